"""Tissue that lags: a limb whose wrinkles come late, swing, and rest; and clips that go round."""

from typing import Any

import numpy as np
import pytest

from kit.limb import limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.effects.wrinkle.activity import Activity, activity
from wrinklecli.effects.wrinkle.bending import rising
from wrinklecli.numeric.arrays import Floats


def bent(*angles: float, **tool_options: Any) -> Prepared:
    """A limb that turns its inner joint to degrees, one every half second."""
    asset = limb_asset(rings=9, sides=8, clip=None)
    animation: dict[str, Any] = {"name": "bend"}
    halves = np.radians(angles) / 2.0
    turns = np.stack([0 * halves, 0 * halves, np.sin(halves), np.cos(halves)], axis=1)
    joint = next(index for index, node in enumerate(asset.gltf["nodes"]) if node.get("name") == "joint_1")
    asset.channel(animation, joint, "rotation", (0.5 * np.arange(len(angles))).tolist(), turns.tolist())
    asset.append("animations", animation)
    return prepare(asset, tool(max_height="none", **tool_options))


def seen(prepared: Prepared, times: Floats) -> tuple[Activity, Floats]:
    """What the tool does, and the heights of its first group."""
    found = activity(prepared.patch, prepared.rig, prepared.clip, times)
    return found, found.amplitudes[:, 0, 0]


TIMES = np.linspace(0.0, 2.5, 501)


@pytest.mark.parametrize("damping", [0.3, 1.0, 2.0])
def test_wrinkles_come_late_and_swing_if_little_damped(damping: float) -> None:
    angles = (0, 0, 80, 80, 80, 80)
    at_once, wanted = seen(bent(*angles), TIMES)
    late, heights = seen(bent(*angles, lag={"frequency": 4, "damping": damping}), TIMES)
    assert heights[0] == wanted[0] == 0
    assert heights.min() == 0
    moving = (TIMES > 0.52) & (TIMES < 0.9)
    assert (heights[moving] < wanted[moving]).all()
    overshoot = late.shortenings.max() / at_once.shortenings.max()
    assert (overshoot > 1.01) if damping < 1 else (overshoot <= 1.0 + 1e-9)
    assert heights[-1] == pytest.approx(wanted[-1], rel=2e-3)
    assert (late.shortenings <= late.rest_lengths).all()


def test_what_is_asked_for_at_once_is_what_is_asked_for_one_by_one() -> None:
    prepared = bent(0, 60, 0, 30, lag={"frequency": 6, "damping": 0.3})
    few = TIMES[::50]
    assert np.concatenate([seen(prepared, few[k : k + 1])[1] for k in range(len(few))]) == pytest.approx(
        seen(prepared, few)[1], abs=1e-12
    )


def test_a_clip_that_ends_as_it_begins_goes_round() -> None:
    lag = {"frequency": 3, "damping": 0.2}
    loop, other = bent(40, 90, 40, lag=lag), bent(40, 90, 41, lag=lag)
    assert (loop.clip.loops, other.clip.loops) == (True, False)
    edge = np.array([0.0, 1e-3, 1.0 - 1e-3, 1.0])
    distances = seen(loop, edge)[0].distances
    assert distances[3] == pytest.approx(distances[0], abs=1e-9)
    assert distances[1] - distances[0] == pytest.approx(distances[3] - distances[2], rel=0.05)
    # The other begins at rest, as it is held there.
    held = activity(other.patch, other.rig, other.clip, np.array([-1.0, 0.0, 1e-4]))
    assert held.distances == pytest.approx(held.distances[0], abs=1e-5)


def test_shapes_and_the_stored_pose_know_nothing_of_it() -> None:
    plain, lagging = bent(0, 80), bent(0, 80, lag={"frequency": 0.5, "damping": 5})
    poses = [rising(each.patch, each.rig, each.rest)[-1].pose for each in (plain, lagging)]
    assert poses[0].matrices == pytest.approx(poses[1].matrices, abs=0)
    stored = [activity(each.patch, each.rig, None, np.zeros(1)).distances for each in (plain, lagging)]
    assert stored[0] == stored[1]
