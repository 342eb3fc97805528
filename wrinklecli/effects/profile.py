"""The shape of one bump, and its height for the shortening that it takes up.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve: a raised control point between two neighbours absorbs a shortening D by
h = √(Dx + D²/4), x the current control interval.

Differs from the paper, whose discrete curve is the profile `polyline`, in a module of that name:
- `smooth` (the default) raises A·g(τ) over a bump, with A solved so that the true arc length is kept. It is C¹, flat at
  a bump's ends, never negative and linear in A, so one shape serves all heights and details cost no more.
  Rejected: Catmull-Rom through the control points dips 12 % below the surface; PCHIP kinks at the patch's end; a
  cubic B-spline does not end at 0; one factor for the whole curve makes full bumps breathe.
- The other profiles of `WARPS` are `smooth` with τ warped: skin has round crests and narrow furrows, cloth leans. A
  warp keeps all of the above, so these too are fixed shapes times A.

Lengths are in scene units: D of the bump, x of an interval (a bump spans two), A of the bump's height.
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from wrinklecli.choices import Profile
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats

# tan(πμ) over tan(πτ) of skin. At half its depth, τ = 1/8, a furrow is then a quarter as wide as the distance of two
# crests; that of `smooth` is half as wide.
_NARROW = 1.0 / math.tan(math.pi / 8.0)
# Distance of cloth's crest from the middle of its bump, relative to half the bump's width.
_LEAN = 0.3
# Newton steps for A, at most; they are quadratic, so a step of _STEP_ERROR leaves an error of its square.
_NEWTON_STEPS = 40
# Relative length of a step that ends them.
_STEP_ERROR = 1e-9
# Quadrature of the arc length: step in y = ln(τ/(1 − τ)), its error e^(−2π (π/4) / step) being below 1e-13,
_QUADRATURE_STEP = 0.16
# and greatest |y|, its error e^(−end) being below 1e-13.
_QUADRATURE_END = 32.0
# Bumps whose arc lengths are found at once.
_AT_ONCE = 8

# Over a bump, lengths enter only as two parts of a whole: the chord 2x, and D or A. The chord's fraction c in [0, 1] is
# mapped to q = 1 − c^¼, which makes both maps between A and D smooth on [0, 1]: the root at D = 0 is factored out (√q),
# and the c² log c of a vanishing chord becomes (1 − q)⁸ log(1 − q).

FIT_ERROR = 1e-13
"""Size of an interpolant's last coefficients, relative to its largest."""

# Pieces of an interpolant: 56 kB, which a core's cache holds. Values are right to 5e-13 of the greatest; with half as
# many pieces to 3e-12.
_PIECES = 1024


@dataclass(frozen=True, slots=True, eq=False)
class Interpolant:
    """A polynomial of degree 6 on each of many equal pieces of [0, 1].

    One Chebyshev series for all pieces, of 35 to 128 terms, takes three to ten times as long.

    Attributes:
        coefficients: (7, pieces) from the constant up, of the position within the piece, 0 to 1.
    """

    coefficients: Floats

    def __call__(self, points: Floats) -> Floats:
        """(…) values at (…) points."""
        count = self.coefficients.shape[1]
        scaled = points * count
        pieces = np.minimum(scaled.astype(np.intp), count - 1)
        within = scaled - pieces
        # `pieces` are in range, so "clip" only avoids a check, which takes half as long again.
        value: Floats = self.coefficients[6].take(pieces, mode="clip")
        for row in self.coefficients[5::-1]:
            value *= within
            value += row.take(pieces, mode="clip")
        return value


def interpolate(function: Callable[[Floats], Floats]) -> Interpolant:
    """Approximate a function on [0, 1] through a Chebyshev series as long as `FIT_ERROR` needs."""
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
class Warp:
    """A map of [0, 1] to itself that gives a bump the shape of a profile.

    Attributes:
        places: (…,) μ(τ), which rises with τ from 0 to 1, and dμ/dτ.
        inverse: (…,) τ(μ).
        leans: True if the bump differs from its mirror image.
    """

    places: Callable[[Floats], tuple[Floats, Floats]]
    inverse: Callable[[Floats], Floats]
    leans: bool = False


def _narrow(taus: Floats) -> tuple[Floats, Floats]:
    # tan πμ = k tan πτ
    sines, cosines = np.sin(np.pi * taus), np.cos(np.pi * taus)
    slopes = _NARROW / (cosines * cosines + (_NARROW * sines) ** 2)
    return np.arctan2(_NARROW * sines, cosines) / np.pi, slopes


def _widen(places: Floats) -> Floats:
    return np.asarray(np.arctan2(np.sin(np.pi * places), _NARROW * np.cos(np.pi * places)) / np.pi, np.float64)


