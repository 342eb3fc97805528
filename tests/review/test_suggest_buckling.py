"""Cloth and leather on a bent limb get two tools that cross on the inside of the bend; all else gets level ones."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, stored
from kit.limb import RADIUS, limb_asset
from kit.suggested import along, ends, middle
from wrinklecli import bake
from wrinklecli.gltf.document import read_document
from wrinklecli.review.check import check
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.tools.read import load_tools, parse_tools
from wrinklecli.tools.records import Contact, Length


def limb_of(material: str, joint: str = "LeftLeg", **options: Any) -> Asset:
    """A limb that bends at its middle, with the name of the bending joint."""
    asset = limb_asset(**{"rings": 24, "sides": 16, **options})
    number = asset.append("materials", {"name": material})
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["material"] = number
    joints = asset.gltf["skins"][0]["joints"]
    for node, name in zip(joints, ["LeftUpLeg", joint], strict=False):
        asset.gltf["nodes"][node]["name"] = name
    return asset


def height_of(suggestion: Suggestion) -> float:
    """Height of a tool's highest bump, scene units."""
    tool, span = suggestion.tool, suggestion.span
    return (
        tool.max_height.resolve(span) if isinstance(tool.max_height, Length) else tool.bump_height * span / tool.bumps
    )


def suggested(folder: Path, asset: Asset, *, everything: bool = False) -> Suggestions:
    return suggest(asset.write(folder / "limb.glb"), everything=everything)


@pytest.mark.slow
@pytest.mark.parametrize(("material", "bumps"), [("Trousers", (6, 4)), ("leather", (4, 4))])
def test_folds_of_cloth_cross_on_the_inside_of_a_bent_limb(
    tmp_path: Path, material: str, bumps: tuple[int, int]
) -> None:
    # Leather folds too low on so thin a limb to be worth it.
    found = suggested(tmp_path, limb_of(material), everything=material == "leather")
    first, second = (each.tool for each in found.tools[:2])
    assert (first.between, second.between) == ((), ())
    # They cross at the crease, and lean as much to one side as to the other.
    assert np.linalg.norm(middle(first) - middle(second)) < 0.2 * RADIUS
    axis = np.array([1.0, 0.0, 0.0])
    for tool in (first, second):
        assert 15 < np.degrees(np.arccos(abs(along(tool) @ axis))) < 50
        for end in ends(tool):
            assert np.linalg.norm(end[1:]) == pytest.approx(RADIUS, rel=0.1)
    side = np.cross(axis, middle(first))
    leaning = [along(tool) @ side * np.sign(along(tool) @ axis) for tool in (first, second)]
    assert leaning[0] == pytest.approx(-leaning[1], rel=0.25)
    # They reach as far as the bend presses the limb together. One leads, and the crease is a furrow of both.
    assert (first.bumps, second.bumps) == bumps
    halves = [abs(float((ends(tool)[1] - ends(tool)[0]) @ axis)) / 2.0 for tool in (first, second)]
    assert RADIUS * 0.9 < halves[1] < halves[0] < RADIUS * 1.5
    assert height_of(found.tools[1]) < 0.7 * height_of(found.tools[0])
    (tmp_path / "tools.yaml").write_text(found.text)
    assert not check(tmp_path / "limb.glb", tmp_path / "tools.yaml").warnings
    assert [tool.name for tool in parse_tools(found.text).tools] == [each.tool.name for each in found.tools]


def test_skin_folds_level(tmp_path: Path) -> None:
    found = suggested(tmp_path, limb_of("skin"))
    axis = np.array([1.0, 0.0, 0.0])
    assert all(abs(along(each.tool) @ axis) > 0.98 for each in found.tools)


def test_bare_skin_creases_close_to_the_joint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kit.limb.BLEND", 1.2)  # it bends over more than its thickness
    lengths = {}
    for joint in ("LeftForeArm", "Joint"):
        found = suggested(tmp_path, limb_of("skin", joint=joint), everything=True)
        lengths[joint] = found.tools[0].span
    assert lengths["LeftForeArm"] < 2.1 * RADIUS < lengths["Joint"]


