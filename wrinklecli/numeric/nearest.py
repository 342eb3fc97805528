"""The nearest points, vertices and triangles of a mesh, and distances along rays.

`closest_point` is exact for one point and any triangles. `nearest_points` is three times as fast for many points, but
needs triangles with area; `nearest_on_mesh` is ten times as fast for ten thousand points near a
mesh. `distances.farthest` needs distances alone.

Sources:
    - C. Ericson, *Real-Time Collision Detection*, 2005, §5.1.5: closest points. Differs: takes the nearest of the three
      edges and, where the point lies above the triangle, its plane, so that degenerate triangles are allowed.
    - T. Möller, B. Trumbore, *Fast, minimum storage ray-triangle intersection*, 1997.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, distinct, distinct_values, dot
from wrinklecli.numeric.boxes import ROUNDING, Boxes

# Rays times triangles that are tested at once: a cache holds their numbers.
_PAIRS = 2**14
# Points, about, that look for their nearest triangles together: more of them would look at triangles that are far.
_GROUP = 64
# Squared sine of a triangle's angle below which rounding errors hide it; its edges belong to its neighbours too.
_SLIVER = 1e-12


def nearest_vertex(positions: Floats, point: Floats) -> int:
    """Index of the first of (vertices, 3) positions that is nearest to a (3,) point."""
    return int(np.argmin(np.sum((positions - point) ** 2, axis=1)))


def nearest_of(places: Floats, points: Floats) -> tuple[Floats, Ints]:
    """(points,) distances and indices of the nearest of (places, 3) to each of (points, 3)."""
    # Imported here, as scipy takes longer to import than all of numpy, and few commands need a k-d tree.
    from scipy.spatial import cKDTree

    distances, indices = cKDTree(places).query(points)
    return np.asarray(distances, np.float64), np.asarray(indices, np.intp)


def pairs_within(places: Floats, radius: float) -> Ints:
    """(pairs, 2) indices, the lower first, of (places, 3) that are at most a radius apart."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(places).query_pairs(radius, output_type="ndarray"), np.intp)


def closest_point(positions: Floats, triangles: Ints, point: Floats) -> tuple[int, Floats, Floats]:
    """Find the nearest point of a triangle mesh.

    Returns:
        The triangle, (3,) barycentric coordinates and (3,) position of the point; of equally near triangles the first.
    """
    # Triangles outside the cube that reaches to the nearest corner are no nearer. It is enlarged for rounding errors.
    reach = np.sqrt(np.sum((positions - point) ** 2, axis=1)[triangles[:, 0]].min())
    reach += ROUNDING * (reach + np.abs(positions).max())
    near = np.flatnonzero(meets_box(positions, point - reach, point + reach, triangles))
    # A file of a few bytes may repeat one triangle a million times.
    near = near[np.sort(distinct(triangles[near])[0])]
    triangle, barycentrics, place = _closest_of(positions, triangles[near], point)
    return int(near[triangle]), barycentrics, place


def meets_box(coordinates: Floats, low: Floats, high: Floats, triangles: Ints) -> Bools:
    """(triangles,) True where the box round a triangle of (vertices, n) coordinates meets the box of (n,) bounds.

    Source: the outcodes of Cohen and Sutherland's line clipping.
    """
    codes = np.zeros(len(coordinates), np.uint8)
    for bit, outside in enumerate((*(coordinates < low).T, *(coordinates > high).T)):
        codes |= outside.view(np.uint8) << bit
    a, b, c = np.take(codes, triangles).T
    meets: Bools = (a & b & c) == 0
    return meets


def _closest_of(positions: Floats, triangles: Ints, point: Floats) -> tuple[int, Floats, Floats]:
    """Find what `closest_point` finds by looking at every triangle."""
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
    """(edges,) parameter in [0, 1] of the nearest point of each edge."""
    edge = stop - start
    squared = np.sum(edge * edge, axis=1)
    parameters = np.sum((point - start) * edge, axis=1) / np.where(squared > 0, squared, 1.0)
    return np.asarray(np.clip(parameters, 0.0, 1.0))


