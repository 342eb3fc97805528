"""Flesh on a mesh: regions attached to joints, then carried by the refined surface, and words about them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.drive.swing import nonnegative
from wrinklecli.effects.body import BodyLayer, BodyWords, body_effect, body_shapes
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan, Seen
from wrinklecli.effects.flesh.attach import AttachedFlesh, attach_flesh, in_place, moves_of
from wrinklecli.errors import listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Flesh
from wrinklecli.tools.records import ToolsFile

# Part of the limit to which a mode is raised where normals are fitted: flesh is seldom further out of its place.
_FITTED = 0.6
# Least error of a region over its limit: float32 stores weights up to 1, and their products with shapes, no better.
_LEAST_ERROR = 1e-6


class FleshWords(BodyWords[AttachedFlesh]):
    """A region's words about itself."""

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
        """The region's entry in a clip: its greatest move and the seconds at its limit."""
        moves = moves_of(seen.reading)
        # At its limit a load, of which |n|⁴ does not act, would move it at least twice as far without.
        held = moves**4 > 0.5
        seconds = float((np.diff(seen.motion.times) * (held[1:] & held[:-1])).sum())
        return {
            "name": self.name,
            "largest_move": significant(self.attached.limit * float(moves.max(initial=0.0)), 4),
            "seconds_at_limit": significant(seconds, 4),
        }

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], _up: str) -> list[str]:
        """Warnings about clips that hardly say how the region moves."""
        return self.attached.clip_warnings(plan.rig, [(motion.clip, weights) for motion, weights, _ in clips])


@dataclass(frozen=True, slots=True)
class FleshLayer(BodyLayer[AttachedFlesh]):
    """The regions of flesh of a mesh."""

    section: ClassVar[str] = Flesh.section

    def words(self, _plan: MeshPlan, attached: AttachedFlesh, deltas: Floats) -> FleshWords:
        """The words of one of them about itself."""
        return FleshWords(attached, deltas)

    def effect(self, plan: MeshPlan, attached: AttachedFlesh, deltas: Floats) -> Effect:
        """The effect of one region, whose normals are fitted where its modes are raised, one at a time."""
        modes, asked = np.eye(len(attached.drive.modes)), attached.tool.max_error
        rows = nonnegative(_FITTED * np.concatenate([modes, -modes]))
        shapes, words = body_shapes(plan, deltas, rows), FleshWords(attached, deltas)
        bound = None if asked == "auto" else max(asked.resolve(attached.limit), _LEAST_ERROR * attached.limit)
        return replace(body_effect(attached, shapes, words), max_error=bound)

    def warnings(self, plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """A line if there is no clip, or if clips are in place; the region's own mesh says it for meshes over it."""
        names = ", ".join(each.tool.name for each in self.attached if each.tool.carrier is None)
        if not names:
            return []
        if not clips:
            return [f"{names}: there is no clip: flesh swings only in a player with a driver"]
        staying = [clip.name for clip in clips if in_place(plan.rig, clip)]
        if not staying:
            return []
        are = "is" if len(staying) == 1 else "are"
        return [
            f"{names}: {listed(staying)} {are} in place: a body that walks or runs on the spot lacks the motion of its"
            " root, which only a player adds, and a driver in the player follows; or export it with root motion"
        ]


class FleshKind(EffectKind[Flesh, AttachedFlesh]):
    """Flesh."""

    def attach(self, tools: Sequence[Flesh], ground: Ground, settings: ToolsFile) -> Sequence[AttachedFlesh]:
        """Attach the regions to joints and the surface at rest, and solve them.

        Raises:
            WrinkleError: Regions do not fit, a line for each.
        """
        return attach_flesh(tools, ground, settings)

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, AttachedFlesh]]) -> FleshLayer:
        """Let the refined surface carry the regions."""
        return FleshLayer.of(plan, attached)

    def lines(self, entry: Json) -> list[str]:
        """The lines of a region of flesh, and a table of its clips."""
        width = max((len(each["name"]) for each in entry["clips"]), default=0)
        hertz = ", ".join(f"{each:.3g}" for each in entry["frequencies"])
        return [
            f"joint    {entry['joint']}",
            f"springs  {hertz} Hz, of {entry['elements']:,} elements",
            f"mesh     {entry['moved_vertices']} vertices move, by about {entry['limit']:.3g} at most",
            *(
                f"{each['name']:{width}}  moves by up to {each['largest_move']:.3g}"
                + (f", {each['seconds_at_limit']:.2g} s at the limit" if each["seconds_at_limit"] else "")
                for each in entry["clips"]
            ),
        ]


KIND = FleshKind()
