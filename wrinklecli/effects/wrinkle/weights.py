"""The weights of a control curve's shapes against its shortening, and the shortenings at which groups of bumps start.

A weight is an amplitude over the greatest one, and the weight of the morph target that has the shape.
"""

import dataclasses
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from wrinklecli.drive.lag import TAUT
from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.numeric.arrays import Floats, distinct_values

# Rows of `weight_path` for each group of bumps.
_PATH_ROWS = 65
# Rows after the last group is full, when only details of a polyline still move.
_FULL_ROWS = 8
# The start of a group of bumps is found to the last bits of a float by choosing one of so many parts. (Halves take
# three times as long, since a curve takes hardly longer for a hundred lengths than for one.)
_PARTS = 64
# Rounds of that choice.
_ROUNDS = 9


def weight_path(curve: ControlCurve) -> Floats:
    """(rows, groups, modes) weights as the nominal rest length shortens to nothing, in small steps of the heights."""
    starts = group_starts(curve, curve.rest_length)
    steps = np.linspace(0.0, 1.0, _PATH_ROWS) ** 2  # heights start like a square root
    rising = [low + (high - low) * steps for low, high in pairwise(starts)]
    rows = distinct_values(np.concatenate([[0.0], *rising, np.linspace(starts[-1], 1.0, _FULL_ROWS)]))
    return weights_at(curve, rows)


def weights_at(curve: ControlCurve, shortenings: Floats) -> Floats:
    """(rows, groups, modes) weights at (rows,) shortenings over the nominal rest length, 1 - distance / rest length."""
    lengths = np.full(len(shortenings), curve.rest_length)
    amplitudes, _ = curve.follow((1.0 - shortenings) * lengths, lengths)
    return weights_of(curve, amplitudes)


def group_starts(curve: ControlCurve, rest_length: float) -> Floats:
    """(groups + 1,) the shortening over the rest length at which each group starts, then at which the last is full."""
    groups = np.arange(len(curve.groups))
    low, high = np.full(len(groups), 1.0 - TAUT), np.ones(len(groups))
    for _ in range(_ROUNDS):
        tried = np.linspace(low, high, _PARTS + 1)
        lengths = np.full(tried.size, rest_length)
        shortenings = curve.shortening((1.0 - tried.reshape(-1)) * lengths, lengths)
        full = curve.absorb(shortenings, lengths).rising.reshape(tried.shape) > groups
        full[-1] = True  # the last row stands for groups that are never full
        first = np.argmax(full[1:], axis=0)
        low, high = tried[first, groups], tried[first + 1, groups]
    return np.concatenate([[1.0 - TAUT], high])


def fitting_compressible(curve: ControlCurve, lengths: Iterable[tuple[Floats, Floats]]) -> float:
    """The `compressible`, 0 to 1, with which all bumps are just full at the greatest shortening.

    `lengths` has for each clip (frames,) current lengths l' and (frames,) rest lengths l, scene units.
    """
    greatest: dict[float, float] = {}  # shortening over the rest length, by rest length: most clips share one
    for distances, rest_lengths in lengths:
        most = int(np.argmin(distances / rest_lengths))
        length, reached = float(rest_lengths[most]), TAUT - float(distances[most] / rest_lengths[most])
        greatest[length] = max(greatest.get(length, 0.0), reached)
    incompressible = dataclasses.replace(curve, compressible=0.0)
    fitting = 0.0
    for length, reached in greatest.items():
        if reached > 0:
            full = float(group_starts(incompressible, length)[-1]) - (1.0 - TAUT)
            asked_full, asked = curve.asked(np.array([full, reached])).tolist()
            fitting = max(fitting, 1.0 - asked_full / asked)
    return fitting


def weights_of(curve: ControlCurve, amplitudes: Floats) -> Floats:
    """(frames, groups, modes) amplitudes over the greatest; 0 for groups that never rise."""
    greatest = curve.greatest_amplitudes
    return amplitudes / np.where(greatest != 0, greatest, 1.0)
