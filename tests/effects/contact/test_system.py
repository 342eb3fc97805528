"""Folds that share vertices, or that touch in a clip, are solved together."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.bakes import report_of
from kit.creases import resolved
from kit.folds import FOLDS
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.crease import march_clip, resolve
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.sample import _systems
from wrinklecli.effects.contact.system import (
    System,
    near_each_other,
    union,
    with_crossings,
)
from wrinklecli.review.crossings import crossings


def folds_of(kind: str, folder: Path) -> tuple[tuple[Fold, ...], list[Clip]]:
    asset, tools = FOLDS[kind]().write(folder, contact="resolve")
    job = read_job(str(asset), [str(tools)], BakeOptions())
    (plan,) = plan_meshes(job)
    layer = plan.layer(ContactLayer)
    assert layer is not None
    return layer.folds, list(job.clips)


@pytest.mark.slow
@pytest.mark.long
def test_both_hips_over_one_pelvis_are_resolved_together() -> None:
    """Solved alone, each had the other in its way: pieces of belly and thighs lay apart."""
    body = FOLDS["groin"]().baked()
    data = report_of(body).data
    assert not any("contact" in line for line in data["warnings"]), data["warnings"]
    assert len(data["folds"]) == 2
    for fold in data["folds"]:
        assert fold["crossing_frames"] == 0
        assert len(fold["targets"]) <= 10
    (clip,) = crossings(body.path).data["clips"]
    assert clip["totals"][0] > clip["totals"][1] == 0


@pytest.mark.slow
@pytest.mark.long
def test_the_parts_of_folds_add_up_to_the_move_of_their_system(tmp_path: Path) -> None:
    (left, right), (clip,) = folds_of("groin", tmp_path)
    assert near_each_other(with_crossings(left, []), with_crossings(right, []))
    creases = tuple(resolved(each, most=4) for each in (left, right))
    times = np.linspace(clip.start, (clip.start + clip.end) / 2.0, 16)
    system = System(tuple(each.fold for each in creases), {0: (clip, times)})
    whole = system.kept[0] = march_clip(system.fold, clip, times)
    assert whole.touching
    first = system.part(0, [])
    nothing = np.zeros((len(times), len(creases[0].shapes)))
    rest = system.part(0, [(creases[0], nothing)])
    vertices = system.fold.free_vertices
    for frame in whole.touching:
        found, one, two = whole.solutions[frame], first.solutions[frame], rest.solutions[frame]
        total = np.zeros_like(found.moved)
        other = ~np.isin(vertices, creases[1].fold.free_vertices)
        total[np.isin(vertices, creases[0].fold.free_vertices)] = one.moved
        # With nothing fitted by the first, the second takes over all that it can move.
        total[~other] = two.moved
        assert total == pytest.approx(found.moved, abs=1e-12)
        assert not one.crosses_itself


def test_knees_that_meet_in_a_clip_are_solved_together(tmp_path: Path) -> None:
    folds, clips = folds_of("knees", tmp_path)
    ((one, two),) = _systems(folds, clips)
    assert near_each_other(one, two)
    assert one.radius == two.radius == pytest.approx((folds[0].radius + folds[1].radius) / 2.0)
    assert [len(each) for each in _systems(folds, [])] == [1, 1]
    assert _systems([], clips) == []


def test_at_most_two_folds_are_solved_together(tmp_path: Path) -> None:
    """Three copies of a fold have all vertices in common."""
    (fold, _), _ = folds_of("knees", tmp_path)
    assert [len(each) for each in _systems([fold] * 3, [])] == [2, 1]


@pytest.mark.slow
def test_a_fold_holds_what_it_meets_in_a_clip_however_far_from_the_joint(tmp_path: Path) -> None:
    """Shins that pass through each other 4.5 radii from the knees, where either fold ends."""
    (fold, _), clips = folds_of("knees", tmp_path)
    alone, whole = with_crossings(fold, []), with_crossings(fold, clips)
    assert np.array_equal(alone.vertices, fold.vertices)
    assert np.isin(fold.vertices, whole.vertices).all()
    crossed = whole.vertices[whole.crossed[: len(whole.vertices)]]
    assert np.isin(alone.vertices[alone.crossed], crossed).all()
    assert not np.isin(crossed, fold.vertices).all()
    # The other leg is in the way, and no part of this fold.
    own = whole.fine.rest_positions[whole.vertices[whole.own], 2] > 0
    assert own.all() or not own.any()


@pytest.mark.slow
def test_a_fold_is_solved_without_what_contact_may_not_move(tmp_path: Path) -> None:
    (fold, _), clips = folds_of("knees", tmp_path)
    whole = with_crossings(fold, clips)
    solved, counted = whole.solved_part, whole.counted_part
    assert solved.near[solved.triangles].any(axis=1).all()
    assert (counted.near | counted.raised)[counted.triangles].any(axis=1).all()
    for part in (solved, counted):
        assert np.array_equal(part.free_vertices, whole.free_vertices)
    # Its tool moves vertices that contact does not, and these count.
    raised = whole.vertices[whole.raised[: len(whole.vertices)]]
    assert np.isin(raised, counted.vertices).all()


@pytest.mark.slow
def test_a_fold_that_only_a_clip_closes_has_shapes_of_the_clip_alone(
    tmp_path: Path,
) -> None:
    ((fold,), clips) = folds_of("low_poly", tmp_path)
    assert not with_crossings(fold, []).crosses
    crease = resolved(fold, most=4, clips=clips)
    assert not len(crease.shapes)
    solved = march_clip(crease.fold, clips[0], np.linspace(clips[0].start, clips[0].end, 31))
    assert crease.follow(solved).crossing
    wider = resolve(crease.fold, [*solved.poses(solved.touching, 31)], [], most=4)
    assert not wider.follow(solved).crossing


@pytest.mark.slow
def test_a_union_has_each_triangle_of_its_folds_once(tmp_path: Path) -> None:
    folds, _ = folds_of("groin", tmp_path)
    whole = union(folds)
    corners = [np.sort(each.vertices[each.triangles], axis=1) for each in (whole, *folds)]
    assert len(np.unique(corners[0], axis=0)) == len(corners[0])
    assert np.array_equal(np.unique(corners[0], axis=0), np.unique(np.concatenate(corners[1:]), axis=0))
    assert np.array_equal(union(folds[:1]).vertices, folds[0].vertices)
