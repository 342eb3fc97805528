"""Finds the edges of a moving surface that pass through its triangles.

Candidates come from trees of bounding boxes, which are built once at rest and refitted to each pose. The sides of boxes
are rounded to whole cells, so that three of them are compared as one integer.

Source: C. Ericson, *Real-Time Collision Detection*, 2005, §6.3 (descent of two hierarchies) and §5.3.4 (segments and
triangles by signed volumes). Differs: all pairs of a level of the trees are compared at once. J. T. Klosowski and
others, *Efficient Collision Detection Using Bounding Volume Hierarchies of k-DOPs*, TVCG 4, 1998, on the directions
beside the axes. Differs: they are only compared where boxes meet.
"""

from collections.abc import Iterable
from functools import reduce
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, cross, distinct, dot, flags_of
from wrinklecli.numeric.portions import portions

# Bits of each coordinate of a box. With a guard bit for each, three of them fill an integer of 64 bits, and a
# subtraction compares all three at once.
_BITS = 20
# Cells along the longest side of the surface; two numbers beyond the cells are left for boxes that meet nothing.
_CELLS = 2**_BITS - 3
_GUARDS = np.int64(sum(1 << (_BITS + k * (_BITS + 1)) for k in range(3)))
# The diagonals of the faces of a box, three at a time: a narrow triangle that leans fills little of its box.
_DIAGONALS = [np.eye(3) + sign * np.roll(np.eye(3), 1, axis=1) for sign in (1.0, -1.0)]
# Level of the trees at which a search begins, with all pairs of its boxes: above it few pairs are told apart.
_TOP = 5
# Error of a coordinate of a posed vertex over the largest one: skinning adds about 2e-14.
_ROUNDING = 1e-12
# Bits of each coordinate in the Morton order of the leaves.
_MORTON_BITS = 10

