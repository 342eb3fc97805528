"""Muscles on a mesh: attached to bones, then carried by the refined surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import Pose
from wrinklecli.effects.effect import Attached, Effect, MeshPlan, Motion, SamplingOptions, named_targets
from wrinklecli.effects.muscle.attach import AttachedMuscle, attach_muscles
from wrinklecli.effects.muscle.effect import MuscleEffect
from wrinklecli.effects.sampling import sample_driven
from wrinklecli.effects.shapes import Sample, make_shapes
from wrinklecli.numeric.arrays import Floats, Ints, nonzero_rows
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Muscle
from wrinklecli.tools.records import EffectTool, ToolsFile

# Thicknesses of a belly that travels at which its normals are right.
_FIT_KNOTS = 12


@dataclass(frozen=True, slots=True)
class MuscleLayer:
    """The muscles of a mesh.

    Attributes:
        muscles: The muscles at rest.
        deltas: For each (targets, fine vertices, 3) displacements at weight 1, bind space.
    """

    muscles: tuple[AttachedMuscle, ...]
    deltas: tuple[Floats, ...]

    section: ClassVar[str] = MuscleEffect.section
    drives_alone: ClassVar[bool] = True
    named_clips: ClassVar[frozenset[str]] = frozenset()
    projected: ClassVar[int] = 0

    @property
    def moved(self) -> Sequence[Ints]:
        """The vertices of each muscle."""
        return [np.flatnonzero(np.any(each, axis=(0, 2))) for each in self.deltas]

    @property
    def keyed_clips(self) -> frozenset[str]:
        """The clips that key the activation of a muscle."""
        return frozenset(clip for each in self.muscles for clip, _ in each.tool.named_clips)

    @property
    def sampled_numbers(self) -> int:
        """Weights, a distance and a rest length of each muscle."""
        return sum(len(each) + 2 for each in self.deltas)

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
        """Run the muscles over clips."""
        every = [*effects, *(self._effect(plan, number) for number in range(len(self.muscles)))]
        return every, sample_driven(plan, clips, every, how)

    def _effect(self, plan: MeshPlan, number: int) -> MuscleEffect:
        """The effect of one muscle."""
        muscle, deltas = self.muscles[number], self.deltas[number]
        vertices = np.flatnonzero(np.any(deltas, axis=(0, 2)))
        moves = np.einsum("vij,kvj->kvi", plan.fine.blended[vertices, :, :3], deltas[:, vertices])
        pose = Pose(plan.rest.matrices, plan.rest.morph_weights)
        knots = muscle.response.mix
        chosen = np.linspace(len(knots) - 1, 0, min(_FIT_KNOTS, len(knots))).astype(int)
        samples = [Sample(row, pose) for row in knots[chosen]] if plan.has_normals else []
        shapes = make_shapes(
            plan.fine,
            vertices,
            deltas[:, vertices],
            tallest=np.sqrt(np.sum(moves**2, axis=2)).max(axis=1),
            samples=samples,
        )
        identifier = muscle.tool.identifier
        gained = _gained(plan, vertices, np.tensordot(knots[-1], moves, axes=1))
        return MuscleEffect(identifier, named_targets(identifier, shapes), muscle, deltas, gained)

    def warnings(self, _plan: MeshPlan, _clips: Sequence[Clip]) -> list[str]:
        """Nothing: each muscle speaks for itself."""
        return []


class MuscleKind:
    """Muscles."""

    def attach(self, tools: Sequence[EffectTool], ground: Ground, _settings: ToolsFile) -> Sequence[Attached]:
        """Attach the muscles to the rig and the surface at rest.

        Raises:
            WrinkleError: Muscles do not fit, a line for each.
        """
        own = [tool for tool in tools if isinstance(tool, Muscle)]
        return attach_muscles(own, ground) if own else []

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, Attached]]) -> MuscleLayer | None:
        """Let the refined surface carry the muscles."""
        muscles = tuple(each for _, each in attached if isinstance(each, AttachedMuscle))
        names = plan.rig.morph_names
        columns = [[names.index(name) for name in each.drive.targets] for each in muscles]
        return MuscleLayer(muscles, tuple(plan.fine.morph_deltas[each] for each in columns)) if muscles else None


def _gained(plan: MeshPlan, vertices: Ints, moves: Floats) -> float:
    """The volume that the skin gains by (vertices, 3) moves of some vertices at rest, cubic scene units."""
    places = plan.fine.rest_positions
    moved = places.copy()
    moved[vertices] += moves
    triangles = plan.fine.triangles[plan.fine.around.faces_of(vertices)]
    # About a point nearby: open meshes have a volume only as far as they move.
    middle = places[vertices].mean(axis=0)
    sums = [np.linalg.det(each[triangles] - middle).sum() / 6.0 for each in (moved, places)]
    return float(sums[0] - sums[1])
