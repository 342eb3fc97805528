"""The moment at which a muscle's bulge passes through other skin, as that of a biceps through a bent forearm."""

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import morph_weights
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.muscle.attach import AttachedMuscle
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.intersections import Crossings

# Distance from the insertion up to which a bulge may meet other skin, over the muscle's length: a forearm folds onto
# the upper arm, which is about as long.
_REACH = 1.5


def passes_through(plan: MeshPlan, attached: AttachedMuscle, deltas: Floats, clip: Clip, time: float) -> float:
    """The farthest that a muscle moves skin that passes through other skin at a time, and does not without the muscle.

    Args:
        plan: The mesh.
        attached: The muscle.
        deltas: (targets, fine vertices, 3) its displacements at weight 1, bind space.
        clip: A clip.
        time: Seconds.

    Returns:
        Scene units; 0 if none does.
    """
    fine, rig, belly = plan.fine, plan.rig, attached.belly
    near = ((fine.rest_positions - belly.insertion) ** 2).sum(axis=1) < (_REACH * belly.span) ** 2
    chosen = np.flatnonzero(near)
    moved = np.any(deltas[:, chosen], axis=(0, 2))
    mesh, now = fine.skinned(rig, chosen), np.array([time])
    shown = morph_weights(rig, clip, now)
    relaxed = shown.copy()
    relaxed[:, [rig.morph_names.index(name) for name in attached.drive.targets]] = 0.0
    flexed, flat = (mesh.posed(clip, now, weights=each).positions[0] for each in (shown, relaxed))
    crossings = Crossings.of(fine.rest_positions[chosen], mesh.triangles)
    # Most muscles meet nothing, so that the skin without them need not be looked at.
    after = _pairs(crossings.at(flexed, counting=moved))
    new = np.array(sorted(after - _pairs(crossings.at(flat, counting=moved))) if after else [], np.intp).reshape(-1, 2)
    corners = np.concatenate([crossings.edges[new[:, 0]].ravel(), mesh.triangles[new[:, 1]].ravel()])
    return float(np.sqrt(((flexed - flat)[corners] ** 2).sum(axis=1)).max(initial=0.0))


def _pairs(found: tuple[Ints, Ints]) -> set[tuple[int, int]]:
    """The pairs of an edge and a triangle."""
    return set(zip(*(part.tolist() for part in found), strict=True))
