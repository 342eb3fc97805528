"""`wrinkle batch` in one process: the bytes of `bake`, only what changed, and faults that stay alone."""

import json
from pathlib import Path
from typing import Any

import pytest

from kit.command import Wrinkle, files
from kit.limb import limb_asset, tool, write_tools

PATTERN = ("batch", "chars/*.glb", "--tools", "tools.yaml", "--out", "out/{stem}.glb")


@pytest.fixture
def chars(wrinkle: Wrinkle, tmp_path: Path) -> Wrinkle:
    """The command, in a folder with three small assets and tools for them."""
    (tmp_path / "out").mkdir()
    for number in range(3):
        (tmp_path / "chars").mkdir(exist_ok=True)
        limb_asset(rings=7, sides=6, angle=60 + number).write(tmp_path / "chars" / f"c{number}.glb")
    write_tools(tmp_path / "tools.yaml", tool(bumps=2), refinement={"max_levels": 0}, sampling={"fps": 4})
    return wrinkle


def lines(path: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in Path(path).read_text().splitlines()]


def results(path: str = "r.jsonl") -> dict[str, str]:
    return {Path(each["out"]).name: f"{each['result']}: {each['reason']}" for each in lines(path)}


@pytest.mark.slow
def test_outputs_are_those_of_bake_and_only_what_changed_is_baked(chars: Wrinkle, tmp_path: Path) -> None:
    dry = chars(*PATTERN, "--dry-run")
    assert (dry.code, dry.out.splitlines()[0]) == (0, "out/c0.glb: would be built: new")
    assert not files(tmp_path / "out")
    assert not (tmp_path / ".wrinkle-cache").exists()

    assert chars(*PATTERN, "--report", "r.jsonl").code == 0
    first = files(tmp_path / "out")
    for name in ("c0", "c2"):
        assert chars("bake", f"chars/{name}.glb", "tools.yaml", "-o", f"{name}.glb").code == 0
        assert (tmp_path / f"{name}.glb").read_bytes() == first[f"{name}.glb"]
    told = lines("r.jsonl")[0]
    assert (told["result"], told["reason"], told["errors"]) == ("built", "new", [])
    assert told["seconds"] > 0
    assert 0 < told["residual"] < told["tallest_wrinkle"]
    assert len(told["warnings"]) == 2

    # Nothing to do; what is lost or damaged comes from the cache; what changed is baked. Times do not matter.
    (tmp_path / "tools.yaml").touch()
    (tmp_path / "out" / "c1.glb").unlink()
    (tmp_path / "out" / "c2.glb").write_bytes(b"damaged")
    ran = chars(*PATTERN, "--report", "r.jsonl")
    assert results() == {"c0.glb": "hit: in place", "c1.glb": "hit: from the cache", "c2.glb": "hit: from the cache"}
    assert files(tmp_path / "out") == first
    assert ran.lines[-1].startswith("3 jobs: 3 hit, in ")
    limb_asset(rings=7, sides=6, angle=70).write(tmp_path / "chars" / "c1.glb")
    dry = chars(*PATTERN, "--dry-run")
    assert dry.out.splitlines() == [
        "out/c0.glb: is in place",
        "out/c1.glb: would be built: the asset changed",
        "out/c2.glb: is in place",
    ]
    # A damaged cache is no cache.
    for path in (tmp_path / ".wrinkle-cache" / "files").rglob("*"):
        if path.is_file():
            path.write_bytes(b"damaged")
    (tmp_path / "out" / "c0.glb").unlink()
    assert chars(*PATTERN, "--report", "r.jsonl").code == 0
    assert results() == {
        "c0.glb": "built: the cache has lost it",
        "c1.glb": "built: the asset changed",
        "c2.glb": "hit: in place",
    }
    assert (tmp_path / "out" / "c0.glb").read_bytes() == first["c0.glb"]


@pytest.mark.slow
def test_a_texture_that_changed_is_new_in_its_place_and_limits_change_nothing(chars: Wrinkle, tmp_path: Path) -> None:
    asset = limb_asset(rings=7, sides=6)
    asset.gltf["images"] = [{"uri": "skin.png"}]
    asset.write(tmp_path / "chars" / "limb.gltf")
    skin, made = tmp_path / "chars" / "skin.png", tmp_path / "out" / "skin.png"

    def result(options: str = "") -> str:
        Path("m.yaml").write_text(
            "version: 1\ndefaults: {tools: tools.yaml, out: 'out/{stem}.gltf'}\n"
            f"jobs: [{{asset: chars/limb.gltf{options}}}]"
        )
        chars("batch", "m.yaml", "--report", "r.jsonl")
        return results()["limb.gltf"]

    skin.write_bytes(b"\x89PNG one")
    assert result() == "built: new"
    skin.write_bytes(b"\x89PNG two")
    assert result() == "built: the asset changed"
    assert made.read_bytes() == skin.read_bytes()
    assert result(", max_memory: 2GB, split: false") == "hit: in place"
    # Of others nothing is known: it stays.
    skin.write_bytes(b"\x89PNG three")
    made.write_bytes(b"\x89PNG of somebody else's")
    assert result() == "failed: "
    assert made.read_bytes() == b"\x89PNG of somebody else's"


