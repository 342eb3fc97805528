"""The contents of a file of wrinkling tools, as frozen records whose fields are its keys: ranges, meanings, defaults.

`schema` makes the JSON Schema of these fields and `read` the records. `configs/README.md` is the reference of the keys.
"""

import math
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, field, is_dataclass, replace
from typing import Any, ClassVar, Literal, Self, TypeAlias, get_args

from wrinklecli.choices import (
    CHANNELS,
    EFFECTS,
    FPS,
    MAX_COMPRESSIBLE,
    MAX_LEVELS,
    PARTS,
    PROFILES,
    Attachment,
    Attenuation,
    Axis,
    Channel,
    Creases,
    LaidPose,
    Profile,
    RestPose,
    Scheme,
    Snap,
    Stops,
    Strategy,
    Up,
)
from wrinklecli.frozen import dataclass
from wrinklecli.tools.json_schema import (
    FLAG,
    LEAST_LENGTH,
    MOST_LENGTH,
    TEXT,
    ListReader,
    Schema,
    any_keys,
    clip_keys,
    default_of,
    defaults_of,
    either,
    expects,
    key,
    key_fields,
    key_of,
    keys_of,
    list_of,
    mapping_of,
    number,
    one_of,
    percentage,
    reader_of,
    readers_of,
    schema_of,
    slider,
    whole,
)
from wrinklecli.tools.materials import PLAIN_HEIGHT, Preset, presets, presets_of, with_material

Position: TypeAlias = tuple[float, float, float]

MAX_DETAILS = 4  # levels; a fifth is a 32nd of a bump, finer than any mesh here
MAX_POINTS = 64  # of a path
MAX_SEED = 2**31 - 1  # what any language's whole numbers hold
MAX_TEXCOORD = 7  # sets of texture coordinates are numbered from 0; importers read eight at most

SECONDS = number(0, 1e6, "seconds")
_RATIO = number(0, 1, step=0.01)
FREQUENCY = number(0.5, 60)
DAMPING_RATIO = number(0.05, 10)
SWINGS = slider(0.5, 20, 0.1, "Hz")  # from soft tissue to flesh so firm that nobody sees it swing
DAMPING = slider(0.05, 2, 0.01)  # from jelly to twice the ratio from which on nothing swings
_STRENGTH = {**number(-100, 100), **slider(-2, 2, 0.05)}
_MATERIALS = f"{', '.join(presets())} or none"


@dataclass(frozen=True, slots=True)
class Length:
    """A length in scene units, or per cent of the tool's own rest distance.

    Attributes:
        value: Scene units, or 80.0 for `80%`.
        percent: True if `value` is a percentage.
    """

    value: float
    percent: bool = False

    def resolve(self, rest_distance: float) -> float:
        """Scene units, given the distance of the tool's anchors at rest in scene units."""
        return self.value / 100.0 * rest_distance if self.percent else self.value


ONE_PERCENT = Length(1.0, percent=True)


def parse_length(value: float | str) -> Length:
    """A length as people write it: 0.02, `0.02` or `80%`.

    Raises:
        ValueError: It is no finite length above 0.
    """
    percent = isinstance(value, str) and value.endswith("%")
    found = float(value.removesuffix("%") if isinstance(value, str) else value)
    if not 0 < found < math.inf:
        raise ValueError(f"{value!r} is no length above 0")
    return Length(found, percent=percent)


def read_length(value: float | str | None) -> Length | Literal["auto"] | None:
    """A length, or the word in its place: auto, or none."""
    if value is None or value in ("auto", "none"):
        return "auto" if value == "auto" else None
    return parse_length(value)


LENGTHS = "a length from 1e-9 to 1e9 scene units or a percentage from 0.01% to 10000%"
LENGTH = expects(
    LENGTHS,
    type=["number", "string"],
    minimum=LEAST_LENGTH,
    maximum=MOST_LENGTH,
    maxLength=40,
    pattern=r"^\+?0*([1-9][0-9]{0,3}(\.[0-9]*)?|10000(\.0*)?|\.(0?[1-9])[0-9]*) ?%$",
    **slider(1, 300, 0.5, "%"),
    read=parse_length,
)


def length_or(*words: str | None, slides: Schema) -> Schema:
    """A length on such a slider, or one of these words."""
    accepted = ", ".join([*filter(None, words), LENGTHS])
    return expects(accepted, anyOf=[{"enum": [*words]}, {**LENGTH, **slides}], read=read_length)


