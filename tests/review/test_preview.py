"""`wrinkle preview`: what is where in a picture, what is in a file, and what is said where it cannot be drawn."""

import io
import re
import subprocess
import sys
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray
from PIL import Image

from kit.asset import ARRAY_BUFFER, Asset
from kit.limb import limb_asset, tool, write_tools
from wrinklecli import bake, cli
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.pixels import read_pixels
from wrinklecli.review.preview import render
from wrinklecli.review.preview.apply import apply_tools
from wrinklecli.review.preview.camera import FACING, VIEWS, Camera, camera_axes, parse_view
from wrinklecli.review.preview.draw import Mark
from wrinklecli.review.preview.framing import View, plan_views
from wrinklecli.review.preview.heat import HEAT, compression, heat_colours
from wrinklecli.review.preview.materials import Texture
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.options import PreviewOptions, Style
from wrinklecli.review.preview.preview import MOST_PIXELS, MOST_SIDE, Preview, preview
from wrinklecli.review.preview.render import PAPER, Snapshot
from wrinklecli.review.preview.sheet import Legend, Sheet, encode_animation, sheet_size
from wrinklecli.review.preview.shown import INKS, ShownAsset, read_shown, take_snapshot

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Json = dict[str, Any]

SIZE = (80, 60)
BUMPY: Json = {"name": "fold", "bumps": 2, "width": 0.4}


def picture(path: Path) -> Bytes:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def covered(pixels: Bytes) -> NDArray[np.bool_]:
    """Which pixels show something."""
    paper = np.array([round(255 * each) for each in PAPER])
    return np.asarray((np.abs(pixels.astype(int) - paper) > 2).any(axis=2))


def near(pixels: Bytes, colour: Sequence[float], *, within: float = 40) -> int:
    """How many pixels have about this colour."""
    return int((np.abs(pixels - 255 * np.array(colour)).max(axis=2) < within).sum())


def reds(pixels: Bytes) -> int:
    """How many pixels are red above all."""
    red, green, blue = np.moveaxis(pixels.astype(int), 2, 0)
    return int((red > 100 + np.maximum(green, blue)).sum())


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


def limb(folder: Path, *, name: str = "limb", **options: Any) -> Path:
    return limb_asset(**{"rings": 17, "sides": 12, **options}).write(folder / f"{name}.glb")


def baked(folder: Path) -> tuple[Path, Path, Path]:
    """An asset, its tools, and the bake of both."""
    asset, tools = limb(folder), write_tools(folder / "tools.yaml", tool(**BUMPY))
    bake(asset, tools, folder / "baked.glb")
    return asset, tools, folder / "baked.glb"


def draw(assets: Sequence[Path], out: Path, **options: Any) -> Preview:
    return preview(assets, out, PreviewOptions(**options))


# The ray caster.


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
    monkeypatch.setattr(render, "_BAND", 1500)
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


