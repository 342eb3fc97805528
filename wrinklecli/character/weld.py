"""Tells which vertices are the same point of a surface, wherever that is asked.

A file stores a point several times along seams of textures, normals and primitives, and exporters round each copy in
its own way: the last vertex of a cylinder is at the sine of 2π, and Draco rounds each primitive separately.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, diagonal, distinct_values, flags_of
from wrinklecli.numeric.cells import leaders

# Greatest difference of the positions of one point, and of its morph deltas, along each axis, relative to the diagonal
# of the box round the mesh: a dozen roundings of float32.
SAME = 1e-6
# Greatest difference of its normalised skin weights: a byte stores them in steps of 4e-3, float16 in steps of 5e-4.
_SAME_WEIGHTS = 1e-4
# Most times that all values are compared. Values that chains connect in one order and not in another need a second.
_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class Weld:
    """The points of a surface.

    Attributes:
        points: (vertices,) the point of each vertex; points are in the order of their first vertices.
        models: (points,) the vertex whose values a point takes: that with the least ones, whatever the vertices' order.
        twins: (points,) True if another point, which moves differently, lies at the same place.
    """

    points: Ints
    models: Ints
    twins: Bools


def weld(positions: Floats, morph_deltas: Floats, joints: Ints, weights: Floats, seen: Bools | None = None) -> Weld:
    """Find the points of a surface: vertices at one place that move alike, as a place alone would glue touching lips.

    Values that a chain of others connects are one.

    Args:
        positions: (vertices, 3) bind space.
        morph_deltas: (morph targets, vertices, 3).
        joints: (vertices, influences) distinct sorted joints.
        weights: (vertices, influences) normalised.
        seen: (vertices,) those whose box tells the size of the mesh; files hold odd values where nothing is drawn.
    """
    inside = np.ones(len(positions), np.bool_)
    if seen is not None and seen.any():
        for axis in positions.T:
            inside &= (axis >= axis[seen].min()) & (axis <= axis[seen].max())
    size = diagonal(positions[inside])
    firsts = np.arange(len(positions))
    for part, reach in ((np.flatnonzero(inside), SAME * size), (np.flatnonzero(~inside), 0.0)):
        firsts[part] = part[leaders(positions.take(part, axis=0), reach)]
    places = firsts.copy()

    shared = np.flatnonzero(np.bincount(firsts, minlength=len(firsts))[firsts] > 1)
    first = firsts[shared]
    equal = np.ones(len(shared), np.bool_)
    for columns in (positions, joints, weights, *morph_deltas):
        for column in columns.T:
            equal &= column[shared] == column[first]
    rows = shared[flags_of(first[~equal], len(firsts))[first]]
    models = firsts.copy()
    if len(rows):
        columns = _columns(positions, morph_deltas, joints, weights, rows, SAME * size)
        rows, groups = _split(rows, firsts[rows], columns)
        firsts[rows] = np.minimum.reduceat(rows, np.flatnonzero(np.diff(groups, prepend=-1)))[groups]
        models[firsts[rows]] = _least(rows, groups, columns)[groups]
    leads = firsts == np.arange(len(firsts))
    at = places[leads]
    return Weld((np.cumsum(leads) - 1)[firsts], models[leads], np.bincount(at, minlength=1)[at] > 1)


# Gives the values of (rows,) vertices, which differ by so much at most in one point.
_Column = tuple[Callable[[Ints], Floats], float]


def _columns(
    positions: Floats, morph_deltas: Floats, joints: Ints, weights: Floats, rows: Ints, reach: float
) -> list[_Column]:
    """All values of (rows,) vertices that lie at one place: coordinates, weights of each joint, morph deltas."""

    def weight(joint: int, chosen: Ints) -> Floats:
        found = np.zeros(len(chosen))
        for numbers, shares in zip(joints.T, weights.T, strict=True):
            found += np.where(numbers[chosen] == joint, shares[chosen], 0.0)
        return found

    acting = distinct_values(joints[rows][weights[rows] > 0]).tolist()
    columns: list[_Column] = [(positions[:, axis].take, np.inf) for axis in range(3)]
    columns += [(partial(weight, joint), _SAME_WEIGHTS) for joint in acting]
    columns += [(deltas[:, axis].take, reach) for deltas in morph_deltas for axis in range(3)]
    return columns


def _split(rows: Ints, places: Ints, columns: Sequence[_Column]) -> tuple[Ints, Ints]:
    """Split (rows,) vertices, with the place of each, where sorted values have a gap.

    Returns:
        The (rows,) vertices again, by groups, and the (rows,) group of each, from 0.
    """
    order = np.argsort(places, kind="stable")
    rows, groups = rows[order], np.cumsum(np.diff(places[order], prepend=-1) != 0) - 1
    for _ in range(_ROUNDS):
        before = int(groups[-1])
        for values, gap in columns:
            if gap == np.inf:
                continue
            column, starts = values(rows), np.flatnonzero(np.diff(groups, prepend=-1))
            spread = np.maximum.reduceat(column, starts) - np.minimum.reduceat(column, starts)
            if (spread > gap).any():
                order = np.lexsort((column, groups))
                rows, groups, column = rows[order], groups[order], column[order]
                fresh = (np.diff(groups, prepend=-1) != 0) | (np.diff(column, prepend=column[0]) > gap)
                groups = np.cumsum(fresh) - 1
        if groups[-1] == before:
            break
    return rows, groups


def _least(rows: Ints, groups: Ints, columns: Sequence[_Column]) -> Ints:
    """(groups,) the one of the (rows,) vertices, by groups, with the least values of each; of equal ones the first."""
    for values, _ in columns:
        starts = np.flatnonzero(np.diff(groups, prepend=-1))
        if len(starts) == len(rows):
            break
        column = values(rows)
        kept = column == np.minimum.reduceat(column, starts)[groups]
        rows, groups = rows[kept], groups[kept]
    return rows[np.flatnonzero(np.diff(groups, prepend=-1))]
