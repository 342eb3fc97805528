"""Systems: folds that share vertices, or that touch in a clip, are solved together in each pose of it.

Both hips press one pelvis, and two knees may meet: solved alone, each fold would have the skinned surface of the other
in its way, and their moves would add up. So the poses of a clip are solved once, for the union of their surfaces. Then
the move of each vertex is divided among the folds, by weights that fade away from where each of them crosses, and each
fold fits its own shapes to its part. Shapes, targets and look-ups are those of one joint, as in a fold that stands
alone: a set of targets for the whole system would have to follow several joints at once. Not in the paper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.crease import Crease, MarchedClip, march_clip
from wrinklecli.effects.contact.fitting import combined
from wrinklecli.effects.contact.fold import REACH_RADII, Fold, Look, Poses, grown
from wrinklecli.effects.contact.solution import Solution
from wrinklecli.effects.contact.tissue import FREE, SOFT, UNITS, Tissue
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, distinct_values, flags_of
from wrinklecli.numeric.closest import meets_box

# Poses of a sweep that are checked for crossings before it is solved, from rest to its end.
_CROSSING_POSES = 8
# Moments of a clip at which folds are checked for touching each other, at most.
_MOMENTS = 8
# Times that what its vertices cross in clips is added to a fold, at most: each lets others move, which may cross too.
_GROWTHS = 3
# Moments of a clip among which the turn of a joint is looked for that is furthest.
_LOOKS = 65


@dataclass(frozen=True)
class System:
    """Folds that are solved together.

    Attributes:
        folds: The folds; all count as equally thick.
        clips: The clips and the (frames,) seconds at which these are solved, by their numbers.
        kept: Those that are solved, by their numbers, as many as memory allows.
    """

    folds: tuple[Fold, ...]
    clips: Mapping[int, tuple[Clip, Floats]]
    kept: dict[int, MarchedClip] = field(default_factory=dict)

    @cached_property
    def fold(self) -> Fold:
        """The union of the folds' surfaces."""
        return union(self.folds) if len(self.folds) > 1 else self.folds[0]

    @property
    def shared(self) -> list[object]:
        """The objects that the solutions of clips and of sweeps refer to."""
        parts = (part for each in (*self.folds, self.fold) for part in (each, each.tissue))
        return [*parts, *(clip for clip, _ in self.clips.values())]

    @cached_property
    def _rows(self) -> list[Ints]:
        """For each fold the indices of its free vertices among the system's."""
        vertices = self.fold.free_vertices
        return [np.searchsorted(vertices, each.free_vertices) for each in self.folds]

    @cached_property
    def _weights(self) -> Floats:
        """(folds, free) parts of the move of each free vertex that belong to each fold."""
        weights = np.zeros((len(self.folds), len(self.fold.free_vertices)))
        for weight, rows, fold in zip(weights, self._rows, self.folds, strict=True):
            apart = fold.apart[fold.tissue.free_rows]
            weight[rows] = np.maximum(1.0 - apart / (FREE * SOFT), TINY) ** 2
        return np.asarray(weights / np.maximum(weights.sum(axis=0), TINY))

    @cached_property
    def _tissues(self) -> list[Tissue]:
        """For each fold the system's surface, of which only the fold's vertices may move."""
        whole = self.fold.tissue
        return [replace(whole, free=flags_of(whole.free_rows[rows], len(whole.free))) for rows in self._rows]

    def part(self, number: int, fitted: Sequence[tuple[Crease, Floats]]) -> MarchedClip:
        """The part of one fold in a clip, solved.

        `fitted` are the folds before it with (frames, shapes) weights that they have, whose errors it takes over.
        """
        solved = self.kept.get(number) or march_clip(self.fold, *self.clips[number])
        if len(self.folds) == 1:
            return solved
        fits = {frame: [(each, weights[frame]) for each, weights in fitted] for frame in solved.solutions}
        parts = {frame: self._part(found, fits[frame]) for frame, found in solved.solutions.items()}
        return replace(solved, solutions=parts)

    def _part(self, found: Solution, fitted: Sequence[tuple[Crease, Floats]]) -> Solution:
        """The part of one fold in a solution, beside the moves of all others."""
        number = len(fitted)
        others = np.sum(self._weights[number + 1 :], axis=0)[:, None] * found.moved
        for (crease, weights), there in zip(fitted, self._rows, strict=False):
            others[there] += combined(weights, crease.shapes)
        rows = self._rows[number]
        return replace(
            found,
            tissue=self._tissues[number],
            moved=found.moved[rows] - others[rows],
            error_weights=found.error_weights[rows],
            outward=found.outward[rows],
            positions=found.positions_under(others),
            matrices=found.matrices[rows],
        )


