"""What small files may ask of every command: memory is refused before it is taken, and a line says how to get more."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from kit import bombs, hostile
from kit.asset import read_glb
from kit.bakes import folding_limb
from kit.command import Wrinkle, files
from kit.limb import limb, tool, write_tools
from kit.work import PATIENCE
from wrinklecli import bake
from wrinklecli.errors import BakeError
from wrinklecli.review.inspect import inspect

MEMORY = "300MB"
# What a command may grow by: what it may claim, and what comes and goes beside that.
MEGABYTES, SECONDS = 500.0, 10.0
COMMANDS = {
    "bake": ["bake", "{}", "tools.yaml", "-o", "out.glb"],
    "replace": ["bake", "{}", "tools.yaml", "--replace", "-o", "out.glb"],
    "preview": ["preview", "{}", "-o", "out.png", "--size", "64x64"],
    "diff": ["diff", "{}", "limb.glb"],
    "inspect": ["inspect", "{}"],
    "check": ["check", "{}", "tools.yaml"],
    "suggest": ["suggest", "{}"],
    "track": ["track", "{}", "limb.glb", "-o", "tracked"],
}
# These look at no geometry that a bomb hides, or refuse it for what it is before they come to that.
UNTOUCHED = {
    "inspect": {*bombs.BOMBS} - {"values", "hole"},
    "track": {*bombs.BOMBS} - {"values", "hole"},
    "bake": {"record"},
    "check": {"record"},
    "suggest": {"record", "overlapping"},
    "preview": {"record"},
    "diff": {"record"},
}


@pytest.mark.quick(5, 12)
@pytest.mark.parametrize("name", bombs.BOMBS)
@pytest.mark.parametrize("command", COMMANDS)
def test_bomb_is_refused_before_it_goes_off(wrinkle: Wrinkle, tmp_path: Path, command: str, name: str) -> None:
    bomb = bombs.BOMBS[name](tmp_path)
    limb(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml", tool())
    before = set(files(tmp_path)) if name != "hole" else set()
    arguments = [each.format(bomb.name) for each in COMMANDS[command]]
    with hostile.bounded(seconds=SECONDS, megabytes=MEGABYTES):
        ran = wrinkle(*arguments, "--max-memory", MEMORY)
    assert ran.code in ((0, 1, 2) if command == "diff" else (0, 1))
    if name not in UNTOUCHED.get(command, set()):
        (line,) = ran.lines
        assert ran.code, line
        assert line.startswith(bomb.name)
        assert re.search(r"(would take \d.* [GM]B\b.*: raise|or than) --max-memory", line), line
    if name != "hole":
        assert ran.code == 0 or set(files(tmp_path)) == before


@pytest.mark.parametrize("size", ["", "1", "1GiB", "-1GB", "0GB", "10MB", "nan", "1e9GB", "9999999GB"])
def test_size_that_is_none_is_wrong_usage(wrinkle: Wrinkle, tmp_path: Path, size: str) -> None:
    ran = wrinkle("inspect", limb(tmp_path / "limb.glb"), "--max-memory", size)
    assert ran.code == 2
    assert "such as 500MB or 4GB" in ran.lines[-1]


@pytest.mark.slow
def test_more_memory_is_given_to_those_who_ask(wrinkle: Wrinkle, tmp_path: Path) -> None:
    path = bombs.values(tmp_path, 1_000_000)
    assert wrinkle("inspect", path, "--max-memory", "100MB").code == 1
    assert wrinkle("inspect", path).code == 0


@pytest.mark.slow
def test_a_file_of_many_buffers_is_read_once(tmp_path: Path) -> None:
    path = bombs.many_buffers(tmp_path)
    with hostile.bounded(seconds=5.0, megabytes=100.0):
        found = inspect(path)
    assert [each["name"] for each in found["files"]] == [str(path), str(path.with_suffix(".bin"))]


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_many_buffers_of_one_file_do_not_become_a_flood(tmp_path: Path, ending: str) -> None:
    path = bombs.many_buffers(tmp_path)
    tools, out = write_tools(tmp_path / "tools.yaml", tool()), tmp_path / f"out.{ending}"
    with hostile.bounded(seconds=10.0, megabytes=100.0), pytest.raises(Exception, match="raise --max-memory"):
        bake(path, tools, out)
    assert not out.exists()


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_an_image_of_many_names_is_read_and_written_once(tmp_path: Path, ending: str) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    path = bombs.many_images(tmp_path / "in")
    tools, out = write_tools(tmp_path / "tools.yaml", tool()), tmp_path / "out" / f"out.{ending}"
    with hostile.bounded(seconds=5.0, megabytes=100.0):
        bake(path, tools, out)
    assert sum(len(each) for each in files(tmp_path / "out").values()) < 3 * 10**6
    if ending == "glb":
        gltf, _ = read_glb(out.read_bytes())
        assert len({image["bufferView"] for image in gltf["images"]}) == 1


def test_new_vertices_are_bounded(tmp_path: Path) -> None:
    path, out = limb(tmp_path / "limb.glb"), tmp_path / "out.glb"
    tools = write_tools(tmp_path / "tools.yaml", tool(), refinement={"max_levels": 8, "edges_per_interval": 16})
    with pytest.raises(BakeError, match=r"^limb: would have [\d,]+ new vertices at level \d.* raise --max-vertices$"):
        bake(path, tools, out, max_vertices=500)
    assert not out.exists()


def test_images_that_are_too_large_to_compare_are_not_said_to_be_the_same(wrinkle: Wrinkle, tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        bombs.many_images(tmp_path / name, count=1 if name == "a" else 2)
        os.truncate(tmp_path / name / "image.png", 3 * 10**9)
    ran = wrinkle("diff", "a/images.gltf", "b/images.gltf", "--max-memory", "1GB")
    assert ran.code == 2
    assert "raise --max-memory" in ran.lines[-1]


# Embree alone takes 270 MB.
@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("command", "rings", "memory", "what"),
    [("suggest", 80, "50MB", "to measure"), ("preview", 500, "400MB", "to draw")],
)
def test_triangles_are_counted_before_they_are_looked_at(
    wrinkle: Wrinkle, tmp_path: Path, command: str, rings: int, memory: str, what: str
) -> None:
    limb(tmp_path / "limb.glb", rings=rings, sides=300, indices="u4")
    with hostile.bounded(seconds=SECONDS, megabytes=MEGABYTES):
        ran = wrinkle(command, "limb.glb", "-o", "out.png", "--max-memory", memory)
    assert ran.code == 1
    (line,) = ran.lines
    assert re.fullmatch(rf"limb.glb: \d+,\d+ triangles {what} would take [\d.]+ MB.*: raise --max-memory", line), line
    assert not (tmp_path / "out.png").exists()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("memory", ["50MB", "80MB", "95MB"])
@pytest.mark.parametrize("effect", ["flesh", "contact"])
def test_solvers_with_little_memory_end_in_a_line(tmp_path: Path, memory: str, effect: str) -> None:
    """Without its buffer the BLAS of SciPy would ask for it for ever; others end the process."""
    flesh = {"name": "belly", "at": [0.3, 0.1, 0.0], "radius": 0.4, "frequency": 3, "shapes": 3}
    if effect == "flesh":
        asset = limb(tmp_path / "limb.glb")
        text = {"version": 1, "flesh": [flesh]}
    else:
        asset = folding_limb()
        text = {"version": 1, "tools": [tool(contact="resolve")]}
    (tmp_path / "tools.yaml").write_text(json.dumps(text))
    command = [sys.executable, "-c", "from wrinklecli.cli import main; main()", "bake", str(asset), "tools.yaml"]
    ran = subprocess.run(
        [*command, "-o", "out.glb", "--max-memory", memory, "-q", "-j", "1"],
        cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert ran.returncode in (0, 1), ran.stderr
    if ran.returncode:
        (line,) = ran.stderr.splitlines()
        size = r"\([\d.]+ MB\): \w+ \(\S+\.py:\d+\) needs .*more"
        assert re.fullmatch(
            rf"{re.escape(str(asset))}: takes more memory than there is, or than --max-memory allows {size}", line
        )


@pytest.mark.slow
@pytest.mark.long
def test_a_thousand_tools_off_the_mesh_are_a_screen_of_lines(wrinkle: Wrinkle, tmp_path: Path) -> None:
    limb(tmp_path / "limb.glb", rings=5, sides=4)
    far = [tool(name=f"t{number}", origin=[-0.5, 9.0 + number, 0.0]) for number in range(1000)]
    write_tools(tmp_path / "tools.yaml", *far)
    ran = wrinkle("bake", "limb.glb", "tools.yaml", "-o", "out.glb")
    assert (ran.code, len(ran.lines), ran.lines[-1]) == (1, 51, "and 950 more")
