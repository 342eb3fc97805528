"""The exact response of a damped spring to a piecewise quartic signal, without time steps.

The equation is x'' = ω² (d - x) - 2 ζ ω x' for the signal d. On a piece where d is a polynomial of time, one solution
is a polynomial of the same degree, found from its highest power downwards. The difference of the state from this
polynomial decays in closed form, so the state advances over a piece in one step, however long the piece is.

Source: W. E. Boyce, R. C. DiPrima, *Elementary Differential Equations*, chapter 3 (undetermined coefficients).
"""

import numpy as np
from numpy.polynomial import polynomial

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.piecewise import Signal, greatest_of_rows, sampled, sampled_inside

# A piece shorter than this phase ωt, radians, counts as straight: over a float32 time step a jump has high powers that
# would cancel all digits. No motion bends within a 600th of the spring's period.
_STRAIGHT = 0.01
# Least exponent of a decay: e^-300 is 1e-130, whose products do not underflow.
_LEAST_EXPONENT = -300.0
# Rounding errors of the zeros of a piece, as fractions of it: a zero with a smaller imaginary part is real, and one
# that is nearer to an end is that end.
_ROUNDED = 1e-9

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


def through(values: Floats) -> Floats:
    """(intervals, 5, values) coefficients of the quartics through (intervals, 5, values) at `NODES`."""
    return np.asarray(np.matmul(_FROM_VALUES, values))


def fit_quartics(function: Signal, breaks: Floats, tolerance: float) -> Quartics:
    """Fit quartics through five points of each interval to a finite function that is smooth between breaks.

    Joints move evenly between keys, so a smooth function of joints needs few samples, while heights, which start like
    square roots of such functions, need many.

    Args:
        function: Maps (points,) seconds to (points, values); each time is asked for only once.
        breaks: (breaks,) sorted seconds at which the function may bend.
        tolerance: An interval is halved, up to six times, while its quartic's last term is larger.

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


@dataclass(frozen=True, slots=True)
class Spring:
    """A damped spring.

    Attributes:
        speed: ω, radians per second, > 0.
        damping: Damping ratio ζ > 0; 1 is critical damping.
    """

    speed: float
    damping: float

    def decay(self, turns: Floats) -> tuple[Floats, Floats]:
        """Give the decay of a free spring after (…,) phases ωt, radians.

        Returns:
            (…,) C and S: y and u = y'/ω become C y + S (u + ζ y) and C u - S (y + ζ u).
        """
        damping = self.damping
        if damping < 1.0:
            swing = np.sqrt(1.0 - damping**2)
            fading = np.exp(np.maximum(-damping * turns, _LEAST_EXPONENT))
            return fading * np.cos(swing * turns), fading * np.sin(swing * turns) / swing
        if damping == 1.0:
            fading = np.exp(np.maximum(-turns, _LEAST_EXPONENT))
            return fading, fading * turns
        # These are hyperbolic functions, written so that no exponential overflows.
        swing = np.sqrt(damping**2 - 1.0)
        fading = np.exp(np.maximum((swing - damping) * turns, _LEAST_EXPONENT))
        faster = np.expm1(np.maximum(-2.0 * swing * turns, _LEAST_EXPONENT))
        return fading * (1.0 + faster / 2.0), -fading * faster / (2.0 * swing)


@dataclass(frozen=True, slots=True, eq=False)
class SpringResponse:
    """The response of a spring to each value of a signal, at any time.

    Attributes:
        begins: (pieces,) sorted seconds.
        spans: (pieces,) seconds.
        powers: (pieces, 5, values) coefficients of the polynomial solution, the constant first, of the elapsed fraction
            of the piece.
        states: (pieces, 2, values) difference y of the state from this solution where a piece begins, and y'/ω.
    """

    spring: Spring
    begins: Floats
    spans: Floats
    powers: Floats
    states: Floats

    def at(self, times: Floats) -> Floats:
        """(times, values) x at seconds, held before the first piece and after the last."""
        held = np.clip(times, self.begins[0], self.begins[-1] + self.spans[-1])
        which = np.clip(np.searchsorted(self.begins, held, side="right") - 1, 0, len(self.begins) - 1)
        elapsed = held - self.begins[which]
        y, u = self.states[which].transpose(1, 0, 2)
        cosine, sine = (each[:, None] for each in self.spring.decay(self.spring.speed * elapsed))
        fractions = (elapsed / self.spans[which])[:, None]
        answer = polynomial.polyval(fractions, self.powers[which].transpose(1, 0, 2), tensor=False)
        return np.asarray(answer + cosine * y + sine * (u + self.spring.damping * y))


def respond(spring: Spring, signal: Quartics, *, periodic: bool) -> SpringResponse:
    """Let a spring follow each value of a signal.

    If the signal is `periodic`, the state at the end is that at the beginning. Otherwise the spring begins at rest, at
    the signal's first value.
    """
    turns = spring.speed * signal.spans
    every = [_respond(spring, powers, turns, periodic=periodic) for powers in signal.powers.transpose(2, 0, 1)]
    answers, states = (np.stack(each, axis=2) for each in zip(*every, strict=True))
    return SpringResponse(spring, signal.begins, signal.spans, answers, states)


def _respond(spring: Spring, powers: Floats, turns: Floats, *, periodic: bool) -> tuple[Floats, Floats]:
    """The `powers` and `states` of the response to (pieces, 5) powers of one value, on pieces of (pieces,) `turns`."""
    short = turns < _STRAIGHT
    powers = np.where(short[:, None], _straight(powers), powers)
    answers = _answers(powers, turns, spring.damping)
    # The polynomials' values at both ends of a piece, and their slopes over ω.
    begins = np.stack([answers[:, 0], answers[:, 1] / turns], axis=1)
    ends = np.stack([answers.sum(axis=1), answers @ np.arange(5.0) / turns], axis=1)
    cosines, sines = spring.decay(turns)
    first = np.zeros(2) if periodic else np.array([powers[0, 0], 0.0])
    states, last = _states(first, begins, ends, cosines, sines, spring.damping)
    if periodic:
        # The state at the end is that of a spring that began with zeros, plus the rest of the true beginning.
        whole = np.concatenate([[0.0], np.cumsum(turns)])
        left = _transitions(*spring.decay(whole), spring.damping)
        states = states + left[:-1] @ np.linalg.solve(np.eye(2) - left[-1], last)
    return answers, states - begins


def _straight(powers: Floats) -> Floats:
    """(pieces, 5) straight lines between the ends of quartics."""
    lines = np.zeros(powers.shape)
    lines[:, 0], lines[:, 1] = powers[:, 0], powers[:, 1:].sum(axis=1)
    return lines


def _answers(powers: Floats, turns: Floats, damping: float) -> Floats:
    """(pieces, 5) polynomials that solve the equation for the signal's ones, on pieces of (pieces,) `turns` radians."""
    answers = np.zeros((len(powers), 7))
    for power in range(4, -1, -1):
        slope, bend = (power + 1) * answers[:, power + 1], (power + 1) * (power + 2) * answers[:, power + 2]
        answers[:, power] = powers[:, power] - 2.0 * damping * slope / turns - bend / turns**2
    return answers[:, :5]


