"""Range of motion: each joint of a character turns about its axes, each morph target rises, one at a time.

Riggers see so how a character deforms, and `suggest` and fields where a character without clips folds. A joint of a
body turns as people do, whatever the axes of its bone: a knee bends back.

Source: 38 CFR § 4.71, plates I and II, for the normal angles of knee, elbow, wrist and ankle. Differs: angles are those
    of everyday motion, as far as rigs bend well; the joints of a spine share its angle, and those of a neck.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from wrinklecli.character.bent import bent_areas
from wrinklecli.character.bones import Bones, forwards_of, read_bones, words_of
from wrinklecli.character.clip import Channel, Clip, clip_name
from wrinklecli.character.motion import (
    MOST_TURN,
    motion_clip,
    quaternion_product,
    raising,
    turned_axis,
    turned_back,
    turning,
)
from wrinklecli.character.pose import node_matrices, stored_positions
from wrinklecli.character.rig import Rig, read_hierarchy, read_rig
from wrinklecli.choices import Part
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, unit, unit_quaternions


def _either(most: float) -> tuple[float, float]:
    """The least and the greatest degrees of a turn that goes as far to one side as to the other."""
    return -most, most


# Least and greatest degrees by which parts of a body turn ahead, aside, and about the bone.
_TRUNK = ((-15.0, 35.0), _either(20.0), _either(20.0))
_NECK = (_either(25.0), _either(20.0), _either(35.0))
_BODY: Mapping[Part | None, Sequence[tuple[float, float]]] = {
    "hips": _TRUNK,
    "spine": _TRUNK,
    "chest": _TRUNK,
    "neck": _NECK,
    "head": _NECK,
    "shoulder": (_either(15.0), _either(20.0)),
    "upper arm": ((-40.0, 80.0), _either(70.0), _either(40.0)),
    "lower arm": ((0.0, 125.0), _either(0.0), _either(45.0)),
    "hand": ((-30.0, 20.0), _either(70.0)),  # where arms are spread or hang, thumbs point ahead
    "palm": (_either(10.0), _either(10.0)),
    "upper leg": ((-25.0, 95.0), _either(30.0), _either(25.0)),
    "lower leg": ((-120.0, 0.0),),
    "foot": ((-45.0, 20.0), _either(20.0)),
    "toes": ((-30.0, 45.0),),
}
# Sine of the least angle between a bone and the way ahead at which it turns ahead. One that points ahead turns up.
_LEAST_ACROSS = 0.3
# Least angle by which a finger's bones turn along it in the stored pose, degrees, that shows which way it bends; it
# bends that way alone.
_BENT = 5.0
# Degrees by which other joints bend to either side,
_BEND = 90.0
# the jaw and the eyes, about as far as Unity lets its humanoids turn them,
_JAW_BEND = 20.0
# and other joints of a face, which are muscles, often with a pivot behind the eyes: 8° move skin by a centimetre.
_FACE_BEND = 8.0
# Most degrees by which a joint turns about its own bone, as a forearm does: linear blend skinning wrings a limb that is
# twisted further.
_TWIST = 45.0
# Clips show a joint's range if they turn it by this many degrees: an idle character breathes by less.
TELLING = 30.0
# Least degrees of a motion.
_LEAST_TURN = 5.0
# Cosine between an axis and a bone above which a turn about the axis twists the bone: 30°.
_ALONG = 0.87
# A bone's direction is clear if the sum of the offsets of the joints below is this long, relative to their lengths.
_LEAST_AGREED = 0.5
# A joint counts if it bends this fraction of the largest area: some square millimetres of a person.
_LEAST_BENT = 1e-5
# Number of motions that show how a character moves,
_TELLING_MOTIONS = 6
# and of morph targets among them if there are joints, too.
_TELLING_MORPHS = 2
# Most joints that move: a person with all fingers has 60.
_MOST_JOINTS = 100
# Parts of a rig that has a body's limbs: its other joints are skirts, straps, springs and helpers, which follow these.
_LIMBS: Collection[Part] = ("upper arm", "lower arm", "upper leg", "lower leg")
# Last words of joints that exporters put where a bone ends, such as `LeftToe_End` and `Bip01 L Toe0Nub`: no clip turns
# them, though skin may follow them.
_END = re.compile(r"\b(end|nub)$")
# Most morph targets that rise: a face of ARKit has 52.
_MOST_MORPHS = 200


# A turn of a joint: in words, about which axis in its parent's space, and both ends in degrees.
_Turn: TypeAlias = tuple[str, Floats, Sequence[float]]


@dataclass(frozen=True, slots=True)
class RangeOfMotion:
    """The motions of a character.

    Attributes:
        turns: By joint, the axes about which it turns, in its parent's space, and least and greatest radians.
        clips: Clips of a second, from the stored pose on, named for their motions.
        telling: Names of a few clips, of the joints that bend most and of morph targets, which show how it moves.
        summary: The numbers of motions, joints and morph targets, and of those that are left out.
    """

    turns: Mapping[int, Sequence[tuple[Floats, Floats]]]
    clips: tuple[Clip, ...]
    telling: tuple[str, ...]
    summary: str


def range_of_motion(
    document: Document,
    nodes: Sequence[int],
    clips: Sequence[Clip] = (),
    *,
    driven: Mapping[int, Collection[str]] | None = None,
) -> RangeOfMotion:
    """Turn the joints of some nodes' meshes, both ways, and raise the meshes' morph targets.

    A joint that the document's clips turn by 30° or more goes as far as in the clips, about its own axes. Joints of a
    body's trunk and limbs turn ahead, aside and about the bone as far as people's; an arm comes down beside the trunk,
    however it is stored. Others bend about their own axes by 90° and twist by 45°; jaw and eyes bend by 20°, and others
    of a face by 8°. Joints are left out if they bend nothing, since they move a whole mesh or a separate part of one,
    or if they are stored as a matrix. On a rig with arms and legs, those of no part of a body are left out, such as a
    skirt's. So are ends of bones, and joints with no joint above or below, as on a hand whose joints a headset poses:
    one alone would tear the skin from the others. If there are more than 100 others, those that bend the least area
    are. Morph targets named in `driven`, by node, are left out, too.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    hierarchy = read_hierarchy(document)
    rigs = [read_rig(document, node, hierarchy) for node in nodes]
    areas, moved = bent_areas(document, rigs)
    bending = np.flatnonzero(areas > _LEAST_BENT * areas.max(initial=0.0))
    turnable = [int(node) for node in bending if "rotation" in hierarchy.locals[node]]
    moving = _morph_targets(document, rigs, driven or {})
    morphs = list(moving)[:_MOST_MORPHS]
    bones = read_bones(document)
    forwards = forwards_of(hierarchy, bones)
    shown = [clip for clip in clips if clip.moves]
    together = _linked(rigs)
    linked = [node for node in turnable if node in together or _is_shown(rigs[0], node, shown)]
    of_body = [node for node in linked if _is_of_body(rigs[0], node, bones) or _is_shown(rigs[0], node, shown)]
    joints = sorted(sorted(of_body, key=lambda node: -areas[node])[:_MOST_JOINTS])
    turns = {node: _turns(rigs[0], node, bones, forwards, shown, moved > 0) for node in joints}
    made = [each for node in joints for each in _motions(rigs[0], node, turns[node])]
    made += [(name, [raising(rig, dict.fromkeys(numbers, 1.0)) for rig, numbers in moving[name]]) for name in morphs]
    left_out = [
        counted(len(of_body) - len(joints), "joint") + " that bend less" if len(of_body) > len(joints) else "",
        counted(len(linked) - len(of_body), "joint") + " beside the body" if len(linked) > len(of_body) else "",
        counted(len(turnable) - len(linked), "joint") + " with no joint above or below"
        if len(turnable) > len(linked)
        else "",
        counted(len(bending) - len(turnable), "joint") + " stored as a matrix" if len(bending) > len(turnable) else "",
        counted(len(moving) - len(morphs), "morph target") if len(moving) > len(morphs) else "",
    ]
    counts = {"joint": len(joints), "morph target": len(morphs)}
    of_what = " and ".join(counted(count, word) for word, count in counts.items() if count)
    summary = f"{counted(len(made), 'motion')} of {of_what or 'nothing'}"
    named = tuple(_named(made, {clip.name for clip in clips}, len(document.items("animations"))))
    return RangeOfMotion(
        {node: [(axis, np.radians(ends)) for _, axis, ends in of_joint] for node, of_joint in turns.items()},
        named,
        _telling(named, areas),
        "; left out: ".join(filter(None, [summary, ", ".join(filter(None, left_out))])),
    )


