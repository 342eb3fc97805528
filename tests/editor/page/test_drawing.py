"""Outlines lie on the surface of their tool, wherever the body moves."""

from pathlib import Path

import numpy as np
import pytest

from kit.places import ROOT
from wrinklecli.editor.page.drawing import Body, outline_of
from wrinklecli.editor.session import Session

# In front of the left thigh, just below the crotch, and so wide that the other leg is as near in space.
WIDE = "{name: a, origin: [0.05, 0.75, 0.08], target: [0.05, 0.6, 0.08], width: 200%}"
KNEE = "{name: a, origin: [0.115, 0.55, -0.078], target: [0.115, 0.4, -0.078], width: 120%}"


@pytest.mark.parametrize(("tool", "longest"), [(WIDE, 0.6), (KNEE, 0.15)])
def test_no_line_of_an_outline_leaves_the_surface(tool: str, longest: float, tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(f"version: 1\ntools: [{tool}]\n")
    session = Session(ROOT / "samples" / "trousers.glb", tmp_path / "tools.yaml")
    (shown,) = session.meshes("squat", 1.2, wait=False)
    attached = session.attached_tools()["a"]
    outline = outline_of(attached, shown.source, 0, (1.0, 0.0, 0.0))
    places = outline.points.positions(Body(shown.faces, ()), shown.positions)
    lengths = np.linalg.norm(np.diff(places[outline.segments], axis=1)[:, 0], axis=1)
    assert len(lengths) > 40
    assert lengths.max() < longest * attached.patch.span
