"""Muscles attached to a rig: their ends on bones, the bone beneath the belly, and the skin above it.

Source: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning*, SCCG 2005.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.pose import joint_matrices, node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.segment import RestLength, Segment, Tension
from wrinklecli.effects.effect import Moves
from wrinklecli.effects.muscle.region import Bulge, bulges_on
from wrinklecli.effects.muscle.shapes import Belly, RefinedSkin, displaced, modes_of
from wrinklecli.effects.muscle.volume import ACTIVATION, FULLEST, ConstantVolume
from wrinklecli.errors import BakeError, WrinkleError, listed, nearest
from wrinklecli.numeric.arrays import Floats, determinants, singular, unit
from wrinklecli.numeric.nearest import distances_along
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import asked_positions, named_node
from wrinklecli.tools.body import ActivationKeys, ActivationMorph, Muscle
from wrinklecli.tools.records import Marker

# Thickness of the belly over the distance from bone to skin, twice 0.42: tried on a human's arm, 0.42 as the radius of
# the belly looks right, 0.62 is absurd.
_THICKNESS = 0.84
# Width over which the skin follows, over the same distance: an upper arm is about as wide.
_WIDTH = 2.4
# Distance of a muscle's middle from its bone, over the muscle's length, below which it bulges to no side.
_LEAST_SIDE = 0.01
# Distance of a muscle's middle from its bone, over that of the skin, above which it is no part of the limb.
_FARTHEST = 1.5
# Part of the error bound for the modes of a belly that travels; the others are of samples and dropped keys.
_TRAVEL_SHARE = 0.5
# Distance of an end below a place on the skin from its bone, over that of the skin: in the middle of the flesh.
_DEPTH = 0.45
# Distance of another mesh from the bone, over that of the skin above the belly, from which on it is the body below
# clothes: nearer, it is a bone, which fills a quarter of an arm.
_INNER = 1.0 / 3.0
# Distance of a muscle's ends over the mesh's size below which they are one point.
_LEAST_SPAN = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class AttachedMuscle:
    """A muscle on a mesh at rest.

    Attributes:
        tool: The muscle of the tools file.
        belly: Its place and size.
        bones: The nodes that carry its ends, origin first.
        bone: The node whose bone the belly lies along.
        depth: Distance from that bone to the skin above the belly, scene units.
        room: The same to the innermost mesh there: the body's, where this mesh is clothing.
        drive: Its length, and the weights of its targets.
        deltas: (targets, vertices, 3) displacements of the coarse surface at weight 1, bind space.
        heights: (vertices,) greatest displacements of the coarse surface, scene units.
        regions: The skin that is refined, once along the muscle and once round the limb.
        covers: Names of other meshes that lie over the muscle, so near that it reaches them, and have no muscles.
    """

    tool: Muscle
    belly: Belly
    bones: tuple[int, int]
    bone: int
    depth: float
    room: float
    drive: Drive
    deltas: Floats
    heights: Floats
    regions: tuple[Bulge, Bulge]
    covers: tuple[str, ...]

    @property
    def idle(self) -> bool:
        """True if nothing ever changes its length: one bone carries both ends, and it has no activation."""
        return self.bones[0] == self.bones[1] and self.tool.activation is None

    @property
    def greatest_height(self) -> float:
        """The largest move of the skin, scene units."""
        return float(np.abs(self.heights).max())

    @property
    def moves(self) -> Moves:
        """Its targets, for the effects after it."""
        return Moves(self.drive, self.deltas, self._refined)

    def _refined(self, fine: Refinement) -> Floats:
        """(targets, vertices, 3) displacements of the refined surface at weight 1, bind space."""
        return displaced(self.belly, self.response, RefinedSkin(fine))[0]

    @property
    def segment(self) -> Segment:
        """From its origin to its insertion."""
        assert isinstance(self.drive.signal, Segment)
        return self.drive.signal

    @property
    def response(self) -> ConstantVolume:
        """Weights by length."""
        assert isinstance(self.drive.response, ConstantVolume)
        return self.drive.response


def attach_muscles(
    muscles: Sequence[Muscle], ground: Ground, swelling: Container[str | None] = ()
) -> list[AttachedMuscle]:
    """Attach every muscle of a mesh.

    Args:
        muscles: Those of the mesh.
        ground: The mesh.
        swelling: The nodes of the file that have muscles: clothes among them swell with the skin below.

    Raises:
        WrinkleError: Muscles do not fit, a line for each.
    """
    found, problems = [], []
    bones = Bones.of(ground)
    for muscle in muscles:
        try:
            found.append(_attach(muscle, ground, bones, swelling))
        except WrinkleError as error:
            problems.append(error)
    if problems:
        raise BakeError.of_all(problems)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Bones:
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
    def of(cls, ground: Ground) -> "Bones":
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
            parent = int(rig.parents[joint])
            while parent >= 0 and parent not in below:
                parent = int(rig.parents[parent])
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
        along = self.ends - self.starts
        squares = np.sum(along**2, axis=1)
        shares = np.sum((point - self.starts) * along, axis=1) / np.where(squares > 0, squares, 1.0)
        feet = self.starts + np.clip(shares, 0.0, 1.0)[:, None] * along
        return int(np.argmin(np.sum((point - feet) ** 2, axis=1)))


def below_skin(ground: Ground, place: Floats) -> tuple[str, Floats]:
    """The joint that carries a muscle's end below a (3,) place on the skin, and the end's offset from that joint.

    The end lies in the flesh of the innermost mesh, where the skin is that of clothes.
    """
    bones = Bones.of(ground)
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


def _attach(muscle: Muscle, ground: Ground, bones: Bones, swelling: Container[str | None]) -> AttachedMuscle:
    rig, rest = ground.rig, ground.rest
    places = asked_positions(rig, rest.clip, rest.time, muscle)
    span = float(np.linalg.norm(places[1] - places[0]))
    if span <= _LEAST_SPAN * ground.surface.size:
        raise BakeError("origin and insertion are one point", where=muscle.where)
    tendons = muscle.tendon.resolve(span)
    if tendons >= span:
        raise BakeError(
            f"its tendons are {tendons:.4g} long together, and the whole muscle is {span:.4g}: nothing is left to"
            " shorten",
            where=muscle.place("tendon"),
        )
    ends = _carrying_node(muscle, 0, places[0], rig, bones), _carrying_node(muscle, 1, places[1], rig, bones)
    middle = places.mean(axis=0)
    bone = bones.nearest(middle)
    start, axis = bones.starts[bone], bones.ends[bone] - bones.starts[bone]
    if not axis.any():
        axis = places[1] - places[0]
    axis = unit(axis)
    foot = start + axis * float((middle - start) @ axis)
    side = middle - foot
    if np.linalg.norm(side) < _LEAST_SIDE * span:
        raise BakeError(
            f"its middle lies in the bone of {rig.names[bones.nodes[bone]]!r}, so it bulges to no side; move its ends"
            " to the side of the limb on which it lies",
            where=muscle.where,
        )
    apart, side = float(np.linalg.norm(side)), unit(side)
    depth = float(distances_along(foot, side, rest.positions[ground.surface.triangles]).min(initial=np.inf))
    if depth > span or apart > _FARTHEST * depth:
        found = f"skin is {depth:.4g} from" if depth < np.inf else "no skin lies on that side of"
        raise BakeError(
            f"there is no skin near it: its middle is {apart:.4g} from the bone of {rig.names[bones.nodes[bone]]!r},"
            f" and {found} that bone",
            where=muscle.where,
        )
    room = _room(ground, bones.nodes[bone], foot, side, depth)
    thickness = _resolved(muscle.thickness, _THICKNESS * room, span)
    if thickness > 2.0 * depth:
        raise BakeError(
            f"is {thickness:.4g} thick, where bone and skin are {depth:.4g} apart; at most twice that fits",
            where=muscle.place("thickness"),
        )
    belly = Belly(
        origin=places[0],
        insertion=places[1],
        tendons=tendons,
        thickness=thickness,
        width=_resolved(muscle.width, _WIDTH * depth, span),
        depth=depth,
        foot=foot,
        axis=axis,
        side=side,
    )
    response = ConstantVolume(span, tendons, *_modes(muscle, belly, ground))
    deltas, heights = displaced(belly, response, ground.rest)
    if not heights.any():
        raise BakeError("no vertex lies above it", where=muscle.where)
    segment = Segment(
        tuple(carried_by(ground, node, place) for node, place in zip(ends, places, strict=True)),
        RestLength(span),
        _tension(muscle, ACTIVATION * response.belly, rig),
    )
    names = tuple(f"wrinkle_{muscle.identifier}_{number + 1}" for number in range(len(deltas)))
    drive = Drive(muscle.name, segment, names, response)
    regions = bulges_on(ground, belly, heights)
    covers = tuple(name for name in ground.meshes_over(np.maximum(heights, 0.0)) if name not in swelling)
    return AttachedMuscle(muscle, belly, ends, bones.nodes[bone], depth, room, drive, deltas, heights, regions, covers)


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
    for corners in ground.neighbours.triangles_near(rig.node, ends.min(axis=0), ends.max(axis=0)):
        met = distances_along(start, ray, corners)
        room = float(met[met > _INNER].min(initial=room))
    return room * depth


def _modes(muscle: Muscle, belly: Belly, ground: Ground) -> tuple[Floats, Floats, Floats]:
    """(knots,) thicknesses over that at rest, (knots,) those gained, and (knots, targets) weights there."""
    if not muscle.travel:
        return np.ones(1), np.array([FULLEST - 1.0]), np.ones((1, 1))
    tolerance = _TRAVEL_SHARE * ground.max_error.resolve(belly.thickness * (FULLEST - 1.0))
    return modes_of(belly, tolerance, activated=muscle.activation is not None)


def _resolved(wanted: object, usual: float, span: float) -> float:
    """A length of the tools file, scene units; `usual` if it is auto."""
    return usual if wanted == "auto" else wanted.resolve(span)  # type: ignore[attr-defined]


def _carrying_node(muscle: Muscle, number: int, place: Floats, rig: Rig, bones: Bones) -> int:
    """The node that carries an end of a muscle: the one that it names or hangs on, or the nearest bone's joint."""
    point, joints = muscle.points[number], set(rig.joints.tolist())
    if isinstance(point, tuple):
        return bones.nodes[bones.nearest(place)]
    node = named_node(rig, muscle, number)
    if isinstance(point, Marker):
        while node >= 0 and node not in joints:
            node = int(rig.parents[node])
    return node if node >= 0 else bones.nodes[bones.nearest(place)]


