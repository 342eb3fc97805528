"""Creases: the contact in a fold as few fixed shapes for any clip, solved for the joint's own motion.

The joint sweeps through its range, and four times more with its axis leaning by 10° to a side. Each clip is solved,
too. The solutions of sweeps and clips are compressed together into few shapes. The weights of a clip are fitted to its
solutions, pose by pose. Players look them up by the joint's turn, also in clips that were never baked.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import approach
from wrinklecli.character.rig import Rig
from wrinklecli.drive.table import LeaningTable, Path, Table
from wrinklecli.effects.contact.fitting import MOST_LOST, combined, fit_pose, fit_poses
from wrinklecli.effects.contact.fold import RINGS, Fold
from wrinklecli.effects.contact.given_up import (
    DEGENERATE,
    GivenUp,
    UnresolvedError,
    degenerate_given_up,
)
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.contact.rise import Rise
from wrinklecli.effects.contact.solution import (
    March,
    Solution,
    free_rows,
    is_clear,
)
from wrinklecli.effects.contact.tissue import FREE, SOFT, UNITS, Tissue
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, interpolated
from wrinklecli.numeric.closest import nearest_of
from wrinklecli.numeric.intersections import widened
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.refine import Refinement

# A sweep ends where contact moves a vertex this far, solver's units: a limb is pressed by half of its radius,
_DEEPEST = 36.0
# and by a quarter if the axis leans. Deeper leaning sweeps would ask for more shapes than clips have use for.
_DEEPEST_LEANING = 18.0
# Strides between two poses of a leaning sweep, which only adds to the others.
_LEANING_STRIDES = 2.0
# Poses of a sweep that are checked for crossings before it is solved, from rest to its end.
_CROSSING_POSES = 8
# Poses from rest to the beginning of a clip that is folded there, or to the pose to which a clip jumps.
_APPROACH = 33
# Strides between two frames from which on a clip jumps, as STEP keys do: a quarter of what closes most folds.
_JUMP = 4.0
# Players whose weights are this much further off than none show none, solver's units: a millimetre of a knee.
_AS_NEAR = 1.0
# Error of what players show of a clip up to which they need no more rows of it, relative to contact's greatest move
# there: the default of `--max-error`. At 0.05 up to seven rows were saved, and `track` was off by as much in that clip.
_SHOWN_ERROR = 0.01
# Most rows of a clip, which take about 2 kB: clips that bend a limb need 7 to 20.
_MOST_ROWS = 32
# Most clips of which there are rows: a player looks at each row in each frame.
_MOST_PATHS = 16
# A bend of 30°, radians, beyond which some pose must settle; about half of a rise.
_FAR = float(np.radians(30.0))
# Sine of half of the turn below which a joint is in its stored pose: rounding.
_AT_REST = 1e-4
# Sampled poses, evenly spread, in which normals are to be right, beside those with the greatest weights. With 8, two
# knees that meet opened a black slit where they only began to touch.
_NORMAL_POSES = 24


@dataclass(frozen=True, slots=True)
class Moves:
    """The moves by contact of a fold in one clip.

    Attributes:
        vertices: (moved,) sorted fine vertices.
        shapes: (shapes, moved, 3) bind space, at weight 1.
        times: (frames,) seconds.
        weights: (frames, shapes) at these, linear between them.
    """

    vertices: Ints
    shapes: Floats
    times: Floats
    weights: Floats

    def displacements(self, _fine: Refinement, _rig: Rig, _clip: Clip | None, times: Floats) -> Floats:
        """(frames, moved, 3) displacements at (frames,) seconds, bind space."""
        return np.tensordot(interpolated(times, self.times, self.weights), self.shapes, axes=1)


@dataclass(frozen=True, slots=True)
class PlayerError:
    """How far what players show of contact in a clip is from what the bake shows.

    Attributes:
        length: Greatest distance between the two, scene units.
        greatest: Greatest move by contact in the clip, as baked, scene units.
        silent: True if players show no contact in the clip, as what they look up is further off.
    """

    length: float
    greatest: float
    silent: bool = False

    @property
    def share(self) -> float:
        """The distance relative to the greatest move; 0 where contact moves nothing."""
        return self.length / self.greatest if self.greatest else 0.0


@dataclass(frozen=True)
class Surface:
    """A fold as the solver sees it.

    Attributes:
        fold: The surface round the joint.
        tissue: That surface with its resistance and its collisions.
    """

    fold: Fold
    tissue: Tissue

    @classmethod
    def of(cls, fold: Fold, apart: Floats) -> "Surface":
        """Make a fold ready for the solver, with distances as `distances_from_crossings` gives them.

        Raises:
            UnresolvedError: All of it crosses at rest.
        """
        tissue = tissue_of(fold, apart)
        if not tissue.colliding.any():
            raise UnresolvedError(GivenUp(DEGENERATE))
        # What its copies have in common is computed once for all processes.
        tissue.again()
        return cls(fold, tissue)

    @property
    def vertices(self) -> Ints:
        """(free,) sorted fine welded vertices that the solver may move."""
        return self.fold.vertices[free_rows(self.tissue)]

    @property
    def leaning_sweeps(self) -> list[tuple[int, float]]:
        """The sweeps whose axis leans: the number of a leaning, and where the sweep ends."""
        return [(number, end) for number in range(1, len(self.fold.hinge.leanings)) for end in self.fold.hinge.ends]

    def sweep(self, number: int, end: float) -> "Sweep":
        """Solve the sweep of a leaning, by its number, to an end.

        A sweep ends before the first pose that does not settle, is torn, or takes too many steps. Nobody may ever bend
        the joint as far, and clips that do are solved themselves.
        """
        fold, lean = self.fold, self.fold.hinge.leanings[number]
        way = sweep_way(fold, lean, end)
        clip = fold.hinge.turn(way, tilt=lean)
        times = np.linspace(0.0, 1.0, len(way))
        poses = list[SolvedPose]()
        try:
            with degenerate_given_up():
                solutions = March(fold, self.tissue.again()).through(clip, times)
                for folded, time, found in zip(way, times, solutions, strict=True):
                    if found.fault is not None:
                        degrees = float(np.degrees(folded)) if isinstance(fold.hinge, Hinge) else None
                        return Sweep(poses, UnresolvedError(GivenUp(found.fault, 1, degrees=degrees)))
                    if found.touches:
                        settled = found.settled_in(self.tissue)
                        poses.append(SolvedPose(clip, float(time), settled, float(folded), number))
                        if found.greatest_move > (_DEEPEST_LEANING if lean.any() else _DEEPEST):
                            break
        except UnresolvedError as error:
            return Sweep(poses, error)
        return Sweep(poses)

    def march(self, clip: Clip, times: Floats) -> "MarchedClip":
        """Solve a clip at (frames,) sorted seconds, as `march_clip` does."""
        return march_clip(self.fold, self.tissue, [self.fold.hinge], clip, times)


@dataclass(frozen=True)
class Crease(Surface):
    """A fold whose contact is resolved.

    Attributes:
        poses: Number of poses of the sweeps in which contact moves something.
        shapes: (shapes, free, 3) bind space, at weight 1.
        response: Weights of the shapes by the joint's turn, or by the shortening of the tool that rises.
        samples: Weights, with the motions and times in which normals are to be right under them.
        error: Greatest distance of the shapes from the solutions of the sweeps, scene units.
        largest: Greatest move in the solutions, scene units.
        squeezed: Greatest volume that the shapes take away in the sweeps, relative to a limb as long as it is thick.
        crossing: Number of poses of the sweeps in which the shapes leave crossings.
    """

    poses: int
    shapes: Floats
    response: Table | LeaningTable
    samples: tuple[tuple[Floats, Clip, float], ...]
    error: float
    largest: float
    squeezed: float
    crossing: int

    @property
    def sizes(self) -> Floats:
        """(shapes,) greatest move of a vertex at weight 1, bind units."""
        return np.asarray(np.sqrt(np.sum(self.shapes**2, axis=2)).max(axis=1))

    @property
    def counting(self) -> Bools:
        """(vertices,) True for those that contact or the fold's tools may move."""
        return (self.tissue.free & self.tissue.own) | self.fold.raised

    def follow(self, marched: "MarchedClip") -> "Followed":
        """Fit the shapes to the solutions of a clip, each pose for itself.

        In frames with a fault, weights are those of the last good frame and of the next. A clip without a good frame
        has weights that are looked up: at its end, a table holds the last good ones.
        """
        weights = np.zeros((len(marched.times), len(self.shapes)))
        crossing, unspanned, error, times = list[int](), list[int](), 0.0, marched.times
        # What lies between others comes after them.
        for frame in sorted(marched.touching, key=lambda frame: marched.solution(frame).between is not None):
            found, crosses = marched.solution(frame), False
            if found.between is not None:
                one, two, share = found.between
                weights[frame] = (1.0 - share) * weights[one] + share * weights[two]
            if found.between is None or found.crossing(combined(weights[frame], self.shapes)).any():
                weights[frame], crosses = fit_pose(found, self.shapes)
            moved = combined(weights[frame], self.shapes)
            error = max(error, found.greatest_error(moved))
            # A fit may take no more volume away than it may, and than the solution does.
            if found.volume_loss(moved) > max(MOST_LOST, found.volume_loss(found.moved)):
                unspanned.append(frame)
            if crosses:
                crossing.append(frame)
        good = np.setdiff1d(np.arange(len(weights)), sorted(marched.faults))
        held = interpolated(times, times[good], weights[good]) if len(good) else self._looked_up(marched.clip, times)
        error *= self.fold.radius / UNITS
        unspanned = sorted({*crossing, *unspanned})
        return Followed(marched.clip, times, held, error, tuple(sorted(crossing)), tuple(unspanned), marched.faults)

    def torn_frames(self, clip: Clip, times: Floats, frames: Ints, moves: Sequence[Moves]) -> set[int]:
        """The frames, of some in a clip of (frames,) seconds, in which contact tears the surface.

        `moves` are those of this fold, and of others that add to these.
        """
        scale, fold = UNITS / self.fold.radius, self.fold
        shown = replace(fold, movers=(*fold.movers, *moves)).poses(clip, times[frames])
        return {
            frame
            for frame, (given, _), (made, _) in zip(
                frames.tolist(), fold.poses(clip, times[frames]), shown, strict=True
            )
            if self.tissue.tears(scale * given, scale * made)
        }

    def moves(self, followed: "Followed") -> Moves:
        """The moves in a clip."""
        return Moves(self.vertices, self.shapes, followed.times, followed.weights)

    def with_path(self, followed: "Followed") -> "Crease":
        """The same fold with rows of a clip in its table if these bring what players show nearer to the bake.

        Rows are added where players are furthest off.
        """
        response, hinge, weights = self.response, self.fold.hinge, followed.weights
        largest = float(np.max(self._lengths(weights), initial=0.0))
        if not isinstance(response, LeaningTable) or not isinstance(hinge, Hinge) or not largest:
            return self
        if len(response.paths) >= _MOST_PATHS:
            return self
        reading = hinge.reading(self.fold.rig, followed.clip, followed.times)
        # Nothing touches in the stored pose, whatever other joints do.
        resting = np.sqrt(np.sum(reading.turns**2, axis=1)) < _AT_REST
        kept = np.where(resting[:, None], 0.0, weights)
        best, found = float(self._lengths(response.weights(reading) - weights).max(initial=0.0)), response
        rows = sorted({0, len(kept) - 1})
        while best > _SHOWN_ERROR * largest and 1 < len(rows) <= _MOST_ROWS:
            tried = replace(response, paths=(*response.paths, Path(reading.turns[rows], kept[rows])))
            errors = self._lengths(tried.weights(reading) - weights)
            if errors.max() < best:
                best, found = float(errors.max()), tried
            further = np.setdiff1d(np.arange(len(kept)), rows)
            rows = sorted({*rows, int(further[errors[further].argmax()])}) if len(further) else []
        return replace(self, response=found)

    def player_error(self, followed: "Followed", *, scale: float) -> PlayerError:
        """The error of what players look up in a clip; `scale` is world over bind units.

        A joint may fold as in the sweeps while others keep its sides apart, or contact fades in the clip: then players
        show less that is wrong without contact.
        """
        greatest, apart = (
            scale * float(np.max(self._lengths(each), initial=0.0))
            for each in (followed.weights, self._looked_up(followed.clip, followed.times) - followed.weights)
        )
        silent = apart > greatest + _AS_NEAR * self.fold.radius / UNITS
        return PlayerError(greatest if silent else apart, greatest, silent)

    def _lengths(self, weights: Floats) -> Floats:
        """(frames,) greatest moves of a vertex, bind units, under (frames, shapes) weights."""
        parts = portions(len(weights), self.shapes[0].size if len(self.shapes) else 1)
        squares = [np.sum(np.tensordot(weights[part], self.shapes, axes=1) ** 2, axis=2) for part in parts]
        return np.asarray(np.sqrt(np.concatenate([np.zeros(0), *(each.max(axis=1, initial=0.0) for each in squares)])))

    def _looked_up(self, clip: Clip, times: Floats) -> Floats:
        """(frames, shapes) weights at (frames,) seconds of a clip, from the table alone, as a player finds them."""
        reading: Any = self.fold.hinge.reading(self.fold.rig, clip, times)
        return np.asarray(self.response.weights(reading))


