"""glTF documents under construction: `Asset` gathers accessors, channels and views; .glb files packed and unpacked."""

import base64
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

Json = dict[str, Any]
Array = NDArray[Any]
Interpolation = Literal["LINEAR", "STEP", "CUBICSPLINE"]
COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
MODES = {"triangles": 4, "strip": 5, "fan": 6}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963


@dataclass
class Asset:
    """A glTF document under construction: its JSON and the bytes of its one buffer."""

    gltf: Json = field(default_factory=lambda: {"asset": {"version": "2.0"}})
    data: bytearray = field(default_factory=bytearray)

    def append(self, kind: str, item: Json) -> int:
        """Append to a top-level array, and give the index."""
        items: list[Json] = self.gltf.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes, *, stride: int | None = None, target: int | None = None) -> int:
        """Append bytes at a multiple of 4, and a buffer view on them."""
        self.data += bytes(-len(self.data) % 4)
        view: Json = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        if stride is not None:
            view["byteStride"] = stride
        if target is not None:
            view["target"] = target
        return self.append("bufferViews", view)

    def accessor(
        self,
        values: Any,
        dtype: str = "f4",
        *,
        normalized: bool = False,
        bounds: bool = False,
        target: int | None = None,
        **more: Any,
    ) -> int:
        """Append an accessor of (count,) or (count, components) values with a view of its own."""
        stored = np.asarray(values).astype(f"<{dtype}")
        rows = stored.reshape(len(stored), -1)
        stride = None
        data = rows.tobytes()
        if target == ARRAY_BUFFER and rows.itemsize * rows.shape[1] % 4:
            size = rows.itemsize * rows.shape[1]
            stride = size + -size % 4
            data = np.pad(np.frombuffer(data, np.uint8).reshape(-1, size), ((0, 0), (0, stride - size))).tobytes()
        view = self.view(data, stride=stride, target=target)
        return self._describe(rows, dtype, view, 0, normalized=normalized, bounds=bounds, **more)

    def interleaved(self, *columns: tuple[Any, str, bool]) -> list[int]:
        """Append accessors of (values, dtype, normalized) that share one strided view."""
        parts = [np.asarray(values).astype(f"<{dtype}").reshape(len(values), -1) for values, dtype, _ in columns]
        bytes_ = [np.frombuffer(part.tobytes(), np.uint8).reshape(len(part), -1) for part in parts]
        padded = [np.pad(each, ((0, 0), (0, -each.shape[1] % 4))) for each in bytes_]
        offsets = np.cumsum([0] + [each.shape[1] for each in padded])
        view = self.view(np.concatenate(padded, axis=1).tobytes(), stride=int(offsets[-1]), target=ARRAY_BUFFER)
        return [
            self._describe(part, dtype, view, int(offset), normalized=normalized, bounds=dtype == "f4")
            for part, (_, dtype, normalized), offset in zip(parts, columns, offsets[:-1], strict=True)
        ]

    def sparse(self, values: Any, *, base: bool, index_dtype: str = "u2", bounds: bool = True) -> int:
        """Append float32 values as substitutes: over a dense base of wrong values, or over zeros."""
        stored = np.asarray(values, "<f4")
        changed = np.flatnonzero((stored != 0).any(axis=1))
        index = self.accessor(np.where(stored != 0, 7.0, 0.0)) if base else self.append("accessors", {})
        described: Json = {"componentType": COMPONENTS["f4"], "count": len(stored), "type": TYPES[stored.shape[1]]}
        described["sparse"] = {
            "count": len(changed),
            "indices": {
                "bufferView": self.view(changed.astype(f"<{index_dtype}").tobytes()),
                "componentType": COMPONENTS[index_dtype],
            },
            "values": {"bufferView": self.view(stored[changed].tobytes())},
        }
        if bounds:
            described |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.gltf["accessors"][index] |= described
        return index

    def _describe(
        self, rows: Array, dtype: str, view: int, offset: int, *, normalized: bool, bounds: bool, **more: Any
    ) -> int:
        accessor: Json = {
            "bufferView": view,
            "componentType": COMPONENTS[dtype],
            "count": len(rows),
            "type": TYPES[rows.shape[1]],
            **more,
        }
        if offset:
            accessor["byteOffset"] = offset
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.append("accessors", accessor)

    def channel(
        self,
        animation: Json,
        node: int,
        path: str,
        times: Any,
        values: Any,
        interpolation: Interpolation = "LINEAR",
    ) -> None:
        """Append a channel to an animation; values are (keys, …), or (keys, 3, …) for CUBICSPLINE."""
        width = 1 if path == "weights" else np.shape(values)[-1]
        sampler = {
            "input": self.accessor(times, bounds=bool(np.isfinite(times).all())),
            "output": self.accessor(np.reshape(values, (-1, width))),
            "interpolation": interpolation,
        }
        animation.setdefault("samplers", []).append(sampler)
        target = {"node": node, "path": path}
        animation.setdefault("channels", []).append({"sampler": len(animation["samplers"]) - 1, "target": target})

    def glb(self) -> bytes:
        """The document as a .glb."""
        gltf = dict(self.gltf)
        if self.data:
            gltf["buffers"] = [{"byteLength": len(self.data)}, *gltf.get("buffers", [])[1:]]
        return pack_glb(json.dumps(gltf).encode(), bytes(self.data))

    def write(self, path: Path, *, buffer: Literal["file", "data", "percent", "folder"] = "file") -> Path:
        """Write the document; the ending decides between .glb and .gltf.

        Args:
            path: The file.
            buffer: Of a .gltf: a file beside it, a data URI, a file with a name to be percent-encoded, or a
                file in a folder below.
        """
        if path.suffix == ".glb":
            path.write_bytes(self.glb())
            return path
        name = {"file": f"{path.stem}.bin", "percent": "my büffer #1%.bin", "folder": "data/a.bin", "data": ""}[buffer]
        if name:
            (path.parent / name).parent.mkdir(exist_ok=True)
            (path.parent / name).write_bytes(self.data)
            uri = quote(name)
        else:
            uri = "data:application/gltf-buffer;base64," + base64.b64encode(self.data).decode()
        path.write_text(json.dumps({**self.gltf, "buffers": [{"uri": uri, "byteLength": len(self.data)}]}))
        return path


