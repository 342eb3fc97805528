"""Damaged and malicious input: always a line that says so, never a traceback, a hang, a flood or a stray file."""

import base64
import errno
import json
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from kit import hostile
from kit.asset import Asset, pack_glb, read_glb
from kit.attack import attack, prepare, run
from kit.cases import ANSWERS, MOTIONS, WEB, Case, loaded, make_case
from kit.clients import need
from kit.damage import copied, edit_tree, tree_edit
from kit.limb import limb_asset, tool, write_tools
from kit.manifests import NAMES
from kit.places import ROOT
from kit.variants import rich
from kit.vectors import CASES as CASES_OF_EXTRAS
from kit.visits import VISITS
from wrinklecli import bake
from wrinklecli.cli import cli
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.gltf import new_data
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.memory import MAX_VERTICES

Json = dict[str, Any]

CASES = int(os.environ.get("WRINKLE_HOSTILE_CASES", "80"))
BATCH = 40
# Cases that failed once, each with as few edits as it took: a line of JSON, written by tests/hostile.py --keep.
KEPT = ROOT / "tests" / "data" / "hostile.jsonl"
MAIN = "from wrinklecli.cli import main; main()"
SMALL: Json = {"rings": 7, "sides": 6}


def attacked(case: Case, folder: Path) -> int:
    try:
        return attack(case, folder)
    except Exception as error:
        pytest.fail(f"case {case.name}: {case.dumped()}\n{type(error).__name__}: {error}", pytrace=True)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("first", range(0, CASES, BATCH))
def test_commands_on_damaged_files_end_in_order(tmp_path: Path, first: int) -> None:
    for number in range(first, min(first + BATCH, CASES)):
        folder = tmp_path / str(number)
        folder.mkdir()
        attacked(make_case(number), folder)


@cache
def many_cases() -> list[Case]:
    """As many attacks as it takes for each way to be among them."""
    return [make_case(number) for number in range(5000)]


@pytest.mark.slow
@pytest.mark.long
def test_every_option_is_attacked() -> None:
    given: dict[str, set[str]] = {name: set() for name in cli.commands}
    for case in many_cases():
        command, *arguments = case.arguments
        given[command].update(arguments)
    for name, command in cli.commands.items():
        # Other processes and the home folder are for tests of their own, and a browser for nobody.
        left_out = ("jobs", "scheduler", "dashboard", "allow_host", "install")
        options = [each for each in command.params if isinstance(each, click.Option) and each.name not in left_out]
        assert [each.opts for each in options if not set(each.opts) & given[name]] == []


@pytest.mark.slow
def test_every_way_in_is_attacked() -> None:
    cases = many_cases()
    parts = {
        "asset",
        "tools",
        "record",
        "data",
        "asset bytes",
        "tools bytes",
        "geometry",
        "later",
        "kill",
        "disk",
        "beside",
    }
    parts |= {"presets", "presets bytes"}
    parts |= {"manifest", "manifest bytes", "side", "side bytes", "visit"}
    parts |= {f"kept {part}" for part in ("record", "note", "record bytes", "note bytes", "content bytes", "tag bytes")}
    assert {edit[1] for case in cases for edit in case.edits} == parts
    assert {edit[0] for case in cases for edit in case.edits if edit[1] == "visit"} == set(VISITS)
    inputs = {each for case in cases for each in case.arguments}
    assert {*NAMES, *MOTIONS, "--watch", "--pose", "--morph", "{web}/limb.glb"} <= inputs
    assert {kind for case in cases for name, kind in case.places.items() if name.startswith(WEB)} == set(ANSWERS)
    places = {name for case in cases for name in case.places}
    assert places & set(NAMES)
    assert {"cache", "sub/limb.gltf", ".tools.yaml.unsaved", "tools.yaml", "out.glb"} <= places


@pytest.mark.quick(2, 5)
@pytest.mark.parametrize("line", KEPT.read_text().splitlines(), ids=lambda line: str(json.loads(line)["arguments"]))
def test_what_failed_once_does_not_again(tmp_path: Path, line: str) -> None:
    attacked(loaded(line, "kept"), tmp_path)


