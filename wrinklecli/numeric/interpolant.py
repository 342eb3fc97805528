"""Approximates smooth functions on [0, 1] by polynomials on equal pieces, which are quick to evaluate."""

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats

FIT_ERROR = 1e-13
"""Size of an interpolant's last coefficients, relative to its largest."""

# Pieces of an interpolant: 56 kB, which a core's cache holds. Values are right to 5e-13 of the greatest; with half as
# many pieces to 3e-12.
_PIECES = 1024


@dataclass(frozen=True, slots=True, eq=False)
class Interpolant:
    """A polynomial of degree 6 on each of many equal pieces of [0, 1].

    One Chebyshev series for all pieces, of 35 to 128 terms, takes three to ten times as long.

    Attributes:
        coefficients: (7, pieces) from the constant up, of the position within the piece, 0 to 1.
    """

    coefficients: Floats

    def __call__(self, points: Floats) -> Floats:
        """(…) values at (…) points."""
        count = self.coefficients.shape[1]
        scaled = points * count
        pieces = np.minimum(scaled.astype(np.intp), count - 1)
        within = scaled - pieces
        # `pieces` are in range, so "clip" only avoids a check, which takes half as long again.
        value: Floats = self.coefficients[6].take(pieces, mode="clip")
        for row in self.coefficients[5::-1]:
            value *= within
            value += row.take(pieces, mode="clip")
        return value


def interpolate(function: Callable[[Floats], Floats]) -> Interpolant:
    """Approximate a function on [0, 1] through a Chebyshev series as long as `FIT_ERROR` needs."""
    coefficients = np.zeros(1)
    for degree in (63, 127, 255, 511):
        points = chebyshev.chebpts1(degree + 1)
        # The mean of f T_k over these points, doubled but for k = 0: interpolation in closed form.
        basis = chebyshev.chebvander(points, degree)
        coefficients = np.einsum("pk,p->k", basis, function((points + 1) / 2)) * 2 / (degree + 1)
        coefficients[0] /= 2
        bound = FIT_ERROR * np.max(np.abs(coefficients))
        if np.max(np.abs(coefficients[-degree // 8 :])) < bound:
            break
    series = chebyshev.chebtrim(coefficients, FIT_ERROR / 10)
    nodes = (1 - np.cos(np.pi * np.arange(7) / 6)) / 2
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    places = (np.arange(_PIECES)[:, None] + nodes) / _PIECES
    return Interpolant(np.ascontiguousarray(inverse @ chebyshev.chebval(2 * places - 1, series).T))
