"""Texels under triangles, their steps, gutters, tangents and occlusion, on squares whose answers are known."""

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.texture.layout import mikk_tangents
from wrinklecli.texture.map_set import occlusion
from wrinklecli.texture.texels import charted, covered, gutter, texture_steps

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def hits(uvs: Floats, size: int) -> tuple[Ints, Ints, Floats]:
    nothing = np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros((0, 3))
    texels, triangles, shares = zip(nothing, *covered(uvs, size), strict=True)
    return np.concatenate(texels), np.concatenate(triangles), np.concatenate(shares)


def test_two_triangles_cover_each_texel_of_the_square() -> None:
    texels, triangles, shares = hits(SQUARE[FACES], 8)
    assert np.unique(texels).tolist() == list(range(64))
    centres = np.einsum("tk,tkx->tx", shares, SQUARE[FACES][triangles]) * 8 - 0.5
    rows, columns = np.divmod(texels, 8)
    assert np.allclose(centres, np.column_stack([columns, rows]))
    first, pairs = charted(SQUARE[FACES], 8, np.ones(2, np.bool_))
    assert np.bincount(first).tolist() == [36, 28]  # the diagonal is the first triangle's
    assert not len(pairs)


def test_coordinates_repeat_and_shared_texels_are_found() -> None:
    small = 0.25 * SQUARE[FACES] + 0.5
    both = np.concatenate([small, small + np.array([3.0, -2.0])])
    first, pairs = charted(both, 16, np.ones(4, np.bool_))
    assert (first >= 0).sum() == 16
    assert set(first[first >= 0].tolist()) == {0, 1}
    assert set(map(tuple, pairs[:, 1:].tolist())) == {(0, 2), (1, 3)}
    assert len(pairs) == 12  # the centres that do not lie on the diagonal
    for wanted in range(4):
        again, some = charted(both, 16, np.arange(4) == wanted)
        assert np.array_equal(again, first)
        assert np.array_equal(some, pairs[(pairs[:, 1:] == wanted).any(axis=1)])


def test_a_triangle_without_area_or_of_a_hundred_squares_covers_nothing() -> None:
    flat = np.array([[[0.1, 0.1], [0.5, 0.5], [0.9, 0.9]]])
    assert not len(hits(flat, 8)[0])
    assert not len(hits(100.0 * SQUARE[FACES], 8)[0])


@pytest.mark.parametrize("sides", [(1.9, 1.9), (1.9, 0.4), (0.4, 1.9)])
def test_a_triangle_of_up_to_two_squares_covers_its_texels(sides: tuple[float, float]) -> None:
    uvs = SQUARE[FACES] * sides + 0.03
    _, triangles, shares = hits(uvs, 10)
    centres = np.unique(np.round(10 * np.einsum("tk,tkx->tx", shares, uvs[triangles]) - 0.5, 6), axis=0)
    assert len(centres) == round(100 * sides[0] * sides[1])
    assert not len(hits(1.25 * SQUARE[FACES] * sides, 10)[0])


def test_a_step_moves_by_one_texel() -> None:
    uvs = np.array([[[0.1, 0.2], [0.7, 0.3], [0.2, 0.8]]])
    steps = texture_steps(uvs, 32)[0]
    assert np.allclose(steps @ uvs[0] * 32, np.eye(2))
    assert np.allclose(steps.sum(axis=1), 0.0)


def test_a_gutter_takes_the_nearest_texel_and_ends() -> None:
    filled = np.zeros((2, 12), np.bool_)
    filled[0, [2, 9]] = True
    beside, nearest = gutter(filled[:1], 3)
    assert beside.tolist() == [0, 1, 3, 4, 5, 6, 7, 8, 10, 11]
    assert nearest.tolist() == [2, 2, 2, 2, 2, 9, 9, 9, 9, 9]
    beside, nearest = gutter(filled, 1)
    assert dict(zip(beside.tolist(), nearest.tolist(), strict=True)) == {1: 2, 3: 2, 14: 2, 8: 9, 10: 9, 21: 9}
    assert not len(gutter(np.ones((4, 4), np.bool_), 3)[0])


def test_tangents_run_along_u_with_the_hand_of_the_texture() -> None:
    places = np.column_stack([SQUARE[:, 0], -SQUARE[:, 1], np.zeros(4)])
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    front = FACES[:, ::-1]
    assert np.allclose(mikk_tangents(places, normals, SQUARE, front), [1.0, 0.0, 0.0, 1.0])
    mirrored = SQUARE * [-1.0, 1.0]
    assert np.allclose(mikk_tangents(places, normals, mirrored, front), [-1.0, 0.0, 0.0, -1.0])


def test_a_flat_surface_sees_the_whole_sky_and_a_furrow_less() -> None:
    steps = np.tile([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (64, 64, 1, 1))
    filled = np.ones((64, 64), np.bool_)
    assert (occlusion(np.zeros((64, 64)), steps, filled) == 1.0).all()
    # Walls at 45° on both sides along x: half the sky there, two thirds on the diagonals, all of it along the furrow.
    walls = np.abs(np.arange(64.0) - 32.0) * np.ones((64, 1))
    seen = occlusion(walls, steps, filled)
    assert np.isclose(seen[32, 32], (2 * 0.5 + 4 * 2 / 3 + 2 * 1.0) / 8)
    assert (occlusion(walls, steps, np.zeros((64, 64), np.bool_)) == 1.0).all()
