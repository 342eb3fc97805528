"""glTF documents: .gltf and .glb bytes in, the same JSON with patched and appended data out.

The JSON is kept as it was parsed, every key in its order, and only ever patched; objects that we add
are built with pygltflib's types. (Round-tripping the source through pygltflib would lose unknown keys,
`Node.weights` and more.)

Source: glTF 2.0 specification, §3.6 (binary data storage), §4 (GLB), §5.1 (accessors);
    EXT_meshopt_compression, KHR_meshopt_compression and KHR_draco_mesh_compression.
"""

import base64
import binascii
import copy
import hashlib
import json
import math
import os
import re
import shutil
import struct
import sys
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote, unquote

import numpy as np
import pygltflib
from numpy.typing import NDArray

from wrinklecli import draco, meshopt
from wrinklecli.errors import AssetError, BakeError, listed

Json = dict[str, Any]
Array = NDArray[Any]

TRIANGLES: int = pygltflib.TRIANGLES
TRIANGLE_STRIP: int = pygltflib.TRIANGLE_STRIP
TRIANGLE_FAN: int = pygltflib.TRIANGLE_FAN
VERTEX_DATA: int = pygltflib.ARRAY_BUFFER
INDEX_DATA: int = pygltflib.ELEMENT_ARRAY_BUFFER

_COMPONENT_DTYPES: dict[Any, np.dtype[Any]] = {
    pygltflib.BYTE: np.dtype("<i1"),
    pygltflib.UNSIGNED_BYTE: np.dtype("<u1"),
    pygltflib.SHORT: np.dtype("<i2"),
    pygltflib.UNSIGNED_SHORT: np.dtype("<u2"),
    pygltflib.UNSIGNED_INT: np.dtype("<u4"),
    pygltflib.FLOAT: np.dtype("<f4"),
}
_COMPONENT_TYPES = {dtype: number for number, dtype in _COMPONENT_DTYPES.items()}
_TYPE_SIZES: dict[Any, int] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_SIZE_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

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
            "primitives": [{"attributes": {"*": int}, "indices": int, "mode": int, "targets": [{"*": int}]}],
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
    "bufferViews": [{"buffer": int, "byteOffset": int, "byteLength": int, "byteStride": int}],
    "buffers": [{"uri": str, "byteLength": int}],
    "images": [{"uri": str, "bufferView": int, "mimeType": str}],
}
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
_SHAPE["bufferViews"][0]["extensions"] = dict.fromkeys(meshopt.EXTENSIONS, _MESHOPT_SHAPE)
_SHAPE["buffers"][0]["extensions"] = {name: {"fallback": bool} for name in meshopt.EXTENSIONS}
_SHAPE["meshes"][0]["primitives"][0]["extensions"] = {draco.EXTENSION: _DRACO_SHAPE}
_KINDS = {int: "a whole number of 0 or more", float: "a number", str: "text", bool: "true or false"}

# Compressions that are decoded where needed; with the next, all extensions of geometry that we understand.
_COMPRESSIONS = (draco.EXTENSION, *meshopt.EXTENSIONS)
_GEOMETRY_EXTENSIONS = (*_COMPRESSIONS, "KHR_mesh_quantization", "EXT_mesh_features")
# What names of extensions that change geometry, or how it is stored, have in them, and what those of others have.
_GEOMETRY_WORDS = re.compile(
    "mesh|primitive|geometry|vertex|skin|morph|subdiv|splat|curve|compress|accessor|buffer", re.IGNORECASE
)
_APPEARANCE_WORDS = re.compile("texture|material|image|light", re.IGNORECASE)

_GLB_MAGIC = b"glTF"
_JSON_CHUNK = b"JSON"
_BIN_CHUNK = b"BIN\0"
_GLB_LIMIT = 2**32 - 1  # bytes; the header's length is 32 bits
_DEPTH_LIMIT = 256  # levels of JSON; copying and writing recurse
_SHOWN = 40  # characters of a found value that a message repeats
_SPOOL_BYTES = 2**26
_ALIGNMENT = 4  # bytes; the largest component is 4 bytes, and GLB chunks are padded to it

# An accessor may claim any count; nothing real has more elements than this.
_COUNT_LIMIT = 2**26
# Numbers of 8 bytes that a file may ask for without storing them (zeros, morph deltas, skin weights of all joints):
# any file so many, and more for each byte of its buffers. Nothing real comes near; 200 bytes cannot ask for gigabytes.
_FREE_NUMBERS = 2**22
_NUMBERS_PER_BYTE = 256
_NUMBERS_LIMIT = 2**28


