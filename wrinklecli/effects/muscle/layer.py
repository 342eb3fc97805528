"""Muscles on a mesh: attached to bones, then carried by the refined surface."""

from collections.abc import Sequence
from typing import ClassVar

from wrinklecli.character.clip import Clip
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.effects.body import BodyLayer
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan
from wrinklecli.effects.muscle.attach import AttachedMuscle, attach_muscles
from wrinklecli.effects.muscle.effect import MuscleWords, muscle_effect, muscle_words
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Muscle
from wrinklecli.tools.records import ToolsFile


@dataclass(frozen=True, slots=True)
class MuscleLayer(BodyLayer[AttachedMuscle]):
    """The muscles of a mesh."""

    section: ClassVar[str] = Muscle.section

    @property
    def sampled_numbers(self) -> int:
        """Weights, a distance and a rest length of each muscle."""
        return sum(len(each) + 2 for each in self.deltas)

    def words(self, plan: MeshPlan, attached: AttachedMuscle, deltas: Floats) -> MuscleWords:
        """The words of one of them about itself."""
        return muscle_words(plan, attached, deltas)

    def effect(self, plan: MeshPlan, attached: AttachedMuscle, deltas: Floats) -> Effect:
        """The effect of one muscle."""
        return muscle_effect(plan, attached, deltas)

    def warnings(self, _plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """A line if there is no clip; with clips, each muscle speaks for itself."""
        names = ", ".join(each.tool.name for each in self.attached if not each.idle)
        if clips or not names:
            return []
        return [f"{names}: there is no clip that moves the body: muscles swell only in a player with a driver"]


class MuscleKind(EffectKind[Muscle, AttachedMuscle]):
    """Muscles."""

    def attach(self, tools: Sequence[Muscle], ground: Ground, settings: ToolsFile) -> Sequence[AttachedMuscle]:
        """Attach the muscles to the rig and the surface at rest.

        Raises:
            WrinkleError: Muscles do not fit, a line for each.
        """
        names = MeshNames.of(ground.document)
        muscles = [each for each in settings.effects if isinstance(each, Muscle)]
        swelling = {ground.rig.names[node] for tool in muscles for node in names.called(tool.node or "")}
        return attach_muscles(tools, ground, swelling)

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, AttachedMuscle]]) -> MuscleLayer:
        """Let the refined surface carry the muscles."""
        return MuscleLayer.of(plan, attached)

    def lines(self, entry: Json) -> list[str]:
        """The lines of a muscle, and a table of its clips."""
        table = [
            (
                each["name"],
                *(f"{100 * end:.3g}" for end in each["length"]),
                f"{each['bulge'][1]:.3g}",
                each["volume_gained"],
            )
            for each in entry["clips"]
        ]
        width = max((len(name) for name, *_ in table), default=0)
        return [
            f"ends     {entry['origin']} to {entry['insertion']}, along {entry['bone']}",
            f"length   {entry['length']:.4g} at rest, of which tendons {entry['tendons']:.4g}",
            f"belly    {entry['thickness']:.4g} thick, {entry['width']:.4g} wide,"
            f" {entry['depth']:.4g} from the bone to the skin",
            f"mesh     {entry['moved_vertices']} vertices move, by at most {entry['height_limit']:.3g}",
            *(
                f"{name:{width}}  {low} to {high} % long, bulges by up to {bulge}, skin gains {volume:.3g} of volume"
                for name, low, high, bulge, volume in table
            ),
        ]


KIND = MuscleKind()
