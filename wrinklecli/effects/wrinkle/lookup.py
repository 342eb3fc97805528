"""A control curve as tables of numbers, for players that look weights up instead of running the method.

If the rest length is constant, heights depend on one number, and a table of weights is enough (`tabulate_weights`).
Otherwise heights depend on two numbers, distance and rest length, and straight lines between several such tables are
wrong where a group of bumps starts, as heights start like a square root there, and the start moves. (An error of 1/256
would take about a hundred tables.) But two functions of one number describe a bump: the shortening that fills it
depends on the distance alone, and its height / (chord + shortening) on the ratio of these two. So these functions are
tabulated (`tabulate_curve`), and the player distributes the shortening over the bumps itself.

The paper has no tables. They work because profiles are homogeneous: if chord and shortening are twice as long, a bump
is twice as high.
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

# First tolerance of a bump's capacity, relative.
_CAPACITY_ERROR = 1e-3
# First tolerance of a bump's height, relative to the greatest.
_RISE_ERROR = 1e-3
# Factor by which the tables get finer until the weights are right,
_FINER = 4.0
# and the most times that this happens.
_MOST_TRIES = 12
# Part of the error between rows for the points at which the curve is sampled.
_OF_POINTS = 0.25
# First rows after a group's start, over the way to the next group's: heights like a root are 1/2, 1/4, 1/8 … there.
_BEHIND = 0.25 ** np.arange(1, 9)
# Least step between two rows, shortening over the rest length.
_LEAST_STEP = 1e-6
# Decimals of weights that count, as the weight of a full bump changes in its last bits, which need no rows.
_DECIMALS = 7
# Rows of a table before refinement.
_FIRST_ROWS = 17
# Most times that an interval between two rows is halved.
_HALVINGS = 12
# Least part of a bump that is computed, in place of 0, as heights are divided by its root.
_LEAST_PART = 1e-12
# Rest lengths at which the tables are checked, at most,
_MOST_LENGTHS = 33
# and at least.
_LEAST_LENGTHS = 5
# Starts of groups of bumps over all these lengths, which decides their number in between.
_CHECKED_GROUPS = 200
# Places of the checks over the way from one group's start to the next; heights begin like the root of these.
_CHECKED_SHARES = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 128)])


def tabulate_weights(curve: ControlCurve, weights: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Tabulate weights against shortening at the nominal rest length, as coarsely as `TABLE_ERROR` allows.

    Heights start like a square root, each group of bumps where the one before it is full, and rows are dense there. A
    dozen rows are enough for a group; 65 at equal steps of the height were off by 1/15 for a polyline with details.

    Args:
        curve: The control curve.
        weights: From (rows, groups, modes) weights of the curve to (rows, targets) weights of targets.

    Returns:
        (rows,) 1 - distance / rest length, sorted from 0 to 1, and (rows, targets) weights, straight between rows.
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
        longest: The greatest rest length, scene units.
        mix: (targets, groups · modes) weights of targets for the curve's weights; by default these themselves.
        positive: True if weights below 0 are 0.
    """
    greatest = curve.greatest_amplitudes.reshape(-1)
    own = np.eye(len(greatest)) if mix is None else mix
    lengths, distances = _where_to_check(curve, shortest, longest)
    exact = weights_of(curve, curve.follow(distances, lengths)[0]).reshape(len(lengths), -1)
    wanted = np.maximum(exact @ own.T, 0.0 if positive else -np.inf)
    # A relative error e of the capacity moves the start of a group behind m bumps by m e of a bump. As weights start
    # like a square root, the error of the weight there is √(m e).
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
    """(rows,) distances of the anchors and a bump's capacities there; none if bumps have no greatest height."""

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
    """Rows of a table so dense that straight lines are right halfway between, and its (rows, columns) values.

    Args:
        function: (rows,) to (rows, columns).
        rows: The first rows, sorted.
        tolerance: Greatest error, relative to the value there if `relative`, else to the greatest value.
        relative: See `tolerance`.
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
