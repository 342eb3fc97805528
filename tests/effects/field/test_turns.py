"""The axes about which joints turn, how far, and the poses in which a field is measured."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, Json
from kit.garments import ground_of, job_of, tube
from wrinklecli.character.motion import motion_clip, quaternion_product
from wrinklecli.character.pose import joint_matrices
from wrinklecli.effects.field.turns import Sweeps, Turn, led_by, turns_of
from wrinklecli.surface.ground import Ground

ELBOW = 2  # the node of `joint_1`


def quaternion(axis: Any, degrees: float) -> list[float]:
    half = np.radians(degrees) / 2.0
    return [*(np.sin(half) * np.array(axis) / np.linalg.norm(axis)), float(np.cos(half))]


def moved(*turns: tuple[Any, float], node: int = ELBOW, **options: Any) -> Asset:
    """The tube with a clip that turns a joint about axes by degrees, one after another."""
    asset = tube(clip=None, **options)
    clip: Json = {"name": "move"}
    keys = [[0.0, 0.0, 0.0, 1.0], *(quaternion(*turn) for turn in turns)]
    asset.channel(clip, node, "rotation", np.arange(len(keys), dtype=float), keys)
    asset.append("animations", clip)
    return asset


def found_in(asset: Asset, *nodes: int, thickness: float = 0.0) -> tuple[Ground, list[Turn]]:
    ground = ground_of(job_of(asset))
    return ground, turns_of(ground, nodes or [ELBOW], thickness)


def degrees(turn: Turn) -> list[float]:
    return [float(each) for each in np.degrees(turn.angles)]


ASLANT = [1.0, 2.0, -1.0]
# A joint shows its range if a clip turns it by 30°.


@pytest.mark.parametrize(
    ("axis", "farthest"),
    [
        *product(([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]), (35.0, 90.0, 150.0)),
        *product((ASLANT,), (90.0, 150.0)),
        pytest.param(ASLANT, 35.0),
    ],
)
def test_a_hinge_turns_about_one_axis_as_far_as_clips_turn_it(axis: list[float], farthest: float) -> None:
    _, (turn,) = found_in(moved((axis, farthest / 3.0), (axis, farthest)))
    # The longer part of its range has the positive angles.
    assert float(turn.signal.axis @ axis) == pytest.approx(np.linalg.norm(axis), rel=1e-5)
    assert (degrees(turn)[0], degrees(turn)[-1]) == pytest.approx((0.0, farthest), abs=0.01)


def test_a_hinge_that_turns_both_ways_has_both_in_its_range() -> None:
    _, (turn,) = found_in(moved(([0, 0, 1], -30.0), ([0, 0, 1], 80.0)))
    assert (degrees(turn)[0], degrees(turn)[-1]) == pytest.approx((-30.0, 80.0), abs=0.01)
    assert (np.diff(turn.angles) > 0).all()
    assert 0.0 in turn.angles


def test_steps_are_small() -> None:
    _, (turn,) = found_in(moved(([0, 0, 1], -30.0), ([0, 0, 1], 150.0)))
    assert np.diff(degrees(turn)).max() <= 30.0


def test_a_ball_joint_turns_about_several_axes() -> None:
    _, turns = found_in(moved(([0, 0, 1], 80.0), ([0, 1, 0], 50.0), ([1, 0, 0], 30.0)))
    assert len(turns) == 3
    assert {each.signal.node for each in turns} == {ELBOW}
    axes = np.stack([each.signal.axis for each in turns])
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-6)


@pytest.mark.parametrize("small", [2.0, 8.0])
def test_what_a_hinge_turns_by_beside_its_axis_does_not_count(small: float) -> None:
    _, turns = found_in(moved(([0, 0, 1], 80.0), ([0, 1, 0], small)))
    assert len(turns) == 1


def test_keys_that_turn_all_the_way_round_have_numbers() -> None:
    for turns in ([([0, 0, 1], 179.9)], [([0, 0, 1], 180.0), ([0, 0, 1], 270.0)]):
        _, found = found_in(moved(*turns))
        assert found
        assert all(np.isfinite(each.angles).all() and np.abs(each.angles).max() < np.pi + 1e-6 for each in found)


def test_a_joint_that_no_clip_turns_has_the_range_of_motion() -> None:
    _, turns = found_in(tube(clip=None))
    assert turns
    for turn in turns:
        assert turn.angles[0] <= 0.0 < turn.angles[-1]
        assert degrees(turn)[-1] > 12.0


def test_joints_that_clips_leave_alone_stay_where_clips_turn_others() -> None:
    ground, turns = found_in(moved(([0, 0, 1], 80.0)), 1, ELBOW)
    assert [each.signal.node for each in turns] == [ELBOW]
    assert ground.rig.names[ELBOW] == "joint_1"


def test_turns_are_in_the_order_of_the_joints() -> None:
    asset = tube(joints=3, rings=31)
    _, turns = found_in(asset, 3, 2)
    assert [each.signal.node for each in turns] == [3, 2]


def chained(first: float, second: float, together: bool = True) -> Asset:
    """The tube with a clip that turns two joints, stored aslant, about one axis, at once or one after the other."""
    asset = tube(joints=3, rings=31, clip=None)
    clip: Json = {"name": "move"}
    stored = quaternion([0, 0, 1], 30.0)
    for row, (node, axis, turn) in enumerate(((2, 0.0, first), (3, -30.0, second))):
        asset.gltf["nodes"][node]["rotation"] = stored
        own = quaternion([np.cos(np.radians(axis)), np.sin(np.radians(axis)), 0.0], turn)
        (made,) = quaternion_product(np.array([own]), np.array(stored)).tolist()
        keys = [stored, made, made] if together else [stored, *([made, stored], [stored, made])[row]]
        asset.channel(clip, node, "rotation", np.arange(3.0), keys)
    asset.append("animations", clip)
    return asset


def test_near_joints_that_turn_together_count_as_one() -> None:
    asset = chained(40.0, 10.0)
    ground, (turn,) = found_in(asset, 3, 2, thickness=10.0)
    assert [joint.node for joint, _ in turn.joints] == [2, 3]
    assert [share for _, share in turn.joints] == pytest.approx([0.8, 0.2], abs=1e-3)
    assert (turn.signal.node, turn.signal.parent) == (3, 1)
    assert degrees(turn)[-1] == pytest.approx(50.0, abs=0.01)
    (clip,) = ground.clips
    for angle, time in ((0.0, 0.0), (turn.angles[-1], 1.0)):
        for made, at in ((clip, time), (motion_clip("", turn.channels(angle)), 1.0)):
            assert turn.signal.angles(ground.rig, made, np.array([at])).rows[0] == pytest.approx(angle, abs=1e-4)
    poses = Sweeps.of(ground.rig, [turn], seed="a")
    farthest = joint_matrices(ground.rig, clip, np.ones(1))[0]
    assert poses.matrices[poses.ends[0]] == pytest.approx(farthest, abs=1e-3)


@pytest.mark.parametrize(
    ("asset", "thickness"),
    [
        pytest.param(chained(40.0, 10.0), 1e-3, id="far"),
        pytest.param(chained(40.0, -30.0), 10.0, id="apart"),
        pytest.param(chained(40.0, 30.0, together=False), 10.0, id="later"),
        pytest.param(chained(100.0, 100.0), 10.0, id="all the way round"),
    ],
)
def test_others_turn_by_themselves(asset: Asset, thickness: float) -> None:
    _, turns = found_in(asset, 3, 2, thickness=thickness)
    assert all(len(turn.joints) == 1 for turn in turns)


def test_joints_of_a_spine_turn_together_where_no_clip_shows_them() -> None:
    asset = tube(joints=3, rings=31, clip=None)
    for node, name in ((2, "spine"), (3, "chest")):
        asset.gltf["nodes"][node]["name"] = name
    _, turns = found_in(asset, 2, 3, thickness=10.0)
    assert [[joint.node for joint, _ in turn.joints] for turn in turns] == [[2, 3]] * 3


def test_angles_are_those_that_the_signal_measures() -> None:
    """The drive of the baked file reads what a pose of a sweep is turned by."""
    ground, turns = found_in(moved(([0, 0, 1], -30.0), ([0, 1, 0], 60.0)))
    for turn in turns:
        for angle in turn.angles.tolist():
            clip = motion_clip("", turn.channels(angle))
            assert turn.signal.angles(ground.rig, clip, np.ones(1)).rows[0] == pytest.approx(angle, abs=1e-6)


def test_poses_are_each_turn_by_itself_and_all_together() -> None:
    ground, turns = found_in(tube(joints=3, rings=31), 2, 3)
    poses = Sweeps.of(ground.rig, turns, seed="a")
    for number, turn in enumerate(turns):
        own = poses.angles[poses.owners == number]
        assert own[:, number].tolist() == [each for each in turn.angles.tolist() if each]
        assert not np.delete(own, number, axis=1).any()
    mixed = poses.angles[poses.owners < 0]
    assert len(mixed) >= 8
    for number, turn in enumerate(turns):
        assert mixed[:, number].min() >= turn.angles[0]
        assert mixed[:, number].max() <= turn.angles[-1]
        assert np.ptp(mixed[:, number]) > 0.5 * np.ptp(turn.angles)
    assert set(poses.ends.tolist()) == {int(np.flatnonzero(poses.owners == number)[-1]) for number in range(len(turns))}


def test_a_pose_is_that_of_a_clip_with_the_same_turns() -> None:
    ground, turns = found_in(tube(joints=3, rings=31), 2, 3)
    poses = Sweeps.of(ground.rig, turns, seed="a")
    row = int(np.flatnonzero(poses.owners < 0)[-1])
    clip = motion_clip(
        "", [turn.channels(float(angle))[0] for turn, angle in zip(turns, poses.angles[row], strict=True)]
    )
    assert poses.matrices[row] == pytest.approx(joint_matrices(ground.rig, clip, np.ones(1))[0], abs=1e-9)


def test_turns_of_one_joint_about_several_axes_are_made_one_after_another() -> None:
    ground, turns = found_in(moved(([0, 0, 1], 80.0), ([0, 1, 0], 50.0)))
    assert len(turns) == 2
    poses = Sweeps.of(ground.rig, turns, seed="a")
    both = np.flatnonzero((poses.angles != 0).all(axis=1))
    still = joint_matrices(ground.rig, None, np.zeros(1))[0]
    moved_by = poses.matrices[both[0]] @ np.linalg.inv(still)
    rotation = moved_by[-1][:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-6)
    one, other = (abs(float(poses.angles[both[0], k])) for k in range(2))
    turned = float(np.arccos((np.trace(rotation) - 1.0) / 2.0))
    assert abs(one - other) - 1e-6 <= turned <= one + other + 1e-6
    assert turned > max(one, other) - 1e-6 or min(one, other) > 0


def test_other_seeds_mix_otherwise() -> None:
    ground, turns = found_in(tube())
    first, again, other = (Sweeps.of(ground.rig, turns, seed=each).angles for each in "aab")
    assert first.tolist() == again.tolist()
    assert first.tolist() != other.tolist()


@pytest.mark.parametrize("name", ["spine", "chest", "upper_leg_l", "lower_leg_l", "upper_arm_l", "lower_arm_l"])
def test_parts_of_a_body_turn_both_ways_but_a_knee_and_an_elbow(name: str) -> None:
    asset = tube(clip=None)
    asset.gltf["nodes"][ELBOW]["name"] = name
    asset.gltf["nodes"][ELBOW]["children"] = [asset.append("nodes", {"name": "end", "translation": [1.0, 0.0, 0.0]})]
    _, turns = found_in(asset)
    swing = degrees(turns[0])
    assert swing[0] <= 0.0 < swing[-1]
    assert (swing[0] < 0.0) == (not name.startswith("lower"))
    assert all(each[0] == pytest.approx(-each[-1]) for each in map(degrees, turns[1:])), "to both sides as far"


def test_a_foot_that_stands_beside_its_leg_follows_it() -> None:
    """Inverse kinematics moves such a foot: the poses are those of one below its leg."""
    found = []
    for beside in (False, True):
        asset = tube(joints=3, rings=31, clip=None)
        nodes = asset.gltf["nodes"]
        for node, name in zip((1, 2, 3), ("upper_leg_l", "lower_leg_l", "foot_l"), strict=True):
            nodes[node]["name"] = name
        if beside:
            nodes[2]["children"].remove(3)
            nodes[3]["translation"] = (np.array(nodes[3]["translation"]) + nodes[2]["translation"]).tolist()
            nodes[1]["children"].append(3)
        ground, turns = found_in(asset, 2)
        led = led_by(ground)
        assert [(leader, own.tolist()) for leader, own in led] == [(1, [2])] * beside
        found.append(Sweeps.of(ground.rig, turns, seed="a", led=led).matrices)
    assert found[1] == pytest.approx(found[0], abs=1e-9)
