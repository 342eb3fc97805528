"""Poses against formulas written out here: hierarchies, and skinning by loops over joints and vertices."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.limb import limb_asset
from kit.prepared import as_document, rig_of, rotation_matrix
from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import blend, joint_matrices, node_matrices, transform
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface

Floats = NDArray[np.float64]


def local_matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.reshape(node["matrix"], (4, 4), order="F").astype(np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(node.get("rotation", [0, 0, 0, 1])) @ np.diag(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def _chain() -> list[dict[str, Any]]:
    """Root with a matrix, a mirrored child, and a turned grandchild of another scale on each axis."""
    matrix = np.eye(4)
    matrix[:3] += np.random.default_rng(5).normal(size=(3, 4)) / 3
    return [
        {"mesh": 0, "translation": [1, 2, 3], "rotation": [0.5, -0.5, 0.1, 2], "scale": [1, 2, 3]},
        {"children": [2], "matrix": matrix.T.ravel().tolist()},
        {"children": [0], "scale": [-1, 1, 1], "rotation": [0, 0, 0.6, 0.8]},
    ]


def test_world_matrix_is_the_product_from_the_root_down() -> None:
    nodes = _chain()
    wanted = local_matrix(nodes[1]) @ local_matrix(nodes[2]) @ local_matrix(nodes[0])
    matrices = node_matrices(rig_of(*nodes), None, np.zeros(2), [0, 1])
    assert matrices.shape == (2, 2, 4, 4)
    assert matrices[1, 0] == pytest.approx(wanted, abs=1e-14)
    assert np.array_equal(matrices[0, 1], local_matrix(nodes[1]))


def test_unskinned_mesh_follows_its_node_alone() -> None:
    rig = rig_of(*_chain())
    assert not rig.skinned
    assert rig.joints.tolist() == [0]
    assert np.array_equal(joint_matrices(rig, None, np.zeros(1)), node_matrices(rig, None, np.zeros(1), [0]))


def test_clip_moves_what_it_animates_and_leaves_the_rest_as_stored() -> None:
    asset = limb_asset(rings=3, sides=4, root={"translation": [0, 5, 0], "scale": [2, 2, 2]})
    document = as_document(asset)
    rig, (clip,) = read_rig(document, 0), read_clips(document)
    nodes = asset.gltf["nodes"]
    turned = nodes[2] | {"rotation": [0, 0, np.sin(np.radians(50)), np.cos(np.radians(50))]}
    wanted = local_matrix(nodes[3]) @ local_matrix(nodes[1]) @ local_matrix(turned)
    bind = np.eye(4)
    result = joint_matrices(rig, clip, np.array([0.0, 1.0, 7.0]))
    assert result[1, 1] == pytest.approx(wanted @ bind, abs=1e-6)  # keys are float32
    assert np.array_equal(result[0], result[2])
    assert np.array_equal(result[:, 0], np.tile(result[0, 0], (3, 1, 1)))
    assert np.array_equal(joint_matrices(rig, clip, np.array([1.0]), np.array([1])), result[1:2, 1:])


def test_deep_chain_is_no_cycle() -> None:
    nodes: list[dict[str, Any]] = [{"mesh": 0, "translation": [0, 0, 1]}]
    nodes += [{"children": [k], "translation": [1, 0, 0]} for k in range(2000)]
    assert node_matrices(rig_of(*nodes), None, np.zeros(1), [0])[0, 0, :3, 3].tolist() == [2000.0, 0.0, 1.0]


@given(seed=st.integers(0, 999), vertices=st.integers(1, 5), joints=st.integers(1, 4), morphed=st.booleans())
def test_skinning_is_the_sum_over_joints(seed: int, vertices: int, joints: int, morphed: bool) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(joints), vertices)
    matrices = rng.normal(size=(3, joints, 4, 4))
    matrices[:, :, 3] = [0, 0, 0, 1]
    positions = rng.normal(size=(3, vertices, 3) if morphed else (vertices, 3))
    result = transform(blend(weights, matrices), positions)
    for frame in range(3):
        for vertex in range(vertices):
            point = np.append(positions[frame, vertex] if morphed else positions[vertex], 1.0)
            wanted = sum(weights[vertex, j] * (matrices[frame, j] @ point) for j in range(joints))
            assert result[frame, vertex] == pytest.approx(wanted[:3], abs=1e-13)


def test_moving_the_root_rigidly_moves_the_skin_rigidly() -> None:
    quaternion, shift = [0.1, -0.7, 0.3, 0.6], [3.0, -1.0, 2.0]
    still, moved = limb_asset(rings=6, sides=5), limb_asset(rings=6, sides=5, root={})
    moved.gltf["nodes"][3] |= {"rotation": quaternion, "translation": shift}
    times, posed = np.array([0.0, 0.4, 1.0]), []
    for asset in (still, moved):
        document = as_document(asset)
        rig, (clip,) = read_rig(document, 0), read_clips(document)
        surface = read_surface(document, rig)
        weights = surface.dense_weights(np.arange(len(surface.positions)), 2)
        posed.append(transform(blend(weights, joint_matrices(rig, clip, times)), surface.positions))
    assert posed[1] == pytest.approx(posed[0] @ rotation_matrix(quaternion).T + shift, abs=1e-13)
