"""Segments and traces: where a straight tool goes across a compressed region, and where one with a path goes.

A segment ends where poses compress the surface less. Wrinkles run across the direction in which skin is compressed
most. Around a corner of the eye or a joint that direction turns from place to place, a straight tool would cross it
askew, and a trace follows it.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, Ints, interpolated, unit
from wrinklecli.numeric.closest import Tree
from wrinklecli.surface.compression import CompressedRegion
from wrinklecli.surface.rest import Rest
from wrinklecli.surface.sites import Sites
from wrinklecli.surface.strain import principal

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Steps of a straight walk from the region's centre.
_WALK_STEPS = 30
# Length of a walk over the region's length.
_REACH = 2.0
# Greatest distance of the triangles that count over the region's length.
_AROUND = 1.5 * _REACH
# A step that advances less than this part of its length is at a border.
_BORDER = 0.4
# Angles between the directions that are tried and the region's direction of loss, radians.
_TURNS = np.radians(8.0 * np.array(sorted(range(-3, 4), key=abs)))
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
# Least cosine of the normals of a triangle and of the region; other triangles are on the far side of a limb.
_TRIANGLE_FACING = -0.5
# Steps of a trace to either side of its middle.
_TRACE_STEPS = 24
# Part of the greatest loss below which compression has no clear direction: a trace goes straight on there.
_CLEAR_LOSS = 0.3
# Degrees that a trace turns for each of its pieces; one that turns by less is as good as straight.
_TURN = 35.0
# Most pieces of a trace.
_MOST_PIECES = 6
# Sites from which the compression at a place is interpolated.
_NEIGHBOURS = 6
# Least cosine of the normals of a site and of the region, likewise.
_SITE_FACING = -0.3


def find_segment(
    sites: Sites, region: CompressedRegion, poses: Sequence[Floats], *, longest: float = np.inf
) -> tuple[Floats, Floats] | None:
    """Find the segment across a region that poses shorten best.

    Args:
        sites: Points of the surface.
        region: The region.
        poses: Each (vertices, 3) without animated scale.
        longest: Greatest length of the segment over the surface, scene units.

    Returns:
        (3,) ends on the surface; None if no segment fits.
    """
    triangles = _surface_around(sites, region)
    if not len(triangles):
        return None
    across = np.cross(region.normal, region.along)
    # A region that is its own mirror image gets a segment that is.
    turns = _TURNS[:1] if region.on_plane else _TURNS
    directions = np.cos(turns)[:, None] * region.along + np.sin(turns)[:, None] * across
    step = _REACH * region.length / _WALK_STEPS
    directions = np.concatenate([-directions, directions])
    walks = _walk(sites.gauge.rest, triangles, poses, region.centre, directions, step)
    best, ends = -np.inf if region.on_plane else 0.0, None
    smoothing = max(1, round(sites.radius / step))
    for turn, backward, forward in zip(turns, walks[: len(turns)], walks[len(turns) :], strict=True):
        line = np.concatenate([backward[:0:-1], forward])
        found = _ends(line, len(backward) - 1, region, smoothing, longest)
        if found is None:
            continue
        low, high = found
        span, *spans = _spans(line, low, high)
        shortest = min(spans)
        # Turned segments must be clearly better.
        gain = (1.0 - shortest / span) * span**_SPAN_POWER * float(np.cos(2.0 * turn))
        if gain > best * (1.0 + 1e-9):
            best, ends = gain, (line[low, 1], line[high, 1])
    return ends


def _ends(
    line: Floats, centre: int, region: CompressedRegion, smoothing: int, longest: float
) -> tuple[int, int] | None:
    """Find two points of a line across a region between which the loss is at least half of its peak.

    Args:
        line: (points, 2 + poses, 3) as `_walk` finds.
        centre: Number of the point at the region's centre.
        region: The region.
        smoothing: Steps to either side over which the loss is averaged.
        longest: Greatest distance of the points along the line, scene units.

    Returns:
        Numbers of the points; None if no segment fits.
    """
    if len(line) < 3:
        return None
    steps, *moved_steps = np.sqrt(np.sum(np.diff(line[:, 1:], axis=0) ** 2, axis=2)).T
    losses = np.max([_losses(steps, moved, smoothing) for moved in moved_steps], axis=0)
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
    furthest = min(_FURTHEST * region.length, longest / 2.0)
    close = np.abs(travelled - (travelled[peak] + travelled[peak + 1]) / 2.0) <= furthest
    while low > 0 and losses[low - 1] >= level and close[low - 1]:
        low -= 1
    while high < len(steps) and losses[high] >= level and close[min(high + 1, len(steps))]:
        high += 1
    shortest = _SHORTEST * region.length
    low, high = _grown(line, low, high, travelled, shortest, longest)
    if region.on_plane and abs(region.along[0]) > 0.5:
        # Both ends are equally far from the plane x = 0.
        reach = min(max(centre - low, high - centre), centre, len(steps) - centre)
        low, high = centre - reach, centre + reach
    while not _fits(line, low, high, float(travelled[high] - travelled[low])):
        if _spans(line, low, high)[0] < shortest or high - low < 3:
            return None
        low, high = low + 1, high - 1
    return low, high


def _grown(line: Floats, low: int, high: int, travelled: Floats, shortest: float, longest: float) -> tuple[int, int]:
    """Move two ends apart while the segment is shorter than the shortest, or within a crease."""
    longest = min(longest, (_LONGER - 1e-6) * float(travelled[high] - travelled[low]))
    last = len(line) - 1
    while low > 0 or high < last:
        span, *spans = _spans(line, low, high)
        creased = min(spans) < (1.0 - _MOST_SHORTENING) * span
        if span >= shortest and not (creased and travelled[high] - travelled[low] < longest):
            break
        low, high = max(low - 1, 0), min(high + 1, last)
    return low, high


def _losses(steps: Floats, moved: Floats, smoothing: int) -> Floats:
    """(steps,) part of their lengths that (steps,) lose in a pose, averaged over neighbouring steps."""
    lost = np.append(0.0, np.cumsum(steps - moved))
    travelled = np.append(0.0, np.cumsum(steps))
    low = np.maximum(np.arange(len(steps)) - smoothing, 0)
    high = np.minimum(np.arange(len(steps)) + smoothing + 1, len(steps))
    return np.asarray((lost[high] - lost[low]) / np.maximum(travelled[high] - travelled[low], TINY))


def _fits(line: Floats, low: int, high: int, travelled: float) -> bool:
    """True if a segment between two points of a line lies on the surface and faces the same way as its ends."""
    between = line[high, 1] - line[low, 1]
    span = float(np.sqrt(between @ between))
    if not span > 0 or span < _STRAIGHT * travelled:
        return False
    ends = line[[low, high], 0]
    mean = ends.sum(axis=0)
    mean = unit(mean - (mean @ between) / span**2 * between)
    return bool((ends @ mean).min() > _END_FACING)


def _spans(line: Floats, low: int, high: int) -> list[float]:
    """The distances of two points of a line, at rest and in each pose."""
    spans: list[float] = np.sqrt(np.sum((line[high, 1:] - line[low, 1:]) ** 2, axis=1)).tolist()
    return spans


def _surface_around(sites: Sites, region: CompressedRegion) -> Ints:
    """(triangles, 3) of the region's piece, within reach of a segment, that face the same way as the region."""
    gauge = sites.gauge
    distances = np.sqrt(np.sum((gauge.middles - region.centre) ** 2, axis=1))
    piece = sites.pieces[region.members[region.weights.argmax()]]
    close = gauge.triangles[(distances < _AROUND * region.length + gauge.radii) & (gauge.pieces == piece)]
    return np.asarray(close[gauge.rest.normals[close].sum(axis=1) @ region.normal > _TRIANGLE_FACING])


