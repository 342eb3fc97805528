"""How work grows with what a file has many of, counted in calls and bytes instead of seconds."""

import tracemalloc
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset
from kit.crowd import crowd_asset, troop_asset, write_frames
from kit.limb import RADIUS, limb_asset, tool, write_tools
from kit.prepared import prepare
from kit.tube import write_tube
from kit.work import calls_of
from wrinklecli import bake
from wrinklecli.baking import pipeline
from wrinklecli.baking.baked_body import BakedBody
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.baking.track import track
from wrinklecli.character import contacts, rig, scene
from wrinklecli.character.skin import SkinnedMesh
from wrinklecli.effects.wrinkle import warnings
from wrinklecli.gltf.document import read_document
from wrinklecli.review import check as check_module
from wrinklecli.review.check import check
from wrinklecli.review.diff import compare_motion
from wrinklecli.review.diff.diff import diff
from wrinklecli.review.suggest import measure
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.surface import refine


def counted(
    monkeypatch: pytest.MonkeyPatch,
    tally: Counter[str],
    module: Any,
    name: str,
    *,
    amount: Callable[..., int] = lambda *_, **_options: 1,
) -> None:
    """Count the calls of a function, as a module knows it, or what `amount` makes of their arguments."""
    function: Callable[..., Any] = getattr(module, name)

    def counting(*arguments: Any, **options: Any) -> Any:
        tally[name] += amount(*arguments, **options)
        return function(*arguments, **options)

    monkeypatch.setattr(module, name, counting)