def _telling(clips: Sequence[Clip], areas: Floats) -> tuple[str, ...]:
    """Choose the names of a few motions, by the (nodes,) areas that the nodes bend."""
    widest: dict[int, Clip] = {}
    morphs = []
    for clip in clips:
        (node, path), *_ = clip.by_target
        if path == "weights":
            morphs.append(clip.name)
        elif node not in widest or _angle(clip) > 1.01 * _angle(widest[node]):
            widest[node] = clip
    joints = [widest[node].name for node in sorted(widest, key=lambda node: -areas[node])]
    room = max(_TELLING_MOTIONS - min(len(morphs), _TELLING_MORPHS), 0)
    first = [*joints[:room], *morphs]
    others = [clip.name for clip in clips if clip.name not in first]
    return tuple([*first, *others][:_TELLING_MOTIONS])


def _angle(clip: Clip) -> float:
    """Radians by which a joint turns from the first key to the last."""
    values = clip.channels[0].values
    return float(2.0 * np.arccos(min(abs(float(values[0] @ values[-1])), 1.0)))


def _named(made: Sequence[tuple[str, Sequence[Channel]]], taken: set[str], first: int) -> Iterator[Clip]:
    """Make clips with indices from `first` on; a name that is taken gets an index behind it, as in `read_clips`."""
    names = set(taken)
    for index, (name, channels) in enumerate(made, first):
        names.add(name := clip_name({"name": name}, index, names))
        yield motion_clip(name, channels, index=index)


