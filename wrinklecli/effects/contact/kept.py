"""Solved folds, kept by all that their solution depends on: where one tool of many moves, the other folds are found.

A fold is a part of a refined mesh. Its solution depends on this part in the poses of sweeps and clips, as all tools and
effects move it there, and not on the numbers of its vertices in the mesh. So the key is a digest of all that makes the
poses. What is searched for in poses is kept likewise (`Fold.searched`).
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, TypeAlias

import numpy as np

from wrinklecli.character.clip import Channel, Clip
from wrinklecli.effects.contact.crease import Crease, Followed
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.kept import digest_of, plain, read_records, written_records
from wrinklecli.numeric.arrays import Floats

MOST_BYTES = 2**27
"""Bytes of a stored solution at most: 9 shapes of 100,000 vertices, which no solver gets through, take a quarter."""


Spanned: TypeAlias = Sequence[tuple[Crease, Mapping[int, Followed]]]
"""Folds that are solved together: their shapes, and the weights of these in each clip, by its number."""


_RECORDS = (Crease, Followed, Clip, Channel)


def solution_key(
    members: Sequence[Fold], clips: Mapping[int, Clip], times: Callable[[Clip], Floats], how: object
) -> str:
    """A digest of all that the solution of some folds depends on, besides this program.

    Args:
        members: The folds that are solved together.
        clips: The clips by their numbers.
        times: The (frames,) seconds of a clip at which the folds are marched.
        how: What else decides how clips are solved.
    """
    every = np.unique(np.concatenate([fold.vertices for fold in members]))

    def parts(fold: Fold) -> Iterator[Any]:
        yield from (np.searchsorted(every, fold.vertices), fold.triangles, fold.own, fold.border, fold.rest_positions)
        yield from (fold.pivot, [fold.radius, fold.per_clip], fold.crossed)
        for clip, moments in [*fold.hinge.sweeps, *((clip, times(clip)) for clip in clips.values())]:
            yield from (moments, *fold.hinge.reading(fold.rig, clip, moments))
            yield fold.hinge.strides(fold.rig, clip, moments)
            yield from fold.inputs(clip, moments)

    name = json.dumps(plain((members[0].rig, clips, how)), default=repr)
    return digest_of(chain.from_iterable(map(parts, members)), name)


def written(solved: Spanned, members: Sequence[Fold], clips: Mapping[int, Clip]) -> bytes:
    """The bytes of a solution."""
    return written_records(solved, [*members, *clips.values()])


def read(data: bytes, members: Sequence[Fold], clips: Mapping[int, Clip]) -> Spanned:
    """Read a stored solution.

    Raises:
        AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError: It is none of these folds.
    """
    stored: Spanned = read_records(data, _RECORDS, [*members, *clips.values()])
    if [id(crease.fold) for crease, _ in stored] != [id(fold) for fold in members if fold.crosses]:
        raise ValueError("its folds are others")
    for crease, own in stored:
        if crease.shapes.shape[1:] != (len(crease.fold.free_vertices), 3) or [*own] != [*clips]:
            raise ValueError("its folds or clips are others")
        fitted = [*crease.swept, *own.values()]
        if any(each.weights.shape != (len(each.times), len(crease.shapes)) for each in fitted):
            raise ValueError("its weights are others")
    return stored
