"""Changes a document: patches a copy of the JSON, and adds accessors and buffer views in the place of dropped ones.

Source: glTF 2.0 specification, §3.6 (binary data storage), §5.1 (accessors); KHR_draco_mesh_compression.
"""

import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from wrinklecli.choices import Storage
from wrinklecli.errors import BakeError
from wrinklecli.gltf.document import COMPONENT_TYPES, SIZE_TYPES, Document
from wrinklecli.gltf.new_data import ALIGNMENT, KeptBytes, NewData, PlacedViews
from wrinklecli.gltf.references import (
    accessor_references,
    accessor_views,
    draco_views,
    extension_integers,
    view_parts,
    view_references,
    view_span,
)
from wrinklecli.gltf.shape import DRACO, Json
from wrinklecli.numeric.arrays import Array, nonzero_rows
from wrinklecli.numeric.memory import once

# Targets of buffer views (§5.11.5).
VERTEX_DATA = 34962
INDEX_DATA = 34963

# Components of vectors that storage `based` puts on a view of zeros; it stores other vectors densely.
_BASE_COMPONENTS = 3
# Bytes by which the JSON of a sparse accessor and its views is longer than that of a dense one.
_SPARSE_JSON_BYTES = 130


class EditedDocument:
    """A document whose JSON callers patch in place, and to which data is appended.

    An accessor whose last reference is replaced gives its index, and that of its buffer view, to the new data, and its
    bytes leave the file. So indices elsewhere keep their meaning, and no dead data remains.

    Attributes:
        source: The document as it was read.
        gltf: A deep copy of the JSON, to be patched.
        storage: How deltas are stored.
    """

    def __init__(self, source: Document, *, storage: Storage = "sparse") -> None:
        self.source = source
        self.gltf: Json = copy.deepcopy(source.gltf)
        self.storage = storage
        self._data = NewData()
        self._new_views: set[int] = set()
        self._dead_views: set[int] = set()  # views of the source without references
        self._dead_spans: list[tuple[int, int, int]] = []  # buffers and byte ranges that no view of the source shows
        self._free_views: list[int] = []  # dead views whose index is not used again yet
        self._free_accessors: list[int] = []
        self._accessor_uses = Counter(index for index, _ in accessor_references(self.gltf))
        self._view_uses = Counter(view_references(self.gltf))
        self._zeros: dict[tuple[Any, ...], int] = {}  # accessors by count, components and bounds
        self._zeros_view: int | None = None  # below all accessors of storage `based`
        self._index_views: dict[bytes, int] = {}
        # An unknown extension may refer to accessors and views: everything that it could mean is kept.
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
            target: VERTEX_DATA or INDEX_DATA; None for animation data and matrices.
            normalized: The integers represent [0, 1] or [-1, 1].
            bounds: Write `min` and `max`.
            replaces: An accessor to which the caller is about to drop one reference.
        """
        values = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("<"), copy=False))
        stored = values if values.ndim == 2 else values[:, None]
        accessor = _accessor(values.dtype, len(values), stored.shape[1])
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor["min"] = [column.min().item() for column in stored.T]
            accessor["max"] = [column.max().item() for column in stored.T]
        slot = self.release(replaces)
        # Elements of vertex attributes begin at multiples of 4 bytes (glTF 2.0 §3.6.2.4).
        rows, stride = np.frombuffer(values.tobytes(), np.uint8).reshape(-1, stored.itemsize * stored.shape[1]), None
        if target == VERTEX_DATA and rows.shape[1] % ALIGNMENT:
            rows = np.pad(rows, ((0, 0), (0, -rows.shape[1] % ALIGNMENT)))
            stride = rows.shape[1]
        accessor = {"bufferView": self._add_view(rows.tobytes(), target=target, stride=stride), **accessor}
        return self._place(accessor, slot)

    def add_like(self, index: int, values: Array, **how: Any) -> int:
        """Add an accessor of values that represent what those of an accessor of the source do."""
        return self.add(values, normalized=bool(self.source.items("accessors")[index].get("normalized")), **how)

    def add_deltas(
        self, vertices: Array, deltas: Array, *, count: int, bounds: bool = False, replaces: int | None = None
    ) -> int:
        """Add an accessor of `count` float32 vectors: zeros, with (changed, components) deltas at (changed,) vertices.

        Accessors of zeros alone are shared. None goes without data, although glTF 2.0 §5.1.1 allows it: assimp, Open3D,
        glTFast, UnityGLTF and Bevy refuse that. `bounds` and `replaces` are those of `add`.
        """
        deltas = deltas.astype("<f4")
        moved = nonzero_rows(deltas)
        vertices, deltas = vertices[moved], deltas[moved]
        if not len(moved):
            return self._add_zeros(count, deltas.shape[1], bounds=bounds, replaces=replaces)
        if self._takes_less_sparse(vertices, count, deltas.shape[1]):
            accessor = self._zeros_accessor(count, deltas, bounds=bounds) | {"sparse": self._sparse(vertices, deltas)}
            return self._place(accessor, self.release(replaces))
        dense = np.zeros((count, deltas.shape[1]), "<f4")
        dense[vertices] = deltas
        return self.add(dense, target=VERTEX_DATA, bounds=bounds, replaces=replaces)

    def _can_be_sparse(self, components: int) -> bool:
        return self.storage == "sparse" or (self.storage == "based" and components == _BASE_COMPONENTS)

    def _takes_less_sparse(self, vertices: Array, count: int, components: int) -> bool:
        each = 4 * components + _index_dtype(vertices).itemsize
        return self._can_be_sparse(components) and len(vertices) * each + _SPARSE_JSON_BYTES < 4 * components * count

    def _zeros_accessor(self, count: int, deltas: Array, *, bounds: bool) -> Json:
        """An accessor of zeros, with the bounds that it has if deltas replace some of them."""
        accessor = _accessor(deltas.dtype, count, deltas.shape[1])
        if self.storage == "based":
            accessor = {"bufferView": self._base(count), **accessor}
        if bounds:
            low, high = deltas.min(axis=0), deltas.max(axis=0)
            if len(deltas) < count:
                low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
            accessor["min"], accessor["max"] = _json_numbers(low), _json_numbers(high)
        return accessor

    def _sparse(self, vertices: Array, deltas: Array) -> Json:
        """The `sparse` of an accessor, with `byteOffset` 0, optional in glTF 2.0 §5.3.2, since VTK insists on it."""
        index_dtype = _index_dtype(vertices)
        indices = vertices.astype(index_dtype).tobytes()
        return {
            "count": len(vertices),
            "indices": {
                # POSITION and NORMAL of a target often change at the same vertices.
                "bufferView": once(self._index_views, indices, partial(self._add_view, indices)),
                "byteOffset": 0,
                "componentType": COMPONENT_TYPES[index_dtype],
            },
            "values": {"bufferView": self._add_view(deltas.tobytes()), "byteOffset": 0},
        }

    def _base(self, count: int) -> int:
        """The view of zeros below sparse vectors, made or grown to hold `count` of them."""
        if self._zeros_view is None:
            self._zeros_view = self._place_view({"byteStride": 4 * _BASE_COMPONENTS, "target": VERTEX_DATA})
        self._data.zeros = max(self._data.zeros, count * 4 * _BASE_COMPONENTS)
        self._settle_zeros()
        return self._zeros_view

    def _settle_zeros(self) -> None:
        """Move the view of zeros to their place behind all other new data."""
        if self._zeros_view is not None:
            place = {"byteOffset": self._data.zeros_start, "byteLength": self._data.zeros}
            self.gltf["bufferViews"][self._zeros_view] |= place

    def _add_zeros(self, count: int, components: int, *, bounds: bool, replaces: int | None) -> int:
        """Give the shared accessor of `count` zeros."""
        freed = self.release(replaces)
        self._free_accessors += [] if freed is None else [freed]
        key = (count, components, bounds)
        if key not in self._zeros:
            if self._can_be_sparse(components):
                zero = np.zeros((1, components), "<f4")
                accessor = self._zeros_accessor(count, zero, bounds=bounds)
                if self.storage == "sparse":
                    accessor["sparse"] = self._sparse(np.zeros(1, np.intp), zero)
                self._zeros[key] = self._place(accessor, None)
            else:
                zeros = np.zeros((count, components), "<f4")
                self._zeros[key] = self.add(zeros, target=VERTEX_DATA, bounds=bounds)
        if freed in self._free_accessors:
            # The freed index must stay a valid accessor until it is used again.
            self.gltf["accessors"][freed] = copy.copy(self.gltf["accessors"][self._zeros[key]])
        return self._zeros[key]

    def clone_mesh(self, mesh: int) -> int:
        """Append a copy of a mesh, which shares its accessors, and give its index."""
        copied = copy.deepcopy(self.gltf["meshes"][mesh])
        self._accessor_uses.update(index for index, _ in accessor_references({"meshes": [copied]}))
        self._view_uses.update(draco_views({"meshes": [copied]}))
        self.gltf["meshes"].append(copied)
        return len(self.gltf["meshes"]) - 1

    def discard(self, accessor: int, *, like: int) -> None:
        """Drop one reference to an accessor; after the last it is a copy of `like` until its index is used again."""
        freed = self.release(accessor)
        if freed is not None:
            self._free_accessors.append(freed)
            self.gltf["accessors"][freed] = copy.copy(self.gltf["accessors"][like])

    def unpack(self, primitive: Json) -> None:
        """Give a primitive plain accessors in the place of its Draco stream, if it has none yet."""
        extension = primitive.get("extensions", {}).pop(DRACO, None)
        if extension is None:
            return
        if not primitive["extensions"]:
            del primitive["extensions"]
        primitive.pop("mode", None)  # a strip is decoded to triangles
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
                owner[key] = self.add_like(index, values, target=target, bounds="min" in accessor, replaces=index)
        if extension.get("bufferView", len(self.gltf["bufferViews"])) < len(self.gltf["bufferViews"]):
            self._release_view(extension["bufferView"])

    def document(self) -> Document:
        """The changed document in memory, with the source's buffers and one of new data."""
        buffers = [*self.source.items("buffers"), {"byteLength": self.new_size}]
        data = memoryview(b"".join(self.new_data()))
        # Decoded data of the source is not taken over, as an accessor's index may be reused.
        return replace(self.source, gltf=self.gltf | {"buffers": buffers}, buffers=(*self.source.buffers, data))

    def continued(self) -> "EditedDocument":
        """Start changing this document as it is: then added accessors may be replaced, too."""
        again = EditedDocument(self.document(), storage=self.storage)
        views = self.source.items("bufferViews")
        dead = [part for slot in sorted(self._dead_views) if slot < len(views) for part in view_parts(views[slot])]
        again._dead_spans = [*self._dead_spans, *((part.get("buffer", -1), *view_span(part)) for part in dead)]
        again._free_views, again._dead_views = list(self._free_views), set(self._free_views)
        again._free_accessors = list(self._free_accessors)
        for accessor in self._free_accessors:
            again._view_uses.subtract(accessor_views(self.gltf["accessors"][accessor]))
        return again

    @property
    def new_size(self) -> int:
        """Bytes of new data."""
        return len(self._data)

    def new_data(self) -> Iterator[bytes]:
        """The new data in pieces, as there may be more than memory holds."""
        return self._data.pieces()

    def kept(self, buffer: int) -> KeptBytes:
        """The bytes of a source's buffer that are kept: all but dead views that no living view overlaps."""
        living: list[tuple[int, int]] = []
        dead = [(low, high) for number, low, high in self._dead_spans if number == buffer]
        for slot, view in enumerate(self.source.items("bufferViews")):
            shown = [view_span(part) for part in view_parts(view) if part.get("buffer") == buffer]
            (dead if slot in self._dead_views else living).extend(shown)
        data = self.source.buffers[buffer]
        spans: list[tuple[int, int]] = []
        start = 0
        for low, high in sorted(dead):
            # Only whole units of alignment are removed, so that the following data stays aligned.
            low = max(start, -(-low // ALIGNMENT) * ALIGNMENT)
            high -= (high - low) % ALIGNMENT
            if high > low and not any(other < high and end > low for other, end in living):
                spans.append((start, low))
                start = high
        spans.append((start, len(data)))
        return KeptBytes(data, tuple((low, high) for low, high in spans if low < high))

    def placed_views(self, idle: int) -> PlacedViews:
        """Copy the buffer views for a file to be written, without dead ones at the end.

        A dead view in between, whose index must stay, shows one byte of the buffer `idle`.
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
        if slot is None and self._free_accessors:
            slot = self._free_accessors.pop(0)
            accessors[slot] = accessor
            return slot
        if slot is None:
            accessors.append(accessor)
            return len(accessors) - 1
        kept = {key: accessors[slot][key] for key in ("name", "extras") if key in accessors[slot]}
        accessors[slot] = accessor | kept
        return slot

    def release(self, accessor_index: int | None) -> int | None:
        """Drop one reference to an accessor, and give its index if this was the last one."""
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
        """Append data with a view, whose offset counts from the start of the new data until the file is laid out."""
        offset = self._data.append(data)
        view = {"byteOffset": offset, "byteLength": len(data), "byteStride": stride, "target": target}
        slot = self._place_view({key: value for key, value in view.items() if value})
        self._settle_zeros()
        return slot

    def _place_view(self, view: Json) -> int:
        view = {"buffer": len(self.source.buffers), **view}
        views = self.gltf.setdefault("bufferViews", [])
        if self._free_views:
            slot = self._free_views.pop(0)
            views[slot] = view
        else:
            slot = len(views)
            views.append(view)
        self._new_views.add(slot)
        return slot


def index_type(count: int, *, smallest: type = np.uint16) -> np.dtype[Any]:
    """The smallest dtype for indices into `count` vertices.

    The greatest value is excluded, as it means primitive restart (glTF 2.0 §3.7.2.1).
    """
    for name in ("<u1", "<u2", "<u4"):
        dtype = np.dtype(name)
        if dtype.itemsize >= np.dtype(smallest).itemsize and count < 256**dtype.itemsize:
            return dtype
    raise BakeError(f"{count} vertices are more than glTF's 32-bit indices can count")


def _index_dtype(vertices: Array) -> np.dtype[Any]:
    """The smallest dtype for (changed,) sorted indices of a sparse accessor."""
    return index_type(int(vertices[-1]) + 1, smallest=np.uint8)


def _accessor(dtype: np.dtype[Any], count: int, components: int) -> Json:
    return {"componentType": COMPONENT_TYPES[dtype], "count": count, "type": SIZE_TYPES[components]}


def _json_numbers(values: Array) -> list[float]:
    """Numbers that JSON readers turn into exactly the stored values."""
    return [value.item() for value in values]


def used_joints(joints: Array, weights: Array, name: str) -> Array:
    """(vertices, 4) joints with joint 0 where the (vertices, 4) weight is 0, as after rounding by Draco.

    A vertex without weight keeps its first joint of JOINTS_0, which it follows.

    Source: glTF 2.0 §3.7.3.3, "joints with a weight of zero SHOULD be set to zero".
    """
    if weights.shape != joints.shape:
        return joints
    used = weights > 0
    if name == "JOINTS_0":
        used[:, 0] |= ~used.any(axis=1)
    return np.where(used, joints, 0).astype(joints.dtype)
