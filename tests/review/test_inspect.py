"""`wrinkle inspect`: what it says of samples, of every form of the limb, of baked files, and of broken ones."""

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

import wrinklecli
from kit.asset import Asset
from kit.command import Wrinkle, files
from kit.fields import sleeve_with_turns
from kit.limb import limb, limb_asset, tool, write_tools
from kit.player import Gltf, Json
from kit.samples import sample
from wrinklecli.character.clip import read_clips
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.review.inspect import KINDS, _described, inspect


@pytest.mark.parametrize("name", ["wrist", "head", "trousers"])
def test_a_sample_is_described_as_it_is(name: str) -> None:
    found, file = inspect(sample(name)), Gltf(sample(name))
    (mesh,) = found["meshes"]
    (primitive,) = file.json["meshes"][0]["primitives"]
    assert mesh["vertices"] == len(file.stored(primitive["attributes"]["POSITION"]))
    assert mesh["triangles"] == len(file.stored(primitive["indices"])) / 3
    assert mesh["primitives"][0]["attributes"] == list(primitive["attributes"])
    assert mesh["morph_targets"] == file.json["meshes"][0].get("extras", {}).get("targetNames", [])
    (skin,) = found["skins"]
    assert skin["joints"] == [file.json["nodes"][joint]["name"] for joint in file.json["skins"][0]["joints"]]
    assert found["deforming"] == [
        {"node": name, "mesh": 0, "skin": 0, "morph_targets": len(mesh["morph_targets"])},
    ]
    for clip, read in zip(found["clips"], read_clips(read_document(sample(name))), strict=True):
        assert (clip["name"], clip["start"], clip["end"]) == (read.name, read.start, read.end)
        assert clip["keys"] == max(len(channel.times) for channel in read.channels)
        assert clip["nodes"] == len({channel.node for channel in read.channels})
        assert sum(clip["channels"].values()) == len(read.channels)
    assert found["wrinkles"] == []
    assert found["replaceable"] is None


MODES = ["points", "lines", "line loop", "line strip", "triangles", "triangle strip", "triangle fan", "7"]


