"""Rigs as they are stored: inverse binds, names and weights; what is malformed is refused."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.asset import Asset
from kit.limb import limb_asset
from kit.prepared import as_document, rig_of
from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.rig import morph_target_names, moving_nodes, read_rig
from wrinklecli.errors import AssetError

Floats = NDArray[np.float64]


def test_missing_inverse_binds_are_identities() -> None:
    rig = read_rig(as_document(limb_asset(rings=3, sides=4, inverse_binds=False, joints=3)), 0)
    assert np.array_equal(rig.inverse_binds, np.tile(np.eye(4), (3, 1, 1)))


def test_inverse_binds_are_stored_by_columns() -> None:
    rig = read_rig(as_document(limb_asset(rings=3, sides=4)), 0)
    assert rig.inverse_binds[0, :3, 3].tolist() == [1.0, 0.0, 0.0]
    # The stored pose is the bind pose: every joint matrix is the identity.
    assert joint_matrices(rig, None, np.zeros(1))[0] == pytest.approx(np.tile(np.eye(4), (2, 1, 1)), abs=1e-15)


@pytest.mark.parametrize(
    "children",
    [{0: [0]}, {0: [1], 1: [0]}, {1: [2], 2: [3], 3: [1]}],
)
def test_cycle_is_refused(children: dict[int, list[int]]) -> None:
    nodes: list[dict[str, Any]] = [{"mesh": 0}, {}, {}, {}]
    for node, its in children.items():
        nodes[node]["children"] = its
    with pytest.raises(AssetError, match=r"limb\.glb#/nodes/\d: is its own ancestor"):
        rig_of(*nodes)


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ([{"mesh": 0, "children": [4]}], r"#/nodes/0/children: refers to nodes\[4\], but there are 1"),
        ([{"mesh": 0, "children": [-1]}], "#/nodes/0/children"),
        ([{"mesh": 3}], r"#/nodes/0: refers to meshes\[3\], but there are 1"),
        ([{"mesh": 0, "skin": 0}], r"#/nodes/0: refers to skins\[0\], but there are 0"),
        ([{"mesh": 0, "rotation": [0, 0, 1]}], "#/nodes"),
        ([{"mesh": 0, "scale": [1, "x", 1]}], "#/nodes"),
        ([{"mesh": 0, "matrix": [1, 2, 3]}], "#/nodes"),
        ([{"mesh": 0, "weights": "x"}], "#/nodes"),
    ],
)
def test_malformed_nodes_are_refused(nodes: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(AssetError, match=message):
        rig_of(*nodes)


@pytest.mark.parametrize(
    ("skin", "message"),
    [
        ({"joints": []}, "has no joints"),
        ({}, "has no joints"),
        ({"joints": [1, 99]}, "refers to nodes.99."),
        ({"joints": [1, 2], "inverseBindMatrices": 99}, "refers to accessors.99."),
        ({"joints": [1, 2], "inverseBindMatrices": 0}, "needs 2 inverse bind matrices"),
        ({"joints": [1, 2, 0], "inverseBindMatrices": "its own"}, "needs 3 inverse bind matrices, has 2"),
    ],
)
def test_malformed_skin_is_refused(skin: dict[str, Any], message: str) -> None:
    asset = limb_asset(rings=3, sides=4)
    if skin.get("inverseBindMatrices") == "its own":
        skin = skin | {"inverseBindMatrices": asset.gltf["skins"][0]["inverseBindMatrices"]}
    asset.gltf["skins"] = [skin]
    with pytest.raises(AssetError, match=f"#/skins/0(/joints)?: {message}"):
        read_rig(as_document(asset), 0)


@pytest.mark.parametrize(
    ("at", "wanted"), [(None, [0.0, 0.0]), ("mesh", [0.25, 0.25]), ("node", [0.5, 0.5]), ("both", [0.5, 0.5])]
)
def test_stored_weights_of_the_node_go_before_those_of_the_mesh(at: Any, wanted: list[float]) -> None:
    document = as_document(limb_asset(rings=3, sides=4, morphs=2, weights_at=at, morph_clip="LINEAR"))
    rig, (clip,) = read_rig(document, 0), read_clips(document)
    assert rig.morph_names == ("morph_0", "morph_1")
    assert morph_weights(rig, None, np.zeros(2)).tolist() == [wanted, wanted]
    assert morph_weights(rig, clip, np.array([0.3])) == pytest.approx(np.array([[1.0, 0.5]]), abs=1e-7)


@pytest.mark.parametrize(
    ("extras", "wanted"),
    [
        ({"targetNames": ["a", "b"]}, ["a", "b"]),
        ({"targetNames": ["a"]}, ["a", "target_1"]),
        ({"targetNames": ["a", "b", "c"]}, ["a", "b"]),
        ({"targetNames": None}, ["target_0", "target_1"]),
        (None, ["target_0", "target_1"]),
        ("text", ["target_0", "target_1"]),
    ],
)
def test_morph_target_names(extras: Any, wanted: list[str]) -> None:
    assert morph_target_names({"primitives": [{"targets": [{}, {}]}], "extras": extras}) == wanted


def test_moving_nodes_are_joints_their_ancestors_and_the_mesh() -> None:
    asset = limb_asset(rings=3, sides=4, joints=3, root={})
    asset.gltf["nodes"].append({"name": "hat"})
    assert moving_nodes(read_rig(as_document(asset), 0)) == {0, 1, 2, 3, 4}


def test_nodes_without_a_name_get_one_that_no_other_has() -> None:
    nodes = [{"name": "node_1", "mesh": 0}, {}, {"name": ""}, {"name": "node_2_2"}, {"name": "node_2"}]
    asset = Asset({"asset": {"version": "2.0"}, "nodes": nodes, "meshes": [{"primitives": []}]})
    assert read_rig(as_document(asset), 0).names == ("node_1", "node_1_2", "node_2_3", "node_2_2", "node_2")
