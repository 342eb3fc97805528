"""The YAML file of wrinkling tools, read into frozen records; all of its problems are reported at once.

Three steps: YAML text to a tree that knows its lines, the tree to pydantic models key by key (so that one bad
key hides no other), the models to records: defaults inherited, mirrored tools made, positions turned to Y-up.
`configs/README.md` is the reference of the keys.
"""

import difflib
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeAlias, get_type_hints

from annotated_types import Ge, GroupedMetadata, Le
from pydantic import (
    AfterValidator,
    AllowInfNan,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Strict,
    StringConstraints,
    Tag,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    create_model,
)
from pydantic.dataclasses import dataclass as model_dataclass
from pydantic_core import PydanticCustomError

from wrinklecli.errors import ConfigError
from wrinklecli.yamltree import MAX_BYTES, MAX_NODES, MAX_SHOWN, Node, Problem, path_to, printable, read_tree

MAX_TOOLS = 1_000
MAX_DETAILS = 4  # levels; a fifth is a 32nd of a bump, finer than any mesh here
MIN_LENGTH, MAX_LENGTH = 1e-9, 1e9  # scene units: a nanometre in metres, a metre in nanometres
MIN_PERCENT, MAX_PERCENT = 0.01, 10_000.0


# --- What a value may be, and the words for it ---


def _short(number: float) -> str:
    return re.sub(r"e([-+])0*", r"e\1", f"{number:g}").replace("e+", "e")


def _unexpected(accepted: str) -> PydanticCustomError:
    return PydanticCustomError("expected", "{accepted}", {"accepted": accepted})


def _expects(accepted: str) -> WrapValidator:
    """Replace whatever pydantic says about a value by one sentence."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise _unexpected(accepted) from None

    return WrapValidator(check)


def _a(
    kind: type[Sized] | tuple[type[Sized], ...], accepted: str, low: int = 0, high: int = MAX_NODES
) -> BeforeValidator:
    """A container of this kind and size; problems of its items are reported at the items."""

    def check(value: Any) -> Any:
        if not isinstance(value, kind) or not low <= len(value) <= high:
            raise _unexpected(accepted)
        return value

    return BeforeValidator(check)


def _whole(value: Any) -> Any:
    """4.0 is a whole number, as it is in JSON Schema; true is none, though Python says that True == 1."""
    if isinstance(value, bool):
        raise _unexpected("a whole number")
    return int(value) if isinstance(value, float) and value.is_integer() else value


@dataclass(frozen=True, slots=True)
class _Between(GroupedMetadata):
    """A finite number in a closed range, no bool and no text."""

    low: float
    high: float
    noun: str = "a number"

    def __iter__(self) -> Iterator[object]:
        yield from (Strict(), AllowInfNan(False), Ge(self.low), Le(self.high))
        yield _expects(f"{self.noun} from {_short(self.low)} to {_short(self.high)}")


@dataclass(frozen=True, slots=True)
class _WholeBetween(GroupedMetadata):
    """A whole number in a closed range."""

    low: int
    high: int

    def __iter__(self) -> Iterator[object]:
        yield from (Strict(), Ge(self.low), Le(self.high), BeforeValidator(_whole))
        yield _expects(f"a whole number from {self.low} to {self.high}")


@dataclass(frozen=True, slots=True)
class Length:
    """A length in scene units, or per cent of the tool's own rest distance.

    Args:
        value: Scene units, or 80.0 for `80%`.
        percent: Whether `value` is a percentage.
    """

    value: float
    percent: bool = False

    def resolve(self, rest_distance: float) -> float:
        """Scene units, given the distance of the tool's anchors at rest in scene units."""
        return self.value / 100.0 * rest_distance if self.percent else self.value


_PERCENT = r"^\+?([0-9]+\.?[0-9]*|\.[0-9]+) ?%$"
_LENGTH = (
    f"a length from {_short(MIN_LENGTH)} to {_short(MAX_LENGTH)} scene units "
    f"or a percentage from {MIN_PERCENT:g}% to {MAX_PERCENT:g}%"
)
_LENGTH_SCHEMA: list[dict[str, Any]] = [
    {"type": "number", "minimum": MIN_LENGTH, "maximum": MAX_LENGTH},
    {"type": "string", "pattern": _PERCENT},
]


