"""Elastic tissue on a grid of cubes: stiffness, mass, and the few shapes in which it answers to an acceleration.

Each cube is a hexahedral finite element, whose stiffness and mass count by the part of it that is filled. The change of
volume is taken as constant over a cube: with a Poisson ratio near 0.5, full integration would lock.

The shapes are load-dependent Ritz vectors: with the stiffness K, the mass M and the three directions e_d, they span
(K⁻¹M)ʲ e_d for j = 1, 2, … In their span, tissue is a set of springs. Three vectors are the static answer to an
acceleration, six add the first answer to the inertia of the tissue itself. Modes of vibration need several times as
many: most of them are not moved by an acceleration.

Sources: T. J. R. Hughes, *The Finite Element Method*, 2000, §4.5.2 (constant change of volume); E. L. Wilson,
M.-W. Yuan, J. M. Dickens, *Dynamic analysis by direct superposition of Ritz vectors*, 1982.
"""

from functools import cached_property
from typing import Any

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, places_of
from wrinklecli.numeric.memory import leave_room, start_blas

POISSON = 0.45
"""Poisson ratio of flesh, which hardly changes its volume; nearer to 0.5 hardly looks different, and solves worse."""

# Corners of a cube as steps along x, y, z.
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.intp)


@dataclass(frozen=True)
class Tissue:
    """Elements of a grid of cubes.

    Attributes:
        nodes: (elements, 8) numbers of each element's nodes, in the order of `CORNERS`.
        fills: (elements,) the part of each cube that is filled, > 0.
        stiffnesses: (elements,) Young's modulus, relative.
        fixed: (nodes,) True for nodes that do not move.
        size: Length of an edge, scene units.
    """

    nodes: Ints
    fills: Floats
    stiffnesses: Floats
    fixed: Bools
    size: float

    @cached_property
    def free(self) -> Ints:
        """(free nodes,) numbers of the nodes that move."""
        return np.flatnonzero(~self.fixed)

    @cached_property
    def masses(self) -> Floats:
        """(free nodes,) masses for a density of 1."""
        every = np.bincount(self.nodes.reshape(-1), np.repeat(self.fills, 8), len(self.fixed)) * self.size**3 / 8.0
        return np.asarray(every[self.free])

    def stiffness(self) -> Any:
        """The sparse (3 free nodes, 3 free nodes) stiffness; x, y, z of a node stand together."""
        from scipy.sparse import coo_matrix

        number = places_of(self.free, len(self.fixed), -1)
        rows = (3 * number[self.nodes][:, :, None] + np.arange(3)).reshape(-1, 24)
        values = (self.size * self.fills * self.stiffnesses)[:, None, None] * cube_stiffness()
        held = np.repeat(self.fixed[self.nodes], 3, axis=1)
        kept = ~(held[:, :, None] | held[:, None, :])
        across, down = (np.broadcast_to(each, values.shape)[kept] for each in (rows[:, None, :], rows[:, :, None]))
        count = 3 * len(self.free)
        return coo_matrix((values[kept], (down, across)), (count, count)).tocsc()


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """The springs to which tissue is reduced.

    Under an acceleration a of its ground, tissue moves by the sum over k of shapes[k] · (loads[k] · r_k), where the
    vector r_k follows r'' + 2 ζ_k ω_k r' + ω_k² r = -a.

    Attributes:
        shapes: (modes, nodes, 3) displacements, the most compliant mode first.
        loads: (modes, 3) unit vectors.
        speeds: (modes,) ω of each mode for a density and a modulus of 1.
    """

    shapes: Floats
    loads: Floats
    speeds: Floats


# Bytes of factors for each entry of a matrix: twice as many, while they grow, as 12 for each of 13, which flesh needs.
_FACTORS = 2 * 12 * 13


def factorised(matrix: Any, *, relax: int | None = None) -> Any:
    """Factorise a sparse, symmetric, positive definite matrix; its method `solve` takes right sides in columns.

    Args:
        matrix: In columns.
        relax: Columns that are joined although their rows differ. 1 takes half the time for the matrix of a surface.
            None is SuperLU's own number, which suits solids.

    Raises:
        MemoryError: There may be too little room.
    """
    from scipy.sparse.linalg import splu

    start_blas()
    # SuperLU would print a line of its own.
    leave_room(_FACTORS * int(matrix.nnz))
    options = {"SymmetricMode": True}
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, relax=relax, options=options)


