"""The scenes as glTF, with a tool or a field each, baked: our wrinkles on the mesh that Blender simulates."""

import time
from pathlib import Path

import numpy as np
import yaml
from measure import line_normals
from scenes import FPS, FRAMES, Array, Scene, share_of

import wrinklecli
from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Asset, Json
from kit.player import Gltf


def asset_of(scene: Scene) -> Asset:
    """A skinned mesh of the scene's cloth with its movement as the clip `move`."""
    asset, cloth = Asset(), scene.cloth
    normals = line_normals(cloth.positions, cloth.quads, np.arange(len(cloth.positions))[None])[0]
    triangles = cloth.quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1)
    joints = np.tile([0, 1, 0, 0], (len(cloth.positions), 1))
    weights = np.pad(cloth.weights, ((0, 0), (0, 2)))
    attributes = {
        "POSITION": asset.accessor(cloth.positions, bounds=True, target=ARRAY_BUFFER),
        "NORMAL": asset.accessor(normals, target=ARRAY_BUFFER),
        "JOINTS_0": asset.accessor(joints, "u1", target=ARRAY_BUFFER),
        "WEIGHTS_0": asset.accessor(weights, target=ARRAY_BUFFER),
    }
    indices = asset.accessor(triangles, "u2", target=ELEMENT_ARRAY_BUFFER)
    asset.append("meshes", {"primitives": [{"attributes": attributes, "indices": indices}]})
    asset.append("nodes", {"name": "cloth", "mesh": 0, "skin": 0})
    # A bone leads from the end of the cloth to the joint that turns, as a limb has one.
    reach = -float(cloth.positions[:, 0].min())
    asset.append("nodes", {"name": "first", "translation": [-reach, 0.0, 0.0], "children": [2]})
    asset.append("nodes", {"name": "second", "translation": [reach, 0.0, 0.0]})
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[0, 3, 0] = reach  # column-major
    asset.append("skins", {"joints": [1, 2], "inverseBindMatrices": asset.accessor(binds.reshape(2, 16))})
    asset.append("scenes", {"nodes": [0, 1]})
    animation: Json = {"name": "move"}
    shares = np.array([share_of(frame) for frame in range(FRAMES)])
    times, halves = np.arange(FRAMES) / FPS, np.radians(scene.turn * shares) / 2.0
    turns = np.stack([0 * halves, 0 * halves, np.sin(halves), np.cos(halves)], axis=1)
    asset.channel(animation, 2, "rotation", times.tolist(), turns.tolist())
    slides = np.stack([reach + scene.slide * shares, 0 * shares, 0 * shares], axis=1)
    asset.channel(animation, 2, "translation", times.tolist(), slides.tolist())
    asset.append("animations", animation)
    return asset


def bake(scene: Scene, listed: Json, folder: Path) -> tuple[Gltf, float]:
    """The scene baked with the tools or fields that are listed, and the seconds that took."""
    folder.mkdir(parents=True, exist_ok=True)
    asset_of(scene).write(folder / "cloth.glb")
    refinement = {"scheme": "midpoint"}
    (folder / "tools.yaml").write_text(yaml.safe_dump({"version": 1, "refinement": refinement, **listed}))
    before = time.process_time()
    wrinklecli.bake(folder / "cloth.glb", folder / "tools.yaml", folder / "out.glb")
    return Gltf(folder / "out.glb"), time.process_time() - before


def played(file: Gltf, frames: Array) -> tuple[Array, float]:
    """(frames, vertices, 3) of the vertices that the cloth has, which keep their numbers, and seconds a frame."""
    times = np.asarray(frames) / FPS
    deltas, weights = file.deltas("cloth"), file.weights("cloth", "move", times)
    posed = file.pose("cloth", "move", times)
    # What an engine does: the weighted sum of the targets, then skinning; the second costs it the same without us.
    np.tensordot(weights[0], deltas, axes=1)  # the first of all starts the threads
    before = time.process_time()
    for each in weights:
        np.tensordot(each, deltas, axes=1)
    return posed, (time.process_time() - before) / len(times)
