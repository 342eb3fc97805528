"""Manifests: what they say, the same in YAML, CSV and JSON lines, and all that is wrong with one at once."""

import json
from pathlib import Path
from typing import Any

import click
import pytest

from kit import hostile
from wrinklecli.baking.job import BakeOptions
from wrinklecli.batching.build import bake_options
from wrinklecli.batching.conflicts import BatchFiles
from wrinklecli.batching.jobs import BatchJob
from wrinklecli.batching.manifest import read_manifest, read_pattern
from wrinklecli.batching.manifest_schema import OPTION_KEYS
from wrinklecli.cli import cli
from wrinklecli.errors import ConfigError
from wrinklecli.numeric.memory import MAX_MEMORY, parse_bytes
from wrinklecli.tools.records import Length


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b", "c"):
        (tmp_path / "chars" / name).mkdir(parents=True)
        (tmp_path / "chars" / name / f"{name}.glb").touch()
    return tmp_path


def read(name: str, text: str, *, profile: str | None = None, **given: Any) -> list[BatchJob]:
    Path(name).write_text(text)
    return read_manifest(name, given, profile=profile)


def complaints(name: str, text: str, **given: Any) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        read(name, text, **given)
    return list(caught.value.lines)


def test_jobs_have_the_options_of_bake() -> None:
    options = {each.opts[-1].strip("-").replace("-", "_"): each for each in cli.commands["bake"].params}
    # Of a job itself, or for one bake alone: a batch has a cache, and its workers are its processes.
    apart = {"asset", "tools", "output", "depfile", "cache", "jobs", "json", "progress", "quiet", "verbose"}
    assert set(OPTION_KEYS) == {name for name in options if name not in apart}
    for name, values in OPTION_KEYS.items():
        option = options[name]
        if isinstance(option.type, click.Choice):
            assert list(option.type.choices) == values["enum"]
        if isinstance(option.type, click.IntRange | click.FloatRange):
            assert (option.type.min, option.type.max) == (values["minimum"], values["maximum"])
        assert getattr(option, "is_flag", False) == (values.get("type") == "boolean")
        assert option.multiple == ("array" in values.get("type", ""))
        if name == "max_memory":
            # Many jobs share a machine; a person's own bake may take more of it.
            assert option.default is None
            assert parse_bytes(values["default"]) == MAX_MEMORY
        elif "default" in values and values.get("type") != "boolean":
            assert option.default == values["default"]


def test_an_option_says_what_it_says_to_bake() -> None:
    said = {"max_error": "2%", "max_memory": "2GB", "clip": ("walk",), "tool": ("knee",), "anim": ("x.glb",), "fps": 12}
    options = bake_options(BatchJob("", "a.glb", ("t.yaml",), "o.glb", said))
    lists = {"clips": ("walk",), "only": ("knee",), "anims": ("x.glb",)}
    assert options == BakeOptions(max_error=Length(2.0, percent=True), max_memory=2 * 10**9, fps=12, **lists)  # type: ignore[arg-type]
    assert bake_options(BatchJob("", "a.glb", ("t.yaml",), "o.glb")) == BakeOptions()


@pytest.mark.usefixtures("folder")
def test_patterns_defaults_and_levels_of_detail() -> None:
    text = """
version: 1
defaults: {tools: [body.yaml, "{folder}/own.yaml"], out: "out/{folder}/{stem}.glb", fps: 24}
jobs:
  - asset: chars/[ab]/*.glb
    clip: walk
  - fps: 60
    lods:
      - {asset: chars/c/c.glb, out: out/c0.glb, max_levels: 2}
      - {asset: chars/c/c.glb, out: s3://bucket/c1.glb, max_levels: 1, edges_per_interval: 1, split: true}
"""
    jobs = read("sub.yaml", text)
    assert [(job.where, job.asset, job.out) for job in jobs] == [
        ("sub.yaml:5: jobs[0]", "chars/a/a.glb", "out/chars/a/a.glb"),
        ("sub.yaml:5: jobs[0]", "chars/b/b.glb", "out/chars/b/b.glb"),
        ("sub.yaml:9: jobs[1].lods[0]", "chars/c/c.glb", "out/c0.glb"),
        ("sub.yaml:10: jobs[1].lods[1]", "chars/c/c.glb", "s3://bucket/c1.glb"),
    ]
    assert jobs[0].tools == ("body.yaml", "chars/a/own.yaml")
    coarser = {"fps": 60, "max_levels": 1, "edges_per_interval": 1, "split": True}
    assert [dict(job.options) for job in jobs[2:]] == [{"fps": 60, "max_levels": 2}, coarser]
    assert dict(jobs[1].options) == {"fps": 24, "clip": ("walk",)}


