"""Morph weights over time: sampled where wrinkles need it, joined with the channels that a clip already has.

Source: glTF 2.0 §3.11 and appendix C. A weights channel drives all targets of a mesh or none, so an existing
channel is widened: it keeps its own keys and interpolation where that loses nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrinklecli.errors import BakeError
from wrinklecli.pose import Channel, Clip, Rig, morph_weights, sample

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

# How often an interval between two keys may be halved for the heights to be right between them. Where a wrinkle
# starts, each halving takes only a factor of 1.4 from the error: five times left 1.2 % of the tallest wrinkle, ten
# times, on a grid of 10 frames per second, 1.1 %.
_BISECTIONS = 16
# Of one clip: almost two hours at 30 a second.
_MOST_FRAMES = 200_000
# Intervals looked into at once: bounds the memory.
_CHUNK = 512
# Where an interval is looked into, as shares of it.
_INNER = np.arange(1, 8) / 8.0
# Points of an interval from its start on, as far apart as those.
_PER_INTERVAL = len(_INNER) + 1
# Intervals that `thin_times` looks ahead at first; twice as many each time that it may look further.
_AHEAD = 4


def sample_times(clip: Clip, rig: Rig, signal: Callable[[Floats], Floats], *, fps: float, tolerance: float) -> Floats:
    """Times of a clip so close that straight lines between them are right.

    Args:
        clip: The animation.
        rig: What it moves; the keys of its channels are among the times.
        signal: (frames,) seconds to (frames, values), in scene units.
        fps: Frames per second of the grid.
        tolerance: Greatest error of a value between two times, scene units. Heights start like a square root,
            so an interval is halved, up to 16 times, until seven points inside it are that good.

    Returns:
        (frames,) seconds, rising, each a float32 value.
    """
    times = clip_grid(clip, rig, fps=fps)
    values = signal(times)
    starts = np.arange(len(times) - 1)
    for _ in range(_BISECTIONS):
        error = np.zeros(len(starts))
        for part in (slice(k, k + _CHUNK) for k in range(0, len(starts), _CHUNK)):
            here = starts[part]
            inner = times[here, None] + _INNER * (times[here + 1] - times[here])[:, None]
            wanted = signal(inner.reshape(-1)).reshape(len(here), len(_INNER), -1)
            first, last = values[here, None], values[here + 1, None]
            error[part] = np.abs(first + _INNER[:, None] * (last - first) - wanted).max(axis=(1, 2), initial=0.0)
        low, high = times[starts], times[starts + 1]
        middles = _stored((low + high) / 2.0)
        fresh = middles[(error > tolerance) & (middles > low) & (middles < high)]
        if not len(fresh):
            break
        order = np.argsort(np.concatenate([times, fresh]), kind="stable")
        times = np.concatenate([times, fresh])[order]
        values = np.concatenate([values, signal(fresh)])[order]
        places = np.searchsorted(times, fresh)
        starts = np.sort(np.concatenate([places - 1, places]))
    return times


def thin_times(times: Floats, signal: Callable[[Floats], Floats], *, tolerance: float) -> Ints:
    """Which of a clip's times to key: those that straight lines between them need.

    From each key on, the next is the furthest time to which a straight line passes all values in between within
    the tolerance: at the times and at seven points between each two. Slopes that do so are an interval for each
    value, which only shrinks on the way, so each point is looked at about twice.

    Args:
        times: (frames,) seconds, rising, as `sample_times` made them.
        signal: (frames,) seconds to (frames, values), in scene units.
        tolerance: Greatest error of a value at seven points between two keys, scene units; exceeded only
            between two neighbouring times that exceed it already.

    Returns:
        (keys,) into the times, the first and the last among them.

    Source: K. Williams, *An efficient algorithm for the piecewise linear approximation of planar curves*, 1978.
    Differs: all values share their keys, and the result is checked once more between these.
    """
    last = len(times) - 1
    if last < 1:
        return np.arange(len(times))
    within = np.arange(_PER_INTERVAL) / _PER_INTERVAL
    points = np.append((times[:-1, None] + within * np.diff(times)[:, None]).reshape(-1), times[-1])
    values = signal(points)
    reached = [0]
    while reached[-1] < last:
        reached.append(_furthest(points, values, reached[-1], tolerance))
    keys = np.array(reached)
    while True:
        low, high = times[keys[:-1]], times[keys[1:]]
        inner = (low[:, None] + _INNER * (high - low)[:, None]).reshape(-1)
        wanted = signal(inner).reshape(len(low), len(_INNER), -1)
        error = np.abs(_lines(values[_PER_INTERVAL * keys]) - wanted).max(axis=(1, 2), initial=0.0)
        wide = (error > tolerance) & (np.diff(keys) > 1)
        if not wide.any():
            return keys
        keys = np.union1d(keys, (keys[:-1] + keys[1:])[wide] // 2)


def _furthest(points: Floats, values: Floats, start: int, tolerance: float) -> int:
    """The furthest time that a straight line from a time reaches within the tolerance; the next at least."""
    here = _PER_INTERVAL * start
    low, high = np.full(values.shape[1], -np.inf), np.full(values.shape[1], np.inf)
    furthest, begin, width = start + 1, here + 1, _AHEAD * _PER_INTERVAL
    while begin < len(points):
        after = np.arange(begin, min(begin + width, len(points)))
        elapsed = (points[after] - points[here])[:, None]
        slopes, slack = (values[after] - values[here]) / elapsed, tolerance / elapsed
        lowest = np.maximum(np.maximum.accumulate(slopes - slack, axis=0), low)
        highest = np.minimum(np.minimum.accumulate(slopes + slack, axis=0), high)
        passes = ((lowest <= slopes) & (slopes <= highest)).all(axis=1)
        ends = after[passes & (after % _PER_INTERVAL == 0)]
        furthest = max([furthest, *(ends[-1:] // _PER_INTERVAL).tolist()])
        low, high = lowest[-1], highest[-1]
        if (low > high).any():
            break
        begin, width = begin + width, 2 * width
    return furthest


def _lines(values: Floats) -> Floats:
    """(intervals, 7, values) inside the straight lines between (keys, values)."""
    first, last = values[:-1, None], values[1:, None]
    lines: Floats = first + _INNER[:, None] * (last - first)
    return lines


def clip_grid(clip: Clip, rig: Rig | None, *, fps: float) -> Floats:
    """(frames,) seconds, float32 values: a grid over the clip with its end, and the keys that move a rig.

    Jumps of STEP channels count twice, with the last float32 time before each.

    Raises:
        BakeError: It would have more than 200,000 frames.
    """
    if (clip.end - clip.start) * fps > _MOST_FRAMES:
        raise BakeError(
            f"lasts {clip.end - clip.start:.6g} s, at {fps:.6g} frames per second more than {_MOST_FRAMES:,} frames",
            where=clip.name,
        )
    count = int(np.floor((clip.end - clip.start) * fps * (1.0 + 1e-9)))
    grid: list[Floats] = [clip.start + np.arange(count + 1) / fps, np.array([clip.end])]
    if rig is not None:
        moving = moving_nodes(rig)
        for channel in clip.channels:
            if channel.node in moving:
                grid.append(channel.times)
                if channel.interpolation == "STEP":
                    grid.append(_just_before(channel.times[1:]))
    return np.unique(_stored(np.concatenate(grid)))


def _just_before(times: Floats) -> Floats:
    """The last float32 times before some, when a STEP channel has not jumped yet."""
    return np.nextafter(times.astype(np.float32), np.float32(-np.inf)).astype(np.float64)


def moving_nodes(rig: Rig) -> frozenset[int]:
    """The nodes whose channels can move a mesh: its joints with their ancestors, and the node itself."""
    nodes: set[int] = {rig.node}
    for joint in rig.joints:
        node = int(joint)
        while node >= 0 and node not in nodes:
            nodes.add(node)
            node = int(rig.parents[node])
    return frozenset(nodes)


def _stored(times: Floats) -> Floats:
    return times.astype(np.float32).astype(np.float64)


@dataclass(frozen=True, slots=True)
class Track:
    """A weights channel to write.

    Attributes:
        times: (keys,) seconds, float32 values.
        values: (keys, targets), or (keys, 3, targets) for CUBICSPLINE.
        interpolation: LINEAR, STEP or CUBICSPLINE.
    """

    times: Floats
    values: Floats
    interpolation: str


def widen(channel: Channel | None, rig: Rig, clip: Clip, times: Floats, weights: Floats) -> Track:
    """Join the weights of new targets with what a clip does to a mesh's old ones.

    Args:
        channel: The clip's weights channel of the mesh's node, if it has one.
        rig: Of the mesh.
        clip: The animation.
        times: (frames,) of the new weights, seconds.
        weights: (frames, new targets).

    Returns:
        A channel over old and new targets. LINEAR keeps its values at the union of key times. STEP becomes
        LINEAR with an extra key one float32 step before each jump. CUBICSPLINE stays: its pieces are split
        where new keys fall, by Hermite subdivision; new weights get the secants' tangents.
    """
    if channel is None:
        old = morph_weights(rig, None, times)
        return Track(times, np.concatenate([old, weights], axis=1), "LINEAR")
    if channel.interpolation == "CUBICSPLINE":
        return _widen_spline(channel, times, weights)
    union = np.union1d(times, channel.times)
    if channel.interpolation == "STEP":
        before = _just_before(channel.times[1:])
        union = np.union1d(union, before[before > channel.times[:-1]])
    old = morph_weights(rig, clip, union)
    return Track(union, np.concatenate([old, _interpolated(union, times, weights)], axis=1), "LINEAR")


def pad(channel: Channel, added: Floats) -> Track:
    """A clip's weights channel with constant weights for new targets, (new targets,) each; its keys are kept."""
    values = channel.values
    constant = np.broadcast_to(added, (*values.shape[:-1], len(added))).copy()
    if channel.interpolation == "CUBICSPLINE":
        constant[:, [0, 2]] = 0.0
    return Track(channel.times, np.concatenate([values, constant], axis=-1), channel.interpolation)


