"""Folds of skin on a bent limb: level, close to the joint, kept apart by contact; and presets for parts of a body."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset
from kit.limb import RADIUS, limb_asset
from kit.suggested import along
from wrinklecli import bake
from wrinklecli.character.rig import Hierarchy
from wrinklecli.gltf.document import read_document
from wrinklecli.review.check import check
from wrinklecli.review.suggest.candidates import _digits
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.tools.read import load_tools, parse_tools
from wrinklecli.tools.records import Contact


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


def suggested(folder: Path, asset: Asset, *, everything: bool = False) -> Suggestions:
    return suggest(asset.write(folder / "limb.glb"), everything=everything)


@pytest.mark.slow
def test_skin_folds_level(tmp_path: Path) -> None:
    found = suggested(tmp_path, limb_of("skin"))
    axis = np.array([1.0, 0.0, 0.0])
    assert all(abs(along(each.tool) @ axis) > 0.98 for each in found.tools)


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "motion"), [("LeftLeg", False), ("joint_1", True)])
def test_a_morph_target_that_shapes_a_leg_is_no_motion(tmp_path: Path, joint: str, motion: bool) -> None:
    asset = limb_of("skin", joint=joint, morphs=1, morph_clip="LINEAR", clip=None)
    if motion:
        asset.gltf["nodes"][asset.gltf["skins"][0]["joints"][0]]["name"] = "joint_0"
    found = suggested(tmp_path, asset)
    said = any("its morph target shapes a limb" in note for note in found.notes)
    assert (bool(found.tools), said) == (motion, not motion)


@pytest.mark.slow
@pytest.mark.long
def test_bare_skin_creases_close_to_the_joint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kit.limb.BLEND", 1.2)  # it bends over more than its thickness
    lengths = {}
    for joint in ("LeftForeArm", "Joint"):
        found = suggested(tmp_path, limb_of("skin", joint=joint), everything=True)
        lengths[joint] = found.tools[0].span
    assert lengths["LeftForeArm"] < 2.1 * RADIUS < lengths["Joint"]


# Contact


def folded(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, installed: bool, joint: str = "LeftForeArm"
) -> Suggestions:
    """Suggestions for a bare limb that folds through itself."""
    monkeypatch.setattr("wrinklecli.effects.contact.layer.ContactKind.is_installed", property(lambda _: installed))
    return suggested(folder, limb_of("skin", joint, angle=75.0, rings=16, sides=10))


@pytest.mark.slow
def test_contact_is_proposed_where_an_elbow_passes_through_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = folded(tmp_path, monkeypatch, installed=True)
    assert found.tools[0].crossings > 0
    assert parse_tools(found.text).tools[0].contact == Contact()
    assert found.text.count("contact: resolve\n") == 1
    assert "contact keeps its sides apart" in found.text


@pytest.mark.slow
@pytest.mark.long
def test_contact_that_is_proposed_bakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tools.yaml").write_text(folded(tmp_path, monkeypatch, installed=True).text)
    bake(tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb", max_levels=1)
    nodes = read_document(tmp_path / "out.glb").items("nodes")
    assert [len(node["extras"]["wrinkle"]["folds"]) for node in nodes if "mesh" in node] == [1]


def test_without_the_extra_a_comment_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = folded(tmp_path, monkeypatch, installed=False)
    assert not any(tool.contact for tool in parse_tools(found.text).tools)
    assert "pip install 'wrinklecli[contact]'" in found.text


@pytest.mark.slow
def test_a_fold_that_does_not_cross_has_no_contact(tmp_path: Path) -> None:
    found = suggested(tmp_path, limb_of("skin", angle=30.0))
    assert not any(each.crossings or each.tool.contact for each in found.tools)
    assert "contact" not in found.text


@pytest.mark.slow
@pytest.mark.long
def test_a_preset_of_a_file_is_taken_for_its_parts_of_a_body(tmp_path: Path) -> None:
    """The text names the file from where it will stand, reads as the tools are, and bakes."""
    (tmp_path / "in").mkdir()
    studio, tools = tmp_path / "in" / "studio.yaml", tmp_path / "in" / "tools.yaml"
    felt = "felt: {material: leather, parts: [lower leg], bump_height: 22%, branch: 0.7, width: 3, max_height: none}\n"
    studio.write_text(f"{felt}boot: {{material: felt, parts: [foot]}}\n")
    limb_of("leather").write(tmp_path / "limb.glb")
    found = suggest(tmp_path / "limb.glb", presets=[studio], folder=str(tmp_path / "in"), everything=True)
    assert {each.tool.material for each in found.tools} == {"felt"}
    assert all((each.tool.branch, each.tool.bump_height) == (0.7, 0.22) for each in found.tools)
    assert str(studio) in found.inputs
    tools.write_text(found.text)
    assert "presets: [studio.yaml]" in found.text
    read = load_tools(tools).tools
    assert [replace(tool, where="") for tool in read[: len(found.tools)]] == [each.tool for each in found.tools]
    assert check(tmp_path / "limb.glb", tools).data["tools"]
    assert "presets" not in suggest(tmp_path / "limb.glb", everything=True).text


def test_a_place_is_of_the_finger_that_moves_it_most() -> None:
    """Joints of one chain are one finger. What none moves is of none, as all is of a hand with one finger."""
    influences = np.array([[1.0, 0.0, 0.0, 0.0], [0.1, 0.9, 0.0, 0.0], [0.0, 0.2, 0.8, 0.0], [0.4, 0.0, 0.0, 0.6]])
    triangles = np.arange(4)[:, None].repeat(3, axis=1)
    parents = SimpleNamespace(parents=np.array([-1, 0, 1, 0]))
    mesh: Any = SimpleNamespace(
        rig=SimpleNamespace(joints=np.arange(4), upwards=partial(Hierarchy.upwards, parents)),
        gauge=SimpleNamespace(influences=influences, triangles=triangles),
        sites=SimpleNamespace(positions=np.zeros((4, 3)), gather=np.eye(4)),
    )
    assert _digits(mesh, ["hand", "finger", "finger", "finger"]).tolist() == [-1, 0, 0, 1]
    assert _digits(mesh, ["hand", "finger", "finger", "hand"]).tolist() == [-1] * 4
