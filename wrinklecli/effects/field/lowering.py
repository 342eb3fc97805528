"""Lowers a field in the places where some pose shows it at fault.

Two things are at fault: a triangle that the field turns over and the skin alone does not, and, with `contact: resolve`,
an edge that passes through a triangle, in a pose in which the skin alone has fewer of these. A field's heights are
ours, and level it is the skin, so this always has an answer.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.effects.faults import turned_over
from wrinklecli.effects.field.attach import UNSEEN, AttachedField
from wrinklecli.effects.field.factors import weights_of
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    any_of,
    cross,
    distinct_values,
    dot,
    flags_of,
    runs,
)
from wrinklecli.numeric.intersections import Crossings, crossing, edges_of
from wrinklecli.surface.refine import Refinement

# Most poses in which the surface is looked at.
_POSES = 64
# Moments of a clip that are among them, evenly spread, at most; and decimal digits of weights by which poses differ.
_MOMENTS, _DIGITS = 25, 3
# Halvings of what is at fault for the first time. Each further time takes as many as all before and a first one more,
# so that even shapes that hardly act become level. Most faults are gone after a little, which leaves a fold to be seen.
_FIRST = 0.25


def lowering(
    attached: AttachedField,
    shown: tuple[Rig, Sequence[Clip]],
    fine: Refinement,
    vertices: Ints,
    moves: Floats,
) -> Floats:
    """(shapes, vertices) factors of (shapes, vertices, 3) moves by which hardly anything is at fault in some poses.

    The shape that moves a place most in a pose that shows a fault is lowered first: folds that a deep crease hides stay
    as they are in a bend that shows them, which has shapes of its own.

    Args:
        attached: The field.
        shown: A rig and its clips, in which the surface is looked at, too.
        fine: The refined surface.
        vertices: (vertices,) sorted fine vertices that the field moves.
        moves: (shapes, vertices, 3) displacements at weight 1, bind space.
    """
    poses = _Poses.of(attached, shown, fine, vertices, moves)
    # Folds that end within less than a wavelength look torn.
    slopes = _Slopes.of(fine, vertices, attached.wavelength)
    looks: list[_Look] = [*_turning(poses, slopes)]
    if attached.tool.contact is not None:
        looks += _crossing(poses)
    lengths = np.zeros((len(moves), len(vertices) + 1))
    lengths[:, :-1] = slopes.around(np.sqrt(np.sum(moves**2, axis=2)).T).T
    left, looked, halvings = np.ones((len(moves), len(vertices) + 1)), looks, np.zeros((len(vertices), len(moves)))
    lowered = poses.moves.copy()
    # What is lowered again and again becomes level, so this ends.
    while True:
        marked, looked = _marked(looked, lowered, left * lengths, slopes)
        if not marked.any():
            # What was lowered for one pose may be at fault in another.
            marked, looked = _marked(looks, lowered, left * lengths, slopes)
        if not marked.any():
            break
        # Level, with all triangles that give its corners their normals, it is at fault as the skin is.
        faults = slopes.around(marked[:, :-1].T)
        halvings = np.where(faults > 0, 2.0 * halvings + _FIRST * faults, halvings)
        limits = np.exp2(-halvings)
        before = left.copy()
        left[:, :-1] = slopes.below(left[:, :-1].T, np.where(limits > UNSEEN, limits, 0.0)).T
        changed = left != before
        own = np.flatnonzero(changed.any(axis=0))
        lowered[:, :, own] = poses.moves[:, :, own] * left[:, None, own]
        for each in looks:
            each.follow(changed)
    return left[:, :-1]


@dataclass(frozen=True, slots=True, eq=False)
class _Slopes:
    """How fast factors of a field may rise beside lower ones, along the edges of a surface.

    Attributes:
        vertices: (vertices,) sorted fine vertices.
        firsts: (vertices,) where the neighbours of each begin, itself among them,
        counts: (vertices,) and how many they are.
        others: (neighbours,) indices among the vertices.
        rises: (neighbours,) most by which a factor is greater than that of the neighbour.
    """

    vertices: Ints
    firsts: Ints
    counts: Ints
    others: Ints
    rises: Floats

    @classmethod
    def of(cls, fine: Refinement, vertices: Ints, length: float) -> "_Slopes":
        """Let factors of (vertices,) sorted fine vertices rise from 0 to 1 over a length."""
        inside = flags_of(vertices, len(fine.positions))
        edges = np.searchsorted(vertices, edges_of(fine.triangles[inside[fine.triangles].all(axis=1)]))
        itself = np.arange(len(vertices))
        one, other = np.concatenate([edges, edges[:, ::-1], np.stack([itself, itself], axis=1)]).T
        order = np.argsort(one, kind="stable")
        places = fine.rest_positions[vertices]
        rises = np.linalg.norm(places[one] - places[other], axis=1)[order] / length
        counts = np.bincount(one, minlength=len(vertices))
        return cls(vertices, np.cumsum(counts) - counts, counts, other[order], rises)

    def around(self, values: Floats) -> Floats:
        """(vertices, …) the greatest of the (vertices, …) values of each vertex and its neighbours."""
        found = np.zeros(values.shape)
        near, own, firsts = self._beside(np.flatnonzero(values.reshape(len(values), -1).any(axis=1)))
        if len(near):
            found[near] = np.maximum.reduceat(values[self.others[own]], firsts, axis=0)
        return found

    def around_some(self, values: Floats, chosen: Ints) -> Floats:
        """(shapes, chosen) the greatest of (shapes, numbers) values of some vertices and their neighbours."""
        counts = self.counts[chosen]
        own = self.others[runs(self.firsts[chosen], counts)]
        return np.asarray(np.maximum.reduceat(values[:, own], np.cumsum(counts) - counts, axis=1))

    def _beside(self, changed: Ints) -> tuple[Ints, Ints, Ints]:
        """(near,) sorted neighbours of vertices, the places of their own neighbours, and where each one's begin."""
        near = distinct_values(self.others[runs(self.firsts[changed], self.counts[changed])])
        counts = self.counts[near]
        return near, runs(self.firsts[near], counts), np.cumsum(counts) - counts

    def below(self, factors: Floats, limits: Floats) -> Floats:
        """(vertices, shapes) the greatest factors below others and below limits that rise no faster."""
        found = np.minimum(factors, limits)
        changed = np.flatnonzero((found < factors).any(axis=1))
        while len(changed):
            near, own, firsts = self._beside(changed)
            lower = np.minimum.reduceat(found[self.others[own]] + self.rises[own, None], firsts, axis=0)
            changed = near[(lower < found[near]).any(axis=1)]
            found[near] = lower
        return found

    def reached(self, faults: Bools) -> Bools:
        """(fine vertices,) True for vertices that are lowered where (fine vertices,) are at fault, and for these."""
        marked = self.around(faults[self.vertices].astype(float))[:, None]
        found = faults.copy()
        found[self.vertices] |= self.below(np.ones(marked.shape), 1.0 - marked)[:, 0] < 1.0
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _Poses:
    """The poses in which a surface is looked at.

    Attributes:
        fine: The refined surface.
        influences: (fine vertices, joints) sparse skin weights.
        inside: (fine vertices,) numbers of those that the field moves; that of all others is the last.
        moves: (shapes, 3, numbers) what its shapes do with them, bind space; the last is 0.
        moving: (shapes, numbers) True where that is not 0.
        matrices: (poses, joints, 4, 4).
        weights: (poses, shapes).
    """

    fine: Refinement
    influences: Any
    inside: Ints
    moves: Floats
    moving: Bools
    matrices: Floats
    weights: Floats

    @classmethod
    def of(
        cls,
        attached: AttachedField,
        shown: tuple[Rig, Sequence[Clip]],
        fine: Refinement,
        vertices: Ints,
        moves: Floats,
    ) -> "_Poses":
        """The poses of clips with the greatest weights, then those of sweeps.

        Clips are what is seen. They show how far joints turn, and together: between the poses of a sweep a crease may
        turn a triangle.
        """
        sweeps, factors = attached.sweeps, attached.factors
        matrices, weights = [sweeps.matrices], [weights_of(sweeps, factors.turns, factors.tables)]
        drive = replace(attached.drive, strengths={}, strength=1.0)
        rig, clips = shown
        for clip in clips:
            times = np.linspace(clip.start, clip.end, _MOMENTS)
            matrices.append(joint_matrices(rig, clip, times))
            weights.append(drive.weights_in(rig, clip)(times))
        every = np.concatenate(weights)
        # A clip that goes to and fro has each pose twice.
        own = np.sort(np.unique(np.round(every, _DIGITS), axis=0, return_index=True)[1])
        of_sweeps = own < len(sweeps.matrices)
        chosen = own[np.lexsort((-(every[own] ** 2).sum(axis=1), of_sweeps))][:_POSES]
        inside = np.full(len(fine.positions), len(vertices))
        inside[vertices] = np.arange(len(vertices))
        padded = np.zeros((len(moves), 3, len(vertices) + 1))
        padded[:, :, :-1] = moves.transpose(0, 2, 1)
        influences = fine.influences(sweeps.matrices.shape[1], np.arange(len(fine.positions))).sparse()
        moving = (padded != 0).any(axis=1)
        return cls(fine, influences, inside, padded, moving, np.concatenate(matrices)[chosen], every[chosen])

    def of_part(self, vertices: Ints) -> "Iterator[_Pose]":
        """Some sorted fine vertices in each of the poses."""
        influences, bind, inside = (
            self.influences[vertices],
            self.fine.bind_positions[vertices].T,
            self.inside[vertices],
        )
        for matrices, weights in zip(self.matrices, self.weights, strict=True):
            rows = np.ascontiguousarray(matrices[:, :3]).reshape(-1, 12)
            blended = np.ascontiguousarray((influences @ rows).T).reshape(3, 4, -1)
            still = np.einsum("abv,bv->av", blended[:, :3], bind) + blended[:, 3]
            yield _Pose(still, blended[:, :3], self.moves, self.moving, inside, weights)


