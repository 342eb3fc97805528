"""The effects of a mesh, planned: attached at rest, refined once, then layer by layer on the refined mesh."""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.rig import moving_nodes
from wrinklecli.character.surface import influence_count
from wrinklecli.choices import EFFECTS, MAX_LEVELS
from wrinklecli.effects.attached import AnyAttached, Attached
from wrinklecli.effects.effect import EffectKind, MeshPlan, Part, ToolType
from wrinklecli.errors import BakeError, WrinkleError, listed
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, determinants, median
from wrinklecli.numeric.memory import MAX_VERTICES
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.refine import Refinement, refine
from wrinklecli.tools.records import EffectTool, Length, ToolsFile

# Units in the last place by which products of skinning are rounded in float32: no error can be held below.
_FLOAT32_STEPS = 8
# Part of the error bound for pruned skin weights. Weights between keys get the rest: see `effects.sampling`.
_PRUNING_SHARE = 0.5


@cache
def kind_of(section: str) -> EffectKind[EffectTool, AnyAttached]:
    """The kind whose effects stand in a section."""
    folder, _ = EFFECTS[section]
    kind: EffectKind[EffectTool, AnyAttached] = import_module(f"wrinklecli.effects.{folder}.layer").KIND
    return kind


def kinds_of(tools: Iterable[EffectTool]) -> dict[str, EffectKind[EffectTool, AnyAttached]]:
    """The kinds of effects that act for some tools, in their order, by their sections."""
    sections = {section for tool in tools for section in tool.sections}
    return {section: kind_of(section) for section in EFFECTS if section in sections}


def plan_mesh(
    document: Document,
    node: int,
    tools: Sequence[EffectTool],
    settings: ToolsFile,
    clips: tuple[Clip, ...],
    max_error: Length,
    *,
    influences: int | None = None,
    max_vertices: int = MAX_VERTICES,
    neighbours: Neighbours | None = None,
    stored: bool = True,
) -> MeshPlan:
    """Attach tools to the mesh of a node and refine it: the part of a bake that depends on mesh and tools only.

    Args:
        document: The asset.
        node: The node with the mesh.
        tools: The tools on the mesh.
        settings: The tools file.
        clips: All clips of the asset, whether they are baked or not.
        max_error: A length, or per cent of the largest move that the effects can make.
        influences: Most joints of a new vertex; by default as many as the asset's sets of joints can hold.
        max_vertices: Most vertices that refinement may add.
        neighbours: The neighbours in the document, if several meshes are planned.
        stored: False if no file has to hold the new vertices: they may have any joints then.

    Raises:
        WrinkleError: Tools do not fit, a line for each.
    """
    ground = read_ground(document, node, tools, settings, clips, neighbours=neighbours)
    ground, attached = attach_effects(ground, tools, settings)
    return plan_on(
        ground, attached, settings, max_error, influences=influences, max_vertices=max_vertices, stored=stored
    )


def attach_effects(
    ground: Ground, tools: Sequence[EffectTool], settings: ToolsFile
) -> tuple[Ground, Sequence[AnyAttached]]:
    """Attach tools kind by kind; each kind sees the mesh as those before it move it.

    Returns:
        The mesh as the effects below the skin move it, and all attached tools.

    Raises:
        WrinkleError: Tools do not fit, a line for each.
    """
    attached: list[AnyAttached] = []
    problems: list[WrinkleError] = []
    for section, kind in kinds_of(tools).items():
        try:
            own = kind.bound(kind.attach([each for each in tools if each.section == section], ground, settings), ground)
        except WrinkleError as error:
            problems.append(error)
            continue
        attached += own
        ground = moved_by(ground, own)
    if problems:
        raise BakeError.of_all(problems)
    return ground, attached


def moved_by(ground: Ground, attached: Sequence[AnyAttached]) -> Ground:
    """The mesh as attached effects below the skin move it; others do not."""
    moves = [moved for each in attached if (moved := each.moves) is not None]
    if not moves:
        return ground
    return ground.moved_by([each.drive for each in moves], np.concatenate([each.deltas for each in moves]))


def attach_one(
    tool: ToolType, ground: Ground, settings: ToolsFile | None = None, *, bounded: bool = True
) -> Attached[ToolType]:
    """Attach one tool to a mesh as the effects before it have moved it; by default with the settings of an empty file.

    If it is not `bounded`, it reaches over features of the surface.

    Raises:
        WrinkleError: It does not fit.
    """
    settings = settings or ToolsFile(path=ground.document.path)
    kind = kind_of(tool.sections[0])
    attached = kind.attach([tool], ground, settings)
    (one,) = kind.bound(attached, ground) if bounded else attached
    return one


def sketch(
    attached: AnyAttached, region: int, fine: Refinement, pinned: Bools, before: Part | None = None
) -> Part | None:
    """Let a refined surface carry a tool quickly, as `EffectKind.sketch` does."""
    return kind_of(attached.tool.sections[0]).sketch(attached, region, fine, pinned, before)


def skin_parts(plan: MeshPlan) -> list[Part]:
    """The effects that move the skin of a refined mesh after those below it, whose moves the rig has."""
    return [part for part in plan.parts if part.attached.moves is None]


def patch_parts(plan: MeshPlan) -> list[Part]:
    """The parts that lie on patches and measure a segment: tools, but no fields."""
    return [part for part in skin_parts(plan) if part.attached.segment is not None]


