"""The tools file: its contract, its messages, and that nothing else ever comes out of it."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, asdict, fields
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from kit import hostile
from kit.drawn import CHARACTERS
from kit.places import ROOT
from kit.tools_text import (
    ANCHORS,
    BAD_HEADERS,
    BAD_TOOL_KEYS,
    EVERYTHING,
    FIELD,
    FILE,
    FILE_KEYS,
    FLESH,
    HEAD,
    LENGTH,
    LENGTHS,
    MUSCLE,
    NAMES,
    OPTIONS,
    README,
    REFERENCE,
    TEXT,
    TOOL,
    TOOL_KEYS,
    TOUCH,
    first_tool,
    lines_of,
    tool_lines,
)
from wrinklecli.choices import GROUPS
from wrinklecli.errors import ConfigError
from wrinklecli.tools import records, schema
from wrinklecli.tools import yaml_tree as yamltree
from wrinklecli.tools.materials import preset
from wrinklecli.tools.read import given_values, load_tools, parse_tools, read_values
from wrinklecli.tools.records import (
    Contact,
    Length,
    Marker,
    RefinementSettings,
    RestFrame,
    RestLengthKeys,
    RestLengthMorph,
    Sampling,
    ToolsFile,
    WrinkleTool,
)
from wrinklecli.tools.schema import TOOLS_SCHEMA


def complaints(text: str) -> tuple[str, ...]:
    """The lines of the error, none for a good file."""
    try:
        parse_tools(text)
    except ConfigError as error:
        return error.lines
    return ()


# --- what a file says ---


def test_every_key_arrives():
    assert parse_tools(EVERYTHING, name="t.yaml") == ToolsFile(
        path="t.yaml",
        rest=RestFrame("walk", 0.5),
        sampling=Sampling(24.0, ("walk", "run")),
        refinement=RefinementSettings(3, 4, "midpoint"),
        effects=(
            WrinkleTool(
                name="brow.L",
                node="head_male",
                origin=(0.035, 0.845, 0.150),
                target=Marker("brow_top.L"),
                snap="vertex",
                width=Length(0.05),
                material="cloth",
                compressible=0.0,
                bump_height=preset("cloth").bump_height,
                strategy="both_ends",
                bumps=5,
                gap=1,
                max_height=Length(40.0, percent=True),
                details=(0.2, 0.1),
                profile="polyline",
                variation=0.8,
                seed=7,
                branch=0.5,
                broken=0.6,
                attenuation="linear",
                attachment="patch",
                strength=-0.5,
                clips={"walk": 0.3, "idle": 0.0},
                rest_length=RestLengthKeys({"frown": ((0.0, Length(0.06)), (0.5, Length(110.0, True)))}),
                optional=True,
                where="t.yaml:8: tools[0]",
            ),
        ),
    )


def test_given_values_are_those_of_the_file_and_valid(tmp_path):
    path = tmp_path / "t.yaml"
    path.write_text(EVERYTHING)
    assert given_values(path) == (yaml.safe_load(EVERYTHING), (str(path),))
    path.write_text(EVERYTHING.replace("bumps: 5", "bumps: 2.5"))
    with pytest.raises(ConfigError, match=r"bumps: found 2.5"):
        given_values(path)


def test_values_are_read_as_the_text_that_says_them():
    values = yaml.safe_load(EVERYTHING)
    assert read_values(values) == parse_tools(json.dumps(values))
    values["tools"][0] |= {"bumps": 99, "widht": [1, "x"], "attachment": None}
    said = []
    for reading in (lambda: read_values(values), lambda: parse_tools(json.dumps(values))):
        with pytest.raises(ConfigError) as caught:
            reading()
        said.append(caught.value.lines)
    assert said[0] == said[1]


def test_the_defaults_of_the_contract():
    file = parse_tools(HEAD + "    width: 1\n")
    assert (file.version, file.up, file.rest) == (1, "y", "stored")
    assert (file.sampling, file.refinement) == (Sampling(30.0, "all"), RefinementSettings(4, 2, "butterfly"))
    assert file.tools[0] == WrinkleTool(
        name="brow.L",
        node=None,
        origin=(1.0, 2.0, 3.0),
        target=(1.0, 4.0, 3.0),
        snap="surface",
        width=Length(1.0),
        material=None,
        strategy="everywhere",
        bumps=4,
        gap=0,
        max_height="auto",
        details=(),
        profile="smooth",
        bow=0.0,
        variation=0.3,
        seed=None,
        branch=0.25,
        broken=0.0,
        attenuation="bell",
        attachment="skin",
        strength=1.0,
        clips={},
        rest_length="auto",
        enabled=True,
        optional=False,
        where="<tools>:3: tools[0]",
    )


def test_schema_and_records_agree_on_keys_and_defaults():
    record = [entry.name for entry in fields(WrinkleTool)]
    # The points of a path are its ends and what is between them.
    assert ["between" if key == "path" else key for key in TOOL if key != "mirror"] == [
        key for key in record if key not in ("mirrored", "where", "places", "bump_height")
    ]
    plain = WrinkleTool(name="a", origin=(0, 0, 0), target=(1, 0, 0), width=Length(1))
    for key, entry in TOOL.items():
        if key != "mirror" and "default" in entry:
            assert as_written(getattr(plain, key), key) == entry["default"], key
    file = ToolsFile(path="")
    for key in ("up", "rest", "sampling", "refinement"):
        assert as_written(getattr(file, key)) == FILE[key]["default"]
    for key in ("sampling", "refinement"):
        assert {name: entry["default"] for name, entry in FILE[key]["properties"].items()} == FILE[key]["default"]
    assert as_written(RestFrame("a")) == {"clip": "a", "time": FILE["rest"]["then"]["properties"]["time"]["default"]}
    own = {"name", "origin", "target", "path"}
    assert {key: entry for key, entry in TOOL.items() if key not in own} == FILE["defaults"]["properties"]


@pytest.mark.parametrize(
    ("more", "key", "expected"),
    [
        ("width: 80%", "width", Length(80.0, percent=True)),
        ("width: '.5 %'", "width", Length(0.5, percent=True)),
        ("width: 1e-3", "width", Length(0.001)),
        ("width: 3", "width", Length(3.0)),
        ("width: 1\nmax_height: none", "max_height", None),
        ("width: 1\nmax_height: null", "max_height", None),
        ("width: 1\nmax_height:", "max_height", None),
        ("width: 1\nmax_height: auto", "max_height", "auto"),
        ("width: 1\nmax_height: 2", "max_height", Length(2.0)),
        ("width: 1\nnode: null", "node", None),
        ("width: 1\nnode: 'on'", "node", "on"),
        ("width: 1\nnode: 2020-01-01", "node", "2020-01-01"),
        ("width: 1\nnode: 1:30", "node", "1:30"),
        ("width: 1\nnode: !!str 5", "node", "5"),
        ("width: 1\nbumps: 3.0", "bumps", 3),
        ("width: 1\nbumps: !!int 3", "bumps", 3),
        ("width: 1\noptional: yes", "optional", True),
        ("width: 1\ndetails: []", "details", ()),
        ("width: 1\ncompressible: 0%", "compressible", 0.0),
        ("width: 1\ncompressible: 37.5 %", "compressible", 0.375),
        ("width: 1\ncompressible: '95.0%'", "compressible", 0.95),
        ("width: 1\nclips: {on: 0.5, 1: 2, y: 0, null: 1}", "clips", {"on": 0.5, "1": 2, "y": 0, "null": 1}),
        ("width: 1\nrest_length: 110%", "rest_length", Length(110.0, percent=True)),
        ("width: 1\nrest_length: 0.06", "rest_length", Length(0.06)),
        (
            "width: 1\nrest_length: {morph: browsUp, full: 115%}",
            "rest_length",
            RestLengthMorph("browsUp", Length(115.0, percent=True)),
        ),
        ("width: 1\nstrength: &s -2\nclips: {a: *s}", "clips", {"a": -2.0}),
        ("<<: {width: 1, gap: 2}\ngap: 3", "gap", 3),
        ("<<: [{width: 1, gap: 2}, {gap: 3, bumps: 7}]", "gap", 2),
        ("<<: [{width: 1, gap: 2}, {gap: 3, bumps: 7}]", "bumps", 7),
    ],
)
def test_values_as_read(more, key, expected):
    found = getattr(first_tool(more), key)
    assert found == expected
    assert type(found) is type(expected)


def test_defaults_are_inherited_and_replaced_as_a_whole():
    defaults = "defaults: {width: 80%, bumps: 7, clips: {a: 1, b: 2}, details: [0.1, 0.1]}\n"
    found = first_tool("clips: {c: 3}\ndetails: []", before=defaults)
    assert (found.width, found.bumps) == (Length(80.0, percent=True), 7)
    assert (found.clips, found.details) == ({"c": 3.0}, ())
    assert first_tool("width: 1", before="defaults:\n").bumps == 4


def test_strength_in_a_clip():
    found = first_tool("width: 1\nstrength: 2\nclips: {walk: 0.5}")
    assert (found.strength_in("walk"), found.strength_in("run")) == (0.5, 2.0)


def test_only_enabled_tools_are_kept_but_all_are_checked():
    more = "  - {name: b, origin: [0, 0, 0], target: [1, 0, 0], width: 1}\n"
    assert [found.name for found in parse_tools(f"{HEAD}    width: 1\n    enabled: no\n{more}").tools] == ["b"]
    assert tool_lines("enabled: false\nwidth: 0") == [f"t.yaml:7: tools[0].width: found 0, expected {LENGTHS}"]


def test_records_are_frozen_and_hash():
    found = first_tool("width: 1\nrest_length: {keys: {a: [[0, 1]]}}")
    assert hash(found) == hash(first_tool("width: 1\nrest_length: {keys: {a: [[0, 1]]}}"))
    for record in (found, found.width, parse_tools(HEAD + "    width: 1"), Marker("a"), Sampling()):
        with pytest.raises(FrozenInstanceError):
            setattr(record, fields(record)[0].name, None)


def test_z_up_positions_become_y_up():
    found = first_tool("width: 1\nmirror: x", before="up: z\n")
    assert found.origin == (1.0, 3.0, -2.0)
    assert parse_tools("up: z\n" + HEAD + "    width: 1\n    mirror: x\n").tools[1].origin == (
        -1.0,
        3.0,
        -2.0,
    )


@given(st.tuples(*[st.floats(-1e9, 1e9)] * 3))
def test_the_turn_to_y_up_keeps_length_and_turns_back(position):
    x, y, z = position
    text = f"version: 1\nup: z\ntools: [{{name: a, origin: [{x}, {y}, {z}], target: {{marker: m}}, width: 1}}]"
    u, v, w = parse_tools(text).tools[0].origin
    assert (u, -w, v) == position
    assert str(w) != "-0.0"


# --- what a file must not say ---


@pytest.mark.parametrize(("more", "expected"), BAD_TOOL_KEYS)
def test_a_bad_key_is_one_line(more, expected):
    line = 7 if "duplicate" in expected else 6
    assert tool_lines(more + "\nwidth: 1") == [f"t.yaml:{line}: {expected}"]


BAD_FILES = [
    ("", ["1: the file is empty, expected a mapping with version and tools"]),
    ("# nothing\n", ["1: the file is empty, expected a mapping with version and tools"]),
    ("[1]", [f"1: found a list of 1, expected a mapping of {FILE_KEYS}"]),
    ("hello", [f"1: found hello, expected a mapping of {FILE_KEYS}"]),
    ("{}", ["1: version: required, but missing", "1: tools: required, but missing"]),
    ("a: [", ["1: YAML: expected the node content, but found '<stream end>', while parsing a flow node"]),
    ("a: 1\n\tb: 2", ["2: YAML: indented by a tab; only spaces are taken"]),
    ("a: *b", ["1: YAML: found undefined alias 'b'"]),
    ("a: 1\n---\nb: 1", ["2: YAML: but found another document, expected a single document in the stream"]),
    ("a: 1\nb: \x07", ["2: YAML: character U+0007 is not allowed"]),
    ('a: "\\U00110000"', ["1: YAML: chr() arg not in range(0x110000)"]),
    ("version: 1\ntools: !more {a: 1}", ["2: tools: found the tag !more, expected a value without it"]),
    ("version: 1\ntools: !include b.yaml", ["2: tools: found the tag !include, expected a value without it"]),
    ("[" * 5000, ["1: YAML: nested more than 32 levels deep"]),
    ("- " * 5000, ["1: YAML: nested more than 32 levels deep"]),
    ("a: &a [*a]", ["1: YAML: nested more than 32 levels deep: an alias stands within its own anchor"]),
    ("a: &a {<<: *a}", ["1: YAML: nested more than 32 levels deep: an alias stands within its own anchor"]),
    ("x" * 4_000_001, ["1: found 4,000,001 characters, expected at most 4,000,000"]),
    ("[" + "1," * 100_001 + "]", ["1: YAML: more than 100,000 values"]),
]


@pytest.mark.quick(len(BAD_FILES) - 1, len(BAD_FILES) - 1)  # the last has 100,001 values
@pytest.mark.parametrize(("text", "expected"), BAD_FILES, ids=[str(i) for i in range(len(BAD_FILES))])
def test_files_that_are_no_tools_files(text, expected):
    assert lines_of(text) == [f"t.yaml:{line}" for line in expected]


@pytest.mark.parametrize(("line", "expected"), BAD_HEADERS)
def test_a_bad_header_is_one_line(line, expected):
    head = HEAD.removeprefix("version: 1\n") if line.startswith("version") else HEAD
    assert lines_of(f"{line}\n{head}    width: 1\n") == [f"t.yaml:1: {expected}"]


POINTS = "[[1, 2, 3], {marker: elbow.L}, [1, 4, 3]]"


def path_tool(path: str, more: str = "") -> str:
    return f"version: 1\n{more}tools:\n  - name: fold.L\n    path: {path}\n    width: 1\n"


def test_a_path_has_the_points_of_origin_and_target_and_those_between() -> None:
    (tool,) = parse_tools(path_tool(POINTS)).tools
    assert tool.points == ((1.0, 2.0, 3.0), Marker("elbow.L"), (1.0, 4.0, 3.0))
    assert (tool.origin, tool.between, tool.target) == (tool.points[0], tool.points[1:2], tool.points[2])
    assert tool.place_of(1) == "<tools>:4: tools[0].path[1]"
    assert tool.place_of(1, "marker") == "<tools>:4: tools[0].path[1].marker"
    other = parse_tools(path_tool(POINTS, "up: z\ndefaults: {mirror: x}\n")).tools[1]
    assert other.points == ((-1.0, 3.0, -2.0), Marker("elbow.R"), (-1.0, 3.0, -4.0))
    (two,) = parse_tools(path_tool("[[1, 2, 3], [1, 4, 3]]")).tools
    (ends,) = parse_tools(path_tool("5").replace("path: 5", "origin: [1, 2, 3]\n    target: [1, 4, 3]")).tools
    assert two == ends
    assert [two.place_of(k) for k in (0, 1)] == [f"<tools>:4: tools[0].path[{k}]" for k in (0, 1)]


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("[[1, 2, 3]]", ": found a list of 1, expected a list of 2 to 64 points, each [x, y, z] or {marker: NODE}"),
        ("[[1, 2, 3], [4, 5]]", "[1]: found a list of 2, expected [x, y, z] or {marker: NODE}"),
        ("[{marker: a}, {marker: a}]", "[1]: same as the point before it, expected another"),
        ("[{marke: a}, [1, 2, 3]]", "[0].marke: unknown key, did you mean marker?"),
    ],
)
def test_bad_paths(path: str, expected: str) -> None:
    assert lines_of(path_tool(path)) == [f"t.yaml:4: tools[0].path{expected}"]


def test_a_path_stands_alone() -> None:
    lines = lines_of(HEAD + f"    path: {POINTS}\n    width: 1\n")
    assert lines == [
        f"t.yaml:{line}: tools[0].{key}: found a list of 3, expected path alone, or origin and target"
        for line, key in ((4, "origin"), (5, "target"))
    ]
    assert lines_of(
        f"version: 1\ndefaults: {{path: {POINTS}}}\n" + HEAD.removeprefix("version: 1\n") + "    width: 1\n"
    ) == ["t.yaml:2: defaults.path: not inherited, each tool needs its own"]


@pytest.mark.parametrize(
    ("anchor", "expected"),
    [
        ("[1, 2]", ": found a list of 2, expected [x, y, z] or {marker: NODE}"),
        ("5", ": found 5, expected [x, y, z] or {marker: NODE}"),
        ("", ": found nothing, expected [x, y, z] or {marker: NODE}"),
        ("[1, 2, a]", "[2]: found a, expected a number from -1e9 to 1e9"),
        ("[1, yes, 0]", "[1]: found yes, expected a number from -1e9 to 1e9"),
        ("[.inf, 0, 0]", "[0]: found .inf, expected a number from -1e9 to 1e9"),
        ("{marke: a}", ".marke: unknown key, did you mean marker?"),
        ("{marker: 5}", f".marker: found 5, expected {TEXT}"),
        ("[1, 2, 3]", ": same as origin, expected another point"),
    ],
)
def test_bad_anchors(anchor, expected):
    text = HEAD.replace("[1, 4, 3]", anchor) + "    width: 1\n"
    assert lines_of(text) == [f"t.yaml:5: tools[0].target{expected}"]


@pytest.mark.parametrize(
    ("tools", "expected"),
    [
        ("tools:", "tools: found nothing, expected a list of 1 to 1,000 tools, each begun by a dash"),
        ("tools: []", "tools: found a list of 0, expected a list of 1 to 1,000 tools, each begun by a dash"),
        ("tools: {a: 1}", "tools: found a mapping, expected a list of 1 to 1,000 tools, each begun by a dash"),
        (
            "tools: {a: {name: b, width: [1]}}",
            "tools: found a mapping, expected a list of 1 to 1,000 tools, each begun by a dash",
        ),
        ("tools: [5]", f"tools[0]: found 5, expected a mapping of {TOOL_KEYS}"),
        (
            f"tools: [{'1, ' * 1001}]",
            "tools: found a list of 1001, expected a list of 1 to 1,000 tools, each begun by a dash",
        ),
    ],
)
def test_bad_lists_of_tools(tools, expected):
    assert lines_of(f"version: 1\n{tools}") == [f"t.yaml:2: {expected}"]


def test_names_must_differ_once_they_are_sanitised():
    other = "  - {name: brow_L, origin: [0, 0, 0], target: [1, 0, 0], width: 1}\n"
    assert lines_of(f"{HEAD}    width: 1\n{other}") == [
        "t.yaml:7: tools[1].name: found brow_L, but tools[0] is 'brow_L' in morph targets: names differ in"
        " letters, digits, _"
    ]
    assert first_tool().identifier == "brow_L"


@pytest.mark.parametrize(("one", "other"), [("élbow", "álbow"), ("ひじ", "ひざ"), ("Ελπίδα", "Ελπίδας")])
def test_names_may_differ_in_letters_of_any_script(one, other):
    tool = "  - {{name: {}, origin: [0, 0, 0], target: [1, 0, 0], width: 1}}\n"
    file = parse_tools(f"version: 1\ntools:\n{tool.format(one)}{tool.format(other)}")
    assert [each.identifier for each in file.tools] == [one, other]


def test_keys_of_a_tool_beside_the_tools_are_said_to_be_indented_too_little():
    text = "version: 1\ndefaults:\nbumps: 4\ntools:\n- name: a\norigin: [0, 0, 0]\ntarget: [1, 0, 0]\nwidth: 1\n"
    assert lines_of(text) == [
        "t.yaml:3: bumps: belongs to a tool or to defaults; is it indented too little?",
        "t.yaml:6: origin: belongs to a tool; is it indented too little?",
        "t.yaml:7: target: belongs to a tool; is it indented too little?",
        "t.yaml:8: width: belongs to a tool or to defaults; is it indented too little?",
    ]


def test_every_value_of_a_tool_has_its_place_in_the_file():
    text = "version: 1\nrest: {clip: a}\ndefaults:\n  width: 1\n  clips: {b: 1}\n  node: hand\n" + HEAD[11:]
    file = parse_tools(text + "    rest_length:\n      keys:\n        my.c: [[0, 1]]\n    node: foot\n", name="t.yaml")
    (found,) = file.tools
    assert file.place("rest", "clip") == "t.yaml:2: rest.clip"
    assert file.place("sampling", "clips") == "t.yaml"
    assert found.place("rest_length", "keys", "my.c") == "t.yaml:13: tools[0].rest_length.keys['my.c']"
    assert found.place("node") == "t.yaml:14: tools[0].node"
    assert found.place("clips", "b") == "t.yaml:5: defaults.clips.b"
    assert found.place("bumps") == found.where == "t.yaml:8: tools[0]"


def test_everything_wrong_is_reported_at_once_in_the_order_of_lines():
    assert lines_of(
        "version: 2\n"
        "defaults:\n"
        "  bumps: 0\n"
        "tools:\n"
        "  - name: a\n"
        "    origin: [0, 0, x]\n"
        "    mirror: x\n"
        "  - name: a\n"
        "    widht: 1\n"
        "    target: [0, 0, 0]\n"
    ) == [
        "t.yaml:1: version: found 2, expected 1, the only version so far",
        "t.yaml:3: defaults.bumps: found 0, expected a whole number from 1 to 64",
        "t.yaml:5: tools[0].target: required, but missing",
        "t.yaml:5: tools[0].width: required, but missing",
        "t.yaml:5: tools[0].name: found a, expected a side to exchange for mirror, such as brow.L or left_brow",
        "t.yaml:6: tools[0].origin[2]: found x, expected a number from -1e9 to 1e9",
        "t.yaml:8: tools[1].origin: required, but missing",
        "t.yaml:8: tools[1].name: found a, but tools[0] is 'a' in morph targets: names differ in letters, digits, _",
        "t.yaml:9: tools[1].widht: unknown key, did you mean width?",
    ]


def test_all_of_a_key_s_problems_are_reported():
    assert tool_lines("width: 1\nrest_length:\n  keys:\n    a: [[1, 1], [1, 2], [0, 2]]\n    b: [[2, 1], [1, 2]]") == [
        "t.yaml:9: tools[0].rest_length.keys.a: found a list of 3, "
        "expected times that rise from key to key, not 1 and then 1",
        "t.yaml:10: tools[0].rest_length.keys.b: found a list of 2, "
        "expected times that rise from key to key, not 2 and then 1",
    ]
    for share in ("96%", "95.1%", "-1%", "0.5", "100%", "a%", "%"):
        assert tool_lines(f"width: 1\ncompressible: '{share}'") == [
            f"t.yaml:7: tools[0].compressible: found '{share}', expected a percentage from 0% to 95%"
        ]
    assert tool_lines("width: 1\ndetails: [0, 2, .1]\nclips: {a: x, b: 300}") == [
        "t.yaml:7: tools[0].details[0]: found 0, expected a number from 0.001 to 0.99",
        "t.yaml:7: tools[0].details[1]: found 2, expected a number from 0.001 to 0.99",
        "t.yaml:8: tools[0].clips.a: found x, expected a number from -100 to 100",
        "t.yaml:8: tools[0].clips.b: found 300, expected a number from -100 to 100",
    ]


def test_a_misspelt_default_is_reported_once_and_not_for_each_tool():
    assert lines_of(f"defaults: {{widht: 1}}\n{HEAD}") == ["t.yaml:1: defaults.widht: unknown key, did you mean width?"]
    assert lines_of(f"defaults: {{width: no}}\n{HEAD}") == [f"t.yaml:1: defaults.width: found no, expected {LENGTHS}"]


@pytest.mark.slow
def test_alias_bombs_are_refused():
    lists = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    maps = "a0: &a0 {x: 1}\n"
    for i in range(9):
        aliases = ", ".join([f"*a{i}"] * 10)
        lists += f"a{i + 1}: &a{i + 1} [{aliases}]\n"
        maps += f"a{i + 1}: &a{i + 1} {{<<: [{aliases}]}}\n"
    for text in (lists, maps):
        (line,) = lines_of(text)
        assert line.endswith("YAML: more than 100,000 values once the aliases are expanded")


def test_merged_problems_are_reported_at_the_lines_where_they_stand():
    text = f"version: 1\ntools:\n  - &a\n{HEAD.split('- ')[1].replace('name', '    name', 1)}    bumps: 0\n"
    text += "    width: 1\n  - <<: *a\n    name: b\n    bumps: 1\n"
    assert lines_of(text) == [
        "t.yaml:7: tools[0].bumps: found 0, expected a whole number from 1 to 64",
    ]


# --- files ---


def test_load_names_the_file_as_typed(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "t.yaml").write_text(HEAD + "    width: 1\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    file = load_tools(Path("sub/t.yaml"))
    name = os.path.join("sub", "t.yaml")
    assert (file.path, file.tools[0].where) == (name, f"{name}:3: tools[0]")
    assert load_tools("./sub/t.yaml").path == "./sub/t.yaml"


def test_load_takes_a_byte_order_mark_and_windows_lines(tmp_path):
    path = tmp_path / "t.yaml"
    text = HEAD + "    width: 1\n    bumps: x\n"
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    with pytest.raises(ConfigError) as caught:
        load_tools(path)
    assert caught.value.lines == (f"{path}:7: tools[0].bumps: found x, expected a whole number from 1 to 64",)


SWAPPED = ": is a glTF asset, where the tools file (YAML) belongs: the asset comes first, then the tools"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"a: 1\nb: \xff", ":2: found byte 0xff, expected UTF-8"),
        ("a: 1".encode("utf-16"), ":1: found byte 0xff, expected UTF-8"),
        (b"#" * 4_000_001, ": larger than 4 MB, expected YAML"),
        (b"glTF" + b"\xff" * 5_000_000, SWAPPED),
        (b'{\n "scenes": [], "asset": {"version": "2.0"}}', SWAPPED),
    ],
    ids=["latin", "utf-16", "large", "glb", "gltf"],
)
def test_load_refuses_other_files(tmp_path, data, expected):
    path = tmp_path / "t.yaml"
    path.write_bytes(data)
    with pytest.raises(ConfigError) as caught:
        load_tools(path)
    assert caught.value.lines == (f"{path}{expected}",)


def test_load_says_why_a_file_cannot_be_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for name, expected in [
        ("none.yaml", "none.yaml: cannot be read: No such file or directory"),
        ("folder", "folder: cannot be read: Is a directory"),
        ("a\0b", "a\\x00b: cannot be read: its path has a null character"),
        ("a\nb", "a\\nb: cannot be read: No such file or directory"),
    ]:
        with pytest.raises(ConfigError) as caught:
            load_tools(name)
        (line,) = caught.value.lines
        assert line.startswith(expected)


def test_numpy_is_not_imported():
    code = "import sys, wrinklecli.tools.read; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- properties ---

FRAGMENTS = st.sampled_from(
    [
        *(
            "version: 1\n",
            "tools:\n",
            "  - name: a\n",
            "    origin: [0, 0, 0]\n",
            "    target: ",
            "defaults: ",
        ),
        *(
            "{",
            "}",
            "[",
            "]",
            ", ",
            ": ",
            "\n",
            "  ",
            "- ",
            "&a ",
            "*a",
            "<<: ",
            "!!int ",
            "!x ",
            "? ",
            "|\n",
            "'",
        ),
        *(
            '"',
            "\\",
            "#",
            "%",
            "---\n",
            "...\n",
            "on",
            "~",
            "1e999",
            ".nan",
            "0x1",
            "mirror",
            "rest_length: ",
        ),
        *(
            "keys",
            "morph",
            "full",
            "80%",
            "\t",
            "\x00",
            "\ud800",
            "\x85",
            "\u2028",
            "é",
            "clips: ",
            "sampling: ",
        ),
    ]
)


@given(st.lists(st.one_of(FRAGMENTS, st.text(CHARACTERS, max_size=4)), max_size=40).map("".join))
def test_any_text_gives_tools_or_a_config_error(text):
    for line in complaints(text):
        assert line.isprintable()
        assert re.match(r"<tools>:\d+: ", line)


VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(CHARACTERS, max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(
            st.sampled_from([*TOOL, "keys", "morph", "full", "clip", "marker", "fps"]),
            inner,
            max_size=4,
        ),
    ),
    max_leaves=12,
)


@pytest.mark.slow
@given(
    st.dictionaries(st.sampled_from(list(FILE)), VALUES),
    st.lists(st.dictionaries(st.sampled_from(list(TOOL)), VALUES), max_size=3),
)
def test_any_values_give_tools_or_a_config_error(header, tools):
    text = yaml.safe_dump({**header, "version": 1, "tools": tools}, allow_unicode=True)
    assert all(line.isprintable() for line in complaints(text))


def as_written(value, key=None):
    """A record's value as a file writes it, at a key."""
    if key == "compressible":
        return f"{100 * value:.15g}%"
    if key == "contact" and value is None:
        return "off"
    match value:
        case Length(number, percent):
            return f"{number!r}%" if percent else number
        case Marker(node):
            return {"marker": node}
        case RestLengthMorph(morph, full):
            return {"morph": morph, "full": as_written(full)}
        case RestLengthKeys(keys):
            return {
                "keys": {clip: [[time, as_written(length)] for time, length in track] for clip, track in keys.items()}
            }
        case Sampling() | RefinementSettings() | RestFrame() | Contact():
            return asdict(value)
        case tuple():
            return list(value)
    return value


