"""Points in the cells of a grid: those near a place are found without a look at each."""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, runs

# Mean number of points in a grid cell, if the points lie on one layer of cells, as those of a surface roughly do.
_CELL_POINTS = 16
# Greatest number of cells along an axis: their numbers stay far below 2**63.
_MOST_CELLS = 2**10
# Balls that are looked at together: files store neighbours one after another.
_BALLS = 2**8


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
            apart = np.maximum(np.maximum(self.low[near] - middle, middle - self.high[near]), 0.0)
            balls, cells = np.nonzero(np.einsum("bcx,bcx->bc", apart, apart) <= radius**2)
            found.append((first + balls, near[cells]))
        balls, cells = (np.concatenate(each) for each in zip(*found, strict=True))
        return balls, cells

    def numbers_in(self, cells: Ints) -> Ints:
        """Indices of the points in cells, one cell after another."""
        return self.numbers[runs(self.starts[cells], self.counts[cells])]
