"""Effects over time: the clips that move them, clips of equal motion, and motions sampled at more times."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np

from wrinklecli.character.clip import KEY_GAP, KEY_STEP, Clip, clip_grid
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, SamplingOptions
from wrinklecli.numeric.arrays import Floats, Ints, interpolated
from wrinklecli.numeric.piecewise import Signal, key_points, key_times

SAMPLING_SHARE = 0.5
"""Part of the error bound for errors between two samples; pruned skin weights get the rest."""
KEYS_SHARE = 0.25
"""Part of the bound for keys that are left out, whose errors are all along a track."""


def sample_effects(plan: MeshPlan, clips: Sequence[Clip], how: SamplingOptions) -> tuple[list[Effect], list[Motion]]:
    """Run the effects of a mesh over clips, layer by layer.

    Returns:
        The effects, and each clip with the weights of their shapes. The mode `morph` leaves out clips that do not move
        the mesh.

    Raises:
        BakeError: There are too many shapes.
    """
    moving = list(clips) if how.mode == "frames" else moving_clips(plan, clips)
    effects: list[Effect] = []
    motions: list[Motion] = []
    anew = [number for number, layer in enumerate(plan.layers) if layer.samples_anew]
    for number, layer in enumerate(plan.layers):
        # Nobody looks at motions before the last layer that samples all effects so far: a half of the time with flesh.
        clips_of = moving if number >= max(anew, default=0) else []
        effects, motions = layer.sample(plan, clips_of, effects, motions, how)
    return effects, motions


def moving_clips(plan: MeshPlan, clips: Sequence[Clip]) -> list[Clip]:
    """The clips that move a mesh, or that key an effect on it."""
    moving, keyed = moving_nodes(plan.rig), {name for each in plan.layers for name in each.keyed_clips}
    return [clip for clip in clips if clip.name in keyed or any(c.node in moving for c in clip.channels)]


def duplicates_of(plan: MeshPlan, clips: Sequence[Clip]) -> list[int]:
    """For each clip the index of the first with identical motion, as converters write one motion under two names."""
    named = {name for each in plan.layers for name in (*each.named_clips, *each.keyed_clips)}
    first: dict[tuple[str, bytes], int] = {}
    return [
        first.setdefault((clip.name if clip.name in named else "", clip.motion), index)
        for index, clip in enumerate(clips)
    ]


def sample_driven(
    plan: MeshPlan,
    clips: Sequence[Clip],
    effects: Sequence[Effect],
    how: SamplingOptions,
) -> list[Motion]:
    """Sample effects that their drives alone move, at times between which straight lines are right for all of them."""
    bound = plan.max_error / max(most_overlaps(plan), 1)
    motions: list[Motion] = []
    for done, (clip, first) in enumerate(zip(clips, duplicates_of(plan, clips), strict=True), start=1):
        if how.mode == "frames":
            times = clip_grid(clip, None, fps=how.fps)
            keys = np.arange(len(times))
        elif first < len(motions):
            times, keys = motions[first].times, motions[first].keys
        else:
            moves = moves_of(effects, plan, clip)
            times, keys = key_times(
                clip_grid(clip, plan.rig, fps=how.fps),
                lambda _stretch, moves=moves: moves,  # type: ignore[misc]
                width=sum(len(each.target_names) for each in effects),
                tolerance=SAMPLING_SHARE * bound,
                thinning=KEYS_SHARE * bound,
                gap=KEY_GAP,
                step=KEY_STEP,
            )
        motions.append(driven_motion(plan, Motion(clip, times, keys, ()), effects))
        how.progress("sampling", done, len(clips))
    return motions


def driven_motion(plan: MeshPlan, motion: Motion, effects: Sequence[Effect]) -> Motion:
    """A motion whose times are known already, with states and weights of effects that their drives alone move."""
    states, weights = _driven(effects, plan.rig, motion.clip, motion.times)
    return replace(motion, states=states, weights=weights)


def _driven(
    effects: Sequence[Effect], rig: Rig, clip: Clip, times: Floats
) -> tuple[tuple[Any, ...], tuple[Floats, ...]]:
    """The measurements and the weights of effects that their drives alone move, at (times,) seconds of a clip."""
    blank = Motion(clip, times[:0], np.zeros(0, np.intp), (None,) * len(effects))
    states = tuple(observed(effects, rig, blank, times))
    pairs = zip(effects, states, strict=True)
    return states, tuple(each.exact_weights(blank, np.zeros(0), times, state) for each, state in pairs)


def moves_of(effects: Sequence[Effect], plan: MeshPlan, clip: Clip) -> Signal:
    """A function from (frames,) seconds of a clip to (frames, shapes) moves of effects that their drives alone move.

    A move is a weight times the largest displacement of its shape, scene units; of an effect with an error bound of its
    own, times the plan's bound over it, so that one bound holds for all.
    """
    sizes = [
        np.array([0.0 if t is None else t.shape.tallest for t in each.targets])
        * (1.0 if each.max_error is None else plan.max_error / each.max_error)
        for each in effects
    ]

    def moves(times: Floats) -> Floats:
        _, weights = _driven(effects, plan.rig, clip, times)
        parts = [each * size for each, size in zip(weights, sizes, strict=True)]
        return np.concatenate([np.zeros((len(times), 0)), *parts], axis=1)

    return moves


def most_overlaps(plan: MeshPlan) -> int:
    """The greatest number of effects that move one vertex: their errors add up there."""
    moved = np.concatenate([np.zeros(0, np.intp), *(each for layer in plan.layers for each in layer.moved)])
    return int(np.bincount(moved).max(initial=0))


def observed(effects: Sequence[Effect], rig: Rig, motion: Motion, times: Floats) -> list[Any]:
    """The measurements of each effect at sorted (times,) seconds, among which are the motion's."""
    pairs = zip(effects, motion.states, strict=True)
    found: list[Any] = []
    for kind, group in groupby(pairs, lambda pair: type(pair[0])):
        some, known = zip(*group, strict=True)
        found += kind.observe(list(some), rig, motion, times, list(known))
    return found


