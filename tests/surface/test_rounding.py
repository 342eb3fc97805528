"""New vertices lie on the normal of their place, near the coarse surface, and on it at hard edges and borders."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from trimesh.triangles import closest_point

from kit.asset import Asset, attribute
from kit.forehead import BROWS, forehead
from kit.limb import cuffed_limb, flat_limb, limb_asset, tool
from kit.prepared import Prepared, prepare
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rounding import hard_edges, hard_inside

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Build = Callable[[], Asset]

SMOOTH: dict[str, Build] = {
    "low-poly": lambda: limb_asset(rings=7, sides=8),
    "coarse": lambda: limb_asset(rings=12, sides=10),
    "fine": lambda: limb_asset(rings=24, sides=16),
    "painted, with a hard edge": lambda: cuffed_limb(rings=13, sides=12),
}
FACETED: dict[str, Build] = {
    "flat": lambda: flat_limb(rings=12, sides=12),
    "hexagonal": lambda: limb_asset(rings=7, sides=6),
    "without NORMAL": lambda: limb_asset(rings=9, sides=8, normals=False),
}


def places_of(fine: Refinement) -> Floats:
    """(vertices, 3) places on the coarse surface, where the texture coordinates are mixed."""
    return fine.subdivision.interpolate(fine.surface.positions)


def new_vertices(fine: Refinement) -> Ints:
    return np.arange(len(fine.surface.positions), len(fine.positions))


def slips_and_departures(prepared: Prepared, fine: Refinement) -> tuple[Floats, Floats]:
    """(new vertices,) offsets along the coarse surface, and away from it, both over the tallest wrinkle."""
    new, places = new_vertices(fine), places_of(fine)
    coarse = fine.surface.positions[fine.surface.triangles]
    nearest, distances = np.zeros((len(new), 3)), np.full(len(new), np.inf)
    for triangle in coarse[np.unique(fine.subdivision.parents[fine.subdivision.changed])]:
        found = closest_point(np.tile(triangle, (len(new), 1, 1)), fine.positions[new])
        away = np.linalg.norm(found - fine.positions[new], axis=1)
        nearer = away < distances
        nearest[nearer], distances[nearer] = found[nearer], away[nearer]
    height = max(patch.greatest_height for patch in prepared.patches)
    return np.linalg.norm(nearest - places[new], axis=1) / height, distances / height


def shares_of(fine: Refinement, prepared: Prepared) -> Floats:
    """(new vertices,) fraction of the tool's height at each."""
    new, patch = new_vertices(fine), prepared.patch
    u, v = patch.coordinates(places_of(fine)[new])
    return patch.presence(u, v, fine.rest_normals[new] @ patch.normal)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", [*SMOOTH, *FACETED])
def test_texture_does_not_slide_and_the_surface_stays_near(name: str) -> None:
    prepared = prepare((SMOOTH | FACETED)[name]())
    fine = prepared.refined()
    slips, departures = slips_and_departures(prepared, fine)
    assert len(slips) > 100
    assert np.quantile(slips, 0.99) <= 0.02
    assert departures.max() <= 0.15
    # The report gives the distance from the place, which is no shorter than that to the nearest point.
    assert departures.max() - 1e-9 <= fine.departures[0] <= 0.15
    assert (fine.departures[0] > 0.05) == (name in SMOOTH)


@pytest.mark.parametrize("name", ["low-poly", "coarse"])
def test_the_whole_scheme_leaves_the_surface_further(name: str) -> None:
    """The scheme `butterfly_full` applies the whole offset, unlike the default."""
    prepared = prepare(SMOOTH[name](), refinement={"scheme": "butterfly_full"})
    fine = prepared.refined()
    assert np.array_equal(fine.positions, fine.subdivision.positions(fine.surface.positions))
    _, departures = slips_and_departures(prepared, fine)
    assert np.quantile(departures, 0.99) > 0.2
    assert fine.departures[0] > 0.2


