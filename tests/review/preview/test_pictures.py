"""Goldens: small pictures of all that a preview draws are as they were when somebody last looked at them."""

from pathlib import Path
from typing import Any

import pytest

from kit.golden import Golden
from kit.limb import RADIUS, limb_asset, tool, write_tools
from kit.pictures import BUMPY, draw
from wrinklecli.review.preview.preview_options import Style

Json = dict[str, Any]
BESIDE: Json = {"name": "beside", "origin": [-0.4, 0.0, RADIUS], "target": [0.4, 0.0, RADIUS], "width": 0.2}
OFF: Json = {"name": "off", "origin": [-0.4, 1.5, 0.0], "target": [0.4, 1.5, 0.0], "width": 0.2}
PICTURES: dict[str, Json] = {
    # Both assets at two moments, from two sides, with tools, heat and a legend.
    "sheet": {"before": True, "heat": True, "times": (0.4, 1.0), "views": ["front", "30:40"], "size": (128, 96)},
    "grid": {"grid": True, "before": True, "views": ["left", "oblique"], "size": (160, 120)},
    "styles": {
        "rest": True,
        "style": Style(wire=True, backfaces=True, key=(0.62, 0.62, 0.48)),
        "views": ["top"],
        "size": (128, 96),
    },
    "review": {"review": True, "size": (128, 96)},
}


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_looks_as_before(name: str, tmp_path: Path, golden: Golden) -> None:
    asset = limb_asset(rings=13, sides=10, joints=3, colors=True).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(**BUMPY), BESIDE)
    draw([asset], tmp_path / "found.png", tools=tools, **PICTURES[name])
    golden.picture(tmp_path / "found.png", f"{name}.png")


def test_a_tool_that_does_not_fit_looks_as_before(tmp_path: Path, golden: Golden) -> None:
    asset = limb_asset(rings=9, sides=8).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(**BUMPY), OFF)
    draw([asset], tmp_path / "found.png", tools=tools, rest=True, views=["30:20"], size=(200, 150))
    golden.picture(tmp_path / "found.png", "misfit.png")
