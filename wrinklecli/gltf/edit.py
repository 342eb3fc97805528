"""A document being changed: the source's JSON patched, accessors and buffer views added in the place of dropped ones.

Objects that we add are built with pygltflib's types. (Round-tripping the source through pygltflib would lose
unknown keys, `Node.weights` and more.)

Source: glTF 2.0 specification, §3.6 (binary data storage), §5.1 (accessors).
"""

import copy
import tempfile
import weakref
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import pygltflib

from wrinklecli.errors import BakeError
from wrinklecli.gltf import draco
from wrinklecli.gltf.document import COMPONENT_TYPES, SIZE_TYPES, Document
from wrinklecli.gltf.references import (
    accessor_references,
    accessor_views,
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
ALIGNMENT = 4  # bytes; the largest component is 4 bytes, and GLB chunks are padded to it

_SPOOL_BYTES = 2**26  # of new data that stay in memory; more goes to a temporary file
_CHUNK_BYTES = 2**20  # of new data that are read back at a time


@dataclass(frozen=True, slots=True)
class KeptBytes:
    """What is kept of a buffer: spans of it, laid one after another.

    Attributes:
        data: The whole buffer.
        spans: Bytes [low, high) that are kept, rising.
    """

    data: memoryview
    spans: tuple[tuple[int, int], ...]

    @property
    def parts(self) -> list[memoryview]:
        """The kept bytes, a part for each span."""
        return [self.data[low:high] for low, high in self.spans]

    @property
    def whole(self) -> bool:
        """Whether all is kept."""
        return sum(high - low for low, high in self.spans) == len(self.data)

    def moved(self, offset: int) -> int:
        """Where among the kept bytes the byte at an offset is; 0 where it is not kept."""
        start = 0
        for low, high in self.spans:
            if low <= offset < high:
                return start + offset - low
            start += high - low
        return 0


@dataclass(frozen=True, slots=True)
class PlacedViews:
    """Copies of a document's buffer views, to be given the places that a written file has for their bytes.

    Attributes:
        views: All of them, for the file's JSON.
        of_source: For each buffer of the source what still shows its bytes: views, or the extensions that compress
            them.
        of_new: Views of new data; `byteOffset` is that in the new data.
    """

    views: list[Json]
    of_source: tuple[list[Json], ...]
    of_new: list[Json]


class EditedDocument:
    """A document being changed: the JSON patched in place, data appended.

    Everything that is not set here stays as it was. An accessor whose last reference is replaced gives its
    index (and its buffer view's) to the new data, and its bytes leave the file: indices elsewhere keep their
    meaning, and no dead data is left behind.

    Attributes:
        source: What was read.
        gltf: The JSON to patch; a deep copy.
        new_size: Bytes of new data.
    """

    def __init__(self, source: Document) -> None:
        self.source = source
        self.gltf: Json = copy.deepcopy(source.gltf)
        self.new_size = 0
        # New data goes to disk when it outgrows memory: per-frame geometry may be gigabytes.
        self._data: IO[bytes] = tempfile.SpooledTemporaryFile(max_size=_SPOOL_BYTES)  # noqa: SIM115
        weakref.finalize(self, self._data.close)
        self._new_views: set[int] = set()
        self._dead_views: set[int] = set()  # of the source: nothing refers to them any more
        self._free_views: list[int] = []  # of these, whose index no other has got yet
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
        padding = -stored.itemsize * stored.shape[1] % ALIGNMENT if target == VERTEX_DATA else 0
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
        """Give a primitive that Draco compressed plain accessors, where it has not got them yet."""
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
        """The changed document as a reader will see it, in memory: the source's buffers and one of new data."""
        buffers = [*self.source.items("buffers"), {"byteLength": self.new_size}]
        data = memoryview(b"".join(self.new_data()))
        return Document(self.source.path, self.gltf | {"buffers": buffers}, (*self.source.buffers, data), ())

    def new_data(self) -> Iterator[bytes]:
        """The new data, in pieces: there may be more than memory holds."""
        self._data.seek(0)
        while piece := self._data.read(_CHUNK_BYTES):
            yield piece

    def kept(self, buffer: int) -> KeptBytes:
        """What is kept of a buffer of the source: all but dead views that no other view overlaps."""
        living: list[tuple[int, int]] = []
        dead: list[tuple[int, int]] = []
        for slot, view in enumerate(self.source.items("bufferViews")):
            shown = [view_span(part) for part in view_parts(view) if part.get("buffer") == buffer]
            (dead if slot in self._dead_views else living).extend(shown)
        data = self.source.buffers[buffer]
        spans: list[tuple[int, int]] = []
        start = 0
        for low, high in sorted(dead):
            # What follows stays aligned: a span leaves the file in whole units of alignment.
            low = max(start, -(-low // ALIGNMENT) * ALIGNMENT)
            high -= (high - low) % ALIGNMENT
            if high > low and not any(other < high and end > low for other, end in living):
                spans.append((start, low))
                start = high
        spans.append((start, len(data)))
        return KeptBytes(data, tuple((low, high) for low, high in spans if low < high))

    def placed_views(self, idle: int) -> PlacedViews:
        """Copies of the buffer views for a file to be written; those at the end whose data is gone are left out.

        Args:
            idle: The buffer of which a view in between, whose data is gone, shows one byte: its index must stay.
        """
        views: list[Json] = copy.deepcopy(self.gltf.get("bufferViews", []))
        while views and len(views) - 1 in self._free_views:
            views.pop()
        for slot in self._free_views:
            if slot < len(views):
                views[slot] = {"buffer": idle, "byteLength": 1}
        parts = [
            (old_part.get("buffer"), part)
            for slot, (old, view) in enumerate(zip(self.source.items("bufferViews"), views, strict=False))
            if slot not in self._new_views and slot not in self._free_views
            for old_part, part in zip(view_parts(old), view_parts(view), strict=True)
        ]
        of_source = tuple(
            [part for shown, part in parts if shown == buffer] for buffer in range(len(self.source.buffers))
        )
        return PlacedViews(views, of_source, [views[slot] for slot in self._new_views])

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
            self._dead_views.add(view)
            self._free_views.append(view)

    def _add_view(self, data: bytes, *, target: int | None = None, stride: int | None = None) -> int:
        """Append data; its view's offset is that in the new data until the file is laid out."""
        padding = -self.new_size % ALIGNMENT
        try:
            self._data.seek(self.new_size)
            self._data.write(bytes(padding) + data)
        except OSError as error:
            raise BakeError(f"cannot be written: {error.strerror or error}", where=tempfile.gettempdir()) from error
        view = _plain(
            pygltflib.BufferView(
                buffer=len(self.source.buffers),
                byteOffset=self.new_size + padding,
                byteLength=len(data),
                byteStride=stride,
                target=target,
            )
        )
        self.new_size += padding + len(data)
        views = self.gltf.setdefault("bufferViews", [])
        if self._free_views:
            slot = self._free_views.pop(0)
            views[slot] = view
        else:
            slot = len(views)
            views.append(view)
        self._new_views.add(slot)
        return slot


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


def _plain(built: Any) -> Json:
    """The JSON of an object built with pygltflib's types, without what is left at its default."""
    # Not `to_dict`, which takes a quarter of a millisecond; these objects hold plain values alone.
    return {key: value for key, value in vars(built).items() if value or key == "buffer"}


def _json_numbers(values: Array) -> list[float]:
    """Numbers that JSON readers turn into exactly the stored values."""
    return [value.item() for value in values]
