"""Triangles in blocks of neighbours, to find the nearest of many without a look at each."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.nearest import closest_point

# Triangles of a block: files have neighbours one after another. Boxes of larger ones hold more that is far off.
_SIZE = 64
# Triangles from which on blocks save time.
_MANY = 2**12
# A distance grows by this share of itself and of the greatest coordinate: rounding errors are far smaller.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Blocks:
    """A triangle mesh, and the boxes round each 64 triangles that follow one another.

    Attributes:
        positions: (vertices, 3).
        triangles: (triangles, 3).
        low: (blocks, 3) least coordinates of each block,
        high: and greatest; none where there are few triangles.
    """

    positions: Floats
    triangles: Ints
    low: Floats
    high: Floats

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Blocks":
        """Find the boxes."""
        if len(triangles) < _MANY:
            return cls(positions, triangles, *np.zeros((2, 0, 3)))
        starts = np.arange(0, len(triangles), _SIZE)
        corners = positions[triangles]
        low, high = corners.min(axis=1), corners.max(axis=1)
        return cls(positions, triangles, np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts))

    def closest_point(self, point: Floats) -> tuple[int, Floats, Floats]:
        """As `nearest.closest_point`, of a (3,) point."""
        if not len(self.low):
            return closest_point(self.positions, self.triangles, point)
        apart = np.maximum(np.maximum(self.low - point, point - self.high), 0.0)
        distances = np.sqrt(np.sum(apart * apart, axis=1))
        # Nothing is further than the nearest corner of any block.
        corners = self.positions[self.triangles[self._faces(np.array([np.argmin(distances)]))]].reshape(-1, 3)
        reach = np.sqrt(np.sum((corners - point) ** 2, axis=1).min())
        reach += _ROUNDING * (reach + max(np.abs(self.low).max(), np.abs(self.high).max()))
        faces = self._faces(np.flatnonzero(distances <= reach))
        used = distinct_values(self.triangles[faces])
        local = np.searchsorted(used, self.triangles[faces])
        triangle, barycentrics, place = closest_point(self.positions[used], local, point)
        return int(faces[triangle]), barycentrics, place

    def _faces(self, blocks: Ints) -> Ints:
        """The triangles of (blocks,) rising blocks."""
        faces = (blocks[:, None] * _SIZE + np.arange(_SIZE)).ravel()
        return faces[faces < len(self.triangles)]
