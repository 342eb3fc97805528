"""Distance of points from a surface, against every triangle tried one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wrinklecli.numeric.nearest import farthest, triangle_distances

Floats = NDArray[np.float64]

SEEDS = st.integers(0, 2**32 - 1)


def soup(rng: np.random.Generator, count: int) -> Floats:
    """(count, 3, 3) triangles of sizes from 1 to 1/1000, a few of them without area or without extent."""
    sizes = 10.0 ** rng.uniform(-3, 0, (count, 1, 1))
    corners = rng.normal(size=(count, 1, 3)) + sizes * rng.normal(size=(count, 3, 3))
    corners[: count // 10, 2] = corners[: count // 10, 0]
    corners[: count // 20, 1] = corners[: count // 20, 0]
    return corners


def sampled_distance(point: Floats, corners: Floats) -> float:
    """Distance of a point from a triangle by walking over it, from above."""
    u, v = np.meshgrid(*[np.linspace(0.0, 1.0, 201)] * 2)
    u, v = u[u + v <= 1.0 + 1e-12], v[u + v <= 1.0 + 1e-12]
    places = corners[0] + u[:, None] * (corners[1] - corners[0]) + v[:, None] * (corners[2] - corners[0])
    return float(np.linalg.norm(places - point, axis=1).min())


@given(SEEDS)
def test_distance_from_a_triangle_is_that_of_its_nearest_place(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, point = soup(rng, 20)[rng.integers(20)], rng.normal(size=3)
    (found,) = triangle_distances(point[None], corners[None])
    walked = sampled_distance(point, corners)
    step = np.linalg.norm(np.ptp(corners, axis=0)) / 100.0
    assert found <= walked + 1e-12
    assert walked <= found + step + 1e-12


@given(SEEDS, st.integers(1, 300), st.integers(1, 200), st.booleans())
def test_the_farthest_point_is_that_of_all_pairs(seed: int, triangles: int, points: int, hinted: bool) -> None:
    rng = np.random.default_rng(seed)
    corners, places = soup(rng, triangles), rng.normal(size=(points, 3))
    every = np.stack([triangle_distances(np.tile(place, (triangles, 1)), corners) for place in places])
    hints = rng.integers(0, triangles, points) if hinted else None
    found = farthest(places, corners, hints=hints)
    assert found.distance == pytest.approx(every.min(axis=1).max(), rel=1e-12)
    assert every[found.point].min() == pytest.approx(found.distance, rel=1e-12)
    above = farthest(places, corners, hints=found.hints, floor=found.distance)
    assert above.point == -1
    assert above.distance == found.distance


def test_points_of_the_surface_are_on_it() -> None:
    rng = np.random.default_rng(1)
    corners = soup(rng, 500)
    shares = rng.dirichlet(np.ones(3), 500)
    found = farthest(np.einsum("tk,tka->ta", shares, corners), corners)
    assert found.distance < 1e-15


@pytest.mark.parametrize("count", [5, 50, 500])
def test_a_triangle_whose_middle_is_farther_may_be_nearer(count: int) -> None:
    turns = np.radians([90.0, 210.0, 330.0])
    flat = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    # All of one size: those above the point have their middles nearer to it than the one that touches it.
    above = flat + np.linspace(0.5, 0.9, count)[:, None, None] * [0.0, 0.0, 1.0]
    touching = flat[None] - flat[0]
    found = farthest(np.zeros((1, 3)), np.concatenate([above, touching]))
    assert (found.distance, found.point, found.hints.tolist()) == (0.0, -1, [count])


@pytest.mark.parametrize("count", [1, 2000])
def test_triangles_all_in_one_place_are_found(count: int) -> None:
    corners = np.tile(np.eye(3), (count, 1, 1))
    found = farthest(np.array([[2.0, 2.0, 2.0], [0.0, 0.0, 0.0]]), corners)
    assert found.point == 0
    assert found.distance == pytest.approx(np.sqrt(3) * 5 / 3)
