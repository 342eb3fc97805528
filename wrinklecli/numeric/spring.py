"""What a damped spring makes of a signal: its exact answer to quartics, one after another, and never a step of time.

The equation is x'' = ω² (d - x) - 2 ζ ω x', for d the signal. On a piece on which d is a polynomial of time, one answer
is a polynomial of the same degree, found from its highest power downwards; what the state at the piece's begin differs
from it by decays in closed form. So the state goes from piece to piece in one step, however long the piece is.

Source: the equation's solution is textbook matter, such as W. E. Boyce, R. C. DiPrima, *Elementary Differential
Equations*, chapter 3 (undetermined coefficients).
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.quartics import NODES, Quartics, through

# Turns of the spring, in radians, below which a piece is straight: a jump of a float32 step has high powers that, in
# these turns, would leave no digit. No motion bends within a 600th of the spring's period.
_STRAIGHT = 0.01
# Exponent of what is left when all is over: 1e-130, whose products are still no underflow.
_OVER = -300.0
# Imaginary part of a zero, in shares of a piece, up to which it is one.
_REAL = 1e-9


@dataclass(frozen=True, slots=True)
class Spring:
    """A damped spring.

    Attributes:
        speed: ω, radians per second, > 0.
        damping: ζ, > 0: below 1 it swings, from 1 on it does not.
    """

    speed: float
    damping: float

    def decay(self, turns: Floats) -> tuple[Floats, Floats]:
        """How a spring left to itself comes to rest.

        Args:
            turns: (…,) ω t, radians.

        Returns:
            (…,) C and S: from y, and u = y'/ω, come C y + S (u + ζ y), and C u - S (y + ζ u).
        """
        damping = self.damping
        if damping < 1.0:
            swing = np.sqrt(1.0 - damping**2)
            fading = np.exp(np.maximum(-damping * turns, _OVER))
            return fading * np.cos(swing * turns), fading * np.sin(swing * turns) / swing
        if damping == 1.0:
            fading = np.exp(np.maximum(-turns, _OVER))
            return fading, fading * turns
        # As hyperbolic functions, whose exponentials would overflow.
        swing = np.sqrt(damping**2 - 1.0)
        fading = np.exp(np.maximum((swing - damping) * turns, _OVER))
        faster = np.expm1(np.maximum(-2.0 * swing * turns, _OVER))
        return fading * (1.0 + faster / 2.0), -fading * faster / (2.0 * swing)


@dataclass(frozen=True, slots=True, eq=False)
class SpringResponse:
    """The answer of a spring to a signal, at any time.

    Attributes:
        spring: The spring.
        begins: (pieces,) seconds, rising.
        spans: (pieces,) seconds.
        powers: (pieces, 5) of the answer's polynomials, the constant first, of the share of the piece that is over.
        states: (pieces, 2) what differs from them where a piece begins: y and y'/ω.
    """

    spring: Spring
    begins: Floats
    spans: Floats
    powers: Floats
    states: Floats

    def at(self, times: Floats) -> Floats:
        """(times,) x at seconds; before the first piece and behind the last as at the ends."""
        held = np.clip(times, self.begins[0], self.begins[-1] + self.spans[-1])
        which = np.clip(np.searchsorted(self.begins, held, side="right") - 1, 0, len(self.begins) - 1)
        elapsed = held - self.begins[which]
        y, u = self.states[which].T
        cosine, sine = self.spring.decay(self.spring.speed * elapsed)
        answer = _polynomial(self.powers[which], elapsed / self.spans[which])
        found: Floats = answer + cosine * y + sine * (u + self.spring.damping * y)
        return found


def respond(spring: Spring, signal: Quartics, *, periodic: bool) -> SpringResponse:
    """Let a spring follow a signal.

    Args:
        spring: The spring.
        signal: Of one value.
        periodic: Whether it goes round: the state at the end is that at the begin. Otherwise the spring begins at rest,
            with the signal.
    """
    powers = signal.powers[:, :, 0]
    turns = spring.speed * signal.spans
    short = turns < _STRAIGHT
    powers = np.where(short[:, None], _straight(powers), powers)
    answers = _answers(powers, turns, spring.damping)
    # Where a piece begins and ends, the polynomials' values and, over ω, their slopes.
    begins = np.stack([answers[:, 0], answers[:, 1] / turns], axis=1)
    ends = np.stack([answers.sum(axis=1), answers @ np.arange(5.0) / turns], axis=1)
    cosines, sines = spring.decay(turns)
    first = np.zeros(2) if periodic else np.array([powers[0, 0], 0.0])
    states, last = _states(first, begins, ends, cosines, sines, spring.damping)
    if periodic:
        # The state at the end is that of a spring that began with nothing, and what is left of the true beginning.
        whole = np.concatenate([[0.0], np.cumsum(turns)])
        left = _transitions(*spring.decay(whole), spring.damping)
        states = states + left[:-1] @ np.linalg.solve(np.eye(2) - left[-1], last)
    return SpringResponse(spring, signal.begins, signal.spans, answers, states - begins)


def _straight(powers: Floats) -> Floats:
    """(pieces, 5) straight lines between the ends of quartics."""
    lines = np.zeros(powers.shape)
    lines[:, 0], lines[:, 1] = powers[:, 0], powers[:, 1:].sum(axis=1)
    return lines


def _answers(powers: Floats, turns: Floats, damping: float) -> Floats:
    """(pieces, 5) polynomials that solve the equation for those of the signal, on pieces of so many radians."""
    answers = np.zeros((len(powers), 7))
    for power in range(4, -1, -1):
        slope, bend = (power + 1) * answers[:, power + 1], (power + 1) * (power + 2) * answers[:, power + 2]
        answers[:, power] = powers[:, power] - 2.0 * damping * slope / turns - bend / turns**2
    return answers[:, :5]


def _states(
    first: Floats, begins: Floats, ends: Floats, cosines: Floats, sines: Floats, damping: float
) -> tuple[Floats, Floats]:
    """(pieces, 2) x and x'/ω where each piece begins, and (2,) at the last one's end, from (2,) at the first."""
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
    """(…, 2, 2) what `Spring.decay` makes of y and u, as matrices."""
    rows = [[cosines + damping * sines, sines], [-sines, cosines - damping * sines]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _polynomial(powers: Floats, shares: Floats) -> Floats:
    """(pieces,) values of (pieces, 5) polynomials at (pieces,) shares."""
    value = powers[:, 4]
    for power in range(3, -1, -1):
        value = value * shares + powers[:, power]
    return value


def positive(signal: Quartics) -> Quartics:
    """A signal of one value where it is above 0, and 0 elsewhere: pieces are divided where it changes sign."""
    powers = signal.powers[:, :, 0]
    spread = np.abs(powers[:, 1:]).sum(axis=1)
    begins, spans, parts, done = [], [], [], 0
    for piece in np.flatnonzero((np.abs(powers[:, 0]) <= spread) & (spread > 0)).tolist():
        cuts = _sign_changes(powers[piece])
        low, wide = cuts[:-1], np.diff(cuts)
        shares = low[:, None] + NODES * wide[:, None]
        values = np.polynomial.polynomial.polyval(shares, powers[piece])
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


def _sign_changes(powers: Floats) -> Floats:
    """(cuts,) shares of a piece from 0 to 1, rising, with those where a (5,) polynomial is 0 between them."""
    zeros = np.polynomial.polynomial.polyroots(np.trim_zeros(powers, "b"))
    real = np.sort(zeros.real[np.abs(zeros.imag) < _REAL])
    return distinct_values(np.concatenate([[0.0], real[(real > 0) & (real < 1)], [1.0]]))


def _where_positive(powers: Floats) -> Floats:
    """(pieces, 5) polynomials without sign changes, 0 for those that are not above it."""
    return np.where(powers[:, :1] > 0, powers, 0.0)
