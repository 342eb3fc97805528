"""A sleeve that bends at two joints, and a field of wrinkles over it."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from kit.asset import Asset, Json
from kit.bakes import bake_once, place
from kit.limb import limb_asset
from kit.player import Gltf


def sleeve(**options: Any) -> Asset:
    """A limb, node `limb`, whose clip `fold` bends both joints by 50°, and whose clip `wave` bends one to the sides."""
    asset = limb_asset(**{"rings": 16, "sides": 10, "joints": 3, **options})
    wave: Json = {"name": "wave"}
    half = np.radians([0.0, 25.0, -20.0, 0.0]) / 2.0
    turns = np.stack([0 * half, np.sin(half), 0 * half, np.cos(half)], axis=1)
    asset.channel(wave, 2, "rotation", [0.0, 0.5, 1.0, 1.5], turns)
    asset.append("animations", wave)
    return asset


def field(**keys: Any) -> Json:
    """A field of a tools file."""
    return {"name": "folds", "node": "limb", **keys}


@cache
def _placed() -> Path:
    return place(sleeve())


def bake_field(keys: Json | None = None, **options: Any) -> Gltf:
    """The sleeve with a field of such keys, as coarse as it is."""
    top = {"fields": [field(**(keys or {}))]}
    return bake_once(_placed(), top=top, **{"max_levels": 0, **options})


def sleeve_and_field(folder: Path, **keys: Any) -> tuple[Path, Path]:
    """The sleeve, and a tools file with a field of such keys that leaves the mesh as coarse as it is."""
    file = folder / "field.yaml"
    file.write_text(yaml.safe_dump({"version": 1, "refinement": {"max_levels": 0}, "fields": [field(**keys)]}))
    return _placed(), file


# Turns of the sleeve's joints with rows of simple numbers: one shape after another, both sides of a joint, and two
# joints that count as one.
TURNS: list[Json] = [
    {
        "joint": "joint_1",
        "parent": "joint_0",
        "rest": [0.0, 0.0, 0.0, 1.0],
        "axis": [0.0, 0.0, 1.0],
        "angles": [0.0, 0.2, 0.5, 0.8],
        "weights": [[0.0, 0.0], [0.1, 0.9], [0.6, 0.7], [1.0, 0.0]],
        "raises": [0, 1],
    },
    {
        "joint": "joint_1",
        "parent": "joint_0",
        "rest": [0.0, 0.0, 0.0, 1.0],
        "axis": [0.0, 1.0, 0.0],
        "angles": [-0.3, 0.0, 0.4],
        "weights": [[0.5], [0.0], [1.0]],
        "raises": [2],
    },
    {
        "joint": "joint_2",
        "parent": "joint_0",
        "rest": [0.0, 0.0, 0.0, 1.0],
        "axis": [0.0, 0.0, 1.0],
        "angles": [0.2, 1.9],
        "weights": [[0.0, 0.2], [1.0, 0.3]],
        "raises": [3, 4],
    },
]


@cache
def sleeve_with_turns() -> Gltf:
    """The sleeve as after a bake of a field with these turns, whose targets are its own."""
    asset = sleeve(morphs=5)
    drive = {"name": "folds", "turns": TURNS, "strengths": {"fold": 0.5}, "strength": 0.8}
    entry = {"layout": 3, "method": 5, "tools": [], "fields": [{**drive, "targets": [f"morph_{k}" for k in range(5)]}]}
    asset.gltf["nodes"][0]["extras"] = {"wrinkle": entry}
    return Gltf(place(asset))
