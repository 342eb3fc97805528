"""Ambient occlusion of a height field on a texture: the part of the sky that wrinkles hide from each other."""

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats

REACH = 64
"""The distance of the farthest texel that hides the sky from another."""
# Directions, texels, in which the horizon is looked for.
_WAYS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
# Steps along each, texels: a furrow of a few hundred texels has its walls within them.
_REACHES = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, REACH)


def occlusion(heights: Floats, steps: Floats, filled: Bools) -> Floats:
    """(rows, columns) share of a cosine-weighted sky that is seen; 1 where nothing rises.

    Along a direction with its horizon at an elevation e above the surface, a share of cos² e is seen.

    Args:
        heights: (rows, columns) scene units.
        steps: (rows, columns, 2, 3) steps of a texel to the right and down on the surface, scene units.
        filled: (rows, columns) True for texels of charts; others neither see nor hide anything.
    """
    rows, columns = heights.shape
    seen = np.zeros(heights.shape)
    for right, below in _WAYS:
        length = np.linalg.norm(right * steps[:, :, 0] + below * steps[:, :, 1], axis=2)
        rise = np.zeros(heights.shape)
        for reach in _REACHES:
            x, y = right * reach, below * reach
            if abs(x) >= columns or abs(y) >= rows:
                break
            to = slice(max(-y, 0), rows - max(y, 0)), slice(max(-x, 0), columns - max(x, 0))
            of = slice(max(y, 0), rows - max(-y, 0)), slice(max(x, 0), columns - max(-x, 0))
            tangent = (heights[of] - heights[to]) / np.maximum(reach * length[to], 1e-30)
            rise[to] = np.where(filled[of], np.maximum(rise[to], tangent), rise[to])
        seen += 1.0 / (1.0 + rise * rise)
    return np.where(filled, seen / len(_WAYS), 1.0)
