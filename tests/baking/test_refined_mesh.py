"""Refined primitives: old vertices stay, new ones lie between them, and shared vertices stay shared."""

from itertools import chain
from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.asset import attribute
from kit.bakes import bake_once, place
from kit.clients import assert_valid, compare_with_three
from kit.limb import LENGTH, blendshape_limb, limb_asset, tool, write_tools
from kit.player import Gltf, Json
from kit.samples import PALM, Editor, edited, sample, three_materials, two_parts
from wrinklecli.gltf.references import accessor_references


def vertex_accessors(primitive: Json) -> list[int]:
    targets = (list(target.values()) for target in primitive.get("targets", []))
    return [*primitive["attributes"].values(), *chain.from_iterable(targets)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "tool", [PALM, {**PALM, "width": 0.004, "origin": [0.03, -0.0205, 0.0], "target": [0.06, -0.02, 0.0]}]
)
@pytest.mark.parametrize("accessors", ["sparse", "dense"])
def test_primitives_go_on_sharing_vertices(tool: Json, accessors: str) -> None:
    """Refined once for all, those that no tool reaches too; the motion is that of a mesh of one primitive."""
    asset = edited("wrist", three_materials)
    whole, parted = (bake_once(each, tool, fine=True, accessors=accessors) for each in ("wrist", asset))
    primitives = parted.mesh("wrist")["primitives"]
    assert [each["material"] for each in primitives] == [0, 1, 2]
    assert len(primitives[0]["targets"]) > 0
    for other in primitives[1:]:
        assert vertex_accessors(other) == vertex_accessors(primitives[0])
    # Vertices on the edges between two primitives are there once for each, indices that nothing splits stay.
    added = len(parted.json["accessors"]) - len(Gltf(asset).json["accessors"])
    assert added == len(whole.json["accessors"]) - len(Gltf(sample("wrist")).json["accessors"])
    grown = parted.path.stat().st_size - asset.stat().st_size
    assert grown < 1.2 * (whole.path.stat().st_size - sample("wrist").stat().st_size)
    lost = [
        set(range(len(each["accessors"]))) - {index for index, _ in accessor_references(each)}
        for each in (Gltf(asset).json, parted.json)
    ]
    assert lost[0] == lost[1], "an accessor that nothing shows any more"
    assert_valid(parted.path)
    for clip in ("flex", "extend"):
        times = [0.0, 0.4, 0.77, 1.3]
        shown = parted.pose("wrist", clip, times)
        compare_with_three(parted.path, "wrist", clip, times, shown)
        corners = [file.pose("wrist", clip, times)[:, file.triangles("wrist")] for file in (whole, parted)]
        middles = [np.sort(each.mean(axis=2), axis=1) for each in corners]
        assert np.abs(middles[0] - middles[1]).max() < 1e-6


def test_attributes_that_primitives_share_stay_shared() -> None:
    one, other = bake_once(edited("wrist", two_parts), PALM).mesh("wrist")["primitives"]
    for name, index in other["attributes"].items():
        assert one["attributes"][name] == index
    # TANGENT, which the second lacks, does not keep POSITION and NORMAL targets apart.
    assert [each["POSITION"] for each in one["targets"]] == [each["POSITION"] for each in other["targets"]]


def test_shared_points_are_left_alone() -> None:
    """Points drawn over the same vertices: without indices, new ones would be drawn too."""

    def points(editor: Editor) -> None:
        (primitive,) = editor.json["meshes"][0]["primitives"]
        kept = {key: value for key, value in primitive.items() if key != "indices"}
        editor.json["meshes"][0]["primitives"].append({**kept, "mode": 0})

    asset = edited("wrist", points)
    before, after = (file.mesh("wrist")["primitives"] for file in (Gltf(asset), bake_once(asset, PALM)))
    count = Gltf(asset).json["accessors"][before[1]["attributes"]["POSITION"]]["count"]
    assert bake_once(asset, PALM).json["accessors"][after[1]["attributes"]["POSITION"]]["count"] == count
    assert after[1]["mode"] == 0
    assert_valid(bake_once(asset, PALM).path)


def test_old_vertices_keep_index_and_bits_and_new_ones_follow() -> None:
    before, after = Gltf(edited("wrist", two_parts)), bake_once(edited("wrist", two_parts), PALM)
    pairs = zip(before.mesh("wrist")["primitives"], after.mesh("wrist")["primitives"], strict=True)
    for old, new in pairs:
        assert list(old["attributes"]) == list(new["attributes"])
        for name in old["attributes"]:
            was, now = (file.stored(each["attributes"][name]) for file, each in ((before, old), (after, new)))
            assert len(now) > len(was)
            assert now[: len(was)].tobytes() == was.tobytes(), name
            kinds = [
                (entry["componentType"], entry["type"], entry.get("normalized"))
                for file, each in ((before, old), (after, new))
                for entry in [file.json["accessors"][each["attributes"][name]]]
            ]
            assert kinds[0] == kinds[1], name


