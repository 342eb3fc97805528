"""Irregular wrinkles: a warp of the patch's coordinates and a height along each crest, drawn from a seed.

Real wrinkles are no ruled cylinders: they are unequal, wander, swell and end at different places, and some merge with a
neighbour. A tool's `variation` a, from 0 to 1, sets the amount. The irregularity is part of the fixed shapes, so it
adds no morph target, and costs nothing at run time.

On the centre line, v = 0, the warp is the identity. There bumps have unequal widths, and heights in proportion: they
are similar, so every bump of a group takes up the same strain, as the wrinkles of an inextensible sheet do (E. Cerda,
L. Mahadevan, *Geometry and Physics of Wrinkling*, Physical Review Letters 90, 2003: amplitude over wavelength depends
on the strain alone). So the formula of one bump gives all their lengths exactly, whatever the profile.

Not in the paper, whose bumps are equal.

Source of the attenuation `bell`: G. Wyvill, C. McPheeters, B. Wyvill, *Data Structure for Soft Objects*, The Visual
Computer 2(4), 1986: 1 - 22/9 v² + 17/9 v⁴ - 4/9 v⁶.
"""

import math
from itertools import pairwise

import numpy as np

from wrinklecli.choices import Attenuation, Strategy
from wrinklecli.effects.wrinkle.bumps import Bumps, group_bumps
from wrinklecli.effects.wrinkle.places import Places
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, smoothstep
from wrinklecli.numeric.drawn import drawn
from wrinklecli.numeric.portions import portions

# All amounts are those of a variation of 1. Bumps' widths differ by this fraction before they are scaled to fill the
# segment.
_WIDTH = 0.35
# Farthest that a furrow wanders, relative to the mean distance of two crests,
_WANDER = 0.45
# and tangent of its greatest angle to the ruled line: steeper furrows read as crumpled paper.
_STEEPEST = 0.6
# Fraction of its width that a bump keeps where its furrows approach each other.
_LEAST_WIDTH = 0.4
# Waves of a furrow along v, radians over half the patch's width: half of the longest wave is 0.7 of a patch.
_WAVE = 2.2
# The second wave is half as long and has this relative height.
_SECOND_WAVE = 0.5
# Correlation of a furrow with the one before it: this fraction of the latter is added.
_ALIKE = 0.8
# Distance of a crest from the middle between its furrows, relative to half the bump's width.
_SWAY = 0.4

# A crest may end this far inside the patch, relative to half the patch's width,
_SHORTER = 0.45
# swell by this fraction of its height,
_SWELL = 0.18
# over this number of waves along v on half a patch, between two bounds,
_SWELLINGS = (0.5, 1.0)
# and be narrower at its ends by this fraction.
_TAPER = 0.45
# Where the surface turns away, crests end at different places too: the cosine between vertex and patch normal at which
# they end is greater by up to this,
_TURNED = 0.35
# in full from this |v| on.
_TURNED_FROM = 0.4

# |v| at which two bumps begin to merge, between these two numbers,
_MERGING = (0.0, 0.2)
# length along v over which they merge, longer where a patch is narrow,
_MERGED_OVER = (0.45, 0.7)
# and height of the joined bump relative to the wider of the two.
_MERGED_HEIGHT = 1.6
# A furrow breaks where its two crests merge and part again: it begins to fill up at a |v| between these two numbers,
_BREAKING = (0.12, 0.45)
# is full after a length along v between these two, longer for wide bumps, and again open after as much more; where that
# is too long, furrows stay whole, as skin would fold across them,
_BROKEN_OVER = (0.22, 0.3)
# and there the skin is this high, relative to the higher crest: it lies flat, and does not swell as where crests end.
_BROKEN_HEIGHT = 1.0
# A broken tool's crests are shorter by this fraction at its ends than in its middle,
_SHORTER_OUTSIDE = 0.4
# and by up to this one at random.
_STAGGERED = 0.3
# Merging crests lean towards each other by this, c, as `_SWAY`. A fraction τ of the way makes the furrow between them
# narrower by the factor (1 − cτ) / (1 + cτ), and fills it up to 1 − τ of its depth. Its flanks are thus
# (1 − τ)(1 + cτ) / (1 − cτ) times as steep as elsewhere: 1/2 is the greatest c for which that exceeds 1 nowhere. A
# furrow that is steeper there ends in a dark, hard line like a cut.
_TOGETHER = 0.5
# Fraction of a gap between them that they close.
_CLOSED = 0.9