@dataclass(frozen=True, slots=True)
class Marker:
    """An anchor at the position of a node of the asset, such as an exported empty."""

    marker: str = key(TEXT, "Node whose position at rest is the anchor.")


def read_anchor(value: Any) -> Position | Marker:
    """An anchor of a tools file, in the file's axes."""
    if isinstance(value, dict):
        return Marker(**value)
    x, y, z = map(float, value)
    return (x, y, z)


def _coordinates(accepted: str, *types: str, **keywords: Any) -> Schema:
    """Three numbers, or other values of some types."""
    coordinate = number(-MOST_LENGTH, MOST_LENGTH)
    return expects(
        accepted, type=["array", *types], items=coordinate, minItems=3, maxItems=3, read=read_anchor, **keywords
    )


@dataclass(frozen=True, slots=True)
class JointPoint:
    """A point that a joint carries: the joint's position at rest, with an offset in the axes of the file."""

    joint: str = key(TEXT, "Joint, or any node, that carries the point.")
    offset: Position = key(
        _coordinates("[x, y, z]"),
        "From the joint's position at rest, in the axes of this file, scene units. Default [0, 0, 0].",
        [0.0, 0.0, 0.0],
    )


Point: TypeAlias = Position | Marker | JointPoint

# Keywords for items hold for lists alone, keywords for properties for mappings alone, so both stand side by side.
_MARKED = {name: each for name, each in schema_of(Marker).items() if name not in ("type", "read")}
ANCHOR = _coordinates("[x, y, z] or {marker: NODE}", "object", **_MARKED)
END = either(
    schema_of(JointPoint),
    _coordinates("[x, y, z], {marker: NODE} or {joint: NODE, offset: [x, y, z]}", "object", **_MARKED),
    "joint",
)
"""A point below the skin, which needs no surface near it."""
TIP = either(
    schema_of(JointPoint),
    expects("the name of a node, or {joint: NODE, offset: [x, y, z]}", type="string", minLength=1, read=JointPoint),
)
"""A point that a node carries: by the node's name, or with an offset."""


@dataclass(frozen=True, slots=True)
class RestFrame:
    """A clip's pose at a time, taken as the rest pose, or as the one in which a tool is laid."""

    clip: str = key(TEXT, "Name of the clip.")
    time: float = key(SECONDS, "Seconds from the clip's start. Default 0.", 0.0)


@dataclass(frozen=True, slots=True)
class Sampling:
    """The times at which clips are evaluated."""

    fps: float = key(number(0.1, 1000), "Samples per second, joined with the clip's own key times. Default 30.", FPS)
    clips: Literal["all"] | tuple[str, ...] = key(
        either(
            {
                **list_of(TEXT, 1, None, "all or a list of clip names"),
                "allOf": [expects("each clip named once", uniqueItems=True)],
            },
            expects("all or a list of clip names", enum=["all"]),
        ),
        "Clips to bake: all, or a list of names. Default all.",
        "all",
    )


@dataclass(frozen=True, slots=True)
class RefinementSettings:
    """The subdivision of the mesh under the wrinkles; in a draft, `edges_per_interval` may be a fraction."""

    max_levels: int = key(whole(0, MAX_LEVELS), "How often an edge is halved at most; 0 keeps the mesh. Default 4.", 4)
    edges_per_interval: float = key(
        whole(1, 16), "Edges on each control interval, half a bump; more is smoother. Default 2.", 2
    )
    scheme: Scheme = key(
        one_of(*get_args(Scheme)),
        "butterfly rounds a little, midpoint keeps the shape, butterfly_full rounds all. Default butterfly.",
        "butterfly",
    )


@dataclass(frozen=True, slots=True)
class RestLengthKeys:
    """Rest lengths keyed by hand, the paper's forehead; other clips keep the rest distance.

    Attributes:
        keys: Each clip's keys: seconds, ascending, and the length at that time.
    """

    keys: Mapping[str, tuple[tuple[float, Length], ...]] = key(
        clip_keys("[seconds, length]", SECONDS, LENGTH, low=1),
        "For each clip a list of [seconds, length], times rising.",
        hashed=False,
    )


