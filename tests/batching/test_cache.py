"""Nothing in a cache is trusted: an entry that is not what the job has written is a miss, with a warning."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec
import pytest
from PIL import Image

from kit.command import Ran, Wrinkle, files
from kit.flesh import body, region
from kit.limb import PNG, limb_asset, tool, write_parts, write_tools
from wrinklecli.batching import stores
from wrinklecli.batching.cache import Cache
from wrinklecli.batching.cache_keys import Parts, key_of, parts_of
from wrinklecli.batching.job_files import JobFiles
from wrinklecli.batching.jobs import BatchJob
from wrinklecli.effects.flesh import tissue

OWNED = b"OWNED"
DIGEST = hashlib.sha256(OWNED).hexdigest()
JOB = {"asset": "a/limb.gltf", "tools": "t.yaml", "out": "o/limb.gltf", "report": "o/r.json"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A character in three files, and tools."""
    monkeypatch.chdir(tmp_path)
    return write_parts(tmp_path, "limb", "run", image="tex/my skin.png")


class Batch:
    """A batch of one job, and its cache."""

    def __init__(self, wrinkle: Wrinkle, **keys: Any) -> None:
        self._wrinkle = wrinkle
        Path("m.jsonl").write_text(json.dumps({**JOB, **keys}))

    def run(self) -> dict[str, Any]:
        """Run the batch without an error; the line of its report."""
        ran = self.command("--report", "-")
        assert ran.code == 0, ran.lines
        told: dict[str, Any] = json.loads(ran.out)
        return told

    def command(self, *arguments: str) -> Ran:
        return self._wrinkle("batch", "m.jsonl", "--cache", "c", *arguments)

    @property
    def record(self) -> Path:
        (path,) = Path("c/keys").rglob("*.json")
        return path

    def plant(self, content: bytes = OWNED) -> str:
        """Put a content into the cache; its digest."""
        digest = hashlib.sha256(content).hexdigest()
        path = Path("c/files", digest[:2], digest)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        return digest


@pytest.fixture
def batch(wrinkle: Wrinkle, folder: Path) -> Batch:
    """A batch that has run once."""
    assert folder
    made = Batch(wrinkle)
    assert made.run()["result"] == "built"
    return made


EVERY = {"frames_dir": "f", "timings": "o/t.json", "anims": "a/*.gltf", "tracked": "tracked", "max_error": "2%"}


@pytest.mark.quick(1)
@pytest.mark.parametrize("keys", [{}, EVERY, {"out": "a/out.gltf"}, {"out": "o/limb.glb", "split": True}])
@pytest.mark.usefixtures("folder")
def test_every_output_comes_back(keys: dict[str, Any], folder: Path, wrinkle: Wrinkle) -> None:
    inputs = files(folder)
    batch = Batch(wrinkle, **keys)
    assert batch.run()["reason"] == "new"
    first = files(folder)
    assert batch.run()["reason"] == "in place"
    for path in first.keys() - inputs.keys():
        if not path.startswith("c/") and path != "m.jsonl":
            Path(path).unlink()
    told = batch.run()
    assert (told["reason"], any("c/" in line for line in told["warnings"])) == ("from the cache", False)
    assert files(folder) == first


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".gltf", ".glb"])
def test_an_output_beside_its_asset_is_another_than_one_elsewhere(ending: str, wrinkle: Wrinkle, folder: Path) -> None:
    """Beside the asset it refers to the asset's buffer and image; elsewhere it has its own."""
    assert Batch(wrinkle, out=f"a/out{ending}").run()["reason"] == "new"
    assert Batch(wrinkle, out=f"o/out{ending}").run()["result"] == "built"
    assert (folder / "a" / f"out{ending}").read_bytes() != (folder / "o" / f"out{ending}").read_bytes()
    (folder / "p").mkdir()
    assert wrinkle("bake", "a/limb.gltf", "t.yaml", "-o", f"p/out{ending}", "--report", "p/r.json").code == 0
    made, expected = files(folder / "o"), files(folder / "p")
    assert made.pop("r.json")
    assert expected.pop("r.json")
    assert made == expected
    assert Batch(wrinkle, out=f"q/out{ending}").run()["reason"] == "from the cache"


