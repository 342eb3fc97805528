"""A sparse matrix by rows, with the few operations that refinement needs."""

from __future__ import annotations

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, runs
from wrinklecli.numeric.portions import portions_of


@dataclass(frozen=True, slots=True)
class Matrix:
    """A sparse matrix by rows, none of which is empty.

    Importing scipy.sparse in its place would take longer than baking a small asset.

    Attributes:
        starts: (rows + 1,) index of each row's first entry.
        columns: (entries,) columns, sorted within a row.
        weights: (entries,) values other than 0.
    """

    starts: Ints
    columns: Ints
    weights: Floats
    column_count: int

    @classmethod
    def of_entries(cls, rows: Ints, columns: Ints, weights: Floats, column_count: int) -> Matrix:
        """Sum the weights of equal places. Each row up to the last must have an entry."""
        order = np.argsort(rows * column_count + columns, kind="stable")
        rows, columns, weights = rows[order], columns[order], weights[order]
        first = np.ones(len(rows), np.bool_)
        first[1:] = (np.diff(rows) != 0) | (np.diff(columns) != 0)
        weights = np.add.reduceat(weights, np.flatnonzero(first)) if len(rows) else weights
        rows, columns = rows[first][weights != 0], columns[first][weights != 0]
        starts = np.searchsorted(rows, np.arange(int(rows[-1]) + 2 if len(rows) else 1))
        return cls(starts, columns, weights[weights != 0], column_count)

    @classmethod
    def identity(cls, count: int) -> Matrix:
        """The identity of `count` rows."""
        return cls(np.arange(count + 1), np.arange(count), np.ones(count), count)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.starts) - 1, self.column_count

    def __matmul__(self, dense: Floats) -> Floats:
        """(columns, …) → (rows, …)."""
        return self.of_rows(np.arange(len(self.starts) - 1), dense)

    def of_rows(self, rows: Ints, dense: Floats) -> Floats:
        """(chosen, …) rows of the product with (columns, …)."""
        width = max(1, int(np.prod(dense.shape[1:])))
        product = np.zeros((len(rows), *dense.shape[1:]))
        counts = self._counts(rows)
        for part in portions_of(counts * width):
            entries, begins = self._entries(rows[part])
            if len(entries):
                weights = self.weights[entries].reshape(-1, *[1] * (dense.ndim - 1))
                product[part] = np.add.reduceat(weights * dense[self.columns[entries]], begins, axis=0)
        return product

    def chosen(self, rows: Ints) -> Matrix:
        """Some rows, as a matrix."""
        entries, _ = self._entries(rows)
        starts = np.append(0, np.cumsum(self._counts(rows)))
        return Matrix(starts, self.columns[entries], self.weights[entries], self.column_count)

    def _entries(self, rows: Ints) -> tuple[Ints, Ints]:
        """Indices of some rows' entries, row by row, and the position of each row's first one among them."""
        counts = self._counts(rows)
        return runs(self.starts[rows], counts), np.cumsum(counts) - counts

    def _counts(self, rows: Ints) -> Ints:
        """(chosen,) numbers of entries of some rows."""
        return self.starts[rows + 1] - self.starts[rows]

    def below(self, above: Matrix) -> Matrix:
        """(n + m, V) the rows of (n, V) `above`, then those of this (m, n) matrix times `above`."""
        widths = np.diff(np.append(0, np.cumsum(np.diff(above.starts)[self.columns]))[self.starts])
        rows = np.arange(len(widths))
        return above.followed_by(*(self.chosen(rows[part])._on(above) for part in portions_of(widths)))

    def followed_by(self, *others: Matrix) -> Matrix:
        """The rows of this matrix, then those of others, which have as many columns."""
        parts = [self, *others]
        ends = np.cumsum([part.starts[-1] for part in parts])
        return Matrix(
            np.concatenate([self.starts, *(end + part.starts[1:] for end, part in zip(ends, others, strict=False))]),
            np.concatenate([part.columns for part in parts]),
            np.concatenate([part.weights for part in parts]),
            self.column_count,
        )

    def _on(self, above: Matrix) -> Matrix:
        """The product of this matrix and another."""
        entries, _ = above._entries(self.columns)
        counts = np.diff(above.starts)[self.columns]
        rows = np.repeat(np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts)), counts)
        weights = np.repeat(self.weights, counts) * above.weights[entries]
        return Matrix.of_entries(rows, above.columns[entries], weights, above.column_count)


def apply(matrix: Matrix | None, coarse: Floats) -> Floats:
    """(V', V) times (..., V, C) → (..., V', C). The first V are copied, as 0.0 + -0.0 would lose a sign."""
    coarse = np.asarray(coarse, dtype=np.float64)
    if matrix is None:
        return coarse.copy()
    count = coarse.shape[-2]
    columns = np.moveaxis(coarse, -2, 0)
    new = matrix.of_rows(np.arange(count, matrix.shape[0]), columns.reshape(count, -1))
    return np.concatenate([coarse, np.moveaxis(new.reshape(new.shape[0], *columns.shape[1:]), 0, -2)], axis=-2)
