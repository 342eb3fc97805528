"""Goldens: maps are as they were when somebody last looked."""

from pathlib import Path

import numpy as np
from PIL import Image

import wrinklecli
from kit.golden import Golden, summed
from kit.limb import limb_asset, tool, write_tools


def test_maps_are_as_before(tmp_path: Path, golden: Golden) -> None:
    asset = limb_asset(rings=11, sides=8)
    asset.gltf["materials"] = [{}]
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=2), tool(name="other", bumps=3, profile="cloth"))
    found = wrinklecli.maps(asset.write(tmp_path / "limb.glb"), tools, tmp_path / "maps", size=96, separate=True)
    images = [path for path in sorted((tmp_path / "maps").iterdir()) if path.suffix == ".png"]
    pixels = {path.name: summed(np.asarray(Image.open(path), float) / 255) for path in images}
    golden([pixels, found.data, *found.warnings], "maps_limb.json", tolerance=0.01)
