"""The bundled samples, tools for them, and changes of them: `edited("wrist", without_normals)` is a file."""

import copy
import json
import struct
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from kit.asset import Json, bare_skeleton
from kit.places import FOLDER, ROOT, SAMPLES
from kit.player import DTYPES, WIDTHS, Gltf


def sample(name: str) -> Path:
    return SAMPLES / f"{name}.glb"


# The tool of configs/wrist.yaml on the palm's side; the clip flex shortens it by 56 %, extend stretches it.
PALM: Json = {"name": "palm", "origin": [-0.032, -0.022, 0.0], "target": [0.028, -0.0205, 0.0], "width": 0.065}
BACK: Json = {"name": "back", "origin": [-0.030, 0.0220, 0.0], "target": [0.030, 0.0198, 0.0], "width": 0.065}
# Round the fold, from the palm to the side of the arm.
BENT: Json = {
    "name": "bent",
    "path": [[-0.032, -0.022, 0.0], [-0.008, -0.0215, 0.004], [0.014, -0.022, 0.011], [0.03, -0.0245, 0.02]],
    "width": 0.02,
}
BROW: Json = {"name": "brow", "origin": [0.028, 0.2400, 0.0847], "target": [0.028, 0.2880, 0.0635], "width": 0.056}


class Editor:
    """A document to change before it is baked."""

    def __init__(self, source: Gltf) -> None:
        self.json = copy.deepcopy(source.json)  # tests share what was baked once
        self.data = bytearray(source.buffers[0])

    def view(self, data: bytes) -> int:
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: NDArray[Any], **more: Any) -> int:
        """(count, components) in the type to store."""
        kind = next(key for key, width in WIDTHS.items() if width == values.shape[1])
        component = next(key for key, dtype in DTYPES.items() if np.dtype(dtype) == values.dtype)
        entry = {"bufferView": self.view(values.tobytes()), "componentType": component, "count": len(values)}
        self.json["accessors"].append({**entry, "type": kind, **more})
        return len(self.json["accessors"]) - 1

    def times(self, values: Sequence[float]) -> int:
        stored = np.array(values, np.float32)[:, None]
        return self.accessor(stored, min=[float(stored.min())], max=[float(stored.max())])

    def save(self, path: Path) -> Path:
        self.data += bytes(-len(self.data) % 4)
        self.json["buffers"][0]["byteLength"] = len(self.data)
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.data))
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.data), b"BIN\0")
        path.write_bytes(head + chunks + self.data)
        return path


@cache
def edited(name: str, change: Callable[[Editor], None]) -> Path:
    """A sample with a change, made once."""
    editor = Editor(Gltf(sample(name)))
    change(editor)
    return editor.save(Path(tempfile.mkdtemp(dir=FOLDER)) / f"{name}_{change.__name__}.glb")


