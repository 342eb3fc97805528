"""An asset on which tools are laid: each attached and refined by itself, or with those that it lies together with.

The functions of a bake attach, refine and carry the tools. Those that lie together are planned together; what others
have is kept, so an edit takes the time of the tools that it touches. In a hurry these are carried anew on the triangles
that are there, and refined later.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.baking.job import check_clip_names, tools_by_node, why_left_out
from wrinklecli.baking.original import original, wrinkled
from wrinklecli.baking.plan import Ground, plan_on, read_ground
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.joined import with_free_nodes
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.scene import deforming_nodes, scene_nodes
from wrinklecli.character.skin import Skin, prepare
from wrinklecli.editor.attached import AttachedTool, AttachedTools, Cluster, PlayableMesh
from wrinklecli.editor.clip_cache import ClipCache, RecentResults
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.effects.wrinkle.carry import carry
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.arrays import Bools, Ints, distinct_values, flags_of
from wrinklecli.numeric.memory import MAX_MEMORY, Memory
from wrinklecli.tools.records import Length, ToolsFile, WrinkleTool

# Of a bake, as long as no option says otherwise.
_MAX_ERROR = Length(1.0, percent=True)
# Rings of triangles around a tool's members that its refinement may read or split: tools whose rings meet are planned
# together.
_RINGS = 4
# Kept for undone steps: patches and plans beside one for each tool, meshes beside one for each node. A plan may take
# 10 MB.
_PATCHES, _PLANS, _MESHES = 256, 24, 8


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How an asset is read.

    Attributes:
        anims: Files with more clips.
        range_of_motion: Whether it is moved through that too, though it has clips.
        allow_external: Whether buffers and images outside the asset's folder are read.
        max_memory: Bytes that reading may take.
    """

    anims: tuple[str, ...] = ()
    range_of_motion: bool = False
    allow_external: bool = False
    max_memory: int = MAX_MEMORY


class LoadedAsset:
    """An asset on which tools are laid. Several threads may ask.

    Args:
        document: With all clips.
        clips: Of it.
        made: Names of those that are a range of motion.
        notes: What was made of its motions, a line each.
    """

    def __init__(
        self,
        document: Document,
        clips: Sequence[Clip],
        made: frozenset[str] = frozenset(),
        notes: Sequence[str] = (),
    ) -> None:
        self.document, self.clips, self.made, self.notes = document, tuple(clips), made, tuple(notes)
        self.played = ClipCache()
        self._neighbours = Neighbours(document)
        self._nodes = [node for node in scene_nodes(document) if "mesh" in document.items("nodes")[node]]
        self._grounds, self._skins = RecentResults(2 * len(self._nodes)), RecentResults(len(self._nodes))
        self._patches, self._clusters, self._meshes = (
            RecentResults(_PATCHES),
            RecentResults(_PLANS),
            RecentResults(len(self._nodes) + _MESHES),
        )

    @classmethod
    def read(cls, asset: str, reading: ReadOptions) -> "LoadedAsset":
        """An asset with its clips, those of other files and of its range of motion; joints without keys move freely.

        Raises:
            WrinkleError: It is at fault.
        """
        memory = Memory(reading.max_memory)
        document, notes = _unbaked(read_document(asset, allow_external=reading.allow_external, memory=memory))
        motions = Motions(reading.anims, reading.range_of_motion or None)
        joined = moved(document, deforming_nodes(document), motions)
        joints = {joint for skin in joined.document.items("skins") for joint in skin.get("joints", [])}
        document = with_free_nodes(joined.document, joints)  # for the free pose
        return cls(document, joined.clips, frozenset(joined.range), (*notes, *joined.notes, *joined.warnings))

    def laid(self, settings: ToolsFile, before: AttachedTools | None = None) -> AttachedTools:
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
                known = [self._clusters.get(_key(ground, group, settings)) is not None for group in groups]
                waiting = [patch for group, there in zip(groups, known, strict=True) if not there for patch in group]
                groups = [group for group, there in zip(groups, known, strict=True) if there]
                clusters += self._carried_again(ground, waiting, before, settings, problems)
                hurried |= bool(waiting)
            for group in groups:
                clusters += self._planned(ground, group, settings, problems)
            for cluster in clusters:
                for carried in cluster.plan.carried_patches:
                    tools[carried.patch.tool.name] = AttachedTool(ground, cluster.plan, carried)
            meshes.append(self._mesh(ground, tuple(clusters)))
        return AttachedTools(tuple(meshes), tools, problems, hurried)

    def _ground(self, node: int, settings: ToolsFile, tools: list[WrinkleTool]) -> Ground:
        bound_to = _bare(tools[0]) if settings.rest == "bind" and tools else None
        key = (node, settings.rest, bound_to)
        if settings.rest == "bind" and not tools:
            settings = replace(settings, rest="stored")
        return self._grounds.of(
            key, lambda: read_ground(self.document, node, tools, settings, self.clips, neighbours=self._neighbours)
        )

    def _patch(self, tool: WrinkleTool, ground: Ground, settings: ToolsFile) -> Patch:
        return self._patches.of(
            (_bare(tool), ground, settings.up),
            lambda: attach_tools([tool], ground.surface, ground.rest, ground.rig, up=settings.up)[0],
        )

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
        return self._clusters.of(
            _key(ground, patches, settings), lambda: Cluster.of(plan_on(ground, patches, settings, _MAX_ERROR))
        )

    def _carried_again(
        self,
        ground: Ground,
        patches: Sequence[Patch],
        before: AttachedTools,
        settings: ToolsFile,
        problems: dict[str, str],
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
                    yield Cluster.of(replace(cluster.plan, carried_patches=tuple(again)), cluster)
        coarse = replace(settings, refinement=replace(settings.refinement, max_levels=0))
        for patch in waiting.values():
            yield from self._planned(ground, [patch], coarse, problems)

    def _mesh(self, ground: Ground, clusters: tuple[Cluster, ...]) -> PlayableMesh:
        def made() -> PlayableMesh:
            taken, apart = np.zeros(len(ground.surface.triangles), bool), []
            for cluster in clusters:
                apart.append(cluster.apart_from(taken))
                taken[cluster.parents] = True
            return PlayableMesh(ground, self._skin(ground), tuple(apart), self.played)

        return self._meshes.of((ground, clusters), made)

    def _skin(self, ground: Ground) -> Skin:
        """The vertices of a coarse mesh, ready to be posed."""

        def made() -> Skin:
            surface, acting = ground.surface, distinct_values(ground.surface.joints)
            weights = surface.dense_weights(np.arange(len(surface.positions)), len(ground.rig.joints))
            return prepare(weights[:, acting], surface.positions, surface.morph_deltas)

        return self._skins.of(ground.rig.node, made)


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


def _unbaked(document: Document) -> tuple[Document, tuple[str, ...]]:
    """What an asset was before wrinkles were baked into it, and notes; of one that cannot be restored, tools tell."""
    if not wrinkled(document.gltf):
        return document, ()
    try:
        note = f"{document.path}: is the output of a bake: its original is shown, and baked anew"
        return original(document), (note,)
    except BakeError as error:
        return document, error.lines