@dataclass(frozen=True, slots=True)
class SolvedPose:
    """A pose in which contact moves something.

    Attributes:
        clip: The clip, or a sweep.
        time: Seconds of it.
        found: The solution.
        folded: In a sweep, angle of the joint, radians, or fraction of a rise.
        lean: In a sweep, number of the leaning of the axis; 0 if it does not lean.
    """

    clip: Clip
    time: float
    found: Solution
    folded: float | None = None
    lean: int = 0

    @property
    def far(self) -> bool:
        """True if a sweep with this pose has gone so far that contact is worth having: 30°, or half of a rise."""
        return self.folded is not None and abs(self.folded) >= _FAR


@dataclass(frozen=True, slots=True)
class Sweep:
    """A solved sweep of a joint.

    Attributes:
        poses: Those in which contact moves something.
        failed: The error that ends the sweep; None if none does.
    """

    poses: list[SolvedPose]
    failed: UnresolvedError | None = None


@dataclass(frozen=True, slots=True)
class MarchedClip:
    """A clip, solved.

    Attributes:
        times: (frames,) seconds.
        solutions: For each frame the solution; None if contact moves nothing, or has a fault.
        faults: The reasons why it does not count in frames, by their numbers.
    """

    clip: Clip
    times: Floats
    solutions: tuple[Solution | None, ...]
    faults: Mapping[int, str]

    @property
    def touching(self) -> list[int]:
        """The frames in which contact moves something."""
        return [frame for frame, found in enumerate(self.solutions) if found is not None]

    def solution(self, frame: int) -> Solution:
        """The solution of a frame in which contact moves something."""
        found = self.solutions[frame]
        assert found is not None
        return found

    def poses(self, frames: Iterable[int]) -> Iterator[SolvedPose]:
        """The poses of some frames in which contact moves something."""
        return (SolvedPose(self.clip, float(self.times[frame]), self.solution(frame)) for frame in frames)


