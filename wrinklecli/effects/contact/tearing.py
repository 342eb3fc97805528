"""Finds where contact tears a surface: it changes the length of an edge too far, or turns a triangle over.

The surface is compared with the one that the solver was given, skinned and wrinkled: wrinkles lengthen edges
themselves, and are no tears. Skinning shrinks edges to nothing on the inside of a bend, where contact gives them their
length back; so an edge is compared with its length at rest too. Likewise, skinning turns triangles over, where a fold
passes through itself, and contact turns them back.
"""

from collections.abc import Callable

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.closest import nearest_of
from wrinklecli.numeric.intersections import edges_of, widened

# Greatest length of an edge, relative to the longer of its lengths at rest and as skinned. In folds that look right
# it is 1.2, and 1.6 in the sleeve of a limb that is pressed by half of its radius; in torn ones it is 2 to 10.
_LONGEST = 2.0
# Least length of an edge, relative to the shorter of its lengths at rest and as skinned,
_SHORTEST = 0.5
# further than so many edges from what crosses as skinned: nearer, in a crease, whole folds have 0.1 to 0.5;
_PRESSED_RINGS = 3
# and further than this at rest, solver's units: a quarter of the limb's radius, as limbs are pressed by half of it.
# Knees on a fine mesh have edges of 0.25 to 0.5 up to 12 units away.
_PRESSED = 17.5
# Edges count as this long at least where they are lengthened, and become shorter by more than this, solver's units: a
# millimetre of a knee is about what contact holds off.
_SHORT = 1.0
# Cosine between the normals of a triangle and of each neighbour below which it is turned over: more than 120°. The
# bottom of a closed fold is as sharp, but it has neighbours on its own side.
_TURNED = -0.5
# Least area of a triangle that can be turned over, squared solver's units.
_LEAST_AREA = 1e-6


@dataclass(frozen=True, slots=True)
class Tearing:
    """The part of a surface that may tear.

    Attributes:
        rest: (vertices, 3) at rest, solver's units.
        edges: (edges, 2) vertices.
        lengths: (edges,) at rest.
        triangles: (triangles, 3) vertices.
        pressed: (vertices,) True for those that cross in the fold's own motion without contact.
        inner: (inner,) triangles with a neighbour at each side,
        beside: and (inner, 3) these neighbours.
    """

    rest: Floats
    edges: Ints
    lengths: Floats
    triangles: Ints
    pressed: Bools
    inner: Ints
    beside: Ints

    @classmethod
    def of(cls, rest: Floats, triangles: Ints, free: Bools, pressed: Bools) -> "Tearing":
        """Look at the (triangles, 3) with a corner among the (vertices,) that are free."""
        triangles = triangles[free[triangles].any(axis=1)]
        edges = edges_of(triangles)
        sides = np.sort(np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
        owners = np.tile(np.arange(len(triangles)), 3)
        order = np.lexsort((sides[:, 1], sides[:, 0]))
        same = np.flatnonzero((sides[order[1:]] == sides[order[:-1]]).all(axis=1))
        others = np.full(3 * len(triangles), -1)
        others[order[same]], others[order[same + 1]] = owners[order[same + 1]], owners[order[same]]
        beside = others.reshape(3, -1).T
        inner = np.flatnonzero((beside >= 0).all(axis=1))
        return cls(rest, edges, _lengths(rest, edges), triangles, pressed, inner, beside[inner])

    def tears(self, given: Floats, shown: Floats, crossing: Callable[[Floats], Bools]) -> bool:
        """True if (vertices, 3) positions are torn relative to the given ones; both in solver's units.

        `crossing` finds the (vertices,) that cross at positions, as a clip may press others.
        """
        wanted, found = _lengths(given, self.edges), _lengths(shown, self.edges)
        if (found > _LONGEST * np.maximum(np.maximum(self.lengths, wanted), _SHORT)).any():
            return True
        if (self._turned(shown) & ~self._turned(given)).any():
            return True
        least = np.minimum(self.lengths, wanted)
        short = self.edges[(found < _SHORTEST * least) & (found < least - _SHORT)]
        if not len(short):
            return False
        # The bottom of a crease is pressed together, and ends that passed through the surface come back to it.
        near = pressed = self.pressed | crossing(given)
        for _ in range(_PRESSED_RINGS):
            near = widened(self.edges, near)
        short = short[~near[short].any(axis=1)]
        if not len(short) or not pressed.any():
            return len(short) > 0
        apart, _ = nearest_of(self.rest[pressed], self.rest[short.ravel()])
        return bool((apart.reshape(-1, 2).min(axis=1) > _PRESSED).any())

    def _turned(self, positions: Floats) -> Bools:
        """(inner,) True for triangles that face away from all of their neighbours."""
        a, b, c = (positions[self.triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.sqrt(np.sum(normals**2, axis=1)), 2.0 * _LEAST_AREA)[:, None]
        cosines = np.einsum("tj,tnj->tn", normals[self.inner], normals[self.beside])
        return np.asarray((cosines < _TURNED).all(axis=1))


def _lengths(positions: Floats, edges: Ints) -> Floats:
    """(edges,) lengths of edges."""
    return np.asarray(np.sqrt(np.sum((positions[edges[:, 0]] - positions[edges[:, 1]]) ** 2, axis=1)))
