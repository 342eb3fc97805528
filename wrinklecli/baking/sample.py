"""What tools do over time: the times of every clip that need a sample, and the weights of all shapes at them."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.targets import AnySet, TargetSet, named_targets
from wrinklecli.character.carried import pose_carriers
from wrinklecli.character.clip import KEY_GAP, KEY_STEP, Clip, clip_grid, motion_breaks
from wrinklecli.character.pose import Pose, pose_at
from wrinklecli.character.rig import moving_nodes
from wrinklecli.choices import Mode
from wrinklecli.drive.lag import SpringFilter
from wrinklecli.effects.wrinkle.activity import (
    Activity,
    activities,
    activity,
    points_of,
    springs_in,
)
from wrinklecli.effects.wrinkle.bending import tallest_poses
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.shapes import Sample, Shape, make_shapes, shapes_of
from wrinklecli.effects.wrinkle.weights import weights_of
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.piecewise import Signal, key_times
from wrinklecli.numeric.quartics import smooth
from wrinklecli.numeric.reduction import compress

# Bytes of a value while keys are found, with its copies.
_VALUE = 16
# Coordinates of displacements that are compressed at once: bounds the memory.
_MOST_COORDINATES = 2**20
# Frames between two breaks to begin with, besides the clip's turns; halved where a quartic misses the distances. With 4
# a bake poses 0.4 to 0.9 times as often as with 1.
_FRAMES_OF_A_QUARTIC = 4
# Share of the error bound for what lies between two samples; pruned skin weights have the rest: see `plan`.
_SAMPLING_SHARE = 0.5
# Share of the bound for fewer shapes than there are frames, with `attachment: patch`.
_COMPRESSION_SHARE = 0.25
# Share of the bound for dropped keys. Their errors are all along a track, those of samples only where wrinkles start.
_KEYS_SHARE = 0.25
# A vector whose three coordinates are each off by 1 is off by this.
_PER_COORDINATE = 3.0**0.5


@dataclass(frozen=True, slots=True)
class Motion:
    """One clip, sampled.

    Attributes:
        clip: The animation.
        times: (frames,) seconds.
        keys: (keys,) the frames that a track needs, straight between them.
        seen: What each tool does at these times.
        weights: For each tool and then each fold, (frames, shapes) of its shapes as sampled, which a remix gives the
            weights of others; empty before there are shapes.
    """

    clip: Clip
    times: Floats
    keys: Ints
    seen: tuple[Activity, ...]
    weights: tuple[Floats, ...] = ()


@dataclass(frozen=True, slots=True)
class ClipActivity:
    """What one tool does in one clip.

    Attributes:
        clip: The animation.
        times: (frames,) seconds.
        seen: What the tool does at these times.
    """

    clip: Clip
    times: Floats
    seen: Activity


def sample_clips(
    plan: MeshPlan, clips: Sequence[Clip], *, fps: float, mode: Mode, memory: Memory, progress: Progress
) -> tuple[list[TargetSet], list[Motion]]:
    """Run the tools over the clips that move their mesh.

    Args:
        plan: The tools.
        clips: To sample, after `estimate` has found them few enough; `morph` leaves out those that do not move the
            mesh.
        fps: Of the grid.
        mode: `frames` takes the grid alone, `morph` what straight lines between keys need.
        memory: That values between keys, and the shapes of all frames, may take.
        progress: Called with a stage's name, frames done and frames in all.

    Returns:
        Each tool's shapes, and each clip with their weights.

    Raises:
        BakeError: There are too many shapes.
    """
    sampled = sample_activities(plan, clips, fps=fps, mode=mode, memory=memory, progress=progress)
    patches = [carried.patch for carried in plan.carried_patches]
    poses: Sequence[Pose | None] = [None] * len(patches)
    if plan.has_normals:
        poses = tallest_poses(patches, plan.rig, plan.rest)
    target_sets, by_tool = [], []
    for number, pose in enumerate(poses):
        target_set, weights = _target_set(plan, number, sampled, pose, memory)
        target_sets.append(target_set)
        by_tool.append(weights)
    by_clip = zip(*by_tool, strict=True)
    return target_sets, [replace(motion, weights=weights) for motion, weights in zip(sampled, by_clip, strict=True)]


def target_weights(target_sets: Sequence[AnySet], motion: Motion) -> Floats:
    """(frames, targets) weights of the targets of all tools and folds in one clip."""
    columns = [
        each.written(each.shape_weights(weights)) for each, weights in zip(target_sets, motion.weights, strict=True)
    ]
    return np.concatenate(columns, axis=1)


def sample_activities(
    plan: MeshPlan, clips: Sequence[Clip], *, fps: float, mode: Mode, memory: Memory, progress: Progress
) -> list[Motion]:
    """As `sample_clips`, without weights, as there are no shapes yet: only times, and what the tools do then."""
    clips = list(clips) if mode == "frames" else moving_clips(plan, clips)
    patches = [carried.patch for carried in plan.carried_patches]
    bound = plan.max_error / _overlaps(plan)
    # Frames up to the end of each clip.
    ends = np.ceil(np.cumsum([1.0 + (clip.end - clip.start) * fps for clip in clips])).astype(int).tolist()
    sampled: list[Motion] = []
    for clip, end, take in zip(clips, ends, takes_of(plan, clips), strict=True):
        springs = springs_in(patches, plan.rig, clip)
        if mode == "frames":
            times = clip_grid(clip, None, fps=fps)
            keys = np.arange(len(times))
        elif take < len(sampled):
            times, keys = sampled[take].times, sampled[take].keys
        else:
            tell_left = partial(_tell_left, progress, end, ends[-1])
            times, keys = _key_times(plan, clip, springs, fps=fps, bound=bound, memory=memory, tell_left=tell_left)
        seen = activities(patches, plan.rig, clip, times, springs=springs)
        sampled.append(Motion(clip, times, keys, tuple(seen)))
        progress("sampling", end, ends[-1])
    return sampled


def _tell_left(progress: Progress, end: int, total: int, left: int) -> None:
    progress("sampling", end - left, total)


def _key_times(
    plan: MeshPlan,
    clip: Clip,
    springs: Sequence[SpringFilter | None],
    *,
    fps: float,
    bound: float,
    memory: Memory,
    tell_left: Callable[[int], None],
) -> tuple[Floats, Ints]:
    """Times so close that straight lines between them are right, and which of them to key.

    Args:
        plan: The tools.
        clip: The animation.
        springs: Each tool's filter in it, as `springs_in`.
        fps: Of the grid.
        bound: Greatest error of one tool, scene units.
        memory: That the values between keys may take.
        tell_left: Called now and then with how many frames of the clip are left.

    Returns:
        (frames,) seconds and (keys,) indices into them, as `key_times`.
    """
    clip_breaks, tolerance = motion_breaks(clip, plan.rig), _SAMPLING_SHARE * bound

    def signal_on(stretch: Floats) -> Signal:
        tell_left(math.ceil((clip.end - stretch[0]) * fps))
        within = clip_breaks[(clip_breaks > stretch[0]) & (clip_breaks < stretch[-1])]
        breaks = distinct_values(np.concatenate([stretch[::_FRAMES_OF_A_QUARTIC], stretch[-1:], within]))
        return _within(memory, _signals(plan, clip, breaks, tolerance, springs), width, where=clip.name)

    grid, width = clip_grid(clip, plan.rig, fps=fps), sum(_width(each) for each in plan.carried_patches)
    return key_times(
        grid,
        signal_on,
        width=width,
        tolerance=tolerance,
        thinning=_KEYS_SHARE * bound,
        gap=KEY_GAP,
        step=KEY_STEP,
    )


def _target_set(
    plan: MeshPlan, number: int, sampled: Sequence[Motion], pose: Pose | None, memory: Memory
) -> tuple[TargetSet, list[Floats]]:
    """One tool's shapes, with normals for a pose if there is one, and for each clip their (frames, shapes) weights.

    Raises:
        BakeError: It has too many shapes.
    """
    carried = plan.carried_patches[number]
    if carried.patch.tool.attachment == "skin":
        shapes = shapes_of(carried, plan.fine, plan.rest, pose)
        weights = [_weights(carried, each.clip, each.seen[number]) for each in sampled]
    else:
        shapes, weights = _compressed(plan, carried, sampled, memory)
    return TargetSet(carried, named_targets(carried.patch.tool.identifier, shapes)), weights


def takes_of(plan: MeshPlan, clips: Sequence[Clip]) -> list[int]:
    """For each clip the first that moves the mesh and its wrinkles alike: converters write a take under two names."""
    named = {name for each in plan.carried_patches for name in (*each.patch.tool.clips, *each.patch.keyed_clips)}
    first: dict[tuple[str, bytes], int] = {}
    return [
        first.setdefault((clip.name if clip.name in named else "", clip.motion), index)
        for index, clip in enumerate(clips)
    ]


def moving_clips(plan: MeshPlan, clips: Sequence[Clip]) -> list[Clip]:
    """The clips that move a mesh or key the rest length of a tool on it."""
    moving = moving_nodes(plan.rig)
    driven = {name for each in plan.carried_patches for name in each.patch.keyed_clips}
    return [clip for clip in clips if clip.name in driven or any(c.node in moving for c in clip.channels)]


def _overlaps(plan: MeshPlan) -> int:
    """How many tools move one vertex at the most: there, their errors add up."""
    moved = np.concatenate([carried.vertices for carried in plan.carried_patches])
    return int(np.bincount(moved).max())


def _signals(
    plan: MeshPlan, clip: Clip, breaks: Floats, tolerance: float, springs: Sequence[SpringFilter | None]
) -> Signal:
    """What must be right between keys within a stretch of a clip, of all tools, scene units.

    Heights start like square roots of the anchors' distances, which are smooth between the breaks: few poses tell
    the distances, and they tell the heights.
    """
    rig = plan.rig
    patches = [each.patch for each in plan.carried_patches]
    # Where a height starts, √(x D) for x the length of an interval, an error of D shows most.
    slack = min(tolerance**2 * each.curve.interval_count / (16 * each.rest_length) for each in patches)

    def distances(times: Floats) -> Floats:
        carriers = pose_carriers(points_of(patches), rig, clip, times)
        return np.stack([each.segment.lengths(rig, clip, times, carriers)[0] for each in patches], axis=1)

    near = smooth(distances, breaks, slack)

    def signals(times: Floats) -> Floats:
        values = []
        for carried, found, late in zip(plan.carried_patches, near(times).T, springs, strict=True):
            patch, rest_lengths = carried.patch, carried.patch.segment.rest_length.at(rig, clip, times)
            followed = found if late is None else late.follow(times, found, rest_lengths)
            amplitudes, _ = patch.curve.follow(followed, rest_lengths)
            if patch.tool.attachment == "patch":
                moved = displacements(carried, plan.fine, rig, clip, times, amplitudes)
                values.append(_PER_COORDINATE * plan.scale * moved.reshape(len(times), -1))
            else:
                values.append(patch.clip_strength(clip) * patch.shape_strength * amplitudes.reshape(len(times), -1))
        return np.concatenate(values, axis=1)

    return signals


def _within(memory: Memory, signal: Signal, width: int, *, where: str) -> Signal:
    """A signal of so many values; it raises TooMuchError before it has been asked for more than there may be."""
    asked = 0

    def counted(times: Floats) -> Floats:
        nonlocal asked
        asked += len(times)
        memory.check(_VALUE * width * asked, f"{asked:,} moments of {width:,} values to find keys", where=where)
        return signal(times)

    return counted


def _width(carried: CarriedPatch) -> int:
    """How many values `_signals` has of a tool."""
    if carried.patch.tool.attachment == "patch":
        return 3 * len(carried.vertices)
    return carried.patch.curve.greatest_amplitudes.size


def skin_weights(plan: MeshPlan, carried: CarriedPatch, clip: Clip | None, times: Floats) -> Floats:
    """(frames, shapes) morph weights of a skin-attached tool in a clip; none for the stored pose."""
    return _weights(carried, clip, activity(carried.patch, plan.rig, clip, times))


def _weights(carried: CarriedPatch, clip: Clip | None, seen: Activity) -> Floats:
    """(frames, shapes) morph weights of what a skin-attached tool does."""
    patch = carried.patch
    return patch.clip_strength(clip) * weights_of(patch.curve, seen.amplitudes).reshape(len(seen.amplitudes), -1)


def _compressed(
    plan: MeshPlan, carried: CarriedPatch, sampled: Sequence[Motion], memory: Memory
) -> tuple[list[Shape | None], list[Floats]]:
    """Shapes and weights of displacements that are new in each frame, all clips together.

    Raises:
        BakeError: They have too many.
    """
    if not sampled:
        return [], []
    together, deltas = compress_displacements(plan, carried, [(each.clip, each.times) for each in sampled], memory)
    weights = np.split(together, np.cumsum([len(each.times) for each in sampled])[:-1])
    even = np.linspace(0, len(together) - 1, 16).astype(int)
    rows = distinct_values(np.concatenate([even, np.argmax(together, axis=0)]))
    moments = [(each.clip, time) for each in sampled for time in each.times.tolist()]
    shapes = make_shapes(
        plan.fine,
        carried.vertices,
        deltas,
        tallest=plan.scale * np.sqrt(np.sum(deltas**2, axis=2)).max(axis=1, initial=0.0),
        samples=[Sample(together[row], pose_at(plan.rig, *moments[row])) for row in rows] if plan.has_normals else [],
    )
    return shapes, weights


def compress_displacements(
    plan: MeshPlan, carried: CarriedPatch, moments: Iterable[tuple[Clip, Floats]], memory: Memory
) -> tuple[Floats, Floats]:
    """Few shapes for all that a tool with `attachment: patch` does at (frames,) times of some clips, as `compress`."""
    chunk = max(_MOST_COORDINATES // (3 * len(carried.vertices)), 1)
    series = (
        displacements(carried, plan.fine, plan.rig, clip, times[k : k + chunk])
        for clip, times in moments
        for k in range(0, len(times), chunk)
    )
    tolerance = _COMPRESSION_SHARE * plan.max_error / plan.scale / _PER_COORDINATE
    return compress(series, tolerance, memory=memory, where=carried.patch.tool.where)
