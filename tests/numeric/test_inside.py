"""The points of a grid within a surface."""

import numpy as np
import pytest

from truth.flesh import trunk
from wrinklecli.numeric.inside import inside_grid

SKIN = trunk(24, 24)[0]
LOW, STEP, COUNTS = np.array([-0.2, -0.4, -0.2]), 0.04, np.array([11, 21, 11])
POINTS = LOW + STEP * np.stack(np.meshgrid(*map(np.arange, COUNTS), indexing="ij"), axis=-1)
# A belly sticks out of the ellipsoid; the middle of the body is far from it.
ELLIPSOID = np.sqrt(((POINTS / [0.17, 0.35, 0.12]) ** 2).sum(axis=-1))


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_closed_body(*, inside_out: bool) -> None:
    triangles = SKIN.triangles[:, ::-1] if inside_out else SKIN.triangles
    found = inside_grid(LOW, STEP, COUNTS, SKIN.positions, triangles)
    assert found[ELLIPSOID < 0.95].all()
    assert not found[(ELLIPSOID > 1.05) & (POINTS[..., 2] < 0.05)].any()
    assert found[5, 9, 8], "the belly"


def test_a_body_that_is_open_at_its_neck_has_an_inside() -> None:
    whole = inside_grid(LOW, STEP, COUNTS, SKIN.positions, SKIN.triangles)
    below = SKIN.positions[SKIN.triangles].mean(axis=1)[:, 1] < 0.27
    opened = inside_grid(LOW, STEP, COUNTS, SKIN.positions, SKIN.triangles[below])
    deep = POINTS[..., 1] < 0.2
    assert np.array_equal(whole[deep], opened[deep])


def test_a_grid_beside_the_body_is_outside() -> None:
    assert not inside_grid(LOW + 3.0, STEP, COUNTS, SKIN.positions, SKIN.triangles).any()
