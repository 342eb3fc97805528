"""Irregular fields: smooth random numbers in space, by which wavelengths, directions and heights differ.

Equal ribs read as a machine's. All amounts are those of a variation of 1; the shapes are fixed, so irregularity costs
nothing in a player.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.drawn import drawn

# Waves in space, and their lengths in wavelengths of a field, evenly between these two.
_WAVES, _SHORTEST, _LONGEST = 12, 4.0, 9.0
# Those of heights over these: a crest has to differ from its neighbours, not one end of a garment from the other.
_NEIGHBOURS = 0.5
# Logarithm by which wavelengths differ, radians by which crests turn, and part by which heights differ.
_LENGTHS, _TURNS, _HEIGHTS = 1.0, 2.0, 3.0


def lengthened(positions: Floats, wavelength: float, variation: float, seed: str) -> Floats:
    """(vertices,) factors of the wavelength at (vertices, 3) places at rest."""
    return np.exp(_LENGTHS * variation * _smooth(positions, wavelength, f"lengths {seed}"))


def raised(positions: Floats, wavelength: float, variation: float, seed: str) -> Floats:
    """(vertices,) factors of the height, from 0 to 2, likewise."""
    return 1.0 + np.tanh(_HEIGHTS * variation * _smooth(positions, _NEIGHBOURS * wavelength, f"heights {seed}"))


def turned(lines: Floats, normals: Floats, positions: Floats, wavelength: float, variation: float, seed: str) -> Floats:
    """(vertices, 3) unit lines, turned in the planes of (vertices, 3) normals."""
    angles = _TURNS * variation * _smooth(positions, wavelength, f"turns {seed}")
    return np.asarray(np.cos(angles)[:, None] * lines + np.sin(angles)[:, None] * np.cross(normals, lines))


def _smooth(positions: Floats, wavelength: float, what: str) -> Floats:
    """(vertices,) smooth random numbers, about from -2 to 2, the same for one place however fine a mesh is."""
    ways = drawn(what, "ways", _WAVES, 3)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    lengths = wavelength * np.linspace(_SHORTEST, _LONGEST, _WAVES)
    phases = np.pi * drawn(what, "phases", _WAVES)
    waves = np.cos(2.0 * np.pi * (positions @ (ways / lengths[:, None]).T) + phases)
    return np.asarray(waves.sum(axis=1) * np.sqrt(2.0 / _WAVES))
