"""Edges through triangles: the trees find what a look at every pair finds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.numeric.intersections import Crossings, _morton_order, crossing, edges_of


def volumes(first: np.ndarray, *others: np.ndarray) -> np.ndarray:
    """Six times those of tetrahedra with (n, 3) corners each, with signs."""
    return np.linalg.det(np.stack([other - first for other in others], axis=1))


def every_crossing(positions: np.ndarray, triangles: np.ndarray) -> list[tuple[int, int]]:
    """Edges with an end on either side of a triangle, whose line turns about all of its sides alike."""
    edges = edges_of(triangles)
    e, t = (each.reshape(-1) for each in np.indices((len(edges), len(triangles))))
    start, stop = positions[edges[e]].swapaxes(0, 1)
    corners = positions[triangles[t]].swapaxes(0, 1)
    split = volumes(*corners, start) * volumes(*corners, stop) < 0
    turns = np.sign([volumes(start, stop, corners[k], corners[k - 1]) for k in range(3)])
    apart = (edges[e][:, :, None] != triangles[t][:, None]).all(axis=(1, 2))
    crosses = apart & split & (turns == turns[0]).all(axis=0)
    return list(zip(e[crosses].tolist(), t[crosses].tolist(), strict=True))


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_trees_find_what_a_look_at_every_pair_finds(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    rest = rng.normal(size=(30, 3))
    triangles = np.array([rng.choice(30, 3, replace=False) for _ in range(count)], np.intp).reshape(-1, 3)
    crossings = Crossings.of(rest, triangles)
    for positions in (rest, rng.normal(size=(30, 3)) * [1, 1, 0.1]):
        found = [each.tolist() for each in crossings.at(positions)]
        every = every_crossing(positions, triangles)
        assert list(zip(*found, strict=True)) == every
        counting = rng.random(30) < 0.1
        marked, pairs = set[int](), set[tuple[int, int]]()
        for edge, triangle in every:
            corners = {*crossings.edges[edge].tolist(), *triangles[triangle].tolist()}
            if counting[list(corners)].any():
                marked, pairs = marked | corners, pairs | {(edge, triangle)}
        assert crossings.pairs_at(positions, counting) == pairs
        assert set(np.flatnonzero(crossings.vertices_at(positions, counting)).tolist()) == marked


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 1.0]))
def test_what_may_cross_holds_all_that_crosses_on_the_way(seed: int, way: float) -> None:
    """Pairs are sought once, and then looked at alone wherever vertices are on lines between two places each."""
    rng = np.random.default_rng(seed)
    one, counting = rng.normal(size=(30, 3)), rng.random(30) < 0.5
    other = one + way * rng.normal(size=(30, 3))
    triangles = np.array([rng.choice(30, 3, replace=False) for _ in range(40)], np.intp)
    crossings = Crossings.of(one, triangles)
    pairs = crossings.may_cross(one, other, counting)
    for positions in (one, other, one + rng.random((30, 1)) * (other - one)):
        found = pairs[crossing(positions.T, pairs[:, :2], pairs[:, 2:])]
        wanted = crossings.corners_of(crossings.pairs_at(positions, counting))
        assert sorted(found.tolist()) == sorted(wanted.tolist())


CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("start", "stop", "crosses"),
    [
        ((0.2, 0.2, 1), (0.2, 0.2, -1), True),
        ((0.2, 0.2, -1), (0.2, 0.2, 1), True),
        ((0.2, 0.2, 1), (0.2, 0.2, 0), False),  # ends on it
        ((0.2, 0.2, 1), (0.2, 0.2, 2), False),
        ((0.8, 0.8, 1), (0.8, 0.8, -1), False),  # beside it
        ((0.0, 0.0, 1), (0.0, 0.0, -1), False),  # through a corner
        ((-1, 0.2, 0), (2, 0.2, 0), False),  # in its plane
    ],
)
def test_an_edge_passes_through_what_it_has_an_end_on_either_side_of(
    start: tuple[float, ...], stop: tuple[float, ...], crosses: bool
) -> None:
    positions, triangles = np.array([*CORNERS, start, stop]), np.array([[0, 1, 2], [3, 4, 4]])
    edges, through = Crossings.of(positions, triangles).at(positions)
    assert list(zip(edges_of(triangles)[edges].tolist(), through.tolist(), strict=True)) == [([3, 4], 0)] * crosses


def test_rounding_lets_no_edge_pass_through_a_triangle_in_its_own_plane() -> None:
    """An edge beside a triangle and parallel to one of its sides, as on flat skin that is refined, wherever that is."""
    flat = np.array([[0.0, 0, 0], [0.61, 0, 0], [0.24, 1.77, 0], [-0.61, 0, 0], [-0.37, 1.77, 0]])
    numbers = np.random.default_rng(1)
    turned = [flat @ np.linalg.qr(numbers.normal(size=(3, 3)))[0].T + numbers.normal(size=3) for _ in range(2000)]
    places, first = np.concatenate(turned), 5 * np.arange(2000)[:, None]
    assert not crossing(places.T, first + np.array([3, 4]), first + np.array([0, 1, 2])).any()
    assert not any(len(Crossings.of(flat, np.array([[0, 1, 2], [3, 4, 4]])).at(each)[0]) for each in turned)


def test_what_is_near_in_the_order_of_a_tree_is_near_in_space() -> None:
    """The order of boxes decides how many of them are opened, not which crossings are found."""
    points = np.random.default_rng(1).random((4096, 3)) * [1.0, 2.0, 0.5] - 3.0
    order = _morton_order(points)
    assert sorted(order) == list(range(len(points)))
    steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    # A cell of 4096 points has edges of a sixteenth.
    assert steps.mean() < 2.0 * (1.0 / len(points)) ** (1.0 / 3.0)
