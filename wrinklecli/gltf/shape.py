"""Checks a document's JSON: within limits, of the specification's types, without unknown compressions.

Source: glTF 2.0 specification, §5 (properties); EXT_meshopt_compression, KHR_meshopt_compression and
    KHR_draco_mesh_compression.
"""

import json
import math
import re
import sys
from typing import Any

from wrinklecli.errors import SHOWN, AssetError, listed
from wrinklecli.files.formats import foreign_format, is_tools_file
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import path_of

Json = dict[str, Any]

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

# Levels of JSON: copying and writing recurse.
_DEPTH_LIMIT = 256


_MESHOPT_SHAPE: Json = {
    "buffer": "buffers",
    "byteOffset": int,
    "byteLength": int,
    "byteStride": int,
    "count": int,
    "mode": str,
    "filter": str,
}
_PRIMITIVE: Json = {
    "attributes": {"*": "accessors"},
    "indices": "accessors",
    "material": int,
    "mode": int,
    "targets": [{"*": "accessors"}],
    "extensions": {DRACO: {"bufferView": "bufferViews", "attributes": {"*": int}}},
}
# The parts of a document that are read: objects by key (`*`: any), arrays by their items, or by how many numbers they
# have, references by the array that they refer to, counts as int, and URIs as bytes. References to appearance may be
# wrong, since a bake does not follow them, and converters that drop images leave such behind.
_ITEMS: Json = {
    "scenes": {"name": str, "nodes": ["nodes"]},
    "nodes": {
        "name": str,
        "children": ["nodes"],
        "mesh": "meshes",
        "skin": "skins",
        "camera": int,
        "matrix": 16,
        "translation": 3,
        "rotation": 4,
        "scale": 3,
        "weights": [float],
        "extensions": {
            "EXT_mesh_gpu_instancing": {"attributes": {"*": "accessors"}},
            "KHR_node_visibility": {"visible": bool},
            "MSFT_lod": {"ids": ["nodes"]},
        },
    },
    "meshes": {"name": str, "primitives": [_PRIMITIVE], "weights": [float]},
    "skins": {"name": str, "joints": ["nodes"], "inverseBindMatrices": "accessors", "skeleton": int},
    "animations": {
        "name": str,
        "channels": [{"sampler": int, "target": {"node": "nodes", "path": str}}],
        "samplers": [{"input": "accessors", "output": "accessors", "interpolation": str}],
    },
    "accessors": {
        "bufferView": "bufferViews",
        "byteOffset": int,
        "componentType": int,
        "count": int,
        "type": str,
        "normalized": bool,
        "sparse": {
            "count": int,
            "indices": {"bufferView": "bufferViews", "byteOffset": int, "componentType": int},
            "values": {"bufferView": "bufferViews", "byteOffset": int},
        },
    },
    "bufferViews": {
        "buffer": "buffers",
        "byteOffset": int,
        "byteLength": int,
        "byteStride": int,
        "extensions": dict.fromkeys(MESHOPT, _MESHOPT_SHAPE),
    },
    "buffers": {"uri": bytes, "byteLength": int, "extensions": {name: {"fallback": bool} for name in MESHOPT}},
    "images": {"name": str, "uri": bytes, "bufferView": "bufferViews", "mimeType": str},
    **{name: {"name": str} for name in ("materials", "textures", "samplers", "cameras")},
}
_SHAPE: Json = {
    "asset": {"version": str},
    "extensionsUsed": [str],
    "extensionsRequired": [str],
    "scene": "scenes",
    **{name: [item] for name, item in _ITEMS.items()},
}
# Keys of integers in parts that are not checked: appearance, expressions and bones of a VRM, levels of detail.
_REFERENCES = frozenset(("index", "texCoord", "source", "sampler", "wrapS", "wrapT", "node", "mesh", "ids", "target"))
_KINDS = {
    int: "a whole number of 0 or more",
    float: "a number",
    str: "text",
    bool: "true or false",
    dict: "an object",
    list: "an array",
}

