"""Light on a surface: a raking key light with soft shadows, a fill light, and a sky that near things hide."""

import numpy as np
from scipy.ndimage import uniform_filter

from wrinklecli.numeric.arrays import Array, Ints
from wrinklecli.review.preview.rays import LIFT, Hits, TracedSurface, unit_rows

# Neighbours per axis that deal out a set of light rays among them; a box filter of this size joins it again.
REACH = 4
_AMBIENT_RAYS = 8  # per pixel: 128 after the filter
_SHADOW_RAYS = 4
# Camera axes: right, up, backwards.
_KEY = np.array((-0.62, 0.62, 0.48), np.float32)
_FILL = np.array((0.75, 0.05, 0.65), np.float32)
_LIGHTS = np.array([(0.78, 0.75, 0.72), (0.126, 0.133, 0.14), (0.228, 0.235, 0.24)], np.float32)  # key, fill, sky
_SOFTNESS = np.float32(0.12)  # radius of the key light at unit distance
_SHINE = 0.10
_FAR = np.float32(1.2)  # occluders count up to here, over half the picture's height
# A ray that went inside leaves the curve that it began on, if normals there have such a cosine, and it is no longer.
_SAME_CURVE, _SOON = np.float32(0.8), np.float32(0.4)
_GOLDEN = 0.6180339887498949
_PLASTIC = 0.7548776662466927  # goes with the golden ratio as that with whole numbers: no pattern with it


