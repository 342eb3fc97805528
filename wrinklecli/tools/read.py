"""Reads the YAML file of wrinkling tools into frozen records; all of its problems are reported at once.

There are three steps. YAML text becomes a tree that knows its lines. The JSON Schema of `schema` checks the tree. Its
valid keys become records: tools inherit defaults, mirrored tools are made, and positions are turned to Y-up.
`configs/README.md` is the reference of the keys.
"""

import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from itertools import chain, pairwise
from typing import Any, TypeAlias

from wrinklecli.errors import ConfigError
from wrinklecli.frozen import dataclass
from wrinklecli.tools.checked import Format, Place, at, check, crowded, refusal
from wrinklecli.tools.files_beside import load_text, path_beside
from wrinklecli.tools.json_schema import readers_of
from wrinklecli.tools.materials import Preset, presets, presets_of
from wrinklecli.tools.mirror import mirrored
from wrinklecli.tools.records import (
    EffectTool,
    MaskImage,
    Point,
    Position,
    ToolsFile,
    identifier,
    moved_point,
    with_points,
)
from wrinklecli.tools.schema import ITEMS, KINDS, PRESETS_SCHEMA, TOOLS_SCHEMA
from wrinklecli.tools.yaml_tree import Node, Problem, path_to, printable, read_tree, tree_of, without_tagged

Keys: TypeAlias = tuple[str, ...]

_FORMAT = Format(TOOLS_SCHEMA, [*ITEMS.values()])
_PRESETS = Format(PRESETS_SCHEMA, [])

# Keys that merged files must share. `up` is not among them: positions are Y-up once they are read.
_SHARED = ("rest", "sampling", "refinement")


def _odd(key: str, value: Any) -> Iterator[tuple[Place, str]]:
    """Faults of a value that the schema accepts: the place below the key, and the expected value."""
    if key == "details" and sum(value) > 0.99:
        yield (), f"expected shares whose sum is at most 0.99, not {sum(value):g}"
    if key in ("rest_length", "activation") and isinstance(value, dict):
        yield from ((("keys", *below), expected) for below, expected in _odd("keys", value.get("keys", {})))
    if key == "keys":
        for clip, keys in value.items():
            falling = next(((a[0], b[0]) for a, b in pairwise(keys) if b[0] <= a[0]), None)
            if falling:
                yield (clip,), "expected times that rise from key to key, not {:g} and then {:g}".format(*falling)
    if key == "presets" and isinstance(value, dict):
        yield from _odd_presets(value, presets())


def _odd_presets(entries: Mapping[str, Any], known: Collection[str]) -> Iterator[tuple[Place, str]]:
    """Find what the schema cannot say of presets, which may be made from `known` ones or from those above them."""
    names = [*known]
    for name, entry in entries.items():
        for inner, each in entry.items():
            yield from (((name, inner, *below), expected) for below, expected in _odd(inner, each))
        if "material" in entry and entry["material"] not in names:
            yield (name, "material"), f"expected {', '.join(names[:-1])} or {names[-1]}, or a preset above it"
        names += [name] * (name not in names)


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
    problems: list[Problem] = []
    given: list[_Effect] = []
    for i, child in node.children.items():
        values, odd = _read(root, (key, i), kind, wrong)
        effect = _Effect({**defaults, **values}, path_to(key, i), child)
        given.append(effect)
        problems += [*odd, *_problems_of(effect, kind, owners)]
        if "material" in ITEMS[key].inherited and known is not None and not {(key, i), ("defaults",)} & wrong:
            problems += _problems_of_material(effect, known)
        if "name" in effect.values:
            owners.setdefault(identifier(effect.values["name"]), effect.path)
    effects: list[_Effect] = []
    for effect in given:
        effects.append(effect)
        axis = effect.values.get("mirror")
        if axis in (None, "none") or "name" not in effect.values:
            continue
        values = mirrored(kind, effect.values, axis)
        path = f"{effect.path} (mirrored as {printable(values['name'])})"
        effects.append(_Effect({**values, "mirrored": True}, path, effect.node))
        problems += _problems_of_mirrored(effect, values, kind, owners)
        owners.setdefault(identifier(values["name"]), f"the {kind.words[0]} mirrored from {effect.path}")
    return effects, problems


def _problems_of(tool: _Effect, kind: type[EffectTool], owners: Mapping[str, str]) -> Iterator[Problem]:
    """The problems of an effect with its points, and with the names of the effects before it."""
    values, parts = tool.values, tool.node.children
    if "name" in values and (owner := owners.get(identifier(values["name"]))) is not None:
        shown = parts["name"].shown
        message = (
            f"found {shown}, but {owner} is {identifier(values['name'])!r} in morph targets: names differ in"
            " letters, digits, _"
        )
        yield Problem(parts["name"].line, f"{tool.path}.name", message)
    for first, second in pairwise(kind.point_keys):
        if first in values and values[first] == values.get(second):
            message = f"same as {first}, expected another point"
            yield Problem(parts[second].line, f"{tool.path}.{second}", message)
    # The points of a touch's path follow its place.
    for key, start in (("path", ()), ("along", (values.get("at"),))):
        listed = values.get(key, ())
        for number, (before, point) in enumerate(pairwise((*start, *listed)), start=1 - len(start)):
            if point == before:
                line = parts[key].children[number].line
                yield Problem(line, f"{tool.path}.{key}[{number}]", "same as the point before it, expected another")


