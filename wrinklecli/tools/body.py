"""The records of effects that move the body, as `tools.records` has them of wrinkles: muscles, flesh and touches.

The pages `muscles`, `flesh` and `touch` in `configs` are the reference of the keys.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal, TypeAlias, get_args

from wrinklecli.choices import PROFILES, MaterialName, Profile
from wrinklecli.frozen import dataclass
from wrinklecli.tools.json_schema import (
    FLAG,
    MOST_LENGTH,
    SCENE_LENGTH,
    TEXT,
    Schema,
    clip_keys,
    either,
    expects,
    key,
    list_of,
    number,
    one_of,
    percentage,
    schema_of,
    slider,
    whole,
)
from wrinklecli.tools.materials import PLAIN_HEIGHT, preset
from wrinklecli.tools.records import (
    ANCHOR,
    DAMPING,
    DAMPING_RATIO,
    END,
    FREQUENCY,
    LENGTH,
    MASK,
    MAX_POINTS,
    MAX_SEED,
    SECONDS,
    SWINGS,
    TIP,
    EffectTool,
    JointPoint,
    Length,
    Marker,
    Mask,
    Point,
    Position,
    length_or,
)

# Nothing below the skin is longer than the muscle, or the region, itself.
_SLIDES = slider(1, 100, 0.5, "%")
_LENGTH = {**LENGTH, **_SLIDES}
AUTO_LENGTH = length_or("auto", slides=_SLIDES)

THICKNESS = 0.95
"""Thickness of a belly over the distance from bone to skin: a bent elbow raises 8 to 14 mm on people, and changes the
outline of an arm then; at 0.5 it hardly does."""

TENDONS = "40%"
"""Tendons over a muscle's length: the belly of a biceps fills six tenths of its way from shoulder to radius."""


@dataclass(frozen=True, slots=True)
class ActivationKeys:
    """Activations keyed by hand in some clips; a muscle is relaxed in all others.

    Attributes:
        keys: Each clip's keys: seconds, ascending, and the activation at that time, 0 to 1.
    """

    keys: Mapping[str, tuple[tuple[float, float], ...]] = key(
        clip_keys("[seconds, activation]", SECONDS, number(0, 1), row="[seconds, activation from 0 to 1]", low=1),
        "For each clip a list of [seconds, activation], times rising.",
        hashed=False,
    )


@dataclass(frozen=True, slots=True)
class ActivationMorph:
    """An activation that is the weight of a morph target, held within 0 and 1."""

    morph: str = key(TEXT, "Name of the morph target.")


Activation: TypeAlias = ActivationKeys | ActivationMorph


