"""Poses of a clip that contact does not resolve: what it shows there, and the crossings that remain.

A pose with a fault has the weights of the last good one (`Crease.follow`). Where these tear the surface, or cross more
than wrinkles without contact, contact fades out over a few frames; and where wrinkles then cross more than the skin
alone, they are lowered, likewise. All other poses keep what they have.

Crossings are counted as edges that pass through triangles, as in `check --crossings`, at vertices that contact or the
fold's tools may move. Pairs that cross at rest do not count: they never collide.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.fold import FAINT
from wrinklecli.effects.contact.given_up import WORSE
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed, Moves
    from wrinklecli.effects.contact.fold import Fold

FADE = 0.1
"""Seconds over which contact and wrinkles fade on either side of a pose with a fault: a few frames."""
# Frames of a clip, evenly spread, in which crossings are counted besides those in which the shapes cross.
_LOOKS = 13
# Least number of edges in a frame that count: where two surfaces cross, the line in which they do passes through one at
# either end. A single one is owed to rounding, where flat triangles touch.
_LEAST = 2


@dataclass(frozen=True, slots=True)
class Remaining:
    """The part of a clip that contact does not resolve.

    Attributes:
        clip: The clip's name.
        time: Time of the frame with the most crossings, seconds.
        frames: Number of frames with crossings.
        before: Edges that pass through triangles in that frame without wrinkles.
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
        heights: (frames,) parts of the height that their wrinkles keep.
        remaining: What is not resolved in each; None if all is.
    """

    followed: "tuple[Followed, ...]"
    heights: Floats
    remaining: tuple[Remaining | None, ...]


def nearness(times: Floats, chosen: Ints | Sequence[int]) -> Floats:
    """(frames,) 1 in chosen frames, and less beside them, down to 0, by (frames,) seconds."""
    if not len(chosen):
        return np.zeros(len(times))
    apart = np.abs(times[:, None] - times[np.asarray(chosen)]).min(axis=1)
    return np.asarray(np.maximum(1.0 - apart / FADE, 0.0))


def shown_in(
    creases: "Sequence[Crease]",
    followed: "Sequence[Followed]",
    clip: Clip,
    times: Floats,
    beside: "Sequence[Sequence[Moves]]",
) -> Shown:
    """Find what folds that are solved together show at the (frames,) seconds at which a clip was marched.

    `beside` are for each the moves of folds that are solved before. Crossings are counted in frames with a fault, in
    those in which the shapes cross, and in some that are evenly spread.
    """
    looks = {*np.linspace(0, len(times) - 1, _LOOKS).astype(int).tolist()}
    looks |= {frame for each in followed for frame in (*each.faults, *each.crossing)}
    counts, every = [_Counter(each, clip, times) for each in creases], range(len(times))
    moves = _moves(creases, followed, beside)
    faults = [each.faulty_frames(clip, times, every, own) for each, own in zip(creases, moves, strict=True)]
    for count, own, found in zip(counts, moves, faults, strict=True):
        crossing = count(looks - found.keys(), own)
        unsure = [frame for frame, edges in crossing.items() if edges and own(frame).any()]
        without, low, skin = count(unsure), count(unsure, own, height=FAINT), count(unsure, height=FAINT)
        pairs = [(crossing, without), (low, skin)]
        if any(_total(one, unsure) > _total(other, unsure) for one, other in pairs):
            found |= {frame: WORSE for frame in unsure if any(one[frame] > other[frame] for one, other in pairs)}
    first = [found | dict(each.faults) for each, found in zip(followed, faults, strict=True)]
    while True:
        gone = nearness(times, sorted({frame for each in faults for frame in each}))
        made = [replace(each, weights=(1.0 - gone)[:, None] * each.weights) for each in followed]
        moves = _moves(creases, made, beside)
        looks |= {*every} if gone.any() else set()
        left = [count(looks, own) for count, own in zip(counts, moves, strict=True)]
        skins = [
            count(looks if gone.any() else [frame for frame in looks if found[frame]], height=FAINT)
            for count, found in zip(counts, left, strict=True)
        ]
        held = sorted({frame for each in (*first, *faults) for frame in each})
        heights, height = _lowered(counts, moves, left, skins, held, (gone == 0) | (gone == 1))
        for count, own, shown in zip(counts, moves, left, strict=True):
            for frame in np.flatnonzero(heights < 1.0).tolist():
                shown |= count([frame], own, height=max(float(heights[frame]), FAINT))
        worse = [
            {frame: WORSE for frame in np.flatnonzero((gone > 0) & (gone < 1)).tolist() if found[frame] > skin[frame]}
            for found, skin in zip(left, skins, strict=True)
        ]
        # While contact fades, the surface passes through itself, but not so much that it was better without.
        if not any(worse) or sum(sum(each.values()) for each in left) <= sum(sum(each.values()) for each in skins):
            break
        faults = [found | more for found, more in zip(faults, worse, strict=True)]
    made = [replace(each, faults=found) for each, found in zip(made, first, strict=True)]
    remaining = [
        _remaining(count, each, found, bool(gone.any()), height)
        for count, each, found in zip(counts, made, left, strict=True)
    ]
    return Shown(tuple(made), heights, tuple(remaining))


def _moves(
    creases: "Sequence[Crease]", made: "Sequence[Followed]", beside: "Sequence[Sequence[Moves]]"
) -> list[Callable[[int], Floats]]:
    """For each of some folds a function from a frame to the (vertices, 3) moves by contact there, bind space."""
    found = list[Callable[[int], Floats]]()
    for crease, own, earlier in zip(creases, made, beside, strict=True):
        pairs = [pair for pair in zip(creases, made, strict=True) if pair[0] is not crease]
        others = [move for other, each in pairs for move in other.moves_in(crease.fold, each.weights)]
        found.append(partial(crease.moves_with, own.weights, [*earlier, *others]))
    return found


def _lowered(
    counts: "Sequence[_Counter]",
    moves: Sequence[Callable[[int], Floats]],
    left: Sequence[dict[int, int]],
    skins: Sequence[dict[int, int]],
    held: Sequence[int],
    deciding: Bools,
) -> tuple[Floats, float]:
    """Lower wrinkles where anything crosses, in `deciding` frames, if all of these cross more than on the skin alone.

    In `held` frames they are lowered, too, so that they do not go up and down.

    Returns:
        (frames,) parts of their height, and the least of these.
    """
    crossing = [[frame for frame, edges in found.items() if deciding[frame] and edges] for found in left]
    over = [
        frames if _total(found, frames) > _total(skin, frames) else []
        for found, skin, frames in zip(left, skins, crossing, strict=True)
    ]
    frames, height, found = sorted({frame for each in over for frame in each}), 1.0, left
    while height > 0.0 and any(
        _total(each, own) > _total(skin, own) for each, skin, own in zip(found, skins, over, strict=True)
    ):
        height = height / 2.0 if height > FAINT else 0.0
        low = max(height, FAINT)
        found = [count(each, own, height=low) for count, own, each in zip(counts, moves, over, strict=True)]
    return 1.0 - (1.0 - height) * nearness(counts[0].times, [*frames, *held]), height


def _total(counts: dict[int, int], frames: Iterable[int]) -> int:
    """The sum of the crossings of some frames."""
    return sum(counts[frame] for frame in frames)


class _Counter:
    """Counts the crossings of a fold in the frames of a clip.

    Args:
        crease: The fold.
        clip: The clip.
        times: (frames,) seconds at which it was marched.
    """

    def __init__(self, crease: "Crease", clip: Clip, times: Floats) -> None:
        self.crease, self.clip, self.times = crease, clip, times
        fold = crease.fold
        names = {patch.tool.name for patch in fold.patches}
        self._own = [number for number, each in enumerate(fold.carried) if each.patch.tool.name in names]
        self._counting = crease.tissue.free & crease.tissue.own
        for number in self._own:
            moved = np.isin(fold.vertices, fold.carried[number].vertices)
            self._counting[: len(moved)] |= moved

    def __call__(
        self, frames: Collection[int], moves: Callable[[int], Floats] | None = None, *, height: float = 1.0
    ) -> dict[int, int]:
        """Edges that pass through triangles in frames, with moves by contact, and tools at a part of their height."""
        fold = self.crease.fold if height == 1.0 else self.crease.fold.at_height(height, self._own)
        return self._counts(fold, frames, moves)

    def bare(self, frame: int) -> int:
        """Such edges of the same part of the asset, neither refined nor wrinkled, with the same vertices."""
        fold = self.crease.fold
        coarse = fold.fine.surface.triangles
        inside = coarse[np.isin(coarse, fold.vertices).all(axis=1)]
        others = fold.triangles[fold.triangles[:, 0] >= len(fold.vertices)]
        triangles = np.concatenate([np.searchsorted(fold.vertices, inside), others])
        return self._counts(replace(fold, carried=(), fields=(), triangles=triangles), [frame])[frame]

    def _counts(
        self, fold: "Fold", frames: Iterable[int], moves: Callable[[int], Floats] | None = None
    ) -> dict[int, int]:
        chosen, found = sorted(frames), dict[int, int]()
        still = fold.crossings.pairs_at(fold.rest_positions, self._counting)
        for frame, (positions, matrices) in zip(chosen, fold.poses(self.clip, self.times[chosen]), strict=True):
            if moves is not None:
                positions += np.einsum("vij,vj->vi", matrices, moves(frame))
            count = len(fold.crossings.pairs_at(positions, self._counting) - still)
            found[frame] = count if count >= _LEAST else 0
        return found


def _remaining(
    count: _Counter, followed: "Followed", crossing: dict[int, int], faded: bool, height: float
) -> Remaining | None:
    """Say what is not resolved in a clip, from the crossings in frames; None if all is."""
    faulty = sorted(followed.faults)
    if not faulty and not any(crossing.values()):
        return None
    most, times, hinge = max(crossing, key=lambda frame: crossing[frame]), count.times, count.crease.fold.hinge
    degrees = None
    if faulty and isinstance(hinge, Hinge):
        turns = np.degrees(hinge.reading(count.crease.fold.rig, count.clip, times[faulty]).rows)
        degrees = (float(turns.min()), float(turns.max()))
    return Remaining(
        count.clip.name,
        float(times[most]),
        sum(edges > 0 for edges in crossing.values()),
        before=count.bare(most),
        wrinkled=count([most])[most],
        resolved=crossing[most],
        poses=len(faulty),
        reason=followed.faults[faulty[0]] if faulty else None,
        begin=float(times[faulty[0]]) if faulty else 0.0,
        end=float(times[faulty[-1]]) if faulty else 0.0,
        degrees=degrees,
        faded=faded,
        height=height,
    )
