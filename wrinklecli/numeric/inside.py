"""The points of a grid that lie within a surface of triangles.

Rays go from each point along the axes, both ways. A ray leaves a closed surface once more often than it enters it, if
it starts inside. Most of the six rays decide, so bodies that are open at a neck or at wrists have an inside too.
"""

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints

# Most rays of six that say "inside" outside a surface with holes: those that go in through a hole.
_STRAY = 3
# Rays pass beside the points by this part of the grid's step: vertices of symmetric bodies lie on the grid.
_BESIDE = np.array([1.1e-5, 2.7e-5, 4.3e-5])


def inside_grid(low: Floats, step: float, counts: Ints, positions: Floats, triangles: Ints) -> Bools:
    """(x, y, z) True for the points of a grid within a surface, whichever way its triangles are wound.

    Args:
        low: (3,) the first point.
        step: The distance of neighbouring points.
        counts: (3,) the number of points along each axis.
        positions: (vertices, 3) of the surface.
        triangles: (triangles, 3).
    """
    corners = ((positions - low) / step - _BESIDE)[triangles]
    votes = np.zeros(tuple(counts.tolist()), np.intp)
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        shape = [int(counts[each]) for each in (*others, axis)]
        crossed = _crossings(corners[:, :, [*others, axis]], shape)
        # Crossings with an index up to k lie below the point k.
        below = np.cumsum(crossed, axis=2)[:, :, :-1]
        above = crossed.sum(axis=2, keepdims=True) - below
        votes += np.moveaxis((below != 0).astype(np.intp) + (above != 0), (0, 1, 2), (*others, axis))
    return np.asarray(votes > _STRAY)


def _crossings(corners: Floats, shape: list[int]) -> Ints:
    """(u, v, w + 1) signed counts of the crossings of each ray, by the first point that lies above a crossing.

    Args:
        corners: (triangles, 3, 3) in steps of the grid; rays run along the last axis.
        shape: The numbers of points u, v, w.
    """
    found = np.zeros((*shape[:2], shape[2] + 1), np.intp)
    first = np.maximum(np.ceil(corners[:, :, :2].min(axis=1)), 0).astype(np.intp)
    last = np.minimum(np.floor(corners[:, :, :2].max(axis=1)), np.array(shape[:2]) - 1).astype(np.intp)
    spans = np.maximum(last - first + 1, 0)
    pairs = spans.prod(axis=1)
    which = np.repeat(np.arange(len(corners)), pairs)
    if not len(which):
        return found
    number = np.arange(len(which)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    u, v = first[which].T + np.divmod(number, spans[which, 1])
    a, b, c = corners[which].transpose(1, 2, 0)
    sides = [(q[0] - p[0]) * (v - p[1]) - (q[1] - p[1]) * (u - p[0]) for p, q in ((b, c), (c, a), (a, b))]
    signs = np.sign(sides[0]).astype(np.intp)
    hit = (np.sign(sides[1]) == signs) & (np.sign(sides[2]) == signs) & (signs != 0)
    area = (sides[0] + sides[1] + sides[2])[hit]
    height = sum(side[hit] * corner[2, hit] for side, corner in zip(sides, (a, b, c), strict=True)) / area
    place = np.clip(np.ceil(height), 0, shape[2]).astype(np.intp)
    np.add.at(found, (u[hit], v[hit], place), signs[hit])
    return found
