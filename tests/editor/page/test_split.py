"""A split view: which side of the eye's plane a vertex is on decides between two states, and a line shows the cut."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from viser import transforms

from wrinklecli.editor.page.split import SplitPlane
from wrinklecli.numeric.arrays import Floats

GRID = np.stack([*np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), np.zeros((9, 9))], axis=2).reshape(-1, 3)
CORNERS = np.arange(81).reshape(9, 9)
TRIANGLES = np.stack([CORNERS[:-1, :-1], CORNERS[:-1, 1:], CORNERS[1:, :-1]], axis=2).reshape(-1, 3)


def camera(position: Any = (0.0, 0.0, 4.0), **others: Any) -> Any:
    """A camera that looks along -z, with y upwards, and sees 2 scene units on either side of the origin."""
    down = transforms.SO3.from_matrix(np.diag([1.0, -1.0, -1.0])).wxyz
    known = {
        "wxyz": down,
        "position": np.array(position),
        "fov": 2 * np.arctan(0.25),
        "image_width": 200,
        "image_height": 100,
    }
    return SimpleNamespace(**{**known, **others})


@pytest.mark.parametrize(("share", "x"), [(0.5, 0.0), (0.25, -1.0), (0.6, 0.4), (1.0, 2.0)])
def test_the_plane_is_where_the_slider_is_on_the_screen(share: float, x: float) -> None:
    plane = SplitPlane.seen_by(camera(), share)
    assert plane is not None
    assert plane.distances(np.array([[x, 0.0, 0.0], [x, -1.0, 0.0]])) == pytest.approx(0.0, abs=1e-12)
    assert plane.distances(np.array([[x + 0.1, 0.0, 0.0]])) > 0


def test_each_side_shows_its_state() -> None:
    plane = SplitPlane.seen_by(camera(), 0.55)
    assert plane is not None
    raised: Floats = GRID + np.array([0.0, 0.0, 0.1])
    shown = plane.between(GRID, raised)
    assert (shown[:, 2] == np.where(GRID[:, 0] > 0.2, 0.1, 0.0)).all()


def test_the_line_runs_along_the_cut_before_the_surface() -> None:
    plane = SplitPlane.seen_by(camera(), 0.53)
    assert plane is not None
    segments = plane.cut(GRID, TRIANGLES)
    assert segments.shape == (8, 2, 3)
    assert plane.distances(segments.reshape(-1, 3)) == pytest.approx(0.0, abs=1e-12)
    assert (segments[..., 2] > 0).all()
    assert plane.cut(GRID + np.array([5.0, 0.0, 0.0]), TRIANGLES).shape == (0, 2, 3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"position": [np.nan, 0, 0]},
        {"fov": np.nan},
        {"image_height": 0, "image_width": 0, "wxyz": np.zeros(4)},
        {"wxyz": np.array([np.nan] * 4)},
    ],
)
def test_a_camera_that_sees_nothing_splits_nothing(wrong: Any) -> None:
    with np.errstate(all="ignore"):
        assert SplitPlane.seen_by(camera(**wrong), 0.3) is None
