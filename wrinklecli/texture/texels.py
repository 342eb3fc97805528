"""Texels of a texture, and the triangles that cover their centres."""

from collections.abc import Iterator

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.portions import portions_of

# Least barycentric coordinate of a texel's centre that lies in the inside of a triangle, not on a border that
# neighbours share.
_INSIDE = 1e-6


def covered(uvs: Floats, size: int) -> Iterator[tuple[Ints, Ints, Floats]]:
    """Find the texels of a square texture whose centres lie under triangles, some triangles at a time.

    Texture coordinates repeat, as glTF's samplers do by default: each triangle is moved into the square as a whole, by
    its middle, and what sticks out comes in on the other side.

    Args:
        uvs: (triangles, 3, 2), v downwards.
        size: Texels of a side.

    Yields:
        (hits,) texels, as row · size + column, (hits,) triangles, and (hits, 3) barycentric coordinates.
    """
    corners = (uvs - np.floor(uvs.mean(axis=1, keepdims=True))) * size - 0.5
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    low, high = np.ceil(corners.min(axis=1)).astype(np.intp), np.floor(corners.max(axis=1)).astype(np.intp)
    spans = np.maximum(high - low + 1, 0)
    # A triangle over several squares of the texture would have hits without end.
    counts = np.where((areas != 0) & (spans <= 2 * size).all(axis=1), spans[:, 0] * spans[:, 1], 0)
    for part in portions_of(counts):
        which = np.repeat(np.arange(len(counts))[part], counts[part])
        starts = np.repeat(np.cumsum(counts[part]) - counts[part], counts[part])
        rows, columns = np.divmod(np.arange(len(which)) - starts, spans[which, 0])
        points = np.column_stack([low[which, 0] + columns, low[which, 1] + rows])
        offsets = points - corners[which, 0]
        second = (offsets[:, 0] * e2[which, 1] - offsets[:, 1] * e2[which, 0]) / areas[which]
        third = (e1[which, 0] * offsets[:, 1] - e1[which, 1] * offsets[:, 0]) / areas[which]
        shares = np.column_stack([1.0 - second - third, second, third])
        inside = (shares >= -_INSIDE).all(axis=1)
        wrapped = points[inside] % size
        if inside.any():
            yield wrapped[:, 1] * size + wrapped[:, 0], which[inside], shares[inside]


def charted(uvs: Floats, size: int, wanted: Bools) -> tuple[Ints, Ints]:
    """Find the first triangle under each texel, and texels that several share.

    Where a texture repeats, most texels have dozens of triangles: pairs without a wanted one would fill memory.

    Args:
        uvs: (triangles, 3, 2), v downwards.
        size: Texels of a side.
        wanted: (triangles,) True for those of which other triangles on their texels are to be known.

    Returns:
        (size²,) triangles, −1 where there is none; and (pairs, 3) texels with two triangles, one of them wanted.
    """
    first = np.full(size * size, -1, np.intp)
    inner = np.zeros(size * size, np.bool_)
    pairs = [np.zeros((0, 3), np.intp)]
    for texels, triangles, shares in covered(uvs, size):
        deep = np.logical_and.reduce(shares > _INSIDE, axis=1)
        # Backwards, so that of several hits on one texel the first stays.
        new = first[texels] < 0
        first[texels[new][::-1]] = triangles[new][::-1]
        inner[texels[new & deep]] = True
        again = deep & (first[texels] != triangles) & inner[texels] & (wanted[first[texels]] | wanted[triangles])
        pairs.append(np.column_stack([texels, first[texels], triangles])[again])
    return first, np.concatenate(pairs)


def texture_steps(uvs: Floats, size: int) -> Floats:
    """(triangles, 2, 3) changes of the barycentric coordinates by one texel to the right, and one down."""
    e1, e2 = (uvs[:, 1] - uvs[:, 0]) * size, (uvs[:, 2] - uvs[:, 0]) * size
    areas = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    inverse = np.where(areas, 1.0 / np.where(areas, areas, 1.0), 0.0)[:, None]
    second = np.column_stack([e2[:, 1], -e2[:, 0]]) * inverse
    third = np.column_stack([-e1[:, 1], e1[:, 0]]) * inverse
    return np.stack([-second - third, second, third], axis=2)


def gutter(filled: Bools, width: int) -> tuple[Ints, Ints]:
    """The texels beside charts, and for each the nearest texel of a chart, whose value lets no border show.

    Args:
        filled: (size, size) True for the texels of charts.
        width: Greatest distance, texels.

    Returns:
        (texels,) row · size + column of both.
    """
    from scipy.ndimage import distance_transform_edt

    if filled.all() or not filled.any():
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    distances, (rows, columns) = distance_transform_edt(~filled, return_indices=True)
    beside = np.flatnonzero((distances > 0) & (distances <= width))
    return beside, rows.reshape(-1)[beside].astype(np.intp) * filled.shape[1] + columns.reshape(-1)[beside]
