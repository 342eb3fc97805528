"""Welded triangles → `Subdivision`: subdivision of a part, without T-junctions and linear in the vertices.

Sources:
    - D. Zorin, P. Schröder, W. Sweldens, *Interpolating Subdivision for Meshes with Arbitrary Topology*,
      SIGGRAPH 1996: modified butterfly, the stencils of extraordinary vertices.
    - N. Dyn, D. Levin, J. A. Gregory, *A Butterfly Subdivision Scheme for Surface Interpolation with Tension
      Control*, ACM Transactions on Graphics 9(2), 1990: the regular stencil (tension w = 1/16).
    - N. Dyn, D. Levin, J. A. Gregory, *A 4-point interpolatory subdivision scheme for curve design*, Computer
      Aided Geometric Design 4(4), 1987: borders.
    - R. E. Bank, A. H. Sherman, A. Weiser, *Some Subdivision Algorithms and Data Structures for Regular Local
      Mesh Subdivision*, Scientific Computing, 1983: red-green closure.

Differs:
    - Only where it is asked for. A level is the set of faces that all the levels below split in four; an edge
      splits only where all faces round both its ends belong to the level, so each new vertex lies exactly
      where refining the whole mesh would put it. Green faces are leaves: no stencil reads them.
    - A face with two split edges splits in four unless its third edge must not split, then in three. (In three wherever
      no finer level needs the quarters was tried: a quarter fewer vertices, and ragged creases.) Splits of which
      nothing would be seen are undone in the end.
    - An inner edge with one end on a border takes the other end's extraordinary stencil, or its midpoint if
      that end's valence is 6; with both ends on a border, its midpoint (Zorin et al. have own rules).
    - Vertices that are not surrounded by one consistently wound fan count as border. Duplicates of a face (a
      sheet modelled with its back) are refined like it, but stencils see one face: the first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct, distinct_values

# Triangles of a level: real-time characters have a tenth, and a level of these takes about 2 GB.
_MOST_TRIANGLES = 500_000
# Edges at a vertex beyond which it counts as irregular: the stencils of its edges take the square of them.
_MOST_VALENCE = 256

# Numbers of a product that are computed at once: bounds the memory.
_AT_ONCE = 2**22

# Corners 0, 1, 2 of a face and the midpoints 3, 4, 5 of the edges that follow them.
_RED = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
_BISECTED = np.array([[0, 3, 2], [3, 1, 2]])  # edge 0 is split
_TRISECTED = (  # edge 0 is not split; the diagonal leaves corner 0 or corner 1
    np.array([[0, 1, 4], [0, 4, 5], [5, 4, 2]]),
    np.array([[0, 1, 5], [1, 4, 5], [5, 4, 2]]),
)


@dataclass(frozen=True, slots=True)
class Matrix:
    """A sparse matrix by rows, none of which is empty.

    Three operations are all that refinement needs of one; importing scipy.sparse for them would take longer than
    baking a small asset does.

    Attributes:
        starts: (rows + 1,) where each row's entries start.
        columns: (entries,) ascending within a row.
        weights: (entries,) other than 0.
        column_count: Of all columns.
    """

    starts: Ints
    columns: Ints
    weights: Floats
    column_count: int

    @classmethod
    def of_entries(cls, rows: Ints, columns: Ints, weights: Floats, column_count: int) -> Matrix:
        """The sums of weights that fall on the same place; there is one in each row up to the last."""
        order = np.argsort(rows * column_count + columns, kind="stable")
        rows, columns, weights = rows[order], columns[order], weights[order]
        first = np.ones(len(rows), np.bool_)
        first[1:] = (np.diff(rows) != 0) | (np.diff(columns) != 0)
        weights = np.add.reduceat(weights, np.flatnonzero(first)) if len(rows) else weights
        rows, columns = rows[first][weights != 0], columns[first][weights != 0]
        starts = np.searchsorted(rows, np.arange(int(rows[-1]) + 2 if len(rows) else 1))
        return cls(starts, columns, weights[weights != 0], column_count)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.starts) - 1, self.column_count

    def __matmul__(self, dense: Floats) -> Floats:
        """(columns, …) → (rows, …)."""
        return self.of_rows(np.arange(len(self.starts) - 1), dense)

    def of_rows(self, rows: Ints, dense: Floats) -> Floats:
        """Some rows of the product with (columns, …) → (chosen, …)."""
        width = max(1, int(np.prod(dense.shape[1:])))
        product = np.zeros((len(rows), *dense.shape[1:]))
        counts = np.diff(self.starts)[rows]
        ends = np.cumsum(counts * width)
        cuts = np.searchsorted(ends, np.arange(_AT_ONCE, (ends[-1] if len(ends) else 0) + _AT_ONCE, _AT_ONCE)) + 1
        low = 0
        for high in np.minimum(cuts, len(rows)):
            entries, begins = self._entries(rows[low:high])
            if len(entries):
                weights = self.weights[entries].reshape(-1, *[1] * (dense.ndim - 1))
                product[low:high] = np.add.reduceat(weights * dense[self.columns[entries]], begins, axis=0)
            low = high
        return product

    def chosen(self, rows: Ints) -> Matrix:
        """Some rows, as a matrix."""
        entries, _ = self._entries(rows)
        starts = np.append(0, np.cumsum(np.diff(self.starts)[rows]))
        return Matrix(starts, self.columns[entries], self.weights[entries], self.column_count)

    def _entries(self, rows: Ints) -> tuple[Ints, Ints]:
        """Numbers of some rows' entries, row by row, and where among them each row begins."""
        counts = self.starts[rows + 1] - self.starts[rows]
        begins = np.cumsum(counts) - counts
        return np.arange(int(counts.sum())) + np.repeat(self.starts[rows] - begins, counts), begins

    def below(self, above: Matrix | None) -> Matrix:
        """The rows of `above`, (n, V) (None: identity), then those of this matrix, on its n rows: (n + m, V)."""
        if above is None:
            identity = np.arange(self.column_count)
            above = Matrix(np.arange(self.column_count + 1), identity, np.ones(self.column_count), self.column_count)
        entries, _ = above._entries(self.columns)
        counts = np.diff(above.starts)[self.columns]
        rows = np.repeat(np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts)), counts)
        weights = np.repeat(self.weights, counts) * above.weights[entries]
        own = Matrix.of_entries(rows, above.columns[entries], weights, above.column_count)
        return Matrix(
            np.concatenate([above.starts, above.starts[-1] + own.starts[1:]]),
            np.concatenate([above.columns, own.columns]),
            np.concatenate([above.weights, own.weights]),
            above.column_count,
        )


