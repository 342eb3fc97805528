"""Butterfly stencils: the weights of the vertices around a split edge in its new vertex.

A regular vertex has six edges (its valence); a vertex of another valence is extraordinary and has its own stencil.

Sources:
    - D. Zorin, P. Schröder, W. Sweldens, *Interpolating Subdivision for Meshes with Arbitrary Topology*,
      SIGGRAPH 1996: modified butterfly, the stencils of extraordinary vertices.
    - N. Dyn, D. Levin, J. A. Gregory, *A Butterfly Subdivision Scheme for Surface Interpolation with Tension
      Control*, ACM Transactions on Graphics 9(2), 1990: the regular stencil (tension w = 1/16).
    - N. Dyn, D. Levin, J. A. Gregory, *A 4-point interpolatory subdivision scheme for curve design*, Computer
      Aided Geometric Design 4(4), 1987: borders.

Differs:
    - An inner edge with one end on a border takes the other end's extraordinary stencil, or its midpoint if
      that end's valence is 6; with both ends on a border, its midpoint (Zorin et al. have own rules).
    - Vertices that are not surrounded by one consistently wound fan count as border. Duplicates of a face (a
      sheet modelled with its back) are refined like it, but stencils see one face: the first.
    - Hard edges are like cuts: a vertex on one counts as border, but has no 4-point rule. So a hard edge takes its
      midpoint, and no stencil reads across it. (H. Hoppe et al., *Piecewise Smooth Surface Reconstruction*, SIGGRAPH
      1994, have rules for creases; here they keep their shape.)
    - A vertex of more than 256 edges has no stencil.
"""

import math

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Ints, among, any_of, distinct, distinct_values, flags_of
from wrinklecli.numeric.sparse import Matrix

# Edges of a vertex beyond which it has no stencil: the stencils of its edges together take the square of this number.
_MOST_VALENCE = 256


def butterfly(triangles: Ints, ends: Ints, vertex_count: int, creased: Bools) -> Matrix:
    """Compute the stencils of the modified butterfly.

    Args:
        triangles: (F, 3) vertices; all faces round the ends are among them.
        ends: (n, 2) vertices of the edges to split.
        vertex_count: Number of vertices of the level.
        creased: (vertex_count,) True on a hard edge.

    Returns:
        (n, vertex_count) weights; rows sum to 1.
    """
    fans = _fans(triangles, flags_of(ends, vertex_count))
    valences = fans.valences[ends]
    valences = np.where((valences > _MOST_VALENCE) | creased[ends], 0, valences)
    extraordinary = (valences != 0) & (valences != 6)
    extraordinary_count = extraordinary.sum(axis=1)
    # Each end has a weight in the edge's stencil, and spreads it over itself and its ring.
    end_weights = extraordinary / np.maximum(extraordinary_count, 1)[:, None]
    end_weights[(valences == 6).all(axis=1)] = 1.0

    border = (fans.border_counts[ends] == 2) & ~creased[ends]
    border = border.all(axis=1) & among(ends[:, 0] * fans.vertex_count + ends[:, 1], fans.border_keys)
    plain = (end_weights.sum(axis=1) == 0.0) & ~border
    edges = np.arange(len(ends))
    beyond = fans.border_sums[ends[border]] - ends[border][:, ::-1]
    rows = [np.repeat(edges[plain], 2), np.repeat(edges[border], 4)]
    columns = [ends[plain].reshape(-1), np.concatenate([ends[border], beyond], axis=1).reshape(-1)]
    weights = [
        np.full(2 * np.count_nonzero(plain), 1 / 2),
        np.tile([9 / 16, 9 / 16, -1 / 16, -1 / 16], np.count_nonzero(border)),
    ]
    for valence in distinct_values(valences[end_weights > 0.0]).tolist():
        edge, end = np.nonzero((valences == valence) & (end_weights > 0.0))
        own, around = _ring_weights(valence)
        stencil = end_weights[edge, end][:, None] * [own, *around]
        ring = fans.rings(ends[edge, end], ends[edge, 1 - end], valence)
        rows.append(np.repeat(edge, valence + 1))
        columns.append(np.concatenate([ends[edge, end][:, None], ring], axis=1).reshape(-1))
        weights.append(stencil.reshape(-1))
    return Matrix.of_entries(np.concatenate(rows), np.concatenate(columns), np.concatenate(weights), vertex_count)


