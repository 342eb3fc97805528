"""Pruned skin weights keep their sums, move between near joints, and the error that pruning makes is measured."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.character.pose import joint_matrices
from wrinklecli.errors import TooMuchError
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.prune import Poses, joint_distances, prune, pruning_errors

Floats = NDArray[np.float64]


def distances_of(prepared: Prepared) -> Floats:
    """(joints, joints) distances of all joints."""
    return joint_distances(prepared.rig, prepared.patches, np.arange(len(prepared.rig.joints)))


@st.composite
def weight_rows(draw: st.DrawFn) -> tuple[Floats, Floats, int]:
    joints = draw(st.integers(1, 7))
    shares = draw(
        st.lists(st.lists(st.integers(0, 9), min_size=joints, max_size=joints).filter(any), min_size=1, max_size=5)
    )
    weights = np.array(shares, float)
    apart = np.array(draw(st.lists(st.integers(1, 30), min_size=joints, max_size=joints)))
    # Joints form a star: distances through its middle add up.
    distances = (apart[:, None] + apart) * ~np.eye(joints, dtype=bool)
    return weights / weights.sum(axis=1, keepdims=True), distances.astype(float), draw(st.integers(1, 5))


@given(weight_rows())
def test_pruned_weights_keep_sum_and_joints(rows: tuple[Floats, Floats, int]) -> None:
    weights, distances, influences = rows
    joints, kept = prune(weights, distances, influences)
    assert joints.shape == kept.shape == (len(weights), influences)
    assert kept.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert (kept >= 0).all()
    assert (np.diff(kept, axis=1) <= 0).all(), "heaviest first"
    for row, its_joints, its_weights in zip(weights, joints, kept, strict=True):
        used = its_joints[its_weights > 0]
        assert len(set(used)) == len(used)
        assert (row[used] > 0).all(), "no joint comes in that was not there"
        assert (its_weights[its_weights > 0] >= row[used] - 1e-15).all()
        assert not its_joints[its_weights == 0].any()
        if (row > 0).sum() <= influences:
            assert np.array_equal(np.sort(row[row > 0]), np.sort(its_weights[its_weights > 0]))


def test_one_influence_too_many_goes_where_it_costs_least() -> None:
    # Joints on a line at 0, 1, 2, 10: the lightest one is far from all, so another near its neighbour goes.
    places = np.array([0.0, 1.0, 2.0, 10.0])
    distances = np.abs(places[:, None] - places)
    joints, kept = prune(np.array([[0.4, 0.2, 0.25, 0.15]]), distances, 3)
    assert joints.tolist() == [[0, 2, 3]]
    # Joint 1 costs 0.2 wherever it goes, joint 3 costs 1.2; joints 0 and 2 are equally near, so the heavier takes it.
    assert kept == pytest.approx(np.array([[0.6, 0.25, 0.15]]), abs=1e-15)


def test_pruning_never_mixes_across_the_bending_bone_if_it_need_not() -> None:
    """Influences lie on both sides of the fold; a side is merged with itself before it goes to the other."""
    prepared = prepare(limb_asset(rings=9, sides=8, joints=6), tool(origin=[-0.3, RADIUS, 0], target=[0.3, RADIUS, 0]))
    distances = distances_of(prepared)
    bent = int(np.argmax(np.diff(distances[0])))  # the bone between joint `bent` and the next
    rng = np.random.default_rng(3)
    weights = rng.dirichlet(np.ones(6), 50)
    joints, kept = prune(weights, distances, 4)
    near = np.zeros(50)
    for column in range(4):
        near += np.where(joints[:, column] <= bent, kept[:, column], 0)
    assert near == pytest.approx(weights[:, : bent + 1].sum(axis=1), abs=1e-14)


def test_bones_between_the_anchors_are_long() -> None:
    # Joints 0 … 4 of a limb from -1 to 1: the anchors at ±0.4 depend on joints 1 and 3.
    prepared = prepare(limb_asset(rings=9, sides=8, joints=5))
    distances = distances_of(prepared)
    bones = np.diagonal(distances, 1)
    assert bones[[0, 3]].tolist() == [1.0, 1.0]
    assert (bones[[1, 2]] > 100).all()
    assert np.array_equal(distances, distances.T)
    # Lengths add up along a chain.
    ends = np.concatenate([[0.0], np.cumsum(bones)])
    assert np.array_equal(distances, np.abs(ends[:, None] - ends))


@pytest.mark.parametrize("start", np.linspace(-0.99, -0.85, 8).tolist())
def test_no_bone_bends_between_anchors_on_one_joint(start: float) -> None:
    """The weights of either anchor sum to 1 or, by rounding, to a little more or less."""
    ends = {"origin": [start, RADIUS, 0.01], "target": [start + 0.09, RADIUS, -0.02]}
    prepared = prepare(limb_asset(rings=9, sides=8, joints=3), tool(**ends, width=0.1))
    assert np.diagonal(distances_of(prepared), 1).tolist() == [1.0, 1.0]


def test_joints_of_separate_trees_are_furthest() -> None:
    asset = limb_asset(rings=9, sides=8, joints=3)
    asset.gltf["nodes"][2]["children"] = []
    prepared = prepare(asset, tool(origin=[-0.97, RADIUS, 0], target=[-0.8, RADIUS, 0], width=0.1))
    distances = distances_of(prepared)
    assert distances[0, 1] == 1.0
    assert distances[0, 2] == distances[2, 1] > 100


@given(seed=st.integers(0, 999))
def test_pruning_errors_are_those_of_skinning_both_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(5), 4)
    positions, poses = rng.normal(size=(4, 3)), rng.normal(size=(3, 5, 4, 4))
    poses[:, :, 3] = [0, 0, 0, 1]
    distances = np.abs(np.arange(5)[:, None] - np.arange(5)).astype(float)
    joints, kept = prune(weights, distances, 2)
    errors = pruning_errors(weights, positions, distances, 2, poses)
    for vertex in range(4):
        point = np.append(positions[vertex], 1.0)
        exact = np.einsum("j,pjab,b->pa", weights[vertex], poses, point)
        stored = np.einsum("j,pjab,b->pa", kept[vertex], poses[:, joints[vertex]], point)
        assert errors[vertex] == pytest.approx(np.linalg.norm(exact - stored, axis=1).max(), abs=1e-12)


def test_distances_of_some_joints_are_those_among_all() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8, joints=6))
    chosen = np.array([1, 3, 4])
    some = joint_distances(prepared.rig, prepared.patches, chosen)
    assert np.array_equal(some, distances_of(prepared)[np.ix_(chosen, chosen)])


def test_poses_are_of_the_joints_and_the_clips_that_move_them() -> None:
    """A motion of a joint further out moves nothing of a region, and takes no memory; the matrices are true."""
    asset = limb_asset(rings=5, sides=4, joints=6, clip=None)
    turns = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.6, 0.8]])
    for joint in range(6):
        animation: dict[str, Any] = {"name": f"turn {joint}"}
        asset.channel(animation, 1 + joint, "rotation", [0.0, 1.0], turns)
        asset.append("animations", animation)
    made = prepare(asset)
    poses = Poses(made.rig, tuple(made.clips), Memory())
    found = poses.of(np.array([1, 2]))
    assert found.shape == (1 + 33 * 3, 2, 4, 4)
    assert poses.of(np.array([1, 2])) is found
    still, times = joint_matrices(made.rig, None, np.zeros(1)), np.linspace(0.0, 1.0, 33)
    moved = [joint_matrices(made.rig, clip, times) for clip in made.clips]
    assert np.array_equal(found, np.concatenate([still, *moved[:3]])[:, 1:3])
    assert all((each[:, 1:3] == still[:, 1:3]).all() for each in moved[3:])
    with pytest.raises(TooMuchError, match=r"^limb: 100 poses of 2 joints would take 76.8 kB.*: raise --max-memory$"):
        Poses(made.rig, tuple(made.clips), Memory(76_000)).of(np.array([1, 2]))
