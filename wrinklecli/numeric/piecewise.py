"""Signals over time as straight lines between few keys: intervals are bisected where they bend, then keys thinned."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, float32_values

# How often an interval between two keys may be halved for the heights to be right between them. Where a wrinkle
# starts, each halving takes only a factor of 1.4 from the error: five times left 1.2 % of the tallest wrinkle, ten
# times, on a grid of 10 frames per second, 1.1 %.
_BISECTIONS = 16
# How often an interval may be halved whose quartic is not good enough.
_FIT_HALVINGS = 6
# Intervals of the grid that are sampled and thinned at once: bounds the memory.
_STRETCH = 8192
# Numbers of a stretch at most: it is shorter where a signal has many values, as `attachment: patch` has three a vertex.
_MOST_VALUES = 2**22
# Times that a signal is asked for at once: what stays in a core's cache.
_CHUNK = 8192
# A line is found interval by interval. So that numpy can do that for many places at once, a signal is cut into lanes of
# so many intervals with keys at their ends, which do not depend on each other. That costs a key in 64 times at most.
_LANE = 64
# Where an interval is looked into, as shares of it: first its middle, then the others, and the closer ones where it is
# almost too far off. If a square root starts anywhere in it, the greatest error is at most 1.7 times the one seen here;
# with seven points at equal steps it is 1.9 times.
_MIDDLE = np.array([0.5])
_OTHERS = np.array([0.2, 0.8])
_CLOSER = np.array([0.3, 0.7])
# Share of the tolerance above which an interval is almost too far off.
_ALMOST = 0.75
# Where an interval is known when keys are chosen: its start and the first three points above, in order.
_SHARES = np.sort(np.concatenate([[0.0], _MIDDLE, _OTHERS]))
_PER_INTERVAL = len(_SHARES)

# Times within a stretch, (points,) seconds, to (points, values).
Signal = Callable[[Floats], Floats]


def key_times(
    grid: Floats, signal_on: Callable[[Floats], Signal], *, tolerance: float, thinning: float
) -> tuple[Floats, Ints]:
    """Times so close that straight lines between them are right, and which of them to key.

    Times are first those of a grid, such as a clip's frames and its own keys. Heights start like a square root, so an
    interval is halved, up to 16 times, until straight lines are right at three points inside it, and at two more where
    they are almost too far off. Of these times a key is then the furthest to which a straight line from the key before
    passes all of them and all those three. A root that starts between such points may be 1.7 times the tolerance off
    there.

    Args:
        grid: (frames,) seconds, rising, float32 values; all are among the times.
        signal_on: Given a stretch of the grid, (frames,) seconds, a function that is right within it, from times to
            values.
        tolerance: Greatest error of a value between two times.
        thinning: The same between two keys; exceeded only between two neighbouring times that exceed it already.

    Returns:
        (frames,) seconds, rising, each a float32 value, and (keys,) indices into them, the first and last among them.
        Keys may be microseconds apart where a wrinkle starts: there heights rise like a square root.

    Source: K. Williams, *An efficient algorithm for the piecewise linear approximation of planar curves*, 1978.
    Differs: all values share their keys; and moving parts have a key at each 64th time at the latest (see `_LANE`).
    """
    times, keys, count = [grid[:1]], [np.zeros(1, np.intp)], 0
    width = max(signal_on(grid[:2])(grid[:1]).shape[1], 1) if len(grid) > 1 else 1
    stretch = min(max(_MOST_VALUES // (_PER_INTERVAL * width), 1), _STRETCH)
    for start in range(0, len(grid) - 1, stretch):
        part = grid[start : start + stretch + 1]
        found, needed = key_points(part, signal_on(part), tolerance=tolerance, thinning=thinning)
        times.append(found[1:])
        keys.append(count + needed[1:])
        count += len(found) - 1
    return np.concatenate(times), np.concatenate(keys)


def key_points(grid: Floats, signal: Signal, *, tolerance: float, thinning: float) -> tuple[Floats, Ints]:
    """As `key_times`, from (points,) rising points on, of any signal."""
    found, values = _bisected(grid, signal, tolerance)
    return found, _thinned(found, values, thinning)


def _bisected(grid: Floats, signal: Signal, tolerance: float) -> tuple[Floats, Floats]:
    """(frames,) times, and (4 (frames - 1) + 1, values) at each and at three points between each two."""
    low, high = grid[:-1], grid[1:]
    at_grid = _sampled(signal, grid)
    first, last, width = at_grid[:-1], at_grid[1:], at_grid.shape[1]
    kept: list[tuple[Floats, Floats]] = []
    for level in range(_BISECTIONS + 1):
        middles = float32_values((low + high) / 2.0)
        divisible = (middles > low) & (middles < high) & (level < _BISECTIONS)
        between = _sampled_inside(signal, low, high, _MIDDLE, width)
        error = _farthest(first, last, _MIDDLE, between)
        # Of the intervals to halve 97 % show it in their middle: the other points are asked for of the rest only.
        rest = np.flatnonzero(~(divisible & (error > tolerance)))
        others = _sampled_inside(signal, low[rest], high[rest], _OTHERS, width)
        error[rest] = np.maximum(error[rest], _farthest(first[rest], last[rest], _OTHERS, others))
        doubtful = rest[divisible[rest] & (error[rest] > _ALMOST * tolerance) & (error[rest] <= tolerance)]
        closer = _sampled_inside(signal, low[doubtful], high[doubtful], _CLOSER, width)
        error[doubtful] = _farthest(first[doubtful], last[doubtful], _CLOSER, closer)
        wide = divisible & (error > tolerance)
        values = np.concatenate([first[rest, None], others[:, :1], between[rest], others[:, 1:]], axis=1)
        kept.append((low[~wide], values[~wide[rest]]))
        if not wide.any():
            break
        at_middles = _sampled(signal, middles[wide])
        low, high = np.concatenate([low[wide], middles[wide]]), np.concatenate([middles[wide], high[wide]])
        first, last = np.concatenate([first[wide], at_middles]), np.concatenate([at_middles, last[wide]])
    starts, blocks = (np.concatenate(each) for each in zip(*kept, strict=True))
    order = np.argsort(starts, kind="stable")
    values = blocks[order].reshape(-1, width)
    return np.append(starts[order], grid[-1]), np.concatenate([values, at_grid[-1:]])


def _sampled(signal: Signal, times: Floats) -> Floats:
    """(times, values) of a signal, asked for as many at once as stay in a core's cache."""
    return np.concatenate([signal(times[k : k + _CHUNK]) for k in range(0, len(times), _CHUNK)])


