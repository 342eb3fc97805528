"""Searches by the cells of a grid find everything that is near, and leave out most of what is not."""

import numpy as np
import pytest

from wrinklecli.numeric.arrays import components
from wrinklecli.numeric.cells import Cells, leaders


@pytest.mark.parametrize("count", [1, 2, 31, 700])
@pytest.mark.parametrize("flat", [0, 1, 3])
def test_every_point_of_a_ball_is_in_a_cell_that_it_reaches(count: int, flat: int) -> None:
    random = np.random.default_rng(count + flat)
    points, middles = random.normal(size=(count, 3)), random.normal(size=(40, 3))
    points[:, :flat] = 0.25
    radii = random.uniform(0.0, 1.5, 40)
    cells = Cells.of(points)
    assert sorted(cells.numbers_in(np.arange(len(cells.starts))).tolist()) == list(range(count))
    balls, reached = cells.meeting(middles, radii)
    found = set(zip(np.repeat(balls, cells.counts[reached]).tolist(), cells.numbers_in(reached).tolist(), strict=True))
    near = np.argwhere(np.linalg.norm(points - middles[:, None], axis=2) <= radii[:, None])
    assert {(ball, point) for ball, point in near.tolist()} <= found
    if count > 600 and not flat:
        assert len(found) < 0.5 * 40 * count, "most pairs are not looked at"


@pytest.mark.parametrize("scale", [0.0, 1e-3, 1.0, 30.0, 1000.0])
def test_groups_are_what_chains_of_near_points_connect(scale: float) -> None:
    """Against all pairs; several points of a cell, which may be twice as far apart, are not among them."""
    random = np.random.default_rng(int(scale))
    points = scale * random.uniform(0, 1, (300, 3)) ** [1, 2, 3]
    points[100:200] = points[:100]
    points[200:] = points[:100] + random.choice([0.0, 0.9, 1.1, 3.0], (100, 3))
    near = np.argwhere((np.abs(points - points[:, None]) <= 1.0).all(axis=2))
    if scale > 1.0:  # below, all are in a few cells
        wanted = components(near, len(points))
        found = leaders(points, 1.0)
        firsts = {int(group): int(np.flatnonzero(wanted == group)[0]) for group in wanted}
        assert found.tolist() == [firsts[int(group)] for group in wanted]
    order = random.permutation(len(points))
    one, other = leaders(points, 1.0), leaders(points[order], 1.0)
    assert (
        len({*one.tolist()}) == len({*other.tolist()}) == len({*zip(one[order].tolist(), other.tolist(), strict=True)})
    )


def test_long_chains_are_one_group() -> None:
    points = 0.9 * np.arange(5000)[:, None] * [1.0, 0.0, -1.0]
    assert (leaders(points, 1.0) == 0).all()
    assert (leaders(points, 0.8) == np.arange(5000)).all()
    assert leaders(np.zeros((0, 3)), 1.0).shape == (0,)
