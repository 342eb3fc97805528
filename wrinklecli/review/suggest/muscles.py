"""Muscles suggested by the names of bones: where they are on a human, in proportion to each limb.

They are guesses, as a rig says where bones are and no more, and the file says that they were guessed. Clips say how far
each bulges, and one that no clip moves is left out.

Source of the places: H. Gray, *Anatomy of the Human Body*, on origins and insertions, simplified to straight segments
along one bone; ends are ratios of the bones' lengths.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from wrinklecli.character.bones import Bones, forwards_of, read_bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import Hierarchy, read_hierarchy
from wrinklecli.choices import Part
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, significant, unit
from wrinklecli.review.suggest.guesses import Guess, entries_of, rounded
from wrinklecli.review.suggest.text import Entry
from wrinklecli.surface.bones import BoneLines, SideOfBone
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.rest import asked_positions
from wrinklecli.tools.body import THICKNESS, Muscle
from wrinklecli.tools.mirror import split_side
from wrinklecli.tools.records import JointPoint, Length

# Distance of a muscle's line from its bone, over that of the skin: the middle of the flesh.
_DEEP = 0.45
# The same over the bone's length, while the skin's distance is not known.
_FIRST = 0.05
# Skin weight of a bone on a mesh, over that on the mesh that has most of it, from which on the mesh is a layer round
# the bone: a sleeve has about as much as the arm below it, a glove's cuff a tenth.
_LAYER = 0.3
# Angle of a joint in the stored pose that shows which way it bends, radians: 5°.
_BENT = np.radians(5.0)


@dataclass(frozen=True, slots=True)
class _Place:
    """The place of a muscle on a limb.

    Attributes:
        bone: The bone along which the muscle lies.
        side: The inside of the joint below that bone, to which it bends, or the outside.
        begin: Distance of the origin from the bone's own joint, over the bone's length.
        end: Distance of the insertion beyond the joint below, over the next bone's length.
        tendons: Part of the muscle that both tendons take together, as a file has it; None for the usual ones.
    """

    bone: Part
    side: Literal["inside", "outside"]
    begin: float
    end: float
    tendons: Length | None = None


# The parts of each limb from its root on.
_LIMBS: tuple[tuple[Part, Part, Part], ...] = (
    ("upper arm", "lower arm", "hand"),
    ("upper leg", "lower leg", "foot"),
)
_MUSCLES: Mapping[str, _Place] = {
    "biceps": _Place("upper arm", "inside", 0.06, 0.14),
    "triceps": _Place("upper arm", "outside", 0.10, 0.02),
    "forearm_flexors": _Place("lower arm", "inside", 0.05, 0.15),
    "quadriceps": _Place("upper leg", "outside", 0.12, 0.08),
    # Their bellies begin below the buttock: from 0.12 on, with usual tendons, they leave a hollow there, 5 mm deep.
    "hamstrings": _Place("upper leg", "inside", 0.04, 0.10, Length(20.0, percent=True)),
    "calf": _Place("lower leg", "outside", 0.04, 0.10),
}


@dataclass(frozen=True, slots=True)
class _Limb:
    """A limb: its joints, with places in the stored pose, and the direction in which each of two joints bends.

    Attributes:
        parts: Those of its joints: of the two bones and of what is below them.
        joints: Their nodes.
        places: (3, 3) their places.
        bends: (2, 3) unit directions across each bone towards which the joint below it bends.
        letter: L or R.
    """

    parts: tuple[Part, Part, Part]
    joints: tuple[int, int, int]
    places: Floats
    bends: Floats
    letter: str


def suggest_muscles(
    document: Document, grounds: Sequence[Ground], nodes: Mapping[int, str | None], clips: Sequence[Clip], *, fps: float
) -> tuple[list[Entry], list[str], str]:
    """Suggest muscles where the rig names the bones of arms and legs, and clips move them.

    Args:
        document: The asset.
        grounds: Its meshes that deform.
        nodes: Their nodes, each with the name that a file must give; None if it need not.
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
    guesses: list[Guess] = []
    problems: dict[str, str] = {}
    for name, place in _MUSCLES.items():
        for limb in limbs:
            if place.bone in limb.parts:
                muscle = f"{name}.{limb.letter}"
                made = _fitted(muscle, place, limb, grounds, nodes, hierarchy.names)
                if isinstance(made, Guess):
                    guesses.append(made)
                else:  # of several skeletons the first says it
                    problems.setdefault(muscle, made)
    entries = entries_of(guesses, clips, fps=fps)
    found = [each for each in entries if not clips or "clip" in each.facts]
    fitted = {each.effect.name for each in guesses}
    notes = [line for muscle, line in problems.items() if muscle not in fitted]
    notes += [f"{each.effect.name}: left out, as no clip changes its length" for each in entries if each not in found]
    reason = "no mesh has skin around the bones of arms and legs, or no clip bends these"
    return found, notes, "" if found else reason