@dataclass(frozen=True, slots=True)
class Level:
    """One level of subdivision as far as it exists; what the criteria of `subdivide` look at.

    Attributes:
        number: 0 for the coarse mesh.
        matrix: (vertices, coarse vertices), positions and morph deltas; None is the identity (level 0).
        linear: (vertices, coarse vertices), the same by edge midpoints, for skin weights; None as above.
        triangles: (F, 3) vertices. Level 0 has the coarse triangles `near` which splits are wanted, except those
            with two equal corners, a higher one the quarters of the faces that split in four, not the green ones.
            Vertices are the coarse ones, then those of each level up to this one.
        parents: (F,) coarse triangle that each lies in, ascending.
        edges: (E, 2) vertices, the lower first; ordered by them.
        triangle_edges: (F, 3); column c is the edge from corner c to the corner that follows it.
    """

    number: int
    matrix: Matrix | None
    linear: Matrix | None
    triangles: Ints
    parents: Ints
    edges: Ints
    triangle_edges: Ints

    def positions(self, coarse: Floats) -> Floats:
        """(..., V, C) coarse positions or morph deltas → (..., vertices, C) of this level."""
        return _apply(self.matrix, coarse)

    def interpolate(self, coarse: Floats) -> Floats:
        """(..., V, C) skin weights or the like → (..., vertices, C) of this level."""
        return _apply(self.linear, coarse)


