"""The closest points of meshes, against every triangle tried one by one."""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from truth.flesh import trunk
from wrinklecli.numeric import closest
from wrinklecli.numeric.arrays import face_normals
from wrinklecli.numeric.closest import Tree, closest_point, is_inside, on_triangles

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

SKIN = trunk(24, 24)[0]
POINTS = np.array([-0.2, -0.4, -0.2]) + 0.04 * np.indices((11, 21, 11)).reshape(3, -1).T
# A belly sticks out of the ellipsoid; the middle of the body is far from it.
ELLIPSOID = np.sqrt(((POINTS / [0.17, 0.35, 0.12]) ** 2).sum(axis=1))

SEEDS = st.integers(0, 2**32 - 1)


def soup(rng: np.random.Generator, count: int) -> Floats:
    """(count, 3, 3) triangles of sizes from 1 to 1/1000, a few of them without area or without extent."""
    sizes = 10.0 ** rng.uniform(-3, 0, (count, 1, 1))
    corners = rng.normal(size=(count, 1, 3)) + sizes * rng.normal(size=(count, 3, 3))
    corners[: count // 5, 2] = corners[: count // 5, 0] + rng.uniform(-1, 2, (count // 5, 1)) * (
        corners[: count // 5, 1] - corners[: count // 5, 0]
    )
    corners[: count // 10, 2] = corners[: count // 10, 0]
    corners[: count // 20, 1] = corners[: count // 20, 0]
    return corners


def mesh_of(corners: Floats) -> tuple[Floats, Ints]:
    """The positions and triangles of (triangles, 3, 3) corners."""
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def distances(points: Floats, corners: Floats) -> Floats:
    """(points, triangles) distances of all pairs."""
    pairs = np.repeat(points, len(corners), axis=0), np.tile(corners, (len(points), 1, 1))
    return np.linalg.norm(on_triangles(*pairs)[1] - pairs[0], axis=1).reshape(len(points), len(corners))


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
    found = distances(point[None], corners[None]).item()
    walked = sampled_distance(point, corners)
    step = np.linalg.norm(np.ptp(corners, axis=0)) / 100.0
    assert found <= walked + 1e-12
    assert walked <= found + step + 1e-12


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
    triangle, barycentrics, place = closest_point(positions, triangles, point)
    every = on_triangles(np.tile(point, (50, 1)), positions[triangles])
    assert triangle == np.argmin(np.sum((every[1] - point) ** 2, axis=1))
    assert np.array_equal(barycentrics, every[0][triangle])
    assert np.array_equal(place, every[1][triangle])


def test_repeated_triangles_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def counting(points: Floats, corners: Floats) -> tuple[Floats, Floats]:
        seen.append(len(corners))
        return on_triangles(points, corners)

    monkeypatch.setattr(closest, "on_triangles", counting)
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


@given(SEEDS, st.integers(1, 200), st.integers(0, 50), st.sampled_from([0.0, 1e3]))
def test_a_tree_finds_the_nearest_of_all_pairs(seed: int, triangles: int, points: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    corners, places = soup(rng, triangles) + away, rng.normal(size=(points, 3)) + away
    found, shares, feet = Tree.of(*mesh_of(corners)).closest_points(places)
    wanted = distances(places, corners).min(axis=1, initial=np.inf)
    # A triangle without area counts as its longest side, as far as rounding errors tell it from one with area.
    assert np.linalg.norm(feet - places, axis=1) == pytest.approx(wanted, rel=1e-9, abs=1e-9)
    assert np.einsum("pk,pkx->px", shares, corners[found]) == pytest.approx(feet, abs=1e-12 * (1.0 + away))
    assert (shares >= 0).all()
    assert shares.sum(axis=1) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.quick(1)
@pytest.mark.parametrize("thickness", [1e-8, 1e-12, 1e-16, 0.0])
def test_a_tree_knows_how_far_a_triangle_is_however_thin(thickness: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        start, stop, aside = rng.normal(size=(3, 3))
        third = start + rng.uniform(-1.0, 2.0) * (stop - start) + thickness * aside
        corners = rng.permutation(np.array([start, stop, third]))
        # Above the triangle, at most as far as it is long.
        lift = np.cross(stop - start, aside) * rng.uniform(0.1, 1.0, (20, 1))
        for point in rng.dirichlet(np.ones(3), 20) @ corners + lift:
            distance = distances(point[None], corners[None]).item()
            # The other triangle is small, and a little farther from the point.
            rival = point + distance * (1.01 * np.eye(3)[0] + 1e-3 * np.eye(3))
            found, _, _ = Tree.of(*mesh_of(np.stack([rival, corners]))).closest_points(point[None])
            assert found.tolist() == [1]


def test_a_point_finds_alone_what_it_finds_among_others() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    tree = Tree.of(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    rng = np.random.default_rng(5)
    # At vertices, on edges, on triangles and beside them: many of these lie equally near to several triangles.
    points = np.concatenate([mesh.vertices[:50], mesh.triangles[:50, :2].mean(axis=1), rng.normal(size=(50, 3))])
    together = tree.closest_points(points)
    for number, point in enumerate(points):
        for one, all_of_them in zip(tree.closest_points(point[None]), together, strict=True):
            assert np.array_equal(one[0], all_of_them[number])


def test_a_tree_is_sent_to_another_process() -> None:
    corners = soup(np.random.default_rng(2), 40)
    tree, points = Tree.of(*mesh_of(corners)), np.random.default_rng(3).normal(size=(20, 3))
    for one, other in zip(
        *(each.closest_points(points) for each in (tree, pickle.loads(pickle.dumps(tree)))), strict=True
    ):
        assert np.array_equal(one, other)


def test_points_of_the_surface_are_on_it() -> None:
    rng = np.random.default_rng(1)
    corners = soup(rng, 500)
    points = np.einsum("tk,tka->ta", rng.dirichlet(np.ones(3), 500), corners)
    _, _, feet = Tree.of(*mesh_of(corners)).closest_points(points)
    assert np.linalg.norm(feet - points, axis=1).max() < 2e-15


@pytest.mark.parametrize("count", [1, 2000])
def test_triangles_all_in_one_place_are_found(count: int) -> None:
    tree = Tree.of(*mesh_of(np.tile(np.eye(3), (count, 1, 1))))
    _, _, feet = tree.closest_points(np.array([[2.0, 2.0, 2.0], [0.0, 0.0, 0.0]]))
    assert feet == pytest.approx(np.full((2, 3), 1.0 / 3.0))


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_closed_body_has_an_inside(*, inside_out: bool) -> None:
    triangles = SKIN.triangles[:, ::-1] if inside_out else SKIN.triangles
    found = is_inside(POINTS, SKIN.positions, triangles)
    assert found[ELLIPSOID < 0.95].all()
    assert not found[(ELLIPSOID > 1.05) & (POINTS[:, 2] < 0.05)].any()
    assert is_inside(np.array([[0.0, -0.04, 0.12]]), SKIN.positions, triangles).all(), "the belly"


def test_a_body_that_is_open_at_its_neck_has_an_inside() -> None:
    below = SKIN.positions[SKIN.triangles].mean(axis=1)[:, 1] < 0.27
    whole, opened = (is_inside(POINTS, SKIN.positions, SKIN.triangles[each]) for each in (slice(None), below))
    deep = POINTS[:, 1] < 0.2
    assert np.array_equal(whole[deep], opened[deep])
    assert not np.array_equal(whole, opened)


def test_what_is_beside_a_body_is_not_inside() -> None:
    assert not is_inside(POINTS + 3.0, SKIN.positions, SKIN.triangles).any()


@pytest.mark.slow
@pytest.mark.long
def test_threads_do_not_change_what_is_found() -> None:
    """libigl divides 10,000 points and more among as many threads as IGL_NUM_THREADS says, or as there are cores."""
    program = """
import hashlib, numpy
from wrinklecli.numeric.closest import Tree, is_inside
random = numpy.random.default_rng(5)
corners = random.normal(size=(1000, 1, 3)) + 0.1 * random.normal(size=(1000, 3, 3))
positions, triangles = corners.reshape(-1, 3), numpy.arange(3000).reshape(-1, 3)
points = random.normal(size=(12_000, 3)).round(1)
found = [*Tree.of(positions, triangles).closest_points(points)]
found.append(is_inside(points, positions, triangles))
print(hashlib.sha256(b"".join(each.tobytes() for each in found)).hexdigest())
"""
    others = {name: value for name, value in os.environ.items() if name != "IGL_NUM_THREADS"}
    digests = [
        subprocess.run(
            [sys.executable, "-c", program], env={**others, **threads}, capture_output=True, text=True, check=True
        ).stdout
        for threads in ({}, {"IGL_NUM_THREADS": "1"}, {"IGL_NUM_THREADS": "2"})
    ]
    assert len(digests[0]) == 65
    assert digests == digests[:1] * 3
