"""Cameras: what they see, and what views are called."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from wrinklecli.review.preview.camera import VIEWS, Camera, camera_axes, parse_view

Floats = NDArray[np.float64]


@given(arrays.arrays(np.float64, (20, 3), elements=st.floats(-5, 5)), st.floats(-180, 180), st.floats(-90, 90))
def test_a_framing_camera_sees_all_points(points: Floats, azimuth: float, elevation: float) -> None:
    points = points + np.arange(20)[:, None] * (0.1, 0.05, 0.02)
    camera = Camera.framing(points, camera_axes(azimuth, elevation), aspect=4 / 3, margin=1.0)
    seen = camera.project(points, (800, 600))
    assert (seen > -0.5).all()
    assert (seen < (800.5, 600.5)).all()
    # As close as that allows: one is at the border.
    assert min(seen.min(), (800 - seen[:, 0]).min(), (600 - seen[:, 1]).min()) < 0.5


@pytest.mark.parametrize("text", ["", "nose", "10", "10:", ":5", "1e9:0", "0:91", "nan:0", "0:inf", "1:2:3"])
def test_a_view_that_is_none_is_said(text: str) -> None:
    with pytest.raises(ValueError, match="none of facing, front"):
        parse_view(text)


@pytest.mark.parametrize("name", VIEWS)
def test_a_view_sees_the_side_that_it_is_named_for(name: str) -> None:
    back = camera_axes(*parse_view(name))[2]
    sides = {"front": (0, 0, 1), "right": (1, 0, 0), "back": (0, 0, -1), "left": (-1, 0, 0), "top": (0, 1, 0)}
    expected = sides.get(name, (0, -1, 0) if name == "bottom" else back)
    assert back @ np.array(expected, float) == pytest.approx(1.0, abs=1e-4)
