"""The written file: morph targets and weight tracks are added, and all other data stays as it was."""

import atexit
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

import wrinklecli
from kit.asset import stored
from kit.bakes import COARSE, bake_config, bake_once, place, report_of
from kit.clients import assert_valid, validate
from kit.command import Wrinkle
from kit.limb import limb_asset, tool, write_tools
from kit.places import FOLDER, ROOT
from kit.player import DTYPES, WIDTHS, Gltf, Json, differences, wrinkle_columns
from kit.samples import (
    BACK,
    BROW,
    PALM,
    Editor,
    aside,
    bystanders,
    edited,
    sample,
    shared_mesh,
    sharp_keys,
    spline_keys,
    two_meshes,
    unnamed_targets,
    with_tangents,
    without_normals,
)
from wrinklecli.errors import WrinkleError

atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)


# Targets


@pytest.mark.quick(0, 7)
@pytest.mark.parametrize("mode", ["sparse", "dense", "based"])
@pytest.mark.quick(1)
@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_names_counts_and_weights_fit(name: str, config: str, mode: str) -> None:
    before, after = Gltf(sample(name)), bake_config(name, config, accessors=mode)
    mesh, old = after.mesh(name), before.mesh(name)
    names = mesh["extras"]["targetNames"]
    old_names = old.get("extras", {}).get("targetNames", [])
    assert names[: len(old_names)] == old_names
    assert all(re.fullmatch(r"wrinkle_[A-Za-z0-9_]+_[1-9][0-9]*", each) for each in names[len(old_names) :])
    assert len(set(names)) == len(names)
    assert {len(primitive["targets"]) for primitive in mesh["primitives"]} == {len(names)}
    for primitive in mesh["primitives"]:
        assert all(set(target) == {"POSITION", "NORMAL"} for target in primitive["targets"])
    own = old.get("weights", [0.0] * len(old_names))
    assert mesh["weights"] == own + [0.0] * (len(names) - len(old_names))
    for clip in after.json["animations"]:
        times, values = after.keys(clip["name"], name)
        assert (np.diff(times) > 0).all()
        assert values.shape == (len(times), len(names))
        assert np.abs(values[:, len(old_names) :]).max() <= 1.0


