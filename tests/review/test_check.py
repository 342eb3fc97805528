"""`wrinkle check`: what it measures, what it warns of, its tables, JSON and pictures."""

import json
import math
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

import wrinklecli
from kit.asset import Asset
from kit.clients import need
from kit.command import Wrinkle, files
from kit.fields import sleeve_and_field
from kit.golden import Golden
from kit.limb import RADIUS, cuffed_limb, limb, limb_asset, tool, write_tools
from kit.places import ROOT
from kit.player import Json
from kit.samples import BACK, PALM, sample
from kit.sheet import REACH, arc, line, sheet
from wrinklecli.effects.wrinkle import warnings as tool_warnings
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric import rays
from wrinklecli.review.check import Check, check

Floats = NDArray[np.float64]

WRIST = str(sample("wrist"))


def across(y: float = 0.0, **keys: Any) -> Json:
    """The tool from one end of a sheet to the other."""
    return {"name": "tool", "origin": [-REACH, y, 0.0], "target": [REACH, y, 0.0], "width": 0.3, "bumps": 2, **keys}


def checked(asset: Path, *tools: Json, **options: Any) -> Check:
    return check(asset, write_tools(asset.parent / "tools.yaml", *tools), **options)


def warnings(asset: Path, *tools: Json, about: str, **options: Any) -> list[str]:
    """The warnings with these words in them."""
    return [line for line in checked(asset, *tools, **options).warnings if about in line]


def path(name: str, *places: tuple[float, float], **keys: Any) -> Json:
    """A tool of a limb with a path through points given by x and degrees from the top."""
    turns = [(x, math.radians(degrees)) for x, degrees in places]
    points = [[x, RADIUS * math.cos(turn), RADIUS * math.sin(turn)] for x, turn in turns]
    return {"name": name, "path": points, "width": 0.2, **keys}


