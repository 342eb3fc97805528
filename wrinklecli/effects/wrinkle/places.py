"""Where points of a patch are on its control curve, and what they have of its height: twice where two bumps become one.

With a curve c of heights, a point's is its factor times (1 − s) c(us) + s c(joined_us). So furrows that wander and
bumps that merge are in the fixed places of points, and a curve's height is as linear in its amplitudes as it was.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.numeric.arrays import Bools, Floats, Ints

# Share of the height from which a bump that two have become is one.
_ONE = 0.7


@dataclass(frozen=True, slots=True)
class Places:
    """Of (…,) points.

    Attributes:
        us: (…,) where each is on the curve: along the patch, where wrinkles are straight and ruled.
        factors: (…,) on the curve's height.
        joined: (…,) s, what a bump that two have become has of that; None where no two do.
        joined_us: (…,) where each is on that one's curve.
    """

    us: Floats
    factors: Floats
    joined: Floats | None = None
    joined_us: Floats | None = None

    def times(self, factors: Floats | Bools) -> "Places":
        """With (…,) further factors."""
        return replace(self, factors=self.factors * factors)

    def of(self, chosen: Bools | Ints) -> "Places":
        """Some of (points,)."""
        parts = (None if each is None else each[chosen] for each in (self.joined, self.joined_us))
        return Places(self.us[chosen], self.factors[chosen], *parts)

    def phases(self, curve: ControlCurve) -> Floats:
        """(triangles, 3) where corners are among a curve's bumps, as it has them; on two that have become one, of that.

        NaN where they become it, within a triangle.
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

    def rises(self, curve: ControlCurve, amplitudes: Floats) -> Floats:
        """Heights where every frame has points of its own; `shapes` where they share them.

        Args:
            curve: The control curve.
            amplitudes: (frames, groups, modes), scene units.

        Returns:
            (points, frames) as the places are, scene units.
        """
        heights = curve.rises(self.us, amplitudes)
        if self.joined is not None and self.joined_us is not None and self.joined.any():
            heights = (1.0 - self.joined) * heights + self.joined * curve.rises(self.joined_us, amplitudes)
        return self.factors * heights
