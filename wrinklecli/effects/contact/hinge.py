"""Hinges: the joint between the ends of some tools, the axis about which it folds them, and how far.

All of it follows from the tools and the rest pose alone: what a fold needs must not hang on the clips that there are.
Not in the paper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.bones import Part
from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import motion_clip, turned_axis, turning
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.drive.angle import JointAngle
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats, cross, unit, unit_quaternions

# Degrees that a joint turns at most, from its stored pose: about as far as people bend it, and others as far as a hip.
_FARTHEST: Mapping[Part, float] = {
    "lower arm": 125.0,
    "lower leg": 115.0,
    "finger": 95.0,
    "hand": 70.0,
    "foot": 60.0,
    "toes": 60.0,
    "neck": 60.0,
    "head": 60.0,
    "spine": 60.0,
    "chest": 60.0,
    "shoulder": 60.0,
}
_OTHERS = 105.0
# Radians that it turns on from where a tool's ends are nearest. Beyond the fold is closed: what is left of the way are
# clips that press a limb into itself, as a deep squat does.
_ON = np.radians(30.0)
# Poses in which the ends of tools are looked at: about 2° from one to the next.
_LOOKS = 61
# The one that tells which way they come together.
_FIRST = 5
# Radians between two poses of a sweep, at most: further apart, what closes fast needs several times the steps.
_STRIDE = np.radians(4.0)
# Radians within which the axis is taken for the nearest one of the joint's own: riggers orient joints so that knees,
# elbows and fingers turn about one of these, and clips do. The patch's own guess is 5 to 15° off on common rigs.
_OWN = np.radians(20.0)
# How far the axis leans, to no side and to four: a clip's joint seldom turns about one axis alone.
_LEANINGS = np.tan(np.radians(10.0)) * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


@dataclass(frozen=True, slots=True)
class Hinge:
    """A joint that turns about one axis.

    Attributes:
        signal: The joint's angle about the axis.
        least: Radians that it turns by at most one way, 0 or less,
        most: and the other way, 0 or more.
    """

    signal: JointAngle
    least: float
    most: float

    @property
    def ends(self) -> tuple[float, ...]:
        """Radians that it turns to, one way or both."""
        return tuple(end for end in (self.least, self.most) if end)

    @property
    def leanings(self) -> Floats:
        """(leanings, 2) tilts of the axis with which it is looked at, the first none."""
        return np.asarray(_LEANINGS)

    @property
    def stride(self) -> float:
        """Radians between two poses, at most."""
        return float(_STRIDE)

    def rows(self, angles: Floats) -> Floats:
        """(rows,) what weights at (rows,) radians are looked up by: these."""
        return angles

    def rows_in(self, rig: Rig, clip: Clip, times: Floats) -> Floats:
        """(frames,) what weights are looked up by at (frames,) seconds of a clip: the angles there."""
        return self.signal.angles(rig, clip, times).rows

    def strides(self, rig: Rig, clip: Clip, times: Floats) -> Floats:
        """(frames,) how far it is at (frames,) seconds of a clip, in strides."""
        return np.asarray(self.rows_in(rig, clip, times) / _STRIDE)

    def turn(self, angles: Floats, *, tilt: Floats | None = None) -> Clip:
        """A clip of a second through (keys,) evenly spaced radians, each less than 180° from the one before.

        Args:
            angles: From the stored rotation.
            tilt: (2,) by how much the axis leans to two sides, tangents of angles; not at all where left out.
        """
        axis = self.signal.axis if tilt is None else unit(self.signal.axis + tilt @ _across(self.signal.axis))
        times = np.linspace(0.0, 1.0, len(angles))
        greatest = float(np.abs(angles).max()) or 1.0
        channel = turning(self.signal.node, self.signal.rest, axis, greatest, angles / greatest)
        return motion_clip("", [replace(channel, times=times)])


def hinge_of(node: int, patches: Sequence[Patch], pivot: Floats, rig: Rig, part: Part | None = None) -> Hinge:
    """The hinge that a joint is to the tools whose ends it brings together.

    Its axis is the joint's own one that is nearest to a guess, where one is near: the mean of two for each tool, which
    count by its area, the one about which a turn brings its ends together fastest, and the patch's v axis, along which
    wrinkles run.

    Args:
        node: The joint.
        patches: The tools, at least one; their axes are taken for one, whichever way each closes.
        pivot: (3,) where the joint is at rest, world space.
        rig: The joints.
        part: Of a body that the joint moves, which tells how far it turns; None where that is unknown.
    """
    stored = unit_quaternions(rig.locals[node]["rotation"])
    parent = int(rig.parents[node])
    world = np.eye(4) if parent < 0 else node_matrices(rig, None, np.zeros(1), [parent])[0, 0]
    # A turn in the parent's space about what the parent takes to the axis.
    axes = [unit(np.linalg.pinv(world[:3, :3]) @ _folding_axis(patch, pivot)) for patch in patches]
    # A small tool that slants to break the evenness of a large one hardly turns the axis.
    areas = [patch.span * patch.half_width for patch in patches]
    signed = [axis if axis @ axes[0] >= 0 else -axis for axis in axes]
    axis = _of_joint(unit(np.average(signed, axis=0, weights=areas)), stored)
    still = Hinge(JointAngle(node, parent, axis, stored), 0.0, 0.0)
    most = float(np.radians(_OTHERS if part is None else _FARTHEST.get(part, _OTHERS)))
    ends = [_end(still, most, patch, rig) for patch in patches]
    return replace(still, least=min(0.0, *ends), most=max(0.0, *ends))


def _of_joint(axis: Floats, stored: Floats) -> Floats:
    """(3,) the nearest axis of a joint with a stored (4,) rotation, in its parent's space; a (3,) axis far from all."""
    own = np.stack([turned_axis(stored, each) for each in np.eye(3)])
    shares = own @ axis
    nearest = int(np.argmax(np.abs(shares)))
    return own[nearest] * np.sign(shares[nearest]) if abs(shares[nearest]) > np.cos(_OWN) else axis


def _folding_axis(patch: Patch, pivot: Floats) -> Floats:
    """(3,) unit, world space at rest: turns about it, one way or the other, bring a tool's ends together."""
    across = np.stack(cross(patch.along, patch.normal))
    fastest = unit(np.cross(patch.target.position - pivot, patch.along))
    return unit(fastest + (across if across @ fastest >= 0 else -across))


def _end(hinge: Hinge, most: float, patch: Patch, rig: Rig) -> float:
    """Radians by which a hinge turns at most to fold a tool, the way that brings its ends together at first."""
    angles, times = np.linspace(0.0, most, _LOOKS), np.linspace(0.0, 1.0, _LOOKS)
    ways = [(sign, patch.segment.lengths(rig, hinge.turn(sign * angles), times)[0]) for sign in (1.0, -1.0)]
    sign, lengths = min(ways, key=lambda way: way[1][_FIRST])
    return float(sign * min(angles[np.argmin(lengths)] + _ON, most))


def _across(axis: Floats) -> Floats:
    """(2, 3) unit, across an axis and each other."""
    first = unit(np.stack(cross(axis, np.eye(3)[np.argmin(np.abs(axis))])))
    return np.stack([first, np.stack(cross(axis, first))])
