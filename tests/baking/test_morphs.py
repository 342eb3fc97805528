"""The written file: morph targets, weight tracks, extras, and that all else stays as it was.

`Gltf` reads and plays files without any code of wrinkle's; the tests of other stages use it too.
"""

import atexit
import json
import re
import shutil
import struct
import tempfile
from base64 import b64decode
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

import wrinklecli
from kit.clients import assert_valid, compare_with_three
from wrinklecli.gltf.writer import accessor_references

Floats = NDArray[np.float64]
Json = dict[str, Any]

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(tempfile.mkdtemp(prefix="wrinkle-tests-"))
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)

DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DEFAULTS = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}

# The tool of configs/wrist.yaml on the palm's side; the clip flex shortens it by 56 %, extend stretches it.
PALM: Json = {"name": "palm", "origin": [-0.032, -0.022, 0.0], "target": [0.028, -0.0205, 0.0], "width": 0.065}
BACK: Json = {"name": "back", "origin": [-0.030, 0.0220, 0.0], "target": [0.030, 0.0198, 0.0], "width": 0.065}
BROW: Json = {"name": "brow", "origin": [0.028, 0.2400, 0.0847], "target": [0.028, 0.2880, 0.0635], "width": 0.056}


class Gltf:
    """A glTF file, read and played by the specification alone, in float64."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._arrays: dict[int, Floats] = {}
        content = path.read_bytes()
        chunk = b""
        if content[:4] == b"glTF":
            (size,) = struct.unpack_from("<I", content, 12)
            self.json: Json = json.loads(content[20 : 20 + size])
            chunk = content[28 + size :]
        else:
            self.json = json.loads(content)
        self.buffers = []
        for buffer in self.json.get("buffers", []):
            uri = buffer.get("uri")
            data = chunk if uri is None else b""
            if uri is not None:
                embedded = uri.startswith("data:")
                data = b64decode(uri.partition(",")[2]) if embedded else (path.parent / unquote(uri)).read_bytes()
            self.buffers.append(data)

    def view_bytes(self, index: int) -> bytes:
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self.buffers[view["buffer"]][start : start + view["byteLength"]]

    def _elements(self, source: Json, dtype: str, width: int, count: int) -> NDArray[Any]:
        view = self.json["bufferViews"][source["bufferView"]]
        start = view.get("byteOffset", 0) + source.get("byteOffset", 0)
        size = np.dtype(dtype).itemsize
        stride = view.get("byteStride", size * width)
        data = self.buffers[view["buffer"]]
        return np.ndarray((count, width), dtype, data, start, (stride, size)).copy()

    def stored(self, index: int) -> NDArray[Any]:
        """(count, components) as stored, sparse elements in place."""
        accessor = self.json["accessors"][index]
        dtype, width, count = DTYPES[accessor["componentType"]], WIDTHS[accessor["type"]], accessor["count"]
        values = np.zeros((count, width), dtype)
        if "bufferView" in accessor:
            values = self._elements(accessor, dtype, width, count)
        if sparse := accessor.get("sparse"):
            at = self._elements(sparse["indices"], DTYPES[sparse["indices"]["componentType"]], 1, sparse["count"])
            values[at[:, 0]] = self._elements(sparse["values"], dtype, width, sparse["count"])
        return values

    def array(self, index: int) -> Floats:
        """(count, components) as meant: normalised integers are fractions."""
        if index not in self._arrays:
            values = self.stored(index)
            if self.json["accessors"][index].get("normalized"):
                self._arrays[index] = np.maximum(values / np.iinfo(values.dtype).max, -1.0)
            else:
                self._arrays[index] = values.astype(np.float64)
        return self._arrays[index]

    def node(self, name: str | int) -> int:
        """The node with a mesh of that name."""
        if isinstance(name, int):
            return name
        (index,) = (i for i, node in enumerate(self.json["nodes"]) if node.get("name") == name and "mesh" in node)
        return index

    def mesh(self, node: str | int) -> Json:
        return self.json["meshes"][self.json["nodes"][self.node(node)]["mesh"]]

    def clip(self, name: str | int | None) -> Json:
        if name is None:
            return {"channels": [], "samplers": []}
        animations = self.json["animations"]
        return animations[name] if isinstance(name, int) else next(a for a in animations if a.get("name") == name)

    def sampler(self, clip: str | int | None, node: int, path: str) -> Json | None:
        animation = self.clip(clip)
        wanted = {"node": node, "path": path}
        found = [c for c in animation["channels"] if {k: c["target"].get(k) for k in wanted} == wanted]
        assert len(found) <= 1, "two channels of one property"
        return animation["samplers"][found[0]["sampler"]] if found else None

    def keys(self, clip: str | int, node: str | int, path: str = "weights") -> tuple[Floats, Floats]:
        """(keys,) times and (keys, …) values of a channel."""
        sampler = self.sampler(clip, self.node(node), path)
        assert sampler is not None
        times = self.array(sampler["input"])[:, 0]
        return times, self.array(sampler["output"]).reshape(len(times), -1)

    def played(self, clip: str | int | None, node: int, path: str, times: Sequence[float] | Floats) -> Floats | None:
        """(times, components) of a property; none where the clip does not animate it."""
        sampler = self.sampler(clip, node, path)
        if sampler is None:
            return None
        keys, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
        kind = sampler.get("interpolation", "LINEAR")
        values = values.reshape(len(keys), 3 if kind == "CUBICSPLINE" else 1, -1)
        return np.array([_between(keys, values, kind, path, float(time)) for time in times])

    def weights(self, node: str | int, clip: str | int | None, times: Sequence[float] | Floats) -> Floats:
        """(times, targets)."""
        index = self.node(node)
        count = len(self.mesh(index)["primitives"][0].get("targets", []))
        stored = self.json["nodes"][index].get("weights", self.mesh(index).get("weights", [0.0] * count))
        played = self.played(clip, index, "weights", times)
        return np.tile(np.array(stored, np.float64), (len(times), 1)) if played is None else played

    def matrices(self, clip: str | int | None, times: Sequence[float] | Floats) -> Floats:
        """(times, nodes, 4, 4) to world space."""
        nodes = self.json["nodes"]
        local = np.zeros((len(times), len(nodes), 4, 4))
        parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
        for index, node in enumerate(nodes):
            if "matrix" in node:
                local[:, index] = np.array(node["matrix"], np.float64).reshape(4, 4).T
                continue
            parts = {}
            for path, default in DEFAULTS.items():
                played = self.played(clip, index, path, times)
                stored = np.array(node.get(path, default), np.float64)
                parts[path] = np.tile(stored, (len(times), 1)) if played is None else played
            for frame in range(len(times)):
                local[frame, index, :3, :3] = _rotation(parts["rotation"][frame]) * parts["scale"][frame]
            local[:, index, :3, 3] = parts["translation"]
            local[:, index, 3, 3] = 1.0
        world = local.copy()
        for index in range(len(nodes)):
            above = parents.get(index)
            while above is not None:
                world[:, index] = local[:, above] @ world[:, index]
                above = parents.get(above)
        return world

    def attribute(self, node: str | int, name: str) -> Floats:
        """(vertices, components), the primitives one after another."""
        return np.concatenate([self.array(p["attributes"][name]) for p in self.mesh(node)["primitives"]])

    def deltas(self, node: str | int, name: str = "POSITION") -> Floats:
        """(targets, vertices, 3)."""
        per_primitive = []
        for primitive in self.mesh(node)["primitives"]:
            count = self.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
            zeros = np.zeros((count, 3))
            targets = primitive.get("targets", [])
            rows = [self.array(each[name]) if name in each else zeros for each in targets]
            per_primitive.append(np.array(rows).reshape(len(rows), count, 3))
        return np.concatenate(per_primitive, axis=1)

    def triangles(self, node: str | int) -> NDArray[np.int64]:
        """(triangles, 3), the primitives one after another."""
        start, parts = 0, []
        for primitive in self.mesh(node)["primitives"]:
            count = self.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
            indices = self.stored(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(count)
            parts.append(indices.astype(np.int64).reshape(-1, 3) + start)
            start += count
        return np.concatenate(parts)

    def blended(self, node: str | int, clip: str | int | None, times: Sequence[float] | Floats) -> Floats:
        """(times, vertices, 4, 4) each vertex's matrix from bind to world space."""
        index = self.node(node)
        world = self.matrices(clip, times)
        carrier = self.json["nodes"][index]
        count = len(self.attribute(index, "POSITION"))
        if "skin" not in carrier:
            return np.broadcast_to(world[:, index, None], (len(times), count, 4, 4))
        skin = self.json["skins"][carrier["skin"]]
        inverse = np.tile(np.eye(4), (len(skin["joints"]), 1, 1))
        if "inverseBindMatrices" in skin:
            inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        palette = world[:, skin["joints"]] @ inverse
        dense = np.zeros((count, len(skin["joints"])))
        names = self.mesh(index)["primitives"][0]["attributes"]
        for number in range(sum(name.startswith("JOINTS_") for name in names)):
            joints = self.attribute(index, f"JOINTS_{number}").astype(int)
            for column, weights in zip(joints.T, self.attribute(index, f"WEIGHTS_{number}").T, strict=True):
                dense[np.arange(count), column] += weights
        # A vertex without weight follows its first joint, as in three.js.
        weightless = np.flatnonzero(dense.sum(axis=1) == 0)
        dense[weightless, self.attribute(index, "JOINTS_0").astype(int)[weightless, 0]] = 1.0
        dense /= dense.sum(axis=1, keepdims=True)
        return np.einsum("vj,tjab->tvab", dense, palette)

    def pose(self, node: str | int, clip: str | int | None, times: Sequence[float] | Floats) -> Floats:
        """(times, vertices, 3) world space."""
        morphed = self.attribute(node, "POSITION") + np.tensordot(
            self.weights(node, clip, times), self.deltas(node), axes=1
        )
        matrices = self.blended(node, clip, times)
        return np.einsum("tvab,tvb->tva", matrices[..., :3, :3], morphed) + matrices[..., :3, 3]

    def normals(self, node: str | int, clip: str | int | None, times: Sequence[float] | Floats) -> Floats:
        """(times, vertices, 3) unit, world space."""
        bent = self.attribute(node, "NORMAL") + np.tensordot(
            self.weights(node, clip, times), self.deltas(node, "NORMAL"), axes=1
        )
        inverse = np.linalg.inv(self.blended(node, clip, times)[..., :3, :3])
        turned = np.einsum("tvba,tvb->tva", inverse, bent)
        return turned / np.linalg.norm(turned, axis=2, keepdims=True)