@dataclass(frozen=True, slots=True)
class Subdivision:
    """The refined mesh, linear in the coarse one. Coarse vertices keep number and place, new ones follow.

    Attributes:
        triangles: (F', 3) fine vertices; children take their coarse triangle's place, others are unchanged.
        parents: (F',) coarse triangle, ascending.
        barycentrics: (F', 3, 3); corner c of fine triangle f is `barycentrics[f, c] @ corners` of its coarse
            triangle. Multiples of powers of two, exact. For corner attributes, so that seams stay seams.
        vertex_count: Of the fine mesh.
        coarse_vertex_count: Of the coarse mesh.
        matrix: (V', V), positions and morph deltas; None is the identity: nothing was split.
        linear: (V', V), the same by edge midpoints, for skin weights; None as above.
        limited: Edges that still want a split at the highest level allowed.
        blocked: Edges that should have been split (asked for, or needed for others) and must not be.
        levels: Deepest level reached; 0: nothing was split.
    """

    triangles: Ints
    parents: Ints
    barycentrics: Floats
    vertex_count: int
    coarse_vertex_count: int
    matrix: Matrix | None
    linear: Matrix | None
    limited: int
    blocked: int
    levels: int

    @property
    def changed(self) -> Bools:
        """(F',) the triangles that are not coarse ones."""
        changed: Bools = np.bincount(self.parents)[self.parents] > 1
        return changed

    def positions(self, coarse: Floats) -> Floats:
        """(..., V, C) coarse positions or morph deltas → (..., V', C); the first V are the same bits."""
        return _apply(self.matrix, coarse)

    def interpolate(self, coarse: Floats) -> Floats:
        """(..., V, C) skin weights or the like → (..., V', C); the first V are the same bits."""
        return _apply(self.linear, coarse)


Criterion: TypeAlias = Callable[[Level], Bools]


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
    where: str = "",
) -> Subdivision:
    """Split the edges that want it, and those that must follow to keep the mesh conforming.

    Any mesh will do: open, non-manifold, in pieces, wound inconsistently. A triangle with two equal corners
    passes through untouched and does not count as a face.

    Args:
        triangles: (F, 3) welded vertices.
        vertex_count: V, of the coarse mesh.
        wants: (E,) for each edge of a level, whether it should split. Called again with a level that has
            grown (what it once wanted stays wanted), and with level `max_levels`, only to be counted.
        forbids: (E,) for each edge of a level, whether it must never split. An edge whose split would need
            that of a forbidden one is not split either.
        shows: (E,) for each edge of a level, whether a split of it could be seen. One that could not is undone, unless
            finer ones need it. All are left where there is no such criterion.
        max_levels: How often an edge may be halved.
        near: (F,) triangles that have every edge that wants a split, at any level; all where left out. What lies
            further off takes hardly any time.
        scheme: `butterfly`, smooth through the coarse vertices, or `midpoint`, which keeps the coarse shape.
        where: Whose triangles they are, for the message.

    Returns:
        The plan. New vertices are numbered by level, then by their edge's vertex pair.

    Raises:
        BakeError: A level would have more than 500,000 new triangles.
    """
    triangles = np.asarray(triangles, dtype=np.intp)
    held = np.ones(len(triangles), dtype=np.bool_) if near is None else _held(near, triangles, vertex_count)
    root = _root(triangles, held, vertex_count, wants, forbids)
    stages, wasted = _close(root, [], wants, forbids, max_levels, scheme, where)
    if wasted:
        # Splits that proved impossible had asked for others at coarser levels: plan again without them.
        stages, _ = _close(root, stages, wants, forbids, max_levels, scheme, where)

    deepest = stages[-1]
    shown = [np.ones(stage.split.size, dtype=np.bool_) if shows is None else shows(stage.level) for stage in stages]
    limited = shown[-1] & deepest.wanted & ~deepest.forbidden if len(stages) > max_levels else shown[-1][:0]
    needed = _needed(stages, shown)
    fine, parents, barycentrics = _leaves(triangles, stages, needed)
    # Coarse vertices, and those of splits that are needed.
    kept = _flags(fine, deepest.complete.size)
    kept[:vertex_count] = True
    matrix, linear = deepest.level.matrix, deepest.level.linear
    if matrix is not None and linear is not None:
        rows, same = np.flatnonzero(kept), matrix is linear
        linear = linear.chosen(rows) if len(rows) > vertex_count else None
        matrix = linear if same or linear is None else matrix.chosen(rows)
    return Subdivision(
        triangles=(np.cumsum(kept) - 1)[fine],
        parents=parents,
        barycentrics=barycentrics,
        vertex_count=int(kept.sum()),
        coarse_vertex_count=vertex_count,
        matrix=matrix,
        linear=linear,
        limited=int(limited.sum()),
        blocked=sum(int(stage.denied.sum()) for stage in stages),
        levels=max((level + 1 for level, splits in enumerate(needed) if splits.any()), default=0),
    )


