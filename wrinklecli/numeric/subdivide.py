"""Subdivides chosen edges of a triangle mesh without T-junctions, and gives a sparse matrix on its vertices.

(A T-junction is a vertex inside a neighbour's edge: a gap opens there as soon as it moves.)

`red_green` decides which edges are split, and `butterfly` which vertices a new vertex is mixed of. Here the levels
become one mesh: invisible splits are undone, and the others split coarse faces into fine triangles.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, among, any_of, distinct_values, flags_of, matches
from wrinklecli.numeric.butterfly import butterfly
from wrinklecli.numeric.red_green import Criterion, Rules, Stage, close, coarse_stage
from wrinklecli.numeric.sparse import Matrix, apply

_BISECTED = np.array([[0, 3, 2], [3, 1, 2]])  # edge 0 is split
_TRISECTED = (  # edge 0 is not split; the diagonal leaves corner 0 or corner 1
    np.array([[0, 1, 4], [0, 4, 5], [5, 4, 2]]),
    np.array([[0, 1, 5], [1, 4, 5], [5, 4, 2]]),
)


@dataclass(frozen=True, slots=True)
class Subdivision:
    """The refined mesh. Coarse vertices keep their indices and positions, new ones follow.

    Attributes:
        triangles: (F', 3) fine vertices; the children of a coarse triangle replace it, others are unchanged.
        parents: (F',) the coarse triangle of each, sorted.
        leaves: (n,) sorted fine triangles near the splits; others are coarse ones.
        leaf_barycentrics: (n, 3, 3) their `barycentrics`.
        vertex_count: V'.
        matrix: (V', V) weights by the scheme's stencils. None is the identity: nothing was split.
        linear: (V', V) weights by edge midpoints, on the coarse mesh. None is the identity.
        limited: Number of edges that still want a split at the highest level allowed.
        unmet: (n,) sorted coarse triangles on which these edges are.
        blocked: Number of edges that should have been split, for themselves or for others, but are forbidden.
        levels: Deepest level reached; 0 if nothing was split.
    """

    triangles: Ints
    parents: Ints
    leaves: Ints
    leaf_barycentrics: Floats
    vertex_count: int
    matrix: Matrix | None
    linear: Matrix | None
    limited: int
    unmet: Ints
    blocked: int
    levels: int

    @property
    def changed(self) -> Bools:
        """(F',) True for triangles that are not coarse ones."""
        return np.bincount(self.parents)[self.parents] > 1

    @property
    def barycentrics(self) -> Floats:
        """(F', 3, 3); corner c of fine triangle f is `barycentrics[f, c] @ corners` of its coarse triangle.

        Multiples of powers of two, exact. For corner attributes, so that seams stay seams.
        """
        return self.barycentrics_of(np.arange(len(self.parents)))

    def barycentrics_of(self, faces: Ints) -> Floats:
        """(faces, 3, 3) `barycentrics` of some fine triangles."""
        found = np.tile(np.eye(3), (len(faces), 1, 1))
        among_leaves, leaves = matches(faces, self.leaves)
        found[among_leaves] = self.leaf_barycentrics[leaves]
        return found

    def reduced(self, triangles: Ints, faces: Ints, vertices: Ints) -> Subdivision:
        """The mesh of some of the vertices, (V'',) sorted ones; (F'', 3) triangles replace (F'',) sorted ones."""
        places, leaves = matches(faces, self.leaves)
        matrix, linear = (each and each.chosen(vertices) for each in (self.matrix, self.linear))
        return replace(
            self,
            triangles=triangles,
            parents=self.parents[faces],
            leaves=places,
            leaf_barycentrics=self.leaf_barycentrics[leaves],
            vertex_count=len(vertices),
            matrix=matrix,
            linear=linear,
        )

    def positions(self, coarse: Floats) -> Floats:
        """(..., V, C) coarse values → (..., V', C) by the scheme's stencils; the first V are the same bits."""
        return apply(self.matrix, coarse)

    def interpolate(self, coarse: Floats) -> Floats:
        """(..., V, C) coarse values → (..., V', C) by edge midpoints; the first V are the same bits."""
        return apply(self.linear, coarse)

    def of_vertices(self, vertices: Ints, coarse: Floats) -> Floats:
        """(vertices, …) linear mixtures of (coarse vertices, …) values at some vertices."""
        return coarse[vertices] if self.linear is None else self.linear.of_rows(vertices, coarse)

    def interpolate_new(self, coarse: Floats) -> Floats:
        """(V, C) coarse values → (V' - V, C) those of the new vertices, by edge midpoints."""
        if self.linear is None:
            return coarse[:0]
        return self.linear.of_rows(np.arange(len(coarse), self.vertex_count), coarse)


def subdivide(
    triangles: Ints,
    vertex_count: int,
    *,
    wants: Criterion,
    forbids: Criterion | None = None,
    shows: Criterion | None = None,
    max_levels: int,
    near: Bools | None = None,
    scheme: Literal["butterfly", "midpoint"] = "butterfly",
    hard: Ints | None = None,
    max_vertices: int | None = None,
    where: str = "",
) -> Subdivision:
    """Split the wanted edges, and those that must follow to keep the mesh conforming.

    The mesh may be open, non-manifold, in pieces or wound inconsistently. A triangle with two equal corners stays
    unchanged and does not count as a face.

    Args:
        triangles: (F, 3) welded vertices.
        vertex_count: V, of the coarse mesh.
        wants: Gives (E,) True for the edges of a level that should split. Called again for the faces that a level gains
            (wanted edges stay wanted), and with level `max_levels`, only to count its edges.
        forbids: Gives (E,) True for the edges of a level that must never split, nor any edge whose split needs theirs;
            called as often as `wants`.
        shows: Gives (E,) True for the edges of a level whose split is visible. Others are undone unless finer ones need
            them. By default all are visible.
        max_levels: How often an edge may be halved.
        near: (F,) True for the triangles that have all wanted edges, at any level; by default all. Triangles further
            away take hardly any time.
        scheme: `butterfly`, smooth through the coarse vertices, or `midpoint`, which keeps the coarse shape.
        hard: (H, 2) vertices of coarse edges, the lower first, that keep their shape and that no stencil reads across.
        max_vertices: Most new vertices, including those that are undone at the end; by default any number.
        where: The owner of the triangles, for the message.

    Returns:
        New vertices are numbered by level, then by their edge's vertex pair.

    Raises:
        BakeError: There would be more than `max_vertices` new vertices.
    """
    triangles = np.asarray(triangles, dtype=np.intp)
    held = np.ones(len(triangles), dtype=np.bool_) if near is None else two_rings(near, triangles, vertex_count)
    rules = Rules(wants, forbids, max_levels, max_vertices, where)
    root = coarse_stage(triangles, held, vertex_count, rules)
    stages, wasted = close(root, [], rules)
    if wasted:
        # Splits that proved impossible had asked for others at coarser levels: plan again without them.
        stages, _ = close(root, stages, rules)

    deepest = stages[-1]
    shown = [np.ones(stage.split.size, dtype=np.bool_) if shows is None else shows(stage.level) for stage in stages]
    limited = shown[-1] & deepest.wanted & ~deepest.forbidden & (len(stages) > max_levels)
    needed = _needed(stages, shown)
    corners, parents, barycentrics = _leaves(stages, needed)
    # Vertices of splits that are needed.
    near_count = root.complete.size
    kept = flags_of(corners, deepest.complete.size)
    rows = near_count + np.flatnonzero(kept[near_count:])
    matrix = linear = None
    if len(rows):
        identity = Matrix.identity(vertex_count)
        matrix = linear = identity.followed_by(deepest.level.linear.chosen(rows))
        if scheme == "butterfly":
            stencils = _stencils(stages, np.zeros((0, 2), np.intp) if hard is None else hard)
            matrix = identity.followed_by(stencils.chosen(rows))
    numbers = np.zeros(kept.size, np.intp)
    numbers[:near_count] = root.level.linear.columns
    numbers[rows] = vertex_count + np.arange(len(rows))
    every, fine, leaves = _among_others(triangles, parents, numbers[corners])
    return Subdivision(
        triangles=fine,
        parents=every,
        leaves=leaves,
        leaf_barycentrics=barycentrics,
        vertex_count=vertex_count + len(rows),
        matrix=matrix,
        linear=linear,
        limited=int(limited.sum()),
        unmet=distinct_values(deepest.level.parents[any_of(limited, deepest.level.triangle_edges)]),
        blocked=sum(int(stage.denied.sum()) for stage in stages),
        levels=max((level + 1 for level, splits in enumerate(needed) if splits.any()), default=0),
    )


def two_rings(near: Bools, triangles: Ints, vertex_count: int) -> Bools:
    """(F,) True for the triangles that can matter if all wanted edges are in the flagged ones: these and two rings.

    A finer edge needs the faces round its ends, at each level half as far as at the level below: in all less than the
    length of a triangle, so no vertex beyond the first ring. The third edge of a face with two split ones shares both
    its ends with them. Stencils read the faces round the ends of split edges: the second ring.
    """
    for _ in range(2):
        near = any_of(flags_of(triangles[near], vertex_count), triangles)
    return near


def _stencils(stages: list[Stage], hard: Ints) -> Matrix:
    """(vertices of the last level, coarse vertices) butterfly weights, with (H, 2) hard coarse edges."""
    matrix = stages[0].level.linear
    count, edges = matrix.column_count, matrix.columns[stages[0].level.edges]
    is_hard = among(edges[:, 0] * count + edges[:, 1], np.sort(hard[:, 0] * count + hard[:, 1]))
    for stage, finer in pairwise(stages):
        edges, count = stage.level.edges, stage.complete.size
        creased = flags_of(edges[is_hard], count)
        matrix = butterfly(stage.level.triangles, edges[stage.split], count, creased).below(matrix)
        # A finer edge with one old end is half of the edge whose midpoint is its other end.
        old, middle = finer.level.edges.T
        was_hard, halves = is_hard[stage.split], np.flatnonzero(old < count)
        is_hard = np.zeros(len(old), dtype=np.bool_)
        is_hard[halves] = was_hard[middle[halves] - count]
    return matrix


def _needed(stages: list[Stage], shown: list[Bools]) -> list[Bools]:
    """(E,) for each stage, the visible splits and those that finer ones need, in all faces round their ends."""
    needed = [stages[-1].split & shown[-1]]
    for below, above, seen in zip(stages[-2::-1], stages[:0:-1], shown[-2::-1], strict=True):
        ends = flags_of(above.level.edges[needed[0]], above.complete.size)
        needed.insert(0, below.split & (seen | below.edges_of(below.faces_at(ends))))
    return needed


def _among_others(triangles: Ints, parents: Ints, leaves: Ints) -> tuple[Ints, Ints, Ints]:
    """Put fine triangles in the places of their coarse ones among (F, 3) others.

    Args:
        triangles: (F, 3) coarse triangles.
        parents: (n,) the coarse triangles that the fine ones replace, sorted.
        leaves: (n, 3) the fine ones.

    Returns:
        (F',) the coarse triangle of each, (F', 3) all triangles, and the (n,) places of the fine ones among them.
    """
    counts = np.bincount(parents, minlength=len(triangles))
    is_leaf = counts > 0
    every = np.repeat(np.arange(len(triangles)), np.maximum(counts, 1))
    places = np.flatnonzero(is_leaf[every])
    fine = triangles[every]
    fine[places] = leaves
    return every, fine, places


def _leaves(stages: list[Stage], needed: list[Bools]) -> tuple[Ints, Ints, Floats]:
    """Give (n, 3) fine triangles near the splits, their (n,) coarse ones and (n, 3, 3) barycentrics, in coarse order.

    The splits to make are (E,) `needed` for each stage.
    """
    finest = len(stages) - 1
    found, weights, places = [], [], []
    there = np.ones(stages[0].codes.size, dtype=np.bool_)
    for depth, (stage, splits) in enumerate(zip(stages, needed, strict=True)):
        scale = 4 ** (finest - depth)
        touched, red = any_of(splits, stage.level.triangle_edges), ~any_of(~splits, stage.level.triangle_edges)
        whole_here = there & ~touched
        found.append(stage.level.triangles[whole_here])
        weights.append(stage.level.barycentrics[whole_here])
        places.append(stage.codes[whole_here] * scale)

        green = there & touched & ~red
        there = np.repeat((there & red)[stage.red], 4)
        split = splits[stage.level.triangle_edges[green]]
        codes = stage.codes[green]
        corners, barycentrics = stage.corners_and_midpoints(green)
        two = split.sum(axis=1) == 2
        for turn in range(3):
            turned = (np.arange(3) + turn) % 3
            turned = np.append(turned, 3 + turned)
            # The order of vertices decides, so that faces with the same vertices (double-sided) share the diagonal.
            ascending = corners[:, turned[0]] < corners[:, turned[1]]
            for chosen, pattern in (
                (~two & split[:, turn], _BISECTED),
                (two & ~split[:, turn] & ascending, _TRISECTED[0]),
                (two & ~split[:, turn] & ~ascending, _TRISECTED[1]),
            ):
                found.append(corners[chosen][:, turned[pattern]].reshape(-1, 3))
                weights.append(barycentrics[chosen][:, turned[pattern]].reshape(-1, 3, 3))
                places.append(np.repeat(codes[chosen] * scale, len(pattern)))
    place = np.concatenate(places)
    order = np.argsort(place, kind="stable")
    return np.concatenate(found)[order], place[order] // 4**finest, np.concatenate(weights)[order]