@dataclass(frozen=True)
class Document:
    """A glTF asset as it was read: JSON as parsed, buffers as stored.

    Attributes:
        path: The file, as the user typed it; messages begin with it.
        gltf: The JSON; never written to.
        buffers: One bytes-like object for each of the JSON's `buffers`; an empty one for a placeholder, whose views
            are all compressed into other buffers.
        files: Every file that was read, the asset first, as typed or joined to its folder.
        allow_external: Whether buffers and images may lie outside the asset's folder.
    """

    path: str
    gltf: Json
    buffers: tuple[memoryview, ...]
    files: tuple[str, ...]
    allow_external: bool = False

    def where(self, *pointer: str | int) -> str:
        """The place of a JSON value for messages: `hand.glb#/meshes/0`."""
        return f"{self.path}#/" + "/".join(str(part) for part in pointer)

    def items(self, kind: str) -> list[Json]:
        """The JSON objects of a top-level array, none where the document has no such array."""
        found: list[Json] = self.gltf.get(kind, [])
        return found

    def item(self, kind: str, index: object, *, user: str) -> Json:
        """One object of a top-level array.

        Raises:
            AssetError: The index, used by `user` (a place from `where`), is out of range or no integer.
        """
        found = self.items(kind)
        if not isinstance(index, int) or not 0 <= index < len(found):
            raise AssetError(f"refers to {kind}[{index}], but there are {len(found)}", where=user)
        return found[index]

    def accessor(self, index: int, *, user: str | None = None) -> Array:
        """The elements of an accessor, sparse substitutions applied.

        Args:
            index: Into `accessors`.
            user: What refers to it, for messages.

        Returns:
            (count, components), or (count,) for SCALAR: float64 where the components are floats or
            normalised integers, otherwise the stored integers.

        Raises:
            AssetError: The accessor, or a view or buffer behind it, is malformed or out of range.

        Source: glTF 2.0 §3.6.2 and, for normalised integers, §3.11. Differs: MAT2 and MAT3 of one- and
            two-byte components, whose columns are padded, are refused; no geometry or animation uses them.
        """
        key = (index,)
        if key not in self._decoded:
            accessor = self.item("accessors", index, user=user or self.where("accessors", index))
            self._decoded[key] = self._decode(accessor, index)
        return self._decoded[key]

    @cached_property
    def _decoded(self) -> dict[tuple[int], Array]:
        return {}

    def refuse_excess(self, numbers: int, what: str, *, where: str) -> None:
        """Check that the file is large enough to ask for memory, before it is taken.

        Args:
            numbers: That `what` takes, in all.
            what: For the message.
            where: In the document.

        Raises:
            AssetError: It is not.
        """
        stored = sum(len(each) for each in self.buffers)
        most = min(_NUMBERS_LIMIT, max(_FREE_NUMBERS, _NUMBERS_PER_BYTE * stored))
        if numbers > most:
            raise AssetError(
                f"{what} are {numbers} numbers; a file of {stored} bytes of data may have {most}", where=where
            )

    def stored(self, index: int) -> Array:
        """(count, components) elements of an accessor as they are stored, sparse substitutions applied.

        Raises:
            AssetError: The accessor, or a view or buffer behind it, is malformed or out of range.
        """
        return self._stored(self.items("accessors")[index], index)

    def stored_dtype(self, index: int) -> np.dtype[Any]:
        """The component type that an accessor is stored in."""
        return _element(self.items("accessors")[index], self.where("accessors", index))[0]

    def is_draco(self, index: int) -> bool:
        """Whether an accessor's data is in a Draco stream."""
        return index in self._draco_sources and "bufferView" not in self.items("accessors")[index]

    @cached_property
    def _draco_sources(self) -> dict[int, tuple[Json, str | None]]:
        """Accessors of primitives that Draco compressed: the extension, and the attribute's name (indices: None)."""
        sources: dict[int, tuple[Json, str | None]] = {}
        count = len(self.items("accessors"))
        for primitive in _draco_primitives(self.gltf):
            extension = primitive["extensions"][draco.EXTENSION]
            for name, index in primitive.get("attributes", {}).items():
                if name in extension.get("attributes", {}) and index < count:
                    sources.setdefault(index, (extension, name))
            if primitive.get("indices", count) < count:
                sources.setdefault(primitive["indices"], (extension, None))
        return sources

    @cached_property
    def _draco_meshes(self) -> dict[int, draco.DracoMesh]:
        return {}

    @cached_property
    def _decompressed(self) -> dict[int, memoryview]:
        return {}

    def _draco_elements(self, index: int, dtype: np.dtype[Any], size: int, where: str) -> Array:
        """(count, size) elements of an accessor of a primitive that Draco compressed."""
        extension, name = self._draco_sources[index]
        view = extension.get("bufferView", -1)
        if view not in self._draco_meshes:
            self._draco_meshes[view] = draco.decode(
                self.view(view, user=where), where=self.where("bufferViews", str(view))
            )
        mesh = self._draco_meshes[view]
        values = mesh.indices[:, None] if name is None else mesh.attributes.get(extension["attributes"][name])
        if values is None or values.shape[1] != size or not len(values):
            raise AssetError(f"the Draco stream has no {name or 'indices'} of {size} components", where=where)
        if name is not None and name.startswith("WEIGHTS_") and dtype.kind == "f":
            # Rounded one by one, they add up to 1 no longer, as glTF 2.0 §3.7.3.3 asks.
            keys = [key for each, key in extension["attributes"].items() if each.startswith("WEIGHTS_")]
            sets = [mesh.attributes[key] for key in keys if key in mesh.attributes]
            sums = np.sum([weights.sum(axis=1, dtype=np.float64) for weights in sets], axis=0)
            values = (values / np.where(sums > 0, sums, 1.0)[:, None]).astype(values.dtype)
        if values.dtype.kind in "iu" and dtype.kind in "iu":
            limits = np.iinfo(dtype)
            if values.min() < limits.min or values.max() > limits.max:
                raise AssetError(f"the Draco stream holds numbers that do not fit {dtype.name}", where=where)
        elif values.dtype != dtype:
            raise AssetError(f"the Draco stream holds {values.dtype.name}, not {dtype.name}", where=where)
        return values.astype(dtype)

    def _decode(self, accessor: Json, index: int) -> Array:
        elements = self._stored(accessor, index)
        values: Array = elements
        if elements.dtype.kind == "f":
            values = elements.astype(np.float64)
        elif accessor.get("normalized"):
            limit = np.iinfo(elements.dtype).max
            values = np.maximum(elements / limit, -1.0)
        values.flags.writeable = False
        return values[:, 0] if accessor["type"] == "SCALAR" else values

    def _stored(self, accessor: Json, index: int) -> Array:
        where = self.where("accessors", index)
        dtype, size = _element(accessor, where)
        count = _whole(accessor, "count", where, least=1, most=_COUNT_LIMIT)
        if "bufferView" in accessor:
            elements = self._view_elements(accessor, "bufferView", dtype, size, count, where).copy()
        elif index in self._draco_sources:
            elements = self._draco_elements(index, dtype, size, where)
        else:
            self.refuse_excess(count * size, f"{count} elements that are not stored", where=where)
            elements = np.zeros((count, size), dtype)
        if (sparse := accessor.get("sparse")) is not None:
            if not isinstance(sparse, dict):
                raise AssetError("sparse must be an object", where=where)
            self._substitute(elements, sparse, dtype, size, where)
        return elements

    def _substitute(self, elements: Array, sparse: Json, dtype: np.dtype[Any], size: int, where: str) -> None:
        """Overwrite elements by those of a sparse accessor, in place."""
        count = _whole(sparse, "count", where, least=1, most=len(elements))
        indices_part, values_part = sparse.get("indices"), sparse.get("values")
        if not isinstance(indices_part, dict) or not isinstance(values_part, dict):
            raise AssetError("sparse needs indices and values", where=where)
        index_dtype = _COMPONENT_DTYPES.get(indices_part.get("componentType"))
        if index_dtype is None or index_dtype.kind != "u":
            raise AssetError("sparse indices must be unsigned integers", where=where)
        indices = self._view_elements(indices_part, "bufferView", index_dtype, 1, count, where)[:, 0]
        if int(indices.max()) >= len(elements):
            raise AssetError(f"sparse index {indices.max()}, but the count is {len(elements)}", where=where)
        elements[indices] = self._view_elements(values_part, "bufferView", dtype, size, count, where)

    def _view_elements(self, source: Json, key: str, dtype: np.dtype[Any], size: int, count: int, where: str) -> Array:
        """(count, size) stored elements of a buffer view, not copied."""
        view_index = source.get(key)
        data = self.view(view_index, user=where)
        view, view_where = self.items("bufferViews")[source[key]], self.where("bufferViews", str(view_index))
        element = dtype.itemsize * size
        stride = _whole(view, "byteStride", view_where, default=element, least=element, most=252 + element)
        offset = _whole(source, "byteOffset", where, default=0)
        if offset + (count - 1) * stride + element > len(data):
            raise AssetError(
                f"{count} elements of {stride} bytes from byte {offset} do not fit in"
                f" bufferViews[{view_index}] of {len(data)} bytes",
                where=where,
            )
        return np.ndarray((count, size), dtype, data, offset, (stride, dtype.itemsize))

    def view(self, index: Any, *, user: str | None = None) -> memoryview:
        """The bytes of a buffer view, decompressed.

        Raises:
            AssetError: The view is malformed, or `user` (a place from `where`) refers to none.
        """
        where = self.where("bufferViews", str(index))
        view = self.item("bufferViews", index, user=user or where)
        length = _whole(view, "byteLength", where, least=1)
        found = next((each for each in _view_parts(view) if each is not view), None)
        if found is None:
            return self._span(view, where)
        if index not in self._decompressed:
            count, stride = (_whole(found, key, where, least=1, most=_COUNT_LIMIT) for key in ("count", "byteStride"))
            if count * stride != length:
                raise AssetError(f"byteLength is {length}, but {count} · {stride} bytes are compressed", where=where)
            decoded = meshopt.decode(
                self._span(found, where),
                count=count,
                stride=stride,
                mode=found.get("mode", ""),
                filter_name=found.get("filter", "NONE"),
                where=where,
            )
            self._decompressed[index] = memoryview(decoded)
        return self._decompressed[index]

    def _span(self, source: Json, where: str) -> memoryview:
        """The bytes of a buffer that a view, or the extension that compresses it, shows."""
        self.item("buffers", source.get("buffer"), user=where)
        data = self.buffers[source["buffer"]]
        start = _whole(source, "byteOffset", where, default=0)
        length = _whole(source, "byteLength", where, least=1)
        if start + length > len(data):
            raise AssetError(
                f"bytes {start} to {start + length} of a buffer of {len(data)}; is the file truncated?", where=where
            )
        return data[start : start + length]


