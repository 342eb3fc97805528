"""Touches on a mesh: attached at rest, carried by the refined surface, with the effect and the words of each."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from wrinklecli.effects.body import BodyLayer, BodyWords, body_effect, body_shapes
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan, Seen
from wrinklecli.effects.touch.attach import FOLDED, AttachedTouch, attach_touch
from wrinklecli.errors import BakeError, counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Touch
from wrinklecli.tools.records import ToolsFile

# Slides over the greatest at which normals are fitted, in as many directions.
_FITTED, _DIRECTIONS = (0.4, 0.8), 8
# Sine of the bend at which the normals of its changes are fitted.
_BENT = 0.7

# Part of the greatest slide below which nobody sees the skin move.
_LEAST = 1e-3


class TouchWords(BodyWords[AttachedTouch]):
    """A touch's words about itself."""

    remedy = "`directions: 1`"

    def values(self, names: Sequence[str]) -> Json:
        """Its tips, the skin that it drags, and its rings."""
        attached, rings = self.attached, self.attached.rings
        ringed: Json = {}
        if rings is not None:
            ringed = {
                "ring_heights": [significant(each, 4) for each in (rings.amplitudes * rings.profile.peak).tolist()],
                "ring_shares": [significant(each, 4) for each in rings.shares.tolist()],
                "compressible": significant(rings.compressible, 4),
                "directions": len(rings.angles),
            }
        return {
            "joints": [names[node] for node in sorted(attached.drive.nodes)],
            "pad": significant(attached.drive.pad),
            "reach": significant(attached.places[0].place.reach),
            "grip": significant(attached.drive.grip),
            "strain": significant(attached.strain, 4),
            **ringed,
            **({"places": len(attached.places)} if len(attached.places) > 1 else {}),
        }

    def describe_clip(self, seen: Seen) -> Json | None:
        """The touch's entry in a clip: when it acts, its largest slide, and its strain; None if it does not."""
        drive, rings, motion, state = self.attached.drive, self.attached.rings, seen.motion, seen.reading
        slides, depths = drive.contact_of(state)
        keys = drive.keys.get(motion.clip.name, np.zeros((0, 4)))
        acting = np.flatnonzero((slides > _LEAST * drive.grip) | (depths > 0))
        if not len(acting):
            return None
        largest = float(slides.max())
        tallest = 0.0
        if rings is not None:
            tallest = rings.tallest * float(np.interp(largest / drive.grip, *rings.rises.T))
        return {
            "name": self.name,
            "times": [significant(float(motion.times[end]), 4) for end in (acting[0], acting[-1])],
            "largest_slide": significant(largest, 4),
            "asked_slide": significant(max(largest, float(np.hypot(*keys[:, 1:3].T).max(initial=0.0))), 4),
            "strain": significant(self.attached.strain * largest / drive.grip, 4),
            "height": significant(tallest, 4),
            "depth": significant(float(depths.max()), 4),
        }

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], _up: str) -> list[str]:
        """Warnings about skin that folds, and about a touch that never acts."""
        warnings, drive = [], self.attached.drive
        if self.attached.strain < FOLDED:
            grip = drive.grip
            warnings.append(
                f"{self.name}: at its grip of {grip:.4g} the strain of the skin is {self.attached.strain:.2f};"
                f" below {FOLDED} it looks folded: up to {grip * FOLDED / self.attached.strain:.3g} it looks well"
            )
        if clips and not any(weights.any() for _, _, weights in clips):
            why = "no clip keys it: only a driver in the player moves the skin there"
            by = self.attached.tool.by
            if by is not None:
                tips = [drive.tip_in(plan.rig.own, each.clip, each.times) for each, _, _ in clips]
                found = np.concatenate(tips)
                beside, heights = drive.away(found), np.abs(found[:, 2])
                away, inside = np.hypot(beside - drive.pad, heights), beside < drive.pad
                nearest = float(np.where(inside, heights, away).min())
                why = (
                    f"{by.joint!r} comes no nearer to the place than {nearest:.3g}, and touches it below"
                    f" {drive.deepest:.3g} (`press`); `offset` puts a tip where its joint is not"
                )
            warnings.append(f"{self.name}: {why}")
        return warnings


@dataclass(frozen=True, slots=True)
class TouchLayer(BodyLayer[AttachedTouch]):
    """The touches of a mesh."""

    section: ClassVar[str] = Touch.section

    def words(self, _plan: MeshPlan, attached: AttachedTouch, deltas: Floats) -> TouchWords:
        """The words of one of them about itself."""
        return TouchWords(attached, deltas)

    def effect(self, plan: MeshPlan, attached: AttachedTouch, deltas: Floats) -> Effect:
        """The effect of one touch; windows of rings that move no vertex have no target."""
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
        return body_effect(attached, body_shapes(plan, deltas, rows), TouchWords(attached, deltas))


class TouchKind(EffectKind[Touch, AttachedTouch]):
    """Touches."""

    def attach(self, tools: Sequence[Touch], ground: Ground, settings: ToolsFile) -> Sequence[AttachedTouch]:
        """Attach the touches to the surface at rest, and solve the slide of its skin.

        Raises:
            WrinkleError: Touches do not fit, a line for each.
        """
        return BakeError.every(lambda tool: attach_touch(tool, ground, settings), tools)

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
