"""Vectors, normals, small matrices, sorted values and connected components.

All rooms take their array types from here: `Floats` are float64, `Ints` are indices, `Bools` are flags, and an `Array`
may have any type.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wrinklecli.frozen import dataclass

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
Array = NDArray[Any]
_Flags = TypeVar("_Flags", NDArray[np.bool_], NDArray[np.uint8])

TINY = 1e-300
"""Replaces a divisor of 0, below which nothing is 0 either."""
PLASTIC = 0.7548776662466927
"""Inverse of the plastic number: multiples of it and of its square are spread evenly (M. Roberts, 2018)."""

# Ratio of the least to the greatest singular value, at or below which a matrix counts as singular.
_SINGULAR = 1e-3
# Fraction of a mesh's vertices above which one look at all triangles is faster than gathering those round each vertex.
_MANY = 1 / 16
# Range of indices, over their number, up to which one look at flags of all of them is faster than sorting the indices.
_DENSE = 8


def unit(vectors: Floats) -> Floats:
    """Vectors (…, 3) divided by their length; 0 stays 0."""
    # Coordinate by coordinate, as numpy takes twice as long along an axis of three.
    x, y, z = vectors[..., :1], vectors[..., 1:2], vectors[..., 2:]
    lengths = np.sqrt(x * x + y * y + z * z)
    empty = ~(lengths > 0)
    units: Floats = vectors / np.where(empty, 1.0, lengths)
    if empty.any():
        units[empty[..., 0]] = 0.0
    return units


def face_normals(positions: Floats, triangles: Ints) -> Floats:
    """(triangles, 3) normals, each as long as twice its triangle's area."""
    a, b, c = (positions.T.take(triangles[:, k], axis=1) for k in range(3))
    return np.stack(cross(b - a, c - a), axis=1)


def vertex_normals(positions: Floats, triangles: Ints) -> Floats:
    """(vertices, 3) area-weighted unit normals; 0 where a vertex has no area around it."""
    return unit(normal_sums(face_normals(positions, triangles), triangles, len(positions)))


def normals_at(positions: Floats, triangles: Ints, vertices: Ints) -> Floats:
    """(chosen, 3) `vertex_normals` of (chosen,) vertices."""
    faces = triangles[any_of(flags_of(vertices, len(positions)), triangles)]
    return unit(normal_sums(face_normals(positions, faces), faces, len(positions))[vertices])


def normal_sums(faces: Floats, triangles: Ints, count: int) -> Floats:
    """(vertices, 3) sums of the (triangles, 3) normals `faces` around each of so many vertices."""
    sums = [np.bincount(triangles.ravel(), np.repeat(faces[:, k], 3), count) for k in range(3)]
    return np.asarray(np.stack(sums, axis=1), np.float64)


def diagonal(points: Array) -> float:
    """The diagonal of the box round (points, 3), whose axes numpy reduces ten times as fast one by one."""
    return float(np.linalg.norm([np.ptp(axis) for axis in points.T]))


def joined(parts: Sequence[Array], axis: int = 0) -> Array:
    """Arrays one behind the other along an axis; a single one itself, as a large copy costs more than what needs it."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=axis)


def distinct(rows: Array) -> tuple[Ints, Ints]:
    """(distinct,) indices of the distinct (n, columns) rows, sorted by value, and (n,) which of them each row equals.

    Several times as fast as `np.unique` along an axis.
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
    """Sorted indices of the (n, columns) rows with a value other than 0.

    Looking at one column after another is six times as fast as `any` along short rows.
    """
    found = np.zeros(len(rows), bool)
    for column in rows.T:
        found |= column != 0
    return np.flatnonzero(found)


def are_nonzero(vectors: Floats) -> Bools:
    """(…,) True where a coordinate of (…, 3) vectors is not 0; ten times as fast as `any` along an axis of three."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.asarray((x != 0) | (y != 0) | (z != 0))


def greatest_coordinates(vectors: Floats) -> Floats:
    """(…,) the greatest coordinate of (…, 3) vectors, without its sign; nine times as fast as `max` along an axis."""
    x, y, z = np.moveaxis(np.abs(vectors), -1, 0)
    return np.asarray(np.maximum(np.maximum(x, y), z))


def distinct_values(values: Array) -> Array:
    """The distinct values of an array, sorted.

    Several times as fast as `np.unique`: numpy 2.3 and later hash the values before they sort them.
    """
    if values.dtype == np.intp and values.size and values.max() < _DENSE * values.size and values.min() >= 0:
        return np.flatnonzero(flags_of(values, int(values.max()) + 1))
    ordered = np.sort(values, axis=None)
    fresh = np.ones(len(ordered), bool)
    fresh[1:] = ordered[1:] != ordered[:-1]
    return ordered[fresh]


def renumbered(values: Ints) -> tuple[Ints, Ints]:
    """The distinct values of an array, sorted, and for each of its values the number among these, in its shape."""
    distinct, numbers = np.unique(values, return_inverse=True)
    return distinct, numbers.reshape(values.shape)  # which numpy 1 and 2.0 leave flat


def median(values: Floats) -> Floats:
    """(…) medians of (n, …) values along the first axis.

    `np.median` imports `numpy.ma` to look for masks, which takes a thirtieth of a small bake.
    """
    ordered, half = np.sort(values, axis=0), len(values) // 2
    return np.asarray((ordered[(len(values) - 1) // 2] + ordered[half]) / 2.0)


def weighted_quantiles(values: Floats, weights: Floats, parts: Floats) -> Floats:
    """(parts,) the least of (n,) values up to which the sorted values have these parts of the (n,) weights."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    places = np.searchsorted(total, parts * total[-1])
    return np.asarray(values[order[np.minimum(places, len(order) - 1)]])


