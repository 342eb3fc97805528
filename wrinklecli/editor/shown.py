"""What an editor shows: an asset's meshes with their wrinkles at a moment, each tool attached and refined by itself.

The functions of a bake attach, refine and carry the tools. Those that lie together are planned together; what others
have is kept, so an edit takes the time of the tools that it touches.
"""

from collections import OrderedDict
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from wrinklecli.baking.job import tools_by_node
from wrinklecli.baking.plan import Ground, MeshPlan, plan_on, read_ground
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.skin import Skin, pose, prepare
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.method.attach import attach_tools
from wrinklecli.method.carry import CarriedPatch, displacements
from wrinklecli.method.patch import Patch
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, flags_of, vertex_normals
from wrinklecli.tools.records import Length, ToolsFile, WrinkleTool

# Of a bake, as long as no option says otherwise.
_MAX_ERROR = Length(1.0, percent=True)
# Rings of triangles around a tool's members that its refinement may read or split: tools whose rings meet are planned
# together.
_RINGS = 4
# Plans and patches that are kept: those of a few undone steps.
_KEPT = 64


@dataclass(frozen=True, eq=False)
class Cluster:
    """Tools that lie together on a mesh, planned together.

    Attributes:
        plan: Of these tools alone.
        parents: (triangles,) of the coarse mesh, rising, that they move or refine.
        triangles: (triangles,) of the refined mesh, in place of these.
    """

    plan: MeshPlan
    parents: Ints
    triangles: Ints

    @property
    def old_count(self) -> int:
        """Vertices of the coarse mesh, which the refined one begins with."""
        return len(self.plan.fine.surface.positions)

    @cached_property
    def skin(self) -> Skin:
        """The new vertices, ready to be posed."""
        fine, old = self.plan.fine, self.old_count
        weights = fine.weights[:, joints_of(self.plan)]
        return prepare(weights, fine.positions[old:], fine.morph_deltas[:, old:])


def joints_of(plan: MeshPlan) -> Ints:
    """(joints,) those that any vertex of a mesh follows."""
    return distinct_values(plan.fine.surface.joints)


@dataclass(frozen=True, eq=False)
class LaidMesh:
    """A node's mesh with all tools on it: the same object as long as all is the same but the pose.

    Attributes:
        ground: The mesh at rest.
        skin: Its vertices, ready to be posed.
        clusters: Its tools.
    """

    ground: Ground
    skin: Skin
    clusters: tuple[Cluster, ...]

    @property
    def node(self) -> str:
        """The name of the node."""
        return self.ground.rig.names[self.ground.rig.node]

    @cached_property
    def kept(self) -> Ints:
        """(triangles,) of the coarse mesh that are shown as they are, rising."""
        kept = np.ones(len(self.ground.surface.triangles), bool)
        for cluster in self.clusters:
            kept[cluster.parents] = False
        return np.flatnonzero(kept)

    @cached_property
    def faces(self) -> Ints:
        """(triangles, 3) vertices: of the coarse mesh's triangles that are kept, then of those of each cluster."""
        parts = [self.ground.surface.triangles[self.kept]]
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            faces = cluster.plan.fine.triangles[cluster.triangles]
            parts.append(np.where(faces < cluster.old_count, faces, faces + shift))
        return np.concatenate(parts)

    @cached_property
    def parents(self) -> Ints:
        """(triangles,) the triangle of the coarse mesh that each of `faces` is, or is a part of."""
        split = [each.plan.fine.subdivision.parents[each.triangles] for each in self.clusters]
        return np.concatenate([self.kept, *split])

    @cached_property
    def rest_positions(self) -> Floats:
        """(vertices, 3) at rest, without wrinkles."""
        new = [each.plan.fine.rest_positions[each.old_count :] for each in self.clusters]
        return np.concatenate([self.ground.rest.positions, *new])

    @cached_property
    def shifts(self) -> list[int]:
        """What is added to the numbers of each cluster's new vertices."""
        counts = [len(each.plan.fine.positions) - each.old_count for each in self.clusters]
        return np.cumsum([0, *counts])[:-1].tolist() if counts else []

    def posed(self, clip: Clip | None, time: float) -> Floats:
        """(vertices, 3) at a time of a clip, seconds, with wrinkles, world space; none for the stored pose."""
        rig, times = self.ground.rig, np.array([time])
        joints = distinct_values(self.ground.surface.joints)
        matrices, weights = joint_matrices(rig, clip, times, joints), morph_weights(rig, clip, times)
        old = len(self.ground.surface.positions)
        total = old + sum(each.skin.weights.shape[1] for each in self.clusters)
        offsets = np.zeros((1, 3, total))
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            plan = cluster.plan
            for carried in plan.carried_patches:
                moved = displacements(carried, plan.fine, rig, plan.rest, clip, times)[0]
                vertices = np.where(carried.vertices < old, carried.vertices, carried.vertices + shift)
                offsets[0][:, vertices] += moved.T
        parts, start = [], 0
        for skin in (self.skin, *(each.skin for each in self.clusters)):
            end = start + skin.weights.shape[1]
            parts.append(pose(skin, matrices, weights, offsets[:, :, start:end])[0][0])
            start = end
        return np.concatenate(parts, axis=1).T

    def normals(self, positions: Floats) -> Floats:
        """(vertices, 3) unit normals of (vertices, 3) positions."""
        return vertex_normals(positions, self.faces)


