"""Reads the YAML file of wrinkling tools into frozen records; all of its problems are reported at once.

There are three steps. YAML text becomes a tree that knows its lines. The JSON Schema of `schema` checks the tree. Its
valid keys become records: tools inherit defaults, mirrored tools are made, and positions are turned to Y-up.
`configs/README.md` is the reference of the keys.
"""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, BinaryIO, TypeAlias

from wrinklecli.errors import ConfigError
from wrinklecli.files.claims import is_path
from wrinklecli.files.formats import is_gltf
from wrinklecli.files.inputs import open_input
from wrinklecli.tools.body import odd_activation
from wrinklecli.tools.checked import Format, Place, at, check, refusal
from wrinklecli.tools.json_schema import readers_of
from wrinklecli.tools.materials import Preset, presets
from wrinklecli.tools.mirror import mirrored
from wrinklecli.tools.records import (
    MaskImage,
    Point,
    Position,
    ToolsFile,
    identifier,
    moved_point,
    with_points,
)
from wrinklecli.tools.schema import KINDS, TOOLS_SCHEMA, Kind
from wrinklecli.tools.yaml_tree import MAX_BYTES, Node, Problem, path_to, printable, read_tree, tree_of

Keys: TypeAlias = tuple[str, ...]

_FORMAT = Format(TOOLS_SCHEMA, [kind.items for kind in KINDS.values()])

# Keys that merged files must share. `up` is not among them: positions are Y-up once they are read.
_SHARED = ("rest", "sampling", "refinement")


def _odd(key: str, value: Any) -> Iterator[tuple[Place, str]]:
    """Faults of a value that the schema accepts: the place below the key, and the expected value."""
    if key == "details" and sum(value) > 0.99:
        yield (), f"expected shares whose sum is at most 0.99, not {sum(value):g}"
    if key == "rest_length" and isinstance(value, dict):
        for clip, keys in value.get("keys", {}).items():
            for (before, _), (after, _) in pairwise(keys):
                if after <= before:
                    yield ("keys", clip), f"expected times that rise from key to key, not {before:g} and then {after:g}"
                    break
    if key == "activation":
        yield from odd_activation(value)
    if key == "presets":
        known = [*presets()]
        for name, entry in value.items():
            for inner, each in entry.items():
                yield from (((name, inner, *below), expected) for below, expected in _odd(inner, each))
            if "material" in entry and entry["material"] not in known:
                yield (name, "material"), f"expected {', '.join(known[:-1])} or {known[-1]}, or a preset above it"
            known += [name] * (name not in known)


def _read(root: Node, place: Place, record: type, wrong: Collection[Place]) -> tuple[dict[str, Any], list[Problem]]:
    """The fields of a record that the mapping at a place gives, and problems that the schema cannot find.

    Args:
        root: The file.
        place: Keys and indices that lead to the mapping.
        record: The record; other keys are skipped.
        wrong: Places that are skipped.
    """
    values: dict[str, Any] = {}
    problems: list[Problem] = []
    node, _ = at(root, place)
    readers = readers_of(record)
    for key, value in node.value.items() if isinstance(node.value, dict) else ():
        if key not in readers or (*place, key) in wrong:
            continue
        odd = [(at(root, (*place, key, *below)), expected) for below, expected in _odd(key, value)]
        problems += [Problem(part.line, path, refusal(part, expected)) for (part, path), expected in odd]
        if not odd:
            values[key] = readers[key](value)
    return values, problems


@dataclass(frozen=True, slots=True)
class _Effect:
    """An effect that the file gives, or its mirror image: its keys in the file's axes, its path and its mapping."""

    values: Mapping[str, Any]
    path: str
    node: Node


def _effects(
    root: Node,
    key: str,
    defaults: Mapping[str, Any],
    known: Mapping[str, Preset] | None,
    wrong: Set[Place],
    owners: dict[str, str],
) -> tuple[list[_Effect], list[Problem]]:
    """All effects of the list at a key, each mirrored one behind its source, and their problems.

    `known` has the materials; None if they are at fault.
    `owners` says which effect has which identifier; those of these effects are added.
    """
    node = root.children.get(key)
    if node is None or not isinstance(node.value, list):
        return [], []  # the schema has not looked into what stands there
    kind = KINDS[key]
    record = kind.record
    problems: list[Problem] = []
    given: list[_Effect] = []
    for i, child in node.children.items():
        values, odd = _read(root, (key, i), record, wrong)
        effect = _Effect({**defaults, **values}, path_to(key, i), child)
        given.append(effect)
        problems += [*odd, *_problems_of(effect, kind, owners)]
        if "material" in kind.items.keys and known is not None and not {(key, i), ("defaults",)} & wrong:
            problems += _problems_of_material(effect, known)
        if "name" in effect.values:
            owners.setdefault(identifier(effect.values["name"]), effect.path)
    effects: list[_Effect] = []
    for effect in given:
        effects.append(effect)
        axis = effect.values.get("mirror")
        if axis in (None, "none") or "name" not in effect.values:
            continue
        values = mirrored(record, effect.values, axis)
        path = f"{effect.path} (mirrored as {printable(values['name'])})"
        effects.append(_Effect({**values, "mirrored": True}, path, effect.node))
        problems += _problems_of_mirrored(effect, values, kind, owners)
        owners.setdefault(identifier(values["name"]), f"the {kind.items.item} mirrored from {effect.path}")
    return effects, problems


