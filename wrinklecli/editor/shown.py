"""What an editor shows: an asset's meshes with their wrinkles at a moment, each tool attached and refined by itself.

The functions of a bake attach, refine and carry the tools. Those that lie together are planned together; what others
have is kept, so an edit takes the time of the tools that it touches. In a hurry these are carried anew on the triangles
that are there, and refined later.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrinklecli.baking.job import check_clip_names, tools_by_node, why_left_out
from wrinklecli.baking.plan import Ground, MeshPlan, plan_on, read_ground
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.skin import Skin, pose, prepare
from wrinklecli.editor.played import Latest, Played
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.method.attach import attach_tools
from wrinklecli.method.carry import CarriedPatch, carry, displacements
from wrinklecli.method.patch import Patch
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, children, distinct_values, flags_of, vertex_normals
from wrinklecli.tools.records import Length, ToolsFile, WrinkleTool

# Of a bake, as long as no option says otherwise.
_MAX_ERROR = Length(1.0, percent=True)
# Rings of triangles around a tool's members that its refinement may read or split: tools whose rings meet are planned
# together.
_RINGS = 4
# Kept for undone steps: patches and plans beside one for each tool, meshes beside one for each node. A plan may take
# 10 MB.
_PATCHES, _PLANS, _MESHES = 256, 24, 8


@dataclass(frozen=True, eq=False)
class Cluster:
    """Tools that lie together on a mesh, planned together.

    Attributes:
        plan: Of these tools alone.
        parents: (triangles,) of the coarse mesh, rising, that they move or refine.
        triangles: (triangles,) of the refined mesh, rising, in place of these.
        skin: The new vertices, ready to be posed.
    """

    plan: MeshPlan
    parents: Ints
    triangles: Ints
    skin: Skin

    @classmethod
    def of(cls, plan: MeshPlan, skin: Skin | None = None) -> "Cluster":
        """What of a refined mesh differs from the coarse one; `skin` where it is known."""
        fine, old = plan.fine, len(plan.fine.surface.positions)
        moved = np.zeros(len(fine.positions), bool)
        moved[old:] = True
        for carried in plan.carried_patches:
            moved[carried.vertices] = True
        parents = distinct_values(fine.subdivision.parents[any_of(moved, fine.triangles)])
        if skin is None:
            weights = fine.weights[:, distinct_values(fine.surface.joints)]
            skin = prepare(weights, fine.positions[old:], fine.morph_deltas[:, old:])
        return cls(plan, parents, children(fine.subdivision.parents, parents), skin)

    @property
    def old_count(self) -> int:
        """Vertices of the coarse mesh, which the refined one begins with."""
        return len(self.plan.fine.surface.positions)

    def apart_from(self, taken: Bools) -> "Cluster":
        """It without what is at (triangles,) of the coarse mesh that others show already; in a hurry some may."""
        if not taken[self.parents].any():
            return self
        parents = self.parents[~taken[self.parents]]
        return replace(self, parents=parents, triangles=children(self.plan.fine.subdivision.parents, parents))


@dataclass(frozen=True, eq=False)
class LaidMesh:
    """A node's mesh with all tools on it: the same object as long as all is the same but the pose.

    Its vertices are those of the coarse mesh, welded, then the new ones of each cluster.

    Attributes:
        ground: The mesh at rest.
        skin: Its vertices, ready to be posed.
        clusters: Its tools.
        played: Where poses and heights come from.
    """

    ground: Ground
    skin: Skin
    clusters: tuple[Cluster, ...]
    played: Played

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
        counts = [each.skin.weights.shape[1] for each in self.clusters]
        shifts: list[int] = np.cumsum([0, *counts])[:-1].tolist()
        return shifts

    def posed(self, clip: Clip | None, time: float, *, wrinkled: bool = True) -> Floats:
        """(vertices, 3) at a time of a clip, seconds, world space; in the stored pose where there is no clip.

        Args:
            clip: The animation.
            time: Seconds.
            wrinkled: With wrinkles.
        """
        rig, old = self.ground.rig, len(self.ground.surface.positions)
        matrices, weights = self.played.pose(self.ground, clip, time)
        skins = (self.skin, *(each.skin for each in self.clusters))
        ends = np.cumsum([0, *(each.weights.shape[1] for each in skins)])
        offsets = np.zeros((1, 3, int(ends[-1])))
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            plan = cluster.plan
            for carried in plan.carried_patches if wrinkled else ():
                amplitudes, _ = self.played.at(self.ground, carried.patch, clip, time)
                moved = displacements(carried, plan.fine, rig, plan.rest, clip, np.array([time]), amplitudes)[0]
                offsets[0][:, np.where(carried.vertices < old, carried.vertices, carried.vertices + shift)] += moved.T
        parts = [
            pose(skin, matrices, weights, offsets[:, :, start:end])[0][0]
            for skin, start, end in zip(skins, ends[:-1], ends[1:], strict=True)
        ]
        return np.concatenate(parts, axis=1).T

    def normals(self, positions: Floats) -> Floats:
        """(vertices, 3) unit normals of (vertices, 3) positions."""
        return vertex_normals(positions, self.faces)


@dataclass(frozen=True, slots=True)
class LaidTool:
    """A tool on its mesh.

    Attributes:
        ground: The mesh.
        plan: Of the tool and those that lie with it.
        carried: The tool, on the refined surface.
    """

    ground: Ground
    plan: MeshPlan
    carried: CarriedPatch

    @property
    def patch(self) -> Patch:
        """It, attached."""
        return self.carried.patch


@dataclass(frozen=True, slots=True)
class Laid:
    """What tools make of an asset.

    Attributes:
        meshes: Of all nodes of the scene.
        tools: Those that fit, by name.
        problems: What is wrong with the others, a line each, by name.
        hurried: Whether tools are on triangles that were not refined for them.
    """

    meshes: tuple[LaidMesh, ...]
    tools: dict[str, LaidTool]
    problems: dict[str, str]
    hurried: bool


class Stage:
    """An asset on which tools are laid. Several threads may ask.

    Args:
        document: With all clips.
        clips: Of it.
        made: Names of those that are a range of motion.
    """

    def __init__(self, document: Document, clips: Sequence[Clip], made: frozenset[str] = frozenset()) -> None:
        self.document, self.clips, self.made = document, tuple(clips), made
        self.played = Played()
        self._neighbours = Neighbours(document)
        self._nodes = [node for node in scene_nodes(document) if "mesh" in document.items("nodes")[node]]
        self._grounds, self._skins = Latest(2 * len(self._nodes)), Latest(len(self._nodes))
        self._patches, self._clusters, self._meshes = (
            Latest(_PATCHES),
            Latest(_PLANS),
            Latest(len(self._nodes) + _MESHES),
        )

    def laid(self, settings: ToolsFile, before: Laid | None = None) -> Laid:
        """Lay the tools of a file; those that do not fit are named, with what a bake would say.

        Args:
            settings: The file.
            before: What was laid before: then in a hurry. Tools that have changed are carried on what was refined for
                them before, and new ones on the mesh as it is.

        Raises:
            WrinkleError: The asset is at fault, or what the file says beside the tools.
        """
        self._patches.count, self._clusters.count = (each + len(settings.tools) for each in (_PATCHES, _PLANS))
        by_node: dict[int, list[WrinkleTool]] = {}
        problems: dict[str, str] = {}
        for tool in settings.tools:
            why = why_left_out(tool, self.document)
            if why is not None:
                problems[tool.name] = f"{tool.name}: is left out, as {why}"
                continue
            try:
                alone = replace(settings, tools=(tool,))
                check_clip_names(alone, (), tuple(clip for clip in self.clips if clip.name not in self.made))
                found, _ = tools_by_node(self.document, alone)
                by_node.setdefault(next(iter(found)), []).append(_quick(tool))
            except WrinkleError as error:
                problems[tool.name] = error.lines[0]
        meshes, tools, hurried = [], {}, False
        for node in self._nodes:
            ground = self._ground(node, settings, by_node.get(node, []))
            patches: list[Patch] = []
            for tool in by_node.get(node, []):
                try:
                    patches.append(self._patch(tool, ground, settings))
                except WrinkleError as error:
                    problems[tool.name] = error.lines[0]
            groups = _groups_of(ground, patches)
            clusters: list[Cluster] = []
            if before is not None:
                known = [self._known(ground, group, settings) is not None for group in groups]
                waiting = [patch for group, there in zip(groups, known, strict=True) if not there for patch in group]
                groups = [group for group, there in zip(groups, known, strict=True) if there]
                clusters += self._carried_again(ground, waiting, before, settings, problems)
                hurried |= bool(waiting)
            for group in groups:
                clusters += self._planned(ground, group, settings, problems)
            for cluster in clusters:
                for carried in cluster.plan.carried_patches:
                    tools[carried.patch.tool.name] = LaidTool(ground, cluster.plan, carried)
            meshes.append(self._mesh(ground, tuple(clusters)))
        return Laid(tuple(meshes), tools, problems, hurried)

    def _ground(self, node: int, settings: ToolsFile, tools: list[WrinkleTool]) -> Ground:
        bound_to = _bare(tools[0]) if settings.rest == "bind" and tools else None
        key = (node, settings.rest, bound_to)
        if settings.rest == "bind" and not tools:
            settings = replace(settings, rest="stored")
        found: Ground | None = self._grounds.get(key)
        return found or self._grounds.put(
            key, read_ground(self.document, node, tools, settings, self.clips, neighbours=self._neighbours)
        )

    def _patch(self, tool: WrinkleTool, ground: Ground, settings: ToolsFile) -> Patch:
        key = (_bare(tool), ground, settings.up)
        found: Patch | None = self._patches.get(key)
        if found is None:
            (found,) = attach_tools([tool], ground.surface, ground.rest, ground.rig, up=settings.up)
            self._patches.put(key, found)
        return found

    def _known(self, ground: Ground, patches: Sequence[Patch], settings: ToolsFile) -> Cluster | None:
        """Patches that were planned together before."""
        found: Cluster | None = self._clusters.get(_key(ground, patches, settings))
        return found

    def _planned(
        self, ground: Ground, patches: Sequence[Patch], settings: ToolsFile, problems: dict[str, str]
    ) -> Iterator[Cluster]:
        """Tools that lie together, planned; where they cannot be, without those that are at fault by themselves."""
        try:
            yield self._cluster(ground, patches, settings)
        except WrinkleError as error:
            fitting = []
            for patch in patches if len(patches) > 1 else ():
                try:
                    self._cluster(ground, [patch], settings)
                    fitting.append(patch)
                except WrinkleError as alone:
                    problems[patch.tool.name] = alone.lines[0]
            if fitting and len(fitting) < len(patches):
                yield from self._planned(ground, fitting, settings, problems)
            else:
                problems |= dict.fromkeys((each.tool.name for each in patches), error.lines[0])

    def _cluster(self, ground: Ground, patches: Sequence[Patch], settings: ToolsFile) -> Cluster:
        found = self._known(ground, patches, settings)
        if found is None:
            plan = plan_on(ground, patches, settings, _MAX_ERROR)
            found = self._clusters.put(_key(ground, patches, settings), Cluster.of(plan))
        return found

    def _carried_again(
        self, ground: Ground, patches: Sequence[Patch], before: Laid, settings: ToolsFile, problems: dict[str, str]
    ) -> Iterator[Cluster]:
        """Tools on what was refined for those of their names before; others on the mesh as it is."""
        waiting = {patch.tool.name: patch for patch in patches}
        for mesh in before.meshes:
            for cluster in mesh.clusters if mesh.ground is ground else ():
                again = []
                for carried in cluster.plan.carried_patches:
                    patch = waiting.pop(carried.patch.tool.name, None)
                    try:
                        if patch is not None:
                            same = patch is carried.patch
                            again.append(carried if same else carry(patch, cluster.plan.fine, ground.contacts))
                    except WrinkleError as error:
                        problems[carried.patch.tool.name] = error.lines[0]
                if again:
                    yield Cluster.of(replace(cluster.plan, carried_patches=tuple(again)), cluster.skin)
        coarse = replace(settings, refinement=replace(settings.refinement, max_levels=0))
        for patch in waiting.values():
            yield from self._planned(ground, [patch], coarse, problems)

    def _mesh(self, ground: Ground, clusters: tuple[Cluster, ...]) -> LaidMesh:
        key = (ground, clusters)
        found: LaidMesh | None = self._meshes.get(key)
        if found is None:
            taken, apart = np.zeros(len(ground.surface.triangles), bool), []
            for cluster in clusters:
                apart.append(cluster.apart_from(taken))
                taken[cluster.parents] = True
            found = self._meshes.put(key, LaidMesh(ground, self._skin(ground), tuple(apart), self.played))
        return found

    def _skin(self, ground: Ground) -> Skin:
        """The vertices of a coarse mesh, ready to be posed."""
        found: Skin | None = self._skins.get(ground.rig.node)
        if found is None:
            surface, acting = ground.surface, distinct_values(ground.surface.joints)
            weights = surface.dense_weights(np.arange(len(surface.positions)), len(ground.rig.joints))
            found = prepare(weights[:, acting], surface.positions, surface.morph_deltas)
            self._skins.put(ground.rig.node, found)
        return found


def _key(ground: Ground, patches: Sequence[Patch], settings: ToolsFile) -> tuple[object, ...]:
    return (tuple(_bare(each.tool) for each in patches), ground, settings.refinement, settings.up)


def _bare(tool: WrinkleTool) -> WrinkleTool:
    """A tool without its places in the file, which any edit above it moves."""
    return replace(tool, where="", places={})


def _quick(tool: WrinkleTool) -> WrinkleTool:
    """A tool without what takes too long to be shown while it is edited."""
    return replace(tool, contact=None)


def _groups_of(ground: Ground, patches: Sequence[Patch]) -> list[list[Patch]]:
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
