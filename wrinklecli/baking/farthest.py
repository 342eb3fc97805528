"""The vertex that two bodies have farthest apart, found without posing the others.

The two have the same vertices and hang on the same joints. A bound of each distance takes a few sums, but no blended
matrices; a vertex is posed if its bound reaches the greatest distance found so far.

If p are bind positions, d morphed displacements, w skin weights, and M the matrices of joints with linear parts A, the
bodies 1 and 2 have a vertex apart by

    Σ M (w₂ p₂ − w₁ p₁)  +  Σ w₂ A (d₂ − d₁)  +  Σ (w₂ − w₁) A d₁

A sum over joints is at most as long as its vectors, times the weights, times the greatest factor by which a joint
stretches a vector.
"""

from functools import cached_property

import numpy as np

from wrinklecli.character.skin import Skin, pose
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values

# Relative error of positions in float64 after some dozens of products and sums: bounds are wider by as much.
_ROUNDING = 1e-13
# Part of all vertices and frames that are posed at once without a look at finer bounds, which take as long.
_FEW = 0.02
# Numbers in the table of finer bounds, at most: 128 MB.
_MOST_FACTORS = 2**24
# The diagonal of a cube of size 1: the length of a vector is at most its largest coordinate times this.
_DIAGONAL = 3.0**0.5


@dataclass(frozen=True)
class Pair:
    """Two bodies of the same vertices and joints."""

    first: Skin
    second: Skin

    @cached_property
    def total(self) -> Floats:
        """(vertices,) sums of the second body's weights without their signs: 1, but for rounding."""
        found: Floats = np.abs(self.second.weights).sum(axis=0)
        return found

    @cached_property
    def moved_weight(self) -> Floats:
        """(vertices,) sums of the differences of weights without their signs."""
        found: Floats = np.abs(self.second.weights - self.first.weights).sum(axis=0)
        return found

    @cached_property
    def gaps(self) -> Floats:
        """(vertices,) distances of the bind positions."""
        found: Floats = _lengths(self.second.places[None, :, 0] - self.first.places[None, :, 0])[0]
        return found

    @cached_property
    def reach(self) -> float:
        """The greatest sum of a coordinate and its displacements by all shapes, without their signs."""
        return max(float(np.abs(each.places).sum(axis=1).max(initial=0.0)) for each in (self.first, self.second))

    @cached_property
    def factors(self) -> Floats:
        """(4 joints, vertices) differences w₂ p₂ − w₁ p₁ and w₂ − w₁, joint by joint."""
        shares = (self.second.weights - self.first.weights)[:, None]
        apart = self.second.places[:, 0] - self.first.places[:, 0]
        linear = self.second.weights[:, None] * apart + shares * self.first.places[:, 0]
        found: Floats = np.concatenate([linear, shares], axis=1).reshape(-1, shares.shape[2])
        return found


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

    def pose(self, skin: Skin, frames: Ints, vertices: Ints) -> Floats:
        """(frames, 3, vertices) world positions of some vertices in some frames."""
        offsets = None if self.offsets is None else self.offsets[np.ix_(frames, np.arange(3), vertices)]
        return pose(skin.of(vertices), self.matrices[frames], self.weights[frames], offsets)[0]

    def displacements(self, skin: Skin) -> Floats | None:
        """(frames, 3, vertices) displacements from the bind positions, bind space; None if there are none."""
        if not self.weights.any():
            return self.offsets
        morphed: Floats = np.matmul(self.weights, skin.places[:, 1:]).transpose(1, 0, 2)
        return morphed if self.offsets is None else morphed + self.offsets


