"""Red-green refinement: finds the edges to split at each level so that the mesh stays conforming.

A face whose edges are all split is red: it splits in four, and its quarters belong to the next level. A face with some
split edges is green: it splits in two or three, and is a leaf.

Source: R. E. Bank, A. H. Sherman, A. Weiser, *Some Subdivision Algorithms and Data Structures for Regular Local Mesh
Subdivision*, Scientific Computing, 1983: red-green closure.

Differs:
    - An edge splits only where all faces round both its ends belong to the level, so that stencils, which never read
      green faces, put each new vertex exactly where refining the whole mesh would.
    - A face with two split edges splits in four unless its third edge must not split, then in three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, distinct_values, flags_of, places_of, renumbered
from wrinklecli.numeric.edges import numbered_edges
from wrinklecli.numeric.sparse import Matrix

# Corners 0, 1, 2 of a face and the midpoints 3, 4, 5 of the edges that follow them.
_RED = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


@dataclass(frozen=True, slots=True)
class Level:
    """One level of subdivision as far as it exists, as the criteria of `subdivide` see it.

    When the level grows, `wants` and `forbids` see only the faces that it gains, among all edges.

    Attributes:
        number: 0 for the coarse mesh.
        linear: (vertices, coarse vertices) weights that put each new vertex at the midpoint of its edge.
        triangles: (F, 3) vertices. Level 0 has the coarse triangles `near` wanted splits, except those with two equal
            corners. A higher level has the quarters of red faces. Vertices are those of the coarse ones `near` wanted
            splits, in their order, then those of each level: nothing is as large as the mesh.
        parents: (F,) the coarse triangle of each, sorted.
        edges: (E, 2) vertices, the lower first, sorted.
        triangle_edges: (F, 3); column c is the edge from corner c to the corner that follows it.
        barycentrics: (F, 3, 3) coordinates of each corner in the coarse triangle.
    """

    number: int
    linear: Matrix
    triangles: Ints
    parents: Ints
    edges: Ints
    triangle_edges: Ints
    barycentrics: Floats

    def of_vertices(self, vertices: Ints, coarse: Floats) -> Floats:
        """(vertices, …) linear mixtures of (coarse vertices, …) values at some vertices."""
        return self.linear.of_rows(vertices, coarse)

    def of_midpoints(self, edges: Ints, coarse: Floats) -> Floats:
        """(edges, …) linear mixtures of (coarse vertices, …) values at the midpoints of some edges."""
        vertices, ends = renumbered(self.edges[edges])
        a, b = self.of_vertices(vertices, coarse)[ends.T]
        return np.asarray((a + b) / 2.0)


Criterion: TypeAlias = Callable[[Level], Bools]
_Flag: TypeAlias = Literal["wanted", "asked", "forbidden", "denied", "split"]


@dataclass(frozen=True, slots=True)
class Rules:
    """The options of `subdivide`, which explains them."""

    wants: Criterion
    forbids: Criterion | None
    max_levels: int
    max_vertices: int | None
    where: str


@dataclass(frozen=True, slots=True)
class Stage:
    """A level and the state of its edges while splits are still added.

    Attributes:
        codes: (F,) sorted paths from the coarse triangles: four times the parent's code plus 0 to 3. A face keeps its
            code however the level grows.
        complete: (vertices,) True if all faces round the vertex exist at this level.
        wanted: (E,) edges that should split for themselves.
        asked: (E,) edges that should split for a finer level.
        forbidden: (E,) edges that must not split.
        denied: (E,) edges that should split but cannot.
        split: (E,) edges that split; both their ends are complete.
    """

    level: Level
    codes: Ints
    complete: Bools
    wanted: Bools
    asked: Bools
    forbidden: Bools
    denied: Bools
    split: Bools

    @property
    def red(self) -> Bools:
        """(F,) faces that split in four."""
        return ~any_of(~self.split, self.level.triangle_edges)

    def faces_at(self, vertices: Bools) -> Bools:
        """(F,) faces round any of the flagged vertices of the next level."""
        count = self.complete.size
        edges = np.zeros(self.split.size, dtype=np.bool_)
        edges[self.split] = vertices[count:]
        return any_of(vertices[:count], self.level.triangles) | any_of(edges, self.level.triangle_edges)

    def vertices_on(self, faces: Bools) -> Bools:
        """(vertices of the next level,) those on any of the flagged faces."""
        corners = flags_of(self.level.triangles[faces], self.complete.size)
        return np.concatenate([corners, self.edges_of(faces)[self.split]])

    def edges_of(self, faces: Bools) -> Bools:
        """(E,) edges of any of the flagged faces."""
        return flags_of(self.level.triangle_edges[faces], self.split.size)

    def corners_and_midpoints(self, faces: Bools) -> tuple[Ints, Floats]:
        """(n, 6) vertices and (n, 6, 3) barycentrics: a face's corners, then its edges' midpoints (-1: not split)."""
        midpoints = np.full(self.split.size, -1)
        midpoints[self.split] = self.complete.size + np.arange(np.count_nonzero(self.split))
        corners = self.level.triangles[faces]
        at_corners = self.level.barycentrics[faces]
        halfway = (at_corners + np.roll(at_corners, -1, axis=1)) / 2
        return (
            np.concatenate([corners, midpoints[self.level.triangle_edges[faces]]], axis=1),
            np.concatenate([at_corners, halfway], axis=1),
        )


def coarse_stage(triangles: Ints, held: Bools, vertex_count: int, rules: Rules) -> Stage:
    """Level 0 of (F,) flagged triangles; nothing is split."""
    faces = np.flatnonzero(held)
    a, b, c = triangles[faces].T
    faces = faces[(a != b) & (b != c) & (c != a)]
    vertices = distinct_values(triangles[faces])
    linear = Matrix.identity(vertex_count).chosen(vertices)
    numbers = places_of(vertices, vertex_count)
    barycentrics = np.broadcast_to(np.eye(3), (faces.size, 3, 3))
    return _stage(
        _level(0, linear, numbers[triangles[faces]], faces, barycentrics),
        codes=faces,
        complete=np.ones(len(vertices), dtype=np.bool_),
        rules=rules,
    )


def close(root: Stage, earlier: list[Stage], rules: Rules) -> tuple[list[Stage], bool]:
    """Find the smallest closed set of splits that has all wanted ones.

    Splits are made level by level. A split whose ends lack faces at its level asks for these faces one level below,
    where the work goes on, or is denied if they cannot exist. Splits and denials only grow, and faces are finitely
    many, so this ends.

    Args:
        root: Level 0 with nothing split.
        earlier: The stages of an earlier attempt, whose denials and criteria are kept; or none.
        rules: The options of the subdivision.

    Returns:
        The stages, and True if a split was denied after others had been made for its sake.

    Raises:
        BakeError: There would be too many new vertices.
    """
    denied = _Older.of(earlier, root.level, root.codes).carried("denied", root.denied.size)
    stages = [replace(root, denied=denied)]
    wasted = False
    at = 0
    while at < rules.max_levels:
        stage = stages[at]
        pending = (stage.wanted | stage.asked) & ~stage.split
        stage = replace(stage, denied=stage.denied | (pending & stage.forbidden))
        pending &= ~stage.denied
        early = pending & ~stage.complete[stage.level.edges].all(axis=1)
        if not early.any():
            stages[at] = stage = _promoted(replace(stage, split=stage.split | pending))
            if not stage.split.any():
                break
            at += 1
            stages[at : at + 1] = [_child(stage, stages, earlier, rules)]
            continue
        # All faces round the ends of the early edges must first exist here, so they must be red one level below.
        below = stages[at - 1]
        hopeless = below.vertices_on(any_of(below.forbidden | below.denied, below.level.triangle_edges))
        lost = early & hopeless[stage.level.edges].any(axis=1)
        if lost.any():
            missed = below.forbidden & _lacking(below, stage, lost)
            stages[at - 1 : at + 1] = [
                replace(below, denied=below.denied | missed),
                replace(stage, denied=stage.denied | lost),
            ]
            wasted = True
        else:
            stages[at - 1 : at + 1] = [replace(below, asked=below.asked | _lacking(below, stage, early)), stage]
            at -= 1
    return stages, wasted


def _lacking(below: Stage, stage: Stage, edges: Bools) -> Bools:
    """(E of the level below,) edges that must split so that all faces round the flagged edges' ends exist above."""
    ends = flags_of(stage.level.edges[edges], stage.complete.size)
    return below.edges_of(below.faces_at(ends & ~stage.complete))


