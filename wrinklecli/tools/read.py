"""The YAML file of wrinkling tools, read into frozen records; all of its problems are reported at once.

Three steps: YAML text to a tree that knows its lines, the tree checked by the JSON Schema of `schema`, what is right
in it read into records: defaults inherited, mirrored tools made, positions turned to Y-up, what is left out taken
from materials.
`configs/README.md` is the reference of the keys.
"""

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, TypeAlias

from wrinklecli.errors import ConfigError
from wrinklecli.files.formats import is_gltf
from wrinklecli.files.inputs import open_input
from wrinklecli.tools.checked import Format, Place, at, check, refusal
from wrinklecli.tools.materials import with_material
from wrinklecli.tools.mirror import mirrored
from wrinklecli.tools.records import (
    Contact,
    Lag,
    Length,
    Marker,
    Position,
    RefinementSettings,
    RestFrame,
    RestLengthKeys,
    RestLengthMorph,
    Sampling,
    ToolsFile,
    WrinkleTool,
    identifier,
    parse_length,
)
from wrinklecli.tools.schema import OWN_KEYS, TOOL_KEYS, TOOLS_SCHEMA
from wrinklecli.tools.yaml_tree import MAX_BYTES, Node, Problem, path_to, printable, read_tree, tree_of

Keys: TypeAlias = tuple[str, ...]


_FORMAT = Format(TOOLS_SCHEMA, "tool", TOOL_KEYS, OWN_KEYS)


