"""What a file of wrinkling tools may say, as a JSON Schema: a bake checks files by it, an editor marks and completes.

Source: JSON Schema, draft 2020-12. Beyond it, `errorMessage` is what a refused value should have been: a bake puts it
behind what it found, and the language servers of JSON and YAML show it. What the schema has no words for (order, sums,
names that differ) `read` checks as it reads the values.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

Schema: TypeAlias = dict[str, Any]

MAX_TOOLS = 1_000
MAX_DETAILS = 4  # levels; a fifth is a 32nd of a bump, finer than any mesh here
MAX_POINTS = 64  # of a path
OWN_KEYS = ("name", "origin", "target", "path")  # of each tool; no defaults


def _expects(accepted: str, **keywords: Any) -> Schema:
    return {**keywords, "errorMessage": f"expected {accepted}"}


def _number(low: float, high: float, noun: str = "a number") -> Schema:
    ends = [f"{end:g}".replace("e+0", "e") for end in (low, high)]
    return _expects(f"{noun} from {ends[0]} to {ends[1]}", type="number", minimum=low, maximum=high)


def _whole(low: int, high: int) -> Schema:
    return _expects(f"a whole number from {low} to {high}", type="integer", minimum=low, maximum=high)


def _one_of(*words: str) -> Schema:
    return _expects(" or ".join([", ".join(words[:-1]), words[-1]]), enum=list(words))


def _list(items: Schema, low: int, high: int | None, accepted: str) -> Schema:
    limits = {"minItems": low} | ({} if high is None else {"maxItems": high})
    return _expects(accepted, type="array", items=items, **limits)


def _mapping(keys: Mapping[str, Schema], required: tuple[str, ...] = ()) -> Schema:
    """A mapping of these keys; without a message, which editors would show in place of the key that is wrong."""
    return {"type": "object", "properties": keys, "required": list(required), "additionalProperties": False}


def _any_keys(values: Schema, accepted: str, low: int = 0) -> Schema:
    return _expects(accepted, type="object", additionalProperties=values, minProperties=low)


def _if_mapping(mapping: Schema, otherwise: Schema, **having: Any) -> Schema:
    """One schema for mappings and one for the rest: `anyOf` would not say what is wrong in the one that was meant."""
    return {"if": {"type": "object", **having}, "then": mapping, "else": otherwise}


def _key(values: Schema, description: str, **default: Any) -> Schema:
    return {**values, "description": description, **default}


_TEXT = _expects("text, in quotes where YAML would read a number, true, false or null", type="string", minLength=1)
_FLAG = _expects("true or false", type="boolean")
_SECONDS = _number(0, 1e6, "seconds")
_STRENGTH = _number(-100, 100)

_LENGTHS = "a length from 1e-9 to 1e9 scene units or a percentage from 0.01% to 10000%"
_LENGTH = _expects(
    _LENGTHS,
    type=["number", "string"],
    minimum=1e-9,  # a nanometre in metres
    maximum=1e9,  # a metre in nanometres
    maxLength=40,
    pattern=r"^\+?0*([1-9][0-9]{0,3}(\.[0-9]*)?|10000(\.0*)?|\.(0?[1-9])[0-9]*) ?%$",
)
# What is said of items holds for lists alone, what is said of properties for mappings: both stand side by side.
_ANCHOR = _expects(
    "[x, y, z] or {marker: NODE}",
    type=["array", "object"],
    items=_number(-1e9, 1e9),
    minItems=3,
    maxItems=3,
    properties={"marker": _key(_TEXT, "Node whose position at rest is the anchor.")},
    required=["marker"],
    additionalProperties=False,
)

_REST = _if_mapping(
    _mapping(
        {
            "clip": _key(_TEXT, "Name of the clip."),
            "time": _key(_SECONDS, "Seconds from the clip's start. Default 0.", default=0.0),
        },
        required=("clip",),
    ),
    _expects("stored, bind or {clip: NAME, time: 0}", enum=["stored", "bind"]),
)

_CLIPS: Schema = {
    "if": {"type": "array"},
    "then": {
        **_list(_TEXT, 1, None, "all or a list of clip names"),
        "allOf": [_expects("each clip named once", uniqueItems=True)],
    },
    "else": _expects("all or a list of clip names", enum=["all"]),
}
_SAMPLING = _mapping(
    {
        "fps": _key(
            _number(0.1, 1000), "Samples per second, joined with the clip's own key times. Default 30.", default=30.0
        ),
        "clips": _key(_CLIPS, "Clips to bake: all, or a list of names. Default all.", default="all"),
    }
)

_REFINEMENT = _mapping(
    {
        "max_levels": _key(_whole(0, 8), "Most times that an edge is halved; 0 keeps the mesh. Default 4.", default=4),
        "edges_per_interval": _key(
            _whole(1, 16), "Edges on each control interval, half a bump; more is smoother. Default 2.", default=2
        ),
        "scheme": _key(
            _one_of("butterfly", "midpoint", "butterfly_full"),
            "butterfly rounds a little, midpoint keeps the shape, butterfly_full rounds all. Default butterfly.",
            default="butterfly",
        ),
    }
)

_LAG = _if_mapping(
    _mapping(
        {
            "frequency": _key(
                _number(0.5, 60), "Swings per second of the tissue, were it not damped. Default 6.", default=6.0
            ),
            "damping": _key(
                _number(0.05, 10),
                "Below 1 heights overshoot and swing, from 1 on they do not. Default 0.5.",
                default=0.5,
            ),
        }
    ),
    _expects("{frequency: 6, damping: 0.5} or none", enum=["none", None]),
)

_KEY = _expects("[seconds, length]", type="array", prefixItems=[_SECONDS, _LENGTH], minItems=2, maxItems=2)
_KEYED = _mapping(
    {
        "keys": _key(
            _any_keys(
                _list(_KEY, 1, None, "a list of one or more [seconds, length]"),
                "a mapping of clip names to lists of [seconds, length]",
                low=1,
            ),
            "For each clip a list of [seconds, length], times rising.",
        )
    },
    required=("keys",),
)
_MORPHED = _mapping(
    {
        "morph": _key(_TEXT, "Name of the morph target."),
        "full": _key(_LENGTH, "Rest length at weight 1: a length or a percentage."),
    },
    required=("morph", "full"),
)
_REST_LENGTH = _if_mapping(
    _KEYED,
    _if_mapping(
        _MORPHED,
        _expects(
            f"auto, {_LENGTHS}, {{keys: {{CLIP: [[SECONDS, LENGTH], …]}}}} or {{morph: NAME, full: LENGTH}}",
            anyOf=[{"const": "auto"}, _LENGTH],
        ),
        anyOf=[{"required": ["morph"]}, {"required": ["full"]}],
    ),
    required=["keys"],
)

TOOL_KEYS = {
    "name": _key(_TEXT, "Unique name; also when all but letters, digits and _ is replaced by _."),
    "node": _key(
        {**_TEXT, "type": ["string", "null"]},
        "Node of the mesh; may be left out where one mesh deforms.",
        default=None,
    ),
    "origin": _key(_ANCHOR, "Where the wrinkles begin: world space at rest in scene units, or {marker: NODE}."),
    "target": _key(_ANCHOR, "Where they end; they run across the line from origin to target."),
    "path": _key(
        _list(_ANCHOR, 2, MAX_POINTS, f"a list of 2 to {MAX_POINTS} points, each [x, y, z] or {{marker: NODE}}"),
        "Points of a curve on the surface that wrinkles run across, in place of origin and target.",
    ),
    "snap": _key(
        _one_of("surface", "vertex"),
        "Anchors go to the nearest point of the surface, or vertex. Default surface.",
        default="surface",
    ),
    "mirror": _key(
        _expects("x, y, z or none", enum=["x", "y", "z", "none", None]),
        "Also make the tool of the other side: this coordinate, as the file writes it, negated, left and right "
        "exchanged in names. Default none.",
        default=None,
    ),
    "width": _key(_LENGTH, "Full width across the segment: a length or a percentage. Required."),
    "material": _key(
        _expects("skin, cloth, leather or none", enum=["skin", "cloth", "leather", "none", None]),
        "Gives bumps, auto heights, compressible, details and profile other defaults. Default none.",
        default=None,
    ),
    "strategy": _key(
        _one_of("everywhere", "origin", "both_ends"),
        "Which bumps rise first: all alike, from the origin, from both ends. Default everywhere.",
        default="everywhere",
    ),
    "bumps": _key(_whole(1, 64), "Wrinkles along the segment. Default 4, or the material's.", default=4),
    "gap": _key(_whole(0, 64), "Flat control intervals, half a bump each, between bumps. Default 0.", default=0),
    "max_height": _key(
        _expects(f"auto, none, {_LENGTHS}", anyOf=[{"enum": ["auto", "none", None]}, _LENGTH]),
        "Highest point of a bump: auto (a quarter of a rest bump's width, or the material's part), none, a length or a "
        "percentage. Default auto.",
        default="auto",
    ),
    "compressible": _key(
        _expects(
            "a percentage from 0% to 95%",
            type="string",
            maxLength=40,
            pattern=r"^\+?0*([0-9]|[1-8][0-9]|9[0-4])(\.[0-9]*)? ?%$|^\+?0*95(\.0*)? ?%$",
        ),
        "Share of every shortening that the tissue takes itself; the rest makes wrinkles. Default 0%, or the "
        "material's.",
        default="0%",
    ),
    "details": _key(
        _list(_number(0.001, 0.99), 0, MAX_DETAILS, f"a list of up to {MAX_DETAILS} shares"),
        "Shares of the shortening that go into ever finer wrinkles on the bumps. Default [], or the material's.",
        default=[],
    ),
    "profile": _key(
        _one_of("smooth", "polyline"),
        "Shape of a bump: smooth, or the paper's polyline. Default smooth, or the material's.",
        default="smooth",
    ),
    "bow": _key(
        _number(-1, 1),
        "Bends crests like an arc, their ends towards the target; negative: origin. Default 0.",
        default=0.0,
    ),
    "attenuation": _key(
        _one_of("bell", "linear"), "How a wrinkle fades across the width. Default bell.", default="bell"
    ),
    "attachment": _key(
        _one_of("skin", "patch"),
        "Wrinkles stay on the skin, or the patch is projected anew. Default skin.",
        default="skin",
    ),
    "strength": _key(
        _STRENGTH, "Factor of the height; negative is inward; not 1 gives up length. Default 1.", default=1.0
    ),
    "clips": _key(
        _any_keys(_STRENGTH, "a mapping of clip names to strengths"),
        "Strength in a clip instead of `strength`; 0 switches it off. Default {}.",
        default={},
    ),
    "rest_length": _key(
        _REST_LENGTH,
        "Length from which shortening counts: auto (the rest distance), a length, a percentage, {keys: …} by hand, "
        "{morph: …} by a morph target. Default auto.",
        default="auto",
    ),
    "lag": _key(
        _LAG,
        "Heights follow the shortening as a damped spring does: {frequency: 6, damping: 0.5}, or none. Default none.",
        default=None,
    ),
    "enabled": _key(_FLAG, "false: checked but not baked. Default true.", default=True),
    "optional": _key(_FLAG, "true: an absent node or clip is a note, not an error. Default false.", default=False),
}
_TOOL: Schema = {
    **_mapping(TOOL_KEYS, required=("name",)),
    "if": {"required": ["path"]},
    "then": {
        "properties": dict.fromkeys(("origin", "target"), _expects("path alone, or origin and target", **{"not": {}}))
    },
    "else": {"required": ["origin", "target"]},
}
_DEFAULTS = _mapping({name: values for name, values in TOOL_KEYS.items() if name not in OWN_KEYS})

TOOLS_SCHEMA: Schema = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "wrinkle tools",
    **_mapping(
        {
            "version": _key(_expects("1, the only version so far", const=1), "Version of this format. Required: 1."),
            "up": _key(
                _one_of("y", "z"),
                "Axis of the positions: y (glTF) or z (as Blender shows them). Default y.",
                default="y",
            ),
            "rest": _key(_REST, "Pose in which the tools are attached. Default stored.", default="stored"),
            "sampling": _key(_SAMPLING, "Times at which clips are evaluated.", default={"fps": 30.0, "clips": "all"}),
            "refinement": _key(
                _REFINEMENT,
                "Subdivision under the wrinkles.",
                default={"max_levels": 4, "edges_per_interval": 2, "scheme": "butterfly"},
            ),
            "defaults": _key(
                {**_DEFAULTS, "type": ["object", "null"]},
                "What every tool inherits where it does not say otherwise.",
                default=None,
            ),
            "tools": _key(
                _list(
                    _TOOL,
                    1,
                    MAX_TOOLS,
                    f"a list of 1 to {MAX_TOOLS:,} tools, each begun by a dash",
                ),
                "The wrinkling tools.",
            ),
        },
        required=("version", "tools"),
    ),
    # The width stands either in the defaults or in each tool.
    "if": {"required": ["defaults"], "properties": {"defaults": {"type": "object", "required": ["width"]}}},
    "else": {"properties": {"tools": {"items": {"required": ["width"]}}}},
}
