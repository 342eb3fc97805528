"""The effect of one region of flesh: its morph targets, their weights by its springs, and its drive."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.swing import SwingDrive
from wrinklecli.effects.body import BodyEffect
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, targets_of
from wrinklecli.effects.flesh.attach import AttachedFlesh
from wrinklecli.effects.flesh.report import describe_swing, region_warnings
from wrinklecli.errors import counted
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, significant


@dataclass(frozen=True, slots=True)
class FleshEffect(BodyEffect[AttachedFlesh]):
    """One region's morph targets. Its states are the weights of the targets."""

    section: ClassVar[str] = "flesh"
    remedy: ClassVar[str] = "`shapes: 3`"

    @property
    def drive(self) -> SwingDrive:
        """The springs that follow the joint."""
        return self.attached.drive

    @classmethod
    def count_targets(cls, effects: Sequence[Effect]) -> str:
        """Count the regions, and their targets."""
        regions = counted(len(effects), "region of flesh", "regions of flesh")
        return f"{regions} in {counted(len(targets_of(effects)), 'morph target')}"

    @classmethod
    def observe(cls, effects: Sequence[Self], rig: Rig, motion: Motion, times: Floats, _known: Sequence[Any]) -> Any:
        """The weights of each region at all times."""
        return [each.drive.weights_in(rig.own, motion.clip)(times) for each in effects]

    def exact_weights(self, _motion: Motion, _sampled: Floats, _times: Floats, state: Floats) -> Floats:
        """(times, targets) the weights of the drive."""
        return state

    def raised(self, _times: Floats, state: Floats) -> Bools:
        """(times,) True where flesh is out of its place."""
        return np.asarray(state.any(axis=1))

    def telling(self, exact: Floats, _state: Floats) -> set[int]:
        """The times when each target acts most."""
        return set(np.argmax(exact, axis=0).tolist())

    def weight_error(self, played: Floats, exact: Floats, _state: Floats, _clip: Clip) -> float:
        """Largest error of the move that a weight stands for, scene units."""
        sizes = np.array([target.shape.tallest for target in self.targets if target is not None])
        return float((np.abs(played - self.written(exact)) * sizes).max(initial=0.0))

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
