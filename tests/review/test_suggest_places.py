"""The names of places: what folds, on which side of it, and on which side of the body."""

from typing import Any

import numpy as np
import pytest

from kit.asset import Asset
from kit.prepared import as_document
from wrinklecli.choices import Part
from wrinklecli.review.suggest.place_names import NamedBody, PlaceName

# A figure that looks along z with its arms spread, by names of Mixamo: name, parent and place.
FIGURE = [
    ("Hips", "", [0.0, 1.0, 0.0]),
    ("Spine", "Hips", [0.0, 1.2, 0.0]),
    ("LeftArm", "Spine", [0.2, 1.5, 0.0]),
    ("LeftForeArm", "LeftArm", [0.5, 1.5, 0.0]),
    ("LeftHand", "LeftForeArm", [0.8, 1.5, 0.0]),
    ("LeftHandIndex1", "LeftHand", [0.9, 1.5, 0.05]),
    ("LeftHandIndex2", "LeftHandIndex1", [0.93, 1.5, 0.05]),
    ("LeftHandPinky1", "LeftHand", [0.9, 1.5, -0.05]),
    ("RightUpLeg", "Hips", [-0.1, 0.9, 0.0]),
    ("RightLeg", "RightUpLeg", [-0.1, 0.5, 0.0]),
    ("RightFoot", "RightLeg", [-0.1, 0.1, 0.0]),
    ("RightToeBase", "RightFoot", [-0.1, 0.0, 0.1]),
]
AXES = [[0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0], [1, 0, 0]]
FRONT, BACK, UP, DOWN, LEFT = (np.array(axis, float) for axis in AXES)


def figure(nodes: Any) -> NamedBody:
    asset, places = Asset(), {name: np.array(place) for name, _, place in nodes}
    numbers = {name: k for k, (name, _, _) in enumerate(nodes)}
    for name, parent, place in nodes:
        node: dict[str, Any] = {"name": name, "translation": (place - places.get(parent, np.zeros(3))).tolist()}
        below = [numbers[each] for each, above, _ in nodes if above == name]
        asset.append("nodes", {**node, "children": below} if below else node)
    asset.gltf["scenes"] = [{"nodes": [k for k, (_, parent, _) in enumerate(nodes) if not parent]}]
    return NamedBody.of(as_document(asset))


@pytest.mark.parametrize(
    ("joint", "normal", "stem", "words"),
    [
        ("LeftForeArm", FRONT, "elbow_front", "front of the left elbow"),
        ("RightLeg", BACK, "knee_back", "back of the right knee"),
        ("RightLeg", LEFT, "knee_inner", "inner side of the right knee"),
        ("RightUpLeg", UP + 0.1 * FRONT, "hip_front", "front of the right hip"),
        ("LeftArm", DOWN, "armpit", "left armpit"),
        ("LeftArm", UP, "shoulder_top", "top of the left shoulder"),
        ("Spine", LEFT, "waist_left", "left side of the waist"),
        ("LeftHand", DOWN, "wrist_palm", "palm side of the left wrist"),
        ("LeftHand", UP, "wrist_back", "back of the left wrist"),
        ("LeftHandIndex2", DOWN, "index_finger_middle", "middle of the left index finger"),
        ("LeftHandPinky1", DOWN, "little_finger_base", "base of the left little finger"),
        ("RightToeBase", UP, "toes_top", "top of the right toes"),
    ],
)
def test_places_have_the_words_of_an_artist(joint: str, normal: Any, stem: str, words: str) -> None:
    body = figure(FIGURE)
    node = body.hierarchy.names.index(joint)
    part = body.bones.parts[node]
    assert part is not None
    place = body.place(node, part, normal, np.array(FIGURE[node][2]))
    side = {"L": "L", "R": "R"}.get(joint[0], "")
    assert (place.stem, place.words(*side)) == (stem, words)


def test_both_sides_are_said_together() -> None:
    assert PlaceName("knee", "back").words("L", "R") == "back of the left and right knee"
    assert PlaceName("waist", "front").words() == "front of the waist"
    assert PlaceName("waist", "left").words("L", "R") == "left and right side of the waist"


def test_five_fingers_that_are_only_numbered_are_in_order() -> None:
    """The fingers of MakeHuman: the first is the thumb."""
    wrist = ("wrist.R", "", [0.0, 0.0, 0.0])
    fingers = [
        [
            (f"finger{k}-1.R", "wrist.R", [-0.1, 0.0, 0.06 - 0.02 * k]),
            (f"finger{k}-2.R", f"finger{k}-1.R", [-0.13, 0.0, 0.0]),
        ]
        for k in range(1, 6)
    ]
    body = figure([wrist, *(each for pair in fingers for each in pair)])

    def words(joint: str, part: Part, normal: Any) -> str:
        return body.place(body.hierarchy.names.index(joint), part, normal, np.zeros(3)).words("R")

    assert words("finger1-1.R", "finger", DOWN) == "base of the right thumb"
    assert words("finger5-2.R", "finger", DOWN) == "middle of the right little finger"
    assert words("wrist.R", "hand", DOWN) == "palm side of the right wrist"
