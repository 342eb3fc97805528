"""Welds a mesh's primitives to one surface in bind space.

glTF splits vertices at UV and normal seams. Topology, normals and displacement work on welded vertices, so that each
point of the artist's mesh moves as one.
"""

from collections.abc import Mapping
from functools import cached_property, partial
from itertools import count, pairwise
from typing import Any

import numpy as np

from wrinklecli.character.rig import LARGEST, Rig, in_range
from wrinklecli.character.skin import Influences, SkinnedMesh, skinned_mesh
from wrinklecli.character.weld import weld
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import EVERY, TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES, Document, Rows
from wrinklecli.gltf.shape import DRACO, Json
from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints, diagonal, flags_of, joined

# Bytes of a morph target's delta of a vertex, three float64.
_DELTA_BYTES = 24
# Most sets of four joints of a vertex: several may be one accessor, so that a small file could ask for any memory.
_MOST_SETS = 16


@dataclass(frozen=True)
class Surface:
    """The triangles of a mesh over welded vertices, bind space.

    Attributes:
        positions: (vertices, 3) stored positions.
        morph_deltas: (morph targets, vertices, 3).
        joints: (vertices, influences) indices into the rig's joints.
        weights: (vertices, influences), rows summing to 1, padded by 0.
        normals: (glTF vertices, 3) stored normals; 0 if a primitive has none.
        triangles: (triangles, 3) welded vertices.
        corners: (triangles, 3) the glTF vertices of the same corners.
        primitives: (triangles,) the primitive of each.
        weld: (glTF vertices,) the welded vertex of each; primitives follow one another.
        vertex_starts: (primitives + 1,) the first glTF vertex of each primitive.
        twins: (vertices,) True if another welded vertex, which moves differently, lies at the same place.
    """

    positions: Floats
    morph_deltas: Floats
    joints: Ints
    weights: Floats
    normals: Floats
    triangles: Ints
    corners: Ints
    primitives: Ints
    weld: Ints
    vertex_starts: Ints
    twins: Bools

    @cached_property
    def size(self) -> float:
        """Diagonal of the bounding box, bind units."""
        return diagonal(self.positions)

    @cached_property
    def heaviest(self) -> Ints:
        """(vertices,) the joint of the greatest weight of each, an index into the rig's joints."""
        return np.asarray(self.joints[np.arange(len(self.joints)), self.weights.argmax(axis=1)])

    def dense_weights(self, vertices: Ints, joint_count: int) -> Floats:
        """(vertices, joints) skin weights of some vertices."""
        return dense_influences(self.joints.take(vertices, axis=0), self.weights.take(vertices, axis=0), joint_count)

    def influences(self, joint_count: int) -> Influences:
        """The skin weights of all vertices, by their joints."""
        return Influences(self.joints.T, self.weights.T, joint_count)

    def skinned(self, rig: Rig) -> SkinnedMesh:
        """The surface as a rig moves it."""
        return skinned_mesh(rig, self.influences(len(rig.joints)), self.positions, self.morph_deltas, self.triangles)


def read_surface(document: Document, rig: Rig) -> Surface:
    """Weld the primitives of a rig's mesh, as `weld` tells.

    Raises:
        AssetError: An attribute is missing, malformed or not finite, or there is no triangle.
    """
    vertices = read_vertices(document, rig)
    parts = _triangle_parts(document, rig, vertices)
    corners = joined(parts)
    if not len(corners):
        raise AssetError("has no triangles", where=document.where("meshes", rig.mesh))
    welded = weld(vertices.positions, vertices.morph_deltas, vertices.joints, vertices.weights, vertices.seen(corners))
    return Surface(
        # `take` copies whole rows, three times as fast as an index does.
        positions=vertices.positions.take(welded.models, axis=0),
        morph_deltas=vertices.morph_deltas[:, welded.models],
        joints=vertices.joints.take(welded.models, axis=0),
        weights=vertices.weights.take(welded.models, axis=0),
        normals=np.zeros_like(vertices.positions) if vertices.normals is None else vertices.normals,
        triangles=welded.points[corners],
        corners=corners,
        primitives=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
        weld=welded.points,
        vertex_starts=vertices.starts,
        twins=welded.twins,
    )


