"""Channels that name what they move by JSON pointers (KHR_animation_pointer)."""

from typing import Any

from kit.asset import Asset, Interpolation, Json

EXTENSION = "KHR_animation_pointer"


def pointer(text: Any) -> Json:
    """The target of a channel."""
    return {"path": "pointer", "extensions": {EXTENSION: {"pointer": text}}}


def add_pointer(
    asset: Asset, text: str, times: Any, values: Any, interpolation: Interpolation = "LINEAR", *, animation: int = 0
) -> None:
    """Append a channel at weights to an animation."""
    moved = asset.gltf["animations"][animation]
    asset.channel(moved, 0, "weights", times, values, interpolation)
    moved["channels"][-1]["target"] = pointer(text)
    asset.gltf["extensionsUsed"] = [EXTENSION]


def by_pointers(asset: Asset, *, weights: str = "nodes") -> Asset:
    """Turn all channels into pointers; weights become those of `nodes` or of `meshes`."""
    for animation in asset.gltf["animations"]:
        for channel in animation["channels"]:
            node, path = channel["target"]["node"], channel["target"]["path"]
            of_mesh = path == "weights" and weights == "meshes"
            holder = f"meshes/{asset.gltf['nodes'][node]['mesh']}" if of_mesh else f"nodes/{node}"
            channel["target"] = pointer(f"/{holder}/{path}")
    asset.gltf["extensionsUsed"] = [EXTENSION]
    return asset