@given(
    st.fixed_dictionaries({"name": NAMES, "origin": ANCHORS, "width": LENGTH}, optional=OPTIONS),
)
def test_what_is_written_is_read(written):
    written = {**written, "target": {"marker": "the end"}}
    text = yaml.safe_dump({"version": 1, "tools": [written]}, allow_unicode=True)
    (read,) = parse_tools(text).tools
    again = {
        entry.name: as_written(getattr(read, entry.name), entry.name)
        for entry in fields(WrinkleTool)
        if entry.name not in ("between", "mirrored", "where", "places", "bump_height")
    }
    (once_more,) = parse_tools(yaml.safe_dump({"version": 1, "tools": [again]})).tools
    assert again == {key: as_written(getattr(once_more, key), key) for key in again}
    for key in ("name", "origin", "node", "bumps", "gap", "details", "strength", "clips", "optional"):
        if key in written:
            assert again[key] == written[key]


# --- the schema and the reference ---


def mappings(part: Any, name: str = "file") -> Iterator[tuple[str, dict[str, Any]]]:
    """The mappings that a schema names the keys of, each with its key."""
    if isinstance(part, dict):
        if "properties" in part and "object" in part.get("type", ()):
            yield name, part
        for key, inner in part.items():
            yield from mappings(inner, key)
    elif isinstance(part, list):
        for inner in part:
            yield from mappings(inner, name)