def cross(a: Floats | list[Floats], b: Floats | list[Floats]) -> list[Floats]:
    """Three (…) coordinates of the cross products of (3, …) vectors."""
    products = []
    for k in range(3):
        product = a[(k + 1) % 3] * b[(k + 2) % 3]
        product -= a[(k + 2) % 3] * b[(k + 1) % 3]
        products.append(product)
    return products


def dot(a: Floats | list[Floats], b: Floats | list[Floats]) -> Floats:
    """(…) dot products of (3, …) vectors."""
    total: Floats = a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def inverses(matrices: Floats) -> Floats:
    """(n, 3, 3) inverses of the linear parts of (n, 3, 4) matrices; 0 where they are `singular`."""
    # Cofactors are as exact as LAPACK far from singular matrices, and several times as fast.
    a, b, c = rows = np.ascontiguousarray(matrices[:, :, :3].transpose(1, 2, 0))
    columns = np.array([cross(b, c), cross(c, a), cross(a, b)])
    determinant = dot(a, columns[0])
    regular = ~_are_singular(rows, determinant)
    return np.where(regular, columns / np.where(regular, determinant, 1.0), 0.0).transpose(2, 1, 0)


def singular(matrices: Floats) -> Bools:
    """(n,) True where the least singular value of the linear part of (n, 3, 4) is at most 1/1000 of the greatest."""
    return _are_singular(matrices[:, :, :3].transpose(1, 2, 0), determinants(matrices[:, :, :3]))


def _are_singular(rows: Floats, determinant: Floats) -> Bools:
    """(n,) the same of (3, 3, n) matrices with (n,) determinants."""
    # The product of all three is |det|, and none exceeds the Frobenius norm, so most matrices need no decomposition.
    norms = np.sqrt(np.square(rows).sum(axis=(0, 1)))
    near: Bools = np.abs(determinant) <= 2.0 * _SINGULAR * norms**3
    if near.any():
        values = np.linalg.svd(rows[:, :, near].transpose(2, 0, 1), compute_uv=False)
        near[near] = values[:, 2] <= _SINGULAR * values[:, 0]
    return near


