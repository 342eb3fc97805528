"""The control curve: it shares the shortening of a tool's segment among the bumps, and so sets their heights.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve: the curve keeps its length while its ends approach, and strategies order the bumps. The
height of one bump for its shortening comes from its `profile`.

Differs from the paper: `max_height` ends a bump's rise, in every strategy; a shortening that no bump can take is
returned as unabsorbed. And the tissue, which the paper calls compressible to a small extent, may take a fraction c of
every shortening itself: it is squeezed along the segment, together with the bumps that the rest of the shortening
makes.

The rest length is l, the current distance of the anchors l', the shortening d = (1 - c) (l - l'), and D the part of d
that one bump takes. The curve has n control intervals, two for each bump, of the current length x = (l - d)/n, not the
rest one's: n·x + ΣD + unabsorbed = l. So a full bump keeps its height and absorbs more as x shrinks. Heights grow with
d, except in one case that is the paper's own: a polyline with details, its chord below about half its length, trades
its highest knot for lower ones.
"""

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from wrinklecli.choices import Profile, Strategy
from wrinklecli.drive.stored import TAUT
from wrinklecli.effects.profile import SmoothProfile, plan_smooth
from wrinklecli.effects.wrinkle.bumps import Bumps, count_intervals, group_bumps
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from wrinklecli.effects.wrinkle.polyline import PolylineProfile

BumpProfile: TypeAlias = "SmoothProfile | PolylineProfile"


@dataclass(frozen=True, slots=True, eq=False)
class Absorption:
    """The distribution of shortenings: some groups of bumps are full, the next one rises, and the others are flat.

    Attributes:
        intervals: (frames,) x, scene units.
        capacities: (frames,) D of a full bump of width 1, scene units; inf if bumps have no greatest height.
        rising: (frames,) index of the group that rises; the number of groups if all are full.
        shares: (frames,) D of a bump of width 1 in that group, scene units.
        unabsorbed: (frames,) shortening that no bump takes, scene units: exactly 0 if some bump is not full.
    """

    intervals: Floats
    capacities: Floats
    rising: Ints
    shares: Floats
    unabsorbed: Floats


