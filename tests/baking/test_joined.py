"""A field on several nodes: their meshes are one surface, and each node shows its own in the end."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.asset import Asset, Json
from kit.bakes import bake_once, place
from kit.clients import assert_valid, compare_with_three
from kit.garments import split_materials, tools_file, tube
from kit.limb import sleeved_limb
from kit.player import Floats, Gltf
from wrinklecli.baking.track import track
from wrinklecli.errors import WrinkleError
from wrinklecli.review.diff.diff import diff
from wrinklecli.tools.read import parse_tools

TIMES = np.linspace(0.0, 2.0, 7)
BOTH: Json = {"name": "folds", "node": ["limb", "cuff"]}


def halves(*, nodes: bool = True) -> Asset:
    """The tube in two primitives, which meet where it bends, each of them on a node of its own."""
    asset = split_materials(tube(primitives=2), [1.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    if nodes:
        other = asset.gltf["meshes"][0]["primitives"].pop()
        asset.append("meshes", {"name": "cuff mesh", "primitives": [other], "extras": {"size": 3}})
        node = asset.append("nodes", {"name": "cuff", "mesh": 1, "skin": 0, "extras": {"worn": True}})
        asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


@cache
def apart() -> Path:
    return place(halves())


@cache
def baked(**options: object) -> Gltf:
    return bake_once(apart(), top={"fields": [BOTH]}, **{"max_levels": 1, **options})


@cache
def whole() -> Gltf:
    return bake_once(place(halves(nodes=False)), top={"fields": [{"name": "folds"}]}, max_levels=1)


def moves(file: Gltf, mesh: int, part: int) -> dict[str, Floats]:
    """The displacements of the morph targets that move a primitive, by their names."""
    found = file.json["meshes"][mesh]
    primitive = found["primitives"][part]
    arrays = {
        name: file.array(target["POSITION"])
        for name, target in zip(found["extras"]["targetNames"], primitive["targets"], strict=True)
    }
    return {name: each for name, each in arrays.items() if each.any()}


@pytest.mark.slow
def test_two_nodes_wrinkle_as_two_primitives_of_one_mesh() -> None:
    """So there is one phase, and neither a hem nor a crack where they meet."""
    one, two = whole(), baked()
    for part in (0, 1):
        wanted, found = moves(one, 0, part), moves(two, part, 0)
        assert wanted
        assert wanted.keys() == found.keys()
        assert all((wanted[name] == found[name]).all() for name in wanted)
    for name, node in (("limb", "limb"), ("cuff", "limb")):
        columns = [one.json["meshes"][0]["extras"]["targetNames"].index(each) for each in names(two, name)]
        assert (two.weights(name, "fold", TIMES) == one.weights(node, "fold", TIMES)[:, columns]).all()
    seam = np.abs(two.attribute("limb", "POSITION")[:, 0]) < 1e-6
    assert np.linalg.norm(two.deltas("limb"), axis=2)[:, seam].max() > 0.01


def names(file: Gltf, node: str) -> list[str]:
    found: list[str] = file.mesh(node)["extras"]["targetNames"]
    return found


@pytest.mark.slow
def test_nodes_stay_as_they_were() -> None:
    before, after = Gltf(apart()), baked()
    assert [each.get("name") for each in after.json["nodes"]] == [each.get("name") for each in before.json["nodes"]]
    limb, cuff = (after.json["nodes"][after.node(name)] for name in ("limb", "cuff"))
    assert (cuff["mesh"], cuff["skin"], cuff["extras"]) == (1, 0, {"worn": True})
    assert after.mesh("cuff")["name"] == "cuff mesh"
    assert after.mesh("cuff")["extras"]["size"] == 3
    assert limb["extras"]["wrinkle"]["parts"] == ["cuff"]
    assert after.json["scenes"] == before.json["scenes"]
    paths = [each["target"] for each in after.json["animations"][0]["channels"] if each["target"]["path"] != "rotation"]
    assert paths == [{"node": after.node(name), "path": "weights"} for name in ("limb", "cuff")]
    assert_valid(after.path)


@pytest.mark.slow
def test_other_programs_show_both() -> None:
    for name in ("limb", "cuff"):
        compare_with_three(baked().path, name, "fold", TIMES, baked().pose(name, "fold", TIMES))


@pytest.mark.slow
def test_the_original_comes_back_and_tracks_reach_both(tmp_path: Path) -> None:
    out = tmp_path / "again.glb"
    wrinklecli.bake(baked().path, tools_file(apart(), BOTH), out, replace=True, max_levels=1)
    assert diff(baked().path, out).same
    track(baked().path, [apart()], tmp_path / "clips")
    (clips,) = (Gltf(path) for path in (tmp_path / "clips").iterdir() if path.suffix in (".glb", ".gltf"))
    played = {
        clips.json["nodes"][each["target"]["node"]]["name"]
        for each in clips.json["animations"][0]["channels"]
        if each["target"]["path"] == "weights"
    }
    assert played == {"limb", "cuff"}


@pytest.mark.slow
def test_a_file_has_all_parts_whatever_is_split() -> None:
    """Nodes are parts already."""
    assert baked(split=True).path.read_bytes() == baked().path.read_bytes()


@pytest.mark.slow
def test_a_list_of_one_is_its_node() -> None:
    one = bake_once(apart(), top={"fields": [{**BOTH, "node": ["cuff"]}]}, max_levels=0)
    assert one.json == bake_once(apart(), top={"fields": [{**BOTH, "node": "cuff"}]}, max_levels=0).json


def other_skin() -> Asset:
    asset = halves()
    joints = asset.gltf["skins"][0]["joints"]
    asset.append("skins", {**asset.gltf["skins"][0], "joints": joints[::-1]})
    asset.gltf["nodes"][-1]["skin"] = 1
    return asset


def shown_twice() -> Asset:
    asset = halves()
    asset.append("nodes", {"name": "copy", "mesh": 1, "skin": 0})
    return asset


def with_targets() -> Asset:
    asset = halves()
    (primitive,) = asset.gltf["meshes"][1]["primitives"]
    primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}]
    return asset


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (other_skin, "cuff has another skin"),
        (shown_twice, "cuff has a mesh that other nodes show too"),
        (with_targets, "cuff has morph targets"),
    ],
)
def test_meshes_that_cannot_be_one_are_told(tmp_path: Path, made: object, why: str) -> None:
    assert callable(made)
    path = place(made())
    with pytest.raises(WrinkleError) as caught:
        wrinklecli.bake(path, tools_file(path, BOTH), tmp_path / "out.glb")
    (line,) = caught.value.lines
    assert f"'limb', 'cuff' cannot be one surface: {why}; give each a field of its own" in line


def test_an_equal_skin_will_do() -> None:
    asset = halves()
    asset.append("skins", dict(asset.gltf["skins"][0]))
    asset.gltf["nodes"][-1]["skin"] = 1
    file = bake_once(place(asset), top={"fields": [BOTH]}, max_levels=0)
    assert file.json["nodes"][file.node("cuff")]["skin"] == 1
    assert moves(file, 1, 0)


@pytest.mark.slow
def test_a_node_that_is_absent_is_told_or_left_out(tmp_path: Path) -> None:
    asset = {**BOTH, "node": ["limb", "cuff", "hood"]}
    with pytest.raises(WrinkleError, match=r"fields\[0\].node: node 'hood' is no node with a mesh"):
        wrinklecli.bake(apart(), tools_file(apart(), asset), tmp_path / "out.glb")
    optional = bake_once(apart(), top={"fields": [{**asset, "optional": True}]}, max_levels=1)
    assert moves(optional, 1, 0).keys() == moves(baked(), 1, 0).keys()


def test_two_gloves_are_fields_of_their_own() -> None:
    """A field without a joint or a node of one side would lie on itself."""
    text = "version: 1\nfields:\n  - {name: glove.L, node: [hand.L, cuff.L], joints: [wrist.L], mirror: x}\n"
    one, other = parse_tools(text).effects
    assert (one.node, one.beside, one.joints) == ("hand.L", ("cuff.L",), ("wrist.L",))
    assert (other.node, other.beside, other.joints) == ("hand.R", ("cuff.R",), ("wrist.R",))
    with pytest.raises(WrinkleError, match="its mirrored field would lie on itself: remove mirror"):
        parse_tools("version: 1\nfields:\n  - {name: glove.L, node: hands, mirror: x}\n")


@pytest.mark.slow
def test_tools_reach_each_of_the_meshes() -> None:
    """A tool may lie on any mesh that is joined."""
    ends = {"origin": [0.2, 0.25, 0.0], "target": [0.8, 0.25, 0.0], "width": 0.2}
    file = bake_once(apart(), {"name": "hand", "node": "cuff", **ends}, top={"fields": [BOTH]}, max_levels=0)
    assert any(name.startswith("wrinkle_hand") for name in names(file, "cuff"))
    assert not any(name.startswith("wrinkle_hand") for name in names(file, "limb"))


@pytest.mark.slow
def test_layers_of_clothes_may_be_one_surface() -> None:
    file = bake_once(place(sleeved_limb(rings=11, sides=8)), top={"fields": [{**BOTH, "node": ["limb", "sleeve"]}]})
    assert moves(file, 0, 0)
    assert moves(file, 1, 0)
