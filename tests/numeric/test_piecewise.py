"""Signals over time: samples as close as straight lines need, and keys where lines bend."""

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.prepared import limb
from wrinklecli.character.clip import KEY_GAP, Clip, clip_grid
from wrinklecli.character.rig import Rig
from wrinklecli.numeric import piecewise
from wrinklecli.numeric.piecewise import Signal, key_points, key_times

Floats = NDArray[np.float64]


def stored(times: Any) -> Floats:
    return np.asarray(times).astype(np.float32).astype(np.float64)


def sampled(
    clip: Clip, rig: Rig, signal: Signal, *, fps: float, tolerance: float, gap: float = 1e-6, step: float = 1e-6
) -> tuple[Floats, Floats]:
    """Times, and those of them that are keys, of one tolerance."""
    grid = clip_grid(clip, rig, fps=fps)
    times, keys = key_times(grid, lambda _: signal, tolerance=tolerance, thinning=tolerance, gap=gap, step=step)
    assert keys[0] == 0
    assert keys[-1] == len(times) - 1
    assert (np.diff(keys) > 0).all()
    return times, times[keys]


@pytest.mark.parametrize(("start", "tolerance"), [(0.31234, 0.01), (0.9, 0.02), (0.0, 0.05), (1.999, 0.005)])
def test_quarter_points_of_every_interval_are_within_the_tolerance(start: float, tolerance: float) -> None:
    """Heights start like a square root; here one rises in the middle of a clip, and one comes to an end.

    Between keys h apart a square root is off by 0.4 √h at the most.
    """
    rig, clip = limb()

    def signal(times: Floats) -> Floats:
        rising = np.sqrt(np.maximum(times - start, 0))
        return np.stack([rising, 0.5 * np.sqrt(np.maximum(start - times, 0)), np.minimum(rising, 0.25)], axis=1)

    times, _ = sampled(clip, rig, signal, fps=10, tolerance=tolerance)
    assert (np.diff(times) > 0).all()
    assert np.array_equal(times, stored(times))
    values = signal(times)
    for share in (0.25, 0.5, 0.75):
        inner = times[:-1] + share * np.diff(times)
        error = np.abs((1 - share) * values[:-1] + share * values[1:] - signal(inner))
        assert error.max() <= tolerance
    # Only where it is needed: a uniform grid of this quality would take hundreds of times more.
    assert len(times) < 21 + 60


@given(st.floats(0.0, 1.0), st.floats(1e-3, 0.1), st.booleans())
def test_a_root_that_starts_anywhere_is_hardly_further_off_than_it_looks(
    start: float, tolerance: float, falling: bool
) -> None:
    """The three to five points inside an interval find at least 1 / 1.7 of the error: seven even ones, 1 / 1.9."""

    def signal(times: Floats) -> Floats:
        return np.sqrt(np.maximum(start - times if falling else times - start, 0.0))[:, None]

    times, _ = key_points(np.array([0.0, 1.0]), signal, tolerance=tolerance, thinning=tolerance, gap=1e-6, step=1e-6)
    inner = times[:-1] + np.linspace(0, 1, 65)[:, None] * np.diff(times)
    lines = np.interp(inner, times, signal(times)[:, 0])
    assert np.abs(lines - signal(inner.reshape(-1)).reshape(inner.shape)).max() <= 1.7 * tolerance


def test_straight_signal_needs_no_more_than_the_grid() -> None:
    rig, clip = limb()
    times, _ = sampled(clip, rig, lambda t: t[:, None] * [1.0, -2.0], fps=7, tolerance=1e-9)
    assert np.array_equal(times, clip_grid(clip, rig, fps=7))


def test_a_time_is_asked_for_once() -> None:
    """Three points inside each interval, seldom five, are asked for; where it is halved its middle is a time."""
    rig, clip = limb()
    asked = []

    def signal(times: Floats) -> Floats:
        asked.append(len(times))
        return np.sqrt(500 * times % 1.0)[:, None]

    times, _ = sampled(clip, rig, signal, fps=1000, tolerance=0.02, gap=1e-7, step=1e-7)
    assert len(times) > 8 * 2000
    assert sum(asked) < 10 * len(times)


