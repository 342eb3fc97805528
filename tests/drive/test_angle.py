"""The angle of a joint: turned about an axis it measures that turn, otherwise the twist of a quaternion."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.prepared import rig_of
from wrinklecli.character.clip import Channel, Clip
from wrinklecli.drive.angle import JointAngle, read_angle
from wrinklecli.numeric.arrays import Floats

NUMBERS = st.floats(-1.0, 1.0)
AXES = st.tuples(NUMBERS, NUMBERS, NUMBERS).filter(lambda each: np.linalg.norm(each) > 0.1)
TURNS = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS).filter(lambda each: np.linalg.norm(each) > 0.1)
SCALES = st.floats(0.1, 10.0)


def unit(values: Any) -> Floats:
    return np.asarray(values, np.float64) / np.linalg.norm(values)


def product(a: Floats, b: Floats) -> Floats:
    """The quaternion (x, y, z, w) of the turn b, then the turn a."""
    return np.append(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3]), a[3] * b[3] - a[:3] @ b[:3])


def measured(turned: Floats, axis: Floats, rest: Floats, above: Floats, scale: float, own: Any) -> float:
    """The angle of a joint of scale `own` that is turned by a quaternion from rest, under a turned, scaled parent."""
    parent = {"name": "parent", "rotation": above.tolist(), "scale": [scale] * 3, "children": [2]}
    joint = {"name": "joint", "rotation": rest.tolist(), "scale": list(own)}
    rig = rig_of({"mesh": 0}, parent, joint)
    channel = Channel(0, 2, "rotation", np.zeros(1), product(turned, rest)[None], "LINEAR")
    signal = JointAngle(node=2, parent=1, axis=axis, rest=rest)
    assert signal.angles(rig, None, np.zeros(1)).rows == pytest.approx([0.0], abs=1e-7)
    found = signal.angles(rig, Clip(-1, "turn", (channel,), 0.0, 0.0), np.zeros(1))
    assert found.active.all()
    assert found.turns[0] == pytest.approx(turned[:3] * np.sign(turned[3] or 1.0), abs=2e-4)
    return float(found.rows[0])


@given(AXES, st.floats(-3.1, 3.1), TURNS, TURNS, SCALES, st.tuples(SCALES, SCALES, SCALES))
def test_a_turn_about_the_axis_is_measured_whatever_rest_and_parent(
    axis: Any, angle: float, rest: Any, above: Any, scale: float, own: Any
) -> None:
    along = unit(axis)
    turned = np.append(np.sin(angle / 2.0) * along, np.cos(angle / 2.0))
    assert measured(turned, along, unit(rest), unit(above), scale, own) == pytest.approx(angle, abs=1e-6)


@given(AXES, TURNS.filter(lambda each: abs(each[3]) > 0.05), TURNS, TURNS, SCALES)
def test_of_any_other_turn_the_twist_about_the_axis_is_measured(
    axis: Any, turn: Any, rest: Any, above: Any, scale: float
) -> None:
    along, turned = unit(axis), unit(turn)
    twist = 2.0 * np.arctan2(np.sign(turned[3]) * (turned[:3] @ along), abs(turned[3]))
    assert measured(turned, along, unit(rest), unit(above), scale, (1, 1, 1)) == pytest.approx(twist, abs=1e-6)


def test_a_root_turns_against_the_world() -> None:
    rig = rig_of({"mesh": 0}, {"name": "joint"})
    channel = Channel(0, 1, "rotation", np.zeros(1), np.array([[0.0, 0.6, 0.0, 0.8]]), "LINEAR")
    signal = JointAngle(node=1, parent=-1, axis=np.array([0.0, 1.0, 0.0]), rest=np.array([0.0, 0.0, 0.0, 1.0]))
    found = signal.angles(rig, Clip(-1, "turn", (channel,), 0.0, 0.0), np.zeros(1))
    assert found.rows == pytest.approx([2.0 * np.arctan2(0.6, 0.8)])


@given(st.permutations(["hips", "spine", "arm"]), st.booleans(), AXES, TURNS)
def test_a_stored_joint_is_read_as_it_was(names: list[str], root: bool, axis: Any, rest: Any) -> None:
    """Whichever numbers its node and its parent have, the first of all among them."""
    numbers = {name: number for number, name in enumerate(names)}
    written = JointAngle(numbers["arm"], -1 if root else numbers["hips"], unit(axis), unit(rest))
    read = read_angle(written.to_json(names), numbers)
    assert (read.node, read.parent) == (written.node, written.parent)
    assert read.axis == pytest.approx(written.axis, abs=1e-6)
    assert read.rest == pytest.approx(written.rest, abs=1e-6)
