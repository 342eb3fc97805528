"""Other morph targets that play the same motion: fewer, fewer at a time, or all with weights from 0 to 1."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.sample import Motion, skin_weights
from wrinklecli.baking.targets import AnySet, Remix, TargetSet, named_targets, of_tools, targets_of
from wrinklecli.character.clip import Clip
from wrinklecli.effects.wrinkle.activity import further_activities
from wrinklecli.effects.wrinkle.shapes import Shape
from wrinklecli.effects.wrinkle.weights import weight_path
from wrinklecli.numeric.arrays import Bools, Floats, interpolated

# Share of the tolerance below which a weight may be left out for its target not to count.
_LEAST_SHARE = 0.1
# Groups of bumps that act at a time where they rise one after another: one that is full, and the next.
_IN_TURN = 2


def with_unit_weights(target_set: AnySet, sampled: Sequence[Floats]) -> AnySet:
    """The same motion with weights from 0 to 1, as those of folds are: scaled, and split where they are negative.

    Args:
        target_set: The tool, on its curve's shapes, or a fold.
        sampled: For each clip its (frames, shapes) weights, which tell the range where there is no curve.
    """
    if not isinstance(target_set, TargetSet):
        return target_set
    if target_set.from_skin:
        path = _path(target_set)
    else:
        path = np.concatenate([np.zeros((0, len(target_set.targets))), *sampled])
    peaks = np.maximum(np.abs(path).max(axis=0, initial=0.0), 1.0)
    negative: Bools = np.any(path < 0, axis=0)
    split = tuple(column for column, target in enumerate(target_set.targets) if target is not None and negative[column])
    if not split and (peaks == 1.0).all():
        return target_set
    shapes = [
        None if each is None else summed([each.shape], np.array([peak]))
        for each, peak in zip(target_set.targets, peaks, strict=True)
    ]
    negated = [summed([shape], np.array([-1.0])) for shape in (shapes[column] for column in split) if shape is not None]
    scaled = np.diag(peaks)
    unmix = np.concatenate([scaled, -scaled[list(split)]])
    return _remixed(target_set, [*shapes, *negated], Remix(np.diag(1.0 / peaks), unmix, split=split))


def _path(target_set: TargetSet) -> Floats:
    """(rows, shapes) weights that a skin-attached tool's targets take over all shortenings."""
    table = target_set.shape_weights(weight_path(target_set.carried.patch.curve))
    tool, strength = target_set.carried.patch.tool, target_set.carried.patch.shape_strength
    factors = [1.0, *(each / strength for each in tool.clips.values())] if strength else [1.0]
    return np.concatenate([factor * table for factor in factors])


def with_fewest(target_set: AnySet, tolerance: float) -> tuple[AnySet, float]:
    """A tool's fewest targets that give all heights within a tolerance, and their error; scene units.

    All shapes of a tool together: full bumps of a polyline with details still change a little, all alike. (Each
    group of bumps by itself: 19 targets at once instead of 12 for five bumps from the origin.)

    Source: C. Eckart, G. Young, *The approximation of one matrix by another of lower rank*, 1936. Differs: the
    error is the greatest over bumps, which lie side by side, and rows of the table, of the sum over modes.
    """
    written = target_set.columns
    if not isinstance(target_set, TargetSet) or not target_set.from_skin or len(written) < 2:
        return target_set, 0.0
    old = [target.shape for target in targets_of([target_set])]
    heights = np.array([shape.tallest for shape in old])
    path = _path(target_set)[:, written] * heights
    groups = written // target_set.carried.patch.curve.greatest_amplitudes.shape[1]
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    _, _, right = np.linalg.svd(path, full_matrices=False)
    for rank in range(1, len(written)):
        axes = right[:rank]
        missed = np.abs(path - path @ axes.T @ axes)
        error = float(np.add.reduceat(missed, starts, axis=1).max())
        if error > tolerance:
            continue
        weights = path @ axes.T
        peaks = weights[np.argmax(np.abs(weights), axis=0), np.arange(rank)]
        mix = np.zeros((len(target_set.targets), rank))
        mix[written] = heights[:, None] * axes.T / peaks
        shares = axes * peaks[:, None] / heights
        unmix = np.zeros((rank, len(target_set.targets)))
        unmix[:, written] = shares
        return _remixed(target_set, [summed(old, row) for row in shares], Remix(mix, unmix)), error
    return target_set, 0.0


