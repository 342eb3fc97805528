"""The resistance of a surface to corrections, and its movement under forces.

The surface itself resists, and so do contacts and the volume under each piece that is free to move: a surface that only
gave way would lose the volume that a contact squeezes away, where flesh bulges beside the contact. So each volume is
held at that of the skinned pose, in which overlapping parts count twice.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, components, cross, dot
from wrinklecli.numeric.laplacian import laplacian, vertex_areas
from wrinklecli.numeric.portions import portions

# Stiffness of a contact, relative to the surface round it, below which a step leaves a direction of the contact out.
_LEAST_STIFFNESS = 0.1
# Least and greatest mass of a vertex relative to the median.
_LEAST_MASS = 0.25
_GREATEST_MASS = 4.0
# Least area of a vertex relative to the median, where the area divides.
_LEAST_AREA = 1e-3


def stiffness_of(rest: Floats, triangles: Ints, *, soft: float, heavier: Floats) -> Any:
    """(vertices, vertices) sparse matrix of the quadratic form Σ m |c|² + ℓ² |∇c|² + ℓ⁴ |Δc|².

    A correction fades over the length `soft`, which is ℓ; `heavier` are (vertices,) factors of the masses.
    """
    import scipy.sparse as sparse

    areas, cotangents = vertex_areas(rest, triangles), laplacian(rest, triangles)
    mean = float(np.median(areas))
    masses = np.clip(areas / mean, _LEAST_MASS, _GREATEST_MASS) * heavier
    bent = cotangents @ sparse.diags_array(1.0 / np.maximum(areas, _LEAST_AREA * mean)) @ cotangents
    return (sparse.diags_array(masses) + soft**2 / mean * cotangents + soft**4 / mean * bent).tocsr()


@dataclass(frozen=True)
class Pieces:
    """The connected pieces of a surface that are free to move, each with the triangles that its vertices deform.

    Where an open border moves, as a hem does, lids close the surface: a fan of triangles to the mean of the border.
    Without them, the volume of all between the border and the origin would count.

    Attributes:
        triangles: (triangles, 3) for each piece; numbers from the count of vertices on are the means of borders.
        means: (borders, vertices) sparse matrix that gives the mean of each border.
    """

    triangles: tuple[Ints, ...]
    means: Any

    @classmethod
    def of(cls, triangles: Ints, free: Bools) -> "Pieces":
        """Find the connected pieces of (triangles, 3) from the (vertices,) that are free."""
        moving = triangles[free[triangles].any(axis=1)]
        ends = moving[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        labels = components(ends[free[ends].all(axis=1)], len(free))
        lids, means = _lids(moving, free)
        every = np.concatenate([moving, lids])
        corners = every[:, :2]  # the third of a lid is a mean
        corners = np.concatenate([corners, np.where(every[:, 2:] < len(free), every[:, 2:], corners[:, :1])], axis=1)
        # All free vertices of a triangle belong to one piece.
        piece = np.where(free[corners], labels[corners], -1).max(axis=1)
        return cls(tuple(every[piece == each] for each in np.unique(piece)), means)

    def volumes(self, positions: Floats) -> Floats:
        """(pieces,) volumes between each piece and the origin; only differences of these mean anything."""
        places = np.concatenate([positions, self.means @ positions])
        return np.array([np.sum(dot(*_sides(places, each))) / 6.0 for each in self.triangles])

    def gradients(self, positions: Floats) -> Floats:
        """(pieces, vertices, 3) gradients of the volumes."""
        count, places = len(positions), np.concatenate([positions, self.means @ positions])
        gradients = np.zeros((len(self.triangles), *places.shape))
        for gradient, triangles in zip(gradients, self.triangles, strict=True):
            for k in range(3):
                _, across = _sides(places, np.roll(triangles, -k, axis=1))
                for axis, values in enumerate(across):
                    gradient[:, axis] += np.bincount(triangles[:, k], values / 6.0, len(places))
            gradient[:count] += self.means.T @ gradient[count:]
        return gradients[:, :count]


def _lids(moving: Ints, free: Bools) -> tuple[Ints, Any]:
    """Close the open borders of (moving, 3) triangles where some of the (vertices,) free ones are on them.

    Returns:
        (lids, 3) vertices, of which the last is the number of vertices plus that of a border; and (borders, vertices)
        a sparse matrix that gives the mean of each border.
    """
    import scipy.sparse as sparse

    count = len(free)
    ends = moving[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, which, owners = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    open_ends = ends[(owners[which.reshape(-1)] == 1) & free[ends].any(axis=1)]
    labels = components(open_ends, count)[open_ends[:, 0]]
    borders, numbers = np.unique(labels, return_inverse=True)
    lids = np.concatenate([open_ends[:, ::-1], count + numbers.reshape(-1, 1)], axis=1)
    within = np.unique(np.stack([np.repeat(numbers.reshape(-1), 2), open_ends.reshape(-1)], axis=1), axis=0)
    shares = 1.0 / np.bincount(within[:, 0], minlength=len(borders))[within[:, 0]]
    return lids, sparse.csr_array((shares, (within[:, 0], within[:, 1])), shape=(len(borders), count))


def _sides(positions: Floats, triangles: Ints) -> tuple[Floats, list[Floats]]:
    """The first corner of each triangle and the cross product of the other two, both (3, triangles)."""
    a, b, c = (positions[triangles[:, k]].T for k in range(3))
    return a, cross(b, c)


@dataclass(frozen=True, slots=True)
class ContactForces:
    """The barrier's forces on free vertices, to first order.

    Attributes:
        vertices: (touched,) sorted indices among the free vertices.
        forces: (touched, 3).
        hessian: (3 · touched, 3 · touched) sparse, positive semidefinite: how the forces fall as the vertices move.
        off: (touched, 3) positions relative to the skinned ones.
    """

    vertices: Ints
    forces: Floats
    hessian: Any
    off: Floats


@dataclass(frozen=True, slots=True)
class VolumeForces:
    """The forces that keep the volume of each piece, to first order.

    Attributes:
        gradients: (pieces, free, 3) gradients of the volumes.
        moves: (pieces, free, 3) movements of the vertices under each gradient.
        stiffness: (pieces,) force per unit of volume.
        excess: (pieces,) volumes minus the wanted ones if all vertices were in their pose, by the gradients.
    """

    gradients: Floats
    moves: Floats
    stiffness: Floats
    excess: Floats


class Response:
    """The movement of the free vertices under forces: the inverse of the constant stiffness, with contacts added.

    Contacts hold few vertices, and most of these along one direction. The movements under a unit force on each are
    solved for once, so a step solves a dense system of those directions and factorises nothing large. (Factors by
    SuperLU in each step took five times as long, and a system of all coordinates of touching vertices three times.)

    Each march has its own: what touches first decides the last bits of all movements.

    Args:
        moves_under: Gives (free, columns) movements under as many forces, one coordinate for each column.
        count: Number of free vertices.
    """

    def __init__(self, moves_under: Callable[[Floats], Floats], count: int) -> None:
        self._moves_under = moves_under
        # Index of each vertex among those that ever touched, and the movements of all these under a unit force on each.
        self._known = np.full(count, -1, np.intp)
        self._vertices = np.zeros(0, np.intp)
        self._gains = np.zeros((0, 0))

    def equilibrium(self, contacts: ContactForces, volume: VolumeForces) -> Floats:
        """(free, 3) positions, relative to the skinned ones, at which the forces of contacts and volumes balance.

        Forces change linearly, as they do near the vertices' current positions.
        """
        # (vertices,) rows of the vertices in `_gains`; adds the rows that are missing.
        fresh = contacts.vertices[self._known[contacts.vertices] < 0]
        if len(fresh):
            self._add(fresh)
        numbers: Ints = self._known[contacts.vertices]
        gains = self._gains[numbers[:, None], numbers]
        # Along the held directions, let H be the Hessian of the contacts, G the gains and W the movements under
        # pressure. The unknowns are the forces f of contacts and s of pressure:
        #     f = −H (G f + moved − W s),   s / stiffness = excess + ∇V · (movements under all forces)
        vertices, directions = _held_directions(contacts.hessian, np.diag(gains))
        count = len(vertices)
        along = _direction_matrix(vertices, directions, len(contacts.vertices))
        hessian = (along.T @ contacts.hessian @ along).tocsr()
        given = volume.moves[:, contacts.vertices].reshape(len(volume.stiffness), -1)
        given_along = along.T @ given.T
        system = np.zeros((count, count))
        for some in portions(count, count):
            system[:, some] = hessian @ (gains[vertices[:, None], vertices[some]] * (directions @ directions[some].T))
        system[np.diag_indices(count)] += 1.0
        moved = along.T @ (gains @ contacts.forces - contacts.off).reshape(-1)
        # First the contacts without pressure and under each unit of it, then the pressures.
        found = np.linalg.solve(system, hessian @ np.column_stack([-moved, given_along]))
        alone, under = found[:, 0], found[:, 1:]
        across = np.tensordot(volume.gradients, volume.moves, axes=((1, 2), (1, 2)))
        pressures = np.linalg.solve(
            np.diag(1.0 / volume.stiffness) + across - given_along.T @ under,
            volume.excess + given @ contacts.forces.reshape(-1) + given_along.T @ alone,
        )
        forces = -np.tensordot(pressures, volume.gradients, axes=1)
        forces[contacts.vertices] += contacts.forces + (along @ (alone + under @ pressures)).reshape(-1, 3)
        return self._moves_under(forces)

    def _add(self, fresh: Ints) -> None:
        """Add vertices to those that ever touched."""
        count = len(self._vertices)
        self._known[fresh] = np.arange(count, count + len(fresh))
        self._vertices = np.concatenate([self._vertices, fresh])
        grown = np.zeros((len(self._vertices), len(self._vertices)))
        grown[:count, :count] = self._gains
        for some in (fresh[part] for part in portions(len(fresh), len(self._known))):
            units = np.zeros((len(self._known), len(some)))
            units[some, np.arange(len(some))] = 1.0
            found = self._moves_under(units)[self._vertices]
            columns = self._known[some]
            grown[:, columns] = found
            grown[columns] = found.T
        self._gains = grown


def _held_directions(hessian: Any, gains: Floats) -> tuple[Ints, Floats]:
    """Find the directions in which (3 · touched, 3 · touched) contacts are stiff relative to (touched,) gains.

    Returns:
        (held,) sorted indices among the touching vertices, and (held, 3) unit directions.
    """
    count = len(gains)
    entries = hessian.tocoo()
    own = entries.row // 3 == entries.col // 3
    places = entries.row[own] * 3 + entries.col[own] % 3
    blocks = np.bincount(places, entries.data[own], 9 * count).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(blocks)
    held = values * gains[:, None] > _LEAST_STIFFNESS
    vertices, which = np.nonzero(held)
    return vertices, vectors[vertices, :, which]


def _direction_matrix(vertices: Ints, directions: Floats, count: int) -> Any:
    """(3 · count, held) sparse matrix that turns amounts along the held directions into coordinates."""
    import scipy.sparse as sparse

    rows = (3 * vertices[:, None] + np.arange(3)).reshape(-1)
    columns = np.repeat(np.arange(len(vertices)), 3)
    return sparse.csr_array((directions.reshape(-1), (rows, columns)), shape=(3 * count, len(vertices)))
