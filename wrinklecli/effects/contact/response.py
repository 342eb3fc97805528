"""What resists a correction of a surface, and what the surface does under forces."""

from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Held:
    """What contacts do to free vertices.

    Attributes:
        vertices: (touched,) of the free ones, rising.
        forces: (touched, 3) on them.
        resisting: (3 · touched, 3 · touched) sparse, not negative: by how much forces fall where they move.
        off: (touched, 3) how far each is from its pose.
    """

    vertices: Ints
    forces: Floats
    resisting: Any
    off: Floats


@dataclass(frozen=True, slots=True)
class Pressed:
    """What keeps the volume of pieces.

    Attributes:
        gradients: (pieces, free, 3) by how much volumes grow where vertices move.
        gives: (pieces, free, 3) how vertices move under a pressure of 1 in each.
        stiff: (pieces,) the force for each unit of volume.
        more: (pieces,) than is wanted if all were in its pose, by the gradients.
    """

    gradients: Floats
    gives: Floats
    stiff: Floats
    more: Floats


class Response:
    """What free vertices do under forces: the inverse of the stiffness, which never changes, with contacts added.

    Contacts hold few vertices, and each of these mostly along one direction. What a force on one does to the others is
    found once: so a step takes a dense system of those directions, and no factors of all. (Those of SuperLU took five
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

    def of(self, forces: Floats) -> Floats:
        """(free, columns) how free vertices move under as many forces."""
        return np.asarray(self._factors.solve(np.asfortranarray(forces)))

    def settled(self, held: Held, pressed: Pressed) -> Floats:
        """(free, 3) how far vertices are from their pose where the forces that hold and press them are in balance.

        Forces change as linearly as contacts and volumes do near where vertices are now.
        """
        numbers = self._of_each(held.vertices)
        gains = self._gains[numbers[:, None], numbers]
        # Along the directions that are held, H are contacts, G what forces do, and W what pressure does:
        #     f = −H (G f + moved − W s),   s / stiff = more + ∇V · (moves under all forces)
        vertices, directions = _directions(held.resisting, np.diag(gains))
        count = len(vertices)
        along = _columns(vertices, directions, len(held.vertices))
        contacts = (along.T @ held.resisting @ along).tocsr()
        given = pressed.gives[:, held.vertices].reshape(len(pressed.stiff), -1)
        given_along = along.T @ given.T
        system = np.zeros((count + len(given), count + len(given)))
        system[:count, :count] = contacts @ (gains[vertices[:, None], vertices] * (directions @ directions.T))
        system[np.diag_indices(count)] += 1.0
        system[:count, count:] = -(contacts @ given_along)
        system[count:, :count] = -given_along.T
        system[count:, count:] = np.diag(1.0 / pressed.stiff) + np.tensordot(
            pressed.gradients, pressed.gives, axes=((1, 2), (1, 2))
        )
        moved = along.T @ (gains @ held.forces - held.off).reshape(-1)
        right = np.concatenate([-(contacts @ moved), pressed.more + given @ held.forces.reshape(-1)])
        solution = np.linalg.solve(system, right)
        forces = -np.tensordot(solution[count:], pressed.gradients, axes=1)
        forces[held.vertices] += held.forces + (along @ solution[:count]).reshape(-1, 3)
        return self.of(forces)

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
            found = self.of(units)[self._vertices]
            columns = self._known[some]
            grown[:, columns] = found
            grown[columns] = found.T
        if len(fresh):
            self._gains = grown
        found_numbers: Ints = self._known[vertices]
        return found_numbers


def _directions(contacts: Any, gains: Floats) -> tuple[Ints, Floats]:
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


def _columns(vertices: Ints, directions: Floats, count: int) -> Any:
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
