"""Creases: the contact in a fold as few fixed shapes for any clip, solved for the joint's own motion.

The joint sweeps through its range. A sweep is a clip like those of the asset: it is solved, some of its poses are
compressed with those of other clips into few shapes, and the weights of these are fitted to its solutions, pose by
pose. Players look them up by the joint's turn, also in clips that were never baked.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, reduce
from itertools import compress
from typing import Any, Literal, TypeAlias

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import approach
from wrinklecli.character.rig import Rig
from wrinklecli.drive.angle import JointAngle
from wrinklecli.drive.table import Path, Table
from wrinklecli.effects.contact.fitting import MOST_LOST, combined, fit_pose, fit_poses
from wrinklecli.effects.contact.fold import Fold, Poses, evenly
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.contact.pose_faults import TORN
from wrinklecli.effects.contact.solution import March, Solution, is_clear
from wrinklecli.effects.contact.tissue import UNITS
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, interpolated
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.refine import Refinement

SHAPE_ERROR = 0.35
"""Greatest error of a vertex over the greatest move. Errors are hidden in the fold; shapes are right at contacts."""
# Most shapes of a fold, whatever their error: with the shape that `nonnegative` asks for, ten morph targets.
_MOST_SHAPES = 9
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
# Move of a vertex in a sweep by contact beyond which it ends, solver's units: a limb is pressed by half of its radius.
_DEEPEST = 36.0
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
    """The distance in a clip between contact as players show it and as the bake shows it.

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
class Crease:
    """A fold whose contact is resolved.

    Attributes:
        fold: The surface round the joint.
        shapes: (shapes, free, 3) bind space, at weight 1.
        samples: Weights, with the motions and times in which normals are to be right under them.
        largest: Greatest move in the solutions that the shapes are fitted to, scene units.
        swept: The fits to the sweeps.
        paths: Rows of clips in the table.
        other: Another joint that folds the surface, by whose turn these rows are looked up, too.
    """

    fold: Fold
    shapes: Floats
    samples: tuple[tuple[Floats, Clip, float], ...]
    largest: float
    swept: "tuple[Followed, ...]" = ()
    paths: tuple[Path, ...] = ()
    other: JointAngle | None = None

    @property
    def signal(self) -> JointAngle | None:
        """The turns by which weights are looked up; None if no joint bends the fold."""
        hinge = self.fold.hinge
        return replace(hinge.signal, other=self.other) if isinstance(hinge, Hinge) else None

    def reading(self, clip: Clip, times: Floats) -> Any:
        """The measurements at (frames,) seconds of a clip by which weights are looked up."""
        signal, fold = self.signal, self.fold
        return fold.hinge.reading(fold.rig, clip, times) if signal is None else signal.angles(fold.rig, clip, times)

    @cached_property
    def response(self) -> Table:
        """The weights in sweeps and clips by the joint's turn, or by the shortening of the tool that rises."""
        rows, table = list[Floats](), list[Floats]()
        for each in self.swept:
            # At rest nothing acts.
            good = np.setdiff1d(np.arange(len(each.times)), sorted({*each.faults} - {0}))
            reading: Any = self.fold.hinge.reading(self.fold.rig, each.clip, each.times[good])
            # A morph target may move the ends beyond the place where they are nearest.
            reached = np.maximum.accumulate(np.abs(reading.rows - reading.rows[0]))
            further = np.diff(reached, prepend=0.0 if rows else -1.0) > 0
            rows.append(reading.rows[further])
            table.append((each.weights[good].T / reading.factors).T[further])
        order = np.argsort(np.concatenate(rows))
        weights = np.concatenate(table)[order]
        # Rows between others without weights say nothing.
        acting = np.pad(weights.any(axis=1), 1, constant_values=True)
        kept = acting[:-2] | acting[1:-1] | acting[2:]
        by: Literal["angles", "shortenings"] = "angles" if isinstance(self.fold.hinge, Hinge) else "shortenings"
        return Table(by, np.concatenate(rows)[order][kept], weights[kept], paths=self.paths)

    def follow(self, marched: "MarchedClip") -> "Followed":
        """Fit the shapes to the solutions of a clip, each pose for itself; a fit that tears the surface is a fault.

        In frames with a fault, weights are those of the last good frame and of the next. A clip without a good frame
        has weights that are looked up: at its end, a table holds the last good ones.
        """
        weights, faults = np.zeros((len(marched.times), len(self.shapes))), dict(marched.faults)
        crossing, unspanned, error, lost, times = list[int](), list[int](), 0.0, 0.0, marched.times
        # What lies between others comes after them.
        for frame in sorted(marched.touching, key=lambda frame: marched.solutions[frame].between is not None):
            found, crosses = marched.solutions[frame], False
            if found.between is not None:
                one, two, share = found.between
                weights[frame] = (1.0 - share) * weights[one] + share * weights[two]
            if found.between is None or found.crossing(combined(weights[frame], self.shapes)).any():
                weights[frame], crosses = fit_pose(found, self.shapes)
            moved = combined(weights[frame], self.shapes)
            error = max(error, float(found.errors(moved).max(initial=0.0)))
            loss = abs(found.volume_change(moved))
            lost = max(lost, loss)
            if found.tears(moved):
                faults[frame] = TORN
            # A fit may take no more volume away than it may, and than the solution does.
            if frame in faults or loss > max(MOST_LOST, abs(found.volume_change(found.moved))):
                unspanned.append(frame)
            if crosses:
                crossing.append(frame)
        good = np.setdiff1d(np.arange(len(weights)), sorted(faults))
        if len(good):
            weights = interpolated(times, times[good], weights[good])
        elif self.swept:
            weights = self._looked_up(marched.clip, times)
        return Followed(
            marched.clip,
            times,
            weights,
            error=error * self.fold.radius / UNITS,
            lost=lost,
            crossing=tuple(sorted(crossing)),
            unspanned=tuple(sorted({*crossing, *unspanned})),
            faults=faults,
        )

    def torn_frames(self, clip: Clip, times: Floats, frames: Ints, moves: Sequence[Moves]) -> set[int]:
        """The frames, of some in a clip of (frames,) seconds, in which contact tears the surface.

        `moves` are those of this fold, and of others that add to these.
        """
        scale, fold, moments = UNITS / self.fold.radius, self.fold, times[frames]

        def torn(poses: Poses) -> Ints:
            both = zip(poses, fold.poses(clip, moments), strict=False)
            return np.array([fold.tissue.tears(scale * given, scale * shown) for (shown, _), (given, _) in both], int)

        inputs = (fold.own, fold.crossed, fold.border, [fold.radius])
        return {*frames[fold.searched([(clip, moments)], len(frames), torn, *inputs, moves=moves) > 0].tolist()}

    def moves(self, followed: "Followed") -> Moves:
        """The moves in a clip."""
        return Moves(self.fold.free_vertices, self.shapes, followed.times, followed.weights)

    def looked_up(self, followed: "Sequence[Followed]", *, scale: float, allowed: float) -> "Crease":
        """The same fold with rows of clips in its table if these bring what players show nearer to the bake.

        If players are further off than `allowed`, relative to contact's greatest move, another joint may fold the
        surface, too. Then rows are by the turn of that one as well which brings players nearest.
        """

        def furthest_off(crease: Crease) -> float:
            return max((crease.player_error(each, scale=scale).share for each in followed), default=0.0)

        fold, rig, found = self.fold, self.fold.rig, reduce(Crease._with_path, followed, self)
        if not isinstance(fold.hinge, Hinge) or furthest_off(found) <= allowed:
            return found
        acting = fold.fine.skinned(rig, fold.free_vertices).acting
        joints = [JointAngle.whole(rig, node) for node in np.setdiff1d(rig.joints[acting], [fold.hinge.signal.node])]
        turns = [[each.angles(rig, clip.clip, clip.times).turns for clip in followed] for each in joints]
        moving = [any(np.ptp(each, axis=0).max() > _AT_REST for each in every) for every in turns]
        others = (replace(self, other=joint) for joint in compress(joints, moving))
        return min([found, *(reduce(Crease._with_path, followed, each) for each in others)], key=furthest_off)

    def _with_path(self, followed: "Followed") -> "Crease":
        """The same fold with rows of a clip in its table if these bring what players show nearer to the bake.

        Rows are added where players are furthest off.
        """
        weights, largest = followed.weights, float(np.max(self._lengths(followed.weights), initial=0.0))
        if not isinstance(self.fold.hinge, Hinge) or not largest or len(self.paths) >= _MOST_PATHS:
            return self
        response, reading = self.response, self.reading(followed.clip, followed.times)
        # Nothing touches in the stored pose, whatever further joints do.
        resting = np.sqrt(np.sum(reading.turns**2, axis=1)) < _AT_REST
        kept = np.where(resting[:, None], 0.0, weights)
        shown = response.weights(reading)
        errors, found, rows = self._lengths(shown - weights), self.paths, sorted({0, len(kept) - 1})
        best = float(errors.max())
        while best > _SHOWN_ERROR * largest and 1 < len(rows) <= _MOST_ROWS:
            paths = (*self.paths, Path(reading.turns[rows], kept[rows]))
            before, shown = shown, replace(response, paths=paths).weights(reading)
            changed = (shown != before).any(axis=1)
            errors[changed] = self._lengths((shown - weights)[changed])
            if errors.max() < best:
                best, found = float(errors.max()), paths
            further = np.setdiff1d(np.arange(len(kept)), rows)
            rows = sorted({*rows, int(further[errors[further].argmax()])}) if len(further) else []
        return replace(self, paths=found)

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
        axes = np.moveaxis(self.shapes, 2, 0)
        parts = portions(len(weights), axes[0].size)
        squares = [np.sum([(weights[part] @ axis) ** 2 for axis in axes], axis=0) for part in parts]
        return np.asarray(np.sqrt(np.concatenate([np.zeros(0), *(each.max(axis=1, initial=0.0) for each in squares)])))

    def _looked_up(self, clip: Clip, times: Floats) -> Floats:
        """(frames, shapes) weights at (frames,) seconds of a clip, from the table alone, as a player finds them."""
        return np.asarray(self.response.weights(self.reading(clip, times)))