def _masked(folder: Path, *, grey: int) -> None:
    """Let the tool have a mask, an image beside the tools file."""
    Image.new("L", (2, 2), grey).save(folder / "mask.png")
    asked = tool(bumps=1, mask={"image": "mask.png"})
    write_tools(folder / "t.yaml", asked, refinement={"max_levels": 0}, sampling={"fps": 4})


@pytest.mark.slow
def test_an_output_depends_on_the_image_of_a_mask(wrinkle: Wrinkle, folder: Path) -> None:
    _masked(folder, grey=255)
    batch = Batch(wrinkle)
    assert batch.run()["reason"] == "new"
    assert batch.run()["reason"] == "in place"
    whole = (folder / "o" / "limb.gltf").read_bytes()
    _masked(folder, grey=128)
    assert batch.run()["reason"] == "the tools changed"
    assert (folder / "o" / "limb.gltf").read_bytes() != whole


@pytest.mark.parametrize("key", ["report", "timings"])
def test_no_output_is_the_image_of_a_mask(key: str, wrinkle: Wrinkle, folder: Path) -> None:
    _masked(folder, grey=255)
    ran = Batch(wrinkle, **{key: "mask.png"}).command()
    assert (ran.code, ran.lines) == (
        1,
        ["m.jsonl:1: jobs[0]: would write over 'mask.png', which jobs[0] reads"],
    )


@pytest.mark.slow
def test_the_image_of_a_mask_is_fetched_with_the_tools(wrinkle: Wrinkle, folder: Path) -> None:
    _masked(folder, grey=255)
    system = fsspec.filesystem("memory")
    for name in ("t.yaml", "mask.png"):
        system.pipe(f"/masked/{name}", (folder / name).read_bytes())
    assert Batch(wrinkle, tools="memory:///masked/t.yaml").run()["result"] == "built"
    Image.new("L", (2, 2), 128).save(folder / "mask.png")
    system.pipe("/masked/mask.png", (folder / "mask.png").read_bytes())
    assert Batch(wrinkle, tools="memory:///masked/t.yaml").run()["reason"] == "the tools changed"


def _with_presets(folder: Path, *, bumps: int) -> None:
    """Let the tool have a preset, from a file beside the tools file."""
    (folder / "studio.yaml").write_text(f"felt: {{material: cloth, bumps: {bumps}}}\n")
    asked = tool(material="felt")
    write_tools(folder / "t.yaml", asked, presets="studio.yaml", refinement={"max_levels": 0}, sampling={"fps": 4})


@pytest.mark.slow
def test_a_file_of_presets_is_an_input(wrinkle: Wrinkle, folder: Path) -> None:
    """Outputs depend on it and never replace it, and it is fetched with the tools."""
    _with_presets(folder, bumps=1)
    batch = Batch(wrinkle)
    assert [batch.run()["reason"] for _ in range(2)] == ["new", "in place"]
    _with_presets(folder, bumps=2)
    assert batch.run()["reason"] == "the tools changed"
    refused = Batch(wrinkle, report="studio.yaml").command()
    assert refused.lines == ["m.jsonl:1: jobs[0]: would write over 'studio.yaml', which jobs[0] reads"]
    system = fsspec.filesystem("memory")
    for name in ("t.yaml", "studio.yaml"):
        system.pipe(f"/preset/{name}", (folder / name).read_bytes())
    assert Batch(wrinkle, tools="memory:///preset/t.yaml").run()["result"] == "built"
    for command in (["bake", "-o", "o.glb", "--report"], ["check", "--plot"], ["preview", "--tools"]):
        before = (folder / "studio.yaml").read_bytes()
        given = ["a/limb.gltf", "t.yaml"] if command[0] != "preview" else ["a/limb.gltf"]
        last = ["t.yaml", "-o"] if command[0] == "preview" else []
        ran = wrinkle(command[0], *given, *command[1:], *last, "studio.yaml")
        assert (ran.code != 0, (folder / "studio.yaml").read_bytes()) == (True, before), command
    assert wrinkle("bake", "a/limb.gltf", "t.yaml", "-o", "o.glb", "--depfile", "o.d").code == 0
    assert "studio.yaml" in (folder / "o.d").read_text().split()


