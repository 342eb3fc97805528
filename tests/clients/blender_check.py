"""Holds a baked file in Blender against the player of the tests. Run by hand: Blender is 370 MB, too much for CI.

In a virtual environment of Python 3.11:

    pip install bpy -e '.[test]'
    PYTHONPATH=tests python tests/clients/blender_check.py BAKED.glb NODE CLIP [FPS]

Prints the greatest distance of a vertex at times of the clip, scene units; above 1e-5 of the mesh's size it fails.

FPS is that of the Blender scene, 1000 where left out: Blender takes keys less than a hundredth of a frame apart for
one. No two keys of a bake are so close, at 24 frames per second neither.

Seen with Blender 5.0.1: within 3e-7 of wrist, head and trousers of the samples, at 24, 60 and 1000 frames per second,
and of a limb with contact; of touch, in which a finger drags skin, at 24.
"""

import sys
from functools import reduce
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from kit.player import Gltf

Floats = NDArray[np.float64]

# Blender evaluates in float32, and bends joints by dual steps of it: rest, pose, and their product.
_TOLERANCE = 1e-5


def play(owner: Any, clip: str) -> Any:
    """Make a clip the only action of an object or of its shape keys; the action."""
    animation = owner.animation_data
    if animation is None:
        return None
    for track in animation.nla_tracks:
        track.mute = True
    slots = {"Key": "KEY", "Object": "OBJECT"}
    kind = slots[type(owner).__name__]
    action = bpy.data.actions[clip]
    slot = next((each for each in action.slots if each.target_id_type == kind), None)
    animation.action = action if slot else None
    if slot:
        animation.action_slot = slot
    return action


def shown(body: Any, frame: float) -> Floats:
    """(vertices, 3) world-space positions at a frame, y up as in glTF."""
    bpy.context.scene.frame_set(int(frame // 1), subframe=float(frame % 1))
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found = np.zeros(3 * len(evaluated.data.vertices), np.float32)
    evaluated.data.vertices.foreach_get("co", found)
    matrix = np.array(evaluated.matrix_world, np.float64)
    x, y, z = (found.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]).T
    return np.stack([x, z, -y], axis=1)


def main(path: Path, node: str, clip: str, fps: int) -> int:
    """Compare; the exit code."""
    file = Gltf(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = fps
    bpy.ops.import_scene.gltf(filepath=str(path), merge_vertices=False)
    names = [*file.mesh(node)["extras"]["targetNames"]]
    body = next(
        each
        for each in bpy.data.objects
        if each.type == "MESH"
        and each.data.shape_keys
        and [key.name for key in each.data.shape_keys.key_blocks][1:] == names
    )
    # What a clip does not move keeps its last pose: that of the first clip's begin, not of the frame after it.
    bpy.context.scene.frame_set(0)
    keyed = play(body.data.shape_keys, clip)
    for each in bpy.data.objects:
        if each.type == "ARMATURE":
            play(each, clip)
    times, _ = file.keys(clip, node)
    # Between keys Blender mixes the four numbers of a rotation one by one, where glTF asks for the great circle.
    turns = [
        file.array(sampler["input"])[:, 0]
        for channel in file.clip(clip)["channels"]
        for sampler in [file.clip(clip)["samplers"][channel["sampler"]]]
        if channel["target"]["path"] == "rotation"
    ]
    compared = reduce(np.intersect1d, turns) if turns else np.linspace(times[0], times[-1], 13)
    start = keyed.frame_range[0] - times[0] * fps
    worst = 0.0
    for time in compared:
        wanted = file.pose(node, clip, [time])[0]
        found = shown(body, start + time * fps)
        gap = float(np.linalg.norm(found - wanted, axis=1).max())
        worst = max(worst, gap / float(np.abs(wanted).max()))
        print(f"{time:8.3f} s  {gap:.3g}")
    return int(worst > _TOLERANCE)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], sys.argv[3], int((sys.argv[4:] or ["1000"])[0])))
