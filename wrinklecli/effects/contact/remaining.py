"""Intersections that remain in a fold with contact, by clip, and those before the bake.

They are counted as edges that pass through triangles, as in `check --crossings`, at vertices that contact may move.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.numeric.arrays import Bools, Floats

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed, Moves
    from wrinklecli.effects.contact.fold import Fold


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

    `others` are moves of other folds, which add to those of this one.
    """
    if not followed.crossing:
        return None
    fold, free = crease.fold, crease.tissue.free & crease.tissue.own
    moves = (crease.moves_with(followed.weights, others, frame) for frame in range(len(times)))
    resolved = np.array(list(_counts(fold, free, clip, times, moves)))
    if not resolved.any():
        return None
    most = int(np.argmax(resolved))
    (wrinkled,), (before,) = (list(_counts(each, free, clip, times[[most]])) for each in (fold, _bare(fold)))
    frames = int(np.count_nonzero(resolved))
    return Remaining(clip.name, float(times[most]), frames, before, wrinkled, int(resolved[most]), followed.given_up)


def _counts(
    fold: "Fold", free: Bools, clip: Clip, times: Floats, moves: Iterator[Floats] | None = None
) -> Iterator[int]:
    """The number of edges that pass through triangles at each of (frames,) seconds of a clip.

    Those of the (vertices,) `free` ones count. `moves` are for each frame the (vertices, 3) displacements by contact,
    bind space.
    """
    crossings = fold.crossings
    for positions, matrices in fold.poses(clip, times):
        if moves is not None:
            positions += np.einsum("vij,vj->vi", matrices, next(moves))
        edges, triangles = crossings.at(positions)
        counts = free[crossings.edges[edges]].any(axis=1) | free[crossings.triangles[triangles]].any(axis=1)
        yield int(np.count_nonzero(counts))


def _bare(fold: "Fold") -> "Fold":
    """The same part of the asset, neither refined nor wrinkled, with the same vertices."""
    coarse = fold.fine.surface.triangles
    inside = coarse[np.isin(coarse, fold.vertices).all(axis=1)]
    others = fold.triangles[fold.triangles[:, 0] >= len(fold.vertices)]
    return replace(fold, carried=(), triangles=np.concatenate([np.searchsorted(fold.vertices, inside), others]))
