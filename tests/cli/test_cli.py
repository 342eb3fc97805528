"""`wrinkle bake` from a shell: exit codes, what is said where, and what is left behind."""

import json
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.bakes import bake_once
from kit.command import Ran, Wrinkle, files
from kit.limb import write_tools
from kit.places import ROOT
from kit.player import Gltf, Json, anchor_distances
from kit.samples import BACK, BROW, PALM, Editor, edited, sample
from kit.work import PATIENCE
from wrinklecli.baking import pipeline
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.errors import counted

WRIST = str(sample("wrist"))
# 38 % of the segment at a height of 15 %: nothing is left unabsorbed in flex, so nothing is warned of.
CALM: Json = {**PALM, "bumps": 2, "max_height": "none"}


# Done


def test_a_bake_says_what_it_made_on_stderr_alone(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", CALM)
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert (ran.code, ran.out) == (0, "")
    assert ran.lines[-1].startswith("out.glb: 1 tool, 1 morph target, ")
    assert not [line for line in ran.lines[:-1] if not line.startswith("warning: ")]
    assert (tmp_path / "out.glb").read_bytes() == bake_once("wrist", CALM).path.read_bytes()
    assert sorted(files(tmp_path)) == ["out.glb", "tools.yaml"]


@pytest.mark.slow
def test_quiet_says_nothing_and_verbose_a_line_for_each_tool(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM, BACK)
    plain = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "-q").lines == []
    verbose = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "-v")
    added = [line for line in verbose.lines if line not in plain.lines]
    assert [line.split()[0] for line in added] == ["palm", "back"]
    assert len(verbose.lines) == len(plain.lines) + 2
    failed = wrinkle("bake", "absent.glb", "tools.yaml", "-o", "out.glb", "-q")
    assert failed.code == 1
    assert len(failed.lines) == 1


def test_options_reach_the_bake(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM, BACK)
    options = ["--clip", "flex", "--tool", "palm", "--fps", "7", "--max-levels", "0", "--accessors", "dense"]
    options += ["--edges-per-interval", "1"]
    assert wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", *options).code == 0
    named = {"clips": ["flex"], "only": ["palm"], "fps": 7, "max_levels": 0, "accessors": "dense"}
    wanted = bake_once("wrist", PALM, BACK, edges_per_interval=1, **named)
    assert (tmp_path / "out.glb").read_bytes() == wanted.path.read_bytes()


def test_frames_from_the_command_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM)
    ran = wrinkle(
        "bake", WRIST, "tools.yaml", "--frames-dir", "f", "--frames-format", "ply", "--fps", 2, "--mode", "frames"
    )
    assert (ran.code, ran.out) == (0, "")
    assert len(list((tmp_path / "f").glob("*.ply"))) == 10
    assert ran.lines[-1].startswith("f: ")


def test_help_needs_no_numpy() -> None:
    code = (
        "import sys; sys.argv = ['wrinkle', 'bake', '--help']; from wrinklecli.cli import main\n"
        "try: main()\n"
        "finally: assert not {'numpy', 'scipy', 'trimesh', 'jsonschema_rs', 'pygltflib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "--max-error" in done.stdout
    assert done.stderr == ""


@pytest.mark.slow
def test_libraries_start_one_thread_whatever_the_cores() -> None:
    code = (
        "import sys; sys.argv = ['wrinkle', 'schema']; from wrinklecli.cli import main\n"
        "try: main()\n"
        "finally:\n"
        "    import numpy, scipy.special, threadpoolctl\n"
        "    print({pool['num_threads'] for pool in threadpoolctl.threadpool_info()}, file=sys.stderr)"
    )
    many = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=many, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "{1}"


@pytest.mark.slow
def test_a_small_bake_imports_no_more_than_it_uses(tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM)
    rarely_needed = {"scipy", "trimesh", "matplotlib", "PIL", "DracoPy", "numpy.ma", "wrinklecli.texture.maps"}
    code = (
        "import sys, numpy; before = set(sys.modules); from wrinklecli.cli import main\n"
        "try: main()\n"
        f"finally: print(*{rarely_needed} & (set(sys.modules) - before))"
    )
    command = [sys.executable, "-c", code, "bake", WRIST, tmp_path / "tools.yaml", "-o", tmp_path / "out.glb"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


# Wrong usage


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["bake"],
        ["bake", WRIST],
        ["bake", WRIST, "tools.yaml"],
        ["bake", WRIST, "tools.yaml", "-o", "out.obj"],
        ["bake", WRIST, "tools.yaml", "-o", "out"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--fps", "0"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--fps", "nan"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--max-error", "-1%"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--max-error", "0"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--max-error", "nan%"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--max-error", "tiny"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--max-levels", "9"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--mode", "video"],
        ["bake", WRIST, "tools.yaml", "-o", "out.glb", "--no-such-option"],
        ["bake", WRIST, "tools.yaml", "--frames-dir", "f", "--depfile", "out.d"],
        ["unbake"],
    ],
)
def test_wrong_usage(arguments: list[str], wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM)
    ran = wrinkle(*arguments)
    assert (ran.code, ran.out) == (2, "")
    assert any(line.startswith(("Error: ", "Usage: ")) for line in ran.lines)
    assert sorted(files(tmp_path)) == ["tools.yaml"]


