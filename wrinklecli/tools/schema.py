"""The JSON Schema of a file of wrinkling tools, by which a bake checks files, and editors mark and complete them.

Source: JSON Schema, draft 2020-12. `read` checks order, sums and unique names, for which the schema has no words.
"""

from typing import Any

from wrinklecli.frozen import dataclass
from wrinklecli.tools.body import Flesh, Muscle, Touch
from wrinklecli.tools.fields import Field
from wrinklecli.tools.json_schema import Items, Schema, any_keys, expects, key_of, keys_of, list_of, mapping_of
from wrinklecli.tools.materials import presets
from wrinklecli.tools.records import PRESET_KEYS, ToolsFile, WrinkleTool

MAX_TOOLS = 1_000
OWN_KEYS = ("name", "origin", "target", "path")  # of each tool; no defaults
TOOL_KEYS = keys_of(WrinkleTool)


@dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """A kind of effects, which a list of the file holds.

    Attributes:
        items: Its keys.
        record: Record of one effect; `fields_of` gives its fields from the keys.
        schema: Schema of one effect.
        description: What the list means, for editors.
        points: The keys of an effect's points, of which no two are equal.
    """

    items: Items
    record: type[Any]
    schema: Schema
    description: str
    points: tuple[str, ...]


def _alone(
    record: type[Any], item: str, required: tuple[str, ...], description: str, points: tuple[str, ...], **more: Schema
) -> Kind:
    """A kind whose effects inherit nothing; `required` are keys besides the name, `more` are keywords of the schema."""
    keys = keys_of(record)
    schema = {**mapping_of(keys, required=("name", *required)), **more}
    description = f"{description} They inherit nothing from `defaults`."
    return Kind(Items(item, keys, tuple(keys)), record, schema, description, points)


_BALL: Schema = {"required": ["at", "radius"]}
_NONE_BESIDE_PATH: Schema = {
    "properties": dict.fromkeys(("towards", "keys"), expects("none beside along", **{"not": {}}))
}
KINDS = {
    "tools": Kind(
        Items("tool", TOOL_KEYS, OWN_KEYS),
        WrinkleTool,
        {
            **mapping_of(TOOL_KEYS, required=("name",)),
            "if": {"required": ["path"]},
            "then": {
                "properties": dict.fromkeys(
                    ("origin", "target"), expects("path alone, or origin and target", **{"not": {}})
                )
            },
            "else": {"required": ["origin", "target"]},
        },
        "The wrinkling tools.",
        ("origin", "target"),
    ),
    "muscles": _alone(
        Muscle,
        "muscle",
        ("origin", "insertion"),
        "Muscles below the skin, which thicken as they shorten.",
        ("origin", "insertion"),
    ),
    "flesh": _alone(
        Flesh,
        "region",
        (),
        "Regions of flesh, which swing after the joint that carries them.",
        ("at",),
        # A region is a ball, or what a mask or a joint outlines.
        **{
            "if": {"anyOf": [{"required": ["at"]}, {"required": ["radius"]}]},
            "then": _BALL,
            "else": {"if": {"not": {"anyOf": [{"required": ["mask"]}, {"required": ["joint"]}]}}, "then": _BALL},
        },
    ),
    "touches": _alone(
        Touch,
        "touch",
        ("at", "pad"),
        "Places where a tip slides the skin, which wrinkles in front of it.",
        ("at", "towards"),
        # Forward is along a path, and keys slide one place.
        **{"if": {"required": ["along"]}, "then": _NONE_BESIDE_PATH},
    ),
    "fields": _alone(Field, "field", (), "Fields of wrinkles over whole garments, where these are compressed.", ()),
}
"""The kinds of effects by the keys of their lists. A new kind is an entry, a record, and a field of `ToolsFile`."""

POINT_KEYS = tuple(dict.fromkeys(key for kind in KINDS.values() for key in kind.points))
"""The keys of points of effects of any kind."""

_INHERITED = mapping_of({name: each for kind in KINDS.values() for name, each in kind.items.inherited.items()})
_LISTS = {
    name: key_of(
        list_of(
            kind.schema, 1, MAX_TOOLS, f"a list of 1 to {MAX_TOOLS:,} {ToolsFile.LISTS[name][1]}, each begun by a dash"
        ),
        kind.description,
    )
    for name, kind in KINDS.items()
}

# Materials that give no width, with which a tool needs its own.
_WIDTHLESS = {"enum": [*(name for name, each in presets().items() if "width" not in each.keys), "none", None]}
# Without presets of its own, a file knows the built-in names alone.
_MATERIAL = TOOL_KEYS["material"]
_KNOWN = {"properties": {"material": {"enum": _MATERIAL["examples"], "errorMessage": _MATERIAL["errorMessage"]}}}

PRESETS_SCHEMA: Schema = any_keys(mapping_of(PRESET_KEYS), "a mapping of names to keys of tools")
"""The schema of a file of presets, and of what stands after `presets` in a tools file."""

TOOLS_SCHEMA: Schema = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "wrinkle tools",
    **mapping_of(
        {
            **keys_of(ToolsFile),
            "defaults": key_of(
                {**_INHERITED, "type": ["object", "null"]},
                "Keys that every tool inherits unless it has its own.",
                default=None,
            ),
            **_LISTS,
        },
        required=("version",),
    ),
    "allOf": [
        {"if": {"not": {"anyOf": [{"required": [name]} for name in KINDS]}}, "then": {"required": ["tools"]}},
        {
            # The width stands in the defaults, in each tool, or in a preset.
            "if": {
                "required": ["defaults"],
                "properties": {
                    "defaults": {
                        "type": "object",
                        "anyOf": [
                            {"required": ["width"]},
                            {"required": ["material"], "properties": {"material": {"not": _WIDTHLESS}}},
                        ],
                    }
                },
            },
            "else": {
                "properties": {
                    "tools": {
                        "items": {"if": {"properties": {"material": _WIDTHLESS}}, "then": {"required": ["width"]}}
                    }
                }
            },
        },
        {
            "if": {"not": {"required": ["presets"]}},
            "then": {"properties": {"defaults": _KNOWN, "tools": {"items": _KNOWN}}},
        },
    ],
}
