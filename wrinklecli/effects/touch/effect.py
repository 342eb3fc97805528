"""The effect of one touch: its morph targets, their weights by the slide of the tip, and its drive."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.effects.body import BodyEffect
from wrinklecli.effects.effect import MeshPlan, Motion
from wrinklecli.effects.touch.attach import FOLDED, AttachedTouch
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant

# Part of the greatest slide below which nobody sees the skin move.
_LEAST = 1e-3


@dataclass(frozen=True, slots=True)
class TouchEffect(BodyEffect[AttachedTouch]):
    """One touch's morph targets. Its states are the weights of the targets."""

    section: ClassVar[str] = "touches"
    remedy: ClassVar[str] = "`directions: 1`"

    @property
    def drive(self) -> TouchDrive:
        """The slide of the tip, and the targets that are written."""
        drive, columns = self.attached.drive, self.columns
        rings = columns[columns >= TouchDrive.slides] - TouchDrive.slides
        return replace(drive, windows=drive.windows[rings[rings < len(drive.windows)]], targets=self.target_names)

    def stored_weights(self, _rig: Rig) -> Floats:
        """(targets,) zeros: nothing touches the stored pose."""
        return np.zeros(len(self.target_names))

    def describe(self, plan: MeshPlan) -> Json:
        """The touch's entry in the report; lengths are scene units."""
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
            "name": self.name,
            "where": attached.tool.where,
            "node": plan.rig.names[plan.rig.node],
            "joints": [plan.rig.names[node] for node in sorted(attached.drive.nodes)],
            "pad": significant(attached.place.pad),
            "reach": significant(attached.place.reach),
            "grip": significant(attached.drive.grip),
            "strain": significant(attached.strain, 4),
            **ringed,
            "moved_vertices": int(np.any(self.deltas, axis=(0, 2)).sum()),
            "targets": list(self.target_names),
        }

    def describe_clip(self, motion: Motion, state: Floats) -> Json | None:
        """The touch's entry in a clip: when it acts, its largest slide, and its strain; None if it does not."""
        drive, rings = self.attached.drive, self.attached.rings
        slides = drive.grip * np.sqrt((state[:, :4] ** 2).sum(axis=1))
        depths = drive.deepest * state[:, 4]
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

    def warnings(self, plan: MeshPlan, motions: Sequence[tuple[Motion, Any, Floats]], *, up: str) -> list[str]:
        """Warnings about skin that folds, and about a touch that never acts."""
        assert up in ("y", "z")
        warnings = []
        if self.attached.strain < FOLDED:
            grip = self.attached.drive.grip
            warnings.append(
                f"{self.name}: at its grip of {grip:.4g} the strain of the skin is {self.attached.strain:.2f};"
                f" below {FOLDED} it looks folded: up to {grip * FOLDED / self.attached.strain:.3g} it looks well"
            )
        if motions and not any(weights.any() for _, _, weights in motions):
            why = "no clip keys it: only a driver in the player moves the skin there"
            by = self.attached.tool.by
            if by is not None:
                tips = [self.drive.tip_in(plan.rig.own, each.clip, each.times) for each, _, _ in motions]
                away = np.concatenate([np.hypot(np.hypot(*t[:, :2].T) - self.drive.pad, t[:, 2]) for t in tips])
                inside = np.concatenate([np.hypot(*t[:, :2].T) < self.drive.pad for t in tips])
                heights = np.abs(np.concatenate([t[:, 2] for t in tips]))
                nearest = float(np.where(inside, heights, away).min())
                why = (
                    f"{by.joint!r} comes no nearer to the place than {nearest:.3g}, and touches it below"
                    f" {self.drive.deepest:.3g} (`press`); `offset` puts a tip where its joint is not"
                )
            warnings.append(f"{self.name}: {why}")
        return warnings
