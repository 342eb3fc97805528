"""Poses of a clip that contact does not resolve: what it shows there, and the crossings that remain.

A pose with a fault has the weights of the last good one (`Crease.follow`). Where poses with a fault that follow each
other cross more than the skin alone, they lose contact, or their wrinkles are lowered; contact that tears the surface
is lost, too. All other poses keep what they have, and it fades between.

What fades, fades with the turn of the joint, and not with the time, as players know the turn alone.

Crossings are counted as edges that pass through triangles, as in `check --crossings`, at vertices that contact or the
fold's tools may move. Pairs that cross at rest do not count: they never collide.
"""

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.drive.drive import Rows
from wrinklecli.effects.contact.fold import FAINT, Fold, Poses, evenly
from wrinklecli.effects.contact.pose_faults import TORN, WORSE
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed, Moves

FADE = 2.0
"""Strides of the fold's motion over which contact and wrinkles fade beside a pose: 8°, or an eighth of a rise. From 10°
on, players count turns as others (`drive.table`)."""
# Least number of edges in a frame that count: where two surfaces cross, the line in which they do passes through one at
# either end. A single one is owed to rounding, where flat triangles touch.
_LEAST = 2
# Frames of a run, evenly spread, by which its state is chosen, at most, and likewise of those in which contact does
# nothing: with all of a run, a sleeve that leaves no room took a quarter of the time of its clip. The middle is among
# them, where a clip that goes to and fro folds furthest.
_LOOKS = 9


@dataclass(frozen=True, slots=True)
class Remaining:
    """The part of a clip that contact does not resolve.

    Attributes:
        clip: The clip's name.
        time: Time of the frame with the most crossings, seconds.
        frames: Number of frames with crossings.
        before: Edges that pass through triangles in that frame on the skin alone, as finely refined.
        wrinkled: Such edges with wrinkles.
        resolved: Such edges with contact.
        poses: Number of frames in which contact has a fault,
        reason: what it is in the first of them,
        begin: and the first and
        end: the last of these, seconds.
        degrees: Least and greatest turn of the joint there; None if no joint bends the fold.
        faded: True if contact fades out in some of them.
        height: Height of wrinkles there, as a part of their own.
    """

    clip: str
    time: float
    frames: int
    before: int
    wrinkled: int
    resolved: int
    poses: int = 0
    reason: str | None = None
    begin: float = 0.0
    end: float = 0.0
    degrees: tuple[float, float] | None = None
    faded: bool = False
    height: float = 1.0


@dataclass(frozen=True, slots=True)
class Shown:
    """Folds that are solved together, as they are shown in a clip.

    Attributes:
        followed: The fit of each.
        heights: The parts of the height that their wrinkles keep over time.
        remaining: What is not resolved in each; None if all is.
    """

    followed: "tuple[Followed, ...]"
    heights: Rows
    remaining: tuple[Remaining | None, ...]


def nearness(strides: Floats, chosen: Ints) -> Floats:
    """(frames,) 1 in chosen frames, and less beside them, down to 0, by (folds, frames) strides of joints."""
    apart = np.abs(strides[:, :, None] - strides[:, None, chosen]).max(axis=0).min(axis=1, initial=np.inf)
    return np.asarray(np.maximum(1.0 - apart / FADE, 0.0))


