"""Several drives in one clip give what each gives alone, and rows of a clip are looked up in that clip."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.drive.angle import JointAngle
from wrinklecli.drive.drive import AnyDrive, Drive, Rows
from wrinklecli.drive.play import Playing, play_grid
from wrinklecli.drive.table import Table
from wrinklecli.drive.turned import TurnDrive
from wrinklecli.effects.wrinkle.effect import tool_drive
from wrinklecli.effects.wrinkle.lookup import curve_table

PATH = {"origin": None, "target": None, "path": [[-0.4, RADIUS, 0.0], [0.0, RADIUS, 0.0], [0.4, RADIUS, 0.0]]}
TOOLS: list[dict[str, Any]] = [
    {},
    {**PATH, "strategy": "origin"},
    {"lag": {"frequency": 4, "damping": 0.3}},
    {"rest_length": {"keys": {"fold": [[0, "90%"], [1.5, "130%"]]}}},
    {"rest_length": {"morph": "morph_1", "full": "140%"}, "strength": 0.5, "clips": {"fold": -0.25}},
]
ROWS = Rows(np.array([0.25, 0.5, 1.75]), np.array([[0.0, 1.0], [1.0, -0.5], [0.25, 0.0]]))


@cache
def limb() -> Prepared:
    """The limb with morph targets that move its anchors, and tools of all kinds of signals."""
    keys = [tool(name=f"tool{number}", **keys) for number, keys in enumerate(TOOLS)]
    tools = [{key: value for key, value in each.items() if value is not None} for each in keys]
    return prepare(limb_asset(rings=9, sides=8, morphs=2, morph_clip="LINEAR", weights_at="node"), *tools)


@cache
def drives() -> tuple[AnyDrive, ...]:
    """Drives of all these tools, one of a joint, one of two turns, and one with rows."""
    found = []
    for number, patch in enumerate(limb().patches):
        table = curve_table(patch.curve)
        names = tuple(f"wrinkle_{number}_{column}" for column in range(table.table.shape[1]))
        found.append(tool_drive(patch, names, table))
    joint = int(limb().rig.joints[1])
    angle = JointAngle(joint, int(limb().rig.parents[joint]), np.array([0.0, 0.0, 1.0]), np.array([0, 0, 0, 1.0]))
    table = Table("angles", np.array([-1.0, 0.0, 1.0]), np.array([[1.0], [0.0], [2.0]]))
    turned = Drive("", angle, ("turned",), table)
    turns = TurnDrive("", ((angle, table), (angle, table)), ("of_one", "of_other"))
    return (*found, turned, turns, replace(found[0], targets=("one", "other"), rows={"fold": ROWS}))


MOMENTS = st.lists(st.integers(0, 200).map(lambda each: each / 100.0), min_size=1, max_size=12, unique=True)


@given(
    chosen=st.lists(st.integers(0, len(TOOLS) + 2), max_size=5),
    moments=MOMENTS,
    chunk=st.sampled_from([1, 3, 4096]),
    stored=st.booleans(),
)
def test_drives_together_are_each_alone(chosen: list[int], moments: list[float], chunk: int, stored: bool) -> None:
    """Whatever is posed once for several, and however many times are posed at once."""
    rig, clip, times = limb().rig, None if stored else limb().clip, np.array(sorted(moments))
    some = [drives()[number] for number in chosen]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wrinklecli.numeric.portions.AT_ONCE", 32 * chunk)
        playing = Playing(some, rig, clip)
        found, together = playing.weights(playing.read(times)), playing.at(times)
    alone = [each.weights_in(rig, clip)(times) for each in some]
    for one, other in zip(found, alone, strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    assert together.shape == (len(times), sum(each.shape[1] for each in alone))
    if alone:
        assert together == pytest.approx(np.concatenate(alone, axis=1), abs=1e-12)


@given(moments=MOMENTS)
def test_rows_of_a_clip_are_looked_up_in_that_clip(moments: list[float]) -> None:
    times = np.array(sorted(moments))
    drive = drives()[-1]
    found = Playing([drive], limb().rig, limb().clip).at(times)
    wanted = np.stack([np.interp(times, ROWS.times, column) for column in ROWS.weights.T], axis=1)
    assert found == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("named", ["other", None])
def test_rows_of_a_clip_are_nothing_in_others(named: str | None) -> None:
    """There the signal counts, and without one the weights are 0."""
    rig, times = limb().rig, np.linspace(0.0, 2.0, 41)
    clip = None if named is None else replace(limb().clip, name=named)
    first, rowed = drives()[0], drives()[-1]
    assert isinstance(rowed, Drive)
    measured = Playing([first], rig, clip).at(times)
    assert (named is None) == (not measured.any())
    assert (Playing([rowed], rig, clip).at(times) == measured).all()
    unmeasured = replace(rowed, signal=None)
    assert not unmeasured.measures
    assert not Playing([unmeasured], rig, clip).at(times).any()
    assert Playing([unmeasured], rig, clip).at(times).shape == (41, 2)
    assert Playing([unmeasured], rig, limb().clip).at(times).any()


def test_the_grid_has_the_corners_of_all_drives() -> None:
    grid = play_grid(drives(), limb().rig, limb().clip, fps=3.0)
    assert set(np.float32([0.0, 1.5, *ROWS.times])) <= set(np.float32(grid))
    other = play_grid(drives(), limb().rig, replace(limb().clip, name="other"), fps=3.0)
    assert not set(np.float32(ROWS.times)) & (
        set(np.float32(other)) - set(np.float32(play_grid([], limb().rig, limb().clip, fps=3.0)))
    )