def determinants(matrices: Floats) -> Floats:
    """(…,) determinants of (…, 3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrices, (-2, -1), (0, 1))
    return np.asarray(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def unit_quaternions(quaternions: Floats) -> Floats:
    """Quaternions (4, …), x, y, z and w, scaled to unit length; the identity where all are 0."""
    lengths = np.sqrt(np.einsum("c...,c...->...", quaternions, quaternions))
    unturned = np.array([0.0, 0.0, 0.0, 1.0]).reshape(4, *[1] * (quaternions.ndim - 1))
    return np.where(lengths > 0, quaternions / np.where(lengths > 0, lengths, 1.0), unturned)


def affine_rows(translations: Floats, rotations: Floats, scales: Floats) -> Floats:
    """(3, 4, …) upper rows of the matrices that scale, then rotate, then translate.

    Args:
        translations: (3, …). Each argument may have one for all along an axis.
        rotations: (4, …) quaternions (x, y, z, w) of unit length.
        scales: (3, …).
    """
    x, y, z, w = rotations
    sx, sy, sz = scales
    (xx, xy, xz), (yy, yz, zz), (xw, yw, zw) = (x * x, x * y, x * z), (y * y, y * z, z * z), (x * w, y * w, z * w)
    rows = (
        ((1 - 2 * (yy + zz)) * sx, 2 * (xy - zw) * sy, 2 * (xz + yw) * sz),
        (2 * (xy + zw) * sx, (1 - 2 * (xx + zz)) * sy, 2 * (yz - xw) * sz),
        (2 * (xz - yw) * sx, 2 * (yz + xw) * sy, (1 - 2 * (xx + yy)) * sz),
    )
    matrices = np.zeros((3, 4, *np.broadcast_shapes(*(each.shape[1:] for each in (translations, rotations, scales)))))
    for row, translation, into in zip(rows, translations, matrices, strict=True):
        into[0], into[1], into[2], into[3] = *row, translation
    return matrices


def composed_rows(outer: Floats, inner: Floats) -> Floats:
    """(3, 4, frames) upper rows of the products of affine matrices; each argument may have one frame for all."""
    product: Floats = outer[:, 0, None] * inner[0]
    product = product + outer[:, 1, None] * inner[1]
    product += outer[:, 2, None] * inner[2]
    product[:, 3] += outer[:, 3]
    return product


def float32_values(values: Floats) -> Floats:
    """The nearest float32 values, as a file holds them."""
    return values.astype(np.float32).astype(np.float64)


def among(values: Ints, ascending: Ints) -> Bools:
    """(n,) True where a value is one of the `ascending` ones, which are sorted."""
    return np.searchsorted(ascending, values, "right") > np.searchsorted(ascending, values)


def any_of(flags: _Flags, members: Ints) -> _Flags:
    """(n,) what is flagged at any of the members of (n, k), or its bits; several times as fast as `any`."""
    found: _Flags = reduce(np.bitwise_or, [flags[each] for each in members.T])
    return found


def flags_of(members: Ints, count: int) -> Bools:
    """(count,) True at the indices `members`."""
    flags = np.zeros(count, dtype=np.bool_)
    flags[members] = True
    return flags


def places_of(members: Ints, count: int, absent: int = 0) -> Ints:
    """(count,) the place of each index in (members,) different ones; another number for those that are absent."""
    places = np.full(count, absent, np.intp)
    places[members] = np.arange(len(members))
    return places


def groups_of(numbers: Ints) -> list[Ints]:
    """The sorted indices of each distinct number, one number after another."""
    order = np.argsort(numbers, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1) if len(numbers) else []


def children(parents: Ints, chosen: Ints) -> Ints:
    """Sorted indices of the (n,) sorted `parents` that are among (chosen,) sorted ones."""
    first, last = np.searchsorted(parents, chosen), np.searchsorted(parents, chosen, "right")
    return runs(first, last - first)


def runs(firsts: Ints, counts: Ints) -> Ints:
    """Concatenate runs of consecutive whole numbers, each with its first number and its count."""
    begins = np.cumsum(counts) - counts
    return np.asarray(np.arange(int(counts.sum())) + np.repeat(firsts - begins, counts))


@dataclass(frozen=True, slots=True)
class ValueIndex:
    """Finds values in an array without a look at all of it.

    Attributes:
        ordered: (n,) the sorted values.
        order: (n,) the position of each in the array.
    """

    ordered: Ints
    order: Ints

    @classmethod
    def of(cls, values: Ints) -> "ValueIndex":
        """Index (n,) values."""
        order = np.argsort(values, kind="stable")
        return cls(values[order], order)

    def holding(self, values: Ints) -> tuple[Ints, Ints]:
        """(found,) sorted positions of (values,) distinct values, and (found,) which of these each position holds."""
        first, last = np.searchsorted(self.ordered, values), np.searchsorted(self.ordered, values, "right")
        places, which = self.order[runs(first, last - first)], np.repeat(np.arange(len(values)), last - first)
        order = np.argsort(places)
        return places[order], which[order]


def interpolated(at: Floats, points: Floats, columns: Floats) -> Floats:
    """(places, columns) linear interpolation of (points, columns) at sorted (points,), held beyond both ends."""
    found = [np.interp(at, points, column) for column in columns.T]
    return np.stack(found, axis=1) if found else np.zeros((len(at), 0))


def bilinear(grid: Array, cells: Floats) -> Floats:
    """(points,) values of a map at (points, 2) row and column in cells, linear between the cells' middles."""
    low = np.minimum(cells.astype(np.intp), np.array(grid.shape) - 2)  # in a single row, -1 and 0 are the same one
    (s, t), (i, j) = (cells - low).T, low.T
    before, after = ((1.0 - t) * grid[k, j] + t * grid[k, j + 1] for k in (i, i + 1))
    return np.asarray((1.0 - s) * before + s * after)


def smoothstep(t: Floats, factor: Floats | float = 1.0) -> Floats:
    """(…) a factor times 3t² - 2t³, which rises from 0 to 1 over [0, 1] and is level at both ends."""
    # The factor comes first, as rounding depends on the order of the products.
    return factor * t * t * (3.0 - 2.0 * t)


def bounded(sizes: Floats) -> Floats:
    """(…) factors that keep sizes below 1: near 1 for small sizes, and towards the inverse for great ones."""
    return np.asarray((1.0 + sizes**4) ** -0.25)


