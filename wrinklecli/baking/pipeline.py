"""The whole bake: read, attach, refine, sample, encode, prove, write."""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from typing import Literal

from wrinklecli.baking.budget import BUDGETS, Engine, fit_budget
from wrinklecli.baking.frame_files import exported_frames
from wrinklecli.baking.frames import Frames, encode_frames
from wrinklecli.baking.morphs import encode_morphs
from wrinklecli.baking.plan import MeshPlan, Mode, plan_mesh
from wrinklecli.baking.proof import Residual, prove
from wrinklecli.baking.report import Baked, Report, make_report
from wrinklecli.baking.sample import Motion, sample_clips
from wrinklecli.baking.targets import TargetSet, targets_of
from wrinklecli.baking.timings import StageClock, make_timings
from wrinklecli.character.clip import Clip, chosen_clips, no_clip, read_clips
from wrinklecli.character.rig import morph_target_names
from wrinklecli.errors import BakeError, ConfigError, RefusedError, WrinkleError, listed, nearest
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.original import original
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.writer import Draft
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.tools.read import load_tools
from wrinklecli.tools.records import Length, RestLengthKeys, ToolsFile, WrinkleTool

DEFAULT_MAX_ERROR = Length(1.0, percent=True)


@dataclass(frozen=True, slots=True)
class Job:
    """An asset and its tools, read: what `bake` and `check` begin with.

    Attributes:
        settings: The tools file with the command line's overrides.
        document: The asset; without the wrinkles of an earlier bake where these are to be replaced.
        inputs: Every file that was read, as typed or joined to the asset's folder.
        every_clip: Of the asset.
        clips: Those to bake.
        by_node: The tools of each node that carries a mesh, nodes rising.
        warnings: A line for each tool and clip that is named in vain.
    """

    settings: ToolsFile
    document: Document
    inputs: tuple[str, ...]
    every_clip: tuple[Clip, ...]
    clips: tuple[Clip, ...]
    by_node: dict[int, list[WrinkleTool]]
    warnings: tuple[str, ...]


