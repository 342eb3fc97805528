"""Points in the cells of a grid: those near a place are found without a look at each."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, components, distinct, dot, runs

# Mean number of points in a grid cell, if the points lie on one layer of cells, as those of a surface roughly do.
_CELL_POINTS = 16
# Greatest number of cells along an axis: their numbers stay far below 2**63.
_MOST_CELLS = 2**10
# Balls that are looked at together: files store neighbours one after another.
_BALLS = 2**8
# Bits of a step along an axis in the number of a cell, with steps to spare, and of the steps in a coarse cell.
_STEP_BITS, _COARSE_BITS = 21, 8
# Half of the cells round a cell, as steps along the axes: the other half has it among its own.
_HALF = [step for step in product((-1, 0, 1), repeat=3) if step > (0, 0, 0)]


@dataclass(frozen=True, slots=True)
class Cells:
    """Points sorted into the cells of a grid.

    Attributes:
        numbers: (points,) indices of the points, one cell after another.
        starts: (cells,) where each cell starts in `numbers`; no cell is empty.
        counts: (cells,) points of each cell.
        low: (cells, 3) least coordinates of each cell's points.
        high: (cells, 3) greatest coordinates of each cell's points.
    """

    numbers: Ints
    starts: Ints
    counts: Ints
    low: Floats
    high: Floats

    @classmethod
    def of(cls, points: Floats) -> "Cells":
        """Sort (points, 3), at least one."""
        along = min(int(np.ceil(np.sqrt(len(points) / _CELL_POINTS))), _MOST_CELLS)
        low = points.min(axis=0)
        extent = float((points.max(axis=0) - low).max()) or 1.0
        places = np.minimum((points - low) / extent * along, along - 1).astype(np.intp)
        keys = (places[:, 0] * along + places[:, 1]) * along + places[:, 2]
        order = np.argsort(keys, kind="stable")
        sorted_points, keys = points[order], keys[order]
        starts = np.append(0, 1 + np.flatnonzero(np.diff(keys)))
        counts = np.diff(np.append(starts, len(keys)))
        least, greatest = (each.reduceat(sorted_points, starts) for each in (np.minimum, np.maximum))
        return cls(order, starts, counts, least, greatest)

    def meeting(self, middles: Floats, radii: Floats) -> tuple[Ints, Ints]:
        """(pairs,) sorted balls of (balls, 3) middles and (balls,) radii, and (pairs,) cells whose boxes they reach."""
        found = [(np.zeros(0, np.intp), np.zeros(0, np.intp))]
        for first in range(0, len(middles), _BALLS):
            middle, radius = middles[first : first + _BALLS, None], radii[first : first + _BALLS, None]
            # Consecutive balls are neighbours, so that the box round them excludes most cells.
            low, high = (middle - radius[:, :, None]).min(axis=(0, 1)), (middle + radius[:, :, None]).max(axis=(0, 1))
            near = np.flatnonzero(((self.low <= high) & (self.high >= low)).all(axis=1))
            # Axis by axis, as numpy takes several times as long along an axis of three.
            axes = zip(self.low[near].T, self.high[near].T, np.moveaxis(middle, 2, 0), strict=True)
            apart = [np.maximum(np.maximum(least - at, at - most), 0.0) for least, most, at in axes]
            balls, cells = np.nonzero(dot(apart, apart) <= radius**2)
            found.append((first + balls, near[cells]))
        balls, cells = (np.concatenate(each) for each in zip(*found, strict=True))
        return balls, cells

    def numbers_in(self, cells: Ints) -> Ints:
        """Indices of the points in cells, one cell after another."""
        return self.numbers[runs(self.starts[cells], self.counts[cells])]


def leaders(points: Floats, reach: float) -> Ints:
    """(points,) the first point of each one's group of (points, 3), which extend over at most a million reaches.

    Points within a reach along each axis are in one group, and so are points that a chain of others connects. Where
    several points share a cell as wide as a reach, two of them may be up to twice as far apart.
    """
    firsts = np.arange(len(points))
    if not reach > 0 or len(points) < 2:
        chosen, which = distinct(points)
        return chosen[which]
    steps = [np.floor((axis - axis.min()) / reach).astype(np.int64) + 1 for axis in points.T]
    doubtful = np.flatnonzero(_near_another(steps))
    numbers = _numbers([axis[doubtful] for axis in steps])
    order = np.argsort(numbers, kind="stable")
    numbers, sorted_points = numbers[order], points[doubtful[order]]
    starts = np.flatnonzero(np.diff(numbers, prepend=-1))
    cells = numbers[starts]
    least, greatest = (each.reduceat(sorted_points, starts) for each in (np.minimum, np.maximum))
    links = [np.zeros((0, 2), np.intp)]
    for step in _HALF:
        beside = cells + _numbers(step)
        at = np.minimum(np.searchsorted(cells, beside), len(cells) - 1)
        one = np.flatnonzero(cells[at] == beside)
        other, across = at[one], np.array(step)
        gaps = np.where(across > 0, least[other] - greatest[one], least[one] - greatest[other])
        near = (gaps <= reach)[:, across != 0].all(axis=1)
        links.append(np.stack([one[near], other[near]], axis=1))
    groups = components(np.concatenate(links), len(cells))[np.cumsum(np.diff(numbers, prepend=-1) != 0) - 1]
    lowest = np.full(len(cells), len(points))
    np.minimum.at(lowest, groups, doubtful[order])
    firsts[doubtful[order]] = lowest[groups]
    return firsts


def _near_another(steps: Sequence[Ints]) -> Bools:
    """(points,) False for those alone in a coarse cell, and not at its border; `steps` are (points,) by axis."""
    numbers = _numbers([axis >> _COARSE_BITS for axis in steps])
    ordered = np.sort(numbers)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    found: Bools = np.append(repeated, -1)[np.searchsorted(repeated, numbers)] == numbers
    last = 2**_COARSE_BITS - 1
    for axis in steps:
        within = axis & last
        found |= (within == 0) | (within == last)
    return found


def _numbers(steps: Sequence[Any]) -> Any:
    """A number for each cell, by its steps along three axes; numbers of sums are sums of numbers."""
    x, y, z = steps
    return (x * 4**_STEP_BITS) + (y * 2**_STEP_BITS) + z
