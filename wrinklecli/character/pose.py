"""Poses of a mesh over time: world matrices of nodes and joints, morph weights, linear blend skinning.

Source: glTF 2.0 specification, §3.5 (nodes), §3.7.3 (skins).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Channel, Clip, sample
from wrinklecli.character.rig import TRANSFORM_DEFAULTS, Hierarchy, Rig
from wrinklecli.numeric.arrays import Floats, Ints, affine_rows, unit_quaternions

# Least scale of a node or an anchor against rest: below it a character is hidden, and distances on it say nothing.
LEAST_SCALE = 1e-6


@dataclass(frozen=True, slots=True)
class Pose:
    """A mesh at one moment.

    Attributes:
        matrices: (joints, 4, 4) bind to world space.
        morph_weights: (morph targets,).
    """

    matrices: Floats
    morph_weights: Floats


def pose_at(rig: Rig, clip: Clip, time: float) -> Pose:
    """A mesh at a time of a clip, seconds."""
    times = np.array([time])
    return Pose(joint_matrices(rig, clip, times)[0], morph_weights(rig, clip, times)[0])


def joint_matrices(rig: Rig, clip: Clip | None, times: Floats, joints: Ints | None = None) -> Floats:
    """Matrices that take bind positions to world space.

    Args:
        rig: Of the mesh.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds; before the first and after the last key a channel holds.
        joints: Which of the rig's joints; all where left out.

    Returns:
        (frames, joints, 4, 4).

    Source: glTF 2.0 §3.7.3.1; a skinned node's own transform is ignored (§3.7.3.3).
    """
    chosen = np.arange(len(rig.joints)) if joints is None else joints
    globals_ = node_matrices(rig, clip, times, [int(rig.joints[joint]) for joint in chosen])
    matrices: Floats = np.matmul(globals_, rig.inverse_binds[chosen])
    return matrices


def node_matrices(rig: Rig, clip: Clip | None, times: Floats, nodes: Iterable[int]) -> Floats:
    """(frames, nodes, 4, 4) world matrices of nodes; only their ancestors are evaluated."""
    found = node_rows(rig, clip, times, nodes)
    matrices = np.zeros((len(times), len(found), 4, 4))
    for index, rows in enumerate(found):
        matrices[:, index, :3] = rows.transpose(2, 0, 1)
    matrices[:, :, 3, 3] = 1.0
    return matrices


def stored_positions(hierarchy: Hierarchy, nodes: Sequence[int]) -> Floats:
    """(nodes, 3) where nodes are in the stored pose, world space."""
    rig = Rig(
        node=-1,
        mesh=-1,
        skinned=False,
        joints=np.array(nodes, np.intp),
        inverse_binds=np.tile(np.eye(4), (len(nodes), 1, 1)),
        parents=hierarchy.parents,
        locals=hierarchy.locals,
        rows=hierarchy.rows,
        names=hierarchy.names,
        morph_names=(),
        morph_weights=np.zeros(0),
    )
    return node_matrices(rig, None, np.zeros(1), nodes)[0, :, :3, 3]


def node_rows(rig: Rig, clip: Clip | None, times: Floats, nodes: Iterable[int]) -> list[Floats]:
    """The first three rows of nodes' world matrices over time; only their ancestors are evaluated.

    Products of 4×4 matrices one by one take five times as long as these, which run along time.

    Returns:
        For each node (3, 4, frames), or (3, 4, 1) where nothing moves it.
    """
    known: dict[int, Floats] = {}
    channels = clip.by_target if clip else {}

    def world(node: int) -> Floats:
        chain = []
        while node >= 0 and node not in known:
            chain.append(node)
            node = int(rig.parents[node])
        matrix = known.get(node)
        for each in reversed(chain):
            local = _local_rows(rig, channels, times, each)
            matrix = local if matrix is None else _composed(matrix, local)
            known[each] = matrix
        assert matrix is not None
        return matrix

    return [world(node) for node in nodes]


def _composed(outer: Floats, inner: Floats) -> Floats:
    """(3, 4, frames) product of affine matrices."""
    product: Floats = outer[:, 0, None] * inner[0]
    product = product + outer[:, 1, None] * inner[1]
    product += outer[:, 2, None] * inner[2]
    product[:, 3] += outer[:, 3]
    return product


def _local_rows(rig: Rig, channels: dict[tuple[int, str], Channel], times: Floats, node: int) -> Floats:
    """(3, 4, frames), or (3, 4, 1) where no channel, by node and path, moves the node."""
    stored = rig.locals[node]
    moved = [path for path in TRANSFORM_DEFAULTS if (node, path) in channels and path in stored]
    if not moved:
        return rig.rows[:, :, node, None]
    parts = {path: value[:, None] for path, value in stored.items()}
    parts["rotation"] = unit_quaternions(stored["rotation"])[:, None]
    return affine_rows(
        *(sample(channels[node, path], times).T if path in moved else parts[path] for path in TRANSFORM_DEFAULTS)
    )


def morph_weights(rig: Rig, clip: Clip | None, times: Floats) -> Floats:
    """(frames, morph targets) weights: those of the clip's channel, else the stored ones."""
    channel = clip.channel(rig.node, "weights") if clip else None
    if channel is None:
        return np.tile(rig.morph_weights, (len(times), 1))
    return sample(channel, times)


def blend(weights: Floats, matrices: Floats) -> Floats:
    """Blended matrices of linear blend skinning.

    Args:
        weights: (vertices, joints), rows summing to 1.
        matrices: (frames, joints, 4, 4) bind to world.

    Returns:
        (frames, vertices, 3, 4).
    """
    frames, joints = matrices.shape[:2]
    rows = matrices[:, :, :3, :].reshape(frames, joints, 12)
    blended: Floats = np.matmul(weights, rows)
    return blended.reshape(frames, len(weights), 3, 4)


def transform(blended: Floats, positions: Floats) -> Floats:
    """Move bind positions by blended matrices.

    Args:
        blended: (frames, vertices, 3, 4).
        positions: (vertices, 3), or (frames, vertices, 3) where morph targets act, bind space.

    Returns:
        (frames, vertices, 3) world space, scene units.
    """
    turned: Floats = (
        np.einsum("fvab,...vb->fva", blended[..., :3], positions)
        if positions.ndim == 2
        else (np.einsum("fvab,fvb->fva", blended[..., :3], positions))
    )
    return turned + blended[..., 3]