def shown_in(
    creases: "Sequence[Crease]", followed: "Sequence[Followed]", beside: "Sequence[Moves]", counted: Sequence[Fold]
) -> Shown:
    """Find what folds that are solved together show in a clip.

    `beside` are the moves of folds that are solved before, and `counted` the parts in which crossings are counted: in
    frames in which contact acts, or has a fault; and in all if anything crosses in a few of the others, as what never
    collides may.
    """
    clip, times = followed[0].clip, followed[0].times
    moves = [crease.moves(each) for crease, each in zip(creases, followed, strict=True)]
    looks = [_Look(fold, clip, times, moves, beside) for fold in counted]
    strides = np.concatenate([each.fold.strides(clip, times).T for each in creases])
    acting = np.flatnonzero(np.any([each.weights.any(axis=1) for each in followed], axis=0))
    torn = [each.torn_frames(clip, times, acting, [*beside, *moves]) for each in creases]
    unsettled = [frame for each in followed for frame in each.faults]
    acting = distinct_values(np.array([*acting, *unsettled], np.intp))
    idle = np.setdiff1d(np.arange(len(times)), acting)
    some = idle[evenly(len(idle), _LOOKS)]
    if any(look.crossings(some, 1.0, 1.0).any() for look in looks):
        acting = np.arange(len(times))
    worse = [look.worse(look.crossings(acting, 1.0, 1.0)) for look in looks]
    faults = [
        dict.fromkeys(np.flatnonzero(more).tolist(), WORSE) | dict.fromkeys(broken, TORN) | dict(each.faults)
        for each, broken, more in zip(followed, torn, worse, strict=True)
    ]
    broken = set[int]().union(*torn)
    bad = np.array(sorted({frame for each in faults for frame in each}), np.intp)
    whole, low, left = _faded(looks, strides, bad, acting, broken)
    made = [
        replace(each, weights=whole[:, None] * each.weights, faults=dict(sorted(own.items())))
        for each, own in zip(followed, faults, strict=True)
    ]
    remaining = [_remaining(look, each, found, whole, low) for look, each, found in zip(looks, made, left, strict=True)]
    return Shown(tuple(made), Rows(times, low[:, None]), tuple(remaining))


def _faded(
    looks: "Sequence[_Look]", strides: Floats, bad: Ints, acting: Ints, broken: set[int]
) -> tuple[Floats, Floats, list[Ints]]:
    """Let contact and wrinkles fade beside bad frames.

    Args:
        looks: The folds.
        strides: (folds, frames) strides of their joints.
        bad: The frames with a fault.
        acting: All in which contact acts, or has a fault.
        broken: Those in which contact is not to be kept.

    Returns:
        (frames,) parts of contact, (frames,) parts of the height of wrinkles, and for each fold the (frames,) crossings
        under these.
    """
    # While contact fades, the surface passes through itself; if the skin alone crosses less, the clip gets none.
    for chosen in (bad, acting):
        whole, low = np.ones(strides.shape[1]), np.ones(strides.shape[1])
        # Poses that follow each other get the same state.
        for run in np.split(chosen, 1 + np.flatnonzero(np.diff(chosen) > 1)):
            near = nearness(strides, run)
            contact, height = _state(looks, run, keep=chosen is bad and not broken & {*run.tolist()})
            whole, low = np.minimum(whole, 1.0 - (1.0 - contact) * near), np.minimum(low, 1.0 - (1.0 - height) * near)
        left = [look.crossings(acting, whole, low) for look in looks]
        if all(_no_worse(look, found, acting) for look, found in zip(looks, left, strict=True)):
            break
    return whole, low, left


def _state(looks: "Sequence[_Look]", frames: Ints, *, keep: bool) -> tuple[float, float]:
    """The parts of contact and of the wrinkles' height in some frames, with which no fold crosses more than its skin.

    Wrinkles keep as much of their height as they can, and contact is kept where it does not ask for less: held in a
    deep pose, it takes volume away. It is whole or 0, and 0 if it is not to `keep`.
    """
    frames = frames[evenly(len(frames), _LOOKS)]
    heights = 0.5 ** np.arange(1.0 - np.log2(FAINT))
    states = ((contact, height) for height in heights.tolist() for contact in (1.0, 0.0)[not keep :])
    return next(
        state for state in states if all(_no_worse(each, each.crossings(frames, *state), frames) for each in looks)
    )


def _no_worse(look: "_Look", found: Ints, frames: Ints) -> bool:
    """True if in some frames together no more crosses than on the skin, whose crossings take long to find."""
    return not found.any() or bool(found.sum() <= look.skin(frames).sum())


