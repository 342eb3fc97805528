"""Refined primitives of a mesh: their vertices, and attributes, old morph targets and indices written anew.

Source: glTF 2.0 §3.7.2.1 (attributes), §3.7.2.2 (morph targets), KHR_mesh_quantization.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import TRIANGLES, Document
from wrinklecli.gltf.edited_document import INDEX_DATA, VERTEX_DATA, EditedDocument, index_type, used_joints
from wrinklecli.gltf.shape import DRACO, Json
from wrinklecli.numeric.arrays import Array, Floats, Ints, places_of, unit
from wrinklecli.surface.refine import Refinement

# Components of the attributes that are vectors. TANGENT has a handedness too, except in morph targets.
_VECTORS = {"POSITION": 3, "NORMAL": 3, "TANGENT": 4}
# Length of a sum of directions, relative to the nearest one, at and below which it is float32's rounding error.
_CANCELLED = 1e-6


Key = tuple[Any, ...]
"""The content of an accessor: primitives that share vertices ask for the same accessor by the same key."""

Written = dict[Key, int]
"""Accessors written so far, so that primitives share them."""


@dataclass(frozen=True, slots=True)
class RefinedPrimitive:
    """The vertices of one primitive after refinement.

    Attributes:
        group: The first primitive that reads the same vertices; the new vertices are those of the whole group.
        old: (old vertices,) glTF vertices of the surface, in file order.
        new: (new vertices,) numbers among the refinement's new glTF vertices.
        sources: (new vertices, 3) vertices of this primitive from which each is mixed.
        shares: (new vertices, 3) factors on the sources, summing to 1.
        weld: (vertices,) fine welded vertex of each, old ones first.
        triangles: (triangles, 3) of this primitive, local vertices.
        changed: True if triangles are not those of the file.
    """

    index: int
    group: int
    old: Ints
    new: Ints
    sources: Ints
    shares: Floats
    weld: Ints
    triangles: Ints
    changed: bool

    @property
    def new_weld(self) -> Ints:
        """(new vertices,) fine welded vertex of each."""
        return self.weld[len(self.old) :]

    def mix(self, values: Floats) -> Floats:
        """(new vertices, …) of (old vertices, …) values."""
        return np.asarray(np.einsum("vk,vk...->v...", self.shares, values[self.sources]))

    def normals(self, old: Floats, fine: Refinement) -> Floats:
        """(vertices, 3) of (old vertices, 3) normals, those of new vertices mixed.

        Old normals of 0, which glTF forbids and some exporters write, are those of the surface.
        """
        lost = np.flatnonzero(~old.any(axis=1))
        if len(lost):
            old = old.copy()
            old[lost] = fine.normals_at(self.weld[lost])
        return nonzero_directions(np.concatenate([old, self._mix_directions(old)]))

    def tangents(self, old: Floats) -> Floats:
        """(vertices, 4) of (old vertices, 4) tangents; the fourth number is a handedness, which cannot be mixed."""
        new = np.concatenate([self._mix_directions(old[:, :3]), old[self.heaviest(), 3:]], axis=1)
        return nonzero_directions(np.concatenate([old, new]))

    def _mix_directions(self, directions: Floats) -> Floats:
        """(new vertices, 3) unit vectors of (old vertices, 3) normals or tangents.

        Where these take each other back, as on an edge between opposite sides, the nearest old vertex gives its own.
        """
        mixed, nearest = self.mix(directions), directions[self.heaviest()]
        lost = (np.square(mixed).sum(axis=1) <= _CANCELLED**2 * np.square(nearest).sum(axis=1))[:, None]
        return unit(np.where(lost, nearest, mixed))

    def heaviest(self) -> Ints:
        """(new vertices,) the old vertex that is nearest to each; the first among equals."""
        return np.asarray(self.sources[np.arange(len(self.sources)), np.argmax(self.shares, axis=1)])


def nonzero_directions(directions: Floats) -> Floats:
    """(vertices, 3) normals or (vertices, 4) tangents, with +Z in place of 0, and a handedness of 1 in place of 0."""
    found = directions.copy()
    found[~found[:, :3].any(axis=1), 2] = 1.0
    found[:, 3:][found[:, 3:] == 0.0] = 1.0
    return found


def shared_vertices(source: Document, mesh: int, fine: Refinement) -> list[int]:
    """For each primitive of a mesh the first that reads the same vertices; exporters write one for each material."""
    starts = fine.surface.vertex_starts
    firsts: dict[Any, int] = {}
    groups = []
    for index, primitive in enumerate(source.items("meshes")[mesh]["primitives"]):
        key: Any = primitive["attributes"]["POSITION"], fine.weld[starts[index] : starts[index + 1]].tobytes()
        if primitive.get("mode", TRIANGLES) < TRIANGLES or DRACO in primitive.get("extensions", {}):
            key = index  # more points would show; each Draco stream has vertices of its own
        groups.append(firsts.setdefault(key, index))
    return groups


def primitives_of(fine: Refinement, groups: Sequence[int] | None = None) -> list[RefinedPrimitive]:
    """The vertices of each primitive after refinement; `groups` from `shared_vertices`, or each by itself."""
    starts = fine.surface.vertex_starts
    old_count, parents = int(starts[-1]), fine.triangle_primitives
    owners = np.arange(len(starts) - 1) if groups is None else np.array(groups)
    refined_primitives = []
    for index, group in enumerate(owners):
        old = np.arange(starts[index], starts[index + 1])
        new = np.flatnonzero(owners[fine.primitives] == group)
        local = places_of(old, old_count + len(fine.primitives))
        local[old_count + new] = len(old) + np.arange(len(new))
        corners, stored = fine.corners[parents == index], fine.surface.corners[fine.surface.primitives == index]
        refined_primitives.append(
            RefinedPrimitive(
                index=index,
                group=int(group),
                old=old,
                new=new,
                # Shares of 0 may have any source.
                sources=np.where(fine.shares[new] != 0, fine.sources[new] - starts[fine.primitives[new], None], 0),
                shares=fine.shares[new],
                weld=np.concatenate([fine.weld[old], fine.weld[old_count + new]]),
                triangles=local[corners],
                changed=not np.array_equal(corners, stored),
            )
        )
    return refined_primitives


def base_normals(source: Document, primitive: Json, refined: RefinedPrimitive, fine: Refinement) -> Floats | None:
    """(vertices, 3) unit NORMALs of a primitive, mixed for new vertices; None if it has none."""
    if "NORMAL" not in primitive.get("attributes", {}):
        return None
    return refined.normals(unit(source.accessor(primitive["attributes"]["NORMAL"])), fine)


def base_tangents(source: Document, primitive: Json, refined: RefinedPrimitive) -> Floats | None:
    """(vertices, 3) TANGENTs of a primitive without their handedness; None if it has none.

    Raises:
        AssetError: The accessor does not hold a tangent for each vertex.
    """
    if "TANGENT" not in primitive.get("attributes", {}):
        return None
    index, count = primitive["attributes"]["TANGENT"], len(refined.old)
    old = source.accessor(index)
    if old.shape != (count, 4):
        raise AssetError(
            f"must hold 4 numbers for {count} vertices, as tangents", where=source.where("accessors", index)
        )
    return refined.tangents(old)[:, :3]


def _vertex_accessors(primitive: Json, refined: RefinedPrimitive) -> Iterator[tuple[Key, int]]:
    """Each accessor that refinement replaces, after the key of its content."""
    for name, index in primitive["attributes"].items():
        yield ("attribute", refined.group, name, index), index
    for number, target in enumerate(primitive.get("targets", [])):
        for name, index in target.items():
            yield ("target", refined.group, number, name, index), index


def drop_repeated(edited: EditedDocument, mesh: Json, refined_primitives: Sequence[RefinedPrimitive]) -> None:
    """Drop all references but the first to accessors whose replacements several primitives will share."""
    seen: set[Key] = set()
    for refined in refined_primitives:
        for key, index in _vertex_accessors(mesh["primitives"][refined.index], refined) if len(refined.new) else ():
            if key in seen:
                edited.release(index)
            seen.add(key)


def refine_primitive(
    edited: EditedDocument,
    primitive: Json,
    refined: RefinedPrimitive,
    fine: Refinement,
    where: str,
    written: Written,
) -> None:
    """Replace a primitive's attributes, old targets and indices by refined ones, and add these to `written`."""
    original = dict(primitive["attributes"])
    for name, index in original.items():
        key: Key = ("attribute", refined.group, name, index)
        if key not in written:
            values, normalized = _refined_attribute(edited, original, name, refined, fine, where)
            written[key] = edited.add(
                values, target=VERTEX_DATA, normalized=normalized, bounds=name == "POSITION", replaces=index
            )
        primitive["attributes"][name] = written[key]
    for number, target in enumerate(primitive.get("targets", [])):
        for name, index in target.items():
            key = ("target", refined.group, number, name, index)
            if key not in written:
                old = old_values(
                    edited.source, target, name, refined, size=3 if name in _VECTORS else None, where=where
                )
                placed = name == "POSITION"
                new = fine.morph_deltas[number][refined.new_weld] if placed else refined.mix(old)
                values = np.concatenate([old, new])
                written[key] = edited.add_deltas(
                    np.arange(len(values)), values, count=len(values), bounds=placed, replaces=index
                )
            target[name] = written[key]
    if refined.changed or "indices" not in primitive:
        if primitive.get("mode", TRIANGLES) != TRIANGLES:
            del primitive["mode"]
        indices = refined.triangles.reshape(-1).astype(index_type(len(refined.weld)))
        primitive["indices"] = edited.add(indices, target=INDEX_DATA, replaces=primitive.get("indices"))


