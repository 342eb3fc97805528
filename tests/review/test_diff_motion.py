"""Golden tests: what a viewer sees over time, vertex by vertex or as surfaces."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import Asset, attribute
from kit.changes import (
    PRIMITIVE,
    bent_normal,
    changed_key,
    compared,
    dropped_clip,
    extras_key,
    hidden_in_scene,
    image_byte,
    lens,
    longer_clip,
    material_factor,
    moved_bind,
    moved_node,
    moved_vertex,
    other_delta,
    other_uv,
    other_weight,
    renamed_node,
    renamed_target,
    stepped,
    stored_weight,
    swapped_joints,
    weight_key,
)
from kit.limb import limb_asset, tool, write_tools
from kit.variants import SMALL, rich
from wrinklecli import bake
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document
from wrinklecli.review.diff.diff import diff
from wrinklecli.tools.records import Length


@given(st.integers(0, 10_000), st.floats(0.01, 100.0), st.sampled_from([0.5, 2.0]))
def test_a_vertex_may_move_by_the_tolerance_and_no_further(
    tmp_path_factory: pytest.TempPathFactory, seed: int, scale: float, factor: float
) -> None:
    rng = np.random.default_rng(seed)
    tolerance = 1e-3 * scale
    root = {"scale": [scale] * 3}
    before, after = (limb_asset(**SMALL, root=root, clip=None) for _ in range(2))
    positions = attribute(after, 0, "POSITION")
    vertex, direction = int(rng.integers(len(positions))), rng.normal(size=3)
    # Bind units: the root scales the limb into the scene.
    positions[vertex] += (factor * tolerance / scale * direction / np.linalg.norm(direction)).astype(np.float32)
    found = compared(tmp_path_factory.mktemp("moved"), before, after, tolerance=Length(tolerance))
    assert found.same == (factor < 1)
    assert found.worst is not None
    assert found.worst.vertex == vertex
    assert found.worst.distance == pytest.approx(factor * tolerance, rel=1e-2)
    if not found.same:
        assert {each.kind for each in found.differences} == {"geometry", "pose"}
        assert all(each.distance == pytest.approx(factor * tolerance, rel=1e-2) for each in found.differences)
        assert all(f"vertex {vertex} is" in each.message for each in found.differences)


@pytest.mark.parametrize("fps", [0.5, 30.0])
def test_the_worst_moment_is_named(tmp_path: Path, fps: float) -> None:
    before, after = rich(), rich()
    weight_key(after)
    # Keys are looked at however coarse the grid is.
    found = compared(tmp_path, before, after, fps=fps)
    assert found.worst is not None
    # The key at 0.3 s has the number 3: the second target's weight, which the joints then carry along.
    assert (found.worst.clip, found.worst.name, found.worst.place) == ("fold", "limb", PRIMITIVE)
    assert found.worst.time == pytest.approx(0.3, abs=1e-6)
    posed = [each for each in found.differences if each.kind == "pose"]
    assert [each.place for each in posed] == [PRIMITIVE]
    assert "clip 'fold' at 0.3 s" in posed[0].message


# Posed


def test_posed_looks_at_positions_alone(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for change in (renamed_node, material_factor, image_byte, renamed_target, bent_normal, lens, extras_key, other_uv):
        change(after)
    found = compared(tmp_path, before, after, posed=True)
    assert found.same
    assert found.normal is not None
    assert found.normal > 10.0


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (dropped_clip, "only in A"),
        (longer_clip, "0 to 2 s -> 0 to 3 s"),
        (changed_key, "clip 'fold'"),
        (swapped_joints, "vertex"),
        (moved_vertex, "stored pose: vertex 17 is 0.01 off"),
        (hidden_in_scene, "stored pose: only in A"),
        (stored_weight, "stored pose: vertex"),
        (other_delta, "stored pose: vertex 40"),
        (other_weight, "clip 'fold'"),
        (moved_node, "stored pose: vertex"),
        (moved_bind, "stored pose: vertex"),
        (stepped, "clip 'fold'"),
    ],
    ids=lambda each: getattr(each, "__name__", ""),
)
def test_posed_sees_what_moves_otherwise(tmp_path: Path, change: Callable[[Asset], None], words: str) -> None:
    before, after = rich(), rich()
    change(after)
    found = compared(tmp_path, before, after, posed=True)
    assert any(words in each.message for each in found.differences), found.differences


def test_only_the_clips_asked_for_are_compared(tmp_path: Path) -> None:
    before, after = rich(), rich()
    changed_key(after)
    assert not compared(tmp_path, before, after, clips=["fold"]).same
    assert compared(tmp_path, before, after, clips=["nod"]).same
    assert compared(tmp_path, before, after, clips=["nod"], posed=True).same
    dropped_clip(after)
    assert not compared(tmp_path, before, after, clips=["nod"]).same
    with pytest.raises(AssetError, match="no clip 'fild'; did you mean 'fold'"):
        compared(tmp_path, before, after, clips=["fild"])


def test_the_stored_pose_is_not_compared_where_clips_are_asked_for(tmp_path: Path) -> None:
    before, after = rich(), rich()
    # In the clip, keys take its place.
    stored_weight(after)
    assert not compared(tmp_path, before, after, posed=True).same
    assert compared(tmp_path, before, after, posed=True, clips=["fold"]).same


def test_a_vertex_of_no_triangle_is_not_seen(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset, place in ((before, 5.0), (after, 6.0)):
        corners = [[0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0.5], [0, 0, place]]
        attributes = {"POSITION": asset.accessor(corners, bounds=True)}
        asset.gltf["meshes"][1]["primitives"][0]["attributes"] = attributes
    assert compared(tmp_path, before, after, posed=True).same
    places = [each.place for each in compared(tmp_path, before, after).differences]
    assert places == ["/meshes/1/primitives/0/attributes/POSITION"]


def test_angles_are_those_between_normals_that_are_there(tmp_path: Path) -> None:
    before, after = limb_asset(**SMALL), limb_asset(**SMALL)
    angle = np.radians(2.0)
    for asset, vertex in ((before, 30), (after, 31)):
        attribute(asset, 0, "NORMAL")[vertex] = 0.0
        attribute(asset, 0, "NORMAL")[5] = [0.0, 1.0, 0.0]
    attribute(after, 0, "NORMAL")[5] = [np.sin(angle), np.cos(angle), 0.0]
    found = compared(tmp_path, before, after, posed=True)
    assert found.same
    assert found.normal == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize("back", [False, True])
def test_what_one_clip_moves_and_the_other_leaves_is_compared_over_time(tmp_path: Path, back: bool) -> None:
    """The hat nods in one file, and in the other a node that shows nothing does."""
    nods, stays = rich(), rich()
    stays.gltf["animations"][-1]["channels"][0]["target"]["node"] = stays.append("nodes", {"name": "nothing"})
    found = compared(tmp_path, *((stays, nods) if back else (nods, stays)), posed=True)
    assert [(each.name, each.distance) for each in found.differences] == [("hat", pytest.approx(0.1))]
    assert "clip 'nod' at 1 s" in found.differences[0].message


def shoes(*places: tuple[str, float]) -> Asset:
    """The asset with nodes that show one more mesh, by their names and x."""
    asset = rich()
    for name, place in places:
        shoe = asset.append("nodes", {"name": name, "mesh": 1, "translation": [place, 0, 0]})
        asset.gltf["scenes"][0]["nodes"].append(shoe)
    return asset


@pytest.mark.slow
def test_twins_are_compared_in_their_order(tmp_path: Path) -> None:
    pair = shoes(("left", -3.0), ("right", 3.0))
    for other in (shoes(("right", 3.0), ("left", -3.0)), pair):
        assert compared(tmp_path, pair, other).same, "documents pair nodes by their names"
    others = shoes(("right", -3.0), ("left", 3.0)), shoes(("left", 3.0), ("right", -3.0))
    assert [compared(tmp_path, pair, other, posed=True).same for other in others] == [True, False]
    assert not any(compared(tmp_path, pair, other).same for other in others)
    for other in (rich(), shoes(("left", -3.0)), shoes(("left", -3.0), ("right", 4.0))):
        assert not compared(tmp_path, pair, other, posed=True).same


def test_points_and_lines_are_compared_by_their_vertices(tmp_path: Path) -> None:
    def dots(count: int, off: float = 0.0) -> Asset:
        asset = rich()
        places = np.zeros((count, 3))
        places[:, 0] = np.linspace(0, 1, count)
        places[-1, 1] = off
        primitive = {"attributes": {"POSITION": asset.accessor(places, bounds=True)}, "mode": 0}
        asset.append("meshes", {"primitives": [primitive]})
        asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "dots", "mesh": 2}))
        return asset

    assert compared(tmp_path, dots(5), dots(5), posed=True).same
    found = compared(tmp_path, dots(5), dots(5, 0.2), posed=True)
    assert found.worst is not None
    assert found.worst.distance == pytest.approx(0.2)
    # Every one of the few dots lies on one of the many, of which every other is a quarter away.
    for a, b, side in ((3, 5, "B"), (5, 3, "A")):
        found = compared(tmp_path, dots(a), dots(b), posed=True)
        assert found.worst is not None
        assert found.worst.distance == pytest.approx(0.25)
        assert found.worst.side == side


@pytest.mark.slow
def test_other_triangles_of_one_surface_are_the_same_as_posed(tmp_path: Path) -> None:
    before, after = limb_asset(**SMALL), limb_asset(**SMALL, mode="strip")
    assert not compared(tmp_path, before, after).same
    found = compared(tmp_path, before, after, posed=True)
    assert found.same
    attribute(after, 0, "POSITION")[3] *= np.float32([1.0, 1.1, 1.1])
    found = compared(tmp_path, before, after, posed=True)
    assert found.worst is not None
    # The seam's first vertex leaves the surface by a tenth of the radius, in every pose.
    assert found.worst.distance == pytest.approx(0.025, rel=0.05)
    assert {each.place for each in found.differences} <= {f"/meshes/0/primitives/{k}" for k in range(8)}


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("gltfpack_c.glb", "gltfpack_cc.glb"),
        ("gltfpack_c.glb", "gltfpack_c_float.glb"),
        ("gltf_transform_draco.glb", "gltf_transform_meshopt.glb"),
    ],
)
def test_what_optimisers_have_rewritten_looks_the_same(first: str, second: str) -> None:
    folder = Path(__file__).parents[1] / "data"
    # Vertices in other orders, quantised, with keys left out; each to a thousandth of the asset's size.
    tolerance = Length(0.1, percent=True)
    assert diff(folder / first, folder / second, posed=True, tolerance=tolerance).same
    assert not diff(folder / first, folder / second, tolerance=tolerance).same


def baked(folder: Path, name: str, asset: Path, *, scheme: str = "midpoint", **options: Any) -> Path:
    tools = write_tools(folder / f"{name}.yaml", tool(), refinement={"scheme": scheme})
    bake(asset, tools, folder / f"{name}.glb", **options)
    return folder / f"{name}.glb"


@pytest.mark.slow
def test_refined_flat_triangles_are_the_same_surface(tmp_path: Path) -> None:
    # At rest no wrinkle shows, and the midpoint scheme keeps the coarse shape.
    asset = limb_asset(rings=13, sides=12, clip=None).write(tmp_path / "limb.glb")
    coarse, fine = (baked(tmp_path, f"levels{levels}", asset, max_levels=levels) for levels in (0, 1))
    counts = [len(read_document(path).accessor(0)) for path in (coarse, fine)]
    assert counts[0] < counts[1]
    found = diff(coarse, fine, posed=True)
    assert found.same
    assert found.worst is not None
    assert found.worst.distance <= 1e-7
    round_ = baked(tmp_path, "butterfly", asset, scheme="butterfly_full", max_levels=1)
    found = diff(coarse, round_, posed=True)
    assert not found.same
    assert found.worst is not None
    # A chord of a twelfth of the circle is this far from it: what the smooth scheme fills.
    sagitta = 0.25 * (1 - np.cos(np.pi / 12))
    assert 0.5 * sagitta < found.worst.distance < 1.1 * sagitta
    assert found.worst.side == "B"


@pytest.mark.slow
def test_morph_and_frames_show_the_same_surface(tmp_path: Path) -> None:
    asset = limb_asset(rings=13, sides=12).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(), sampling={"fps": 10})
    report = bake(asset, tools, tmp_path / "morph.glb")
    bake(asset, tools, tmp_path / "frames.glb", mode="frames")
    paths = [tmp_path / "morph.glb", tmp_path / "frames.glb"]
    limit = Length(report.data["meshes"][0]["max_error"])
    frames = [each for each in read_document(paths[1]).items("nodes") if "_fold_" in each["name"]]
    for a, b in (paths, paths[::-1]):
        found = diff(a, b, posed=True, tolerance=limit)
        assert found.same, found.differences
        # The frames' own times, none between them.
        assert found.times == len(frames)
    assert not diff(*paths, tolerance=limit).same
    # The wrinkles are there to be missed.
    assert not diff(asset, paths[1], posed=True, tolerance=limit).same
    bake(asset, tools, tmp_path / "fewer.glb", mode="frames", fps=5)
    assert diff(paths[0], tmp_path / "fewer.glb", posed=True, tolerance=limit).same


@pytest.mark.slow
def test_a_dense_bake_is_the_same_as_a_sparse_one(tmp_path: Path) -> None:
    asset = limb_asset(rings=13, sides=12).write(tmp_path / "limb.glb")
    sparse = baked(tmp_path, "sparse", asset)
    dense = baked(tmp_path, "dense", asset, accessors="dense")
    assert sparse.read_bytes() != dense.read_bytes()
    assert diff(sparse, dense).same