def _ring_weights(valence: int) -> tuple[float, tuple[float, ...]]:
    """Weight of an edge's end, and weights of the end's ring from the edge's other end on.

    For valence 6 these are half of the regular stencil (the edge's other end has the other half), for any other valence
    the whole extraordinary stencil.
    """
    if valence == 6:
        return 1 / 2, (0.0, 1 / 16, -1 / 16, 0.0, -1 / 16, 1 / 16)
    if valence == 4:
        return 3 / 4, (3 / 8, 0.0, -1 / 8, 0.0)
    if valence == 3:
        return 3 / 4, (5 / 12, -1 / 12, -1 / 12)
    # Angles count the shorter way round, so that mirrored rings have the same bits.
    angles = [2 * math.pi * min(j, valence - j) / valence for j in range(valence)]
    return 3 / 4, tuple((1 / 4 + math.cos(a) + math.cos(2 * a) / 2) / valence for a in angles)


@dataclass(frozen=True, slots=True)
class _Fans:
    """The faces round some vertices, as half-edges (vertex, next corner, corner after that).

    Attributes:
        keys: (H,) vertex · vertex_count + next corner, sorted.
        nexts: (H,) the next corner.
        successors: (H,) the half-edge of the same vertex whose next corner is this one's last; valid in closed fans.
        valences: (vertices,) valences of vertices within one closed, consistently wound fan; 0 for others.
        border_counts: (vertices,) number of the vertex's edges with one face (border edges).
        border_sums: (vertices,) sum of the other ends of the border edges.
        border_keys: (B,) vertex · vertex_count + other end of each border edge, sorted.
    """

    vertex_count: int
    keys: Ints
    nexts: Ints
    successors: Ints
    valences: Ints
    border_counts: Ints
    border_sums: Ints
    border_keys: Ints

    def rings(self, vertices: Ints, firsts: Ints, valence: int) -> Ints:
        """(n, valence) vertices round each of (n,) closed fans, beginning with (n,) `firsts`."""
        at = np.searchsorted(self.keys, vertices * self.vertex_count + firsts)
        ring = []
        for _ in range(valence):
            ring.append(self.nexts[at])
            at = self.successors[at]
        return np.stack(ring, axis=1)


def _fans(triangles: Ints, centres: Bools) -> _Fans:
    """The fans of the flagged vertices only: what is refined is often a small part of a mesh.

    Args:
        triangles: (F, 3) vertices.
        centres: (vertices,) flags.
    """
    count = centres.size
    near = triangles[any_of(centres, triangles)]
    firsts, _ = distinct(np.sort(near, axis=1))
    near = near[np.sort(firsts)]
    halves = np.concatenate([np.roll(near, -turn, axis=1) for turn in range(3)])
    halves = halves[centres[halves[:, 0]]]
    halves = halves[np.argsort(halves[:, 0] * count + halves[:, 1], kind="stable")]
    vertices, nexts, lasts = halves.T
    keys, last_keys = vertices * count + nexts, vertices * count + lasts
    successors = np.minimum(np.searchsorted(keys, last_keys), keys.size - 1)

    spokes, face_counts = np.unique(np.concatenate([keys, last_keys]), return_counts=True)
    border_keys = spokes[face_counts == 1]
    at_border, border_ends = np.divmod(border_keys, count)
    border_counts, border_sums = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intp)
    np.add.at(border_counts, at_border, 1)
    np.add.at(border_sums, at_border, border_ends)

    # A fan is closed if each spoke is a next and a last corner once, and the walk from any spoke passes all of them.
    open_at = flags_of(vertices[keys[successors] != last_keys], count)
    open_at[vertices[1:][keys[1:] == keys[:-1]]] = True
    sorted_last_keys = np.sort(last_keys)
    open_at[sorted_last_keys[1:][sorted_last_keys[1:] == sorted_last_keys[:-1]] // count] = True
    centre, first, degrees = np.unique(vertices, return_index=True, return_counts=True)
    closed = ~open_at[centre]
    centre, first, degrees = centre[closed], first[closed], degrees[closed]
    lengths = np.zeros(centre.size, dtype=np.intp)
    walking, at = np.arange(centre.size), first
    while walking.size:
        lengths[walking] += 1
        at = successors[at]
        going = at != first[walking]
        walking, at = walking[going], at[going]
    valences = np.zeros(count, dtype=np.intp)
    valences[centre] = np.where(lengths == degrees, degrees, 0)
    return _Fans(count, keys, nexts, successors, valences, border_counts, border_sums, border_keys)
