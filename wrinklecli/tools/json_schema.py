"""JSON Schemas with messages, and records whose fields are the keys of a file.

`errorMessage`, which JSON Schema does not have, names the accepted values: the program's messages end with it, and the
language servers of JSON and YAML show it. `group` and `slider` say how programs show the control of a key. A schema
may have a function under `read`, which turns a value that fits into a field's value; schemas of keys are without it.
"""

import functools
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import MISSING, Field, field, fields
from typing import Any, NamedTuple, TypeAlias, TypeVar

from wrinklecli.choices import Group
from wrinklecli.frozen import dataclass

Schema: TypeAlias = dict[str, Any]
Reader: TypeAlias = Callable[[Any], Any]
_Record = TypeVar("_Record")
# What reads values of a type unless a schema says otherwise: YAML's 1 is a float too, and its 1.0 a whole number.
_READERS: dict[str, Reader] = {"number": float, "integer": int}


def expects(accepted: str, **keywords: Any) -> Schema:
    """Values that fit these keywords, and the message for others: `accepted`."""
    return {**keywords, "errorMessage": f"expected {accepted}"}


def slider(low: float, high: float, step: float, unit: str = "") -> Schema:
    """Values with these numbers on the slider of their control; others are typed, and all are without a slider."""
    return {"slider": {"minimum": low, "maximum": high, "step": step, **({"unit": unit} if unit else {})}}


def number(low: float, high: float, noun: str = "a number", *, step: float | None = None) -> Schema:
    """A number between two ends; with a step, a slider goes from one to the other."""
    ends = [f"{end:g}".replace("e+0", "e") for end in (low, high)]
    slides = {} if step is None else slider(low, high, step)
    return expects(f"{noun} from {ends[0]} to {ends[1]}", type="number", minimum=low, maximum=high, **slides)


def whole(low: int, high: int, *, slider_most: int | None = None) -> Schema:
    """A whole number between two ends, with the end of its slider, if it has one."""
    more = {} if slider_most is None else slider(low, slider_most, 1)
    return expects(f"a whole number from {low} to {high}", type="integer", minimum=low, maximum=high, **more)


def percentage(most: int, slider_most: float) -> Schema:
    """A percentage from 0 to another one, of two digits or 100, with the end of its slider."""
    tens, ones = divmod(most, 10)
    below = f"[0-9]|[1-{tens - 1}][0-9]" + (f"|{tens}[0-{ones - 1}]" if ones else "")
    return expects(
        f"a percentage from 0% to {most}%",
        type="string",
        maxLength=40,
        pattern=rf"^\+?0*({below})(\.[0-9]*)? ?%$|^\+?0*{most}(\.0*)? ?%$",
        read=read_percentage,
        **slider(0, slider_most, 0.5, "%"),
    )


def read_percentage(value: str | None) -> float | None:
    """A percentage as a ratio; None for none."""
    return None if value is None else float(value.rstrip("% ")) / 100.0


def one_of(*words: str, none: bool = False) -> Schema:
    """One of these words; with `none`, YAML's null too."""
    return expects(" or ".join([", ".join(words[:-1]), words[-1]]), enum=[*words, *([None] if none else [])])


class ListReader(NamedTuple):
    """Reads a list, each item by the same function."""

    read: Reader

    def __call__(self, value: Any) -> tuple[Any, ...]:
        """The fields' values of a list."""
        return tuple(map(self.read, value))


def list_of(items: Schema, low: int, high: int | None, accepted: str) -> Schema:
    """A list of `low` to `high` items."""
    limits = {"minItems": low} | ({} if high is None else {"maxItems": high})
    return expects(accepted, type="array", items=items, **limits, read=ListReader(reader_of(items)))


def mapping_of(keys: Mapping[str, Schema], required: tuple[str, ...] = ()) -> Schema:
    """A mapping of these keys; it has no message, which editors would show in place of the wrong key."""
    return {"type": "object", "properties": keys, "required": list(required), "additionalProperties": False}


def any_keys(values: Schema, accepted: str, low: int = 0) -> Schema:
    """A mapping of any keys to these values."""
    read = reader_of(values)
    return expects(
        accepted,
        type="object",
        additionalProperties=values,
        minProperties=low,
        read=lambda value: {name: read(each) for name, each in value.items()},
    )


def clip_keys(shown: str, *values: Schema, row: str = "", optional: int = 0, low: int = 0) -> Schema:
    """The keys of each clip, each a row of one value for each of these schemas; `optional` ones at the end may lack.

    Messages show a key as `shown`, and what is wrong with one as `row`, if that differs.
    """
    readers = [*map(reader_of, values)]
    one = expects(
        row or shown,
        type="array",
        prefixItems=[*values],
        minItems=len(values) - optional,
        maxItems=len(values),
        read=lambda value: tuple(read(each) for read, each in zip(readers, [*value, *[0.0] * optional], strict=False)),
    )
    every = list_of(one, 1, None, f"a list of one or more {shown}")
    return any_keys(every, f"a mapping of clip names to lists of {shown}", low)


