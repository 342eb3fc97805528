"""The shapes of a wrinkling tool: one for each group of bumps that rise together, at its greatest height.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: the paper
displaces each frame's vertices; here a shape in bind space times a weight does.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.pose import Pose, pose_at
from wrinklecli.effects.effect import MeshPlan, Motion
from wrinklecli.effects.shapes import Sample, Shape, make_shapes
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.weights import weight_path
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest

# Heights over the greatest at which true normals are sampled if a group's height has several weights.
_FIT_HEIGHTS = (0.25, 0.5, 0.75, 1.0)
# Frames, evenly spread, in which normals are to be right where displacements are projected, beside those with the
# greatest weights.
_FIT_FRAMES = 16
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


def projected_shapes(
    plan: MeshPlan, vertices: Ints, deltas: Floats, motions: Sequence[Motion], weights: Sequence[Floats]
) -> list[Shape | None]:
    """Shapes that give what is projected in each frame (`attachment: patch`), with normals for some of the frames.

    Args:
        plan: The mesh.
        vertices: (vertices,) fine welded vertices, sorted.
        deltas: (shapes, vertices, 3) bind displacement at weight 1.
        motions: All clips.
        weights: (frames, shapes) weights of the shapes in each clip.
    """
    together = np.concatenate(weights)
    even = np.linspace(0, len(together) - 1, _FIT_FRAMES).astype(int)
    rows = distinct_values(np.concatenate([even, np.argmax(together, axis=0)]))
    moments = [(each.clip, time) for each in motions for time in each.times.tolist()]
    return make_shapes(
        plan.fine,
        vertices,
        deltas,
        tallest=plan.scale * np.sqrt(np.sum(deltas**2, axis=2)).max(axis=1, initial=0.0),
        samples=[Sample(together[row], pose_at(plan.rig, *moments[row])) for row in rows] if plan.has_normals else [],
    )


def _samples(weights: Floats, rest: Rest, pose: Pose) -> list[Sample]:
    """States in which a group's normals are to be right, from (rows, modes) weights over all shortenings."""
    sizes = np.abs(weights[:, 0])
    heights = _FIT_HEIGHTS if weights.shape[1] > 1 else (1.0,)
    rows = [weights[int(np.argmin(np.abs(sizes - height * sizes.max())))] for height in heights]
    return [*(Sample(row, pose) for row in rows), Sample(rows[-1], rest.pose, REST_SHARE)]
