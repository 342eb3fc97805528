"""The range of motion against turns written out here: which joints turn, about what, how far, and what rises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import Asset
from kit.limb import limb_asset
from kit.prepared import as_document, rotation_matrix
from wrinklecli.character.bent import bent_areas
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.pose import joint_matrices, morph_weights, node_matrices
from wrinklecli.character.range_of_motion import range_of_motion
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.numeric.arrays import face_normals

AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}


def motions(asset: Asset) -> dict[str, Clip]:
    document = as_document(asset)
    return {clip.name: clip for clip in range_of_motion(document, [0], read_clips(document)).clips}


def test_a_joint_turns_about_its_own_axes_both_ways() -> None:
    asset = limb_asset(rings=5, sides=4, clip=None)
    asset.gltf["nodes"][2]["rotation"] = [0.5, 0.5, 0.5, 0.5]
    made, rig = motions(asset), read_rig(as_document(asset), 0)
    # The limb's first joint carries all of it. Its second one's bone goes on from the first, along its own z here.
    ends = {(axis, sign * (45 if axis == "z" else 90)) for axis in "xyz" for sign in (-1, 1)}
    assert {*made} == {f"joint_1 about {axis}, {angle:+d}°" for axis, angle in ends}
    rest = node_matrices(rig, None, np.zeros(1), [2])[0, 0, :3, :3]
    for axis, angle in ends:
        half = np.radians(angle) / 2
        turn = rotation_matrix([*(np.sin(half) * np.array(AXES[axis])), np.cos(half)])
        clip = made[f"joint_1 about {axis}, {angle:+d}°"]
        found = node_matrices(rig, clip, np.array([0.0, 1.0]), [2])[:, 0, :3, :3]
        assert found == pytest.approx(np.array([rest, rest @ turn]), abs=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_what_bends_is_what_a_node_carries_in_part(seed: int) -> None:
    """Against sums over all triangles and nodes, of a random hierarchy and random weights."""
    random = np.random.default_rng(seed)
    asset = limb_asset(rings=4, sides=3, joints=5, clip=None)
    nodes, joints = asset.gltf["nodes"], asset.gltf["skins"][0]["joints"]
    parents = {joint: int(random.choice([-1, *joints[:place]])) for place, joint in enumerate(joints)}
    for node in nodes:
        node.pop("children", None)
    for joint, parent in parents.items():
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(joint)
    document = as_document(asset)
    rig = read_rig(document, 0)
    surface = read_surface(document, rig)
    areas, moved = bent_areas(document, [rig, rig])
    sizes = np.linalg.norm(face_normals(surface.positions, surface.triangles), axis=1) / 2
    shares = surface.dense_weights(np.arange(len(surface.positions)), len(joints))[surface.triangles].mean(axis=1)
    for node in range(len(nodes)):
        below = []
        for place, joint in enumerate(joints):
            above = joint
            while above not in (node, -1):
                above = parents.get(above, -1)
            below += [place] * (above == node)
        share = shares[:, below].sum(axis=1)
        assert areas[node] == pytest.approx(np.sum(sizes * share * (1 - share)), abs=1e-9)
        assert moved[node] == pytest.approx(np.sum(sizes * share), abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "ends"),
    [(100.0, {"z, +100°"}), (20.0, {"x, -45°", "x, +45°", "y, -90°", "y, +90°", "z, -90°", "z, +90°"})],
)
def test_a_joint_goes_as_far_as_its_clips_where_these_tell(angle: float, ends: set[str]) -> None:
    assert {*motions(limb_asset(rings=5, sides=4, angle=angle))} == {f"joint_1 about {end}" for end in ends}


def test_joints_of_a_body_turn_as_those_of_people_and_a_face_hardly() -> None:
    asset = limb_asset(rings=16, sides=4, joints=6, clip=None)
    names = ["root", "mixamorig:Spine2", "Arm", "Head", "jaw", "eyebrow.L"]
    for node, name in zip(asset.gltf["nodes"][1:7], names, strict=True):
        node["name"] = name
    ranges = {
        "mixamorig:Spine2": {"ahead": (-15, 35), "aside": (-20, 20), "twisted": (-20, 20)},
        "Arm": {"ahead": (-40, 80), "aside": (-70, 70), "twisted": (-40, 40)},
        "Head": {"ahead": (-25, 25), "aside": (-20, 20), "twisted": (-35, 35)},
        "jaw": {f"about {axis}": (-20, 20) for axis in "xyz"},
        "eyebrow.L": {f"about {axis}": (-8, 8) for axis in "xyz"},
    }
    wanted = {f"{name} {way}, {end:+d}°" for name, ways in ranges.items() for way, ends in ways.items() for end in ends}
    assert {*motions(asset)} == wanted


@pytest.mark.parametrize("own", [[0.0, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5], [0.6, 0.0, 0.8, 0.0]])
def test_a_knee_bends_back_whatever_the_axes_of_its_bone(own: list[float]) -> None:
    """The limb lies along x, and looks along z."""
    asset = limb_asset(rings=5, sides=4, joints=3, clip=None)
    nodes = asset.gltf["nodes"]
    nodes[2]["name"] = "LeftKnee"
    place = np.array(nodes[3]["translation"])
    nodes[2]["rotation"], nodes[3]["translation"] = own, (rotation_matrix(own).T @ place).tolist()
    document = as_document(asset)
    made = {name: clip for name, clip in motions(asset).items() if name.startswith("LeftKnee")}
    assert {*made} == {"LeftKnee ahead, -120°"}
    (clip,) = made.values()
    knee, end = node_matrices(read_rig(document, 0), clip, np.array([1.0]), [2, 3])[0, :, :3, 3]
    length = np.linalg.norm(place)
    assert (end - knee) / length == pytest.approx([-0.5, 0.0, -np.sqrt(0.75)], abs=1e-6)


@pytest.mark.parametrize(
    ("degrees", "ends"),
    [(0.0, {-70, 70}), (30.0, {-70, 70}), (-45.0, {-70, 25}), (-80.0, {-70}), (225.0, {-25, 70})],
)
def test_an_arm_comes_down_beside_the_trunk_however_it_is_stored(degrees: float, ends: set[int]) -> None:
    """The arm lies aside along x, or hangs by so many degrees; that of 225° is on the other side."""
    asset = limb_asset(rings=5, sides=4, joints=3, clip=None)
    half = np.radians(degrees) / 2.0
    asset.gltf["nodes"][2] |= {"name": "LeftArm", "rotation": [0.0, 0.0, float(np.sin(half)), float(np.cos(half))]}
    found = {name for name in motions(asset) if name.startswith("LeftArm aside")}
    assert found == {f"LeftArm aside, {end:+d}°" for end in ends}


@pytest.mark.parametrize(
    ("bend", "ends"), [(20.0, {"bent, +90°"}), (2.0, {f"about {a}, {b}°" for a in "xyz" for b in ("-90", "+90")})]
)
def test_a_finger_bends_as_it_is_bent_in_the_stored_pose(bend: float, ends: set[str]) -> None:
    asset = limb_asset(rings=5, sides=4, joints=3, clip=None)
    turn = np.radians(bend) / 2.0
    asset.gltf["nodes"][2] |= {"name": "LeftIndex2", "rotation": [0.0, 0.0, float(np.sin(turn)), float(np.cos(turn))]}
    found = {name for name in motions(asset) if name.startswith("LeftIndex2")}
    assert {name.replace("-45", "-90").replace("+45", "+90") for name in found} == {f"LeftIndex2 {end}" for end in ends}


def test_a_spine_turns_as_a_spine_though_a_leg_hangs_from_it() -> None:
    """The joints are 3ds Max's Biped's. The limb lies along x, and the leg goes the other way."""
    asset = limb_asset(rings=12, sides=4, joints=4, clip=None)
    nodes = asset.gltf["nodes"]
    for node, name in zip(nodes[2:5], ("Bip01 Spine", "Bip01 Spine1", "Bip01 L Thigh"), strict=True):
        node["name"] = name
    nodes[2]["children"], nodes[3]["children"] = [3, 4], []
    nodes[4]["translation"] = [-x for x in nodes[4]["translation"]]
    found = {name for name in motions(asset) if name.startswith("Bip01 Spine ")}
    ways = {"ahead": (-15, 35), "aside": (-20, 20), "twisted": (-20, 20)}
    assert found == {f"Bip01 Spine {way}, {end:+d}°" for way, ends in ways.items() for end in ends}


def test_all_joints_of_a_finger_bend_as_it_is_curled_however_it_is_spread() -> None:
    """The limb lies along x. The finger is spread from it about y, and one of its joints is curled about z."""
    asset = limb_asset(rings=12, sides=4, joints=6, clip=None)
    nodes, angle = asset.gltf["nodes"], np.radians(10.0)
    for number, place in enumerate(range(3, 7), 1):
        nodes[place]["name"] = f"LeftIndex{number}"
    nodes[3]["rotation"] = [0.0, float(np.sin(angle)), 0.0, float(np.cos(angle))]
    nodes[4]["rotation"] = [0.0, 0.0, float(np.sin(angle)), float(np.cos(angle))]
    document = as_document(asset)
    rig, curl = read_rig(document, 0), rotation_matrix(nodes[3]["rotation"]) @ AXES["z"]
    turns = range_of_motion(document, [0]).turns
    for node in range(3, 7):
        ((axis, ends),) = turns[node]
        (world,) = node_matrices(rig, None, np.zeros(1), [node - 1])[0, :, :3, :3]
        assert world @ axis == pytest.approx(curl, abs=1e-9)
        assert ends.tolist() == pytest.approx([0.0, np.pi / 2])


def test_morph_targets_of_one_name_rise_together_and_those_that_move_nothing_do_not() -> None:
    asset = limb_asset(rings=4, sides=3, morphs=3, skinned=False, clip=None, weights_at="node")
    (mesh,) = asset.gltf["meshes"]
    mesh["extras"]["targetNames"] = ["browInnerUp", "idle", "browInnerUp"]
    asset.gltf["nodes"].append({"name": "twin", "mesh": 0})
    for primitive in mesh["primitives"]:
        count = asset.gltf["accessors"][primitive["targets"][1]["POSITION"]]["count"]
        primitive["targets"][1]["POSITION"] = asset.accessor(np.zeros((count, 3), np.float32))
    document = as_document(asset)
    nodes = [0, len(asset.gltf["nodes"]) - 1]
    (clip,) = range_of_motion(document, nodes, ()).clips
    assert clip.name == "browInnerUp"
    for node in nodes:
        rig = read_rig(document, node)
        wanted = rig.morph_weights.copy()
        wanted[[0, 2]] = 1.0
        assert morph_weights(rig, clip, np.array([1.0]))[0] == pytest.approx(wanted)
    assert not range_of_motion(document, nodes, (), driven={node: {"browInnerUp"} for node in nodes}).clips


def test_names_that_a_clip_has_are_told_apart() -> None:
    asset = limb_asset(rings=4, sides=3, morphs=1, clip="grow")
    asset.gltf["animations"][0]["name"] = "target_0"
    asset.gltf["meshes"][0]["extras"]["targetNames"] = ["target_0"]
    made = motions(asset)
    assert made["target_0#7"].index == 7
    assert [clip.index for clip in made.values()] == list(range(1, 8))


@pytest.mark.slow
def test_the_rest_of_many_joints_is_left_out_and_said() -> None:
    """A chain of 4,000 joints, of which a tenth bends something."""
    asset = limb_asset(rings=160, sides=3, joints=130, clip=None)
    nodes, (skin,) = asset.gltf["nodes"], asset.gltf["skins"]
    last = skin["joints"][-1]
    for _ in range(3800):
        nodes[last]["children"] = [len(nodes)]
        last = len(nodes)
        nodes.append({"name": f"end_{last}"})
    document = as_document(asset)
    found = range_of_motion(document, [0])
    assert len({clip.channels[0].node for clip in found.clips}) == 100
    assert "100 joints" in found.summary
    assert "left out: 29 joints that bend less" in found.summary
    rig = read_rig(document, 0)
    clip = found.clips[-1]
    assert not np.allclose(joint_matrices(rig, clip, np.ones(1)), joint_matrices(rig, None, np.ones(1)))


def test_joints_that_a_headset_poses_one_by_one_do_not_turn_alone() -> None:
    """The limb's joints hang on one node beside each other, as those of a WebXR hand; a clip shows how far one goes."""
    asset = limb_asset(rings=9, sides=4, joints=3)
    nodes, joints = asset.gltf["nodes"], asset.gltf["skins"][0]["joints"]
    for joint in joints:
        nodes[joint].pop("children", None)
    asset.gltf["scenes"][0]["nodes"] = [0, asset.append("nodes", {"name": "hand", "children": joints})]
    document = as_document(asset)
    found = range_of_motion(document, [0])
    assert not found.clips
    assert found.summary == "0 motions of nothing; left out: 3 joints with no joint above or below"
    told = range_of_motion(document, [0], read_clips(document))
    assert {clip.channels[0].node for clip in told.clips} == {2, 3}


