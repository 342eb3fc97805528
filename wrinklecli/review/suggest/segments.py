"""Segments across regions: trails over the surface to either side, and the ends between which poses lose most."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.method.rest import Rest
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.regions import Region

# Steps of a trail from the region's centre, and how far they go together, as a multiple of the region's length.
_STEPS = 30
_REACH = 2.6
# Angles of the directions that are tried, from that of the region's loss, radians.
_TURNS = np.radians([0.0, -8.0, 8.0, -16.0, 16.0, -24.0, 24.0])
# Spans that are tried, as multiples of the region's length: the loss at the ends must be small, and wrinkles need
# room ...
_SHORTEST, _LONGEST = 0.8, 5.0
# ... but at most this multiple of the region's width: further away begins another part of the body.
_LONGEST_OF_WIDTH = 2.5
# What a span is worth: its shortening times the span to this power. 1 would prefer ever longer segments over a bend,
# 0 ever shorter ones within the fold.
_SPAN_POWER = 0.3
# A segment that shortens by more is all within a fold, and so are its wrinkles: a longer one is worth more.
_BEST_SHORTENING = 0.55
# Least length of a segment, as a part of the way over the surface: a shorter one spans a fold or a gap at rest.
_STRAIGHT = 0.75
# Part of its worth that a segment loses where all of it lies on one side of the centre.
_ASIDE = 0.6
# Least cosine of the normal at an end with that of the patch between the ends: below 0.6 wrinkles fade.
_END_FACING = 0.45


@dataclass(frozen=True, slots=True)
class _Trail:
    """Points of a surface one after another, away from a centre, which is the first.

    Attributes:
        triangles: (points,)
        barycentrics: (points, 3)
        places: (points, 3)
        normals: (points, 3) unit.
    """

    triangles: Ints
    barycentrics: Floats
    places: Floats
    normals: Floats

    def moved(self, corners: Floats) -> Floats:
        """(points, 3) places where the corners (points, 3, 3) of their triangles are."""
        return np.asarray(np.einsum("pk,pkc->pc", self.barycentrics, corners))


def lay_segment(mesh: MeasuredMesh, region: Region, poses: Sequence[Floats]) -> tuple[Floats, Floats] | None:
    """The ends of the segment across a region that poses shorten best; none where there is none.

    Args:
        mesh: The mesh.
        region: On it.
        poses: (vertices, 3) each, animated scale taken out.
    """
    triangles = _around(mesh, region)
    if not len(triangles):
        return None
    across = np.cross(region.normal, region.along)
    # What is its own mirror image stays so.
    turns = _TURNS[:1] if region.on_plane else _TURNS
    directions = np.cos(turns)[:, None] * region.along + np.sin(turns)[:, None] * across
    step = _REACH * region.length / _STEPS
    trails = _walk(mesh.rest, triangles, region.centre, np.concatenate([-directions, directions]), step)
    best, ends = 0.0, None
    for turn, first, second in zip(turns, trails[: len(turns)], trails[len(turns) :], strict=True):
        distances = [
            _distances(*(trail.moved(now[triangles[trail.triangles]]) for trail in (first, second))) for now in poses
        ]
        # A turn must be worth its while.
        gains = _gains(region, first, second, np.min(distances, axis=0), step, np.cos(2.0 * turn))
        i, j = np.unravel_index(int(gains.argmax()), gains.shape)
        if gains[i, j] > best * (1.0 + 1e-9):
            best, ends = float(gains[i, j]), (first.places[i], second.places[j])
    return ends


def _gains(region: Region, first: _Trail, second: _Trail, shortest: Floats, step: float, share: float) -> Floats:
    """What segments between the points of two trails are worth; 0 where one does not fit.

    Args:
        region: Between them.
        first: Trail to one side.
        second: To the other.
        shortest: (points, points) least distance of two points in any pose.
        step: From one point to the next, scene units.
        share: Of its gain that a segment along these trails keeps.
    """
    longest = min(_LONGEST * region.length, max(_LONGEST_OF_WIDTH * region.width, region.length))
    spans = _distances(first.places, second.places)
    between = unit(second.places[None] - first.places[:, None])
    mean = first.normals[:, None] + second.normals[None]
    mean = unit(mean - np.sum(mean * between, axis=2, keepdims=True) * between)
    facing = np.minimum(np.sum(mean * first.normals[:, None], axis=2), np.sum(mean * second.normals[None], axis=2))
    walked = [np.arange(len(trail.places)) for trail in (first, second)]
    total = walked[0][:, None] + walked[1]
    fits = (spans >= _SHORTEST * region.length) & (spans <= longest) & (facing > _END_FACING)
    fits &= spans >= _STRAIGHT * step * total
    ratios = shortest / np.where(fits, spans, 1.0)
    gains = (1.0 - ratios) * np.minimum(ratios / (1.0 - _BEST_SHORTENING), 1.0) * spans**_SPAN_POWER
    # A middle beside the region's must be worth its while.
    aside = np.abs(walked[0][:, None] - walked[1]) / np.maximum(total, 1)
    return np.asarray(np.where(fits, gains, 0.0) * share * (1.0 - _ASIDE * aside))


def _distances(first: Floats, second: Floats) -> Floats:
    """(n, m) of (n, 3) and (m, 3) points."""
    return np.asarray(np.sqrt(np.sum((first[:, None] - second[None]) ** 2, axis=2)))


def _around(mesh: MeasuredMesh, region: Region) -> Ints:
    """(triangles, 3) those within reach of a segment that look its way."""
    gauge = mesh.gauge
    distances = np.sqrt(np.sum((gauge.middles - region.centre) ** 2, axis=1))
    close = gauge.triangles[distances < 1.5 * _REACH * region.length + gauge.radii]
    found: Ints = close[mesh.rest.normals[close].sum(axis=1) @ region.normal > -0.5]
    return found


def _walk(rest: Rest, triangles: Ints, centre: Floats, directions: Floats, step: float) -> list[_Trail]:
    """Walk over a surface, from the point nearest to a centre straight on in some directions as far as it goes."""
    from scipy.spatial import cKDTree

    corners = rest.positions[triangles]
    middles = corners.mean(axis=1)
    radius = float(np.sqrt(np.max(np.sum((corners - middles[:, None]) ** 2, axis=2))))
    tree = cKDTree(middles)
    count = len(directions)
    first, shares = _nearest_points(centre[None], corners)
    found, shares = np.repeat(first, count), np.repeat(shares, count, axis=0)
    steps = []
    for number in range(_STEPS + 1):
        places = np.einsum("pk,pkc->pc", shares, corners[found])
        normals = unit(np.einsum("pk,pkc->pc", shares, rest.normals[triangles[found]]))
        steps.append((found, shares, places, normals))
        if number < _STEPS:
            directions = unit(directions - np.sum(directions * normals, axis=1)[:, None] * normals)
            ahead = places + step * directions
            # The surface is no further than where the step came from.
            close = np.unique(np.concatenate(tree.query_ball_point(ahead, 1.001 * step + radius)).astype(np.intp))
            which, shares = _nearest_points(ahead, corners[close])
            found = close[which]
    columns = [np.stack(column, axis=1) for column in zip(*steps, strict=True)]
    # At a border the nearest point stays behind.
    strides = np.sqrt(np.sum(np.diff(columns[2], axis=1) ** 2, axis=2))
    lengths = 1 + np.cumprod(strides > 0.4 * step, axis=1).sum(axis=1)
    return [_Trail(*(column[k, : lengths[k]] for column in columns)) for k in range(count)]


def _nearest_points(points: Floats, corners: Floats) -> tuple[Ints, Floats]:
    """The points of triangles with area that are nearest to points.

    Args:
        points: (points, 3)
        corners: (triangles, 3, 3)

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
    # Squared distances, less that of the first corner where it is the same for all four.
    squared = vs**2 * aa + 2.0 * vs * ws * mixed + ws**2 * bb - 2.0 * (vs * first + ws * second)
    squared = squared + (np.sum(points**2, axis=1)[:, None] - 2.0 * points @ a.T + np.sum(a**2, axis=1))
    squared[0] = np.where(inside, squared[0], np.inf)
    which = squared.argmin(axis=0)
    triangle = squared.min(axis=0).argmin(axis=1)
    rows = np.arange(len(points))
    chosen = which[rows, triangle]
    v, w = vs[chosen, rows, triangle], ws[chosen, rows, triangle]
    return triangle, np.stack([1.0 - v - w, v, w], axis=1)
