"""Displacements as high as they should be in world space, along normals, and normals that follow them."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, as_document, prepare
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import read_rig
from wrinklecli.errors import BakeError
from wrinklecli.method.curve import plan_curve
from wrinklecli.method.refine import Refinement
from wrinklecli.method.shapes import (
    Activity,
    CarriedPatch,
    activities,
    activity,
    carry,
    compress,
    displaced_normals,
    displacements,
    further_activities,
    shapes_of,
    turn_to,
    weights_of,
)

Floats = NDArray[np.float64]

ROOTS = [
    {},
    {"rotation": [0.1, 0.5, -0.3, 0.8], "translation": [3, -2, 1]},
    {"scale": [3, 3, 3]},
    {"scale": [-1, 1, 1]},
    {"scale": [0.5, 2, 1]},
    {"scale": [-1, -2, -0.5], "rotation": [0, 0.6, 0, 0.8]},
]
# Imposes shortening at rest: a fifth more skin than there is room for.
MORE = {"keys": {"fold": [[0, "120%"], [1, "120%"]]}}


def placed(root: Any, **keys: Any) -> dict[str, Any]:
    """The limb's default tool where a root transform has put its place."""
    document = as_document(limb_asset(rings=3, sides=4, root=root))
    matrix = node_matrices(read_rig(document, 0), None, np.zeros(1), [3])[0, 0]
    ends = {key: (matrix[:3, :3] @ tool()[key] + matrix[:3, 3]).tolist() for key in ("origin", "target")}
    return tool(**ends, **{"width": "40%", **keys})


def carry_patch(prepared: Prepared, *, pinned: Any = None) -> tuple[CarriedPatch, Refinement]:
    fine = prepared.refined()
    pins = np.zeros(len(prepared.surface.positions), bool) if pinned is None else pinned
    return carry(prepared.patch, fine, pins), fine


def moved(prepared: Prepared, carried: CarriedPatch, fine: Refinement, times: Any) -> Floats:
    return displacements(carried, fine, prepared.rig, prepared.rest, prepared.clip, np.asarray(times, float))


def scattered(carried: CarriedPatch, fine: Refinement, displacement: Floats) -> Floats:
    """(frames, fine vertices, 3), 0 where the tool moves no vertex."""
    every = np.zeros((len(displacement), len(fine.positions), 3))
    every[:, carried.vertices] = displacement
    return every


# --- Height and direction ---


@pytest.mark.parametrize("root", ROOTS, ids=str)
@pytest.mark.parametrize("strategy", ["everywhere", "origin", "both_ends"])
@pytest.mark.parametrize("strength", [1.0, -0.5])
def test_displacement_at_rest_has_the_intended_height_along_the_world_normal(
    root: Any, strategy: Any, strength: float
) -> None:
    asked = placed(root, rest_length=MORE, strategy=strategy, strength=strength, attenuation="linear", bumps=3, gap=1)
    prepared = prepare(limb_asset(rings=15, sides=12, root=root), asked)
    carried, fine = carry_patch(prepared)
    patch, span = prepared.patch, prepared.patch.span
    (displacement,) = moved(prepared, carried, fine, [0.0])
    world = np.einsum("vab,vb->va", fine.blended[carried.vertices, :, :3], displacement)
    # The tool's own formula, from the curve's amplitudes: bumps of two intervals of 8, gaps of one.
    curve = plan_curve(
        bumps=3,
        gap=1,
        strategy=strategy,
        details=(),
        profile="smooth",
        max_height=patch.curve.max_height,
        rest_length=span,
        greatest_rest_length=1.2 * span,
    )
    lengths = np.array([1.2 * span])
    amplitudes, _ = curve.follow(np.array([span]), lengths)
    u, v = patch.coordinates(fine.rest_positions[carried.vertices])
    heights = np.zeros(len(u))
    for group, bumps in enumerate(curve.groups):
        for bump in bumps:
            tau = (8 * u - 3 * bump) / 2
            heights += np.where((tau > 0) & (tau < 1), amplitudes[0, group, 0] * np.sin(np.pi * tau) ** 2, 0)
    facing = np.clip((fine.rest_normals[carried.vertices] @ patch.normal - 0.2) / 0.4, 0, 1)
    signed = strength * heights * (1 - np.abs(v)) * facing**2 * (3 - 2 * facing)
    wanted = signed[:, None] * fine.rest_normals[carried.vertices]
    assert np.abs(signed).max() > 0.01 * span, "the case is one"
    assert world == pytest.approx(wanted, abs=1e-9 * span)  # the smooth curve's own precision


