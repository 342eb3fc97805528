"""What resists a correction of a surface, and what the surface does under forces."""

from typing import Any

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints

# Resistance of a contact that is left out of a step, against that of the surface round it.
_HARDLY = 0.1
# Forces whose moves are found at once: bounds the memory.
_AT_ONCE = 64


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

    Contacts hold few vertices, and each of these mostly along one direction: what a force on one does to the others is
    found once, so a step takes a dense system of those directions, and no factors of all. (Those of SuperLU took five
    times as long, and a system of all coordinates of those that touch three times.)

    Args:
        stiffness: (free, free) sparse.
    """

    def __init__(self, stiffness: Any) -> None:
        import scipy.sparse.linalg as linear

        self._factors = linear.splu(
            stiffness.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        # Of vertices that once touched: their numbers here, and what a force on each does to each.
        self._known = np.full(stiffness.shape[0], -1, np.intp)
        self._vertices = np.zeros(0, np.intp)
        self._gains = np.zeros((0, 0))

    def of(self, forces: Floats, touched: Ints | None = None, contacts: Any = None) -> Floats:
        """What moves under forces.

        Args:
            forces: (3 · free, forces).
            touched: (touched,) free vertices that contacts hold,
            contacts: and (3 · touched, 3 · touched) sparse, not negative, how they resist.

        Returns:
            (3 · free, forces) moves.
        """
        several = forces.shape[1]
        alone = self._solved(forces.reshape(-1, 3 * several))
        if touched is None or not len(touched):
            return np.asarray(alone.reshape(-1, several))
        numbers = self._of_each(touched)
        gains = self._gains[numbers[:, None], numbers]
        # What is held: (held,) the vertex, and its direction.
        vertices, directions = _held(contacts, np.diag(gains))
        projected = _sparse_rows(vertices, directions, len(touched))
        stiff = (projected.T @ contacts @ projected).tocsr()
        # (1 + H G) f = H u at what is held, of the moves u without contact.
        coupled = gains[vertices[:, None], vertices] * (directions @ directions.T)
        system = stiff @ coupled
        system[np.diag_indices(len(vertices))] += 1.0
        moved = projected.T @ alone.reshape(-1, 3, several)[touched].reshape(-1, several)
        held = np.zeros((len(alone) * 3, several))
        coordinates = (3 * touched[:, None] + np.arange(3)).reshape(-1)
        held[coordinates] = projected @ np.linalg.solve(system, stiff @ moved)
        return np.asarray((alone - self._solved(held.reshape(-1, 3 * several))).reshape(-1, several))

    def _solved(self, forces: Floats) -> Floats:
        return np.asarray(self._factors.solve(np.asfortranarray(forces)))

    def _of_each(self, vertices: Ints) -> Ints:
        """(vertices,) the numbers of some among those of which is known what a force on each does to each."""
        fresh = vertices[self._known[vertices] < 0]
        count = len(self._vertices)
        self._known[fresh] = np.arange(count, count + len(fresh))
        self._vertices = np.concatenate([self._vertices, fresh])
        grown = np.zeros((len(self._vertices), len(self._vertices)))
        grown[:count, :count] = self._gains
        for k in range(0, len(fresh), _AT_ONCE):
            some = fresh[k : k + _AT_ONCE]
            units = np.zeros((len(self._known), len(some)))
            units[some, np.arange(len(some))] = 1.0
            found = self._solved(units)[self._vertices]
            columns = self._known[some]
            grown[:, columns] = found
            grown[columns] = found.T
        if len(fresh):
            self._gains = grown
        found_numbers: Ints = self._known[vertices]
        return found_numbers


def _held(contacts: Any, gains: Floats) -> tuple[Ints, Floats]:
    """Where (3 · touched, 3 · touched) contacts resist more than hardly, against (touched,) gains under a force.

    Returns:
        (held,) which of the vertices that touch, rising, and (held, 3) unit directions.
    """
    count = len(gains)
    entries = contacts.tocoo()
    own = entries.row // 3 == entries.col // 3
    places = entries.row[own] * 3 + entries.col[own] % 3
    blocks = np.bincount(places, entries.data[own], 9 * count).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(blocks)
    held = values * gains[:, None] > _HARDLY
    vertices, which = np.nonzero(held)
    return vertices, vectors[vertices, :, which]


def _sparse_rows(vertices: Ints, directions: Floats, count: int) -> Any:
    """(3 · count, held) sparse: what each direction of a vertex is, in coordinates."""
    import scipy.sparse as sparse

    rows = (3 * vertices[:, None] + np.arange(3)).reshape(-1)
    columns = np.repeat(np.arange(len(vertices)), 3)
    return sparse.csr_array((directions.reshape(-1), (rows, columns)), shape=(3 * count, len(vertices)))


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
