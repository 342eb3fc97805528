"""First guesses of tools between two places that a user chooses: the width, bumps and `compressible` of `suggest`.

A guesser also measures how far clips compress each place at most.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, significant
from wrinklecli.numeric.closest import nearest_of
from wrinklecli.review.suggest.draft import WIDTH_OF_REGION
from wrinklecli.review.suggest.measure import MeasuredMesh, clips_that_move
from wrinklecli.review.suggest.shortening import Shortening, attached, greatest, shortenings_of, with_rising_bumps
from wrinklecli.review.suggest.text import REST_LENGTH
from wrinklecli.surface.compression import CompressedRegion, grow_region
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.path import Path
from wrinklecli.surface.region import Region
from wrinklecli.surface.sites import Peaks, at_sites, find_peaks, spread_sites
from wrinklecli.surface.strain import read_gauge
from wrinklecli.surface.substance import read_makeup, substance_of
from wrinklecli.tools.json_schema import readers_of
from wrinklecli.tools.materials import preset
from wrinklecli.tools.records import Length, WrinkleTool

# Poses of each clip.
_POSES = 60
# Least width of a guessed tool over its length: a narrower region says nothing about the tool.
_NARROWEST = 0.4
# Greatest width of a guessed tool over its length, likewise.
_WIDEST = 3.0
# Shortening below which a place does not fold, as a part of the rest length.
_LEAST_SHORTENING = 0.02


@dataclass(frozen=True, slots=True)
class Compressed:
    """The greatest compression of (sites, 3) places of a surface at rest over some poses."""

    sites: Floats
    peaks: Peaks

    def at(self, places: Floats) -> tuple[Floats, Ints]:
        """(places,) the compression of (places, 3) at rest, at least 0, and (places,) the number of its pose."""
        _, near = nearest_of(self.sites, places)
        return np.maximum(self.peaks.losses[near], 0.0), self.peaks.poses[near]


class ToolGuesser:
    """Guesses tools on a mesh. Measuring the mesh takes as long as a few frames."""

    def __init__(self, document: Document, ground: Ground, clips: Sequence[Clip]) -> None:
        moving = clips_that_move(ground.rig, clips)
        sites = spread_sites(read_gauge(ground.surface, ground.rest, ground.rig))
        times = tuple(np.linspace(clip.start, clip.end, _POSES) for clip in moving)
        self._mesh = MeasuredMesh(ground, sites, moving, times)
        self._makeup = read_makeup(document, ground.rig, sites.gauge)

    @cached_property
    def compressed(self) -> Compressed | None:
        """The greatest compression over the clips; None if no clip moves the mesh."""
        mesh = self._mesh
        return Compressed(mesh.sites.positions, find_peaks(mesh.sites, mesh.clips, mesh.times)) if mesh.clips else None

    def tool(self, origin: Floats, target: Floats) -> WrinkleTool:
        """Guess the tool between two (3,) places at rest, world space.

        The tool is as wide as the region that the pose with the greatest shortening folds, has the usual bumps of its
        material, and they are full in that pose. If no clip folds the place, the tool has the usual values of its
        material, and is as wide as long.
        """
        span, mesh = float(np.linalg.norm(target - origin)), self._mesh
        tool = _plain(origin, target, span)
        patches = attached(mesh, [tool])
        if patches is None:
            return tool
        tool = self._with_material(tool, patches[0].regions[0])
        if not mesh.clips:
            return tool
        deepest = greatest(shortenings_of(mesh, patches[0]))
        if not deepest.ratio > _LEAST_SHORTENING:
            return tool
        region = self._region(patches[0].regions[0].path, deepest)
        if region is not None:
            width = float(np.clip(WIDTH_OF_REGION * region.width, _NARROWEST * span, _WIDEST * span))
            tool = replace(tool, width=Length(significant(width, 2)), rest_length=REST_LENGTH, strategy="everywhere")
        patches = attached(mesh, [tool])
        return with_rising_bumps(patches, [shortenings_of(mesh, patches[0])])[0] if patches else tool

    def _with_material(self, tool: WrinkleTool, region: Region) -> WrinkleTool:
        """Give a tool the material of the triangles of its region."""
        gauge = self._mesh.gauge
        areas = gauge.areas * np.isin(gauge.numbers, region.members)
        material = substance_of(self._makeup, areas / areas.sum()).material if areas.any() else None
        if material is None:
            return tool
        return replace(tool, material=material, **preset(material).fields(readers_of(WrinkleTool)))

    def _region(self, path: Path, deepest: Shortening) -> CompressedRegion | None:
        """The region that the pose folds around the middle of a path; None if it folds nothing there."""
        sites = self._mesh.sites
        away = np.sum((sites.positions - path.middle) ** 2, axis=1)
        facing = sites.normals @ path.normal > 0
        if not facing.any():
            return None
        seed = int(np.argmin(np.where(facing, away, np.inf)))
        tensors = at_sites(sites, deepest.clip, np.array([deepest.time]))[0]
        free = np.ones(len(sites.positions), bool)
        return grow_region(sites, seed, tensors, free, twin=False, across=False)


def _plain(origin: Floats, target: Floats, span: float) -> WrinkleTool:
    """A tool with these ends and usual values, as wide as long."""
    (a, b, c), (d, e, f) = origin.tolist(), target.tolist()
    width = Length(significant(span, 2) or 1.0)
    return WrinkleTool(name="chosen", origin=(a, b, c), target=(d, e, f), width=width)
