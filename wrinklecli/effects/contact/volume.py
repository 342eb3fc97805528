"""Volume under a surface: what a contact squeezes away bulges beside it.

Flesh keeps its volume. A surface that only gives way loses what went through itself; so the volume under each piece of
it that is free to move is held at what the pose asks for, in which what overlaps counts twice.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, dot, pieces_of


@dataclass(frozen=True)
class Pieces:
    """The pieces of a surface that are free to move, each with what of its border is not.

    Attributes:
        triangles: For each piece (triangles, 3) vertices.
    """

    triangles: tuple[Ints, ...]

    @classmethod
    def of(cls, triangles: Ints, free: Bools) -> "Pieces":
        """Find the pieces of (triangles, 3), of (vertices,) those that are free, that hang together."""
        moving = triangles[free[triangles].any(axis=1)]
        ends = moving[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        labels = pieces_of(ends[free[ends].all(axis=1)], len(free))
        # A triangle's free vertices are all of one piece.
        piece = np.where(free[moving], labels[moving], -1).max(axis=1)
        return cls(tuple(moving[piece == each] for each in np.unique(piece)))

    def grown(self, positions: Floats, wanted: Floats) -> float:
        """By how much the volume of all under (vertices, 3) positions is more than under others."""
        return float(np.sum(self.volumes(positions) - self.volumes(wanted)))

    def volumes(self, positions: Floats) -> Floats:
        """(pieces,) between each and the origin; only differences mean anything."""
        return np.array([np.sum(dot(*_sides(positions, each))) / 6.0 for each in self.triangles])

    def gradients(self, positions: Floats) -> Floats:
        """(pieces, vertices, 3) by how much the volumes grow where vertices move."""
        gradients = np.zeros((len(self.triangles), *positions.shape))
        for gradient, triangles in zip(gradients, self.triangles, strict=True):
            for k in range(3):
                _, across = _sides(positions, np.roll(triangles, -k, axis=1))
                for axis, values in enumerate(across):
                    gradient[:, axis] += np.bincount(triangles[:, k], values / 6.0, len(positions))
        return gradients


def _sides(positions: Floats, triangles: Ints) -> tuple[Floats, list[Floats]]:
    """Of triangles the first corner, and the cross product of the others, both (3, triangles)."""
    a, b, c = (positions[triangles[:, k]].T for k in range(3))
    return a, cross(b, c)
