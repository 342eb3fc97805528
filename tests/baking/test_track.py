"""`wrinkle track`: the body in one file, each clip in another."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kit.asset import Asset
from kit.bakes import COARSE, bake_config, bake_once, place
from kit.clients import assert_valid, drive
from kit.command import Wrinkle
from kit.limb import limb_asset, tool
from kit.player import Gltf, Json, differences, wrinkle_columns
from kit.samples import BENT, BROW, Editor, bystanders, config, edited, sample, skeleton_only
from wrinklecli.baking import parts
from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.baking.driven_body import DrivenBody, with_own_weights
from wrinklecli.baking.track import Tracked, track
from wrinklecli.character.clip import read_clips
from wrinklecli.errors import AssetError, BakeError
from wrinklecli.gltf.document import read_document

# By default weights are right to 1 % of the greatest, those of a bake to the same; float32 adds a little.
CLOSE = 0.01 + 0.01 + 1e-3


def body_of(name: str, tools: str = "") -> Gltf:
    """A sample with wrinkles, and no tracks."""
    return bake_config(name, tools or name, tracks="none")


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
        node["name"] = f"other {node['name']}"


def of_another_program(editor: Editor) -> None:
    skeleton_only(editor)
    for node in editor.json["nodes"]:
        node["name"] = f"mixamorig9:{node['name']}"


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


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("name", "clips", "change"),
    [("wrist", ["flex", "extend"], skeleton_only), ("trousers", ["squat", "walk"], in_centimetres)],
)
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


@pytest.mark.slow
def test_tissue_lags_as_in_a_bake(tmp_path: Path) -> None:
    tools = config("wrist")
    tools["defaults"]["lag"] = {"frequency": 6, "damping": 0.5}
    whole = bake_once("wrist", top=tools, **COARSE)
    made, _ = run(whole, edited("wrist", skeleton_only), tmp_path)
    assert_tracks(made, whole, "wrist", "extend")


@pytest.mark.slow
def test_a_path_gets_the_weights_that_baking_gives(tmp_path: Path) -> None:
    body, whole = (bake_once("wrist", BENT, tracks=tracks) for tracks in ("none", "all"))
    made, _ = run(body, edited("wrist", skeleton_only), tmp_path)
    assert_tracks(made, whole, "wrist", "flex")


def with_bystanders(editor: Editor) -> None:
    """A skeleton in a file that has much else in it."""
    skeleton_only(editor)
    corners = editor.accessor(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), min=[0, 0, 0], max=[1, 1, 0])
    editor.json["meshes"] = [{"name": "prop", "primitives": [{"attributes": {"POSITION": corners}}]}]
    bystanders(editor)


def as_it_was(made: Gltf, before: Gltf) -> Json:
    """The document without what is meant to be new: a stub, and at the end of each clip one channel."""
    gltf: Json = json.loads(json.dumps(made.json))
    stub = len(before.json["nodes"])
    assert gltf["nodes"].pop()["mesh"] == len(gltf["meshes"]) - 1
    gltf["meshes"].pop()
    assert gltf["scenes"][gltf.get("scene", 0)]["nodes"].pop() == stub
    for animation in gltf["animations"]:
        if animation["channels"][-1]["target"] == {"node": stub, "path": "weights"}:
            assert animation["channels"].pop()["sampler"] == len(animation["samplers"]) - 1
            animation["samplers"].pop()
    for key in ("accessors", "bufferViews"):
        del gltf[key][len(before.json[key]) :]
    if "meshes" not in before.json:
        assert gltf.pop("meshes") == []
    gltf["buffers"][0]["byteLength"] = before.json["buffers"][0]["byteLength"]
    return gltf


@pytest.mark.slow
@pytest.mark.parametrize("change", [with_bystanders, idle, skeleton_only, in_centimetres])
def test_nothing_else_changes_and_the_stub_costs_three_points(change: Callable[[Editor], None], tmp_path: Path) -> None:
    anim = edited("trousers", change)
    before, (made, _) = Gltf(anim), run(body_of("trousers"), anim, tmp_path)
    count = len(before.json["nodes"])
    assert list(differences(before.json, as_it_was(made, before))) == []
    assert made.json["nodes"][count] == {"name": "trousers", "mesh": len(made.json["meshes"]) - 1}
    (primitive,) = made.json["meshes"][-1]["primitives"]
    assert {index for target in primitive["targets"] for index in target.values()} == {
        *primitive["attributes"].values()
    }
    assert made.json["meshes"][-1]["weights"] == [0.0] * len(primitive["targets"])
    for index in range(len(before.json["bufferViews"])):
        assert before.view_bytes(index) == made.view_bytes(index)
    added = made.json["bufferViews"][len(before.json["bufferViews"]) :]
    tracks = [made.keys(clip, count) for clip in ("squat", "walk")]
    numbers = 9 + sum(times.size + values.size for times, values in tracks)
    assert sum(view["byteLength"] for view in added) == 4 * numbers


@pytest.mark.slow
def test_keys_are_as_few_as_a_bakes(tmp_path: Path) -> None:
    whole = bake_config("trousers", "trousers")
    made, _ = run(body_of("trousers"), edited("trousers", skeleton_only), tmp_path)
    (coarse,) = track(body_of("trousers").path, [edited("trousers", skeleton_only)], tmp_path / "b", max_error=0.03)
    for clip in ("squat", "walk"):
        counts = [len(file.keys(clip, "trousers")[0]) for file in (whole, made, Gltf(Path(coarse.path)))]
        assert counts[1] < 1.5 * counts[0]
        assert counts[2] < 0.7 * counts[1]


def test_an_error_below_the_tables_own_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="1/2048"):
        track(body_of("trousers").path, [sample("trousers")], tmp_path, max_error=1 / 2048)


def test_buffers_outside_the_folder_are_read_on_request_only(tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    before = Gltf(edited("trousers", skeleton_only))
    document = {**before.json, "buffers": [{**before.json["buffers"][0], "uri": "../clip.bin"}]}
    (tmp_path / "clip.bin").write_bytes(before.buffers[0])
    anim = tmp_path / "clips" / "walk.gltf"
    anim.write_text(json.dumps(document))
    with pytest.raises(AssetError, match="outside"):
        track(body_of("trousers").path, [anim], tmp_path / "out")
    (made,) = track(body_of("trousers").path, [anim], tmp_path / "out", allow_external=True)
    assert_tracks(Gltf(Path(made.path)), bake_config("trousers", "trousers"), "trousers", "walk")


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["trousers", "wrist", "head"])
def test_three_js_drives_the_body_by_name(name: str, tmp_path: Path) -> None:
    body, whole = body_of(name), bake_config(name, name)
    # Of the head a clip moves the face itself, which needs its mesh.
    made, report = run(body, sample(name) if name == "head" else edited(name, skeleton_only), tmp_path)
    for clip in report.clips:
        times, values = whole.keys(clip, name)
        found = drive(body.path, anim=made.path, node=name, clip=clip, times=times.tolist())
        for column, target in zip(values.T, whole.mesh(name)["extras"]["targetNames"], strict=True):
            assert np.abs(found[target][:, 0] - column).max() < CLOSE


def two_parts(editor: Editor) -> None:
    (primitive,) = editor.json["meshes"][0]["primitives"]
    editor.json["meshes"][0]["primitives"].append(dict(primitive))
    editor.json["meshes"][0]["name"] = "skin"


def test_three_js_drives_every_part_of_a_body(tmp_path: Path) -> None:
    tools: Json = {"name": "palm", "origin": [-0.032, -0.022, 0.0], "target": [0.028, -0.0205, 0.0], "width": 0.065}
    body = bake_once(edited("wrist", two_parts), tools, tracks="none")
    made, _ = run(body, edited("wrist", skeleton_only), tmp_path)
    found = drive(body.path, anim=made.path, node="wrist", clip="flex", times=[0.0, 1.0])
    assert found["wrinkle_palm_1"].shape == (2, 2)
    assert found["wrinkle_palm_1"][1].min() > 0.1
    assert_valid(made.path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["trousers", "head"])
def test_the_files_own_body_takes_the_tracks(name: str, tmp_path: Path) -> None:
    """The original, with the mesh that the body had before: it keeps its weights and gets targets that do nothing."""
    whole = bake_config(name, name)
    made, report = run(body_of(name), sample(name), tmp_path)
    before = Gltf(sample(name))
    assert not report.warnings
    assert len(made.json["nodes"]) == len(before.json["nodes"])
    times = np.linspace(0.0, 2.0, 101)
    for clip in report.clips:
        assert np.allclose(made.pose(name, clip, times), before.pose(name, clip, times), atol=1e-6)
        if whole.weights(name, clip, times)[:, wrinkle_columns(whole, name)].max() > 0.1:
            assert_tracks(made, whole, name, clip)
    assert_valid(made.path)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["trousers", "head"])
def test_a_body_with_the_targets_gets_its_tracks_anew(name: str, tmp_path: Path) -> None:
    whole = bake_config(name, name)
    made, _ = run(whole, whole.path, tmp_path)
    for clip in whole.json["animations"]:
        if whole.weights(name, clip["name"], whole.keys(clip["name"], name)[0])[:, wrinkle_columns(whole, name)].any():
            assert_tracks(made, whole, name, clip["name"])
    assert made.json["meshes"] == whole.json["meshes"]
    assert_valid(made.path)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("strategy", "rest_length"),
    [
        (
            "everywhere",
            {
                "keys": {
                    "think": [[0.0, "100%"], [1.4, "118%"], [3.0, "100%"]],
                    "raise_brows": [[0, "90%"], [2, "125%"]],
                }
            },
        ),
        ("origin", {"morph": "browsUp", "full": "115%"}),
        ("both_ends", {"morph": "browsUp", "full": "85%"}),
    ],
)
def test_strengths_and_rest_lengths_of_a_clip(rest_length: Json, strategy: str, tmp_path: Path) -> None:
    tool: Json = {**BROW, "bumps": 5, "strategy": strategy, "rest_length": rest_length, "clips": {"think": 0.5}}
    tool["compressible"] = "30%"
    whole = bake_once("head", tool)
    made, report = run(bake_once("head", tool, tracks="none"), sample("head"), tmp_path)
    assert not report.warnings
    assert_tracks(made, whole, "head", "raise_brows")
    if "keys" in rest_length:
        assert_tracks(made, whole, "head", "think")
    else:
        assert not made.weights("head", "think", np.linspace(0, 3, 31)).any()


@pytest.mark.slow
def test_a_tool_of_some_clips_stays_flat_in_all_others(tmp_path: Path) -> None:
    for clip, acts in (("think", False), ("raise_brows", True)):
        tool: Json = {**BROW, "strength": 0, "clips": {clip: 0.5}}
        made, report = run(bake_once("head", tool, tracks="none"), sample("head"), tmp_path)
        assert not report.warnings
        if acts:
            assert_tracks(made, bake_once("head", tool), "head", "raise_brows")
        else:
            assert not made.weights("head", "raise_brows", np.linspace(0, 3, 31))[
                :, wrinkle_columns(made, "head")
            ].any()


@pytest.mark.slow
@pytest.mark.parametrize("clip", ["think", "raise_brows"])
def test_keyed_rest_lengths_of_a_sample(clip: str, tmp_path: Path) -> None:
    made, report = run(body_of("head", "head_keyed"), sample("head"), tmp_path)
    assert not report.warnings
    assert_tracks(made, bake_config("head", "head_keyed"), "head", clip)


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    body = body_of("trousers")
    made, report = run(body, edited("trousers", one_renamed), tmp_path)
    assert any("knee_out.L" in line and "'shin.L'" in line for line in report.warnings)
    assert made.weights("trousers", "squat", [0.5, 1.0, 1.5]).any()
    made, report = run(body, edited("trousers", idle), tmp_path)
    assert report.clips == ("squat", "walk")
    assert any("pan: moves no anchor of 'trousers': it moves only 'camera'" in line for line in report.warnings)


@pytest.mark.slow
def test_a_name_that_three_js_would_change_is_said(tmp_path: Path) -> None:
    def scene_of_its_name(editor: Editor) -> None:
        editor.json["scenes"][0]["name"] = "trousers"

    body = bake_once(edited("trousers", scene_of_its_name), top=config("trousers"), tracks="none", **COARSE)
    _, report = run(body, edited("trousers", skeleton_only), tmp_path)
    assert any("three.js" in line for line in report.warnings)


@pytest.mark.slow
def test_prefixes_of_programs_do_not_count_and_are_said(tmp_path: Path) -> None:
    made, report = run(body_of("trousers"), edited("trousers", of_another_program), tmp_path)
    assert_tracks(made, bake_config("trousers", "trousers"), "trousers", "squat")
    (note,) = (line for line in report.notes if "without prefixes" in line)
    assert re.search(r"'mixamorig9:(\S+)' counts as '\1', as their names are the same without prefixes, and \d", note)


def test_no_joint_in_common_is_an_error_and_writes_nothing(tmp_path: Path) -> None:
    body = bake_config("trousers", "trousers")
    fine, strange = edited("trousers", skeleton_only), edited("trousers", renamed)
    with pytest.raises(AssetError, match="joints"):
        track(body.path, [fine, strange], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_body_without_wrinkles(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="carries no wrinkles"):
        track(sample("trousers"), [sample("trousers")], tmp_path)


@pytest.mark.parametrize(
    "value",
    [None, {}, {"layout": 3}, {"layout": 3, "tools": [{}]}, {"layout": 3, "tools": [{"name": "x", "origin": 3}]}],
)
def test_extras_that_are_not_ours(value: object, tmp_path: Path) -> None:
    editor = Editor(Gltf(bake_config("trousers", "trousers").path))
    editor.json["nodes"][0]["extras"]["wrinkle"] = value
    with pytest.raises(AssetError, match="wrinkle"):
        track(editor.save(tmp_path / "body.glb"), [sample("trousers")], tmp_path / "out")


@pytest.mark.slow
def test_targets_that_no_extras_drive_rest_in_other_clips_and_stay_in_their_own(tmp_path: Path) -> None:
    asset = place(limb_asset(rings=12, sides=8))
    body = bake_once(asset, tool(), tool(name="paper", attachment="patch"), max_levels=0)
    undriven = body.json["nodes"][0]["extras"]["wrinkle"]["undriven"]
    names = body.mesh("limb")["extras"]["targetNames"]
    columns = [names.index(name) for name in undriven]
    for source, wanted in ((asset, 0.0), (body.path, 1.0)):
        made, report = run(body, source, tmp_path)
        assert not report.warnings
        times, _ = made.keys("fold", "limb")
        assert made.mesh("limb")["extras"]["targetNames"] == names
        weights, baked = (file.weights("limb", "fold", times) for file in (made, body))
        assert baked[:, columns].any()
        assert np.allclose(weights[:, columns], wanted * baked[:, columns], atol=1e-6)
        assert np.abs(weights - baked)[:, [k for k in range(len(names)) if k not in columns]].max() < CLOSE


def with_other_targets(editor: Editor) -> None:
    """The targets in another order, with one more before them, whose weight is a quarter in every clip."""
    gltf = editor.json
    mesh = gltf["meshes"][0]
    names = mesh["extras"]["targetNames"]
    mesh["extras"]["targetNames"] = ["smirk", *reversed(names)]
    mesh["weights"] = [0.0] * (len(names) + 1)
    for primitive in mesh["primitives"]:
        primitive["targets"] = [primitive["targets"][0], *reversed(primitive["targets"])]
    before = Gltf(sample("head"))
    for animation in gltf["animations"]:
        _, values = before.keys(animation["name"], "head")
        made = np.column_stack([np.full(len(values), 0.25), values[:, ::-1]])
        (channel,) = (each for each in animation["channels"] if each["target"]["path"] == "weights")
        animation["samplers"][channel["sampler"]]["output"] = editor.accessor(made.reshape(-1, 1).astype(np.float32))


@pytest.mark.slow
def test_weights_of_other_targets_go_to_those_of_the_same_names(tmp_path: Path) -> None:
    """`bake --anim` matches them so too; what the body lacks stays in the file, behind its targets, and is named."""
    body = body_of("head")
    made, report = run(body, edited("head", with_other_targets), tmp_path)
    (warning,) = report.warnings
    assert "has no morph targets 'smirk'" in warning
    names = body.mesh("head")["extras"]["targetNames"]
    assert made.mesh("head")["extras"]["targetNames"] == [*names, "smirk"]
    plain, _ = run(body, sample("head"), tmp_path / "plain")
    for clip in report.clips:
        times, _ = made.keys(clip, "head")
        weights = made.weights("head", clip, times)
        assert np.allclose(weights[:, :-1], plain.weights("head", clip, times), atol=1e-6)
        assert np.allclose(weights[:, -1], 0.25)
    assert_valid(made.path)


@pytest.mark.slow
def test_two_targets_of_one_name_are_refused(tmp_path: Path) -> None:
    editor = Editor(Gltf(edited("head", with_other_targets)))
    editor.json["meshes"][0]["extras"]["targetNames"][1] = "smirk"
    with pytest.raises(AssetError, match="several morph targets of one name, 'smirk'"):
        track(body_of("head").path, [editor.save(tmp_path / "a.glb")], tmp_path / "out")


def without_position(primitive: Json) -> None:
    del primitive["attributes"]["POSITION"]


def without_attributes(primitive: Json) -> None:
    del primitive["attributes"]


@pytest.mark.parametrize("change", [without_position, without_attributes])
def test_a_mesh_without_vertices_is_said(change: Callable[[Json], None], tmp_path: Path) -> None:
    def broken(editor: Editor) -> None:
        change(editor.json["meshes"][0]["primitives"][0])

    with pytest.raises(AssetError, match="#/meshes/0/primitives/0: has no POSITION"):
        track(body_of("wrist").path, [edited("wrist", broken)], tmp_path)


def test_a_mesh_without_primitives_is_said(tmp_path: Path) -> None:
    def broken(editor: Editor) -> None:
        del editor.json["meshes"][0]["primitives"]

    with pytest.raises(AssetError, match="#/meshes/0: has no primitives"):
        track(body_of("wrist").path, [edited("wrist", broken)], tmp_path)


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


# Two tools behind each knee of the sample trousers; the second has so much slack that no step of a walk raises it.
KNEE: Json = {
    "name": "knee.L",
    "mirror": "x",
    "width": 0.24,
    "origin": [0.104, 0.635, -0.0906],
    "target": [0.104, 0.365, -0.0844],
}
SLANT: Json = {
    **KNEE,
    "name": "knee_slant.L",
    "origin": [0.134, 0.6, -0.0776],
    "target": [0.076, 0.4, -0.0739],
    "rest_length": "65%",
}


@pytest.mark.slow
def test_from_the_command_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    body, anim = bake_once("trousers", KNEE, SLANT, tracks="none").path, edited("trousers", skeleton_only)
    ran = wrinkle("track", body, anim, "-o", "out")
    assert (ran.code, ran.out) == (0, "")
    assert ran.lines == [f"out/{anim.name}: 2 clips: squat, walk"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == [anim.name]
    assert wrinkle("track", body, anim, "-o", "out", "-q").lines == []
    ran = wrinkle("track", body, edited("trousers", idle), "-o", "out", "--fps", "12")
    assert ran.code == 0
    assert ran.lines[0].startswith("warning: ")
    ran = wrinkle("track", body, anim, "-o", "out", "-v", "--max-error", "2%", "--allow-external")
    assert ran.code == 0
    assert ran.lines[0] == "knee.L on trousers: targets wrinkle_knee_L_1"
    assert [line.split(": ")[0] for line in ran.lines[:4]] == [
        f"{knee}.{side} on trousers" for knee in ("knee", "knee_slant") for side in "LR"
    ]
    reason = r"walk: knee_slant\.[LR] stays flat, as its ends come no closer than 1\d\d\.?\d? % of its rest length"
    assert all(re.search(reason, line) for line in ran.lines[4:6])
    assert len(ran.lines) == 7


def skeleton(*animations: Json, names: tuple[str | None, ...] = ("other", "joint_0", "joint_1")) -> Asset:
    """The joints of a limb with clips, {name: turns of the inner joint about z by degrees, a second apart}."""
    asset = limb_asset(rings=2, sides=3, clip=None)
    gltf = asset.gltf
    gltf["nodes"] = [{key: value for key, value in node.items() if key != "name"} for node in gltf["nodes"]]
    for node, name in zip(gltf["nodes"], names, strict=True):
        node |= {} if name is None else {"name": name}
    for key in ("mesh", "skin"):
        del gltf["nodes"][0][key]
    del gltf["meshes"], gltf["skins"]
    for animation in animations:
        for name, degrees in animation.items():
            halves = np.radians(degrees) / 2.0
            clip: Json = {"name": name}
            asset.channel(
                clip, 2, "rotation", np.arange(len(halves)), [[0, 0, np.sin(half), np.cos(half)] for half in halves]
            )
            asset.append("animations", clip)
    return asset


def limb_body(**keys: Json) -> Gltf:
    return bake_once(place(limb_asset(rings=12, sides=8)), tool(**keys), tracks="none", max_levels=0)


def test_a_clip_that_raises_nothing_is_told_with_the_reason(wrinkle: Wrinkle, tmp_path: Path) -> None:
    body, anim = limb_body(clips={"fold": 0}).path, place(skeleton({"back": [0, -60]}, {"fold": [0, 100]}))
    _, report = run(Gltf(body), anim, tmp_path)
    assert report.clips == ("back", "fold")
    assert report.flat == (
        f"{anim}: back: crease stays flat, as its ends come no closer than 100 % of its rest length",
        f"{anim}: fold: crease stays flat, as its strength is 0 in this clip",
    )
    assert report.notes == tuple(
        line.replace(": crease", ": raises no wrinkle of 'limb': crease") for line in report.flat
    )
    assert not report.warnings
    ran = wrinkle("track", body, anim, "-o", "out", "--strict")
    assert (ran.code, ran.lines[:-1]) == (0, list(report.notes))
    assert wrinkle("track", body, anim, "-o", "out", "-q").lines == []


def test_clips_of_no_time_and_clips_of_one_name(tmp_path: Path) -> None:
    anim = place(skeleton({"pose": [100]}, {"fold": [0, 100]}, {"fold": [0, 10]}, {"": [0, 100]}))
    made, report = run(limb_body(), anim, tmp_path)
    assert report.clips == ("pose", "fold", "fold#2", "animation_3")
    assert not report.warnings
    weights = [made.weights("limb", clip, [0.0, 1.0])[:, 0] for clip in range(4)]
    assert np.allclose(weights[0], 1.0)
    assert np.allclose(weights[1], [0.0, 1.0])
    assert 0.1 < weights[2][1] < 1.0
    assert np.allclose(weights[3], weights[1])
    assert_valid(made.path)


def test_a_file_without_names_is_told_why(tmp_path: Path) -> None:
    anim = place(skeleton({"fold": [0, 100]}, names=(None, None, "")))
    with pytest.raises(AssetError, match=r"'joint_0', 'joint_1', its nodes are none; 3 more nodes without a name"):
        track(limb_body().path, [anim], tmp_path)


def test_the_bodys_node_without_its_mesh_gets_the_stub(tmp_path: Path) -> None:
    """A further node of its name would get another one in three.js."""
    anim = place(skeleton({"fold": [0, 100]}, names=("limb", "joint_0", "joint_1")))
    body = limb_body()
    made, report = run(body, anim, tmp_path)
    assert not report.warnings
    assert len(made.json["nodes"]) == 3
    found = drive(body.path, anim=made.path, node="limb", clip="fold", times=[0.0, 1.0])
    assert np.allclose(found["wrinkle_crease_1"][:, 0], [0.0, 1.0])


def test_names_that_three_js_makes_one_are_said(tmp_path: Path) -> None:
    asset = limb_asset(rings=12, sides=8)
    asset.gltf["nodes"][0]["name"], asset.gltf["nodes"][1]["name"] = "the.limb", "the[limb]"
    body = bake_once(place(asset), tool(), tracks="none", max_levels=0)
    _, report = run(body, place(skeleton({"fold": [0, 100]}, names=("other", "the[limb]", "joint_1"))), tmp_path)
    assert any("named 'the.limb' too" in line for line in report.warnings)


def test_joints_of_the_files_own_body_go_first(tmp_path: Path) -> None:
    """Another character of the file has joints of the same names, and comes first."""
    asset = limb_asset(rings=12, sides=8)
    gltf = asset.gltf
    gltf["nodes"] = [
        {"name": "joint_0", "children": [1]},
        {"name": "joint_1", "translation": [1.0, 0.0, 0.0]},
        {"name": "limb", "mesh": 0, "skin": 1},
        {"name": "joint_0", "translation": [-1.0, 0.0, 0.0], "children": [4]},
        {"name": "joint_1", "translation": [1.0, 0.0, 0.0]},
    ]
    gltf["skins"] = [{"joints": [0, 1]}, {**gltf["skins"][0], "joints": [3, 4], "skeleton": 3}]
    gltf["scenes"][0]["nodes"] = [0, 2, 3]
    gltf["animations"][0]["channels"][0]["target"]["node"] = 4
    made, report = run(limb_body(), place(asset), tmp_path)
    assert not report.warnings
    assert np.allclose(made.weights("limb", "fold", [0.0, 1.0])[:, 0], [0.0, 1.0])


@pytest.mark.parametrize("mesh", [True, False])
def test_parts_without_skin_move_as_their_node_does(
    mesh: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts, "_WORTH", 2000)
    asset = limb_asset(skinned=False, morphs=1, morph_clip="LINEAR", rings=16)
    asset.channel(asset.gltf["animations"][0], 0, "translation", [0.0, 1.0], [[0, 0, 0], [0, 3, 0]])
    other = {"name": "other", "origin": [-0.3, 0.0, 0.25], "target": [0.3, 0.0, 0.25]}
    body = bake_once(place(asset), tool(width=0.2), tool(**other), tracks="none", split=True)
    names = [node["name"] for node in body.json["nodes"]]
    assert names[:2] == ["limb", "limb_part2"]
    if not mesh:
        del asset.gltf["nodes"][0]["mesh"], asset.gltf["meshes"]
        clip = asset.gltf["animations"][0]
        clip["channels"] = [each for each in clip["channels"] if each["target"]["path"] != "weights"]
    made, _ = run(body, place(asset), tmp_path)
    found = {node["name"]: index for index, node in enumerate(made.json["nodes"])}
    moved = [
        each["target"]["node"] for each in made.json["animations"][0]["channels"] if "trans" in each["target"]["path"]
    ]
    assert moved == [found[name] for name in names]
    assert_valid(made.path)


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ({}, "has the layout 1 of an older `wrinkle`: bake it again from its source"),
        ({"layout": 4}, "has the layout 4 of a newer `wrinkle`, and this one reads layout 3"),
    ],
)
def test_extras_of_another_layout_are_refused(layout: Json, said: str, tmp_path: Path) -> None:
    editor = Editor(Gltf(bake_config("wrist", "wrist").path))
    wrinkled = next(node for node in editor.json["nodes"] if "extras" in node)
    del wrinkled["extras"]["wrinkle"]["layout"]
    wrinkled["extras"]["wrinkle"] |= layout
    with pytest.raises(AssetError, match=said):
        track(editor.save(tmp_path / "other.glb"), [sample("wrist")], tmp_path / "tracks")


@pytest.mark.slow
def test_warnings_refuse_on_request(wrinkle: Wrinkle, tmp_path: Path) -> None:
    body = body_of("trousers").path
    ran = wrinkle("track", body, edited("trousers", skeleton_only), edited("trousers", idle), "-o", "out", "--strict")
    assert ran.code == 3
    assert any("pan" in line for line in ran.lines)
    assert not (tmp_path / "out").exists()
    assert wrinkle("track", body, edited("trousers", skeleton_only), "-o", "out", "--strict").code == 0


def test_faults_on_the_command_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    body, strange = body_of("trousers").path, edited("trousers", renamed)
    assert wrinkle("track", body, strange, "-o", "out").code == 1
    assert wrinkle("track", body, "absent.glb", "-o", "out").code == 1
    assert wrinkle("track", body, "-o", "out").code == 2
    assert wrinkle("track", body, strange).code == 2
    assert wrinkle("track", body, "walk.fbx", "-o", "out").code == 2
    assert wrinkle("track", body, strange, "-o", "out", "--fps", "nan").code == 2
    assert wrinkle("track", body, strange, "-o", "out", "--max-error", "100%").code == 1
    for wrong in ("1", "0.048%", "nan%", "x%", "101%"):
        assert wrinkle("track", body, strange, "-o", "out", "--max-error", wrong).code == 2
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    ran = wrinkle("track", body, edited("trousers", skeleton_only), "-o", "file")
    assert (ran.code, len(ran.lines)) == (1, 1)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["wrist", "head_keyed"])
def test_a_bake_s_own_tracks_are_those_of_its_stored_drives(name: str) -> None:
    """A player looks up by the extras of the file what the bake has written into its clips."""
    file = bake_config(name.removesuffix("_keyed"), name)
    document = read_document(file.path)
    (body,) = read_bodies(document)
    driven = DrivenBody.of(document, file.node(body.node), body, body.drives)
    targets = file.mesh(body.node)["extras"]["targetNames"]
    columns = [targets.index(each) for each in body.driven]
    compared = 0
    for clip in read_clips(document):
        times, weights = file.keys(clip.name, body.node)
        played = driven.weights_in(with_own_weights(clip, file.node(body.node), body, targets))(times)
        off = np.abs(played - weights[:, columns])
        # Extras have five digits of weights. Where a group of bumps starts, digits of anchors count for their root.
        assert np.percentile(off, 98) < 2e-5
        assert off.max() < 2e-3
        compared += int(weights[:, columns].any())
    assert compared
