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
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from wrinklecli.drive.lag import TAUT
from wrinklecli.effects.wrinkle.bumps import Bumps, Strategy, count_intervals, group_bumps
from wrinklecli.effects.wrinkle.polyline import PolylineProfile, plan_polyline, reachable_heights
from wrinklecli.effects.wrinkle.profile import Profile, SmoothProfile, plan_smooth
from wrinklecli.numeric.arrays import Bools, Floats, Ints

BumpProfile: TypeAlias = SmoothProfile | PolylineProfile


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
        bumps: Where they lie on the segment.
        peaks: (bumps,) greatest height of a bump over that on the segment, beside which it may be higher.
        strategy: In which order bumps rise.
        details: Share of a bump's shortening that goes to each finer level; their sum is below 1.
        max_height: Greatest height of a bump's highest point, details included, scene units; inf for none.
        compressible: c, the share of every shortening that the tissue takes itself, from 0 to below 1.
        rest_length: The tool's rest length, scene units.
        greatest_rest_length: The greatest that keyed rest lengths reach, scene units.
        groups: Bump indices of each group, in rising order.
        profile: The shape of one bump, precomputed.
        demand: (2, rows) roots of shares of the rest length, rising: by how much the ends are closer, and what the line
            on the surface then asks the curve for (see module `demand`); None where it asks for just that.
        greatest_amplitudes: (groups, modes) bounds of |amplitude|, scene units: reached at full shortening or
            at `max_height`; exactly 0 for a group that never rises. Amplitudes of further modes, which only a
            polyline with details has, can be negative; such modes' bounds are sampled, to 2 % or
            0.3 % of the greatest of all.
    """

    bumps: Bumps
    peaks: Floats
    strategy: Strategy
    details: tuple[float, ...]
    max_height: float
    compressible: float
    rest_length: float
    greatest_rest_length: float
    groups: tuple[tuple[int, ...], ...]
    profile: BumpProfile
    greatest_amplitudes: Floats
    demand: Floats | None = None

    @property
    def interval_count(self) -> int:
        """n, the control intervals of the segment."""
        return self.bumps.interval_count

    @cached_property
    def turned(self) -> Bools:
        """(bumps,) those that are the mirror image of the profile: behind the middle, so that all lean towards it."""
        return self.profile.leans & (self.bumps.starts + self.bumps.ends > 1.0 + 1e-9)

    @cached_property
    def limit(self) -> float:
        """Greatest height of a bump of width 1 on the segment, scene units: the highest then has `max_height`."""
        return self.max_height / float((self.bumps.widths * self.peaks).max())

    @cached_property
    def sizes(self) -> Floats:
        """(groups,) sum of the widths of each group's bumps."""
        return np.array([self.bumps.widths[list(group)].sum() for group in self.groups])

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
        widths = self.bumps.widths[:, None]
        taus = (us - self.bumps.starts[:, None]) * (self.interval_count / 2) / widths
        inside = (taus > 0) & (taus < 1)
        taus = np.clip(taus, 0.0, 1.0)
        of_bumps = self.profile.shapes(np.where(self.turned[:, None], 1.0 - taus, taus)) * (inside * widths)
        return np.stack([of_bumps[:, group].sum(axis=1) for group in self.groups])

    def rises(self, us: Floats, amplitudes: Floats) -> Floats:
        """Heights of the curve where every frame has points of its own; `shapes` where they share them.

        Args:
            us: (points, frames) positions along the segment.
            amplitudes: (frames, groups, modes), scene units.

        Returns:
            (points, frames), scene units; 0 outside all bumps.
        """
        bumps, taus = self.bumps.locate(us)
        inside = (taus > 0) & (taus < 1)
        bumps, taus = bumps[inside], taus[inside]
        acting = amplitudes[np.nonzero(inside)[1], self.groups_of_bumps[bumps]]
        shapes = self.profile.shapes(np.where(self.turned[bumps], 1.0 - taus, taus))
        heights = np.zeros(us.shape)
        heights[inside] = np.sum(acting.T * shapes, axis=0) * self.bumps.widths[bumps]
        return heights

    def stretched(self, us: Floats) -> Floats:
        """(…,) us, (…,) along the curve, with each bump warped towards where its profile is the smooth one.

        Before its ends and behind them as within, mirrored: an edge across a foot is as short as one across a furrow.
        """
        before, behind = us < 0.0, us > 1.0
        within = np.where(before, -us, np.where(behind, 2.0 - us, us))
        bumps, taus = self.bumps.locate(within)
        inside, turned = (taus > 0) & (taus < 1), self.turned[bumps]
        taus = taus.clip(0.0, 1.0)
        places = self.profile.warped(np.where(turned, 1.0 - taus, taus))
        starts, ends = self.bumps.starts[bumps], self.bumps.ends[bumps]
        placed = np.where(inside, starts + (ends - starts) * np.where(turned, 1.0 - places, places), within)
        return np.where(before, -placed, np.where(behind, 2.0 - placed, placed))

    def phases(self, us: Floats) -> Floats:
        """(…,) where (…,) us are among the bumps: k + 1/2 on the crest of bump k, k and k + 1 at its feet."""
        bumps, taus = self.bumps.locate(us)
        taus = taus.clip(0.0, 1.0)
        crests = np.where(self.turned, 1.0 - self.profile.crest, self.profile.crest)[bumps]
        over = taus > crests
        phases: Floats = bumps + 0.5 * (over + (taus - over * crests) / np.where(over, 1.0 - crests, crests))
        return phases

    def heights(self, amplitudes: Floats) -> Floats:
        """(frames, bumps) height of each bump's highest point, on the segment or beside it, scene units.

        Args:
            amplitudes: (frames, groups, modes), scene units.
        """
        return self.profile.highest(amplitudes)[:, self.groups_of_bumps] * (self.bumps.widths * self.peaks)

    def lengths(self, amplitudes: Floats, distances: Floats) -> Floats:
        """(frames,) arc length of the control curve, scene units: l − unabsorbed, if all is right, where d > 0.

        Args:
            amplitudes: (frames, groups, modes), scene units.
            distances: (frames,) of the curve's ends, l − d, scene units: l' where the tissue takes nothing.
        """
        intervals = (distances / self.interval_count)[:, None]
        excess = self.profile.excess(amplitudes, intervals)[:, self.groups_of_bumps] * self.bumps.widths
        return np.asarray(distances + excess.sum(axis=1), np.float64)

    def intervals(self, rest_lengths: Floats, shortenings: Floats) -> Floats:
        """(frames,) x = (l − d)/n; where d = 0, l' may be longer, but nothing rises there."""
        return np.maximum(TAUT * rest_lengths - shortenings, 0.0) / self.interval_count

    @cached_property
    def groups_of_bumps(self) -> Ints:
        """(bumps,) index of the group of each bump."""
        indices = np.zeros(self.bumps.count, np.intp)
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
    groups = group_bumps(bumps, strategy)
    greatest = max(rest_length, greatest_rest_length or 0.0)
    shape: BumpProfile
    if profile != "polyline":
        shape = plan_smooth(details, profile)
    else:
        reached = (1.0 - compressible) * TAUT * greatest
        sharing = float(widths[list(groups[0])].sum())
        samples = reachable_heights(details, limit, TAUT * greatest, reached, count_intervals(bumps, gap), sharing)
        shape = plan_polyline(details, samples)
    curve = ControlCurve(
        bumps=Bumps(widths, gap),
        peaks=peaks,
        strategy=strategy,
        details=details,
        max_height=max_height,
        compressible=compressible,
        rest_length=rest_length,
        greatest_rest_length=greatest,
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
    taken = (shares[curve.groups_of_bumps] * curve.bumps.widths).sum() + absorbed.unabsorbed
    return curve.profile.bounds(shares, curve.intervals(lengths, taken), curve.limit)