def test_every_key_of_the_schema_is_described_and_no_other_is_let_in():
    found = list(mappings(TOOLS_SCHEMA))
    assert len(found) > 10
    for name, mapping in found:
        assert mapping["additionalProperties"] is False, name
        for key, entry in mapping["properties"].items():
            assert entry.get("description"), key


def readme_tables() -> dict[str, dict[str, tuple[str, str]]]:
    """For each heading of the reference its keys, their values and their defaults as written."""
    tables: dict[str, dict[str, tuple[str, str]]] = {}
    heading = ""
    for line in REFERENCE.splitlines():
        if line.startswith("#"):
            heading = line.strip("# ")
        elif match := re.match(r"\| `(\w+)` \| (.*) \| (`[^`]+`|required|none) \| [^|]+ \|$", line):
            tables.setdefault(heading, {})[match[1]] = match[2], match[3]
    return tables


@pytest.mark.parametrize(
    ("heading", "keys"),
    [
        *((group, {key: each for key, each in TOOL.items() if each["group"] == group}) for group in GROUPS),
        ("The file", FILE),
        ("rest", FILE["rest"]["then"]["properties"]),
        ("sampling", FILE["sampling"]["properties"]),
        ("refinement", FILE["refinement"]["properties"]),
        ("marker", TOOL["origin"]["properties"]),
        (
            "Rest lengths",
            TOOL["rest_length"]["then"]["properties"] | TOOL["rest_length"]["else"]["then"]["properties"],
        ),
        ("Tissue that lags", TOOL["lag"]["then"]["properties"]),
        ("Fields", FIELD),
        ("Muscles", MUSCLE),
        ("Flesh", FLESH),
        ("Touch", TOUCH),
        ("wrinkles", TOUCH["wrinkles"]["then"]["properties"]),
        ("release", TOUCH["release"]["properties"]),
        ("joint", MUSCLE["origin"]["then"]["properties"]),
        ("Contact", TOOL["contact"]["then"]["properties"]),
    ],
)
def test_the_reference_names_every_key_with_its_values_and_its_default(heading, keys):
    table = readme_tables()[heading]
    assert list(written_defaults(table).items()) == list(defaults_of(keys).items())
    for key, each in keys.items():
        words = [f"`{word}`" for word in each.get("enum", ()) if word is not None]
        ends = [each[end] for end in ("minimum", "maximum") if each.get("type") in ("number", "integer")]
        numbers = [f"{end:g}".replace("e-0", "e-").replace("e+0", "e") for end in ends]
        types = table[key][0].replace("−", "-")
        assert [word for word in (*words, *numbers) if word not in types] == [], (key, types)


