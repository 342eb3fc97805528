"""Cameras of the page stand where there is something to see."""

from pathlib import Path

import numpy as np
import pytest

from kit.limb import limb
from kit.places import ROOT
from wrinklecli.editor.page.drawing import Body, outline_of
from wrinklecli.editor.page.viewpoints import SIDES, clear_time, frame_asset, frame_tool
from wrinklecli.editor.session import Session
from wrinklecli.numeric.rays import distances_along

KNEE = "{name: a, origin: [0.104, 0.635, -0.0906], target: [0.104, 0.365, -0.0844], width: 0.24, bumps: 6}"
HIP = "{name: a, origin: [0.11, 0.97, 0.09], target: [0.11, 0.78, 0.09], width: 0.2, compressible: 50%}"
TOOL = "tools: [{name: a, origin: [-0.4, 0.25, 0], target: [0.4, 0.25, 0], width: 0.3}]\n"


def test_a_tool_is_seen_from_its_side_and_all_of_the_asset_from_any(tmp_path: Path) -> None:
    (tmp_path / "limb.yaml").write_text("version: 1\n" + TOOL)
    session = Session(limb(tmp_path / "limb.glb", rings=20, sides=12))
    (mesh,) = session.meshes(None, 0.0)
    outline = outline_of(session.attached_tools()["a"], mesh.source, 0, (1.0, 0.0, 0.0))
    body = Body(mesh.faces, ())
    camera = frame_tool(outline, body, mesh.positions, mesh.source.ground.surface.triangles)
    assert camera.axes[2, 1] > 0.4
    spots = outline.points.positions(body, mesh.positions)
    assert np.abs(camera.local(spots)[:, :2]).max() < 1
    for side in SIDES:
        every = frame_asset(mesh.positions, side).local(mesh.positions)
        assert np.abs(every[:, 1]).max() < 1


@pytest.mark.slow
def test_the_other_leg_does_not_stand_before_the_camera_of_a_knee(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(f"version: 1\ntools: [{KNEE}]\n")
    session = Session(ROOT / "samples" / "trousers.glb", tmp_path / "tools.yaml")
    raised = session.raised("a")
    assert raised is not None
    (mesh,) = raised.shown(clear_time(raised))
    outline, body = outline_of(raised.attached, mesh.source, 0, (1.0, 0.0, 0.0)), Body(mesh.faces, ())
    corners = mesh.positions[mesh.source.ground.surface.triangles]
    camera = frame_tool(outline, body, mesh.positions, mesh.source.ground.surface.triangles)
    spots = outline.points.positions(body, mesh.positions, 0.05 * raised.attached.region.span)
    free = [not (distances_along(spot, camera.eye - spot, corners) < 1).any() for spot in spots]
    assert np.mean(free) > 0.5


@pytest.mark.slow
def test_a_tool_that_its_fold_hides_is_shown_earlier(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(f"version: 1\ntools: [{HIP}]\n")
    session = Session(ROOT / "samples" / "trousers.glb", tmp_path / "tools.yaml")
    raised = session.raised("a")
    assert raised is not None
    assert 0 < clear_time(raised) < raised.time
    assert raised.height_at(clear_time(raised)) > 0.3 * raised.height
