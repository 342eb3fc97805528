"""JSON Schemas with messages: what a key of a file of ours may hold, and what is said of a value that it may not.

Beyond JSON Schema, `errorMessage` is what a refused value should have been: the program puts it behind what it found,
and the language servers of JSON and YAML show it.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

Schema: TypeAlias = dict[str, Any]


def expects(accepted: str, **keywords: Any) -> Schema:
    """Values of these keywords, with what is said of others."""
    return {**keywords, "errorMessage": f"expected {accepted}"}


def number(low: float, high: float, noun: str = "a number") -> Schema:
    """A number within these ends."""
    ends = [f"{end:g}".replace("e+0", "e") for end in (low, high)]
    return expects(f"{noun} from {ends[0]} to {ends[1]}", type="number", minimum=low, maximum=high)


def whole(low: int, high: int) -> Schema:
    """A whole number within these ends."""
    return expects(f"a whole number from {low} to {high}", type="integer", minimum=low, maximum=high)


def one_of(*words: str, none: bool = False) -> Schema:
    """One of these words, or null where `none` is one of them and YAML's own null says the same."""
    return expects(" or ".join([", ".join(words[:-1]), words[-1]]), enum=[*words, *([None] if none else [])])


def list_of(items: Schema, low: int, high: int | None, accepted: str) -> Schema:
    """A list of so many items."""
    limits = {"minItems": low} | ({} if high is None else {"maxItems": high})
    return expects(accepted, type="array", items=items, **limits)


def mapping_of(keys: Mapping[str, Schema], required: tuple[str, ...] = ()) -> Schema:
    """A mapping of these keys; without a message, which editors would show in place of the key that is wrong."""
    return {"type": "object", "properties": keys, "required": list(required), "additionalProperties": False}


def any_keys(values: Schema, accepted: str, low: int = 0) -> Schema:
    """A mapping of any keys to such values."""
    return expects(accepted, type="object", additionalProperties=values, minProperties=low)


def if_mapping(mapping: Schema, otherwise: Schema, **having: Any) -> Schema:
    """One schema for mappings and one for the rest: `anyOf` would not say what is wrong in the one that was meant."""
    return {"if": {"type": "object", **having}, "then": mapping, "else": otherwise}


def key_of(values: Schema, description: str, **default: Any) -> Schema:
    """Values of a key, with what it means."""
    return {**values, "description": description, **default}


TEXT = expects("text, in quotes where YAML would read a number, true, false or null", type="string", minLength=1)
FLAG = expects("true or false", type="boolean")
LENGTHS = "a length from 1e-9 to 1e9 scene units or a percentage from 0.01% to 10000%"
LENGTH = expects(
    LENGTHS,
    type=["number", "string"],
    minimum=1e-9,  # a nanometre in metres
    maximum=1e9,  # a metre in nanometres
    maxLength=40,
    pattern=r"^\+?0*([1-9][0-9]{0,3}(\.[0-9]*)?|10000(\.0*)?|\.(0?[1-9])[0-9]*) ?%$",
)