@dataclass(frozen=True, slots=True)
class Followed:
    """The fit of a crease's shapes to a clip.

    Attributes:
        clip: The first of the clips with this motion.
        times: (frames,) seconds.
        weights: (frames, shapes).
        error: Greatest distance of the shapes from the solutions, scene units.
        crossing: The frames in which the shapes leave crossings.
        unspanned: These frames, and those in which the shapes take volume away.
        faults: The reasons why contact does not count in frames, by their numbers: it is held there, or fades.
    """

    clip: Clip
    times: Floats
    weights: Floats
    error: float
    crossing: tuple[int, ...]
    unspanned: tuple[int, ...]
    faults: Mapping[int, str]


def march_clip(fold: Fold, tissue: Tissue, hinges: "Sequence[Hinge | Rise]", clip: Clip, times: Floats) -> MarchedClip:
    """Solve a clip at (frames,) sorted seconds, near enough to each other for the surface to follow.

    If the clip begins folded, or jumps to a pose that is folded at one of the hinges, an approach from rest is solved
    first.
    """
    solutions, faults = list[Solution | None](), dict[int, str]()
    for frame, found in enumerate(_in_clip(fold, tissue.again(), hinges, clip, times)):
        if found.fault is not None:
            faults[frame] = found.fault
        solutions.append(found.settled_in(tissue) if found.touches else None)
    return MarchedClip(clip, times, tuple(solutions), faults)


