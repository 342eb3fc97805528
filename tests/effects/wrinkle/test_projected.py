"""A forecast looks into clips at some moments, and finds how crowded keys are there."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wrinklecli.character.clip import KEY_GAP
from wrinklecli.effects.sampling import SAMPLING_SHARE
from wrinklecli.effects.wrinkle import projected
from wrinklecli.numeric.arrays import Floats


def clips(*ends: tuple[float, float]) -> Any:
    return [SimpleNamespace(start=start, end=end) for start, end in ends]


@pytest.mark.parametrize("count", [1, 3, 16, 40])
def test_intervals_between_frames_are_spread_evenly_inside_the_clips(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[tuple[Any, Floats]] = []
    monkeypatch.setattr(projected, "_line_error", lambda *given: looked.append(given[2:]) or 0.0)
    given = clips(*((1.0 + k, 3.0 + k) for k in range(count)))
    found = projected._crowding(None, None, given, 60 * count, 1.0)  # type: ignore[arg-type]
    assert 16 <= len(looked) < 16 + len(found) <= 32
    assert len({id(clip) for clip, _ in found}) == len(found) >= min(count, 8)
    for clip, parts in found:
        assert parts.tolist() == [1.0] * len(parts)
        times = np.array([at for each, at in looked if each is clip])
        assert np.diff(times, axis=1) == pytest.approx(np.full((len(parts), 4), 2.0 / 60 / 4))
        middles = (times.mean(axis=1) - clip.start) / 2.0
        assert middles == pytest.approx((np.arange(len(parts)) + 1.0) / (len(parts) + 1.0), abs=0.01)


@pytest.mark.parametrize(("over", "parts"), [(0.5, 1.0), (3.0, 3.0), (1e9, 0.5 / KEY_GAP / 10.0)])
def test_a_line_is_divided_until_it_is_right_or_keys_are_too_close(
    over: float, parts: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(projected, "_line_error", lambda *_: over * SAMPLING_SHARE * 0.2)
    ((_, found),) = projected._crowding(None, None, clips((0.0, 1.0)), 10, 0.2)  # type: ignore[arg-type]
    assert found == pytest.approx(np.full(len(found), parts))


def test_the_error_of_a_line_is_that_between_its_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """One vertex moves straight, one along a parabola, and one does not move."""

    def displaced(*given: Any) -> Floats:
        times = given[-1]
        return np.stack([[[t, -t, 2 * t], [0.0, -(t**2), 0.1], [0.3, 0.3, 0.3]] for t in times])

    monkeypatch.setattr(projected, "displacements", displaced)
    plan: Any = SimpleNamespace(fine=None, rig=None, scale=3.0)
    error = projected._line_error(plan, None, None, np.linspace(1.0, 3.0, 5))  # type: ignore[arg-type]
    assert error == pytest.approx(projected.PER_COORDINATE * 3.0 * 1.0)
