"""Distance of points from a surface, against every triangle tried one by one."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wrinklecli.numeric.arrays import face_normals
from wrinklecli.numeric.distances import farthest, triangle_distances
from wrinklecli.numeric.nearest import (
    Blocks,
    _closest_of,
    closest_point,
    distances_along,
    nearest_on_mesh,
    nearest_points,
    ray_hits,
)

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


@given(seed=st.integers(0, 999))
def test_closest_point_is_as_near_as_any_sample_and_lies_where_it_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(9, 3))
    triangles = rng.integers(0, 9, (6, 3))
    triangles[0] = triangles[1, [0, 0, 1]]  # without area
    point = rng.normal(size=3) * rng.choice([0.2, 1.0, 4.0])
    triangle, barycentrics, place = closest_point(positions, triangles, point)
    assert barycentrics @ positions[triangles[triangle]] == pytest.approx(place, abs=1e-14)
    assert barycentrics.sum() == pytest.approx(1.0, abs=1e-14)
    assert (barycentrics >= 0).all()
    distance = np.linalg.norm(place - point)
    steps = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
    samples = np.einsum("sk,tkx->tsx", steps, positions[triangles])
    assert distance <= np.linalg.norm(samples - point, axis=2).min() + 1e-14
    solid = np.linalg.norm(face_normals(positions, triangles), axis=1) > 1e-9
    if solid.any():
        corners = positions[triangles[solid]]
        repeated = np.tile(point, (len(corners), 1))
        near = trimesh.triangles.closest_point(corners, repeated)
        assert distance <= np.linalg.norm(near - point, axis=1).min() + 1e-9
    if solid[triangle]:
        assert distance == pytest.approx(np.linalg.norm(near - point, axis=1).min(), abs=1e-9)


@given(seed=st.integers(0, 9999), apart=st.sampled_from([0.0, 1e3, 1e9]))
def test_triangles_that_are_too_far_need_not_be_looked_at(seed: int, apart: float) -> None:
    rng = np.random.default_rng(seed)
    # Of few numbers, so that many triangles are equally near; vertex 0 has none.
    positions = rng.integers(-3, 4, (20, 3)) * rng.choice([0.1, 1.0]) + apart * rng.normal(size=3)
    triangles = rng.integers(1, 20, (30, 3))[rng.integers(0, 30, 50)]
    point = positions[0] + rng.choice([0.0, 0.05, 1.0]) * rng.integers(-1, 2, 3)
    for found, wanted in zip(
        closest_point(positions, triangles, point), _closest_of(positions, triangles, point), strict=True
    ):
        assert np.array_equal(found, wanted)


@given(seed=st.integers(0, 999), away=st.sampled_from([0.0, 1e3]))
def test_nearest_points_are_as_near_as_the_closest_ones(seed: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(20, 3)) + away
    triangles = np.array([rng.choice(20, 3, replace=False) for _ in range(7)])
    points = rng.normal(size=(5, 3)) * rng.choice([0.2, 1.0, 4.0]) + away
    found, shares = nearest_points(points, positions[triangles])
    assert shares.sum(axis=1) == pytest.approx(1.0)
    places = np.einsum("pk,pkx->px", shares, positions[triangles[found]])
    for point, place in zip(points, places, strict=True):
        assert np.linalg.norm(closest_point(positions, triangles, point)[2] - place) < 1e-6


@pytest.mark.parametrize("count", [0, 1, 700])
def test_many_points_find_the_nearest_of_a_mesh(count: int) -> None:
    """They lie as near as those that each finds alone, though two triangles have no area."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    positions = np.asarray(mesh.vertices) * [1.0, 2.0, 0.5]
    triangles = np.concatenate([mesh.faces[:1, [0, 0, 1]], [[2, 2, 2]], mesh.faces])
    points = np.random.default_rng(5).normal(size=(count, 3)) * [0.8, 1.6, 0.4]
    found, shares = nearest_on_mesh(points, positions, triangles)
    feet = np.einsum("vc,vcx->vx", shares, positions[triangles[found]])
    wanted = np.array([closest_point(positions, triangles, each)[2] for each in points]).reshape(-1, 3)
    assert shares.sum(axis=1) == pytest.approx(1.0)
    assert shares.min(initial=0.0) > -1e-9
    away = [np.linalg.norm(points - each, axis=1) for each in (feet, wanted)]
    assert away[0] == pytest.approx(away[1], abs=1e-9)


def test_repeated_triangles_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def closest_of(positions: Floats, triangles: NDArray[np.intp], point: Floats) -> tuple[int, Floats, Floats]:
        seen.append(len(triangles))
        return _closest_of(positions, triangles, point)

    monkeypatch.setattr("wrinklecli.numeric.nearest._closest_of", closest_of)
    triangles = np.tile([[0, 0, 0], [0, 1, 2]], (50, 1))
    triangle, _, _ = closest_point(np.eye(3), triangles, np.array([0.2, 0.3, 0.4]))
    assert (triangle, seen) == (1, [2])


def test_of_equally_near_triangles_the_first_is_taken() -> None:
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    for triangles in ([[0, 1, 2], [0, 2, 3]], [[0, 2, 3], [0, 1, 2]]):
        triangle, barycentrics, place = closest_point(positions, np.array(triangles), np.array([0.5, 0.5, 3.0]))
        assert triangle == 0
        assert place.tolist() == [0.5, 0.5, 0.0]
        assert sorted(barycentrics.tolist()) == [0.0, 0.5, 0.5]


@given(seed=st.integers(0, 999), count=st.sampled_from([0, 1, 40, 1000]), away=st.sampled_from([0.0, 1e3]))
def test_all_rays_at_once_meet_what_each_meets_alone(seed: int, count: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    corners = soup(rng, count) + away
    starts, rays = rng.normal(size=(30, 3)) + away, rng.normal(size=(30, 3))
    rays[:10] = corners.reshape(-1, 3).mean(axis=0) - starts[:10] if count else rays[:10]
    numbers, triangles, distances = ray_hits(starts, rays, corners)
    found = np.full((30, count), np.inf)
    found[numbers, triangles] = distances
    alone = np.array([distances_along(start, ray, corners) for start, ray in zip(starts, rays, strict=True)])
    assert np.array_equal(np.isfinite(found), np.isfinite(alone))
    met = np.isfinite(alone)
    assert found[met] == pytest.approx(alone[met], rel=1e-9 if away else 1e-12, abs=1e-9 if away else 1e-12)


def test_a_mesh_in_boxes_has_the_closest_point_of_the_mesh_alone() -> None:
    rng = np.random.default_rng(3)
    corners = soup(rng, 5000)
    positions, triangles = corners.reshape(-1, 3), np.arange(15000).reshape(-1, 3)
    triangles = np.concatenate([triangles, triangles[:50]])
    blocks = Blocks.of(positions, triangles)
    for point in np.concatenate([rng.normal(size=(20, 3)), positions[:100:5]]):
        for found, wanted in zip(blocks.closest_point(point), closest_point(positions, triangles, point), strict=True):
            assert np.array_equal(found, wanted)
