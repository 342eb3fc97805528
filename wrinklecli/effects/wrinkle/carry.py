"""A tool carried by the skin: the vertices of the refined surface that it moves, their directions and distances.

A vertex keeps the (u, v) that it has on the patch in the pose in which the tool is laid, mostly at rest, and its
displacement direction is the rest normal carried by the skin. So a tool's displacement is a sum of fixed shapes times
amplitudes, which depend only on the distance of its anchors.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: the paper
projects vertices onto the patch anew each frame, as module `posed` does for `attachment: patch`.
"""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.effects.shapes import LEAST_SHARE
from wrinklecli.effects.wrinkle.activity import activity
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.places import Places
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, children, distinct_values, singular
from wrinklecli.surface.refine import Refinement

if TYPE_CHECKING:
    from wrinklecli.effects.wrinkle.posed import Ring


@dataclass(frozen=True)
class CarriedPatch:
    """A tool on the vertices that it moves.

    Attributes:
        vertices: (vertices,) fine welded vertices that move, sorted.
        places: Their places on the control curve; the factors are world displacements at rest over the curve's height.
        directions: (vertices, 3) bind displacement for a curve height of 1.
        stuck: The number of members that stay put because their joints' blend is singular at rest.
        ring: The surface that is posed in each frame; None for `attachment: skin`.
    """

    patch: Patch
    vertices: Ints
    places: Places
    directions: Floats
    stuck: int
    ring: "Ring | None"

    @property
    def us(self) -> Floats:
        """(vertices,) places along the control curve."""
        return self.places.us

    @property
    def magnitudes(self) -> Floats:
        """(vertices,) world displacement at rest over the curve's height."""
        return self.places.factors

    def left_by_features(self, fine: Refinement) -> float:
        """The part of the height that features of the surface leave, in the mean over the vertices that move."""
        places, _ = fine.posed_at(self.patch.pose, self.vertices)
        left = self.patch.left(fine.subdivision, self.vertices, places)
        if left is None:
            return 1.0
        sizes = np.abs(self.magnitudes)
        return float(sizes.sum() / (sizes / np.maximum(left, LEAST_SHARE)).sum())

    def times(self, factors: Floats) -> "CarriedPatch":
        """The tool with (vertices,) factors on its height."""
        return replace(
            self,
            places=self.places.times(factors),
            directions=self.directions * factors[:, None],
            ring=self.ring and replace(self.ring, kept=self.ring.kept * factors),
        )

    def tallest(self, amplitudes: Floats, clip: Clip) -> float:
        """Greatest height of a vertex over the surface at rest, scene units: what features, folds and masks leave.

        (frames, groups, modes) `amplitudes` are those in the clip. Only frames in which some bump is tallest count.
        """
        if not len(amplitudes):
            return 0.0
        highest = distinct_values(np.argmax(np.abs(self.patch.curve.heights(amplitudes)), axis=0).ravel())
        heights = np.einsum("fgm,gmv->fv", amplitudes[highest], self.shapes) * self.magnitudes
        return abs(self.patch.clip_strength(clip)) * float(np.abs(heights).max())

    @cached_property
    def shapes(self) -> Floats:
        """(groups, modes, vertices) heights of the curve per unit of amplitude."""
        return self.places.shapes(self.patch.curve)


def carry(patch: Patch, fine: Refinement, pinned: Bools) -> CarriedPatch:
    """Attach the vertices under a patch to it, at rest; (coarse vertices,) `pinned` ones must not move.

    Raises:
        BakeError: The tool moves no vertex.
    """
    members = distinct_values(fine.triangles[children(fine.subdivision.parents, patch.members)])
    positions, facing = fine.posed_at(patch.pose, members)
    u, v = patch.coordinates(positions)
    places = patch.places(u, v, patch.cosines(u, facing))
    old = members < len(pinned)
    kept = np.ones(len(members))
    kept[old] = ~pinned[members[old]]
    left = patch.left(fine.subdivision, members, positions)
    if left is not None:
        kept *= left
    if patch.mask is not None:
        kept *= patch.mask.on_refined(fine, patch.members, members)
    places = places.times(kept)
    magnitudes = places.factors
    regular = ~singular(fine.blended_at(fine.rest, members))
    moving = np.abs(magnitudes) > LEAST_SHARE * abs(patch.shape_strength)
    if left is not None and not (regular & moving).any():
        # A tool that lies on features alone was meant to wrinkle them.
        return carry(replace(patch, reach=None), fine, pinned)
    if not (regular & moving).any():
        raise BakeError("moves no vertex: the mesh faces away or lies beside the patch", where=patch.tool.where)
    # If members are projected anew in each frame, any of them may come to lie on the patch.
    chosen = regular & (moving if patch.tool.attachment == "skin" else True)
    vertices, ring = members[chosen], None
    if patch.tool.attachment == "patch":
        from wrinklecli.effects.wrinkle.posed import ring_around  # few tools ask for it

        ring = ring_around(patch, vertices, kept[chosen], fine)
    return CarriedPatch(
        patch=patch,
        vertices=vertices,
        places=places.of(chosen),
        directions=fine.raising_at(vertices) * magnitudes[chosen, None],
        # A singular blend gives no normal either, and no magnitude.
        stuck=int(((u >= 0) & (u <= 1) & (np.abs(v) <= 1) & ~regular).sum()),
        ring=ring,
    )


def displacements(
    carried: CarriedPatch,
    fine: Refinement,
    rig: Rig,
    clip: Clip | None,
    times: Floats,
    amplitudes: Floats | None = None,
) -> Floats:
    """(frames, vertices, 3) the method's displacements of a tool's vertices, bind space.

    Args:
        carried: The tool.
        fine: The refined surface.
        rig: The rig of the mesh.
        clip: The clip; None for the stored pose.
        times: (frames,) seconds.
        amplitudes: (frames, groups, modes) amplitudes at these times, if they are known.
    """
    patch = carried.patch
    if amplitudes is None:
        amplitudes = activity(patch, rig, clip, times).amplitudes
    amplitudes = patch.clip_strength(clip) * amplitudes
    if carried.ring is not None:
        from wrinklecli.effects.wrinkle.posed import posed_displacements

        return posed_displacements(patch, carried.ring, fine, rig, clip, times, amplitudes)
    heights = np.einsum("fgm,gmv->fv", amplitudes, carried.shapes)
    return np.asarray(heights[..., None] * carried.directions)
