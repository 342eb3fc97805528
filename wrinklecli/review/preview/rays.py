"""Trace rays with Embree: find the triangle that a pixel sees, and what hides a point of the surface.

The same triangles give the same hits: rays follow fixed patterns.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeAlias

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Array, Bools, Floats, Ints, unit
from wrinklecli.review.preview.camera import TANGENT

# How far above the surface rays start that leave it, over half the picture's height.
LIFT = np.float32(2e-4)
# How deep below the surface a point may lie and still count as visible, over half the picture's height.
_NEAR = 0.01
# Bytes that Embree takes; measured were 130 MB with two threads, twice as much is kept, as it depends on the machine.
_EMBREE = 2**28
# Bytes that Embree takes for a triangle; measured were 120.
_EMBREE_TRIANGLE = 240
# Layers of hair, lace or glass through which a ray passes; what is behind more of them does not show.
_LAYERS = 32
INVISIBLE = 0.5 / 255.0
"""Opacity that does not change an 8-bit colour."""
# Units of libigl's tree in half a picture's height: it takes triangles for none whose area is below 1e-6 units.
_TREE_SIZE = 1e4

# Gives the opacity, 0 to 1, at points of (points,) triangles, by (points, 3) barycentric weights.
Opacity: TypeAlias = Callable[[Ints, Array], Array]


@dataclass(frozen=True, slots=True)
class TracedSurface:
    """Triangles in camera space, float32. The eye is at (0, 0, 1 / tangent), or rays are parallel.

    Attributes:
        rays: Embree's scene, which finds the triangles that rays hit.
        shades: The same of the triangles that throw shadows.
        corners: (triangles, 3, 3) positions.
        normals: (triangles, 3, 3) unit normals of the corners.
        faces: (triangles, 3) unit normals of the triangles.
        tangent: Tangent of half the camera's vertical field of view; 0 for parallel rays.
    """

    rays: Any
    shades: Any
    corners: Array
    normals: Array
    faces: Array
    tangent: float


def trace(
    places: Floats,
    normals: Floats,
    tangent: float = TANGENT,
    *,
    triangles: Ints | None = None,
    whole: Bools | None = None,
) -> TracedSurface:
    """Prepare a surface in camera space for rays.

    Args:
        places: (triangles, 3, 3) corners, or (vertices, 3) positions of `triangles`, which takes half the time.
        normals: (triangles, 3, 3) unit normals of the corners.
        tangent: As in `TracedSurface`.
        triangles: (triangles, 3) vertices.
        whole: (triangles,) True for those that throw shadows; None for all.
    """
    corners = places if triangles is None else places[triangles]
    rays = _traced(places, triangles)
    return TracedSurface(
        rays=rays,
        # A triangle in one point is never hit.
        shades=rays if whole is None else _traced(np.append(corners[whole], np.zeros((1, 3, 3)), axis=0), None),
        corners=np.ascontiguousarray(corners, np.float32),
        normals=normals.astype(np.float32),
        faces=unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).astype(np.float32),
        tangent=tangent,
    )


def _traced(places: Floats, triangles: Ints | None) -> Any:
    """Build Embree's scene of corners, or of positions and triangles; a `_Tree` where Embree is not installed."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except (ImportError, ValueError):  # ValueError: built for another numpy
        return _Tree(places, triangles)

    leave_room(len(places if triangles is None else triangles))
    scene = EmbreeScene(robust=True)  # rays through a shared edge hit one triangle or the other
    TriangleMesh(
        scene,
        np.ascontiguousarray(places, np.float32),
        None if triangles is None else np.ascontiguousarray(triangles, np.int32),
    )
    return scene


class _Tree:
    """Answers as Embree's scene does, by libigl, in three times the time."""

    def __init__(self, places: Floats, triangles: Ints | None) -> None:
        import igl

        self._places = _TREE_SIZE * np.asarray(places, np.float64).reshape(-1, 3)
        corners = np.arange(len(self._places)) if triangles is None else triangles
        self._triangles = np.asarray(corners, np.int64).reshape(-1, 3)
        self._tree = igl.AABB()
        self._tree.init(self._places, self._triangles)

    def run(self, starts: Array, directions: Array, *, query: str = "INTERSECT", output: bool = False) -> Any:
        """The first triangles that rays hit, -1 for none; with `output`, where they are hit too."""
        rays = (_TREE_SIZE * starts.astype(np.float64), directions.astype(np.float64))
        found, distances, shares = self._tree.intersect_ray_first(self._places, self._triangles, *rays)
        if query == "OCCLUDED" or not output:
            return found
        u, v, far = np.where(found >= 0, [*shares.T, distances / _TREE_SIZE], 0.0).astype(np.float32)
        return {"primID": found, "tfar": far, "u": u, "v": v}


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


