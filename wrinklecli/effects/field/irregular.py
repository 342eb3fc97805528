"""Irregular fields: smooth random numbers in space, by which crests differ from their neighbours, and bend.

Equal ribs read as a machine's. In cloth few wide and high folds stand among narrow and low ones, so one number gives
width and height of a crest. The number differs less along the crest, where another width forks it and another height
ends it. Neighbouring crests bend alike. All amounts are those of a variation of 1. The shapes are fixed, so
irregularity costs nothing in a player.
"""

import numpy as np

from wrinklecli.effects.field.compression import shortest
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.drawn import drawn

# Waves in space, and their lengths in wavelengths of a field, evenly between these two: a crest has to differ from its
# neighbours, not one end of a garment from the other.
_WAVES, _SHORTEST, _LONGEST = 40, 1.6, 4.0
# Stands for 0 where numbers divide.
_TINY = 1e-9
# Logarithm by which wavelengths differ, radians by which crests turn, and by how much heights differ.
_LENGTHS, _TURNS, _HEIGHTS = 1.5, 2.0, 10.0


@dataclass(frozen=True, slots=True)
class Irregular:
    """The differences between the crests of a field.

    Attributes:
        wavelength: Typical, scene units.
        variation: From 0 to 1.
        seed: What the numbers are drawn from.
    """

    wavelength: float
    variation: float
    seed: str

    def crests(self, positions: Floats, normals: Floats, directions: Floats) -> tuple[Floats, Floats, Floats]:
        """Draw the crests at (vertices, 3) places at rest with unit normals, and (vertices, 6) tensors of strain.

        Returns:
            (vertices, 3) unit lines across the crests, without signs; and (vertices,) factors of the wavelength and of
            the height.
        """
        _, lines, _ = shortest(directions, normals)
        return self.turned(lines, normals, positions), *self.varied(positions, lines)

    def varied(self, positions: Floats, lines: Floats) -> tuple[Floats, Floats]:
        """(vertices,) factors of the wavelength and of the height at (vertices, 3) places at rest, crest by crest.

        Wide crests are the high ones. The mean square of the heights is 1, so the surface keeps its length.
        (vertices, 3) `lines` are unit directions across the crests, without signs.
        """
        drawn_here = self.variation * self._smooth(positions, lines, "crests")
        return np.exp(_LENGTHS * drawn_here), np.sqrt(1.0 + np.tanh(_HEIGHTS * drawn_here))

    def turned(self, lines: Floats, normals: Floats, positions: Floats) -> Floats:
        """(vertices, 3) unit lines, turned in the planes of (vertices, 3) normals."""
        crests = np.cross(normals, lines)
        angles = _TURNS * self.variation * self._smooth(positions, crests, "turns")
        return np.asarray(np.cos(angles)[:, None] * lines + np.sin(angles)[:, None] * crests)

    def _smooth(self, positions: Floats, along: Floats, what: str) -> Floats:
        """(vertices,) smooth random numbers, about from -2 to 2, the same for one place however fine a mesh is.

        They differ most in the direction of (vertices, 3) unit vectors without signs.
        """
        what = f"{what} {self.seed}"
        ways = drawn(what, "ways", _WAVES, 3)
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        lengths = self.wavelength * np.linspace(_SHORTEST, _LONGEST, _WAVES)
        phases = np.pi * drawn(what, "phases", _WAVES)
        # A place without a direction has numbers too. With a higher power of the cosine, crests stay alike from end to
        # end, and those of one patch are bars of one length.
        parts = (along @ ways.T) ** 2 + _TINY
        waves = parts * np.cos(2.0 * np.pi * (positions @ (ways / lengths[:, None]).T) + phases)
        return np.asarray(np.sqrt(2.0) * waves.sum(axis=1) / np.linalg.norm(parts, axis=1))
