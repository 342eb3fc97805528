"""The substance of each place: by the pictures under it, by metal and boxes, by names, or as the user says."""

import builtins
import importlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from kit import characters
from kit.asset import Array, Asset, attribute
from kit.limb import limb_asset
from kit.suggested import run
from wrinklecli.errors import AssetError
from wrinklecli.review.suggest.candidates import Candidate
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.surface.substance import Substance, named

Json = dict[str, Any]


def painted(pixels: Array | None, *, name: str = "Material.001", node: str = "limb", **looks: Any) -> Asset:
    """A limb with a picture on it."""
    asset = limb_asset(rings=11, sides=8)
    if pixels is not None:
        looks["baseColorTexture"] = {"index": texture(asset, pixels)}
    asset.append("materials", {"name": name, "pbrMetallicRoughness": looks})
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["material"] = 0
    asset.gltf["nodes"][0]["name"] = node
    return asset


def texture(asset: Asset, pixels: Array) -> int:
    view = asset.view(characters.png(pixels))
    image = asset.append("images", {"bufferView": view, "mimeType": "image/png"})
    return asset.append("textures", {"source": image})


def judged(folder: Path, asset: Asset, **options: Any) -> Suggestions:
    return suggest(asset.write(folder / "asset.glb"), count=1, everything=True, **options)


def places_on(folder: Path, asset: Asset, **options: Any) -> list[Candidate]:
    """The places that `suggest` finds, each with its substance, before it fits tools there, which takes longest."""
    found: list[Candidate] = []

    def fitted(candidates: Sequence[Candidate]) -> list[Suggestion]:
        found.extend(candidates)
        return []

    module = importlib.import_module("wrinklecli.review.suggest.suggest")
    none = mock.patch.object(module, "find_garments", return_value=[])
    with none, mock.patch.object(module, "fit_tools", fitted):
        suggest(asset.write(folder / "asset.glb"), everything=True, **options)
    return found


def substance_of(folder: Path, asset: Asset, **options: Any) -> Substance:
    """The substance of the place that folds most."""
    substance = places_on(folder, asset, **options)[0].substance
    assert substance is not None
    return substance


def kind_of(folder: Path, asset: Asset, **options: Any) -> str:
    return substance_of(folder, asset, **options).kind


def flat(colour: tuple[float, float, float]) -> Array:
    return np.tile(colour, (32, 32, 1))


