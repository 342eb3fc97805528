"""Motion of two assets compared: which primitives show at each time, which are the same, and how far they are apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.scene import ScenePrimitive, pose_primitive
from wrinklecli.numeric.arrays import Bools, Floats
from wrinklecli.numeric.guard import Progress
from wrinklecli.review.diff.difference import Difference
from wrinklecli.review.diff.moments import AnimatedScene, Moment
from wrinklecli.review.diff.surfaces import (
    Advance,
    Apart,
    Worst,
    compare_surfaces,
    compare_vertices,
    place_of,
    pose_difference,
    untouched,
    when,
)


@dataclass(frozen=True, slots=True)
class Seen:
    """What a viewer sees differ.

    Attributes:
        times: How many moments.
        worst: The greatest distance.
        normal: The greatest angle between normals, degrees.
        differences: What is beyond the tolerance.
    """

    times: int
    worst: Worst | None
    normal: float | None
    differences: tuple[Difference, ...]


def compare_motion(
    a: AnimatedScene, b: AnimatedScene, moments: Sequence[Moment], tolerance: float, progress: Progress
) -> Seen:
    """Compare what both show at all moments.

    Args:
        a: The first asset.
        b: The second.
        moments: The clips of both with their times, as of `common_moments`.
        tolerance: How far vertices may be apart, scene units.
        progress: Called with a stage's name, times done and times in all.
    """
    total, done = sum(len(moment.times) for moment in moments), 0.0

    def advance(times: float) -> None:
        nonlocal done
        done += times
        progress("compare", round(done), total)

    return _together([_compare_moment(a, b, moment, tolerance, advance) for moment in moments])


def _together(several: Sequence[Seen]) -> Seen:
    worsts = [each.worst for each in several if each.worst is not None]
    normals = [each.normal for each in several if each.normal is not None]
    return Seen(
        sum(each.times for each in several),
        max(worsts, key=lambda each: each.distance, default=None),
        max(normals, default=None),
        tuple(difference for each in several for difference in each.differences),
    )


def _compare_moment(a: AnimatedScene, b: AnimatedScene, moment: Moment, tolerance: float, advance: Advance) -> Seen:
    """Compare what both show in a clip."""
    shown = [_shown(side.primitives, clip, moment.times) for side, clip in zip((a, b), moment.clips, strict=True)]
    # Times at which both show the same primitives go together.
    _, groups = np.unique(np.concatenate(shown, axis=1), axis=0, return_inverse=True)
    groups = groups.reshape(-1)
    same_clip = _equal_clips(*moment.clips)
    found: dict[str, Apart] = {}
    alone: dict[str, Difference] = {}
    for group in dict.fromkeys(groups.tolist()):
        times = moment.times[groups == group]
        frame = int(np.argmax(groups == group))
        primitives_a, primitives_b = (
            [side.primitives[k] for k in np.flatnonzero(each[frame])] for side, each in zip((a, b), shown, strict=True)
        )
        pairs, left_a, left_b = _matched(primitives_a, primitives_b, moment, float(times[0]), tolerance)
        share = 1.0 / max(len(pairs) + int(bool(left_a and left_b)), 1)

        def group_advance(done: float, share: float = share) -> None:
            advance(share * done)

        results = []
        for one, other in pairs:
            if same_clip and _equal_primitives(one, other):
                results.append(untouched(one, moment, float(times[0])))
                group_advance(len(times))
            else:
                results.append(compare_vertices(one, other, moment, times, tolerance, group_advance))
        if left_a and left_b:
            results.append(compare_surfaces(left_a, left_b, moment, times, group_advance))
        else:
            for primitive in (*left_a, *left_b):
                message = f"{when(moment.name, float(times[0]))}: only in {'A' if left_a else 'B'}"
                alone.setdefault(place_of(primitive), Difference("pose", place_of(primitive), primitive.name, message))
        for result in results:
            key = result.worst.place
            if key not in found or result.worst.distance > found[key].worst.distance:
                found[key] = result
    beyond = [pose_difference(each) for each in found.values() if each.worst.distance > tolerance]
    normals = [each.normal for each in found.values() if each.normal is not None]
    worst = max((each.worst for each in found.values()), key=lambda each: each.distance, default=None)
    return Seen(len(moment.times), worst, max(normals, default=None), (*alone.values(), *beyond))


def _shown(primitives: Sequence[ScenePrimitive], clip: Clip | None, times: Floats) -> Bools:
    """(times, primitives) whether a primitive is shown; a node that is scaled to nothing is not."""
    shown = np.ones((len(times), len(primitives)), bool)
    by_node: dict[int, Bools] = {}
    for column, primitive in enumerate(primitives):
        if not primitive.rig.skinned:
            if primitive.rig.node not in by_node:
                matrices = joint_matrices(primitive.rig, clip, times)[:, 0, :3, :3]
                by_node[primitive.rig.node] = np.linalg.det(matrices) != 0
            shown[:, column] = by_node[primitive.rig.node]
    return shown


def _matched(
    primitives_a: Sequence[ScenePrimitive],
    primitives_b: Sequence[ScenePrimitive],
    moment: Moment,
    time: float,
    tolerance: float,
) -> tuple[list[tuple[ScenePrimitive, ScenePrimitive]], list[ScenePrimitive], list[ScenePrimitive]]:
    """Pairs of primitives of the same triangles, and those that are left of each asset.

    Among several of the same triangles: the one of the same name, or where that is elsewhere, the nearest.
    """
    waiting: dict[tuple[int, bytes], list[ScenePrimitive]] = {}
    for primitive in primitives_b:
        waiting.setdefault(_topology(primitive), []).append(primitive)
    pairs, left_a = [], []
    for primitive in primitives_a:
        candidates = waiting.get(_topology(primitive), [])
        if not candidates:
            left_a.append(primitive)
            continue
        chosen = candidates[0]
        if len(candidates) > 1:
            at = np.array([time])
            positions = pose_primitive(primitive, moment.clips[0], at).positions

            def away(other: ScenePrimitive, positions: Floats = positions, at: Floats = at) -> float:
                return float(np.abs(pose_primitive(other, moment.clips[1], at).positions - positions).max())

            named = [
                each for each in candidates if (each.name, each.primitive) == (primitive.name, primitive.primitive)
            ]
            chosen = named[0] if named and away(named[0]) <= tolerance else min(candidates, key=away)
        candidates.remove(chosen)
        pairs.append((primitive, chosen))
    return pairs, left_a, [primitive for candidates in waiting.values() for primitive in candidates]


def _topology(primitive: ScenePrimitive) -> tuple[int, bytes]:
    return len(primitive.vertices.positions), primitive.triangles.tobytes()


def _equal_clips(one: Clip | None, other: Clip | None) -> bool:
    """Whether two clips have the same keys to the bit, by the same numbers of nodes."""
    if one is None or other is None:
        return one is other
    return one.moves_as(other)


def _equal_primitives(one: ScenePrimitive, other: ScenePrimitive) -> bool:
    """Whether two primitives are the same to the bit, as is all that moves them: a clip then poses both alike."""
    first, second = one.rig, other.rig
    if (first.node, first.skinned, len(first.locals)) != (second.node, second.skinned, len(second.locals)):
        return False
    arrays = zip(_arrays(one), _arrays(other), strict=True)
    return all(_equal_arrays(*pair) for pair in arrays) and all(
        here.keys() == there.keys() and all(np.array_equal(here[key], there[key]) for key in here)
        for here, there in zip(first.locals, second.locals, strict=True)
    )


def _arrays(primitive: ScenePrimitive) -> tuple[NDArray[Any] | None, ...]:
    """All arrays by which a primitive is posed."""
    vertices, rig = primitive.vertices, primitive.rig
    shape = vertices.positions, vertices.morph_deltas, vertices.normals, vertices.normal_deltas
    skin = vertices.joints, vertices.weights
    return (*shape, *skin, rig.joints, rig.inverse_binds, rig.parents, rig.morph_weights)


def _equal_arrays(one: NDArray[Any] | None, other: NDArray[Any] | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)
