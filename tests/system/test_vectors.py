"""The drivers in several languages: they turn the poses of `samples/driver/vectors.json` into the weights due."""

import json
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from kit.clients import ask
from kit.places import ROOT
from kit.vectors import CASES, vectors

FILE = ROOT / "samples" / "driver" / "vectors.json"
Played = dict[str, list[list[list[float]]]]


@cache
def due() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(FILE.read_text())
    return found


@cache
def javascript() -> Played:
    found: Played = ask("vectors", "play", str(FILE))
    return found


DRIVERS: dict[str, Callable[[], Played]] = {"javascript": javascript}


def test_the_file_is_small_and_has_all_cases() -> None:
    assert FILE.stat().st_size < 300_000
    assert list(due()) == list(CASES)


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", ["wrist", "muscles", "flesh", *sorted({*CASES} - {"wrist", "muscles", "flesh"})])
def test_the_vectors_are_those_of_the_program(name: str) -> None:
    """Another processor rounds otherwise, and contact adds that up."""
    wanted, found = due()[name], json.loads(json.dumps(vectors(CASES[name])))
    assert differences(wanted["wrinkle"], found["wrinkle"], 0.05) == []
    assert differences(wanted["runs"], found["runs"], 0.02) == []
    assert [wanted[key] for key in wanted if key not in ("wrinkle", "runs")] == [
        found[key] for key in found if key not in ("wrinkle", "runs")
    ]


def differences(wanted: Any, found: Any, tolerance: float) -> list[str]:
    """Where two pieces of JSON differ by more than a ratio of their numbers, or of 1."""
    if isinstance(wanted, dict) and isinstance(found, dict) and wanted.keys() == found.keys():
        return [f"{key} {line}" for key in wanted for line in differences(wanted[key], found[key], tolerance)]
    if isinstance(wanted, list) and isinstance(found, list) and len(wanted) == len(found):
        pairs = zip(wanted, found, strict=True)
        return [f"{k} {line}" for k, pair in enumerate(pairs) for line in differences(*pair, tolerance)]
    same = wanted == found
    if isinstance(wanted, int | float) and isinstance(found, int | float):
        same = abs(wanted - found) <= tolerance * max(abs(wanted), 1.0)
    return [] if same else [f"{wanted} {found}"]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("language", DRIVERS)
def test_a_driver_gives_the_weights_due(language: str, name: str) -> None:
    case = due()[name]
    for run, played in zip(case["runs"], DRIVERS[language]()[name], strict=True):
        wanted = np.array(run["weights"])
        assert len(played) == len(wanted) * run["rounds"]
        error = np.abs(np.array(played)[-len(wanted) :] - wanted)
        frame, target = np.unravel_index(error.argmax(), error.shape)
        assert error.max() < case["tolerance"], (run["clip"], run["times"][frame], case["targets"][target], error.max())
