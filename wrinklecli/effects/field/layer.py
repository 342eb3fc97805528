"""Fields on a mesh: measured in poses at rest, then carried by the refined surface."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.body import BodyLayer, BodyPart, moves_at_rest
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan, Part
from wrinklecli.effects.field.attach import AttachedField, attach_fields
from wrinklecli.effects.field.carry import Displacements, displaced
from wrinklecli.effects.field.effect import SECTION, FieldWords, field_effect
from wrinklecli.effects.shapes import LEAST_SHARE, Middles
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, greatest_coordinates
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.tools.fields import Field
from wrinklecli.tools.records import ToolsFile

# Part of its height that a field has at its tallest place below which others cover it: it is lower all over then.
_LITTLE = 0.5


@dataclass(frozen=True, slots=True)
class FieldLayer(BodyLayer[AttachedField]):
    """The fields of a mesh.

    Attributes:
        middles: Those of the edges of each.
        remaining: The greatest height of each over that without tools and earlier fields.
    """

    middles: tuple[Middles, ...] = ()
    remaining: tuple[float, ...] = ()

    section: ClassVar[str] = SECTION

    @classmethod
    def of(
        cls, plan: MeshPlan, numbered: Iterable[tuple[int, AttachedField]], ground: Ground | None = None
    ) -> "FieldLayer":
        """Let the refined surface carry them, each with the number of its region, and look at them on the mesh."""
        free, regions, found = _free(plan), list[int](), list[tuple[AttachedField, Displacements]]()
        for number, each in numbered:
            regions.append(number)
            found.append(_carried(each, plan.fine, free, ground))
            free = free * (1.0 - found[-1][1].shares)
        return cls(
            tuple(attached for attached, _ in found),
            tuple(regions),
            tuple(made.deltas for _, made in found),
            tuple(made.middles for _, made in found),
            tuple(made.remaining for _, made in found),
        )

    @property
    def named_clips(self) -> frozenset[str]:
        """The clips in which a field has a strength of its own."""
        return frozenset(name for each in self.attached for name in each.tool.clips)

    @property
    def sampled_numbers(self) -> int:
        """Weights, and of each turn seven numbers and its parts of the weights."""
        both = zip(self.deltas, self.attached, strict=True)
        return sum(len(own) + len(each.drive.turns) * (7 + len(own)) for own, each in both)

    def words(self, plan: MeshPlan, attached: AttachedField, deltas: Floats) -> FieldWords:
        """The words of one of them about itself."""
        return FieldWords(attached, deltas, moves_at_rest(plan.fine.blended, deltas)[1])

    def effect(self, plan: MeshPlan, attached: AttachedField, deltas: Floats) -> Effect:
        """The effect of one field."""
        return field_effect(plan, attached, deltas, self.middles[self.attached.index(attached)])

    def warnings(self, _plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """A line if there is no clip, for each texture that cannot be read, and for each field under others."""
        names = ", ".join(each.tool.name for each in self.attached)
        found = [f"{each.tool.name}: {note}" for each in self.attached for note in each.notes]
        found += [
            f"{each.tool.name}: tools and fields before it leave {100 * part:.2g} % of its height at most"
            for each, part in zip(self.attached, self.remaining, strict=False)
            if part < _LITTLE
        ]
        ways = "bake clips of other files (--anim), add folds to them (`wrinkle track`), or use a driver"
        return found if clips else [*found, f"{names}: there is no clip, so nothing folds yet: {ways}"]


def _carried(
    attached: AttachedField, fine: Refinement, free: Floats, ground: Ground | None = None
) -> tuple[AttachedField, Displacements]:
    """A field as `displaced` gives it, and with these shapes: those that move something, such as no level crease."""
    made = displaced(attached, fine, free, ground)
    lengths = greatest_coordinates(made.deltas).max(axis=1)
    # A field that is level everywhere keeps all of them.
    moving = lengths >= LEAST_SHARE * lengths.max()
    factors, drive = attached.factors.some(np.flatnonzero(moving)), attached.drive.of_targets(moving)
    middles = replace(made.middles, deltas=made.middles.deltas[moving])
    return replace(attached, factors=factors, drive=drive), replace(made, deltas=made.deltas[moving], middles=middles)


def _free(plan: MeshPlan) -> Floats:
    """(fine vertices,) what tools before fields leave to these: a tool is by hand, so a field fades under it."""
    found = np.ones(len(plan.fine.positions))
    for part in (each for each in plan.parts if each.attached.moves is None):
        found[part.vertices] *= 1.0 - part.shares
    return found


class FieldKind(EffectKind[Field, AttachedField]):
    """Fields."""

    def attach(self, tools: Sequence[Field], ground: Ground, _settings: ToolsFile) -> Sequence[AttachedField]:
        """Measure the fields on the surface at rest, and find their shapes.

        Raises:
            WrinkleError: Fields do not fit, a line for each.
        """
        return attach_fields(tools, ground)

    def plan(self, plan: MeshPlan, ground: Ground, attached: Sequence[tuple[int, AttachedField]]) -> FieldLayer:
        """Let the refined surface carry the fields."""
        return FieldLayer.of(plan, attached, ground)

    def driven_by(self, attached: AttachedField, tool: Field) -> AttachedField:
        """The field with the strengths of another entry."""
        drive = replace(attached.drive, strengths=dict(tool.clips), strength=tool.strength)
        return replace(attached, tool=tool, drive=drive)

    def sketch(
        self, attached: AttachedField, region: int, fine: Refinement, _pinned: Bools, before: Part | None = None
    ) -> Part | None:
        """Let a refined surface carry a field, as if no tool were there; other strengths have the same shapes.

        It is not lowered where it is at fault.
        """
        old = before.attached if before is not None else None
        if isinstance(before, BodyPart) and isinstance(old, AttachedField) and old.region is attached.region:
            return replace(before, attached=self.driven_by(old, attached.tool))
        carried, made = _carried(attached, fine, np.ones(len(fine.positions)))
        layer = FieldLayer((carried,), (region,), (made.deltas,), (made.middles,))
        (part,) = layer.parts
        return part

    def lines(self, entry: Json) -> list[str]:
        """The lines of a field, a table of its joints, and one of its clips."""
        width = max(len(each["joint"]) for each in entry["turns"])
        clips = max((len(each["name"]) for each in entry["clips"]), default=0)
        return [
            f"folds    {entry['wavelength']:.4g} from crest to crest, up to {entry['height_limit']:.3g} high",
            *(
                f"{'' if number else 'turns':7}  {each['joint']:{width}}  {each['degrees'][0]:g} to"
                f" {each['degrees'][1]:g}°, {counted(each['shapes'], 'shape')}"
                for number, each in enumerate(entry["turns"])
            ),
            f"error    {100 * entry['error']:.3g} % of the heights; the best weights leave"
            f" {100 * entry['least_error']:.3g} %",
            f"mesh     {entry['moved_vertices']} vertices move",
            *(
                f"{each['name']:{clips}}  "
                + (f"folds by up to {each['height']:.3g}, at {each['time']:.4g} s" if each["height"] else "stays flat")
                for each in entry["clips"]
            ),
        ]


KIND = FieldKind()