def bystanders(editor: Editor) -> None:
    """A second mesh, a picture, unknown keys, extras and a camera, none of which wrinkles concern."""
    gltf = editor.json
    corners = np.float32([[0, 1, 0], [1, 1, 0], [0, 2, 0]])
    position = editor.accessor(corners, min=[0, 1, 0], max=[1, 2, 0], name="corners", extras={"of": "the sign"})
    joints = editor.accessor(np.uint8([[7, 0, 0, 0]] * 3), name="_FEATURE")
    del joints
    gltf["meshes"].insert(1, {"name": "sign", "primitives": [{"attributes": {"POSITION": position}}], "extras": 3})
    gltf["nodes"].append({"name": "sign", "mesh": 1, "camera": 0, "extras": {"price": None, "list": []}})
    gltf["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}, "extras": {}}]
    gltf["scenes"][0]["nodes"].append(len(gltf["nodes"]) - 1)
    picture = b"\x89PNG\r\n\x1a\n" + bytes(range(201))
    gltf["images"] = [{"bufferView": editor.view(picture), "mimeType": "image/png", "name": "ä"}]
    gltf["samplers"] = [{"name": "nearest"}]
    gltf["extras"] = {"nothing": None, "kept": [1, 2.5, "三"]}
    gltf["futureKey"] = {"deep": [{"accessor": 1}]}
    gltf["asset"]["copyright"] = "someone"
    gltf["extensionsUsed"] = ["VENDOR_unheard_of"]
    gltf["extensions"] = {"VENDOR_unheard_of": {"level": "high"}}
    gltf["nodes"][0]["extras"] = {"rigger": "me"}
    gltf["animations"][0]["extras"] = {"loop": True}


def without_normals(editor: Editor) -> None:
    for primitive in editor.json["meshes"][0]["primitives"]:
        del primitive["attributes"]["NORMAL"]


def skeleton_only(editor: Editor) -> None:
    """Joints and clips alone."""
    bare_skeleton(editor.json)


def without_animations(editor: Editor) -> None:
    del editor.json["animations"]


def two_parts(editor: Editor) -> None:
    """Every other triangle in a primitive of its own, over the same vertices; the first has more attributes."""
    (primitive,) = editor.json["meshes"][0]["primitives"]
    accessor = editor.json["accessors"][primitive["indices"]]
    view = editor.json["bufferViews"][accessor["bufferView"]]
    stored = np.frombuffer(bytes(editor.data), "<u2", accessor["count"], view["byteOffset"]).reshape(-1, 3)
    count = editor.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
    rng = np.random.default_rng(1)
    second = {**primitive, "attributes": dict(primitive["attributes"])}
    for part, faces in ((primitive, stored[::2]), (second, stored[1::2])):
        part["indices"] = editor.accessor(np.ascontiguousarray(faces).reshape(-1, 1))
    fresh = primitive["attributes"]
    fresh["COLOR_0"] = editor.accessor(rng.integers(0, 256, (count, 4), np.uint8), normalized=True)
    fresh["TEXCOORD_1"] = editor.accessor(rng.integers(0, 65536, (count, 2)).astype(np.uint16), normalized=True)
    fresh["_ID"] = editor.accessor(rng.integers(0, 60000, (count, 2)).astype(np.uint16))
    tangents = np.tile(np.float32([1, 0, 0, -1]), (count, 1))
    fresh["TANGENT"] = editor.accessor(tangents)
    editor.json["meshes"][0]["primitives"].append(second)


def three_materials(editor: Editor) -> None:
    """Three primitives over the same vertices, as exporters write them: the wrist, the hand, the forearm."""
    (primitive,) = editor.json["meshes"][0]["primitives"]
    arrays = [
        editor.json["accessors"][index]
        | {"view": editor.json["bufferViews"][editor.json["accessors"][index]["bufferView"]]}
        for index in (primitive["indices"], primitive["attributes"]["POSITION"])
    ]
    triangles, positions = (
        np.frombuffer(bytes(editor.data), dtype, size * each["count"], each["view"]["byteOffset"]).reshape(-1, 3)
        for each, dtype, size in zip(arrays, ("<u2", "<f4"), (1, 3), strict=True)
    )
    along = positions[triangles, 0].mean(axis=1)
    middle = np.abs(along) < 0.02
    parts = [triangles[middle], triangles[~middle & (along > 0)], triangles[~middle & (along < 0)]]
    editor.json["materials"] = [{"name": name} for name in ("wrist", "hand", "forearm")]
    editor.json["meshes"][0]["primitives"] = [
        {**primitive, "indices": editor.accessor(np.ascontiguousarray(part).reshape(-1, 1)), "material": number}
        for number, part in enumerate(parts)
    ]


def shared_mesh(editor: Editor) -> None:
    """A twin, one unit aside, shows the same mesh on a skeleton of its own, moved alike."""
    gltf = editor.json
    (skin,) = gltf["skins"]
    count = len(gltf["nodes"])
    for node in json.loads(json.dumps(gltf["nodes"])):
        node["children"] = [child + count for child in node.get("children", [])] or None
        gltf["nodes"].append({key: value for key, value in node.items() if value is not None})
        gltf["nodes"][-1]["name"] = "twin" if "mesh" in node else f"{node['name']}.twin"
    root = gltf["nodes"][count + 1]
    root["translation"][2] += 1.0
    gltf["nodes"][count]["skin"] = 1
    gltf["skins"].append({**skin, "joints": [joint + count for joint in skin["joints"]]})
    if "skeleton" in skin:
        gltf["skins"][1]["skeleton"] = skin["skeleton"] + count
    gltf["scenes"][0]["nodes"] += [node + count for node in gltf["scenes"][0]["nodes"]]
    for animation in gltf["animations"]:
        for channel in list(animation["channels"]):
            target = channel["target"]
            animation["channels"].append({**channel, "target": {**target, "node": target["node"] + count}})


def two_meshes(editor: Editor) -> None:
    """A twin with a mesh of its own, over the same accessors."""
    shared_mesh(editor)
    editor.json["meshes"].append(json.loads(json.dumps(editor.json["meshes"][0])))
    next(node for node in editor.json["nodes"] if node["name"] == "twin")["mesh"] = 1


def one_moves(editor: Editor) -> None:
    """Two meshes; flex moves the wrist alone, extend both."""
    two_meshes(editor)
    flex = editor.json["animations"][0]
    count = next(k for k, node in enumerate(editor.json["nodes"]) if node["name"] == "twin")
    flex["channels"] = [channel for channel in flex["channels"] if channel["target"]["node"] < count]


def aside(tool: Json, **changes: Any) -> Json:
    """A tool for the twin."""
    ends = {end: [*tool[end][:2], tool[end][2] + 1.0] for end in ("origin", "target")}
    return {**tool, **ends, "node": "twin", **changes}


def sharp_keys(editor: Editor) -> None:
    """raise_brows with three keys that jump."""
    _own_brow_track(editor, "STEP", [0.0, 0.5, 1.25, 2.0], [[0, 0], [0.8, 0.1], [0.3, 0], [0, 0.5]])


def spline_keys(editor: Editor) -> None:
    """raise_brows on a spline that overshoots."""
    values = [[0, 0], [0.4, 0], [0.5, 0.3], [0.9, 0.1], [0, 0], [-2, 1], [1, 0], [0, 0], [0.5, 0.5]]
    _own_brow_track(editor, "CUBICSPLINE", [0.0, 0.7, 2.0], values)


def _own_brow_track(editor: Editor, kind: str, times: Sequence[float], values: Sequence[Sequence[float]]) -> None:
    animation = editor.json["animations"][0]
    assert animation["name"] == "raise_brows"
    output = editor.accessor(np.array(values, np.float32).reshape(-1, 1))
    animation["samplers"] = [{"input": editor.times(times), "interpolation": kind, "output": output}]
    animation["channels"] = [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]


def with_tangents(editor: Editor) -> None:
    """Tangents along the limb, of either handedness."""
    for primitive in editor.json["meshes"][0]["primitives"]:
        accessor = editor.json["accessors"][primitive["attributes"]["NORMAL"]]
        view = editor.json["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        normals = np.frombuffer(bytes(editor.data), "<f4", 3 * accessor["count"], start).reshape(-1, 3).astype(float)
        axis = np.where(np.abs(normals[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        along = axis - np.sum(axis * normals, axis=1, keepdims=True) * normals
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        hands = np.where(normals[:, 1:2] > 0, 1.0, -1.0)
        primitive["attributes"]["TANGENT"] = editor.accessor(np.hstack([along, hands]).astype(np.float32))


def unnamed_targets(editor: Editor) -> None:
    del editor.json["meshes"][0]["extras"]["targetNames"]


def config(name: str) -> Json:
    found: Json = yaml.safe_load((ROOT / "configs" / f"{name}.yaml").read_text())
    return found