def _interpolated(at: Floats, times: Floats, weights: Floats) -> Floats:
    """(keys, targets) of weights linear between times."""
    columns = [np.interp(at, times, column) for column in weights.T]
    return np.stack(columns, axis=1) if columns else np.zeros((len(at), 0))


def _widen_spline(channel: Channel, times: Floats, weights: Floats) -> Track:
    union = np.union1d(times, channel.times)
    values = sample(channel, union)
    into, out = _spline_slopes(channel, union)
    fresh = _interpolated(union, times, weights)
    slopes = np.diff(fresh, axis=0) / np.diff(union)[:, None] if len(union) > 1 else np.zeros((0, fresh.shape[1]))
    edge = np.zeros((1, fresh.shape[1]))
    # With the secants of both sides as tangents a Hermite piece is its own straight line.
    fresh_into, fresh_out = np.concatenate([edge, slopes]), np.concatenate([slopes, edge])
    stacked = [np.concatenate(pair, axis=1) for pair in ((into, fresh_into), (values, fresh), (out, fresh_out))]
    return Track(union, np.stack(stacked, axis=1), "CUBICSPLINE")


def _spline_slopes(channel: Channel, at: Floats) -> tuple[Floats, Floats]:
    """(keys, targets) derivatives per second of a CUBICSPLINE channel before and after each time."""
    keys, values = channel.times, channel.values
    slopes = []
    for side in ("left", "right"):
        if len(keys) == 1:
            slopes.append(np.zeros((len(at), values.shape[2])))
            continue
        piece = np.searchsorted(keys, at, side="left" if side == "left" else "right") - 1
        outside = (piece < 0) | (piece > len(keys) - 2)
        piece = np.clip(piece, 0, len(keys) - 2)
        span = (keys[piece + 1] - keys[piece])[:, None]
        t = (at - keys[piece])[:, None] / span
        change = values[piece + 1, 1] - values[piece, 1]
        slope = (
            6.0 * (t - t * t) * change / span
            + (1.0 - 4.0 * t + 3.0 * t * t) * values[piece, 2]
            + (3.0 * t * t - 2.0 * t) * values[piece + 1, 0]
        )
        slopes.append(np.where(outside[:, None], 0.0, slope))
    return slopes[0], slopes[1]
