"""Poses said in words: turns of joints about their own axes, weights of morph targets."""

import math

import numpy as np
import pytest

from kit.limb import limb_asset
from kit.prepared import as_document, rotation_matrix
from wrinklecli.character.clip import read_clips
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.pose import morph_weights, node_matrices
from wrinklecli.character.posing import with_pose
from wrinklecli.character.rig import read_rig
from wrinklecli.errors import AssetError


@pytest.mark.parametrize("stored", ["rotation", "matrix"])
def test_turns_of_a_joint_follow_one_another_about_its_own_axes(stored: str) -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2, weights_at="node")
    node = asset.gltf["nodes"][2]
    turn = [0.5, -0.1, 0.3, 0.8]
    if stored == "matrix":
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation_matrix(turn), node.pop("translation")
        node["matrix"] = matrix.T.ravel().tolist()
    else:
        node["rotation"] = (np.array(turn) / np.linalg.norm(turn)).tolist()
    document = as_document(asset)
    posed = with_pose(document, [("joint_1", "x", 40.0), ("joint_1", "z", -70.0)], [("morph_1", 0.25)])
    rig, clip = read_rig(posed, 0), read_clips(posed)[-1]
    assert clip.name == "joint_1=x:40 joint_1=z:-70 morph_1=0.25"
    about_x = rotation_matrix([math.sin(math.radians(20)), 0, 0, math.cos(math.radians(20))])
    about_z = rotation_matrix([0, 0, -math.sin(math.radians(35)), math.cos(math.radians(35))])
    before, after = (node_matrices(rig, of, np.zeros(1), [2])[0, 0] for of in (None, clip))
    assert after[:3, :3] == pytest.approx(before[:3, :3] @ about_x @ about_z, abs=1e-6)
    assert after[:3, 3] == pytest.approx(before[:3, 3])
    assert morph_weights(rig, clip, np.zeros(1))[0] == pytest.approx([rig.morph_weights[0], 0.25])


@pytest.mark.parametrize("theirs", ["mixamorig:joint_1", "mixamorig9:joint_1", "joint_1", "joint_0/mixamorig:joint_1"])
def test_joints_are_found_without_prefixes_and_by_paths(theirs: str) -> None:
    asset = limb_asset(rings=3, sides=4)
    nodes = asset.gltf["nodes"]
    nodes[2]["name"] = "mixamorig:joint_1"
    found = moved(as_document(asset), (), Motions(range_of_motion=False, pose=[(theirs, "x", 40.0)]))
    assert [channel.node for channel in found.clips[-1].channels] == [2]
    alike = f"{theirs!r} counts as 'mixamorig:joint_1', as their names are the same without prefixes"
    assert [alike in note for note in found.notes] == [True] * (theirs in ("mixamorig9:joint_1", "joint_1"))
    nodes.append({"name": "other:joint_1"})
    if found.notes:
        with pytest.raises(AssetError, match="has no joint"):
            with_pose(as_document(asset), [(theirs, "x", 40.0)], [])


def test_names_that_there_are_not_and_numbers_that_are_none_are_refused() -> None:
    document = as_document(limb_asset(rings=3, sides=4, morphs=2))
    with pytest.raises(
        AssetError, match=r"limb\.glb: has no joint 'joint1'; did you mean 'joint_1'\?; there are 'joint_0'"
    ):
        with_pose(document, [("joint1", "x", 1.0)], [])
    with pytest.raises(
        AssetError, match=r"limb\.glb: has no morph target 'morph1'; did you mean 'morph_1'\?; there are"
    ):
        with_pose(document, [], [("morph1", 1.0)])
    for turns, weights in (
        ([("joint_1", "w", 1.0)], []),
        ([("joint_1", "x", math.nan)], []),
        ([], [("morph_1", 1e99)]),
    ):
        with pytest.raises(ValueError, match="are"):
            with_pose(document, turns, weights)
    asset = limb_asset(rings=3, sides=4)
    sheared = np.eye(4)
    sheared[0, 1] = 0.1
    asset.gltf["nodes"][2] = {"name": "joint_1", "matrix": sheared.T.ravel().tolist()}
    with pytest.raises(AssetError, match="'joint_1' cannot turn: it is stored as a matrix that shears"):
        with_pose(as_document(asset), [("joint_1", "x", 1.0)], [])