def test_skirts_of_a_body_follow_and_do_not_tell_which_way_a_leg_lies() -> None:
    """The limb lies along x. A skirt's bones hang from its thigh, aside and farther out than the knee."""
    asset = limb_asset(rings=16, sides=4, joints=6, clip=None)
    nodes = asset.gltf["nodes"]
    for node, name in zip(nodes[1:7], ("hips", "LeftArm", "LeftForeArm", "LeftUpLeg", "LeftLeg", "Skirt"), strict=True):
        node["name"] = name
    nodes[4]["children"], nodes[5]["children"] = [5, 6], []
    nodes[6]["translation"] = [0.0, 2.0 * nodes[5]["translation"][0], 0.0]
    found = {*motions(asset)}
    assert {f"LeftUpLeg {way}" for way in ("ahead, +95°", "aside, -30°", "twisted, +25°")} <= found
    assert not any("Skirt" in name or "about" in name for name in found)
    nodes[4]["name"] = "thing"  # no legs: no body, so each joint moves
    assert any("Skirt about" in name for name in motions(asset))


def test_the_end_of_a_bone_does_not_turn() -> None:
    asset = limb_asset(rings=16, sides=4, joints=4, clip=None)
    for node, name in zip(asset.gltf["nodes"][2:5], ("LeftFoot", "LeftToeBase", "LeftToe_End"), strict=True):
        node["name"] = name
    found = {*motions(asset)}
    assert "LeftToeBase up, +45°" in found or "LeftToeBase ahead, +45°" in found
    assert not any("Toe_End" in name for name in found)
