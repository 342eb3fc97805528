"""Bakes of clips whose channels are JSON pointers (KHR_animation_pointer): they play as those of nodes and paths."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrinklecli
from kit.asset import Asset, Interpolation
from kit.bakes import bake_once, place
from kit.clients import assert_valid
from kit.limb import limb_asset, tool, write_tools
from kit.player import Gltf
from kit.pointers import EXTENSION, add_pointer, by_pointers, pointer
from wrinklecli.baking import parts, split
from wrinklecli.baking.original import original
from wrinklecli.baking.track import track
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.review.inspect import inspect

TIMES = np.linspace(0.0, 2.0, 37)


def small(**options: Any) -> Asset:
    return limb_asset(rings=12, sides=8, morphs=2, **options)


def clips_of(file: Gltf) -> tuple[Clip, ...]:
    return read_clips(read_document(file.path))


def pointers_of(file: Gltf) -> list[str]:
    channels = (each for animation in file.json["animations"] for each in animation["channels"])
    extensions = [channel["target"].get("extensions", {}) for channel in channels]
    return [each[EXTENSION]["pointer"] for each in extensions if EXTENSION in each]


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("interpolation", "weights"), [("LINEAR", "nodes"), ("STEP", "meshes"), ("CUBICSPLINE", "nodes")]
)
def test_a_bake_plays_pointers_as_channels_of_nodes(interpolation: Interpolation, weights: str) -> None:
    asset = small(morph_clip=interpolation, interpolation=interpolation)
    plain = bake_once(place(asset), tool())
    pointed = bake_once(place(by_pointers(asset, weights=weights)), tool())
    for first, second in zip(clips_of(plain), clips_of(pointed), strict=True):
        assert first.moves_as(second)
    # The asset's own weights, which players without the extension show now, too, and nothing else.
    assert pointers_of(pointed) == ["/nodes/2/rotation"]
    assert (pointed.weights("limb", "fold", TIMES).max(axis=0) > 0.2).all()
    assert_valid(pointed.path)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("holder", "tracks"), [("nodes", "all"), ("meshes", "none")])
def test_single_weights_become_part_of_the_one_channel(holder: str, tracks: str) -> None:
    asset = small()
    add_pointer(asset, f"/{holder}/0/weights/0", [0.0, 1.0, 2.0], [0.0, 1.0, 0.25])
    add_pointer(asset, f"/{holder}/0/weights/1", [0.5, 1.5], [0.125, 0.5])
    baked = bake_once(place(asset), tool(), tracks=tracks)
    played = baked.weights("limb", "fold", TIMES)
    assert played[:, 0] == pytest.approx(np.interp(TIMES, [0.0, 1.0, 2.0], [0.0, 1.0, 0.25]), abs=1e-6)
    assert played[:, 1] == pytest.approx(np.interp(TIMES, [0.5, 1.5], [0.125, 0.5]), abs=1e-6)
    assert (played[:, 2:].max(axis=0) > 0.2).all() == (tracks == "all")
    assert pointers_of(baked) == []
    assert "extensionsUsed" not in baked.json
    (animation,) = baked.json["animations"]
    assert len(animation["samplers"]) == len(animation["channels"]) == 2
    assert_valid(baked.path)


def test_weights_of_a_mesh_stay_for_the_nodes_that_are_not_baked() -> None:
    asset = by_pointers(small(morph_clip="LINEAR", skinned=False, clip="grow"), weights="meshes")
    copy = asset.append("nodes", {"name": "copy", "mesh": 0, "translation": [0.0, 9.0, 0.0]})
    asset.gltf["scenes"][0]["nodes"].append(copy)
    before = read_clips(read_document(place(asset)))[0].channel(copy, "weights")
    baked = bake_once(place(asset), tool(node="limb"))
    (clip,) = clips_of(baked)
    own, other = clip.channel(0, "weights"), clip.channel(copy, "weights")
    assert before is not None
    assert other is not None
    assert own is not None
    assert np.array_equal(other.values, before.values)
    assert own.values.shape[-1] > other.values.shape[-1]
    assert "/meshes/0/weights" in pointers_of(baked)
    assert_valid(baked.path)


def test_weights_of_a_mesh_that_no_node_plays_keep_their_number() -> None:
    asset = small(weights_at="both")
    add_pointer(asset, "/meshes/0/weights", [0.0, 1.0], np.array([[0.5, 1.0], [1.0, 0.5]]))
    baked = bake_once(place(asset), tool())
    (animation,) = baked.json["animations"]
    idle = animation["channels"][1]
    assert idle["target"] == pointer("/meshes/0/weights")
    values = baked.array(animation["samplers"][idle["sampler"]]["output"]).reshape(2, -1)
    count = len(baked.mesh("limb")["primitives"][0]["targets"])
    assert np.array_equal(values, np.pad([[0.5, 1.0], [1.0, 0.5]], ((0, 0), (0, count - 2))))
    own = baked.json["nodes"][0]["weights"][:2]
    assert (baked.weights("limb", "fold", TIMES)[:, :2] == np.float32(own)).all()


def test_what_no_player_of_nodes_moves_is_kept_and_named(tmp_path: Path) -> None:
    asset = small()
    asset.append("materials", {"name": "skin"})
    for text in ("/materials/0/alphaCutoff", "/nodes/99/scale"):
        add_pointer(asset, text, [0.0, 1.0], [0.25, 0.75])
    asset.gltf["animations"].append({**asset.gltf["animations"][0], "name": "lone"})
    lone = asset.gltf["animations"][1]
    lone["channels"] = [{"sampler": 1, "target": pointer("/materials/0/alphaCutoff")}, {"sampler": 1, "target": {}}]
    source = Gltf(asset.write(tmp_path / "limb.glb"))
    data = inspect(source.path)
    assert [clip["name"] for clip in data["clips"]] == ["fold"]
    assert [(each["animation"], each["pointer"]) for each in data["unplayed"]] == [
        ("fold", "/materials/0/alphaCutoff"),
        ("fold", "/nodes/99/scale"),
        ("lone", "/materials/0/alphaCutoff"),
        ("lone", None),
    ]
    baked = bake_once(place(asset), tool())
    assert pointers_of(baked) == pointers_of(source)
    assert baked.json["extensionsUsed"] == [EXTENSION]
    for old, new in zip(source.json["animations"], baked.json["animations"], strict=True):
        for first, second in zip(old["channels"], new["channels"], strict=False):
            samplers = source, old["samplers"][first["sampler"]], baked, new["samplers"][second["sampler"]]
            assert np.array_equal(*(file.array(each["output"]) for file, each in (samplers[:2], samplers[2:])))


def test_the_original_comes_back(tmp_path: Path) -> None:
    asset = small()
    add_pointer(asset, "/meshes/0/weights/1", [0.0, 1.0], [0.5, 1.0])
    add_pointer(asset, "/meshes/0/weights/0", [0.0, 2.0], [0.5, 1.0])
    path = asset.write(tmp_path / "limb.glb")
    baked = bake_once(place(asset), tool())
    restored, source = original(read_document(baked.path)), read_document(path)
    assert restored.gltf == source.gltf
    assert [bytes(each) for each in restored.buffers] == [bytes(each) for each in source.buffers]


@pytest.mark.slow
def test_frames_have_no_weights_left() -> None:
    asset = by_pointers(small(morph_clip="LINEAR"))
    top = {"sampling": {"fps": 3}}
    both = small(morph_clip="LINEAR"), asset
    plain, pointed = (bake_once(place(each), tool(), mode="frames", top=top) for each in both)
    assert pointers_of(pointed) == ["/nodes/2/rotation"]
    for first, second in zip(clips_of(plain), clips_of(pointed), strict=True):
        assert first.moves_as(second)


@pytest.mark.slow
def test_parts_follow_pointers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "_WORTH", 200)
    monkeypatch.setattr(split, "_MATTERS", 0)

    def turned(*, as_pointers: bool) -> Asset:
        asset = small(skinned=False, morph_clip="LINEAR", clip="grow")
        animation = asset.gltf["animations"][0]
        asset.channel(animation, 0, "rotation", [0.0, 1.0], [[0, 0, 0, 1], [0, 0, 1, 0]])
        asset.channel(animation, 0, "scale", [0.0, 1.0], [[1, 1, 1], [2, 2, 2]])
        return by_pointers(asset, weights="meshes") if as_pointers else asset

    tools, made = write_tools(tmp_path / "tools.yaml", tool()), []
    for name in (False, True):
        asset = turned(as_pointers=name).write(tmp_path / f"{name}.glb")
        wrinklecli.bake(asset, tools, tmp_path / f"{name}.out.glb", split=True)
        made.append(clips_of(Gltf(tmp_path / f"{name}.out.glb")))
    nodes = {channel.node for channel in made[0][0].channels}
    assert len(nodes) >= 2
    for first, second in zip(*made, strict=True):
        assert first.moves_as(second)


def test_track_reads_pointers_of_clips(tmp_path: Path) -> None:
    body = bake_once(place(small()), tool(), tracks="none")
    made = []
    for number, pointed in enumerate((False, True)):
        asset = small(morph_clip="LINEAR")
        folder = tmp_path / str(number)
        clip = (by_pointers(asset, weights="meshes") if pointed else asset).write(tmp_path / f"{number}.glb")
        (tracked,) = track(body.path, [clip], folder)
        made.append(clips_of(Gltf(Path(tracked.path))))
    assert made[0]
    for first, second in zip(*made, strict=True):
        assert first.moves_as(second)


@pytest.mark.slow
def test_clips_of_other_files_are_read_by_pointers(tmp_path: Path) -> None:
    made = []
    for number, pointed in enumerate((False, True)):
        source = small(morph_clip="LINEAR")
        anim = (by_pointers(source, weights="meshes") if pointed else source).write(tmp_path / f"{number}.glb")
        body = small(clip=None).write(tmp_path / "body.glb")
        tools = write_tools(tmp_path / "tools.yaml", tool())
        wrinklecli.bake(body, tools, tmp_path / f"out{number}.glb", anims=[anim])
        made.append((tmp_path / f"out{number}.glb").read_bytes())
    assert made[0] == made[1]
