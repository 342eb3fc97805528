"""An extension for Blender 4.2 to 5 that draws the tools of `wrinkle`, previews and bakes them.

Everything is done by the command `wrinkle`, on the PATH or in an environment that the preferences name; Blender's own
Python needs nothing. The page beside this file says how to install and use it. `python wrinkle_blender.py OUT.zip`
writes the extension with its manifest.

A tool is a curve that shows its patch, with an empty at each of its points; of a field, which lies on a whole mesh, the
curve is empty. Keys of the tools file are custom
properties of the curve: numbers with their ranges, and for everything else the text that stands behind the colon in
YAML. Keys that are not set have their defaults, or what the material gives. Positions are those at rest in frame 0, as
Blender exports them.

The first half of this file needs no Blender, and can be imported without it.
"""

import atexit
import itertools
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import threading
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

try:
    import bmesh
    import bpy
    from mathutils import Matrix, Vector
    from mathutils.bvhtree import BVHTree
except ImportError:
    _kinds = dict.fromkeys(("Operator", "Panel", "AddonPreferences"), object)
    _props = dict.fromkeys(("BoolProperty", "EnumProperty", "FloatProperty", "IntProperty", "StringProperty"), dict)
    bpy = SimpleNamespace(types=SimpleNamespace(**_kinds), props=SimpleNamespace(**_props))

bl_info = {
    "name": "wrinkle",
    "description": "Dynamic wrinkles, muscles and flesh as shape keys",
    "location": "3D View > Sidebar > Wrinkle",
    "blender": (3, 4, 0),
    "version": (1, 0, 0),
    "category": "Animation",
}


@dataclass(frozen=True)
class Kind:
    """A list of the tools file: its title in menus, the points of an entry, and how many vertices make one."""

    title: str
    points: tuple[str, ...]
    picked: int


KINDS = {
    "tools": Kind("wrinkle", ("origin", "target"), 2),
    "muscles": Kind("muscle", ("origin", "insertion"), 2),
    "flesh": Kind("flesh", ("at",), 1),
    "touches": Kind("touch", ("at",), 1),
    "fields": Kind("field", (), 0),
}
# Keys of an entry that are no custom properties: Blender's objects say them.
PLACED = ("name", "node", "origin", "target", "path", "insertion", "at")
# Significant digits of a place, of its largest coordinate: micrometres on a body, and no noise of Blender's float32.
PLACE_DIGITS = 6
# Significant digits of other numbers: Blender's sliders are float32.
NUMBER_DIGITS = 6
# Blender counts the steps of a slider of floats in hundredths.
STEPS = 100

# --- what needs no Blender: text ---

_PLAIN = re.compile(r"[A-Za-z_][\w.\-/]*(?: [\w.\-/]+)*|\d+(?:\.\d+)?%")
_RESERVED = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_PERCENT = re.compile(r"([+-]?\d+(?:\.\d*)?) ?%")


def number_text(value: float) -> str:
    """A number as YAML reads it, without the digits that float32 makes up."""
    if isinstance(value, int):
        return str(value)
    text = repr(float(f"{value:.{NUMBER_DIGITS}g}") + 0.0)
    mantissa, _, exponent = text.partition("e")
    return text if not exponent or "." in mantissa else f"{mantissa}.0e{exponent}"


def flow(value: Any) -> str:
    """A value as YAML in one line."""
    match value:
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case int() | float():
            return number_text(value)
        case Mapping():
            return "{" + ", ".join(f"{flow(key)}: {flow(each)}" for key, each in value.items()) + "}"
        case list() | tuple():
            return "[" + ", ".join(map(flow, value)) + "]"
    if _PLAIN.fullmatch(value) and value.lower() not in _RESERVED:
        return str(value)
    return json.dumps(value, ensure_ascii=False)


def tidy(point: Iterable[float]) -> list[float]:
    """A place without Blender's noise: as many decimals for all coordinates."""
    values = [float(each) for each in point]
    largest = max(map(abs, values))
    decimals = PLACE_DIGITS - 1 - math.floor(math.log10(largest)) if largest else 0
    return [round(each, decimals) + 0.0 for each in values]


def tools_text(header: Mapping[str, Any], entries: Mapping[str, Sequence[Mapping[str, str]]]) -> str:
    """The text of a tools file, z up.

    Args:
        header: Keys of the file, such as `refinement`, as plain values.
        entries: For each list of the file its entries, whose values are YAML.

    Raises:
        ValueError: A value has a line break.
    """
    lines = ["version: 1", "up: z", *(f"{key}: {flow(value)}" for key, value in header.items())]
    for kind, each in entries.items():
        if each:
            lines += ["", f"{kind}:"]
        for entry in each:
            for number, (key, text) in enumerate(entry.items()):
                if not text.isprintable():
                    raise ValueError(f"{entry['name']}: {key} has a line break or another control character")
                lines.append(f"  {'- ' if number == 0 else '  '}{key}: {text}")
    return "\n".join(lines) + "\n"


def z_up(values: Mapping[str, Any]) -> dict[str, Any]:
    """A tools file, as plain values, with z up: places, offsets and mirror planes are turned if y was up.

    Raises:
        ValueError: A mask or a driver that this extension does not know has places.
    """
    if values.get("up", "y") == "z":
        return dict(values)

    def turned(key: str, value: Any) -> Any:
        if key == "mirror":
            return {"y": "z", "z": "y"}.get(value, value)
        if key in ("origin", "target", "insertion", "at", "towards", "offset") and isinstance(value, list):
            x, y, z = value
            return [x, 0.0 - z, y]
        if key in ("path", "along"):
            return [turned("at", each) if isinstance(each, list) else each for each in value]
        if key in ("defaults", "by", "origin", "insertion") and isinstance(value, dict):
            return {inner: turned(inner, each) for inner, each in value.items()}
        if key in KINDS:
            return [{inner: turned(inner, each) for inner, each in entry.items()} for entry in value]
        return value

    return {key: turned(key, value) for key, value in values.items()} | {"up": "z"}


_SIDE = re.compile(
    r"(?:^|(?<=[._\- :]))[LRlr](?=$|[._\- :])|(?:Left|Right)(?![a-z])|"
    r"(?<![A-Za-z])(?:left|right)(?![a-z])|(?<![A-Z])(?:LEFT|RIGHT)(?![A-Z])"
)
_SIDES = {"L": "R", "l": "r", "Left": "Right", "left": "right", "LEFT": "RIGHT"}
_SIDES |= {right: left for left, right in _SIDES.items()}


def other_side(name: str) -> str:
    """A name with left and right exchanged, as `mirror` in a tools file does; the same name if it says no side."""
    return _SIDE.sub(lambda found: _SIDES[found[0]], name)


def other_side_of_text(text: str) -> str:
    """The names in a line of YAML with left and right exchanged."""
    return re.sub(r"[^\[\]{},\"']+", lambda word: other_side(word[0]), text)


def free_name(stem: str, taken: Collection[str]) -> str:
    """A name that differs from the others as names of morph targets do, where only letters, digits and _ count."""
    used = {_identifier(each) for each in taken}
    names = itertools.chain([stem], (f"{stem}_{number}" for number in itertools.count(2)))
    return next(name for name in names if _identifier(name) not in used)


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name)


def row(picked: Sequence[int], chosen: Collection[int], edges: Iterable[tuple[int, int]]) -> list[int]:
    """The chosen vertices in the order of a path.

    Args:
        picked: Vertices in the order in which they were clicked, as far as Blender knows.
        chosen: All selected vertices.
        edges: Edges whose two vertices are selected.

    Raises:
        ValueError: They were not all clicked one by one, and are no chain of edges either.
    """
    order = [each for each in picked if each in chosen]
    if len(order) == len(chosen) or len(chosen) <= 2:
        return order if len(order) == len(chosen) else sorted(chosen)
    beside: dict[int, list[int]] = {each: [] for each in chosen}
    for a, b in edges:
        beside[a].append(b)
        beside[b].append(a)
    ends = sorted(each for each, others in beside.items() if len(others) == 1)
    if len(ends) == 2 and all(len(others) <= 2 for others in beside.values()):
        # The end that was clicked last is the end of the path.
        found = [ends[0] if not order or order[-1] != ends[0] else ends[1]]
        while len(found) < len(chosen):
            following = [each for each in beside[found[-1]] if each not in found[-2:]]
            if not following:
                break
            found.append(following[0])
        if len(found) == len(chosen):
            return found
    raise ValueError("pick the vertices of a path one by one, or a chain of edges")


# --- what needs no Blender: keys and their ranges ---


@dataclass(frozen=True)
class Field:
    """A custom property: its value, and what Blender shows beside it. A percentage is a number with its subtype."""

    value: Any
    shown: Mapping[str, Any]


