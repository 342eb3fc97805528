"""Trace rays with Embree: find the triangle that a pixel sees, and what hides a point of the surface.

The same triangles give the same hits: rays follow fixed patterns.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints, unit
from wrinklecli.review.preview.camera import TANGENT

# How far above the surface rays start that leave it, over half the picture's height.
LIFT = np.float32(2e-4)
# How deep below the surface a point may lie and still count as visible, over half the picture's height.
_NEAR = 0.01
# Bytes that Embree takes; measured were 130 MB with two threads, twice as much is kept, as it depends on the machine.
_EMBREE = 2**28
# Bytes that Embree takes for a triangle; measured were 120.
_EMBREE_TRIANGLE = 240


@dataclass(frozen=True, slots=True)
class TracedSurface:
    """Triangles in camera space, float32. The eye is at (0, 0, 1 / tangent), or rays are parallel.

    Attributes:
        rays: Embree's scene, which finds the triangles that rays hit.
        corners: (triangles, 3, 3) positions.
        normals: (triangles, 3, 3) unit normals of the corners.
        faces: (triangles, 3) unit normals of the triangles.
        tangent: Tangent of half the camera's vertical field of view; 0 for parallel rays.
    """

    rays: Any
    corners: Array
    normals: Array
    faces: Array
    tangent: float


def trace(corners: Floats, normals: Floats, tangent: float = TANGENT) -> TracedSurface:
    """Prepare (triangles, 3, 3) corners and their unit normals, in camera space, for rays."""
    return TracedSurface(
        rays=_traced(corners),
        corners=np.ascontiguousarray(corners, np.float32),
        normals=normals.astype(np.float32),
        faces=unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).astype(np.float32),
        tangent=tangent,
    )


def _traced(corners: Floats) -> Any:
    """Build Embree's scene."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    leave_room(len(corners))
    scene = EmbreeScene(robust=True)  # rays through a shared edge hit one triangle or the other
    TriangleMesh(scene, np.ascontiguousarray(corners, np.float32))
    return scene


def leave_room(triangles: int = 0) -> None:
    """Raise MemoryError if Embree cannot have its memory, because without it Embree ends the process."""
    np.empty(_EMBREE + _EMBREE_TRIANGLE * triangles, np.uint8)


@dataclass(frozen=True, slots=True)
class Hits:
    """Points at which primary rays meet a surface.

    Attributes:
        pixels: (hits,) numbers in a band of the picture, row after row.
        middles: (hits, 2) where the rays pass, pixels of the whole picture.
        areas: (hits,) part of the pixel that each stands for.
        directions: (hits, 3) unit, from the eye.
        depths: (hits,) distance from the eye.
        triangles: (hits,) numbers of triangles.
        weights: (hits, 3) barycentric.
        sides: (hits, 1) -1 where the triangle is seen from behind, else 1.
        normals: (hits, 3) unit, towards the eye's side.
    """

    pixels: Ints
    middles: Array
    areas: Array
    directions: Array
    depths: Array
    triangles: Ints
    weights: Array
    sides: Array
    normals: Array

    def only(self, chosen: Bools | Ints) -> "Hits":
        """The chosen hits."""
        return Hits(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def joined(self, others: "Hits") -> "Hits":
        """These hits, followed by others."""
        both = ((getattr(self, field.name), getattr(others, field.name)) for field in fields(self))
        return Hits(*(np.concatenate(each) for each in both))


def first_hits(surface: TracedSurface, size: tuple[int, int], first: int, pixels: Ints, offsets: Array) -> Hits:
    """Trace primary rays.

    Args:
        surface: The triangles.
        size: Width and height of the picture, pixels.
        first: Row of the picture at which the band begins.
        pixels: (pixels,) numbers of the pixels to trace in the band.
        offsets: (rays, 2) of the rays of a pixel from its middle, down and across, pixels.
    """
    width, height = size
    down, across = np.divmod(np.repeat(pixels, len(offsets)), width)
    middles = np.stack([across, down + first], axis=1) + 0.5 + np.tile(offsets[:, ::-1], (len(pixels), 1))
    grid = np.full((len(middles), 3), -1, np.float32)
    grid[:, 0] = (middles[:, 0] * 2 / width - 1) * (surface.tangent * width / height)
    grid[:, 1] = (1 - middles[:, 1] * 2 / height) * surface.tangent
    directions = unit_rows(grid)
    eyes = np.zeros_like(directions)
    if surface.tangent:
        eyes[:, 2] = 1 / surface.tangent
    else:
        eyes[:, 0] = (middles[:, 0] * 2 / width - 1) * (width / height)
        eyes[:, 1] = 1 - middles[:, 1] * 2 / height
        eyes[:, 2] = surface.corners[..., 2].max(initial=0) + 1
    traced = surface.rays.run(eyes, directions, output=True)
    hit = np.flatnonzero(traced["primID"] >= 0)
    found, directions = traced["primID"][hit].astype(np.intp), directions[hit]
    u, v = traced["u"][hit], traced["v"][hit]
    weights = np.stack([1 - u - v, u, v], axis=1)
    behind = np.einsum("pi,pi->p", surface.faces[found], directions) > 0
    sides = np.where(behind, np.float32(-1), np.float32(1))[:, None]
    normals = np.zeros_like(directions)
    for i in range(3):
        normals += weights[:, i, None] * surface.normals[found, i]
    return Hits(
        pixels=np.repeat(pixels, len(offsets))[hit],
        middles=middles[hit].astype(np.float32),
        areas=np.full(len(hit), 1 / len(offsets), np.float32),
        directions=directions,
        depths=traced["tfar"][hit],
        triangles=found,
        weights=weights,
        sides=sides,
        normals=unit_rows(normals) * sides,
    )


def in_sight(surface: TracedSurface, points: Floats) -> Bools:
    """(points,) True if no triangle lies between (points, 3) points in camera space and the eye."""
    towards = np.zeros((len(points), 3))
    towards[:, 2] = 1.0
    if surface.tangent:
        towards = unit(np.array((0, 0, 1 / surface.tangent)) - points)
    starts = points + _NEAR * towards
    free = surface.rays.run(starts.astype(np.float32), towards.astype(np.float32), query="OCCLUDED") < 0
    return np.asarray(free)


def free_ways(corners: Floats, points: Floats, normals: Floats) -> Callable[[Floats], Bools]:
    """Prepare to find the unit directions, to eyes, in which nothing lies between points of a surface and an eye.

    Args:
        corners: (triangles, 3, 3) of everything.
        points: (points, 3) of a surface.
        normals: (points, 3) unit.

    Returns:
        A function of (eyes, 3) directions to far eyes, or (eyes, points, 3) to near ones, that gives (eyes, points).
    """
    middle = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    extent = max(float(np.abs(corners - middle).max()), 1e-30)
    rays = _traced((corners - middle) / extent)

    def free(towards: Floats) -> Bools:
        towards = np.broadcast_to(towards if towards.ndim == 3 else towards[:, None], (len(towards), *points.shape))
        starts = np.tile((points - middle) / extent + 10 * LIFT * normals, (len(towards), 1)).astype(np.float32)
        met = rays.run(starts, towards.reshape(-1, 3).astype(np.float32), query="OCCLUDED").reshape(len(towards), -1)
        return np.asarray((met < 0) & (np.sum(towards * normals, axis=2) > 0))

    return free


def unit_rows(vectors: Array) -> Array:
    """(n, k) float32 vectors divided by their length; a zero vector stays zero."""
    lengths = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    units: Array = vectors / np.maximum(lengths, np.float32(1e-30))[:, None]
    return units
