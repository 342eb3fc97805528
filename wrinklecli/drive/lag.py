"""The filter of a tool with `lag`: a damped spring follows the shortening over a clip, so that heights swing a little.

The shortening is that of the control curve, as a ratio of the rest length: d = max((1 - 1e-5) - l'/l, 0). The spring
follows x'' = ω² (d - x) - 2 ζ ω x', and the curve has the heights for ends l' = (1 - 1e-5 - x) l apart; none if x is
below 0. So an overshoot is capped like any shortening, by `max_height` and at the point where the ends would meet.

The clip begins with the spring at rest, as in a player that starts there. A clip that ends as it begins counts as a
loop, and the spring's motion is periodic. The paper has no springs: its heights follow at once.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.drive.stored import TAUT
from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.numeric.spring import Spring, SpringResponse, fit_quartics, positive, respond
from wrinklecli.tools.records import Lag

# Longest piece of the fitted shortening before refinement, seconds.
_PIECE = 0.1
# Greatest error of the fitted shortening, over the rest length: a hundredth of the least that raises a wrinkle.
_TOLERANCE = (1.0 - TAUT) / 100.0
# Greatest difference of the shortening at both ends of a loop, over the rest length.
_SAME = 1e-3


def spring_filter(lag: Lag, ratios: Signal, clip: Clip, breaks: Floats) -> Callable[[Floats, Floats, Floats], Floats]:
    """Let a spring follow the shortening of a segment in a clip, over the rest length.

    Args:
        lag: The spring's frequency and damping.
        ratios: (times,) seconds to (times, 1) distances of the anchors over rest lengths; infinite while inactive.
        clip: The clip.
        breaks: (breaks,) seconds between which ratios are smooth.

    Returns:
        `_followed` with the spring's response.
    """

    def shares(times: Floats) -> Floats:
        # Neither a hidden tool is shortened nor a stretched one, so ratios above 2 count as 2.
        return TAUT - np.minimum(ratios(times), 2.0)

    end = max(clip.end, float(np.nextafter(np.float32(clip.start), np.float32(np.inf))))
    even = np.linspace(clip.start, end, max(int(np.ceil((end - clip.start) / _PIECE)), 1) + 1)
    inside = breaks[(breaks > clip.start) & (breaks < end)]
    signal = fit_quartics(shares, distinct_values(np.concatenate([even, inside])), _TOLERANCE)
    first, last = ratios(np.array([clip.start, clip.end]))[:, 0]
    periodic = clip.loops and (first == last or abs(last - first) < _SAME)
    spring = Spring(2.0 * np.pi * lag.frequency, lag.damping)
    return partial(_followed, respond(spring, positive(signal), periodic=periodic))


def _followed(response: SpringResponse, times: Floats, distances: Floats, rest_lengths: Floats) -> Floats:
    """(frames,) distances at which a curve has the heights of the spring's response, scene units.

    Args:
        response: The spring's, over the rest length.
        times: (frames,) seconds.
        distances: (frames,) distances of the ends, scene units; infinite while the tool is inactive.
        rest_lengths: (frames,) scene units.
    """
    shares = np.minimum(response.at(times)[:, 0], TAUT)
    # While nothing is to rise, the distance of a stretched segment stays as it is.
    slack = np.maximum(distances, TAUT * rest_lengths)
    return np.where((shares > 0) & np.isfinite(distances), (TAUT - shares) * rest_lengths, slack)
