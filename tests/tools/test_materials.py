"""Materials: what they give a tool, what wins over them, and the reference's table of them."""

import re
from dataclasses import replace
from typing import get_args

import pytest
import yaml

from kit.places import ROOT
from kit.tools_text import FILE, HEAD, README, first_tool
from wrinklecli.choices import MaterialName
from wrinklecli.errors import ConfigError
from wrinklecli.tools.materials import presets, usual_bumps
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import Length, WrinkleTool

# Presets are made from them.
SUBSTANCES = {name: presets()[name] for name in get_args(MaterialName)}
NAMES = ["none", *SUBSTANCES]


def given_by(name: str, tool: WrinkleTool) -> dict[str, object]:
    """What the reference's table says of a tool on which nothing but its material is said."""
    return {
        "bumps": usual_bumps(tool.material),
        "width": SUBSTANCES[name].bump_width if name in SUBSTANCES else 1.0 / tool.bumps,
        "max_height": tool.bump_height,
        "compressible": tool.compressible,
        "profile": tool.profile,
        "details": list(tool.details),
        "variation": tool.variation,
    }


def test_the_reference_s_table_is_the_code_s() -> None:
    table = README.split("## Materials", 1)[1].split("##", 1)[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    columns = [name.strip("`") for name in rows[0][1:-1]]
    assert sorted(columns) == sorted(NAMES)
    sources = set(re.findall(r"^- (\w): ", table, re.MULTILINE))
    for row in rows[2:]:
        assert set(row[-1].split(", ")) <= sources
    for column, name in enumerate(columns, 1):
        written = {re.findall(r"\w+", row[0])[0]: yaml.safe_load(row[column].strip("`")) for row in rows[2:]}
        shares = {key: float(value[:-1]) / 100 for key, value in written.items() if str(value).endswith("%")}
        assert written | shares == given_by(name, first_tool(f"width: 1\nmaterial: {name}"))


def tool(more: str = "", defaults: str = "") -> WrinkleTool:
    """A tool wherever it stands."""
    return replace(first_tool(f"width: 1\n{more}", before=f"defaults: {{{defaults}}}\n"), where="")


@pytest.mark.parametrize("name", SUBSTANCES)
def test_what_is_written_wins_over_the_material_and_the_material_over_none(name: str) -> None:
    plain, given = tool(), tool(f"material: {name}")
    assert plain.bumps == usual_bumps(None)
    assert tool("material: none") == tool("material: none", f"material: {name}") == plain
    assert tool("", f"material: {name}") == tool(f"material: {name}", "material: skin") == given
    own = ["bumps: 7", "max_height: none", "compressible: 5%", "profile: smooth", "details: [0.3]", "variation: 0.7"]
    written = replace(tool("\n".join(own)), material=given.material, bump_height=given.bump_height)
    assert tool("\n".join([f"material: {name}", *own])) == tool(f"material: {name}", ", ".join(own)) == written
    of_material = {
        key: getattr(given, key) for key in ("bumps", "bump_height", "compressible", "profile", "details", "variation")
    }
    assert replace(plain, material=given.material, **of_material) == given


@pytest.mark.parametrize(("gap", "bumps"), [(0, 3), (1, 2), (2, 2), (12, 1), (64, 1)])
def test_gaps_leave_fewer_bumps_of_about_the_same_width(gap: int, bumps: int) -> None:
    assert first_tool(f"width: 1\nmaterial: skin\ngap: {gap}").bumps == bumps


def first_of(entries: str, material: str, width: str = "width: 1") -> WrinkleTool:
    """The tool of a file with presets of its own, wherever it stands."""
    return replace(first_tool(f"{width}\nmaterial: {material}", before=f"presets: {entries}\n"), where="")


def test_built_in_entries_are_what_a_file_may_say() -> None:
    for name, each in presets().items():
        built_in = first_tool(f"width: 1\nmaterial: {name}")
        entry = {"bump_width": f"{100 * each.bump_width:g}%", "bump_height": f"{100 * each.bump_height:g}%"}
        own = first_of(yaml.safe_dump({"own": {**entry, **each.keys}}, default_flow_style=True, width=10_000), "own")
        assert own == replace(built_in, material="own", where="")


def test_a_preset_is_made_from_another_and_the_tool_s_keys_win() -> None:
    assert first_of("{felt: {material: cloth, bumps: 2}}", "felt").bumps == 2
    felt, cloth = first_of("{felt: {material: cloth, bumps: 2}}", "felt"), tool("material: cloth")
    assert replace(felt, material="cloth", bumps=cloth.bumps) == cloth
    two = first_of("{felt: {material: cloth, bumps: 2}, thin: {material: felt, width: 40%}}", "thin", width="")
    assert (two.bumps, two.width, two.profile) == (2, Length(40.0, percent=True), "cloth")
    assert first_of("{cloth: {material: cloth, profile: smooth}}", "cloth").profile == "smooth"
    assert first_of("{felt: {bumps: 2}}", "felt", width="width: 1\nbumps: 7").bumps == 7
    assert first_of("{felt: {bump_width: 10%, bump_height: 20%}}", "felt").bumps == 10
    assert first_of("{felt: {bump_height: 20%}}", "felt").bump_height == 0.2


@pytest.mark.parametrize(
    ("before", "material", "line"),
    [
        (
            "presets: {felt: {bumps: 2}}",
            "flet",
            "t.yaml:7: tools[0].material: found flet, expected {names}, felt or none; did you mean felt?",
        ),
        (
            "presets: {felt: {bumps: 0}}",
            "felt",
            "t.yaml:1: presets.felt.bumps: found 0, expected a whole number from 1 to 64",
        ),
        ("presets: {felt: {bupms: 2}}", "felt", "t.yaml:1: presets.felt.bupms: unknown key, did you mean bumps?"),
        (
            "presets: {felt: {material: loden}}",
            "felt",
            "t.yaml:1: presets.felt.material: found loden, expected {any_name}, or a preset above it",
        ),
        (
            "presets: {felt: {material: felt}}",
            "felt",
            "t.yaml:1: presets.felt.material: found felt, expected {any_name}, or a preset above it",
        ),
        (
            "presets: {felt: {details: [0.5, 0.5]}}",
            "felt",
            "t.yaml:1: presets.felt.details: found a list of 2, expected shares whose sum is at most 0.99, not 1",
        ),
        ("presets: {felt: 5}", "felt", "t.yaml:1: presets.felt: found 5, expected a mapping of {preset_keys}"),
        (
            "presets: 5",
            "felt",
            "t.yaml:1: presets: found 5, expected a mapping of names to keys of tools, or a file of such, or a list of"
            " up to 16 files",
        ),
        (
            "presets: {felt: {parts: [knee]}}",
            "felt",
            "t.yaml:1: presets.felt.parts[0]: found knee, expected hips, spine, chest, neck, head, jaw, eye, shoulder,"
            " upper arm, lower arm, hand, palm, finger, upper leg, lower leg, foot, toes or twist",
        ),
        (
            "presets: {felt: {bump_width: 0.3}}",
            "felt",
            "t.yaml:1: presets.felt.bump_width: found 0.3, expected a percentage from 1% to 100%",
        ),
    ],
)
def test_mistakes_in_presets_have_a_line(before: str, material: str, line: str) -> None:
    text = f"{before}\n{HEAD}    material: {material}\n    width: 1\n"
    keys = ", ".join(FILE["presets"]["additionalProperties"]["properties"])
    with pytest.raises(ConfigError) as raised:
        parse_tools(text, name="t.yaml")
    names = [*presets()]
    written = line.format(
        names=", ".join(names), any_name=" or ".join([", ".join(names[:-1]), names[-1]]), preset_keys=keys
    )
    assert [*raised.value.lines] == [written]


def test_a_width_that_nothing_gives_is_missed_once() -> None:
    text = HEAD.replace("tools:", "presets: {felt: {bumps: 2}, wide: {width: 40%}}\ntools:")
    parse_tools(f"{text}    material: wide\n")
    parse_tools(f"defaults: {{material: wide}}\n{text}")
    for material in ("felt", "cloth", "none"):
        for wrong in (
            f"{text}    material: {material}\n",
            f"defaults: {{material: wide}}\n{text}    material: {material}\n",
        ):
            with pytest.raises(ConfigError) as raised:
                parse_tools(wrong)
            assert [each.partition(": ")[2] for each in raised.value.lines] == ["tools[0].width: required, but missing"]


def test_the_reference_s_table_of_presets_is_the_code_s() -> None:
    table = README.split("### Presets", 1)[1].split("\n## ", 1)[0]
    rows = [
        [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        for line in table.splitlines()
        if line[:1] == "|"
    ]
    built_in = yaml.safe_load((ROOT / "wrinklecli/tools/presets.yaml").read_text(encoding="utf-8"))
    made = {name: {"material": "none", **entry} for name, entry in built_in.items() if name not in SUBSTANCES}
    assert [row[0] for row in rows[2:]] == list(made)
    for name, title, material, parts, keys in rows[2:]:
        written = yaml.safe_load(f"{{{keys.replace('`', '')}}}")
        of_parts = {"parts": parts.split(", ")} if parts else {}
        assert {"title": title, "material": material, **of_parts, **written} == made[name]
