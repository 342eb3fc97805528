"""Compare the motion of two assets: pair the primitives that are visible at each time, and find their distances."""

import hashlib
import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.numeric.arrays import Bools, Floats, distinct_values
from wrinklecli.numeric.guard import Progress
from wrinklecli.review.diff.common_clips import AnimatedScene, CommonClip
from wrinklecli.review.diff.difference import Difference
from wrinklecli.review.diff.surfaces import (
    Advance,
    Apart,
    compare_surfaces,
    compare_vertices,
    place_of,
    pose_difference,
    untouched,
    when,
)


def compare_motion(
    a: AnimatedScene, b: AnimatedScene, clips: Sequence[CommonClip], tolerance: float, progress: Progress
) -> tuple[list[Apart], list[Difference]]:
    """Compare two assets in their common clips.

    Returns:
        The greatest distance of each pair of primitives in each clip; and differences, which are distances beyond the
        tolerance in scene units, and primitives that only one asset shows.
    """
    total, done = sum(len(common.times) for common in clips), 0.0

    def advance(times: float) -> None:
        nonlocal done
        done += times
        progress("compare", round(done), total)

    apart: list[Apart] = []
    differences: list[Difference] = []
    stored = _StoredPoses(tolerance)
    same_nodes = _equal_nodes(a.primitives, b.primitives)
    for common in clips:
        found, alone = _compare_clip(a, b, common, stored, advance, same_nodes=same_nodes)
        apart += found
        differences += [*alone, *(pose_difference(each) for each in found if each.worst.distance > tolerance)]
    return apart, differences


class _StoredPoses:
    """The parts that clips leave in the stored pose, which are looked at once for all clips.

    A clip for each of many characters moves one of them.
    """

    def __init__(self, tolerance: float) -> None:
        """`tolerance` is in scene units."""
        self.tolerance = tolerance
        self._moving: dict[int, frozenset[int]] = {}
        self._places: dict[int, Floats] = {}
        self._topologies: dict[int, bytes] = {}
        self._equal: dict[tuple[int, int], bool] = {}
        self._apart: dict[tuple[int, int], Apart] = {}

    def moves(self, primitive: ScenePrimitive, clip: Clip | None) -> bool:
        """True if a clip may move a primitive, or hide it."""
        if clip is None:
            return False
        if id(primitive) not in self._moving:
            self._moving[id(primitive)] = moving_nodes(primitive.rig)
        return not self._moving[id(primitive)].isdisjoint(clip.nodes)

    def place(self, primitive: ScenePrimitive, clip: Clip | None, time: Floats) -> Floats:
        """(vertices, 3) positions of a primitive at (1,) time of a clip."""
        if self.moves(primitive, clip):
            return _posed(primitive, clip, time)
        if id(primitive) not in self._places:
            self._places[id(primitive)] = _posed(primitive, None, time)
        return self._places[id(primitive)]

    def topology(self, primitive: ScenePrimitive) -> bytes:
        """A digest of the triangles and the number of vertices; thousands of instances may have many triangles."""
        if id(primitive.vertices) not in self._topologies:
            digest = hashlib.blake2b(struct.pack("<Q", len(primitive.vertices.positions)))
            digest.update(primitive.triangles.tobytes())
            self._topologies[id(primitive.vertices)] = digest.digest()
        return self._topologies[id(primitive.vertices)]

    def equal(self, one: ScenePrimitive, other: ScenePrimitive) -> bool:
        """True if two primitives are the same to the bit."""
        pair = id(one), id(other)
        if pair not in self._equal:
            self._equal[pair] = _equal_primitives(one, other)
        return self._equal[pair]

    def compared(self, one: ScenePrimitive, other: ScenePrimitive, common: CommonClip, time: float) -> Apart:
        """The result of comparing two primitives with the same triangles that no clip of `common` moves."""
        pair = id(one), id(other)
        if pair not in self._apart:
            at_rest = CommonClip((None, None), np.array([time]))
            self._apart[pair] = compare_vertices(one, other, at_rest, at_rest.times, self.tolerance, lambda _done: None)
        found = self._apart[pair]
        return replace(found, worst=replace(found.worst, clip=common.name, time=time))


def _posed(primitive: ScenePrimitive, clip: Clip | None, time: Floats) -> Floats:
    """(vertices, 3) positions at (1,) time."""
    return np.asarray(primitive.posed(clip, time).positions[0] + 0.0)  # -0 and 0 are one place


