"""Suggested tools and fields, placed on the mesh as a bake refines it.

Regions are measured on the mesh as it is. Only the refined mesh shows what wrinkles reach, and whether its triangles
become short enough for them.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

from wrinklecli.baking.job import BakeOptions, tools_by_node
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.scene import read_scene
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.effect import Part
from wrinklecli.effects.plan import attach_effects, plan_on
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.review.suggest.candidates import Place
from wrinklecli.review.suggest.layers import Layers
from wrinklecli.review.suggest.score import Score
from wrinklecli.review.suggest.stage import Placement
from wrinklecli.review.suggest.text import Entry, file_text, read_suggested
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.rounding import hard_inside
from wrinklecli.tools.records import EffectTool, RefinementSettings, ToolsFile

# Most times that an edge is halved for suggested wrinkles: then a triangle is several times as long as the fold.
MOST_LEVELS = 6
# Triangles of the asset under a bump from which on more make it no better: four along each flank, twice across.
_OF_BUMP = 16


class TriedAsset:
    """An asset on which suggestions are tried; each of its meshes is read, and posed in all clips, once."""

    def __init__(self, document: Document, clips: Sequence[Clip], *, jobs: int = 1) -> None:
        """Read what the scene shows, without malformed primitives.

        Args:
            document: The asset.
            clips: All of the asset.
            jobs: How many processes may try or look at suggestions.
        """
        self.jobs = jobs
        self.document = document
        self.clips = tuple(clips)
        self.scene = read_scene(document, leave_out_malformed=True)
        self.layers = Layers(self.scene, clips)
        self._by_name = {clip.name: clip for clip in reversed(clips)}
        self._neighbours = Neighbours(document)
        self._grounds: dict[int, Ground] = {}

    def clip(self, name: str) -> Clip:
        """The clip of a name; of equal names the asset's."""
        return self._by_name[name]

    def ground(self, node: int) -> Ground:
        """The mesh of a node at rest; suggested tools are laid out in the stored pose."""
        if node not in self._grounds:
            settings = ToolsFile(path=self.document.path)
            self._grounds[node] = read_ground(
                self.document, node, [], settings, self.clips, neighbours=self._neighbours
            )
        return self._grounds[node]

    @property
    def shared(self) -> list[object]:
        """The objects that results of other processes refer to: its meshes at rest, as far as these are read."""
        grounds = self._grounds.values()
        return [part for each in grounds for part in (each, each.document, each.rig, each.surface, each.rest)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Suggested(Place):
    """A tool or a field to try, and what was seen of it.

    Attributes:
        mesh: Name of the node.
        clip: Name of the clip in which it is tallest; empty if it is not known before the mesh carries it.
        time: The time in this clip, seconds.
        height: The greatest displacement, scene units; 0 if nobody looked.
        wavelength: From crest to crest, scene units; 0 if nobody looked.
        targets: The number of its morph targets.
        gpu_bytes: What they take on a GPU, where each part of the mesh has only those that move it.
        own_bytes: What the mesh's own targets take there for the vertices that it adds.
        grown: The merit of a field; NaN if it is not known.
        judgement: What one sees of it, as a score; None if nobody looked, or if no clip raises it.
    """

    mesh: str
    clip: str = ""
    time: float = 0.0
    height: float = 0.0
    wavelength: float = 0.0
    targets: int = 0
    gpu_bytes: int = 0
    own_bytes: int = 0
    grown: float = math.nan
    judgement: Score | None = None

    @property
    @abstractmethod
    def effect(self) -> EffectTool:
        """Its record, with numbers as they are written; the left one of a pair."""

    @property
    @abstractmethod
    def entry(self) -> Entry:
        """It as the file has it."""

    def clips_among(self, clips: Sequence[Clip], part: Part) -> list[Clip]:
        """The clips in which it is checked frame by frame."""
        return [clip for clip in clips if not clip.nodes.isdisjoint(part.drive.nodes)]

    def crossing(self, edges: int) -> Self:  # noqa: ARG002
        """The same, as its fold passes through itself at so many edges."""
        return self

    def mended(self, compressible: float) -> Self | None:  # noqa: ARG002
        """Another one to try where `check` warns of it, by the `compressible` that it needs; None if there is none."""
        return None


@dataclass(frozen=True, slots=True)
class Trial:
    """A suggestion and its twin, or one of them, attached to their mesh alone.

    Attributes:
        ground: The mesh at rest.
        attached: The tools or the field.
        settings: The tools file that has them.
    """

    ground: Ground
    attached: Sequence[AnyAttached]
    settings: ToolsFile

    @classmethod
    def of(cls, asset: TriedAsset, suggestion: Suggested) -> "list[Trial]":
        """Attach a suggestion as a bake does, to each mesh that has it or its twin.

        Raises:
            AssetError: The asset's lengths are beyond the range of a tools file.
            BakeError: A bake would refuse it.
        """
        text = file_text([suggestion.entry], presets=["presets.yaml"])
        settings = read_suggested(text, asset.document, suggestion.presets)
        of_nodes = tools_by_node(asset.document, settings)[0]
        return [cls(*attach_effects(asset.ground(node), of_nodes[node], settings), settings) for node in of_nodes]

    @property
    def smooth(self) -> float:
        """Part of the edges inside their regions that are not hard; the least of both."""
        surface, positions = self.ground.surface, self.ground.rest.bind_positions
        return 1.0 - max(hard_inside(surface, positions, each.regions[0]) for each in self.attached)

    @property
    def fine(self) -> float:
        """Part of the triangles that each of their bumps needs, in the asset; the least of both."""
        needed = (len(each.regions[0].members) / (_OF_BUMP * each.tool.bumps) for each in self.attached)
        return float(min(1.0, *needed))

    def placed(self, refinement: RefinementSettings) -> tuple[RefinementSettings, dict[str, Placement]]:
        """Refine the mesh as finely as they need, without rounding if that would be visible at rest.

        Returns:
            The settings for that, at least those given, and placements by name.

        Raises:
            BakeError: A bake would refuse them.
        """
        finest = replace(refinement, max_levels=MOST_LEVELS)
        # A field needs finer triangles as a rule, and takes so long that nobody tries twice.
        needed = refinement if self._is_carried else finest
        placed = self._placed(needed)
        if needed is not finest and any(each.coarse for each in placed.values()):
            needed = finest
            placed = self._placed(needed)
        if any(each.departs for each in placed.values()):
            needed = replace(needed, scheme="midpoint")
            placed = self._placed(needed)
        # No edge is halved more often than it has to be, so the mesh is that of the least levels.
        levels = max(each.plan.fine.subdivision.levels for each in placed.values())
        return replace(needed, max_levels=max(levels, refinement.max_levels)), placed

    @property
    def _is_carried(self) -> bool:
        """False for a field: to carry it takes long, and what it costs is known before."""
        return all(each.segment is not None for each in self.attached)

    def _placed(self, refinement: RefinementSettings) -> dict[str, Placement]:
        settings = replace(self.settings, refinement=refinement)
        plan = plan_on(self.ground, self.attached, settings, BakeOptions().max_error, carried=self._is_carried)
        return {each.tool.name: Placement(plan, self.ground, each) for each in self.attached}
