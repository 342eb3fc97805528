"""Timings of a bake: their keys and sums, which appear in no other output."""

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import wrinklecli
from kit.limb import limb, limb_asset, tool, write_tools
from kit.places import ROOT
from wrinklecli.baking import timings
from wrinklecli.baking.report import Report
from wrinklecli.cli import cli

KEYS = [
    "timings",
    "seconds",
    "total_seconds",
    "clips",
    "frames",
    "frames_per_second",
    "members",
    "targets",
    "bytes_added",
    "peak_memory_bytes",
]
STAGES = ["read", "plan", "sample", "budget", "encode", "prove", "report", "export", "write"]


def bake(folder: Path, **options: Any) -> Report:
    asset, tools = limb(folder / "limb.glb"), write_tools(folder / "tools.yaml", sampling={"fps": 10})
    return wrinklecli.bake(asset, tools, folder / "out.glb", **options)


def test_a_clock_shares_out_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    moments = iter([10.0, 11.0, 11.0, 13.0, 13.0, 13.5])
    monkeypatch.setattr(time, "perf_counter", lambda: next(moments))
    clock = timings.StageClock()
    for stage in ("read", "sample", "read"):
        with clock.stage(stage):
            pass
    assert clock.seconds == dict.fromkeys(STAGES, 0.0) | {"read": 1.5, "sample": 2.0}


def test_keys_and_what_they_count(tmp_path: Path) -> None:
    report = bake(tmp_path)
    found = report.timings
    assert list(found) == KEYS
    assert found["timings"] == 1
    assert list(found["seconds"]) == STAGES
    assert found["total_seconds"] == pytest.approx(sum(found["seconds"].values()), abs=1e-6)
    # Two seconds with both ends.
    assert (found["clips"], found["frames"]) == (1, 21)
    assert found["frames_per_second"] == pytest.approx(21 / found["total_seconds"], rel=1e-3)
    (only,) = report.data["tools"]
    assert (found["members"], found["targets"]) == (only["moved_vertices"], len(only["targets"]))
    sizes = [(tmp_path / name).stat().st_size for name in ("limb.glb", "out.glb")]
    assert found["bytes_added"] == sizes[1] - sizes[0] > 0


@pytest.mark.slow
def test_vertices_of_two_tools_count_once(tmp_path: Path) -> None:
    same = {"seed": 1}
    alone = write_tools(tmp_path / "alone.yaml", tool(**same))
    tools = write_tools(tmp_path / "tools.yaml", tool(**same), tool(name="again", **same))
    found = wrinklecli.bake(limb(tmp_path / "limb.glb"), tools, tmp_path / "out.glb").timings
    assert found["members"] == wrinklecli.bake(tmp_path / "limb.glb", alone, tmp_path / "b.glb").timings["members"]
    assert found["targets"] == 2


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("options", "idle"),
    [
        ({}, ["budget", "export"]),
        ({"engine": "three"}, ["export"]),
        ({"tracks": "none"}, ["budget", "export", "prove"]),
        ({"mode": "frames"}, ["budget", "export", "prove"]),
        ({"frames_dir": "frames"}, ["budget"]),
    ],
    ids=str,
)
def test_stages_that_do_not_run_take_no_time(options: dict[str, Any], idle: list[str], tmp_path: Path) -> None:
    if "frames_dir" in options:
        options = {"frames_dir": tmp_path / options["frames_dir"]}
    seconds = bake(tmp_path, **options).timings["seconds"]
    assert {stage for stage, each in seconds.items() if not each} == set(idle)


@pytest.mark.slow
def test_bytes_added_are_those_of_buffers_too(tmp_path: Path) -> None:
    asset = limb_asset().write(tmp_path / "limb.gltf")
    (tmp_path / "out").mkdir()
    tools = write_tools(tmp_path / "tools.yaml")
    found = wrinklecli.bake(asset, tools, tmp_path / "out" / "out.gltf").timings
    written = sum(path.stat().st_size for path in (tmp_path / "out").iterdir())
    assert found["bytes_added"] == written - sum((tmp_path / f"limb.{end}").stat().st_size for end in ("gltf", "bin"))
    frames_only = wrinklecli.bake(asset, tools, frames_dir=tmp_path / "frames").timings
    assert frames_only["bytes_added"] is None


def test_an_asset_that_is_gone_meanwhile_fails_nothing(tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml")

    def remove(stage: str, _done: int, _total: int) -> None:
        if stage == "sampling":
            asset.unlink(missing_ok=True)

    found = wrinklecli.bake(asset, tools, tmp_path / "out.glb", progress=remove).timings
    assert found["bytes_added"] is None


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the system does not say")
def test_peak_memory_is_in_bytes() -> None:
    before = timings.peak_memory()
    held = np.ones(2**24)
    after = timings.peak_memory()
    assert before is not None
    assert after is not None
    assert before <= after
    assert held.nbytes < after < 2**40


def test_peak_memory_is_unknown_on_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    assert timings.peak_memory() is None


@pytest.mark.slow
def test_the_command_writes_them_and_they_change_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    limb(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml")
    made = []
    for more in ([], ["--timings", "timings.json"]):
        arguments = ["bake", "limb.glb", "tools.yaml", "-o", "out.glb", "--report", "report.json", *more]
        result = CliRunner().invoke(cli, arguments)
        assert result.exit_code == 0
        made.append([(tmp_path / name).read_bytes() for name in ("out.glb", "report.json")])
    assert made[0] == made[1]
    found = json.loads((tmp_path / "timings.json").read_text())
    assert list(found) == KEYS
    assert b"seconds" not in made[0][1]


def test_the_page_names_every_key_and_stage() -> None:
    text = (ROOT / "configs" / "json.md").read_text(encoding="utf-8")
    described = text[text.index("`--timings FILE` writes") : text.index("## batch")]
    for word in [*KEYS, *STAGES]:
        assert word in described
    assert list(timings.STAGES) == STAGES
