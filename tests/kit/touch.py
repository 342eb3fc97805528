"""A plate of skin on one joint, and touches for it."""

from typing import Any

import numpy as np

from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Array, Asset, Json
from wrinklecli.numeric.arrays import vertex_normals

PAD, REACH, GRIP = 0.016, 0.018, 0.010
SECONDS = 2.0


def touch(**keys: Any) -> Json:
    """A touch of a tools file in the middle of the plate, whose forward is +x."""
    rings = {"bumps": 3, "length": 0.024, "variation": 0, **keys.pop("wrinkles", {})}
    return {
        "name": "spot",
        "at": [0.0, 0.0, 0.0],
        "towards": [0.05, 0.0, 0.0],
        "pad": PAD,
        "reach": REACH,
        "grip": GRIP,
        "press": 0.003,
        "wrinkles": rings,
        "keys": {"drag": [[0.2, 0, 0], [0.6, GRIP, 0, 0.003], [1.0, 0, GRIP, 0.003]]},
        **keys,
    }


def stroked(**keys: Any) -> Json:
    """A touch of a tools file along 80 mm of the plate, towards +x, by the node `tip`."""
    spot = touch(at=[-0.04, 0.0, 0.0], along=[[0.04, 0.0, 0.0]], by="tip")
    return {name: each for name, each in spot.items() if name not in ("towards", "keys")} | keys


def plate(
    size: float = 0.24,
    cells: int = 24,
    *,
    bend: float = 0.0,
    clips: bool = True,
    tip: Array | None = None,
    turns: bool = True,
    sizes: dict[float, float] | None = None,
) -> Asset:
    """A square of skin in the plane y = 0 that faces +y, on a joint that a clip `drag` turns.

    Args:
        size: Length of a side, metres.
        cells: Along a side.
        bend: Curvature along x, one over metres: above 0 the plate is the top of a cylinder.
        clips: False for an asset without a clip.
        tip: (keys, 3) places of a node `tip` before the joint, evenly in the clip `drag`; there is none without.
        turns: False for a joint that keeps still, so that the clip may loop.
        sizes: By second of the clip the joint's scale from then on.
    """
    asset = Asset()
    line = np.linspace(-size / 2, size / 2, cells + 1)
    x, z = (each.reshape(-1) for each in np.meshgrid(line, line, indexing="ij"))
    angle = bend * x
    positions = np.stack(
        [np.sin(angle) / bend if bend else x, (np.cos(angle) - 1) / bend if bend else 0 * x, z], axis=1
    )
    numbers = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]
    triangles = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    count = len(positions)
    attributes = {
        "POSITION": asset.accessor(positions, bounds=True, target=ARRAY_BUFFER),
        "NORMAL": asset.accessor(vertex_normals(positions, triangles), target=ARRAY_BUFFER),
        "JOINTS_0": asset.accessor(np.zeros((count, 4)), "u1", target=ARRAY_BUFFER),
        "WEIGHTS_0": asset.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), target=ARRAY_BUFFER),
    }
    indices = asset.accessor(triangles.reshape(-1), "u2", target=ELEMENT_ARRAY_BUFFER)
    asset.append("meshes", {"primitives": [{"attributes": attributes, "indices": indices}]})
    asset.append("nodes", {"name": "skin", "mesh": 0, "skin": 0})
    asset.append("nodes", {"name": "bone"})
    asset.append("skins", {"joints": [1]})
    asset.append("scenes", {"nodes": [0, 1]})
    asset.gltf["scene"] = 0
    if tip is not None:
        asset.append("nodes", {"name": "tip", "translation": tip[0].tolist()})
        asset.gltf["nodes"][1]["children"] = [2]
    if clips:
        animation: Json = {"name": "drag"}
        turn: Array = np.array([[0, 0, 0, 1.0], [0, 0.3826834, 0, 0.9238795]])
        if turns:
            asset.channel(animation, 1, "rotation", np.array([0.0, SECONDS]), turn)
        if sizes is not None:
            asset.channel(
                animation, 1, "scale", [*sizes], np.array([*sizes.values()])[:, None].repeat(3, axis=1), "STEP"
            )
        if tip is not None:
            asset.channel(animation, 2, "translation", np.linspace(0.0, SECONDS, len(tip)), tip)
        asset.append("animations", animation)
    return asset
