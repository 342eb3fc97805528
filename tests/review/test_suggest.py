"""Suggested tools: the meshes that are looked at, the file, the command, limits and damaged assets."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.asset import Asset, stored
from kit.limb import limb, limb_asset
from kit.samples import edited, shared_mesh
from kit.suggested import each_once, ends, middle, run, suggest_once
from wrinklecli import bake
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.character.clip import Clip
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.review.suggest.measure import _finer
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.tools.read import load_tools, parse_tools

Json = dict[str, Any]
Floats = NDArray[np.float64]


KEYS = [
    "name",
    "node",
    "origin",
    "between",
    "target",
    "mirror",
    "width",
    "material",
    "strategy",
    "bumps",
    "max_height",
    "compressible",
    "rest_length",
    "contact",
    "mesh",
    "place",
    "driver",
    "driver_kind",
    "clip",
    "time",
    "span",
    "shortest",
    "shortening",
    "clips",
    "score",
    "height",
    "gpu_bytes",
    "keep",
    "merits",
    "substance",
    "why",
    "confidence",
]


# Nothing to suggest


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"skinned": False, "clip": None}, "no mesh deforms"),
        ({"skinned": False, "clip": "grow"}, "no mesh deforms"),
        ({"clip": None, "joints": 1}, "no clip"),
        ({"clip": "grow"}, "compresses"),
        ({"angle": 2.0}, "compresses"),
    ],
)
def test_nothing_is_suggested_where_nothing_is_compressed(tmp_path: Path, options: Json, reason: str) -> None:
    path = limb(tmp_path / "limb.glb", **options)
    found = suggest(path)
    assert not found.tools
    assert not found.text
    assert reason in found.reason
    result = run(path, "-o", tmp_path / "tools.yaml")
    assert isinstance(result.exception, AssetError)
    assert reason in str(result.exception)
    assert not (tmp_path / "tools.yaml").exists()


@pytest.mark.slow
def test_an_asset_without_clips_is_looked_at_in_its_range_of_motion(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", clip=None, morphs=1)
    found = suggest(path, clips=["joint_1 about z, +90°"])
    assert any("has no clip; looked at in 7 motions of 1 joint and 1 morph target" in note for note in found.notes)
    (tool,) = {each.tool for each in found.tools[:1]}
    assert middle(tool)[1] > 0.2, "the limb folds towards +y"
    (tmp_path / "tools.yaml").write_text(found.text)
    bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb", max_levels=0)


@pytest.mark.slow
def test_of_the_range_of_motion_morph_targets_may_be_asked_for(tmp_path: Path) -> None:
    found = suggest(limb(tmp_path / "limb.glb", clip=None, morphs=1), clips=["morph_0"])
    assert {each.clip for each in found.tools} == {"morph_0"}


@pytest.mark.slow
def test_an_asset_with_clips_is_looked_at_in_its_range_of_motion_where_asked(tmp_path: Path) -> None:
    folded = limb(tmp_path / "limb.glb")
    assert not any("looked at" in note for note in suggest_once(folded).notes)
    result = run(folded, "--range-of-motion", "-o", tmp_path / "own.yaml")
    assert "1 joint" in result.stderr
    assert result.exit_code == 0


def test_a_clip_that_moves_another_node_is_not_looked_at(tmp_path: Path) -> None:
    asset = limb_asset(clip=None)
    aside = asset.append("nodes", {"name": "prop"})
    animation: Json = {"name": "spin"}
    asset.channel(animation, aside, "rotation", [0.0, 1.0], [[0, 0, 0, 1], [0, 0, 1, 0]])
    asset.append("animations", animation)
    assert "no clip moves" in suggest(asset.write(tmp_path / "limb.glb")).reason


def two_limbs() -> Asset:
    """A folding limb, and at a distance a twin with its own mesh and the same joints."""
    asset = limb_asset(rings=11, sides=8)
    asset.append("meshes", json.loads(json.dumps(asset.gltf["meshes"][0])))
    (skin,) = asset.gltf["skins"]
    inverse = stored(asset, skin["inverseBindMatrices"]).copy()
    inverse[:, 14] += 5.0
    asset.append("skins", {**skin, "inverseBindMatrices": asset.accessor(inverse)})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "twin", "mesh": 1, "skin": 1}))
    return asset


# Several meshes


@pytest.mark.slow
@pytest.mark.long
def test_tools_name_their_node_where_several_meshes_deform(tmp_path: Path) -> None:
    path = two_limbs().write(tmp_path / "limbs.glb")
    found = suggest(path, count=4, everything=True)
    assert {each.tool.node for each in found.tools} == {"limb", "twin"}
    (tmp_path / "tools.yaml").write_text(found.text)
    bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb", max_levels=0)
    alone = suggest(path, count=4, node="twin", everything=True)
    assert {each.tool.node for each in alone.tools} == {"twin"}


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("name", ['a"b', "a\\b: #", "new\nline\x07", "a\x7f\x85b", "日本 \u2028", "- [x", " "])
def test_a_node_of_any_name_can_be_named(tmp_path: Path, name: str) -> None:
    asset = two_limbs()
    asset.gltf["nodes"][-1]["name"] = name
    path = asset.write(tmp_path / "limbs.glb")
    found = suggest(path, count=1, node=name, everything=True)
    assert parse_tools(found.text).tools[0].node == name
    (tmp_path / "tools.yaml").write_text(found.text, encoding="utf-8")
    bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb", max_levels=0)
    assert run(path, "--node", name, "--count", 1, "--all").exit_code == 0


@pytest.mark.slow
def test_a_mesh_without_normals_keeps_its_flat_faces(tmp_path: Path) -> None:
    flat = suggest(limb(tmp_path / "flat.glb", normals=False), everything=True)
    assert parse_tools(flat.text).refinement.scheme == "midpoint"
    assert parse_tools(suggest_once(limb(tmp_path / "limb.glb")).text).refinement.scheme == "butterfly"


# The command


@pytest.mark.slow
@pytest.mark.long
def test_the_file_says_what_the_record_says(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", joints=3, angle=200.0)
    found = suggest_once(path)
    read = {tool.name: tool for tool in parse_tools(found.text).tools}
    for each in found.tools:
        tool = read[each.tool.name]
        assert (tool.origin, tool.target, tool.width, tool.bumps) == (
            each.tool.origin,
            each.tool.target,
            each.tool.width,
            each.tool.bumps,
        )
        assert all(len(f"{x:g}") <= 7 for end in ends(tool) for x in end)
    assert found.text.endswith("\n")
    assert max(map(len, found.text.splitlines())) <= 120


@pytest.mark.slow
def test_the_file_bakes_without_a_length_that_no_bump_takes(tmp_path: Path) -> None:
    """Bumps rise through the whole movement, as `compressible` is slightly more than the deepest fold needs."""
    path = limb(tmp_path / "limb.glb", angle=120.0)
    found = suggest(path)
    (tmp_path / "tools.yaml").write_text(found.text)
    assert all(0.1 < each.tool.compressible <= 0.95 for each in found.tools)
    report = bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb", max_levels=0)
    assert not [line for line in report.warnings if "not absorbed" in line]


@pytest.mark.slow
@each_once()
def test_command_writes_the_file_and_a_table(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb")
    result = run(path, "-o", tmp_path / "tools.yaml", "--count", 1)
    assert result.exit_code == 0
    assert result.stdout == ""
    assert (tmp_path / "tools.yaml").read_text() == suggest_once(path, count=1).text
    note, head, row = result.stderr.splitlines()
    assert note == "note: 'limb': skin, as nothing says what it is made of (a guess)"
    assert head.split() == ["tool", "place", "of", "clip", "at", "keep", "shortens", "height", "on", "a", "GPU"]
    assert row.split()[:6] == ["joint_1", "joint", "joint_1", "skin", "fold", "0.93"]
    for arguments in ([path, "--count", 1], [path, "--count", 1, "-o", "-"]):
        result = run(*arguments)
        assert result.stdout == (tmp_path / "tools.yaml").read_text()
    result = run(path, "--count", 1, "-q")
    assert result.stderr == ""
    assert result.stdout


@pytest.mark.slow
def test_progress_goes_on_while_tools_are_looked_at(tmp_path: Path) -> None:
    lines = run(limb(tmp_path / "limb.glb"), "--count", 1, "--progress").stderr.splitlines()
    assert {"progress: posing 100%", "progress: looking 100%"} <= set(lines)


@pytest.mark.slow
@each_once()
def test_a_budget_keeps_what_fits(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb")
    (tool,) = suggest_once(path, count=1).tools
    assert 0 < tool.gpu_bytes < 8e6
    # A merit that is unknown is NaN, which equals nothing.
    assert repr(suggest_once(path, count=1, budget=tool.gpu_bytes).tools) == repr((tool,))
    poor = suggest(path, count=1, budget=1)
    assert (poor.tools, poor.reason) == (
        (),
        "nothing is worth it, as the notes say; `wrinkle edit` draws tools by hand",
    )
    assert poor.dropped[0].line.endswith(" on a GPU, more than --budget leaves")


@pytest.mark.slow
@each_once()
def test_json_has_these_keys(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb")
    result = run(path, "--json", "-q")
    assert result.exit_code == 0
    data = json.loads(result.stdout)
    assert list(data) == ["suggest", "asset", "reason", "notes", "dropped", "tools", "fields"]
    assert data["suggest"] == 1
    assert data["reason"] is None
    assert all(list(tool) == KEYS for tool in data["tools"])
    best = data["tools"][0]
    assert best["clips"] == {"fold": best["shortest"]}
    assert best["shortening"] == pytest.approx(1.0 - best["shortest"] / best["span"])
    result = run(path, "--json", "-o", tmp_path / "tools.yaml")
    assert json.loads(result.stdout) == data
    assert load_tools(tmp_path / "tools.yaml").tools
    rigid = limb(tmp_path / "rigid.glb", skinned=False, clip=None)
    result = run(rigid, "--json")
    assert isinstance(result.exception, AssetError)
    assert json.loads(result.stdout)["tools"] == []
    assert "no mesh deforms" in json.loads(result.stdout)["reason"]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (["--clip", "flod"], AssetError, "did you mean 'fold'"),
        (["--node", "limp"], AssetError, "did you mean 'limb'"),
        (["-o", "limb.glb"], BakeError, "is an input"),
        (["-o", "missing/tools.yaml"], WrinkleError, "missing"),
    ],
)
def test_faults_are_said_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], error: type[WrinkleError], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    limb(Path("limb.glb"))
    before = Path("limb.glb").read_bytes()
    result = run("limb.glb", *arguments)
    assert isinstance(result.exception, error)
    assert message in str(result.exception)
    assert os.listdir(".") == ["limb.glb"]
    assert Path("limb.glb").read_bytes() == before


@pytest.mark.parametrize("arguments", [["--count", "0"], ["--fps", "nan"], ["--json", "-o", "-"], []])
def test_wrong_usage_is_code_2(arguments: list[str]) -> None:
    assert run(*(["limb.glb", *arguments] if arguments else [])).exit_code == 2


@pytest.mark.slow
@pytest.mark.long
def test_same_bytes_in_another_folder_and_process(tmp_path: Path) -> None:
    for folder, seed in (("a", "1"), ("b", "2")):
        (tmp_path / folder).mkdir()
        limb(tmp_path / folder / "limb.glb", joints=3, morphs=1, morph_clip="LINEAR")
        program = "import sys; from wrinklecli.cli import main; main()"
        arguments = ["suggest", "limb.glb", "-o", "tools.yaml"]
        subprocess.run(
            [sys.executable, "-c", program, *arguments],
            check=True,
            cwd=tmp_path / folder,
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
        )
    assert (tmp_path / "a/tools.yaml").read_bytes() == (tmp_path / "b/tools.yaml").read_bytes()


# Limits and damage


@pytest.mark.slow
def test_long_clips_are_sampled_sparsely(tmp_path: Path) -> None:
    asset = limb_asset()
    animation: Json = {"name": "long"}
    turns: Floats = np.array([[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0, 0, 0, 1]])
    asset.channel(animation, 2, "rotation", [0.0, 40000.0, 80000.0], turns)
    asset.append("animations", animation)
    seen: list[int] = []
    found = suggest(
        asset.write(tmp_path / "limb.glb"),
        progress=lambda stage, _done, total: seen.append(total) if stage == "posing" else None,
    )
    assert max(seen) <= 2 * 200
    assert "long" in found.tools[0].clips


def test_too_much_work_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wrinklecli.review.suggest.measure._TOO_MUCH_WORK", 100)
    with pytest.raises(BakeError, match="use --clip or --node"):
        suggest(limb(tmp_path / "limb.glb"))


@pytest.mark.quick(1)
@pytest.mark.parametrize("scale", [1e15, 1e25, 1e200])
def test_lengths_beyond_what_a_tools_file_takes_are_said(tmp_path: Path, scale: float) -> None:
    with pytest.raises(AssetError):
        suggest(limb(tmp_path / "limb.glb", root={"scale": [scale] * 3}))


@pytest.mark.quick(1)
@pytest.mark.parametrize("scale", [1e-12, 1e-30])
def test_where_no_tool_attaches_none_is_suggested(tmp_path: Path, scale: float) -> None:
    assert not suggest(limb(tmp_path / "limb.glb", root={"scale": [scale] * 3})).tools


def flat_mesh() -> Asset:
    asset = limb_asset()
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["mode"] = 1
    return asset


def hidden() -> Asset:
    asset = limb_asset(root={})
    animation: Json = {"name": "vanish"}
    asset.channel(animation, 3, "scale", [0.0, 1.0], [[1.0] * 3, [0.0] * 3])
    asset.append("animations", animation)
    return asset


def test_meshes_that_the_scene_does_not_draw_are_said(tmp_path: Path) -> None:
    asset = limb_asset(rings=9, sides=8)
    asset.gltf["scenes"] = [{"nodes": [1]}, {"nodes": [0, 1]}]
    found = suggest(asset.write(tmp_path / "limb.glb"))
    assert found.reason == "no mesh deforms: those that do are not drawn"
    assert found.notes[0].startswith("'limb': left out, as the scene does not draw it: it is in another scene")


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", [None, "", "body", "\ud800"])
def test_a_mesh_whose_name_tells_nothing_gets_one_that_works(name: str | None, tmp_path: Path) -> None:
    """On nodes without a name, of one name, and of one that no file can hold."""
    asset = limb_asset(rings=15, sides=10)
    nodes = asset.gltf["nodes"]
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"mesh": 0, "skin": 0}))
    for node in (nodes[0], nodes[-1]):
        node["name"] = name
        if name is None:
            del node["name"]
    path = asset.write(tmp_path / "limb.glb")
    found = suggest(path, node="node_0", count=1, everything=True)
    (tmp_path / "tools.yaml").write_text(found.text, encoding="utf-8")
    assert found.tools[0].tool.node == "node_0"
    assert [*read_job(path, tmp_path / "tools.yaml", BakeOptions()).by_node] == [0]


@pytest.mark.parametrize(("make", "message"), [(flat_mesh, "no triangles")])
def test_malformed_assets_are_a_line(tmp_path: Path, make: Callable[[], Asset], message: str) -> None:
    with pytest.raises(AssetError, match=message):
        suggest(make().write(tmp_path / "limb.glb"))


def test_a_character_scaled_to_nothing_is_not_compressed(tmp_path: Path) -> None:
    found = suggest(hidden().write(tmp_path / "limb.glb"), clips=["vanish"])
    assert "compresses" in found.reason


@pytest.mark.slow
def test_clips_that_hide_the_character_are_null_in_json(tmp_path: Path) -> None:
    asset = limb_asset()
    animation: Json = {"name": "hidden"}
    asset.channel(animation, 1, "scale", [0.0, 1.0], [[0.0] * 3, [0.0] * 3])
    asset.append("animations", animation)
    result = run(asset.write(tmp_path / "limb.glb"), "--json", "-q")
    assert result.exit_code == 0
    clips = json.loads(result.stdout)["tools"][0]["clips"]
    assert clips["hidden"] is None
    assert clips["fold"] > 0


@pytest.mark.slow
@pytest.mark.long
def test_shared_meshes_are_looked_at_for_each_node() -> None:
    found = suggest(edited("wrist", shared_mesh), count=4)
    assert {each.mesh for each in found.tools} == {"wrist", "twin"}


@pytest.mark.parametrize("poses", [1, 2, 3, 9, 25, 40])
@pytest.mark.parametrize("frames", [2, 10, 200])
def test_tools_are_measured_at_the_poses_of_a_clip_and_at_more_between_few_of_them(poses: int, frames: int) -> None:
    clip = Clip(0, "fold", (), 0.5, 0.5 + (frames - 1) / 32.0)
    times = np.linspace(clip.start, clip.end, poses)
    finer = _finer(clip, times, 32.0)
    assert set(times.round(9)) <= set(finer.round(9))
    parts = (len(finer) - 1) // max(poses - 1, 1)
    if poses > 1:
        wanted = min(25, frames)
        assert len(finer) >= wanted, "as many as show where a segment is shortest"
        assert parts == 1 or (parts - 1) * (poses - 1) + 1 < wanted, "no more than are needed"
