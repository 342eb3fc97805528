"""Muscles that are guessed by the names of bones."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import wrinklecli
from kit.asset import Asset, attribute
from kit.characters import avatar, cartoon, dressed, tubes
from kit.command import Wrinkle
from kit.limb import limb
from kit.player import Gltf
from kit.suggested import each_once
from wrinklecli.review.check import check
from wrinklecli.tools.records import JointPoint

NAMES = ["biceps", "triceps", "forearm_flexors", "quadriceps", "hamstrings", "calf"]


def plumed() -> Asset:
    """A person with a plume, which the head alone carries: no muscle is below it. The right forearm is longer."""
    asset = tubes()
    hand = next(node for node in asset.gltf["nodes"] if node["name"] == "hand.R")
    hand["translation"] = [1.15 * x for x in hand["translation"]]
    joints = asset.gltf["skins"][0]["joints"]
    head = next(k for k, joint in enumerate(joints) if asset.gltf["nodes"][joint]["name"].lower().endswith("head"))
    places = np.array([[0.0, 1.8, 0.0], [0.1, 1.8, 0.0], [0.0, 2.0, 0.0]])
    attributes = {
        "POSITION": asset.accessor(places),
        "JOINTS_0": asset.accessor(np.tile([head, 0, 0, 0], (3, 1)), "u1"),
        "WEIGHTS_0": asset.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))),
    }
    mesh = asset.append("meshes", {"primitives": [{"attributes": attributes}]})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "plume", "mesh": mesh, "skin": 0}))
    return asset


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.quick(2)
def test_a_body_gets_muscles_on_both_sides_that_bake(tmp_path: Path) -> None:
    asset = tubes().write(tmp_path / "tubes.glb")
    found = wrinklecli.suggest(asset, muscles=True, range_of_motion=True)
    assert [each.effect.name for each in found.guesses] == [f"{name}.L" for name in NAMES]
    assert all(each.mirrored for each in found.guesses)
    assert "guess" in found.text
    (tmp_path / "muscles.yaml").write_text(found.text)
    report = wrinklecli.bake(asset, tmp_path / "muscles.yaml", tmp_path / "out.glb")
    assert len(report.data["muscles"]) == 2 * len(NAMES)


@pytest.mark.slow
def test_joints_with_a_number_behind_their_side_are_no_mirror_images(tmp_path: Path) -> None:
    """Sketchfab numbers all nodes, so the other side has another name, and `mirror` would find no joint."""
    asset = tubes()
    for number, node in enumerate(asset.gltf["nodes"]):
        node["name"] = f"{node['name']}_{number:02}"
    path = asset.write(tmp_path / "tubes.glb")
    found = wrinklecli.suggest(path, muscles=True, range_of_motion=True, count=4)
    assert [each.effect.name for each in found.guesses] == ["biceps.L", "biceps.R", "triceps.L", "triceps.R"]
    (tmp_path / "muscles.yaml").write_text(found.text)
    assert len(check(path, tmp_path / "muscles.yaml").data["muscles"]) == 4


@pytest.mark.slow
def test_muscles_lie_on_the_sides_of_their_bones(tmp_path: Path) -> None:
    """A biceps and the thigh's quadriceps in front, triceps, hamstrings and calf behind, flexors below."""
    found = wrinklecli.suggest(plumed().write(tmp_path / "tubes.glb"), muscles=True, range_of_motion=True)
    sides = {}
    for each in found.guesses:
        assert isinstance(each.effect.origin, JointPoint)
        _, y, z = each.effect.origin.offset
        sides[each.effect.name] = z if abs(z) > 1e-9 else y
    signs = [np.sign(sides[f"{name}.L"]) for name in NAMES]
    assert signs == [1.0, -1.0, -1.0, 1.0, -1.0, -1.0]
    # The forearms are not mirror images of each other.
    assert {each.effect.name for each in found.guesses if not each.mirrored} == {
        "forearm_flexors.L",
        "forearm_flexors.R",
    }


