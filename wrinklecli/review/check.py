"""Say, without a bake, where each tool attaches, how far clips shorten it, and how much mesh it refines."""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from wrinklecli.baking.estimate import refuse_many_samples
from wrinklecli.baking.job import BakeOptions, Job, ToolsPaths, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.clip import Clip
from wrinklecli.character.moved import Motions
from wrinklecli.character.posing import JointTurn, MorphWeight
from wrinklecli.character.rig import moving_nodes
from wrinklecli.effects.effect import VISIBLE, MeshPlan, Part, SamplingOptions, Seen, Words
from wrinklecli.effects.faults import turned_warnings
from wrinklecli.effects.plan import mesh_warnings, skin_parts, track_warnings
from wrinklecli.effects.sampling import moving_clips, play_below_skin, play_parts
from wrinklecli.errors import log_findings
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Ints
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import MAX_MEMORY, MAX_VERTICES

# Version of the JSON.
VERSION = 1
# The greatest number of motions, of a range of motion, that are reported for each tool.
_MOST_MOTIONS = 12
# Tools that are listed of those that share vertices with one.
_MOST_OVERLAPS = 20


@dataclass(frozen=True, slots=True)
class CheckOptions:
    """Options of `check` and `crossings`.

    Attributes:
        anims: Files with more clips, for joints of the same names.
        range_of_motion: Look at the range of motion too, even if the asset has clips.
        pose: Joints to turn, by name, axis and degrees, for one pose in place of clips.
        morphs: Names of morph targets and their weights in this pose.
        clips: Names of the clips to look at; if empty, those of the tools file.
        only: Names of the tools to look at; if empty, all.
        fps: Overrides `sampling.fps`; for crossings, moments per second of each clip.
        max_levels: Overrides `refinement.max_levels`.
        max_vertices: Most vertices that refinement may add to a mesh.
        allow_external: Read buffers and images outside the asset's folder too.
        max_memory: Most bytes that reading the asset may take.
    """

    anims: Sequence[str | os.PathLike[str]] = ()
    range_of_motion: bool = False
    pose: Sequence[JointTurn] = ()
    morphs: Sequence[MorphWeight] = ()
    clips: Sequence[str] = ()
    only: Sequence[str] = ()
    fps: float | None = None
    max_levels: int | None = None
    max_vertices: int = MAX_VERTICES
    allow_external: bool = False
    max_memory: int = MAX_MEMORY

    @property
    def bake_options(self) -> BakeOptions:
        """The options of a bake of the same clips and tools."""
        return BakeOptions(
            clips=self.clips,
            only=self.only,
            fps=self.fps,
            max_levels=self.max_levels,
            max_vertices=self.max_vertices,
            allow_external=self.allow_external,
            max_memory=self.max_memory,
        )

    @property
    def motions(self) -> Motions:
        """The motions of the asset besides its own clips."""
        return Motions(self.anims, self.range_of_motion or None, self.pose, self.morphs)


@dataclass(frozen=True, slots=True)
class CheckedTool:
    """A tool on its mesh, what is seen of it in each clip that moves the mesh, and its part of the JSON."""

    plan: MeshPlan
    part: Part
    clips: tuple[Seen, ...]
    data: Json


@dataclass(frozen=True, slots=True)
class Check:
    """The result of `check`: what `--json` prints, and the tools in the same order.

    `inputs` are all files that were read, and the asset's images.
    """

    data: Json
    warnings: tuple[str, ...]
    inputs: tuple[str, ...]
    tools: tuple[CheckedTool, ...]