def _in_clip(
    fold: Fold, tissue: Tissue, hinges: "Sequence[Hinge | Rise]", clip: Clip, times: Floats
) -> Iterator[Solution]:
    strides = np.stack([hinge.strides(fold.rig, clip, times) for hinge in hinges], axis=1)
    jumps, marching = np.abs(np.diff(strides, axis=0)).max(axis=1) > _JUMP, March(fold, tissue)
    for part in np.split(np.arange(len(times)), 1 + np.flatnonzero(jumps)):
        if not is_clear(fold, tissue, clip, float(times[part[0]])):
            way, there = March(fold, tissue), approach(clip, float(times[part[0]]), fold.rig)
            deque(way.through(there, np.linspace(0.0, 1.0, _APPROACH)), maxlen=0)
            marching.reached += way.reached
        yield from marching.through(clip, times[part], strides[part])


def poses_of_sweeps(solved: Sequence[Sweep]) -> list[SolvedPose]:
    """The poses in which contact moves something, of a joint's motion about its own axis.

    Raises:
        UnresolvedError: This motion has a fault, and none of its poses that touch counts beyond 30°.
    """
    poses = [pose for each in solved for pose in each.poses]
    failed = [each.failed for each in solved if each.failed is not None]
    if failed and not any(pose.far for pose in poses):
        raise failed[0]
    return poses


