"""The morph targets of faces, by the names of several vocabularies, and the regions that an artist wrinkles with them.

A name of any vocabulary stands for one or more *motions*, which are called as ARKit calls them, without a side.

Sources of the names:
    - ARKit, `ARFaceAnchor.BlendShapeLocation`: `browInnerUp`, `eyeBlinkLeft`; others write `eyeBlink_L`.
    - P. Ekman, W. V. Friesen, J. C. Hager, *Facial Action Coding System*, 2002: units such as AU1, inner brow raiser.
    - VRM 0.x, blendShapeMaster, and VRMC_vrm-1.0, expressions; VRoid Studio's morph targets `Fcl_BRW_Surprised`.
    - Character Creator's `Brow_Raise_Inner_L`, MetaHuman's `browRaiseInL`, and plain names such as `browsUp`.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any, Literal

import numpy as np

from wrinklecli.character.bones import words_of
from wrinklecli.character.rig import Rig
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.tools.mirror import split_side

Side = Literal["", "L", "R"]

# Each motion with its units of FACS, and its names in any order of words, singular, after any other words.
_MOTIONS: Mapping[str, str] = {
    "browInnerUp": (
        "1, brow inner up, inner brow raiser, brow raise inner, brow raise in, brow up, brow raise, brw surprised"
    ),
    "browOuterUp": (
        "2, brow outer up, outer brow raiser, brow raise outer, brow raise out, brow up, brow raise, brw surprised"
    ),
    "browDown": "4, brow down, brow lowerer, brow lower, brow drop, brow compress, brow pinch, frown brow, brw angry",
    "cheekSquint": "6, cheek squint, cheek raiser, cheek raise, eye cheek raise, eye joy",
    "eyeSquint": "7, eye squint, lid tightener, lid tighten, eye squint inner, squint, eye joy",
    "noseSneer": "9, nose sneer, nose wrinkler, nose wrinkle, sneer",
    "mouthSmile": "12, mouth smile, lip corner puller, mouth corner pull, smile, mth joy, mth fun",
    "mouthShrugLower": "17, mouth shrug lower, chin raiser, chin raise, mouth chin up, mouth raiser lower",
    "eyeBlink": "43, 45, eye blink, eye close, eye closed, lid close, blink",
    "jawOpen": "26, 27, jaw open, jaw drop, mouth open, mth a",
    "mouthPucker": "18, 22, 25, mouth pucker, mouth funnel, lip pucker, lip funneler, lip part, mth u",
    "mouthFrown": "15, 20, mouth frown, mouth stretch, lip corner depressor, lip stretcher",
}
# Expressions of VRM 0 and 1.
_EXPRESSIONS: Mapping[str, tuple[str, ...]] = {
    "surprised": ("browInnerUp", "browOuterUp"),
    "angry": ("browDown",),
    "happy joy": ("cheekSquint", "eyeSquint", "mouthSmile"),
    "blink": ("eyeBlink",),
    "aa a": ("jawOpen",),
    "ou u oh o": ("mouthPucker",),
}
_UNIT = re.compile(r"(?:^|[^A-Za-z])[Aa][Uu][_ .-]?0?(\d{1,2})(?!\d)")
VOCABULARIES = (
    "none has a name of ARKit (browInnerUp), of FACS (AU1, BrowRaiser_Inner), of VRoid (Fcl_BRW_Surprised) or of an"
    " expression of a VRM (surprised)"
)


# Heights of parts of a face: in the middle of the eyes 0, and 1 at the brows.
HEIGHTS = {"chin": -np.inf, "mouth": -1.0, "eyes": 0.0, "brows": 1.0, "crown": np.inf}
# Least and greatest distances from the middle of a face, which are 1 at an eye's middle, and 2 at its outer corner.
COLUMNS = {"face": (0.0, np.inf), "nose": (0.0, 1.0), "side": (0.5, np.inf), "temple": (2.0, np.inf)}


@dataclass(frozen=True, slots=True)
class FaceRegion:
    """A region of a face that an artist wrinkles.

    Attributes:
        title: Its name in a sentence.
        name: The stem of its tools' names.
        targets: The motions that wrinkle it.
        between: Parts of a face, keys of `HEIGHTS`, between which its summit lies.
        column: That of `COLUMNS` in which its summit lies.
        middle: True if it lies across the middle of the face, False for one on each side.
        upright: True for lines across the middle that stand upright, False for lines that are level.
        round_eye: True if its wrinkles spread like rays from an eye.
        furrow: True if it is one furrow below the skin, without crests beside it.
    """

    title: str
    name: str
    targets: tuple[str, ...]
    between: tuple[str, str]
    column: str
    middle: bool = False
    upright: bool = False
    round_eye: bool = False
    furrow: bool = False


# The regions, from the forehead down.
REGIONS = (
    FaceRegion("the forehead", "forehead", ("browInnerUp",), ("brows", "crown"), "face", middle=True),
    FaceRegion("the side of the forehead", "forehead_side", ("browOuterUp",), ("brows", "crown"), "side"),
    FaceRegion("the glabella", "glabella", ("browDown",), ("eyes", "crown"), "nose", middle=True, upright=True),
    FaceRegion("crow's feet", "crows_foot", ("cheekSquint", "eyeSquint"), ("mouth", "brows"), "temple", round_eye=True),
    FaceRegion("bunny lines", "bunny", ("noseSneer",), ("mouth", "eyes"), "nose"),
    FaceRegion(
        "the nasolabial fold", "nasolabial", ("mouthSmile", "cheekSquint"), ("mouth", "eyes"), "side", furrow=True
    ),
    FaceRegion("the chin", "chin", ("mouthShrugLower",), ("chin", "mouth"), "nose", middle=True),
)


@dataclass(frozen=True, slots=True)
class FaceTarget:
    """Morph targets of a mesh that a name of a face stands for.

    Attributes:
        name: As the asset has it.
        motions: By ARKit's names.
        side: L or R of the character; empty for both.
        weights: By the target's number, its weight.
    """

    name: str
    motions: tuple[str, ...]
    side: Side
    weights: Mapping[int, float] = field(hash=False)


def read_face_targets(document: Document, rig: Rig) -> list[FaceTarget]:
    """Find the morph targets of a rig's mesh that are named for a face, and the expressions of a VRM."""
    found = [
        FaceTarget(name, *said, {number: 1.0})
        for number, name in enumerate(rig.morph_names)
        if (said := motions_of(name))[0]
    ]
    known = {motion for each in found for motion in each.motions}
    for name, weights in _expressions(document, rig):
        motions = _EXPRESSION_OF.get(words_of(name).replace(" ", ""), ())
        side: Side = ""
        if not motions:
            motions, side = motions_of(name)
        # An expression moves the whole face, so single targets say more about a place.
        motions = tuple(motion for motion in motions if motion not in known)
        if motions:
            found.append(FaceTarget(name, motions, side, weights))
    return found