@dataclass(frozen=True, slots=True)
class _Stage:
    """A level on its way to the fixpoint.

    Attributes:
        level: The faces and edges.
        codes: (F,) the face's path from its coarse triangle, four times the parent's plus 0 to 3; ascending.
            The same face has the same code however the level grows.
        barycentrics: (F, 3, 3) of each corner in the coarse triangle.
        complete: (vertices,) whether all faces round the vertex exist at this level.
        wanted: (E,) edges that should split, for themselves or for a finer level.
        forbidden: (E,) edges that must not.
        denied: (E,) edges that should split but cannot.
        split: (E,) edges that do; both ends are complete.
    """

    level: Level
    codes: Ints
    barycentrics: Floats
    complete: Bools
    wanted: Bools
    forbidden: Bools
    denied: Bools
    split: Bools

    @property
    def red(self) -> Bools:
        """(F,) faces that split in four."""
        return ~_any(~self.split, self.level.triangle_edges)

    def faces_at(self, vertices: Bools) -> Bools:
        """(F,) faces round any of the flagged vertices of the next level."""
        count = self.complete.size
        edges = np.zeros(self.split.size, dtype=np.bool_)
        edges[self.split] = vertices[count:]
        return _any(vertices[:count], self.level.triangles) | _any(edges, self.level.triangle_edges)

    def vertices_on(self, faces: Bools) -> Bools:
        """(vertices of the next level,) those on any of the flagged faces."""
        corners = np.zeros(self.complete.size, dtype=np.bool_)
        corners[self.level.triangles[faces]] = True
        return np.concatenate([corners, self.edges_of(faces)[self.split]])

    def edges_of(self, faces: Bools) -> Bools:
        """(E,) edges of any of the flagged faces."""
        edges = np.zeros(self.split.size, dtype=np.bool_)
        edges[self.level.triangle_edges[faces]] = True
        return edges


def _held(near: Bools, triangles: Ints, vertex_count: int) -> Bools:
    """(F,) the triangles that matter where all edges that want a split are of the flagged ones: two rings more.

    A finer edge asks for the faces round its ends, at every level for half as far as at the level below: in all for
    less than the length of a triangle, so for no vertex beyond the first ring. The third edge of a face with two split
    ones has no end that they have not. And stencils see the faces round the ends of split edges: the second ring.
    """
    for _ in range(2):
        near = _any(_flags(triangles[near], vertex_count), triangles)
    return near


def _root(triangles: Ints, held: Bools, vertex_count: int, wants: Criterion, forbids: Criterion | None) -> _Stage:
    """Level 0 of (F,) flagged triangles; nothing is split."""
    a, b, c = triangles.T
    faces = np.flatnonzero(held & (a != b) & (b != c) & (c != a))
    return _stage(
        _level(0, None, None, triangles[faces], faces, vertex_count),
        codes=faces,
        barycentrics=np.broadcast_to(np.eye(3), (faces.size, 3, 3)),
        complete=np.ones(vertex_count, dtype=np.bool_),
        wants=wants,
        forbids=forbids,
    )


