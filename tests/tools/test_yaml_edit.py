"""Edits of a tools file's text: what they do not touch keeps every byte, and what they do reads as it was meant."""

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.places import ROOT
from wrinklecli.errors import ConfigError
from wrinklecli.tools.yaml_edit import ToolsText, written
from wrinklecli.tools.yaml_tree import read_tree

FILE = ToolsText(
    """\
# A file as people write them.
version: 1
defaults: { mirror:  x }    # both sides

tools:
  # The left knee.
  - name: "knee.L"   # quoted
    origin: [ 0.10, 0.6 , 0.1 ]
    target: [0.1, 0.4, 0.1]
    width: &wide 0.24        # metres
    clips:
      walk: 0.8  # flatter
      'my run': 1

  - {name: elbow.L, origin: [1, 2, 3], target: [1, 2, 4], width: *wide}   # in one line
  # The last one.
  -
    name: hip.L
    origin: [1, 2, 3]
    target: [1, 2, 4]
    width: *wide
"""
)


def test_one_value_changes_and_all_else_stays() -> None:
    assert FILE.with_value(0, ("clips", "walk"), 0.5).text == FILE.text.replace("walk: 0.8", "walk: 0.5")
    assert FILE.with_value(0, ("clips", "my run"), 2).text == FILE.text.replace("'my run': 1", "'my run': 2")
    assert FILE.with_value(2, ("target",), [1.5, 2, 4]).text == FILE.text[:-40].replace("x", "x") + FILE.text[
        -40:
    ].replace("target: [1, 2, 4]", "target: [1.5, 2, 4]")
    assert FILE.with_value(0, ("bumps",), 5).text == FILE.text.replace("run': 1\n", "run': 1\n    bumps: 5\n")
    assert FILE.with_value(1, ("bumps",), 5).text == FILE.text.replace("*wide}", "*wide, bumps: 5}")
    assert FILE.without(0, ("clips",)).text == FILE.text.replace(
        "    clips:\n      walk: 0.8  # flatter\n      'my run': 1\n", ""
    )


def test_what_others_repeat_stays_theirs() -> None:
    changed = FILE.with_value(0, ("width",), 0.3)
    assert [each["width"] for each in changed.tools] == [0.3, 0.24, 0.24]
    assert "width: 0.3        # metres" in changed.text
    assert "width: &wide 0.24}   # in one line" in changed.text
    gone = FILE.without_tool(0)
    assert [(each["name"], each["width"]) for each in gone.tools] == [("elbow.L", 0.24), ("hip.L", 0.24)]
    assert "The left knee" not in gone.text
    assert "The last one" in gone.text
    assert [each["width"] for each in FILE.with_copy(0, "shin.L").tools] == [0.24] * 4


def test_a_part_of_what_is_repeated_or_merged_is_changed_in_one_tool_alone() -> None:
    file = ToolsText(
        "version: 1\ntools:\n  - {name: a, clips: &c {walk: 1, run: 2}, path: &p [[0, 0, 0], [1, 1, 1]]}\n"
        "  - {name: b, clips: *c, path: *p}\n  - &m\n    name: d\n    clips: {on: 3}\n  - <<: *m\n    name: e\n"
    )
    assert file.with_value(1, ("clips", "run"), 5).tools[1]["clips"] == {"walk": 1, "run": 5}
    assert file.with_value(1, ("path", 1), [2, 2, 2]).tools[1]["path"] == [[0, 0, 0], [2, 2, 2]]
    assert file.with_value(3, ("clips", "run"), 5).tools[3]["clips"] == {"on": 3, "run": 5}
    assert file.with_value(0, ("path", 0), [3, 3, 3]).tools[1]["path"][0] == [0, 0, 0]


def test_lines_end_as_they_did() -> None:
    file = ToolsText(FILE.text.replace("\n", "\r\n"))
    for changed in (file.without(0, ("clips",)), file.without_tool(2), file.without(2, ("width",))):
        assert "\n" not in changed.text.replace("\r\n", "")


@pytest.mark.parametrize("text", ["version: 1\ntools: []   # none\n", "version: 1\ntools:   # none\n", "version: 1\n"])
def test_the_first_tool_comes_and_the_last_goes(text: str) -> None:
    one = ToolsText(text).with_tool({"name": "a", "origin": [1.0, 2, 3], "width": "80%"})
    assert one.tools == ({"name": "a", "origin": [1.0, 2, 3], "width": "80%"},)
    assert one.without_tool(0).tools == ()


def test_a_tool_that_is_an_alias_is_not_edited() -> None:
    with pytest.raises(ConfigError, match="write it out"):
        ToolsText("version: 1\ntools: [&a {name: a}, *a]\n").with_value(1, ("bumps",), 3)


VALUES = st.one_of(
    st.integers(0, 99),
    st.floats(-1e9, 1e9),
    st.booleans(),
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=9),
    st.lists(st.floats(0, 1), max_size=3),
    st.dictionaries(st.sampled_from(["walk", "my run", "on", "1"]), st.floats(0, 1), max_size=2),
)
EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("with_value"), st.sampled_from(["bumps", "width", "clips", "lag"]), VALUES),
        st.tuples(st.just("without"), st.sampled_from(["width", "clips", "origin", "bumps"])),
        st.tuples(st.just("with_copy"), st.sampled_from(["a", "b", "c d", "e"])),
        st.tuples(st.just("without_tool")),
        st.tuples(st.just("with_tool"), st.dictionaries(st.sampled_from(["name", "bumps"]), VALUES, min_size=1)),
    ),
    max_size=6,
)


@given(st.sampled_from(["mine", "trousers", "head_keyed"]), EDITS, st.data(), st.booleans())
def test_edits_do_what_they_say_and_nothing_else(name: str, edits: list[Any], data: st.DataObject, crlf: bool) -> None:
    text = FILE.text if name == "mine" else (ROOT / "configs" / f"{name}.yaml").read_text()
    file = ToolsText(text.replace("\n", "\r\n") if crlf else text)
    expected = [dict(each) for each in file.tools]
    for kind, *arguments in edits:
        number = data.draw(st.integers(0, len(expected) - 1)) if expected else 0
        if kind == "with_tool":
            file, expected = file.with_tool(arguments[0]), [*expected, arguments[0]]
            continue
        if not expected:
            continue
        if kind == "with_value":
            file = file.with_value(number, arguments[:1], arguments[1])
            expected[number] = expected[number] | {arguments[0]: arguments[1]}
        elif kind == "without":
            try:
                file = file.without(number, arguments)
            except ConfigError as error:
                assert "by an alias" in str(error)  # noqa: PT017
                continue
            expected[number] = {key: each for key, each in expected[number].items() if key != arguments[0]}
        elif kind == "with_copy":
            file = file.with_copy(number, arguments[0])
            expected.insert(number + 1, expected[number] | {"name": arguments[0]})
        else:
            file = file.without_tool(number)
            del expected[number]
    assert [*map(dict, file.tools)] == expected
    assert crlf == ("\r\n" in file.text)
    assert not crlf or "\n" not in file.text.replace("\r\n", "")
    for line in text.splitlines():
        if line.startswith(("#", "version", "defaults")):
            assert line in file.text.splitlines()


@given(VALUES)
def test_a_value_is_read_as_it_was_written(value: Any) -> None:
    root, problems = read_tree(f"a: {written(value)}\n")
    assert not problems
    assert root is not None
    assert root.value == {"a": dict(value) if isinstance(value, Mapping) else value}
