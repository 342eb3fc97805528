"""Poses meshes over time: world matrices of nodes and joints, morph weights, linear blend skinning.

Source: glTF 2.0 specification, §3.5 (nodes), §3.7.3 (skins).
"""

from collections.abc import Iterable, Sequence

import numpy as np

from wrinklecli.character.clip import Clip, sample, sample_together
from wrinklecli.character.rig import TRANSFORM_DEFAULTS, Hierarchy, Rig
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, affine_rows, composed_rows, unit_quaternions
from wrinklecli.numeric.portions import portions

# Least scale of a node or an anchor relative to rest. Below it a character is hidden, and distances are meaningless.
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
    return poses_at(rig, clip, np.array([time]))[0]


def poses_at(rig: Rig, clip: Clip, times: Floats) -> list[Pose]:
    """A mesh at (frames,) seconds of a clip."""
    return [*map(Pose, joint_matrices(rig, clip, times), morph_weights(rig, clip, times))]


def joint_matrices(rig: Rig, clip: Clip | None, times: Floats, joints: Ints | None = None) -> Floats:
    """(frames, joints, 4, 4) matrices from bind to world space at (frames,) seconds of a clip.

    Without a clip, the mesh is in the stored pose. `joints` are indices into the rig's; by default all.

    Source: glTF 2.0 §3.7.3.1; a skinned node's own transform is ignored (§3.7.3.3).
    """
    chosen = np.arange(len(rig.joints)) if joints is None else joints
    globals_ = node_matrices(rig, clip, times, [int(rig.joints[joint]) for joint in chosen])
    return np.asarray(np.matmul(globals_, rig.inverse_binds[chosen]))


def node_matrices(hierarchy: Hierarchy, clip: Clip | None, times: Floats, nodes: Iterable[int]) -> Floats:
    """(frames, nodes, 4, 4) world matrices of nodes; only their ancestors are evaluated."""
    found = node_rows(hierarchy, clip, times, nodes)
    matrices = np.zeros((len(times), len(found), 4, 4))
    for index, rows in enumerate(found):
        matrices[:, index, :3] = rows.transpose(2, 0, 1)
    matrices[:, :, 3, 3] = 1.0
    return matrices


def stored_positions(hierarchy: Hierarchy, nodes: Sequence[int]) -> Floats:
    """(nodes, 3) world positions of nodes in the stored pose."""
    return node_matrices(hierarchy, None, np.zeros(1), nodes)[0, :, :3, 3]


def node_rows(
    hierarchy: Hierarchy, clip: Clip | None, times: Floats, nodes: Iterable[int], known: dict[int, Floats] | None = None
) -> list[Floats]:
    """(3, 4, frames) upper rows of each node's world matrices, or (3, 4, 1) if nothing moves the node.

    Only ancestors are evaluated. Products of 4×4 matrices take five times as long as these, which run along time.
    `known` has the rows of nodes at these times of this clip, and gets those of others.
    """
    nodes, known = list(nodes), {} if known is None else known
    moved: frozenset[int] = clip.nodes if clip else frozenset()
    chain: dict[int, None] = {}
    for each in nodes:
        node, above = each, list[int]()
        while node >= 0 and node not in known and node not in chain:
            above.append(node)
            node = int(hierarchy.parents[node])
        chain.update(dict.fromkeys(reversed(above)))
    keyed = [node for node in chain if node in moved]
    local_rows: dict[int, Floats] = {}
    # With few frames, numpy takes as long for one node as for many.
    for part in (keyed[some] for some in portions(len(keyed), 64 * len(times))):
        local_rows.update(zip(part, _local_rows(hierarchy, clip, times, part), strict=True))
    still = {-1}
    for node in chain:
        parent = int(hierarchy.parents[node])
        if parent in still and node not in moved:
            still.add(node)
            known[node] = hierarchy.world_rows(node)
        else:
            local = local_rows[node] if node in local_rows else hierarchy.rows[:, :, node, None]
            known[node] = composed_rows(known[parent], local) if parent >= 0 else local
    return [known[node] for node in nodes]


def _local_rows(hierarchy: Hierarchy, clip: Clip | None, times: Floats, nodes: Sequence[int]) -> list[Floats]:
    """(3, 4, frames) upper rows of each node's local matrix, or (3, 4, 1) if the clip does not change it."""
    stored, values = hierarchy.locals, dict[tuple[int, str], Floats]()
    if clip is not None:
        places = [(node, path) for node in nodes for path in TRANSFORM_DEFAULTS if path in stored[node]]
        held = {place: clip.held[place][:, None] for place in places if place in clip.held}
        keyed = [place for place in places if place in clip.by_target and place not in held]
        values = held | dict(zip(keyed, sample_together(clip, keyed, times), strict=True))
    moved = list(dict.fromkeys(node for node, _ in values))
    for node in moved:
        for path in TRANSFORM_DEFAULTS:
            if (node, path) not in values:
                value = stored[node][path]
                values[node, path] = (unit_quaternions(value) if path == "rotation" else value)[:, None]
    found = {node: hierarchy.rows[:, :, node, None] for node in nodes}
    if moved:
        parts = []
        for path in TRANSFORM_DEFAULTS:
            every = [values[node, path] for node in moved]
            part = np.zeros((len(every[0]), len(every), max(each.shape[1] for each in every)))
            for number, each in enumerate(every):
                part[:, number] = each
            parts.append(part)
        found.update(zip(moved, affine_rows(*parts).transpose(2, 0, 1, 3), strict=True))
    return list(found.values())


def morph_weights(rig: Rig, clip: Clip | None, times: Floats, wanted: Bools | None = None) -> Floats:
    """(frames, morph targets) weights of the clip's channel, or else the stored ones, with those of the rig's drives.

    A channel that has the weights of the drives too, as made motions have, counts as it is. Drives of which no target
    is (morph targets,) `wanted` give 0.
    """
    channel = clip.channel(rig.node, "weights") if clip else None
    if channel is not None and (not rig.drives or channel.values.shape[-1] == len(rig.morph_names)):
        return sample(channel, times)
    own = rig.own
    weights = np.tile(own.morph_weights, (len(times), 1)) if channel is None else sample(channel, times)
    if not rig.drives:
        return weights
    columns, first = [weights], weights.shape[1]
    for drive in rig.drives:
        last = first + len(drive.targets)
        idle = wanted is not None and not wanted[first:last].any()
        columns.append(np.zeros((len(times), last - first)) if idle else drive.weights_in(own, clip)(times))
        first = last
    return np.concatenate(columns, axis=1)


def blend(weights: Floats, matrices: Floats) -> Floats:
    """(frames, vertices, 3, 4) sums of (frames, joints, 4, 4) matrices by (vertices, joints) skin weights."""
    frames, joints = matrices.shape[:2]
    rows = matrices[:, :, :3, :].reshape(frames, joints, 12)
    blended: Floats = np.matmul(weights, rows)
    return blended.reshape(frames, len(weights), 3, 4)


def transform(blended: Floats, positions: Floats) -> Floats:
    """(frames, vertices, 3) world positions of bind ones, by (frames, vertices, 3, 4) blended matrices.

    The bind positions are (vertices, 3), or (frames, vertices, 3) if morph targets act.
    """
    turned: Floats = (
        np.einsum("fvab,...vb->fva", blended[..., :3], positions)
        if positions.ndim == 2
        else (np.einsum("fvab,fvb->fva", blended[..., :3], positions))
    )
    return turned + blended[..., 3]
