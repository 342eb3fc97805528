"""Reduces many shapes to few: exactly to a tolerance, or as well as possible by weights.

Three reductions have different aims. `fewest_axes` keeps the fewest singular vectors that a caller's test accepts.
`compress` takes them of a series that is too large to hold at once, right to a tolerance in every coordinate.
`weighted_basis` fits a fixed number of shapes, each vertex of each field with its own weight: shapes of a contact must
be right to a fraction of its gap where it touches, but a tenth of the greatest move stays hidden elsewhere in the fold.

Sources:
    - C. Eckart, G. Young, *The approximation of one matrix by another of lower rank*, 1936: singular vectors. Differs:
      errors are measured in the maximum norm.
    - N. Srebro, T. Jaakkola, *Weighted Low-Rank Approximations*, ICML 2003: `weighted_basis`, by alternating least
      squares from the singular vectors of the fields. Differs: it takes a fixed number of rounds, so that the same
      fields give the same shapes.
"""

from collections.abc import Callable, Iterable

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.portions import portion, portions

# Fraction of the tolerance of `compress` by which a series may be simplified before shapes are chosen.
_SIMPLIFIED = 0.02
# Directions in which a series may move: four times as many as three.js plays morph targets.
_MOST_AXES = 1024
# Rounds of alternating least squares. After six the error hardly falls.
_ROUNDS = 6
# Regularisation, relative to the greatest weight: keeps shapes and weights at 0 where no field asks for anything.
_RIDGE = 1e-9


def fewest_axes(rows: Floats, fits: Callable[[Floats], bool]) -> Floats:
    """(axes, columns) the fewest leading right singular vectors of (rows, columns) that fit; all if no fewer do."""
    axes = np.linalg.svd(rows, full_matrices=False)[2]
    count = next((count for count in range(1, len(axes)) if fits(axes[:count])), len(axes))
    return np.asarray(axes[:count], np.float64)


def peaks_of(weights: Floats) -> Floats:
    """(columns,) the entry of greatest size, with its sign, of each column of (rows, columns)."""
    return np.asarray(weights[np.argmax(np.abs(weights), axis=0), np.arange(weights.shape[1])])


