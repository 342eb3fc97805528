"""Functions of time that are smooth between breaks, as polynomials of the fourth degree through few points."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.piecewise import Signal, greatest_of_rows, sampled, sampled_inside

# How often an interval may be halved whose quartic is not good enough.
_FIT_HALVINGS = 6
# Where a quartic meets its function, as shares of its interval: Chebyshev points of the second kind.
NODES = (1.0 - np.cos(np.pi * np.arange(5) / 4.0)) / 2.0
# (5, 5) from values there to coefficients.
_FROM_VALUES = np.linalg.inv(np.vander(NODES, increasing=True))


@dataclass(frozen=True, slots=True, eq=False)
class Quartics:
    """A function of time, one quartic after another.

    Attributes:
        begins: (intervals,) seconds, rising.
        spans: (intervals,) seconds.
        powers: (intervals, 5, values) coefficients, the constant first, of the share of the interval that is over.
    """

    begins: Floats
    spans: Floats
    powers: Floats

    def signal(self) -> Signal:
        """The function itself; before the first and behind the last interval it goes on as in these."""
        table = np.ascontiguousarray(self.powers.transpose(1, 2, 0))

        def fitted(times: Floats) -> Floats:
            which = np.clip(np.searchsorted(self.begins, times, side="right") - 1, 0, len(self.begins) - 1)
            t = (times - self.begins[which]) / self.spans[which]
            # `which` is in range; "clip" spares the check for it, and `row[:, which]` takes seven times as long.
            found: Floats = table[4].take(which, axis=1, mode="clip")
            for row in table[3::-1]:
                found *= t
                found += row.take(which, axis=1, mode="clip")
            return found.T

        return fitted


def through(values: Floats) -> Floats:
    """(intervals, 5, values) coefficients of the quartics through (intervals, 5, values) at `NODES`."""
    powers: Floats = np.matmul(_FROM_VALUES, values)
    return powers


def fit_quartics(function: Signal, breaks: Floats, tolerance: float) -> Quartics | None:
    """A function of time that is smooth between breaks, as quartics through five points of each interval.

    Joints turn and slide evenly between keys, so what depends on them smoothly needs few samples, where heights, which
    start like square roots of it, need many.

    Args:
        function: (points,) seconds to (points, values); asked for all times but once.
        breaks: (breaks,) seconds, rising; it may bend at them.
        tolerance: An interval is halved, up to six times, while its quartic's last term is larger.

    Returns:
        The quartics; none where the function is not finite.

    Source: L. N. Trefethen, *Approximation Theory and Approximation Practice*, 2013, chapters 2 and 7: Chebyshev
    points of the second kind, and the size of the last coefficient for that of the error.
    """
    starts, ends = breaks[:-1], breaks[1:]
    at_breaks = sampled(function, breaks)
    first, last = at_breaks[:-1], at_breaks[1:]
    kept: list[tuple[Floats, Floats, Floats]] = []
    for level in range(_FIT_HALVINGS + 1):
        inner = sampled_inside(function, starts[:, None] + NODES[1:-1] * (ends - starts)[:, None])
        values = np.concatenate([first[:, None], inner, last[:, None]], axis=1)
        if not np.isfinite(values).all():
            return None
        powers = through(values)
        # The last Chebyshev coefficient of a quartic on an interval is that of its fourth power over 128.
        wide = (greatest_of_rows(np.abs(powers[:, 4])) > 128.0 * tolerance) & (level < _FIT_HALVINGS)
        kept.append((starts[~wide], (ends - starts)[~wide], powers[~wide]))
        if not wide.any():
            break
        middles, between = (starts + ends)[wide] / 2.0, values[wide, 2]
        starts, ends = np.concatenate([starts[wide], middles]), np.concatenate([middles, ends[wide]])
        first, last = np.concatenate([first[wide], between]), np.concatenate([between, last[wide]])
    begins, spans, powers = (np.concatenate(each) for each in zip(*kept, strict=True))
    order = np.argsort(begins, kind="stable")
    return Quartics(begins[order], spans[order], powers[order])


def smooth(function: Signal, breaks: Floats, tolerance: float) -> Signal:
    """As `fit_quartics`, as a function of time within the breaks; where the function is not finite, itself."""
    fitted = fit_quartics(function, breaks, tolerance)
    return function if fitted is None else fitted.signal()
