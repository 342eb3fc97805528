"""The paper's discrete bump, and the heights of its knots for the shortening that it takes up.

Details have a closed form: the sum of a raised point's distances from both ends of its segment is given, so the point
lies on an ellipse with these ends as foci. With details knots do not rise in proportion, so a few modes describe them.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve.

Lengths are in scene units: D of the bump, x of an interval (a bump spans two).
"""

import math
from typing import ClassVar

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.reduction import fewest_axes

MODE_ERROR = 1e-4
"""Greatest error of knots rebuilt from modes, relative to the tallest knot."""
# Distances, and shortenings at each, at which knot heights are sampled for the modes.
_SAMPLED = 33
# Largest entries of a mode that differ by less than this are equal up to rounding.
_SAME = 1e-9
# Steps of regula falsi for the capacity, at most, and relative error of the squared height that ends them.
_CAPACITY_STEPS = 60
_CAPACITY_ERROR = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class PolylineProfile:
    """The paper's discrete bump as a few modes, and its methods as `SmoothProfile` has them.

    Attributes:
        details: Fractions of the shortening that go to the finer levels.
        modes: (modes, knots) heights of a bump's knots, both ends included, greatest |height| 1.
        projection: (modes, knots) from knot heights to amplitudes.
        sampled_amplitudes: (modes,) greatest |amplitude| that the tool can reach, scene units.
    """

    details: tuple[float, ...]
    modes: Floats
    projection: Floats
    sampled_amplitudes: Floats

    # The bump is its own mirror image, turns sharply at its knots only, and has its crest in the middle.
    leans: ClassVar[bool] = False
    sharp: ClassVar[bool] = False
    crest: ClassVar[float] = 0.5

    def amplitudes(self, shortenings: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., modes) amplitudes from D and x."""
        # The limit holds where x is too long for a full bump, and trims the last bit.
        if self.details:
            shortenings = np.minimum(shortenings, self.capacity(intervals, max_height))
        heights = np.minimum(polyline_heights(self.details, shortenings, intervals), max_height)
        return np.asarray(np.einsum("...k,mk->...m", heights, self.projection), np.float64)

    def fullest(self, capacities: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., modes) amplitudes of a bump whose highest knot is at `max_height`, from its D and x."""
        return self.amplitudes(capacities, intervals, max_height)

    def capacity(self, intervals: Floats, max_height: float) -> Floats:
        """(…,) D of a bump whose highest knot is at `max_height`."""
        return polyline_capacity(self.details, intervals, max_height)

    def bounds(self, shortenings: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., modes) greatest |amplitude| on the way to D at x."""
        # A mode may turn round on the way, so its end is no bound; its samples are.
        reached = np.abs(self.amplitudes(shortenings, intervals, max_height))
        return np.where(shortenings[..., None] > 0, np.maximum(self.sampled_amplitudes, reached), 0.0)

    def excess(self, amplitudes: Floats, intervals: Floats) -> Floats:
        """(…,) arc length of a bump minus its chord, from (..., modes) amplitudes."""
        rises = np.diff(self._heights(amplitudes))
        chords = np.broadcast_to(2 * intervals[..., None] / rises.shape[-1], rises.shape)
        # √(c² + r²) − c = r²/(√(c² + r²) + c), exact for small r.
        sums = np.hypot(rises, chords) + chords
        slopes = np.divide(rises, sums, out=np.zeros_like(rises), where=sums > 0)
        return np.asarray((rises * slopes).sum(axis=-1), np.float64)

    def highest(self, amplitudes: Floats) -> Floats:
        """(…,) height of the highest knot, from (..., modes) amplitudes."""
        return np.asarray(self._heights(amplitudes).max(axis=-1), np.float64)

    def shapes(self, taus: Floats) -> Floats:
        """(modes, ...) heights at τ for amplitude 1."""
        knots = np.linspace(0.0, 1.0, self.modes.shape[1])
        return np.stack([np.interp(taus, knots, mode) for mode in self.modes])

    def warped(self, taus: Floats) -> Floats:
        """(…,) τ itself."""
        return taus

    def _heights(self, amplitudes: Floats) -> Floats:
        return np.asarray(np.einsum("...m,mk->...k", amplitudes, self.modes), np.float64)


def plan_polyline(details: tuple[float, ...], samples: Floats) -> PolylineProfile:
    """Reduce (samples, knots) heights of a bump's knots to the fewest modes that keep within `MODE_ERROR`."""

    def fits(modes: Floats) -> bool:
        rebuilt = np.einsum("sm,mk->sk", np.einsum("sk,mk->sm", samples, modes), modes)
        return bool(np.abs(samples - rebuilt).max() <= limit)

    limit = MODE_ERROR * samples.max()
    kept = fewest_axes(samples, fits)
    # The sign of a singular vector is arbitrary: make its largest entry (the first within rounding) 1.
    sizes = np.abs(kept)
    peaks = np.argmax(sizes > sizes.max(axis=1, keepdims=True) * (1 - _SAME), axis=1)
    scales = kept[np.arange(len(kept)), peaks][:, None]
    projection = kept * scales
    sampled = np.abs(np.einsum("sk,mk->sm", samples, projection)).max(axis=0)
    return PolylineProfile(details, kept / scales + 0.0, projection + 0.0, sampled)  # + 0.0: no −0.0


