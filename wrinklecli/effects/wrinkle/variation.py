"""Irregular wrinkles: a warp of the patch's coordinates and a height along each crest, from a seed.

Real wrinkles are no ruled cylinders: they are unequal, wander, swell, end at places of their own, and some merge with a
neighbour. A tool's `variation` a, from 0 to 1, says how much. All of it is in its fixed shapes: it adds no morph
target, and nothing at run time.

On the centre line, v = 0, the warp is the identity. There bumps have unequal widths, and heights in proportion: they
are similar, so every bump of a group takes up the same strain, as the wrinkles of an inextensible sheet do (E. Cerda,
L. Mahadevan, *Geometry and Physics of Wrinkling*, Physical Review Letters 90, 2003: amplitude over wavelength hangs on
the strain alone), and the formula of one bump gives all their lengths exactly, whatever its profile.

Not in the paper, whose bumps are equal.

Source of the attenuation `bell`: G. Wyvill, C. McPheeters, B. Wyvill, *Data Structure for Soft Objects*, The Visual
Computer 2(4), 1986: 1 - 22/9 v² + 17/9 v⁴ - 4/9 v⁶.
"""

import hashlib
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from wrinklecli.effects.wrinkle.bumps import Bumps, Strategy, group_bumps
from wrinklecli.effects.wrinkle.places import Places
from wrinklecli.numeric.arrays import Floats, Ints

Attenuation = Literal["bell", "linear"]

# What a variation of 1 does. Widths of bumps differ by this share, before they are made to fill the segment.
_WIDTH = 0.35
# How far a furrow goes astray, as a share of the mean distance of two crests, and how steeply: the tangent of its angle
# to the ruled line. Steeper ones read as crumpled paper.
_WANDER, _STEEPEST = 0.45, 0.6
# What a bump keeps of its width, as a share, where its furrows approach each other.
_LEAST_WIDTH = 0.4
# How far inside the patch a crest may end and how much it swells on its way there, as shares of half the width and of
# its height; and how much narrower it is at its ends.
_SHORTER, _SWELL, _TAPER = 0.45, 0.18, 0.45
# From which |v| two bumps become one, over which length, more where a patch is narrow, and how high that is, over the
# wider of the two.
_MERGING, _MERGED_OVER, _MERGED_HEIGHT = (0.0, 0.2), (0.45, 0.7), 1.6
# How near the furrow between them their crests come on the way, as `_SWAY`, and from which share of the way that is
# filled: it is narrow then.
_TOGETHER, _FILLED_FROM = 0.7, 0.25
# How much of a gap between them they take over.
_CLOSED = 0.9
# Where the surface turns away, crests end at places of their own too: the cosine of vertex and patch normal at which
# they do is greater by up to this. It is reached so far from the centre line, as a share of half the width.
_TURNED, _TURNED_FROM = 0.35, 0.4
# Waves along v of a furrow, radians over half the width: half of the longest is 0.7 of a patch; the second is half as
# long, and lower.
_WAVE, _SECOND = 2.2, 0.5
# Waves along v of a swelling, over half a patch.
_SWELLINGS = (0.5, 1.0)
# How far a crest is off the middle between its furrows, as a share of half its width.
_SWAY = 0.4
# How much a furrow goes with the one before it.
_ALIKE = 0.8
# Points that are placed at once: bounds the memory, which grows with bumps too.
_AT_ONCE = 2**14
# Values of v at which bounds are measured.
_LINES = np.linspace(-1.0, 1.0, 129)


def attenuation(kind: Attenuation, v: Floats) -> Floats:
    """(…,) what is left of a height at (…,) v: all on the centre line, nothing from |v| = 1 on."""
    spread = np.minimum(np.abs(v), 1.0)
    if kind == "linear":
        return 1.0 - spread
    squared = spread**2
    left: Floats = 1.0 + squared * (-22.0 + squared * (17.0 - 4.0 * squared)) / 9.0
    return left