def keys_of(schema: Mapping[str, Any], kind: str) -> dict[str, Mapping[str, Any]]:
    """The keys of an entry of a list of the file that are custom properties, each with its schema."""
    found = schema["properties"][kind]["items"]["properties"]
    return {key: each for key, each in found.items() if key not in PLACED}


def choices(key_schema: Mapping[str, Any]) -> list[str]:
    """The words among which a key chooses, as YAML; none if it takes other values only."""
    words = next((part[key] for part in _parts(key_schema) for key in ("enum", "examples") if key in part), ())
    # `off` needs no quotes: the schema takes what YAML makes of it.
    return [str(each) for each in words if each is not None and not isinstance(each, bool)]


def _parts(key_schema: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """A schema, and those of its parts that are no mappings."""
    yield from (key_schema, *key_schema.get("anyOf", ()))
    if "else" in key_schema:
        yield from _parts(key_schema["else"])


def _bounds(key_schema: Mapping[str, Any], *, percent: bool) -> dict[str, float]:
    """The least and greatest number that a key takes; those of a percentage stand in the message of its schema."""
    parts = [*_parts(key_schema)]
    if percent:
        said = (re.search(r"percentage from ([\d.]+)% to ([\d.]+)%", part.get("errorMessage", "")) for part in parts)
        return next(({"min": float(each[1]), "max": float(each[2])} for each in said if each), {})
    part = next((part for part in parts if "minimum" in part or "maximum" in part), {})
    return {short: part[name] for short, name in (("min", "minimum"), ("max", "maximum")) if name in part}


def _slides(key_schema: Mapping[str, Any], *, percent: bool) -> dict[str, float]:
    """The numbers over which a key's slider goes, if it is one of percentages or not, as Blender is told of them."""
    slider = next((part["slider"] for part in _parts(key_schema) if "slider" in part), {})
    if not slider or (slider.get("unit") == "%") != percent:
        return {}
    step = slider["step"] * (1 if _is_whole(key_schema) else STEPS)
    return {"soft_min": slider["minimum"], "soft_max": slider["maximum"], "step": step}


def _is_whole(key_schema: Mapping[str, Any]) -> bool:
    """True if a key takes whole numbers alone."""
    return key_schema.get("type") in ("integer", ["integer", "null"])


def groups_of(keys: Mapping[str, Mapping[str, Any]]) -> dict[str, list[str]]:
    """The keys of an entry by their groups; a `wrinkle` of old has none."""
    found: dict[str, list[str]] = {}
    for key, key_schema in keys.items():
        found.setdefault(key_schema.get("group", ""), []).append(key)
    return found


def field(key_schema: Mapping[str, Any], text: str) -> Field:
    """The custom property that holds a value, given as YAML: a number with its range, a switch, or the text itself."""
    shown: dict[str, Any] = {"description": key_schema.get("description", "")}
    text = text.strip()
    percent = _PERCENT.fullmatch(text)
    ends = _bounds(key_schema, percent=bool(percent)) | _slides(key_schema, percent=bool(percent))
    if percent:
        return Field(float(percent[1]), shown | ends | {"subtype": "PERCENTAGE"})
    if text in ("true", "false"):
        return Field(text == "true", shown)
    if _NUMBER.fullmatch(text) and (not choices(key_schema) or "anyOf" in key_schema):
        number = int if _is_whole(key_schema) else float
        return Field(number(float(text)), shown | {end: number(each) for end, each in ends.items()})
    return Field(text, shown)


def written(value: Any, subtype: str | None) -> str:
    """A custom property as YAML."""
    if isinstance(value, str):
        return value
    return f"{number_text(value).removesuffix('.0')}%" if subtype == "PERCENTAGE" else flow(value)


# --- what needs no Blender: the command ---


def find_command(chosen: str) -> str:
    """The path of `wrinkle`: on the PATH, or a chosen program, or in a chosen environment.

    Raises:
        FileNotFoundError: It is not there.
    """
    if not chosen:
        found = shutil.which("wrinkle")
        if found is None:
            raise FileNotFoundError(
                "no `wrinkle` on the PATH: install it, or choose its environment in the preferences"
            )
        return found
    place = Path(chosen).expanduser()
    programs = (place, *(place / each for each in ("bin/wrinkle", "Scripts/wrinkle.exe", "wrinkle", "wrinkle.exe")))
    found_here = next((each for each in programs if each.is_file()), None)
    if found_here is None:
        raise FileNotFoundError(f"{chosen}: is no `wrinkle`, and no environment with one")
    return str(found_here)


def bake_command(command: str, asset: Path, tools: Path, out: Path, *, draft: bool) -> list[str]:
    """The command line of a bake that says how far it is."""
    return [command, "bake", str(asset), str(tools), "-o", str(out), "--progress", *(["--draft"] if draft else [])]


def quiet_start() -> dict[str, Any]:
    """Start commands so that they speak UTF-8 and open no console in Windows."""
    return {"env": {**os.environ, "PYTHONUTF8": "1"}, "creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}


def progress_of(line: str) -> tuple[str, float] | None:
    """The stage and its part done, 0 to 1, that a line of `wrinkle bake --progress` says; None for other lines."""
    found = re.fullmatch(r"progress: (.+) (\d+)%", line.strip())
    return None if found is None else (found[1], int(found[2]) / 100)


def without_paths(said: str, tools: Path, out: Path) -> str:
    """Give what a bake said, without the names and lines of temporary files."""
    return re.sub(rf"{re.escape(str(tools))}:\d+: ", "", said).replace(f"{out}: ", "")


class Job:
    """A command that runs in the background; `stage`, `part` (0 to 1) and `lines` say how far it is."""

    def __init__(self, command: Sequence[str]) -> None:
        self.stage, self.part, self.is_stopped = "starting", 0.0, False
        self.lines: list[str] = []
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            encoding="utf-8", errors="replace", **quiet_start(),
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as said:
            for line in said:
                if (progress := progress_of(line)) is not None:
                    self.stage, self.part = progress
                else:
                    self.lines.append(line.rstrip())

    def code(self) -> int | None:
        """The exit code, once it has ended and all that it said is read."""
        return None if self._reader.is_alive() else self._process.wait()

    def wait(self) -> int:
        """Wait for its end; the exit code."""
        self._reader.join()
        return self._process.wait()

    def stop(self) -> None:
        """End it."""
        self.is_stopped = True
        self._process.terminate()


def extension_zip(out: Path) -> None:
    """Write the extension: this file as the package that Blender expects, and its manifest."""
    here = Path(__file__)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as package:
        for name, source in (("__init__.py", here), ("blender_manifest.toml", here.with_name("blender_manifest.toml"))):
            package.writestr(zipfile.ZipInfo(name, (2026, 1, 1, 0, 0, 0)), source.read_bytes())


# --- tools as objects of Blender ---

# Part of its length by which a tool's lines float above the surface, so that they are seen.
_LIFT = 0.01
# Points along a line of a patch, and across it.
_ALONG, _ACROSS = 16, 6
# Width that is drawn, of the length, where a material gives the width.
_USUAL_WIDTH = 0.8
# Radius of a new region of flesh, and of a new touch's pad, of the largest side of the mesh.
_NEW_RADIUS = {"flesh": 0.1, "touches": 0.015}
# Way from the skin towards the bone that the ends of a new muscle take.
_MUSCLE_DEPTH = 0.5
_COLLECTION = "Wrinkle tools"
_PREVIEWS = "Wrinkle preview"


def kind_of(thing: Any) -> str:
    """The list of the file that a tool's object belongs to; empty for other objects."""
    return str(thing.get("wrinkle_kind", "")) if thing is not None else ""


def tools_of(scene: Any) -> list[Any]:
    """The tools of a scene, in the order in which they were made."""
    return sorted((each for each in scene.objects if kind_of(each)), key=lambda each: each["wrinkle_order"])


def points_of(tool: Any) -> list[Any]:
    """The empties of a tool from its origin to its target.

    Raises:
        ValueError: One has been deleted or doubled.
    """
    # They stand in the tool's collections, unless somebody has moved them: not to look through a whole city.
    beside = [each for collection in tool.users_collection for each in collection.objects]
    found = [each for each in beside if each.get("wrinkle_tool") == tool]
    wanted = len(KINDS[kind_of(tool)].points)
    if len(found) < wanted:
        found = [each for each in bpy.data.objects if each.get("wrinkle_tool") == tool and each.users_scene]
    empties = [*dict.fromkeys(found)]
    empties.sort(key=lambda each: each["wrinkle_number"])
    is_doubled = len({each["wrinkle_number"] for each in empties}) < len(empties)
    if is_doubled or len(empties) < wanted or (len(empties) > wanted and not tool["wrinkle_path"]):
        raise ValueError(f"{tool['name']}: has {len(empties)} points; undo, or delete the tool")
    return empties


def tool_at(context: Any) -> Any:
    """The tool of the active object; else the one that was made or selected last; None if there is none."""
    active = context.object
    for each in (active, active.get("wrinkle_tool") if active else None, context.scene.get("wrinkle_active")):
        if kind_of(each) and each.name in context.scene.objects:
            return each
    return None


def body_at(context: Any) -> Any:
    """The mesh that tools are drawn on: the active one, that of the active tool, or the only one that is skinned.

    Raises:
        ValueError: There is none.
    """
    active = context.object
    if active is not None and active.type == "MESH":
        return bpy.data.objects.get(active.get("wrinkle_preview_of", ""), active)
    if (tool := tool_at(context)) is not None and tool["wrinkle_mesh"] is not None:
        return tool["wrinkle_mesh"]
    skinned = [each for each in context.scene.objects if each.type == "MESH" and armature_of(each)]
    if len(skinned) == 1:
        return skinned[0]
    raise ValueError("select the mesh")


def armature_of(body: Any) -> Any:
    """The armature that deforms a mesh; None if there is none."""
    modified = (each.object for each in body.modifiers if each.type == "ARMATURE" and each.object)
    parent = body.parent if body.parent is not None and body.parent.type == "ARMATURE" else None
    return next(modified, parent)


def bodies_with(body: Any, scene: Any) -> list[Any]:
    """A mesh, and those of its armature that have tools or move with its flesh: what is exported together."""
    armature = armature_of(body)
    tools = tools_of(scene)
    wanted = [each["wrinkle_mesh"] for each in tools]
    named = " ".join(str(each.get("meshes", "")) for each in tools)
    beside = [
        each for each in scene.objects if each.type == "MESH" and re.search(rf"\b{re.escape(each.name)}\b", named)
    ]
    others = {
        each
        for each in (*wanted, *beside)
        if each is not None and armature is not None and armature_of(each) == armature
    }
    return sorted({body, *others}, key=lambda each: each.name)


class Skin:
    """The surface of a mesh at rest, in world space, and the bones that carry it."""

    def __init__(self, body: Any) -> None:
        self.body, self.armature = body, armature_of(body)
        place = body.matrix_world
        self._corners = [tuple(each.vertices) for each in body.data.polygons]
        points = [place @ each.co for each in body.data.vertices]
        self.size = max(max(axis) - min(axis) for axis in zip(*points, strict=True)) if points else 0.0
        self._tree = BVHTree.FromPolygons(points, self._corners)

    def nearest(self, point: Any) -> tuple[Any, Any]:
        """The nearest point of the surface and its normal."""
        found, normal, _, _ = self._tree.find_nearest(point)
        return (point, Vector((0, 0, 1))) if found is None else (found, normal)

    def bone_at(self, point: Any) -> str:
        """The bone of most weight at the nearest face; empty if none has any."""
        _, _, face, _ = self._tree.find_nearest(point)
        return "" if face is None else self.bone_of(self._corners[face])

    def bone_of(self, vertices: Iterable[int]) -> str:
        """The bone of most weight at some vertices; empty if none has any."""
        if self.armature is None:
            return ""
        sums: dict[str, float] = {}
        names = [each.name for each in self.body.vertex_groups]
        for number in vertices:
            for group in self.body.data.vertices[number].groups:
                name = names[group.group]
                bone = self.armature.data.bones.get(name)
                if bone is not None and bone.use_deform:
                    sums[name] = sums.get(name, 0.0) + group.weight
        return max(sums, key=lambda name: sums[name]) if any(sums.values()) else ""


def _carrier(empty: Any) -> Any:
    """The matrix of what carries an empty in the rest pose, world space."""
    parent = empty.parent
    if parent is None:
        return Matrix()
    if empty.parent_type != "BONE":
        return parent.matrix_world @ empty.matrix_parent_inverse
    bone = parent.data.bones[empty.parent_bone]
    tail = bone.matrix_local @ Matrix.Translation((0, bone.length, 0))
    return parent.matrix_world @ tail @ empty.matrix_parent_inverse


def at_rest(empty: Any) -> Any:
    """(4, 4) matrix of an empty in the rest pose, world space."""
    return _carrier(empty) @ empty.matrix_basis


def _collection(scene: Any, name: str) -> Any:
    found = next((each for each in scene.collection.children if each.name.split(".")[0] == name), None)
    if found is None:
        found = bpy.data.collections.new(name)
        scene.collection.children.link(found)
    return found


def make_tool(scene: Any, kind: str, name: str, skin: Skin, places: Sequence[tuple[Any, str]]) -> Any:
    """Make the objects of a tool.

    Args:
        scene: The scene that gets them.
        kind: List of the tools file.
        name: The tool's name.
        skin: The surface that it lies on.
        places: Each of its points at rest, world space, and the bone that carries it.
    """
    tool = bpy.data.objects.new(name, bpy.data.curves.new(name, "CURVE"))
    tool.data.dimensions = "3D"
    tool.hide_render = tool.show_in_front = True
    tool.color = (1.0, 0.55, 0.1, 1.0)
    collection = _collection(scene, _COLLECTION)
    collection.objects.link(tool)
    orders = [each["wrinkle_order"] for each in tools_of(scene)]
    tool["name"], tool["wrinkle_kind"] = name, kind
    tool["wrinkle_order"] = max(orders, default=0) + 1
    tool["wrinkle_mesh"], tool["wrinkle_node"] = skin.body, True
    tool["wrinkle_path"] = len(places) > len(KINDS[kind].points)
    for number, (place, bone) in enumerate(places):
        empty = bpy.data.objects.new("point", None)
        collection.objects.link(empty)
        empty["wrinkle_tool"], empty["wrinkle_number"] = tool, number
        empty.empty_display_size = 0.01 * skin.size
        empty.empty_display_type = "SPHERE"
        empty.show_in_front = empty.hide_render = True
        if bone:
            empty.parent, empty.parent_type, empty.parent_bone = skin.armature, "BONE", bone
        else:
            empty.parent = skin.body
        empty.matrix_basis = Matrix.Translation(_carrier(empty).inverted() @ Vector(place))
    _name(tool, name)
    scene["wrinkle_active"] = tool
    return tool


def _name(tool: Any, name: str) -> None:
    """Name a tool and its objects."""
    tool["name"] = tool.name = tool.data.name = name
    empties = points_of(tool)
    names = KINDS[kind_of(tool)].points
    if tool["wrinkle_path"]:
        names = ("origin", *(f"path_{number}" for number in range(1, len(empties) - 1)), "target")
    for point, empty in zip(names, empties, strict=True):
        empty.name = f"{name}.{point}"


def delete_tool(tool: Any) -> None:
    """Delete the objects of a tool."""
    empties = [each for each in bpy.data.objects if each.get("wrinkle_tool") == tool]
    curve = tool.data
    for each in (*empties, tool):
        bpy.data.objects.remove(each)
    bpy.data.curves.remove(curve)


def own_keys(tool: Any) -> list[str]:
    """The keys of the file that a tool gives."""
    return [key for key in tool.keys() if key not in PLACED and not key.startswith("wrinkle_")]  # noqa: SIM118


def set_key(tool: Any, key: str, text: str) -> None:
    """Give a tool a key: a value as YAML.

    Raises:
        ValueError: Tools of this kind have no such key.
    """
    known = keys_of(schema(), kind_of(tool))
    if key not in known:
        raise ValueError(f"{tool['name']}: {key} is no key of a {KINDS[kind_of(tool)].title}")
    made = field(known[key], text)
    tool.pop(key, None)
    tool[key] = made.value
    tool.id_properties_ui(key).update(**made.shown)


def key_text(tool: Any, key: str) -> str:
    """A tool's key as YAML."""
    value = tool[key]
    shown = {} if isinstance(value, str | bool) else tool.id_properties_ui(key).as_dict()
    return written(value, shown.get("subtype"))


def entry_of(tool: Any) -> dict[str, str]:
    """A tool as the entry of a tools file: keys, with their values as YAML."""
    kind, empties = kind_of(tool), points_of(tool)
    entry = {"name": flow(tool["name"])}
    if tool["wrinkle_node"] and tool["wrinkle_mesh"] is not None:
        entry["node"] = flow(tool["wrinkle_mesh"].name)
    places = [tidy(at_rest(each).translation) for each in empties]
    if tool["wrinkle_path"]:
        entry["path"] = flow(places)
    elif kind == "muscles":
        for key, empty in zip(KINDS[kind].points, empties, strict=True):
            entry[key] = _muscle_end(empty)
    elif not (kind == "flesh" and "radius" not in tool):
        entry |= dict(zip(KINDS[kind].points, map(flow, places), strict=True))
    return entry | {key: key_text(tool, key) for key in own_keys(tool)}


def _muscle_end(empty: Any) -> str:
    """An end of a muscle: its place from the joint that carries it, as wrinkle would else take the nearest bone."""
    place = at_rest(empty).translation
    if empty.parent_type != "BONE":
        return flow(tidy(place))
    head = empty.parent.matrix_world @ empty.parent.data.bones[empty.parent_bone].head_local
    return flow({"joint": empty.parent_bone, "offset": tidy(place - head)})


# --- what a tool's curve shows ---


def _length(tool: Any, key: str, whole: float, usual: float) -> float:
    """A length of a tool in scene units; a percentage is of `whole`."""
    value = tool.get(key)
    if not isinstance(value, float | int):
        return usual
    is_share = tool.id_properties_ui(key).as_dict().get("subtype") == "PERCENTAGE"
    return whole * value / 100 if is_share else value


def lines_of(tool: Any, skin: Skin) -> list[list[tuple[Any, int]]]:
    """The lines that show a tool at rest, world space; each point with the number of the empty that it follows."""
    places = [at_rest(each).translation for each in points_of(tool)]
    match kind_of(tool):
        case "tools":
            return _patch_lines(tool, skin, places)
        case "muscles":
            return [[(places[0], 0), (places[1], 1)]]
        case "flesh":
            return [_ring(skin, places[0], _length(tool, "radius", 0.0, 0.0))]
        case "fields":  # the whole mesh
            return []
        case _:
            pad = _length(tool, "pad", 0.0, 0.0)
            return [_ring(skin, places[0], pad), _ring(skin, places[0], pad + _length(tool, "reach", pad, 1.1 * pad))]


def _patch_lines(tool: Any, skin: Skin, places: Sequence[Any]) -> list[list[tuple[Any, int]]]:
    """The middle of a patch, its border, and its crests, draped over the surface."""
    steps = [(b - a).length for a, b in itertools.pairwise(places)]
    total = sum(steps)
    if not total:
        return []
    half = _length(tool, "width", total, _USUAL_WIDTH * total) / 2
    bumps = tool.get("bumps", 0)

    def draped(u: float, v: float) -> tuple[Any, int]:
        """The point at a part of the length, and at a part of half the width to one side."""
        rest, number = u * total, 0
        while number < len(steps) - 1 and rest > steps[number]:
            rest, number = rest - steps[number], number + 1
        part = min(rest / steps[number], 1.0) if steps[number] else 0.0
        along = places[number + 1] - places[number]
        found, normal = skin.nearest(places[number].lerp(places[number + 1], part))
        # In small steps, so that a wide patch goes round a limb, and not over to the other one.
        steps_aside = math.ceil(abs(v) * _ACROSS)
        for _ in range(steps_aside):
            found, normal = skin.nearest(found + normal.cross(along).normalized() * (v * half / steps_aside))
        return found + normal * (_LIFT * total), number + (part > 0.5)

    def line(begin: tuple[float, float], end: tuple[float, float], count: int) -> list[tuple[Any, int]]:
        parts = (step / count for step in range(count + 1))
        return [draped(*(a + (b - a) * part for a, b in zip(begin, end, strict=True))) for part in parts]

    border = [line((0, v), (1, v), _ALONG) for v in (-1, 0, 1)]
    crests = ((bump + 0.5) / bumps for bump in range(bumps if isinstance(bumps, int) else 0))
    return [*border, *(line((u, -1), (u, 1), _ACROSS) for u in (0, *crests, 1))]


def _ring(skin: Skin, middle: Any, radius: float) -> list[tuple[Any, int]]:
    """A circle about a place, draped over the surface."""
    found, normal = skin.nearest(middle)
    side = normal.orthogonal().normalized() * radius
    other = normal.cross(side)
    angles = (math.tau * step / (2 * _ALONG) for step in range(2 * _ALONG + 1))
    around = (found + side * math.cos(angle) + other * math.sin(angle) for angle in angles)
    return [(point + away * (_LIFT * radius), 0) for point, away in map(skin.nearest, around)]


def draw_tool(tool: Any) -> None:
    """Draw a tool's curve at rest; hooks let it follow the empties in every pose."""
    empties, curve = points_of(tool), tool.data
    lines = lines_of(tool, Skin(tool["wrinkle_mesh"]))
    curve.splines.clear()
    hooked: dict[int, list[int]] = {number: [] for number in range(len(empties))}
    count = 0
    for line in lines:
        spline = curve.splines.new("POLY")
        spline.points.add(len(line) - 1)
        for point, (place, number) in zip(spline.points, line, strict=True):
            point.co = (*place, 1.0)
            hooked[number].append(count)
            count += 1
    tool.modifiers.clear()
    for number, empty in enumerate(empties):
        if hooked[number]:
            hook = tool.modifiers.new(empty.name, "HOOK")
            hook.object, hook.falloff_type = empty, "NONE"
            hook.matrix_inverse = at_rest(empty).inverted() @ tool.matrix_world
            hook.vertex_indices_set(hooked[number])
    if kind_of(tool) == "flesh" and isinstance(tool.get("radius"), float):
        empties[0].empty_display_size = tool["radius"]


_drawn: dict[str, Any] = {}


def _signature(tool: Any) -> Any:
    """Give all that the curve of a tool depends on."""
    places = [tuple(round(value, 6) for value in at_rest(each).translation) for each in points_of(tool)]
    return places, [str(tool.get(key)) for key in ("width", "bumps", "radius", "pad", "reach")]


def draw_changed(scene: Any, *_: Any) -> None:
    """Draw the tools anew whose points or keys have changed, and let previews play the clip of their armature.

    Blender calls this after each change and frame: 8 ms with twenty tools among 5,000 objects, nothing without tools.
    """
    if "wrinkle_active" not in scene:
        return
    for tool in tools_of(scene):
        with suppress(ValueError, ReferenceError, AttributeError):  # a tool of which something has just been deleted
            signature = _signature(tool)
            if _drawn.get(tool.name) != signature:
                _drawn[tool.name] = signature
                draw_tool(tool)
    for each in scene.objects:
        if each.get("wrinkle_preview_of"):
            play_clip(each)


# --- assets ---


# What keeps an export lossless: every influence, whole actions, and modifiers off, as these would drop shape keys.
_EXPORT = {
    "export_format": "GLB",
    "use_selection": True,
    "export_apply": False,
    "export_yup": True,
    "export_skins": True,
    "export_all_influences": True,
    "export_rest_position_armature": True,
    "export_def_bones": False,
    "export_morph": True,
    "export_morph_normal": True,
    "export_attributes": True,
    "export_animations": True,
    "export_animation_mode": "ACTIONS",
    "export_frame_range": False,
    "export_force_sampling": True,
    "export_frame_step": 1,
    "export_optimize_animation_size": False,
    "export_current_frame": False,
    "export_draco_mesh_compression_enable": False,
    "export_extras": True,
}


_CHANNELS = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale")


@contextmanager
def kept(context: Any, bodies: Sequence[Any]) -> Iterator[None]:
    """Leave the mode and frame, and restore them, the selection, and poses that have no key."""
    layer, scene = context.view_layer, context.scene
    mode = context.mode
    active = layer.objects.active.name if layer.objects.active is not None else ""
    selected = {each.name for each in layer.objects if each.select_get()}
    hidden = [each for each in bodies if each.hide_get()]
    frame = scene.frame_current, scene.frame_subframe
    armatures = {each for each in map(armature_of, bodies) if each is not None}
    posed = [*(bone for armature in armatures for bone in armature.pose.bones), *armatures, *bodies]
    poses = [(each, key, (*getattr(each, key),)) for each in posed for key in _CHANNELS]
    values = [(key, key.value) for each in bodies if each.data.shape_keys for key in each.data.shape_keys.key_blocks]
    # They are not exported, but would be evaluated in each frame: 0.4 s for a subdivided head of 20,000 triangles.
    shown = [each for body in bodies for each in body.modifiers if each.type != "ARMATURE" and each.show_viewport]
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for each in shown:
        each.show_viewport = False
    try:
        yield
    finally:
        scene.frame_set(frame[0], subframe=frame[1])
        for each, key, numbers in poses:
            setattr(each, key, numbers)
        for key, value in values:
            key.value = value
        for each in shown:
            each.show_viewport = True
        layer.update()
        for each in layer.objects:
            each.select_set(each.name in selected)
        for each in hidden:
            each.hide_set(True)
        layer.objects.active = layer.objects.get(active)
        if mode != "OBJECT" and layer.objects.active is not None:
            bpy.ops.object.mode_set(mode="EDIT" if mode.startswith("EDIT") else mode)


def export_asset(context: Any, bodies: Sequence[Any], path: Path) -> None:
    """Export meshes with their armature and actions. Called within `kept`."""
    wanted = {*bodies}
    for each in bodies:
        armature = armature_of(each)
        above = [armature] if armature is not None else []
        above.append(each.parent)
        while above:
            other = above.pop()
            if other is not None and other not in wanted:
                wanted.add(other)
                above.append(other.parent)
    for each in context.view_layer.objects:
        if each in wanted:
            each.hide_set(False)
        each.select_set(each in wanted)
    context.view_layer.objects.active = bodies[0]
    known = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()
    options = {key: value for key, value in _EXPORT.items() if key in known}
    bpy.ops.export_scene.gltf(filepath=str(path), **options)


def file_text(scene: Any, bodies: Sequence[Any]) -> str:
    """The tools of some meshes as the text of a tools file.

    Raises:
        ValueError: There are none, or a tool lacks a point.
    """
    entries: dict[str, list[dict[str, str]]] = {}
    for kind in KINDS:
        tools = [each for each in tools_of(scene) if kind_of(each) == kind and each["wrinkle_mesh"] in bodies]
        entries[kind] = [*map(entry_of, tools)]
    if not any(entries.values()):
        raise ValueError("no tools yet: add a field, or pick two vertices and add a wrinkle")
    return tools_text(json.loads(scene.get("wrinkle_file", "{}")), entries)


def load_values(context: Any, values: Mapping[str, Any], body: Any) -> list[Any]:
    """Make the tools of a file, given as plain values, in place of those of the same names; the tools.

    Raises:
        ValueError: The file names an object or a bone that the scene lacks.
    """
    values = z_up(values)
    scene = context.scene
    places: list[tuple[str, Mapping[str, Any], Skin, list[tuple[Any, str]]]] = []
    skins: dict[str, Skin] = {}
    for kind in KINDS:
        for entry in values.get(kind, ()):
            node = entry.get("node") or values.get("defaults", {}).get("node") or body.name
            if node not in bpy.data.objects or bpy.data.objects[node].type != "MESH":
                raise ValueError(f"{entry['name']}: no mesh is named {node}")
            skin = skins.setdefault(node, Skin(bpy.data.objects[node]))
            points = entry.get("path") or [entry[key] for key in KINDS[kind].points if key in entry]
            if kind == "flesh" and not points:
                points = [[*skin.body.matrix_world.translation]]
            places.append((kind, entry, skin, [_placed(each, skin, entry["name"]) for each in points]))
    names = {entry["name"] for _, entry, _, _ in places}
    for each in tools_of(scene):
        if each["name"] in names:
            delete_tool(each)
    made = []
    for kind, entry, skin, points in places:
        tool = make_tool(scene, kind, entry["name"], skin, points)
        tool["wrinkle_node"] = "node" in entry
        tool["wrinkle_path"] = "path" in entry
        _name(tool, entry["name"])
        for key, value in entry.items():
            if key not in PLACED:
                set_key(tool, key, flow(value))
        made.append(tool)
    header = {key: value for key, value in values.items() if key not in (*KINDS, "version", "up")}
    scene["wrinkle_file"] = json.dumps(header)
    return made


def _placed(point: Any, skin: Skin, name: str) -> tuple[Any, str]:
    """A point of the file, with z up, in world space at rest, and the bone that carries it."""
    if isinstance(point, dict) and "marker" in point:
        marker = bpy.data.objects.get(point["marker"])
        if marker is None:
            raise ValueError(f"{name}: no object is named {point['marker']}")
        place = at_rest(marker).translation
        return place, skin.bone_at(place)
    if isinstance(point, dict):
        bone = skin.armature.data.bones.get(point["joint"]) if skin.armature is not None else None
        if bone is None:
            raise ValueError(f"{name}: no bone is named {point['joint']}")
        head = skin.armature.matrix_world @ bone.head_local
        return head + Vector(point.get("offset", (0, 0, 0))), bone.name
    return Vector(point), skin.bone_at(Vector(point))


# --- previews ---


def import_preview(context: Any, path: Path, bodies: Sequence[Any]) -> list[Any]:
    """Bring the meshes of a baked file back beside the originals, on their armature; the new objects. Within `kept`.

    Materials are those of the originals; all else that the file has is removed.
    """
    kinds = ("objects", "meshes", "armatures", "materials", "images", "actions", "collections")
    before = {kind: {*getattr(bpy.data, kind)} for kind in kinds}
    bpy.ops.import_scene.gltf(filepath=str(path), merge_vertices=False)
    new = {kind: [each for each in getattr(bpy.data, kind) if each not in before[kind]] for kind in kinds}
    previews = []
    # All are found before the first is renamed.
    for body, made in [*_pairs(path, bodies, [each for each in new["objects"] if each.type == "MESH"])]:
        _remove_preview(body)
        _put_beside(context.scene, body, made)
        previews.append(made)
    used = {*previews, *(action for each in previews for action in _actions_of(each))}
    for kind in ("objects", "collections", "actions"):
        bpy.data.batch_remove([each for each in new[kind] if each not in used])
    for kind in ("meshes", "armatures", "materials", "images"):
        bpy.data.batch_remove([each for each in new[kind] if each.users == 0])
    return previews


def _stem(name: str) -> str:
    return re.sub(r"\.\d{3,}$", "", name)


def _pairs(path: Path, bodies: Sequence[Any], meshes: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Each original with its imported mesh. Blender numbers names that are taken, in the order of the file's nodes."""
    data = path.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    names = [node.get("name", "") for node in document["nodes"] if "mesh" in node]
    imported = sorted(meshes, key=lambda each: (_stem(each.name), len(each.name), each.name))
    for body in bodies:
        same = [name for name in names if _stem(name) == _stem(body.name)]
        found = [each for each in imported if _stem(each.name) == _stem(body.name)]
        if body.name in same and len(found) == len(same):
            yield body, found[same.index(body.name)]


def _remove_preview(body: Any) -> None:
    for each in [*bpy.data.objects]:
        if each.get("wrinkle_preview_of") == body.name:
            mesh, actions = each.data, _actions_of(each)
            bpy.data.objects.remove(each)
            bpy.data.meshes.remove(mesh)
            bpy.data.batch_remove(actions)


def _slide_back(body: Any, made: Any) -> None:
    """Put weights where the originals' keys are: Blender exports an action that begins before frame 0 from there on."""
    keys = made.data.shape_keys
    if keys is None or keys.animation_data is None:
        return
    begins = {each.name: each.frame_range[0] for each in bpy.data.actions}
    for owner in (armature_of(body), body.data.shape_keys, body):
        for track in owner.animation_data.nla_tracks if owner is not None and owner.animation_data is not None else ():
            if track.strips and track.strips[0].action is not None:
                begins[track.name] = track.strips[0].action.frame_range[0]
    for track in keys.animation_data.nla_tracks:
        slide = min(math.floor(begins.get(track.name, 0)), 0)
        for key in (
            key for strip in track.strips for curve in _curves_of(strip.action) for key in curve.keyframe_points
        ):
            for place in (key.co, key.handle_left, key.handle_right):
                place.x += slide


def _curves_of(action: Any) -> Iterator[Any]:
    """The curves of an action, in layers since Blender 4.4."""
    if not hasattr(action, "layers"):
        yield from action.fcurves
        return
    for layer in action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                yield from bag.fcurves


def _actions_of(preview: Any) -> list[Any]:
    """The actions of a preview's shape keys."""
    keys = preview.data.shape_keys
    tracks = keys.animation_data.nla_tracks if keys is not None and keys.animation_data is not None else ()
    return [*{strip.action for track in tracks for strip in track.strips if strip.action is not None}]


def _put_beside(scene: Any, body: Any, made: Any) -> None:
    """Link an imported mesh in the place of the original, deformed by the same armature."""
    armature = armature_of(body)
    if made.parent is not None and made.parent.type == "ARMATURE" and armature is not None:
        place = made.matrix_local.copy()
        made.parent = armature
        made.matrix_parent_inverse, made.matrix_basis = Matrix(), place
        for modifier in made.modifiers:
            if modifier.type == "ARMATURE":
                modifier.object = armature
    else:
        made.parent, made.matrix_parent_inverse, made.matrix_basis = body, Matrix(), Matrix()
    if made.animation_data is not None:
        made.animation_data_clear()
    for collection in [*made.users_collection]:
        collection.objects.unlink(made)
    _collection(scene, _PREVIEWS).objects.link(made)
    originals = [slot.material for slot in body.material_slots if slot.material]
    by_name = {_stem(each.name): each for each in originals} | {each.name: each for each in originals}
    for slot in made.material_slots:
        if slot.material is not None:
            name = slot.material.name
            slot.material = by_name.get(name) or by_name.get(_stem(name)) or slot.material
    # Since 4.4 an action also moves the imported armature, and would be exported as a clip of the original.
    for action in _actions_of(made):
        for slot in [each for each in getattr(action, "slots", ()) if each.target_id_type != "KEY"]:
            action.slots.remove(slot)
    _slide_back(body, made)
    made["wrinkle_preview_of"] = body.name
    made.name = f"{body.name}.wrinkled"
    play_clip(made)


def clips_of(body: Any) -> list[str]:
    """Names that an exported clip may have which plays on a mesh's armature, its shape keys or itself.

    Blender exports an action by the name of its NLA track, if it is in one, else by its own.
    """
    for owner in (armature_of(body), body.data.shape_keys, body):
        animation = owner.animation_data if owner is not None else None
        if animation is not None and (action := animation.action) is not None:
            tracks = (each for each in animation.nla_tracks if any(strip.action == action for strip in each.strips))
            return [*(each.name for each in tracks), action.name]
    return []


def play_clip(preview: Any) -> None:
    """Let the weights of a preview be those of the clip that its original plays, at the same frames."""
    body, keys = bpy.data.objects.get(preview["wrinkle_preview_of"]), preview.data.shape_keys
    if body is None or keys is None or keys.animation_data is None:
        return
    animation, clips = keys.animation_data, clips_of(body)
    tracks = {each.name: each for each in animation.nla_tracks if each.strips}
    clip = next((name for name in clips if name in tracks), None)
    if clip is None or preview.get("wrinkle_clip") == clip:
        return
    preview["wrinkle_clip"] = clip
    for each in animation.nla_tracks:
        each.mute = True
    strip = tracks[clip].strips[0]
    animation.action = strip.action
    if getattr(strip, "action_slot", None) is not None:
        animation.action_slot = strip.action_slot


# --- the command ---

_PANEL_WIDTH = 28  # characters
_TICK = 0.1  # seconds between two looks at a bake that runs
_job: Job | None = None
_unfinished: Path | None = None  # the tools file of the bake that runs
_said = ""
_editor: subprocess.Popen[bytes] | None = None


def command() -> str:
    """The path of `wrinkle`, by the preferences.

    Raises:
        FileNotFoundError: It is not there.
    """
    addon = bpy.context.preferences.addons.get(__name__)
    return find_command(addon.preferences.command if addon is not None else "")


def schema() -> Mapping[str, Any]:
    """The schema of the tools file of the chosen `wrinkle`."""
    return _schema_of(command())


@cache
def _schema_of(program: str) -> Mapping[str, Any]:
    found = _answer([program, "schema"])
    for key in {key for kind in KINDS for key, each in keys_of(found, kind).items() if choices(each)}:
        _offer_choices(found, key)
    return found


def read_tools(path: Path) -> dict[str, Any]:
    """A tools file as plain values.

    Raises:
        ValueError: `wrinkle` says what is wrong with it.
    """
    return _answer([command(), "schema", "--read", str(path)])


def _answer(command_line: Sequence[str]) -> dict[str, Any]:
    """The object that a command prints as JSON; ValueError with what it says if it fails."""
    ran = subprocess.run(command_line, capture_output=True, text=True, encoding="utf-8", check=False, **quiet_start())
    if ran.returncode:
        raise ValueError(ran.stderr.strip())
    found: dict[str, Any] = json.loads(ran.stdout)
    return found


def _offer_choices(found: Mapping[str, Any], key: str) -> None:
    """Give objects a list of the words of a key, which reads and sets the custom property."""

    @cache
    def items(kind: str, current: str) -> list[tuple[str, str, str, int]]:
        words = choices(keys_of(found, kind).get(key, {})) if kind else []
        words += [current] * (current not in words)
        return [(each, each, "", number) for number, each in enumerate(words)]

    def of(tool: Any) -> list[tuple[str, str, str, int]]:
        return items(kind_of(tool), str(tool.get(key, "")))

    def get(tool: Any) -> int:
        return next(number for name, _, _, number in of(tool) if name == str(tool.get(key, "")))

    def put(tool: Any, number: int) -> None:
        set_key(tool, key, of(tool)[number][0])

    listed = bpy.props.EnumProperty(name=key, items=lambda tool, _: of(tool), get=get, set=put)
    setattr(bpy.types.Object, f"wrinkle_{key}_choice", listed)


def start(command_line: Sequence[str], tools: Path, done: Callable[[], None], title: str) -> None:
    """Run a command in the background, call `done` if it has succeeded, and remove its tools file.

    Without a window, wait for it.

    Raises:
        ValueError: Another one is running, or, without a window, it has failed.
    """
    global _job, _said, _unfinished
    if _job is not None:
        tools.unlink(missing_ok=True)
        raise ValueError("a command is running")
    _job, _said, _unfinished = Job(command_line), "", tools

    def finish(job: Job) -> None:
        global _job, _said, _unfinished
        code = job.wait()
        _job, _said = None, without_paths("\n".join(job.lines), tools, Path(command_line[command_line.index("-o") + 1]))
        try:
            if job.is_stopped:
                raise ValueError(f"{title}: cancelled")
            if code:
                raise ValueError(f"{title}: {_said or f'ended with {code}'}")
            done()
        finally:
            tools.unlink(missing_ok=True)
            _unfinished = None

    def tick() -> float | None:
        global _said
        if _job is None:
            return None
        if _job.code() is None:
            _redraw()
            return _TICK
        try:
            with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
                finish(_job)
        except (ValueError, RuntimeError, OSError) as error:
            _said = str(error)
        _redraw()
        return None

    if bpy.app.background:
        finish(_job)
    else:
        bpy.app.timers.register(tick, first_interval=_TICK)


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _folder() -> Path:
    """A folder for files of this session, which Blender removes."""
    return Path(bpy.app.tempdir or tempfile.gettempdir())


def asset_and_tools(context: Any) -> tuple[Path, Path, list[Any]]:
    """Export the active mesh, and others with it, and its tools to temporary files; the caller removes the tools file.

    The tools file stands in the folder of the one that was loaded, if there is one, since it may name files beside it.
    """
    body = body_at(context)
    bodies = bodies_with(body, context.scene)
    known = os.path.dirname(context.scene.get("wrinkle_path", ""))
    with kept(context, bodies):
        asset = _folder() / f"wrinkle_{re.sub(r'[^A-Za-z0-9]', '_', body.name)}.glb"
        export_asset(context, bodies, asset)
        context.scene.frame_set(0)
        text = file_text(context.scene, bodies)
    handle, name = tempfile.mkstemp(".yaml", ".wrinkle_", known if os.path.isdir(known) else _folder())
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    return asset, Path(name), bodies


class glTF2ExportUserExtension:  # noqa: N801 (the exporter looks for this name)
    """Leaves previews out of every export as glTF."""

    def gather_tree_filter_tag_hook(self, tree: Any, _settings: Any) -> None:
        """Called by the exporter, before it drops the nodes that are not to be kept."""
        for node in tree.nodes.values():
            if node.blender_object is not None and node.blender_object.get("wrinkle_preview_of"):
                node.keep_tag = False


# --- operators ---


@cache
def _material_items(words: tuple[str, ...]) -> list[tuple[str, str, str]]:
    # Blender needs the very same strings for as long as it shows them.
    return [(each, each, "") for each in words]


def _materials() -> list[tuple[str, str, str]]:
    """The materials and presets that a new tool may have, `none` first."""
    known: list[str] = []
    with suppress(OSError, ValueError):
        known = choices(keys_of(schema(), "tools")["material"])
    return _material_items(("none", *(each for each in known if each != "none")))


class _Operator(bpy.types.Operator):
    """Reports what is wrong as a line, and changes nothing then. The class's name gives its id and its label."""

    bl_options = {"REGISTER", "UNDO"}

    def __init_subclass__(cls) -> None:
        """Blender's id and label of `SetKey` are `wrinkle.set_key` and "Set key"."""
        words = re.sub(r"(?<=.)(?=[A-Z])", " ", cls.__name__).lower()
        cls.bl_idname = f"wrinkle.{words.replace(' ', '_')}"
        cls.bl_label = vars(cls).get("bl_label", words.capitalize())

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        try:
            self.act(context)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def act(self, context: Any) -> None:
        """Do it; raises ValueError with a line for the user."""
        raise NotImplementedError


class _Run(_Operator):
    """Starts or ends a command in the background, which no step can undo."""

    bl_options = {"REGISTER"}


class _OnFile:
    """Asks for a file first: by the name that a key of the scene remembers, or else by the usual one."""

    remembered = ("wrinkle_path", "tools.yaml")
    filepath: bpy.props.StringProperty(subtype="FILE_PATH")
    filter_glob: bpy.props.StringProperty(default="*.yaml;*.yml", options={"HIDDEN"})

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Ask for it."""
        self.filepath = context.scene.get(*self.remembered)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


class _OnTool(_Operator):
    """Acts on the tool of the active object."""

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Only if there is one."""
        return tool_at(context) is not None


class Add(_Operator):
    """Add a tool at the picked vertices: two for a wrinkle or a muscle, one for flesh or a touch; a field needs none"""

    bl_label = "Add wrinkle"

    kind: bpy.props.EnumProperty(name="Kind", items=[(key, each.title.title(), "") for key, each in KINDS.items()])
    name: bpy.props.StringProperty(name="Name", description="Left out: that of the bone")
    material: bpy.props.EnumProperty(name="Material", items=lambda _, __: _materials())
    bumps: bpy.props.IntProperty(name="Bumps", min=0, max=64, description="0: as many as the material gives")
    width: bpy.props.FloatProperty(name="Width", min=0, max=10000, default=80, subtype="PERCENTAGE")
    radius: bpy.props.FloatProperty(name="Radius", min=0, description="0: by the size of the mesh", unit="LENGTH")

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Only where a mesh is active."""
        return context.object is not None and context.object.type == "MESH"

    def act(self, context: Any) -> None:
        """Make the tool."""
        known = schema()  # says at once if there is no wrinkle
        body, kind = body_at(context), KINDS[self.kind]
        body.update_from_editmode()
        picked = self._picked(body) if kind.picked and context.mode == "EDIT_MESH" else []
        if len(picked) < kind.picked or (len(picked) > kind.picked and self.kind != "tools"):
            raise ValueError(f"{kind.title}: pick {kind.picked} vertices, not {len(picked)}")
        most = known["properties"]["tools"]["items"]["properties"]["path"]["maxItems"]
        if len(picked) > most:
            raise ValueError(f"a path has up to {most} vertices, not {len(picked)}")
        skin = Skin(body)
        bones = [skin.bone_of([each]) for each in picked]
        places = [body.matrix_world @ body.data.vertices[each].co for each in picked]
        if self.kind == "muscles":
            places = [self._within(skin, place, bone) for place, bone in zip(places, bones, strict=True)]
        taken = [each["name"] for each in tools_of(context.scene)]
        name = free_name(self.name or next(iter(bones), "") or kind.title, taken)
        tool = make_tool(context.scene, self.kind, name, skin, [*zip(places, bones, strict=True)])
        if self.kind == "tools":
            set_key(tool, "width", f"{number_text(self.width)}%")
            if self.material != "none":
                set_key(tool, "material", flow(self.material))
            if self.bumps:
                set_key(tool, "bumps", str(self.bumps))
        elif self.kind in _NEW_RADIUS:
            radius = self.radius or float(f"{_NEW_RADIUS[self.kind] * skin.size:.2g}")
            set_key(tool, "radius" if self.kind == "flesh" else "pad", number_text(radius))
        draw_tool(tool)

    def _picked(self, body: Any) -> list[int]:
        mesh = bmesh.from_edit_mesh(body.data)
        history = [each.index for each in mesh.select_history if isinstance(each, bmesh.types.BMVert)]
        chosen = {each.index for each in mesh.verts if each.select}
        edges = [tuple(vertex.index for vertex in each.verts) for each in mesh.edges if each.select]
        return row(history, chosen, edges)

    def _within(self, skin: Skin, place: Any, bone_name: str) -> Any:
        """A place half-way between the skin and its bone, where muscles have their ends."""
        if not bone_name:
            return place
        bone = skin.armature.data.bones[bone_name]
        head, tail = (skin.armature.matrix_world @ each for each in (bone.head_local, bone.tail_local))
        way = tail - head
        part = max(0.0, min(1.0, (place - head).dot(way) / way.length_squared))
        return place.lerp(head + way * part, _MUSCLE_DEPTH)


class SetKey(_OnTool):
    """Set a key of the tool, as it would stand in YAML: 5, 80%, cloth, {walk: 0.8}"""

    key: bpy.props.StringProperty(name="Key")
    text: bpy.props.StringProperty(name="Value")

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Ask for the value."""
        tool = tool_at(context)
        known = keys_of(schema(), kind_of(tool))[self.key]
        words = choices(known)
        default = known.get("default")
        self.text = key_text(tool, self.key) if self.key in tool else flow(default) if default is not None else ""
        if not self.text and words:
            self.text = words[0]
        return context.window_manager.invoke_props_dialog(self)

    def act(self, context: Any) -> None:
        """Set it."""
        set_key(tool_at(context), self.key, self.text)


class UnsetKey(_OnTool):
    """Remove the key, so that its default or the material's value holds"""

    key: bpy.props.StringProperty(name="Key")

    def act(self, context: Any) -> None:
        """Remove it."""
        tool_at(context).pop(self.key, None)


class Rename(_OnTool):
    """Rename the tool and its empties"""

    name: bpy.props.StringProperty(name="Name")

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Ask for the name."""
        self.name = tool_at(context)["name"]
        return context.window_manager.invoke_props_dialog(self)

    def act(self, context: Any) -> None:
        """Rename it."""
        tool = tool_at(context)
        others = [each["name"] for each in tools_of(context.scene) if each != tool]
        if not self.name or free_name(self.name, others) != self.name:
            raise ValueError(f"{self.name or 'an empty name'}: names of tools must differ in their letters and digits")
        _name(tool, self.name)


class Copy(_OnTool):
    """Copy the tool, in the same place"""

    def act(self, context: Any) -> None:
        """Copy it."""
        tool = tool_at(context)
        taken = [each["name"] for each in tools_of(context.scene)]
        _copied(context, tool, free_name(f"{tool['name']}_2", taken), lambda place: place, lambda text: text)


class Mirror(_OnTool):
    """Make the tool of the other side, x negated: left and right change places in its names"""

    def act(self, context: Any) -> None:
        """Make the other side's."""
        tool = tool_at(context)
        name = other_side(tool["name"])
        if name == tool["name"]:
            raise ValueError(f"{name}: says no side; call it {name}.L, then mirror it")
        if free_name(name, [each["name"] for each in tools_of(context.scene)]) != name:
            raise ValueError(f"{name}: is there already")
        _copied(context, tool, name, lambda place: Vector((0.0 - place.x, place.y, place.z)), other_side_of_text)


# Keys whose values name joints, meshes or morph targets, which have sides.
_SIDED = ("joint", "joints", "by", "meshes", "rest_length", "activation", "towards")


def _copied(context: Any, tool: Any, name: str, moved: Callable[[Any], Any], named: Callable[[str], str]) -> None:
    """Make a tool like another, with its points moved, and names in its keys changed."""
    body = bpy.data.objects.get(named(tool["wrinkle_mesh"].name), tool["wrinkle_mesh"])
    skin = Skin(body)
    places = []
    for empty in points_of(tool):
        bone = named(empty.parent_bone) if empty.parent_type == "BONE" else ""
        place = moved(at_rest(empty).translation)
        is_there = skin.armature is not None and bone in skin.armature.data.bones
        places.append((place, bone if is_there else skin.bone_at(place)))
    made = make_tool(context.scene, kind_of(tool), name, skin, places)
    made["wrinkle_node"] = tool["wrinkle_node"]
    for key in own_keys(tool):
        text = key_text(tool, key)
        set_key(made, key, named(text) if key in _SIDED else text)
    draw_tool(made)


class Delete(_OnTool):
    """Delete the tool and its empties"""

    def act(self, context: Any) -> None:
        """Delete it."""
        delete_tool(tool_at(context))


class Select(_Operator):
    """Show the keys of this tool in the panel"""

    bl_label = "Select tool"

    name: bpy.props.StringProperty(name="Name")

    def act(self, context: Any) -> None:
        """Select its empties and its curve, unless vertices are being edited."""
        tool = next((each for each in tools_of(context.scene) if each["name"] == self.name), None)
        if tool is None:
            raise ValueError(f"no tool is named {self.name}")
        context.scene["wrinkle_active"] = tool
        if context.mode == "OBJECT":
            for each in context.view_layer.objects:
                each.select_set(each == tool or each.get("wrinkle_tool") == tool)
            context.view_layer.objects.active = tool


def _load(context: Any, path: Path) -> None:
    """Make the tools of a file."""
    body = body_at(context)
    bodies = bodies_with(body, context.scene)
    values = read_tools(path)
    with kept(context, bodies):
        context.scene.frame_set(0)
        context.view_layer.update()
        for tool in load_values(context, values, body):
            draw_tool(tool)


class Suggest(_Run):
    """Propose tools where the actions compress the mesh, in place of those of the same names"""

    def act(self, context: Any) -> None:
        """Start it."""
        program = command()
        bodies = bodies_with(body_at(context), context.scene)
        asset, tools = _folder() / "wrinkle_suggest.glb", _folder() / "wrinkle_suggest.yaml"
        tools.unlink(missing_ok=True)
        with kept(context, bodies):
            export_asset(context, bodies, asset)
        line = [program, "suggest", str(asset), "-o", str(tools)]
        start(line, tools, lambda: _load(bpy.context, tools), "suggest")


class Save(_OnFile, _Operator):
    """Write the tools of the mesh as YAML, with z up"""

    bl_label = "Save tools"

    check_existing: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def act(self, context: Any) -> None:
        """Write it."""
        bodies = bodies_with(body_at(context), context.scene)
        with kept(context, bodies):
            context.scene.frame_set(0)
            text = file_text(context.scene, bodies)
        path = Path(bpy.path.abspath(self.filepath))
        path.write_text(text, encoding="utf-8")
        context.scene["wrinkle_path"] = str(path)


class Load(_OnFile, _Operator):
    """Read tools from YAML, in place of those of the same names. Comments of the file are not kept"""

    bl_label = "Load tools"

    def act(self, context: Any) -> None:
        """Read it."""
        path = Path(bpy.path.abspath(self.filepath))
        _load(context, path)
        context.scene["wrinkle_path"] = str(path)


class Preview(_Run):
    """Bake a draft in the background, and show it in place of the mesh, playing. The mesh itself stays as it is"""

    def act(self, context: Any) -> None:
        """Start it."""
        program = command()
        asset, tools, bodies = asset_and_tools(context)
        out = asset.with_name(f"{asset.stem}_baked.glb")
        names = [each.name for each in bodies]

        def done() -> None:
            known = [bpy.data.objects[name] for name in names if name in bpy.data.objects]
            with kept(bpy.context, known):
                previews = import_preview(bpy.context, out, known)
            if not previews:
                raise ValueError("preview: the baked file has none of these meshes")
            show(bpy.context, previews=True)
            screen = bpy.context.screen
            if screen is not None and not screen.is_animation_playing and not bpy.app.background:
                bpy.ops.screen.animation_play()

        start(bake_command(program, asset, tools, out, draft=True), tools, done, "preview")


class Bake(_OnFile, _Run):
    """Bake the mesh with its tools to a .glb file, in the background"""

    remembered = ("", "wrinkled.glb")  # no key of the scene, which the exporter would write into the file
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})
    check_existing: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def act(self, context: Any) -> None:
        """Start it."""
        program, out = command(), Path(bpy.path.abspath(self.filepath))
        asset, tools, _ = asset_and_tools(context)
        start(bake_command(program, asset, tools, out, draft=False), tools, lambda: None, "bake")


class Cancel(_Run):
    """Stop the bake"""

    def act(self, _context: Any) -> None:
        """Stop it."""
        if _job is not None:
            _job.stop()


class Compare(_Operator):
    """Show the preview or the original"""

    bl_label = "Before / after"

    def act(self, context: Any) -> None:
        """Change places."""
        previews = [each for each in context.scene.objects if each.get("wrinkle_preview_of")]
        if not previews:
            raise ValueError("no preview yet")
        show(context, previews=previews[0].hide_get())


def show(context: Any, *, previews: bool) -> None:
    """Hide originals and show their previews, or the other way round, in this view layer."""
    for each in context.scene.objects:
        if name := each.get("wrinkle_preview_of"):
            each.hide_set(not previews)
            body = context.scene.objects.get(name)
            if body is not None and body.mode == "OBJECT" and body.hide_get() != previews:
                if previews:  # what is hidden is no longer selected
                    each["wrinkle_selected"] = body.select_get()
                body.hide_set(previews)
                if not previews:
                    body.select_set(bool(each.get("wrinkle_selected")))


class Edit(_Run):
    """Export the mesh and open `wrinkle edit` on it in a browser; Load tools then reads what was saved there"""

    bl_label = "Edit in browser"

    def act(self, context: Any) -> None:
        """Start it; one that runs is ended."""
        global _editor
        program = command()
        stop_editor()
        asset, tools, _ = asset_and_tools(context)
        path = context.scene.get("wrinkle_path", str(asset.with_suffix(".yaml")))
        os.replace(tools, path)
        context.scene["wrinkle_path"] = path
        options = ["--no-browser", "--port", "0"] if bpy.app.background else []
        line = [program, "edit", str(asset), path, *options]
        _editor = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, **quiet_start())


