"""Many nodes that show one limb, and many meshes that show one after another: what each of many costs shows."""

from pathlib import Path

import numpy as np

from kit.asset import Asset
from kit.limb import LENGTH, limb_asset, tool, write_tools
from wrinklecli import bake


def crowd_asset(count: int, *, prefix: str = "limb", skinned: bool = False) -> Asset:
    """A limb that so many more nodes show: of one pose, which all follow, or on a square grid, each in its place."""
    asset = limb_asset(rings=7, sides=6, skinned=skinned)
    side = int(np.ceil(np.sqrt(count)))
    for number in range(count):
        place = [1.25 * LENGTH * (1 + number % side), 0.5 * LENGTH * (number // side), 0.0]
        moved = {"skin": 0} if skinned else {"translation": place}
        node = asset.append("nodes", {"name": f"{prefix}_{number}", "mesh": 0, **moved})
        asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


def troop_asset(count: int, *, own_clips: bool = False, clip: bool = True) -> Asset:
    """So many limbs on a square grid that show one mesh, each with joints of its own.

    One clip folds all; with `own_clips` each has one of its own. `clip` is False for no clip.
    """
    asset = limb_asset(rings=7, sides=6)
    gltf = asset.gltf
    (skin,), (fold,) = gltf["skins"], gltf["animations"]
    (channel,) = fold["channels"]
    side = int(np.ceil(np.sqrt(count)))
    for number in range(1, count):
        x, y = 1.5 * LENGTH * (number % side), LENGTH * (number // side)
        first = len(gltf["nodes"])
        asset.append("nodes", {"name": f"limb_{number}", "mesh": 0, "skin": number})
        asset.append("nodes", {"name": f"joint_0_{number}", "translation": [x - 1.0, y, 0.0], "children": [first + 2]})
        asset.append("nodes", {"name": f"joint_1_{number}", "translation": [1.0, 0.0, 0.0]})
        asset.append("skins", {**skin, "joints": [first + 1, first + 2], "skeleton": first + 1})
        gltf["scenes"][0]["nodes"] += [first, first + 1]
        turned = {**channel, "target": {"node": first + 2, "path": "rotation"}}
        if own_clips:
            asset.append("animations", {**fold, "name": f"fold_{number}", "channels": [turned]})
        else:
            fold["channels"].append(turned)
    if not clip:
        del gltf["animations"]
    return asset


def write_crowds(folder: Path, count: int) -> tuple[Path, Path]:
    """Write two crowds on a grid; in the second, one of them is elsewhere by less than anybody sees."""
    first, second = crowd_asset(count), crowd_asset(count)
    second.gltf["nodes"][-1]["translation"][2] += 1e-6
    return first.write(folder / f"crowd_{count}.gltf"), second.write(folder / f"moved_{count}.gltf")


def write_frames(folder: Path, count: int) -> tuple[Path, Path]:
    """Bake a limb to so many frames, of a mesh each, twice; wrinkles of the second are a little lower."""
    asset = limb_asset(rings=7, sides=6).write(folder / "limb.glb")
    outs = folder / f"frames_{count}.glb", folder / f"lower_{count}.glb"
    for out, strength in zip(outs, (1.0, 0.999999), strict=True):
        tools = write_tools(folder / "frames.yaml", tool(bumps=2, strength=strength))
        bake(asset, tools, out, mode="frames", fps=(count - 1) / 2.0)
    return outs