def with_times(effects: Sequence[Effect], rig: Rig, motion: Motion, fresh: Floats, *, states: bool = True) -> Motion:
    """Sample a motion at more times, (fresh,) sorted seconds, which are no keys yet.

    Without `states`, the measurements stay those of the old times, as more times follow.
    """
    if not len(fresh):
        return motion
    places = np.searchsorted(motion.times, fresh)
    times = np.insert(motion.times, places, fresh)
    weights = tuple(
        np.insert(sampled, places, each.weights_at(rig, motion, sampled, fresh), axis=0)
        for each, sampled in zip(effects, motion.weights, strict=True)
    )
    found = tuple(observed(effects, rig, motion, times)) if states else motion.states
    keys = np.searchsorted(times, motion.times[motion.keys])
    return Motion(motion.clip, times, keys, found, weights)


def joined(
    plan: MeshPlan,
    effects: Sequence[Effect],
    motion: Motion,
    times: Floats,
    weights: Sequence[Floats],
    sizes: Floats,
    *,
    at_once: bool,
) -> Motion:
    """A motion with the weights of further effects, and keys where these bend.

    Args:
        plan: The mesh.
        effects: The effects that the motion has already.
        motion: A clip as these effects sampled it.
        times: (frames,) seconds of the further weights; the motion's own if `at_once`.
        weights: For each further effect (frames, shapes).
        sizes: (all further shapes,) the largest move of each, scene units.
        at_once: True if no time is to be added.
    """
    unmeasured = (None,) * len(weights)
    if at_once:
        return replace(motion, states=(*motion.states, *unmeasured), weights=(*motion.weights, *weights))
    # All times at which the effects act are added, not the keys alone, as the proof compares times between keys too.
    acting = np.any([each.any(axis=1) for each in weights], axis=0)
    near = acting.copy()  # with the times before and after
    near[1:] |= acting[:-1]
    near[:-1] |= acting[1:]
    whole = with_times(effects, plan.rig, motion, np.setdiff1d(times[near], motion.times))
    more = [interpolated(whole.times, times, each) for each in weights]
    keys = np.searchsorted(whole.times, times[_keys(plan, times, np.concatenate(weights, axis=1) * sizes)])
    states, keys = (*whole.states, *unmeasured), np.union1d(whole.keys, keys)
    return replace(whole, keys=keys, states=states, weights=(*whole.weights, *more))


def _keys(plan: MeshPlan, times: Floats, moves: Floats) -> Ints:
    """(keys,) the times that straight lines need to give (times, shapes) moves, scene units."""
    bound = KEYS_SHARE * plan.max_error
    points, keys = key_points(
        times,
        lambda at: interpolated(at, times, moves),
        tolerance=np.inf,
        thinning=bound,
        gap=KEY_GAP,
        step=KEY_STEP,
    )
    return np.searchsorted(times, points[keys])
