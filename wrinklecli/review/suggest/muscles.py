"""Muscles suggested by the names of bones: where they are on a human, in proportion to each limb.

They are guesses, as a rig says where bones are and no more, and the file says that they were guessed. Clips say how far
each bulges, and one that no clip moves is left out.

Source of the places: H. Gray, *Anatomy of the Human Body*, on origins and insertions, simplified to straight segments
along one bone; ends are ratios of the bones' lengths.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from wrinklecli.character.bones import Bones, forwards_of, read_bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import Hierarchy, read_hierarchy
from wrinklecli.choices import Part
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.review.suggest.moves import STILL, Move, greatest_moves, move_of
from wrinklecli.review.suggest.text import entry, quoted
from wrinklecli.surface.bones import BoneLines, SideOfBone
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.rest import asked_positions
from wrinklecli.tools.body import TENDONS, THICKNESS, Muscle
from wrinklecli.tools.mirror import exchange_sides, split_side
from wrinklecli.tools.records import JointPoint, Length, Position, ToolsFile, parse_length
from wrinklecli.tools.yaml_tree import printable

# Distance of a muscle's line from its bone, over that of the skin: the middle of the flesh.
_DEEP = 0.45
# The same over the bone's length, while the skin's distance is not known.
_FIRST = 0.05
# Skin weight of a bone on a mesh, over that on the mesh that has most of it, from which on the mesh is a layer round
# the bone: a sleeve has about as much as the arm below it, a glove's cuff a tenth.
_LAYER = 0.3
# Angle of a joint in the stored pose that shows which way it bends, radians: 5°.
_BENT = np.radians(5.0)
# Difference of mirrored joints over the body's size below which a body is symmetric about x = 0.
_SYMMETRIC = 0.01

_Side = Literal["inside", "outside"]


@dataclass(frozen=True, slots=True)
class _Place:
    """The place of a muscle on a limb.

    Attributes:
        limb: The limb, a key of `_LIMBS`.
        bone: The number of the limb's bone along which the muscle lies, 0 or 1.
        side: The inside of the joint below that bone, to which it bends, or the outside.
        begin: Distance of the origin from the bone's own joint, over the bone's length.
        end: Distance of the insertion beyond the joint below, over the next bone's length, negative on this side of it.
        tendons: Per cent of the muscle that both tendons take together; None for the usual ones.
    """

    limb: Literal["arm", "leg"]
    bone: int
    side: _Side
    begin: float
    end: float
    tendons: float | None = None


# The parts of each limb from its root on, and the way that its two lower joints bend on a human.
_LIMBS: Mapping[str, tuple[Part, Part, Part]] = {
    "arm": ("upper arm", "lower arm", "hand"),
    "leg": ("upper leg", "lower leg", "foot"),
}
_MUSCLES: Mapping[str, _Place] = {
    "biceps": _Place("arm", 0, "inside", 0.06, 0.14),
    "triceps": _Place("arm", 0, "outside", 0.10, 0.02),
    "forearm_flexors": _Place("arm", 1, "inside", 0.05, 0.15),
    "quadriceps": _Place("leg", 0, "outside", 0.12, 0.08),
    # Their bellies begin below the buttock: from 0.12 on, with usual tendons, they leave a hollow there, 5 mm deep.
    "hamstrings": _Place("leg", 0, "inside", 0.04, 0.10, 20.0),
    "calf": _Place("leg", 1, "outside", 0.04, 0.10),
}


@dataclass(frozen=True, slots=True)
class SuggestedMuscle:
    """A muscle that is guessed, and its entry in a tools file.

    Attributes:
        muscle: The muscle; its side is the left one if `mirrored`.
        mirrored: True if the other side has the same.
        bone: The name of the bone that it lies along.
        depth: Distance from that bone to the skin above, scene units.
        move: What the clips do to it, or to its mirror image if they move that more.
    """

    muscle: Muscle
    mirrored: bool
    bone: str
    depth: float
    move: Move

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints that carry its origin and its insertion."""
        return tuple(each.joint for each in self.muscle.points if isinstance(each, JointPoint))

    @property
    def offsets(self) -> tuple[Position, ...]:
        """The offsets of its origin and its insertion from these joints."""
        return tuple(each.offset for each in self.muscle.points if isinstance(each, JointPoint))


