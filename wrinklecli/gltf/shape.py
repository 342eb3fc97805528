"""What a valid document looks like: JSON within limits, of the specification's types, without unknown compressions.

Source: glTF 2.0 specification, §5 (properties); EXT_meshopt_compression, KHR_meshopt_compression and
    KHR_draco_mesh_compression.
"""

import json
import math
import re
import sys
from typing import Any

from wrinklecli.errors import AssetError, listed
from wrinklecli.gltf import draco, meshopt

Json = dict[str, Any]

_DEPTH_LIMIT = 256  # levels of JSON; copying and writing recurse
_SHOWN = 40  # characters of a found value that a message repeats

_MESHOPT_SHAPE: Json = {
    "buffer": int,
    "byteOffset": int,
    "byteLength": int,
    "byteStride": int,
    "count": int,
    "mode": str,
    "filter": str,
}
_DRACO_SHAPE: Json = {"bufferView": int, "attributes": {"*": int}}
# What is read of a document: objects by key (`*`: any), arrays by their items, indices and counts as int.
_SHAPE: Json = {
    "asset": {"version": str},
    "extensionsUsed": [str],
    "extensionsRequired": [str],
    "scenes": [{"nodes": [int]}],
    "nodes": [
        {
            "name": str,
            "children": [int],
            "mesh": int,
            "skin": int,
            "matrix": [float],
            "translation": [float],
            "rotation": [float],
            "scale": [float],
            "weights": [float],
        }
    ],
    "meshes": [
        {
            "primitives": [
                {
                    "attributes": {"*": int},
                    "indices": int,
                    "mode": int,
                    "targets": [{"*": int}],
                    "extensions": {draco.EXTENSION: _DRACO_SHAPE},
                }
            ],
            "weights": [float],
        }
    ],
    "skins": [{"joints": [int], "inverseBindMatrices": int}],
    "animations": [
        {
            "name": str,
            "channels": [{"sampler": int, "target": {"node": int, "path": str}}],
            "samplers": [{"input": int, "output": int, "interpolation": str}],
        }
    ],
    "accessors": [
        {
            "bufferView": int,
            "byteOffset": int,
            "componentType": int,
            "count": int,
            "type": str,
            "normalized": bool,
            "sparse": {
                "count": int,
                "indices": {"bufferView": int, "byteOffset": int, "componentType": int},
                "values": {"bufferView": int, "byteOffset": int},
            },
        }
    ],
    "bufferViews": [
        {
            "buffer": int,
            "byteOffset": int,
            "byteLength": int,
            "byteStride": int,
            "extensions": dict.fromkeys(meshopt.EXTENSIONS, _MESHOPT_SHAPE),
        }
    ],
    "buffers": [
        {"uri": str, "byteLength": int, "extensions": {name: {"fallback": bool} for name in meshopt.EXTENSIONS}}
    ],
    "images": [{"uri": str, "bufferView": int, "mimeType": str}],
}
_KINDS = {int: "a whole number of 0 or more", float: "a number", str: "text", bool: "true or false"}

# Compressions that are decoded where needed; with the next, all extensions of geometry that we understand.
COMPRESSIONS = (draco.EXTENSION, *meshopt.EXTENSIONS)
_GEOMETRY_EXTENSIONS = (*COMPRESSIONS, "KHR_mesh_quantization", "EXT_mesh_features")
# What names of extensions that change geometry, or how it is stored, have in them, and what those of others have.
_GEOMETRY_WORDS = re.compile(
    "mesh|primitive|geometry|vertex|skin|morph|subdiv|splat|curve|compress|accessor|buffer", re.IGNORECASE
)
_APPEARANCE_WORDS = re.compile("texture|material|image|light", re.IGNORECASE)


def place(path: str, *pointer: str | int) -> str:
    """The place of a JSON value for messages: `hand.glb#/meshes/0`."""
    return f"{path}#/" + "/".join(str(part) for part in pointer)


def parse_json(data: bytes, name: str) -> Json:
    """The JSON object of a document.

    Raises:
        AssetError: It is none, or is nested too deeply to copy.
    """

    def refuse(constant: str) -> float:
        raise ValueError(f"{constant} is no JSON number")

    def finite(digits: str) -> float:
        value = float(digits)
        if math.isinf(value):
            raise ValueError(f"{digits[:_SHOWN]} is too large a number")
        return value

    try:
        gltf = json.loads(data.decode("utf-8-sig"), parse_constant=refuse, parse_float=finite)
    except RecursionError as error:
        raise AssetError("the JSON is nested too deeply", where=name) from error
    except ValueError as error:
        raise AssetError(f"is neither a .glb nor JSON: {error}", where=name) from error
    if not isinstance(gltf, dict):
        raise AssetError("the JSON is no object", where=name)
    level: list[Any] = [gltf]
    for _ in range(_DEPTH_LIMIT):
        inside = (each.values() if isinstance(each, dict) else each for each in level)
        level = [child for children in inside for child in children if isinstance(child, dict | list)]
        if not level:
            return gltf
    raise AssetError(f"the JSON is nested more than {_DEPTH_LIMIT} levels deep", where=name)


def check_asset(gltf: Json, path: str) -> None:
    """Check that the JSON has the types that the specification asks for, and needs no extension that we cannot read.

    Args:
        gltf: The JSON; what of it is not read may be anything.
        path: The file, for messages.

    Raises:
        AssetError: It does not.
    """
    _check_shape(gltf, _SHAPE, path, ())
    version = gltf.get("asset", {}).get("version")
    if not isinstance(version, str) or not version.startswith("2."):
        raise AssetError(f"asset.version is {version!r}; glTF 2.0 is read", where=place(path, "asset", "version"))
    for index, name in enumerate(gltf.get("extensionsRequired", [])):
        about_geometry = _GEOMETRY_WORDS.search(name) and not _APPEARANCE_WORDS.search(name)
        if about_geometry and name not in _GEOMETRY_EXTENSIONS:
            raise AssetError(
                f"{name} changes geometry, but is not understood; understood are {listed(_GEOMETRY_EXTENSIONS)}",
                where=place(path, "extensionsRequired", index),
            )


def _check_shape(value: Any, shape: Any, path: str, pointer: tuple[str | int, ...]) -> None:
    """Check that a value of the JSON, at a pointer into it, and all below are of the types of a shape."""
    if isinstance(shape, dict):
        fits = isinstance(value, dict)
        children = [(key, child, shape.get(key, shape.get("*"))) for key, child in value.items()] if fits else []
    elif isinstance(shape, list):
        fits = isinstance(value, list)
        children = [(index, child, shape[0]) for index, child in enumerate(value)] if fits else []
    else:
        accepted = (int, float) if shape is float else shape
        # An integer of JSON may be too large for a float.
        fits = not (shape is float and isinstance(value, int) and abs(value) > sys.float_info.max)
        fits = fits and isinstance(value, accepted) and isinstance(value, bool) == (shape is bool)
        fits = fits and not (shape is int and value < 0)
        children = []
    if not fits:
        kind = "an object" if isinstance(shape, dict) else "an array" if isinstance(shape, list) else _KINDS[shape]
        raise AssetError(f"is {repr(value)[:_SHOWN]}, not {kind}", where=place(path, *pointer))
    for key, child, inner in children:
        if inner is not None:
            _check_shape(child, inner, path, (*pointer, key))
