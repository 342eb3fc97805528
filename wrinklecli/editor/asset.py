"""An asset to which tools can be attached, one by one or in overlapping groups.

Tools are attached, refined and carried by the functions of a bake. Only overlapping tools are planned together, and
finished plans are kept, so that an edit costs the time of the tools that it touches. While someone drags, changed tools
are carried on the triangles that are there, and refined later.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from wrinklecli.baking.job import check_clip_names, tools_by_node, why_left_out
from wrinklecli.baking.original import original, wrinkled
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.joined import with_free_nodes
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.rig import DrivenTargets
from wrinklecli.character.scene import deforming_nodes, none_deforms, scene_nodes
from wrinklecli.character.skin import Skin, prepare
from wrinklecli.editor.attached import AttachedBelow, AttachedTool, AttachedTools, Cluster, PlayableMesh
from wrinklecli.editor.clip_cache import ClipCache, RecentResults
from wrinklecli.effects.attached import AnyAttached, Moves
from wrinklecli.effects.plan import attach_one, kind_of, plan_on, sketch
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.arrays import Ints, components, distinct_values, flags_of
from wrinklecli.numeric.memory import MAX_MEMORY, Memory
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.tools.fields import Field
from wrinklecli.tools.records import EffectTool, Length, ToolsFile

_MAX_ERROR = Length(1.0, percent=True)  # the default of a bake
_RINGS = 4  # rings of triangles around a tool that its refinement may read or split; tools whose rings meet overlap
# Numbers of results that are kept for undone steps, beside those in use:
_KEPT_PATCHES = 256  # they are small
_KEPT_PLANS = 24  # a plan may take 10 MB
_KEPT_MESHES = 8  # those of the last steps


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options for reading an asset.

    Attributes:
        anims: Files with more clips.
        range_of_motion: Also move an asset with clips through its range of motion.
        presets: Files of presets that the tools file shall name.
        allow_external: Read buffers and images outside the asset's folder, and presets outside that of the tools.
        max_memory: Bytes that reading may take.
    """

    anims: Sequence[str | os.PathLike[str]] = ()
    range_of_motion: bool = False
    presets: Sequence[str | os.PathLike[str]] = ()
    allow_external: bool = False
    max_memory: int = MAX_MEMORY


