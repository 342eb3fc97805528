"""Wrinkles on a mesh: tools attached at rest and carried by the refined surface, and what may be asked of each."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.segment import Lengths
from wrinklecli.effects.below import losses_below
from wrinklecli.effects.effect import Effect, EffectKind, Layer, MeshPlan, Part, SamplingOptions, Seen
from wrinklecli.effects.faults import departure_warnings
from wrinklecli.effects.sampling import most_overlaps
from wrinklecli.effects.wrinkle.activity import Activity, ClipActivity, curve_drive
from wrinklecli.effects.wrinkle.attach import attach_tools, bounded
from wrinklecli.effects.wrinkle.carry import CarriedPatch, carry, displacements
from wrinklecli.effects.wrinkle.creases import creased, faded
from wrinklecli.effects.wrinkle.demand import demanding
from wrinklecli.effects.wrinkle.effect import SECTION, WrinkleWords, wrinkle_effect
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.report import describe_heights, describe_place
from wrinklecli.effects.wrinkle.warnings import twin_warnings
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.tools.records import ToolsFile, WrinkleTool

# Numbers of each tool that are sampled besides its amplitudes.
_BESIDE = 4

# Points of a control curve that is drawn at a moment; and of one for each interval, doubled by each level of details.
_CURVE_POINTS, _POINTS = 200, 32


@dataclass(frozen=True, slots=True)
class WrinklePart:
    """A tool on the refined surface; `region` is the number of its patch among the regions of the refinement."""

    carried: CarriedPatch
    region: int

    @property
    def attached(self) -> Patch:
        """Its patch."""
        return self.carried.patch

    @property
    def vertices(self) -> Ints:
        """(vertices,) the vertices that it moves."""
        return self.carried.vertices

    @property
    def target_vertices(self) -> list[Ints]:
        """For each target the vertices under its bumps."""
        curve, us = self.attached.curve, self.us[:, None]
        under = (us >= curve.bumps.starts) & (us < curve.bumps.ends)
        of_groups = [self.vertices[under[:, list(bumps)].any(axis=1)] for bumps in curve.groups]
        return [vertices for vertices in of_groups for _ in range(curve.greatest_amplitudes.shape[1])]

    @property
    def shares(self) -> Floats:
        """(vertices,) the parts of the curve's height that they get, over the greatest."""
        magnitudes = np.abs(self.carried.magnitudes)
        return np.asarray(magnitudes / magnitudes.max())

    @property
    def us(self) -> Floats:
        """(vertices,) their places along the control curve."""
        return self.carried.us

    @property
    def drive(self) -> Drive:
        """Its segment and filter, with the table of its control curve; `attachment: patch` has them too."""
        return curve_drive(self.attached)

    def sizes(self, _fine: Refinement) -> Floats:
        """(amplitudes,) the greatest height for each."""
        return np.full(self.attached.curve.greatest_amplitudes.size, self.attached.greatest_height)

    def numbers(self, _clip: Clip | None, reading: Lengths) -> Floats:
        """(frames, numbers) what `Activity` has at each time."""
        seen = Activity.of(self.attached, reading)
        beside = seen.distances, seen.rest_lengths, seen.shortenings, seen.unabsorbed
        return np.column_stack([*beside, seen.amplitudes.reshape(len(seen.distances), -1)])

    def strengths(self, seen: Seen) -> Floats:
        """(frames,) shortenings over the rest length, without what the tissue takes."""
        found = Activity.of(self.attached, seen.reading)
        return np.asarray(found.shortenings / found.rest_lengths)

    def _seen(self, numbers: Floats) -> Activity:
        """The activity that (frames, numbers) are."""
        distances, rest_lengths, shortenings, unabsorbed = numbers[:, :4].T
        amplitudes = numbers[:, 4:].reshape(len(numbers), *self.attached.curve.greatest_amplitudes.shape)
        return Activity(distances, rest_lengths, shortenings, unabsorbed, amplitudes)

    def displacements(
        self, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, numbers: Floats | None = None
    ) -> Floats:
        """(frames, vertices, 3) the method's displacements, bind space."""
        amplitudes = None if numbers is None else self._seen(numbers).amplitudes
        return displacements(self.carried, fine, rig, clip, times, amplitudes)

    def heights(self, _fine: Refinement, clip: Clip | None, numbers: Floats) -> Floats:
        """(frames,) the height of the control curve's highest bump."""
        patch = self.attached
        strength = abs(patch.clip_strength(clip) * patch.shape_strength)
        heights = patch.curve.heights(self._seen(numbers).amplitudes)
        return np.asarray(strength * heights.reshape(len(numbers), -1).max(axis=1))

    def cut(self, clip: Clip | None, numbers: Floats) -> Floats:
        """(points, 2) the control curve."""
        patch, seen, us = self.attached, self._seen(numbers), np.linspace(0.0, 1.0, _CURVE_POINTS)
        strength, distance = patch.clip_strength(clip) * patch.shape_strength, float(seen.distances[0])
        heights = strength * np.einsum("gm,gmv->v", seen.amplitudes[0], patch.curve.shapes(us))
        return np.stack([us * (distance if np.isfinite(distance) else 0.0), heights], axis=1)

    def facts(self, plan: MeshPlan, up: str) -> Json:
        """The entry of `check` for it."""
        return describe_place(plan, self.carried, self.region, up)

    def facts_in(self, _plan: MeshPlan, seen: Seen) -> Json:
        """The entry of `check` for it in a clip."""
        found = Activity.of(self.attached, seen.reading)
        return describe_heights(self.carried, ClipActivity(seen.motion.clip, seen.motion.times, found))

    def cuts(self, shortenings: Floats) -> tuple[Floats, Floats]:
        """(cuts, points) of the control curve."""
        curve = self.attached.curve
        lengths = np.full(len(shortenings), curve.rest_length)
        distances = (1.0 - shortenings) * lengths
        amplitudes, _ = curve.follow(distances, lengths)
        us = np.linspace(0.0, 1.0, _POINTS * 2 ** len(curve.details) * curve.interval_count + 1)
        heights = self.attached.shape_strength * np.einsum("fgm,gmu->fu", amplitudes, curve.shapes(us))
        return distances[:, None] * us, heights

    def words(self, plan: MeshPlan) -> WrinkleWords:
        """Its words about itself."""
        return WrinkleWords(self.carried, self.region, plan.rig)