def _problems_of(tool: _Effect, kind: Kind, owners: Mapping[str, str]) -> Iterator[Problem]:
    """The problems of an effect with its points, and with the names of the effects before it."""
    values, parts = tool.values, tool.node.children
    if "name" in values and (owner := owners.get(identifier(values["name"]))) is not None:
        shown = parts["name"].shown
        message = f"found {shown}, but {owner} has that name: they must differ in letters, digits or _"
        yield Problem(parts["name"].line, f"{tool.path}.name", message)
    for first, second in pairwise(kind.points):
        if first in values and values[first] == values.get(second):
            message = f"same as {first}, expected another point"
            yield Problem(parts[second].line, f"{tool.path}.{second}", message)
    for number, (before, point) in enumerate(pairwise(values.get("path", ())), start=1):
        if point == before:
            line = parts["path"].children[number].line
            yield Problem(line, f"{tool.path}.path[{number}]", "same as the point before it, expected another")


def _problems_of_mirrored(
    tool: _Effect, other: Mapping[str, Any], kind: Kind, owners: Mapping[str, str]
) -> Iterator[Problem]:
    """The problems of the effect that is mirrored from another one."""
    name, item = tool.node.children["name"], kind.items.item
    if other["name"] == tool.values["name"]:
        message = f"found {name.shown}, expected a side to exchange for mirror, such as brow.L or left_brow"
    elif (taken := identifier(other["name"])) in owners:
        message = f"found {name.shown}, but its mirrored {item} would have the name of {owners[taken]}"
    elif None not in _points(tool.values, kind) and _points(tool.values, kind) == _points(other, kind):
        message = f"found {name.shown}, but its mirrored {item} would lie on itself: remove mirror"
    else:
        return
    yield Problem(name.line, f"{tool.path}.name", message)


def _points(values: Mapping[str, Any], kind: Kind) -> set[Point | None]:
    return {*values["path"]} if "path" in values else {values.get(name) for name in kind.points}


def _problems_of_material(effect: _Effect, known: Mapping[str, Preset]) -> Iterator[Problem]:
    """The problems of an effect's material, and of a width that neither the file nor the material gives."""
    name, line = effect.values.get("material"), effect.node.line
    if name is not None and name not in known:
        written = effect.node.children.get("material") or replace(tree_of(name), line=line, shown=printable(name))
        expected = f"expected {', '.join(known)} or none"
        yield Problem(written.line, f"{effect.path}.material", refusal(written, expected))
    elif "width" not in effect.values and (name is None or "width" not in known[name].keys):
        yield Problem(line, f"{effect.path}.width", "required, but missing")


def _record(
    kind: Kind,
    effect: _Effect,
    up: str,
    known: Mapping[str, Preset],
    inherited: Mapping[Keys, str],
    name: str,
) -> Any:
    """The record of an effect without problems, with the places of its own and its inherited values."""
    shown_name, folder = printable(name, len(name)), os.path.dirname(name)
    values = with_points(kind.record, effect.values, lambda point: moved_point(point, _Y_UP[up]))
    fields = kind.record.fields_of(values, known)
    images = {key: replace(value, folder=folder) for key, value in fields.items() if isinstance(value, MaskImage)}
    places = {keys: place for keys, place in inherited.items() if keys[0] not in effect.node.children}
    places |= _places(effect.node, effect.path, shown_name)
    where = f"{shown_name}:{effect.node.line}: {effect.path}"
    return kind.record(**{**fields, **images}, where=where, places=places)


def _places(node: Node, path: str, shown_name: str) -> dict[Keys, str]:
    """The places of all values below a node, as messages write them, by their keys."""
    places: dict[Keys, str] = {}
    for key, child in node.children.items() if isinstance(node.value, dict | list) else ():
        places[(str(key),)] = f"{shown_name}:{child.line}: {path_to(path, key)}"
        places |= {(str(key), *below): place for below, place in _places(child, path_to(path, key), shown_name).items()}
    return places


def _from_z_up(position: Position) -> Position:
    x, y, z = position
    return (x, z, 0.0 - y)


# From the axes of a file to Y-up.
_Y_UP: Mapping[str, Callable[[Position], Position]] = {"y": lambda position: position, "z": _from_z_up}


def parse_tools(text: str, *, name: str = "<tools>") -> ToolsFile:
    """Read tools from YAML text, which error messages call `name`.

    Raises:
        ConfigError: All problems of the text, a line each, in the order of its lines.
    """
    return _parsed(*read_tree(text), name)


def read_values(values: Mapping[str, Any], *, name: str = "<tools>") -> ToolsFile:
    """Read tools from plain Python values, as `parse_tools` does from YAML, but faster."""
    return _parsed(tree_of(values), [], name)