def _states(
    first: Floats, begins: Floats, ends: Floats, cosines: Floats, sines: Floats, damping: float
) -> tuple[Floats, Floats]:
    """(pieces, 2) x and x'/ω at the begin of each piece, and (2,) at the end of the last, from (2,) `first` ones."""
    x, v = first.tolist()
    states = []
    for (p, r), (q, s), cosine, sine in zip(
        begins.tolist(), ends.tolist(), cosines.tolist(), sines.tolist(), strict=True
    ):
        states.append((x, v))
        y, u = x - p, v - r
        x, v = q + cosine * y + sine * (u + damping * y), s + cosine * u - sine * (y + damping * u)
    return np.array(states), np.array([x, v])


def _transitions(cosines: Floats, sines: Floats, damping: float) -> Floats:
    """(…, 2, 2) matrices by which `Spring.decay` changes y and u."""
    rows = [[cosines + damping * sines, sines], [-sines, cosines - damping * sines]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def positive(signal: Quartics) -> Quartics:
    """Replace the negative parts of a signal of one value by 0; pieces are divided where it changes sign."""
    powers = signal.powers[:, :, 0]
    spread = np.abs(powers[:, 1:]).sum(axis=1)
    begins, spans, parts, done = [], [], [], 0
    for piece in np.flatnonzero((np.abs(powers[:, 0]) <= spread) & (spread > 0)).tolist():
        # (cuts,) sorted fractions of a piece: 0, the zeros of a (5,) polynomial between the ends, and 1.
        trimmed = polynomial.polytrim(powers[piece], np.finfo(float).eps * spread[piece])
        zeros = polynomial.polyroots(trimmed)
        real = np.sort(zeros.real[np.abs(zeros.imag) < _ROUNDED])
        cuts = distinct_values(np.concatenate([[0.0], real[(real > _ROUNDED) & (real < 1.0 - _ROUNDED)], [1.0]]))
        low, wide = cuts[:-1], np.diff(cuts)
        fractions = low[:, None] + NODES * wide[:, None]
        values = polynomial.polyval(fractions, powers[piece])
        above = values[:, 2] > 0
        begins += [signal.begins[done:piece], signal.begins[piece] + low * signal.spans[piece]]
        spans += [signal.spans[done:piece], wide * signal.spans[piece]]
        parts += [
            _where_positive(powers[done:piece]),
            np.where(above[:, None], through(values[..., None])[..., 0], 0.0),
        ]
        done = piece + 1
    parts.append(_where_positive(powers[done:]))
    together = np.concatenate([*begins, signal.begins[done:]]), np.concatenate([*spans, signal.spans[done:]])
    return Quartics(*together, np.concatenate(parts)[..., None])


def _where_positive(powers: Floats) -> Floats:
    """(pieces, 5) polynomials without sign changes, replaced by 0 if they are not positive."""
    return np.where(powers[:, :1] > 0, powers, 0.0)
