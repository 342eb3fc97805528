"""What of an asset the page draws: meshes of points that move, coloured, and lines and dots of its tools on them.

Normals are the browser's, of the shown triangles: vertices that the file splits at texture seams are joined again where
their stored normals are equal, so that hard edges stay hard and seams are not seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.editor.attached import AttachedTool, PlayableMesh
from wrinklecli.numeric.arrays import Floats, Ints, among, distinct, distinct_values, face_normals, unit
from wrinklecli.numeric.nearest import distances_along
from wrinklecli.review.preview.paints import Paint

# Stored normals that differ by less are one: an 8-bit normal's step.
_NORMAL_STEP = 1 / 127
# Spots on each line, with one in its middle, and lines: the four sides of a patch, and that from origin to target.
_SIDE, _LINES = 25, 5
# Of a tool's length.
_LIFT = 0.015
# Barycentric coordinates may be below 0 by so much: points between triangles are on one of them.
_EDGE = 1e-6


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
class SurfacePoints:
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
class ToolOutline:
    """A tool, drawn on its body.

    Attributes:
        name: Of the tool.
        colour: sRGB, 0 to 1.
        spots: The places of it.
        segments: (segments, 2) lines between spots: the border of the patch and the line along it.
        anchors: (anchors,) spots, from origin to target.
        lift: How far above the surface it is drawn, so as not to sink into it between its spots, scene units.
        edges: (edges,) spots by which the hand takes hold of the patch's width: as far aside as they are on it.
    """

    name: str
    colour: tuple[float, float, float]
    spots: SurfacePoints
    segments: Ints
    anchors: Ints
    edges: Ints
    lift: float


def body_of(mesh: PlayableMesh, paints: Sequence[Paint]) -> Body:
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


def mark_of(tool: AttachedTool, mesh: PlayableMesh, body: int, colour: tuple[float, float, float]) -> ToolOutline:
    """A tool, to be drawn on its mesh, the body of a number."""
    patch, surface = tool.carried.patch, mesh.ground.surface
    near = mesh.ground.rest.around.faces_of(distinct_values(surface.triangles[patch.members]))
    faces = np.flatnonzero(among(mesh.parents, near))
    corners = mesh.rest_positions[mesh.faces[faces]]
    u, v = patch.coordinates(corners)
    outward = patch.cosines(u.mean(axis=1), unit(face_normals(mesh.rest_positions, mesh.faces[faces]))) > 0
    faces, places = faces[outward], np.stack([u, v], axis=2)[outward]
    ends, ones = np.linspace(0.0, 1.0, _SIDE), np.ones(_SIDE)
    sought = [
        np.column_stack(line)
        for line in ((ends, ones), (ends, -ones), (0 * ends, 2 * ends - 1), (ones, 2 * ends - 1), (ends, 0 * ends))
    ]
    for anchor in patch.anchors:
        sought.append(np.column_stack([np.atleast_1d(each) for each in patch.coordinates(anchor.position)]))
    # From the middle to either side: a wide patch may end where the surface faces away.
    sought += [np.column_stack([0.5 * ones, side * ends]) for side in (1.0, -1.0)]
    located = [_located(line, places) for line in sought]
    found, barycentrics = (np.concatenate(each) for each in zip(*located, strict=True))
    lines = np.arange(_LINES * _SIDE).reshape(_LINES, _SIDE)
    segments = np.stack([lines[:, :-1].ravel(), lines[:, 1:].ravel()], axis=1)
    sides = np.arange(len(found) - 2 * _SIDE, len(found)).reshape(2, _SIDE)
    reached = np.cumprod(found[sides] >= 0, axis=1).sum(axis=1)
    edges = [int(side[count - 1]) for side, count in zip(sides, reached, strict=True) if count > 1]
    return ToolOutline(
        name=patch.tool.name,
        colour=colour,
        spots=SurfacePoints(body, faces[np.maximum(found, 0)], barycentrics),
        segments=segments[(found[segments] >= 0).all(axis=1)],
        anchors=np.arange(lines.size, int(sides[0, 0])),
        edges=np.array(edges, np.intp),
        lift=_LIFT * patch.span,
    )


def _located(line: Floats, places: Floats) -> tuple[Ints, Floats]:
    """Which of (triangles, 3, 2) triangles of a plane the (points, 2) of a line are in, and where there.

    Returns:
        (points,) the first triangle; -1 where there is none. (points, 3) barycentric coordinates.
    """
    low, high = line.min(axis=0) - _EDGE, line.max(axis=0) + _EDGE
    inside = np.ones(len(places), bool)
    for axis in (0, 1):
        a, b, c = places[:, :, axis].T
        inside &= np.minimum(np.minimum(a, b), c) <= high[axis]
        inside &= np.maximum(np.maximum(a, b), c) >= low[axis]
    near = np.flatnonzero(inside)
    found, barycentrics = np.full(len(line), -1), np.tile((1.0, 0.0, 0.0), (len(line), 1))
    if not len(near):
        return found, barycentrics
    a, b, c = places[near].transpose(1, 2, 0)
    ab, ac = b - a, c - a
    ap = line[:, :, None] - a
    area = ab[0] * ac[1] - ab[1] * ac[0]
    solid = np.abs(area) > 0
    safe = np.where(solid, area, 1.0)
    second = (ap[:, 0] * ac[1] - ap[:, 1] * ac[0]) / safe
    third = (ab[0] * ap[:, 1] - ab[1] * ap[:, 0]) / safe
    hits = (second >= -_EDGE) & (third >= -_EDGE) & (second + third <= 1 + _EDGE) & solid
    there = np.flatnonzero(hits.any(axis=1))
    first = np.argmax(hits[there], axis=1)
    found[there] = near[first]
    x, y = second[there, first], third[there, first]
    barycentrics[there] = np.stack([1 - x - y, x, y], axis=1)
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