@dataclass(frozen=True, slots=True)
class LaidTool:
    """A tool on its mesh.

    Attributes:
        plan: Of it and the tools that lie with it.
        carried: It, on the refined surface.
    """

    plan: MeshPlan
    carried: CarriedPatch


@dataclass(frozen=True, slots=True)
class Laid:
    """What tools make of an asset.

    Attributes:
        meshes: Of all nodes of the scene.
        tools: Those that fit, by name.
        problems: What is wrong with the others, a line each, by name.
    """

    meshes: tuple[LaidMesh, ...]
    tools: dict[str, LaidTool]
    problems: dict[str, str]


Kept = TypeVar("Kept")


class _Kept:
    """Results by what they were made from, the latest ones."""

    def __init__(self) -> None:
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable) -> Any:
        """What was made from a key; None where it is not kept."""
        if key in self._values:
            self._values.move_to_end(key)
        return self._values.get(key)

    def put(self, key: Hashable, value: Kept) -> Kept:
        """Keep a value, and give it back."""
        self._values[key] = value
        while len(self._values) > _KEPT:
            self._values.popitem(last=False)
        return value


class Stage:
    """An asset on which tools are laid.

    Args:
        document: With all clips.
        clips: Of it.
        made: Names of those that are a range of motion.
    """

    def __init__(self, document: Document, clips: Sequence[Clip], made: frozenset[str] = frozenset()) -> None:
        self.document, self.clips, self.made = document, tuple(clips), made
        self._neighbours = Neighbours(document)
        self._nodes = [node for node in scene_nodes(document) if "mesh" in document.items("nodes")[node]]
        self._grounds, self._skins = _Kept(), dict[int, Skin]()
        self._patches, self._clusters, self._meshes = _Kept(), _Kept(), _Kept()

    def laid(self, settings: ToolsFile) -> Laid:
        """Lay the tools of a file; those that do not fit are named, with what a bake would say.

        Raises:
            WrinkleError: The asset is at fault, or what the file says beside the tools.
        """
        by_node: dict[int, list[WrinkleTool]] = {}
        problems: dict[str, str] = {}
        for tool in settings.tools:
            try:
                found, _ = tools_by_node(self.document, replace(settings, tools=(tool,)))
                by_node.setdefault(next(iter(found)), []).append(_quick(tool))
            except WrinkleError as error:
                problems[tool.name] = error.lines[0]
        meshes, tools = [], {}
        for node in self._nodes:
            ground = self._ground(node, settings, by_node.get(node, []))
            patches: list[Patch] = []
            for tool in by_node.get(node, []):
                try:
                    patches.append(self._patch(tool, ground, settings))
                except WrinkleError as error:
                    problems[tool.name] = error.lines[0]
            clusters: list[Cluster] = []
            for together in _clusters_of(ground, patches):
                clusters += self._planned(ground, together, settings, problems)
            for cluster in clusters:
                for carried in cluster.plan.carried_patches:
                    tools[carried.patch.tool.name] = LaidTool(cluster.plan, carried)
            meshes.append(self._mesh(ground, tuple(clusters)))
        return Laid(tuple(meshes), tools, problems)

    def _ground(self, node: int, settings: ToolsFile, tools: list[WrinkleTool]) -> Ground:
        key = (node, settings.rest, _bare(tools[0]) if settings.rest == "bind" and tools else None)
        if settings.rest == "bind" and not tools:
            settings = replace(settings, rest="stored")
        found: Ground | None = self._grounds.get(key)
        return found or self._grounds.put(
            key, read_ground(self.document, node, tools, settings, self.clips, neighbours=self._neighbours)
        )

    def _patch(self, tool: WrinkleTool, ground: Ground, settings: ToolsFile) -> Patch:
        key = (_bare(tool), ground, settings.up)
        found: Patch | None = self._patches.get(key)
        return found or self._patches.put(
            key, attach_tools([tool], ground.surface, ground.rest, ground.rig, up=settings.up)[0]
        )

    def _planned(
        self, ground: Ground, patches: Sequence[Patch], settings: ToolsFile, problems: dict[str, str]
    ) -> Iterator[Cluster]:
        """Tools that lie together, planned; where they cannot be, one by one, without those that are at fault."""
        tools = [each.tool for each in patches]
        try:
            yield self._cluster(ground, tools, settings)
        except WrinkleError as error:
            if len(tools) == 1:
                problems[tools[0].name] = error.lines[0]
                return
            fitting = []
            for patch in patches:
                try:
                    self._cluster(ground, [patch.tool], settings)
                    fitting.append(patch)
                except WrinkleError as alone:
                    problems[patch.tool.name] = alone.lines[0]
            if len(fitting) == len(patches):
                problems |= dict.fromkeys((tool.name for tool in tools), error.lines[0])
            elif fitting:
                yield from self._planned(ground, fitting, settings, problems)

    def _cluster(self, ground: Ground, tools: Sequence[WrinkleTool], settings: ToolsFile) -> Cluster:
        key = (tuple(map(_bare, tools)), ground, settings.refinement)
        found: Cluster | None = self._clusters.get(key)
        if found is None:
            plan = plan_on(ground, list(tools), settings, _MAX_ERROR)
            found = self._clusters.put(key, _cluster_of(plan))
        return found

    def _mesh(self, ground: Ground, clusters: tuple[Cluster, ...]) -> LaidMesh:
        key = (ground, clusters)
        found: LaidMesh | None = self._meshes.get(key)
        if found is None:
            surface, node = ground.surface, ground.rig.node
            if node not in self._skins:
                weights = surface.dense_weights(np.arange(len(surface.positions)), len(ground.rig.joints))
                acting = distinct_values(surface.joints)
                self._skins[node] = prepare(weights[:, acting], surface.positions, surface.morph_deltas)
            found = self._meshes.put(key, LaidMesh(ground, self._skins[node], clusters))
        return found


