"""Wrinkles over clips: the times that need a sample, the tools' activities then, and the weights of their shapes."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wrinklecli.character.carried import pose_carriers
from wrinklecli.character.clip import KEY_GAP, KEY_STEP, Clip, clip_grid, motion_breaks
from wrinklecli.drive.lag import SpringFilter
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, SamplingOptions, named_targets
from wrinklecli.effects.sampling import KEYS_SHARE, SAMPLING_SHARE, driven_motion, duplicates_of, moves_of
from wrinklecli.effects.sampling import most_overlaps as most_effects
from wrinklecli.effects.shapes import Shape, fit_bytes
from wrinklecli.effects.wrinkle.activity import activities, points_of, springs_in
from wrinklecli.effects.wrinkle.bending import rising
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.effect import WrinkleEffect, curve_weights
from wrinklecli.effects.wrinkle.shapes import projected_shapes, shapes_of
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.piecewise import Signal, key_times
from wrinklecli.numeric.quartics import smooth
from wrinklecli.numeric.reduction import compress

# Bytes of a value while keys are found, with its copies.
_VALUE = 16
# Coordinates of displacements that are compressed at once, which bounds the memory.
_MOST_COORDINATES = 2**20
# Frames between two breaks before refinement, besides the clip's own breaks. With 4 a bake poses 0.4 to 0.9 times as
# often as with 1.
_FRAMES_OF_A_QUARTIC = 4
# Part of the bound for having fewer shapes than frames, with `attachment: patch`.
_COMPRESSION_SHARE = 0.25
PER_COORDINATE = 3.0**0.5
"""Length of a vector whose coordinates are all 1: its error if each coordinate is off by 1."""


def sample_wrinkles(
    carried_patches: Sequence[CarriedPatch],
    first: int,
    plan: MeshPlan,
    clips: Sequence[Clip],
    before: Sequence[Effect],
    how: SamplingOptions,
) -> tuple[list[Effect], list[Motion]]:
    """Run tools over clips, as `Layer.sample` does; `first` is the number of the first tool's region."""
    motions = sample_activities(carried_patches, plan, clips, how, before)
    patches = [carried.patch for carried in carried_patches]
    effects: list[Effect] = []
    by_tool = []
    for number, patch in enumerate(patches):
        shapes, weights = _shapes(carried_patches[number], plan, number, motions, how.memory)
        identifier = patch.tool.identifier
        targets = named_targets(identifier, shapes)
        effects.append(WrinkleEffect(identifier, targets, carried_patches[number], first + number))
        by_tool.append(weights)
    by_clip = zip(*by_tool, strict=True)
    found = [replace(motion, weights=weights) for motion, weights in zip(motions, by_clip, strict=True)]
    if before:
        found = [_after(driven_motion(plan, motion, before), motion) for motion in found]
    return [*before, *effects], found


def _after(first: Motion, second: Motion) -> Motion:
    """A motion with the states and weights of some effects, and of others after them."""
    return replace(first, states=(*first.states, *second.states), weights=(*first.weights, *second.weights))


def sample_activities(
    carried_patches: Sequence[CarriedPatch],
    plan: MeshPlan,
    clips: Sequence[Clip],
    how: SamplingOptions,
    before: Sequence[Effect] = (),
) -> list[Motion]:
    """Sample clips without weights: their times, and the tools' activities as states.

    The times suit the effects `before` the tools, too.
    """
    patches = [carried.patch for carried in carried_patches]
    overlaps = most_effects(plan) if before else most_overlaps(carried_patches)
    bound, fps, progress = plan.max_error / overlaps, how.fps, how.progress
    # Frames up to the end of each clip.
    ends = np.ceil(np.cumsum([1.0 + (clip.end - clip.start) * fps for clip in clips])).astype(int).tolist()
    sampled: list[Motion] = []
    for clip, end, first in zip(clips, ends, duplicates_of(plan, clips), strict=True):
        springs = springs_in(patches, plan.rig, clip)
        if how.mode == "frames":
            times = clip_grid(clip, None, fps=fps)
            keys = np.arange(len(times))
        elif first < len(sampled):
            times, keys = sampled[first].times, sampled[first].keys
        else:
            report_remaining = partial(_report_remaining, progress, end, ends[-1])
            others = moves_of(before, plan, clip) if before else None
            times, keys = _key_times(carried_patches, plan, clip, springs, bound, how, report_remaining, others)
        seen = activities(patches, plan.rig, clip, times, springs=springs)
        sampled.append(Motion(clip, times, keys, tuple(seen)))
        progress("sampling", end, ends[-1])
    return sampled


