"""The closest points, vertices and triangles of a mesh.

`closest_point` serves a few points, and needs numpy alone. A `Tree` of libigl serves many, and takes longer to import
than all of numpy, as it imports scipy.

Source: C. Ericson, *Real-Time Collision Detection*, 2005, §5.1.5. Differs: takes the nearest of the three edges and,
where the point lies above the triangle, its plane, so that degenerate triangles are allowed.
"""

from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, distinct, dot

if TYPE_CHECKING:
    import igl

# Distances are enlarged by this fraction of themselves and of the greatest coordinate: rounding errors are far smaller.
ROUNDING = 1e-9
# Square of a triangle's height over its longest side below which that side stands for it: libigl's rounding errors,
# 1e-16 of the side over this square, would take points above it to anywhere along it.
_SLIVER = 1e-12


def nearest_of(places: Floats, points: Floats, *, within: float = np.inf) -> tuple[Floats, Ints]:
    """(points,) distances and indices of the nearest of (places, 3) to each of (points, 3).

    Distances of `within` or more are infinite.
    """
    # Imported here, as scipy takes longer to import than all of numpy, and few commands need a k-d tree.
    from scipy.spatial import cKDTree

    distances, indices = cKDTree(places).query(points, distance_upper_bound=within)
    return np.asarray(distances, np.float64), np.asarray(indices, np.intp)


