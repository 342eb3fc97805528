"""The softness of a region on the skin, by a painted mask or by the weights of a joint."""

import numpy as np

from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.mask import read_mask
from wrinklecli.tools.body import Flesh


def softness_of(tool: Flesh, ground: Ground, joint: int | None) -> Floats | None:
    """(vertices,) factors from 0 to 1 of a region on the coarse skin; None if its ball alone says where it is.

    Args:
        tool: The region.
        ground: The mesh at rest.
        joint: The index of the joint whose skin is the region; None if the region is elsewhere.

    Raises:
        WrinkleError: The mask is missing or malformed.
    """
    surface = ground.surface
    soft = None
    if joint is not None:
        soft = surface.dense_weights(np.arange(len(surface.positions)), len(ground.rig.joints))[:, joint]
    mask = read_mask(tool, ground, np.arange(len(surface.triangles)))
    if mask is None:
        return soft
    painted = mask.welded(surface.weld, len(surface.positions))
    return painted if soft is None else painted * soft