@pytest.mark.quick(1, 4)
@pytest.mark.parametrize("number", range(hostile.SOURCES))  # each worker would make the corpus, to be counted
def test_corpus_is_sound(tmp_path: Path, number: int) -> None:
    assert len(hostile.corpus()) == hostile.SOURCES
    asset = f"limb{hostile.corpus()[number].suffix}"
    case = Case("sound", number, [], ["bake", asset, "tools.yaml", "--replace", "-o", "out.glb"])
    # One needs instances, which no bake reads.
    needs = hostile.corpus()[number].gltf.get("extensionsRequired", [])
    assert attacked(case, tmp_path) == ("EXT_mesh_gpu_instancing" in needs)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["rest_length_keys", "lag", "fold", "muscles", "flesh", "touch", "bent"])
def test_forged_extras_end_every_command_in_order(tmp_path: Path, name: str) -> None:
    """What a bake has written for players, with anything in the place of any field."""
    gltf, data = read_glb(CASES_OF_EXTRAS[name].make().path.read_bytes())
    write_tools(tmp_path / "tools.yaml", tool(optional=True), refinement={"max_levels": 0}, sampling={"fps": 4})
    (number,) = (k for k, node in enumerate(gltf["nodes"]) if "wrinkle" in node.get("extras", {}))
    chance = random.Random(name)
    commands = [
        "track forged.glb forged.glb -o tracked --fps 4",
        "diff forged.glb forged.glb --posed --fps 2",
        "bake forged.glb tools.yaml --replace -o out.glb",
        "check forged.glb tools.yaml --fps 2",
        "preview forged.glb -o p.png --size 32x32 --frames 1",
    ]
    for _ in range(20):
        forged = copied(gltf)
        for edit in tree_edit(chance, "extras", forged["nodes"][number]["extras"]["wrinkle"]):
            edit_tree(forged["nodes"][number]["extras"]["wrinkle"], edit)
        (tmp_path / "forged.glb").write_bytes(pack_glb(json.dumps(forged).encode(), data))
        for command in (commands[0], chance.choice(commands[1:])):
            with hostile.bounded():
                code, _, err = run(command.split(), tmp_path)
            assert (code in (0, 1, 2), "Traceback" in err) == (True, False), (command, edit, err)


@pytest.mark.quick(0, 3)
@pytest.mark.parametrize("kind", ["pipe", "/dev/null"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["bake", "limb.glb", "tools.yaml", "--report", "report.json", "-o", "out.glb"],
        ["bake", "limb.glb", "tools.yaml", "-o", "out.glb", "--report", "report.json"],
        ["check", "limb.glb", "tools.yaml", "--plot", "plot.svg"],
        ["suggest", "limb.glb", "--all", "-o", "found.yaml"],
        ["preview", "limb.glb", "--size", "32x32", "-o", "p.png"],
    ],
    ids=" ".join,
)
def test_outputs_go_through_pipes_and_devices(tmp_path: Path, arguments: list[str], kind: str) -> None:
    assert attacked(Case("sound", 0, [], arguments, {arguments[-1]: kind}), tmp_path) == 0
    assert not (tmp_path / arguments[-1]).is_file()


def refusal(folder: Path, asset: Asset | bytes, *tools: Json, **header: Any) -> str:
    """The one line that a bake ends in, without much time or memory."""
    path = folder / "limb.glb"
    path.write_bytes(asset if isinstance(asset, bytes) else asset.glb())
    settings = write_tools(folder / "tools.yaml", *tools, **header)
    with hostile.bounded(seconds=5.0, megabytes=400.0), pytest.raises(WrinkleError) as caught:
        bake(path, settings, folder / "out.glb")
    assert sorted(each.name for each in folder.iterdir()) == ["limb.glb", "tools.yaml"]
    (line,) = caught.value.lines
    return line


