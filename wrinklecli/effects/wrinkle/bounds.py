"""Where the wrinkles of an attached tool end: at its mask."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.effects.wrinkle.mask import read_mask, spread
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.numeric.arrays import face_normals, unit
from wrinklecli.surface.ground import Ground


def bounded(patches: Sequence[Patch], ground: Ground) -> list[Patch]:
    """Attached tools with their masks.

    Raises:
        WrinkleError: Masks do not fit, a line for each.
    """
    found: list[Patch] = []
    problems: list[WrinkleError] = []
    for patch in patches:
        try:
            found.append(_masked(patch, ground))
        except WrinkleError as error:
            problems.append(error)
    if problems:
        raise BakeError.of_all(problems)
    return found


def _masked(patch: Patch, ground: Ground) -> Patch:
    """A patch with its mask, without the members where the mask is 0.

    Raises:
        WrinkleError: The mask cannot be read, or is 0 all over the patch.
    """
    mask = read_mask(patch.tool, ground, patch.members)
    if mask is None:
        return patch
    pose, triangles = patch.pose, ground.surface.triangles[patch.members]
    factors = mask.over(ground.surface.corners[patch.members])
    used, corners = np.unique(triangles, return_inverse=True)
    normals = pose.normals_at(used)[corners.reshape(-1, 3)]
    u, v = patch.coordinates(spread(pose.positions[triangles]))
    heights = patch.share(u, v, patch.cosines(u, unit(spread(normals))))
    heights *= np.linalg.norm(face_normals(pose.positions, triangles), axis=1)[:, None]
    left = float((factors * heights).sum())
    if not left > 0:
        raise BakeError(f"the mask leaves nothing of {patch.tool.name}", where=patch.tool.place("mask"))
    chosen = patch.members[factors.any(axis=1)]
    return replace(patch, members=chosen, mask=mask, mask_share=left / float(heights.sum()))
