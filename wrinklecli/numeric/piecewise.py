"""Fits straight lines between few keys to signals over time: bisects intervals that bend, then thins the keys."""

import math
from collections.abc import Callable

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, float32_values

# Intervals of the grid that are sampled and thinned at once, which bounds the memory, and times for which a signal is
# evaluated at once: they stay in a core's cache.
_STRETCH = 8192
# Most numbers of a stretch, which is shorter for a signal of many values, and of lines that are drawn at once.
_MOST_VALUES = 2**20
# Most intervals that a line passes while something moves. No line of the samples passes more than 50.
_LONGEST = 64
# Points inside an interval, as fractions of it, at which errors are measured. If a square root starts anywhere in the
# interval, its greatest error is at most 1.7 times the measured one; with seven points at equal steps 1.9 times.
_INNER_POINTS = np.array([0.2, 0.5, 0.8])
# Further points, for an interval whose error is almost too large.
_FURTHER_POINTS = np.array([0.3, 0.7])
# Fraction of the tolerance above which an error is almost too large.
_ALMOST = 0.75
# Points of an interval that are known when keys are chosen: its start and the points inside it.
_PER_INTERVAL = 1 + len(_INNER_POINTS)

# Maps (points,) seconds within a stretch to (points, values).
Signal = Callable[[Floats], Floats]