# The input is at fault


def assert_at_fault(ran: Ran, tmp_path: Path, *words: str, count: int = 1) -> None:
    """Exit code 1, so many lines, all words in the first, an old OUT untouched and nothing new."""
    assert (ran.code, ran.out) == (1, ""), ran
    assert len(ran.lines) == count, ran.lines
    assert all(word in ran.lines[0] for word in words), ran.lines[0]
    assert (tmp_path / "out.glb").read_bytes() == b"old"
    assert not [name for name in files(tmp_path) if name not in ("out.glb", "tools.yaml", "asset.glb")]


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A folder with a tools file and an OUT of an earlier bake."""
    (tmp_path / "out.glb").write_bytes(b"old")
    return write_tools(tmp_path / "tools.yaml", PALM)


@pytest.mark.usefixtures("old")
def test_an_asset_that_is_not_there(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("bake", "absent.glb", "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "absent.glb: ", "No such file")


@pytest.mark.usefixtures("old")
def test_tools_that_are_not_there(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("bake", WRIST, "absent.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "absent.yaml: ", "No such file")


@pytest.mark.usefixtures("old")
def test_an_asset_that_is_a_folder_or_cut_off(wrinkle: Wrinkle, tmp_path: Path) -> None:
    assert_at_fault(wrinkle("bake", ".", "tools.yaml", "-o", "out.glb"), tmp_path, ".: cannot be read")
    for size in (0, 3, 100, 50_000):
        (tmp_path / "asset.glb").write_bytes(Path(WRIST).read_bytes()[:size])
        assert_at_fault(wrinkle("bake", "asset.glb", "tools.yaml", "-o", "out.glb"), tmp_path, "asset.glb")


def test_every_problem_of_the_tools_file_has_its_line(wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    old.write_text(
        "version: 1\n"
        "tools:\n"
        "- name: a\n"
        "  origin: [0, 0]\n"
        "  target: [1, 0, 0]\n"
        "  widht: 2\n"
        "- {name: b, origin: [0, 0, 0], target: [1, 0, 0], width: 1, bumps: 2.5}\n"
    )
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "tools.yaml:", count=len(ran.lines))
    text = "\n".join(ran.lines)
    assert len(ran.lines) >= 3
    assert all(line.startswith("tools.yaml:") for line in ran.lines)
    assert "tools.yaml:6: tools[0].widht: unknown key, did you mean width?" in text
    assert "tools.yaml:7: tools[1].bumps: found 2.5" in text


@pytest.mark.parametrize("text", ["", "[", "version: 1\ntools: []\n", "a: &a [*a]\n", "\0", "version: 2\n", "- 1\n"])
def test_yaml_that_is_none(text: str, wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    old.write_text(text)
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "tools.yaml", count=len(ran.lines))


@pytest.mark.usefixtures("old")
@pytest.mark.parametrize(
    ("option", "name", "words"),
    [
        ("--clip", "flxe", ["no clip 'flxe'", "did you mean 'flex'?", "'flex', 'extend'"]),
        ("--clip", "", ["no clip ''"]),
        ("--tool", "plam", ["'plam'", "did you mean 'palm'?"]),
    ],
)
def test_unknown_names_have_a_hint(option: str, name: str, words: list[str], wrinkle: Wrinkle, tmp_path: Path) -> None:
    assert_at_fault(wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", option, name), tmp_path, *words)


def test_a_tool_that_hits_nothing(wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    write_tools(old, {**PALM, "origin": [5, 5, 5]})
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "tools.yaml:", "tools[0].origin", "from the mesh")


def test_a_file_of_clips_alone(wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    assert old

    def bare(editor: Editor) -> None:
        del editor.json["meshes"], editor.json["nodes"][0]["mesh"], editor.json["nodes"][0]["skin"]

    asset = edited("wrist", bare)
    drawn = ("preview", asset, "-o", "out.png")
    for command in (("bake", asset, "tools.yaml", "-o", "out.glb"), ("suggest", asset), drawn):
        assert_at_fault(wrinkle(*command), tmp_path, "it has no mesh: --anim takes its clips, beside a character")


def test_a_mesh_that_does_not_deform(wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    def rigid(editor: Editor) -> None:
        del editor.json["nodes"][0]["skin"]

    asset = edited("wrist", rigid)
    ran = wrinkle("bake", asset, "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "no mesh of the asset deforms")
    write_tools(old, {**PALM, "node": "wrist"})
    ran = wrinkle("bake", asset, "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "tools[0].node", "does not deform")


def hostile(editor: Editor) -> None:
    editor.json["animations"][0]["name"] = "a\nb\x1b[31m\u202e"
    editor.json["nodes"][0]["name"] = "mesh\r\x07\n"


def test_names_cannot_command_the_terminal(wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    asset = edited("wrist", hostile)
    ran = wrinkle("bake", asset, "tools.yaml", "-o", "out.glb", "--clip", "x")
    assert_at_fault(ran, tmp_path, "\\n", "\\x1b[31m", "\\u202e")
    write_tools(old, {**PALM, "node": "x"})
    ran = wrinkle("bake", asset, "tools.yaml", "-o", "out.glb")
    assert_at_fault(ran, tmp_path, "\\r\\x07\\n")
    write_tools(old, PALM)
    ran = wrinkle("bake", asset, "tools.yaml", "-o", "out.glb", "-v")
    assert ran.code == 0
    assert all(line.isprintable() for line in ran.lines)
    assert len([line for line in ran.lines if not line.startswith("warning: ")]) == 2


@pytest.mark.usefixtures("old")
def test_an_output_that_cannot_be_written(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "absent/out.glb")
    assert_at_fault(ran, tmp_path, "absent/out.glb: cannot be written")
    (tmp_path / "folder.glb").mkdir()
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "folder.glb")
    assert_at_fault(ran, tmp_path, "folder.glb: cannot be written")


@pytest.mark.usefixtures("old")
def test_a_refused_bake_leaves_no_cache(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("bake", "absent.glb", "tools.yaml", "-o", "out.glb", "--cache", "new/cache")
    assert_at_fault(ran, tmp_path, "absent.glb: ")
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "--cache", "tools.yaml")
    assert_at_fault(ran, tmp_path, "tools.yaml: cannot be written: File exists")
    assert not (tmp_path / "new").exists()


@pytest.mark.usefixtures("old")
def test_a_report_that_cannot_be_written_leaves_the_old_output(wrinkle: Wrinkle, tmp_path: Path) -> None:
    for option in ("--report", "--timings", "--depfile"):
        ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", option, "absent/file")
        assert_at_fault(ran, tmp_path, "absent/file: cannot be written")


def test_an_output_that_is_an_input(wrinkle: Wrinkle, tmp_path: Path) -> None:
    shutil.copy(WRIST, tmp_path / "asset.glb")
    write_tools(tmp_path / "tools.yaml", PALM)
    (tmp_path / "link.glb").symlink_to("asset.glb")
    (tmp_path / "sub").mkdir()
    (tmp_path / "here").symlink_to(".")
    (tmp_path / "tools.glb").symlink_to("tools.yaml")
    before = files(tmp_path)
    outputs = ["asset.glb", "./asset.glb", "sub/../asset.glb", "here/asset.glb", "link.glb", tmp_path / "asset.glb"]
    for out in [*outputs, "tools.glb"]:
        ran = wrinkle("bake", "asset.glb", "tools.yaml", "-o", out)
        assert (ran.code, ran.out, len(ran.lines)) == (1, "", 1), out
        assert "is an input too" in ran.lines[0]
    for option in ("--report", "--timings", "--depfile"):
        for name in ("tools.yaml", "link.glb"):
            ran = wrinkle("bake", "asset.glb", "tools.yaml", "-o", "out.glb", option, name)
            assert (ran.code, len(ran.lines)) == (1, 1), (option, name)
    assert wrinkle("bake", "asset.glb", "tools.yaml", "-o", "out.glb", "--report", "out.glb").code == 1
    assert files(tmp_path) == before


def test_outputs_that_are_hard_links_of_inputs(wrinkle: Wrinkle, tmp_path: Path) -> None:
    """Another name of the same file is replaced, the input's name keeps its content."""
    shutil.copy(WRIST, tmp_path / "asset.glb")
    write_tools(tmp_path / "tools.yaml", PALM)
    os.link(tmp_path / "asset.glb", tmp_path / "out.glb")
    wrinkle("bake", "asset.glb", "tools.yaml", "-o", "out.glb")
    assert (tmp_path / "asset.glb").read_bytes() == Path(WRIST).read_bytes()


