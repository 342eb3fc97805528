"""Cameras of the page stand where there is something to see."""

from pathlib import Path

import numpy as np

from kit.limb import limb
from wrinklecli.editor.page.drawing import Body, outline_of
from wrinklecli.editor.page.viewpoints import SIDES, frame_asset, frame_tool
from wrinklecli.editor.session import Session

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
