"""Finds the edges of a moving surface that pass through its triangles.

Candidates come from trees of bounding boxes, which are built once at rest and refitted to each pose.

Source: C. Ericson, *Real-Time Collision Detection*, 2005, §6.3 (descent of two hierarchies) and §5.3.4 (segments and
triangles by signed volumes). Differs: all pairs of a level of the trees are compared at once.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, distinct, dot, flags_of

# Pairs of boxes that are compared at once, as many as a cache holds: with sixteen times as many a search takes a tenth
# longer.
_PAIRS = 2**15
# Bits of each coordinate in the Morton order of the leaves.
_BITS = 10


@dataclass(frozen=True, slots=True)
class Crossings:
    """The trees of a surface's edges and triangles.

    Attributes:
        triangles: (triangles, 3) vertices.
        edges: (edges, 2) vertices as `edges_of` sorts them.
        triangle_order: (triangles,) the leaves of the tree of triangles, along a Morton curve.
        edge_order: (edges,) the leaves of the tree of edges, likewise.
    """

    triangles: Ints
    edges: Ints
    triangle_order: Ints
    edge_order: Ints

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Crossings":
        """Build the trees of (triangles, 3) from (vertices, 3) positions at rest."""
        edges = edges_of(triangles)
        return cls(triangles, edges, *(_morton_order(positions[each].mean(axis=1)) for each in (triangles, edges)))

    def at(self, positions: Floats, counting: Bools | None = None) -> tuple[Ints, Ints]:
        """Find what crosses in a pose.

        Args:
            positions: (vertices, 3).
            counting: (vertices,) True for those of which a crossing must have at least one; None if all count.

        Returns:
            (crossings,) edges and (crossings,) the triangles that they pass through, sorted by edge, then triangle.
            Pairs that only touch or share a vertex do not count.
        """
        depth = max(len(self.triangles), len(self.edges), 1).bit_length()
        trees = [_tree(positions[corners[order]], depth) for corners, order in self._leaves]
        # A box of a tree counts if something in it does.
        counts = (
            [_any_tree(np.asarray(counting[corners[order]].any(axis=1)), depth) for corners, order in self._leaves]
            if counting is not None
            else []
        )
        found = []
        stack = [(0, np.zeros(1, np.intp), np.zeros(1, np.intp))]
        while stack:
            level, edges, triangles = stack.pop()
            if counts:
                counted = np.flatnonzero(counts[0][level].take(edges) | counts[1][level].take(triangles))
                edges, triangles = edges.take(counted), triangles.take(counted)
            (low, high), (other_low, other_high) = (tree[level] for tree in trees)
            for k in range(3):
                meets = low[k].take(edges) <= other_high[k].take(triangles)
                meets &= high[k].take(edges) >= other_low[k].take(triangles)
                meeting = np.flatnonzero(meets)
                edges, triangles = edges.take(meeting), triangles.take(meeting)
            if level == depth:
                found.append(self._crossing(positions, self.edge_order[edges], self.triangle_order[triangles]))
                continue
            edges = (2 * edges[:, None] + np.array([0, 0, 1, 1])).reshape(-1)
            triangles = (2 * triangles[:, None] + np.array([0, 1, 0, 1])).reshape(-1)
            stack += [
                (level + 1, edges[k : k + _PAIRS], triangles[k : k + _PAIRS]) for k in range(0, len(edges), _PAIRS)
            ]
        crossing = np.concatenate([np.zeros((0, 2), np.intp), *found])
        edges, triangles = crossing[np.lexsort(crossing.T[::-1])].T
        return edges, triangles

    def vertices_at(self, positions: Floats, counting: Bools) -> Bools:
        """(vertices,) True for the vertices of edges and triangles that cross at (vertices, 3) positions.

        Only crossings of which at least one vertex is among the (vertices,) `counting` are marked.
        """
        edges, triangles = self.at(positions)
        corners = np.concatenate([self.edges[edges], self.triangles[triangles]], axis=1)
        return flags_of(corners[counting[corners].any(axis=1)], len(positions))

    def pairs_at(self, positions: Floats, counting: Bools | None = None) -> set[tuple[int, int]]:
        """The edges and the triangles that they pass through at (vertices, 3) positions.

        If (vertices,) `counting` are given, only crossings of which at least one vertex is among these.
        """
        edges, triangles = self.at(positions, counting)
        return set(zip(edges.tolist(), triangles.tolist(), strict=True))

    @property
    def _leaves(self) -> tuple[tuple[Ints, Ints], tuple[Ints, Ints]]:
        """The corners and the order of the leaves, of both trees."""
        return (self.edges, self.edge_order), (self.triangles, self.triangle_order)

    def _crossing(self, positions: Floats, edges: Ints, triangles: Ints) -> Ints:
        """(crossings, 2) the pairs of (pairs,) edges and (pairs,) triangles that cross."""
        ends, corners = self.edges.T.take(edges, axis=1), self.triangles.T.take(triangles, axis=1)
        apart = np.flatnonzero(np.logical_and.reduce([end != corner for end in ends for corner in corners]))
        edges, triangles = edges.take(apart), triangles.take(apart)
        crosses = pass_through(positions[self.edges[edges]], positions[self.triangles[triangles]])
        return np.stack([edges[crosses], triangles[crosses]], axis=1)


def sides_of(triangles: Ints) -> Ints:
    """(3 · triangles, 2) the sides of one of (triangles, 3) after another, the lower vertex of each first."""
    return np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)


def edges_of(triangles: Ints) -> Ints:
    """(edges, 2) the distinct sides of (triangles, 3), sorted."""
    sides = sides_of(triangles)
    return np.asarray(sides[distinct(sides)[0]], np.intp)


def widened(edges: Ints, marked: Bools) -> Bools:
    """(vertices,) the marked vertices and their neighbours along (edges, 2)."""
    first, second = edges.T
    wider = marked.copy()
    wider[second[marked[first]]] = True
    wider[first[marked[second]]] = True
    return wider


def pass_through(ends: Floats, corners: Floats) -> Bools:
    """(pairs,) True where a segment of (pairs, 2, 3) ends passes through the triangle of (pairs, 3, 3) corners."""
    start, stop = ends[:, 0].T, ends[:, 1].T
    a, b, c = (corners[:, k].T for k in range(3))
    normal = cross(b - a, c - a)
    passing = np.flatnonzero(np.sign(dot(start - a, normal)) * np.sign(dot(stop - a, normal)) < 0)
    start, ray = start[:, passing], (stop - start)[:, passing]
    a, b, c = (each[:, passing] - start for each in (a, b, c))
    turns = [np.sign(dot(ray, cross(one, other))) for one, other in ((a, b), (b, c), (c, a))]
    # A segment through an edge that two triangles share must cross exactly one of them: rounding decides which.
    return flags_of(passing[np.abs(turns[0] + turns[1] + turns[2]) == 3], len(ends))


def _tree(corners: Floats, depth: int) -> list[tuple[Floats, Floats]]:
    """(3, boxes) least and greatest coordinates for each level, root first, of a tree over (things, n, 3) corners."""
    low, high = np.full((3, 2**depth), np.inf), np.full((3, 2**depth), -np.inf)
    low[:, : len(corners)], high[:, : len(corners)] = corners.min(axis=1).T, corners.max(axis=1).T
    # A scale of 0 hides parts in one point, where they cross nothing but their boxes would all meet.
    hidden = (low == high).all(axis=0)
    low[:, hidden], high[:, hidden] = np.inf, -np.inf
    levels = [(low, high)]
    for _ in range(depth):
        low, high = np.minimum(low[:, ::2], low[:, 1::2]), np.maximum(high[:, ::2], high[:, 1::2])
        levels.append((low, high))
    return levels[::-1]


def _any_tree(leaves: Bools, depth: int) -> list[Bools]:
    """(boxes,) True where any of the (things,) leaves below is, for each level of a tree, root first."""
    flags = np.zeros(2**depth, bool)
    flags[: len(leaves)] = leaves
    levels = [flags]
    for _ in range(depth):
        flags = flags[::2] | flags[1::2]
        levels.append(flags)
    return levels[::-1]


def _morton_order(points: Floats) -> Ints:
    """(points,) the order along a Morton curve, which interleaves the bits of the coordinates."""
    low = points.min(axis=0, initial=np.inf)
    size = float((points - low).max(initial=0.0)) or 1.0
    cells = np.minimum((points - low) / size * 2**_BITS, 2**_BITS - 1).astype(np.int64)
    codes = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for k in range(3):
            codes |= (cells[:, k] >> bit & 1) << (3 * bit + k)
    return np.argsort(codes, kind="stable")
