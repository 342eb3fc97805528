"""Faults of the surface that anyone sees: triangles that an effect turns over in a fold, and refinement that rounds it.

Turned triangles show as teeth, and as dark tiles where light falls on their backs. A triangle is turned over if it
faces away from the surface around it, by the normal of one of its corners. Skinning alone turns triangles over in deep
folds, and the surface inside out; those triangles do not count. Not in the paper.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.effects.effect import MeshPlan, Part, Seen
from wrinklecli.errors import counted
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    determinants,
    distinct_values,
    dot,
    face_normals,
    renumbered,
    vertex_normals,
)
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import carried_normals

# Fraction of the triangles that an effect moves from which on those that it turns over are seen: fewer lie in the fold.
_SEEN = 0.01


def turned_warnings(plan: MeshPlan, part: Part, clips: Sequence[Seen]) -> list[str]:
    """A warning about triangles that an effect turns over where clips move it most."""
    moment = deepest_moment(part, clips)
    if moment is None:
        return []
    clip, time = moment
    count = count_turned_over(part, plan.fine, plan.rig, clip, time)
    if count <= _SEEN * len(plan.fine.around.faces_of(part.vertices)):
        return []
    return [
        f"{part.attached.tool.name}: turns {counted(count, 'triangle')} over in {clip.name} at {time:.3g} s, which"
        f" shows as teeth or dark tiles: {part.attached.flatter}"
    ]


def deepest_moment(part: Part, clips: Sequence[Seen]) -> tuple[Clip, float] | None:
    """The moment at which clips move an effect most, when its wrinkles are tallest; None if no clip moves it."""
    found, greatest = None, 0.0
    for each in clips:
        strengths = part.strengths(each)
        if strengths.max(initial=0.0) > greatest:
            greatest = float(strengths.max())
            found = each.motion.clip, float(each.motion.times[int(np.argmax(strengths))])
    return found


def departure_warnings(fine: Refinement, parts: Iterable[Part]) -> list[str]:
    """Warnings about tools whose refinement rounds the surface visibly, even where nothing wrinkles."""
    return [
        f"{part.attached.tool.name}: refinement moves the surface at rest by {100 * fine.departures[part.region]:.0f} %"
        " of the tallest wrinkle, as the mesh is coarse for it: scheme: midpoint keeps it as it is"
        + (", butterfly nearly" if fine.schemes[part.region] == "butterfly_full" else "")
        for part in parts
        if fine.departs(part.region)
    ]


def turned_over(triangles: Ints, faces: Floats | list[Floats], normals: Floats | list[Floats]) -> Bools:
    """(triangles,) True where a corner's normal encloses more than 90° with the triangle's.

    Coordinate by coordinate, as numpy takes several times as long along an axis of three: `faces` are (3, triangles)
    normals of any length, and `normals` (3, vertices).
    """
    away = np.zeros(len(triangles), np.bool_)
    for corner in triangles.T:
        away |= dot(faces, [each.take(corner) for each in normals]) < 0.0
    return away


def count_turned_over(part: Part, fine: Refinement, rig: Rig, clip: Clip | None, time: float) -> int:
    """Count the triangles that an effect turns over at a moment of a clip, or in the stored pose if `clip` is None."""
    times = np.array([time])
    own = fine.triangles[fine.around.faces_of(part.vertices)]
    used, faces = renumbered(fine.triangles[fine.around.faces_of(distinct_values(own))])
    moves = np.zeros((1, len(used), 3))
    moves[:, np.searchsorted(used, part.vertices)] = part.displacements(fine, rig, clip, times)
    mesh = fine.skinned(rig, used)
    skinned, matrices = mesh.carried(clip, times)
    wrinkled = skinned + np.einsum("fvij,fvj->fvi", matrices, moves)
    shown = np.searchsorted(used, own)
    before, after = (
        turned_over(shown, face_normals(each[0], shown).T, vertex_normals(each[0], faces).T)
        for each in (skinned, wrinkled)
    )
    # Where the surface is inside out, by the normals that joints carry, it is hidden behind what it has passed through.
    outwards = np.sign(determinants(matrices[0]))[:, None] * carried_normals(matrices[0], fine.normals_at(used))
    hidden = turned_over(shown, face_normals(skinned[0], shown).T, outwards.T)
    return int((after & ~before & ~hidden).sum())
