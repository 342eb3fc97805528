"""Other morph targets that play the same motion: fewer, fewer at a time, or all with weights in [0, 1]."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.effects.effect import Target
from wrinklecli.effects.shapes import Shape, summed
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.reduction import fewest_axes, peaks_of

# Greatest weight that a file's 32 bits hold as 1; processors round the sums of weights differently.
_ONE = 1.0 + 2.0**-25


Remixed = tuple[list[Shape], Floats]
"""New shapes, and (own shapes, shapes) factors from weights of the tool's own shapes to those of the new."""


def unit_weights(targets: Sequence[Target], path: Floats) -> tuple[Remixed, Floats] | None:
    """Shapes whose weights lie in [0, 1], and the `lows` by which a drive splits them; None if the targets' own do.

    `path` has (rows, shapes) all weights of the targets. Where any is below 0, a negative of the shape stands behind
    the others.
    """
    peaks = np.abs(path).max(axis=0, initial=0.0)
    peaks[peaks <= _ONE] = 1.0
    lows = np.where((path < 0).any(axis=0), 1.0, 0.0)
    if not lows.any() and (peaks == 1.0).all():
        return None
    shapes = [summed([each.shape], np.array([peak])) for each, peak in zip(targets, peaks, strict=True)]
    negated = [summed([shapes[column]], np.array([-1.0])) for column in np.flatnonzero(lows)]
    return ([*shapes, *negated], np.diag(1.0 / peaks)), lows


def fewest(targets: Sequence[Target], path: Floats, groups: Ints, tolerance: float) -> tuple[Remixed, float] | None:
    """The fewest shapes that give all heights within a tolerance, and their error, scene units; None if all are needed.

    All shapes of a tool together: full bumps of a polyline with details still change a little, all alike. (Each
    group of bumps by itself: 19 targets at once instead of 12 for five bumps from the origin.)

    Args:
        targets: The tool's own targets.
        path: (rows, shapes) all weights of these.
        groups: (shapes,) the number of each one's group of bumps, sorted.
        tolerance: Greatest error, scene units: the maximum over rows, and over bumps, as they lie side by side, of the
            sum over the shapes of a group.
    """
    if len(targets) < 2:
        return None
    old = [target.shape for target in targets]
    heights = np.array([shape.tallest for shape in old])
    path = path * heights
    starts = np.flatnonzero(np.diff(groups, prepend=-1))

    def error(axes: Floats) -> float:
        return float(np.add.reduceat(np.abs(path - path @ axes.T @ axes), starts, axis=1).max())

    axes = fewest_axes(path, lambda axes: error(axes) <= tolerance)
    if len(axes) == len(targets):
        return None
    peaks = peaks_of(path @ axes.T)
    parts = axes * peaks[:, None] / heights
    return ([summed(old, row) for row in parts], heights[:, None] * axes.T / peaks), error(axes)


def in_turn(targets: Sequence[Target], columns: Ints, greatest: Floats) -> Remixed | None:
    """Shapes of which few act at a time, if a tool's bumps rise one after another; None if they rise together.

    Each group of bumps rises when those before it are full, and these stay full. Target k has the first k groups at
    their full height. So only two targets have weights, the last full one and the next, to which it gives way, as with
    the in-betweens of animators. The weights for amplitudes a are a_k - a_(k+1), separately for each mode. Targets
    overlap, so files grow: samples/head.glb with its tools from 2.7 to 4.3 MB.

    Args:
        targets: The tool's own targets.
        columns: (targets,) their numbers among the curve's shapes, group by group and mode by mode.
        greatest: (groups, modes) the greatest amplitudes of the curve.
    """
    if len(greatest) < 2:
        return None
    parts, mix = np.zeros((2, len(targets), len(targets)))
    heights = greatest.reshape(-1)[columns]
    modes: Bools = np.arange(greatest.shape[1])[:, None] == columns % greatest.shape[1]
    for mode in modes:
        acting = np.flatnonzero(mode)
        for k, column in enumerate(acting):
            # Units are the group's own greatest amplitude.
            parts[column, acting[: k + 1]] = heights[column] / heights[acting[: k + 1]]
            mix[column, column] = 1.0
            if k:
                mix[column, acting[k - 1]] = -heights[column] / heights[acting[k - 1]]
    old = [target.shape for target in targets]
    return [summed(old, row) for row in parts], mix