STUFFS = {
    "pale skin": (characters.skin(128, (0.94, 0.79, 0.71)), "skin"),
    "skin": (characters.skin(128), "skin"),
    "dark skin": (characters.skin(128, (0.38, 0.24, 0.17)), "skin"),
    "painted skin": (flat((0.98, 0.80, 0.62)), "skin"),
    "jeans": (characters.denim(128), "cloth"),
    "pale jeans": (characters.denim(128, (0.55, 0.64, 0.76)), "cloth"),
    "white shirt": (characters.cotton(128), "cloth"),
    "black shirt": (characters.cotton(128, (0.12, 0.12, 0.13)), "cloth"),
    "khaki weave": (characters.cotton(128, (0.70, 0.63, 0.50)), "cloth"),
    "painted red": (flat((0.75, 0.20, 0.18)), "cloth"),
    "painted green": (flat((0.30, 0.55, 0.30)), "cloth"),
    "boots": (characters.leather(128), "leather"),
    "dark boots": (characters.leather(128, (0.17, 0.12, 0.09)), "leather"),
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("stuff", STUFFS)
def test_a_picture_says_what_a_place_is_made_of(tmp_path: Path, stuff: str) -> None:
    pixels, kind = STUFFS[stuff]
    found = substance_of(tmp_path, painted(pixels))
    assert (found.kind, found.why) == (kind, "by its texture")
    assert found.confidence > 0.5


def halves(**info: Any) -> Asset:
    """A limb whose picture is skin on the left and denim on the right."""
    asset = painted(np.concatenate([characters.skin(64), characters.denim(64)], axis=1))
    asset.gltf["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] |= info
    return asset


def transformed(x: float) -> Json:
    transform = {"offset": [x, 0.0], "scale": [0.4, 1.0]}
    return {"extensions": {"KHR_texture_transform": transform}}


def test_one_atlas_holds_several_stuffs(tmp_path: Path) -> None:
    asset = halves()
    places = attribute(asset, 0, "TEXCOORD_0")
    places[:, 0] = 0.05 + 0.4 * places[:, 0]
    assert kind_of(tmp_path, asset) == "skin"
    places[:, 0] += 0.5
    assert kind_of(tmp_path, asset) == "cloth"


def test_a_place_on_a_border_is_not_of_one_substance(tmp_path: Path) -> None:
    asset = halves()
    places = attribute(asset, 0, "TEXCOORD_0")
    assert places_on(tmp_path, asset)[0].uniform < 0.9
    places[:, 0] = 0.05 + 0.4 * places[:, 0]
    assert places_on(tmp_path, asset)[0].uniform == pytest.approx(1.0)


def test_what_alpha_cuts_away_is_of_no_substance(tmp_path: Path) -> None:
    lace = np.ones((64, 64, 4))
    lace[:, 32:, 3] = 0.25
    asset = painted(lace)
    assert places_on(tmp_path, asset)[0].uniform == pytest.approx(1.0)
    material = asset.gltf["materials"][0]
    material["alphaMode"] = "MASK"
    cut = places_on(tmp_path, asset)[0].uniform
    assert cut < 0.9
    material["alphaCutoff"] = 0.2
    assert places_on(tmp_path, asset)[0].uniform == pytest.approx(1.0)
    material["alphaMode"] = "BLEND"
    assert cut < places_on(tmp_path, asset)[0].uniform < 1.0


@pytest.mark.quick(1)
@pytest.mark.parametrize(("x", "kind"), [(0.05, "skin"), (0.55, "cloth"), (-0.45, "cloth"), (1.05, "skin")])
def test_texture_transforms_and_wraps_are_followed(tmp_path: Path, x: float, kind: str) -> None:
    assert kind_of(tmp_path, halves(**transformed(x))) == kind


def test_the_texture_coordinates_are_those_of_the_texture(tmp_path: Path) -> None:
    asset = halves(texCoord=1)
    places = attribute(asset, 0, "TEXCOORD_0")
    second = asset.accessor(places * [0.4, 1.0] + [0.55, 0.0])
    places[:, 0] *= 0.4
    asset.gltf["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = second
    assert kind_of(tmp_path, asset) == "cloth"


def test_factors_and_colours_of_vertices_are_multiplied_in(tmp_path: Path) -> None:
    assert kind_of(tmp_path, painted(flat((1.0, 1.0, 1.0)), baseColorFactor=[0.05, 0.1, 0.5, 1.0])) == "cloth"
    asset = limb_asset(rings=11, sides=8, colors=True)
    attribute(asset, 0, "COLOR_0")[:] = [205, 130, 95]
    assert kind_of(tmp_path, asset) == "skin"


def rough(blue: float) -> Array:
    return flat((0.0, 0.5, blue))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("factor", "blue", "kind"), [(1.0, 1.0, "hard"), (None, 0.8, "hard"), (0.5, 1.0, "cloth"), (1.0, 0.1, "cloth")]
)
def test_metal_is_factor_times_texture(tmp_path: Path, factor: float | None, blue: float, kind: str) -> None:
    asset = painted(characters.cotton(64, (0.5, 0.5, 0.55)))
    looks = asset.gltf["materials"][0]["pbrMetallicRoughness"]
    looks["metallicRoughnessTexture"] = {"index": texture(asset, rough(blue))}
    if factor is not None:
        looks["metallicFactor"] = factor
    assert kind_of(tmp_path, asset) == kind


def test_smoothness_says_nothing(tmp_path: Path) -> None:
    """Exporters write one roughness for all of a character, and the textures of games give dark cloth any."""
    cloth = characters.cotton(128, (0.12, 0.12, 0.13))
    for roughness in (0.05, 0.9):
        assert kind_of(tmp_path, painted(cloth, metallicFactor=0.0, roughnessFactor=roughness)) == "cloth"


@pytest.mark.parametrize("name", ["Hand.L", "ArmLeft", "body", "head", "Foot_R", "顔"])
def test_a_limb_says_nothing_of_its_stuff(name: str) -> None:
    assert named([name], "it") is None


@pytest.mark.slow
def test_the_picture_counts_more_than_names(tmp_path: Path) -> None:
    skin = painted(characters.skin(128), name="Clothes_Atlas", node="Trousers")
    assert kind_of(tmp_path, skin) == "skin"
    assert kind_of(tmp_path, painted(None, name="Clothes_Atlas")) == "cloth"
    # But eyes and hair have the colours of anything.
    assert kind_of(tmp_path, painted(characters.skin(128), name="Hair")) == "hard"


@pytest.mark.slow
def test_where_nothing_is_said_the_confidence_is_low(tmp_path: Path) -> None:
    grey = painted(None, baseColorFactor=[0.6, 0.6, 0.6, 1.0])
    found = judged(tmp_path, grey)
    substance = found.tools[0].substance
    assert substance is not None
    assert substance.kind == "skin"
    assert substance.confidence < 0.5
    assert "# skin, as nothing says what it is made of (a guess)" in found.text


@pytest.mark.slow
@pytest.mark.long
def test_the_file_and_json_say_why(tmp_path: Path) -> None:
    path = painted(characters.skin(128)).write(tmp_path / "asset.glb")
    assert "  # skin, by its texture (sure)\n  - name: " in suggest(path, everything=True).text
    (tool, *_) = json.loads(run(path, "--json", "--all").stdout)["tools"]
    assert (tool["substance"], tool["why"]) == ("skin", "by its texture")
    assert 0.8 < tool["confidence"] <= 1.0


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    ("name", "kind"), [("limb", "none"), ("My=Jeans", "skin"), ("limb", "leather"), ("My=Jeans", "hard")]
)
def test_material_overrides_the_picture(tmp_path: Path, name: str, kind: str) -> None:
    path = painted(characters.denim(64), name="My=Jeans").write(tmp_path / "asset.glb")
    found = json.loads(run(path, "--json", "--all", "--material", f"{name}={kind}").stdout)["tools"][0]
    assert (found["substance"], found["why"]) == (kind, "as --material says")
    plain = kind in ("hard", "none")
    assert (found["material"] == "none") == plain


def test_a_material_counts_before_its_node(tmp_path: Path) -> None:
    asset = painted(characters.denim(64), name="jeans")
    assert kind_of(tmp_path, asset, materials={"limb": "skin", "jeans": "leather"}) == "leather"


def test_material_refuses_what_it_does_not_know(tmp_path: Path) -> None:
    path = painted(None, name="jeans").write(tmp_path / "asset.glb")
    with pytest.raises(AssetError, match=r"'jean' is no material.*did you mean 'jeans'"):
        suggest(path, materials={"jean": "cloth"})
    for value in ("jeans", "jeans=wool", "=cloth"):
        result = run(path, "--material", value)
        assert result.exit_code == 2
        assert "skin, cloth, leather, hard, none" in " ".join(result.stderr.split())


@pytest.mark.slow
@pytest.mark.long
def test_what_cannot_be_read_says_nothing_in_one_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asset = painted(characters.denim(64))
    asset.gltf["images"][0] = {"bufferView": asset.view(b"\x89PNG\r\n\x1a\n nothing"), "mimeType": "image/png"}
    found = judged(tmp_path, asset)
    assert [note for note in found.notes if "cannot be read" in note]
    assert found.tools[0].substance.kind == "skin"  # type: ignore[union-attr]
    found_import = builtins.__import__

    def without_pillow(name: str, *arguments: Any, **more: Any) -> Any:
        if name == "PIL":
            raise ImportError("No module named 'PIL'")
        return found_import(name, *arguments, **more)

    monkeypatch.setattr(builtins, "__import__", without_pillow)
    asset = painted(characters.denim(64))
    looks = asset.gltf["materials"][0]["pbrMetallicRoughness"]
    looks["metallicRoughnessTexture"] = {"index": texture(asset, rough(0.0))}
    notes = [note for note in judged(tmp_path, asset).notes if "Pillow" in note]
    assert len(notes) == 1
    assert "wrinklecli[preview]" in notes[0]


# Characters

# By the joint's name without its side, what is there on most of the characters; "" is any other joint.
DRESSED = {
    "forearm": "skin",
    "hand": "skin",
    "neck": "skin",
    "head": "skin",
    "foot": "leather",
    "toe": "leather",
    "": "cloth",
}
TRUTH: dict[str, dict[str, str]] = {
    "knight": {"": "hard"},
    "knight_tabard": {"hand": "hard", "": "cloth"},
    "robot": {"": "hard"},
    "low_poly_flat": DRESSED,
    "low_poly_smooth": DRESSED,
    "dressed": DRESSED,
    "dressed_brown": DRESSED,
    "dressed_black": DRESSED,
    "cartoon": {**DRESSED, "shin": "skin"},
}


def compared(candidates: Sequence[Candidate], truth: dict[str, str]) -> list[tuple[str, str, str]]:
    """The joint, the substance and the truth of each place."""
    stems = [(each.driver.split(".")[0], each.substance) for each in candidates]
    return [(stem, "" if it is None else it.kind, truth.get(stem.split("_")[0], truth[""])) for stem, it in stems]


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize("name", ["low_poly_flat", "dressed_brown", "dressed", "robot", "knight_tabard"])
def test_each_place_of_a_clip_has_its_substance(tmp_path: Path, name: str) -> None:
    found = compared(places_on(tmp_path, characters.CHARACTERS[name]()), TRUTH[name])
    assert len(found) >= 2
    assert [(joint, kind) for joint, kind, _ in found] == [(joint, truth) for joint, _, truth in found]


@pytest.mark.slow
@pytest.mark.long
def test_nine_of_ten_places_of_all_characters_are_right(tmp_path: Path) -> None:
    found = []
    for name, truth in TRUTH.items():
        candidates = places_on(tmp_path, characters.CHARACTERS[name](), range_of_motion=True)
        found += [(name, *each) for each in compared(candidates, truth)]
    wrong = [each for each in found if each[2] != each[3]]
    assert len(found) > 70
    assert len(wrong) <= 0.1 * len(found), wrong


@pytest.mark.slow
@pytest.mark.long
def test_layers_have_substances_of_their_own(tmp_path: Path) -> None:
    clips = ["mixamorig:LeftLeg ahead, -120°", "mixamorig:LeftHand aside, +70°", "mixamorig:LeftArm aside, +70°"]
    found = places_on(tmp_path, characters.avatar(), clips=clips)
    kinds = {(each.mesh.node, each.substance.kind) for each in found if each.substance is not None}
    assert kinds == {("mesh_0", "skin"), ("mesh_1", "cloth"), ("mesh_2", "cloth")}


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize(
    ("name", "words"), [("knight", ["body is rigid", "Hand.L is metal"]), ("robot", ["Cube.007 is rigid"])]
)
def test_a_knight_and_a_robot_get_nothing(tmp_path: Path, name: str, words: list[str]) -> None:
    path = characters.CHARACTERS[name]().write(tmp_path / f"{name}.glb")
    result = run(path, "-o", tmp_path / "tools.yaml")
    assert result.exit_code == 1
    assert all(each in str(result.exception) for each in ["nothing to suggest: ", *words])
    assert not (tmp_path / "tools.yaml").exists()


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("node", "joint", "material", "reason"),
    [
        ("fox1", "b_Tail01", "Material.001", "fox1 is fur"),
        ("Body", "b_Tail01", "husky_fur", "Body is fur"),
        ("Body", "LeftLeg", "fur_collar", "Body is fur"),
    ],
)
def test_fur_is_said_to_be_fur(tmp_path: Path, node: str, joint: str, material: str, reason: str) -> None:
    """Fur hides the folds of the skin below it."""
    asset = painted(characters.skin(64, (0.8, 0.5, 0.3)), name=material, node=node)
    asset.gltf["nodes"][asset.gltf["skins"][0]["joints"][1]]["name"] = joint
    found = suggest(asset.write(tmp_path / "asset.glb"))
    assert not found.tools
    assert reason in found.reason
    assert any("fur, as" in note for note in found.notes)
    assert kind_of(tmp_path, asset, materials={node: "skin"}) == "skin"


@pytest.mark.parametrize(("node", "joint"), [("Wolf3D_Body", "LeftLeg"), ("lizard", "b_Tail01")])
def test_names_of_animals_say_nothing_of_people_and_of_bare_animals(tmp_path: Path, node: str, joint: str) -> None:
    asset = painted(characters.skin(64, (0.94, 0.79, 0.71)), node=node)
    asset.gltf["nodes"][asset.gltf["skins"][0]["joints"][1]]["name"] = joint
    assert kind_of(tmp_path, asset) == "skin"