class LoadedAsset:
    """An asset with all its clips, to which tools can be attached. Several threads may use it.

    `range_clips` names the clips that are a range of motion; `notes` are lines about the asset's motions.
    """

    def __init__(
        self,
        document: Document,
        clips: Sequence[Clip],
        range_clips: frozenset[str] = frozenset(),
        notes: Sequence[str] = (),
    ) -> None:
        self.document, self.clips, self.range_clips, self.notes = document, tuple(clips), range_clips, tuple(notes)
        self.cache = ClipCache()
        self._neighbours = Neighbours(document)
        self._nodes = [node for node in scene_nodes(document) if "mesh" in document.items("nodes")[node]]
        self._grounds = RecentResults(4 * len(self._nodes))
        self._skins = RecentResults(len(self._nodes))
        self._attached = RecentResults(_KEPT_PATCHES)
        self._patches = RecentResults(_KEPT_PATCHES)
        self._clusters = RecentResults(_KEPT_PLANS)
        self._meshes = RecentResults(len(self._nodes) + _KEPT_MESHES)

    @classmethod
    def read(cls, asset: str, options: ReadOptions) -> "LoadedAsset":
        """Read an asset, the clips of other files and its range of motion; joints without keys can be posed.

        Raises:
            WrinkleError: A file is at fault.
        """
        memory = Memory(options.max_memory)
        document, notes = _unbaked(read_document(asset, allow_external=options.allow_external, memory=memory))
        motions, deforming = Motions(options.anims, options.range_of_motion or None), deforming_nodes(document)
        if not deforming:
            notes = (*notes, f"{asset}: no mesh deforms: {none_deforms(document)}")
        joined = moved(document, deforming, motions)
        joints = {joint for skin in joined.document.items("skins") for joint in skin.get("joints", [])}
        document = with_free_nodes(joined.document, joints)  # for the free pose
        return cls(document, joined.clips, frozenset(joined.range), (*notes, *joined.notes, *joined.warnings))

    def attach(self, settings: ToolsFile, before: AttachedTools | None = None) -> AttachedTools:
        """Attach the tools of a file; a tool that does not fit gets the message of a bake as its problem.

        Args:
            settings: Tools file.
            before: Earlier result. If given, changed tools are carried on the triangles that were refined for them
                before, and new tools on the coarse mesh, to save time.

        Raises:
            WrinkleError: The asset is at fault, or the file beside its tools.
        """
        self._patches.count = _KEPT_PATCHES + len(settings.on_skin)
        self._clusters.count = _KEPT_PLANS + len(settings.on_skin)
        problems: dict[str, str] = {}
        by_node = self._by_node(settings.on_skin, settings, problems)
        below = self._by_node([each for each in settings.effects if each not in settings.on_skin], settings, problems)
        meshes, tools, provisional = [], {}, False
        attached_below: dict[str, AttachedBelow] = {}
        for node in self._nodes:
            ground = self._ground(node, settings, by_node.get(node, []))
            ground, driven, here = self._moved(ground, below.get(node, []), settings, problems)
            attached_below = here | attached_below  # of a region on several meshes, that of the first
            patches: list[AnyAttached] = []
            for tool in by_node.get(node, []):
                with _noting(problems, tool.name):
                    patches.append(self._patch(tool, ground, settings))
            groups = _overlapping(ground, [*patches, *(each.attached for each in here.values())])
            clusters: list[Cluster] = []
            if before is not None:
                planned = [self._clusters.get(_key(ground, group, settings)) is not None for group in groups]
                waiting = [patch for group, known in zip(groups, planned, strict=True) if not known for patch in group]
                groups = [group for group, known in zip(groups, planned, strict=True) if known]
                clusters += self._carried_again(ground, waiting, before, settings, problems)
                provisional |= bool(waiting)
            for group in groups:
                clusters += self._planned(ground, group, settings, problems)
            for cluster in clusters:
                for part in cluster.parts:
                    tools[part.attached.tool.name] = AttachedTool(driven, cluster.plan, part)
            meshes.append(self._mesh(ground, driven, tuple(clusters)))
        return AttachedTools(tuple(meshes), tools, attached_below, problems, provisional)

    def _by_node(
        self, effects: Sequence[EffectTool], settings: ToolsFile, problems: dict[str, str]
    ) -> dict[int, list[EffectTool]]:
        """Find the nodes of some effects, and add the problems of those that a bake refuses or leaves out."""
        by_node: dict[int, list[EffectTool]] = {}
        file_clips = tuple(clip for clip in self.clips if clip.name not in self.range_clips)
        for effect in effects:
            why = why_left_out(effect, self.document, MeshNames.of(self.document))
            if why is not None:
                problems[effect.name] = f"{effect.name}: is left out, as {why}"
                continue
            with _noting(problems, effect.name):
                alone = settings.only([effect.name])
                check_clip_names(alone, (), file_clips)
                # A region of flesh may move several meshes.
                for node, found in tools_by_node(self.document, alone)[0].items():
                    # Contact takes too long to be shown while a tool is edited.
                    by_node.setdefault(node, []).extend(each.without_contact for each in found)
        return by_node

    def _moved(
        self, ground: Ground, effects: Sequence[EffectTool], settings: ToolsFile, problems: dict[str, str]
    ) -> tuple[Ground, Ground, dict[str, AttachedBelow]]:
        """Let the effects below its skin that fit move a mesh.

        Returns:
            The mesh with their morph targets, the same with their drives as they are edited, and the effects by name.
            The first is the same object until shapes change, so that all that is on the mesh may stay.
        """
        fitting: dict[str, AnyAttached] = {}
        moving: list[Moves] = []
        drives: list[DrivenTargets] = []
        for effect in effects:
            with _noting(problems, effect.name):
                attached = self._below(effect, ground, settings)
                moves = attached.moves
                assert moves is not None, "effects below the skin move the body"
                fitting[effect.name] = attached
                moving.append(moves)
                drives.append(moves.drive if moves.tuned is None else moves.tuned(effect))
        if not fitting:
            return ground, ground, {}
        every = tuple(fitting.values())
        moved: Ground = self._grounds.get_or_make(
            (ground, every),
            lambda: ground.moved_by([each.drive for each in moving], np.concatenate([each.deltas for each in moving])),
        )
        tuned = tuple(tuple(getattr(each, key) for key in getattr(each, "DRIVING", ())) for each in effects)
        own = ground.rig.driven_by(drives)
        driven: Ground = self._grounds.get_or_make((moved, tuned), lambda: replace(moved, rig=own))
        found, first = {}, len(ground.rig.morph_names)
        for (name, each), moves in zip(fitting.items(), moving, strict=True):
            columns = np.arange(first, first + len(moves.drive.targets))
            found[name] = AttachedBelow(driven, columns, each.span, each)
            first = int(columns[-1]) + 1
        return moved, driven, found

    def _below(self, effect: EffectTool, ground: Ground, settings: ToolsFile) -> AnyAttached:
        """Attach an effect below the skin; one that differs by its drive alone is the same."""
        same: dict[str, Any] = dict.fromkeys(getattr(effect, "DRIVING", ()), 0.0)
        plain = replace(effect, where="", places={}, **same)
        return self._attached.get_or_make((ground, plain), lambda: attach_one(effect, ground, settings))

    def _ground(self, node: int, settings: ToolsFile, tools: list[EffectTool]) -> Ground:
        bound_to = _without_places(tools[0]) if settings.rest == "bind" and tools else None
        key = (node, settings.rest, bound_to)
        if settings.rest == "bind" and not tools:
            settings = replace(settings, rest="stored")
        return self._grounds.get_or_make(
            key, lambda: read_ground(self.document, node, tools, settings, self.clips, neighbours=self._neighbours)
        )

    def _patch(self, tool: EffectTool, ground: Ground, settings: ToolsFile) -> AnyAttached:
        plain = _without_places(tool)
        if not isinstance(plain, Field):
            return self._patches.get_or_make((plain, ground, settings.up), lambda: attach_one(tool, ground, settings))
        # Strengths change the drive of a field alone.
        whole = replace(plain, strength=1.0, clips={})
        measured = self._patches.get_or_make((whole, ground), lambda: attach_one(tool, ground, settings))
        return self._patches.get_or_make((plain, measured), lambda: kind_of("fields").driven_by(measured, plain))

    def _planned(
        self, ground: Ground, patches: Sequence[AnyAttached], settings: ToolsFile, problems: dict[str, str]
    ) -> Iterator[Cluster]:
        """Plan overlapping tools; if that fails, plan those that can be planned alone."""
        try:
            yield self._cluster(ground, patches, settings)
        except WrinkleError as error:
            fitting = []
            for patch in patches if len(patches) > 1 else ():
                with _noting(problems, patch.tool.name):
                    self._cluster(ground, [patch], settings)
                    fitting.append(patch)
            if fitting and len(fitting) < len(patches):
                yield from self._planned(ground, fitting, settings, problems)
            else:
                problems |= dict.fromkeys((each.tool.name for each in patches), error.lines[0])

    def _cluster(self, ground: Ground, patches: Sequence[AnyAttached], settings: ToolsFile) -> Cluster:
        return self._clusters.get_or_make(
            _key(ground, patches, settings), lambda: Cluster.from_plan(plan_on(ground, patches, settings, _MAX_ERROR))
        )

    def _carried_again(
        self,
        ground: Ground,
        patches: Sequence[AnyAttached],
        before: AttachedTools,
        settings: ToolsFile,
        problems: dict[str, str],
    ) -> Iterator[Cluster]:
        """Carry tools on the triangles that were refined for tools of the same names, and new tools on the mesh.

        Effects below the skin need no triangles of their own.
        """
        waiting = {patch.tool.name: patch for patch in patches if patch.moves is None}
        for mesh in before.meshes:
            for cluster in mesh.clusters if mesh.ground is ground else ():
                again = []
                for part in cluster.parts:
                    patch = waiting.pop(part.attached.tool.name, None)
                    if patch is part.attached:
                        again.append(part)
                    elif patch is not None:
                        with _noting(problems, patch.tool.name):
                            made = sketch(patch, part.region, cluster.plan.fine, ground.contacts.held, part)
                            again += [] if made is None else [made]
                if again:
                    yield cluster.with_parts(again)
        coarse = replace(settings, refinement=replace(settings.refinement, max_levels=0))
        for patch in waiting.values():
            yield from self._planned(ground, [patch], coarse, problems)

    def _mesh(self, ground: Ground, driven: Ground, clusters: tuple[Cluster, ...]) -> PlayableMesh:
        def made() -> PlayableMesh:
            taken, apart = np.zeros(len(ground.surface.triangles), bool), []
            for cluster in clusters:
                apart.append(cluster.without(taken))
                taken[cluster.parents] = True
            return PlayableMesh(ground, driven, self._skin(ground, clusters), tuple(apart), self.cache)

        return self._meshes.get_or_make((driven, clusters), made)

    def _skin(self, ground: Ground, clusters: Sequence[Cluster]) -> Skin:
        """Prepare the coarse vertices to be posed."""

        def made() -> Skin:
            surface, acting = ground.surface, distinct_values(ground.surface.joints)
            count = len(surface.positions)
            influences = surface.influences(len(ground.rig.joints)).among(acting)
            deltas = surface.morph_deltas.copy() if ground.rig.drives else surface.morph_deltas
            for cluster in clusters if ground.rig.drives else ():
                # Effects below the skin move it by the normals of the refined surface.
                refined = cluster.plan.fine.morph_deltas[:, :count]
                other = refined != surface.morph_deltas
                deltas[other] = refined[other]
            return prepare(influences, surface.positions, deltas)

        # Rest poses share the skin, unless effects below it move it too.
        return self._skins.get_or_make((ground, *clusters) if ground.rig.drives else ground.rig.node, made)