def test_folds_at_a_hip_stay_level(tmp_path: Path) -> None:
    found = suggested(tmp_path, limb_of("Trousers", joint="LeftFoot"))
    assert abs(along(found.tools[0].tool) @ np.array([1.0, 0.0, 0.0])) > 0.98


def test_a_hip_of_trousers_has_more_folds_than_a_squat_hides(tmp_path: Path) -> None:
    found = suggested(tmp_path, limb_of("Trousers", joint="LeftUpLeg"), everything=True)
    assert (found.tools[0].tool.material, found.tools[0].tool.bumps) == ("trouser_hip", 7)


@pytest.mark.slow
def test_half_a_tube_is_no_limb(tmp_path: Path) -> None:
    asset = limb_of("Trousers")
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        positions = stored(asset, primitive["attributes"]["POSITION"])
        triangles = stored(asset, primitive["indices"]).reshape(-1, 3)
        near = positions[triangles][..., 1].mean(axis=1)
        primitive["indices"] = asset.accessor(triangles[near > -0.1 * RADIUS].ravel(), "u2")
    found = suggested(tmp_path, asset)
    assert all(abs(along(each.tool) @ np.array([1.0, 0.0, 0.0])) > 0.98 for each in found.tools)


# Contact


def folded(folder: Path, monkeypatch: pytest.MonkeyPatch, *, installed: bool, joint: str = "LeftLeg") -> Suggestions:
    """Suggestions for a bare limb that folds through itself."""
    monkeypatch.setattr("wrinklecli.effects.contact.layer.ContactKind.is_installed", property(lambda _: installed))
    return suggested(folder, limb_of("skin", joint, angle=75.0, rings=16, sides=10))


def test_contact_is_proposed_where_a_knee_passes_through_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = folded(tmp_path, monkeypatch, installed=True)
    assert found.tools[0].crossings > 0
    assert parse_tools(found.text).tools[0].contact == Contact()
    assert found.text.count("contact: resolve\n") == 1
    assert "contact keeps its sides apart" in found.text


@pytest.mark.slow
def test_contact_that_is_proposed_bakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tools.yaml").write_text(folded(tmp_path, monkeypatch, installed=True).text)
    bake(tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb", max_levels=1)
    nodes = read_document(tmp_path / "out.glb").items("nodes")
    assert [len(node["extras"]["wrinkle"]["folds"]) for node in nodes if "mesh" in node] == [1]


def test_without_the_extra_a_comment_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = folded(tmp_path, monkeypatch, installed=False)
    assert not any(tool.contact for tool in parse_tools(found.text).tools)
    assert "pip install 'wrinklecli[contact]'" in found.text


def test_a_fold_that_does_not_cross_has_no_contact(tmp_path: Path) -> None:
    found = suggested(tmp_path, limb_of("skin", angle=30.0))
    assert not any(each.crossings or each.tool.contact for each in found.tools)
    assert "contact" not in found.text


@pytest.mark.slow
def test_a_preset_of_a_file_is_taken_for_its_parts_of_a_body(tmp_path: Path) -> None:
    """The text names the file from where it will stand, reads as the tools are, and bakes."""
    (tmp_path / "in").mkdir()
    studio, tools = tmp_path / "in" / "studio.yaml", tmp_path / "in" / "tools.yaml"
    felt = "felt: {material: cloth, parts: [lower leg], bump_height: 22%, branch: 0.7, width: 3, max_height: none}\n"
    studio.write_text(f"{felt}boot: {{material: felt, parts: [foot]}}\n")
    limb_of("Trousers").write(tmp_path / "limb.glb")
    found = suggest(tmp_path / "limb.glb", presets=[studio], folder=str(tmp_path / "in"), everything=True)
    assert {each.tool.material for each in found.tools} == {"felt"}
    assert all((each.tool.branch, each.tool.bump_height) == (0.7, 0.22) for each in found.tools)
    assert str(studio) in found.inputs
    tools.write_text(found.text)
    assert 'presets: ["studio.yaml"]' in found.text
    read = load_tools(tools).tools
    assert [replace(tool, where="") for tool in read[: len(found.tools)]] == [each.tool for each in found.tools]
    assert check(tmp_path / "limb.glb", tools).data["tools"]
    assert "presets" not in suggest(tmp_path / "limb.glb", everything=True).text
