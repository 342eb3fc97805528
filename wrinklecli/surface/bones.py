"""The bones of a mesh at rest, the skin round them, and what they carry."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.pose import joint_matrices, node_matrices
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, determinants, singular, unit
from wrinklecli.numeric.rays import distances_along
from wrinklecli.surface.features import segment_distances
from wrinklecli.surface.ground import Ground

# Distance of an end below a place on the skin from its bone, over that of the skin: in the middle of the flesh.
_DEPTH = 0.45
# Distance of another mesh from the bone, over that of the skin above the belly, from which on it is the body below
# clothes: nearer, it is a bone, which fills a quarter of an arm.
_INNER = 1.0 / 3.0


@dataclass(frozen=True, slots=True, eq=False)
class BoneLines:
    """The bones of a mesh at rest: straight lines from joints that carry skin to the joints below them.

    The bone of a joint with none below ends twice as far as the middle of its skin.

    Attributes:
        nodes: The joint that carries each bone.
        starts, ends: (bones, 3) world space at rest.
    """

    nodes: tuple[int, ...]
    starts: Floats
    ends: Floats

    @classmethod
    def of(cls, ground: Ground) -> "BoneLines":
        """The bones of a mesh."""
        rig, surface = ground.rig, ground.surface
        joints = rig.joints.tolist()
        places = _places(ground, joints)
        shares = np.zeros(len(joints))
        sums = np.zeros((len(joints), 3))
        np.add.at(shares, surface.joints, surface.weights)
        np.add.at(sums, surface.joints, surface.weights[..., None] * ground.rest.positions[:, None])
        below: dict[int, list[int]] = {joint: [] for joint in joints}
        for number, joint in enumerate(joints):
            parent = rig.next_above(joint, below)
            if parent >= 0:
                below[parent].append(number)
        nodes, starts, ends = [], [], []
        for number in np.flatnonzero(shares > 0).tolist():
            tips = [places[other] for other in below[joints[number]]]
            for tip in tips or [2.0 * sums[number] / shares[number] - places[number]]:
                nodes.append(joints[number])
                starts.append(places[number])
                ends.append(tip)
        return cls(tuple(nodes), np.array(starts), np.array(ends))

    def nearest(self, point: Floats) -> int:
        """The number of the bone that is nearest to a (3,) point."""
        bones = np.stack([self.starts, self.ends], axis=1)
        return int(np.argmin(segment_distances(np.broadcast_to(point, self.starts.shape), bones)))

    def side_of(self, ground: Ground, place: Floats, along: Floats) -> "SideOfBone":
        """The side of the nearest bone on which a (3,) place lies; a bone without a length runs along a (3,) vector."""
        number = self.nearest(place)
        start, axis = self.starts[number], self.ends[number] - self.starts[number]
        axis = unit(axis if axis.any() else along)
        foot = start + axis * float((place - start) @ axis)
        apart, side, depth = float(np.linalg.norm(place - foot)), unit(place - foot), np.inf
        if apart > 0.0:
            skin = ground.rest.positions[ground.surface.triangles]
            depth = float(distances_along(foot, side, skin).min(initial=np.inf))
        return SideOfBone(self.nodes[number], foot, axis, side, apart, depth)


@dataclass(frozen=True, slots=True, eq=False)
class SideOfBone:
    """A side of a bone, and the skin there.

    Attributes:
        node: The joint that carries the bone.
        foot: (3,) the point of the bone below the place that says the side.
        axis: (3,) unit vector along the bone.
        side: (3,) unit vector from that point to the place.
        apart: Distance of the place from the bone, scene units.
        depth: Distance of the skin there from the bone; infinite if no skin lies on that side.
    """

    node: int
    foot: Floats
    axis: Floats
    side: Floats
    apart: float
    depth: float

    def room(self, ground: Ground) -> float:
        """The distance from the bone to the innermost mesh there: the body's, where this mesh is clothing."""
        return _room(ground, self.node, self.foot, self.side, self.depth)


def bone_distances(points: Floats, bones: Floats) -> Floats:
    """(points,) distances to the nearest of (bones, 2, 3) segments."""
    found = np.full(len(points), np.inf)
    for bone in bones:
        found = np.minimum(found, segment_distances(points, bone[None]))
    return found


def below_skin(ground: Ground, place: Floats) -> tuple[str, Floats]:
    """The joint that carries a muscle's end below a (3,) place on the skin, and the end's offset from that joint.

    The end lies in the flesh of the innermost mesh, where the skin is that of clothes.
    """
    bones = BoneLines.of(ground)
    number = bones.nearest(place)
    start, along = bones.starts[number], bones.ends[number] - bones.starts[number]
    square = float(along @ along)
    share = float(np.clip((place - start) @ along / square, 0.0, 1.0)) if square else 0.0
    foot = start + share * along
    depth, side = float(np.linalg.norm(place - foot)), unit(place - foot)
    room = _room(ground, bones.nodes[number], foot, side, depth)
    return ground.rig.names[bones.nodes[number]], foot + _DEPTH * room * side - start


def _places(ground: Ground, nodes: Sequence[int]) -> Floats:
    """(nodes, 3) places of nodes in the rest pose, world space."""
    return node_matrices(ground.rig, ground.rest.clip, ground.rest.time, nodes)[0, :, :3, 3]


def _room(ground: Ground, bone: int, foot: Floats, side: Floats, depth: float) -> float:
    """The distance from a point of a bone to the innermost mesh on a side: clothes lie over the body of another node.

    Args:
        ground: The mesh that the muscle moves.
        bone: The joint that carries the bone.
        foot: (3,) the point.
        side: (3,) unit vector.
        depth: Distance to this mesh.
    """
    rig, rest = ground.rig, ground.rest
    joint = np.flatnonzero(rig.joints == bone)[:1]
    # The other meshes are in the stored pose, to which the bone carries the ray.
    stored = joint_matrices(rig, None, np.zeros(1), joint)[0, 0]
    if singular(np.stack([stored, rest.matrices[joint[0]]])[:, :3, :3]).any():
        return depth
    turn = stored @ np.linalg.inv(rest.matrices[joint[0]])
    start, ray = turn[:3, :3] @ foot + turn[:3, 3], turn[:3, :3] @ (depth * side)
    ends = np.stack([start, start + ray])
    room = 1.0
    for _, corners in ground.neighbours.triangles_near(rig.node, ends.min(axis=0), ends.max(axis=0)):
        met = distances_along(start, ray, corners)
        room = float(met[met > _INNER].min(initial=room))
    return room * depth


def carried_by(ground: Ground, node: int, place: Floats) -> CarriedPoint:
    """A (3,) place at rest that a node carries rigidly."""
    matrix = node_matrices(ground.rig, ground.rest.clip, ground.rest.time, [node])[0, 0]
    points = np.zeros((1 + len(ground.rig.morph_names), 1, 4))
    points[0, 0] = np.linalg.solve(matrix, np.append(place, 1.0))
    size = float(np.abs(determinants(matrix[None, :3, :3]))[0])
    return CarriedPoint(np.array([node]), np.ones(1), points, np.array([1.0 / size]))