@pytest.mark.usefixtures("folder")
def test_paths_are_as_seen_from_the_manifest_but_those_of_the_command_line_from_here() -> None:
    job, *_ = read("chars/jobs.csv", "asset\n*/*.glb\n", tools="t.yaml", out="out/{stem}.glb")
    assert (job.asset, job.tools, job.out) == ("chars/a/a.glb", ("t.yaml",), "out/a.glb")
    assert read_pattern("chars/?/*.glb", {"tools": "t.yaml", "out": "out/{stem}.glb"})[0].out == "out/a.glb"


@pytest.mark.usefixtures("folder")
def test_tables_say_the_same() -> None:
    yaml = "version: 1\njobs:\n  - {asset: chars/a/a.glb, tools: [t.yaml, u.yaml], out: a.glb, fps: 12, draft: true}\n"
    csv = "asset,tools,out,fps,draft,clip\nchars/a/a.glb,t.yaml; u.yaml,a.glb,12,true,\n"
    lines = '{"asset": "chars/a/a.glb", "tools": ["t.yaml", "u.yaml"], "out": "a.glb", "fps": 12, "draft": true}\n'
    every = [read("m.yaml", yaml), read("m.csv", csv), read("m.jsonl", lines)]
    assert [(job.asset, job.tools, job.out, dict(job.options)) for (job,) in every] == [
        ("chars/a/a.glb", ("t.yaml", "u.yaml"), "a.glb", {"fps": 12, "draft": True})
    ] * 3
    assert [job.where for (job,) in every] == ["m.yaml:3: jobs[0]", "m.csv:2: jobs[0]", "m.jsonl:1: jobs[0]"]


@pytest.mark.usefixtures("folder")
def test_all_that_is_wrong_is_said_at_once_with_its_line() -> None:
    text = """version: 1
defaults: {tools: t.yaml, max_level: 3}
jobs:
  - {asset: "chars/x*.glb", out: x.glb}
  - asset: chars/a/a.glb
    out: out.glb
    max_levels: 12
    engine: unit
  - {asset: chars/a/a.glb, out: "{stm}.glb"}
  - {asset: chars/a/a.glb, out: a.txt}
  - {asset: chars/a/a.glb, out: b.glb, anims: w.glb}
  - {asset: chars/*/*.glb, out: b.glb}
  - {asset: chars/a/a.glb}
  - {asset: chars/a/a.glb, out: chars/b/b.glb, max_memory: 3kB}
  - {asset: chars/a/a.glb, out: chars/b/b.glb}
  - {lods: [{asset: chars/a/a.glb, engin: unity}]}
"""
    assert complaints("m.yaml", text) == [
        "m.yaml:2: defaults.max_level: unknown key, did you mean max_levels?",
        "m.yaml:4: jobs[0].asset: found 'chars/x*.glb', which no file is like",
        "m.yaml:7: jobs[1].max_levels: found 12, expected a whole number from 0 to 8",
        "m.yaml:8: jobs[1].engine: found unit, expected three, unity, unreal, filament, cesium, blender, godot3, vtk or"
        " spec8; did you mean unity?",
        "m.yaml:9: jobs[2].out: found {stm}, expected {stem} or {folder}",
        "m.yaml:10: jobs[3].out: found 'a.txt', which does not end in '.glb', '.gltf', '.vrm'",
        "m.yaml:11: jobs[4]: anims and tracked go together: files, and the folder for them",
        "m.yaml:12: jobs[5]: 'b.glb' is an output of another asset too: each needs a name of its own",
        "m.yaml:13: jobs[6].out: required, but missing",
        "m.yaml:14: jobs[7].max_memory: found 3kB, expected a size from 50MB up, such as 500MB or 4GB",
        "m.yaml:15: jobs[8]: would write over 'chars/b/b.glb', which jobs[5] reads",
        "m.yaml:16: jobs[9].lods[0].engin: unknown key, did you mean engine?",
    ]
    assert complaints("m.csv", "asset,out\nchars/a/a.glb\nx.glb,o.glb,1\n", tools="t") == [
        "m.csv:2: jobs[0].out: required, but missing",
        "m.csv:3: found 3 cells, expected at most 2",
    ]
    assert complaints("m.jsonl", '{"asset": 1}\n\n{"asset"\n') == [
        "m.jsonl:1: jobs[0].asset: found 1, expected text, in quotes where YAML would read a number, true, false or"
        " null",
        "m.jsonl:3: JSON: Expecting ':' delimiter",
    ]
    assert complaints("m.yaml", "") == ["m.yaml: the file is empty, expected jobs"]
    assert complaints("m.csv", "asset\n")[0].startswith("m.csv:1: jobs: found a list of 0, expected a list of 1 to ")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "key", ["asset", "tools", "out", "report", "timings", "frames_dir", "maps_dir", "anim", "anims"]
)
@pytest.mark.parametrize("path", ["a\0.glb", "a\0/b.glb"])
def test_a_path_that_no_file_has_is_refused(key: str, path: str) -> None:
    job = {"asset": "chars/a/a.glb", "tools": "t.yaml", "out": "o.glb", key: path}
    if key == "anims":
        job["tracked"] = "tracked"
    (line,) = complaints("m.jsonl", json.dumps(job))
    assert line.startswith(f"m.jsonl:1: jobs[0].{key}: found ")
    assert line.endswith("which has a null character: no file has such a name")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("key", ["asset", "tools", "out", "report", "engine", "clip", "half \udbff"])