@dataclass(frozen=True, slots=True)
class WrinkleLayer(Layer):
    """The wrinkling tools of a mesh.

    Attributes:
        carried_patches: The tools, on the refined surface.
        first: The number of the first tool's patch among the regions of the refinement; the others follow.
    """

    carried_patches: tuple[CarriedPatch, ...]
    first: int = 0

    section: ClassVar[str] = SECTION

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
                from wrinklecli.effects.wrinkle.projected import expected_shapes  # few tools are projected

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
        twins = twin_warnings(self.carried_patches, clips, where=plan.rig.node_name)
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
            return demanding(_below_layers(lowered, ground, plan.fine), plan.fine, plan.rig)

        firsts, patches = zip(*attached, strict=True)
        return WrinkleLayer(tuple(BakeError.every(carried, patches)), firsts[0])

    def lines(self, entry: Json) -> list[str]:
        """The lines of a tool, and tables of its bumps and clips."""
        from wrinklecli.effects.wrinkle.lines import lines_of

        return lines_of(entry)


def _below_layers(carried: CarriedPatch, ground: Ground, fine: Refinement) -> CarriedPatch:
    """Lower the wrinkles of a tool where they would come through a layer over the mesh."""
    patch, vertices = carried.patch, carried.vertices
    ignored = patch.tool.contact.ignore if patch.tool.contact else ()
    losses = losses_below(ground, fine, vertices, patch.curve.greatest_height * carried.magnitudes, ignored)
    if not losses.any():
        return carried
    return faded(carried, losses, np.stack(patch.coordinates(fine.rest_positions[vertices]), axis=1))


KIND = WrinkleKind()


def carried_patches_of(plan: MeshPlan) -> tuple[CarriedPatch, ...]:
    """The wrinkling tools of a mesh, on its refined surface."""
    wrinkles = plan.layer(WrinkleLayer)
    return wrinkles.carried_patches if wrinkles else ()
