"""Larger versions of assets: longer clips, more of them, more joints, finer meshes."""

import copy
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.surface import read_triangles
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import INDEX_DATA, VERTEX_DATA, EditedDocument, index_type
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.arrays import unit

Floats = NDArray[np.float64]


def longer(asset: Path, out: Path, seconds: float) -> Path:
    """Write an asset whose clips are repeated until each is at least as long; only the first clip is kept.

    One clip, so that its frames are the bake's.
    """
    document = read_document(asset)
    edited = EditedDocument(document)
    del edited.gltf["animations"][1:]
    for sampler in edited.gltf["animations"][0]["samplers"]:
        times, values = (document.accessor(sampler[key]).astype(np.float32) for key in ("input", "output"))
        step = times[1] - times[0]
        period = float(times[-1] + step)
        count = int(np.ceil(seconds / period))
        repeated = np.concatenate([times + k * period for k in range(count)])
        kept = int(np.searchsorted(repeated, seconds)) + 1
        each = len(values) // len(times)
        tiled = np.tile(values, (count, *[1] * (values.ndim - 1)))
        sampler["input"] = edited.add(repeated[:kept], bounds=True, replaces=sampler["input"])
        sampler["output"] = edited.add(tiled[: kept * each], replaces=sampler["output"])
    write(edited, out)
    return out


def more_clips(asset: Path, out: Path, count: int) -> Path:
    """Write an asset with as many clips, its own in turn, each of another length."""
    document = read_document(asset)
    edited = EditedDocument(document)
    own = edited.gltf["animations"]
    clips = [copy.deepcopy(own[k % len(own)]) for k in range(count)]
    for k, clip in enumerate(clips):
        clip["name"] = f"{clip.get('name')}_{k}"
        for sampler in clip["samplers"]:
            times = document.accessor(sampler["input"]) * (0.5 + 1.5 * k / count)
            sampler["input"] = edited.add(times.astype(np.float32), bounds=True)
    edited.gltf["animations"] = clips
    write(edited, out)
    return out


def more_joints(asset: Path, out: Path) -> Path:
    """Write an asset with a child at the place of each joint of its first skin, which takes half of the joint's weight.

    Such joints, for twists and the like, double the motions to look at. Vertices keep their two heaviest joints.
    """
    document = read_document(asset)
    edited = EditedDocument(document)
    (skin,) = edited.gltf["skins"]
    joints, nodes = list(skin["joints"]), edited.gltf["nodes"]
    for joint in joints:
        nodes[joint] = {**nodes[joint], "children": [*nodes[joint].get("children", ()), len(nodes)]}
        nodes.append({"name": f"{nodes[joint]['name']}Half"})
        skin["joints"] = [*skin["joints"], len(nodes) - 1]
    binds = document.accessor(skin["inverseBindMatrices"])
    skin["inverseBindMatrices"] = edited.add(np.concatenate([binds, binds]).astype(np.float32))
    for mesh in edited.gltf["meshes"]:
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            numbers, weights = (document.accessor(attributes[name]) for name in ("JOINTS_0", "WEIGHTS_0"))
            heaviest = np.argsort(-weights, axis=1, kind="stable")[:, :2]
            numbers = np.take_along_axis(numbers, heaviest, axis=1).astype(np.uint16)
            weights = np.take_along_axis(weights, heaviest, axis=1).astype(np.float32)
            weights /= 2.0 * weights.sum(axis=1, keepdims=True)
            # A joint without weight has the number 0.
            twins = np.where(weights > 0, numbers + len(joints), 0).astype(np.uint16)
            attributes["JOINTS_0"] = edited.add(np.concatenate([numbers, twins], axis=1), target=VERTEX_DATA)
            attributes["WEIGHTS_0"] = edited.add(np.concatenate([weights, weights], axis=1), target=VERTEX_DATA)
    write(edited, out)
    return out


def finer(asset: Path, out: Path, *, keep: tuple[Floats, float], rounds: int) -> Path:
    """Write an asset with each triangle of its first mesh split in four, round by round, but near a place.

    Where split and whole triangles meet their edges do not: the file is for timing, not for looking at.

    Args:
        asset: To read.
        out: To write.
        keep: Centre (3,) and radius, bind space: triangles with a vertex inside stay whole.
        rounds: How many times; each is four times as many triangles.
    """
    document = read_document(asset)
    edited = EditedDocument(document)
    centre, radius = keep
    for number, primitive in enumerate(edited.gltf["meshes"][0]["primitives"]):
        attributes = primitive["attributes"]
        values = {name: document.accessor(index) for name, index in attributes.items()}
        count = len(values["POSITION"])
        triangles = read_triangles(document, primitive, count, document.where("meshes", 0, "primitives", number))
        near = np.linalg.norm(values["POSITION"] - centre, axis=1) < radius
        whole = near[triangles].any(axis=1)
        kept, split = triangles[whole], triangles[~whole]
        for _ in range(rounds):
            ends = np.sort(split[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
            edges, which = np.unique(ends, axis=0, return_inverse=True)
            middles = len(values["POSITION"]) + which.reshape(-1, 3)
            values = {name: np.concatenate([each, _between(name, each, edges)]) for name, each in values.items()}
            (a, b, c), (ab, bc, ca) = split.T, middles.T
            split = np.concatenate(
                [np.stack(each, axis=1) for each in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
            )
        for name, index in list(attributes.items()):
            dtype = np.dtype("<u2") if name.startswith("JOINTS") else np.dtype("<f4")
            attributes[name] = edited.add(
                values[name].astype(dtype), target=VERTEX_DATA, bounds=name == "POSITION", replaces=index
            )
        indices = np.concatenate([kept, split]).reshape(-1)
        primitive["indices"] = edited.add(
            indices.astype(index_type(len(values["POSITION"]))), target=INDEX_DATA, replaces=primitive.get("indices")
        )
    write(edited, out)
    return out


def _between(name: str, values: Floats, edges: NDArray[np.intp]) -> Floats:
    first, second = values[edges[:, 0]], values[edges[:, 1]]
    if name.startswith(("JOINTS", "WEIGHTS")):
        return first
    mixed = (first.astype(np.float64) + second) / 2.0
    return unit(mixed) if name == "NORMAL" else mixed
