"""An elastic membrane tethered to what is below it: how far its points slide under loads along the surface.

The slide u minimises ∫ ½ ε:C:ε + t |u|² / 2 dA - ∫ g·u, with the strain ε of u in each triangle's plane, plane stress,
tethers t and loads g. Slides lie in the tangent planes of the vertices, so that the membrane has two unknowns at each.

Source: O. C. Zienkiewicz, R. L. Taylor, *The Finite Element Method*, volume 1 (constant strain triangles).
"""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.elements import factorised

POISSON = 0.4
"""Poisson ratio of skin along its surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Membrane:
    """A triangulated surface with a plane at each vertex.

    Attributes:
        positions: (vertices, 3).
        triangles: (triangles, 3).
        axes: (2, vertices, 3) orthogonal unit vectors in the tangent plane of each vertex.
        tethers: (vertices,) t, over the stiffness against stretching, per squared length.
        still: (vertices,) True for those that do not move.
    """

    positions: Floats
    triangles: Ints
    axes: Floats
    tethers: Floats
    still: Bools

    def slides(self, loads: Floats) -> Floats:
        """(loads, vertices, 3) slides under (loads, vertices, 3) forces per area."""
        from scipy.sparse import coo_matrix

        areas, gradients = _gradients(self.positions[self.triangles])
        stiffness = (
            _stiffness(self.axes[:, self.triangles], gradients, self.positions[self.triangles]) * areas[:, None, None]
        )
        masses = np.bincount(self.triangles.reshape(-1), np.repeat(areas / 3.0, 3), len(self.positions))
        unknowns = (2 * self.triangles[:, :, None] + np.arange(2)).reshape(-1, 6)
        rows, columns = np.repeat(unknowns, 6, axis=1).reshape(-1), np.tile(unknowns, (1, 6)).reshape(-1)
        free = np.flatnonzero(~np.repeat(self.still, 2))
        count = 2 * len(self.positions)
        diagonal = np.repeat(masses * self.tethers, 2)
        whole = coo_matrix(
            (
                np.concatenate([stiffness.reshape(-1), diagonal]),
                (np.concatenate([rows, np.arange(count)]), np.concatenate([columns, np.arange(count)])),
            ),
            shape=(count, count),
        ).tocsc()
        forces = np.einsum("avx,lvx,v->lva", self.axes, loads, masses).reshape(len(loads), count)
        found = np.zeros((len(loads), count))
        if len(free):
            found[:, free] = factorised(whole[free][:, free]).solve(forces[:, free].T.copy()).T
        return np.asarray(np.einsum("lva,avx->lvx", found.reshape(len(loads), -1, 2), self.axes))


def _planes(corners: Floats) -> Floats:
    """(triangles, 2, 3) orthogonal unit vectors in the planes of (triangles, 3, 3) corners."""
    along = corners[:, 1] - corners[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    other = corners[:, 2] - corners[:, 0]
    across = other - np.sum(other * along, axis=1, keepdims=True) * along
    return np.stack([along, across / np.linalg.norm(across, axis=1, keepdims=True)], axis=1)


def _gradients(corners: Floats) -> tuple[Floats, Floats]:
    """(triangles,) areas, and (triangles, 3, 2) gradients of each corner's share in the triangle's plane."""
    planes = _planes(corners)
    flat = np.einsum("tax,tkx->tka", planes, corners - corners[:, :1])
    edges = np.stack([flat[:, 2] - flat[:, 1], flat[:, 0] - flat[:, 2], flat[:, 1] - flat[:, 0]], axis=1)
    doubled = edges[:, 2, 0] * -edges[:, 1, 1] + edges[:, 2, 1] * edges[:, 1, 0]
    return doubled / 2.0, np.stack([-edges[:, :, 1], edges[:, :, 0]], axis=2) / doubled[:, None, None]


def _stiffness(axes: Floats, gradients: Floats, corners: Floats) -> Floats:
    """(triangles, 6, 6) stiffness per area, of (2, triangles, 3, 3) axes at the corners."""
    turned = np.einsum("tax,btkx->tkba", _planes(corners), axes)  # the part of each unknown along the plane's axes
    count = len(corners)
    strains = np.zeros((count, 3, 3, 2))
    strains[:, 0] = gradients[:, :, 0, None] * turned[..., 0]
    strains[:, 1] = gradients[:, :, 1, None] * turned[..., 1]
    strains[:, 2] = gradients[:, :, 1, None] * turned[..., 0] + gradients[:, :, 0, None] * turned[..., 1]
    rows = strains.reshape(count, 3, 6)
    law = np.array([[1.0, POISSON, 0.0], [POISSON, 1.0, 0.0], [0.0, 0.0, (1.0 - POISSON) / 2.0]])
    return np.asarray(np.einsum("tsi,sr,trj->tij", rows, law, rows))


def stretches(before: Floats, after: Floats) -> Floats:
    """(…, triangles) least stretches from (triangles, 3, 3) to (…, triangles, 3, 3) corners; below 0 where turned over.

    A triangle has turned over if it faces away from where it faced before.
    """
    _, gradients = _gradients(before)
    deformed = np.einsum("...tkx,tka->...tax", after, gradients)
    one, other = deformed[..., 0, :], deformed[..., 1, :]
    ones, others = np.sum(one**2, axis=-1), np.sum(other**2, axis=-1)
    half, product = (ones + others) / 2.0, ones * others - np.sum(one * other, axis=-1) ** 2
    least = np.sqrt(np.maximum(half - np.sqrt(np.maximum(half**2 - product, 0.0)), 0.0))
    planes = _planes(before)
    facing = np.sum(np.cross(planes[:, 0], planes[:, 1]) * np.cross(one, other), axis=-1)
    return np.asarray(np.where(facing > 0, least, -least))
