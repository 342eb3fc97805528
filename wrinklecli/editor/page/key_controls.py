"""Controls for the keys of a tool, made from the schema of the tools file, so that a new key has its control at once.

A control says which values a key may have. How the page draws controls is the business of `controls`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from wrinklecli.numeric.arrays import significant
from wrinklecli.tools.json_schema import LENGTH, Schema
from wrinklecli.tools.schema import TOOL_KEYS

Kind = Literal["choice", "flag", "whole", "number", "percent", "length", "list", "record", "text", "json"]

_MAX_STEPS = 200  # steps of a slider; a finer one cannot be set by hand, so such numbers are typed
_STEP = 0.01  # step of a number; smaller changes are not visible
_COARSE_STEP = 0.1  # step of a number whose range has too many of the fine ones
_PERCENT_STEP = 0.5  # step of a length or share in per cent
_MIN_PERCENT = 1.0  # of the tool's rest distance, the least length that a slider offers; its box takes any
_MAX_PERCENT = 300.0  # of the rest distance, the greatest length that a slider offers
NONE = "none"

# The keys under each heading, in the order of work. Other keys stand under a last heading.
GROUPS: Mapping[str, Mapping[str, Sequence[str]]] = {
    "tools": {
        "Shape": ("material", "width", "bumps", "gap", "strategy", "max_height", "profile", "attenuation", "details"),
        "Irregularity": ("variation", "seed", "branch", "broken", "bow"),
        "Motion": ("compressible", "strength", "rest_length", "lag", "contact"),
        "Place": ("node", "snap", "mirror", "laid", "attachment", "optional", "mask", "stops"),
    },
    "muscles": {
        "Muscle": ("activation", "thickness", "width", "tendon", "travel"),
        "Place": ("origin", "insertion", "node", "mirror", "optional"),
    },
    "flesh": {
        "Flesh": ("frequency", "damping", "gravity", "limit", "radius", "shapes"),
        "Place": ("at", "joint", "mask", "meshes", "node", "mirror", "optional"),
    },
    "touches": {
        "Touch": ("pad", "reach", "grip", "press", "release", "wrinkles", "keys"),
        "Place": ("at", "towards", "mask", "node", "mirror", "optional"),
    },
}
_MAX_BELOW = 100.0  # of a muscle's length or a region's radius, likewise
_OTHERS = "More"
_WHOLE_PERCENTS = range(101)  # among which is the greatest one that a key may have
# Keys that are set by the mouse on the mesh, by buttons, or clip by clip.
ELSEWHERE: Mapping[str, Sequence[str]] = {
    "tools": ("name", "origin", "target", "path", "clips", "enabled"),
    "muscles": ("name", "enabled"),
    "flesh": ("name", "enabled"),
    "touches": ("name", "enabled"),
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
    slides: bool = False
    group: str = ""
    tip: str = ""
    default: Any = None
    parts: tuple["KeyControl", ...] = ()
    also_json: bool = False
    whole: bool = False

    @property
    def step(self) -> float:
        """The smallest change of the number."""
        if self.kind == "number":
            fine = (self.high - self.low) / _STEP <= _MAX_STEPS or not self.slides
            return _STEP if fine else _COARSE_STEP
        return 1 if self.kind == "whole" else _PERCENT_STEP if self.kind in ("percent", "length") else _STEP


def key_controls(keys: Mapping[str, Schema] = TOOL_KEYS, list_key: str = "tools") -> tuple[KeyControl, ...]:
    """Make the controls of all keys that have one, of the effects of a list, in the order of the list's groups."""
    groups = GROUPS[list_key]
    ordered = [key for group in groups.values() for key in group if key in keys]
    ordered += [key for key in keys if key not in ordered and key not in ELSEWHERE[list_key]]
    controls = (_control(key, keys[key], groups) for key in ordered)
    if list_key == "tools":
        return tuple(controls)
    # Nothing below the skin is longer than the muscle or the region itself.
    return tuple(replace(each, high=_MAX_BELOW) if each.kind == "length" else each for each in controls)


def _control(key: str, schema: Schema, groups: Mapping[str, Sequence[str]]) -> KeyControl:
    group = next((name for name, members in groups.items() if key in members), _OTHERS)
    made = _plain(key, schema)
    return replace(made, group=group, tip=schema.get("description", ""), default=schema.get("default"))


def _plain(key: str, schema: Schema) -> KeyControl:
    """Make the control of a key, without the fields that do not depend on its kind."""
    title, kinds = key.replace("_", " "), schema.get("type")
    low, high = schema.get("minimum", 0.0), schema.get("maximum", 0.0)
    if "enum" in schema or "examples" in schema:
        whole = all(isinstance(each, int) for each in schema.get("enum", [""]))
        return KeyControl(key, "choice", title, choices=_words(schema), whole=whole)
    if kinds == "boolean":
        return KeyControl(key, "flag", title)
    plain = _without_mappings(schema)
    if "properties" in plain or ("properties" in schema.get("then", {}) and "joint" in schema["then"]["properties"]):
        return KeyControl(key, "json", title)
    if _is_length(plain):
        words = tuple(word for each in plain.get("anyOf", ()) for word in _words(each))
        return KeyControl(
            key, "length", title, words, _MIN_PERCENT, _MAX_PERCENT, slides=True, also_json=plain is not schema
        )
    if kinds == "integer" or (isinstance(kinds, list) and "integer" in kinds):
        return KeyControl(key, "whole", title, (), int(low), int(high), slides=high - low < _MAX_STEPS)
    if kinds == "number":
        return KeyControl(
            key, "number", title, (), float(low), float(high), slides=(high - low) / _COARSE_STEP <= _MAX_STEPS
        )
    if kinds == "string" and "%" in schema.get("pattern", ""):
        most = max(percent for percent in _WHOLE_PERCENTS if re.search(schema["pattern"], f"{percent}%"))
        return KeyControl(key, "percent", f"{title} (%)", (), 0.0, float(most), slides=True)
    if kinds == "string" or kinds == ["string", "null"]:
        return KeyControl(key, "text", title)
    if kinds == "array" and schema["items"].get("type") == "number":
        parts = tuple(_control(f"{title} {number + 1}", schema["items"], {}) for number in range(schema["maxItems"]))
        return KeyControl(key, "list", title, parts=tuple(replace(part, low=0.0) for part in parts))
    numbers = schema.get("then", {}).get("properties", {})
    if numbers and plain is not schema and all(each.get("type") == "number" for each in numbers.values()):
        parts = tuple(_control(name, each, {}) for name, each in numbers.items())
        return KeyControl(key, "record", title, choices=_words(plain), parts=parts)
    words = tuple(word for word in plain.get("enum", ()) if isinstance(word, str))
    if words and plain is not schema:
        return KeyControl(key, "choice", title, choices=words, also_json=True)
    return KeyControl(key, "json", title)


def _without_mappings(schema: Schema) -> Schema:
    """The part of a schema that is about values other than mappings."""
    while "else" in schema:
        schema = schema["else"]
    return schema


def _is_length(schema: Schema) -> bool:
    """True if values may be lengths."""
    pattern = LENGTH["pattern"]
    return schema.get("pattern") == pattern or any(each.get("pattern") == pattern for each in schema.get("anyOf", ()))


def _words(schema: Schema) -> tuple[str, ...]:
    """The words that values may be; null counts as `none`."""
    words: list[Any] = schema.get("enum", []) or schema.get("examples", [])
    found = [*words, *([schema["const"]] if "const" in schema else [])]
    return tuple(dict.fromkeys(NONE if word is None else str(word) for word in found))


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
