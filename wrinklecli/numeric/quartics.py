"""Functions of time that are smooth between breaks, as fourth-degree polynomials through few points."""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.piecewise import Signal, greatest_of_rows, sampled, sampled_inside

# An interval whose quartic is not exact enough is halved at most this often.
_FIT_HALVINGS = 6
# Points at which a quartic equals its function, as fractions of its interval: Chebyshev points of the second kind.
NODES = (1.0 - np.cos(np.pi * np.arange(5) / 4.0)) / 2.0
# (5, 5) matrix from values at the nodes to coefficients.
_FROM_VALUES = np.linalg.inv(np.vander(NODES, increasing=True))


@dataclass(frozen=True, slots=True, eq=False)
class Quartics:
    """A function of time, piecewise quartic.

    Attributes:
        begins: (intervals,) sorted seconds.
        spans: (intervals,) seconds.
        powers: (intervals, 5, values) coefficients, the constant first, of the elapsed fraction of the interval.
    """

    begins: Floats
    spans: Floats
    powers: Floats

    def signal(self) -> Signal:
        """The function; the first and last quartics also hold before and after their intervals."""
        table = np.ascontiguousarray(self.powers.transpose(1, 2, 0))

        def fitted(times: Floats) -> Floats:
            which = np.clip(np.searchsorted(self.begins, times, side="right") - 1, 0, len(self.begins) - 1)
            t = (times - self.begins[which]) / self.spans[which]
            # `which` is in range, so "clip" only avoids a check; `row[:, which]` takes seven times as long.
            found: Floats = table[4].take(which, axis=1, mode="clip")
            for row in table[3::-1]:
                found *= t
                found += row.take(which, axis=1, mode="clip")
            return found.T

        return fitted


def through(values: Floats) -> Floats:
    """(intervals, 5, values) coefficients of the quartics through (intervals, 5, values) at `NODES`."""
    return np.asarray(np.matmul(_FROM_VALUES, values))


def fit_quartics(function: Signal, breaks: Floats, tolerance: float) -> Quartics | None:
    """Fit quartics through five points of each interval to a function that is smooth between breaks.

    Joints move evenly between keys, so a smooth function of joints needs few samples, while heights, which start like
    square roots of such functions, need many.

    Args:
        function: Maps (points,) seconds to (points, values); each time is asked for only once.
        breaks: (breaks,) sorted seconds at which the function may bend.
        tolerance: An interval is halved, up to six times, while its quartic's last term is larger.

    Returns:
        None if the function is not finite everywhere.

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
    """Replace a function by its `fit_quartics` within the breaks, or give it back if it is not finite everywhere."""
    fitted = fit_quartics(function, breaks, tolerance)
    return function if fitted is None else fitted.signal()