@dataclass(frozen=True, eq=False)
class ControlCurve:
    """A tool's control curve, planned once and evaluated for all frames at a time.

    Bumps that always rise together form a group; its height at u is Σ amplitudes[mode] · shapes[mode](u). All bumps are
    similar: a bump of width w is w times as high as one of width 1, and takes w times as much of the shortening. So the
    profile and the amplitudes are those of a bump of width 1.

    Arguments of methods: `distances` l', `rest_lengths` l and `shortenings` d are (frames,), `amplitudes` are (frames,
    groups, modes), all in scene units; `us` are positions along the segment, 0 at the origin and 1 at the target.

    Attributes:
        bumps: The layout of the bumps.
        peaks: (bumps,) greatest height of each bump, beside the segment too, relative to its height on the segment.
        details: Fraction of a bump's shortening that goes to each finer level; their sum is below 1.
        max_height: Greatest height of a bump's highest point, details included, at the nominal rest length, scene
            units; inf for none.
        compressible: c, the fraction of every shortening that the tissue takes itself, from 0 to below 1.
        rest_length: The tool's nominal rest length, scene units.
        groups: Bump indices of each group, in the order in which groups rise.
        profile: The shape of one bump, precomputed.
        greatest_amplitudes: (groups, modes) bounds of |amplitude|, scene units, which full shortening or `max_height`
            reaches; exactly 0 for a group that never rises. Further modes, which only a polyline with details has, can
            have negative amplitudes; their bounds are sampled, to 2 % or 0.3 % of the greatest of all.
        demand: (2, rows) square roots, sorted: of the fraction of the rest length by which the ends approach, and of
            the fraction that the line on the surface then asks for (see module `demand`). None if both are equal.
        longest: The greatest rest length over the nominal one.
    """

    bumps: Bumps
    peaks: Floats
    details: tuple[float, ...]
    max_height: float
    compressible: float
    rest_length: float
    groups: tuple[tuple[int, ...], ...]
    profile: BumpProfile
    greatest_amplitudes: Floats
    demand: Floats | None = None
    longest: float = 1.0

    @property
    def interval_count(self) -> int:
        """The number n of control intervals of the segment."""
        return self.bumps.interval_count

    @cached_property
    def turned(self) -> Bools:
        """(bumps,) True for mirrored bumps: those behind the middle, so that all lean towards it."""
        return self.profile.leans & (self.bumps.starts + self.bumps.ends > 1.0 + 1e-9)

    @cached_property
    def limit(self) -> float:
        """Greatest height of a bump of width 1 on the segment, scene units: the highest bump then has `max_height`."""
        return self.max_height / float((self.bumps.widths * self.peaks).max())

    @cached_property
    def sizes(self) -> Floats:
        """(groups,) total width of each group's bumps."""
        return np.array([self.bumps.widths[list(group)].sum() for group in self.groups])

    @property
    def greatest_height(self) -> float:
        """Greatest height of any bump, scene units."""
        return float(self.heights(self.greatest_amplitudes[None]).max(initial=0.0))

    def shortening(self, distances: Floats, rest_lengths: Floats) -> Floats:
        """(frames,) d = (1 − c) max((1 − 1e-5) l − l', 0), scene units; neither stretching nor rounding counts.

        If the surface asks for more or less than the ends' approach, that replaces the maximum.
        """
        gone = np.maximum(TAUT * rest_lengths - distances, 0.0)
        if self.demand is not None:
            gone = rest_lengths * self.asked(gone / rest_lengths)
        return (1.0 - self.compressible) * gone

    def asked(self, shares: Floats) -> Floats:
        """(…,) fractions of the rest length that the surface asks for if the ends approach by (…,) shares of it."""
        if self.demand is None:
            return shares
        return np.interp(np.sqrt(shares), *self.demand) ** 2

    def absorb(self, shortenings: Floats, rest_lengths: Floats) -> Absorption:
        """Distribute shortenings, from 0 to the rest lengths, over the groups of bumps."""
        intervals = self.intervals(rest_lengths, shortenings)
        capacities = self.profile.capacity(intervals, self.limit)
        sizes = self.sizes
        before = np.append(0.0, np.cumsum(sizes))
        rising = np.zeros(len(shortenings), np.intp)
        for bumps in before[1:]:
            rising += shortenings > bumps * capacities
        # Capacities may be infinite, but not those of full groups.
        remaining = np.maximum(shortenings - before[rising] * np.where(rising > 0, capacities, 0.0), 0.0)
        all_full = rising == len(self.groups)
        return Absorption(
            intervals=intervals,
            capacities=capacities,
            rising=rising,
            shares=np.where(all_full, 0.0, remaining / np.append(sizes, 1.0)[rising]),
            unabsorbed=np.where(all_full, remaining, 0.0),
        )

    def amplitudes(self, absorbed: Absorption) -> Floats:
        """(frames, groups, modes) amplitudes, scene units."""
        count = len(self.groups)
        amplitudes = np.zeros((len(absorbed.rising), count, self.greatest_amplitudes.shape[1]))
        full, partly = np.flatnonzero(absorbed.rising > 0), np.flatnonzero(absorbed.rising < count)
        # Calls have few frames, mostly of one kind, so their cost is that of calling the profile at all.
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
        """(frames, groups, modes) amplitudes and (frames,) unabsorbed lengths, scene units.

        A curve that is twice as long has bumps twice as high, and twice their greatest height. So heights over the
        length are a function of the shortening over the length alone, of which players have a table.
        """
        scales = rest_lengths / self.rest_length
        lengths = np.full(len(distances), self.rest_length)
        shortenings = self.shortening(distances / scales, lengths)
        acting = np.flatnonzero(shortenings)
        amplitudes = np.zeros((len(shortenings), *self.greatest_amplitudes.shape))
        unabsorbed = np.zeros(len(shortenings))
        if len(acting):
            absorbed = self.absorb(shortenings[acting], lengths[acting])
            amplitudes[acting], unabsorbed[acting] = self.amplitudes(absorbed), absorbed.unabsorbed
        return amplitudes * scales[:, None, None], unabsorbed * scales

    def unabsorbed(self, distances: Floats, rest_lengths: Floats) -> Floats:
        """(frames,) lengths that no bump takes, scene units, as `follow`."""
        scales = rest_lengths / self.rest_length
        lengths = np.full(len(distances), self.rest_length)
        return self.absorb(self.shortening(distances / scales, lengths), lengths).unabsorbed * scales

    def shapes(self, us: Floats) -> Floats:
        """(groups, modes, points) heights per unit of amplitude at (points,) us; 0 outside the group's bumps."""
        widths = self.bumps.widths[:, None]
        taus = (us - self.bumps.starts[:, None]) * (self.interval_count / 2) / widths
        inside = (taus > 0) & (taus < 1)
        taus = np.clip(taus, 0.0, 1.0)
        of_bumps = self.profile.shapes(np.where(self.turned[:, None], 1.0 - taus, taus)) * (inside * widths)
        return np.stack([of_bumps[:, group].sum(axis=1) for group in self.groups])

    def heights_at(self, us: Floats, amplitudes: Floats) -> Floats:
        """(points, frames) heights at (points, frames) us, scene units; 0 outside all bumps.

        Where all frames share their points, `shapes` is cheaper.
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
        """(…,) us at which `smooth` bumps have the height of this curve at (…,) us.

        Beyond the ends the map is mirrored, so that an edge across a bump's foot is as short as one across a furrow.
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
        """(…,) positions of (…,) us among the bumps: k + 1/2 on the crest of bump k, k and k + 1 at its feet."""
        bumps, taus = self.bumps.locate(us)
        taus = taus.clip(0.0, 1.0)
        crests = np.where(self.turned, 1.0 - self.profile.crest, self.profile.crest)[bumps]
        over = taus > crests
        return bumps + 0.5 * (over + (taus - over * crests) / np.where(over, 1.0 - crests, crests))

    def heights(self, amplitudes: Floats) -> Floats:
        """(frames, bumps) height of each bump's highest point, on the segment or beside it, scene units."""
        return self.profile.highest(amplitudes)[:, self.groups_of_bumps] * (self.bumps.widths * self.peaks)

    def lengths(self, amplitudes: Floats, distances: Floats) -> Floats:
        """(frames,) arc length of the control curve, scene units: l − unabsorbed where d > 0.

        Its ends are (frames,) distances l − d apart, scene units: l' if the tissue takes nothing.
        """
        intervals = (distances / self.interval_count)[:, None]
        excess = self.profile.excess(amplitudes, intervals)[:, self.groups_of_bumps] * self.bumps.widths
        return np.asarray(distances + excess.sum(axis=1), np.float64)

    def intervals(self, rest_lengths: Floats, shortenings: Floats) -> Floats:
        """(frames,) x = (l − d)/n, scene units. Where d = 0, l' may be longer than l, but no bump rises."""
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
    """Plan a tool's control curve; arguments are as in `Bumps` and `ControlCurve`.

    By default all bumps are equally wide, peaks are 1, and the greatest rest length is the rest length.
    """
    ruled = np.ones(bumps)
    widths, peaks = ruled if widths is None else widths, ruled if peaks is None else peaks
    limit = max_height / float((widths * peaks).max())
    groups = group_bumps(bumps, strategy)
    shape: BumpProfile
    if profile == "polyline":
        from wrinklecli.effects.wrinkle.polyline import plan_polyline, reachable_heights  # few tools ask for it

        taut = TAUT * rest_length
        sharing = float(widths[list(groups[0])].sum())
        reached = (1.0 - compressible) * taut
        shape = plan_polyline(
            details, reachable_heights(details, limit, taut, reached, count_intervals(bumps, gap), sharing)
        )
    else:
        shape = plan_smooth(details, profile)
    curve = ControlCurve(
        bumps=Bumps(widths, gap),
        peaks=peaks,
        details=details,
        max_height=max_height,
        compressible=compressible,
        rest_length=rest_length,
        groups=groups,
        profile=shape,
        greatest_amplitudes=np.zeros((len(groups), 1)),
    )
    longest = max(greatest_rest_length or rest_length, rest_length) / rest_length
    greatest = longest * _greatest_amplitudes(curve)
    return dataclasses.replace(curve, greatest_amplitudes=greatest, longest=longest)


def _greatest_amplitudes(curve: ControlCurve) -> Floats:
    """(groups, modes) bounds of |amplitude| at the nominal rest length, scene units."""
    # Heights grow with d/l, so they are greatest where the ends meet.
    lengths = np.array([curve.rest_length])
    absorbed = curve.absorb(curve.shortening(np.zeros(1), lengths), lengths)
    numbers = np.arange(len(curve.groups))
    shares = np.where(numbers < absorbed.rising, absorbed.capacities, 0.0)
    shares = np.where(numbers == absorbed.rising, absorbed.shares, shares)
    # The ends meet up to the rounding of the bumps' sum.
    taken = (shares[curve.groups_of_bumps] * curve.bumps.widths).sum() + absorbed.unabsorbed
    return curve.profile.bounds(shares, curve.intervals(lengths, taken), curve.limit)
