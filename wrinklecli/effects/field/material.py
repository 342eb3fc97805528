"""The shape of a fold by the material of its field.

Folds lie on what is below, so they rise more than they sink. Those of cloth, which is thin, are rucks: between narrow
crests it lies flat. Thick leather and skin have round crests and narrow valleys.

Source: D. Vella, A. Boudaoud, M. Adda-Bedia, *Statics and Inertial Dynamics of a Ruck in a Rug*, Physical Review
Letters 103, 2009 (cloth rises from what it lies on, and is flat beside it). Differs: rucks are as many as waves.
"""

from collections.abc import Mapping

import numpy as np

from wrinklecli.choices import MaterialName
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats

# Points of a wave on which its mean height is found.
_POINTS = 360


@dataclass(frozen=True, slots=True)
class Fabric:
    """The shape of a fold.

    Attributes:
        roundness: 0 for crests, or valleys, as in a row of circles that touch; large for sine waves.
        inward: Part of the wave's height that is below the surface at rest.
        ruck: Whether valleys are round and crests narrow, in place of the reverse.
    """

    roundness: float
    inward: float
    ruck: bool = False

    def wave(self, cosines: Floats) -> Floats:
        """(…,) heights over half of a sine's, at (…,) cosines of the phase: from 2 (1 − inward) to −2 inward."""
        low, high = np.sqrt(self.roundness), np.sqrt(1.0 + self.roundness)
        risen = (np.sqrt((1.0 + (-cosines if self.ruck else cosines)) / 2.0 + self.roundness) - low) / (high - low)
        risen = 1.0 - risen if self.ruck else risen
        return np.asarray(2.0 * (risen - self.inward))

    def higher(self, one: Floats, other: Floats) -> Floats:
        """(…,) the higher of (…,) heights of two waves, with round furrows where both are as high."""
        near = np.maximum(2.0 * self.roundness - np.abs(one - other), 0.0)
        # A parabola as round as the furrow: it lowers crests less than a hyperbola, which has no end.
        return np.asarray(np.maximum(one, other) + near**2 / (8.0 * self.roundness) - self.roundness / 2.0)

    @property
    def mean(self) -> float:
        """The mean height of a wave, which is that of the surface where waves fork and end."""
        return float(self.wave(np.cos(np.linspace(0.0, 2.0 * np.pi, _POINTS, endpoint=False))).mean())


FABRICS: Mapping[MaterialName, Fabric] = {
    "cloth": Fabric(roundness=0.2, inward=0.2, ruck=True),
    "leather": Fabric(roundness=0.5, inward=0.2),
    "skin": Fabric(roundness=0.12, inward=0.3),
}
"""By material."""
