"""Volumes below a surface that is free to move: those of closed surfaces, whatever their borders do."""

import numpy as np
import pytest

from wrinklecli.effects.contact.response import Pieces
from wrinklecli.numeric.arrays import Floats, Ints

SIDES, RINGS = 24, 8


def tube(shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[Floats, Ints]:
    """An open tube of radius 1 along x, from 0 to 7."""
    angles = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    rings = [np.stack([0 * angles + k, np.cos(angles), np.sin(angles)], axis=1) for k in range(RINGS)]
    corners = np.arange(RINGS * SIDES).reshape(RINGS, SIDES)
    a, b, c, d = (
        each.reshape(-1)
        for each in (corners[:-1], np.roll(corners[:-1], -1, axis=1), np.roll(corners[1:], -1, axis=1), corners[1:])
    )
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.concatenate(rings) + np.array(shift), triangles


AREA = SIDES / 2.0 * np.sin(2.0 * np.pi / SIDES)


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (300.0, -200.0, 500.0)])
def test_a_border_that_moves_changes_the_volume_by_what_it_passes(shift: tuple[float, float, float]) -> None:
    places, triangles = tube(shift)
    free = np.arange(len(places)) >= 4 * SIDES
    pieces = Pieces.of(triangles, free)
    assert len(pieces.volumes(places)) == 1
    last = np.arange(len(places)) >= (RINGS - 1) * SIDES
    longer = places + np.where(last[:, None], [0.5, 0.0, 0.0], 0.0)
    assert abs(np.sum(pieces.volumes(longer) - pieces.volumes(places))) == pytest.approx(0.5 * AREA, rel=1e-9)
    # A border that slides aside shears the last ring, and takes nothing away.
    aside = places + np.where(last[:, None], [0.0, 0.3, 0.0], 0.0)
    assert np.sum(pieces.volumes(aside) - pieces.volumes(places)) == pytest.approx(0.0, abs=1e-6)


def test_gradients_are_the_changes_of_volumes() -> None:
    places, triangles = tube((3.0, -2.0, 5.0))
    numbers = np.random.default_rng(5)
    free = numbers.random(len(places)) < 0.7
    pieces = Pieces.of(triangles, free)
    at, move = places + numbers.normal(0.0, 0.05, places.shape), numbers.normal(0.0, 1.0, places.shape)
    move[~free] = 0.0
    changes = (pieces.volumes(at + 1e-4 * move) - pieces.volumes(at - 1e-4 * move)) / 2e-4
    assert np.sum(pieces.gradients(at) * move, axis=(1, 2)) == pytest.approx(changes, abs=1e-6)
