"""What of an asset the page draws: meshes of points that move, coloured, and lines and dots of its tools on them.

Normals are the browser's, of the shown triangles: vertices that the file splits at texture seams are joined again where
their stored normals are equal, so that hard edges stay hard and seams are not seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.editor.shown import LaidMesh, LaidTool
from wrinklecli.numeric.arrays import Floats, Ints, among, distinct, distinct_values, face_normals, unit
from wrinklecli.numeric.nearest import closest_point, distances_along
from wrinklecli.review.preview.materials import Paint

# Stored normals that differ by less are one: an 8-bit normal's step.
_NORMAL_STEP = 1 / 127
# Spots on each side of a patch's border, and on the line from origin to target.
_SIDE = 24
# Barycentric coordinates may be below 0 by so much: points between triangles are on one of them.
_EDGE = 1e-9


@dataclass(frozen=True, slots=True)
class DrawnMesh:
    """What of a body has one paint.

    Attributes:
        triangles: (triangles, 3) its vertices.
        points: (vertices,) the body's point that each vertex is at.
        paint: What colours its vertices.
    """

    triangles: Ints
    points: Ints
    paint: Paint


@dataclass(frozen=True, slots=True)
class Body:
    """A mesh of the asset, as a surface of points that move.

    Attributes:
        triangles: (triangles, 3) of points.
        meshes: What is drawn of it.
    """

    triangles: Ints
    meshes: tuple[DrawnMesh, ...]


@dataclass(frozen=True, slots=True)
class Spots:
    """Places on a body, which move with it.

    Attributes:
        body: Its number.
        triangles: (spots,) of the body.
        barycentrics: (spots, 3).
    """

    body: int
    triangles: Ints
    barycentrics: Floats

    def on(self, body: Body, points: Floats, lift: float = 0.0) -> Floats:
        """(spots, 3) where they are, the body's (points, 3) being there; so far above the surface, scene units."""
        places = np.einsum("sc,sca->sa", self.barycentrics, points[body.triangles[self.triangles]])
        return np.asarray(places + lift * self.normals(body, points)) if lift else np.asarray(places)

    def normals(self, body: Body, points: Floats) -> Floats:
        """(spots, 3) unit normals of the surface there."""
        return unit(face_normals(points, body.triangles[self.triangles]))


@dataclass(frozen=True, slots=True)
class Mark:
    """A tool, drawn on its body.

    Attributes:
        name: Of the tool.
        colour: sRGB, 0 to 1.
        spots: The places of it.
        segments: (segments, 2) lines between spots: the border of the patch and the line along it.
        anchors: (anchors,) spots, from origin to target.
        edges: (edges,) spots by which the hand takes hold of the patch's width.
    """

    name: str
    colour: tuple[float, float, float]
    spots: Spots
    segments: Ints
    anchors: Ints
    edges: Ints


def body_of(mesh: LaidMesh, paints: Sequence[Paint]) -> Body:
    """A mesh with its tools, to be drawn.

    Args:
        mesh: The mesh.
        paints: Of its primitives.
    """
    surface = mesh.ground.surface
    weld, normals = [surface.weld], [surface.normals]
    colours = [np.concatenate([paint.colours for paint in paints])]
    coordinates = [np.concatenate([paint.coordinates for paint in paints])]
    corners, primitives = [surface.corners[mesh.kept]], [surface.primitives[mesh.kept]]
    old, shift = len(surface.weld), 0
    for cluster, moved in zip(mesh.clusters, mesh.shifts, strict=True):
        fine = cluster.plan.fine
        found = fine.corners[cluster.triangles]
        corners.append(np.where(found < old, found, found + shift))
        primitives.append(fine.triangle_primitives[cluster.triangles])
        points = fine.weld[old:]
        weld.append(np.where(points < cluster.old_count, points, points + moved))
        shift += len(points)
        for values in (normals, colours, coordinates):
            values.append(np.einsum("vk,vka->va", fine.shares, values[0][fine.sources]))
    every, owners, at = np.concatenate(corners), np.concatenate(primitives), np.concatenate(weld)
    turned, shades, places = unit(np.concatenate(normals)), np.concatenate(colours), np.concatenate(coordinates)
    meshes = []
    for number, paint in enumerate(paints):
        triangles = every[owners == number]
        if not len(triangles):
            continue
        if paint.texture is None:
            firsts, joined = _joined(triangles, at, turned, shades)
        else:
            firsts = distinct_values(triangles)
            joined = np.searchsorted(firsts, triangles)
        made = replace(paint, colours=shades[firsts], coordinates=places[firsts])
        meshes.append(DrawnMesh(joined, at[firsts], made))
    return Body(mesh.faces, tuple(meshes))


