"""Two families of crests, and smooth random numbers in space by which crests differ from their neighbours.

Equal ribs read as a machine's. In cloth few wide and high folds stand among narrow and low ones, so one number gives
width and height of a crest. The number differs less along the crest, where another width forks it and another height
ends it. Two families that cross everywhere would be dents without a direction. So one of them leads over folds several
times as long as wide, and the other one where these end: the one that bends less along its crests, and where both bend
alike, that which chance draws. All amounts are those of a variation of 1. The shapes are fixed, so irregularity costs
nothing in a player.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.effects.field.compression import shortest
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.drawn import drawn
from wrinklecli.surface.strain import tangents

# Waves in space, and their lengths in wavelengths of a field, evenly between these two: a crest has to differ from its
# neighbours, not one end of a garment from the other.
_WAVES, _SHORTEST, _LONGEST = 40, 1.6, 4.0
# Times these lengths over which one family leads: a crest that has a number of its own ends there twice as seldom.
_LEADS = 2.0
# Standard deviations of chance that outweigh it where one family alone bends along its crests.
_SURE = 3.0
# Stands for 0 where numbers divide.
_TINY = 1e-9
# Logarithm by which wavelengths differ, and by how much heights differ.
_LENGTHS, _HEIGHTS = 1.5, 5.0


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
        self,
        positions: Floats,
        normals: Floats,
        directions: Floats,
        slants: Floats,
        leads: Floats | float = 0.0,
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Draw the crests at (vertices, 3) places at rest with unit normals, by what `Heights` has of these names.

        Returns:
            (2, vertices, 3) unit lines across two families of crests, without signs; (2, vertices) factors of their
            wavelength and of their height; and (vertices,) how much lines agree, from 0, where they turn at once, to 1.
        """
        least, lines, across = shortest(directions, tangents(normals))
        agreed = np.clip((across - least) / np.maximum(-across - least, _TINY), 0.0, 1.0)
        level, aslant = np.sqrt(1.0 - slants**2)[:, None] * lines, slants[:, None] * np.cross(normals, lines)
        both = np.stack([level + aslant, level - aslant])
        return both, *self.varied(positions, lines, both, agreed, leads), agreed

    def varied(
        self,
        positions: Floats,
        lines: Floats,
        both: Floats,
        agreed: Floats | float = 1.0,
        leads: Floats | float = 0.0,
    ) -> tuple[Floats, Floats]:
        """(2, vertices) factors of the wavelength and of the height at (vertices, 3) places at rest, crest by crest.

        Wide crests are the high ones. The mean square of the heights is 1, so the surface keeps its length: what one
        family has more, the other has less.

        Args:
            positions: The places.
            lines: (vertices, 3) unit lines, without signs, across the bands in which one family leads.
            both: (2, vertices, 3) unit lines across the crests of each.
            agreed: (vertices,) how much lines agree with those beside them: where they turn at once, numbers do not.
            leads: (vertices,) from -1 to 1, those of `Heights`.
        """
        numbers = self._smooth(positions, both, agreed)
        bands = replace(self, wavelength=_LEADS * self.wavelength, seed=f"{self.seed} leads")
        leading = bands._smooth(positions, lines, agreed) + _SURE * leads
        ranks = numbers + np.multiply.outer([1.0, -1.0], leading)
        much = 1.0 + np.tanh(_HEIGHTS * self.variation * ranks.mean(axis=0))
        part = 1.0 + np.tanh(_HEIGHTS * self.variation * (ranks - ranks[::-1]))
        return np.exp(_LENGTHS * self.variation * numbers), np.sqrt(much * part)

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
