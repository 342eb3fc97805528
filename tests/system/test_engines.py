"""Engines that compute positions themselves play what our player plays, however morph targets are stored."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kit.bakes import bake_config, bake_fold, bake_once, place
from kit.clients import HERE as CLIENTS
from kit.clients import assert_valid, compare_with_three, pose
from kit.engines import babylon_pose, browser_pose, through_assimp, vtk_pose
from kit.limb import RADIUS, blendshape_limb, limb_asset, tool
from kit.player import Floats, Gltf
from wrinklecli.numeric.intersections import Crossings

TIMES = (0.0, 0.35, 0.5, 0.9, 1.3)


def idle_part(stored: str) -> Gltf:
    """Three primitives, of which a tool touches the one in the middle."""
    crease = tool(origin=[-0.3, RADIUS, 0.0], target=[0.3, RADIUS, 0.0])
    return bake_once(place(limb_asset(primitives=3)), crease, accessors=stored)


# Node, clip, and the bake with its morph targets stored in some way.
CASES: dict[str, tuple[str, str, Callable[[str], Gltf]]] = {
    "skin": ("wrist", "flex", lambda stored: bake_config("wrist", "wrist", accessors=stored)),
    "idle_part": ("limb", "fold", idle_part),
    "blendshapes": (
        "limb",
        "fold",
        lambda stored: bake_once(place(blendshape_limb(3)), tool(bumps=6), accessors=stored),
    ),
    "contact": ("limb", "fold", lambda stored: bake_fold(accessors=stored)),
    "touch": ("touch", "drag", lambda stored: bake_config("touch", "touch", accessors=stored)),
    "face": ("head", "raise_brows", lambda stored: bake_config("head", "head", accessors=stored)),
}


def bakes(cases: tuple[str, ...], stored: tuple[str, ...], *, also: tuple[str, ...] = ()) -> pytest.MarkDecorator:
    """A case for each asset and each way of storing its morph targets; of some more assets the first way alone.

    Assets of one primitive store their targets alike, whatever has made these.
    """
    every = [(case, each) for case in cases for each in stored]
    return pytest.mark.parametrize(("case", "stored"), every + [(case, stored[0]) for case in also])


def played(file: Gltf, node: str, clip: str) -> Floats:
    """(times, vertices, 3) positions as our player has them, with wrinkles that an engine could miss."""
    posed = file.pose(node, clip, TIMES)
    moved = np.einsum("tk,kvx->tvx", file.weights(node, clip, TIMES), file.deltas(node))
    assert np.abs(moved).max() > 1e-3 * np.abs(posed).max()
    return posed


@pytest.mark.quick(1)
@bakes(("blendshapes", "idle_part", "skin"), ("sparse", "dense"), also=("contact", "touch", "face"))
def test_babylon_plays_the_bake(case: str, stored: str) -> None:
    """Not based ones: it writes the first accessor's numbers into the zeros that all others stand on."""
    node, clip, bake = CASES[case]
    posed = played(bake(stored), node, clip)
    shown = babylon_pose(bake(stored).path, node, clip, TIMES)
    assert np.abs(shown - posed).max() < 2e-6 * np.abs(posed).max()


@pytest.mark.quick(1)
@bakes(("idle_part", "blendshapes", "skin"), ("based", "dense"))
def test_three_plays_the_bake(case: str, stored: str) -> None:
    """Sparse ones are played in many other tests."""
    node, clip, bake = CASES[case]
    compare_with_three(bake(stored).path, node, clip, TIMES, played(bake(stored), node, clip))


@pytest.mark.slow
@pytest.mark.long
def test_filament_plays_the_bake() -> None:
    """Chromium runs its own shaders; targets are `based`, as `--engine filament` stores them."""
    file = bake_config("wrist", "wrist", accessors="based")
    posed = played(file, "wrist", "flex")
    shown = browser_pose("filament", file, "wrist", "flex", TIMES, posed)
    assert np.abs(shown - posed).max() < 4e-6 * np.abs(posed).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "package", "options"),
    [
        ("playcanvas", "playcanvas", {}),
        ("model-viewer", "@google/model-viewer", {}),
        ("cesium", "cesium", {"engine": "cesium"}),
    ],
)
def test_an_engine_plays_the_bake_where_it_is_installed(engine: str, package: str, options: dict[str, str]) -> None:
    """It is in a folder that WRINKLE_ENGINES names, as `npm ci` omits large ones. PlayCanvas has half floats."""
    modules = Path(os.environ.get("WRINKLE_ENGINES", CLIENTS / "node_modules"))
    if not (modules / package).is_dir():
        pytest.skip(f"{package} is not installed: npm install {package}, and name its node_modules as WRINKLE_ENGINES")
    file = bake_config("wrist", "wrist", **options)
    posed = played(file, "wrist", "flex")
    shown = browser_pose(engine, file, "wrist", "flex", TIMES, posed, modules)
    assert np.abs(shown - posed).max() < 5e-5 * np.abs(posed).max()


@pytest.mark.slow
@bakes(("blendshapes", "skin"), ("dense", "based"), also=("face",))
def test_vtk_plays_the_bake(case: str, stored: str) -> None:
    """Four targets at most: a vertex that others move is left out. Of several primitives VTK bends only the first."""
    node, clip, bake = CASES[case]
    file = bake(stored)
    posed = played(file, node, clip)
    shown = vtk_pose(file.path, [each["name"] for each in file.json["animations"]].index(clip), TIMES)
    gaps = np.abs(shown - posed).max(axis=(0, 2))
    missed = np.abs(file.deltas(node)[4:]).max(axis=(0, 2), initial=0.0) > 0
    assert gaps[~missed].max() < 2e-6 * np.abs(posed).max()


@pytest.mark.quick(3)
@bakes(("idle_part", "blendshapes", "skin"), ("sparse", "based", "dense"), also=("contact", "face"))
def test_assimp_reads_and_writes_the_bake(case: str, stored: str, tmp_path: Path) -> None:
    node, _, bake = CASES[case]
    file = bake(stored)
    made = through_assimp(file.path, tmp_path)
    assert np.array_equal(made.attribute(node, "POSITION"), file.attribute(node, "POSITION"))
    # What it holds are moved vertices; of normals it writes none.
    step = 4e-7 * np.abs(file.attribute(node, "POSITION")).max()
    assert np.abs(made.deltas(node) - file.deltas(node)).max() < step


@pytest.mark.slow
def test_nothing_crosses_where_three_plays_contact() -> None:
    """At keys and between them, by its own positions; without contact the limb goes through itself there."""
    file, without = bake_fold(), bake_fold(contact="off")
    assert_valid(file.path)
    keys, _ = file.keys("fold", "limb")
    times = np.union1d(keys, (keys[1:] + keys[:-1]) / 2)
    compare_with_three(file.path, "limb", "fold", times.tolist(), file.pose("limb", "fold", times))
    assert crossings_in_three(file, times) == 0
    assert crossings_in_three(without, times) > 0


def crossings_in_three(file: Gltf, times: Floats) -> int:
    """Edges that pass through triangles at all of (times,) of the fold, seams welded."""
    rest = file.attribute("limb", "POSITION")
    _, first, weld = np.unique(rest, axis=0, return_index=True, return_inverse=True)
    crossings = Crossings.of(rest[first], weld[file.triangles("limb")])
    posed = pose(file.path, node="limb", clip="fold", times=times.tolist(), vertices=first.tolist())
    return sum(len(crossings.at(places)[0]) for places in posed)
