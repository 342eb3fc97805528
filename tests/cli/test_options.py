"""Options read values from words; no command runs here."""

import re
from collections.abc import Sequence
from typing import Any

import click
import pytest

from wrinklecli.cli import cli
from wrinklecli.numeric import memory
from wrinklecli.tools.records import Length

BAKE = ["bake", "a.glb", "t.yaml", "-o", "out.glb"]
PREVIEW = ["preview", "a.glb", "-o", "a.png"]
CHECK = ["check", "a.glb", "t.yaml"]


def read(arguments: Sequence[str]) -> dict[str, Any]:
    """The values that a command would get."""
    command, *rest = arguments
    with cli.commands[command].make_context(command, list(rest)) as context:
        return context.params


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        (BAKE, "max_error", Length(1, percent=True)),
        ([*BAKE, "--max-error", "0.5"], "max_error", Length(0.5)),
        ([*BAKE, "--fps", "0.1"], "fps", 0.1),
        ([*BAKE, "--fps", "1000"], "fps", 1000),
        (BAKE, "fps", None),
        ([*BAKE, "--max-levels", "0"], "max_levels", 0),
        ([*BAKE, "--max-levels", "8"], "max_levels", 8),
        (BAKE, "max_vertices", 200_000),
        ([*BAKE, "--max-vertices", "0"], "max_vertices", 0),
        (BAKE, "accessors", "sparse"),
        (BAKE, "tracks", "all"),
        (BAKE, "frames_format", "obj"),
        (BAKE, "engine", None),
        ([*BAKE, "--clip", "a", "--clip", "b"], "clips", ("a", "b")),
        ([*BAKE, "--tool", "a"], "only", ("a",)),
        ([*BAKE, "--anim", "walk.glb"], "anims", ("walk.glb",)),
        ([*CHECK, "--pose", "a:b=c=Y:-1.5"], "pose", (("a:b=c", "y", -1.5),)),
        ([*CHECK, "--morph", "a=b=.5", "--morph", "c=1"], "morphs", (("a=b", 0.5), ("c", 1.0))),
        (PREVIEW, "times", ()),
        ([*PREVIEW, "--times", "0,0.5"], "times", (0.0, 0.5)),
        ([*PREVIEW, "--focus", "0,0,0"], "focus", (0.0, 0.0, 0.0)),
        (PREVIEW, "focus", None),
        ([*PREVIEW, "--radius", "0.01"], "radius", 0.01),
        ([*PREVIEW, "--size", "16x16383"], "size", (16, 16383)),
        ([*PREVIEW, "--views", "front,facing,-30:45"], "views", ("front", "facing", "-30:45")),
        ([*PREVIEW, "--labels", "a,b c"], "labels", ("a", "b c")),
        (["diff", "a", "b"], "tolerance", Length(0.0001, percent=True)),
        (["diff", "a", "b"], "fps", 30),
        (["suggest", "a.glb"], "count", 8),
        (["track", "a.glb", "b.glb", "-o", "d"], "max_error", 0.01),
        (["edit", "a.glb"], "port", 8765),
        (["batch", "j.yaml"], "jobs", 1),
        (["batch", "j.yaml", "--fail-fast"], "keep_going", False),
    ],
)
def test_an_option_is_read(arguments: Sequence[str], key: str, value: object) -> None:
    assert read(arguments)[key] == value


@pytest.mark.parametrize(
    "arguments",
    [
        ["preview", "-o", "a.png"],
        [*PREVIEW, "--times", "0,x"],
        [*PREVIEW, "--times", "0,inf"],
        [*PREVIEW, "--focus", "0,0"],
        [*PREVIEW, "--focus", ""],
        [*PREVIEW, "--radius", "0"],
        [*PREVIEW, "--radius", "inf"],
        [*PREVIEW, "--size", "15x600"],
        [*PREVIEW, "--size", "600x16384"],
        [*PREVIEW, "--size", "600"],
        [*PREVIEW, "--views", "front,beneath"],
        [*PREVIEW, "--frames", "0"],
        [*CHECK, "--pose", "a=w:1"],
        [*CHECK, "--pose", "=x:1"],
        [*CHECK, "--morph", "a"],
        [*CHECK, "--morph", "a=1e3"],
        [*BAKE, "--fps", "1001"],
        [*BAKE, "--max-memory", "much"],
        ["track", "a.glb", "b.glb", "-o", "d", "--max-error", "0.048828125%"],
        ["track", "a.glb", "b.glb", "-o", "d", "--max-error", "1"],
        ["suggest", "a.glb", "--count", "501"],
    ],
)
def test_an_option_is_refused(arguments: Sequence[str]) -> None:
    with pytest.raises(click.UsageError):
        read(arguments)


def paths() -> list[tuple[str, str]]:
    """Every option and argument that is a path, with its command."""
    return [
        (name, each.name or "")
        for name, command in cli.commands.items()
        for each in command.params
        if isinstance(each.type, click.Path)
    ]


@pytest.mark.parametrize(("command", "name"), paths())
def test_an_empty_path_is_refused(command: str, name: str) -> None:
    (wanted,) = (each for each in cli.commands[command].params if each.name == name)
    option = [] if isinstance(wanted, click.Argument) else [wanted.opts[-1]]
    others = [each for each in cli.commands[command].params if each.required and each is not wanted]
    rest = [
        word for each in others for word in ([each.opts[-1], "x.glb"] if isinstance(each, click.Option) else ["x.glb"])
    ]
    before = rest[: list(cli.commands[command].params).index(wanted)] if not option else rest
    with pytest.raises(click.BadParameter, match="the path is empty"):
        read([command, *before, *option, "", *rest[len(before) :]])


def test_every_path_is_one() -> None:
    """Options that name a file or a folder, by their placeholders."""
    named = {
        (name, each.name)
        for name, command in cli.commands.items()
        for each in command.params
        if isinstance(each, click.Option) and re.search(r"FILE|DIR|PATH|OUT|TOOLS", str(each.metavar))
    }
    assert named <= set(paths())
    assert {("bake", "frames_dir"), ("batch", "cache"), ("batch", "out"), ("track", "folder")} <= named


@pytest.mark.parametrize(
    ("arguments", "most"),
    [
        (BAKE, 20 * 10**9),
        ([*BAKE, "--max-memory", "2GB"], 2 * 10**9),
        (["suggest", "a.glb"], 20 * 10**9),
        (["edit", "a.glb"], 20 * 10**9),
        (["edit", "a.glb", "--host", "127.0.0.2"], 20 * 10**9),
        (["edit", "a.glb", "--host", "0.0.0.0"], 10**9),
        (["edit", "a.glb", "--host", "studio.example"], 10**9),
        (["edit", "a.glb", "--host", "0.0.0.0", "--max-memory", "3GB"], 3 * 10**9),
    ],
)
def test_a_person_s_command_may_take_half_of_what_is_free_and_a_server_1_gb(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], most: int
) -> None:
    monkeypatch.setattr(memory, "available_memory", lambda: 40 * 10**9)
    assert read(arguments)["max_memory"] == most