def test_a_fine_surface_is_as_round_as_the_whole_scheme_makes_it() -> None:
    """Offsets are whole where all of the height remains, and proportional to it elsewhere."""
    prepared = prepare(limb_asset(rings=24, sides=32), refinement={"max_levels": 1})
    fine = prepared.refined()
    new = new_vertices(fine)
    places, full, found = (
        np.linalg.norm(each[new, 1:], axis=1)
        for each in (places_of(fine), fine.subdivision.positions(fine.surface.positions), fine.positions)
    )
    assert (full - places).max() > 1e-3
    assert found == pytest.approx(places + shares_of(fine, prepared) * (full - places), abs=2e-5)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", [*SMOOTH, *FACETED])
def test_new_vertices_lie_on_hard_edges(name: str) -> None:
    fine = prepare((SMOOTH | FACETED)[name]()).refined()
    new, places = new_vertices(fine), places_of(fine)
    if name in FACETED:
        on_edges = np.ones(len(new), bool)
    else:
        # The one hard edge goes round the limb at its middle.
        on_edges = (np.abs(places[new, 0]) < 1e-9) & (name == "painted, with a hard edge")
        assert on_edges.any() == (name == "painted, with a hard edge")
    assert np.array_equal(fine.positions[new][on_edges], places[new][on_edges])
    assert on_edges.all() or not np.array_equal(fine.positions, places)


