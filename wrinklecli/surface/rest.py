"""The rest pose, as the tools file asks for it: where the surface, normals and markers are when no effect acts.

The paper (C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004) takes the mesh as modelled. Here the rest
pose may also be the stored pose of the nodes, or a moment of a clip.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, Pose, blend, joint_matrices, morph_weights, node_matrices, transform
from wrinklecli.character.rig import Rig
from wrinklecli.character.skin import orientations
from wrinklecli.character.surface import Surface
from wrinklecli.errors import BakeError, ConfigError, unknown
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, VertexFaces, determinants, inverses, median, unit, vertex_normals
from wrinklecli.numeric.closest import closest_point
from wrinklecli.numeric.memory import once
from wrinklecli.tools.records import EffectTool, JointPoint, ToolsFile

# Poses of a surface besides the rest pose that are kept: in the editor a time may be dragged.
_MOST_OTHERS = 16


@dataclass(frozen=True)
class Rest:
    """A surface in its rest pose.

    Attributes:
        clip: The clip whose pose it is; None for the stored pose.
        time: (1,) seconds of the clip.
        matrices: (joints, 4, 4) bind to world space.
        morph_weights: (morph targets,).
        bind_positions: (vertices, 3) stored positions plus weighted morph deltas, bind space.
        blended: (vertices, 3, 4) bind to world space.
        positions: (vertices, 3) world space.
        triangles: (triangles, 3).
    """

    clip: Clip | None
    time: Floats
    matrices: Floats
    morph_weights: Floats
    bind_positions: Floats
    blended: Floats
    positions: Floats
    triangles: Ints
    _others: dict[Hashable, "Rest"] = field(default_factory=dict, init=False, repr=False, compare=False)

    def closest_point(self, point: Floats) -> tuple[int, Floats, Floats]:
        """The triangle, (3,) barycentric coordinates and (3,) position nearest to a (3,) point, world space."""
        return closest_point(self.positions, self.triangles, point)

    def foot(self, point: Floats) -> tuple[Floats, Floats]:
        """(3,) nearest point of the surface to a (3,) point, world space, and the (3,) unit normal there."""
        triangle, barycentrics, place = self.closest_point(point)
        return place, unit(barycentrics @ self.normals_at(self.triangles[triangle]))

    @property
    def pose(self) -> Pose:
        """The joint matrices and morph weights."""
        return Pose(self.matrices, self.morph_weights)

    def once(self, key: Hashable, make: Callable[[], "Rest"]) -> "Rest":
        """Another pose of the surface, made once for each key as long as there are few: tools of a mesh share them."""
        return once(self._others, key, make, _MOST_OTHERS)

    @cached_property
    def normals(self) -> Floats:
        """(vertices, 3) unit normals of all vertices, world space."""
        return carried_normals(self.blended, vertex_normals(self.bind_positions, self.triangles))

    def normals_at(self, vertices: Ints) -> Floats:
        """(chosen, 3) area-weighted bind normals, carried to world space by the inverse transpose."""
        return carried_normals(self.blended[vertices], self.around.normals_at(self.bind_positions, vertices))

    @cached_property
    def to_bind(self) -> Floats:
        """(joints, 4, 4) world to bind space; pseudo-inverses where a joint is scaled to nothing."""
        return np.asarray(np.linalg.pinv(self.matrices), np.float64)

    @cached_property
    def way(self) -> float:
        """1 if triangles wind as in bind space, -1 if the joints mirror the surface."""
        return float(orientations(self.blended, np.ones(len(self.blended)))) or 1.0

    @cached_property
    def around(self) -> VertexFaces:
        """The triangles of each vertex."""
        return VertexFaces.of(self.triangles, len(self.bind_positions))


def rest_pose(
    surface: Surface, rig: Rig, settings: ToolsFile, clips: tuple[Clip, ...], tools: Sequence[EffectTool]
) -> Rest:
    """Pose a surface at rest, as the tools file says.

    Raises:
        ConfigError: The clip that `rest` names is not in the asset.
    """
    clip, time = None, np.zeros(1)
    if not isinstance(settings.rest, str):
        clip = next((each for each in clips if each.name == settings.rest.clip), None)
        if clip is None:
            message = unknown("the asset has no clip", settings.rest.clip, [each.name for each in clips])
            raise ConfigError(message, where=settings.place("rest", "clip"))
        time = np.array([settings.rest.time])
    weights = morph_weights(rig, clip, time)[0]
    matrices = joint_matrices(rig, clip, time)[0]
    if settings.rest == "bind":
        matrices = _bind_matrices(surface, rig, matrices, _morphed(surface, weights), tools)
    return _posed(surface, rig, clip, time, matrices, weights)


def _posed(surface: Surface, rig: Rig, clip: Clip | None, time: Floats, matrices: Floats, weights: Floats) -> Rest:
    bind = _morphed(surface, weights)
    blended = blend(surface.dense_weights(np.arange(len(bind)), len(rig.joints)), matrices[None])[0]
    positions = transform(blended[None], bind)[0]
    return Rest(clip, time, matrices, weights, bind, blended, positions, surface.triangles)


def _morphed(surface: Surface, weights: Floats) -> Floats:
    """(vertices, 3) positions in bind space under (morph targets,) weights."""
    return np.asarray(surface.positions + np.tensordot(weights, surface.morph_deltas, axes=1))


def raised_pose(rest: Rest, surface: Surface, weights: Floats) -> Rest:
    """The rest pose of a surface with other (morph targets,) weights."""
    if np.array_equal(weights, rest.morph_weights):
        return rest

    def make() -> Rest:
        bind = _morphed(surface, weights)
        positions = transform(rest.blended[None], bind)[0]
        return replace(rest, morph_weights=weights, bind_positions=bind, positions=positions)

    return rest.once(weights.tobytes(), make)


def clip_pose(rest: Rest, surface: Surface, rig: Rig, clip: Clip, time: float) -> Rest:
    """A surface at a time of a clip, as large as at rest: an animated scale is taken out."""
    return rest.once((clip.name, time), lambda: _clip_pose(rest, surface, rig, clip, np.array([time])))


def _clip_pose(rest: Rest, surface: Surface, rig: Rig, clip: Clip, at: Floats) -> Rest:
    matrices, weights = joint_matrices(rig, clip, at)[0], morph_weights(rig, clip, at)[0]
    if np.array_equal(matrices, rest.matrices) and np.array_equal(weights, rest.morph_weights):
        return rest
    found = _posed(surface, rig, clip, at, matrices, weights)
    sizes = [float(median(np.cbrt(np.abs(determinants(each.blended[:, :, :3]))))) for each in (rest, found)]
    if sizes[1] <= LEAST_SCALE * sizes[0]:
        return found
    scale = sizes[0] / sizes[1]
    return replace(
        found,
        matrices=np.diag([scale, scale, scale, 1.0]) @ matrices,
        blended=scale * found.blended,
        positions=scale * found.positions,
    )


def _bind_matrices(surface: Surface, rig: Rig, stored: Floats, bind: Floats, tools: Sequence[EffectTool]) -> Floats:
    """(joints, 4, 4) stored matrix of one joint, repeated for every joint: the main one at the first tool's origin.

    Where no tool has points, it is the joint of most weight.
    """
    main = int(np.argmax(np.bincount(surface.joints.reshape(-1), surface.weights.reshape(-1), len(stored))))
    placed = next((tool for tool in tools if tool.points), None)
    if placed is not None:
        place, main = _asked_position(rig, None, np.zeros(1), placed, 0), 0
        # The nearest vertex decides the joint, but the joint decides where vertices lie: a second round settles it.
        for _ in range(2):
            posed = bind @ stored[main, :3, :3].T + stored[main, :3, 3]
            vertex = int(np.argmin(np.sum((posed - place) ** 2, axis=1)))
            main = int(surface.joints[vertex, np.argmax(surface.weights[vertex])])
    return np.tile(stored[main], (len(stored), 1, 1))


def asked_positions(rig: Rig, rest: Rest, tool: EffectTool) -> Floats:
    """(points, 3) where a tool's points are asked for, world space; markers count at rest.

    Raises:
        BakeError: A marker names no node, or several.
    """
    return np.stack([_asked_position(rig, rest.clip, rest.time, tool, number) for number in range(len(tool.points))])


def _asked_position(rig: Rig, clip: Clip | None, time: Floats, tool: EffectTool, number: int) -> Floats:
    point = tool.points[number]
    if isinstance(point, tuple):
        return np.array(point)
    place: Floats = node_matrices(rig, clip, time, [named_node(rig, tool, number)])[0, 0, :3, 3]
    return place + point.offset if isinstance(point, JointPoint) else place


def named_node(rig: Rig, tool: EffectTool, number: int) -> int:
    """The node that a tool's point names.

    Raises:
        BakeError: It names no node, or several.
    """
    point = tool.points[number]
    assert not isinstance(point, tuple), "the point names a node"
    key, wanted = ("joint", point.joint) if isinstance(point, JointPoint) else ("marker", point.marker)
    found = [index for index, name in enumerate(rig.names) if name == wanted]
    if len(found) != 1:
        fault = unknown("no node is named", wanted, rig.names)
        if found:
            fault = f"{len(found)} nodes are named {wanted!r}"
        raise BakeError(fault, where=tool.place_of(number, key))
    return found[0]


def carried_normals(blended: Floats, normals: Floats) -> Floats:
    """(vertices, 3) unit normals moved by the inverse transpose of (vertices, 3, 4) matrices; 0 where singular."""
    return unit(np.einsum("vji,vj->vi", inverses(blended), normals))
