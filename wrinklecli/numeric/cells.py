"""Points in the cells of a grid, to find those in many balls without a look at all."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, runs

# Points of a cell, were they spread evenly over as many cells of one layer: those of a surface are about so.
_POINTS = 16
# Cells along an axis at most: their numbers stay far below 2**63.
_MOST_CELLS = 2**10
# Balls that are looked at together: files have neighbours one after another.
_BALLS = 2**8


@dataclass(frozen=True, slots=True)
class Cells:
    """Points, by cells.

    Attributes:
        numbers: (points,) of the points as given, one cell after another.
        starts: (cells,) where those of each cell start; no cell is empty.
        counts: (cells,) how many it has.
        low: (cells, 3) least coordinates in it,
        high: and greatest.
    """

    numbers: Ints
    starts: Ints
    counts: Ints
    low: Floats
    high: Floats

    @classmethod
    def of(cls, points: Floats) -> "Cells":
        """Sort (points, 3), at least one."""
        along = min(int(np.ceil(np.sqrt(len(points) / _POINTS))), _MOST_CELLS)
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
        """(pairs,) balls, rising, of (balls, 3) middles and (balls,) radii, and the cells whose boxes they reach."""
        found = [(np.zeros(0, np.intp), np.zeros(0, np.intp))]
        for first in range(0, len(middles), _BALLS):
            middle, radius = middles[first : first + _BALLS, None], radii[first : first + _BALLS, None]
            # Balls that follow one another are neighbours: the box round them leaves most cells out.
            low, high = (middle - radius[:, :, None]).min(axis=(0, 1)), (middle + radius[:, :, None]).max(axis=(0, 1))
            near = np.flatnonzero(((self.low <= high) & (self.high >= low)).all(axis=1))
            apart = np.maximum(np.maximum(self.low[near] - middle, middle - self.high[near]), 0.0)
            balls, cells = np.nonzero(np.einsum("bcx,bcx->bc", apart, apart) <= radius**2)
            found.append((first + balls, near[cells]))
        balls, cells = (np.concatenate(each) for each in zip(*found, strict=True))
        return balls, cells

    def numbers_in(self, cells: Ints) -> Ints:
        """The numbers of the points in cells, one cell after another."""
        return self.numbers[runs(self.starts[cells], self.counts[cells])]
