"""The shapes of a wrinkling tool: one for each group of bumps that rise together, at its greatest height.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: the paper
displaces each frame's vertices; here a shape in bind space times a weight does.
"""

import numpy as np

from wrinklecli.character.pose import Pose
from wrinklecli.effects.shapes import Sample, Shape, make_shapes
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.weights import weight_path
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest

# Heights over the greatest at which true normals are sampled if a group's height has several weights.
_FIT_HEIGHTS = (0.25, 0.5, 0.75, 1.0)
REST_SHARE = 1 / 32
"""Weight of the rest pose beside the pose of the tallest wrinkles.

It matters only if that pose closes a fold and makes wrinkles so steep that their normals hardly count: lower wrinkles
would get such normals before the fold closes.
"""


def shapes_of(carried: CarriedPatch, fine: Refinement, rest: Rest, pose: Pose | None) -> list[Shape | None]:
    """A shape for each group of bumps and mode of their profile, in the order of the curve's amplitudes.

    A shape that never rises, or that moves no vertex, is None. Normals are fitted in `pose`, if the mesh has normals.
    """
    curve = carried.patch.curve
    scaled = carried.shapes() * curve.greatest_amplitudes[..., None]
    path = weight_path(curve)
    shapes: list[Shape | None] = []
    for group, heights in enumerate(scaled):
        shapes += make_shapes(
            fine,
            carried.vertices,
            heights[..., None] * carried.directions,
            tallest=np.abs(heights * carried.magnitudes).max(axis=1),
            samples=_samples(path[:, group], rest, pose) if pose is not None else [],
        )
    return shapes


def _samples(weights: Floats, rest: Rest, pose: Pose) -> list[Sample]:
    """States in which a group's normals are to be right, from (rows, modes) weights over all shortenings."""
    sizes = np.abs(weights[:, 0])
    heights = _FIT_HEIGHTS if weights.shape[1] > 1 else (1.0,)
    rows = [weights[int(np.argmin(np.abs(sizes - height * sizes.max())))] for height in heights]
    return [*(Sample(row, pose) for row in rows), Sample(rows[-1], rest.pose, REST_SHARE)]
