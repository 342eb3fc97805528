"""Uncommon but valid assets: `suggest` gives tools or a reason, and `diff` compares each with any other."""

from collections.abc import Callable
from pathlib import Path

import pytest

from kit.asset import Asset, attribute
from kit.crowd import crowd_asset, troop_asset
from kit.limb import blendshape_limb, limb_asset, sleeved_limb
from wrinklecli.review.diff.diff import diff
from wrinklecli.review.suggest.suggest import suggest

SMALL = {"rings": 9, "sides": 6}


def one_triangle() -> Asset:
    asset = limb_asset(**SMALL)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    asset.gltf["accessors"][primitive["indices"]]["count"] = 3
    return asset


def with_lines() -> Asset:
    asset = limb_asset(primitives=2, **SMALL)
    asset.gltf["meshes"][0]["primitives"][1]["mode"] = 1  # lines
    return asset


def two_halves() -> Asset:
    asset = limb_asset(rings=5, sides=5, indices=None)
    attribute(asset, 0, "POSITION").reshape(-1, 3, 3)[::2, :, 2] += 3.0
    return asset


def mirrored() -> Asset:
    asset = troop_asset(3)
    for node in asset.gltf["nodes"]:
        if str(node.get("name")).startswith("joint_0_"):
            node["scale"] = [-1.0, 1.0, 1.0]
    return asset


def one_moment() -> Asset:
    asset = limb_asset(clip=None, **SMALL)
    animation: dict[str, object] = {"name": "pose"}
    asset.channel(animation, 2, "rotation", [5.0], [[0.0, 0.0, 0.6, 0.8]])
    asset.append("animations", animation)
    return asset


def in_one_place() -> Asset:
    asset = limb_asset(**SMALL)
    attribute(asset, 0, "POSITION")[:] = 0.0
    return asset


ASSETS: dict[str, Callable[[], Asset]] = {
    "one triangle": one_triangle,
    "lines beside triangles": with_lines,
    "two halves": two_halves,
    "mirrored instances": mirrored,
    "a clip of 0 s": one_moment,
    "in one place": in_one_place,
    "no clip": lambda: limb_asset(clip=None, **SMALL),
    "no normals": lambda: limb_asset(normals=False, **SMALL),
    "nodes that are not skinned": lambda: crowd_asset(3),
    "66 blendshapes": lambda: blendshape_limb(66),
    "hidden": lambda: limb_asset(root={"scale": [0.0, 0.0, 0.0]}, **SMALL),
    "a sleeve": lambda: sleeved_limb(**SMALL),
}


@pytest.mark.quick(1, 3)
@pytest.mark.parametrize("name", ASSETS)
def test_an_uncommon_asset_gets_tools_a_field_or_a_reason(name: str, tmp_path: Path) -> None:
    found = suggest(ASSETS[name]().write(tmp_path / "asset.glb"))
    assert bool(found.tools or found.fields) != bool(found.reason)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ASSETS)
def test_an_uncommon_asset_is_compared_with_others(name: str, tmp_path: Path) -> None:
    asset, other = ASSETS[name]().write(tmp_path / "a.glb"), troop_asset(2).write(tmp_path / "b.glb")
    for comparison in (diff(asset, other), diff(other, asset, posed=True)):
        assert not comparison.same
        assert list(comparison.lines())
    assert diff(asset, ASSETS[name]().write(tmp_path / "again.gltf")).same
