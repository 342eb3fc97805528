"""Clips in place: feet that stand on the ground slide backwards, and the body stays where it is."""

import numpy as np
import pytest

from kit.asset import Asset, Json
from kit.bakes import place
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.effects.flesh.attach import in_place
from wrinklecli.gltf.document import read_document

HEIGHT = 2.0


def walking(half: float, ahead: float, axis: int, seconds: float) -> Asset:
    """Two feet, one of which is on the ground while it moves backwards by twice `half`, and a head above them.

    In each round the body gets ahead by `ahead` along an axis.
    """
    asset = Asset()
    attributes = {
        "POSITION": asset.accessor(np.eye(3)),
        "JOINTS_0": asset.accessor(np.zeros((3, 4)), "u1"),
        "WEIGHTS_0": asset.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))),
    }
    asset.append("meshes", {"primitives": [{"attributes": attributes}]})
    asset.append("nodes", {"name": "body", "mesh": 0, "skin": 0})
    asset.append("nodes", {"name": "root", "children": [2, 3, 4]})
    for name in ("foot.L", "foot.R", "head"):
        asset.append("nodes", {"name": name, "translation": [0.0, HEIGHT * (name == "head"), 0.0]})
    asset.append("skins", {"joints": [1, 2, 3, 4]})
    asset.append("scenes", {"nodes": [0, 1]})
    clip: Json = {"name": "walk"}
    times, lifted, along = seconds * np.linspace(0.0, 1.0, 5), [0.0, 0.0, 0.0, 0.1, 0.0], [1.0, 0.0, -1.0, 0.0, 1.0]
    for node, sign in ((2, 1.0), (3, -1.0)):
        places = np.zeros((5, 3))
        places[:, axis] = sign * half * np.array(along)
        places[:, 1] = lifted if node == 2 else lifted[::-1]
        asset.channel(clip, node, "translation", times, places)
    asset.channel(clip, 1, "translation", times[[0, -1]], np.outer([0.0, ahead], np.eye(3)[axis]))
    asset.append("animations", clip)
    return asset


@pytest.mark.parametrize(
    ("half", "ahead", "found"),
    [
        (0.07, 0.0, False),  # a body height in seven seconds, which is a shifted foot
        (0.08, 0.0, True),
        (0.20, 0.15, True),
        (0.20, 0.17, False),  # a quarter of the way by which its feet slide
        (0.20, 0.8, False),
        (0.00, 0.8, False),
    ],
)
@pytest.mark.parametrize(("axis", "seconds"), [(0, 1.0), (2, 2.0)])
def test_a_body_is_in_place_if_its_feet_run_and_it_gets_nowhere(
    half: float, ahead: float, found: bool, axis: int, seconds: float
) -> None:
    document = read_document(place(walking(seconds * half, seconds * ahead, axis, seconds)))
    rig, (clip,) = read_rig(document, 0), read_clips(document)
    assert in_place(rig, clip) == found


def test_a_body_in_one_point_walks_nowhere() -> None:
    asset = walking(0.0, 1.0, 0, 1.0)
    asset.gltf["nodes"][4]["translation"] = [0.0, 0.0, 0.0]
    document = read_document(place(asset))
    assert not in_place(read_rig(document, 0), read_clips(document)[0])
