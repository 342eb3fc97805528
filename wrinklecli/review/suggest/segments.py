"""Segments across regions: trails over the surface to either side, and the ends between which poses lose most."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.numeric.nearest import balls
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.regions import Region
from wrinklecli.surface.rest import Rest

# Steps of a trail from the region's centre, and how far they go together, as a multiple of the region's length.
_STEPS = 30
_REACH = 2.0
# Angles of the directions that are tried, from that of the region's loss, radians.
_TURNS = np.radians([0.0, -8.0, 8.0, -16.0, 16.0, -24.0, 24.0])
# A segment ends where the loss falls under this part of its peak: beyond, flesh bulges and does not fold. The peak
# counts as this at most, so that a crease of a single edge leaves room for wrinkles.
_END_LOSS, _HIGHEST_PEAK = 0.5, 0.6
# Loss below which the middle between two halves of a region is still.
_STILL = 0.05
# How far an end is from the peak at most, as a part of the region's length.
_FURTHEST = 0.8
# A segment that shortens by more is all within a crease, where nobody sees its wrinkles, and its ends pass each other:
# it may be longer, by this factor.
_MOST_SHORTENING, _LONGER = 0.75, 2.0
# What a span is worth: its shortening times the span to this power. 1 would prefer ever longer segments over a bend,
# 0 ever shorter ones within the fold.
_SPAN_POWER = 0.3
# Least length of a segment, as a part of the region's, and of the way over the surface: a shorter one spans a fold or
# a gap at rest.
_SHORTEST, _STRAIGHT = 0.5, 0.75
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
    triangles = surface_around(mesh, region)
    if not len(triangles):
        return None
    across = np.cross(region.normal, region.along)
    # What is its own mirror image stays so.
    turns = _TURNS[:1] if region.on_plane else _TURNS
    directions = np.cos(turns)[:, None] * region.along + np.sin(turns)[:, None] * across
    step = _REACH * region.length / _STEPS
    trails = _walk(mesh.rest, triangles, region.centre, np.concatenate([-directions, directions]), step)
    best, ends = -np.inf if region.on_plane else 0.0, None
    smoothing = max(1, round(mesh.sites.radius / step))
    for turn, first, second in zip(turns, trails[: len(turns)], trails[len(turns) :], strict=True):
        line = _joined(first, second)
        moved = [line.moved(now[triangles[line.triangles]]) for now in poses]
        found = _ends(line, len(first.places) - 1, moved, region, smoothing)
        if found is None:
            continue
        low, high = found
        span = _span(line.places, low, high)
        # A turn must be worth its while.
        shortest = min(_span(now, low, high) for now in moved)
        gain = (1.0 - shortest / span) * span**_SPAN_POWER * float(np.cos(2.0 * turn))
        if gain > best * (1.0 + 1e-9):
            best, ends = gain, (line.places[low], line.places[high])
    return ends


def _joined(first: _Trail, second: _Trail) -> _Trail:
    """One trail from the end of a first over the centre to the end of a second."""
    columns = [
        np.concatenate([here[:0:-1], there])
        for here, there in (
            (first.triangles, second.triangles),
            (first.barycentrics, second.barycentrics),
            (first.places, second.places),
            (first.normals, second.normals),
        )
    ]
    return _Trail(*columns)


def _ends(line: _Trail, centre: int, moved: Sequence[Floats], region: Region, smoothing: int) -> tuple[int, int] | None:
    """Between which points of a trail the loss is at least half of its peak; none where no segment fits there.

    Args:
        line: Over the region.
        centre: Which point of it the region's centre is.
        moved: (points, 3) of each pose.
        region: Under it.
        smoothing: Steps to either side over which the loss is a mean.
    """
    if len(line.places) < 3:
        return None
    steps = np.sqrt(np.sum(np.diff(line.places, axis=0) ** 2, axis=1))
    losses = np.max([_losses(steps, now, smoothing) for now in moved], axis=0)
    travelled = np.append(0.0, np.cumsum(steps))
    about = np.abs((travelled[1:] + travelled[:-1]) / 2.0 - travelled[centre]) <= region.length / 2.0
    about[min(centre, len(steps) - 1)] = True
    peak = int(np.where(about, losses, -np.inf).argmax())
    if region.on_plane and losses[peak] < _STILL:
        # Between two halves that move, as between brows: as far as those.
        within = np.flatnonzero(np.abs(travelled - travelled[centre]) <= region.length / 2.0)
        return (int(within[0]), int(within[-1])) if len(within) > 1 else None
    level = _END_LOSS * min(float(losses[peak]), _HIGHEST_PEAK)
    low, high = peak, peak + 1
    # Along a row of knuckles the loss nowhere falls so far.
    furthest = np.abs(travelled - (travelled[peak] + travelled[peak + 1]) / 2.0) <= _FURTHEST * region.length
    while low > 0 and losses[low - 1] >= level and furthest[low - 1]:
        low -= 1
    while high < len(steps) and losses[high] >= level and furthest[min(high + 1, len(steps))]:
        high += 1
    shortest = _SHORTEST * region.length
    longest = (_LONGER - 1e-6) * float(travelled[high] - travelled[low])
    while True:
        span = _span(line.places, low, high)
        reduced = min(_span(now, low, high) for now in moved) < (1.0 - _MOST_SHORTENING) * span
        wanted = span < shortest or (reduced and travelled[high] - travelled[low] < longest)
        if not wanted or (low == 0 and high == len(steps)):
            break
        low, high = max(low - 1, 0), min(high + 1, len(steps))
    if region.on_plane and abs(region.along[0]) > 0.5:
        # Its own mirror image: as far to one side as to the other.
        reach = min(max(centre - low, high - centre), centre, len(steps) - centre)
        low, high = centre - reach, centre + reach
    while not _fits(line, low, high, float(travelled[high] - travelled[low])):
        if _span(line.places, low, high) < shortest or high - low < 3:
            return None
        low, high = low + 1, high - 1
    return low, high


def _losses(steps: Floats, now: Floats, smoothing: int) -> Floats:
    """(steps,) the part of its length that each step of a trail loses in a pose, as a mean over some around it."""
    lengths = np.sqrt(np.sum(np.diff(now, axis=0) ** 2, axis=1))
    lost = np.append(0.0, np.cumsum(steps - lengths))
    travelled = np.append(0.0, np.cumsum(steps))
    low = np.maximum(np.arange(len(steps)) - smoothing, 0)
    high = np.minimum(np.arange(len(steps)) + smoothing + 1, len(steps))
    losses: Floats = (lost[high] - lost[low]) / np.maximum(travelled[high] - travelled[low], 1e-300)
    return losses


def _fits(line: _Trail, low: int, high: int, travelled: float) -> bool:
    """Whether a segment from one point of a trail to another lies on the surface and faces what its ends face."""
    between = line.places[high] - line.places[low]
    span = float(np.sqrt(between @ between))
    if not span > 0 or span < _STRAIGHT * travelled:
        return False
    ends = line.normals[[low, high]]
    mean = ends.sum(axis=0)
    mean = unit(mean - (mean @ between) / span**2 * between)
    return bool((ends @ mean).min() > _END_FACING)


def _span(places: Floats, low: int, high: int) -> float:
    """The distance of two of some places."""
    return float(np.sqrt(np.sum((places[high] - places[low]) ** 2)))


def surface_around(mesh: MeasuredMesh, region: Region) -> Ints:
    """(triangles, 3) those of a region's piece within reach of a segment that look its way."""
    gauge = mesh.gauge
    distances = np.sqrt(np.sum((gauge.middles - region.centre) ** 2, axis=1))
    piece = mesh.sites.pieces[region.members[region.weights.argmax()]]
    close = gauge.triangles[(distances < 1.5 * _REACH * region.length + gauge.radii) & (gauge.pieces == piece)]
    found: Ints = close[mesh.rest.normals[close].sum(axis=1) @ region.normal > -0.5]
    return found


def _walk(rest: Rest, triangles: Ints, centre: Floats, directions: Floats, step: float) -> list[_Trail]:
    """Walk over a surface, from the point nearest to a centre straight on in some directions as far as it goes."""
    from scipy.spatial import cKDTree

    corners = rest.positions[triangles]
    middles, radii = balls(corners)
    radius, tree = float(radii.max()), cKDTree(middles)
    count = len(directions)
    first, shares = nearest_points(centre[None], corners)
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
            which, shares = nearest_points(ahead, corners[close])
            found = close[which]
    columns = [np.stack(column, axis=1) for column in zip(*steps, strict=True)]
    # At a border the nearest point stays behind.
    strides = np.sqrt(np.sum(np.diff(columns[2], axis=1) ** 2, axis=2))
    lengths = 1 + np.cumprod(strides > 0.4 * step, axis=1).sum(axis=1)
    return [_Trail(*(column[k, : lengths[k]] for column in columns)) for k in range(count)]


def nearest_points(points: Floats, corners: Floats) -> tuple[Ints, Floats]:
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