@contextmanager
def _noting(problems: dict[str, str], name: str) -> Iterator[None]:
    """Add an error in the block as the problem of a tool."""
    try:
        yield
    except WrinkleError as error:
        problems[name] = error.lines[0]


def _key(ground: Ground, patches: Sequence[AnyAttached], settings: ToolsFile) -> tuple[object, ...]:
    tools = tuple(_without_places(each.tool) if each.moves is None else each for each in patches)
    return (tools, ground, settings.refinement, settings.up)


def _without_places(tool: EffectTool) -> EffectTool:
    """Forget a tool's places in the file, which change with any edit above it."""
    return replace(tool, where="", places={})


def _overlapping(ground: Ground, effects: Sequence[AnyAttached]) -> list[list[AnyAttached]]:
    """Group effects with regions, so that the refinement for one group reads nothing of another."""
    count = len(ground.surface.triangles)
    split = [each for each in effects if each.regions]
    members = [distinct_values(np.concatenate([region.members for region in each.regions])) for each in split]
    near = [flags_of(_around(ground, each), count) for each in members]
    links = [(i, j) for i, j in combinations(range(len(near)), 2) if (near[i] & near[j]).any()]
    groups: dict[int, list[AnyAttached]] = {}
    for each, group in zip(split, components(np.array(links, np.intp).reshape(-1, 2), len(near)), strict=True):
        groups.setdefault(int(group), []).append(each)
    return list(groups.values())


def _around(ground: Ground, triangles: Ints) -> Ints:
    """Add the rings of triangles around some (triangles,) of a mesh."""
    for _ in range(_RINGS):
        triangles = ground.rest.around.faces_of(distinct_values(ground.surface.triangles[triangles]))
    return triangles


def _unbaked(document: Document) -> tuple[Document, tuple[str, ...]]:
    """Restore the original of a baked asset, and say so; if that fails, each tool has a problem that says why."""
    if not wrinkled(document.gltf):
        return document, ()
    try:
        note = f"{document.path}: is the output of a bake: its original is shown, and baked anew"
        return original(document), (note,)
    except BakeError as error:
        return document, error.lines
