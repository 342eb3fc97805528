"""The grid: coordinates are read off it as they are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.limb import LENGTH
from kit.pictures import covered, draw, limb, picture
from wrinklecli.gltf.document import read_document
from wrinklecli.review.preview.framing import plan_views
from wrinklecli.review.preview.grid import _SPACE, draw_grid, ruler_step
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.overlay import placed_words
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.rays import first_hits, trace
from wrinklecli.review.preview.shown import read_shown

SIZE = (400, 300)
REST = Moment(None, 0.0)


@given(span=st.floats(1e-6, 1e9), count=st.integers(2, 40))
def test_steps_are_round_and_no_more_than_there_is_room_for(span: float, count: int) -> None:
    step = ruler_step(span, count)
    assert float(f"{step:.0e}") == pytest.approx(step, rel=1e-9)
    assert f"{step:.0e}"[0] in "125"
    assert span / step <= count * (1 + 1e-6)
    assert span / step > count / 5 / (1 + 1e-6)


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("view", ["front", "back", "right", "top", "bottom", "90:0"])
def test_labels_stand_where_their_coordinates_are(tmp_path: Path, view: str, up: str) -> None:
    shown, _ = read_shown(read_document(limb(tmp_path, rings=3, sides=4)), "", ())
    options = PreviewOptions(grid=True, views=[view], size=SIZE, focus=(0.1, 0.05, -0.2), radius=0.8)
    ((camera,),) = (each.cameras for each in plan_views([shown], [REST], options))
    grid = draw_grid(shown, REST, camera, SIZE, up=up)
    names = [label.text for label in grid.labels if label.text[1:] in ("x", "y", "z")]
    numbers = [label for label in grid.labels if label.text not in names]
    axes = {"y": np.eye(3), "z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])}[up]
    assert len(names) == 2
    for anchor, name in (("ms", names[0]), ("lm", names[1])):
        found = [label for label in numbers if label.anchor == anchor]
        assert len(found) >= 2
        for label in found:
            # However deep it lies.
            for depth in (-1.0, 1.0):
                place = camera.centre + depth * camera.axes[2]
                axis = axes["xyz".index(name[1])]
                place = place + (float(label.text) - place @ axis) * axis
                at = camera.project(place, SIZE)[0 if anchor == "ms" else 1]
                assert at == pytest.approx(label.at[0 if anchor == "ms" else 1], abs=0.01)


def test_joints_are_named_where_they_are_then(tmp_path: Path) -> None:
    shown, _ = read_shown(read_document(limb(tmp_path, rings=3, sides=4, joints=3)), "", ())
    options = PreviewOptions(grid=True, views=["front"], size=SIZE)
    for moment in (REST, Moment("fold", 1.0)):
        ((camera,),) = (each.cameras for each in plan_views([shown], [moment], options))
        overlay = draw_grid(shown, moment, camera, SIZE, up="y")
        words = {word.text: word.place for word in overlay.words}
        assert words["joint_0"] == pytest.approx([-LENGTH / 2, 0.0, 0.0])
        assert words["joint_1"] == pytest.approx([-LENGTH / 6, 0.0, 0.0])
        straight = bool(abs(words["joint_2"][1]) < 1e-6)
        assert straight == (moment is REST)
        named = {*words, *(label.text for label in overlay.labels)}
        assert {word.text for word in placed_words(overlay, camera, SIZE)} == named


def test_parallel_rays_show_lengths_alike_at_every_depth() -> None:
    square = np.array(
        [[[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0]], [[-0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]]]
    )
    normals = np.tile([0.0, 0.0, 1.0], (2, 3, 1))
    counts = []
    for depth in (-3.0, 0.5):
        surface = trace(square + np.array([0.0, 0.0, depth]), normals, 0.0)
        counts.append(len(first_hits(surface, (60, 40), 0, np.arange(2400), np.zeros((1, 2))).pixels))
    assert counts == [400, 400], "of 20 × 20 pixels, where the picture is two units high"


def test_a_grid_is_drawn_from_any_side(tmp_path: Path) -> None:
    options: dict[str, Any] = {"grid": True, "size": (200, 150), "labels": [" "]}
    draw([limb(tmp_path)], tmp_path / "a.png", views=["front", "oblique"], **options)
    shown = picture(tmp_path / "a.png")
    assert shown.shape == (150, 404, 3)
    draw([limb(tmp_path)], tmp_path / "b.png", views=["front"], rest=True, size=(200, 150), labels=[" "])
    plain = picture(tmp_path / "b.png")
    assert covered(shown[:, :200]).sum() > covered(plain).sum() + 500


@pytest.mark.parametrize("size", [(400, 300), (400, 900)])
def test_numbers_of_the_upright_edge_have_room(tmp_path: Path, size: tuple[int, int]) -> None:
    asset = limb(tmp_path, rings=3, sides=4, angle=90.0)
    shown, _ = read_shown(read_document(asset), "", ())
    options = PreviewOptions(grid=True, views=["30:10"], size=size)
    moment = Moment("fold", 1.0)
    ((camera,),) = (each.cameras for each in plan_views([shown], [moment], options))
    overlay = draw_grid(shown, moment, camera, size, up="y")
    places = np.array([word.place for word in overlay.words if word.text.lstrip("-").replace(".", "").isdigit()])
    # The last numbers are its own; below them may be one of the floor.
    edge = places[(np.abs(places - places[-1]) < 1e-9)[:, [0, 2]].all(axis=1)][1:]
    gaps = np.abs(np.diff(camera.project(edge, size)[:, 1]))
    assert len(edge) >= 3
    assert 0.95 * _SPACE < gaps.min() <= gaps.max() < 2.6 * _SPACE
