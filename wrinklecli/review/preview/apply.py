"""Apply tools to an asset in memory, as a bake would; nothing is proved, and no file is written.

A bake refuses tools that do not fit. A preview leaves them out, and names them, so that it can show where they are.
"""

import os
from collections.abc import Sequence
from dataclasses import replace

from wrinklecli.baking.estimate import refuse_too_much
from wrinklecli.baking.job import BakeOptions, Job, read_job
from wrinklecli.baking.morphs import encode_morphs
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.effect import MeshPlan, SamplingOptions
from wrinklecli.effects.plan import skin_parts
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.tools.read import load_tools
from wrinklecli.tools.records import ToolsFile, WrinkleTool


@dataclass(frozen=True, slots=True)
class RefusedTool:
    """A tool that does not fit, and the line with which a bake would refuse it."""

    tool: WrinkleTool
    reason: str


@dataclass(frozen=True, slots=True)
class PlannedTools:
    """Tools attached to an asset; `settings` are the tools file with all tools that were asked for.

    `job` and `plans`, one for each mesh, have the tools that fit; without any, `job` is None. The warnings begin with
    the reasons of the misfits.
    """

    settings: ToolsFile
    job: Job | None
    plans: tuple[MeshPlan, ...]
    misfits: tuple[RefusedTool, ...]
    warnings: tuple[str, ...]

    @property
    def tool_count(self) -> int:
        """The number of tools, with those that do not fit."""
        return len(self.misfits) + sum(len(skin_parts(plan)) for plan in self.plans)


def plan_tools(asset: Document, tools: str | os.PathLike[str], options: BakeOptions) -> PlannedTools:
    """Attach the tools of a YAML file that fit to an asset with all its clips, and refine it for them.

    Raises:
        WrinkleError: The asset or the tools file is at fault.
    """
    misfits: list[RefusedTool] = []
    settings = load_tools(tools, external=options.allow_external)
    wanted = [tool for tool in settings.tools if not options.only or tool.name in options.only]
    settings = settings.only(options.only) if options.only else settings
    asked = options
    # A tool may fail at one of several stages: its mesh, its ends or its patch.
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
            others = [each.name for each in settings.effects if each not in wanted]
            asked = replace(options, only=[*(tool.name for tool in _without(wanted, misfits)), *others])
        else:
            reasons = [each.reason for each in misfits]
            return PlannedTools(settings, job, plans, tuple(misfits), (*reasons, *job.warnings))
    return PlannedTools(settings, None, (), tuple(misfits), tuple(each.reason for each in misfits))


def without_contact(planned: PlannedTools) -> tuple[PlannedTools, list[str]]:
    """The same without contact, and a line if that leaves any out.

    A look at tools takes seconds, and resolving their folds may take a minute.
    """
    asked = [tool.name for tool in planned.settings.tools if tool.contact is not None]
    left = tuple(
        replace(plan, layers=tuple(each for each in plan.layers if not each.is_solved)) for plan in planned.plans
    )
    if all(len(plan.layers) == len(before.layers) for plan, before in zip(left, planned.plans, strict=True)):
        return planned, []
    note = f"{', '.join(asked)}: contact is left out, as a preview of tools is a quick look; a bake has it"
    return replace(planned, plans=left), [note]


def _without(tools: Sequence[WrinkleTool], misfits: Sequence[RefusedTool]) -> list[WrinkleTool]:
    names = {each.tool.name for each in misfits}
    return [tool for tool in tools if tool.name not in names]


def _at_fault(error: WrinkleError, tools: Sequence[WrinkleTool]) -> list[RefusedTool] | None:
    """The tools that an error names, each with its first line; None if a line is about something else."""
    found: dict[str, RefusedTool] = {}
    pairs = list(zip(error.places, error.lines, strict=True))
    for place, line in pairs[:-1] if error.more else pairs:
        # Several tools may inherit a key; the place of a mirrored tool is its source's place and one more word.
        of_place = [tool for tool in tools if place in tool.places.values()]
        around = [tool for tool in tools if place.startswith(tool.where)]
        if not of_place and around:
            of_place = [max(around, key=lambda tool: len(tool.where))]
        if not of_place:
            return None
        for tool in of_place:
            found.setdefault(tool.name, RefusedTool(tool, line))
    return list(found.values())


def apply_tools(
    planned: PlannedTools, clips: Sequence[str], progress: Progress = log_progress
) -> tuple[Document, list[str]]:
    """The asset as a bake of planned tools, of which at least one fits, would leave it, and what it leaves out.

    Only the clips of these names get weights, and only they count for what is left out.

    Raises:
        WrinkleError: The tools cannot be baked.
    """
    job = planned.job
    assert job is not None
    edited, left_out = EditedDocument(job.document), list[str]()
    chosen = [clip for clip in job.clips if clip.name in clips]
    sampling = SamplingOptions(job.settings.sampling.fps, "morph", job.document.memory, progress, job.options.jobs)
    for plan in planned.plans:
        refuse_too_much(job, plan, chosen, job.document.path)
        effects, motions = sample_effects(plan, chosen, sampling)
        encode_morphs(edited, plan, effects, motions)
        left_out += [each.words.left_out for each in effects if each.words.left_out is not None]
    return edited.document(), left_out
