"""Wrinkles and folds stay below what lies over a surface: another mesh, or another piece of its own."""

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

from kit.asset import ARRAY_BUFFER, Asset, attribute, stored
from kit.bakes import place
from kit.garments import FOLDS, tube
from kit.limb import RADIUS, tool
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.numeric.arrays import Bools, Floats

GAP = 0.01  # scene units between the tube and the layer over a part of it
LOW, HIGH = -0.3, 0.1  # that part of the length


def under(how: str) -> Asset:
    """The bent tube with a wider, shorter one over it: in a mesh of its own, in its mesh, or not at all."""
    asset = tube()
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    places, faces = attribute(asset, 0, "POSITION"), stored(asset, primitive["indices"]).reshape(-1, 3)
    wider = places * np.array([1.0, 1.0 + GAP / RADIUS, 1.0 + GAP / RADIUS])
    inside = (places[:, 0] >= LOW) & (places[:, 0] <= HIGH)
    over = {
        "attributes": {**primitive["attributes"], "POSITION": asset.accessor(wider, target=ARRAY_BUFFER)},
        "indices": asset.accessor(faces[inside[faces].all(axis=1)].ravel(), "u2"),
    }
    if how == "piece":
        asset.gltf["meshes"][0]["primitives"].append(over)
    elif how == "mesh":
        mesh = asset.append("meshes", {"primitives": [over]})
        asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "over", "mesh": mesh, "skin": 0}))
    return asset


@cache
def rises(how: str, kind: str) -> tuple[Bools, Floats]:
    """(vertices,) which of the tube are under the layer, and how far each rises at most in the clip, scene units."""
    path = place(under(how))
    effects: dict[str, Any] = {"fields": [{**FOLDS, "node": "limb", "wavelength": "9%"}]}
    if kind == "tool":
        effects = {"tools": [tool(node="limb", strategy="everywhere", bumps=2, max_height=6.0 * GAP)]}
    file = path.with_suffix(".yaml")
    file.write_text(json.dumps({"version": 1, **effects}))
    job = read_job(path, file, BakeOptions(max_levels=2))
    (made,) = plan_meshes(job)
    (part,) = made.parts
    (clip,) = job.every_clip
    moves = part.displacements(made.fine, made.rig, clip, np.linspace(clip.start, clip.end, 25))
    found = np.zeros(len(made.fine.positions))
    found[part.vertices] = np.sqrt((moves**2).sum(axis=2)).max(axis=0)
    x, y, z = made.fine.rest_positions.T
    return (x > LOW) & (x < HIGH) & (np.hypot(y, z) < RADIUS + 0.5 * GAP), found


@pytest.mark.parametrize("kind", ["field", "tool"])
@pytest.mark.parametrize("how", ["mesh", "piece"])
def test_nothing_rises_through_a_layer_over_it(how: str, kind: str) -> None:
    """It is about as high as there is room, as it fades smoothly, and farther away as without the layer."""
    (covered, found), (bare, free) = rises(how, kind), rises("alone", kind)
    assert free[bare].max() > 2.0 * GAP
    assert GAP / 4.0 < found[covered].max() < 1.2 * GAP
    assert found[~covered].max() > 0.5 * free[~bare].max()
