"""A tool's own motion: the joint that bends its segment, or the target that moves its ends, from rig and tool alone."""

import numpy as np
import pytest

from kit.limb import limb_asset, tool
from kit.prepared import prepare
from wrinklecli.character.pose import pose_at
from wrinklecli.effects.wrinkle.activity import activity
from wrinklecli.effects.wrinkle.bending import own_motions, rising


def test_the_joint_between_the_ends_turns_as_a_clip_would_turn_it() -> None:
    """The limb folds about z at joint_1, to the tool's side; the other way its ends part."""
    made = prepare(limb_asset(clip=None), tool())
    motions = list(own_motions(made.patch, made.rig))
    assert [(each.channels[0].node, each.channels[0].path) for each in motions] == [(2, "rotation")] * 2
    ends = np.array([0.0, 0.4])
    distances = [activity(made.patch, made.rig, each, ends).distances for each in motions]
    assert all(each[0] == pytest.approx(made.patch.span) for each in distances)
    assert sorted(each[1] < 0.9 * each[0] for each in distances) == [False, True]
    closing = motions[0 if distances[0][1] < distances[1][1] else 1]
    turn = made.rig.locals[2]["rotation"]
    assert closing.channels[0].values[0] == pytest.approx(turn)
    # Sixty degrees about z, whatever the joint's own turn.
    matrix = pose_at(made.rig, closing, 0.4).matrices[1][:3, :3] @ np.linalg.inv(made.rest.matrices[1][:3, :3])
    assert matrix == pytest.approx(np.array([[0.5, -(0.75**0.5), 0], [0.75**0.5, 0.5, 0], [0, 0, 1]]), abs=1e-9)


def test_wrinkles_are_tall_in_the_pose_and_no_clip_has_to_do_with_it() -> None:
    made, clipped = (prepare(limb_asset(clip=clip), tool()) for clip in (None, "fold"))
    (*lower, pose), (*_, other) = ([each.pose for each in rising(of.patch, of.rig, of.rest)] for of in (made, clipped))
    assert np.array_equal(pose.matrices, other.matrices)
    assert not np.allclose(pose.matrices, made.rest.matrices)
    fold = activity(clipped.patch, clipped.rig, clipped.clip, np.linspace(0.0, 2.0, 201))
    heights = clipped.patch.curve.heights(fold.amplitudes).sum(axis=1)
    first = int(np.argmax(heights >= 0.97 * heights.max()))
    posed = pose_at(clipped.rig, clipped.clip, 0.01 * first).matrices
    # The clip bends it as far, to the 2.3° between two moments.
    angles = [np.degrees(np.arccos(np.clip((np.trace(m[1][:3, :3]) - 1) / 2, -1, 1))) for m in (pose.matrices, posed)]
    assert angles[0] == pytest.approx(angles[1], abs=2.4)
    # On the way there it is bent less.
    turns = [np.trace(each.matrices[1][:3, :3]) for each in (*lower, pose)]
    assert turns == sorted(turns, reverse=True)
    assert len(set(turns)) == 4


def test_a_tool_that_is_keyed_by_hand_or_has_no_motion_keeps_the_rest_pose() -> None:
    keyed = {"rest_length": {"keys": {"fold": [[0.0, "100%"], [1.0, "120%"]]}}}
    for made in (
        prepare(limb_asset(), tool(**keyed)),
        prepare(limb_asset(skinned=False, clip=None), tool()),
    ):
        moments = rising(made.patch, made.rig, made.rest)
        for each in moments:
            assert np.array_equal(each.pose.matrices, made.rest.matrices)
            assert np.array_equal(each.pose.morph_weights, made.rest.morph_weights)
        assert [each.weights.max() for each in moments] == pytest.approx([0.25, 0.5, 0.75, 1.0], abs=0.05)


def test_a_morph_target_that_moves_an_end_is_raised() -> None:
    made = prepare(limb_asset(morphs=2, skinned=False, clip=None), tool())
    motions = list(own_motions(made.patch, made.rig))
    moving = [m for m in range(2) if any(a.carried.points[1 + m].any() for a in (made.patch.origin, made.patch.target))]
    assert len(moving) > 0
    assert [each.channels[0].path for each in motions] == ["weights"] * len(moving)
    for number, each in zip(moving, motions, strict=True):
        weights = pose_at(made.rig, each, 1.0).morph_weights
        assert weights[number] == 1.0
        assert np.array_equal(np.delete(weights, number), np.delete(made.rig.morph_weights, number))
