"""The turns of joints that fold a garment: the axes about which each turns, how far, and the poses that show it.

Joints turn as far as clips turn them, about the principal axes of their turns there: a knee has one, a hip three. Where
no clip turns any joint much, they turn as `character.range_of_motion` lets them.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.motion import motion_clip, quaternion_product, turning
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.range_of_motion import TELLING, range_of_motion
from wrinklecli.character.rig import Rig
from wrinklecli.choices import Part
from wrinklecli.drive.angle import JointAngle
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, unit, unit_quaternions
from wrinklecli.numeric.drawn import drawn
from wrinklecli.surface.ground import Ground

# Least turn about an axis that counts, radians: joints turn by less beside their hinge. With half of it the file of a
# body that walks was a third larger.
_LEAST = float(np.radians(12.0))
# Steps of a sweep, radians: heights go with the root of the compression, so they are smooth beyond the first step.
_STEP = float(np.radians(25.0))
# Least steps to a side on which a joint turns at all.
_LEAST_STEPS = 2
# Most turns, those of the joints that bend the most: a body in clothes has twenty that fold them.
_MOST = 32
# Poses in which joints turn at once, each by its own part of its range, twice as many without clips; and those in which
# all turn by the same part.
_MIXTURES, _ALIKE = 4, 4
# Moments of clips, evenly spread over all, that are among the poses: what is played should be right. They take a third
# off the errors of heights in the sample's squat.
_MOMENTS = 12
# Turns that do so, in the mean, where no clip shows them.
_TOGETHER = 4.0
# Ends of limbs, with the part above each.
_ENDS: Mapping[Part | None, Part] = {"foot": "lower leg", "hand": "lower arm"}


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A joint that turns about one axis.

    Attributes:
        signal: The angle about the axis; its rest is the stored rotation.
        angles: (steps,) sorted radians from the greatest turn one way to that the other way; 0 is among them.
    """

    signal: JointAngle
    angles: Floats

    def channel(self, angle: float) -> Channel:
        """A channel that turns the joint by an angle in a second."""
        return turning(self.signal.node, self.signal.rest, self.signal.axis, angle)


def turns_of(ground: Ground, moving: Sequence[int]) -> list[Turn]:
    """The turns of some nodes of a character, each about up to three axes, those of the first nodes first."""
    shown = {node: _shown(ground.rig, node, ground.clips) for node in moving if "rotation" in ground.rig.locals[node]}
    told = _are_told(shown.values())
    usual = {} if told else range_of_motion(ground.document, [ground.rig.node]).turns
    found = []
    for node, vectors in shown.items():
        stored, parent = unit_quaternions(ground.rig.locals[node]["rotation"]), int(ground.rig.parents[node])
        for axis, (least, most) in _principal(vectors) if told else usual.get(node, ()):
            if -least >= most:
                axis, least, most = -axis, -most, -least
            if most >= _LEAST:
                found.append(Turn(JointAngle(node, parent, unit(axis), stored), _steps(least, most)))
    return found[:_MOST]


def acting_together(ground: Ground, turns: Sequence[Turn]) -> float:
    """The number of turns that act at once, in the mean: all where clips show them, as in a walk."""
    vectors = [_shown(ground.rig, node, ground.clips) for node in {turn.signal.node for turn in turns}]
    return len(turns) if _are_told(vectors) else min(_TOGETHER, len(turns))


def led_by(ground: Ground) -> list[tuple[int, Ints]]:
    """Numbers of joints of limbs, each with those of a foot or a hand that is not below it and shares its skin.

    Where inverse kinematics moves limbs, these stand beside them, and follow them in every clip.
    """
    rig, surface, parts, found = ground.rig, ground.surface, ground.neighbours.parts, []
    of_joints = [parts[node] for node in rig.joints.tolist()]
    for number, node in enumerate(rig.joints.tolist()):
        above = _ENDS.get(parts[node])
        if above is None or above in (parts[each] for each in rig.upwards(node)):
            continue
        own = np.where(surface.joints == number, surface.weights, 0.0).sum(axis=1)
        shared = np.bincount(surface.joints.ravel(), (own[:, None] * surface.weights).ravel(), len(of_joints))
        shared *= [part == above for part in of_joints]
        if shared.any():
            below = [node in rig.upwards(each) for each in rig.joints.tolist()]
            found.append((int(shared.argmax()), np.flatnonzero(below)))
    return found


def _are_told(shown: Iterable[Floats]) -> bool:
    """True if some (keys, 3) turns in clips are so wide that clips tell how far joints turn."""
    return any(np.linalg.norm(each, axis=1).max(initial=0.0) >= np.radians(TELLING) for each in shown)


def _principal(vectors: Floats) -> list[tuple[Floats, tuple[float, float]]]:
    """The principal axes of (turns, 3) axes · radians, with the range about each."""
    axes = np.linalg.svd(vectors, full_matrices=False)[2]
    return [(axis, _angles(vectors, axis)) for axis in axes]


def _shown(rig: Rig, node: int, clips: Sequence[Clip]) -> Floats:
    """(keys, 3) turns of a node from its stored rotation at the keys of clips: axes in its parent's space · radians."""
    stored = unit_quaternions(rig.locals[node]["rotation"])
    found = [np.zeros((1, 3))]
    for clip in clips:
        channel = clip.channel(node, "rotation")
        if channel is not None:
            keys = unit_quaternions(channel.points.T).T
            turns = quaternion_product(keys, stored * [-1.0, -1.0, -1.0, 1.0])
            turns *= np.where(turns[:, 3:] < 0, -1.0, 1.0)
            halves = np.arctan2(np.linalg.norm(turns[:, :3], axis=1), turns[:, 3])
            found.append(unit(turns[:, :3]) * (2.0 * halves)[:, None])
    return np.concatenate(found)


