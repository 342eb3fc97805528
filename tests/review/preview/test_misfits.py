"""Tools that do not fit: what a preview shows of them, and what it says."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrinklecli
from kit.asset import Asset, attribute
from kit.limb import RADIUS, limb_asset, tool, write_tools
from kit.pictures import draw, limb, picture, reds
from wrinklecli.baking.job import BakeOptions
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.review.preview.apply import plan_tools
from wrinklecli.review.preview.misfits import find_misfits
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.shown import read_shown

Json = dict[str, Any]

FAR: Json = {"name": "far", "origin": [-0.4, RADIUS + 0.5, 0.0]}
STILL: Json = {"rest": True, "size": (160, 120), "views": ["front"], "labels": [" "]}


@pytest.mark.slow
def test_a_tool_off_the_mesh_is_drawn_in_red_and_the_others_as_ever(tmp_path: Path) -> None:
    asset = limb(tmp_path)
    both = write_tools(tmp_path / "both.yaml", tool(), tool(**FAR))
    made = draw([asset], tmp_path / "a.png", tools=both, focus=(0, 0.3, 0), radius=1.2, **STILL)
    with pytest.raises(WrinkleError) as refused:
        wrinklecli.bake(asset, both, tmp_path / "out.glb")
    assert made.warnings == refused.value.lines
    draw([asset], tmp_path / "b.png", tools=write_tools(tmp_path / "one.yaml"), focus=(0, 0.3, 0), radius=1.2, **STILL)
    shown, alone = (picture(tmp_path / name)[:120] for name in ("a.png", "b.png"))
    assert reds(shown) > reds(alone) + 30
    others = (np.abs(shown.astype(int) - alone) > 8).any(axis=2)
    assert others[:75].sum() > 30, "from the point asked for to the mesh"
    assert others[90:].sum() == 0
    draw([asset], tmp_path / "b.png", tools=both, hide_tools=True, focus=(0, 0.3, 0), radius=1.2, **STILL)
    assert reds(picture(tmp_path / "b.png")) == 0


def test_the_distance_is_that_of_the_message_and_goes_along_with_the_skin(tmp_path: Path) -> None:
    asset = limb(tmp_path)
    planned = plan_tools(asset, write_tools(tmp_path / "tools.yaml", tool(**FAR)), BakeOptions())
    assert planned.job is None
    document = read_document(asset)
    (misfit,) = find_misfits(planned, document)
    assert [end.far for end in misfit.points] == [True, False]
    assert f"is {misfit.points[0].distance:.4g} from the mesh" in misfit.refused.reason
    shown, _ = read_shown(document, "", ())
    for moment in (Moment(None, 0.0), Moment("fold", 1.0)):
        places = misfit.places(shown, moment)
        assert np.linalg.norm(places[:, 1] - places[:, 0], axis=1) == pytest.approx([0.5, 0.0], abs=1e-3)
        if moment.clip is None:
            assert places[:, 1] == pytest.approx(np.array([FAR["origin"], tool()["target"]]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("keys", "said", "ends"),
    [
        ({"node": "lim"}, "is no node with a mesh", 2),
        ({"origin": {"marker": "elbow"}}, "no node is named 'elbow'", 0),
        ({"origin": [0.4, RADIUS, 0.0], "target": [0.4, RADIUS + 1e-9, 0.0]}, "1e-09 from the mesh", 2),
        ({"rest_length": {"morph": "smile", "full": "110%"}}, "has no morph target 'smile'", 2),
        ({"target": [1e6, 1.0, 0.0]}, "1e+06 from the mesh", 2),
    ],
)
def test_whatever_does_not_fit_is_shown_and_said(tmp_path: Path, keys: Json, said: str, ends: int) -> None:
    asset = limb_asset(rings=5, sides=6).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(**keys), tool(name="fits"))
    planned = plan_tools(asset, tools, BakeOptions())
    (misfit,) = find_misfits(planned, read_document(asset))
    assert [len(misfit.points), len(planned.plans)] == [ends, 1]
    made = draw([asset], tmp_path / "a.png", tools=tools, size=(32, 24))
    assert made.shown == "2 tools"
    assert said in made.warnings[0]
    assert draw([asset], tmp_path / "a.png", tools=tools, only=["crease"], rest=True, size=(32, 24)).warnings


def test_tools_may_fail_at_one_stage_after_another(tmp_path: Path) -> None:
    asset = limb_asset(rings=9, sides=8).write(tmp_path / "limb.glb")
    ends: Json = {"origin": [0.5, RADIUS, 0.0], "target": [0.9, RADIUS, 0.0]}
    leaning = tool(name="end.L", mirror="z", origin=[0.5, 0.1, 0.2291], target=[0.9, RADIUS, 0.0])
    tools = write_tools(tmp_path / "tools.yaml", tool(**ends), tool(name="b", node="none"), tool(**FAR), leaning)
    planned = plan_tools(asset, tools, BakeOptions())
    assert [each.tool.name for each in planned.misfits] == ["b", "far"]
    (plan,) = planned.plans
    assert [carried.patch.tool.name for carried in carried_patches_of(plan)] == ["crease", "end.L", "end.R"]


def test_what_is_wrong_with_the_file_is_refused_as_ever(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", tool(widht=1))
    with pytest.raises(WrinkleError, match="widht"):
        plan_tools(limb(tmp_path), tools, BakeOptions())
    with pytest.raises(WrinkleError, match="no enabled tool is named"):
        plan_tools(limb(tmp_path), write_tools(tmp_path / "tools.yaml"), BakeOptions(only=["none"]))


def flattened(asset: Asset) -> None:
    """Put all vertices at one point."""
    attribute(asset, 0, "POSITION")[:] = [0.1, 0.2, 0.3]


NOTHING: dict[str, tuple[Callable[[Asset], Any], str]] = {
    "outside": (lambda asset: asset.gltf["scenes"][0].update(nodes=[1]), "no triangles"),
    "empty scene": (lambda asset: asset.gltf["scenes"][0].pop("nodes"), "no triangles"),
    "one point": (flattened, "all is at one point"),
    "scaled to 0": (lambda asset: asset.gltf["nodes"][1].update(scale=[0, 0, 0]), "all is at one point"),
}


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", NOTHING)
def test_tools_are_not_shown_on_nothing(tmp_path: Path, name: str) -> None:
    change, said = NOTHING[name]
    asset = limb_asset(rings=5, sides=6)
    change(asset)
    asset.write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(**FAR), tool(**{**FAR, "name": "b"}))
    shots: list[tuple[str, Json]] = [("a.png", {}), ("a.png", {"rest": True}), ("a.png", {"grid": True})]
    # The joints part what the stored pose has at one point.
    if name != "one point":
        shots += [("a.png", {"times": (0.5,)}), ("a.gif", {}), ("a.webp", {"grid": True})]
    for out, options in shots:
        with pytest.raises(AssetError, match=f"limb.glb: nothing to see: {said}"):
            draw([tmp_path / "limb.glb"], tmp_path / out, tools=tools, size=(32, 24), **options)
        assert not (tmp_path / out).exists()


def test_ends_that_are_all_very_far_away_are_said_and_the_asset_is_shown(tmp_path: Path) -> None:
    asset = limb_asset(rings=5, sides=6).write(tmp_path / "limb.glb")
    away = tool(origin=[50.0, 50.0, 0.0], target=[51.0, 50.0, 0.0])
    tools = write_tools(tmp_path / "tools.yaml", away, {**away, "name": "b"})
    made = draw([asset], tmp_path / "a.png", tools=tools, size=(64, 48))
    assert made.shown == "2 tools"
    assert len(set(made.warnings)) >= 2
