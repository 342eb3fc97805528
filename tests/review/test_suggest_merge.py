"""`wrinkle suggest` and a tools file that is there already: it is kept, written over or merged, as asked."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
import pytest

from kit.limb import limb
from kit.suggested import each_once, run
from wrinklecli.errors import WrinkleError
from wrinklecli.review.suggest.merged import merged
from wrinklecli.tools.read import parse_tools

FOUND = """# Tools
version: 1

defaults:
  rest_length: 95%
  max_height: auto

tools:
  # Joint a: shortens by 30 %
  # skin, by its colour
  - name: arm.L
    origin: [0.1, 0.2, 0.3]
    target: [0.1, 0.4, 0.3]
    mirror: x
    width: 0.1

  # Joint b
  - name: neck
    node: "body"
    path: [[0, 1, 0], [0, 2, 0.1], [0, 3, 0]]
    width: 0.2
"""


@pytest.fixture(scope="module", autouse=True)
def _once() -> Iterator[None]:
    with each_once():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a limb and the tools that are suggested for it."""
    folder = tmp_path_factory.mktemp("suggested")
    limb(folder / "limb.glb", rings=12, sides=8)
    assert run(folder / "limb.glb", "--all", "-o", folder / "tools.yaml").exit_code == 0
    return folder


@pytest.mark.slow
def test_a_file_that_is_there_is_not_written_over(folder: Path, tmp_path: Path) -> None:
    made, edited = (folder / "tools.yaml").read_text(), tmp_path / "tools.yaml"
    edited.write_text("# mine\n" + made)
    refused = run(folder / "limb.glb", "--all", "-o", edited)
    assert isinstance(refused.exception, WrinkleError)
    assert str(refused.exception) == (
        f"{edited}: is there already; --merge adds what it does not have, --force writes over it"
    )
    assert edited.read_text() == "# mine\n" + made
    assert run(folder / "limb.glb", "--all", "--force", "-o", edited).exit_code == 0
    assert edited.read_text() == made


@pytest.mark.slow
@pytest.mark.parametrize("content", [None, ""])
def test_a_file_without_content_is_written(folder: Path, tmp_path: Path, content: str | None) -> None:
    """An empty file, as `mktemp` makes it, is written, and so is one that is merged into nothing."""
    for arguments in ([], ["--merge"]):
        out = tmp_path / f"tools{len(arguments)}.yaml"
        if content is not None:
            out.write_text(content)
        assert run(folder / "limb.glb", "--all", *arguments, "-o", out).exit_code == 0
        assert out.read_text() == (folder / "tools.yaml").read_text()