def _between(keys: Floats, values: Floats, kind: str, path: str, time: float) -> Floats:
    points = values[:, 1] if kind == "CUBICSPLINE" else values[:, 0]
    if time <= keys[0] or len(keys) == 1:
        return points[0]
    if time >= keys[-1]:
        return points[-1]
    k = int(np.searchsorted(keys, time, side="right")) - 1
    span = keys[k + 1] - keys[k]
    t = (time - keys[k]) / span
    if kind == "STEP":
        return points[k]
    if kind == "CUBICSPLINE":
        out, into = span * values[k, 2], span * values[k + 1, 0]
        hermite = (2 * t**3 - 3 * t**2 + 1) * points[k] + (t**3 - 2 * t**2 + t) * out
        hermite = hermite + (-2 * t**3 + 3 * t**2) * points[k + 1] + (t**3 - t**2) * into
        return hermite / np.linalg.norm(hermite) if path == "rotation" else hermite
    if path == "rotation":
        a, b = (q / np.linalg.norm(q) for q in (points[k], points[k + 1]))
        b = -b if a @ b < 0 else b
        angle = np.arccos(min(float(a @ b), 1.0))
        if angle < 1e-7:
            return (1 - t) * a + t * b
        return (np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle)
    return (1 - t) * points[k] + t * points[k + 1]