@pytest.mark.slow
@pytest.mark.parametrize("uri", ["", "tex", "none.png", ".", "http://127.0.0.1:9/skin.png", "../skin.png"])
def test_a_reference_that_is_no_file_beside_is_not_kept(uri: str, wrinkle: Wrinkle, folder: Path) -> None:
    asset = limb_asset(rings=7, sides=6)
    asset.gltf["images"] = [{"uri": uri}]
    asset.write(folder / "a" / "limb.gltf")
    batch = Batch(wrinkle, out="a/out.gltf")
    assert batch.run()["warnings"][2:] == []
    assert batch.run()["reason"] == "in place"


@pytest.mark.slow
@pytest.mark.usefixtures("batch")
def test_a_bake_of_a_bake_comes_back(wrinkle: Wrinkle) -> None:
    again = Batch(wrinkle, asset="o/limb.gltf", out="p/q.gltf", report="p/r.json", replace=True)
    assert again.run()["reason"] == "new"
    first = files(Path("p"))
    assert {"q.gltf", "tex/my skin.png"} < first.keys()
    for path in first:
        Path("p", path).unlink()
    assert again.run()["reason"] == "from the cache"
    assert files(Path("p")) == first


def changed(**keys: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda record: {**record, **keys}


def with_file(root: Any, path: Any, digest: Any = DIGEST) -> Callable[[dict[str, Any]], Any]:
    return lambda record: {**record, "files": [[root, path, digest], *record["files"]]}


def saying(**keys: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda record: {**record, "said": {**record["said"], **keys}}


def deep(count: int) -> Any:
    nested: Any = []
    for _ in range(count):
        nested = [nested]
    return nested


RECORDS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "above": with_file("out", "../victim"),
    "an input": with_file("out", "../t.yaml"),
    "the manifest": with_file("out", "../m.jsonl"),
    "absolute": with_file("out", os.path.abspath("/tmp/victim")),
    "beside": with_file("out", "victim"),
    "beside, as a buffer of others": with_file("out", f"other-{DIGEST[:12]}.bin"),
    "beside, as a buffer of other content": with_file("out", "limb-0123456789ab.bin"),
    "above, as a buffer": with_file("out", f"../limb-{DIGEST[:12]}.bin"),
    "a buffer below": with_file("out", f"x/limb-{DIGEST[:12]}.bin"),
    "an image of other content": with_file("out", "tex/my skin.png"),
    "an image by its URI": with_file("out", "tex/my%20skin.png"),
    "beside the report": with_file("report", "victim"),
    "a report that is not asked for": with_file("timings", "t.json"),
    "frames that are not asked for": with_file("frames_dir", "fold_0001.obj"),
    "tracked files that are not asked for": with_file("tracked", "run.gltf"),
    "an unknown root": with_file("nope", "o.glb"),
    "an unknown root alone": changed(files=[["nope", "o.glb", "0"]]),
    "no files": changed(files=[]),
    "no main output": lambda record: {**record, "files": record["files"][:-1]},
    "no report": lambda record: {**record, "files": [each for each in record["files"] if each[0] != "report"]},
    "twice": lambda record: {**record, "files": record["files"] * 2},
    "a null character": with_file("out", "a\0b"),
    "half a character": with_file("out", "\udcff\ud800"),
    "a digest in capitals": lambda record: {
        **record,
        "files": [[root, path, digest.upper()] for root, path, digest in record["files"]],
    },
    "a digest that is a path": with_file("report", "r.json", "../../../m.jsonl"),
    "a path that is a number": with_file("out", 3),
    "a root that is a list": with_file([], "x"),
    "files of two fields": changed(files=[["out", "o.glb"]]),
    "files as text": changed(files="abc"),
    "files as a number": changed(files=7),
    "no version": lambda record: {key: value for key, value in record.items() if key != "cache"},
    "another version": changed(cache=3),
    "a nested version": changed(cache=deep(200)),
    "no outcome": lambda record: {key: value for key, value in record.items() if key != "said"},
    "an outcome of none": changed(said=None),
    "an outcome of text": changed(said="built"),
    "NaN": saying(residual=float("nan")),
    "infinity": saying(tallest=float("inf")),
    "a length that is true": saying(residual=True),
    "a length as text": saying(residual="1"),
    "a length beyond all": saying(residual=10**400),
    "warnings as a number": saying(warnings=5),
    "warnings that are numbers": saying(warnings=[5]),
    "a nested summary": saying(summary=deep(50)),
    "a list": lambda record: [record],
    "null": lambda _: None,
    "text": lambda _: "record",
}


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_that_no_job_writes_is_a_miss(name: str, known: tuple[dict[str, Any], Parts]) -> None:
    record, parts = known
    cache = Cache("c")
    Path("c/keys/ke").mkdir(parents=True)
    path = Path("c/keys/ke/key.json")
    path.write_text(json.dumps(record))
    assert cache.find("key", JobFiles(parts)) is not None
    path.write_text(json.dumps(RECORDS[name](record)))
    assert cache.find("key", JobFiles(parts)) is None
    (warning,) = cache.warnings
    assert warning.startswith(f"{path}: is not ")
    assert len(warning) < 300


def test_a_record_of_an_older_program_is_a_miss(known: tuple[dict[str, Any], Parts]) -> None:
    cache = Cache("c")
    Path("c/keys/ke").mkdir(parents=True)
    Path("c/keys/ke/key.json").write_text(json.dumps({**known[0], "cache": 1}))
    assert cache.find("key", JobFiles(known[1])) is None
    assert not cache.warnings


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b"\xff\xfe\0",
        b'{"cache": 1, "files": NaN}',
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"9" * 5000,
        b" " * (2**23 + 1),
    ],
    ids=["empty", "half", "no text", "NaN", "deep", "deep objects", "long number", "huge"],
)
def test_a_record_that_is_no_json_is_a_miss(text: bytes, known: tuple[dict[str, Any], Parts]) -> None:
    cache = Cache("c")
    Path("c/keys/ke").mkdir(parents=True)
    Path("c/keys/ke/key.json").write_bytes(text)
    assert cache.find("key", JobFiles(known[1])) is None
    assert len(cache.warnings) == 1


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Parts]:
    """The record of a job, and the parts of its key."""
    made = tmp_path_factory.mktemp("cache")
    asset = limb_asset(rings=7, sides=6)
    asset.gltf["images"] = [{"uri": "tex/my%20skin.png"}]
    asset.write(made / "limb.gltf")
    (made / "tex").mkdir()
    (made / "tex" / "my skin.png").write_bytes(PNG)
    write_tools(made / "t.yaml")
    job = BatchJob("", str(made / "limb.gltf"), (str(made / "t.yaml"),), "o/limb.gltf", report="o/r.json")
    image = hashlib.sha256(PNG).hexdigest()
    record = {
        "cache": 2,
        "files": [
            ["report", "r.json", DIGEST],
            ["out", f"limb-{DIGEST[:12]}.bin", DIGEST],
            ["out", "tex/my skin.png", image],
            ["out", "limb.gltf", DIGEST],
        ],
        "said": {"summary": "1 tool", "warnings": ["a warning"], "residual": 1e-9, "tallest": None},
    }
    return record, parts_of(job, job)


