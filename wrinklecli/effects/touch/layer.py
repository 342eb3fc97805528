"""Touches on a mesh: attached to the skin, then carried by the refined surface."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.body import BodyLayer
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan
from wrinklecli.effects.touch.attach import FOLDED, AttachedTouch, attach_touches
from wrinklecli.effects.touch.effect import TouchWords, touch_effect
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Touch
from wrinklecli.tools.records import ToolsFile

# Slides over the greatest at which normals are fitted, in as many directions.
_FITTED, _DIRECTIONS = (0.4, 0.8), 8
# Sine of the bend at which the normals of its changes are fitted.
_BENT = 0.7


@dataclass(frozen=True, slots=True)
class TouchLayer(BodyLayer[AttachedTouch]):
    """The touches of a mesh."""

    section: ClassVar[str] = Touch.section

    @property
    def sampled_numbers(self) -> int:
        """Weights, as states too."""
        return sum(2 * len(each) for each in self.deltas)

    def words(self, _plan: MeshPlan, attached: AttachedTouch, deltas: Floats) -> TouchWords:
        """The words of one of them about itself."""
        return TouchWords(attached, deltas)

    def effect(self, plan: MeshPlan, attached: AttachedTouch, deltas: Floats) -> Effect:
        """The effect of one touch."""
        drive = attached.drive
        angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
        if len(drive.places[0].windows) == 1:
            angles = drive.places[0].windows
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        # Slides without a dent and a dent without a slide, so that none of them gets the normals of the others.
        slid = np.concatenate([part * drive.grip * np.pad(ways, ((0, 0), (0, 1))) for part in _FITTED])
        dented = slid + np.array([0.0, 0.0, _FITTED[-1] * drive.deepest])
        contacts = np.concatenate([slid, dented, [[0.0, 0.0, drive.deepest]]])
        if len(drive.places) > 1:
            # At each place, and where two share the weights.
            at = np.linspace(0.0, drive.length, 2 * len(drive.places) - 1)
            ahead = np.pad(slid, ((0, 0), (0, 1)))
            contacts = np.concatenate([ahead + np.array([0.0, 0.0, 0.0, along]) for along in at])
        rows = drive.weights_of_contacts(contacts)
        if drive.limb is not None:
            bent = slid[-len(ways) :]
            rows = np.concatenate(
                [rows, *(drive.weights_of_contacts(bent, np.full(len(bent), bend)) for bend in (-_BENT, _BENT))]
            )
        return touch_effect(plan, attached, deltas, rows)

    def warnings(self, _plan: MeshPlan, _clips: Sequence[Clip]) -> list[str]:
        """Nothing: each touch speaks for itself."""
        return []


class TouchKind(EffectKind[Touch, AttachedTouch]):
    """Touches."""

    def attach(self, tools: Sequence[Touch], ground: Ground, settings: ToolsFile) -> Sequence[AttachedTouch]:
        """Attach the touches to the surface at rest, and solve the slide of its skin.

        Raises:
            WrinkleError: Touches do not fit, a line for each.
        """
        return attach_touches(tools, ground, settings)

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, AttachedTouch]]) -> TouchLayer:
        """Let the refined surface carry the touches."""
        return TouchLayer.of(plan, attached)

    def lines(self, entry: Json) -> list[str]:
        """The lines of a touch, and a table of its clips."""
        width = max((len(each["name"]) for each in entry["clips"]), default=0)
        rings = [f"{each:.3g}" for each in entry.get("ring_heights", ())]
        return [
            f"joints   {', '.join(entry['joints'])}",
            f"slide    up to {entry['grip']:.3g}, with a strain of {entry['strain']:.2f}; below {FOLDED} it looks"
            " folded",
            *(
                [f"rings    {', '.join(rings)} high from the pad outwards, {counted(entry['directions'], 'direction')}"]
                if rings
                else []
            ),
            f"mesh     {entry['moved_vertices']} vertices move",
            *(
                f"{each['name']:{width}}  from {each['times'][0]:.4g} to {each['times'][1]:.4g} s: slides by up to"
                f" {each['largest_slide']:.3g}, strain {each['strain']:.2f}"
                + (f", rings {each['height']:.3g} high" if rings else "")
                + (f", dented by {each['depth']:.3g}" if each["depth"] else "")
                + (
                    f"; slips, as {each['asked_slide']:.3g} is asked"
                    if each["asked_slide"] > each["largest_slide"]
                    else ""
                )
                for each in entry["clips"]
            ),
        ]


KIND = TouchKind()
