"""What a bake would make, estimated before any of it is made: samples of clips, morph targets, frames, in bytes."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.baking.budget import storage
from wrinklecli.baking.job import Job
from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.sample import moving_clips, refuse_many_frames
from wrinklecli.character.clip import Clip
from wrinklecli.errors import BakeError, counted
from wrinklecli.gltf.writer import GLB_LIMIT
from wrinklecli.method.carry import CarriedPatch
from wrinklecli.numeric.arrays import Ints
from wrinklecli.numeric.memory import shown_bytes

# Bytes of a float32 vector, and of the index that it has in a sparse accessor.
_VECTOR, _INDEX = 12, 4
# Bytes of one number that is sampled of a tool at one time, with its copies.
_SAMPLED = 40
# Numbers that are sampled of each tool besides its amplitudes.
_BESIDE = 4


def refuse_too_much(job: Job, plan: MeshPlan, out: str | None) -> None:
    """Check that what a bake makes of a mesh can be held, before it takes long.

    Args:
        job: The asset, its tools and the options.
        plan: The tools on the mesh.
        out: What is to be written, if anything.

    Raises:
        TooMuchError: It would take more memory than there may be.
        BakeError: There are too many frames, or they would not fit in a .glb.
    """
    options, where, vertices = job.options, plan.rig.names[plan.rig.node], len(plan.fine.weld)
    clips = job.clips if options.mode == "frames" else moving_clips(plan, job.clips)
    frames = refuse_many_samples(job, plan, clips)
    if out is not None and options.mode == "morph":
        dense = storage(options.engine, options.accessors) == "dense"
        count, size = morph_target_bytes(plan, dense=dense)
        what = f"{count:,} {'dense ' if dense else ''}morph targets of {vertices:,} vertices"
        job.document.memory.check(size, what, where=where)
    if out is not None and options.mode == "frames" and not out.lower().endswith(".gltf"):
        size = frames * vertices * _vectors(plan) * _VECTOR
        if size > GLB_LIMIT:
            raise BakeError(
                f"{frames:,} frames of {vertices:,} vertices would be {shown_bytes(size)}, and a .glb holds 4 GiB: use"
                " --frames-dir, a .gltf, or a lower --fps",
                where=where,
            )


def refuse_many_samples(job: Job, plan: MeshPlan, clips: Sequence[Clip]) -> int:
    """Check that all that the tools do at all times of clips can be held.

    Returns:
        How many times there are at least, those of the grid.

    Raises:
        TooMuchError: It would take more memory than there may be.
        BakeError: There are too many frames.
    """
    fps = job.settings.sampling.fps
    refuse_many_frames(plan, clips, fps=fps)
    frames = sum(1 + int((clip.end - clip.start) * fps) for clip in clips)
    numbers = sum(each.patch.curve.greatest_amplitudes.size + _BESIDE for each in plan.carried_patches)
    what = f"{frames:,} samples of {counted(len(plan.carried_patches), 'tool')}"
    job.document.memory.check(_SAMPLED * numbers * frames, what, where=plan.rig.names[plan.rig.node])
    return frames


def morph_target_bytes(plan: MeshPlan, *, dense: bool) -> tuple[int, int]:
    """How many morph targets the tools make at the most, and the bytes that these take in the file.

    Tools with `attachment: patch` have as many as their clips ask for: they are not counted.
    """
    carried = [each for each in plan.carried_patches if each.patch.tool.attachment == "skin"]
    moved = np.concatenate([np.zeros(0, np.intp), *(_moved(each) for each in carried)])
    if dense:
        return len(moved), len(moved) * len(plan.fine.weld) * _vectors(plan) * _VECTOR
    return len(moved), int(moved.sum()) * _vectors(plan) * (_VECTOR + _INDEX)


def _vectors(plan: MeshPlan) -> int:
    """Of a vertex: POSITION, and NORMAL where there is one."""
    return 1 + plan.has_normals


def _moved(carried: CarriedPatch) -> Ints:
    """(targets,) how many welded vertices each target of a tool moves: those under its bumps."""
    curve = carried.patch.curve
    us = np.sort(carried.us)
    low, high = (np.searchsorted(us, curve.bump_starts + more) for more in (0.0, 2.0 / curve.interval_count))
    of_groups = [int((high - low)[list(bumps)].sum()) for bumps in curve.groups]
    return np.repeat(of_groups, curve.greatest_amplitudes.shape[1])
