"""`--json` prints one object alone, which begins with its version, and says as much as the lines do."""

import json
from pathlib import Path
from typing import Any

import pytest

from kit.command import Wrinkle, files
from kit.limb import limb_asset, tool, write_tools
from kit.small_maps import small_maps


@pytest.fixture
def limb(wrinkle: Wrinkle, tmp_path: Path) -> Wrinkle:
    """The command, in a folder with a limb, tools for it and its bake."""
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb")
    write_tools(tmp_path / "t.yaml", tool(bumps=1), refinement={"max_levels": 0}, sampling={"fps": 4})
    assert wrinkle("bake", "limb.glb", "t.yaml", "-o", "body.glb").code == 0
    return wrinkle


def printed(wrinkle: Wrinkle, *arguments: str) -> dict[str, Any]:
    """The object that a command prints, where it prints nothing else."""
    ran = wrinkle(*arguments, "--json")
    assert (ran.code, ran.lines) == (0, [])
    data = json.loads(ran.out)
    assert isinstance(data, dict)
    assert next(iter(data.items())) == ({"bake": "report"}.get(arguments[0], arguments[0]), 1)
    return data


def test_a_bake_prints_what_its_report_says(limb: Wrinkle) -> None:
    with small_maps(32):
        arguments = ("bake", "limb.glb", "t.yaml", "-o", "out.glb", "--maps-dir", "maps", "--report", "r.json")
        data = printed(limb, *arguments)
    assert data == json.loads(Path("r.json").read_text())
    assert data["clips"][0]["tools"], "frame by frame"
    assert data["maps"]["files"][0] == "maps/maps.json"
    assert len(files(Path("maps"))) == len(data["maps"]["files"])
    assert Path("out.glb").exists()


def test_other_commands_print_what_they_made(limb: Wrinkle) -> None:
    with small_maps(32):
        data = printed(limb, "maps", "limb.glb", "t.yaml", "-o", "maps", "--size", "32")
    assert [Path(each).exists() for each in data["files"]] == [True] * len(data["files"])
    assert len(data["files"]) > 1
    (file,) = printed(limb, "track", "body.glb", "limb.glb", "-o", "tracked")["files"]
    assert (file["path"], file["clips"], len(file["tools"])) == ("tracked/limb.glb", ["fold"], 1)
    data = printed(limb, "preview", "limb.glb", "-o", "p.png", "--size", "32x32", "--rest")
    assert (data["assets"], data["path"], data["views"]) == (["limb.glb"], "p.png", ["oblique"])
    assert Path("p.png").exists()
    for more in ([], ["--merge", "-v"]):
        data = printed(limb, "suggest", "limb.glb", "-o", "new.yaml", "--all", *more)
        assert [each["clip"] for each in data["tools"]] == ["fold"] * len(data["tools"])
        assert data["tools"]
    assert Path("new.yaml").exists()


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "arguments",
    [
        ("bake", "absent.glb", "t.yaml", "-o", "out.glb"),
        ("maps", "absent.glb", "t.yaml", "-o", "out"),
        ("track", "absent.glb", "limb.glb", "-o", "out"),
        ("preview", "absent.glb", "-o", "out.png"),
    ],
)
def test_a_failure_is_a_line_on_standard_error_alone(arguments: tuple[str, ...], limb: Wrinkle) -> None:
    before = files(Path())
    ran = limb(*arguments, "--json")
    assert (ran.code, ran.out) == (1, "")
    assert [line.partition(":")[0] for line in ran.lines] == ["absent.glb"]
    assert files(Path()) == before


def test_a_preview_that_draws_again_prints_no_object(wrinkle: Wrinkle) -> None:
    assert wrinkle("preview", "limb.glb", "-o", "p.png", "--watch", "--json").code == 2
