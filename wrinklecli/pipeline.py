"""The whole bake: read, attach, refine, sample, encode, prove, write."""

import os
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from wrinklecli.config import Length, RestLengthKeys, ToolsFile, WrinkleTool, load_tools
from wrinklecli.deform import (
    Carrier,
    Shape,
    activity,
    carry,
    compress,
    displacements,
    make_shapes,
    shapes_of,
    weights_of,
)
from wrinklecli.document import Document, Draft, read_document
from wrinklecli.encode import METHOD, Target, encode_extras, encode_mesh, encode_track
from wrinklecli.errors import AssetError, BakeError, ConfigError, RefusedError, listed, nearest
from wrinklecli.frames import Frames, Motion, Progress, encode_frames, exported_frames
from wrinklecli.patch import Rest, attach_tools, rest_pose
from wrinklecli.pose import Clip, Rig, joint_matrices, morph_target_names, read_clips, read_rig
from wrinklecli.proof import Residual, compare, read_back
from wrinklecli.refine import Refinement, contacts_of, influence_count, refine
from wrinklecli.report import (
    VERSION,
    Report,
    describe_activity,
    describe_clip,
    describe_residual,
    warnings_of,
)
from wrinklecli.surface import read_surface
from wrinklecli.tracks import clip_grid, moving_nodes, pad, sample_times, widen

Floats = NDArray[np.float64]
Json = dict[str, Any]
Mode = Literal["morph", "frames"]

_DEFAULT_MAX_ERROR = Length(1.0, percent=True)
# Products of skinning round a few times; below this many units in the last place float32 sets the limit.
_FLOAT32_STEPS = 8
# Poses of a clip at which pruned skin weights are judged before the proof.
_POSES = 33
# Quarter points of an interval and the rest of the chain share the error bound.
_SAMPLING_SHARE = 0.5
_COMPRESSION_SHARE = 0.25
# A vector whose three coordinates are each off by 1 is off by this.
_PER_COORDINATE = 3.0**0.5


@dataclass(frozen=True, slots=True)
class Plan:
    """The tools on one node's mesh, attached and refined: everything but time.

    Attributes:
        rig: Of the node.
        rest: The rest pose.
        fine: The refined surface.
        carriers: Of each tool.
        tallest: Height of the tallest wrinkle that the tools can make, scene units.
        max_error: Scene units.
        scale: World over bind units, at rest.
        has_normals: Whether the mesh has NORMALs, so that shapes need them too.
    """

    rig: Rig
    rest: Rest
    fine: Refinement
    carriers: tuple[Carrier, ...]
    tallest: float
    max_error: float
    scale: float
    has_normals: bool


@dataclass(frozen=True, slots=True)
class Basis:
    """One tool's morph targets.

    Attributes:
        carrier: The tool.
        targets: One for each shape; None for a shape that never shows, which is not written.
        weights: For each sampled clip, (frames, shapes).
    """

    carrier: Carrier
    targets: tuple[Target | None, ...]
    weights: tuple[Floats, ...]

    @property
    def from_skin(self) -> bool:
        """Whether weights follow from the anchors' distance alone."""
        return self.carrier.patch.tool.attachment == "skin"

    def written(self, weights: Floats) -> Floats:
        """The columns of (frames, shapes) weights that have a target."""
        return weights[:, [index for index, target in enumerate(self.targets) if target is not None]]


