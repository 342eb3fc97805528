"""The length of a segment or path: rigid motion and scale of a whole body do not change it; rest lengths may."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.prepared import rig_of
from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.segment import RestLength, Segment
from wrinklecli.numeric.arrays import Floats

TIMES = np.array([0.0, 0.5, 1.0])


def carried(node: int, place: Any) -> CarriedPoint:
    """A point that one node carries, in its own space; the node is not scaled at rest."""
    return CarriedPoint(np.array([node]), np.ones(1), np.append(place, 1.0)[None, None], np.ones(1))


def body() -> Rig:
    """A root, node 1, with two joints."""
    joints = [{"name": f"joint_{k}", "translation": [float(k), 0.0, 0.0]} for k in range(2)]
    return rig_of({"mesh": 0}, {"name": "root", "children": [2, 3]}, *joints)


def clip_of(node: int, **channels: Any) -> Clip:
    made = [Channel(-1, node, path, TIMES, np.asarray(each, float), "LINEAR") for path, each in channels.items()]
    return Clip(-1, "clip", tuple(made), 0.0, 1.0)


def chain(places: Floats) -> Segment:
    """A path through (points, 3) places, which the two joints carry in turn."""
    return Segment(tuple(carried(2 + k % 2, place) for k, place in enumerate(places)), RestLength(1.0))


@given(st.integers(0, 1000), st.integers(2, 4))
def test_a_body_that_moves_and_grows_as_a_whole_keeps_its_lengths(seed: int, count: int) -> None:
    numbers = np.random.default_rng(seed)
    places, turns = numbers.normal(size=(count, 3)), numbers.normal(size=(3, 4))
    clip = clip_of(
        1,
        translation=numbers.normal(size=(3, 3)),
        rotation=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        scale=np.repeat(numbers.uniform(0.1, 10.0, (3, 1)), 3, axis=1),
    )
    world = places + np.array([[float(k % 2), 0.0, 0.0] for k in range(count)])
    length = np.linalg.norm(np.diff(world, axis=0), axis=1).sum()
    found = chain(places).lengths(body(), clip, TIMES)
    assert found.active.all()
    assert found.distances == pytest.approx(np.full(3, length), rel=1e-9)
    assert found.rows == pytest.approx(1.0 - found.distances)
    if count > 2:
        ends = Segment((chain(places).points[0], chain(places).points[-1]), RestLength(1.0))
        assert (ends.lengths(body(), clip, TIMES).distances <= found.distances * (1 + 1e-9)).all()


def test_joints_that_part_lengthen_the_segment_between_them() -> None:
    clip = clip_of(3, translation=[[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    found = chain(np.zeros((2, 3))).lengths(body(), clip, TIMES)
    assert found.distances == pytest.approx([1.0, 3.0, 0.5])
    assert found.rows == pytest.approx([0.0, -2.0, 0.5])


def test_nothing_is_measured_while_scale_hides_the_body() -> None:
    clip = clip_of(1, scale=[[1.0] * 3, [1e-9] * 3, [1.0] * 3])
    found = chain(np.zeros((2, 3))).lengths(body(), clip, TIMES)
    assert found.active.tolist() == [True, False, True]
    assert found.distances == pytest.approx([1.0, np.inf, 1.0])
    assert found.rows[1] == 0.0


def test_a_rest_length_follows_its_keys_or_its_morph_target() -> None:
    rig = replace(body(), morph_names=("a", "b"), morph_weights=np.zeros(2))
    clip = clip_of(0, weights=[[0.0, -1.0], [0.0, 0.5], [0.0, 2.0]])
    keyed = RestLength(2.0, keys={"clip": np.array([[0.5, 3.0], [1.0, 5.0]])})
    assert keyed.at(rig, clip, np.array([0.0, 0.75, 9.0])) == pytest.approx([3.0, 4.0, 5.0])
    assert keyed.at(rig, None, TIMES) == pytest.approx([2.0] * 3)
    morphed = RestLength(2.0, morph=(1, 6.0))
    assert morphed.at(rig, clip, TIMES) == pytest.approx([2.0, 4.0, 6.0])
    assert morphed.at(rig, None, TIMES) == pytest.approx([2.0] * 3)
