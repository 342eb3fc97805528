"""Goldens: bakes, and what is said of an asset, are as they were when somebody last looked."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from kit.asset import attribute
from kit.bakes import bake_config, bake_fold, bake_once, place, report_of
from kit.command import Wrinkle
from kit.flesh import body, region
from kit.golden import Golden, wrinkles_of
from kit.limb import RADIUS, limb_asset, tool
from kit.muscles import arm, muscle
from kit.player import Gltf
from kit.touch import plate, touch

Json = dict[str, Any]
TOP, SIDE = 0.8 * RADIUS, 0.6 * RADIUS
# A limb that folds at x = -1/3 and 1/3 has all effects: together they set nearly each key to a value that is not the
# default.
TOOLS: list[Json] = [
    tool(name="cloth", origin=[-0.6, RADIUS, 0.0], target=[-0.05, RADIUS, 0.0], strategy="both_ends", bumps=5, gap=1,
         profile="cloth", compressible="10%", details=[0.3], bow=0.5, seed=3, variation=0.9, branch=0.9),
    {"name": "path", "path": [[0.05, TOP, -SIDE], [0.3, RADIUS, 0.0], [0.6, TOP, SIDE]], "strategy": "origin",
     "bumps": 3, "profile": "polyline", "max_height": "5%", "strength": -0.7, "width": "30%"},
    tool(name="swing", origin=[0.05, TOP, -SIDE], target=[0.6, TOP, -SIDE], profile="skin", attenuation="linear",
         rest_length={"keys": {"fold": [[0.0, "100%"], [1.0, "105%"]]}}, lag={"frequency": 3, "damping": 0.3},
         max_height="none", clips={"fold": 0.8}, snap="vertex"),
    tool(name="leather.L", origin=[-0.6, TOP, SIDE], target=[-0.05, TOP, SIDE], material="leather", mirror="z",
         rest_length={"morph": "morph_0", "full": "110%"}),
]  # fmt: skip
BELOW: Json = {
    "muscles": [muscle(travel=True)],
    "flesh": [{"name": "calf", "at": [0.6, -RADIUS, 0.0], "radius": 0.2, "frequency": 4, "damping": 0.2}],
    "touches": [
        {"name": "inside", "at": [0.5, RADIUS, 0.0], "towards": [0.0, RADIUS, 0.0], "pad": 0.12, "reach": 0.2,
         "keys": {"fold": [[0.2, 0, 0], [0.8, 0.05, 0.02, 0.01], [1.4, -0.03, 0.04, 0.01]]}},
    ],
    "fields": [{"name": "folds", "node": "limb", "wavelength": 0.3}],
    "refinement": {"max_levels": 0},
}  # fmt: skip


@cache
def limb() -> Path:
    return place(
        limb_asset(rings=15, sides=10, joints=3, angle=180.0, morphs=1, morph_clip="CUBICSPLINE", tangents=True)
    )


def limb_with_all_effects() -> Gltf:
    return bake_once(limb(), *TOOLS, top=BELOW, morph_tangents=True, details=True)


def arm_with_muscles() -> Gltf:
    activation = {"keys": {"fold": [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]}}
    crease = tool(origin=[-0.3, RADIUS, 0.0], target=[0.3, RADIUS, 0.0], bumps=2)
    return bake_once(arm(rings=13, sides=8), crease, top={"muscles": [muscle(travel=True, activation=activation)]})


def limb_that_is_touched() -> Gltf:
    keys = {"fold": [[0.2, 0, 0], [0.8, 0.05, 0.02, 0.01], [1.4, -0.03, 0.04, 0.01]]}
    places = {"at": [0.45, RADIUS, 0.0], "towards": [0.0, RADIUS, 0.0], "pad": 0.15, "reach": 0.3}
    touches = [{"name": "inside", **places, "keys": keys}]
    return bake_once(place(limb_asset(rings=12, sides=8)), top={"touches": touches, "refinement": {"max_levels": 0}})


def belly_below_a_strap() -> Gltf:
    asset = body(keys=10)
    positions = attribute(asset, 0, "POSITION")
    nearest = np.argsort(np.linalg.norm(positions - np.array([0.01, 0.03, 0.15]), axis=1))[:3]
    primitive = {"attributes": {"POSITION": asset.accessor(positions[nearest], bounds=True)}}
    mesh = asset.append("meshes", {"primitives": [primitive]})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "strap", "mesh": mesh}))
    return bake_once(place(asset), top={"flesh": [region(limit=0.026)]})


BAKES: dict[str, Callable[[], Gltf]] = {
    "limb": limb_with_all_effects,
    "wrist": lambda: bake_config("wrist", "wrist"),
    "muscles": arm_with_muscles,
    "touch": lambda: bake_once(place(plate()), top={"touches": [touch()], "refinement": {"max_levels": 0}}),
    "bend": limb_that_is_touched,
    "flesh": belly_below_a_strap,
    "head_keyed": lambda: bake_config("head", "head_keyed"),
    "head": lambda: bake_config("head", "head"),
    "trousers": lambda: bake_config("trousers", "trousers"),
    "trousers_field": lambda: bake_config("trousers", "trousers_field"),
}
# What a command is asked of the limb with all effects: before.glb, baked.glb and tools.yaml.
ASKED: dict[str, tuple[str, ...]] = {
    "inspect": ("inspect", "baked.glb"),
    "check": ("check", "before.glb", "tools.yaml", "--verbose"),
    "crossings": ("check", "baked.glb", "--crossings", "--fps", "2"),
    "diff": ("diff", "before.glb", "baked.glb", "--verbose", "--fps", "4"),
    "posed": ("diff", "before.glb", "baked.glb", "--posed", "--fps", "4"),
    "track": ("track", "baked.glb", "before.glb", "-o", "tracked", "--verbose"),
}


@pytest.mark.quick(6)
@pytest.mark.parametrize("name", BAKES)
def test_a_bake_adds_the_same_wrinkles(name: str, golden: Golden) -> None:
    file = BAKES[name]()
    report = report_of(file).data
    for clip in report["clips"]:
        del clip["residual"]  # what rounding leaves
    golden({"wrinkles": wrinkles_of(file), "report": report}, f"bake_{name}.json")


def test_contact_moves_a_fold_as_far_as_before(golden: Golden) -> None:
    """The solver's steps amplify rounding, so that other processors find other shapes of nearly the same size."""
    ((_, found),) = wrinkles_of(bake_fold()).items()
    sizes = [[positions[1], normals[1]] for positions, normals in found["moments"]["fold"]]
    golden([sizes, len(found["shapes"])], "bake_fold.json", tolerance=0.05)


