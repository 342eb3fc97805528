"""A basis: few shapes that make many fields of displacements, the most exactly where it matters most.

Not in the paper. A fold that touches needs shapes that are right to a fraction of its gap where it touches, and only
there; elsewhere a tenth of the greatest move is hidden in the fold.

Source: N. Srebro, T. Jaakkola, *Weighted Low-Rank Approximations*, ICML 2003, by alternating least squares from the
singular vectors of the fields; a fixed number of rounds, so that the same fields give the same shapes.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats

# Rounds of alternating least squares. After six the error hardly falls.
_ROUNDS = 6
# What holds shapes and weights down where nothing asks for them, of what asks most.
_RIDGE = 1e-9


def weighted_basis(fields: Floats, shares: Floats, count: int) -> tuple[Floats, Floats]:
    """The shapes, and weights of them, whose sums are nearest to some fields.

    Args:
        fields: (fields, vertices, 3).
        shares: (fields, vertices) what the square of an error counts there, above 0.
        count: Of shapes, at most as many as there are fields.

    Returns:
        (fields, count) weights and (count, vertices, 3) shapes.
    """
    scaled = (fields * np.sqrt(shares.mean(axis=0))[:, None]).reshape(len(fields), -1)
    _, vectors = np.linalg.eigh(scaled @ scaled.T)
    weights = vectors[:, ::-1][:, :count]
    shapes = np.zeros((count, *fields.shape[1:]))
    for _ in range(_ROUNDS):
        # Of each vertex the shapes, under the weights; then of each field the weights, under the shapes.
        pairs = (weights[:, :, None] * weights[:, None, :]).reshape(len(fields), -1)
        normal = (shares.T @ pairs).reshape(-1, count, count)
        right = np.tensordot(weights, shares[..., None] * fields, axes=(0, 0))
        shapes = _solved(normal, right.transpose(1, 0, 2)).transpose(1, 0, 2)
        weights = project(fields, shares, shapes)
        weights = weights / np.abs(weights).max(axis=0)
    return weights, shapes


def project(fields: Floats, shares: Floats, shapes: Floats) -> Floats:
    """(fields, shapes) the weights of (shapes, vertices, 3) that make (fields, vertices, 3) best, by their shares."""
    together = np.einsum("svx,tvx->vst", shapes, shapes)
    normal = np.tensordot(shares, together, axes=1)
    right = np.tensordot(shares[..., None] * fields, shapes, axes=((1, 2), (1, 2)))
    return np.asarray(_solved(normal, right[..., None])[..., 0])


def _solved(normal: Floats, right: Floats) -> Floats:
    """(n, shapes, columns) solutions of (n, shapes, shapes) systems that are not negative."""
    asked = np.trace(normal, axis1=1, axis2=2)
    ridge = _RIDGE * (asked + _RIDGE * asked.max(initial=0.0)) + 1e-30
    return np.linalg.solve(normal + ridge[:, None, None] * np.eye(normal.shape[1]), right)