def test_merging_again_changes_nothing_and_adds_what_was_deleted(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "tools.yaml"
    edited = (folder / "tools.yaml").read_text().replace("bumps: ", "bumps:  1  # was ", 1)
    out.write_text(edited)
    again = run(folder / "limb.glb", "--all", "--merge", "-o", out)
    assert (again.exit_code, out.read_text()) == (0, edited)
    assert f"note: {out}: nothing is new" in again.stderr
    others = edited.replace("- name: ", "- name: my_")
    out.write_text(others)
    added = run(folder / "limb.glb", "--all", "--merge", "-o", out)
    assert added.exit_code == 0
    assert f"note: {out}: 1 tool added" in added.stderr
    assert out.read_text().startswith(others)
    (wanted,), (_, found) = (parse_tools(text).tools for text in ((folder / "tools.yaml").read_text(), out.read_text()))
    assert replace(found, where="", places={}) == replace(wanted, where="", places={})


def test_wrong_options_and_files_are_refused_before_the_work(folder: Path, tmp_path: Path) -> None:
    for arguments in (["--merge"], ["--merge", "-o", "-"], ["--merge", "--force", "-o", tmp_path / "new.yaml"]):
        assert isinstance(run(tmp_path / "none.glb", *arguments).exception, SystemExit | click.UsageError)
    (tmp_path / "bad.yaml").write_text("version: 1\ntools: [{name: a}]\n")
    refused = run(folder / "limb.glb", "--merge", "-o", tmp_path / "bad.yaml")
    assert isinstance(refused.exception, WrinkleError)
    assert "bad.yaml:2: tools[0]" in str(refused.exception)


def test_what_is_added_means_the_same_in_the_other_file() -> None:
    """Its axes, defaults and names are those of the file, and the comments come along."""
    mine = """version: 1
up: z
defaults: {mirror: x, width: 1, bumps: 7}
tools:
  - name: own   # mine
    origin: [0, 0, 0]
    target: [1, 0, 0]
    mirror: none
"""
    made = merged("tools.yaml", mine, FOUND)
    assert made.text.startswith(mine)
    assert made.added == {"tools": 2}
    by_name = {each.name: each for each in parse_tools(made.text).tools}
    wanted = {each.name: each for each in parse_tools(FOUND).tools}
    assert set(by_name) == {"own", *wanted}
    for name, each in wanted.items():
        found = by_name[name]
        assert (found.points, found.width, found.rest_length) == (each.points, each.width, each.rest_length)
        assert found.bumps == 7
    assert "# Joint a: shortens by 30 %\n" in made.text
    assert merged("tools.yaml", made.text, FOUND).text == made.text


@pytest.mark.parametrize(
    ("list_key", "entry"),
    [
        ("muscles", 'm\n    origin: {joint: "a", offset: [1, 2, 3]}\n    insertion: {joint: "b", offset: [0, 1, 0]}'),
        ("flesh", "m\n    at: [1, 2, 3]\n    radius: 0.1"),
        ("touches", "m\n    at: [1, 2, 3]\n    towards: [1, 3, 3]\n    pad: 0.01\n    reach: 0.01"),
    ],
)
@pytest.mark.parametrize("up", ["y", "z"])
def test_effects_of_other_lists_are_added(list_key: str, entry: str, up: str) -> None:
    mine = f"version: 1\nup: {up}\ntools:\n- {{name: a, origin: [0, 0, 0], target: [1, 0, 0], width: 1}}\n"
    found = f"version: 1\n\n{list_key}:\n  - name: {entry}\n"
    made = merged("tools.yaml", mine, found)
    (tool, added), (wanted,) = (parse_tools(text).effects for text in (made.text, found))
    assert (tool.section, added.section, wanted.section) == ("tools", list_key, list_key)
    for key in ("origin", "insertion", "at", "towards"):
        assert getattr(added, key, None) == getattr(wanted, key, None)


@pytest.mark.parametrize("tools", ["tools:\n", "tools: []\n", ""])
def test_a_file_whose_tools_are_all_gone_gets_them(tools: str) -> None:
    made = merged("tools.yaml", f"# mine\nversion: 1\n{tools}", FOUND)
    assert made.text.startswith("# mine\nversion: 1\n")
    assert [each.name for each in parse_tools(made.text).tools] == ["arm.L", "arm.R", "neck"]


def test_a_name_that_another_node_s_tool_has_gets_a_number() -> None:
    mine = FOUND.replace('"body"', '"head"').replace("arm.L", "arm.R")
    made = merged("tools.yaml", mine, FOUND)
    assert [each.name for each in parse_tools(made.text).tools if each.node == "body"] == ["neck_1"]
    assert "name: arm.L" not in made.text, "mirror makes it of arm.R"


def test_files_of_presets_are_named_too(tmp_path: Path) -> None:
    mine = "version: 1\npresets: a.yaml\ntools: [{name: a, origin: [0, 0, 0], target: [1, 0, 0], width: 1}]\n"
    found = FOUND.replace("defaults:", "presets: [b.yaml]\n\ndefaults:")
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text(f"{name}: {{material: skin}}\n")
    made = merged(str(tmp_path / "tools.yaml"), mine, found)
    assert "\npresets: [a.yaml, b.yaml]\n" in made.text
    with pytest.raises(WrinkleError, match="presets of its own"):
        merged("tools.yaml", mine.replace("a.yaml", "{b: {material: skin}}"), found)
