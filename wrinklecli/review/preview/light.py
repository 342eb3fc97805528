"""Light a surface with a key light with soft shadows, a fill light, and a sky that near things hide."""

import numpy as np

from wrinklecli.numeric.arrays import PLASTIC, Array, Ints
from wrinklecli.review.preview.rays import LIFT, Hits, TracedSurface, unit_rows

# Pixels along each axis that share one set of light rays; a box filter of this size blends their results.
REACH = 4
# Rays to the sky for each pixel; the filter makes 128 of them.
_AMBIENT_RAYS = 8
# Rays to the key light for each pixel; the filter makes 64 of them.
_SHADOW_RAYS = 4
# Linear RGB of the key light, which rakes over wrinkles and is a little warmer, of the fill light at the camera, which
# nothing hides from what it sees, and of the sky: what the key light does not reach has a third of the light, as in a
# portrait, and is not black.
RAKING_LIGHTS = np.array([(0.78, 0.75, 0.72), (0.247, 0.25, 0.253), (0.137, 0.141, 0.144)], np.float32)
# Radius of the key light at unit distance.
_SOFTNESS = np.float32(0.12)
# Brightness of the highlight, linear.
_SHINE = 0.10
# Distance up to which triangles hide the sky, over half the picture's height.
_FAR = np.float32(1.2)
# A shadow ray that enters the surface stays on its curve, and is not shadowed, if normals there have at least this
# cosine
_SAME_CURVE = np.float32(0.8)
# and the ray is shorter than this, over half the picture's height.
_SOON = np.float32(0.4)
# Inverse of the golden ratio, whose multiples spread angles evenly, and form no pattern with those of `PLASTIC`.
_GOLDEN = 0.6180339887498949


