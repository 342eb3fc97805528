"""Where a preview looks from: at the wrinkles, from their side, and with what walks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.limb import limb_asset
from kit.pictures import SIZE, baked, covered, draw, limb, picture
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document
from wrinklecli.review.preview.camera import FACING, parse_view
from wrinklecli.review.preview.framing import View, plan_views
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.shown import ShownAsset, read_shown

Json = dict[str, Any]


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
        ((_, posed),) = shown.posed(moment)
        moved = primitive.shapes.any(axis=(0, 2))
        seen = camera.project(posed.positions[0, moved], (400, 300))
        assert (seen > 0).all()
        assert (seen < (400, 300)).all()
    assert len({camera.reach for camera in view.cameras}) == 1, "one scale for all moments"


def test_an_asset_without_wrinkles_has_no_side_that_faces_them(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="no wrinkles to face"):
        view_of(limb(tmp_path), [Moment(None, 0.0)], views=[FACING])


def test_a_camera_that_follows_looks_at_the_middle_of_what_it_sees(tmp_path: Path) -> None:
    moments = [Moment("fold", time) for time in (0.0, 0.5, 1.0)]
    asset, view = view_of(limb(tmp_path, rings=9, sides=8), moments, follow=True, views=["front"])
    for moment, camera in zip(moments, view.cameras, strict=True):
        ((_, posed),) = asset.posed(moment)
        middle = (posed.positions[0].min(axis=0) + posed.positions[0].max(axis=0)) / 2.0
        assert camera.centre == pytest.approx(middle, abs=1e-9)


def walking(folder: Path, distance: float = 5.0) -> Path:
    asset = limb_asset(rings=9, sides=12, root={"translation": [0.0, 0.0, 0.0]}, clip=None)
    animation: Json = {"name": "walk"}
    asset.channel(animation, 3, "translation", [0.0, 1.0], [[0.0, 0.0, 0.0], [distance, 0.0, 0.4 * distance]])
    asset.append("animations", animation)
    return asset.write(folder / "walking.glb")


@pytest.mark.parametrize("focus", [None, (0.5, 0.25, 0.0)])
def test_a_camera_that_follows_sees_a_walker_stand_still(tmp_path: Path, focus: tuple[float, ...] | None) -> None:
    path = walking(tmp_path, 5.0 if focus else 0.8)
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


@pytest.mark.parametrize(
    ("distance", "options", "follows"), [(0.8, {}, False), (3.0, {}, True), (3.0, {"grid": True}, False)]
)
def test_a_camera_follows_by_itself_what_goes_further_than_its_size(
    distance: float, options: Json, follows: bool, tmp_path: Path
) -> None:
    moments = [Moment("walk", time) for time in (0.0, 1.0)]
    _, view = view_of(walking(tmp_path, distance), moments, views=["front"], **options)
    first, second = (camera.centre for camera in view.cameras)
    assert (second - first).tolist() == pytest.approx([distance, 0.0, 0.4 * distance] if follows else [0.0] * 3)