def either(first: Schema, otherwise: Schema, *having: str) -> Schema:
    """One schema for lists, or for mappings that have one of some keys, and one for other values.

    Mappings need no key if none is named. `anyOf` would not name the fault in the schema that was meant.
    """
    required: list[Schema] = [{"required": [each]} for each in having]
    fitting = {"anyOf": required} if len(required) > 1 else required[0] if required else {}
    kind, readers = {"object": dict, "array": list}[first["type"]], (reader_of(otherwise), reader_of(first))

    def read(value: Any) -> Any:
        return readers[isinstance(value, kind) and (not having or not {*having}.isdisjoint(value))](value)

    return {"if": {"type": first["type"], **fitting}, "then": first, "else": otherwise, "read": read}


def reader_of(values: Schema) -> Reader:
    """The function that turns a value that fits a schema into a field's value; of words, `none` is None as null is."""
    if "read" in values:
        return values["read"]  # type: ignore[no-any-return]
    if None in values.get("enum", ()):
        return lambda value: None if value == "none" else value
    return _READERS.get(str(values.get("type")), lambda value: value)


def key_of(values: Schema, description: str, **default: Any) -> Schema:
    """Values of a key, and its meaning."""
    return {**without_readers(values), "description": description, **default}


def without_readers(values: Any) -> Any:
    """A schema as JSON holds it."""
    if isinstance(values, dict):
        return {name: without_readers(each) for name, each in values.items() if not callable(each)}
    return [*map(without_readers, values)] if isinstance(values, list) else values


@dataclass(frozen=True, slots=True, eq=False)
class Items:
    """Items of a list, which inherit from the `defaults` of their file.

    Attributes:
        item: What messages call one of them, such as `tool`.
        keys: Schemas of their keys.
        own: Keys that are not inherited.
    """

    item: str
    keys: Mapping[str, Schema]
    own: Collection[str]

    @property
    def inherited(self) -> dict[str, Schema]:
        """Schemas of the keys that `defaults` may give."""
        return {name: schema for name, schema in self.keys.items() if name not in self.own}


def key(
    values: Schema,
    description: str,
    default: Any = MISSING,
    *,
    group: Group | None = None,
    read: Reader | None = None,
    name: str = "",
    absent: Any = MISSING,
    hashed: bool = True,
) -> Any:
    """A field of a record that a key of a file gives.

    Args:
        values: Schema of the key's values.
        description: Meaning of the key, for editors.
        default: Default as a file would write it; required keys have none.
        group: Group of controls that begins with the key; the record's further keys belong to it, up to the next one.
        read: Turns the file's value into the field's value, in place of the reader of the schema.
        name: The key, if it differs from the field's name.
        absent: The field's default, if it differs from `read(default)`.
        hashed: False for values that cannot be hashed.
    """
    said = {} if default is MISSING else {"default": default}
    read = read or reader_of(values)
    metadata = {"schema": key_of(values, description, **said), "group": group, "read": read, "name": name}
    if absent is MISSING and default is not MISSING:
        absent = read(default)
    hashing = None if hashed else False
    if isinstance(absent, dict):
        return field(default_factory=dict, metadata=metadata, hash=hashing)
    return field(default=absent, metadata=metadata, hash=hashing)


def keys_of(record: type) -> dict[str, Schema]:
    """The schemas of a record's keys, each with its group of controls."""
    found: dict[str, Schema] = {}
    group: Schema = {}
    for each in key_fields(record):
        group = {"group": each.metadata["group"]} if each.metadata["group"] else group
        found[each.metadata["name"] or each.name] = {**each.metadata["schema"], **group}
    return found


@functools.cache
def readers_of(record: type) -> Mapping[str, Reader]:
    """The functions that turn the values of a record's keys into the values of its fields."""
    return {each.metadata["name"] or each.name: each.metadata["read"] for each in key_fields(record)}


def defaults_of(record: type) -> dict[str, Any]:
    """The defaults of a record's keys, as a file would write them."""
    return {name: schema["default"] for name, schema in keys_of(record).items() if "default" in schema}


def schema_of(record: type) -> Schema:
    """A mapping of a record's keys; those of fields without a default are required."""
    required = (each for each in key_fields(record) if default_of(each) is MISSING)
    keys = mapping_of(keys_of(record), required=tuple(each.metadata["name"] or each.name for each in required))
    return {**keys, "read": functools.partial(read_record, record)}


def read_record(record: type[_Record], values: Mapping[str, Any]) -> _Record:
    """The record of a mapping that the record's schema accepts."""
    readers = readers_of(record)  # type: ignore[arg-type]
    return record(**{name: readers[name](value) for name, value in values.items()})


def default_of(field: Field[Any]) -> Any:
    """The default of a record's field; MISSING if it has to be given."""
    return field.default if field.default_factory is MISSING else field.default_factory()


def key_fields(record: type) -> Iterator[Field[Any]]:
    """The fields of a record that keys of a file give."""
    return (each for each in fields(record) if "schema" in each.metadata)


TEXT = expects("text, in quotes where YAML would read a number, true, false or null", type="string", minLength=1)
FLAG = expects("true or false", type="boolean")
LEAST_LENGTH = 1e-9  # a nanometre in metres
MOST_LENGTH = 1e9  # a metre in nanometres
SCENE_LENGTH = number(LEAST_LENGTH, MOST_LENGTH, "a length")
