"""Writes one skinned character as a glTF 2.0 binary: a mesh, its skin, morph targets and clips."""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _shapes import Floats, Ints, Mesh, triangulate, vertex_normals

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
UNSIGNED_BYTE, UNSIGNED_SHORT, FLOAT = 5121, 5123, 5126


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint; its axes are those of the world at rest.

    Attributes:
        parent: Name of the joint above; None for the root.
        position: World space at rest, metres.
    """

    name: str
    parent: str | None
    position: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Clip:
    """An animation with LINEAR keys.

    Attributes:
        times: (keys,), seconds.
        rotations: Quaternions (keys, 4) by name of joint, x y z w.
        translations: Offsets (keys, 3) from the place at rest by name of joint, metres.
        weights: (keys, morph targets), or None.
    """

    name: str
    times: Floats
    rotations: dict[str, Floats] = field(default_factory=dict)
    translations: dict[str, Floats] = field(default_factory=dict)
    weights: Floats | None = None


@dataclass(frozen=True, slots=True)
class Character:
    """The content of one sample.

    Attributes:
        name: Name of the mesh and of its node.
        mesh: Bind-space surface, relaxed.
        joints: Parents before children.
        weights: (vertices, joints); rows sum to 1, and at most four numbers of a row are above 0.
        colour: Linear RGB of the material.
        material: Name of the material.
        double_sided: True if the inside shows.
        morphs: Offsets (vertices, 3) by name of morph target, metres.
        image: PNG of the base colour, by which `colour` is multiplied; None if it is plain.
    """

    name: str
    mesh: Mesh
    joints: tuple[Joint, ...]
    weights: Floats
    clips: tuple[Clip, ...]
    colour: tuple[float, float, float]
    material: str
    roughness: float
    double_sided: bool = False
    morphs: dict[str, Floats] = field(default_factory=dict)
    image: bytes | None = None


@dataclass(slots=True)
class _Buffer:
    """The binary chunk, with the accessors and views that describe it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add_bytes(self, data: bytes) -> int:
        """Append bytes, and return the index of their view."""
        self.data.extend(b"\0" * (-len(self.data) % 4))
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data.extend(data)
        return len(self.views) - 1

    def add(self, array: NDArray[Any], *, bounds: bool = False, target: int | None = None) -> int:
        """Append an array, and return the index of its accessor."""
        self.data.extend(b"\0" * (-len(self.data) % 4))
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        if target is not None:
            view["target"] = target
        self.views.append(view)
        self.data.extend(array.astype(array.dtype.newbyteorder("<")).tobytes())
        kinds: dict[tuple[int, ...], str] = {
            (): "SCALAR",
            (2,): "VEC2",
            (3,): "VEC3",
            (4,): "VEC4",
            (4, 4): "MAT4",
        }
        components = {"float32": FLOAT, "uint16": UNSIGNED_SHORT, "uint8": UNSIGNED_BYTE}
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": components[array.dtype.name],
            "count": len(array),
            "type": kinds[array.shape[1:]],
        }
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def influences(weights: Floats) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Four joints and float32 weights (vertices, 4), heaviest first, whose sum is 1 within a rounding."""
    order = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    if order.shape[1] < 4:
        order = np.pad(order, ((0, 0), (0, 4 - order.shape[1])))
        kept = np.take_along_axis(weights, order, axis=1)
        kept[:, weights.shape[1] :] = 0.0
    else:
        kept = np.take_along_axis(weights, order, axis=1)
    kept = (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)
    kept[:, 0] = np.float32(1.0) - (kept[:, 1] + kept[:, 2] + kept[:, 3])
    return np.where(kept > 0, order, 0).astype(np.uint8), kept


def split_corners(triangles: Ints, uvs: Floats) -> tuple[Ints, Floats, Ints]:
    """Split welded vertices where texture coordinates differ, as glTF must.

    Args:
        triangles: (triangles, 3) welded vertices.
        uvs: (triangles, 3, 2).

    Returns:
        Welded vertex (vertices,) and texture coordinate (vertices, 2) of each glTF vertex, and the triangles'
        glTF vertices (triangles, 3).
    """
    # A grid of 1e-9 makes corners equal that two patches computed by different routes.
    keys = np.column_stack([triangles.ravel(), np.rint(uvs.reshape(-1, 2) * 1e9).astype(np.int64)])
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return triangles.ravel()[first], uvs.reshape(-1, 2)[first], inverse.reshape(-1, 3)


def to_glb(character: Character) -> bytes:
    """Encode a character.

    Raises:
        ValueError: A vertex has more than four joints, indices do not fit 16 bits, or the first joint is not the only
            root, as glTF wants one above all joints of a skin.
    """
    roots = [joint.name for joint in character.joints if joint.parent is None]
    if roots != [character.joints[0].name]:
        raise ValueError(f"{character.name}: not its first joint alone is a root: {', '.join(roots)}")
    triangles, corner_uvs = triangulate(character.mesh)
    owners, uvs, indices = split_corners(triangles, corner_uvs)
    if len(owners) >= 0xFFFF or np.count_nonzero(character.weights, axis=1).max() > 4:
        raise ValueError(f"{character.name}: {len(owners)} vertices, or more than four joints on one")
    positions = character.mesh.positions.astype(np.float32).astype(np.float64)
    normals = vertex_normals(positions, triangles)
    joints, weights = influences(character.weights)

    buffer = _Buffer()

    def vertices(array: NDArray[Any], *, bounds: bool = False) -> int:
        return buffer.add(array[owners], bounds=bounds, target=ARRAY_BUFFER)

    primitive: dict[str, Any] = {
        "attributes": {
            "POSITION": vertices(positions.astype(np.float32), bounds=True),
            "NORMAL": vertices(normals.astype(np.float32)),
            "TEXCOORD_0": buffer.add((uvs * [1, -1] + [0, 1]).astype(np.float32), target=ARRAY_BUFFER),
            "JOINTS_0": vertices(joints),
            "WEIGHTS_0": vertices(weights),
        },
        "indices": buffer.add(indices.ravel().astype(np.uint16), bounds=True, target=ELEMENT_ARRAY_BUFFER),
        "material": 0,
        "mode": 4,
    }
    mesh: dict[str, Any] = {"name": character.name, "primitives": [primitive]}
    if character.morphs:
        primitive["targets"] = [
            {
                "POSITION": vertices(offsets.astype(np.float32), bounds=True),
                "NORMAL": vertices((vertex_normals(positions + offsets, triangles) - normals).astype(np.float32)),
            }
            for offsets in character.morphs.values()
        ]
        mesh |= {"weights": [0.0] * len(character.morphs), "extras": {"targetNames": list(character.morphs)}}

    nodes: list[dict[str, Any]] = [{"name": character.name, "mesh": 0, "skin": 0}]
    numbers = {joint.name: number for number, joint in enumerate(character.joints, start=1)}
    places = {joint.name: np.array(joint.position) for joint in character.joints}
    offsets_at_rest = {
        joint.name: places[joint.name] - (places[joint.parent] if joint.parent else 0.0) for joint in character.joints
    }
    for joint in character.joints:
        children = [numbers[other.name] for other in character.joints if other.parent == joint.name]
        translation = [round(value, 9) for value in offsets_at_rest[joint.name].tolist()]
        nodes.append({"name": joint.name, "translation": translation} | ({"children": children} if children else {}))
    inverse_binds = np.tile(np.eye(4), (len(character.joints), 1, 1))
    # glTF keeps matrices by columns, so the translation is the last row here.
    inverse_binds[:, 3, :3] = [-places[joint.name] for joint in character.joints]

    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "wrinkle samples"},
        "scene": 0,
        # Not the name of the body, since three.js renames the second of two things with one name.
        "scenes": [{"name": "Scene", "nodes": [0, 1]}],
        "nodes": nodes,
        "meshes": [mesh],
        "skins": [
            {
                "name": character.name,
                "inverseBindMatrices": buffer.add(inverse_binds.astype(np.float32)),
                "skeleton": 1,
                "joints": list(numbers.values()),
            }
        ],
        "materials": [
            {
                "name": character.material,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*character.colour, 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": character.roughness,
                }
                | ({} if character.image is None else {"baseColorTexture": {"index": 0}}),
            }
            | ({"doubleSided": True} if character.double_sided else {})
        ],
        "animations": [_animation(clip, buffer, numbers, offsets_at_rest) for clip in character.clips],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
    }
    if character.image is not None:
        view = buffer.add_bytes(character.image)
        document |= {
            "images": [{"name": character.name, "mimeType": "image/png", "bufferView": view}],
            "samplers": [{"magFilter": 9729, "minFilter": 9987}],
            "textures": [{"source": 0, "sampler": 0}],
        }
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    return _container(document, bytes(buffer.data))


def _animation(
    clip: Clip, buffer: _Buffer, numbers: dict[str, int], offsets_at_rest: dict[str, Floats]
) -> dict[str, Any]:
    times = buffer.add(clip.times.astype(np.float32), bounds=True)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []

    def add(node: int, path: str, values: Floats) -> None:
        output = buffer.add(values.astype(np.float32))
        samplers.append({"input": times, "interpolation": "LINEAR", "output": output})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

    for name, rotations in clip.rotations.items():
        add(numbers[name], "rotation", rotations)
    for name, translations in clip.translations.items():
        add(numbers[name], "translation", offsets_at_rest[name] + translations)
    if clip.weights is not None:
        add(0, "weights", clip.weights.ravel())
    return {"name": clip.name, "channels": channels, "samplers": samplers}


def _container(document: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(data), 0x004E4942) + data
