"""What of an asset is shown: its tools in their place, its sides and its shading."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.bakes import place
from kit.flesh import body, region
from kit.forehead import BROWS, forehead
from kit.limb import limb_asset, tool, write_tools
from kit.muscles import ANGLE, muscle
from kit.pictures import BUMPY, SIZE, covered, draw, limb, picture, reds
from kit.touch import plate, touch
from wrinklecli.baking.job import BakeOptions
from wrinklecli.review.preview.apply import apply_tools, plan_tools
from wrinklecli.review.preview.draw import Outline
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.preview_options import Style
from wrinklecli.review.preview.shown import read_shown, tool_names

Json = dict[str, Any]


def arm() -> Path:
    return place(limb_asset(rings=21, sides=16, angle=ANGLE))


def jumping() -> Path:
    return place(body())


def skin() -> Path:
    return place(plate(size=0.36, cells=36))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "options", [{}, {"primitives": 3}, {"primitives": 4, "indices": None}, {"mode": "strip", "morphs": 1}]
)
def test_marks_lie_on_the_triangles_that_they_are_of_before_and_after(tmp_path: Path, options: Json) -> None:
    tools = write_tools(
        tmp_path / "tools.yaml", tool(**BUMPY), tool(name="end", origin=[0.6, 0.25, 0.0], target=[0.9, 0.25, 0.0])
    )
    planned = plan_tools(limb(tmp_path, **options), tools, BakeOptions())
    assert planned.job is not None
    for document, refined in ((apply_tools(planned, [])[0], True), (planned.job.document, False)):
        asset, _ = read_shown(document, "limb", planned.plans, refined=refined)
        marked = 0
        for shown, posed in asset.posed(Moment(None, 0.0)):
            for mark in shown.marks:
                corners = posed.corners()[mark.triangles].reshape(-1, 3)
                places = mark.places.reshape(-1, 2)
                marked += int(mark.inside.sum())
                if not len(corners):
                    continue
                # Along x from the origin, and across along z.
                assert np.ptp(places[:, 0] - corners[:, 0]) < 0.01
                assert np.abs(np.abs(places[:, 1]) - np.abs(corners[:, 2])).max() < 0.01
        assert marked > (50 if refined else 5)


def test_marks_are_laid_where_the_tool_is(tmp_path: Path) -> None:
    """At three quarters of the brows' rise, crests are drawn straight across the forehead."""
    tools = write_tools(tmp_path / "tools.yaml", BROWS)
    planned = plan_tools(forehead().write(tmp_path / "forehead.glb"), tools, BakeOptions())
    assert planned.job is not None
    asset, _ = read_shown(apply_tools(planned, [])[0], "forehead", planned.plans, refined=True)
    bends = []
    for time in (0.0, 0.75):
        ((shown, posed),) = asset.posed(Moment("raise", time))
        (mark,) = shown.marks
        up = posed.corners()[mark.triangles].reshape(-1, 3)[:, 1]
        u = mark.places.reshape(-1, 2)[:, 0] / mark.span
        middle = np.abs(u - 0.5) < 0.25
        line = np.polyfit(u[middle], up[middle], 1)
        bends.append(np.abs(np.polyval(line, u[middle]) - up[middle]).max())
    assert bends[1] < 0.25 * bends[0]


@pytest.mark.quick(0)
@pytest.mark.parametrize(
    ("asset", "section", "entry"),
    [(arm, "muscles", muscle()), (jumping, "flesh", region()), (skin, "touches", touch())],
    ids=["muscle", "flesh", "touch"],
)
@pytest.mark.parametrize("refined", [True, False])
def test_what_moves_below_the_skin_is_outlined_where_it_moves_the_skin(
    tmp_path: Path, asset: Callable[[], Path], section: str, entry: Json, refined: bool
) -> None:
    """Inside the line, skin moves by three tenths of its largest move and more."""
    tools = tmp_path / "tools.yaml"
    tools.write_text(json.dumps({"version": 1, section: [entry]}))
    planned = plan_tools(asset(), tools, BakeOptions(max_levels=1))
    assert planned.job is not None
    document = apply_tools(planned, [])[0] if refined else planned.job.document
    assert tool_names(planned.plans) == [entry["name"]]
    shown, _ = read_shown(document, "", planned.plans, refined=refined)
    applied, _ = read_shown(apply_tools(planned, [])[0], "", ())
    ((one, posed),), ((other, _),) = shown.posed(Moment(None, 0.0)), applied.posed(Moment(None, 0.0))
    (mark,) = one.marks
    assert isinstance(mark, Outline)
    corners = posed.triangles[mark.triangles]
    assert 0.05 < (mark.depths > 0).mean() < 0.95
    moved = np.sqrt((other.shapes**2).sum(axis=2)).max(axis=0)
    assert mark.depths == pytest.approx(moved[corners] / moved.max() - 0.3, abs=1e-5)
    beside = np.setdiff1d(posed.triangles, corners)
    assert not moved[beside].any()
    assert np.array_equal(mark.rewound().depths, mark.depths[:, ::-1])


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_unskinned_limb_may_be_mirrored(tmp_path: Path, mirrored: bool) -> None:
    scale = [-1.0, 1.0, 1.0] if mirrored else [1.0, 1.0, 1.0]
    path = limb(tmp_path, skinned=False, root={"scale": scale}, clip=None, morphs=1, morph_clip="LINEAR")
    style = Style(backfaces=True)
    draw([path], tmp_path / "a.png", rest=True, views=["front"], size=SIZE, style=style)
    assert reds(picture(tmp_path / "a.png")) == 0


def test_without_normals_each_triangle_is_one_shade(tmp_path: Path) -> None:
    sets = []
    for normals in (True, False):
        path = limb(tmp_path, rings=3, sides=6, normals=normals)
        draw([path], tmp_path / "a.png", rest=True, size=(240, 180), views=["front"], labels=[" "])
        shown = picture(tmp_path / "a.png")
        sets.append(len(np.unique(shown[covered(shown)], axis=0)))
    assert sets[1] < 0.6 * sets[0]
