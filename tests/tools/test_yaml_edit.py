"""Edits of a tools file's text: what they do not touch keeps every byte, and what they do reads as it was meant."""

import copy
import difflib
import itertools
import re
from collections.abc import Mapping
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
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


def test_a_key_of_the_file_stands_before_the_tools() -> None:
    named = FILE.with_key("presets", "studio.yaml")
    assert named.text == FILE.text.replace("\ntools:", "\npresets: studio.yaml\ntools:")
    again = named.with_key("presets", ["studio.yaml", "a b.yaml"])
    assert again.text == named.text.replace("studio.yaml", "[studio.yaml, a b.yaml]")
    assert ToolsText("{version: 1, tools: []}").with_key("presets", "a").text == "{version: 1, tools: [], presets: a}"


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


MERGING = """\
version: 1
tools:
  - &T0   # the first
    name: a
    width: 0.3
    clips:
      walk: 1  # slow

  - <<: *T0
    name: b
  - {<<: *T0, name: c, width: 0.2}
"""


def test_a_tool_that_others_merge_merges_what_it_was() -> None:
    file = ToolsText(MERGING)
    wider = file.with_value(0, ("width",), 0.4).with_value(0, ("bumps",), 5)
    start = MERGING.index("  - &T0")
    assert (
        wider.text[start : wider.text.index("  - <<: *T0")]
        == """\
  - <<: &T0   # the first
      name: a
      width: 0.3
      clips:
        walk: 1  # slow
    width: 0.4
    bumps: 5

"""
    )
    assert wider.text.endswith(MERGING[MERGING.index("  - <<: *T0") :])
    assert wider.tools[0] == {**file.tools[0], "width": 0.4, "bumps": 5}
    assert wider.tools[1:] == file.tools[1:]
    # A key that all others have themselves, or that only this tool repeats, changes where it stands.
    assert file.with_value(0, ("name",), "d").text == MERGING.replace("name: a", "name: d")
    assert file.with_value(1, ("clips", "walk"), 2).text == MERGING.replace(
        "    name: b\n", "    name: b\n    clips: {walk: 2}\n"
    )


def test_a_merged_key_is_reset_in_one_tool_alone() -> None:
    file = ToolsText(MERGING)
    assert file.without(1, ("width",)).text == MERGING.replace("- <<: *T0\n", "- clips: {walk: 1}\n")
    assert file.without(2, ("width",)).tools[2] == {"name": "c", "clips": {"walk": 1}}
    with pytest.raises(ConfigError, match=r"^<tools>:3: holds the anchor &T0, .* write these out first$"):
        file.without(0, ("width",))


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


@pytest.mark.slow
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


# Lines of a key, as people write them; those after the first are indented relative to it.
KEY_LINES: dict[str, list[list[str]]] = {
    "mirror": [["mirror: x"], ["mirror:   x       # both sides"]],
    "origin": [["origin: [ 0.10, 0.6 , 1e-1 ]"], ["origin:", "  - 0.1", "  # up", "  - .60   # more", "  - -0", ""]],
    "target": [["target: {marker: 'Knie.L'}"], ["target: {", "    marker: Knie,   # ä, and so on", "  }"]],
    "width": [["width: 0.240"], ['width: "24%" # quoted'], ["width: >-", "  80%"], ["? width", ": 0.3"]],
    "clips": [
        ["clips:", "    walk: 0.8  # flatter", "", "    'my run': 1.0", '    "on": 0'],
        ["clips: {walk: 0.80, 'my run': 1,   # no more", "        on: +1,}"],
        ["clips: {" + ", ".join(f"walk {number}: 0.{number}0" for number in range(1, 60)) + "}  # long"],
    ],
    "details": [["details: []"], ["details: [0.20,", "# none", "     0.1 ]"]],
    "enabled": [["enabled: True"], ["enabled: yes   # 日本"], ["enabled:", "  on"]],
    "node": [["node: ~"], ["node:   # the only one"], ["node: |", "  body"], ["node: a long", "  name # of two lines"]],
    "lag": [["lag: {frequency: 6, damping: 0.50}"], ["lag:", "  # slow", "  frequency: 3"]],
}
ENTRIES = st.sampled_from(sorted(KEY_LINES)).flatmap(
    lambda key: st.tuples(st.just(key), st.sampled_from(KEY_LINES[key]))
)


