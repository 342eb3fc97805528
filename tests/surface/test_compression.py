"""Basins of the compression over a surface, and regions that reach across its middle."""

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.sparse import csr_array

from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.compression import CompressedRegion, basins, grow_region
from wrinklecli.surface.sites import Sites


def test_a_slope_belongs_to_the_fold_above_it() -> None:
    losses = np.array([0.1, 0.3, 0.5, 0.45, 0.48, 0.9, 0.3, 0.05, 0.2, 0.6])
    count = len(losses)
    chain = np.eye(count, k=1) + np.eye(count, k=-1)
    found = basins(losses, csr_array(chain), least=0.1)
    assert found.tolist() == [5, 5, 5, 5, 5, 5, 5, -1, 9, 9]


def half(x: Floats, y: Floats, *, middle: float) -> Floats:
    """Losses of a fold three sites wide round (4, 3): 1 at one corner, less elsewhere and in the middle."""
    inside = (np.abs(x - 4.0) <= 1.0) & (np.abs(y - 3.0) <= 1.0)
    losses = np.where((x == 5.0) & (y == 4.0), 1.0, np.where((x == 4.0) & (y == 3.0), middle, 0.8))
    return np.where(inside, losses, 0.0)


def across(
    axis: int, *, opposite: float = 1.0, between: float = 0.3, lean: float = 0.0, gap: float = 0.0
) -> CompressedRegion:
    """The region round (4, 3) on a sheet at z = 5, which loses along an axis there, and on the other side of x = 0.

    Args:
        axis: 0 for x, 1 for y.
        opposite: What the other side loses, over what this one loses.
        between: What the rest loses, over the same.
        lean: Angle by which the sheet between both leans, radians.
        gap: Distance from x = 0 up to which there is no sheet.
    """
    x, y = (each.ravel().astype(np.float64) for each in np.meshgrid(np.arange(-7, 8), np.arange(-5, 7)))
    front = np.stack([x, y, np.full(len(x), 5.0)], axis=1)[np.abs(x) >= gap]
    # A sheet behind loses on both sides, and so does the front below the fold. Neither is the other half.
    places = np.concatenate([front, front * [1.0, 1.0, -1.0]])
    x, y, z = places.T
    folds = half(x, y, middle=1.0) + opposite * half(-x, y, middle=0.8)
    losses = np.where(z < 0, half(np.abs(x), y, middle=1.0), np.maximum(folds, between))
    losses[(x == -4.0) & ((y == -4.0) | (y == 1.0))] = 1.0
    tensors = np.zeros((len(places), 6))
    tensors[:, axis] = 0.5 * losses
    leans = lean * (np.abs(x) < 2.0)
    normals = np.stack([np.zeros(len(x)), np.sin(leans), np.cos(leans)], axis=1)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    near = csr_array((apart > 0) & (apart < 1.5))
    areas, primitives = np.ones(len(places)), np.zeros(len(places), np.intp)
    sites = Sites(Mock(), places, normals, areas, primitives, near, near, near, 1.9, 1.0)
    seed = int(np.flatnonzero((places == [4.0, 3.0, 5.0]).all(axis=1))[0])
    found = grow_region(sites, seed, tensors, np.ones(len(places), np.bool_), twin=True, across=True)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("sheet", "joined"),
    [
        ({"axis": 1}, True),
        ({"axis": 1, "opposite": 0.7}, True),
        ({"axis": 1, "opposite": 0.55}, False),
        ({"axis": 0, "between": 0.2}, True),
        ({"axis": 0, "between": 0.1}, False),
        ({"axis": 1, "between": 0.0}, True),
        ({"axis": 1, "between": 0.0, "lean": 0.7}, True),
        ({"axis": 1, "between": 0.0, "lean": 0.9}, False),
        ({"axis": 1, "between": 0.0, "gap": 2.5}, False),
    ],
    ids=str,
)
def test_two_halves_are_one_region_if_both_lose_and_the_surface_between_them_loses_or_is_even(
    sheet: dict[str, Any], joined: bool
) -> None:
    region = across(**sheet)
    assert region.on_plane == joined
    x, y, z = region.centre
    assert (x, y, z) == pytest.approx((0.0 if joined else 4.0, 3.0, 5.0), abs=0.3)
    assert abs(region.along[sheet["axis"]]) == pytest.approx(1.0)