def _report_remaining(progress: Progress, end: int, total: int, remaining: int) -> None:
    progress("sampling", end - remaining, total)


def _key_times(
    carried_patches: Sequence[CarriedPatch],
    plan: MeshPlan,
    clip: Clip,
    springs: Sequence[SpringFilter | None],
    bound: float,
    how: SamplingOptions,
    report_remaining: Callable[[int], None],
    others: Signal | None,
) -> tuple[Floats, Ints]:
    """Times so dense that straight lines between them are right, and the numbers of the keys among them.

    Args:
        carried_patches: The tools.
        plan: Their mesh.
        clip: The clip.
        springs: Each tool's filter in the clip, as `springs_in`.
        bound: Greatest error of one tool, scene units.
        how: The grid, and the limit on values between keys.
        report_remaining: Called now and then with the number of frames that remain.
        others: The moves of effects before the tools, scene units; None without any.

    Returns:
        (frames,) seconds and (keys,) indices into them, as `key_times`.
    """
    clip_breaks, tolerance = motion_breaks(clip, plan.rig), SAMPLING_SHARE * bound

    def signal_on(stretch: Floats) -> Signal:
        report_remaining(math.ceil((clip.end - stretch[0]) * how.fps))
        within = clip_breaks[(clip_breaks > stretch[0]) & (clip_breaks < stretch[-1])]
        breaks = distinct_values(np.concatenate([stretch[::_FRAMES_OF_A_QUARTIC], stretch[-1:], within]))
        own = _signals(carried_patches, plan, clip, breaks, tolerance, springs)
        every = own if others is None else lambda times: np.concatenate([own(times), others(times)], axis=1)
        return _within(how.memory, every, width, where=clip.name)

    grid, width = clip_grid(clip, plan.rig, fps=how.fps), sum(_width(each) for each in carried_patches)
    return key_times(
        grid,
        signal_on,
        width=width,
        tolerance=tolerance,
        thinning=KEYS_SHARE * bound,
        gap=KEY_GAP,
        step=KEY_STEP,
    )


def _shapes(
    carried: CarriedPatch, plan: MeshPlan, number: int, motions: Sequence[Motion], memory: Memory
) -> tuple[Sequence[Shape | None], list[Floats]]:
    """One tool's shapes, with normals if the mesh has any, and for each clip their (frames, shapes) weights.

    Raises:
        BakeError: There are too many shapes.
    """
    if carried.ring is None:
        shapes = shapes_of(carried, plan.fine, rising(carried.patch, plan.rig, plan.rest) if plan.has_normals else [])
        return shapes, [curve_weights(carried.patch, each.clip, each.states[number]) for each in motions]
    return _compressed(plan, carried, motions, memory)


def most_overlaps(carried_patches: Sequence[CarriedPatch]) -> int:
    """The greatest number of tools that move one vertex: their errors add up there."""
    moved = np.concatenate([each.vertices for each in carried_patches])
    return int(np.bincount(moved).max())


