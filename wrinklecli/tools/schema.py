"""What a file of wrinkling tools may say, as a JSON Schema: a bake checks files by it, an editor marks and completes.

Source: JSON Schema, draft 2020-12. What the schema has no words for (order, sums, names that differ) `read` checks as
it reads the values.
"""

from typing import get_args

from wrinklecli.choices import (
    Attachment,
    Attenuation,
    Axis,
    MaterialName,
    Profile,
    RestPose,
    Scheme,
    Snap,
    Strategy,
    Up,
)
from wrinklecli.tools.json_schema import (
    FLAG,
    LENGTH,
    LENGTHS,
    TEXT,
    Schema,
    any_keys,
    expects,
    if_mapping,
    key_of,
    list_of,
    mapping_of,
    number,
    one_of,
    whole,
)

MAX_TOOLS = 1_000
MAX_DETAILS = 4  # levels; a fifth is a 32nd of a bump, finer than any mesh here
MAX_POINTS = 64  # of a path
MAX_SEED = 2**31 - 1  # what any language's whole numbers hold
OWN_KEYS = ("name", "origin", "target", "path")  # of each tool; no defaults

_SECONDS = number(0, 1e6, "seconds")
_STRENGTH = number(-100, 100)

# What is said of items holds for lists alone, what is said of properties for mappings: both stand side by side.
_ANCHOR = expects(
    "[x, y, z] or {marker: NODE}",
    type=["array", "object"],
    items=number(-1e9, 1e9),
    minItems=3,
    maxItems=3,
    properties={"marker": key_of(TEXT, "Node whose position at rest is the anchor.")},
    required=["marker"],
    additionalProperties=False,
)

_REST = if_mapping(
    mapping_of(
        {
            "clip": key_of(TEXT, "Name of the clip."),
            "time": key_of(_SECONDS, "Seconds from the clip's start. Default 0.", default=0.0),
        },
        required=("clip",),
    ),
    expects(f"{', '.join(get_args(RestPose))} or {{clip: NAME, time: 0}}", enum=[*get_args(RestPose)]),
)

_CLIPS: Schema = {
    "if": {"type": "array"},
    "then": {
        **list_of(TEXT, 1, None, "all or a list of clip names"),
        "allOf": [expects("each clip named once", uniqueItems=True)],
    },
    "else": expects("all or a list of clip names", enum=["all"]),
}
_SAMPLING = mapping_of(
    {
        "fps": key_of(
            number(0.1, 1000), "Samples per second, joined with the clip's own key times. Default 30.", default=30.0
        ),
        "clips": key_of(_CLIPS, "Clips to bake: all, or a list of names. Default all.", default="all"),
    }
)

_REFINEMENT = mapping_of(
    {
        "max_levels": key_of(whole(0, 8), "Most times that an edge is halved; 0 keeps the mesh. Default 4.", default=4),
        "edges_per_interval": key_of(
            whole(1, 16), "Edges on each control interval, half a bump; more is smoother. Default 2.", default=2
        ),
        "scheme": key_of(
            one_of(*get_args(Scheme)),
            "butterfly rounds a little, midpoint keeps the shape, butterfly_full rounds all. Default butterfly.",
            default="butterfly",
        ),
    }
)

_LAG = if_mapping(
    mapping_of(
        {
            "frequency": key_of(
                number(0.5, 60), "Swings per second of the tissue, were it not damped. Default 6.", default=6.0
            ),
            "damping": key_of(
                number(0.05, 10),
                "Below 1 heights overshoot and swing, from 1 on they do not. Default 0.5.",
                default=0.5,
            ),
        }
    ),
    expects("{frequency: 6, damping: 0.5} or none", enum=["none", None]),
)

_CONTACT = if_mapping(
    mapping_of(
        {
            "per_clip": key_of(
                FLAG,
                "true: a clip that still crosses with the targets of all clips gets targets of its own. Default false.",
                default=False,
            ),
            "ignore": key_of(
                list_of(TEXT, 0, None, "a list of node names"),
                "Nodes whose meshes may go through the tool's. Default [].",
                default=[],
            ),
        }
    ),
    # To YAML 1.1, which is read, off is false.
    expects("off, resolve or {per_clip: false, ignore: []}", enum=["off", "resolve", False]),
)