@pytest.mark.parametrize("flipped", [False, True])
def test_an_edge_is_hard_where_its_faces_meet_at_more_than_50_degrees(flipped: bool) -> None:
    """Sharp edges are hard whatever the normals say, and however the faces are wound."""
    hard = {}
    for sides in (7, 8):
        asset = limb_asset(rings=7, sides=sides)
        if flipped:
            corners = asset.gltf["meshes"][0]["primitives"][0]["indices"]
            view = asset.gltf["bufferViews"][asset.gltf["accessors"][corners]["bufferView"]]
            faces = np.ndarray((view["byteLength"] // 6, 3), "<u2", asset.data, view["byteOffset"])
            faces[::3] = faces[::3, ::-1].copy()
        hard[sides] = prepare(asset).refined().hard_shares[0]
    assert hard[7] > 0.2, "51 degrees"
    assert hard[8] == 0.0, "45 degrees"


def test_hard_edges_at_the_border_of_a_region_are_not_inside() -> None:
    """The one hard edge goes round the limb at its middle, and half of the region ends there."""
    prepared = prepare(cuffed_limb(rings=13, sides=12))
    surface, positions, region = prepared.surface, prepared.rest.bind_positions, prepared.patch
    on_one_side = surface.positions[surface.triangles[region.members], 0].mean(axis=1) < 0.0
    half = replace(region, members=region.members[on_one_side])
    assert 0 < len(half.members) < len(region.members)
    assert hard_edges(surface, positions, [half]).shares[0] > 0.0
    assert hard_inside(surface, positions, half) == 0.0
    assert hard_inside(surface, positions, region) > 0.0


def test_offsets_end_at_the_border_of_the_patch() -> None:
    prepared = prepare(limb_asset(rings=12, sides=10))
    fine = prepared.refined()
    new, places = new_vertices(fine), places_of(fine)
    u, v = prepared.patch.coordinates(places[new])
    outside = (u <= 0) | (u >= 1) | (np.abs(v) >= 1)
    assert outside.sum() > 10
    assert np.array_equal(fine.positions[new][outside], places[new][outside])
    # Inside, offsets grow gently: none is beyond what the height that remains there allows.
    offsets = np.linalg.norm(fine.positions[new] - places[new], axis=1)
    assert (offsets <= 0.15 * prepared.patch.greatest_height * shares_of(fine, prepared) + 1e-4).all()


def test_green_triangles_at_the_border_lie_in_the_old_faces() -> None:
    prepared = prepare(limb_asset(rings=12, sides=10))
    fine = prepared.refined()
    parents = fine.subdivision.parents
    beside = fine.subdivision.changed & ~np.isin(parents, prepared.patch.members)
    assert beside.sum() > 5

    def normals(positions: Floats, triangles: Ints) -> Floats:
        a, b, c = np.moveaxis(positions[triangles], 1, 0)
        found: Floats = np.cross(b - a, c - a)
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    old = normals(fine.surface.positions, fine.surface.triangles[parents[beside]])
    assert normals(fine.positions, fine.triangles[beside]) == pytest.approx(old, abs=1e-6)


def with_morphs(asset: Asset, factor: float = 1.0) -> Asset:
    """The asset with the deltas of its first morph target multiplied."""
    (target,) = asset.gltf["meshes"][0]["primitives"][0]["targets"]
    accessor = asset.gltf["accessors"][target["POSITION"]]
    view = asset.gltf["bufferViews"][accessor["bufferView"]]
    deltas = np.ndarray((accessor["count"], 3), "<f4", asset.data, view["byteOffset"])
    deltas *= factor
    return asset


def test_morph_deltas_get_their_whole_offsets_in_all_directions() -> None:
    """They move nothing at rest, and fade out only near the border of the patch."""
    prepared = prepare(limb_asset(rings=12, sides=10, morphs=2))
    fine, old = prepared.refined(), len(prepared.surface.positions)
    full, flat = (
        each(prepared.surface.morph_deltas)[:, old:]
        for each in (fine.subdivision.positions, fine.subdivision.interpolate)
    )
    shares = shares_of(fine, prepared)
    inside, border = shares > 0.1, shares == 0
    assert min(inside.sum(), border.sum()) > 10
    assert np.abs(full - flat)[:, inside].max() > 1e-3
    assert fine.morph_deltas[:, old:][:, inside] == pytest.approx(full[:, inside], abs=1e-12)
    assert np.array_equal(fine.morph_deltas[:, old:][:, border], flat[:, border])
    assert np.array_equal(fine.morph_deltas[:, :old], prepared.surface.morph_deltas)
    offsets = np.sum((fine.morph_deltas[:, old:] - flat) * (full - flat), axis=(0, 2))
    assert (offsets >= -1e-12).all()
    assert (offsets <= np.sum((full - flat) ** 2, axis=(0, 2)) + 1e-12).all()


def test_morph_deltas_with_a_weight_at_rest_stay_near_the_coarse_surface() -> None:
    asset = limb_asset(rings=12, sides=10, morphs=2)
    asset.gltf["meshes"][0]["weights"] = [0.0, 0.5]
    fine = prepare(asset).refined()
    plain = prepare(limb_asset(rings=12, sides=10, morphs=2)).refined()
    assert not np.array_equal(fine.morph_deltas[1], plain.morph_deltas[1])
    flat = fine.subdivision.interpolate(fine.surface.positions + 0.5 * fine.surface.morph_deltas[1])
    offsets = np.linalg.norm(fine.bind_positions - flat, axis=1)
    assert offsets.max() <= 2.0 * np.linalg.norm(fine.positions - places_of(fine), axis=1).max()


@pytest.mark.quick(1)
@pytest.mark.parametrize("count", [9, 17])
def test_an_expression_is_as_round_at_the_old_edges_as_the_whole_scheme_makes_it(count: int) -> None:
    """On a plane all angles between faces come from the morph target."""
    angles = {}
    for scheme in ("butterfly", "butterfly_full", "midpoint"):
        prepared = prepare(forehead(count=count), BROWS, refinement={"scheme": scheme})
        fine = prepared.refined()
        assert not fine.positions[:, 2].any()
        angles[scheme] = _angles_at_old_edges(fine, fine.positions + fine.morph_deltas[0], prepared)
    assert len(angles["butterfly"]) > 50
    assert angles["butterfly"] == pytest.approx(angles["butterfly_full"], abs=0.5)
    assert np.quantile(angles["butterfly"], 0.9) < 0.7 * np.quantile(angles["midpoint"], 0.9)


def _angles_at_old_edges(fine: Refinement, positions: Floats, prepared: Prepared) -> Floats:
    """(edges,) degrees between two fine faces of two coarse faces, inside the patch."""
    triangles = fine.triangles
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    keys = edges @ [len(positions), 1]
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order]) == 0)
    one, other = order[first] // 3, order[first + 1] // 3
    u, v = prepared.patch.coordinates(fine.rest_positions[edges[order[first]]])
    inside = ((u > 0.2) & (u < 0.8) & (np.abs(v) < 0.7)).all(axis=1)
    inside &= fine.subdivision.parents[one] != fine.subdivision.parents[other]
    found: Floats = np.degrees(np.arccos(np.clip(np.sum(normals[one] * normals[other], axis=1), -1.0, 1.0)))
    return found[inside]