@pytest.mark.slow
def test_muscles_that_no_clip_moves_are_left_out(tmp_path: Path) -> None:
    """A clip that bends the right arm moves its muscles; the left arm gets the same, as its mirror image."""
    found = wrinklecli.suggest(tubes().write(tmp_path / "tubes.glb"), muscles=True)
    assert [each.effect.name for each in found.guesses] == [f"{name}.L" for name in NAMES[:3]]
    assert list(found.notes) == [f"{name}.L: left out, as no clip changes its length" for name in NAMES[3:]]
    biceps, triceps, _ = (each.facts for each in found.guesses)
    assert biceps["shortening"] > 0.1
    assert biceps["height"] > 0.005
    assert abs(triceps["height"]) < biceps["height"] / 4.0


@pytest.mark.slow
def test_what_a_clip_does_to_a_muscle_is_what_check_says(tmp_path: Path) -> None:
    asset = dressed().write(tmp_path / "dressed.glb")
    found = wrinklecli.suggest(asset, muscles=True)
    (tmp_path / "muscles.yaml").write_text(found.text)
    checked = {each["name"]: each["clips"] for each in check(asset, tmp_path / "muscles.yaml").data["muscles"]}
    assert found.guesses
    for each in found.guesses:
        names = [each.effect.name, *([each.effect.name[:-1] + "R"] if each.mirrored else [])]
        moves = [end for name in names for clip in checked[name] for end in clip["bulge"]]
        assert each.facts["height"] == pytest.approx(max(map(abs, moves)), rel=0.1)


@pytest.mark.slow
def test_hamstrings_begin_right_below_the_buttock(tmp_path: Path) -> None:
    """From 0.77 m down they leave a hollow below the buttock, of which the crease is at 0.83 m, as they swell."""
    asset = cartoon().write(tmp_path / "cartoon.glb")
    (tmp_path / "muscles.yaml").write_text(wrinklecli.suggest(asset, muscles=True, range_of_motion=True).text)
    wrinklecli.bake(asset, tmp_path / "muscles.yaml", tmp_path / "out.glb", only=["hamstrings.L"])
    file = Gltf(tmp_path / "out.glb")
    moves = np.linalg.norm(file.deltas("Toon")[0], axis=1)
    heights = file.attribute("Toon", "POSITION")[moves > 0.02 * moves.max(), 1]
    assert 0.80 < heights.max() < 0.84


@pytest.mark.slow
@pytest.mark.parametrize(("part", "node"), [(0.2, "Figure"), (0.4, "sleeve")])
def test_a_sleeve_is_lifted_that_has_enough_of_the_arm(part: float, node: str, tmp_path: Path) -> None:
    """As much of the skin weights of the upper arm as the layers of a garment have, and not a ribbon."""
    asset = tubes()
    joints = {each["name"]: number for number, each in enumerate(asset.gltf["nodes"])}
    arm, shoulder = (asset.gltf["skins"][0]["joints"].index(joints[name]) for name in ("upper_arm.L", "shoulder.L"))
    weights = attribute(asset, 0, "WEIGHTS_0")[attribute(asset, 0, "JOINTS_0") == arm].sum()
    angles, along = np.meshgrid(np.arange(16) * np.pi / 8.0, np.linspace(0.2, 0.44, 12))
    places = np.stack([along, 1.39 + 0.09 * np.cos(angles), 0.09 * np.sin(angles)], axis=-1).reshape(-1, 3)
    ids = np.arange(12 * 16).reshape(12, 16)
    a, b, c, d = ids[:-1], ids[1:], np.roll(ids[1:], -1, axis=1), np.roll(ids[:-1], -1, axis=1)
    triangles = np.stack([a, c, b, a, d, c], axis=-1)
    share = part * weights / len(places)
    attributes = {
        "POSITION": asset.accessor(places, bounds=True),
        "JOINTS_0": asset.accessor(np.tile([arm, shoulder, 0, 0], (len(places), 1)), "u1"),
        "WEIGHTS_0": asset.accessor(np.tile([share, 1.0 - share, 0.0, 0.0], (len(places), 1))),
    }
    primitive = {"attributes": attributes, "indices": asset.accessor(triangles.reshape(-1), "u2")}
    mesh = asset.append("meshes", {"primitives": [primitive]})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "sleeve", "mesh": mesh, "skin": 0}))
    found = wrinklecli.suggest(asset.write(tmp_path / "worn.glb"), muscles=True, range_of_motion=True)
    assert share < 1.0
    assert {each.effect.name: each.effect.node for each in found.guesses}["biceps.L"] == node


