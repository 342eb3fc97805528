"""A forehead: a flat sheet of skin on one joint, and morph targets that raise the brows in two arches."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Array, Asset, Json

BROWS: Json = {
    "name": "brow",
    "origin": [0.3, -0.6, 0.0],
    "target": [0.3, 0.6, 0.0],
    "width": 1.2,
    "bumps": 3,
    "variation": 0.0,
}
"""A tool beside the middle, from the brow to the hairline."""


def brow_deltas(positions: Array, *, side: int = 0) -> Array:
    """(vertices, 3) move of brows that rise, on both sides or, with 1 or -1, on that of the positive or negative x."""
    x, y, _ = positions.T
    up = 0.3 * (1.0 - np.sin(0.5 * np.pi * y)) * (0.3 + 0.7 * np.sin(np.pi * x) ** 2)
    share = 0.5 * (1.0 + side * np.sin(0.5 * np.pi * x)) if side else 1.0
    return np.stack([0.0 * x, 0.5 * up * share, 0.2 * up * share], axis=1)


def forehead(
    *,
    count: int = 9,
    targets: Sequence[str] = ("browsUp",),
    clip: str | None = "raise",
    scale: float = 1.0,
) -> Asset:
    """A sheet of (count - 1)² quads in the plane z = 0, from -1 to 1 along x and y; up is +y, and +z is outside.

    A target whose name ends in Left or Right moves that side alone, where left is +x. `blink` moves nothing above
    y = -0.5, `small` shrinks everything by 40 %, and `meet` brings all to y = 0 at a weight of 0.75. The clip raises
    the first target to 1 in a second, and lowers it again. Everything is multiplied by `scale`.
    """
    asset = Asset()
    line = np.linspace(-1.0, 1.0, count)
    x, y = (each.ravel() for each in np.meshgrid(line, line))
    positions = np.stack([x, y, 0.0 * x], axis=1)
    corners = np.add.outer(count * np.arange(count - 1), np.arange(count - 1))
    faces = np.add.outer(corners, [0, 1, count + 1, 0, count + 1, count]).reshape(-1)
    first = np.tile([1, 0, 0, 0], (len(positions), 1))
    mesh: dict[str, Any] = {
        "attributes": {
            "POSITION": asset.accessor(scale * positions, bounds=True, target=ARRAY_BUFFER),
            "NORMAL": asset.accessor(np.tile([0.0, 0.0, 1.0], (len(positions), 1)), target=ARRAY_BUFFER),
            "JOINTS_0": asset.accessor(0 * first, "u1", target=ARRAY_BUFFER),
            "WEIGHTS_0": asset.accessor(np.float64(first), target=ARRAY_BUFFER),
        },
        "indices": asset.accessor(faces, "u2", target=ELEMENT_ARRAY_BUFFER),
        "targets": [{"POSITION": asset.accessor(scale * _deltas(positions, name), bounds=True)} for name in targets],
    }
    asset.append("meshes", {"primitives": [mesh], "extras": {"targetNames": list(targets)}})
    asset.append("nodes", {"name": "forehead", "mesh": 0, "skin": 0})
    asset.append("nodes", {"name": "head"})
    asset.append("skins", {"joints": [1]})
    asset.append("scenes", {"nodes": [0, 1]})
    asset.gltf["scene"] = 0
    if clip is not None:
        animation: Json = {"name": clip}
        weights = np.zeros((3, len(targets)))
        weights[1, 0] = 1.0
        asset.channel(animation, 0, "weights", [0.0, 1.0, 2.0], weights)
        asset.append("animations", animation)
    return asset


def _deltas(positions: Array, name: str) -> Array:
    if name == "small":
        return -0.4 * positions
    if name == "meet":
        return positions * [0.0, -4.0 / 3.0, 0.0]
    if name == "blink":
        return np.where(positions[:, 1:2] < -0.5, [[0.0, -0.1, 0.0]], 0.0)
    return brow_deltas(positions, side=name.endswith("Left") - name.endswith("Right"))
