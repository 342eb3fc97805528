"""Checks a YAML tree by a JSON Schema: each problem gets its line, its path and a hint at the word that was meant.

Source: JSON Schema, draft 2020-12. Differs: only the keywords of our schemas are known, and a pattern is that of the
whole text. Importing a library that knows them all, and compiling a schema with it, takes a twentieth of a small bake.
"""

import difflib
import functools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from wrinklecli.errors import SHOWN
from wrinklecli.frozen import dataclass
from wrinklecli.tools.json_schema import Items, Schema
from wrinklecli.tools.yaml_tree import Node, Problem, path_to

Place: TypeAlias = tuple[str | int, ...]  # keys and indices that lead to a value


@dataclass(frozen=True, slots=True, eq=False)
class Format:
    """The format of a file: its schema, and the items of its lists, which inherit from its `defaults`."""

    schema: Schema
    kinds: Sequence[Items]


def _is(value: Any, kind: str) -> bool:
    """True if a value has a type of JSON Schema: 1.0 is an integer, and true is no number."""
    if kind == "integer":
        return _is(value, "number") and (isinstance(value, int) or value.is_integer())
    return isinstance(value, _TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))


_TYPES: Mapping[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "number": (int, float),
    "boolean": bool,
    "null": type(None),
}
# The type of values that a keyword judges, and its judgement of a value by what stands behind it.
_ACCEPTS: Mapping[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "minimum": ("number", lambda value, least: value >= least),
    "maximum": ("number", lambda value, most: value <= most),
    "minLength": ("string", lambda value, least: len(value) >= least),
    "maxLength": ("string", lambda value, most: len(value) <= most),
    "pattern": ("string", lambda value, pattern: re.fullmatch(pattern, value) is not None),
    "minItems": ("array", lambda value, least: len(value) >= least),
    "maxItems": ("array", lambda value, most: len(value) <= most),
    "uniqueItems": ("array", lambda value, _: all(each not in value[:k] for k, each in enumerate(value))),
    "minProperties": ("object", lambda value, least: len(value) >= least),
    "required": ("object", lambda value, keys: all(key in value for key in keys)),
}


def faults(value: Any, schema: Schema, place: Place = ()) -> Iterator[tuple[Place, Schema, str]]:
    """Find the faults of a value: the place of each below a `place`, and the schema and its keyword that refuse it."""

    def fits(part: Schema) -> bool:
        return next(faults(value, part, place), None) is None

    for keyword, given in schema.items():
        accepted = True
        match keyword:
            case "type":
                accepted = any(_is(value, kind) for kind in ([given] if isinstance(given, str) else given))
            case "enum" | "const":
                words = given if keyword == "enum" else [given]
                accepted = any(value == each and isinstance(value, bool) == isinstance(each, bool) for each in words)
            case "anyOf":
                accepted = any(fits(each) for each in given)
            case "not":
                accepted = not fits(given)
            case "allOf":
                for each in given:
                    yield from faults(value, each, place)
            case "if":
                yield from faults(value, schema.get("then" if fits(given) else "else", {}), place)
            case "properties" if isinstance(value, dict):
                for key in (key for key in value if key in given):
                    yield from faults(value[key], given[key], (*place, key))
            case "additionalProperties" if isinstance(value, dict):
                others = [key for key in value if key not in schema.get("properties", {})]
                accepted = given is not False or not others
                for key in others if accepted else ():
                    yield from faults(value[key], given, (*place, key))
            case "items" | "prefixItems" if isinstance(value, list):
                for index, each in enumerate(value):
                    if keyword == "items" or index < len(given):
                        yield from faults(each, given if keyword == "items" else given[index], (*place, index))
            case _ if keyword in _ACCEPTS:
                kind, accepts = _ACCEPTS[keyword]
                accepted = not _is(value, kind) or accepts(value, given)
        if not accepted:
            yield place, schema, keyword


def _nearest(found: str, known: Iterable[str]) -> str | None:
    # A text longer than any key is no typing error, and difflib takes quadratic time.
    if len(found) > SHOWN:
        return None
    return next(iter(difflib.get_close_matches(found.lower(), list(known), n=1)), None)


def refusal(node: Node, expected: str) -> str:
    """The message about a value that differs from the expected ones."""
    words = [word for word in re.split(r", | or ", expected.removeprefix("expected ")) if re.fullmatch("[a-z_]+", word)]
    near = _nearest(node.value, words) if isinstance(node.value, str) else None
    return f"found {node.shown}, {expected}" + (f"; did you mean {near}?" if near else "")


def at(root: Node, place: Place) -> tuple[Node, str]:
    """The value at a place, and the path that messages write for it."""
    return functools.reduce(lambda node, step: node.children[step], place, root), functools.reduce(path_to, place, "")


def crowded(root: Node, form: Format) -> list[Problem]:
    """The problems of lists with more items than a file may have: their items need no look, nor a line each."""
    return [
        Problem(child.line, str(key), refusal(child, schema["errorMessage"]))
        for key, child in root.children.items()
        if isinstance(child.value, list) and (schema := form.schema["properties"].get(key))
        if len(child.value) > schema.get("maxItems", len(child.value))
    ]


def check(root: Node, form: Format) -> tuple[list[Problem], set[Place]]:
    """The problems that the schema finds, and the places of refused values and of all that holds them."""
    unknown: dict[Place, Schema] = {}  # the known keys, at each mapping with an unknown one
    missing: dict[Place, list[str]] = {}
    refused: dict[Place, str] = {}
    for place, schema, keyword in faults(root.value, form.schema):
        match keyword:
            case "additionalProperties":
                unknown[place] = schema["properties"]
            case "required":
                missing[place] = [*missing.get(place, ()), *schema["required"]]
            case _:
                mapping = f"expected a mapping of {', '.join(schema.get('properties', ()))}"
                refused.setdefault(place, schema.get("errorMessage", mapping))
    wrong = {place[:depth] for place in (*unknown, *missing, *refused) for depth in range(len(place) + 1)}
    problems: list[Problem] = []
    meant: set[tuple[Place, str | None]] = set()
    for place, known in unknown.items():
        node, path = at(root, place)
        for key in (str(key) for key in node.children if key not in known):
            near = _nearest(key, known)
            meant.add((place, near))
            wrong.add((*place, key))
            message = f"unknown key, did you mean {near}?" if near else f"unknown key, expected {', '.join(known)}"
            for kind in reversed(form.kinds):  # the first that knows the key has the last word
                if place == ("defaults",) and key in kind.own:
                    message = f"not inherited, each {kind.item} needs its own"
                if not place and key in kind.keys:
                    meant.add((place, key))
                    home = f"a {kind.item}" if key in kind.own else f"a {kind.item} or to defaults"
                    message = f"belongs to {home}; is it indented too little?"
            problems.append(Problem(node.children[key].line, path_to(path, key), message))
    for place, keys in missing.items():
        node, path = at(root, place)
        for key in dict.fromkeys(keys):
            # A missing key is not reported if a misspelt one was meant to be it: here, in the defaults, or at the root.
            if key not in node.children and not {(place, key), (("defaults",), key), ((), key)} & meant:
                problems.append(Problem(node.line, path_to(path, key), "required, but missing"))
    for place, expected in refused.items():
        if not any(place[:depth] in refused for depth in range(len(place))):
            node, path = at(root, place)
            problems.append(Problem(node.line, path, refusal(node, expected)))
    return problems, wrong
