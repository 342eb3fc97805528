"""Prunes skin weights of new vertices to the joints that the file can store, and forbids splits that cost too much.

A midpoint depends on the joints of both ends of its edge, which may be too many. Influences are dropped one by one, and
each gives its weight to a joint that is near in the skeleton, but not across a bone that bends under a region. (Keeping
the heaviest four moved a hand's forearm off by 29 %.) `pruning_errors` measures the cost, and `forbidden_splits`
marks edges whose midpoint could not move as the surface does there.

The paper (C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004) refines the posed mesh, where nothing
has to be pruned.
"""

from collections.abc import Callable, Sequence
from dataclasses import field
from functools import partial
from itertools import pairwise

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, distinct_values, flags_of
from wrinklecli.numeric.memory import Memory, once
from wrinklecli.numeric.portions import portions
from wrinklecli.numeric.red_green import Level
from wrinklecli.surface.region import Region
from wrinklecli.surface.rest import Rest

# Poses of a clip at which pruned skin weights are judged before the proof.
_POSES = 33
# Bytes of a matrix, and of its copies in the product with weights.
_MATRIX_BYTES = 3 * 128
# Skin weights of two anchors that differ by less than this are equal up to rounding.
_SAME_WEIGHTS = 1e-6
# Length of a bone that bends under a region; other bones have length 1.
_BENDING_LENGTH = 1000.0


@dataclass(frozen=True, eq=False)
class Poses:
    """The stored pose, and a few poses of every clip of the asset, whichever are baked.

    Attributes:
        rig: Of a mesh.
        clips: Of the asset.
        memory: The limit on matrices.
    """

    rig: Rig
    clips: tuple[Clip, ...]
    memory: Memory
    _known: dict[bytes, Floats] = field(default_factory=dict, init=False, repr=False, compare=False)

    def of(self, joints: Ints) -> Floats:
        """(poses, joints, 4, 4) matrices of some joints, bind to world space, in poses in which any of these is moved.

        A character may have hundreds of clips, of which a region follows a few: a motion of a finger moves no knee.

        Raises:
            TooMuchError: They would take more memory than there may be.
        """
        # Tools that are tried again and again ask for the same joints.
        return once(self._known, joints.tobytes(), partial(self._matrices, joints), 1)

    def _matrices(self, joints: Ints) -> Floats:
        moving = {node for joint in joints.tolist() for node in self.rig.upwards(int(self.rig.joints[joint]))}
        clips = [clip for clip in self.clips if not clip.nodes.isdisjoint(moving)]
        count = 1 + _POSES * len(clips)
        what, where = f"{count:,} poses of {len(joints):,} joints", self.rig.node_name
        self.memory.check(_MATRIX_BYTES * count * len(joints), what, where=where)
        poses = np.zeros((count, len(joints), 4, 4))
        poses[:1] = joint_matrices(self.rig, None, np.zeros(1), joints)
        for part, clip in zip(poses[1:].reshape(-1, _POSES, len(joints), 4, 4), clips, strict=True):
            part[:] = joint_matrices(self.rig, clip, np.linspace(clip.start, clip.end, _POSES), joints)
        return poses


def pruning_errors(weights: Floats, positions: Floats, distances: Floats, influences: int, poses: Floats) -> Floats:
    """(vertices,) greatest distance by which pruning moves each vertex off in (poses, joints, 4, 4) poses.

    Weights are (vertices, joints) before pruning, positions (vertices, 3) in bind space, and distances (joints, joints)
    in the skeleton.
    """
    joints, kept = prune(weights, distances, influences)
    change = weights.copy()
    for column in range(influences):
        change[np.arange(len(change)), joints[:, column]] -= kept[:, column]
    # Few joints give or take weight.
    giving = np.flatnonzero(change.any(axis=0))
    change = change[:, giving]
    # A vertex's movement is linear in its position times its weights, so one product does for all poses.
    columns = poses[:, giving, :3].transpose(1, 3, 2, 0).reshape(4 * len(giving), 3 * len(poses))
    homogeneous = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    errors = np.zeros(len(weights))
    for rows in portions(len(weights), len(columns) + columns.shape[1]):
        spread = change[rows, :, None] * homogeneous[rows, None]
        moved = (spread.reshape(-1, len(columns)) @ columns).reshape(-1, 3, len(poses))
        errors[rows] = np.sqrt(np.sum(moved**2, axis=1)).max(axis=1)
    return errors


def joint_distances(rig: Rig, regions: Sequence[Region], chosen: Ints) -> Floats:
    """(chosen, chosen) distances of some of a rig's joints in the skeleton.

    A bone counts 1. A bone between two neighbouring anchors of a region bends with the region and counts far more, so
    that weights are not moved across it. Joints of separate trees are furthest apart.
    """
    lengths = np.ones(len(rig.parents))
    lengths[sorted(_bending_nodes(rig, regions))] = _BENDING_LENGTH
    lengths[rig.parents < 0] = 0.0
    chains = [list(rig.upwards(node)) for node in rig.joints[chosen].tolist()]
    nodes, columns = np.unique(np.concatenate([np.zeros(0, np.intp), *chains]), return_inverse=True)
    passed = np.zeros((len(chains), len(nodes)))
    passed[np.repeat(np.arange(len(chains)), list(map(len, chains))), columns] = 1.0
    # The way from a joint to the root, less what two of these have in common.
    common = (passed * lengths[nodes]) @ passed.T
    apart = np.add.outer(common.diagonal(), common.diagonal()) - 2.0 * common
    return np.where(passed @ passed.T > 0.0, apart, _BENDING_LENGTH * len(lengths))


