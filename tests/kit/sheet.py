"""Sheets: ribbons of any profile, which a morph target squeezes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kit.asset import Asset
from kit.player import Json
from wrinklecli.numeric.arrays import vertex_normals

Floats = NDArray[np.float64]

REACH = 0.4  # of the tool on a sheet, scene units to either side of the middle


def sheet(path: Path, *profiles: Sequence[Sequence[float]], clip: bool = True, smooth: bool = False) -> Path:
    """A mesh of ribbons, each an (x, y) line drawn out along z from -0.5 to 0.5; the clip halves its x.

    What lies to the left of a line, seen towards +z, is its outside: +y of one that runs to +x. Without normals it is
    shaded flat; it has some if it is `smooth`.
    """
    positions, faces = [], []
    depths = np.linspace(-0.5, 0.5, 11)
    for profile in profiles:
        line = np.array(profile, np.float64)
        start = sum(len(each) for each in positions)
        points = [(x, y, z) for x, y in line for z in depths]
        for k in range(len(line) - 1):
            for j in range(len(depths) - 1):
                a = start + k * len(depths) + j
                b, c, d = a + 1, a + len(depths), a + len(depths) + 1
                faces += [(a, b, c), (b, d, c)]
        positions.append(np.array(points))
    every = np.concatenate(positions)
    asset = Asset()
    normals = {"NORMAL": asset.accessor(vertex_normals(every, np.array(faces)))} if smooth else {}
    asset.append(
        "meshes",
        {
            "primitives": [
                {
                    "attributes": {"POSITION": asset.accessor(every), **normals},
                    "indices": asset.accessor(np.ravel(faces), "u2"),
                    "targets": [{"POSITION": asset.accessor(every * [-0.5, 0.0, 0.0])}],
                }
            ]
        },
    )
    asset.append("nodes", {"mesh": 0, "name": "sheet"})
    if clip:
        animation: Json = {"name": "squeeze"}
        asset.channel(animation, 0, "weights", [0.0, 1.0, 1.5], [[0.0], [1.0], [0.0]])
        asset.append("animations", animation)
    return asset.write(path)


def arc(degrees: float) -> Floats:
    """A profile that is an arc between (-REACH, 0) and (REACH, 0), and goes on a little."""
    half = np.radians(degrees) / 2
    radius = REACH / np.sin(half)
    angles = np.linspace(-1.05 * half, 1.05 * half, 85)
    return np.stack([radius * np.sin(angles), radius * (np.cos(angles) - np.cos(half))], axis=1)


def line(start: float, stop: float, y: float = 0.0) -> Floats:
    return np.stack([np.linspace(start, stop, 21), np.full(21, y)], axis=1)