def defaults_of(keys: dict[str, Any]) -> dict[str, Any]:
    """The defaults of the schema."""
    defaults = {key: entry.get("default", "required") for key, entry in keys.items()}
    defaults |= {key: {} for key in ("sampling", "refinement") if key in keys}  # none of their keys given
    # Each in place of others, or with them.
    absent = [
        "path",
        "tools",
        "muscles",
        "flesh",
        "touches",
        "fields",
        "radius",
        "towards",
        "along",
        "by",
        *(["at"] if "radius" in keys else []),
    ]
    return defaults | {key: None for key in absent if key in keys}


def written_defaults(table: dict[str, tuple[str, str]]) -> dict[str, Any]:
    """The defaults of a table of the reference."""
    written = {key: yaml.safe_load(default.strip("`")) for key, (_, default) in table.items()}
    written |= {key: None for key, default in written.items() if default == "none"}
    return written | {key: "off" for key in ("contact",) if written.get(key) is False}  # YAML 1.1


def test_the_examples_of_the_reference_are_valid():
    example, messages, own = re.findall(r"```(?:yaml)?\n(.*?)```", README, re.DOTALL)
    names = [found.name for found in parse_tools(example).tools]
    assert names == ["brow.L", "brow.R", "knee.L", "elbow.L"]
    assert [found.bumps for found in parse_tools(own).tools] == [3]
    for line in messages.splitlines():
        key = line.rsplit("tools[0].", 1)[1]
        assert any(expected.endswith(key) for _, expected in BAD_TOOL_KEYS)