def light_up(
    surface: TracedSurface,
    hits: Hits,
    shape: tuple[int, int],
    first: int,
    towards: tuple[float, float, float],
) -> tuple[Array, Array]:
    """Light hits: (hits, 3) diffuse light, to multiply their colours by, and (hits,) shine to add, both linear.

    Args:
        surface: The triangles.
        hits: The hits of a band of pixels, in any order.
        shape: Rows and columns of the band.
        first: Row of the picture at which the band begins.
        towards: Direction to the key light in camera axes.
    """
    width = shape[1]
    # Light is traced for one hit of each pixel.
    firsts = np.full(shape[0] * width, -1, np.intp)
    firsts[hits.pixels[::-1]] = np.arange(len(hits.pixels))[::-1]
    pixels = np.flatnonzero(firsts >= 0)
    sets = (pixels // width + first) % REACH * REACH + pixels % width % REACH
    # Parallel rays one after another are a third faster, because of the caches.
    order = np.argsort(sets, kind="stable")
    pixels, sets = pixels[order], sets[order]
    chosen = hits.only(firsts[pixels])
    starts = _starts(surface, chosen)
    key = unit_rows(np.array([towards], np.float32))
    openness = smooth(_openness(surface, starts, chosen.normals, sets), pixels, shape)[hits.pixels]
    lit = smooth(_lit(surface, starts, chosen, sets, key), pixels, shape)[hits.pixels]
    amounts = (
        lit * np.maximum(hits.normals @ key[0], 0),
        -np.sum(hits.normals * hits.directions, axis=1),
        openness * (0.8 + 0.2 * hits.normals[:, 1]),
    )
    light = np.stack(amounts, axis=1) @ RAKING_LIGHTS
    gleam = np.maximum(np.einsum("pi,pi->p", hits.normals, unit_rows(key - hits.directions)), 0) ** 2
    return light, _SHINE * lit * (gleam * gleam * gleam) ** 4


def _starts(surface: TracedSurface, hits: Hits) -> Array:
    """(hits, 3) points where light rays start: just above the curved surface that the vertex normals suggest.

    Source: J. Hanika, Hacking the Shadow Terminator, Ray Tracing Gems II, 2021.
    """
    corners = surface.corners[hits.triangles]
    points = np.einsum("pi,pia->pa", hits.weights, corners)
    normals = surface.normals[hits.triangles] * hits.sides[..., None]
    below = np.minimum(np.einsum("pia,pia->pi", points[:, None] - corners, normals), 0)
    lifts = np.einsum("pi,pia->pa", hits.weights * below, normals)
    return np.asarray(points - lifts + LIFT * hits.sides * surface.faces[hits.triangles])


def _openness(surface: TracedSurface, points: Array, normals: Array, sets: Ints) -> Array:
    """(hits,) openness to the sky, 0 to 1; a triangle hides less of it the farther away it is.

    Rays start at (hits, 3) points just above the surface; `sets` has the number of each one's set, 0 to REACH² - 1.
    """
    tangents, bitangents = _basis(normals)
    openness = np.zeros(len(points), np.float32)
    for disc in _discs(_AMBIENT_RAYS):
        x, y, square, length = disc[sets].T[..., None]
        directions = x * tangents
        directions += y * bitangents
        directions += np.sqrt(1 - square) * normals
        # Lengths are even from 0 to _FAR, so that the part of the rays that hit falls linearly to 0.
        free = surface.shades.run(points, directions, dists=_FAR * length[:, 0], query="OCCLUDED") < 0
        openness += free / np.float32(_AMBIENT_RAYS)
    return openness


def _lit(surface: TracedSurface, points: Array, hits: Hits, sets: Ints, key: Array) -> Array:
    """(hits,) visible part of the key light in direction (1, 3), 0 to 1; 0 for normals that face away from it.

    A normal may face the light although its triangle does not, because triangles are chords of a curved surface. A ray
    from there enters the surface, and is not shadowed if it soon leaves the same curve again.
    """
    facing_it = np.flatnonzero(hits.normals @ key[0] > 0)
    points, sets, sides = points[facing_it], sets[facing_it], hits.sides[facing_it]
    triangles, normals = hits.triangles[facing_it], hits.normals[facing_it]
    outwards = sides * surface.faces[triangles]
    inside = np.einsum("pi,pia->pa", hits.weights[facing_it], surface.corners[triangles]) - LIFT * outwards
    across = np.concatenate(_basis(key))
    free = np.zeros(len(points), np.float32)
    for disc in _discs(_SHADOW_RAYS):
        directions = (key + _SOFTNESS * (disc[:, :2] @ across))[sets]
        starts = points.copy()
        below = np.flatnonzero(np.einsum("pi,pi->p", outwards, directions) < 0)
        met = surface.rays.run(inside[below], directions[below], output=True)
        exits = sides[below] * surface.faces[met["primID"]]
        alike = np.einsum("pi,pi->p", exits, normals[below]) > _SAME_CURVE
        ways = np.einsum("pi,pi->p", exits, directions[below])
        leaving = np.flatnonzero((met["primID"] >= 0) & (ways > 0) & alike & (met["tfar"] < _SOON))
        out = below[leaving]
        starts[out] = inside[out] + (met["tfar"][leaving, None] + LIFT) * directions[out]
        free += (surface.shades.run(starts, directions, query="OCCLUDED") < 0) / np.float32(_SHADOW_RAYS)
    lit = np.zeros(len(hits.normals), np.float32)
    lit[facing_it] = free
    return lit


def smooth(values: Array, places: Ints, shape: tuple[int, int], reach: int = REACH) -> Array:
    """Blend the values of neighbours by a box filter, of a side in pixels, over the pixels that have a value."""
    sums, counts = np.zeros((2, *shape), np.float32)
    sums.ravel()[places] = values
    counts.ravel()[places] = 1
    sums, counts = (_summed(_summed(each, reach).T, reach).T for each in (sums, counts))
    return (sums / np.maximum(counts, 1)).ravel()


def _summed(rows: Array, reach: int) -> Array:
    """Sum rows (n, columns) over windows of `reach` rows. To import scipy's filters takes longer than many pictures."""
    padded = np.pad(rows, ((reach // 2, (reach - 1) // 2), (0, 0)))
    return sum((padded[first:][: len(rows)] for first in range(1, reach)), padded[: len(rows)])


def _basis(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors across each normal, continuous except at one pole (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1), np.stack([b, sign + y * y * a, -y], 1)


def _discs(count: int) -> Array:
    """(count, REACH², 4) points of the unit disc: x, y, the squared radius, and a length of 0 to 1.

    The points of a golden-angle spiral are dealt out in turn, so that each of the REACH² sets covers the disc evenly.
    """
    numbers = np.arange(count * REACH**2)
    squares = (numbers + 0.5) / len(numbers)
    angles = 2 * np.pi * _GOLDEN * numbers
    lengths = (PLASTIC * numbers + 0.5) % 1
    radii = np.sqrt(squares)
    spiral = np.stack([radii * np.cos(angles), radii * np.sin(angles), squares, lengths], axis=1)
    return spiral.reshape(count, REACH**2, 4).astype(np.float32)
