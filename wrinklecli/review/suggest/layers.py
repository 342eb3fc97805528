"""The layers of a scene in a pose: what may hide a place, as clothes hide a body."""

import hashlib
from collections.abc import Collection, Hashable, Iterator, Sequence
from functools import cache

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import moving_nodes
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.numeric.arrays import Floats


class Layers:
    """The primitives of a scene, which may hide a place.

    Primitives that are at the same place in every pose, such as instances of a skinned mesh, are one layer. Layers are
    posed where a box round them is near a place.
    """

    def __init__(self, scene: Sequence[ScenePrimitive], clips: Sequence[Clip]) -> None:
        """`clips` are all from which poses are asked for."""
        weighed = {channel.node for clip in clips for channel in clip.channels if channel.path == "weights"}
        self._layers: list[ScenePrimitive] = []
        self._nodes: list[set[int]] = []
        numbers: dict[Hashable, int] = {}
        digests: dict[int, bytes] = {}
        for each in scene:
            if len(each.triangles):
                number = numbers.setdefault(_appearance(each, weighed, digests), len(self._layers))
                if number == len(self._layers):
                    self._layers.append(each.bare)
                    self._nodes.append(set())
                self._nodes[number].add(each.rig.node)
        self._moving = [moving_nodes(each.rig) for each in self._layers]
        self._moment: tuple[Clip, float] | None = None
        self._boxes: dict[int, Floats] = {}
        self._posed = cache(self._pose)
        self._stored_box = cache(lambda number: _box(_corners(self._layers[number], None, 0.0)))

    def near(self, clip: Clip, time: float, low: Floats, high: Floats, *, node: int) -> Iterator[Floats]:
        """(triangles, 3, 3) corners, in a pose, of each layer that may reach into a box, but not of a node's own.

        Poses that are asked for one after another take least time.
        """
        if self._moment is None or self._moment[0] is not clip or self._moment[1] != time:
            self._moment = clip, time
            self._posed.cache_clear()
            self._boxes = {}
        for number, nodes in enumerate(self._nodes):
            if nodes == {node}:
                continue
            if number not in self._boxes:
                moves = not self._moving[number].isdisjoint(clip.nodes)
                self._boxes[number] = _box(self._posed(number)) if moves else self._stored_box(number)
            least, most = self._boxes[number]
            # Comparisons with the infinite bounds of a hidden layer are False.
            if (least <= high).all() and (most >= low).all():
                yield self._posed(number)

    def _pose(self, number: int) -> Floats:
        assert self._moment is not None
        return _corners(self._layers[number], *self._moment)


def _appearance(primitive: ScenePrimitive, weighed: Collection[int], digests: dict[int, bytes]) -> Hashable:
    """A key that primitives share if all clips pose them alike.

    `weighed` are the nodes whose morph weights clips move; `digests` has those of vertices and triangles, and gets new
    ones.
    """
    vertices, rig = primitive.vertices, primitive.rig
    if id(vertices) not in digests:
        digest = hashlib.blake2b()
        arrays = (vertices.positions, vertices.morph_deltas, vertices.joints, vertices.weights, primitive.triangles)
        for each in arrays:
            digest.update(f"{each.shape} ".encode() + each.tobytes())
        digests[id(vertices)] = digest.digest()
    own = rig.node if not rig.skinned or rig.node in weighed else -1
    return digests[id(vertices)], own, rig.joints.tobytes(), rig.inverse_binds.tobytes(), rig.morph_weights.tobytes()


def _corners(layer: ScenePrimitive, clip: Clip | None, time: float) -> Floats:
    """(triangles, 3, 3) corners of a layer in a pose; none if its node is hidden."""
    return layer.posed(clip, np.array([time])).corners()


def _box(corners: Floats) -> Floats:
    """(2, 3) bounds of (triangles, 3, 3) corners; least ones are infinite without triangles."""
    places = corners.reshape(-1, 3)
    return np.stack([places.min(axis=0, initial=np.inf), places.max(axis=0, initial=-np.inf)])
