"""The response of a control curve: the weights of its shapes against its shortening, exactly and as a table.

A weight is an amplitude over the greatest one, and the weight of the morph target that has the shape. The exact
response makes the table, by which bakes, players and previews look weights up; besides, the proof alone asks it.

Profiles are homogeneous: if chord and shortening are twice as long, a bump is twice as high. So weights over the rest
length depend on one number, 1 - distance / rest length. The paper has no tables.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from wrinklecli.drive.segment import Lengths
from wrinklecli.drive.stored import TAUT, stored
from wrinklecli.drive.table import ROWS, TABLE_ERROR, Table
from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.piecewise import key_points

# Rows after the last group is full, when only details of a polyline still move.
_FULL_ROWS = 8
# The start of a group of bumps is found to the last bits of a float by choosing one of so many parts. (Halves take
# three times as long, since a curve takes hardly longer for a hundred lengths than for one.)
_PARTS = 64
# Rounds of that choice.
_ROUNDS = 9


# Part of the error between rows for the points at which the curve is sampled.
_OF_POINTS = 0.25
# Least step between two rows, shortening over the rest length: about that of float32 values near 1.
_LEAST_STEP = 1e-7
# Decimals of weights that count, as the weight of a full bump changes in its last bits, which need no rows.
_DECIMALS = 7
# Rows of a table before refinement.
_FIRST_ROWS = 17


@dataclass(frozen=True, slots=True, eq=False)
class CurveResponse:
    """The exact weights of a tool's targets, from its control curve.

    Attributes:
        curve: The control curve.
        columns: (shapes,) numbers of the curve's shapes, group by group and mode by mode, that move a vertex.
        mix: (shapes, targets) factors from their weights to those of other shapes that an engine's limits ask for; None
            if the shapes are the control curve's.
    """

    curve: ControlCurve
    columns: Ints
    mix: Floats | None = None

    def at(self, shortenings: Floats) -> Floats:
        """(rows, targets) weights at (rows,) shortenings over the nominal rest length, 1 - distance / rest length."""
        return self.mixed(weights_at(self.curve, shortenings))

    def mixed(self, weights: Floats) -> Floats:
        """(rows, targets) weights from (rows, groups, modes) those of the curve's shapes."""
        own = weights.reshape(len(weights), -1)[:, self.columns]
        return own if self.mix is None else own @ self.mix

    def weights(self, reading: Lengths) -> Floats:
        """(frames, targets) weights at the measurements of a segment."""
        distances = np.where(reading.active, reading.distances, reading.rest_lengths)
        amplitudes, _ = self.curve.follow(distances, reading.rest_lengths)
        return self.mixed(weights_of(self.curve, amplitudes))

    def table(self, error: float = TABLE_ERROR) -> Table:
        """Tabulate the weights, right to an error over the greatest weight."""
        if self.mix is None and error >= TABLE_ERROR:
            return curve_table(self.curve).mapped(lambda weights: weights[:, self.columns])
        return _tabulated(self, error)


def _tabulated(response: CurveResponse, error: float) -> Table:
    """Tabulate a response as coarsely as an error over its greatest weight allows.

    Heights start like a square root, each group of bumps where the one before it is full, and rows are dense there.
    Values are linear between rows, which are sorted from 0 to 1.
    """

    def signal(shortenings: Floats) -> Floats:
        return np.round(response.at(shortenings), _DECIMALS)

    starts = group_starts(response.curve)
    # Heights like a root are 1/2, 1/4, 1/8 … there, down to the error: a line from 0 is off by a quarter of them.
    halved = 0.25 ** np.arange(1, math.ceil(-math.log2(error)) + 1)
    behind = starts[:-1] + (starts[1:] - starts[:-1]) * halved[:, None]
    rows = np.concatenate([np.linspace(0.0, 1.0, _FIRST_ROWS), starts, behind.reshape(-1)])
    # Rows must differ in the digits that extras hold, too.
    grid = distinct_values(rows)
    grid = grid[np.diff(stored(grid), prepend=-1.0) > 0]
    most = error * np.abs(signal(grid)).max(initial=0.0)
    bounds = {"tolerance": _OF_POINTS * most, "thinning": (1 - _OF_POINTS) * most}
    points, keys = key_points(grid, signal, **bounds, gap=_LEAST_STEP, step=_LEAST_STEP)
    return Table("shortenings", points[keys], signal(points[keys]))


def looked_up(curve: ControlCurve, lengths: Lengths) -> Floats:
    """(frames, groups, modes) amplitudes at the measurements of a segment, scene units, by the curve's table."""
    greatest = curve.greatest_amplitudes
    table = curve_table(curve)
    return table.weights(lengths).reshape(-1, *greatest.shape) * greatest


@lru_cache(maxsize=256)
def curve_table(curve: ControlCurve) -> Table:
    """The table of the weights of all shapes of a curve, made once."""
    return _tabulated(CurveResponse(curve, np.arange(curve.greatest_amplitudes.size)), TABLE_ERROR)


def weight_path(curve: ControlCurve) -> Floats:
    """(rows, groups, modes) weights as the greatest rest length shortens to nothing, in small steps of the heights."""
    starts = group_starts(curve)
    steps = np.linspace(0.0, 1.0, ROWS) ** 2  # heights start like a square root
    rising = [low + (high - low) * steps for low, high in pairwise(starts)]
    rows = distinct_values(np.concatenate([[0.0], *rising, np.linspace(starts[-1], 1.0, _FULL_ROWS)]))
    return curve.longest * weights_at(curve, rows)


def weights_at(curve: ControlCurve, shortenings: Floats) -> Floats:
    """(rows, groups, modes) weights at (rows,) shortenings over the nominal rest length, 1 - distance / rest length."""
    lengths = np.full(len(shortenings), curve.rest_length)
    amplitudes, _ = curve.follow((1.0 - shortenings) * lengths, lengths)
    return weights_of(curve, amplitudes)


@lru_cache(maxsize=256)
def group_starts(curve: ControlCurve) -> Floats:
    """(groups + 1,) the shortening over the rest length at which each group starts, then at which the last is full."""
    groups = np.arange(len(curve.groups))
    low, high = np.full(len(groups), 1.0 - TAUT), np.ones(len(groups))
    for _ in range(_ROUNDS):
        tried = np.linspace(low, high, _PARTS + 1)
        lengths = np.full(tried.size, curve.rest_length)
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
    reached = max((TAUT - float((distances / rest).min()) for distances, rest in lengths), default=0.0)
    if reached <= 0.0:
        return 0.0
    full = float(group_starts(replace(curve, compressible=0.0))[-1]) - (1.0 - TAUT)
    asked_full, asked = curve.asked(np.array([full, reached])).tolist()
    return float(max(0.0, 1.0 - asked_full / asked))


def weights_of(curve: ControlCurve, amplitudes: Floats) -> Floats:
    """(frames, groups, modes) amplitudes over the greatest; 0 for groups that never rise."""
    greatest = curve.greatest_amplitudes
    return amplitudes / np.where(greatest != 0, greatest, 1.0)