def test_half_a_character_is_refused(key: str) -> None:
    job = {"asset": "chars/a/a.glb", "tools": "t.yaml", "out": "o.glb", key: "x\udbff/a.glb"}
    assert complaints("m.jsonl", json.dumps(job)) == ["m.jsonl:1: JSON: \\udbff is half of a character"]


@pytest.mark.parametrize("text", ["[" * 100_000, '{"asset":' * 100_000])
def test_json_that_is_nested_too_deep_is_said_in_our_words(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complaints("m.jsonl", text) == ["m.jsonl:1: JSON: nested deeper than any job"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("name", "text", "first"),
    [
        ("m.jsonl", "{1}\n" * 400_001, "m.jsonl:100001: found more lines, expected at most 100,000 jobs"),
        ("m.jsonl", "{1}\n" * 100_000, "m.jsonl:1: JSON: Expecting property name enclosed in double quotes"),
        ("m.csv", "asset\n" + "a,b\n" * 400_000, "m.csv:100002: found more rows, expected at most 100,000 jobs"),
    ],
)
def test_a_flood_of_mistakes_is_a_screen_of_lines(name: str, text: str, first: str) -> None:
    with hostile.bounded(seconds=30.0, megabytes=150.0):
        line, *others = complaints(name, text)
    assert line == first
    assert others == [] or (len(others), others[-1]) == (50, "and 99,950 more")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("key", ["clip", "tool", "anim"])
def test_one_name_or_a_list_of_one_is_enough_and_none_is_not(key: str) -> None:
    def job(value: object) -> str:
        return json.dumps({"asset": "chars/a/a.glb", "tools": "t.yaml", "out": "o.glb", key: value})

    for value in ("x", ["x"], ["x", "y"]):
        (found,) = read("m.jsonl", job(value))
        assert found.options[key] == tuple(value)
    for value in ("", [], [""]):
        (line,) = complaints("m.jsonl", job(value))
        assert line.startswith(f"m.jsonl:1: jobs[0].{key}")


SHARED = """version: 1
defaults: {tools: t.yaml, out: "out/{profile}/{stem}.glb", fps: 24, max_levels: 2}
profiles:
  mobile: {max_levels: 0, engine: unity}
  desktop:
"""


@pytest.mark.usefixtures("folder")
def test_a_profile_overrides_defaults_and_jobs_override_both() -> None:
    text = f"{SHARED}jobs:\n  - asset: chars/a/a.glb\n  - {{asset: chars/b/b.glb, max_levels: 3}}\n"
    jobs = read("m.yaml", text, profile="mobile")
    assert [job.out for job in jobs] == ["out/mobile/a.glb", "out/mobile/b.glb"]
    assert [dict(job.options) for job in jobs] == [
        {"fps": 24, "max_levels": levels, "engine": "unity"} for levels in (0, 3)
    ]
    assert dict(read("m.yaml", text, profile="desktop")[0].options) == {"fps": 24, "max_levels": 2}
    place = "m.yaml:6: jobs[0].out"
    assert complaints("m.yaml", text)[0] == "m.yaml:7: jobs[0].out: found {profile}, which needs --profile NAME"
    assert place not in complaints("m.yaml", text)
    expected = "m.yaml:3: profiles: found mobil, expected mobile or desktop; did you mean mobile?"
    assert complaints("m.yaml", text, profile="mobil") == [expected]
    none = "version: 1\njobs: [{asset: chars/a/a.glb, tools: t, out: o.glb}]\n"
    assert complaints("n.yaml", none, profile="m") == ["n.yaml:1: profiles: found m, but no manifest has profiles"]
    wrong = "version: 1\nprofiles:\n  mobile: {max_vertice: 3}\n  x: 1\njobs: [{asset: a.glb}]\n"
    found = complaints("m.yaml", wrong, profile="mobile", tools="t", out="o.glb")
    assert found[0] == "m.yaml:3: profiles.mobile.max_vertice: unknown key, did you mean max_vertices?"
    assert found[1].startswith("m.yaml:4: profiles.x: found 1, expected a mapping of ")


def test_included_manifests_come_first_and_paths_are_relative_to_each(folder: Path) -> None:
    (folder / "chars" / "shared.yaml").write_text(SHARED + "include: [more.csv, ../chars/more.csv]\n")
    (folder / "chars" / "more.csv").write_text("asset,fps\n*/b.glb,12\n")
    own = "defaults: {fps: 60}\nprofiles: {mobile: {engine: three}}\njobs: [{asset: chars/a/a.glb, out: a.glb}]\n"
    jobs = read("m.yaml", f"version: 1\ninclude: chars/shared.yaml\n{own}", profile="mobile")
    assert [(job.where, job.asset, job.tools, job.out) for job in jobs] == [
        ("chars/more.csv:2: jobs[0]", "chars/b/b.glb", ("chars/t.yaml",), "chars/out/mobile/b.glb"),
        ("m.yaml:5: jobs[0]", "chars/a/a.glb", ("chars/t.yaml",), "a.glb"),
    ]
    assert [dict(job.options) for job in jobs] == [{"fps": fps, "max_levels": 0, "engine": "three"} for fps in (12, 60)]
    # An included manifest is an input of the batch, and its faults have its lines.
    text = "version: 1\ninclude: chars/shared.yaml\njobs: [{asset: chars/a/a.glb, out: chars/more.glb}]\n"
    Path("m.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"chars/more\.csv: is a file of the batch too"):
        read_manifest("m.yaml", {}, BatchFiles(report="chars/more.csv"), profile="mobile")
    (folder / "chars" / "more.csv").write_text("asset,fp\n*/b.glb,12\n")
    assert complaints("m.yaml", text, profile="mobile") == [
        "chars/more.csv:2: jobs[0].fp: unknown key, did you mean fps?"
    ]


def test_includes_that_lead_nowhere_or_to_themselves_are_refused(folder: Path) -> None:
    (folder / "b.yaml").write_text("version: 1\ninclude:\n  - ./m.yaml\n")
    text = "version: 1\ninclude:\n  - b.yaml\n  - c.yaml\n  - b.txt\n  - m.yaml\n  - 5\n"
    jobs = "jobs: [{asset: chars/a/a.glb, tools: t, out: o.glb}]\n"
    assert complaints("m.yaml", text.replace("  - 5\n", "") + jobs) == [
        "b.yaml:3: include[0]: found './m.yaml', which leads to itself: m.yaml → b.yaml → m.yaml",
        "m.yaml:4: include[1]: 'c.yaml' cannot be read: No such file or directory",
        "m.yaml:5: include[2]: 'b.txt' does not end in '.yaml', '.yml', '.csv', '.jsonl'",
        "m.yaml:6: include[3]: found 'm.yaml', which leads to itself: m.yaml → m.yaml",
    ]
    assert complaints("m.yaml", text + jobs)[-1].startswith("m.yaml:7: include[4]: found 5, expected text")
    assert complaints("m.yaml", "version: 1\ninclude: m.yaml\n")[0].startswith("m.yaml:2: include: found 'm.yaml'")
    assert complaints("m.yaml", "version: 1\n") == ["m.yaml:1: jobs: required, but missing"]
    for number in range(40):
        (folder / f"{number}.yaml").write_text(f"version: 1\ninclude: {number + 1}.yaml\n")
    (found,) = complaints("m.yaml", f"version: 1\ninclude: 0.yaml\n{jobs}")
    assert found == "31.yaml:2: include: found '32.yaml', expected at most 32 included manifests"