@st.composite
def written_files(draw: st.DrawFn) -> tuple[str, list[tuple[str, int | None, str | None]]]:
    """A realistic file: its line break, and each line with the tool and the key that it belongs to."""
    lines: list[tuple[str, int | None, str | None]] = []
    beside: list[list[str]] = [
        ["version: 1"],
        ["up: z   # as Blender has it"],
        ["defaults: { width:  80% }    # both"],
        ["defaults:", "  lag: {frequency: 6,", "     damping: 1}", "  # and more", "  seed: 010"],
        ["# A file as people write them: Fältchen.", "", ""],
        ["sampling: {clips: [walk, 'my run'], fps: 3_0}"],
    ]
    above, below = (
        draw(st.lists(st.sampled_from(beside), max_size=3)),
        draw(st.lists(st.sampled_from(beside), max_size=1)),
    )
    lines += [(line, None, None) for each in above for line in each]
    lines.append((draw(st.sampled_from(["tools:", "tools:   # of the left"])), None, None))
    indent, wide = draw(st.sampled_from(["", "  ", "     "])), draw(st.integers(1, 3))
    for tool in range(draw(st.integers(1, 4))):
        lead = draw(st.sampled_from([[], [""], ["# The next one - or so."], ["", "# One.", "    # Two."]]))
        lines += [(f"{indent}{line}" if line else line, None, None) for line in lead]
        entries = [
            ("name", [f'name: "tool {tool}"']),
            *draw(st.lists(ENTRIES, max_size=5, unique_by=lambda each: each[0])),
        ]
        style = draw(st.sampled_from(["block", "own line", "flow"]))
        inner = indent + " " * (wide + 1)
        if style == "flow":
            found = [
                entry for entry in entries if len(entry[1]) == 1 and "#" not in entry[1][0] and ":" in entry[1][0][:9]
            ]
            text = ", ".join(line for _, [line] in found)
            lines.append((f"{indent}-{' ' * wide}{{{text}}}   # in one line", tool, None))
            continue
        if style == "own line":
            lines.append((f"{indent}-   # a tool - of {len(entries)} keys", None, None))
        for number, (key, [first, *others]) in enumerate(entries):
            dash = f"{indent}-{' ' * wide}" if style == "block" and not number else inner
            lines.append((dash + first, tool, key))
            lines += [(inner + line if line else line, tool, key) for line in others]
            if draw(st.booleans()):
                lines.append((draw(st.sampled_from(["", f"{inner}# What follows.", "# not indented"])), None, None))
    return draw(st.sampled_from(["\n", "\r\n"])), lines + [(line, None, None) for each in below for line in each]


@pytest.mark.slow
@settings(max_examples=60)
@given(written_files(), st.sampled_from([*KEY_LINES, "bumps", "name"]), VALUES, st.booleans(), st.data())
def test_only_the_edited_lines_change(
    file: tuple[str, list[tuple[str, int | None, str | None]]], key: str, value: Any, last: bool, data: st.DataObject
) -> None:
    newline, lines = file
    text = newline.join(line for line, _, _ in lines) + newline * last
    before = ToolsText(text)
    number = data.draw(st.integers(0, len(before.tools) - 1))
    edit = data.draw(st.sampled_from(["with_value", "without", "with_copy", "without_tool", "with_tool"]))
    expected = [dict(each) for each in before.tools]
    touched = key
    if edit == "with_value":
        after = before.with_value(number, [key], value)
        expected[number][key] = value
    elif edit == "without":
        after = before.without(number, [key])
        expected[number].pop(key, None)
    elif edit == "with_copy":
        after, touched = before.with_copy(number, "ä b"), "none"
        expected.insert(number + 1, expected[number] | {"name": "ä b"})
    elif edit == "without_tool":
        after = before.without_tool(number)
        del expected[number]
    else:
        after, touched = before.with_tool({"name": "new", key: value} if key != "name" else {"name": "new"}), "none"
        expected.append({"name": "new", key: value} if key != "name" else {"name": "new"})
    assert [*map(dict, after.tools)] == expected
    assert after.header == before.header
    if edit == "without_tool":
        return
    kept = [line for line, tool, of in lines if not (tool == number and of in (touched, None) and touched != "none")]
    found = iter(after.text.split(newline))
    for line in kept:
        assert any(line == each for each in found), line


# Values as others may repeat them: in one line, or as the block below a key.
SHARED: dict[str, list[str]] = {
    "width": ["0.3", "80%"],
    "origin": ["[0, 0, 1]", "[0.5, 0, 1]"],
    "clips": ["{walk: 1, run: 2}", "\n  walk: 1\n  # slow\n  run: 0.5"],
    "lag": ["{frequency: 6, damping: 1}", "\n  frequency: 3"],
}