def bake(
    asset: str | os.PathLike[str],
    tools: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    mode: Mode = "morph",
    clips: Sequence[str] = (),
    only: Sequence[str] = (),
    fps: float | None = None,
    max_error: Length = DEFAULT_MAX_ERROR,
    max_levels: int | None = None,
    accessors: Literal["sparse", "dense"] = "sparse",
    tracks: Literal["all", "none"] = "all",
    frames_dir: str | os.PathLike[str] | None = None,
    frames_format: Literal["obj", "ply", "glb"] = "obj",
    allow_external: bool = False,
    morph_tangents: bool = False,
    engine: Engine | None = None,
    strict: bool = False,
    replace: bool = False,
    details: bool = False,
    progress: Progress = no_progress,
) -> Report:
    """Bake wrinkles into an animated asset.

    Args:
        asset: The .gltf or .glb to read.
        tools: The YAML file of tools.
        out: The .gltf or .glb to write; may be left out where `frames_dir` is given.
        mode: `morph` keeps the skin and adds morph targets; `frames` writes posed geometry for each frame.
        clips: Names of the clips to bake; those of the tools file where left out.
        only: Names of the tools to bake; all where left out.
        fps: Overrides `sampling.fps`.
        max_error: Largest distance of the file from the method, of the tallest wrinkle where in per cent.
        max_levels: Overrides `refinement.max_levels`.
        accessors: `dense` for readers that cannot take sparse accessors.
        tracks: `none` writes targets and extras without weight tracks.
        frames_dir: Also write a file for each frame into this folder.
        frames_format: Of those files.
        allow_external: Read buffers and images outside the asset's folder too.
        morph_tangents: Also write TANGENT targets, where the base has TANGENT.
        engine: Hold morph targets to what this one plays: three, unity, or spec8 (eight at a time).
        strict: Refuse to write where there are warnings.
        replace: Bake the asset that an earlier bake was made from, where ASSET is that bake's output; see `restore`.
        details: Measure residuals of normals and curve lengths for the report, which takes longer.
        progress: Called with a stage's name, steps done and steps in all.

    Returns:
        What was made, how exact it is, and what it took.

    Raises:
        ConfigError: The tools file is at fault.
        AssetError: The asset is.
        BakeError: They do not go together, or OUT cannot be written.
        RefusedError: The error exceeds `max_error`, a limit of the engine cannot be held, or `strict` and there
            are warnings. Nothing is written.
    """
    clock = StageClock()
    with ExitStack() as stack:
        stack.enter_context(guarded(os.fspath(asset)))
        job = read_job(
            asset,
            tools,
            clips=clips,
            only=only,
            fps=fps,
            max_levels=max_levels,
            allow_external=allow_external,
            replace=replace,
        )
        refuse_overwriting(job.inputs, [out] if out is not None else [])
        clock.ends("read")
        document, settings, warnings = job.document, job.settings, list(job.warnings)
        draft = Draft(document)
        fps_wanted = settings.sampling.fps
        baked: list[Baked] = []
        frames: list[Frames] = []
        budgets: list[Json] = []
        influences = BUDGETS[engine].influences if engine is not None else None
        plans = plan_meshes(job, max_error, influences=influences)
        clock.ends("plan")
        for plan in plans:
            motions: list[Motion] = []
            target_sets: list[TargetSet] = []
            residuals: dict[str, Residual] = {}
            if frames_dir is not None or mode == "frames":
                target_sets, motions = sample_clips(plan, job.clips, fps=fps_wanted, mode="frames", progress=progress)
                if not motions:
                    raise BakeError("has no clip: there is no frame to write", where=document.path)
                frames.append(Frames(plan.rig, plan.fine, targets_of(target_sets), tuple(motions)))
                clock.ends("sample")
            if mode == "morph" and out is not None:
                target_sets, motions = sample_clips(plan, job.clips, fps=fps_wanted, mode="morph", progress=progress)
                clock.ends("sample")
                if engine is not None:
                    target_sets, motions, budget = fit_budget(
                        document, plan, target_sets, motions, job.every_clip, engine
                    )
                    budgets.append(budget)
                    clock.ends("budget")
                tracked = motions if tracks == "all" else ()
                encode_morphs(draft, plan, target_sets, tracked, sparse=accessors == "sparse", tangents=morph_tangents)
                clock.ends("encode")
                if tracks == "all":
                    residuals = prove(draft, plan, target_sets, motions, details=details, progress=progress)
                    clock.ends("prove")
            baked.append(Baked(plan, target_sets, motions, residuals))
        report = make_report(document, settings, mode, baked, warnings, details=details)
        if engine is not None:
            report.data["engine"] = {"name": engine, "limits": asdict(BUDGETS[engine]), "meshes": budgets}
        report.inputs = [*job.inputs, *(draft.image_files(out) if out is not None else [])]
        if strict and report.warnings:
            raise RefusedError.of_all(RefusedError(line) for line in report.warnings)
        clock.ends("report")
        put_files = None
        if frames_dir is not None:
            put_files = stack.enter_context(exported_frames(document, frames, frames_dir, frames_format, progress))
            clock.ends("export")
        if out is not None and mode == "frames":
            encode_frames(draft, frames, progress)
            clock.ends("encode")
        if put_files is not None:
            put_files()  # taken back where OUT fails
            clock.ends("export")
        if out is not None:
            report.bytes_written = draft.write(out)
            clock.ends("write")
        written = report.bytes_written if out is not None else None
        report.timings = make_timings(clock, document, baked, fps=fps_wanted, bytes_written=written)
        return report


def read_job(
    asset: str | os.PathLike[str],
    tools: str | os.PathLike[str],
    *,
    clips: Sequence[str] = (),
    only: Sequence[str] = (),
    fps: float | None = None,
    max_levels: int | None = None,
    allow_external: bool = False,
    replace: bool = False,
) -> Job:
    """Read an asset and its tools, and find each tool's mesh; arguments as of `bake`.

    Raises:
        WrinkleError: One of them is at fault, or they do not go together.
    """
    settings = _settings(load_tools(tools), only, fps, max_levels)
    document = read_document(asset, allow_external=allow_external)
    if replace:
        document = original(document)
    inputs = (document.files[0], settings.path, *document.files[1:])
    every_clip = read_clips(document)
    chosen = _chosen_clips(every_clip, settings, clips, document)
    warnings = _vain_clips(settings, every_clip)
    by_node = _by_node(document, settings, warnings)
    return Job(settings, document, inputs, every_clip, chosen, by_node, tuple(warnings))


def plan_meshes(job: Job, max_error: Length = DEFAULT_MAX_ERROR, *, influences: int | None = None) -> list[MeshPlan]:
    """Attach the tools of every mesh and refine it, as `plan_mesh` does.

    Raises:
        WrinkleError: Of all tools that do not fit, a line each.
    """
    plans: list[MeshPlan] = []
    problems: list[WrinkleError] = []
    for node, tools in job.by_node.items():
        try:
            plans.append(
                plan_mesh(job.document, node, tools, job.settings, job.every_clip, max_error, influences=influences)
            )
        except WrinkleError as error:
            problems.append(error)
    if problems:
        # What is wrong with the whole file is wrong with each mesh.
        raise problems[0] if len({str(each) for each in problems}) == 1 else BakeError.of_all(problems)
    return plans