def _signals(
    carried_patches: Sequence[CarriedPatch],
    plan: MeshPlan,
    clip: Clip,
    breaks: Floats,
    tolerance: float,
    springs: Sequence[SpringFilter | None],
) -> Signal:
    """The values of all tools that must be right between keys within a stretch of a clip, scene units.

    Heights start like square roots of the anchors' distances, but distances are smooth between the breaks. So few poses
    give the distances, and these give the heights.
    """
    rig = plan.rig
    patches = [each.patch for each in carried_patches]
    # An error of a distance D shows most where a height starts, as √(x D) for an interval of length x.
    slack = min(tolerance**2 * each.curve.interval_count / (16 * each.rest_length) for each in patches)

    def distances(times: Floats) -> Floats:
        carriers = pose_carriers(points_of(patches), rig, clip, times)
        return np.stack([each.segment.lengths(rig, clip, times, carriers)[0] for each in patches], axis=1)

    near = smooth(distances, breaks, slack)

    def signals(times: Floats) -> Floats:
        values = []
        for carried, found, late in zip(carried_patches, near(times).T, springs, strict=True):
            patch, rest_lengths = carried.patch, carried.patch.segment.rest_length.at(rig, clip, times)
            followed = found if late is None else late.follow(times, found, rest_lengths)
            amplitudes, _ = patch.curve.follow(followed, rest_lengths)
            if patch.tool.attachment == "patch":
                moved = displacements(carried, plan.fine, rig, clip, times, amplitudes)
                values.append(PER_COORDINATE * plan.scale * moved.reshape(len(times), -1))
            else:
                values.append(patch.clip_strength(clip) * patch.shape_strength * amplitudes.reshape(len(times), -1))
        return np.concatenate(values, axis=1)

    return signals


def _within(memory: Memory, signal: Signal, width: int, *, where: str) -> Signal:
    """A signal of so many values that raises TooMuchError before it would give more than fit in memory."""
    asked = 0

    def counted(times: Floats) -> Floats:
        nonlocal asked
        asked += len(times)
        memory.check(_VALUE * width * asked, f"{asked:,} moments of {width:,} values to find keys", where=where)
        return signal(times)

    return counted


def _width(carried: CarriedPatch) -> int:
    """The number of values that `_signals` has for a tool."""
    if carried.patch.tool.attachment == "patch":
        return 3 * len(carried.vertices)
    return carried.patch.curve.greatest_amplitudes.size


def _compressed(
    plan: MeshPlan, carried: CarriedPatch, motions: Sequence[Motion], memory: Memory
) -> tuple[list[Shape | None], list[Floats]]:
    """Shapes and weights of displacements that are new in each frame, all clips together.

    Raises:
        BakeError: There are too many shapes.
        TooMuchError: They would take more memory than is left.
    """
    if not motions:
        return [], []
    together, deltas = compress_displacements(plan, carried, [(each.clip, each.times) for each in motions], memory)
    weights = np.split(together, np.cumsum([len(each.times) for each in motions])[:-1])
    if plan.has_normals:
        what = f"the normals of {len(deltas):,} shapes of {len(carried.vertices):,} vertices"
        memory.check(fit_bytes(len(deltas), len(carried.vertices)), what, where=carried.patch.tool.where)
    return projected_shapes(plan, carried.vertices, deltas, motions, weights), weights


def compress_displacements(
    plan: MeshPlan, carried: CarriedPatch, moments: Iterable[tuple[Clip, Floats]], memory: Memory
) -> tuple[Floats, Floats]:
    """`compress` the displacements of a tool with `attachment: patch` at (frames,) times of some clips."""
    chunk = max(_MOST_COORDINATES // (3 * len(carried.vertices)), 1)
    series = (
        displacements(carried, plan.fine, plan.rig, clip, times[k : k + chunk])
        for clip, times in moments
        for k in range(0, len(times), chunk)
    )
    tolerance = _COMPRESSION_SHARE * plan.max_error / plan.scale / PER_COORDINATE
    return compress(series, tolerance, memory=memory, where=carried.patch.tool.where)
