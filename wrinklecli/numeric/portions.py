"""Portions of long computations: what one takes stays in a core's cache, and bounds the memory."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from wrinklecli.numeric.arrays import Ints

# Numbers that are computed at once, 1 MB. With half or twice as many, poses and searches take up to a quarter longer:
# products of few rows are slow, and the memory of what leaves the cache is given back to the system each time.
AT_ONCE = 2**17


def portion(width: int) -> int:
    """The number of rows of `width` numbers that are computed at once, at least one."""
    return max(AT_ONCE // max(width, 1), 1)


def portions(count: int, width: int = 1) -> Iterator[slice]:
    """Slices of `count` rows of `width` numbers; none without rows."""
    rows = portion(width)
    return (slice(first, first + rows) for first in range(0, count, rows))


def portions_of(widths: Ints) -> list[slice]:
    """Slices of rows of (rows,) numbers; each exceeds what is computed at once by less than its last row."""
    ends = np.cumsum(widths)
    cuts = np.searchsorted(ends, np.arange(AT_ONCE, ends[-1:].sum(), AT_ONCE)) + 1
    return [slice(low, high) for low, high in pairwise(sorted({0, *cuts.tolist(), len(ends)}))]