@pytest.mark.slow
def test_it_says_where_a_path_bends_too_sharply_or_leaves_the_mesh(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", rings=33, sides=24)
    zigzag = path("sharp", (-0.4, 0), (0.1, 20), (0.1, -30), (0.5, 0), width=0.5)
    sparse = path("sparse", (-0.3, -80), (0.0, 0), (0.3, -130))
    good = path("good", (-0.4, -30), (0.0, 0), (0.4, 40))
    sharp, beside = warnings(asset, zigzag, sparse, good, about="its path")
    assert re.fullmatch(
        r"sharp: its path bends with a radius of 0\.1\d* near path\[2\], less than half its width of 0\.5:"
        r" on the inside wrinkles end before they would meet",
        sharp,
    )
    assert re.fullmatch(
        r"sparse: its path is 0\.1\d* beside the mesh between path\[1\] and path\[2\], which are 0\.5\d* apart:"
        r" a point there keeps it on the surface",
        beside,
    )
    found = checked(asset, good).data["tools"][0]
    assert (len(found["between"]), found["between"][0]["off"] < 1e-3) == (1, True)


# --- What is measured ---


@pytest.mark.slow
@pytest.mark.parametrize("levels", [0, None])
def test_it_says_what_a_bake_then_does(levels: int | None, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM, {**BACK, "strategy": "both_ends"})
    found = check(WRIST, tools, max_levels=levels)
    report = wrinklecli.bake(WRIST, tools, tmp_path / "out.glb", max_levels=levels, details=True)
    (mesh,), (baked,) = found.data["meshes"], report.data["meshes"]
    assert mesh["vertices"] + mesh["new_vertices"] == baked["vertices"]
    assert mesh["triangles"] + mesh["new_triangles"] == baked["triangles"]
    assert mesh["levels"] == baked["levels"]
    for ours, theirs in zip(found.data["tools"], report.data["tools"], strict=True):
        for key in ("moved_vertices", "scheme", "hard_edges", "departure"):
            assert ours[key] == theirs[key]
        assert ours["rest_length"] == pytest.approx(theirs["rest_length"])
        assert [ours[end]["off"] for end in ("origin", "target")] == pytest.approx(theirs["anchor_distances"])
        for clip in ours["clips"]:
            (entry,) = (each for each in report.data["clips"] if each["name"] == clip["name"])
            (frames,) = (each for each in entry["tools"] if each["name"] == ours["name"])
            shares = 1 - np.array(frames["distance"]) / frames["rest_length"]
            assert clip["shortening"] == pytest.approx([shares.min(), shares.max()], abs=1e-8)
            assert entry["times"][int(shares.argmax())] == clip["time"]
            assert clip["height"] == frames["tallest"]


BLOCK = line(0.45, -0.45, 0.05)  # above a sheet, closer than its wrinkles are tall
WARNED: dict[str, tuple[Callable[[Path], Path], list[Json], list[str]]] = {
    "a limb": (
        lambda path: limb(path, morphs=1),
        [
            tool(name="twice", strength=2.0, clips={"absent": 1.0}, optional=True),
            tool(name="far", origin=[-0.4, RADIUS + 0.1, 0.0]),
            tool(name="still", origin=[-0.95, RADIUS, 0.0], target=[-0.65, RADIUS, 0.0], bumps=20),
            tool(name="full", max_height="1%", origin=[-0.4, RADIUS, 0.01], variation=0),
            tool(name="gone", node="hand", optional=True),
            tool(name="mute", strength=0),
        ],
        [
            "twice: strength 2",
            "twice: the asset has no clip 'absent'",
            "gone: left out",
            "mute: left out",
            "limb: fold gets a weights channel",
            "twice and full: lie nearly on top",
            "far: its origin is 0.1 from the mesh",
            "still: never shortens in fold",
            "full: 81 % of its length is not absorbed",
            "limb: 88 edges are still too long",
        ],
    ),
    "sheets": (
        lambda path: sheet(path, line(-0.5, 0.5), BLOCK),
        [across(), across(name="wide", width=30.0, strength=-1)],
        [
            "tool: wrinkles are taller",
            "wide: its width of 30 is 38 times its segment of 0.8",
            "tool and wide: lie nearly on top",
        ],
    ),
    "folds": (
        lambda path: sheet(path, arc(150.0), line(-0.5, -0.2, -2.0), line(0.2, 0.5, -2.0)),
        [across(), across(-2.0, name="gap", strength=0.1)],
        ["tool: the surface below its segment is", "gap: 50 % of its segment has no surface"],
    ),
    "coarse": (
        lambda path: limb(path, rings=12, sides=10),
        [tool(strength=0.25)],
        ["crease: refinement moves the surface at rest"],
    ),
}


@pytest.mark.quick(1)
@pytest.mark.parametrize("case", WARNED)
def test_check_and_bake_give_the_same_warnings(case: str, tmp_path: Path) -> None:
    build, tools, starts = WARNED[case]
    asset = build(tmp_path / "asset.glb")
    options = {"max_levels": 2 if case == "coarse" else 1}
    of_check = checked(asset, *tools, **options)
    found = wrinklecli.bake(asset, tmp_path / "tools.yaml", tmp_path / "out.glb", **options).warnings
    # A track of weights is the bake's: `check` notes it.
    assert sorted(found) == sorted((*of_check.warnings, *of_check.data["notes"]))
    assert ["gets a weights channel" in note for note in of_check.data["notes"]] == [True] * (case == "a limb")
    for words in starts:
        assert [each for each in found if each.startswith(words)], (words, found)


def test_the_warning_and_the_check_name_the_compressible_that_absorbs_all(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb")
    found = checked(asset, tool(max_height="6%"), max_levels=0)
    fitting = math.ceil(100 * found.data["tools"][0]["fitting_compressible"])
    (warning,) = [line for line in found.warnings if "not absorbed" in line]
    assert 0 < fitting <= 95
    assert f"compressible: {fitting}% has them reach it there" in warning
    after = checked(asset, tool(max_height="6%", compressible=f"{fitting}%"), max_levels=0)
    assert not [line for line in after.warnings if "not absorbed" in line]
    assert after.data["tools"][0]["fitting_compressible"] == found.data["tools"][0]["fitting_compressible"]
    (clip,) = after.data["tools"][0]["clips"]
    assert clip["unabsorbed"] == 0.0
    # Just full: no bump stays far below its greatest height, which it has where some length is not absorbed.
    assert 0.95 < clip["height"] / found.data["tools"][0]["clips"][0]["height"] <= 1.0


def test_edges_split_are_the_new_vertices_where_one_tool_splits_them(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", seam=False)
    data = checked(asset, tool()).data
    assert data["tools"][0]["edges_split"] > 100
    # Closing the refinement splits a few edges beside the patch as well.
    assert (
        0.9 * data["meshes"][0]["new_vertices"] <= data["tools"][0]["edges_split"] <= data["meshes"][0]["new_vertices"]
    )
    assert checked(asset, tool(), max_levels=0).data["tools"][0]["edges_split"] == 0


@pytest.mark.quick(1)
@pytest.mark.parametrize("primitives", [1, 3])
@pytest.mark.parametrize("up", ["y", "z"])
def test_anchors_are_where_the_named_vertex_is_in_the_file_s_axes(up: str, primitives: int, tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", primitives=primitives)
    x, height = 0.41, RADIUS + 0.01
    place = [x, height, 0.0] if up == "y" else [x, 0.0, height]
    ends: Json = {"origin": [-place[0], *place[1:]], "target": place}
    tools = write_tools(tmp_path / "tools.yaml", tool(**ends, snap="vertex"), up=up)
    (found,) = check(asset, tools).data["tools"]
    document = read_document(asset)
    stored = document.items("meshes")[0]["primitives"]
    for end in ("origin", "target"):
        anchor = found[end]
        x, y, z = document.accessor(stored[anchor["primitive"]]["attributes"]["POSITION"])[anchor["vertex"]]
        assert anchor["position"] == pytest.approx([x, y, z] if up == "y" else [x, -z, y])
        assert anchor["off"] == pytest.approx(np.linalg.norm(np.array(anchor["position"]) - ends[end]), abs=1e-6)
    assert {found["origin"]["primitive"], found["target"]["primitive"]} == ({0} if primitives == 1 else {0, 2})


@pytest.mark.slow
def test_overlaps_are_the_vertices_that_both_tools_move(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb")
    tools = [
        tool(name="a"),
        tool(name="b", origin=[0.0, RADIUS, 0.0], target=[0.6, RADIUS, 0.0]),
        tool(name="c", origin=[-0.4, -RADIUS, 0.0], target=[0.4, -RADIUS, 0.0]),
    ]
    found = checked(asset, *tools)
    moved = [set(each.part.vertices.tolist()) for each in found.tools]
    shared = len(moved[0] & moved[1])
    assert shared > 10
    assert [each["overlaps"] for each in found.data["tools"]] == [
        [{"tool": "b", "vertices": shared}],
        [{"tool": "a", "vertices": shared}],
        [],
    ]


def test_stretching_is_negative_and_a_hidden_character_has_no_shortening(tmp_path: Path) -> None:
    asset = limb_asset()
    animation: Json = {"name": "hide"}
    asset.channel(animation, 1, "scale", [0.0, 1.0], [[0.0] * 3] * 2)
    asset.append("animations", animation)
    outer = tool(origin=[-0.4, -RADIUS, 0.0], target=[0.4, -RADIUS, 0.0])
    clips = checked(asset.write(tmp_path / "limb.glb"), outer, max_levels=0).data["tools"][0]["clips"]
    assert clips[0]["name"] == "fold"
    assert clips[0]["shortening"][0] < -0.15
    assert clips[0]["shortening"][1] == pytest.approx(0.0, abs=1e-6)
    assert clips[1] == {
        "name": "hide",
        "strength": 1.0,
        "shortening": None,
        "time": None,
        "unabsorbed": 0.0,
        "height": 0.0,
    }


def test_problems_of_all_tools_on_all_meshes_are_reported_at_once(tmp_path: Path) -> None:
    asset = limb_asset()
    asset.append("nodes", {"name": "twin", "mesh": 0, "skin": 0})
    path = asset.write(tmp_path / "limb.glb")
    off: Json = {"origin": [0.0, 9.0, 0.0]}
    tools = [tool(name=f"{node}{k}", node=node, **off) for node in ("limb", "twin") for k in range(2)]
    for run in (check, wrinklecli.bake):
        with pytest.raises(WrinkleError) as caught:
            run(path, write_tools(tmp_path / "tools.yaml", *tools))
        assert [line.split(".origin")[0].rpartition(" ")[2] for line in caught.value.lines] == [
            f"tools[{k}]" for k in range(4)
        ]


# --- What is wrong with places ---


@pytest.mark.quick(1)
@pytest.mark.parametrize("degrees", [20.0, 90.0, 130.0, 150.0, 165.0])
def test_a_segment_across_a_bulge_is_warned_of_by_how_long_the_surface_below_is(degrees: float, tmp_path: Path) -> None:
    half = np.radians(degrees) / 2
    lines = warnings(sheet(tmp_path / "a.glb", arc(degrees)), across(), about="times as long")
    wanted = half / np.sin(half)
    assert lines == (
        [f"tool: the surface below its segment is {wanted:.2f} times as long: it reaches across a fold"]
        if wanted > 1.3
        else []
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize("gap", [0.0, 0.02, 0.3])
def test_a_segment_over_a_gap_is_warned_of_by_its_share(gap: float, tmp_path: Path) -> None:
    asset = sheet(tmp_path / "a.glb", line(-0.5, -gap / 2), line(gap / 2, 0.5))
    lines = warnings(asset, across(), about="has no surface below")
    assert bool(lines) == (gap > 0.05 * 2 * REACH)
    if lines:
        share = float(lines[0].split(" % ")[0].split()[-1])
        assert share == pytest.approx(100 * gap / (2 * REACH), abs=2.0)


@pytest.mark.quick(1)
@pytest.mark.parametrize("fold", [0.0, 0.1, 0.2])
def test_a_patch_over_two_layers_is_warned_of_by_their_share(fold: float, tmp_path: Path) -> None:
    # Forward on top, back below it, forward again below that: between -fold and fold there are two layers that face up.
    lines_ = [line(-0.5, fold, 0.1), line(fold, -fold, 0.05), line(-fold, 0.5, 0.0)] if fold else [line(-0.5, 0.5)]
    asset = sheet(tmp_path / "a.glb", np.concatenate(lines_))
    ends: Json = {"origin": [-REACH, 0.1 if fold else 0.0, 0.0], "target": [REACH, 0.0, 0.0]}
    lines = warnings(asset, across(**ends), about="two layers")
    assert bool(lines) == (fold > 0)
    if lines:
        share = float(lines[0].split(" % ")[0].split()[-1])
        assert share == pytest.approx(100 * 2 * fold / (2 * REACH), abs=8.0)


@pytest.mark.slow
@pytest.mark.parametrize("strength", [1.0, -1.0])
@pytest.mark.parametrize("share", [0.1, 0.9, 1.1])
def test_wrinkles_taller_than_the_room_are_warned_of(strength: float, share: float, tmp_path: Path) -> None:
    ruled = {"strength": strength, "variation": 0}
    alone = checked(sheet(tmp_path / "a.glb", line(-0.5, 0.5)), across(**ruled)).data["tools"][0]
    height = alone["clips"][0]["height"]
    room = share * height
    # Of one piece, as wrinkles stay below another.
    folded = np.concatenate([line(-0.5, 0.5), line(0.45, -0.45, np.sign(strength) * room)])
    asset = sheet(tmp_path / "a.glb", folded)
    lines = warnings(asset, across(**ruled), about="opposite surface")
    assert bool(lines) == (share < 1)
    if lines:
        assert f"{height:.3g} where there is room for {room:.3g} at rest, near [" in lines[0]
    # The other way, there is nothing.
    assert not warnings(asset, across(strength=-strength), about="opposite surface")
    # Nor is there where no clip that is looked at raises them so far.
    calm = {"strength": strength, "clips": {"squeeze": 0.2 * strength}}
    assert bool(warnings(asset, across(**calm), about="opposite surface")) == (share < 0.2)


def test_without_clips_the_tallest_wrinkles_possible_count(tmp_path: Path) -> None:
    asset = sheet(tmp_path / "a.glb", line(-0.5, 0.5), line(0.45, -0.45, 0.05), clip=False)
    assert warnings(asset, across(max_height=0.06), about="opposite surface")
    assert not warnings(asset, across(max_height=0.04), about="opposite surface")


def test_a_wrinkle_into_a_limb_has_the_room_of_its_thickness(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", clip=None, joints=1)
    deep = tool(origin=[-0.9, RADIUS, 0.0], target=[0.9, RADIUS, 0.0], strength=-1, bumps=1)
    lines = warnings(asset, {**deep, "max_height": 2.1 * RADIUS}, about="opposite surface")
    assert f"where there is room for {2 * RADIUS:.3g} at rest" in lines[0]
    assert not warnings(asset, {**deep, "max_height": 1.9 * RADIUS}, about="opposite surface")


@pytest.mark.slow
def test_collisions_are_the_same_in_small_portions_and_found_among_fewer_vertices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset = sheet(tmp_path / "a.glb", np.concatenate([line(-0.5, 0.5), line(0.45, -0.45, 0.05)]))
    whole = warnings(asset, across(), about="opposite surface")
    assert len(whole) == 1
    monkeypatch.setattr(rays, "portions_of", lambda widths: [slice(k, k + 1) for k in range(len(widths))])
    assert warnings(asset, across(), about="opposite surface") == whole
    monkeypatch.setattr(tool_warnings, "_MOST_PAIRS", 500)
    thinned = warnings(asset, across(), about="opposite surface")
    assert len(thinned) == 1
    assert thinned != whole


@pytest.mark.quick(0, 3)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("shift", "near"), [(0.02, True), (0.07, True), (0.09, False)])
def test_tools_nearly_on_top_of_each_other_are_warned_of(
    shift: float, near: bool, turned: bool, tmp_path: Path
) -> None:
    asset = sheet(tmp_path / "a.glb", line(-0.5, 0.5))
    ends = [[-REACH, 0.0, shift], [REACH, 0.0, shift]]
    second = across(name="other", origin=ends[turned], target=ends[not turned])
    words = "lie nearly on top of each other"
    assert warnings(asset, across(), second, about=words) == (
        ["tool and other: lie nearly on top of each other, and their heights add up"] if near else []
    )
    # Those that never act together do not add up.
    assert not warnings(asset, across(clips={"squeeze": 0}), second, about=words)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("height", "far"), [(0.0, False), (0.03, False), (0.1, True)])
def test_an_anchor_far_from_the_mesh_is_warned_of(height: float, far: bool, tmp_path: Path) -> None:
    asset = sheet(tmp_path / "a.glb", line(-0.5, 0.5))
    lines = warnings(asset, across(origin=[-REACH, height, 0.0]), about="from the mesh")
    assert bool(lines) == far
    if far:
        assert lines[0].startswith("tool: its origin is 0.1 from the mesh, 12 % of its segment")


# --- The command ---


def test_json_has_these_keys(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM, BACK)
    ran = wrinkle("check", WRIST, "tools.yaml", "--json")
    assert ran.code == 0
    data = json.loads(ran.out)
    assert list(data) == ["check", "asset", "tools_file", "meshes", "tools", "notes", "warnings"]
    assert data["check"] == 1
    assert list(data["meshes"][0]) == ["node", "vertices", "new_vertices", "triangles", "new_triangles", "levels"]
    assert list(data["tools"][0]) == [
        "name",
        "node",
        "where",
        "origin",
        "target",
        "distance",
        "rest_length",
        "width",
        "laid",
        "material",
        "bumps",
        "strategy",
        "compressible",
        "lag",
        "height_limit",
        "triangles",
        "edges_split",
        "moved_vertices",
        "scheme",
        "hard_edges",
        "departure",
        "overlaps",
        "fitting_compressible",
        "clips",
        "warnings",
    ]
    assert list(data["tools"][0]["origin"]) == ["position", "off", "primitive", "vertex"]
    assert list(data["tools"][0]["clips"][0]) == ["name", "strength", "shortening", "time", "unabsorbed", "height"]
    assert sorted(files(tmp_path)) == ["tools.yaml"]


def test_tables_are_on_standard_output_and_nothing_is_written(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM, BACK)
    ran = wrinkle("check", WRIST, "tools.yaml", "--clip", "flex", "--max-levels", "0", "-v")
    assert (ran.code, ran.lines) == (0, [])
    lines = ran.out.splitlines()
    assert [line for line in lines if line.endswith(" on wrist")] == ["palm on wrist", "back on wrist"]
    clips = [line for line in lines if line.strip().startswith("flex")]
    assert [line.split("%")[0].split()[-1] for line in clips] == ["56", "0"]
    assert "warning: back: never shortens in flex: no wrinkle" in lines
    assert not [line for line in lines if "extend" in line]
    assert "\x1b" not in ran.out
    assert sorted(files(tmp_path)) == ["tools.yaml"]


def test_each_tool_has_a_row_that_says_what_to_look_at(wrinkle: Wrinkle, tmp_path: Path) -> None:
    write_tools(tmp_path / "tools.yaml", PALM, BACK)
    ran = wrinkle("check", WRIST, "tools.yaml", "--clip", "flex", "--max-levels", "0")
    rows = [line.split(maxsplit=2) for line in ran.out.splitlines() if " on " not in line]
    assert ["back", "wrist", "never shortens in flex: no wrinkle"] in rows
    assert "origin" not in ran.out
    write_tools(tmp_path / "calm.yaml", {**PALM, "bumps": 2, "max_height": "none", "compressible": "90%"})
    calm = wrinkle("check", WRIST, "calm.yaml", "--clip", "flex", "--max-levels", "0")
    assert "palm  wrist  good" in calm.out.splitlines()


@pytest.mark.slow
def test_strict_refuses_warnings_and_errors_are_1(wrinkle: Wrinkle, tmp_path: Path) -> None:
    need("matplotlib")
    write_tools(tmp_path / "tools.yaml", PALM, BACK, refinement={})
    ran = wrinkle("check", WRIST, "tools.yaml", "--clip", "flex", "--strict")
    assert ran.code == 3
    assert "never shortens" in ran.out
    assert ran.lines == ["tools.yaml: refused by --strict: 2 warnings"]
    # Refused, it writes nothing.
    assert wrinkle("check", WRIST, "tools.yaml", "--clip", "flex", "--strict", "--plot", "a.svg").code == 3
    assert sorted(files(tmp_path)) == ["tools.yaml"]
    calm = {**PALM, "bumps": 2, "max_height": "none"}
    write_tools(tmp_path / "calm.yaml", calm, refinement={})
    assert wrinkle("check", WRIST, "calm.yaml", "--strict").code == 0
    write_tools(tmp_path / "bad.yaml", {**PALM, "origin": [9, 9, 9]})
    failed = wrinkle("check", WRIST, "bad.yaml", "--strict")
    assert (failed.code, failed.out, len(failed.lines)) == (1, "", 1)
    assert wrinkle("check", WRIST, "bad.yaml", "--plot", "a.jpg").code == 2
    assert wrinkle("check", WRIST).code == 2


def test_names_cannot_command_a_terminal(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb_asset()
    asset.gltf["nodes"][0]["name"] = "\x1b[31mred\n"
    asset.gltf["animations"][0]["name"] = "\x1b]0;x\x07"
    asset.write(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml", tool(name="a\nb"))
    ran = wrinkle("check", "limb.glb", "tools.yaml")
    assert ran.code == 0
    assert not set("\x1b\x07") & set(ran.out)
    assert "a\\nb  \\x1b[31mred\\n  " in ran.out


# --- Rounding at rest ---


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("asset", "row"),
    [
        (limb_asset(rings=12, sides=10), "at rest  rounded by up to 12 % of the tallest wrinkle"),
        (
            cuffed_limb(rings=12, sides=10),
            "at rest  rounded by up to 12 % of the tallest wrinkle; 5.8 % of the edges are hard",
        ),
        (limb_asset(rings=12, sides=10, normals=False), "at rest  as it was; 100 % of the edges are hard"),
    ],
    ids=["smooth", "hard edge", "faceted"],
)
def test_a_row_says_how_much_the_surface_is_rounded_at_rest(
    asset: Asset, row: str, wrinkle: Wrinkle, tmp_path: Path
) -> None:
    asset.write(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml", tool(variation=0), refinement={})
    assert f"  {row}" in wrinkle("check", "limb.glb", "tools.yaml", "--verbose").out.splitlines()


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("scheme", "strength", "ends"),
    [
        ("butterfly", 0.25, "scheme: midpoint keeps it as it is"),
        ("butterfly_full", 0.5, "scheme: midpoint keeps it as it is, butterfly nearly"),
        ("butterfly", 1.0, None),
        ("midpoint", 0.25, None),
    ],
)
def test_warned_where_much_of_a_wrinkle_s_height_shows_at_rest(
    scheme: str, strength: float, ends: str | None, tmp_path: Path
) -> None:
    asset = limb_asset(rings=12, sides=10).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(strength=strength), refinement={"scheme": scheme})
    made = check(asset, tools)
    lines = [line for line in made.warnings if "moves the surface at rest" in line]
    share = f"{100 * made.data['tools'][0]['departure']:.0f} % of the tallest wrinkle"
    assert [line.endswith(str(ends)) and share in line for line in lines] == [True] * (ends is not None)


# --- The picture ---


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("kind", ["svg", pytest.param("png", marks=pytest.mark.slow)])
def test_a_picture_is_the_same_in_every_process(wrinkle: Wrinkle, tmp_path: Path, kind: str) -> None:
    need("matplotlib")
    write_tools(tmp_path / "tools.yaml", PALM, BACK)
    (tmp_path / "folder").mkdir()
    here, there = tmp_path / f"plot.{kind}", tmp_path / "folder" / f"plot.{kind}"
    assert wrinkle("check", WRIST, "tools.yaml", "--plot", here).code == 0
    command = [sys.executable, "-c", "from wrinklecli.cli import main; main()", "check", WRIST, "tools.yaml"]
    environment = {**os.environ, "PYTHONHASHSEED": "1", "TZ": "UTC1"}
    subprocess.run(
        [*command, "--plot", str(there)], cwd=tmp_path, env=environment, check=True, stdout=subprocess.DEVNULL
    )
    made = here.read_bytes()
    assert made == there.read_bytes()
    assert made.startswith(b"\x89PNG" if kind == "png" else b"<?xml")


@pytest.mark.slow
def test_a_picture_shows_names_as_they_are(wrinkle: Wrinkle, tmp_path: Path) -> None:
    need("matplotlib")
    asset = limb_asset()
    asset.gltf["animations"][0]["name"] = "_$\\frac{<a>&"
    asset.write(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml", tool(name="$x$ 額\n\x1b" + "n" * 500), tool(name="keyed", rest_length="120%"))
    ran = wrinkle("check", "limb.glb", "tools.yaml", "--plot", "a.svg")
    assert (ran.code, ran.lines) == (0, [])
    text = (tmp_path / "a.svg").read_text()
    ET.fromstring(text)
    # Text is drawn as outlines, with what it says in a comment before each.
    assert "<!--  _$\\frac{&lt;a&gt;&amp; -->" in text
    assert "<!-- $x$ \N{CJK UNIFIED IDEOGRAPH-984D}" in text
    assert "n" * 60 not in text


@pytest.mark.slow
def test_a_clip_and_a_tool_that_never_act_are_drawn_too(wrinkle: Wrinkle, tmp_path: Path) -> None:
    need("matplotlib")
    limb(tmp_path / "limb.glb", clip=None, morphs=1)
    write_tools(tmp_path / "tools.yaml", tool(details=[0.2], profile="polyline", strategy="origin"))
    assert wrinkle("check", "limb.glb", "tools.yaml", "--plot", "a.png").code == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_takes_no_input_s_place(wrinkle: Wrinkle, tmp_path: Path) -> None:
    need("matplotlib")
    asset = limb_asset()
    asset.write(tmp_path / "limb.svg")
    write_tools(tmp_path / "tools.yaml")
    before = files(tmp_path)
    ran = wrinkle("check", "limb.svg", "tools.yaml", "--plot", "./limb.svg")
    assert ran.code == 1
    assert "would be overwritten" in ran.lines[0]
    assert files(tmp_path) == before


@pytest.mark.slow
def test_a_plot_looks_as_before(tmp_path: Path, wrinkle: Wrinkle, golden: Golden) -> None:
    need("matplotlib")
    tools = write_tools(tmp_path / "tools.yaml", PALM, BACK)
    assert wrinkle("check", WRIST, tools, "--max-levels", "0", "--plot", "plot.png").code == 0
    golden.picture(tmp_path / "plot.png", "plot.png", reduced=4)


def test_without_matplotlib_it_says_what_to_install(
    wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    write_tools(tmp_path / "tools.yaml", PALM)
    ran = wrinkle("check", WRIST, "tools.yaml", "--plot", "a.svg")
    assert (ran.code, ran.out) == (1, "")
    assert ran.lines == ["--plot needs matplotlib: pip install 'wrinklecli[plot]'"]
    assert wrinkle("check", WRIST, "tools.yaml").code == 0


# What moves an asset besides its own clips


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("options", "is_said"),
    [
        ({"morphs": 1}, True),
        ({"morphs": 1, "tracks": "none"}, False),
        ({"morphs": 1, "morph_clip": "LINEAR"}, False),
        ({}, False),
    ],
)
def test_a_clip_that_gets_a_weights_channel_is_told_where_morph_targets_were_free(
    tmp_path: Path, options: Json, *, is_said: bool
) -> None:
    tracks = {"tracks": options.pop("tracks")} if "tracks" in options else {}
    report = wrinklecli.bake(
        limb(tmp_path / "limb.glb", rings=8, sides=6, **options),
        write_tools(tmp_path / "tools.yaml", tool()),
        tmp_path / "out.glb",
        max_levels=0,
        **tracks,
    )
    assert any("weights channel" in line for line in report.data["warnings"]) == is_said


@pytest.mark.slow
def test_an_asset_without_clips_is_checked_in_its_range_of_motion(tmp_path: Path, wrinkle: Wrinkle) -> None:
    path = limb(tmp_path / "limb.glb", clip=None, morphs=1, joints=3)
    tools = write_tools(tmp_path / "tools.yaml", tool(origin=[-0.7, 0.25, 0], target=[0.05, 0.25, 0]))
    found = check(path, tools)
    (note,) = found.data["notes"]
    assert "has no clip; looked at in 13 motions of 2 joints and 1 morph target" in note
    clips = found.data["tools"][0]["clips"]
    # Those that shorten it, most first; the other joint's and those that part its ends are left out.
    assert clips[0]["name"] == "joint_1 about z, +90°"
    assert {clip["name"].split()[0] for clip in clips} == {"joint_1", "morph_0"}
    shortenings = [clip["shortening"][1] for clip in clips]
    assert shortenings == sorted(shortenings, reverse=True)
    assert shortenings[-1] > 0
    # A bake has none of these clips.
    assert not any("weights channel" in line for line in found.warnings)
    ran = wrinkle("check", path, tools)
    assert note in ran.out
    named = write_tools(tmp_path / "named.yaml", tool(clips={"walk": 0.5}))
    with pytest.raises(WrinkleError, match="no clip 'walk'; there are none"):
        check(path, named)
    (alone,) = check(path, tools, clips=["morph_0"]).data["tools"]
    assert [clip["name"] for clip in alone["clips"]] == ["morph_0"]
    assert any("joint_1" in clip["name"] for clip in check(path, tools, range_of_motion=True).data["tools"][0]["clips"])


@pytest.mark.slow
def test_a_pose_takes_the_place_of_clips(tmp_path: Path, wrinkle: Wrinkle) -> None:
    path, tools = limb(tmp_path / "limb.glb", morphs=1), write_tools(tmp_path / "tools.yaml")
    (folded,) = check(path, tools).data["tools"][0]["clips"]
    # The clip folds by 100°.
    (posed,) = check(path, tools, pose=[("joint_1", "z", 100.0)]).data["tools"][0]["clips"]
    assert posed["name"] == "joint_1=z:100"
    assert posed["shortening"] == pytest.approx([folded["shortening"][1]] * 2, abs=1e-6)
    ran = wrinkle(
        "check", path, tools, "--json", "--pose", "joint_1=z:60", "--pose", "joint_1=z:40", "--morph=morph_0=0"
    )
    (twice,) = json.loads(ran.out)["tools"][0]["clips"]
    assert twice["shortening"] == pytest.approx(posed["shortening"], abs=1e-6)
    for option, message in (
        ("--pose=joint_1=w:9", "JOINT=AXIS:DEGREES"),
        ("--morph=morph_0", "NAME=WEIGHT"),
        ("--morph=morph_0=nan", "NAME=WEIGHT"),
        ("--pose=joint_1=z:9 --clip=fold", "without '--clip'"),
    ):
        ran = wrinkle("check", path, tools, *option.split())
        assert ran.code == 2
        assert message in " ".join(ran.lines)
    ran = wrinkle("check", path, tools, "--pose", "joint1=z:9")
    assert ran.code == 1
    assert "did you mean 'joint_1'?" in ran.lines[0]


@pytest.mark.slow
def test_clips_of_other_files_are_checked(tmp_path: Path) -> None:
    whole, body = limb(tmp_path / "whole.glb"), limb(tmp_path / "body.glb", clip=None)
    tools = write_tools(tmp_path / "tools.yaml")
    (expected,), (found,) = (
        check(path, tools, anims=anims).data["tools"][0]["clips"] for path, anims in ((whole, []), (body, [whole]))
    )
    assert found == expected


@pytest.mark.slow
def test_teeth_are_named_with_their_clip_and_time(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb")
    tall = tool(max_height="none", bumps=3, width=0.4)
    (line,) = warnings(asset, {**tall, "strength": 4}, about="triangles over")
    assert re.fullmatch(
        r"crease: turns \d+ triangles over in fold at 1 s, which shows as teeth or dark tiles: .*", line
    )
    assert not warnings(asset, {**tall, "strength": 0.5}, about="triangles over")
    (kept,) = warnings(asset, {**tall, "creases": "keep"}, about="triangles over")
    assert kept.endswith("creases: lower avoids it")
    assert not warnings(asset, tall, about="triangles over")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["wrist", "head", "head_keyed", "body"])
def test_the_samples_have_no_teeth_and_no_warning(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not those of trousers, whose knees bend by more than 90°, and hide a few such triangles in the fold."""
    monkeypatch.setattr("wrinklecli.effects.faults._SEEN", 0.0)
    found = check(sample(name.split("_")[0]), ROOT / "configs" / f"{name}.yaml")
    assert not [line for line in found.warnings if "over in" in line or name != "body"]


@pytest.mark.slow
def test_a_field_says_how_its_joints_turn_and_how_far_clips_fold_it(wrinkle: Wrinkle, tmp_path: Path) -> None:
    """Beside a tool, which is checked as ever."""
    asset, tools = sleeve_and_field(tmp_path, clips={"wave": 0.5})
    tools.write_text(json.dumps(yaml.safe_load(tools.read_text()) | {"tools": [tool(node="limb")]}))
    ran = wrinkle("check", asset, tools, "-v")
    assert ran.code == 0, ran.lines
    assert "folds on limb" in ran.out
    assert re.search(r"\n +(turns +)?joint_1  -20 to 25°, [1-9] shapes?\n", ran.out)
    assert re.search(r"\n +(turns +)?joint_2  0 to 50°, [1-9] shapes?\n", ran.out)
    heights = re.search(
        r"\n  fold  folds by up to (0\.0\d+), at [\d.]+ s\n  wave  folds by up to (0\.0\d+), at [\d.]+ s\n", ran.out
    )
    assert heights is not None
    data = check(asset, tools).data
    (entry,) = data["fields"]
    assert [each["height"] for each in entry["clips"]] == pytest.approx(
        [float(each) for each in heights.groups()], 0.01
    )
    assert entry["clips"][0]["height"] > 2.0 * entry["clips"][1]["height"]
    assert sorted(each["joint"] for each in entry["turns"]) == ["joint_1", "joint_1", "joint_2"]
    assert all(1 <= each["shapes"] <= len(entry["targets"]) for each in entry["turns"])
    assert [each["name"] for each in data["tools"]] == [tool()["name"]]


@pytest.mark.slow
def test_a_field_is_checked_in_those_motions_of_a_range_of_motion_that_turn_its_joints(tmp_path: Path) -> None:
    _, tools = sleeve_and_field(tmp_path, joints=["joint_2"])
    asset = limb(tmp_path / "limb.glb", rings=16, sides=10, joints=3, clip=None)
    (entry,) = check(asset, tools).data["fields"]
    assert entry["clips"]
    assert all(each["height"] > 0 and each["name"].startswith("joint_2") for each in entry["clips"])


@pytest.mark.slow
@pytest.mark.long
def test_a_pose_in_place_of_clips_is_no_want_of_clips(tmp_path: Path) -> None:
    asset, tools = sleeve_and_field(tmp_path)
    made = check(asset, tools, pose=[("joint_1", "z", 30.0)])
    assert not [line for line in made.warnings if "there is no clip" in line]
    (clip,) = made.data["fields"][0]["clips"]
    assert clip["height"] > 0.01
    still = limb(tmp_path / "limb.glb", rings=16, sides=10, joints=3, clip=None)
    assert not [line for line in check(still, tools).warnings if "there is no clip" in line]


@pytest.mark.slow
def test_a_picture_of_no_control_curve_is_refused(wrinkle: Wrinkle, tmp_path: Path) -> None:
    """Fields have none, nor have muscles and flesh."""
    need("matplotlib")
    asset, tools = sleeve_and_field(tmp_path)
    ran = wrinkle("check", asset, tools, "--plot", tmp_path / "a.svg")
    assert (ran.code, ran.lines) == (1, [f"{tools}: no wrinkling tool has a control curve to draw"])
    assert not (tmp_path / "a.svg").exists()
