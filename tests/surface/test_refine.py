"""The refined mesh: corners keep their seams, and skin weights their sums."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.prune import Poses, joint_distances, pruning_errors
from wrinklecli.surface.refine import Refinement, _weights, refine

Floats = NDArray[np.float64]


def attribute(prepared: Prepared, name: str) -> Floats:
    """An attribute of all glTF vertices, primitive after primitive."""
    primitives = prepared.document.gltf["meshes"][0]["primitives"]
    return np.concatenate([prepared.document.accessor(each["attributes"][name]) for each in primitives])


def refined_attribute(fine: Refinement, coarse: Floats) -> Floats:
    return np.concatenate([coarse, np.einsum("vk,vkc->vc", fine.shares, coarse[fine.sources])])


STORED = [{}, {"seam": False}, {"primitives": 3}, {"primitives": 2, "seam": False}, {"indices": None}]


@pytest.mark.quick(1)
@pytest.mark.parametrize("options", STORED, ids=str)
def test_corner_attributes_are_linear_on_each_coarse_triangle(options: dict[str, Any]) -> None:
    prepared = prepare(limb_asset(rings=7, sides=6, **options))
    fine = prepared.refined()
    assert fine.subdivision.levels >= 2
    uvs = attribute(prepared, "TEXCOORD_0")
    corners = prepared.surface.corners[fine.subdivision.parents]
    wanted = np.einsum("fck,fkx->fcx", fine.subdivision.barycentrics, uvs[corners])
    # Shares are multiples of powers of two and UVs are float32, so sums are exact but for one rounding.
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


@pytest.mark.quick(1)
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
    member = np.isin(fine.subdivision.parents, patch.members)
    u, v = patch.coordinates(fine.rest_positions)
    heights = patch.magnitudes(np.full(len(u), 0.5), v, fine.rest_normals)
    edges = np.unique(np.sort(fine.triangles[member][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
    # No step is too long beside the segment, and where less than a hundredth of the height remains.
    shows = (u[edges].max(axis=1) > 1e-6) & (u[edges].min(axis=1) < 1 - 1e-6) & (heights[edges].min(axis=1) > 0.01)
    steps = np.abs(np.diff(u[edges]))[shows]
    assert len(steps) > 30
    # A bump has two intervals, and each level of details halves them.
    assert steps.max() <= 1 / (6 * 2 ** len(details) * edges_per_interval) + 1e-12
    # A green triangle's edge may be half as long as a red one's, and an edge is halved only where it must be.
    assert steps.max() > 1 / (6 * 2 ** len(details) * edges_per_interval) / 2.5


def test_edges_where_the_sides_of_a_path_s_bend_meet_need_not_be_short() -> None:
    places = [
        [x, RADIUS * np.cos(angle), RADIUS * np.sin(angle)] for x, angle in ((-0.2, -0.4), (-0.05, 0), (-0.2, 0.4))
    ]
    bent = {"name": "bent", "path": places, "width": 0.5, "bumps": 5}
    assert prepare(limb_asset(rings=33, sides=24), bent).refined().subdivision.limited == 0


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


@pytest.mark.parametrize("joints", [1, 2, 6])
def test_weights_of_all_vertices_sum_to_1(joints: int) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8, joints=joints, clip=None))
    fine = prepared.refined()
    dense = fine.dense_weights(np.arange(len(fine.positions)), joints)
    assert dense.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert (dense >= 0).all()
    assert fine.weights_pruned.sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert np.array_equal(dense[len(prepared.surface.positions) :], fine.weights.dense().T)


def test_edge_whose_weights_cannot_be_stored_is_left_whole() -> None:
    """Adjacent rings depend on different pairs of joints, so midpoints between them need more than two."""
    asset = limb_asset(rings=7, sides=6, joints=9)
    prepared = prepare(asset)
    poses = Poses(prepared.rig, (prepared.clip,), Memory())
    distances = joint_distances(prepared.rig, prepared.patches, np.arange(9))
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
        errors = pruning_errors(fine.weights.dense().T, fresh, distances, 2, poses.of(np.arange(9)))
        found[tolerance] = (len(fresh), errors.max(initial=0.0), fine.subdivision.blocked)
    assert found[np.inf][1] > 1e-3, "the case is one"
    assert found[1e-3][1] <= 1e-3
    assert found[1e-3][0] < found[np.inf][0]
    assert found[1e-3][2] > 0 == found[np.inf][2]


def test_no_edge_across_a_furrow_is_longer_where_the_patch_fades_than_other_edges() -> None:
    patch = prepare(limb_asset(), tool(bumps=3, profile="skin", variation=0)).patch
    v = np.repeat(np.linspace(0.0, 1.0, 101)[:, None], 2, axis=1)
    for u, least in ((1 / 3, 1.0), (1 / 2, 1 / 1.5)):
        weights = _weights(patch, patch.stretched(np.full(v.shape, u), v) + np.array([-0.01, 0.01]), v)
        assert weights[0] == (1.5 if u == 1 / 3 else 1.0)
        assert (weights >= 0.999 * least).all()


def test_edges_across_a_sharp_furrow_are_shorter_and_those_that_hardly_rise_longer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    prepared = prepare(
        limb_asset(rings=24, sides=24),
        tool(bumps=3, profile="skin", variation=0, width=0.6, attenuation="linear"),
        refinement={"max_levels": 8, "scheme": "midpoint"},
    )
    fine, patch = prepared.refined(), prepared.patch
    assert fine.subdivision.limited == 0
    member = np.isin(fine.subdivision.parents, patch.members)
    u, v = patch.coordinates(fine.rest_positions)
    edges = np.unique(np.sort(fine.triangles[member][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
    heights = patch.magnitudes(np.full(len(u), 0.5), v, fine.rest_normals)[edges].min(axis=1)
    edges = edges[(heights > 0.01) & (u[edges].min(axis=1) > 0) & (u[edges].max(axis=1) < 1)]
    places, shares = patch.stretched(u, v)[edges], 1.0 - np.abs(v[edges]).min(axis=1)
    steps, step = np.abs(np.diff(places, axis=1))[:, 0], 1 / (2 * 6)
    across = np.zeros(len(edges), bool)
    for furrow in (1 / 3, 2 / 3):
        across |= (places.min(axis=1) < furrow) & (places.max(axis=1) > furrow)
    most = step / np.maximum(shares, 0.2) ** 0.25
    assert (steps <= most + 1e-12).all()
    assert (steps[across] <= most[across] / 1.5 + 1e-12).all()
    assert steps[~across & (shares > 0.7)].max() > 0.6 * step, "edges elsewhere are as long as ever"
    monkeypatch.setattr("wrinklecli.surface.refine._FADING", 0.0)
    assert len(prepared.refined().positions) > 1.05 * len(fine.positions)
    with_smooth_crests = prepare(
        limb_asset(rings=30, sides=24), tool(bumps=3, variation=0), refinement={"max_levels": 8, "scheme": "midpoint"}
    )
    assert not len(with_smooth_crests.patch.furrows)
