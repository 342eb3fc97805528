"""Other morph targets that play the same motion: fewer, fewer at a time, or all with weights in [0, 1]."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from wrinklecli.effects.effect import Target
from wrinklecli.effects.shapes import Shape, summed
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats
from wrinklecli.numeric.reduction import fewest_axes, peaks_of

# Groups of bumps that act at a time if groups rise one after another: one that is full, and the next.
_IN_TURN = 2
# Greatest weight that a file's 32 bits hold as 1; processors round the sums of weights differently.
_ONE = 1.0 + 2.0**-25


@dataclass(frozen=True, slots=True)
class Remix:
    """Other shapes than the control curve's, which play the same motion within an engine's limits.

    Attributes:
        mix: (curve's shapes, shapes before the split) factors from weights of the curve's shapes to those of the new.
        unmix: (shapes, curve's shapes) parts of the curve's shapes in the new ones.
        split: Columns of `mix` whose negative weights drive shapes of their own, which stand behind the others.
        least: Weights up to this are 0.
    """

    mix: Floats
    unmix: Floats
    split: tuple[int, ...] = ()
    least: float = 0.0

    def weights(self, of_curve: Floats) -> Floats:
        """(frames, shapes) weights of the new shapes from (frames, curve's shapes) weights of the curve's."""
        mixed = of_curve @ self.mix
        kept = np.where(np.abs(mixed) > self.least, mixed, 0.0)
        columns = list(self.split)
        negative = np.maximum(-kept[:, columns], 0.0)
        kept[:, columns] = np.maximum(kept[:, columns], 0.0)
        return np.concatenate([kept, negative], axis=1)

    @property
    def signed_mix(self) -> Floats:
        """(curve's shapes, shapes) the mix with the negatives of split columns; weights below 0 are then set to 0."""
        return np.concatenate([self.mix, -self.mix[:, list(self.split)]], axis=1)


Remixed = tuple[list[Shape | None], Remix]
"""New shapes, and their relation to the curve's."""


def unit_weights(targets: Sequence[Target | None], path: Floats) -> Remixed | None:
    """Shapes whose weights lie in [0, 1]; None if the targets' own do.

    `path` has (rows, shapes) all weights of the targets.
    """
    peaks = np.abs(path).max(axis=0, initial=0.0)
    peaks[peaks <= _ONE] = 1.0
    negative: Bools = np.any(path < 0, axis=0)
    split = tuple(column for column, target in enumerate(targets) if target is not None and negative[column])
    if not split and (peaks == 1.0).all():
        return None
    shapes = [
        None if each is None else summed([each.shape], np.array([peak]))
        for each, peak in zip(targets, peaks, strict=True)
    ]
    negated = [summed([shape], np.array([-1.0])) for shape in (shapes[column] for column in split) if shape is not None]
    scaled = np.diag(peaks)
    unmix = np.concatenate([scaled, -scaled[list(split)]])
    return [*shapes, *negated], Remix(np.diag(1.0 / peaks), unmix, split=split)


def fewest(
    targets: Sequence[Target | None], path: Floats, modes: int, tolerance: float
) -> tuple[Remixed, float] | None:
    """The fewest shapes that give all heights within a tolerance, and their error, scene units; None if all are needed.

    All shapes of a tool together: full bumps of a polyline with details still change a little, all alike. (Each
    group of bumps by itself: 19 targets at once instead of 12 for five bumps from the origin.)

    Args:
        targets: The tool's own targets.
        path: (rows, shapes) all weights of these.
        modes: Shapes of a group of bumps.
        tolerance: Greatest error, scene units: the maximum over rows, and over bumps, as they lie side by side, of the
            sum over modes.
    """
    written = np.array([number for number, target in enumerate(targets) if target is not None], np.intp)
    if len(written) < 2:
        return None
    old = [target.shape for target in targets if target is not None]
    heights = np.array([shape.tallest for shape in old])
    path = path[:, written] * heights
    starts = np.flatnonzero(np.diff(written // modes, prepend=-1))

    def error(axes: Floats) -> float:
        return float(np.add.reduceat(np.abs(path - path @ axes.T @ axes), starts, axis=1).max())

    axes = fewest_axes(path, lambda axes: error(axes) <= tolerance)
    if len(axes) == len(written):
        return None
    peaks = peaks_of(path @ axes.T)
    mix, unmix = np.zeros((len(targets), len(axes))), np.zeros((len(axes), len(targets)))
    mix[written] = heights[:, None] * axes.T / peaks
    unmix[:, written] = axes * peaks[:, None] / heights
    return ([summed(old, row[written]) for row in unmix], Remix(mix, unmix)), error(axes)


def in_turn(targets: Sequence[Target | None], greatest: Floats, least: float) -> Remixed | None:
    """Shapes of which few act at a time, if a tool's bumps rise one after another; None if they rise together.

    Each group of bumps rises when those before it are full, and these stay full. Target k has the first k groups at
    their full height. So only two targets have weights, the last full one and the next, to which it gives way, as with
    the in-betweens of animators. The weights for amplitudes a are a_k - a_(k+1), separately for each mode. Targets
    overlap, so files grow: samples/head.glb with its tools from 2.7 to 4.3 MB.

    Args:
        targets: The tool's own targets.
        greatest: (groups, modes) the greatest amplitudes of the curve.
        least: Weights up to this may be left out.
    """
    groups, modes = greatest.shape
    if groups < 2:
        return None
    has = np.array([target is not None for target in targets]).reshape(groups, modes)
    shares, mix = np.zeros((2, len(targets), len(targets)))
    numbers = np.arange(groups * modes).reshape(groups, modes)
    for mode in range(modes):
        acting = numbers[has[:, mode], mode]
        heights = greatest[has[:, mode], mode]
        for k, column in enumerate(acting):
            # Units are the group's own greatest amplitude.
            shares[column, acting[: k + 1]] = heights[k] / heights[: k + 1]
            mix[column, column] = 1.0
            if k:
                mix[column, acting[k - 1]] = -heights[k] / heights[k - 1]
    old = [target.shape for target in targets if target is not None]
    shapes = [
        summed(old, row[has.reshape(-1)]) if target is not None else None
        for row, target in zip(shares, targets, strict=True)
    ]
    return shapes, Remix(mix, shares, least=least)


def turns(shape: tuple[int, int], weights_at: Callable[[Floats], Floats], keys: Floats, weights: Floats) -> Floats:
    """Times when one group of bumps is full and the next has not begun, in intervals of keys that show three.

    Args:
        shape: The numbers of groups and of modes.
        weights_at: (times,) seconds to (times, shapes) weights, of a tool whose bumps rise in turn.
        keys: (keys,) seconds.
        weights: (keys, shapes).

    Returns:
        Seconds, sorted, float32 values, none a key; nothing if no interval can be helped.
    """

    def groups(of: Floats) -> Bools:
        found: Bools = (of != 0).reshape(len(of), *shape).any(axis=2)
        return found

    def highest(of: Floats) -> NDArray[np.intp]:
        """The number of groups that have risen."""
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
        below = highest(weights_at(middle)) <= top
        near, far = np.where(inside & below, middle, near), np.where(inside & ~below, middle, far)
