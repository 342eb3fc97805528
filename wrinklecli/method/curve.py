"""The control curve: how a tool's bumps share the shortening of its segment, and so how high each rises.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve: it keeps its length while its ends approach, and strategies order the bumps. What one
bump makes of its share is its `profile`.

Differs from the paper: `max_height` ends a bump's rise, in every strategy; what no bump can take is returned as
unabsorbed. And the tissue, which the paper says is compressible to a small extent, may take a share c of every
shortening itself: it is squeezed along the segment, with the bumps that the rest of the shortening makes.

The rest length is l, the current distance of the anchors l', the shortening d = (1 - c) (l - l'), and D what one bump
takes of it. The curve has n control intervals, two for each bump, of the current length x = (l - d)/n, not the rest
one's: n·x + ΣD + unabsorbed = l. So a full bump keeps its height and absorbs more as x shrinks. Heights grow with d,
but for one case that is the paper's own: a polyline with details, its chord below about half its length, trades its
highest knot for lower ones.
"""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from wrinklecli.method.profile import (
    PolylineProfile,
    Profile,
    SmoothProfile,
    plan_polyline,
    plan_smooth,
    reachable_heights,
    warped,
)
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values

Strategy = Literal["everywhere", "origin", "both_ends"]

TAUT = 1 - 1e-5
"""Part of the rest length below which wrinkles start: rounding noise of 1e-7 alone would raise 6e-5 l."""

# Rows of `weight_path` for each group of bumps, and after the last is full, when only details of a polyline still move.
_PATH_ROWS = 65
_FULL_ROWS = 8
# Where a group of bumps starts is found to the last bits of a float by taking one of so many parts, so often. (Halves
# take three times as long: a curve answers for a hundred lengths nearly as fast as for one.)
_PARTS = 64
_ROUNDS = 9


@dataclass(frozen=True, slots=True, eq=False)
class Absorption:
    """How the groups of bumps take up a shortening: first some that are full, then one that rises, then flat ones.

    Attributes:
        intervals: (frames,) x, scene units.
        capacities: (frames,) D of a full bump of width 1, scene units; inf where bumps have no greatest height.
        rising: (frames,) which group rises; the number of groups where all are full.
        shares: (frames,) D of a bump of width 1 in it, scene units.
        unabsorbed: (frames,) what none could take, scene units: ≥ 0, and exactly 0 where some bump is not full.
    """

    intervals: Floats
    capacities: Floats
    rising: Ints
    shares: Floats
    unabsorbed: Floats


