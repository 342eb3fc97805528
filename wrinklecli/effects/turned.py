"""Counts the triangles that an effect turns over in a fold: teeth, and dark tiles where light falls on their backs.

A triangle is turned over if it faces away from the surface around it, by the normal of one of its corners. Skinning
alone turns triangles over in deep folds, and the surface inside out; those triangles do not count. Not in the paper.
"""

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.character.rig import Rig
from wrinklecli.effects.effect import MeshPlan, Part
from wrinklecli.numeric.arrays import Bools, Floats, Ints, determinants, distinct_values, face_normals, vertex_normals
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import carried_normals

# Fraction of the triangles that an effect moves from which on those that it turns over are seen: fewer lie in the fold.
_SEEN = 0.01


def count_teeth(plan: MeshPlan, part: Part, clip: Clip, time: float) -> int:
    """Count the triangles that an effect turns over at a moment of a clip; 0 if they are too few to be seen."""
    count = count_turned_over(part, plan.fine, plan.rig, clip, time)
    return count if count > _SEEN * len(plan.fine.around.faces_of(part.vertices)) else 0


def turned_over(faces: Floats, normals: Floats) -> Bools:
    """(triangles,) True where a corner's normal encloses more than 90° with the triangle's.

    `faces` are (triangles, 3) normals of any length, `normals` (triangles, 3, 3) those of the corners.
    """
    away: Bools = (np.einsum("tx,tcx->tc", faces, normals) < 0.0).any(axis=1)
    return away


def count_turned_over(part: Part, fine: Refinement, rig: Rig, clip: Clip | None, time: float) -> int:
    """Count the triangles that an effect turns over at a moment of a clip, or in the stored pose if `clip` is None."""
    times = np.array([time])
    own = fine.triangles[fine.around.faces_of(part.vertices)]
    used, faces = np.unique(fine.triangles[fine.around.faces_of(distinct_values(own))], return_inverse=True)
    weights = fine.dense_weights(used, fine.weights.shape[1])
    acting = np.flatnonzero(weights.any(axis=0))
    blended = blend(weights[:, acting], joint_matrices(rig, clip, times, acting))
    morphs = morph_weights(rig, clip, times)[0]
    bind = fine.positions[used] + np.tensordot(morphs, fine.morph_deltas[:, used], axes=1)
    wrinkled = bind.copy()
    wrinkled[np.searchsorted(used, part.vertices)] += part.displacements(fine, rig, clip, times)[0]
    shown, faces = np.searchsorted(used, own), faces.reshape(-1, 3)
    before, after = (_turned_over(transform(blended, each)[0], shown, faces) for each in (bind, wrinkled))
    # Where the surface is inside out, by the normals that joints carry, it is hidden behind what it has passed through.
    outwards = np.sign(determinants(blended[0, :, :, :3]))[:, None] * carried_normals(blended[0], fine.normals_at(used))
    hidden = turned_over(face_normals(transform(blended, bind)[0], shown), outwards[shown])
    return int((after & ~before & ~hidden).sum())


def _turned_over(positions: Floats, triangles: Ints, around: Ints) -> Bools:
    """(triangles,) True if turned over, by the normals of all the triangles `around` their corners."""
    return turned_over(face_normals(positions, triangles), vertex_normals(positions, around)[triangles])
