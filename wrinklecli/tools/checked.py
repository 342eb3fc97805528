"""Checks a YAML tree by a JSON Schema: each problem gets its line, its path and a hint at the word that was meant."""

import difflib
import functools
import re
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

from jsonschema_rs import Draft202012Validator

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


@functools.cache
def _validator(form: Format) -> Draft202012Validator:
    return Draft202012Validator(form.schema)


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
    for error in _validator(form).iter_errors(root.value):
        place = tuple(error.instance_path)
        schema: Any = form.schema
        for step in error.schema_path[:-1]:
            schema = schema[step]
        match error.schema_path[-1]:
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