@pytest.mark.parametrize("turn", [0.0, 60.0])
def test_a_mark_has_an_outline_a_segment_and_ends_of_even_width_on_any_slope(turn: float) -> None:
    frame = square(half=0.9)
    mark = Mark(
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


@given(arrays.arrays(np.float64, (20, 3), elements=st.floats(-5, 5)), st.floats(-180, 180), st.floats(-90, 90))
def test_a_framing_camera_sees_all_points(points: Floats, azimuth: float, elevation: float) -> None:
    points = points + np.arange(20)[:, None] * (0.1, 0.05, 0.02)
    camera = Camera.framing(points, camera_axes(azimuth, elevation), aspect=4 / 3, margin=1.0)
    seen = camera.project(points, (800, 600))
    assert (seen > -0.5).all()
    assert (seen < (800.5, 600.5)).all()
    # As close as that allows: one is at the border.
    assert min(seen.min(), (800 - seen[:, 0]).min(), (600 - seen[:, 1]).min()) < 0.5


# Heat.


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


def test_the_legend_has_the_colours_of_the_heat() -> None:
    stops = [loss for loss, _ in HEAT]
    assert np.allclose(heat_colours(np.array(stops)), [colour for _, colour in HEAT])
    assert np.allclose(heat_colours(np.array([5.0])), HEAT[-1][1])
    assert (np.diff(heat_colours(np.linspace(0.1, 0.8, 50)).sum(axis=1)) < 0).all(), "darker all the way, in grey too"


# Files.


def test_one_asset_gives_a_sheet_over_time_and_two_give_columns(tmp_path: Path) -> None:
    asset, _, wrinkled = baked(tmp_path)
    seen: Json = {"focus": (0, 0.1, 0), "radius": 0.5, "size": SIZE, "labels": ["a"], "views": ["oblique"]}
    for name, path in (("a", asset), ("b", wrinkled)):
        draw([path], tmp_path / f"{name}.png", times=(0.5, 1.0), columns=2, **seen)
    draw([asset, wrinkled], tmp_path / "ab.png", times=(0.5, 1.0), **seen | {"labels": ["a", "a"]})
    single, other, side = (picture(tmp_path / f"{name}.png") for name in ("a", "b", "ab"))
    width, height = SIZE
    assert single.shape == (height, 2 * width + 4, 3)
    assert side.shape == (2 * height + 4, 2 * width + 4, 3)
    for row, column in ((0, 0), (1, width + 4)):
        across = side[row * (height + 4) :][:height]
        assert np.array_equal(across[:, :width], single[:, column : column + width])
        assert np.array_equal(across[:, width + 4 :], other[:, column : column + width])
    assert not np.array_equal(single[:, width + 4 :], other[:, width + 4 :])


@pytest.mark.parametrize("ending", ["png", "webp", "gif"])
def test_the_same_input_gives_the_same_bytes(tmp_path: Path, ending: str) -> None:
    asset, tools, _ = baked(tmp_path)
    for name in ("a", "b"):
        draw([asset], tmp_path / f"{name}.{ending}", tools=tools, heat=True, frames=3, size=SIZE)
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


@pytest.mark.parametrize("ending", ["webp", "gif"])
@pytest.mark.parametrize(
    ("options", "count", "milliseconds"),
    [
        ({"fps": 8.0}, 16, 2000),
        ({"frames": 6}, 6, 2000),
        ({"times": (0.0, 0.5, 1.0), "fps": 3.0}, 3, 1000),
        ({"times": (0.0, 0.5, 1.0)}, 3, 200),
        ({}, 30, 2000),
    ],
)
def test_an_animation_has_so_many_frames_and_takes_as_long_as_the_clip(
    tmp_path: Path, ending: str, options: Json, count: int, milliseconds: int
) -> None:
    out = tmp_path / f"fold.{ending}"
    made = draw([limb(tmp_path, rings=5, sides=6)], out, size=(32, 24), views=["front"], **options)
    assert made.moments == count
    with Image.open(out) as image:
        total = 0
        frames = []
        for number in range(count):
            image.seek(number)
            frames.append(np.asarray(image.convert("RGB")))
            total += image.info["duration"]
        with pytest.raises(EOFError):
            image.seek(count)
        assert image.info["loop"] == 0
    assert total == pytest.approx(milliseconds, abs=10)
    assert (np.abs(frames[0].astype(int) - frames[count // 2]) > 60).any(), "it moves"


def test_tools_show_what_their_bake_would(tmp_path: Path) -> None:
    asset, tools, wrinkled = baked(tmp_path)
    seen: Json = {"times": (0.4, 1.0), "size": SIZE, "labels": ["x"]}
    first = draw([asset], tmp_path / "a.png", tools=tools, hide_tools=True, **seen)
    second = draw([wrinkled], tmp_path / "b.png", **seen)
    draw([asset], tmp_path / "c.png", **seen, views=second.views)
    assert first.views == second.views
    shown, expected, smooth = (picture(tmp_path / f"{name}.png").astype(int) for name in "abc")
    # Weight tracks of one clip and of all have their keys elsewhere: within the same error.
    assert np.abs(shown - expected).mean() < 0.2
    assert np.abs(shown - smooth).mean() > 3


def test_tools_are_drawn_on_the_right_side_and_named(tmp_path: Path) -> None:
    asset, tools, _ = baked(tmp_path)
    counts = {}
    for view in ("top", "bottom"):
        draw([asset], tmp_path / "a.png", tools=tools, before=True, rest=True, views=[view], size=(160, 120))
        shown = picture(tmp_path / "a.png")
        counts[view] = (near(shown[:120, :160], INKS[0]), near(shown[:120, 164:], INKS[0]))
        assert near(shown[120:], INKS[0], within=5) > 50, "a swatch in the legend"
    assert counts["top"][0] == 0
    assert counts["top"][1] > 50
    assert counts["bottom"] == (0, 0)
    draw([asset], tmp_path / "b.png", tools=tools, hide_tools=True, rest=True, views=["top"], size=(160, 120))
    assert near(picture(tmp_path / "b.png"), INKS[0]) == 0


@pytest.mark.parametrize(
    "options", [{}, {"primitives": 3}, {"primitives": 4, "indices": None}, {"mode": "strip", "morphs": 1}]
)
def test_marks_lie_on_the_triangles_that_they_are_of(tmp_path: Path, options: Json) -> None:
    tools = write_tools(
        tmp_path / "tools.yaml", tool(**BUMPY), tool(name="end", origin=[0.6, 0.25, 0.0], target=[0.9, 0.25, 0.0])
    )
    applied = apply_tools(limb(tmp_path, **options), tools)
    asset, _ = read_shown(applied.document, "limb", applied.plans)
    marked = 0
    for posed in asset.posed(Moment(None, 0.0)):
        for mark in posed.shown.marks:
            corners = posed.positions[posed.triangles[mark.triangles]].reshape(-1, 3)
            places = mark.places.reshape(-1, 2)
            marked += int(mark.inside.sum())
            if not len(corners):
                continue
            # Along x from the origin, and across along z.
            assert np.ptp(places[:, 0] - corners[:, 0]) < 0.01
            assert np.abs(np.abs(places[:, 1]) - np.abs(corners[:, 2])).max() < 0.01
    assert marked > 50


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_unskinned_limb_may_be_mirrored(tmp_path: Path, mirrored: bool) -> None:
    scale = [-1.0, 1.0, 1.0] if mirrored else [1.0, 1.0, 1.0]
    path = limb(tmp_path, skinned=False, root={"scale": scale}, clip=None, morphs=1, morph_clip="LINEAR")
    style = Style(backfaces=True)
    draw([path], tmp_path / "a.png", rest=True, views=["front"], size=SIZE, style=style)
    assert reds(picture(tmp_path / "a.png")) == 0


def test_a_material_shows_its_colour_its_texture_and_the_colours_of_vertices(tmp_path: Path) -> None:
    def drawn(name: str, material: Json, *, colors: bool = False, image: bytes = b"") -> tuple[Bytes, tuple[str, ...]]:
        asset = limb_asset(rings=9, sides=12, colors=colors)
        textured(asset, material, image)
        made = draw([asset.write(tmp_path / f"{name}.glb")], tmp_path / "a.png", rest=True, size=SIZE)
        shown = picture(tmp_path / "a.png")[22:]
        return shown[covered(shown)].mean(axis=0), made.warnings

    green = io.BytesIO()
    Image.new("RGB", (8, 8), (20, 220, 20)).save(green, "PNG")
    plain, _ = drawn("plain", {})
    assert np.ptp(plain) < 15
    red, _ = drawn("red", {"baseColorFactor": [0.8, 0.05, 0.05, 1.0]})
    assert red.argmax() == 0
    assert red[0] > 1.5 * red[1]
    leafy, warnings = drawn("leafy", {"baseColorTexture": {"index": 0}}, image=green.getvalue())
    assert leafy[1] > 1.5 * leafy[0]
    assert warnings == ()
    bare, warnings = drawn("damaged", {"baseColorTexture": {"index": 0}}, image=b"\x89PNG\r\n\x1a\n nothing")
    assert np.abs(bare - plain).max() < 1
    assert len(warnings) == 1
    assert "without its texture" in warnings[0]
    assert np.abs(drawn("vertices", {}, colors=True)[0] - plain).max() > 5


def textured(asset: Asset, material: Json, image: bytes) -> None:
    if image:
        asset.append("images", {"bufferView": asset.view(image, target=ARRAY_BUFFER), "mimeType": "image/png"})
        asset.append("textures", {"source": 0})
    asset.append("materials", {"pbrMetallicRoughness": material})
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["material"] = 0


@pytest.mark.parametrize(
    "change",
    [
        {"materials": [5]},
        {"materials": [{"pbrMetallicRoughness": 7}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorFactor": "red"}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [{}, 1, 1]}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": []}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 9}}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 7}}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": 3}}}]},
        {"textures": [{"source": "x"}]},
        {"textures": [4]},
        {"samplers": [4], "textures": [{"source": 0, "sampler": 0}]},
        {"images": [{"uri": "../../etc/passwd"}]},
    ],
)
def test_odd_looks_do_not_hide_a_shape(tmp_path: Path, change: Json) -> None:
    asset = limb_asset(rings=5, sides=6)
    textured(asset, {"baseColorTexture": {"index": 0}}, b"\x89PNG\r\n\x1a\n")
    asset.gltf |= change
    draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.png", rest=True, size=(32, 24))
    assert covered(picture(tmp_path / "a.png")).sum() > 30


def test_large_textures_are_reduced_and_huge_ones_refused() -> None:
    file = io.BytesIO()
    Image.new("RGB", (3000, 10), (10, 20, 30)).save(file, "PNG")
    assert read_pixels(file.getvalue()).shape == (4, 1000, 3)
    header = bytearray(file.getvalue())
    for most in (12_000, 60_000):
        header[16:24] = most.to_bytes(4) + most.to_bytes(4)
        header[29:33] = zlib.crc32(bytes(header[12:29])).to_bytes(4)
        with pytest.raises(ValueError, match="too large"):
            read_pixels(bytes(header))


def test_without_normals_each_triangle_is_one_shade(tmp_path: Path) -> None:
    sets = []
    for normals in (True, False):
        path = limb(tmp_path, rings=3, sides=6, normals=normals)
        draw([path], tmp_path / "a.png", rest=True, size=(240, 180), views=["front"], labels=[" "])
        shown = picture(tmp_path / "a.png")
        sets.append(len(np.unique(shown[covered(shown)], axis=0)))
    assert sets[1] < 0.6 * sets[0]


# The camera.


def view_of(path: Path, moments: Sequence[Moment], **options: Any) -> tuple[ShownAsset, View]:
    asset, _ = read_shown(read_document(path), "limb", [])
    (view,) = plan_views([asset], moments, PreviewOptions(**options))
    return asset, view


def test_a_baked_file_is_framed_on_its_wrinkles_from_the_side_that_shows_them(tmp_path: Path) -> None:
    asset, _, wrinkled = baked(tmp_path)
    moments = [Moment("fold", time) for time in (0.0, 0.2, 0.4)]
    shown, view = view_of(wrinkled, moments)
    _, whole = view_of(asset, moments)
    assert whole.name == "oblique"
    assert view.cameras[0].reach < 0.6 * whole.cameras[0].reach
    _, elevation = parse_view(view.name)
    assert elevation > 0, "it folds upwards"
    (primitive,) = shown.primitives
    for moment, camera in zip(moments, view.cameras, strict=True):
        (posed,) = shown.posed(moment)
        moved = primitive.shapes.any(axis=(0, 2))
        seen = camera.project(posed.positions[moved], (400, 300))
        assert (seen > 0).all()
        assert (seen < (400, 300)).all()
    assert len({camera.reach for camera in view.cameras}) == 1, "one scale for all moments"


def test_an_asset_without_wrinkles_has_no_side_that_faces_them(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="no wrinkles to face"):
        view_of(limb(tmp_path), [Moment(None, 0.0)], views=[FACING])


def walking(folder: Path) -> Path:
    asset = limb_asset(rings=9, sides=12, root={"translation": [0.0, 0.0, 0.0]}, clip=None)
    animation: Json = {"name": "walk"}
    asset.channel(animation, 3, "translation", [0.0, 1.0], [[0.0, 0.0, 0.0], [5.0, 0.0, 2.0]])
    asset.append("animations", animation)
    return asset.write(folder / "walking.glb")


@pytest.mark.parametrize("focus", [None, (0.5, 0.25, 0.0)])
def test_a_camera_that_follows_sees_a_walker_stand_still(tmp_path: Path, focus: tuple[float, ...] | None) -> None:
    path = walking(tmp_path)
    shots = []
    for follow in (True, False):
        options: Json = {"radius": 0.4} if focus else {}
        draw(
            [path],
            tmp_path / "a.png",
            times=(0.0, 1.0),
            columns=2,
            size=SIZE,
            views=["front"],
            labels=[""],
            follow=follow,
            focus=focus,
            **options,
        )
        shown = picture(tmp_path / "a.png").astype(int)
        shots.append([shown[20:, :80], shown[20:, 84:]])
    (first, second), (fixed, gone) = shots
    assert np.abs(first - second).max() <= 3
    assert np.abs(fixed - gone).max() > 50
    assert covered(first.astype(np.uint8)).sum() > 300


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


# Sheets.


@pytest.mark.parametrize("label", ["", "x" * 500, "名前 ‮ \x1b[31m\n", "a"])
def test_any_label_fits_its_picture(label: str) -> None:
    sheet = Sheet(2, 1, SIZE, Legend())
    grey = np.full((*SIZE[::-1], 3), 90, np.uint8)
    sheet.put(0, 0, grey, label)
    shown = np.asarray(sheet.image)
    assert np.array_equal(shown[30:, :80], grey[30:])
    assert (shown[:, 80:] == 255).all(), "nothing beyond it"


def test_a_legend_with_more_names_than_there_is_room_for_stays_in_its_place() -> None:
    legend = Legend("compressed by", heat_colours(np.linspace(0, 0.8, 9)), ((0.0, "0%"),), (("tool", (1, 0, 0)),) * 99)
    size = sheet_size(1, 1, SIZE, legend)
    sheet = Sheet(1, 1, SIZE, legend)
    assert sheet.image.size == size
    assert size[1] > SIZE[1]


def test_an_animation_keeps_flat_colours() -> None:
    images = [Image.new("RGB", (16, 16), colour) for colour in ((200, 40, 40), (40, 200, 40))]
    for kind in ("gif", "webp"):
        with Image.open(io.BytesIO(encode_animation(images, kind, seconds=0.1))) as image:
            for number, expected in enumerate(images):
                image.seek(number)
                ours, theirs = (np.asarray(each.convert("RGB")).astype(int) for each in (image, expected))
                assert np.abs(ours - theirs).max() < 12


# The command.


def run(
    arguments: Sequence[str | Path], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> tuple[int, str]:
    """Exit code and standard error of `wrinkle preview`."""
    monkeypatch.setattr(sys, "argv", ["wrinkle", "preview", *map(str, arguments)])
    capfd.readouterr()
    code: Any = 0
    try:
        cli.main()
    except SystemExit as leaving:
        code = leaving.code or 0
    captured = capfd.readouterr()
    assert captured.out == ""
    return code, captured.err


def test_the_command_says_what_it_has_drawn(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asset, tools, _ = baked(tmp_path)
    out = tmp_path / "a.png"
    options = ["--tools", tools, "--before", "--times", "0,1", "--size", "64x48", "--views", "-30:45,facing", "-o", out]
    code, said = run([asset, *options], capfd, monkeypatch)
    assert code == 0
    assert re.fullmatch(rf"{out}: 132 × 2\d\d pixels, 2 moments, seen from -30:45, -?\d+:-?\d+\n", said)
    assert run([asset, *options, "-q"], capfd, monkeypatch) == (0, "")


def test_help_names_every_view(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["wrinkle", "preview", "--help"])
    cli.main()
    shown = " ".join(capfd.readouterr().out.split())
    assert f"{', '.join(VIEWS)}, {FACING} (" in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.glb"], "Missing option '-o'"),
        (["a.glb", "-o", "a.jpg"], "none of .png, .webp, .gif"),
        (["a", "b", "c", "-o", "a.png"], "at most two"),
        (["a", "b", "--tools", "t.yaml", "-o", "a.png"], "takes one ASSET"),
        (["a", "--tool", "x", "-o", "a.png"], "needs '--tools'"),
        (["a", "--before", "-o", "a.png"], "needs '--tools'"),
        (["a", "--hide-tools", "-o", "a.png"], "needs '--tools'"),
        (["a", "--rest", "--times", "1", "-o", "a.png"], "one moment"),
        (["a", "--times", "1", "--frames", "3", "-o", "a.png"], "exclude"),
        (["a", "--times", "1,x", "-o", "a.png"], "numbers between commas"),
        (["a", "--times", "inf", "-o", "a.png"], "numbers between commas"),
        (["a", "--frames", "0", "-o", "a.png"], "0 is not in the range"),
        (["a", "--frames", "99999", "-o", "a.png"], "99999 is not in the range"),
        (["a", "--fps", "nan", "-o", "a.png"], "not a number"),
        (["a", "--size", "8x600", "-o", "a.png"], "of 16 to 16383 pixels"),
        (["a", "--size", "99999x600", "-o", "a.png"], "of 16 to 16383 pixels"),
        (["a", "--size", "800", "-o", "a.png"], "WIDTHxHEIGHT"),
        (["a", "--views", "nose", "-o", "a.png"], "none of facing"),
        (["a", "--focus", "1,2", "-o", "a.png"], "2 numbers, not 3"),
        (["a", "--focus", "1,2,3", "-o", "a.png"], "needs '--radius'"),
        (["a", "--radius", "0", "-o", "a.png"], "not a length above 0"),
        (["a", "--radius", "inf", "-o", "a.png"], "not a length above 0"),
        (["a", "--labels", "x,y", "-o", "a.png"], "has 2, not 1"),
    ],
)
def test_wrong_usage_is_said_and_ends_in_2(
    arguments: list[str], said: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, error = run(arguments, capfd, monkeypatch)
    assert code == 2
    assert said in " ".join(error.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"clips": ["walk"]}, "has no clip 'walk'; there are 'fold'"),
        ({"size": (16_000, 16_000), "times": (0.0, 1.0)}, "at most 16383 each way"),
        ({"size": (16_000, 16_000), "times": (0.0, 1.0), "out": "a.gif"}, "at most 1"),
        ({"out": "limb.glb"}, "ends in none of"),
        ({"out": "none/a.png"}, "cannot be written"),
        ({"fps": 1000.0, "frames": None, "clips": ["fold"] * 9}, "too many"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_line(tmp_path: Path, options: Json, said: str) -> None:
    path = limb(tmp_path, rings=3, sides=4)
    out = tmp_path / options.pop("out", "a.png")
    if "size" not in options:
        options["size"] = (16, 16)
    with pytest.raises(WrinkleError, match=re.escape(said)) as caught:
        draw([path], out, **options)
    assert len(caught.value.lines) == 1
    assert [each.name for each in tmp_path.iterdir()] == ["limb.glb"]


def test_a_long_clip_is_not_drawn_at_any_rate(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4, clip=None)
    animation: Json = {"name": "long"}
    asset.channel(animation, 1, "translation", [0.0, 1e30], [[0.0, 0.0, 0.0], [5.0, 0.0, 2.0]])
    asset.append("animations", animation)
    with pytest.raises(WrinkleError, match="at most 10000"):
        draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.gif", size=(16, 16))


def test_an_input_is_not_overwritten(tmp_path: Path) -> None:
    path = limb(tmp_path, rings=3, sides=4)
    link = tmp_path / "link.png"
    link.symlink_to(path)
    with pytest.raises(WrinkleError, match="would be overwritten"):
        draw([path], link, size=(16, 16))


def test_an_asset_without_triangles_shows_nothing(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["meshes"][0]["primitives"][0]["mode"] = 0
    with pytest.raises(AssetError, match="nothing to see"):
        draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.png", size=(16, 16))


def test_bounds_hold_a_sheet_in_memory() -> None:
    assert MOST_SIDE**2 < MOST_PIXELS <= 2**28


@pytest.mark.parametrize("missing", ["embreex", "PIL"])
def test_a_missing_extra_is_one_line_that_says_what_to_install(tmp_path: Path, missing: str) -> None:
    path = limb(tmp_path, rings=3, sides=4)
    program = (
        f"import sys; sys.modules['{missing}'] = None\n"
        f"sys.argv = ['wrinkle', 'preview', {str(path)!r}, '-o', {str(tmp_path / 'a.png')!r}]\n"
        "from wrinklecli.cli import main\n"
        "main()\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert "pip install 'wrinklecli[preview]'" in line
    assert not (tmp_path / "a.png").exists()
