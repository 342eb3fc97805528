"""The turns of joints that fold a garment: the axes about which each turns, how far, and the poses that show it.

Joints turn as far as clips turn them, about the principal axes of their turns there: a knee has one, a hip three. Where
no clip turns any joint much, they turn as `character.range_of_motion` lets them. Several joints of a spine bend the
same cloth, each by little: where they turn together, they count as one, which the last one shows against what is above
the first.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Channel, Clip, sample
from wrinklecli.character.motion import MOST_TURN, motion_clip, quaternion_product, turned_axis, turned_back, turning
from wrinklecli.character.pose import joint_matrices, stored_positions
from wrinklecli.character.range_of_motion import TELLING, range_of_motion
from wrinklecli.character.rig import Rig
from wrinklecli.choices import Part
from wrinklecli.drive.angle import JointAngle
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, Ints, distinct_values, unit, unit_quaternions
from wrinklecli.numeric.drawn import drawn
from wrinklecli.surface.ground import Ground

# Least turn about an axis that counts, radians: joints turn by less beside their hinge. With half of it the file of a
# body that walks was a third larger.
_LEAST = float(np.radians(12.0))
# Least part of a chain's turn that a joint has. Keys of one that stays still have rounding errors.
_LEAST_SHARE = 0.01
# Steps of a sweep, radians: heights go with the root of the compression, so they are smooth beyond the first step.
_STEP = float(np.radians(25.0))
# Least steps to a side on which a joint turns at all.
_LEAST_STEPS = 2
# Most turns, those of the joints that bend the most: a body in clothes has twenty that fold them.
_MOST = 32
# Poses in which joints turn at once, each by its own part of its range, twice as many without clips; and those in which
# all turn by the same part.
_MIXTURES, _ALIKE = 12, 4
# Moments of clips, evenly spread over all, that are among the poses: what is played should be right. They take a third
# off the errors of heights in the sample's squat.
_MOMENTS = 12
# Turns that do so, in the mean, where no clip shows them.
_TOGETHER = 4.0
# Ends of limbs, with the part above each.
_ENDS: Mapping[Part | None, Part] = {"foot": "lower leg", "hand": "lower arm"}


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A joint, or a chain of joints, that turns about one axis.

    Attributes:
        signal: The angle of the last joint about the axis, against what is above the first; its rest is as stored.
        angles: (steps,) sorted radians from the greatest turn one way to that the other way; 0 is among them.
        joints: Each joint's own turn, and the part of the angle that it has.
    """

    signal: JointAngle
    angles: Floats
    joints: tuple[tuple[JointAngle, float], ...]

    def channels(self, angle: float) -> list[Channel]:
        """Channels that turn the joints by an angle, all together, in a second."""
        return [turning(each.node, each.rest, each.axis, share * angle) for each, share in self.joints]


def turns_of(ground: Ground, moving: Sequence[int], thickness: float) -> list[Turn]:
    """The turns of some nodes of a character, each about up to three axes, those of the first nodes first.

    Nodes nearer to each other than the thickness of a limb, scene units, bend the same cloth.
    """
    rig = ground.rig
    nodes = [node for node in moving if "rotation" in rig.locals[node]]
    shown = _shown(rig, nodes, ground.clips)
    told = _are_told(shown)
    if not told:
        shown = _usual(ground, nodes)
    found = []
    for chain in _chains(rig, nodes, shown, thickness):
        axes = np.linalg.svd(chain.whole, full_matrices=False)[2] if told else _farthest(chain.whole)
        for axis in axes:
            least, most = _angles(chain.whole, axis)
            if -least >= most:
                axis, least, most = -axis, -most, -least
            if most >= _LEAST:
                found.append(chain.turn(rig, axis, _steps(least, most)))
    return found[:_MOST]


def acting_together(ground: Ground, turns: Sequence[Turn]) -> float:
    """The number of turns that act at once, in the mean: all where clips show them, as in a walk."""
    nodes = sorted({joint.node for turn in turns for joint, _ in turn.joints})
    return len(turns) if _are_told(_shown(ground.rig, nodes, ground.clips)) else min(_TOGETHER, len(turns))


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    """Joints that turn as one, each the parent of the next.

    Attributes:
        nodes: The joints.
        frames: (joints + 1, 4) stored rotations of their parents, and of the last one, against what is above the first.
        turns: (joints, keys, 3) what each is turned by, axes against what is above the first · radians.
    """

    nodes: tuple[int, ...]
    frames: Floats
    turns: Floats

    @classmethod
    def of(cls, rig: Rig, node: int, turns: Floats) -> "_Chain":
        """One joint with (keys, 3) turns."""
        return cls(
            (node,), np.stack([[0.0, 0.0, 0.0, 1.0], unit_quaternions(rig.locals[node]["rotation"])]), turns[None]
        )

    def with_next(self, other: "_Chain") -> "_Chain":
        """The chain with a child of its last joint."""
        last = self.frames[-1]
        frames = np.concatenate([self.frames, quaternion_product(last[None], other.frames[1])])
        return _Chain(
            self.nodes + other.nodes, frames, np.concatenate([self.turns, turned_axis(last, other.turns[0])[None]])
        )

    @property
    def whole(self) -> Floats:
        """(keys, 3) what all are turned by together."""
        return np.asarray(self.turns.sum(axis=0))

    @property
    def shares(self) -> Floats:
        """(joints,) the part of the whole turn that each has."""
        whole = self.whole
        return np.asarray((self.turns * whole).sum(axis=(1, 2)) / max((whole**2).sum(), TINY))

    @property
    def is_one(self) -> bool:
        """True if all turn the same way, and what each turns by beside its share does not count."""
        whole, shares = self.whole, self.shares
        beside = np.linalg.norm(self.turns - shares[:, None, None] * whole, axis=2)
        farthest = np.linalg.norm(whole, axis=1).max()
        return bool((shares > _LEAST_SHARE).all() and beside.max() < _LEAST and farthest < np.radians(MOST_TURN))

    def turn(self, rig: Rig, axis: Floats, angles: Floats) -> Turn:
        """The turn by (steps,) angles about a (3,) unit axis."""
        joints = []
        for node, frame, share in zip(self.nodes, self.frames, self.shares.tolist(), strict=False):
            own = turned_axis(turned_back(frame), axis)
            stored = unit_quaternions(rig.locals[node]["rotation"])
            joints.append((JointAngle(node, int(rig.parents[node]), own, stored), share))
        signal = JointAngle(self.nodes[-1], int(rig.parents[self.nodes[0]]), axis, unit_quaternions(self.frames[-1]))
        return Turn(signal, angles, tuple(joints))