@dataclass(frozen=True, eq=False)
class ControlCurve:
    """A tool's control curve, planned once, evaluated for all frames at a time.

    Bumps that always rise together form a group; its height at u is Σ amplitudes[mode] · shapes[mode](u). All bumps are
    similar: one of width w is w times as high as one of width 1, and takes w times as much of the shortening. So the
    profile is asked of a bump of width 1, and amplitudes are its.

    Attributes:
        widths: (bumps,) of each bump over their mean, on the segment.
        peaks: (bumps,) greatest height of a bump over that on the segment, beside which it may be higher.
        gap: Flat intervals between neighbouring bumps.
        strategy: In which order bumps rise.
        details: Share of a bump's shortening that goes to each finer level; their sum is below 1.
        max_height: Greatest height of a bump's highest point, details included, scene units; inf for none.
        compressible: c, the share of every shortening that the tissue takes itself, from 0 to below 1.
        rest_length: The tool's rest length, scene units.
        greatest_rest_length: The greatest that keyed rest lengths reach, scene units.
        interval_count: n, see `count_intervals`.
        groups: Bump indices of each group, in rising order.
        profile: The shape of one bump, precomputed.
        demand: (2, rows) roots of shares of the rest length, rising: by how much the ends are closer, and what the line
            on the surface then asks the curve for (see module `demand`); None where it asks for just that.
        greatest_amplitudes: (groups, modes) bounds of |amplitude|, scene units: reached at full shortening or
            at `max_height`; exactly 0 for a group that never rises. Amplitudes of further modes, which only a
            polyline with details has, can be negative; such modes' bounds are sampled, to 2 % or
            0.3 % of the greatest of all.
    """

    widths: Floats
    peaks: Floats
    gap: int
    strategy: Strategy
    details: tuple[float, ...]
    max_height: float
    compressible: float
    rest_length: float
    greatest_rest_length: float
    interval_count: int
    groups: tuple[tuple[int, ...], ...]
    profile: SmoothProfile | PolylineProfile
    greatest_amplitudes: Floats
    demand: Floats | None = None

    @property
    def bumps(self) -> int:
        """Number of bumps B."""
        return len(self.widths)

    @cached_property
    def bump_starts(self) -> Floats:
        """(bumps,) u where each bump starts; it spans 2/n times its width."""
        return bump_ends(self.widths, self.gap)[0]

    @cached_property
    def turned(self) -> Bools:
        """(bumps,) those that are the mirror image of the profile: behind the middle, so that all lean towards it."""
        starts, ends = bump_ends(self.widths, self.gap)
        return (self.profile.leans) & (starts + ends > 1.0 + 1e-9)

    @cached_property
    def limit(self) -> float:
        """Greatest height of a bump of width 1 on the segment, scene units: the highest then has `max_height`."""
        return self.max_height / float((self.widths * self.peaks).max())

    @cached_property
    def sizes(self) -> Floats:
        """(groups,) sum of the widths of each group's bumps."""
        return np.array([self.widths[list(group)].sum() for group in self.groups])

    @property
    def greatest_height(self) -> float:
        """Of all bumps, scene units."""
        return float(self.heights(self.greatest_amplitudes[None]).max(initial=0.0))

    def shortening(self, distances: Floats, rest_lengths: Floats) -> Floats:
        """(frames,) d = (1 − c) max((1 − 1e-5) l − l', 0), scene units: the shortening that makes wrinkles.

        Neither stretching nor rounding noise does. In place of the maximum stands what the surface asks for, if it
        asks for more or less.

        Args:
            distances: (frames,) current lengths l', scene units.
            rest_lengths: (frames,) rest lengths l, scene units.
        """
        gone = np.maximum(TAUT * rest_lengths - distances, 0.0)
        if self.demand is not None:
            gone = rest_lengths * self.asked(gone / rest_lengths)
        return (1.0 - self.compressible) * gone

    def asked(self, shares: Floats) -> Floats:
        """(…,) of the rest length that the surface asks for where the ends are closer by (…,) shares of it."""
        if self.demand is None:
            return shares
        asked: Floats = np.interp(np.sqrt(shares), *self.demand) ** 2
        return asked

    def absorb(self, shortenings: Floats, rest_lengths: Floats) -> Absorption:
        """Distribute shortenings over the groups of bumps by the tool's strategy.

        Args:
            shortenings: (frames,) d, scene units, from 0 to the rest length.
            rest_lengths: (frames,) l, scene units.
        """
        intervals = self.intervals(rest_lengths, shortenings)
        capacities = self.profile.capacity(intervals, self.limit)
        sizes = self.sizes
        before = np.append(0.0, np.cumsum(sizes))
        rising = np.zeros(len(shortenings), np.intp)
        for bumps in before[1:]:
            rising += shortenings > bumps * capacities
        # Capacities may be infinite, but not where they are full.
        left = np.maximum(shortenings - before[rising] * np.where(rising > 0, capacities, 0.0), 0.0)
        all_full = rising == len(self.groups)
        return Absorption(
            intervals=intervals,
            capacities=capacities,
            rising=rising,
            shares=np.where(all_full, 0.0, left / np.append(sizes, 1.0)[rising]),
            unabsorbed=np.where(all_full, left, 0.0),
        )

    def amplitudes(self, absorbed: Absorption) -> Floats:
        """(frames, groups, modes) amplitudes of each group's modes, scene units."""
        count = len(self.groups)
        amplitudes = np.zeros((len(absorbed.rising), count, self.greatest_amplitudes.shape[1]))
        full, partly = np.flatnonzero(absorbed.rising > 0), np.flatnonzero(absorbed.rising < count)
        # Few frames at a time are asked for, mostly of one kind: the profile's cost then is that of being asked at all.
        if len(full):
            heights = self.profile.fullest(absorbed.capacities[full], absorbed.intervals[full], self.limit)
            for number in range(absorbed.rising.max()):
                amplitudes[full, number] = heights * (absorbed.rising[full] > number)[:, None]
        if len(partly):
            amplitudes[partly, absorbed.rising[partly]] = self.profile.amplitudes(
                absorbed.shares[partly], absorbed.intervals[partly], self.max_height
            )
        return amplitudes

    def follow(self, distances: Floats, rest_lengths: Floats) -> tuple[Floats, Floats]:
        """All steps in one: (frames, groups, modes) amplitudes and (frames,) unabsorbed lengths, scene units.

        Args:
            distances: (frames,) current lengths l', scene units.
            rest_lengths: (frames,) rest lengths l, scene units.
        """
        shortenings = self.shortening(distances, rest_lengths)
        acting = np.flatnonzero(shortenings)
        amplitudes = np.zeros((len(shortenings), *self.greatest_amplitudes.shape))
        unabsorbed = np.zeros(len(shortenings))
        if len(acting):
            absorbed = self.absorb(shortenings[acting], rest_lengths[acting])
            amplitudes[acting], unabsorbed[acting] = self.amplitudes(absorbed), absorbed.unabsorbed
        return amplitudes, unabsorbed

    def shapes(self, us: Floats) -> Floats:
        """Heights per unit of amplitude.

        Args:
            us: (points,) positions along the segment; 0 is the origin, 1 the target.

        Returns:
            (groups, modes, points), 0 outside the group's bumps.
        """
        taus = (us - self.bump_starts[:, None]) * (self.interval_count / 2) / self.widths[:, None]
        inside = (taus > 0) & (taus < 1)
        taus = np.clip(taus, 0.0, 1.0)
        of_bumps = self.profile.shapes(np.where(self.turned[:, None], 1.0 - taus, taus)) * (
            inside * self.widths[:, None]
        )
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
        starts = self.bump_starts
        bumps = np.searchsorted(starts[1:], us, side="right")
        taus = (us - starts[bumps]) * (self.interval_count / 2) / self.widths[bumps]
        inside = (taus > 0) & (taus < 1)
        taus = np.where(self.turned[bumps], 1.0 - taus, taus)
        at = np.flatnonzero(inside)
        frames = np.broadcast_to(np.arange(us.shape[1]), us.shape).reshape(-1)[at]
        acting = amplitudes[frames, self.groups_of_bumps[bumps.reshape(-1)[at]]]
        heights = np.zeros(us.shape)
        of_width = np.sum(acting.T * self.profile.shapes(taus.reshape(-1)[at]), axis=0)
        heights[inside] = of_width * self.widths[bumps.reshape(-1)[at]]
        return heights

    @property
    def sharp(self) -> bool:
        """Whether bumps turn more sharply here than there: neither those of `smooth` nor of `polyline` do."""
        return isinstance(self.profile, SmoothProfile) and self.profile.kind != "smooth"

    def stretched(self, us: Floats) -> Floats:
        """(…,) us, (…,) along a sharp curve, with each bump warped towards where its profile is the smooth one."""
        assert isinstance(self.profile, SmoothProfile)
        starts, ends = bump_ends(self.widths, self.gap)
        bumps = np.searchsorted(starts[1:], us, side="right")
        widths, turned = (ends - starts)[bumps], self.turned[bumps]
        taus = (us - starts[bumps]) / widths
        inside = (taus > 0) & (taus < 1)
        places, _ = warped(self.profile.kind, np.where(turned, 1.0 - taus, taus).clip(0.0, 1.0))
        return np.where(inside, starts[bumps] + widths * np.where(turned, 1.0 - places, places), us)

    def phases(self, us: Floats) -> Floats:
        """(…,) where (…,) us are among the bumps: k + 1/2 on the crest of bump k, k and k + 1 at its feet."""
        starts, ends = bump_ends(self.widths, self.gap)
        bumps = np.searchsorted(starts[1:], us, side="right")
        taus = np.clip((us - starts[bumps]) / (ends - starts)[bumps], 0.0, 1.0)
        crests = np.where(self.turned, 1.0 - self.profile.crest, self.profile.crest)[bumps]
        over = taus > crests
        phases: Floats = bumps + 0.5 * (over + (taus - over * crests) / np.where(over, 1.0 - crests, crests))
        return phases

    def heights(self, amplitudes: Floats) -> Floats:
        """(frames, bumps) height of each bump's highest point, on the segment or beside it, scene units.

        Args:
            amplitudes: (frames, groups, modes), scene units.
        """
        return self.profile.highest(amplitudes)[:, self.groups_of_bumps] * (self.widths * self.peaks)

    def lengths(self, amplitudes: Floats, distances: Floats) -> Floats:
        """(frames,) arc length of the control curve, scene units: l − unabsorbed, if all is right, where d > 0.

        Args:
            amplitudes: (frames, groups, modes), scene units.
            distances: (frames,) of the curve's ends, l − d, scene units: l' where the tissue takes nothing.
        """
        intervals = (distances / self.interval_count)[:, None]
        excess = self.profile.excess(amplitudes, intervals)[:, self.groups_of_bumps] * self.widths
        return np.asarray(distances + excess.sum(axis=1), np.float64)

    def intervals(self, rest_lengths: Floats, shortenings: Floats) -> Floats:
        """(frames,) x = (l − d)/n; where d = 0, l' may be longer, but nothing rises there."""
        return np.maximum(TAUT * rest_lengths - shortenings, 0.0) / self.interval_count

    @cached_property
    def groups_of_bumps(self) -> Ints:
        """(bumps,) index of the group of each bump."""
        indices = np.zeros(self.bumps, np.intp)
        for index, group in enumerate(self.groups):
            indices[list(group)] = index
        return indices


