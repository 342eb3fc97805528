"""Segments across compressed regions: paths straight over the surface, and the ends between which poses lose most."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.numeric.nearest import balls, nearest_points
from wrinklecli.surface.compression import CompressedRegion
from wrinklecli.surface.rest import Rest
from wrinklecli.surface.sites import Sites

# Steps of a walk from the region's centre.
_STEPS = 30
# Length of a walk over the region's length.
_REACH = 2.0
# A step that advances less than this part of its length is at a border.
_BORDER = 0.4
# Angles between the directions that are tried and the region's direction of loss, radians.
_TURNS = np.radians([0.0, -8.0, 8.0, -16.0, 16.0, -24.0, 24.0])
# A segment ends where the loss falls below this part of its peak: beyond, flesh bulges and does not fold.
_END_LOSS = 0.5
# Greatest peak that counts, so that a crease of a single edge leaves room for wrinkles.
_HIGHEST_PEAK = 0.6
# Loss below which the middle between two halves of a region is at rest.
_AT_REST = 0.05
# Greatest distance of an end from the peak, as a part of the region's length.
_FURTHEST = 0.8
# A segment whose shortening exceeds this part is within a crease, where nobody sees its wrinkles, and its ends pass
# each other; ...
_MOST_SHORTENING = 0.75
# ... it may grow by this factor.
_LONGER = 2.0
# Exponent of the length when segments are compared. 1 would prefer ever longer segments over a bend, 0 ever shorter
# ones within the fold.
_SPAN_POWER = 0.3
# Least length of a segment, as a part of the region's ...
_SHORTEST = 0.5
# ... and of the way over the surface: a shorter segment spans a fold or a gap at rest.
_STRAIGHT = 0.75
# Least cosine of the normal at an end and of the patch between the ends: below 0.6 wrinkles fade.
_END_FACING = 0.45
# Least cosine of a triangle's normal and the region's; other triangles are on the far side of a limb.
_SAME_SIDE = -0.5


@dataclass(frozen=True, slots=True)
class _Walk:
    """Points one after another on a surface.

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
        """(points, 3) places for (points, 3, 3) moved corners of the triangles."""
        return np.asarray(np.einsum("pk,pkc->pc", self.barycentrics, corners))

    def joined(self, other: "_Walk") -> "_Walk":
        """From the end of this walk back to its start, which is also the other's, and to the end of the other."""
        columns = ("triangles", "barycentrics", "places", "normals")
        return _Walk(*(np.concatenate([getattr(self, each)[:0:-1], getattr(other, each)]) for each in columns))


def lay_segment(sites: Sites, region: CompressedRegion, poses: Sequence[Floats]) -> tuple[Floats, Floats] | None:
    """Find the segment across a region that poses shorten best.

    Args:
        sites: Points of the surface.
        region: A region of the sites.
        poses: (vertices, 3) each, without animated scale.

    Returns:
        (3,) ends on the surface; None if no segment fits.
    """
    rest, triangles = sites.gauge.rest, surface_around(sites, region)
    if not len(triangles):
        return None
    across = np.cross(region.normal, region.along)
    # A region that is its own mirror image gets a segment that is.
    turns = _TURNS[:1] if region.on_plane else _TURNS
    directions = np.cos(turns)[:, None] * region.along + np.sin(turns)[:, None] * across
    step = _REACH * region.length / _STEPS
    walks = _walk(rest, triangles, region.centre, np.concatenate([-directions, directions]), step)
    best, ends = -np.inf if region.on_plane else 0.0, None
    smoothing = max(1, round(sites.radius / step))
    for turn, backward, forward in zip(turns, walks[: len(turns)], walks[len(turns) :], strict=True):
        line = backward.joined(forward)
        moved = [line.moved(now[triangles[line.triangles]]) for now in poses]
        found = _ends(line, len(backward.places) - 1, moved, region, smoothing)
        if found is None:
            continue
        low, high = found
        span = _span(line.places, low, high)
        shortest = min(_span(now, low, high) for now in moved)
        # Turned segments must be clearly better.
        gain = (1.0 - shortest / span) * span**_SPAN_POWER * float(np.cos(2.0 * turn))
        if gain > best * (1.0 + 1e-9):
            best, ends = gain, (line.places[low], line.places[high])
    return ends