@pytest.mark.parametrize("root", ROOTS, ids=str)
def test_wrinkles_point_out_of_the_limb(root: Any) -> None:
    prepared = prepare(limb_asset(rings=15, sides=12, root=root), placed(root, rest_length=MORE))
    carried, fine = carry_patch(prepared)
    (displacement,) = moved(prepared, carried, fine, [0.0])
    outward = fine.bind_positions[carried.vertices] * [0, 1, 1]
    assert (np.sum(displacement * outward, axis=1) >= 0).all()


@pytest.mark.parametrize("attachment", ["skin", "patch"])
def test_nothing_moves_without_shortening(attachment: str) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool(attachment=attachment))
    carried, fine = carry_patch(prepared)
    assert not moved(prepared, carried, fine, [0.0, 2.0]).any()
    assert moved(prepared, carried, fine, [1.0]).any()


@pytest.mark.parametrize("attachment", ["skin", "patch"])
@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("rotation", [[0, 0, 0, 1], [0.5, -0.5, 0.5, 0.5]]),
        ("translation", [[0, 0, 0], [9, -8, 7]]),
        ("scale", [[1, 1, 1], [0.3, 0.3, 0.3]]),
    ],
)
def test_moving_turning_and_scaling_the_character_makes_no_wrinkles(attachment: str, path: str, values: Any) -> None:
    asset = limb_asset(rings=9, sides=8, clip=None, root={})
    animation: dict[str, Any] = {"name": "root"}
    asset.channel(animation, 3, path, [0, 1], values)
    asset.append("animations", animation)
    prepared = prepare(asset, tool(attachment=attachment))
    carried, fine = carry_patch(prepared)
    assert not moved(prepared, carried, fine, np.linspace(0, 1, 7)).any()


def test_only_vertices_on_the_patch_move() -> None:
    prepared = prepare(limb_asset(rings=15, sides=12), tool(rest_length=MORE))
    carried, fine = carry_patch(prepared)
    u, v = prepared.patch.coordinates(fine.rest_positions)
    on_patch = (u >= 0) & (u <= 1) & (np.abs(v) <= 1) & (fine.rest_normals @ prepared.patch.normal > 0.2)
    assert on_patch[carried.vertices].all()
    # All that lie well inside do: near its edges the attenuation falls below what can be seen.
    inner = (u >= 0) & (u <= 1) & (np.abs(v) <= 0.99) & (fine.rest_normals @ prepared.patch.normal > 0.25)
    assert np.isin(np.flatnonzero(inner), carried.vertices).all()
    assert (np.diff(carried.vertices) > 0).all()


def test_pinned_vertices_stay_and_their_neighbours_do_not() -> None:
    prepared = prepare(limb_asset(rings=15, sides=12), tool(rest_length=MORE))
    free, _ = carry_patch(prepared)
    old = free.vertices[free.vertices < len(prepared.surface.positions)]
    pinned = np.zeros(len(prepared.surface.positions), bool)
    pinned[old[::2]] = True
    held, _ = carry_patch(prepared, pinned=pinned)
    assert not np.isin(old[::2], held.vertices).any()
    others = np.setdiff1d(free.vertices, old[::2])
    assert np.array_equal(held.vertices, others)
    assert np.array_equal(held.directions, free.directions[np.isin(free.vertices, others)])


def test_tool_that_moves_nothing_is_refused() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), refinement={"max_levels": 0})
    with pytest.raises(BakeError, match=r"tools\.yaml:1: tools\[0\]: moves no vertex"):
        carry_patch(prepared, pinned=np.ones(len(prepared.surface.positions), bool))


def test_vertices_of_singular_joints_stay_and_are_counted() -> None:
    """The middle of three joints is flat at rest: what hangs on it alone has no displacement before skinning."""
    asset = limb_asset(rings=25, sides=12, joints=3, clip=None)
    asset.gltf["nodes"][2]["scale"] = [1, 1, 1e-5]
    asset.gltf["nodes"][3]["scale"] = [1, 1, 1e5]
    prepared = prepare(asset, tool(origin=[-0.7, RADIUS, 0], target=[0.7, RADIUS, 0], width=0.2))
    carried, fine = carry_patch(prepared)
    values = np.linalg.svd(fine.blended[:, :, :3], compute_uv=False)
    singular = values[:, 2] < 1e-3 * values[:, 0]
    u, v = prepared.patch.coordinates(fine.rest_positions)
    member = np.unique(fine.triangles[prepared.patch.members[fine.subdivision.parents]])
    stuck = [m for m in member if singular[m] and 0 < u[m] < 1 and abs(v[m]) < 1]
    assert stuck, "the case is one"
    assert not np.isin(stuck, carried.vertices).any()
    assert carried.stuck == len(stuck)


