"""Vectors, normals and small matrices, and which values of an array are distinct or among others.

The array types of all rooms stand here too: `Floats` are float64, `Ints` are indices, `Bools` are flags, and an `Array`
may be of any type.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
Array = NDArray[Any]

# Least singular value of a matrix over the greatest at which its inverse is still of use.
_SINGULAR = 1e-3


def unit(vectors: Floats) -> Floats:
    """Vectors (…, 3) divided by their length; 0 stays 0."""
    lengths = np.sqrt(np.sum(vectors * vectors, axis=-1, keepdims=True))
    return np.where(lengths > 0, vectors / np.where(lengths > 0, lengths, 1.0), 0.0)


def face_normals(positions: Floats, triangles: Ints) -> Floats:
    """(triangles, 3) normals, each as long as twice its triangle's area."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def vertex_normals(positions: Floats, triangles: Ints) -> Floats:
    """(vertices, 3) area-weighted unit normals; 0 where a vertex has no area around it."""
    return unit(_normal_sums(positions, triangles))


def normals_at(positions: Floats, triangles: Ints, vertices: Ints) -> Floats:
    """(chosen, 3) `vertex_normals` of (chosen,) vertices."""
    wanted = np.zeros(len(positions), bool)
    wanted[vertices] = True
    a, b, c = wanted[triangles].T
    return unit(_normal_sums(positions, triangles[a | b | c])[vertices])


def _normal_sums(positions: Floats, triangles: Ints) -> Floats:
    """(vertices, 3) sums of the normals of the triangles around each vertex."""
    faces = face_normals(positions, triangles)
    sums = [np.bincount(triangles.ravel(), np.repeat(faces[:, k], 3), len(positions)) for k in range(3)]
    return np.asarray(np.stack(sums, axis=1), np.float64)


def distinct(rows: Array) -> tuple[Ints, Ints]:
    """(distinct,) where each distinct one of (n, columns) rows is, in rising order, and (n,) which of them each row is.

    As `np.unique` along an axis, but several times as fast.
    """
    order = np.lexsort(rows.T[::-1])
    fresh = np.zeros(len(rows), bool)
    fresh[:1] = True
    for column in rows.T:
        ordered = column[order]
        fresh[1:] |= ordered[1:] != ordered[:-1]
    which = np.zeros(len(rows), np.intp)
    which[order] = np.cumsum(fresh) - 1
    return order[fresh], which


def nonzero_rows(rows: Array) -> Ints:
    """Numbers of the (n, columns) rows that are not 0 throughout, rising.

    Six times as fast by columns as `any` along rows, where these are few.
    """
    found = np.zeros(len(rows), bool)
    for column in rows.T:
        found |= column != 0
    return np.flatnonzero(found)


def distinct_values(values: Array) -> Array:
    """The values of an array, each once, rising.

    As `np.unique`, but several times as fast: numpy 2.3 and later hash the values before they sort them.
    """
    ordered = np.sort(values, axis=None)
    fresh = np.ones(len(ordered), bool)
    fresh[1:] = ordered[1:] != ordered[:-1]
    return ordered[fresh]


