"""The effect of one region of flesh: its morph targets, their weights by its springs, and its drive."""

from collections.abc import Sequence
from typing import Any, ClassVar, Self

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.drive.swing import SwingDrive
from wrinklecli.effects.body import BodyEffect
from wrinklecli.effects.effect import MeshPlan, Motion
from wrinklecli.effects.flesh.attach import AttachedFlesh
from wrinklecli.effects.flesh.report import describe_swing, region_warnings
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant

# Least error of a region over its limit: float32 stores weights up to 1, and their products with shapes, no better.
_LEAST_ERROR = 1e-6


@dataclass(frozen=True, slots=True)
class FleshEffect(BodyEffect[AttachedFlesh]):
    """One region's morph targets. Its states are the weights of the targets."""

    section: ClassVar[str] = "flesh"
    remedy: ClassVar[str] = "`shapes: 3`"

    @property
    def drive(self) -> SwingDrive:
        """The springs that follow the joint."""
        return self.attached.drive

    @property
    def max_error(self) -> float | None:
        """The error that the tools file allows this region; None if it says nothing."""
        asked = self.attached.tool.max_error
        return None if asked == "auto" else max(asked.resolve(self.attached.limit), _LEAST_ERROR * self.attached.limit)

    @classmethod
    def observe(cls, effects: Sequence[Self], rig: Rig, motion: Motion, times: Floats, _known: Sequence[Any]) -> Any:
        """The weights of each at all times; the joints of all are posed once."""
        rows: dict[int, Floats] = {}
        return [each.drive.weights_at(rig.own, motion.clip, times, rows) for each in effects]

    def describe(self, plan: MeshPlan) -> Json:
        """The region's entry in the report; lengths are scene units."""
        attached, tissue = self.attached, self.attached.swings.tissue
        return {
            "name": self.name,
            "where": attached.tool.where,
            "node": plan.rig.names[plan.rig.node],
            "joint": plan.rig.names[self.drive.node],
            "limit": significant(attached.limit),
            "elements": len(tissue.fills),
            "frequencies": [significant(each.spring.speed / (2.0 * np.pi), 4) for each in self.drive.modes],
            "moved_vertices": int(np.any(self.deltas, axis=(0, 2)).sum()),
            "targets": list(self.target_names),
        }

    def describe_clip(self, motion: Motion, state: Floats) -> Json | None:
        """The region's entry in a clip: the greatest move, and how far the cap has reduced it."""
        return describe_swing(self.attached, motion, state)

    def warnings(self, plan: MeshPlan, motions: Sequence[tuple[Motion, Any, Floats]], *, up: str) -> list[str]:
        """Warnings about clips that hardly say how the region moves."""
        assert up in ("y", "z")
        return region_warnings(self.attached, plan.rig, [(motion.clip, state) for motion, state, _ in motions])
