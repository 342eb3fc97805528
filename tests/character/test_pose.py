"""Poses against formulas written out here: sampling, hierarchies, skinning by loops over joints and vertices."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.asset import Asset
from kit.limb import limb_asset
from kit.prepared import as_document
from wrinklecli.character.clip import Channel, read_clips, sample
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, node_matrices, transform
from wrinklecli.character.rig import Rig, morph_target_names, read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.errors import AssetError

Floats = NDArray[np.float64]
KEYS = np.array([0.5, 1.0, 2.5, 2.75])
TIMES = np.concatenate([np.linspace(-0.5, 4.0, 91), KEYS])


def channel(values: Any, interpolation: str, *, path: str = "translation", keys: Floats = KEYS) -> Channel:
    return Channel(0, 0, path, keys, np.asarray(values, np.float64), interpolation)


def rotation_matrix(quaternion: Any) -> Floats:
    """By the double cross product, for a vector v: v + 2 w (q × v) + 2 q × (q × v)."""
    *axis, w = np.asarray(quaternion, np.float64) / np.linalg.norm(quaternion)
    columns = [v + 2 * w * np.cross(axis, v) + 2 * np.cross(axis, np.cross(axis, v)) for v in np.eye(3)]
    return np.stack(columns, axis=1)


def local_matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.reshape(node["matrix"], (4, 4), order="F").astype(np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(node.get("rotation", [0, 0, 0, 1])) @ np.diag(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def rig_of(*nodes: dict[str, Any], node: int = 0) -> Rig:
    gltf = {"asset": {"version": "2.0"}, "nodes": list(nodes), "meshes": [{"primitives": [{"attributes": {}}]}]}
    return read_rig(as_document(Asset(gltf)), node)


# --- Sampling ---


def between(time: float) -> int | None:
    """The key before a time, None outside the keys."""
    return next((k for k, (low, high) in enumerate(pairwise(KEYS)) if low <= time < high), None)


def test_linear() -> None:
    values = np.random.default_rng(1).normal(size=(4, 3))
    wanted = np.stack([np.interp(TIMES, KEYS, column) for column in values.T], axis=1)
    assert sample(channel(values, "LINEAR"), TIMES) == pytest.approx(wanted, abs=1e-14)


def test_step_holds_each_key_until_the_next_exactly() -> None:
    values = np.arange(12.0).reshape(4, 3)
    times = np.concatenate([TIMES, np.nextafter(KEYS, -np.inf)])
    wanted = [values[max(int((time >= KEYS).sum()) - 1, 0)] for time in times]
    assert np.array_equal(sample(channel(values, "STEP"), times), wanted)


def test_cubicspline() -> None:
    values = np.random.default_rng(2).normal(size=(4, 3, 5))
    result = sample(channel(values, "CUBICSPLINE", path="weights"), TIMES)
    for time, row in zip(TIMES, result, strict=True):
        k = between(time)
        if k is None:
            wanted = values[0, 1] if time < KEYS[0] else values[-1, 1]
        else:
            # glTF 2.0, appendix C.5, as it is printed there.
            td = KEYS[k + 1] - KEYS[k]
            t = (time - KEYS[k]) / td
            wanted = (
                (2 * t**3 - 3 * t**2 + 1) * values[k, 1]
                + td * (t**3 - 2 * t**2 + t) * values[k, 2]
                + (-2 * t**3 + 3 * t**2) * values[k + 1, 1]
                + td * (t**3 - t**2) * values[k + 1, 0]
            )
        assert row == pytest.approx(wanted, abs=1e-13)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 1e-3, 30.0, 179.0, 181.0, 300.0, 359.9999])
def test_slerp_turns_evenly_the_short_way(degrees: float) -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    half = np.radians(degrees) / 2
    values = [[0, 0, 0, 1], [*(np.sin(half) * axis), np.cos(half)]]
    turn = (degrees + 180.0) % 360.0 - 180.0
    shares = np.linspace(0.0, 1.0, 9)
    result = sample(channel(values, "LINEAR", path="rotation", keys=np.array([0.0, 1.0])), shares)
    for share, quaternion in zip(shares, result, strict=True):
        h = np.radians(turn * share) / 2
        wanted = rotation_matrix([*(np.sin(h) * axis), np.cos(h)])
        assert rotation_matrix(quaternion) == pytest.approx(wanted, abs=1e-12)
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)


def test_slerp_of_keys_that_are_not_unit_is_that_of_their_directions() -> None:
    values = np.random.default_rng(3).normal(size=(4, 4))
    unit = values / np.linalg.norm(values, axis=1, keepdims=True)
    one, other = (sample(channel(v, "LINEAR", path="rotation"), TIMES) for v in (values * 0.3, unit))
    assert one == pytest.approx(other, abs=1e-14)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize("path", ["translation", "rotation"])
def test_held_before_the_first_and_after_the_last_key(interpolation: str, path: str) -> None:
    width = 4 if path == "rotation" else 3
    shape = (4, 3, width) if interpolation == "CUBICSPLINE" else (4, width)
    values = np.random.default_rng(4).normal(size=shape)
    moved = channel(values, interpolation, path=path)
    first, at_first, at_last, last = sample(moved, np.array([-9.0, KEYS[0], KEYS[-1], 99.0]))
    assert np.array_equal(first, at_first)
    assert np.array_equal(last, at_last)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_single_key_holds_for_ever(interpolation: str) -> None:
    values = np.array([[[9.0, 9.0, 9.0], [1.0, 2.0, 3.0], [9.0, 9.0, 9.0]]])
    moved = channel(values if interpolation == "CUBICSPLINE" else values[:, 1], interpolation, keys=KEYS[:1])
    assert np.array_equal(sample(moved, TIMES), np.tile([1.0, 2.0, 3.0], (len(TIMES), 1)))


# --- Hierarchies ---


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


def test_deep_chain_is_no_cycle() -> None:
    nodes: list[dict[str, Any]] = [{"mesh": 0, "translation": [0, 0, 1]}]
    nodes += [{"children": [k], "translation": [1, 0, 0]} for k in range(2000)]
    assert node_matrices(rig_of(*nodes), None, np.zeros(1), [0])[0, 0, :3, 3].tolist() == [2000.0, 0.0, 1.0]


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
    with pytest.raises(AssetError, match=f"#/skins/0: {message}"):
        read_rig(as_document(asset), 0)


# --- Clips ---


def test_clips_of_one_name_and_of_none_are_told_apart() -> None:
    asset = limb_asset(rings=3, sides=4)
    (animation,) = asset.gltf["animations"]
    unnamed = {key: value for key, value in animation.items() if key != "name"}
    asset.gltf["animations"] = [animation, unnamed, animation, {"name": "empty", "channels": [], "samplers": []}]
    clips = read_clips(as_document(asset))
    assert [clip.name for clip in clips] == ["fold", "animation_1", "fold#2"]
    assert [clip.index for clip in clips] == [0, 1, 2]
    assert (clips[0].start, clips[0].end) == (0.0, 2.0)


def test_channels_of_extensions_are_left_out() -> None:
    asset = limb_asset(rings=3, sides=4)
    pointer = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/materials/0"}}}
    asset.gltf["animations"][0]["channels"] += [{"sampler": 0, "target": pointer}, {"sampler": 0, "target": {}}]
    (clip,) = read_clips(as_document(asset))
    assert [(c.index, c.node, c.path) for c in clip.channels] == [(0, 2, "rotation")]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sampler": 9}, "no sampler"),
        ({"sampler": -1}, "is -1"),
        ({"sampler": None}, "is None"),
        ({"target": {"node": 99, "path": "rotation"}}, "refers to nodes.99."),
        ({"target": {"node": 2, "path": "translation"}}, "a key of translation has 4 numbers"),
    ],
)
def test_malformed_channel_is_refused(change: dict[str, Any], message: str) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["animations"][0]["channels"][0] |= change
    with pytest.raises(AssetError, match=rf"limb\.glb#/animations/0.*{message}"):
        read_clips(as_document(asset))


@pytest.mark.parametrize(
    ("times", "values", "interpolation", "message"),
    [
        ([0, 1, 1], np.ones((3, 4)), "LINEAR", "key times must rise"),
        ([0, 2, 1], np.ones((3, 4)), "LINEAR", "key times must rise"),
        ([0, np.nan], np.ones((2, 4)), "LINEAR", "key times must rise"),
        ([0, 1, 2], np.ones((4, 4)), "LINEAR", "3 key times do not fit 16 values"),
        ([0, 1], np.ones((2, 4)), "CUBICSPLINE", "2 key times do not fit 8 values"),
        ([0, 1], np.full((2, 4), np.inf), "LINEAR", "not a finite number"),
        ([0, 1], np.ones((2, 4)), "SMOOTH", "'SMOOTH' is not of glTF 2.0"),
    ],
)
def test_malformed_sampler_is_refused(times: Any, values: Any, interpolation: Any, message: str) -> None:
    asset = Asset({"asset": {"version": "2.0"}, "nodes": [{}]})
    animation: dict[str, Any] = {}
    asset.channel(animation, 0, "rotation", np.array(times, np.float32), values, interpolation)
    asset.append("animations", animation)
    with pytest.raises(AssetError, match=f"#/animations/0/channels/0: .*{message}"):
        read_clips(as_document(asset))


# --- Morph targets ---


@pytest.mark.parametrize(
    ("at", "wanted"), [(None, [0.0, 0.0]), ("mesh", [0.25, 0.25]), ("node", [0.5, 0.5]), ("both", [0.5, 0.5])]
)
def test_stored_weights_of_the_node_go_before_those_of_the_mesh(at: Any, wanted: list[float]) -> None:
    document = as_document(limb_asset(rings=3, sides=4, morphs=2, weights_at=at, morph_clip="LINEAR"))
    rig, (clip,) = read_rig(document, 0), read_clips(document)
    assert rig.morph_names == ("morph_0", "morph_1")
    assert morph_weights(rig, None, np.zeros(2)).tolist() == [wanted, wanted]
    assert morph_weights(rig, clip, np.array([0.3])) == pytest.approx(np.array([[1.0, 0.5]]), abs=1e-7)


def test_clip_that_animates_another_number_of_weights_is_refused() -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2, morph_clip="LINEAR", clip=None)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["targets"].pop()
    document = as_document(asset)
    with pytest.raises(AssetError, match=r"animations/0.* 2 "):
        morph_weights(read_rig(document, 0), read_clips(document)[0], np.zeros(1))


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


# --- Skinning ---


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
