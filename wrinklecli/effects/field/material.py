"""The shape of a fold by the material of its field.

The folds of cloth have round crests and narrower valleys, and lie on what is below: they rise more than they sink.
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
        roundness: 0 for crests as in a row of circles that touch; large for sine waves.
        inward: Part of the wave's height that is below the surface at rest.
    """

    roundness: float
    inward: float

    def wave(self, cosines: Floats) -> Floats:
        """(…,) heights over half of a sine's, at (…,) cosines of the phase: from 2 (1 − inward) to −2 inward."""
        low, high = np.sqrt(self.roundness), np.sqrt(1.0 + self.roundness)
        risen = (np.sqrt((1.0 + cosines) / 2.0 + self.roundness) - low) / (high - low)
        return np.asarray(2.0 * (risen - self.inward))

    def higher(self, one: Floats, other: Floats) -> Floats:
        """(…,) the higher of (…,) heights of two waves, with round furrows where both are as high."""
        half = (one - other) / 2.0
        return np.asarray((one + other) / 2.0 + np.sqrt(half**2 + self.roundness**2) - self.roundness)

    @property
    def mean(self) -> float:
        """The mean height of a wave, which is that of the surface where waves fork and end."""
        return float(self.wave(np.cos(np.linspace(0.0, 2.0 * np.pi, _POINTS, endpoint=False))).mean())


FABRICS: Mapping[MaterialName, Fabric] = {
    "cloth": Fabric(roundness=0.2, inward=0.2),
    "leather": Fabric(roundness=0.5, inward=0.2),
    "skin": Fabric(roundness=0.12, inward=0.3),
}
"""By material."""