@dataclass(frozen=True, slots=True, kw_only=True)
class Muscle(EffectTool):
    """One muscle; mirrored ones are muscles of their own.

    Attributes:
        origin: The end that hardly moves: world space at rest, Y-up, scene units; or a marker, or a joint with an
            offset. `insertion`, the end on the bone that the muscle turns, is alike.
        activation: None for a muscle that its length alone thickens.
    """

    section: ClassVar[str] = "muscles"
    words: ClassVar[tuple[str, str]] = ("muscle", "muscles")
    meaning: ClassVar[str] = "Muscles below the skin, which thicken as they shorten."
    point_keys: ClassVar[tuple[str, ...]] = ("origin", "insertion")

    origin: Point = key(
        END,
        "Where the muscle begins, below the skin: world space at rest in scene units, {marker: NODE}, or {joint: NODE, "
        "offset: [x, y, z]}.",
    )
    insertion: Point = key(END, "Where it ends, as a rule just beyond the joint that it bends. Written as `origin`.")
    thickness: Literal["auto"] | Length = key(
        AUTO_LENGTH,
        "Thickness of the belly at rest: a length or a percentage of the way from bone to skin. Default auto: 95 %.",
        "auto",
        group="Shape",
    )
    tendon: Length = key(
        _LENGTH,
        "Length of both tendons, which do not shorten: a length or a percentage. Default 40%, as of a biceps.",
        TENDONS,
    )
    width: Literal["auto"] | Length = key(
        AUTO_LENGTH,
        "Width over which the skin follows, around the limb: a length or a percentage. Default auto: from the limb's "
        "own thickness.",
        "auto",
    )
    activation: Activation | None = key(
        either(
            schema_of(ActivationKeys),
            either(
                schema_of(ActivationMorph),
                expects("{keys: {CLIP: [[SECONDS, ACTIVATION], …]}}, {morph: NAME} or none", enum=["none", None]),
                "morph",
            ),
            "keys",
        ),
        "Tension that thickens the muscle while its length stays: {keys: …} by hand, {morph: …} by a morph target. "
        "Default none.",
        None,
        group="Motion",
    )
    travel: bool = key(
        FLAG,
        "The belly moves along as the muscle shortens; false takes two morph targets in place of four. Default true.",
        True,
    )

    @property
    def named_clips(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """The clips that key the activation, with the paths of their keys."""
        keyed = self.activation.keys if isinstance(self.activation, ActivationKeys) else {}
        return [(name, ("activation", "keys", name)) for name in keyed]


_BALL: Schema = {"required": ["at", "radius"]}


@dataclass(frozen=True, slots=True, kw_only=True)
class Flesh(EffectTool):
    """One region of flesh; mirrored ones are regions of their own.

    Attributes:
        at: Its middle: world space at rest, Y-up, scene units; or a marker. None for a region that a mask or a joint
            outlines.
        gravity: The share of gravity, 0 to 1.
        carrier: If it is one of `meshes` that moves with the region, the number of the region's own node.
    """

    section: ClassVar[str] = "flesh"
    words: ClassVar[tuple[str, str]] = ("region of flesh", "regions of flesh")
    meaning: ClassVar[str] = "Regions of flesh, which swing after the joint that carries them."
    point_keys: ClassVar[tuple[str, ...]] = ("at",)
    # A region is a ball, or what a mask or a joint outlines.
    keywords: ClassVar[Schema] = {
        "if": {"anyOf": [{"required": ["at"]}, {"required": ["radius"]}]},
        "then": _BALL,
        "else": {"if": {"not": {"anyOf": [{"required": ["mask"]}, {"required": ["joint"]}]}}, "then": _BALL},
    }

    at: Position | Marker | None = key(
        ANCHOR, "Middle of the region, on the skin: world space at rest in scene units, or {marker: NODE}.", absent=None
    )
    radius: float | None = key(
        SCENE_LENGTH,
        "Length in scene units from the middle over which flesh swings; it fades to the border.",
        absent=None,
    )
    joint: str | None = key(
        {**TEXT, "type": ["string", "null"]},
        "Joint that carries the region; without `at`, the region is the skin that follows it. Default: the joint of "
        "most weight at the middle.",
        None,
    )
    mask: Mask | None = key(
        MASK,
        "Softness of the skin at each place, 0 to 1: {attribute: _FLESH} of vertices, or {image: FILE, channel: r}. "
        "Without `at`, it outlines the region. Default none.",
        None,
    )
    meshes: tuple[str, ...] = key(
        list_of(TEXT, 0, None, "a list of node names"),
        "Nodes whose meshes lie over the region and move with it, as clothes do. Default [].",
        [],
        read=lambda value: tuple(dict.fromkeys(value)),
    )
    frequency: float = key(
        {**number(0.5, 20), **SWINGS},
        "Swings per second without damping: 2 is soft, 6 is firm. Default 4.",
        4.0,
        group="Motion",
    )
    damping: float = key(
        {**number(0.05, 2), **DAMPING}, "From 1 on flesh does not swing back. Default 0.3.", 0.3
    )  # fmt: skip
    shapes: int = key(
        expects("3, 6 or 9", enum=[3, 6, 9]),
        "The number of shapes in which it swings; it takes one morph target more. 3 is stylised, 6 is right to some "
        "per cent. Default 6.",
        6,
    )
    limit: Length = key(
        _LENGTH,
        "About how far skin moves at most, towards which flesh gets stiffer: a length, or a percentage of the radius. "
        "Default 12%.",
        "12%",
    )
    gravity: float = key(
        percentage(100, 100),
        "Share of gravity that pulls where the body turns; the rest pose has its own already. Default 30%.",
        "30%",
    )
    max_error: Literal["auto"] | Length = key(
        AUTO_LENGTH,
        "How far its swing in the file may be off: a length, or a percentage of `limit`. Default auto: --max-error, as "
        "for all else on its mesh.",
        "auto",
    )
    carrier: int | None = None

    DRIVING: ClassVar[tuple[str, ...]] = ("frequency", "damping", "gravity")
    """The keys that change the weights of a region alone, not its shapes."""


@dataclass(frozen=True, slots=True)
class Release:
    """A damped spring by which the skin comes back once a tip lets go; damping is the ratio ζ, 1 is critical."""

    frequency: float = key(FREQUENCY, "Swings per second of the skin without damping. Default 4.", 4.0)
    damping: float = key(
        DAMPING_RATIO, "Below 1 the skin swings past its place, from 1 on it does not. Default 0.7.", 0.7
    )


LIFTED = 1.5
"""Height of rings over that of a tool's wrinkles of the same stuff: a tip lifts skin off what is below it."""

_SUBSTANCES = get_args(MaterialName)
_PROFILES = tuple(each for each in PROFILES if each != "polyline")


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchWrinkles:
    """The rings of wrinkles round a touch.

    Attributes:
        bump_height: Highest point of a ring relative to its width, from the material's.
    """

    bumps: int = key(whole(1, 16), "Rings from the pad's edge outwards. Default 5.", 5)
    length: Length = key(
        LENGTH,
        "From the pad's edge to the last ring's: a length or a percentage of the reach. Default 150%.",
        "150%",
    )
    directions: int = key(
        expects("1, 6, 8, 12 or 16", enum=[1, 6, 8, 12, 16]),
        "1: rings for the main direction of the keys alone, in one morph target; more: for slides in any direction, in "
        "as many. Default 8.",
        8,
    )
    material: MaterialName | None = key(
        one_of(*_SUBSTANCES, "none", none=True),
        "Substance, which gives profile, variation, height and `compressible`. Default skin.",
        "skin",
    )
    profile: Profile | None = key(
        {**one_of(*_PROFILES, none=True)}, f"Shape of a ring: {', '.join(_PROFILES)}. Default: the material's.", None
    )
    variation: float | None = key(
        {**number(0, 1), "type": ["number", "null"]},
        "0 even circles, 1 most irregular. Default: the material's.",
        None,
    )
    seed: int | None = key(
        {**whole(0, MAX_SEED), "type": ["integer", "null"]}, "Seed of the irregularity. Default: from the name.", None
    )

    @property
    def shape(self) -> Profile:
        """The profile, its own or the material's."""
        given: Profile = preset(self.material).keys["profile"] if self.material else "smooth"
        return self.profile or given

    @property
    def amount(self) -> float:
        """The variation, its own or the material's."""
        given = preset(self.material).keys["variation"] if self.material else 0.0
        return float(given if self.variation is None else self.variation)

    @property
    def bump_height(self) -> float:
        """Highest point of a ring relative to its width."""
        return LIFTED * (preset(self.material).bump_height if self.material else PLAIN_HEIGHT)


_OFFSET = number(-MOST_LENGTH, MOST_LENGTH, "a length")


@dataclass(frozen=True, slots=True, kw_only=True)
class Touch(EffectTool):
    """One place where a tip slides the skin; mirrored ones are places of their own.

    Attributes:
        at: Its middle: world space at rest, Y-up, scene units; or a marker. `towards` is alike.
        along: Further points of its path; none for one place.
        towards: A point in whose direction slides count as forward; None for the direction of the limb.
        by: The tip; None if it is keyed alone.
        wrinkles: None for a slide without rings.
        keys: Each clip's keys: seconds, ascending, the slide forward and sideways, and the tip's depth.
    """

    section: ClassVar[str] = "touches"
    words: ClassVar[tuple[str, str]] = ("touch", "touches")
    meaning: ClassVar[str] = "Places where a tip slides the skin, which wrinkles in front of it."
    point_keys: ClassVar[tuple[str, ...]] = ("at", "towards")
    # Forward is along a path, and keys slide one place.
    keywords: ClassVar[Schema] = {
        "if": {"required": ["along"]},
        "then": {"properties": dict.fromkeys(("towards", "keys"), expects("none beside along", **{"not": {}}))},
    }

    at: Position | Marker = key(
        ANCHOR, "Middle of the place, on the skin: world space at rest in scene units, or {marker: NODE}."
    )
    towards: Position | Marker | None = key(
        ANCHOR,
        "Slides towards this point count as forward. Default: along the limb, away from the body.",
        absent=None,
    )
    along: tuple[Position | Marker, ...] = key(
        list_of(ANCHOR, 1, MAX_POINTS, f"a list of 1 to {MAX_POINTS} points, each [x, y, z] or {{marker: NODE}}"),
        "Further points of the path along which the tip strokes the skin; forward is along it. Default: none, so that "
        "the place is fixed.",
        absent=(),
    )
    mask: Mask | None = key(
        MASK,
        "Softness of the skin at each place, from 0, where it does not slide, to 1: {attribute: _SKIN} of "
        "vertices, or {image: FILE, channel: r}. Default none.",
        None,
    )
    pad: float = key(SCENE_LENGTH, "Radius of the tip, scene units.", group="Shape")
    reach: Length = key(
        {**LENGTH, **slider(100, 300, 0.5, "%")},
        "Length over which the slide fades beyond the pad: a length or a percentage of the pad. Default 110%.",
        "110%",
    )
    grip: Length = key(
        _LENGTH,
        "Greatest slide, beyond which the tip slips: a length or a percentage of the pad. Default 60%.",
        "60%",
    )
    press: Length = key(
        _LENGTH,
        "Distance from the skin below which a node touches it, and depth of the dent at most: a length or a percentage "
        "of the pad. Default 20%.",
        "20%",
    )
    wrinkles: TouchWrinkles | None = key(
        either(schema_of(TouchWrinkles), expects("a mapping or none", enum=["none", None])),
        "The rings of wrinkles in front of the tip; none for a slide alone.",
        {},
    )
    release: Release = key(
        schema_of(Release),
        "The spring by which the skin comes back when the tip lets go.",
        {"frequency": 4, "damping": 0.7},
        group="Motion",
    )
    by: JointPoint | None = key(
        TIP,
        "Node whose motion in the clips slides the skin while it is near: a fingertip, a prop, or {joint: NODE, "
        "offset: [x, y, z]}.",
        absent=None,
    )
    keys: Mapping[str, tuple[tuple[float, ...], ...]] = key(
        clip_keys(
            "[seconds, forward, sideways, depth]",
            SECONDS,
            _OFFSET,
            _OFFSET,
            number(0, MOST_LENGTH, "a depth"),
            row="[seconds, forward, sideways] or [seconds, forward, sideways, depth]",
            optional=1,
        ),
        "For each clip a list of [seconds, forward, sideways, depth]: slide of the skin and depth of the tip, scene "
        "units, times rising. After the last key the tip lets go.",
        {},
        hashed=False,
    )

    @property
    def points(self) -> tuple[Point, ...]:
        """The middle, and the point that is forward, those of the path and the tip if there are such."""
        return tuple(each for each in (self.at, self.towards, *self.along, self.by) if each is not None)

    def place_of(self, number: int, *keys: str) -> str:
        """The place of a point in the file."""
        path = [("along", str(each)) for each in range(len(self.along))]
        there = [("at",), *([] if self.towards is None else [("towards",)]), *path, ("by",)]
        return self.places.get((*there[number], *keys), self.place(*there[number]))

    @property
    def named_clips(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """The clips that key the touch, with the paths of their keys."""
        return [(name, ("keys", name)) for name in self.keys]
