"""Damped springs that swing together within a limit, by fixed steps.

The springs' places n and speeds p, each over the spring's ω, change by kicks between steps; within a step each spring
is free and swings about its place of rest, which has a closed form. Two things keep it within the limit of 1:

- Of a load, by a kick or a place of rest, |n|⁴ of what pushes further out does not act. So a steady load F moves it to
  |n| = F (1 - |n|⁴), as a spring that gets stiffer towards the limit.
- A swing that would pass the limit, or move by more than `FASTEST` a second, is damped: after each kick, speeds are
  scaled so that |n|² + |ω p / min(ω, `FASTEST`)|² is at most 1.

The speed lost there takes from kicks the other way, and fades over `FADE`. So a blow and a weaker one back, as a curve
through keys makes of a sudden start, move flesh as the blow does. If the first were cut and the second were not, the
second would win.

Nothing of this adds energy, and nothing acts on a small swing, which is that of the free spring, at any frame rate.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.spring import Spring

STEPS = 360.0
"""Steps per second, at least: a frame has whole ones at 24, 30, 60, 72, 90 and 120 frames a second.

A sudden start may lie anywhere in a step, and the fastest swing moves by a fifteenth of the limit in one. So players
whose steps begin elsewhere are up to 2 % of the limit off, and 4 % with 240 steps.
"""

FASTEST = 24.0
"""Greatest change of |n| per second: 0.4 of the limit in a 60th of a second; more looks as if frames were missing."""

FADE = 1.0 / 30.0
"""Seconds over which lost speed counts: from key to key at 30 a second, as a blow and one back lie between two keys."""

# A loop is played until its state changes by less than that; and at most so often, as a player does.
_SAME, _MOST_ROUNDS = 1e-7, 100


@dataclass(frozen=True, slots=True, eq=False)
class LimitedSwing:
    """Springs over time.

    Attributes:
        springs: Their speeds and damping ratios.
        begins: (steps + 1,) sorted seconds of the steps' begins, and of the last end.
        rests: (steps, springs) their places of rest.
        states: (steps, 2, springs) n and p where a step begins, after its kick.
    """

    springs: tuple[Spring, ...]
    begins: Floats
    rests: Floats
    states: Floats

    def at(self, times: Floats) -> Floats:
        """(times, springs) n at seconds, held before the first step and after the last."""
        held = np.clip(times, self.begins[0], self.begins[-1])
        which = np.clip(np.searchsorted(self.begins, held, side="right") - 1, 0, len(self.rests) - 1)
        cosines, sines = decays(self.springs, held - self.begins[which])
        rest = self.rests[which]
        away = self.states[which, 0] - rest
        pushed = self.states[which, 1] + np.array([each.damping for each in self.springs]) * away
        found = rest + cosines * away + sines * pushed
        return np.asarray(found / np.maximum(np.sqrt((found**2).sum(axis=1, keepdims=True)), 1.0))


def decays(springs: Sequence[Spring], spans: Floats) -> tuple[Floats, Floats]:
    """(spans, springs) C and S of `Spring.decay` after (spans,) seconds."""
    each = [spring.decay(spring.speed * spans) for spring in springs]
    cosines, sines = (np.stack(one, axis=1) for one in zip(*each, strict=True))
    return cosines, sines


def settled(loads: Floats) -> Floats:
    """(…, springs) places at which springs come to rest under steady (…, springs) loads."""
    sizes = np.sqrt((loads**2).sum(axis=-1, keepdims=True))
    # Newton's method, which comes from above: what it finds gets lower until nothing is left but rounding.
    found, lower = np.full(sizes.shape, np.inf), np.minimum(sizes, 1.0)
    while (lower < found).any():
        found = np.minimum(lower, found)
        lower = found - (sizes * found**4 + found - sizes) / (4.0 * sizes * found**3 + 1.0)
    return np.asarray(loads * np.where(sizes > 0.0, found / np.where(sizes > 0.0, sizes, 1.0), 1.0))


def swing(springs: Sequence[Spring], begins: Floats, kicks: Floats, loads: Floats, *, periodic: bool) -> LimitedSwing:
    """Let springs swing, from their places of rest.

    Args:
        springs: At least one.
        begins: (steps + 1,) sorted seconds.
        kicks: (steps, springs) changes of p where a step begins.
        loads: (steps, springs) places of rest in a step, were there no limit.
        periodic: Whether they swing as often as it takes to end as they begin.
    """
    cosines, sines = decays(springs, np.diff(begins))
    steps = list(zip(kicks.tolist(), loads.tolist(), cosines.tolist(), sines.tolist(), strict=True))
    start: _State = (settled(loads[0]).tolist(), [0.0] * len(springs), [0.0] * len(springs))
    fades = np.exp(-np.diff(begins) / FADE).tolist()
    for _ in range(_MOST_ROUNDS if periodic else 1):
        rests, states, end = _played(springs, steps, fades, start)
        if np.abs(np.subtract(end, start)).max() < _SAME:
            break
        start = end
    return LimitedSwing(tuple(springs), begins, np.array(rests), np.array(states))


# Places n, speeds p, and the speeds that the limit took.
_State = tuple[list[float], list[float], list[float]]


def _played(
    springs: Sequence[Spring], steps: Sequence[tuple[list[float], ...]], fades: Sequence[float], start: _State
) -> tuple[list[list[float]], list[tuple[list[float], list[float]]], _State]:
    """The places of rest and the states of each step, and the state at the end."""
    dampings = [each.damping for each in springs]
    squares = [max(each.speed / FASTEST, 1.0) ** 2 for each in springs]
    n, p, lost = start
    rests, states = [], []
    for (kick, load, cosine, sine), fade in zip(steps, fades, strict=True):
        square = sum([x * x for x in n])
        out = square * max(sum([x * k for x, k in zip(n, kick, strict=True)]), 0.0)
        push = [k - out * x for k, x in zip(kick, n, strict=True)]
        size, against = sum([d * d for d in lost]), -sum([k * d for k, d in zip(push, lost, strict=True)])
        share = min(max(against, 0.0), size) / size if size > 0.0 else 0.0
        p = [v + k + share * d for v, k, d in zip(p, push, lost, strict=True)]
        out = square * max(sum([x * f for x, f in zip(n, load, strict=True)]), 0.0)
        rest = [f - out * x for f, x in zip(load, n, strict=True)]
        if square > 1.0:
            n = [x / square**0.5 for x in n]
        room, taken = max(1.0 - square, 0.0), sum([w * v * v for w, v in zip(squares, p, strict=True)])
        kept = (room / taken) ** 0.5 if taken > room else 1.0
        lost = [fade * ((1.0 - share) * d + (1.0 - kept) * v) for d, v in zip(lost, p, strict=True)]
        p = [kept * v for v in p]
        rests.append(rest)
        states.append((n, p))
        swung = [
            (r + c * (x - r) + s * (v + z * (x - r)), c * v - s * (x - r + z * v))
            for r, c, s, x, v, z in zip(rest, cosine, sine, n, p, dampings, strict=True)
        ]
        n, p = [x for x, _ in swung], [v for _, v in swung]
    return rests, states, (n, p, lost)
