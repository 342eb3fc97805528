"""Holds a baked file in an engine of the browser, in Chromium, against the player of the tests. Run by hand.

    apt-get install chromium
    npm install --prefix FOLDER playcanvas @google/model-viewer filament cesium
    PYTHONPATH=tests python tests/clients/browser_check.py ENGINE BAKED.glb NODE CLIP FOLDER/node_modules

ENGINE is playcanvas, model-viewer, filament or cesium; NODE's mesh has one primitive. It is compared at eight times of
the clip. Prints the greatest distance at each time, as part of the mesh's size; above 1e-4 it fails.
"""

import sys
from pathlib import Path

import numpy as np

from kit.engines import browser_pose
from kit.player import Gltf

# PlayCanvas adds morph targets up in half floats.
_TOLERANCE = 1e-4
_FRAMES = 8


def main(engine: str, path: Path, node: str, clip: str, modules: Path) -> int:
    """Compare; the exit code."""
    file = Gltf(path)
    keys, _ = file.keys(clip, node)
    times = np.linspace(keys[0], keys[-1], _FRAMES, endpoint=False)
    wanted = file.pose(node, clip, times)
    found = browser_pose(engine, file, node, clip, times.tolist(), wanted, modules)
    wrinkles = np.einsum("tk,kvx->tvx", file.weights(node, clip, times), file.deltas(node))
    size = np.ptp(wanted.reshape(-1, 3), axis=0).max()
    gaps, heights = (np.linalg.norm(each, axis=2).max(axis=1) / size for each in (found - wanted, wrinkles))
    for time, gap, height in zip(times, gaps, heights, strict=True):
        print(f"{time:8.3f} s  off by {gap:.2g}; morph targets move up to {height:.2g}")
    return int(gaps.max() > _TOLERANCE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), sys.argv[3], sys.argv[4], Path(sys.argv[5])))
