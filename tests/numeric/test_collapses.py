"""Vertices that go because no edge needs them, and all that stays."""

from collections.abc import Callable

import numpy as np
import pytest

from kit.asset import Array
from kit.garments import plane
from wrinklecli.numeric.arrays import Floats, face_normals, flags_of
from wrinklecli.numeric.collapses import collapse_edges
from wrinklecli.numeric.edges import Edges
from wrinklecli.numeric.intersections import edges_of
from wrinklecli.numeric.subdivide import subdivide


def over(positions: Floats, longest: float) -> Callable[[Array], Floats]:
    """Lengths of edges over the longest that may be made."""
    return lambda ends: np.linalg.norm(positions[ends[:, 1]] - positions[ends[:, 0]], axis=1) / longest


def reduced(positions: Floats, triangles: Array, longest: float, *, tolerance: float = 1e-9) -> Array:
    """The triangles after all vertices may have gone."""
    every = np.ones(len(positions), np.bool_)
    weld = np.unique(positions, axis=0, return_inverse=True)[1].reshape(-1)
    found, numbers = collapse_edges(triangles, weld, positions, over(positions, longest), every, tolerance)
    assert len(found) == len(numbers) == len(np.unique(numbers))
    return found


def divided(positions: Floats, triangles: Array, levels: int) -> tuple[Floats, Array]:
    """Triangles in four, again and again."""
    fine = subdivide(
        triangles,
        len(positions),
        wants=lambda level: np.ones(len(level.edges), np.bool_),
        max_levels=levels,
        scheme="midpoint",
    )
    return fine.positions(positions), fine.triangles


def ridge(height: float) -> tuple[Floats, Array]:
    """A plane of 8 by 8 squares, folded along its middle."""
    positions, triangles = plane(1.0, 1.0, 8)
    return positions + np.outer(height * (0.5 - np.abs(positions[:, 0] - 0.5)), [0.0, 0, 1]), triangles


@pytest.mark.parametrize(("squares", "goes"), [(1.5, False), (2.9, True)])
def test_vertices_go_until_edges_would_be_too_long(squares: float, goes: bool) -> None:
    positions, triangles = plane(1.0, 1.0, 12)
    found = reduced(positions, triangles, squares / 12)
    after = face_normals(positions, found)[:, 2]
    assert (after > 0).all()
    assert after.sum() == pytest.approx(2.0)
    assert over(positions, squares / 12)(edges_of(found)).max() <= 1.0 + 1e-6
    assert len(np.unique(found)) < 0.55 * len(positions) if goes else np.array_equal(found, triangles)


def test_borders_stay() -> None:
    positions, triangles = plane(1.0, 1.0, 8)
    found = reduced(positions, triangles, 10.0)
    borders = [Edges.of(each).vertices[Edges.of(each).counts == 1] for each in (triangles, found)]
    assert np.array_equal(*borders)
    assert len(np.unique(found)) < 0.75 * len(positions)


def test_seams_stay() -> None:
    """Faces on both sides of the middle have corners of their own there, as at a seam of textures."""
    positions, triangles = plane(1.0, 1.0, 8)
    middle, right = np.flatnonzero(positions[:, 0] == 0.5), positions[triangles, 0].mean(axis=1) > 0.5
    copies = np.arange(len(positions))
    copies[middle] = len(positions) + np.arange(len(middle))
    split = np.where(right[:, None], copies[triangles], triangles)
    found = reduced(np.concatenate([positions, positions[middle]]), split, 10.0)
    assert flags_of(found.ravel(), len(positions) + len(middle))[np.append(middle, copies[middle])].all()


@pytest.mark.parametrize(("height", "stays"), [(0.5, True), (0.02, False)])
def test_the_surface_changes_by_no_more_than_the_tolerance(height: float, stays: bool) -> None:
    """A vertex of a ridge goes along it, or not at all."""
    positions, triangles = ridge(height)
    across = positions[reduced(positions, triangles, 10.0, tolerance=0.01), 0] - 0.5
    assert (across.min(axis=1) * across.max(axis=1) < -1e-6).any() != stays


@pytest.mark.parametrize("longest", [0.4, 0.8, 5.0])
def test_a_closed_surface_stays_closed(longest: float) -> None:
    """An octahedron's edges, of 90° and more, stay where they are, and no gap opens at halved ones."""
    corners = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    positions, triangles = divided(corners, faces, 3)
    found = reduced(positions, triangles, longest)
    edges = Edges.of(found)
    assert (edges.counts == 2).all()
    assert (edges.way > 0).all()
    assert len(np.unique(found)) - len(edges.vertices) + len(found) == 2
    assert len(found) < len(triangles)
    volumes = [np.linalg.det(positions[each]).sum() for each in (triangles, found)]
    assert volumes[1] == pytest.approx(volumes[0])


def test_faces_on_both_sides_of_one_place_stay() -> None:
    """Two faces with the same corners, one for each side, as of a leaf."""
    positions, triangles = divided(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]), 2)
    found = reduced(positions, triangles, 10.0)
    normals = face_normals(positions, found)
    assert np.abs(normals.sum(axis=0)).max() < 1e-12
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(2 * np.sqrt(3.0))


def test_no_sliver_is_made() -> None:
    """A row of vertices close to a border would leave faces as narrow as the row."""
    positions, triangles = plane(1.0, 1.0, 8)
    positions[:, 1] *= 0.05
    before, after = (_narrowest(positions, each) for each in (triangles, reduced(positions, triangles, 10.0)))
    assert after >= 0.999 * before


def _narrowest(positions: Floats, triangles: Array) -> float:
    sides = np.linalg.norm(positions[triangles] - positions[np.roll(triangles, 1, axis=1)], axis=2).max(axis=1)
    return float((np.linalg.norm(face_normals(positions, triangles), axis=1) / sides**2).min())
