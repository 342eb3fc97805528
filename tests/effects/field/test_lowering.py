"""Fields are lowered where they would cross more than the skin does."""

from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from kit.garments import job_of
from kit.limb import limb_asset
from wrinklecli.baking.job import Job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.field import carry, lowering
from wrinklecli.effects.field.layer import FieldLayer
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.intersections import Crossings, edges_of


@cache
def planned(contact: str, angle: float, levels: int = 0) -> tuple[Job, MeshPlan]:
    """A tube that folds onto itself, with a field."""
    job = job_of(
        limb_asset(angle=angle, rings=16, sides=10),
        {"name": "folds", "contact": contact, "wavelength": "9%"},
        levels=levels,
    )
    (plan,) = plan_meshes(job)
    return job, plan


def deltas_of(plan: MeshPlan) -> Floats:
    """The shapes with their creases, as each joint's end of the bend plays them."""
    layer = plan.layer(FieldLayer)
    assert layer is not None
    folds = np.cumsum(~layer.attached[0].factors.creases) - 1
    return np.stack([layer.deltas[0][folds == number].sum(axis=0) for number in range(folds[-1] + 1)])


def without(module: ModuleType, name: str, stand_in: Callable[..., Any], angle: float, levels: int = 0) -> MeshPlan:
    """The tube with contact, with a part of the program replaced."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, name, stand_in)
        _, plan = planned.__wrapped__("resolve", angle, levels)
    return plan


@cache
def free(angle: float, levels: int = 0) -> MeshPlan:
    """It as if nothing crossed."""
    return without(lowering, "_crossing", lambda *_given: [], angle, levels)


@cache
def unlowered(angle: float = 80.0) -> MeshPlan:
    """It as if nothing were at fault."""
    return without(carry, "lowering", lambda *given: given[-2], angle)


def crossing(job: Job, plan: MeshPlan, part: float) -> Ints:
    """(frames,) edges through triangles in the clip, with the field at a part of its height."""
    fine, layer, (clip,) = plan.fine, plan.layer(FieldLayer), job.clips
    assert layer is not None
    times = np.linspace(clip.start, clip.end, 13)
    moves = np.zeros((len(times), len(fine.positions), 3))
    (field,) = layer.parts
    moves[:, field.vertices] = part * field.displacements(fine, plan.rig, clip, times)
    # What a crease takes back as a whole is level but for rounding, which decides where the tube's two sides touch.
    moves[np.abs(moves) < 1e-12] = 0.0
    surface = Crossings.of(fine.rest_positions, fine.triangles)
    posed, _ = fine.skinned(plan.rig).carried(clip, times, moves)
    return np.array([len(surface.pairs_at(each)) for each in posed])


@pytest.mark.slow
@pytest.mark.parametrize("contact", ["off", "resolve"])
@pytest.mark.parametrize("levels", [0, 1])
def test_a_field_never_crosses_more_than_the_skin(levels: int, contact: str) -> None:
    """Without contact it is looked at in fewer poses, which are enough for a clip that bends one joint."""
    job, held = planned(contact, 85.0, levels)
    skin = crossing(job, free(85.0, levels), 0.0)
    assert skin.max() > 0
    assert crossing(job, free(85.0, levels), 1.0).sum() > skin.sum()
    assert (crossing(job, held, 1.0) <= skin).all()


def test_what_crosses_in_one_place_is_not_made_up_for_by_another() -> None:
    """An edge passes through the first triangle in the skin alone, and another through the second with the field."""
    triangle, edge = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0.2, 0.2, -1.0], [0.2, 0.2, 1.0]]
    skin = np.array([*edge, *triangle, *edge, *triangle]).T
    ways = np.zeros((3, 10))
    # The field lifts the first edge off its triangle, and lets the second through.
    ways[2, :2], ways[2, 5:7], skin[2, 5:7] = 2.0, -2.0, skin[2, 5:7] + 2.0
    look = lowering._crossed(0, np.arange(10), skin, ways, np.arange(10).reshape(2, 5))
    assert look.faults(np.ones(10)).tolist() == [5, 6, 7, 8, 9]
    assert not len(look.faults(np.zeros(10)))


def test_contact_lowers_what_crosses_alone() -> None:
    one, other = deltas_of(free(74.0)), deltas_of(planned("resolve", 74.0)[1])
    sizes, lower, whole = (np.linalg.norm(each, axis=2) for each in (one, other, deltas_of(unlowered(74.0))))
    assert (lower <= whole + 1e-12).all()
    # What contact lowers may leave a triangle beside it without a fault, which is higher then than before.
    assert (lower > sizes + 1e-12).mean() < 0.01
    assert (lower.max(axis=0) < 0.5 * sizes.max(axis=0)).any()
    # They point the same way.
    assert np.sum(one * other, axis=2) == pytest.approx(sizes * lower, abs=1e-12)
    # The outer half of the bend never meets anything.
    outer = free(74.0).fine.rest_positions[:, 1] < 0.0
    assert sizes[:, outer].any()
    assert (lower[:, outer] > sizes[:, outer] - 1e-3 * sizes.max()).all()


def test_contact_leaves_what_half_of_the_bend_folds() -> None:
    """Nothing crosses in the near half, so its shape keeps its height; at the end the crease takes back a part."""
    plans = free(85.0), planned("resolve", 85.0)[1]
    near, held_near = (np.linalg.norm(plan.parts[0].deltas[0]) for plan in plans)
    assert held_near == pytest.approx(near, rel=1e-3)
    whole, held = (np.linalg.norm(deltas_of(plan)) for plan in plans)
    assert 0.5 * whole < held < whole


def test_what_is_lowered_rises_again_over_a_wavelength_along_crests_and_half_of_one_across() -> None:
    """Folds that end within less look torn, and one that stays beside one that is lowered is seen."""
    _, held = planned("resolve", 80.0)
    whole = unlowered()
    raised, lower = (np.linalg.norm(deltas_of(plan), axis=2) for plan in (whole, held))
    layer, fine = held.layer(FieldLayer), held.fine
    assert layer is not None
    ends = edges_of(fine.triangles)
    ways = np.abs(fine.rest_positions[ends[:, 0]] - fine.rest_positions[ends[:, 1]])
    steepest = 0.0
    for before, after in zip(raised, lower, strict=True):
        own = (before[ends] > 1e-3 * before.max()).all(axis=1)
        factors = after[ends[own]] / before[ends[own]]
        rises = np.abs(factors[:, 0] - factors[:, 1]) * layer.attached[0].wavelength
        # The tube is compressed along x.
        lengths = np.hypot(2.0 * ways[own, 0], np.hypot(*ways[own, 1:].T))
        assert (rises <= 1.02 * lengths).all()
        steepest = max(steepest, float((rises / np.linalg.norm(ways[own], axis=1)).max()))
    assert steepest > 1.05
    assert lower.sum() < 0.9 * raised.sum()


@pytest.mark.slow
def test_contact_changes_nothing_where_nothing_crosses() -> None:
    before, after = deltas_of(free(30.0)), deltas_of(planned("resolve", 30.0)[1])
    assert np.array_equal(before, after)


def test_poses_of_clips_are_looked_at_before_those_of_sweeps() -> None:
    looked = list[Floats]()

    def poses(*given: Any) -> tuple[Floats, ...]:
        found = chosen(*given)
        looked.append(found[1])
        return found

    chosen = lowering._poses
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lowering, "_POSES", 5)
        patch.setattr(lowering, "_poses", poses)
        job, plan = planned.__wrapped__("off", 80.0)
    (clip,), layer = job.clips, plan.layer(FieldLayer)
    assert layer is not None
    (field,) = layer.parts
    shown = field.drive.weights_in(plan.rig, clip)(np.linspace(clip.start, clip.end, 25))
    (weights,) = looked
    assert len(weights) == 5
    assert np.abs(weights[:, None] - shown).max(axis=2).min(axis=1) == pytest.approx(0.0, abs=1e-9)


def test_without_contact_all_of_a_clip_is_looked_at_and_each_shape_where_it_acts_most() -> None:
    """Other joints stand otherwise in a clip, so what crosses there may not in a sweep."""
    seen = dict[str, tuple[Any, ...]]()

    def poses(*given: Any) -> tuple[Floats, ...]:
        seen["poses"] = chosen(*given)
        return seen["poses"]

    def looks(*given: Any) -> list[Any]:
        seen["given"] = given
        return []

    chosen = lowering._poses
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lowering, "_poses", poses)
        patch.setattr(lowering, "_crossing", looks)
        planned.__wrapped__("off", 80.0)
    (_, weights, of_clips), (*_, counting) = seen["poses"], seen["given"]
    looked = counting.any(axis=1)
    assert looked[of_clips].all()
    assert looked[weights.argmax(axis=0)].all()
