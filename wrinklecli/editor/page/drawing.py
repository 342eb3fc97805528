"""Geometry that the page draws: coloured meshes of moving points, and outlines of tools on them.

The browser computes normals from the shown triangles. Vertices that the file splits at texture seams are therefore
joined if their stored normals are equal: seams stay invisible, and hard edges stay hard.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.paints import Paint
from wrinklecli.editor.attached import AttachedBelow, AttachedTool, PlayableMesh
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, among, distinct, distinct_values, face_normals, renumbered, unit
from wrinklecli.numeric.closest import closest_point
from wrinklecli.numeric.edges import Edges
from wrinklecli.numeric.intersections import zero_lines

_NORMAL_STEP = 1 / 127  # difference of stored normals that counts as none: the step of an 8-bit normal
_SAMPLES = 24  # points of a line that is laid over a surface: a limb that it goes round has as many sides
_LIFT = 0.015  # height of an outline above the surface over the tool's length


@dataclass(frozen=True, slots=True)
class DrawnMesh:
    """The part of a body that has one material.

    Attributes:
        triangles: (triangles, 3) vertices.
        points: (vertices,) point of the body at each vertex.
        paint: Colours of the vertices.
    """

    triangles: Ints
    points: Ints
    paint: Paint


@dataclass(frozen=True, slots=True)
class Body:
    """A mesh of the asset as a surface of moving points, joined by (triangles, 3) of them."""

    triangles: Ints
    meshes: tuple[DrawnMesh, ...]


@dataclass(frozen=True, slots=True)
class SurfacePoints:
    """Points on a body that move with it.

    Attributes:
        body: Number of the body.
        triangles: (points,) triangle of the body.
        barycentrics: (points, 3) coordinates in the triangle.
    """

    body: int
    triangles: Ints
    barycentrics: Floats

    def positions(self, body: Body, points: Floats, lift: float = 0.0) -> Floats:
        """(points, 3) positions on a body with (points, 3) positions, raised above the surface by `lift`."""
        places = np.einsum("sc,sca->sa", self.barycentrics, points[body.triangles[self.triangles]])
        return np.asarray(places + lift * self.normals(body, points)) if lift else np.asarray(places)

    def normals(self, body: Body, points: Floats) -> Floats:
        """(points, 3) unit normals of the surface."""
        return unit(face_normals(points, body.triangles[self.triangles]))


@dataclass(frozen=True, slots=True)
class ToolOutline:
    """A tool, drawn on its body.

    Attributes:
        colour: sRGB, 0 to 1.
        segments: (segments, 2) lines between `points`: the border of the patch and the line along it.
        anchors: (anchors,) numbers of `points`, from origin to target.
        edges: (edges,) numbers of `points` at the sides of the patch, by which its width is dragged.
        skins: (skins,) numbers of `points` by which the skin of a touch is dragged.
        length: Of the tool, by which dots are sized, scene units.
    """

    name: str
    colour: tuple[float, float, float]
    points: SurfacePoints
    segments: Ints
    anchors: Ints
    edges: Ints
    skins: Ints
    length: float

    @property
    def lift(self) -> float:
        """Height above the surface, scene units, so that lines do not sink into it between their points."""
        return _LIFT * self.length


def line_between(body: Body, points: Floats, start: Floats, end: Floats) -> Floats:
    """(segments, 2, 3) a line from (3,) to (3,) laid over a body with (points, 3) positions."""
    chord = start + np.linspace(0.0, 1.0, _SAMPLES)[:, None] * (end - start)
    found = [closest_point(points, body.triangles, place) for place in chord]
    normals = unit(face_normals(points, body.triangles[[triangle for triangle, *_ in found]]))
    lifted = np.array([place for *_, place in found]) + _LIFT * np.linalg.norm(end - start) * normals
    return np.stack([lifted[:-1], lifted[1:]], axis=1)


def body_of(mesh: PlayableMesh, paints: Sequence[Paint]) -> Body:
    """Make the body of a mesh and its tools, from the paints of its primitives."""
    surface = mesh.ground.surface
    weld, normals = [surface.weld], [surface.normals]
    colours = [np.concatenate([paint.colours for paint in paints])]
    coordinates = [np.concatenate([paint.coordinates for paint in paints])]
    ones = (np.ones(len(paint.colours)) if paint.opacity is None else paint.opacity.alphas for paint in paints)
    alphas = [np.concatenate(list(ones))[:, None]]
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
        for values in (normals, colours, coordinates, alphas):
            values.append(np.einsum("vk,vka->va", fine.shares, values[0][fine.sources]))
    every, owners, at = np.concatenate(corners), np.concatenate(primitives), np.concatenate(weld)
    turned, shades, places = unit(np.concatenate(normals)), np.concatenate(colours), np.concatenate(coordinates)
    opaque = np.concatenate(alphas)
    meshes = []
    for number, paint in enumerate(paints):
        triangles = every[owners == number][:, :: mesh.way]
        if not len(triangles):
            continue
        if paint.texture is None:
            firsts, joined = _joined(triangles, at, turned, np.concatenate([shades, opaque], axis=1))
        else:
            firsts = distinct_values(triangles)
            joined = np.searchsorted(firsts, triangles)
        opacity = None if paint.opacity is None else replace(paint.opacity, alphas=opaque[firsts, 0])
        made = replace(paint, colours=shades[firsts], coordinates=places[firsts], opacity=opacity)
        meshes.append(DrawnMesh(joined, at[firsts], made))
    return Body(mesh.faces, tuple(meshes))


def _joined(triangles: Ints, points: Ints, normals: Floats, colours: Floats) -> tuple[Ints, Ints]:
    """Join glTF vertices at the same point with the same normal and colour.

    Returns:
        (joined,) one glTF vertex of each group, and (triangles, 3) numbers of groups.
    """
    used = distinct_values(triangles)
    keys = np.column_stack([points[used], np.round(normals[used] / _NORMAL_STEP), np.round(255 * colours[used])])
    firsts, numbers = distinct(keys)
    return used[firsts], numbers[np.searchsorted(used, triangles)]


def outline_of(
    tool: AttachedTool | AttachedBelow, mesh: PlayableMesh, body: int, colour: tuple[float, float, float]
) -> ToolOutline:
    """Outline a tool on its mesh, the body of a number: the border of its patch, and the line along the middle.

    Without a segment it is the border of the skin that moves, and the place by which a touch is dragged.
    """
    if isinstance(tool, AttachedBelow) or tool.attached.segment is None:
        return _bordered(tool, mesh, body, colour)
    region, surface = tool.region, mesh.ground.surface
    near = mesh.ground.rest.around.faces_of(distinct_values(surface.triangles[region.members]))
    around = np.flatnonzero(among(mesh.parents, near))
    used, corners = renumbered(mesh.faces[around])
    positions = mesh.positions_in(region.pose)[used]
    u, v = region.coordinates(positions)
    outward = np.flatnonzero(region.cosines(u[corners].mean(axis=1), unit(face_normals(positions, corners))) > 0)
    found, barycentrics = _border(np.minimum(np.minimum(u, 1.0 - u), 1.0 - np.abs(v)), corners[outward])
    along, across = (np.einsum("sc,sc->s", barycentrics, each[corners[outward[found]]]) for each in (u, v))
    # Dots to drag lie on the border beside the middle, on either side.
    beside = [side[np.argsort(np.abs(along[side] - 0.5))[:1]] for side in map(np.flatnonzero, (across > 0, across < 0))]
    middle, shares = zero_lines(v, corners[outward])
    places = np.einsum("sc,sc->s", shares, u[corners[outward[middle]]]).reshape(-1, 2).mean(axis=1)
    within = np.repeat((places > 0) & (places < 1), 2)
    ends = [closest_point(mesh.rest_positions, mesh.faces[around], each.position) for each in region.anchors]
    drawn = len(found) + int(within.sum())
    triangles = np.concatenate([outward[found], outward[middle[within]], [triangle for triangle, _, _ in ends]])
    return ToolOutline(
        name=tool.attached.tool.name,
        colour=colour,
        points=SurfacePoints(
            body,
            around[triangles.astype(np.intp)],
            np.concatenate([barycentrics, shares[within], [each for _, each, _ in ends]]),
        ),
        segments=np.arange(drawn).reshape(-1, 2),
        anchors=np.arange(drawn, len(triangles)),
        edges=np.concatenate(beside),
        skins=np.zeros(0, np.intp),
        length=region.span,
    )


def _bordered(
    tool: AttachedTool | AttachedBelow, mesh: PlayableMesh, body: int, colour: tuple[float, float, float]
) -> ToolOutline:
    """The border between positive and negative `excess`; where it has one sign, the middles of all triangles."""
    found, barycentrics = _border(mesh.smooth(tool.excess), mesh.faces)
    segments, none, drag = np.arange(len(found)).reshape(-1, 2), np.zeros(0, np.intp), tool.attached.drag
    if not len(found):
        found, barycentrics = np.arange(len(mesh.faces)), np.full((len(mesh.faces), 3), 1.0 / 3.0)
    skins = none if drag is None else np.array([len(found)])
    if drag is not None:
        triangle, shares, _ = closest_point(mesh.rest_positions, mesh.faces, drag.at)
        found, barycentrics = np.append(found, triangle), np.concatenate([barycentrics, shares[None]])
    points, length = SurfacePoints(body, found, barycentrics), tool.attached.bump_width if drag is None else drag.reach
    return ToolOutline(tool.attached.tool.name, colour, points, segments, none, none, skins, length)


def _border(values: Floats, faces: Ints) -> tuple[Ints, Floats]:
    """The lines round the part of (triangles, 3) faces where (vertices,) values are above 0, as a contour is drawn.

    Returns:
        (ends,) triangles and (ends, 3) barycentric coordinates, two ends for each line: across triangles on which the
        values pass 0, and along the mesh's own border.
    """
    triangles, crossing = zero_lines(values, faces)
    above = values[faces] > 0
    edges = Edges.of(faces)
    open_sides = (edges.counts[edges.of_faces] == 1) & above & np.roll(above, -1, axis=1)
    open_faces, first = np.nonzero(open_sides)
    ends = np.eye(3)[np.stack([first, (first + 1) % 3], axis=1).reshape(-1)]
    return np.concatenate([triangles, np.repeat(open_faces, 2)]), np.concatenate([crossing, ends])
