"""What commands write: never over what they read, all of it or nothing, and as it should be found."""

import itertools
import json
import os
import re
import stat
from pathlib import Path
from typing import Any

import click
import pytest

import wrinklecli
from kit.command import Wrinkle, files
from kit.limb import limb_asset, tool, write_tools
from kit.variants import PNG
from wrinklecli.cli import cli

# Commands, and what the name of their output ends in.
WRITING = {
    "bake": ("bake limb.gltf tools.yaml -o {}", ".glb"),
    "bake .gltf": ("bake limb.gltf tools.yaml -o {}", ".gltf"),
    "report": ("bake limb.gltf tools.yaml -o out.glb --report {}", ".json"),
    "timings": ("bake limb.gltf tools.yaml -o out.glb --timings {}", ".json"),
    "depfile": ("bake limb.gltf tools.yaml -o out.glb --depfile {}", ".d"),
    "suggest": ("suggest limb.gltf --all --force -o {}", ".yaml"),
    "check": ("check limb.gltf tools.yaml --plot {}", ".svg"),
    "preview": ("preview limb.gltf --tools tools.yaml -o {} --rest --size 32x32", ".png"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An asset of three files, and tools."""
    asset = limb_asset(rings=7, sides=6)
    asset.gltf["images"] = [{"uri": "skin.png"}]
    asset.write(tmp_path / "limb.gltf")
    (tmp_path / "skin.png").write_bytes(PNG)
    small_tools(tmp_path)
    return tmp_path


def small_tools(folder: Path, **keys: int) -> Path:
    return write_tools(folder / "tools.yaml", tool(bumps=1) | keys, refinement={"max_levels": 0}, sampling={"fps": 4})


# Each option that writes, by command and parameter: a command that also has every option that reads, what the name of
# its output ends in, and the files that it reads besides those that the assets refer to.
BAKE = "bake limb.gltf tools.yaml --anim run.gltf"
CLIPS = ("limb.gltf", "run.gltf")
TOOLS = (*CLIPS, "tools.yaml", "studio.yaml")
KEPT_APART = {
    ("bake", "output"): (BAKE + " -o {}.glb", TOOLS),
    ("bake", "output, as .gltf"): (BAKE + " -o {}.gltf", TOOLS),
    ("bake", "report"): (BAKE + " -o out.glb --report {}", TOOLS),
    ("bake", "timings"): (BAKE + " -o out.glb --timings {}", TOOLS),
    ("bake", "depfile"): (BAKE + " -o out.glb --depfile {}", TOOLS),
    ("bake", "frames_dir"): (BAKE + " --clip fold --frames-dir {}", TOOLS),
    ("bake", "maps_dir"): (BAKE + " -o out.glb --maps-dir {}", TOOLS),
    ("suggest", "output"): (
        "suggest limb.gltf --all --anim run.gltf --presets studio.yaml -o {}",
        (*CLIPS, "studio.yaml"),
    ),
    ("check", "plot"): ("check limb.gltf tools.yaml --anim run.gltf --plot {}.svg", TOOLS),
    ("preview", "output"): (
        "preview limb.gltf --tools tools.yaml --anim run.gltf -o {}.png --rest --size 32x32",
        TOOLS,
    ),
    ("preview", "output, of two assets"): ("preview limb.gltf run.gltf -o {}.png --rest --size 32x32", CLIPS),
    ("maps", "folder, of maps"): ("maps limb.gltf tools.yaml --anim run.gltf -o {}", TOOLS),
    ("maps", "unwrap"): ("maps limb.gltf tools.yaml --anim run.gltf -o maps --size 64 --unwrap {}.glb", TOOLS),
    ("track", "folder"): ("track baked.gltf limb.gltf run.gltf -o {}", (*CLIPS, "baked.gltf")),
}
# The other options that write: a test below has that of `schema`, `tests/batching/test_conflicts.py` those of `batch`.
# Files of a cache have digests for names.
OF_BATCH = {("batch", "out"), ("batch", "report"), ("batch", "junit"), ("batch", "cache")}
APART = {("schema", "output"), ("bake", "cache"), *OF_BATCH}
READ_ONLY = {"asset", "assets", "tools", "anims", "baked", "manifest", "a", "b", "presets"}


def test_every_option_that_writes_is_in_the_table() -> None:
    paths = {
        (name, str(each.name))
        for name, command in cli.commands.items()
        for each in command.params
        if isinstance(each.type, click.Path) and each.name not in READ_ONLY
    }
    assert paths == {(command, name.partition(",")[0]) for command, name in KEPT_APART} | APART


@pytest.fixture
def read(folder: Path) -> Path:
    """Two assets that refer to other files, tools, and a file of presets that these name."""
    limb_asset(rings=7, sides=6).write(folder / "run.gltf")
    (folder / "studio.yaml").write_text("felt: {material: cloth}\n")
    header: Any = {"presets": "studio.yaml", "refinement": {"max_levels": 0}, "sampling": {"fps": 4}}
    write_tools(folder / "tools.yaml", tool(bumps=1), **header)
    return folder


@pytest.mark.quick(1, 4)
@pytest.mark.parametrize(("command", "option"), KEPT_APART)
def test_no_option_writes_over_what_another_reads(command: str, option: str, read: Path, wrinkle: Wrinkle) -> None:
    line, named = KEPT_APART[command, option]
    if command == "track":
        wrinklecli.bake(read / "limb.gltf", read / "tools.yaml", read / "baked.gltf")
    ending = re.findall(r"{}(\.\w+)?", line)[0]
    inputs = [*named, *(name for name in files(read) if name.endswith((".bin", ".png")))]
    (read / "here").symlink_to(".")
    # A folder of outputs gets the files of an earlier run, which are links here.
    own = {
        "frames_dir": "fold_0001.obj",
        "folder": "run.gltf",
        "folder, of maps": "maps.json",
        "maps_dir": "maps.json",
    }.get(option)
    for number, (each, kind) in enumerate(itertools.product(inputs, ("itself", "link", "hard link", "folder link"))):
        output = f"{number}{ending}"
        if own is not None:
            (read / f"to{number}").mkdir()
            output, shown = f"to{number}", f"to{number}/{own}"
            made = read / shown
        else:
            shown, made = output, read / output
        if kind in ("itself", "folder link"):
            if own is not None or not each.endswith(ending):
                continue
            output = shown = each if kind == "itself" else f"here/{each}"
        elif kind == "link":
            made.symlink_to(read / each)
        else:
            os.link(read / each, made)
        before = files(read)
        words = line.replace(f"{{}}{ending}", "{}").format(output).split()
        ran = wrinkle(*words)
        said = [text for text in ran.lines if not text.startswith("warning: ")]
        assert (ran.code, ran.out, said) == (1, "", [f"{shown}: is an input too and would be overwritten"]), (
            each,
            kind,
        )
        assert files(read) == before


@pytest.mark.parametrize("name", ["tools.yaml", "studio.yaml"])
def test_a_tools_file_is_not_overwritten_by_its_json(name: str, read: Path, wrinkle: Wrinkle) -> None:
    before = files(read)
    ran = wrinkle("schema", "--read", "tools.yaml", "-o", name)
    assert (ran.code, ran.out, ran.lines) == (1, "", [f"{name}: is an input too and would be overwritten"])
    assert files(read) == before


def test_a_track_that_cannot_be_written_leaves_none(folder: Path, wrinkle: Wrinkle) -> None:
    wrinklecli.bake(folder / "limb.gltf", folder / "tools.yaml", folder / "baked.glb")
    limb_asset(rings=7, sides=6).write(folder / "other.glb")
    (folder / "tracked" / "other.glb").mkdir(parents=True)
    before = files(folder)
    ran = wrinkle("track", "baked.glb", "limb.gltf", "other.glb", "-o", "tracked")
    assert (ran.code, ran.lines) == (1, ["tracked/other.glb: cannot be written: Is a directory"])
    assert files(folder) == before


@pytest.mark.parametrize("options", ["--report r --timings r", "--depfile out.glb", "--report ./r --depfile sub/../r"])
def test_each_output_has_a_name_of_its_own(options: str, folder: Path, wrinkle: Wrinkle) -> None:
    (folder / "sub").mkdir()
    before = files(folder)
    ran = wrinkle("bake", "limb.gltf", "tools.yaml", "-o", "out.glb", *options.split())
    assert ran.code == 1
    assert len(ran.lines) == 1
    assert ran.lines[0].endswith(": is another output too: each needs a name of its own")
    assert files(folder) == before


@pytest.mark.slow
@pytest.mark.parametrize("uri", ["d/x=\nall:;touch${IFS}PWNED;", "x;touch PWNED", "SHELL=x;"])
def test_a_name_that_would_be_a_command_in_a_makefile_is_refused(uri: str, folder: Path, wrinkle: Wrinkle) -> None:
    (folder / "d").mkdir()
    (folder / "limb.bin").rename(folder / uri)
    asset = json.loads((folder / "limb.gltf").read_text())
    asset["buffers"][0]["uri"] = uri
    (folder / "limb.gltf").write_text(json.dumps(asset))
    before = files(folder)
    ran = wrinkle("bake", "limb.gltf", "tools.yaml", "-o", "out.glb", "--depfile", "out.d")
    assert (ran.code, len(ran.lines)) == (1, 1)
    assert "is a name that Make or Ninja cannot read" in ran.lines[0]
    assert files(folder) == before
    assert wrinkle("bake", "limb.gltf", "tools.yaml", "-o", "out.glb").code == 0


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", WRITING)
def test_an_output_that_is_there_keeps_its_mode(name: str, folder: Path, wrinkle: Wrinkle) -> None:
    command, ending = WRITING[name]
    output = folder / f"new{ending}"
    output.write_text("old")
    output.chmod(0o600)
    assert wrinkle(*command.format(output.name).split()).code == 0
    assert stat.S_IMODE(output.stat().st_mode) == 0o600
    assert output.read_bytes() != b"old"


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", WRITING)
def test_what_is_a_device_stays_one(name: str, folder: Path, wrinkle: Wrinkle) -> None:
    command, ending = WRITING[name]
    (folder / f"null{ending}").symlink_to("/dev/null")
    assert wrinkle(*command.format(f"null{ending}").split()).code == 0
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert not list(folder.glob(".wrinkle-*"))


@pytest.mark.quick(6)
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
@pytest.mark.parametrize(
    "command",
    [
        "bake {} tools.yaml -o out.glb",
        "bake limb.gltf {} -o out.glb",
        "inspect {}",
        "check limb.gltf {}",
        "suggest {}",
        "preview {} -o new.png",
        "track {} limb.gltf -o tracked",
        "diff limb.gltf {}",
    ],
)
def test_an_input_that_is_no_file_is_refused_at_once(command: str, kind: str, folder: Path, wrinkle: Wrinkle) -> None:
    os.mkfifo(folder / "pipe")
    (folder / "device").symlink_to("/dev/zero")
    (folder / "folder").mkdir()
    before = files(folder)
    ran = wrinkle(*command.format(kind).split())
    reason = "Is a directory" if kind == "folder" else "not a regular file"
    assert (ran.code, ran.lines) == (2 if "diff" in command else 1, [f"{kind}: cannot be read: {reason}"])
    assert files(folder) == before


# Files beside a .gltf


def buffers(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("out-*.bin")}


@pytest.mark.slow
def test_the_buffer_of_an_earlier_bake_goes(folder: Path) -> None:
    def bake(bumps: int) -> set[str]:
        wrinklecli.bake(folder / "limb.gltf", small_tools(folder, bumps=bumps), folder / "out.gltf")
        named = {each["uri"] for each in json.loads((folder / "out.gltf").read_text())["buffers"]}
        assert named - {"limb.bin"} == buffers(folder)
        return named

    first = bake(1)
    assert bake(2) != first
    assert bake(1) == first
    assert bake(1) == first
    assert (folder / "limb.bin").exists()


def test_a_buffer_that_is_not_surely_ours_stays(folder: Path) -> None:
    """It is an input, has another content, lies elsewhere, has another name, or the JSON does not name it."""
    wrinklecli.bake(folder / "limb.gltf", small_tools(folder), folder / "out.gltf")
    (old,) = buffers(folder)
    text = (folder / "out.gltf").read_text()
    content = (folder / old).read_bytes()
    (folder / "sub").mkdir()
    others = [old.replace("out-", "in-"), f"sub/{old}", re.sub("[0-9a-f]{12}", "0" * 12, old)]
    for name in others:
        (folder / name).write_bytes(content)
        text = text.replace('"buffers": [', f'"buffers": [{{"uri": "{name}"}},')
    (folder / "out.gltf").write_text(text)
    wrinklecli.bake(folder / "limb.gltf", small_tools(folder, bumps=2), folder / "out.gltf")
    assert all((folder / name).exists() for name in others)
    assert not (folder / old).exists()


def test_the_buffer_of_an_earlier_bake_that_is_an_input_stays(folder: Path) -> None:
    wrinklecli.bake(folder / "limb.gltf", small_tools(folder), folder / "out.gltf")
    (old,) = buffers(folder)
    (folder / "again.gltf").write_bytes((folder / "out.gltf").read_bytes())
    wrinklecli.bake(folder / "again.gltf", small_tools(folder, bumps=2), folder / "out.gltf", replace=True)
    assert (folder / old).exists()
    assert len(buffers(folder)) == 2
