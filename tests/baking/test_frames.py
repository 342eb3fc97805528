"""Geometry for each frame: a clip shows one frame after another, each as morph targets would show it."""

import os
from pathlib import Path

import numpy as np
import pytest

from kit.bakes import bake_config, bake_once, place
from kit.clients import assert_valid
from kit.limb import limb_asset, tool
from kit.player import Floats, Gltf, Json, wrinkle_columns
from kit.samples import (
    BACK,
    BROW,
    PALM,
    aside,
    edited,
    one_moves,
    sample,
    without_animations,
    without_normals,
)
from wrinklecli.errors import WrinkleError

SAMPLES = [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")]


def frame_nodes(file: Gltf, name: str) -> list[int]:
    """The nodes of a mesh's frames, clip after clip, in order."""
    (group,) = (node for node in file.json["nodes"] if node.get("name") == f"{name}_frames")
    return list(group["children"])


def shown(file: Gltf, nodes: list[int], clip: str | None, times: Floats) -> list[list[int]]:
    """For each time the frames (places in `nodes`) whose scale is not 0; a scale in between is a fault."""
    columns = []
    for node in nodes:
        played = file.played(clip, node, "scale", times)
        scale = np.tile(file.json["nodes"][node].get("scale", [1, 1, 1]), (len(times), 1)) if played is None else played
        assert np.isin(scale, (0, 1)).all()
        assert (scale == scale[:, :1]).all()
        columns.append(scale[:, 0] == 1)
    return [np.flatnonzero(row).tolist() for row in np.stack(columns, axis=1)]


def clip_times(file: Gltf, name: str, nodes: list[int]) -> dict[str, tuple[int, Floats]]:
    """For each clip the place of its first frame and its frames' times: each is shown from its own key."""
    starts = {}
    for animation in file.json["animations"]:
        clip = animation["name"]
        prefix = f"{name}_{clip}_"
        own = [k for k, node in enumerate(nodes) if file.json["nodes"][node]["name"].startswith(prefix)]
        if not own:
            continue
        begins = []
        for k in own:
            times, scales = file.keys(clip, nodes[k], "scale")
            (begin,) = times[scales[:, 0] == 1]
            begins.append(begin)
        assert own == list(range(own[0], own[0] + len(own)))
        starts[clip] = (own[0], np.array(begins))
    return starts


@pytest.mark.slow
@pytest.mark.parametrize(("asset", "config"), SAMPLES)
def test_each_frame_is_shown_exactly_during_its_interval(asset: str, config: str) -> None:
    file = bake_config(asset, config, mode="frames", fps=10)
    nodes = frame_nodes(file, asset)
    clips = clip_times(file, asset, nodes)
    assert list(clips) == [animation["name"] for animation in file.json["animations"]]
    assert sum(len(times) for _, times in clips.values()) == len(nodes)
    assert shown(file, nodes, None, np.zeros(1)) == [[0]]
    for clip, (first, begins) in clips.items():
        assert (np.diff(begins) > 0).all()
        assert np.diff(begins).max() < 0.1 + 1e-6
        middles = (begins[1:] + begins[:-1]) / 2
        for times in (begins, middles, np.array([begins[-1] + 1.0])):
            wanted = first + np.searchsorted(begins, times, side="right") - 1
            assert shown(file, nodes, clip, times) == [[k] for k in wanted]


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(("asset", "config"), SAMPLES)
def test_frames_are_what_morph_targets_show(asset: str, config: str) -> None:
    file, morphed = (bake_config(asset, config, mode=mode, fps=10) for mode in ("frames", "morph"))
    nodes = frame_nodes(file, asset)
    for clip, (first, times) in clip_times(file, asset, nodes).items():
        posed, normals = morphed.pose(asset, clip, times), morphed.normals(asset, clip, times)
        size = np.ptp(posed.reshape(-1, 3), axis=0).max()
        # Between their keys, tracks take a quarter of --max-error, 1 % of the tallest wrinkle.
        between = 0.005 * np.linalg.norm(morphed.deltas(asset)[wrinkle_columns(morphed, asset)], axis=2).max()
        keyed = np.isin(np.float32(times), np.float32(morphed.keys(clip, asset)[0]))
        assert keyed.sum() >= 4
        # A track that has weights of the asset's own has their keys, too, and ours between some of them.
        keyed &= len(wrinkle_columns(morphed, asset)) == len(morphed.deltas(asset))
        for k in range(len(times)):
            node = nodes[first + k]
            apart = np.abs(file.attribute(node, "POSITION") - posed[k]).max()
            assert apart < 1e-6 * size + (0.0 if keyed[k] else between)
            # Two unit vectors as float32; angles in radians.
            turned = np.abs(file.attribute(node, "NORMAL") - normals[k]).max()
            assert turned < 2e-4 + (0.0 if keyed[k] else 0.02)
            assert np.array_equal(file.triangles(node), morphed.triangles(asset))
    coordinates = file.attribute(nodes[0], "TEXCOORD_0")
    assert np.array_equal(coordinates, morphed.attribute(asset, "TEXCOORD_0"))


@pytest.mark.slow
def test_frames_of_patch_attachment_are_its_own_method() -> None:
    """Morph targets compress all frames together, to --max-error; frames take the same shapes."""
    tool = {**PALM, "attachment": "patch", "bumps": 2, "clips": {"extend": 0}}
    file, morphed = (bake_once("wrist", tool, mode=mode, fps=10) for mode in ("frames", "morph"))
    nodes = frame_nodes(file, "wrist")
    tallest = 0.0
    for clip, (first, times) in clip_times(file, "wrist", nodes).items():
        posed = morphed.pose("wrist", clip, times)
        flat = Gltf(morphed.path)
        for animation in flat.json["animations"]:
            animation["channels"] = [c for c in animation["channels"] if c["target"]["path"] != "weights"]
        tallest = max(tallest, np.linalg.norm(posed - flat.pose("wrist", clip, times), axis=2).max())
        for k in range(len(times)):
            gap = np.linalg.norm(file.attribute(nodes[first + k], "POSITION") - posed[k], axis=1).max()
            assert gap < 0.01 * 0.004
    assert tallest > 0.003


@pytest.mark.slow
def test_a_clip_that_was_not_baked_shows_one_frame_throughout() -> None:
    file = bake_config("wrist", "wrist", mode="frames", fps=5, clips=["extend"])
    nodes = frame_nodes(file, "wrist")
    assert list(clip_times(file, "wrist", nodes)) == ["extend"]
    assert shown(file, nodes, "flex", np.linspace(0, 2, 9)) == [[0]] * 9
    assert_valid(file.path)


@pytest.mark.slow
def test_the_skinned_mesh_is_gone_and_the_skeleton_stays() -> None:
    before, file = Gltf(sample("head")), bake_config("head", "head", mode="frames", fps=5)
    assert "mesh" not in file.json["nodes"][0]
    assert "skin" not in file.json["nodes"][0]
    assert "weights" not in file.json["nodes"][0]
    for node, old in zip(file.json["nodes"][1:], before.json["nodes"][1:], strict=False):
        assert node == old
    times = np.linspace(0, 3, 13)
    count = len(before.json["nodes"])
    for clip in ("raise_brows", "think"):
        moved, still = (each.matrices(clip, times)[:, 1:count] for each in (file, before))
        assert np.array_equal(moved, still)
        assert not [c for c in file.clip(clip)["channels"] if c["target"]["path"] == "weights"]
    assert_valid(file.path)


def test_frames_of_a_mesh_without_normals() -> None:
    asset = edited("wrist", without_normals)
    file, morphed = (bake_once(asset, PALM, mode=mode, fps=5) for mode in ("frames", "morph"))
    nodes = frame_nodes(file, "wrist")
    (first, times) = clip_times(file, "wrist", nodes)["flex"]
    assert "NORMAL" not in file.mesh(nodes[0])["primitives"][0]["attributes"]
    posed = morphed.pose("wrist", "flex", times)
    for k in range(len(times)):
        assert np.abs(file.attribute(nodes[first + k], "POSITION") - posed[k]).max() < 4e-7
    assert_valid(file.path)


def test_each_primitive_of_a_frame_has_its_own_vertices() -> None:
    asset = place(limb_asset(rings=7, sides=6, primitives=3))
    file, morphed = (bake_once(asset, tool(bumps=2), mode=mode, fps=4) for mode in ("frames", "morph"))
    nodes = frame_nodes(file, "limb")
    ((first, times),) = clip_times(file, "limb", nodes).values()
    wanted = morphed.pose("limb", 0, times)
    counts = [len(file.array(each["attributes"]["POSITION"])) for each in file.mesh(nodes[0])["primitives"]]
    assert counts == [len(morphed.array(each["attributes"]["POSITION"])) for each in morphed.mesh("limb")["primitives"]]
    for k, posed in enumerate(wanted):
        assert np.abs(file.attribute(nodes[first + k], "POSITION") - posed).max() < 1e-6


def test_frames_of_a_mesh_without_any_clip_are_refused() -> None:
    """With nothing to play the mesh would vanish."""
    with pytest.raises(WrinkleError, match="no clip"):
        bake_once(edited("wrist", without_animations), PALM, mode="frames")


@pytest.mark.slow
def test_two_meshes_of_which_a_clip_moves_one() -> None:
    """The still one is shown as it is stored."""
    asset, tools = edited("wrist", one_moves), ({**PALM, "node": "wrist"}, aside(BACK))
    file, morphed = (bake_once(asset, *tools, mode=mode, fps=10) for mode in ("frames", "morph"))
    assert_valid(file.path)
    times = np.linspace(0, 2, 21)
    for name in ("wrist", "twin"):
        nodes = frame_nodes(file, name)
        for clip in ("flex", "extend"):
            posed = morphed.pose(name, clip, times)
            visible = shown(file, nodes, clip, times + 1e-4)
            assert all(len(each) == 1 for each in visible)
            for (k,), wanted in zip(visible, posed, strict=True):
                assert np.abs(file.attribute(nodes[k], "POSITION") - wanted).max() < 1e-6


@pytest.mark.slow
def test_the_first_frame_of_a_morphing_head(tmp_path: Path) -> None:
    """Old morph targets are in the frames, too."""
    file, source = bake_once("head", BROW, mode="frames", fps=10), Gltf(sample("head"))
    nodes = frame_nodes(file, "head")
    first, times = clip_times(file, "head", nodes)["raise_brows"]
    flat = source.pose("head", "raise_brows", times)
    old = flat.shape[1]
    top = int(np.argmax(np.abs(flat - flat[0]).max(axis=(1, 2))))
    patch: Json = {"low": np.array(BROW["origin"]) - 0.05, "high": np.array(BROW["target"]) + 0.05}
    outside = ~((flat[0] > patch["low"]) & (flat[0] < patch["high"])).all(axis=1)
    moved = np.abs(flat[top] - flat[0]).max(axis=1) > 1e-3
    assert (outside & moved).sum() > 50
    found = file.attribute(nodes[first + top], "POSITION")[:old]
    assert np.abs(found - flat[top])[outside].max() < 1e-6
    assert os.listdir(tmp_path) == []
