"""The drive of a touch in extras."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.drive.drive import StoredDrive

ANCHOR = {"joints": ["hand"], "weights": [1.0], "positions": [[0.0, 0.0, 0.0]], "scales": [1.0]}
PALM = {
    "name": "palm",
    "anchors": [ANCHOR] * 4,
    "pad": 1.0,
    "grip": 1.0,
    "deepest": 1.0,
    "bend": [0.0, 0.0, 0.0],
    "release": {"frequency": 4.0, "damping": 1.0},
    "rises": [[0.0, 0.0], [1.0, 1.0]],
}


@given(st.lists(st.floats(-3.0, 3.0), max_size=4), st.booleans(), st.integers(-9, 9))
def test_a_touch_has_a_target_for_each_of_its_shapes(windows: list[float], limb: bool, more: int) -> None:
    """Four slides and a dent, one for each window, and eight that a limb's bend changes."""
    count = 5 + len(windows) + 8 * limb
    targets = [f"wrinkle_palm_{k}" for k in range(count + more)]
    data: dict[str, Any] = {**PALM, "windows": windows, "targets": targets} | ({"limb": [ANCHOR] * 2} if limb else {})
    if more == 0:
        assert len(StoredDrive.read(data).targets) == count
    else:
        with pytest.raises(ValueError):  # noqa: PT011  # it has no words: who reads extras says where they are
            StoredDrive.read(data)