def carried_by(ground: Ground, node: int, place: Floats) -> CarriedPoint:
    """A (3,) place at rest that a node carries rigidly."""
    matrix = node_matrices(ground.rig, ground.rest.clip, ground.rest.time, [node])[0, 0]
    points = np.zeros((1 + len(ground.rig.morph_names), 1, 4))
    points[0, 0] = np.linalg.solve(matrix, np.append(place, 1.0))
    size = float(np.abs(determinants(matrix[None, :3, :3]))[0])
    return CarriedPoint(np.array([node]), np.ones(1), points, np.array([1.0 / size]))


def _tension(muscle: Muscle, length: float, rig: Rig) -> Tension | None:
    """The activation of a muscle; None for one that its length alone thickens.

    Raises:
        BakeError: The mesh has no such morph target.
    """
    wanted = muscle.activation
    if isinstance(wanted, ActivationKeys):
        return Tension(length, {clip: np.array(keys, np.float64) for clip, keys in wanted.keys.items()})
    if isinstance(wanted, ActivationMorph):
        names = rig.own.morph_names
        if wanted.morph not in names:
            raise BakeError(
                f"the mesh has no morph target {wanted.morph!r}{nearest(wanted.morph, names)}; it has {listed(names)}",
                where=muscle.place("activation", "morph"),
            )
        return Tension(length, morph=names.index(wanted.morph))
    return None