@pytest.fixture
def known(
    baked: tuple[dict[str, Any], Parts], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[dict[str, Any], Parts]:
    monkeypatch.chdir(tmp_path)
    return baked


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize("name", ["above", "an image of other content", "an unknown root alone", "NaN", "text"])
def test_a_job_with_such_a_record_is_baked(name: str, batch: Batch, folder: Path) -> None:
    (folder / "victim").write_bytes(b"precious")
    batch.plant()
    before = files(folder)
    record = json.loads(batch.record.read_text())
    for path in files(folder / "o"):
        (folder / "o" / path).unlink()
    batch.record.write_text(json.dumps(RECORDS[name](record)))
    assert batch.command("--dry-run").out == "o/limb.gltf: would be built: the cache has lost it\n"
    told = batch.run()
    assert (told["result"], told["reason"]) == ("built", "the cache has lost it")
    assert told["warnings"][-1].startswith("c/keys/")
    assert files(folder) == before
    told = batch.run()
    assert (told["result"], any("c/" in line for line in told["warnings"])) == ("hit", False)


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    "note",
    [
        {"parts": 5},
        {"parts": {"asset": 3, "names": {"out": ["x"]}, "options": {"frames": 1}, "anims": [1]}},
        {"parts": {"names": {"out": "../../victim", "report": None, "timings": None}, "asset": {"\ud800": 1}}},
        {"parts": {}},
        {"parts": deep(600)},
        {"parts": {"program": deep(600)}},
        [],
    ],
)
def test_what_is_noted_of_an_output_may_be_anything(note: Any, batch: Batch, folder: Path) -> None:
    before = files(folder)
    for path in Path("c/outs").rglob("*.json"):
        path.write_text(json.dumps(note))
    batch.record.unlink()
    told = batch.run()
    assert told["result"] == "built"
    assert files(folder) == before