def _linked(rigs: Sequence[Rig]) -> set[int]:
    """The nodes with a joint above and those with one below in the hierarchy, whatever nodes are between."""
    joints = {joint for rig in rigs for joint in rig.joints.tolist()}
    above = {joint: {*rigs[0].upwards(int(rigs[0].parents[joint]))} for joint in joints}
    return {joint for joint in joints if above[joint] & joints}.union(*above.values())


def _is_of_body(rig: Rig, node: int, bones: Bones) -> bool:
    """True if a joint moves a part of a body or face; all but the ends of bones do on rigs without limbs."""
    parts = bones.parts
    on_head = any(parts[above] == "head" for above in rig.upwards(node))
    known = parts[node] is not None or on_head or not {*_LIMBS} <= {*parts}
    return known and not _END.search(words_of(rig.names[node]))


def _is_shown(rig: Rig, node: int, clips: Sequence[Clip]) -> bool:
    """True if clips show how far a joint goes."""
    stored = unit_quaternions(rig.locals[node]["rotation"])
    return float(np.abs(_shown_turns(node, stored, clips)).max()) >= TELLING


def _turns(rig: Rig, node: int, bones: Bones, forwards: Floats, clips: Sequence[Clip], carrying: Bools) -> list[_Turn]:
    """The turns of a joint; `carrying` flags the (nodes,) that move something."""
    stored = unit_quaternions(rig.locals[node]["rotation"])
    bone, ends = _bone(rig, node, bones, carrying), _shown_turns(node, stored, clips)
    if max(-ends.min(), ends.max()) < TELLING:
        turns = list(_turns_of_body(rig, node, bones, bone, forwards))
        if turns:
            return turns
        bend = _usual_bend(rig, node, bones)
        most = np.where(np.abs(bone) > _ALONG, min(bend, _TWIST), bend)
        ends = np.stack([-most, most], axis=1)
    own = [turned_axis(stored, axis) for axis in np.eye(3)]
    return [(f"about {name}", *each) for name, *each in zip("xyz", own, ends.tolist(), strict=True)]


def _motions(rig: Rig, node: int, turns: Sequence[_Turn]) -> Iterator[tuple[str, list[Channel]]]:
    """Make the motions of a joint by its turns, each way."""
    stored = unit_quaternions(rig.locals[node]["rotation"])
    for way, axis, ends in turns:
        for angle in ends:
            if abs(angle) >= _LEAST_TURN:
                angle = float(np.clip(angle, -MOST_TURN, MOST_TURN))
                yield f"{rig.names[node]} {way}, {angle:+.0f}°", [turning(node, stored, axis, np.radians(angle))]


def _turns_of_body(rig: Rig, node: int, bones: Bones, bone: Floats, forwards: Floats) -> Iterator[_Turn]:
    """The turns of a part of a body.

    There are none if the part has no usual turns, or if its `bone`, a (3,) direction in its space, is unclear.
    """
    parent, part = int(rig.parents[node]), bones.parts[node]
    own, over = node_matrices(rig, None, np.zeros(1), [node, node if parent < 0 else parent])[0]
    along = unit(own[:3, :3] @ bone)
    if not along.any():
        return
    into = np.eye(3) if parent < 0 else np.linalg.pinv(over[:3, :3])
    curl = _curl(rig, node, bones) if part == "finger" else np.zeros(3)
    if np.linalg.norm(curl) > np.sin(np.radians(_BENT)):
        yield "bent", unit(into @ curl), (0.0, _BEND)
        return
    swing, way = np.cross(along, forwards), "ahead"
    if np.linalg.norm(swing) < _LEAST_ACROSS:
        swing, way = np.cross(along, [0.0, 1.0, 0.0]), "up"
    swing = unit(swing)
    axes = swing, np.cross(along, swing), along
    for word, axis, ends in zip((way, "aside", "twisted"), axes, _BODY.get(part, ()), strict=False):
        if (part, word) == ("upper arm", "aside"):
            # A spread arm comes down beside the trunk, so one that hangs already has as much less room below.
            raised = np.degrees(np.arctan2(along[1], np.hypot(along[0], along[2])))
            room = float(np.clip(ends[1] + raised, 0.0, ends[1]))
            ends = (ends[0], room) if swing[1] < 0 else (-room, ends[1])
        yield word, unit(into @ axis), ends