@dataclass(frozen=True, slots=True)
class _Limb:
    """A limb: its joints, with places in the stored pose, and the direction in which each of two joints bends.

    Attributes:
        joints: Nodes of the two bones and of what is below them.
        places: (3, 3) their places.
        bends: (2, 3) unit directions across each bone towards which the joint below it bends.
        letter: L or R.
    """

    kind: str
    joints: tuple[int, int, int]
    places: Floats
    bends: Floats
    letter: str


def suggest_muscles(
    document: Document, nodes: Mapping[int, str | None], clips: tuple[Clip, ...], *, fps: float
) -> tuple[list[SuggestedMuscle], list[str], str]:
    """Suggest muscles where the rig names the bones of arms and legs, and clips move them.

    Args:
        document: The asset.
        nodes: Nodes whose meshes deform, each with the name that a file must give; None if it need not.
        clips: Motions of the asset; without any, muscles that nothing moves are suggested too.
        fps: Frames a second at which these are looked at.

    Returns:
        The muscles, a line for each that fits no mesh or is still, and why there are none.
    """
    hierarchy, bones = read_hierarchy(document), read_bones(document)
    limbs = _limbs(hierarchy, bones)
    if not limbs:
        wanted = "upper arm and lower arm, or upper leg and lower leg, with a hand or a foot below"
        return [], [], f"no joints are named as {wanted}"
    settings, neighbours = ToolsFile(path=document.path), Neighbours(document)
    grounds = [read_ground(document, node, [], settings, clips, neighbours=neighbours) for node in nodes]
    found, notes = [], []
    lefts = {limb.kind: limb for limb in limbs if limb.letter == "L"}
    twins = {limb.kind for limb in limbs if limb.letter == "R" and limb.kind in lefts}
    twins = {kind for kind in twins if _mirrored(lefts[kind], limbs, hierarchy)}
    fitted: list[tuple[SuggestedMuscle, Ground, AnyAttached, _Limb]] = []
    for name, place in _MUSCLES.items():
        for limb in (each for each in limbs if each.kind == place.limb):
            one = _fitted(f"{name}.{limb.letter}", place, limb, grounds, nodes, hierarchy.names)
            if not isinstance(one, str):
                fitted.append((*one, limb))
            elif limb.letter == "L" or limb.kind not in twins:
                notes.append(one)
    moves = greatest_moves([(ground, attached) for _, ground, attached, _ in fitted], clips, fps=fps)
    for each, _, _, limb in fitted:
        paired = limb.kind in twins
        move = move_of(each.muscle.name, moves, mirrored=paired)
        if clips and move is STILL:
            notes += [f"{each.muscle.name}: left out, as no clip changes its length"] * (
                not paired or limb.letter == "L"
            )
        elif not paired or limb.letter == "L":
            found.append(replace(each, mirrored=paired, move=move))
    reason = "no mesh has skin around the bones of arms and legs, or no clip bends these"
    return found, notes, "" if found else reason


def _limbs(hierarchy: Hierarchy, bones: Bones) -> list[_Limb]:
    """The arms and legs of a rig, left ones first."""
    found = []
    forwards = forwards_of(hierarchy, bones)
    aside = np.cross([0.0, 1.0, 0.0], forwards)  # to the character's left
    for kind, (upper, lower, end) in _LIMBS.items():
        for node, part in enumerate(bones.parts):
            above = _above(hierarchy, bones, node, upper)
            if part != lower or above is None or _above(hierarchy, bones, node, lower) is not None:
                continue
            below = next(
                (k for k, each in enumerate(bones.parts) if each == end and _above(hierarchy, bones, k, lower) == node),
                None,
            )
            if below is None:
                continue
            joints = above, node, below
            places = stored_positions(hierarchy, joints)
            left = float((places[1] - places[0]) @ aside)
            if kind == "leg":  # legs hang down, and their sides are those of their joints
                left = float((places[0] - _middle(hierarchy, bones, upper)) @ aside)
            bends = _bends(kind, places, forwards, left >= 0)
            letter = split_side(hierarchy.names[node])[1] or ("L" if left >= 0 else "R")
            found.append(_Limb(kind, joints, places, bends, letter))
    return sorted(found, key=lambda limb: limb.letter)


