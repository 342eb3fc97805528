"""Finds where contact crumples a surface: its bending energy is a few times that of the surface without contact.

A fold that is resolved well has flat sides and one valley between them. Its bending energy is about that of the same
surface without contact, whose sides bend as sharply and pass through each other. A surface of ridges and dents, like
crumpled foil, has several times as much, wherever it touches itself.

Source: E. Grinspun, A. Hirani, M. Desbrun, P. Schröder, *Discrete Shells*, 2003, on the energy of a hinge, with flat
rest angles.
"""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, cross, dot
from wrinklecli.numeric.intersections import sides_of

# Greatest energy relative to that without contact. Folds that look right have 0.9 to 2.1. If their vertices are moved
# at random by a fifth of an edge, which looks like foil, they have 2.5 to 3.2, and by three tenths 4.2 to 5.4.
_MOST = 3.0
# Least area of a hinge's triangles, as a part of the mean: slivers bend without being seen.
_LEAST_AREA = 1e-2


@dataclass(frozen=True, slots=True)
class Crumpling:
    """The part of a surface that may crumple.

    Attributes:
        triangles: (triangles, 3) vertices.
        edges: (hinges, 2) vertices of the edges between two triangles each,
        beside: and (hinges, 2) these triangles.
        radius: Radius of the limb, in the units of positions.
    """

    triangles: Ints
    edges: Ints
    beside: Ints
    radius: float

    @classmethod
    def of(cls, triangles: Ints, free: Bools, radius: float) -> "Crumpling":
        """Look at the (triangles, 3) with a corner among the (vertices,) that are free."""
        triangles = triangles[free[triangles].any(axis=1)]
        sides, owners = sides_of(triangles), np.repeat(np.arange(len(triangles)), 3)
        order = np.lexsort((sides[:, 1], sides[:, 0]))
        same = np.flatnonzero((sides[order[1:]] == sides[order[:-1]]).all(axis=1))
        beside = np.stack([owners[order[same]], owners[order[same + 1]]], axis=1)
        return cls(triangles, sides[order[same]], beside, radius)

    def crumples(self, given: Floats, shown: Floats) -> bool:
        """True if (vertices, 3) positions are crumpled relative to the given ones."""
        energy, least = self._energy(given)
        return self._energy(shown)[0] > _MOST * max(energy, least)

    def _energy(self, positions: Floats) -> tuple[float, float]:
        """The bending energy of the surface, and about that of a ball as large as the limb, per area."""
        a, b, c = (positions[self.triangles[:, k]].T for k in range(3))
        normals = np.stack(cross(b - a, c - a), axis=1)
        doubled = np.sqrt(np.sum(normals**2, axis=1))
        normals /= np.maximum(doubled, TINY)[:, None]
        one, two = normals[self.beside[:, 0]].T, normals[self.beside[:, 1]].T
        angles = np.arccos(np.clip(dot(one, two), -1.0, 1.0))
        squares = np.sum((positions[self.edges[:, 0]] - positions[self.edges[:, 1]]) ** 2, axis=1)
        areas = doubled[self.beside].sum(axis=1) / 2.0
        areas = np.maximum(areas, _LEAST_AREA * np.mean(areas)) if len(areas) else areas
        return float(np.sum(3.0 * squares * angles**2 / areas)), float(doubled.sum()) / self.radius**2
