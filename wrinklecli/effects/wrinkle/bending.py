"""Finds the motion that a tool's own wrinkles follow, and the pose in which they are tall, whatever clips there are.

Results that follow from mesh and tools alone must not depend on clips. So the joint that carries one of the tool's ends
and not the other turns about the patch's v axis, along which wrinkles run, or a morph target goes from 0 to 1. Not in
the paper.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import motion_clip, raising, turning
from wrinklecli.character.pose import Pose, node_matrices, pose_at
from wrinklecli.character.rig import Rig
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats, cross, unit, unit_quaternions
from wrinklecli.surface.anchor import Anchor
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

MOMENTS = 65
"""Sampled moments of a motion: a joint turns by 2.3° between two."""
# Greatest turn of a joint to either side, radians: 150°, as knees and elbows turn.
_MOST_TURN = np.radians(150.0)
# A joint hardly bends the skin between two ends if the fractions of their weights that it carries differ by less.
_LEAST_CARRIED = 0.1
# Wrinkles this near to the tallest, as a fraction, are tall enough: full bumps stay full while a limb folds on.
_TALLEST = 0.97


def tallest_poses(patches: Sequence[Patch], rig: Rig, rest: Rest) -> list[Pose]:
    """The first pose of each tool's own motion in which its wrinkles are about as tall as they become.

    A tool that has no such motion, or whose rest length is keyed by hand, gets the rest pose.
    """
    return [_tallest_pose(patch, rig, rest) for patch in patches]


def _tallest_pose(patch: Patch, rig: Rig, rest: Rest) -> Pose:
    tallest, pose = 0.0, rest.pose
    if isinstance(patch.tool.rest_length, RestLengthKeys):
        return pose
    times = np.linspace(0.0, 1.0, MOMENTS)
    for motion in own_motions(patch, rig):
        amplitudes, _ = patch.curve.follow(*patch.segment.lengths(rig, motion, times))
        heights = patch.curve.heights(amplitudes).sum(axis=1)
        # Of several equal motions the first counts.
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
        moves = any(anchor.carried.points[1 + number].any() for anchor in patch.anchors)
        if moves if morphed is None else name == morphed:
            yield motion_clip("", [raising(rig, {number: 1.0})])


def turns_of(patch: Patch, rig: Rig, node: int) -> tuple[Clip, Clip]:
    """Motions of a second in which a node turns by 150° about a patch's v axis, either way."""
    axis = np.stack(cross(patch.along, patch.normal))
    return _turning(rig, node, axis), _turning(rig, node, -axis)


def bent_node(patch: Patch, rig: Rig) -> int | None:
    """The joint that bends a tool: the one nearest to its middle of those that carry one end more than the other."""
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
    """The fraction of an anchor's weights that each node carries, directly or through its children."""
    shares: dict[int, float] = {}
    for node, weight in zip(anchor.carried.nodes.tolist(), anchor.carried.weights, strict=True):
        while node >= 0:
            shares[node] = shares.get(node, 0.0) + float(weight)
            node = int(rig.parents[node])
    return shares


def _turning(rig: Rig, node: int, axis: Floats) -> Clip:
    """A motion in which a node turns steadily about a (3,) axis in world space at rest."""
    parent = int(rig.parents[node])
    world = np.eye(4) if parent < 0 else node_matrices(rig, None, np.zeros(1), [parent])[0, 0]
    # The axis in the parent's space that the parent takes to the wanted one.
    local = unit(np.linalg.pinv(world[:3, :3]) @ axis)
    stored = unit_quaternions(rig.locals[node]["rotation"])
    return motion_clip("", [turning(node, stored, local, _MOST_TURN, np.linspace(0.0, 1.0, MOMENTS))])
