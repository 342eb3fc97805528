"""Simulate the scenes in Blender's cloth: `python simulate.py FOLDER [SEED] [SCENE]…`, by a Python that has bpy.

Each scene and cloth gives FOLDER/SCENE_CLOTH.npz: (frames, vertices, 3) positions and (frames,) seconds of processor.
A seed, a number above 0, makes the cloth uneven by a tenth of a millimetre, which is enough for it to buckle elsewhere.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from scenes import FPS, FRAMES, SCENES, Scene, Surface, share_of

# Blender's own presets: kg a vertex is set from kg/m², the stiffness of springs and bends as they are.
CLOTHS = {
    "denim": {"area": 0.45, "tension": 40.0, "shear": 40.0, "bending": 10.0, "damping": 25.0, "bend_damping": 0.5},
    "leather": {"area": 0.90, "tension": 80.0, "shear": 80.0, "bending": 150.0, "damping": 25.0, "bend_damping": 0.5},
}
QUALITY = 7  # substeps a frame
UNEVEN = 1e-4  # metres, by a seed


def add_moving(scene: Scene, surface: Surface, name: str) -> bpy.types.Object:
    """A mesh whose shape keys, one for each frame, are the skinned surface."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(surface.positions.tolist(), [], surface.quads.tolist())
    mesh.shade_smooth()
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(thing)
    thing.shape_key_add(name="rest")
    for frame in range(1, FRAMES):
        key = thing.shape_key_add(name=f"frame {frame}", from_mix=False)
        key.data.foreach_set("co", scene.posed(surface, share_of(frame)).astype(np.float32).ravel())
        for at, value in ((frame, 0.0), (frame + 1, 1.0), (frame + 2, 0.0)):
            if at == frame + 2 and frame + 1 == FRAMES:
                continue
            key.value = value
            key.keyframe_insert("value", frame=at)
    for curve in _curves(thing.data.shape_keys):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    return thing


def _curves(keys):
    action = keys.animation_data.action
    return [c for layer in action.layers for strip in layer.strips for bag in strip.channelbags for c in bag.fcurves]


def simulate(scene: Scene, cloth: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """(frames, vertices, 3) positions and (frames,) seconds."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world = bpy.context.scene
    world.render.fps, world.frame_start, world.frame_end = FPS, 1, FRAMES
    world.gravity = scene.gravity
    if scene.body is not None:
        body = add_moving(scene, scene.body, "body")
        body.modifiers.new("collision", "COLLISION")
        body.collision.thickness_outer = 0.002
        body.collision.cloth_friction = 1.0
    sheet = add_moving(scene, scene.cloth, "cloth")
    group = sheet.vertex_groups.new(name="held")
    for vertex, share in enumerate(scene.held.tolist()):
        group.add([vertex], share, "REPLACE")
    modifier = sheet.modifiers.new("cloth", "CLOTH")
    settings, touching = modifier.settings, modifier.collision_settings
    corners = scene.cloth.positions[scene.cloth.quads]
    area = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1).sum() / 2
    settings.quality = QUALITY
    settings.mass = cloth["area"] * area / len(scene.cloth.positions)
    settings.tension_stiffness = settings.compression_stiffness = cloth["tension"]
    settings.shear_stiffness, settings.bending_stiffness = cloth["shear"], cloth["bending"]
    settings.tension_damping = settings.compression_damping = settings.shear_damping = cloth["damping"]
    settings.bending_damping = cloth["bend_damping"]
    settings.vertex_group_mass = "held"
    settings.pin_stiffness = 1.0
    touching.collision_quality = 2
    touching.distance_min = 0.002
    touching.use_self_collision = True
    touching.self_distance_min = 0.0015
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 1, FRAMES
    frames, seconds = [], []
    for frame in range(1, FRAMES + 1):
        before = time.process_time()
        world.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        mesh = sheet.evaluated_get(graph).data
        points = np.zeros(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        seconds.append(time.process_time() - before)
        frames.append(points.reshape(-1, 3))
    return np.stack(frames), np.array(seconds)


def uneven(scene: Scene, seed: int) -> Scene:
    """The scene with cloth that a seed makes uneven; 0 leaves it even."""
    shift = np.random.default_rng(seed).standard_normal(scene.cloth.positions.shape) * (UNEVEN if seed else 0.0)
    return replace(scene, cloth=replace(scene.cloth, positions=scene.cloth.positions + shift))


def main() -> None:
    folder, *names = sys.argv[1:]
    seed = int(names.pop(0)) if names and names[0].isdigit() else 0
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or SCENES:
        scene = uneven(SCENES[name](), seed)
        for cloth, values in CLOTHS.items():
            positions, seconds = simulate(scene, values)
            np.savez(folder / f"{name}_{cloth}.npz", positions=positions, seconds=seconds)
            print(f"{name} {cloth}: {seconds.mean():.3f} s a frame of {positions.shape[1]} vertices", flush=True)


if __name__ == "__main__":
    main()
