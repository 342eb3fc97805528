"""The drivers in several languages: they turn the poses of `samples/driver/vectors.json` into the weights due."""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.bakes import bake_config, bake_once, place
from kit.clients import HERE as CLIENTS
from kit.clients import ask, drive, give_up, need
from kit.flesh import SECONDS, bob, bob_share, body, jump, region
from kit.places import FOLDER, ROOT
from kit.vectors import CASES, Case, vectors
from kit.work import PATIENCE

FILE = ROOT / "samples" / "driver" / "vectors.json"
GODOT = FILE.parent / "godot"
# What Godot 4 spells otherwise than Godot 3: all of it in the node, and none in the driver.
# Of a weight between two languages: sums are in another order, and a wrinkle starts like a square root.
ALIKE = 1e-7


@cache
def due() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(FILE.read_text())
    return found


@cache
def javascript() -> dict[str, Any]:
    found: dict[str, Any] = ask("vectors", "play", str(FILE))
    return found


@cache
def csharp(poses: Path = FILE, baked: Path | None = None) -> dict[str, Any]:
    """Compiled and run by Mono; flesh knows the clips of a baked file."""
    program = compiled("vectors.exe", "Vectors.cs")
    found: dict[str, Any] = json.loads(run("mono", "mono-runtime", program, poses, *([baked] if baked else [])))
    return found


@cache
def gdscript(poses: Path = FILE, baked: Path | None = None) -> dict[str, Any]:
    """Run by Godot 3, without a window; flesh knows the clips of a baked file."""
    folder = Path(tempfile.mkdtemp(dir=FOLDER))
    for source in (*GODOT.glob("*.gd"), CLIENTS / "vectors.gd", CLIENTS / "answers.gd"):
        shutil.copy(source, folder)
    shutil.copy(poses, folder / "vectors.json")
    if baked:
        shutil.copy(baked, folder / "baked.glb")
    (folder / "project.godot").write_text('config_version=4\n[application]\nconfig/name="vectors"\n')
    run("godot3-server", "godot3-server", "--no-window", "--path", folder, "-s", "vectors.gd")
    found: dict[str, Any] = json.loads((folder / "played.json").read_text())
    return found


@cache
def compiled(name: str, *sources: str) -> Path:
    """The C# driver with further files of `clients` or of its own folder, as a program or a library."""
    kind = "-target:library" if name.endswith(".dll") else "-target:exe"
    own = FILE.parent / "csharp"
    more = [CLIENTS / each if (CLIENTS / each).exists() else own / each for each in sources]
    run("mcs", "mono-mcs", "-langversion:7", "-warnaserror", kind, f"-out:{FOLDER / name}", *own.glob("*.cs"), *more)
    return FOLDER / name


def run(command: str, package: str, *arguments: str | Path) -> str:
    """Give what a program of Debian says; without it the test is skipped, and fails where `CI` is set."""
    if shutil.which(command) is None:
        give_up(f"{command} is not installed: apt-get install {package}")
    done = subprocess.run([command, *arguments], capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


DRIVERS: dict[str, Callable[[], dict[str, Any]]] = {"javascript": javascript, "csharp": csharp, "gdscript": gdscript}


def test_the_file_is_small_and_has_all_cases() -> None:
    assert FILE.stat().st_size < 300_000
    assert list(due()) == list(CASES)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["wrist", "muscles", "flesh", *sorted({*CASES} - {"wrist", "muscles", "flesh"})])
def test_the_vectors_are_those_of_the_program(name: str) -> None:
    """Another processor rounds otherwise, and contact adds that up."""
    wanted, found = due()[name], json.loads(json.dumps(vectors(CASES[name])))
    assert differences(wanted["wrinkle"], found["wrinkle"], 0.05) == []
    assert differences(wanted["runs"], found["runs"], 0.02) == []
    assert [wanted[key] for key in wanted if key not in ("wrinkle", "runs")] == [
        found[key] for key in found if key not in ("wrinkle", "runs")
    ]


