"""Two families of crests, and smooth random numbers in space by which crests differ from their neighbours.

Equal ribs read as a machine's. In cloth few wide and high folds stand among narrow and low ones, so one number gives
width and height of a crest. The number differs less along the crest, where another width forks it and another height
ends it. Of two families that cross, one is higher here and the other there. All amounts are those of a variation of 1.
The shapes are fixed, so irregularity costs nothing in a player.
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
# Logarithm by which wavelengths differ, and by how much heights differ.
_LENGTHS, _HEIGHTS = 1.5, 10.0


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

    def crests(
        self, positions: Floats, normals: Floats, directions: Floats, slants: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Draw the crests at (vertices, 3) places at rest with unit normals, by `Heights.directions` and `slants`.

        Returns:
            (2, vertices, 3) unit lines across two families of crests, without signs; (2, vertices) factors of their
            wavelength and of their height; and (vertices,) how much lines agree, from 0, where they turn at once, to 1.
        """
        least, lines, across = shortest(directions, normals)
        agreed = np.clip((across - least) / np.maximum(-across - least, _TINY), 0.0, 1.0)
        level, aslant = np.sqrt(1.0 - slants**2)[:, None] * lines, slants[:, None] * np.cross(normals, lines)
        both = np.stack([level + aslant, level - aslant])
        return both, *self.varied(positions, both, agreed), agreed

    def varied(self, positions: Floats, lines: Floats, agreed: Floats | float = 1.0) -> tuple[Floats, Floats]:
        """(…, vertices) factors of the wavelength and of the height at (vertices, 3) places at rest, crest by crest.

        Wide crests are the high ones. The mean square of the heights is 1, so the surface keeps its length.
        (…, vertices, 3) `lines` are unit directions across the crests, without signs. (vertices,) `agreed` say how much
        they agree with those beside them: where lines turn at once, numbers do not.
        """
        drawn_here = self.variation * self._smooth(positions, lines, agreed)
        return np.exp(_LENGTHS * drawn_here), np.sqrt(1.0 + np.tanh(_HEIGHTS * drawn_here))

    def _smooth(self, positions: Floats, along: Floats, agreed: Floats | float) -> Floats:
        """(…, vertices) smooth random numbers, about from -2 to 2, the same for one place however fine a mesh is.

        They differ most in the direction of (…, vertices, 3) unit vectors without signs, and alike in all where none of
        these `agreed`.
        """
        what = f"crests {self.seed}"
        ways = drawn(what, "ways", _WAVES, 3)
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        lengths = self.wavelength * np.linspace(_SHORTEST, _LONGEST, _WAVES)
        phases = np.pi * drawn(what, "phases", _WAVES)
        # A place without a direction has numbers too. With a higher power of the cosine, crests stay alike from end to
        # end, and those of one patch are bars of one length.
        agreed = np.reshape(agreed, (-1, 1))
        parts = agreed * (along @ ways.T) ** 2 + (1.0 - agreed) / 3.0 + _TINY
        waves = parts * np.cos(2.0 * np.pi * (positions @ (ways / lengths[:, None]).T) + phases)
        return np.asarray(np.sqrt(2.0) * waves.sum(axis=-1) / np.linalg.norm(parts, axis=-1))
