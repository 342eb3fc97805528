"""The patch of refined skin on which a touch is fitted: the part that may move.

A bake refines the skin of a touch twice: for the touch alone, and together with all other effects. Most patches are the
same both times, and what was fitted once holds.
"""

import numpy as np

from wrinklecli.effects.touch.skin import Hold
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.surface.refine import Refinement


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """The triangles of refined skin that may move.

    Attributes:
        vertices: (vertices,) sorted fine vertices.
        corners: (triangles, 3) numbers among these.
        positions: (vertices, 3) bind space.
        blended: (vertices, 3, 4) bind to world space at rest.
    """

    vertices: Ints
    corners: Ints
    positions: Floats
    blended: Floats

    @classmethod
    def of(cls, fine: Refinement, hold: Hold) -> "Patch":
        """The patch of refined skin whose coarse vertices are held."""
        moving = fine.subdivision.interpolate(hold.still[:, None])[:, 0] < 1.0
        vertices, corners = np.unique(fine.triangles[moving[fine.triangles].any(axis=1)], return_inverse=True)
        return cls(vertices, corners.reshape(-1, 3), fine.positions[vertices], fine.blended[vertices])

    def equals(self, other: "Patch") -> bool:
        """True if both are refined alike, whatever the numbers of their vertices."""
        return (
            np.array_equal(self.corners, other.corners)
            and np.array_equal(self.positions, other.positions)
            and np.array_equal(self.blended, other.blended)
        )

    def spread(self, values: Floats, count: int) -> Floats:
        """(…, count, 3) values of the first vertices from (…, vertices, 3) ones of the patch; 0 beside it."""
        found = np.zeros((*values.shape[:-2], count, 3))
        within = self.vertices < count
        found[..., self.vertices[within], :] = values[..., within, :]
        return found
