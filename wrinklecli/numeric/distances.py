"""Distances of points from the surface of a triangle mesh."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, cross, dot
from wrinklecli.numeric.nearest import balls, nearest_of

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Centroids that are tried first for each point; twice as many follow until no other can be nearer.
_FIRST_COUNT = 8
# Pairs of a point and a triangle that are gathered at once. Bounds the memory (about 500 bytes each).
_GATHERED_PAIRS = 2**17
# Pairs whose distances are computed at once: their numbers stay in a core's cache.
_COMPUTED_PAIRS = 2**12
# Points whose distance is found at once, the seemingly farthest first: their distances rule out most others.
_POINTS = 1024
# Triangles are sorted into this many classes, each of half the size of the one before; the last has all smaller ones.
_SIZE_CLASSES = 20


@dataclass(frozen=True, slots=True)
class Farthest:
    """The point that is farthest from a surface.

    Attributes:
        distance: The floor if no point is farther.
        point: Its index; -1 if no point is farther than the floor.
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
        hints: (points,) a triangle near each point, such as those of the same surfaces a moment before. The nearer they
            are, the fewer distances have to be computed.
        floor: Points that are no farther than this distance are ignored.
    """
    best = near_triangles(points, corners) if hints is None else hints.copy()
    bounds = triangle_distances(points, corners[best])
    worst, point = floor, -1
    order = np.argsort(-bounds, kind="stable")
    trees: list[_SizeClass] = []
    for start in range(0, len(order), _POINTS):
        chosen = order[start : start + _POINTS]
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
    """(points,) the triangle of (triangles, 3, 3) corners with the nearest centroid to each of (points, 3)."""
    return nearest_of(corners.mean(axis=1), points)[1]


@dataclass(frozen=True, slots=True)
class _SizeClass:
    """Triangles of similar size.

    Attributes:
        members: (members,) indices of the triangles.
        tree: A k-d tree of their centroids.
        radius: The greatest distance of a corner from its triangle's centroid.
    """

    members: Ints
    tree: "cKDTree"
    radius: float


def _size_classes(corners: Floats) -> Iterator[_SizeClass]:
    from scipy.spatial import cKDTree

    centroids, radii = balls(corners)
    largest = float(radii.max())
    edges = [np.inf, *(largest * 0.5 ** np.arange(1, _SIZE_CLASSES)), -1.0] if largest else [np.inf, -1.0]
    for above, below in pairwise(edges):
        members = np.flatnonzero((radii <= above) & (radii > below))
        if len(members):
            yield _SizeClass(members, cKDTree(centroids[members]), float(radii[members].max()))


def _nearest(
    points: Floats, corners: Floats, classes: list[_SizeClass], bounds: Floats, hints: Ints
) -> tuple[Floats, Ints]:
    """(points,) distances from the surface and (points,) nearest triangles; `bounds` are the distances of the hints."""
    best, triangles = bounds.copy(), hints.copy()
    for each in classes:
        pending = np.arange(len(points))
        count = min(_FIRST_COUNT, len(each.members))
        while len(pending):
            step = max(1, _GATHERED_PAIRS // count)
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
    """Try the nearest `count` members of a class, and write nearer ones into `best` and `triangles`.

    Returns:
        (some,) the chosen points to which a member farther away may still be nearer.
    """
    found_away, found_members = each.tree.query(points[chosen], k=count)
    away = np.asarray(found_away).reshape(len(chosen), count)
    members = np.asarray(found_members).reshape(len(chosen), count)
    # A member is no nearer than the distance of its centroid less its radius.
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
    """(pairs,) distances of (pairs, 3) points, each from its own triangle among (pairs, 3, 3) corners."""
    portions = (slice(k, k + _COMPUTED_PAIRS) for k in range(0, len(points), _COMPUTED_PAIRS))
    found = [_triangle_distances(points[each].T, corners[each].transpose(1, 2, 0)) for each in portions]
    return np.concatenate(found) if found else np.zeros(0)


def _triangle_distances(points: Floats, corners: Floats) -> Floats:
    """(pairs,) distances of (3, pairs) points from (3, 3, pairs) corners, whose second axis is the coordinates."""
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