def _above(hierarchy: Hierarchy, bones: Bones, node: int, part: Part) -> int | None:
    """The nearest node above a node that is a part of the body."""
    node = int(hierarchy.parents[node])
    while node >= 0 and bones.parts[node] != part:
        node = int(hierarchy.parents[node])
    return node if node >= 0 else None


def _middle(hierarchy: Hierarchy, bones: Bones, part: Part) -> Floats:
    """(3,) the mean place of the joints of a part."""
    joints = [k for k, each in enumerate(bones.parts) if each == part]
    return np.asarray(stored_positions(hierarchy, joints).mean(axis=0))


def _bends(kind: str, places: Floats, forwards: Floats, left: bool) -> Floats:
    """(2, 3) directions across both bones of a limb towards which the joint below each bends.

    An elbow bends forwards and a knee backwards, unless the stored pose shows another way. A wrist bends to the palm,
    which looks down where arms are spread, and an ankle bends upwards.
    """
    upper, lower = unit(places[1] - places[0]), unit(places[2] - places[1])
    hinge = lower - upper * float(upper @ lower)
    if np.linalg.norm(hinge) < np.sin(_BENT):
        hinge = forwards if kind == "arm" else -forwards
    palm = np.cross(lower, forwards) if left else np.cross(forwards, lower)
    end = palm if kind == "arm" else forwards
    across = [each - bone * float(bone @ each) for each, bone in ((hinge, upper), (end, lower))]
    return np.array([unit(each) for each in across])


def _mirrored(left: _Limb, limbs: Sequence[_Limb], hierarchy: Hierarchy) -> bool:
    """True if a limb has a mirror image about x = 0, with joints of mirrored names."""
    right = next(limb for limb in limbs if limb.kind == left.kind and limb.letter == "R")
    names = [[hierarchy.names[joint] for joint in limb.joints] for limb in (left, right)]
    size = float(np.linalg.norm(left.places[2] - left.places[0]))
    apart = np.abs(left.places * [-1.0, 1.0, 1.0] - right.places).max()
    return [exchange_sides(name) for name in names[0]] == names[1] and bool(apart < _SYMMETRIC * size)


def _fitted(
    name: str,
    place: _Place,
    limb: _Limb,
    grounds: Sequence[Ground],
    nodes: Mapping[int, str | None],
    names: Sequence[str],
) -> tuple[SuggestedMuscle, Ground, AnyAttached] | str:
    """A muscle on the outermost of the meshes round its bone, with that mesh; or the line that says why it fits none.

    It is as deep as the innermost mesh leaves room: a sleeve hides the arm whose muscles lift it.
    """
    bone = limb.joints[place.bone]
    shares = [_share(ground, bone) for ground in grounds]
    if not shares or max(shares) <= 0.0:
        return f"{name}: left out, as no mesh has skin on {names[bone]!r}"
    span = float(np.linalg.norm(limb.places[place.bone + 1] - limb.places[place.bone]))
    layers: list[SideOfBone] = []
    meshes: list[Ground] = []
    problems: list[WrinkleError] = []
    for number in np.argsort(shares)[::-1].tolist():
        if shares[number] < _LAYER * max(shares):
            break
        try:
            layers.append(_attached(name, place, limb, _FIRST * span, grounds[number], nodes, names)[1])
            meshes.append(grounds[number])
        except WrinkleError as error:
            problems.append(error)
    if not layers:
        return f"{name}: left out: {problems[0].lines[0].removeprefix(f'{grounds[0].document.path}: ')}"
    outer = int(np.argmax([each.depth for each in layers]))
    outermost = meshes[outer]
    try:
        deep = _DEEP * layers[outer].room(outermost)
        muscle, found, attached = _attached(name, place, limb, deep, outermost, nodes, names)
    except WrinkleError as error:
        return f"{name}: left out: {error.lines[0].removeprefix(f'{outermost.document.path}: ')}"
    room = found.room(outermost)
    muscle = replace(muscle, thickness=Length(THICKNESS * room))
    return SuggestedMuscle(muscle, False, names[found.node], room, STILL), outermost, attached


