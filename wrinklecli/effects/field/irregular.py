"""Irregular fields: smooth random numbers in space, by which crests differ from their neighbours, and bend.

Equal ribs read as a machine's. In cloth few wide and high folds stand among narrow and low ones, so one number gives
width and height of a crest. The number hardly differs along the crest, where another width would fork it. Neighbouring
crests bend alike. All amounts are those of a variation of 1. The shapes are fixed, so irregularity costs nothing in a
player.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.drawn import drawn

# Waves in space, and their lengths in wavelengths of a field, evenly between these two: a crest has to differ from its
# neighbours, not one end of a garment from the other.
_WAVES, _SHORTEST, _LONGEST = 40, 1.6, 4.0
# Stands for 0 where numbers divide.
_TINY = 1e-9
# Logarithm by which wavelengths differ, radians by which crests turn, and by how much heights differ.
_LENGTHS, _TURNS, _HEIGHTS = 1.5, 2.0, 10.0


def varied(positions: Floats, lines: Floats, wavelength: float, variation: float, seed: str) -> tuple[Floats, Floats]:
    """(vertices,) factors of the wavelength and of the height at (vertices, 3) places at rest, crest by crest.

    Wide crests are the high ones. The mean square of the heights is 1, so the surface keeps its length.

    Args:
        positions: The places.
        lines: (vertices, 3) unit directions across the crests, without signs.
        wavelength: Typical, scene units.
        variation: From 0 to 1.
        seed: What the numbers are drawn from.
    """
    drawn_here = variation * _smooth(positions, lines, wavelength, f"crests {seed}")
    return np.exp(_LENGTHS * drawn_here), np.sqrt(1.0 + np.tanh(_HEIGHTS * drawn_here))


def turned(lines: Floats, normals: Floats, positions: Floats, wavelength: float, variation: float, seed: str) -> Floats:
    """(vertices, 3) unit lines, turned in the planes of (vertices, 3) normals."""
    crests = np.cross(normals, lines)
    angles = _TURNS * variation * _smooth(positions, crests, wavelength, f"turns {seed}")
    return np.asarray(np.cos(angles)[:, None] * lines + np.sin(angles)[:, None] * crests)


def _smooth(positions: Floats, along: Floats, wavelength: float, what: str) -> Floats:
    """(vertices,) smooth random numbers, about from -2 to 2, the same for one place however fine a mesh is.

    They differ in the direction of (vertices, 3) unit vectors without signs, and hardly across it.
    """
    ways = drawn(what, "ways", _WAVES, 3)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    lengths = wavelength * np.linspace(_SHORTEST, _LONGEST, _WAVES)
    phases = np.pi * drawn(what, "phases", _WAVES)
    # A place without a direction has numbers too.
    # The eighth power of the cosine: numbers are alike three times as far across a wave's way. `**` takes eight times
    # as long with another exponent than 2.
    parts = (((along @ ways.T) ** 2) ** 2) ** 2 + _TINY
    waves = parts * np.cos(2.0 * np.pi * (positions @ (ways / lengths[:, None]).T) + phases)
    return np.asarray(np.sqrt(2.0) * waves.sum(axis=1) / np.linalg.norm(parts, axis=1))