@dataclass(frozen=True, slots=True, eq=False)
class _Pose:
    """A part of the surface in a pose.

    Attributes:
        still: (3, vertices) places in the skin.
        turns: (3, 3, vertices) from bind to world space.
        moves: (shapes, 3, numbers) what shapes do, bind space,
        moving: (shapes, numbers) where they do anything, and
        inside: (vertices,) the number of each vertex there.
        weights: (shapes,).
    """

    still: Floats
    turns: Floats
    moves: Floats
    moving: Bools
    inside: Ints
    weights: Floats

    def of(self, own: Ints) -> "_Pose":
        """Some of its vertices."""
        return replace(self, still=self.still[:, own], turns=self.turns[:, :, own], inside=self.inside[own])

    def places(self, moved: Floats) -> Floats:
        """(3, vertices) places with the field, which moves its (3, numbers), bind space."""
        return np.asarray(self.still + np.einsum("abv,bv->av", self.turns, moved.take(self.inside, axis=1)))

    @property
    def moved(self) -> Bools:
        """(vertices,) True for those that the field moves."""
        return np.asarray(self.moving[self.weights != 0].any(axis=0)[self.inside])

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """(3, vertices) lowest and highest coordinates, however much the field is lowered."""
        low, high = self.still.copy(), self.still.copy()
        for shape in np.flatnonzero(self.weights).tolist():
            # Most poses turn few joints, and most shapes are elsewhere.
            if self.moving[shape].take(self.inside).any():
                moves = self.weights[shape] * self.moves[shape].take(self.inside, axis=1)
                way = np.einsum("abv,bv->av", self.turns, moves)
                low += np.minimum(way, 0.0)
                high += np.maximum(way, 0.0)
        return low, high