def bake(
    asset: str | os.PathLike[str],
    tools: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    mode: Mode = "morph",
    clips: Sequence[str] = (),
    only: Sequence[str] = (),
    fps: float | None = None,
    max_error: Length = _DEFAULT_MAX_ERROR,
    max_levels: int | None = None,
    accessors: Literal["sparse", "dense"] = "sparse",
    tracks: Literal["all", "none"] = "all",
    frames_dir: str | os.PathLike[str] | None = None,
    frames_format: Literal["obj", "ply", "glb"] = "obj",
    strict: bool = False,
    details: bool = False,
    progress: Progress = lambda _stage, _done, _total: None,
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
        strict: Refuse to write where there are warnings.
        details: Measure residuals of normals and curve lengths for the report, which takes longer.
        progress: Called with a stage's name, steps done and steps in all.

    Returns:
        What was made and how exact it is.

    Raises:
        ConfigError: The tools file is at fault.
        AssetError: The asset is.
        BakeError: They do not go together, or OUT cannot be written.
        RefusedError: The error exceeds `max_error`, or `strict` and there are warnings. Nothing is written.
    """
    with ExitStack() as stack:
        # With several BLAS threads sums change their last bits, and so would the file.
        stack.enter_context(threadpool_limits(limits=1, user_api="blas"))
        settings = _settings(load_tools(tools), only, fps, max_levels)
        document = read_document(asset)
        inputs = [document.files[0], settings.path, *document.files[1:]]
        refuse_overwriting(inputs, [out] if out is not None else [])
        every_clip = read_clips(document)
        chosen = _chosen_clips(every_clip, settings, clips, document)
        warnings = _vain_clips(settings, every_clip)
        draft = Draft(document)
        fps_wanted = settings.sampling.fps
        baked: list[Baked] = []
        frames: list[Frames] = []
        for node, its_tools in _by_node(document, settings, warnings).items():
            plan = plan_mesh(document, node, its_tools, settings, every_clip, max_error)
            motions: list[Motion] = []
            bases: list[Basis] = []
            residuals: dict[str, Residual] = {}
            if frames_dir is not None or mode == "frames":
                bases, motions = sample_clips(plan, chosen, fps=fps_wanted, mode="frames", progress=progress)
                if not motions:
                    raise BakeError("has no clip: there is no frame to write", where=document.path)
                frames.append(Frames(plan.rig, plan.fine, _targets(bases), tuple(motions)))
            if mode == "morph" and out is not None:
                bases, motions = sample_clips(plan, chosen, fps=fps_wanted, mode="morph", progress=progress)
                _encode(draft, plan, bases, motions if tracks == "all" else (), sparse=accessors == "sparse")
                if tracks == "all":
                    residuals = _prove(draft, plan, bases, motions, details=details, progress=progress)
            baked.append(Baked(plan, bases, motions, residuals))
        report = _report(document, settings, mode, baked, warnings, details=details)
        report.inputs = [*inputs, *(draft.image_files(out) if out is not None else [])]
        if strict and report.warnings:
            raise RefusedError.of_all(RefusedError(line) for line in report.warnings)
        put_files = None
        if frames_dir is not None:
            put_files = stack.enter_context(exported_frames(document, frames, frames_dir, frames_format, progress))
        if out is not None:
            if mode == "frames":
                encode_frames(draft, frames, progress)
            report.bytes_written = draft.write(out)
        if put_files is not None:
            put_files()
        return report


@dataclass(frozen=True, slots=True)
class Baked:
    """All that was made of one node's mesh; residuals by clip."""

    plan: Plan
    bases: list[Basis]
    motions: list[Motion]
    residuals: dict[str, Residual]


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


def _chosen_clips(clips: tuple[Clip, ...], settings: ToolsFile, asked: Sequence[str], document: Document) -> list[Clip]:
    """The clips to bake: those asked for, else those of the tools file, else all."""
    wanted: Sequence[str] = asked
    if not asked and settings.sampling.clips != "all":
        wanted = settings.sampling.clips
    names = [clip.name for clip in clips]
    for name in wanted:
        if name not in names:
            raise AssetError(
                f"has no clip {name!r}{nearest(name, names)}; there are {listed(names)}", where=document.path
            )
    return [clip for clip in clips if not wanted or clip.name in wanted]


def _vain_clips(settings: ToolsFile, clips: tuple[Clip, ...]) -> list[str]:
    """A warning for each clip that a tool names and the asset lacks."""
    names = [clip.name for clip in clips]
    warnings = []
    for tool in settings.tools:
        keyed = tool.rest_length.keys if isinstance(tool.rest_length, RestLengthKeys) else {}
        warnings += [
            f"{tool.name}: the asset has no clip {name!r}{nearest(name, names)}; there are {listed(names)}"
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
                    "already carries wrinkles of an earlier bake; bake from the original asset",
                    where=document.where("nodes", index, "extras", "wrinkle"),
                )
            )
    if problems:
        raise BakeError.of_all(problems)
    if not found:
        raise BakeError("no tool is left: all of them are optional and absent", where=settings.path)
    return dict(sorted(found.items()))


def _deforms(document: Document, node: int) -> bool:
    carrier = document.items("nodes")[node]
    mesh = document.item("meshes", carrier["mesh"], user=document.where("nodes", node))
    return "skin" in carrier or bool(morph_target_names(mesh))


