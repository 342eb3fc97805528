"""The effect of one region of flesh: its morph targets, their weights by its springs, and words about it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.effects.body import BodyWords, body_effect, body_shapes
from wrinklecli.effects.effect import Effect, MeshPlan, Seen
from wrinklecli.effects.flesh.attach import AttachedFlesh
from wrinklecli.effects.flesh.report import describe_swing, region_warnings
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant
from wrinklecli.tools.body import Flesh

SECTION = Flesh.section
"""The key of extras and report under which flesh stands."""

# Least error of a region over its limit: float32 stores weights up to 1, and their products with shapes, no better.
_LEAST_ERROR = 1e-6


def flesh_effect(plan: MeshPlan, attached: AttachedFlesh, deltas: Floats, rows: Floats) -> Effect:
    """The effect of a region with (targets, fine vertices, 3) displacements at weight 1, bind space.

    Its normals are fitted at (rows, targets) weights.
    """
    asked = attached.tool.max_error
    bound = None if asked == "auto" else max(asked.resolve(attached.limit), _LEAST_ERROR * attached.limit)
    found = body_effect(SECTION, attached, body_shapes(plan, deltas, rows), FleshWords(attached, deltas))
    return replace(found, max_error=bound)


class FleshWords(BodyWords[AttachedFlesh]):
    """A region's words about itself."""

    __slots__ = ()
    remedy = "`shapes: 3`"

    def values(self, names: Sequence[str]) -> Json:
        """Its joint, its limit, and its springs."""
        attached = self.attached
        return {
            "joint": names[attached.drive.node],
            "limit": significant(attached.limit),
            "elements": len(attached.swings.tissue.fills),
            "frequencies": [significant(each.spring.speed / (2.0 * np.pi), 4) for each in attached.drive.modes],
        }

    def describe_clip(self, seen: Seen) -> Json:
        """The region's entry in a clip: the greatest move, and how long it stands at its limit."""
        return describe_swing(self.attached, seen.motion, seen.reading)

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], *, up: str) -> list[str]:
        """Warnings about clips that hardly say how the region moves."""
        assert up in ("y", "z")
        return region_warnings(self.attached, plan.rig, [(motion.clip, weights) for motion, weights, _ in clips])
