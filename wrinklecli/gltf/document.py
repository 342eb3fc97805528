"""Reads glTF documents: .gltf and .glb bytes to JSON, buffers and accessors.

The JSON stays as it was parsed, with every key in its order; `edited_document` patches a copy of it.

Source: glTF 2.0 specification, §3.6 (binary data storage), §4 (GLB), §5.1 (accessors);
    EXT_meshopt_compression, KHR_meshopt_compression and KHR_draco_mesh_compression.
"""

import os
import struct
from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.files.formats import foreign_format
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import check_channels
from wrinklecli.gltf.files import local_file, read_data_uri, read_file
from wrinklecli.gltf.new_data import aligned
from wrinklecli.gltf.references import draco_primitives, is_placeholder, view_parts
from wrinklecli.gltf.shape import DRACO, Json, check_asset, parse_json, place
from wrinklecli.numeric.arrays import Array, Ints, nonzero_rows
from wrinklecli.numeric.memory import MAX_MEMORY, Memory, json_memory, once, shown_bytes

if TYPE_CHECKING:
    from wrinklecli.gltf.draco import DracoMesh

Rows = Ints | slice
"""The numbers of the elements of an accessor that are read."""

EVERY = slice(None)

# Primitive modes (§5.24.4) and component types (§5.1.3).
TRIANGLES = 4
TRIANGLE_STRIP = 5
TRIANGLE_FAN = 6
_COMPONENT_DTYPES: dict[Any, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
COMPONENT_TYPES = {dtype: number for number, dtype in _COMPONENT_DTYPES.items()}
_TYPE_SIZES: dict[Any, int] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
SIZE_TYPES = {size: name for name, size in _TYPE_SIZES.items() if name != "MAT2"}

# Marks of a .glb (§4.4).
GLB_MAGIC = b"glTF"
JSON_CHUNK = b"JSON"
BIN_CHUNK = b"BIN\0"

# Most elements of an accessor: its count may be any number, but no real one is larger.
_COUNT_LIMIT = 2**26
# Bytes of a decoded number, a float64.
_DECODED_BYTES = 8
# Bytes of numbers that any file may need without storing them (zeros, morph deltas, skin weights of all joints), at the
# usual limit of memory,
_FREE_BYTES = 2**25
# or that a large file may need for each byte of its buffers. No real file comes near, and a file of 200 bytes cannot
# need gigabytes.
_FREE_PER_BYTE = 2**11


@dataclass(frozen=True)
class Document:
    """A glTF asset as it was read.

    Attributes:
        path: The file, as the user typed it; messages begin with it.
        gltf: The parsed JSON; never written to.
        buffers: One for each of the JSON's `buffers`; empty for a placeholder, whose views are all compressed into
            other buffers.
        files: Every file that was read, the asset first, as typed or joined to its folder.
        allow_external: True if buffers and images may lie outside the asset's folder.
        resources: Images by relative URI if the document was restored from a file elsewhere and they are not beside
            `path`; otherwise None.
        memory: The memory that reading may take.
    """

    path: str
    gltf: Json
    buffers: tuple[memoryview, ...]
    files: tuple[str, ...]
    allow_external: bool = False
    resources: dict[str, memoryview] | None = None
    memory: Memory = field(default_factory=Memory, compare=False)
    # What was read so far: accessors, views, streams of Draco by their views, and files by their paths.
    _decoded: dict[int, Array] = field(default_factory=dict, init=False, repr=False, compare=False)
    _decompressed: dict[int, memoryview] = field(default_factory=dict, init=False, repr=False, compare=False)
    _draco_meshes: "dict[int, DracoMesh]" = field(default_factory=dict, init=False, repr=False, compare=False)
    _read: dict[str, memoryview] = field(default_factory=dict, init=False, repr=False, compare=False)

    def extended(self, gltf: Json, buffers: Sequence[memoryview], files: Iterable[str] = ()) -> "Document":
        """Add content, read from further `files` or made, to the document; decoded data is kept.

        Accessors, views and buffers of the new JSON, and the buffers, begin with those of this document.
        """
        more = replace(self, gltf=gltf, buffers=tuple(buffers), files=tuple(dict.fromkeys([*self.files, *files])))
        for name in ("_decoded", "_decompressed", "_draco_meshes", "_read"):
            vars(more)[name] = getattr(self, name)
        return more

    def where(self, *pointer: str | int) -> str:
        """The place of a JSON value for messages: `hand.glb#/meshes/0`."""
        return place(self.path, *pointer)

    def items(self, kind: str) -> list[Json]:
        """The JSON objects of a top-level array; none if the document has no such array."""
        found: list[Json] = self.gltf.get(kind, [])
        return found

    def item(self, kind: str, index: object, *, user: str) -> Json:
        """One object of a top-level array.

        Raises:
            AssetError: The index, used by `user` (a place from `where`), is out of range or not an integer.
        """
        found = self.items(kind)
        if not isinstance(index, int) or not 0 <= index < len(found):
            raise AssetError(f"refers to {kind}[{index}], but there are {len(found)}", where=user)
        return found[index]

    def accessor(self, index: int, *, user: str | None = None, rows: Rows = EVERY) -> Array:
        """Decode the elements of an accessor, or some rows of them, with sparse substitutions.

        Only whole accessors are kept. `user` refers to the accessor, for messages.

        Returns:
            (rows, components), or (rows,) for SCALAR: float64 for floats and normalised integers, otherwise the stored
            integers.

        Raises:
            AssetError: The accessor, or a view or buffer behind it, is malformed or out of range.

        Source: glTF 2.0 §3.6.2 and, for normalised integers, §3.11. Differs: MAT2 and MAT3 of one- and
            two-byte components, whose columns are padded, are refused; no geometry or animation uses them.
        """
        if index not in self._decoded:
            accessor = self.item("accessors", index, user=user or self.where("accessors", index))
            elements = self._elements(index)[rows]
            where = self.where("accessors", index)
            self.memory.claim(_DECODED_BYTES * elements.size, f"{len(elements)} elements", where=where)
            values = _values(accessor, elements)
            if rows is not EVERY:
                return values
            self._decoded[index] = values
        return self._decoded[index][rows]

    def claim_unstored(self, size: int, what: str, *, where: str) -> None:
        """Claim bytes for data that the file does not store byte by byte, if the file is large enough for so many.

        Raises:
            TooMuchError: The file is too small, or too little memory is left.
        """
        most = max(_FREE_BYTES, _FREE_PER_BYTE * self._stored_bytes) * self.memory.most // MAX_MEMORY
        if size > most:
            raise TooMuchError(
                f"{what} would take {shown_bytes(size)}; a file of {shown_bytes(self._stored_bytes)} of data may take"
                f" {shown_bytes(most)} for what it does not store: raise --max-memory",
                where=where,
            )
        self.memory.claim(size, what, where=where)

    @cached_property
    def _stored_bytes(self) -> int:
        """Bytes of all buffers; a file that several buffers share counts once."""
        return sum({id(each.obj): len(each) for each in self.buffers}.values())

    def read_uri(self, uri: str, where: str) -> tuple[memoryview, str | None]:
        """Read the bytes behind a URI, and give their file (None for a data URI). Each file is read once.

        Raises:
            AssetError: The file is missing, too large, or lies outside the asset's folder; or the data is malformed.
        """
        if uri.startswith("data:"):
            return read_data_uri(uri, where, memory=self.memory), None
        file = local_file(uri, self.path, where, allow_external=self.allow_external)
        return once(self._read, file, partial(read_file, file, memory=self.memory, where=where)), file

    def element_count(self, index: int, *, user: str | None = None) -> int:
        """The number of elements of an accessor, to which `user` refers.

        Raises:
            AssetError: The accessor, or a view or buffer behind it, is malformed or out of range.
        """
        self.item("accessors", index, user=user or self.where("accessors", index))
        return len(self._elements(index))

    def stored(self, index: int) -> Array:
        """(count, components) stored elements of an accessor, with sparse substitutions.

        Raises:
            AssetError: The accessor, or a view or buffer behind it, is malformed or out of range.
        """
        elements = self._elements(index)
        return elements if elements.flags.owndata else elements.copy()

    def _elements(self, index: int) -> Array:
        """The same, perhaps as a view of the file's bytes."""
        accessor, where = self.items("accessors")[index], self.where("accessors", index)
        dtype, size = _element(accessor, where)
        count = _whole(accessor, "count", where, least=1, most=_COUNT_LIMIT)
        if "bufferView" in accessor:
            elements = self._view_elements(accessor, dtype, size, count, where)
            self.memory.check(elements.nbytes, f"{count} elements", where=where)
        elif index in self._draco_sources:
            elements = self._draco_elements(index, dtype, size, where)
        else:
            self.claim_unstored(_DECODED_BYTES * count * size, f"{count} elements that are not stored", where=where)
            elements = np.zeros((count, size), dtype)
        if (sparse := accessor.get("sparse")) is not None:
            indices, values = self._sparse_elements(sparse, dtype, size, len(elements), where)
            elements = elements.copy()
            elements[indices] = values
        return elements

    def changes(self, index: int) -> tuple[Ints, Array]:
        """(changed,) sorted indices and (changed, components) values of the elements other than 0.

        A sparse accessor over zeros takes no more memory than its values. Nothing is kept.

        Raises:
            AssetError: The accessor, or a view or buffer behind it, is malformed or out of range.
        """
        accessor, where = self.items("accessors")[index], self.where("accessors", index)
        sparse = accessor.get("sparse")
        if sparse is None or "bufferView" in accessor or index in self._draco_sources:
            elements = self._elements(index)
            changed = nonzero_rows(elements)
            return changed, _values(accessor, elements[changed])
        dtype, size = _element(accessor, where)
        count = _whole(accessor, "count", where, least=1, most=_COUNT_LIMIT)
        indices, values = self._sparse_elements(sparse, dtype, size, count, where)
        changed = nonzero_rows(values)
        return indices[changed].astype(np.intp), _values(accessor, values[changed])

    def stored_dtype(self, index: int) -> np.dtype[Any]:
        """The component type that an accessor is stored in."""
        return _element(self.items("accessors")[index], self.where("accessors", index))[0]

    def is_draco(self, index: int) -> bool:
        """True if an accessor's data is in a Draco stream."""
        return index in self._draco_sources and "bufferView" not in self.items("accessors")[index]

    @cached_property
    def _draco_sources(self) -> dict[int, tuple[Json, str | None]]:
        """The extension and the attribute's name (None for indices) of each accessor that Draco compressed."""
        sources: dict[int, tuple[Json, str | None]] = {}
        count = len(self.items("accessors"))
        for primitive in draco_primitives(self.gltf):
            extension = primitive["extensions"][DRACO]
            for name, index in primitive.get("attributes", {}).items():
                if name in extension.get("attributes", {}) and index < count:
                    sources.setdefault(index, (extension, name))
            if primitive.get("indices", count) < count:
                sources.setdefault(primitive["indices"], (extension, None))
        return sources

    def _draco_elements(self, index: int, dtype: np.dtype[Any], size: int, where: str) -> Array:
        """(count, size) elements of an accessor of a primitive that Draco compressed."""
        extension, name = self._draco_sources[index]
        view = extension.get("bufferView", -1)
        if view not in self._draco_meshes:
            from wrinklecli.gltf.draco import decode  # few files are compressed

            self._draco_meshes[view] = decode(
                self.view(view, user=where), memory=self.memory, where=self.where("bufferViews", str(view))
            )
        mesh = self._draco_meshes[view]
        values = mesh.indices[:, None] if name is None else mesh.attributes.get(extension["attributes"][name])
        if values is None or values.shape[1] != size or not len(values):
            raise AssetError(f"the Draco stream has no {name or 'indices'} of {size} components", where=where)
        if name is not None and name.startswith("WEIGHTS_") and dtype.kind == "f":
            # Weights are rounded separately and no longer add up to 1, as glTF 2.0 §3.7.3.3 asks.
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

    def _sparse_elements(
        self, sparse: Any, dtype: np.dtype[Any], size: int, count: int, where: str
    ) -> tuple[Array, Array]:
        """(changed,) indices and (changed, size) values of a sparse accessor with `count` elements."""
        changed = _whole(sparse, "count", where, least=1, most=count)
        indices_part, values_part = sparse.get("indices"), sparse.get("values")
        if not isinstance(indices_part, dict) or not isinstance(values_part, dict):
            raise AssetError("sparse needs indices and values", where=where)
        index_dtype = _COMPONENT_DTYPES.get(indices_part.get("componentType"))
        if index_dtype is None or index_dtype.kind != "u":
            raise AssetError("sparse indices must be unsigned integers", where=where)
        indices = self._view_elements(indices_part, index_dtype, 1, changed, where)[:, 0]
        if int(indices.max()) >= count:
            raise AssetError(f"sparse index {indices.max()}, but the count is {count}", where=where)
        return indices, self._view_elements(values_part, dtype, size, changed, where)

    def _view_elements(self, source: Json, dtype: np.dtype[Any], size: int, count: int, where: str) -> Array:
        """(count, size) elements of the buffer view that part of an accessor names, not copied."""
        view_index = source.get("bufferView")
        data = self.view(view_index, user=where)
        view, view_where = self.items("bufferViews")[source["bufferView"]], self.where("bufferViews", str(view_index))
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
        """The decompressed bytes of a buffer view.

        Raises:
            AssetError: The view is malformed, or does not exist and `user` (a place from `where`) refers to it.
        """
        where = self.where("bufferViews", str(index))
        view = self.item("bufferViews", index, user=user or where)
        length = _whole(view, "byteLength", where, least=1)
        found = next((each for each in view_parts(view) if each is not view), None)
        if found is None:
            return self._span(view, where)
        if index not in self._decompressed:
            count, stride = (_whole(found, key, where, least=1, most=_COUNT_LIMIT) for key in ("count", "byteStride"))
            if count * stride != length:
                raise AssetError(f"byteLength is {length}, but {count} · {stride} bytes are compressed", where=where)
            from wrinklecli.gltf.meshopt import decode  # few files are compressed

            decoded = decode(
                self._span(found, where),
                count=count,
                stride=stride,
                mode=found.get("mode", ""),
                filter_name=found.get("filter", "NONE"),
                memory=self.memory,
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


def _values(accessor: Json, elements: Array) -> Array:
    """The read-only values that the stored elements of an accessor represent."""
    values: Array = elements
    if elements.dtype.kind == "f":
        # A signalling NaN is converted like any other NaN: the accessor's reader judges it.
        with np.errstate(invalid="ignore"):
            values = elements.astype(np.float64)
    elif accessor.get("normalized"):
        limit = np.iinfo(elements.dtype).max
        values = np.maximum(elements / limit, -1.0)
    values.flags.writeable = False
    return values[:, 0] if accessor["type"] == "SCALAR" else values


def _whole(source: Json, key: str, where: str, *, default: int | None = None, least: int = 0, most: int = 2**53) -> int:
    """A non-negative integer property."""
    value = source.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise AssetError(f"{key} is {value!r}, not an integer of {least} to {most}", where=where)
    return value


def read_document(
    path: str | os.PathLike[str], *, allow_external: bool = False, memory: Memory | None = None
) -> Document:
    """Read a .glb or .gltf file and every buffer of it.

    Args:
        path: The file, whose first bytes, not its name, decide its format.
        allow_external: Let buffers and images, or the targets of links, lie outside the asset's folder: an asset from
            elsewhere could name any file of this machine.
        memory: The memory that the document may take, now and later; by default 1 GB.

    Raises:
        AssetError: A file is missing, truncated, malformed, too large for the memory, or outside the asset's folder.
    """
    name = os.fspath(path)
    memory = memory or Memory()
    data = read_file(name, memory=memory)
    if bytes(data[:4]) == GLB_MAGIC:
        json_bytes, binary = _split_glb(data, name)
    else:
        json_bytes, binary = data, None
    text = bytes(json_bytes)
    memory.claim(json_memory(text), "the values of the JSON", where=name)
    gltf = parse_json(text, name)
    files = [name]
    check_asset(gltf, name)
    check_channels(gltf, name)
    document = Document(name, gltf, (), (), allow_external, memory=memory)
    buffers = []
    for index, buffer in enumerate(document.items("buffers")):
        where = document.where("buffers", index)
        uri = buffer.get("uri")
        if uri is None and index == 0 and binary is not None:
            content = binary
        elif isinstance(uri, str):
            content, file = document.read_uri(uri, where)
            files += [file] if file else []
        elif uri is None and is_placeholder(gltf, index):
            buffers.append(memoryview(b""))
            continue
        else:
            raise AssetError("has no data: no uri, and no binary chunk of a .glb", where=where)
        length = _whole(buffer, "byteLength", where, least=1)
        if len(content) < length:
            what = foreign_format(bytes(content), uri or name)
            raise AssetError(
                f"is {what}" if what else f"has {len(content)} bytes of {length}; is the file truncated?", where=where
            )
        buffers.append(content[:length])
    return replace(document, buffers=tuple(buffers), files=tuple(dict.fromkeys(files)))


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
    if JSON_CHUNK not in chunks:
        raise AssetError("has no JSON chunk", where=name)
    return chunks[JSON_CHUNK], chunks.get(BIN_CHUNK)


def stored_bytes(gltf: Json, accessors: Iterable[int]) -> int:
    """Count the bytes of VEC and SCALAR accessors in buffers, those that several accessors read once.

    An accessor of a compressed view counts with the fraction of the view that it would take uncompressed.

    Source: glTF 2.0 §3.6.2; EXT_meshopt_compression.
    """
    views = gltf.get("bufferViews", [])
    places: dict[tuple[int, int], float] = {}
    for index in set(accessors):
        accessor = gltf["accessors"][index]
        sparse = accessor.get("sparse", {})
        element = _COMPONENT_DTYPES[accessor["componentType"]].itemsize * _TYPE_SIZES[accessor["type"]]
        # Each element of vertex attributes begins at a multiple of 4 bytes.
        parts = [(accessor, accessor["count"] * aligned(element))]
        if sparse:
            index_bytes = _COMPONENT_DTYPES[sparse["indices"]["componentType"]].itemsize
            parts += [(sparse["indices"], sparse["count"] * index_bytes), (sparse["values"], sparse["count"] * element)]
        for part, size in parts:
            if "bufferView" in part:
                whole, *packed = [each.get("byteLength", 0) for each in view_parts(views[part["bufferView"]])]
                fraction = packed[0] / max(whole, 1) if packed else 1.0
                place = part["bufferView"], part.get("byteOffset", 0)
                places[place] = max(places.get(place, 0.0), size * fraction)
    return round(sum(places.values()))