def test_nodes_of_a_scene_are_read_once_and_share_what_they_show(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    tally = Counter[str]()
    for name in ("read_hierarchy", "read_primitive"):
        counted(monkeypatch, tally, scene, name)
    document = read_document(crowd_asset(100, skinned=True).write(tmp_path / "limbs.glb"))
    shown = scene.read_scene(document)
    assert (len(shown), tally["read_hierarchy"], tally["read_primitive"]) == (101, 1, 1)
    assert len({id(each.rig.locals) for each in shown}) == len({id(each.vertices) for each in shown}) == 1
    assert [each.rig.node for each in shown] == [
        0,
        *range(len(document.items("nodes")) - 100, len(document.items("nodes"))),
    ]


@pytest.mark.slow
def test_memory_of_a_scene_grows_with_its_nodes(tmp_path: Path) -> None:
    sizes = []
    for count in (200, 400):
        document = read_document(crowd_asset(count, skinned=True).write(tmp_path / "limbs.glb"))
        scene.read_scene(document)  # what is kept of the document is not the scene's
        tracemalloc.start()
        shown = scene.read_scene(document)
        sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        assert len(shown) == count + 1
    assert sizes[1] < 2.2 * sizes[0]


@pytest.mark.quick(1)
@pytest.mark.parametrize("prefix", ["limb", "renamed"])
def test_instances_are_posed_a_few_times_each(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, prefix: str) -> None:
    calls = []
    for count in (20, 40):
        a = crowd_asset(count, skinned=True).write(tmp_path / "a.glb")
        other = crowd_asset(count, prefix=prefix, skinned=True)
        other.gltf["nodes"][2]["name"] = "another"
        b = other.write(tmp_path / "b.glb")
        tally = Counter[str]()
        with monkeypatch.context() as patched:
            counted(patched, tally, SkinnedMesh, "posed")
            counted(patched, tally, rig, "_stored_local")
            diff(a, b)
        calls.append(tally)
    for name in ("posed", "_stored_local"):
        assert calls[1][name] <= 2.2 * calls[0][name], name


@pytest.mark.slow
def test_instances_that_move_alike_are_measured_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tally = Counter[str]()
    for name in ("read_surface", "spread_sites", "find_peaks"):
        counted(monkeypatch, tally, measure, name)
    found = suggest(crowd_asset(3, skinned=True).write(tmp_path / "crowd.glb"), count=8, everything=True)
    assert set(tally.values()) == {1}
    # They are in one place, where a fold has one tool.
    assert [each.mesh for each in found.tools] == ["limb"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("make", [partial(crowd_asset, skinned=True), troop_asset], ids=["one skeleton", "their own"])
def test_layers_are_posed_once_in_a_pose(
    make: Callable[[int], Asset], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    posed = []
    for count in (4, 8):
        tally = Counter[str]()
        with monkeypatch.context() as patched:
            counted(patched, tally, scene.ScenePrimitive, "posed")
            suggest(make(count).write(tmp_path / "many.glb"), count=1)
        posed.append(tally["posed"])
    assert 0 < posed[1] <= 2.1 * posed[0]


@pytest.mark.slow
@pytest.mark.long
def test_suggestions_take_as_many_calls_for_each_instance(tmp_path: Path) -> None:
    """Each with a skeleton of its own; `test_layers_are_posed_once_in_a_pose` has those of one skeleton, too."""
    paths = [troop_asset(count).write(tmp_path / f"{count}.glb") for count in (6, 12, 18)]
    few, some, many = calls_of(*(partial(suggest, path, count=1) for path in paths))
    assert many - some < 1.05 * (some - few), "differences, as most calls depend on no instance"


def elsewhere(asset: Asset) -> Asset:
    """The asset with each node a little elsewhere."""
    for number, node in enumerate(asset.gltf["nodes"]):
        x, y, z = node.get("translation", [0.0, 0.0, 0.0])
        node["translation"] = [x, y, z + 1e-3 * (number % 7 + 1)]
    return asset


@pytest.mark.slow
@pytest.mark.parametrize("make", [partial(crowd_asset, skinned=True), troop_asset], ids=["one skeleton", "their own"])
def test_a_comparison_takes_as_many_calls_for_each_instance(make: Callable[[int], Asset], tmp_path: Path) -> None:
    pairs = [
        (make(count).write(tmp_path / f"a{count}.glb"), elsewhere(make(count)).write(tmp_path / f"b{count}.glb"))
        for count in (8, 16, 32)
    ]
    few, some, many = calls_of(*(partial(diff, a, b) for a, b in pairs))
    assert many - some < 2.05 * (some - few)


def test_what_a_clip_does_not_move_is_compared_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    posed = []
    for count in (6, 12):
        a = troop_asset(count, own_clips=True).write(tmp_path / "a.glb")
        b = elsewhere(troop_asset(count, own_clips=True)).write(tmp_path / "b.glb")
        tally = Counter[str]()
        with monkeypatch.context() as patched:
            counted(patched, tally, SkinnedMesh, "posed")
            comparison = diff(a, b)
        posed.append(tally["posed"])
        # Each character is elsewhere in the stored pose, and in the clip that moves it by as much.
        assert {each.kind for each in comparison.differences} == {"value", "pose"}
    assert posed[1] <= 2.1 * posed[0]


@pytest.mark.slow
@pytest.mark.long
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


@pytest.mark.slow
def test_a_tool_compares_its_wrinkles_with_what_is_near(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    near, found = warnings.meets_box, []

    def counting(*arguments: Any, **options: Any) -> Any:
        found.append(near(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(warnings, "meets_box", counting)
    check(*write_tube(tmp_path, 12))
    assert found
    assert max(each.mean() for each in found) < 1 / 4


@pytest.mark.slow
def test_frames_that_are_shown_in_turn_are_looked_at_when_they_change(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    looked = []
    for count in (10, 30):
        tally = Counter[str]()
        with monkeypatch.context() as patched:
            counted(patched, tally, compare_motion, "joint_matrices", amount=lambda _rig, _clip, times: len(times))
            assert diff(*write_frames(tmp_path, count)).same
        looked.append(tally["joint_matrices"])
    assert looked[1] <= 3.3 * looked[0]


def test_of_many_meshes_those_that_may_touch_are_posed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    document = read_document(crowd_asset(30).write(tmp_path / "crowd.glb"))
    tally = Counter[str]()
    counted(monkeypatch, tally, contacts._Shown, "posed")
    neighbours = contacts.Neighbours(document)
    every = scene.read_scene(document)
    for number, shown in enumerate(every):
        positions = shown.positions_at(None, 0.0)
        assert not list(neighbours.near(shown.rig.node, positions.min(axis=0), positions.max(axis=0)))
        other = every[number - 1].rig.node
        found = [places for _, places in neighbours.near(other, positions.min(axis=0), positions.max(axis=0))]
        assert len(found) == 1
        np.testing.assert_allclose(found[0], positions, atol=1e-12)
        assert tally["posed"] == number + 1


@pytest.mark.slow
def test_pairs_of_tools_are_found_without_a_look_at_each() -> None:
    rng = np.random.default_rng(7)
    places = [rng.normal(size=(300, 3)) * [1.0, 20.0, 1.0], np.cumsum(np.full((2000, 3), [0.0, 0.3, 0.0]), axis=0)]
    peaks = []
    for middles in places:
        halves = 0.3 * rng.normal(size=(len(middles), 3))
        patches: list[Any] = [
            SimpleNamespace(
                span=2.0 * float(np.linalg.norm(half)),
                origin=SimpleNamespace(position=middle - half),
                target=SimpleNamespace(position=middle + half),
                path=SimpleNamespace(middle=middle),
            )
            for middle, half in zip([*middles, middles[5]], [*halves, -0.99 * halves[5]], strict=True)
        ]
        tracemalloc.start()
        found = warnings._twins(patches, np.ones((len(patches), 1), bool))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert (5, len(middles)) in found
    # A number for each pair would be 32 MB.
    assert peaks[1] < 4e6


def crowded(count: int, apart: float = 1e-3) -> list[dict[str, Any]]:
    """Tools on one spot of the limb, whose ends are a little apart."""
    places = apart * np.random.default_rng(3).uniform(-1.0, 1.0, size=(count, 2))
    return [
        tool(name=f"t{number}", origin=[-0.4 + x, RADIUS, z], target=[0.4 + x, RADIUS, z], variation=0)
        for number, (x, z) in enumerate(places.tolist())
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "pairs"), [(10, 45), (22, 191)])
def test_pairs_of_tools_on_one_spot_are_listed_up_to_a_limit(tmp_path: Path, count: int, pairs: int) -> None:
    asset = limb_asset(rings=8, sides=6).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", *crowded(count))
    found = check(asset, tools)
    lines = [line for line in found.data["warnings"] if "lie nearly on top" in line]
    assert len(lines) == pairs
    assert (lines[-1] == "limb: more than 190 pairs of tools lie nearly on top of each other") == (count == 22)
    assert {len(each["overlaps"]) for each in found.data["tools"]} == {min(count - 1, 20)}
    assert {each.get("more_overlaps", False) for each in found.data["tools"]} == {count == 22}


@pytest.mark.slow
def test_the_surface_below_tools_on_one_spot_is_posed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asset, posed = limb_asset(rings=8, sides=6).write(tmp_path / "limb.glb"), []
    for count in (4, 16):
        tools = write_tools(tmp_path / "tools.yaml", *crowded(count))
        tally = Counter[str]()
        with monkeypatch.context() as patched:
            counted(patched, tally, refine, "transform", amount=lambda blended, _positions: blended.shape[1])
            plan_meshes(read_job(asset, tools, BakeOptions()))
        posed.append(tally["transform"])
    assert posed[1] < 1.2 * posed[0]


@pytest.mark.slow
def test_names_of_driven_targets_are_listed_as_often_for_any_number_of_tools(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset, listed = limb_asset(rings=8, sides=6).write(tmp_path / "limb.glb"), []
    for count in (3, 9):
        body = tmp_path / f"body_{count}.glb"
        bake(asset, write_tools(tmp_path / "tools.yaml", *crowded(count)), body, tracks="none")
        calls: list[int] = []
        original: Any = BakedBody.driven

        def driven(self: BakedBody, calls: list[int] = calls, original: Any = original) -> Any:
            calls.append(1)
            return original.fget(self)

        with monkeypatch.context() as patched:
            patched.setattr(BakedBody, "driven", property(driven))
            track(body, [asset], tmp_path / f"tracked_{count}")
        listed.append(len(calls))
    assert listed[0] == listed[1]


def test_overlaps_of_many_tools_are_the_first_ones() -> None:
    rng = np.random.default_rng(11)
    moved = [np.sort(rng.choice(400, size=rng.integers(3, 60), replace=False)) for _ in range(80)]
    names = [str(number) for number in range(80)]
    for one, found in enumerate(check_module._overlaps(moved, names)):
        shared = {names[k]: len(np.intersect1d(moved[one], each)) for k, each in enumerate(moved) if k != one}
        wanted = [{"tool": name, "vertices": count} for name, count in shared.items() if count]
        assert found["overlaps"] == wanted[:20]
        assert found.get("more_overlaps", False) == (len(wanted) > 20)


def test_joints_that_act_elsewhere_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = prepare(limb_asset(joints=60), tool(origin=[-0.1, RADIUS, 0.0], target=[0.1, RADIUS, 0.0], width=0.1))
    tally = Counter[str]()
    counted(monkeypatch, tally, refine, "joint_distances", amount=lambda _rig, _patches, chosen: len(chosen))
    prepared.refined()
    assert 0 < tally["joint_distances"] < 60