@pytest.mark.slow
def test_every_primitive_gets_every_target_and_the_untouched_share_zeros() -> None:
    def far_part(editor: Editor) -> None:
        """Triangles beyond the knuckles are a primitive of their own."""
        (primitive,) = editor.json["meshes"][0]["primitives"]
        accessors, views = editor.json["accessors"], editor.json["bufferViews"]

        def read(index: int, dtype: str, width: int) -> NDArray[Any]:
            start = views[accessors[index]["bufferView"]]["byteOffset"]
            return np.frombuffer(bytes(editor.data), dtype, accessors[index]["count"] * width, start)

        faces = read(primitive["indices"], "<u2", 1).reshape(-1, 3)
        positions = read(primitive["attributes"]["POSITION"], "<f4", 3).reshape(-1, 3)
        far = (positions[faces, 0] > 0.1).all(axis=1)
        second = {**primitive, "attributes": {}}
        used, local = np.unique(faces[far], return_inverse=True)
        for name, index in primitive["attributes"].items():
            width, kind = WIDTHS[accessors[index]["type"]], DTYPES[accessors[index]["componentType"]]
            values = read(index, kind, width).reshape(-1, width)[used]
            bounds = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            second["attributes"][name] = editor.accessor(values, **(bounds if name == "POSITION" else {}))
        primitive["indices"] = editor.accessor(faces[~far].reshape(-1, 1).copy())
        second["indices"] = editor.accessor(local.reshape(-1, 1).astype(np.uint16))
        editor.json["meshes"][0]["primitives"].append(second)

    after = bake_once(edited("wrist", far_part), {**PALM, "strategy": "both_ends", "bumps": 5})
    near, far = after.mesh("wrist")["primitives"]
    assert len(near["targets"]) == len(far["targets"]) == 3
    zeros = {target["POSITION"] for target in far["targets"]}
    assert len(zeros) == 1
    accessor = after.json["accessors"][zeros.pop()]
    assert accessor["sparse"]["count"] == 1, "many readers refuse an accessor without data"
    assert accessor["min"] == accessor["max"] == [0, 0, 0]
    assert all(after.array(target["POSITION"]).any() for target in near["targets"])
    assert_valid(after.path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_min_and_max_are_those_of_the_stored_numbers(name: str, config: str) -> None:
    for mode in ("sparse", "dense", "based"):
        after = bake_config(name, config, accessors=mode)
        bounded = 0
        for index, accessor in enumerate(after.json["accessors"]):
            stored = after.stored(index)
            for key, found in (("min", stored.min(axis=0)), ("max", stored.max(axis=0))):
                if key in accessor:
                    bounded += 1
                    assert np.array_equal(np.array(accessor[key], stored.dtype), found), (index, key)
        for primitive in after.mesh(name)["primitives"]:
            needed = [primitive["attributes"]["POSITION"], *(each["POSITION"] for each in primitive["targets"])]
            assert all({"min", "max"} <= set(after.json["accessors"][index]) for index in needed)
        for clip in after.json["animations"]:
            for sampler in clip["samplers"]:
                assert {"min", "max"} <= set(after.json["accessors"][sampler["input"]])
        assert bounded


@pytest.mark.quick(1)
@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_sparse_dense_and_based_hold_the_same_numbers(name: str, config: str) -> None:
    sparse, dense, based = (bake_config(name, config, accessors=mode) for mode in ("sparse", "dense", "based"))
    assert sparse.path.stat().st_size < based.path.stat().st_size < dense.path.stat().st_size
    assert not any("sparse" in accessor for accessor in dense.json["accessors"])
    assert all("bufferView" in accessor for accessor in dense.json["accessors"])
    for kind in ("POSITION", "NORMAL"):
        assert np.array_equal(sparse.deltas(name, kind), dense.deltas(name, kind))
        assert np.array_equal(sparse.deltas(name, kind), based.deltas(name, kind))
    for attribute in sparse.mesh(name)["primitives"][0]["attributes"]:
        assert np.array_equal(sparse.attribute(name, attribute), dense.attribute(name, attribute))
    for clip in sparse.json["animations"]:
        for one, other in zip(sparse.keys(clip["name"], name), dense.keys(clip["name"], name), strict=True):
            assert np.array_equal(one, other)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head")])
def test_based_targets_stand_on_one_view_of_zeros(name: str, config: str) -> None:
    """VTK and Godot 3 want a view below sparse vectors, the validator its stride, and VTK the offsets of the rest."""
    after = bake_config(name, config, accessors="based")
    sparse = [accessor for accessor in after.json["accessors"] if "sparse" in accessor]
    assert sparse
    (zeros,) = {accessor["bufferView"] for accessor in sparse}
    view = after.json["bufferViews"][zeros]
    longest = max(accessor["count"] for accessor in after.json["accessors"] if accessor.get("bufferView") == zeros)
    assert (view["byteStride"], view["target"], view["byteLength"]) == (12, 34962, 12 * longest)
    assert not any(after.view_bytes(zeros))
    for accessor in sparse:
        assert accessor["sparse"]["indices"]["byteOffset"] == accessor["sparse"]["values"]["byteOffset"] == 0
    assert_valid(after.path)


def test_sparse_targets_hold_only_what_moves() -> None:
    after = bake_config("wrist", "wrist")
    for target in after.mesh("wrist")["primitives"][0]["targets"]:
        accessor = after.json["accessors"][target["POSITION"]]
        assert "bufferView" not in accessor
        assert 0 < accessor["sparse"]["count"] < 0.7 * accessor["count"]
        values = after._elements(accessor["sparse"]["values"], "<f4", 3, accessor["sparse"]["count"])
        assert values.any(axis=1).all()


@pytest.mark.slow
def test_a_base_without_normals_stays_so() -> None:
    after = bake_once(edited("wrist", without_normals), PALM, fine=True)
    for primitive in after.mesh("wrist")["primitives"]:
        assert "NORMAL" not in primitive["attributes"]
        assert all(set(target) == {"POSITION"} for target in primitive["targets"])
    # Its faces stay flat, as in the midpoint scheme.
    with_normals = bake_once("wrist", PALM, top={"refinement": {"scheme": "midpoint"}})
    assert np.array_equal(after.deltas("wrist"), with_normals.deltas("wrist"))
    assert_valid(after.path)


# Keyed by hand, a tool has no motion of its own, so normals are fitted in the rest pose: bind space.
AT_REST: Json = {"rest_length": {"keys": {"flex": [[0.0, "100%"]]}}}

TANGENTIAL: Json = {**PALM, "strategy": "both_ends", "bumps": 5}


@pytest.mark.slow
@pytest.mark.long
def test_tangent_targets_keep_tangents_in_the_surface() -> None:
    """Across the bent normals, and where the triangles' own edges carry them, at several weights of all tools.

    On triangles so small that they hardly cut the corners of the wrinkles.
    """
    after = bake_once(
        edited("wrist", with_tangents),
        {**TANGENTIAL, **AT_REST},
        {**BACK, **AT_REST},
        top={"refinement": {"edges_per_interval": 6}},
        morph_tangents=True,
    )
    tangents, normals = after.attribute("wrist", "TANGENT"), after.attribute("wrist", "NORMAL")
    base, faces = after.attribute("wrist", "POSITION"), after.triangles("wrist")
    deltas = {name: after.deltas("wrist", name) for name in ("POSITION", "NORMAL", "TANGENT")}
    for weights in (np.full(len(deltas["NORMAL"]), 1.0), np.linspace(1.0, 0.0, len(deltas["NORMAL"]))):
        bent = {name: np.tensordot(weights, deltas[name], axes=1) for name in deltas}
        along, outward = tangents[:, :3] + bent["TANGENT"], normals + bent["NORMAL"]
        # New tangents are mixed, and as far from a right angle as before.
        before = np.sum(tangents[:, :3] * normals, axis=1)
        assert np.abs(np.sum(along * outward, axis=1) - before).max() < 1e-5
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        turned = np.linalg.norm(bent["TANGENT"], axis=1) > 0.05
        true = np.zeros_like(along)
        edges, carried = (at[faces[:, 1:]] - at[faces[:, :1]] for at in (base, base + bent["POSITION"]))
        np.add.at(true, faces, tangents[faces, :3] @ np.linalg.pinv(edges) @ carried)
        true /= np.maximum(np.linalg.norm(true, axis=1, keepdims=True), 1e-12)
        angles, unbent = (
            np.degrees(np.arccos(np.clip(np.sum(true * each, axis=1)[turned], -1, 1)))
            for each in (along, tangents[:, :3])
        )
        assert np.median(angles) < 1 < 8 < np.median(unbent)
        assert np.percentile(angles, 99) < 7
    assert_valid(after.path)


@pytest.mark.slow
def test_tangent_targets_come_on_request_and_where_the_base_has_them() -> None:
    plain = bake_once(edited("wrist", with_tangents), TANGENTIAL)
    asked = bake_once(edited("wrist", with_tangents), TANGENTIAL, morph_tangents=True)
    bare = bake_once("wrist", TANGENTIAL, morph_tangents=True)
    for file, kinds in ((plain, {"POSITION", "NORMAL"}), (asked, {"POSITION", "NORMAL", "TANGENT"})):
        targets = [target for primitive in file.mesh("wrist")["primitives"] for target in primitive["targets"]]
        assert all(set(target) == kinds for target in targets)
    assert bare.path.read_bytes() == bake_once("wrist", TANGENTIAL).path.read_bytes()
    for name in ("POSITION", "NORMAL"):
        assert np.array_equal(plain.deltas("wrist", name), asked.deltas("wrist", name))
    for target in asked.mesh("wrist")["primitives"][0]["targets"]:
        accessor = asked.json["accessors"][target["TANGENT"]]
        assert accessor["type"] == "VEC3"
        assert 0 < accessor["sparse"]["count"] < 0.7 * accessor["count"]


def half_named_targets(editor: Editor) -> None:
    del editor.json["meshes"][0]["extras"]["targetNames"][1:]


@pytest.mark.slow
@pytest.mark.parametrize("change", [unnamed_targets, half_named_targets])
def test_old_targets_without_names_are_numbered(change: Callable[[Editor], None]) -> None:
    """Names are all or nothing: readers take them by position."""
    after = bake_once(edited("head", change), BROW)
    names = after.mesh("head")["extras"]["targetNames"]
    assert names[1] == "target_1"
    assert names[0] == (
        "target_0" if change is unnamed_targets else Gltf(sample("head")).mesh("head")["extras"]["targetNames"][0]
    )
    assert all(each.startswith("wrinkle_brow_") for each in names[2:])
    assert len(names) == len(after.deltas("head"))
    assert_valid(after.path)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("name", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_no_target_moves_nothing(name: str, config: str) -> None:
    after = bake_config(name, config)
    for column in wrinkle_columns(after, name):
        assert after.deltas(name)[column].any()


@pytest.mark.slow
def test_normals_follow_the_wrinkles() -> None:
    """Against area-weighted normals of the wrinkled triangles, in bind space, at several heights.

    On a surface as round as its normals say it is, and on triangles that hardly cut the corners of the wrinkles.
    """
    refinement = {"scheme": "butterfly_full", "edges_per_interval": 4}
    after = bake_once("wrist", {**PALM, **AT_REST}, top={"refinement": refinement})
    base, faces = after.attribute("wrist", "POSITION"), after.triangles("wrist")
    _, weld = np.unique(base, axis=0, return_inverse=True)
    weld = weld.reshape(-1)
    moved = np.linalg.norm(after.deltas("wrist")[0], axis=1) > 1e-4
    stored = after.attribute("wrist", "NORMAL")
    for weight in (0.4, 0.7, 1.0):
        positions = base + weight * after.deltas("wrist")[0]
        a, b, c = (positions[faces[:, k]] for k in range(3))
        sums = np.zeros((weld.max() + 1, 3))
        for k in range(3):
            np.add.at(sums, weld[faces[:, k]], np.cross(b - a, c - a))
        true = (sums / np.linalg.norm(sums, axis=1, keepdims=True))[weld][moved]
        bent = (stored + weight * after.deltas("wrist", "NORMAL")[0])[moved]
        bent = bent / np.linalg.norm(bent, axis=1, keepdims=True)
        angles, unbent = (
            np.degrees(np.arccos(np.clip(np.sum(true * normals, axis=1), -1, 1))) for normals in (bent, stored[moved])
        )
        # The stored normals themselves are some degrees off the area-weighted ones.
        assert np.median(angles) < 1 < 4 < np.median(unbent)
        assert np.percentile(angles, 99) < min(8, np.percentile(unbent, 99) / 2)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "clip", "risen"),
    # The clip extend closes the wrist's crease further than where its wrinkles are full at first.
    [
        ("wrist", "extend", 1.0),
        ("head", "raise_brows", 0.5),
        ("trousers", "squat", 0.5),
        ("trousers", "squat", 1.0),
        ("trousers", "walk", 1.0),
    ],
)
def test_wrinkles_look_as_steep_as_they_are(name: str, clip: str, risen: float) -> None:
    """Degrees by which wrinkles turn the normals that an engine shows, and those of the posed triangles.

    When they have risen half of the way, and when they are tallest; on triangles that hardly cut their corners.
    """
    settings = yaml.safe_load((ROOT / "configs" / f"{name}.yaml").read_text())
    file = bake_once(name, top=settings | {"refinement": {"edges_per_interval": 4}})
    wrinkles = wrinkle_columns(file, name)
    times, weights = file.keys(clip, name)
    rising = weights[:, wrinkles].sum(axis=1)
    at = times[[np.argmax(rising >= risen * rising.max())]]
    faces = file.triangles(name)
    _, weld = np.unique(file.attribute(name, "POSITION"), axis=0, return_inverse=True)

    def of_triangles(positions: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b, c = (positions[faces[:, k]] for k in range(3))
        sums = np.zeros((weld.max() + 1, 3))
        for k in range(3):
            np.add.at(sums, weld.reshape(-1)[faces[:, k]], np.cross(b - a, c - a))
        return (sums / np.linalg.norm(sums, axis=1, keepdims=True))[weld.reshape(-1)]

    with_and_without: list[list[int]] = [[], wrinkles]
    positions = [file.pose(name, clip, at, without=left)[0] for left in with_and_without]
    heights = np.linalg.norm(positions[0] - positions[1], axis=1)
    moved = heights > 0.02 * heights.max()
    shown = [file.normals(name, clip, at, without=left)[0][moved] for left in with_and_without]
    true = [of_triangles(each)[moved] for each in positions]
    seen, wanted = (np.degrees(np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1))) for a, b in (shown, true))
    assert abs(np.median(seen) - np.median(wanted)) <= 1.5
    assert abs(np.percentile(seen, 95) - np.percentile(wanted, 95)) <= 2


