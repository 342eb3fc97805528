"""Godot 4 plays a bake, runs the driver, and blends maps; the shaders for Unity and Unreal blend them alike."""

import io
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from kit.godot4 import DRIVER, WEIGHTS, answers
from kit.player import Floats

pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_godot_4_plays_the_bake() -> None:
    """A plain bake by its own vertex shaders, and maps of further coordinates; the engine complains of nothing."""
    found, _ = answers()
    assert found["gap"] < 2e-5
    errors = [line for line in found["said"] if "ERROR" in line]
    # What an editor would have written.
    assert errors == ["ERROR: Could not load global script cache."]


def test_the_node_of_godot_4_sets_the_weights_of_the_tracks() -> None:
    """The frames are of a clip whose poses are imported 240 times a second."""
    _, baked, driven = np.array(answers()[0]["driven"]).T
    assert baked.max() > 0.9
    assert np.abs(driven - baked).max() < 0.01


def test_godot_4_gives_the_weights_due() -> None:
    for name, case in json.loads((DRIVER / "vectors.json").read_text()).items():
        for run, played in zip(case["runs"], answers()[0]["vectors"][name]["runs"], strict=True):
            wanted = np.array(run["weights"])
            assert np.abs(np.array(played)[-len(wanted) :] - wanted).max() < case["tolerance"], (name, run["clip"])


@pytest.mark.parametrize("engine", ["godot", "unity", "unreal"])
def test_shaders_blend_maps_as_the_page_says(engine: str) -> None:
    """Within what 8 bits of a normal and of a share of the sky tell; the green of Unreal points down."""
    normals, seen = due()
    folder = answers()[1]
    if engine == "godot":
        shown = opened(folder / "godot.png", "RGBA")
    else:
        shown = np.frombuffer((folder / engine).read_bytes(), np.uint8).reshape(*seen.shape, 4) / 255.0
    found = (2.0 * shown[..., :3] - 1.0) * ([1.0, -1.0, 1.0] if engine == "unreal" else 1.0)
    found /= np.linalg.norm(found, axis=2, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(np.sum(found * normals, axis=2), -1.0, 1.0)))
    assert np.degrees(np.arccos(normals[..., 2].min())) > 30.0
    assert angles.max() < 0.7
    assert np.abs(shown[..., 3] - seen).max() < 0.6 / 255


@cache
def due() -> tuple[Floats, Floats]:
    """The page of the samples says what maps hold: normals, and the share of the sky that is seen."""
    folder = answers()[1] / "maps"
    (material,) = json.loads((folder / "maps.json").read_text())["materials"]
    slopes: Any = 0.0
    seen: Any = 1.0
    for each, weights in zip(material["sets"], WEIGHTS, strict=True):
        normal = opened(folder / each["normal"], "RGB") * 255.0 / 127.5 - 1.0
        mask = opened(folder / each["weights"][0]["mask"], "RGBA")
        share = sum(
            mask[..., "rgba".index(weight["channel"])] * weights["rgba".index(weight["channel"])]
            for weight in each["weights"]
        )
        slopes = slopes + (share / normal[..., 2])[..., None] * normal[..., :2]
        seen = seen * (1.0 + share * (opened(folder / each["ao"], "L") - 1.0))
    normals = np.concatenate([slopes, np.ones((*seen.shape, 1))], axis=2)
    return normals / np.linalg.norm(normals, axis=2, keepdims=True), seen


def opened(path: Path, mode: str) -> Floats:
    """The pixels of a picture, 0 to 1."""
    return np.asarray(Image.open(io.BytesIO(path.read_bytes())).convert(mode)) / 255.0
