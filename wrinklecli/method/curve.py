"""The control curve: how a tool's bumps share the shortening of its segment, and so how high each rises.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve: it keeps its length while its ends approach, and strategies order the bumps. What one
bump makes of its share is its `profile`.

Differs from the paper: `max_height` ends a bump's rise, in every strategy; what no bump can take is returned as
unabsorbed.

Intervals are the current x = l'/n, not the rest ones: n·x + ΣD + unabsorbed = l' + d. So a full bump keeps
its height and absorbs more as x shrinks. Heights grow with d, but for one case that is the paper's own: a
polyline with details, its chord below about half its length, trades its highest knot for lower ones.
"""

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np

from wrinklecli.method.profile import (
    PolylineProfile,
    Profile,
    SmoothProfile,
    plan_polyline,
    plan_smooth,
    polyline_heights,
    reachable_heights,
)
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values

Strategy = Literal["everywhere", "origin", "both_ends"]

TAUT = 1 - 1e-5
"""Part of the rest length below which wrinkles start: rounding noise of 1e-7 alone would raise 6e-5 l."""

# Rows of a path of weights, for each group of bumps, and behind the last, where only details of a polyline still move.
_PATH_ROWS = 65
_FULL_ROWS = 8
# Where a group of bumps starts is found to the last bits of a float by taking one of so many parts, so often. (Halves
# take three times as long: a curve answers for a hundred lengths nearly as fast as for one.)
_PARTS = 64
_ROUNDS = 9


