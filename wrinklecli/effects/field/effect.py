"""The effect of a field: its morph targets, their weights by the turns of joints, and words about it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wrinklecli.character.pose import Pose
from wrinklecli.drive.turned import TurnDrive
from wrinklecli.effects.body import BodyWords, body_effect, largest_moves, moves_at_rest
from wrinklecli.effects.effect import Effect, MeshPlan, Remixes, Seen, driven_targets
from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.effects.field.factors import weights_of
from wrinklecli.effects.shapes import Middles, Sample, make_shapes, summed
from wrinklecli.errors import listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, distinct_values, significant
from wrinklecli.tools.fields import Field

SECTION = Field.section
"""The key of extras and report under which fields stand."""


def field_effect(plan: MeshPlan, attached: AttachedField, deltas: Floats, middles: Middles) -> Effect:
    """The effect of a field with (targets, fine vertices, 3) displacements at weight 1, bind space."""
    vertices, moves = moves_at_rest(plan.fine.blended, deltas)
    sweeps, factors = attached.sweeps, attached.factors
    weights = weights_of(sweeps, factors.tables)
    # Normals are right where each shape has its greatest weight, where each turn is farthest, and in mixtures.
    rows = distinct_values(np.concatenate([np.argmax(weights, axis=0), sweeps.ends, np.flatnonzero(sweeps.owners < 0)]))
    morphs = plan.rest.morph_weights
    shapes = make_shapes(
        plan.fine,
        vertices,
        deltas[:, vertices],
        tallest=np.sqrt(np.sum(moves**2, axis=2)).max(axis=1, initial=0.0),
        samples=[Sample(weights[row], Pose(sweeps.matrices[row], morphs)) for row in rows.tolist()]
        if plan.has_normals
        else [],
        middles=middles,
    )
    words = FieldWords(attached, deltas, moves)
    return replace(body_effect(attached, shapes, words), remixes=words, add_up=True)


@dataclass(frozen=True, slots=True)
class FieldWords(BodyWords[AttachedField], Remixes):
    """A field's words about itself, and its other targets for engines.

    Attributes:
        moves: (targets, moved vertices, 3) displacements at weight 1 in world space at rest.
    """

    moves: Floats
    remedy: ClassVar[str] = "fewer `joints`"

    def with_unit_weights(self, effect: Effect) -> Effect:
        """The same motion with weights in [0, 1]: strengths above 1 are in the shapes."""
        drive = effect.drive
        assert isinstance(drive, TurnDrive)
        most = max(1.0, drive.strength, *drive.strengths.values())
        if most == 1.0:
            return effect
        targets = tuple(replace(each, shape=summed([each.shape], np.array([most]))) for each in effect.targets)
        return replace(effect, targets=targets, drive=drive.weaker(most))

    def with_at_most(self, effect: Effect, most: int) -> Effect:
        """Its main shapes alone: those that fold most."""
        attached, drive = self.attached, effect.drive
        assert isinstance(drive, TurnDrive)
        if len(effect.targets) <= most:
            return effect
        factors, kept = attached.factors.fewer(attached.sweeps, most)
        played = drive.of_targets(np.isin(np.arange(len(effect.targets)), kept))
        targets = driven_targets(played.targets, [effect.targets[k].shape for k in kept.tolist()])
        words = FieldWords(replace(attached, factors=factors, drive=played), self.deltas[kept], self.moves[kept])
        return replace(effect, targets=targets, drive=played, words=words, remixes=words)

    def values(self, names: Sequence[str]) -> Json:
        """Its folds, the joints that turn it, and how far tables of their angles are off."""
        attached, factors = self.attached, self.attached.factors
        return {
            "material": attached.tool.material,
            "wavelength": significant(attached.wavelength),
            "height_limit": significant(attached.greatest_height),
            "turns": [
                {
                    "joint": names[signal.node],
                    "degrees": [round(float(np.degrees(end)), 1) for end in (table.rows[0], table.rows[-1])],
                    "shapes": int(table.table.any(axis=0).sum()),
                }
                for signal, table in attached.drive.turns
            ],
            "error": significant(factors.error, 4),
            "least_error": significant(factors.best, 4),
        }

    def describe_clip(self, seen: Seen) -> Json:
        """The field's entry in a clip: the largest move of the surface, scene units, and its time."""
        heights = largest_moves(seen.weights, self.moves)
        most = int(np.argmax(heights))
        return {
            "name": self.name,
            "height": significant(float(heights[most]), 4),
            "time": significant(float(seen.motion.times[most]), 4),
        }

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], _up: str) -> list[str]:
        """Warnings about a field that nothing moves, and about joints for which it has no shapes."""
        attached, found = self.attached, []
        name, names = self.name, plan.rig.names
        if clips and not any(each.weights.any() for each in clips):
            found.append(f"{name}: no clip turns its joints: it stays flat")
        shown = {signal.node for signal, _ in attached.drive.turns}
        turned = [attached.sweeps.turns[number].signal.node for number in attached.factors.left_out]
        absent = [names[node] for node in dict.fromkeys(turned) if node not in shown]
        if absent:
            found.append(
                f"{name}: {listed(absent)} fold it too, but there is room for {len(attached.factors.shapes)} shapes:"
                " those of the joints that fold it most, or of the `joints` that are named"
            )
        return found
