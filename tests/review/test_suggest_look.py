"""Crests are seen as bands across a tool; lumps, specks and steps are none. Pictures show what is nearest."""

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.suggest.look import SIDE, Crests, _DepthBuffer, _places
from wrinklecli.review.suggest.worth import _LEAST_CONTRAST, _LEAST_CRESTS

BUMPS = 4
US, VS = (each.ravel() for each in np.meshgrid(np.linspace(0.0, 1.0, 120), np.linspace(-1.0, 1.0, 100)))


def of(changes: Floats, bumps: int = BUMPS) -> Crests:
    return Crests.of(0.15 * changes, US, VS, bumps)


@pytest.mark.parametrize("bumps", [1, 2, 4])
def test_bands_across_a_tool_are_crests(bumps: int) -> None:
    seen = of(np.cos(2 * np.pi * bumps * US), bumps)
    assert seen.contrast == pytest.approx(0.15 / np.sqrt(2.0), rel=0.1)
    assert seen.share > 0.95


def test_crests_that_end_in_the_middle_are_crests() -> None:
    assert of(np.cos(2 * np.pi * BUMPS * US) * (VS < 0.25)).share > _LEAST_CRESTS


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
    assert seen.share < _LEAST_CRESTS, kind


@pytest.mark.parametrize("changes", [np.full(len(US), 1.0), 2.0 * US - 1.0], ids=["darker", "a slope"])
def test_a_place_that_only_gets_darker_shows_no_crests(changes: Floats) -> None:
    assert of(changes).contrast < _LEAST_CONTRAST["near"]


def test_nothing_is_seen_of_nothing() -> None:
    nothing = np.zeros(0)
    assert Crests.of(nothing, nothing, nothing, BUMPS) == Crests(0.0, 0.0)


def test_a_pixel_shows_the_nearest_triangle_that_its_middle_lies_in() -> None:
    rng = np.random.default_rng(5)
    # Some triangles are larger than the picture, some smaller than a pixel, some beside it and some seen from the side.
    corners = rng.normal(size=(300, 1, 3)) + 10.0 ** rng.uniform(-3.0, 0.5, (300, 1, 1)) * rng.normal(size=(300, 3, 3))
    corners[:10, 2] = corners[:10, 0] + [0.0, 0.0, 1.0]
    positions, triangles = corners.reshape(-1, 3), np.arange(900).reshape(-1, 3)
    places = _places(positions, np.zeros(3), np.eye(3), 1.0)
    buffer = _DepthBuffer.empty().drawn(places, triangles, np.ones(300, bool))
    drawn = buffer.picture(places, triangles)
    depths, numbers = np.full((SIDE, SIDE), -np.inf), np.full((SIDE, SIDE), -1)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    for number, (a, b, c) in enumerate(places.T[triangles][10:], 10):
        edges = np.stack([b - a, c - a], axis=1)[:2]
        second, third = np.tensordot(np.linalg.inv(edges), np.stack([columns - a[0], rows - a[1]]), axes=1)
        deep = a[2] + second * (b[2] - a[2]) + third * (c[2] - a[2])
        nearer = (second >= 0) & (third >= 0) & (second + third <= 1) & (deep > depths)
        depths[nearer], numbers[nearer] = deep[nearer], number
    assert np.array_equal(drawn.numbers, numbers)
    hit = numbers >= 0
    at = drawn.interpolate(places.T, triangles, hit)
    assert at == pytest.approx(np.stack([columns, rows, depths], axis=-1)[hit], abs=1e-6)
    # A part is drawn into a copy of the picture of the other part.
    some = rng.random(300) < 0.5
    parts = _DepthBuffer.empty().drawn(places, triangles, some)
    before = parts.numbers.copy()
    assert np.array_equal(parts.drawn(places, triangles, ~some).numbers, buffer.numbers)
    assert np.array_equal(parts.numbers, before)
