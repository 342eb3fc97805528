"""Numbers drawn from a seed, the same on every machine."""

import hashlib
import math

import numpy as np

from wrinklecli.numeric.arrays import Floats


def drawn(seed: str, what: str, *shape: int) -> Floats:
    """Numbers of a shape from −1 to below 1, evenly distributed, the same for a seed and a name on every machine."""
    digest = hashlib.shake_128(f"{what} {seed}".encode()).digest(8 * math.prod(shape))
    bits = np.frombuffer(digest, "<u8") >> np.uint64(11)  # 53 bits, which a float holds exactly
    return bits.reshape(shape).astype(np.float64) * 2.0**-52 - 1.0