def _settings(settings: ToolsFile, only: Sequence[str], fps: float | None, max_levels: int | None) -> ToolsFile:
    """The tools file with the command line's overrides."""
    names = [tool.name for tool in settings.tools]
    for name in only:
        if name not in names:
            raise ConfigError(
                f"no enabled tool is named {name!r}{nearest(name, names)}; there are {listed(names)}",
                where=settings.path,
            )
    tools = tuple(tool for tool in settings.tools if not only or tool.name in only)
    if not tools:
        raise ConfigError("no tool is enabled", where=settings.path)
    sampling, refinement = settings.sampling, settings.refinement
    if fps is not None:
        sampling = replace(sampling, fps=fps)
    if max_levels is not None:
        refinement = replace(refinement, max_levels=max_levels)
    return replace(settings, tools=tools, sampling=sampling, refinement=refinement)


def _chosen_clips(
    clips: tuple[Clip, ...], settings: ToolsFile, asked: Sequence[str], document: Document
) -> tuple[Clip, ...]:
    """The clips to bake: those asked for, else those of the tools file, else all."""
    wanted: Sequence[str] = asked
    if not asked and settings.sampling.clips != "all":
        wanted = settings.sampling.clips
    return chosen_clips(clips, wanted, where=document.path)


def _vain_clips(settings: ToolsFile, clips: tuple[Clip, ...]) -> list[str]:
    """A warning for each clip that a tool names and the asset lacks."""
    names = [clip.name for clip in clips]
    warnings = []
    for tool in settings.tools:
        keyed = tool.rest_length.keys if isinstance(tool.rest_length, RestLengthKeys) else {}
        warnings += [
            f"{tool.name}: the asset has {no_clip(name, names)}"
            for name in dict.fromkeys([*tool.clips, *keyed])
            if name not in names
        ]
    return warnings


def _by_node(document: Document, settings: ToolsFile, notes: list[str]) -> dict[int, list[WrinkleTool]]:
    """The tools of each node that carries a mesh, in the document's order of nodes."""
    nodes = document.items("nodes")
    names = [node.get("name") for node in nodes]
    carriers = [index for index, node in enumerate(nodes) if "mesh" in node]
    deforming = [index for index in carriers if _deforms(document, index)]
    found: dict[int, list[WrinkleTool]] = {}
    problems = []
    for tool in settings.tools:
        if not tool.strength and not any(tool.clips.values()):
            notes.append(f"{tool.name}: left out, as its strength is 0 in every clip")
            continue
        if tool.node is None:
            matches = deforming
            fault = "no mesh of the asset deforms: it has neither a skin nor morph targets"
            if len(deforming) > 1:
                several = listed(str(names[index]) for index in deforming)
                fault = f"several meshes deform; name one by `node`: {several}"
        else:
            matches = [index for index in carriers if names[index] == tool.node]
            options = [str(names[index]) for index in carriers]
            fault = (
                f"node {tool.node!r} is no node with a mesh{nearest(tool.node, options)}; there are {listed(options)}"
            )
            if len(matches) > 1:
                fault = f"{len(matches)} nodes with a mesh are named {tool.node!r}"
            elif matches and not _deforms(document, matches[0]):
                matches, fault = (
                    [],
                    f"node {tool.node!r} has neither a skin nor morph targets: it does not deform",
                )
            elif not matches and tool.optional:
                notes.append(f"{tool.name}: left out, as there is no node {tool.node!r}")
                continue
        if len(matches) != 1:
            problems.append(BakeError(fault, where=f"{tool.where}.node" if tool.node else document.path))
            continue
        found.setdefault(matches[0], []).append(tool)
    for index in found:
        extras = nodes[index].get("extras")
        if isinstance(extras, dict) and "wrinkle" in extras:
            problems.append(
                BakeError(
                    "already carries wrinkles of an earlier bake; bake from the original asset, or use --replace",
                    where=document.where("nodes", index, "extras", "wrinkle"),
                )
            )
    if problems:
        raise BakeError.of_all(problems)
    if not found:
        raise BakeError("no tool is left: those that there are, are absent or of strength 0", where=settings.path)
    return dict(sorted(found.items()))


def _deforms(document: Document, node: int) -> bool:
    carrier = document.items("nodes")[node]
    mesh = document.item("meshes", carrier["mesh"], user=document.where("nodes", node))
    return "skin" in carrier or bool(morph_target_names(mesh))


def refuse_overwriting(inputs: Sequence[str], outputs: Sequence[str | os.PathLike[str]]) -> None:
    """Check that no output is an input, by whatever name.

    Raises:
        BakeError: One is.
    """
    known = {os.path.realpath(path) for path in inputs}
    for path in outputs:
        if os.path.realpath(path) in known:
            raise BakeError("is an input too and would be overwritten", where=os.fspath(path))
