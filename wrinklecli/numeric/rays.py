"""Distances along rays to triangles.

libigl has rays, too, but keeps distances in single precision, and misses triangles below an area in scene units.

Source: T. Möller, B. Trumbore, *Fast, minimum storage ray-triangle intersection*, 1997.
"""

from collections.abc import Callable

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, dot
from wrinklecli.numeric.cells import Cells
from wrinklecli.numeric.closest import ROUNDING, balls
from wrinklecli.numeric.portions import portions, portions_of


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
    # As for `ray_distances`.
    with np.errstate(all="ignore"):
        for part in portions(len(corners), 8 * len(rays)):
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
            found.append((numbers[hit], part.start + triangles[hit], distances[hit]))
    if not found:
        return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0)
    numbers, triangles, distances = (np.concatenate(each) for each in zip(*found, strict=True))
    return numbers, triangles, distances


def first_hits(
    starts: Floats,
    rays: Floats,
    lengths: Floats,
    corners: Floats,
    *,
    least: float,
    apart: Callable[[Ints, Ints], Bools] | None = None,
    most: int | None = None,
) -> Floats:
    """(rays,) distances to the first triangle that each ray meets within its length, or farther on; infinite for none.

    Args:
        starts: (rays, 3), at least one.
        rays: (rays, 3) unit vectors.
        lengths: (rays,)
        corners: (triangles, 3, 3)
        least: A triangle that is no farther away is not met.
        apart: Tells for (pairs,) triangles and (pairs,) rays which may meet; all if left out.
        most: Pairs of a triangle and a ray near by above which only some rays are followed, evenly from the longest on.
    """
    found = np.full(len(starts), np.inf)
    order = np.arange(len(starts))
    points = starts + 0.5 * lengths[:, None] * rays
    middles, radii = balls(corners)
    reaches = radii + 0.5 * float(lengths.max())
    cells = Cells.of(points)
    pairs, reached = cells.meeting(middles, reaches)
    total = int(cells.counts[reached].sum())
    if most is not None and total > most:
        order = np.argsort(-lengths, kind="stable")[:: -(-total // most)]
        cells = Cells.of(points[order])
        pairs, reached = cells.meeting(middles, reaches)
    for part in portions_of(4 * cells.counts[reached]):
        ball, at = np.repeat(pairs[part], cells.counts[reached[part]]), order[cells.numbers_in(reached[part])]
        # A ray that misses the ball round a triangle does not meet the triangle.
        away = [axis[at] - middle[ball] for axis, middle in zip(points.T, middles.T, strict=True)]
        squared, along = dot(away, away), dot(away, [axis[at] for axis in rays.T])
        near = squared - along**2 <= radii[ball] ** 2 + ROUNDING * squared
        ball, at = ball[near], at[near]
        if apart is not None:
            there = apart(ball, at)
            ball, at = ball[there], at[there]
        distances = ray_distances(starts[at], rays[at], corners[ball])
        np.minimum.at(found, at, np.where(distances > least, distances, np.inf))
    return found


def near_points(corners: Floats, points: Floats, reach: float) -> Ints:
    """Sorted indices of the (triangles, 3, 3) corners within reach of the ball round (points, 3), by bounding balls."""
    middles, radii = balls(corners)
    middle = points.mean(axis=0)
    reach += float(np.sqrt(np.max(np.sum((points - middle) ** 2, axis=1))))
    return np.flatnonzero(np.sqrt(np.sum((middles - middle) ** 2, axis=1)) < reach + radii)