_KEY = expects("[seconds, length]", type="array", prefixItems=[_SECONDS, LENGTH], minItems=2, maxItems=2)
_KEYED = mapping_of(
    {
        "keys": key_of(
            any_keys(
                list_of(_KEY, 1, None, "a list of one or more [seconds, length]"),
                "a mapping of clip names to lists of [seconds, length]",
                low=1,
            ),
            "For each clip a list of [seconds, length], times rising.",
        )
    },
    required=("keys",),
)
_MORPHED = mapping_of(
    {
        "morph": key_of(TEXT, "Name of the morph target."),
        "full": key_of(LENGTH, "Rest length at weight 1: a length or a percentage."),
    },
    required=("morph", "full"),
)
_REST_LENGTH = if_mapping(
    _KEYED,
    if_mapping(
        _MORPHED,
        expects(
            f"auto, {LENGTHS}, {{keys: {{CLIP: [[SECONDS, LENGTH], …]}}}} or {{morph: NAME, full: LENGTH}}",
            anyOf=[{"const": "auto"}, LENGTH],
        ),
        anyOf=[{"required": ["morph"]}, {"required": ["full"]}],
    ),
    required=["keys"],
)

TOOL_KEYS = {
    "name": key_of(TEXT, "Unique name; also when all but letters, digits and _ is replaced by _."),
    "node": key_of(
        {**TEXT, "type": ["string", "null"]},
        "Node of the mesh; may be left out where one mesh deforms.",
        default=None,
    ),
    "origin": key_of(_ANCHOR, "Where the wrinkles begin: world space at rest in scene units, or {marker: NODE}."),
    "target": key_of(_ANCHOR, "Where they end; they run across the line from origin to target."),
    "path": key_of(
        list_of(_ANCHOR, 2, MAX_POINTS, f"a list of 2 to {MAX_POINTS} points, each [x, y, z] or {{marker: NODE}}"),
        "Points of a curve on the surface that wrinkles run across, in place of origin and target.",
    ),
    "snap": key_of(
        one_of(*get_args(Snap)),
        "Anchors go to the nearest point of the surface, or vertex. Default surface.",
        default="surface",
    ),
    "mirror": key_of(
        one_of(*get_args(Axis), "none", none=True),
        "Also make the tool of the other side: this coordinate, as the file writes it, negated, left and right "
        "exchanged in names. Default none.",
        default=None,
    ),
    "width": key_of(LENGTH, "Full width across the segment: a length or a percentage. Required."),
    "material": key_of(
        one_of(*get_args(MaterialName), "none", none=True),
        "Gives bumps, auto heights, compressible, details, profile and variation other defaults. Default none.",
        default=None,
    ),
    "strategy": key_of(
        one_of(*get_args(Strategy)),
        "Which bumps rise first: all alike, from the origin, from both ends. Default everywhere.",
        default="everywhere",
    ),
    "bumps": key_of(whole(1, 64), "Wrinkles along the segment. Default 4, or the material's.", default=4),
    "gap": key_of(whole(0, 64), "Flat control intervals, half a bump each, between bumps. Default 0.", default=0),
    "max_height": key_of(
        expects(f"auto, none, {LENGTHS}", anyOf=[{"enum": ["auto", "none", None]}, LENGTH]),
        "Highest point of a bump: auto (a quarter of a rest bump's width, or the material's part), none, a length or a "
        "percentage. Default auto.",
        default="auto",
    ),
    "compressible": key_of(
        expects(
            "a percentage from 0% to 95%",
            type="string",
            maxLength=40,
            pattern=r"^\+?0*([0-9]|[1-8][0-9]|9[0-4])(\.[0-9]*)? ?%$|^\+?0*95(\.0*)? ?%$",
        ),
        "Share of every shortening that the tissue takes itself; the rest makes wrinkles. Default 0%, or the "
        "material's.",
        default="0%",
    ),
    "details": key_of(
        list_of(number(0.001, 0.99), 0, MAX_DETAILS, f"a list of up to {MAX_DETAILS} shares"),
        "Shares of the shortening that go into ever finer wrinkles on the bumps. Default [], or the material's.",
        default=[],
    ),
    "profile": key_of(
        one_of(*get_args(Profile)),
        "Shape of a bump: smooth; skin, with narrow furrows; cloth, which leans; polyline, the paper's. Default "
        "smooth, or the material's.",
        default="smooth",
    ),
    "bow": key_of(
        number(-1, 1),
        "Bends crests like an arc, their ends towards the target; negative: origin. Default 0.",
        default=0.0,
    ),
    "variation": key_of(
        number(0, 1),
        "How irregular the bumps are: 0 is ruled, 1 the most. Default 0.3, or the material's.",
        default=0.3,
    ),
    "seed": key_of(
        {**whole(0, MAX_SEED), "type": ["integer", "null"]},
        "Which irregularity it is; a tool and its mirror image with one seed have mirrored wrinkles. Default: from the "
        "name.",
        default=None,
    ),
    "branch": key_of(
        number(0, 1), "Chance of a bump to merge with its neighbour, where variation is. Default 0.25.", default=0.25
    ),
    "attenuation": key_of(
        one_of(*get_args(Attenuation)), "How a wrinkle fades across the width. Default bell.", default="bell"
    ),
    "attachment": key_of(
        one_of(*get_args(Attachment)),
        "Wrinkles stay on the skin, or the patch is projected anew. Default skin.",
        default="skin",
    ),
    "strength": key_of(
        _STRENGTH, "Factor of the height; negative is inward; not 1 gives up length. Default 1.", default=1.0
    ),
    "clips": key_of(
        any_keys(_STRENGTH, "a mapping of clip names to strengths"),
        "Strength in a clip instead of `strength`; 0 switches it off. Default {}.",
        default={},
    ),
    "rest_length": key_of(
        _REST_LENGTH,
        "Length from which shortening counts: auto (the rest distance), a length, a percentage, {keys: …} by hand, "
        "{morph: …} by a morph target. Default auto.",
        default="auto",
    ),
    "lag": key_of(
        _LAG,
        "Heights follow the shortening as a damped spring does: {frequency: 6, damping: 0.5}, or none. Default none.",
        default=None,
    ),
    "contact": key_of(
        _CONTACT,
        "resolve, or a mapping of what else it shall do: folds that touch never cross. Default off.",
        default="off",
    ),
    "enabled": key_of(FLAG, "false: checked but not baked. Default true.", default=True),
    "optional": key_of(FLAG, "true: an absent node or clip is a note, not an error. Default false.", default=False),
}
_TOOL: Schema = {
    **mapping_of(TOOL_KEYS, required=("name",)),
    "if": {"required": ["path"]},
    "then": {
        "properties": dict.fromkeys(("origin", "target"), expects("path alone, or origin and target", **{"not": {}}))
    },
    "else": {"required": ["origin", "target"]},
}
_DEFAULTS = mapping_of({name: values for name, values in TOOL_KEYS.items() if name not in OWN_KEYS})

TOOLS_SCHEMA: Schema = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "wrinkle tools",
    **mapping_of(
        {
            "version": key_of(expects("1, the only version so far", const=1), "Version of this format. Required: 1."),
            "up": key_of(
                one_of(*get_args(Up)),
                "Axis of the positions: y (glTF) or z (as Blender shows them). Default y.",
                default="y",
            ),
            "rest": key_of(_REST, "Pose in which the tools are attached. Default stored.", default="stored"),
            "sampling": key_of(_SAMPLING, "Times at which clips are evaluated.", default={"fps": 30.0, "clips": "all"}),
            "refinement": key_of(
                _REFINEMENT,
                "Subdivision under the wrinkles.",
                default={"max_levels": 4, "edges_per_interval": 2, "scheme": "butterfly"},
            ),
            "defaults": key_of(
                {**_DEFAULTS, "type": ["object", "null"]},
                "What every tool inherits where it does not say otherwise.",
                default=None,
            ),
            "tools": key_of(
                list_of(
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