def _converted(value: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a mapping, each as its record holds it."""
    return {key: _READ[key](part) if key in _READ else part for key, part in value.items()}


def _anchor(value: Any) -> Position | Marker:
    if isinstance(value, dict):
        return Marker(**value)
    x, y, z = map(float, value)
    return (x, y, z)


def _max_height(value: Any) -> Literal["auto"] | Length | None:
    if value in ("auto", "none", None):
        return "auto" if value == "auto" else None
    return parse_length(value)


def _clips(value: Any) -> Literal["all"] | tuple[str, ...] | dict[str, float]:
    """The clips to sample, or the strengths in clips."""
    if isinstance(value, dict):
        return {clip: float(strength) for clip, strength in value.items()}
    return "all" if value == "all" else tuple(value)


def _keys(value: Mapping[str, Any]) -> dict[str, tuple[tuple[float, Length], ...]]:
    return {clip: tuple((float(time), parse_length(length)) for time, length in keys) for clip, keys in value.items()}


def _rest_length(value: Any) -> Literal["auto"] | Length | RestLengthKeys | RestLengthMorph:
    if isinstance(value, dict):
        return RestLengthKeys(**_converted(value)) if "keys" in value else RestLengthMorph(**_converted(value))
    return "auto" if value == "auto" else parse_length(value)


def _contact(value: Any) -> Contact | None:
    if isinstance(value, dict):
        return Contact(**_converted(value))
    return Contact() if value == "resolve" else None


# How a key's value becomes a record's, wherever the key stands; those that are not here stay as they are.
_READ: Mapping[str, Callable[[Any], Any]] = {
    "version": int,
    "rest": lambda value: RestFrame(**_converted(value)) if isinstance(value, dict) else value,
    "time": float,
    "sampling": lambda value: Sampling(**_converted(value)),
    "fps": float,
    "clips": _clips,
    "refinement": lambda value: RefinementSettings(**_converted(value)),
    "max_levels": int,
    "edges_per_interval": int,
    "origin": _anchor,
    "target": _anchor,
    "path": lambda value: tuple(map(_anchor, value)),
    "width": parse_length,
    "material": lambda value: None if value == "none" else value,
    "bumps": int,
    "gap": int,
    "max_height": _max_height,
    "compressible": lambda value: float(value.rstrip(" %")) / 100.0,
    "details": lambda value: tuple(map(float, value)),
    "bow": float,
    "strength": float,
    "rest_length": _rest_length,
    "keys": _keys,
    "lag": lambda value: Lag(**_converted(value)) if isinstance(value, dict) else None,
    "frequency": float,
    "damping": float,
    "contact": _contact,
    "ignore": tuple,
    "full": parse_length,
}


def _odd(key: str, value: Any) -> Iterator[tuple[Place, str]]:
    """What is wrong with a key's value though the schema accepts it: where below the key, and what was expected."""
    if key == "details" and sum(value) > 0.99:
        yield (), f"expected shares whose sum is at most 0.99, not {sum(value):g}"
    if key == "rest_length" and isinstance(value, dict):
        for clip, keys in value.get("keys", {}).items():
            for (before, _), (after, _) in pairwise(keys):
                if after <= before:
                    yield ("keys", clip), f"expected times that rise from key to key, not {before:g} and then {after:g}"
                    break


def _read(root: Node, place: Place, wrong: Collection[Place]) -> tuple[dict[str, Any], list[Problem]]:
    """What a mapping of the file says, and what is wrong with it that the schema has no words for.

    Args:
        root: The file.
        place: Where the mapping is.
        wrong: Places that are left out.
    """
    values: dict[str, Any] = {}
    problems: list[Problem] = []
    node, _ = at(root, place)
    for key, value in node.value.items() if isinstance(node.value, dict) else ():
        if (*place, key) in wrong:
            continue
        odd = [(at(root, (*place, key, *below)), expected) for below, expected in _odd(key, value)]
        problems += [Problem(part.line, path, refusal(part, expected)) for (part, path), expected in odd]
        if not odd:
            values |= _converted({key: value})
    return values, problems


@dataclass(frozen=True, slots=True)
class _Tool:
    """A tool as the file gives it, or mirrored from such a one: its keys in the file's axes, its path, its mapping."""

    values: Mapping[str, Any]
    path: str
    node: Node


def _tools(root: Node, defaults: Mapping[str, Any], wrong: Collection[Place]) -> tuple[list[_Tool], list[Problem]]:
    """All tools, each mirrored one behind its source, and what is wrong with them."""
    node = root.children.get("tools")
    if node is None or not isinstance(node.value, list):
        return [], []  # what stands there the schema has not looked into
    problems: list[Problem] = []
    given: list[_Tool] = []
    owners: dict[str, str] = {}  # who has an identifier
    for i, child in node.children.items():
        values, odd = _read(root, ("tools", i), wrong)
        tool = _Tool({**defaults, **values}, path_to("tools", i), child)
        given.append(tool)
        problems += [*odd, *_problems_of(tool, owners)]
        if "name" in tool.values:
            owners.setdefault(identifier(tool.values["name"]), tool.path)
    tools: list[_Tool] = []
    for tool in given:
        tools.append(tool)
        axis = tool.values.get("mirror")
        if axis in (None, "none") or "name" not in tool.values:
            continue
        values = mirrored(tool.values, axis)
        tools.append(
            _Tool({**values, "mirrored": True}, f"{tool.path} (mirrored as {printable(values['name'])})", tool.node)
        )
        problems += _problems_of_mirrored(tool, values, owners)
        owners.setdefault(identifier(values["name"]), f"the tool mirrored from {tool.path}")
    return tools, problems


def _problems_of(tool: _Tool, owners: Mapping[str, str]) -> Iterator[Problem]:
    """What is wrong with a tool beside those before it."""
    values, parts = tool.values, tool.node.children
    if "name" in values and (owner := owners.get(identifier(values["name"]))) is not None:
        shown = parts["name"].shown
        message = f"found {shown}, but {owner} has that name: they must differ in letters, digits or _"
        yield Problem(parts["name"].line, f"{tool.path}.name", message)
    if "origin" in values and values["origin"] == values.get("target"):
        yield Problem(parts["target"].line, f"{tool.path}.target", "same as origin, expected another point")
    for number, (before, point) in enumerate(pairwise(values.get("path", ())), start=1):
        if point == before:
            line = parts["path"].children[number].line
            yield Problem(line, f"{tool.path}.path[{number}]", "same as the point before it, expected another")


def _problems_of_mirrored(tool: _Tool, other: Mapping[str, Any], owners: Mapping[str, str]) -> Iterator[Problem]:
    """What is wrong with the keys of the tool that is mirrored from one."""
    name = tool.node.children["name"]
    if other["name"] == tool.values["name"]:
        message = f"found {name.shown}, expected a side to exchange for mirror, such as brow.L or left_brow"
    elif (taken := identifier(other["name"])) in owners:
        message = f"found {name.shown}, but its mirrored tool would have the name of {owners[taken]}"
    elif None not in _points(tool.values) and _points(tool.values) == _points(other):
        message = f"found {name.shown}, but its mirrored tool would lie on itself: remove mirror"
    else:
        return
    yield Problem(name.line, f"{tool.path}.name", message)


def _points(values: Mapping[str, Any]) -> set[Position | Marker | None]:
    return {*values["path"]} if "path" in values else {values.get("origin"), values.get("target")}


def _record(tool: _Tool, up: str, inherited: Mapping[Keys, str], shown_name: str) -> WrinkleTool:
    """The record of a tool with which nothing is wrong, and the places of what it says and inherits."""
    values = {key: value for key, value in tool.values.items() if key not in ("mirror", "path")}
    points = tool.values.get("path") or (values["origin"], values["target"])
    origin, *between, target = (_y_up(point, up) for point in points)
    values |= {"origin": origin, "between": tuple(between), "target": target}
    places = {keys: place for keys, place in inherited.items() if keys[0] not in tool.node.children}
    places |= _places(tool.node, tool.path, shown_name)
    return WrinkleTool(**with_material(values), where=f"{shown_name}:{tool.node.line}: {tool.path}", places=places)


def _places(node: Node, path: str, shown_name: str) -> dict[Keys, str]:
    """Where the values of a mapping and of those below it stand, for messages, by their keys."""
    places: dict[Keys, str] = {}
    for key, child in node.children.items() if isinstance(node.value, dict | list) else ():
        places[(str(key),)] = f"{shown_name}:{child.line}: {path_to(path, key)}"
        places |= {(str(key), *below): place for below, place in _places(child, path_to(path, key), shown_name).items()}
    return places


def _y_up(anchor: Position | Marker, up: str) -> Position | Marker:
    if up == "y" or isinstance(anchor, Marker):
        return anchor
    x, y, z = anchor
    return (x, z, 0.0 - y)


def parse_tools(text: str, *, name: str = "<tools>") -> ToolsFile:
    """Read tools from YAML text.

    Args:
        text: The YAML.
        name: What error messages call it.

    Raises:
        ConfigError: All problems of the text, a line each, in the order of its lines.
    """
    return _parsed(*read_tree(text), name)


def read_values(values: Mapping[str, Any], *, name: str = "<tools>") -> ToolsFile:
    """As `parse_tools`, of what the YAML would say, as plain Python values, without the time that YAML takes."""
    return _parsed(tree_of(values), [], name)


def _parsed(root: Node | None, problems: list[Problem], name: str) -> ToolsFile:
    shown_name = printable(name, len(name))
    header: dict[str, Any] = {}
    tools: list[_Tool] = []
    if root is not None:
        refused, wrong = check(root, _FORMAT)
        header, odd = _read(root, (), {*wrong, ("defaults",), ("tools",)})
        defaults, odd_defaults = _read(root, ("defaults",), wrong) if "defaults" in root.children else ({}, [])
        tools, odd_tools = _tools(root, defaults, wrong)
        problems = [*problems, *refused, *odd, *odd_defaults, *odd_tools]
    if problems:
        raise ConfigError.of_all(
            ConfigError(problem.message, where=f"{shown_name}:{problem.line}: {problem.path}".rstrip(": "))
            for problem in sorted(problems, key=lambda problem: problem.line)
        )
    assert root is not None
    beside = {key: child for key, child in root.children.items() if key != "tools"}
    places = _places(replace(root, children=beside), "", shown_name)
    inherited = {keys[1:]: place for keys, place in places.items() if keys[0] == "defaults" and keys[1:]}
    records = (_record(tool, header.get("up", "y"), inherited, shown_name) for tool in tools)
    return ToolsFile(path=name, **header, tools=tuple(tool for tool in records if tool.enabled), places=places)


def load_tools(path: str | os.PathLike[str]) -> ToolsFile:
    """Read a file of tools.

    Args:
        path: The file; messages repeat it as it is given.

    Raises:
        ConfigError: The file cannot be read, or all of its problems, a line each, in the order of its lines.
    """
    return parse_tools(load_text(path), name=os.fspath(path))


def load_text(path: str | os.PathLike[str]) -> str:
    """Read the text of a file of tools, whatever it says.

    Raises:
        ConfigError: The file cannot be read, or is no text.
    """
    name = os.fspath(path)
    shown_name = printable(name, len(name))
    try:
        with open_input(path) as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConfigError(f"cannot be read: {reason}", where=shown_name) from None
    if is_gltf(data):
        message = "is a glTF asset, where the tools file (YAML) belongs: the asset comes first, then the tools"
        raise ConfigError(message, where=shown_name)
    if len(data) > MAX_BYTES:
        raise ConfigError(f"larger than {MAX_BYTES // 1_000_000} MB, expected YAML", where=shown_name)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"found byte 0x{data[error.start]:02x}, expected UTF-8"
        raise ConfigError(message, where=f"{shown_name}:{line}") from None