def key_times(
    grid: Floats,
    signal_on: Callable[[Floats], Signal],
    *,
    width: int = 1,
    tolerance: float,
    thinning: float,
    gap: float,
    step: float,
) -> tuple[Floats, Ints]:
    """Find times between which straight lines are exact enough, and the keys among them.

    The times start as a grid, such as a clip's frames and its own keys. Heights start like a square root, so an
    interval is divided until straight lines are right at three points inside it, and at two more if they are almost
    wrong. Each key is then the last time to which a straight line from the key before passes all times and points in
    between. A root that starts between such points may exceed the tolerance 1.7 times.

    Args:
        grid: (frames,) sorted seconds, float32 values, which all are among the times.
        signal_on: Maps a stretch of the grid, (frames,) seconds, to a signal that is valid within it.
        width: Number of values of the signal.
        tolerance: Greatest error of a value between two times.
        thinning: Greatest error between two keys; exceeded only between neighbouring times that exceed it already.
        gap: Seconds > 0. No interval is divided into parts that are shorter.
        step: Seconds. An interval is divided at the multiple of it that is nearest to its middle, if possible.

    Returns:
        (frames,) sorted seconds, float32 values, and (keys,) indices into them, the first and last among them.

    Source: K. Williams, *An efficient algorithm for the piecewise linear approximation of planar curves*, 1978.
    Differs: all values share their keys, and a line passes at most 64 intervals while something moves.
    """
    times, keys, count = [grid[:1]], [np.zeros(1, np.intp)], 0
    stretch = min(max(_MOST_VALUES // (_PER_INTERVAL * max(width, 1)), 1), _STRETCH)
    for start in range(0, len(grid) - 1, stretch):
        part = grid[start : start + stretch + 1]
        found, needed = key_points(part, signal_on(part), tolerance=tolerance, thinning=thinning, gap=gap, step=step)
        times.append(found[1:])
        keys.append(count + needed[1:])
        count += len(found) - 1
    return np.concatenate(times), np.concatenate(keys)


def key_points(
    grid: Floats, signal: Signal, *, tolerance: float, thinning: float, gap: float, step: float
) -> tuple[Floats, Ints]:
    """Find what `key_times` finds within (points,) sorted points of one stretch; a single point is the only key."""
    if len(grid) == 1:
        return grid, np.zeros(1, np.intp)
    points, values = _bisected(grid, signal, tolerance, gap, step)
    return points[::_PER_INTERVAL], _thinned(points, values, thinning)


def _bisected(grid: Floats, signal: Signal, tolerance: float, gap: float, step: float) -> tuple[Floats, Floats]:
    """(4 (times - 1) + 1,) the times with three points between each two, sorted, and (…, values) there."""
    at_grid = sampled(signal, grid)
    low, high, first, last = grid[:-1], grid[1:], at_grid[:-1], at_grid[1:]
    kept: list[tuple[Floats, Floats]] = []
    while len(low):
        inside = low[:, None] + _INNER_POINTS * (high - low)[:, None]
        # The middle may become a time, so it is a float32 value.
        snapped = float32_values(np.round(inside[:, 1] / step) * step)
        fits = np.minimum(snapped - low, high - snapped) >= gap
        middles = np.where(fits, snapped, float32_values(inside[:, 1]))
        divisible = np.minimum(middles - low, high - middles) >= gap
        inside[divisible, 1] = middles[divisible]
        values = sampled_inside(signal, inside)
        fractions = (inside - low[:, None]) / (high - low)[:, None]
        error = _farthest(first, last, fractions, values)
        doubtful = np.flatnonzero(divisible & (error > _ALMOST * tolerance) & (error <= tolerance))
        if len(doubtful):
            closer = sampled_inside(signal, low[doubtful, None] + _FURTHER_POINTS * (high - low)[doubtful, None])
            error[doubtful] = _farthest(first[doubtful], last[doubtful], _FURTHER_POINTS, closer)
        wide = divisible & (error > tolerance)
        points, at_points = np.column_stack([low, inside]), np.concatenate([first[:, None], values], axis=1)
        kept.append((points[~wide], at_points[~wide]))
        middles, at_middles = inside[wide, 1], values[wide, 1]
        low, high = np.concatenate([low[wide], middles]), np.concatenate([middles, high[wide]])
        first, last = np.concatenate([first[wide], at_middles]), np.concatenate([at_middles, last[wide]])
    points = np.concatenate([each for each, _ in kept])
    order = np.argsort(points[:, 0])
    # There may be gigabytes, so one part after another is copied to its place and dropped.
    together = np.zeros((points.size + 1, at_grid.shape[1]))
    together[-1] = at_grid[-1]
    by_interval = together[:-1].reshape(*points.shape, at_grid.shape[1])  # a signal may have no values
    for rows in np.split(np.argsort(order), np.cumsum([len(each) for each, _ in kept])[:-1]):
        by_interval[rows] = kept.pop(0)[1]
    return np.append(points[order], grid[-1]), together


def sampled(signal: Signal, times: Floats) -> Floats:
    """(times, values) of a signal, evaluated in chunks that stay in a core's cache."""
    return np.concatenate([signal(times[k : k + _STRETCH]) for k in range(0, len(times), _STRETCH)])


def sampled_inside(signal: Signal, times: Floats) -> Floats:
    """(intervals, points, values) of a signal at (intervals, points) times."""
    found = sampled(signal, times.reshape(-1))
    return found.reshape(*times.shape, found.shape[1])


def _farthest(first: Floats, last: Floats, fractions: Floats, values: Floats) -> Floats:
    """(intervals,) greatest distances of (intervals, fractions, values) from lines between (intervals, values) ends."""
    lines = fractions[..., None] * (last - first)[:, None]
    lines += first[:, None]
    lines -= values
    return greatest_of_rows(np.abs(lines, out=lines))


def greatest_of_rows(numbers: Floats) -> Floats:
    """(n,) the greatest number of each row of (n, …), or 0. `max` along short rows takes eight times as long."""
    columns = np.ascontiguousarray(numbers.reshape(len(numbers), math.prod(numbers.shape[1:])).T)
    return np.asarray(np.maximum.reduce(columns, axis=0, initial=0.0))


def _thinned(points: Floats, values: Floats, tolerance: float) -> Ints:
    """(keys,) the times that straight lines need, first and last among them, of points and values from `_bisected`."""
    count = len(points) // _PER_INTERVAL
    moving = (values[1:] != values[:-1]).any(axis=1).reshape(count, _PER_INTERVAL).any(axis=1)
    # A line ends where something begins or ceases to move. While nothing moves, one line lasts until then.
    changes = np.append(np.flatnonzero(np.diff(moving)) + 1, count)
    ends = changes[np.searchsorted(changes, np.arange(count), side="right")]
    starts = np.flatnonzero(moving)
    chunk = max(_MOST_VALUES // (_PER_INTERVAL * max(values.shape[1], 1)), 1)
    for some in (starts[k : k + chunk] for k in range(0, len(starts), chunk)):
        ends[some] = np.minimum(_reached(points, values, some, tolerance), ends[some])
    keys, furthest = [0], ends.tolist()
    while keys[-1] < count:
        keys.append(furthest[keys[-1]])
    return np.array(keys, np.intp)


def _reached(points: Floats, values: Floats, starts: Ints, tolerance: float) -> Ints:
    """(starts,) the last time to which a line from each start passes all (points, values) on the way, to a tolerance.

    The slopes that pass all points form a range for each value, which only shrinks on the way.
    """
    reached = starts + 1
    going = np.arange(len(starts))
    low = np.full((len(starts), values.shape[1]), -np.inf)
    high = -low
    for interval in range(_LONGEST):
        begin = _PER_INTERVAL * starts[going]
        after = begin[:, None] + np.arange(1, _PER_INTERVAL + 1) + _PER_INTERVAL * interval
        elapsed = (points[after] - points[begin, None])[..., None]
        slopes = (values[after] - values[begin, None]) / elapsed
        slack = tolerance / elapsed
        low = np.maximum(low, (slopes - slack).max(axis=1))
        high = np.minimum(high, (slopes + slack).min(axis=1))
        passing = ((low <= slopes[:, -1]) & (slopes[:, -1] <= high)).all(axis=1)
        reached[going[passing]] = starts[going[passing]] + interval + 1
        left = (low <= high).all(axis=1) & (after[:, -1] < len(points) - 1)
        going, low, high = going[left], low[left], high[left]
        if not len(going):
            break
    return reached
