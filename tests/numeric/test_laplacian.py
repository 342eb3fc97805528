"""Diffusion over surfaces: the cotangent matrix, areas of vertices, and averages over a length."""

import numpy as np
import pytest

from kit.bent_tube import tube
from kit.garments import plane
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.laplacian import Sheet, laplacian, side_weights, vertex_areas

SURFACES = {"plane": plane(2.0, 1.0, 12), "tube": tube(0.5)}
EACH = pytest.mark.parametrize("name", SURFACES)


def area(positions: Floats, triangles: Ints) -> float:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


@EACH
def test_areas_of_vertices_add_up(name: str) -> None:
    assert vertex_areas(*SURFACES[name]).sum() == pytest.approx(area(*SURFACES[name]))


def test_the_form_of_a_linear_function_is_its_squared_slope_times_the_area() -> None:
    positions, triangles = SURFACES["plane"]
    values = positions @ [3.0, -4.0, 0.0]
    # A tenth comes from the least cotangent, which right angles have in place of 0.
    assert values @ (laplacian(positions, triangles) @ values) == pytest.approx(25.0 * 2.0, rel=0.12)


@EACH
def test_the_matrix_is_symmetric_and_kills_constants(name: str) -> None:
    matrix = laplacian(*SURFACES[name])
    assert np.abs((matrix - matrix.T).toarray()).max() < 1e-12
    assert np.abs(matrix @ np.ones(matrix.shape[0])).max() < 1e-9


def test_weights_of_slivers_are_bounded() -> None:
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0], [0.5, 1, 0]])
    _, weights = side_weights(positions, np.array([[0, 1, 2], [0, 1, 3], [0, 0, 1]]))
    assert np.isfinite(weights).all()
    assert weights.min() > 0.0
    assert weights.max() < 10.0


@EACH
@pytest.mark.parametrize("length", [0.05, 0.5, 5.0])
def test_an_average_keeps_constants_and_integrals(name: str, length: float) -> None:
    sheet = Sheet.of(*SURFACES[name])
    average = sheet.averaging(length)
    assert average.of(np.full(len(sheet.areas), 3.0)) == pytest.approx(3.0)
    values = np.random.default_rng(0).random((len(sheet.areas), 2))
    found = average.of(values)
    assert sheet.areas @ found == pytest.approx(sheet.areas @ values)
    assert found.min() >= values.min() - 1e-9
    assert found.max() <= values.max() + 1e-9


def test_an_average_is_wider_over_a_greater_length() -> None:
    """Of a single point, half of what is left lies within about the length."""
    positions, triangles = plane(2.0, 2.0, 16)
    sheet = Sheet.of(positions, triangles)
    middle = int(np.argmin(np.linalg.norm(positions - [1.0, 1.0, 0.0], axis=1)))
    away = np.linalg.norm(positions - positions[middle], axis=1)
    radii = []
    for length in (0.2, 0.4):
        shares = sheet.areas * sheet.averaging(length).of(np.eye(len(positions))[middle])
        shares /= shares.sum()
        radii.append(float(np.sqrt(shares @ away**2)))
    assert radii[1] / radii[0] == pytest.approx(2.0, rel=0.15)
    assert radii[0] == pytest.approx(0.2, rel=0.3)


def test_values_of_triangles_are_spread_to_their_vertices() -> None:
    positions, triangles = SURFACES["plane"]
    sheet = Sheet.of(positions, triangles)
    values = np.random.default_rng(0).random((len(triangles), 3))
    sizes = np.full(len(triangles), area(positions, triangles) / len(triangles))
    assert sheet.to_vertices(values).sum(axis=0) == pytest.approx(sizes @ values)
    assert sheet.averaging(0.3).of_integrals(sheet.to_vertices(np.ones(len(triangles)))) == pytest.approx(1.0)


def test_vertices_without_triangles_keep_finite_averages() -> None:
    positions, triangles = SURFACES["plane"]
    alone = np.concatenate([positions, [[5.0, 5.0, 5.0]]])
    sheet = Sheet.of(alone, triangles)
    assert (sheet.areas > 0).all()
    assert np.isfinite(sheet.averaging(0.2).of(np.arange(len(alone), dtype=float))).all()