def _ends(
    line: _Walk, centre: int, moved: Sequence[Floats], region: CompressedRegion, smoothing: int
) -> tuple[int, int] | None:
    """Find two points of a line between which the loss is at least half of its peak.

    Args:
        line: Across the region.
        centre: Number of the point at the region's centre.
        moved: (points, 3) of each pose.
        region: The region.
        smoothing: Steps to either side over which the loss is averaged.

    Returns:
        Numbers of the points; None if no segment fits.
    """
    if len(line.places) < 3:
        return None
    steps = np.sqrt(np.sum(np.diff(line.places, axis=0) ** 2, axis=1))
    losses = np.max([_losses(steps, now, smoothing) for now in moved], axis=0)
    travelled = np.append(0.0, np.cumsum(steps))
    about = np.abs((travelled[1:] + travelled[:-1]) / 2.0 - travelled[centre]) <= region.length / 2.0
    about[min(centre, len(steps) - 1)] = True
    peak = int(np.where(about, losses, -np.inf).argmax())
    if region.on_plane and losses[peak] < _AT_REST:
        # Between two halves that move, such as brows, the segment is as long as they are.
        within = np.flatnonzero(np.abs(travelled - travelled[centre]) <= region.length / 2.0)
        return (int(within[0]), int(within[-1])) if len(within) > 1 else None
    level = _END_LOSS * min(float(losses[peak]), _HIGHEST_PEAK)
    low, high = peak, peak + 1
    # Along a row of knuckles the loss nowhere falls to the level.
    close = np.abs(travelled - (travelled[peak] + travelled[peak + 1]) / 2.0) <= _FURTHEST * region.length
    while low > 0 and losses[low - 1] >= level and close[low - 1]:
        low -= 1
    while high < len(steps) and losses[high] >= level and close[min(high + 1, len(steps))]:
        high += 1
    shortest = _SHORTEST * region.length
    longest = (_LONGER - 1e-6) * float(travelled[high] - travelled[low])
    while True:
        span = _span(line.places, low, high)
        creased = min(_span(now, low, high) for now in moved) < (1.0 - _MOST_SHORTENING) * span
        grows = span < shortest or (creased and travelled[high] - travelled[low] < longest)
        if not grows or (low == 0 and high == len(steps)):
            break
        low, high = max(low - 1, 0), min(high + 1, len(steps))
    if region.on_plane and abs(region.along[0]) > 0.5:
        # Both ends are equally far from the plane x = 0.
        reach = min(max(centre - low, high - centre), centre, len(steps) - centre)
        low, high = centre - reach, centre + reach
    while not _fits(line, low, high, float(travelled[high] - travelled[low])):
        if _span(line.places, low, high) < shortest or high - low < 3:
            return None
        low, high = low + 1, high - 1
    return low, high


def _losses(steps: Floats, now: Floats, smoothing: int) -> Floats:
    """(steps,) part of its length that each of (steps,) lengths loses in a pose, averaged over neighbouring steps."""
    lengths = np.sqrt(np.sum(np.diff(now, axis=0) ** 2, axis=1))
    lost = np.append(0.0, np.cumsum(steps - lengths))
    travelled = np.append(0.0, np.cumsum(steps))
    low = np.maximum(np.arange(len(steps)) - smoothing, 0)
    high = np.minimum(np.arange(len(steps)) + smoothing + 1, len(steps))
    losses: Floats = (lost[high] - lost[low]) / np.maximum(travelled[high] - travelled[low], 1e-300)
    return losses


def _fits(line: _Walk, low: int, high: int, travelled: float) -> bool:
    """True if a segment between two points of a line lies on the surface and faces the same way as its ends."""
    between = line.places[high] - line.places[low]
    span = float(np.sqrt(between @ between))
    if not span > 0 or span < _STRAIGHT * travelled:
        return False
    ends = line.normals[[low, high]]
    mean = ends.sum(axis=0)
    mean = unit(mean - (mean @ between) / span**2 * between)
    return bool((ends @ mean).min() > _END_FACING)


def _span(places: Floats, low: int, high: int) -> float:
    """The distance of two places."""
    return float(np.sqrt(np.sum((places[high] - places[low]) ** 2)))


def surface_around(sites: Sites, region: CompressedRegion) -> Ints:
    """(triangles, 3) of the region's piece, within reach of a segment, that face the same way as the region."""
    gauge = sites.gauge
    distances = np.sqrt(np.sum((gauge.middles - region.centre) ** 2, axis=1))
    piece = sites.pieces[region.members[region.weights.argmax()]]
    close = gauge.triangles[(distances < 1.5 * _REACH * region.length + gauge.radii) & (gauge.pieces == piece)]
    found: Ints = close[gauge.rest.normals[close].sum(axis=1) @ region.normal > _SAME_SIDE]
    return found


def _walk(rest: Rest, triangles: Ints, centre: Floats, directions: Floats, step: float) -> list[_Walk]:
    """Walk straight over a surface in each direction, from the point nearest to the centre to a border at most."""
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
            # The surface is no further away than the place that the step came from.
            close = np.unique(np.concatenate(tree.query_ball_point(ahead, 1.001 * step + radius)).astype(np.intp))
            which, shares = nearest_points(ahead, corners[close])
            found = close[which]
    columns = [np.stack(column, axis=1) for column in zip(*steps, strict=True)]
    # At a border the nearest point stays behind.
    advances = np.sqrt(np.sum(np.diff(columns[2], axis=1) ** 2, axis=2))
    lengths = 1 + np.cumprod(advances > _BORDER * step, axis=1).sum(axis=1)
    return [_Walk(*(column[k, : lengths[k]] for column in columns)) for k in range(count)]