def resolve(surface: Surface, poses: Sequence[SolvedPose], *, share: float, most: int, fewest: int = 1) -> Crease:
    """Compress solved poses of the sweeps of a fold, and of clips.

    There are no shapes if nothing touches.

    Args:
        surface: The fold.
        poses: The solved poses, sweeps first.
        share: Greatest error of a vertex, relative to the greatest move. More shapes are made than this asks for if
            there would be crossings.
        most: Greatest number of shapes, even if crossings remain.
        fewest: Least number of shapes.
    """
    fold, tissue = surface.fold, surface.tissue
    weights, shapes, crossing = np.zeros((0, 0)), np.zeros((0, len(free_rows(tissue)), 3)), 0
    if poses:
        weights, shapes, crossing = fit_poses([each.found for each in poses], share=share, most=most, fewest=fewest)
    sweeps = tuple(each for each in poses if each.folded is not None)
    made = [(each.found, combined(row, shapes)) for each, row in zip(sweeps, weights, strict=False)]
    scale = fold.radius / UNITS
    torn = [found.tears(moved) for found, moved in made]
    return Crease(
        fold=fold,
        tissue=tissue,
        poses=len(sweeps),
        shapes=shapes,
        response=_response(fold, sweeps, weights, torn),
        samples=tuple((weights[k], poses[k].clip, poses[k].time) for k in _chosen(weights)) if poses else (),
        error=scale * max((found.greatest_error(moved) for found, moved in made), default=0.0),
        largest=scale * max((each.found.greatest_move for each in poses), default=0.0),
        squeezed=max((found.volume_loss(moved) for found, moved in made), default=0.0),
        crossing=crossing,
    )


def _response(fold: Fold, solved: Sequence[SolvedPose], weights: Floats, torn: Sequence[bool]) -> Table | LeaningTable:
    """Tabulate (solved, shapes) weights of the sweeps, at the rows of all of them.

    A sweep ends before a pose that is torn under its weights.
    """
    kept = _before_torn(solved, torn)
    solved, weights = [solved[number] for number in kept], weights[kept]
    sweeps = [_tabulated(fold, lean, solved, weights) for lean in range(len(fold.hinge.leanings))]
    rows, table = sweeps[0]
    if not isinstance(fold.hinge, Hinge):
        return Table("shortenings", rows, table / fold.hinge.factors_at(rows)[:, None])
    every = distinct_values(np.concatenate([each for each, _ in sweeps]))
    central, tables = interpolated(every, rows, table), []
    for own, weights_there in sweeps[1:]:
        # Where a leaning sweep has ended, it differs from the others as at its end.
        held = np.clip(every, own[0], own[-1])
        tables.append(central + interpolated(held, own, weights_there) - interpolated(held, rows, table))
    return LeaningTable(Table("angles", every, central), fold.hinge.towards, np.stack(tables))


def _before_torn(solved: Sequence[SolvedPose], torn: Sequence[bool]) -> list[int]:
    """Numbers of the poses of sweeps before the first in the same sweep that is torn."""
    sweeps = [(each.lean, (each.folded or 0.0) > 0) for each in solved]
    ends: dict[tuple[int, bool], float] = {}
    for sweep, each, bad in zip(sweeps, solved, torn, strict=True):
        if bad:
            ends[sweep] = min(ends.get(sweep, np.inf), abs(each.folded or 0.0))
    pairs = enumerate(zip(sweeps, solved, strict=True))
    return [number for number, (sweep, each) in pairs if abs(each.folded or 0.0) < ends.get(sweep, np.inf)]


