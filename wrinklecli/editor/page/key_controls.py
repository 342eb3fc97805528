"""Controls for the keys of effects, made from the schema of the tools file, so that a new key has its control at once.

A control says which values a key may have. How the page draws controls is the business of `controls`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from wrinklecli.choices import GROUPS
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import significant
from wrinklecli.tools.json_schema import Schema
from wrinklecli.tools.records import WrinkleTool
from wrinklecli.tools.schema import ITEMS

Kind = Literal["choice", "flag", "whole", "number", "percent", "length", "list", "record", "text", "json"]

_STEP = 0.01  # step of a number that is typed; smaller changes are not visible
NONE = "none"
# Keys that are set by the mouse on the mesh, by buttons, or clip by clip.
ELSEWHERE: Mapping[str, Sequence[str]] = {
    **{name: tuple({"name", "enabled", "clips"} & items.keys.keys()) for name, items in ITEMS.items()},
    "tools": (*WrinkleTool.own_keys, "enabled", "clips"),
}


@dataclass(frozen=True, slots=True)
class KeyControl:
    """The control of a key.

    Attributes:
        kind: Kind of values: `length` is a number in scene units or per cent; `list` holds numbers and `record` a
            mapping of them, each with a control of its own; `json` is any value, written as JSON.
        title: Label on the page, with a unit.
        choices: Words that the key may be.
        low: Least number.
        high: Greatest number.
        step: The smallest change of the number.
        slides: The number has a slider; otherwise it is typed.
        group: Heading.
        tip: The schema's description.
        default: Value if the file names none.
        parts: Controls for the numbers of a list or a record.
        also_json: The value may also be a mapping, written as JSON.
        whole: The choices are whole numbers.
    """

    key: str
    kind: Kind
    title: str
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 0.0
    step: float = _STEP
    slides: bool = False
    group: str = ""
    tip: str = ""
    default: Any = None
    parts: tuple["KeyControl", ...] = ()
    also_json: bool = False
    whole: bool = False


def key_controls(list_key: str = "tools") -> tuple[KeyControl, ...]:
    """Make the controls of all keys that have one, of the effects of a list, in the order of their groups."""
    keys = ITEMS[list_key].keys
    shown = [key for key in keys if key not in ELSEWHERE[list_key]]
    return tuple(_control(key, keys[key]) for key in sorted(shown, key=lambda key: GROUPS.index(keys[key]["group"])))


def _control(key: str, schema: Schema) -> KeyControl:
    made = _plain(key, schema)
    more = {name: schema[name] for name in ("group", "default") if name in schema}
    return replace(made, tip=schema.get("description", ""), **more)


def _plain(key: str, schema: Schema) -> KeyControl:
    """Make the control of a key, without the fields that do not depend on its kind."""
    title, plain = key.replace("_", " "), _without_mappings(schema)
    words, also_json, types = _words(plain), plain is not schema, plain.get("type", ())
    numbers = schema.get("then", {}).get("properties", {})
    if numbers and all(each.get("type") == "number" for each in numbers.values()):
        return KeyControl(key, "record", title, words, parts=tuple(_control(*each) for each in numbers.items()))
    if "enum" in plain or "examples" in plain:
        whole = all(isinstance(each, int) for each in plain.get("enum", [""]))
        return KeyControl(key, "choice", title, words, also_json=also_json, whole=whole)
    if "boolean" in types:
        return KeyControl(key, "flag", title)
    ends = next((part["slider"] for part in (plain, *plain.get("anyOf", ())) if "slider" in part), None)
    if ends or types == "number" or "integer" in types:
        return _number(key, plain, ends, words, also_json=also_json)
    if types == "array" and plain["items"].get("type") == "number":
        parts = (_control(f"{title} {number + 1}", plain["items"]) for number in range(plain["maxItems"]))
        return KeyControl(key, "list", title, parts=tuple(replace(part, low=0.0) for part in parts))
    return KeyControl(key, "text" if "string" in types and not also_json else "json", title)


def _number(key: str, schema: Schema, ends: Schema | None, words: tuple[str, ...], *, also_json: bool) -> KeyControl:
    """Make the control of a number, with the ends of its slider, or without one those of its values."""
    title, slides, unit = key.replace("_", " "), ends is not None, (ends or {}).get("unit")
    types = schema.get("type", ())
    kind: Kind = "whole" if "integer" in types else "number"
    if unit == "%":
        kind = "percent" if "string" in types and "number" not in types else "length"
    if unit and kind != "length":  # one of which may be in scene units
        title += f" ({unit})"
    ends = ends or {**schema, "step": 1 if kind == "whole" else _STEP}
    low, high, step = (ends[each] for each in ("minimum", "maximum", "step"))
    return KeyControl(key, kind, title, words, low, high, step, slides=slides, also_json=also_json)


def _without_mappings(schema: Schema) -> Schema:
    """The part of a schema that is about values other than mappings."""
    while "else" in schema:
        schema = schema["else"]
    return schema


def _words(schema: Schema) -> tuple[str, ...]:
    """The words that values may be; null counts as `none`."""
    parts = (schema, *schema.get("anyOf", ()))
    words = (word for part in parts for word in part.get("enum", part.get("examples", [part.get("const", False)])))
    return tuple(dict.fromkeys(NONE if word is None else str(word) for word in words if not isinstance(word, bool)))


def percent_of(value: Any, rest_distance: float) -> float:
    """Convert a length of the file to per cent of the tool's rest distance, scene units."""
    if isinstance(value, str) and value.strip().endswith("%"):
        return float(value.strip().removesuffix("%"))
    return 100.0 * float(value) / rest_distance


def as_written(control: KeyControl, value: Any, before: Any, rest_distance: float) -> Any:
    """Convert the value of a control to that of the file.

    Args:
        control: Control of the key.
        value: Value of the control: for a length, per cent or a word.
        before: Previous value of the file; a length in scene units stays in scene units.
        rest_distance: Rest distance of the tool, scene units.
    """
    if control.kind == "percent":
        return f"{value:g}%"
    if control.kind == "length" and not isinstance(value, str):
        if isinstance(before, (int, float)) and not isinstance(before, bool):
            return significant(value / 100 * rest_distance, 4)
        return f"{value:g}%"
    if control.kind == "whole" or (control.kind == "choice" and control.whole):
        return int(value)
    if control.kind == "number":
        return significant(value, 6)
    if control.kind == "text" and not value:
        return None
    return value
