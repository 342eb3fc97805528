"""Flesh that is guessed by the names of bones and the thickness of the body."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import wrinklecli
from kit.asset import stored
from kit.characters import avatar, cartoon, dressed
from kit.command import Wrinkle
from kit.limb import limb
from kit.suggested import each_once, suggest_once
from wrinklecli.review.check import check


@pytest.fixture(scope="module")
def person(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dressed().write(tmp_path_factory.mktemp("person") / "dressed.glb")


@pytest.mark.slow
@pytest.mark.long
def test_a_body_gets_regions_where_its_skin_is_thick(person: Path, tmp_path: Path) -> None:
    """Its chest is lean. The others lie where they should, mirrored, and the file bakes."""
    found = suggest_once(person, flesh=True)
    places = {each.effect.name: each.effect.at for each in found.guesses}
    assert set(places) == {"belly", "buttock.L", "thigh.L", "cheek.L"}
    assert {each.effect.name for each in found.guesses if each.mirrored} == set(places) - {"belly"}
    assert any(note.startswith("chest: left out, as skin and bone are") for note in found.notes)
    # Above the hips, below the chest, and below the eyes.
    assert 1.0 < places["belly"][1] < 1.1
    assert places["belly"][2] > 0.08
    assert 1.55 < places["cheek.L"][1] < 1.6
    assert places["buttock.L"][2] < -0.07
    assert "guess" in found.text
    (tmp_path / "flesh.yaml").write_text(found.text)
    report = wrinklecli.bake(person, tmp_path / "flesh.yaml", tmp_path / "out.glb", draft=True)
    assert len(report.data["flesh"]) == 7


@pytest.mark.slow
@pytest.mark.long
def test_a_region_says_how_far_a_clip_swings_it(person: Path, tmp_path: Path) -> None:
    """The row says about what a bake does, which has more shapes."""
    found = suggest_once(person, flesh=True)
    (tmp_path / "flesh.yaml").write_text(found.text)
    listed = {each["name"]: each["clips"] for each in check(person, tmp_path / "flesh.yaml").data["flesh"]}
    for each in found.guesses:
        sides = [each.effect.name, each.effect.name.replace(".L", ".R")]
        moved = max(clip["largest_move"] for name in sides for clip in listed[name])
        assert each.facts["height"] == pytest.approx(moved, rel=0.15)


@pytest.mark.slow
@pytest.mark.long
def test_clothes_over_a_region_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shirt and trousers move with the flesh below them; what lies over a face does not, coarse as this one is."""
    monkeypatch.setattr("wrinklecli.review.suggest.flesh.LEAST_VERTICES", 1)
    found = wrinklecli.suggest(avatar().write(tmp_path / "avatar.glb"), flesh=True)
    worn = {each.effect.name: each.effect.meshes for each in found.guesses}
    assert worn == {
        "belly": ("mesh_1", "mesh_2"), "buttock.L": ("mesh_1",), "thigh.L": ("mesh_1",), "cheek.L": ()
    }  # fmt: skip
    (cheek,) = (each.effect.at for each in found.guesses if each.effect.name == "cheek.L")
    assert cheek[0] > 0.04
    assert "meshes: [mesh_1, mesh_2]" in found.text


@pytest.mark.slow
def test_flesh_of_a_thigh_lies_over_its_own_bone(tmp_path: Path) -> None:
    """A body that is stored with one leg ahead and one behind: between both knees there is no bone."""
    asset, half = dressed(), np.radians(35.0) / 2.0
    nodes = {each["name"]: each for each in asset.gltf["nodes"]}
    for side, sign in (("L", -1.0), ("R", 1.0)):
        nodes[f"thigh.{side}"]["rotation"] = [float(sign * np.sin(half)), 0.0, 0.0, float(np.cos(half))]
    found = wrinklecli.suggest(asset.write(tmp_path / "runs.glb"), flesh=True)
    depths = {each.effect.name: each.facts["depth"] for each in found.guesses if each.effect.name.startswith("thigh")}
    assert depths["thigh.L"] == pytest.approx(depths["thigh.R"], rel=0.35)


@pytest.mark.slow
@pytest.mark.long
def test_flesh_on_a_coarse_mesh_is_left_out(tmp_path: Path) -> None:
    """A cartoon's cheeks have one vertex each, which would stand out as a spike; the right one has it, too.

    The middle of the right cheek is nearest to a corner beyond the region.
    """
    found = wrinklecli.suggest(cartoon().write(tmp_path / "cartoon.glb"), flesh=True)
    assert found.guesses == ()
    for name in ("cheek.L", "cheek.R"):
        line = f"{name}: left out, as the mesh is too coarse there: 1 vertex would move, fewer than 5"
        assert line in found.notes


@pytest.mark.slow
@pytest.mark.long
def test_flesh_of_one_side_is_left_out(wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cartoon that lacks the skin of its right cheek: the left one alone would look like a fault."""
    monkeypatch.setattr("wrinklecli.review.suggest.flesh.LEAST_VERTICES", 1)
    asset = cartoon()
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        positions = stored(asset, primitive["attributes"]["POSITION"])
        triangles = stored(asset, primitive["indices"]).reshape(-1, 3)
        x, y, z = positions[triangles].mean(axis=1).T
        cheek = (x < -0.05) & (y > 1.5) & (z > 0.05)
        primitive["indices"] = asset.accessor(triangles[~cheek].reshape(-1), "u4")
    ran = wrinkle("suggest", asset.write(tmp_path / "cartoon.glb"), "--flesh")
    assert ran.code == 1
    assert any(line == "note: cheek.L: left out, as the other side is" for line in ran.lines)


@pytest.mark.slow
@pytest.mark.long
@each_once()
def test_the_command_prints_a_file_and_json(wrinkle: Wrinkle, person: Path) -> None:
    ran = wrinkle("suggest", person, "--flesh", "-q")
    listed = yaml.safe_load(ran.out)["flesh"]
    data = json.loads(wrinkle("suggest", person, "--flesh", "--json", "-q").out)
    assert [each["name"] for each in data["flesh"]] == [each["name"] for each in listed]
    assert wrinkle("suggest", person, "--flesh", "--muscles").code == 2


def test_a_limb_without_names_gets_none(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.gltf", rings=9, sides=8)
    ran = wrinkle("suggest", asset, "--flesh", "-o", tmp_path / "flesh.yaml")
    assert ran.code == 1
    assert "nothing to suggest: no joints of a mesh are named as two legs" in ran.lines[-1]
