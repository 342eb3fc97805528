"""Fields on the refined surface: under tools, beside each other, in poses."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from kit.asset import Json, attribute
from kit.garments import job_of, planned, tube, with_attribute
from kit.limb import RADIUS, tool
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.faults import count_turned_over
from wrinklecli.effects.field import carry
from wrinklecli.effects.field.factors import UNSEEN
from wrinklecli.effects.field.layer import FieldLayer
from wrinklecli.effects.field.material import FABRICS
from wrinklecli.effects.plan import skin_parts
from wrinklecli.numeric.arrays import Floats, face_normals
from wrinklecli.numeric.edges import Edges
from wrinklecli.surface import refine
from wrinklecli.surface.refine import Refinement

# Along the inner side of the bend.
ENDS = {"origin": [-0.15, RADIUS, 0.0], "target": [0.15, RADIUS, 0.0]}


@cache
def _planned(text: str, levels: int, angle: float) -> MeshPlan:
    read = json.loads(text)
    return planned(tube(angle=angle), *read.pop("fields"), levels=levels, **read)


def plan_of(*fields: Json, levels: int = 1, angle: float = 90.0, **top: Json) -> MeshPlan:
    return _planned(json.dumps({"fields": list(fields) or [{"name": "folds"}], **top}), levels, angle)


def layer_of(plan: MeshPlan) -> FieldLayer:
    (found,) = (each for each in plan.layers if isinstance(each, FieldLayer))
    return found


def sizes(deltas: Floats) -> Floats:
    """(vertices,) the greatest move by any shape."""
    return np.asarray(np.linalg.norm(deltas, axis=2).max(axis=0))


def test_displacements_are_along_normals_and_no_higher_than_said() -> None:
    """The tallest bump of a variation may stand out; nothing is a spike."""
    plan = plan_of({"name": "folds", "variation": 0})
    (deltas,) = layer_of(plan).deltas
    (field,) = layer_of(plan).attached
    assert 0.3 * field.greatest_height < sizes(deltas).max() <= 1.05 * field.greatest_height
    moved = sizes(deltas) > 0.05 * sizes(deltas).max()
    ways = deltas[np.argmax(np.linalg.norm(deltas, axis=2), axis=0), np.arange(len(moved))][moved]
    radial = plan.fine.rest_positions[moved] * [0.0, 1.0, 1.0]
    cosines = np.sum(ways * radial, axis=1) / np.linalg.norm(ways, axis=1) / np.linalg.norm(radial, axis=1)
    assert np.abs(cosines).min() > 0.9


@pytest.mark.slow
def test_folds_rise_more_than_they_sink() -> None:
    plan = plan_of()
    (deltas,) = layer_of(plan).deltas
    radial = plan.fine.rest_positions * [0.0, 1.0, 1.0]
    heights = np.sum(deltas[0] * radial, axis=1) / np.linalg.norm(radial, axis=1)
    assert heights.max() > 1.5 * -heights.min() > 0


def test_nothing_moves_where_no_shape_has_a_height() -> None:
    plan = plan_of()
    (deltas,) = layer_of(plan).deltas
    (field,) = layer_of(plan).attached
    heights = plan.fine.subdivision.interpolate(field.factors.shapes.T).max(axis=1)
    far = heights < UNSEEN / 2.0 * heights.max()
    assert far.any()
    # Heights are averaged over a part of a wave.
    assert sizes(deltas)[far].max() < 2e-3 * sizes(deltas).max()


@pytest.mark.parametrize("fabric", FABRICS.values(), ids=list(FABRICS))
def test_waves_are_level_with_their_mean_where_they_fork(fabric: object) -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 33)
    round_ = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    made = [carry._height(fabric, length * round_) for length in (0.0, 0.01, 0.2, 0.6, 1.0)]
    assert made[0] == pytest.approx(fabric.mean)
    spreads = [float(np.ptp(each)) for each in made]
    assert spreads == sorted(spreads)
    assert spreads[1] < 0.1 * spreads[-1]
    assert made[-1] == pytest.approx(fabric.wave(np.cos(angles)))


def test_a_field_is_level_where_its_lines_turn_at_once() -> None:
    """No direction is right there, as at a fork."""
    plan = plan_of({"name": "folds", "variation": 0})
    (field,) = layer_of(plan).attached
    free = np.ones(len(plan.fine.positions))
    moved = []
    for line in ([-1.0, 0, 0, 0, 0, 0], [-1.0, -1.0, -1.0, 0, 0, 0]):
        region = replace(field.region, directions=np.tile(line, (len(field.region.directions), 1)))
        found = carry.displaced(replace(field, region=region), plan.fine, free)
        radial = plan.fine.rest_positions * [0.0, 1.0, 1.0]
        moved.append(np.sum(found.deltas[0] * radial, axis=1) / np.linalg.norm(radial, axis=1))
    waves, level = moved
    assert waves.min() < -0.1 * waves.max()
    assert level.min() >= -1e-9
    assert 0.0 < level.max() < 0.9 * waves.max()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"angle": 120.0}, {"angle": 110.0, "joints": 3}], ids=["one", "two"])
def test_a_field_turns_no_triangle_over_that_the_skin_does_not(options: Json) -> None:
    """Between the poses of a sweep neither, nor beside the field."""
    job = job_of(tube(**options))
    (plan,) = plan_meshes(job)
    (part,), (clip,) = skin_parts(plan), job.clips
    times = np.linspace(clip.start, clip.end, 13).tolist()
    assert sum(count_turned_over(part, plan.fine, plan.rig, clip, time) for time in times) == 0
    moves = np.zeros((len(times), len(plan.fine.positions), 3))
    moves[:, part.vertices] = part.displacements(plan.fine, plan.rig, clip, np.array(times))
    mesh = plan.fine.skinned(plan.rig, np.arange(moves.shape[1]))
    for skinned, folded in zip(
        *(mesh.carried(clip, np.array(times), each)[0] for each in (0 * moves, moves)), strict=True
    ):
        faces = (face_normals(each, plan.fine.triangles) for each in (skinned, folded))
        assert (np.einsum("tx,tx->t", *faces) >= 0.0).all()
    assert part.sizes(plan.fine).max() > 0.3 * part.attached.greatest_height


@pytest.mark.slow
def test_a_field_fades_under_a_tool() -> None:
    """A tool is by hand; the skin of so slight a bend does not pass through itself, where folds are lowered."""
    plan = plan_of({"name": "folds"}, angle=60.0, tools=[tool(name="hand", bumps=2, **ENDS)])
    alone = layer_of(plan_of(angle=60.0))
    (deltas,) = layer_of(plan).deltas
    (part,) = (each for each in plan.parts if each.attached.moves is None and each.attached.tool.name == "hand")
    left = 1.0 - part.shares
    assert left.min() < 1e-6
    # Where a half of the tool is left of its height, at most a half of the field's; two families rise a little beyond.
    bent = sizes(deltas.sum(axis=0, keepdims=True))  # as the end of the bend plays it
    assert (bent[part.vertices] <= 1.1 * left * alone.attached[0].greatest_height).all()
    beside = np.setdiff1d(np.arange(deltas.shape[1]), part.vertices)
    assert bent[beside].max() == bent.max()
    assert alone.attached[0].greatest_height == layer_of(plan).attached[0].greatest_height


@pytest.mark.slow
def test_a_second_field_takes_what_the_first_leaves() -> None:
    plan = plan_of({"name": "first"}, {"name": "second", "seed": 5}, levels=0)
    one, other = layer_of(plan).deltas
    tallest = sizes(one) > 0.9 * sizes(one).max()
    assert sizes(other)[tallest].max() < 0.5 * sizes(one).max()
    # What the first is, does not depend on the second.
    assert sizes(other).max() < sizes(one).max()


@pytest.mark.slow
def test_two_fields_with_masks_lie_beside_each_other() -> None:
    asset = tube()
    side = attribute(asset, 0, "POSITION")[:, 2]
    with_attribute(asset, "_LEFT", (side > 1e-6).astype(float))
    with_attribute(asset, "_RIGHT", (side < -1e-6).astype(float))
    plan = planned(asset, *({"name": name[1:], "mask": {"attribute": name}} for name in ("_LEFT", "_RIGHT")), levels=0)
    one, other = layer_of(plan).deltas
    at = plan.fine.rest_positions[:, 2]
    assert sizes(one)[at > 1e-6].max() > 0.3 * sizes(one).max()
    assert not sizes(one)[at < -1e-6].any()
    assert sizes(other)[at < -1e-6].max() > 0.3 * sizes(other).max()
    assert not sizes(other)[at > 1e-6].any()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_folds() -> None:
    """The name is the seed by default."""
    by_name, seeded, again = (
        layer_of(plan_of(each, levels=0)).deltas[0].tobytes()
        for each in ({"name": "folds"}, {"name": "folds", "seed": 3}, {"name": "others", "seed": 3})
    )
    assert seeded == again
    assert seeded != by_name


def test_a_strength_is_a_factor_of_weights_and_no_shape() -> None:
    plain, strong = plan_of(), plan_of({"name": "folds", "strength": 1.5, "clips": {"fold": 0.25}})
    assert layer_of(plain).deltas[0].tobytes() == layer_of(strong).deltas[0].tobytes()
    clip = job_of(tube()).clips[0]
    other = replace(clip, name="other")
    for each, factor in ((clip, 0.25), (other, 1.5)):
        weights = [
            layer_of(plan).attached[0].drive.weights_in(plan.rig, each)(np.array([0.0, 0.5, 1.0]))
            for plan in (plain, strong)
        ]
        assert weights[0].max() > 0.9
        assert weights[1] == pytest.approx(factor * weights[0])
        assert not weights[0][0].any()


@pytest.mark.parametrize("options", [{}, {"primitives": 2}, {"seam": False}], ids=str)
def test_a_mesh_has_no_vertex_that_no_edge_of_a_field_needs(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The vertices that stay keep their rows of the matrix and their corners at seams, and no gap opens."""
    keys = {"refinement": {"scheme": "midpoint"}, "fields": [{"name": "folds", "wavelength": 0.1}]}
    fine = planned(tube(**options), levels=3, **keys).fine
    monkeypatch.setattr(refine, "collapse_edges", lambda triangles, *_: (triangles, np.arange(len(triangles))))
    every = planned(tube(**options), levels=3, **keys).fine
    assert len(fine.positions) < 0.8 * len(every.positions)
    assert {each.tobytes() for each in fine.positions} < {each.tobytes() for each in every.positions}
    assert fine.subdivision.interpolate(fine.surface.positions) == pytest.approx(fine.positions, abs=1e-15)
    old = len(fine.surface.weld)
    mixed = np.einsum("vk,vkc->vc", fine.shares, fine.positions[fine.weld][fine.sources])
    assert mixed == pytest.approx(fine.positions[fine.weld[old:]], abs=1e-15)
    assert np.array_equal(fine.weld[fine.corners], fine.triangles)
    assert np.array_equal(np.unique(fine.corners), np.arange(len(fine.weld)))
    borders = [positions_at_borders(each) for each in (fine, every)]
    assert np.array_equal(*borders)
    assert (
        fine.weights_pruned.shape[0]
        == fine.weights.dense().shape[1]
        == len(fine.positions) - len(fine.surface.positions)
    )


def positions_at_borders(fine: Refinement) -> Floats:
    """(edges, 2, 3) the edges of one face, in an order of their own; there are none of more than two."""
    edges = Edges.of(fine.triangles)
    assert edges.counts.max() <= 2
    found = fine.positions[edges.vertices[edges.counts == 1]]
    found = np.stack([each[np.lexsort(each.T)] for each in found])
    return np.asarray(found[np.lexsort(found.reshape(-1, 6).T)])
