"""The substance of places, by the colours of a whole character."""

from copy import deepcopy

from kit.asset import Asset
from kit.bakes import place
from kit.characters import avatar
from wrinklecli.choices import SUBSTANCES
from wrinklecli.gltf.document import read_document
from wrinklecli.surface.ground import read_ground
from wrinklecli.surface.substance import substances_at
from wrinklecli.tools.records import ToolsFile

TAN = [0.75, 0.41, 0.26, 1.0]


def jacket_of_skin(asset: Asset) -> float:
    """The part of the jacket's triangles that counts as skin."""
    path = place(asset)
    (node,) = [number for number, each in enumerate(asset.gltf["nodes"]) if each.get("mesh") == 2]
    ground = read_ground(read_document(path), node, [], ToolsFile(path=str(path)), ())
    return float((substances_at(ground, 0.05) == SUBSTANCES.index("skin")).mean())


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