@pytest.fixture
def asked(tmp_path: Path, wrinkle: Wrinkle) -> Callable[..., str]:
    """A command and its arguments give what it says of the limb with all effects."""
    (tmp_path / "before.glb").symlink_to(limb())
    (tmp_path / "baked.glb").symlink_to(limb_with_all_effects().path)
    (tmp_path / "tools.yaml").write_text(yaml.safe_dump({"version": 1, "tools": TOOLS, **BELOW}))

    def run(*arguments: str) -> str:
        ran = wrinkle(*arguments)
        return "\n".join([str(ran.code), ran.out, *ran.lines])

    return run


@pytest.mark.parametrize("name", ASKED)
def test_commands_say_the_same(name: str, asked: Callable[..., str], golden: Golden) -> None:
    golden.text(asked(*ASKED[name]), f"said_{name}.txt")


def test_a_review_looks_as_before(asked: Callable[..., str], golden: Golden) -> None:
    """A tool, a touch and a field have their pictures, an inset, a legend, and what stands beside them."""
    shown = ("--review", "--size", "144x108", "--tool", "path", "--tool", "inside", "--tool", "folds")
    golden.text(asked("preview", "baked.glb", "-o", "baked.png", *shown), "said_review.txt")
    golden.picture(Path("baked.png"), "review_effects.png")
