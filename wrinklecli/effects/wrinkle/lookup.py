"""A control curve as tables of numbers, for players that look weights up instead of running the method.

Where the rest length is constant, heights depend on one number, and a table of weights will do (`tabulate_weights`).
Otherwise they depend on two, distance and rest length, and straight lines between several such tables are wrong
where a group of bumps starts: heights start like a square root there, and the start moves. (To be right to 1/256
would take about a hundred tables.) But two functions of one number say all of one bump: what it takes when full
depends on the distance alone, and its height, as a share of chord plus shortening, on the ratio of these two. So these
functions are tabulated (`tabulate_curve`), and the player distributes the shortening over the bumps itself.

Not in the paper. It works since the profiles are homogeneous: with chord and shortening twice as long, a bump is twice
as high.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from wrinklecli.drive.lag import TAUT
from wrinklecli.drive.table import TABLE_ERROR, CurveTable
from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.effects.wrinkle.weights import group_starts, weights_at, weights_of
from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.piecewise import key_points

# Tolerances of the two tables to begin with, as shares: of what a bump takes and of its height.
_CAPACITY_ERROR = 1e-3
_RISE_ERROR = 1e-3
# How much finer the tables get, and how often at most, until the weights are right.
_FINER = 4.0
_MOST_TRIES = 12
# Share of the error between rows that is left to the points at which the curve is sampled.
_OF_POINTS = 0.25
# First rows after a group's start, as shares of the way to the next: heights like a root are 1/2, 1/4, 1/8 … there.
_BEHIND = 0.25 ** np.arange(1, 9)
# Between two rows, at least.
_LEAST_STEP = 1e-6
# Decimals of weights that count: the weight of a full bump moves in its last bits, which need no rows.
_DECIMALS = 7
# Rows of a table to begin with, and how often an interval between two is halved at most.
_FIRST_ROWS = 17
_HALVINGS = 12
# Least part of a bump that is computed, in place of 0, as heights are divided by its root.
_LEAST_PART = 1e-12
# Rest lengths at which the tables are checked: at most and at least.
_MOST_LENGTHS = 33
_LEAST_LENGTHS = 5
# In between, as many as give so many starts of groups of bumps over all lengths.
_CHECKED_GROUPS = 200
# Where they are checked, as shares of the way from one group's start to the next: heights begin like the root of these.
_CHECKED_SHARES = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 128)])


def tabulate_weights(curve: ControlCurve, weights: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Tabulate weights against shortening at the nominal rest length, as coarsely as `TABLE_ERROR` allows.

    Heights start like a square root, each group of bumps where the one before it is full: there rows lie close
    together. A dozen do for a group; 65 at equal steps of the height were off by 1/15 where a polyline has details.

    Args:
        curve: The control curve.
        weights: Those of the targets, (rows, targets), from the curve's own, (rows, groups, modes).

    Returns:
        (rows,) 1 - distance / rest length from 0 to 1, rising, and (rows, targets) weights; straight lines between.
    """

    def signal(shortenings: Floats) -> Floats:
        return np.round(weights(weights_at(curve, shortenings)), _DECIMALS)

    starts = group_starts(curve, curve.rest_length)
    behind = starts[:-1] + (starts[1:] - starts[:-1]) * _BEHIND[:, None]
    grid = distinct_values(np.concatenate([np.linspace(0.0, 1.0, _FIRST_ROWS), starts, behind.reshape(-1)]))
    most = TABLE_ERROR * np.abs(signal(grid)).max(initial=0.0)
    bounds = {"tolerance": _OF_POINTS * most, "thinning": (1 - _OF_POINTS) * most}
    points, rows = key_points(grid, signal, **bounds, gap=_LEAST_STEP, step=_LEAST_STEP)
    return points[rows], signal(points[rows])