def _joined(triangles: Ints, points: Ints, normals: Floats, colours: Floats) -> tuple[Ints, Ints]:
    """Join glTF vertices that are at one point with one normal and one colour.

    Returns:
        (joined,) a glTF vertex of each, and (triangles, 3) of these.
    """
    used = distinct_values(triangles)
    keys = np.column_stack([points[used], np.round(normals[used] / _NORMAL_STEP), np.round(255 * colours[used])])
    firsts, numbers = distinct(keys)
    return used[firsts], numbers[np.searchsorted(used, triangles)]


def mark_of(tool: LaidTool, mesh: LaidMesh, body: int, colour: tuple[float, float, float]) -> Mark:
    """A tool, to be drawn on its mesh, the body of a number."""
    patch, surface = tool.carried.patch, mesh.ground.surface
    near = mesh.ground.rest.around.faces_of(distinct_values(surface.triangles[patch.members]))
    faces = np.flatnonzero(among(mesh.parents, near))
    corners = mesh.rest_positions[mesh.faces[faces]]
    u, v = patch.coordinates(corners)
    outward = patch.cosines(u.mean(axis=1), unit(face_normals(mesh.rest_positions, mesh.faces[faces]))) > 0
    faces, places = faces[outward], np.stack([u, v], axis=2)[outward]
    ends = np.linspace(0.0, 1.0, _SIDE)
    sides = [
        np.column_stack([ends, np.full(_SIDE, 1.0)]),
        np.column_stack([ends, np.full(_SIDE, -1.0)]),
        np.column_stack([np.zeros(_SIDE), 2 * ends - 1]),
        np.column_stack([np.ones(_SIDE), 2 * ends - 1]),
        np.column_stack([ends, np.zeros(_SIDE)]),
    ]
    sought = np.concatenate([*sides, [(0.5, 1.0), (0.5, -1.0)]])
    found, barycentrics = _located(sought, places)
    lines = np.arange(len(sides) * _SIDE).reshape(len(sides), _SIDE)
    segments = np.stack([lines[:, :-1].ravel(), lines[:, 1:].ravel()], axis=1)
    anchors = [_anchored(mesh.rest_positions[mesh.faces[faces]], anchor.position) for anchor in patch.anchors]
    numbers = len(sought) + np.arange(len(anchors))
    return Mark(
        name=patch.tool.name,
        colour=colour,
        spots=Spots(
            body,
            faces[np.concatenate([np.maximum(found, 0), [number for number, _ in anchors]])],
            np.concatenate([barycentrics, [each for _, each in anchors]]),
        ),
        segments=segments[(found[segments] >= 0).all(axis=1)],
        anchors=numbers,
        edges=np.flatnonzero(found[-2:] >= 0) + len(sought) - 2,
    )


def _anchored(corners: Floats, position: Floats) -> tuple[int, Floats]:
    """The nearest of (triangles, 3, 3) to a (3,) point, and (3,) where on it."""
    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    number, barycentrics, _ = closest_point(corners.reshape(-1, 3), triangles, position)
    return number, barycentrics


def _located(sought: Floats, places: Floats) -> tuple[Ints, Floats]:
    """Which of (triangles, 3, 2) triangles of a plane (points, 2) are in, and where there.

    Returns:
        (points,) the first triangle; -1 where there is none. (points, 3) barycentric coordinates.
    """
    low, high = places.min(axis=1), places.max(axis=1)
    found, barycentrics = np.full(len(sought), -1), np.tile((1.0, 0.0, 0.0), (len(sought), 1))
    for number, point in enumerate(sought):
        near = np.flatnonzero(((low <= point) & (point <= high)).all(axis=1))
        if not len(near):
            continue
        a, b, c = places[near].transpose(1, 0, 2)
        ab, ac, ap = b - a, c - a, point - a
        area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
        safe = np.where(area != 0, area, 1.0)
        second = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / safe
        third = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / safe
        shares = np.stack([1 - second - third, second, third], axis=1)
        inside = np.flatnonzero((shares >= -_EDGE).all(axis=1) & (area != 0))
        if len(inside):
            found[number], barycentrics[number] = near[inside[0]], shares[inside[0]]
    return found, barycentrics


def picked(origin: Floats, direction: Floats, points: Floats, triangles: Ints) -> tuple[float, int, Floats] | None:
    """Where a ray first meets a mesh.

    Args:
        origin: (3,).
        direction: (3,) in whose length the distance is measured.
        points: (points, 3).
        triangles: (triangles, 3).

    Returns:
        The distance, the triangle and (3,) barycentric coordinates; None where it misses.
    """
    if not len(triangles):
        return None
    corners = points[triangles]
    distances = distances_along(origin, direction, corners)
    nearest = int(np.argmin(distances))
    if not np.isfinite(distances[nearest]):
        return None
    place = origin + distances[nearest] * direction
    a, b, c = corners[nearest]
    normal = np.cross(b - a, c - a)
    area = float(normal @ normal)
    second = float(np.cross(place - a, c - a) @ normal) / area
    third = float(np.cross(b - a, place - a) @ normal) / area
    return float(distances[nearest]), nearest, np.clip(np.array([1 - second - third, second, third]), 0.0, 1.0)
