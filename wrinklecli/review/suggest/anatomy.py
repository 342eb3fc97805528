"""Which motions of a range of motion a body makes, and how far: a knee bends one way, a spine by little at each joint.

Sides of a face move together, as nobody raises one brow alone for long.

Source of the angles of knee, elbow, wrist and ankle: the normal ones of 38 CFR § 4.71, plates I and II. The others are
smaller than a body's, as far as rigs bend well; a spine's and a neck's are shared by the joints that rigs have there.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.bones import Bones, Part
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.tools.mirror import split_side

# Cosine of a turn's axis and the bone above which it twists, and of a motion and a direction for that to be its way.
_TWISTS, _THAT_WAY = 0.87, 0.6
# Degrees below which a motion folds nothing, and from which a hinge that is bent at rest shows which way it bends.
_LEAST, _BENT = 10.0, 5.0


@dataclass(frozen=True, slots=True)
class _Joint:
    """How far a joint bends, degrees.

    Attributes:
        forwards: To where the character looks; a hinge to where it is bent at rest already, if that shows.
        backwards: The other way.
        aside: To either side, up and down.
        twist: About its bone.
        hinge: Whether it bends about one axis.
    """

    forwards: float
    backwards: float
    aside: float
    twist: float
    hinge: bool = False


# By part of the body. Of arms and legs that hang or are spread out.
_JOINTS: Mapping[Part, _Joint] = {
    "toes": _Joint(30, 45, 30, 0),
    "finger": _Joint(90, 90, 90, 0, hinge=True),
    "palm": _Joint(10, 0, 0, 0),
    "lower arm": _Joint(145, 0, 0, 0, hinge=True),
    "lower leg": _Joint(0, 140, 0, 0, hinge=True),
    "upper leg": _Joint(110, 20, 30, 20),
    "shoulder": _Joint(15, 15, 25, 0),
    "upper arm": _Joint(90, 45, 90, 30),
    "hand": _Joint(70, 70, 70, 0),
    "foot": _Joint(45, 45, 45, 0),
    "neck": _Joint(30, 30, 25, 30),
    "head": _Joint(30, 30, 25, 30),
    "chest": _Joint(10, 10, 10, 10),
    "spine": _Joint(25, 10, 15, 10),
    "hips": _Joint(25, 10, 15, 10),
    "twist": _Joint(0, 0, 0, 0),
}


def believable(clips: Sequence[Clip], rig: Rig, bones: Bones) -> list[Clip]:
    """Motions of a range of motion, each only as far as a body goes; morph targets of two sides raised together.

    Args:
        clips: Each turns one joint, or raises one morph target, evenly.
        rig: With the joints.
        bones: Which these are.
    """
    forwards = _forwards(rig, bones)
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
    """When a motion of a joint has gone as far as a body's does, seconds; its start where that is nowhere."""
    joint = None if part is None else _JOINTS.get(part)
    if joint is None:
        return clip.end
    (before, after), above, bone = _turned(clip, node, rig)
    turn = after @ np.linalg.inv(before)
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = float(np.degrees(np.arctan2(np.linalg.norm(axis) / 2.0, (np.trace(turn) - 1.0) / 2.0)))
    axis = unit(axis)
    # Where the end of the bone goes.
    way = unit(np.cross(axis, bone))
    bent = joint.hinge and float(above @ bone) < np.cos(np.radians(_BENT)) and above.any()
    if abs(float(axis @ bone)) > _TWISTS:
        most = joint.twist
    elif bent:
        most = max(joint.forwards, joint.backwards) if way @ unit(bone - above) > _THAT_WAY else 0.0
    else:
        ahead = float(way @ forwards)
        most = joint.forwards if ahead > _THAT_WAY else joint.backwards if ahead < -_THAT_WAY else joint.aside
    if most < _LEAST or angle <= 0.0:
        return clip.start
    return clip.start + (clip.end - clip.start) * min(1.0, most / angle)


def _turned(clip: Clip, node: int, rig: Rig) -> tuple[list[Floats], Floats, Floats]:
    """(3, 3) rotations of a joint before and after a motion; (3,) unit, the bone that ends there, and its own one."""
    below = np.flatnonzero(rig.parents == node).tolist()
    parent = int(rig.parents[node])
    every = [node, *([parent] if parent >= 0 else [node]), *below]
    place, start, *ends = node_matrices(rig, None, np.zeros(1), every)[0, :, :3, 3]
    above = unit(place - start)
    bone = unit(np.mean(ends, axis=0) - place) if ends else above
    linear = node_matrices(rig, clip, np.array([clip.start, clip.end]), [node])[:, 0, :3, :3]
    scale = np.cbrt(np.abs(np.linalg.det(linear)))
    return list(linear / np.where(scale > 0, scale, 1.0)[:, None, None]), above, bone if bone.any() else above


def _forwards(rig: Rig, bones: Bones) -> Floats:
    """(3,) unit, where a character looks: along its feet, or as its file format says."""
    toes = [k for k, part in enumerate(bones.parts) if part == "toes" and rig.parents[k] >= 0]
    if toes:
        places = node_matrices(rig, None, np.zeros(1), [*toes, *(int(rig.parents[k]) for k in toes)])[0, :, :3, 3]
        along = (places[: len(toes)] - places[len(toes) :]).sum(axis=0) * [1.0, 0.0, 1.0]
        if along.any():
            return unit(along)
    return bones.ahead


def _expressions(clips: Sequence[Clip]) -> Iterator[Clip]:
    """Clips that raise morph targets, those that differ by the side or both raise brows joined into one."""
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
        name = " + ".join(clip.name for clip in group)
        yield replace(first, name=name, channels=tuple(channels.values()))
