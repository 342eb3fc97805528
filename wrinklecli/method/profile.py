"""The shape of one bump and how high it rises: from the shortening that it takes up and its chord to its heights.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve: a raised control point between two neighbours absorbs a shortening D by
h = √(Dx + D²/4), x the current control interval.

Differs from the paper:
- `smooth` (the default) raises A·g(τ) over a bump, with A solved so that the true arc length is kept. C¹,
  flat at a bump's ends, never negative, linear in A: one shape serves all heights, and details cost no more.
  Rejected: Catmull-Rom through the control points dips 12 % below the surface; PCHIP kinks at the patch's end; a
  cubic B-spline does not end at 0; one factor for the whole curve makes full bumps breathe.
- `polyline` is the paper's discrete curve. Its details have a closed form: a raised point keeps two lengths'
  sum, so it lies on an ellipse whose foci are the segment's ends.

- `skin` and `cloth` are `smooth` with the place on the bump warped (`warped`): skin has round crests and narrow
  furrows, cloth leans. A warp keeps all of the above: these, too, are fixed shapes times A.

Lengths are in scene units: D of the bump, x of an interval (a bump spans two), A of its height.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.polynomial import chebyshev

from wrinklecli.numeric.arrays import Floats

Profile = Literal["smooth", "skin", "cloth", "polyline"]

# tan(πμ) over tan(πτ) of skin: at half its depth, τ = 1/8, a furrow then is a quarter as wide as its crests are apart;
# that of `smooth` is half as wide.
_NARROW = 1.0 / math.tan(math.pi / 8.0)
# How far the crest of cloth is off the middle of its bump, of half its width.
_LEAN = 0.3

MODE_ERROR = 1e-4
"""Largest error of a polyline's knots as rebuilt from its modes, of the tallest knot."""

FIT_ERROR = 1e-13
"""Size of an interpolant's last coefficients, of its largest: four digits better than promised (1e-9)."""

_LEAST = 1e-300
"""In place of a divisor that is 0."""

_PIECES = 1024
"""Pieces of an interpolant: 56 kB, which a core's cache holds.

Right to 5e-13 of the greatest value; half as many are right to 3e-12.
"""

# Over a bump, lengths enter only as two parts of a whole: its chord 2x, and D or A. Its part c in [0, 1]
# is mapped to q = 1 − c^¼, which makes both maps between A and D smooth on [0, 1]: the root at D = 0 is
# factored out (√q), and the c² log c of a vanishing chord becomes (1 − q)⁸ log(1 − q).