@dataclass(frozen=True, slots=True, eq=False)
class ControlCurve:
    """A tool's control curve, planned once, evaluated for all frames at a time.

    Bumps that always rise together form a group; its height at u is Σ amplitudes[mode] · shapes[mode](u).

    Attributes:
        bumps: Number of bumps B.
        gap: Flat intervals between neighbouring bumps.
        strategy: In which order bumps rise.
        details: Share of a bump's shortening that goes to each finer level; their sum is below 1.
        max_height: Greatest height of a bump's highest point, details included, scene units; inf for none.
        rest_length: The tool's rest length, scene units.
        greatest_rest_length: The greatest that keyed rest lengths reach, scene units.
        interval_count: n = 2B + gap (B − 1).
        groups: Bump indices of each group, in rising order.
        profile: The shape of one bump, precomputed.
        greatest_amplitudes: (groups, modes) bounds of |amplitude|, scene units: reached at full shortening or
            at `max_height`; exactly 0 for a group that never rises. Amplitudes of further modes, which only a
            polyline with details has, can be negative; such modes' bounds are sampled, to 2 %.
    """

    bumps: int
    gap: int
    strategy: Strategy
    details: tuple[float, ...]
    max_height: float
    rest_length: float
    greatest_rest_length: float
    interval_count: int
    groups: tuple[tuple[int, ...], ...]
    profile: "SmoothProfile | PolylineProfile"
    greatest_amplitudes: Floats

    @property
    def bump_starts(self) -> Floats:
        """(bumps,) u where each bump starts; it spans 2/n."""
        return np.arange(self.bumps) * (2 + self.gap) / self.interval_count

    def shortening(self, distances: Floats, rest_lengths: Floats) -> Floats:
        """Same shape, d = max((1 − 1e-5) l − l', 0): neither stretching nor rounding noise makes wrinkles."""
        return np.maximum(TAUT * rest_lengths - distances, 0.0)

    def absorb(self, shortenings: Floats, rest_lengths: Floats) -> tuple[Floats, Floats]:
        """Distribute shortenings over the bumps by the tool's strategy.

        Args:
            shortenings: (frames,) d, scene units, from 0 to the rest length.
            rest_lengths: (frames,) l, scene units.

        Returns:
            (frames, bumps) shortening of each bump, and (frames,) what none could take: ≥ 0, and exactly 0
            where some bump is not full.
        """
        rising, share, capacities, unabsorbed = self._fill(shortenings, self._intervals(rest_lengths, shortenings))
        shares = np.zeros((len(shortenings), self.bumps))
        for number, group in enumerate(self.groups):
            full = np.where(number < rising, capacities, 0.0)
            shares[:, group] = np.where(number == rising, share, full)[:, None]
        return shares, unabsorbed

    def full_groups(self, shortenings: Floats, rest_lengths: Floats) -> Ints:
        """(frames,) how many groups are full, in the order in which they rise; arguments as of `absorb`."""
        return self._fill(shortenings, self._intervals(rest_lengths, shortenings))[0]

    def _fill(self, shortenings: Floats, intervals: Floats) -> tuple[Ints, Floats, Floats, Floats]:
        """What `absorb` gives, in terms of groups: in a frame all are full, then one may be rising, then all flat.

        Returns:
            (frames,) the index of the rising group, or the number of groups where all are full; (frames,) shortening of
            each of its bumps, (frames,) that of a full bump, and (frames,) what none could take.
        """
        capacities = self.profile.capacity(intervals, self.max_height)
        sizes, before = _sizes(self.groups)
        rising = np.zeros(len(shortenings), np.intp)
        for bumps in before[1:]:
            rising += shortenings > bumps * capacities
        # Capacities may be infinite, but not where they are full.
        rest = np.maximum(shortenings - before[rising] * np.minimum(capacities, shortenings), 0.0)
        is_full = rising == len(self.groups)
        share = np.where(is_full, 0.0, rest / sizes[rising])
        return rising, share, capacities, np.where(is_full, rest, 0.0)

    def amplitudes(self, bump_shortenings: Floats, rest_lengths: Floats, unabsorbed: Floats | float = 0.0) -> Floats:
        """Amplitudes of each group's modes.

        Args:
            bump_shortenings: (frames, bumps) from `absorb`, scene units.
            rest_lengths: (frames,) l, scene units.
            unabsorbed: (frames,) from `absorb`, scene units. Of a polyline with details it shifts the lower
                knots of full bumps; elsewhere it changes nothing.

        Returns:
            (frames, groups, modes), scene units.
        """
        first = [group[0] for group in self.groups]
        intervals = self._intervals(rest_lengths, bump_shortenings.sum(axis=1) + unabsorbed)[:, None]
        return self.profile.amplitudes(bump_shortenings[:, first], intervals, self.max_height)

    def follow(self, distances: Floats, rest_lengths: Floats) -> tuple[Floats, Floats]:
        """All steps in one: (frames, groups, modes) amplitudes and (frames,) unabsorbed lengths, scene units.

        Args:
            distances: (frames,) current lengths l', scene units.
            rest_lengths: (frames,) rest lengths l, scene units.
        """
        shortenings = self.shortening(distances, rest_lengths)
        acting = np.flatnonzero(shortenings != 0)
        amplitudes = np.zeros((len(shortenings), *self.greatest_amplitudes.shape))
        unabsorbed = np.zeros(len(shortenings))
        if len(acting):
            taken = shortenings[acting]
            intervals = self._intervals(rest_lengths[acting], taken)
            rising, share, capacities, unabsorbed[acting] = self._fill(taken, intervals)
            full, partly = np.flatnonzero(rising > 0), np.flatnonzero(rising < len(self.groups))
            if len(full):
                heights = np.zeros((len(shortenings), amplitudes.shape[2]))
                heights[acting[full]] = self.profile.fullest(capacities[full], intervals[full], self.max_height)
                counts = np.zeros(len(shortenings), np.intp)
                counts[acting] = rising
                # Multiplied, since to pick those that are full takes three times as long.
                for number in range(rising.max()):
                    np.multiply(heights, (counts > number)[:, None], out=amplitudes[:, number])
            if len(partly):
                partial = self.profile.amplitudes(share[partly], intervals[partly], self.max_height)
                amplitudes[acting[partly], rising[partly]] = partial
        return amplitudes, unabsorbed

    def shapes(self, us: Floats) -> Floats:
        """Heights per unit of amplitude.

        Args:
            us: (points,) positions along the segment; 0 is the origin, 1 the target.

        Returns:
            (groups, modes, points), 0 outside the group's bumps.
        """
        taus = (us - self.bump_starts[:, None]) * (self.interval_count / 2)
        inside = (taus > 0) & (taus < 1)
        of_bumps = self.profile.shapes(np.clip(taus, 0.0, 1.0)) * inside
        return np.stack([of_bumps[:, group].sum(axis=1) for group in self.groups])

    def rises(self, us: Floats, amplitudes: Floats) -> Floats:
        """Heights of the curve where every frame has points of its own; `shapes` where they share them.

        Args:
            us: (points, frames) positions along the segment.
            amplitudes: (frames, groups, modes), scene units.

        Returns:
            (points, frames), scene units; 0 outside all bumps.
        """
        # Bumps lie side by side: a point is in one at the most.
        bumps = np.clip(us * self.interval_count / (2 + self.gap), 0, self.bumps - 1).astype(np.intp)
        taus = (us - self.bump_starts[bumps]) * (self.interval_count / 2)
        inside = (taus > 0) & (taus < 1)
        at = np.flatnonzero(inside)
        frames = np.broadcast_to(np.arange(us.shape[1]), us.shape).reshape(-1)[at]
        acting = amplitudes[frames, self._groups_of_bumps()[bumps.reshape(-1)[at]]]
        heights = np.zeros(us.shape)
        heights[inside] = np.sum(acting.T * self.profile.shapes(taus.reshape(-1)[at]), axis=0)
        return heights

    def heights(self, amplitudes: Floats) -> Floats:
        """(frames, bumps) height of each bump's highest point, details included, scene units.

        Args:
            amplitudes: (frames, groups, modes), scene units.
        """
        return self.profile.highest(amplitudes)[:, self._groups_of_bumps()]

    def lengths(self, amplitudes: Floats, distances: Floats) -> Floats:
        """(frames,) arc length of the control curve, scene units: l' + d − unabsorbed, if all is right.

        Args:
            amplitudes: (frames, groups, modes), scene units.
            distances: (frames,) current lengths l', scene units.
        """
        intervals = (distances / self.interval_count)[:, None]
        excess = self.profile.excess(amplitudes, intervals)[:, self._groups_of_bumps()]
        return np.asarray(distances + excess.sum(axis=1), np.float64)

    def knots(
        self, bump_shortenings: Floats, rest_lengths: Floats, unabsorbed: Floats | float = 0.0
    ) -> tuple[Floats, Floats]:
        """The exact discrete curve of `profile: polyline`, before it is reduced to modes.

        Args:
            bump_shortenings: (frames, bumps) from `absorb`, scene units.
            rest_lengths: (frames,) l, scene units.
            unabsorbed: (frames,) from `absorb`, scene units.

        Returns:
            (knots,) positions u from 0 to 1, rising, and (frames, knots) heights, scene units, straight in
            between.

        Raises:
            ValueError: The profile is smooth and has no knots.
        """
        if isinstance(self.profile, SmoothProfile):
            raise ValueError("a smooth profile has no knots")
        intervals = self._intervals(rest_lengths, bump_shortenings.sum(axis=1) + unabsorbed)[:, None]
        per_bump = polyline_heights(self.details, bump_shortenings, intervals)
        per_interval = 2 ** len(self.details)
        # Whole numbers of the finest step, so that bumps without a gap share their end knot exactly.
        starts = np.arange(self.bumps) * (2 + self.gap) * per_interval
        steps = starts[:, None] + np.arange(2 * per_interval + 1)
        knots, places = np.unique(steps, return_inverse=True)
        heights = np.zeros((len(per_bump), len(knots)))
        heights[:, places.reshape(-1)] = per_bump.reshape(len(per_bump), -1)
        return knots / (self.interval_count * per_interval), heights

    def _intervals(self, rest_lengths: Floats, shortenings: Floats) -> Floats:
        """(frames,) x = l'/n; where d = 0, l' may be longer, but nothing rises there."""
        return np.maximum(TAUT * rest_lengths - shortenings, 0.0) / self.interval_count

    def _groups_of_bumps(self) -> Ints:
        """(bumps,) index of the group of each bump."""
        indices = np.zeros(self.bumps, np.intp)
        for index, group in enumerate(self.groups):
            indices[list(group)] = index
        return indices