@pytest.mark.parametrize("count", [2**21, 2**26, 2**26 + 1, 2**32, 2**53, 2**64])
def test_small_file_cannot_ask_for_gigabytes(tmp_path: Path, count: int) -> None:
    gltf = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "targets": [{}]}]}],
        "accessors": [{"count": count, "type": "VEC3", "componentType": 5126}],
    }
    assert "#/accessors/0" in refusal(tmp_path, json.dumps(gltf).encode())


@pytest.mark.slow
def test_empty_morph_targets_take_no_gigabytes(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL, morphs=1)
    asset.gltf["meshes"][0]["primitives"][0]["targets"] += [{}] * 200_000
    assert "200001 morph targets of 49 vertices" in refusal(tmp_path, asset)


def test_repeated_joints_take_no_gigabytes(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL)
    asset.gltf["skins"][0]["joints"] += [1] * 50_000
    del asset.gltf["skins"][0]["inverseBindMatrices"]
    assert "has 50002 joints; at most 4096" in refusal(tmp_path, asset)


def test_repeated_influences_take_no_minutes(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL)
    attributes = asset.gltf["meshes"][0]["primitives"][0]["attributes"]
    for k in range(1, 1000):
        attributes |= {f"{kind}_{k}": attributes[f"{kind}_0"] for kind in ("JOINTS", "WEIGHTS")}
    assert "has 1000 sets of joints; at most 16" in refusal(tmp_path, asset)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "message"), [(100_000, "levels deep"), (1, "its own ancestor")])
def test_long_and_endless_chains_are_refused(tmp_path: Path, count: int, message: str) -> None:
    asset = limb_asset(**SMALL)
    first = len(asset.gltf["nodes"])
    last = 1 if count > 1 else first
    asset.gltf["nodes"] += [{"children": [first + k + 1]} for k in range(count - 1)] + [{"children": [last]}]
    assert message in refusal(tmp_path, asset)


@pytest.mark.parametrize("end", [1e5, 1e30, 3e38])
def test_endless_clip_is_refused(tmp_path: Path, end: float) -> None:
    asset = limb_asset(**SMALL, clip=None)
    animation: Json = {"name": "for ever"}
    asset.channel(animation, 2, "rotation", [0.0, end], [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.6, 0.8]])
    asset.append("animations", animation)
    assert "frames" in refusal(tmp_path, asset)


@pytest.mark.slow
def test_many_vertices_at_one_place_take_no_minutes(tmp_path: Path) -> None:
    count = 20_000
    asset = limb_asset(**SMALL)
    shares = np.linspace(0.0, 1.0, count)
    asset.gltf["meshes"][0]["primitives"] = [
        {
            "attributes": {
                "POSITION": asset.accessor(np.zeros((count, 3))),
                "JOINTS_0": asset.accessor(np.tile([0, 1, 0, 0], (count, 1)), "u1"),
                "WEIGHTS_0": asset.accessor(np.stack([shares, 1 - shares, 0 * shares, 0 * shares], axis=1)),
            }
        }
    ]
    assert "from the mesh" in refusal(tmp_path, asset)


@pytest.mark.parametrize("value", [1e90, 1e200, -1e16])
def test_transforms_without_meaning_are_refused(tmp_path: Path, value: float) -> None:
    asset = limb_asset(**SMALL, root={"scale": [value, value, value]})
    assert refusal(tmp_path, asset).startswith(f"{tmp_path / 'limb.glb'}#/nodes/3: ")


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e30])
def test_inverse_bind_matrices_without_meaning_are_refused(tmp_path: Path, value: float) -> None:
    asset = limb_asset(**SMALL)
    index = asset.gltf["skins"][0]["inverseBindMatrices"]
    view = asset.gltf["bufferViews"][asset.gltf["accessors"][index]["bufferView"]]
    asset.data[view["byteOffset"] : view["byteOffset"] + 4] = np.float32(value).tobytes()
    assert f"#/accessors/{index}: holds inverse bind matrices" in refusal(tmp_path, asset)


