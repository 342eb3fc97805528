"""The effect of one touch: its morph targets, their weights by the slide of the tip, and words about it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.effects.body import BodyWords, body_effect, body_shapes
from wrinklecli.effects.effect import Effect, MeshPlan, Seen
from wrinklecli.effects.touch.attach import FOLDED, AttachedTouch
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant

# Part of the greatest slide below which nobody sees the skin move.
_LEAST = 1e-3


def touch_effect(plan: MeshPlan, attached: AttachedTouch, deltas: Floats, rows: Floats) -> Effect:
    """The effect of a touch with (targets, fine vertices, 3) displacements at weight 1, bind space.

    Its normals are fitted at (rows, targets) weights. Windows of rings that move no vertex have no target.
    """
    drive, shapes = attached.drive, body_shapes(plan, deltas, rows)
    left, places = list(shapes), []
    for place in drive.places:
        first, end = len(drive.slides), len(drive.slides) + len(place.windows)
        places.append(replace(place, windows=place.windows[[shape is not None for shape in left[first:end]]]))
        left = left[end:]
    found = body_effect(attached, shapes, TouchWords(attached, deltas))
    return replace(found, drive=replace(drive, places=tuple(places), targets=found.target_names))


class TouchWords(BodyWords[AttachedTouch]):
    """A touch's words about itself."""

    __slots__ = ()
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

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], *, up: str) -> list[str]:
        """Warnings about skin that folds, and about a touch that never acts."""
        assert up in ("y", "z")
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
