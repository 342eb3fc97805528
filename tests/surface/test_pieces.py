"""Pieces of a surface of one colour."""

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.surface.pieces import pieces_of

SIDE = 20
CLOTH, SKIN = (0.4, 0.0, -0.08), (0.75, 0.04, 0.06)


def sheet() -> Ints:
    """(triangles, 3) a square of squares, each of which is two triangles."""
    first = (np.arange(SIDE)[:, None] * (SIDE + 1) + np.arange(SIDE)).ravel()
    over = first + SIDE + 1
    return np.stack([first, first + 1, over, first + 1, over + 1, over], axis=1).reshape(-1, 3)


def columns() -> Ints:
    """(triangles,) the column of each triangle of the sheet."""
    return np.repeat(np.tile(np.arange(SIDE), SIDE), 2)


def pieces(colours: Floats, apart: Ints | None = None) -> Ints:
    count = len(colours)
    return pieces_of(sheet(), np.zeros(count, np.intp) if apart is None else apart, colours, np.ones(count))


def test_pieces_end_where_the_colour_changes() -> None:
    right = columns() >= 7
    noise = np.random.default_rng(1).normal(0.0, 0.002, (len(right), 3))
    found = pieces(np.where(right[:, None], CLOTH, SKIN) + noise)
    assert len(np.unique(found)) < 8
    assert not set(found[right]) & set(found[~right])


@pytest.mark.parametrize(("size", "count"), [(1, 1), (5, 2)])
def test_a_spot_belongs_to_the_piece_round_it(size: int, count: int) -> None:
    spot = (abs(columns() - 10) < size) & (abs(np.repeat(np.arange(SIDE), 2 * SIDE) - 10) < size)
    assert len(np.unique(pieces(np.where(spot[:, None], SKIN, CLOTH)))) == count


def test_primitives_are_pieces_apart() -> None:
    right = (columns() >= 7).astype(np.intp)
    assert np.array_equal(pieces(np.tile(CLOTH, (len(right), 1)), right), right)