def _problems_of_mirrored(
    tool: _Effect, other: Mapping[str, Any], kind: type[EffectTool], owners: Mapping[str, str]
) -> Iterator[Problem]:
    """The problems of the effect that is mirrored from another one."""
    name, item = tool.node.children["name"], kind.words[0]
    if other["name"] == tool.values["name"]:
        message = f"found {name.shown}, expected a side to exchange for mirror, such as brow.L or left_brow"
    elif (taken := identifier(other["name"])) in owners:
        message = f"found {name.shown}, but its mirrored {item} would have the name of {owners[taken]}"
    elif None not in _points(tool.values, kind) and _place(tool.values, kind) == _place(other, kind):
        message = f"found {name.shown}, but its mirrored {item} would lie on itself: remove mirror"
    else:
        return
    yield Problem(name.line, f"{tool.path}.name", message)


def _points(values: Mapping[str, Any], kind: type[EffectTool]) -> set[Point | None]:
    return {*values["path"]} if "path" in values else {values.get(name) for name in kind.point_keys}


def _place(values: Mapping[str, Any], kind: type[EffectTool]) -> Any:
    """The keys that say where an effect is: its points, or for want of such its mesh and its joints."""
    return _points(values, kind) or [values.get(key) for key in ("node", "joints")]


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
    kind: type[EffectTool],
    effect: _Effect,
    up: str,
    known: Mapping[str, Preset],
    inherited: Mapping[Keys, str],
    name: str,
) -> EffectTool:
    """The record of an effect without problems, with the places of its own and its inherited values."""
    shown_name, folder = printable(name, len(name)), os.path.dirname(name)
    values = with_points(kind, effect.values, lambda point: moved_point(point, _Y_UP[up]))
    fields = kind.fields_of(values, known)
    images = {key: replace(value, folder=folder) for key, value in fields.items() if isinstance(value, MaskImage)}
    places = {keys: place for keys, place in inherited.items() if keys[0] not in effect.node.children}
    places |= _places(effect.node, effect.path, shown_name)
    where = f"{shown_name}:{effect.node.line}: {effect.path}"
    return kind(**{**fields, **images}, where=where, places=places)


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


def load_presets(path: str, known: Mapping[str, Preset]) -> dict[str, Preset]:
    """Read a file of presets, which may be made from `known` ones: a mapping such as that of `presets:`.

    Raises:
        ConfigError: The file cannot be read, or all of its problems, a line each, in the order of its lines.
    """
    root, problems = read_tree(load_text(path), "a mapping of names to keys of tools")
    if root is not None:
        refused, wrong = check(root, _PRESETS)
        odd = [] if () in wrong else [*_odd_presets(root.value, known), *_images_in(root.value)]
        parts = ((at(root, place), expected) for place, expected in odd)
        problems += [*refused, *(Problem(part.line, where, refusal(part, text)) for (part, where), text in parts)]
    _raise_all(problems, path)
    assert root is not None
    return presets_of(root.value, known)