def differences(wanted: Any, found: Any, tolerance: float) -> list[str]:
    """Find where two pieces of JSON differ by more than a ratio of their numbers, or of 1."""
    if isinstance(wanted, dict) and isinstance(found, dict) and wanted.keys() == found.keys():
        return [f"{key} {line}" for key in wanted for line in differences(wanted[key], found[key], tolerance)]
    if isinstance(wanted, list) and isinstance(found, list) and len(wanted) == len(found):
        pairs = zip(wanted, found, strict=True)
        return [f"{k} {line}" for k, pair in enumerate(pairs) for line in differences(*pair, tolerance)]
    same = wanted == found
    if isinstance(wanted, int | float) and isinstance(found, int | float):
        same = abs(wanted - found) <= tolerance * max(abs(wanted), 1.0)
    return [] if same else [f"{wanted} {found}"]


@pytest.mark.quick(14, 25)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("language", DRIVERS)
def test_a_driver_gives_the_weights_due(language: str, name: str) -> None:
    case = due()[name]
    for run, played in zip(case["runs"], DRIVERS[language]()[name]["runs"], strict=True):
        wanted = np.array(run["weights"])
        assert len(played) == len(wanted) * run["rounds"]
        error = np.abs(np.array(played)[-len(wanted) :] - wanted)
        frame, target = np.unravel_index(error.argmax(), error.shape)
        assert error.max() < case["tolerance"], (run["clip"], run["times"][frame], case["targets"][target], error.max())


@pytest.mark.quick(1)
@pytest.mark.parametrize("language", DRIVERS)
def test_a_driver_knows_how_often_a_loop_is_played_unseen(language: str) -> None:
    rounds = {}
    for name, case in due().items():
        for run, unseen in zip(case["runs"], DRIVERS[language]()[name]["unseen"], strict=True):
            if run["rounds"] > 1 and None not in run["elapsed"]:
                rounds[name] = run["rounds"] - 1
                assert unseen == rounds[name], name
            elif not any("lag" in each for each in case["wrinkle"]["tools"]) and name not in (
                "tip",
                "tip_of_one_clip",
                "anew",
                "stroke",
            ):
                assert unseen == 0, name
    assert rounds == {"lag": 1, "loop": 6, "flesh": 1, "rub": 1}


@pytest.mark.parametrize("language", [each for each in DRIVERS if each != "javascript"])
def test_all_languages_do_and_say_the_same(language: str) -> None:
    """In each frame of springs too, and where a joint and a morph target are lost."""
    found, wanted = DRIVERS[language](), javascript()
    assert {name: each["problems"] for name, each in found.items()} == {
        name: each["problems"] for name, each in wanted.items()
    }
    assert 'the fold of "lower" is left out, as there is no joint "upper"' in wanted["fold"]["problems"]
    assert 'folds is left out, as there is no joint "joint_1"' in wanted["field"]["problems"]
    assert "palm_side does not show, as there is no morph target" in "\n".join(wanted["wrist"]["problems"])
    for name in CASES:
        for played, other in zip(found[name]["runs"], wanted[name]["runs"], strict=True):
            assert np.abs(np.subtract(played, other)).max() < ALIKE, name


