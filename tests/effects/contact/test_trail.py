"""Trails find the turns that a joint has had before in a clip."""

import numpy as np
import pytest

from wrinklecli.drive.angle import Angles
from wrinklecli.drive.segment import Lengths
from wrinklecli.effects.contact.trail import Trail
from wrinklecli.numeric.arrays import Floats

DEGREE = np.sin(np.radians(0.5))


def followed(turns: Floats) -> tuple[Trail, list[int]]:
    """The trail of a clip whose weights are the numbers of its frames, and the frames whose turns were met before."""
    trail, met = Trail.of(Angles(np.zeros(len(turns)), np.zeros_like(turns), turns)), []
    for frame in range(len(turns)):
        if trail.at(frame) is None:
            trail.go_on(frame, np.array([float(frame)]))
        else:
            met.append(frame)
    return trail, met


def turned(*degrees: float, aside: float = 0.0) -> Floats:
    return DEGREE * np.array([[each, aside, 0.0] for each in degrees])


@pytest.mark.parametrize("step", [0.01, 1.0, 5.0])
def test_a_turn_that_goes_on_is_new_and_one_that_comes_back_is_met(step: float) -> None:
    there = step * np.arange(10.0)
    trail, met = followed(np.concatenate([turned(*there), turned(*there[-2::-1] + step / 4)]))
    assert trail.frames == [*range(10)]
    assert met == [*range(10, 19)]


def test_weights_are_those_between_the_turns_met() -> None:
    trail, met = followed(turned(0.0, 10.0, 20.0, 13.0))
    assert met == [3]
    found = trail.at(3)
    assert found is not None
    weights, share = found
    assert (weights[0], share) == (pytest.approx(1.3), 1.0)


def test_weights_count_less_the_further_the_turn_is_and_nothing_3_degrees_away() -> None:
    shares = []
    for aside in np.linspace(0.5, 3.5, 13):
        trail, _ = followed(np.concatenate([turned(0.0, 20.0, 40.0), turned(25.0, aside=aside)]))
        at = Trail(trail.turns, [0, 1, 2], [np.zeros(1)] * 3).at(3)
        shares.append(0.0 if at is None else at[1])
    assert shares[:2] == [1.0] * 2
    assert shares[-3:] == [0.0] * 3
    assert np.diff(shares).max() <= 0.0
    assert np.diff(shares).min() > -0.2


def test_a_fold_that_no_joint_bends_meets_nothing() -> None:
    trail = Trail.of(Lengths(np.zeros(3), np.ones(3), 1.0))
    for frame in range(3):
        assert trail.at(frame) is None
        trail.go_on(frame, np.zeros(1))