# Tracks


@pytest.mark.parametrize("change", [None, sharp_keys, spline_keys])
def test_old_morph_targets_keep_their_values_at_all_times(change: Callable[[Editor], None] | None) -> None:
    asset = sample("head") if change is None else edited("head", change)
    before, after = Gltf(asset), bake_once(asset, BROW)
    times = np.linspace(-0.1, 2.1, 1501)
    if change is sharp_keys:
        # A millisecond before a jump there is a key: between these two nothing is promised.
        jumps = np.array([0.5, 1.25, 2.0])
        early = ((times[:, None] > jumps - 0.00101) & (times[:, None] < jumps)).any(axis=1)
        times = np.union1d(times[~early], [0.5, 1.25, *(jumps - 0.00101)])
    was, now = (file.weights("head", "raise_brows", times) for file in (before, after))
    assert np.abs(now[:, :2] - was).max() < 1e-6
    assert now[:, 2:].max() > 0.5
    sampler = after.sampler("raise_brows", after.node("head"), "weights")
    assert sampler is not None
    assert sampler.get("interpolation", "LINEAR") == ("CUBICSPLINE" if change is spline_keys else "LINEAR")
    assert set(before.keys("raise_brows", "head")[0]) <= set(after.keys("raise_brows", "head")[0])
    assert_valid(after.path)


