"""The axis about which tools over one joint fold it."""

import numpy as np
import pytest

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.method.hinge import hinge_of


@pytest.mark.parametrize("width", ["10%", "40%"])
def test_a_slanting_tool_turns_the_axis_by_its_share_of_the_area(width: str) -> None:
    y, z = 0.8 * RADIUS, 0.6 * RADIUS
    slanting = tool(name="slanting", origin=[-0.4, y, z], target=[0.4, y, -z], width=width)
    prepared = prepare(limb_asset(rings=9, sides=8), tool(name="level", width="40%"), slanting)
    joint = prepared.rig.names.index("joint_1")

    def axis(*numbers: int) -> np.ndarray:
        patches = [prepared.patches[number] for number in numbers]
        return hinge_of(joint, patches, np.zeros(3), prepared.rig, prepared.rest).axis

    level, slant = axis(0), axis(1)
    share = np.divide(*(patch.span * patch.half_width for patch in prepared.patches[::-1]))
    between = level + share * np.copysign(1.0, level @ slant) * slant
    assert 5.0 < np.degrees(np.arccos(abs(level @ slant))) < 45.0
    for found in (axis(0, 1), axis(1, 0)):
        assert abs(found @ between) / np.linalg.norm(between) == pytest.approx(1.0, abs=1e-9)
