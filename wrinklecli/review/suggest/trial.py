"""Suggested tools placed on the mesh as a bake refines it.

Regions are measured on the mesh as it is. Only the refined mesh shows what a tool's wrinkles reach, and whether its
triangles become short enough for them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from wrinklecli.baking.job import BakeOptions, tools_by_node
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.scene import ScenePrimitive, read_scene
from wrinklecli.effects.effect import MeshPlan, Part
from wrinklecli.effects.plan import attach_effects, plan_on, skin_parts
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Ints, among, distinct_values
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.text import read_suggested, tools_text
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.records import EffectTool, RefinementSettings, ToolsFile

# Most times that an edge is halved for suggested wrinkles: then a triangle is several times as long as the fold.
MOST_LEVELS = 6


@dataclass(frozen=True, slots=True)
class Placement:
    """A tool on the refined mesh.

    Attributes:
        plan: The mesh with the tools that were placed together.
        part: The tool on that mesh.
        vertices: (vertices,) of the mesh under the tool's patch, sorted.
        coarse: True if edges under the patch stay too long, for its wrinkles or for those of a tool beside it.
        departs: True if refinement moves the surface under the tool so much that it is visible at rest.
    """

    plan: MeshPlan
    part: Part
    vertices: Ints
    coarse: bool
    departs: bool

    @classmethod
    def of(cls, plan: MeshPlan, part: Part) -> "Placement":
        """Look at a part of a plan."""
        members = part.attached.regions[0].members
        return cls(
            plan=plan,
            part=part,
            vertices=distinct_values(plan.fine.surface.triangles[members]),
            coarse=bool(among(members, plan.fine.subdivision.unmet).any()),
            departs=plan.fine.departs(part.region),
        )


class TriedAsset:
    """An asset on which suggestions are tried; each of its meshes is read, and posed in all clips, once."""

    def __init__(self, document: Document, clips: Sequence[Clip], *, jobs: int = 1) -> None:
        """`clips` are all of the asset; `jobs` is how many processes may try or look at suggestions."""
        self.jobs = jobs
        self.document = document
        self.clips = tuple(clips)
        self._neighbours = Neighbours(document)
        self._grounds: dict[int, Ground] = {}

    @cached_property
    def scene(self) -> tuple[ScenePrimitive, ...]:
        """All primitives that the scene shows, without malformed ones."""
        return read_scene(self.document, leave_out_malformed=True)

    def ground(self, node: int) -> Ground:
        """The mesh of a node at rest; suggested tools are laid out in the stored pose."""
        if node not in self._grounds:
            settings = ToolsFile(path=self.document.path, tools=())
            self._grounds[node] = read_ground(
                self.document, node, [], settings, self.clips, neighbours=self._neighbours
            )
        return self._grounds[node]


@dataclass(frozen=True, slots=True)
class Trial:
    """The asset on which suggestions are tried, and the settings with which it is refined."""

    asset: TriedAsset
    refinement: RefinementSettings

    def placements(self, suggestions: Sequence[Suggestion]) -> dict[str, Placement]:
        """Place suggestions and their twins on refined meshes, by the tool's name; empty if a bake would refuse."""
        if not suggestions:
            return {}
        try:
            settings = read_suggested(tools_text(suggestions, "", presets=["presets.yaml"]), suggestions)
            settings = replace(settings, refinement=self.refinement)
            by_node, _ = tools_by_node(self.asset.document, settings)
            grounds = [self.asset.ground(node) for node in by_node]
            shared = [part for each in grounds for part in (each, each.surface, each.rest, each.rig)]
            planned = partial(_planned, settings=settings)
            plans = list(
                in_processes(planned, [*zip(grounds, by_node.values(), strict=True)], self.asset.jobs, shared=shared)
            )
        except WrinkleError:
            return {}
        return {part.attached.tool.name: Placement.of(plan, part) for plan in plans for part in skin_parts(plan)}

    def placed_again(
        self, suggestions: Sequence[Suggestion], changed: Sequence[Suggestion], placed: Mapping[str, Placement]
    ) -> dict[str, Placement]:
        """Place the changed ones of some placed suggestions anew, with those that they touch; give all placements."""
        moved = [placed[name] for each in changed for name in names_of(each, placed)]
        return {**placed, **self.placements([each for each in suggestions if _touches(each, placed, moved)])}

    def fitting(self, suggestions: Sequence[Suggestion]) -> "tuple[Trial, dict[str, Placement], list[Suggestion]]":
        """Refine as finely as suggestions need, and without rounding if that would be visible at rest.

        Returns:
            The settings for that; suggestions and their twins so placed, by the tool's name; and suggestions that even
            the finest mesh does not show, which are not placed.
        """
        usual = self
        trial, placed = usual._fine_enough(suggestions)
        if any(each.departs for each in placed.values()) and self.refinement.scheme != "midpoint":
            usual = replace(self, refinement=replace(self.refinement, scheme="midpoint"))
            trial, placed = usual._fine_enough(suggestions)
        beside = [each for each in suggestions if any(placed[name].coarse for name in names_of(each, placed))]
        too_coarse = in_processes(usual._is_coarse, beside, self.asset.jobs)
        coarse = [each for each, holds in zip(beside, too_coarse, strict=True) if holds]
        if coarse:
            trial, placed = usual._fine_enough([each for each in suggestions if each not in coarse])
        return trial, placed, coarse

    def _is_coarse(self, suggestion: Suggestion) -> bool:
        """True if edges stay too long for a suggestion even where they are halved most often."""
        trial = replace(self, refinement=replace(self.refinement, max_levels=MOST_LEVELS))
        return any(each.coarse for each in trial.placements([suggestion]).values())

    def _fine_enough(self, suggestions: Sequence[Suggestion]) -> "tuple[Trial, dict[str, Placement]]":
        """Find the least levels, these or more, that make edges short enough, or else the most; and place them so."""
        if not self._must_be_finer(suggestions):
            placed = self.placements(suggestions)
            finest = self.refinement.max_levels >= MOST_LEVELS
            if finest or not any(each.coarse for each in placed.values()):
                return self, placed
        most = replace(self, refinement=replace(self.refinement, max_levels=MOST_LEVELS))
        # No edge is halved more often than it has to be, so the mesh is that of the least levels.
        placed = most.placements(suggestions)
        levels = max((each.plan.fine.subdivision.levels for each in placed.values()), default=0)
        levels = max(levels, self.refinement.max_levels)
        return replace(self, refinement=replace(self.refinement, max_levels=levels)), placed

    def _must_be_finer(self, suggestions: Sequence[Suggestion]) -> bool:
        """True if an edge of the mesh as it is stays too long for a suggestion, however evenly it is halved."""
        levels = self.refinement.max_levels
        if levels >= MOST_LEVELS:
            return False
        steps = self.refinement.edges_per_interval / 2**levels
        unrefined = replace(self.refinement, max_levels=0, edges_per_interval=steps)
        return any(each.coarse for each in replace(self, refinement=unrefined).placements(suggestions).values())


def _planned(mesh: tuple[Ground, Sequence[EffectTool]], settings: ToolsFile) -> MeshPlan:
    """Plan the tools of a mesh as a bake does."""
    ground, tools = mesh
    return plan_on(*attach_effects(ground, tools, settings), settings, BakeOptions().max_error)


def _touches(suggestion: Suggestion, placed: Mapping[str, Placement], moved: Sequence[Placement]) -> bool:
    """True if the refinement under moved tools may change the refinement under the suggestion's."""
    own = [placed[name] for name in names_of(suggestion, placed)]
    pairs = ((first, second) for first in own for second in moved if first.plan.rig.node == second.plan.rig.node)
    return any(len(np.intersect1d(first.vertices, second.vertices)) > 0 for first, second in pairs)


def names_of(suggestion: Suggestion, placed: Mapping[str, Placement]) -> Iterator[str]:
    """The names of the suggestion's tool and of its twin that could be placed."""
    names = [suggestion.tool.name, *([exchange_sides(suggestion.tool.name)] if suggestion.mirrored else [])]
    return (name for name in names if name in placed)