def _promoted(stage: Stage) -> Stage:
    """Split the third edge of each face with two split ones, unless it is forbidden.

    Its ends are ends of the other two edges, so no finer face is missing there.
    """
    split, denied = stage.split.copy(), stage.denied.copy()
    # Column by column, as numpy is slow to reduce rows of three.
    first, second, third = stage.level.triangle_edges.T
    while True:
        a, b, c = split[first], split[second], split[third]
        thirds = np.concatenate([first[b & c & ~a], second[c & a & ~b], third[a & b & ~c]])
        denied[thirds[stage.forbidden[thirds]]] = True
        thirds = thirds[~denied[thirds]]
        if not thirds.size:
            return replace(stage, split=split, denied=denied)
        split[thirds] = True


def _child(stage: Stage, stages: list[Stage], earlier: list[Stage], rules: Rules) -> Stage:
    """Build the next level: the quarters of the red faces, and a vertex for each split edge.

    The level is built anew each time, as changes below may have renumbered the vertices. Decisions are taken over from
    `stages` and, if denied, from `earlier` ones: otherwise the work would double with each level. Only faces that
    both lack are judged by the criteria.
    """
    level, red = stage.level, stage.red
    ends = level.edges[stage.split]
    count = stage.complete.size
    new = count + len(ends) - stages[0].complete.size
    if rules.max_vertices is not None and new > rules.max_vertices:
        raise BakeError(
            f"would have {new:,} new vertices at level {level.number + 1} of refinement, and {rules.max_vertices:,} may"
            f" be: lower max_levels, now {rules.max_levels}, ask for fewer bumps or details, or raise --max-vertices",
            where=rules.where,
        )
    halves = Matrix(2 * np.arange(len(ends) + 1), ends.reshape(-1), np.full(ends.size, 0.5), count)
    corners, barycentrics = stage.corners_and_midpoints(red)
    return _stage(
        _level(
            level.number + 1,
            halves.below(level.linear),
            corners[:, _RED].reshape(-1, 3),
            np.repeat(level.parents[red], 4),
            barycentrics[:, _RED].reshape(-1, 3, 3),
        ),
        codes=(4 * stage.codes[red][:, None] + np.arange(4)).reshape(-1),
        complete=np.append(stage.complete, np.ones(len(ends), dtype=np.bool_)) & ~stage.vertices_on(~red),
        rules=rules,
        stages=stages,
        earlier=earlier,
    )