def _rotation(quaternion: Floats) -> Floats:
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def sample(name: str) -> Path:
    return ROOT / "samples" / f"{name}.glb"


def write_tools(path: Path, *tools: Json, **top: Any) -> Path:
    """A tools file of these tools, and other top-level keys."""
    path.write_text(yaml.safe_dump({"version": 1, "tools": list(tools), **top}))
    return path


@cache
def _baked(asset: Path, text: str, options: str) -> Path:
    folder = Path(tempfile.mkdtemp(dir=FOLDER))
    tools = folder / "tools.yaml"
    tools.write_text(text)
    wrinklecli.bake(asset, tools, folder / "out.glb", **json.loads(options))
    return folder / "out.glb"


@cache
def _read(path: Path) -> Gltf:
    """A file that no test changes, read once."""
    return Gltf(path)


def bake_once(asset: Path | str, *tools: Json, top: Json | None = None, **options: Any) -> Gltf:
    """Bake an asset (or a sample by its name); the same bake is made only once."""
    asset = sample(asset) if isinstance(asset, str) else asset
    text = yaml.safe_dump({"version": 1, "tools": list(tools), **(top or {})})
    return _read(_baked(asset, text, json.dumps(options, sort_keys=True)))


def bake_config(asset: str, config: str, **options: Any) -> Gltf:
    """Bake a sample with one of the bundled tools files."""
    text = (ROOT / "configs" / f"{config}.yaml").read_text()
    return _read(_baked(sample(asset), text, json.dumps(options, sort_keys=True)))


class Editor:
    """A document to change before it is baked."""

    def __init__(self, source: Gltf) -> None:
        self.json = source.json
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


def wrinkle_columns(file: Gltf, node: str | int) -> list[int]:
    names = file.mesh(node)["extras"]["targetNames"]
    return [index for index, name in enumerate(names) if name.startswith("wrinkle_")]


def described(file: Gltf) -> list[Json]:
    """The nodes, but for the number of the buffer view with the original, which there are fewer or more before."""
    nodes: list[Json] = json.loads(json.dumps(file.json["nodes"]))
    for node in nodes:
        if "wrinkle" in node.get("extras", {}):
            assert node["extras"]["wrinkle"].pop("original") == len(file.json["bufferViews"]) - 1
    return nodes


def anchor_places(file: Gltf, anchor: Json, node: str | int, clip: str | int | None, times: Floats) -> Floats:
    """(times, 3) of an anchor in a node's extras, by what the extras say alone."""
    names = [each.get("name") for each in file.json["nodes"]]
    world = file.matrices(clip, times)
    morph_weights = file.weights(node, clip, times)
    targets = file.mesh(node)["extras"]["targetNames"]
    place = np.zeros((len(times), 3))
    for number, (joint, weight) in enumerate(zip(anchor["joints"], anchor["weights"], strict=True)):
        points = np.tile(np.array(anchor["positions"][number]), (len(times), 1))
        for name, moves in anchor.get("morphs", {}).items():
            points = points + morph_weights[:, [targets.index(name)]] * np.array(moves[number])
        matrices = world[:, names.index(joint)]
        place += weight * (np.einsum("tab,tb->ta", matrices[:, :3, :3], points) + matrices[:, :3, 3])
    return place


def anchor_distances(file: Gltf, tool: Json, node: str | int, clip: str | int | None, times: Floats) -> Floats:
    """(times,) distance of a tool's anchors by the node's extras."""
    ends = [anchor_places(file, tool[end], node, clip, times) for end in ("origin", "target")]
    return np.linalg.norm(ends[1] - ends[0], axis=1)


def differences(before: Any, after: Any, path: str = "") -> Iterator[str]:
    """JSON paths at which two documents differ, the elements that only one has by their own path."""
    if isinstance(before, dict) and isinstance(after, dict):
        kept = [key for key in before if key in after]
        replaced = re.match(r"/(accessors|bufferViews)/", path)
        assert replaced or kept == [key for key in after if key in before], f"{path}: order of keys"
        for key in {**before, **after}:
            if key in before and key in after:
                yield from differences(before[key], after[key], f"{path}/{key}")
            else:
                yield f"{path}/{key}"
    elif isinstance(before, list) and isinstance(after, list):
        for index in range(max(len(before), len(after))):
            if index < min(len(before), len(after)):
                yield from differences(before[index], after[index], f"{path}/{index}")
            else:
                yield f"{path}/{index}"
    elif before != after or type(before) is not type(after):
        yield path


# What follows are assets: changes of the samples.


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


# Targets


def vertex_accessors(primitive: Json) -> list[int]:
    targets = (list(target.values()) for target in primitive.get("targets", []))
    return [*primitive["attributes"].values(), *chain.from_iterable(targets)]


