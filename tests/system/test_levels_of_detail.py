"""One tools file on levels of detail of a character, decimated by gltfpack: wrinkles are in the same places."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import wrinklecli
from kit.bakes import bake_config
from kit.clients import gltfpack
from kit.limb import limb_asset, tool, write_tools
from kit.places import ROOT
from kit.player import Gltf
from kit.samples import config, sample
from wrinklecli.numeric.closest import closest_point

# As a manifest of `wrinkle batch` says it of levels: fewer triangles, and less refinement.
LEVELS = {"0.5": {"max_levels": 3}, "0.25": {"max_levels": 3, "edges_per_interval": 2}}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("share", LEVELS)
def test_crests_of_coarser_levels_are_within_a_fifth_of_a_bump(share: str, tmp_path: Path) -> None:
    coarse, out = tmp_path / "coarse.glb", tmp_path / "out.glb"
    gltfpack(sample("wrist"), coarse, "-si", share, "-sa", *["-noq", "-kn", "-km", "-ke"])
    wrinklecli.bake(coarse, ROOT / "configs" / "wrist.yaml", out, tracks="none", **LEVELS[share])
    whole, level = bake_config("wrist", "wrist", fine=True), Gltf(out)
    assert len(level.triangles("wrist")) < 0.8 * len(whole.triangles("wrist"))
    for entry in config("wrist")["tools"]:
        ends = np.array([entry["origin"], entry["target"]])
        wanted, found = (crests(file, entry["name"], ends) for file in (whole, level))
        bumps = 5
        assert len(wanted) == bumps
        apart = np.abs(wanted[:, None] - found) * bumps
        assert apart.min(axis=1).max() < 0.2, "a crest is elsewhere"
        assert apart.min(axis=0).max() < 0.2, "there is a crest more"


@pytest.mark.slow
def test_levels_and_copies_hold_no_wrinkles_down(tmp_path: Path) -> None:
    """Levels in no scene and in the scene, and a second node of the mesh, which is said to be a copy."""
    tools = write_tools(tmp_path / "tools.yaml", tool(node="limb"), refinement={"max_levels": 0})
    found = []
    for drawn, level in ((None, False), (False, True), (True, True), (True, False)):
        asset = limb_asset(rings=12, sides=8)
        if drawn is not None:
            number = asset.append("nodes", {"name": "again", "mesh": 0, "skin": 0})
            asset.gltf["scenes"][0]["nodes"] += [number] * drawn
            asset.gltf["nodes"][0]["extensions"] = {"MSFT_lod": {"ids": [number]}} if level else {}
        report = wrinklecli.bake(asset.write(tmp_path / "limb.glb"), tools, tmp_path / "out.glb")
        copies = [line for line in report.warnings if "limb: again counts as a copy of it" in line]
        found.append((Gltf(tmp_path / "out.glb").deltas("limb"), len(copies)))
    assert [copies for _, copies in found] == [0, 0, 0, 1]
    for deltas, _ in found:
        assert np.array_equal(deltas, found[0][0])
    assert np.abs(found[0][0]).max() > 0.01


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
