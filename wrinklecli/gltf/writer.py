"""Documents being changed: the source's JSON patched, data appended, and files that are complete or not there.

Objects that we add are built with pygltflib's types. (Round-tripping the source through pygltflib would lose
unknown keys, `Node.weights` and more.)

Source: glTF 2.0 specification, §3.6 (binary data storage), §4 (GLB), §5.1 (accessors).
"""

import copy
import hashlib
import json
import os
import shutil
import struct
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import IO, Any
from urllib.parse import quote, unquote

import numpy as np
import pygltflib

from wrinklecli.errors import AssetError, BakeError
from wrinklecli.gltf import draco, meshopt
from wrinklecli.gltf.document import BIN_CHUNK, COMPONENT_TYPES, GLB_MAGIC, JSON_CHUNK, SIZE_TYPES, Document
from wrinklecli.gltf.files import leaves_folder, make_folders, read_file, read_uri, replace_bytes, replace_file
from wrinklecli.gltf.original import Span, pack, refer, wrinkled
from wrinklecli.gltf.references import (
    accessor_references,
    accessor_views,
    compressions,
    draco_views,
    extension_integers,
    view_parts,
    view_references,
    view_span,
)
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Array

VERTEX_DATA: int = pygltflib.ARRAY_BUFFER
INDEX_DATA: int = pygltflib.ELEMENT_ARRAY_BUFFER

