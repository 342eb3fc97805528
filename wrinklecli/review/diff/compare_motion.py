"""Compare the motion of two assets: pair the primitives that are visible at each time, and find their distances."""

import hashlib
import struct
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.numeric.arrays import Bools, Floats, distinct_values
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.memory import once
from wrinklecli.review.diff.common_clips import AnimatedScene, CommonClip
from wrinklecli.review.diff.difference import Difference, pairs_by_key, without
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
        self._topologies: dict[int, bytes] = {}
        self._equal: dict[tuple[int, int], bool] = {}
        self._apart: dict[tuple[int, int], Apart] = {}

    def moves(self, primitive: ScenePrimitive, clip: Clip | None) -> bool:
        """True if a clip may move a primitive, or hide it."""
        if clip is None:
            return False
        moving = once(self._moving, id(primitive), lambda: moving_nodes(primitive.rig))
        return not moving.isdisjoint(clip.nodes)

    def topology(self, primitive: ScenePrimitive) -> bytes:
        """A digest of the triangles and the number of vertices; thousands of instances may have many triangles."""
        if id(primitive.vertices) not in self._topologies:
            digest = hashlib.blake2b(struct.pack("<Q", len(primitive.vertices.positions)))
            digest.update(primitive.triangles.tobytes())
            self._topologies[id(primitive.vertices)] = digest.digest()
        return self._topologies[id(primitive.vertices)]

    def equal(self, one: ScenePrimitive, other: ScenePrimitive) -> bool:
        """True if two primitives are the same to the bit."""
        return once(self._equal, (id(one), id(other)), lambda: _equal_primitives(one, other))

    def compared(self, one: ScenePrimitive, other: ScenePrimitive, common: CommonClip, time: float) -> Apart:
        """The result of comparing two primitives with the same triangles that no clip of `common` moves."""
        at_rest = CommonClip((None, None), np.array([time]))
        compare = partial(compare_vertices, one, other, at_rest, at_rest.times, self.tolerance, lambda _done: None)
        found = once(self._apart, (id(one), id(other)), compare)
        return replace(found, worst=replace(found.worst, clip=common.name, time=time))


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
    same_motion = same_nodes and (clip_a is None or clip_b is None or clip_a.moves_as(clip_b))
    found: dict[str, Apart] = {}
    alone: dict[str, Difference] = {}
    for frames in groups.values():
        times = common.times[frames]
        primitives_a, primitives_b = (
            [side.primitives[k] for k in np.flatnonzero(each[frames[0]]).tolist()]
            for side, each in zip((a, b), shown, strict=True)
        )
        pairs, rest_a, rest_b = _matched(primitives_a, primitives_b, stored)
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
    for node in rig.upwards(rig.node):
        channels += [each for path in ("rotation", "scale") if clip and (each := clip.channel(node, path))]
    starts = np.arange(len(times))
    if all(channel.interpolation == "STEP" for channel in channels):
        keys = np.concatenate([np.zeros(0), *(channel.times for channel in channels)])
        starts = distinct_values(np.append(0, np.searchsorted(times, keys)))
        starts = starts[starts < len(times)]
    shown = np.linalg.det(joint_matrices(rig, clip, times[starts])[:, 0, :3, :3]) != 0
    return np.repeat(shown, np.diff(np.append(starts, len(times))))


def _matched(
    primitives_a: Sequence[ScenePrimitive], primitives_b: Sequence[ScenePrimitive], stored: _StoredPoses
) -> tuple[list[tuple[ScenePrimitive, ScenePrimitive]], list[ScenePrimitive], list[ScenePrimitive]]:
    """Pair primitives with the same triangles in their order, and give the unpaired primitives of each asset."""
    keys_a, keys_b = (dict(enumerate(map(stored.topology, each))) for each in (primitives_a, primitives_b))
    pairs = pairs_by_key(keys_a, keys_b)
    return (
        [(primitives_a[i], primitives_b[j]) for i, j in pairs.items()],
        [primitives_a[i] for i in without(keys_a, pairs)],
        [primitives_b[j] for j in without(keys_b, pairs.values())],
    )


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