def count_intervals(bumps: int, gap: int) -> int:
    """n, the control intervals of a segment: two for each bump, and `gap` flat ones between neighbours."""
    return 2 * bumps + gap * (bumps - 1)


def bump_ends(widths: Floats, gap: int) -> tuple[Floats, Floats]:
    """(bumps,) u where each bump starts, and where it ends.

    Args:
        widths: (bumps,) of each bump over their mean.
        gap: Flat intervals between neighbouring bumps.
    """
    intervals = count_intervals(len(widths), gap)
    before = np.append(0.0, np.cumsum(widths))
    before[-1] = len(widths)  # the last bump ends where the segment does
    flat = np.arange(len(widths)) * gap
    return (2.0 * before[:-1] + flat) / intervals, (2.0 * before[1:] + flat) / intervals


def plan_curve(
    *,
    bumps: int,
    gap: int,
    strategy: Strategy,
    details: tuple[float, ...],
    profile: Profile,
    max_height: float,
    compressible: float = 0.0,
    rest_length: float,
    greatest_rest_length: float | None = None,
    widths: Floats | None = None,
    peaks: Floats | None = None,
) -> ControlCurve:
    """Plan a tool's control curve.

    Args:
        bumps: Number of bumps, ≥ 1.
        gap: Flat intervals between neighbouring bumps, ≥ 0.
        strategy: In which order bumps rise.
        details: Shares of the finer levels, each > 0, their sum < 1.
        profile: The shape of a bump.
        max_height: Greatest height of a bump's highest point, scene units, ≥ 0; inf for none.
        compressible: c, the share of every shortening that the tissue takes itself, from 0 to below 1.
        rest_length: The tool's rest length, scene units, > 0.
        greatest_rest_length: The greatest that keyed rest lengths reach, scene units; else `rest_length`.
        widths: (bumps,) of each bump over their mean; else all are equal.
        peaks: (bumps,) greatest height of a bump over that on the segment; else 1.
    """
    ruled = np.ones(bumps)
    widths, peaks = ruled if widths is None else widths, ruled if peaks is None else peaks
    limit = max_height / float((widths * peaks).max())
    interval_count = count_intervals(bumps, gap)
    groups = group_bumps(bumps, strategy)
    greatest = max(rest_length, greatest_rest_length or 0.0)
    shape: SmoothProfile | PolylineProfile
    if profile != "polyline":
        shape = plan_smooth(details, profile)
    else:
        reached = (1.0 - compressible) * TAUT * greatest
        sharing = float(widths[list(groups[0])].sum())
        samples = reachable_heights(details, limit, TAUT * greatest, reached, interval_count, sharing)
        shape = plan_polyline(details, samples)
    curve = ControlCurve(
        widths=widths,
        peaks=peaks,
        gap=gap,
        strategy=strategy,
        details=details,
        max_height=max_height,
        compressible=compressible,
        rest_length=rest_length,
        greatest_rest_length=greatest,
        interval_count=interval_count,
        groups=groups,
        profile=shape,
        greatest_amplitudes=np.zeros((len(groups), 1)),
    )
    return dataclasses.replace(curve, greatest_amplitudes=_greatest_amplitudes(curve))