def plan_mesh(
    document: Document,
    node: int,
    tools: list[WrinkleTool],
    settings: ToolsFile,
    clips: tuple[Clip, ...],
    max_error: Length,
) -> Plan:
    """Attach tools to the mesh of a node and refine it: what depends on mesh and tools only.

    Raises:
        WrinkleError: Of all tools that do not fit, a line each.
    """
    rig = read_rig(document, node)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, tools)
    patches = attach_tools(tools, surface, rest, rig, settings, clips)
    contacts = contacts_of(document, rig, surface, rest, patches)
    tallest = max(
        abs(patch.shape_strength) * float(patch.curve.heights(patch.curve.greatest_amplitudes[None]).max(initial=0.0))
        for patch in patches
    )
    largest = float(np.abs(rest.positions).max())
    floor = _FLOAT32_STEPS * float(np.spacing(np.float32(largest)))
    bound = max(max_error.resolve(tallest), floor)
    fine = refine(
        surface,
        rest,
        patches,
        rig,
        settings=settings.refinement,
        contacts=contacts,
        influences=influence_count(document, rig),
        poses=_poses(rig, clips),
        tolerance=_SAMPLING_SHARE * bound,
    )
    carriers = tuple(carry(patch, fine, contacts) for patch in patches)
    scale = float(np.median(np.cbrt(np.abs(np.linalg.det(rest.blended[:, :, :3])))))
    return Plan(rig, rest, fine, carriers, tallest, bound, scale, _has_normals(document, rig.mesh))


def _poses(rig: Rig, clips: Sequence[Clip]) -> Floats:
    """(poses, joints, 4, 4) a few poses of every clip of the asset, whichever are baked."""
    poses = [joint_matrices(rig, clip, np.linspace(clip.start, clip.end, _POSES)) for clip in clips]
    return np.concatenate([joint_matrices(rig, None, np.zeros(1)), *poses])


def sample_clips(
    plan: Plan, clips: Sequence[Clip], *, fps: float, mode: Mode, progress: Progress
) -> tuple[list[Basis], list[Motion]]:
    """Run the tools over the clips that move their mesh.

    Args:
        plan: The tools.
        clips: To sample; `morph` leaves out those that do not move the mesh.
        fps: Of the grid.
        mode: `frames` takes the grid alone, `morph` what straight lines between keys need.
        progress: Called with a stage's name, clips done and clips in all.

    Returns:
        Each tool's shapes, and each clip's weights over all of them.
    """
    rig, rest, fine = plan.rig, plan.rest, plan.fine
    moving = moving_nodes(rig)
    driven = {name for each in plan.carriers for name in each.patch.keyed_clips}
    chosen = [
        clip
        for clip in clips
        if mode == "frames" or clip.name in driven or any(c.node in moving for c in clip.channels)
    ]
    times = []
    for number, clip in enumerate(chosen):

        def signal(at: Floats, clip: Clip = clip) -> Floats:
            return np.concatenate([_signal(plan, each, clip, at) for each in plan.carriers], axis=1)

        if mode == "frames":
            times.append(clip_grid(clip, None, fps=fps))
        else:
            tolerance = _SAMPLING_SHARE * plan.max_error / _overlaps(plan)
            times.append(sample_times(clip, rig, signal, fps=fps, tolerance=tolerance))
        progress("sampling", number + 1, len(chosen))
    bases: list[Basis] = []
    for carrier in plan.carriers:
        if carrier.patch.tool.attachment == "skin":
            shapes = shapes_of(carrier, fine, with_normals=plan.has_normals)
            weights = [_skin_weights(plan, carrier, clip, at) for clip, at in zip(chosen, times, strict=True)]
        else:
            series = [displacements(carrier, fine, rig, rest, clip, at) for clip, at in zip(chosen, times, strict=True)]
            shapes, weights = _compressed(plan, carrier, series)
        bases.append(Basis(carrier, tuple(_named(carrier, shapes)), tuple(weights)))
    motions = []
    for index, (clip, at) in enumerate(zip(chosen, times, strict=True)):
        columns = [basis.written(basis.weights[index]) for basis in bases]
        motions.append(Motion(clip, at, np.concatenate(columns, axis=1)))
    return bases, motions


def _overlaps(plan: Plan) -> int:
    """How many tools move one vertex at the most: there, their errors add up."""
    moved = np.concatenate([carrier.vertices for carrier in plan.carriers])
    return int(np.bincount(moved).max())


