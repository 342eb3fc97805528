"""Options read values from words; no command runs here."""

from collections.abc import Sequence
from typing import Any

import click
import pytest

from wrinklecli.cli import cli
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
        (BAKE, "max_memory", 1_000_000_000),
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
        ["track", "a.glb", "b.glb", "-o", "d", "--max-error", "0.390625%"],
        ["track", "a.glb", "b.glb", "-o", "d", "--max-error", "1"],
        ["suggest", "a.glb", "--count", "501"],
    ],
)
def test_an_option_is_refused(arguments: Sequence[str]) -> None:
    with pytest.raises(click.UsageError):
        read(arguments)