def union(folds: Sequence[Fold]) -> Fold:
    """One fold with the surface of several on the same mesh; its hinge is that of the first."""
    vertices = np.unique(np.concatenate([each.vertices for each in folds]))
    own, crossed = np.zeros((2, len(vertices)), bool)
    triangles, others, count = [], [], len(vertices)
    for each in folds:
        rows = np.searchsorted(vertices, each.vertices)
        own[rows] |= each.own[: len(rows)]
        crossed[rows] |= each.crossed[: len(rows)]
        of_mesh = each.triangles[:, 0] < len(rows)
        triangles.append(rows[each.triangles[of_mesh]])
        others.append(each.triangles[~of_mesh] - len(rows) + count)
        count += len(each.own) - len(rows)
    return replace(
        folds[0],
        patches=tuple(patch for each in folds for patch in each.patches),
        vertices=vertices,
        triangles=np.concatenate([np.unique(np.concatenate(triangles), axis=0), *others]),
        own=np.concatenate([own, np.zeros(count - len(vertices), bool)]),
        crossed=np.concatenate([crossed, *(each.crossed[len(each.vertices) :] for each in folds)]),
        radius=float(np.mean([each.radius for each in folds])),
        pivot=np.mean([each.pivot for each in folds], axis=0),
        others=tuple(other for each in folds for other in each.others),
        parts=tuple(folds),
    )


def with_crossings(fold: Fold, clips: Sequence[Clip]) -> Fold:
    """A fold with what crosses in its own motion, and all of its mesh that crosses what it moves in clips.

    A shin may meet the other one far below the knee, where the fold of either knee ends: what it may move would cross
    what it does not see. And knees may meet beside what either crosses in its own motion.
    """
    sweeps = [(clip, np.linspace(0.0, 1.0, _CROSSING_POSES)[1:]) for clip, _ in fold.hinge.sweeps]
    looks = [(clip, _moments(fold, clip)) for clip in clips]
    fold = replace(fold, crossed=_crossing_in(fold, sweeps, fold.own))
    count = len(fold.vertices)
    alone = replace(fold, triangles=fold.triangles[fold.triangles[:, 0] < count], others=())
    alone = replace(alone, own=fold.own[:count], crossed=fold.crossed[:count])
    wide = grown(alone, fold.vertices, REACH_RADII * fold.radius)

    def meeting(poses: Poses) -> Ints:
        """(vertices,) 1 for those of the surroundings that cross in some of its poses what the fold may move."""
        placed = [positions for positions, _ in poses]
        found, counted = np.zeros((2, len(wide.vertices)), bool)
        for _ in range(_GROWTHS):
            fresh = (replace(wide, crossed=wide.crossed | found).near | wide.raised) & ~counted
            # Nothing crosses these but what comes near them, by boxes; so the search does not depend on anything else.
            near = np.asarray(fresh[wide.triangles].any(axis=1))
            corners = distinct_values(wide.triangles[near].ravel())
            if not len(corners):
                break
            for positions in placed:
                box = positions[corners]
                near |= meets_box(positions, box.min(axis=0), box.max(axis=0), wide.triangles)
            part = wide.part(near)
            rows = np.searchsorted(wide.vertices, part.vertices)
            crossing = rows[_crossing_in(part, looks, fresh[rows])]
            if (wide.crossed | found)[crossing].all():
                break
            found[crossing] = True
            counted |= fresh
        return found.astype(np.intp)

    inputs = (wide.crossed, wide.raised, [fold.radius])
    found = wide.vertices[wide.searched(looks, len(wide.vertices), meeting, *inputs) > 0]
    fold = grown(fold, found, FREE * SOFT * fold.radius / UNITS)
    crossed = fold.crossed.copy()
    crossed[: len(fold.vertices)] |= np.isin(fold.vertices, found)
    return replace(fold, crossed=crossed)


def _crossing_in(fold: Fold, looks: Sequence[Look], counting: Bools) -> Bools:
    """(vertices,) True for those that cross at seconds of some motions and not at rest, one of them counting."""

    def crossing(poses: Poses) -> Ints:
        still, marked = fold.crossings.pairs_at(fold.rest_positions, counting), np.zeros(len(counting), np.intp)
        for positions, _ in poses:
            marked[fold.crossings.corners_of(fold.crossings.pairs_at(positions, counting) - still)] = 1
        return marked

    return np.asarray(fold.searched(looks, len(counting), crossing, counting) > 0)


def _moments(fold: Fold, clip: Clip) -> Floats:
    """(moments,) seconds of a clip, evenly spread, and those at which the joint is turned furthest either way."""
    evenly, times = (np.linspace(clip.start, clip.end, count) for count in (_MOMENTS, _LOOKS))
    strides = fold.strides(clip, times)
    return distinct_values(np.array([*evenly, times[strides.argmin()], times[strides.argmax()]]))


def near_each_other(one: Fold, two: Fold) -> bool:
    """True if two folds may move the same vertices."""
    first, second = (each.vertices[each.near[: len(each.vertices)]] for each in (one, two))
    return bool(np.isin(first, second).any())