def _sampled_inside(signal: Signal, low: Floats, high: Floats, shares: Floats, width: int) -> Floats:
    """(intervals, shares, values) of a signal at shares of (intervals,) intervals; unasked where there are none."""
    if not len(low):
        return np.zeros((0, len(shares), width))
    times = low[:, None] + shares * (high - low)[:, None]
    found = _sampled(signal, times.reshape(-1))
    return found.reshape(*times.shape, found.shape[1])


def _farthest(first: Floats, last: Floats, shares: Floats, values: Floats) -> Floats:
    """(intervals,) how far (intervals, shares, values) are from straight lines between (intervals, values) ends."""
    lines = shares[:, None] * (last - first)[:, None]
    lines += first[:, None]
    lines -= values
    return _greatest(np.abs(lines, out=lines))


def _greatest(numbers: Floats) -> Floats:
    """(n,) the greatest of each row of (n, …), or 0. `max` along rows of a few numbers takes eight times as long."""
    columns = np.ascontiguousarray(numbers.reshape(len(numbers), math.prod(numbers.shape[1:])).T)
    greatest: Floats = np.maximum.reduce(columns, axis=0, initial=0.0)
    return greatest


def _thinned(times: Floats, values: Floats, tolerance: float) -> Ints:
    """(keys,) which times straight lines need, first and last among them; values as `_bisected` gives them."""
    points = np.append((times[:-1, None] + _SHARES * np.diff(times)[:, None]), times[-1])
    moving = (values[1:] != values[:-1]).any(axis=1).reshape(-1, _PER_INTERVAL).any(axis=1)
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(moving)) + 1, [len(moving)]])
    # Where nothing moves the ends are enough; what moves is cut into lanes (see `_LANE`).
    starts = np.concatenate([np.zeros(0, np.intp), *(np.arange(a, b, _LANE) for a, b in pairwise(bounds) if moving[a])])
    stops = np.minimum(starts + _LANE, bounds[np.searchsorted(bounds, starts, side="right")])
    return distinct_values(np.concatenate([bounds, *_lines(points, values, starts, stops, tolerance)]))


