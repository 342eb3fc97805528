"""The edges of triangles, the two faces on both sides of each, and the shorter of the two diagonals of such a pair.

A wave is drawn best by edges along its crests. Where all edges run across or aslant, shaded crests have teeth. Lengths
that are measured in waves are short along crests, whatever the way of the triangles that were refined.

Source: N. Dyn, D. Levin, S. Rippa, *Data Dependent Triangulations for Piecewise Linear Interpolation*, IMA Journal of
Numerical Analysis 10, 1990: edges are swapped while that lowers a cost. Differs: the cost is the sum of lengths.
"""

from collections.abc import Callable

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    TINY,
    Bools,
    Floats,
    Ints,
    any_of,
    cross,
    dot,
    face_normals,
    flags_of,
    places_of,
    renumbered,
)

STEP = 2.0**-20
"""Part of a length by which others must differ to count as shorter or longer: rounding errors decide nothing."""
# Least part of the area of two triangles that each has: a refined triangle and the one beside it have a quarter or
# more, and what is narrower has hardly a normal.
_NARROWEST = 0.125


def numbered_edges(triangles: Ints) -> tuple[Ints, Ints]:
    """The first two attributes of `Edges`, for (faces, 3) vertices."""
    following, count = np.roll(triangles, -1, axis=1), int(triangles.max(initial=-1)) + 1
    keys = np.minimum(triangles, following) * count + np.maximum(triangles, following)
    edges, of_faces = renumbered(keys)
    return np.stack(np.divmod(edges, max(count, 1)), axis=1), of_faces


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


def turn_diagonals(triangles: Ints, positions: Floats, lengths: Callable[[Ints], Floats], tolerance: float) -> Ints:
    """Turn diagonals until none would become shorter: (triangles, 3) vertices, in which only seams and borders stay.

    Args:
        triangles: (triangles, 3) vertices; those on both sides of a seam have numbers of their own.
        positions: (vertices, 3).
        lengths: Gives (edges,) lengths from their (edges, 2) vertices.
        tolerance: Greatest distance by which the surface may change.
    """
    found, near = triangles.copy(), np.arange(len(triangles))
    # A pair that does not turn does so later only if a pair with one of its triangles turns.
    open_to_turns = np.ones(len(triangles), np.bool_)
    while True:
        faces, quads = _pairs(found[near])
        faces = near[faces]
        again = open_to_turns[faces].any(axis=1)
        faces, quads = faces[again], quads[again]
        made = np.stack([quads[:, [1, 2, 3]], quads[:, [3, 0, 1]]], axis=1)
        before, after = np.split(lengths(np.concatenate([quads[:, [0, 2]], quads[:, [1, 3]]])), 2)
        areas = face_normals(positions, made.reshape(-1, 3)).reshape(-1, 2, 3)
        whole = areas.sum(axis=1)
        parts = np.einsum("eta,ea->et", areas, whole) / np.maximum(np.sum(whole**2, axis=1), TINY)[:, None]
        a, b, c, d = positions.T[:, quads.T].swapaxes(0, 1)
        across = np.array(cross(c - a, d - b))
        flat = np.abs(dot(across, b - a)) <= tolerance * np.linalg.norm(across, axis=0)
        turns = flat & (before - after > STEP * before) & (parts >= _NARROWEST).all(axis=1)
        turned = _apart(np.where(turns, before - after, 0.0), faces, len(found))
        if not turned.any():
            return found
        found[faces[turned]] = made[turned]
        open_to_turns = flags_of(faces[turns], len(found))
        near = np.flatnonzero(any_of(flags_of(found[open_to_turns], len(positions)), found))


def _pairs(triangles: Ints) -> tuple[Ints, Ints]:
    """The pairs of (triangles, 3) that share an edge with no other: (pairs, 2) triangles and (pairs, 4) vertices.

    The vertices go round: an end of the edge, the corner of the second triangle, the other end, that of the first.
    """
    edges = Edges.of(triangles)
    # Those that wind against each other have no outer side.
    one, other = edges.one[edges.way > 0], edges.other[edges.way > 0]
    starts, ends, beyond = (np.roll(triangles, -turn, axis=1).ravel() for turn in range(3))
    quads = np.stack([starts[one], beyond[other], ends[one], beyond[one]], axis=1)
    return np.stack([one // 3, other // 3], axis=1), quads


def _apart(gains: Floats, faces: Ints, count: int) -> Bools:
    """(pairs,) True for those with a gain that is the greatest of all pairs with one of their (pairs, 2) triangles."""
    ranks = places_of(np.argsort(-gains, kind="stable"), len(gains))
    least = np.full(count, len(gains))
    np.minimum.at(least, faces, ranks[:, None])
    return np.asarray((gains > 0.0) & (least[faces] == ranks[:, None]).all(axis=1))