@pytest.mark.slow
@pytest.mark.long
def test_muscles_below_clothes_lift_the_clothes(tmp_path: Path) -> None:
    """The outermost of several meshes round a bone is what one sees; the arm in it says how thick a muscle is."""
    asset = avatar().write(tmp_path / "avatar.glb")
    muscles = {each.effect.name: each for each in wrinklecli.suggest(asset, muscles=True, range_of_motion=True).guesses}
    biceps, quadriceps = muscles["biceps.L"], muscles["quadriceps.L"]
    assert biceps.effect.node != quadriceps.effect.node
    body = "mesh_0"
    assert body not in {each.effect.node for each in muscles.values()}
    assert biceps.facts["depth"] == pytest.approx(0.0465, abs=2e-3)


@pytest.mark.slow
@pytest.mark.long
def test_guessed_muscles_are_no_lumps(tmp_path: Path) -> None:
    """A squat moves the skin over the hamstrings by less than a third of the way to the bone."""
    asset = dressed().write(tmp_path / "dressed.glb")
    found = wrinklecli.suggest(asset, muscles=True, range_of_motion=True)
    (tmp_path / "muscles.yaml").write_text(found.text)
    for muscle in check(asset, tmp_path / "muscles.yaml").data["muscles"]:
        for clip in muscle["clips"]:
            assert clip["bulge"][1] < 0.33 * muscle["depth"]


@pytest.mark.parametrize("count", [1, 2])
def test_skeletons_of_the_same_names_give_one_line_for_each_muscle(count: int, tmp_path: Path) -> None:
    """Copies of a body's skeleton beside it, which no mesh follows."""
    asset = tubes()
    nodes, skin = asset.gltf["nodes"], asset.gltf["skins"][0]
    for _ in range(count):
        copies = {number: len(nodes) + place for place, number in enumerate(skin["joints"])}
        for number in skin["joints"]:
            children = [copies[each] for each in nodes[number].get("children", ()) if each in copies]
            copy = {key: value for key, value in nodes[number].items() if key != "children"}
            asset.append("nodes", copy | ({"children": children} if children else {}))
        held = {each for number in copies.values() for each in nodes[number].get("children", ())}
        asset.gltf["scenes"][0]["nodes"] += [number for number in copies.values() if number not in held]
        asset.append("skins", {**skin, "joints": list(copies.values())})
    found = wrinklecli.suggest(asset.write(tmp_path / "tubes.glb"), muscles=True)
    muscles = [line.partition(":")[0] for line in found.notes if "left out" in line]
    assert muscles.count("biceps.L") == muscles.count("calf.R") == 1
    assert len(muscles) == len(set(muscles))


def test_a_limb_without_names_gets_none(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.gltf", rings=9, sides=8)
    ran = wrinkle("suggest", asset, "--muscles", "-o", tmp_path / "muscles.yaml")
    assert ran.code == 1
    assert "nothing to suggest: no joints are named as upper arm" in ran.lines[-1]
    assert not (tmp_path / "muscles.yaml").exists()


@pytest.mark.slow
@each_once()
def test_the_command_prints_a_file_and_json(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = tubes().write(tmp_path / "tubes.glb")
    ran = wrinkle("suggest", asset, "--muscles")
    listed = yaml.safe_load(ran.out)["muscles"]
    assert ran.code == 0
    rows = [line.split()[0] for line in ran.lines if not line.startswith("note: ")]
    assert rows == ["muscle", *(each["name"] for each in listed)]
    data = json.loads(wrinkle("suggest", asset, "--muscles", "--json").out)
    assert [each["name"] for each in data["muscles"]] == [each["name"] for each in listed]
    assert data["muscles"][0]["origin"] == listed[0]["origin"]
    assert wrinkle("suggest", asset, "--muscles", "--face").code == 2