def test_tools_that_overlap_add_up() -> None:
    """Two of half the strength are one of the whole."""
    asset = limb_asset(rings=15, sides=12)
    whole = prepare(asset, tool(rest_length=MORE))
    halves = prepare(asset, *(tool(name=name, rest_length=MORE, strength=0.5) for name in ("a", "b")))
    fine = halves.refined()
    assert np.array_equal(fine.positions, whole.refined().positions)
    none = np.zeros(len(whole.surface.positions), bool)
    one = carry(whole.patch, fine, none)
    total = sum(
        scattered(each, fine, moved(halves, each, fine, [0.0, 1.0]))
        for each in (carry(patch, fine, none) for patch in halves.patches)
    )
    assert total == pytest.approx(scattered(one, fine, moved(whole, one, fine, [0.0, 1.0])), abs=1e-15)


@pytest.mark.parametrize("strength", [1.0, 2.0, 0.0])
def test_strength_in_a_clip_takes_the_place_of_the_tool_s(strength: float) -> None:
    asset = limb_asset(rings=9, sides=8)
    plain = prepare(asset, tool(strength=0.25))
    other = prepare(asset, tool(strength=strength, clips={"fold": 0.25}))
    results = [moved(each, *carry_patch(each), [0.5, 1.0]) for each in (plain, other)]
    assert results[1] == pytest.approx(results[0], abs=1e-15)


# --- The paper's attachment ---


@pytest.mark.parametrize("root", ROOTS[:4], ids=str)
@pytest.mark.parametrize("profile", ["smooth", "polyline"])
def test_projected_anew_at_rest_is_carried_by_the_skin(root: Any, profile: str) -> None:
    """Unrefined and placed by a similarity, where area-weighted normals are the same before and after skinning."""
    results = []
    for attachment in ("skin", "patch"):
        prepared = prepare(
            limb_asset(rings=25, sides=24, root=root),
            placed(root, rest_length=MORE, attachment=attachment, profile=profile),
            refinement={"max_levels": 0},
        )
        carried, fine = carry_patch(prepared)
        results.append(scattered(carried, fine, moved(prepared, carried, fine, [0.0])))
    assert np.abs(results[0]).max() > 0.01, "the case is one"
    assert results[1] == pytest.approx(results[0], abs=1e-12)


def test_projected_anew_a_pinned_vertex_stays_too() -> None:
    prepared = prepare(limb_asset(rings=15, sides=12), tool(rest_length=MORE, attachment="patch"))
    pinned = np.zeros(len(prepared.surface.positions), bool)
    free, fine = carry_patch(prepared)
    pinned[free.vertices[free.vertices < len(pinned)]] = True
    held, _ = carry_patch(prepared, pinned=pinned)
    every = scattered(held, fine, moved(prepared, held, fine, [0.0, 0.5]))
    assert every.any()
    assert not every[:, : len(pinned)][:, pinned].any()


@pytest.mark.parametrize("strategy", ["everywhere", "origin"])
def test_projected_anew_a_frame_depends_on_no_other(strategy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asset = limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")
    prepared = prepare(asset, tool(attachment="patch", strategy=strategy))
    carried, fine = carry_patch(prepared)
    times = np.linspace(0.0, 2.0, 12)
    together = moved(prepared, carried, fine, times)
    assert together.any()
    alone = np.concatenate([moved(prepared, carried, fine, [time]) for time in times])
    assert alone == pytest.approx(together, abs=1e-12)
    monkeypatch.setattr("wrinklecli.method.shapes._POSED_AT_ONCE", 1)
    assert moved(prepared, carried, fine, times) == pytest.approx(together, abs=1e-12)


# --- Activity ---


def test_activities_of_several_tools_are_those_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = [tool(), tool(name="far", origin=[0.5, RADIUS, 0.0], target=[0.9, RADIUS, 0.0])]
    prepared = prepare(limb_asset(rings=9, sides=8, joints=4, morphs=1, morph_clip="STEP"), *tools)
    times = np.linspace(0.0, 2.0, 12)
    clip = prepared.clip
    single = [activity(patch, prepared.rig, prepared.rest, clip, times) for patch in prepared.patches]
    for at_once in (1, 2**17):
        monkeypatch.setattr("wrinklecli.method.shapes._ANCHORS_AT_ONCE", at_once)
        found = activities(prepared.patches, prepared.rig, prepared.rest, clip, times)
        for one, other in zip(found, single, strict=True):
            assert one.distances == pytest.approx(other.distances, abs=1e-12)
            assert one.amplitudes == pytest.approx(other.amplitudes, abs=1e-9)


@pytest.mark.parametrize("known", [[3], [0, 1, 5, 11], range(12)])
def test_further_activities_go_between_those_that_are_known(known: Sequence[int]) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8, joints=4), tool(), tool(name="other", strategy="origin"))
    patches, rig, rest, clip = prepared.patches, prepared.rig, prepared.rest, prepared.clip
    times = np.linspace(0.0, 2.0, 12)
    at = times[list(known)]
    some = activities(patches, rig, rest, clip, at)
    found = further_activities(patches, rig, rest, clip, times, known=some, known_at=at)
    for one, other in zip(found, activities(patches, rig, rest, clip, times), strict=True):
        for field in fields(Activity):
            assert getattr(one, field.name) == pytest.approx(getattr(other, field.name), abs=1e-9)


