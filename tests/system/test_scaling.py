"""How work grows with what a file has many of, counted in calls and bytes instead of seconds."""

import tracemalloc
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kit.asset import Asset
from kit.limb import limb_asset
from kit.tube import write_tube
from wrinklecli import bake
from wrinklecli.baking import pipeline, placement
from wrinklecli.character import rig, scene
from wrinklecli.gltf.document import read_document
from wrinklecli.review.check import check
from wrinklecli.review.diff import motion
from wrinklecli.review.diff.diff import diff


def instances(count: int, *, prefix: str = "limb") -> Asset:
    """A limb that so many nodes show."""
    asset = limb_asset(rings=7, sides=6)
    for number in range(count):
        node = asset.append("nodes", {"name": f"{prefix}_{number}", "mesh": 0, "skin": 0})
        asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


def counted(monkeypatch: pytest.MonkeyPatch, tally: Counter[str], module: Any, name: str) -> None:
    """Count the calls of a function, as a module knows it."""
    function: Callable[..., Any] = getattr(module, name)

    def counting(*arguments: Any, **options: Any) -> Any:
        tally[name] += 1
        return function(*arguments, **options)

    monkeypatch.setattr(module, name, counting)


def test_nodes_of_a_scene_are_read_once_and_share_what_they_show(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    tally = Counter[str]()
    for name in ("read_hierarchy", "read_primitive"):
        counted(monkeypatch, tally, scene, name)
    document = read_document(instances(100).write(tmp_path / "limbs.glb"))
    shown = scene.read_scene(document)
    assert (len(shown), tally["read_hierarchy"], tally["read_primitive"]) == (101, 1, 1)
    assert len({id(each.rig.locals) for each in shown}) == len({id(each.vertices) for each in shown}) == 1
    assert [each.rig.node for each in shown] == [
        0,
        *range(len(document.items("nodes")) - 100, len(document.items("nodes"))),
    ]


def test_memory_of_a_scene_grows_with_its_nodes(tmp_path: Path) -> None:
    sizes = []
    for count in (200, 400):
        document = read_document(instances(count).write(tmp_path / "limbs.glb"))
        scene.read_scene(document)  # what is kept of the document is not the scene's
        tracemalloc.start()
        shown = scene.read_scene(document)
        sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        assert len(shown) == count + 1
    assert sizes[1] < 2.2 * sizes[0]


@pytest.mark.parametrize("prefix", ["limb", "renamed"])
def test_instances_are_posed_a_few_times_each(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, prefix: str) -> None:
    calls = []
    for count in (20, 40):
        a = instances(count).write(tmp_path / "a.glb")
        other = instances(count, prefix=prefix)
        other.gltf["nodes"][2]["name"] = "another"
        b = other.write(tmp_path / "b.glb")
        tally = Counter[str]()
        with monkeypatch.context() as patched:
            counted(patched, tally, motion, "pose_primitive")
            counted(patched, tally, rig, "_stored_local")
            diff(a, b)
        calls.append(tally)
    for name in ("pose_primitive", "_stored_local"):
        assert calls[1][name] <= 2.2 * calls[0][name], name


def test_proof_holds_of_each_target_what_it_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prove, peaks = pipeline.prove, []

    def watched(*arguments: Any, **options: Any) -> Any:
        tracemalloc.start()
        residuals = prove(*arguments, **options)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        return residuals

    monkeypatch.setattr(pipeline, "prove", watched)
    bake(*write_tube(tmp_path, 32), tmp_path / "out.glb")
    # Frames take 9 MB. 32 targets of all 4,000 vertices, positions and normals, would be 6 MB, and twice as much while
    # those that are compared are chosen.
    assert len(peaks) == 1
    assert peaks[0] < 14e6


def test_a_tool_compares_its_wrinkles_with_what_is_near(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    near, found = placement._near_box, []

    def counting(*arguments: Any, **options: Any) -> Any:
        found.append(near(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(placement, "_near_box", counting)
    check(*write_tube(tmp_path, 12))
    triangles = 1 + max(int(each.max()) for each in found)
    assert max(map(len, found)) < triangles / 4