def _close(
    root: _Stage,
    earlier: list[_Stage],
    wants: Criterion,
    forbids: Criterion | None,
    max_levels: int,
    scheme: str,
    where: str,
) -> tuple[list[_Stage], bool]:
    """Find the smallest set of splits that has all the wanted ones and is closed.

    Splits only ever grow and faces are finitely many, so this ends.

    Args:
        root: Level 0 with nothing split.
        earlier: The stages of an earlier attempt, for what they denied; or none.
        wants: See `subdivide`.
        forbids: See `subdivide`.
        max_levels: See `subdivide`.
        scheme: See `subdivide`.
        where: See `subdivide`.

    Returns:
        The stages, and whether one found out late that a split cannot be.
    """
    stages = [replace(root, denied=_carried(earlier, root, "denied"))]
    wasted = False
    at = 0
    while at < max_levels:
        stage = stages[at]
        ends = stage.level.edges
        pending = stage.wanted & ~stage.split
        stage = replace(stage, denied=stage.denied | (pending & stage.forbidden))
        pending &= ~stage.denied
        early = pending & ~stage.complete[ends].all(axis=1)
        if early.any():
            # The faces round their ends must first all exist here, that is, be red one level below.
            below = stages[at - 1]
            hopeless = below.vertices_on(_any(below.forbidden | below.denied, below.level.triangle_edges))
            lost = early & hopeless[ends].any(axis=1)
            needed, missed = (
                below.edges_of(below.faces_at(_flags(ends[edges], stage.complete.size) & ~stage.complete))
                for edges in (early & ~lost, lost)
            )
            stages[at] = replace(stage, denied=stage.denied | lost)
            stages[at - 1] = replace(
                below, wanted=below.wanted | needed, denied=below.denied | (missed & below.forbidden)
            )
            wasted |= bool(lost.any())
            at -= bool(needed.any())
            continue
        stages[at] = stage = _promoted(replace(stage, split=stage.split | pending))
        if not stage.split.any():
            break
        at += 1
        # Built anew, as what changed below may have renumbered the vertices; but what was settled here stays
        # settled, or the work would double with each level.
        count = 4 * int(np.count_nonzero(stage.red))
        if count > _MOST_TRIANGLES:
            raise BakeError(
                f"would have {count:,} triangles at level {at} of refinement; at most {_MOST_TRIANGLES:,} are made:"
                f" lower max_levels, now {max_levels}, or ask for fewer bumps or details",
                where=where,
            )
        child = _child(stage, wants, forbids, scheme)
        child = replace(
            child,
            wanted=child.wanted | _carried(stages, child, "wanted"),
            denied=_carried(stages, child, "denied") | _carried(earlier, child, "denied"),
            split=_carried(stages, child, "split"),
        )
        stages[at : at + 1] = [child]
    return stages, wasted


def _promoted(stage: _Stage) -> _Stage:
    """Split the third edge of each face that has two split ones, unless that is forbidden.

    Its ends are ends of the other two, so no finer face is missing there.
    """
    split, denied = stage.split.copy(), stage.denied.copy()
    following = stage.level.triangle_edges
    while True:
        a, b, c = split[following].T
        thirds = np.concatenate([following[b & c & ~a, 0], following[c & a & ~b, 1], following[a & b & ~c, 2]])
        denied[thirds[stage.forbidden[thirds]]] = True
        thirds = thirds[~denied[thirds]]
        if not thirds.size:
            return replace(stage, split=split, denied=denied)
        split[thirds] = True


