"""A mask that is painted: it reaches the texels of the skin under the brush, is written as a PNG, and can be undone."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from kit.limb import limb, tool, write_tools
from wrinklecli.editor import mask_canvas
from wrinklecli.editor.session import Session
from wrinklecli.errors import WrinkleError


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A limb with a tool."""
    write_tools(tmp_path / "limb.yaml", tool(name="a", width=0.3))
    return Session(limb(tmp_path / "limb.glb", rings=40, sides=24, uvs=True))


def test_a_brush_lowers_what_lies_under_it_and_nothing_else(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mask_canvas, "_SIZE", 128)
    name, before = session.tools()[0].name, session.text
    canvas, length = session.mask_canvas(name)
    assert (canvas.pixels == 255).all()
    tool = session.attached_tools()[name]
    middle, radius = tool.region.path.middle, 0.2 * length
    assert canvas.paint(middle, middle, radius, back=False)
    image = session.set_mask(name, canvas)
    assert (yaml.safe_load(session.text)["tools"][0]["mask"]) == {"image": image}
    session.refine()
    places, weld = tool.ground.rest.positions, tool.ground.surface.weld
    again, _ = session.mask_canvas(name)
    away = np.linalg.norm(places - middle, axis=1)[weld]
    spots = np.floor(again.coordinates * len(again.pixels)).astype(int).clip(0, len(again.pixels) - 1)
    factors = again.pixels[spots[:, 1], spots[:, 0]]
    assert (factors[away > 1.2 * radius] == 255).all()
    assert (factors[away < 0.4 * radius] < 128).all()
    assert (away < 0.4 * radius).any()

    assert again.paint(middle, middle, 2.5 * radius, back=True)
    assert (again.pixels == 255).mean() > (canvas.pixels == 255).mean()
    assert session.set_mask(name, again) != image, "so that the one before can be undone"
    assert session.undo()
    assert session.undo()
    assert session.text == before


def test_a_mesh_without_texture_coordinates_has_no_mask_to_paint(tmp_path: Path) -> None:
    write_tools(tmp_path / "limb.yaml", tool(name="a", width=0.3))
    session = Session(limb(tmp_path / "limb.glb", rings=8, sides=6, uvs=False))
    with pytest.raises(WrinkleError, match="has no TEXCOORD_0"):
        session.mask_canvas("a")
