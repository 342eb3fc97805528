"""`wrinkle track`: the body in one file, each clip in another."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_cli import Wrinkle
from test_encode import BROW, ROOT, Editor, Gltf, Json, bake_config, bake_once, edited, sample, wrinkle_columns

from clients import assert_valid, drive
from wrinklecli.document import read_document
from wrinklecli.errors import AssetError, BakeError
from wrinklecli.track import Tracked, track

# The table's own straight lines, half a per cent between keys, and what float32 adds.
CLOSE = 1 / 256 + 0.005 + 1e-3


def scene_unnamed(editor: Editor) -> None:
    """Of the same name as its body, three.js would call the body otherwise."""
    del editor.json["scenes"][0]["name"]


def body_of(name: str) -> Gltf:
    """A sample with wrinkles, and no tracks."""
    return bake_once(edited(name, scene_unnamed), top=config(name), tracks="none")


def config(name: str) -> Json:
    found: Json = yaml.safe_load((ROOT / "configs" / f"{name}.yaml").read_text())
    return found


def skeleton_only(editor: Editor) -> None:
    """Joints and clips, as Mixamo gives them: neither mesh nor skin; the nodes in another order, one more above."""
    gltf = editor.json
    for key in ("meshes", "skins", "materials"):
        gltf.pop(key, None)
    count = len(gltf["nodes"])
    turned = list(reversed(range(count)))
    gltf["nodes"] = [gltf["nodes"][k] for k in turned]
    gone = next(k for k, node in enumerate(gltf["nodes"]) if "mesh" in node)
    del gltf["nodes"][gone]["mesh"], gltf["nodes"][gone]["skin"]
    gltf["nodes"][gone]["name"] = "leftover"
    for node in gltf["nodes"]:
        if "children" in node:
            node["children"] = [turned.index(child) for child in node["children"]]
    gltf["scenes"] = [{"nodes": [turned.index(node) for node in gltf["scenes"][0]["nodes"]]}]
    for animation in gltf["animations"]:
        for channel in animation["channels"]:
            channel["target"]["node"] = turned.index(channel["target"]["node"])


def in_centimetres(editor: Editor) -> None:
    """The same rig, a hundred times as large."""
    skeleton_only(editor)
    gltf = editor.json
    gltf["nodes"].append({"name": "Armature", "scale": [100, 100, 100], "children": gltf["scenes"][0]["nodes"]})
    gltf["scenes"][0]["nodes"] = [len(gltf["nodes"]) - 1]


def idle(editor: Editor) -> None:
    """A second clip that moves nothing above the knees' anchors."""
    skeleton_only(editor)
    gltf = editor.json
    gltf["nodes"].append({"name": "camera"})
    first = gltf["animations"][0]
    sampler = first["samplers"][first["channels"][0]["sampler"]]
    path = first["channels"][0]["target"]["path"]
    channel = {"sampler": 0, "target": {"node": len(gltf["nodes"]) - 1, "path": path}}
    gltf["animations"].append({"name": "pan", "samplers": [sampler], "channels": [channel]})


def renamed(editor: Editor) -> None:
    skeleton_only(editor)
    for node in editor.json["nodes"]:
        node["name"] = f"rig:{node['name']}"


def one_renamed(editor: Editor) -> None:
    skeleton_only(editor)
    next(node for node in editor.json["nodes"] if node["name"] == "shin.L")["name"] = "shinL"


def run(body: Gltf, anim: Path, folder: Path) -> tuple[Gltf, Tracked]:
    (made,) = track(body.path, [anim], folder)
    return Gltf(Path(made.path)), made


def assert_tracks(made: Gltf, whole: Gltf, node: str, clip: str) -> None:
    """The weights of a body whose clip was baked, at its keys and between."""
    keys, _ = whole.keys(clip, node)
    times = np.union1d(keys, (keys[1:] + keys[:-1]) / 2)
    expected, found = (file.weights(node, clip, times) for file in (whole, made))
    assert made.mesh(node)["extras"]["targetNames"] == whole.mesh(node)["extras"]["targetNames"]
    assert expected[:, wrinkle_columns(whole, node)].max() > 0.1
    assert np.abs(found - expected).max() < CLOSE


@pytest.mark.parametrize("change", [skeleton_only, in_centimetres])
@pytest.mark.parametrize(("name", "clips"), [("trousers", ["squat", "walk"]), ("wrist", ["flex", "extend"])])
def test_a_clip_in_a_file_of_its_own_gets_the_weights_that_baking_gives(
    name: str, clips: list[str], change: Callable[[Editor], None], tmp_path: Path
) -> None:
    body, whole = body_of(name), bake_config(name, name)
    made, report = run(body, edited(name, change), tmp_path / "new" / "folder")
    assert not report.warnings
    assert list(report.clips) == [clip["name"] for clip in whole.json["animations"]]
    for clip in clips:
        if whole.weights(name, clip, whole.keys(clip, name)[0]).max() > 0.1:
            assert_tracks(made, whole, name, clip)
    assert_valid(made.path)