def test_activity_is_the_curve_s_answer_to_the_anchors() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool(max_height="2%"))
    seen = activity(prepared.patch, prepared.rig, prepared.rest, prepared.clip, np.linspace(0, 2, 9))
    assert seen.shortenings == pytest.approx(np.maximum(seen.rest_lengths * (1 - 1e-5) - seen.distances, 0))
    assert (seen.unabsorbed <= seen.shortenings).all()
    assert seen.unabsorbed[4] > 0.1
    heights = prepared.patch.curve.heights(seen.amplitudes)
    assert heights.max() == pytest.approx(0.02 * prepared.patch.span, rel=1e-6)
    weights = weights_of(prepared.patch.curve, seen.amplitudes)
    assert weights.min() == 0
    assert weights.max() == pytest.approx(1.0, abs=1e-9)


# --- Shapes and their normals ---


@pytest.mark.parametrize("strategy", ["everywhere", "origin", "both_ends"])
def test_shapes_times_weights_are_the_displacements(strategy: str) -> None:
    prepared = prepare(limb_asset(rings=15, sides=12), tool(strategy=strategy, bumps=5))
    carried, fine = carry_patch(prepared)
    times = np.linspace(0, 2, 11)
    weights = weights_of(
        prepared.patch.curve, activity(prepared.patch, prepared.rig, prepared.rest, prepared.clip, times).amplitudes
    ).reshape(11, -1)
    total = np.zeros((11, len(fine.positions), 3))
    for column, shape in enumerate(shapes_of(carried, fine, with_normals=False)):
        assert shape is not None
        assert not len(shape.normal_vertices)
        total[:, shape.vertices] += weights[:, column, None, None] * shape.deltas
    # A vertex below 1e-6 of its shape's tallest is left out of it.
    bound = 1e-6 * np.abs(total).max()
    assert np.abs(total - scattered(carried, fine, moved(prepared, carried, fine, times))).max() <= bound


def test_tallest_is_the_largest_world_displacement() -> None:
    root = {"scale": [2, 2, 2]}
    prepared = prepare(limb_asset(rings=25, sides=24, root=root), placed(root))
    carried, fine = carry_patch(prepared)
    (shape,) = shapes_of(carried, fine, with_normals=False)
    assert shape is not None
    world = np.einsum("vab,vb->va", fine.blended[shape.vertices, :, :3], shape.deltas)
    assert shape.tallest == pytest.approx(np.linalg.norm(world, axis=1).max(), rel=1e-12)
    assert shape.tallest <= prepared.patch.curve.max_height * (1 + 1e-12)


