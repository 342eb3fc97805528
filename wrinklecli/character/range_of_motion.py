"""Range of motion: each joint of a character turned about its axes, each morph target raised, one at a time.

So riggers see how a character deforms; and it shows where one folds that has no clips.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.bent import bent_areas
from wrinklecli.character.bones import Bones, Part, read_bones
from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.motion import motion_clip, quaternion_product, raising, turned_axis, turning
from wrinklecli.character.rig import Rig, read_hierarchy, read_rig
from wrinklecli.errors import counted
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, unit, unit_quaternions

# Degrees that a joint bends to either side; those of the trunk and the jaw about as far as Unity lets its humanoids
# bend. What else hangs on the head are muscles, often with a pivot behind the eyes: 8° move skin by a centimetre.
_BEND, _TRUNK_BEND, _JAW_BEND, _FACE_BEND = 90.0, 45.0, 20.0, 8.0
_TRUNK: tuple[Part, ...] = ("hips", "spine", "chest", "neck", "head", "shoulder", "palm")
# Degrees at most that a joint turns about its own bone, as a forearm does: linear blend skinning wrings a limb that is
# twisted further.
_TWIST = 45.0
# Degrees that clips turn a joint before they tell how far it goes: an idle character breathes by less.
_TELLING = 30.0
# Degrees of a motion at least, and at most: a knee or an elbow.
_LEAST_TURN, _MOST_TURN = 5.0, 150.0
# Cosine of an axis and a bone above which a turn about the one twists the other: 30°.
_ALONG = 0.87
# Of joints' directions, which say where a bone points: length of their sum over the sum of their lengths.
_LEAST_AGREED = 0.5
# Part of the largest area below which nobody sees what a joint bends: some square millimetres of a person.
_LEAST_BENT = 1e-5
# Motions that show how a character moves, and how many of these are morph targets where it has joints too.
_TELLING_MOTIONS, _TELLING_MORPHS = 6, 2
# At most: a person with all fingers has 60 joints, a face of ARKit 52 morph targets.
_MOST_JOINTS, _MOST_MORPHS = 100, 200


@dataclass(frozen=True, slots=True)
class RangeOfMotion:
    """The motions of a character.

    Attributes:
        clips: Each of a second, from the stored pose to its end; the name says what it is.
        telling: Names of a few, of joints that bend most of it and of morph targets, that together show how it moves.
        summary: How many motions, of how many joints and morph targets, and how many are left out.
    """

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
    """Turn the joints that bend some meshes about their own axes, both ways, and raise the meshes' morph targets.

    A joint that the clips turn by 30° or more goes as far as they do, each way. Others bend by 90° and twist by 45°;
    those of the trunk bend by 45°, jaw and eyes by 20°, and others of a face by 8°.
    Left out are joints that bend nothing, as they carry all of a mesh, or a part that hangs on nothing else; those that
    are stored as a matrix; and, of more than 100, those that bend the least area.

    Args:
        document: The asset.
        nodes: With the meshes that are looked at, at least one.
        clips: All of the document.
        driven: By node, names of morph targets that are not raised.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    hierarchy = read_hierarchy(document)
    rigs = [read_rig(document, node, hierarchy) for node in nodes]
    areas, moved = bent_areas(document, rigs)
    bending = np.flatnonzero(areas > _LEAST_BENT * areas.max(initial=0.0))
    turnable = [int(node) for node in bending if "rotation" in hierarchy.locals[node]]
    joints = sorted(sorted(turnable, key=lambda node: -areas[node])[:_MOST_JOINTS])
    moving = _morph_targets(document, rigs, driven or {})
    morphs = list(moving)[:_MOST_MORPHS]
    bones = read_bones(document)
    made = [each for node in joints for each in _turns(rigs[0], node, bones, clips, moved > 0)]
    made += [(name, [raising(rig, dict.fromkeys(numbers, 1.0)) for rig, numbers in moving[name]]) for name in morphs]
    left_out = [
        counted(len(turnable) - len(joints), "joint") + " that bend less" if len(turnable) > len(joints) else "",
        counted(len(bending) - len(turnable), "joint") + " stored as a matrix" if len(bending) > len(turnable) else "",
        counted(len(moving) - len(morphs), "morph target") if len(moving) > len(morphs) else "",
    ]
    summary = (
        f"{counted(len(made), 'motion')} of {counted(len(joints), 'joint')} and {counted(len(morphs), 'morph target')}"
    )
    named = tuple(_named(made, {clip.name for clip in clips}, len(document.items("animations"))))
    return RangeOfMotion(
        named, _telling(named, areas), summary + "".join(f"; left out: {each}" for each in left_out if each)
    )


def _telling(clips: Sequence[Clip], areas: Floats) -> tuple[str, ...]:
    """The names of a few of the motions; `areas` are the (nodes,) that bend."""
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
    """Radians by which a joint turns from its first key to its last."""
    values = clip.channels[0].values
    return float(2.0 * np.arccos(min(abs(float(values[0] @ values[-1])), 1.0)))


