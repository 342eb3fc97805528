"""Things that lie near each other in a file, in blocks: those near a place are found without a look at each."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, runs
from wrinklecli.numeric.nearest import closest_point

# Things in a block: files have neighbours one after another. Boxes of larger ones hold more that is far off.
_SIZE = 64
# Things from which on blocks save time.
_MANY = 2**12
# A distance grows by this share of itself and of the greatest coordinate: rounding errors are far smaller.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes round each 64 things that follow one another; one round all where these are few.

    Attributes:
        count: Of the things.
        size: Of them in a box.
        low: (boxes, 3) least coordinates of each box,
        high: and greatest.
    """

    count: int
    size: int
    low: Floats
    high: Floats

    @classmethod
    def of(cls, low: Floats, high: Floats) -> "Boxes":
        """Box (things, 3) least and greatest coordinates."""
        size = _SIZE if len(low) >= _MANY else max(len(low), 1)
        starts = np.arange(0, len(low), size)
        return cls(len(low), size, np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts))

    @property
    def greatest(self) -> float:
        """The greatest coordinate, of either sign."""
        return float(max(np.abs(self.low).max(initial=0.0), np.abs(self.high).max(initial=0.0)))

    def reaching(self, origin: Floats, directions: Floats, low: Floats, high: Floats) -> Ints:
        """The things, rising, in boxes that reach between bounds along some directions, and perhaps a few more.

        Args:
            origin: (3,) from where is measured.
            directions: (directions, 3) in whose lengths is measured.
            low: (directions,) least bounds,
            high: and greatest.
        """
        lengths = np.abs(directions).sum(axis=1)
        slack = _ROUNDING * lengths * (self.greatest + np.abs(origin).max())
        middles = ((self.low + self.high) / 2.0 - origin) @ directions.T
        reaches = (self.high - self.low) / 2.0 @ np.abs(directions).T + slack
        return self.things((middles + reaches >= low).all(axis=1) & (middles - reaches <= high).all(axis=1))

    def things(self, chosen: Bools) -> Ints:
        """The things, rising, in (boxes,) chosen boxes."""
        firsts = np.flatnonzero(chosen) * self.size
        return runs(firsts, np.minimum(self.size, self.count - firsts))


@dataclass(frozen=True, slots=True)
class Blocks:
    """A triangle mesh, and the boxes round triangles that follow one another.

    Attributes:
        positions: (vertices, 3).
        triangles: (triangles, 3).
        boxes: Of the triangles.
    """

    positions: Floats
    triangles: Ints
    boxes: Boxes

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Blocks":
        """Find the boxes."""
        corners = positions[triangles]
        return cls(positions, triangles, Boxes.of(corners.min(axis=1), corners.max(axis=1)))

    def closest_point(self, point: Floats) -> tuple[int, Floats, Floats]:
        """As `nearest.closest_point`, of a (3,) point."""
        boxes = self.boxes
        if len(boxes.low) == 1:
            return closest_point(self.positions, self.triangles, point)
        apart = np.maximum(np.maximum(boxes.low - point, point - boxes.high), 0.0)
        distances = np.sqrt(np.sum(apart * apart, axis=1))
        # Nothing is further than the nearest corner of any box.
        nearest = np.arange(len(distances)) == np.argmin(distances)
        corners = self.positions[self.triangles[boxes.things(nearest)]].reshape(-1, 3)
        reach = np.sqrt(np.sum((corners - point) ** 2, axis=1).min())
        reach += _ROUNDING * (reach + boxes.greatest)
        faces = boxes.things(distances <= reach)
        used = distinct_values(self.triangles[faces])
        local = np.searchsorted(used, self.triangles[faces])
        triangle, barycentrics, place = closest_point(self.positions[used], local, point)
        return int(faces[triangle]), barycentrics, place
