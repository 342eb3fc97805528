"""The skin above a belly in which edges must be split, so that the bulge is as round as the muscle on a coarse limb.

The bulge curves along the muscle and round the limb: the skin is a region twice, once for each.
"""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from wrinklecli.effects.muscle.shapes import Belly, bell, spindle
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.path import Straight
from wrinklecli.surface.region import SmoothRegion
from wrinklecli.surface.rest import Rest

# Equal intervals along the belly, and round it, with two edges each by default: straight edges then miss the bulge by
# (1/8)² / 8 · 2π², which is 4 % of its height, and a limb gets about 20 edges round.
_INTERVALS = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Bulge(SmoothRegion):
    """The skin above a belly, with u along the muscle or round the limb.

    Attributes:
        belly: The muscle.
        height: Greatest displacement, scene units.
        members: (members,) sorted coarse triangles.
        pose: The surface at rest.
        turned: True if u runs round the limb.
    """

    belly: Belly
    height: float
    members: Ints
    pose: Rest
    turned: bool = False

    intervals: ClassVar[float] = _INTERVALS

    @property
    def span(self) -> float:
        """The belly's length, or the width over which the skin follows."""
        return self._width if self.turned else self._length

    @property
    def half_width(self) -> float:
        """Half the belly's length, or half the width over which the skin follows."""
        return (self._length if self.turned else self._width) / 2.0

    @property
    def path(self) -> Straight:
        """The line above the muscle, or across it, that touches the skin in the middle."""
        belly = self.belly
        along = np.cross(belly.axis, belly.side) if self.turned else unit(belly.insertion - belly.origin)
        middle, normal = belly.foot + belly.depth * belly.side, unit(belly.side - (belly.side @ along) * along)
        return Straight(middle - 0.5 * self.span * along, along, normal, self.span)

    @property
    def _length(self) -> float:
        return self.belly.span - self.belly.tendons

    @property
    def _width(self) -> float:
        return 2.0 * self.belly.widest * self.belly.depth

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u from 0 to 1 and v from -1 to 1 of (…, 3) world positions at rest."""
        belly = self.belly
        along = (belly.along(positions) - belly.tendons / 2.0) / (belly.span - belly.tendons)
        relative = positions - belly.foot
        aside = np.arctan2(relative @ np.cross(belly.axis, belly.side), relative @ belly.side) / belly.widest
        return ((aside + 1.0) / 2.0, 2.0 * along - 1.0) if self.turned else (along, aside)

    def cosines(self, u: Floats, _normals: Floats) -> Floats:
        """(…,) ones: the other side of the limb is farther round than the skin follows."""
        return np.ones(np.shape(u))

    def share(self, u: Floats, v: Floats, _cosines: Floats) -> Floats:
        """(…,) fractions of the displacement along the muscle and round the limb."""
        along, aside = ((v + 1.0) / 2.0, 2.0 * u - 1.0) if self.turned else (u, v)
        return np.abs(spindle(along, 0.0, 1.0) * bell(aside))


def bulges_on(ground: Ground, belly: Belly, heights: Floats) -> tuple[Bulge, Bulge]:
    """The skin above a belly, whose vertices move by (vertices,) heights at most, once along it and once round it."""
    members = ground.rest.around.faces_of(np.flatnonzero(heights))
    bulge = Bulge(belly, float(np.abs(heights).max()), members, ground.rest)
    return bulge, replace(bulge, turned=True)