@pytest.mark.parametrize(("mode", "name"), list(enumerate(MODES)))
def test_modes_of_primitives_have_names(mode: int, name: str, tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["meshes"][0]["primitives"][0]["mode"] = mode
    (mesh,) = inspect(asset.write(tmp_path / "limb.glb"))["meshes"]
    assert mesh["primitives"][0]["mode"] == name


@pytest.mark.parametrize(
    "options",
    [
        {"mode": "strip", "indices": "u1", "rings": 6},
        {"mode": "fan", "rings": 5, "primitives": 2},
        {"indices": None},
        {"interleave": True, "primitives": 3},
        {"sparse": "zeros", "morphs": 3, "morph_clip": "CUBICSPLINE"},
        {"skinned": False, "clip": "grow"},
        {"clip": None},
    ],
)
def test_counts_are_those_of_the_data(options: Json, tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", **options)
    found, document = inspect(path), read_document(path)
    for mesh, described in zip(document.items("meshes"), found["meshes"], strict=True):
        for primitive, each in zip(mesh["primitives"], described["primitives"], strict=True):
            assert each["vertices"] == len(document.accessor(primitive["attributes"]["POSITION"]))
            assert each["morph_targets"] == options.get("morphs", 0)
            corners = len(document.accessor(primitive["indices"])) if "indices" in primitive else each["vertices"]
            assert each["triangles"] == (corners // 3 if each["mode"] == "triangles" else corners - 2)
    names = [clip.name for clip in read_clips(document)]
    assert [clip["name"] for clip in found["clips"]] == names
    assert [each["node"] for each in found["deforming"]] == (["limb"] if options.get("skinned", True) else [])


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
@pytest.mark.parametrize("options", [{}, {"morphs": 2, "interleave": True}, {"sparse": "base"}])
def test_bytes_add_up_to_the_files(options: Json, ending: str, tmp_path: Path) -> None:
    path = limb(tmp_path / f"limb{ending}", **options)
    found = inspect(path)
    assert [each["name"] for each in found["files"]] == [str(path), *(str(p) for p in tmp_path.glob("*.bin"))]
    assert [each["bytes"] for each in found["files"]] == [os.path.getsize(each["name"]) for each in found["files"]]
    assert tuple(found["bytes"]) == KINDS
    assert sum(found["bytes"].values()) == sum(each["bytes"] for each in found["files"])
    document = read_document(path)
    primitive = document.items("meshes")[0]["primitives"][0]
    assert found["bytes"]["indices"] == document.accessor(primitive["indices"]).size * 2
    if not options:
        stored = sum(document.stored(index).nbytes for index in primitive["attributes"].values())
        # JOINTS of single bytes are four; positions, normals and UVs are floats: nothing is padded.
        assert found["bytes"]["geometry"] == stored
    if options.get("morphs"):
        targets = [index for target in primitive["targets"] for index in target.values()]
        assert found["bytes"]["morph targets"] == sum(document.stored(index).nbytes for index in targets)
    assert found["bytes"]["skins"] == 2 * 64
    assert found["bytes"]["animation"] > 0


def test_a_view_that_serves_two_purposes_is_shared_among_them(tmp_path: Path) -> None:
    asset = limb_asset(morphs=1)
    accessors, views = asset.gltf["accessors"], asset.gltf["bufferViews"]
    primitive = asset.gltf["meshes"][0]["primitives"][0]
    before = inspect(asset.write(tmp_path / "a.glb"))["bytes"]
    # The morph target's bytes and those of the positions, in one view.
    position, morph = (
        accessors[index] for index in (primitive["attributes"]["POSITION"], primitive["targets"][0]["POSITION"])
    )
    data = b"".join(
        bytes(asset.data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
        for view in (views[position["bufferView"]], views[morph["bufferView"]])
    )
    half = views[position["bufferView"]]["byteLength"]
    position["bufferView"] = morph["bufferView"] = asset.view(data)
    morph["byteOffset"] = half
    after = inspect(asset.write(tmp_path / "b.glb"))["bytes"]
    assert {kind: after[kind] for kind in KINDS[:-1]} == {kind: before[kind] for kind in KINDS[:-1]}


def test_images_count_where_they_are(tmp_path: Path) -> None:
    asset = limb_asset()
    embedded = asset.view(b"\x89PNG" + bytes(96))
    asset.gltf["images"] = [
        {"bufferView": embedded, "mimeType": "image/png"},
        {"uri": "skin.png"},
        {"uri": "absent.png"},
        {"uri": "../outside.png"},
        {"uri": "data:image/png;base64,iVBORw=="},
    ]
    folder = tmp_path / "asset"
    folder.mkdir()
    path = asset.write(folder / "limb.gltf")
    (folder / "skin.png").write_bytes(bytes(1000))
    (tmp_path / "outside.png").write_bytes(bytes(70))
    found = inspect(path)
    assert found["bytes"]["images"] == 100 + 1000 + 4
    sizes = {Path(each["name"]).name: each["bytes"] for each in found["files"]}
    assert (sizes["skin.png"], sizes["absent.png"], sizes["outside.png"]) == (1000, None, None)
    assert inspect(path, allow_external=True)["bytes"]["images"] == 100 + 1000 + 4 + 70


def test_bounds_and_joints_are_where_they_are_in_the_stored_pose(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4, joints=3, root={"translation": [0.0, 5.0, 0.0], "scale": [2.0, 2.0, 2.0]})
    asset.gltf["skins"].append({"name": "again", "joints": asset.gltf["skins"][0]["joints"][:2]})
    path = asset.write(tmp_path / "limb.glb")
    found = inspect(path)
    low, high = found["bounds"]["min"], found["bounds"]["max"]
    assert [*low, *high] == pytest.approx([-2.0, 4.5, -0.5, 2.0, 5.5, 0.5], abs=1e-6)
    places = [[-2.0, 5.0, 0.0], [-2.0 / 3.0, 5.0, 0.0], [2.0 / 3.0, 5.0, 0.0]]
    assert found["skins"][0]["rest"] == [pytest.approx(place, abs=1e-6) for place in places]
    ran = wrinkle("inspect", path)
    assert "  [-2, 4.5, -0.5] to [2, 5.5, 0.5], as stored" in ran.out.splitlines()
    first, second = (line for line in ran.out.splitlines() if "joint_0" in line)
    assert first.endswith("3 joints: joint_0 [-2, 5, 0], joint_1 [-0.6667, 5, 0], joint_2 [0.6667, 5, 0]")
    assert second == "  again: 2 joints: joint_0, joint_1"


def test_many_joints_are_a_tree_of_chains_with_both_sides_on_one_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4, joints=11)
    (skin,) = asset.gltf["skins"]
    joints = [asset.gltf["nodes"][joint] for joint in skin["joints"]]
    joints[0]["children"].append(skin["joints"][6])
    del joints[5]["children"]
    for number, joint in enumerate(joints[1:]):
        joint["name"] = f"leg_{number % 5}.{'LR'[number // 5]}"
    path = asset.write(tmp_path / "limb.glb")
    assert inspect(path)["skins"][0]["parents"] == [None, 0, 1, 2, 3, 4, 0, 6, 7, 8, 9]
    lines = wrinkle("inspect", path).out.splitlines()
    at = lines.index("skins")
    assert lines[at + 1].endswith(": 11 joints")
    assert lines[at + 2] == "    joint_0 [-1, 0, 0]"
    assert re.fullmatch(
        r"      leg_0\.L \[[^]]*\] > leg_1\.L > leg_2\.L > leg_3\.L > leg_4\.L, and the other side", lines[at + 3]
    )
    joints[-1]["name"] = "toes"
    lines = wrinkle("inspect", asset.write(tmp_path / "limb.glb")).out.splitlines()
    assert [line.split()[0] for line in lines[at + 2 : at + 5]] == ["joint_0", "leg_0.L", "leg_0.R"]


def test_what_cannot_be_read_has_no_bounds(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["meshes"][0]["primitives"][0]["attributes"].pop("POSITION")
    assert inspect(asset.write(tmp_path / "limb.glb"))["bounds"] is None
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["nodes"][2]["children"] = [1]
    found = inspect(asset.write(tmp_path / "limb.glb"))
    assert (found["bounds"], found["skins"][0]["rest"]) == (None, None)


@pytest.mark.quick(1)
@pytest.mark.parametrize("levels", [0, None])
def test_a_baked_file_names_its_tools(levels: int | None, tmp_path: Path) -> None:
    limb(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(name="a", strategy="both_ends"), tool(name="b", bumps=2))
    wrinklecli.bake(tmp_path / "limb.glb", tools, tmp_path / "out.glb", max_levels=levels)
    found = inspect(tmp_path / "out.glb")
    (wrinkles,) = found["wrinkles"]
    assert wrinkles["node"] == "limb"
    assert [each["name"] for each in wrinkles["tools"]] == ["a", "b"]
    targets = [name for each in wrinkles["tools"] for name in each["targets"]]
    assert targets == found["meshes"][0]["morph_targets"]
    assert [each["rest_length"] for each in wrinkles["tools"]] == pytest.approx([0.8, 0.8], abs=1e-3)
    # The folding joint is in the middle: each end hangs on one side's.
    assert wrinkles["tools"][0]["origin_joints"] == ["joint_0"]
    assert wrinkles["tools"][0]["target_joints"] == ["joint_1"]
    assert found["bytes"]["original"] > 0
    assert sum(found["bytes"].values()) == os.path.getsize(tmp_path / "out.glb")


def test_a_baked_field_names_its_joints_with_their_ranges(wrinkle: Wrinkle) -> None:
    path = sleeve_with_turns().path
    (wrinkles,) = inspect(path)["wrinkles"]
    (found,) = wrinkles["fields"]
    assert [(each["joint"], each["shapes"]) for each in found["turns"]] == [
        ("joint_1", 2),
        ("joint_1", 1),
        ("joint_2", 2),
    ]
    assert found["turns"][1]["degrees"] == pytest.approx([-17.19, 22.92], abs=0.01)
    assert found["targets"] == [f"morph_{k}" for k in range(5)]
    assert wrinkles["tools"] == []
    said = (
        "folds: folds as joints turn: joint_1 by 0 to 45.84°, joint_1 by -17.19 to 22.92°, joint_2 by 11.46 to 108.9°"
    )
    assert said in wrinkle("inspect", path).out


def test_it_says_whether_a_bake_can_be_replaced_as_a_bake_then_finds(tmp_path: Path) -> None:
    limb(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml")
    wrinklecli.bake(tmp_path / "limb.glb", tools, tmp_path / "out.glb", max_levels=0)
    file = Gltf(tmp_path / "out.glb")
    shutil.copy(tmp_path / "out.glb", tmp_path / "same.glb")
    file.json["meshes"][0]["primitives"][0]["attributes"].pop("TEXCOORD_0")
    Asset(file.json, bytearray(file.buffers[0])).write(tmp_path / "changed.glb")
    states = set()
    for name in ("same.glb", "changed.glb"):
        try:
            wrinklecli.bake(tmp_path / name, tools, tmp_path / "again.glb", replace=True)
            replaced = True
        except WrinkleError:
            replaced = False
        assert inspect(tmp_path / name)["replaceable"] is replaced
        states.add(replaced)
    assert states == {True, False}


def test_clips_have_the_names_that_other_commands_take(tmp_path: Path) -> None:
    asset = limb_asset()
    first = asset.gltf["animations"][0]
    asset.gltf["animations"] += [json.loads(json.dumps(first)), {"channels": [], "samplers": []}]
    unnamed = json.loads(json.dumps(first))
    del unnamed["name"]
    asset.gltf["animations"].append(unnamed)
    path = asset.write(tmp_path / "limb.glb")
    names = [clip["name"] for clip in inspect(path)["clips"]]
    assert names == [clip.name for clip in read_clips(read_document(path))] == ["fold", "fold#1", "animation_3"]


def test_geometry_is_decoded_for_the_bounds_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = limb(tmp_path / "limb.glb", morphs=2, morph_clip="LINEAR")
    found = inspect(path)

    def refuse(*_: object, **__: object) -> None:
        raise AssetError("cannot be decoded")

    monkeypatch.setattr(Document, "accessor", refuse)
    monkeypatch.setattr(Document, "view", refuse)
    assert inspect(path) == found | {"bounds": None}


@pytest.mark.parametrize(
    "entry",
    [
        1,
        {"tools": 5},
        {"tools": [{"name": "a"}]},
        {"tools": [{"name": "a", "origin": {"joints": 1}, "target": {"joints": []}, "rest_length": 1, "targets": []}]},
        {
            "tools": [
                {"name": "a", "origin": {"joints": []}, "target": {"joints": []}, "rest_length": "1", "targets": []}
            ]
        },
    ],
)
def test_extras_that_are_no_bake_s_are_refused(entry: Any, tmp_path: Path) -> None:
    asset = limb_asset()
    asset.gltf["nodes"][0]["extras"] = {"wrinkle": entry}
    with pytest.raises(AssetError, match="is not what `wrinkle bake` writes"):
        inspect(asset.write(tmp_path / "limb.glb"))


def test_key_times_without_bounds_leave_the_duration_open(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb_asset()
    for sampler in asset.gltf["animations"][0]["samplers"]:
        asset.gltf["accessors"][sampler["input"]].pop("max")
    path = asset.write(tmp_path / "limb.glb")
    (clip,) = inspect(path)["clips"]
    assert (clip["start"], clip["end"], clip["keys"]) == (0.0, None, 3)
    assert "fold: unknown duration, 3 keys" in wrinkle("inspect", path).out


# --- The command ---


def test_json_has_these_keys(wrinkle: Wrinkle, tmp_path: Path) -> None:
    limb(tmp_path / "limb.glb", morphs=1)
    write_tools(tmp_path / "tools.yaml")
    assert wrinkle("bake", "limb.glb", "tools.yaml", "-o", "out.glb", "-q").code == 0
    ran = wrinkle("inspect", "out.glb", "--json")
    assert (ran.code, ran.lines) == (0, [])
    data = json.loads(ran.out)
    assert list(data) == [
        "inspect",
        "asset",
        "version",
        "generator",
        "extensions_used",
        "extensions_required",
        "meshes",
        "bounds",
        "nodes",
        "deforming",
        "skins",
        "clips",
        "unplayed",
        "wrinkles",
        "replaceable",
        "files",
        "bytes",
    ]
    assert data["inspect"] == 1
    assert list(data["meshes"][0]) == ["name", "vertices", "triangles", "morph_targets", "primitives"]
    assert list(data["meshes"][0]["primitives"][0]) == [
        "mode",
        "vertices",
        "triangles",
        "attributes",
        "morph_targets",
        "material",
        "compression",
    ]
    assert list(data["deforming"][0]) == ["node", "mesh", "skin", "morph_targets"]
    assert list(data["skins"][0]) == ["name", "joints", "rest", "parents"]
    assert list(data["clips"][0]) == ["name", "start", "end", "keys", "nodes", "channels"]
    assert list(data["wrinkles"][0]) == ["node", "method", "draft", "tools", "undriven"]
    assert list(data["wrinkles"][0]["tools"][0]) == ["name", "origin_joints", "target_joints", "rest_length", "targets"]
    assert list(data["files"][0]) == ["name", "bytes"]


def test_the_tree_names_everything(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("inspect", sample("head"))
    assert (ran.code, ran.lines) == (0, [])
    lines = ran.out.splitlines()
    headings = [line for line in lines if not line.startswith(" ")]
    assert headings[1:] == ["bounds", "meshes", "deform", "skins", "clips", "bytes"]
    for word in ("head: 1 primitive", "browsUp, browsDown", "raise_brows: 2 s", "think: 3 s", "geometry"):
        assert word in ran.out
    assert "\x1b" not in ran.out
    assert files(tmp_path) == {}


def test_names_cannot_command_a_terminal(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb_asset(morphs=1)
    evil = "\x1b]0;x\x07\n"
    for kind in ("nodes", "meshes", "skins", "animations"):
        for item in asset.gltf[kind]:
            item["name"] = evil
    asset.gltf["meshes"][0]["extras"]["targetNames"] = [evil]
    asset.gltf["asset"]["generator"] = evil
    asset.gltf["extensionsUsed"] = [evil]
    ran = wrinkle("inspect", asset.write(tmp_path / "limb.glb"))
    assert ran.code == 0
    assert not {c for c in ran.out if not c.isprintable()} - {"\n"}


def test_compressed_geometry_is_named(tmp_path: Path) -> None:
    asset = limb_asset()
    name = "EXT_meshopt_compression"
    count = len(asset.gltf["bufferViews"])
    for view in asset.gltf["bufferViews"]:
        view["extensions"] = {
            name: {"buffer": 0, "byteOffset": 0, "byteLength": 10, "byteStride": 4, "count": 1, "mode": "ATTRIBUTES"}
        }
    asset.gltf["extensionsUsed"] = asset.gltf["extensionsRequired"] = [name]
    found = inspect(asset.write(tmp_path / "limb.glb"))
    assert found["meshes"][0]["primitives"][0]["compression"] == name
    assert sum(found["bytes"][kind] for kind in KINDS[:-1]) == 10 * count


def test_a_missing_file_is_one_line(wrinkle: Wrinkle) -> None:
    ran = wrinkle("inspect", "absent.glb")
    assert (ran.code, ran.out) == (1, "")
    assert ran.lines == ["absent.glb: cannot be read: No such file or directory"]


def test_a_touch_is_carried_by_the_joints_of_its_middle() -> None:
    drive = {
        "name": "tap",
        "anchors": [{"joints": ["hand", "thumb"]}, {"joints": ["finger"]}],
        "pad": 0.1,
        "grip": 0.06,
        "windows": [0, 1, 2],
        "targets": ["a"],
    }
    said = {"name": "tap", "joints": ["hand", "thumb"], "pad": 0.1, "grip": 0.06, "directions": 3, "targets": ["a"]}
    assert _described("touches", drive) == said