# A pose in which contact moves something: seconds of a clip or sweep, and the solution there.
SolvedPose: TypeAlias = tuple[Clip, float, Solution]


@dataclass(frozen=True, slots=True)
class MarchedClip:
    """A clip or a sweep, solved.

    Attributes:
        times: (frames,) seconds.
        solutions: The solutions of frames in which contact moves something and has no fault, by their numbers.
        faults: The reasons why it does not count in frames, by their numbers.
    """

    clip: Clip
    times: Floats
    solutions: Mapping[int, Solution]
    faults: Mapping[int, str]

    @property
    def touching(self) -> list[int]:
        """The frames in which contact moves something."""
        return [*self.solutions]

    def poses(self, frames: Sequence[int], most: int) -> Iterator[SolvedPose]:
        """At most so many poses, evenly spread, of some frames in which contact moves something."""
        chosen = (frames[k] for k in evenly(len(frames), most))
        return ((self.clip, float(self.times[frame]), self.solutions[frame]) for frame in chosen)


@dataclass(frozen=True, slots=True)
class Followed:
    """The fit of a crease's shapes to a clip.

    Attributes:
        clip: The first of the clips with this motion, or a sweep.
        times: (frames,) seconds.
        weights: (frames, shapes).
        error: Greatest distance of the shapes from the solutions, scene units.
        lost: Greatest volume that the shapes take away, relative to a limb as long as it is thick.
        crossing: The frames in which the shapes leave crossings.
        unspanned: These frames, and those in which the shapes take volume away or tear the surface.
        faults: The reasons why contact does not count in frames, by their numbers: it is held there, or fades.
    """

    clip: Clip
    times: Floats
    weights: Floats
    error: float
    lost: float
    crossing: tuple[int, ...]
    unspanned: tuple[int, ...]
    faults: Mapping[int, str]


