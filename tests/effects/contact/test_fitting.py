"""The fewest shapes of solved poses, tested with points before a wall, for which every answer is known."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wrinklecli.effects.contact import fitting
from wrinklecli.effects.contact.fitting import MOST_WEIGHT, combined, fit_pose, fit_poses
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.reduction import project, weighted_basis

POINTS, POSES = 12, 9


@dataclass(frozen=True)
class Wall:
    """A pose of points in a row, each of which may go a gap further along x than it was moved, and no more."""

    moved: np.ndarray
    gaps: np.ndarray
    crosses_itself = False

    @property
    def error_weights(self) -> np.ndarray:
        return np.ones(POINTS)

    @property
    def greatest_move(self) -> float:
        return float(np.linalg.norm(self.moved, axis=1).max())

    def errors(self, moved: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(moved - self.moved, axis=1))

    def with_neighbours(self, marked: np.ndarray) -> np.ndarray:
        return np.convolve(marked, [1, 1, 1], "same") > 0

    def crossing(self, moved: np.ndarray) -> np.ndarray:
        return np.asarray(moved[:, 0] > self.moved[:, 0] + self.gaps)

    def volume_change(self, moved: np.ndarray) -> float:
        return float(moved[:, 2].sum())

    @property
    def held_volume(self) -> tuple[np.ndarray, float]:
        return np.tile([0.0, 0.0, 1.0], (POINTS, 1)), 0.0

    def opened(self, moved: np.ndarray) -> np.ndarray:
        further = np.minimum(moved - self.moved, 0.0) * [1.0, 0.0, 0.0]
        return self.moved + np.where(np.isfinite(self.gaps)[:, None], further, 0.0)


def walls(rank: int, *, noise: float = 0.0, touching: int = POINTS, gap: float = 1e-3) -> list[Any]:
    """Poses that are sums of `rank` fields, but for some noise; the first points touch the wall."""
    random = np.random.default_rng(rank)
    fields = random.normal(size=(rank, POINTS, 3)) * [1.0, 1.0, 0.0]
    sizes = random.uniform(-1.0, 1.0, (POSES, rank)) * np.linspace(0.1, 1.0, POSES)[:, None]
    moved = np.tensordot(sizes, fields, axes=1)
    moved[..., :2] += noise * random.uniform(-1.0, 1.0, (POSES, POINTS, 2))
    gaps = np.where(np.arange(POINTS) < touching, gap, np.inf)
    return [Wall(each, gaps) for each in moved]


def made(weights: np.ndarray, shapes: np.ndarray) -> list[np.ndarray]:
    return [combined(row, shapes) for row in weights]


def crossing_count(solved: list[Any], weights: np.ndarray, shapes: np.ndarray) -> int:
    return sum(bool(each.crossing(moved).any()) for each, moved in zip(solved, made(weights, shapes), strict=True))


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_shapes_are_as_many_as_the_poses_are_made_of(rank: int) -> None:
    solved = walls(rank)
    weights, shapes, crossing = fit_poses(solved, share=0.1, most=8)
    assert (len(shapes), crossing) == (rank, 0)
    assert np.abs(weights).max(axis=0) == pytest.approx(1.0)
    assert max(each.errors(moved).max() for each, moved in zip(solved, made(weights, shapes), strict=True)) < 1e-3


def test_few_numbers_of_shapes_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = list[int]()

    def recorded(fields: Floats, importance: Floats, count: int) -> tuple[Floats, Floats]:
        tried.append(count)
        return weighted_basis(fields, importance, count)

    monkeypatch.setattr(fitting, "weighted_basis", recorded)
    weights, shapes, crossings = fit_poses(walls(6), share=0.35, most=7)
    assert (len(shapes), crossings, crossing_count(walls(6), weights, shapes)) == (6, 0, 0)
    assert len(set(tried)) <= 3


@pytest.mark.parametrize(("touching", "count"), [(0, 2), (POINTS, None)])
def test_noise_costs_shapes_only_where_something_touches(touching: int, count: int | None) -> None:
    solved = walls(2, noise=0.1, touching=touching)
    weights, shapes, crossing = fit_poses(solved, share=0.2, most=POSES)
    assert crossing == crossing_count(solved, weights, shapes) == 0
    longest = max(each.greatest_move for each in solved)
    assert (
        max(each.errors(moved).max() for each, moved in zip(solved, made(weights, shapes), strict=True)) < 0.2 * longest
    )
    assert len(shapes) == count if count else len(shapes) > 2


@pytest.mark.parametrize("most", [1, 2, 3])
def test_too_few_shapes_leave_as_many_crossings_as_they_say(most: int) -> None:
    solved = walls(5, touching=4, gap=0.01)
    weights, shapes, crossing = fit_poses(solved, share=0.3, most=most)
    assert len(shapes) == most
    assert 0 < crossing == crossing_count(solved, weights, shapes) < POSES


def test_weights_of_a_pose_are_those_that_made_it_within_their_limits() -> None:
    """Its shapes change no volume, as what a pose changes itself is not followed."""
    (found, *_), shapes = walls(3), np.random.default_rng(1).normal(size=(3, POINTS, 3)) * [1.0, 1.0, 0.0]
    wanted = np.array([0.7, -0.2, 1.4])
    weights, crosses = fit_pose(Wall(combined(wanted, shapes), found.gaps), shapes)  # type: ignore[arg-type]
    assert weights == pytest.approx(wanted, abs=1e-6)
    assert not crosses
    beyond = Wall(combined(2.0 * wanted, shapes), np.full(POINTS, np.inf))
    assert fit_pose(beyond, shapes)[0] == pytest.approx(np.clip(2.0 * wanted, -MOST_WEIGHT, MOST_WEIGHT), abs=1e-6)  # type: ignore[arg-type]


def test_errors_count_more_where_a_pose_crosses() -> None:
    """One shape cannot follow two points: it gives way at the one that would cross."""
    moved = np.zeros((POINTS, 3))
    moved[:2, 0] = (1.0, 2.0)
    shapes = np.zeros((1, POINTS, 3))
    shapes[0, :2, 0] = 1.0
    gaps = np.full(POINTS, np.inf)
    weights, crosses = fit_pose(Wall(moved, gaps), shapes)  # type: ignore[arg-type]
    assert weights == pytest.approx([1.5])
    assert not crosses
    gaps[0] = 0.1
    weights, crosses = fit_pose(Wall(moved, gaps), shapes)  # type: ignore[arg-type]
    assert weights[0] <= 1.1
    assert not crosses
    gaps[0] = -1.0
    assert fit_pose(Wall(moved, gaps), shapes)[1]  # type: ignore[arg-type]


def test_a_pose_keeps_its_volume_where_its_shapes_do_not_span_it() -> None:
    """The first shape is nearer to the pose, and takes volume away, which the other gives back."""
    (found,) = walls(1)[-1:]
    wanted = found.moved
    swelling = np.tile([0.0, 0.0, 0.01], (POINTS, 1))
    shapes = np.stack([wanted - 2.0 * swelling, 2.0 * swelling])
    weights, _ = fit_pose(found, shapes)
    assert abs(found.volume_change(combined(weights, shapes))) < 0.01
    shares = found.error_weights[None]
    (nearest,) = project(wanted[None], shares, shapes[:1])
    gradient, product = found.held_volume
    (kept,) = project(wanted[None], shares, shapes[:1], (gradient[None] / 0.0025, np.array([product])))
    assert abs(found.volume_change(kept * shapes[0])) < abs(found.volume_change(nearest * shapes[0]))


def test_no_bulge_stands_for_volume_that_a_solution_loses_everywhere() -> None:
    """The hips of a running woman bulged by 5.7 mm where the solution moved nothing by more than 0.2 mm."""
    found = Wall(np.tile([0.0, 0.0, -0.02], (POINTS, 1)), np.full(POINTS, np.inf))
    shapes = np.zeros((1, POINTS, 3))
    shapes[0, 0, 2] = 1.0
    (weight,), _ = fit_pose(found, shapes)  # type: ignore[arg-type]
    assert abs(weight) < 0.02