def light_up(
    surface: TracedSurface, hits: Hits, shape: tuple[int, int], first: int, *, from_right: bool = False
) -> tuple[Array, Array]:
    """The light that hits get: diffuse, to be multiplied by their colour, and mirrored, to be added.

    Args:
        surface: The triangles.
        hits: Of a band of pixels, in any order.
        shape: Rows and columns of the band.
        first: Row of the picture that the band begins with.
        from_right: Whether the key light is on the right, and the fill light on the left.

    Returns:
        (hits, 3) and (hits,), linear.
    """
    width = shape[1]
    # One hit of each pixel speaks for it.
    firsts = np.full(shape[0] * width, -1, np.intp)
    firsts[hits.pixels[::-1]] = np.arange(len(hits.pixels))[::-1]
    pixels = np.flatnonzero(firsts >= 0)
    sets = (pixels // width + first) % REACH * REACH + pixels % width % REACH
    # Parallel rays in a row are a third faster, for what they find in the caches.
    order = np.argsort(sets, kind="stable")
    pixels, sets = pixels[order], sets[order]
    chosen = hits.only(firsts[pixels])
    starts = _starts(surface, chosen)
    side = np.array((-1.0 if from_right else 1.0, 1.0, 1.0), np.float32)
    key, fill = unit_rows(side * _KEY[None]), unit_rows(side * _FILL[None])
    openness = _smooth(_openness(surface, starts, chosen.normals, sets), pixels, shape)[hits.pixels]
    lit = _smooth(_lit(surface, starts, chosen, sets, key), pixels, shape)[hits.pixels]
    amounts = (
        lit * np.maximum(hits.normals @ key[0], 0),
        openness * np.maximum(hits.normals @ fill[0], 0),
        openness * (0.8 + 0.2 * hits.normals[:, 1]),
    )
    light = np.stack(amounts, axis=1) @ _LIGHTS
    gleam = np.maximum(np.einsum("pi,pi->p", hits.normals, unit_rows(key - hits.directions)), 0) ** 2
    return light, _SHINE * lit * (gleam * gleam * gleam) ** 4


def _starts(surface: TracedSurface, hits: Hits) -> Array:
    """(hits, 3) where light rays start: just above the curved surface that the vertex normals suggest.

    Source: J. Hanika, Hacking the Shadow Terminator, Ray Tracing Gems II, 2021.
    """
    found, weights, sides = hits.found, hits.weights, hits.sides
    corners = surface.corners[found]
    points = np.einsum("pi,pia->pa", weights, corners)
    normals = surface.normals[found] * sides[..., None]
    below = np.minimum(np.einsum("pia,pia->pi", points[:, None] - corners, normals), 0)
    lifts = np.einsum("pi,pia->pa", weights * below, normals)
    starts: Array = points - lifts + LIFT * sides * surface.faces[found]
    return starts


def _openness(surface: TracedSurface, points: Array, normals: Array, sets: Ints) -> Array:
    """(hits,) openness to the sky, 0 to 1: an occluder counts the less the further off it is.

    Args:
        surface: The triangles.
        points: (hits, 3) where rays start, just above the surface.
        normals: (hits, 3) unit.
        sets: (hits,) number of each hit's set of rays, 0 to REACH² - 1.
    """
    tangents, bitangents = _basis(normals)
    openness = np.zeros(len(points), np.float32)
    for disc in _discs(_AMBIENT_RAYS):
        x, y, square, length = disc[sets].T[..., None]
        directions = x * tangents
        directions += y * bitangents
        directions += np.sqrt(1 - square) * normals
        # Lengths are even from 0 to FAR: the share of rays that hit falls to 0 in a straight line.
        free = surface.rays.run(points, directions, dists=_FAR * length[:, 0], query="OCCLUDED") < 0
        openness += free / np.float32(_AMBIENT_RAYS)
    return openness


def _lit(surface: TracedSurface, points: Array, hits: Hits, sets: Ints, key: Array) -> Array:
    """(hits,) how much of the key light, in direction (1, 3), is seen, 0 to 1; none from what faces away from it.

    A normal may face the light where its triangle does not, as the triangle is but a chord of a curved surface. Such a
    ray goes inside, and where it soon comes out again of the same curve hides nothing.
    """
    facing_it = np.flatnonzero(hits.normals @ key[0] > 0)
    points, sets, sides = points[facing_it], sets[facing_it], hits.sides[facing_it]
    found, normals = hits.found[facing_it], hits.normals[facing_it]
    outwards = sides * surface.faces[found]
    inside = np.einsum("pi,pia->pa", hits.weights[facing_it], surface.corners[found]) - LIFT * outwards
    across = np.concatenate(_basis(key))
    free = np.zeros(len(points), np.float32)
    for disc in _discs(_SHADOW_RAYS):
        directions = (key + _SOFTNESS * (disc[:, :2] @ across))[sets]
        starts = points.copy()
        below = np.flatnonzero(np.einsum("pi,pi->p", outwards, directions) < 0)
        met = surface.rays.run(inside[below], directions[below], output=True)
        left = sides[below] * surface.faces[met["primID"]]
        alike = np.einsum("pi,pi->p", left, normals[below]) > _SAME_CURVE
        ways = np.einsum("pi,pi->p", left, directions[below])
        leaving = np.flatnonzero((met["primID"] >= 0) & (ways > 0) & alike & (met["tfar"] < _SOON))
        out = below[leaving]
        starts[out] = inside[out] + (met["tfar"][leaving, None] + LIFT) * directions[out]
        free += (surface.rays.run(starts, directions, query="OCCLUDED") < 0) / np.float32(_SHADOW_RAYS)
    lit = np.zeros(len(hits.normals), np.float32)
    lit[facing_it] = free
    return lit


def _smooth(values: Array, places: Ints, shape: tuple[int, int]) -> Array:
    """Join the ray sets of neighbours: a box filter of a grid, over the places that have a value; all places."""
    sums, counts = np.zeros((2, *shape), np.float32)
    sums.ravel()[places] = values
    counts.ravel()[places] = 1
    sums, counts = (uniform_filter(each, REACH, mode="constant") for each in (sums, counts))
    smoothed: Array = (sums / np.maximum(counts, 1e-6)).ravel()
    return smoothed


def _basis(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors across each normal, continuous but for one pole (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1), np.stack([b, sign + y * y * a, -y], 1)


def _discs(count: int) -> Array:
    """Points spread evenly over the unit disc, (count, REACH², 4): x, y, the squared radius, a length of 0 to 1.

    Any one of the sets covers the disc, and all together cover it more finely (a golden-angle spiral, dealt
    out in turn).
    """
    numbers = np.arange(count * REACH**2)
    squares = (numbers + 0.5) / len(numbers)
    angles = 2 * np.pi * _GOLDEN * numbers
    lengths = (_PLASTIC * numbers + 0.5) % 1
    radii = np.sqrt(squares)
    spiral = np.stack([radii * np.cos(angles), radii * np.sin(angles), squares, lengths], axis=1)
    return spiral.reshape(count, REACH**2, 4).astype(np.float32)