@given(st.floats(0.01, 1.99), st.floats(1e-3, 0.04))
def test_no_two_times_are_closer_than_the_gap_and_none_at_a_jump_twice_as_far(jump: float, gap: float) -> None:
    rig, clip = limb()
    times, _ = sampled(clip, rig, lambda t: (t > jump).astype(float)[:, None], fps=10, tolerance=1e-3, gap=gap)
    assert np.diff(times).min() >= gap
    after = int(np.searchsorted(times, jump, side="right"))
    # A middle is a float32 value: there they are 1.2e-7 apart.
    assert times[after] - times[after - 1] < 2 * gap + 1.2e-7


def test_times_are_multiples_of_the_step_where_that_leaves_a_gap() -> None:
    rig, clip = limb()
    times, _ = sampled(
        clip, rig, lambda t: np.sqrt(np.abs(t - 0.777))[:, None], fps=7, tolerance=1e-3, gap=1e-3, step=1 / 600
    )
    added = np.setdiff1d(times, clip_grid(clip, rig, fps=7))
    assert len(added) > 10
    assert np.abs(added * 600 - np.round(added * 600)).max() < 1e-4
    # Steps that are too close together are no use: then the middle is taken.
    closer, _ = sampled(
        clip, rig, lambda t: np.sqrt(np.abs(t - 0.777))[:, None], fps=7, tolerance=1e-3, gap=1e-3, step=0.5
    )
    assert len(closer) > len(clip_grid(clip, rig, fps=7)) + 10


def points_of(times: Floats) -> Floats:
    """The times and the three points between each two that are looked into."""
    inner = times[:-1, None] + np.array([0.0, 0.2, 0.5, 0.8]) * np.diff(times)[:, None]
    middles = stored(inner[:, 2])
    divisible = np.minimum(middles - times[:-1], times[1:] - middles) >= 1e-6
    inner[divisible, 2] = middles[divisible]
    return np.append(inner.reshape(-1), times[-1])


def worst_between(keys: Floats, signal: Any, points: Floats) -> Floats:
    """(intervals of keys,) greatest error of straight lines at the points inside each."""
    values = signal(keys)
    lines = np.stack([np.interp(points, keys, column) for column in values.T], axis=1)
    errors = np.abs(lines - signal(points)).max(axis=1)
    which = np.clip(np.searchsorted(keys, points, side="right") - 1, 0, len(keys) - 2)
    worst = np.zeros(len(keys) - 1)
    np.maximum.at(worst, which, errors)
    return worst


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.3), st.integers(1, 5))
def test_dropped_keys_leave_lines_that_are_right(seed: int, tolerance: float, columns: int) -> None:
    """Waves and square roots of any start; all but neighbours that were too far apart already."""
    rng = np.random.default_rng(seed)
    speeds, starts = rng.uniform(0, 12, columns), rng.uniform(-0.5, 2.5, columns)

    def signal(times: Floats) -> Floats:
        after = np.maximum(times[:, None] - starts, 0.0)
        return 0.5 * np.sin(speeds * times[:, None]) + np.sqrt(after)

    rig, clip = limb()
    times, keys = sampled(clip, rig, signal, fps=30, tolerance=tolerance)
    wrong = worst_between(keys, signal, points_of(times)) > tolerance * (1 + 1e-9)
    together = np.searchsorted(times, keys)
    assert (np.diff(together)[wrong] == 1).all()
    assert np.array_equal(keys, sampled(clip, rig, signal, fps=30, tolerance=tolerance)[1])


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.1), st.floats(1e-3, 0.1))
def test_no_key_could_be_left_out(seed: int, tolerance: float, thinning: float) -> None:
    """From each key the next is the furthest that a straight line reaches, but for the longest that are allowed."""
    rng = np.random.default_rng(seed)
    waves = rng.uniform(0, 12, (2, 3))

    def signal(times: Floats) -> Floats:
        return np.sin(waves[0] * times[:, None] + waves[1])

    rig, clip = limb()
    grid = clip_grid(clip, rig, fps=30)
    times, keys = key_times(grid, lambda _: signal, tolerance=tolerance, thinning=thinning, gap=1e-6, step=1e-6)
    points = points_of(times)
    for k in range(len(keys) - 2):
        if keys[k + 1] - keys[k] < piecewise._LONGEST:
            longer = times[[keys[k], keys[k + 1] + 1]]
            inside = points[(points >= longer[0]) & (points <= longer[1])]
            assert worst_between(longer, signal, inside)[0] > thinning * (1 - 1e-9)


