"""Wrinkles on a mesh: the tools attached, then carried by the refined surface."""

from collections.abc import Sequence
from typing import ClassVar

from wrinklecli.character.clip import Clip
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan, Part, SamplingOptions
from wrinklecli.effects.faults import departure_warnings
from wrinklecli.effects.sampling import most_overlaps
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.effects.wrinkle.bounds import bounded
from wrinklecli.effects.wrinkle.carry import CarriedPatch, carry
from wrinklecli.effects.wrinkle.creases import creased
from wrinklecli.effects.wrinkle.demand import demanding
from wrinklecli.effects.wrinkle.effect import SECTION, wrinkle_effect
from wrinklecli.effects.wrinkle.part import WrinklePart
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.warnings import twin_warnings
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.tools.records import ToolsFile, WrinkleTool

# Numbers of each tool that are sampled besides its amplitudes.
_BESIDE = 4


@dataclass(frozen=True, slots=True)
class WrinkleLayer:
    """The wrinkling tools of a mesh.

    Attributes:
        carried_patches: The tools, on the refined surface.
        first: The number of the first tool's patch among the regions of the refinement; the others follow.
    """

    carried_patches: tuple[CarriedPatch, ...]
    first: int = 0

    section: ClassVar[str] = SECTION
    is_solved: ClassVar[bool] = False

    @property
    def parts(self) -> Sequence[WrinklePart]:
        """The tools."""
        return [WrinklePart(each, self.first + number) for number, each in enumerate(self.carried_patches)]

    @property
    def named_clips(self) -> frozenset[str]:
        """The clips in which a tool has a strength of its own."""
        return frozenset(name for each in self.carried_patches for name in each.patch.tool.clips)

    @property
    def projected(self) -> int:
        """The number of vertices that are projected onto patches in each frame."""
        return sum(len(each.vertices) for each in self.carried_patches if each.ring is not None)

    @property
    def sampled_numbers(self) -> int:
        """Amplitudes, distances and lengths."""
        return sum(each.patch.curve.greatest_amplitudes.size + _BESIDE for each in self.carried_patches)

    def target_sizes(self, plan: MeshPlan, clips: Sequence[Clip], frames: int, memory: Memory) -> list[int]:
        """The vertices under each group of bumps, or those of an estimated number of shapes if vertices are projected.

        Raises:
            BakeError: A tool that is projected in each frame would need too many shapes.
            TooMuchError: Its frames would take more memory.
        """
        sizes: list[int] = []
        bound = plan.max_error / most_overlaps(plan)
        for part in self.parts:
            carried = part.carried
            if carried.ring is None:
                sizes += [len(moved) for moved in part.target_vertices]
            elif clips:
                from wrinklecli.effects.wrinkle.forecast import expected_shapes  # few tools are projected

                count = expected_shapes(plan, carried, clips, frames, bound, memory)
                sizes += [len(carried.vertices)] * count
        return sizes

    def effects(
        self, plan: MeshPlan, clips: Sequence[Clip], before: Sequence[Effect], how: SamplingOptions
    ) -> list[Effect]:
        """Make an effect of each tool."""
        numbered = enumerate(self.carried_patches, start=self.first)
        return [*before, *(wrinkle_effect(plan, carried, number, clips, how) for number, carried in numbered)]

    def warnings(self, plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """Tools at one place, and tools under which the refined surface departs from the old one."""
        twins = twin_warnings(self.carried_patches, clips, where=plan.rig.names[plan.rig.node])
        return twins + departure_warnings(plan.fine, self.parts)


class WrinkleKind(EffectKind[WrinkleTool, Patch]):
    """Wrinkling tools."""

    def attach(self, tools: Sequence[WrinkleTool], ground: Ground, settings: ToolsFile) -> Sequence[Patch]:
        """Attach the tools to the surface at rest.

        Raises:
            WrinkleError: Tools do not fit, a line for each.
        """
        return attach_tools(tools, ground.surface, ground.rest, ground.rig, up=settings.up, clips=ground.clips)

    def bound(self, attached: Sequence[Patch], ground: Ground) -> Sequence[Patch]:
        """Let the tools end at hems, seams and creases, and where masks are 0.

        Raises:
            WrinkleError: Masks do not fit, a line for each.
        """
        return bounded(attached, ground)

    def sketch(
        self, attached: Patch, region: int, fine: Refinement, pinned: Bools, _before: Part | None = None
    ) -> WrinklePart:
        """Let a refined surface carry a tool, without a look at creases.

        Raises:
            BakeError: It moves no vertex.
        """
        return WrinklePart(carry(attached, fine, pinned), region)

    def plan(self, plan: MeshPlan, ground: Ground, attached: Sequence[tuple[int, Patch]]) -> WrinkleLayer:
        """Let the refined surface carry the tools.

        Raises:
            BakeError: Tools move no vertex, a line for each.
        """

        def carried(patch: Patch) -> CarriedPatch:
            lowered = creased(carry(patch, plan.fine, ground.contacts.held), plan.fine, plan.rest, plan.rig)
            return demanding(lowered, plan.fine, plan.rig)

        firsts, patches = zip(*attached, strict=True)
        return WrinkleLayer(tuple(BakeError.every(carried, patches)), firsts[0])

    def lines(self, entry: Json) -> list[str]:
        """The lines of a tool, and tables of its bumps and clips."""
        from wrinklecli.effects.wrinkle.lines import lines_of

        return lines_of(entry)


KIND = WrinkleKind()


def carried_patches_of(plan: MeshPlan) -> tuple[CarriedPatch, ...]:
    """The wrinkling tools of a mesh, on its refined surface."""
    wrinkles = plan.layer(WrinkleLayer)
    return wrinkles.carried_patches if wrinkles else ()
