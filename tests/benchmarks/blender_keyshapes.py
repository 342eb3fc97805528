"""What a user of Blender does today for wrinkles in a game: a shape key for each frame.

    python tests/benchmarks/blender_keyshapes.py ASSET.glb TOOLS.json OUT.glb --clip CLIP [--fps FPS] [--operators]

By a Python that can import bpy, such as that of blender.sh. TOOLS.json lists segments:
[{"origin": [x, y, z], "target": [x, y, z], "width": w, "bumps": n}, …], rest pose, metres, Y up.

1. Imports the asset, with the option Merge Vertices, lest the surface crack at UV seams.
2. Subdivides once.
3. At each frame of the clip measures the segments on the posed mesh, and displaces the subdivided vertices along their
   normals by a wave of so many bumps, as high as the lost length makes it and at most a quarter of a bump's width. The
   result is a shape key: 1 at its frame and 0 at the two beside it.
4. Exports with the exporter's defaults: sparse accessors where they are smaller, normals of shape keys included.

With --operators it does steps 2 and 3 as an artist does, by Blender's tools: Subdivide in Edit mode, all selected; a
vertex group and a Displace modifier for each segment; and Join as Shapes. The modifiers are those of a copy that no
armature poses, so that keys are unposed, one for a frame, however many the segments. Apply as Shape Key, which
published scripts call at each frame, takes one modifier at a time, and none of strength 0; where there are two, artists
apply each, make New Shape from Mix of these keys and remove them. The keys are the same and take several times as long,
so that the quicker tool is measured. This script sets the weights and strengths that an artist would paint and type.
What is slow is the export, above all of the keys' normals, which it works out for each corner of four times the faces.

Without, which is measured beside it, it is kinder still to Blender, and quicker: it subdivides those faces alone that a
segment's rectangle covers and that face the same way, and a key is a few products of arrays.

The rest pose must be the bind pose, and the character one mesh.
"""

import argparse
import json
import math
from collections.abc import Iterable, Iterator
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
        self.wave = np.where(inside, np.sin(np.pi * self.bumps * u) ** 2 * bell * t * t * (3.0 - 2.0 * t), 0.0)

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


def subdivide(body: Any, segments: list[Segment]) -> None:
    """Split each edge of the segments' faces in two."""
    faces = np.logical_or.reduce([each.covered(body) for each in segments])
    edit = bmesh.new()
    edit.from_mesh(body.data)
    edit.faces.ensure_lookup_table()
    edges = {edge for index in np.nonzero(faces)[0].tolist() for edge in edit.faces[index].edges}
    bmesh.ops.subdivide_edges(edit, edges=list(edges), cuts=1, use_grid_fill=True, smooth=1.0)
    edit.to_mesh(body.data)
    edit.free()


def subdivide_all(body: Any) -> None:
    """The same of all faces, by Blender's tools; selects the body alone."""
    bpy.ops.object.select_all(action="DESELECT")
    body.select_set(True)
    bpy.context.view_layer.objects.active = body
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=1, smoothness=1.0)
    bpy.ops.object.mode_set(mode="OBJECT")


def measured(body: Any, segments: list[Segment], frames: Iterable[int]) -> Iterator[list[float]]:
    """The segments' heights at each frame, which becomes the scene's."""
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices
        yield [each.height(math.dist(*(posed[index].co for index in each.anchors))) for each in segments]


def multiplied(body: Any, segments: list[Segment], heights: Iterable[list[float]]) -> Iterator[Any]:
    """A shape key for each frame's heights, by products of arrays."""
    positions = column(body.data.vertices, "co", 3)
    normals = column(body.data.vertex_normals, "vector", 3)
    for each in heights:
        wave = sum(height * segment.wave for height, segment in zip(each, segments, strict=True))
        key = body.shape_key_add(from_mix=False)
        key.data.foreach_set("co", (positions + normals * wave[:, None]).astype(np.float32).reshape(-1))
        yield key


def joined(body: Any, segments: list[Segment], heights: Iterable[list[float]]) -> Iterator[Any]:
    """The same by Blender's tools; the body is selected alone."""
    copy = body.copy()
    copy.data = body.data.copy()
    copy.shape_key_clear()
    copy.modifiers.clear()
    bpy.context.collection.objects.link(copy)
    displacements = []
    for number, segment in enumerate(segments):
        group = copy.vertex_groups.new(name=f"wrinkle_{number}")
        for vertex in np.nonzero(segment.wave)[0].tolist():
            group.add([vertex], segment.wave[vertex], "REPLACE")
        displace = copy.modifiers.new(group.name, "DISPLACE")
        displace.vertex_group = group.name
        displace.mid_level = 0.0  # strength times weight is then the distance
        displacements.append(displace)
    copy.select_set(True)
    for each in heights:
        for displace, height in zip(displacements, each, strict=True):
            displace.strength = height
        bpy.ops.object.join_shapes()
        yield body.data.shape_keys.key_blocks[-1]
    bpy.data.objects.remove(copy)


def play(owner: Any, action: Any, kind: str) -> Any:
    """Make an action the only one of an object, or of its shape keys; its animation."""
    animation = owner.animation_data or owner.animation_data_create()
    for track in animation.nla_tracks:
        track.mute = True
    animation.action = action
    slot = next((each for each in action.slots if each.target_id_type == kind), None)
    animation.action_slot = slot or action.slots.new(kind, owner.name)
    return animation


def main(asset: Path, tools: Path, out: Path, clip: str, *, fps: int, operators: bool) -> None:
    """Import, subdivide, displace, key, export."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = fps
    bpy.ops.import_scene.gltf(filepath=str(asset), merge_vertices=True)
    skinned = [each for each in bpy.data.objects if each.type == "MESH" and each.find_armature()]
    (body,) = skinned
    action = bpy.data.actions[clip]
    play(body.find_armature(), action, "OBJECT")

    segments = [Segment(tool) for tool in json.loads(tools.read_text(encoding="utf-8"))]
    if operators:
        subdivide_all(body)
    else:
        subdivide(body, segments)
    for segment in segments:
        segment.attach(body)

    body.shape_key_add(name="Basis", from_mix=False)
    play(body.data.shape_keys, action, "KEY")
    first, last = (round(frame) for frame in action.frame_range)
    heights = measured(body, segments, range(first, last + 1))
    for frame, key in enumerate((joined if operators else multiplied)(body, segments, heights), first):
        key.name = f"frame_{frame}"
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
    parser.add_argument("--operators", action="store_true", help="by Blender's tools, all faces subdivided")
    options = parser.parse_args()
    main(options.asset, options.tools, options.out, options.clip, fps=options.fps, operators=options.operators)