def _limbs(hierarchy: Hierarchy, bones: Bones) -> list[_Limb]:
    """The arms and legs of a rig, left ones first."""
    found = []
    forwards = forwards_of(hierarchy, bones)
    aside = np.cross([0.0, 1.0, 0.0], forwards)  # to the character's left

    def above(node: int, part: Part) -> int | None:
        """The nearest node above a node that is a part of the body."""
        return next((k for k in hierarchy.upwards(int(hierarchy.parents[node])) if bones.parts[k] == part), None)

    for parts in _LIMBS:
        upper, lower, end = ([k for k, part in enumerate(bones.parts) if part == each] for each in parts)
        for node in lower:
            top, below = above(node, parts[0]), [k for k in end if above(k, parts[1]) == node]
            if top is None or not below or above(node, parts[1]) is not None:
                continue
            joints = top, node, below[0]
            places = stored_positions(hierarchy, joints)
            # Legs hang down, and their sides are those of their joints.
            beside = places[0] - stored_positions(hierarchy, upper).mean(axis=0)
            left = float((places[1] - places[0] if parts[0] == "upper arm" else beside) @ aside) >= 0
            letter = split_side(hierarchy.names[node])[1] or ("L" if left else "R")
            found.append(_Limb(parts, joints, places, _bends(parts[0], places, forwards, left), letter))
    return sorted(found, key=lambda limb: limb.letter)


def _bends(upper: Part, places: Floats, forwards: Floats, left: bool) -> Floats:
    """(2, 3) directions across both bones of a limb towards which the joint below each bends.

    An elbow bends forwards and a knee backwards, unless the stored pose shows another way. A wrist bends to the palm,
    which looks down where arms are spread, and an ankle bends upwards.
    """
    first, second = unit(places[1] - places[0]), unit(places[2] - places[1])
    hinge = second - first * float(first @ second)
    if np.linalg.norm(hinge) < np.sin(_BENT):
        hinge = forwards if upper == "upper arm" else -forwards
    palm = np.cross(second, forwards) if left else np.cross(forwards, second)
    end = palm if upper == "upper arm" else forwards
    across = [each - bone * float(bone @ each) for each, bone in ((hinge, first), (end, second))]
    return np.array([unit(each) for each in across])


def _fitted(
    name: str,
    place: _Place,
    limb: _Limb,
    grounds: Sequence[Ground],
    nodes: Mapping[int, str | None],
    names: Sequence[str],
) -> Guess | str:
    """A muscle on the outermost of the meshes round its bone; or the line that says why it fits none.

    It is as deep as the innermost mesh leaves room: a sleeve hides the arm whose muscles lift it.
    """
    number = limb.parts.index(place.bone)
    bone, span = limb.joints[number], float(np.linalg.norm(limb.places[number + 1] - limb.places[number]))
    # The sums of the bone's skin weights.
    surfaces = ((each.surface, np.flatnonzero(each.rig.joints == bone)) for each in grounds)
    shares = [float(each.weights[np.isin(each.joints, columns)].sum()) for each, columns in surfaces]
    if max(shares, default=0.0) <= 0.0:
        return f"{name}: left out, as no mesh has skin on {names[bone]!r}"
    layers: list[tuple[SideOfBone, Ground]] = []
    problem = ""
    for share, ground in sorted(zip(shares, grounds, strict=True), key=lambda each: -each[0]):
        try:
            if share >= _LAYER * max(shares):
                layers.append((_attached(name, place, limb, _FIRST * span, ground, nodes, names)[1], ground))
        except WrinkleError as error:
            problem = problem or error.lines[0]
    if layers:
        side, outermost = max(layers, key=lambda each: each[0].depth)
        try:
            guess, side = _attached(name, place, limb, _DEEP * side.room(outermost), outermost, nodes, names)
        except WrinkleError as error:
            problem = error.lines[0]
        else:
            room = side.room(outermost)
            muscle = replace(guess.effect, thickness=Length(significant(THICKNESS * room, 3)))
            return replace(guess, effect=muscle, facts={"bone": names[side.node], "depth": room})
    return f"{name}: left out: {problem.removeprefix(f'{grounds[0].document.path}: ')}"


def _attached(
    name: str,
    place: _Place,
    limb: _Limb,
    deep: float,
    ground: Ground,
    nodes: Mapping[int, str | None],
    names: Sequence[str],
) -> tuple[Guess, SideOfBone]:
    """A muscle whose line is some scene units beside its bone, and the side of the bone on which it lies.

    Raises:
        WrinkleError: It does not fit.
    """
    k, places = limb.parts.index(place.bone), limb.places
    bone = places[k + 1] - places[k]
    beyond = places[k + 2] - places[k + 1] if k == 0 else 0.5 * bone
    aside = deep * limb.bends[k] * (1.0 if place.side == "inside" else -1.0)
    first, last = (place.begin * bone + aside, place.end * beyond + aside)
    points = (
        JointPoint(names[limb.joints[k]], rounded(first, float(np.linalg.norm(first)))),
        JointPoint(names[limb.joints[k + 1]], rounded(last, float(np.linalg.norm(last)))),
    )
    muscle = Muscle(
        name=name, node=nodes[ground.rig.node], origin=points[0], insertion=points[1], where=ground.document.path
    )
    if place.tendons is not None:
        muscle = replace(muscle, tendon=place.tendons)
    ends = asked_positions(ground.rig, ground.rest, muscle)
    guess = Guess(muscle, ground, attach_one(muscle, ground), ends, {})
    return guess, BoneLines.of(ground).side_of(ground, ends.mean(axis=0), ends[1] - ends[0])
