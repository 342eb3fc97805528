"""The edges of triangles, and the two faces on both sides of each."""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints


def numbered_edges(triangles: Ints) -> tuple[Ints, Ints]:
    """The first two attributes of `Edges`, for (faces, 3) vertices."""
    following, count = np.roll(triangles, -1, axis=1), int(triangles.max(initial=-1)) + 1
    keys = np.minimum(triangles, following) * count + np.maximum(triangles, following)
    edges, of_faces = np.unique(keys.reshape(-1), return_inverse=True)
    return np.stack(np.divmod(edges, max(count, 1)), axis=1), of_faces.reshape(triangles.shape)


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
        vertices, of_faces = numbered_edges(triangles)
        edges, starts = of_faces.reshape(-1), triangles.reshape(-1)
        counts = np.bincount(edges, minlength=len(vertices))
        order, pairs = np.argsort(edges, kind="stable"), np.flatnonzero(counts == 2)
        first = np.searchsorted(edges[order], pairs)
        one, other = order[first], order[first + 1]
        return cls(
            vertices=vertices,
            of_faces=of_faces,
            counts=counts,
            pairs=pairs,
            one=one,
            other=other,
            way=np.where(starts[one] != starts[other], 1.0, -1.0),
        )
