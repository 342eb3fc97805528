"""The shapes of a wrinkling tool: one for each group of bumps that rise together, at its greatest height.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: the paper
displaces each frame's vertices; here a shape in bind space times a weight does.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.effects.shapes import Middles, Sample, Shape, make_shapes
from wrinklecli.effects.wrinkle.bending import Risen
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.places import Places
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.numeric.intersections import edges_of
from wrinklecli.surface.refine import Refinement


def shapes_of(carried: CarriedPatch, fine: Refinement, risen: Sequence[Risen]) -> list[Shape | None]:
    """A shape for each group of bumps and mode of their profile, in the order of the curve's amplitudes.

    A shape that never rises, or that moves no vertex, is None. Normals are fitted in the poses of the moments in which
    wrinkles have `risen`; there are none on a mesh without normals.
    """
    curve = carried.patch.curve
    scaled = carried.shapes() * curve.greatest_amplitudes[..., None]
    between = _Between.of(carried, fine) if risen else None
    shapes: list[Shape | None] = []
    for group, heights in enumerate(scaled):
        deltas = heights[..., None] * carried.directions
        shapes += make_shapes(
            fine,
            carried.vertices,
            deltas,
            tallest=np.abs(heights * carried.magnitudes).max(axis=1),
            samples=[Sample(each.weights[group], each.pose) for each in risen],
            middles=between.middles(group, deltas) if between is not None else None,
        )
    return shapes


@dataclass(frozen=True, slots=True)
class _Between:
    """The middles of the edges round a tool's vertices, which have their own places on its patch.

    Attributes:
        edges: (edges,) numbers of the edges, as `Middles` has them.
        ends: (edges, 2) which of the tool's vertices the ends are; the number of vertices for all others.
        heights: (groups, modes, edges) heights of the curve at its greatest amplitudes.
        directions: (edges, 3) bind displacement for a curve height of 1.
    """

    edges: Ints
    ends: Ints
    heights: Floats
    directions: Floats

    @classmethod
    def of(cls, carried: CarriedPatch, fine: Refinement) -> "_Between":
        """Place the middles. What features, masks and sharp folds leave of their height is the mean of the ends'."""
        patch = carried.patch
        edges = edges_of(fine.triangles[fine.around.faces_of(carried.vertices)])
        used, ends = np.unique(edges, return_inverse=True)
        ends, own = ends.reshape(-1, 2), np.searchsorted(used, carried.vertices)
        positions, facing = fine.posed_at(patch.pose, used)

        def placed(positions: Floats, facing: Floats) -> Places:
            u, v = patch.coordinates(positions)
            return patch.places(u, v, patch.cosines(u, facing))

        whole = placed(positions, facing).factors
        kept = np.zeros(len(used))
        kept[own] = np.divide(carried.magnitudes, whole[own], out=np.zeros(len(own)), where=whole[own] != 0.0)
        # Ends beside the patch do not say what is left on it.
        one, other = ends.T
        left = (kept[one] + kept[other]) / np.maximum(1 * (whole != 0.0)[one] + (whole != 0.0)[other], 1)

        def halfway(values: Floats) -> Floats:
            between: Floats = (values[one] + values[other]) / 2.0
            return between

        middles = placed(halfway(positions), unit(halfway(facing))).times(left)
        numbers = np.full(len(used), len(own))
        numbers[own] = np.arange(len(own))
        return cls(
            edges=Middles.numbers_of(edges, fine),
            ends=numbers[ends],
            heights=middles.shapes(patch.curve) * patch.curve.greatest_amplitudes[..., None],
            directions=halfway(fine.raising_at(used)) * middles.factors[:, None],
        )

    def middles(self, group: int, deltas: Floats) -> Middles:
        """The middles of a group's shapes, from the (modes, vertices, 3) deltas of the tool's vertices."""
        padded = np.pad(deltas, ((0, 0), (0, 1), (0, 0)))
        straight = (padded[:, self.ends[:, 0]] + padded[:, self.ends[:, 1]]) / 2.0
        return Middles(self.edges, self.heights[group, ..., None] * self.directions - straight)
