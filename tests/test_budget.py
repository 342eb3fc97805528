"""Engine budgets: nothing changes where they hold, little where they are made to, nothing is written else."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_encode import (
    BACK,
    BROW,
    PALM,
    Editor,
    Gltf,
    Json,
    anchor_distances,
    bake_once,
    edited,
    sample,
    wrinkle_columns,
    write_tools,
)

import wrinklecli
from wrinklecli.budget import BUDGETS
from wrinklecli.cli import main
from wrinklecli.errors import RefusedError

# Twelve targets, as many at a time.
ROUGH: Json = {**PALM, "profile": "polyline", "details": [0.2, 0.1], "strategy": "origin", "bumps": 3}
TIMES = np.linspace(0.0, 2.0, 97)


def active(file: Gltf, node: str) -> int:
    """Most targets of a weight other than 0 at and between keys, in any clip."""
    most = 0
    for clip in file.json["animations"]:
        _, values = file.keys(clip["name"], node)
        shown = values != 0
        most = max(most, int((shown[:-1] | shown[1:]).sum(axis=1).max()))
    return most


def report_of(tmp_path: Path, asset: Path, *tools: Json, **options: Any) -> Json:
    made = wrinklecli.bake(asset, write_tools(tmp_path / "tools.yaml", *tools), tmp_path / "out.glb", **options)
    return made.data


@pytest.mark.parametrize("engine", sorted(BUDGETS))
def test_what_is_within_a_budget_stays_as_it_is(engine: str) -> None:
    plain, held = bake_once("wrist", PALM, BACK), bake_once("wrist", PALM, BACK, engine=engine)
    assert plain.path.read_bytes() == held.path.read_bytes()


def test_spec8_reduces_to_eight_at_a_time(tmp_path: Path) -> None:
    plain, held = bake_once("wrist", ROUGH), bake_once("wrist", ROUGH, engine="spec8")
    assert active(plain, "wrist") > 8
    assert active(held, "wrist") <= 8
    tallest = report_of(tmp_path, sample("wrist"), ROUGH)["tallest_wrinkle"]
    for clip in ("flex", "extend"):
        apart = np.linalg.norm(plain.pose("wrist", clip, TIMES) - held.pose("wrist", clip, TIMES), axis=2)
        assert apart.max() < 0.01 * tallest
    assert np.abs(held.keys("flex", "wrist")[1]).max() <= 1 + 1e-6


def test_the_report_says_what_was_reduced(tmp_path: Path) -> None:
    data = report_of(tmp_path, sample("wrist"), ROUGH, engine="spec8")
    (mesh,) = data["engine"]["meshes"]
    (reduced,) = mesh["reduced"]
    out = Gltf(tmp_path / "out.glb")
    assert data["engine"]["name"] == "spec8"
    assert data["engine"]["limits"]["active"] == 8
    assert reduced["tool"] == "palm"
    assert reduced["from"] == len(bake_once("wrist", ROUGH).deltas("wrist"))
    assert reduced["to"] == mesh["targets"] == len(out.deltas("wrist")) == len(data["tools"][0]["targets"])
    assert 0 < reduced["error"] <= 0.25 * data["meshes"][0]["max_error"]
    assert mesh["active"] == active(out, "wrist")


def test_reduced_targets_do_not_depend_on_the_clips() -> None:
    """Whether a tool is reduced does: `extend` alone needs few at a time. How it is, does not."""
    both, one = bake_once("wrist", ROUGH, engine="spec8"), bake_once("wrist", ROUGH, engine="spec8", clips=["flex"])
    assert np.array_equal(both.deltas("wrist"), one.deltas("wrist"))
    assert both.json["nodes"][0]["extras"] == one.json["nodes"][0]["extras"]


def test_extras_play_reduced_targets() -> None:
    held = bake_once("wrist", ROUGH, engine="spec8")
    (tool,) = held.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    names = held.mesh("wrist")["extras"]["targetNames"]
    assert tool["targets"] == names
    times, values = held.keys("flex", "wrist")
    shortenings = 1 - anchor_distances(held, tool, "wrist", "flex", times) / tool["rest_length"]
    table = np.array(tool["weights"])
    for column in range(len(names)):
        replayed = np.interp(shortenings, tool["shortenings"], table[:, column])
        assert np.abs(values[:, column] - replayed).max() < 0.02


def test_what_cannot_be_held_is_refused_and_nothing_written(tmp_path: Path) -> None:
    """Five bumps a side, one after another, on three tools: heights that have nothing in common."""
    left = {**BROW, "strategy": "origin", "bumps": 5}
    right = {**left, "name": "other", "origin": [-0.028, 0.24, 0.0847], "target": [-0.028, 0.288, 0.0635]}
    with pytest.raises(RefusedError) as caught:
        report_of(tmp_path, sample("head"), left, right, engine="spec8")
    assert caught.value.exit_code == 3
    assert "head: needs " in str(caught.value)
    assert "raise_brows" in str(caught.value)
    assert "--engine spec8 allows 8" in str(caught.value)
    assert "strategy: everywhere" in str(caught.value)
    assert not (tmp_path / "out.glb").exists()


def test_more_targets_than_three_takes_are_refused(tmp_path: Path) -> None:
    def many_targets(editor: Editor) -> None:
        for primitive in editor.json["meshes"][0]["primitives"]:
            index = primitive["attributes"]["POSITION"]
            count = editor.json["accessors"][index]["count"]
            zeros = {"componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0]}
            editor.json["accessors"].append(zeros)
            primitive["targets"] = [{"POSITION": len(editor.json["accessors"]) - 1}] * 256

    with pytest.raises(RefusedError, match=r"has 257 morph targets, 256 of them the asset's own.*allows 256"):
        report_of(tmp_path, edited("wrist", many_targets), PALM, engine="three")


@pytest.mark.parametrize("strengths", [{"flex": -0.5}, {"flex": 2.0}, {"flex": -1.5, "extend": 0.5}])
@pytest.mark.parametrize("base", [PALM, ROUGH])
def test_unity_gets_weights_from_0_to_1_and_the_same_motion(base: Json, strengths: Json) -> None:
    tool = {**base, "clips": strengths}
    plain, held = bake_once("wrist", tool), bake_once("wrist", tool, engine="unity")
    columns = wrinkle_columns(held, "wrist")
    for clip in ("flex", "extend"):
        values = held.keys(clip, "wrist")[1][:, columns]
        assert values.min() >= 0
        assert values.max() <= 1
        apart = plain.pose("wrist", clip, TIMES) - held.pose("wrist", clip, TIMES)
        assert np.abs(apart).max() < 1e-7
        turned = np.sum(plain.normals("wrist", clip, TIMES[::8]) * held.normals("wrist", clip, TIMES[::8]), axis=2)
        assert turned.min() > 1 - 1e-6
    names = held.mesh("wrist")["extras"]["targetNames"]
    assert names == [f"wrinkle_palm_{number}" for number in range(1, len(names) + 1)]


def test_unity_splits_targets_of_posed_displacements() -> None:
    tool = {**PALM, "attachment": "patch"}
    plain, held = bake_once("wrist", tool), bake_once("wrist", tool, engine="unity")
    assert plain.keys("flex", "wrist")[1].min() < 0
    assert held.keys("flex", "wrist")[1].min() >= 0
    assert np.abs(plain.pose("wrist", "flex", TIMES) - held.pose("wrist", "flex", TIMES)).max() < 1e-6


def _second_joints(editor: Editor, share: float) -> None:
    """A share of each vertex's heaviest weight moves to JOINTS_1, on the first joint."""
    for primitive in editor.json["meshes"][0]["primitives"]:
        attributes = primitive["attributes"]
        accessor = editor.json["accessors"][attributes["WEIGHTS_0"]]
        count, view = accessor["count"], editor.json["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        weights = np.frombuffer(bytes(editor.data), "<f4", 4 * count, start).reshape(-1, 4).copy()
        second = np.zeros((count, 4), np.float32)
        second[:, 0] = share * weights[:, 0]
        weights[:, 0] -= second[:, 0]
        attributes["WEIGHTS_0"] = editor.accessor(weights)
        attributes["WEIGHTS_1"] = editor.accessor(second)
        attributes["JOINTS_1"] = editor.accessor(np.zeros((count, 4), np.uint8))


def empty_second_set(editor: Editor) -> None:
    _second_joints(editor, 0.0)


def full_second_set(editor: Editor) -> None:
    _second_joints(editor, 0.5)


def test_three_gets_four_joints_for_new_vertices() -> None:
    asset = edited("wrist", empty_second_set)
    held = bake_once(asset, PALM, engine="three")
    old = len(Gltf(asset).attribute("wrist", "POSITION"))
    new = held.attribute("wrist", "WEIGHTS_1")[old:]
    assert len(new)
    assert not new.any()
    assert held.attribute("wrist", "WEIGHTS_0")[old:].sum(axis=1) == pytest.approx(1, abs=1e-6)


def test_vertices_of_more_joints_than_three_reads_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="vertices of more than 4 joints, which --engine three would put off by"):
        report_of(tmp_path, edited("wrist", full_second_set), PALM, engine="three")
    assert not (tmp_path / "out.glb").exists()


def test_gpu_bytes_are_those_of_float_textures(tmp_path: Path) -> None:
    """targets x vertices x (POSITION, NORMAL) x 16 bytes, however sparse the file."""
    made = wrinklecli.bake(sample("head"), write_tools(tmp_path / "tools.yaml", BROW), tmp_path / "out.glb")
    out = Gltf(tmp_path / "out.glb")
    targets, vertices, _ = out.deltas("head").shape
    assert made.data["meshes"][0]["gpu_bytes"] == targets * vertices * 2 * 16
    assert f"{targets * vertices * 32 / 1e6:.1f} MB of targets on a GPU" in made.summary


def test_the_command_line_refuses_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tools = write_tools(tmp_path / "tools.yaml", {**BROW, "strategy": "origin", "bumps": 9})
    arguments = [
        "wrinkle",
        "bake",
        str(sample("head")),
        str(tools),
        "-o",
        str(tmp_path / "out.glb"),
        "--engine",
        "spec8",
    ]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 3
    assert "--engine spec8 allows 8" in capsys.readouterr().err
    assert not (tmp_path / "out.glb").exists()