@dataclass(frozen=True, slots=True, eq=False)
class SmoothProfile:
    """A bump A g(μ(τ)), τ ∈ [0, 1], g = sin²(πμ) + Σₖ rₖ sin²(2ᵏπμ), rₖ = 2⁻ᵏ √(sₖ/(1 − Σs)).

    Attributes:
        kind: Which μ; see `warped`.
        ratios: (levels + 1,) 1, r₁, r₂, …
        peak: Greatest value of g.
        to_amplitude: Over q, of A / (whole √q), whole = 2x + D.
        to_shortening: Over q, of D / (whole q²), whole = 2x + A.
    """

    kind: Profile
    ratios: Floats
    peak: float
    to_amplitude: "Interpolant"
    to_shortening: "Interpolant"

    @property
    def leans(self) -> bool:
        """Whether it differs from its mirror image."""
        return self.kind == "cloth"

    @property
    def crest(self) -> float:
        """τ of its highest point, without details."""
        return float(_unwarped(self.kind, np.array(0.5)))

    def amplitudes(self, shortenings: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., 1) A of mean over τ of √((2x)² + (A g')²) = 2x + D, from D and x; scene units."""
        wholes, q = _parts(2 * intervals, shortenings)
        rises = wholes * np.sqrt(q) * self.to_amplitude(q)
        return np.minimum(rises, max_height / self.peak)[..., None]

    def fullest(self, _: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., 1) A of a bump whose highest point is at `max_height`, from its D and x; scene units."""
        return np.full((*intervals.shape, 1), max_height / self.peak)

    def capacity(self, intervals: Floats, max_height: float) -> Floats:
        """D of a bump whose highest point is at `max_height`, from x; scene units."""
        if math.isinf(max_height):
            return np.full_like(intervals, math.inf)
        return self._shortenings(max_height / self.peak, intervals)

    def excess(self, amplitudes: Floats, intervals: Floats) -> Floats:
        """Arc length of a bump less its chord, from (..., 1) amplitudes and x; scene units."""
        return self._shortenings(amplitudes[..., 0], intervals)

    def highest(self, amplitudes: Floats) -> Floats:
        """Height of the highest point, from (..., 1) amplitudes; scene units."""
        return np.asarray(self.peak * amplitudes[..., 0], np.float64)

    def shapes(self, taus: Floats) -> Floats:
        """(1, ...) g(μ(τ))."""
        places, _ = warped(self.kind, taus)
        return sum(
            (ratio * np.sin(2**level * np.pi * places) ** 2 for level, ratio in enumerate(self.ratios)),
            start=np.zeros_like(taus),
        )[None]

    def _shortenings(self, amplitudes: Floats | float, intervals: Floats) -> Floats:
        wholes, q = _parts(2 * intervals, amplitudes)
        return np.asarray(wholes * q**2 * self.to_shortening(q), np.float64)


def _parts(chords: Floats, others: Floats | float) -> tuple[Floats, Floats]:
    """The whole, chord + other, and q = 1 − (chord / whole)^¼ without cancellation; 0 where the whole is."""
    wholes = chords + others
    # Where nothing is, both are 0, and so is q.
    divisors = np.maximum(wholes, _LEAST)
    roots = np.sqrt(chords / divisors)
    parts: Floats = others / divisors
    parts /= 1 + np.sqrt(roots)
    parts /= 1 + roots
    return wholes, parts


def warped(kind: Profile, taus: Floats) -> tuple[Floats, Floats]:
    """(…,) μ(τ), rising from 0 to 1 with τ, and dμ/dτ."""
    if kind == "skin":
        # tan πμ = k tan πτ
        sines, cosines = np.sin(np.pi * taus), np.cos(np.pi * taus)
        slopes = _NARROW / (cosines * cosines + (_NARROW * sines) ** 2)
        return np.arctan2(_NARROW * sines, cosines) / np.pi, slopes
    if kind == "cloth":
        # A Möbius map of [−1, 1].
        divisors = 1.0 - _LEAN * (2.0 * taus - 1.0)
        return taus * (1.0 - _LEAN) / divisors, (1.0 - _LEAN * _LEAN) / (divisors * divisors)
    return taus, np.ones_like(taus)


def _unwarped(kind: Profile, places: Floats) -> Floats:
    """(…,) τ at (…,) μ."""
    if kind == "skin":
        return np.asarray(np.arctan2(np.sin(np.pi * places), _NARROW * np.cos(np.pi * places)) / np.pi, np.float64)
    return places * (1.0 + _LEAN) / (1.0 + _LEAN * (2.0 * places - 1.0)) if kind == "cloth" else places


@lru_cache(maxsize=16)  # all tools of most files have the same details
def plan_smooth(details: tuple[float, ...], kind: Profile = "smooth") -> SmoothProfile:
    """Solve A for all D and x at once: build the interpolants of a smooth bump with these details."""
    levels = np.arange(len(details) + 1)
    ratios = np.sqrt(np.array([1.0, *(np.array(details) / (1 - math.fsum(details)))])) / 2**levels
    # sin²(2ᵏπτ) = (1 − T_m(c))/2 with m = 2ᵏ, c = cos 2πτ; and d²T_m/dτ² = −(2πm)² T_m.
    series = np.zeros(2 ** len(details) + 1)
    series[2**levels] = -ratios / 2
    bends = series * np.arange(len(series)) ** 2.0
    turns = [np.real(chebyshev.chebroots(c)) for c in (chebyshev.chebder(series), bends) if len(c) > 1]
    points = np.arccos(np.clip(np.concatenate(turns), -1.0, 1.0)) / (2 * np.pi)
    # A turning point is at a root; the real part of a complex one is a harmless further candidate.
    candidates = np.concatenate([points, [0.5]])
    peak = float(max(sum(r * np.sin(2**k * np.pi * candidates) ** 2 for k, r in enumerate(ratios))))
    breaks = np.sort(np.concatenate([[0.0], points, [0.5]]))
    if kind == "cloth":  # not symmetric
        breaks = np.concatenate([breaks, 1.0 - breaks[-2::-1]])
    taus, weights = _quadrature(_unwarped(kind, breaks))
    places, stretches = warped(kind, taus)
    slopes = np.abs(sum(r * 2**k * np.pi * np.sin(2 ** (k + 1) * np.pi * places) for k, r in enumerate(ratios)))
    slopes *= stretches

    def excess(amplitudes: Floats, chords: Floats) -> tuple[Floats, Floats]:
        # Arc length less chord, and its derivative by A; s²/(√(c² + s²) + c) has no cancellation. (`hypot` is slower.)
        rises = amplitudes[:, None] * slopes
        arcs = np.sqrt(rises * rises + (chords * chords)[:, None])
        return (
            np.einsum("sq,q->s", rises * (rises / (arcs + chords[:, None])), weights),
            np.einsum("sq,q->s", slopes * (rises / arcs), weights),
        )

    def amplitudes(q: Floats) -> Floats:
        chords, shortenings = (1 - q) ** 4, q * (2 - q) * (1 + (1 - q) ** 2)
        # Jensen: at this A the curve is too long; the length is convex in A, so Newton comes down from there.
        guesses = np.sqrt(shortenings * (1 + chords)) / np.einsum("q,q->", slopes, weights)
        for _ in range(40):
            lengths, derivatives = excess(guesses, chords)
            steps = (lengths - shortenings) / derivatives
            guesses = guesses - steps
            if np.max(np.abs(steps) / guesses) < 1e-9:  # Quadratic: the step after would be 1e-18.
                break
        return np.asarray(guesses / np.sqrt(q), np.float64)

    def shortenings(q: Floats) -> Floats:
        return excess(q * (2 - q) * (1 + (1 - q) ** 2), (1 - q) ** 4)[0] / q**2

    return SmoothProfile(kind, ratios, peak, _interpolate(amplitudes), _interpolate(shortenings))


def _quadrature(breaks: Floats) -> tuple[Floats, Floats]:
    """Nodes and weights of the mean over τ of a function on [0, 1], or of one with period 1, symmetric about ½.

    Nodes crowd exponentially at the breaks: √(c² + (A g')²) has a rounded kink at each zero of g', of a width
    c/A that goes to 0. The trapezoid rule in y, τ = 1/(1 + e⁻ʸ) within a panel, resolves all widths alike.

    Args:
        breaks: (panels + 1,) rising from 0 to 1, or to ½: zeros of g', and of g'' where g' may nearly vanish.
    """
    step, end = 0.16, 32.0  # Errors e^(−2π (π/4) / step) and e^(−end), both below 1e-13.
    ys = np.arange(-end, end + step / 2, step)
    fractions = 1 / (1 + np.exp(-ys))
    widths = np.diff(breaks)
    taus = breaks[:-1, None] + widths[:, None] * fractions
    weights = step / breaks[-1] * widths[:, None] * fractions * fractions[::-1]
    return taus.reshape(-1), weights.reshape(-1)


@dataclass(frozen=True, slots=True, eq=False)
class Interpolant:
    """A smooth function on [0, 1]: a polynomial of degree 6 on each of many equal pieces.

    One Chebyshev series for all, of 35 to 128 terms, takes three to ten times as long.

    Attributes:
        coefficients: (7, pieces) from the constant to the sixth power of where in its piece a point is.
    """

    coefficients: Floats

    def __call__(self, points: Floats) -> Floats:
        """(…) values at (…) points."""
        count = self.coefficients.shape[1]
        scaled = points * count
        pieces = np.minimum(scaled.astype(np.intp), count - 1)
        within = scaled - pieces
        # `pieces` are in range; "clip" spares the check for it, which takes half as long again.
        value: Floats = self.coefficients[6].take(pieces, mode="clip")
        for row in self.coefficients[5::-1]:
            value *= within
            value += row.take(pieces, mode="clip")
        return value


def _interpolate(function: Callable[[Floats], Floats]) -> Interpolant:
    """An interpolant of a function on [0, 1], by way of a Chebyshev series as long as `FIT_ERROR` asks for."""
    coefficients = np.zeros(1)
    for degree in (63, 127, 255, 511):
        points = chebyshev.chebpts1(degree + 1)
        # The mean of f T_k over these points, doubled but for k = 0: interpolation in closed form.
        basis = chebyshev.chebvander(points, degree)
        coefficients = np.einsum("pk,p->k", basis, function((points + 1) / 2)) * 2 / (degree + 1)
        coefficients[0] /= 2
        bound = FIT_ERROR * np.max(np.abs(coefficients))
        if np.max(np.abs(coefficients[-degree // 8 :])) < bound:
            break
    series = chebyshev.chebtrim(coefficients, FIT_ERROR / 10)
    nodes = (1 - np.cos(np.pi * np.arange(7) / 6)) / 2
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    places = (np.arange(_PIECES)[:, None] + nodes) / _PIECES
    return Interpolant(np.ascontiguousarray(inverse @ chebyshev.chebval(2 * places - 1, series).T))


@dataclass(frozen=True, slots=True, eq=False)
class PolylineProfile:
    """The paper's discrete bump, as a few modes: with details, its knots do not rise in proportion.

    Attributes:
        details: Shares of the finer levels.
        modes: (modes, knots) heights of a bump's knots, both ends included, greatest |height| 1.
        projection: (modes, knots) from knot heights to amplitudes.
        sampled_amplitudes: (modes,) greatest |amplitude| over what the tool can reach, scene units.
    """

    details: tuple[float, ...]
    modes: Floats
    projection: Floats
    sampled_amplitudes: Floats

    @property
    def leans(self) -> bool:
        """Whether it differs from its mirror image."""
        return False

    @property
    def crest(self) -> float:
        """τ of its highest point, without details."""
        return 0.5

    def amplitudes(self, shortenings: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., modes) from D and x; scene units."""
        # The limit holds where x is too long for a full bump, and trims the last bit.
        if self.details:
            shortenings = np.minimum(shortenings, self.capacity(intervals, max_height))
        heights = np.minimum(polyline_heights(self.details, shortenings, intervals), max_height)
        return np.asarray(np.einsum("...k,mk->...m", heights, self.projection), np.float64)

    def fullest(self, capacities: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., modes) of a bump whose highest knot is at `max_height`, from its D and x; scene units."""
        return self.amplitudes(capacities, intervals, max_height)

    def capacity(self, intervals: Floats, max_height: float) -> Floats:
        """D of a bump whose highest knot is at `max_height`, from x; scene units."""
        return polyline_capacity(self.details, intervals, max_height)

    def excess(self, amplitudes: Floats, intervals: Floats) -> Floats:
        """Arc length of a bump less its chord, from (..., modes) amplitudes and x; scene units."""
        rises = np.diff(self._heights(amplitudes))
        chords = np.broadcast_to(2 * intervals[..., None] / rises.shape[-1], rises.shape)
        # √(c² + r²) − c = r²/(√(c² + r²) + c), exact for small r.
        sums = np.hypot(rises, chords) + chords
        slopes = np.divide(rises, sums, out=np.zeros_like(rises), where=sums > 0)
        return np.asarray((rises * slopes).sum(axis=-1), np.float64)

    def highest(self, amplitudes: Floats) -> Floats:
        """Height of the highest knot, from (..., modes) amplitudes; scene units."""
        return np.asarray(self._heights(amplitudes).max(axis=-1), np.float64)

    def shapes(self, taus: Floats) -> Floats:
        """(modes, ...) heights at τ for amplitude 1."""
        knots = np.linspace(0.0, 1.0, self.modes.shape[1])
        return np.stack([np.interp(taus, knots, mode) for mode in self.modes])

    def _heights(self, amplitudes: Floats) -> Floats:
        return np.asarray(np.einsum("...m,mk->...k", amplitudes, self.modes), np.float64)


def plan_polyline(details: tuple[float, ...], samples: Floats) -> PolylineProfile:
    """Reduce sampled knot heights to the fewest modes that keep within `MODE_ERROR`.

    Args:
        details: Shares of the finer levels.
        samples: (samples, knots) heights of a bump's knots, scene units.
    """
    vectors = np.linalg.svd(samples, full_matrices=False)[2]
    limit = MODE_ERROR * samples.max()
    for count in range(1, len(vectors) + 1):
        kept = vectors[:count]
        rebuilt = np.einsum("sm,mk->sk", np.einsum("sk,mk->sm", samples, kept), kept)
        if np.abs(samples - rebuilt).max() <= limit:
            break
    # The sign of a singular vector is arbitrary: make its largest entry (the first within rounding) 1.
    sizes = np.abs(kept)
    peaks = np.argmax(sizes > sizes.max(axis=1, keepdims=True) * (1 - 1e-9), axis=1)
    scales = kept[np.arange(len(kept)), peaks][:, None]
    projection = kept * scales
    sampled = np.abs(np.einsum("sk,mk->sm", samples, projection)).max(axis=0)
    return PolylineProfile(details, kept / scales + 0.0, projection + 0.0, sampled)  # + 0.0: no −0.0


def reachable_heights(
    details: tuple[float, ...], max_height: float, greatest: float, reached: float, interval_count: int, sharing: float
) -> Floats:
    """(samples, knots) knot heights of a bump over the (x, D) that a tool can reach, scene units.

    Args:
        details: Shares of the finer levels.
        max_height: Of a bump, scene units.
        greatest: The greatest taut length, scene units.
        reached: The greatest d, scene units.
        interval_count: n.
        sharing: Sum of the widths of the first group's bumps, which share all of d.
    """
    distances = (greatest - reached) + reached * np.linspace(0.0, 1.0, 33, endpoint=False)
    intervals = distances / interval_count
    # A tool that never rises still needs a shape.
    limit = max_height if max_height > 0 else math.inf
    greatest_shares = np.minimum((greatest - distances) / sharing, polyline_capacity(details, intervals, limit))
    shares = greatest_shares[:, None] * np.linspace(0.0, 1.0, 34)[1:] ** 2
    heights = polyline_heights(details, shares, intervals[:, None])
    return heights.reshape(-1, heights.shape[-1])


def polyline_heights(details: tuple[float, ...], shortenings: Floats, intervals: Floats) -> Floats:
    """Knots of the paper's discrete bump.

    Args:
        details: Shares of the finer levels.
        shortenings: (...) D, scene units.
        intervals: (...) x, scene units.

    Returns:
        (..., 2^(levels + 1) + 1) heights at equal steps from end to end, scene units.
    """
    shortenings, steps = np.broadcast_arrays(shortenings[..., None], intervals[..., None])
    apexes = (1 - math.fsum(details)) * shortenings
    heights: Floats = np.sqrt(apexes * (steps + apexes / 4)) * np.array([0.0, 1.0, 0.0])
    for share in details:
        rises = np.diff(heights)
        lengths = np.hypot(rises, steps)
        totals = lengths.sum(axis=-1, keepdims=True)
        parts = np.divide(lengths, totals, out=np.zeros_like(lengths), where=totals > 0)
        # Half axes a, b of the ellipse through the new point, the foci at the segment's ends; `added` is e.
        added = share * shortenings * parts
        a, b = (lengths + added) / 2, np.sqrt(added * (2 * lengths + added)) / 2
        spans = np.hypot(b * rises, a * steps)
        lifts = np.divide(a * b * lengths, spans, out=np.zeros_like(spans), where=spans > 0)
        finer = np.zeros((*heights.shape[:-1], 2 * heights.shape[-1] - 1))
        finer[..., ::2] = heights
        finer[..., 1::2] = (heights[..., :-1] + heights[..., 1:]) / 2 + lifts
        heights, steps = finer, steps / 2
    return heights


def polyline_capacity(details: tuple[float, ...], intervals: Floats, max_height: float) -> Floats:
    """D at which a bump's highest knot is at `max_height`, from x; scene units, same shape.

    Regula falsi in the Illinois form on (D, height²), nearly straight for small D and convex for large.
    """
    if math.isinf(max_height):
        return np.full_like(intervals, math.inf)
    sums = np.hypot(intervals, max_height) + intervals
    lows = 2 * max_height * np.divide(max_height, sums, out=np.zeros_like(sums), where=sums > 0)
    if not details or max_height == 0:
        return lows
    # A hat of the same length is higher than any curve; the apex alone, with its share of D, is lower.
    highs = lows / (1 - math.fsum(details))

    def misses(shortenings: Floats) -> Floats:
        peaks = polyline_heights(details, shortenings, intervals).max(axis=-1) / max_height
        return np.asarray((peaks - 1) * (peaks + 1), np.float64)

    low_misses, high_misses = np.minimum(misses(lows), 0.0), np.maximum(misses(highs), 0.0)
    side = np.zeros(lows.shape, np.intp)
    for _ in range(60):
        spans = high_misses - low_misses
        fractions = np.divide(-low_misses, spans, out=np.zeros_like(spans), where=spans > 0)
        guesses = np.clip(lows + fractions * (highs - lows), lows, highs)
        found = misses(guesses)
        above = found > 0
        # The end that stays for a second time counts half, or it would stay for good.
        low_misses = np.where(above, np.where(side == 1, low_misses / 2, low_misses), found)
        high_misses = np.where(above, found, np.where(side == -1, high_misses / 2, high_misses))
        lows, highs = np.where(above, lows, guesses), np.where(above, guesses, highs)
        side = np.where(above, 1, -1)
        if np.abs(found).max(initial=0.0) < 1e-14:
            break
    return np.asarray(guesses, np.float64)