def ritz_modes(tissue: Tissue, count: int) -> Modes:
    """Reduce tissue to `count` springs, three for each power of K⁻¹M.

    There are fewer springs if the tissue has too few nodes.
    """
    stiffness = tissue.stiffness()
    solve = factorised(stiffness).solve
    masses = np.repeat(tissue.masses, 3)
    directions = np.tile(np.eye(3), (len(tissue.free), 1))
    basis, block = np.zeros((len(masses), 0)), directions
    for _ in range(count // 3):
        block = solve(masses[:, None] * block)
        # Twice, as rounding errors of the first time are not small beside what remains.
        for _ in range(2):
            block = block - basis @ (basis.T @ (masses[:, None] * block))
            block = _orthonormal(block, masses)
        basis = np.concatenate([basis, block], axis=1)
    squares, turn = np.linalg.eigh(basis.T @ (stiffness @ basis))
    vectors = basis @ turn
    loads = vectors.T @ (masses[:, None] * directions)
    sizes = np.linalg.norm(loads, axis=1)
    kept = sizes > 1e-9 * sizes.max()
    loads, sizes, vectors, squares = loads[kept], sizes[kept], vectors[:, kept], squares[kept]
    # A fixed sign, whatever the solver gives.
    signs = np.sign(loads[np.arange(len(loads)), np.abs(loads).argmax(axis=1)])
    shapes = np.zeros((len(loads), len(tissue.fixed), 3))
    shapes[:, tissue.free] = (vectors * (signs * sizes)).T.reshape(len(loads), -1, 3)
    return Modes(shapes, signs[:, None] * loads / sizes[:, None], np.sqrt(squares))


def _orthonormal(vectors: Floats, masses: Floats) -> Floats:
    """Columns that span those of (numbers, columns) `vectors`, of unit mass."""
    values, turn = np.linalg.eigh(vectors.T @ (masses[:, None] * vectors))
    kept = values > 1e-14 * values[-1]
    return np.asarray(vectors @ (turn[:, kept] / np.sqrt(values[kept])))


def cube_stiffness() -> Floats:
    """(24, 24) stiffness of a unit cube of Young's modulus 1; x, y, z of a corner stand together."""
    bulk, shear = 1.0 / (3.0 * (1.0 - 2.0 * POISSON)), 1.0 / (2.0 * (1.0 + POISSON))
    near, far = (1.0 - 1.0 / np.sqrt(3.0)) / 2.0, (1.0 + 1.0 / np.sqrt(3.0)) / 2.0
    total = np.zeros((24, 24))
    for place in np.where(CORNERS, far, near):
        strains, volume = _strains(place)
        deviator = strains.copy()
        deviator[:3] -= volume / 3.0
        # Engineering shear strains count half as much as the others in the energy: shear · γ² against 2 shear · ε².
        weights = shear * np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
        total += deviator.T @ (weights[:, None] * deviator) / 8.0
    _, volume = _strains(np.full(3, 0.5))
    return np.asarray(total + bulk * np.outer(volume, volume))


def _strains(place: Floats) -> tuple[Floats, Floats]:
    """(6, 24) strains at a (3,) place in a unit cube from its corners' displacements, and (24,) change of volume."""
    sides = np.where(CORNERS, place, 1.0 - place)
    ways = np.where(CORNERS, 1.0, -1.0)
    slopes = np.stack([ways[:, k] * np.delete(sides, k, axis=1).prod(axis=1) for k in range(3)], axis=1)
    strains = np.zeros((6, 8, 3))
    for k in range(3):
        strains[k, :, k] = slopes[:, k]
    for row, (i, j) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
        strains[row, :, i], strains[row, :, j] = slopes[:, j], slopes[:, i]
    flat = strains.reshape(6, 24)
    return flat, flat[:3].sum(axis=0)