def as_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def as_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def as_loop(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def as_other_content(path: Path) -> None:
    path.write_bytes(b"other")


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize("spoilt", [as_pipe, as_device, as_loop, as_other_content])
@pytest.mark.parametrize("kind", ["keys", "files", "outs"])
def test_entries_that_are_no_files_are_misses(
    kind: str, spoilt: Callable[[Path], None], batch: Batch, folder: Path
) -> None:
    before = files(folder)
    for path in list(Path("c", kind).rglob("*")):
        if path.is_file():
            spoilt(path)
    Path("o/limb.gltf").unlink()
    if kind == "outs":
        batch.record.unlink()
    told = batch.run()
    assert told["result"] == "built"
    assert sum(line.startswith(f"c/{kind}/") for line in told["warnings"]) == 1
    assert files(folder) == before, "and the cache has the right entries again"


@pytest.mark.slow
def test_an_entry_that_cannot_be_replaced_is_a_warning(batch: Batch) -> None:
    as_folder(batch.record)
    Path("o/limb.gltf").unlink()
    told = batch.run()
    assert told["result"] == "built"
    assert any("the cache cannot be written: Is a directory" in line for line in told["warnings"])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["keys", "files", "outs"])
def test_a_link_in_the_cache_leads_nowhere(kind: str, batch: Batch, folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    shutil.rmtree(Path("c", kind))
    Path("c", kind).mkdir()
    for number in range(256):
        Path("c", kind, f"{number:02x}").symlink_to(folder / "elsewhere")
    write_tools(folder / "t.yaml", tool(bumps=1, width=0.31), refinement={"max_levels": 0}, sampling={"fps": 4})
    told = batch.run()
    assert told["result"] == "built"
    assert any("a link leads out of it" in line for line in told["warnings"])
    assert files(folder / "elsewhere") == {}


# A cache that cannot be written


@pytest.mark.slow
@pytest.mark.parametrize("reason", ["No space left on device", "Read-only file system", "Access Denied"])
def test_outputs_are_done_whatever_the_cache_does(
    reason: str, wrinkle: Wrinkle, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(28, reason)

    with monkeypatch.context() as patched:
        patched.setattr(stores, "put", refuse)
        ran = Batch(wrinkle).command("--report", "r.jsonl")
        assert ran.code == 0
        line = f"c/CACHEDIR.TAG: the cache cannot be written: {reason}; outputs are not kept"
        assert ran.lines[0] == f"warning: {line}"
        assert any(line.startswith("warning: ") for line in ran.lines)
        told = json.loads((folder / "r.jsonl").read_text())
        assert told["result"] == "built"
        assert f"the cache cannot be written: {reason}" in told["warnings"][-1]
    made = files(folder / "o")
    assert {"limb.gltf", "r.json"} < made.keys()
    assert not (folder / "c").exists()
    # A hit that cannot be noted is one.
    batch = Batch(wrinkle)
    assert batch.run()["result"] == "built"
    Path("o/limb.gltf").unlink()
    monkeypatch.setattr(stores, "put", refuse)
    told = batch.run()
    assert (told["result"], told["reason"]) == ("hit", "from the cache")
    assert f"the cache cannot be written: {reason}" in told["warnings"][-1]
    assert files(folder / "o") == made


@pytest.mark.slow
def test_a_cache_that_is_a_file_is_one_that_cannot_be_written(wrinkle: Wrinkle, folder: Path) -> None:
    (folder / "c").write_bytes(b"a file")
    told = Batch(wrinkle).run()
    assert told["result"] == "built"
    assert "the cache cannot be written: " in told["warnings"][-1]
    assert (folder / "c").read_bytes() == b"a file"
    assert Batch(wrinkle).run()["result"] == "built"


def test_an_output_that_is_gone_again_is_not_kept(
    wrinkle: Wrinkle, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert folder
    real = Cache.keep

    def keep(self: Cache, key: str, *rest: Any) -> None:
        Path("o/r.json").unlink()
        real(self, key, *rest)

    monkeypatch.setattr(Cache, "keep", keep)
    told = Batch(wrinkle).run()
    assert told["result"] == "built"
    assert "cannot be kept" in told["warnings"][-1]


@pytest.mark.slow
@pytest.mark.long
def test_a_solved_region_of_flesh_is_taken_from_the_cache(
    wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A change of the springs solves nothing again; what is no solution is solved anew, with a warning."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tissue, "NODES", 200)
    Path("body.glb").write_bytes(body(keys=12, normals=False).glb())
    Path("m.jsonl").write_text(json.dumps({"asset": "body.glb", "tools": "t.yaml", "out": "out.glb"}))
    solved: list[int] = []
    solve = tissue.solve
    monkeypatch.setattr(tissue, "solve", lambda *args: solved.append(1) or solve(*args))

    def run(frequency: float) -> list[str]:
        tissue._kept.clear()
        Path("t.yaml").write_text(json.dumps({"version": 1, "flesh": [region(frequency=frequency, shapes=3)]}))
        ran = wrinkle("batch", "m.jsonl", "--cache", "c", "--report", "-")
        assert ran.code == 0, ran.lines
        return [line for line in json.loads(ran.out)["warnings"] if "shapes/" in line]

    assert not run(3.0)
    (entry,) = Path("c/shapes").glob("*/*")
    sound, first = entry.read_bytes(), Path("out.glb").read_bytes()
    assert not run(4.0)
    assert len(solved) == 1
    again = Path("out.glb").read_bytes()
    assert again != first

    record = json.loads(sound[32:])
    record["Swings"][1] *= -1  # the length of a cube's edge
    forged = json.dumps(record).encode()
    damages = {
        "is damaged: its content has another digest": sound[:-1],
        "is not a solution of this region (its numbers": hashlib.sha256(forged).digest() + forged,
        "is not a solution of this region": hashlib.sha256(b"{}").digest() + b"{}",
        "has another digest": b"",
    }
    for number, (reason, data) in enumerate(damages.items(), start=2):
        entry.write_bytes(data)
        Path("out.glb").unlink()
        shutil.rmtree("c/keys")
        (line,) = run(4.0)
        assert reason in line
        assert line.endswith(": ignored")
        assert len(solved) == number
        assert Path("out.glb").read_bytes() == again
        assert entry.read_bytes() == sound


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("# a comment\nversion:   1\ntools: [ {name: a, width: '10%'} ]  # another\n", True),
        ("\ufeffversion: 1\ntools:\n- name: 'a'\n  width: 10%\n", True),
        ("version: 1\ntools:\n  - name: a\n    width: 11%\n", False),
        ("version: 1\ntools:\n  - width: 10%\n    name: a\n  -\n", False),
        ("version: 1\ntools:\n  - name: a\n    width: 10%\n    width: 10%\n", False),
        ("version: 1\ntools:\n  - name: a\n    width: 10%\n]", False),
        ("", False),
    ],
)
def test_comments_and_layout_of_tools_do_not_count(text: str, same: bool, folder: Path) -> None:
    (folder / "asset.gltf").write_text("{}")
    job = BatchJob("", str(folder / "asset.gltf"), (str(folder / "own.yaml"),), "out.glb")
    found = []
    for each in ("version: 1\ntools:\n  - name: a\n    width: 10%\n", text):
        (folder / "own.yaml").write_text(each, encoding="utf-8")
        found.append(key_of(parts_of(job, job)))
    assert (found[0] == found[1]) == same
