"""Which control fits which key of a tool: made from the tools file's own schema, so a new key has its control at once.

A key's control says what may be entered, in the schema's words; nothing here knows how a page draws it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from wrinklecli.numeric.arrays import significant
from wrinklecli.tools.json_schema import LENGTH, Schema
from wrinklecli.tools.schema import TOOL_KEYS

Kind = Literal["choice", "flag", "whole", "number", "percent", "length", "list", "record", "text", "json"]

# A slider of more steps than this is no use for a hand: such numbers are typed.
_MOST_STEPS = 200
_STEP = 0.01  # of numbers that a slider sets, of which a hundredth is the least that anyone sees
# Lengths that a slider offers, per cent of the tool's rest distance; others may be typed into its box.
LEAST_PERCENT, MOST_PERCENT = 1.0, 300.0
_MOST_COMPRESSIBLE = 95.0  # per cent, as the schema's pattern has it
NONE = "none"

# Under which heading a key stands, in the order of work. What is not named here stands under the last.
GROUPS: Mapping[str, Sequence[str]] = {
    "Shape": ("material", "width", "bumps", "gap", "strategy", "max_height", "profile", "attenuation", "details"),
    "Grown": ("variation", "seed", "branch", "bow"),
    "Motion": ("compressible", "strength", "rest_length", "lag", "contact"),
    "Place": ("node", "snap", "mirror", "attachment", "optional"),
}
OTHERS = "More"
# Keys that are set otherwise: by the hand on the mesh, by buttons of the list, clip by clip.
ELSEWHERE = ("name", "origin", "target", "path", "clips", "enabled")


@dataclass(frozen=True, slots=True)
class KeyControl:
    """The control of a key.

    Attributes:
        key: Of a tool.
        kind: Of values: `length` is a number in scene units or per cent; `list` holds numbers and `record` a mapping
            of them, each with a control of its own; `json` is whatever its schema allows, as JSON writes it.
        title: What the page calls it, with its unit.
        choices: Words that the key may be.
        low: Least number.
        high: Greatest number.
        slides: Whether a slider sets the number; it is typed otherwise.
        group: The heading that it stands under.
        tip: The schema's description.
        default: Of a file that says nothing.
        parts: Of a list or a record, the controls of its numbers.
        also_json: Whether the value may be a mapping too, which is written as JSON.
    """

    key: str
    kind: Kind
    title: str
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 0.0
    slides: bool = False
    group: str = ""
    tip: str = ""
    default: Any = None
    parts: tuple["KeyControl", ...] = ()
    also_json: bool = False

    @property
    def step(self) -> float:
        """The least change of the number."""
        return 1 if self.kind == "whole" else 0.5 if self.kind in ("percent", "length") else _STEP


def key_controls(keys: Mapping[str, Schema] = TOOL_KEYS) -> tuple[KeyControl, ...]:
    """The controls of all keys of a tool that a control sets, in the order of the groups."""
    ordered = [key for group in GROUPS.values() for key in group if key in keys]
    ordered += [key for key in keys if key not in ordered and key not in ELSEWHERE]
    return tuple(_control(key, keys[key]) for key in ordered)


def _control(key: str, schema: Schema) -> KeyControl:
    group = next((name for name, members in GROUPS.items() if key in members), OTHERS)
    made = _plain(key, schema)
    return replace(made, group=group, tip=schema.get("description", ""), default=schema.get("default"))


def _plain(key: str, schema: Schema) -> KeyControl:
    """The control of a key, without what does not depend on the kind."""
    title, kinds = key.replace("_", " "), schema.get("type")
    low, high = schema.get("minimum", 0.0), schema.get("maximum", 0.0)
    if "enum" in schema:
        return KeyControl(key, "choice", title, choices=_words(schema))
    if kinds == "boolean":
        return KeyControl(key, "flag", title)
    plain = _without_mappings(schema)
    if _is_length(plain):
        words = tuple(word for each in plain.get("anyOf", ()) for word in _words(each))
        return KeyControl(
            key, "length", title, words, LEAST_PERCENT, MOST_PERCENT, slides=True, also_json=plain is not schema
        )
    if kinds == "integer" or (isinstance(kinds, list) and "integer" in kinds):
        return KeyControl(key, "whole", title, (), int(low), int(high), slides=high - low < _MOST_STEPS)
    if kinds == "number":
        return KeyControl(key, "number", title, (), float(low), float(high), slides=(high - low) / _STEP <= _MOST_STEPS)
    if kinds == "string" and "%" in schema.get("pattern", ""):
        return KeyControl(key, "percent", f"{title} (%)", (), 0.0, _MOST_COMPRESSIBLE, slides=True)
    if kinds == "string" or kinds == ["string", "null"]:
        return KeyControl(key, "text", title)
    if kinds == "array" and schema["items"].get("type") == "number":
        parts = tuple(_control(f"{title} {number + 1}", schema["items"]) for number in range(schema["maxItems"]))
        return KeyControl(key, "list", title, parts=tuple(replace(part, low=0.0) for part in parts))
    numbers = schema.get("then", {}).get("properties", {})
    if numbers and plain is not schema and all(each.get("type") == "number" for each in numbers.values()):
        parts = tuple(_control(name, each) for name, each in numbers.items())
        return KeyControl(key, "record", title, choices=_words(plain), parts=parts)
    words = tuple(word for word in plain.get("enum", ()) if isinstance(word, str))
    if words and plain is not schema:
        return KeyControl(key, "choice", title, choices=words, also_json=True)
    return KeyControl(key, "json", title)


def _without_mappings(schema: Schema) -> Schema:
    """What a schema says of values that are no mappings."""
    while "else" in schema:
        schema = schema["else"]
    return schema


def _is_length(schema: Schema) -> bool:
    """Whether values are lengths, alone or beside words."""
    pattern = LENGTH["pattern"]
    return schema.get("pattern") == pattern or any(each.get("pattern") == pattern for each in schema.get("anyOf", ()))


def _words(schema: Schema) -> tuple[str, ...]:
    """The words that values may be; `none` and null are one."""
    found = [*schema.get("enum", ()), *([schema["const"]] if "const" in schema else [])]
    return tuple(dict.fromkeys(NONE if word is None else str(word) for word in found))


def percent_of(value: Any, rest_distance: float) -> float:
    """A length as the file has it, per cent of the tool's rest distance in scene units."""
    if isinstance(value, str) and value.strip().endswith("%"):
        return float(value.strip().removesuffix("%"))
    return 100.0 * float(value) / rest_distance


def as_written(control: KeyControl, value: Any, before: Any, rest_distance: float) -> Any:
    """What the file says where a control has been set.

    Args:
        control: Of the key.
        value: Of the control; of lengths per cent, or one of the control's words.
        before: What the file said. A length in scene units stays one.
        rest_distance: Of the tool, scene units.
    """
    if control.kind == "percent":
        return f"{value:g}%"
    if control.kind == "length" and not isinstance(value, str):
        if isinstance(before, (int, float)) and not isinstance(before, bool):
            return significant(value / 100 * rest_distance, 4)
        return f"{value:g}%"
    if control.kind == "whole":
        return int(value)
    if control.kind == "number":
        return significant(value, 6)
    if control.kind == "text" and not value:
        return None
    return value