@dataclass(frozen=True, slots=True)
class Vertices:
    """The glTF vertices of a mesh, primitive after primitive, bind space.

    Attributes:
        starts: (primitives + 1,) the first vertex of each primitive.
        positions: (vertices, 3).
        morph_deltas: (morph targets, vertices, 3).
        joints: (vertices, influences) distinct sorted indices into the rig's joints.
        weights: (vertices, influences), rows summing to 1.
        normals: (vertices, 3); None if a primitive has none.
        normal_deltas: (morph targets, vertices, 3); None if a primitive has no normals.
    """

    starts: Ints
    positions: Floats
    morph_deltas: Floats
    joints: Ints
    weights: Floats
    normals: Floats | None
    normal_deltas: Floats | None

    def seen(self, triangles: Ints) -> Bools:
        """(vertices,) True for those of (triangles, 3), and for all of a primitive that has none, as of points."""
        seen = flags_of(triangles.ravel(), len(self.positions))
        for first, end in pairwise(self.starts.tolist()):
            seen[first:end] |= not seen[first:end].any()
        return seen


def read_vertices(
    document: Document, rig: Rig, chosen: Mapping[int, Ints] | None = None, *, targets: int | None = None
) -> Vertices:
    """Read the vertices of a rig's mesh, or chosen ones, with all or the first `targets` morph targets.

    Args:
        document: The asset.
        rig: Of the mesh's node.
        chosen: (rows,) numbers of the vertices to read of each primitive that counts; None for all.
        targets: The number of morph targets to read.

    Raises:
        AssetError: An attribute is missing, malformed or not finite.
    """
    primitives = document.items("meshes")[rig.mesh].get("primitives", [])
    where = document.where("meshes", rig.mesh)
    if not primitives:
        raise AssetError("has no primitives", where=where)
    rows: Mapping[int, Rows] = dict.fromkeys(range(len(primitives)), EVERY) if chosen is None else chosen
    parts = [
        read_primitive(document, primitives[number], rig, f"{where}/primitives/{number}", targets=targets, rows=each)
        for number, each in rows.items()
    ]
    most = max(part.joints.shape[1] for part in parts)

    def padded(rows: Array) -> Array:
        return rows if rows.shape[1] == most else np.pad(rows, ((0, 0), (0, most - rows.shape[1])))

    normals = [part.normals for part in parts if part.normals is not None]
    deltas = [part.normal_deltas for part in parts if part.normal_deltas is not None]
    complete = len(normals) == len(parts)
    return Vertices(
        starts=np.cumsum([0] + [len(part.positions) for part in parts]),
        positions=joined([part.positions for part in parts]),
        morph_deltas=joined([part.morph_deltas for part in parts], axis=1),
        joints=joined([padded(part.joints) for part in parts]),
        weights=joined([padded(part.weights) for part in parts]),
        normals=joined(normals) if complete else None,
        normal_deltas=joined(deltas, axis=1) if complete else None,
    )


def read_primitive(
    document: Document, primitive: Json, rig: Rig, where: str, *, targets: int | None = None, rows: Rows = EVERY
) -> Vertices:
    """Read the vertices of one primitive of a rig's mesh, or some, with all or the first `targets` morph targets.

    Raises:
        AssetError: An attribute is missing, malformed or not finite.
    """
    attributes = primitive.get("attributes", {})
    positions = read_positions(document, primitive, where, rows)
    count = document.element_count(attributes["POSITION"])
    stored = primitive.get("targets", [])
    if len(stored) != len(rig.morph_weights):
        raise AssetError(f"has {len(stored)} morph targets, others have {len(rig.morph_weights)}", where=where)
    chosen = stored[:targets]
    kinds = 1 + ("NORMAL" in attributes)
    document.claim_unstored(
        _DELTA_BYTES * kinds * len(chosen) * count, f"{len(chosen)} morph targets of {count} vertices", where=where
    )
    attribute = partial(_attribute, document, count=count, size=3, rows=rows)

    def deltas_of(name: str) -> Floats:
        deltas = np.zeros((len(chosen), len(positions), 3))
        for index, target in enumerate(chosen):
            if name in target:
                deltas[index] = attribute(target, name, where=f"{where}/targets/{index}")
        return deltas

    joints, weights = read_influences(document, primitive, rig, count, where, rows)
    has_normals = "NORMAL" in attributes
    return Vertices(
        starts=np.array([0, len(positions)]),
        # Adding 0 turns -0 into 0, as both are the same place.
        positions=positions + 0.0,
        morph_deltas=deltas_of("POSITION"),
        joints=joints,
        weights=weights,
        normals=attribute(attributes, "NORMAL", where=where) if has_normals else None,
        normal_deltas=deltas_of("NORMAL") if has_normals else None,
    )


