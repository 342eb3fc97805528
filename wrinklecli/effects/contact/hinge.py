"""Hinges: the joint between the ends of some tools, the axis about which it folds them, and its range.

A hinge follows from the tools and the rest pose alone, since the shapes of a fold must not depend on the clips that
there are. Not in the paper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import motion_clip, turned_axis, turning
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.choices import Part
from wrinklecli.drive.angle import Angles, JointAngle
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, cross, unit, unit_quaternions

_STIFF: tuple[Part, ...] = ("foot", "toes", "neck", "head", "spine", "chest", "shoulder")
# Greatest turn of a joint from its stored pose, degrees: about as far as people bend it.
_FARTHEST: Mapping[Part, float] = {
    "lower arm": 125.0,
    "lower leg": 115.0,
    "finger": 95.0,
    "hand": 70.0,
    **dict.fromkeys(_STIFF, 60.0),
}
# Other joints turn as far as a hip, degrees.
_FARTHEST_OTHER = 105.0
# Turn beyond the angle at which a tool's ends are nearest, radians. The fold is closed there; only clips that press a
# limb into itself turn further, as a deep squat does.
_BEYOND_NEAREST = np.radians(30.0)
# Poses in which the distance of a tool's ends is measured, about 2° apart,
_POSES = 61
# and index of the pose that shows which way the ends come together.
_EARLY_POSE = 5
STRIDE = float(np.radians(4.0))
"""Greatest step between two poses of a sweep, radians: with longer ones a fold that closes fast takes several times the
solver's steps."""
# An axis of the joint's own replaces a guess that is nearer than this, radians: riggers orient joints so that knees,
# elbows and fingers turn about one of their axes, and clips do. The guess is 5 to 15° off on common rigs.
_OWN_AXIS = np.radians(20.0)


@dataclass(frozen=True, slots=True)
class Hinge:
    """A joint that turns about one axis.

    Attributes:
        signal: The joint's angle about the axis.
        least: Greatest turn one way, radians, 0 or less,
        most: and the other way, 0 or more.
    """

    signal: JointAngle
    least: float
    most: float

    @property
    def sweeps(self) -> list[tuple[Clip, Floats]]:
        """The turns one or both ways, each as a clip of a second that no file has, and (poses,) seconds of it."""
        ends = [end for end in (self.least, self.most) if end]
        ways = [np.linspace(0.0, end, int(np.ceil(abs(end) / STRIDE)) + 1) for end in ends]
        return [(self.turn(way), np.linspace(0.0, 1.0, len(way))) for way in ways]

    def reading(self, rig: Rig, clip: Clip, times: Floats) -> Angles:
        """The measurements at (frames,) seconds of a clip by which weights are looked up."""
        return self.signal.angles(rig, clip, times)

    def strides(self, rig: Rig, clip: Clip, times: Floats) -> Floats:
        """(frames,) angles at (frames,) seconds of a clip, in strides."""
        return np.asarray(self.reading(rig, clip, times).rows / STRIDE)

    def turn(self, angles: Floats) -> Clip:
        """A clip of a second through (keys,) evenly spaced radians from the stored rotation, less than 180° apart."""
        times = np.linspace(0.0, 1.0, len(angles))
        greatest = float(np.abs(angles).max()) or 1.0
        channel = turning(self.signal.node, self.signal.rest, self.signal.axis, greatest, angles / greatest)
        return motion_clip("", [replace(channel, times=times)])


def hinge_of(node: int, patches: Sequence[Patch], pivot: Floats, rig: Rig, part: Part | None = None) -> Hinge:
    """Find the axis and range of a joint that brings the ends of some tools together.

    The axis is first guessed for each tool, from the axis about which a turn brings its ends together fastest, and from
    the patch's v axis, along which wrinkles run. Tools count by their areas. If one of the joint's own axes is near, it
    replaces the guess. All axes count as one, whichever way each tool closes.

    `pivot` is the (3,) place of the joint at rest, world space; `part` limits the turn.
    """
    stored = unit_quaternions(rig.locals[node]["rotation"])
    parent = int(rig.parents[node])
    world = np.eye(4) if parent < 0 else node_matrices(rig, None, np.zeros(1), [parent])[0, 0]
    # The axis in the parent's space that the parent takes to the wanted one.
    axes = [unit(np.linalg.pinv(world[:3, :3]) @ _folding_axis(patch, pivot)) for patch in patches]
    # A small tool that slants to break the evenness of a large one hardly turns the axis.
    areas = [patch.span * patch.half_width for patch in patches]
    signed = [axis if axis @ axes[0] >= 0 else -axis for axis in axes]
    axis = _of_joint(unit(np.average(signed, axis=0, weights=areas)), stored)
    still = Hinge(JointAngle(node, parent, axis, stored), 0.0, 0.0)
    most = float(np.radians(_FARTHEST_OTHER if part is None else _FARTHEST.get(part, _FARTHEST_OTHER)))
    ends = [_end(still, most, patch, rig) for patch in patches]
    return replace(still, least=min(0.0, *ends), most=max(0.0, *ends))


def _of_joint(axis: Floats, stored: Floats) -> Floats:
    """(3,) own axis of a joint with a stored (4,) rotation nearest to a (3,) axis, or this one if all are far."""
    own = np.stack([turned_axis(stored, each) for each in np.eye(3)])
    cosines = own @ axis
    nearest = int(np.argmax(np.abs(cosines)))
    return own[nearest] * np.sign(cosines[nearest]) if abs(cosines[nearest]) > np.cos(_OWN_AXIS) else axis


def _folding_axis(patch: Patch, pivot: Floats) -> Floats:
    """(3,) unit axis, world space at rest, about which a turn one way or the other brings a tool's ends together."""
    across = np.stack(cross(patch.along, patch.normal))
    fastest = unit(np.cross(patch.target.position - pivot, patch.along))
    return unit(fastest + (across if across @ fastest >= 0 else -across))


def _end(hinge: Hinge, most: float, patch: Patch, rig: Rig) -> float:
    """Greatest turn of a hinge that folds a tool, radians, the way that brings the tool's ends together at first."""
    angles, times = np.linspace(0.0, most, _POSES), np.linspace(0.0, 1.0, _POSES)
    ways = [(sign, patch.segment.lengths(rig, hinge.turn(sign * angles), times)[0]) for sign in (1.0, -1.0)]
    sign, lengths = min(ways, key=lambda way: way[1][_EARLY_POSE])
    return float(sign * min(angles[np.argmin(lengths)] + _BEYOND_NEAREST, most))
