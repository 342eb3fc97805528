"""Basins of the compression over a surface, and regions that reach across its middle."""

from unittest.mock import Mock

import numpy as np
import pytest
from scipy.sparse import csr_array

from wrinklecli.surface.compression import basins, grow_region
from wrinklecli.surface.sites import Sites


def test_a_slope_belongs_to_the_fold_above_it() -> None:
    losses = np.array([0.1, 0.3, 0.5, 0.45, 0.48, 0.9, 0.3, 0.05, 0.2, 0.6])
    count = len(losses)
    chain = np.eye(count, k=1) + np.eye(count, k=-1)
    found = basins(losses, csr_array(chain), least=0.1)
    assert found.tolist() == [5, 5, 5, 5, 5, 5, 5, -1, 9, 9]


@pytest.mark.parametrize(("opposite", "joined"), [(1.0, True), (0.7, True), (0.5, False), (0.3, False)])
def test_two_halves_are_one_region_if_both_lose(opposite: float, joined: bool) -> None:
    """A sheet that loses 1 along y on its right side, above the middle, and a part of that on its left."""
    x, y = (each.ravel().astype(np.float64) for each in np.meshgrid(np.arange(-6, 7), np.arange(-5, 6)))
    places = np.stack([x, y, np.full(len(x), 5.0)], axis=1)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    near = csr_array((apart > 0) & (apart < 1.5))
    up, ones = np.tile([0.0, 0.0, 1.0], (len(x), 1)), np.ones(len(x))
    sites = Sites(Mock(), places, up, ones, np.zeros(len(x), np.intp), near, near, near, 1.5, 1.0)
    half = (np.abs(np.abs(x) - 4.0) <= 1.0) & (np.abs(y - 3.0) <= 1.0)
    tensors = np.zeros((len(x), 6))
    tensors[:, 1] = np.where(half, np.where(x > 0, 1.0, opposite), 0.3)
    tensors[np.abs(x) > 5.0, 1] = -1.0
    # Another fold on the left, below the middle, is not the other half.
    tensors[(x == -4.0) & (y == -4.0), 1] = 1.0
    seed = int(np.flatnonzero((x == 4.0) & (y == 3.0))[0])
    region = grow_region(sites, seed, tensors, np.ones(len(x), np.bool_), twin=True, across=True)
    assert region is not None
    assert region.on_plane == joined
    assert region.centre == pytest.approx([0.0 if joined else 4.0, 3.0, 5.0])
