"""Faults put into an asset and its tools at random, as a list of edits that can be kept, replayed and shortened.

An edit is JSON: what it does, to which part, where, and with what. Parts are `asset` and `tools` (their JSON), `record`
(the JSON of the original asset in a baked file, which is then forged to fit), `data` (the asset's buffer), and
`asset bytes` and `tools bytes` (the files as they are written).
"""

import json
import math
import random
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from kit.asset import Json
from kit.forged import forge
from kit.hostile import Source, packed

Edit = list[Any]
TREES = ("asset", "tools", "record")

_WORDS = ["SCALAR", "VEC3", "VEC4", "MAT4", "STEP", "LINEAR", "CUBICSPLINE", "translation", "rotation", "scale"]
_PATHS = ["weights", "POSITION", "NORMAL", "../x.bin", "/etc/passwd", "file:///etc/passwd", "http://localhost/x"]
_TEXTS = ["", "x", "\n\x1b[31mred\x07", "\ud800", "%2e%2e/%2e%2e/x", "a\0b", "limb.bin", ".", "data:,", "x" * 5000]
_URIS = ["data:application/octet-stream;base64,AAAA", "data:;base64,*", "limb.glb", "//host/x", "C:\\x", "joint_0"]
_MODES = ["ATTRIBUTES", "TRIANGLES", "INDICES", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR", "NONE", "MAT2"]
_SMALL = [-1, 0, 1, 2, 3, 4, 5, 7, 16, 255, 256, 5120, 5121, 5123, 5125, 5126]
_LARGE = [2**16, 2**20, 2**26, 2**26 + 1, 2**31, 2**32 - 1, 2**53, 2**63, 2**64, 10**400, -(2**31), -(10**30)]
_REALS = [0.5, -0.0, 1e-45, 1e-320, 1e-6, 1e6, 1e12, 1e30, 3.4e38, 3.5e38, 1e160, 1.7e308, -1e30, math.nan, math.inf]
_OTHERS = [None, True, False, [], {}, [0], [[]], {"a": 1}, [1e30] * 3, [0.0] * 4, [1e300] * 16, [0] * 1000, [{}] * 500]
_JUNK = [_SMALL, _SMALL, _LARGE, _REALS, _WORDS, _PATHS, _TEXTS, _URIS, _MODES, _OTHERS, _OTHERS]
_FLOATS = [math.nan, math.inf, -math.inf, 1e30, -3e38, 1e-45, 1e-38, 0.0, -0.0, 1e10, 1e-10, 1e20, 2.0]
_POINTER = "KHR_animation_pointer"
_POINTERS = [
    "/nodes/0/translation", "/nodes/1/rotation", "/nodes/1/scale", "/nodes/0/weights", "/nodes/0/weights/0",
    "/meshes/0/weights", "/meshes/0/weights/0", "/meshes/0/weights/7", "/meshes/0/weights/-1", "/nodes/99/rotation",
    "/nodes/1/rotation/0", "/nodes//rotation", "/nodes/01/rotation", "/nodes/1e0/rotation", "nodes/1/rotation", "", "/",
    "/nodes/0/extensions/KHR_node_visibility/visible", "/materials/0/pbrMetallicRoughness/baseColorFactor", "~1", 5,
    None, [], "/nodes/٣/rotation", "/nodes/" + "9" * 400 + "/rotation", "/meshes/0/weights/" + "1" * 5000,
    "/nodes/0/mesh",
]  # fmt: skip
_LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"0" * 64 + b"\nsize 12345\n"
_PICTURES = [
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==",
    "data:image/png;base64,iVBORw0KGgo=",
    "data:image/jpeg;base64,",
    "limb.png",
    "limb.glb",
]
# fmt: off
_KEYS = [
    "matrix", "weights", "skin", "mesh", "children", "translation", "rotation", "scale", "sparse", "bufferView",
    "byteOffset", "byteStride", "normalized", "count", "uri", "extensions", "extras", "targets", "indices", "mode",
    "skeleton", "images", "extensionsRequired", "name", "camera", "targetNames", "width", "bumps", "gap", "details",
    "max_height", "rest_length", "strength", "attenuation", "snap", "mirror", "clips", "sampling", "fps", "rest",
    "up", "materials", "textures", "samplers", "cameras", "source", "sampler", "material", "pbrMetallicRoughness",
    "baseColorTexture", "index", "texCoord", "nodes", "scenes", "scene", "skins", "joints", "inverseBindMatrices",
    "animations", "channels", "wrinkle", "original", "attributes", "POSITION", "path", "lag", "frequency", "damping",
    "bow", "variation", "seed", "branch", "profile", "compressible", "fields", "turns", "angles", "axis", "wavelength",
    "slack", "stops", "mask",
]
# fmt: on


OWN_PRESETS: Json = {
    "knitted": {"title": "Knitted", "material": "cloth", "bump_width": "20%", "bump_height": "30%", "parts": ["knee"]},
    "sock": {"bumps": 2, "width": "40%", "profile": "smooth", "details": [0.2], "lag": {"frequency": 3}},
}
_SPRING = {"frequency": 3, "damping": 0.3, "limit": "10%", "gravity": "30%", "shapes": 3}
_BODIES = {
    "muscles": {
        "name": "biceps",
        "origin": {"joint": "joint_0", "offset": [0.15, 0.1, 0.0]},
        "insertion": {"joint": "joint_1", "offset": [0.15, 0.1, 0.0]},
        "thickness": "auto",
        "activation": {"keys": {"fold": [[0, 0], [0.5, 1]]}},
        "travel": True,
    },
    "flesh": {"name": "belly", "at": [0.3, 0.1, 0.0], "radius": 0.4, **_SPRING},
    "fields": {"name": "sleeve", "wavelength": "30%", "slack": "3%", "joints": ["joint_0", "joint_1"], "seed": 3},
}


def copied(value: Any) -> Any:
    """A deep copy of JSON."""
    return json.loads(json.dumps(value))


def damage(chance: random.Random, source: Source) -> list[Edit]:
    """One to three faults."""
    edits: list[Edit] = []
    shares = {"json": 18, "top": 12, "sly": 24, "link": 14, "number": 14, "data": 14, "asset bytes": 4, "tools": 6}
    shares |= {"tools bytes": 2, "record": 12 if is_baked(source) else 0, "geometry": 10, "of others": 14}
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        match chance.choices(list(shares), list(shares.values()))[0]:
            case "json":
                edits += tree_edit(chance, "asset", source.gltf)
            case "top":
                edits += _top_edit(chance, source.gltf)
            case "sly":
                edits += _sly_edits(chance, source.gltf)
            case "link":
                edits += _link_edit(chance, source.gltf)
            case "number":
                edits += _number_edit(chance, source.gltf)
            case "data":
                edits += _data_edits(chance, source)
            case "tools":
                edits += tree_edit(chance, "tools", source.tools)
            case "record":
                edits += tree_edit(chance, "record", {"gltf": source.gltf, "sizes": [1], "kept": [[[0, 4, 0, 0]]]})
            case "geometry":
                edits += geometry_edit(chance)
            case "of others":
                edits += _edits_of_others(chance, source)
            case part:
                size = len(packed(copied(source.gltf), source.data, source.suffix)) if part == "asset bytes" else 300
                edits += _byte_edits(chance, part, size)
    return edits


def is_baked(source: Source) -> bool:
    """Whether a source carries wrinkles, and a record of what it was."""
    return any("wrinkle" in (node.get("extras") or {}) and "mesh" in node for node in source.gltf["nodes"])


def _junk(chance: random.Random) -> Any:
    return chance.choice(chance.choice(_JUNK))


def _pointer(chance: random.Random, root: Any) -> list[Any]:
    """Keys and indices of something in a tree."""
    at, pointer = root, [chance.choice(list(root))]
    while isinstance(at[pointer[-1]], dict | list) and at[pointer[-1]] and chance.random() < 0.8:
        at = at[pointer[-1]]
        pointer.append(chance.choice(list(at)) if isinstance(at, dict) else chance.randrange(len(at)))
    return pointer


def _at(root: Any, pointer: Sequence[Any]) -> Any:
    for key in pointer:
        root = root[key]
    return root


def tree_edit(chance: random.Random, part: str, root: Any) -> Iterator[Edit]:
    """Replace, delete, copy, insert or repeat something anywhere."""
    pointer = _pointer(chance, root)
    above = _at(root, pointer[:-1])
    match chance.randrange(6):
        case 0 | 1:
            yield ["set", part, pointer, _junk(chance)]
        case 2:
            yield ["drop", part, pointer]
        case 3:
            yield ["set", part, pointer, copied(_at(root, _pointer(chance, root)))]
        case 4 if isinstance(above, list):
            yield ["insert", part, pointer, copied(chance.choice(above)) if chance.random() < 0.5 else _junk(chance)]
        case _ if isinstance(above, dict):
            yield ["set", part, [*pointer[:-1], chance.choice([*above, *_KEYS])], _junk(chance)]
        case _:
            yield ["repeat", part, pointer, chance.choice([1, 2, 300])]


def _top_edit(chance: random.Random, gltf: Json) -> Iterator[Edit]:
    """Something in a top-level array that is rare there, one item of it, or a key of one."""
    kind = chance.choice([*gltf, "materials", "cameras", "samplers", "textures", "images", "skins", "meshes", "scenes"])
    items = gltf.get(kind)
    if not isinstance(items, list) or not items or chance.random() < 0.3:
        yield ["set", "asset", [kind], _junk(chance)]
        return
    number = chance.randrange(len(items))
    if not isinstance(items[number], dict) or chance.random() < 0.3:
        yield ["set", "asset", [kind, number], _junk(chance)]
        return
    key = chance.choice([*items[number], *_KEYS])
    yield ["set", "asset", [kind, number, key], _junk(chance)]


def _sly_edits(chance: random.Random, gltf: Json) -> Iterator[Edit]:
    """What has the right types but is twice, missing, empty, of another length, or refers to nothing."""
    items = [(kind, number) for kind in gltf if isinstance(gltf[kind], list) for number in range(len(gltf[kind]))]
    objects = [(kind, number) for kind, number in items if isinstance(gltf[kind][number], dict)]
    lists = [pointer for pointer, value in _lists(gltf) if value]
    match chance.randrange(9):
        case 0:  # twice
            pointer = chance.choice(lists)
            number = chance.randrange(len(_at(gltf, pointer)))
            yield ["repeat", "asset", [*pointer, number], chance.choice([1, 1, 2])]
        case 1:
            yield ["set", "asset", chance.choice(lists), []]
        case 2:
            pointer = chance.choice(lists)
            yield ["drop", "asset", [*pointer, chance.randrange(len(_at(gltf, pointer)))]]
        case 3:
            yield ["drop", "asset", [chance.choice(list(gltf))]]
        case 4:
            kind, number = chance.choice(objects)
            yield ["set", "asset", [kind, number, "name"], chance.choice([*_TEXTS, "limb", "joint_0", "N" * 40000])]
        case 5:
            indices = [("textures", "source"), ("textures", "sampler"), ("skins", "skeleton"), ("nodes", "camera")]
            kind, key = chance.choice([*indices, ("images", "bufferView"), ("images", "uri"), ("buffers", "uri")])
            value = chance.choice(_TEXTS) if key == "uri" else chance.choice([0, 1, 7, 99, -1])
            yield ["set", "asset", [kind, 0, key], value]
        case 6:
            mesh = chance.randrange(max(len(gltf.get("meshes", [])), 1))
            place = ["meshes", mesh, "primitives", 0]
            changes = (
                ["set", "asset", [*place, "material"], chance.choice([0, 1, 99])],
                ["set", "asset", [*place, "mode"], chance.choice([0, 1, 2, 3, 5, 6, 7, 99])],
                [
                    "drop",
                    "asset",
                    [*place, "attributes", chance.choice(["POSITION", "NORMAL", "JOINTS_0", "WEIGHTS_0"])],
                ],
                ["drop", "asset", [*place, "attributes"]],
                ["drop", "asset", [*place, "indices"]],
                [
                    "set",
                    "asset",
                    [*place, "targets"],
                    chance.choice([[], [{}], [{"NORMAL": 0}], [{"POSITION": 0}] * 2]),
                ],
                ["set", "asset", ["meshes", mesh, "weights"], chance.choice([[], [1], [0.5] * 40])],
                [
                    "set",
                    "asset",
                    ["meshes", mesh, "extras"],
                    {"targetNames": chance.choice([5, [], [1, None, {}], "ab"])},
                ],
            )
            yield chance.choice(changes)
        case 7:
            accessor = chance.randrange(len(gltf["accessors"]))
            kind = chance.choice(["SCALAR", "VEC2", "VEC3", "VEC4", "MAT4"])
            yield ["set", "asset", ["accessors", accessor, "type"], kind]
            if chance.random() < 0.5:
                yield ["set", "asset", ["accessors", accessor, "count"], chance.choice([1, 2, 3, 5, 16])]
        case _:
            node = chance.randrange(len(gltf["nodes"]))
            entry = chance.choice([5, None, [], {}, {"tools": [{}]}, {"tools": 5, "original": 0}, {"original": -1}])
            yield ["set", "asset", ["nodes", node, "extras"], {"wrinkle": entry}]


def _edits_of_others(chance: random.Random, source: Source) -> Iterator[Edit]:
    """Edits give an asset what other exporters write: pointers, odd names, keys below 0 s, floats for integers."""
    gltf = source.gltf
    channels = [
        (each, number)
        for each, animation in enumerate(gltf.get("animations") or ())
        for number in range(len(animation.get("channels") or ()))
    ]
    match chance.randrange(16):
        case 0 if channels:  # a pointer at something that is there, or not, or is of another type
            animation, number = chance.choice(channels)
            target: Json = {"path": "pointer", "extensions": {_POINTER: {"pointer": chance.choice(_POINTERS)}}}
            if chance.random() < 0.2:
                target = {**target, "node": 0, **chance.choice([{"path": "weights"}, {"extensions": {_POINTER: {}}}])}
            yield ["set", "asset", ["animations", animation, "channels", number, "target"], target]
            yield ["set", "asset", ["extensionsUsed"], [_POINTER]]
        case 1:  # names of morph targets in the extras of a primitive
            mesh = chance.randrange(max(len(gltf.get("meshes", [])), 1))
            names = chance.choice([["a", "b"], ["a", "a"], [], ["\ud800"], [5], "ab", ["a"] * 300, None, {"0": "a"}])
            yield ["set", "asset", ["meshes", mesh, "primitives", 0, "extras"], {"targetNames": names}]
            yield ["drop", "asset", ["meshes", mesh, "extras"]]
        case 2:  # half a character in names
            for kind in ("nodes", "meshes", "materials", "animations", "skins", "scenes"):
                for number in range(len(gltf.get(kind) or ())):
                    if chance.random() < 0.5:
                        yield ["set", "asset", [kind, number, "name"], kind + chr(0xD800 + number % 2048)]
        case 3:  # no names, or one for all
            for number in range(len(gltf["nodes"])):
                place = ["asset", ["nodes", number, "name"]]
                yield ["drop", *place] if chance.random() < 0.7 else ["set", *place, "same"]
        case 4 if channels:  # keys below 0 s
            samplers = [each for animation in gltf["animations"] for each in animation.get("samplers") or ()]
            start = _start_of(gltf, chance.choice(samplers).get("input") if samplers else None)
            if start is not None:
                yield ["write", "data", start, struct.pack("<f", chance.choice([-0.5, -1e-3, -1e30])).hex()]
        case 5:  # no number, where a tool may look or not
            primitives = [each for mesh in gltf.get("meshes", []) for each in mesh["primitives"]]
            start = _start_of(gltf, chance.choice([*chance.choice(primitives)["attributes"].values()]))
            if start is not None:
                place = start + 4 * chance.randrange(8)
                yield ["write", "data", place, struct.pack("<f", chance.choice([math.nan, math.inf])).hex()]
        case 6:  # floats for integers
            integers = [(at, each) for at, each in _leaves(gltf) if type(each) is int and abs(each) < 2**53]
            for pointer, value in chance.sample(integers, min(len(integers), chance.choice([1, 5, 10_000]))):
                yield ["set", "asset", pointer, float(value) + chance.choice([0.0] * 20 + [0.5])]
        case 7:  # levels of detail, of any node
            node = chance.randrange(len(gltf["nodes"]))
            ids = chance.choice([[0], [1, 2], [node], [99], [-1], ["0"], [], 5, None, [0] * 1000, list(range(12))])
            yield ["set", "asset", ["nodes", node, "extensions"], {"MSFT_lod": {"ids": ids}}]
            yield ["set", "asset", ["extensionsUsed"], ["MSFT_lod"]]
        case 8:  # the mesh shown again, in another scene, in none, as a level of detail, or not to be seen
            again = {**_shown(gltf), "name": chance.choice(["limb", "again", "\ud800", 5])}
            again |= chance.choice([{}, {"scale": [1, 1, -1]}, {"scale": [0, 0, 0]}, {"translation": [0, 1e-6, 0]}])
            if chance.random() < 0.3:
                visible = chance.choice([False, False, True, None, 0, []])
                again["extensions"] = {"KHR_node_visibility": {"visible": visible}}
            yield ["insert", "asset", ["nodes", len(gltf["nodes"])], again]
            if chance.random() < 0.6:
                scenes = chance.choice([[{"nodes": [len(gltf["nodes"])]}], {"nodes": [len(gltf["nodes"])]}])
                where = ["scenes", 0, "nodes", 0] if chance.random() < 0.5 else ["scenes", 1]
                yield ["insert", "asset", where, len(gltf["nodes"]) if len(where) == 4 else scenes]
        case 9:  # mirrored
            number = chance.randrange(len(gltf["nodes"]))
            yield ["set", "asset", ["nodes", number, "scale"], chance.choice([[-1, 1, 1], [-1, -1, -1], [1, -1e-9, 1]])]
        case 10:  # masks, of textures that are there or not, and names of joints of other programs
            texture = {
                "baseColorTexture": {"index": chance.choice([0, 0, 1, 99]), "texCoord": chance.choice([0, 0, 7])}
            }
            cutoff = chance.choice([0.5, 0, 1, 2, -1, math.nan, "0.5", None, 10**400])
            mask = {"alphaMode": chance.choice(["MASK", "MASK", "BLEND", "mask", 5]), "alphaCutoff": cutoff}
            yield ["set", "asset", ["materials"], [{**mask, "pbrMetallicRoughness": texture}] * 2]
            yield ["set", "asset", ["images"], [{"uri": chance.choice(_PICTURES)}]]
            yield ["set", "asset", ["textures"], [{"source": 0}]]
            yield ["set", "asset", ["meshes", 0, "primitives", 0, "material"], 0]
        case 11:
            prefix = chance.choice(
                ["mixamorig:", "mixamorig9:", "mixamorig_", "Armature|", "a:b:", ":", "\ud800:", "|"]
            )
            for number, node in enumerate(gltf["nodes"]):
                if chance.random() < 0.9:
                    yield ["set", "asset", ["nodes", number, "name"], f"{prefix}{node.get('name', '')}"]
        case 12:  # normals that are zero, or opposite
            yield ["normals", "geometry", chance.randrange(1000), chance.choice([0.1, 0.5, 1.0])]
        case 13:  # a pointer of Git LFS, in place of a file or of a buffer
            if chance.random() < 0.5:
                yield ["cut", "asset bytes", 0, 10**9]
                yield ["put", "asset bytes", 0, _LFS.hex()]
            else:
                yield ["cut", "data", 0, 10**9]
                yield ["put", "data", 0, _LFS.hex()]
        case 14:  # a flood, or depths, of tools
            flood = (
                ["repeat", "tools", ["tools", 0], chance.choice([1000, 20_000])],
                ["set", "tools", ["tools"], [{}] * chance.choice([50, 5000])],
                [
                    "put",
                    "tools bytes",
                    0,
                    (chance.choice([b"[", b"{a: ", b"- ", b"? ", b"&a ", b"!a "]) * 20_000).hex(),
                ],
            )
            yield chance.choice(flood)
        case _:  # vertices that are one but for rounding
            yield ["near", "geometry", chance.randrange(1000), chance.choice([1e-16, 1e-7, 1e-6, 2e-6, 1e-4])]


def _shown(gltf: Json) -> Json:
    """What a node needs to show the first mesh."""
    node = next((each for each in gltf["nodes"] if "mesh" in each), {})
    return {key: node[key] for key in ("mesh", "skin") if key in node}


def _start_of(gltf: Json, index: Any) -> int | None:
    """The offset in the buffer at which an accessor's values begin; None if that is not plain."""
    try:
        accessor = gltf["accessors"][index]
        return int(gltf["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0))
    except (LookupError, TypeError):
        return None


def _lists(root: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[list[Any], list[Any]]]:
    """Every array of a tree, with its pointer."""
    for key, child in root.items() if isinstance(root, dict) else enumerate(root):
        if isinstance(child, list):
            yield [*above, key], child
        if isinstance(child, dict | list):
            yield from _lists(child, (*above, key))


def _link_edit(chance: random.Random, gltf: Json) -> Iterator[Edit]:
    """Turn an index to something else, or bend the node graph, skin or channels."""
    count = len(gltf["nodes"])
    if chance.random() < 0.4:
        node, number = chance.randrange(count), chance.randrange(count)
        match chance.randrange(7):
            case 0:
                yield ["set", "asset", ["nodes", node, "children"], [number]]
            case 1:
                yield ["set", "asset", ["nodes", node, "children"], list(range(count))]
            case 2:
                yield ["set", "asset", ["nodes", node, "skin"], chance.choice(_SMALL)]
            case 3:
                yield ["set", "asset", ["nodes", node, "mesh"], chance.choice([0, 0, 1])]
            case 4:
                moved = chance.choice(["translation", "scale"])
                yield ["set", "asset", ["nodes", node, moved], [chance.choice(_REALS[:-2]) for _ in range(3)]]
            case 5 if gltf.get("skins"):
                yield ["insert", "asset", ["skins", 0, "joints", 0], chance.choice([number, 0, 1, 99])]
            case _:
                yield [
                    "set",
                    "asset",
                    ["nodes", node, "matrix"],
                    [chance.choice([0, 1, *_REALS[:-2]]) for _ in range(16)],
                ]
        return
    integers = [each for each, value in _leaves(gltf) if isinstance(value, int) and not isinstance(value, bool)]
    yield ["set", "asset", chance.choice(integers), chance.randrange(12)]


def _number_edit(chance: random.Random, gltf: Json) -> Iterator[Edit]:
    """Another number in the accessors, views, buffers, samplers: counts, offsets, lengths, types."""
    kind = chance.choice(["accessors", "accessors", "bufferViews", "buffers", "meshes", "skins", "animations", "nodes"])
    if not gltf.get(kind):
        return
    index = chance.randrange(len(gltf[kind]))
    numbers = [(each, value) for each, value in _leaves(gltf[kind][index]) if isinstance(value, int | float)]
    if numbers:
        pointer, value = chance.choice(numbers)
        near = [value - 1, value + 1, value * 2, value // 2] if abs(value) < math.inf else []
        yield [
            "set",
            "asset",
            [kind, index, *pointer],
            chance.choice([*near, chance.choice([*_SMALL, *_LARGE, *_REALS])]),
        ]
    if kind == "accessors" and chance.random() < 0.2:
        yield ["drop", "asset", [kind, index, "bufferView"]]
        yield ["set", "asset", [kind, index, "count"], chance.choice([1, 49, 2**20, 2**24, 2**26, 2**32])]


def _leaves(root: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[list[Any], Any]]:
    """Every leaf of a tree, with its pointer."""
    for key, child in root.items() if isinstance(root, dict) else enumerate(root):
        if isinstance(child, dict | list):
            yield from _leaves(child, (*above, key))
        else:
            yield [*above, key], child


def _data_edits(chance: random.Random, source: Source) -> Iterator[Edit]:
    """Numbers that are not, or are too large or small, in what an accessor shows; or any bytes."""
    view = chance.choice(source.gltf["bufferViews"])
    start, length = view.get("byteOffset", 0), view.get("byteLength", 4)
    start = min(start, max(len(source.data) - 4, 0))  # of a placeholder's view
    count = min(length, len(source.data) - start) // 4
    value = struct.pack("<f", chance.choice(_FLOATS))
    for _ in range(chance.choice([1, 1, 3, min(count, 40)])):
        place = start + 4 * chance.randrange(max(count, 1))
        yield ["write", "data", place, (value if chance.random() < 0.8 else chance.randbytes(4)).hex()]


def geometry_edit(chance: random.Random) -> Iterator[Edit]:
    """Vertices at one place, in one plane or on one line, noise, triangles without area, a mesh that crosses itself."""
    seed = chance.randrange(1000)
    edits = (
        ["noise", "geometry", seed, chance.choice([1e-7, 1e-3, 0.05, 0.3, 3.0])],
        ["coincide", "geometry", seed, chance.choice([0.02, 0.2, 0.9, 1.0])],
        ["pair", "geometry", seed, chance.choice([0.1, 0.5])],
        ["flat", "geometry", seed % 3, chance.choice([0.0, 1e-9, 0.01])],
        ["grid", "geometry", seed, chance.choice([0.01, 0.1, 0.25, 1.0])],
        ["wave", "geometry", seed % 3, chance.choice([3.0, 30.0])],
        ["scale", "geometry", seed, chance.choice([1e-30, 1e-6, 1e6, 1e15])],
        ["swap", "geometry", seed, chance.choice([0.1, 0.9])],
        ["empty", "geometry", seed, chance.choice([0.05, 0.5, 1.0])],
        ["weights", "geometry", seed, chance.choice([0.1, 1.0])],
    )
    yield chance.choice(edits)


def body_edits(chance: random.Random) -> Iterator[Edit]:
    """A muscle, flesh or a field in the tools file, with a fault in three of four cases."""
    kind = chance.choice(sorted(_BODIES))
    yield ["set", "tools", [kind], [_BODIES[kind]]]
    if chance.random() < 0.75:
        yield from tree_edit(chance, "tools", {kind: [_BODIES[kind]]})


def presets_edits(chance: random.Random) -> Iterator[Edit]:
    """A fault in a file of presets."""
    if chance.random() < 0.7:
        yield from tree_edit(chance, "presets", {"presets": OWN_PRESETS})
    else:
        yield from _byte_edits(chance, "presets bytes", 200)


def damaged_presets(edits: Sequence[Edit]) -> bytes:
    """The file of presets, with these faults."""
    tree = {"presets": copied(OWN_PRESETS)}
    for edit in edits:
        if edit[1] == "presets":
            edit_tree(tree, edit)
    data = bytearray(json.dumps(tree.get("presets")).encode("utf-8", "replace"))
    for edit in edits:
        if edit[1] == "presets bytes":
            edit_bytes(data, edit)
    return bytes(data)


def _byte_edits(chance: random.Random, part: str, size: int) -> Iterator[Edit]:
    """Cut, flip, overwrite, repeat or insert bytes of a file."""
    place = chance.randrange(size)
    head = min(place, chance.choice([12, 40, size]))
    match chance.randrange(6):
        case 0:
            yield ["cut", part, place, size]
        case 1:
            for _ in range(chance.choice([1, 2, 8])):
                yield ["flip", part, chance.randrange(size), 1 << chance.randrange(8)]
        case 2:
            number = chance.choice([b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\1\0\0\0"])
            yield ["write", part, head, number.hex()]
        case 3 | 4:
            yield ["cut", part, place, chance.choice([1, 4, 64])]
        case _:
            texts = [b"[" * 3000, b"&a [*a, *a]", b"\0", b"1e999", b'"', b"\xff\xfe", b": ", b"- "]
            yield ["put", part, place, chance.choice(texts).hex()]


def damaged(source: Source, edits: Sequence[Edit]) -> tuple[bytes, bytes]:
    """The files of an asset and its tools, with these faults; edits of what others took away do nothing."""
    trees: dict[str, Any] = {"asset": copied(source.gltf), "tools": copied(source.tools)}
    data = bytearray(source.data)
    of_record = [edit for edit in edits if edit[1] == "record"]
    if of_record:

        def change(record: Json) -> None:
            for edit in of_record:
                edit_tree(record, edit)

        trees["asset"], forged = forge(trees["asset"], bytes(data), change)
        data = bytearray(forged)
    for edit in edits:
        if edit[1] in trees:
            edit_tree(trees[edit[1]], edit)
    for edit in edits:
        if edit[1] == "data":
            edit_bytes(data, edit)
        elif edit[1] == "geometry":
            _edit_geometry(source.gltf, data, edit)
    files = {
        "asset bytes": bytearray(packed(trees["asset"], bytes(data), source.suffix)),
        "tools bytes": bytearray(json.dumps(trees["tools"]).encode("utf-8", "replace")),
    }
    for edit in edits:
        if edit[1] in files:
            edit_bytes(files[edit[1]], edit)
    return bytes(files["asset bytes"]), bytes(files["tools bytes"])


def edit_tree(root: Any, edit: Edit) -> None:
    """Change a tree."""
    what, _, (*above, key), *values = edit
    try:
        at = _at(root, above)
        if what == "set":
            at[key] = copied(values[0])
        elif what == "drop":
            del at[key]
        elif what == "insert":
            at.insert(key, copied(values[0]))
        else:
            at[key:key] = [at[key]] * values[0]
    except (LookupError, TypeError, AttributeError):
        pass


def _edit_geometry(gltf: Json, data: bytearray, edit: Edit) -> None:
    """Move vertices of every mesh, or change its triangles or skin weights, where these are stored plainly."""
    what, _, seed, amount = edit
    chance = np.random.default_rng(seed)
    for primitive in [each for mesh in gltf.get("meshes", []) for each in mesh["primitives"]]:
        wanted = {"swap": "indices", "empty": "indices", "weights": "WEIGHTS_0", "normals": "NORMAL"}.get(
            what, "POSITION"
        )
        index = primitive.get("indices") if wanted == "indices" else primitive["attributes"].get(wanted)
        values = None if index is None else _stored(gltf, data, index)
        if values is None:
            continue
        count = len(values)
        some = chance.random(count) < amount
        if wanted == "indices":
            corners = values[: count // 3 * 3].reshape(-1, 3)
            some = chance.random(len(corners)) < amount
            corners[some, 1] = corners[some, 0 if what == "empty" else 2]
        elif what == "normals":
            values[some] *= chance.choice([0, -1]).astype(values.dtype)
        elif what == "weights":
            values[some] = chance.permutation(values[some])
        else:
            with np.errstate(all="ignore"):
                values[:] = _moved(values.astype(float), what, some, seed, amount, chance)


def _moved(places: Any, what: str, some: Any, seed: int, amount: float, chance: np.random.Generator) -> Any:
    """(vertices, 3) positions that have been moved."""
    size = float(np.abs(places).max()) or 1.0
    match what:
        case "noise":
            return places + amount * size * chance.standard_normal(places.shape)
        case "coincide":
            return np.where(some[:, None], places[seed % len(places)], places)
        case "pair":
            return np.where(some[:, None], chance.permutation(places), places)
        case "flat":
            places[:, seed] *= amount
        case "near":  # in pairs
            nudge = amount * size * chance.choice([-1.0, 1.0], places.shape)
            return np.where(np.arange(len(places))[:, None] % 2 == 1, np.roll(places, 1, axis=0) + nudge, places)
        case "grid":
            return np.round(places / (amount * size)) * (amount * size)
        case "wave":
            places[:, seed] = size * np.sin(amount * places[:, seed] / size)
        case "scale":
            return places * amount
    return places


def _stored(gltf: Json, data: bytearray, index: int) -> Any:
    """A view of an accessor's values in the buffer; None if they are sparse, compressed or in between others."""
    accessor = gltf["accessors"][index]
    view = gltf["bufferViews"][accessor["bufferView"]] if "bufferView" in accessor else {"extensions": 1}
    if "sparse" in accessor or "extensions" in view or "byteStride" in view:
        return None
    kind = np.dtype({5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor["componentType"]])
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    if start + accessor["count"] * width * kind.itemsize > len(data):  # another edit has cut it
        return None
    found = np.frombuffer(data, kind, accessor["count"] * width, start)
    return found if width == 1 else found.reshape(-1, width)


def edit_bytes(data: bytearray, edit: Edit) -> None:
    """Change bytes."""
    what, _, place, value = edit
    if what == "cut":
        del data[place : place + value]
    elif what == "flip" and place < len(data):
        data[place] ^= value
    elif what == "put":
        data[place:place] = bytes.fromhex(value)
    elif what == "flood":
        data[len(data) :] = bytes.fromhex(place) * value
    elif what == "write" and place < len(data):
        data[place : place + len(value) // 2] = bytes.fromhex(value)
