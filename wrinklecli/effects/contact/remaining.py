"""Intersections that remain in a fold with contact, by clip, and those before the bake.

They are counted as edges that pass through triangles, as in `check --crossings`, at vertices that contact may move.
Pairs that cross at rest do not count: they never collide.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.fold import FAINT
from wrinklecli.effects.contact.given_up import WORSE, GivenUp, UnresolvedError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, distinct_values

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed, Moves
    from wrinklecli.effects.contact.fold import Fold

# Frames of a clip, evenly spread, in which intersections are counted besides those in which the shapes cross.
_LOOKS = 13
# Least number of edges in a frame that count: where two surfaces cross, the line in which they do passes through one at
# either end. A single one is owed to rounding, where flat triangles touch.
_LEAST = 2


@dataclass(frozen=True, slots=True)
class Remaining:
    """The intersections of a clip with contact, in the frame that has most.

    Attributes:
        clip: The clip's name.
        time: Time of that frame, seconds.
        frames: Number of frames with intersections.
        before: Edges that pass through triangles in that frame without wrinkles.
        wrinkled: Such edges with wrinkles.
        resolved: Such edges with contact.
        given_up: True if the clip is left without contact, as there would be more intersections with it.
    """

    clip: str
    time: float
    frames: int
    before: int
    wrinkled: int
    resolved: int
    given_up: bool


def remaining_in(
    crease: "Crease", clip: Clip, times: Floats, followed: "Followed", others: "Sequence[Moves]" = ()
) -> Remaining | None:
    """Count the intersections at the (frames,) seconds at which a clip was marched; None if there are none.

    Frames are looked at in which the shapes cross, and some that are evenly spread. `others` are moves of other folds,
    which add to those of this one.

    Raises:
        UnresolvedError: There are more than on the same surface without wrinkles and contact.
    """
    fold, free = crease.fold, crease.tissue.free & crease.tissue.own
    looks = distinct_values(np.array([*np.linspace(0, len(times) - 1, _LOOKS).astype(int), *followed.crossing]))
    moves = (crease.moves_with(followed.weights, others, frame) for frame in looks.tolist())
    resolved = np.array(list(_counts(fold, free, clip, times[looks], moves)))
    if not resolved.any():
        return None
    frames, most = int(np.count_nonzero(resolved)), int(np.argmax(resolved))
    time, worst = float(times[looks[most]]), int(resolved[most])
    # On the refined surface, as an edge that is split counts there as often as with contact.
    skin = sum(_counts(fold.at_height(FAINT), free, clip, times[looks]))
    if resolved.sum() > skin:
        raise UnresolvedError(GivenUp(WORSE, frames, clip.name, time))
    (wrinkled,), (before,) = (list(_counts(each, free, clip, times[looks[[most]]])) for each in (fold, _bare(fold)))
    return Remaining(clip.name, time, frames, before, wrinkled, worst, followed.given_up)


def _counts(
    fold: "Fold", free: Bools, clip: Clip, times: Floats, moves: Iterator[Floats] | None = None
) -> Iterator[int]:
    """The number of edges that pass through triangles at each of (frames,) seconds of a clip.

    Those of the (vertices,) `free` ones count. `moves` are for each frame the (vertices, 3) displacements by contact,
    bind space.
    """
    still = fold.crossings.pairs_at(fold.rest_positions, free)
    for positions, matrices in fold.poses(clip, times):
        if moves is not None:
            positions += np.einsum("vij,vj->vi", matrices, next(moves))
        found = len(fold.crossings.pairs_at(positions, free) - still)
        yield found if found >= _LEAST else 0


def _bare(fold: "Fold") -> "Fold":
    """The same part of the asset, neither refined nor wrinkled, with the same vertices."""
    coarse = fold.fine.surface.triangles
    inside = coarse[np.isin(coarse, fold.vertices).all(axis=1)]
    others = fold.triangles[fold.triangles[:, 0] >= len(fold.vertices)]
    return replace(
        fold, carried=(), fields=(), triangles=np.concatenate([np.searchsorted(fold.vertices, inside), others])
    )
