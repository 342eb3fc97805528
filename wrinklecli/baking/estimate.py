"""The size of a bake, estimated before it is made: bytes of samples, morph targets and frames."""

from collections.abc import Sequence

from wrinklecli.baking.budget import storage
from wrinklecli.baking.job import Job
from wrinklecli.character.clip import Clip
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.sampling import moving_clips
from wrinklecli.errors import BakeError, counted
from wrinklecli.gltf.writer import GLB_LIMIT
from wrinklecli.numeric.memory import Memory, shown_bytes

# Frames of all clips that are baked at once: nine hours at 30 per second.
_MOST_FRAMES = 1_000_000
# Vertices that are projected in each frame, times frames of all clips: a quarter of an hour, at 10 to 20 microseconds
# each. A knee's 2,000 in 76 clips of 70 frames are a fifth.
_MOST_PROJECTED = 50_000_000
# Bytes of a float32 vector.
_VECTOR = 12
# Bytes of a vector's index in a sparse accessor.
_INDEX = 4
# Bytes of one number that is sampled at one time, with its copies.
_SAMPLED = 40


def refuse_too_much(job: Job, plan: MeshPlan, clips: Sequence[Clip], out: str | None) -> None:
    """Check that the bake of a mesh fits in memory and in the file `out`, if there is one, before it takes long.

    Raises:
        TooMuchError: It would take more memory than there may be.
        BakeError: There are too many frames, or they would not fit in a .glb.
    """
    options, memory, vertices = job.options, job.document.memory, len(plan.fine.weld)
    clips = clips if options.mode == "frames" else moving_clips(plan, clips)
    frames = refuse_many_samples(job, plan, clips)
    moved = target_sizes(plan, clips, frames, memory)
    if out is not None and options.mode == "morph":
        dense = storage(options.engine, options.accessors) == "dense"
        size = morph_target_bytes(plan, moved, dense=dense)
        what = f"{len(moved):,} {'dense ' if dense else ''}morph targets of {vertices:,} vertices"
        memory.check(size, what, where=plan.rig.node_name)
    if out is not None and options.mode == "frames" and not out.lower().endswith(".gltf"):
        size = frames * vertices * plan.attributes * _VECTOR
        if size > GLB_LIMIT:
            raise BakeError(
                f"{frames:,} frames of {vertices:,} vertices would be {shown_bytes(size)}, and a .glb holds 4 GiB: use"
                " --frames-dir, a .gltf, or a lower --fps",
                where=plan.rig.node_name,
            )


def refuse_many_samples(job: Job, plan: MeshPlan, clips: Sequence[Clip]) -> int:
    """Check that the samples of all clips fit in memory.

    Returns:
        The number of times of the grid, to which sampling may add more.

    Raises:
        TooMuchError: It would take more memory than there may be.
        BakeError: There are too many frames, or too many for tools that are projected in each.
    """
    fps = job.settings.sampling.fps
    refuse_many_frames(plan, clips, fps=fps)
    frames = sum(1 + int((clip.end - clip.start) * fps) for clip in clips)
    # Check that tools with `attachment: patch` are done in reasonable time.
    vertices = sum(each.projected for each in plan.layers)
    if vertices * frames > _MOST_PROJECTED:
        raise BakeError(
            f"{vertices:,} vertices under tools with attachment: patch are projected in each of {frames:,} frames,"
            f" {vertices * frames:,} in all, and {_MOST_PROJECTED:,} may be, which take a quarter of an hour: use"
            " attachment: skin, fewer clips at once or a lower fps",
            where=plan.rig.node_name,
        )
    numbers = sum(each.sampled_numbers for each in plan.layers)
    what = f"{frames:,} samples of {counted(len(plan.parts), 'tool')}"
    job.document.memory.check(_SAMPLED * numbers * frames, what, where=plan.rig.node_name)
    return frames


def refuse_many_frames(plan: MeshPlan, clips: Sequence[Clip], *, fps: float) -> None:
    """Check that clips are short enough to be sampled together.

    Raises:
        BakeError: There are too many frames.
    """
    frames = sum((clip.end - clip.start) * fps for clip in clips)
    if frames > _MOST_FRAMES:
        raise BakeError(
            f"{len(clips)} clips have {frames:.6g} frames at {fps:.6g} per second; at once {_MOST_FRAMES:,} may be",
            where=plan.rig.node_name,
        )


def target_sizes(plan: MeshPlan, clips: Sequence[Clip], frames: int, memory: Memory) -> list[int]:
    """The number of welded vertices that each morph target moves, at most.

    Raises:
        TooMuchError: Sampling would take more memory than there may be.
    """
    return [size for layer in plan.layers for size in layer.target_sizes(plan, clips, frames, memory)]


def morph_target_bytes(plan: MeshPlan, moved: Sequence[int], *, dense: bool) -> int:
    """Bytes in the file of morph targets, from the number of welded vertices that each moves."""
    if dense:
        return len(moved) * len(plan.fine.weld) * plan.attributes * _VECTOR
    return sum(moved) * plan.attributes * (_VECTOR + _INDEX)