def _greatest_amplitudes(curve: ControlCurve) -> Floats:
    """(groups, modes) bounds of |amplitude|, scene units."""
    # Heights grow with d/l, and at the same d/l with l: the greatest are those where the ends meet.
    lengths = np.array([curve.greatest_rest_length])
    absorbed = curve.absorb(curve.shortening(np.zeros(1), lengths), lengths)
    numbers = np.arange(len(curve.groups))
    shares = np.where(numbers < absorbed.rising, absorbed.capacities, 0.0)
    shares = np.where(numbers == absorbed.rising, absorbed.shares, shares)
    # The ends meet but for the rounding of the bumps' sum.
    taken = (shares[curve.groups_of_bumps] * curve.widths).sum() + absorbed.unabsorbed
    bounds = curve.profile.amplitudes(shares, curve.intervals(lengths, taken), curve.limit)
    if isinstance(curve.profile, SmoothProfile):
        return bounds
    # A mode may turn round on its way, so its end is no bound; its samples are.
    return np.where(shares[:, None] > 0, np.maximum(curve.profile.sampled_amplitudes, np.abs(bounds)), 0.0)


def group_bumps(bumps: int, strategy: Strategy) -> tuple[tuple[int, ...], ...]:
    """Bumps that always rise together, in rising order."""
    if strategy == "everywhere":
        return (tuple(range(bumps)),)
    if strategy == "origin":
        return tuple((bump,) for bump in range(bumps))
    pairs = tuple((bump, bumps - 1 - bump) for bump in range(bumps // 2))
    return pairs if bumps % 2 == 0 else (*pairs, (bumps // 2,))


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
        full[-1] = True  # the last stands for what is never full
        first = np.argmax(full[1:], axis=0)
        low, high = tried[first, groups], tried[first + 1, groups]
    return np.concatenate([[1.0 - TAUT], high])


def fitting_compressible(curve: ControlCurve, lengths: Iterable[tuple[Floats, Floats]]) -> float:
    """The `compressible`, 0 to 1, with which all bumps are just full at the greatest shortening, whatever it is now.

    Args:
        curve: The control curve.
        lengths: Of each clip (frames,) current lengths l' and (frames,) rest lengths l, scene units.
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
    """(frames, groups, modes) amplitudes as shares of the greatest; 0 for what never rises."""
    greatest = curve.greatest_amplitudes
    return amplitudes / np.where(greatest != 0, greatest, 1.0)
