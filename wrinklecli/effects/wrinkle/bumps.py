"""Lays out a tool's bumps along its segment, and groups those that always rise together.

Source: C. Larboulette, M.-P. Cani, "Real-Time Dynamic Wrinkles", Computer Graphics International 2004, the
section on the control curve: a bump has two control intervals. Differs: bumps may be unequal, and have flat intervals
between them.
"""

from functools import cached_property

import numpy as np

from wrinklecli.choices import Strategy
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class Bumps:
    """A tool's bumps, side by side along its segment.

    Attributes:
        widths: (bumps,) widths over their mean.
        gap: Flat intervals between neighbours.
    """

    widths: Floats
    gap: int

    @property
    def count(self) -> int:
        """Number of bumps."""
        return len(self.widths)

    @property
    def interval_count(self) -> int:
        """The number n of control intervals."""
        return count_intervals(self.count, self.gap)

    @cached_property
    def starts(self) -> Floats:
        """(bumps,) u at which each bump starts; it spans 2/n times its width."""
        return (2.0 * self._before[:-1] + self._flat) / self.interval_count

    @cached_property
    def ends(self) -> Floats:
        """(bumps,) u at which each bump ends."""
        return (2.0 * self._before[1:] + self._flat) / self.interval_count

    def locate(self, us: Floats) -> tuple[Ints, Floats]:
        """(…,) index of the last bump that starts before each of (…,) us, and (…,) τ: 0 to 1 on that bump."""
        bumps = np.searchsorted(self.starts[1:], us, side="right")
        return bumps, (us - self.starts[bumps]) * (self.interval_count / 2) / self.widths[bumps]

    @cached_property
    def _before(self) -> Floats:
        """(bumps + 1,) sum of the widths before each bump, and of all."""
        before = np.append(0.0, np.cumsum(self.widths))
        before[-1] = self.count  # the last bump ends where the segment does
        return before

    @property
    def _flat(self) -> Ints:
        """(bumps,) number of flat intervals before each bump."""
        return np.arange(self.count) * self.gap


def count_intervals(bumps: int, gap: int) -> int:
    """The number n of control intervals: two for each bump, and `gap` flat ones between neighbours."""
    return 2 * bumps + gap * (bumps - 1)


def group_bumps(bumps: int, strategy: Strategy) -> tuple[tuple[int, ...], ...]:
    """Groups of bumps that always rise together, in the order in which they rise."""
    if strategy == "everywhere":
        return (tuple(range(bumps)),)
    if strategy == "origin":
        return tuple((bump,) for bump in range(bumps))
    pairs = tuple((bump, bumps - 1 - bump) for bump in range(bumps // 2))
    return pairs if bumps % 2 == 0 else (*pairs, (bumps // 2,))