@pytest.mark.parametrize(
    "tool", [PALM, {**PALM, "width": 0.004, "origin": [0.03, -0.0205, 0.0], "target": [0.06, -0.02, 0.0]}]
)
@pytest.mark.parametrize("accessors", ["sparse", "dense"])
def test_primitives_go_on_sharing_vertices(tool: Json, accessors: str) -> None:
    """Refined once for all, those that no tool reaches too; the motion is that of a mesh of one primitive."""
    asset = edited("wrist", three_materials)
    whole, parted = (bake_once(each, tool, accessors=accessors) for each in ("wrist", asset))
    primitives = parted.mesh("wrist")["primitives"]
    assert [each["material"] for each in primitives] == [0, 1, 2]
    assert len(primitives[0]["targets"]) > 0
    for other in primitives[1:]:
        assert vertex_accessors(other) == vertex_accessors(primitives[0])
    # Vertices on the edges between two primitives are there once for each, indices that nothing splits stay.
    added = len(parted.json["accessors"]) - len(Gltf(asset).json["accessors"])
    assert added == len(whole.json["accessors"]) - len(Gltf(sample("wrist")).json["accessors"])
    grown = parted.path.stat().st_size - asset.stat().st_size
    assert grown < 1.15 * (whole.path.stat().st_size - sample("wrist").stat().st_size)
    lost = [
        set(range(len(each["accessors"]))) - set(accessor_references(each)) for each in (Gltf(asset).json, parted.json)
    ]
    assert lost[0] == lost[1], "an accessor that nothing shows any more"
    assert_valid(parted.path)
    for clip in ("flex", "extend"):
        times = [0.0, 0.4, 0.77, 1.3]
        shown = parted.pose("wrist", clip, times)
        compare_with_three(parted.path, "wrist", clip, times, shown)
        corners = [file.pose("wrist", clip, times)[:, file.triangles("wrist")] for file in (whole, parted)]
        middles = [np.sort(each.mean(axis=2), axis=1) for each in corners]
        assert np.abs(middles[0] - middles[1]).max() < 1e-6


def test_attributes_that_primitives_share_stay_shared() -> None:
    one, other = bake_once(edited("wrist", two_parts), PALM).mesh("wrist")["primitives"]
    for name, index in other["attributes"].items():
        assert one["attributes"][name] == index
    # TANGENT, which the second lacks, does not keep POSITION and NORMAL targets apart.
    assert [each["POSITION"] for each in one["targets"]] == [each["POSITION"] for each in other["targets"]]


def test_shared_points_are_left_alone() -> None:
    """Points drawn over the same vertices: without indices, new ones would be drawn too."""

    def points(editor: Editor) -> None:
        (primitive,) = editor.json["meshes"][0]["primitives"]
        kept = {key: value for key, value in primitive.items() if key != "indices"}
        editor.json["meshes"][0]["primitives"].append({**kept, "mode": 0})

    asset = edited("wrist", points)
    before, after = (file.mesh("wrist")["primitives"] for file in (Gltf(asset), bake_once(asset, PALM)))
    count = Gltf(asset).json["accessors"][before[1]["attributes"]["POSITION"]]["count"]
    assert bake_once(asset, PALM).json["accessors"][after[1]["attributes"]["POSITION"]]["count"] == count
    assert after[1]["mode"] == 0
    assert_valid(bake_once(asset, PALM).path)


def test_old_vertices_keep_index_and_bits_and_new_ones_follow() -> None:
    before, after = Gltf(edited("wrist", two_parts)), bake_once(edited("wrist", two_parts), PALM)
    pairs = zip(before.mesh("wrist")["primitives"], after.mesh("wrist")["primitives"], strict=True)
    for old, new in pairs:
        assert list(old["attributes"]) == list(new["attributes"])
        for name in old["attributes"]:
            was, now = (file.stored(each["attributes"][name]) for file, each in ((before, old), (after, new)))
            assert len(now) > len(was)
            assert now[: len(was)].tobytes() == was.tobytes(), name
            kinds = [
                (entry["componentType"], entry["type"], entry.get("normalized"))
                for file, each in ((before, old), (after, new))
                for entry in [file.json["accessors"][each["attributes"][name]]]
            ]
            assert kinds[0] == kinds[1], name


def test_new_attributes_lie_between_old_ones() -> None:
    after = bake_once(edited("wrist", two_parts), PALM)
    primitive = after.mesh("wrist")["primitives"][0]
    old = len(Gltf(sample("wrist")).attribute("wrist", "POSITION"))
    values = {name: after.array(index) for name, index in primitive["attributes"].items()}
    assert np.abs(np.linalg.norm(values["NORMAL"][old:], axis=1) - 1).max() < 1e-6
    assert np.abs(np.linalg.norm(values["TANGENT"][old:, :3], axis=1) - 1).max() < 1e-6
    assert np.array_equal(np.unique(values["TANGENT"][:, 3]), [-1.0])
    assert np.abs(values["WEIGHTS_0"].sum(axis=1) - 1).max() < 1e-6
    for name in ("TEXCOORD_0", "TEXCOORD_1", "COLOR_0"):
        assert (values[name][old:] >= values[name][:old].min(axis=0)).all(), name
        assert (values[name][old:] <= values[name][:old].max(axis=0)).all(), name
    known = {tuple(row) for row in values["_ID"][:old].tolist()}
    assert {tuple(row) for row in values["_ID"][old:].tolist()} <= known, "a feature id was made up"


def test_the_refined_surface_is_whole() -> None:
    """Every edge that two triangles shared still is shared by two: no cracks, across seams and primitives."""
    for asset in (sample("wrist"), edited("wrist", two_parts)):
        before, after = Gltf(asset), bake_once(asset, PALM)
        counts = []
        for file in (before, after):
            positions = file.attribute("wrist", "POSITION")
            _, weld = np.unique(positions.round(9), axis=0, return_inverse=True)
            faces = weld.reshape(-1)[file.triangles("wrist")]
            edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
            _, uses = np.unique(edges, axis=0, return_counts=True)
            counts.append(np.bincount(uses))
        assert len(counts[1]) == len(counts[0]) == 3
        assert counts[1][1] == counts[0][1], "the border has changed"