def outlined_parts(plan: MeshPlan) -> list[Part]:
    """The parts that move the body below the skin: muscles, flesh and touches."""
    return [part for part in plan.parts if part.attached.moves is not None]


def plan_on(
    ground: Ground,
    attached: Sequence[AnyAttached],
    settings: ToolsFile,
    max_error: Length,
    *,
    influences: int | None = None,
    max_vertices: int = MAX_VERTICES,
    stored: bool = True,
    carried: bool = True,
) -> MeshPlan:
    """Plan tools that are attached already, as `plan_mesh` does; the surface is only refined if it is not `carried`."""
    document, rig, rest = ground.document, ground.rig, ground.rest
    tallest = min(
        max(each.greatest_height for each in attached if type(each) is kind)
        for kind in {type(each) for each in attached}
    )
    # The error of posed positions from float32 alone: no bound can be held below it.
    least = _FLOAT32_STEPS * float(np.spacing(np.float32(np.abs(rest.positions).max())))
    bound = max(max_error.resolve(tallest), least)
    # A new vertex is mixed from three of the asset's.
    most = influence_count(document, rig) * (1 if stored else 3)
    fine = refine(
        ground.surface,
        rest,
        [region for each in attached for region in each.regions],
        rig,
        settings=settings.refinement,
        contacts=ground.contacts.held,
        influences=min(most, influences or sys.maxsize),
        poses=ground.poses,
        tolerance=_PRUNING_SHARE * bound,
        max_vertices=max_vertices,
    )
    fine = _with_moves(fine, attached, rig.morph_names)
    plan = MeshPlan(
        rig=rig,
        rest=rest,
        fine=fine,
        layers=(),
        tallest=tallest,
        max_error=bound,
        scale=float(median(np.cbrt(np.abs(determinants(rest.blended[:, :, :3]))))),
        has_normals=any(
            "NORMAL" in each.get("attributes", {}) for each in document.items("meshes")[rig.mesh]["primitives"]
        ),
        copies=tuple(rig.names[node] for node in ground.contacts.copies),
        unread=tuple(ground.contacts.unread.values()),
    )
    return carry(plan, ground, attached) if carried else plan


def carry(plan: MeshPlan, ground: Ground, attached: Sequence[AnyAttached]) -> MeshPlan:
    """Let a refined surface carry the effects for which it is refined, kind by kind."""
    firsts = np.cumsum([0, *(len(each.regions) for each in attached)]).tolist()
    numbered = list(zip(firsts, attached, strict=False))
    for section, kind in kinds_of(each.tool for each in attached).items():
        own = [(number, each) for number, each in numbered if each.tool.section == section]
        plan = replace(plan, layers=(*plan.layers, kind.plan(plan, ground, own)))
    return plan


def _with_moves(fine: Refinement, attached: Sequence[AnyAttached], names: Sequence[str]) -> Refinement:
    """The refined surface with deltas of effects that find them there, by the names of targets, not interpolated."""
    moves = [moved for each in attached if (moved := each.moves) is not None]
    deltas = fine.morph_deltas
    for each in moves:
        if each.refined is not None:
            deltas = deltas.copy() if deltas is fine.morph_deltas else deltas
            deltas[[names.index(name) for name in each.drive.targets]] = each.refined(fine)
    return replace(fine, morph_deltas=deltas)


def mesh_warnings(plan: MeshPlan, settings: ToolsFile, clips: Sequence[Clip]) -> list[str]:
    """Warnings about a mesh with all its effects, for clips that are baked."""
    where = plan.rig.node_name
    warnings = [
        f"{where}: {name} counts as a copy of it, as most vertices of one are at those of the other: it holds no"
        " wrinkles down, and has only those of its own tools"
        for name in plan.copies
    ]
    warnings += [f"{line}: this mesh holds no wrinkles of {where} down" for line in plan.unread]
    warnings += [line for layer in plan.layers for line in layer.warnings(plan, clips)]
    moving, rig = moving_nodes(plan.rig), plan.rig
    moved = {channel.node for clip in clips for channel in clip.channels if channel.path != "weights"}
    fixed = [rig.names[node] for node in sorted(moved & moving) if "matrix" in rig.locals[node]]
    if fixed:
        warnings.append(
            f"{where}: clips cannot move {listed(fixed)}: a node with a matrix is not animated (glTF 2.0); export"
            " translation, rotation and scale in its place"
        )
    if plan.fine.subdivision.limited:
        warnings.append(
            f"{where}: {plan.fine.subdivision.limited} edges are still too long for the wrinkles at max_levels"
            f" {settings.refinement.max_levels} (a key of `refinement`): one more level, of {MAX_LEVELS} at most,"
            " halves them, and fewer or longer bumps need none so short"
        )
    return warnings


def track_warnings(plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
    """Warnings about clips that get a track of weights: before 0 s, or on a mesh whose own targets they left alone."""
    rig, where = plan.rig, plan.rig.node_name
    early = [
        f"{where}: {clip.name} has keys before 0 s, where players begin: its weights are written from 0 s on"
        for clip in clips
        if clip.early
    ]
    return early + [
        f"{where}: {clip.name} gets a weights channel, which will hold the morph targets that were free there;"
        " --tracks none avoids it"
        for clip in clips
        if rig.own.morph_names and clip.channel(rig.node, "weights") is None
    ]