@pytest.mark.parametrize(("asset", "change"), [("wrist", None), ("head", None), ("head", sharp_keys)])
def test_no_two_keys_are_closer_than_a_millisecond(asset: str, change: Callable[[Editor], None] | None) -> None:
    tool = PALM if asset == "wrist" else BROW
    after = bake_once(asset if change is None else edited(asset, change), tool)
    names = [each["name"] for each in after.json["animations"]]
    times = [after.keys(name, asset)[0] for name in names if after.sampler(name, after.node(asset), "weights")]
    assert len(times) > 0
    assert max(len(each) for each in times) > 20
    assert all(np.diff(each).min() >= 0.001 for each in times)


def test_old_targets_keep_their_shapes() -> None:
    before, after = Gltf(sample("head")), bake_once("head", BROW)
    old = len(before.attribute("head", "POSITION"))
    for kind in ("POSITION", "NORMAL"):
        was, now = before.deltas("head", kind), after.deltas("head", kind)
        assert np.array_equal(now[: len(was), :old], was)


# What must not change


def test_everything_else_is_as_it_was() -> None:
    asset = edited("wrist", bystanders)
    before, after = Gltf(asset), bake_once(asset, PALM)
    allowed = [
        r"/buffers/0/byteLength",
        r"/accessors/\d+",
        r"/bufferViews/\d+(/byteOffset)?",
        r"/meshes/0/(extras|weights)",
        r"/meshes/0/primitives/0/targets",
        r"/nodes/0/extras/wrinkle",
        r"/animations/\d+/(samplers|channels)/\d+",
    ]
    slots = set()
    for path in differences(before.json, after.json):
        if match := re.match(r"/(accessors|bufferViews)/(\d+)/", path + "/"):
            slots.add((match[1], int(match[2])))
            continue
        assert any(re.fullmatch(pattern, path) for pattern in allowed), path
    refined = {*before.mesh("wrist")["primitives"][0]["attributes"].values(), 5}
    for index, accessor in enumerate(before.json["accessors"]):
        if index in refined:
            continue
        assert after.json["accessors"][index] == accessor
        assert after.stored(index).tobytes() == before.stored(index).tobytes()
    for kind, index in slots:
        if kind == "accessors":
            assert index in refined or index >= len(before.json["accessors"])
    image = before.json["images"][0]["bufferView"]
    assert after.view_bytes(image) == before.view_bytes(image)
    assert after.json["meshes"][1] == before.json["meshes"][1]
    assert after.json["nodes"][0]["extras"]["rigger"] == "me"


