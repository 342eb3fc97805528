"""The filter of a tool with `lag`: a damped spring follows the shortening over a clip, so that heights swing a little.

The shortening is that of the control curve, as a share of the rest length: d = max((1 - 1e-5) - l'/l, 0). The spring
answers x'' = ω² (d - x) - 2 ζ ω x', and the curve is asked as if its ends were l' = (1 - 1e-5 - x) l apart; where x is
below 0 nothing rises. So an overshoot is capped like any shortening, by `max_height` and where the ends would meet.

The clip begins with the spring at rest, as in a player that starts there. A clip that ends as it begins counts as a
loop, and the spring goes round with it. Not in the paper, whose heights follow at once.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.numeric.quartics import fit_quartics
from wrinklecli.numeric.spring import Spring, SpringResponse, positive, respond
from wrinklecli.tools.records import Lag

TAUT = 1 - 1e-5
"""Part of the rest length below which wrinkles start: rounding noise of 1e-7 alone would raise 6e-5 l."""

# Seconds that a piece of the shortening lasts at most, to begin with.
_PIECE = 0.1
# How exactly pieces give the shortening, a share of the rest length: a hundredth of what counts as one.
_TOLERANCE = (1.0 - TAUT) / 100.0
# Difference of the shortening at both ends of a clip, a share of the rest length, up to which it may be a loop.
_SAME = 1e-3


@dataclass(frozen=True, slots=True)
class SpringFilter:
    """The answer of a spring to a segment's shortening in one clip.

    Attributes:
        response: The spring's, a share of the rest length.
    """

    response: SpringResponse

    def follow(self, times: Floats, distances: Floats, rest_lengths: Floats) -> Floats:
        """(frames,) distances at which a curve has the heights that the spring asks for, scene units.

        Args:
            times: (frames,) seconds.
            distances: (frames,) of the segment, scene units; infinite where the tool is inactive.
            rest_lengths: (frames,) scene units.
        """
        shares = np.minimum(self.response.at(times), TAUT)
        # Where nothing is to rise, a stretched segment may say so.
        slack = np.maximum(distances, TAUT * rest_lengths)
        return np.where((shares > 0) & np.isfinite(distances), (TAUT - shares) * rest_lengths, slack)


def spring_filter(lag: Lag, ratios: Signal, clip: Clip, breaks: Floats) -> SpringFilter:
    """Let a spring follow a clip.

    Args:
        lag: Its frequency and damping.
        ratios: (times,) seconds to (times, 1) distances of the anchors over rest lengths; infinite where inactive.
        clip: The animation.
        breaks: (breaks,) seconds between which ratios are smooth.
    """

    def shares(times: Floats) -> Floats:
        # A tool that is hidden is not shortened; and no segment is a rest length longer than at rest, for the spring.
        return TAUT - np.minimum(ratios(times), 2.0)

    end = max(clip.end, float(np.nextafter(np.float32(clip.start), np.float32(np.inf))))
    even = np.linspace(clip.start, end, max(int(np.ceil((end - clip.start) / _PIECE)), 1) + 1)
    inside = breaks[(breaks > clip.start) & (breaks < end)]
    signal = fit_quartics(shares, distinct_values(np.concatenate([even, inside])), _TOLERANCE)
    assert signal is not None, "shares are finite"
    first, last = ratios(np.array([clip.start, clip.end]))[:, 0]
    periodic = clip.loops and (first == last or abs(last - first) < _SAME)
    spring = Spring(2.0 * np.pi * lag.frequency, lag.damping)
    return SpringFilter(respond(spring, positive(signal), periodic=periodic))
