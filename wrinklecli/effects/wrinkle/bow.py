"""Crests bent like an arc: a shift of the place along a patch that grows with the square of that across it.

Not in the paper, whose wrinkles are straight.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats


def bowed(u: Floats, v: Floats, bow: float, bumps: int) -> Floats:
    """(…,) where places of a patch are on the control curve: u - bow v² / 2B, over the first and the last bump less.

    It rises strictly with u, and keeps both borders: no bump is cut off there.

    Args:
        u: (…,) along the patch; what is not between 0 and 1 stays.
        v: (…,) across it.
        bow: From -1 to 1, at which the ends of crests lie half a bump further towards the target.
        bumps: B.
    """
    over = min(1.0 / bumps, 0.5)
    t = np.clip(np.minimum(u, 1.0 - u) / over, 0.0, 1.0)
    # A smoothstep over a bump is steepest at 1.5 B: ũ rises by a quarter of u's rise at least, also with one bump.
    share = min(1.0, 0.5 * bumps) * t * t * (3.0 - 2.0 * t)
    shifted: Floats = u - bow * np.minimum(v * v, 1.0) / (2.0 * bumps) * share
    return shifted
