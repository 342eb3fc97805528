"""Regions that another layer covers in the pose that folds them: a belly under a cape, a knee in trousers.

Rays leave the region along its normals. They meet a layer that covers it from inside: clothes look away from the body
that wears them, whereas a forearm in front of an upper arm looks at it.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.scene import ScenePrimitive, pose_primitive
from wrinklecli.numeric.arrays import Floats, face_normals, unit
from wrinklecli.numeric.nearest import distances_along, near_points
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.surface.strain import posed

# Greatest distance of a covering layer, as a part of the diagonal of the mesh's box: 20 cm on a person.
_REACH = 0.12
# Greatest thickness of a covering layer, as a part of this diagonal: 14 mm on a person.
_THICKNESS = 0.008
# Distance below which a ray has not left its own triangle, as a part of this diagonal.
_SELF = 1e-6
# Least cosine of a ray and the normal of a triangle that it meets from inside; below the negative, from outside.
_ALONG = 0.2
# Most rays of a region: from the triangles that lose most.
_RAYS = 32
# Part of a region that must be covered for the whole to count as hidden.
_HIDDEN = 0.6


def is_covered(mesh: MeasuredMesh, scene: Sequence[ScenePrimitive], weights: Floats, clip: Clip, time: float) -> bool:
    """True if most of a region, with (triangles,) `triangle_weights`, lies under another layer in a pose.

    Layers are the other primitives of the scene, and the pieces of the mesh that the region is not on.
    """
    gauge = mesh.gauge
    chosen = np.argsort(-weights, kind="stable")[:_RAYS]
    chosen = chosen[weights[chosen] > 0]
    own, _ = posed(gauge, clip, np.array([time]))
    faces = face_normals(own[0], gauge.triangles[chosen])
    at_rest = face_normals(mesh.rest.positions, gauge.triangles[chosen])
    # Normals point outwards at rest, whichever way triangles wind.
    outward = np.sign(np.sum(at_rest * mesh.rest.normals[gauge.triangles[chosen]].sum(axis=1), axis=1))
    rays = unit(faces) * outward[:, None]
    starts = own[0][gauge.triangles[chosen]].mean(axis=1)
    size = float(np.linalg.norm(np.ptp(mesh.rest.positions, axis=0)))
    corners = [own[0][gauge.triangles[~np.isin(gauge.pieces, gauge.pieces[chosen])]]]
    for other in scene:
        if other.rig.node == mesh.rig.node or not len(other.triangles):
            continue
        shown = pose_primitive(other, clip, np.array([time]))
        if not shown.hidden[0]:
            faces_of = other.triangles[:, ::-1] if shown.mirrored[0] else other.triangles
            corners.append(shown.positions[0][faces_of])
    covered = _met_from_inside(starts, rays, np.concatenate(corners), size)
    return bool(weights[chosen] @ covered > _HIDDEN * weights[chosen].sum())


def _met_from_inside(starts: Floats, rays: Floats, corners: Floats, size: float) -> Floats:
    """(rays,) 1 for rays that meet the inside of a layer before they meet anything thicker; else 0.

    Args:
        starts: (rays, 3)
        rays: (rays, 3) unit.
        corners: (triangles, 3, 3) of the layers.
        size: Diagonal of the mesh's box, scene units.
    """
    near = corners[near_points(corners, starts, _REACH * size)]
    covered = np.zeros(len(starts))
    if not len(near):
        return covered
    normals = unit(np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0]))
    for number, (start, ray) in enumerate(zip(starts, rays, strict=True)):
        distances = distances_along(start, ray, near)
        hit = (distances > _SELF * size) & (distances < _REACH * size)
        cosines = normals[hit] @ ray
        inside, outside = (distances[hit][cosines * sign > _ALONG] for sign in (1.0, -1.0))
        covered[number] = len(inside) and inside.min() < outside.min(initial=np.inf) + _THICKNESS * size
    return covered