def old_values(
    source: Document,
    attributes: Json,
    name: str,
    refined: RefinedPrimitive,
    *,
    size: int | None = None,
    where: str | None = None,
) -> Array:
    """The stored values of an attribute, or of a morph target's attribute, one for each old vertex.

    Args:
        source: The document.
        attributes: Accessors by name.
        name: The attribute.
        refined: The primitive.
        size: Components that a value must have; any number if None.
        where: The place that errors name; the accessor if None.

    Raises:
        AssetError: The number of values or of components does not fit.
    """
    index = attributes[name]
    where = where or source.where("accessors", index)
    old = source.accessor(index, user=where)
    if len(old) != len(refined.old):
        raise AssetError(f"{name} has {len(old)} elements for {len(refined.old)} vertices", where=where)
    if size is not None and old.shape[1:] != (size,):
        raise AssetError(f"{name} must have {size} numbers for each vertex", where=where)
    return old


def _refined_attribute(
    edited: EditedDocument, attributes: Json, name: str, refined: RefinedPrimitive, fine: Refinement, where: str
) -> tuple[Array, bool]:
    """Stored values of an attribute with those of new vertices appended, and True if they are normalised."""
    source, index = edited.source, attributes[name]
    old = old_values(source, attributes, name, refined, size=_VECTORS.get(name), where=where)
    accessor = source.items("accessors")[index]
    if name == "POSITION":
        return np.concatenate([old, fine.positions[refined.new_weld]]).astype(np.float32), False
    if name == "NORMAL":
        return refined.normals(old, fine).astype(np.float32), False
    if name == "TANGENT":
        return refined.tangents(old).astype(np.float32), False
    kind, _, number = name.partition("_")
    if kind in ("JOINTS", "WEIGHTS") and number.isdecimal() and len(number) < 4 and old.shape[1:] == (4,):
        # Values of new vertices are pruned; they do not use sets that other primitives lack.
        pruned = fine.joints_pruned if kind == "JOINTS" else fine.weights_pruned
        new = pruned[refined.new_weld - len(fine.surface.positions), 4 * int(number) : 4 * int(number) + 4]
        if kind == "JOINTS" and f"WEIGHTS_{number}" in attributes:
            old = used_joints(old, source.accessor(attributes[f"WEIGHTS_{number}"]), name)
        values = np.concatenate([old, np.pad(new, ((0, 0), (0, 4 - new.shape[1])))])
        if kind == "WEIGHTS":
            return values.astype(np.float32), False
        small = int(values.max(initial=0)) < 256 and old.dtype.itemsize == 1
        return values.astype("<u1" if small else "<u2"), False
    stored = source.stored_dtype(index)
    if stored.kind == "f":
        return np.concatenate([old, refined.mix(old)]).astype(np.float32), False
    if accessor.get("normalized"):
        limit = np.iinfo(stored).max
        return np.rint(np.concatenate([old, refined.mix(old)]) * limit).astype(stored), True
    if kind == "TEXCOORD":  # KHR_mesh_quantization
        return np.rint(np.concatenate([old, refined.mix(old)])).astype(stored), False
    # Plain integers are names of something, such as feature ids, and cannot be mixed.
    return np.concatenate([old, old[refined.heaviest()]]).astype(stored), False
