"""Diffusion over a triangulated surface: the cotangent matrix, areas of vertices, and averages over a distance."""

from typing import Any

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, cross, dot, face_normals
from wrinklecli.numeric.elements import factorised

# Least and greatest cotangent, so that obtuse and thin triangles do not pull apart.
_LEAST_COTANGENT = 0.05
_GREATEST_COTANGENT = 5.0
# Least area of a vertex over the mean: isolated vertices and slivers have none to divide by.
_LEAST_AREA = 1e-6
# Columns that are solved for at once. Solving jumps from row to row in each of them, and many do not stay in a cache:
# 160 columns of 23,000 rows take 3.8 s at once and 0.2 s by fours, which are as many as BLAS takes in one step.
_AT_ONCE = 4


def vertex_areas(positions: Floats, triangles: Ints) -> Floats:
    """(vertices,) a third of the area of the triangles round each vertex."""
    return _spread(_thirds(positions, triangles), triangles, len(positions))


def _thirds(positions: Floats, triangles: Ints) -> Floats:
    """(triangles,) a third of the area of each."""
    return np.asarray(np.sqrt(np.sum(face_normals(positions, triangles) ** 2, axis=1)) / 6.0)


def _spread(values: Floats, triangles: Ints, count: int) -> Floats:
    """(vertices,) sums over the triangles round each of so many vertices, of (triangles,) values."""
    return np.asarray(np.bincount(triangles.reshape(-1), np.repeat(values, 3), count), np.float64)


def side_weights(positions: Floats, triangles: Ints) -> tuple[Ints, Floats]:
    """(3 · triangles, 2) ends of the triangles' sides, and (3 · triangles,) half the clamped cotangents opposite."""
    corners = [positions.T.take(column, axis=1) for column in triangles.T]
    ends, weights = [], []
    for k in range(3):
        first, second = (corners[(k + i) % 3] - corners[k] for i in (1, 2))
        normals = cross(first, second)
        sine = np.sqrt(dot(normals, normals))
        cotangent = dot(first, second) / np.where(sine > 0, sine, 1.0)
        ends.append(np.stack([triangles[:, (k + i) % 3] for i in (1, 2)], axis=1))
        weights.append(np.clip(cotangent, _LEAST_COTANGENT, _GREATEST_COTANGENT) / 2.0)
    return np.concatenate(ends), np.concatenate(weights)


def laplacian(positions: Floats, triangles: Ints) -> Any:
    """(vertices, vertices) sparse cotangent matrix, whose quadratic form is the integral of the squared gradient.

    Source: U. Pinkall, K. Polthier, *Computing Discrete Minimal Surfaces and Their Conjugates*, 1993. Differs:
    cotangents are clamped.
    """
    import scipy.sparse as sparse

    ends, weights = side_weights(positions, triangles)
    rows, columns = np.concatenate([ends, ends[:, ::-1]]).T
    shape = (len(positions), len(positions))
    sides = sparse.csr_array((np.tile(weights, 2), (rows, columns)), shape=shape)
    return (sparse.diags_array(sides.sum(axis=1)) - sides).tocsr()


def curvatures(positions: Floats, triangles: Ints) -> Floats:
    """(vertices, 3) sums of the principal curvatures times normals, which point to the convex side."""
    ends, weights = side_weights(positions, triangles)
    a, b = ends.T
    pulls = weights * (positions[a] - positions[b]).T
    count = len(positions)
    sums = [np.bincount(a, pull, count) - np.bincount(b, pull, count) for pull in pulls]
    areas = vertex_areas(positions, triangles)
    return np.asarray(np.stack(sums, axis=1) / np.maximum(areas, _LEAST_AREA * areas.mean())[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A triangulated surface whose fields diffuse.

    Attributes:
        positions: (vertices, 3).
        triangles: (triangles, 3).
        areas: (vertices,) of each vertex, above 0.
        stiffness: (vertices, vertices) its cotangent matrix.
        cells: (vertices, triangles) sparse areas that the cells of vertices have of triangles.
    """

    positions: Floats
    triangles: Ints
    areas: Floats
    stiffness: Any
    cells: Any

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Sheet":
        """Prepare a surface."""
        import scipy.sparse as sparse

        thirds = _thirds(positions, triangles)
        areas = _spread(thirds, triangles, len(positions))
        areas = np.maximum(areas, _LEAST_AREA * areas.mean())
        places = (triangles.ravel(), np.repeat(np.arange(len(triangles)), 3))
        cells = sparse.csr_array((np.repeat(thirds, 3), places), shape=(len(positions), len(triangles)))
        return cls(positions, triangles, areas, laplacian(positions, triangles), cells)

    def averaging(self, length: float, stiffness: Any = None) -> "Average":
        """Averages over about a length, by one implicit step of diffusion over length² / 4.

        `stiffness` is another one, such as of an anisotropic diffusion.
        """
        import scipy.sparse as sparse

        form = self.stiffness if stiffness is None else stiffness
        diffusion = sparse.diags_array(self.areas) + length**2 / 4.0 * form
        return Average(self.areas, factorised(diffusion.tocsc(), relax=1))

    def to_vertices(self, of_triangles: Floats) -> Floats:
        """(vertices, …) integrals over the cells of vertices of (triangles, …) values."""
        flat = of_triangles.reshape(len(of_triangles), -1)
        return np.asarray((self.cells @ flat).reshape(-1, *of_triangles.shape[1:]))


@dataclass(frozen=True, slots=True, eq=False)
class Average:
    """An average over the surface; `factors` solve for it."""

    areas: Floats
    factors: Any

    def of(self, values: Floats) -> Floats:
        """(vertices, …) averages of (vertices, …) values."""
        return self.of_integrals((values.T * self.areas).T)

    def of_integrals(self, integrals: Floats) -> Floats:
        """(vertices, …) averages, from integrals over the cells of vertices."""
        flat = integrals.reshape(len(integrals), -1)
        found = np.zeros(flat.shape, order="F")
        for first in range(0, flat.shape[1], _AT_ONCE):
            own = slice(first, first + _AT_ONCE)
            found[:, own] = self.factors.solve(np.ascontiguousarray(flat[:, own]))
        return found.reshape(integrals.shape)