@dataclass(frozen=True, slots=True)
class Merger:
    """Two neighbouring bumps that become one on a side of the patch: their crests bend towards each other and meet.

    First the furrow between them gets narrow. Then they fade into a bump as wide as they are together, which fills it.

    Attributes:
        left: The first of the two.
        wider: The one of the two that is as wide as the other or wider: the joined bump is its shape, drawn out.
        side: Of the patch, −1 or 1: the sign of v.
        start: |v| where it begins.
        over: Up to where they are one, from there.
    """

    left: int
    wider: int
    side: float
    start: float
    over: float

    def together(self, v: Floats) -> Floats:
        """(…,) how much of the way towards each other their crests have come, from 0 to 1, at (…,) v."""
        return _smoothstep((self.side * v - self.start) / self.over)

    def share(self, v: Floats) -> Floats:
        """(…,) what the joined bump has of the height, from 0 to 1, at (…,) v."""
        return _smoothstep(((self.side * v - self.start) / self.over - _FILLED_FROM) / (1.0 - _FILLED_FROM))


@dataclass(frozen=True, slots=True, eq=False)
class Variation:
    """How a tool's wrinkles differ from ruled ones.

    Attributes:
        kind: How crests fade towards their ends.
        bumps: Where they lie on the centre line.
        wander: (bumps + 1, waves) of the furrows before, between and behind the bumps; 0 of the first and the last.
        sway: (bumps, waves) of each crest between its furrows, as a share of half the bump's width.
        reaches: (2, bumps) |v| where each crest ends, for v < 0 and for v ≥ 0.
        turns: (2, bumps) how much sooner each ends where the surface turns away, as a cosine, on both sides.
        swells: (3, bumps) share of the height, radians over half a patch, and radians at the centre line.
        tapers: (bumps,) how much narrower each is at its ends, from 0 to below 1.
        mergers: Pairs of bumps; none has two.
        turned: −1 where v counts the other way, for a mirrored tool; else 1.
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
        """(bumps,) the greatest height of each crest over that on the centre line."""
        heights = np.stack([self._height(bump, _LINES) for bump in range(self.bumps.count)])
        peaks: Floats = heights.max(axis=1)
        widths = self.bumps.widths
        for merger in self.mergers:
            share, pair = merger.share(_LINES), slice(merger.left, merger.left + 2)
            apart = (heights[pair] * widths[pair, None]).max(axis=0) / widths[merger.wider]
            joined = (1.0 - share) * apart + share * self._joined_height(merger, _LINES)
            peaks[merger.wider] = max(float(peaks[merger.wider]), float(joined.max()))
        return peaks

    def furrows(self, v: Floats) -> tuple[Floats, Floats]:
        """(bumps, lines) u where each bump starts, and where it ends, on (lines,) v."""
        return self._furrows(self.turned * v)

    def places(self, u: Floats, v: Floats) -> tuple[Places, Floats]:
        """Where the points of a patch are on the centre line's curve, and what they have of its height.

        Args:
            u: (…,) along the segment.
            v: (…,) across it.

        Returns:
            Places: their ũ rises strictly with u, is u itself where v = 0, and where u is not between 0 and 1; their
            factors are 1 where v = 0, and 0 in gaps; nothing is joined where v = 0;
            (…,) how much sooner a crest ends where the surface turns away, as a cosine; 0 where v = 0.
        """
        flat_u, lines = u.reshape(-1), self.turned * v.reshape(-1)
        found = np.zeros((5, len(flat_u)))
        for start in range(0, len(flat_u), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            found[:, part] = self._places(flat_u[part], lines[part])
        us, factors, joined, joined_us, turned = found.reshape(5, *u.shape)
        return (Places(us, factors, joined, joined_us) if self.mergers else Places(us, factors)), turned

    def _places(self, us: Floats, lines: Floats) -> Floats:
        """(5, points) us, factors, joined, joined_us and turned of `places`, of (points,) u and v."""
        starts, ends = self._furrows(lines)
        bumps, points = np.sum(us >= starts[1:], axis=0), np.arange(len(us))
        start, end = starts[bumps, points], ends[bumps, points]
        # From −1 to 1 over the bump: bent so that the crest is beside the middle, and narrower.
        side = np.clip((2.0 * us - start - end) / (end - start), -1.0, 1.0)
        sway = _waving(self.sway, lines)[bumps, points]
        taper = self.tapers[bumps] * np.minimum(self._spread(bumps, lines) ** 2, 1.0)
        for merger in self.mergers:
            towards = np.select([bumps == merger.left, bumps == merger.left + 1], [-_TOGETHER, _TOGETHER])
            share = merger.together(lines) * (towards != 0.0)
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
        turned = _smoothstep(np.abs(lines) / _TURNED_FROM) * np.where(lines < 0, *self.turns[:, bumps])
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

    def _furrows(self, lines: Floats) -> tuple[Floats, Floats]:
        moves = _waving(self.wander, lines)
        starts, ends = self.bumps.starts[:, None] + moves[:-1], self.bumps.ends[:, None] + moves[1:]
        for merger in self.mergers:
            closed = _CLOSED / 2.0 * merger.together(lines) * (starts[merger.left + 1] - ends[merger.left])
            ends[merger.left] += closed
            starts[merger.left + 1] -= closed
        return starts, ends

    def _spread(self, bump: int | Ints, lines: Floats) -> Floats:
        """(lines,) how far out on a crest, or each on its own, lines are: −1 and 1 where it ends."""
        spread: Floats = lines / np.where(lines < 0, *self.reaches[:, bump])
        return spread

    def _height(self, bump: int | Ints, lines: Floats) -> Floats:
        """(lines,) height of a crest, or each of its own, over that on the centre line."""
        share, turn, phase = self.swells[:, bump]
        swelling = (1.0 + share * np.sin(turn * lines + phase)) / (1.0 + share * np.sin(phase))
        height: Floats = attenuation(self.kind, self._spread(bump, lines)) * swelling
        return height

    def _joined_height(self, merger: Merger, lines: Floats) -> Floats:
        """(lines,) height of what two bumps become over that of the wider on the centre line."""
        return _MERGED_HEIGHT * self._height(merger.wider, lines)


def plan_variation(
    seed: str,
    amount: float,
    branch: float,
    *,
    bumps: int,
    gap: int,
    aspect: float,
    kind: Attenuation,
    strategy: Strategy = "everywhere",
    mirrored: bool = False,
) -> Variation:
    """Draw the irregularity of a tool's wrinkles.

    Args:
        seed: What it hangs on: the tool's name, or its `seed`.
        amount: a, above 0 and up to 1.
        branch: Chance of a bump to merge with its neighbour on a side of the patch, from 0 to 1; only bumps that rise
            together do.
        bumps: Number of bumps.
        gap: Flat intervals between neighbouring bumps.
        aspect: Half the width of the patch over the segment's length.
        kind: How crests fade.
        strategy: In which order bumps rise.
        mirrored: Whether v counts the other way, as it does on a mirrored patch.
    """
    widths = 1.0 + _WIDTH * amount * _unlike(drawn(seed, "widths", bumps))
    ruled = Bumps(widths * (bumps / widths.sum()), gap)
    starts, ends = ruled.starts, ruled.ends
    together = {pair for group in group_bumps(bumps, strategy) for pair in pairwise(sorted(group))}
    mergers = _mergers(seed, branch, ends - starts, aspect, together)
    reaches = 1.0 - _SHORTER * amount * (1.0 + drawn(seed, "reaches", 2, bumps)) / 2.0
    for merger in mergers:
        half = int(merger.side > 0)
        reaches[half, merger.left : merger.left + 2] = 1.0
    share, turn, phase = drawn(seed, "swells", 3, bumps)
    low, high = _SWELLINGS
    return Variation(
        kind=kind,
        bumps=ruled,
        wander=_wandering(drawn(seed, "furrows", bumps + 1, 4), amount, starts, ends, aspect),
        sway=_swaying(drawn(seed, "crests", bumps, 4), amount, ends - starts, aspect),
        reaches=reaches,
        turns=_TURNED * amount * (1.0 + drawn(seed, "facing", 2, bumps)) / 2.0,
        swells=np.stack(
            [_SWELL * amount * np.abs(share), 2.0 * np.pi * (low + (high - low) * np.abs(turn)), np.pi * phase]
        ),
        tapers=_TAPER * amount * (1.0 + drawn(seed, "tapers", bumps)) / 2.0,
        mergers=mergers,
        turned=-1.0 if mirrored else 1.0,
    )


def drawn(seed: str, what: str, *shape: int) -> Floats:
    """Numbers from −1 to below 1, spread evenly, the same on every machine.

    Args:
        seed: What they hang on.
        what: Numbers of another name are others.
        shape: How many.
    """
    digest = hashlib.shake_128(f"{what} {seed}".encode()).digest(8 * math.prod(shape))
    bits = np.frombuffer(digest, "<u8") >> np.uint64(11)  # 53, what a float holds exactly
    numbers: Floats = bits.reshape(shape).astype(np.float64) * 2.0**-52 - 1.0
    return numbers


def _smoothstep(t: Floats) -> Floats:
    t = np.clip(t, 0.0, 1.0)
    step: Floats = t * t * (3.0 - 2.0 * t)
    return step


def _unlike(numbers: Floats) -> Floats:
    """As many numbers from −1 to 1 in the same order, however few: one in each equal part, and more towards both ends.

    As they are, four numbers may be all but equal, which reads as ruled.
    """
    ranks = np.argsort(np.argsort(numbers, kind="stable"), kind="stable")
    spread: Floats = np.sin(np.pi / 2.0 * ((2.0 * ranks + 1.0 + numbers) / len(numbers) - 1.0))
    return spread


def _mergers(
    seed: str, branch: float, widths: Floats, aspect: float, together: set[tuple[int, int]]
) -> tuple[Merger, ...]:
    """Pairs of neighbouring bumps of (bumps,) widths, along u, of those that rise together."""
    bumps = len(widths)
    chances, sides, starts = drawn(seed, "mergers", 3, bumps)
    found: list[Merger] = []
    bump = 0
    low, high = _MERGING
    while bump + 1 < bumps:
        merges = (1.0 + chances[bump]) / 2.0 < branch and (bump, bump + 1) in together
        if merges:
            start = low + (high - low) * (1.0 + float(starts[bump])) / 2.0
            wider = bump + int(widths[bump + 1] > widths[bump])
            # Crests go about half a bump to the side.
            over = float(np.clip(0.5 * widths[wider] / (_STEEPEST * aspect), *_MERGED_OVER))
            found.append(Merger(bump, wider, side=1.0 if sides[bump] > 0 else -1.0, start=start, over=over))
        bump += 1 + merges
    return tuple(found)


def _wandering(numbers: Floats, amount: float, starts: Floats, ends: Floats, aspect: float) -> Floats:
    """(bumps + 1, waves) of the furrows, from as many random numbers, as large as all bounds allow."""
    moving: Floats = numbers.copy()
    for furrow in range(1, len(moving)):
        moving[furrow] += _ALIKE * moving[furrow - 1]
    moving[[0, -1]] = 0.0
    moves = _waving(moving, _LINES)
    farthest = np.abs(moves).max()
    if farthest == 0.0:  # of one bump
        return moving
    steepest = np.abs(np.diff(moves, axis=1)).max() / (_LINES[1] - _LINES[0])
    narrowest = (-np.diff(moves, axis=0) / (ends - starts)[:, None]).max()
    scale = min(
        _WANDER * amount / (len(starts) * farthest),
        _STEEPEST * amount * aspect / steepest,
        (1.0 - _LEAST_WIDTH) * amount / narrowest,
    )
    wander: Floats = scale * moving
    return wander


def _swaying(numbers: Floats, amount: float, widths: Floats, aspect: float) -> Floats:
    """(bumps, waves) of the crests between their furrows, from as many random numbers, as large as bounds allow."""
    moves = _waving(numbers, _LINES)
    farthest = np.abs(moves).max(axis=1)
    steepest = np.abs(np.diff(moves, axis=1)).max(axis=1) / (_LINES[1] - _LINES[0]) * widths / 2.0
    scales = amount * np.minimum(_SWAY / farthest, _STEEPEST * aspect / steepest)
    sway: Floats = scales[:, None] * numbers
    return sway


def _waving(amplitudes: Floats, lines: Floats) -> Floats:
    """(rows, lines) sums of four waves with (rows, 4) amplitudes, on (lines,) v; all are 0 on the centre line."""
    at = _WAVE * lines
    waves = [np.sin(at), 1.0 - np.cos(at), _SECOND * np.sin(2.0 * at), _SECOND * (1.0 - np.cos(2.0 * at))]
    # Same bytes: BLAS sums in another order where there are more lines.
    return np.asarray(np.einsum("rw,wl->rl", amplitudes, np.stack(waves)), np.float64)