def motions_of(name: str) -> tuple[tuple[str, ...], Side]:
    """The motions that a morph target's name stands for, and its side; none if the name says nothing of a face."""
    stem, letter = split_side(name)
    side: Side = "L" if letter == "L" else "R" if letter == "R" else ""
    if unit := _UNIT.search(name):
        if not letter and (after := re.match(r"_?([LR])\b", name[unit.end() :])):
            side = "L" if after[1] == "L" else "R"
        return _BY_WORDS.get((str(int(unit[1])),), ()), side
    words = words_of(stem).split()
    # MetaHuman and others write the side as the last letter: `browRaiseInL`, `innerBrowRaiserL`.
    if not side and words and words[-1] in ("l", "r"):
        side = "L" if words.pop() == "l" else "R"
    words = [word.removesuffix("s") if word in _PLURALS else word for word in words]
    for count in range(min(_LONGEST, len(words)), 0, -1):
        motions = _BY_WORDS.get(tuple(sorted(words[-count:])))
        if motions:
            return motions, side
    return (), side


_PLURALS = ("brows", "eyebrows", "eyes", "lids", "cheeks", "lips", "eyebrow")


def _by_words() -> dict[tuple[str, ...], tuple[str, ...]]:
    found: dict[tuple[str, ...], tuple[str, ...]] = {}
    for motion, names in _MOTIONS.items():
        for name in names.split(", "):
            key = tuple(sorted(name.split()))
            found[key] = (*found.get(key, ()), motion)
    return found


_BY_WORDS = _by_words()
_LONGEST = max(map(len, _BY_WORDS))
_EXPRESSION_OF = {name: motions for names, motions in _EXPRESSIONS.items() for name in names.split()}


def _expressions(document: Document, rig: Rig) -> Iterator[tuple[str, dict[int, float]]]:
    """Give the names of a VRM's expressions, and the weights of a rig's morph targets in each."""
    for name, binds, holder, own, full in _named_binds(document, rig):
        weights = {}
        for bind in binds if isinstance(binds, list) else ():
            number, weight = _inside(bind, "index"), _inside(bind, "weight")
            # In Python, true is a number.
            numbers = type(number) is int and type(weight) in (int, float)
            if numbers and _inside(bind, holder) == own and 0 <= number < len(rig.morph_names):
                weights[number] = min(max(float(weight) / full, 0.0), 1.0)
        if weights:
            yield name, weights


def _named_binds(document: Document, rig: Rig) -> Iterator[tuple[str, Any, str, int, float]]:
    """Give each expression's name and list of morph targets, their holder by key and index, and the full weight."""
    groups = _inside(document.gltf, "extensions", "VRM", "blendShapeMaster", "blendShapeGroups")
    for group in groups if isinstance(groups, list) else ():
        preset = _inside(group, "presetName")
        name = _inside(group, "name") if preset in (None, "", "unknown") else preset
        yield str(name), _inside(group, "binds"), "mesh", rig.mesh, 100.0
    for kind in ("preset", "custom"):
        named = _inside(document.gltf, "extensions", "VRMC_vrm", "expressions", kind)
        for name, expression in named.items() if isinstance(named, dict) else ():
            yield str(name), _inside(expression, "morphTargetBinds"), "node", rig.node, 1.0


def _inside(value: Any, *keys: str) -> Any:
    """The value in nested objects, which nothing has checked in extensions; None if it is not there."""
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value