class _Look(ABC):
    """A look at a pose, which remembers what it saw: most of the time a field is lowered elsewhere.

    Args:
        pose: The part of the surface.
    """

    def __init__(self, pose: _Pose) -> None:
        self.pose, self.faults = pose, np.zeros(0, np.intp)
        self._changed = np.ones(len(pose.inside), np.bool_)

    def follow(self, changed: Bools) -> None:
        """Look again where (shapes, numbers) factors have changed."""
        self._changed |= changed[self.pose.weights != 0].any(axis=0)[self.pose.inside]

    @property
    def is_old(self) -> bool:
        """True if its faults are those of another field."""
        return bool(self._changed.any())

    def look(self, moved: Floats) -> None:
        """Find the numbers at which the surface is at fault, with a field that moves its (3, numbers), bind space."""
        faults = self.pose.inside[self._look(self.pose.places(moved), self._changed)]
        # What the field does not move is not lowered.
        self.faults = faults[faults < moved.shape[1] - 1]
        self._changed[:] = False

    @abstractmethod
    def _look(self, places: Floats, changed: Bools) -> Ints:
        """The vertices at fault at (3, vertices) places, of which (vertices,) `changed` since the last look."""


def _marked(looks: Sequence[_Look], lowered: Floats, sizes: Floats, slopes: _Slopes) -> tuple[Floats, list[_Look]]:
    """Look at (shapes, 3, numbers) what a lowered field's shapes do, at weight 1 by (shapes, numbers) sizes.

    Returns:
        (shapes, numbers) 1 for the shapes that do most at a fault; and the looks that have any.
    """
    old, lot = [each for each in looks if each.is_old], len(lowered)
    # One product for as many poses as shapes takes a tenth of the time that one for each takes.
    for some in (old[k : k + lot] for k in range(0, len(old), lot)):
        moved = np.stack([each.pose.weights for each in some]) @ lowered.reshape(lot, -1)
        for each, own in zip(some, moved, strict=True):
            each.look(own.reshape(3, -1))
    marked, found = np.zeros(sizes.shape), [each for each in looks if len(each.faults)]
    for each in found:
        faults, weights = each.faults, each.pose.weights[:, None]
        acting = weights * sizes[:, faults]
        level = ~acting.any(axis=0)
        if level.any():
            # What is level may be at fault by what is beside it.
            acting[:, level] = weights * slopes.around_some(sizes, faults[level])
        marked[:, faults] = np.maximum(marked[:, faults], (acting == acting.max(axis=0)) & (acting > 0))
    return marked, found


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A part of a surface, with the triangles around it.

    Attributes:
        vertices: (vertices,) sorted, of the surface.
        triangles: (triangles, 3) indices among them.
        judged: (triangles,) True for those that have all of the triangles around them.
    """

    vertices: Ints
    triangles: Ints
    judged: Bools

    @classmethod
    def of(cls, inside: Bools, triangles: Ints) -> "_Part":
        """The triangles with a corner among the (vertices,) that are inside, and those around these."""
        judged = any_of(inside, triangles)
        around = any_of(flags_of(triangles[judged], len(inside)), triangles)
        vertices = distinct_values(triangles[around])
        return cls(vertices, np.searchsorted(vertices, triangles[around]), judged[around])


def _numbered(triangles: Ints, count: int) -> tuple[Ints, Ints]:
    """(used,) sorted vertices of (n, k) triangles or pairs, of so many, and the (n, k) numbers among these."""
    used = flags_of(triangles, count)
    return np.flatnonzero(used), (np.cumsum(used) - 1)[triangles]


class _Turning(_Look):
    """A look at triangles that may turn over, by the normals of their corners.

    Args:
        pose: Of the vertices of the part.
        part: Triangles that the skin turns over itself do not count.
    """

    def __init__(self, pose: _Pose, part: _Part) -> None:
        super().__init__(pose)
        self._triangles, self._skinned = part.triangles, np.array(_faces(pose.still, part.triangles))
        self._turned, self._normals = np.zeros(len(part.triangles), np.bool_), np.zeros(pose.still.shape)
        self._turn(pose.still, self._changed)
        self._judged = part.judged & ~self._turned
        self._changed = pose.moved

    def _look(self, places: Floats, changed: Bools) -> Ints:
        self._turn(places, changed)
        return distinct_values(self._triangles[self._judged & self._turned])

    def _turn(self, places: Floats, changed: Bools) -> None:
        """Turn the triangles whose corners' normals have changed."""
        fresh = np.flatnonzero(any_of(changed, self._triangles))
        around = flags_of(self._triangles.take(fresh, axis=0), len(changed))
        beside = np.flatnonzero(any_of(around, self._triangles))
        triangles = self._triangles.take(beside, axis=0)
        faces = _faces(places, triangles)
        for known, found in zip(self._normals, _sums(faces, triangles, len(changed)), strict=True):
            np.copyto(known, found, where=around)
        away = dot(faces, self._skinned.take(beside, axis=1)) < 0.0
        self._turned[beside] = away | turned_over(triangles, faces, self._normals)


