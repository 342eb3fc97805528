"""The axis about which tools over one joint fold it."""

from dataclasses import replace

import numpy as np
import pytest

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.effects.contact.hinge import STRIDE, hinge_of


def axis_of(prepared: Prepared, *numbers: int, turned: np.ndarray) -> np.ndarray:
    """The axis about which some tools fold a limb, whose joint is turned by a (4,) quaternion."""
    joint = prepared.rig.names.index("joint_1")
    stored = [dict(each) for each in prepared.rig.locals]
    stored[joint]["rotation"] = turned
    rig = replace(prepared.rig, locals=stored)
    patches = [prepared.patches[number] for number in numbers]
    return hinge_of(joint, patches, np.zeros(3), rig).signal.axis


def quaternion(axis: np.ndarray, degrees: float) -> np.ndarray:
    half = np.radians(degrees) / 2.0
    return np.append(np.sin(half) * axis / np.linalg.norm(axis), np.cos(half))


@pytest.mark.parametrize("width", ["10%", "40%"])
def test_a_slanting_tool_turns_the_axis_by_its_share_of_the_area(width: str) -> None:
    y, z = 0.8 * RADIUS, 0.6 * RADIUS
    slanting = tool(name="slanting", origin=[-0.4, y, z], target=[0.4, y, -z], width=width)
    prepared = prepare(limb_asset(rings=9, sides=8), tool(name="level", width="40%"), slanting)
    askew = quaternion(np.array([1.0, 1.0, 1.0]), 60.0)

    level, slant = (axis_of(prepared, number, turned=askew) for number in (0, 1))
    share = np.divide(*(patch.span * patch.half_width for patch in prepared.patches[::-1]))
    between = level + share * np.copysign(1.0, level @ slant) * slant
    assert 5.0 < np.degrees(np.arccos(abs(level @ slant))) < 45.0
    for numbers in ((0, 1), (1, 0)):
        found = axis_of(prepared, *numbers, turned=askew)
        assert abs(found @ between) / np.linalg.norm(between) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(("off", "is_own"), [(0.0, True), (18.0, True), (22.0, False)])
def test_the_axis_is_one_of_the_joints_own_where_one_is_near(off: float, *, is_own: bool) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool())
    guess = axis_of(prepared, 0, turned=quaternion(np.array([1.0, 1.0, 1.0]), 60.0))
    found = axis_of(prepared, 0, turned=quaternion(np.array([0.0, 1.0, 0.0]), off))

    assert guess == pytest.approx([0.0, 0.0, np.sign(guess[2])], abs=1e-6)
    degrees = np.degrees(np.arccos(np.clip(found @ guess, -1.0, 1.0)))
    assert degrees == pytest.approx(off if is_own else 0.0, abs=1e-3)


@pytest.mark.parametrize("degrees", [(-80.0, 0.0), (-10.0, 100.0), (0.0, 35.0)])
def test_the_sweeps_of_a_hinge_go_to_its_ends_in_strides(degrees: tuple[float, float]) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool())
    hinge = hinge_of(prepared.rig.names.index("joint_1"), prepared.patches, np.zeros(3), prepared.rig)
    least, most = np.radians(degrees)
    hinge = replace(hinge, least=least, most=most)
    ends = [end for end in (least, most) if end]
    for (clip, times), end in zip(hinge.sweeps, ends, strict=True):
        reading = hinge.reading(prepared.rig, clip, times)
        assert reading.rows[[0, -1]] == pytest.approx([0.0, end], abs=1e-9)
        assert np.abs(np.diff(reading.rows)).max() < 1.001 * STRIDE
        assert reading.turns == pytest.approx(np.sin(reading.rows / 2.0)[:, None] * hinge.signal.axis, abs=1e-9)