def plan_curve(
    *,
    bumps: int,
    gap: int,
    strategy: Strategy,
    details: tuple[float, ...],
    profile: Profile,
    max_height: float,
    rest_length: float,
    greatest_rest_length: float | None = None,
) -> ControlCurve:
    """Plan a tool's control curve.

    Args:
        bumps: Number of bumps, ≥ 1.
        gap: Flat intervals between neighbouring bumps, ≥ 0.
        strategy: In which order bumps rise.
        details: Shares of the finer levels, each > 0, their sum < 1.
        profile: `smooth` or `polyline`.
        max_height: Greatest height of a bump's highest point, scene units, ≥ 0; inf for none.
        rest_length: The tool's rest length, scene units, > 0.
        greatest_rest_length: The greatest that keyed rest lengths reach, scene units; else `rest_length`.
    """
    interval_count = 2 * bumps + gap * (bumps - 1)
    groups = _group(bumps, strategy)
    greatest = max(rest_length, greatest_rest_length or 0.0)
    shape: SmoothProfile | PolylineProfile
    if profile == "smooth":
        shape = plan_smooth(details)
    else:
        samples = reachable_heights(details, max_height, TAUT * greatest, interval_count, len(groups[0]))
        shape = plan_polyline(details, samples)
    curve = ControlCurve(
        bumps=bumps,
        gap=gap,
        strategy=strategy,
        details=details,
        max_height=max_height,
        rest_length=rest_length,
        greatest_rest_length=greatest,
        interval_count=interval_count,
        groups=groups,
        profile=shape,
        greatest_amplitudes=np.zeros((len(groups), 1)),
    )
    # Heights grow with d/l, and at the same d/l with l: the greatest are those where the ends meet.
    lengths = np.array([greatest])
    shares, unabsorbed = curve.absorb(TAUT * lengths, lengths)
    bounds = curve.amplitudes(shares, lengths, unabsorbed)[0]
    if isinstance(shape, PolylineProfile):
        # A mode may turn round on its way, so its end is no bound; its samples are.
        rises = shares[0, [group[0] for group in groups]] > 0
        bounds = np.where(rises[:, None], np.maximum(shape.sampled_amplitudes, np.abs(bounds)), 0.0)
    return dataclasses.replace(curve, greatest_amplitudes=bounds)


