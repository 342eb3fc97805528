"""A tool's place on its mesh at rest: the surface under its patch, and the room above it for wrinkles."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.activity import ClipActivity
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.patch import LOW, Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, children
from wrinklecli.numeric.closest import ROUNDING, meets_box
from wrinklecli.numeric.intersections import zero_lines
from wrinklecli.numeric.rays import first_hits
from wrinklecli.surface.refine import Refinement

# v of the lines along a patch on which layers are counted.
_LINES = np.linspace(-0.75, 0.75, 7)
# Points on each line.
_POINTS = 64
# Least distance of two layers of a surface, over the segment.
_APART = 0.01
# Distance over the mesh's size below which a surface touches a vertex at rest, and is not opposite.
_TOUCHING = 1e-6
# Pairs of a wrinkle's vertex and a triangle near by that are checked in all, which takes some seconds.
_MOST_PAIRS = 2**25


@dataclass(frozen=True, slots=True)
class SurfaceBelow:
    """The surface under a patch, at rest.

    Attributes:
        gap: Fraction of the segment without a member under it.
        detour: Length of the surface under the rest of the segment, over that of the segment.
        doubled: Fraction of the patch over two or more layers that wrinkle.
    """

    gap: float
    detour: float
    doubled: float


def ground_under(plan: MeshPlan, patch: Patch) -> SurfaceBelow:
    """Cut the members of a patch by planes along it."""
    fine = plan.fine
    vertices, local = np.unique(fine.triangles[children(fine.subdivision.parents, patch.under)], return_inverse=True)
    members, positions = local.reshape(-1, 3), fine.rest_positions[vertices]
    places, normals = fine.posed_at(patch.pose, vertices)
    u, v = patch.coordinates(places)
    least = LOW * abs(patch.shape_strength)
    moves = np.abs(patch.magnitudes(u, v, normals)) > least
    points = (np.arange(_POINTS) + 0.5) / _POINTS
    ends = _cut(members, np.column_stack([u, positions]), v, 0.0)
    middle, length = ends[..., 0], np.sqrt(np.sum((ends[:, 1, 1:] - ends[:, 0, 1:]) ** 2, axis=1))
    covered = _layers(middle, points).any(axis=1)
    inside = np.clip(middle, 0.0, 1.0)
    runs, inner = np.abs(np.diff(middle, axis=1))[:, 0], np.abs(np.diff(inside, axis=1))[:, 0]
    parts = np.divide(inner, runs, out=((middle[:, 0] >= 0) & (middle[:, 0] <= 1)).astype(np.float64), where=runs > 0)
    straight = patch.path.length * float(inner.sum())
    wrinkling = members[moves[members].any(axis=1)]
    depths = patch.path.depths(positions)
    doubled = 0
    for line in _LINES:
        ends, heights = np.moveaxis(_cut(wrinkling, np.column_stack([u, depths]), v, float(line)), 2, 0)
        at, which = np.nonzero(_layers(ends, points))
        t = (points[at] - ends[which, 0]) / (ends[which, 1] - ends[which, 0])
        depth = heights[which, 0] + t * (heights[which, 1] - heights[which, 0])
        low, high = np.full(_POINTS, np.inf), np.full(_POINTS, -np.inf)
        np.minimum.at(low, at, depth)
        np.maximum.at(high, at, depth)
        doubled += int((high > low + _APART * patch.span).sum())
    return SurfaceBelow(
        gap=1.0 - float(covered.mean()),
        detour=float((parts * length).sum()) / straight if straight > 0 else 1.0,
        doubled=doubled / (len(_LINES) * _POINTS),
    )


def _cut(triangles: Ints, values: Floats, v: Floats, line: float) -> Floats:
    """(cuts, 2, columns) of (vertices, columns) values at both ends of each triangle's cut with the plane v = line."""
    found, shares = zero_lines(v - line, triangles)
    ends = np.einsum("ec,ecx->ex", shares, values[triangles[found]])
    return np.asarray(ends.reshape(-1, 2, values.shape[1]))


