"""The JSON Schema of a file of wrinkling tools, by which a bake checks files, and editors mark and complete them.

Source: JSON Schema, draft 2020-12. `read` checks order, sums and unique names, for which the schema has no words.
"""

from importlib import import_module

from wrinklecli.choices import EFFECTS
from wrinklecli.tools.json_schema import (
    Items,
    Schema,
    any_keys,
    key_of,
    keys_of,
    list_of,
    mapping_of,
    schema_of,
    without_readers,
)
from wrinklecli.tools.materials import presets
from wrinklecli.tools.records import PRESET_KEYS, EffectTool, ToolsFile, WrinkleTool

MAX_TOOLS = 1_000
TOOL_KEYS = keys_of(WrinkleTool)


def _record(path: str) -> type[EffectTool]:
    module, _, name = path.rpartition(".")
    record: type[EffectTool] = getattr(import_module(f"wrinklecli.{module}"), name)
    return record


KINDS = {
    section: _record(path)
    for section, (_, path) in sorted(EFFECTS.items(), key=lambda each: each[0] != "tools")
    if path is not None
}
"""The records of effects by the keys of their lists, tools first."""

ITEMS = {
    section: Items(kind.words[0], keys := keys_of(kind), tuple(keys) if kind.own_keys is None else kind.own_keys)
    for section, kind in KINDS.items()
}
"""The items of the lists of effects."""

POINT_KEYS = tuple(dict.fromkeys(key for kind in KINDS.values() for key in kind.point_keys))
"""The keys of points of effects of any kind."""

_INHERITED = mapping_of({name: each for items in ITEMS.values() for name, each in items.inherited.items()})
_LISTS = {
    section: key_of(
        list_of(
            {**schema_of(kind), **kind.keywords},
            1,
            MAX_TOOLS,
            f"a list of 1 to {MAX_TOOLS:,} {kind.words[1]}, each begun by a dash",
        ),
        kind.meaning + ("" if ITEMS[section].inherited else " They inherit nothing from `defaults`."),
    )
    for section, kind in KINDS.items()
}

# Materials that give no width, with which a tool needs its own.
_WIDTHLESS = {"enum": [*(name for name, each in presets().items() if "width" not in each.keys), "none", None]}
_GIVES_WIDTH = {
    "type": "object",
    "anyOf": [
        {"required": ["width"]},
        {"required": ["material"], "properties": {"material": {"not": _WIDTHLESS}}},
    ],
}
_NEEDS_WIDTH = {"if": {"properties": {"material": _WIDTHLESS}}, "then": {"required": ["width"]}}
# Without presets of its own, a file knows the built-in names alone.
_MATERIAL = TOOL_KEYS["material"]
_KNOWN = {"properties": {"material": {"enum": _MATERIAL["examples"], "errorMessage": _MATERIAL["errorMessage"]}}}

PRESETS_SCHEMA: Schema = without_readers(any_keys(mapping_of(PRESET_KEYS), "a mapping of names to keys of tools"))
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
            "if": {"required": ["defaults"], "properties": {"defaults": _GIVES_WIDTH}},
            "else": {"properties": {"tools": {"items": _NEEDS_WIDTH}}},
        },
        {
            "if": {"not": {"required": ["presets"]}},
            "then": {"properties": {"defaults": _KNOWN, "tools": {"items": _KNOWN}}},
        },
    ],
}