def ramp(values: Floats, low: float, high: float) -> Floats:
    """(…) parts of the way from `low`, where it is 0, to `high`, which may be the lower one, and 1 beyond that."""
    return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))


def significant(value: float, digits: int = 9) -> float:
    """Round a value to some significant decimal digits: nine of them distinguish all float32 values."""
    return float(f"{value:.{digits}g}")


def components(links: Ints, count: int) -> Ints:
    """(count,) the connected component of each thing by (links, 2), numbered in the order of their first things.

    Labels sink to the least among neighbours, roots hook on to them, and each label is replaced by its own: a path of
    90,000 things takes 18 rounds, all together a quarter of the time that importing scipy's search takes.
    """
    both = np.concatenate([links, links[:, ::-1]])
    things, others = both[np.argsort(both[:, 0], kind="stable")].T
    starts = np.flatnonzero(np.diff(things, prepend=-1))
    linked, labels = things[starts], np.arange(count)
    while len(starts):
        lowest = np.minimum.reduceat(labels[others], starts)
        lower = labels.copy()
        np.minimum.at(lower, labels[linked], lowest)
        lower[linked] = np.minimum(lower[linked], lowest)
        lower = lower[lower]
        if np.array_equal(lower, labels):
            break
        labels = lower
    return np.searchsorted(distinct_values(labels), labels)


def root_of(roots: list[int] | dict[int, int], thing: int) -> int:
    """The root of a thing, by the thing that each one leads to; roots lead to themselves. It shortens the way."""
    while roots[thing] != thing:
        roots[thing] = thing = roots[roots[thing]]
    return thing


@dataclass(frozen=True, slots=True)
class VertexFaces:
    """The triangles round each vertex.

    Attributes:
        triangles: (triangles, 3) vertices.
        starts: (vertices + 1,) where each vertex starts in `faces`.
        faces: (3 triangles,) the sorted triangles of one vertex after another.
    """

    triangles: Ints
    starts: Ints
    faces: Ints

    @classmethod
    def of(cls, triangles: Ints, vertex_count: int) -> "VertexFaces":
        """Sort (triangles, 3) by their vertices."""
        counts, size = np.bincount(triangles.ravel(), minlength=vertex_count), triangles.size
        # Sorting vertices together with their places is eight times as fast as a stable `argsort` of whole numbers.
        places = np.sort(triangles.ravel() * size + np.arange(size)) % max(size, 1)
        return cls(triangles, np.append(0, np.cumsum(counts)), places // 3)

    def faces_of(self, vertices: Ints) -> Ints:
        """Sorted triangles that have any of (vertices,)."""
        if self._are_many(vertices):
            return np.flatnonzero(any_of(flags_of(vertices, len(self.starts) - 1), self.triangles))
        first, counts = self.starts[vertices], self.starts[vertices + 1] - self.starts[vertices]
        return distinct_values(self.faces[runs(first, counts)])

    def normals_at(self, positions: Floats, vertices: Ints) -> Floats:
        """(chosen, 3) `vertex_normals` of (chosen,) vertices."""
        if self._are_many(vertices):
            return normals_at(positions, self.triangles, vertices)
        faces = self.triangles[self.faces_of(vertices)]
        used = distinct_values(np.concatenate([faces.ravel(), vertices]))
        return normals_at(positions[used], np.searchsorted(used, faces), np.searchsorted(used, vertices))

    def _are_many(self, vertices: Ints) -> bool:
        return len(vertices) > _MANY * (len(self.starts) - 1)


@dataclass(frozen=True, eq=False, slots=True)
class KnownRows:
    """Rows of an array, each found when it is first asked for: the steps of a bake ask for the same few of a mesh.

    Attributes:
        rows: (count, 3), 0 where a row is not known yet.
        known: (count,)
    """

    rows: Floats
    known: Bools

    @classmethod
    def of(cls, count: int) -> "KnownRows":
        """None of so many rows is known."""
        return cls(np.zeros((count, 3)), np.zeros(count, np.bool_))

    def at(self, wanted: Ints, find: Callable[[Ints], Floats]) -> Floats:
        """(wanted, 3) rows; `find` gives those of sorted numbers that are not known."""
        missing = distinct_values(wanted[~self.known[wanted]])
        if len(missing):
            self.rows[missing] = find(missing)
            self.known[missing] = True
        return self.rows[wanted]


def matches(vertices: Ints, wanted: Ints) -> tuple[Ints, Ints]:
    """(n,) which of (vertices,) are any of (wanted,) sorted ones, and (n,) which of these each is."""
    order = np.argsort(vertices, kind="stable")
    firsts, ends = (np.searchsorted(vertices, wanted, side, order) for side in ("left", "right"))
    return order[runs(firsts, ends - firsts)], np.repeat(np.arange(len(wanted)), ends - firsts)