def _layers(ends: Floats, points: Floats) -> Bools:
    """(points, cuts) True if a cut lies over a u."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    return np.asarray((low <= points[:, None]) & (points[:, None] < high))


@dataclass(frozen=True, slots=True)
class Collision:
    """Wrinkles that are taller than the room that they have at rest.

    Attributes:
        count: Vertices that reach another part of the surface.
        height: Height of the vertex that goes furthest beyond, scene units.
        room: Room of that vertex, scene units.
        position: (3,) position of that vertex, world space at rest.
    """

    count: int
    height: float
    room: float
    position: Floats


def collision(plan: MeshPlan, carried: CarriedPatch, clips: Sequence[ClipActivity]) -> Collision | None:
    """Compare a tool's wrinkles at rest with the distance to the opposite surface along the normals.

    Any triangle of the same mesh may be opposite, except those of the vertex itself and those that touch it there.
    Without clips, the tallest wrinkles possible count.
    """
    fine = plan.fine
    count, worst = 0, None
    for way, peaks in zip((1.0, -1.0), _peaks(carried, clips), strict=True):
        tall = np.flatnonzero(peaks > LOW * peaks.max(initial=0.0))
        if not len(tall):
            continue
        vertices, heights = carried.vertices[tall], peaks[tall]
        rooms = _rooms(fine, vertices, heights, way)
        short = np.flatnonzero(rooms < heights)
        if len(short):
            count += len(short)
            most = short[np.argmax(heights[short] - rooms[short])]
            if worst is None or heights[most] - rooms[most] > worst.height - worst.room:
                at = fine.rest_positions[vertices[most]]
                worst = Collision(len(short), float(heights[most]), float(rooms[most]), at)
    return None if worst is None else replace(worst, count=count)


def _rooms(fine: Refinement, vertices: Ints, heights: Floats, way: float) -> Floats:
    """Distances from wrinkling vertices at rest to the opposite surface.

    Args:
        fine: The refined surface.
        vertices: (vertices,) vertices to check.
        heights: (vertices,) greatest distances to check, scene units.
        way: 1 outwards along the normals, -1 inwards.

    Returns:
        (vertices,) the room of each; infinite if nothing is within its height, and for some if there are very many.
    """
    size = fine.rest_size
    starts, rays = fine.rest_positions[vertices], way * fine.rest_normals_at(vertices)
    ends = np.concatenate([starts, starts + heights[:, None] * rays])
    low, high = ends.min(axis=0) - ROUNDING * size, ends.max(axis=0) + ROUNDING * size
    triangles = fine.triangles[meets_box(fine.rest_positions, low, high, fine.triangles)]

    def apart(facets: Ints, at: Ints) -> Bools:
        return np.asarray((triangles[facets] != vertices[at, None]).all(axis=1))

    corners = fine.rest_positions[triangles]
    return first_hits(starts, rays, heights, corners, least=_TOUCHING * size, apart=apart, most=_MOST_PAIRS)


def _peaks(carried: CarriedPatch, clips: Sequence[ClipActivity]) -> tuple[Floats, Floats]:
    """(vertices,) greatest moves of each vertex of a tool outwards, and inwards, scene units."""
    patch, curve = carried.patch, carried.patch.curve
    shapes = carried.shapes()
    moved = [np.zeros(len(carried.us))]
    if not clips:
        moved.append(np.einsum("gm,gmv->v", curve.greatest_amplitudes, shapes) * carried.magnitudes)
    for each in clips:
        amplitudes = each.seen.amplitudes
        tallest = curve.heights(amplitudes).argmax(axis=0)
        rows = np.stack([amplitudes[tallest[bumps[0]], k] for k, bumps in enumerate(curve.groups)])
        moved.append(patch.clip_strength(each.clip) * np.einsum("gm,gmv->v", rows, shapes) * carried.magnitudes)
    return np.max(moved, axis=0), -np.min(moved, axis=0)
