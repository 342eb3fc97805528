"""The triangles around vertices, looked up without a look at all others: what many small patches of a mesh ask for."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, any_of, distinct_values, flags_of, normals_at, runs

# Share of the vertices from which on one look at all triangles takes less time than to gather those around each.
_MANY = 1 / 16


@dataclass(frozen=True, slots=True)
class Around:
    """Which triangles each vertex has.

    Attributes:
        triangles: (triangles, 3) vertices.
        starts: (vertices + 1,) where those of each vertex start.
        faces: (3 triangles,) the triangles of one vertex after another, rising for each.
    """

    triangles: Ints
    starts: Ints
    faces: Ints

    @classmethod
    def of(cls, triangles: Ints, vertex_count: int) -> "Around":
        """Sort (triangles, 3) by their vertices."""
        counts = np.bincount(triangles.ravel(), minlength=vertex_count)
        return cls(triangles, np.append(0, np.cumsum(counts)), np.argsort(triangles.ravel(), kind="stable") // 3)

    def faces_of(self, vertices: Ints) -> Ints:
        """The triangles, rising, that have any of (vertices,)."""
        if self._are_many(vertices):
            return np.flatnonzero(any_of(flags_of(vertices, len(self.starts) - 1), self.triangles))
        first, counts = self.starts[vertices], self.starts[vertices + 1] - self.starts[vertices]
        return distinct_values(self.faces[runs(first, counts)])

    def normals_at(self, positions: Floats, vertices: Ints) -> Floats:
        """(chosen, 3) `vertex_normals` of (chosen,) vertices, from (vertices, 3) positions."""
        if self._are_many(vertices):
            return normals_at(positions, self.triangles, vertices)
        faces = self.triangles[self.faces_of(vertices)]
        used = distinct_values(np.concatenate([faces.ravel(), vertices]))
        return normals_at(positions[used], np.searchsorted(used, faces), np.searchsorted(used, vertices))

    def _are_many(self, vertices: Ints) -> bool:
        return len(vertices) > _MANY * (len(self.starts) - 1)
