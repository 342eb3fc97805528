"""What a user of Blender does today for wrinkles in a game: a shape key for each frame.

    python tests/benchmarks/blender_keyshapes.py ASSET.glb TOOLS.json OUT.glb --clip CLIP [--fps FPS] [--whole]

By a Python that can import bpy, such as that of blender.sh. TOOLS.json lists segments:
[{"origin": [x, y, z], "target": [x, y, z], "width": w, "bumps": n}, …], rest pose, metres, Y up.

1. Imports the asset, with the option Merge Vertices, lest the surface crack at UV seams.
2. Subdivides once those faces alone that a segment's rectangle covers and that face the same way; with --whole, all
   faces, as one does who does not select any.
3. At each frame of the clip measures the segments on the posed mesh, and displaces the subdivided vertices along their
   normals by a wave of so many bumps, as high as the lost length makes it and at most a quarter of a bump's width. The
   result is a shape key: 1 at its frame and 0 at the two beside it.
4. Exports with the exporter's defaults: sparse accessors where they are smaller, normals of shape keys included.

It is kind to Blender: by hand, or by a Displace modifier that is applied at each frame, the keys take longer; here the
displacement is a few products of arrays, and half of the time or more goes into the export.

The rest pose must be the bind pose, and the character one mesh.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import bmesh  # isort: skip: it comes with bpy, once that is imported

Floats = NDArray[np.float64]


def column(collection: Any, name: str, width: int) -> Floats:
    """(count, width) values of a property of all members of a collection."""
    values = np.zeros(width * len(collection), np.float32)
    collection.foreach_get(name, values)
    return values.reshape(-1, width).astype(np.float64)


class Segment:
    """A segment across the wrinkles: in Blender's axes, bind space."""

    def __init__(self, tool: dict[str, Any]) -> None:
        (x, y, z), (a, b, c) = tool["origin"], tool["target"]
        self.ends = np.array([[x, -z, y], [a, -c, b]])
        self.half = tool["width"] / 2.0
        self.bumps = tool["bumps"]

    def attach(self, body: Any) -> None:
        """Choose the nearest vertices as anchors, and the patch's axes; the mesh has its last topology."""
        positions = column(body.data.vertices, "co", 3)
        self.anchors = [int(np.linalg.norm(positions - end, axis=1).argmin()) for end in self.ends]
        self.rest = math.dist(*positions[self.anchors])
        normals = column(body.data.vertex_normals, "vector", 3)
        u, v = self.place(positions, normals[self.anchors])
        bell = np.clip(1.0 + (-4.0 * v**6 + 17.0 * v**4 - 22.0 * v**2) / 9.0, 0.0, 1.0)
        t = np.clip((normals @ self.normal - 0.2) / 0.4, 0.0, 1.0)
        inside = (u > 0.0) & (u < 1.0) & (np.abs(v) < 1.0)
        wave = np.where(inside, np.sin(np.pi * self.bumps * u) ** 2 * bell * t * t * (3.0 - 2.0 * t), 0.0)
        self.shape = normals * wave[:, None]

    def place(self, points: Floats, normals: Floats) -> tuple[Floats, Floats]:
        """Coordinates u along the segment and v across of points (n, 3); the anchors' normals (2, 3) give the plane."""
        along = self.ends[1] - self.ends[0]
        length = float(np.linalg.norm(along))
        axis = along / length
        mean = normals.sum(axis=0)
        mean -= (mean @ axis) * axis
        self.normal = mean / np.linalg.norm(mean)
        offsets = points - self.ends[0]
        return offsets @ axis / length, offsets @ np.cross(axis, self.normal) / self.half

    def covered(self, body: Any) -> NDArray[np.bool_]:
        """(faces,) that the rectangle covers, wholly or at a corner, and that face its way."""
        mesh = body.data
        positions = column(mesh.vertices, "co", 3)
        near = [int(np.linalg.norm(positions - end, axis=1).argmin()) for end in self.ends]
        u, v = self.place(positions, column(mesh.vertex_normals, "vector", 3)[near])
        inside = (u >= 0.0) & (u <= 1.0) & (np.abs(v) <= 1.0)
        corners = column(mesh.loops, "vertex_index", 1)[:, 0].astype(int)
        starts = column(mesh.polygons, "loop_start", 1)[:, 0].astype(int)
        touched = np.logical_or.reduceat(inside[corners], starts)
        return touched & (column(mesh.polygons, "normal", 3) @ self.normal > 0.0)

    def height(self, length: float) -> float:
        """Of each bump, where the anchors are at a distance."""
        interval = length / (2.0 * self.bumps)
        lost = max(self.rest - length, 0.0) / self.bumps
        return min(math.sqrt(lost * interval + lost * lost / 4.0), 0.25 * self.rest / self.bumps)


def subdivide(body: Any, faces: NDArray[np.bool_]) -> None:
    """Split each edge of some faces in two."""
    edit = bmesh.new()
    edit.from_mesh(body.data)
    edit.faces.ensure_lookup_table()
    edges = {edge for index in np.nonzero(faces)[0].tolist() for edge in edit.faces[index].edges}
    bmesh.ops.subdivide_edges(edit, edges=list(edges), cuts=1, use_grid_fill=True, smooth=1.0)
    edit.to_mesh(body.data)
    edit.free()


def play(owner: Any, action: Any, kind: str) -> Any:
    """Make an action the only one of an object, or of its shape keys; its animation."""
    animation = owner.animation_data or owner.animation_data_create()
    for track in animation.nla_tracks:
        track.mute = True
    animation.action = action
    slot = next((each for each in action.slots if each.target_id_type == kind), None)
    animation.action_slot = slot or action.slots.new(kind, owner.name)
    return animation


def main(asset: Path, tools: Path, out: Path, clip: str, *, fps: int, whole: bool) -> None:
    """Import, subdivide, displace, key, export."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = fps
    bpy.ops.import_scene.gltf(filepath=str(asset), merge_vertices=True)
    skinned = [each for each in bpy.data.objects if each.type == "MESH" and each.find_armature()]
    (body,) = skinned
    action = bpy.data.actions[clip]
    play(body.find_armature(), action, "OBJECT")

    segments = [Segment(tool) for tool in json.loads(tools.read_text(encoding="utf-8"))]
    covered = np.logical_or.reduce([each.covered(body) for each in segments])
    subdivide(body, covered | whole)
    for segment in segments:
        segment.attach(body)
    positions = column(body.data.vertices, "co", 3)

    body.shape_key_add(name="Basis", from_mix=False)
    play(body.data.shape_keys, action, "KEY")
    first, last = (round(frame) for frame in action.frame_range)
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices
        moved = positions.copy()
        for segment in segments:
            origin, target = (posed[index].co for index in segment.anchors)
            moved += segment.height((target - origin).length) * segment.shape
        key = body.shape_key_add(name=f"frame_{frame}", from_mix=False)
        key.data.foreach_set("co", moved.astype(np.float32).reshape(-1))
        for each, value in ((frame - 1, 0.0), (frame, 1.0), (frame + 1, 0.0)):
            if first <= each <= last:
                key.value = value
                key.keyframe_insert("value", frame=each)
        key.value = 0.0
    bpy.ops.export_scene.gltf(filepath=str(out), export_format="GLB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("asset", "tools", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--clip", required=True)
    parser.add_argument("--fps", type=int, default=30)
    parser.add_argument("--whole", action="store_true", help="subdivide all faces, not those of the patches alone")
    options = parser.parse_args()
    main(options.asset, options.tools, options.out, options.clip, fps=options.fps, whole=options.whole)