def test_new_attributes_lie_between_old_ones() -> None:
    after = bake_once(edited("wrist", two_parts), PALM)
    primitive = after.mesh("wrist")["primitives"][0]
    old = len(Gltf(sample("wrist")).attribute("wrist", "POSITION"))
    values = {name: after.array(index) for name, index in primitive["attributes"].items()}
    assert np.abs(np.linalg.norm(values["NORMAL"][old:], axis=1) - 1).max() < 1e-6
    assert np.abs(np.linalg.norm(values["TANGENT"][old:, :3], axis=1) - 1).max() < 1e-6
    assert np.array_equal(np.unique(values["TANGENT"][:, 3]), [-1.0])
    assert np.abs(values["WEIGHTS_0"].sum(axis=1) - 1).max() < 1e-6
    for name in ("TEXCOORD_0", "TEXCOORD_1", "COLOR_0"):
        assert (values[name][old:] >= values[name][:old].min(axis=0)).all(), name
        assert (values[name][old:] <= values[name][:old].max(axis=0)).all(), name
    known = {tuple(row) for row in values["_ID"][:old].tolist()}
    assert {tuple(row) for row in values["_ID"][old:].tolist()} <= known, "a feature id was made up"


def test_new_vertices_have_the_influences_of_old_ones_in_each_set() -> None:
    """A vertex has five to eight joints, and each set holds four."""
    asset = limb_asset(rings=9, sides=8, joints=8, influences=8)
    shares = np.array([0.25, 0.2, 0.15, 0.12, 0.1, 0.08, 0.06, 0.04])
    for number in (0, 1):
        attribute(asset, 0, f"JOINTS_{number}")[:] = 4 * number + np.arange(4)
        attribute(asset, 0, f"WEIGHTS_{number}")[:] = shares[4 * number : 4 * number + 4]
    file = bake_once(place(asset), tool(bumps=2), max_levels=1)
    primitive = file.mesh("limb")["primitives"][0]["attributes"]
    joints, weights = (
        np.concatenate([file.array(primitive[f"{kind}_{number}"]) for number in (0, 1)], axis=1)
        for kind in ("JOINTS", "WEIGHTS")
    )
    assert len(joints) > 9 * 8
    by_joint = np.take_along_axis(weights, np.argsort(joints, axis=1), axis=1)
    assert by_joint == pytest.approx(np.tile(shares, (len(joints), 1)), abs=1e-6)


def test_the_refined_surface_is_whole() -> None:
    """Every edge that two triangles shared still is shared by two: no cracks, across seams and primitives."""
    for asset in (sample("wrist"), edited("wrist", two_parts)):
        before, after = Gltf(asset), bake_once(asset, PALM)
        counts = []
        for file in (before, after):
            positions = file.attribute("wrist", "POSITION")
            _, weld = np.unique(positions.round(9), axis=0, return_inverse=True)
            faces = weld.reshape(-1)[file.triangles("wrist")]
            edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
            _, uses = np.unique(edges, axis=0, return_counts=True)
            counts.append(np.bincount(uses))
        assert len(counts[1]) == len(counts[0]) == 3
        assert counts[1][1] == counts[0][1], "the border has changed"