def test_signalling_nan_is_refused_where_it_is(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL)
    index = asset.gltf["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    view = asset.gltf["bufferViews"][asset.gltf["accessors"][index]["bufferView"]]
    asset.data[view["byteOffset"] : view["byteOffset"] + 4] = b"\x01\x00\xa0\x7f"
    assert f"POSITION (accessor {index}) of vertex 0 is not a finite number" in refusal(tmp_path, asset)


def test_products_that_overflow_say_where_in_the_program(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL)
    scale = {"scale": [1e14] * 3}
    first = len(asset.gltf["nodes"])
    asset.gltf["nodes"] += [{**scale, "children": [first + k + 1]} for k in range(29)] + [{**scale, "children": [1]}]
    line = refusal(tmp_path, asset)
    assert "too large or too small to compute with (overflow encountered in" in line
    assert ".py:" in line


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("bumps", "edges", "most"),
    [
        (64, 24, 12_500),
        (4, 5_000, 12_500),
        pytest.param(64, 24, MAX_VERTICES, marks=pytest.mark.slow),
        pytest.param(4, 20_000, MAX_VERTICES, marks=[pytest.mark.slow, pytest.mark.long]),
    ],
)
def test_millions_of_triangles_are_refused(tmp_path: Path, bumps: int, edges: int, most: int) -> None:
    details = [0.1] * 4 if bumps == 64 else []
    asset = limb_asset() if bumps == 64 else hostile.pole(edges)
    (tmp_path / "limb.glb").write_bytes(asset.glb())
    settings = write_tools(
        tmp_path / "tools.yaml", tool(bumps=bumps, details=details, width=1.0), refinement={"max_levels": 8}
    )
    with hostile.bounded(), pytest.raises(WrinkleError) as caught:
        bake(tmp_path / "limb.glb", settings, tmp_path / "out.glb", max_vertices=most)
    (line,) = caught.value.lines
    assert line.startswith("limb: would have ")
    assert "new vertices at level" in line
    assert "max_levels, now 8" in line
    assert line.endswith("or raise --max-vertices")