def pairs_within(places: Floats, radius: float) -> Ints:
    """(pairs, 2) indices, the lower first, of (places, 3) that are at most a radius apart."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(places).query_pairs(radius, output_type="ndarray"), np.intp)


def closest_point(positions: Floats, triangles: Ints, point: Floats) -> tuple[int, Floats, Floats]:
    """Find the nearest point of a triangle mesh, with at least one triangle.

    Returns:
        The triangle, (3,) barycentric coordinates and (3,) position of the point; of equally near triangles the first.
    """
    # Triangles outside the cube that reaches to the nearest corner are no nearer. It is enlarged for rounding errors.
    away = positions.T - point[:, None]
    reach = np.sqrt(dot(away, away)[triangles[:, 0]].min())
    reach += ROUNDING * (reach + np.abs(positions).max())
    near = np.flatnonzero(meets_box(positions, point - reach, point + reach, triangles))
    # A file of a few bytes may repeat one triangle a million times.
    near = near[np.sort(distinct(triangles[near])[0])]
    barycentrics, places = on_triangles(np.broadcast_to(point, (len(near), 3)), positions[triangles[near]])
    chosen = int(np.argmin(np.sum((places - point) ** 2, axis=1)))
    return int(near[chosen]), barycentrics[chosen], places[chosen]


def meets_box(coordinates: Floats, low: Floats, high: Floats, triangles: Ints) -> Bools:
    """(triangles,) True where the box round a triangle of (vertices, n) coordinates meets the box of (n,) bounds.

    Source: the outcodes of Cohen and Sutherland's line clipping.
    """
    codes = np.zeros(len(coordinates), np.uint8)
    # Axis by axis, as numpy takes several times as long along an axis of three.
    for number, (axis, least, most) in enumerate(zip(coordinates.T, low, high, strict=True)):
        codes |= (axis < least).view(np.uint8) << (2 * number)
        codes |= (axis > most).view(np.uint8) << (2 * number + 1)
    a, b, c = np.take(codes, triangles).T
    return np.asarray((a & b & c) == 0)


def on_triangles(points: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """(pairs, 3) barycentric coordinates and positions of the nearest point of each triangle to a point of its own.

    Args:
        points: (pairs, 3)
        corners: (pairs, 3, 3) of the triangles, with or without area.
    """
    # Coordinate by coordinate, as numpy takes three times as long along an axis of three.
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    point = np.ascontiguousarray(points.T)
    zero = np.zeros(len(points))
    ab, bc, ca = (_on_edge(point, start, stop) for start, stop in ((a, b), (b, c), (c, a)))
    normal = cross(b - a, c - a)
    area = dot(normal, normal)
    safe = np.where(area > 0, area, 1.0)
    second, third = dot(cross(point - a, c - a), normal) / safe, dot(cross(b - a, point - a), normal) / safe
    inner = np.stack([1 - second - third, second, third])
    edges = np.array([[1 - ab, ab, zero], [zero, 1 - bc, bc], [ca, zero, 1 - ca]])
    options = np.concatenate([edges, np.where((area > 0) & (inner >= 0).all(axis=0), inner, edges[0])[None]])
    places = options[:, 0, None] * a + options[:, 1, None] * b + options[:, 2, None] * c
    away = np.moveaxis(places - point, 1, 0)
    which, pairs = dot(away, away).argmin(axis=0), np.arange(len(points))
    return options[which, :, pairs], places[which, :, pairs]


def _on_edge(point: Floats, start: Floats, stop: Floats) -> Floats:
    """(edges,) parameter in [0, 1] of the nearest point of each edge; all are (3, edges)."""
    edge = stop - start
    squared = dot(edge, edge)
    return np.asarray(np.clip(dot(point - start, edge) / np.where(squared > 0, squared, 1.0), 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Tree:
    """A triangle mesh in a tree of boxes, for many searches.

    Attributes:
        positions: (vertices, 3), finite.
        triangles: (triangles, 3), at least one.
    """

    positions: Floats
    triangles: Ints
    _searched: Ints
    _boxes: "igl.AABB"

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Tree":
        """Sort (triangles, 3) of (vertices, 3) positions into a tree."""
        import igl

        a, b, c = positions[triangles].transpose(1, 2, 0)
        sides = np.stack([dot(side, side) for side in (b - a, c - b, a - c)], axis=1)
        normal = cross(b - a, c - a)
        slivers = np.flatnonzero(dot(normal, normal) <= _SLIVER * sides.max(axis=1) ** 2)
        # A triangle without area is as good as its longest side.
        starts = sides[slivers].argmax(axis=1)
        searched = np.array(triangles, np.int64)
        searched[slivers, 0] = triangles[slivers, starts]
        searched[slivers, 1:] = triangles[slivers, (starts + 1) % 3][:, None]
        boxes = igl.AABB()
        boxes.init(positions, searched)
        return cls(positions, triangles, searched, boxes)

    def __reduce__(self) -> tuple[object, ...]:
        """Sends itself to another process without its boxes, which are made anew there."""
        return Tree.of, (self.positions, self.triangles)

    def closest_points(self, points: Floats) -> tuple[Ints, Floats, Floats]:
        """Find the nearest points of the mesh to (points, 3) finite ones.

        Returns:
            (points,) triangles, (points, 3) barycentric coordinates and (points, 3) positions. Of equally near
            triangles it is the one that the tree has first: that depends on the mesh and the point alone.
        """
        _, found, _ = self._boxes.squared_distance(self.positions, self._searched, points)
        return found, *on_triangles(points, self.positions[self.triangles[found]])


def is_inside(points: Floats, positions: Floats, triangles: Ints) -> Bools:
    """(points,) True for (points, 3) within a surface, whichever way it is wound, and if it is open at neck or wrists.

    Source: G. Barill, N. Dickson, R. Schmidt, D. Levin, A. Jacobson, *Fast winding numbers for soups and clouds*,
    SIGGRAPH 2018.
    """
    import igl

    return np.asarray(np.abs(igl.fast_winding_number(positions, triangles, points)) > 0.5)


def balls(corners: Floats) -> tuple[Floats, Floats]:
    """(triangles, 3) centroids of (triangles, 3, 3) corners, and (triangles,) the radii of balls round all corners."""
    # Coordinate by coordinate, as numpy takes four times as long along an axis of three.
    a, b, c = corners.transpose(1, 2, 0)
    middles = (a + b + c) / 3.0
    first, second, third = (dot(each, each) for each in (a - middles, b - middles, c - middles))
    return np.ascontiguousarray(middles.T), np.sqrt(np.maximum(np.maximum(first, second), third))