@pytest.mark.slow
def test_channels_of_joints_keep_their_place_and_bytes() -> None:
    before, after = Gltf(sample("trousers")), bake_config("trousers", "trousers")
    for old, new in zip(before.json["animations"], after.json["animations"], strict=True):
        assert new["channels"][: len(old["channels"])] == old["channels"]
        assert len(new["channels"]) == len(old["channels"]) + 1
        for was, now in zip(old["samplers"], new["samplers"], strict=False):
            for key in ("input", "output"):
                assert before.stored(was[key]).tobytes() == after.stored(now[key]).tobytes()


@pytest.mark.slow
def test_no_dead_data_is_left() -> None:
    """Every accessor is used, every view is used, and the views cover the buffer but for padding."""
    after = bake_config("head", "head")
    used = {
        channel for mesh in after.json["meshes"] for p in mesh["primitives"] for channel in p["attributes"].values()
    }
    for primitive in after.mesh("head")["primitives"]:
        used |= {primitive["indices"], *(index for target in primitive["targets"] for index in target.values())}
    used |= {skin["inverseBindMatrices"] for skin in after.json["skins"]}
    used |= {s[key] for clip in after.json["animations"] for s in clip["samplers"] for key in ("input", "output")}
    assert used == set(range(len(after.json["accessors"])))
    covered = sum(view["byteLength"] for view in after.json["bufferViews"])
    assert after.json["buffers"][0]["byteLength"] - covered < 4 * (len(after.json["bufferViews"]) + 4)