@pytest.mark.parametrize("mode", ["sparse", "dense"])
@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_names_counts_and_weights_fit(name: str, config: str, mode: str) -> None:
    before, after = Gltf(sample(name)), bake_config(name, config, accessors=mode)
    mesh, old = after.mesh(name), before.mesh(name)
    names = mesh["extras"]["targetNames"]
    old_names = old.get("extras", {}).get("targetNames", [])
    assert names[: len(old_names)] == old_names
    assert all(re.fullmatch(r"wrinkle_[A-Za-z0-9_]+_[1-9][0-9]*", each) for each in names[len(old_names) :])
    assert len(set(names)) == len(names)
    assert {len(primitive["targets"]) for primitive in mesh["primitives"]} == {len(names)}
    for primitive in mesh["primitives"]:
        assert all(set(target) == {"POSITION", "NORMAL"} for target in primitive["targets"])
    if "weights" in mesh:
        assert mesh["weights"] == old["weights"] + [0.0] * (len(names) - len(old_names))
    for clip in after.json["animations"]:
        times, values = after.keys(clip["name"], name)
        assert (np.diff(times) > 0).all()
        assert values.shape == (len(times), len(names))
        assert np.abs(values[:, len(old_names) :]).max() <= 1.0


def test_every_primitive_gets_every_target_and_the_untouched_share_zeros() -> None:
    def far_part(editor: Editor) -> None:
        """Triangles beyond the knuckles are a primitive of their own."""
        (primitive,) = editor.json["meshes"][0]["primitives"]
        accessors, views = editor.json["accessors"], editor.json["bufferViews"]

        def read(index: int, dtype: str, width: int) -> NDArray[Any]:
            start = views[accessors[index]["bufferView"]]["byteOffset"]
            return np.frombuffer(bytes(editor.data), dtype, accessors[index]["count"] * width, start)

        faces = read(primitive["indices"], "<u2", 1).reshape(-1, 3)
        positions = read(primitive["attributes"]["POSITION"], "<f4", 3).reshape(-1, 3)
        far = (positions[faces, 0] > 0.1).all(axis=1)
        second = {**primitive, "attributes": {}}
        used, local = np.unique(faces[far], return_inverse=True)
        for name, index in primitive["attributes"].items():
            width, kind = WIDTHS[accessors[index]["type"]], DTYPES[accessors[index]["componentType"]]
            values = read(index, kind, width).reshape(-1, width)[used]
            bounds = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            second["attributes"][name] = editor.accessor(values, **(bounds if name == "POSITION" else {}))
        primitive["indices"] = editor.accessor(faces[~far].reshape(-1, 1).copy())
        second["indices"] = editor.accessor(local.reshape(-1, 1).astype(np.uint16))
        editor.json["meshes"][0]["primitives"].append(second)

    after = bake_once(edited("wrist", far_part), {**PALM, "strategy": "both_ends", "bumps": 5})
    near, far = after.mesh("wrist")["primitives"]
    assert len(near["targets"]) == len(far["targets"]) == 3
    zeros = {target["POSITION"] for target in far["targets"]}
    assert len(zeros) == 1
    accessor = after.json["accessors"][zeros.pop()]
    assert "bufferView" not in accessor
    assert "sparse" not in accessor
    assert accessor["min"] == accessor["max"] == [0, 0, 0]
    assert all(after.array(target["POSITION"]).any() for target in near["targets"])
    assert_valid(after.path)


@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_min_and_max_are_those_of_the_stored_numbers(name: str, config: str) -> None:
    for mode in ("sparse", "dense"):
        after = bake_config(name, config, accessors=mode)
        bounded = 0
        for index, accessor in enumerate(after.json["accessors"]):
            stored = after.stored(index)
            for key, found in (("min", stored.min(axis=0)), ("max", stored.max(axis=0))):
                if key in accessor:
                    bounded += 1
                    assert np.array_equal(np.array(accessor[key], stored.dtype), found), (index, key)
        for primitive in after.mesh(name)["primitives"]:
            needed = [primitive["attributes"]["POSITION"], *(each["POSITION"] for each in primitive["targets"])]
            assert all({"min", "max"} <= set(after.json["accessors"][index]) for index in needed)
        for clip in after.json["animations"]:
            for sampler in clip["samplers"]:
                assert {"min", "max"} <= set(after.json["accessors"][sampler["input"]])
        assert bounded


@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_sparse_and_dense_hold_the_same_numbers(name: str, config: str) -> None:
    sparse, dense = (bake_config(name, config, accessors=mode) for mode in ("sparse", "dense"))
    assert sparse.path.stat().st_size < dense.path.stat().st_size
    assert not any("sparse" in accessor for accessor in dense.json["accessors"])
    assert all("bufferView" in accessor for accessor in dense.json["accessors"])
    for kind in ("POSITION", "NORMAL"):
        assert np.array_equal(sparse.deltas(name, kind), dense.deltas(name, kind))
    for attribute in sparse.mesh(name)["primitives"][0]["attributes"]:
        assert np.array_equal(sparse.attribute(name, attribute), dense.attribute(name, attribute))
    for clip in sparse.json["animations"]:
        for one, other in zip(sparse.keys(clip["name"], name), dense.keys(clip["name"], name), strict=True):
            assert np.array_equal(one, other)


def test_sparse_targets_hold_only_what_moves() -> None:
    after = bake_config("wrist", "wrist")
    for target in after.mesh("wrist")["primitives"][0]["targets"]:
        accessor = after.json["accessors"][target["POSITION"]]
        assert "bufferView" not in accessor
        assert 0 < accessor["sparse"]["count"] < 0.7 * accessor["count"]
        values = after._elements(accessor["sparse"]["values"], "<f4", 3, accessor["sparse"]["count"])
        assert values.any(axis=1).all()