def test_csharp_finds_the_extras_in_a_file(tmp_path: Path) -> None:
    baked = bake_config("wrist", "wrist")
    program = compiled("vectors.exe", "Vectors.cs")
    assert run("mono", "mono-runtime", program, baked.path) == "wrist: palm_side, back_side\n"
    (tmp_path / "out.gltf").write_text(json.dumps(baked.json))
    assert run("mono", "mono-runtime", program, tmp_path / "out.gltf") == "wrist: palm_side, back_side\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "clip", "fps"),
    [("trunk", "jump", 30), ("trunk", "jump", 144), pytest.param("body", "walk", 60, marks=pytest.mark.long)],
)
@pytest.mark.parametrize("play", [csharp, gdscript])
def test_flesh_knows_the_clips_of_a_file(
    play: Callable[..., dict[str, Any]], name: str, clip: str, fps: int, tmp_path: Path
) -> None:
    """The keys of both are 30 a second, which kick flesh by 4 and 20 % where the driver does not know them."""
    trunk = {"flesh": [region(limit=0.026)]}
    baked = bake_config("body", "body") if name == "body" else bake_once(place(body(keys=30)), top=trunk)
    case = vectors(Case("", lambda: baked, {clip: (fps, True)}))
    poses = tmp_path / "poses.json"
    poses.write_text(json.dumps({"flesh": case}))
    found = play(poses, baked.path)["flesh"]["runs"][0]
    wanted = np.array(case["runs"][0]["weights"])
    for each in case["wrinkle"]["flesh"]:
        columns = [case["targets"].index(target) for target in each["targets"]]
        due = wanted[:, columns]
        assert due.max() > 0.05
        assert np.abs(np.array(found)[-len(due) :, columns] - due).max() < 0.01 * due.max(), each["name"]


@pytest.mark.slow
@pytest.mark.parametrize("play", [csharp, gdscript])
def test_flesh_knows_clips_that_blend(play: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    """Each driver gives the weights of that of three.js, which is held to a motion that blends the curves of both."""
    baked = bake_once(place(body(keys=30, bobs=True)), top={"flesh": [region(limit=0.026)]})
    case = vectors(Case("", lambda: baked, {"jump": (60, False)}))
    (run,) = case["runs"]
    times = np.array(run["times"])
    shares, keys = bob_share(times), np.linspace(0.0, SECONDS, round(30 * SECONDS) + 1)
    ways = [np.stack([np.interp(times, keys, axis) for axis in motion(keys).T], axis=1) for motion in (jump, bob)]
    run["others"] = [
        {"bob": {"time": time, "share": share}} for time, share in zip(run["times"], shares.tolist(), strict=True)
    ]
    for (matrix,), moved in zip(
        run["matrices"], (1.0 - shares)[:, None] * ways[0] + shares[:, None] * ways[1], strict=True
    ):
        matrix[12:15] = moved.tolist()
    poses = tmp_path / "poses.json"
    poses.write_text(json.dumps({"flesh": case}))
    found = np.array(play(poses, baked.path)["flesh"]["runs"][0])
    steps = {"times": run["times"], "elapsed": run["elapsed"], "into": ("bob", shares.tolist())}
    wanted = drive(baked.path, node="trunk", clip="jump", driver=True, **steps)
    assert np.abs(found - np.stack([wanted[name][:, 0] for name in case["targets"]], axis=1)).max() < 1e-3


@pytest.mark.slow
def test_the_component_of_unity_compiles() -> None:
    """Against names of Unity's that stand in `clients`: there is no Unity here."""
    sources = ("unity/WrinkleDriver.cs", "unity/WrinkleMaps.cs", "UnityNames.cs")
    assert compiled("unity.dll", *sources).stat().st_size > 10_000


def test_drivers_are_short() -> None:
    for path in (*FILE.parent.rglob("*.cs"), *FILE.parent.rglob("*.gd")):
        assert len(path.read_text().splitlines()) < 400, path.name


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wrinkle", "joints", "clips", "numbers", "driver", "driver_godot4", "maps_godot4"])
def test_godot_4_can_parse_the_driver(name: str) -> None:
    """By its grammar; there is no Godot 4 here to run it."""
    need("gdtoolkit")
    from gdtoolkit.parser import parser

    parser.parse((GODOT / f"{name}.gd").read_text())
    with pytest.raises(Exception, match="Unexpected token"):
        parser.parse((GODOT / "driver_godot3.gd").read_text())
