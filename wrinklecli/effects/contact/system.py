"""Systems: folds that share vertices, or that touch in a clip, are solved together in each pose of it.

Both hips press one pelvis, and two knees may meet: solved alone, each fold would have the skinned surface of the other
in its way, and their moves would add up. So the poses of a clip are solved once, for the union of their surfaces. Then
the move of each vertex is divided among the folds, by weights that fade away from where each of them crosses, and each
fold fits its own shapes to its part. Shapes, targets and look-ups are those of one joint, as in a fold that stands
alone: a set of targets for the whole system would have to follow several joints at once. Not in the paper.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, reduce

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.crease import Crease, MarchedClip, march_clip
from wrinklecli.effects.contact.fitting import combined
from wrinklecli.effects.contact.fold import REACH_RADII, Fold, Look, Poses, grown
from wrinklecli.effects.contact.solution import Solution
from wrinklecli.effects.contact.tissue import FREE, SOFT, UNITS, Tissue
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, components, distinct_values

# Poses of a sweep that are checked for crossings before it is solved, from rest to its end.
_CROSSING_POSES = 8
# Moments of a clip at which folds are checked for touching each other, at most.
_MOMENTS = 8
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
        found = []
        for fold in self.folds:
            free = np.zeros(len(self.fold.own), bool)
            free[: len(self.fold.vertices)] = np.isin(self.fold.vertices, fold.free_vertices)
            found.append(replace(self.fold.tissue, free=free))
        return found

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


def touching_in_clips(folds: Sequence[Fold], clips: Iterable[Clip]) -> list[tuple[int, int, Ints]]:
    """Find folds that cross each other in clips, and not at rest, as skinned and wrinkled.

    Returns:
        The numbers of two folds, and the vertices of both that cross, as often as folds do.
    """
    if len(folds) < 2:
        return []
    whole = union([_mesh_alone(each) for each in folds])
    places = whole.rest_positions
    apart = np.full((len(folds), len(places)), np.inf)
    for distances, each in zip(apart, folds, strict=True):
        rows = np.searchsorted(whole.vertices, each.vertices[each.own[: len(each.vertices)]])
        distances[rows] = np.sqrt(np.sum((places[rows] - each.pivot) ** 2, axis=1)) / each.radius
    nearest = np.where(np.isfinite(apart).any(axis=0), np.argmin(apart, axis=0), -1)
    still = whole.crossing(places)
    found: dict[tuple[int, int], set[int]] = {}
    for clip in clips:
        for positions in whole.posed(clip, _moments(folds, clip))[0]:
            edges, triangles = whole.crossings.at(positions)
            corners = np.concatenate([whole.crossings.edges[edges], whole.crossings.triangles[triangles]], axis=1)
            corners = corners[~still[corners].any(axis=1)]
            labels = nearest[corners]
            for one, two in np.unique(labels[:, [0, 2]], axis=0).tolist():
                if one != two and min(one, two) >= 0:
                    these = corners[(labels[:, 0] == one) & (labels[:, 2] == two)]
                    pair = (min(one, two), max(one, two))
                    found.setdefault(pair, set()).update(whole.vertices[np.unique(these)].tolist())
    return [(one, two, np.array(sorted(vertices), np.intp)) for (one, two), vertices in sorted(found.items())]


def crossing_in_sweeps(fold: Fold) -> Bools:
    """(vertices,) True for those that cross in a sweep and not at rest, as skinned and wrinkled."""
    return _crossing_in(fold, [(clip, np.linspace(0.0, 1.0, _CROSSING_POSES)[1:]) for clip, _ in fold.hinge.sweeps])


def crossing_in_clips(fold: Fold, clips: Iterable[Clip]) -> Ints:
    """The fine vertices of a fold that cross in clips and not at rest, as skinned and wrinkled."""
    marked = _crossing_in(fold, [(clip, _moments([fold], clip)) for clip in clips])
    return fold.vertices[marked[: len(fold.vertices)]]


def _crossing_in(fold: Fold, looks: Sequence[Look]) -> Bools:
    """(vertices,) True for those that cross at seconds of some motions, and not at rest."""

    def crossing(poses: Poses) -> Ints:
        marked = np.logical_or.reduce([fold.crossing(positions) for positions, _ in poses])
        return np.asarray(marked & ~fold.crossing(fold.rest_positions), np.intp)

    return np.asarray(fold.searched(looks, len(fold.own), crossing, fold.own) > 0)


def holding_contacts(fold: Fold, clips: Sequence[Clip]) -> tuple[Fold, Ints]:
    """A fold that holds all of its mesh that its free vertices cross in clips, as skinned and wrinkled.

    A shin may meet the other one far below the knee, where the fold of either knee ends: what it may move would cross
    what it does not see.

    Args:
        fold: The fold.
        clips: The clips.

    Returns:
        The fold, which may have grown, and the fine vertices that cross and that it did not have, or held still.
    """
    looks, free = [(clip, _moments([fold], clip)) for clip in clips], fold.vertices[fold.near[: len(fold.vertices)]]
    wide = _coming_near(_mesh_alone(grown(fold, fold.vertices, REACH_RADII * fold.radius)), free, looks)
    counting = np.isin(wide.vertices, free)

    def held_still(poses: Poses) -> Ints:
        still, marked = wide.crossings.pairs_at(wide.rest_positions, counting), np.zeros(len(counting), np.intp)
        for positions, _ in poses:
            corners = wide.crossings.corners_of(wide.crossings.pairs_at(positions, counting) - still)
            marked[corners[~counting[corners].all(axis=1)]] = 1
        return marked

    fresh = wide.vertices[wide.searched(looks, len(counting), held_still, counting) > 0]
    return grown(fold, fresh, FREE * SOFT * fold.radius / UNITS) if len(fresh) else fold, fresh


def _coming_near(fold: Fold, chosen: Ints, looks: Sequence[Look]) -> Fold:
    """The part of a fold that comes near its triangles with chosen fine vertices at seconds of some motions, by boxes.

    Nothing else can cross these, so what is searched for does not depend on it.
    """
    touched = np.asarray(np.isin(fold.vertices, chosen)[fold.triangles].any(axis=1))

    def coming(poses: Poses) -> Ints:
        near: Ints = touched.astype(np.intp)
        for positions, _ in poses:
            corners = [positions.take(each, axis=0) for each in fold.triangles.T]
            low, high = reduce(np.minimum, corners), reduce(np.maximum, corners)
            near |= ((low <= high[touched].max(axis=0)) & (low[touched].min(axis=0) <= high)).all(axis=1)
        return near

    near = fold.searched(looks, len(touched), coming, touched) > 0
    vertices, triangles = np.unique(fold.triangles[near], return_inverse=True)
    own, crossed = fold.own[vertices], fold.crossed[vertices]
    return replace(fold, vertices=fold.vertices[vertices], triangles=triangles.reshape(-1, 3), own=own, crossed=crossed)


def _moments(folds: Sequence[Fold], clip: Clip) -> Floats:
    """(moments,) seconds of a clip, evenly spread, and those at which each joint is turned furthest either way."""
    evenly, times = (np.linspace(clip.start, clip.end, count) for count in (_MOMENTS, _LOOKS))
    strides = [each.hinge.strides(each.rig, clip, times) for each in folds]
    furthest = [times[end(each)] for each in strides for end in (np.argmin, np.argmax)]
    return distinct_values(np.array([*evenly, *furthest]))


def _mesh_alone(fold: Fold) -> Fold:
    """The fold without other meshes."""
    count = len(fold.vertices)
    return replace(fold, others=(), triangles=fold.triangles[fold.triangles[:, 0] < count], own=fold.own[:count])


def near_each_other(one: Fold, two: Fold) -> bool:
    """True if two folds may move the same vertices."""
    first, second = (each.vertices[each.near[: len(each.vertices)]] for each in (one, two))
    return bool(np.isin(first, second).any())


def grouped(count: int, pairs: Iterable[tuple[int, int]]) -> list[list[int]]:
    """The groups of `count` folds of which some pairs belong together, in the order of their first folds."""
    edges = np.array([*pairs], np.intp).reshape(-1, 2)
    labels = components(edges, count)
    return [np.flatnonzero(labels == each).tolist() for each in distinct_values(labels)]