def stop_all() -> None:
    """End what runs, and remove its tools file: at the end of Blender, too."""
    stop_editor()
    if _job is not None:
        _job.stop()
        _job.wait()
    if _unfinished is not None:
        _unfinished.unlink(missing_ok=True)


def stop_editor() -> None:
    """End `wrinkle edit`."""
    global _editor
    if _editor is not None:
        _editor.terminate()
        _editor.wait()
        _editor = None


# --- the panel ---


class Preferences(bpy.types.AddonPreferences):
    """Find `wrinkle`."""

    bl_idname = __name__
    command: bpy.props.StringProperty(
        name="wrinkle",
        description="The program, or the folder of its environment; empty: the one on the PATH",
        subtype="FILE_PATH",
    )

    def draw(self, _context: Any) -> None:
        """The path, and whether it is there."""
        self.layout.prop(self, "command")
        try:
            self.layout.label(text=find_command(self.command))
        except FileNotFoundError as error:
            self.layout.label(text=str(error), icon="ERROR")


class Tools(bpy.types.Panel):
    """The panel in the sidebar of the 3D view."""

    bl_idname = "WRINKLE_PT_tools"
    bl_label = "Wrinkle"
    bl_category = "Wrinkle"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    def draw(self, context: Any) -> None:
        """Shows what can be added, the tools, and the keys of the active one."""
        layout = self.layout
        if _job is None:
            layout.operator("wrinkle.suggest", icon="VIEWZOOM")
        adding = layout.column(align=True)
        for kind, each in KINDS.items():
            adding.operator("wrinkle.add", text=f"Add {each.title}").kind = kind
        if context.mode != "EDIT_MESH":
            layout.label(text="Pick vertices to add", icon="INFO")
        active = tool_at(context)
        tools = layout.column(align=True)
        for tool in tools_of(context.scene):
            text = f"{tool['name']}  ({KINDS[kind_of(tool)].title})"
            tools.operator("wrinkle.select", text=text, depress=tool == active).name = tool["name"]
        self._draw_bakes()
        if active is not None:
            self._draw_keys(active)

    def _draw_keys(self, tool: Any) -> None:
        box = self.layout.box()
        # Two in a row, and names beside fields and not in them, so that a sidebar as wide as Blender's has whole words.
        edits = box.grid_flow(columns=2, align=True)
        for each in ("rename", "copy", "mirror", "delete"):
            edits.operator(f"wrinkle.{each}")
        try:
            known = keys_of(schema(), kind_of(tool))
        except (OSError, ValueError) as error:
            box.label(text=str(error), icon="ERROR")
            return
        for key, key_schema in known.items():
            if key in tool:
                line = box.row(align=True)
                line.label(text=key)
                path = f"wrinkle_{key}_choice"
                chosen = choices(key_schema) and isinstance(tool[key], str) and hasattr(tool, path)
                line.prop(tool, path if chosen else f'["{key}"]', text="")
                line.operator("wrinkle.set_key", text="", icon="GREASEPENCIL").key = key
                line.operator("wrinkle.unset_key", text="", icon="X").key = key
        others = box.column(align=True)
        others.label(text="By default, or by the material:")
        for group, keys in groups_of({key: each for key, each in known.items() if key not in tool}).items():
            others.label(text=group)
            for key in keys:
                line = others.row(align=True)
                default = known[key].get("default")
                shown = "none" if default is None else default if isinstance(default, str) else flow(default)
                line.label(text=f"{key}: {shown}")
                line.operator("wrinkle.set_key", text="", icon="ADD").key = key

    def _draw_bakes(self) -> None:
        layout = self.layout
        if _job is None:
            line = layout.row(align=True)
            line.operator("wrinkle.preview")
            line.operator("wrinkle.compare")
            layout.operator("wrinkle.bake")
        else:
            line = layout.row(align=True)
            text = f"{_job.stage} {100 * _job.part:.0f} %"
            if hasattr(line, "progress"):
                line.progress(factor=_job.part, text=text)
            else:
                line.label(text=text)
            line.operator("wrinkle.cancel", text="", icon="X")
        for text in _said.splitlines():
            for part in textwrap.wrap(text, _PANEL_WIDTH):
                layout.label(text=part)
        line = layout.row(align=True)
        line.operator("wrinkle.save")
        line.operator("wrinkle.load")
        layout.operator("wrinkle.edit")


_CLASSES = (
    Add, SetKey, UnsetKey, Rename, Copy, Mirror, Delete, Select, Suggest, Save, Load, Preview, Bake, Cancel,
    Compare, Edit, Preferences, Tools,
)  # fmt: skip


def register() -> None:
    """Called by Blender."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    atexit.register(stop_all)
    bpy.app.handlers.depsgraph_update_post.append(bpy.app.handlers.persistent(draw_changed))


def unregister() -> None:
    """Called by Blender."""
    stop_all()
    atexit.unregister(stop_all)
    bpy.app.handlers.depsgraph_update_post.remove(draw_changed)
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
    for name in [each for each in dir(bpy.types.Object) if re.fullmatch(r"wrinkle_\w+_choice", each)]:
        delattr(bpy.types.Object, name)
    _schema_of.cache_clear()


if __name__ == "__main__":
    extension_zip(Path(sys.argv[1]))