def test_a_base_without_normals_stays_so() -> None:
    after = bake_once(edited("wrist", without_normals), PALM)
    for primitive in after.mesh("wrist")["primitives"]:
        assert "NORMAL" not in primitive["attributes"]
        assert all(set(target) == {"POSITION"} for target in primitive["targets"])
    with_normals = bake_once("wrist", PALM)
    assert np.array_equal(after.deltas("wrist"), with_normals.deltas("wrist"))
    assert_valid(after.path)


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


TANGENTIAL: Json = {**PALM, "strategy": "both_ends", "bumps": 5}


def test_tangent_targets_keep_tangents_in_the_surface() -> None:
    """Across the bent normals, and where the triangles' own edges carry them, at several weights of all tools."""
    after = bake_once(edited("wrist", with_tangents), TANGENTIAL, BACK, morph_tangents=True)
    tangents, normals = after.attribute("wrist", "TANGENT"), after.attribute("wrist", "NORMAL")
    base, faces = after.attribute("wrist", "POSITION"), after.triangles("wrist")
    deltas = {name: after.deltas("wrist", name) for name in ("POSITION", "NORMAL", "TANGENT")}
    for weights in (np.full(len(deltas["NORMAL"]), 1.0), np.linspace(1.0, 0.0, len(deltas["NORMAL"]))):
        bent = {name: np.tensordot(weights, deltas[name], axes=1) for name in deltas}
        along, outward = tangents[:, :3] + bent["TANGENT"], normals + bent["NORMAL"]
        # New tangents are mixed, and as far from a right angle as before.
        before = np.sum(tangents[:, :3] * normals, axis=1)
        assert np.abs(np.sum(along * outward, axis=1) - before).max() < 1e-5
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        turned = np.linalg.norm(bent["TANGENT"], axis=1) > 0.05
        true = np.zeros_like(along)
        for corners in faces:
            edges, carried = (at[corners[1:]] - at[corners[0]] for at in (base, base + bent["POSITION"]))
            shares = np.linalg.lstsq(edges.T, tangents[corners, :3].T, rcond=None)[0]
            np.add.at(true, corners, (carried.T @ shares).T)
        true /= np.maximum(np.linalg.norm(true, axis=1, keepdims=True), 1e-12)
        angles, unbent = (
            np.degrees(np.arccos(np.clip(np.sum(true * each, axis=1)[turned], -1, 1)))
            for each in (along, tangents[:, :3])
        )
        assert np.median(angles) < 1 < 8 < np.median(unbent)
        assert np.percentile(angles, 99) < 7
    assert_valid(after.path)


def test_tangent_targets_come_on_request_and_where_the_base_has_them() -> None:
    plain = bake_once(edited("wrist", with_tangents), TANGENTIAL)
    asked = bake_once(edited("wrist", with_tangents), TANGENTIAL, morph_tangents=True)
    bare = bake_once("wrist", TANGENTIAL, morph_tangents=True)
    for file, kinds in ((plain, {"POSITION", "NORMAL"}), (asked, {"POSITION", "NORMAL", "TANGENT"})):
        targets = [target for primitive in file.mesh("wrist")["primitives"] for target in primitive["targets"]]
        assert all(set(target) == kinds for target in targets)
    assert bare.path.read_bytes() == bake_once("wrist", TANGENTIAL).path.read_bytes()
    for name in ("POSITION", "NORMAL"):
        assert np.array_equal(plain.deltas("wrist", name), asked.deltas("wrist", name))
    for target in asked.mesh("wrist")["primitives"][0]["targets"]:
        accessor = asked.json["accessors"][target["TANGENT"]]
        assert accessor["type"] == "VEC3"
        assert 0 < accessor["sparse"]["count"] < 0.7 * accessor["count"]


def unnamed_targets(editor: Editor) -> None:
    del editor.json["meshes"][0]["extras"]["targetNames"]


def half_named_targets(editor: Editor) -> None:
    del editor.json["meshes"][0]["extras"]["targetNames"][1:]


@pytest.mark.parametrize("change", [unnamed_targets, half_named_targets])
def test_old_targets_without_names_are_numbered(change: Callable[[Editor], None]) -> None:
    """Names are all or nothing: readers take them by position."""
    after = bake_once(edited("head", change), BROW)
    names = after.mesh("head")["extras"]["targetNames"]
    assert names[1] == "target_1"
    assert names[0] == (
        "target_0" if change is unnamed_targets else Gltf(sample("head")).mesh("head")["extras"]["targetNames"][0]
    )
    assert all(each.startswith("wrinkle_brow_") for each in names[2:])
    assert len(names) == len(after.deltas("head"))
    assert_valid(after.path)


@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_no_target_moves_nothing(name: str, config: str) -> None:
    after = bake_config(name, config)
    for column in wrinkle_columns(after, name):
        assert after.deltas(name)[column].any()


def test_normals_follow_the_wrinkles() -> None:
    """Against area-weighted normals of the wrinkled triangles, in bind space, at several heights."""
    after = bake_once("wrist", PALM)
    base, faces = after.attribute("wrist", "POSITION"), after.triangles("wrist")
    _, weld = np.unique(base, axis=0, return_inverse=True)
    weld = weld.reshape(-1)
    moved = np.linalg.norm(after.deltas("wrist")[0], axis=1) > 1e-4
    stored = after.attribute("wrist", "NORMAL")
    for weight in (0.3, 0.6, 1.0):
        positions = base + weight * after.deltas("wrist")[0]
        a, b, c = (positions[faces[:, k]] for k in range(3))
        sums = np.zeros((weld.max() + 1, 3))
        for k in range(3):
            np.add.at(sums, weld[faces[:, k]], np.cross(b - a, c - a))
        true = (sums / np.linalg.norm(sums, axis=1, keepdims=True))[weld][moved]
        bent = (stored + weight * after.deltas("wrist", "NORMAL")[0])[moved]
        bent = bent / np.linalg.norm(bent, axis=1, keepdims=True)
        angles, unbent = (
            np.degrees(np.arccos(np.clip(np.sum(true * normals, axis=1), -1, 1))) for normals in (bent, stored[moved])
        )
        # The stored normals themselves are some degrees off the area-weighted ones.
        assert np.median(angles) < 1 < 4 < np.median(unbent)
        assert np.percentile(angles, 99) < min(8, np.percentile(unbent, 99) / 2)


