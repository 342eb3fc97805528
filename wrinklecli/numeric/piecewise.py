"""Signals over time as straight lines between few keys: intervals are bisected where they bend, then keys thinned."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, float32_values

# How often an interval between two keys may be halved for the heights to be right between them. Where a wrinkle
# starts, each halving takes only a factor of 1.4 from the error: five times left 1.2 % of the tallest wrinkle, ten
# times, on a grid of 10 frames per second, 1.1 %.
_BISECTIONS = 16
# Of an interval whose quartic is not good enough.
_FIT_HALVINGS = 6
# Intervals of the grid that are sampled and thinned at once: bounds the memory.
_STRETCH = 8192
# Fewer where a signal has many values, as `attachment: patch` has three for each vertex: these in all.
_MOST_VALUES = 2**22
# Times that a signal is asked for at once, and intervals that are thinned side by side: what stays in a core's cache.
_CHUNK = 8192
_LANE = 64
# Where an interval is looked into, as shares of it: first here, then there, and where it is almost too far off, closer.
# Of a square root that starts anywhere in it at most 1.7 times what this finds is missed; seven points even apart: 1.9.
_MIDDLE = 0.5
_OTHERS = np.array([0.2, 0.8])
_CLOSER = np.array([0.3, 0.7])
# Of the tolerance.
_ALMOST = 0.75
# Points of an interval that are kept, from its start on.
_SHARES = np.sort(np.append(_OTHERS, [0.0, _MIDDLE]))
_PER_INTERVAL = len(_SHARES)
# Points that a straight line is tried through at once.
_AHEAD = 4 * _PER_INTERVAL

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
    Differs: all values share their keys; and the lines of up to 64 stretches, between which there is a key, are
    found side by side.
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
    first = last = final = np.zeros((0, 0))
    ends = grid  # of intervals, not asked for yet: later the middles of those of the level before
    kept: list[tuple[Floats, Floats]] = []
    for level in range(_BISECTIONS + 1):
        inner = low[:, None] + _OTHERS * (high - low)[:, None]
        # Of the intervals to halve 97 % show it in their middle, and the other points are not asked for; but for few
        # intervals a second call takes longer.
        few = inner.size <= _CHUNK
        asked = [low + _MIDDLE * (high - low), ends, inner.reshape(-1) if few else ends[:0]]
        found = _in_chunks(signal, np.concatenate(asked))
        between, at, early = np.split(found, np.cumsum([len(each) for each in asked[:2]]))
        if level:
            first, last = np.concatenate([first, at]), np.concatenate([at, last])
        else:
            first, last, final = at[:-1], at[1:], at[-1:]
        middles = float32_values((low + high) / 2.0)
        divisible = (middles > low) & (middles < high) & (level < _BISECTIONS)
        middle_error = _greatest(np.abs(first + _MIDDLE * (last - first) - between))
        wide = divisible & (middle_error > tolerance)
        left, count = np.flatnonzero(~wide), _CHUNK // len(_OTHERS)
        for part in (left[k : k + count] for k in range(0, len(left), count)):
            others = early.reshape(*inner.shape, -1)[part] if few else signal(inner[part].reshape(-1))
            others = others.reshape(len(part), len(_OTHERS), -1)
            begin, end = first.take(part, axis=0), last.take(part, axis=0)
            error = np.maximum(middle_error[part], _farthest(begin, end, _OTHERS, others))
            doubtful = np.flatnonzero(divisible[part] & (error > _ALMOST * tolerance) & (error <= tolerance))
            if len(doubtful):
                which = part[doubtful]
                closer = low[which, None] + _CLOSER * (high - low)[which, None]
                found = signal(closer.reshape(-1)).reshape(*closer.shape, -1)
                error[doubtful] = _farthest(begin[doubtful], end[doubtful], _CLOSER, found)
            wide[part] = divisible[part] & (error > tolerance)
            done = np.flatnonzero(~wide[part])
            pieces = begin[:, None], others[:, :1], between.take(part, axis=0)[:, None], others[:, 1:]
            kept.append((low[part[done]], np.concatenate(pieces, axis=1).take(done, axis=0)))
        if not wide.any():
            break
        ends = middles[wide]
        low, high = np.concatenate([low[wide], ends]), np.concatenate([ends, high[wide]])
        first, last = first[wide], last[wide]
    starts = np.sort(np.concatenate([each for each, _ in kept]))
    values = np.zeros((_PER_INTERVAL * len(starts) + 1, final.shape[1]))
    values[-1:] = final
    by_interval = values[:-1].reshape(len(starts), _PER_INTERVAL, -1)
    for each, block in kept:
        by_interval[np.searchsorted(starts, each)] = block
    return np.append(starts, grid[-1]), values


def _farthest(first: Floats, last: Floats, shares: Floats, values: Floats) -> Floats:
    """(intervals,) how far (intervals, shares, values) are from straight lines between (intervals, values) ends."""
    lines = shares[:, None] * (last - first)[:, None]
    lines += first[:, None]
    lines -= values
    return _greatest(np.abs(lines, out=lines))


def _greatest(numbers: Floats) -> Floats:
    """(n,) of (n, …), or 0. Along rows of a few numbers `max` takes eight times as long."""
    columns = np.ascontiguousarray(numbers.reshape(len(numbers), -1).T)
    greatest: Floats = np.maximum.reduce(columns, axis=0, initial=0.0)
    return greatest


def _in_chunks(signal: Signal, times: Floats) -> Floats:
    return np.concatenate([signal(times[k : k + _CHUNK]) for k in range(0, len(times), _CHUNK)])


def _thinned(times: Floats, values: Floats, tolerance: float) -> Ints:
    """(keys,) which times straight lines need, first and last among them; values as `_bisected` gives them."""
    differ = values[1:] != values[:-1]
    moving = np.logical_or.reduce([differ[k::_PER_INTERVAL] for k in range(_PER_INTERVAL)])
    still = ~np.logical_or.reduce(np.ascontiguousarray(moving.T))
    changes = np.flatnonzero(np.diff(still)) + 1
    bounds = np.concatenate([[0], changes, [len(still)]])
    # Where nothing changes the ends are enough; elsewhere lanes begin, side by side.
    cuts = [np.arange(a, b, _LANE) for a, b in pairwise(bounds) if not still[a]]
    starts = np.concatenate([np.zeros(0, np.intp), *cuts])
    stops = np.minimum(starts + _LANE, bounds[np.searchsorted(bounds, starts, side="right")]) if len(starts) else starts
    points = np.append((times[:-1, None] + _SHARES * np.diff(times)[:, None]), times[-1])
    reaching = np.flatnonzero(~_ending(points, values, moving, tolerance))
    columns = moving.any(axis=0)
    lines = _lanes(points, values if columns.all() else values[:, columns], starts, stops, reaching, tolerance)
    quiet = np.flatnonzero(still[bounds[:-1]])
    begins, ends = (np.concatenate(each) for each in zip((bounds[quiet], bounds[quiet + 1]), *lines, strict=True))
    # What lies inside a line is no key.
    inside = np.zeros(len(times) + 1, np.intp)
    inside[begins + 1] += 1
    inside[ends] -= 1
    return np.flatnonzero(np.cumsum(inside[:-1]) == 0)


def _ending(points: Floats, values: Floats, moving: Bools, tolerance: float) -> Bools:
    """(intervals,) those from whose start no straight line passes all points of it and of the next interval.

    Around the start of a wrinkle that is most. Only few values move at a time, so these are tried one by one.

    Args:
        points: (points,) seconds: each time and three points between each two.
        values: (points, values).
        moving: (intervals, values) those that change.
        tolerance: Greatest error of a value.
    """
    starts, columns = np.nonzero(moving[:-1] | moving[1:])
    width = values.shape[1]
    times, places = _PER_INTERVAL * starts, _PER_INTERVAL * width * starts + columns
    low, high = np.full(len(starts), -np.inf), np.full(len(starts), np.inf)
    start, first = points.take(times), values.take(places)
    for ahead in range(1, 2 * _PER_INTERVAL + 1):
        elapsed = points.take(times + ahead) - start
        slopes = (values.take(places + ahead * width) - first) / elapsed
        slack = tolerance / elapsed
        np.maximum(low, slopes - slack, out=low)
        np.minimum(high, slopes + slack, out=high)
    ending = np.zeros(len(moving), np.bool_)
    ending[starts[low > high]] = True
    return ending


def _lanes(
    points: Floats, values: Floats, starts: Ints, stops: Ints, reaching: Ints, tolerance: float
) -> list[tuple[Ints, Ints]]:
    """Lines inside lanes of times, each to the furthest that a straight line reaches, where that is not the next time.

    The slopes that pass all points within the tolerance are an interval for each value, which only shrinks on the way.

    Args:
        points: (points,) seconds: each time and three points between each two.
        values: (points, values).
        starts: (lanes,) the first time of each lane, and
        stops: (lanes,) the last.
        reaching: (some times,) rising: those from which a line may reach further than the next time.
        tolerance: Greatest error of a value.

    Returns:
        The (lines,) times at which some lines start, and those at which they end; then those of others.
    """
    after_all = np.append(reaching, len(points))

    def skipped(here: Ints, stops: Ints) -> Ints:
        found: Ints = np.minimum(after_all[np.searchsorted(reaching, here)], stops)
        return found

    lines: list[tuple[Ints, Ints]] = []
    here = skipped(starts, stops)
    furthest, begin = here + 1, _PER_INTERVAL * here + 1
    low = np.full((len(starts), values.shape[1]), -np.inf)
    high = -low
    ahead = np.arange(_AHEAD)
    while True:
        going = here < stops
        here, begin, furthest, stops = here[going], begin[going], furthest[going], stops[going]
        low, high = low[going], high[going]
        if not len(here):
            return lines
        after = np.minimum(begin[:, None] + ahead, _PER_INTERVAL * stops[:, None])
        from_ = _PER_INTERVAL * here[:, None]
        elapsed = (points[after] - points[from_])[..., None]
        slopes = (values.take(after, axis=0) - values[from_]) / elapsed
        slack = tolerance / elapsed
        lowest = np.maximum(np.maximum.accumulate(slopes - slack, axis=1), low[:, None])
        highest = np.minimum(np.minimum.accumulate(slopes + slack, axis=1), high[:, None])
        passes = ((lowest <= slopes) & (slopes <= highest)).all(axis=2) & (after % _PER_INTERVAL == 0)
        furthest = np.maximum(furthest, np.where(passes, after // _PER_INTERVAL, 0).max(axis=1))
        low, high = lowest[:, -1], highest[:, -1]
        closed = (low > high).any(axis=1) | (begin + _AHEAD > _PER_INTERVAL * stops)
        lines.append((here[closed], furthest[closed]))
        here = np.where(closed, skipped(furthest, stops), here)
        begin = np.where(closed, _PER_INTERVAL * here + 1, begin + _AHEAD)
        furthest = np.where(closed, here + 1, furthest)
        low[closed], high[closed] = -np.inf, np.inf


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
    starts, ends = breaks[:-1], breaks[1:]
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    kept: list[tuple[Floats, Floats, Floats]] = []
    first = last = np.zeros((0, 0))
    for level in range(_FIT_HALVINGS + 1):
        inner = starts[:, None] + nodes[1:-1] * (ends - starts)[:, None]
        if level:
            wanted = _in_chunks(function, inner.reshape(-1)).reshape(*inner.shape, -1)
        else:
            # In order, together with the breaks: the keys of channels are looked up once.
            found = _in_chunks(function, np.append(np.column_stack([starts, inner]), breaks[-1:]))
            wanted = found[:-1].reshape(len(starts), 4, -1)[:, 1:]
            first, last = found[:-1:4], found[4::4]
        through = np.concatenate([first[:, None], wanted, last[:, None]], axis=1)
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
    begins, spans, powers = begins[order], spans[order], powers[order]

    table = np.ascontiguousarray(powers.transpose(1, 2, 0))

    def fitted(times: Floats) -> Floats:
        which = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(begins) - 1)
        t = (times - begins[which]) / spans[which]
        # Clipped, since what has to be able to fail takes longer, and `row[:, which]` seven times as long.
        found: Floats = table[4].take(which, axis=1, mode="clip")
        for row in table[3::-1]:
            found *= t
            found += row.take(which, axis=1, mode="clip")
        return found.T

    return fitted
