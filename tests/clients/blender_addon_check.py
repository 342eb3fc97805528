"""Runs the extension of samples/blender in Blender without a window. Run by hand: Blender is 370 MB, too much for CI.

In a virtual environment of Python 3.11 with Blender as a module, and with `wrinkle` on the PATH:

    pip install bpy
    python tests/clients/blender_addon_check.py

Prints a line for each check; fails at the first that does not hold. Seen with Blender 4.2.0, 4.5.15 and 5.0.1.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

# Extensions are installed there.
os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp()
import bpy  # isort: skip (the next are found only after it)
import bmesh
import numpy as np
from mathutils import Matrix, Vector

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "samples" / "blender"))
import fbx_to_glb  # noqa: E402
import wrinkle_blender as addon  # noqa: E402

FOLDER = Path(tempfile.mkdtemp())
# Scene units: Blender and glTF store float32.
NOISE = 1e-5
# Every action, and every frame of it.
FBX = {
    "add_leaf_bones": False,
    "bake_anim_use_nla_strips": False,
    "bake_anim_use_all_actions": True,
    "bake_anim_simplify_factor": 0.0,
}
# FBX holds Euler angles in degrees.
FBX_NOISE = 1e-4


def start(sample: str) -> Any:
    """An empty scene with a sample; its mesh, which is active."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(ROOT / "samples" / f"{sample}.glb"), merge_vertices=False)
    for each in [each for each in bpy.data.objects if each.name.startswith("Icosphere")]:
        bpy.data.objects.remove(each)
    # Blender gives the armature the name of the mesh.
    body = next(each for each in bpy.data.objects if each.type == "MESH" and each.name.startswith(sample))
    addon.armature_of(body).name = "rig"
    body.name = sample
    for each in bpy.data.objects:
        each.select_set(each == body)
    bpy.context.view_layer.objects.active = body
    return body


def pick(body: Any, *places: Sequence[float]) -> list[list[float]]:
    """Pick the vertices nearest to places, in world space at rest, one after the other; where they are."""
    bpy.ops.object.mode_set(mode="EDIT")
    mesh = bmesh.from_edit_mesh(body.data)
    mesh.verts.ensure_lookup_table()
    for each in (*mesh.verts, *mesh.edges, *mesh.faces):
        each.select = False
    mesh.select_history.clear()
    found = []
    for place in places:
        vertex = min(mesh.verts, key=lambda each: (body.matrix_world @ each.co - Vector(place)).length)
        vertex.select = True
        mesh.select_history.add(vertex)
        found.append([*(body.matrix_world @ vertex.co)])
    bmesh.update_edit_mesh(body.data)
    return found


