"""Flesh on a mesh: regions attached to joints, then carried by the refined surface."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.drive.swing import nonnegative
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.body import BodyLayer
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan
from wrinklecli.effects.flesh.attach import AttachedFlesh, attach_flesh
from wrinklecli.effects.flesh.effect import SECTION, FleshWords, flesh_effect
from wrinklecli.effects.flesh.report import in_place
from wrinklecli.errors import listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.records import EffectTool, ToolsFile

# Part of the limit to which a mode is raised where normals are fitted: flesh is seldom further out of its place.
_FITTED = 0.6


@dataclass(frozen=True, slots=True)
class FleshLayer(BodyLayer[AttachedFlesh]):
    """The regions of flesh of a mesh."""

    section: ClassVar[str] = SECTION

    @property
    def sampled_numbers(self) -> int:
        """Weights, as states too."""
        return sum(2 * len(each) for each in self.deltas)

    def words(self, _plan: MeshPlan, attached: AttachedFlesh, deltas: Floats) -> FleshWords:
        """The words of one of them about itself."""
        return FleshWords(attached, deltas)

    def effect(self, plan: MeshPlan, attached: AttachedFlesh, deltas: Floats) -> Effect:
        """The effect of one region."""
        modes = np.eye(len(attached.drive.modes))
        return flesh_effect(plan, attached, deltas, nonnegative(_FITTED * np.concatenate([modes, -modes])))

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


class FleshKind(EffectKind):
    """Flesh."""

    def attach(self, tools: Sequence[EffectTool], ground: Ground, settings: ToolsFile) -> Sequence[AnyAttached]:
        """Attach the regions to joints and the surface at rest, and solve them.

        Raises:
            WrinkleError: Regions do not fit, a line for each.
        """
        return attach_flesh(tools, ground, settings)

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, AnyAttached]]) -> FleshLayer:
        """Let the refined surface carry the regions."""
        return FleshLayer.of(plan, [(number, each) for number, each in attached if isinstance(each, AttachedFlesh)])

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
