"""Effects over time: the clips that move them, clips of equal motion, and the weights of their drives in each."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.drive.drive import AnyDrive
from wrinklecli.drive.play import Playing, play_grid, play_keys
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, Part, SamplingOptions, Seen
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.piecewise import Signal

SAMPLING_SHARE = 0.5
"""Part of the error bound for errors between two samples; pruned skin weights get the rest."""
KEYS_SHARE = 0.25
"""Part of the bound for keys that are left out, whose errors are all along a track."""
REDUCTION_SHARE = 0.25
"""Part of the bound for having fewer shapes: than frames, or than an engine plays otherwise."""
# Bytes of a value while keys are found, with its copies.
_VALUE = 16


def sample_effects(plan: MeshPlan, clips: Sequence[Clip], how: SamplingOptions) -> tuple[list[Effect], list[Motion]]:
    """Make the effects of a mesh, layer by layer, and let their drives play clips.

    Returns:
        The effects, and each clip with the weights of their targets. The mode `morph` leaves out clips that do not move
        the mesh.

    Raises:
        BakeError: There are too many shapes.
    """
    moving = list(clips) if how.mode == "frames" else moving_clips(plan, clips)
    effects: list[Effect] = []
    for layer in plan.layers:
        effects = layer.effects(plan, moving, effects, how)
    return effects, play(plan, effects, moving, how)


def play(plan: MeshPlan, effects: Sequence[Effect], clips: Sequence[Clip], how: SamplingOptions) -> list[Motion]:
    """Let the drives of effects play clips, at times between which straight lines are right for all of them."""
    motions: list[Motion] = []
    # Frames up to the end of each clip.
    ends = np.ceil(np.cumsum([1.0 + (clip.end - clip.start) * how.fps for clip in clips])).astype(int).tolist()
    for clip, end, first in zip(clips, ends, duplicates_of(plan, clips), strict=True):
        alike = motions[first] if first < len(motions) else None
        report = partial(_report, how, clip, end, ends[-1])
        times, keys = _times(plan, effects, clip, how, report) if alike is None else (alike.times, alike.keys)
        motions.append(motion_at(plan, effects, clip, times, keys))
        how.progress("sampling", end, ends[-1])
    return motions


def _report(how: SamplingOptions, clip: Clip, end: int, total: int, seconds: float) -> None:
    """Tell the frames that are sampled at some seconds of a clip, at whose end they are `end` of `total`."""
    how.progress("sampling", end - math.ceil((clip.end - seconds) * how.fps), total)


def play_below_skin(plan: MeshPlan, clips: Sequence[Clip], how: SamplingOptions) -> Iterator[tuple[Effect, list[Seen]]]:
    """The effects that move the skin from below, each as it is seen in clips."""
    effects: list[Effect] = []
    for layer in plan.layers:
        if any(part.attached.moves is not None for part in layer.parts):
            effects = layer.effects(plan, [], effects, how)
    motions = play(plan, effects, clips, how) if effects else []
    for number, effect in enumerate(effects):
        yield effect, [motion.seen(number) for motion in motions]


def play_parts(plan: MeshPlan, parts: Sequence[Part], clips: Sequence[Clip], how: SamplingOptions) -> list[list[Seen]]:
    """For each part what is seen of it in each clip, at times between which straight lines give the moves of all."""
    found: list[list[Seen]] = [[] for _ in parts]
    sizes = np.concatenate([np.zeros(0), *(part.sizes(plan.fine) for part in parts)])
    for clip in clips if parts else ():
        drives = [part.drive for part in parts]
        playing = Playing(drives, plan.rig, clip)
        times, keys = _keyed(plan, drives, clip, how, partial(_moves, playing, sizes), len(sizes))
        readings = playing.read(times)
        motion = Motion(clip, times, keys, tuple(readings), tuple(playing.weights(readings)))
        for number, each in enumerate(found):
            each.append(motion.seen(number))
    return found


def _moves(playing: Playing, sizes: Floats, times: Floats) -> Floats:
    """(frames, weights) moves of (weights,) sizes at (frames,) seconds, scene units."""
    return playing.at(times) * sizes


def seen_at(part: Part, rig: Rig, clip: Clip, times: Floats) -> Seen:
    """Play a part at (frames,) seconds of a clip."""
    playing = Playing([part.drive], rig, clip)
    readings = playing.read(times)
    return Motion(clip, times, np.arange(len(times)), tuple(readings), tuple(playing.weights(readings))).seen(0)


def reader(part: Part, rig: Rig, clip: Clip | None) -> Signal:
    """A function from (frames,) seconds of a clip to (frames, numbers) by which a part moves.

    Its spring follows the clip once; None is the stored pose.
    """
    playing = Playing([part.drive], rig, clip)
    return lambda times: part.numbers(clip, playing.read(times)[0])


def motion_at(plan: MeshPlan, effects: Sequence[Effect], clip: Clip, times: Floats, keys: Ints) -> Motion:
    """A clip as effects play it at (frames,) seconds, of which (keys,) numbers are the keys of a track."""
    readings = read(plan, effects, clip, times)
    weights = [each.weights(clip, reading) for each, reading in zip(effects, readings, strict=True)]
    return Motion(clip, times, keys, tuple(readings), tuple(weights))


def read(plan: MeshPlan, effects: Sequence[Effect], clip: Clip, times: Floats) -> list[object]:
    """The measurements of each effect's drive at (frames,) seconds of a clip; the times themselves without a drive."""
    driven = iter(Playing([each.drive for each in effects if each.drive is not None], plan.rig, clip).read(times))
    return [times if each.drive is None else next(driven) for each in effects]


