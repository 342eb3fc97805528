"""Elastic elements: energies that are known, and shapes in which tissue answers to an acceleration."""

import numpy as np
import pytest

from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.elements import CORNERS, POISSON, Tissue, cube_stiffness, factorised, ritz_modes


def block(count: int = 5) -> Tissue:
    """A block of cubes on a floor, to which its lowest nodes are fixed."""
    places = np.stack(np.meshgrid(*[np.arange(count + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    firsts = places[(places < count).all(axis=1)]
    nodes = (firsts[:, None] + CORNERS) @ [(count + 1) ** 2, count + 1, 1]
    return Tissue(nodes, np.ones(len(nodes)), np.ones(len(nodes)), places[:, 1] == 0, 0.1)


def test_a_cube_that_moves_rigidly_holds_no_energy() -> None:
    moved = np.eye(3)[None].repeat(8, axis=0).transpose(2, 0, 1)
    turned = [np.cross(axis, CORNERS - 0.5) for axis in np.eye(3)]
    for each in (*moved, *turned):
        assert np.abs(cube_stiffness() @ each.reshape(-1)).max() < 1e-14


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_stretched_cube_holds_the_energy_of_hookes_law(axis: int) -> None:
    """All sides but two are held, so that the modulus is the one of waves."""
    stretched = np.zeros((8, 3))
    stretched[:, axis] = 0.01 * CORNERS[:, axis]
    modulus = (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON))
    flat = stretched.reshape(-1)
    assert 0.5 * flat @ cube_stiffness() @ flat == pytest.approx(0.5 * modulus * 0.01**2)


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize(("axis", "other"), [(0, 1), (1, 2), (2, 0)])
def test_a_bent_cube_holds_the_energy_of_its_uneven_strain(axis: int, other: int, corner: Ints) -> None:
    """Its sides move by the product of two distances from any corner; the change of volume counts as at the centre."""
    bent = np.zeros((8, 3))
    bent[:, axis] = np.prod(np.abs(CORNERS - corner)[:, [axis, other]], axis=1)
    bulk, shear = 1 / (3 * (1 - 2 * POISSON)), 1 / (2 * (1 + POISSON))
    flat = bent.reshape(-1)
    assert flat @ cube_stiffness() @ flat == pytest.approx(shear * 7 / 9 + bulk / 4)


def sag(tissue: Tissue, direction: Floats) -> Floats:
    """(free nodes, 3) moves under an acceleration of 1 along a direction, by the full stiffness."""
    masses = np.repeat(tissue.masses, 3)
    return np.asarray(factorised(tissue.stiffness()).solve(masses * np.tile(direction, len(tissue.free)))).reshape(
        -1, 3
    )


@pytest.mark.parametrize("count", [3, 6, 9])
def test_springs_at_rest_sag_as_all_elements_do(count: int) -> None:
    tissue, direction = block(), np.array([0.3, -0.8, 0.5])
    modes = ritz_modes(tissue, count)
    assert len(modes.speeds) == count
    assert (np.diff(modes.speeds) >= 0).all()
    found = np.einsum("k,kvx->vx", modes.loads @ direction / modes.speeds**2, modes.shapes[:, tissue.free])
    assert np.allclose(found, sag(tissue, direction), rtol=1e-9, atol=1e-12)


def test_few_nodes_make_few_springs() -> None:
    """One free node has three ways to move, whatever is asked for."""
    tissue = block(1)
    fixed = np.ones(8, np.bool_)
    fixed[0] = False
    lone = Tissue(tissue.nodes, tissue.fills, tissue.stiffnesses, fixed, tissue.size)
    assert len(ritz_modes(lone, 9).speeds) == 3
