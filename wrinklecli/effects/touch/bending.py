"""The bend of a joint near a touch, and what it changes of a slide.

Where a joint bends, the skin before it is stretched or pressed together, and a slide fades over more or less of it. The
shapes of a touch are those of the rest pose; their changes to either side grow almost as the sine of the bend, so that
one more shape for each way and side, times that sine, makes up for them. The joint and its axis follow from the mesh,
not from clips.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.motion import held_at, motion_clip, turning
from wrinklecli.character.pose import joint_matrices, node_matrices
from wrinklecli.effects.touch.skin import Hold, Place, hold_of, slides_on
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, Ints, inverses, singular, unit, unit_quaternions
from wrinklecli.surface.bones import carried_by
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest, clip_pose

# Angle of the bends, to either side, in which slides are solved, radians: with 46° they were 3.2 % off where a wrist is
# bent back by 60°, with 65° 4.2 % off at 36°, and with 54° 1.9 % at most.
_SOLVED = np.radians(54.0)
_HALF = 0.5
# Part of the slide that a joint must carry otherwise than the place does, along the limb, to change it: with less, the
# change was below 2 % of the slide on the hands that were tried.
_LEAST_CARRIED = 0.03
# Part of the place up to which the other side of the joint may carry it.
_APART = 0.1
# Change over the slide below which a vertex has none: targets are sparse.
_LEAST_SEEN = 0.002
LEAST_CHANGE = 0.02
"""Greatest change over the slide, at a bend of 90°, that nobody sees."""


@dataclass(frozen=True, slots=True, eq=False)
class Bent:
    """A touch in a bent pose.

    Attributes:
        pose: The coarse surface.
        place: The touch's.
        hold: How the coarse skin is held there.
        bend: The sine of the bend, as the drive measures it.
    """

    pose: Rest
    place: Place
    hold: Hold
    bend: float


@dataclass(frozen=True, slots=True, eq=False)
class Bending:
    """A joint that bends the skin of a touch.

    Attributes:
        limb: Two points at rest, a pad apart along the limb, that the other side of the joint carries.
        bents: The touch bent towards the skin, with a `bend` above 0, and away from it.
    """

    limb: tuple[CarriedPoint, CarriedPoint]
    bents: tuple[Bent, Bent]

    def changes(self, fine: Refinement, slides: Floats) -> Floats:
        """(2, 2, fine vertices, 3) changes of (2, fine vertices, 3) slides in bends of sine 1 and -1, world at rest."""
        return np.stack([self._change(bent, fine, slides) for bent in self.bents])

    def _change(self, bent: Bent, fine: Refinement, slides: Floats) -> Floats:
        found = slides_on(fine, fine.posed_at(bent.pose, np.arange(len(fine.positions)))[0], bent.place, bent.hold)
        blended = fine.subdivision.interpolate(bent.pose.blended.reshape(-1, 12)).reshape(-1, 3, 4)
        shown = np.flatnonzero(np.any(slides, axis=(0, 2)) & ~singular(blended))
        change = np.zeros(slides.shape)
        carried = fine.blended[shown, :, :3] @ inverses(blended[shown])
        change[:, shown] = np.einsum("vab,wvb->wva", carried, found[:, shown]) - slides[:, shown]
        change[np.sqrt((change**2).sum(axis=2)) < _LEAST_SEEN] = 0.0
        return np.asarray(change / abs(bent.bend))


def bending_of(ground: Ground, place: Place, hold: Hold, soft: Floats | None, slides: Floats) -> Bending | None:
    """Find the joint that changes a touch's slide most, and solve the skin's hold in two bends of it.

    Args:
        ground: The mesh at rest.
        place: The place of the touch.
        hold: How the coarse skin is held at rest.
        soft: (vertices,) factors of a mask; None without one.
        slides: (2, vertices, 3) on the coarse skin at rest.

    Returns:
        None if there is no such joint, and in the rest pose `bind`, in which no joint is where the rig has it.
    """
    rest, rig = ground.rest, ground.rig
    if not rig.skinned or not np.array_equal(rest.matrices, joint_matrices(rig, rest.clip, rest.time)[0]):
        return None
    triangle, corners, _ = rest.closest_point(place.at)
    vertices, moving = rest.triangles[triangle], np.flatnonzero(np.any(slides, axis=(0, 2)))
    below, count = rig.joints_below, len(rig.joints)
    own = corners @ ground.surface.dense_weights(vertices, count) @ below.T
    shares = ground.surface.dense_weights(moving, count) @ below.T
    places = node_matrices(rig, rest.clip, rest.time, rig.joints.tolist())[0, :, :3, 3]
    ways = place.at - places
    ways -= (ways @ place.axes[2])[:, None] * place.axes[2]
    alongs = unit(ways)
    # Skin that the joint carries otherwise counts where it slides, and by how far it lies along the limb.
    slid = np.sqrt((slides[:, moving] ** 2).sum(axis=2)).max(axis=0)
    offsets = (rest.positions[moving] - place.at) @ alongs.T
    spread = np.sqrt(np.maximum(slid @ offsets**2, TINY) * slid.sum())
    scores = np.abs(slid @ ((shares - own) * offsets)) / spread
    # Files of clips have the joints of the skin, but perhaps nothing above them.
    joints = set(rig.joints.tolist())
    turnable = np.array(
        ["rotation" in rig.locals[node] and int(rig.parents[node]) in joints for node in rig.joints.tolist()]
    )
    # A joint above the place bends all the skin behind it; one below may be a finger beside the slide.
    sides = [turnable & side & (scores > _LEAST_CARRIED) for side in (own > 1.0 - _APART, own < _APART)]
    chosen = next((np.flatnonzero(side) for side in sides if side.any()), None)
    if chosen is None:
        return None
    number = int(chosen[np.argmax(scores[chosen])])
    node, along = int(rig.joints[number]), alongs[number]
    far = int(rig.parents[node]) if own[number] > _HALF else node
    joint = _Joint(node, far, along, vertices, corners)
    if singular(node_matrices(rig, rest.clip, rest.time, [far])[0, :, :3]).any():
        return None
    one, other = (_bent(ground, place, hold, soft, joint, turn) for turn in (_SOLVED, -_SOLVED))
    one, other = sorted((one, other), key=lambda each: -each.bend)
    # A place that both sides of the joint carry hardly turns against the limb.
    if min(one.bend, -other.bend) < _HALF * np.sin(_SOLVED):
        return None
    limb = (carried_by(ground, far, place.at), carried_by(ground, far, place.at + place.pad * along))
    return Bending(limb, (one, other))


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
    """The joint that bends the skin of a touch.

    Attributes:
        node: The joint that turns.
        far: The joint that carries the other side.
        along: (3,) unit, from the joint to the place, in the tangent plane of the place.
        vertices: (3,) of the triangle with the place.
        corners: (3,) the place's shares in it.
    """

    node: int
    far: int
    along: Floats
    vertices: Ints
    corners: Floats


def _bent(ground: Ground, place: Place, hold: Hold, soft: Floats | None, joint: _Joint, turn: float) -> Bent:
    """The touch where a joint is turned by an angle about the axis across the limb, in the skin's tangent plane."""
    rig, rest = ground.rig, ground.rest
    (above,) = node_matrices(rig, rest.clip, rest.time, [int(rig.parents[joint.node])])[0]
    axis = unit(np.linalg.pinv(above[:3, :3]) @ np.cross(place.axes[2], joint.along))
    held = {} if rest.clip is None else {(each.node, each.path): each for each in held_at(rest.clip, rest.time)}
    own = held.pop((joint.node, "rotation"), None)
    unbent = np.array(rig.locals[joint.node]["rotation"] if own is None else own.values[0], np.float64)
    channels = [turning(joint.node, unit_quaternions(unbent), axis, turn), *held.values()]
    clip = motion_clip(f"bend {joint.node} {turn} {axis.tolist()}", channels)
    pose = clip_pose(rest, ground.surface, rig, clip, 1.0)
    before, after = (
        (joint.corners @ each.blended[joint.vertices].reshape(3, 12)).reshape(3, 4)[:, :3] for each in (rest, pose)
    )
    turned = after @ np.linalg.inv(before)
    normal = unit(joint.corners @ pose.normals_at(joint.vertices))
    forward = turned @ place.axes[0]
    forward = unit(forward - (forward @ normal) * normal)
    sideways = np.cross(normal, forward) * np.sign(np.linalg.det(place.axes))
    at = joint.corners @ pose.positions[joint.vertices]
    there = Place(at, np.stack([forward, sideways, normal]), place.pad, place.reach)
    poses = (rest.clip, rest.time), (clip, np.ones(1))
    (far,), (turned_far,) = (node_matrices(rig, *each, [joint.far])[0, :, :3, :3] for each in poses)
    limb = turned_far @ np.linalg.solve(far, joint.along)
    bend = float(np.linalg.solve(turned @ place.axes.T, limb)[2])
    return Bent(pose, there, hold_of(replace(ground, rest=pose), there, soft, hold.still), bend)