def _turning(poses: _Poses, slopes: _Slopes) -> Iterator[_Turning]:
    """The looks at triangles: only near those that the whole field turns over in a pose."""
    fine, raised = poses.fine, np.tensordot(poses.weights, poses.moves, axes=1)
    # Triangles beside the field have corners in it.
    whole = _Part.of(poses.inside < poses.moves.shape[2] - 1, fine.triangles)
    faults = np.zeros(len(fine.positions), np.bool_)
    for each, moved in zip(poses.of_part(whole.vertices), raised, strict=True):
        near = _Part.of(each.moved, whole.triangles)
        own = each.of(near.vertices)
        faces, skinned = (_faces(places, near.triangles) for places in (own.places(moved), own.still))
        normals = _sums(faces, near.triangles, len(near.vertices))
        turned = (dot(faces, skinned) < 0.0) | turned_over(near.triangles, faces, normals)
        faults[whole.vertices[near.vertices[near.triangles[near.judged & turned]]]] = True
    if not faults.any():
        return
    part = _Part.of(slopes.reached(faults), fine.triangles)
    for each in poses.of_part(part.vertices):
        yield _Turning(each, part)


def _faces(places: Floats, triangles: Ints) -> list[Floats]:
    """Three (triangles,) coordinates of the triangles' normals at (3, vertices) places."""
    a, b, c = (places.take(corner, axis=1) for corner in triangles.T)
    return cross(b - a, c - a)


