"""Nearest points of triangle meshes, distances of points from a surface, and distances of triangles along rays.

Sources:
    - C. Ericson, *Real-Time Collision Detection*, 2005, §5.1.5: closest points. Differs: the nearest of the three edges
      and, where the point lies above the triangle, its plane, which takes degenerate triangles too.
    - T. Möller, B. Trumbore, *Fast, minimum storage ray-triangle intersection*, 1997.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, distinct, dot

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


# Centroids looked at first for each point; twice as many until nothing nearer can be left.
_FIRST = 8
# Pairs of a point and a triangle that are computed at once: bounds the memory (about 500 bytes each).
_PAIRS = 2**17
# Pairs whose distances are computed at once: their numbers stay in a core's cache.
_AT_ONCE = 2**12
# Points whose distance is found at once, the seemingly farthest first: their distances rule out most others.
_BATCH = 1024
# Size classes of triangles below the largest, each of half the size: the smallest share the last.
_CLASSES = 20
# A reach grows by this share of itself and of the greatest coordinate: rounding errors of distances are far smaller.
_ROUNDING = 1e-9


def closest_point(positions: Floats, triangles: Ints, point: Floats) -> tuple[int, Floats, Floats]:
    """The nearest point of a triangle mesh.

    Returns:
        The triangle, (3,) barycentric coordinates and (3,) position of the point; among equally near ones
        those of the first triangle.
    """
    # No nearer than some vertex are the triangles outside the cube that ends at it; widened, as computing rounds.
    reach = np.sqrt(np.sum((positions - point) ** 2, axis=1)[triangles[:, 0]].min())
    reach += _ROUNDING * (reach + np.abs(positions).max())
    near = np.flatnonzero(meets_box(positions, point - reach, point + reach, triangles))
    # A file of a few bytes may repeat one triangle a million times.
    near = near[np.sort(distinct(triangles[near])[0])]
    triangle, barycentrics, place = _closest_of(positions, triangles[near], point)
    return int(near[triangle]), barycentrics, place


def meets_box(coordinates: Floats, low: Floats, high: Floats, triangles: Ints) -> Bools:
    """(triangles,) whether the boxes round triangles, of (vertices, n) coordinates, meet that of (n,) bounds.

    Source: the outcodes of Cohen and Sutherland's line clipping.
    """
    codes = np.zeros(len(coordinates), np.uint8)
    for bit, outside in enumerate((*(coordinates < low).T, *(coordinates > high).T)):
        codes |= outside.view(np.uint8) << bit
    a, b, c = np.take(codes, triangles).T
    meets: Bools = (a & b & c) == 0
    return meets


def _closest_of(positions: Floats, triangles: Ints, point: Floats) -> tuple[int, Floats, Floats]:
    """As `closest_point`, looking at every triangle."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    candidates = [_on_edge(point, first, second) for first, second in ((a, b), (b, c), (c, a))]
    zero = np.zeros(len(triangles))
    (ab, bc, ca) = candidates
    choices = [
        np.stack([1 - ab, ab, zero], axis=1),
        np.stack([zero, 1 - bc, bc], axis=1),
        np.stack([ca, zero, 1 - ca], axis=1),
    ]
    normal = np.cross(b - a, c - a)
    area = np.sum(normal * normal, axis=1)
    solid = area > 0
    safe = np.where(solid, area, 1.0)
    second = np.sum(np.cross(point - a, c - a) * normal, axis=1) / safe
    third = np.sum(np.cross(b - a, point - a) * normal, axis=1) / safe
    inner = np.stack([1 - second - third, second, third], axis=1)
    choices.append(np.where((solid & (inner >= 0).all(axis=1))[:, None], inner, choices[0]))
    options = np.stack(choices)
    places = options[..., :1] * a + options[..., 1:2] * b + options[..., 2:] * c
    squared = np.sum((places - point) ** 2, axis=2)
    triangle = int(np.argmin(squared.min(axis=0)))
    which = int(np.argmin(squared[:, triangle]))
    return triangle, options[which, triangle], places[which, triangle]