# Compressions that are decoded,
COMPRESSIONS = (DRACO, *MESHOPT)
# and all extensions of geometry that are understood.
_GEOMETRY_EXTENSIONS = (*COMPRESSIONS, "KHR_mesh_quantization", "EXT_mesh_features")
# Words in names of extensions that change geometry or its storage,
_GEOMETRY_WORDS = re.compile(
    "mesh|primitive|geometry|vertex|skin|morph|subdiv|splat|curve|compress|accessor|buffer", re.IGNORECASE
)
# and in names of extensions that do not.
_APPEARANCE_WORDS = re.compile("texture|material|image|light", re.IGNORECASE)


def place(path: str, *pointer: str | int) -> str:
    """The place of a JSON value for messages: `hand.glb#/meshes/0`."""
    return f"{path}#/" + "/".join(str(part) for part in pointer)


def parse_json(data: bytes, name: str) -> Json:
    """Parse the JSON object of a document; AssetError if it is none, or is nested too deeply to copy."""

    def refuse(constant: str) -> float:
        raise ValueError(f"{constant} is no JSON number")

    def finite(digits: str) -> float:
        value = float(digits)
        if math.isinf(value):
            raise ValueError(f"{digits[:SHOWN]} is too large a number")
        return value

    try:
        gltf = json.loads(data.decode("utf-8-sig"), parse_constant=refuse, parse_float=finite)
    except RecursionError as error:
        raise AssetError("the JSON is nested too deeply", where=name) from error
    except ValueError as error:
        if is_tools_file(data, name):
            raise AssetError("is a tools file (YAML), where a glTF asset (.glb, .gltf) belongs", where=name) from error
        what = foreign_format(data, name)
        raise AssetError(f"is {what or f'neither a .glb nor JSON: {error}'}", where=name) from error
    if not isinstance(gltf, dict):
        raise AssetError("the JSON is no object", where=name)
    level: list[Any] = [gltf]
    for _ in range(_DEPTH_LIMIT):
        inside = (each.values() if isinstance(each, dict) else each for each in level)
        level = [child for children in inside for child in children if isinstance(child, dict | list)]
        if not level:
            return gltf
    raise AssetError(f"the JSON is nested more than {_DEPTH_LIMIT} levels deep", where=name)


def json_bytes(value: Json, *, indent: int | None = None) -> bytes:
    """A value as JSON in UTF-8; names of nodes and of files may hold half a surrogate pair, which is escaped."""
    separators = (",", ":") if indent is None else (",", ": ")
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, indent=indent, separators=separators)
    try:
        return text.encode()
    except UnicodeEncodeError:
        return json.dumps(value, allow_nan=False, indent=indent, separators=separators).encode()


def check_asset(gltf: Json, path: str) -> None:
    """Check the types of all JSON that is read, and that no required extension is unknown.

    Raises:
        AssetError: A type is wrong, or a required extension of geometry is unknown.
    """
    asset = gltf.get("asset", {})
    version = asset.get("version") if isinstance(asset, dict) else "2.0"
    if not str(version).startswith("2."):
        # First, since most of glTF 1.0 has other types.
        raise AssetError(f"asset.version is {version!r}; glTF 2.0 is read", where=place(path, "asset", "version"))
    counts: dict[str, int] = {}
    for kind, shape in _SHAPE.items():
        if isinstance(shape, list):
            value = gltf.get(kind, [])
            if not isinstance(value, list):
                raise _misfit(value, list, path, (kind,))
            counts[kind] = len(value)
    _check_shape(gltf, _SHAPE, _Limits(path, counts), ())
    parts = [each for kind in ("materials", "textures", "samplers", "bufferViews") for each in gltf.get(kind, [])]
    for part in (gltf.get("extensions"), *parts, *(node.get("extensions") for node in gltf.get("nodes", []))):
        if isinstance(part, dict):
            _read_references(part)
    for index, name in enumerate(gltf.get("extensionsRequired", [])):
        about_geometry = _GEOMETRY_WORDS.search(name) and not _APPEARANCE_WORDS.search(name)
        if about_geometry and name not in _GEOMETRY_EXTENSIONS:
            raise AssetError(
                f"{name} changes geometry, but is not understood; understood are {listed(_GEOMETRY_EXTENSIONS)}",
                where=place(path, "extensionsRequired", index),
            )