def _child(stage: _Stage, wants: Criterion, forbids: Criterion | None, scheme: str) -> _Stage:
    """The next level: the quarters of the red faces, and a vertex for each split edge."""
    level, red = stage.level, stage.red
    ends = level.edges[stage.split]
    count = stage.complete.size
    halves = Matrix.of_entries(np.repeat(np.arange(len(ends)), 2), ends.reshape(-1), np.full(ends.size, 0.5), count)
    linear = halves.below(level.linear)
    matrix = linear if scheme == "midpoint" else _butterfly(level.triangles, ends, count).below(level.matrix)
    corners, barycentrics = _six(stage, red)
    return _stage(
        _level(
            level.number + 1,
            matrix,
            linear,
            corners[:, _RED].reshape(-1, 3),
            np.repeat(level.parents[red], 4),
            stage.complete.size + len(ends),
        ),
        codes=(4 * stage.codes[red][:, None] + np.arange(4)).reshape(-1),
        barycentrics=barycentrics[:, _RED].reshape(-1, 3, 3),
        complete=np.append(stage.complete, np.ones(len(ends), dtype=np.bool_)) & ~stage.vertices_on(~red),
        wants=wants,
        forbids=forbids,
    )


def _stage(
    level: Level,
    *,
    codes: Ints,
    barycentrics: Floats,
    complete: Bools,
    wants: Criterion,
    forbids: Criterion | None,
) -> _Stage:
    none = np.zeros(len(level.edges), dtype=np.bool_)
    return _Stage(
        level=level,
        codes=codes,
        barycentrics=barycentrics,
        complete=complete,
        wanted=none | wants(level),
        forbidden=none if forbids is None else none | forbids(level),
        denied=none,
        split=none,
    )


def _level(
    number: int,
    matrix: Matrix | None,
    linear: Matrix | None,
    triangles: Ints,
    parents: Ints,
    vertex_count: int,
) -> Level:
    following = np.roll(triangles, -1, axis=1)
    keys = np.minimum(triangles, following) * vertex_count + np.maximum(triangles, following)
    edges, triangle_edges = np.unique(keys.reshape(-1), return_inverse=True)
    return Level(
        number=number,
        matrix=matrix,
        linear=linear,
        triangles=triangles,
        parents=parents,
        edges=np.stack(np.divmod(edges, max(vertex_count, 1)), axis=1),
        triangle_edges=triangle_edges.reshape(triangles.shape),
    )


def _carried(stages: list[_Stage], stage: _Stage, name: Literal["wanted", "denied", "split"]) -> Bools:
    """(E,) the flags that the same level's edges had among `stages`, faces being known by their codes."""
    flags = np.zeros(stage.split.size, dtype=np.bool_)
    if stage.level.number < len(stages):
        old = stages[stage.level.number]
        kept, of_old = _among(stage.codes, old.codes), _among(old.codes, stage.codes)
        marked: Bools = getattr(old, name)[old.level.triangle_edges[of_old]]
        flags[stage.level.triangle_edges[kept][marked]] = True
    return flags


def _needed(stages: list[_Stage], shown: list[Bools]) -> list[Bools]:
    """For each stage (E,) the splits that show, and those that finer ones need: of all faces round their ends."""
    needed = [stages[-1].split & shown[-1]]
    for below, above, seen in zip(stages[-2::-1], stages[:0:-1], shown[-2::-1], strict=True):
        ends = _flags(above.level.edges[needed[0]], above.complete.size)
        needed.insert(0, below.split & (seen | below.edges_of(below.faces_at(ends))))
    return needed


def _leaves(triangles: Ints, stages: list[_Stage], needed: list[Bools]) -> tuple[Ints, Ints, Floats]:
    """The fine triangles (F', 3), their coarse ones (F',) and barycentrics (F', 3, 3), in coarse order.

    Args:
        triangles: (F, 3) coarse ones.
        stages: All levels.
        needed: For each (E,) the splits to make.
    """
    finest = len(stages) - 1
    whole = np.flatnonzero(~_flags(stages[0].codes, len(triangles)))
    found, weights = [triangles[whole]], []
    places = [whole * 4**finest]
    there = np.ones(stages[0].codes.size, dtype=np.bool_)
    for depth, (stage, splits) in enumerate(zip(stages, needed, strict=True)):
        scale = 4 ** (finest - depth)
        touched, red = _any(splits, stage.level.triangle_edges), ~_any(~splits, stage.level.triangle_edges)
        whole_here = there & ~touched
        found.append(stage.level.triangles[whole_here])
        weights.append(stage.barycentrics[whole_here])
        places.append(stage.codes[whole_here] * scale)

        green = there & touched & ~red
        there = np.repeat((there & red)[stage.red], 4)
        split = splits[stage.level.triangle_edges[green]]
        codes = stage.codes[green]
        corners, barycentrics = _six(stage, green)
        two = split.sum(axis=1) == 2
        for turn in range(3):
            turned = (np.arange(3) + turn) % 3
            turned = np.append(turned, 3 + turned)
            # By number, so that faces with the same vertices (double-sided) share the diagonal as well.
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
    barycentrics, refined = np.tile(np.eye(3), (order.size, 1, 1)), order >= whole.size
    barycentrics[refined] = np.concatenate(weights)[order[refined] - whole.size]
    return np.concatenate(found)[order], place[order] // 4**finest, barycentrics