def read_positions(document: Document, primitive: Json, where: str, rows: Rows = EVERY) -> Floats:
    """(rows, 3) stored positions of a primitive; AssetError if they are missing, malformed or not finite."""
    attributes = primitive.get("attributes", {})
    if "POSITION" not in attributes:
        raise AssetError("has no POSITION", where=where)
    count = document.element_count(attributes["POSITION"], user=where)
    return np.asarray(_attribute(document, attributes, "POSITION", count=count, size=3, where=where, rows=rows))


def _attribute(
    document: Document, attributes: Json, name: str, *, count: int, size: int, where: str, rows: Rows = EVERY
) -> Any:
    chosen = document.accessor(attributes[name], user=where, rows=rows)
    if chosen.shape[1:] != (size,) or document.element_count(attributes[name]) != count:
        message = f"{name} (accessor {attributes[name]}) must hold {size} numbers for {count} vertices"
        raise AssetError(message, where=where)
    if not in_range(chosen):
        with np.errstate(invalid="ignore"):
            first = int(np.arange(count)[rows][np.argmin((np.abs(chosen) <= LARGEST).all(axis=1))])
        message = f"{name} (accessor {attributes[name]}) of vertex {first} is not a finite number, or above {LARGEST:g}"
        raise AssetError(message, where=where)
    return chosen


def influence_sets(attributes: Json) -> int:
    """Number of sets of four joints and weights of a primitive, JOINTS_0 and so on."""
    return next(sets for sets in count() if not {f"JOINTS_{sets}", f"WEIGHTS_{sets}"} <= attributes.keys())


def read_influences(
    document: Document, primitive: Json, rig: Rig, count: int, where: str, rows: Rows = EVERY
) -> tuple[Ints, Floats]:
    """(vertices, influences) distinct sorted joints, and their normalised weights, padded by 0.

    A vertex without weight follows its first joint, as in three.js; an unskinned one follows the node.

    Raises:
        AssetError: Joints or weights are missing or malformed.
    """
    if not rig.skinned:
        chosen = len(np.arange(count)[rows])
        return np.zeros((chosen, 1), np.intp), np.ones((chosen, 1))
    attributes, joint_count = primitive.get("attributes", {}), len(rig.joints)
    sets = influence_sets(attributes)
    if sets > _MOST_SETS:
        raise AssetError(f"has {sets} sets of joints; at most {_MOST_SETS} are read", where=where)
    if not sets:
        raise AssetError("belongs to a skinned node but has no JOINTS_0 and WEIGHTS_0", where=where)
    attribute = partial(_attribute, document, attributes, count=count, size=4, where=where, rows=rows)
    parts = ([attribute(f"{kind}_{number}") for number in range(sets)] for kind in ("JOINTS", "WEIGHTS"))
    joints = np.concatenate(next(parts), axis=1, dtype=np.intp, casting="unsafe")
    weights = np.concatenate(next(parts), axis=1, dtype=np.float64)
    np.maximum(weights, 0.0, out=weights)
    beyond = (joints < 0) | (joints >= joint_count)
    if (weights[beyond] > 0).any():
        raise AssetError(f"JOINTS refer to joint {joints[beyond & (weights > 0)][0]} of {joint_count}", where=where)
    firsts = joints[:, 0].copy()
    joints, weights = _by_joint(joints, weights, joint_count)
    repeats = (joints[:, 1:] == joints[:, :-1]) & (weights[:, 1:] > 0)
    if repeats.any():
        rows = np.flatnonzero(repeats.any(axis=1))
        for column, repeated in enumerate(repeats.T):
            weights[repeated, column + 1] += weights[repeated, column]
            weights[repeated, column] = 0.0
        joints[rows], weights[rows] = _by_joint(joints[rows], weights[rows], joint_count)
    alone = np.flatnonzero(weights[:, 0] == 0)
    joints[alone, 0], weights[alone, 0] = np.clip(firsts[alone], 0, joint_count - 1), 1.0
    weights /= weights.sum(axis=1, keepdims=True)
    return joints, weights