@pytest.mark.slow
@pytest.mark.long
def test_yaml_bomb_is_refused(tmp_path: Path) -> None:
    (tmp_path / "limb.glb").write_bytes(limb_asset(**SMALL).glb())
    levels = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]
    (tmp_path / "tools.yaml").write_text("\n".join(["a0: &a0 [x]", *levels]))
    with hostile.bounded(seconds=5.0, megabytes=200.0), pytest.raises(WrinkleError, match="aliases are expanded"):
        bake(tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb")


def linked(uri: str, *, kind: str = "buffers") -> str:
    """A limb whose buffer, or an image, is behind a URI."""
    asset = limb_asset(**SMALL)
    inside = "data:application/gltf-buffer;base64," + base64.b64encode(asset.data).decode()
    buffer = {"uri": uri if kind == "buffers" else inside, "byteLength": len(asset.data)}
    return json.dumps({**asset.gltf, "buffers": [buffer], "images": [{"uri": uri}] if kind == "images" else []})


@pytest.mark.quick(1, 7)
@pytest.mark.parametrize("kind", ["buffers", "images"])
@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "sub/../../secret.bin",
        "../assets/limb.bin",
        "{folder}/limb.bin",
        "{secret}",
        "file://{secret}",
        "http://localhost:9/limb.bin",
        "//localhost/limb.bin",
        "link.bin",
        "pipe",
        "folder",
        "a%00b",
    ],
)
def test_uri_reads_nothing_outside_the_folder(tmp_path: Path, uri: str, kind: str) -> None:
    folder, out = tmp_path / "assets", tmp_path / "out"
    for each in (folder, out, folder / "sub", folder / "folder"):
        each.mkdir()
    data = limb_asset(**SMALL).data
    (tmp_path / "secret.bin").write_bytes(data)
    (folder / "limb.bin").write_bytes(data)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    os.mkfifo(folder / "pipe")
    uri = uri.format(folder=folder, secret=tmp_path / "secret.bin")
    (folder / "limb.gltf").write_text(linked(uri, kind=kind))
    settings = write_tools(folder / "tools.yaml")
    before = set(tmp_path.rglob("*"))
    for name in ("out.glb", "out.gltf"):
        with hostile.bounded(), pytest.raises(WrinkleError, match=f"limb.gltf#/{kind}/0"):
            bake(folder / "limb.gltf", settings, out / name)
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.long
def test_names_cannot_command_the_terminal(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL)
    evil = "\x1b]0;owned\x07\r\n\x1b[31mred\u202e\u2028"
    asset.gltf["animations"][0]["name"] = evil
    asset.gltf["nodes"][0]["name"] = evil
    path, settings = asset.write(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", tool(node="limb"))
    for more in ([], ["--clip", evil + "?"]):
        command = [sys.executable, "-c", MAIN, "bake", path, settings, "-o", tmp_path / "out.glb", *more]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ended.returncode == 1
        assert ended.stderr.count("\n") == 1
        assert ended.stderr.strip("\n").isprintable()


def _full(*_: Any, **__: Any) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _read_only(*_: Any, **__: Any) -> Any:
    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _after(calls: int, function: Callable[..., Any], fault: Callable[..., Any]) -> Callable[..., Any]:
    """A function that fails from a call on."""
    left = [calls]

    def failing(*args: Any, **options: Any) -> Any:
        left[0] -= 1
        return function(*args, **options) if left[0] >= 0 else fault()

    return failing


@pytest.mark.quick(1, 8)
@pytest.mark.parametrize("calls", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("module", "name", "fault"),
    [
        (os, "fsync", _full),
        (os, "replace", _full),
        (os, "mkdir", _read_only),
    ],
)
@pytest.mark.parametrize("name_out", ["out.glb", "out.gltf"])
def test_full_disk_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name_out: str, module: Any, name: str, fault: Any, calls: int
) -> None:
    folder, out = tmp_path / "assets", tmp_path / "out"
    (folder / "textures").mkdir(parents=True)
    out.mkdir()
    (folder / "textures" / "skin.png").write_bytes(b"\x89PNG")
    asset = limb_asset(**SMALL)
    asset.gltf["images"] = [{"uri": "textures/skin.png"}]
    asset.write(folder / "limb.gltf")
    settings = write_tools(folder / "tools.yaml")
    (out / name_out).write_bytes(b"old")
    before = set(tmp_path.rglob("*"))
    monkeypatch.setattr(module, name, _after(calls, getattr(module, name), fault))
    try:
        bake(folder / "limb.gltf", settings, out / name_out)
    except BakeError as error:
        (line,) = error.lines
        assert "cannot be" in line
        assert (out / name_out).read_bytes() == b"old"
        assert set(tmp_path.rglob("*")) == before
    else:
        assert calls or (name, name_out) == ("mkdir", "out.glb")
        read_document(out / name_out)