def _curl(rig: Rig, node: int, bones: Bones) -> Floats:
    """(3,) axis about which the bones of a finger turn along it in the stored pose, as long as the sines; world space.

    The bone of the palm above it counts where the finger has one bone alone: others spread from the palm's.
    """
    finger = [node]
    while (above := int(rig.parents[finger[0]])) >= 0 and bones.parts[above] == "finger":
        finger.insert(0, above)
    while len(below := np.flatnonzero(rig.parents == finger[-1])) == 1:
        finger.append(int(below[0]))
    if len(finger) < 3 and above >= 0:
        finger.insert(0, above)
    along = unit(np.diff(stored_positions(rig, finger), axis=0))
    return np.asarray(np.cross(along[:-1], along[1:]).sum(axis=0))


def _usual_bend(rig: Rig, node: int, bones: Bones) -> float:
    """Degrees by which a joint bends to either side, depending on its part of the body and the parts above."""
    if not any(bones.parts[above] == "head" for above in rig.upwards(int(rig.parents[node]))):
        return _BEND
    return _JAW_BEND if bones.parts[node] in ("jaw", "eye") else _FACE_BEND


def _shown_turns(node: int, stored: Floats, clips: Sequence[Clip]) -> Floats:
    """(3, 2) least and greatest degrees by which keys turn a node about its own axes, from its stored rotation."""
    extents = np.zeros((3, 2))
    for clip in clips:
        channel = clip.channel(node, "rotation")
        if channel is not None:
            keys = unit_quaternions(channel.points.T).T
            # `back` is the inverse of the turn from the stored rotation to a key's, in the node's own space.
            back = quaternion_product(turned_back(keys), stored)
            turns = np.degrees(2.0 * np.arctan2(-back[:, :3], back[:, 3:]))
            turns -= 360.0 * np.round(turns / 360.0)
            extents[:, 0] = np.minimum(extents[:, 0], turns.min(axis=0))
            extents[:, 1] = np.maximum(extents[:, 1], turns.max(axis=0))
    return extents


def _bone(rig: Rig, node: int, bones: Bones, carrying: Bools) -> Floats:
    """(3,) unit direction of a joint's bone, to the joints below or from the parent, in its space; 0 if unclear.

    Joints below of a body's parts count before others, such as a skirt's. Where they lie on all sides, those of the
    joint's own part count: a biped's legs hang from its spine.
    """
    below = np.flatnonzero((rig.parents == node) & carrying)
    if not len(below):
        linear = rig.rows[:, :3, node]
        return unit(np.linalg.pinv(linear) @ rig.rows[:, 3, node])
    known = [each for each in below if bones.parts[each]] or below
    own = [each for each in below if bones.parts[each] == bones.parts[node]]
    for some in (known, own):
        offsets = rig.rows[:, 3, some].T
        total = offsets.sum(axis=0)
        if np.linalg.norm(total) >= _LEAST_AGREED * np.linalg.norm(offsets, axis=1).sum():
            return unit(total)
    return np.zeros(3)


def _morph_targets(
    document: Document, rigs: Sequence[Rig], driven: Mapping[int, Collection[str]]
) -> dict[str, list[tuple[Rig, list[int]]]]:
    """Find, by name, the rigs with morph targets that move something, and the indices of these targets."""
    found: dict[str, list[tuple[Rig, list[int]]]] = {}
    moving = {mesh: set(_moving_targets(document, mesh)) for mesh in {rig.mesh for rig in rigs}}
    for rig in rigs:
        numbers: dict[str, list[int]] = {}
        for number, name in enumerate(rig.morph_names):
            numbers.setdefault(name, []).append(number)
        for name, own in numbers.items():
            if moving[rig.mesh].intersection(own) and name not in driven.get(rig.node, ()):
                found.setdefault(name, []).append((rig, own))
    return found


def _moving_targets(document: Document, mesh: int) -> Iterator[int]:
    """Give the indices of a mesh's morph targets that move a vertex."""
    for primitive in document.items("meshes")[mesh].get("primitives", []):
        for number, target in enumerate(primitive.get("targets", [])):
            if "POSITION" in target and len(document.changes(target["POSITION"])[0]):
                yield number
