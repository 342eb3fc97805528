"""Mirrored tools: what names one side names the other, and positions lie across the plane."""

from dataclasses import fields

import pytest

from kit.tools_text import EVERYTHING, HEAD, lines_of
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import Marker, WrinkleTool


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("brow.L", "brow.R"),
        ("brow.l", "brow.r"),
        ("brow_R", "brow_L"),
        ("brow_r", "brow_l"),
        ("brow.L.001", "brow.R.001"),
        ("l_brow", "r_brow"),
        ("left brow", "right brow"),
        ("leftBrow", "rightBrow"),
        ("browRight", "browLeft"),
        ("mixamorig:LeftArm", "mixamorig:RightArm"),
        ("LEFT_ARM", "RIGHT_ARM"),
        ("bright.L", "bright.R"),
        ("ball_l", "ball_r"),
    ],
)
def test_mirror_exchanges_sides(name, other):
    text = f"version: 1\ntools: [{{name: '{name}', mirror: x, origin: [1, 2, 3], target: [2, 2, 3], width: 1}}]"
    assert [found.name for found in parse_tools(text).tools] == [name, other]


@pytest.mark.parametrize("name", ["brow", "bright", "cleft", "Lip", "browl", "upright", "Leftover"])
def test_a_name_without_a_side_cannot_be_mirrored(name):
    text = HEAD.replace("brow.L", name) + "    width: 1\n    mirror: x\n"
    assert lines_of(text) == [
        f"t.yaml:3: tools[0].name: found {name}, expected a side to exchange for mirror, such as brow.L or left_brow"
    ]


@pytest.mark.parametrize(
    ("axis", "up", "expected"),
    [
        ("x", "y", (-1.0, 2.0, 3.0)),
        ("y", "y", (1.0, -2.0, 3.0)),
        ("z", "y", (1.0, 2.0, -3.0)),
        ("x", "z", (-1.0, 3.0, -2.0)),
        ("y", "z", (1.0, 3.0, 2.0)),
        ("z", "z", (1.0, -3.0, -2.0)),
    ],
)
def test_mirror_negates_the_axis_as_written(axis, up, expected):
    text = f"up: {up}\n{HEAD}    width: 1\n    mirror: {axis}\n"
    assert parse_tools(text).tools[1].origin == expected


def test_a_mirrored_tool_copies_the_rest_and_names_its_source():
    text = EVERYTHING.replace("    enabled: true\n", "    mirror: x\n").replace("head_male", "glove_l")
    source, other = parse_tools(text, name="t.yaml").tools
    assert (other.name, other.target, other.node) == ("brow.R", Marker("brow_top.R"), "glove_r")
    assert other.where == "t.yaml:8: tools[0] (mirrored as brow.R)"
    assert other.place("node") == "t.yaml:9: tools[0] (mirrored as brow.R).node"
    changed = {"name", "origin", "target", "node", "where", "places", "mirrored"}
    for entry in fields(WrinkleTool):
        if entry.name not in changed:
            assert getattr(other, entry.name) == getattr(source, entry.name)


def test_mirror_exchanges_the_driving_morph_target():
    text = HEAD + "    width: 1\n    mirror: x\n    rest_length: {morph: browUpLeft, full: 115%}\n"
    assert [found.rest_length.morph for found in parse_tools(text).tools] == ["browUpLeft", "browUpRight"]


def test_mirror_twice_is_the_source():
    text = HEAD + "    width: 1\n    mirror: x\n"
    there = parse_tools(text).tools[1]
    back = f"version: 1\ntools: [{{name: {there.name}, origin: {list(there.origin)}, "
    back += f"target: {list(there.target)}, width: 1, mirror: x}}]"
    source, again = parse_tools(text).tools[0], parse_tools(back).tools[1]
    assert (again.name, again.origin, again.target) == (source.name, source.origin, source.target)


def test_mirror_order_and_none():
    more = "  - {name: b.L, origin: [0, 0, 0], target: [1, 0, 0], width: 1, mirror: none}\n"
    text = f"defaults: {{mirror: x}}\n{HEAD}    width: 1\n{more}"
    assert [found.name for found in parse_tools(text).tools] == ["brow.L", "brow.R", "b.L"]


def test_mirror_collisions():
    other = "  - {name: brow_R, origin: [0, 0, 0], target: [1, 0, 0], width: 1}\n"
    assert lines_of(f"{HEAD}    width: 1\n    mirror: x\n{other}") == [
        "t.yaml:3: tools[0].name: found brow.L, but its mirrored tool would have the name of tools[1]"
    ]
    across = HEAD.replace("[1, 2, 3]", "[-1, 2, 3]").replace("[1, 4, 3]", "[1, 2, 3]")
    for text in (across, HEAD.replace("[1, ", "[0, ")):
        assert lines_of(f"{text}    width: 1\n    mirror: x\n") == [
            "t.yaml:3: tools[0].name: found brow.L, but its mirrored tool would lie on itself: remove mirror"
        ]


def test_a_missing_end_does_not_lie_on_itself():
    text = HEAD.replace("[1, ", "[0, ").replace("    target: [0, 4, 3]\n", "")
    assert lines_of(f"{text}    width: 1\n    mirror: x\n") == ["t.yaml:3: tools[0].target: required, but missing"]


def test_a_field_has_the_joints_or_the_mesh_of_the_other_side():
    made = parse_tools("{version: 1, fields: [{name: arm.L, mirror: x, joints: [arm_l, hip]}]}").effects
    assert [(each.name, each.joints) for each in made] == [("arm.L", ("arm_l", "hip")), ("arm.R", ("arm_r", "hip"))]
    made = parse_tools("{version: 1, fields: [{name: arm.L, mirror: x, node: sleeve_L}]}").effects
    assert [each.node for each in made] == ["sleeve_L", "sleeve_R"]
    for keys in ("", ", node: shirt", ", joints: all, node: shirt"):
        (line,) = lines_of(f"{{version: 1, fields: [{{name: arm.L, mirror: x{keys}}}]}}")
        assert line.endswith("its mirrored field would lie on itself: remove mirror")
