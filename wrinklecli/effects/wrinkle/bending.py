"""Poses in which a tool's wrinkles are tall: its joint bent, or a morph target raised, whatever clips there are.

What follows from mesh and tools alone must not hang on clips. So a tool's own motion is found here: the joint that
carries one of its ends and not the other turns about the patch's v axis, along which wrinkles run, or a morph target
goes from 0 to 1. Not in the paper.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import motion_clip, raising, turning
from wrinklecli.character.pose import Pose, node_matrices, pose_at
from wrinklecli.character.rig import Rig
from wrinklecli.effects.wrinkle.activity import lengths_over_time
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats, cross, unit, unit_quaternions
from wrinklecli.surface.anchor import Anchor
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

MOMENTS = 65
"""At which a motion is looked at: a joint turns by 2.3° between two."""

# Radians that a joint turns at most, to either side: 150°, a knee or an elbow.
_MOST_TURN = np.radians(150.0)
# Difference of the shares of both ends that a joint carries, below which it hardly bends what is between them.
_LEAST_CARRIED = 0.1
# Share of a tool's tallest that is as good as it. Full bumps stay full while a limb folds on.
_TALLEST = 0.97


def tallest_poses(patches: Sequence[Patch], rig: Rig, rest: Rest) -> list[Pose]:
    """For each tool the first pose of its own motion in which its wrinkles are about as tall as that makes them.

    A tool that has no such motion, or whose rest length is keyed by hand, has the rest pose.
    """
    return [_tallest_pose(patch, rig, rest) for patch in patches]


def _tallest_pose(patch: Patch, rig: Rig, rest: Rest) -> Pose:
    tallest, pose = 0.0, rest.pose
    if isinstance(patch.tool.rest_length, RestLengthKeys):
        return pose
    times = np.linspace(0.0, 1.0, MOMENTS)
    for motion in own_motions(patch, rig):
        amplitudes, _ = patch.curve.follow(*lengths_over_time(patch, rig, rest, motion, times))
        heights = patch.curve.heights(amplitudes).sum(axis=1)
        # The first of several that are alike.
        if heights.max() * _TALLEST > tallest:
            tallest = float(heights.max())
            pose = pose_at(rig, motion, times[int(np.argmax(heights >= _TALLEST * tallest))])
    return pose


def own_motions(patch: Patch, rig: Rig) -> Iterator[Clip]:
    """Motions of a second that may bring a tool's ends together: its joint turning either way, then morph targets."""
    morphed = patch.tool.rest_length.morph if isinstance(patch.tool.rest_length, RestLengthMorph) else None
    node = None if morphed else bent_node(patch, rig)
    if node is not None:
        yield from turns_of(patch, rig, node)
    for number, name in enumerate(rig.morph_names):
        moves = any(anchor.points[1 + number].any() for anchor in patch.anchors)
        if moves if morphed is None else name == morphed:
            yield motion_clip("", [raising(rig, {number: 1.0})])


def turns_of(patch: Patch, rig: Rig, node: int) -> tuple[Clip, Clip]:
    """A node that turns about a patch's v axis, either way, by 150° within a second."""
    axis = np.stack(cross(patch.along, patch.normal))
    return _turning(rig, node, axis), _turning(rig, node, -axis)


def bent_node(patch: Patch, rig: Rig) -> int | None:
    """The joint between a tool's ends: of those that carry the one more than the other, that nearest to its middle."""
    carried = [_carried_by(anchor, rig) for anchor in patch.anchors]
    shares = {
        node: [each.get(node, 0.0) for each in carried]
        for node in sorted({node for each in carried for node in each})
        if "rotation" in rig.locals[node]
    }
    differences = {node: max(each) - min(each) for node, each in shares.items()}
    most = max(differences.values(), default=0.0)
    if most < _LEAST_CARRIED:
        return None
    likely = [node for node, difference in differences.items() if difference > most - _LEAST_CARRIED]
    places = node_matrices(rig, None, np.zeros(1), likely)[0, :, :3, 3]
    middle = sum((anchor.position for anchor in patch.anchors), np.zeros(3)) / len(patch.anchors)
    return likely[int(np.argmin(np.linalg.norm(places - middle, axis=1)))]


def _carried_by(anchor: Anchor, rig: Rig) -> dict[int, float]:
    """The nodes that an anchor follows, and with which share of its weights."""
    shares: dict[int, float] = {}
    for joint, weight in zip(anchor.joints, anchor.weights, strict=True):
        node = int(rig.joints[joint])
        while node >= 0:
            shares[node] = shares.get(node, 0.0) + float(weight)
            node = int(rig.parents[node])
    return shares


def _turning(rig: Rig, node: int, axis: Floats) -> Clip:
    """A node that turns about a (3,) axis of world space at rest, further and further."""
    parent = int(rig.parents[node])
    world = np.eye(4) if parent < 0 else node_matrices(rig, None, np.zeros(1), [parent])[0, 0]
    # A turn in the parent's space about what the parent takes to the axis.
    local = unit(np.linalg.pinv(world[:3, :3]) @ axis)
    return motion_clip(
        "",
        [
            turning(
                node, unit_quaternions(rig.locals[node]["rotation"]), local, _MOST_TURN, np.linspace(0.0, 1.0, MOMENTS)
            )
        ],
    )
