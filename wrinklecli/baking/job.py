"""The job of a bake: its options, and an asset read with its clips, and with the tools of each mesh."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from wrinklecli.baking.original import original
from wrinklecli.baking.parts import PARTS
from wrinklecli.character.clip import Clip, chosen_clips
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.scene import deforms, none_deforms
from wrinklecli.choices import Engine, FrameFormat, Mode, Storage, Tracks
from wrinklecli.drive.drive import is_baked, wrinkle_entry
from wrinklecli.errors import BakeError, ConfigError, counted, listed, nearest, unknown
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.images import files_of
from wrinklecli.gltf.joined_mesh import JoinedMesh, joined
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.memory import MAX_MEMORY, MAX_VERTICES, Memory
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.fields import Field
from wrinklecli.tools.read import load_merged
from wrinklecli.tools.records import ONE_PERCENT, EffectTool, Length, ToolsFile, WrinkleTool

ToolsPaths: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]

# Shapes of a region of flesh in a draft: the fewest.
_DRAFTED_SHAPES = 3


@dataclass(frozen=True, slots=True)
class BakeOptions:
    """Options of `bake`, besides what the tools file says.

    Attributes:
        mode: `morph` keeps the skin and adds morph targets; `frames` writes posed geometry for each frame; `weights`
            adds morph targets that move nothing, whose weights are those of wrinkle maps.
        anims: Files with more clips, for joints of the same names; OUT gets these clips too.
        clips: Names of the clips to bake; if empty, those of the tools file.
        only: Names of the tools to bake; if empty, all.
        fps: Overrides `sampling.fps`.
        max_error: Greatest distance of the file from the method: a length, or per cent of the tallest wrinkle.
        max_levels: Overrides `refinement.max_levels`.
        edges_per_interval: Overrides `refinement.edges_per_interval`.
        max_vertices: Most vertices that refinement may add to a mesh.
        accessors: The storage of morph targets: `dense` for readers that cannot take sparse accessors, `based` for
            those that need zeros below them; see `gltf.edited_document`.
        tracks: `none` writes targets and extras without weight tracks.
        frames_dir: Also write a file for each frame into this folder.
        frames_format: The format of these files.
        allow_external: Read buffers and images outside the asset's folder too.
        max_memory: Most bytes that reading the asset may take.
        morph_tangents: Also write TANGENT targets, where the base has TANGENT.
        engine: Keep morph targets within the limits of this engine; see `baking.budget`.
        strict: Refuse to write if there are warnings.
        replace: If the asset is the output of an earlier bake, bake the asset of that bake; see `baking.original`.
        details: Measure residuals of normals and curve lengths for the report, which takes longer.
        draft: Bake for a quick look: refine one level less, without contact and proof, and with flesh in three shapes.
            The file says that it is a draft.
        jobs: Processes that resolve contact. The file does not depend on their number.
        split: Divide meshes into nodes of faces that the same morph targets move, without the other targets.
    """

    mode: Mode = "morph"
    anims: Sequence[str | os.PathLike[str]] = ()
    clips: Sequence[str] = ()
    only: Sequence[str] = ()
    fps: float | None = None
    max_error: Length = ONE_PERCENT
    max_levels: int | None = None
    edges_per_interval: int | None = None
    max_vertices: int = MAX_VERTICES
    accessors: Storage = "sparse"
    tracks: Tracks = "all"
    frames_dir: str | os.PathLike[str] | None = None
    frames_format: FrameFormat = "obj"
    allow_external: bool = False
    max_memory: int = MAX_MEMORY
    morph_tangents: bool = False
    engine: Engine | None = None
    strict: bool = False
    replace: bool = False
    details: bool = False
    draft: bool = False
    jobs: int = 1
    split: bool = False


@dataclass(frozen=True, slots=True)
class Job:
    """An asset and its tools, read: `bake` and `check` begin with this record.

    Attributes:
        settings: The tools file with the options that override it.
        asset: The asset as it was read, without the wrinkles of an earlier bake if these are to be replaced.
        document: The asset with the clips of other files, and of its range of motion.
        inputs: Every file that was read, as typed or joined to the asset's folder.
        beside: All files of asset and anims, read or not: nothing may be written over them.
        every_clip: The clips of the document.
        clips: The clips to bake.
        by_node: The tools of each node that has a mesh, sorted by node.
        joined: By their first nodes the meshes that are one in the document, and several in the asset.
        pose: Name of the clip that is the pose asked for, if any.
        range: Names of the clips that are the asset's range of motion.
        notes: A line for each motion that was made, for each part of the anims that was left out or renamed, and for
            contact that is left out of a draft.
        warnings: A line for each tool that is left out, each unknown clip that an optional tool names, and each anim
            without clips.
    """

    options: BakeOptions
    settings: ToolsFile
    asset: Document
    document: Document
    inputs: tuple[str, ...]
    beside: tuple[str, ...]
    every_clip: tuple[Clip, ...]
    clips: tuple[Clip, ...]
    by_node: dict[int, list[EffectTool]]
    joined: dict[int, JoinedMesh]
    pose: str | None
    range: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def read_job(
    asset: str | os.PathLike[str] | Document,
    tools: ToolsPaths,
    options: BakeOptions,
    motions: Motions | None = None,
) -> Job:
    """Read an asset and its tools, and find each tool's mesh.

    `motions` are further motions of the asset. If None, they are the anims of the options.

    Raises:
        WrinkleError: Asset or tools are at fault, or they do not go together.
    """
    settings = _overridden(load_merged(tools_paths(tools), external=options.allow_external), options)
    document = asset if isinstance(asset, Document) else _read(asset, options)
    if options.replace:
        from wrinklecli.baking.baked_body import lost_record  # other bakes look for no earlier one

        if lost := lost_record(document):
            ways = "bake from the original asset, or without --replace if these targets are the asset's own"
            raise BakeError(f"{lost}; {ways}", where=document.path)
        document = original(document)
    settings, notes = _simplified(settings, options)
    job = job_of(document, settings, options, motions or Motions(anims=options.anims, range_of_motion=False))
    return replace(job, notes=(*job.notes, *notes))


def _simplified(settings: ToolsFile, options: BakeOptions) -> tuple[ToolsFile, list[str]]:
    """The tools of a draft, or those whose maps need no geometry, and a line about each that is left out or changed.

    Raises:
        BakeError: No tool is left.
    """
    if options.mode != "weights" and not options.draft:
        return settings, []
    notes = []
    if options.mode == "weights":
        for tool in settings.effects:
            if tool not in settings.on_skin:
                notes.append(f"{tool.name}: left out, as it moves the body; maps hold wrinkles alone")
            elif isinstance(tool, WrinkleTool) and tool.attachment == "patch":
                notes.append(f"{tool.name}: left out, as attachment: patch has other wrinkles in each frame")
            else:
                continue
            settings = settings.only([each.name for each in settings.effects if each != tool])
        if not settings.effects:
            raise BakeError("has no wrinkling tool and no field that maps could show", where=settings.path)
    # Fields fade where they would cross, which maps can show.
    bare = settings.on_skin if options.draft else settings.tools
    if asked := [each.name for each in bare if each != each.without_contact]:
        why = "as in every draft" if options.draft else "as it moves the mesh"
        notes.append(f"{', '.join(asked)}: contact is left out, {why}")
    effects = [each.without_contact if each in bare else each for each in settings.effects]
    if options.draft:
        effects = [replace(each, shapes=_DRAFTED_SHAPES) if isinstance(each, Flesh) else each for each in effects]
    return replace(settings, effects=tuple(effects)), notes


def tools_paths(tools: ToolsPaths) -> Sequence[str | os.PathLike[str]]:
    """The paths of one tools file or several."""
    return (tools,) if isinstance(tools, str | os.PathLike) else tools


def _read(asset: str | os.PathLike[str], options: BakeOptions) -> Document:
    return read_document(asset, allow_external=options.allow_external, memory=Memory(options.max_memory))


def job_of(asset: Document, settings: ToolsFile, options: BakeOptions, motions: Motions) -> Job:
    """Join an asset with its tools and its motions.

    Raises:
        WrinkleError: They do not go together.
    """
    by_node, left_out = tools_by_node(asset, settings)
    whole, by_node, meshes = _joined(asset, settings, by_node)
    played = moved(whole, list(by_node), motions)
    document = played.document
    every_clip = played.clips
    asked = played.chosen(options.clips)
    sampled = () if asked or settings.sampling.clips == "all" else settings.sampling.clips
    nameable = tuple(clip for clip in every_clip if clip.name not in (*played.range, played.pose))
    vain_clips = check_clip_names(settings, sampled, nameable)
    return Job(
        options=options,
        settings=settings,
        asset=asset,
        document=document,
        inputs=(document.files[0], settings.path, *settings.merged_paths, *document.files[1:], *settings.files_beside),
        beside=(*files_of(asset), *played.beside),
        every_clip=every_clip,
        clips=chosen_clips(every_clip, sampled or asked, where=document.path),
        by_node=by_node,
        joined=meshes,
        pose=played.pose,
        range=played.range,
        notes=played.notes,
        warnings=(*played.warnings, *vain_clips, *left_out),
    )


def tools_by_node(document: Document, settings: ToolsFile) -> tuple[dict[int, list[EffectTool]], list[str]]:
    """Find each tool's mesh.

    Returns:
        The tools of each node that has a mesh, sorted by node, and a warning for each tool that is left out.

    Raises:
        BakeError: Tools have no mesh, or meshes are wrinkled already, a line for each; or no tool remains.
    """
    nodes, names = document.items("nodes"), MeshNames.of(document)
    found: dict[int, list[EffectTool]] = {}
    warnings: list[str] = []
    problems: list[BakeError] = []
    places: dict[str, list[str]] = {}
    for tool in settings.effects:
        why = why_left_out(tool, document, names)
        if why is not None:
            warnings.append(f"{tool.name}: left out, as {why}")
        else:
            try:
                node = _nodes_of(tool, document, names)[0]
                tool = _by_own_names(tool, names)
                found.setdefault(node, []).append(tool)
                # A region, once for each mesh that moves with it.
                every = (
                    [replace(tool, node=each, carrier=node) for each in tool.meshes] if isinstance(tool, Flesh) else []
                )
                for over in every:
                    if (why := why_left_out(over, document, names)) is not None:
                        warnings.append(f"{tool.name}: a mesh is left out, as {why}")
                        continue
                    other = _node_of(over, document, names, "meshes")
                    if other == node:
                        message = f"{over.node!r} is the mesh of the region itself; name meshes over it"
                        raise BakeError(message, where=tool.place("meshes"))
                    found.setdefault(other, []).append(over)
            except BakeError as error:
                places.setdefault(str(error.args[0]), []).append(error.places[0])
    for fault, (place, *others) in places.items():
        # A fault of many tools is one line, with the place of the first.
        count = len(set(others) - {place})
        more = f"; the same holds for {counted(count, 'more tool')}" if count else ""
        problems.append(BakeError(f"{fault}{more}", where=place))
    for index in filter(lambda node: is_baked(nodes[node]), found):
        message = "already carries wrinkles of an earlier bake; bake from the original asset, or use --replace"
        problems.append(BakeError(message, where=document.where("nodes", index, "extras", "wrinkle")))
    if problems:
        raise BakeError.of_all(problems)
    if not found:
        raise BakeError("no tool is left: those that there are, are absent or of strength 0", where=settings.path)
    return dict(sorted(found.items())), warnings


def _parts_of(node: Json) -> list[str]:
    """Names of the nodes that an earlier bake has split from a node."""
    parts = wrinkle_entry(node).get(PARTS)
    return [name for name in parts if isinstance(name, str)] if isinstance(parts, list) else []


def why_left_out(tool: EffectTool, document: Document, names: MeshNames) -> str | None:
    """The reason why a bake would go on without a tool; None if it would not."""
    if tool.idle:
        return "its strength is 0 in every clip"
    if tool.optional and tool.node is not None and not any(map(names.called, _named(tool))):
        return f"there is no node {listed(_named(tool))}"
    joints = tool.joints if tool.optional and isinstance(tool, Field) else "all"
    if joints != "all" and not set(joints) & {node.get("name") for node in document.items("nodes")}:
        return f"there is no node {listed(joints)}"
    return None


def _named(tool: EffectTool) -> list[str]:
    """The names of its nodes that a tool has."""
    return [] if tool.node is None else [tool.node, *(tool.beside if isinstance(tool, Field) else ())]


def _nodes_of(tool: EffectTool, document: Document, names: MeshNames) -> list[int]:
    """The nodes whose meshes a tool wrinkles, without those that are absent if it is optional.

    Raises:
        BakeError: They are not there.
    """
    if not isinstance(tool, Field) or not tool.beside:
        return [_node_of(tool, document, names)]
    wanted = [name for name in _named(tool) if not tool.optional or names.called(name)]
    return list(dict.fromkeys(_node_of(replace(tool, node=name), document, names) for name in wanted))


def _joined(
    document: Document, settings: ToolsFile, by_node: Mapping[int, list[EffectTool]]
) -> tuple[Document, dict[int, list[EffectTool]], dict[int, JoinedMesh]]:
    """Let the meshes of each field with several nodes be one: the document, the tools by nodes, and these meshes.

    Raises:
        WrinkleError: They cannot be.
    """
    names = MeshNames.of(document)
    groups: list[set[int]] = []
    for tool in settings.effects:
        if isinstance(tool, Field) and tool.beside and why_left_out(tool, document, names) is None:
            group = {*_nodes_of(tool, document, names)}
            # Fields that share a mesh are on one surface.
            group = group.union(*(each for each in groups if each & group))
            groups = [*(each for each in groups if not each & group), group]
    meshes: dict[int, JoinedMesh] = {}
    for group in groups:
        if len(group) > 1:
            document, mesh = joined(document, sorted(group))
            meshes[mesh.nodes[0]] = mesh
    found: dict[int, list[EffectTool]] = {}
    firsts = {node: first for first, mesh in meshes.items() for node in mesh.nodes}
    for node, tools in by_node.items():
        found.setdefault(firsts.get(node, node), []).extend(tools)
    return document, dict(sorted(found.items())), meshes


def _by_own_names(tool: EffectTool, names: MeshNames) -> EffectTool:
    """A tool that calls nodes as `MeshNames.own` does, whatever the tools file calls them."""

    def own(name: str) -> str:
        nodes = names.called(name)
        return names.own[nodes[0]] if len(nodes) == 1 else name

    changes: dict[str, Any] = {} if tool.node is None else {"node": own(tool.node)}
    if isinstance(tool, Flesh):
        changes["meshes"] = tuple(map(own, tool.meshes))
    if isinstance(tool, WrinkleTool) and tool.contact is not None:
        changes["contact"] = replace(tool.contact, ignore=tuple(map(own, tool.contact.ignore)))
    return replace(tool, **changes)


def _node_of(tool: EffectTool, document: Document, names: MeshNames, key: str = "node") -> int:
    """The node whose mesh a tool wrinkles; `key` is the one that names it.

    Raises:
        BakeError: There is none, or more than one.
    """
    nodes = document.items("nodes")
    deforming = [index for index in names.own if deforms(document, index)]
    if tool.node is None:
        # Parts belong to the node that an earlier bake has split, which will be refused.
        parts = {name for index in deforming for name in _parts_of(nodes[index])}
        whole = [index for index in deforming if nodes[index].get("name") not in parts]
        if len(whole) == 1:
            return whole[0]
        if not deforming:
            raise BakeError(f"no mesh of the asset deforms: {none_deforms(document)}", where=document.path)
        several = listed(names.name_of(index) for index in deforming)
        raise BakeError(f"several meshes deform; say which, by node: one of {several}", where=tool.where)
    matches = names.called(tool.node)
    if len(matches) == 1 and matches[0] in deforming:
        return matches[0]
    if len(matches) == 1:
        fault = f"node {tool.node!r} has neither a skin nor morph targets: it does not deform"
    elif matches:
        several = listed(names.name_of(index) for index in matches)
        fault = f"{len(matches)} nodes with a mesh are meant by {tool.node!r}; say which: one of {several}"
    else:
        known = [names.name_of(index) for index in names.own]
        fault = f"node {tool.node!r} is no node with a mesh{nearest(tool.node, known)}; there are {listed(known)}"
    raise BakeError(fault, where=tool.place(key))


def _overridden(settings: ToolsFile, options: BakeOptions) -> ToolsFile:
    """The tools file with the options that override it."""
    names = [tool.name for tool in settings.effects]
    ConfigError.unless_known("no enabled tool is named", options.only, names, where=settings.path)
    chosen = settings.only(options.only) if options.only else settings
    if not chosen.effects:
        raise ConfigError("no tool is enabled", where=settings.path)
    sampling, refinement = settings.sampling, settings.refinement
    if options.fps is not None:
        sampling = replace(sampling, fps=options.fps)
    if options.max_levels is not None:
        refinement = replace(refinement, max_levels=options.max_levels)
    if options.edges_per_interval is not None:
        refinement = replace(refinement, edges_per_interval=options.edges_per_interval)
    if options.draft:
        # Edges twice as long need one level less.
        fewer, longer = max(refinement.max_levels - 1, 0), refinement.edges_per_interval / 2
        refinement = replace(refinement, max_levels=fewer, edges_per_interval=longer)
    return replace(chosen, sampling=sampling, refinement=refinement)


def check_clip_names(settings: ToolsFile, sampled: Sequence[str], clips: tuple[Clip, ...]) -> list[str]:
    """A warning for each clip that an optional tool names and the asset lacks.

    `sampled` are the names of the clips that the tools file says to bake.

    Raises:
        ConfigError: The asset lacks other clips that the file names, a line for each.
    """
    names = [clip.name for clip in clips]
    warnings: list[str] = []
    problems: dict[str, ConfigError] = {}  # by their lines: a key that several tools inherit gets one line

    def refuse(name: str, where: str) -> None:
        error = ConfigError(unknown("the asset has no clip", name, names), where=where)
        problems.setdefault(str(error), error)

    for name in sampled:
        if name not in names:
            refuse(name, settings.place("sampling", "clips"))
    for tool in settings.effects:
        for name, keys in tool.named_clips:
            if name not in names and tool.optional:
                warnings.append(unknown(f"{tool.name}: the asset has no clip", name, names))
            elif name not in names:
                refuse(name, tool.place(*keys))
    if problems:
        raise ConfigError.of_all(problems.values())
    return warnings
