"""Tools applied to an asset in memory, as a bake would: nothing is proved, and no file is written."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.morphs import encode_morphs
from wrinklecli.baking.plan import MeshPlan, plan_meshes
from wrinklecli.baking.sample import sample_clips
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edit import EditedDocument
from wrinklecli.numeric.guard import Progress, no_progress
from wrinklecli.numeric.memory import MAX_MEMORY
from wrinklecli.tools.records import MAX_VERTICES


@dataclass(frozen=True, slots=True)
class AppliedTools:
    """An asset with tools.

    Attributes:
        document: The asset as a bake would leave it.
        plans: The tools on each of its meshes.
        warnings: A line each.
    """

    document: Document
    plans: tuple[MeshPlan, ...]
    warnings: tuple[str, ...]


def apply_tools(
    asset: str | os.PathLike[str],
    tools: str | os.PathLike[str],
    *,
    only: Sequence[str] = (),
    clips: Sequence[str] = (),
    allow_external: bool = False,
    max_memory: int = MAX_MEMORY,
    max_vertices: int = MAX_VERTICES,
    progress: Progress = no_progress,
) -> AppliedTools:
    """Bake tools into some clips of an asset, in memory.

    Args:
        asset: The .gltf or .glb.
        tools: The YAML file of tools.
        only: Names of the tools to apply; all where left out.
        clips: Names of the clips that get weights.
        allow_external: Read buffers and images outside the asset's folder too.
        max_memory: Bytes that reading may take.
        max_vertices: That may be added to a mesh.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        WrinkleError: The asset or the tools are at fault, or do not go together.
    """
    options = BakeOptions(
        clips=clips, only=only, allow_external=allow_external, max_memory=max_memory, max_vertices=max_vertices
    )
    job = read_job(asset, tools, options)
    edited = EditedDocument(job.document)
    plans = plan_meshes(job)
    chosen = [clip for clip in job.clips if clip.name in clips]
    fps = job.settings.sampling.fps
    for plan in plans:
        target_sets, motions = sample_clips(plan, chosen, fps=fps, mode="morph", progress=progress)
        encode_morphs(edited, plan, target_sets, motions)
    document = replace(edited.document(), allow_external=allow_external)
    return AppliedTools(document, tuple(plans), tuple(job.warnings))