def _angles(vectors: Floats, axis: Floats) -> tuple[float, float]:
    """The least and greatest angle about an axis, as `JointAngle` measures it, of (turns, 3) axes · radians."""
    sizes = np.linalg.norm(vectors, axis=1)
    halves = np.tan(np.minimum(sizes, 0.99 * np.pi) / 2.0)
    angles = 2.0 * np.arctan(halves * (vectors @ axis) / np.where(sizes > 0, sizes, 1.0))
    return min(float(angles.min()), 0.0), max(float(angles.max()), 0.0)


def _steps(least: float, most: float) -> Floats:
    """Sorted angles from the least to the greatest, with 0."""
    up = np.linspace(0.0, most, max(_LEAST_STEPS, int(np.ceil(most / _STEP))) + 1)
    if least > -_LEAST:
        return up
    down = np.linspace(least, 0.0, max(_LEAST_STEPS, int(np.ceil(-least / _STEP))) + 1)
    return np.concatenate([down[:-1], up])


@dataclass(frozen=True, slots=True, eq=False)
class Sweeps:
    """Poses of a character: each turn through its range by itself, and mixtures of all.

    Attributes:
        turns: The turns.
        angles: (poses, turns) radians.
        owners: (poses,) the number of the turn that is swept; -1 for mixtures.
        matrices: (poses, joints, 4, 4) bind to world space.
    """

    turns: tuple[Turn, ...]
    angles: Floats
    owners: Ints
    matrices: Floats

    @classmethod
    def of(
        cls,
        rig: Rig,
        turns: Sequence[Turn],
        clips: Sequence[Clip] = (),
        *,
        seed: str,
        together: float = np.inf,
        led: Sequence[tuple[int, Ints]] = (),
    ) -> "Sweeps":
        """Let joints turn one by one, then so many `together`, in the mean, and then as in clips; some are `led`."""
        rows, owners = [], []
        for number, turn in enumerate(turns):
            for angle in turn.angles[turn.angles != 0]:
                rows.append(np.eye(len(turns))[number] * angle)
                owners.append(number)
        least, most = (np.array([end(turn.angles) for turn in turns]) for end in (np.min, np.max))
        count = _MIXTURES if clips else 2 * _MIXTURES
        shares = (drawn(seed, "mixtures", count, len(turns)) + 1.0) / 2.0
        # As in a squat, on the way down and at its end.
        alike = np.linspace(0.0, 1.0, _ALIKE + 1)[1:, None] * most
        mixed = np.concatenate([alike, least + shares * (most - least)])
        acting = (drawn(seed, "turning", len(mixed), len(turns)) + 1.0) / 2.0 < together / len(turns)
        rows += [*np.where(acting, mixed, 0.0), *_in_clips(rig, turns, clips)]
        owners += [-1] * (len(rows) - len(owners))
        angles = np.array(rows).reshape(-1, len(turns))
        matrices = np.stack([_matrices(rig, turns, each) for each in angles])
        stored = np.linalg.pinv(joint_matrices(rig, None, np.zeros(1))[0])
        for leader, own in led:
            matrices[:, own] = (matrices[:, leader] @ stored[leader])[:, None] @ matrices[:, own]
        return cls(tuple(turns), angles, np.array(owners), matrices)

    @property
    def ends(self) -> Ints:
        """(poses,) the poses in which a turn is farthest, one way or the other."""
        own = np.flatnonzero(self.owners >= 0)
        angles = self.angles[own, self.owners[own]]
        least, most = (
            np.array([end(turn.angles) for turn in self.turns])[self.owners[own]] for end in (np.min, np.max)
        )
        return np.asarray(own[(angles == least) | (angles == most)])


def _in_clips(rig: Rig, turns: Sequence[Turn], clips: Sequence[Clip]) -> Iterator[Floats]:
    """The (turns,) radians at moments that are evenly spread over all clips."""
    ends = np.cumsum([clip.end - clip.start for clip in clips])
    moments = ends[-1:] * (np.arange(_MOMENTS)[:, None] + 0.5) / _MOMENTS
    owners = np.searchsorted(ends, moments[:, 0]) if len(ends) else np.zeros(0, np.intp)
    for number in np.unique(owners).tolist():
        times = clips[number].end - (ends[number] - moments[owners == number, 0])
        yield from np.stack([turn.signal.angles(rig, clips[number], times).rows for turn in turns], axis=1)


def _matrices(rig: Rig, turns: Sequence[Turn], angles: Floats) -> Floats:
    """(joints, 4, 4) matrices where joints are turned by (turns,) angles, about one axis after the other."""
    channels: dict[int, Channel] = {}
    for turn, angle in zip(turns, angles.tolist(), strict=True):
        if angle:
            made = turn.channel(angle)
            before = channels.get(turn.signal.node)
            if before is not None:
                rest = turn.signal.rest * [-1.0, -1.0, -1.0, 1.0]
                turned = quaternion_product(quaternion_product(made.values[-1:], rest), before.values[-1])
                made = replace(made, values=np.concatenate([made.values[:1], turned]))
            channels[turn.signal.node] = made
    return np.asarray(joint_matrices(rig, motion_clip("", list(channels.values())), np.ones(1))[0])
