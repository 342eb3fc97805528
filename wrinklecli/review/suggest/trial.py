"""Suggested tools placed on the mesh as a bake refines it.

Regions are measured on the mesh as it is. Only the refined mesh shows what a tool's wrinkles reach, and whether its
triangles become short enough for them.
"""

from collections.abc import Sequence
from dataclasses import replace

from wrinklecli.baking.job import BakeOptions, tools_by_node
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.scene import read_scene
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.plan import attach_effects, plan_on, skin_parts
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.layers import Layers
from wrinklecli.review.suggest.stage import Placement
from wrinklecli.review.suggest.text import file_text, read_suggested
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.rounding import hard_edges
from wrinklecli.tools.records import RefinementSettings, ToolsFile

# Most times that an edge is halved for suggested wrinkles: then a triangle is several times as long as the fold.
MOST_LEVELS = 6


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
        self.layers = Layers(read_scene(document, leave_out_malformed=True), clips)
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


@dataclass(frozen=True, slots=True)
class Trial:
    """A suggestion and its twin, or one of them, attached to their mesh alone.

    Attributes:
        ground: The mesh at rest.
        attached: The tools.
        settings: The tools file that has them.
    """

    ground: Ground
    attached: Sequence[AnyAttached]
    settings: ToolsFile

    @classmethod
    def of(cls, asset: TriedAsset, suggestion: Suggestion) -> "list[Trial]":
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
        """Part of the edges under the tools that are not hard."""
        regions = [each.regions[0] for each in self.attached]
        return 1.0 - float(hard_edges(self.ground.surface, self.ground.rest.bind_positions, regions).shares.max())

    def placed(self, refinement: RefinementSettings) -> tuple[RefinementSettings, dict[str, Placement]]:
        """Refine the mesh as finely as the tools need, without rounding if that would be visible at rest.

        Returns:
            The settings for that, at least those given, and placements by the tool's name.

        Raises:
            BakeError: A bake would refuse the tools.
        """
        needed, placed = refinement, self._placed(refinement)
        if any(each.coarse for each in placed.values()):
            needed = replace(refinement, max_levels=MOST_LEVELS)
            placed = self._placed(needed)
        if any(each.departs for each in placed.values()):
            needed = replace(needed, scheme="midpoint")
            placed = self._placed(needed)
        # No edge is halved more often than it has to be, so the mesh is that of the least levels.
        levels = max(each.plan.fine.subdivision.levels for each in placed.values())
        return replace(needed, max_levels=max(levels, refinement.max_levels)), placed

    def _placed(self, refinement: RefinementSettings) -> dict[str, Placement]:
        settings = replace(self.settings, refinement=refinement)
        plan = plan_on(self.ground, self.attached, settings, BakeOptions().max_error)
        return {part.attached.tool.name: Placement(plan, part) for part in skin_parts(plan)}