def _images_in(entries: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Masks in images, which would lie beside each tools file that names these presets."""
    for name, entry in entries.items():
        if isinstance(entry.get("mask"), dict) and "image" in entry["mask"]:
            yield (name, "mask"), "expected {attribute: …} or none, as an image belongs to one tools file"


def _presets_of_files(
    node: Node, name: str, *, external: bool
) -> tuple[dict[str, Preset], tuple[str, ...], list[Problem], list[ConfigError]]:
    """The presets of the files that stand after `presets`, the files, and the problems of the place and of the files.

    A preset replaces one of the same name in an earlier file.
    """
    found: dict[str, Preset] = {}
    paths: list[str] = []
    problems: list[Problem] = []
    errors: list[ConfigError] = []
    listed = node.children.items() if isinstance(node.value, list) else [(None, node)]
    for number, child in listed:
        path = path_beside(name, child.value, external=external)
        if path is None:
            place = path_to("presets", number) if number is not None else "presets"
            expected = "expected a file below the folder of this one; others are read with --allow-external"
            problems.append(Problem(child.line, place, refusal(child, expected)))
            continue
        paths.append(path)
        try:
            found |= load_presets(path, {**presets(), **found})
        except ConfigError as error:
            errors.append(error)
    return found, tuple(paths), problems, errors


def parse_tools(text: str, *, name: str = "<tools>", external: bool = False) -> ToolsFile:
    """Read tools from YAML text, which error messages call `name`.

    Files of presets that it names are read from the folder of `name`, and with `external` from others.

    Raises:
        ConfigError: All problems of the text, a line each, in the order of its lines.
    """
    return _parsed(*read_tree(text), name, external=external)


def read_values(
    values: Mapping[str, Any], *, name: str = "<tools>", known: Mapping[str, Preset] | None = None
) -> ToolsFile:
    """Read tools from plain Python values, as `parse_tools` does from YAML, but faster.

    `known` has the presets that the values name the files of; if None, these are read.
    """
    return _parsed(tree_of(values), [], name, known=known)


def _raise_all(problems: Sequence[Problem], name: str, others: Sequence[ConfigError] = ()) -> None:
    """Raise all problems of a file in the order of its lines, and those of other files behind them."""
    shown_name = printable(name, len(name))
    if problems or others:
        own = (
            ConfigError(problem.message, where=f"{shown_name}:{problem.line}: {problem.path}".rstrip(": "))
            for problem in sorted(without_tagged(problems), key=lambda problem: problem.line)
        )
        raise ConfigError.of_all(chain(own, others))


def _parsed(
    root: Node | None,
    problems: list[Problem],
    name: str,
    *,
    external: bool = False,
    known: Mapping[str, Preset] | None = None,
) -> ToolsFile:
    shown_name = printable(name, len(name))
    header: dict[str, Any] = {}
    effects: dict[str, list[_Effect]] = {}
    owners: dict[str, str] = {}
    others: list[ConfigError] = []
    if root is not None:
        if too_many := crowded(root, _FORMAT):
            _raise_all([*problems, *too_many], name)
        refused, wrong = check(root, _FORMAT)
        header, odd = _read(root, (), ToolsFile, wrong)
        if "presets" in header and known is None and not isinstance(root.value["presets"], dict):
            found, paths, unread, others = _presets_of_files(root.children["presets"], name, external=external)
            header |= {"presets": found, "preset_files": paths}
            odd += unread
            if unread or others:
                del header["presets"]
        problems = [*problems, *refused, *odd]
        if known is None and ("presets" in header or "presets" not in root.children):
            known = {**presets(), **header.get("presets", {})}
        for key, kind in KINDS.items():
            inherits = "defaults" in root.children and ITEMS[key].inherited
            defaults, odd = _read(root, ("defaults",), kind, wrong) if inherits else ({}, [])
            effects[key], odd_effects = _effects(root, key, defaults, known, wrong, owners)
            problems += [*odd, *odd_effects]
    _raise_all(problems, name, others)
    assert root is not None
    assert known is not None
    head = {key: child for key, child in root.children.items() if key not in KINDS}
    places = _places(replace(root, children=head), "", shown_name)
    inherited = {keys[1:]: place for keys, place in places.items() if keys[0] == "defaults" and keys[1:]}
    up = header.get("up", "y")
    records = [_record(KINDS[key], each, up, known, inherited, name) for key, own in effects.items() for each in own]
    return ToolsFile(path=name, **header, effects=tuple(each for each in records if each.enabled), places=places)


def load_tools(path: str | os.PathLike[str], *, external: bool = False) -> ToolsFile:
    """Read a file of tools, and those of presets that it names: below its folder, or anywhere with `external`.

    Raises:
        ConfigError: A file cannot be read, or all of its problems, a line each, in the order of its lines.
    """
    return parse_tools(load_text(path), name=os.fspath(path), external=external)


def given_values(path: str | os.PathLike[str]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The keys that a valid file of tools gives, as plain values in its own axes, and the files that were read.

    Raises:
        ConfigError: As `load_tools`.
    """
    root, problems = read_tree(load_text(path))
    settings = _parsed(root, problems, os.fspath(path))
    assert root is not None
    return root.value, (os.fspath(path), *settings.preset_files)


def load_merged(paths: Sequence[str | os.PathLike[str]], *, external: bool = False) -> ToolsFile:
    """Read several files of tools for one asset.

    Args:
        paths: The files. The first gives the result its name and its `up`, in which results are shown.
        external: Read files of presets that lie outside the folders of these too.

    Raises:
        ConfigError: All problems of the files; or two files share a tool's name, or differ in their other keys.
    """
    merged, *others = ConfigError.every(partial(load_tools, external=external), paths)
    problems: list[ConfigError] = []
    for each in others:
        problems += _differences(merged, each)
        said = {key: getattr(each, key) for key in _SHARED if (key,) in each.places}
        effects = sorted((*merged.effects, *each.effects), key=lambda effect: [*KINDS].index(effect.section))
        merged = replace(
            merged,
            **said,
            effects=tuple(effects),
            places={**merged.places, **{keys: place for keys, place in each.places.items() if keys[0] in said}},
            merged_paths=(*merged.merged_paths, each.path),
            preset_files=(*merged.preset_files, *each.preset_files),
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
