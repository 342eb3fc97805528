"""glTF files read and played by the specification alone, without any code of wrinkle's: what a bake is held to."""

import json
import re
import struct
from base64 import b64decode
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Vertices = NDArray[np.bool_] | NDArray[np.int64] | slice
ALL = slice(None)
Json = dict[str, Any]
DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DEFAULTS = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}


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

    def blended(
        self, node: str | int, clip: str | int | None, times: Sequence[float] | Floats, vertices: Vertices = ALL
    ) -> Floats:
        """(3, 4, times, vertices) each vertex's matrix from bind to world space, a number of all after another."""
        index = self.node(node)
        world = self.matrices(clip, times)
        carrier = self.json["nodes"][index]
        count = len(self.attribute(index, "POSITION"))
        if "skin" not in carrier:
            rows = world[:, index, :3].transpose(1, 2, 0)[..., None]
            return np.broadcast_to(rows, (3, 4, len(times), count))[..., vertices]
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
        return palette[:, :, :3].transpose(2, 3, 0, 1) @ dense[vertices].T

    def _morphed(
        self,
        node: str | int,
        clip: str | int | None,
        times: Sequence[float] | Floats,
        name: str,
        vertices: Vertices,
        without: Sequence[int],
    ) -> Floats:
        """(times, vertices, 3) of an attribute in bind space."""
        weights = self.weights(node, clip, times)
        weights[:, list(without)] = 0.0
        return self.attribute(node, name)[vertices] + np.tensordot(
            weights, self.deltas(node, name)[:, vertices], axes=1
        )

    def pose(
        self,
        node: str | int,
        clip: str | int | None,
        times: Sequence[float] | Floats,
        vertices: Vertices = ALL,
        *,
        without: Sequence[int] = (),
    ) -> Floats:
        """(times, vertices, 3) world space, without some of the morph targets."""
        morphed = self._morphed(node, clip, times, "POSITION", vertices, without)
        matrices = self.blended(node, clip, times, vertices)
        return _times(matrices, morphed) + np.moveaxis(matrices[:, 3], 0, 2)

    def normals(
        self,
        node: str | int,
        clip: str | int | None,
        times: Sequence[float] | Floats,
        vertices: Vertices = ALL,
        *,
        without: Sequence[int] = (),
    ) -> Floats:
        """(times, vertices, 3) unit, world space, without some of the morph targets."""
        bent = self._morphed(node, clip, times, "NORMAL", vertices, without)
        # Times the matrix of cofactors, which is the inverse transposed but for the determinant.
        a, b, c = np.moveaxis(self.blended(node, clip, times, vertices)[:, :3], 1, 0)
        cofactors = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
        turned = _times(cofactors, bent) * np.sign(np.sum(a * cofactors[:, 0], axis=0))[..., None]
        return turned / np.linalg.norm(turned, axis=2, keepdims=True)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """(times, vertices, 3) each vector times its matrix of (3, 3 or 4, times, vertices): faster than einsum."""
    x, y, z = np.moveaxis(vectors, 2, 0)
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrices], axis=2)


def _cross(a: Floats, b: Floats) -> Floats:
    """(3, …) cross products."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


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


def wrinkle_columns(file: Gltf, node: str | int) -> list[int]:
    names = file.mesh(node)["extras"]["targetNames"]
    return [index for index, name in enumerate(names) if name.startswith("wrinkle_")]


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
    """(times,) summed distances of a tool's neighbouring anchors by the node's extras."""
    anchors = tool["anchors"] if "anchors" in tool else [tool["origin"], tool["target"]]
    places = np.stack([anchor_places(file, anchor, node, clip, times) for anchor in anchors])
    return np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0)


def described(file: Gltf) -> list[Json]:
    """The nodes, but for the number of the buffer view with the original, which there are fewer or more before."""
    nodes: list[Json] = json.loads(json.dumps(file.json["nodes"]))
    for node in nodes:
        if "wrinkle" in node.get("extras", {}):
            assert node["extras"]["wrinkle"].pop("original") == len(file.json["bufferViews"]) - 1
    return nodes


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
