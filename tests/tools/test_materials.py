"""Materials: what they give a tool, what wins over them, and the reference's table of them."""

import re
from dataclasses import replace

import pytest
import yaml

from kit.tools_text import README, TOOL, first_tool
from wrinklecli.tools.materials import MATERIALS, bump_height, usual_bumps
from wrinklecli.tools.records import WrinkleTool

NAMES = [name for name in TOOL["material"]["enum"] if name is not None]


def given_by(name: str, tool: WrinkleTool) -> dict[str, object]:
    """What the reference's table says of a tool on which nothing but its material is said."""
    return {
        "bumps": usual_bumps(tool.material),
        "width": MATERIALS[name].bump_width if name in MATERIALS else 1.0 / tool.bumps,
        "max_height": bump_height(tool.material),
        "compressible": tool.compressible,
        "profile": tool.profile,
        "details": list(tool.details),
        "variation": tool.variation,
    }


def test_the_reference_s_table_is_the_code_s() -> None:
    table = README.split("## Materials", 1)[1].split("##", 1)[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    columns = [name.strip("`") for name in rows[0][1:-1]]
    assert sorted(columns) == sorted(NAMES) == sorted(["none", *MATERIALS])
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


@pytest.mark.parametrize("name", MATERIALS)
def test_what_is_written_wins_over_the_material_and_the_material_over_none(name: str) -> None:
    plain, given = tool(), tool(f"material: {name}")
    assert plain.bumps == usual_bumps(None)
    assert tool("material: none") == tool("material: none", f"material: {name}") == plain
    assert tool("", f"material: {name}") == tool(f"material: {name}", "material: skin") == given
    own = ["bumps: 7", "max_height: none", "compressible: 5%", "profile: smooth", "details: [0.3]", "variation: 0.7"]
    written = replace(tool("\n".join(own)), material=given.material)
    assert tool("\n".join([f"material: {name}", *own])) == tool(f"material: {name}", ", ".join(own)) == written
    of_material = {key: getattr(given, key) for key in ("bumps", "compressible", "profile", "details", "variation")}
    assert replace(plain, material=given.material, **of_material) == given


@pytest.mark.parametrize(("gap", "bumps"), [(0, 3), (1, 2), (2, 2), (12, 1), (64, 1)])
def test_gaps_leave_fewer_bumps_of_about_the_same_width(gap: int, bumps: int) -> None:
    assert first_tool(f"width: 1\nmaterial: skin\ngap: {gap}").bumps == bumps