def _by_joint(joints: Ints, weights: Floats, joint_count: int) -> tuple[Ints, Floats]:
    """(vertices, influences) joints and weights, sorted by the joint; those without weight are of joint 0, and last."""
    bits = (joints.shape[1] - 1).bit_length()
    # Joints are sorted together with their places, as sorting these apart takes twice as long.
    keys = np.where(weights > 0, joints, joint_count)
    keys <<= bits
    keys += np.arange(joints.shape[1])
    keys.sort(axis=1)
    joints, places = keys >> bits, np.bitwise_and(keys, (1 << bits) - 1, out=keys)
    joints[joints == joint_count] = 0
    return joints, np.take_along_axis(weights, places, 1)


def read_triangles(document: Document, primitive: Json, count: int, where: str) -> Ints:
    """(triangles, 3) vertices of a primitive; none for points and lines. Strips and fans become triangles."""
    mode = primitive.get("mode", TRIANGLES)
    if mode not in (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN):
        return np.zeros((0, 3), np.intp)
    if "indices" in primitive:
        stored = document.accessor(primitive["indices"], user=where)
        if stored.ndim != 1 or stored.dtype.kind != "u" or int(stored.max(initial=0)) >= count:
            raise AssetError(f"indices must be whole numbers below {count}", where=where)
        indices = stored.astype(np.intp)
    else:
        indices = np.arange(count)
    # A Draco stream always holds triangles, even if the mode says strip.
    if mode == TRIANGLES or DRACO in primitive.get("extensions", {}):
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if len(indices) < 3:
        return np.zeros((0, 3), np.intp)
    first, second, third = indices[:-2], indices[1:-1], indices[2:]
    if mode == TRIANGLE_FAN:
        return np.stack([second, third, np.broadcast_to(indices[0], second.shape)], axis=1)
    odd = np.arange(len(first)) % 2 == 1
    return np.stack([first, np.where(odd, third, second), np.where(odd, second, third)], axis=1)


def read_all_triangles(document: Document, rig: Rig, vertices: "Vertices") -> Ints:
    """Read the (triangles, 3) glTF vertices of the triangles of a rig's mesh, which has none perhaps.

    Raises:
        AssetError: An index is malformed.
    """
    return joined(_triangle_parts(document, rig, vertices))


def _triangle_parts(document: Document, rig: Rig, vertices: "Vertices") -> list[Ints]:
    """The (triangles, 3) glTF vertices of each primitive's triangles."""
    primitives = document.items("meshes")[rig.mesh]["primitives"]
    counts = np.diff(vertices.starts)
    where = document.where("meshes", rig.mesh)
    parts = [
        read_triangles(document, primitive, int(count), f"{where}/primitives/{index}")
        for index, (primitive, count) in enumerate(zip(primitives, counts, strict=True))
    ]
    for part, start in zip(parts, vertices.starts, strict=False):
        part += start
    return parts


def dense_influences(joints: Ints, weights: Floats, joint_count: int) -> Floats:
    """(vertices, joints) skin weights from (vertices, influences) joints and weights."""
    dense = np.zeros((len(joints), joint_count))
    every = np.arange(len(dense))
    # A padded joint has no weight, so those before it overwrite it.
    for column, shares in zip(joints.T[::-1], weights.T[::-1], strict=True):
        dense[every, column] = shares
    return dense


def influence_count(document: Document, rig: Rig) -> int:
    """Number of joints that every primitive of a rig's mesh can store for a vertex: 4 for each JOINTS_n."""
    if not rig.skinned:
        return 1
    primitives = document.items("meshes")[rig.mesh]["primitives"]
    return 4 * min(influence_sets(each["attributes"]) for each in primitives)


def has_triangles(document: Document, mesh: int) -> bool:
    """True if any primitive of a mesh has triangles; others have points or lines."""
    for number, primitive in enumerate(document.items("meshes")[mesh].get("primitives", [])):
        where = document.where("meshes", mesh, "primitives", number)
        stored = primitive.get("attributes", {}).get("POSITION")
        count = len(document.accessor(stored, user=where)) if stored is not None else 0
        if len(read_triangles(document, primitive, count, where)):
            return True
    return False
