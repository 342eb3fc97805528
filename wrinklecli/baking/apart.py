"""Bounds on how far two bodies of the same vertices and joints are apart in some frames.

If p are bind positions, d morphed displacements, w skin weights, and M the matrices of joints with linear parts A, the
bodies 1 and 2 have a vertex apart by

    Σ M (w₂ p₂ − w₁ p₁)  +  Σ w₂ A (d₂ − d₁)  +  Σ (w₂ − w₁) A d₁

A sum over joints is at most as long as its vectors, times the weights, times the greatest factor by which a joint
stretches a vector. So the distance is at most a static one, of shapes and skin, and what the weights of shapes are off.
The few vertices whose skin weights differ by more than rounding are posed.
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from wrinklecli.character.skin import Skin, pose
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.portions import portions

# The diagonal of a cube of size 1: the length of a vector is at most its largest coordinate times this.
_DIAGONAL = 3.0**0.5
# Sum of the differences of skin weights above which a vertex is posed: float32 weights of four joints differ by less.
_ROUNDED = 1e-6
# Difference of factors, over the greatest, below which one stands for all: float32 matrices differ by less.
_ALIKE = 1e-5


@dataclass(frozen=True, slots=True)
class Frames:
    """A body's state in some frames.

    Attributes:
        matrices: (frames, joints, 4, 4) bind to world space.
        weights: (frames, shapes) of the skin's own shapes.
        offsets: (frames, 3, vertices) added to the positions, bind space; None if nothing is added.
    """

    matrices: Floats
    weights: Floats
    offsets: Floats | None

    def pose(self, skin: Skin, vertices: Ints) -> Floats:
        """(frames, 3, vertices) world positions of some vertices."""
        offsets = None if self.offsets is None else self.offsets[:, :, vertices]
        return pose(skin.of(vertices), self.matrices, self.weights, offsets)[0]

    def displacements(self, skin: Skin) -> Floats:
        """(frames, 3, vertices) displacements from the bind positions, bind space."""
        if self.offsets is not None and skin.places.shape[1] == 1:
            return self.offsets  # there are no shapes
        morphed: Floats = np.matmul(self.weights, skin.places[:, 1:]).transpose(1, 0, 2)
        return morphed if self.offsets is None else morphed + self.offsets


@dataclass(frozen=True)
class Pair:
    """Two bodies of the same vertices and joints."""

    first: Skin
    second: Skin

    @cached_property
    def _moved_weight(self) -> Floats:
        """(vertices,) sums of the differences of skin weights without their signs."""
        found = [np.abs(second - first).sum(axis=0) for first, second in self._dense()]
        return np.concatenate([np.zeros(0), *found])

    def _dense(self) -> Iterator[tuple[Floats, Floats]]:
        """(joints, vertices) skin weights of both, of some vertices after the other."""
        for part in portions(len(self.first), 16):
            yield self.first.influences.at(part).dense(), self.second.influences.at(part).dense()

    @cached_property
    def _gaps(self) -> Floats:
        """(vertices,) distances of the bind positions."""
        return np.asarray(_lengths(self.second.places[None, :, 0] - self.first.places[None, :, 0])[0])

    @cached_property
    def _reach(self) -> float:
        """The greatest sum of a coordinate and its displacements by all own shapes, without their signs."""
        return max(float(np.abs(each.places).sum(axis=1).max(initial=0.0)) for each in (self.first, self.second))

    def bounds(self, before: Frames, after: Frames) -> Floats:
        """(frames, vertices) distances in world space that none exceeds; those of vertices that are posed are exact.

        Args:
            before: The state of the first body.
            after: The state of the second.
        """
        posed = np.arange(len(self._gaps))
        found = np.zeros((len(before.matrices), len(posed)))
        if np.array_equal(before.matrices, after.matrices):
            found = self._bounds(before, after)
            posed = np.flatnonzero(self._moved_weight > _ROUNDED)
        if len(posed):
            found[:, posed] = _lengths(after.pose(self.second, posed) - before.pose(self.first, posed))
        return found

    def _bounds(self, before: Frames, after: Frames) -> Floats:
        """(frames, vertices) the same of bodies with equal joints, by the formula alone."""
        linear, origins = before.matrices[:, :, :3, :3], before.matrices[:, :, :3, 3]
        # The square of a joint's factor is an eigenvalue of the transposed matrix times itself: at most a sum of a row.
        squares = np.abs(linear.transpose(0, 1, 3, 2) @ linear).sum(axis=3)
        factors = np.sqrt(squares.max(axis=2, initial=0.0))
        if np.ptp(factors) <= _ALIKE * factors.max(initial=0.0):
            # Joints that only turn stretch nothing: skin weights sum to 1.
            stretches = np.full((len(factors), 1), factors.max(initial=0.0))
        else:
            stretches = np.concatenate(
                [factors[:, :0], *(factors @ np.abs(second) for _, second in self._dense())], axis=1
            )
        # Two joints take one vertex to places that are no farther apart.
        spread = np.abs(origins - origins[:, :1]).sum(axis=2).max(axis=1, initial=0.0)
        spread += 2.0 * factors.max(axis=1, initial=0.0) * _DIAGONAL * self._reach
        first, second = before.displacements(self.first), after.displacements(self.second)
        farthest = max(float(first.max(initial=0.0)), -float(first.min(initial=0.0)))
        moved = farthest * _DIAGONAL * factors.max(axis=1, initial=0.0)
        found: Floats = stretches * (self._gaps + _lengths(second - first))
        found += (spread + moved)[:, None] * self._moved_weight
        return found


def _lengths(vectors: Floats) -> Floats:
    """(frames, vertices) lengths of (frames, 3, vertices) vectors."""
    return np.asarray(np.sqrt(np.einsum("fxv,fxv->fv", vectors, vectors)))