def test_nothing_else_changes_and_the_stub_costs_no_bytes(tmp_path: Path) -> None:
    anim = edited("trousers", skeleton_only)
    before, (made, _) = Gltf(anim), run(body_of("trousers"), anim, tmp_path)
    count = len(before.json["nodes"])
    assert made.json["nodes"][:count] == before.json["nodes"]
    (stub,) = made.json["nodes"][count:]
    assert stub == {"name": "trousers", "mesh": 0}
    assert made.json["scenes"][0]["nodes"] == [*before.json["scenes"][0]["nodes"], count]
    (primitive,) = made.json["meshes"][0]["primitives"]
    assert "bufferView" not in made.json["accessors"][primitive["attributes"]["POSITION"]]
    for old, new in zip(before.json["animations"], made.json["animations"], strict=True):
        assert new["channels"][:-1] == old["channels"]
        assert new["samplers"][:-1] == old["samplers"]
        assert new["channels"][-1]["target"] == {"node": count, "path": "weights"}
    for index in range(len(before.json["accessors"])):
        assert before.stored(index).tobytes() == made.stored(index).tobytes()


@pytest.mark.parametrize("name", ["trousers", "wrist"])
def test_three_js_drives_the_body_by_name(name: str, tmp_path: Path) -> None:
    body, whole = body_of(name), bake_config(name, name)
    made, report = run(body, edited(name, skeleton_only), tmp_path)
    for clip in report.clips:
        times, values = whole.keys(clip, name)
        found = drive(body.path, anim=made.path, node=name, clip=clip, times=times.tolist())
        for column, target in zip(values.T, whole.mesh(name)["extras"]["targetNames"], strict=True):
            assert np.abs(found[target][:, 0] - column).max() < CLOSE


def two_parts(editor: Editor) -> None:
    (primitive,) = editor.json["meshes"][0]["primitives"]
    editor.json["meshes"][0]["primitives"].append(dict(primitive))
    editor.json["meshes"][0]["name"] = "skin"
    scene_unnamed(editor)


def test_three_js_drives_every_part_of_a_body(tmp_path: Path) -> None:
    tools: Json = {"name": "palm", "origin": [-0.032, -0.022, 0.0], "target": [0.028, -0.0205, 0.0], "width": 0.065}
    body = bake_once(edited("wrist", two_parts), tools, tracks="none")
    made, _ = run(body, edited("wrist", skeleton_only), tmp_path)
    found = drive(body.path, anim=made.path, node="wrist", clip="flex", times=[0.0, 1.0])
    assert found["wrinkle_palm_1"].shape == (2, 2)
    assert found["wrinkle_palm_1"][1].min() > 0.1
    assert_valid(made.path)


@pytest.mark.parametrize("name", ["trousers", "head"])
def test_the_files_own_body_takes_the_tracks(name: str, tmp_path: Path) -> None:
    """The original, with the mesh that the body had before: it keeps its weights and gets targets that do nothing."""
    whole = bake_config(name, name)
    made, report = run(body_of(name), edited(name, scene_unnamed), tmp_path)
    before = Gltf(sample(name))
    # The head's joint has the name of its body, which is worth a word.
    assert len(report.warnings) == int(name == "head")
    assert len(made.json["nodes"]) == len(before.json["nodes"])
    times = np.linspace(0.0, 2.0, 101)
    for clip in report.clips:
        assert np.allclose(made.pose(name, clip, times), before.pose(name, clip, times), atol=1e-6)
        if whole.weights(name, clip, times)[:, wrinkle_columns(whole, name)].max() > 0.1:
            assert_tracks(made, whole, name, clip)
    assert_valid(made.path)


@pytest.mark.parametrize("name", ["trousers", "head"])
def test_a_body_with_the_targets_gets_its_tracks_anew(name: str, tmp_path: Path) -> None:
    whole = bake_config(name, name)
    made, _ = run(whole, whole.path, tmp_path)
    for clip in whole.json["animations"]:
        if whole.weights(name, clip["name"], whole.keys(clip["name"], name)[0])[:, wrinkle_columns(whole, name)].any():
            assert_tracks(made, whole, name, clip["name"])
    assert made.json["meshes"] == whole.json["meshes"]
    assert_valid(made.path)


def test_strengths_and_rest_lengths_of_a_clip(tmp_path: Path) -> None:
    keys = {"think": [[0.0, "100%"], [1.4, "118%"], [3.0, "100%"]]}
    tool: Json = {**BROW, "rest_length": {"keys": keys}, "clips": {"think": 0.5}}
    whole = bake_once("head", tool)
    made, _ = run(bake_once("head", tool, tracks="none"), sample("head"), tmp_path)
    assert_tracks(made, whole, "head", "think")


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    body = body_of("trousers")
    made, report = run(body, edited("trousers", one_renamed), tmp_path)
    assert any("knee.L" in line and "'shin.L'" in line for line in report.warnings)
    assert made.weights("trousers", "squat", [0.5, 1.0, 1.5]).any()
    made, report = run(body, edited("trousers", idle), tmp_path)
    assert report.clips == ("squat", "walk")
    assert any("pan" in line for line in report.warnings)


