"""Clips of other files: joints and morph targets by their names, and what of them does not fit."""

import re
from pathlib import Path

import numpy as np
import pytest

from kit.asset import Asset, Interpolation, Json, bare_skeleton
from kit.limb import limb_asset
from kit.prepared import as_document
from wrinklecli.character.anims import read_anims
from wrinklecli.character.clip import read_clips
from wrinklecli.errors import AssetError


def skeleton(name: str = "fold", **options: object) -> Asset:
    """The limb's joints and clip."""
    asset = limb_asset(rings=3, sides=4, **options)  # type: ignore[arg-type]
    bare_skeleton(asset.gltf)
    asset.gltf["animations"][0]["name"] = name
    return asset


def body(**options: object) -> Asset:
    return limb_asset(rings=3, sides=4, clip=None, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_channels_move_the_nodes_of_their_names(interpolation: Interpolation, tmp_path: Path) -> None:
    path = skeleton(interpolation=interpolation).write(tmp_path / "walk.glb")
    found = read_anims(as_document(body()), [path])
    (clip,) = found.clips
    assert clip.moves_as(read_clips(as_document(limb_asset(rings=3, sides=4, interpolation=interpolation)))[0])
    assert clip.name == "fold"
    assert not found.notes
    assert found.read == (str(path),)


@pytest.mark.parametrize("interpolation", ["LINEAR", "CUBICSPLINE"])
def test_weights_are_those_of_the_same_names_and_others_stay(interpolation: Interpolation, tmp_path: Path) -> None:
    anim = limb_asset(rings=3, sides=4, morphs=3, morph_clip=interpolation)
    anim.gltf["meshes"][0]["extras"]["targetNames"] = ["a", "b", "c"]
    own = body(morphs=3, weights_at="node")
    own.gltf["meshes"][0]["extras"]["targetNames"] = ["c", "x", "b"]
    path, document = anim.write(tmp_path / "face.glb"), as_document(own)
    channel = read_anims(document, [path]).clips[0].channel(0, "weights")
    theirs = read_clips(as_document(anim))[0].channel(0, "weights")
    assert channel is not None
    assert theirs is not None
    assert np.array_equal(channel.values[..., [0, 2]], theirs.values[..., [2, 1]])
    points = channel.values[:, 1] if interpolation == "CUBICSPLINE" else channel.values
    assert set(points[:, 1]) == {document.gltf["nodes"][0]["weights"][1]}
    if interpolation == "CUBICSPLINE":
        assert not channel.values[:, [0, 2], 1].any()


def test_a_clip_whose_name_is_taken_is_named_for_its_file(tmp_path: Path) -> None:
    """Mixamo calls all of its clips `mixamo.com`."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    paths = [skeleton("mixamo.com").write(tmp_path / name / "walk.glb") for name in ("", "a", "b")]
    found = read_anims(as_document(body()), paths)
    assert [clip.name for clip in found.clips] == ["mixamo.com", "walk", "walk 2"]
    assert [re.sub(r".*glb: ", "", line) for line in found.notes] == [
        "its clip 'mixamo.com' is 'walk' here, as that name is taken",
        "its clip 'mixamo.com' is 'walk 2' here, as that name is taken",
    ]


def renamed(asset: Asset, names: dict[str, str]) -> Asset:
    for node in asset.gltf["nodes"]:
        node["name"] = names.get(node["name"], node["name"])
    return asset


def test_what_the_asset_has_not_is_said(tmp_path: Path) -> None:
    document = as_document(body())
    anim = skeleton(joints=3)
    path = anim.write(tmp_path / "walk.glb")
    found = read_anims(document, [path])
    assert found.notes == (
        f"{path}: 1 node of its clips cannot be moved in {document.path}: 'joint_2'; did you mean 'joint_1'?",
    )
    with pytest.raises(
        AssetError, match=r"walk\.glb: has no joints of .*limb\.glb: its clips move 'rig joint_1', .*'jo"
    ):
        read_anims(document, [renamed(skeleton(), {"joint_1": "rig joint_1"}).write(tmp_path / "walk.glb")])
    still: Json = {"asset": {"version": "2.0"}}
    path = Asset(still).write(tmp_path / "still.glb")
    assert read_anims(document, [path]).warnings == (f"{path}: has no clip",)


@pytest.mark.parametrize("theirs", ["mixamorig:", "mixamorig9:", "mixamorig_", "mixamorig", "", "a:b:"])
@pytest.mark.parametrize("ours", ["mixamorig:", "mixamorig12_", ""])
def test_prefixes_of_programs_do_not_count(theirs: str, ours: str, tmp_path: Path) -> None:
    anim, own = skeleton(), body()
    for asset, prefix in ((anim, theirs), (own, ours)):
        for node in asset.gltf["nodes"]:
            node["name"] = prefix + str(node.get("name", ""))
    found = read_anims(as_document(own), [anim.write(tmp_path / "walk.glb")])
    assert found.clips[0].nodes == read_clips(as_document(limb_asset(rings=3, sides=4)))[0].nodes
    said = f"'{theirs}joint_1' counts as '{ours}joint_1', as their names are the same without prefixes"
    assert [said in note for note in found.notes] == ([] if theirs == ours else [True])


def test_names_that_are_the_same_without_prefixes_must_be_alone(tmp_path: Path) -> None:
    """Two characters in one file, there or here: none is guessed. A name that is there as it is goes first."""
    path = skeleton().write(tmp_path / "walk.glb")
    own = body()
    own.gltf["nodes"][2]["name"] = "left:joint_1"
    twin = own.append("nodes", {"name": "right:joint_1"})
    with pytest.raises(AssetError, match="has no joints of"):
        read_anims(as_document(own), [path])
    own.gltf["nodes"][twin]["name"] = "joint_1"
    found = read_anims(as_document(own), [path])
    assert {*found.clips[0].nodes} == {twin}
    assert not found.notes