def test_a_job_that_fails_does_so_alone_with_its_line(chars: Wrinkle, tmp_path: Path) -> None:
    (tmp_path / "chars" / "c1.glb").write_bytes(b"glTF, but not quite")
    text = "version: 1\ndefaults: {tools: tools.yaml, out: 'out/{stem}.glb'}\njobs:\n  - asset: chars/c[12].glb\n"
    Path("m.yaml").write_text(text + "  - {asset: chars/c0.glb, strict: true}\n  - asset: none.glb\n")
    ran = chars("batch", "m.yaml", "--report", "r.jsonl", "-q")
    assert ran.code == 1
    assert list(results().values()) == ["failed: ", "built: new", "refused: ", "failed: "]
    assert list(files(tmp_path / "out")) == ["c2.glb"]
    assert ran.lines[0].startswith("m.yaml:4: jobs[0]: chars/c1.glb: ")
    assert ran.lines[-1] == "m.yaml:6: jobs[2]: none.glb: cannot be read: No such file or directory"
    assert not any("Traceback" in line for line in ran.lines)
    stopped = chars("batch", "m.yaml", "--fail-fast")
    assert (stopped.code, stopped.lines[-1].rpartition(",")[0]) == (1, "4 jobs: 1 failed, 3 not begun")
    Path("n.yaml").write_text("version: 1\njobs: [{asset: chars/c0.glb, tools: tools.yaml, out: x.glb, strict: true}]")
    assert chars("batch", "n.yaml").code == 3


@pytest.mark.slow
def test_folders_of_outputs_are_made(chars: Wrinkle, tmp_path: Path) -> None:
    Path("m.yaml").write_text(
        "version: 1\ndefaults: {tools: tools.yaml, out: 'new/{folder}/{stem}.glb'}\n"
        "jobs: [{asset: chars/c0.glb, report: reports/all/c0.json, anims: chars/c2.glb, tracked: 'clips/{stem}'},\n"
        "  {asset: chars/c1.glb, out: tools.yaml/c1.glb}]"
    )
    ran = chars("batch", "m.yaml", "--dry-run")
    assert ran.code == 0
    assert not (tmp_path / "new").exists()
    ran = chars("batch", "m.yaml")
    assert ran.lines[0] == "m.yaml:4: jobs[1]: tools.yaml: cannot be written: File exists"
    made = {Path(each).name for folder in ("new/chars", "reports/all", "clips/c0") for each in files(tmp_path / folder)}
    assert made == {"c0.glb", "c0.json", "c2.glb"}


