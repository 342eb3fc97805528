"""The motions of a range of motion that a body can make: a knee bends one way, a spine a little at each joint.

Both sides of a face move together, as nobody raises one brow alone for long.

Source: 38 CFR § 4.71, plates I and II, for the normal angles of knee, elbow, wrist and ankle. Other angles are smaller
than a body's, as far as rigs bend well; the joints of a spine share its angle, and those of a neck.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.bones import Bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Hierarchy, Rig
from wrinklecli.choices import Part
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.tools.mirror import split_side

# What is between the names of motions in the name of the one that joins them.
JOINED = " + "
# Least cosine of the bone and the axis of a turn that twists the bone.
_TWISTS = 0.87
# Least cosine of a direction and a motion that goes in that direction.
_SAME_WAY = 0.6
# Least angle of a motion that folds anything, degrees.
_LEAST_ANGLE = 10.0
# Least angle of a hinge in the stored pose that shows which way it bends, degrees.
_BENT_HINGE = 5.0


@dataclass(frozen=True, slots=True)
class _JointLimits:
    """Greatest angles of a joint, degrees.

    Attributes:
        forwards: Towards where the character looks, or for a hinge the way in which the stored pose bends it.
        backwards: The other way.
        aside: To either side, up and down.
        twist: About its bone.
        hinge: True if the joint bends about one axis.
    """

    forwards: float = 0.0
    backwards: float = 0.0
    aside: float = 0.0
    twist: float = 0.0
    hinge: bool = False


_SPINE = _JointLimits(25, 10, 15, 10)
# Limits by part of the body, for arms and legs that hang down or are spread out. Other parts stay as they are.
_LIMITS: Mapping[Part, _JointLimits] = {
    "toes": _JointLimits(30, 45, 30),
    "finger": _JointLimits(90, 90, 90, hinge=True),
    "palm": _JointLimits(10),
    "lower arm": _JointLimits(145, hinge=True),
    "lower leg": _JointLimits(backwards=140, hinge=True),
    "upper leg": _JointLimits(110, 20, 30, 20),
    "hand": _JointLimits(70, 70, 70),
    "spine": _SPINE,
    "hips": _SPINE,
    "upper arm": _JointLimits(90, 45, 90, 30),
}
LIMBS = frozenset(_LIMITS) - {"upper arm"}
"""Parts of a body whose joints fold what is around them.

Around others it slides, bulges or is stiff: of 64 places there that were judged by eye, twice each, 4 % of looks kept
one. An upper arm folds a garment, whose field is looked at.
"""


def limit_to_body(clips: Sequence[Clip], rig: Rig, bones: Bones) -> list[Clip]:
    """Limit motions to the angles that a body reaches, and raise morph targets of both sides together.

    Each clip turns one joint, or raises one morph target, evenly.
    """
    forwards = forwards_of(rig, bones)
    found = []
    for clip in clips:
        (channel, *others) = clip.channels
        if channel.path != "rotation" or others:
            continue
        end = _end(clip, channel.node, rig, bones.parts[channel.node], forwards)
        if end > clip.start:
            found.append(replace(clip, end=end))
    return [*found, *_expressions([clip for clip in clips if clip.channels[0].path == "weights"])]


def _end(clip: Clip, node: int, rig: Rig, part: Part | None, forwards: Floats) -> float:
    """The time at which a motion of a joint reaches the body's limit, seconds; its start if a body does not move so."""
    if part is None:
        return clip.end
    limits = _LIMITS.get(part, _JointLimits())
    (before, after), above, bone = _turned(clip, node, rig)
    turn = after @ np.linalg.inv(before)
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = float(np.degrees(np.arctan2(np.linalg.norm(axis) / 2.0, (np.trace(turn) - 1.0) / 2.0)))
    axis = unit(axis)
    # The direction in which the end of the bone moves.
    way = unit(np.cross(axis, bone))
    bent = limits.hinge and float(above @ bone) < np.cos(np.radians(_BENT_HINGE)) and above.any()
    if abs(float(axis @ bone)) > _TWISTS:
        most = limits.twist
    elif bent:
        most = max(limits.forwards, limits.backwards) if way @ unit(bone - above) > _SAME_WAY else 0.0
    else:
        ahead = float(way @ forwards)
        most = limits.forwards if ahead > _SAME_WAY else limits.backwards if ahead < -_SAME_WAY else limits.aside
    if most < _LEAST_ANGLE or angle <= 0.0:
        return clip.start
    return clip.start + (clip.end - clip.start) * min(1.0, most / angle)


def _turned(clip: Clip, node: int, rig: Rig) -> tuple[list[Floats], Floats, Floats]:
    """(3, 3) rotations of a joint before and after a motion; (3,) units along the bone that ends there and its own."""
    below = np.flatnonzero(rig.parents == node).tolist()
    parent = int(rig.parents[node])
    every = [node, *([parent] if parent >= 0 else [node]), *below]
    place, start, *ends = node_matrices(rig, None, np.zeros(1), every)[0, :, :3, 3]
    above = unit(place - start)
    bone = unit(np.mean(ends, axis=0) - place) if ends else above
    linear = node_matrices(rig, clip, np.array([clip.start, clip.end]), [node])[:, 0, :3, :3]
    scale = np.cbrt(np.abs(np.linalg.det(linear)))
    return list(linear / np.where(scale > 0, scale, 1.0)[:, None, None]), above, bone if bone.any() else above


def forwards_of(rig: Hierarchy, bones: Bones) -> Floats:
    """(3,) unit, the direction in which a character looks: along its feet, or as its file format says."""
    toes = [k for k, part in enumerate(bones.parts) if part == "toes" and rig.parents[k] >= 0]
    if toes:
        places = node_matrices(rig, None, np.zeros(1), [*toes, *(int(rig.parents[k]) for k in toes)])[0, :, :3, 3]
        along = (places[: len(toes)] - places[len(toes) :]).sum(axis=0) * [1.0, 0.0, 1.0]
        if along.any():
            return unit(along)
    return bones.ahead


def _expressions(clips: Sequence[Clip]) -> Iterator[Clip]:
    """Join clips that raise morph targets if their names differ by the side, or if all raise brows."""
    groups: dict[str, list[Clip]] = {}
    for clip in clips:
        raises = re.search("brow|brw", clip.name, re.IGNORECASE) and re.search("up|raise", clip.name, re.IGNORECASE)
        groups.setdefault("brows up" if raises else split_side(clip.name)[0], []).append(clip)
    for group in groups.values():
        first = group[0]
        channels = {channel.node: channel for channel in first.channels}
        for clip in group[1:]:
            for channel in clip.channels:
                known = channels.get(channel.node)
                added = channel.values - channel.values[:1]
                values = channel.values if known is None else known.values + added
                channels[channel.node] = replace(known or channel, values=values)
        name = JOINED.join(clip.name for clip in group)
        yield replace(first, name=name, channels=tuple(channels.values()))