def first_hits(
    surface: TracedSurface,
    size: tuple[int, int],
    first: int,
    pixels: Ints,
    offsets: Array,
    opacity: Opacity | None = None,
) -> Hits:
    """Trace primary rays; of a pixel's hits those in front are first.

    Args:
        surface: The triangles.
        size: Width and height of the picture, pixels.
        first: Row of the picture at which the band begins.
        pixels: (pixels,) numbers of the pixels to trace in the band.
        offsets: (rays, 2) of the rays of a pixel from its middle, down and across, pixels.
        opacity: Of the triangles; None if all are opaque. Rays go on behind what lets light through.
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
    rays, triangles, weights, depths, shares = _seen(surface, eyes, directions, opacity)
    directions = directions[rays]
    behind = np.einsum("pi,pi->p", surface.faces[triangles], directions) > 0
    sides = np.where(behind, np.float32(-1), np.float32(1))[:, None]
    normals = np.zeros_like(directions)
    for i in range(3):
        normals += weights[:, i, None] * surface.normals[triangles, i]
    return Hits(
        pixels=np.repeat(pixels, len(offsets))[rays],
        middles=middles[rays].astype(np.float32),
        areas=shares / np.float32(len(offsets)),
        directions=directions,
        depths=depths,
        triangles=triangles,
        weights=weights,
        sides=sides,
        normals=unit_rows(normals) * sides,
    )


def _seen(surface: TracedSurface, eyes: Array, directions: Array, opacity: Opacity | None) -> list[Array]:
    """The hits of rays by layers: (hits,) rays, triangles, (hits, 3) weights, depths, and parts of a ray's light."""
    rays, far, left = np.arange(len(eyes)), np.zeros(len(eyes), np.float32), np.ones(len(eyes), np.float32)
    layers: list[tuple[Array, ...]] = []
    while len(layers) < _LAYERS and (len(rays) or not layers):
        starts = eyes[rays] + far[:, None] * directions[rays] if layers else eyes
        traced = surface.rays.run(starts, directions[rays], output=True)
        hit = np.flatnonzero(traced["primID"] >= 0)
        rays, far, left = rays[hit], far[hit] + traced["tfar"][hit], left[hit]
        triangles, u, v = traced["primID"][hit].astype(np.intp), traced["u"][hit], traced["v"][hit]
        weights = np.stack([1 - u - v, u, v], axis=1)
        shares = left if opacity is None else left * opacity(triangles, weights)
        layers.append(tuple(each[shares > 0] for each in (rays, triangles, weights, far, shares)))
        left = left - shares
        on = left > INVISIBLE
        rays, far, left = rays[on], far[on] + LIFT, left[on]
    return [np.concatenate(each) for each in zip(*layers, strict=True)]


def in_sight(surface: TracedSurface, points: Floats) -> Bools:
    """(points,) True if no triangle lies between (points, 3) points in camera space and the eye."""
    towards = np.zeros((len(points), 3))
    towards[:, 2] = 1.0
    if surface.tangent:
        towards = unit(np.array((0, 0, 1 / surface.tangent)) - points)
    starts = points + _NEAR * towards
    free = surface.rays.run(starts.astype(np.float32), towards.astype(np.float32), query="OCCLUDED") < 0
    return np.asarray(free)


@dataclass(frozen=True, slots=True)
class Occluders:
    """Triangles that may lie between points of a surface and an eye or a light.

    Attributes:
        rays: Embree's scene, around the origin and of size 1.
        middle: (3,) of the triangles, world space.
        extent: Half their size, scene units.
    """

    rays: Any
    middle: Floats
    extent: float

    @classmethod
    def of(cls, places: Floats, triangles: Ints | None = None) -> "Occluders":
        """Prepare triangles in world space, as for `trace`; where there are none, one without an area hides nothing."""
        places = places if places.size else np.zeros((1, 3, 3))
        points = places.reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        extent = max(float(np.abs(points - middle).max()), TINY)
        return cls(_traced((places - middle) / extent, triangles), middle, extent)

    def free(self, points: Floats, normals: Floats, towards: Floats) -> Bools:
        """Find the directions in which nothing hides the outside of a surface.

        Args:
            points: (points, 3) of the surface.
            normals: (points, 3) unit.
            towards: (eyes, 3) unit, to eyes that are far away.

        Returns:
            (eyes, points) True if a point faces an eye and nothing lies between them.
        """
        lifted = (points - self.middle) / self.extent + 10 * LIFT * normals
        starts = np.tile(lifted, (len(towards), 1)).astype(np.float32)
        met = self.rays.run(starts, np.repeat(towards, len(points), axis=0).astype(np.float32), query="OCCLUDED")
        return np.asarray((met.reshape(len(towards), -1) < 0) & (towards @ normals.T > 0))


def unit_rows(vectors: Array) -> Array:
    """(n, k) float32 vectors divided by their length; a zero vector stays zero."""
    lengths = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return np.asarray(vectors / np.maximum(lengths, np.float32(1e-30))[:, None])