def with_fewest_at_once(plan: MeshPlan, target_set: AnySet, tolerance: float) -> tuple[AnySet, float]:
    """A tool on those shapes of which the fewest act at a time, and their error; the exact ones among equals."""
    choices = [
        (target_set, 0.0),
        (in_turn(target_set, _LEAST_SHARE * tolerance / plan.tallest), 0.0),
        with_fewest(target_set, tolerance),
    ]
    return min(choices, key=lambda choice: most_at_once(choice[0]))


def most_at_once(target_set: AnySet) -> int:
    """Most targets of a tool with a weight other than 0 at a time, over all shortenings; all, without a curve."""
    if not isinstance(target_set, TargetSet) or not target_set.from_skin:
        return len(targets_of([target_set]))
    shown: Bools = target_set.written(target_set.shape_weights(weight_path(target_set.carried.patch.curve))) != 0
    return int((shown[:-1] | shown[1:]).sum(axis=1).max())


def in_turn(target_set: AnySet, least: float) -> AnySet:
    """The same motion with few targets at a time where a tool's bumps rise one after another.

    Each group of bumps rises when those before it are full and stay so. Target k has the first k groups at their
    full height, so that only the last full one and the one above it, to which it gives way, have weights: what
    animators call in-betweens. The weights of the amplitudes a are a_k - a_(k+1), of each mode by itself. Targets
    overlap, so files grow: samples/head.glb with its tools from 2.7 to 4.3 MB.

    Args:
        target_set: The tool, on the shapes of its curve.
        least: Weights that may be left out.
    """
    if not isinstance(target_set, TargetSet) or not target_set.from_skin:
        return target_set
    greatest = target_set.carried.patch.curve.greatest_amplitudes
    groups, modes = greatest.shape
    if groups < 2:
        return target_set
    has = np.array([target is not None for target in target_set.targets]).reshape(groups, modes)
    shares, mix = np.zeros((2, len(target_set.targets), len(target_set.targets)))
    numbers = np.arange(groups * modes).reshape(groups, modes)
    for mode in range(modes):
        acting = numbers[has[:, mode], mode]
        heights = greatest[has[:, mode], mode]
        for k, column in enumerate(acting):
            # In units of the group's own greatest amplitude.
            shares[column, acting[: k + 1]] = heights[k] / heights[: k + 1]
            mix[column, column] = 1.0
            if k:
                mix[column, acting[k - 1]] = -heights[k] / heights[k - 1]
    old = [target.shape for target in targets_of([target_set])]
    shapes = [
        summed(old, row[has.reshape(-1)]) if target is not None else None
        for row, target in zip(shares, target_set.targets, strict=True)
    ]
    return _remixed(target_set, shapes, Remix(mix, shares, least=least))


def keyed_at_turns(plan: MeshPlan, target_sets: Sequence[AnySet], motion: Motion) -> Motion:
    """A clip keyed where one group of bumps is full and the next begins: no interval shows three groups of a tool."""
    clip, times, keys, weights = motion.clip, motion.times, motion.keys, motion.weights
    for number, target_set in enumerate(target_sets):
        while isinstance(target_set, TargetSet) and target_set.remix is not None and target_set.remix.least > 0:
            turns = _turns(plan, target_set, clip, times[keys], target_set.shape_weights(weights[number])[keys])
            if not len(turns):
                break
            fresh, keyed = np.setdiff1d(turns, times), np.union1d(times[keys], turns)
            times, weights = with_times(plan, target_sets, clip, times, weights, fresh)
            keys = np.searchsorted(times, keyed)
    patches = [target_set.carried.patch for target_set in of_tools(target_sets)]
    seen = further_activities(patches, plan.rig, clip, times, known=motion.seen, known_at=motion.times)
    return replace(motion, times=times, keys=keys, seen=tuple(seen), weights=weights)


