"""What a bake would make, estimated before any of it is made: samples of clips, morph targets, frames, in bytes."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.baking.budget import storage
from wrinklecli.baking.job import Job
from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.sample import compress_displacements, moving_clips
from wrinklecli.character.clip import Clip
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.errors import BakeError, counted
from wrinklecli.gltf.writer import GLB_LIMIT
from wrinklecli.numeric.arrays import Ints
from wrinklecli.numeric.memory import Memory, shown_bytes
from wrinklecli.numeric.reduction import refuse_large_series

# Of all clips that are baked at once: nine hours at 30 a second.
_MOST_FRAMES = 1_000_000
# Bytes of a float32 vector, and of the index that it has in a sparse accessor.
_VECTOR, _INDEX = 12, 4
# Bytes of one number that is sampled of a tool at one time, with its copies.
_SAMPLED = 40
# Numbers that are sampled of each tool besides its amplitudes.
_BESIDE = 4
# Moments of all clips at which it is tried how many shapes a tool with `attachment: patch` needs.
_MOMENTS = 32


def refuse_too_much(job: Job, plan: MeshPlan, clips: Sequence[Clip], out: str | None) -> None:
    """Check that what a bake makes of a mesh can be held, before it takes long.

    Args:
        job: The asset, its tools and the options.
        plan: The tools on the mesh.
        clips: To bake.
        out: What is to be written, if anything.

    Raises:
        TooMuchError: It would take more memory than there may be.
        BakeError: There are too many frames, or they would not fit in a .glb.
    """
    options, memory, vertices = job.options, job.document.memory, len(plan.fine.weld)
    clips = clips if options.mode == "frames" else moving_clips(plan, clips)
    frames = refuse_many_samples(job, plan, clips)
    moved = moved_by_targets(plan, clips, frames, memory)
    if out is not None and options.mode == "morph":
        dense = storage(options.engine, options.accessors) == "dense"
        size = morph_target_bytes(plan, moved, dense=dense)
        what = f"{len(moved):,} {'dense ' if dense else ''}morph targets of {vertices:,} vertices"
        memory.check(size, what, where=_where(plan))
    if out is not None and options.mode == "frames" and not out.lower().endswith(".gltf"):
        size = frames * vertices * _vectors(plan) * _VECTOR
        if size > GLB_LIMIT:
            raise BakeError(
                f"{frames:,} frames of {vertices:,} vertices would be {shown_bytes(size)}, and a .glb holds 4 GiB: use"
                " --frames-dir, a .gltf, or a lower --fps",
                where=_where(plan),
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
    job.document.memory.check(_SAMPLED * numbers * frames, what, where=_where(plan))
    return frames


def refuse_many_frames(plan: MeshPlan, clips: Sequence[Clip], *, fps: float) -> None:
    """Check that clips are short enough to be sampled together.

    Raises:
        BakeError: They are not.
    """
    frames = sum((clip.end - clip.start) * fps for clip in clips)
    if frames > _MOST_FRAMES:
        raise BakeError(
            f"{len(clips)} clips have {frames:.6g} frames at {fps:.6g} per second; at once {_MOST_FRAMES:,} may be",
            where=_where(plan),
        )


def moved_by_targets(plan: MeshPlan, clips: Sequence[Clip], frames: int, memory: Memory) -> Ints:
    """(targets,) how many welded vertices each morph target moves.

    Those of `attachment: skin` are as many as there are at the most. With `attachment: patch` there are as many as the
    clips ask for: at least about as many as some moments ask for.

    Args:
        plan: The tools on a mesh.
        clips: To bake.
        frames: Of them.
        memory: That there may be.

    Raises:
        TooMuchError: All frames of a tool that is projected anew in each would take more.
    """
    moved = [np.zeros(0, np.intp)]
    for carried in plan.carried_patches:
        if carried.patch.tool.attachment == "skin":
            moved.append(_moved(carried))
        elif clips:
            count = _least_shapes(plan, carried, clips, memory)
            refuse_large_series(memory, frames, len(carried.vertices), count, where=carried.patch.tool.where)
            moved.append(np.full(count, len(carried.vertices)))
    return np.concatenate(moved)


def morph_target_bytes(plan: MeshPlan, moved: Ints, *, dense: bool) -> int:
    """The bytes in the file of morph targets that move so many welded vertices each, (targets,)."""
    if dense:
        return len(moved) * len(plan.fine.weld) * _vectors(plan) * _VECTOR
    return int(moved.sum()) * _vectors(plan) * (_VECTOR + _INDEX)


def _where(plan: MeshPlan) -> str:
    return plan.rig.names[plan.rig.node]


def _vectors(plan: MeshPlan) -> int:
    """Of a vertex: POSITION, and NORMAL where there is one."""
    return 1 + plan.has_normals


def _moved(carried: CarriedPatch) -> Ints:
    """(targets,) how many welded vertices each target of a tool moves: those under its bumps."""
    curve = carried.patch.curve
    us = np.sort(carried.us)
    low, high = (np.searchsorted(us, ends) for ends in (curve.bumps.starts, curve.bumps.ends))
    of_groups = [int((high - low)[list(bumps)].sum()) for bumps in curve.groups]
    return np.repeat(of_groups, curve.greatest_amplitudes.shape[1])


def _least_shapes(plan: MeshPlan, carried: CarriedPatch, clips: Sequence[Clip], memory: Memory) -> int:
    """How many shapes some moments, spread over the clips, ask for."""
    chosen = clips[:: -(-len(clips) // _MOMENTS)]
    count = -(-_MOMENTS // len(chosen))
    moments = ((clip, np.linspace(clip.start, clip.end, count)) for clip in chosen)
    _, shapes = compress_displacements(plan, carried, moments, memory)
    return len(shapes)