def test_a_buffer_of_the_asset_is_an_input(wrinkle: Wrinkle, tmp_path: Path) -> None:
    source = Gltf(Path(WRIST))
    (tmp_path / "data.glb").write_bytes(source.buffers[0])
    source.json["buffers"][0]["uri"] = "data.glb"
    (tmp_path / "asset.gltf").write_text(json.dumps(source.json))
    write_tools(tmp_path / "tools.yaml", PALM)
    ran = wrinkle("bake", "asset.gltf", "tools.yaml", "-o", "data.glb")
    assert ran.code == 1
    assert (tmp_path / "data.glb").read_bytes() == source.buffers[0]


# Refused


@pytest.mark.slow
def test_strict_refuses_warnings(wrinkle: Wrinkle, tmp_path: Path, old: Path) -> None:
    write_tools(old, {**PALM, "max_height": "1%"})
    plain = wrinkle("bake", WRIST, "tools.yaml", "-o", "plain.glb")
    warnings = [line for line in plain.lines if line.startswith("warning: ")]
    assert plain.code == 0
    assert any("not absorbed" in line for line in warnings)
    (tmp_path / "plain.glb").unlink()
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "--strict", "--report", "r.json")
    why = f"{WRIST}: refused by --strict: {counted(len(warnings), 'warning')}"
    assert (ran.code, ran.out, ran.lines) == (3, "", [*warnings, why])
    assert files(tmp_path).keys() == {"out.glb", "tools.yaml"}
    assert (tmp_path / "out.glb").read_bytes() == b"old"
    write_tools(old, CALM)
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "--strict")
    assert ran.code == 0, ran.lines


