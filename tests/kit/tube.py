"""A tube as long as the number of its tools, which all act alike: what each of many tools costs shows."""

from pathlib import Path

import numpy as np

from kit.asset import Asset, Json, attribute
from kit.limb import RADIUS, limb_asset, tool, write_tools

RINGS, SIDES = 4, 8  # of vertices along each scene unit, and around
SLIDE = 0.1  # scene units by which the ends of every other tool come together, and those of the others part


def tube_asset(length: int) -> Asset:
    """A tube along x from 0 to `length`; places of a tool, one in each scene unit, hang on two joints in turns."""
    asset = limb_asset(rings=RINGS * length + 1, sides=SIDES, clip=None)
    positions, weights = attribute(asset, 0, "POSITION"), attribute(asset, 0, "WEIGHTS_0")
    positions[:, 0] = np.round((positions[:, 0] + 1.0) / 2.0 * length * RINGS) / RINGS
    number = asset.gltf["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    asset.gltf["accessors"][number] |= {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
    attribute(asset, 0, "JOINTS_0")[:] = [0, 1, 0, 0]
    share = 0.5 - 0.5 * np.cos(np.pi * positions[:, 0])
    weights[:] = np.stack([1.0 - share, share, 0.0 * share, 0.0 * share], axis=1)
    animation: Json = {"name": "slide"}
    rest = np.array(asset.gltf["nodes"][2]["translation"])
    asset.channel(animation, 2, "translation", [0.0, 1.0, 2.0], rest - np.outer([0.0, SLIDE, 0.0], [1.0, 0.0, 0.0]))
    asset.append("animations", animation)
    return asset


def tube_tools(length: int) -> list[Json]:
    """A tool in each scene unit of a tube; every other one is longer than its place, and lessens as that is pulled."""
    ends = [([k + 0.25, RADIUS, 0.0], [k + 0.75, RADIUS, 0.0]) for k in range(length)]
    return [
        tool(name=f"t{k}", origin=low, target=high, bumps=2, rest_length="110%" if k % 2 else "auto")
        for k, (low, high) in enumerate(ends)
    ]


def write_tube(folder: Path, length: int) -> tuple[Path, Path]:
    """Write a tube and its tools file."""
    asset = tube_asset(length).write(folder / f"tube_{length}.gltf")
    return asset, write_tools(folder / f"tube_{length}.yaml", *tube_tools(length))
