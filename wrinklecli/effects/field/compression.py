"""The compression of a surface in poses: how much shorter it becomes at each place, and in which direction.

Poses are measured by dual quaternions, which keep the girth of a bent or twisted limb. Linear blend skinning, which
engines play, lets it collapse, and would show compression all round a pit.

Source: L. Kavan, S. Collins, J. Žára, C. O'Sullivan, *Geometric Skinning with Approximate Dual Quaternion Blending*,
ACM Transactions on Graphics 27(4), 2008.
"""

import numpy as np

from wrinklecli.character.motion import quaternion_product, turned_back
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, cross, dot, face_normals, unit

# Greatest stretch that counts, as a part of the length: triangles of almost no area may have any.
_MOST = 1.0


def rigid_parts(matrices: Floats, to_bind: Floats) -> tuple[Floats, Floats]:
    """Unit dual quaternions of (joints, 4, 4) matrices against those at rest: (joints, 4) real and dual parts.

    Scale and shear are left out. Quaternions are x, y, z, w. `to_bind` are the inverses of the matrices at rest.
    """
    moved = matrices @ to_bind
    one, _, other = np.linalg.svd(moved[:, :3, :3])
    turns = one @ other
    turns = turns * np.sign(np.linalg.det(turns))[:, None, None]
    real = quaternions_of(turns)
    shift = np.concatenate([moved[:, :3, 3], np.zeros((len(moved), 1))], axis=1)
    return real, 0.5 * quaternion_product(shift, real)


def quaternions_of(turns: Floats) -> Floats:
    """(n, 4) unit quaternions of (n, 3, 3) rotation matrices.

    Source: the symmetric matrix of I. Y. Bar-Itzhack, *New Method for Extracting the Quaternion from a Rotation
    Matrix*, 2000: its largest eigenvector.
    """
    form = np.zeros((len(turns), 4, 4))
    trace = np.trace(turns, axis1=1, axis2=2)
    form[:, :3, :3] = turns + turns.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
    form[:, :3, 3] = form[:, 3, :3] = np.stack(
        [turns[:, (k + 2) % 3, (k + 1) % 3] - turns[:, (k + 1) % 3, (k + 2) % 3] for k in range(3)], axis=1
    )
    form[:, 3, 3] = trace
    found: Floats = np.linalg.eigh(form)[1][:, :, 3]
    return found * np.where(found[:, 3:] < 0, -1.0, 1.0)


def posed_rigidly(positions: Floats, joints: Ints, weights: Floats, parts: tuple[Floats, Floats]) -> Floats:
    """(…, vertices, 3) positions moved by blended dual quaternions, with (vertices, influences) joints and weights."""
    real, dual = parts
    heaviest = np.take_along_axis(joints, np.argmax(weights, axis=1)[:, None], axis=1)
    ways = np.where(np.sum(real[joints] * real[heaviest], axis=2) < 0, -weights, weights)
    one, other = (np.einsum("vk,vkq->vq", ways, each[joints]) for each in (real, dual))
    size = np.linalg.norm(one, axis=1, keepdims=True)
    one, other = one / size, other / size
    axis, twice = one[:, :3], 2.0 * np.cross(one[:, :3], positions)
    turned = positions + one[:, 3:] * twice + np.cross(axis, twice)
    return np.asarray(turned + 2.0 * quaternion_product(other, turned_back(one))[:, :3])


@dataclass(frozen=True, slots=True, eq=False)
class Gauges:
    """Strain gauges on the triangles of a surface at rest.

    Attributes:
        triangles: (triangles, 3).
        axes: (triangles, 2, 3) orthogonal unit vectors in each plane.
        inverse: (triangles, 3) 1 / length of the first edge; the second edge's part along it, over that length, and 1 /
            its part across.
    """

    triangles: Ints
    axes: Floats
    inverse: Floats

    @classmethod
    def of(cls, positions: Floats, triangles: Ints) -> "Gauges":
        """Lay gauges on triangles, none of which may be without area."""
        a, b, c = (positions[triangles[:, k]] for k in range(3))
        first, normal = unit(b - a), unit(face_normals(positions, triangles))
        second = np.cross(normal, first)
        length, across = np.sum((b - a) * first, axis=1), np.sum((c - a) * second, axis=1)
        inverse = np.stack([1.0 / length, np.sum((c - a) * first, axis=1) / length, 1.0 / across], axis=1)
        return cls(triangles, np.stack([first, second], axis=1), inverse)

    def of_some(self, chosen: Ints) -> "Gauges":
        """Those of some triangles, by their numbers."""
        return Gauges(self.triangles[chosen], self.axes[chosen], self.inverse[chosen])

    def strains(self, posed: Floats, outward: Floats | None = None) -> Floats:
        """(triangles, 6) Biot strain U − I of (vertices, 3) posed positions: xx, yy, zz, xy, yz, zx at rest.

        Unlike those of other strains, its averages are the mean length that is lost. A bend that is narrower than the
        limb is thick turns its inside over: its triangles have lost more than all of their length.

        Args:
            posed: The positions.
            outward: (vertices, 3) where the outer side is, if triangles may be turned over.
        """
        # Coordinate by coordinate, as numpy takes several times as long along axes of three.
        a, b, c = (posed.T.take(corner, axis=1) for corner in self.triangles.T)
        first, part, second = self.inverse.T
        one = (b - a) * first
        other = (c - a - (b - a) * part) * second
        xx, xy, yy = dot(one, one), dot(one, other), dot(other, other)
        middle, spread = (xx + yy) / 2.0, np.hypot((xx - yy) / 2.0, xy)
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        long, short = (np.sqrt(np.maximum(middle + sign * spread, 0.0)) for sign in (1, -1))
        if outward is not None:
            up = np.sum([outward.T.take(corner, axis=1) for corner in self.triangles.T], axis=0)
            short = np.where(dot(cross(one, other), up) < 0.0, -short, short)
        long, short = np.minimum(long - 1.0, _MOST), np.minimum(short - 1.0, _MOST)
        cosine, sine = np.cos(angle), np.sin(angle)
        p, q = self.axes.transpose(1, 2, 0)
        along, across = cosine * p + sine * q, cosine * q - sine * p
        pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
        return np.stack([long * (along[i] * along[j]) + short * (across[i] * across[j]) for i, j in pairs], axis=1)


def along(tensors: Floats, one: Floats, other: Floats) -> Floats:
    """(n,) products one · T · other of (n, 6) symmetric tensors and (n, 3) vectors."""
    (a, b, c), (p, q, r), (xx, yy, zz, xy, yz, zx) = one.T, other.T, tensors.T
    mixed = (a * q + b * p) * xy + (b * r + c * q) * yz + (c * p + a * r) * zx
    return np.asarray(a * p * xx + b * q * yy + c * r * zz + mixed)


def shortest(tensors: Floats, axes: tuple[Floats, Floats]) -> tuple[Floats, Floats, Floats]:
    """The least of (vertices, 6) strains in the planes of two (vertices, 3) `tangents`.

    Returns:
        (vertices,) the least, (vertices, 3) its unit directions, and (vertices,) the strain across these.
    """
    first, second = axes
    xx, xy, yy = along(tensors, first, first), along(tensors, first, second), along(tensors, second, second)
    middle, spread = (xx + yy) / 2.0, np.hypot((xx - yy) / 2.0, xy)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) + np.pi / 2.0
    direction = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return middle - spread, direction, middle + spread