def tabulate_curve(
    curve: ControlCurve, shortest: float, longest: float, *, mix: Floats | None = None, positive: bool = False
) -> CurveTable:
    """Tabulate a curve for a range of rest lengths, as finely as `TABLE_ERROR` asks for.

    Args:
        curve: The control curve.
        shortest: The least rest length, scene units.
        longest: The greatest.
        mix: (targets, groups · modes) weights of targets for the curve's own weights; those themselves if left out.
        positive: Whether weights below 0 are 0.
    """
    greatest = curve.greatest_amplitudes.reshape(-1)
    own = np.eye(len(greatest)) if mix is None else mix
    lengths, distances = _where_to_check(curve, shortest, longest)
    exact = weights_of(curve, curve.follow(distances, lengths)[0]).reshape(len(lengths), -1)
    wanted = np.maximum(exact @ own.T, 0.0 if positive else -np.inf)
    # A capacity that is wrong by a share e moves the start of a group behind m bumps by m e of a bump, which at its
    # start, like a square root, is a weight of √(m e).
    before = float(curve.sizes[:-1].sum())
    tolerance = TABLE_ERROR**2 / before if before else _CAPACITY_ERROR
    finer = 1.0
    for _ in range(_MOST_TRIES):
        at, capacities = _capacity_rows(curve, TAUT * longest, tolerance / finer)
        parts, rises = _rise_rows(curve, _RISE_ERROR / finer)
        table = CurveTable(
            taut=TAUT,
            compressible=curve.compressible,
            intervals=curve.interval_count,
            bumps=tuple(float(size) for size in curve.sizes),
            distances=at,
            capacities=capacities,
            parts=parts,
            rises=rises,
            mix=own / np.where(greatest != 0, greatest, np.inf),
            positive=positive,
        )
        error = np.abs(table.at(distances, lengths) - wanted).max(initial=0.0)
        if error <= TABLE_ERROR * np.abs(wanted).max(initial=0.0):
            return table
        finer *= _FINER
    raise ArithmeticError(f"a table of {len(table.distances)} and {len(table.parts)} rows is off by {error:.3g}")


def _capacity_rows(curve: ControlCurve, longest: float, tolerance: float) -> tuple[Floats, Floats]:
    """(rows,) distances of the anchors and what one bump takes there; none where bumps have no greatest height."""

    def capacities(distances: Floats) -> Floats:
        return curve.profile.capacity(distances / curve.interval_count, curve.limit)[:, None]

    if np.isinf(curve.max_height):
        return np.zeros(0), np.zeros(0)
    rows, values = _rows(capacities, np.linspace(0.0, longest, _FIRST_ROWS), tolerance, relative=True)
    return rows, values[:, 0]


def _rise_rows(curve: ControlCurve, tolerance: float) -> tuple[Floats, Floats]:
    """(rows,) parts and (rows, modes) rises, as `CurveTable` has them."""

    def rises(parts: Floats) -> Floats:
        inside = np.maximum(parts, _LEAST_PART)
        found: Floats = curve.profile.amplitudes(inside, (1.0 - inside) / 2.0, np.inf) / np.sqrt(inside)[:, None]
        return found

    return _rows(rises, np.linspace(0.0, 1.0, _FIRST_ROWS), tolerance, relative=False)


def _rows(
    function: Callable[[Floats], Floats], rows: Floats, tolerance: float, *, relative: bool
) -> tuple[Floats, Floats]:
    """Rows of a table so close that straight lines are right halfway between, and (rows, columns) its values.

    Args:
        function: (rows,) to (rows, columns).
        rows: To begin with, rising.
        tolerance: Greatest error, a share of the value there if `relative`, else of the greatest.
        relative: Which.
    """
    values = function(rows)
    for _ in range(_HALVINGS):
        middles = (rows[1:] + rows[:-1]) / 2.0
        between = function(middles)
        error = np.abs(between - (values[1:] + values[:-1]) / 2.0)
        size = np.abs(between) if relative else np.abs(values).max(axis=0)
        fresh = (error > tolerance * size).any(axis=1)
        if not fresh.any():
            break
        places = np.flatnonzero(fresh) + 1
        rows, values = np.insert(rows, places, middles[fresh]), np.insert(values, places, between[fresh], axis=0)
    return rows, values


def _where_to_check(curve: ControlCurve, shortest: float, longest: float) -> tuple[Floats, Floats]:
    """(points,) rest lengths and distances, close behind the start of every group of bumps."""
    count = int(np.clip(_CHECKED_GROUPS // len(curve.groups), _LEAST_LENGTHS, _MOST_LENGTHS))
    lengths = np.linspace(shortest, longest, count if longest > shortest else 1)
    starts = [(1.0 - each) * lengths for each in np.stack([group_starts(curve, length) for length in lengths], axis=1)]
    distances = [high + _CHECKED_SHARES[:, None] * (low - high) for high, low in pairwise(starts)]
    distances.append(np.linspace(0.0, 1.0, len(_CHECKED_SHARES))[:, None] * starts[-1])
    together = np.concatenate(distances)
    return np.broadcast_to(lengths, together.shape).reshape(-1), together.reshape(-1)