def _compare_clip(
    a: AnimatedScene, b: AnimatedScene, common: CommonClip, stored: _StoredPoses, advance: Advance, *, same_nodes: bool
) -> tuple[list[Apart], list[Difference]]:
    """Compare the visible primitives of both assets in a clip; differences are those that only one asset shows.

    `same_nodes` is True if the nodes of both assets are the same to the bit.
    """
    tolerance = stored.tolerance
    shown = [
        _shown(side.primitives, clip, common.times, stored) for side, clip in zip((a, b), common.clips, strict=True)
    ]
    # Times at which the same primitives are visible are compared together.
    groups: dict[bytes, list[int]] = {}
    for frame, row in enumerate(np.packbits(np.concatenate(shown, axis=1), axis=1)):
        groups.setdefault(row.tobytes(), []).append(frame)
    clip_a, clip_b = common.clips
    same_keys = clip_a is clip_b if clip_a is None or clip_b is None else clip_a.moves_as(clip_b)
    same_motion = same_keys and same_nodes
    found: dict[str, Apart] = {}
    alone: dict[str, Difference] = {}
    for frames in groups.values():
        times = common.times[frames]
        primitives_a, primitives_b = (
            [side.primitives[k] for k in np.flatnonzero(each[frames[0]]).tolist()]
            for side, each in zip((a, b), shown, strict=True)
        )
        pairs, rest_a, rest_b = _matched(primitives_a, primitives_b, common, float(times[0]), stored)
        part = 1.0 / max(len(pairs) + int(bool(rest_a and rest_b)), 1)

        def advance_part(done: float, part: float = part) -> None:
            advance(part * done)

        results = []
        for one, other in pairs:
            if same_motion and stored.equal(one, other):
                results.append(untouched(one, common, float(times[0])))
                advance_part(len(times))
            elif not stored.moves(one, clip_a) and not stored.moves(other, clip_b):
                results.append(stored.compared(one, other, common, float(times[0])))
                advance_part(len(times))
            else:
                results.append(compare_vertices(one, other, common, times, tolerance, advance_part))
        if rest_a and rest_b:
            results.append(compare_surfaces(rest_a, rest_b, common, times, advance_part))
        else:
            for primitive in (*rest_a, *rest_b):
                message = f"{when(common.name, float(times[0]))}: only in {'A' if rest_a else 'B'}"
                alone.setdefault(place_of(primitive), Difference("pose", place_of(primitive), primitive.name, message))
        for result in results:
            key = result.worst.place
            if key not in found or result.worst.distance > found[key].worst.distance:
                found[key] = result
    return list(found.values()), list(alone.values())


def _shown(primitives: Sequence[ScenePrimitive], clip: Clip | None, times: Floats, stored: _StoredPoses) -> Bools:
    """(times, primitives) False where the node of a primitive is scaled to 0."""
    shown = np.ones((len(times), len(primitives)), bool)
    by_node: dict[int, Bools] = {}
    for column, primitive in enumerate(primitives):
        if not primitive.rig.skinned:
            if primitive.rig.node not in by_node:
                moving = clip if stored.moves(primitive, clip) else None
                by_node[primitive.rig.node] = _node_shown(primitive.rig, moving, times)
            shown[:, column] = by_node[primitive.rig.node]
    return shown


def _node_shown(rig: Rig, clip: Clip | None, times: Floats) -> Bools:
    """(times,) False where a node is scaled to 0; if only steps move it, they alone are evaluated, to save time."""
    channels: list[Channel] = []
    node = rig.node
    while node >= 0:
        channels += [each for path in ("rotation", "scale") if clip and (each := clip.channel(node, path))]
        node = int(rig.parents[node])
    starts = np.arange(len(times))
    if all(channel.interpolation == "STEP" for channel in channels):
        keys = np.concatenate([np.zeros(0), *(channel.times for channel in channels)])
        starts = distinct_values(np.append(0, np.searchsorted(times, keys)))
        starts = starts[starts < len(times)]
    shown = np.linalg.det(joint_matrices(rig, clip, times[starts])[:, 0, :3, :3]) != 0
    return np.repeat(shown, np.diff(np.append(starts, len(times))))


def _matched(
    primitives_a: Sequence[ScenePrimitive],
    primitives_b: Sequence[ScenePrimitive],
    common: CommonClip,
    time: float,
    stored: _StoredPoses,
) -> tuple[list[tuple[ScenePrimitive, ScenePrimitive]], list[ScenePrimitive], list[ScenePrimitive]]:
    """Pairs of primitives with the same triangles, and the unpaired primitives of each asset.

    Among several with the same triangles, the pair has the same name, or is the nearest if that one is elsewhere.
    """
    waiting: dict[bytes, list[ScenePrimitive]] = {}
    for primitive in primitives_b:
        waiting.setdefault(stored.topology(primitive), []).append(primitive)
    candidates = {key: _Candidates(found, common.clips[1], time, stored) for key, found in waiting.items()}
    pairs, rest_a = [], []
    for primitive in primitives_a:
        alike = candidates.get(stored.topology(primitive))
        chosen = alike.take(primitive, common.clips[0]) if alike is not None else None
        if chosen is None:
            rest_a.append(primitive)
        else:
            pairs.append((primitive, chosen))
    return pairs, rest_a, [primitive for each in candidates.values() for primitive in each.rest]