@pytest.mark.slow
def test_max_error_refuses(wrinkle: Wrinkle, tmp_path: Path, old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_tools(old, BROW)
    monkeypatch.setattr("wrinklecli.drive.play.KEY_GAP", 1.0)
    ran = wrinkle("bake", sample("head"), "tools.yaml", "-o", "out.glb", "--max-error", "0.1%", "--report", "r.json")
    assert (ran.code, ran.out, len(ran.lines)) == (3, "", 1)
    assert "--max-error" in ran.lines[0]
    assert files(tmp_path).keys() == {"out.glb", "tools.yaml"}
    assert (tmp_path / "out.glb").read_bytes() == b"old"


# A bug of ours


@pytest.mark.usefixtures("old")
def test_a_bug_keeps_its_traceback(wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise KeyError("surprise")

    monkeypatch.setattr(pipeline, "sample_effects", broken)
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert (ran.code, ran.out) == (70, "")
    assert ran.lines[0] == "Traceback (most recent call last):"
    assert "KeyError: 'surprise'" in ran.lines
    assert "bug" in ran.lines[-1]
    assert files(tmp_path).keys() == {"out.glb", "tools.yaml"}
    assert (tmp_path / "out.glb").read_bytes() == b"old"


@pytest.mark.usefixtures("old")
def test_an_interrupt_is_no_bug(wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "sample_effects", interrupted)
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb")
    assert (ran.code, ran.out, [line for line in ran.lines if line]) == (130, "", ["wrinkle: interrupted"])
    assert (tmp_path / "out.glb").read_bytes() == b"old"


# The report


@pytest.mark.slow
def test_the_report_says_what_every_tool_did(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", {**PALM, "max_height": "8%", "variation": 0}, BACK)
    ran = wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "--report", "r.json")
    assert ran.code == 0
    report = json.loads((tmp_path / "r.json").read_text())
    file = Gltf(tmp_path / "out.glb")
    assert (report["asset"], report["tools_file"], report["mode"]) == (WRIST, "tools.yaml", "morph")
    assert [f"warning: {line}" for line in report["warnings"]] == ran.lines[:-1]
    (mesh,) = report["meshes"]
    assert mesh["vertices"] == len(file.attribute("wrist", "POSITION"))
    assert mesh["triangles"] == len(file.triangles("wrist"))
    assert mesh["coarse_triangles"] == len(Gltf(Path(WRIST)).triangles("wrist"))
    extras = {tool["name"]: tool for tool in file.json["nodes"][0]["extras"]["wrinkle"]["tools"]}
    names = file.mesh("wrist")["extras"]["targetNames"]
    assert [clip["name"] for clip in report["clips"]] == ["flex", "extend"]
    for clip in report["clips"]:
        times = np.array(clip["times"])
        assert (clip["start"], clip["end"]) == (times[0], times[-1]) == (0, 2)
        assert clip["residual"]["position"] <= mesh["max_error"]
        assert {"position", "time", "weights", "normal_degrees_99"} <= clip["residual"].keys()
        assert [tool["name"] for tool in clip["tools"]] == ["palm", "back"]
        for tool in clip["tools"]:
            columns = {key: np.array(tool[key]) for key in ("distance", "shortening", "unabsorbed", "rest_length")}
            assert {len(column) for column in columns.values()} == {len(times)}
            wanted = anchor_distances(file, extras[tool["name"]], "wrist", clip["name"], times)
            assert np.abs(columns["distance"] - wanted).max() < 1e-6 * wanted.max()
            taut = columns["rest_length"] * (1 - 1e-5)
            assert np.abs(columns["shortening"] - np.maximum(taut - wanted, 0)).max() < 2e-7
            assert (columns["unabsorbed"] >= 0).all()
            assert (columns["unabsorbed"] <= columns["shortening"]).all()
            heights = np.array(tool["heights"])
            assert heights.shape == (len(times), 4)
            own = [column for column, each in enumerate(names) if each.startswith(f"wrinkle_{tool['name']}_")]
            moves = np.tensordot(file.keys(clip["name"], "wrist")[1][:, own], file.deltas("wrist")[own], axes=1)
            tallest = np.linalg.norm(moves, axis=2).max()
            assert tool["tallest"] == pytest.approx(tallest, rel=1e-3)
            assert tallest <= heights.max()
            assert max(tool["curve_length_error"]) < 1e-8
            lines = tool["line_length_errors"]
            errors = np.array(lines["errors"])
            assert abs(errors[lines["v"].index(0)]) < 1e-3
            assert (
                lines["worst"]
                == np.abs(errors).max()
                >= lines["rms"]
                == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.01, abs=1e-4)
            )
            if tool["name"] == "palm" and clip["name"] == "flex":
                segment = extras["palm"]["rest_length"]
                assert heights.max() == pytest.approx(0.08 * segment, rel=1e-4)
                full = columns["unabsorbed"] > 0
                assert full.any()
                assert np.allclose(heights[full], heights.max(), rtol=1e-5)
                weights = file.weights("wrist", "flex", times)[:, names.index("wrinkle_palm_1")]
                error = np.abs(weights - heights[:, 0] / heights.max())
                keyed = np.isin(np.float32(times), np.float32(file.keys("flex", "wrist")[0]))
                assert clip["keys"] == keyed.sum() < len(times)
                assert error[keyed].max() < TABLE_ERROR
                # Between keys, tracks take a quarter of --max-error.
                assert error.max() < 0.0025 * mesh["tallest_wrinkle"] / heights.max() + TABLE_ERROR


@pytest.mark.slow
@pytest.mark.usefixtures("old")
def test_a_report_is_the_same_every_time(wrinkle: Wrinkle, tmp_path: Path) -> None:
    for name in ("a.json", "b.json"):
        assert wrinkle("bake", WRIST, "tools.yaml", "-o", "out.glb", "--report", name).code == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


# Dependencies


@pytest.mark.slow
@pytest.mark.long
def test_make_bakes_again_exactly_when_it_must(tmp_path: Path) -> None:
    make = shutil.which("make")
    if make is None:
        pytest.skip("make is not installed")
    folder = tmp_path / "my $HOME #1 assets"
    folder.mkdir()
    source = Gltf(Path(WRIST))
    (folder / "the wrist's data.bin").write_bytes(source.buffers[0])
    source.json["buffers"][0]["uri"] = "the%20wrist's%20data.bin"
    (folder / "wrist #2.gltf").write_text(json.dumps(source.json))
    write_tools(folder / "tools $x.yaml", PALM)
    script = tmp_path / "bake.sh"
    asset, tools, out = (f"{folder.name}/{name}" for name in ("wrist #2.gltf", "tools $x.yaml", "baked $ #.gltf"))
    program = "import sys; sys.argv[0] = 'wrinkle'; from wrinklecli.cli import main; main()"
    command = [sys.executable, "-c", program, "bake", asset, tools, "-o", out, "--depfile", "out.d", "-q"]
    script.write_text("echo baked >> log\n" + " ".join("'" + word.replace("'", "'\\''") + "'" for word in command))
    escaped = out.replace("$", "$$").replace("#", "\\#").replace(" ", "\\ ")
    (tmp_path / "Makefile").write_text(f"{escaped}:\n\tsh bake.sh\n-include out.d\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def bakes() -> int:
        done = subprocess.run(
            [make, out.replace("$", "$")], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return (tmp_path / "log").read_text().count("baked")

    assert bakes() == 1
    assert (tmp_path / out).exists()
    assert bakes() == 1
    later = time.time() + 10
    for count, name in enumerate(("wrist #2.gltf", "tools $x.yaml", "the wrist's data.bin"), start=2):
        os.utime(folder / name, (later, later))
        assert bakes() == count, name
        later += 10
        os.utime(tmp_path / out, (later, later))
        assert bakes() == count
        later += 10
    # An input that is renamed does not stop Make.
    (folder / "tools $x.yaml").rename(folder / "tools.yaml")
    script.write_text(script.read_text().replace("tools $x.yaml", "tools.yaml"))
    assert bakes() == 5


# Killed


@contextmanager
def started(*arguments: str, cwd: Path, before: str = "") -> Iterator[subprocess.Popen[bytes]]:
    """`wrinkle` in a process of its own, after some lines of Python; it is gone in the end.

    A shell's job in the background ignores interrupts, and so would its children: this one listens again.
    """
    listens = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{listens}; sys.argv = ['wrinkle', *sys.argv[1:]]\n{before}\nfrom wrinklecli.cli import main; main()"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program, *arguments]
    with subprocess.Popen(command, cwd=cwd, env=environment, stderr=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.quick(1)
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGKILL])
def test_killed_at_any_moment_the_output_is_whole(sign: signal.Signals, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM)
    new, rng = bake_once("wrist", PALM).path.read_bytes(), random.Random(4)
    for _ in range(3):
        (tmp_path / "out.glb").write_bytes(b"old")
        with started("bake", WRIST, "tools.yaml", "-o", "out.glb", cwd=tmp_path) as process:
            time.sleep(rng.uniform(0.1, 0.9))
            process.send_signal(sign)
            process.communicate(timeout=PATIENCE)
        assert (tmp_path / "out.glb").read_bytes() in (b"old", new)


# Stops where the temporary file is written, but not yet in place.
SLOW_DISK = "import os, time\nos.fsync = lambda _: (print('written', file=sys.stderr, flush=True), time.sleep(600))"


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_killed_while_writing_the_old_output_stays(sign: signal.Signals, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM)
    (tmp_path / "out.glb").write_bytes(b"old")
    with started("bake", WRIST, "tools.yaml", "-o", "out.glb", cwd=tmp_path, before=SLOW_DISK) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == b"written\n"
        assert len(files(tmp_path)) == 3
        process.send_signal(sign)
        _, said = process.communicate(timeout=PATIENCE)
    assert (tmp_path / "out.glb").read_bytes() == b"old"
    if sign != signal.SIGKILL:
        assert files(tmp_path).keys() == {"out.glb", "tools.yaml"}
        assert process.returncode == (143 if sign == signal.SIGTERM else 130)
        assert b"Traceback" not in said


def test_the_header_of_the_output_counts_its_bytes() -> None:
    content = bake_once("wrist", PALM).path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    assert len(content) % 4 == 0
