"""Triangles to a picture: what hides, shades, colours and marks what."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.limb import tool, write_tools
from kit.pictures import SIZE, covered, draw, limb, picture, reds
from wrinklecli.character.paints import Texture
from wrinklecli.review.preview import render
from wrinklecli.review.preview.camera import Camera, camera_axes
from wrinklecli.review.preview.draw import Mark, Outline
from wrinklecli.review.preview.preview_options import Style
from wrinklecli.review.preview.render import Opacities, Snapshot


def square(
    *, half: float = 0.5, at: float = 0.0, colour: Sequence[float] = (1, 1, 1), flipped: bool = False, **more: Any
) -> Snapshot:
    """A square across the z axis that faces +z."""
    corners = np.array([(-half, -half, at), (half, -half, at), (half, half, at), (-half, half, at)])
    triangles = np.array([(0, 1, 2), (0, 2, 3)])
    triangles = triangles[:, ::-1] if flipped else triangles
    shape = (2, 3)
    return Snapshot(
        corners=corners[triangles],
        normals=np.tile([0.0, 0.0, -1.0 if flipped else 1.0], (*shape, 1)),
        colours=np.tile(np.array(colour, float), (*shape, 1)),
        coordinates=(corners[triangles][..., :2] * (1, -1) + half) / (2 * half),
        texture_numbers=np.full(2, 0 if "textures" in more else -1),
        **more,
    )


def both(*frames: Snapshot) -> Snapshot:
    """Frames together, without textures and marks."""
    keys = ("corners", "normals", "colours", "coordinates", "texture_numbers")
    return Snapshot(*(np.concatenate([getattr(frame, key) for frame in frames]) for key in keys))


HEAD_ON = Camera(np.zeros(3), camera_axes(0.0, 0.0), 1.0)


@pytest.mark.parametrize("size", [(64, 48), (48, 64), (61, 35)])
def test_a_silhouette_is_where_the_camera_projects_it(size: tuple[int, int]) -> None:
    frame = square(half=0.4)
    shown = covered(render.render(frame, HEAD_ON, size=size))
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    left, top = HEAD_ON.project(np.array([-0.4, 0.4, 0.0]), size)
    right, bottom = HEAD_ON.project(np.array([0.4, -0.4, 0.0]), size)
    found = (columns[0], columns[-1] + 1, rows[0], rows[-1] + 1)
    assert np.abs(np.array(found) - (left, right, top, bottom)).max() <= 1
    assert shown[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all(), "a crack along the diagonal"


def test_what_is_nearer_hides_what_is_behind_it() -> None:
    red, green = square(half=0.2, at=0.5, colour=(0.8, 0, 0)), square(half=0.8, at=-0.5, colour=(0, 0.8, 0))
    shown = render.render(both(green, red), HEAD_ON, size=SIZE)
    middle, edge = shown[30, 40].astype(int), shown[30, 18].astype(int)
    assert middle.argmax() == 0
    assert edge.argmax() == 1


def test_what_stands_before_a_surface_darkens_it() -> None:
    wall = square(half=0.9)
    alone = render.render(wall, HEAD_ON, size=SIZE).astype(int)
    # Up and to the left, towards the light, a little before the wall.
    post = replace(square(half=0.15), corners=square(half=0.15).corners + np.array((-0.2, 0.2, 0.2)))
    shaded = render.render(both(wall, post), HEAD_ON, size=SIZE).astype(int)
    fall = (alone - shaded).sum(axis=2)
    assert fall[31, 40] > 100
    assert abs(fall[50, 60]) < 30


def test_a_picture_does_not_depend_on_the_bands_it_is_drawn_in(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = both(square(half=0.8, at=-0.3), square(half=0.3, at=0.3))
    whole = render.render(frame, HEAD_ON, size=SIZE, style=Style(wire=True))
    monkeypatch.setattr("wrinklecli.numeric.portions.AT_ONCE", 3000)
    parts = render.render(frame, HEAD_ON, size=SIZE, style=Style(wire=True))
    assert np.abs(whole.astype(int) - parts).max() <= 1


def test_scale_and_place_of_a_scene_do_not_matter() -> None:
    frame = both(square(half=0.8, at=-0.3), square(half=0.3, at=0.3))
    base = render.render(frame, HEAD_ON, size=SIZE).astype(int)
    for scale, moved in ((1e-4, 0.0), (1e5, 0.0), (1.0, 1000.0)):
        there = np.array([moved, -moved, moved])
        other = render.render(
            replace(frame, corners=frame.corners * scale + there), Camera(there, HEAD_ON.axes, scale), size=SIZE
        )
        assert np.abs(base - other).mean() < 0.1


def test_a_texture_colours_its_surface_the_right_way_up_and_goes_on_as_it_says() -> None:
    # Red and green above, blue and white below.
    pixels = np.array([[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]], np.uint8)
    for wraps, right in (
        (("repeat", "repeat"), "red"),
        (("mirror", "repeat"), "green"),
        (("clamp", "repeat"), "green"),
    ):
        frame = square(half=0.9, textures=(Texture(pixels.repeat(8, 0).repeat(8, 1), wraps),))
        shown = render.render(frame, HEAD_ON, size=SIZE).astype(int)
        assert shown[12, 22].argmax() == 0
        assert shown[12, 58].argmax() == 1
        assert shown[48, 22].argmax() == 2
        assert np.ptp(shown[48, 58]) < 30
        # Moved by a whole, the right half lies beyond the image's border.
        moved = replace(frame, coordinates=frame.coordinates + np.array((0.5, 0.0)))
        there = render.render(moved, HEAD_ON, size=SIZE).astype(int)[12, 58]
        assert there.argmax() == ("red", "green").index(right)


def test_triangles_seen_from_behind_are_painted_red_on_demand() -> None:
    style = Style(backfaces=True)
    assert not reds(render.render(square(), HEAD_ON, size=SIZE, style=style))
    assert reds(render.render(square(flipped=True), HEAD_ON, size=SIZE, style=style)) > 500


def test_wires_are_drawn_along_the_edges() -> None:
    plain, wired = (render.render(square(), HEAD_ON, size=SIZE, style=Style(wire=wire)) for wire in (False, True))
    fall = plain.astype(int).sum(axis=2) - wired.astype(int).sum(axis=2)
    assert fall[30, 40] > 50, "the diagonal"
    assert abs(fall[22, 44]) < 3, "the middle of a triangle"


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 60.0])
def test_a_mark_has_an_outline_a_segment_and_ends_of_even_width_on_any_slope(turn: float) -> None:
    frame = square(half=0.9)
    mark = Mark(
        name="",
        triangles=np.array([0, 1]),
        inside=np.array([True, True]),
        places=frame.corners[..., [1, 0]] + (0.5, 0.0),
        span=1.0,
        half_width=0.4,
        colour=(0.9, 0.0, 0.0),
    )
    camera = Camera(np.zeros(3), camera_axes(turn, 0.0), 1.0)
    size = (400, 300)
    shown = render.render(replace(frame, marks=(mark,)), camera, size=size).astype(int)
    bare = render.render(frame, camera, size=size).astype(int)
    drawn = (bare - shown)[..., 1] > 60
    across = np.flatnonzero(drawn[150])
    lines = np.split(across, np.flatnonzero(np.diff(across) > 1) + 1)
    expected = camera.project(np.array([(-0.4, 0, 0), (0, 0, 0), (0.4, 0, 0)]), size)[:, 0]
    assert [round(float(line.mean()) + 0.5) for line in lines] == pytest.approx(expected, abs=1.5)
    assert {len(line) for line in lines} <= {2, 3}
    for y, filled, outside in ((-0.5, True, slice(2, 5)), (0.5, False, slice(-6, -3))):
        column, row = camera.project(np.array([0.0, y, 0.0]), size).round().astype(int)
        assert drawn[row - 1, column - 1] == filled, "a dot at the origin, a ring at the target"
        rows = slice(row + outside.start, row + outside.stop)
        assert drawn[rows, column - 1 : column + 1].any(), "round, beyond the outline too"


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 60.0])
def test_an_outline_has_an_even_width_on_any_slope(turn: float) -> None:
    """Skin inside it is tinted."""
    frame = square(half=0.9)
    mark = Outline("", np.array([0, 1]), 0.4 - frame.corners[..., 0], (0.9, 0.0, 0.0))
    camera = Camera(np.zeros(3), camera_axes(turn, 0.0), 1.0)
    size = (400, 300)
    fall = render.render(frame, camera, size=size).astype(int) - render.render(
        replace(frame, marks=(mark,)), camera, size=size
    ).astype(int)
    line = np.flatnonzero(fall[150, :, 1] > 60)
    at, inside, outside = camera.project(np.array([(0.4, 0, 0), (0.2, 0, 0), (0.6, 0, 0)]), size)[:, 0]
    assert round(float(line.mean()) + 0.5) == pytest.approx(at, abs=1.5)
    assert len(line) in (2, 3)
    assert 3 < fall[150, round(inside), 1] < 40
    assert not fall[150, round(outside)].any()


@pytest.mark.slow
@pytest.mark.long
def test_a_mark_has_a_line_on_each_crest() -> None:
    frame = square(half=0.9)
    places = frame.corners[..., [1, 0]] + (0.9, 0.0)
    mark = Mark(
        name="",
        triangles=np.array([0, 1]),
        inside=np.array([True, True]),
        places=places,
        span=1.8,
        half_width=0.8,
        colour=(0.9, 0.0, 0.0),
        phases=3.0 * places[..., 0] / 1.8,
    )
    shown, bare = (
        render.render(each, HEAD_ON, size=(400, 300)).astype(int) for each in (replace(frame, marks=(mark,)), frame)
    )
    # Beside the segment.
    column = round(float(HEAD_ON.project(np.array([0.4, 0.0, 0.0]), (400, 300))[0]))
    drawn = np.flatnonzero((bare - shown)[:, column, 1] > 40)
    lines = np.split(drawn, np.flatnonzero(np.diff(drawn) > 1) + 1)
    expected = HEAD_ON.project(np.array([(0.4, y, 0) for y in (0.9, 0.6, 0.0, -0.6, -0.9)]), (400, 300))[:, 1]
    assert [float(line.mean()) + 0.5 for line in lines] == pytest.approx(expected.tolist(), abs=1.5)
    unmarked = replace(mark, phases=np.full(mark.phases.shape, np.nan) if mark.phases is not None else None)
    plain = render.render(replace(frame, marks=(unmarked,)), HEAD_ON, size=(400, 300)).astype(int)
    assert ((bare - plain)[:, column, 1] > 40).sum() < len(drawn)


@pytest.mark.slow
def test_light_ends_on_a_coarse_mesh_that_is_refined_where_it_did_before(tmp_path: Path) -> None:
    asset = limb(tmp_path, rings=7, sides=7)
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=4, width=0.9))
    draw(
        [asset],
        tmp_path / "a.png",
        tools=tools,
        before=True,
        hide_tools=True,
        rest=True,
        views=["120:20"],
        size=(200, 150),
        labels=[" ", " "],
        style=Style(clay=True),
    )
    shown = picture(tmp_path / "a.png").astype(int)
    assert np.abs(shown[20:, :200] - shown[20:, 204:]).max() <= 4


def test_what_alpha_cuts_out_shows_what_is_behind() -> None:
    holes = np.zeros((2, 2, 1), np.uint8)
    holes[0, 0] = holes[1, 1] = 255
    texture = Texture(holes.repeat(32, 0).repeat(32, 1))
    back, front = square(half=0.5, at=-0.2, colour=(1, 0, 0)), square(half=0.5, colour=(0, 0, 1))
    frame = both(back, front)
    cutoffs, numbers = np.array([0.0, 0.0, 0.5, 0.5]), np.array([-1, -1, 0, 0])
    opacities = Opacities(np.ones((4, 3)), cutoffs, frame.coordinates, numbers, (texture,))
    shown = render.render(replace(frame, opacities=opacities), HEAD_ON, size=(64, 64)).astype(int)
    for (row, column), way in {(24, 24): 2, (40, 40): 2, (24, 40): 0, (40, 24): 0}.items():
        assert shown[row, column, way] > shown[row, column, 2 - way] + 60
    # Light falls through, too: no holes of a shadow on what is behind.
    assert np.array_equal(opacities.whole(), [True, True, False, False])
    assert not covered(render.render(seen_through(front, 0.45, cutoff=0.5), HEAD_ON, size=(64, 64))).any()


def seen_through(frame: Snapshot, *alphas: float, cutoff: float = np.inf) -> Snapshot:
    """A frame of squares with an alpha each."""
    count, each = 2 * len(alphas), np.repeat(alphas, 2)
    corners, cutoffs = np.repeat(each[:, None], 3, axis=1), np.full(count, cutoff)
    return replace(frame, opacities=Opacities(corners, cutoffs, frame.coordinates, np.full(count, -1), ()))


@pytest.mark.quick(1)
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_what_is_behind_blended_triangles_shows_through_them(order: Sequence[int]) -> None:
    squares = [
        square(half=0.5, at=0.3 * way, colour=colour)
        for way, colour in enumerate([(0.8, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.8)])
    ]
    alphas = [1.0, 0.25, 0.6]
    middle = (32, 32)
    single = [render.render(each, HEAD_ON, size=(64, 64))[middle].astype(float) for each in squares]
    together = seen_through(both(*(squares[k] for k in order)), *(alphas[k] for k in order))
    shown = render.render(together, HEAD_ON, size=(64, 64))[middle]
    wanted = np.zeros(3)
    for colour, alpha in zip(single, alphas, strict=True):
        wanted = alpha * colour + (1.0 - alpha) * wanted
    assert shown == pytest.approx(wanted, abs=6.0)
    nothing = seen_through(both(*squares), 0.0, 0.001, 0.0)
    assert not covered(render.render(nothing, HEAD_ON, size=(64, 64))).any()
    whole = seen_through(both(*squares), 1.0, 1.0, 1.0)
    assert np.array_equal(*(render.render(each, HEAD_ON, size=(64, 64)) for each in (whole, both(*squares))))


@pytest.mark.parametrize("clay", [False, True])
def test_a_texture_finer_than_pixels_is_mixed_in_each_of_them(clay: bool) -> None:
    stripes = np.zeros((1, 4 * SIZE[0], 3), np.uint8)
    stripes[:, ::2] = 255
    shown = render.render(square(half=0.9, textures=(Texture(stripes),)), HEAD_ON, size=SIZE, style=Style(clay=clay))
    inside = shown[20:40, 30:50].astype(int)
    assert np.ptp(inside) < 60