def check(
    asset: str | os.PathLike[str],
    tools: ToolsPaths,
    options: CheckOptions | None = None,
    *,
    progress: Progress = log_progress,
    **named: Any,
) -> Check:
    """Attach tools, refine their meshes and run their control curves over the clips as a bake does; write nothing.

    An asset without clips is checked in its range of motion: joints and morph targets move one at a time.

    Args:
        asset: The .gltf or .glb to read.
        tools: The YAML file of tools, or several that are merged.
        options: The defaults of `CheckOptions` if None.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `CheckOptions`, in place of those in `options`.

    Raises:
        WrinkleError: A bake would raise this error before it samples clips; all tools that do not fit have a line each.
        TypeError: `CheckOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import check
        >>> found = check("samples/wrist.glb", "configs/wrist.yaml", clips=["flex"], only=["palm_side"])
        >>> print(f"{found.data['tools'][0]['clips'][0]['height']:.4f}")  # of the tallest bump, metres
        0.0028
    """
    options = replace(options or CheckOptions(), **named)
    with guarded(os.fspath(asset)):
        job = read_job(asset, tools, options.bake_options, options.motions)
        warnings, notes = list(job.warnings), list(job.notes)
        checked: list[CheckedTool] = []
        sections: dict[str, list[Json]] = {}
        plans = plan_meshes(job)
        for plan in plans:
            clips = _clips_to_check(plan, job)
            refuse_many_samples(job, plan, clips)
            sampling = SamplingOptions(job.settings.sampling.fps, "morph", job.document.memory, progress)
            moving = moving_clips(plan, clips)
            parts = skin_parts(plan)
            seen = play_parts(plan, parts, moving, sampling)
            # With a pose in place of clips, a bake has the asset's clips all the same.
            there = moving if job.pose is None else moving_clips(plan, job.every_clip)
            baked = [clip for clip in there if clip.name not in (*job.range, job.pose)]
            # A note says that the asset has no clip, and what is looked at in their place.
            warnings += mesh_warnings(plan, job.settings, baked or moving)
            # No tool is at fault, and an option of the bake decides.
            notes += track_warnings(plan, baked)
            measured = [each for each in zip(parts, seen, strict=True) if each[0].attached.segment is not None]
            # Those that measure no segment: effects below the skin, and fields.
            unmeasured = [
                (effect.section, _describe(plan, effect.words, effect.target_names, below, job))
                for effect, below in play_below_skin(plan, moving, sampling)
            ]
            for part, own in zip(parts, seen, strict=True):
                if part.attached.segment is None:
                    found = _describe(plan, part.words(plan), part.drive.targets, own, job)
                    found["warnings"] = [*found["warnings"], *turned_warnings(plan, part, own)]
                    unmeasured.append((part.attached.tool.sections[0], found))
            for section, found in unmeasured:
                sections.setdefault(section, []).append(found)
                warnings += found["warnings"]
            shared = _overlaps(
                [part.vertices for part, _ in measured], [part.attached.tool.name for part, _ in measured]
            )
            for (part, own), overlaps in zip(measured, shared, strict=True):
                tool = _check_tool(plan, part, own, overlaps, job)
                checked.append(tool)
                warnings += tool.data["warnings"]
                progress("checking", len(checked), len(job.settings.tools))
    data: Json = {
        "check": VERSION,
        "asset": job.document.path,
        "tools_file": job.settings.path,
        "meshes": [_describe_mesh(plan) for plan in plans],
        **sections,
        "tools": [tool.data for tool in checked],
        "notes": notes,
        "warnings": warnings,
    }
    log_findings(warnings, notes, where=job.document.path)
    return Check(data, tuple(warnings), (*job.inputs, *job.beside), tuple(checked))


def _clips_to_check(plan: MeshPlan, job: Job) -> list[Clip]:
    """The chosen clips, without motions of the range of motion that move no anchor on this mesh."""
    moving: set[int] = set()
    for part in skin_parts(plan):
        moving |= moving_nodes(plan.rig, np.flatnonzero(np.isin(plan.rig.joints, [*part.drive.nodes])))
    if plan.rig.drives:
        moving |= moving_nodes(plan.rig)
    made = set(job.range)
    return [
        clip for clip in job.clips if clip.name not in made or any(channel.node in moving for channel in clip.channels)
    ]