_GLB_LIMIT = 2**32 - 1  # bytes; the header's length is 32 bits
_SPOOL_BYTES = 2**26
_ALIGNMENT = 4  # bytes; the largest component is 4 bytes, and GLB chunks are padded to it


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
        self._accessor_uses = Counter(accessor_references(self.gltf))
        self._view_uses = Counter(view_references(self.gltf))
        self._shared: dict[tuple[Any, ...], int] = {}
        # An extension that we do not know may refer to accessors and views; whatever it could mean is kept.
        foreign = set(extension_integers(self.gltf))
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
                componentType=COMPONENT_TYPES[values.dtype],
                count=len(values),
                type=SIZE_TYPES[stored.shape[1]],
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
            pygltflib.Accessor(componentType=pygltflib.FLOAT, count=count, type=SIZE_TYPES[values.shape[1]])
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
                "componentType": COMPONENT_TYPES[index_dtype],
            },
            "values": {"bufferView": self._add_view(values.astype("<f4").tobytes())},
        }
        return self._place(accessor, slot)

    def clone_mesh(self, mesh: int) -> int:
        """Append a copy of a mesh, which shares its accessors, and give its index."""
        copied = copy.deepcopy(self.gltf["meshes"][mesh])
        self._accessor_uses.update(accessor_references({"meshes": [copied]}))
        self._view_uses.update(draco_views({"meshes": [copied]}))
        self.gltf["meshes"].append(copied)
        return len(self.gltf["meshes"]) - 1

    def drop(self, accessor: int) -> None:
        """Drop one reference to an accessor, not the last: its successor will be there for another's sake."""
        self._release(accessor)

    def unpack(self, primitive: Json) -> None:
        """Give a primitive of the draft that Draco compressed plain accessors, where it has not got them yet."""
        extension = primitive.get("extensions", {}).pop(draco.EXTENSION, None)
        if extension is None:
            return
        if not primitive["extensions"]:
            del primitive["extensions"]
        primitive.pop("mode", None)  # a strip came as triangles
        attributes = primitive["attributes"]
        packed = dict(attributes)
        users = [(attributes, name, VERTEX_DATA) for name in attributes]
        users += [(primitive, "indices", INDEX_DATA)] if "indices" in primitive else []
        for owner, key, target in users:
            index = owner[key]
            accessor = self.gltf["accessors"][index]
            if "bufferView" not in accessor and self.source.is_draco(index):
                values = self.source.stored(index)
                weights = packed.get(key.replace("JOINTS_", "WEIGHTS_")) if key.startswith("JOINTS_") else None
                if weights is not None:
                    values = used_joints(values, self.source.accessor(weights), key)
                owner[key] = self.add(
                    values,
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
        another folder (.gltf) or embedded (.glb). Where the draft has put wrinkles on a node, a record of the source
        follows the new data: see `restore`.

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
        for view in accessor_views(self.gltf["accessors"][accessor_index]):
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
            spans = [view_span(part) for part in view_parts(view) if part.get("buffer") == buffer]
            (dead if slot in self._dead_views else kept).extend(spans)
        start, length = 0, len(self.source.buffers[buffer])
        for low, high in sorted(dead):
            # What follows stays aligned: a span leaves the file in whole units of alignment.
            low = max(start, -(-low // _ALIGNMENT) * _ALIGNMENT)
            high -= (high - low) % _ALIGNMENT
            if high > low and not any(other < high and end > low for other, end in kept):
                if start < low:
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
        kept: list[list[Span]] = []
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
            kept.append([])
            if not len(data):
                placeholders += [self.gltf["buffers"][buffer]] if shown else []
                for part in shown:
                    part["buffer"] = len(placeholders)
                continue
            parts, moved = self._compacted(buffer)
            base = append(*parts)
            kept[buffer] = [(low, high, 0, base + moved(low)) for low, high in self._kept_parts(buffer)]
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
            first = {key: value for key, value in old_buffers[0].items() if key != "uri"} if old_buffers else {}
            if any(name in first.get("extensions", {}) for name in meshopt.EXTENSIONS):
                del first["extensions"]  # a fallback, which the binary chunk is not any more
            gltf["buffers"] = [first | {"byteLength": total_data}, *placeholders]
        self._drop_compressions(gltf, views)
        gltf, tail = self._seal(name, gltf, [chunks, *([] for _ in placeholders)], 0, kept)
        if tail:
            total_data += len(tail)
            gltf["buffers"][0]["byteLength"] = total_data
        text = _dump(gltf)
        text += b" " * (-len(text) % _ALIGNMENT)
        tail += bytes(-total_data % _ALIGNMENT)
        total = 12 + 8 + len(text) + (8 + total_data + -total_data % _ALIGNMENT if total_data else 0)
        if total > _GLB_LIMIT:
            raise BakeError(f"would be {total} bytes; a .glb holds 4 GiB: use --frames-dir", where=name)

        def write(file: IO[bytes]) -> None:
            file.write(struct.pack("<4sII", GLB_MAGIC, 2, total))
            file.write(struct.pack("<I4s", len(text), JSON_CHUNK) + text)
            if total_data:
                file.write(struct.pack("<I4s", total_data + -total_data % _ALIGNMENT, BIN_CHUNK))
                file.writelines(chunks)
                self._copy_data(file)
                file.write(tail)

        replace_file(name, write)
        return total

    def _seal(
        self, name: str, gltf: Json, contents: list[list[memoryview | bytes]], buffer: int, kept: list[list[Span]]
    ) -> tuple[Json, bytes]:
        """Add a record of the source where the draft has put wrinkles on a node: see `restore`.

        Args:
            name: OUT.
            gltf: The JSON to be written; the buffer that gets the new data may lack its length and name.
            contents: What each buffer holds before the new data, in pieces.
            buffer: The one that gets it.
            kept: For each buffer of the source, its spans in these.

        Returns:
            The JSON, and what is to follow the new data; both as they were, and nothing, where there are no wrinkles.
        """
        added = sorted(set(wrinkled(gltf)) - set(wrinkled(self.source.gltf)))
        if not added:
            return gltf, b""
        padding = bytes(-self._data_size % _ALIGNMENT)
        self._data.seek(0)
        new = self._data.read() + padding
        view: Json = {"buffer": buffer, "byteOffset": sum(len(part) for part in contents[buffer]) + len(new)}
        gltf = refer(gltf, added[0], view)
        # A .glb holds the buffers itself.
        named = [self.source.items("images"), self.source.items("buffers")][: 1 + name.lower().endswith(".gltf")]
        uris = [each.get("uri", "data:") for kind in named for each in kind]
        beside = self._beside(name) and not all(uri.startswith("data:") for uri in uris)
        record = pack(self.source, gltf, contents, new, kept, beside=beside)
        view["byteLength"] = len(record)
        return gltf, padding + record

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
                for old_part, part in zip(view_parts(old), view_parts(views[slot]), strict=True):
                    if old_part.get("buffer") == buffer:
                        yield part

    def _drop_compressions(self, gltf: Json, views: list[Json]) -> None:
        """Take compressions that nothing uses any more out of the lists of extensions; `gltf` is a shallow copy."""
        gone = compressions(self.source.gltf) - compressions(gltf | {"bufferViews": views})
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
        folder = os.path.realpath(os.path.dirname(self.source.path))
        return self.source.resources is None and os.path.realpath(os.path.dirname(name)) == folder

    def _in_place(self, name: str, index: int) -> bool:
        """Whether a file of a buffer's own, beside OUT, goes on holding it."""
        uri, content = self.source.items("buffers")[index].get("uri", ""), self.source.buffers[index]
        if not uri or not self._beside(name):
            return False
        where, allowed = self.source.where("buffers", index), self.source.allow_external
        try:
            return read_uri(uri, self.source.path, where, allow_external=allowed)[0][: len(content)] == content
        except AssetError:  # an original's, that was read from a baked file
            return False

    def _write_gltf(self, name: str, made: list[str]) -> int:
        """Write OUT and the files beside it; those, and folders, that were not there go on the list `made`."""
        images = self._copy_images(name, made)
        written = 0
        folder, stem = os.path.dirname(name), os.path.splitext(os.path.basename(name))[0]
        gltf = copy.copy(self.gltf)
        buffers: list[Json] = [dict(buffer) for buffer in gltf.get("buffers", [])]
        stored = [index for index, data in enumerate(self.source.buffers) if len(data)]
        contents: list[list[memoryview | bytes]] = [[] for _ in buffers]
        kept: list[list[Span]] = [[] for _ in self.source.buffers]
        views = self._used_views(stored[0] if stored else 0)
        for index in stored:
            buffer = buffers[index]
            parts, moved = self._compacted(index)
            uri = buffer.get("uri", "")
            kept[index] = [(low, high, index, moved(low)) for low, high in self._kept_parts(index)]
            unchanged = sum(len(part) for part in parts) == len(self.source.buffers[index])
            if unchanged and (uri.startswith("data:") or self._in_place(name, index)):
                contents[index] = [self.source.buffers[index]]
                continue
            for part in self._old_parts(views, index):
                _set_offset(part, moved(part.get("byteOffset", 0)))
            content = b"".join(parts) or bytes(_ALIGNMENT)  # a buffer may not be empty
            contents[index] = [content]
            buffer["byteLength"] = len(content)
            file_name = f"{stem}-{hashlib.sha256(content).hexdigest()[:12]}.bin"
            buffer["uri"] = quote(file_name)
            _note_new(os.path.join(folder, file_name), made)
            written += replace_bytes(os.path.join(folder, file_name), content)
        if self._data_size:
            buffers.append({})
            contents.append([])
        shown = {part.get("buffer") for view in views for part in view_parts(view)}
        lasting = [index for index in range(len(buffers)) if index in shown or "uri" in buffers[index]]
        for part in (part for view in views for part in view_parts(view) if "buffer" in part):
            part["buffer"] = lasting.index(part["buffer"]) if part["buffer"] in lasting else part["buffer"]
        if images:
            gltf["images"] = images
        if buffers:
            gltf["buffers"] = [buffers[index] for index in lasting]
        if "bufferViews" in gltf or views:
            gltf["bufferViews"] = views
        self._drop_compressions(gltf, views)
        if self._data_size:
            places = {index: place for place, index in enumerate(lasting)}
            spans = [[(low, high, places[at], start) for low, high, at, start in each] for each in kept]
            held = [contents[index] for index in lasting]
            gltf, tail = self._seal(name, gltf, held, len(lasting) - 1, spans)
            self._data.seek(0)
            digest = hashlib.file_digest(self._data, "sha256")  # type: ignore[arg-type]
            digest.update(tail)
            file_name = f"{stem}-{digest.hexdigest()[:12]}.bin"
            gltf["buffers"][-1] |= {"uri": quote(file_name), "byteLength": self._data_size + len(tail)}
            _note_new(os.path.join(folder, file_name), made)

            def write(file: IO[bytes]) -> None:
                self._copy_data(file)
                file.write(tail)

            written += replace_file(os.path.join(folder, file_name), write)
        text = _dump(gltf, indent=2) + b"\n"
        return written + replace_bytes(name, text)

    def _read_image(self, uri: str, index: int) -> memoryview:
        if self.source.resources is not None and uri in self.source.resources:
            return self.source.resources[uri]
        where, allowed = self.source.where("images", index), self.source.allow_external
        return read_uri(uri, self.source.path, where, allow_external=allowed)[0]

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
                if leaves_folder(uri):
                    digest = hashlib.sha256(data).hexdigest()[:12]
                    uri = image["uri"] = quote(f"{stem}-{digest}{os.path.splitext(unquote(uri))[1]}")
                copy_path = os.path.join(folder, unquote(uri))
                if os.path.exists(copy_path):
                    if read_file(copy_path) != data:
                        raise BakeError("is there already and is another image; choose another folder", where=copy_path)
                    continue
                make_folders(os.path.dirname(copy_path), made)
                _note_new(copy_path, made)
                replace_bytes(copy_path, data)
        return images

    def image_files(self, out: str | os.PathLike[str]) -> list[str]:
        """The image files that writing to `out` reads."""
        if self.source.resources is not None or self._beside(os.fspath(out)):
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


def used_joints(joints: Array, weights: Array, name: str) -> Array:
    """(vertices, 4) joints, those of weight 0 as joint 0: rounding, as Draco's, leaves some behind.

    Args:
        joints: (vertices, 4).
        weights: (vertices, 4) of the same set.
        name: JOINTS_0 or another set. In the first a vertex without weight keeps its first joint, which it follows.

    Source: glTF 2.0 §3.7.3.3, "joints with a weight of zero SHOULD be set to zero".
    """
    if weights.shape != joints.shape:
        return joints
    used = weights > 0
    if name == "JOINTS_0":
        used[:, 0] |= ~used.any(axis=1)
    return np.where(used, joints, 0).astype(joints.dtype)


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
    # Not `to_dict`, which takes a quarter of a millisecond; these objects hold plain values alone.
    return {key: value for key, value in vars(built).items() if value or key == "buffer"}


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
