"""The whole bake: read, attach and refine, sample, encode, prove, report, write."""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from wrinklecli.baking.budget import BUDGETS, fit_budget, storage
from wrinklecli.baking.estimate import refuse_too_much
from wrinklecli.baking.job import BakeOptions, Job, ToolsPaths, read_job, tools_paths
from wrinklecli.baking.morphs import encode_morphs, own_target_bytes
from wrinklecli.baking.original import seal
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.baking.proof import prove
from wrinklecli.baking.report import BakedMesh, Report, make_report
from wrinklecli.baking.split import split_meshes, weighed
from wrinklecli.baking.timings import StageClock, make_timings
from wrinklecli.choices import Mode
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, SamplingOptions
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.errors import BakeError, log_findings, refuse_warnings
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.images import image_files
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.guard import Progress, guarded, log_progress


def bake(
    asset: str | os.PathLike[str],
    tools: ToolsPaths,
    out: str | os.PathLike[str] | None = None,
    options: BakeOptions | None = None,
    *,
    outputs: Outputs | None = None,
    progress: Progress = log_progress,
    **named: Any,
) -> Report:
    """Bake wrinkles into an animated asset.

    Args:
        asset: The .gltf or .glb to read.
        tools: The YAML file of tools, or several that are merged.
        out: The .gltf or .glb to write; may be None if `frames_dir` is given.
        options: The defaults of `BakeOptions` if None.
        outputs: OUT and the frames are added to these. If None, they are committed before returning.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `BakeOptions`, in place of those in `options`.

    Raises:
        ConfigError: The tools file is at fault.
        AssetError: The asset is at fault.
        BakeError: Asset and tools do not go together, or OUT cannot be written.
        TypeError: `BakeOptions` lacks a name of `named`.
        RefusedError: The error exceeds `max_error`, a limit of the engine cannot be held, or there are warnings and
            `strict` is set. Nothing is written.

    Examples:
        >>> from wrinklecli import bake
        >>> report = bake("samples/wrist.glb", "configs/wrist.yaml", "wrinkled.glb", clips=["flex"], fps=24)
        >>> [tool["targets"] for tool in report.data["tools"]][0]
        ['wrinkle_palm_side_1']
    """
    options = replace(options or BakeOptions(), **named)
    if options.split and options.mode != "morph":
        message = f"split keeps morph targets from what they do not move; mode {options.mode} writes none that move any"
        raise BakeError(message, where=os.fspath(asset))
    clock = StageClock()
    with part_of(outputs) as added, guarded(os.fspath(asset)):
        if out is not None:
            added.claim(out)
        added.protect([asset, *tools_paths(tools), *options.anims])
        with clock.stage("read"):
            job = read_job(asset, tools, options)
            added.protect([*job.inputs, *job.beside])
        with clock.stage("plan"):
            plans = plan_meshes(job, influences=BUDGETS[options.engine].influences if options.engine else None)
            for plan in plans:
                refuse_too_much(job, plan, job.clips, None if out is None else os.fspath(out))
        run = _Run(job, clock, progress)
        edited = EditedDocument(job.document, storage=storage(options.engine, options.accessors))
        posed, morphed = [], []
        if options.mode == "frames" or options.frames_dir is not None:
            posed = [run.pose_frames(plan) for plan in plans]
        if options.mode != "frames" and out is not None:
            morphed = [run.add_morph_targets(edited, plan) for plan in plans]
            with clock.stage("encode"):
                if options.split or job.joined:
                    edited, morphed = split_meshes(edited, morphed, job.joined, asked=options.split)
                elif options.mode == "morph":
                    morphed = [weighed(edited, mesh) for mesh in morphed]
        # If nothing is to be written, the report describes the plans alone.
        baked = morphed or posed or [BakedMesh(plan) for plan in plans]
        with clock.stage("report"):
            images = image_files(job.document, out) if out is not None else []
            report = make_report(job, baked, images=images, tracks=bool(morphed) and options.tracks == "all")
            log_findings(report.warnings, report.notes, where=os.fspath(asset))
            if options.strict:
                refuse_warnings(report.warnings, where=os.fspath(asset))
        written = run.write(edited, posed, out, added)
        timings = make_timings(clock, job, baked, bytes_written=written)
        return replace(report, bytes_written=written or 0, timings=timings)


@dataclass(frozen=True, slots=True)
class _Run:
    """A bake that runs: its job, its clock and its progress, which all steps share."""

    job: Job
    clock: StageClock
    progress: Progress

    def pose_frames(self, plan: MeshPlan) -> BakedMesh:
        """Sample a mesh's clips at each frame."""
        effects, motions = self._sample(plan, self._sampling("frames"))
        if not motions:
            raise BakeError("has no clip: there is no frame to write", where=self.job.document.path)
        return BakedMesh(plan, tuple(effects), tuple(motions))

    def _sampling(self, mode: Mode) -> SamplingOptions:
        """The options with which clips are sampled."""
        fps, memory = self.job.settings.sampling.fps, self.job.document.memory
        return SamplingOptions(fps, mode, memory, self.progress, self.job.options.jobs)

    def _sample(self, plan: MeshPlan, how: SamplingOptions) -> tuple[list[Effect], list[Motion]]:
        """Run the effects of a mesh over all clips."""
        with self.clock.stage("sample"):
            return sample_effects(plan, self.job.clips, how)

    def add_morph_targets(self, edited: EditedDocument, plan: MeshPlan) -> BakedMesh:
        """Sample a mesh's clips, put targets for the engine and their tracks into the document, and prove them."""
        options, document, how = self.job.options, self.job.document, self._sampling("morph")
        effects, motions = self._sample(plan, how)
        tangents, budget = options.morph_tangents, None
        if options.engine is not None:
            with self.clock.stage("budget"):
                effects, motions, budget = fit_budget(
                    document, plan, effects, motions, self.job.every_clip, options.engine, how, tangents=tangents
                )
        tracked, idle = motions if options.tracks == "all" else [], options.mode == "weights"
        with self.clock.stage("encode"):
            names = encode_morphs(edited, plan, effects, tracked, tangents=tangents, draft=options.draft, idle=idle)
        residuals = {}
        if options.tracks == "all" and not options.draft and not idle:
            with self.clock.stage("prove"):
                residuals = prove(edited, plan, effects, motions, details=options.details, progress=self.progress)
        own_bytes = own_target_bytes(document.gltf, plan.rig.own), own_target_bytes(edited.gltf, plan.rig.own)
        return BakedMesh(plan, tuple(effects), tuple(motions), residuals, budget, own_bytes, joint_names=names)

    def write(
        self, edited: EditedDocument, posed: Sequence[BakedMesh], out: str | os.PathLike[str] | None, outputs: Outputs
    ) -> int | None:
        """Write the files of `frames_dir` and OUT; return the size of OUT with the files beside it."""
        options = self.job.options
        if out is not None and options.mode == "frames":
            from wrinklecli.baking.frames import encode_frames  # most bakes make none

            with self.clock.stage("encode"):
                for mesh in posed:
                    encode_frames(edited, mesh, self.progress)
        if options.frames_dir is not None:
            from wrinklecli.baking.frame_files import export_frames

            with self.clock.stage("export"):
                export_frames(
                    self.job.document, posed, options.frames_dir, options.frames_format, outputs, self.progress
                )
        if out is None:
            return None
        with self.clock.stage("write"):
            return write(edited, out, seal=partial(seal, self.job.asset), outputs=outputs)