def _signal(plan: Plan, carrier: Carrier, clip: Clip, times: Floats) -> Floats:
    """(frames, values) what must be right between keys, scene units."""
    patch = carrier.patch
    if patch.tool.attachment == "patch":
        moved = displacements(carrier, plan.fine, plan.rig, plan.rest, clip, times)
        return _PER_COORDINATE * plan.scale * moved.reshape(len(times), -1)
    seen = activity(patch, plan.rig, plan.rest, clip, times)
    strength = patch.clip_strength(clip) * patch.shape_strength
    return strength * seen.amplitudes.reshape(len(times), -1)


def _skin_weights(plan: Plan, carrier: Carrier, clip: Clip | None, times: Floats) -> Floats:
    seen = activity(carrier.patch, plan.rig, plan.rest, clip, times)
    weights = weights_of(carrier.patch.curve, seen.amplitudes)
    return carrier.patch.clip_strength(clip) * weights.reshape(len(times), -1)


def _compressed(plan: Plan, carrier: Carrier, series: list[Floats]) -> tuple[list[Shape | None], list[Floats]]:
    """Shapes and weights of displacements that are new in each frame, all clips together."""
    if not series:
        return [], []
    together, deltas = compress(
        np.concatenate(series), _COMPRESSION_SHARE * plan.max_error / plan.scale / _PER_COORDINATE
    )
    weights = np.split(together, np.cumsum([len(each) for each in series])[:-1])
    rows = np.unique(np.concatenate([np.linspace(0, len(together) - 1, 16).astype(int), np.argmax(together, axis=0)]))
    shapes = make_shapes(
        plan.fine,
        carrier.vertices,
        deltas,
        tallest=plan.scale * np.sqrt(np.sum(deltas**2, axis=2)).max(axis=1, initial=0.0),
        samples=together[rows] if plan.has_normals else None,
    )
    return shapes, weights


def _targets(bases: Iterable[Basis]) -> tuple[Target, ...]:
    """The morph targets of all tools, in order."""
    return tuple(target for basis in bases for target in basis.targets if target is not None)


def _named(carrier: Carrier, shapes: Iterable[Shape | None]) -> Iterable[Target | None]:
    """Targets `wrinkle_TOOL_1`, `wrinkle_TOOL_2` … for the shapes that there are."""
    number = 0
    for shape in shapes:
        number += shape is not None
        yield None if shape is None else Target(f"wrinkle_{carrier.patch.tool.identifier}_{number}", shape)


def _encode(draft: Draft, plan: Plan, bases: list[Basis], motions: Sequence[Motion], *, sparse: bool) -> None:
    """Put meshes, targets, tracks and extras into the draft."""
    rig = plan.rig
    targets = _targets(bases)
    # In the stored pose nothing is wrinkled, unless the tools file names another pose as rest.
    known = np.zeros(len(targets))
    if all(each.from_skin for each in bases):
        stored = [each.written(_skin_weights(plan, each.carrier, None, np.zeros(1))) for each in bases]
        known = np.concatenate(stored, axis=1)[0]
    encode_mesh(draft, rig, plan.fine, targets, sparse=sparse, stored=known)
    encode_extras(
        draft,
        rig,
        [
            (each.carrier.patch, [None if target is None else target.name for target in each.targets])
            for each in bases
            if each.from_skin
        ],
    )
    baked = {motion.clip.index for motion in motions}
    for clip in read_clips(draft.source):
        channel = clip.channel(rig.node, "weights")
        if channel is not None and clip.index not in baked:
            # A channel drives all targets of its mesh, so a clip that is not baked is widened too.
            encode_track(draft, clip, rig.node, pad(channel, known))
    for motion in motions:
        channel = motion.clip.channel(rig.node, "weights")
        encode_track(draft, motion.clip, rig.node, widen(channel, rig, motion.clip, motion.times, motion.weights))