def _times(
    plan: MeshPlan, effects: Sequence[Effect], clip: Clip, how: SamplingOptions, report: Callable[[float], None]
) -> tuple[Floats, Ints]:
    """(frames,) seconds at which a clip is sampled, and the numbers of the (keys,) that a track needs.

    `report` is called with the seconds that are done.
    """
    if how.mode == "frames":
        grid = clip_grid(clip, None, fps=how.fps)
        return grid, np.arange(len(grid))
    drives = [each.drive for each in effects if each.drive is not None]
    playing, sizes = Playing(drives, plan.rig, clip), move_sizes(plan, effects)
    signal = within(how.memory, partial(_moves, playing, sizes), len(sizes), where=clip.name)
    return _keyed(plan, drives, clip, how, signal, len(sizes), report)


def _keyed(
    plan: MeshPlan,
    drives: Sequence[AnyDrive],
    clip: Clip,
    how: SamplingOptions,
    moves: Signal,
    width: int,
    report: Callable[[float], None] = lambda _seconds: None,
) -> tuple[Floats, Ints]:
    """Find times between which straight lines give so many moves of drives, scene units, and the keys among them."""

    def signal_on(stretch: Floats) -> Signal:
        report(float(stretch[0]))
        return moves

    bound = plan.max_error / max(most_overlaps(plan), 1)
    return play_keys(
        play_grid(drives, plan.rig, clip, fps=how.fps),
        signal_on,
        width=width,
        tolerance=SAMPLING_SHARE * bound,
        thinning=KEYS_SHARE * bound,
    )


def move_sizes(plan: MeshPlan, effects: Sequence[Effect]) -> Floats:
    """(targets,) the largest move of each target at weight 1, scene units.

    That of an effect with an error bound of its own is times the plan's bound over it, so that one bound holds for all.
    Where several targets move a vertex at once, their errors add up.
    """
    factors = [
        (1.0 if each.max_error is None else plan.max_error / each.max_error) * _together(each) for each in effects
    ]
    sizes = [
        target.shape.tallest * factor for each, factor in zip(effects, factors, strict=True) for target in each.targets
    ]
    return np.array(sizes, np.float64)


def _together(effect: Effect) -> float:
    """The largest sum of the moves of all targets at one vertex, over the largest move of one."""
    if effect.projected is not None:
        return len(effect.targets)  # all of them move each vertex
    shapes = [target.shape for target in effect.targets]
    if not effect.add_up or not shapes:
        return 1.0
    lengths = [np.linalg.norm(shape.deltas, axis=1) for shape in shapes]
    sums = np.bincount(np.concatenate([shape.vertices for shape in shapes]), np.concatenate(lengths))
    return float(sums.max() / max(float(each.max(initial=0.0)) for each in lengths))


def within(memory: Memory, signal: Signal, width: int, *, where: str) -> Signal:
    """A signal of so many values that raises TooMuchError before it would give more than fit in memory."""
    asked = 0

    def counted(times: Floats) -> Floats:
        nonlocal asked
        asked += len(times)
        memory.check(_VALUE * width * asked, f"{asked:,} moments of {width:,} values to find keys", where=where)
        return signal(times)

    return counted


def moving_clips(plan: MeshPlan, clips: Sequence[Clip]) -> list[Clip]:
    """The clips that move a mesh, or that key an effect on it."""
    moving, keyed = moving_nodes(plan.rig), _keyed_clips(plan)
    return [clip for clip in clips if clip.name in keyed or any(c.node in moving for c in clip.channels)]


def _keyed_clips(plan: MeshPlan) -> set[str]:
    """The names of clips that key an effect on a mesh."""
    return {name for part in plan.parts for name in part.attached.keyed_clips}


def duplicates_of(plan: MeshPlan, clips: Sequence[Clip]) -> list[int]:
    """For each clip the index of the first with identical motion, as converters write one motion under two names."""
    named = _keyed_clips(plan).union(*(each.named_clips for each in plan.layers))
    first: dict[tuple[str, bytes], int] = {}
    return [
        first.setdefault((clip.name if clip.name in named else "", clip.motion), index)
        for index, clip in enumerate(clips)
    ]


def most_overlaps(plan: MeshPlan) -> int:
    """The greatest number of effects that move one vertex: their errors add up there."""
    moved = np.concatenate([np.zeros(0, np.intp), *(part.vertices for part in plan.parts)])
    return int(np.bincount(moved).max(initial=0))