def _lines(points: Floats, values: Floats, starts: Ints, stops: Ints, tolerance: float) -> list[Ints]:
    """The times at which straight lines begin, each the furthest that the line before it reaches.

    The slopes that pass all points within the tolerance are an interval for each value, which only shrinks on the way.

    Args:
        points: (points,) seconds: each time and three points between each two.
        values: (points, values).
        starts: (lanes,) index of the first time of each lane.
        stops: (lanes,) index of the last.
        tolerance: Greatest error of a value.

    Returns:
        Indices of times: `starts`, then for each step those at which some lanes' lines end.
    """
    inside = np.arange(1 - _PER_INTERVAL, 1)
    begins, furthest, at = starts, starts + 1, starts + 1
    low = np.full((len(starts), values.shape[1]), -np.inf)
    high = -low
    found = [starts]
    while len(at):
        # One interval more, up to the time `at`.
        after, first = _PER_INTERVAL * at[:, None] + inside, _PER_INTERVAL * begins[:, None]
        elapsed = (points[after] - points[first])[..., None]
        slopes = (values.take(after, axis=0) - values[first]) / elapsed
        slack = tolerance / elapsed
        low = np.maximum(low, (slopes - slack).max(axis=1))
        high = np.minimum(high, (slopes + slack).min(axis=1))
        reached = ((low <= slopes[:, -1]) & (slopes[:, -1] <= high)).all(axis=1)
        furthest = np.where(reached, at, furthest)
        ending = (low > high).any(axis=1) | (at == stops)
        found.append(furthest[ending])
        begins = np.where(ending, furthest, begins)
        at = np.where(ending, begins, at) + 1
        furthest = np.where(ending, begins + 1, furthest)
        low[ending], high[ending] = -np.inf, np.inf
        going = begins < stops
        begins, furthest, at, stops = begins[going], furthest[going], at[going], stops[going]
        low, high = low[going], high[going]
    return found


def smooth(function: Signal, breaks: Floats, tolerance: float) -> Signal:
    """A function of time that is smooth between breaks, as quartics through five points of each interval.

    Joints turn and slide evenly between keys, so what depends on them smoothly needs few samples, where heights, which
    start like square roots of it, need many.

    Args:
        function: (points,) seconds to (points, values); asked for all times but once.
        breaks: (breaks,) seconds, rising; it may bend at them.
        tolerance: An interval is halved, up to six times, while its quartic's last term is larger.

    Returns:
        The same within the breaks; where the function is not finite, itself.

    Source: L. N. Trefethen, *Approximation Theory and Approximation Practice*, 2013, chapters 2 and 7: Chebyshev
    points of the second kind, and the size of the last coefficient for that of the error.
    """
    nodes = (1.0 - np.cos(np.pi * np.arange(5) / 4.0)) / 2.0
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    starts, ends = breaks[:-1], breaks[1:]
    at_breaks = _sampled(function, breaks)
    first, last, width = at_breaks[:-1], at_breaks[1:], at_breaks.shape[1]
    kept: list[tuple[Floats, Floats, Floats]] = []
    for level in range(_FIT_HALVINGS + 1):
        inner = _sampled_inside(function, starts, ends, nodes[1:-1], width)
        through = np.concatenate([first[:, None], inner, last[:, None]], axis=1)
        if not np.isfinite(through).all():
            return function
        # (intervals, 5, values) from the constant to the fourth power.
        powers = np.matmul(inverse, through)
        # The last Chebyshev coefficient of a quartic on an interval is that of its fourth power over 128.
        wide = (_greatest(np.abs(powers[:, 4])) > 128.0 * tolerance) & (level < _FIT_HALVINGS)
        kept.append((starts[~wide], (ends - starts)[~wide], powers[~wide]))
        if not wide.any():
            break
        middles, between = (starts + ends)[wide] / 2.0, through[wide, 2]
        starts, ends = np.concatenate([starts[wide], middles]), np.concatenate([middles, ends[wide]])
        first, last = np.concatenate([first[wide], between]), np.concatenate([between, last[wide]])
    begins, spans, powers = (np.concatenate(each) for each in zip(*kept, strict=True))
    order = np.argsort(begins, kind="stable")
    return _quartics(begins[order], spans[order], powers[order])


def _quartics(begins: Floats, spans: Floats, powers: Floats) -> Signal:
    """A function of time from its intervals' (intervals,) begins and spans and (intervals, 5, values) coefficients."""
    table = np.ascontiguousarray(powers.transpose(1, 2, 0))

    def fitted(times: Floats) -> Floats:
        which = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(begins) - 1)
        t = (times - begins[which]) / spans[which]
        # `which` is in range; "clip" spares the check for it, and `row[:, which]` takes seven times as long.
        found: Floats = table[4].take(which, axis=1, mode="clip")
        for row in table[3::-1]:
            found *= t
            found += row.take(which, axis=1, mode="clip")
        return found.T

    return fitted
