"""What resists a correction of a surface, and what the surface does under forces."""

from typing import Any

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints


def stiffness_of(rest: Floats, triangles: Ints, *, soft: float, heavier: Floats) -> Any:
    """(vertices, vertices) sparse, of the quadratic form Σ m |c|² + ℓ² |∇c|² + ℓ⁴ |Δc|².

    Args:
        rest: (vertices, 3).
        triangles: (triangles, 3).
        soft: ℓ, the length over which a correction fades.
        heavier: (vertices,) factors of the masses.
    """
    import scipy.sparse as sparse

    areas, laplacian = _areas(rest, triangles), _laplacian(rest, triangles)
    mean = float(np.median(areas))
    masses = np.clip(areas / mean, 0.25, 4.0) * heavier
    bent = laplacian @ sparse.diags_array(1.0 / np.maximum(areas, 1e-3 * mean)) @ laplacian
    return (sparse.diags_array(masses) + soft**2 / mean * laplacian + soft**4 / mean * bent).tocsr()


class Response:
    """What free vertices do under forces: the inverse of the stiffness, which never changes, with contacts added.

    Contacts touch few vertices, and what a force on one does everywhere is found once: so a step takes a dense system
    of those that touch, and no factors of all. (Those of SuperLU took five times as long.)

    Args:
        stiffness: (free, free) sparse.
    """

    def __init__(self, stiffness: Any) -> None:
        import scipy.sparse.linalg as linear

        self._factors = linear.splu(
            stiffness.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        # Of vertices that once touched: where what a force on each does to all stands, a row each.
        self._known = np.full(stiffness.shape[0], -1, np.intp)
        self._rows = np.zeros((0, stiffness.shape[0]))
        self._count = 0

    def of(self, forces: Floats, contacts: Any = None) -> Floats:
        """(3 · free, forces) what moves under as many, if contacts, (3 · free, 3 · free) sparse, resist too."""
        from scipy.linalg import cho_factor, cho_solve

        several = forces.shape[1]
        alone = self._factors.solve(forces.reshape(-1, 3 * several))
        if contacts is None:
            return np.asarray(alone.reshape(-1, several))
        touched = np.flatnonzero(np.diff(contacts.indptr).reshape(-1, 3).any(axis=1))
        numbers = self._of_each(touched)
        coordinates = (3 * touched[:, None] + np.arange(3)).reshape(-1)
        resisting = contacts[coordinates][:, coordinates].toarray()
        # (G⁻¹ + H) d = G⁻¹ (G f) at the vertices that touch: G is the same for each coordinate, and H mixes them.
        inverse = np.linalg.inv(self._rows[numbers[:, None], touched])
        inverse = 0.5 * (inverse + inverse.T)
        system = resisting.reshape(len(touched), 3, len(touched), 3).copy()
        for k in range(3):
            system[:, k, :, k] += inverse
        factors = cho_factor(system.reshape(resisting.shape), overwrite_a=True, check_finite=False)
        pulled = (inverse @ alone[touched]).reshape(-1, several)
        held = (resisting @ cho_solve(factors, pulled, check_finite=False)).reshape(-1, 3 * several)
        return np.asarray((alone - self._rows[numbers].T @ held).reshape(-1, several))

    def _of_each(self, vertices: Ints) -> Ints:
        """(vertices,) the rows that tell what a force of 1 on each of some does to all."""
        fresh = vertices[self._known[vertices] < 0]
        if len(fresh):
            units = np.zeros((len(self._known), len(fresh)))
            units[fresh, np.arange(len(fresh))] = 1.0
            count = self._count + len(fresh)
            if count > len(self._rows):
                grown = np.zeros((max(count, 2 * len(self._rows)), len(self._known)))
                grown[: self._count] = self._rows[: self._count]
                self._rows = grown
            self._rows[self._count : count] = self._factors.solve(units).T
            self._known[fresh] = np.arange(self._count, count)
            self._count = count
        found: Ints = self._known[vertices]
        return found


def _areas(positions: Floats, triangles: Ints) -> Floats:
    """(vertices,) a third of the triangles of each."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    areas = np.sqrt(np.sum(np.cross(b - a, c - a) ** 2, axis=1)) / 6.0
    return np.asarray(np.bincount(triangles.reshape(-1), np.repeat(areas, 3), len(positions)), np.float64)


def _laplacian(positions: Floats, triangles: Ints) -> Any:
    """(vertices, vertices) sparse, of cotangents, whose quadratic form is the integral of a squared gradient.

    Source: U. Pinkall, K. Polthier, *Computing Discrete Minimal Surfaces and Their Conjugates*, 1993. Differs:
    cotangents are held between 0.05 and 5, so that obtuse and thin triangles do not pull apart.
    """
    import scipy.sparse as sparse

    rows, columns, values = [], [], []
    for k in range(3):
        a, b, c = (triangles[:, (k + i) % 3] for i in range(3))
        first, second = positions[b] - positions[a], positions[c] - positions[a]
        sine = np.sqrt(np.sum(np.cross(first, second) ** 2, axis=1))
        half = np.clip(np.sum(first * second, axis=1) / np.maximum(sine, 1e-9), 0.05, 5.0) / 2.0
        rows += [b, c]
        columns += [c, b]
        values += [half, half]
    shape = (len(positions), len(positions))
    sides = sparse.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    return (sparse.diags_array(sides.sum(axis=1)) - sides).tocsr()
