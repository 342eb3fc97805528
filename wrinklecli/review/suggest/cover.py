"""Regions that nobody sees: under another layer in the pose that folds them, as in trousers.

Rays leave a region along its normals. They meet a layer that covers it from inside: clothes look away from the body
that wears them, whereas a forearm in front of an upper arm looks at it.
"""

import hashlib
from collections.abc import Collection, Hashable, Iterator, Sequence
from functools import cache, lru_cache

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import moving_nodes
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.numeric.arrays import Floats, diagonal, face_normals, unit
from wrinklecli.numeric.rays import near_points, ray_hits
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.surface.strain import posed

# Greatest distance of a covering layer, as a part of the diagonal of the mesh's box: 20 cm on a person.
_REACH = 0.12
# Greatest thickness of a covering layer, as a part of this diagonal: 14 mm on a person.
_THICKNESS = 0.008
# Distance below which a ray has not left its own triangle, as a part of this diagonal.
_SELF = 1e-6
# Least cosine of a ray and the normal of a triangle that it meets from inside; below the negative, from outside.
_ALONG = 0.2
# Most rays of a region: from the triangles that lose most.
_RAYS = 32
# Part of a region that must be covered for the whole to count as hidden.
_HIDDEN = 0.6
# Most posed layers in memory: those of a character are posed once in each pose.
_KNOWN_LAYERS = 32


class Layers:
    """The primitives of a scene, which may cover a region.

    Primitives that are at the same place in every pose, such as instances of a skinned mesh, are one layer. Layers are
    posed where a box round them is near a region.
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
        self._posed = lru_cache(_KNOWN_LAYERS)(self._pose)
        self._stored_box = cache(self._bounds)

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

    def _bounds(self, number: int) -> Floats:
        """(2, 3) bounds in the stored pose."""
        return _box(_corners(self._layers[number], None, 0.0))

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


def is_covered(mesh: MeasuredMesh, layers: Layers, weights: Floats, clip: Clip, time: float) -> bool:
    """True if most of a region, with (triangles,) `triangle_weights`, lies under another layer in a pose.

    Layers are the other primitives of the scene, and the pieces of the mesh that the region is not on.
    """
    gauge = mesh.gauge
    chosen = np.argsort(-weights, kind="stable")[:_RAYS]
    chosen = chosen[weights[chosen] > 0]
    own, _ = posed(gauge, clip, np.array([time]))
    faces = face_normals(own[0], gauge.triangles[chosen])
    at_rest = face_normals(mesh.rest.positions, gauge.triangles[chosen])
    # Normals point outwards at rest, whichever way triangles wind.
    outward = np.sign(np.sum(at_rest * mesh.rest.normals[gauge.triangles[chosen]].sum(axis=1), axis=1))
    rays = unit(faces) * outward[:, None]
    starts = own[0][gauge.triangles[chosen]].mean(axis=1)
    size = diagonal(mesh.rest.positions)
    corners = [own[0][gauge.triangles[~np.isin(gauge.pieces, gauge.pieces[chosen])]]]
    low, high = starts.min(axis=0) - _REACH * size, starts.max(axis=0) + _REACH * size
    corners += layers.near(clip, time, low, high, node=mesh.rig.node)
    covered = _met_from_inside(starts, rays, np.concatenate(corners), size, _REACH * size)
    return bool(weights[chosen] @ covered > _HIDDEN * weights[chosen].sum())


def _met_from_inside(starts: Floats, rays: Floats, corners: Floats, size: float, reach: float) -> Floats:
    """(rays,) 1 for rays that meet the inside of a layer before they meet anything thicker; else 0.

    Args:
        starts: (rays, 3)
        rays: (rays, 3) unit.
        corners: (triangles, 3, 3) of the layers.
        size: Diagonal of the mesh's box, scene units.
        reach: Greatest length of a ray, scene units.
    """
    near = corners[near_points(corners, starts, reach)]
    covered = np.zeros(len(starts))
    if not len(near):
        return covered
    numbers, triangles, distances = ray_hits(starts, rays, near)
    hit = (distances > _SELF * size) & (distances < reach)
    numbers, triangles, distances = numbers[hit], triangles[hit], distances[hit]
    met = near[triangles]
    normals = unit(face_normals(met.reshape(-1, 3), np.arange(3 * len(met)).reshape(-1, 3)))
    cosines = np.sum(normals * rays[numbers], axis=1)
    inside, outside = np.full((2, len(starts)), np.inf)
    for nearest, sign in ((inside, 1.0), (outside, -1.0)):
        faces = cosines * sign > _ALONG
        np.minimum.at(nearest, numbers[faces], distances[faces])
    covered[np.isfinite(inside) & (inside < outside + _THICKNESS * size)] = 1.0
    return covered