def test_folders_of_jobs_that_fail_do_not_stay(chars: Wrinkle, tmp_path: Path) -> None:
    """But those that were there, or in which another job has written."""
    (tmp_path / "bad.yaml").write_text("version: 1\ntools: []\n")
    (tmp_path / "empty").mkdir()
    jobs = [
        {"asset": "chars/c0.glb", "tools": "bad.yaml", "out": "new/a/out.glb", "report": "new/b/r.json"},
        {"asset": "chars/c0.glb", "tools": "bad.yaml", "out": "empty/c/out.glb"},
        {"asset": "chars/c0.glb", "tools": "bad.yaml", "out": "both/a/out.glb"},
        {"asset": "chars/c0.glb", "tools": "tools.yaml", "out": "both/b/out.glb"},
    ]
    (tmp_path / "m.jsonl").write_text("\n".join(map(json.dumps, jobs)))
    assert chars("batch", "m.jsonl", "--keep-going").code == 1
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_dir()}
    assert {name for name in found if not name.startswith(".wrinkle-cache")} == {
        *("chars", "out", "empty", "both", "both/b")
    }
    (tmp_path / "f.jsonl").write_text("\n".join(map(json.dumps, jobs[:3])))
    assert chars("batch", "f.jsonl", "--keep-going", "--cache", "new/cache").code == 1
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_urls_reports_tracks_and_merged_tools(chars: Wrinkle, tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    store = fsspec.filesystem("memory")
    for name in ("chars/c0.glb", "tools.yaml"):
        store.pipe_file(f"/b/{name}", (tmp_path / name).read_bytes())
    write_tools(tmp_path / "more.yaml", tool(name="back", bumps=1), refinement={"max_levels": 0})
    text = """version: 1
jobs:
  - asset: memory:///b/chars/*.glb
    tools: [memory:///b/tools.yaml, more.yaml]
    out: memory:///b/out/{stem}.gltf
    anims: chars/c2.glb
    tracked: memory:///b/clips
    report: memory:///b/out/r.json
"""
    Path("m.yaml").write_text(text)
    try:
        ran = chars("batch", "m.yaml", "--cache", "memory:///b/cache", "--report", "r.jsonl")
        assert ran.code == 0
        both = json.loads((tmp_path / "tools.yaml").read_text())
        both["tools"] += json.loads((tmp_path / "more.yaml").read_text())["tools"]
        (tmp_path / "both.yaml").write_text(json.dumps(both))
        assert chars("bake", "chars/c0.glb", "both.yaml", "-o", "x/c0.gltf").code == 1  # no folder x
        assert chars("bake", "chars/c0.glb", "both.yaml", "-o", "out/c0.gltf").code == 0
        assert chars("track", "out/c0.gltf", "chars/c2.glb", "-o", "clips").code == 0
        made = {path: store.cat_file(path) for folder in ("/b/out", "/b/clips") for path in store.find(folder)}
        report = json.loads(made.pop("/b/out/r.json"))
        assert report["asset"] == "memory:///b/chars/c0.glb"
        assert {Path(path).name: data for path, data in made.items()} == {
            **files(tmp_path / "out"),
            **files(tmp_path / "clips"),
        }
        store.rm_file("/b/out/c0.gltf")
        chars("batch", "m.yaml", "--cache", "memory:///b/cache", "--report", "r.jsonl")
        assert results() == {"c0.gltf": "hit: from the cache"}
        assert store.cat_file("/b/out/c0.gltf") == made["/b/out/c0.gltf"]
        store.rm_file("/b/tools.yaml")
        assert (
            chars("batch", "m.yaml", "--cache", "memory:///b/cache")
            .lines[0]
            .startswith("m.yaml:3: jobs[0]: memory:///b/tools.yaml: cannot be read")
        )
    finally:
        store.rm("/b", recursive=True)


def test_tools_files_that_are_merged_must_agree(chars: Wrinkle) -> None:
    write_tools(Path("more.yaml"), tool(bumps=1), refinement={"max_levels": 1})
    Path("m.csv").write_text("asset,tools,out\nchars/c0.glb,tools.yaml;more.yaml,out/a.glb\n")
    ran = chars("batch", "m.csv")
    assert ran.code == 1
    assert [line.removeprefix("m.csv:2: jobs[0]: ") for line in ran.lines[:2]] == [
        "more.yaml:1: refinement: differs from tools.yaml:1: refinement, with which it is merged: they must agree",
        "more.yaml:1: tools[0].name: found 'crease', but tools.yaml:1: tools[0] has that name: files that are merged"
        " need names apart",
    ]


@pytest.mark.slow
def test_a_report_is_a_new_one_in_a_new_folder_or_goes_to_a_device(chars: Wrinkle) -> None:
    arguments = (*PATTERN, "--fail-fast", "--report")
    for _ in range(2):
        assert chars(*arguments, "reports/all/r.jsonl").code == 0
        assert len(lines("reports/all/r.jsonl")) == 3
    assert chars(*arguments, "/dev/null").code == 0
    assert chars(*arguments, "/dev/full").lines == ["/dev/full: cannot be written: No space left on device"]


@pytest.mark.usefixtures("chars")
def test_what_is_missing_or_misused_is_one_line(chars: Wrinkle, monkeypatch: pytest.MonkeyPatch) -> None:
    assert chars("batch", "chars/*.glb").code == 2
    assert chars("batch", "jobs.txt").code == 2
    assert chars(*PATTERN, "-j", "2", "--scheduler", "tcp://h:1").code == 2
    assert chars(*PATTERN, "--dashboard").code == 2
    assert chars("batch", "m.yaml").lines == ["m.yaml: cannot be read: No such file or directory"]
    Path("link.jsonl").symlink_to("chars/c0.glb")
    for report in ("chars/c0.glb", "link.jsonl"):
        ran = chars(*PATTERN, "--report", report)
        assert ran.lines == [f"{report}: is a file of the batch too and would be overwritten"]
    assert chars(*PATTERN, "--report", "tools.yaml/r.jsonl").lines == [
        "tools.yaml/r.jsonl: cannot be written: File exists"
    ]
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    Path("r.jsonl").write_text("of an earlier batch\n")
    assert chars(*PATTERN, "-j", "2", "--report", "r.jsonl").lines == [
        "more workers than one need dask.distributed: pip install 'wrinklecli[batch]'"
    ]
    assert Path("r.jsonl").read_text() == "of an earlier batch\n"
