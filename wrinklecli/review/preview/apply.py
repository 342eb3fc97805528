"""Tools applied to an asset in memory, as a bake would: nothing is proved, and no file is written.

Where a bake refuses tools that do not fit, a preview is to show where they are: they are left out, and named.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

from wrinklecli.baking.creases import sample_with_creases
from wrinklecli.baking.estimate import refuse_too_much
from wrinklecli.baking.job import BakeOptions, Job, read_job
from wrinklecli.baking.morphs import encode_morphs
from wrinklecli.baking.plan import MeshPlan, plan_meshes
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edit import EditedDocument
from wrinklecli.numeric.guard import Progress, no_progress
from wrinklecli.tools.read import load_tools
from wrinklecli.tools.records import ToolsFile, WrinkleTool


@dataclass(frozen=True, slots=True)
class Refused:
    """A tool that does not fit.

    Attributes:
        tool: As the file has it.
        reason: The line that a bake would refuse it with.
    """

    tool: WrinkleTool
    reason: str


@dataclass(frozen=True, slots=True)
class PlannedTools:
    """Tools attached to an asset.

    Attributes:
        settings: The tools file, with all tools that were asked for.
        job: The asset and the tools that fit; None where none does.
        plans: These on each of its meshes.
        misfits: The tools that do not fit.
        warnings: A line each, of misfits those that a bake would refuse them with.
    """

    settings: ToolsFile
    job: Job | None
    plans: tuple[MeshPlan, ...]
    misfits: tuple[Refused, ...]
    warnings: tuple[str, ...]

    @property
    def tool_count(self) -> int:
        """How many tools there are, whether they fit or not."""
        return len(self.misfits) + sum(len(plan.carried_patches) for plan in self.plans)


def plan_tools(asset: Document, tools: str | os.PathLike[str], options: BakeOptions) -> PlannedTools:
    """Attach tools to an asset and refine it, without those that do not fit.

    Args:
        asset: With all clips.
        tools: The YAML file of tools.
        options: Which of them, and how to read.

    Raises:
        WrinkleError: The asset or the tools file is at fault.
    """
    misfits: list[Refused] = []
    settings = load_tools(tools)
    wanted = [tool for tool in settings.tools if not options.only or tool.name in options.only]
    settings, asked = replace(settings, tools=tuple(wanted)), options
    # Tools can be found not to fit at one stage after another: where they name a mesh, at their ends, on their patch.
    while not wanted or len(misfits) < len(wanted):
        try:
            job = read_job(asset, tools, asked)
            plans = tuple(plan_meshes(job))
        except WrinkleError as error:
            fitting = _without(wanted, misfits)
            found = _at_fault(error, fitting)
            if not found:
                raise
            misfits += found
            asked = replace(options, only=[tool.name for tool in _without(wanted, misfits)])
        else:
            reasons = [each.reason for each in misfits]
            return PlannedTools(settings, job, plans, tuple(misfits), (*reasons, *job.warnings))
    return PlannedTools(settings, None, (), tuple(misfits), tuple(each.reason for each in misfits))


def _without(tools: Sequence[WrinkleTool], misfits: Sequence[Refused]) -> list[WrinkleTool]:
    names = {each.tool.name for each in misfits}
    return [tool for tool in tools if tool.name not in names]


def _at_fault(error: WrinkleError, tools: Sequence[WrinkleTool]) -> list[Refused] | None:
    """The tools that an error is about, each with its first line; None where a line is about something else."""
    found: dict[str, Refused] = {}
    for place, line in zip(error.places, error.lines, strict=True):
        # A key may be inherited by several; a mirrored tool is at the place of its source, and a word further.
        of_place = [tool for tool in tools if place in tool.places.values()]
        around = [tool for tool in tools if place.startswith(tool.where)]
        if not of_place and around:
            of_place = [max(around, key=lambda tool: len(tool.where))]
        if not of_place:
            return None
        for tool in of_place:
            found.setdefault(tool.name, Refused(tool, line))
    return list(found.values())


def apply_tools(planned: PlannedTools, clips: Sequence[str], progress: Progress = no_progress) -> Document:
    """Bake planned tools into some clips of their asset, in memory.

    Args:
        planned: The tools; at least one fits.
        clips: Names of the clips that get weights.
        progress: Called with a stage's name, steps done and steps in all.

    Returns:
        The asset as a bake would leave it.

    Raises:
        WrinkleError: The tools cannot be baked.
    """
    job = planned.job
    assert job is not None
    edited, memory = EditedDocument(job.document), job.document.memory
    chosen = [clip for clip in job.clips if clip.name in clips]
    fps = job.settings.sampling.fps
    for plan in planned.plans:
        refuse_too_much(job, plan, chosen, job.document.path)
        every_set, motions = sample_with_creases(plan, chosen, fps=fps, mode="morph", memory=memory, progress=progress)
        encode_morphs(edited, plan, every_set, motions)
    return edited.document()
