"""Finds the edges of a moving surface that pass through its triangles.

Candidates come from a tree of bounding boxes, which is built once at rest and refitted to each pose. The sides of boxes
are rounded to whole cells, so that three of them are compared as one integer.

Source: C. Ericson, *Real-Time Collision Detection*, 2005, §6.3 (descent of two hierarchies) and §5.3.4 (segments and
triangles by signed volumes). Differs: all pairs of a level of the trees are compared at once. J. T. Klosowski and
others, *Efficient Collision Detection Using Bounding Volume Hierarchies of k-DOPs*, TVCG 4, 1998, on the directions
beside the axes. Differs: they are only compared where boxes meet.
"""

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, VertexFaces, any_of, cross, distinct, dot, flags_of, runs
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

Cells: TypeAlias = NDArray[np.int32]
Codes: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Crossings:
    """The tree of a surface's triangles, and its edges.

    An edge belongs to the first triangle that has it, and is looked at where that one's box meets another's.

    Attributes:
        triangles: (triangles, 3) vertices.
        edges: (edges, 2) vertices as `edges_of` sorts them.
        leaves: (triangles,) those of the tree, along a Morton curve.
        owned: (3, triangles) the edges of each leaf; -1 for those of others.
        fans: (2, pairs) edges, and leaves round the third vertex of those which they belong to: such pairs have no
            vertex in common, but always near boxes.
    """

    triangles: Ints
    edges: Ints
    leaves: Ints
    owned: Ints
    fans: Ints

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Crossings":
        """Build the tree of (triangles, 3) from (vertices, 3) positions at rest."""
        leaves = _morton_order(positions[triangles].mean(axis=1))
        corners = triangles[leaves]
        sides, around = sides_of(corners), VertexFaces.of(corners, len(positions))
        first = distinct(sides)[0]
        edges, owned = sides[first], np.full(triangles.T.shape, -1)
        owned[first % 3, first // 3] = np.arange(len(edges))
        third = np.roll(corners, 1, axis=1).reshape(-1)[first]
        many = around.starts[third + 1] - around.starts[third]
        fans = np.stack([np.repeat(np.arange(len(edges)), many), around.faces[runs(around.starts[third], many)]])
        fans = fans[:, _apart(edges.T.take(fans[0], axis=1), corners.T.take(fans[1], axis=1))]
        return cls(triangles, edges, leaves, owned, fans)

    def at(self, positions: Floats, counting: Bools | None = None) -> tuple[Ints, Ints]:
        """Find what crosses in a pose.

        Args:
            positions: (vertices, 3), finite.
            counting: (vertices,) True for those of which a crossing must have at least one; None if all count.

        Returns:
            (crossings,) edges and (crossings,) the triangles that they pass through, sorted by edge, then triangle.
            Pairs that only touch or share a vertex do not count.
        """
        edges, triangles = self._near(_Boxes.of(positions, positions, counting))
        corners = self._corners(edges, triangles)
        crosses = crossing(np.ascontiguousarray(positions.T), corners[:, :2], corners[:, 2:])
        if counting is not None:
            crosses &= any_of(counting, corners)
        edges, triangles = edges[crosses], triangles[crosses]
        order = np.lexsort((triangles, edges))
        return edges[order], triangles[order]

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

    def may_cross(self, one: Floats, other: Floats, counting: Bools | None = None) -> Ints:
        """Find what may cross while each vertex is anywhere on a line between two places of its own.

        Args:
            one: (vertices, 3) the places where the lines begin.
            other: (vertices, 3) the places where they end.
            counting: As `at` takes it.

        Returns:
            (pairs, 5) the two ends of edges, and the three corners of triangles, which are others.
        """
        turned = [_Boxes.of(one @ axes.T, other @ axes.T) for axes in _DIAGONALS]
        pairs = self._corners(*self._near(_Boxes.of(one, other, counting), *turned))
        return pairs if counting is None else pairs[any_of(counting, pairs)]

    def _near(self, *boxes: "_Boxes") -> tuple[Ints, Ints]:
        """(pairs,) edges and (pairs,) triangles that have no common vertex, and whose boxes meet along all axes."""
        corners, depth = self.triangles[self.leaves], max(len(self.triangles), 1).bit_length()
        tree = _tree(boxes[0].around(corners, 2**depth), depth)
        of_leaves = [tree[depth][0], *(_codes(each.around(corners, len(corners))) for each in boxes[1:])]
        some, others = _near_leaves(tree, corners)
        for codes in of_leaves[1:]:
            meeting = _meeting(codes, codes, some, others)
            some, others = some.take(meeting), others.take(meeting)
        edges = self.owned.take(np.concatenate([some, others]), axis=1)
        leaves = np.concatenate([np.tile(np.concatenate([others, some]), 3)[edges.ravel() >= 0], self.fans[1]])
        edges = np.concatenate([edges[edges >= 0], self.fans[0]])
        for each, codes in zip(boxes, of_leaves, strict=True):
            meeting = _meeting(_codes(each.around(self.edges, len(self.edges))), codes, edges, leaves)
            edges, leaves = edges.take(meeting), leaves.take(meeting)
        return edges, self.leaves.take(leaves)


def _apart(some: Ints, others: Ints) -> Ints:
    """The pairs of (n, pairs) and (m, pairs) corners that have no vertex in common."""
    return np.flatnonzero(np.logical_and.reduce([one != other for one in some for other in others]))


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


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """The boxes round two places of each vertex.

    Attributes:
        places: The two (vertices, 3) places.
        cells: (vertices, 8) the low sides, in whole cells from 1 to `_CELLS` + 1, -1 for those that count, minus the
            high sides, and a 0. So the least of some rows are a box round some vertices.
    """

    places: tuple[Floats, Floats]
    cells: Cells

    @classmethod
    def of(cls, one: Floats, other: Floats, counting: Bools | None = None) -> "_Boxes":
        """The boxes round two (vertices, 3) places; all count if no (vertices,) are given that do."""
        low, high = (one, one) if other is one else (np.minimum(one, other), np.maximum(one, other))
        origin = low.min(axis=0, initial=np.inf)
        size = float((high - origin).max(initial=0.0)) or 1.0
        cells = np.zeros((len(one), 8), np.int32)
        cells[:, :3] = (low - origin) / size * _CELLS + 1.0
        cells[:, 3] = -1 if counting is None else -counting.astype(np.int32)
        cells[:, 4:7] = -cells[:, :3] if high is low else -((high - origin) / size * _CELLS + 1.0)
        return cls((one, other), cells)

    def around(self, corners: Ints, count: int) -> Cells:
        """(count, 8) cells of the boxes round (things, n) corners; others meet nothing."""
        found = np.zeros((count, 8), np.int32)
        found[len(corners) :, :3] = _CELLS + 2
        found[: len(corners)] = reduce(np.minimum, (self.cells.take(each, axis=0) for each in corners.T))
        # A scale of 0 hides parts in one point, where they cross nothing but their boxes would all meet.
        small = np.flatnonzero(np.logical_and.reduce([found[:, k] == -found[:, k + 4] for k in range(3)]))
        every = [each[corners[small]] for each in self.places]
        hidden = np.logical_and.reduce([(each == every[0][:, :1]).all(axis=(1, 2)) for each in every])
        found[small[hidden], :3] = _CELLS + 2
        return found


def _tree(cells: Cells, depth: int) -> list[tuple[Codes, Bools]]:
    """The codes of the boxes of a tree over leaves with (leaves, 8) cells, and whether they count; root first."""
    levels = [cells]
    for _ in range(depth):
        levels.append(np.minimum(levels[-1][::2], levels[-1][1::2]))
    return [(_codes(each), each[:, 3] < 0) for each in levels[::-1]]


def _codes(cells: Cells) -> Codes:
    """(boxes, 2) codes of low and of high sides, one bit above each coordinate; that of high ones is set."""
    low, high = (
        reduce(np.add, (cells[:, first + k].astype(np.int64) << k * (_BITS + 1) for k in range(3))) for first in (0, 4)
    )
    return np.stack([low, _GUARDS - high], axis=1)


def _near_leaves(tree: Sequence[tuple[Codes, Bools]], corners: Ints) -> tuple[Ints, Ints]:
    """The pairs of leaves with (leaves, 3) corners that have no vertex in common, and whose boxes meet.

    One of a pair counts, or of the pair of boxes above it: leaves are not asked, as most pairs are leaves.
    """
    depth, rows = len(tree) - 1, np.ascontiguousarray(corners.T)
    top = min(_TOP, depth)
    some, others = np.triu_indices(2**top)
    meeting = _meeting(tree[top][0], tree[top][0], some, others)
    found, stack = [np.zeros((2, 0), np.intp)], [(top, some.take(meeting), others.take(meeting))]
    while stack:
        level, some, others = stack.pop()
        if level == depth:
            apart = _apart(rows.take(some, axis=1), rows.take(others, axis=1))
            found.append(np.stack([some.take(apart), others.take(apart)]))
            continue
        counted = np.flatnonzero(tree[level][1].take(some) | tree[level][1].take(others))
        some, others = some.take(counted), others.take(counted)
        for part in portions(len(some), 4):
            stack.append((level + 1, *_children(tree[level + 1][0], some[part], others[part])))
    some, others = np.concatenate(found, axis=1)
    return some, others


def _children(codes: Codes, some: Ints, others: Ints) -> tuple[Ints, Ints]:
    """The pairs of boxes below `some` and `others` that meet, each once; the codes are those of the level below."""
    # Those of both boxes below one stand together.
    sides, other_sides = (codes.reshape(-1, 4).take(each, axis=0).reshape(-1, 2, 2) for each in (some, others))
    found = []
    for one in range(2):
        for other in range(2):
            meeting = _meet(sides[:, one], other_sides[:, other])
            found.append((2 * some.take(meeting) + one, 2 * others.take(meeting) + other))
    ones, others = (np.concatenate(each) for each in zip(*found, strict=True))
    once = np.flatnonzero(ones <= others)
    return ones.take(once), others.take(once)


def _meet(codes: Codes, others: Codes) -> Ints:
    # A difference takes a guard bit away where a low side lies above the other box's high side.
    guards = others[:, 1] - codes[:, 0]
    guards &= codes[:, 1] - others[:, 0]
    guards &= _GUARDS
    return np.flatnonzero(guards == _GUARDS)


def _meeting(first: Codes, second: Codes, some: Ints, others: Ints) -> Ints:
    """(meeting,) which pairs of `some` boxes of the first and `others` of the second meet."""
    found = [np.zeros(0, np.intp)]
    for part in portions(len(some), 4):
        found.append(part.start + _meet(first.take(some[part], axis=0), second.take(others[part], axis=0)))
    return np.concatenate(found)


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
