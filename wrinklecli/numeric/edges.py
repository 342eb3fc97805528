"""The edges of triangles, and the two faces on both sides of each."""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class Edges:
    """The edges of some triangles. A side is a number: three times that of its face, plus 0 to 2.

    Attributes:
        vertices: (edges, 2) vertices, the lower first, sorted.
        of_faces: (faces, 3) the edge that begins at each corner.
        counts: (edges,) faces of each edge.
        pairs: (pairs,) the edges of exactly two faces.
        one: (pairs,) one side of these.
        other: (pairs,) the other side.
        way: (pairs,) 1 if the sides run in opposite ways, as those of faces that are wound alike, or else -1.
    """

    vertices: Ints
    of_faces: Ints
    counts: Ints
    pairs: Ints
    one: Ints
    other: Ints
    way: Floats

    @classmethod
    def of(cls, triangles: Ints) -> "Edges":
        """Find the edges of (faces, 3) vertices."""
        starts, ends = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
        count = int(triangles.max(initial=-1)) + 1
        keys, edges = np.unique(np.minimum(starts, ends) * count + np.maximum(starts, ends), return_inverse=True)
        edges, counts = edges.reshape(-1), np.bincount(edges.reshape(-1), minlength=len(keys))
        order, pairs = np.argsort(edges, kind="stable"), np.flatnonzero(counts == 2)
        first = np.searchsorted(edges[order], pairs)
        one, other = order[first], order[first + 1]
        return cls(
            vertices=np.stack(np.divmod(keys, max(count, 1)), axis=1),
            of_faces=edges.reshape(-1, 3),
            counts=counts,
            pairs=pairs,
            one=one,
            other=other,
            way=np.where(starts[one] != starts[other], 1.0, -1.0),
        )
