"""Compression, and crests, as colours."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from kit.pictures import draw, limb, picture
from wrinklecli.gltf.document import read_document
from wrinklecli.review.preview.heat import HEAT, compression, crest_colours, heat_colours
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.shown import read_shown, take_snapshot

Floats = NDArray[np.float64]
Json = dict[str, Any]


@given(
    arrays.arrays(np.float64, (4, 3, 3), elements=st.floats(-1, 1)),
    arrays.arrays(np.float64, (3, 3), elements=st.floats(-2, 2)),
)
def test_compression_is_one_less_the_smallest_stretch_in_the_plane(corners: Floats, matrix: Floats) -> None:
    corners = corners * 0.2 + np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    losses = compression(corners, corners @ matrix.T)
    for triangle, loss in zip(corners, losses, strict=True):
        plane, _ = np.linalg.qr(np.stack([triangle[1] - triangle[0], triangle[2] - triangle[0]], axis=1))
        stretch = np.linalg.svd(matrix @ plane, compute_uv=False)[-1]
        assert loss == pytest.approx(max(1 - stretch, 0.0), abs=1e-6)


def test_a_triangle_without_area_at_rest_is_not_compressed() -> None:
    flat = np.array([[(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 0, 0)] * 3], float)
    assert not compression(flat, flat * 0.1).any()


def test_heat_shows_where_a_fold_compresses(tmp_path: Path) -> None:
    asset, _ = read_shown(read_document(limb(tmp_path)), "limb", [])
    rest, folded = (take_snapshot(asset, Moment("fold", time), heat=True) for time in (0.0, 1.0))
    cold = heat_colours(np.zeros(1))[0]
    assert np.ptp(rest.colours.reshape(-1, 3), axis=0).max() < 1e-6
    places = take_snapshot(asset, Moment(None, 0.0), heat=False).corners
    inside = (np.abs(places[..., 0]) < 0.1) & (places[..., 1] > 0.2)
    ends = np.abs(places[..., 0]) > 0.8
    blue = folded.colours[..., 2]
    assert blue[inside].max() < 0.2 * rest.colours[0, 0, 2]
    assert np.allclose(blue[ends], rest.colours[0, 0, 2])
    assert rest.colours[0, 0, 2] < cold[2], "linear"

    seen: Json = {"views": ["top"], "size": (160, 120), "focus": (0.0, 0.25, 0.0), "radius": 0.6}
    draw([tmp_path / "limb.glb"], tmp_path / "heat.png", times=(0.3,), heat=True, **seen)
    shown = picture(tmp_path / "heat.png")[:120].astype(int)
    warm = shown[..., 0] - shown[..., 2]
    hottest = np.argwhere(warm > 0.7 * warm.max())
    assert warm.max() > 60
    assert np.abs(hottest.mean(axis=0) - (60, 80)).max() < 12
    assert warm[60, [20, 150]].max() < 20, "the ends stay grey"


def test_crests_and_furrows_of_all_heights_have_colours() -> None:
    """Shapes rise together, so what one lowers as much as another raises it is plain."""
    shapes = np.zeros((2, 5, 3))
    shapes[:, :, 1] = [[1.0, 0.1, 0.0, -0.1, 1.0], [1.0, 0.1, 0.0, -0.1, -1.0]]
    red_first = crest_colours(shapes, np.array([[0.0, 1.0, 0.0]] * 5)) @ [1.0, 0.0, -1.0]
    assert red_first[0] > red_first[1] > 0.3 * red_first[0] > 0.0 > red_first[3]
    assert red_first[2] == red_first[4] == pytest.approx(0.0, abs=0.05)
    assert not np.ptp(crest_colours(np.zeros((1, 5, 3)), np.zeros((5, 3))), axis=0).any()


def test_the_legend_has_the_colours_of_the_heat() -> None:
    stops = [loss for loss, _ in HEAT]
    assert np.allclose(heat_colours(np.array(stops)), [colour for _, colour in HEAT])
    assert np.allclose(heat_colours(np.array([5.0])), HEAT[-1][1])
    assert (np.diff(heat_colours(np.linspace(0.1, 0.8, 50)).sum(axis=1)) < 0).all(), "darker all the way, in grey too"