def _named(made: Sequence[tuple[str, Sequence[Channel]]], taken: set[str], first: int) -> Iterator[Clip]:
    """Clips that follow a document's in number, those of a name that is taken told apart as `read_clips` does."""
    names = set(taken)
    for index, (name, channels) in enumerate(made, first):
        name = f"{name}#{index}" if name in names else name
        names.add(name)
        yield motion_clip(name, channels, index=index)


def _turns(
    rig: Rig, node: int, bones: Bones, clips: Sequence[Clip], carrying: Bools
) -> Iterator[tuple[str, list[Channel]]]:
    """The turns of a joint about its axes, each way; `carrying` are the (nodes,) that move something."""
    stored = unit_quaternions(rig.locals[node]["rotation"])
    bone = _bone(rig, node, carrying)
    shown, bend = _shown_turns(node, stored, clips), _usual_bend(rig, node, bones)
    for number, (axis, (least, most)) in enumerate(zip(np.eye(3), shown, strict=True)):
        extents = [-least, most]
        if max(-shown.min(), shown.max()) < _TELLING:
            extents = [min(bend, _TWIST) if abs(bone[number]) > _ALONG else bend] * 2
        for sign, extent in zip((-1.0, 1.0), extents, strict=True):
            if extent >= _LEAST_TURN:
                angle = sign * min(extent, _MOST_TURN)
                name = f"{rig.names[node]} about {'xyz'[number]}, {angle:+.0f}°"
                yield name, [turning(node, stored, turned_axis(stored, axis), np.radians(angle))]


def _usual_bend(rig: Rig, node: int, bones: Bones) -> float:
    """Degrees that a joint bends to either side, by the part of the body that it is and those above."""
    part, above = bones.parts[node], int(rig.parents[node])
    while above >= 0:
        if bones.parts[above] == "head":
            return _JAW_BEND if part in ("jaw", "eye") else _FACE_BEND
        above = int(rig.parents[above])
    return _TRUNK_BEND if part in _TRUNK else _BEND


def _shown_turns(node: int, stored: Floats, clips: Sequence[Clip]) -> Floats:
    """(3, 2) degrees that keys of clips turn a node about each of its own axes, from its stored rotation, each way."""
    extents = np.zeros((3, 2))
    for clip in clips:
        channel = clip.channel(node, "rotation")
        if channel is not None:
            keys = unit_quaternions(channel.points.T).T
            # The inverse of the turn that leads from the stored rotation to a key's, in the node's own space.
            back = quaternion_product(keys * [-1.0, -1.0, -1.0, 1.0], stored)
            turns = np.degrees(2.0 * np.arctan2(-back[:, :3], back[:, 3:]))
            turns -= 360.0 * np.round(turns / 360.0)
            extents[:, 0] = np.minimum(extents[:, 0], turns.min(axis=0))
            extents[:, 1] = np.maximum(extents[:, 1], turns.max(axis=0))
    return extents


def _bone(rig: Rig, node: int, carrying: Bools) -> Floats:
    """(3,) unit, where a joint's bone points in its own space: to the joints below, or on from above; 0 if unclear."""
    below = np.flatnonzero((rig.parents == node) & carrying)
    offsets = rig.rows[:, 3, below].T
    if not len(below):
        linear = rig.rows[:, :3, node]
        offsets = (np.linalg.pinv(linear) @ rig.rows[:, 3, node])[None]
    total = offsets.sum(axis=0)
    agreed = np.linalg.norm(total) >= _LEAST_AGREED * np.linalg.norm(offsets, axis=1).sum()
    return unit(total) if agreed else np.zeros(3)


def _morph_targets(
    document: Document, rigs: Sequence[Rig], driven: Mapping[int, Collection[str]]
) -> dict[str, list[tuple[Rig, list[int]]]]:
    """By name, the meshes with morph targets of that name that move something, and the numbers of these."""
    found: dict[str, list[tuple[Rig, list[int]]]] = {}
    moving: dict[int, set[int]] = {}
    for rig in rigs:
        if rig.mesh not in moving:
            moving[rig.mesh] = set(_moving_targets(document, rig.mesh))
        numbers: dict[str, list[int]] = {}
        for number, name in enumerate(rig.morph_names):
            numbers.setdefault(name, []).append(number)
        for name, own in numbers.items():
            if moving[rig.mesh].intersection(own) and name not in driven.get(rig.node, ()):
                found.setdefault(name, []).append((rig, own))
    return found


def _moving_targets(document: Document, mesh: int) -> Iterator[int]:
    """The numbers of a mesh's morph targets that move a vertex."""
    for primitive in document.items("meshes")[mesh].get("primitives", []):
        for number, target in enumerate(primitive.get("targets", [])):
            if "POSITION" in target and len(document.changes(target["POSITION"])[0]):
                yield number