# Tracks


@pytest.mark.parametrize("change", [None, sharp_keys, spline_keys])
def test_old_morph_targets_keep_their_values_at_all_times(change: Callable[[Editor], None] | None) -> None:
    asset = sample("head") if change is None else edited("head", change)
    before, after = Gltf(asset), bake_once(asset, BROW)
    times = np.linspace(-0.1, 2.1, 1501)
    if change is sharp_keys:
        # Just before a jump there is a key, one float32 step earlier: between these two nothing is promised.
        jumps = [float(np.nextafter(np.float32(jump), np.float32(0))) for jump in (0.5, 1.25, 2.0)]
        times = np.union1d(times[(np.abs(times[:, None] - [0.5, 1.25, 2.0]) > 1e-6).all(axis=1)], [0.5, 1.25, *jumps])
    was, now = (file.weights("head", "raise_brows", times) for file in (before, after))
    assert np.abs(now[:, :2] - was).max() < 1e-6
    assert now[:, 2:].max() > 0.5
    sampler = after.sampler("raise_brows", after.node("head"), "weights")
    assert sampler is not None
    assert sampler.get("interpolation", "LINEAR") == ("CUBICSPLINE" if change is spline_keys else "LINEAR")
    assert set(before.keys("raise_brows", "head")[0]) <= set(after.keys("raise_brows", "head")[0])
    assert_valid(after.path)


def test_old_targets_keep_their_shapes() -> None:
    before, after = Gltf(sample("head")), bake_once("head", BROW)
    old = len(before.attribute("head", "POSITION"))
    for kind in ("POSITION", "NORMAL"):
        was, now = before.deltas("head", kind), after.deltas("head", kind)
        assert np.array_equal(now[: len(was), :old], was)


@pytest.mark.parametrize("change", [sharp_keys, spline_keys])
def test_new_weights_are_right_on_every_kind_of_track(change: Callable[[Editor], None]) -> None:
    """Replayed from the extras of the same file, at and between keys, jumps included."""
    after = bake_once(edited("head", change), BROW)
    times = np.setdiff1d(np.linspace(0.0, 2.0, 301), [0.5, 1.25, 2.0])
    assert_replayed(after, "head", "raise_brows", times, 0.005 + 1 / 256 + 1e-3)


def assert_replayed(file: Gltf, node: str, clip: str, times: Floats, tolerance: float) -> None:
    """Weights from the tables in the node's extras are those of the tracks, in shares of the greatest."""
    extras = file.json["nodes"][file.node(node)]["extras"]["wrinkle"]
    names = file.mesh(node)["extras"]["targetNames"]
    played = file.weights(node, clip, times)
    for tool in extras["tools"]:
        table, rows = np.array(tool["weights"]), np.array(tool["shortenings"])
        assert table.shape == (len(rows), len(tool["targets"]))
        assert rows[0] == 0
        assert rows[-1] == 1
        assert (np.diff(rows) > 0).all()
        shortenings = 1 - anchor_distances(file, tool, node, clip, times) / tool["rest_length"]
        strength = tool.get("strengths", {}).get(clip, 1.0)
        for column, name in zip(table.T, tool["targets"], strict=True):
            error = np.abs(played[:, names.index(name)] - strength * np.interp(shortenings, rows, column))
            assert error.max() < tolerance, (tool["name"], name, times[error.argmax()])


@pytest.mark.parametrize(
    ("name", "config", "clip"),
    [
        ("wrist", "wrist", "flex"),
        ("wrist", "wrist", "extend"),
        ("head", "head", "raise_brows"),
        ("head", "head", "think"),
        ("trousers", "trousers", "squat"),
        ("trousers", "trousers", "walk"),
    ],
)
def test_extras_are_enough_to_play_the_wrinkles(name: str, config: str, clip: str) -> None:
    after = bake_config(name, config)
    # Between keys tracks are straight and off by up to --max-error; the table is held against the keys. Its own
    # straight lines are right to 1/256, and float32 and eight digits add a little where a height starts.
    times, _ = after.keys(clip, name)
    assert_replayed(after, name, clip, times, 1 / 256 + 1e-3)


def test_extras_of_a_clip_that_was_not_baked() -> None:
    part, whole = bake_config("wrist", "wrist", clips=["extend"]), bake_config("wrist", "wrist")
    assert part.sampler("flex", 0, "weights") is None
    assert described(part) == described(whole)


def test_extras_say_what_else_drives_a_tool() -> None:
    """A rest length that follows a morph target cannot be played from the table alone, unless they say so."""
    tool = {**BROW, "rest_length": {"morph": "browsDown", "full": "130%"}}
    (described,) = bake_once("head", tool).json["nodes"][0]["extras"]["wrinkle"]["tools"]
    assert "browsDown" in json.dumps(
        {key: value for key, value in described.items() if key not in ("origin", "target")}
    )


# What must not change