def test_a_mesh_of_two_nodes_is_cloned() -> None:
    asset = edited("wrist", shared_mesh)
    before, after = Gltf(asset), bake_once(asset, aside(PALM))
    assert after.json["nodes"][0]["mesh"] == 0
    assert after.json["nodes"][after.node("twin")]["mesh"] == 1
    assert after.json["meshes"][0] == before.json["meshes"][0]
    for name in before.mesh("wrist")["primitives"][0]["attributes"]:
        assert np.array_equal(before.attribute("wrist", name), after.attribute("wrist", name))
    assert np.array_equal(before.triangles("wrist"), after.triangles("wrist"))
    assert wrinkle_columns(after, "twin") == [0]
    assert len(after.attribute("twin", "POSITION")) > len(before.attribute("twin", "POSITION"))
    assert after.sampler("flex", after.node("twin"), "weights") is not None
    assert after.sampler("flex", 0, "weights") is None
    assert "extras" not in after.json["nodes"][0]
    assert_valid(after.path)


@pytest.mark.slow
@pytest.mark.parametrize("change", [shared_mesh, two_meshes])
def test_tools_on_two_nodes(change: Callable[[Editor], None]) -> None:
    after = bake_once(edited("wrist", change), {**PALM, "node": "wrist"}, aside(BACK))
    alone = {node: bake_once("wrist", tool) for node, tool in (("wrist", PALM), ("twin", BACK))}
    for name in ("POSITION", "NORMAL", "TEXCOORD_0"):
        assert np.array_equal(after.attribute("wrist", name), alone["wrist"].attribute("wrist", name))
    assert np.array_equal(after.deltas("wrist"), alone["wrist"].deltas("wrist"))
    times = np.linspace(0, 2, 81)
    for node, clip in (("wrist", "flex"), ("twin", "extend")):
        wanted = alone[node].pose("wrist", clip, times) + np.array([0, 0, node == "twin"])
        moving = alone[node].weights("wrist", clip, times).max()
        assert moving > 0.5
        # One unit aside anchors round differently, and so may the choice of an edge to split: compare extents.
        found = after.pose(node, clip, times)
        for measure in (np.min, np.max):
            assert np.abs(measure(found, axis=1) - measure(wanted, axis=1)).max() < 1e-6
        other = next(each for each in alone if each != node)
        assert after.weights(other, clip, times).max() == 0
    assert_valid(after.path)


@pytest.mark.slow
def test_weights_in_the_stored_pose_are_zero() -> None:
    for name in ("wrist", "trousers"):
        after = bake_config(name, name)
        assert not after.weights(name, None, [0.0])[:, wrinkle_columns(after, name)].any()


