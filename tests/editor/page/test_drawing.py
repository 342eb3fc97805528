"""Outlines lie on the surface of their tool, wherever the body moves."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from kit.fields import sleeve, sleeve_and_field
from kit.forehead import BROWS, forehead
from kit.garments import thinner
from kit.limb import limb_asset, write_tools
from kit.places import ROOT
from kit.touch import plate, touch
from wrinklecli.character.paints import Opacity, Paint
from wrinklecli.editor.page.drawing import Body, _bordered, body_of, outline_of
from wrinklecli.editor.page.viewpoints import clear_time
from wrinklecli.editor.raised import raised_tool
from wrinklecli.editor.session import Session

# In front of the left thigh, just below the crotch, and so wide that the other leg is as near in space.
WIDE = "{name: a, origin: [0.05, 0.75, 0.08], target: [0.05, 0.6, 0.08], width: 200%}"
KNEE = "{name: a, origin: [0.115, 0.55, -0.078], target: [0.115, 0.4, -0.078], width: 120%}"


@pytest.mark.quick(1)
@pytest.mark.parametrize("tool", [WIDE, KNEE])
def test_an_outline_is_the_border_of_a_patch_and_never_leaves_the_surface(tool: str, tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(f"version: 1\ntools: [{tool}]\n")
    session = Session(ROOT / "samples" / "trousers.glb", tmp_path / "tools.yaml")
    (shown,) = session.meshes(None, 0.0, wait=False)
    region = session.attached_tools()["a"].region
    outline = outline_of(session.attached_tools()["a"], shown.source, 0, (1.0, 0.0, 0.0))
    first, second = outline.points.triangles[outline.segments].T
    assert len(first) > 40
    assert np.array_equal(first, second), "a line across a triangle"
    places = outline.points.positions(Body(shown.faces, ()), shown.positions)
    u, v = region.coordinates(places[outline.segments.reshape(-1)])
    assert (u > -0.01).all()
    assert (u < 1.01).all()
    assert np.abs(v).max() < 1.01
    assert all((np.abs(side) < 1e-3).any() for side in (u, u - 1.0, v))
    assert places[outline.anchors] == pytest.approx(np.array([each.position for each in region.anchors]), abs=1e-3)
    along, across = region.coordinates(places[outline.edges])
    assert along == pytest.approx(0.5, abs=0.1)
    assert across.min() < -0.5
    assert across.max() > 0.5


@pytest.mark.parametrize("laid", ["stored", "raised"])
def test_an_outline_is_a_rectangle_in_the_pose_in_which_the_tool_is_laid(laid: str, tmp_path: Path) -> None:
    """The brows rise in arches, and so does the edge at the origin unless it is laid there."""
    asset = forehead(count=33).write(tmp_path / "forehead.glb")
    session = Session(asset, write_tools(tmp_path / "tools.yaml", {**BROWS, "laid": laid}))
    bends = {}
    for time in (0.0, 0.75):
        (shown,) = session.meshes("raise", time, wait=False)
        tool, body = session.attached_tools()["brow"], Body(shown.faces, ())
        outline = outline_of(tool, shown.source, 0, (1.0, 0.0, 0.0))
        u, v = tool.region.coordinates(
            outline.points.positions(body, shown.source.positions_in(tool.region.pose))[outline.segments].mean(axis=1)
        )
        places = outline.points.positions(body, shown.positions)[outline.segments]
        bends[time] = np.ptp(places[(np.abs(u) < 1e-3) & (np.abs(v) < 0.9), :, 1])
    straight, bent = (0.0, 0.75) if laid == "stored" else (0.75, 0.0)
    assert bends[straight] < 0.03
    assert bends[bent] > 3.0 * bends[straight]


@pytest.mark.quick(1)
@pytest.mark.parametrize("scale", [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]], ids=str)
@pytest.mark.parametrize("refined", [False, True])
def test_outlines_lie_above_the_surface_that_is_drawn_right_side_out(
    scale: list[float], refined: bool, tmp_path: Path
) -> None:
    asset = limb_asset(rings=12, sides=12, root={"scale": scale}).write(tmp_path / "limb.glb")
    keys = write_tools(tmp_path / "tools.yaml")
    session = Session(asset, keys)
    if refined:
        session.refine()
    (shown,) = session.meshes(None, 0.0, wait=refined)
    mesh = shown.source
    count = len(mesh.ground.surface.weld)
    opacity = Opacity(mesh.ground.surface.normals[:, 1], 0.5, None)
    body = body_of(mesh, [Paint(np.ones((count, 3)), np.zeros((count, 2)), None, opacity)])
    outline = outline_of(session.attached_tools()["crease"], mesh, 0, (1.0, 0.0, 0.0))
    low, high = (outline.points.positions(body, shown.positions, lift) for lift in (0.0, outline.lift))
    assert (np.linalg.norm(high[:, 1:], axis=1) - np.linalg.norm(low[:, 1:], axis=1)).min() > 0.9 * outline.lift
    (drawn,) = body.meshes
    corners = shown.positions[drawn.points[drawn.triangles]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum((normals * corners.mean(axis=1))[:, 1:], axis=1) > 0).all()
    assert drawn.paint.opacity is not None
    places = shown.source.rest_positions[drawn.points]
    across = scale[1] * places[:, 1] / np.linalg.norm(places[:, 1:], axis=1)
    assert drawn.paint.opacity.alphas == pytest.approx(across, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("refined", [False, True])
def test_the_outline_of_a_touch_is_round_on_a_coarse_mesh(refined: bool, tmp_path: Path) -> None:
    """It crosses triangles half as long as its radius, and does not follow their sides."""
    settings = {"version": 1, "refinement": {"max_levels": 2}, "touches": [touch()]}
    (tmp_path / "tools.yaml").write_text(yaml.safe_dump(settings))
    session = Session(plate(cells=16).write(tmp_path / "plate.glb"), tmp_path / "tools.yaml")
    if refined:
        session.refine()
    (shown,) = session.meshes("drag", 0.0, wait=refined)
    outline = outline_of(session.attached()["spot"], shown.source, 0, (1.0, 0.0, 0.0))
    places = outline.points.positions(Body(shown.faces, ()), shown.source.rest_positions)
    ends = places[outline.segments]
    radii = np.linalg.norm(ends, axis=2)
    assert radii.mean() > 0.02
    assert radii.std() < (0.03 if refined else 0.06) * radii.mean()
    # One closed line: each end is that of another line, too.
    _, counts = np.unique(ends.reshape(-1, 3).round(7), axis=0, return_counts=True)
    assert (counts == 2).all()


@pytest.mark.slow
def test_the_outline_of_a_touch_at_a_border_is_closed_along_it(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(
        yaml.safe_dump({"version": 1, "touches": [touch(at=[0.118, 0.0, 0.0], towards=[0, 0, 0])]})
    )
    session = Session(plate(cells=16).write(tmp_path / "plate.glb"), tmp_path / "tools.yaml")
    (shown,) = session.meshes("drag", 0.0, wait=False)
    outline = outline_of(session.attached()["spot"], shown.source, 0, (1.0, 0.0, 0.0))
    ends = outline.points.positions(Body(shown.faces, ()), shown.source.rest_positions)[outline.segments]
    along = (ends[:, :, 0] > 0.1199).all(axis=1)
    assert along.sum() >= 2
    assert (~along).sum() > 6


def test_the_outline_of_a_field_is_the_border_of_what_it_folds(tmp_path: Path) -> None:
    _, tools = sleeve_and_field(tmp_path, joints=["joint_2"])
    # Folds fade over the radius of the limb.
    session = Session(thinner(sleeve(), 0.6).write(tmp_path / "sleeve.glb"), tools)
    (shown,) = session.meshes("fold", 0.0)
    outline = outline_of(session.attached_tools()["folds"], shown.source, 0, (1.0, 0.0, 0.0))
    places = outline.points.positions(Body(shown.faces, ()), shown.source.rest_positions)
    assert outline.name == "folds"
    assert not len(outline.anchors)
    assert len(outline.segments) > 4
    # The second joint is at a third of the length.
    assert np.abs(places[:, 0] - 1 / 3).max() < 0.6


def test_a_field_without_a_border_has_a_place(tmp_path: Path) -> None:
    session = Session(*sleeve_and_field(tmp_path))
    (shown,) = session.meshes("fold", 0.0)
    tool: Any = SimpleNamespace(
        excess=-np.ones(len(shown.source.ground.surface.positions)), attached=session.attached()["folds"].attached
    )
    outline = _bordered(tool, shown.source, 0, (1.0, 0.0, 0.0))
    assert not len(outline.segments)
    places = outline.points.positions(Body(shown.faces, ()), shown.source.rest_positions)
    assert np.ptp(places[:, 0]) > 1.8
    raised = raised_tool(session._attached(), "folds", session._loaded.cache, session._loaded.clips)
    assert raised is not None
    assert raised.height > 0.01
    assert raised.clip.start <= clear_time(raised) <= raised.clip.end