def positions(body: Any) -> Any:
    """(vertices, 3) positions as shown, world space."""
    evaluated = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    found = np.zeros(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", found)
    matrix = np.array(evaluated.matrix_world)
    return found.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def digest(body: Any) -> str:
    """A hash of all that an artist made: mesh, shape keys, weights, bones, poses, actions, modes and selection."""
    said: list[Any] = [bpy.context.mode, bpy.context.scene.frame_current, bpy.context.object.name]
    said += [sorted(each.name for each in bpy.context.selected_objects)]
    said += [[*each.co, *[(group.group, group.weight) for group in each.groups]] for each in body.data.vertices]
    keys = body.data.shape_keys.key_blocks if body.data.shape_keys else ()
    said += [(key.name, key.value, [[*each.co] for each in key.data]) for key in keys]
    said += [[slot.material.name for slot in body.material_slots], [each.name for each in body.modifiers]]
    armature = addon.armature_of(body)
    said += [[each.name, [*map(tuple, each.matrix_basis)]] for each in armature.pose.bones]
    said += [[each.name, [*map(tuple, each.matrix_local)]] for each in armature.data.bones]
    said += [armature.animation_data.action.name, sorted(each.name for each in bpy.data.materials)]
    for action in sorted(bpy.data.actions, key=lambda each: each.name):
        if action in ACTIONS:
            curves = addon._curves_of(action)
            said.append(
                [action.name, [[curve.data_path, [[*k.co] for k in curve.keyframe_points]] for curve in curves]]
            )
    return hashlib.sha256(repr(said).encode()).hexdigest()


ACTIONS: set[Any] = set()


def wrinkle(*arguments: str | Path) -> str:
    """Run the command; what it prints."""
    ran = subprocess.run(["wrinkle", *map(str, arguments)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def knee(body: Any, **options: Any) -> list[list[float]]:
    """Add the sample's tool behind the left knee; where its ends are."""
    ends = pick(body, (0.1587, 0.0619, 0.6507), (0.0562, 0.0580, 0.3792))
    bpy.ops.wrinkle.add(**{"kind": "tools", "name": "knee.L", "bumps": 5, **options})
    bpy.ops.object.mode_set(mode="OBJECT")
    return ends


def one(name: str) -> Any:
    """The tool of a name."""
    return next(each for each in addon.tools_of(bpy.context.scene) if each["name"] == name)


def check_that_a_tool_drawn_is_the_tool_written_by_hand() -> None:
    body = start("trousers")
    ends = knee(body, material="cloth")
    tool = one("knee.L")
    tool["strategy"] = "both_ends"
    bpy.ops.wrinkle.save(filepath=str(FOLDER / "drawn.yaml"))
    bpy.ops.wrinkle.bake(filepath=str(FOLDER / "drawn.glb"))
    origin, target = ([round(each, 6) for each in end] for end in ends)
    (FOLDER / "hand.yaml").write_text(
        f"version: 1\nup: z   # as Blender shows\ntools:\n  - name: knee.L\n    node: trousers\n    origin: {origin}\n"
        f"    target: {target}\n    width: 80%\n    material: cloth\n    bumps: 5\n    strategy: both_ends\n"
    )
    wrinkle("bake", addon._folder() / "wrinkle_trousers.glb", FOLDER / "hand.yaml", "-o", FOLDER / "hand.glb")
    assert wrinkle("schema", "--read", FOLDER / "drawn.yaml") == wrinkle("schema", "--read", FOLDER / "hand.yaml")
    assert (FOLDER / "drawn.glb").read_bytes() == (FOLDER / "hand.glb").read_bytes()


def check_that_empties_and_the_patch_follow_the_bones() -> None:
    body = start("trousers")
    ends = knee(body)
    tool, armature = one("knee.L"), addon.armature_of(body)
    empties = addon.points_of(tool)
    assert [each.name for each in empties] == ["knee.L.origin", "knee.L.target"]
    assert [each.parent_bone for each in empties] == ["thigh.L", "shin.L"]
    for empty, end in zip(empties, ends, strict=True):
        assert (addon.at_rest(empty).translation - Vector(end)).length < NOISE
    at_rest = positions(tool)
    armature.pose.bones["shin.L"].rotation_mode = "QUATERNION"
    armature.animation_data.action = None
    before = [each.matrix_world.translation.copy() for each in empties]
    rest = [addon.at_rest(each).translation.copy() for each in empties]
    armature.pose.bones["shin.L"].rotation_quaternion = (0.8, 0.6, 0, 0)
    bpy.context.view_layer.update()
    after = [each.matrix_world.translation.copy() for each in empties]
    assert (after[0] - before[0]).length < NOISE < 0.05 < (after[1] - before[1]).length
    assert max((a - addon.at_rest(b).translation).length for a, b in zip(rest, empties, strict=True)) < NOISE
    posed = positions(tool)
    moved = np.linalg.norm(posed - at_rest, axis=1)
    assert moved.min() < NOISE < 0.05 < moved.max()
    addon.draw_tool(tool)
    bpy.context.view_layer.update()
    assert np.abs(positions(tool) - posed).max() < NOISE, "a curve drawn in a pose is the same"
    # The curve lies on the skin at rest, across the whole width.
    skin = addon.Skin(body)
    points = [Vector(point.co[:3]) for spline in tool.data.splines for point in spline.points]
    length = (Vector(ends[1]) - Vector(ends[0])).length
    assert max((skin.nearest(each)[0] - each).length for each in points) < 0.012 * length
    assert len(tool.data.splines) == 3 + 5 + 2
    # An empty that is moved by hand draws the curve anew, and counts.
    empties[0].location.x += 0.03
    bpy.context.view_layer.update()
    assert addon.entry_of(tool)["origin"] != addon.flow(addon.tidy(ends[0]))
    now = [Vector(point.co[:3]) for point in tool.data.splines[1].points]
    place = addon.at_rest(empties[0]).translation
    assert (now[0] - skin.nearest(place)[0]).length < 0.012 * length


def check_that_keys_have_the_ranges_of_the_schema() -> None:
    body = start("trousers")
    knee(body)
    tool = one("knee.L")
    shown = tool.id_properties_ui("bumps").as_dict()
    assert (tool["bumps"], shown["min"], shown["max"], shown["step"]) == (5, 1, 64, 1)
    shown = tool.id_properties_ui("width").as_dict()
    assert (tool["width"], shown["min"], shown["max"], shown["subtype"]) == (80, 0.01, 10000, "PERCENTAGE")
    assert (shown["soft_min"], shown["soft_max"], shown["step"]) == (1, 300, 50)
    bpy.ops.wrinkle.set_key(key="variation", text="0.6")
    shown = tool.id_properties_ui("variation").as_dict()
    assert (tool["variation"], shown["min"], shown["max"]) == (0.6, 0, 1)
    bpy.ops.wrinkle.set_key(key="max_height", text="5%")
    assert addon.key_text(tool, "max_height") == "5%"
    bpy.ops.wrinkle.set_key(key="clips", text="{walk: 0.8}")
    bpy.ops.wrinkle.set_key(key="material", text="cloth")
    tool.wrinkle_material_choice = "leather"
    assert tool["material"] == tool.wrinkle_material_choice == "leather"
    offered = tool.bl_rna.properties["wrinkle_material_choice"]
    assert offered.type == "ENUM"
    bpy.ops.wrinkle.unset_key(key="variation")
    assert set(addon.own_keys(tool)) == {"bumps", "width", "max_height", "clips", "material"}
    refused(lambda: bpy.ops.wrinkle.set_key(key="widht", text="3"), "widht is no key of a wrinkle")


class Layout:
    """Takes what a panel draws, and holds it to what Blender's layout knows."""

    def __init__(self) -> None:
        self.drawn: list[str] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        known = bpy.types.UILayout.bl_rna.functions[name].parameters

        def call(*places: Any, **words: Any) -> Any:
            assert set(words) <= set(known.keys()), (name, words)
            if "icon" in words:
                assert words["icon"] in known["icon"].enum_items, words
            if name == "operator":
                assert hasattr(bpy.types, addon_class(places[0])), places
                self.drawn.append(places[0])
                return SimpleNamespace()
            if name == "prop":
                assert places[0].path_resolve(places[1]) is not None, places
                self.drawn.append(places[1])
            if name in ("label", "progress"):
                self.drawn.append(words["text"])
            return self

        return call


def addon_class(name: str) -> str:
    """The type of an operator."""
    room, _, rest = name.partition(".")
    return f"{room.upper()}_OT_{rest}"


def panel() -> list[str]:
    """Records what the panel draws."""
    drawn = SimpleNamespace(layout=Layout())
    for each in ("_draw_keys", "_draw_bakes"):
        setattr(drawn, each, partial(getattr(addon.Tools, each), drawn))
    addon.Tools.draw(drawn, bpy.context)
    return drawn.layout.drawn


def check_that_the_panel_has_every_key_and_a_bar() -> None:
    body = start("body")
    assert "Pick vertices to add" in panel()
    pick(body, (0.205, 0.06, 1.368), (0.382, -0.05, 1.18))
    for kind, points in (("tools", 2), ("muscles", 2), ("flesh", 1), ("touches", 1), ("fields", 0)):
        pick(body, *((0.205, 0.06, 1.368), (0.382, -0.05, 1.18))[:points])
        bpy.ops.wrinkle.add(kind=kind, name=kind)
        drawn = panel()
        for key in addon.keys_of(addon.schema(), kind):
            is_set = {f'["{key}"]', f"wrinkle_{key}_choice"} & set(drawn)
            assert len(is_set) == (key in addon.tool_at(bpy.context)), key
            assert is_set or [each for each in drawn if each.startswith(f"{key}: ")], key
        assert [each for each in drawn if each in ("Place", "Shape", "Irregularity", "Motion")]
    bpy.ops.wrinkle.select(name="tools")
    bpy.ops.wrinkle.set_key(key="material", text="leather")
    assert "wrinkle_material_choice" in panel()
    assert "wrinkle.preview" in panel()
    addon._job = addon.Job([sys.executable, "-c", "import sys; print('progress: sampling 50%', file=sys.stderr)"])
    addon._job.wait()
    drawn = panel()
    addon._job = None
    assert "sampling 50 %" in drawn
    assert "wrinkle.cancel" in drawn
    assert "wrinkle.preview" not in drawn


def check_that_tools_are_mirrored_copied_renamed_and_deleted() -> None:
    body = start("trousers")
    ends = knee(body)
    bpy.ops.wrinkle.mirror()
    twin = one("knee.R")
    assert [each.parent_bone for each in addon.points_of(twin)] == ["thigh.R", "shin.R"]
    for empty, (x, y, z) in zip(addon.points_of(twin), ends, strict=True):
        assert (addon.at_rest(empty).translation - Vector((-x, y, z))).length < NOISE
    bpy.ops.wrinkle.copy()
    copied = one("knee.R_2")
    assert addon.entry_of(copied) | {"name": "knee.R"} == addon.entry_of(twin)
    bpy.ops.wrinkle.rename(name="calf.R")
    assert [each.name for each in (copied, *addon.points_of(copied))] == ["calf.R", "calf.R.origin", "calf.R.target"]
    bpy.ops.wrinkle.delete()
    assert [each["name"] for each in addon.tools_of(bpy.context.scene)] == ["knee.L", "knee.R"]
    assert not [each for each in bpy.data.objects if each.name.startswith("calf")]
    pick(body, (0.1587, 0.0619, 0.6507))
    bpy.ops.wrinkle.add(kind="flesh", name="thigh.L")
    bpy.ops.wrinkle.set_key(key="joint", text="thigh.L")
    bpy.ops.wrinkle.mirror()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert one("thigh.R")["joint"] == "thigh.R"
    bpy.ops.wrinkle.save(filepath=str(FOLDER / "both.yaml"))
    # Both sides by hand are what `mirror: x` makes of one, but for the seed, which a name gives.
    values = json.loads(wrinkle("schema", "--read", FOLDER / "both.yaml"))
    assert [each["name"] for each in values["tools"]] == ["knee.L", "knee.R"]


def check_that_a_row_of_vertices_becomes_a_path() -> None:
    body = start("trousers")
    picked = pick(body, (0.1587, 0.0619, 0.6507), (0.11, 0.07, 0.5), (0.0562, 0.0580, 0.3792))
    bpy.ops.wrinkle.add(kind="tools", name="knee")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wrinkle.save(filepath=str(FOLDER / "path.yaml"))
    entry = json.loads(wrinkle("schema", "--read", FOLDER / "path.yaml"))["tools"][0]
    assert np.abs(np.array(entry["path"]) - picked).max() < NOISE
    assert [each.name for each in addon.points_of(one("knee"))] == ["knee.origin", "knee.path_1", "knee.target"]


def check_that_a_preview_plays_beside_an_original_that_stays() -> None:
    body = start("trousers")
    knee(body, material="cloth", width=100)
    armature = addon.armature_of(body)
    ACTIONS.update(bpy.data.actions)
    play(armature, next(each for each in bpy.data.actions if "squat" in each.name))
    bpy.context.scene.frame_set(3)
    bpy.ops.wrinkle.bake(filepath=str(FOLDER / "first.glb"))
    before, things = digest(body), {each.name for each in bpy.data.objects}
    bpy.ops.wrinkle.preview()
    made = bpy.data.objects["trousers.wrinkled"]
    assert {each.name for each in bpy.data.objects} - things == {"trousers.wrinkled"}
    assert [slot.material for slot in made.material_slots] == [slot.material for slot in body.material_slots]
    assert [key.name for key in made.data.shape_keys.key_blocks][1:] == ["wrinkle_knee_L_1"]
    assert (body.hide_get(), made.hide_get()) == (True, False)
    bpy.ops.wrinkle.compare()
    assert (body.hide_get(), made.hide_get()) == (False, True)
    assert digest(body) == before
    # The coarse vertices are where those of the original are, but for the wrinkles.
    greatest = {}
    for frame in (0, 5, 10, 15, 20):
        bpy.context.scene.frame_set(frame)
        shown, plain = positions(made), positions(body)
        distance = np.array([np.linalg.norm(shown - each, axis=1).min() for each in plain[:: len(plain) // 200]])
        assert np.median(distance) < NOISE, "beside the patch nothing moves"
        greatest[frame] = made.data.shape_keys.key_blocks["wrinkle_knee_L_1"].value
    assert greatest[0] == 0
    assert max(greatest.values()) > 0.5
    # Another preview replaces the first, and nothing is left of it.
    counts = [len(each) for each in (bpy.data.meshes, bpy.data.actions, bpy.data.materials, bpy.data.armatures)]
    bpy.context.view_layer.objects.active = body
    bpy.ops.wrinkle.preview()
    assert {each.name for each in bpy.data.objects} - things == {"trousers.wrinkled"}
    assert counts == [len(each) for each in (bpy.data.meshes, bpy.data.actions, bpy.data.materials, bpy.data.armatures)]
    bpy.ops.wrinkle.compare()
    bpy.ops.wrinkle.bake(filepath=str(FOLDER / "second.glb"))
    assert (FOLDER / "first.glb").read_bytes() == (FOLDER / "second.glb").read_bytes()
    # It follows when the armature plays another clip.
    play(armature, next(each for each in bpy.data.actions if "walk" in each.name and each in ACTIONS))
    bpy.context.view_layer.update()
    assert "walk" in bpy.data.objects["trousers.wrinkled"].data.shape_keys.animation_data.action.name


def check_that_rigs_may_be_scaled_turned_and_moved_and_meshes_edited() -> None:
    body = start("trousers")
    armature = addon.armature_of(body)
    play(armature, next(each for each in bpy.data.actions if "squat" in each.name))
    armature.scale = (0.02, 0.02, 0.02)
    armature.rotation_mode = "XYZ"
    armature.rotation_euler = (0.3, -0.2, 1.0)
    for frame, place in ((0, (1, 2, 3)), (20, (2, 2, 3))):
        armature.location = place
        armature.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(11, subframe=0.5)
    bpy.context.view_layer.update()
    body.matrix_world = Matrix.Translation((0.001, 0.002, 0)) @ body.matrix_world
    bpy.context.view_layer.update()
    place = armature.matrix_world
    ends = [place @ Vector(each) for each in ((0.1587, 0.0619, 0.6507), (0.0562, 0.0580, 0.3792))]
    pick(body, *ends)
    bpy.ops.wrinkle.add(kind="tools", name="knee.L", material="cloth")
    # From edit mode, and with a pose that has no key.
    bone = armature.pose.bones["shin.R"]
    bone.rotation_quaternion = (0.8, 0.6, 0, 0)
    posed = tuple(bone.rotation_quaternion)
    bpy.ops.wrinkle.preview()
    assert bpy.context.mode == "EDIT_MESH"
    assert (bpy.context.scene.frame_current, bpy.context.scene.frame_subframe) == (11, 0.5)
    assert tuple(bone.rotation_quaternion) == posed
    assert not body.hide_get(), "it is being edited"
    bpy.ops.object.mode_set(mode="OBJECT")
    made = bpy.data.objects["trousers.wrinkled"]
    for frame in (0, 7, 16, 20):
        bpy.context.scene.frame_set(frame)
        shown, plain = positions(made), positions(body)
        distance = np.array([np.linalg.norm(shown - each, axis=1).min() for each in plain[::17]])
        assert np.median(distance) < NOISE, (frame, np.median(distance))
    assert made.data.shape_keys.key_blocks["wrinkle_knee_L_1"].value > 0
    # The anchors are where the empties are, at rest in frame 0.
    bpy.ops.wrinkle.save(filepath=str(FOLDER / "moved.yaml"))
    asset = addon._folder() / "wrinkle_trousers.glb"
    checked = json.loads(wrinkle("check", asset, FOLDER / "moved.yaml", "--json"))
    assert max(checked["tools"][0][end]["off"] for end in ("origin", "target")) < NOISE, checked["tools"][0]


def check_that_clips_before_frame_0_play_at_their_frames() -> None:
    shown = {}
    for begin in (0, -7, 12):
        body = start("trousers")
        knee(body, material="cloth")
        armature = addon.armature_of(body)
        action = next(each for each in bpy.data.actions if "squat" in each.name)
        play(armature, action)
        for curve in addon._curves_of(action):
            for key in curve.keyframe_points:
                for each in (key.co, key.handle_left, key.handle_right):
                    each.x += begin
        bpy.ops.wrinkle.preview()
        made = bpy.data.objects["trousers.wrinkled"]
        shown[begin] = []
        for frame in (4, 16, 30):
            bpy.context.scene.frame_set(begin + frame)
            shown[begin].append(made.data.shape_keys.key_blocks[1].value)
        assert shown[0][1] > 0.5
        assert np.abs(np.array(shown[begin]) - shown[0]).max() < 0.01, shown


def check_that_shape_keys_and_two_meshes_are_previewed() -> None:
    body = start("head")
    armature = addon.armature_of(body)
    pick(body, (0.03, -0.11, 0.235), (0.03, -0.1, 0.275))
    bpy.ops.wrinkle.add(kind="tools", name="brow.L")
    bpy.ops.object.mode_set(mode="OBJECT")
    names = [each.name for each in body.data.shape_keys.key_blocks]
    values = [each.value for each in body.data.shape_keys.key_blocks]
    # Another head on the same bones, with a tool too, and a modifier that stays out of it.
    twin = body.copy()
    twin.data = body.data.copy()
    for key in twin.data.shape_keys.key_blocks:
        for point in key.data:
            point.co.x += 0.3
    for vertex in twin.data.vertices:
        vertex.co.x += 0.3
    twin.name = "head.009"
    bpy.context.collection.objects.link(twin)
    bpy.context.view_layer.objects.active = twin
    smooth = twin.modifiers.new("smooth", "SUBSURF")
    pick(twin, (0.27, -0.11, 0.235), (0.27, -0.1, 0.275))
    bpy.ops.wrinkle.add(kind="tools", name="brow.R")
    bpy.ops.object.mode_set(mode="OBJECT")
    before = positions(body)
    bpy.ops.wrinkle.preview()
    assert [each.value for each in body.data.shape_keys.key_blocks] == values
    assert smooth.show_viewport
    made = {each["wrinkle_preview_of"]: each for each in bpy.data.objects if each.get("wrinkle_preview_of")}
    assert sorted(made) == ["head", "head.009"]
    for name, side in (("head", "L"), ("head.009", "R")):
        keys = [each.name for each in made[name].data.shape_keys.key_blocks]
        assert keys[: len(names)] == names
        assert all(each.startswith(f"wrinkle_brow_{side}") for each in keys[len(names) :]), keys
        assert addon.armature_of(made[name]) == armature
    assert np.abs(positions(body) - before).max() == 0
    bpy.context.scene.frame_set(20)
    shown, plain = positions(made["head"]), positions(body)
    distance = np.array([np.linalg.norm(shown - each, axis=1).min() for each in plain[::53]])
    assert np.median(distance) < NOISE


def check_that_a_preview_is_the_draft_that_the_command_bakes() -> None:
    body = start("trousers")
    knee(body, material="cloth", width=100)
    bpy.ops.wrinkle.preview()
    shown = {}
    made = bpy.data.objects["trousers.wrinkled"]
    clips = addon.clips_of(body)
    for frame in (0, 8, 16):
        bpy.context.scene.frame_set(frame)
        shown[frame] = positions(made)
    # Blender empties its own folder with the scene.
    baked = shutil.copy(addon._folder() / "wrinkle_trousers_baked.glb", FOLDER)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(baked), merge_vertices=False)
    alone = next(each for each in bpy.data.objects if each.type == "MESH" and each.data.shape_keys)
    for owner in (addon.armature_of(alone), alone.data.shape_keys):
        track = next(each for each in owner.animation_data.nla_tracks if each.name in clips)
        owner.animation_data.action = track.strips[0].action
        if hasattr(track.strips[0], "action_slot"):
            owner.animation_data.action_slot = track.strips[0].action_slot
    for frame, wanted in shown.items():
        bpy.context.scene.frame_set(frame)
        assert np.abs(positions(alone) - wanted).max() < NOISE, frame


def check_that_suggested_tools_are_loaded_and_exports_leave_previews_out() -> None:
    body = start("wrist")
    assert panel()[0] == "wrinkle.suggest"
    bpy.ops.wrinkle.suggest()
    names = {each["name"] for each in addon.tools_of(bpy.context.scene)}
    assert {"wrist_top", "wrist_under"} <= names
    assert not [*addon._folder().glob("wrinkle_suggest.yaml")]
    bpy.ops.wrinkle.preview()
    assert "wrist.wrinkled" in bpy.data.objects
    bpy.context.preferences.addons.new().module = addon.__name__
    written = FOLDER / "exported.glb"
    bpy.ops.export_scene.gltf(filepath=str(written))
    bpy.context.preferences.addons.remove(bpy.context.preferences.addons[addon.__name__])
    (mesh,) = json.loads(wrinkle("inspect", "--json", written))["meshes"]
    assert mesh["name"] == body.name


def check_that_files_are_loaded_and_saved_alike() -> None:
    for sample, tools in (
        ("trousers", "trousers"),
        ("trousers", "trousers_field"),
        ("wrist", "wrist"),
        ("body", "body"),
    ):
        start(sample)
        source = ROOT / "configs" / f"{tools}.yaml"
        bpy.ops.wrinkle.load(filepath=str(source))
        bpy.ops.wrinkle.save(filepath=str(FOLDER / "again.yaml"))
        first = addon.z_up(json.loads(wrinkle("schema", "--read", source)))
        second = json.loads(wrinkle("schema", "--read", FOLDER / "again.yaml"))
        muscles = [first.pop("muscles", []), second.pop("muscles", [])]
        for kind in addon.KINDS:
            for one_entry, other in zip(first.pop(kind, []), second.pop(kind, []), strict=True):
                assert one_entry.keys() == other.keys()
                for key, value in one_entry.items():
                    if isinstance(value, list) and key != "details":
                        assert np.abs(np.array(value) - other[key]).max() < NOISE
                    else:
                        assert other[key] == value, key
        assert first == second
        # The ends of a muscle name the joint that carries them.
        for one_muscle, other in zip(*muscles, strict=True):
            for key in ("origin", "insertion"):
                armature = next(each for each in bpy.data.objects if each.type == "ARMATURE")
                head = armature.matrix_world @ armature.data.bones[other[key]["joint"]].head_local
                assert np.abs(np.array(head) + other[key]["offset"] - one_muscle[key]).max() < NOISE
        wrinkle("check", ROOT / "samples" / f"{sample}.glb", FOLDER / "again.yaml")


def check_that_muscles_flesh_and_touches_are_added_and_bake() -> None:
    body = start("body")
    pick(body, (0.205, 0.06, 1.368), (0.382, -0.05, 1.18))
    bpy.ops.wrinkle.add(kind="muscles", name="biceps.L")
    pick(body, (0.0, -0.172, 1.015))
    bpy.ops.wrinkle.add(kind="flesh", name="belly", radius=0.16)
    pick(body, (0.0, 0.15, 1.2))
    bpy.ops.wrinkle.add(kind="touches", name="poke")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert one("biceps.L")
    assert addon.points_of(one("belly"))[0].empty_display_size == np.float32(0.16)
    bpy.ops.wrinkle.set_key(key="keys", text="{jump: [[0.2, 0, 0], [0.5, 0.01, 0]]}")
    bpy.ops.wrinkle.preview()
    names = {each.name for each in bpy.data.objects["body.wrinkled"].data.shape_keys.key_blocks}
    for name in ("biceps", "belly", "poke"):
        assert [each for each in names if name in each], name


def check_that_a_field_is_added_without_vertices_and_bakes() -> None:
    start("trousers")
    bpy.ops.wrinkle.add(kind="fields", name="folds.L")
    bpy.ops.wrinkle.set_key(key="slack", text="5%")
    bpy.ops.wrinkle.set_key(key="joints", text="[thigh.L]")
    bpy.ops.wrinkle.mirror()
    made = [addon.entry_of(one(name)) for name in ("folds.L", "folds.R")]
    assert [each["joints"] for each in made] == ["[thigh.L]", "[thigh.R]"]
    bpy.ops.wrinkle.delete()
    addon.draw_changed(bpy.context.scene)
    bpy.ops.wrinkle.preview()
    names = {each.name for each in bpy.data.objects["trousers.wrinkled"].data.shape_keys.key_blocks}
    assert [each for each in names if "folds_L" in each]


def check_that_faults_are_one_line_and_change_nothing() -> None:
    body = start("trousers")
    before = len(bpy.data.objects)
    pick(body, (0.1587, 0.0619, 0.6507))
    refused(lambda: bpy.ops.wrinkle.add(kind="tools", name="knee"), "wrinkle: pick 2 vertices, not 1")
    bpy.ops.object.mode_set(mode="OBJECT")
    refused(lambda: bpy.ops.wrinkle.save(filepath=str(FOLDER / "none.yaml")), "no tools yet")
    knee(body)
    bpy.ops.wrinkle.set_key(key="strategy", text="sideways")
    refused(lambda: bpy.ops.wrinkle.preview(), "expected everywhere, origin or both_ends")
    assert len(bpy.data.objects) == before + 3
    assert not [*addon._folder().glob(".wrinkle_*.yaml")]
    (FOLDER / "bad.yaml").write_text("version: 1\ntools:\n  - nam: x\n")
    refused(lambda: bpy.ops.wrinkle.load(filepath=str(FOLDER / "bad.yaml")), "bad.yaml:3: tools[0].nam: unknown key")
    bpy.data.objects.remove(addon.points_of(one("knee.L"))[0])
    refused(lambda: bpy.ops.wrinkle.preview(), "knee.L: has 1 points")


def check_that_an_fbx_becomes_a_glb_with_its_clips() -> None:
    for sample, clip in (("trousers", "squat"), ("body", "curl")):
        body = start(sample)
        written = FOLDER / f"{sample}.fbx"
        bpy.ops.export_scene.fbx(filepath=str(written), **FBX)
        play(addon.armature_of(body), next(each for each in bpy.data.actions if clip in each.name))
        wanted = []
        for frame in (5, 15, 25):
            bpy.context.scene.frame_set(frame)
            wanted.append(positions(body))
        clips = fbx_to_glb.convert(written, written.with_suffix(".glb"))
        inspected = json.loads(wrinkle("inspect", "--json", written.with_suffix(".glb")))
        assert [each["name"] for each in inspected["clips"]] == clips
        assert len(clips) == {"trousers": 2, "body": 3}[sample]
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_scene.gltf(filepath=str(written.with_suffix(".glb")), merge_vertices=False)
        body = next(each for each in bpy.data.objects if each.type == "MESH" and each.vertex_groups)
        armature = addon.armature_of(body)
        track = next(each for each in armature.animation_data.nla_tracks if clip in each.name)
        play(armature, track.strips[0].action)
        for frame, before in zip((5, 15, 25), wanted, strict=True):
            bpy.context.scene.frame_set(frame)
            after = positions(body)
            gaps = [np.linalg.norm(after - each, axis=1).min() for each in before[::50]]
            assert max(gaps) < FBX_NOISE, (sample, frame, max(gaps))


def check_that_the_package_installs() -> None:
    import addon_utils

    addon.unregister()
    addon.extension_zip(FOLDER / "wrinkle.zip")
    body = start("trousers")
    addon_utils.enable("bl_pkg", default_set=True)
    bpy.ops.extensions.package_install_files(
        filepath=str(FOLDER / "wrinkle.zip"), repo="user_default", enable_on_install=True
    )
    name = "bl_ext.user_default.wrinkle"
    settings = bpy.context.preferences.addons[name].preferences
    installed = sys.modules[name]
    settings.command = str(Path(shutil.which("wrinkle") or "").parents[1])
    assert Path(installed.command()).samefile(shutil.which("wrinkle") or "")
    knee(body)
    assert [each["name"] for each in installed.tools_of(bpy.context.scene)] == ["knee.L"]
    addon_utils.disable(name, default_set=True)
    assert not hasattr(bpy.types, "WRINKLE_PT_tools")
    addon.register()


def play(armature: Any, action: Any) -> None:
    """Let an action alone move an armature."""
    for track in armature.animation_data.nla_tracks:
        track.mute = True
    armature.animation_data.action = action
    if hasattr(action, "slots"):
        armature.animation_data.action_slot = next(each for each in action.slots if each.target_id_type == "OBJECT")


def refused(act: Callable[[], Any], said: str) -> None:
    """An operator that is refused, for this reason."""
    found = ""
    try:
        act()
    except RuntimeError as error:
        found = str(error)
    assert said in found, found


def check_that_the_editor_opens_what_is_exported() -> None:
    body = start("trousers")
    knee(body)
    bpy.ops.wrinkle.save(filepath=str(FOLDER / "edited.yaml"))
    bpy.ops.wrinkle.edit()
    try:
        addon._editor.wait(3)
    except subprocess.TimeoutExpired:
        addon.stop_editor()
    else:
        raise AssertionError("the editor has ended")
    bpy.ops.wrinkle.load(filepath=str(FOLDER / "edited.yaml"))
    assert [each["name"] for each in addon.tools_of(bpy.context.scene)] == ["knee.L"]


def main(wanted: Sequence[str]) -> None:
    """Run the checks whose names have one of the words; all if there are none."""
    addon.register()
    for name, check in [*globals().items()]:
        if name.startswith("check_that") and (not wanted or any(word in name for word in wanted)):
            check()
            print("holds:", name.removeprefix("check_that_").replace("_", " "), flush=True)
    addon.unregister()


if __name__ == "__main__":
    main(sys.argv[1:])