def _length(value: Any, accepted: str = _LENGTH) -> Length:
    match value:
        case Length():
            return value
        case bool():
            pass
        case int() | float() if MIN_LENGTH <= value <= MAX_LENGTH:
            return Length(float(value))
        case str() if len(value) <= MAX_SHOWN and re.search(_PERCENT, value):
            percent = float(value.rstrip("%"))
            if MIN_PERCENT <= percent <= MAX_PERCENT:
                return Length(percent, percent=True)
    raise _unexpected(accepted)


def _max_height(value: Any) -> Literal["auto"] | Length | None:
    if value is None or value == "none":
        return None
    return "auto" if value == "auto" else _length(value, f"auto, none, {_LENGTH}")


def _auto_or_length(value: Any) -> Literal["auto"] | Length:
    return "auto" if value == "auto" else _length(value, _REST_LENGTH)


def _rising(keys: tuple[tuple[float, Length], ...]) -> tuple[tuple[float, Length], ...]:
    for (before, _), (after, _) in pairwise(keys):
        if after <= before:
            raise _unexpected(f"times that rise from key to key, not {before:g} and then {after:g}")
    return keys


def _different(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise _unexpected("each clip named once")
    return names


def _shares(details: tuple[float, ...]) -> tuple[float, ...]:
    if sum(details) > 0.99:
        raise _unexpected(f"shares whose sum is at most 0.99, not {sum(details):g}")
    return details


Position: TypeAlias = tuple[float, float, float]
Text: TypeAlias = Annotated[
    str,
    Strict(),
    StringConstraints(min_length=1),
    _expects("text, in quotes where YAML would read a number, true, false or null"),
]
Flag: TypeAlias = Annotated[bool, Strict(), _expects("true or false")]
_Seconds: TypeAlias = Annotated[float, _Between(0, 1e6, "seconds")]
_Strength: TypeAlias = Annotated[float, _Between(-100, 100)]
_Coordinate: TypeAlias = Annotated[float, _Between(-1e9, 1e9)]
_PlainLength: TypeAlias = Annotated[Length, PlainValidator(_length), WithJsonSchema({"anyOf": _LENGTH_SCHEMA})]
_Key: TypeAlias = Annotated[tuple[_Seconds, _PlainLength], _a((list, tuple), "[seconds, length]", 2, 2)]
_Keys: TypeAlias = Annotated[
    tuple[_Key, ...],
    Field(json_schema_extra={"minItems": 1}),
    _a((list, tuple), "a list of one or more [seconds, length]", 1),
    AfterValidator(_rising),
]

# --- Records that are parts of the file as well ---

_STRICT_KEYS = ConfigDict(extra="forbid", defer_build=True)


@model_dataclass(frozen=True, slots=True, config=_STRICT_KEYS)
class Marker:
    """An anchor given by the position of a node of the asset, such as an exported empty."""

    marker: Annotated[Text, Field(description="Node whose position at rest is the anchor.")]


@model_dataclass(frozen=True, slots=True, config=_STRICT_KEYS)
class RestFrame:
    """A clip's pose at a time, taken as the rest pose."""

    clip: Annotated[Text, Field(description="Name of the clip.")]
    time: Annotated[_Seconds, Field(description="Seconds from the clip's start. Default 0.")] = 0.0


@model_dataclass(frozen=True, slots=True, config=_STRICT_KEYS)
class Sampling:
    """At which times which clips are evaluated."""

    fps: Annotated[
        float,
        _Between(0.1, 1000),
        Field(description="Samples per second, joined with the clip's own key times. Default 30."),
    ] = 30.0
    clips: Annotated[
        Annotated[Literal["all"], _expects("all or a list of clip names"), Tag("<word>")]
        | Annotated[
            tuple[Text, ...],
            Field(json_schema_extra={"minItems": 1, "uniqueItems": True}),
            _a((list, tuple), "all or a list of clip names", 1),
            AfterValidator(_different),
            Tag("<list>"),
        ],
        Discriminator(lambda value: "<list>" if isinstance(value, list | tuple) else "<word>"),
        Field(description="Clips to bake: all, or a list of names. Default all."),
    ] = "all"


@model_dataclass(frozen=True, slots=True, config=_STRICT_KEYS)
class RefinementSettings:
    """How finely the mesh is subdivided under the wrinkles."""

    max_levels: Annotated[
        int,
        _WholeBetween(0, 8),
        Field(description="Most times that an edge is halved; 0 keeps the mesh. Default 4."),
    ] = 4
    edges_per_interval: Annotated[
        int,
        _WholeBetween(1, 16),
        Field(description="Edges on each control interval, half a bump; more is smoother. Default 2."),
    ] = 2
    scheme: Annotated[
        Literal["butterfly", "midpoint"],
        _expects("butterfly or midpoint"),
        Field(description="butterfly rounds the surface, midpoint keeps the coarse shape. Default butterfly."),
    ] = "butterfly"


@model_dataclass(frozen=True, slots=True, config=_STRICT_KEYS)
class RestLengthKeys:
    """Rest lengths keyed by hand, the paper's forehead; clips that are not named keep the rest distance."""

    keys: Annotated[
        Mapping[str, _Keys],
        _a(dict, "a mapping of clip names to lists of [seconds, length]", 1),
        Field(
            description="For each clip a list of [seconds, length], times rising.",
            json_schema_extra={"minProperties": 1},
        ),
    ] = field(hash=False)


@model_dataclass(frozen=True, slots=True, config=_STRICT_KEYS)
class RestLengthMorph:
    """A rest length driven by a morph target's weight: the rest distance at 0, `full` at 1."""

    morph: Annotated[Text, Field(description="Name of the morph target.")]
    full: Annotated[_PlainLength, Field(description="Rest length at weight 1: a length or a percentage.")]


_REST_LENGTH = f"auto, {_LENGTH}, {{keys: {{CLIP: [[SECONDS, LENGTH], …]}}}} or {{morph: NAME, full: LENGTH}}"


def _rest_length_tag(value: Any) -> str | None:
    if isinstance(value, RestLengthKeys) or (isinstance(value, dict) and "keys" in value):
        return "<keys>"
    if isinstance(value, RestLengthMorph) or (isinstance(value, dict) and {"morph", "full"} & set(value)):
        return "<morph>"
    return None if isinstance(value, dict) else "<length>"


def _pick(tag: Any, accepted: str) -> Discriminator:
    return Discriminator(
        tag,
        custom_error_type="expected",
        custom_error_message="{accepted}",
        custom_error_context={"accepted": accepted},
    )


_Anchor: TypeAlias = Annotated[
    Annotated[
        tuple[_Coordinate, _Coordinate, _Coordinate],
        _a((list, tuple), "[x, y, z] or {marker: NODE}", 3, 3),
        Tag("<xyz>"),
    ]
    | Annotated[Marker, Tag("<marker>")],
    _pick(
        lambda value: (
            "<xyz>" if isinstance(value, list | tuple) else "<marker>" if isinstance(value, dict | Marker) else None
        ),
        "[x, y, z] or {marker: NODE}",
    ),
]

# --- The model of the file ---


class ToolModel(BaseModel):
    """A tool as the file writes it."""

    model_config = ConfigDict(extra="forbid", validate_assignment=True, title="Tool")

    name: Annotated[Text, Field(description="Unique name; also when all but letters, digits and _ is replaced by _.")]
    node: Annotated[
        Text | None,
        _expects("text, in quotes where YAML would read a number, true, false or null"),
        Field(description="Node of the mesh; may be left out where one mesh deforms."),
    ] = None
    origin: Annotated[
        _Anchor,
        Field(description="Where the wrinkles begin: world space at rest in scene units, or {marker: NODE}."),
    ]
    target: Annotated[
        _Anchor,
        Field(description="Where they end; they run across the line from origin to target."),
    ]
    snap: Annotated[
        Literal["surface", "vertex"],
        _expects("surface or vertex"),
        Field(description="Anchors go to the nearest point of the surface, or vertex. Default surface."),
    ] = "surface"
    mirror: Annotated[
        Literal["x", "y", "z", "none"] | None,
        _expects("x, y, z or none"),
        Field(
            description="Also make the tool of the other side: this coordinate, as the file writes it, "
            "negated, left and right exchanged in names. Default none."
        ),
    ] = None
    width: Annotated[
        _PlainLength,
        Field(description="Full width across the segment: a length or a percentage. Required."),
    ]
    strategy: Annotated[
        Literal["everywhere", "origin", "both_ends"],
        _expects("everywhere, origin or both_ends"),
        Field(description="Which bumps rise first: all alike, from the origin, from both ends. Default everywhere."),
    ] = "everywhere"
    bumps: Annotated[int, _WholeBetween(1, 64), Field(description="Wrinkles along the segment. Default 4.")] = 4
    gap: Annotated[
        int,
        _WholeBetween(0, 64),
        Field(description="Flat control intervals, half a bump each, between bumps. Default 0."),
    ] = 0
    max_height: Annotated[
        Literal["auto"] | Length | None,
        PlainValidator(_max_height),
        WithJsonSchema({"anyOf": [{"enum": ["auto", "none", None]}, *_LENGTH_SCHEMA]}),
        Field(
            description="Highest point of a bump: auto (a quarter of a rest bump's width), none, a length "
            "or a percentage. Default auto."
        ),
    ] = "auto"
    details: Annotated[
        tuple[Annotated[float, _Between(0.001, 0.99)], ...],
        Field(max_length=MAX_DETAILS),
        _a((list, tuple), f"a list of up to {MAX_DETAILS} shares", 0, MAX_DETAILS),
        AfterValidator(_shares),
        Field(description="Shares of the shortening that go into ever finer wrinkles on the bumps. Default []."),
    ] = ()
    profile: Annotated[
        Literal["smooth", "polyline"],
        _expects("smooth or polyline"),
        Field(description="Shape of a bump: smooth, or the paper's polyline. Default smooth."),
    ] = "smooth"
    attenuation: Annotated[
        Literal["bell", "linear"],
        _expects("bell or linear"),
        Field(description="How a wrinkle fades across the width. Default bell."),
    ] = "bell"
    attachment: Annotated[
        Literal["skin", "patch"],
        _expects("skin or patch"),
        Field(description="Wrinkles stay on the skin, or the patch is projected anew. Default skin."),
    ] = "skin"
    strength: Annotated[
        _Strength,
        Field(description="Factor of the height; negative is inward; not 1 gives up length. Default 1."),
    ] = 1.0
    clips: Annotated[
        Mapping[str, _Strength],
        _a(dict, "a mapping of clip names to strengths"),
        Field(description="Strength in a clip instead of `strength`; 0 switches it off. Default {}."),
    ] = {}
    rest_length: Annotated[
        Annotated[
            Literal["auto"] | Length,
            PlainValidator(_auto_or_length),
            WithJsonSchema({"anyOf": [{"const": "auto"}, *_LENGTH_SCHEMA]}),
            Tag("<length>"),
        ]
        | Annotated[RestLengthKeys, Tag("<keys>")]
        | Annotated[RestLengthMorph, Tag("<morph>")],
        _pick(_rest_length_tag, _REST_LENGTH),
        Field(
            description="Length from which shortening counts: auto (the rest distance), a length, a "
            "percentage, {keys: …} by hand, {morph: …} by a morph target. Default auto."
        ),
    ] = "auto"
    enabled: Annotated[Flag, Field(description="false: checked but not baked. Default true.")] = True
    optional: Annotated[Flag, Field(description="true: an absent node is a note, not an error. Default false.")] = False


_OWN_KEYS = ("name", "origin", "target")
# Keys of the file that are models themselves, and whether they must be there.
_PARTS = {"defaults": False, "tools": True}


class HeaderModel(BaseModel):
    """The file but for its tools and their defaults."""

    model_config = ConfigDict(extra="forbid", validate_assignment=True, title="wrinkle tools")

    version: Annotated[
        Literal[1],
        BeforeValidator(_whole),
        _expects("1, the only version so far"),
        Field(description="Version of this format. Required: 1."),
    ]
    up: Annotated[
        Literal["y", "z"],
        _expects("y or z"),
        Field(description="Axis of the positions: y (glTF) or z (as Blender shows them). Default y."),
    ] = "y"
    rest: Annotated[
        Annotated[Literal["stored", "bind"], _expects("stored, bind or {clip: NAME, time: 0}"), Tag("<word>")]
        | Annotated[RestFrame, Tag("<clip>")],
        Discriminator(lambda value: "<clip>" if isinstance(value, dict | RestFrame) else "<word>"),
        Field(description="Pose in which the tools are attached. Default stored."),
    ] = "stored"
    sampling: Annotated[Sampling, Field(description="Times at which clips are evaluated.")] = Sampling()
    refinement: Annotated[RefinementSettings, Field(description="Subdivision under the wrinkles.")] = (
        RefinementSettings()
    )


_DIALECT = "https://json-schema.org/draft/2020-12/schema"  # that pydantic writes


def file_model() -> type[BaseModel]:
    """The whole file; made when asked for, as to make a model takes longer than to read most files."""
    shared: dict[str, Any] = {
        key: (hint, ToolModel.model_fields[key].default)
        for key, hint in get_type_hints(ToolModel, include_extras=True).items()
        if key in ToolModel.model_fields and key not in _OWN_KEYS
    }
    defaults: Any = create_model(
        "DefaultsModel",
        __config__=ConfigDict(extra="forbid", title="Defaults"),
        __doc__="What every tool inherits where it does not say otherwise.",
        **shared,
    )
    parts: dict[str, Any] = {
        "defaults": (Annotated[defaults | None, Field(description="Inherited by every tool.")], None),
        "tools": (
            Annotated[list[ToolModel], Field(description="The wrinkling tools.", min_length=1, max_length=MAX_TOOLS)],
            ...,
        ),
    }
    return create_model("FileModel", __base__=HeaderModel, __doc__="The whole file.", **parts)


def tools_schema() -> dict[str, Any]:
    """The JSON Schema of the file, for editors that complete and check YAML."""
    schema = {"$schema": _DIALECT} | file_model().model_json_schema()
    # The file must say the width, but either here or there.
    schema["$defs"]["ToolModel"]["required"].remove("width")
    del schema["$defs"]["DefaultsModel"]["required"]
    return schema


# --- The records that the pipeline reads ---


@dataclass(frozen=True, slots=True, kw_only=True)
class WrinkleTool:
    """One wrinkling tool, defaults and mirror applied.

    Args:
        name: Unique name.
        node: Node of the mesh, None where the file leaves it out.
        origin: World space at rest, Y-up, scene units; or a marker.
        target: As origin.
        snap: What anchors go to.
        width: Full width across the segment.
        strategy: Which bumps rise first.
        bumps: Wrinkles along the segment.
        gap: Flat control intervals between neighbouring bumps.
        max_height: Highest point of a bump; `auto`; or None for no limit.
        details: Shares of the shortening for finer wrinkles, each > 0, their sum < 1.
        profile: Shape of a bump.
        attenuation: How a wrinkle fades across the width.
        attachment: `skin`, or the paper's `patch`.
        strength: Factor of the height.
        clips: Strength by clip name, in place of `strength`.
        rest_length: `auto`, a length, or what drives it.
        enabled: Whether it is baked; a `ToolsFile` keeps only those.
        optional: Whether an absent node is a note rather than an error.
        where: Its place in the file for later errors, such as `tools.yaml:12: tools[0]`.
    """

    name: str
    node: str | None = None
    origin: Position | Marker
    target: Position | Marker
    snap: Literal["surface", "vertex"] = "surface"
    width: Length
    strategy: Literal["everywhere", "origin", "both_ends"] = "everywhere"
    bumps: int = 4
    gap: int = 0
    max_height: Literal["auto"] | Length | None = "auto"
    details: tuple[float, ...] = ()
    profile: Literal["smooth", "polyline"] = "smooth"
    attenuation: Literal["bell", "linear"] = "bell"
    attachment: Literal["skin", "patch"] = "skin"
    strength: float = 1.0
    clips: Mapping[str, float] = field(default_factory=dict, hash=False)
    rest_length: Literal["auto"] | Length | RestLengthKeys | RestLengthMorph = "auto"
    enabled: bool = True
    optional: bool = False
    where: str = ""

    @property
    def identifier(self) -> str:
        """The name in letters, digits and `_`, as in the morph targets `wrinkle_IDENTIFIER_1`; unique too."""
        return _identifier(self.name)

    def strength_in(self, clip: str) -> float:
        """The factor of the height while a clip plays."""
        return self.clips.get(clip, self.strength)


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolsFile:
    """A file of tools.

    Args:
        path: The file as the user typed it.
        version: Version of the format.
        up: The up axis of the file; positions here are Y-up already.
        rest: Pose in which the tools are attached.
        sampling: At which times which clips are evaluated.
        refinement: How finely the mesh is subdivided.
        tools: The enabled tools in the file's order, a mirrored one behind its source.
    """

    path: str
    version: int = 1
    up: Literal["y", "z"] = "y"
    rest: Literal["stored", "bind"] | RestFrame = "stored"
    sampling: Sampling = field(default_factory=Sampling)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    tools: tuple[WrinkleTool, ...]


# --- The tree to models, key by key ---


def _fields(model: Any) -> tuple[str, ...]:
    fields = model.model_fields if hasattr(model, "model_fields") else model.__pydantic_fields__
    return tuple(fields)


_KEYS_BELOW: Mapping[str, tuple[str, ...]] = {
    "rest": _fields(RestFrame),
    "sampling": _fields(Sampling),
    "refinement": _fields(RefinementSettings),
    "origin": _fields(Marker),
    "target": _fields(Marker),
    "rest_length": (*_fields(RestLengthKeys), *_fields(RestLengthMorph)),
}


def _nearest(found: str, known: Iterable[str]) -> str | None:
    # Longer than any key: no typing error, and difflib takes quadratic time.
    if len(found) > MAX_SHOWN:
        return None
    return next(iter(difflib.get_close_matches(found.lower(), list(known), n=1)), None)


def _unknown_key(key: str, known: tuple[str, ...]) -> str:
    near = _nearest(key, known)
    return f"unknown key, did you mean {near}?" if near else f"unknown key, expected {', '.join(known)}"


def _value_problem(node: Node, accepted: str) -> str:
    words = [word for word in re.split(r", | or ", accepted) if re.fullmatch("[a-z_]+", word)]
    near = _nearest(node.value, words) if isinstance(node.value, str) else None
    return f"found {node.shown}, expected {accepted}" + (f"; did you mean {near}?" if near else "")


def _pydantic_problems(error: ValidationError, parent: Node, path: str) -> Iterator[Problem]:
    """One problem for each of pydantic's below `parent`, whose path is `path`."""
    details = error.errors(include_url=False, include_input=False)
    # A missing key is not reported beside the misspelt one that was meant to be it.
    meant = {
        (detail["loc"][:-1], _nearest(str(detail["loc"][-1]), _KEYS_BELOW.get(str(detail["loc"][0]), ())))
        for detail in details
        if detail["type"] == "unexpected_keyword_argument"
    }
    for detail in details:
        kind, loc = detail["type"], detail["loc"]
        node, where, key = parent, path, str(loc[-1])
        for step in loc:  # a step that is no key of the file is the tag of a union's branch
            if step in node.children:
                node, where = node.children[step], path_to(where, step)
        known = _KEYS_BELOW.get(str(loc[0]), ())
        if kind == "unexpected_keyword_argument":
            yield Problem(node.line, where, _unknown_key(key, known))
        elif kind == "missing":
            if (loc[:-1], key) not in meant:
                yield Problem(node.line, path_to(where, key), "required, but missing")
        elif kind == "expected":
            yield Problem(node.line, where, _value_problem(node, str(detail["ctx"]["accepted"])))
        elif kind == "dataclass_type":
            yield Problem(node.line, where, _value_problem(node, f"a mapping of {', '.join(known)}"))
        else:
            yield Problem(node.line, where, f"found {node.shown}: {detail['msg']}")


def _fill(
    model: type[BaseModel],
    node: Node,
    path: str,
    *,
    apart: Mapping[str, bool] = {},
    inherited: Collection[str] = (),
    partial: bool = False,
) -> tuple[dict[str, Any], list[Problem]]:
    """The valid keys of a mapping and the problems of the others.

    Keys are set one at a time: a model validated as a whole is nothing at all after its first error.

    Args:
        model: What the mapping should be.
        node: The mapping.
        path: Its path in the file.
        apart: Keys that the caller reads, and whether they are required.
        inherited: Required keys that need not be here.
        partial: No key is required, and those that each tool has for itself must not be here.
    """
    required = {
        name: info.is_required() for name, info in model.model_fields.items() if not (partial and name in _OWN_KEYS)
    }
    fields = (*required, *apart)
    if not isinstance(node.value, dict):
        accepted = f"a mapping of {', '.join(fields)}"
        return {}, [Problem(node.line, path, f"found {node.shown}, expected {accepted}")]
    values = model.model_construct()
    problems: list[Problem] = []
    meant: set[str | None] = set()
    for key, child in node.children.items():
        name = str(key)
        if name in apart:
            continue
        if name in fields:
            try:
                setattr(values, name, child.value)
            except ValidationError as error:
                problems += _pydantic_problems(error, node, path)
        elif partial and name in _OWN_KEYS:
            problems.append(Problem(child.line, path_to(path, name), "not inherited, each tool needs its own"))
        else:
            meant.add(_nearest(name, fields))
            problems.append(Problem(child.line, path_to(path, name), _unknown_key(name, fields)))
    for name, must in {**required, **apart}.items():
        absent = must and name not in node.children
        if absent and not partial and name not in inherited and name not in meant:
            problems.append(Problem(node.line, path_to(path, name), "required, but missing"))
    return {name: getattr(values, name) for name in values.model_fields_set}, problems


# --- Models to records ---

_SIDES = {"L": "R", "l": "r", "Left": "Right", "left": "right", "LEFT": "RIGHT"}
_OTHER_SIDE = _SIDES | {right: left for left, right in _SIDES.items()}
# A letter stands alone between separators, a word is no part of another (bright, cleft, Leftover).
_SIDE = re.compile(
    r"(?:^|(?<=[._\- :]))[LRlr](?=$|[._\- :])|(?:Left|Right)(?![a-z])|"
    r"(?<![A-Za-z])(?:left|right)(?![a-z])|(?<![A-Z])(?:LEFT|RIGHT)(?![A-Z])"
)


def _identifier(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]", "_", name)


def _exchange_sides(name: str) -> str:
    return _SIDE.sub(lambda match: _OTHER_SIDE[match[0]], name)


def split_side(name: str) -> tuple[str, str]:
    """A name without its first side, and `L` or `R` for that; nothing where `mirror` would find none to exchange."""
    match = _SIDE.search(name)
    if match is None:
        return name, ""
    return name[: match.start()] + name[match.end() :], match[0][0].upper()


def _mirror_anchor(anchor: Position | Marker, axis: str) -> Position | Marker:
    if isinstance(anchor, Marker):
        return Marker(_exchange_sides(anchor.marker))
    x, y, z = (0.0 - value if axis == name else value for name, value in zip("xyz", anchor, strict=True))
    return (x, y, z)


def _mirrored(values: Mapping[str, Any], axis: str) -> dict[str, Any]:
    """The keys of the tool on the other side: whatever names one side names the other."""
    other = dict(values)
    other["name"] = _exchange_sides(values["name"])
    for key in ("origin", "target"):
        if key in values:
            other[key] = _mirror_anchor(values[key], axis)
    if isinstance(values.get("node"), str):
        other["node"] = _exchange_sides(values["node"])
    if isinstance(driver := values.get("rest_length"), RestLengthMorph):
        other["rest_length"] = replace(driver, morph=_exchange_sides(driver.morph))
    return other


def _ends(values: Mapping[str, Any]) -> set[Position | Marker]:
    return {values["origin"], values["target"]}


def _y_up(anchor: Position | Marker, up: str) -> Position | Marker:
    if up == "y" or isinstance(anchor, Marker):
        return anchor
    x, y, z = anchor
    return (x, z, 0.0 - y)


def _tools(
    root: Node, defaults: Mapping[str, Any], inherited: Collection[str]
) -> tuple[list[tuple[dict[str, Any], str, int]], list[Problem]]:
    """All tools in the file's axes, mirrored ones too: keys that the file gives, path and line of each."""
    node = root.children.get("tools")
    if node is None:
        return [], []
    if not isinstance(node.value, list) or not 1 <= len(node.value) <= MAX_TOOLS:
        message = f"found {node.shown}, expected a list of 1 to {MAX_TOOLS:,} tools"
        return [], [Problem(node.line, "tools", message)]
    problems: list[Problem] = []
    tools: list[tuple[dict[str, Any], str, Node]] = []
    owners: dict[str, str] = {}  # who has an identifier
    for i, child in node.children.items():
        path = path_to("tools", i)
        values, found = _fill(ToolModel, child, path, inherited=inherited)
        problems += found
        values = {**defaults, **values}
        tools.append((values, path, child))
        if "name" in values:
            owner = owners.setdefault(_identifier(values["name"]), path)
            if owner != path:
                name = child.children["name"]
                message = f"found {name.shown}, but {owner} has that name: they must differ in letters, digits or _"
                problems.append(Problem(name.line, f"{path}.name", message))
        if "origin" in values and values["origin"] == values.get("target"):
            line = child.children["target"].line
            problems.append(Problem(line, f"{path}.target", "same as origin, expected another point"))
    result: list[tuple[dict[str, Any], str, int]] = []
    for values, path, child in tools:
        axis = values.pop("mirror", None)
        result.append((values, path, child.line))
        if axis in (None, "none") or "name" not in values:
            continue
        other = _mirrored(values, axis)
        shown, message = child.children["name"].shown, ""
        if other["name"] == values["name"]:
            message = f"found {shown}, expected a side to exchange for mirror, such as brow.L or left_brow"
        elif (identifier := _identifier(other["name"])) in owners:
            message = f"found {shown}, but its mirrored tool would have the name of {owners[identifier]}"
        elif {"origin", "target"} <= set(values) and _ends(other) == _ends(values):
            message = f"found {shown}, but its mirrored tool would lie on itself: remove mirror"
        if message:
            problems.append(Problem(child.children["name"].line, f"{path}.name", message))
        owners.setdefault(_identifier(other["name"]), f"the tool mirrored from {path}")
        note = f"{path} (mirrored as {printable(other['name'])})"
        result.append((other, note, child.line))
    return result, problems


def parse_tools(text: str, *, name: str = "<tools>") -> ToolsFile:
    """Read tools from YAML text.

    Args:
        text: The YAML.
        name: What error messages call it.

    Raises:
        ConfigError: All problems of the text, a line each, in the order of its lines.
    """
    shown_name = printable(name, len(name))
    root, problems = read_tree(text)
    header: dict[str, Any] = {}
    tools: list[tuple[dict[str, Any], str, int]] = []
    if root is not None:
        header, found = _fill(HeaderModel, root, "", apart=_PARTS)
        problems += found
        defaults: dict[str, Any] = {}
        inherited: Collection[str] = ()
        if (node := root.children.get("defaults")) and node.value is not None:
            defaults, found = _fill(ToolModel, node, "defaults", partial=True)
            inherited = {str(key) for key in node.children}
            inherited |= {near for key in inherited if (near := _nearest(key, ToolModel.model_fields))}
            problems += found
        tools, found = _tools(root, defaults, inherited)
        problems += found
    if problems:
        raise ConfigError.of_all(
            ConfigError(problem.message, where=f"{shown_name}:{problem.line}: {problem.path}".rstrip(": "))
            for problem in sorted(problems, key=lambda problem: problem.line)
        )
    up = header.get("up", "y")
    records = (
        WrinkleTool(
            **values | {key: _y_up(values[key], up) for key in ("origin", "target")},
            where=f"{shown_name}:{line}: {path}",
        )
        for values, path, line in tools
    )
    return ToolsFile(path=name, **header, tools=tuple(tool for tool in records if tool.enabled))


def load_tools(path: str | os.PathLike[str]) -> ToolsFile:
    """Read a file of tools.

    Args:
        path: The file; messages repeat it as it is given.

    Raises:
        ConfigError: The file cannot be read, or all of its problems, a line each, in the order of its lines.
    """
    name = os.fspath(path)
    shown_name = printable(name, len(name))
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConfigError(f"cannot be read: {reason}", where=shown_name) from None
    if len(data) > MAX_BYTES:
        raise ConfigError(f"larger than {MAX_BYTES // 1_000_000} MB, expected YAML", where=shown_name)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"found byte 0x{data[error.start]:02x}, expected UTF-8"
        raise ConfigError(message, where=f"{shown_name}:{line}") from None
    return parse_tools(text, name=name)
