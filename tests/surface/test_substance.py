"""The substance of places, by the colours of a whole character."""

from collections import defaultdict
from copy import deepcopy

import numpy as np
import pytest

from kit.asset import Array, Asset, attribute, stored
from kit.bakes import place
from kit.characters import avatar, cotton, denim, dressed, png
from kit.limb import limb_asset
from kit.prepared import as_document
from wrinklecli.character.rig import read_rig
from wrinklecli.choices import SUBSTANCES
from wrinklecli.gltf.document import read_document
from wrinklecli.surface.ground import read_ground
from wrinklecli.surface.substance import is_animal, substances_at
from wrinklecli.tools.records import ToolsFile

TAN = [0.75, 0.41, 0.26, 1.0]
SKIN = (0.86, 0.62, 0.5)


def jacket_of_skin(asset: Asset) -> float:
    """The part of the jacket's triangles that counts as skin."""
    path = place(asset)
    (node,) = [number for number, each in enumerate(asset.gltf["nodes"]) if each.get("mesh") == 2]
    ground = read_ground(read_document(path), node, [], ToolsFile(path=str(path)), ())
    return float((substances_at(ground) == SUBSTANCES.index("skin")).mean())


def in_tan() -> Asset:
    """A dark avatar in a jacket that has the colour of lighter skin, and a name that says nothing."""
    asset = avatar()
    (wool,) = [each for each in asset.gltf["materials"] if each["name"] == "M_04"]
    wool["pbrMetallicRoughness"] = {"baseColorFactor": TAN, "roughnessFactor": 0.9}
    return asset


def test_a_jacket_is_told_from_the_hands_of_another_mesh() -> None:
    dressed = in_tan()
    headless = deepcopy(dressed)
    (body,) = [each for each in headless.gltf["nodes"] if each.get("mesh") == 0]
    del body["mesh"], body["skin"]
    assert jacket_of_skin(dressed) < 0.1
    assert jacket_of_skin(headless) > 0.9


def kinds_by_joint(asset: Asset) -> dict[str, set[str]]:
    """The substances of triangles, by the joint that their first corner follows most, without its side."""
    path = place(asset)
    (node,) = [number for number, each in enumerate(asset.gltf["nodes"]) if "mesh" in each]
    ground = read_ground(read_document(path), node, [], ToolsFile(path=str(path)), ())
    joints = ground.rig.joints[ground.surface.heaviest[ground.surface.triangles[:, 0]]]
    found = defaultdict[str, set[str]](set)
    for joint, kind in zip(joints.tolist(), substances_at(ground).tolist(), strict=True):
        found[str(ground.rig.names[joint]).split(".")[0]].add(SUBSTANCES[kind])
    return found


@pytest.mark.parametrize("tone", ["tan", "dark", "green", "pink"])
def test_skin_is_what_hands_and_head_have_in_common(tone: str) -> None:
    found = kinds_by_joint(dressed(tone))
    assert found["forearm"] == {"skin"}
    assert found["spine"] == {"cloth"}


def cut_off_feet(asset: Asset) -> None:
    """Leave out the triangles between feet and shins, whose corners follow both."""
    names = np.array([asset.gltf["nodes"][joint]["name"] for joint in asset.gltf["skins"][0]["joints"]])
    heaviest = attribute(asset, 0, "WEIGHTS_0").argmax(axis=1)
    foot = np.char.startswith(names, "foot")[attribute(asset, 0, "JOINTS_0")[np.arange(len(heaviest)), heaviest]]
    triangles = stored(asset, asset.gltf["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)
    triangles[foot[triangles].any(axis=1) & ~foot[triangles].all(axis=1)] = 0


@pytest.mark.parametrize("shod", [True, False])
@pytest.mark.parametrize(("colour", "foot"), [((0.17, 0.34, 0.07), "cloth"), ((0.6, 0.3, 0.16), "skin")])
def test_a_colour_all_over_that_is_no_human_s_says_nothing(colour: tuple[float, ...], foot: str, shod: bool) -> None:
    """A mannequin is of one; feet that are pieces of their own are shod as far as one knows, others bare as hands."""
    asset = dressed()
    if shod:
        cut_off_feet(asset)
    else:
        foot = "skin"
    asset.gltf["materials"][0]["pbrMetallicRoughness"] = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0}
    found = kinds_by_joint(asset)
    assert found["spine"] == found["forearm"] == {"skin"}
    assert found["foot"] == {foot}


def test_black_gloves_and_a_black_mask_are_no_skin() -> None:
    assert "skin" not in kinds_by_joint(dressed("black"))["forearm"]


def kinds_of(asset: Asset) -> list[str]:
    """The substances of a limb, those of the most triangles first."""
    path = place(asset)
    ground = read_ground(read_document(path), 0, [], ToolsFile(path=str(path)), ())
    kinds = [SUBSTANCES[kind] for kind in substances_at(ground).tolist()]
    return sorted(set(kinds), key=kinds.count, reverse=True)


def limb_of(pixels: Array) -> Asset:
    asset = limb_asset(rings=21, sides=12)
    image = asset.append("images", {"bufferView": asset.view(png(pixels)), "mimeType": "image/png"})
    texture = asset.append("textures", {"source": image})
    looks = {"baseColorTexture": {"index": texture}, "metallicFactor": 0.0}
    asset.append("materials", {"name": "M", "pbrMetallicRoughness": looks})
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    return asset


def test_a_spot_of_another_colour_is_of_the_cloth_round_it() -> None:
    pixels = denim(256)
    assert kinds_of(limb_of(pixels)) == ["cloth"]
    pixels[120:134, 120:134] = SKIN
    assert kinds_of(limb_of(pixels)) == ["cloth"]
    pixels[:128] = SKIN
    assert set(kinds_of(limb_of(pixels))) == {"cloth", "skin"}


def test_the_plain_grey_of_a_palette_says_nothing() -> None:
    """It may be metal's; a picture of grey cloth has shadows."""
    assert kinds_of(limb_of(np.full((64, 64, 3), 0.5))) == ["skin"]
    assert kinds_of(limb_of(cotton(256, (0.5, 0.5, 0.5)))) == ["cloth"]


@pytest.mark.parametrize(
    ("names", "animal"),
    [
        (["Bip01-Spine_5", "BN_Tail_01_32", "Bip01-L-Finger0_16"], True),
        (["body", "wing_1.L", "foot.L"], True),
        (["spine.004", "front_thigh.L", "f_index.01.L", "thigh.L"], True),
        (["J_Bip_C_Hips", "J_Sec_Tail1", "J_Bip_L_Thumb1"], False),
        (["mixamorig:Spine", "WingLeft", "mixamorig:LeftHandThumb1"], False),
        (["全ての親", "尾1"], True),
        (["swinger", "detail", "foot.L"], False),
    ],
)
def test_animals_have_tails_wings_or_front_legs_and_no_thumbs(names: list[str], animal: bool) -> None:
    asset = limb_asset(rings=4, sides=3, joints=len(names))
    for joint, name in zip(asset.gltf["skins"][0]["joints"], names, strict=True):
        asset.gltf["nodes"][joint]["name"] = name
    assert is_animal(read_rig(as_document(asset), 0)) == animal
