"""What lies under another layer of a character in the pose that folds it: a belly under a cape, a knee in trousers.

Rays leave the region along its normals. A layer that covers it is met from inside: clothes look away from the body
that they are on, where a forearm before an upper arm looks at it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.scene import ScenePrimitive, pose_primitive
from wrinklecli.numeric.arrays import Floats, face_normals, unit
from wrinklecli.numeric.nearest import distances_along, near_points
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.surface.strain import posed

# How far away a layer still covers, and how thick it may be, as parts of the diagonal of the mesh's box: 20 cm and
# 14 mm on a person.
_REACH, _THICKNESS = 0.12, 0.008
# Nearer than this part of the diagonal, a ray has not left its own triangle.
_SELF = 1e-6
# Cosine of a ray and the normal of a triangle that is met from inside, or from outside below the negative.
_ALONG = 0.2
# Rays of a region: its triangles that lose most.
_RAYS = 32
# Part of a region that is covered where all of it is hidden.
_HIDDEN = 0.6


@dataclass(frozen=True, slots=True)
class Layers:
    """What a mesh may lie under.

    Attributes:
        mesh: The mesh.
        others: What the scene shows beside it.
    """

    mesh: MeasuredMesh
    others: tuple[ScenePrimitive, ...]


def layers_over(mesh: MeasuredMesh, scene: Sequence[ScenePrimitive]) -> Layers:
    """Get ready to say what of a mesh is covered by others, or by other pieces of it."""
    others = tuple(each for each in scene if each.rig.node != mesh.rig.node and len(each.triangles))
    return Layers(mesh, others)


def is_covered(layers: Layers, shares: Floats, clip: Clip, time: float) -> bool:
    """Whether most of a region lies under another layer in a pose.

    Args:
        layers: Over its mesh.
        shares: (triangles,) of the gauge, the region's shares.
        clip: The animation.
        time: Seconds.
    """
    gauge = layers.mesh.gauge
    chosen = np.argsort(-shares, kind="stable")[:_RAYS]
    chosen = chosen[shares[chosen] > 0]
    own, _ = posed(gauge, clip, np.array([time]))
    faces = face_normals(own[0], gauge.triangles[chosen])
    at_rest = face_normals(layers.mesh.rest.positions, gauge.triangles[chosen])
    # Normals look outwards at rest, whichever way triangles wind.
    outward = np.sign(np.sum(at_rest * layers.mesh.rest.normals[gauge.triangles[chosen]].sum(axis=1), axis=1))
    rays = unit(faces) * outward[:, None]
    starts = own[0][gauge.triangles[chosen]].mean(axis=1)
    size = float(np.linalg.norm(np.ptp(layers.mesh.rest.positions, axis=0)))
    corners = [own[0][gauge.triangles[~np.isin(gauge.pieces, gauge.pieces[chosen])]]]
    for other in layers.others:
        shown = pose_primitive(other, clip, np.array([time]))
        if not shown.hidden[0]:
            faces_of = other.triangles[:, ::-1] if shown.mirrored[0] else other.triangles
            corners.append(shown.positions[0][faces_of])
    covered = _met_from_inside(starts, rays, np.concatenate(corners), size)
    weights = shares[chosen]
    return bool(weights @ covered > _HIDDEN * weights.sum())


def _met_from_inside(starts: Floats, rays: Floats, corners: Floats, size: float) -> Floats:
    """(rays,) 1 for those that meet the inside of a layer before they meet anything thicker.

    Args:
        starts: (rays, 3).
        rays: (rays, 3) unit.
        corners: (triangles, 3, 3) of the layers.
        size: Of the character, scene units.
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