@dataclass(frozen=True, slots=True)
class _Limits:
    """A document's path, for messages, and the lengths of its top-level arrays."""

    path: str
    counts: dict[str, int]


def _check_shape(value: Any, shape: Any, limits: _Limits, pointer: tuple[str | int, ...]) -> Any:
    """Check that a value at a pointer, and all values below it, have a shape; give it with integers as such.

    JSON has one kind of number: 1.0 is an integer, too, and its place in an object or array gets 1.
    """
    if isinstance(shape, dict | list):
        kind = dict if isinstance(shape, dict) else list
        if not isinstance(value, kind):
            raise _misfit(value, kind, limits.path, pointer)
        every = shape.get("*") if isinstance(shape, dict) else shape[0]
        for key, child in value.items() if isinstance(value, dict) else enumerate(value):
            inner = shape.get(key, every) if isinstance(shape, dict) else every
            if inner is not None:
                value[key] = _check_shape(child, inner, limits, (*pointer, key))
        return value
    if isinstance(shape, int):
        _check_shape(value, [float], limits, pointer)
        if len(value) != shape:
            raise AssetError(f"has {len(value)} numbers, not {shape}", where=place(limits.path, *pointer))
        return value
    wanted: Any = int if isinstance(shape, str) else str if shape is bytes else shape
    if wanted is int:
        value = _whole(value)
    if not _is_of(value, wanted):
        raise _misfit(value, wanted, limits.path, pointer)
    if shape is bytes:
        _check_uri(value, limits.path, pointer)
    if isinstance(shape, str) and value >= limits.counts[shape]:
        message = f"refers to {shape}[{value}], but there are {limits.counts[shape]}"
        raise AssetError(message, where=place(limits.path, *pointer[:-1]))
    return value


def _whole(value: Any) -> Any:
    """A number without a fraction as an integer; all else as it is."""
    # Above 2^53 not every integer is a float.
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) <= 2**53 else value


def _read_references(value: Any) -> None:
    """Write the references below a part that is not checked as integers."""
    for key, child in value.items() if isinstance(value, dict) else enumerate(value):
        if key in _REFERENCES:
            value[key] = [_whole(each) for each in child] if isinstance(child, list) else _whole(child)
        if key != "extras" and isinstance(child, dict | list):
            _read_references(child)


def _is_of(value: Any, kind: type) -> bool:
    """True if a value is of a kind: text, a boolean, a whole number of 0 or more, or a number that fits a float."""
    if kind is int:
        return type(value) is int and value >= 0
    if kind is float:
        # An integer in JSON may be too large for a float.
        return type(value) is float or (type(value) is int and abs(value) <= sys.float_info.max)
    return type(value) is kind


def _check_uri(value: str, path: str, pointer: tuple[str | int, ...]) -> None:
    # No system has names with half a character or with NUL in them; data URIs are long, and ASCII.
    try:
        known = value.startswith("data:") or "\0" not in path_of(value)
    except UnicodeEncodeError:
        known = False
    if not known:
        message = f"uri {value[:SHOWN]!r} is not a file below the asset's folder"
        raise AssetError(message, where=place(path, *pointer[:-1]))


def _misfit(value: Any, kind: type, path: str, pointer: tuple[str | int, ...]) -> AssetError:
    return AssetError(f"is {repr(value)[:SHOWN]}, not {_KINDS[kind]}", where=place(path, *pointer))