def farthest(pair: Pair, before: Frames, after: Frames, known: float) -> tuple[float, int]:
    """The greatest distance of a vertex, and its frame; 0 if none exceeds the `known` one.

    Args:
        pair: The two bodies.
        before: The state of the first in some frames.
        after: The state of the second.
        known: Distances up to this one need not be found.
    """

    def distances(frames: Ints, vertices: Ints) -> Floats:
        apart = after.pose(pair.second, frames, vertices) - before.pose(pair.first, frames, vertices)
        found: Floats = _lengths(apart).max(axis=1)
        return found

    every = np.arange(len(before.matrices))
    bounds, slack = bounds_of(pair, before, after), rounding(pair, before)
    if not bounds.size or bounds.max() < known - slack:
        return 0.0, 0
    if np.isfinite(bounds).all():
        reached = max(known, float(distances(every, distinct_values(bounds.argmax(axis=1))).max()))
        if (bounds >= reached).mean() > _FEW and pair.first.weights.size < _MOST_FACTORS / 4:
            bounds = finer_bounds(pair, before, after)
        near = bounds >= reached - slack
    else:
        near = np.ones(bounds.shape, bool)
    frames, vertices = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    if not len(frames):
        return 0.0, 0
    found = distances(frames, vertices)
    return float(found.max()), int(frames[found.argmax()])


def bounds_of(pair: Pair, before: Frames, after: Frames) -> Floats:
    """(frames, vertices) distances that none exceeds; infinite if the joints of the two bodies stand differently."""
    if not np.array_equal(before.matrices, after.matrices):
        return np.full((len(before.matrices), len(pair.total)), np.inf)
    stretch, (_, origins) = _stretch(before), _parts(before)
    most = float(stretch.max(initial=0.0))
    # Two joints take one vertex to places that are no farther apart.
    spread = float(np.abs(origins - origins[:, :1]).sum(axis=2).max(initial=0.0)) + 2.0 * most * _DIAGONAL * pair.reach
    always = most * pair.total * pair.gaps + spread * pair.moved_weight
    moving = _moving(pair, before, after, stretch)
    return np.broadcast_to(always, (len(stretch), len(always))) if moving is None else always + moving


def finer_bounds(pair: Pair, before: Frames, after: Frames) -> Floats:
    """(frames, vertices) the same of bodies with equal joints, exact for vertices that no shape displaces."""
    rows = before.matrices[:, :, :3]
    fixed = rows.transpose(0, 2, 1, 3).reshape(3 * len(rows), -1) @ pair.factors
    found, moving = _lengths(fixed.reshape(len(rows), 3, -1)), _moving(pair, before, after, _stretch(before))
    return found if moving is None else found + moving


def rounding(pair: Pair, frames: Frames) -> float:
    """The error of a distance by rounding, at most, scene units."""
    linear, origins = _parts(frames)
    reach = pair.reach + _largest(frames.offsets)
    return _ROUNDING * float(np.abs(linear).sum(axis=3).max(initial=0.0) * reach + np.abs(origins).max(initial=0.0))


def _moving(pair: Pair, before: Frames, after: Frames, stretch: Floats) -> Floats | None:
    """(frames, vertices) bounds of the two sums over displacements; None if there are none."""
    displaced, again = before.displacements(pair.first), after.displacements(pair.second)
    if displaced is None and again is None:
        return None
    apart = again if displaced is None else -displaced if again is None else again - displaced
    assert apart is not None
    found = _lengths(apart)
    found *= pair.total
    found += _DIAGONAL * _largest(displaced) * pair.moved_weight
    found *= stretch[:, None]
    return found


def _stretch(frames: Frames) -> Floats:
    """(frames,) the greatest factor by which a joint stretches a vector, or a little more.

    The square of the factor is an eigenvalue of the transposed matrix times itself, and so at most a sum of a row.
    """
    linear, _ = _parts(frames)
    squares = np.abs(linear.transpose(0, 1, 3, 2) @ linear).sum(axis=3)
    greatest: Floats = np.sqrt(squares.max(axis=(1, 2), initial=0.0))
    return greatest


def _parts(frames: Frames) -> tuple[Floats, Floats]:
    """(frames, joints, 3, 3) linear parts and (frames, joints, 3) origins."""
    return frames.matrices[:, :, :3, :3], frames.matrices[:, :, :3, 3]


def _largest(numbers: Floats | None) -> float:
    """The largest of some numbers, without their signs; 0 without any."""
    if numbers is None:
        return 0.0
    return max(float(numbers.max(initial=0.0)), -float(numbers.min(initial=0.0)))


def _lengths(vectors: Floats) -> Floats:
    """(frames, vertices) lengths of (frames, 3, vertices) vectors."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    squares = x * x
    squares += y * y
    squares += z * z
    return np.sqrt(squares, out=squares)