def test_morph_deltas_are_linear() -> None:
    one, two = (
        prepare(with_morphs(limb_asset(rings=12, sides=10, morphs=1), k), tool(laid="stored")).refined()
        for k in (1.0, 2.0)
    )
    assert np.array_equal(one.positions, two.positions)
    assert two.morph_deltas == pytest.approx(2.0 * one.morph_deltas, abs=1e-15)


@pytest.mark.parametrize("name", ["flat", "without NORMAL"])
def test_a_faceted_patch_takes_midpoints(name: str) -> None:
    fine, plain = (
        prepare(FACETED[name](), refinement={"scheme": scheme}).refined() for scheme in ("butterfly", "midpoint")
    )
    assert fine.schemes == ("midpoint",)
    assert fine.hard_shares[0] > 0.5
    assert fine.departures[0] == 0.0
    assert np.array_equal(fine.positions, plain.positions)
    assert np.array_equal(fine.triangles, plain.triangles)


def test_seams_of_smooth_surfaces_are_not_hard() -> None:
    """The asset with normals that two programs rounded differently."""
    asset = limb_asset(rings=12, sides=10)
    normals = attribute(asset, 0, "NORMAL")
    normals += np.random.default_rng(0).uniform(-0.02, 0.02, normals.shape)
    fine = prepare(asset).refined()
    assert fine.hard_shares[0] == 0.0
    assert fine.schemes == ("butterfly",)


@pytest.mark.quick(1)
@pytest.mark.parametrize("scheme", ["butterfly", "butterfly_full", "midpoint"])
def test_shading_at_rest_is_the_authored_one(scheme: str) -> None:
    """Normals of new vertices are mixed from those of their coarse triangle, whatever the positions are."""
    prepared = prepare(cuffed_limb(rings=13, sides=12), refinement={"scheme": scheme})
    fine = prepared.refined()
    normals = prepared.surface.normals
    mixed = np.einsum("vk,vkc->vc", fine.shares, normals[fine.sources])
    corners = prepared.surface.corners[fine.subdivision.parents]
    wanted = np.einsum("fck,fkx->fcx", fine.subdivision.barycentrics, normals[corners])
    assert np.concatenate([normals, mixed])[fine.corners] == pytest.approx(wanted, abs=1e-15)


@pytest.mark.parametrize("keys", [{}, {"strength": 0.5}, {"strength": -1.0}], ids=str)
def test_the_surface_at_rest_does_not_depend_on_the_strength(keys: dict[str, Any]) -> None:
    asset = limb_asset(rings=12, sides=10)
    plain, other = prepare(asset).refined(), prepare(asset, tool(**keys)).refined()
    assert np.array_equal(plain.positions, other.positions)
    assert other.departures[0] == pytest.approx(plain.departures[0] / abs(keys.get("strength", 1.0)))


def test_of_tools_that_overlap_the_greater_share_counts() -> None:
    asset = limb_asset(rings=12, sides=10)
    beside = tool(name="b", origin=[-0.1, 0.25, 0.0], target=[0.7, 0.25, 0.0])
    tools = [tool(), beside]
    settings: dict[str, Any] = {"refinement": {"max_levels": 1}}
    both = prepare(asset, *tools, **settings).refined()
    place = {each.tobytes(): n for n, each in enumerate(places_of(both).round(9))}
    greatest = np.zeros(len(both.positions))
    for each in tools:
        fine = prepare(asset, each, **settings).refined()
        offsets = np.linalg.norm(fine.positions - places_of(fine), axis=1)
        for vertex, at in enumerate(places_of(fine).round(9)):
            greatest[place[at.tobytes()]] = max(greatest[place[at.tobytes()]], offsets[vertex])
    found = np.linalg.norm(both.positions - places_of(both), axis=1)
    assert found == pytest.approx(greatest, rel=0.02, abs=1e-5)