@dataclass(frozen=True)
class _Look:
    """A fold in the frames of a clip.

    Attributes:
        fold: The part of a fold in which crossings are counted.
        clip: The clip.
        times: (frames,) seconds at which it was marched.
        moves: The moves by contact of the folds that are solved together.
        beside: Those of folds that are solved before.
    """

    fold: Fold
    clip: Clip
    times: Floats
    moves: "Sequence[Moves]"
    beside: "Sequence[Moves]"
    # The counts so far, by the frame, the part of contact, and that of the wrinkles' height.
    _known: dict[tuple[int, float, float], int] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def counting(self) -> Bools:
        """(vertices,) True for those that contact or the fold's tools may move."""
        return (self.fold.free & self.fold.own) | self.fold.raised

    @cached_property
    def _still(self) -> set[tuple[int, int]]:
        """The edges and triangles that cross at rest."""
        return self.fold.crossings.pairs_at(self.fold.rest_positions, self.counting)

    def crossings(self, frames: Ints, contact: Floats | float, height: Floats | float) -> Ints:
        """(times,) edges that pass through triangles in some frames, 0 in others.

        Contact and the height of wrinkles are parts of their own, the same or (times,).
        """
        contacts, heights = (np.broadcast_to(each, len(self.times))[frames].tolist() for each in (contact, height))
        asked = [*zip(frames.tolist(), contacts, heights, strict=True)]
        for part, low in {key[1:] for key in asked if key not in self._known}:
            moves = [replace(each, shapes=part * each.shapes) for each in self.moves] if part else []
            fold = self.fold if low == 1.0 else self.fold.at_height(low)
            fresh = [key[0] for key in asked if key[1:] == (part, low) and key not in self._known]
            look, moves = (self.clip, self.times[fresh]), [*self.beside, *moves]
            counts = fold.searched([look], len(fresh), self._counts, self.counting, moves=moves)
            self._known.update(zip(((frame, part, low) for frame in fresh), counts.tolist(), strict=True))
        found = np.zeros(len(self.times), np.intp)
        found[frames] = [self._known[key] for key in asked]
        return found

    def _counts(self, poses: Poses) -> Ints:
        """(poses,) edges that pass through triangles in each of some poses."""
        pairs = (self.fold.crossings.pairs_at(positions, self.counting) - self._still for positions, _ in poses)
        counts = np.array([*map(len, pairs)], np.intp)
        return np.where(counts < _LEAST, 0, counts)

    def skin(self, frames: Ints) -> Ints:
        """(times,) such edges in some frames without contact and wrinkles."""
        return self.crossings(frames, 0.0, FAINT)

    def worse(self, found: Ints) -> Bools:
        """(times,) True where more crosses than on the skin, if this is so in all frames together."""
        skin = self.skin(np.flatnonzero(found))
        return np.asarray((found > skin) & (found.sum() > skin.sum()))


def _remaining(look: _Look, followed: "Followed", crossing: Ints, contact: Floats, height: Floats) -> Remaining | None:
    """Say what is not resolved in a clip, from the (times,) crossings, and the shown parts of contact and height.

    Gives None if all is resolved.
    """
    faulty, most, times = [*followed.faults], int(crossing.argmax()), look.times
    if not faulty and not crossing[most]:
        return None
    turns = look.fold.degrees(look.clip, times[faulty]) if faulty else None
    return Remaining(
        look.clip.name,
        float(times[most]),
        int(np.count_nonzero(crossing)),
        before=int(look.skin(np.array([most]))[most]),
        wrinkled=int(look.crossings(np.array([most]), 0.0, 1.0)[most]),
        resolved=int(crossing[most]),
        poses=len(faulty),
        reason=followed.faults[faulty[0]] if faulty else None,
        begin=float(times[faulty[0]]) if faulty else 0.0,
        end=float(times[faulty[-1]]) if faulty else 0.0,
        degrees=None if turns is None else (float(turns.min()), float(turns.max())),
        faded=bool((contact < 1.0).any()),
        height=float(height.min()),
    )