def _walk(
    rest: Rest, triangles: Ints, poses: Sequence[Floats], centre: Floats, directions: Floats, step: float
) -> list[Floats]:
    """Walk straight over a surface in each direction, from the point nearest to the centre to a border at most.

    Returns:
        (points, 2 + poses, 3) for each direction: unit normals, positions at rest, positions in each pose.
    """
    tree = Tree.of(rest.positions, triangles)
    found, barycentrics, _ = tree.closest_points(np.tile(centre, (len(directions), 1)))
    points = []
    for _ in range(_WALK_STEPS + 1):
        every = (rest.normals, rest.positions, *poses)
        normals, places, *moved = (np.einsum("pk,pkc->pc", barycentrics, each[triangles[found]]) for each in every)
        normals = unit(normals)
        points.append(np.stack([normals, places, *moved], axis=1))
        directions = unit(directions - np.sum(directions * normals, axis=1)[:, None] * normals)
        found, barycentrics, _ = tree.closest_points(places + step * directions)
    lines = np.stack(points, axis=1)
    # At a border the nearest point stays behind.
    advances = np.sqrt(np.sum(np.diff(lines[:, :, 1], axis=1) ** 2, axis=2))
    counts = 1 + np.cumprod(advances > _BORDER * step, axis=1).sum(axis=1)
    return [line[:count] for line, count in zip(lines, counts, strict=True)]


