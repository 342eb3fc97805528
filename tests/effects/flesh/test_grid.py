"""The grid of cubes over a region of flesh."""

import numpy as np
import pytest

from wrinklecli.effects.flesh.tissue import NODES, Body, Place, _grid

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
# Outwards, two of each side.
BOX = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


@pytest.mark.parametrize("thickness", [1.0, 0.3, 0.05])
def test_a_grid_covers_a_plate_however_thin_and_has_about_as_many_nodes(thickness: float) -> None:
    sides = np.array([1.0, 1.0, thickness])
    body = Body(CORNERS * sides, BOX, np.zeros((0, 2, 3)))
    low, size, counts = _grid(body, Place(at=0.5 * sides, radius=2.0))
    assert size > 0.0
    assert (low < 0.0).all()
    assert (low + size * (counts - 1) > sides).all()
    assert low + size * (counts - 1) / 2.0 == pytest.approx(0.5 * sides), "the box lies in its middle"
    # Cubes within are two thirds of the nodes that are asked for; the rest is a rim.
    assert sides.prod() / size**3 == pytest.approx(NODES / 1.5, rel=0.5)
