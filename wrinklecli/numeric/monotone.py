"""A smooth curve through points in time, which goes nowhere between two points at the same place.

It is cubic between points, with a slope at each point. The slope is that of the parabola through the point and its two
neighbours, but is limited so that the curve rises nowhere where the points fall, and rests where they rest: a curve of
continuous acceleration would move before a motion begins. A smooth crest between two points stays, as a limit that
knows single steps alone would cut it off: at 30 points a second, springs of 8 Hz then are 20 % off, here 2 %.

Source: H. T. Huynh, *Accurate Monotone Cubic Interpolation*, SIAM Journal on Numerical Analysis 30, 1993 (its limit
M3), which widens that of F. N. Fritsch and R. E. Carlson, *Monotone Piecewise Cubic Interpolation*, ibid. 17, 1980.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats

# Points of a loop beyond either end that the slopes at its ends depend on.
_AROUND = 2


def slopes(times: Floats, points: Floats, *, periodic: bool) -> Floats:
    """(points, columns) slopes at (points,) sorted times of a curve through (points, columns), three of them at least.

    A curve that is `periodic` goes on as from its beginning, from where it ends.
    """
    if periodic:
        whole, span = points[-1] - points[0], times[-1] - times[0]
        before, after = slice(-1 - _AROUND, -1), slice(1, 1 + _AROUND)
        times = np.concatenate([times[before] - span, times, times[after] + span])
        points = np.concatenate([points[before] - whole, points, points[after] + whole])
    spans = np.diff(times)[:, None]
    steps = np.diff(points, axis=0) / spans
    bends = np.diff(steps, axis=0) / (spans[1:] + spans[:-1])
    # A bend of a piece is the less of those at its two points; beyond the ends, they go on.
    bends = np.concatenate([bends[:1], bends, bends[-1:]])
    bends = _least(bends[:-1], bends[1:])
    mean = (spans[1:] * steps[:-1] + spans[:-1] * steps[1:]) / (spans[1:] + spans[:-1])
    tended = _least(steps[:-1] + bends[:-1] * spans[:-1], steps[1:] - bends[1:] * spans[1:])
    most = np.maximum(3.0 * np.abs(_least(steps[:-1], steps[1:])), 1.5 * np.abs(tended))
    inner = _least(mean, np.sign(tended) * most)
    first, last = (_least(2.0 * steps[end] - inner[end], 3.0 * steps[end])[None] for end in (0, -1))
    found = np.concatenate([first, inner, last])
    return found[_AROUND:-_AROUND] if periodic else found


def _least(a: Floats, b: Floats) -> Floats:
    """The one of two numbers that is nearer to 0; 0 if their signs differ."""
    return np.where(a * b > 0.0, np.where(np.abs(a) < np.abs(b), a, b), 0.0)


def divided(times: Floats, points: Floats, slopes: Floats, most: float) -> tuple[Floats, Floats]:
    """(parts + 1,) times, with those of the points, about `most` apart or less, and (parts + 1, columns) there.

    Args:
        times: (points,) sorted.
        points: (points, columns) of the curve.
        slopes: (points, columns) of the curve.
        most: Seconds; between two points, all parts are alike.
    """
    spans = np.diff(times)
    # Keys are float32: at 200 s, spans are off by up to 15 µs, which is half a hundredth of a 360th of a second.
    counts = np.maximum(np.ceil(spans / most - 1e-2), 1.0).astype(np.intp)
    pieces = np.repeat(np.arange(len(spans)), counts)
    fractions = (np.arange(len(pieces)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[pieces]
    t, wide = fractions[:, None], spans[pieces, None]
    found = (
        points[pieces] * (1.0 + 2.0 * t) * (1.0 - t) ** 2
        + points[pieces + 1] * t**2 * (3.0 - 2.0 * t)
        + wide * (slopes[pieces] * t * (1.0 - t) ** 2 - slopes[pieces + 1] * t**2 * (1.0 - t))
    )
    return (
        np.append(times[pieces] + fractions * spans[pieces], times[-1]),
        np.concatenate([found, points[-1:]]),
    )