def reachable_heights(
    details: tuple[float, ...], max_height: float, greatest: float, reached: float, interval_count: int, sharing: float
) -> Floats:
    """(samples, knots) knot heights of a bump over the (x, D) that a tool can reach, scene units.

    `greatest` is the greatest taut length, `reached` the greatest d, and `sharing` the total width of the first group's
    bumps, which share all of d.
    """
    distances = (greatest - reached) + reached * np.linspace(0.0, 1.0, _SAMPLED, endpoint=False)
    intervals = distances / interval_count
    # A tool that never rises still needs a shape.
    limit = max_height if max_height > 0 else math.inf
    greatest_shares = np.minimum((greatest - distances) / sharing, polyline_capacity(details, intervals, limit))
    shares = greatest_shares[:, None] * np.linspace(0.0, 1.0, _SAMPLED + 1)[1:] ** 2
    heights = polyline_heights(details, shares, intervals[:, None])
    return heights.reshape(-1, heights.shape[-1])


def polyline_heights(details: tuple[float, ...], shortenings: Floats, intervals: Floats) -> Floats:
    """(..., 2^(levels + 1) + 1) heights of the knots at equal steps from end to end, from (...) D and x."""
    shortenings, steps = np.broadcast_arrays(shortenings[..., None], intervals[..., None])
    apexes = (1 - math.fsum(details)) * shortenings
    heights: Floats = np.sqrt(apexes * (steps + apexes / 4)) * np.array([0.0, 1.0, 0.0])
    for share in details:
        rises = np.diff(heights)
        lengths = np.hypot(rises, steps)
        totals = lengths.sum(axis=-1, keepdims=True)
        parts = np.divide(lengths, totals, out=np.zeros_like(lengths), where=totals > 0)
        # a and b are the half axes of the ellipse through the new point, with the segment's ends as foci; `added` is e.
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
    """(…,) D at which a bump's highest knot is at `max_height`, from x; scene units.

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
    for _ in range(_CAPACITY_STEPS):
        spans = high_misses - low_misses
        fractions = np.divide(-low_misses, spans, out=np.zeros_like(spans), where=spans > 0)
        guesses = np.clip(lows + fractions * (highs - lows), lows, highs)
        found = misses(guesses)
        above = found > 0
        # An end that stays for a second time counts half, or it would stay for good.
        low_misses = np.where(above, np.where(side == 1, low_misses / 2, low_misses), found)
        high_misses = np.where(above, found, np.where(side == -1, high_misses / 2, high_misses))
        lows, highs = np.where(above, lows, guesses), np.where(above, guesses, highs)
        side = np.where(above, 1, -1)
        if np.abs(found).max(initial=0.0) < _CAPACITY_ERROR:
            break
    return np.asarray(guesses, np.float64)
