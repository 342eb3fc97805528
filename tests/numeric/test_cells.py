"""Searches by the cells of a grid find everything that is near, and leave out most of what is not."""

import numpy as np
import pytest

from wrinklecli.numeric.cells import Cells


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