def test_full_disk_for_temporary_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, settings = limb_asset(**SMALL).write(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml")
    monkeypatch.setattr(new_data, "_SPOOL_BYTES", 2**10)
    monkeypatch.setattr(tempfile, "TemporaryFile", _full)
    with pytest.raises(BakeError, match="cannot be written: No space left"):
        bake(path, settings, tmp_path / "out.glb")
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect", "limb.glb"],
        ["diff", "limb.glb", "sound.glb"],
        ["track", "body.glb", "limb.glb", "-o", "tracked"],
        ["track", "limb.glb", "sound.glb", "-o", "tracked"],
        ["bake", "limb.glb", "tools.yaml", "-o", "out.glb"],
        ["check", "limb.glb", "tools.yaml"],
        ["suggest", "limb.glb"],
        ["preview", "limb.glb", "-o", "limb.png"],
    ],
    ids=" ".join,
)
def test_lack_of_memory_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]) -> None:
    prepare(Case("sound", 0, [], arguments), tmp_path)

    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("wrinklecli.gltf.document.parse_json", full)
    code, _, err = run(arguments, tmp_path)
    assert code == (2 if arguments[0] == "diff" else 1)
    assert "takes more memory than there is" in err
    assert err.count("\n") == 1


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "arguments",
    [
        ["inspect", "limb.glb"],
        ["diff", "limb.glb", "other.glb", "--verbose"],
        ["check", "limb.glb", "tools.yaml"],
        ["suggest", "limb.glb", "--all", "-o", "found.yaml"],
        ["bake", "limb.glb", "tools.yaml", "-o", "out.glb", "--verbose"],
        ["bake", "limb.glb", "tools.yaml", "-o", "out.glb", "--clip", "N" * 100_000],
        ["preview", "limb.glb", "-o", "limb.png", "--size", "32x32", "--frames", "1"],
    ],
    ids=lambda arguments: " ".join(arguments)[:60],
)
def test_long_names_are_cut_where_they_are_shown(tmp_path: Path, arguments: list[str]) -> None:
    asset = rich(rings=7, sides=6)
    for kind in ("nodes", "meshes", "materials", "skins", "animations", "images", "scenes"):
        for number, each in enumerate(asset.gltf.get(kind, [])):
            each["name"] = f"{kind}{number}{'N' * 100_000}"
    asset.gltf["asset"]["generator"] = "N" * 100_000
    asset.gltf["meshes"][0]["extras"] = {"targetNames": ["t" * 100_000, "u" * 100_000]}
    asset.write(tmp_path / "limb.glb")
    for each in asset.gltf["nodes"]:
        each["name"] += "x"
    asset.write(tmp_path / "other.glb")
    write_tools(tmp_path / "tools.yaml", tool(node=f"nodes0{'N' * 100_000}"))
    code, out, err = run(arguments, tmp_path)
    assert code == (1 if "--clip" in arguments or arguments[0] == "diff" else 0)
    assert max(map(len, (out + err).splitlines())) < 10_100


def test_json_has_long_names_whole(tmp_path: Path) -> None:
    asset = limb_asset(**SMALL)
    asset.gltf["nodes"][0]["name"] = "N" * 100_000
    asset.write(tmp_path / "limb.glb")
    _, out, _ = run(["inspect", "limb.glb", "--json"], tmp_path)
    assert json.loads(out)["deforming"][0]["node"] == "N" * 100_000


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "arguments",
    [
        ["bake", "{}.glb", "tools.yaml", "-o", "{}out.gltf", "--report", "{}.json"],
        ["bake", "{}.gltf", "tools.yaml", "-o", "sub/{}.gltf", "--frames-dir", "{}frames"],
        ["inspect", "{}.gltf"],
        ["check", "{}.glb", "{}.yaml", "--plot", "{}.svg"],
        ["diff", "{}.glb", "{}.gltf"],
        ["suggest", "{}.glb", "--all", "-o", "{}found.yaml"],
        ["preview", "{}.glb", "-o", "{}.png", "--size", "32x32", "--frames", "1"],
        ["track", "body.glb", "{}.gltf", "-o", "{}tracked"],
    ],
    ids=" ".join,
)
def test_names_of_files_need_be_no_utf8(tmp_path: Path, arguments: list[str]) -> None:
    if "--plot" in arguments:
        need("matplotlib")
    prepare(Case("sound", 0, [], arguments), tmp_path)
    name = os.fsdecode(b"l\xffmb")
    asset = limb_asset(**SMALL)
    asset.write(tmp_path / f"{name}.glb")
    (tmp_path / f"{name}.bin").write_bytes(asset.data)
    buffer = {"uri": "l%FFmb.bin", "byteLength": len(asset.data)}
    (tmp_path / f"{name}.gltf").write_text(json.dumps(asset.gltf | {"buffers": [buffer]}))
    write_tools(tmp_path / f"{name}.yaml")
    arguments = [each.format(name) for each in arguments]
    code, _, err = run(arguments, tmp_path)
    assert (code, "Traceback" in err) == (0, False), err
    if arguments[0] == "bake":
        read_document(tmp_path / arguments[4])