def test_everything_else_is_as_it_was() -> None:
    asset = edited("wrist", bystanders)
    before, after = Gltf(asset), bake_once(asset, PALM)
    allowed = [
        r"/buffers/0/byteLength",
        r"/accessors/\d+",
        r"/bufferViews/\d+(/byteOffset)?",
        r"/meshes/0/extras",
        r"/meshes/0/primitives/0/targets",
        r"/nodes/0/extras/wrinkle",
        r"/animations/\d+/(samplers|channels)/\d+",
    ]
    slots = set()
    for path in differences(before.json, after.json):
        if match := re.match(r"/(accessors|bufferViews)/(\d+)/", path + "/"):
            slots.add((match[1], int(match[2])))
            continue
        assert any(re.fullmatch(pattern, path) for pattern in allowed), path
    refined = {*before.mesh("wrist")["primitives"][0]["attributes"].values(), 5}
    for index, accessor in enumerate(before.json["accessors"]):
        if index in refined:
            continue
        assert after.json["accessors"][index] == accessor
        assert after.stored(index).tobytes() == before.stored(index).tobytes()
    for kind, index in slots:
        if kind == "accessors":
            assert index in refined or index >= len(before.json["accessors"])
    image = before.json["images"][0]["bufferView"]
    assert after.view_bytes(image) == before.view_bytes(image)
    assert after.json["meshes"][1] == before.json["meshes"][1]
    assert after.json["nodes"][0]["extras"]["rigger"] == "me"


def test_channels_of_joints_keep_their_place_and_bytes() -> None:
    before, after = Gltf(sample("trousers")), bake_config("trousers", "trousers")
    for old, new in zip(before.json["animations"], after.json["animations"], strict=True):
        assert new["channels"][: len(old["channels"])] == old["channels"]
        assert len(new["channels"]) == len(old["channels"]) + 1
        for was, now in zip(old["samplers"], new["samplers"], strict=False):
            for key in ("input", "output"):
                assert before.stored(was[key]).tobytes() == after.stored(now[key]).tobytes()


def test_no_dead_data_is_left() -> None:
    """Every accessor is used, every view is used, and the views cover the buffer but for padding."""
    after = bake_config("head", "head")
    used = {
        channel for mesh in after.json["meshes"] for p in mesh["primitives"] for channel in p["attributes"].values()
    }
    for primitive in after.mesh("head")["primitives"]:
        used |= {primitive["indices"], *(index for target in primitive["targets"] for index in target.values())}
    used |= {skin["inverseBindMatrices"] for skin in after.json["skins"]}
    used |= {s[key] for clip in after.json["animations"] for s in clip["samplers"] for key in ("input", "output")}
    assert used == set(range(len(after.json["accessors"])))
    covered = sum(view["byteLength"] for view in after.json["bufferViews"])
    assert after.json["buffers"][0]["byteLength"] - covered < 4 * (len(after.json["bufferViews"]) + 4)


def test_a_mesh_of_two_nodes_is_cloned() -> None:
    asset = edited("wrist", shared_mesh)
    before, after = Gltf(asset), bake_once(asset, aside(PALM))
    assert after.json["nodes"][0]["mesh"] == 0
    assert after.json["nodes"][after.node("twin")]["mesh"] == 1
    assert after.json["meshes"][0] == before.json["meshes"][0]
    for name in before.mesh("wrist")["primitives"][0]["attributes"]:
        assert np.array_equal(before.attribute("wrist", name), after.attribute("wrist", name))
    assert np.array_equal(before.triangles("wrist"), after.triangles("wrist"))
    assert wrinkle_columns(after, "twin") == [0]
    assert len(after.attribute("twin", "POSITION")) > len(before.attribute("twin", "POSITION"))
    assert after.sampler("flex", after.node("twin"), "weights") is not None
    assert after.sampler("flex", 0, "weights") is None
    assert "extras" not in after.json["nodes"][0]
    assert_valid(after.path)


@pytest.mark.parametrize("change", [shared_mesh, two_meshes])
def test_tools_on_two_nodes(change: Callable[[Editor], None]) -> None:
    after = bake_once(edited("wrist", change), {**PALM, "node": "wrist"}, aside(BACK))
    alone = {node: bake_once("wrist", tool) for node, tool in (("wrist", PALM), ("twin", BACK))}
    for name in ("POSITION", "NORMAL", "TEXCOORD_0"):
        assert np.array_equal(after.attribute("wrist", name), alone["wrist"].attribute("wrist", name))
    assert np.array_equal(after.deltas("wrist"), alone["wrist"].deltas("wrist"))
    times = np.linspace(0, 2, 81)
    for node, clip in (("wrist", "flex"), ("twin", "extend")):
        wanted = alone[node].pose("wrist", clip, times) + np.array([0, 0, node == "twin"])
        moving = alone[node].weights("wrist", clip, times).max()
        assert moving > 0.5
        # One unit aside anchors round differently, and so may the choice of an edge to split: compare extents.
        found = after.pose(node, clip, times)
        for measure in (np.min, np.max):
            assert np.abs(measure(found, axis=1) - measure(wanted, axis=1)).max() < 1e-6
        other = next(each for each in alone if each != node)
        assert after.weights(other, clip, times).max() == 0
    assert_valid(after.path)


def test_weights_in_the_stored_pose_are_zero() -> None:
    for name in ("wrist", "trousers"):
        after = bake_config(name, name)
        assert not after.weights(name, None, [0.0])[:, wrinkle_columns(after, name)].any()


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_both_containers_hold_the_same(ending: str, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    wrinklecli.bake(sample("wrist"), tools, tmp_path / f"out.{ending}")
    made, reference = Gltf(tmp_path / f"out.{ending}"), bake_once("wrist", PALM)
    assert {k: v for k, v in made.json.items() if k not in ("buffers", "bufferViews")} == {
        k: v for k, v in reference.json.items() if k not in ("buffers", "bufferViews")
    }
    for index in range(len(made.json["accessors"])):
        assert np.array_equal(made.stored(index), reference.stored(index))
    assert_valid(tmp_path / f"out.{ending}")