def nearest_points(points: Floats, corners: Floats) -> tuple[Ints, Floats]:
    """Find the nearest points of (triangles, 3, 3) corners, of triangles with area, to (points, 3).

    Returns:
        (points,) triangles, the first of equally near ones, and (points, 3) barycentric coordinates.
    """
    # Products of coordinates lose digits far from the origin.
    middle = points.mean(axis=0)
    a, ab, ac = corners[:, 0] - middle, corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    aa, bb, mixed = np.sum(ab * ab, axis=1), np.sum(ac * ac, axis=1), np.sum(ab * ac, axis=1)
    points = points - middle
    first, second = points @ ab.T - np.sum(a * ab, axis=1), points @ ac.T - np.sum(a * ac, axis=1)
    determinant = aa * bb - mixed**2
    v, w = (bb * first - mixed * second) / determinant, (aa * second - mixed * first) / determinant
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    on_ab, on_ac = np.clip(first / aa, 0.0, 1.0), np.clip(second / bb, 0.0, 1.0)
    on_bc = np.clip((second - first - mixed + aa) / (aa + bb - 2.0 * mixed), 0.0, 1.0)
    zero = np.zeros_like(v)
    vs = np.stack([np.where(inside, v, 0.0), on_ab, zero, 1.0 - on_bc])
    ws = np.stack([np.where(inside, w, 0.0), zero, on_ac, on_bc])
    # Squared distances; the first line is without the part that is the same for all four candidates.
    squared = vs**2 * aa + 2.0 * vs * ws * mixed + ws**2 * bb - 2.0 * (vs * first + ws * second)
    squared = squared + (np.sum(points**2, axis=1)[:, None] - 2.0 * points @ a.T + np.sum(a**2, axis=1))
    squared[0] = np.where(inside, squared[0], np.inf)
    which = squared.argmin(axis=0)
    triangle = squared.min(axis=0).argmin(axis=1)
    rows = np.arange(len(points))
    chosen = which[rows, triangle]
    v, w = vs[chosen, rows, triangle], ws[chosen, rows, triangle]
    return triangle, np.stack([1.0 - v - w, v, w], axis=1)


def nearest_on_mesh(points: Floats, positions: Floats, triangles: Ints) -> tuple[Ints, Floats]:
    """Find the nearest points of a mesh of (triangles, 3) of (vertices, 3) positions to (points, 3), in small groups.

    Returns:
        (points,) triangles and (points, 3) barycentric coordinates; triangles almost without area do not count.
    """
    found, shares = np.zeros(len(points), np.intp), np.zeros((len(points), 3))
    if not len(points):
        return found, shares
    corners = positions[triangles]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas, squares = ((np.cross(one, two)) ** 2).sum(axis=1), (one**2).sum(axis=1) * (two**2).sum(axis=1)
    solid = np.flatnonzero(areas > _SLIVER * squares)
    # The nearest point is no farther than the nearest corner.
    reaches, _ = nearest_of(positions[distinct_values(triangles[solid])], points)
    reaches += ROUNDING * (reaches + np.abs(positions).max())
    side = np.ptp(points, axis=0).max() / max(np.sqrt(len(points) / _GROUP), 1.0)
    cells = np.floor((points - points.min(axis=0)) / (side or 1.0))
    _, groups = np.unique(cells, axis=0, return_inverse=True)
    order = np.argsort(groups.reshape(-1), kind="stable")
    for group in np.split(order, np.cumsum(np.bincount(groups.reshape(-1)))[:-1]):
        near = solid[near_points(corners[solid], points[group], float(reaches[group].max()))]
        which, shares[group] = nearest_points(points[group], corners[near])
        found[group] = near[which]
    return found, shares


@dataclass(frozen=True, slots=True)
class Blocks:
    """A triangle mesh with boxes round consecutive triangles, for quick searches.

    Attributes:
        positions: (vertices, 3).
        triangles: (triangles, 3).
    """

    positions: Floats
    triangles: Ints
    boxes: Boxes

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Blocks":
        """Box (triangles, 3) of (vertices, 3) positions."""
        # Corner by corner, as numpy takes four times as long along an axis of three.
        a, b, c = (positions[corner] for corner in triangles.T)
        low, high = (each(each(a, b), c) for each in (np.minimum, np.maximum))
        return cls(positions, triangles, Boxes.of(low, high))

    def closest_point(self, point: Floats) -> tuple[int, Floats, Floats]:
        """Find what `closest_point` finds, to the bit."""
        boxes = self.boxes
        if len(boxes.low) == 1:
            return closest_point(self.positions, self.triangles, point)
        apart = np.maximum(np.maximum(boxes.low - point, point - boxes.high), 0.0)
        distances = np.sqrt(np.sum(apart * apart, axis=1))
        # The nearest point is no farther than the nearest corner in the nearest box.
        nearest = np.arange(len(distances)) == np.argmin(distances)
        corners = self.positions[self.triangles[boxes.things(nearest)]].reshape(-1, 3)
        reach = np.sqrt(np.sum((corners - point) ** 2, axis=1).min())
        reach += ROUNDING * (reach + boxes.greatest)
        faces = boxes.things(distances <= reach)
        a, b, c = (self.positions.take(corner, axis=0) for corner in self.triangles[faces].T)
        apart = a - point
        reach = np.sqrt(dot(apart.T, apart.T).min())
        reach += ROUNDING * (reach + boxes.greatest)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        meets = (low <= point + reach) & (high >= point - reach)
        near = faces[meets[:, 0] & meets[:, 1] & meets[:, 2]]
        # A file of a few bytes may repeat one triangle a million times.
        near = near[np.sort(distinct(self.triangles[near])[0])]
        triangle, barycentrics, place = _closest_of(self.positions, self.triangles[near], point)
        return int(near[triangle]), barycentrics, place


