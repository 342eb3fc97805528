"""Extras of a baked node: enough for a player to play the wrinkles of any clip."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.bakes import bake_config, bake_once
from kit.clients import driver_warnings, pose
from kit.limb import limb_asset, write_tools
from kit.limb import tool as crease
from kit.player import Floats, Gltf, Json, anchor_distances, described
from kit.samples import BROW, Editor, config, edited, sharp_keys, spline_keys
from wrinklecli.baking.track import track
from wrinklecli.choices import Tracks
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.review.diff.diff import diff


def assert_replayed(file: Gltf, node: str, clip: str, times: Floats, tolerance: float) -> None:
    """Weights from the tables in the node's extras are those of the tracks, in shares of the greatest."""
    extras = file.json["nodes"][file.node(node)]["extras"]["wrinkle"]
    names = file.mesh(node)["extras"]["targetNames"]
    played = file.weights(node, clip, times)
    for tool in extras["tools"]:
        table, rows = np.array(tool["weights"]), np.array(tool["shortenings"])
        assert table.shape == (len(rows), len(tool["targets"]))
        assert rows[0] == 0
        assert rows[-1] == 1
        assert (np.diff(rows) > 0).all()
        shortenings = 1 - anchor_distances(file, tool, node, clip, times) / tool["rest_length"]
        strength = tool.get("strengths", {}).get(clip, tool.get("strength", 1.0))
        for column, name in zip(table.T, tool["targets"], strict=True):
            error = np.abs(played[:, names.index(name)] - strength * np.interp(shortenings, rows, column))
            assert error.max() < tolerance, (tool["name"], name, times[error.argmax()])


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("name", "config", "clip"),
    [
        ("wrist", "wrist", "flex"),
        ("wrist", "wrist", "extend"),
        ("head", "head", "raise_brows"),
        ("head", "head", "think"),
        ("trousers", "trousers", "squat"),
        ("trousers", "trousers", "walk"),
    ],
)
def test_extras_are_enough_to_play_the_wrinkles(name: str, config: str, clip: str) -> None:
    after = bake_config(name, config)
    # Between keys tracks are straight and off by up to --max-error; the table is held against the keys. Its own
    # straight lines are right to 1/2048, and float32 and eight digits add a little where a height starts.
    times, _ = after.keys(clip, name)
    assert_replayed(after, name, clip, times, TABLE_ERROR + 1e-3)


@pytest.mark.slow
def test_extras_of_a_clip_that_was_not_baked() -> None:
    part, whole = bake_config("wrist", "wrist", clips=["extend"]), bake_config("wrist", "wrist")
    assert part.sampler("flex", 0, "weights") is None
    assert described(part) == described(whole)


@pytest.mark.slow
def test_extras_say_what_else_drives_a_tool() -> None:
    """A rest length that follows a morph target cannot be played from the table alone, unless they say so."""
    tool = {**BROW, "rest_length": {"morph": "browsDown", "full": "130%"}}
    (described,) = bake_once("head", tool).json["nodes"][0]["extras"]["wrinkle"]["tools"]
    assert "browsDown" in json.dumps(
        {key: value for key, value in described.items() if key not in ("origin", "target")}
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize(("clip", "acts"), [("raise_brows", True), ("think", False)])
def test_extras_say_that_a_tool_acts_in_some_clips_alone(clip: str, acts: bool) -> None:
    after = bake_once("head", {**BROW, "strength": 0, "clips": {clip: -0.5}})
    times = np.linspace(0.0, 2.0, 101)
    assert after.weights("head", "raise_brows", times)[:, -1].any() == acts
    if acts:
        times, _ = after.keys("raise_brows", "head")
    assert_replayed(after, "head", "raise_brows", times, TABLE_ERROR + 1e-3)


def without_names(editor: Editor) -> None:
    """Joints without a name, or with an empty one; another node has the name that one of them would get."""
    skin = editor.json["skins"][0]["joints"]
    for joint in skin[::2]:
        del editor.json["nodes"][joint]["name"]
    for joint in skin[1::2]:
        editor.json["nodes"][joint]["name"] = ""
    editor.json["nodes"].append({"name": f"node_{skin[1]}"})


@pytest.mark.slow
def test_joints_without_a_name_get_one(tmp_path: Path) -> None:
    """Only joints of drives get a name, and a note says so; the asset comes back without them."""
    asset = edited("wrist", without_names)
    before, after = Gltf(asset), bake_once(asset, top=config("wrist"), max_levels=0)
    (body,) = (node for node in after.json["nodes"] if "extras" in node)
    tools = body["extras"]["wrinkle"]["tools"]
    wanted = {joint for tool in tools for end in ("origin", "target") for joint in tool[end]["joints"]}
    changed = {
        now["name"]: was.get("name")
        for was, now in zip(before.json["nodes"], after.json["nodes"], strict=True)
        if was.get("name") != now.get("name")
    }
    assert changed.keys() == wanted
    assert not any(changed.values())
    assert f"node_{before.json['skins'][0]['joints'][1]}_2" in wanted
    tools_file = tmp_path / "tools.yaml"
    tools_file.write_text(json.dumps(config("wrist")))
    report = wrinklecli.bake(asset, tools_file, tmp_path / "out.glb", max_levels=0)
    (note,) = report.notes
    assert f"{len(wanted)} joints of tools had no name" in note
    assert report.data["notes"] == [note]
    told = [each.message for each in diff(asset, tmp_path / "out.glb").differences if each.place.endswith("/name")]
    assert len(told) == len(wanted)
    again = wrinklecli.bake(tmp_path / "out.glb", tools_file, tmp_path / "again.glb", max_levels=0, replace=True)
    assert again.notes
    assert (tmp_path / "again.glb").read_bytes() == (tmp_path / "out.glb").read_bytes()
    frames = wrinklecli.bake(asset, tools_file, tmp_path / "frames.glb", mode="frames", max_levels=0)
    assert not frames.notes


def test_joints_of_one_name_are_said(tmp_path: Path) -> None:
    asset = limb_asset(rings=12, sides=8)
    for node in asset.gltf["nodes"][1:]:
        node["name"] = "bone"
    path = asset.write(tmp_path / "limb.glb")
    report = wrinklecli.bake(path, write_tools(tmp_path / "tools.yaml"), tmp_path / "out.glb")
    assert any(f"{path}: several nodes are named 'bone'" in line for line in report.warnings)


@pytest.mark.quick(1)
@pytest.mark.parametrize("change", [sharp_keys, spline_keys])
def test_new_weights_are_right_on_every_kind_of_track(change: Callable[[Editor], None]) -> None:
    """Replayed from the extras of the same file, at and between keys, jumps included."""
    after = bake_once(edited("head", change), BROW)
    times = np.setdiff1d(np.linspace(0.0, 2.0, 301), [0.5, 1.25, 2.0])
    assert_replayed(after, "head", "raise_brows", times, 0.005 + TABLE_ERROR + 1e-3)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("morphs", "tracks", "told"), [(1, "all", True), (0, "all", False), (1, "none", False)])
