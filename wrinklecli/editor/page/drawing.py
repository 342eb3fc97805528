"""Geometry that the page draws: coloured meshes of moving points, and outlines of tools on them.

The browser computes normals from the shown triangles. Vertices that the file splits at texture seams are therefore
joined if their stored normals are equal: seams stay invisible, and hard edges stay hard.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from wrinklecli.character.paints import Paint
from wrinklecli.editor.attached import AttachedBelow, AttachedTool, PlayableMesh
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, among, distinct, distinct_values, face_normals, unit
from wrinklecli.numeric.closest import closest_point
from wrinklecli.numeric.intersections import edges_of

_NORMAL_STEP = 1 / 127  # difference of stored normals that counts as none: the step of an 8-bit normal
_LINE_POINTS = 25  # points on each line of an outline; an odd number has one in the middle
_LIFT = 0.015  # height of an outline above the surface over the tool's length
_ZIGZAG = 1.5  # longest way along edges, over the straight one: over squares with diagonals it is 1.41
_DETOUR = 2.0  # the same for the way to a place of the patch, whose distance is as the patch sees it: 1.4 · 1.41
_LEAST_WAY = 0.25  # way within which all is near, over the tool's length: lines begin at a triangle, not at a point
_SHORT = 2.0  # edges: lines up to this long jump nowhere
_TOLERANCE = 1e-6  # barycentric coordinates may be this far below 0, so that no point falls between two triangles


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


def outline_of(tool: AttachedTool, mesh: PlayableMesh, body: int, colour: tuple[float, float, float]) -> ToolOutline:
    """Outline a tool on its mesh, the body of a number.

    Lines are followed over the surface from the anchors: what is only near in space, such as the other leg, has none.
    """
    if tool.attached.segment is None:
        return _bordered(tool.attached.tool.name, tool.excess, mesh, body, colour, tool.attached.bump_width)
    region, surface = tool.region, mesh.ground.surface
    near = mesh.ground.rest.around.faces_of(distinct_values(surface.triangles[region.members]))
    faces = np.flatnonzero(among(mesh.parents, near))
    positions = mesh.positions_in(region.pose)
    corners = positions[mesh.faces[faces]]
    u, v = region.coordinates(corners)
    normals = unit(face_normals(positions, mesh.faces[faces]))
    outward = region.cosines(u.mean(axis=1), normals) > 0
    places, ways = np.stack([u, v], axis=2), _Ways(positions, mesh.faces[faces])
    ends, ones = np.linspace(0.0, 1.0, _LINE_POINTS), np.ones(_LINE_POINTS)
    anchors = distinct_values(np.concatenate([anchor.triangles for anchor in region.anchors]))
    middle = np.column_stack((ends, 0 * ends))
    found, _ = _located(middle, places, ways.order(np.flatnonzero(among(mesh.parents[faces], anchors)), outward))
    starts = distinct_values(found[found >= 0])
    lengths = ways.lengths(starts) if len(starts) else np.zeros(len(faces))
    straight = np.abs(v).mean(axis=1) * region.half_width
    wanted = ways.order(starts, outward & (lengths <= _DETOUR * straight + _LEAST_WAY * region.span))
    # (u, v) of the four sides of the patch, and of the line from origin to target.
    sides_and_middle = [(ends, ones), (ends, -ones), (0 * ends, 2 * ends - 1), (ones, 2 * ends - 1), (ends, 0 * ends)]
    sought = [np.column_stack(line) for line in sides_and_middle]
    for anchor in region.anchors:
        place = anchor.barycentrics @ region.pose.positions[anchor.vertices]
        sought.append(np.column_stack([np.atleast_1d(each) for each in region.coordinates(place)]))
    # The edges are sought from the middle outwards: a wide patch may end where the surface faces away.
    sought += [np.column_stack([0.5 * ones, side * ends]) for side in (1.0, -1.0)]
    located = [_located(line, places, wanted) for line in sought]
    found, barycentrics = (np.concatenate(each) for each in zip(*located, strict=True))
    lines = np.arange(len(sides_and_middle) * _LINE_POINTS).reshape(-1, _LINE_POINTS)
    segments = np.stack([lines[:, :-1].ravel(), lines[:, 1:].ravel()], axis=1)
    segments = segments[(found[segments] >= 0).all(axis=1)]
    spots = np.einsum("sc,sca->sa", barycentrics, corners[found])
    segments = segments[[ways.joined(*found[ends], *spots[ends]) for ends in segments]]
    outwards = np.arange(len(found) - 2 * _LINE_POINTS, len(found)).reshape(2, _LINE_POINTS)
    reached = np.cumprod(found[outwards] >= 0, axis=1).sum(axis=1)
    edges = [int(side[count - 1]) for side, count in zip(outwards, reached, strict=True) if count > 1]
    return ToolOutline(
        name=tool.attached.tool.name,
        colour=colour,
        points=SurfacePoints(body, faces[np.maximum(found, 0)], barycentrics),
        segments=segments,
        anchors=np.arange(lines.size, int(outwards[0, 0])),
        edges=np.array(edges, np.intp),
        skins=np.zeros(0, np.intp),
        length=region.span,
    )


def outline_below(
    below: AttachedBelow, mesh: PlayableMesh, body: int, colour: tuple[float, float, float]
) -> ToolOutline:
    """Outline the skin that a muscle, flesh or a touch moves, on its mesh, the body of a number."""
    made = _bordered("", below.excess, mesh, body, colour, below.span)
    if (drag := below.attached.drag) is None:
        return made
    triangle, shares, _ = closest_point(mesh.rest_positions, mesh.faces, drag.at)
    found, barycentrics = made.points.triangles, made.points.barycentrics
    points = SurfacePoints(body, np.append(found, triangle), np.concatenate([barycentrics, shares[None]]))
    return replace(made, points=points, skins=np.array([len(found)]), length=drag.reach)


def _bordered(
    name: str, excess: Floats, mesh: PlayableMesh, body: int, colour: tuple[float, float, float], length: float
) -> ToolOutline:
    """The border between (coarse vertices,) values above 0 and below, without points to drag.

    Where all are on one side, there are no lines, and the middles of all triangles say where it is.
    """
    found, barycentrics = _border(mesh.smooth(excess), mesh.faces)
    segments = np.arange(len(found)).reshape(-1, 2)
    if not len(found):
        found, barycentrics = np.arange(len(mesh.faces)), np.full((len(mesh.faces), 3), 1.0 / 3.0)
    return ToolOutline(
        name=name,
        colour=colour,
        points=SurfacePoints(body, found, barycentrics),
        segments=segments,
        anchors=np.zeros(0, np.intp),
        edges=np.zeros(0, np.intp),
        skins=np.zeros(0, np.intp),
        length=length,
    )


def _border(values: Floats, faces: Ints) -> tuple[Ints, Floats]:
    """The lines round the part of (triangles, 3) faces where (vertices,) values are above 0, as a contour is drawn.

    Returns:
        (ends,) triangles and (ends, 3) barycentric coordinates, two ends for each line: across triangles on which the
        values pass 0, and along the mesh's own border.
    """
    corners = values[faces]
    above = corners > 0
    triangles, sides = np.nonzero(above != np.roll(above, -1, axis=1))
    here, there = corners[triangles, sides], corners[triangles, (sides + 1) % 3]
    crossing = np.zeros((len(triangles), 3))
    crossing[np.arange(len(triangles)), sides] = there / (there - here)
    crossing[np.arange(len(triangles)), (sides + 1) % 3] = here / (here - there)
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, numbers, counts = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    open_sides = (counts[numbers.reshape(-1)] == 1).reshape(-1, 3) & above & np.roll(above, -1, axis=1)
    open_faces, first = np.nonzero(open_sides)
    ends = np.eye(3)[np.stack([first, (first + 1) % 3], axis=1).reshape(-1)]
    return np.concatenate([triangles, np.repeat(open_faces, 2)]), np.concatenate([crossing, ends])


class _Ways:
    """The ways over a surface of (triangles, 3) vertices at (vertices, 3) positions, along its edges."""

    def __init__(self, positions: Floats, triangles: Ints) -> None:
        used, corners = np.unique(triangles, return_inverse=True)
        self._corners = corners.reshape(-1, 3)
        edges = edges_of(self._corners)
        lengths = np.sqrt(np.sum(np.diff(positions[used[edges]], axis=1)[:, 0] ** 2, axis=1))
        self._graph = csr_matrix((lengths, (edges[:, 0], edges[:, 1])), shape=(len(used), len(used)))
        self._edge = float(lengths.mean()) if len(lengths) else 0.0

    def lengths(self, starts: Ints, longest: float = np.inf) -> Floats:
        """(triangles,) lengths of the shortest ways from the (starts,) triangles; infinite beyond the longest."""
        sources = distinct_values(self._corners[starts])
        found = dijkstra(self._graph, directed=False, indices=sources, limit=longest, min_only=True)
        return np.asarray(found[self._corners].min(axis=1))

    def order(self, starts: Ints, chosen: Bools) -> Ints:
        """Sort the chosen of the triangles by their ways from the starts, so that of two sheets the nearer is first."""
        kept = np.flatnonzero(chosen)
        return kept[np.argsort(self.lengths(starts)[kept], kind="stable")] if len(starts) else kept

    def joined(self, first: int, second: int, here: Floats, there: Floats) -> bool:
        """True if the way from one triangle to another is about as long as the straight one from (3,) to (3,)."""
        straight = float(np.linalg.norm(there - here))
        if straight <= _SHORT * self._edge:
            return True
        longest = _ZIGZAG * straight
        return bool(self.lengths(np.array([first]), longest)[second] <= longest)


def _located(line: Floats, places: Floats, order: Ints) -> tuple[Ints, Floats]:
    """Find the plane triangles that the (points, 2) of a line are in, among (triangles, 3, 2).

    Returns:
        (points,) the first triangle of each in an order, or -1; and (points, 3) barycentric coordinates.
    """
    numbers, places = order, places[order]
    low, high = line.min(axis=0) - _TOLERANCE, line.max(axis=0) + _TOLERANCE
    close = np.ones(len(places), bool)
    for axis in (0, 1):
        a, b, c = places[:, :, axis].T
        close &= np.minimum(np.minimum(a, b), c) <= high[axis]
        close &= np.maximum(np.maximum(a, b), c) >= low[axis]
    near = np.flatnonzero(close)
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
    hits = (second >= -_TOLERANCE) & (third >= -_TOLERANCE) & (second + third <= 1 + _TOLERANCE) & solid
    inside = np.flatnonzero(hits.any(axis=1))
    first = np.argmax(hits[inside], axis=1)
    found[inside] = numbers[near[first]]
    x, y = second[inside, first], third[inside, first]
    barycentrics[inside] = np.stack([1 - x - y, x, y], axis=1)
    return found, barycentrics