def _six(stage: _Stage, faces: Bools) -> tuple[Ints, Floats]:
    """(n, 6) vertices, (n, 6, 3) barycentrics: a face's corners, its edges' midpoints (-1: not split)."""
    midpoints = np.full(stage.split.size, -1)
    midpoints[stage.split] = stage.complete.size + np.arange(np.count_nonzero(stage.split))
    corners = stage.level.triangles[faces]
    at_corners = stage.barycentrics[faces]
    halfway = (at_corners + np.roll(at_corners, -1, axis=1)) / 2
    return (
        np.concatenate([corners, midpoints[stage.level.triangle_edges[faces]]], axis=1),
        np.concatenate([at_corners, halfway], axis=1),
    )


def _butterfly(triangles: Ints, ends: Ints, vertex_count: int) -> Matrix:
    """The modified butterfly's stencils.

    Differs: a vertex of more than 256 edges has none.

    Args:
        triangles: (F, 3) vertices; all faces round the ends are among them.
        ends: (n, 2) vertices of the edges to split.
        vertex_count: Of the level.

    Returns:
        (n, vertex_count) weights; rows sum to 1.
    """
    fans = _fans(triangles, _flags(ends, vertex_count))
    valences = fans.valences[ends]
    valences = np.where(valences > _MOST_VALENCE, 0, valences)
    peculiar = (valences != 0) & (valences != 6)
    peculiar_count = peculiar.sum(axis=1)
    # Each end has a share in the edge's stencil, and spreads it over itself and its ring.
    shares = peculiar / np.maximum(peculiar_count, 1)[:, None]
    shares[(valences == 6).all(axis=1)] = 1.0

    border = fans.border_counts[ends] == 2
    border = border.all(axis=1) & fans.is_border(ends)
    plain = (shares.sum(axis=1) == 0.0) & ~border
    edges = np.arange(len(ends))
    beyond = fans.border_sums[ends[border]] - ends[border][:, ::-1]
    rows = [np.repeat(edges[plain], 2), np.repeat(edges[border], 4)]
    columns = [ends[plain].reshape(-1), np.concatenate([ends[border], beyond], axis=1).reshape(-1)]
    weights = [
        np.full(2 * np.count_nonzero(plain), 1 / 2),
        np.tile([9 / 16, 9 / 16, -1 / 16, -1 / 16], np.count_nonzero(border)),
    ]
    for valence in distinct_values(valences[shares > 0.0]).tolist():
        edge, end = np.nonzero((valences == valence) & (shares > 0.0))
        own, around = _ring_weights(valence)
        stencil = shares[edge, end][:, None] * [own, *around]
        ring = fans.rings(ends[edge, end], ends[edge, 1 - end], valence)
        rows.append(np.repeat(edge, valence + 1))
        columns.append(np.concatenate([ends[edge, end][:, None], ring], axis=1).reshape(-1))
        weights.append(stencil.reshape(-1))
    return Matrix.of_entries(np.concatenate(rows), np.concatenate(columns), np.concatenate(weights), vertex_count)