def _parsed(root: Node | None, problems: list[Problem], name: str) -> ToolsFile:
    shown_name = printable(name, len(name))
    header: dict[str, Any] = {}
    effects: dict[str, list[_Effect]] = {}
    known: Mapping[str, Preset] | None = None
    owners: dict[str, str] = {}
    if root is not None:
        refused, wrong = check(root, _FORMAT)
        header, odd = _read(root, (), ToolsFile, wrong)
        problems = [*problems, *refused, *odd]
        sound = "presets" in header or "presets" not in root.children
        known = {**presets(), **header.get("presets", {})} if sound else None
        for key, kind in KINDS.items():
            inherits = "defaults" in root.children and kind.items.inherited
            defaults, odd = _read(root, ("defaults",), kind.record, wrong) if inherits else ({}, [])
            effects[key], odd_effects = _effects(root, key, defaults, known, wrong, owners)
            problems += [*odd, *odd_effects]
    if problems:
        raise ConfigError.of_all(
            ConfigError(problem.message, where=f"{shown_name}:{problem.line}: {problem.path}".rstrip(": "))
            for problem in sorted(problems, key=lambda problem: problem.line)
        )
    assert root is not None
    assert known is not None
    others = {key: child for key, child in root.children.items() if key not in KINDS}
    places = _places(replace(root, children=others), "", shown_name)
    inherited = {keys[1:]: place for keys, place in places.items() if keys[0] == "defaults" and keys[1:]}
    up = header.get("up", "y")
    lists: dict[str, Any] = {
        key: tuple(
            record for effect in effects[key] if (record := _record(kind, effect, up, known, inherited, name)).enabled
        )
        for key, kind in KINDS.items()
    }
    return ToolsFile(path=name, **header, **lists, places=places)


def load_tools(path: str | os.PathLike[str]) -> ToolsFile:
    """Read a file of tools.

    Raises:
        ConfigError: The file cannot be read, or all of its problems, a line each, in the order of its lines.
    """
    return parse_tools(load_text(path), name=os.fspath(path))


def load_text(path: str | os.PathLike[str]) -> str:
    """Read the text of a file of tools.

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


def images_named(file: BinaryIO) -> list[str]:
    """List the images that an open tools file names, as it writes them; none if it is at fault, as a bake will say."""
    data = file.read(MAX_BYTES)
    # Parsing takes far longer. An escape may spell the key in another way.
    if b"mask" not in data and b"\\" not in data:
        return []
    try:
        tools = parse_tools(data.decode("utf-8-sig")).tools
    except (ConfigError, UnicodeDecodeError):
        return []
    images = (tool.mask.image for tool in tools if isinstance(tool.mask, MaskImage))
    return [image for image in dict.fromkeys(images) if is_path(image)]


def with_images(paths: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Give tools files and the images that they name; a file that cannot be read names none."""
    for each in paths:
        path = os.fspath(each)
        yield path
        try:
            with open_input(path) as file:
                images = images_named(file)
        except (OSError, ValueError):
            continue
        yield from (os.path.join(os.path.dirname(path), image) for image in images)


def load_merged(paths: Sequence[str | os.PathLike[str]]) -> ToolsFile:
    """Read several files of tools for one asset.

    Args:
        paths: The files. The first gives the result its name and its `up`, in which results are shown.

    Raises:
        ConfigError: All problems of the files; or two files share a tool's name, or differ in their other keys.
    """
    files, problems = [], []
    for path in paths:
        try:
            files.append(load_tools(path))
        except ConfigError as error:
            problems.append(error)
    if problems:
        raise ConfigError.of_all(problems)
    merged = files[0]
    for each in files[1:]:
        problems += _differences(merged, each)
        said = {key: getattr(each, key) for key in _SHARED if (key,) in each.places}
        lists: dict[str, Any] = {key: (*getattr(merged, key), *getattr(each, key)) for key in ToolsFile.LISTS}
        merged = replace(
            merged,
            **said,
            **lists,
            places={**merged.places, **{keys: place for keys, place in each.places.items() if keys[0] in said}},
            merged_paths=(*merged.merged_paths, each.path),
        )
    if problems:
        raise ConfigError.of_all(problems)
    return merged


def _differences(merged: ToolsFile, other: ToolsFile) -> list[ConfigError]:
    """The reasons why a file cannot be merged with the files before it."""
    problems = []
    for key in _SHARED:
        both = (key,) in merged.places and (key,) in other.places
        if both and getattr(merged, key) != getattr(other, key):
            message = f"differs from {merged.place(key)}, with which it is merged: they must agree"
            problems.append(ConfigError(message, where=other.place(key)))
    names = {identifier(tool.name): tool for tool in merged.effects}
    for tool in other.effects:
        if (taken := names.get(identifier(tool.name))) is not None:
            message = f"found {tool.name!r}, but {taken.where} has that name: files that are merged need names apart"
            problems.append(ConfigError(message, where=tool.place("name")))
    return problems