@lru_cache(maxsize=64)
def _sizes(groups: tuple[tuple[int, ...], ...]) -> tuple[Floats, Floats]:
    """(groups + 1,) number of bumps of each group, and of all before it; after the last, 1 and that of all."""
    sizes = np.array([*map(len, groups), 1], np.float64)
    return sizes, np.append(0.0, np.cumsum(sizes[:-1]))


def _group(bumps: int, strategy: Strategy) -> tuple[tuple[int, ...], ...]:
    """Bumps that always rise together, in rising order."""
    if strategy == "everywhere":
        return (tuple(range(bumps)),)
    if strategy == "origin":
        return tuple((bump,) for bump in range(bumps))
    pairs = tuple((bump, bumps - 1 - bump) for bump in range(bumps // 2))
    return pairs if bumps % 2 == 0 else (*pairs, (bumps // 2,))


def weight_path(curve: ControlCurve) -> Floats:
    """(rows, groups, modes) weights as the nominal rest length shortens to nothing, in small steps of the heights."""
    starts = group_starts(curve)
    steps = np.linspace(0.0, 1.0, _PATH_ROWS) ** 2  # heights start like a square root
    rising = [low + (high - low) * steps for low, high in pairwise(starts)]
    rows = distinct_values(np.concatenate([[0.0], *rising, np.linspace(starts[-1], 1.0, _FULL_ROWS)]))
    return weights_at(curve, rows)


def weights_at(curve: ControlCurve, shortenings: Floats) -> Floats:
    """(rows, groups, modes) weights at (rows,) shortenings over the nominal rest length, 1 - distance / rest length."""
    lengths = np.full(len(shortenings), curve.rest_length)
    amplitudes, _ = curve.follow((1.0 - shortenings) * lengths, lengths)
    return weights_of(curve, amplitudes)


def group_starts(curve: ControlCurve) -> Floats:
    """(groups + 1,) the shortening over the nominal rest length at which each group starts, and the last is full."""
    groups = np.arange(len(curve.groups))
    low, high = np.full(len(groups), 1.0 - TAUT), np.ones(len(groups))
    for _ in range(_ROUNDS):
        tried = np.linspace(low, high, _PARTS + 1)
        lengths = np.full(tried.size, curve.rest_length)
        shortenings = curve.shortening((1.0 - tried.reshape(-1)) * lengths, lengths)
        full = curve.full_groups(shortenings, lengths).reshape(tried.shape) > groups
        full[-1] = True  # the last stands for what is never full
        first = np.argmax(full[1:], axis=0)
        low, high = tried[first, groups], tried[first + 1, groups]
    return np.concatenate([[1.0 - TAUT], high])


def weights_of(curve: ControlCurve, amplitudes: Floats) -> Floats:
    """(frames, groups, modes) amplitudes as shares of the greatest; 0 for what never rises."""
    greatest = curve.greatest_amplitudes
    return amplitudes / np.where(greatest != 0, greatest, 1.0)
