"""The tool of a place that somebody has chosen: width, bumps and tissue's share as `suggest` would give them there."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.baking.plan import Ground
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import moving_nodes
from wrinklecli.choices import MaterialName
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.suggest.draft import tool_of, width_of
from wrinklecli.review.suggest.folds import Fold
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.moments import deepest_moments, rising_tools
from wrinklecli.review.suggest.room import highest
from wrinklecli.review.suggest.substance import Makeup, is_faceted, read_makeup, substance_of
from wrinklecli.surface.compression import CompressedRegion, grow_region, triangle_shares
from wrinklecli.surface.sites import Peaks, at_sites, spread_sites
from wrinklecli.surface.strain import read_gauge
from wrinklecli.tools.records import Length, WrinkleTool

# Poses of each clip that are looked at.
_POSES = 60
# Widths over the length of a segment: below and above these a region says nothing of a tool.
_NARROWEST, _WIDEST = 0.4, 3.0
# Shortening, as a part of the rest length, below which nothing is told of how a place folds.
_LEAST_SHORTENING = 0.02


class Chosen:
    """A mesh on which somebody chooses places. To measure it takes as long as a few frames.

    Args:
        document: The asset.
        ground: The mesh at rest.
        clips: Of the asset.
    """

    def __init__(self, document: Document, ground: Ground, clips: Sequence[Clip]) -> None:
        self._ground = ground
        moving = moving_nodes(ground.rig)
        its_clips = tuple(clip for clip in clips if any(channel.node in moving for channel in clip.channels))
        gauge = read_gauge(ground.surface, ground.rest, ground.rig)
        sites = spread_sites(gauge)
        self._mesh = MeasuredMesh(
            rig=ground.rig,
            surface=ground.surface,
            rest=ground.rest,
            gauge=gauge,
            sites=sites,
            clips=its_clips,
            times=tuple(np.linspace(clip.start, clip.end, _POSES) for clip in its_clips),
            peaks=Peaks(np.zeros(len(sites.positions)), np.zeros(0, np.intp), (), np.zeros(0)),
            node=None,
            flat=False,
        )
        self._makeup: Makeup = read_makeup(document, ground.rig, gauge)

    def tool(self, origin: Floats, target: Floats) -> WrinkleTool:
        """A tool between two (3,) places at rest, world space.

        Its width is that of the region which the deepest pose folds, its bumps those of what it is made of, and they
        are full in that pose. Where no clip folds the place, it is as wide as long, and plain.
        """
        span = float(np.linalg.norm(target - origin))
        tool = _plain(origin, target, span)
        probe = self._attached(tool)
        if probe is None or not self._mesh.clips:
            return tool
        moments = deepest_moments(self._mesh, probe)
        name = max(moments, key=lambda each: moments[each].shortening)
        if not moments[name].shortening > _LEAST_SHORTENING:
            return tool
        clip = next(each for each in self._mesh.clips if each.name == name)
        region = self._region(probe, clip, moments[name].time)
        if region is None:
            return self._rising(tool)
        fold = self._fold(region, clip, moments[name].time, origin, target)
        width = float(np.clip(width_of(fold), _NARROWEST * span, _WIDEST * span))
        found = tool_of(fold, tool.name, width)
        return self._rising(replace(found, origin=tool.origin, target=tool.target))

    def _attached(self, tool: WrinkleTool) -> Patch | None:
        ground = self._ground
        try:
            return attach_tools([tool], ground.surface, ground.rest, ground.rig, up="y")[0]
        except WrinkleError:
            return None

    def _region(self, patch: Patch, clip: Clip, time: float) -> CompressedRegion | None:
        """What the pose folds around the middle of a patch; none where that is not folded."""
        sites = self._mesh.sites
        away = np.sum((sites.positions - patch.path.middle) ** 2, axis=1)
        facing = sites.normals @ patch.normal > 0
        if not facing.any():
            return None
        seed = int(np.argmin(np.where(facing, away, np.inf)))
        tensors = at_sites(sites, clip, np.array([time]))[0]
        free = np.ones(len(sites.positions), bool)
        return grow_region(sites, seed, tensors, free, twin=False, across=False)

    def _fold(self, region: CompressedRegion, clip: Clip, time: float, origin: Floats, target: Floats) -> Fold:
        fold = Fold(self._mesh, region, clip, time, origin, target, score=0.0)
        shares = triangle_shares(self._mesh.sites, region)
        kind = substance_of(self._makeup, shares).kind
        material: MaterialName | None = None if kind == "hard" else kind
        facet = 3.0**0.5 * float(shares @ self._mesh.gauge.radii) if is_faceted(self._makeup, shares) else 0.0
        return replace(fold, material=material, facet=facet)

    def _rising(self, tool: WrinkleTool) -> WrinkleTool:
        """A tool whose bumps are full in its deepest pose, where there is room for them."""
        patch = self._attached(tool)
        if patch is None:
            return tool
        found = rising_tools([patch], [deepest_moments(self._mesh, patch)], highest(self._mesh, patch))
        return tool if found is None else found[0]


def _plain(origin: Floats, target: Floats, span: float) -> WrinkleTool:
    """A tool of which nothing is known but its ends."""
    (a, b, c), (d, e, f) = origin.tolist(), target.tolist()
    width = round(span, 1 - math.floor(math.log10(span))) if span > 0 else 1.0
    return WrinkleTool(name="chosen", origin=(a, b, c), target=(d, e, f), width=Length(width))
