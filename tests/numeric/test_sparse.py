"""The sparse matrix against dense ones."""

import numpy as np
import pytest

from wrinklecli.numeric.sparse import Matrix


@pytest.mark.parametrize("seed", range(5))
def test_sparse_products_are_those_of_dense_matrices(seed, monkeypatch):
    monkeypatch.setattr("wrinklecli.numeric.portions.AT_ONCE", 40)
    random = np.random.default_rng(seed)
    count = 9

    def entries(rows, columns):
        where = np.concatenate([np.arange(rows), random.integers(0, rows, 30)])
        return where, random.integers(0, columns, len(where)), random.normal(size=len(where))

    first, second = entries(7, count), entries(5, count + 7)
    dense = [np.eye(count)]
    for (rows, columns, weights), width in ((first, count), (second, count + 7)):
        step = np.zeros((rows.max() + 1, width))
        np.add.at(step, (rows, columns), weights)
        dense.append(step)
    expected = np.concatenate([dense[0], dense[1]])
    expected = np.concatenate([expected, dense[2] @ expected])
    found = Matrix.of_entries(*second, count + 7).below(Matrix.of_entries(*first, count).below(Matrix.identity(count)))
    assert found.shape == expected.shape
    np.testing.assert_allclose(found @ np.eye(count), expected, atol=1e-13)
    values, chosen = random.normal(size=(count, 2, 3)), np.array([3, 20, 3, 10, 0])
    np.testing.assert_allclose(found.of_rows(chosen, values), np.tensordot(expected, values, 1)[chosen], atol=1e-13)
    assert found.of_rows(chosen[:0], values).shape == (0, 2, 3)