@dataclass(frozen=True, slots=True)
class RestLengthMorph:
    """A rest length driven by a morph target's weight: the rest distance at 0, `full` at 1."""

    morph: str = key(TEXT, "Name of the morph target.")
    full: Length = key(LENGTH, "Rest length at weight 1: a length or a percentage.")


RestLength: TypeAlias = Literal["auto"] | Length | RestLengthKeys | RestLengthMorph


@dataclass(frozen=True, slots=True)
class Lag:
    """A damped spring, by which heights follow the shortening late; damping is the ratio ζ, 1 is critical."""

    frequency: float = key({**FREQUENCY, **SWINGS}, "Swings per second of the tissue without damping. Default 6.", 6.0)
    damping: float = key(
        {**DAMPING_RATIO, **DAMPING}, "Below 1 heights overshoot and swing, from 1 on they do not. Default 0.5.", 0.5
    )


@dataclass(frozen=True, slots=True)
class Contact:
    """Settings of folds that touch and must not cross."""

    per_clip: bool = key(
        FLAG,
        "false: no clip changes the targets, and a clip may still cross. Default true.",
        True,
    )
    ignore: tuple[str, ...] = key(
        list_of(TEXT, 0, None, "a list of node names"),
        "Nodes whose meshes may go through the tool's. Default [].",
        [],
    )


def contact_word(accepted: str, **keywords: Any) -> Schema:
    """Words for contact as a file asks for it; None for none."""
    return expects(accepted, **keywords, read=lambda value: Contact() if value == "resolve" else None)


CONTACT_WORDS = ("off", "resolve", False)  # to YAML 1.1, which is read, off is false
CONTACT = either(
    schema_of(Contact), contact_word("off, resolve or {per_clip: false, ignore: []}", enum=[*CONTACT_WORDS])
)


@dataclass(frozen=True, slots=True)
class MaskAttribute:
    """A factor on the height of a tool, painted on the vertices of its mesh."""

    attribute: str = key(
        expects(
            "COLOR_0 or _NAME, with .r, .g, .b or .a for another component than the first",
            type="string",
            maxLength=200,
            pattern=r"^(COLOR_[0-9]+|_[^.]+)(\.[rgba])?$",
        ),
        "Vertex attribute of the mesh, such as _WRINKLE or COLOR_0.r.",
    )

    @property
    def name(self) -> str:
        """The attribute without its component."""
        return self.attribute.partition(".")[0]

    @property
    def component(self) -> int:
        """The number of the component."""
        return CHANNELS.index(self.attribute.partition(".")[2] or "r")


@dataclass(frozen=True, slots=True)
class MaskImage:
    """A factor on the height of a tool, painted in an image.

    Attributes:
        folder: The folder of the tools file.
    """

    image: str = key(TEXT, "PNG, JPEG or WebP image; its path is relative to the folder of this file.")
    channel: Channel = key(one_of(*CHANNELS), "Channel of the image. Default r.", "r")
    texcoord: int = key(whole(0, MAX_TEXCOORD), "Set of texture coordinates in which the image lies. Default 0.", 0)
    folder: str = ""

    @property
    def path(self) -> str:
        """The path of the image, as the tools file was typed."""
        return os.path.join(self.folder, self.image)


Mask: TypeAlias = MaskAttribute | MaskImage


MASK = either(
    schema_of(MaskImage),
    either(
        schema_of(MaskAttribute),
        expects("{attribute: NAME}, {image: FILE, channel: r, texcoord: 0} or none", enum=["none", None]),
    ),
    *keys_of(MaskImage),
)


def in_axes(position: Sequence[float], up: str) -> tuple[float, float, float]:
    """A Y-up position with the axes of a tools file."""
    x, y, z = position
    return (x, y, z) if up == "y" else (x, 0.0 - z, y)


def in_words(position: Sequence[float], up: str) -> str:
    """A Y-up position with the axes of a tools file, for messages."""
    return f"[{', '.join(f'{float(each):.4g}' for each in in_axes(position, up))}]"


def moved_point(point: Point, moved: Callable[[Position], Position], named: Callable[[str], str] = str) -> Point:
    """A point whose position or offset a linear map moves, and whose node gets another name."""
    if isinstance(point, Marker):
        return Marker(named(point.marker))
    if isinstance(point, JointPoint):
        return JointPoint(named(point.joint), moved(point.offset))
    return moved(point)