def median(values: Floats) -> Floats:
    """(…) the medians of (n, …) values along the first axis.

    As `np.median`, which imports `numpy.ma` to look for masks: a thirtieth of a small bake.
    """
    ordered, half = np.sort(values, axis=0), len(values) // 2
    middles: Floats = (ordered[(len(values) - 1) // 2] + ordered[half]) / 2.0
    return middles


def cross(a: Floats, b: Floats) -> list[Floats]:
    """Three (…) coordinates of the cross product of (3, …) vectors."""
    products = []
    for k in range(3):
        product = a[(k + 1) % 3] * b[(k + 2) % 3]
        product -= a[(k + 2) % 3] * b[(k + 1) % 3]
        products.append(product)
    return products


def dot(a: Floats | list[Floats], b: Floats | list[Floats]) -> Floats:
    """(…) of (3, …) vectors."""
    total: Floats = a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def inverses(matrices: Floats) -> Floats:
    """(n, 3, 3) inverses of the linear parts of (n, 3, 4) matrices; 0 where these are `singular`."""
    # By cofactors: as exact as LAPACK where matrices are far from singular, and several times as fast.
    a, b, c = np.moveaxis(matrices[:, :, :3], 0, 2)
    columns = np.array([cross(b, c), cross(c, a), cross(a, b)])
    regular = ~singular(matrices)
    determinant = np.where(regular, np.sum(a * columns[0], axis=0), 1.0)
    return np.where(regular, columns / determinant, 0.0).transpose(2, 1, 0)


def singular(matrices: Floats) -> Bools:
    """(n,) whether the least singular value of each of (n, 3, 4) linear parts is at most 1/1000 of the greatest."""
    linear = matrices[:, :, :3]
    # The product of the three is |det|, and none exceeds the Frobenius norm: most matrices need no decomposition.
    norms = np.sqrt(np.sum(linear * linear, axis=(1, 2)))
    near: Bools = np.abs(determinants(linear)) <= 2.0 * _SINGULAR * norms**3
    values = np.linalg.svd(linear[near], compute_uv=False)
    near[near] = values[:, 2] <= _SINGULAR * values[:, 0]
    return near


def determinants(matrices: Floats) -> Floats:
    """(…,) of (…, 3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrices, (-2, -1), (0, 1))
    found: Floats = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return found


def unit_quaternions(quaternions: Floats) -> Floats:
    """Quaternions (4, …), x, y, z and w, of unit length; no turn where all are 0."""
    lengths = np.sqrt(np.einsum("c...,c...->...", quaternions, quaternions))
    unturned = np.array([0.0, 0.0, 0.0, 1.0]).reshape(4, *[1] * (quaternions.ndim - 1))
    return np.where(lengths > 0, quaternions / np.where(lengths > 0, lengths, 1.0), unturned)


def affine_rows(translations: Floats, rotations: Floats, scales: Floats) -> Floats:
    """(3, 4, frames) upper rows of the matrices that scale, then rotate, then translate.

    Args:
        translations: (3, frames); this and the others may have one frame for all.
        rotations: (4, frames) quaternions (x, y, z, w) of unit length.
        scales: (3, frames).
    """
    x, y, z, w = rotations
    sx, sy, sz = scales
    (xx, xy, xz), (yy, yz, zz), (xw, yw, zw) = (x * x, x * y, x * z), (y * y, y * z, z * z), (x * w, y * w, z * w)
    rows = (
        ((1 - 2 * (yy + zz)) * sx, 2 * (xy - zw) * sy, 2 * (xz + yw) * sz),
        (2 * (xy + zw) * sx, (1 - 2 * (xx + zz)) * sy, 2 * (yz - xw) * sz),
        (2 * (xz - yw) * sx, 2 * (yz + xw) * sy, (1 - 2 * (xx + yy)) * sz),
    )
    matrices = np.zeros((3, 4, max(each.shape[1] for each in (translations, rotations, scales))))
    for row, translation, into in zip(rows, translations, matrices, strict=True):
        into[0], into[1], into[2], into[3] = *row, translation
    return matrices


def float32_values(values: Floats) -> Floats:
    """The nearest float32 values, as a file holds them."""
    return values.astype(np.float32).astype(np.float64)


def among(values: Ints, ascending: Ints) -> Bools:
    """(n,) whether each of (n,) values is one of some, which ascend."""
    found: Bools = np.searchsorted(ascending, values, "right") > np.searchsorted(ascending, values)
    return found


def any_of(flags: Bools, members: Ints) -> Bools:
    """(n,) whether any of the three members of (n, 3) is flagged; several times faster than `any`."""
    a, b, c = members.T
    found: Bools = flags[a] | flags[b] | flags[c]
    return found


def flags_of(members: Ints, count: int) -> Bools:
    """(count,) True at the members."""
    flags = np.zeros(count, dtype=np.bool_)
    flags[members] = True
    return flags


def children(parents: Ints, chosen: Ints) -> Ints:
    """Those, rising, whose parent is one of (chosen,) rising ones, from the (n,) parents of each, which ascend."""
    first, last = np.searchsorted(parents, chosen), np.searchsorted(parents, chosen, "right")
    return runs(first, last - first)


def runs(firsts: Ints, counts: Ints) -> Ints:
    """One run of whole numbers after another: (n,) first numbers, and (n,) how many each run has."""
    begins = np.cumsum(counts) - counts
    found: Ints = np.arange(int(counts.sum())) + np.repeat(firsts - begins, counts)
    return found


@dataclass(frozen=True, slots=True)
class Places:
    """Where an array holds each value: looked up without a look at all of it.

    Attributes:
        ordered: (n,) its values, rising.
        order: (n,) the place of each in the array.
    """

    ordered: Ints
    order: Ints

    @classmethod
    def of(cls, values: Ints) -> "Places":
        """Sort (n,) values."""
        order = np.argsort(values, kind="stable")
        return cls(values[order], order)

    def holding(self, values: Ints) -> tuple[Ints, Ints]:
        """(found,) the places, rising, of (values,) distinct ones, and (found,) which of these each place holds."""
        first, last = np.searchsorted(self.ordered, values), np.searchsorted(self.ordered, values, "right")
        places, which = self.order[runs(first, last - first)], np.repeat(np.arange(len(values)), last - first)
        rising = np.argsort(places)
        return places[rising], which[rising]


def interpolated(at: Floats, points: Floats, columns: Floats) -> Floats:
    """(places, columns) straight between (points, columns) of rising (points,), at (places,); held beyond the ends."""
    found = [np.interp(at, points, column) for column in columns.T]
    return np.stack(found, axis=1) if found else np.zeros((len(at), 0))


def pieces_of(links: Ints, count: int) -> Ints:
    """(count,) the same number for those that hang together by (links, 2), numbered in the order of their first."""
    # Imported here, as it takes longer than many a bake.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    _, pieces = connected_components(graph, directed=False)
    return np.asarray(pieces, np.intp)
