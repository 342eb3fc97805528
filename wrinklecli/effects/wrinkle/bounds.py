"""The places where the wrinkles of a tool end within its patch: features of the surface, and where its mask is 0.

The paper (C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004) ends wrinkles at the border of the patch.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.effects.wrinkle.patch import Patch, Reach
from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Bools, Floats, distinct_values, face_normals, unit
from wrinklecli.numeric.edges import Edges
from wrinklecli.numeric.intersections import zero_lines
from wrinklecli.surface.features import Nearest, cut_at_features, surface_distances
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.mask import read_mask, spread

# Part of a bump's width over which heights fade at a feature: as wide as the bump's own flank.
_FADE = 0.5
# Ratio of the way over the surface, from the tool's line, to the straight distance, above which a place is another part
# of the body. Round a limb the ratio is π/2 at most, and ways along edges are up to 1.4 times too long.
_DETOUR = 2.5


def bounded(patches: Sequence[Patch], ground: Ground) -> list[Patch]:
    """Attached tools with the bounds of their wrinkles.

    Raises:
        WrinkleError: Masks do not fit, a line for each.
    """
    return BakeError.every(lambda patch: _masked(_stopped(patch, ground), ground), patches)


def _stopped(patch: Patch, ground: Ground) -> Patch:
    """A patch that ends at features of the surface, without the members behind them.

    A part of the surface between features belongs to the tool if the tool's line runs over it for a bump at least. So
    an anchor may lie on a waistband.
    """
    if patch.tool.stops == "none":
        return patch
    bump = 2.0 * patch.span / patch.curve.interval_count
    cut, covered = cut_at_features(ground, patch.members, bump), _covered(patch, ground)
    if len(cut.features):
        lengths = np.bincount(cut.parts, covered)
        belongs = lengths >= min(bump / patch.span, lengths.max())
        chosen = belongs[cut.parts]
        patch, covered = replace(patch, members=patch.members[chosen]), covered[chosen]
    detours = _detours(patch, ground, covered > 0.0, bump)
    if detours is not None:
        behind = (detours[ground.surface.triangles[patch.members]] >= 1.0).all(axis=1)
        patch = replace(patch, members=patch.members[~behind])
    fade = _FADE * min(bump, patch.half_width)
    nearest = Nearest.of(cut.features, patch.pose, patch.members, fade) if len(cut.features) else None
    return patch if nearest is None and detours is None else replace(patch, reach=Reach(nearest, fade, detours))


def _covered(patch: Patch, ground: Ground) -> Floats:
    """(members,) part of the tool's line, from 0 to 1, that lies on each member."""
    vertices, corners = np.unique(ground.surface.triangles[patch.members], return_inverse=True)
    corners = corners.reshape(-1, 3)
    u, v = patch.coordinates(patch.pose.positions[vertices])
    found, shares = zero_lines(v, corners)
    ends = np.sort(np.clip(np.einsum("ec,ec->e", shares, u[corners[found]]), 0.0, 1.0).reshape(-1, 2), axis=1)
    covered = np.zeros(len(corners))
    covered[found[::2]] = ends[:, 1] - ends[:, 0]
    return covered


def _detours(patch: Patch, ground: Ground, on_line: Bools, bump: float) -> Floats | None:
    """(coarse vertices,) 1 at parts of the body that are only near in space, fading over a bump; None if none are.

    The way over the surface from the tool's line, of which (members,) `on_line` have a part, is much longer there than
    the straight distance.
    """
    surface, pose = ground.surface, patch.pose
    members = surface.triangles[patch.members]
    used = distinct_values(members)
    vertices, corners = np.unique(surface.triangles[ground.rest.around.faces_of(used)], return_inverse=True)
    u, v = patch.coordinates(pose.positions[vertices])
    straight = np.hypot(np.maximum(np.abs(u - 0.5) - 0.5, 0.0) * patch.span, np.abs(v) * patch.half_width)
    starts = np.full(len(vertices), np.inf)
    begun = np.searchsorted(vertices, distinct_values(members[on_line]))
    starts[begun] = straight[begun]
    if not len(begun):
        return None
    ways = surface_distances(Edges.of(corners.reshape(-1, 3)).vertices, pose.positions[vertices], starts)
    excess = np.clip((ways - _DETOUR * straight) / bump, 0.0, 1.0)
    if not excess[np.searchsorted(vertices, used)].any():
        return None
    detours = np.zeros(len(pose.positions))
    detours[vertices] = excess
    return detours


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