def drawn_from(name: str, seed: int | None) -> str:
    """The seed of an effect's irregularity, or else its name."""
    return name if seed is None else str(seed)


def identifier(name: str) -> str:
    """A tool's name in letters and digits of any script, and `_`."""
    return re.sub(r"\W", "_", name)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectTool:
    """One effect of a tools file, of any kind: the keys that all share; a mirrored one is an effect of its own.

    Attributes:
        mirrored: True if `mirror` made it.
        where: Its place in the file for later errors, such as `tools.yaml:12: tools[0]`.
        places: The places of its keys, such as those of `rest_length.morph`; see `place`.
        section: The key of the file's list, and of those in extras and report.
        words: What messages call one and many.
        meaning: What the list means, for editors.
        point_keys: The keys of its points, of which no two are equal.
        own_keys: Keys that do not inherit from the `defaults` of the file; None if none does.
        keywords: Further keywords of the schema of one.
    """

    section: ClassVar[str]
    words: ClassVar[tuple[str, str]]
    meaning: ClassVar[str]
    point_keys: ClassVar[tuple[str, ...]] = ()
    own_keys: ClassVar[tuple[str, ...] | None] = None
    keywords: ClassVar[Schema] = {}

    name: str = key(
        TEXT, "Unique name, also after _ has replaced all characters but letters, digits and _.", group="Place"
    )
    node: str | None = key(
        {**TEXT, "type": ["string", "null"]}, "Node of the mesh; may be left out where one mesh deforms.", None
    )
    mirrored: bool = key(
        one_of(*get_args(Axis), "none", none=True),
        "Also make the one of the other side: negate this coordinate, as the file writes it, and exchange left and "
        "right in names. Default none.",
        None,
        name="mirror",
        absent=False,
    )
    enabled: bool = key(FLAG, "false: checked but not baked. Default true.", True)
    optional: bool = key(FLAG, "true: an absent node or clip is a note, not an error. Default false.", False)
    where: str = ""
    places: Mapping[tuple[str, ...], str] = field(default_factory=dict, hash=False, compare=False)

    @classmethod
    def fields_of(cls, values: Mapping[str, Any], _known: Mapping[str, Preset]) -> dict[str, Any]:
        """The fields that the keys of a file give."""
        return {name: each for name, each in values.items() if name != "mirror"}

    @classmethod
    def of_material(cls, _values: Mapping[str, Any], _known: Mapping[str, Preset]) -> Mapping[str, Any]:
        """The values that its material gives other keys, as a file would write them; most kinds have no material."""
        return {}

    def place(self, *keys: str) -> str:
        """The place of a key, for later errors, such as `tools.yaml:14: tools[0].node`."""
        return self.places.get(keys, self.where)

    def place_of(self, number: int, *keys: str) -> str:
        """The place of a point in the file."""
        return self.place(*self.point_keys[number : number + 1], *keys)

    @property
    def points(self) -> tuple[Point, ...]:
        """The points at which it lies on the mesh or below it, from its origin on."""
        every = (getattr(self, each) for each in self.point_keys)
        return tuple(each for each in every if each is not None)

    @property
    def identifier(self) -> str:
        """The name in letters, digits and `_`, as in the morph targets `wrinkle_IDENTIFIER_1`; unique too."""
        return identifier(self.name)

    def target_names(self, count: int) -> tuple[str, ...]:
        """The names of so many morph targets of its own."""
        return tuple(f"wrinkle_{self.identifier}_{number}" for number in range(1, count + 1))

    @property
    def sections(self) -> tuple[str, ...]:
        """The kinds of effects that act for it, by their sections in extras and report, its own first."""
        return (self.section,)

    @property
    def without_contact(self) -> Self:
        """The same effect, whose folds may cross."""
        off: Any = {"contact": None} if hasattr(self, "contact") else {}
        return replace(self, **off)

    @property
    def idle(self) -> bool:
        """True if nothing would be seen of it: it has a strength, which is 0 in every clip."""
        return not any((getattr(self, "strength", 1.0), *getattr(self, "clips", {}).values()))

    @property
    def named_clips(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """The names of clips that it asks for, each with the path of its key: those with a strength of their own."""
        return [(name, ("clips", name)) for name in getattr(self, "clips", {})]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrinkleTool(EffectTool):
    """One wrinkling tool, with defaults and its material applied; mirrored tools are tools of their own.

    Attributes:
        origin: World space at rest, Y-up, scene units; or a marker. `target` and `between` are alike.
        between: Points of its path between these two; none for a straight tool.
        material: None for none; as for `seed`, `max_height` (no limit), `lag`, `contact` and `mask`.
        compressible: From 0 to 0.95.
        details: Each > 0, their sum < 1.
        bump_height: Highest point of a bump relative to its width at rest, for `max_height: auto`.
    """

    section: ClassVar[str] = "tools"
    words: ClassVar[tuple[str, str]] = ("tool", "tools")
    meaning: ClassVar[str] = "The wrinkling tools."
    point_keys: ClassVar[tuple[str, ...]] = ("origin", "target")
    own_keys: ClassVar[tuple[str, ...]] = ("name", "origin", "target", "path")
    keywords: ClassVar[Schema] = {
        "required": ["name"],
        "if": {"required": ["path"]},
        "then": {
            "properties": dict.fromkeys(point_keys, expects("path alone, or origin and target", **{"not": {}})),
        },
        "else": {"required": ["origin", "target"]},
    }

    origin: Position | Marker = key(
        ANCHOR, "Where the wrinkles begin: world space at rest in scene units, or {marker: NODE}."
    )
    target: Position | Marker = key(ANCHOR, "Where they end; they run across the line from origin to target.")
    between: tuple[Position | Marker, ...] = key(
        list_of(ANCHOR, 2, MAX_POINTS, f"a list of 2 to {MAX_POINTS} points, each [x, y, z] or {{marker: NODE}}"),
        "Points of a curve on the surface that wrinkles run across, in place of origin and target.",
        name="path",
        absent=(),
    )
    snap: Snap = key(
        one_of(*get_args(Snap)),
        "Anchors go to the nearest point of the surface, or vertex. Default surface.",
        "surface",
    )
    laid: LaidPose | RestFrame = key(
        either(
            schema_of(RestFrame),
            expects(f"{', '.join(get_args(LaidPose))} or {{clip: NAME, time: 0}}", enum=[*get_args(LaidPose)]),
        ),
        "Pose in which crests are straight: stored (at rest), raised (by the morph target that brings the ends "
        "together), or a clip's. Default auto: raised if such a target shortens the tool more than a joint does.",
        "auto",
    )
    attachment: Attachment = key(
        one_of(*get_args(Attachment)),
        "Wrinkles stay on the skin, or the patch is projected anew. Default skin.",
        "skin",
    )
    stops: Stops = key(
        one_of(*get_args(Stops)),
        "Where wrinkles fade out within the patch: at features (open borders, seams of materials, sharp creases, the "
        "other leg), or none. Default features.",
        "features",
    )
    creases: Creases = key(
        one_of(*get_args(Creases)),
        "Where a joint folds the surface more sharply than a bump is wide: lower wrinkles there, or keep their height. "
        "Default lower.",
        "lower",
    )
    mask: Mask | None = key(
        MASK,
        "Factor of the height at each place, 0 to 1: {attribute: _WRINKLE} of the vertices, or {image: FILE, channel: "
        "r}. Default none.",
        None,
    )
    material: str | None = key(
        expects(_MATERIALS, type=["string", "null"], minLength=1, examples=[*presets(), "none", None]),
        "A substance or a preset, which gives other keys other defaults. Default none.",
        None,
        group="Shape",
        read=lambda value: None if value == "none" else value,
    )
    width: Length = key(LENGTH, "Full width across the segment: a length or a percentage. Required.")
    bumps: int = key(whole(1, 64, slider_most=12), "Wrinkles along the segment. Default 4, or the material's.", 4)
    gap: int = key(
        whole(0, 64, slider_most=12), "Flat control intervals, half a bump each, between bumps. Default 0.", 0
    )
    strategy: Strategy = key(
        one_of(*get_args(Strategy)),
        "Which bumps rise first: all alike, from the origin, from both ends. Default everywhere.",
        "everywhere",
    )
    max_height: Literal["auto"] | Length | None = key(
        length_or("auto", "none", None, slides=slider(1, 30, 0.5, "%")),
        "Highest point of a bump: auto (a quarter of a rest bump's width, or the material's part), none, a length or a "
        "percentage. Default auto.",
        "auto",
    )
    profile: Profile = key(
        one_of(*get_args(Profile)),
        f"Shape of a bump: {'; '.join(PROFILES.values())}. Default smooth, or the material's.",
        "smooth",
    )
    attenuation: Attenuation = key(
        one_of(*get_args(Attenuation)), "How a wrinkle fades across the width. Default bell.", "bell"
    )
    details: tuple[float, ...] = key(
        list_of(number(0.001, 0.99, step=0.01), 0, MAX_DETAILS, f"a list of up to {MAX_DETAILS} shares"),
        "Shares of the shortening that go into ever finer wrinkles on the bumps. Default [], or the material's.",
        [],
    )
    variation: float = key(
        _RATIO,
        "How irregular the bumps are: 0 is straight and equal, 1 is most irregular. Default 0.3, or the material's.",
        0.3,
        group="Irregularity",
    )
    seed: int | None = key(
        {**whole(0, MAX_SEED), "type": ["integer", "null"]},
        "Chooses the irregularity; with the same seed a tool and its mirror image have mirrored wrinkles. Default: "
        "from the name.",
        None,
    )
    branch: float = key(_RATIO, "Chance that a bump merges with its neighbour; needs `variation`. Default 0.25.", 0.25)
    broken: float = key(
        _RATIO,
        "How broken wrinkles are: furrows have gaps, and crests end apart, the middle one last. Default 0.",
        0.0,
    )
    bow: float = key(
        number(-1, 1, step=0.01),
        "Bends crests like an arc, their ends towards the target; negative: origin. Default 0.",
        0.0,
    )
    compressible: float = key(
        percentage(MAX_COMPRESSIBLE, MAX_COMPRESSIBLE),
        "Share of every shortening that the tissue takes itself; the rest makes wrinkles. Default 0%, or the "
        "material's.",
        "0%",
        group="Motion",
    )
    strength: float = key(
        _STRENGTH, "Factor of the height; negative is inward. The length is kept only with 1. Default 1.", 1.0
    )
    clips: Mapping[str, float] = key(
        any_keys(_STRENGTH, "a mapping of clip names to strengths"),
        "Strength in a clip instead of `strength`; 0 switches it off. Default {}.",
        {},
        hashed=False,
    )
    rest_length: RestLength = key(
        either(
            schema_of(RestLengthKeys),
            either(
                schema_of(RestLengthMorph),
                expects(
                    f"auto, {LENGTHS}, {{keys: {{CLIP: [[SECONDS, LENGTH], …]}}}} or {{morph: NAME, full: LENGTH}}",
                    anyOf=[{"const": "auto"}, LENGTH],
                    read=read_length,
                ),
                "morph",
                "full",
            ),
            "keys",
        ),
        "Length from which shortening counts: auto (the rest distance), a length, a percentage, {keys: …} by hand, "
        "{morph: …} by a morph target. Default auto.",
        "auto",
    )
    lag: Lag | None = key(
        either(schema_of(Lag), expects("{frequency: 6, damping: 0.5} or none", enum=["none", None])),
        "Heights follow the shortening as a damped spring does: {frequency: 6, damping: 0.5}, or none. Default none.",
        None,
    )
    contact: Contact | None = key(
        CONTACT,
        "resolve, or a mapping with more keys: folds that touch do not cross. Default off.",
        "off",
    )
    bump_height: float = PLAIN_HEIGHT

    @classmethod
    def fields_of(cls, values: Mapping[str, Any], known: Mapping[str, Preset]) -> dict[str, Any]:
        """The fields that the keys of a file give: a path gives the points, a material of `known` gives defaults."""
        found = {name: each for name, each in values.items() if name not in ("mirror", "path")}
        points = values.get("path") or (values["origin"], values["target"])
        found["origin"], *between, found["target"] = points
        return with_material({**found, "between": tuple(between)}, readers_of(WrinkleTool), known)

    @classmethod
    def of_material(cls, values: Mapping[str, Any], known: Mapping[str, Preset]) -> Mapping[str, Any]:
        """The values that the material of these keys gives others, as a file would write them."""
        material = known.get(str(values.get("material")))
        if material is None:
            return {}
        return {**material.keys, "bumps": material.bumps(values.get("gap", material.keys.get("gap", 0)))}

    @property
    def points(self) -> tuple[Position | Marker, ...]:
        """All points from origin to target."""
        return (self.origin, *self.between, self.target)

    def point_name(self, number: int) -> str:
        """The name of a point in messages."""
        return f"path[{number}]" if self.between else ("origin", "target")[number]

    def place_of(self, number: int, *keys: str) -> str:
        """The place of a point in the file, in a path or not."""
        given = ("path", str(number)) if ("path",) in self.places or self.between else (("origin", "target")[number],)
        return self.place(*given, *keys)

    @property
    def sections(self) -> tuple[str, ...]:
        """Wrinkles, and folds where contact keeps them apart."""
        return (self.section,) if self.contact is None else (self.section, "folds")

    @property
    def named_clips(self) -> list[tuple[str, tuple[str, ...]]]:
        """The clips with a strength of their own, of keyed rest lengths and of `laid`, with the paths of their keys."""
        keyed = self.rest_length.keys if isinstance(self.rest_length, RestLengthKeys) else {}
        laid = [self.laid.clip] if isinstance(self.laid, RestFrame) else []
        return [
            *((name, ("clips", name)) for name in self.clips),
            *((name, ("rest_length", "keys", name)) for name in keyed),
            *((name, ("laid", "clip")) for name in laid),
        ]

    def strength_in(self, clip: str) -> float:
        """The factor of the height while a clip plays."""
        return self.clips.get(clip, self.strength)


def with_points(record: type, values: Mapping[str, Any], moved: Callable[[Point], Point]) -> dict[str, Any]:
    """Values of a record's keys, with each point among them moved."""
    readers = readers_of(record)
    found = dict(values)
    for name in values:
        if readers.get(name) in (read_anchor, reader_of(END), reader_of(TIP)):
            found[name] = moved(values[name])
        elif readers.get(name) == ListReader(read_anchor):
            found[name] = tuple(map(moved, values[name]))
    return found


def with_axes(record: type, values: Mapping[str, Any], up: str) -> dict[str, Any]:
    """Plain values of a record's keys, Y-up, in the axes of a file."""

    def moved(point: Any) -> Any:
        if isinstance(point, Mapping):
            return {**point, "offset": list(in_axes(point["offset"], up))} if "offset" in point else point
        return point if isinstance(point, str) else list(in_axes(point, up))

    turned = with_points(record, values, moved)
    if up == "z" and turned.get("mirror") in ("y", "z"):
        turned["mirror"] = {"y": "z", "z": "y"}[turned["mirror"]]
    return turned


def written_keys(record: Any, usual: Any = None, shown: Collection[str] = ()) -> dict[str, Any]:
    """The keys of a record as a file writes them.

    Args:
        record: The record.
        usual: Values that the file need not have are those of this record; by default those of the keys.
        shown: Keys that are written in any case, if they have a value.
    """
    found = {}
    for each in key_fields(type(record)):
        name, value = each.metadata["name"] or each.name, getattr(record, each.name)
        default = default_of(each)
        known = default if usual is None or default is MISSING else getattr(usual, each.name)
        if value != known or (name in shown and value is not None):
            percentage = isinstance(value, float) and "string" in each.metadata["schema"].get("type", "")
            found[name] = f"{100.0 * value:.12g}%" if percentage else _written(value)
    return found


def _written(value: Any) -> Any:
    if isinstance(value, Length):
        return f"{value.value:.12g}%" if value.percent else value.value
    if isinstance(value, tuple | list):
        return [_written(each) for each in value]
    if is_dataclass(value):
        return written_keys(value) or "resolve"  # Contact alone may have no key
    return value


def usual_effect(effect: EffectTool, known: Mapping[str, Preset], **defaults: Any) -> EffectTool:
    """An effect of the same place and material, with the defaults of a file and what `known` materials give."""
    kind = type(effect)
    needed = [each.name for each in key_fields(kind) if default_of(each) is MISSING]
    material = {"material": effect.material} if hasattr(effect, "material") else {}
    own = {name: getattr(effect, name) for name in needed}
    return kind(**kind.fields_of({**own, **material, **defaults}, known))


# Keys that say where a tool is or in which clips it works, not what wrinkles.
_NOT_OF_PRESETS = ("name", "node", "origin", "target", "path", "mirror", "material", "clips", "enabled", "optional")
_MAX_PRESET_FILES = 16  # each may take the time of a tools file
_PERCENT = expects("a percentage from 1% to 100%", type="string", maxLength=40, pattern=r"^([1-9][0-9]?|100) ?%$")
PRESET_KEYS = {
    "title": key_of(TEXT, "Its name in menus. Default: its name."),
    "material": key_of(TEXT, "The material or preset that gives the keys that this one leaves out. Default none."),
    "parts": key_of(
        list_of(one_of(*PARTS), 1, len(PARTS), "a list of parts of a body"),
        "Parts of a body for which suggest takes it, on its substance. Default none.",
    ),
    "bump_width": key_of(_PERCENT, "Width of a bump at rest, of the segment; it gives the number of bumps."),
    "bump_height": key_of(_PERCENT, "Highest point of a bump with max_height auto, of its width at rest."),
    **{name: each for name, each in keys_of(WrinkleTool).items() if name not in _NOT_OF_PRESETS},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolsFile:
    """A file of tools.

    Attributes:
        path: The file as the user typed it.
        up: The up axis of the file; positions here are Y-up already.
        effects: The enabled effects, list by list in the file's order, a mirrored one behind its source.
        places: Places of the other keys of the file, such as those of `rest.clip`, for later errors.
        merged_paths: Further files that are merged into this one.
        preset_files: Files of presets that these name.
    """

    path: str
    version: int = key(
        expects("1, the only version so far", const=1), "Version of this format. Required: 1.", read=int, absent=1
    )
    up: Up = key(one_of(*get_args(Up)), "Axis of the positions: y (glTF) or z (as Blender shows them). Default y.", "y")
    rest: RestPose | RestFrame = key(
        either(
            schema_of(RestFrame),
            expects(f"{', '.join(get_args(RestPose))} or {{clip: NAME, time: 0}}", enum=[*get_args(RestPose)]),
        ),
        "Pose in which the tools are attached. Default stored.",
        "stored",
    )
    sampling: Sampling = key(
        schema_of(Sampling),
        "Times at which clips are evaluated.",
        defaults_of(Sampling),
    )
    refinement: RefinementSettings = key(
        schema_of(RefinementSettings),
        "Subdivision under the wrinkles.",
        defaults_of(RefinementSettings),
    )
    presets: Mapping[str, Preset] = key(
        # Keywords for lists, texts and mappings hold for each alone, so all stand side by side.
        expects(
            f"a mapping of names to keys of tools, or a file of such, or a list of up to {_MAX_PRESET_FILES} files",
            type=["object", "string", "array"],
            additionalProperties=mapping_of(PRESET_KEYS),
            minLength=1,
            items=TEXT,
            minItems=1,
            maxItems=_MAX_PRESET_FILES,
        ),
        "Presets for `material`, or files of them; one that has the name of a built-in preset replaces it.",
        {},
        read=lambda value: presets_of(value, presets()) if isinstance(value, dict) else {},
        hashed=False,
    )
    effects: tuple[EffectTool, ...] = ()
    places: Mapping[tuple[str, ...], str] = field(default_factory=dict, hash=False, compare=False)
    merged_paths: tuple[str, ...] = ()
    preset_files: tuple[str, ...] = ()

    @property
    def tools(self) -> tuple[WrinkleTool, ...]:
        """The wrinkling tools."""
        return tuple(each for each in self.effects if isinstance(each, WrinkleTool))

    @property
    def on_skin(self) -> tuple[EffectTool, ...]:
        """Tools and fields, which move the skin; all others move the body below it."""
        order = [*EFFECTS]
        return tuple(each for each in self.effects if order.index(each.section) >= order.index("tools"))

    @property
    def files_beside(self) -> tuple[str, ...]:
        """The paths of the images that the enabled effects name, and of the files of presets."""
        masks = (getattr(each, "mask", None) for each in self.effects)
        images = (mask.path for mask in masks if isinstance(mask, MaskImage))
        return tuple(dict.fromkeys([*images, *self.preset_files]))

    def only(self, names: Collection[str]) -> "ToolsFile":
        """The file with the effects of some names alone."""
        return replace(self, effects=tuple(each for each in self.effects if each.name in names))

    def place(self, *keys: str) -> str:
        """The place of a key beside the tools, for later errors, such as `tools.yaml:4: rest.clip`."""
        return self.places.get(keys, self.path)