@st.composite
def sharing_files(draw: st.DrawFn) -> str:
    """A file whose tools repeat and merge each other, or parts of each other."""
    anchors: dict[str, str] = {}  # the key of each value, or `tool`
    count = itertools.count()
    names = st.booleans().map(lambda named: f"&v{next(count)} " if named else "")
    lines = ["version: 1"]

    def value(key: str, *, flow: bool) -> str:
        repeated = [name for name, of in anchors.items() if of == key]
        if repeated and draw(st.booleans()):
            return f"*{draw(st.sampled_from(repeated))}"
        anchor, text = draw(names), draw(st.sampled_from(SHARED[key][: 1 if flow else None]))
        if anchor:
            anchors[anchor[1:-1]] = key
        return f"{anchor}{text}".replace(" \n", "\n")

    def merge() -> str:
        merged = [name for name, of in anchors.items() if of == "tool"]
        some = draw(st.lists(st.sampled_from(merged), max_size=2, unique=True)) if merged else []
        return f"[{', '.join(f'*{each}' for each in some)}]" if len(some) > 1 else "".join(f"*{each}" for each in some)

    if draw(st.booleans()):
        anchor = draw(names)
        lines.append(f"defaults: {anchor}{{width: {value('width', flow=True)}, bumps: 3}}   # for all")
        if anchor:
            anchors[anchor[1:-1]] = "tool"
    lines.append("tools:")
    for number in range(draw(st.integers(2, 4))):
        anchor, flow = draw(names), draw(st.booleans())
        keys = draw(st.permutations(["<<", *draw(st.lists(st.sampled_from(sorted(SHARED)), unique=True))]))
        # In the order of the text, as an alias stands behind its anchor.
        entries = [("name", f"t{number}"), *((key, merge() if key == "<<" else value(key, flow=flow)) for key in keys)]
        entries = [entry for entry in entries if entry[1]]
        if flow:
            lines.append(f"  - {anchor}{{{', '.join(f'{key}: {text}' for key, text in entries)}}}   # tool {number}")
        else:
            lines += [f"  - {anchor}  # tool {number}"]
            for key, text in entries:
                lines += f"    {key}: {text}".replace("\n", "\n    ").split("\n")
        if anchor:
            anchors[anchor[1:-1]] = "tool"
    return "\n".join(lines) + "\n"


SHARED_EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("with_value"), st.sampled_from([*SHARED, "bumps", "name"]), VALUES),
        st.tuples(
            st.just("with_value"), st.sampled_from([("clips", "walk"), ("clips", "jump"), ("origin", 1)]), VALUES
        ),
        st.tuples(st.just("without"), st.sampled_from([*SHARED, "bumps", ("clips", "walk"), ("lag", "frequency")])),
        st.tuples(st.just("with_copy")),
        st.tuples(st.just("without_tool")),
        st.tuples(st.just("with_item")),
    ),
    min_size=1,
    max_size=4,
)


@pytest.mark.slow
@pytest.mark.long
@settings(max_examples=40)
@given(sharing_files(), SHARED_EDITS, st.sampled_from(["\n", "\r\n"]), st.data())
def test_an_edit_changes_one_tool_whatever_others_share_with_it(
    text: str, edits: list[Any], newline: str, data: st.DataObject
) -> None:
    file = ToolsText(text.replace("\n", newline))
    for kind, *arguments in edits:
        tools = [copy.deepcopy(dict(each)) for each in file.tools]
        number = data.draw(st.integers(0, len(tools) - 1))
        steps = [arguments[0]] if arguments and isinstance(arguments[0], str) else [*(arguments or [()])[0]]
        held = tools[number].get(steps[0]) if len(steps) > 1 else None
        if len(steps) > 1 and not (isinstance(held, dict) if steps[1] != 1 else isinstance(held, list) and held[1:]):
            continue
        if kind == "with_value":
            after = file.with_value(number, steps, arguments[1])
            holder = tools[number] if len(steps) == 1 else tools[number][steps[0]]
            holder[steps[-1]] = arguments[1]
        else:
            try:
                after, tools = changed(file, kind, number, steps, tools)
            except ConfigError as error:
                assert "write " in str(error)  # noqa: PT017
                continue
        assert [*map(dict, after.tools)] == tools
        assert after.header == file.header
        assert newline == "\n" or "\n" not in after.text.replace("\r\n", "")
        file = after
        if not file.tools:
            return