class _Candidates:
    """Primitives of the second asset that have the same triangles; each can be taken once.

    Each is posed once, and indexed by name and by place, so that thousands of instances do not take minutes.
    """

    def __init__(
        self, primitives: Sequence[ScenePrimitive], clip: Clip | None, time: float, stored: _StoredPoses
    ) -> None:
        self._primitives, self._clip = primitives, clip
        self._time, self._stored = np.array([time]), stored
        self._waiting = np.ones(len(primitives), bool)
        self._count = len(primitives)
        self._by_name: dict[tuple[str, int], deque[int]] = {}
        for number, each in enumerate(primitives):
            self._by_name.setdefault((each.name, each.primitive), deque()).append(number)
        # Instances are often at one place. The numbers of those at each place that may be free, by the place,
        self._by_place: dict[bytes, deque[int]] = {}
        # and in the places' order; how many are free; the places; and the place of each primitive.
        self._queues: list[deque[int]] = []
        self._free = np.zeros(0, np.intp)
        self._places = np.zeros((0, 0))
        self._place_of = np.zeros(len(primitives), np.intp)

    @property
    def rest(self) -> list[ScenePrimitive]:
        """The primitives that were not taken."""
        return [self._primitives[number] for number in np.flatnonzero(self._waiting).tolist()]

    def take(self, primitive: ScenePrimitive, clip: Clip | None) -> ScenePrimitive | None:
        """The primitive of the same name, or the nearest if that one is elsewhere; the first of equals."""
        if not self._count:
            return None
        number = int(self._waiting.argmax()) if self._count == 1 else self._match(primitive, clip)
        self._waiting[number], self._count = False, self._count - 1
        if self._queues:
            self._free[self._place_of[number]] -= 1
        return self._primitives[number]

    def _match(self, primitive: ScenePrimitive, clip: Clip | None) -> int:
        if not self._queues:
            places = [self._stored.place(each, self._clip, self._time) for each in self._primitives]
            for number, each in enumerate(places):
                self._by_place.setdefault(each.tobytes(), deque()).append(number)
            self._queues = list(self._by_place.values())
            self._places = np.stack([places[numbers[0]] for numbers in self._queues])
            for index, numbers in enumerate(self._queues):
                self._place_of[list(numbers)] = index
            self._free = np.bincount(self._place_of)
        place = self._stored.place(primitive, clip, self._time)
        named = self._first(self._by_name.get((primitive.name, primitive.primitive)))
        if named is not None:
            there = self._stored.place(self._primitives[named], self._clip, self._time)
            if np.abs(there - place).max(initial=0.0) <= self._stored.tolerance:
                return named
        same = self._first(self._by_place.get(place.tobytes()))
        if same is not None:
            return same
        return self._nearest(place)

    def _nearest(self, place: Floats) -> int:
        """The nearest one; the distance of first vertices is a lower bound, which saves most comparisons."""
        free = np.flatnonzero(self._free)
        least = np.abs(self._places[free, :1] - place[:1]).max(axis=(1, 2), initial=0.0)
        best = (np.inf, -1)
        for k in np.argsort(least, kind="stable").tolist():
            if least[k] > best[0]:
                break
            number = self._first(self._queues[free[k]])
            assert number is not None
            best = min(best, (float(np.abs(self._places[free[k]] - place).max(initial=0.0)), number))
        return best[1]

    def _first(self, numbers: deque[int] | None) -> int | None:
        """The first number that was not taken; taken ones are dropped from the queue."""
        while numbers and not self._waiting[numbers[0]]:
            numbers.popleft()
        return numbers[0] if numbers else None


def _equal_nodes(one: Sequence[ScenePrimitive], other: Sequence[ScenePrimitive]) -> bool:
    """True if the nodes of two assets, which all their primitives share, are the same to the bit."""
    if not one or not other:
        return False
    first, second = one[0].rig, other[0].rig
    return np.array_equal(first.parents, second.parents) and all(
        here.keys() == there.keys() and all(np.array_equal(here[key], there[key]) for key in here)
        for here, there in zip(first.locals, second.locals, strict=True)
    )


def _equal_primitives(one: ScenePrimitive, other: ScenePrimitive) -> bool:
    """True if two primitives are the same to the bit; if their nodes are too, a clip poses both alike."""
    if (one.rig.node, one.rig.skinned) != (other.rig.node, other.rig.skinned):
        return False
    for here, there in zip(_arrays(one), _arrays(other), strict=True):
        if (here is not there) if here is None or there is None else not np.array_equal(here, there):
            return False
    return True


def _arrays(primitive: ScenePrimitive) -> tuple[NDArray[Any] | None, ...]:
    """All arrays by which a primitive is posed."""
    vertices, rig = primitive.vertices, primitive.rig
    shape = vertices.positions, vertices.morph_deltas, vertices.normals, vertices.normal_deltas
    skin = vertices.joints, vertices.weights
    return (*shape, *skin, rig.joints, rig.inverse_binds, rig.morph_weights)
