"""No output of a batch is a file that the batch reads, nor another output, by whatever name."""

import itertools
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kit.command import Wrinkle, files
from kit.limb import PNG, limb_asset, tool, write_parts, write_tools
from wrinklecli.batching.conflicts import BatchFiles
from wrinklecli.batching.jobs import BatchJob
from wrinklecli.batching.manifest import read_manifest, read_pattern
from wrinklecli.errors import ConfigError

MANIFEST = "jobs.jsonl"
# Every file that the batch of `batch` reads, and who reads it.
INPUTS = {
    MANIFEST: "the manifest",
    "t.yaml": "jobs[0]",
    "a/limb.gltf": "jobs[0]",
    "a/limb.bin": "jobs[0]",
    "a/skin.png": "jobs[0]",
    "a/walk.gltf": "jobs[0]",
    "a/walk.bin": "jobs[0]",
    "a/run.gltf": "jobs[0]",
    "a/run.bin": "jobs[0]",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A character and two files of clips, in several files each."""
    monkeypatch.chdir(tmp_path)
    return write_parts(tmp_path, "limb", "walk", "run", image="skin.png")


def job(**keys: Any) -> dict[str, Any]:
    return {"asset": "a/limb.gltf", "tools": "t.yaml", "out": "o/limb.glb", **keys}


def read(*jobs: dict[str, Any], **own: str) -> list[BatchJob]:
    Path(MANIFEST).write_text("".join(json.dumps(each) + "\n" for each in jobs))
    return read_manifest(MANIFEST, {}, BatchFiles(**own))  # type: ignore[arg-type]


def refused(*jobs: dict[str, Any], **own: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        read(*jobs, **own)
    return list(caught.value.lines)


READER = job(anim="a/walk.gltf", anims="a/run.gltf", tracked="tracked")


def by_link(path: str, name: str) -> str:
    Path(name).symlink_to(path)
    return name


def by_hard_link(path: str, name: str) -> str:
    os.link(path, name)
    return name


def by_link_to_its_folder(path: str, name: str) -> str:
    Path(name).symlink_to(os.path.dirname(path) or ".")
    return f"{name}/{os.path.basename(path)}"


def by_its_absolute_path(path: str, _name: str) -> str:
    return os.path.abspath(path)


def by_url(path: str, _name: str) -> str:
    return f"file://{os.path.abspath(path)}"


@pytest.mark.quick(11, 12)
@pytest.mark.parametrize(
    "renamed", [lambda path, _: path, by_link, by_hard_link, by_link_to_its_folder, by_its_absolute_path, by_url]
)
@pytest.mark.parametrize("path", INPUTS)
@pytest.mark.usefixtures("folder")
def test_no_output_is_an_input(path: str, renamed: Callable[[str, str], str]) -> None:
    Path(MANIFEST).touch()
    name = renamed(path, "link.gltf")
    shown = name.removeprefix("file://")
    cut = shown if len(shown) <= 40 else shown[:39] + "…"
    line = f"{MANIFEST}:2: jobs[1]: would write over {cut!r}, which"
    line += " is the manifest" if path == MANIFEST else f" {INPUTS[path]} reads"
    for key in ("report", "timings"):
        assert refused(READER, job(**{"out": "x.glb", key: name})) == [line]
    if name.endswith(".gltf"):
        assert refused(READER, job(out=name)) == [line]
    # The order of the jobs does not matter.
    assert refused(job(out="x.glb", report=name), READER)[0].startswith(f"{MANIFEST}:1: jobs[0]: would write over")
    line = f"{name}: is a file of the batch too and would be overwritten"
    assert refused(READER, report=name) == [line]
    assert refused(READER, report="r.jsonl", cache=name) == [line]
    # A file of clips keeps its name in the folder of tracked files.
    Path("tracked").mkdir()
    Path("tracked/run.gltf").symlink_to(os.path.abspath(path))
    assert len(refused(READER)) == 1


@pytest.mark.usefixtures("folder")
def test_no_output_is_another_one() -> None:
    os.mkdir("o")
    os.symlink("o", "l")
    os.symlink("new", "m")
    os.symlink("x.glb", "o/dangling.glb")
    Path("o/one.glb").touch()
    os.link("o/one.glb", "o/two.glb")
    pairs = [("o/x.glb", "l/x.glb"), ("o/x.glb", "o/dangling.glb"), ("o/one.glb", "l/two.glb")]
    pairs += [("new/sub/x.glb", "m/sub/x.glb"), ("memory:///b/x.glb", "memory://b/x.glb")]
    pairs += [("s3://b/x.glb", "s3a://b/x.glb"), ("file:///nowhere/x.glb", "/nowhere/./x.glb")]
    for first, second in pairs:
        for one, other in itertools.permutations((first, second)):
            shown = other.removeprefix("file://")
            ending = f"{shown!r} is an output of jobs[0] too: each needs a name of its own"
            assert refused(job(out=one), job(out=other)) == [f"{MANIFEST}:2: jobs[1]: {ending}"]
    frames = [job(frames_dir="f"), job(out="o/y.glb", frames_dir="./f/")]
    assert len(refused(*frames)) == 1
    line = f"{MANIFEST}:1: jobs[0]: 'l/limb.glb' is another output of this job too: each needs a name of its own"
    assert refused(job(frames_dir="l/limb.glb")) == [line]
    assert refused(job(report="l/limb.glb")) == [line]
    assert len(refused(job(report="o/r"), job(out="o/y.glb", timings="l/r"))) == 1
    assert refused(job(out="r.glb"), report="r.glb") == [
        f"{MANIFEST}:1: jobs[0]: 'r.glb' is an output of --report too: each needs a name of its own"
    ]
    assert refused(job(out="l/r.glb"), cache="o/r.glb")[0].endswith(
        "is an output of --cache too: each needs a name of its own"
    )
    nowhere = [job(timings="/dev/null"), job(out="o/y.glb", timings="/dev/null", report="/dev/null")]
    assert len(read(*nowhere, report="/dev/null")) == 2


@pytest.mark.usefixtures("folder")
def test_the_cache_has_files_of_its_own() -> None:
    os.mkdir("c")
    os.symlink("c", "l")
    for path in ("c/keys/x.glb", "l/files/ab/x.glb", "./c/outs/x.glb"):
        assert refused(job(out=path), cache="c") == [
            f"{MANIFEST}:1: jobs[0]: {path!r} is inside the cache, which has files of its own"
        ]
    assert refused(job(report="l/CACHEDIR.TAG"), cache="c") != []
    assert refused(job(), cache="c", report="c/outs/r.jsonl") == [
        "c/outs/r.jsonl: is inside the cache, which has files of its own"
    ]
    assert refused(job(asset="c/files/x.glb"), cache="./l")
    assert len(read(job(out="c/x.glb"), cache="c")) == 1
    assert len(read(job(out="keys/x.glb"), cache="memory:///c")) == 1
    assert refused(job(out="memory:///c/keys/x.glb"), cache="memory://c")


@pytest.mark.usefixtures("folder")
def test_an_archive_that_holds_an_asset_is_an_input() -> None:
    Path("o").mkdir()
    archive = os.path.abspath("o/a.zip")
    for name in (archive, f"file://{archive}", "memory:///b/a.zip"):
        asset = f"zip://limb.glb::{name}"
        found = refused(job(asset=asset), job(out="x.glb", report=name))
        assert len(found) == 1
        assert found[0].endswith("which jobs[0] reads")


def test_what_is_apart_is_left_alone(folder: Path) -> None:
    both = [READER, job(out="o/y.glb", anim=["a/run.gltf", "a/walk.gltf"], report="a/report.json")]
    assert [each.others for each in read(*both, report="a/r.jsonl", cache="cache")] == [(), ()]
    assert files(folder).keys() == {*INPUTS}
    # Files that cannot be read are for their jobs to complain about.
    Path("a/limb.gltf").write_bytes(b"{")
    os.mkfifo("a/pipe.gltf")
    assert len(read(job(report="a/x.bin"), job(asset="a/pipe.gltf", out="a/y.glb"))) == 2


def run(wrinkle: Wrinkle, *jobs: dict[str, Any]) -> tuple[int, list[str]]:
    """Bake jobs; the exit code and the lines of jobs that failed."""
    Path(MANIFEST).write_text("".join(json.dumps(each) + "\n" for each in jobs))
    ran = wrinkle("batch", MANIFEST)
    return ran.code, [line for line in ran.lines if line.startswith(MANIFEST)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "other", [{"asset": "o/fold_0001.glb", "out": "z.glb"}, {"asset": "a/run.gltf", "out": "o/fold_0001.glb"}]
)
@pytest.mark.usefixtures("folder")
def test_frames_keep_off_the_files_of_other_jobs(other: dict[str, str], wrinkle: Wrinkle) -> None:
    os.mkdir("o")
    limb_asset(rings=7, sides=6).write(Path("o/fold_0001.glb"))
    os.symlink("o", "l")
    before = Path("o/fold_0001.glb").read_bytes()
    frames = job(out="limb.glb", frames_dir="l", frames_format="glb")
    assert read(frames, job(**other))[0].others == ("o/fold_0001.glb",)
    code, lines = run(wrinkle, frames, job(**other))
    line = "l/fold_0001.glb: is a file of another job too and would be overwritten"
    assert (code, lines) == (1, [f"{MANIFEST}:1: jobs[0]: {line}"])
    assert Path(other["out"]).exists()
    assert (Path("o/fold_0001.glb").read_bytes() == before) == (other["out"] == "z.glb")
    assert not Path("o/fold_0000.glb").exists()


@pytest.mark.usefixtures("folder")
def test_frames_keep_off_clips_that_are_tracked_after_them(wrinkle: Wrinkle) -> None:
    os.mkdir("o")
    limb_asset(rings=7, sides=6).write(Path("o/fold_0001.glb"))
    before = Path("o/fold_0001.glb").read_bytes()
    both = job(frames_dir="o", frames_format="glb", anims="o/fold_0001.glb", tracked="tracked")
    line = "o/fold_0001.glb: is an input too and would be overwritten"
    assert run(wrinkle, both) == (1, [f"{MANIFEST}:1: jobs[0]: {line}"])
    assert Path("o/fold_0001.glb").read_bytes() == before
    assert not Path("o/limb.glb").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_an_old_buffer_stays_if_another_job_reads_it(wrinkle: Wrinkle) -> None:
    first = job(out="o/limb.gltf")
    assert run(wrinkle, first)[0] == 0
    before = set(Path("o").glob("limb-*.bin"))
    Path("o/copy.gltf").write_bytes(Path("o/limb.gltf").read_bytes())
    again = job(asset="o/copy.gltf", out="z.glb", replace=True)
    assert set(read(first, again)[0].others) == {*map(str, before), "o/skin.png"}
    write_tools(Path("t.yaml"), tool(bumps=2), refinement={"max_levels": 0}, sampling={"fps": 4})
    assert run(wrinkle, first, again) == (0, [])
    after = set(Path("o").glob("limb-*.bin"))
    assert after > before
    write_tools(Path("t.yaml"), tool(bumps=3), refinement={"max_levels": 0}, sampling={"fps": 4})
    assert run(wrinkle, first) == (0, [])
    assert len(set(Path("o").glob("limb-*.bin")) - after) == 1
    assert len(after - set(Path("o").glob("limb-*.bin"))) == 1, "nobody else reads the one of the run before"


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_an_image_of_an_earlier_bake_stays_if_another_job_uses_it(wrinkle: Wrinkle) -> None:
    first = job(out="o/limb.gltf")
    assert run(wrinkle, first)[0] == 0
    Path("a/skin.png").write_bytes(b"\x89PNG another")
    other = limb_asset(rings=7, sides=6)
    other.gltf["images"] = [{"uri": "skin.png"}]
    other.write(Path("o/other.gltf"))
    line = f"{MANIFEST}:1: jobs[0]: o/skin.png: is a file of another job too and would be overwritten"
    assert run(wrinkle, first, job(asset="o/other.gltf", out="z.glb")) == (1, [line])
    assert Path("o/skin.png").read_bytes() == PNG
    Path("o/skin.png").unlink()
    assert run(wrinkle, first, job(out="z.glb", report="o/skin.png")) == (1, [line])
    assert Path("o/skin.png").read_bytes().startswith(b"{")
    Path("o/skin.png").unlink()
    assert run(wrinkle, first) == (0, [])


def test_others_are_found_at_urls_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    fsspec = pytest.importorskip("fsspec")
    store = fsspec.filesystem("memory")
    asset = {"images": [{"uri": "skin.png"}], "buffers": [{"uri": "a%20b.bin"}]}
    store.pipe_file("/b/a/limb.gltf", json.dumps(asset).encode())
    first = {"asset": "memory:///b/a/limb.gltf", "tools": "t.yaml", "out": "memory:///b/o/limb.gltf"}
    frames = {"asset": "x.glb", "tools": "t.yaml", "out": "o.glb", "frames_dir": "memory:///b/a"}
    try:
        jobs = read(first, frames, {**first, "out": "p.glb", "report": "memory:///b/o/skin.png"})
        assert [each.others for each in jobs][:2] == [
            ("memory:///b/o/skin.png",),
            ("memory:///b/a/limb.gltf", "memory:///b/a/a b.bin", "memory:///b/a/skin.png"),
        ]
        with pytest.raises(ConfigError, match=r"would write over 'memory:///b/a/a b.bin', which jobs\[0\] reads"):
            read(first, {**first, "out": "p.glb", "report": "memory:///b/a/a b.bin"})
    finally:
        store.rm("/b", recursive=True)


def test_a_store_is_not_asked_for_what_no_output_can_be(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("wrinklecli.batching.stores.opened", None)
    jobs = [{"asset": f"s3://b/in/{n}.glb", "tools": "t.yaml", "out": f"s3://b/out/{n}.gltf"} for n in range(3)]
    monkeypatch.setattr("wrinklecli.batching.stores.read", lambda path, *_: Path(path).read_bytes())
    assert len(read(*jobs)) == 3


def test_thousands_of_jobs_take_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each path is looked up once, and each folder."""
    monkeypatch.chdir(tmp_path)
    os.mkdir("chars")
    count = 300
    for number in range(count):
        Path(f"chars/{number}.glb").write_bytes(b"glTF")
    looks: list[str] = []
    for name in ("stat", "lstat"):
        real = getattr(os, name)
        monkeypatch.setattr(os, name, lambda path, real=real, **more: looks.append(path) or real(path, **more))
    opened: list[str] = []
    monkeypatch.setattr("wrinklecli.batching.conflicts.references", lambda file: opened.append(file.name) or [])
    given = {"tools": "t.yaml", "out": "out/{stem}.glb"}
    assert len(read_pattern("chars/*.glb", given, BatchFiles(report="r.jsonl", cache="cache"))) == count
    assert len(looks) < 3 * count
    assert not opened
    assert len(read_pattern("chars/*.glb", {**given, "out": "chars/{stem}.out.glb"})) == count
    assert len(opened) == count