def _tabulated(fold: Fold, lean: int, solved: Sequence[SolvedPose], weights: Floats) -> tuple[Floats, Floats]:
    """(rows,) sorted measurements of the sweeps of a leaning, and (rows, shapes) weights: 0 before anything touches."""
    own = [(each.folded or 0.0, number) for number, each in enumerate(solved) if each.lean == lean]
    stride = fold.hinge.stride * (_LEANING_STRIDES if lean else 1.0)
    ahead = {0.0}
    for end in fold.hinge.ends:
        there = [abs(folded) for folded, _ in own if folded * end > 0]
        ahead.add(float(np.sign(end)) * max(min(there) - stride, 0.0) if there else end)
    every = sorted([*own, *((folded, len(solved)) for folded in ahead)])
    padded = np.concatenate([weights, np.zeros((1, weights.shape[1]))])
    rows = fold.hinge.rows(np.array([folded for folded, _ in every]), tilt=fold.hinge.leanings[lean])
    # A morph target may move the ends beyond the place where they are nearest.
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(rows), prepend=-np.inf) > 0)
    return rows[rising], padded[[number for _, number in every]][rising]


def _chosen(weights: Floats) -> list[int]:
    """Frames in which normals are to be right: the frame with the greatest weight of each shape, and an even choice."""
    even = np.linspace(0, len(weights) - 1, _NORMAL_POSES).astype(int).tolist()
    return sorted({*even, *np.argmax(np.abs(weights), axis=0).tolist()})


def sweep_way(fold: Fold, lean: Floats, end: float) -> Floats:
    """(poses,) evenly spaced turns of a sweep of a leaning to an end."""
    stride = fold.hinge.stride * (_LEANING_STRIDES if lean.any() else 1.0)
    return np.linspace(0.0, end, int(np.ceil(abs(end) / stride)) + 1)


def sweep_poses(fold: Fold) -> int:
    """The number of poses of all sweeps of a fold, if none ends early."""
    return sum(len(sweep_way(fold, lean, end)) for lean in fold.hinge.leanings for end in fold.hinge.ends)


def distances_from_crossings(fold: Fold, further: Ints | None = None) -> Floats | None:
    """(vertices,) distance at rest from the vertices that cross in a sweep and not at rest, solver's units.

    `further` are fine welded vertices that cross in clips. None if nothing of the fold's own crosses. Where edges are
    long, a vertex counts as nearer, so that corrections fade over at least `RINGS` edges.
    """
    still = fold.crossing(fold.rest_positions)
    marked = np.zeros(len(fold.own), bool)
    for lean in fold.hinge.leanings:
        for end in fold.hinge.ends:
            clip = fold.hinge.turn(sweep_way(fold, lean, end), tilt=lean)
            looks = np.linspace(0.0, 1.0, _CROSSING_POSES)[1:] if not lean.any() else np.ones(1)
            for positions in fold.posed(clip, looks)[0]:
                marked |= fold.crossing(positions)
    marked &= ~still
    if further is not None:
        marked[: len(fold.vertices)] |= np.isin(fold.vertices, further)
    if not marked[fold.own].any():
        return None
    apart = nearest_of(fold.rest_positions[marked], fold.rest_positions)[0] * UNITS / fold.radius
    for ring in range(1, RINGS + 1):
        marked, within = widened(fold.crossings.edges, marked), marked
        apart = np.where(marked & ~within, np.minimum(apart, FREE * SOFT * ring / (RINGS + 1)), apart)
    return apart


def border(fold: Fold) -> Bools:
    """(vertices,) True for vertices with triangles beyond the fold, which must stay; not for those of other meshes."""
    inside = np.bincount(fold.triangles.reshape(-1), minlength=len(fold.own))[: len(fold.vertices)]
    starts = fold.fine.around.starts
    return np.asarray(starts[fold.vertices + 1] - starts[fold.vertices] > inside)


def tissue_of(fold: Fold, apart: Floats) -> Tissue:
    """The fold as the solver sees it, from (vertices,) distances from what crosses, solver's units."""
    free = apart < FREE * SOFT
    free[: len(fold.vertices)] &= ~border(fold)
    edges, crossed = fold.crossings.at(fold.rest_positions)
    # Triangles without a free corner never touched one.
    colliding = np.asarray(free[fold.triangles].any(axis=1))
    colliding[crossed] = False
    through = np.zeros(len(free), bool)
    through[fold.crossings.edges[edges]] = True
    colliding[(through & ~fold.own)[fold.triangles].any(axis=1)] = False
    tissue = Tissue(fold.rest_positions * UNITS / fold.radius, fold.triangles, colliding, free, fold.own, apart)
    tissue = tissue.without_touching()
    return tissue if fold.own.all() else tissue.without_close_meshes()