def test_straight_lines_keep_their_corners_alone() -> None:
    rig, clip = limb()

    def signal(times: Floats) -> Floats:
        return np.stack([np.abs(times - 1.0), np.maximum(times - 1.5, 0.0)], axis=1)

    assert sampled(clip, rig, signal, fps=20, tolerance=1e-6)[1].tolist() == [0.0, 1.0, 1.5, 2.0]


def test_where_nothing_moves_there_are_two_keys_however_long() -> None:
    rig, clip = limb()
    long = replace(clip, end=500.0)

    def signal(times: Floats) -> Floats:
        return np.where(np.abs(times[:, None] - 300.0) < 1.0, np.sin(times[:, None]), np.sin(300.0) * 0 + 0.5)

    times, keys = sampled(long, rig, lambda t: np.full((len(t), 2), 0.25), fps=30, tolerance=1e-6)
    assert len(times) > 15_000
    assert keys[[0, -1]].tolist() == [0.0, 500.0]
    # The ends of what is sampled at once are keys too.
    assert len(keys) <= 2 + len(times) // piecewise._STRETCH
    _, keys = sampled(long, rig, signal, fps=30, tolerance=1e-3)
    assert np.sum((keys > 299) & (keys < 301)) > len(keys) / 2


def test_a_signal_without_values_has_its_ends_as_keys() -> None:
    grid = np.linspace(0.0, 1.0, 9)
    points, keys = key_points(
        grid, lambda at: np.zeros((len(at), 0)), tolerance=0.1, thinning=0.1, gap=0.001, step=0.001
    )
    assert points[keys].tolist() == [0.0, 1.0]


def test_smooth_heights_need_few_keys() -> None:
    """Over a line of length h a parabola of curvature c is off by c h²/8: here h may be 0.28."""
    rig, clip = limb()
    times, keys = sampled(clip, rig, lambda t: t[:, None] ** 2, fps=30, tolerance=0.02)
    assert len(times) == 61
    assert len(keys) <= 2 + np.ceil(2 / 0.28)


def test_jumps_keep_both_their_keys() -> None:
    rig, clip = limb(interpolation="STEP")
    _, keys = sampled(clip, rig, lambda t: np.floor(t)[:, None], fps=30, tolerance=0.01, gap=KEY_GAP)
    assert keys == pytest.approx([0.0, 0.999, 1.0, 1.999, 2.0], abs=3e-7)
    assert np.diff(keys).min() >= KEY_GAP


@pytest.mark.parametrize("end", [0.0, 1e-3])
def test_the_ends_are_never_dropped(end: float) -> None:
    rig, clip = limb()
    short = replace(clip, channels=(), end=end)
    times, keys = sampled(short, rig, lambda t: np.zeros((len(t), 3)), fps=30, tolerance=1.0)
    assert times.tolist() == keys.tolist() == np.unique([0.0, np.float32(end)]).tolist()


@pytest.mark.slow
def test_a_wide_signal_is_held_few_times() -> None:
    def signal(times: Floats) -> Floats:
        return np.sqrt(np.abs(np.sin(40.0 * times)))[:, None] * np.linspace(0.0, 1.0, 2000)

    tracemalloc.start()
    times, _ = key_points(np.linspace(0.0, 1.0, 61), signal, tolerance=1e-3, thinning=1e-3, gap=1e-3, step=1e-3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(times) > 500
    assert peak < 3.6 * 8 * 4 * len(times) * 2000


@pytest.mark.parametrize("count", [1, 2])
def test_one_time_is_a_key_and_so_are_two(count: int) -> None:
    """A clip of 0 s has one time, and no interval."""
    times = np.array([0.5, 0.75])[:count]
    how = {"tolerance": 0.1, "thinning": 0.1, "gap": KEY_GAP, "step": KEY_GAP}
    for width in (0, 1, 3):

        def signal(at: Floats, width: int = width) -> Floats:
            return np.ones((len(at), width))

        points, keys = key_points(times, signal, **how)
        assert points.tolist() == times.tolist()
        assert keys.tolist() == list(range(count))
        assert [each.tolist() for each in key_times(times, lambda _, one=signal: one, **how)] == [
            points.tolist(),
            keys.tolist(),
        ]
