"""The refined mesh: corners keep their seams, skin weights their sums, and contacts their places."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.asset import Asset
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, as_document, prepare
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import read_rig
from wrinklecli.method.refine import (
    Refinement,
    contacts_of,
    influence_count,
    joint_distances,
    prune,
    pruning_errors,
    refine,
)

Floats = NDArray[np.float64]


def attribute(prepared: Prepared, name: str) -> Floats:
    """An attribute of all glTF vertices, primitive after primitive."""
    primitives = prepared.document.gltf["meshes"][0]["primitives"]
    return np.concatenate([prepared.document.accessor(each["attributes"][name]) for each in primitives])


def refined_attribute(fine: Refinement, coarse: Floats) -> Floats:
    return np.concatenate([coarse, np.einsum("vk,vkc->vc", fine.shares, coarse[fine.sources])])


# --- Corners ---

STORED = [{}, {"seam": False}, {"primitives": 3}, {"primitives": 2, "seam": False}, {"indices": None}]


@pytest.mark.parametrize("options", STORED, ids=str)
def test_corner_attributes_are_linear_on_each_coarse_triangle(options: dict[str, Any]) -> None:
    prepared = prepare(limb_asset(rings=7, sides=6, **options))
    fine = prepared.refined()
    assert fine.subdivision.levels >= 2
    uvs = attribute(prepared, "TEXCOORD_0")
    corners = prepared.surface.corners[fine.subdivision.parents]
    wanted = np.einsum("fck,fkx->fcx", fine.subdivision.barycentrics, uvs[corners])
    # Shares are multiples of powers of two and UVs are float32: sums are exact but for one rounding.
    assert refined_attribute(fine, uvs)[fine.corners] == pytest.approx(wanted, abs=1e-15)


@pytest.mark.parametrize("options", STORED, ids=str)
def test_corners_lie_on_their_welded_vertices(options: dict[str, Any]) -> None:
    prepared = prepare(limb_asset(rings=7, sides=6, **options), refinement={"scheme": "midpoint"})
    fine = prepared.refined()
    assert np.array_equal(fine.weld[fine.corners], fine.triangles)
    # The midpoint scheme keeps the coarse shape, so corners mixed like UVs lie where the vertices do.
    places = refined_attribute(fine, attribute(prepared, "POSITION"))
    assert places == pytest.approx(fine.positions[fine.weld], abs=1e-15)


@pytest.mark.parametrize("options", STORED, ids=str)
def test_new_gltf_vertices_mix_vertices_of_their_own_primitive(options: dict[str, Any]) -> None:
    prepared = prepare(limb_asset(rings=7, sides=6, **options))
    fine = prepared.refined()
    starts = prepared.surface.vertex_starts
    assert (fine.shares.sum(axis=1) == 1.0).all()
    assert (fine.shares >= 0).all()
    owners = np.searchsorted(starts, fine.sources, side="right") - 1
    assert ((owners == fine.primitives[:, None]) | (fine.shares == 0)).all()
    old = len(prepared.surface.weld)
    corner_owners = np.concatenate([np.searchsorted(starts, np.arange(old), side="right") - 1, fine.primitives])
    assert np.array_equal(corner_owners[fine.corners], np.tile(fine.triangle_primitives[:, None], 3))
    used = np.unique(fine.corners)
    assert np.isin(np.arange(old, len(fine.weld)), used).all(), "every new glTF vertex is some corner's"


def test_seam_stays_a_seam_and_what_was_one_vertex_stays_one() -> None:
    split, whole = (prepare(limb_asset(rings=7, sides=6, seam=seam)) for seam in (True, False))
    fine, plain = split.refined(), whole.refined()
    assert len(fine.positions) == len(plain.positions)
    uvs = refined_attribute(fine, attribute(split, "TEXCOORD_0"))
    on_seam = np.flatnonzero(np.bincount(fine.weld) > 1)
    assert len(on_seam) > 7, "the seam itself was split"
    for vertex in on_seam:
        one, other = uvs[fine.weld == vertex]
        assert {one[0], other[0]} == {0.0, 1.0}
        assert one[1] == other[1]
        assert fine.positions[vertex, 1] == pytest.approx(RADIUS, abs=0.01)
    assert len(plain.weld) == len(plain.positions), "without a seam nothing is split"
    # No triangle reaches across the seam in UV space.
    assert np.ptp(uvs[fine.corners][..., 0], axis=1).max() <= 1 / 6 + 1e-7


@pytest.mark.parametrize("levels", [0, 1, 3])
def test_old_vertices_and_untouched_triangles_are_as_they_were(levels: int) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8, morphs=1), refinement={"max_levels": levels})
    surface, fine = prepared.surface, prepared.refined()
    old = len(surface.positions)
    assert np.array_equal(fine.positions[:old], surface.positions)
    assert np.array_equal(fine.morph_deltas[:, :old], surface.morph_deltas)
    assert np.array_equal(fine.weld[: len(surface.weld)], surface.weld)
    kept = np.bincount(fine.subdivision.parents) == 1
    assert np.array_equal(fine.corners[kept[fine.subdivision.parents]], surface.corners[kept])
    if levels == 0:
        assert np.array_equal(fine.corners, surface.corners)
        assert fine.sources.shape == (0, 3)
    assert fine.subdivision.levels <= levels


# --- How fine ---


@pytest.mark.parametrize("edges_per_interval", [1, 2, 4])
@pytest.mark.parametrize("details", [[], [0.3]])
def test_edges_are_as_short_along_u_as_the_curve_needs(edges_per_interval: int, details: list[float]) -> None:
    prepared = prepare(
        limb_asset(rings=6, sides=8),
        tool(details=details, bumps=3),
        refinement={"max_levels": 8, "edges_per_interval": edges_per_interval, "scheme": "midpoint"},
    )
    fine, patch = prepared.refined(), prepared.patch
    assert fine.subdivision.limited == 0
    member = patch.members[fine.subdivision.parents]
    u, v = patch.coordinates(fine.rest_positions)
    heights = patch.magnitudes(np.full(len(u), 0.5), v, fine.rest_normals)
    edges = np.unique(np.sort(fine.triangles[member][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
    # Beside the segment, and where less than a hundredth of the height is left, no step is too long.
    shows = (u[edges].max(axis=1) > 1e-6) & (u[edges].min(axis=1) < 1 - 1e-6) & (heights[edges].min(axis=1) > 0.01)
    steps = np.abs(np.diff(u[edges]))[shows]
    assert len(steps) > 30
    # Two intervals for each bump, each halved by a level of details.
    assert steps.max() <= 1 / (6 * 2 ** len(details) * edges_per_interval) + 1e-12
    # A green triangle's edge may be half as long as a red one's, and an edge is halved only where it must be.
    assert steps.max() > 1 / (6 * 2 ** len(details) * edges_per_interval) / 2.5


@pytest.mark.parametrize("attachment", ["skin", "patch"])
def test_edges_beside_a_patch_are_split_only_where_it_may_come_to_lie_there(attachment: str) -> None:
    prepared = prepare(limb_asset(rings=24, sides=32), tool(attachment=attachment), refinement={"max_levels": 1})
    fine, patch = prepared.refined(), prepared.patch
    halves = fine.subdivision.linear
    assert halves is not None
    ends = halves.columns[halves.starts[len(fine.surface.positions)] :].reshape(-1, 2)
    u, v = (each[ends] for each in patch.coordinates(fine.rest_positions))
    cosines = (fine.rest_normals @ patch.normal)[ends].max(axis=1)
    beside = (u.max(axis=1) < 0) | (u.min(axis=1) > 1) | (v.max(axis=1) < -1) | (v.min(axis=1) > 1) | (cosines < 0.2)
    assert len(ends) > 100
    assert beside.any() == (attachment == "patch")


# --- Skin weights ---


@pytest.mark.parametrize("joints", [1, 2, 6])
def test_weights_of_all_vertices_sum_to_1(joints: int) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8, joints=joints, clip=None))
    fine = prepared.refined()
    dense = fine.dense_weights(np.arange(len(fine.positions)), joints)
    assert dense.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert (dense >= 0).all()
    assert fine.weights_pruned.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert np.array_equal(dense[len(prepared.surface.positions) :], fine.weights)


@st.composite
def weight_rows(draw: st.DrawFn) -> tuple[Floats, Floats, int]:
    joints = draw(st.integers(1, 7))
    shares = draw(
        st.lists(st.lists(st.integers(0, 9), min_size=joints, max_size=joints).filter(any), min_size=1, max_size=5)
    )
    weights = np.array(shares, float)
    apart = np.array(draw(st.lists(st.integers(1, 30), min_size=joints, max_size=joints)))
    # Joints hang on a star: through its middle, distances add up.
    distances = (apart[:, None] + apart) * ~np.eye(joints, dtype=bool)
    return weights / weights.sum(axis=1, keepdims=True), distances.astype(float), draw(st.integers(1, 5))


@given(weight_rows())
def test_pruned_weights_keep_sum_and_joints(rows: tuple[Floats, Floats, int]) -> None:
    weights, distances, influences = rows
    joints, kept = prune(weights, distances, influences)
    assert joints.shape == kept.shape == (len(weights), influences)
    assert kept.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert (kept >= 0).all()
    assert (np.diff(kept, axis=1) <= 0).all(), "heaviest first"
    for row, its_joints, its_weights in zip(weights, joints, kept, strict=True):
        used = its_joints[its_weights > 0]
        assert len(set(used)) == len(used)
        assert (row[used] > 0).all(), "no joint comes in that was not there"
        assert (its_weights[its_weights > 0] >= row[used] - 1e-15).all()
        assert not its_joints[its_weights == 0].any()
        if (row > 0).sum() <= influences:
            assert np.array_equal(np.sort(row[row > 0]), np.sort(its_weights[its_weights > 0]))


def test_one_influence_too_many_goes_where_it_costs_least() -> None:
    # Joints on a line at 0, 1, 2, 10: the lightest one is far from all, so another near its neighbour goes.
    places = np.array([0.0, 1.0, 2.0, 10.0])
    distances = np.abs(places[:, None] - places)
    joints, kept = prune(np.array([[0.4, 0.2, 0.25, 0.15]]), distances, 3)
    assert joints.tolist() == [[0, 2, 3]]
    # Joint 1 costs 0.2 wherever it goes, joint 3 costs 1.2; of 0 and 2, equally near, the heavier takes it.
    assert kept == pytest.approx(np.array([[0.6, 0.25, 0.15]]), abs=1e-15)


def test_pruning_never_mixes_across_the_bending_bone_if_it_need_not() -> None:
    """Of influences on both sides of the fold, a side is merged with itself before it goes to the other."""
    prepared = prepare(limb_asset(rings=9, sides=8, joints=6), tool(origin=[-0.3, RADIUS, 0], target=[0.3, RADIUS, 0]))
    distances = joint_distances(prepared.rig, prepared.patches)
    bent = int(np.argmax(np.diff(distances[0])))  # the bone between joint `bent` and the next
    rng = np.random.default_rng(3)
    weights = rng.dirichlet(np.ones(6), 50)
    joints, kept = prune(weights, distances, 4)
    near = np.zeros(50)
    for column in range(4):
        near += np.where(joints[:, column] <= bent, kept[:, column], 0)
    assert near == pytest.approx(weights[:, : bent + 1].sum(axis=1), abs=1e-14)


def test_bones_between_the_anchors_are_long() -> None:
    # Joints 0 … 4 of a limb from -1 to 1: the anchors at ±0.4 hang on joints 1 and 3.
    prepared = prepare(limb_asset(rings=9, sides=8, joints=5))
    distances = joint_distances(prepared.rig, prepared.patches)
    bones = np.diagonal(distances, 1)
    assert bones[[0, 3]].tolist() == [1.0, 1.0]
    assert (bones[[1, 2]] > 100).all()
    assert np.array_equal(distances, distances.T)
    # Along a chain lengths add up.
    ends = np.concatenate([[0.0], np.cumsum(bones)])
    assert np.array_equal(distances, np.abs(ends[:, None] - ends))


@pytest.mark.parametrize("start", np.linspace(-0.99, -0.85, 8).tolist())
def test_no_bone_bends_between_anchors_on_one_joint(start: float) -> None:
    """Whatever their shares of it sum to: 1, or a rounding more or less."""
    ends = {"origin": [start, RADIUS, 0.01], "target": [start + 0.09, RADIUS, -0.02]}
    prepared = prepare(limb_asset(rings=9, sides=8, joints=3), tool(**ends, width=0.1))
    assert np.diagonal(joint_distances(prepared.rig, prepared.patches), 1).tolist() == [1.0, 1.0]


def test_joints_of_separate_trees_are_furthest() -> None:
    asset = limb_asset(rings=9, sides=8, joints=3)
    asset.gltf["nodes"][2]["children"] = []
    prepared = prepare(asset, tool(origin=[-0.97, RADIUS, 0], target=[-0.8, RADIUS, 0], width=0.1))
    distances = joint_distances(prepared.rig, prepared.patches)
    assert distances[0, 1] == 1.0
    assert distances[0, 2] == distances[2, 1] > 100


@given(seed=st.integers(0, 999))
def test_pruning_errors_are_those_of_skinning_both_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(5), 4)
    positions, poses = rng.normal(size=(4, 3)), rng.normal(size=(3, 5, 4, 4))
    poses[:, :, 3] = [0, 0, 0, 1]
    distances = np.abs(np.arange(5)[:, None] - np.arange(5)).astype(float)
    joints, kept = prune(weights, distances, 2)
    errors = pruning_errors(weights, positions, distances, 2, poses)
    for vertex in range(4):
        point = np.append(positions[vertex], 1.0)
        exact = np.einsum("j,pjab,b->pa", weights[vertex], poses, point)
        stored = np.einsum("j,pjab,b->pa", kept[vertex], poses[:, joints[vertex]], point)
        assert errors[vertex] == pytest.approx(np.linalg.norm(exact - stored, axis=1).max(), abs=1e-12)


def test_edge_whose_weights_cannot_be_stored_is_left_whole() -> None:
    """Adjacent rings hang on different pairs of joints, so midpoints between them need more than two."""
    asset = limb_asset(rings=7, sides=6, joints=9)
    prepared = prepare(asset)
    times = np.linspace(0, 2, 9)
    poses = joint_matrices(prepared.rig, prepared.clip, times)
    distances = joint_distances(prepared.rig, prepared.patches)
    found = {}
    for tolerance in (1e-3, np.inf):
        fine = refine(
            prepared.surface,
            prepared.rest,
            prepared.patches,
            prepared.rig,
            settings=prepared.settings.refinement,
            contacts=np.zeros(len(prepared.surface.positions), bool),
            influences=2,
            poses=poses,
            tolerance=tolerance,
        )
        fresh = fine.bind_positions[len(prepared.surface.positions) :]
        errors = pruning_errors(fine.weights, fresh, distances, 2, poses)
        found[tolerance] = (len(fresh), errors.max(initial=0.0), fine.subdivision.blocked)
    assert found[np.inf][1] > 1e-3, "the case is one"
    assert found[1e-3][1] <= 1e-3
    assert found[1e-3][0] < found[np.inf][0]
    assert found[1e-3][2] > 0 == found[np.inf][2]


@pytest.mark.parametrize(("options", "count"), [({}, 4), ({"influences": 8}, 8), ({"skinned": False}, 1)])
def test_influences_that_the_file_can_store(options: dict[str, Any], count: int) -> None:
    document = as_document(limb_asset(rings=3, sides=4, morphs=1, **options))
    assert influence_count(document, read_rig(document, 0)) == count


def test_influences_are_those_of_the_poorest_primitive() -> None:
    asset = limb_asset(rings=5, sides=4, influences=8, primitives=2)
    del asset.gltf["meshes"][0]["primitives"][1]["attributes"]["JOINTS_1"]
    document = as_document(asset)
    assert influence_count(document, read_rig(document, 0)) == 4


# --- Contacts ---


def with_neighbour(places: Any, *, translation: Any = (0, 0, 0), **options: Any) -> Asset:
    """The limb and a static mesh beside it."""
    asset = limb_asset(rings=9, sides=8, **options)
    corners = np.asarray(places, np.float32)
    primitive = {"attributes": {"POSITION": asset.accessor(corners - np.float32(translation), bounds=True)}}
    mesh = asset.append("meshes", {"primitives": [primitive]})
    node = asset.append("nodes", {"name": "neighbour", "mesh": mesh, "translation": list(translation)})
    asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


@pytest.mark.parametrize("translation", [(0, 0, 0), (4, -2, 1)])
def test_vertices_that_touch_another_mesh_are_found_and_their_edges_kept(translation: Any) -> None:
    # Rings of 9 at multiples of 1/4; the top edge of the limb is y = 1/4. Two vertices touch, one is 0.001 off.
    touching = [[0.0, 0.25, 0.0], [0.25, 0.25, 0.0], [-0.25, 0.251, 0.0]]
    prepared = prepare(with_neighbour(touching, translation=translation), refinement={"max_levels": 5})
    contacts = contacts_of(prepared.document, prepared.rig, prepared.surface, prepared.rest)
    assert sorted(prepared.surface.positions[contacts].tolist()) == touching[:2]
    ends = set(np.flatnonzero(contacts).tolist())

    def is_whole(fine: Refinement) -> bool:
        return any(ends <= set(triangle) for triangle in fine.triangles.tolist())

    assert not is_whole(prepared.refined())
    assert is_whole(prepared.refined(contacts=contacts))


def test_twins_of_the_own_mesh_are_contacts() -> None:
    asset = limb_asset(rings=9, sides=8, joints=3, primitives=2)
    # The second half's first ring hangs on another joint: not welded, but touching.
    second = asset.gltf["meshes"][0]["primitives"][1]["attributes"]
    joints = np.zeros((45, 4), np.uint8)
    joints[:, 0] = 2
    second["JOINTS_0"] = asset.accessor(joints, "u1")
    second["WEIGHTS_0"] = asset.accessor(np.tile([1.0, 0, 0, 0], (45, 1)))
    prepared = prepare(asset, tool(target=[0.45, RADIUS, 0]))
    contacts = contacts_of(prepared.document, prepared.rig, prepared.surface, prepared.rest)
    assert contacts.sum() == 2 * 8
    assert (prepared.surface.positions[contacts][:, 0] == 0).all()


def test_seam_is_no_contact() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8))
    contacts = contacts_of(prepared.document, prepared.rig, prepared.surface, prepared.rest)
    assert not contacts.any()