def _prove(
    draft: Draft,
    plan: Plan,
    bases: list[Basis],
    motions: Sequence[Motion],
    *,
    details: bool,
    progress: Progress,
) -> dict[str, Residual]:
    """Play the draft as an engine would and compare it with the method, clip by clip.

    Raises:
        RefusedError: A vertex is further off than the plan's bound.
    """
    carriers = [basis.carrier for basis in bases]
    proof = read_back(draft.document(), plan.rig.node, plan.fine, carriers)
    residuals = {}
    for number, motion in enumerate(motions):
        residual = compare(proof, motion, plan.fine, carriers, plan.rig, plan.rest, with_normals=details)
        if residual.position > plan.max_error:
            share = 100 * residual.position / plan.tallest
            raise RefusedError(
                f"the file would be off by {residual.position:.3g} ({share:.2g} % of the tallest wrinkle) at"
                f" {residual.time:.3g} s; --max-error allows {plan.max_error:.3g}",
                where=motion.clip.name,
            )
        residuals[motion.clip.name] = residual
        progress("proof", number + 1, len(motions))
    return residuals


def _has_normals(document: Document, mesh: int) -> bool:
    return any("NORMAL" in each.get("attributes", {}) for each in document.items("meshes")[mesh]["primitives"])


def refuse_overwriting(inputs: Sequence[str], outputs: Sequence[str | os.PathLike[str]]) -> None:
    """Check that no output is an input, by whatever name.

    Raises:
        BakeError: One is.
    """
    known = {os.path.realpath(path) for path in inputs}
    for path in outputs:
        if os.path.realpath(path) in known:
            raise BakeError("is an input too and would be overwritten", where=os.fspath(path))


def _report(
    document: Document,
    settings: ToolsFile,
    mode: Mode,
    baked: Sequence[Baked],
    warnings: list[str],
    *,
    details: bool,
) -> Report:
    """Gather what was made; frame by frame only with `details`."""
    clips: dict[str, Json] = {}
    meshes, tools = [], []
    for each in baked:
        plan, rig = each.plan, each.plan.rig
        split = plan.fine.subdivision
        meshes.append(
            {
                "node": rig.names[rig.node],
                "coarse_vertices": len(plan.fine.surface.weld),
                "vertices": len(plan.fine.weld),
                "coarse_triangles": len(plan.fine.surface.triangles),
                "triangles": len(plan.fine.triangles),
                "levels": split.levels,
                "edges_at_max_levels": split.limited,
                "edges_blocked": split.blocked,
                "vertices_pruned": plan.fine.pruned_count,
                "max_error": plan.max_error,
                "tallest_wrinkle": plan.tallest,
            }
        )
        if split.limited:
            warnings.append(
                f"{rig.names[rig.node]}: {split.limited} edges are still too long for the wrinkles at max_levels"
                f" {settings.refinement.max_levels}"
            )
        for motion in each.motions:
            if rig.morph_names and motion.clip.channel(rig.node, "weights") is None and mode == "morph":
                warnings.append(
                    f"{rig.names[rig.node]}: {motion.clip.name} gets a weights channel, which will hold the morph"
                    " targets that were free there; --tracks none avoids it"
                )
            entry = clips.setdefault(motion.clip.name, describe_clip(motion.clip, motion.times))
            if motion.clip.name in each.residuals:
                entry["residual"] = describe_residual(each.residuals[motion.clip.name])
        for basis in each.bases:
            patch = basis.carrier.patch
            seen = [
                (motion.clip, motion.times, activity(patch, rig, plan.rest, motion.clip, motion.times))
                for motion in each.motions
            ]
            warnings += warnings_of(patch, seen)
            if basis.carrier.stuck:
                warnings.append(f"{patch.tool.name}: {basis.carrier.stuck} vertices stay put: singular at rest")
            tools.append(
                {
                    "name": patch.tool.name,
                    "node": rig.names[rig.node],
                    "rest_length": patch.rest_length,
                    "anchor_distances": [patch.origin.distance, patch.target.distance],
                    "moved_vertices": len(basis.carrier.vertices),
                    "stuck_vertices": basis.carrier.stuck,
                    "targets": [target.name for target in basis.targets if target is not None],
                }
            )
            if details:
                for clip, _, what in seen:
                    strength = patch.tool.clips.get(clip.name, patch.tool.strength)
                    clips[clip.name]["tools"].append(describe_activity(patch, what, strength))
    return Report(
        data={
            "report": VERSION,
            "method": METHOD,
            "asset": document.path,
            "tools_file": settings.path,
            "mode": mode,
            "tallest_wrinkle": max(each.plan.tallest for each in baked),
            "meshes": meshes,
            "tools": tools,
            "clips": list(clips.values()),
            "warnings": warnings,
        },
        warnings=warnings,
    )