def _bare(tool: WrinkleTool) -> WrinkleTool:
    """A tool without its places in the file, which any edit above it moves."""
    return replace(tool, where="", places={})


def _quick(tool: WrinkleTool) -> WrinkleTool:
    """A tool without what takes too long to be shown while it is edited."""
    return replace(tool, contact=None)


def _clusters_of(ground: Ground, patches: Sequence[Patch]) -> list[list[Patch]]:
    """Patches in groups, so that refinement under those of one reads nothing of another's."""
    groups: list[tuple[list[int], Bools]] = []
    for number, patch in enumerate(patches):
        near = flags_of(_around(ground, patch.members), len(ground.surface.triangles))
        numbers = [number]
        apart = []
        for others, theirs in groups:
            if (near & theirs).any():
                numbers, near = others + numbers, near | theirs
            else:
                apart.append((others, theirs))
        groups = [*apart, (sorted(numbers), near)]
    return [[patches[number] for number in numbers] for numbers, _ in sorted(groups, key=lambda each: each[0])]


def _around(ground: Ground, triangles: Ints) -> Ints:
    """(triangles,) some of the mesh with the rings of others around them."""
    for _ in range(_RINGS):
        triangles = ground.rest.around.faces_of(distinct_values(ground.surface.triangles[triangles]))
    return triangles


def _cluster_of(plan: MeshPlan) -> Cluster:
    """What of a refined mesh differs from the coarse one."""
    fine = plan.fine
    moved = np.zeros(len(fine.positions), bool)
    moved[len(fine.surface.positions) :] = True
    for carried in plan.carried_patches:
        moved[carried.vertices] = True
    parents = distinct_values(fine.subdivision.parents[moved[fine.triangles].any(axis=1)])
    inside = flags_of(parents, len(fine.surface.triangles))
    return Cluster(plan, parents, np.flatnonzero(inside[fine.subdivision.parents]))