def _chains(rig: Rig, nodes: Sequence[int], shown: Floats, thickness: float) -> list[_Chain]:
    """Join nodes with (nodes, keys, 3) turns that turn as one and are near to each other, where none branches off."""
    chains = {node: _Chain.of(rig, node, turns) for node, turns in zip(nodes, shown, strict=True)}
    parents = [int(rig.parents[node]) for node in nodes]
    for node in sorted(nodes, key=lambda node: len(list(rig.upwards(node)))):
        above = int(rig.parents[node])
        if parents.count(above) == 1 and above in chains:
            joined = chains[above].with_next(chains[node])
            if np.linalg.norm(np.subtract(*stored_positions(rig, [above, node]))) < thickness and joined.is_one:
                chains.update(dict.fromkeys(joined.nodes, joined))
    return list(dict.fromkeys(chains.values()))


def _usual(ground: Ground, nodes: Sequence[int]) -> Floats:
    """(nodes, keys, 3) turns of nodes about each axis, both ways, as far as the range of motion: axes · radians."""
    usual = range_of_motion(ground.document, [ground.rig.node]).turns
    found = np.zeros((len(nodes), 3, 2, 3))
    for own, node in zip(found, nodes, strict=True):
        for row, (axis, ends) in zip(own, usual.get(node, ()), strict=False):
            row[:] = np.outer(ends, axis)
    return found.reshape(len(nodes), 6, 3)


def _farthest(vectors: Floats) -> Floats:
    """(axes, 3) unit axes of (2 axes, 3) turns both ways."""
    pairs = vectors.reshape(-1, 2, 3)
    farther = np.linalg.norm(pairs, axis=2).argmax(axis=1)
    return unit(pairs[np.arange(len(pairs)), farther])


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


def _are_told(shown: Floats) -> bool:
    """True if some of (nodes, keys, 3) turns in clips are so wide that clips tell how far joints turn."""
    return bool(np.linalg.norm(shown, axis=2).max(initial=0.0) >= np.radians(TELLING))


def _shown(rig: Rig, nodes: Sequence[int], clips: Sequence[Clip]) -> Floats:
    """(nodes, keys, 3) turns of nodes from their stored rotations, at all keys of any: axes by parents · radians."""
    found = [np.zeros((len(nodes), 1, 3))]
    for clip in clips:
        channels = [clip.channel(node, "rotation") for node in nodes]
        times = distinct_values(np.concatenate([np.zeros(0), *(each.times for each in channels if each is not None)]))
        turned = np.zeros((len(nodes), len(times), 3))
        for own, node, channel in zip(turned, nodes, channels, strict=True):
            if channel is not None:
                stored = turned_back(unit_quaternions(rig.locals[node]["rotation"]))
                turns = quaternion_product(sample(channel, times), stored)
                turns *= np.where(turns[:, 3:] < 0, -1.0, 1.0)
                halves = np.arctan2(np.linalg.norm(turns[:, :3], axis=1), turns[:, 3])
                own[:] = unit(turns[:, :3]) * (2.0 * halves)[:, None]
        found.append(turned)
    return np.concatenate(found, axis=1)


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
        posed = [_posed(turns, each) for each in angles]
        matrices = np.concatenate([joint_matrices(rig, clip, np.ones(1)) for clip in posed])
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


def _posed(turns: Sequence[Turn], angles: Floats) -> Clip:
    """A clip of a second, at whose end joints are turned by (turns,) angles, about one axis after the other."""
    channels: dict[int, Channel] = {}
    for turn, angle in zip(turns, angles.tolist(), strict=True):
        if angle:
            for made, (joint, _) in zip(turn.channels(angle), turn.joints, strict=True):
                before = channels.get(joint.node)
                if before is not None:
                    rest = turned_back(joint.rest)
                    turned = quaternion_product(quaternion_product(made.values[-1:], rest), before.values[-1])
                    made = replace(made, values=np.concatenate([made.values[:1], turned]))
                channels[joint.node] = made
    return motion_clip("", list(channels.values()))