def _turns(plan: MeshPlan, target_set: TargetSet, clip: Clip, keys: Floats, weights: Floats) -> Floats:
    """Times between keys when one group of a tool is full and no more have begun, where an interval shows three.

    Args:
        plan: The tools on a mesh.
        target_set: One whose bumps rise in turn.
        clip: The animation.
        keys: (keys,) seconds.
        weights: (keys, shapes).

    Returns:
        Seconds, rising, float32 values, none a key; nothing where no interval can be helped.
    """

    def groups(of: Floats) -> Bools:
        shape = target_set.carried.patch.curve.greatest_amplitudes.shape
        found: Bools = (of != 0).reshape(len(of), *shape).any(axis=2)
        return found

    def highest(of: Floats) -> NDArray[np.intp]:
        """How many groups have risen."""
        shown = groups(of)
        numbers: NDArray[np.intp] = np.max(shown * np.arange(1, shown.shape[1] + 1), axis=1)
        return numbers

    shown, tops = groups(weights), highest(weights)
    crowded = np.flatnonzero((shown[:-1] | shown[1:]).sum(axis=1) > _IN_TURN)
    if not len(crowded):
        return np.zeros(0)
    rising = tops[crowded + 1] > tops[crowded]
    near, far = (keys[crowded + side] for side in (~rising, rising))
    top = np.minimum(tops[crowded], tops[crowded + 1])
    while True:
        middle = ((near + far) / 2.0).astype(np.float32).astype(np.float64)
        inside = (middle != near) & (middle != far)
        if not inside.any():
            return np.setdiff1d(near, keys)
        below = highest(target_set.shape_weights(skin_weights(plan, target_set.carried, clip, middle))) <= top
        near, far = np.where(inside & below, middle, near), np.where(inside & ~below, middle, far)


def with_times(
    plan: MeshPlan,
    target_sets: Sequence[AnySet],
    clip: Clip,
    times: Floats,
    weights: Sequence[Floats],
    fresh: Floats,
) -> tuple[Floats, tuple[Floats, ...]]:
    """(more times,) with (fresh,) ones, rising, among them, and for each set its (more times, shapes) weights there."""
    if not len(fresh):
        return times, tuple(weights)
    places = np.searchsorted(times, fresh)
    more = (
        np.insert(old, places, _weights_at(plan, each, clip, old, times, fresh), axis=0)
        for each, old in zip(target_sets, weights, strict=True)
    )
    return np.insert(times, places, fresh), tuple(more)


def _weights_at(
    plan: MeshPlan, target_set: AnySet, clip: Clip, weights: Floats, times: Floats, fresh: Floats
) -> Floats:
    """(fresh, shapes) weights of a tool at more times: its curve's, or between those sampled where it has none."""
    if isinstance(target_set, TargetSet) and target_set.from_skin:
        return skin_weights(plan, target_set.carried, clip, fresh)
    return interpolated(fresh, times, weights)


def _remixed(target_set: TargetSet, shapes: Sequence[Shape | None], remix: Remix) -> TargetSet:
    """A tool on other shapes than its own, which are those of its curve."""
    return replace(target_set, targets=named_targets(target_set.identifier, shapes), remix=remix)


def summed(shapes: Sequence[Shape], factors: Floats) -> Shape:
    """A weighted sum of shapes."""
    pairs = []
    for each in ([(s.vertices, s.deltas) for s in shapes], [(s.normal_vertices, s.normal_deltas) for s in shapes]):
        vertices = np.unique(np.concatenate([where for where, _ in each]))
        deltas = np.zeros((len(vertices), 3))
        for factor, (where, values) in zip(factors, each, strict=True):
            deltas[np.searchsorted(vertices, where)] += factor * values
        pairs.append((vertices, deltas))
    (vertices, deltas), (normal_vertices, normal_deltas) = pairs
    scale = max(shape.tallest / _longest(shape.deltas) for shape in shapes)
    tallest = scale * _longest(deltas)
    return Shape(vertices, deltas, tallest, normal_vertices, normal_deltas)


def _longest(deltas: Floats) -> float:
    return float(np.sqrt(np.sum(deltas**2, axis=1)).max())