Codes: TypeAlias = NDArray[np.int64]


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
            positions: (vertices, 3), finite.
            counting: (vertices,) True for those of which a crossing must have at least one; None if all count.

        Returns:
            (crossings,) edges and (crossings,) the triangles that they pass through, sorted by edge, then triangle.
            Pairs that only touch or share a vertex do not count.
        """
        pairs = self._split(positions, *self._near(positions, positions, counting))
        crossing = np.stack(self._passing(positions, *pairs), axis=1)
        edges, triangles = crossing[np.lexsort(crossing.T[::-1])].T
        counts = slice(None) if counting is None else counting[self._corners(edges, triangles)].any(axis=1)
        return edges[counts], triangles[counts]

    def vertices_at(self, positions: Floats, counting: Bools | None = None) -> Bools:
        """(vertices,) True for the vertices of edges and triangles that cross at (vertices, 3) positions.

        If (vertices,) `counting` are given, only crossings of which at least one vertex is among these are marked.
        """
        edges, triangles = self.at(positions, counting)
        return flags_of(self._corners(edges, triangles), len(positions))

    def pairs_at(self, positions: Floats, counting: Bools | None = None) -> set[tuple[int, int]]:
        """The edges and the triangles that they pass through at (vertices, 3) positions.

        If (vertices,) `counting` are given, only crossings of which at least one vertex is among these.
        """
        edges, triangles = self.at(positions, counting)
        return set(zip(edges.tolist(), triangles.tolist(), strict=True))

    def corners_of(self, pairs: Iterable[tuple[int, int]]) -> Ints:
        """(pairs, 5) vertices of edges, and of the triangles that they pass through; pairs are sorted."""
        return self._corners(*np.array(sorted(pairs), np.intp).reshape(-1, 2).T)

    def _corners(self, edges: Ints, triangles: Ints) -> Ints:
        """(pairs, 5) vertices of (pairs,) edges and (pairs,) triangles."""
        return np.concatenate([self.edges[edges], self.triangles[triangles]], axis=1)

    @property
    def _leaves(self) -> tuple[tuple[Ints, Ints], tuple[Ints, Ints]]:
        """The corners and the order of the leaves, of both trees."""
        return (self.edges, self.edge_order), (self.triangles, self.triangle_order)

    def may_cross(self, one: Floats, other: Floats, counting: Bools | None = None) -> Ints:
        """Find what may cross while each vertex is anywhere on a line between two places of its own.

        Args:
            one: (vertices, 3) the places where the lines begin.
            other: (vertices, 3) the places where they end.
            counting: As `at` takes it.

        Returns:
            (pairs, 5) the two ends of edges, and the three corners of triangles, which are others.
        """
        edges, triangles = self._near(np.minimum(one, other), np.maximum(one, other), counting)
        ends, corners = (np.ascontiguousarray(each.T) for each in (self.edges, self.triangles))
        apart = [
            part.start + _apart(ends.take(edges[part], axis=1), corners.take(triangles[part], axis=1))
            for part in portions(len(edges), 4)
        ]
        meeting = np.concatenate([np.zeros(0, np.intp), *apart])
        for axes in _DIAGONALS:
            edges, triangles = edges.take(meeting), triangles.take(meeting)
            begun, ended = one @ axes.T, other @ axes.T
            cells = _cells(np.minimum(begun, ended), np.maximum(begun, ended))
            of_edges, of_triangles = (_codes(*_boxes(*cells, each, len(each))) for each in (self.edges, self.triangles))
            meeting = _meeting(of_edges, of_triangles, edges, triangles)
        pairs = self._corners(edges.take(meeting), triangles.take(meeting))
        return pairs if counting is None else pairs[any_of(counting, pairs)]

    def _near(self, low: Floats, high: Floats, counting: Bools | None) -> tuple[Ints, Ints]:
        """(pairs,) edges and (pairs,) triangles whose boxes meet, and that may count.

        Vertices are anywhere in boxes between (vertices, 3) `low` and `high`; `counting` is as in `at`.
        """
        depth = max(len(self.triangles), len(self.edges), 1).bit_length()
        cells = _cells(low, high)
        trees = [_tree(*cells, corners[order], depth) for corners, order in self._leaves]
        # A box of a tree counts if something in it does. That of a leaf is not looked at, as most pairs are leaves.
        counts = (
            [_any_tree(any_of(counting, corners[order]), depth) for corners, order in self._leaves]
            if counting is not None
            else []
        )
        top = min(_TOP, depth)
        edges, triangles = np.indices((2**top, 2**top)).reshape(2, -1)
        meeting = _meeting(trees[0][top], trees[1][top], edges, triangles)
        found, stack = [np.zeros((2, 0), np.intp)], [(top, edges.take(meeting), triangles.take(meeting))]
        while stack:
            level, edges, triangles = stack.pop()
            if level == depth:
                found.append(np.stack([self.edge_order.take(edges), self.triangle_order.take(triangles)]))
                continue
            if counts:
                counted = np.flatnonzero(counts[0][level].take(edges) | counts[1][level].take(triangles))
                edges, triangles = edges.take(counted), triangles.take(counted)
            of_edges, of_triangles = (tree[level + 1] for tree in trees)
            for part in portions(len(edges), 4):
                stack.append((level + 1, *_children(of_edges, of_triangles, edges[part], triangles[part])))
        edges, triangles = np.concatenate(found, axis=1)
        return edges, triangles

    def _split(self, positions: Floats, edges: Ints, triangles: Ints) -> tuple[Ints, Ints]:
        """The pairs of (pairs,) edges and (pairs,) triangles with an end of the edge on each side of the triangle."""
        places = positions.T
        ends = [places.take(corners, axis=1) for corners in self.edges.T]
        a, b, c = (places.take(corners, axis=1) for corners in self.triangles.T)
        normals = np.stack(cross(b - a, c - a))
        found = []
        for part in portions(len(edges), 4):
            some, through = edges[part], triangles[part]
            corner, normal = ([row.take(through) for row in rows] for rows in (a, normals))
            one, two = (dot([row.take(some) - at for row, at in zip(end, corner, strict=True)], normal) for end in ends)
            found.append(part.start + np.flatnonzero(((one < 0) & (two > 0)) | ((one > 0) & (two < 0))))
        split = np.concatenate([np.zeros(0, np.intp), *found])
        return edges.take(split), triangles.take(split)

    def _passing(self, positions: Floats, edges: Ints, triangles: Ints) -> tuple[Ints, Ints]:
        """The pairs of (pairs,) edges and (pairs,) triangles, which have no vertex in common, that cross.

        The ends of each edge are on both sides of the triangle.
        """
        ends, corners = self.edges.T.take(edges, axis=1), self.triangles.T.take(triangles, axis=1)
        apart = _apart(ends, corners)
        crosses = apart[_turn_alike(positions.T, ends.take(apart, axis=1), corners.take(apart, axis=1))]
        return edges.take(crosses), triangles.take(crosses)


def _apart(ends: Ints, corners: Ints) -> Ints:
    """The pairs of (2, pairs) ends of edges and (3, pairs) corners of triangles that have no vertex in common."""
    return np.flatnonzero(np.logical_and.reduce([end != corner for end in ends for corner in corners]))


def crossing(places: Floats, ends: Ints, corners: Ints) -> Bools:
    """(pairs,) True where an edge between (pairs, 2) ends passes through a triangle with (pairs, 3) other corners.

    `places` are (3, vertices).
    """
    found = np.zeros(len(ends), bool)
    for part in portions(len(ends), 4):
        start, stop, a, b, c = (places.take(each, axis=1) for each in (*ends[part].T, *corners[part].T))
        normal = cross(b - a, c - a)
        one, two = (dot(end - a, normal) for end in (start, stop))
        split = np.flatnonzero(((one < 0) & (two > 0)) | ((one > 0) & (two < 0)))
        turning = _turn_alike(places, ends[part].T.take(split, axis=1), corners[part].T.take(split, axis=1))
        found[part.start + split[turning]] = True
    return found


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


def _turn_alike(places: Floats, ends: Ints, corners: Ints) -> Bools:
    """(pairs,) True where a line through (2, pairs) ends passes within (3, pairs) corners, at (3, vertices) places."""
    start, stop, a, b, c = (places.take(each, axis=1) for each in (*ends, *corners))
    ray, normal = stop - start, cross(b - a, c - a)
    # Rounding puts the ends of an edge in the triangle's own plane, as on flat skin that is refined, on either side.
    apart = np.abs(dot(ray, normal)) > _ROUNDING * np.abs(places).max(initial=0.0) * np.sqrt(dot(normal, normal))
    a, b, c = a - start, b - start, c - start
    turns = [np.sign(dot(ray, cross(one, other))) for one, other in ((a, b), (b, c), (c, a))]
    # A segment through an edge that two triangles share must cross exactly one of them: rounding decides which.
    return np.asarray(apart & (np.abs(turns[0] + turns[1] + turns[2]) == 3))


def _cells(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """(3, vertices) low and high sides of (vertices, 3) boxes, in cells from 1 to `_CELLS` + 1."""
    origin = low.min(axis=0, initial=np.inf)
    size = float((high - origin).max(initial=0.0)) or 1.0
    lowest = (low - origin).T / size * _CELLS + 1.0
    return lowest, lowest if high is low else (high - origin).T / size * _CELLS + 1.0


def _boxes(lowest: Floats, highest: Floats, corners: Ints, count: int) -> tuple[Ints, Ints]:
    """(3, count) cells of the low and of the high sides of the boxes of (things, n) corners; others meet nothing."""
    below = [lowest.take(each, axis=1) for each in corners.T]
    above = below if highest is lowest else [highest.take(each, axis=1) for each in corners.T]
    least, greatest = reduce(np.minimum, below), reduce(np.maximum, above)
    low, high = np.full((3, count), _CELLS + 2, np.int64), np.zeros((3, count), np.int64)
    low[:, : len(corners)], high[:, : len(corners)] = least, greatest
    # A scale of 0 hides parts in one point, where they cross nothing but their boxes would all meet.
    hidden = np.flatnonzero((least == greatest).all(axis=0))
    low[:, hidden], high[:, hidden] = _CELLS + 2, 0
    return low, high


def _tree(lowest: Floats, highest: Floats, corners: Ints, depth: int) -> list[tuple[Codes, Codes]]:
    """The codes of the boxes, for each level, root first, of a tree over (things, n) corners in `_cells`."""
    levels = [_boxes(lowest, highest, corners, 2**depth)]
    for _ in range(depth):
        low, high = levels[-1]
        levels.append((np.minimum(low[:, ::2], low[:, 1::2]), np.maximum(high[:, ::2], high[:, 1::2])))
    return [_codes(*each) for each in levels[::-1]]


def _codes(low: Ints, high: Ints) -> tuple[Codes, Codes]:
    """(boxes,) codes of (3, boxes) low and high sides; those of high sides have guard bits."""
    return _packed(low), _packed(high) | _GUARDS


def _packed(cells: Ints) -> Codes:
    """(boxes,) codes of (3, boxes) whole coordinates, one bit above each of which is free."""
    code: Codes = cells[0] | cells[1] << (_BITS + 1) | cells[2] << 2 * (_BITS + 1)
    return code


def _children(first: tuple[Codes, Codes], second: tuple[Codes, Codes], some: Ints, others: Ints) -> tuple[Ints, Ints]:
    """The pairs of boxes below `some` and `others` that meet; the codes of both are those of the level below."""
    found, below = [], [(child, *(code.take(child) for code in second)) for child in (2 * others, 2 * others + 1)]
    for one in (2 * some, 2 * some + 1):
        sides = [code.take(one) for code in first]
        for other, *other_sides in below:
            meeting = _meet(*sides, *other_sides)
            found.append((one.take(meeting), other.take(meeting)))
    ones, others = (np.concatenate(each) for each in zip(*found, strict=True))
    return ones, others


def _meet(low: Codes, high: Codes, other_low: Codes, other_high: Codes) -> Ints:
    # A difference takes a guard bit away where a low side lies above the other box's high side.
    guards = other_high - low
    guards &= high - other_low
    guards &= _GUARDS
    return np.flatnonzero(guards == _GUARDS)


def _meeting(first: tuple[Codes, Codes], second: tuple[Codes, Codes], some: Ints, others: Ints) -> Ints:
    """(meeting,) which pairs of `some` boxes of the first and `others` of the second meet."""
    (low, high), (other_low, other_high) = first, second
    return _meet(low.take(some), high.take(some), other_low.take(others), other_high.take(others))


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
    cells = np.minimum((points - low) / size * 2**_MORTON_BITS, 2**_MORTON_BITS - 1).astype(np.int64)
    codes = np.zeros(len(points), np.int64)
    for bit in range(_MORTON_BITS):
        for k in range(3):
            codes |= (cells[:, k] >> bit & 1) << (3 * bit + k)
    return np.argsort(codes, kind="stable")


def zero_lines(values: Floats, faces: Ints) -> tuple[Ints, Floats]:
    """The lines across (triangles, 3) faces on which (vertices,) values pass 0.

    Returns:
        (ends,) triangles and (ends, 3) barycentric coordinates, two ends for each line.
    """
    corners = values[faces]
    above = corners > 0
    triangles, sides = np.nonzero(above != np.roll(above, -1, axis=1))
    here, there = corners[triangles, sides], corners[triangles, (sides + 1) % 3]
    crossing = np.zeros((len(triangles), 3))
    crossing[np.arange(len(triangles)), sides] = there / (there - here)
    crossing[np.arange(len(triangles)), (sides + 1) % 3] = here / (here - there)
    return triangles, crossing
