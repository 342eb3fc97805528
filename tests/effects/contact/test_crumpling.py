"""Crumpled surfaces: ridges and dents are told from a fold with flat sides, however finely it is divided."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.effects.contact.crumpling import Crumpling
from wrinklecli.numeric.arrays import Floats, Ints

RADIUS = 70.0


def sheet(count: int) -> tuple[Floats, Ints]:
    """A square of twice the radius, of (count, count) cells, and its triangles."""
    x, y = np.meshgrid(np.linspace(-RADIUS, RADIUS, count + 1), np.linspace(-RADIUS, RADIUS, count + 1), indexing="ij")
    corners = np.arange((count + 1) ** 2).reshape(count + 1, -1)
    a, b, c, d = (each.reshape(-1) for each in (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x.reshape(-1), y.reshape(-1), np.zeros(x.size)], axis=1), triangles


def folded(flat: Floats, degrees: float, width: float) -> Floats:
    """A sheet that bends by an angle along a strip of some width."""
    turn = np.radians(degrees) * np.clip(flat[:, 0] / width + 0.5, 0.0, 1.0)
    steps = np.diff(flat[:, 0], prepend=flat[0, 0])
    order = np.argsort(flat[:, 0], kind="stable")
    steps = np.diff(flat[order, 0], prepend=flat[order[0], 0])
    bent = flat.copy()
    bent[order, 0], bent[order, 2] = np.cumsum(steps * np.cos(turn[order])), np.cumsum(steps * np.sin(turn[order]))
    return bent


@given(count=st.integers(8, 24), size=st.floats(0.3, 0.5), seed=st.integers(0, 99))
def test_foil_is_crumpled_and_a_sharper_fold_is_not(count: int, size: float, seed: int) -> None:
    flat, triangles = sheet(count)
    crumpling = Crumpling.of(triangles, np.ones(len(flat), bool), RADIUS)
    skin, fold = folded(flat, 115.0, RADIUS), folded(flat, 140.0, 0.7 * RADIUS)
    assert not crumpling.crumples(skin, skin)
    assert not crumpling.crumples(skin, fold)
    edge = 2.0 * RADIUS / count
    foil = fold + np.random.default_rng(seed).normal(0.0, size * edge / np.sqrt(3.0), fold.shape)
    assert crumpling.crumples(skin, foil)
    # In other units it is the same.
    assert Crumpling.of(triangles, np.ones(len(flat), bool), 1.0).crumples(skin / RADIUS, foil / RADIUS)


def test_a_flat_surface_may_become_as_round_as_the_limb() -> None:
    flat, triangles = sheet(12)
    crumpling = Crumpling.of(triangles, np.ones(len(flat), bool), RADIUS)
    assert not crumpling.crumples(flat, folded(flat, 115.0, 2.0 * RADIUS))
    nothing = Crumpling.of(triangles, np.zeros(len(flat), bool), RADIUS)
    assert not nothing.crumples(flat, np.random.default_rng(1).normal(size=flat.shape))