def _share(ground: Ground, joint: int) -> float:
    """The sum of the skin weights of a joint on a mesh."""
    columns = np.flatnonzero(ground.rig.joints == joint)
    if not len(columns):
        return 0.0
    return float(ground.surface.weights[np.isin(ground.surface.joints, columns)].sum())


def _attached(
    name: str,
    place: _Place,
    limb: _Limb,
    deep: float,
    ground: Ground,
    nodes: Mapping[int, str | None],
    names: Sequence[str],
) -> tuple[Muscle, SideOfBone, AnyAttached]:
    """A muscle whose line is some scene units beside its bone, the side of the bone on which it lies, and it attached.

    Raises:
        WrinkleError: It does not fit.
    """
    k, places = place.bone, limb.places
    bone = places[k + 1] - places[k]
    beyond = places[k + 2] - places[k + 1] if k + 2 < len(places) else 0.5 * bone
    aside = deep * limb.bends[k] * (1.0 if place.side == "inside" else -1.0)
    points = (
        JointPoint(names[limb.joints[k]], _rounded(place.begin * bone + aside)),
        JointPoint(names[limb.joints[k + 1]], _rounded(place.end * beyond + aside)),
    )
    muscle = Muscle(
        name=name, node=nodes[ground.rig.node], origin=points[0], insertion=points[1], where=ground.document.path
    )
    if place.tendons is not None:
        muscle = replace(muscle, tendon=Length(place.tendons, percent=True))
    attached = attach_one(muscle, ground)
    ends = asked_positions(ground.rig, ground.rest.clip, ground.rest.time, muscle)
    return muscle, BoneLines.of(ground).side_of(ground, ends.mean(axis=0), ends[1] - ends[0]), attached


def _rounded(offset: Floats) -> tuple[float, float, float]:
    """An offset to four digits of its length, as a file writes it."""
    digits = 4 - int(np.floor(np.log10(max(float(np.linalg.norm(offset)), 1e-9))))
    x, y, z = (round(float(each), digits) + 0.0 for each in offset)
    return (x, y, z)


def muscles_text(muscles: Sequence[SuggestedMuscle], document: Document) -> str:
    """A tools file of suggested muscles, which says that they are guesses."""
    lines = [
        f"# Muscles for {printable(os.path.basename(document.path), 90)}, as `wrinkle suggest --muscles` guesses them",
        "# by the names of bones and the thickness of limbs. Look at each in a preview, move its ends, make it thicker",
        "# or thinner, or delete it. `activation` flexes it by hand.",
        "version: 1",
        "",
        "muscles:",
    ]
    for each in muscles:
        muscle = each.muscle
        assert isinstance(muscle.thickness, Length)
        keys = {
            "node": None if muscle.node is None else quoted(muscle.node),
            "origin": _written(each.joints[0], each.offsets[0]),
            "insertion": _written(each.joints[1], each.offsets[1]),
            "mirror": "x" if each.mirrored else None,
            "tendon": f"{muscle.tendon.value:.3g}%" if muscle.tendon != parse_length(TENDONS) else None,
            "thickness": f"{muscle.thickness.value:.3g}   # a guess: skin and bone are {each.depth:.3g} apart",
        }
        if each.move is not STILL:
            change = "shorter, the skin bulges" if each.move.shortening > 0 else "longer, the skin sinks"
            share = f"{100 * abs(each.move.shortening):.0f} %"
            lines.append(f"  # {each.move.moment}: {share} {change} by {each.move.height:.2g}")
        lines += entry(muscle.name, keys)
    return "\n".join(lines) + "\n"


def _written(joint: str, offset: Position) -> str:
    return f"{{joint: {quoted(joint)}, offset: [{', '.join(f'{x:.12g}' for x in offset)}]}}"