def ray_distances(starts: Floats, rays: Floats, corners: Floats) -> Floats:
    """(pairs,) distances along (pairs, 3) rays, in units of their length, from (pairs, 3) starts to triangles.

    Each ray has its own triangle among (pairs, 3, 3) corners. The distance is infinite if the ray misses the triangle
    or lies in its plane.
    """
    # Coordinate by coordinate, as numpy takes three times as long along an axis of three.
    a, b, c = corners.transpose(1, 2, 0)
    rays, relative = rays.T, starts.T - a
    first, second = b - a, c - a
    across, turned = cross(rays, second), cross(relative, first)
    determinant = dot(first, across)
    # A ray in the plane of its triangle gives quotients that are not numbers, which count as no hit.
    with np.errstate(all="ignore"):
        one, other = dot(relative, across) / determinant, dot(rays, turned) / determinant
        distance = dot(second, turned) / determinant
        hit = (one >= 0) & (other >= 0) & (one + other <= 1) & (distance > 0)
    return np.where(hit, distance, np.inf)


def distances_along(start: Floats, ray: Floats, corners: Floats) -> Floats:
    """(triangles,) the `ray_distances` of one (3,) ray from a (3,) start to each of (triangles, 3, 3) corners."""
    shape = (len(corners), 3)
    return ray_distances(np.broadcast_to(start, shape), np.broadcast_to(ray, shape), corners)


def ray_hits(starts: Floats, rays: Floats, corners: Floats) -> tuple[Ints, Ints, Floats]:
    """Find all triangles that rays meet.

    The determinants of Möller and Trumbore are products of the rays' Plücker coordinates with vectors of the triangles,
    so that matrix products give those of all pairs.

    Args:
        starts: (rays, 3)
        rays: (rays, 3)
        corners: (triangles, 3, 3)

    Returns:
        (hits,) rays, (hits,) triangles, and (hits,) distances, in units of the length of each ray.
    """
    # Products of coordinates lose digits far from the origin.
    middle = starts.mean(axis=0) if len(starts) else np.zeros(3)
    starts = starts - middle
    lines = np.concatenate([np.stack(cross(starts.T, rays.T), axis=1), rays], axis=1)
    ends = np.concatenate([starts, np.ones((len(starts), 1))], axis=1)
    a, b, c = corners.transpose(1, 2, 0) - middle[:, None]
    first, second = b - a, c - a
    normals = np.stack(cross(first, second))
    of_one = np.concatenate([second, -np.stack(cross(second, a))])
    of_other = np.concatenate([-first, -np.stack(cross(a, first))])
    planes = np.concatenate([normals, -dot(normals, a)[None]])
    found = []
    size = max(_PAIRS // max(len(rays), 1), 1)
    # As for `ray_distances`.
    with np.errstate(all="ignore"):
        for begin in range(0, len(corners), size):
            part = slice(begin, begin + size)
            determinants = -rays @ normals[:, part]
            one, other = lines @ of_one[:, part], lines @ of_other[:, part]
            within = one * determinants >= 0
            within &= other * determinants >= 0
            within &= (determinants - one - other) * determinants >= 0
            # Searching the flat array is several times as fast.
            places = np.flatnonzero(within)
            numbers, triangles = np.divmod(places, within.shape[1])
            determinants = determinants.ravel()[places]
            distances = np.einsum("hk,kh->h", ends[numbers], planes[:, part][:, triangles]) / determinants
            # Quotients, as products of the least numbers are 0.
            one, other = one.ravel()[places] / determinants, other.ravel()[places] / determinants
            hit = (one >= 0) & (other >= 0) & (one + other <= 1) & (distances > 0) & np.isfinite(distances)
            found.append((numbers[hit], begin + triangles[hit], distances[hit]))
    if not found:
        return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0)
    numbers, triangles, distances = (np.concatenate(each) for each in zip(*found, strict=True))
    return numbers, triangles, distances


def balls(corners: Floats) -> tuple[Floats, Floats]:
    """(triangles, 3) centroids of (triangles, 3, 3) corners, and (triangles,) the radii of balls round all corners."""
    # Coordinate by coordinate, as numpy takes four times as long along an axis of three.
    a, b, c = corners.transpose(1, 2, 0)
    middles = (a + b + c) / 3.0
    first, second, third = (dot(each, each) for each in (a - middles, b - middles, c - middles))
    return np.ascontiguousarray(middles.T), np.sqrt(np.maximum(np.maximum(first, second), third))


def near_points(corners: Floats, points: Floats, reach: float) -> Ints:
    """Sorted indices of the (triangles, 3, 3) corners within reach of the ball round (points, 3), by bounding balls."""
    middles, radii = balls(corners)
    middle = points.mean(axis=0)
    reach += float(np.sqrt(np.max(np.sum((points - middle) ** 2, axis=1))))
    return np.flatnonzero(np.sqrt(np.sum((middles - middle) ** 2, axis=1)) < reach + radii)