def pack_glb(text: bytes, binary: bytes = b"") -> bytes:
    """A .glb of a JSON chunk and a binary one, none where it is empty."""
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        binary += bytes(-len(binary) % 4)
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def read_glb(data: bytes) -> tuple[Json, bytes]:
    """The JSON and the binary chunk of a .glb, read without the code under test."""
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def stored(asset: Asset, index: int) -> NDArray[Any]:
    """The numbers of an accessor, to be written to."""
    accessor = asset.gltf["accessors"][index]
    view = asset.gltf["bufferViews"][accessor["bufferView"]]
    dtype = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    size = np.dtype(dtype).itemsize
    stride = view.get("byteStride", width * size)
    return np.ndarray((accessor["count"], width), dtype, asset.data, view["byteOffset"], (stride, size))


def attribute(asset: Asset, mesh: int, name: str) -> NDArray[Any]:
    return stored(asset, asset.gltf["meshes"][mesh]["primitives"][0]["attributes"][name])


def plate(positions: Any, faces: Any) -> Asset:
    """An unskinned mesh with one morph target that does nothing."""
    asset = Asset()
    asset.append(
        "meshes",
        {
            "primitives": [
                {
                    "attributes": {"POSITION": asset.accessor(positions)},
                    "indices": asset.accessor(np.ravel(faces), "u2"),
                    "targets": [{"POSITION": asset.accessor(np.zeros_like(positions, dtype=float))}],
                }
            ]
        },
    )
    asset.append("nodes", {"mesh": 0})
    return asset


def bare_skeleton(gltf: Json) -> None:
    """Leave joints and clips, as Mixamo gives them: neither mesh nor skin; the nodes in another order."""
    for key in ("meshes", "skins", "materials"):
        gltf.pop(key, None)
    count = len(gltf["nodes"])
    turned = list(reversed(range(count)))
    gltf["nodes"] = [gltf["nodes"][k] for k in turned]
    gone = next(k for k, node in enumerate(gltf["nodes"]) if "mesh" in node)
    del gltf["nodes"][gone]["mesh"], gltf["nodes"][gone]["skin"]
    gltf["nodes"][gone]["name"] = "leftover"
    for node in gltf["nodes"]:
        if "children" in node:
            node["children"] = [turned.index(child) for child in node["children"]]
    gltf["scenes"] = [{"nodes": [turned.index(node) for node in gltf["scenes"][0]["nodes"]]}]
    for animation in gltf["animations"]:
        for channel in animation["channels"]:
            channel["target"]["node"] = turned.index(channel["target"]["node"])