@pytest.mark.quick(1)
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_both_containers_hold_the_same(ending: str, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    wrinklecli.bake(sample("wrist"), tools, tmp_path / f"out.{ending}", **COARSE)
    made, reference = Gltf(tmp_path / f"out.{ending}"), bake_once("wrist", PALM)
    assert {k: v for k, v in made.json.items() if k not in ("buffers", "bufferViews")} == {
        k: v for k, v in reference.json.items() if k not in ("buffers", "bufferViews")
    }
    for index in range(len(made.json["accessors"])):
        assert np.array_equal(made.stored(index), reference.stored(index))
    assert_valid(tmp_path / f"out.{ending}")


def test_names_on_primitives_are_read_and_joined() -> None:
    asset = limb_asset(rings=12, sides=8, morphs=2, morph_clip="LINEAR", primitives=2)
    mesh, names = asset.gltf["meshes"][0], ["bulge", "squash"]
    mesh.pop("extras", None)
    for primitive in mesh["primitives"]:
        primitive["extras"] = {"targetNames": names, "kept": True}
    after = bake_once(place(asset), tool(rest_length={"morph": "squash", "full": "95%"}))
    joined = after.mesh("limb")["extras"]["targetNames"]
    assert joined[:2] == names
    assert joined[2:] == [f"wrinkle_crease_{number + 1}" for number in range(len(joined) - 2)]
    assert len(joined) > 2
    for primitive in after.mesh("limb")["primitives"]:
        assert primitive["extras"] == {"targetNames": joined, "kept": True}
        assert len(primitive["targets"]) == len(joined)


@pytest.mark.slow
def test_keys_before_0_s_make_no_more_of_them(tmp_path: Path) -> None:
    asset = limb_asset(rings=12, sides=8, morphs=1, morph_clip="LINEAR")
    for sampler in asset.gltf["animations"][0]["samplers"]:
        sampler["input"] = asset.accessor(stored(asset, sampler["input"])[:, 0] - 0.5, bounds=True)
    source = asset.write(tmp_path / "limb.glb")
    after = bake_once(place(asset), tool())
    times, weights = after.keys("fold", "limb")
    assert times[0] == 0.0
    assert weights[:, 1:].max() > 0.2
    before, made = validate([source, after.path])
    assert made.errors < before.errors
    assert [line for line in report_of(after).data["warnings"] if "fold has keys before 0 s" in line]
    body = bake_once(place(limb_asset(rings=12, sides=8, morphs=1)), tool(), tracks="none")
    (tracked,) = wrinklecli.track(body.path, [source], tmp_path / "made")
    assert [line for line in tracked.warnings if "fold has keys before 0 s" in line]


def test_a_node_with_a_matrix_is_said_not_to_move() -> None:
    asset = limb_asset(rings=12, sides=8)
    joint, matrix = asset.gltf["nodes"][2], np.eye(4)
    matrix[3, :3] = joint.pop("translation")
    joint["matrix"] = matrix.ravel().tolist()
    warnings = report_of(bake_once(place(asset), tool())).data["warnings"]
    assert any("clips cannot move 'joint_1': a node with a matrix is not animated" in line for line in warnings)


@pytest.mark.slow
def test_a_vrm_is_written_as_a_glb(tmp_path: Path, wrinkle: Wrinkle) -> None:
    limb_asset(rings=12, sides=8).write(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml")
    for name in ("a.glb", "b.vrm"):
        ran = wrinkle("bake", tmp_path / "limb.glb", tmp_path / "tools.yaml", "-o", tmp_path / name)
        assert ran.code == 0, ran.lines
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.vrm").read_bytes()


@pytest.mark.quick(1)
@pytest.mark.parametrize(("node", "path"), [("lamp", "translation"), ("limb", "weights"), ("joint_1", "rotation")])
def test_keys_that_are_not_finite_refuse_only_what_they_move(tmp_path: Path, node: str, path: str) -> None:
    asset = limb_asset(rings=12, sides=8, morphs=1)
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "lamp"}))
    number = [each.get("name") for each in asset.gltf["nodes"]].index(node)
    animation = asset.gltf["animations"][0]
    animation["channels"] = [each for each in animation["channels"] if each["target"] != {"node": number, "path": path}]
    width = {"weights": 1, "rotation": 4}.get(path, 3)
    asset.channel(animation, number, path, [0.0, 1.0], np.full((2, width), np.nan))
    source, tools = asset.write(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml")
    if node == "lamp":
        wrinklecli.bake(source, tools, tmp_path / "out.glb")
        before, after = validate([source, tmp_path / "out.glb"])
        assert before.errors == after.errors
        return
    for tracks in ("all", "none"):
        if (path, tracks) != ("rotation", "none"):
            with pytest.raises(WrinkleError, match=r"limb.glb#/animations/0/channels/\d: a key value is not a finite"):
                wrinklecli.bake(source, tools, tmp_path / "out.glb", tracks=tracks)