def changed(
    file: ToolsText, kind: str, number: int, steps: list[Any], tools: list[dict[str, Any]]
) -> tuple[ToolsText, list[dict[str, Any]]]:
    """A file and its tools after an edit."""
    if kind == "without":
        holder = tools[number] if len(steps) == 1 else tools[number][steps[0]]
        holder.pop(steps[-1], None)
        return file.without(number, steps), tools
    if kind == "with_copy":
        tools.insert(number + 1, {**tools[number], "name": "copy"})
        return file.with_copy(number, "copy"), tools
    if kind == "without_tool":
        del tools[number]
        return file.without_tool(number), tools
    tools[number] = {"name": "new", "width": 0.1}
    return file.with_item(["name: new", "width: 0.1"], instead_of=number), tools


@pytest.mark.parametrize("name", ["head", "head_keyed", "trousers", "wrist"])
def test_of_a_config_only_the_lines_of_a_key_change(name: str) -> None:
    file = ToolsText((ROOT / "configs" / f"{name}.yaml").read_text())
    lines = file.text.splitlines()
    for number, tool in enumerate(file.tools):
        for key in tool:
            changed = file.with_value(number, [key], "else").text.splitlines()
            codes = difflib.SequenceMatcher(None, lines, changed, autojunk=False).get_opcodes()
            [(start, end, at, behind)] = [code[1:] for code in codes if code[0] != "equal"]
            assert changed[at].split("#")[0].split()[-1] == "else"
            assert behind == at + 1
            if isinstance(tool[key], dict) and "{" not in lines[start]:  # it stands below its key
                start, end = start - 1, start
            assert lines[start].lstrip(" -").startswith(f"{key}:")
            assert end == start + 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tools: [{name: a,\n  width: 1}]\n", "tools: [{name: a,\n  width: 1}, {name: b,\n        width: 1}]\n"),
        ("tools:\n  - name: |-\n      a\n", "tools:\n  - name: |-\n      a\n\n  - name: b\n"),
        ("tools:\n  -  &t\n    name: a\n    lag:\n      f: 1\n", None),
    ],
)
def test_a_tool_is_copied_however_it_is_written(text: str, expected: str | None) -> None:
    copy = ToolsText(text).with_copy(0, "b")
    assert copy.tools == (ToolsText(text).tools[0], {**ToolsText(text).tools[0], "name": "b"})
    assert copy.text.startswith(text.removesuffix("]\n"))
    assert expected in (None, copy.text)


def test_a_tool_in_brackets_gives_way_to_another() -> None:
    file = ToolsText("tools: [{name: a,   # the first\n  width: 1}, {name: b}]\n")
    changed = file.with_item(["{name: a,", "  width: 2}"], instead_of=0)
    assert changed.tools == ({"name": "a", "width": 2}, {"name": "b"})
    block = ["name: c", "clips:", "  walk: 1  # slow"]
    assert file.with_item(block, instead_of=1).tools[1] == {"name": "c", "clips": {"walk": 1}}
    assert file.with_item(block).tools[2] == {"name": "c", "clips": {"walk": 1}}


@given(VALUES)
def test_a_value_is_read_as_it_was_written(value: Any) -> None:
    root, problems = read_tree(f"a: {written(value)}\n")
    assert not problems
    assert root is not None
    assert root.value == {"a": dict(value) if isinstance(value, Mapping) else value}


@pytest.mark.parametrize(
    "text",
    [
        "{version: 1, fields: [{name: a}]}",
        '{"version": 1, "fields": [{"name": "a"}]}\n',
        "{version: 1, # first\n fields: [\n  {name: a} # second\n ]\n}\n",
        "version: 1\nfields: [name: a]  # first\n",
    ],
)
def test_a_file_in_brackets_is_edited_in_brackets(text: str) -> None:
    """The shortest files of fields; what was there stays, with its comments."""
    fields = ToolsText(text, "t.yaml", "fields")
    edited = fields.with_value(0, ("strength",), 2).with_value(0, ("clips", "walk"), 0.5)
    assert edited.tools == ({"name": "a", "strength": 2, "clips": {"walk": 0.5}},)
    assert re.findall(r"# \w+", edited.text) == re.findall(r"# \w+", text)
    more = edited.of_list("tools").with_tool({"name": "b", "width": "80%"})
    assert yaml.safe_load(more.text) == yaml.safe_load(edited.text) | {"tools": [{"name": "b", "width": "80%"}]}
    assert more.without_tool(0).with_tool({"name": "c"}).tools == ({"name": "c"},)
    assert yaml.safe_load(more.without_tool(0).without_empty().text) == yaml.safe_load(edited.text)