def _element(accessor: Json, where: str) -> tuple[np.dtype[Any], int]:
    """Component dtype and component count of an accessor."""
    dtype = _COMPONENT_DTYPES.get(accessor.get("componentType", 0))
    size = _TYPE_SIZES.get(accessor.get("type", ""))
    if dtype is None or size is None:
        kind = f"{accessor.get('type')!r} of componentType {accessor.get('componentType')!r}"
        raise AssetError(f"{kind} is not an accessor type of glTF 2.0", where=where)
    if accessor["type"] in ("MAT2", "MAT3") and dtype.itemsize < 4:
        raise AssetError("matrices of small integers are not supported", where=where)
    return dtype, size


def _whole(source: Json, key: str, where: str, *, default: int | None = None, least: int = 0, most: int = 2**53) -> int:
    """A non-negative integer property."""
    value = source.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise AssetError(f"{key} is {value!r}, not an integer of {least} to {most}", where=where)
    return value


def read_document(path: str | os.PathLike[str], *, allow_external: bool = False) -> Document:
    """Read a .glb or .gltf file and every buffer of it.

    Args:
        path: The file; told apart by its first bytes, not its name.
        allow_external: Let buffers and images lie outside the asset's folder, where an asset from elsewhere could
            name any file of this machine.

    Raises:
        AssetError: A file is missing, truncated or malformed, or lies outside the asset's folder, itself or where a
            link leads to.
    """
    name = os.fspath(path)
    data = _read_file(name)
    if bytes(data[:4]) == _GLB_MAGIC:
        json_bytes, binary = _split_glb(data, name)
    else:
        json_bytes, binary = data, None
    gltf = _parse_json(bytes(json_bytes), name)
    files = [name]
    document = Document(name, gltf, (), ())
    _check_asset(document)
    buffers = []
    for index, buffer in enumerate(document.items("buffers")):
        where = document.where("buffers", index)
        uri = buffer.get("uri")
        if uri is None and index == 0 and binary is not None:
            content = binary
        elif isinstance(uri, str):
            content, file = _read_uri(uri, name, where, allow_external=allow_external)
            files += [file] if file else []
        elif uri is None and _is_placeholder(document, index):
            buffers.append(memoryview(b""))
            continue
        else:
            raise AssetError("has no data: no uri, and no binary chunk of a .glb", where=where)
        length = _whole(buffer, "byteLength", where, least=1)
        if len(content) < length:
            raise AssetError(f"has {len(content)} bytes of {length}; is the file truncated?", where=where)
        buffers.append(content[:length])
    return Document(name, gltf, tuple(buffers), tuple(files), allow_external)


