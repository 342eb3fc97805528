"""Touches on a mesh: attached to the skin, then carried by the refined surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.body import BodyLayer, body_targets
from wrinklecli.effects.effect import Attached, MeshPlan
from wrinklecli.effects.touch.attach import AttachedTouch, attach_touches, touches_of
from wrinklecli.effects.touch.effect import TouchEffect
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.records import EffectTool, ToolsFile

# Slides over the greatest at which normals are fitted, in as many directions.
_FITTED, _DIRECTIONS = (0.4, 0.8), 8
# Sine of the bend at which the normals of its changes are fitted.
_BENT = 0.7


@dataclass(frozen=True, slots=True)
class TouchLayer(BodyLayer[AttachedTouch]):
    """The touches of a mesh."""

    section: ClassVar[str] = TouchEffect.section

    @property
    def keyed_clips(self) -> frozenset[str]:
        """The clips that key a touch, or in which a node touches."""
        return frozenset(clip for each in self.attached for clip in (*each.drive.keys, *each.drive.ends))

    @property
    def sampled_numbers(self) -> int:
        """Weights, as states too."""
        return sum(2 * len(each) for each in self.deltas)

    def _effect(self, plan: MeshPlan, attached: AttachedTouch, deltas: Floats) -> TouchEffect:
        """The effect of one touch."""
        drive = attached.drive
        angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
        if len(drive.windows) == 1:
            angles = drive.windows
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        # Slides without a dent and a dent without a slide, so that none of them gets the normals of the others.
        slid = np.concatenate([part * drive.grip * np.pad(ways, ((0, 0), (0, 1))) for part in _FITTED])
        dented = slid + np.array([0.0, 0.0, _FITTED[-1] * drive.deepest])
        rows = drive.weights(np.concatenate([slid, dented, [[0.0, 0.0, drive.deepest]]]))
        if drive.limb is not None:
            bent = slid[-len(ways) :]
            rows = np.concatenate([rows, *(drive.weights(bent, np.full(len(bent), bend)) for bend in (-_BENT, _BENT))])
        identifier = attached.tool.identifier
        return TouchEffect(identifier, body_targets(plan, identifier, deltas, rows), attached, deltas)

    def warnings(self, _plan: MeshPlan, _clips: Sequence[Clip]) -> list[str]:
        """Nothing: each touch speaks for itself."""
        return []


class TouchKind:
    """Touches."""

    def attach(self, tools: Sequence[EffectTool], ground: Ground, settings: ToolsFile) -> Sequence[Attached]:
        """Attach the touches to the surface at rest, and solve the slide of its skin.

        Raises:
            WrinkleError: Touches do not fit, a line for each.
        """
        own = touches_of(tools)
        return attach_touches(own, ground, settings) if own else []

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, Attached]]) -> TouchLayer | None:
        """Let the refined surface carry the touches."""
        return TouchLayer.of(plan, [each for _, each in attached if isinstance(each, AttachedTouch)])
