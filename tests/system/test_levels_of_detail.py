"""One tools file on levels of detail of a character, decimated by gltfpack: wrinkles are in the same places."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import wrinklecli
from kit.bakes import bake_config
from kit.clients import gltfpack
from kit.places import ROOT
from kit.player import Gltf
from kit.samples import config, sample
from wrinklecli.numeric.closest import closest_point

# As a manifest of `wrinkle batch` says it of levels: fewer triangles, and less refinement.
LEVELS = {"0.5": {"max_levels": 3}, "0.25": {"max_levels": 3, "edges_per_interval": 2}}


@pytest.mark.slow
@pytest.mark.parametrize("share", LEVELS)
def test_crests_of_coarser_levels_are_within_a_fifth_of_a_bump(share: str, tmp_path: Path) -> None:
    coarse, out = tmp_path / "coarse.glb", tmp_path / "out.glb"
    gltfpack(sample("wrist"), coarse, "-si", share, "-sa", *["-noq", "-kn", "-km", "-ke"])
    wrinklecli.bake(coarse, ROOT / "configs" / "wrist.yaml", out, tracks="none", **LEVELS[share])
    whole, level = bake_config("wrist", "wrist", fine=True), Gltf(out)
    assert len(level.triangles("wrist")) < 0.8 * len(whole.triangles("wrist"))
    for tool in config("wrist")["tools"]:
        ends = np.array([tool["origin"], tool["target"]])
        wanted, found = (crests(file, tool["name"], ends) for file in (whole, level))
        bumps = 5
        assert len(wanted) == bumps
        apart = np.abs(wanted[:, None] - found) * bumps
        assert apart.min(axis=1).max() < 0.2, "a crest is elsewhere"
        assert apart.min(axis=0).max() < 0.2, "there is a crest more"


def crests(file: Gltf, tool: str, ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a tool's wrinkles, all at full height, are tallest along the line between its ends, shares of this."""
    names = file.mesh("wrist")["extras"]["targetNames"]
    columns = [names.index(name) for name in names if name.startswith(f"wrinkle_{tool}_")]
    deltas = file.deltas("wrist")[columns]
    heights = np.sqrt(np.sum(deltas**2, axis=2)).sum(axis=0)
    positions, triangles = file.attribute("wrist", "POSITION"), file.triangles("wrist").astype(np.intp)
    us = np.linspace(0.0, 1.0, 201)
    places = [closest_point(positions, triangles, ends[0] + u * (ends[1] - ends[0])) for u in us]
    along = np.array([heights[triangles[number]] @ shares for number, shares, _ in places])
    # Between two vertices of a crest the line is straight: some samples of rounding apart.
    along = np.convolve(along, [0.25, 0.5, 0.25], mode="same")
    inner = along[1:-1]
    tops = (inner > along[:-2]) & (inner >= along[2:]) & (inner > 0.3 * along.max())
    found: NDArray[np.float64] = us[1:-1][tops]
    return found