def test_morph_targets_below_a_node_with_new_weights_are_said(
    morphs: int, tracks: Tracks, told: bool, tmp_path: Path
) -> None:
    asset = limb_asset(rings=12, sides=8)
    corners = asset.accessor([[0, 5, 0], [1, 5, 0], [0, 6, 0]], bounds=True)
    lash: Json = {"attributes": {"POSITION": corners}} | ({"targets": [{"POSITION": corners}]} if morphs else {})
    asset.append("meshes", {"primitives": [lash]})
    asset.gltf["nodes"][0]["children"] = [asset.append("nodes", {"name": "lid", "children": [4]})]
    asset.append("nodes", {"name": "lash", "mesh": 1})
    path = asset.write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", crease(node="limb"))
    report = wrinklecli.bake(path, tools, tmp_path / "out.glb", tracks=tracks, max_levels=0)
    line = (
        "limb: three.js before 0.184 gives its new weights to the morph targets of 'lash' too, as these are below it;"
        " let them stand beside it"
    )
    assert (line in report.warnings) == told


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", [{}, {"name": ""}], ids=str)
def test_a_mesh_without_skin_and_name_is_its_own_joint(name: Json, tmp_path: Path) -> None:
    asset = limb_asset(skinned=False, morphs=1, morph_clip="LINEAR", rings=12, sides=8)
    asset.gltf["nodes"][0] = {"mesh": 0, **name}
    path = asset.write(tmp_path / "limb.glb")
    report = wrinklecli.bake(path, write_tools(tmp_path / "tools.yaml"), tmp_path / "out.glb", tracks="none")
    assert len(report.notes) == 1
    (node,) = Gltf(tmp_path / "out.glb").json["nodes"]
    assert node["extras"]["wrinkle"]["tools"][0]["origin"]["joints"] == [node["name"]] == ["node_0"]
    assert driver_warnings(tmp_path / "out.glb") == []
    (made,) = track(tmp_path / "out.glb", [tmp_path / "out.glb"], tmp_path / "tracked")
    assert not made.warnings


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("change", "primitives", "told"),
    [
        ({"camera": 0}, 2, "of several primitives on a node with a camera or light"),
        ({"camera": 0}, 1, None),
        ({"extensions": {"KHR_lights_punctual": {"light": 0}}}, 2, "of several primitives on a node with a camera"),
        ({"joint": True}, 1, "of a node that is a joint"),
        ({}, 2, None),
    ],
    ids=str,
)
def test_nodes_whose_weights_three_js_does_not_play_are_said(
    change: Json, primitives: int, told: str | None, tmp_path: Path
) -> None:
    """three.js itself agrees: what is told of does not move, and all else does."""
    asset = limb_asset(skinned=False, morphs=1, morph_clip="LINEAR", rings=12, sides=8, primitives=primitives)
    if change.get("joint"):
        asset.append("skins", {"joints": [0]})
        corners = asset.accessor(np.eye(3), bounds=True)
        joints, weights = asset.accessor(np.zeros((3, 4)), "u1"), asset.accessor(np.eye(4)[[0, 0, 0]])
        ring = {"POSITION": corners, "JOINTS_0": joints, "WEIGHTS_0": weights}
        asset.append("meshes", {"primitives": [{"attributes": ring}]})
        asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "ring", "mesh": 1, "skin": 0}))
    else:
        asset.gltf["nodes"][0] |= change
        asset.append("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}})
        asset.gltf["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
        asset.gltf["extensionsUsed"] = ["KHR_lights_punctual"]
    path = asset.write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", crease(node="limb"))
    report = wrinklecli.bake(path, tools, tmp_path / "out.glb", max_levels=0)
    found = [line for line in report.warnings if "three.js since 0.184 plays no weights" in line]
    assert len(found) == (told is not None)
    assert all(str(told) in line for line in found)
    posed = pose(tmp_path / "out.glb", node="limb", clip="fold", times=[0.0, 0.3])
    assert np.array_equal(posed[0], posed[1]) == (told is not None)
