"""Displacements as high as they should be in world space, along normals, of the right vertices alone."""

from typing import Any

import numpy as np
import pytest

from kit.carried import MORE, ROOTS, carry_patch, moved, placed, scattered
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.effects.wrinkle.activity import activity
from wrinklecli.effects.wrinkle.carry import carry
from wrinklecli.effects.wrinkle.curve import plan_curve
from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import unit
from wrinklecli.surface.refine import Refinement


def mixed_normals(fine: Refinement) -> Any:
    """(fine vertices, 3) normals at rest, mixed from those of the coarse vertices."""
    coarse = fine.rest.normals_at(np.arange(len(fine.surface.positions)))
    return unit(fine.subdivision.interpolate(coarse))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("root", "strategy", "strength"),
    # Each root with each strategy, and each strategy with both strengths.
    [
        (root, strategy, (1.0, -0.5)[(row + column) % 2])
        for row, strategy in enumerate(["everywhere", "origin", "both_ends"])
        for column, root in enumerate(ROOTS)
    ],
    ids=str,
)
def test_displacement_at_rest_has_the_intended_height_along_the_world_normal(
    root: Any, strategy: Any, strength: float
) -> None:
    ruled = {"attenuation": "linear", "bumps": 3, "gap": 1, "variation": 0}
    asked = placed(root, rest_length=MORE, strategy=strategy, strength=strength, **ruled)
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
    facing = np.clip((mixed_normals(fine)[carried.vertices] @ patch.normal - 0.2) / 0.4, 0, 1)
    signed = strength * heights * (1 - np.abs(v)) * facing**2 * (3 - 2 * facing)
    wanted = signed[:, None] * fine.rest_normals[carried.vertices]
    assert np.abs(signed).max() > 0.01 * span, "the case is one"
    assert world == pytest.approx(wanted, abs=1e-7 * span)  # weights in tables have seven decimals


@pytest.mark.quick(1)
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


@pytest.mark.quick(1)
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
    prepared = prepare(limb_asset(rings=15, sides=12), tool(rest_length=MORE, variation=0))
    carried, fine = carry_patch(prepared)
    u, v = prepared.patch.coordinates(fine.rest_positions)
    on_patch = (u >= 0) & (u <= 1) & (np.abs(v) <= 1) & (mixed_normals(fine) @ prepared.patch.normal > 0.2)
    assert on_patch[carried.vertices].all()
    # All that lie well inside do: near its edges the attenuation falls below what can be seen.
    inner = (u >= 0) & (u <= 1) & (np.abs(v) <= 0.99) & (mixed_normals(fine) @ prepared.patch.normal > 0.25)
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
    member = np.unique(fine.triangles[np.isin(fine.subdivision.parents, prepared.patch.members)])
    stuck = [m for m in member if singular[m] and 0 < u[m] < 1 and abs(v[m]) < 1]
    assert stuck, "the case is one"
    assert not np.isin(stuck, carried.vertices).any()
    assert carried.stuck == len(stuck)


def test_tools_that_overlap_add_up() -> None:
    """Two of half the strength are one of the whole."""
    asset = limb_asset(rings=15, sides=12)
    whole = prepare(asset, tool(rest_length=MORE, seed=1))
    halves = prepare(asset, *(tool(name=name, rest_length=MORE, strength=0.5, seed=1) for name in ("a", "b")))
    fine = halves.refined()
    assert np.array_equal(fine.positions, whole.refined().positions)
    none = np.zeros(len(whole.surface.positions), bool)
    one = carry(whole.patch, fine, none)
    total = sum(
        scattered(each, fine, moved(halves, each, fine, [0.0, 1.0]))
        for each in (carry(patch, fine, none) for patch in halves.patches)
    )
    assert total == pytest.approx(scattered(one, fine, moved(whole, one, fine, [0.0, 1.0])), abs=1e-15)


@pytest.mark.quick(1)
@pytest.mark.parametrize("strength", [1.0, 2.0, 0.0])
def test_strength_in_a_clip_takes_the_place_of_the_tool_s(strength: float) -> None:
    asset = limb_asset(rings=9, sides=8)
    plain = prepare(asset, tool(strength=0.25))
    other = prepare(asset, tool(strength=strength, clips={"fold": 0.25}))
    results = [moved(each, *carry_patch(each), [0.5, 1.0]) for each in (plain, other)]
    assert results[1] == pytest.approx(results[0], abs=1e-15)


@pytest.mark.parametrize("strategy", ["everywhere", "origin"])
@pytest.mark.parametrize("strength", [1.0, -0.5])
def test_a_tool_is_as_tall_as_its_highest_vertex(strategy: str, strength: float) -> None:
    """Factors on the height, as of features and folds, count: a tool that keeps half of its height is half as tall."""
    prepared = prepare(limb_asset(rings=15, sides=12), tool(strategy=strategy, bumps=4, clips={"fold": strength}))
    carried, fine = carry_patch(prepared)
    times = np.linspace(0.0, 2.0, 21)
    moves = np.linalg.norm(moved(prepared, carried, fine, times), axis=2)
    seen = activity(prepared.patch, prepared.rig, prepared.clip, times)
    assert moves.max() > 0.01
    assert carried.tallest(seen.amplitudes, prepared.clip) == pytest.approx(moves.max(), rel=1e-9)
    lowered = carried.times(np.full(len(carried.vertices), 0.5))
    assert lowered.tallest(seen.amplitudes, prepared.clip) == pytest.approx(moves.max() / 2.0, rel=1e-9)