def _bending_nodes(rig: Rig, regions: Sequence[Region]) -> frozenset[int]:
    """The nodes that move one anchor of a region and not the next: those below where the anchors' chains part."""
    nodes: set[int] = set()
    for before, after in (pair for region in regions for pair in pairwise(region.anchors)):
        difference = np.zeros(len(rig.joints))
        difference[after.joints] += after.carried.weights
        difference[before.joints] -= before.carried.weights
        if np.ptp(difference) < _SAME_WEIGHTS:
            continue  # both anchors depend on the same joints: nothing bends between them
        ends = (int(rig.joints[np.argmax(difference)]), int(rig.joints[np.argmin(difference)]))
        nodes |= set(rig.upwards(ends[0])) ^ set(rig.upwards(ends[1]))
    return frozenset(nodes)


def prune(weights: Floats, distances: Floats, influences: int) -> tuple[Ints, Floats]:
    """Reduce each vertex to as many joints as the file can store.

    Each step drops the influence that costs least: its weight times the distance to the nearest joint kept. That joint
    takes over the weight; the heaviest does if several are equally near. Weights are (vertices, joints), with rows that
    sum to 1, and distances (joints, joints) in the skeleton.

    Returns:
        (vertices, influences) joints and weights, heaviest first.
    """
    most = max(influences, int((weights > 0).sum(axis=1).max(initial=0)))
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :most]
    kept = np.take_along_axis(weights, joints, 1)
    for _ in range(most - influences):
        rows = np.flatnonzero((kept > 0).sum(axis=1) > influences)
        used = kept[rows] > 0
        apart = distances[joints[rows][:, :, None], joints[rows][:, None, :]]
        apart = np.where(used[:, None, :] & ~np.eye(joints.shape[1], dtype=bool), apart, np.inf)
        cost = np.where(used, kept[rows] * apart.min(axis=2), np.inf)
        dropped = np.argmin(cost, axis=1)
        every = np.arange(len(rows))
        kept[rows, np.argmin(apart[every, dropped], axis=1)] += kept[rows, dropped]
        kept[rows, dropped] = 0.0
    order = np.argsort(-kept, axis=1, kind="stable")[:, :influences]
    kept = np.take_along_axis(kept, order, 1)
    joints = np.where(kept > 0, np.take_along_axis(joints, order, 1), 0)
    pad = ((0, 0), (0, influences - kept.shape[1]))
    return np.pad(joints, pad), np.pad(kept, pad)


def forbidden_splits(
    surface: Surface,
    rest: Rest,
    members: Bools,
    rig: Rig,
    regions: Sequence[Region],
    *,
    contacts: Bools,
    influences: int,
    poses: Poses,
    tolerance: float,
) -> Callable[[Level], Bools]:
    """Make a function that marks the (edges,) of a level that must not be split.

    They are edges along another mesh, where a new midpoint in only one of the meshes would leave a gap, and edges near
    the (coarse triangles,) members of regions whose midpoint would be too far off with pruned weights. Other arguments
    are those of `refine`.
    """
    near = any_of(flags_of(surface.triangles[members], len(surface.positions)), surface.triangles)
    used = distinct_values(surface.triangles[near])
    # Most joints move no vertex of a region.
    acting = distinct_values(surface.joints[used])
    coarse_weights = spread_weights(surface, used, len(rig.joints), acting)
    distances = joint_distances(rig, regions, acting)
    touched = contacts.astype(np.float64)

    def forbidden(level: Level) -> Bools:
        # No new vertex touches, as no edge between two that do is split.
        touching = level.of_vertices(np.arange(level.linear.shape[0]), touched) == 1.0
        found: Bools = touching[level.edges[:, 0]] & touching[level.edges[:, 1]]
        edges = distinct_values(level.triangle_edges[near[level.parents]])
        weights = level.of_midpoints(edges, coarse_weights)
        many = (weights > 0).sum(axis=1) > influences
        if not many.any():
            return found
        edges, weights = edges[many], weights[many]
        positions = level.of_midpoints(edges, rest.bind_positions)
        found[edges] |= pruning_errors(weights, positions, distances, influences, poses.of(acting)) > tolerance
        return found

    return forbidden


def spread_weights(surface: Surface, vertices: Ints, joint_count: int, chosen: Ints | slice = slice(None)) -> Floats:
    """(all vertices, chosen joints) skin weights of some vertices; 0 elsewhere, which takes hardly any memory."""
    some = surface.dense_weights(vertices, joint_count)[:, chosen]
    dense = np.zeros((len(surface.positions), some.shape[1]))
    dense[vertices] = some
    return dense
