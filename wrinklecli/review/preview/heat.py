"""Compression as a colour: how much shorter each place of a surface is than in the stored pose."""

import numpy as np

from wrinklecli.character.scene import ScenePrimitive, pose_primitive
from wrinklecli.gltf.pixels import linear_rgb
from wrinklecli.numeric.arrays import Floats, Ints, face_normals

Colour = tuple[float, float, float]

# Compression, 1 - the smallest principal stretch, and its colour, sRGB.
HEAT: tuple[tuple[float, Colour], ...] = (
    (0.0, (0.84, 0.84, 0.82)),
    (0.1, (0.98, 0.90, 0.55)),
    (0.25, (0.98, 0.62, 0.22)),
    (0.45, (0.85, 0.20, 0.16)),
    (0.65, (0.50, 0.06, 0.36)),
    (0.8, (0.16, 0.03, 0.28)),
)
HEAT_TICKS = (0.0, 0.2, 0.4, 0.6, 0.8)


def heat_colours(losses: Floats) -> Floats:
    """(…, 3) sRGB of compressions."""
    stops = [loss for loss, _ in HEAT]
    channels = [np.interp(losses, stops, [colour[k] for _, colour in HEAT]) for k in range(3)]
    return np.stack(channels, axis=-1)


def compressions(primitive: ScenePrimitive, positions: Floats) -> Floats:
    """(vertices,) compression against the stored pose, the mean of the triangles around each place.

    Args:
        primitive: Of the scene.
        positions: (vertices, 3) where its vertices are now, world space.
    """
    stored = pose_primitive(primitive, None, np.zeros(1)).positions[0]
    # Vertices of a seam are one place.
    _, places = np.unique(primitive.vertices.positions, axis=0, return_inverse=True)
    places = places.reshape(-1)
    return _means(stored, positions, primitive.triangles, places)[places]


def point_colours(rest: Floats, posed: Floats, triangles: Ints) -> Floats:
    """(points, 3) linear RGB of compression, of (points, 3) at rest and now, and their (triangles, 3)."""
    return linear_rgb(heat_colours(_means(rest, posed, triangles, np.arange(len(rest)))))


def _means(rest: Floats, posed: Floats, triangles: Ints, places: Ints) -> Floats:
    """(places,) compression of the triangles around each place, the mean by area; (vertices,) have places."""
    losses = compression(rest[triangles], posed[triangles])
    areas = np.sqrt(np.sum(face_normals(rest, triangles) ** 2, axis=1))
    into = places[triangles].ravel()
    sums = np.bincount(into, np.repeat(losses * areas, 3), len(places))
    weights = np.bincount(into, np.repeat(areas, 3), len(places))
    return np.asarray(sums / np.where(weights > 0, weights, 1.0))


def compression(rest: Floats, posed: Floats) -> Floats:
    """(triangles,) 1 - the smallest principal stretch of each triangle, at least 0; 0 where it has no area at rest.

    Args:
        rest: (triangles, 3, 3) corners.
        posed: (triangles, 3, 3).

    Source: principal stretches squared are the eigenvalues of the product of the posed metric of a triangle's edges
        and the inverse of that at rest.
    """
    before, after = (_metric(corners) for corners in (rest, posed))
    a, b, c = before.T
    area = a * c - b * b
    solid = area > 1e-12 * (a + c) ** 2
    area = np.where(solid, area, 1.0)
    p, q, r = after.T
    trace = (c * p - 2 * b * q + a * r) / area
    determinant = np.maximum(p * r - q * q, 0.0) / area
    largest = trace / 2 + np.sqrt(np.maximum(trace**2 / 4 - determinant, 0.0))
    smallest = np.sqrt(determinant / np.where(largest > 0, largest, 1.0))
    return np.where(solid, np.maximum(1.0 - smallest, 0.0), 0.0)


def _metric(corners: Floats) -> Floats:
    """(triangles, 3) products of the edges from the first corner: of one, of both, of the other."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([np.sum(p * q, axis=1) for p, q in ((first, first), (first, second), (second, second))], axis=1)