@pytest.mark.parametrize(("height", "median", "worst", "steepest"), [("5%", 0.015, 0.3, 30), ("12.5%", 0.06, 1.3, 55)])
def test_fitted_normals_follow_the_wrinkled_surface(height: str, median: float, worst: float, steepest: float) -> None:
    """Degrees between what an engine shades (base plus weighted delta, normalised) and true normals where it moves.

    Bounds are what was measured, rounded up, within those of design.md, §2: on slopes of 55–63° median 0.01–0.1°,
    99 % 0.4–2.4°. A fit to t − N, not t/(t·N) − N, has 0.24° and 3.7° in the steep case.
    """
    prepared = prepare(
        limb_asset(rings=25, sides=24), tool(max_height=height, bumps=4), refinement={"edges_per_interval": 4}
    )
    carried, fine = carry_patch(prepared)
    (shape,) = shapes_of(carried, fine, with_normals=True)
    assert shape is not None
    weights = np.array([0.25, 0.5, 0.75, 1.0])
    touched, true = displaced_normals(fine, shape.vertices, weights[:, None, None] * shape.deltas)
    deltas = np.zeros((len(fine.positions), 3))
    deltas[shape.normal_vertices] = shape.normal_deltas
    shaded = fine.normals[touched] + weights[:, None, None] * deltas[touched]
    shaded /= np.linalg.norm(shaded, axis=2, keepdims=True)
    angles = np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(shaded - true, axis=2) / 2, 0, 1)))
    # How many vertices around them hardly turn is the refinement's affair.
    moving = angles[:, np.isin(touched, shape.vertices)]
    assert np.median(moving) <= median
    assert np.quantile(moving, 0.99) <= worst
    unmoved = np.degrees(2 * np.arcsin(np.linalg.norm(fine.normals[touched] - true, axis=2) / 2))
    assert unmoved.max() > steepest, "the case is one"


def test_normals_change_on_all_faces_of_moved_vertices_and_nowhere_else() -> None:
    prepared = prepare(limb_asset(rings=15, sides=12))
    carried, fine = carry_patch(prepared)
    (shape,) = shapes_of(carried, fine, with_normals=True)
    assert shape is not None
    around = np.unique(fine.triangles[np.isin(fine.triangles, carried.vertices).any(axis=1)])
    assert np.isin(shape.normal_vertices, around).all()
    assert not np.isin(around, shape.vertices).all(), "the ring around the wrinkles turns without moving"
    assert not np.isin(shape.normal_vertices, shape.vertices).all()


def test_normals_of_undisplaced_vertices_are_the_surface_s() -> None:
    prepared = prepare(limb_asset(rings=15, sides=12))
    carried, fine = carry_patch(prepared)
    touched, normals = displaced_normals(fine, carried.vertices, np.zeros((1, len(carried.vertices), 3)))
    assert normals[0] == pytest.approx(fine.normals[touched], abs=1e-14)


unit_vectors = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)


@given(base=unit_vectors, authored=unit_vectors, vector=unit_vectors)
def test_turn_is_the_smallest_rotation_from_one_normal_to_the_other(
    base: Floats, authored: Floats, vector: Any
) -> None:
    if base @ authored < -0.999:
        assert turn_to(base[None], authored[None], vector[None])[0] == pytest.approx(-vector, abs=0)
        return
    rows = np.concatenate([np.eye(3), [base, vector]])
    turned = turn_to(np.tile(base, (5, 1)), np.tile(authored, (5, 1)), rows)
    matrix = turned[:3].T
    # Near opposite normals 1/(1 + cos) magnifies rounding a thousand times.
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-11)
    assert np.linalg.det(matrix) == pytest.approx(1, abs=1e-11)
    assert turned[3] == pytest.approx(authored, abs=1e-11)
    assert turned[4] == pytest.approx(matrix @ vector, abs=1e-11)
    # The smallest rotation turns by the angle between the normals: its trace is 1 + 2 cos.
    assert np.trace(matrix) == pytest.approx(1 + 2 * base @ authored, abs=1e-11)


def test_no_base_normal_no_turn() -> None:
    vectors = np.array([[1.0, 2.0, 3.0]])
    assert np.array_equal(turn_to(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]), vectors), vectors)


# --- Compression ---


@given(seed=st.integers(0, 999), tolerance=st.sampled_from([1e-9, 1e-3, 0.1, 1.0, 100.0]))
def test_compressed_series_meets_its_bound_with_as_few_shapes_as_its_rank(seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    rank = rng.integers(0, 4)
    series = np.einsum("fr,rvx->fvx", rng.normal(size=(7, rank)), rng.normal(size=(rank, 5, 3)))
    weights, shapes = compress([series[:3], series[3:]] if seed % 2 else [series], tolerance)
    assert len(shapes) <= rank
    assert weights.shape == (7, len(shapes))
    assert np.abs(np.einsum("fs,svx->fvx", weights, shapes) - series).max() <= tolerance + 1e-12
    assert np.abs(weights).max(initial=0) <= 1.0
    assert (weights.max(axis=0, initial=0) == 1.0).all()
    if tolerance == 1e-9 and np.linalg.matrix_rank(series.reshape(7, -1), tol=1e-6) == rank:
        assert len(shapes) == rank


def test_still_series_needs_no_shape() -> None:
    weights, shapes = compress([np.zeros((4, 3, 3))], 1e-9)
    assert weights.shape == (4, 0)
    assert shapes.shape == (0, 3, 3)
