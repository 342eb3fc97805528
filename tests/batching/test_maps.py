"""`maps_dir` of a job: the maps of `bake --maps-dir`, kept and held apart as all outputs are."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest

from kit.command import Wrinkle, files
from kit.limb import limb_asset, tool, write_tools
from kit.small_maps import small_maps
from kit.variants import PNG
from wrinklecli.batching.cache import Cache
from wrinklecli.batching.cache_keys import parts_of
from wrinklecli.batching.job_files import JobFiles
from wrinklecli.batching.jobs import BatchJob
from wrinklecli.batching.manifest import read_manifest

MANIFEST = "m.jsonl"
JOB = {"asset": "limb.gltf", "tools": "t.yaml", "out": "o/limb.glb", "maps_dir": "maps"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.gltf")
    write_tools(tmp_path / "t.yaml", tool(bumps=1), refinement={"max_levels": 0}, sampling={"fps": 4})
    with small_maps():
        yield tmp_path


def run(wrinkle: Wrinkle, *jobs: dict[str, Any]) -> tuple[int, list[str], list[dict[str, Any]]]:
    """Run a batch; its exit code, the lines of jobs that failed, and its report."""
    Path(MANIFEST).write_text("".join(json.dumps({**JOB, **each}) + "\n" for each in jobs))
    ran = wrinkle("batch", MANIFEST, "--cache", "c", "--report", "-")
    lines = [line for line in ran.lines if line.startswith(MANIFEST)]
    return ran.code, lines, [json.loads(line) for line in ran.out.splitlines()]


@pytest.mark.slow
def test_maps_are_those_of_a_bake_and_come_back_from_the_cache(folder: Path, wrinkle: Wrinkle) -> None:
    assert wrinkle("bake", "limb.gltf", "t.yaml", "-o", "p.glb", "--maps-dir", "expected").code == 0
    assert run(wrinkle, {})[2][0]["reason"] == "new"
    made = files(folder / "maps")
    assert made == files(folder / "expected")
    assert "maps.json" in made
    assert len(made) > 3
    assert run(wrinkle, {})[2][0]["reason"] == "in place"
    for name in made:
        Path("maps", name).unlink()
        assert run(wrinkle, {})[2][0]["reason"] == "from the cache"
        assert files(folder / "maps") == made
    # Another folder gets the same files; a job without maps is another job.
    assert run(wrinkle, {"maps_dir": "{stem}_maps"})[2][0]["reason"] == "from the cache"
    assert files(folder / "limb_maps") == made
    Path(MANIFEST).write_text(json.dumps({key: value for key, value in JOB.items() if key != "maps_dir"}))
    assert (
        wrinkle("batch", MANIFEST, "--cache", "c", "--dry-run").out == "o/limb.glb: would be built: options changed\n"
    )


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_maps_go_to_a_store_but_not_over_an_input(wrinkle: Wrinkle) -> None:
    store = fsspec.filesystem("memory")
    asset = limb_asset(rings=7, sides=6)
    asset.gltf["images"] = [{"uri": "maps/skin_1_normal.png"}]
    asset.gltf["materials"] = [{"name": "skin"}]
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    asset.write(Path("limb.gltf"))
    try:
        store.pipe({"/m/limb.gltf": Path("limb.gltf").read_bytes(), "/m/limb.bin": Path("limb.bin").read_bytes()})
        store.pipe("/m/maps/skin_1_normal.png", PNG)
        named = {"asset": "memory:///m/limb.gltf", "maps_dir": "memory:///m/made"}
        assert run(wrinkle, named)[0] == 0
        assert "/m/made/skin_1_normal.png" in store.find("/m/made")
        assert "/m/made/maps.json" in store.find("/m/made")
        code, (line,), _ = run(wrinkle, {**named, "maps_dir": "memory:///m/maps"})
        over = "memory:///m/maps/skin_1_normal.png: is an input too and would be overwritten"
        assert (code, line) == (1, f"{MANIFEST}:1: jobs[0]: {over}")
        assert store.cat("/m/maps/skin_1_normal.png") == PNG
    finally:
        store.rm("/m", recursive=True)


@pytest.mark.usefixtures("folder")
def test_two_jobs_have_two_folders(wrinkle: Wrinkle) -> None:
    os.symlink("maps", "linked")
    line = f"{MANIFEST}:2: jobs[1]: {{}} is an output of jobs[0] too: each needs a name of its own"
    assert run(wrinkle, {}, {"out": "x.glb", "maps_dir": "./maps/"})[:2] == (1, [line.format("'./maps/'")])
    assert run(wrinkle, {}, {"out": "x.glb", "maps_dir": "linked"})[:2] == (1, [line.format("'linked'")])
    own = f"{MANIFEST}:1: jobs[0]: 'maps/maps.json' is another output of this job too: each needs a name of its own"
    assert run(wrinkle, {"report": "maps/maps.json"})[:2] == (1, [own])
    assert not Path("maps").exists()
    assert not Path("o").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_no_map_is_a_file_that_the_batch_reads(wrinkle: Wrinkle) -> None:
    os.mkdir("maps")
    Path("t.yaml").rename("maps/maps.json")
    line = f"{MANIFEST}:1: jobs[0]: would write over 'maps/maps.json', which jobs[0] reads"
    assert run(wrinkle, {"tools": "maps/maps.json"})[:2] == (1, [line])
    Path("maps/maps.json").rename("t.yaml")
    # An image that another job reads fails its job, whatever the order, and leaves the other alone.
    other = limb_asset(rings=7, sides=6)
    other.gltf["images"] = [{"uri": "maps/limb_1_normal.png"}]
    other.write(Path("other.gltf"))
    Path("maps/limb_1_normal.png").write_bytes(PNG)
    beside = {"asset": "other.gltf", "out": "o/other.glb", "maps_dir": "others"}
    Path(MANIFEST).write_text(json.dumps(JOB) + "\n" + json.dumps({**JOB, **beside}))
    assert read_manifest(MANIFEST, {})[0].others == ("maps/limb_1_normal.png",)
    line = "maps/limb_1_normal.png: is a file of another job too and would be overwritten"
    assert run(wrinkle, {}, beside)[:2] == (1, [f"{MANIFEST}:1: jobs[0]: {line}"])
    assert Path("maps/limb_1_normal.png").read_bytes() == PNG
    assert not Path("o/limb.glb").exists()
    assert Path("o/other.glb").exists()


@pytest.mark.usefixtures("folder")
def test_maps_of_a_bake_are_refused(wrinkle: Wrinkle) -> None:
    line = f"{MANIFEST}:1: jobs[0].maps_dir: goes without replace: maps are of an asset without wrinkles"
    assert run(wrinkle, {"replace": True})[:2] == (1, [line])


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_strict_takes_the_warnings_of_maps(wrinkle: Wrinkle) -> None:
    asset = limb_asset(rings=7, sides=6)
    for node in asset.gltf["nodes"]:
        node.pop("name", None)
    asset.write(Path("limb.gltf"))
    code, lines, (told,) = run(wrinkle, {"strict": True})
    assert (code, told["result"]) == (3, "refused"), lines
    assert not Path("maps/maps.json").exists()
    told = run(wrinkle, {})[2][0]
    assert any("players look joints up by name" in line for line in told["warnings"])


DIGEST = "0" * 64


@pytest.mark.parametrize(
    ("path", "asked", "taken"),
    [
        ("maps.json", True, True),
        ("skin_2_mask_11.png", True, True),
        ("maps.json", False, False),
        ("skin_1_ao.png", False, False),
        ("skin_0_ao.png", True, False),
        ("../skin_1_ao.png", True, False),
        ("sub/skin_1_ao.png", True, False),
        ("skin_1_ao.png\n", True, False),
        ("limb.gltf", True, False),
    ],
)
def test_a_cache_gives_a_job_no_other_files_than_maps(folder: Path, path: str, *, asked: bool, taken: bool) -> None:
    options = {"maps_dir": "maps"} if asked else {}
    job = BatchJob("", "limb.gltf", ("t.yaml",), "o/limb.glb", options)
    parts, own = parts_of(job, job), [["maps_dir", "maps.json", DIGEST]] if asked else []
    record = {
        "cache": 2,
        "files": [*own, ["out", "limb.glb", DIGEST]],
        "said": {"summary": "", "warnings": [], "residual": None, "tallest": None},
    }
    cache, place = Cache("c"), folder / "c" / "keys" / "ke" / "key.json"
    place.parent.mkdir(parents=True)
    place.write_text(json.dumps(record))
    assert cache.find("key", JobFiles(parts)) is not None
    if [path] != [each[1] for each in own]:
        record["files"] = [["maps_dir", path, DIGEST], *record["files"]]  # type: ignore[misc]
    place.write_text(json.dumps(record))
    assert (cache.find("key", JobFiles(parts)) is not None) == taken
    place.write_text(json.dumps({**record, "files": [["out", "limb.glb", DIGEST]]}))
    assert (cache.find("key", JobFiles(parts)) is None) == asked