def _on_edge(point: Floats, start: Floats, stop: Floats) -> Floats:
    """(edges,) parameter of the nearest point of each edge."""
    edge = stop - start
    squared = np.sum(edge * edge, axis=1)
    share = np.sum((point - start) * edge, axis=1) / np.where(squared > 0, squared, 1.0)
    return np.asarray(np.clip(share, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Farthest:
    """The point that is farthest from a surface.

    Attributes:
        distance: Of it, or the floor where no point is farther.
        point: Its number; -1 where no point is farther than the floor.
        hints: (points,) a triangle near each point, for the next call.
    """

    distance: float
    point: int
    hints: Ints


def farthest(points: Floats, corners: Floats, *, hints: Ints | None = None, floor: float = 0.0) -> Farthest:
    """Find the point that is farthest from a surface.

    Args:
        points: (points, 3), at least one.
        corners: (triangles, 3, 3), at least one.
        hints: (points,) a triangle near each point: those of the same surfaces a moment before. The nearer they are,
            the fewer distances have to be found.
        floor: Points that are no farther than this are not looked at.
    """
    best = near_triangles(points, corners) if hints is None else hints.copy()
    bounds = triangle_distances(points, corners[best])
    worst, point = floor, -1
    order = np.argsort(-bounds, kind="stable")
    trees: list[_SizeClass] = []
    for start in range(0, len(order), _BATCH):
        chosen = order[start : start + _BATCH]
        chosen = chosen[bounds[chosen] > worst]
        if not len(chosen):
            break
        trees = trees or list(_size_classes(corners))
        distances, best[chosen] = _nearest(points[chosen], corners, trees, bounds[chosen], best[chosen])
        top = int(distances.argmax())
        if distances[top] > worst:
            worst, point = float(distances[top]), int(chosen[top])
    return Farthest(worst, point, best)


def near_triangles(points: Floats, corners: Floats) -> Ints:
    """(points,) a triangle near each point: that of the nearest centroid. The arguments are those of `farthest`."""
    # Imported here, as it takes longer than all of numpy, and equal topologies do without.
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(corners.mean(axis=1)).query(points)[1], np.intp)


@dataclass(frozen=True, slots=True)
class _SizeClass:
    """Triangles of like size.

    Attributes:
        members: (members,) their numbers.
        tree: A k-d tree of their centroids.
        radius: No point of a member is farther from its centroid.
    """

    members: Ints
    tree: "cKDTree"
    radius: float


def _size_classes(corners: Floats) -> Iterator[_SizeClass]:
    from scipy.spatial import cKDTree

    centroids, radii = balls(corners)
    largest = float(radii.max())
    edges = [np.inf, *(largest * 0.5 ** np.arange(1, _CLASSES)), -1.0] if largest else [np.inf, -1.0]
    for above, below in pairwise(edges):
        members = np.flatnonzero((radii <= above) & (radii > below))
        if len(members):
            yield _SizeClass(members, cKDTree(centroids[members]), float(radii[members].max()))


def _nearest(
    points: Floats, corners: Floats, classes: list[_SizeClass], bounds: Floats, hints: Ints
) -> tuple[Floats, Ints]:
    """Distance of each point from the surface, and the triangle it is from; `bounds` are those of the hints."""
    best, triangles = bounds.copy(), hints.copy()
    for each in classes:
        pending = np.arange(len(points))
        count = min(_FIRST, len(each.members))
        while len(pending):
            step = max(1, _PAIRS // count)
            open_ = [
                _look(points, corners, each, best, triangles, pending[start : start + step], count)
                for start in range(0, len(pending), step)
            ]
            if count == len(each.members):
                break
            pending = np.concatenate(open_)
            count = min(2 * count, len(each.members))
    return best, triangles


def _look(
    points: Floats, corners: Floats, each: _SizeClass, best: Floats, triangles: Ints, chosen: Ints, count: int
) -> Ints:
    """Try the nearest members of a class, and write into `best` and `triangles` what is nearer.

    Returns:
        (some,) the chosen points to which a member further on may still be nearer.
    """
    found_away, found_members = each.tree.query(points[chosen], k=count)
    away = np.asarray(found_away).reshape(len(chosen), count)
    members = np.asarray(found_members).reshape(len(chosen), count)
    # A member is no nearer than its centroid less its radius.
    rows, columns = np.nonzero(away - each.radius < best[chosen][:, None])
    if len(rows):
        numbers = each.members[members[rows, columns]]
        found = triangle_distances(points[chosen[rows]], corners[numbers])
        order = np.lexsort((numbers, found))
        _, first = np.unique(rows[order], return_index=True)
        top = order[first]
        nearer = found[top] < best[chosen[rows[top]]]
        top = top[nearer]
        best[chosen[rows[top]]] = found[top]
        triangles[chosen[rows[top]]] = numbers[top]
    return chosen[away[:, -1] - each.radius < best[chosen]]


def triangle_distances(points: Floats, corners: Floats) -> Floats:
    """(pairs,) distances of (pairs, 3) points from (pairs, 3, 3) triangles, a triangle for each point."""
    portions = (slice(k, k + _AT_ONCE) for k in range(0, len(points), _AT_ONCE))
    found = [_triangle_distances(points[each].T, corners[each].transpose(1, 2, 0)) for each in portions]
    return np.concatenate(found) if found else np.zeros(0)


def _triangle_distances(points: Floats, corners: Floats) -> Floats:
    """As `triangle_distances`, of (3, pairs) and (3, 3, pairs), coordinates second."""
    edges = corners[[1, 2, 0]] - corners
    offsets = np.ascontiguousarray(points) - corners
    squared = np.full(points.shape[1], np.inf)
    for edge, offset in zip(edges, offsets, strict=True):
        length = dot(edge, edge)
        along = dot(offset, edge) / np.where(length > 0, length, 1.0)
        away = offset - np.clip(along, 0.0, 1.0) * edge
        squared = np.minimum(squared, dot(away, away))
    first, second, offset = edges[0], -edges[2], offsets[0]
    normal = cross(first, second)
    area = dot(normal, normal)
    safe = np.where(area > 0, area, 1.0)
    u = dot(cross(offset, second), normal) / safe
    v = dot(cross(first, offset), normal) / safe
    above = (area > 0) & (u >= 0) & (v >= 0) & (u + v <= 1)
    height = dot(offset, normal) ** 2 / safe
    return np.sqrt(np.where(above, np.minimum(squared, height), squared))


def ray_distances(starts: Floats, rays: Floats, corners: Floats) -> Floats:
    """(pairs,) distance along each ray to its triangle; infinite where it misses or lies in its plane.

    Args:
        starts: (pairs, 3).
        rays: (pairs, 3) directions, in whose lengths distances are measured.
        corners: (pairs, 3, 3) of the triangle of each ray.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(rays, second)
    determinant = np.sum(first * across, axis=1)
    relative = starts - corners[:, 0]
    turned = np.cross(relative, first)
    # In the plane of a triangle the quotients are no numbers, and no hit.
    with np.errstate(all="ignore"):
        a = np.sum(relative * across, axis=1) / determinant
        b = np.sum(rays * turned, axis=1) / determinant
        distance = np.sum(second * turned, axis=1) / determinant
        hit = (a >= 0) & (b >= 0) & (a + b <= 1) & (distance > 0)
    return np.where(hit, distance, np.inf)


def distances_along(start: Floats, ray: Floats, corners: Floats) -> Floats:
    """(triangles,) as `ray_distances`, of one ray from a (3,) start to each of (triangles, 3, 3)."""
    shape = (len(corners), 3)
    return ray_distances(np.broadcast_to(start, shape), np.broadcast_to(ray, shape), corners)


def balls(corners: Floats) -> tuple[Floats, Floats]:
    """(triangles, 3) middles of (triangles, 3, 3), and (triangles,) how far their corners are from there."""
    middles = corners.mean(axis=1)
    return middles, np.sqrt(((corners - middles[:, None]) ** 2).sum(axis=2).max(axis=1))


def near_points(corners: Floats, points: Floats, reach: float) -> Ints:
    """The (triangles, 3, 3) that may be within reach of (points, 3), rising: of the ball round all of them."""
    middles, radii = balls(corners)
    middle = points.mean(axis=0)
    reach += float(np.sqrt(np.max(np.sum((points - middle) ** 2, axis=1))))
    return np.flatnonzero(np.sqrt(np.sum((middles - middle) ** 2, axis=1)) < reach + radii)