def march_clip(fold: Fold, clip: Clip, times: Floats, *, sweep: bool = False) -> MarchedClip:
    """Solve a clip at (frames,) sorted seconds, near enough to each other for the surface to follow.

    If the clip begins folded, or jumps to a pose that is folded at one of the hinges, an approach from rest is solved
    first. A `sweep` ends where contact moves a vertex further than `_DEEPEST`, or at a fault: nobody may ever bend the
    joint further.
    """
    solutions, faults, count = dict[int, Solution](), dict[int, str](), 0
    for frame, found in enumerate(_in_clip(fold, clip, times)):
        count = frame + 1
        if found.fault is not None:
            faults[frame] = found.fault
        elif found.touches:
            solutions[frame] = found
        if sweep and (found.fault is not None or found.greatest_move > _DEEPEST):
            break
    return MarchedClip(clip, times[:count], solutions, faults)


def _in_clip(fold: Fold, clip: Clip, times: Floats) -> Iterator[Solution]:
    strides, response = fold.strides(clip, times), fold.tissue.response()
    jumps, marching = np.abs(np.diff(strides, axis=0)).max(axis=1) > _JUMP, March(fold, response)
    for part in np.split(np.arange(len(times)), 1 + np.flatnonzero(jumps)):
        if not is_clear(fold, clip, float(times[part[0]])):
            way, there = March(fold, response), approach(clip, float(times[part[0]]), fold.rig)
            moments = np.linspace(0.0, 1.0, _APPROACH)
            deque(way.through(there, moments, fold.strides(there, moments)), maxlen=0)
            marching.reached += way.reached
        yield from marching.through(clip, times[part], strides[part])


def resolve(
    fold: Fold, poses: Sequence[SolvedPose], sweeps: Sequence[MarchedClip], *, fewest: int = 1, most: int = _MOST_SHAPES
) -> Crease:
    """Compress solved poses of the sweeps of a fold, and of clips, and follow the sweeps.

    There are no shapes if nothing touches.

    Args:
        fold: The fold.
        poses: The solved poses.
        sweeps: The sweeps.
        fewest: Least number of shapes. More are made than `SHAPE_ERROR` asks for if there would be crossings.
        most: Greatest number of shapes, even if crossings remain.
    """
    weights, shapes, chosen = np.zeros((0, 0)), np.zeros((0, len(fold.free_vertices), 3)), list[int]()
    if poses:
        weights, shapes, _ = fit_poses([found for *_, found in poses], share=SHAPE_ERROR, most=most, fewest=fewest)
        # Frames in which normals are to be right: those with the greatest weight of each shape, and an even choice.
        even = evenly(len(weights), _NORMAL_POSES).tolist()
        chosen = sorted({*even, *np.argmax(np.abs(weights), axis=0).tolist()})
    crease = Crease(
        fold=fold,
        shapes=shapes,
        samples=tuple((weights[k], *poses[k][:2]) for k in chosen),
        largest=max((found.greatest_move for *_, found in poses), default=0.0) * fold.radius / UNITS,
    )
    return replace(crease, swept=tuple(map(crease.follow, sweeps)))