def _check_asset(document: Document) -> None:
    _check_shape(document, document.gltf, _SHAPE, ())
    version = document.gltf.get("asset", {}).get("version")
    if not isinstance(version, str) or not version.startswith("2."):
        raise AssetError(f"asset.version is {version!r}; glTF 2.0 is read", where=document.where("asset", "version"))
    for index, name in enumerate(document.gltf.get("extensionsRequired", [])):
        about_geometry = _GEOMETRY_WORDS.search(name) and not _APPEARANCE_WORDS.search(name)
        if about_geometry and name not in _GEOMETRY_EXTENSIONS:
            raise AssetError(
                f"{name} changes geometry, but is not understood; understood are {listed(_GEOMETRY_EXTENSIONS)}",
                where=document.where("extensionsRequired", index),
            )


def _is_placeholder(document: Document, buffer: int) -> bool:
    """Whether a buffer may go without data: all views that show it are compressed into other buffers."""
    views = [(view, list(_view_parts(view))) for view in document.items("bufferViews")]
    shown = [parts for view, parts in views if view.get("buffer") == buffer]
    read = any(part.get("buffer") == buffer for _, parts in views for part in parts[1:])
    return not read and bool(shown) and all(len(parts) > 1 for parts in shown)


def _check_shape(document: Document, value: Any, shape: Any, pointer: tuple[str | int, ...]) -> None:
    """Check that the JSON that we read has the types of the specification; what we do not read may be anything."""
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
        raise AssetError(f"is {repr(value)[:_SHOWN]}, not {kind}", where=document.where(*pointer))
    for key, child, inner in children:
        if inner is not None:
            _check_shape(document, child, inner, (*pointer, key))


def _read_file(path: str, *, where: str = "") -> memoryview:
    try:
        return memoryview(Path(path).read_bytes())
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise AssetError(f"cannot be read: {reason or error}", where=where or path) from error


def _split_glb(data: memoryview, name: str) -> tuple[memoryview, memoryview | None]:
    """The JSON and BIN chunks of a GLB container (glTF 2.0 §4.4)."""
    if len(data) < 12:
        raise AssetError("truncated: shorter than a .glb header", where=name)
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise AssetError(f"is a .glb of version {version}; version 2 is read", where=name)
    if length > len(data):
        raise AssetError(f"truncated: {len(data)} bytes of {length}", where=name)
    chunks: dict[bytes, memoryview] = {}
    offset = 12
    while offset + 8 <= length:
        (size,) = struct.unpack_from("<I", data, offset)
        kind = bytes(data[offset + 4 : offset + 8])
        if offset + 8 + size > length:
            raise AssetError(f"truncated: the chunk at byte {offset} ends after the file", where=name)
        chunks.setdefault(kind, data[offset + 8 : offset + 8 + size])
        offset += 8 + size
    if _JSON_CHUNK not in chunks:
        raise AssetError("has no JSON chunk", where=name)
    return chunks[_JSON_CHUNK], chunks.get(_BIN_CHUNK)


def _parse_json(data: bytes, name: str) -> Json:
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


def _read_uri(uri: str, asset: str, where: str, *, allow_external: bool) -> tuple[memoryview, str | None]:
    """The bytes behind a URI, and the file they came from (none for a data URI)."""
    if uri.startswith("data:"):
        head, comma, body = uri.partition(",")
        try:
            if not comma or not head.endswith(";base64"):
                raise ValueError("not base64")
            return memoryview(base64.b64decode(body, validate=True)), None
        except (ValueError, binascii.Error) as error:
            raise AssetError(f"the data URI is malformed: {error}", where=where) from error
    file = _local_file(uri, asset, where, allow_external=allow_external)
    if os.path.exists(file) and not (os.path.isfile(file) or os.path.isdir(file)):  # a pipe would be waited for
        raise AssetError("cannot be read: not a regular file", where=where)
    return _read_file(file, where=where), file


def _local_file(uri: str, asset: str, where: str, *, allow_external: bool) -> str:
    """The file that a URI without a scheme names; below the asset's folder, unless others are allowed."""
    folder = os.path.dirname(asset)
    relative = unquote(uri)
    file = os.path.join(folder, relative)
    inside = os.path.realpath(folder or ".")
    if ":" in relative.split("/")[0] or "\0" in relative:
        raise AssetError(f"uri {uri[:80]!r} is not a file below the asset's folder", where=where)
    if (_leaves(uri) or os.path.commonpath([inside, os.path.realpath(file)]) != inside) and not allow_external:
        hint = "others are read with --allow-external"
        raise AssetError(f"uri {uri[:80]!r} is not a file below the asset's folder; {hint}", where=where)
    return file


def _leaves(uri: str) -> bool:
    """Whether a URI's path leaves the folder that it is relative to."""
    relative = unquote(uri)
    return os.path.isabs(relative) or os.path.normpath(relative).split(os.sep)[0] == os.pardir