def _ring_weights(valence: int) -> tuple[float, tuple[float, ...]]:
    """Weight of an edge's end, and of the end's ring from the edge's other end on.

    For valence 6 it is half of the regular stencil (the edge's other end brings the other half), for any
    other all of the extraordinary one.
    """
    if valence == 6:
        return 1 / 2, (0.0, 1 / 16, -1 / 16, 0.0, -1 / 16, 1 / 16)
    if valence == 4:
        return 3 / 4, (3 / 8, 0.0, -1 / 8, 0.0)
    if valence == 3:
        return 3 / 4, (5 / 12, -1 / 12, -1 / 12)
    # The nearer way round, so that mirrored rings have the same bits.
    angles = [2 * math.pi * min(j, valence - j) / valence for j in range(valence)]
    return 3 / 4, tuple((1 / 4 + math.cos(a) + math.cos(2 * a) / 2) / valence for a in angles)


@dataclass(frozen=True, slots=True)
class _Fans:
    """The faces round some vertices, as half-edges (vertex, next corner, corner after that).

    Attributes:
        vertex_count: Of the level.
        keys: (H,) vertex · vertex_count + next corner; ascending.
        nexts: (H,) the next corner.
        successors: (H,) the half-edge of the same vertex whose next corner is this one's last; right only in
            closed fans.
        valences: (vertices,) of vertices that one closed, consistently wound fan surrounds; else 0.
        border_counts: (vertices,) edges at the vertex that have one face.
        border_sums: (vertices,) sum of the other ends of those.
        border_keys: (B,) vertex · vertex_count + other end of those; ascending.
    """

    vertex_count: int
    keys: Ints
    nexts: Ints
    successors: Ints
    valences: Ints
    border_counts: Ints
    border_sums: Ints
    border_keys: Ints

    def is_border(self, ends: Ints) -> Bools:
        """(n, 2) ends of edges → (n,) whether the edge has exactly one face."""
        return _among(ends[:, 0] * self.vertex_count + ends[:, 1], self.border_keys)

    def rings(self, vertices: Ints, firsts: Ints, valence: int) -> Ints:
        """(n, valence) vertices round each of (n,) closed fans, from (n,) given ones on."""
        at = np.searchsorted(self.keys, vertices * self.vertex_count + firsts)
        ring = []
        for _ in range(valence):
            ring.append(self.nexts[at])
            at = self.successors[at]
        return np.stack(ring, axis=1)


def _fans(triangles: Ints, centres: Bools) -> _Fans:
    """Walk round the flagged vertices only: a patch is small in a large mesh.

    Args:
        triangles: (F, 3) vertices.
        centres: (vertices,) flags.
    """
    count = centres.size
    near = triangles[_any(centres, triangles)]
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

    # Closed: each spoke once a next and once a last corner, and the walk from any comes past them all.
    open_at = np.zeros(count, dtype=np.bool_)
    open_at[vertices[keys[successors] != last_keys]] = True
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


def _apply(matrix: Matrix | None, coarse: Floats) -> Floats:
    """(V', V) times (..., V, C) → (..., V', C). The first V are copied: 0.0 + -0.0 would lose a sign."""
    coarse = np.asarray(coarse, dtype=np.float64)
    if matrix is None:
        return coarse.copy()
    count = coarse.shape[-2]
    columns = np.moveaxis(coarse, -2, 0)
    new = matrix.of_rows(np.arange(count, matrix.shape[0]), columns.reshape(count, -1))
    return np.concatenate([coarse, np.moveaxis(new.reshape(new.shape[0], *columns.shape[1:]), 0, -2)], axis=-2)


def _among(values: Ints, ascending: Ints) -> Bools:
    """(n,) whether each of (n,) values is one of some, which ascend."""
    found: Bools = np.searchsorted(ascending, values, "right") > np.searchsorted(ascending, values)
    return found


def _any(flags: Bools, members: Ints) -> Bools:
    """(n,) whether any of the three members of (n, 3) is flagged; several times faster than `any`."""
    a, b, c = members.T
    found: Bools = flags[a] | flags[b] | flags[c]
    return found


def _flags(members: Ints, count: int) -> Bools:
    """(count,) True at the members."""
    flags = np.zeros(count, dtype=np.bool_)
    flags[members] = True
    return flags