def _describe(plan: MeshPlan, words: Words, targets: tuple[str, ...], seen: Sequence[Seen], job: Job) -> Json:
    """Describe an effect that no segment moves, as it is seen in clips."""
    # Of a range of motion those motions are told that do something.
    told = [
        {**row, "name": each.motion.clip.name}
        for each in seen
        if (row := words.describe_clip(each)) is not None
        and (each.motion.clip.name not in job.range or each.weights.any())
    ]
    return {**words.describe(plan, targets), "clips": told, "warnings": words.warnings(plan, seen, job.settings.up)}


def _check_tool(plan: MeshPlan, part: Part, every: Sequence[Seen], overlaps: Json, job: Job) -> CheckedTool:
    """Describe a tool in all clips, and in those motions of a range of motion that shorten it most."""
    up = job.settings.up
    own = [each for each in every if each.motion.clip.name not in job.range]
    made = [(float(part.strengths(each).max()), each) for each in every if each.motion.clip.name in job.range]
    most = sorted((each for each in made if each[0] > VISIBLE), key=lambda each: each[0], reverse=True)
    clips = (*own, *(each for _, each in most[:_MOST_MOTIONS]))
    lengths = ((each.reading.distances, each.reading.rest_lengths) for each in clips)
    data = part.facts(plan, up) | overlaps
    data |= {
        "fitting_compressible": part.attached.fitting_compressible(lengths),
        "clips": [part.facts_in(plan, each) for each in clips],
        "warnings": part.words(plan).warnings(plan, clips, up) + turned_warnings(plan, part, clips),
    }
    if made and not clips:
        data["warnings"].append(f"{data['name']}: never shortens in the asset's range of motion: no wrinkle")
    return CheckedTool(plan, part, clips, data)


def _describe_mesh(plan: MeshPlan) -> Json:
    fine = plan.fine
    return {
        "node": plan.rig.node_name,
        "vertices": len(fine.surface.weld),
        "new_vertices": len(fine.weld) - len(fine.surface.weld),
        "triangles": len(fine.surface.triangles),
        "new_triangles": len(fine.triangles) - len(fine.surface.triangles),
        "levels": fine.subdivision.levels,
    }


def _overlaps(moved: Sequence[Ints], names: Sequence[str]) -> list[Json]:
    """Describe for each tool of a mesh the others that move some of its vertices.

    Args:
        moved: (vertices,) sorted vertices of each tool.
        names: The names of the tools.

    Returns:
        For each tool under `overlaps` the first others, and the number of vertices that they share. If there are very
        many, `more_overlaps` is True: all pairs of n tools at one place would be n².
    """
    if not moved:
        return []
    tools = np.repeat(np.arange(len(moved)), [len(each) for each in moved])
    vertices = np.concatenate(moved)
    order = np.argsort(vertices, kind="stable")
    tools, vertices = tools[order], vertices[order]
    # A tool's first others, and the next one, are among the first tools of each vertex with the tool itself.
    first = np.arange(len(vertices)) - np.searchsorted(vertices, vertices) < _MOST_OVERLAPS + 2
    shape = len(moved), int(vertices[-1]) + 1
    moves, early = (
        csr_array((np.ones(len(each[0]), np.bool_), each), shape=shape)
        for each in ((tools, vertices), (tools[first], vertices[first]))
    )
    shared = (moves @ early.T).tocsr()
    found: list[Json] = []
    is_own = np.zeros(shape[1], np.bool_)
    for one, own in enumerate(moved):
        others = np.sort(shared.indices[shared.indptr[one] : shared.indptr[one + 1]])
        others = others[others != one]
        is_own[own] = True
        overlaps = [
            {"tool": names[other], "vertices": int(is_own[moved[other]].sum())}
            for other in others[:_MOST_OVERLAPS].tolist()
        ]
        is_own[own] = False
        found.append({"overlaps": overlaps} | ({"more_overlaps": True} if len(others) > _MOST_OVERLAPS else {}))
    return found