def trace(sites: Sites, region: CompressedRegion, tensors: Floats, lengths: tuple[float, float]) -> Floats | None:
    """Trace the strongest compression of a pose through the middle of a region.

    Args:
        sites: Points of the surface.
        region: A region of the sites.
        tensors: (sites, 6) loss tensors of the pose.
        lengths: Greatest lengths against the region's direction and along it, scene units.

    Returns:
        (points, 3) evenly spaced points on the surface, three or more; None if it hardly turns, or the surface ends.
    """
    triangles = _surface_around(sites, region)
    if not len(triangles):
        return None
    field = _Field.of(sites, region, tensors, triangles)
    backward, forward = (
        field.walk(region.centre, sign * region.along, length)
        for sign, length in zip((-1.0, 1.0), lengths, strict=True)
    )
    line = np.concatenate([backward[:0:-1], forward])
    if len(line) < 3:
        return None
    steps = unit(np.diff(_resampled(line, _TRACE_STEPS // 3), axis=0))
    turned = np.degrees(np.arccos(np.clip(np.sum(steps[1:] * steps[:-1], axis=1), -1.0, 1.0))).sum()
    return _resampled(line, min(2 + int(turned / _TURN), _MOST_PIECES)) if turned > _TURN else None


def _resampled(line: Floats, pieces: int) -> Floats:
    """(pieces + 1, 3) evenly spaced points of a polyline."""
    ways = np.append(0.0, np.cumsum(np.sqrt(np.sum(np.diff(line, axis=0) ** 2, axis=1))))
    return interpolated(np.linspace(0.0, ways[-1], pieces + 1), ways, line)


@dataclass(frozen=True, slots=True)
class _Field:
    """The strongest compression over a part of a surface.

    Attributes:
        surface: Its triangles.
        normals: (vertices, 3) unit normals.
        tree: Positions of the sites of this part.
        tensors: (sites, 6) loss tensors there.
    """

    surface: Tree
    normals: Floats
    tree: "cKDTree"
    tensors: Floats

    @classmethod
    def of(cls, sites: Sites, region: CompressedRegion, tensors: Floats, triangles: Ints) -> "_Field":
        """The field over (triangles, 3) around a region, from (sites, 6) tensors of all sites."""
        from scipy.spatial import cKDTree

        rest = sites.gauge.rest
        piece = sites.pieces[region.members[region.weights.argmax()]]
        chosen = (sites.pieces == piece) & (sites.normals @ region.normal > _SITE_FACING)
        return cls(Tree.of(rest.positions, triangles), rest.normals, cKDTree(sites.positions[chosen]), tensors[chosen])

    def walk(self, start: Floats, along: Floats, length: float) -> Floats:
        """(points, 3) from near a (3,) start, at first in a (3,) direction, to the length or the surface's border."""
        line: list[Floats] = []
        ahead, step, peak = start, length / _TRACE_STEPS, 0.0
        ranks = list(range(1, min(_NEIGHBOURS, len(self.tensors)) + 1))
        for _ in range(_TRACE_STEPS + 1):
            (triangle,), (barycentrics,), (place,) = self.surface.closest_points(ahead[None])
            normal = unit(barycentrics @ self.normals[self.surface.triangles[triangle]])
            if line and np.linalg.norm(place - line[-1]) < _BORDER * step:
                break
            distances, near = (np.asarray(each) for each in self.tree.query(place, k=ranks))
            weights = 1.0 / (distances**2 + step**2)
            loss, direction = principal((weights @ self.tensors[near] / weights.sum())[None], normal[None])
            peak = max(peak, float(loss[0]))
            line.append(place)
            if loss[0] >= _CLEAR_LOSS * peak:
                along = direction[0] * (1.0 if direction[0] @ along >= 0 else -1.0)
            along = unit(along - (along @ normal) * normal)
            ahead = place + step * along
        return np.array(line).reshape(-1, 3)