def _sums(faces: list[Floats], triangles: Ints, count: int) -> Floats:
    """(3, vertices) sums of three (triangles,) coordinates of normals around each of so many vertices."""
    at = triangles.ravel()
    return np.array([np.bincount(at, np.repeat(each, 3), count) for each in faces])


class _Crossing(_Look):
    """A look at a surface that may pass through itself: at fault if more crosses with the field than without.

    Where the skin passes through itself, the field shifts what crosses, and need not be lowered as long as it gives way
    elsewhere: so what is beside a crossing of the skin is at fault only if nothing else is.

    Args:
        pose: Of the corners of the pairs.
        pairs: (pairs, 5) indices of the two ends of edges, and of the three corners of triangles.
    """

    def __init__(self, pose: _Pose, pairs: Ints) -> None:
        super().__init__(pose)
        self._pairs, self._crossing = pairs, np.zeros(len(pairs), np.bool_)
        self._skinned = crossing(pose.still, pairs[:, :2], pairs[:, 2:])
        self._apart = ~any_of(flags_of(pairs[self._skinned], len(pose.inside)), pairs)

    def _look(self, places: Floats, changed: Bools) -> Ints:
        beside = np.flatnonzero(any_of(changed, self._pairs))
        pairs = self._pairs[beside]
        self._crossing[beside] = crossing(places, pairs[:, :2], pairs[:, 2:])
        if self._crossing.sum() <= self._skinned.sum():
            return np.zeros(0, np.intp)
        found = self._crossing & self._apart
        return distinct_values(self._pairs[found if found.any() else self._crossing & ~self._skinned])


def _crossing(poses: _Poses) -> Iterator[_Crossing]:
    """The looks at crossings: only at what may cross between the skin and the whole field, and that the field moves."""
    fine, every = poses.fine, np.arange(len(poses.fine.positions))
    surface = Crossings.of(
        fine.rest_positions, fine.triangles[(fine.triangles != np.roll(fine.triangles, 1, axis=1)).all(axis=1)]
    )
    for each in poses.of_part(every):
        low, high = (np.ascontiguousarray(end.T) for end in each.bounds)
        vertices, corners = _numbered(surface.may_cross(low, high, each.moved), len(every))
        yield _Crossing(each.of(vertices), corners.astype(np.int32))
