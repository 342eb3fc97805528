"""Places of a body in the words of an artist, such as the back of the left knee.

A joint that is known as a part of a body names the place that it folds. The normal of the skin there, in the stored
pose, says which side of it: the front or the back, the palm, the outer side. A finger has a name, and its joints are
its base, its middle and its tip.
"""

import re
from collections.abc import Mapping
from functools import cached_property
from itertools import takewhile
from typing import Literal

import numpy as np

from wrinklecli.character.bones import Bones, forwards_of, read_bones, words_of
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import Hierarchy, read_hierarchy
from wrinklecli.choices import Part
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.tools.mirror import split_side

Aspect = Literal[
    "", "front", "back", "outer", "inner", "top", "under", "left", "right", "palm", "base", "middle", "tip",
]  # fmt: skip

# The joint, or what else folds, where each part of a body begins.
NOUNS: Mapping[Part, str] = {
    "hips": "hips", "spine": "waist", "chest": "chest", "neck": "neck", "head": "head", "jaw": "jaw", "eye": "eye",
    "shoulder": "collarbone", "upper arm": "shoulder", "lower arm": "elbow", "hand": "wrist", "palm": "palm",
    "finger": "finger", "upper leg": "hip", "lower leg": "knee", "foot": "ankle", "toes": "toes", "twist": "limb",
}  # fmt: skip
_FINGERS = {
    "thumb": "thumb",
    "index": "index finger",
    "mid": "middle finger",
    "ring": "ring finger",
    "pink|little": "little finger",
}
_PHALANGES: tuple[Aspect, ...] = ("base", "middle", "tip")
# Aspects in a sentence, where they are not a word as it stands.
_SIDES: Mapping[str, str] = {
    "outer": "outer side",
    "inner": "inner side",
    "under": "underside",
    "palm": "palm side",
}


@dataclass(frozen=True, slots=True)
class PlaceName:
    """The name of a place, alike for both sides of a body.

    Attributes:
        noun: What folds, such as `knee`.
        aspect: Which side of that, or which joint of a finger.
    """

    noun: str
    aspect: Aspect = ""

    @property
    def stem(self) -> str:
        """The stem of tools' names."""
        return "_".join(f"{self.noun} {self.aspect}".split())

    def words(self, *sides: str) -> str:
        """The place in a sentence, without an article; `sides` are L, R or both."""
        both = " and ".join({"L": "left", "R": "right"}[side] for side in sides)
        if self.aspect in ("left", "right"):  # of a waist, which both sides share
            return f"{both or self.aspect} side of the {self.noun}"
        named = f"{both} {self.noun}" if sides else self.noun
        return f"{_SIDES.get(self.aspect, self.aspect)} of the {named}" if self.aspect else named


@dataclass(frozen=True)
class NamedBody:
    """A character whose places have names.

    Attributes:
        hierarchy: Its nodes.
        bones: The parts of a body that they move.
        ahead: (3,) unit, where it looks.
    """

    hierarchy: Hierarchy
    bones: Bones
    ahead: Floats

    @classmethod
    def of(cls, document: Document) -> "NamedBody":
        """Read the bones of an asset."""
        hierarchy, bones = read_hierarchy(document), read_bones(document)
        return cls(hierarchy, bones, forwards_of(hierarchy, bones))

    def place(self, joint: int, part: Part, normal: Floats, centre: Floats) -> PlaceName:
        """The name of a place at a joint, with a (3,) normal and a (3,) centre in the stored pose."""
        if part == "finger":
            return PlaceName(*self._fingers.get(joint, (NOUNS[part], "")))
        aside = np.cross([0.0, 1.0, 0.0], self.ahead)  # to the character's left
        side = split_side(self.hierarchy.names[joint])[1]
        if not side and part not in ("hips", "spine", "chest", "neck", "head", "jaw"):
            side = "L" if float(centre @ aside) > 0 else "R"
        outwards = aside if side == "L" else -aside
        names: dict[Aspect, Floats] = {"front": self.ahead, "back": -self.ahead}
        names |= {"outer": outwards, "inner": -outwards} if side else {"left": aside, "right": -aside}
        if part not in ("upper leg", "lower leg"):  # which hang down
            names |= {"top": np.array([0.0, 1.0, 0.0]), "under": np.array([0.0, -1.0, 0.0])}
        if joint in self._palms:
            names = {"palm": self._palms[joint], "back": -self._palms[joint]}
        aspect = max(names, key=lambda name: float(names[name] @ normal))
        if part == "upper arm" and aspect in ("inner", "under"):
            return PlaceName("armpit")
        return PlaceName(NOUNS[part], aspect)

    @cached_property
    def _fingers(self) -> dict[int, tuple[str, Aspect]]:
        """For each joint of a finger the finger's name, and the joint's. Five fingers without names are in order."""
        names = {}
        for roots in self._hands.values():
            for order, root in enumerate(roots):
                words = words_of(self.hierarchy.names[root])
                said = [name for pattern, name in _FINGERS.items() if re.search(rf"\b({pattern})", words)]
                usual = [*_FINGERS.values()][order] if len(roots) == len(_FINGERS) else NOUNS["finger"]
                names[root] = said[0] if said else usual
        lines = {node: self._line(node) for node, part in enumerate(self.bones.parts) if part == "finger"}
        return {
            node: (names[line[-1]], _PHALANGES[len(line) - 1])
            for node, line in lines.items()
            if len(line) <= len(_PHALANGES)
        }

    def _line(self, node: int) -> list[int]:
        """A joint of a finger and those of the finger above it."""
        return [*takewhile(lambda each: self.bones.parts[each] == "finger", self.hierarchy.upwards(node))]

    @cached_property
    def _hands(self) -> dict[int, list[int]]:
        """For each hand, -1 for none, the first joint of each finger, in the order of their names."""
        parts, found = self.bones.parts, dict[int, list[int]]()
        for node, part in enumerate(parts):
            if part == "finger" and self._line(node) == [node]:
                hand = next((each for each in self.hierarchy.upwards(node) if parts[each] == "hand"), -1)
                found.setdefault(hand, []).append(node)
        return {hand: sorted(roots, key=self.hierarchy.names.__getitem__) for hand, roots in found.items()}

    @cached_property
    def _palms(self) -> dict[int, Floats]:
        """(3,) unit out of the palm of each hand of which the index finger and the little one are known."""
        found = {}
        for hand, roots in self._hands.items():
            named = {self._fingers[root][0]: root for root in roots}
            ends = [named.get(_FINGERS["index"], -1), named.get(_FINGERS["pink|little"], -1)]
            side = split_side(self.hierarchy.names[hand])[1]
            if hand < 0 or min(ends) < 0 or not side:
                continue
            wrist, index, little = stored_positions(self.hierarchy, [hand, *ends])
            out = unit(np.cross(index - wrist, little - wrist))
            found[hand] = -out if side == "L" else out
        return found