def _stage(
    level: Level,
    *,
    codes: Ints,
    complete: Bools,
    rules: Rules,
    stages: Sequence[Stage] = (),
    earlier: Sequence[Stage] = (),
) -> Stage:
    """A level that takes over what `stages`, which had some of its faces, decided, and what `earlier` ones denied."""
    known, former, count = _Older.of(stages, level, codes), _Older.of(earlier, level, codes), len(level.edges)
    wanted, forbidden, denied = (
        known.carried(name, count) | former.carried(name, count) for name in ("wanted", "forbidden", "denied")
    )
    faces = ~(known.faces | former.faces)
    added = replace(
        level,
        triangles=level.triangles[faces],
        parents=level.parents[faces],
        triangle_edges=level.triangle_edges[faces],
        barycentrics=level.barycentrics[faces],
    )
    return Stage(
        level,
        codes,
        complete,
        wanted=wanted | rules.wants(added),
        asked=known.carried("asked", count),
        forbidden=forbidden if rules.forbids is None else forbidden | rules.forbids(added),
        denied=denied,
        split=known.carried("split", count),
    )


@dataclass(frozen=True, slots=True)
class _Older:
    """An older state of a level, some of whose faces the level has still, or again.

    Attributes:
        stage: The older state; None if there is none.
        faces: (F,) True for the faces of the level that it had.
        edges: (n, 3) edges of these.
        old_edges: (n, 3) the same edges in the older state.
    """

    stage: Stage | None
    faces: Bools
    edges: Ints
    old_edges: Ints

    @classmethod
    def of(cls, stages: Sequence[Stage], level: Level, codes: Ints) -> _Older:
        """Find the level's faces, which have (F,) codes, in its older state, if `stages` have one."""
        none = np.zeros((0, 3), np.intp)
        if level.number >= len(stages):
            return cls(None, np.zeros(codes.size, np.bool_), none, none)
        old = stages[level.number]
        places = np.searchsorted(old.codes, codes)
        faces = np.append(old.codes, -1)[places] == codes
        return cls(old, faces, level.triangle_edges[faces], old.level.triangle_edges[places[faces]])

    def carried(self, name: _Flag, count: int) -> Bools:
        """(count,) the flags that the level's edges have in the older state."""
        flags = np.zeros(count, dtype=np.bool_)
        if self.stage is not None:
            marked: Bools = getattr(self.stage, name)[self.old_edges]
            flags[self.edges[marked]] = True
        return flags


def _level(number: int, linear: Matrix, triangles: Ints, parents: Ints, barycentrics: Floats) -> Level:
    return Level(number, linear, triangles, parents, *numbered_edges(triangles), barycentrics)
