"""Diagonals that turn towards the shorter way, and all that stays."""

from collections.abc import Callable

import numpy as np
import pytest

from kit.asset import Array
from kit.garments import plane
from wrinklecli.numeric.arrays import Floats, face_normals
from wrinklecli.numeric.edges import turn_diagonals
from wrinklecli.numeric.intersections import edges_of


def across(positions: Floats, angle: float) -> Callable[[Array], Floats]:
    """Lengths of edges that count fully along one direction, and half across it."""
    line = [np.cos(angle), np.sin(angle), 0.0]

    def lengths(ends: Array) -> Floats:
        way = positions[ends[:, 1]] - positions[ends[:, 0]]
        return np.asarray(np.maximum(np.abs(way @ line), np.linalg.norm(way, axis=1) / 2.0))

    return lengths


def slopes(positions: Floats, triangles: Array) -> set[float]:
    """The slopes of the diagonals of a grid."""
    way = np.diff(positions[edges_of(triangles)], axis=1)[:, 0, :2]
    return {round(float(y / x), 6) for x, y in way if x and y}


@pytest.mark.parametrize(("angle", "slope"), [(np.pi / 4, -1.0), (-np.pi / 4, 1.0)])
def test_diagonals_run_across_the_direction(angle: float, slope: float) -> None:
    positions, triangles = plane(1.0, 1.0, 4)
    found = turn_diagonals(triangles, positions, across(positions, angle), 0.0)
    assert slopes(positions, found) == {slope}


def test_borders_orientation_and_area_stay() -> None:
    positions, triangles = plane(2.0, 1.0, 6)
    found = turn_diagonals(triangles, positions, across(positions, -0.6), 0.0)
    assert not np.array_equal(found, triangles)
    before, after = (face_normals(positions, each) for each in (triangles, found))
    assert (after[:, 2] * before[0, 2] > 0).all()
    assert after.sum() == pytest.approx(before.sum())
    lengths = across(positions, -0.6)
    assert lengths(edges_of(found)).sum() < lengths(edges_of(triangles)).sum()
    assert np.array_equal(turn_diagonals(found, positions, lengths, 0.0), found)


def test_seams_stay() -> None:
    """The two triangles of a square have corners of their own along their diagonal, as at a seam of textures."""
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    one = np.array([[0, 1, 2], [0, 2, 3]])
    assert not np.array_equal(turn_diagonals(one, positions, across(positions, np.pi / 4), 0.0), one)
    split, doubled = np.array([[0, 1, 2], [4, 5, 3]]), np.concatenate([positions, positions[[0, 2]]])
    assert np.array_equal(turn_diagonals(split, doubled, across(doubled, np.pi / 4), 0.0), split)


@pytest.mark.parametrize(("height", "turns"), [(0.1, True), (0.3, False)])
def test_the_surface_changes_by_no_more_than_the_tolerance(height: float, turns: bool) -> None:
    positions = np.array([[0.0, 0, 0], [1, 0, height], [1, 1, 0], [0, 1, height]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    found = turn_diagonals(triangles, positions, across(positions, np.pi / 4), 0.2)
    assert np.array_equal(found, triangles) != turns


def test_no_sliver_is_made() -> None:
    """A corner that is almost on the other diagonal would be one."""
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0.52, 0.52, 0], [0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    assert np.array_equal(turn_diagonals(triangles, positions, across(positions, np.pi / 4), 1.0), triangles)
