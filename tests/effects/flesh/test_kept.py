"""Solutions of regions that are stored: each is read as it was, and one that is none is refused."""

import json
from typing import Any

import numpy as np
import pytest

from wrinklecli.effects.flesh.tissue import Swings, _read
from wrinklecli.effects.kept import written_records
from wrinklecli.numeric.elements import Tissue

COUNT = 3


def solution(**other: Any) -> Swings:
    """Numbers of a solution on a grid of 2 by 3 by 4 nodes, with two cubes."""
    chance = np.random.default_rng(1)
    cubes: dict[str, Any] = {
        "nodes": chance.integers(0, 24, (2, 8)),
        "fills": np.array([1.0, 0.5]),
        "stiffnesses": np.array([1.0, 2.0]),
        "fixed": np.arange(24) < 4,
        "size": 0.25,
    }
    tissue = Tissue(**{name: other.pop(name, each) for name, each in cubes.items() if name != "size"}, size=0.25)
    known: dict[str, Any] = {
        "low": np.array([-1.0, 0.0, 1.0]),
        "size": 0.25,
        "values": chance.normal(size=(COUNT, 2, 3, 4, 3)),
        "loads": np.eye(3),
        "speeds": np.array([1.0, 1.5, 2.0]),
    }
    return Swings(**{**known, **other}, tissue=tissue)


def test_a_solution_is_read_as_it_waswritten_records() -> None:
    made = solution()
    data = written_records(made)
    assert written_records(_read(data, COUNT)) == data
    found = _read(data, COUNT)
    assert (found.size, found.tissue.size) == (0.25, 0.25)
    for name in ("low", "values", "loads", "speeds"):
        assert np.array_equal(getattr(found, name), getattr(made, name)), name


@pytest.mark.parametrize(
    "other",
    [
        {"size": 0.0},
        {"size": -0.25},
        {"size": np.inf},
        {"speeds": np.array([1.0, 0.0, 2.0])},
        {"loads": np.eye(3)[:2]},
        {"low": np.zeros(2)},
        {"values": np.full((COUNT, 2, 3, 4, 3), np.nan)},
        {"nodes": np.full((2, 8), 24)},
        {"nodes": np.full((2, 8), -1)},
        {"fixed": np.ones(23, bool)},
        {"stiffnesses": np.ones(3)},
        {"fixed": np.zeros(24)},
    ],
    ids=lambda other: next(iter(other)),
)
def test_numbers_of_no_solution_are_refused(other: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"fit|solution"):
        _read(written_records(solution(**other)), COUNT)


@pytest.mark.parametrize("cut", [0, 1, 8])
def test_one_that_is_cut_off_or_of_another_count_is_refused(cut: int) -> None:
    data = written_records(solution())
    with pytest.raises(ValueError, match=r"fit|Expecting|Unterminated"):
        _read(data[: len(data) - cut], COUNT if cut else COUNT + 1)
    with pytest.raises((ValueError, LookupError)):
        _read(json.dumps([1]).encode() + b"\nx", COUNT)
    for forged in (b"[1]", b"{}", data.replace(b'"Tissue"', b'"Swings"'), data.replace(b'"<f8"', b'"|O"')):
        with pytest.raises((AttributeError, LookupError, TypeError, ValueError)):
            _read(forged, COUNT)