def test_a_name_that_three_js_would_change_is_said(tmp_path: Path) -> None:
    _, report = run(bake_config("trousers", "trousers"), edited("trousers", skeleton_only), tmp_path)
    assert any("three.js" in line for line in report.warnings)


def test_no_joint_in_common_is_an_error_and_writes_nothing(tmp_path: Path) -> None:
    body = bake_config("trousers", "trousers")
    fine, strange = edited("trousers", skeleton_only), edited("trousers", renamed)
    with pytest.raises(AssetError, match="joints"):
        track(body.path, [fine, strange], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_body_without_wrinkles(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="carries no wrinkles"):
        track(sample("trousers"), [sample("trousers")], tmp_path)


@pytest.mark.parametrize("value", [None, {}, {"tools": [{}]}, {"tools": [{"name": "x", "origin": 3}]}])
def test_extras_that_are_not_ours(value: object, tmp_path: Path) -> None:
    editor = Editor(Gltf(bake_config("trousers", "trousers").path))
    editor.json["nodes"][0]["extras"]["wrinkle"] = value
    with pytest.raises(AssetError, match="wrinkle"):
        track(editor.save(tmp_path / "body.glb"), [sample("trousers")], tmp_path / "out")


def test_a_mesh_with_other_targets_of_the_same_name(tmp_path: Path) -> None:
    editor = Editor(Gltf(sample("head")))
    editor.json["nodes"][0]["name"] = "trousers"
    editor.json["nodes"] += [{"name": name} for name in ("pelvis", "thigh.L", "shin.L", "thigh.R", "shin.R")]
    with pytest.raises(AssetError, match="other morph targets"):
        track(bake_config("trousers", "trousers").path, [editor.save(tmp_path / "a.glb")], tmp_path / "out")


def test_inputs_are_not_overwritten(tmp_path: Path) -> None:
    body = bake_config("trousers", "trousers")
    anim = tmp_path / "squat.glb"
    anim.write_bytes(sample("trousers").read_bytes())
    with pytest.raises(BakeError, match="overwritten"):
        track(body.path, [anim], tmp_path)
    with pytest.raises(BakeError, match="two inputs"):
        track(body.path, [anim, sample("trousers").parent / "trousers.glb", anim], tmp_path / "out")
    assert anim.read_bytes() == sample("trousers").read_bytes()


def test_same_input_same_bytes(tmp_path: Path) -> None:
    body, anim = bake_config("trousers", "trousers"), edited("trousers", skeleton_only)
    outputs = [track(body.path, [anim], tmp_path / name)[0].path for name in ("a", "b")]
    assert Path(outputs[0]).read_bytes() == Path(outputs[1]).read_bytes()
    assert read_document(outputs[0]).gltf["asset"] == read_document(anim).gltf["asset"]


@pytest.fixture
def wrinkle(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Wrinkle:
    monkeypatch.chdir(tmp_path)
    return Wrinkle(capfd, monkeypatch)


def test_from_the_command_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    body, anim = body_of("trousers").path, edited("trousers", skeleton_only)
    ran = wrinkle("track", body, anim, "-o", "out")
    assert (ran.code, ran.out) == (0, "")
    assert ran.lines == [f"out/{anim.name}: 2 clips: squat, walk"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == [anim.name]
    assert wrinkle("track", body, anim, "-o", "out", "-q").lines == []
    ran = wrinkle("track", body, edited("trousers", idle), "-o", "out", "--fps", "12")
    assert ran.code == 0
    assert ran.lines[0].startswith("warning: ")


def test_faults_on_the_command_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    body, strange = body_of("trousers").path, edited("trousers", renamed)
    assert wrinkle("track", body, strange, "-o", "out").code == 1
    assert wrinkle("track", body, "absent.glb", "-o", "out").code == 1
    assert wrinkle("track", body, "-o", "out").code == 2
    assert wrinkle("track", body, strange).code == 2
    assert wrinkle("track", body, "walk.fbx", "-o", "out").code == 2
    assert wrinkle("track", body, strange, "-o", "out", "--fps", "nan").code == 2
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    ran = wrinkle("track", body, edited("trousers", skeleton_only), "-o", "file")
    assert (ran.code, len(ran.lines)) == (1, 1)


def test_keyed_rest_lengths_of_several_groups_are_said_to_be_approximate(tmp_path: Path) -> None:
    body = bake_config("head", "head_keyed", tracks="none")
    _, report = run(body, edited("head", scene_unnamed), tmp_path)
    assert any("approximate" in line and "brow.L" in line for line in report.warnings)
    assert not any("approximate" in line and "brow_middle" in line for line in report.warnings)