@pytest.mark.slow
@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize("accessors", ["sparse", "based"])
def test_many_blendshapes_cost_no_more_than_they_did(normals: bool, accessors: str, tmp_path: Path) -> None:
    """Refinement doubles the vertices of this limb: dense, they would cost twice as much."""
    asset = blendshape_limb(normals=normals).write(tmp_path / "in.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=6, width=0.4), refinement={})
    report = wrinklecli.bake(asset, tools, tmp_path / "out.glb", accessors=accessors)
    (mesh,) = report.data["meshes"]
    assert mesh["vertices"] > 1.8 * mesh["coarse_vertices"]
    own = mesh["own_targets"]
    assert own["count"] == 67
    kinds = 2 if normals else 1
    assert own["bytes_before"] == 67 * 12 * mesh["coarse_vertices"] * kinds
    assert own["bytes"] < 0.5 * own["bytes_before"]
    assert f"the asset's own 67 morph targets in {own['bytes'] / 1e6:.2f} MB" in report.summary
    before, after = Gltf(asset), Gltf(tmp_path / "out.glb")
    old = len(before.attribute("limb", "POSITION"))
    for name in ("POSITION", "NORMAL")[:kinds]:
        assert np.array_equal(after.deltas("limb", name)[:67, :old], before.deltas("limb", name))
        assert after.deltas("limb", name)[:67, old:].any()
    zeros = {
        index
        for target in after.mesh("limb")["primitives"][0]["targets"]
        for index in target.values()
        if not after.array(index).any()
    }
    assert len(zeros) == 1, "what is zero is shared"
    assert_valid(tmp_path / "out.glb")


def test_dense_is_dense_for_refined_targets_of_the_asset_too(tmp_path: Path) -> None:
    asset = blendshape_limb(3)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    count = asset.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
    for target in primitive["targets"]:
        deltas = np.zeros((count, 3))
        deltas[100:120] = 0.01
        target["NORMAL"] = asset.sparse(deltas, base=False)
    wrinklecli.bake(
        asset.write(tmp_path / "in.glb"),
        write_tools(tmp_path / "t.yaml", tool(bumps=6)),
        tmp_path / "o.glb",
        accessors="dense",
    )
    assert not any("sparse" in accessor for accessor in Gltf(tmp_path / "o.glb").json["accessors"])
    assert_valid(tmp_path / "o.glb")


@pytest.mark.slow
@pytest.mark.parametrize("stops", ["features", "none"])
def test_seams_that_are_equal_but_for_rounding_stay_closed(stops: str, tmp_path: Path) -> None:
    """The seam along the tool as exporters of cylinders write it: the last vertex of a ring is at the sine of 2π."""
    tools = write_tools(tmp_path / "tools.yaml", tool(stops=stops), refinement={"max_levels": 0})
    found = []
    for apart in (0.0, 1e-6 * LENGTH):
        asset = limb_asset(rings=12, sides=8)
        positions = attribute(asset, 0, "POSITION").reshape(12, 9, 3)
        positions[:, 8, 2] += np.float32(apart)
        wrinklecli.bake(asset.write(tmp_path / "limb.glb"), tools, tmp_path / "out.glb")
        baked = Gltf(tmp_path / "out.glb")
        heights = np.abs(baked.deltas("limb")).max(axis=(0, 2))
        open_by = np.abs(heights[: 12 * 9].reshape(12, 9)[:, 8] - heights[: 12 * 9].reshape(12, 9)[:, 0]).max()
        found.append((heights.max(), open_by, len(heights)))
    assert found[0][0] > 0.01
    assert found[1] == pytest.approx(found[0], abs=1e-5)


@pytest.mark.parametrize("mode", ["morph", "frames"])
def test_normals_and_tangents_are_unit_where_old_ones_cancel_or_are_0(mode: str) -> None:
    asset = limb_asset(rings=12, sides=8, tangents=True)
    normals, tangents = attribute(asset, 0, "NORMAL"), attribute(asset, 0, "TANGENT")
    signs = np.where(np.arange(len(normals)) % 2, 1.0, -1.0)[:, None]
    normals[:], tangents[:, :3] = signs * [0.0, 1.0, 0.0], signs * [1.0, 0.0, 0.0]
    normals[: len(normals) // 2 : 2] = 0.0
    tangents[: len(tangents) // 3] = 0.0
    top = {"sampling": {"fps": 2}, "refinement": {"max_levels": 1}}
    after = bake_once(place(asset), tool(), top=top, mode=mode)
    for mesh in after.json["meshes"][mode == "frames" :]:
        attributes = mesh["primitives"][0]["attributes"]
        found = [after.array(attributes[name]) for name in ("NORMAL", "TANGENT")]
        assert len(found[0]) > len(normals)
        for directions in found:
            assert np.linalg.norm(directions[:, :3], axis=1) == pytest.approx(1.0, abs=1e-5)
        assert set(found[1][:, 3]) == {1.0, -1.0}


@pytest.mark.slow
def test_a_normal_of_0_becomes_that_of_the_surface() -> None:
    asset = limb_asset(rings=12, sides=8)
    normals = attribute(asset, 0, "NORMAL")
    whole = bake_once(place(asset), tool())
    lost = np.arange(0, len(normals), 7)
    normals[lost] = 0.0
    file = bake_once(place(asset), tool())
    found, wanted = (each.array(each.mesh("limb")["primitives"][0]["attributes"]["NORMAL"]) for each in (file, whole))
    assert np.sum(found * wanted, axis=1)[lost].min() > 0.95