@pytest.mark.parametrize("page", ["fields", "muscles", "flesh", "touch", "contact"])
def test_the_page_of_an_effect_begins_with_a_valid_example(page):
    text = (ROOT / "configs" / f"{page}.md").read_text(encoding="utf-8")
    example = text.partition("| key |")[0].partition("```yaml\n")[2].partition("```")[0]
    assert parse_tools(example).effects


@pytest.mark.parametrize(
    ("constant", "words"),
    [
        ("MAX_TOOLS", "1 to 1,000 tools"),
        ("MAX_NODES", "100,000 values"),
        ("MAX_DEPTH", "32 levels"),
        ("MAX_BYTES", "4 MB"),
        ("MAX_DETAILS", "up to 4 shares"),
    ],
)
def test_the_reference_names_the_limits(constant, words):
    [limit] = [getattr(each, constant) for each in (yamltree, schema, records) if hasattr(each, constant)]
    number = f"{limit // 1_000_000} MB" if constant == "MAX_BYTES" else f"{limit:,}"
    assert number in words
    assert words in README


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("tools", "line"),
    [
        ("- {}\n" * 30_000, "t.yaml:2: tools: found a list of 30000, expected a list of 1 to 1,000 tools"),
        (f"- {{{','.join(f'k{number}: !x 1' for number in range(15_000))}}}\n", "t.yaml:3: tools[0].k0: found the tag"),
    ],
    ids=["tools", "keys"],
)
def test_a_flood_of_mistakes_is_a_screen_of_lines(tools: str, line: str) -> None:
    with hostile.bounded(seconds=30.0, megabytes=100.0):
        first, *others = lines_of(f"version: 1\ntools:\n{tools}")
    assert first.startswith(line)
    assert not others or others[-1] == f"and {14_954:,} more"
    assert len(others) in (0, 50)
