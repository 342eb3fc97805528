"""Reduction of many shapes to few: within the tolerance, with as few shapes as the rank asks for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.errors import TooMuchError
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.reduction import compress, fewest_axes


@given(seed=st.integers(0, 999), rank=st.integers(1, 4))
def test_as_few_axes_are_kept_as_a_matrix_has_ranks(seed: int, rank: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(9, rank)) @ rng.normal(size=(rank, 6))
    axes = fewest_axes(rows, lambda axes: bool(np.abs(rows - rows @ axes.T @ axes).max() < 1e-9))
    assert len(axes) == rank
    assert len(fewest_axes(rows, lambda _: False)) == 6


@given(seed=st.integers(0, 999), tolerance=st.sampled_from([1e-9, 1e-3, 0.1, 1.0, 100.0]))
def test_compressed_series_meets_its_bound_with_as_few_shapes_as_its_rank(seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    rank = rng.integers(0, 4)
    series = np.einsum("fr,rvx->fvx", rng.normal(size=(7, rank)), rng.normal(size=(rank, 5, 3)))
    weights, shapes = compress([series[:3], series[3:]] if seed % 2 else [series], tolerance)
    assert len(shapes) <= rank
    assert weights.shape == (7, len(shapes))
    assert np.abs(np.einsum("fs,svx->fvx", weights, shapes) - series).max() <= tolerance + 1e-12
    assert np.abs(weights).max(initial=0) <= 1.0
    assert (weights.max(axis=0, initial=0) == 1.0).all()
    if tolerance == 1e-9 and np.linalg.matrix_rank(series.reshape(7, -1), tol=1e-6) == rank:
        assert len(shapes) == rank


def test_still_series_needs_no_shape() -> None:
    weights, shapes = compress([np.zeros((4, 3, 3))], 1e-9)
    assert weights.shape == (4, 0)
    assert shapes.shape == (0, 3, 3)


def test_a_series_is_given_up_before_it_takes_more_than_it_may() -> None:
    parts = (np.random.default_rng(k).normal(size=(10, 50, 3)) for k in range(100))
    with pytest.raises(TooMuchError, match=r"^tool: 30 frames of 50 vertices, as 30 shapes, would take .* kB "):
        compress(parts, 1e-9, memory=Memory(150_000), where="tool")
    assert len(list(parts)) == 97