# Values of v at which bounds are measured.
_LINES = np.linspace(-1.0, 1.0, 129)


def attenuation(kind: Attenuation, v: Floats) -> Floats:
    """(…,) fraction of the height that remains at (…,) v: 1 on the centre line, 0 from |v| = 1 on."""
    spread = np.minimum(np.abs(v), 1.0)
    if kind == "linear":
        return 1.0 - spread
    squared = spread**2
    return 1.0 + squared * (-22.0 + squared * (17.0 - 4.0 * squared)) / 9.0


@dataclass(frozen=True, slots=True)
class Merger:
    """Two neighbouring bumps that merge on one side of the patch: their crests bend towards each other and meet.

    The furrow between them becomes narrow and fills up, as they fade into one bump as wide as both.

    Attributes:
        left: Index of the first of the two.
        wider: Index of the wider one, whose stretched shape the joined bump has.
        side: Sign of v on that side, −1 or 1.
        start: |v| at which merging begins.
        over: Length along v over which the bumps merge.
        until: |v| at which the bumps begin to part again, over the same length; infinite if they stay one.
        height: Height of the joined bump relative to the wider of the two.
    """

    left: int
    wider: int
    side: float
    start: float
    over: float
    until: float = math.inf
    height: float = _MERGED_HEIGHT

    def share(self, v: Floats) -> Floats:
        """(…,) fraction of the way that the crests have come at (…,) v, and of the joined bump's height there."""
        towards: Floats = (self.side * v - self.start) / self.over
        way = np.minimum(towards, 1.0 + (self.until - self.side * v) / self.over)
        return smoothstep(np.clip(way, 0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Variation:
    """The differences between a tool's wrinkles and ruled ones.

    Attributes:
        kind: How crests fade towards their ends.
        bumps: Their places on the centre line.
        wander: (bumps + 1, waves) amplitudes of the furrows before, between and behind the bumps; 0 for the outermost.
        sway: (bumps, waves) amplitudes of each crest between its furrows, relative to half the bump's width.
        reaches: (2, bumps) |v| at which each crest ends, for v < 0 and for v ≥ 0.
        turns: (2, bumps) increase of the cosine at which each crest ends where the surface turns away, on both sides.
        swells: (3, bumps) fraction of the height, radians over half a patch, and radians at the centre line.
        tapers: (bumps,) fraction by which each crest is narrower at its ends, below 1.
        mergers: Pairs of bumps; no bump is in two.
        turned: −1 if v counts the other way, for a mirrored tool; else 1.
    """

    kind: Attenuation
    bumps: Bumps
    wander: Floats
    sway: Floats
    reaches: Floats
    turns: Floats
    swells: Floats
    tapers: Floats
    mergers: tuple[Merger, ...]
    turned: float

    @property
    def peaks(self) -> Floats:
        """(bumps,) greatest height of each crest, relative to its height on the centre line."""
        heights = np.stack([self._height(bump, _LINES) for bump in range(self.bumps.count)])
        peaks: Floats = heights.max(axis=1)
        widths = self.bumps.widths
        for merger in self.mergers:
            share, pair = merger.share(_LINES), slice(merger.left, merger.left + 2)
            apart = (heights[pair] * widths[pair, None]).max(axis=0) / widths[merger.wider]
            joined = (1.0 - share) * apart + share * self._joined_height(merger, _LINES)
            peaks[merger.wider] = max(float(peaks[merger.wider]), float(joined.max()))
        return peaks

    def places(self, u: Floats, v: Floats) -> tuple[Places, Floats]:
        """Map points of a patch, (…,) u along the segment and v across it, to places on the centre line's curve.

        Returns:
            Places whose us rise strictly with u, and are u itself where v = 0 and where u is not between 0 and 1. Their
            factors are 1 where v = 0, and 0 in gaps. Nothing is joined where v = 0.
            (…,) increase of the cosine at which a crest ends where the surface turns away; 0 where v = 0.
        """
        flat_u, lines = u.reshape(-1), self.turned * v.reshape(-1)
        found = np.zeros((5, len(flat_u)))
        for part in portions(len(flat_u), 8):
            found[:, part] = self._places(flat_u[part], lines[part])
        us, factors, joined, joined_us, turned = found.reshape(5, *u.shape)
        return (Places(us, factors, joined, joined_us) if self.mergers else Places(us, factors)), turned

    def _places(self, us: Floats, lines: Floats) -> Floats:
        """(5, points) us, factors, joined, joined_us and turned of `places`, for (points,) u and v."""
        starts, ends = self.furrows(lines)
        bumps, points = np.sum(us >= starts[1:], axis=0), np.arange(len(us))
        start, end = starts[bumps, points], ends[bumps, points]
        # `side` goes from −1 to 1 over the bump. Bending it moves the crest off the middle and makes it narrower.
        side = np.clip((2.0 * us - start - end) / (end - start), -1.0, 1.0)
        sway = _waving(self.sway, lines)[bumps, points]
        taper = self.tapers[bumps] * np.minimum(self._spread(bumps, lines) ** 2, 1.0)
        for merger in self.mergers:
            towards = np.select([bumps == merger.left, bumps == merger.left + 1], [-_TOGETHER, _TOGETHER])
            share = merger.share(lines) * (towards != 0.0)
            sway, taper = sway + share * (towards - sway), taper * (1.0 - share)
        side = (side + sway) / (1.0 + side * sway)
        side = side * (1.0 + taper) / (1.0 + taper * side * side)
        ruled_starts, ruled_ends = self.bumps.starts, self.bumps.ends
        placed = ruled_starts[bumps] + (ruled_ends - ruled_starts)[bumps] * (1.0 + side) / 2.0
        gaps = np.flatnonzero((us >= end) & (bumps + 1 < len(starts)))
        before, behind = bumps[gaps], bumps[gaps] + 1
        share = (us[gaps] - end[gaps]) / (starts[behind, gaps] - end[gaps])
        placed[gaps] = ruled_ends[before] + share * (ruled_starts[behind] - ruled_ends[before])
        factors = self._height(bumps, lines)
        factors[gaps] = 0.0
        turned = smoothstep(np.clip(np.abs(lines) / _TURNED_FROM, 0.0, 1.0)) * np.where(
            lines < 0, *self.turns[:, bumps]
        )
        stays = (lines == 0.0) | (us <= 0.0) | (us >= 1.0)
        joined, joined_us = np.zeros(len(us)), us.copy()
        for merger in self.mergers:
            left, right = merger.left, merger.left + 1
            share = merger.share(lines)
            on = np.flatnonzero((share > 0.0) & (us > starts[left]) & (us < ends[right]))
            before, behind = starts[left, on], ends[right, on]
            low, high = ruled_starts[merger.wider], ruled_ends[merger.wider]
            # The joined crest lies where the furrow between the two was.
            furrow = (ends[left, on] + starts[right, on] - before - behind) / (behind - before)
            side = np.clip((2.0 * us[on] - before - behind) / (behind - before), -1.0, 1.0)
            joined_us[on] = low + (high - low) * (1.0 + (side - furrow) / (1.0 - side * furrow)) / 2.0
            apart, together = (1.0 - share[on]) * factors[on], share[on] * self._joined_height(merger, lines[on])
            factors[on] = apart + together
            joined[on] = np.divide(together, factors[on], out=np.zeros(len(on)), where=factors[on] > 0.0)
        return np.stack([np.where(stays, us, placed), factors, joined, joined_us, turned])

    def furrows(self, lines: Floats) -> tuple[Floats, Floats]:
        """(bumps, lines) u at which each bump starts, and u at which it ends, on (lines,) `turned` times v."""
        moves = _waving(self.wander, lines)
        starts, ends = self.bumps.starts[:, None] + moves[:-1], self.bumps.ends[:, None] + moves[1:]
        for merger in self.mergers:
            closed = _CLOSED / 2.0 * merger.share(lines) * (starts[merger.left + 1] - ends[merger.left])
            ends[merger.left] += closed
            starts[merger.left + 1] -= closed
        return starts, ends

    def _spread(self, bump: int | Ints, lines: Floats) -> Floats:
        """(lines,) position along a crest, or along one crest per line: −1 and 1 at its ends."""
        return lines / np.where(lines < 0, *self.reaches[:, bump])

    def _height(self, bump: int | Ints, lines: Floats) -> Floats:
        """(lines,) height of a crest, or of one crest per line, relative to its height on the centre line."""
        share, turn, phase = self.swells[:, bump]
        swelling = (1.0 + share * np.sin(turn * lines + phase)) / (1.0 + share * np.sin(phase))
        return np.asarray(attenuation(self.kind, self._spread(bump, lines)) * swelling)

    def _joined_height(self, merger: Merger, lines: Floats) -> Floats:
        """(lines,) height of the joined bump relative to that of the wider one on the centre line."""
        return merger.height * self._height(merger.wider, lines)


def plan_variation(
    seed: str,
    amount: float,
    branch: float,
    broken: float = 0.0,
    *,
    bumps: int,
    gap: int,
    aspect: float,
    kind: Attenuation,
    strategy: Strategy = "everywhere",
    mirrored: bool = False,
) -> Variation:
    """Draw the irregularity of a tool's wrinkles.

    The amount is a, above 0 and up to 1, and `branch` the probability that a bump merges with its neighbour on one side
    of the patch; only bumps that rise together do. `broken` is the probability that such neighbours merge for a stretch
    alone, which breaks the furrow between them, and the amount by which crests end apart. `aspect` is half the patch's
    width over the segment's length. On a mirrored patch v counts the other way.
    """
    widths = 1.0 + _WIDTH * amount * _well_spread(drawn(seed, "widths", bumps))
    ruled = Bumps(widths * (bumps / widths.sum()), gap)
    starts, ends = ruled.starts, ruled.ends
    together = {pair for group in group_bumps(bumps, strategy) for pair in pairwise(sorted(group))}
    mergers = _mergers(seed, branch, broken, ends - starts, aspect, together)
    reaches = 1.0 - _SHORTER * amount * (1.0 + drawn(seed, "reaches", 2, bumps)) / 2.0
    if broken:
        outside = np.abs(starts + ends - 1.0)  # 0 in the middle of the segment, and 1 at its ends
        staggered = _STAGGERED * (1.0 + drawn(seed, "ends", 2, bumps)) / 2.0
        reaches = reaches * (1.0 - broken * (_SHORTER_OUTSIDE * outside + staggered * (0.3 + 0.7 * outside)))
    turns = _TURNED * amount * (1.0 + drawn(seed, "facing", 2, bumps)) / 2.0
    for merger in mergers:
        half, pair = int(merger.side > 0), slice(merger.left, merger.left + 2)
        reaches[half, pair] = reaches[half, pair].max() if broken else 1.0
        # The joined crest lies where the two met, and would have a step along it.
        turns[half, pair] = turns[half, merger.wider]
    share, turn, phase = drawn(seed, "swells", 3, bumps)
    low, high = _SWELLINGS
    return Variation(
        kind=kind,
        bumps=ruled,
        wander=_wandering(drawn(seed, "furrows", bumps + 1, 4), amount, starts, ends, aspect),
        sway=_swaying(drawn(seed, "crests", bumps, 4), amount, ends - starts, aspect),
        reaches=reaches,
        turns=turns,
        swells=np.stack(
            [_SWELL * amount * np.abs(share), 2.0 * np.pi * (low + (high - low) * np.abs(turn)), np.pi * phase]
        ),
        tapers=_TAPER * amount * (1.0 + drawn(seed, "tapers", bumps)) / 2.0,
        mergers=mergers,
        turned=-1.0 if mirrored else 1.0,
    )


def _well_spread(numbers: Floats) -> Floats:
    """Spread numbers in the same order, one in each equal part of −1 to 1, and more of them towards both ends.

    Four numbers may be nearly equal as drawn, and equal widths read as ruled.
    """
    ranks = np.argsort(np.argsort(numbers, kind="stable"), kind="stable")
    return np.sin(np.pi / 2.0 * ((2.0 * ranks + 1.0 + numbers) / len(numbers) - 1.0))


def _mergers(
    seed: str, branch: float, broken: float, widths: Floats, aspect: float, together: set[tuple[int, int]]
) -> tuple[Merger, ...]:
    """Draw pairs of neighbouring bumps, of (bumps,) widths along u, from the pairs that rise together."""
    bumps = len(widths)
    chances, sides, starts = drawn(seed, "mergers", 3, bumps)
    found: list[Merger] = []
    bump = 0
    low, high = _MERGING
    (earliest, latest), (shortest, longest) = _BREAKING, _BROKEN_OVER
    breaks = drawn(seed, "breaks", bumps)
    while bump + 1 < bumps:
        merges = (1.0 + chances[bump]) / 2.0 < branch and (bump, bump + 1) in together
        if merges:
            start = low + (high - low) * (1.0 + float(starts[bump])) / 2.0
            wider = bump + int(widths[bump + 1] > widths[bump])
            # Crests move sideways by about half a bump.
            over = float(np.clip(0.5 * widths[wider] / (_STEEPEST * aspect), *_MERGED_OVER))
            found.append(Merger(bump, wider, side=1.0 if sides[bump] > 0 else -1.0, start=start, over=over))
        elif (1.0 + breaks[bump]) / 2.0 < broken and (bump, bump + 1) in together:
            start = earliest + (latest - earliest) * (1.0 + float(starts[bump])) / 2.0
            wider = bump + int(widths[bump + 1] > widths[bump])
            side = 1.0 if sides[bump] > 0 else -1.0
            over = max(shortest, 0.5 * float(widths[wider]) / (_STEEPEST * aspect))
            merges = over <= longest
            found += [Merger(bump, wider, side, start, over, start + over, _BROKEN_HEIGHT)] * merges
        bump += 1 + merges
    return tuple(found)


def _wandering(numbers: Floats, amount: float, starts: Floats, ends: Floats, aspect: float) -> Floats:
    """(bumps + 1, waves) amplitudes of the furrows: the drawn numbers, scaled up to the first bound."""
    moving: Floats = numbers.copy()
    for furrow in range(1, len(moving)):
        moving[furrow] += _ALIKE * moving[furrow - 1]
    moving[[0, -1]] = 0.0
    moves = _waving(moving, _LINES)
    farthest = np.abs(moves).max()
    if farthest == 0.0:  # a single bump has no furrow inside
        return moving
    steepest = np.abs(np.diff(moves, axis=1)).max() / (_LINES[1] - _LINES[0])
    narrowest = (-np.diff(moves, axis=0) / (ends - starts)[:, None]).max()
    scale = min(
        _WANDER * amount / (len(starts) * farthest),
        _STEEPEST * amount * aspect / steepest,
        (1.0 - _LEAST_WIDTH) * amount / narrowest,
    )
    return np.asarray(scale * moving)


def _swaying(numbers: Floats, amount: float, widths: Floats, aspect: float) -> Floats:
    """(bumps, waves) amplitudes of the crests: the drawn numbers, scaled up to the first bound."""
    moves = _waving(numbers, _LINES)
    farthest = np.abs(moves).max(axis=1)
    steepest = np.abs(np.diff(moves, axis=1)).max(axis=1) / (_LINES[1] - _LINES[0]) * widths / 2.0
    scales = amount * np.minimum(_SWAY / farthest, _STEEPEST * aspect / steepest)
    return np.asarray(scales[:, None] * numbers)


def _waving(amplitudes: Floats, lines: Floats) -> Floats:
    """(rows, lines) sums of four waves with (rows, 4) amplitudes, at (lines,) v; all are 0 on the centre line."""
    at = _WAVE * lines
    waves = [np.sin(at), 1.0 - np.cos(at), _SECOND_WAVE * np.sin(2.0 * at), _SECOND_WAVE * (1.0 - np.cos(2.0 * at))]
    # einsum keeps the bytes: BLAS sums in another order if there are more lines.
    return np.asarray(np.einsum("rw,wl->rl", amplitudes, np.stack(waves)), np.float64)