def _lean(taus: Floats) -> tuple[Floats, Floats]:
    # A Möbius map of [−1, 1].
    divisors = 1.0 - _LEAN * (2.0 * taus - 1.0)
    return taus * (1.0 - _LEAN) / divisors, (1.0 - _LEAN * _LEAN) / (divisors * divisors)


def _straighten(places: Floats) -> Floats:
    return places * (1.0 + _LEAN) / (1.0 + _LEAN * (2.0 * places - 1.0))


WARPS: Mapping[Profile, Warp] = {
    "smooth": Warp(lambda taus: (taus, np.ones_like(taus)), lambda places: places),
    "skin": Warp(_narrow, _widen),
    "cloth": Warp(_lean, _straighten, leans=True),
}


@dataclass(frozen=True, slots=True, eq=False)
class SmoothProfile:
    """A bump A g(μ(τ)), τ ∈ [0, 1], g = sin²(πμ) + Σₖ rₖ sin²(2ᵏπμ), rₖ = 2⁻ᵏ √(sₖ/(1 − Σs)).

    Attributes:
        kind: The profile, which chooses μ; see `WARPS`.
        ratios: (levels + 1,) 1, r₁, r₂, …
        peak: Greatest value of g.
        to_amplitude: A / (whole √q) over q, with whole = 2x + D.
        to_shortening: D / (whole q²) over q, with whole = 2x + A.
    """

    kind: Profile
    ratios: Floats
    peak: float
    to_amplitude: Interpolant
    to_shortening: Interpolant

    @property
    def leans(self) -> bool:
        """True if the bump differs from its mirror image."""
        return WARPS[self.kind].leans

    @property
    def sharp(self) -> bool:
        """True if some parts of the bump turn more sharply than those of `smooth`."""
        return self.kind != "smooth"

    @property
    def crest(self) -> float:
        """The τ of the highest point, without details."""
        return float(WARPS[self.kind].inverse(np.array(0.5)))

    def amplitudes(self, shortenings: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., 1) the A that solves: mean over τ of √((2x)² + (A g')²) = 2x + D."""
        wholes, q = _parts(2 * intervals, shortenings)
        amplitudes = wholes * np.sqrt(q) * self.to_amplitude(q)
        return np.minimum(amplitudes, max_height / self.peak)[..., None]

    def fullest(self, _: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., 1) A of a bump whose highest point is at `max_height`."""
        return np.full((*intervals.shape, 1), max_height / self.peak)

    def capacity(self, intervals: Floats, max_height: float) -> Floats:
        """(…,) D of a bump whose highest point is at `max_height`."""
        if math.isinf(max_height):
            return np.full_like(intervals, math.inf)
        return self._shortenings(max_height / self.peak, intervals)

    def bounds(self, shortenings: Floats, intervals: Floats, max_height: float) -> Floats:
        """(..., 1) greatest A on the way to D at x."""
        return self.amplitudes(shortenings, intervals, max_height)

    def excess(self, amplitudes: Floats, intervals: Floats) -> Floats:
        """(…,) arc length of a bump minus its chord, from (..., 1) amplitudes."""
        return self._shortenings(amplitudes[..., 0], intervals)

    def highest(self, amplitudes: Floats) -> Floats:
        """(…,) height of the highest point, from (..., 1) amplitudes."""
        return np.asarray(self.peak * amplitudes[..., 0], np.float64)

    def shapes(self, taus: Floats) -> Floats:
        """(1, ...) g(μ(τ)), heights at τ for amplitude 1."""
        places = self.warped(taus)
        return sum(
            (ratio * np.sin(2**level * np.pi * places) ** 2 for level, ratio in enumerate(self.ratios)),
            start=np.zeros_like(taus),
        )[None]

    def warped(self, taus: Floats) -> Floats:
        """(…,) μ(τ), the place on the bump of `smooth` that has the same height; it rises with τ from 0 to 1."""
        return WARPS[self.kind].places(taus)[0]

    def _shortenings(self, amplitudes: Floats | float, intervals: Floats) -> Floats:
        wholes, q = _parts(2 * intervals, amplitudes)
        return np.asarray(wholes * q**2 * self.to_shortening(q), np.float64)


def _parts(chords: Floats, others: Floats | float) -> tuple[Floats, Floats]:
    """The whole, chord + other, and q = 1 − (chord / whole)^¼ without cancellation; both 0 if the whole is 0."""
    wholes = chords + others
    divisors = np.maximum(wholes, TINY)
    roots = np.sqrt(chords / divisors)
    parts: Floats = others / divisors
    parts /= 1 + np.sqrt(roots)
    parts /= 1 + roots
    return wholes, parts


@lru_cache(maxsize=16)  # all tools of most files have the same details
def plan_smooth(details: tuple[float, ...], kind: Profile = "smooth") -> SmoothProfile:
    """Build the interpolants of a smooth bump with these details, which solve A for all D and x at once."""
    levels = np.arange(len(details) + 1)
    ratios = np.sqrt(np.array([1.0, *(np.array(details) / (1 - math.fsum(details)))])) / 2**levels
    # sin²(2ᵏπτ) = (1 − T_m(c))/2 with m = 2ᵏ, c = cos 2πτ; and d²T_m/dτ² = −(2πm)² T_m. Factors change no root.
    series = np.zeros(2 ** len(details) + 1)
    series[2**levels] = ratios
    bends = series * np.arange(len(series)) ** 2.0
    turns = [np.real(chebyshev.chebroots(c)) for c in (chebyshev.chebder(series), bends) if len(c) > 1]
    points = np.arccos(np.clip(np.concatenate(turns), -1.0, 1.0)) / (2 * np.pi)
    # A turning point is at a root; the real part of a complex root is a harmless further candidate.
    candidates = np.concatenate([points, [0.5]])
    peak = float(max(sum(r * np.sin(2**k * np.pi * candidates) ** 2 for k, r in enumerate(ratios))))
    breaks = np.sort(np.concatenate([[0.0], points, [0.5]]))
    warp = WARPS[kind]
    if warp.leans:  # not symmetric
        breaks = np.concatenate([breaks, 1.0 - breaks[-2::-1]])
    taus, weights = _quadrature(warp.inverse(breaks))
    places, stretches = warp.places(taus)
    slopes = np.abs(sum(r * 2**k * np.pi * np.sin(2 ** (k + 1) * np.pi * places) for k, r in enumerate(ratios)))
    slopes *= stretches

    def excess(amplitudes: Floats, chords: Floats) -> Floats:
        """(2, …) arc lengths minus chords, and their derivatives by A."""
        found = np.zeros((2, len(chords)))
        # A few at once: larger arrays leave the processor's cache, and take four times as long.
        for some in (slice(k, k + _AT_ONCE) for k in range(0, len(chords), _AT_ONCE)):
            chord = chords[some, None]
            # s²/(√(c² + s²) + c) has no cancellation. (`hypot` is slower.)
            heights = amplitudes[some, None] * slopes
            arcs = np.sqrt(heights * heights + chord * chord)
            found[0, some] = np.einsum("sq,q->s", heights * (heights / (arcs + chord)), weights)
            found[1, some] = np.einsum("sq,q->s", slopes * (heights / arcs), weights)
        return found

    def amplitudes(q: Floats) -> Floats:
        chords, shortenings = (1 - q) ** 4, q * (2 - q) * (1 + (1 - q) ** 2)
        # By Jensen the curve is too long at this A; the length is convex in A, so Newton's method comes down from it.
        guesses = np.sqrt(shortenings * (1 + chords)) / np.einsum("q,q->", slopes, weights)
        for _ in range(_NEWTON_STEPS):
            lengths, derivatives = excess(guesses, chords)
            steps = (lengths - shortenings) / derivatives
            guesses = guesses - steps
            if np.max(np.abs(steps) / guesses) < _STEP_ERROR:
                break
        return np.asarray(guesses / np.sqrt(q), np.float64)

    def shortenings(q: Floats) -> Floats:
        return np.asarray(excess(q * (2 - q) * (1 + (1 - q) ** 2), (1 - q) ** 4)[0] / q**2, np.float64)

    return SmoothProfile(kind, ratios, peak, interpolate(amplitudes), interpolate(shortenings))


def _quadrature(breaks: Floats) -> tuple[Floats, Floats]:
    """Nodes and weights of the mean over τ of a function on [0, 1], or of one with period 1, symmetric about ½.

    Nodes crowd exponentially at the breaks: √(c² + (A g')²) has a rounded kink at each zero of g', of a width
    c/A that goes to 0. The trapezoid rule in y, τ = 1/(1 + e⁻ʸ) within a panel, resolves all widths equally well.

    Args:
        breaks: (panels + 1,) sorted, from 0 to 1, or to ½: zeros of g', and of g'' where g' may nearly vanish.
    """
    ys = np.arange(-_QUADRATURE_END, _QUADRATURE_END + _QUADRATURE_STEP / 2, _QUADRATURE_STEP)
    fractions = 1 / (1 + np.exp(-ys))
    widths = np.diff(breaks)
    taus = breaks[:-1, None] + widths[:, None] * fractions
    weights = _QUADRATURE_STEP / breaks[-1] * widths[:, None] * fractions * fractions[::-1]
    return taus.reshape(-1), weights.reshape(-1)