class Draft:
    """A document being changed: the JSON patched in place, data appended.

    Everything that is not set here stays as it was. An accessor whose last reference is replaced gives its
    index (and its buffer view's) to the new data, and its bytes leave the file: indices elsewhere keep their
    meaning, and no dead data is left behind.

    Attributes:
        source: What was read.
        gltf: The JSON to patch; a deep copy.
    """

    def __init__(self, source: Document) -> None:
        self.source = source
        self.gltf: Json = copy.deepcopy(source.gltf)
        # New data goes to disk when it outgrows memory: per-frame geometry may be gigabytes.
        self._data: IO[bytes] = tempfile.SpooledTemporaryFile(max_size=_SPOOL_BYTES)  # noqa: SIM115
        weakref.finalize(self, self._data.close)
        self._data_size = 0
        self._new_views: set[int] = set()
        self._dead_views: list[int] = []
        self._free_views: list[int] = []
        self._accessor_uses = Counter(_accessor_references(self.gltf))
        self._view_uses = Counter(_view_references(self.gltf))
        self._shared: dict[tuple[Any, ...], int] = {}
        # An extension that we do not know may refer to accessors and views; whatever it could mean is kept.
        foreign = set(_extension_integers(self.gltf))
        self._accessor_uses.update(foreign)
        self._view_uses.update(foreign)

    def add(
        self,
        values: Array,
        *,
        target: int | None = None,
        normalized: bool = False,
        bounds: bool = False,
        replaces: int | None = None,
    ) -> int:
        """Add an accessor and give its index.

        Args:
            values: (count, components) or (count,), in the dtype to store: float32 or an integer.
            target: VERTEX_DATA or INDEX_DATA; none for animation data and matrices.
            normalized: The integers stand for [0, 1] or [-1, 1].
            bounds: Write `min` and `max`.
            replaces: An accessor to which the caller is about to drop one reference.
        """
        values = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("<"), copy=False))
        stored = values if values.ndim == 2 else values[:, None]
        accessor = _plain(
            pygltflib.Accessor(
                componentType=_COMPONENT_TYPES[values.dtype],
                count=len(values),
                type=_SIZE_TYPES[stored.shape[1]],
            )
        )
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = _json_numbers(stored.min(axis=0))
            accessor["max"] = _json_numbers(stored.max(axis=0))
        slot = self._release(replaces)
        # Elements of vertex attributes begin at multiples of 4 bytes (glTF 2.0 §3.6.2.4).
        padding = -stored.itemsize * stored.shape[1] % _ALIGNMENT if target == VERTEX_DATA else 0
        if padding:
            rows = np.frombuffer(values.tobytes(), np.uint8).reshape(len(values), -1)
            data = np.pad(rows, ((0, 0), (0, padding))).tobytes()
            stride = rows.shape[1] + padding
        else:
            data, stride = values.tobytes(), None
        accessor = {"bufferView": self._add_view(data, target=target, stride=stride), **accessor}
        return self._place(accessor, slot)

    def add_sparse(
        self,
        indices: Array,
        values: Array,
        *,
        count: int,
        bounds: bool = False,
        stored: bool = False,
        replaces: int | None = None,
    ) -> int:
        """Add an accessor of float32 vectors that are zero but at some indices.

        Accessors that are zero throughout are shared: one for each count and type.

        Args:
            indices: (changed,) strictly rising.
            values: (changed, components) float32.
            count: Of the whole accessor.
            bounds: Write `min` and `max`.
            stored: Store an accessor that is zero throughout, for readers that need its bytes.
            replaces: An accessor to which the caller is about to drop one reference.

        Source: glTF 2.0 §3.6.2.3.
        """
        accessor = _plain(
            pygltflib.Accessor(componentType=pygltflib.FLOAT, count=count, type=_SIZE_TYPES[values.shape[1]])
        )
        if bounds:
            low, high = np.zeros(values.shape[1]), np.zeros(values.shape[1])
            if len(values):
                low, high = values.min(axis=0), values.max(axis=0)
                if len(values) < count:
                    low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
            accessor["min"], accessor["max"] = _json_numbers(low), _json_numbers(high)
        if not len(indices):
            key = (count, accessor["type"], bounds)
            if key not in self._shared:
                zeros = np.zeros((count, values.shape[1]), np.float32)
                self._shared[key] = (
                    self.add(zeros, target=VERTEX_DATA, bounds=bounds) if stored else self._place(accessor, None)
                )
            return self._shared[key]
        slot = self._release(replaces)
        index_dtype = index_type(int(indices[-1]) + 1, smallest=np.uint8)
        accessor["sparse"] = {
            "count": len(indices),
            "indices": {
                "bufferView": self._add_view(indices.astype(index_dtype).tobytes()),
                "componentType": _COMPONENT_TYPES[index_dtype],
            },
            "values": {"bufferView": self._add_view(values.astype("<f4").tobytes())},
        }
        return self._place(accessor, slot)

    def clone_mesh(self, mesh: int) -> int:
        """Append a copy of a mesh, which shares its accessors, and give its index."""
        copied = copy.deepcopy(self.gltf["meshes"][mesh])
        self._accessor_uses.update(_accessor_references({"meshes": [copied]}))
        self._view_uses.update(_draco_views({"meshes": [copied]}))
        self.gltf["meshes"].append(copied)
        return len(self.gltf["meshes"]) - 1

    def unpack(self, primitive: Json) -> None:
        """Give a primitive of the draft that Draco compressed plain accessors, where it has not got them yet."""
        extension = primitive.get("extensions", {}).pop(draco.EXTENSION, None)
        if extension is None:
            return
        if not primitive["extensions"]:
            del primitive["extensions"]
        attributes = primitive["attributes"]
        users = [(attributes, name, VERTEX_DATA) for name in attributes]
        users += [(primitive, "indices", INDEX_DATA)] if "indices" in primitive else []
        for owner, key, target in users:
            index = owner[key]
            accessor = self.gltf["accessors"][index]
            if "bufferView" not in accessor and self.source.is_draco(index):
                owner[key] = self.add(
                    self.source.stored(index),
                    target=target,
                    normalized=accessor.get("normalized", False),
                    bounds="min" in accessor,
                    replaces=index,
                )
        if extension.get("bufferView", len(self.gltf["bufferViews"])) < len(self.gltf["bufferViews"]):
            self._release_view(extension["bufferView"])

    def document(self) -> Document:
        """The draft as a reader will see it, in memory: the source's buffers and one of new data."""
        buffers = [*self.source.items("buffers"), {"byteLength": self._data_size}]
        self._data.seek(0)
        data = memoryview(self._data.read())
        return Document(self.source.path, self.gltf | {"buffers": buffers}, (*self.source.buffers, data), ())

    def write(self, path: str | os.PathLike[str]) -> int:
        """Write .glb or .gltf, as the path's ending says, replacing the file only by a complete one.

        A .glb embeds every buffer. A .gltf keeps embedded and relative buffers as they are and writes one
        more file, `STEM-<hash>.bin`, before its JSON. Images with relative URIs are copied beside an OUT in
        another folder (.gltf) or embedded (.glb).

        Returns:
            The bytes written.

        Raises:
            BakeError: The disk is full, the folder is missing or read-only, or a .glb passes 4 GiB.
        """
        name = os.fspath(path)
        if not name.lower().endswith(".gltf"):
            return self._write_glb(name)
        made: list[str] = []
        try:
            return self._write_gltf(name, made)
        except BaseException:
            # What lies beside an OUT that is not to be would be rubbish.
            for other in reversed(made):
                with suppress(OSError):
                    os.rmdir(other) if os.path.isdir(other) else os.unlink(other)
            raise

    def _place(self, accessor: Json, slot: int | None) -> int:
        accessors = self.gltf.setdefault("accessors", [])
        if slot is None:
            accessors.append(accessor)
            return len(accessors) - 1
        kept = {key: accessors[slot][key] for key in ("name", "extras") if key in accessors[slot]}
        accessors[slot] = accessor | kept
        return slot

    def _release(self, accessor_index: int | None) -> int | None:
        """Drop one reference to an accessor; its index where that was the last."""
        if accessor_index is None:
            return None
        self._accessor_uses[accessor_index] -= 1
        if self._accessor_uses[accessor_index] > 0:
            return None
        for view in _accessor_views(self.gltf["accessors"][accessor_index]):
            self._release_view(view)
        return accessor_index

    def _release_view(self, view: int) -> None:
        self._view_uses[view] -= 1
        if self._view_uses[view] == 0:
            self._dead_views.append(view)
            self._free_views.append(view)

    def _add_view(self, data: bytes, *, target: int | None = None, stride: int | None = None) -> int:
        """Append data; its view's offset is that in the new data until the file is laid out."""
        padding = -self._data_size % _ALIGNMENT
        try:
            self._data.write(bytes(padding) + data)
        except OSError as error:
            raise BakeError(f"cannot be written: {error.strerror or error}", where=tempfile.gettempdir()) from error
        view = _plain(
            pygltflib.BufferView(
                buffer=len(self.source.buffers),
                byteOffset=self._data_size + padding,
                byteLength=len(data),
                byteStride=stride,
                target=target,
            )
        )
        self._data_size += padding + len(data)
        views = self.gltf.setdefault("bufferViews", [])
        if self._free_views:
            slot = self._free_views.pop(0)
            views[slot] = view
        else:
            slot = len(views)
            views.append(view)
        self._new_views.add(slot)
        return slot

    def _kept_parts(self, buffer: int) -> Iterator[tuple[int, int]]:
        """The spans of a source buffer to keep: all but dead views that no other view overlaps."""
        kept: list[tuple[int, int]] = []
        dead: list[tuple[int, int]] = []
        for slot, view in enumerate(self.source.items("bufferViews")):
            spans = [_view_span(part) for part in _view_parts(view) if part.get("buffer") == buffer]
            (dead if slot in self._dead_views else kept).extend(spans)
        start, length = 0, len(self.source.buffers[buffer])
        for low, high in sorted(dead):
            # What follows stays aligned: a span leaves the file in whole units of alignment.
            low = max(start, -(-low // _ALIGNMENT) * _ALIGNMENT)
            high -= (high - low) % _ALIGNMENT
            if high > low and not any(other < high and end > low for other, end in kept):
                yield start, low
                start = high
        if start < length:
            yield start, length

    def _compacted(self, buffer: int) -> tuple[list[memoryview], Callable[[int], int]]:
        """What is kept of a source buffer, and where an old offset is in it."""
        parts = list(self._kept_parts(buffer))
        data = self.source.buffers[buffer]
        starts = np.cumsum([0] + [high - low for low, high in parts])

        def moved(offset: int) -> int:
            for (low, high), start in zip(parts, starts[:-1], strict=True):
                if low <= offset < high:
                    return int(start) + offset - low
            return 0

        return [data[low:high] for low, high in parts], moved

    def _write_glb(self, name: str) -> int:
        chunks: list[memoryview | bytes] = []
        size = 0

        def append(*parts: memoryview | bytes) -> int:
            nonlocal size
            start = size + -size % _ALIGNMENT
            chunks.extend([bytes(start - size), *parts])
            size = start + sum(len(part) for part in parts)
            return start

        gltf = copy.copy(self.gltf)
        views = self._used_views(0)
        placeholders: list[Json] = []
        for buffer, data in enumerate(self.source.buffers):
            shown = list(self._old_parts(views, buffer))
            if not len(data):
                placeholders += [self.gltf["buffers"][buffer]] if shown else []
                for part in shown:
                    part["buffer"] = len(placeholders)
                continue
            parts, moved = self._compacted(buffer)
            base = append(*parts)
            for part in shown:
                _set_offset(part, base + moved(part.get("byteOffset", 0)))
                part["buffer"] = 0
        images = self._embed_images(name, views, append)
        if images is not None:
            gltf["images"] = images
        append(b"")
        for slot in self._new_views:
            views[slot]["buffer"] = 0
            _set_offset(views[slot], size + views[slot].get("byteOffset", 0))
        total_data = size + self._data_size
        if "bufferViews" in gltf or views:
            gltf["bufferViews"] = views
        if total_data:
            old_buffers = self.gltf.get("buffers", [])
            kept = {key: value for key, value in old_buffers[0].items() if key != "uri"} if old_buffers else {}
            if any(name in kept.get("extensions", {}) for name in meshopt.EXTENSIONS):
                del kept["extensions"]  # a fallback, which the binary chunk is not any more
            gltf["buffers"] = [kept | {"byteLength": total_data}, *placeholders]
        self._drop_compressions(gltf, views)
        text = _dump(gltf)
        text += b" " * (-len(text) % _ALIGNMENT)
        tail = bytes(-total_data % _ALIGNMENT)
        total = 12 + 8 + len(text) + (8 + total_data + len(tail) if total_data else 0)
        if total > _GLB_LIMIT:
            raise BakeError(f"would be {total} bytes; a .glb holds 4 GiB: use --frames-dir", where=name)

        def write(file: IO[bytes]) -> None:
            file.write(struct.pack("<4sII", _GLB_MAGIC, 2, total))
            file.write(struct.pack("<I4s", len(text), _JSON_CHUNK) + text)
            if total_data:
                file.write(struct.pack("<I4s", total_data + len(tail), _BIN_CHUNK))
                file.writelines(chunks)
                self._copy_data(file)
                file.write(tail)

        replace_file(name, write)
        return total

    def _used_views(self, buffer: int) -> list[Json]:
        """Copies of all views; a free one in between, whose data is gone, shows one byte of a buffer for its place."""
        views: list[Json] = copy.deepcopy(self.gltf.get("bufferViews", []))
        while views and len(views) - 1 in self._free_views:
            views.pop()
            self._free_views.remove(len(views))
        for slot in self._free_views:
            views[slot] = {"buffer": buffer, "byteLength": 1}
        return views

    def _old_parts(self, views: list[Json], buffer: int) -> Iterator[Json]:
        """What still shows data of a source buffer: views, or the extensions that compress them."""
        for slot, old in enumerate(self.source.items("bufferViews")):
            if slot not in self._new_views and slot not in self._free_views and slot < len(views):
                for old_part, part in zip(_view_parts(old), _view_parts(views[slot]), strict=True):
                    if old_part.get("buffer") == buffer:
                        yield part

    def _drop_compressions(self, gltf: Json, views: list[Json]) -> None:
        """Take compressions that nothing uses any more out of the lists of extensions; `gltf` is a shallow copy."""
        gone = _compressions(self.source.gltf) - _compressions(gltf | {"bufferViews": views})
        for key in ("extensionsUsed", "extensionsRequired"):
            if gone.intersection(gltf.get(key, [])):
                gltf[key] = [name for name in gltf[key] if name not in gone]
                if not gltf[key]:
                    del gltf[key]

    def _copy_data(self, file: IO[bytes]) -> None:
        self._data.seek(0)
        shutil.copyfileobj(self._data, file)

    def _embed_images(self, name: str, views: list[Json], append: Callable[..., int]) -> list[Json] | None:
        """Images with the files of another folder put into the binary chunk; None where there are none."""
        images: list[Json] = [dict(image) for image in self.gltf.get("images", [])]
        changed = False
        for index, image in enumerate(images):
            uri = image.get("uri")
            if not isinstance(uri, str) or uri.startswith("data:") or self._beside(name):
                continue
            data = self._read_image(uri, index)
            del image["uri"]
            image["bufferView"] = len(views)
            image.setdefault("mimeType", _image_type(bytes(data[:16])))
            views.append({"buffer": 0, "byteOffset": append(data), "byteLength": len(data)})
            changed = True
        return images if changed else None

    def _beside(self, name: str) -> bool:
        """Whether OUT lies in the source's folder, so that relative URIs still work."""
        return os.path.realpath(os.path.dirname(name)) == os.path.realpath(os.path.dirname(self.source.path))

    def _write_gltf(self, name: str, made: list[str]) -> int:
        """Write OUT and the files beside it; those, and folders, that were not there go on the list `made`."""
        images = self._copy_images(name, made)
        written = 0
        folder, stem = os.path.dirname(name), os.path.splitext(os.path.basename(name))[0]
        gltf = copy.copy(self.gltf)
        buffers: list[Json] = [dict(buffer) for buffer in gltf.get("buffers", [])]
        stored = [index for index, data in enumerate(self.source.buffers) if len(data)]
        views = self._used_views(stored[0] if stored else 0)
        for index in stored:
            buffer = buffers[index]
            parts, moved = self._compacted(index)
            uri = buffer.get("uri", "")
            unchanged = sum(len(part) for part in parts) == len(self.source.buffers[index])
            if unchanged and (uri.startswith("data:") or (uri and self._beside(name))):
                continue
            for part in self._old_parts(views, index):
                _set_offset(part, moved(part.get("byteOffset", 0)))
            content = b"".join(parts) or bytes(_ALIGNMENT)  # a buffer may not be empty
            buffer["byteLength"] = len(content)
            file_name = f"{stem}-{hashlib.sha256(content).hexdigest()[:12]}.bin"
            buffer["uri"] = quote(file_name)
            _note_new(os.path.join(folder, file_name), made)
            written += replace_bytes(os.path.join(folder, file_name), content)
        if self._data_size:
            self._data.seek(0)
            digest = hashlib.file_digest(self._data, "sha256").hexdigest()[:12]  # type: ignore[arg-type]
            file_name = f"{stem}-{digest}.bin"
            buffers.append({"uri": quote(file_name), "byteLength": self._data_size})
            _note_new(os.path.join(folder, file_name), made)
            written += replace_file(os.path.join(folder, file_name), self._copy_data)
        shown = {part.get("buffer") for view in views for part in _view_parts(view)}
        lasting = [index for index in range(len(buffers)) if index in shown or "uri" in buffers[index]]
        for part in (part for view in views for part in _view_parts(view) if "buffer" in part):
            part["buffer"] = lasting.index(part["buffer"]) if part["buffer"] in lasting else part["buffer"]
        if images:
            gltf["images"] = images
        if buffers:
            gltf["buffers"] = [buffers[index] for index in lasting]
        if "bufferViews" in gltf or views:
            gltf["bufferViews"] = views
        self._drop_compressions(gltf, views)
        text = _dump(gltf, indent=2) + b"\n"
        return written + replace_bytes(name, text)

    def _read_image(self, uri: str, index: int) -> memoryview:
        where, allowed = self.source.where("images", index), self.source.allow_external
        return _read_uri(uri, self.source.path, where, allow_external=allowed)[0]

    def _copy_images(self, name: str, made: list[str]) -> list[Json]:
        """Put images with relative URIs beside an OUT in another folder; those from outside get new names there."""
        images: list[Json] = [dict(image) for image in self.gltf.get("images", [])]
        if self._beside(name):
            return images
        folder, stem = os.path.dirname(name), os.path.splitext(os.path.basename(name))[0]
        for index, image in enumerate(images):
            uri = image.get("uri")
            if isinstance(uri, str) and not uri.startswith("data:"):
                data = self._read_image(uri, index)
                if _leaves(uri):
                    digest = hashlib.sha256(data).hexdigest()[:12]
                    uri = image["uri"] = quote(f"{stem}-{digest}{os.path.splitext(unquote(uri))[1]}")
                copy_path = os.path.join(folder, unquote(uri))
                if os.path.exists(copy_path):
                    if _read_file(copy_path) != data:
                        raise BakeError("is there already and is another image; choose another folder", where=copy_path)
                    continue
                _make_folders(os.path.dirname(copy_path), made)
                _note_new(copy_path, made)
                replace_bytes(copy_path, data)
        return images

    def image_files(self, out: str | os.PathLike[str]) -> list[str]:
        """The image files that writing to `out` reads."""
        if self._beside(os.fspath(out)):
            return []
        return [
            os.path.join(os.path.dirname(self.source.path), unquote(image["uri"]))
            for image in self.gltf.get("images", [])
            if isinstance(image.get("uri"), str) and not image["uri"].startswith("data:")
        ]


def _note_new(path: str, made: list[str]) -> None:
    """Put a file that is about to be written on the list, unless it is there already."""
    if not os.path.lexists(path):
        made.append(path)


def _make_folders(path: str, made: list[str]) -> None:
    """Make a folder and those above it; they go on the list."""
    if not path or os.path.isdir(path):
        return
    _make_folders(os.path.dirname(path), made)
    try:
        os.mkdir(path)
    except OSError as error:
        raise BakeError(f"cannot be made: {error.strerror or error}", where=path) from error
    made.append(path)


def replace_file(path: str, write: Callable[[IO[bytes]], object]) -> int:
    """Write a file completely beside `path`, then put it in its place; its size in bytes.

    Raises:
        BakeError: It cannot be written; the old file is as it was, and no other is left.
    """
    target = os.path.realpath(path)
    temporary: str | None = None
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=".wrinkle-", dir=os.path.dirname(target))
        with os.fdopen(descriptor, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
            size = file.tell()
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, target)
        temporary = None
    except OSError as error:
        raise BakeError(f"cannot be written: {error.strerror or error}", where=path) from error
    finally:
        if temporary is not None:
            os.unlink(temporary)
    return size


def replace_bytes(path: str, data: bytes | memoryview) -> int:
    """Put a file with this content in place of `path`, as `replace_file` does."""
    return replace_file(path, lambda file: file.write(data))


def index_type(count: int, *, smallest: type = np.uint16) -> np.dtype[Any]:
    """The smallest dtype for indices into `count` vertices.

    The greatest value is left out: it means primitive restart (glTF 2.0 §3.7.2.1).
    """
    for name in ("<u1", "<u2", "<u4"):
        dtype = np.dtype(name)
        if dtype.itemsize >= np.dtype(smallest).itemsize and count < 256**dtype.itemsize:
            return dtype
    raise BakeError(f"{count} vertices are more than glTF's 32-bit indices can count")


def _image_type(head: bytes) -> str:
    """The MIME type of an image by its first bytes: those of glTF 2.0 and of its texture extensions."""
    if head.startswith(b"\x89PNG"):
        return "image/png"
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "image/webp"
    return "image/ktx2" if head[1:4] == b"KTX" else "image/jpeg"


def _plain(built: Any) -> Json:
    """The JSON of an object built with pygltflib's types, without what is left at its default."""
    return {key: value for key, value in built.to_dict().items() if value or key == "buffer"}


def _json_numbers(values: Array) -> list[float]:
    """Numbers that JSON readers turn into exactly the stored values."""
    return [value.item() for value in values]


def _dump(gltf: Json, *, indent: int | None = None) -> bytes:
    separators = (",", ":") if indent is None else (",", ": ")
    text = json.dumps(gltf, ensure_ascii=False, allow_nan=False, indent=indent, separators=separators)
    try:
        return text.encode()
    except UnicodeEncodeError:  # half a surrogate pair, which some exporters cut from a name: only escapes can say it
        return json.dumps(gltf, allow_nan=False, indent=indent, separators=separators).encode()


def _set_offset(view: Json, offset: int) -> None:
    if offset or "byteOffset" in view:
        view["byteOffset"] = offset


def _view_span(view: Json) -> tuple[int, int]:
    start = view.get("byteOffset", 0)
    return start, start + view.get("byteLength", 0)


def _view_parts(view: Json) -> Iterator[Json]:
    """What of a view refers to bytes of a buffer: itself, and the extension that compresses it."""
    yield view
    extensions = view.get("extensions", {})
    yield from (extensions[name] for name in meshopt.EXTENSIONS if name in extensions)


def _draco_primitives(gltf: Json) -> Iterator[Json]:
    for mesh in gltf.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            if draco.EXTENSION in primitive.get("extensions", {}):
                yield primitive


def _draco_views(gltf: Json) -> Iterator[int]:
    for primitive in _draco_primitives(gltf):
        if "bufferView" in primitive["extensions"][draco.EXTENSION]:
            yield primitive["extensions"][draco.EXTENSION]["bufferView"]


def _compressions(gltf: Json) -> set[str]:
    """The compressions that a document's objects use."""
    users = [*gltf.get("bufferViews", []), *gltf.get("buffers", []), *_draco_primitives(gltf)]
    return {name for user in users for name in user.get("extensions", {}) if name in _COMPRESSIONS}


def _accessor_references(gltf: Json) -> Iterator[int]:
    for mesh in gltf.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            yield from primitive.get("attributes", {}).values()
            for targets in primitive.get("targets", []):
                yield from targets.values()
            if "indices" in primitive:
                yield primitive["indices"]
    for skin in gltf.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin["inverseBindMatrices"]
    for animation in gltf.get("animations", []):
        for sampler in animation.get("samplers", []):
            yield from (sampler[key] for key in ("input", "output") if key in sampler)


def _accessor_views(accessor: Json) -> Iterator[int]:
    sparse = accessor.get("sparse", {})
    for source in (accessor, sparse.get("indices", {}), sparse.get("values", {})):
        if "bufferView" in source:
            yield source["bufferView"]


def _view_references(gltf: Json) -> Iterator[int]:
    for accessor in gltf.get("accessors", []):
        yield from _accessor_views(accessor)
    yield from _draco_views(gltf)
    yield from (image["bufferView"] for image in gltf.get("images", []) if "bufferView" in image)


def _extension_integers(value: Any, *, inside: bool = False) -> Iterator[int]:
    """Every integer below any `extensions` object, but those that we understand: a possible reference."""
    if isinstance(value, dict):
        for key, child in value.items():
            if key != "extras" and not (inside and key in _COMPRESSIONS):
                yield from _extension_integers(child, inside=inside or key == "extensions")
    elif isinstance(value, list):
        for child in value:
            yield from _extension_integers(child, inside=inside)
    elif inside and isinstance(value, int) and not isinstance(value, bool):
        yield value
