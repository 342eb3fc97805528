"""Crests are seen as bands across a tool; lumps, specks and steps are none."""

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.suggest.look import Crests

BUMPS = 4
# Part of the change of light.
MOST = 0.55
US, VS = (each.ravel() for each in np.meshgrid(np.linspace(0.0, 1.0, 120), np.linspace(-1.0, 1.0, 100)))


def of(changes: Floats, bumps: int = BUMPS) -> Crests:
    return Crests.of(0.15 * changes, US, VS, bumps)


@pytest.mark.parametrize("bumps", [1, 2, 4])
def test_bands_across_a_tool_are_crests(bumps: int) -> None:
    seen = of(np.cos(2 * np.pi * bumps * US), bumps)
    assert seen.contrast == pytest.approx(0.15 / np.sqrt(2.0), rel=0.1)
    assert seen.share > 0.95


def test_crests_that_end_in_the_middle_are_crests() -> None:
    assert of(np.cos(2 * np.pi * BUMPS * US) * (VS < 0.25)).share > MOST


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        (np.random.default_rng(1).choice([0.0, -3.0], len(US), p=[0.9, 0.1]), "specks"),
        (np.cos(2 * np.pi * BUMPS * US) * np.sign(np.sin(4 * np.pi * VS)), "lumps"),
        (np.cos(6 * np.pi * VS), "bands along the tool"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_lumps_and_specks_are_no_crests(changes: Floats, kind: str) -> None:
    seen = of(changes)
    assert seen.share < MOST, kind


@pytest.mark.parametrize("changes", [np.full(len(US), 1.0), 2.0 * US - 1.0], ids=["darker", "a slope"])
def test_a_place_that_only_gets_darker_shows_no_crests(changes: Floats) -> None:
    assert of(changes).contrast < 0.015


def test_nothing_is_seen_of_nothing() -> None:
    nothing = np.zeros(0)
    assert Crests.of(nothing, nothing, nothing, BUMPS) == Crests(0.0, 0.0)
