"""Flesh on a mesh: regions attached to joints, then carried by the refined surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import Pose
from wrinklecli.drive.swing import nonnegative
from wrinklecli.effects.effect import Attached, Effect, MeshPlan, Motion, SamplingOptions, named_targets
from wrinklecli.effects.flesh.attach import AttachedFlesh, attach_flesh
from wrinklecli.effects.flesh.effect import FleshEffect
from wrinklecli.effects.sampling import sample_driven
from wrinklecli.effects.shapes import Sample, make_shapes
from wrinklecli.numeric.arrays import Floats, Ints, nonzero_rows
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.records import EffectTool, ToolsFile

# Part of the limit to which a mode is raised where normals are fitted: flesh is seldom further out of its place.
_FITTED = 0.6


@dataclass(frozen=True, slots=True)
class FleshLayer:
    """The regions of flesh of a mesh.

    Attributes:
        regions: The regions at rest.
        deltas: For each (targets, fine vertices, 3) displacements at weight 1, bind space.
    """

    regions: tuple[AttachedFlesh, ...]
    deltas: tuple[Floats, ...]

    section: ClassVar[str] = FleshEffect.section
    drives_alone: ClassVar[bool] = True
    named_clips: ClassVar[frozenset[str]] = frozenset()
    keyed_clips: ClassVar[frozenset[str]] = frozenset()
    projected: ClassVar[int] = 0

    @property
    def moved(self) -> Sequence[Ints]:
        """The vertices of each region."""
        return [np.flatnonzero(np.any(each, axis=(0, 2))) for each in self.deltas]

    @property
    def sampled_numbers(self) -> int:
        """Weights, as states too."""
        return sum(2 * len(each) for each in self.deltas)

    def target_sizes(self, _plan: MeshPlan, _clips: Sequence[Clip], _frames: int, _memory: Memory) -> list[int]:
        """The vertices that each target moves."""
        return [len(nonzero_rows(target)) for each in self.deltas for target in each]

    def sample(
        self,
        plan: MeshPlan,
        clips: Sequence[Clip],
        effects: Sequence[Effect],
        _motions: Sequence[Motion],
        how: SamplingOptions,
    ) -> tuple[list[Effect], list[Motion]]:
        """Run the springs over clips."""
        every = [*effects, *(self._effect(plan, number) for number in range(len(self.regions)))]
        return every, sample_driven(plan, clips, every, how)

    def _effect(self, plan: MeshPlan, number: int) -> FleshEffect:
        """The effect of one region."""
        region, deltas = self.regions[number], self.deltas[number]
        vertices = np.flatnonzero(np.any(deltas, axis=(0, 2)))
        moves = np.einsum("vij,kvj->kvi", plan.fine.blended[vertices, :, :3], deltas[:, vertices])
        pose = Pose(plan.rest.matrices, plan.rest.morph_weights)
        modes = np.eye(len(region.drive.modes))
        rows = nonnegative(_FITTED * np.concatenate([modes, -modes]))
        shapes = make_shapes(
            plan.fine,
            vertices,
            deltas[:, vertices],
            tallest=np.sqrt(np.sum(moves**2, axis=2)).max(axis=1, initial=0.0),
            samples=[Sample(row, pose) for row in rows] if plan.has_normals else [],
        )
        identifier = region.tool.identifier
        return FleshEffect(identifier, named_targets(identifier, shapes), region, deltas)

    def warnings(self, _plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """A line if there is no clip."""
        names = ", ".join(each.tool.name for each in self.regions)
        return [] if clips else [f"{names}: there is no clip: flesh swings only in a player with a driver"]


class FleshKind:
    """Flesh."""

    def attach(self, tools: Sequence[EffectTool], ground: Ground, settings: ToolsFile) -> Sequence[Attached]:
        """Attach the regions to joints and the surface at rest, and solve them.

        Raises:
            WrinkleError: Regions do not fit, a line for each.
        """
        own = [tool for tool in tools if isinstance(tool, Flesh)]
        return attach_flesh(own, ground, settings) if own else []

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, Attached]]) -> FleshLayer | None:
        """Let the refined surface carry the regions."""
        regions = tuple(each for _, each in attached if isinstance(each, AttachedFlesh))
        names = plan.rig.morph_names
        columns = [[names.index(name) for name in each.drive.targets] for each in regions]
        return FleshLayer(regions, tuple(plan.fine.morph_deltas[each] for each in columns)) if regions else None
