"""Places: where points of a patch lie on its control curve, and how much of the curve's height they get.

The height of a point is its factor times (1 − s) c(us) + s c(joined_us), where c is the control curve and s > 0 only
where two bumps merge. Bent crests, wandering furrows and merging bumps are thus in the fixed places of the points, and
heights stay linear in the curve's amplitudes.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, smoothstep

# Two merging bumps count as one where the joined bump has more than this fraction of the height.
_ONE = 0.7


@dataclass(frozen=True, slots=True)
class Places:
    """The places of (…,) points on a control curve.

    Attributes:
        us: (…,) coordinate on the curve; equal to the patch's u for straight, regular wrinkles.
        factors: (…,) factors on the curve's height.
        joined: (…,) s, the fraction of the height that the joined bump has; None if no bumps merge.
        joined_us: (…,) coordinate on the joined bump's curve.
    """

    us: Floats
    factors: Floats
    joined: Floats | None = None
    joined_us: Floats | None = None

    def times(self, factors: Floats | Bools) -> "Places":
        """Multiply the factors by (…,) others."""
        return replace(self, factors=self.factors * factors)

    def of(self, chosen: Bools | Ints) -> "Places":
        """Select some of (points,)."""
        parts = (None if each is None else each[chosen] for each in (self.joined, self.joined_us))
        return Places(self.us[chosen], self.factors[chosen], *parts)

    def phases(self, curve: ControlCurve) -> Floats:
        """(triangles, 3) `ControlCurve.phases` of the corners, on the joined bump where two bumps count as one.

        NaN for triangles within which two bumps become one.
        """
        phases = curve.phases(self.us)
        if self.joined is None or self.joined_us is None:
            return phases
        one = self.joined > _ONE
        phases = np.where(one, curve.phases(self.joined_us), phases)
        return np.where(np.ptp(one.astype(np.intp), axis=1, keepdims=True) > 0, np.nan, phases)

    def shapes(self, curve: ControlCurve) -> Floats:
        """(groups, modes, points) heights of (points,) per unit of amplitude, without the factors."""
        found = curve.shapes(self.us)
        if self.joined is not None and self.joined_us is not None:
            on = np.flatnonzero(self.joined)
            share = self.joined[on]
            found[..., on] = (1.0 - share) * found[..., on] + share * curve.shapes(self.joined_us[on])
        return found

    def heights(self, curve: ControlCurve, amplitudes: Floats) -> Floats:
        """(points, frames) heights of (points, frames) places under (frames, groups, modes) amplitudes, scene units.

        Where all frames share their places, `shapes` is cheaper.
        """
        heights = curve.heights_at(self.us, amplitudes)
        if self.joined is not None and self.joined_us is not None and self.joined.any():
            heights = (1.0 - self.joined) * heights + self.joined * curve.heights_at(self.joined_us, amplitudes)
        return self.factors * heights


def bowed(u: Floats, v: Floats, bow: float, bumps: int) -> Floats:
    """(…,) places on the control curve if crests bend like an arc: u - bow v² / 2B, less over the first and last bump.

    Places rise strictly with u and keep both borders, so that no bump is cut off. Not in the paper, whose wrinkles are
    straight. Places outside the patch, whose (…,) u is not between 0 and 1, stay. At a bow of 1 the ends of crests lie
    half a bump further towards the target. B is the number of bumps.
    """
    fade = min(1.0 / bumps, 0.5)
    t = np.clip(np.minimum(u, 1.0 - u) / fade, 0.0, 1.0)
    # A smoothstep over a bump has a slope of 1.5 B at most: places rise at least a quarter as fast as u, also if B = 1.
    share = smoothstep(t, min(1.0, 0.5 * bumps))
    return u - bow * np.minimum(v * v, 1.0) / (2.0 * bumps) * share
