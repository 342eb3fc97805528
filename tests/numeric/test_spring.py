"""A damped spring: its answer against the equation stepped finely, at rest, going round, and without overshoot."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.spring import Quartics, Spring, SpringResponse, fit_quartics, positive, respond

SPEED = 2.0 * np.pi * 6.0
# Under-, critically and overdamped, and close to critical, where closed forms lose digits.
DAMPINGS = [0.05, 0.5, 0.999999, 1.0, 1.000001, 3.0]


def played(fitted: Quartics, times: Floats) -> Floats:
    """(times, values) of the function at (times,) seconds."""
    which = np.clip(np.searchsorted(fitted.begins, times, side="right") - 1, 0, len(fitted.begins) - 1)
    t = (times - fitted.begins[which]) / fitted.spans[which]
    return np.einsum("tkv,tk->tv", fitted.powers[which], t[:, None] ** np.arange(5))


def answer(signal: Floats, times: Floats, damping: float, *, periodic: bool = False) -> SpringResponse:
    """To straight lines through (times,) values, above 0."""
    fitted = fit_quartics(lambda at: np.interp(at, times, signal)[:, None], times, 1e-9)
    return respond(Spring(SPEED, damping), positive(fitted), periodic=periodic)


@given(st.integers(0, 2**32 - 1))
def test_smooth_functions_are_right_within_the_tolerance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speeds, phases = rng.uniform(0, 6, 3), rng.uniform(0, 7, 3)
    asked = []

    def function(times: Floats) -> Floats:
        asked.append(len(times))
        return np.abs(np.sin(speeds * times[:, None] + phases)) + 0.1 * times[:, None]

    # It bends where a sine is 0: there are breaks.
    bends = np.concatenate(
        [(np.pi * np.arange(-3, 9) - phase) / speed for speed, phase in zip(speeds, phases, strict=True)]
    )
    breaks = np.unique(np.concatenate([np.linspace(0, 2, 61), bends[(bends > 0) & (bends < 2)]]))
    fitted = fit_quartics(function, breaks, 1e-7)
    assert sum(asked) < 12 * len(breaks)
    times = np.linspace(0, 2, 1001)
    assert np.abs(played(fitted, times) - function(times)).max() < 1e-7


def test_fast_motion_is_sampled_closer() -> None:
    fitted = fit_quartics(lambda t: np.sin(40 * t)[:, None], np.linspace(0, 2, 7), 1e-6)
    times = np.linspace(0, 2, 1001)
    assert np.abs(played(fitted, times)[:, 0] - np.sin(40 * times)).max() < 1e-5


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize("damping", DAMPINGS)
def test_the_answer_is_the_equation_s(damping: float) -> None:
    times = np.linspace(0.0, 1.5, 40)
    fitted = fit_quartics(lambda at: (0.3 * np.sin(5.0 * at) + 0.1 * np.cos(31.0 * at))[:, None], times, 1e-9)
    signal = positive(fitted)
    fine = np.linspace(0.0, 1.5, 24_001)
    given_there = played(signal, fine)[:, 0]
    assert given_there == pytest.approx(np.maximum(played(fitted, fine)[:, 0], 0.0), abs=1e-12)
    found = respond(Spring(SPEED, damping), signal, periodic=False).at(fine)[:, 0]
    step = fine[1]
    slope = (found[2:] - found[:-2]) / (2.0 * step)
    bend = (found[2:] - 2.0 * found[1:-1] + found[:-2]) / step**2
    wanted = SPEED**2 * (given_there - found)[1:-1] - 2.0 * damping * SPEED * slope
    assert bend == pytest.approx(wanted, abs=1e-3 * np.abs(bend).max())
    assert found[0] == pytest.approx(given_there[0], abs=1e-12)
    assert found[1] - found[0] == pytest.approx(0.0, abs=1e-3 * step)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_what_goes_round_ends_as_it_begins(damping: float) -> None:
    times = np.array([0.0, 0.2, 0.35, 1.0])
    heights = np.array([0.1, 0.4, 0.0, 0.1])
    once = answer(heights, times, damping, periodic=True)
    # After many rounds a spring that began at rest has forgotten how.
    rounds = 40
    laps = np.concatenate([times[:-1] + lap for lap in range(rounds)] + [[float(rounds)]])
    many = answer(np.append(np.tile(heights[:-1], rounds), 0.1), laps, damping)
    at = np.linspace(0.0, 1.0, 101)
    assert once.at(at) == pytest.approx(many.at(at + rounds - 1), abs=1e-5)
    assert once.at(at[-1:]) == pytest.approx(once.at(at[:1]), abs=1e-12)


@given(
    signal=st.lists(st.floats(-0.5, 1.0), min_size=2, max_size=12),
    damping=st.sampled_from([1.0, 1.2, 5.0]),
    gap=st.sampled_from([1e-7, 1e-3, 0.04, 3.0]),
)
@example(signal=[-7e-307, 1.0], damping=1.0, gap=1e-7)
@example(signal=[1.0, 2.2e-311], damping=1.0, gap=1e-7)
def test_without_overshoot_from_a_damping_of_1_on(signal: list[float], damping: float, gap: float) -> None:
    """Whatever it follows, however sudden: the answer stays between the least and the greatest."""
    times = np.cumsum([0.0] + [gap if k % 2 else 0.04 for k in range(len(signal) - 1)])
    above = np.maximum(signal, 0.0)
    found = answer(np.array(signal), times, damping).at(np.linspace(0.0, times[-1] + 1.0, 300))[:, 0]
    assert found.min() >= above.min() - 1e-6
    assert found.max() <= above.max() + 1e-6


@pytest.mark.parametrize(("damping", "overshoot"), [(0.3, 0.3723), (0.5, 0.1630), (0.9, 0.0015)])
def test_a_sudden_step_overshoots_as_the_manual_says(damping: float, overshoot: float) -> None:
    found = answer(np.array([0.0, 0.0, 1.0, 1.0]), np.array([0.0, 0.1, 0.1 + 1e-7, 2.0]), damping)
    assert found.at(np.linspace(0.0, 2.0, 20_001)).max() == pytest.approx(1.0 + overshoot, abs=2e-4)
    assert found.at(np.array([9.0])) == pytest.approx(1.0, abs=1e-4)