def compress(
    series: Iterable[Floats], tolerance: float, *, memory: Memory | None = None, where: str = ""
) -> tuple[Floats, Floats]:
    """Find the fewest leading singular vectors that give every frame of a series, within a tolerance.

    Args:
        series: Parts of (frames, vertices, 3) displacements, which follow one another and are looked at once.
        tolerance: Greatest error of a coordinate, in the series' unit.
        memory: What the shapes may take; by default the limit of any command.
        where: The tool that moves like that, for the message.

    Returns:
        (frames, shapes) weights in [-1, 1], of which the largest of each shape is positive, and (shapes, vertices, 3).

    Raises:
        BakeError: There are more than 1,024 shapes to choose from.
        TooMuchError: The shapes would take more memory than is left.
    """
    memory = memory or Memory()
    simplified = _SIMPLIFIED * tolerance
    axes, parts, frames = np.zeros((0, 0)), [], 0
    size: tuple[int, ...] = ()
    for part in series:
        size = part.shape[1:]
        flat = part.reshape(len(part), -1)
        axes = axes if len(axes) else np.zeros((0, flat.shape[1]))
        coordinates = flat @ axes.T
        rest = flat - coordinates @ axes
        if np.abs(rest).max(initial=0.0) > simplified:
            _, values, fresh = np.linalg.svd(rest, full_matrices=False)
            # No entry of the part that is left out exceeds its largest singular value.
            fresh = fresh[values > simplified]
            axes = np.concatenate([axes, fresh])
            coordinates = np.concatenate([coordinates, flat @ fresh.T], axis=1)
        if len(axes) > _MOST_AXES:
            raise BakeError(f"moves in more than {_MOST_AXES:,} ways, more than morph targets can follow", where=where)
        frames += len(part)
        refuse_large_series(memory, frames, flat.shape[1] // 3, len(axes), where=where)
        parts.append(coordinates)
    flat = np.concatenate([np.pad(each, ((0, 0), (0, len(axes) - each.shape[1]))) for each in parts])
    left, values, right = np.linalg.svd(flat, full_matrices=False)
    shapes = right @ axes
    rank = 0
    for rows in portions(len(flat), axes.shape[1]):
        wanted = flat[rows] @ axes
        while (
            np.abs(wanted - (left[rows, :rank] * values[:rank]) @ shapes[:rank]).max(initial=0.0)
            > tolerance - simplified
        ):
            rank += 1
    weights, shapes = left[:, :rank] * values[:rank], shapes[:rank]
    peaks = peaks_of(weights)
    return weights / peaks, (shapes * peaks[:, None]).reshape(rank, *size)


def refuse_large_series(memory: Memory, frames: int, vertices: int, shapes: int, *, where: str) -> None:
    """Raise TooMuchError if `compress` cannot hold a series that needs so many shapes."""
    width = 3 * vertices
    # Axes and shapes; checked frames, given and rebuilt; coordinates and three arrays of their size.
    numbers = 2 * shapes * width + 2 * min(frames, portion(width)) * width + 4 * frames * shapes
    what = f"{frames:,} frames of {vertices:,} vertices, as {shapes:,} shapes,"
    memory.check(8 * numbers, what, where=where)


def weighted_basis(fields: Floats, importance: Floats, count: int) -> tuple[Floats, Floats]:
    """Find shapes, and weights of them, whose sums are nearest to some fields.

    Args:
        fields: (fields, vertices, 3).
        importance: (fields, vertices) weights above 0 of squared errors.
        count: Number of shapes, at most that of the fields.

    Returns:
        (fields, count) weights and (count, vertices, 3) shapes.
    """
    scaled = (fields * np.sqrt(importance.mean(axis=0))[:, None]).reshape(len(fields), -1)
    _, vectors = np.linalg.eigh(scaled @ scaled.T)
    weights = vectors[:, ::-1][:, :count]
    shapes = np.zeros((count, *fields.shape[1:]))
    for _ in range(_ROUNDS):
        # First find the shapes at each vertex from the weights, then the weights of each field from the shapes.
        pairs = (weights[:, :, None] * weights[:, None, :]).reshape(len(fields), -1)
        normal = (importance.T @ pairs).reshape(-1, count, count)
        right = np.tensordot(weights, importance[..., None] * fields, axes=(0, 0))
        shapes = _solved(normal, right.transpose(1, 0, 2)).transpose(1, 0, 2)
        weights = project(fields, importance, shapes)
        weights = weights / np.abs(weights).max(axis=0)
    return weights, shapes


def project(fields: Floats, importance: Floats, shapes: Floats, held: tuple[Floats, Floats] | None = None) -> Floats:
    """(fields, shapes) weights of (shapes, vertices, 3) nearest to (fields, vertices, 3), by their `importance`.

    With `held`, which are (fields, vertices, 3) and (fields,), squared differences of products with the first from the
    second count too.
    """
    together = np.einsum("svx,tvx->vst", shapes, shapes)
    normal = np.tensordot(importance, together, axes=1)
    right = np.tensordot(importance[..., None] * fields, shapes, axes=((1, 2), (1, 2)))
    steady = _steadied(normal)
    if held is not None:
        along = np.tensordot(held[0], shapes, axes=((1, 2), (1, 2)))
        steady += along[:, :, None] * along[:, None, :]
        right = right + along * held[1][:, None]
    return np.asarray(np.linalg.solve(steady, right[..., None])[..., 0])


def _solved(normal: Floats, right: Floats) -> Floats:
    """(n, shapes, columns) solutions of (n, shapes, shapes) positive semidefinite systems."""
    return np.asarray(np.linalg.solve(_steadied(normal), right))


def _steadied(normal: Floats) -> Floats:
    """(n, shapes, shapes) positive semidefinite matrices with a little on their diagonals, which can be solved."""
    asked = np.trace(normal, axis1=1, axis2=2)
    ridge = _RIDGE * (asked + _RIDGE * asked.max(initial=0.0)) + 1e-30
    return np.asarray(normal + ridge[:, None, None] * np.eye(normal.shape[1]))
