"""Edges that pass through triangles of a surface that moves: what a fold shows where it goes through itself.

Candidates come from trees of bounding boxes, which are made once, at rest, and refitted to each pose. No pair is looked
at twice, and nothing hangs on the order of the triangles but the numbers of what is found.

Source: C. Ericson, *Real-Time Collision Detection*, 2005, §6.3 (descent of two hierarchies) and §5.3.4 (segments and
triangles by signed volumes). Differs: all pairs of a level of the trees are compared at once.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct

# Pairs of boxes that are compared at once: bounds the memory.
_PAIRS = 2**19
# Bits of a coordinate in the order of the leaves.
_BITS = 10


@dataclass(frozen=True, slots=True)
class Crossings:
    """What may cross on a surface.

    Attributes:
        triangles: (triangles, 3) vertices.
        edges: (edges, 2) vertices, the lower first, each once, in rising order.
        triangle_order: (triangles,) the leaves of a tree, neighbours beside each other,
        edge_order: and (edges,) those of another.
    """

    triangles: Ints
    edges: Ints
    triangle_order: Ints
    edge_order: Ints

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Crossings":
        """Plan the trees of (triangles, 3) over (vertices, 3) positions at rest."""
        edges = edges_of(triangles)
        return cls(triangles, edges, *(_morton_order(positions[each].mean(axis=1)) for each in (triangles, edges)))

    def at(self, positions: Floats) -> tuple[Ints, Ints]:
        """Find what crosses in a pose.

        Args:
            positions: (vertices, 3).

        Returns:
            (crossings,) an edge and (crossings,) a triangle that it passes through, ordered by edge and triangle. What
            only touches, or shares a vertex, does not count.
        """
        depth = max(len(self.triangles), len(self.edges), 1).bit_length()
        trees = [
            _tree(positions[corners[order]], depth)
            for corners, order in ((self.edges, self.edge_order), (self.triangles, self.triangle_order))
        ]
        found = []
        stack = [(0, np.zeros(1, np.intp), np.zeros(1, np.intp))]
        while stack:
            level, edges, triangles = stack.pop()
            (low, high), (other_low, other_high) = (tree[level] for tree in trees)
            meets = np.ones(len(edges), bool)
            for k in range(3):
                meets &= (low[k][edges] <= other_high[k][triangles]) & (high[k][edges] >= other_low[k][triangles])
            edges, triangles = edges[meets], triangles[meets]
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

    def _crossing(self, positions: Floats, edges: Ints, triangles: Ints) -> Ints:
        """(crossings, 2) those of (pairs,) edges and (pairs,) triangles that cross."""
        ends, corners = self.edges[edges], self.triangles[triangles]
        apart = (ends[:, :, None] != corners[:, None, :]).all(axis=(1, 2))
        edges, triangles, ends, corners = edges[apart], triangles[apart], ends[apart], corners[apart]
        crosses = pass_through(positions[ends], positions[corners])
        return np.stack([edges[crosses], triangles[crosses]], axis=1)


def edges_of(triangles: Ints) -> Ints:
    """(edges, 2) the edges of (triangles, 3), the lower vertex first, each once, in rising order."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.asarray(sides[distinct(sides)[0]], np.intp)


def widened(edges: Ints, marked: Bools) -> Bools:
    """(vertices,) those marked, and those that (edges, 2) join to them."""
    first, second = edges.T
    wider = marked.copy()
    wider[second[marked[first]]] = True
    wider[first[marked[second]]] = True
    return wider


def pass_through(ends: Floats, corners: Floats) -> Bools:
    """(pairs,) whether segments of (pairs, 2, 3) ends pass through triangles of (pairs, 3, 3) corners."""
    start, stop = ends[:, 0], ends[:, 1]
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    sides = np.sign(np.sum((start - a) * normal, axis=1)) * np.sign(np.sum((stop - a) * normal, axis=1))
    passing = sides < 0
    ray = (stop - start)[passing]
    a, b, c = (each[passing] - start[passing] for each in (a, b, c))
    turns = [np.sign(np.sum(ray * np.cross(one, other), axis=1)) for one, other in ((a, b), (b, c), (c, a))]
    # Along an edge that two triangles share, exactly one of them has to count: rounding decides which.
    passing[passing] = np.abs(turns[0] + turns[1] + turns[2]) == 3
    return np.asarray(passing)


def _tree(corners: Floats, depth: int) -> list[tuple[Floats, Floats]]:
    """For each level of a binary tree (3, boxes) least and greatest coordinates; the last has (things, n, 3) boxed."""
    low, high = np.full((3, 2**depth), np.inf), np.full((3, 2**depth), -np.inf)
    low[:, : len(corners)], high[:, : len(corners)] = corners.min(axis=1).T, corners.max(axis=1).T
    # What a scale of 0 hides lies in one point, crosses nothing, and would meet all else that is hidden.
    hidden = (low == high).all(axis=0)
    low[:, hidden], high[:, hidden] = np.inf, -np.inf
    levels = [(low, high)]
    for _ in range(depth):
        low, high = np.minimum(low[:, ::2], low[:, 1::2]), np.maximum(high[:, ::2], high[:, 1::2])
        levels.append((low, high))
    return levels[::-1]


def _morton_order(points: Floats) -> Ints:
    """(points,) in an order in which neighbours in space are mostly neighbours: bits of coordinates in turns."""
    low = points.min(axis=0, initial=np.inf)
    size = float((points - low).max(initial=0.0)) or 1.0
    cells = np.minimum((points - low) / size * 2**_BITS, 2**_BITS - 1).astype(np.int64)
    codes = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for k in range(3):
            codes |= (cells[:, k] >> bit & 1) << (3 * bit + k)
    return np.argsort(codes, kind="stable")
