"""A trunk with a belly that jumps, and regions of flesh for it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Array, Asset, Json
from truth.flesh import trunk
from wrinklecli.numeric.arrays import vertex_normals

SECONDS = 2.0

# Heights of hips in a jump, metres at seconds: crouch, flight, landing, and up again.
_HEIGHTS = [(0.0, 0.0), (0.2, -0.06), (0.4, -0.2), (0.55, 0.0), (0.75, 0.2), (0.95, 0.0), (1.08, -0.15), (1.3, -0.08)]


def region(**keys: Any) -> Json:
    """A region of flesh of a tools file, at the belly of the trunk."""
    return {"name": "belly", "at": [0.0, -0.05, 0.18], "radius": 0.13, **keys}


def jump(times: Array) -> Array:
    """(times, 3) places of hips that jump, and land a step ahead."""
    from scipy.interpolate import CubicSpline

    knots = np.array([*_HEIGHTS, (SECONDS, 0.0)])
    ahead = np.clip((times - 0.4) / 0.7, 0.0, 1.0)
    height = CubicSpline(*knots.T, bc_type="clamped")(times)
    return np.stack([0 * times, height, 0.3 * ahead**3 * (10.0 - 15.0 * ahead + 6.0 * ahead**2)], axis=1)


def bob(times: Array) -> Array:
    """(times, 3) places of a joint that goes round and round."""
    turn = 2 * np.pi * times
    return np.stack([0.06 * np.sin(turn), 0.04 * (1.0 - np.cos(2 * turn)), 0 * times], axis=1)


def bob_share(times: Array) -> Array:
    """(times,) the share of `bob` in a motion that goes from `jump` into it between 0.7 and 1.3 s."""
    part = np.clip((times - 0.7) / 0.6, 0.0, 1.0)
    return np.asarray(part**3 * (10.0 - 15.0 * part + 6.0 * part**2))


def body(
    move: Callable[[Array], Array] | None = jump, *, keys: int = 60, normals: bool = True, bobs: bool = False
) -> Asset:
    """A trunk on one joint, which a clip `jump` moves with so many keys a second; without `move` there is no clip.

    With `bobs` there is another clip, `bob`.
    """
    asset = Asset()
    skin, _ = trunk(20, 24)
    positions, triangles = skin.positions, skin.triangles
    count = len(positions)
    attributes = {
        "POSITION": asset.accessor(positions, bounds=True, target=ARRAY_BUFFER),
        "JOINTS_0": asset.accessor(np.zeros((count, 4)), "u1", target=ARRAY_BUFFER),
        "WEIGHTS_0": asset.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), target=ARRAY_BUFFER),
    }
    if normals:
        attributes["NORMAL"] = asset.accessor(vertex_normals(positions, triangles), target=ARRAY_BUFFER)
    indices = asset.accessor(triangles.reshape(-1), "u2", target=ELEMENT_ARRAY_BUFFER)
    asset.append("meshes", {"primitives": [{"attributes": attributes, "indices": indices}]})
    asset.append("nodes", {"name": "trunk", "mesh": 0, "skin": 0})
    asset.append("nodes", {"name": "hips"})
    asset.append("skins", {"joints": [1]})
    asset.append("scenes", {"nodes": [0, 1]})
    asset.gltf["scene"] = 0
    for name, motion in (("jump", move), ("bob", bob if bobs else None)):
        if motion is not None:
            times = np.linspace(0.0, SECONDS, round(SECONDS * keys) + 1)
            animation: Json = {"name": name}
            asset.channel(animation, 1, "translation", times, motion(times))
            asset.append("animations", animation)
    return asset
