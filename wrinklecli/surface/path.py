"""Paths: the line that a tool follows on the surface at rest, and the coordinates of places along it and across it.

Two anchors are joined by a straight line, as in the paper. More are joined by a smooth curve: a place belongs to the
nearest point of the curve, so lines across the curve fan out where it bends.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, which names curved tools as future work.
Source of the curve: C. Yuksel, *A Class of C2 Interpolating Splines*, ACM Transactions on Graphics 39(5), 2020, with
circular arcs. Differs: the curve is sampled and measured by its length, and it also meets the surface halfway between
two anchors.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, cross, unit
from wrinklecli.numeric.portions import portions

# Maps a (3,) point to the nearest point of the surface and the unit normal there.
Foot: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]

# Two normals face opposite ways if their sum, projected across the line, is shorter than this.
_LEAST_MEAN = 1e-3
# Pieces of the curve between an anchor and halfway to the next: 8° each where the curve bends most.
_PIECES = 8
# A surface further from the curve than this fraction of two anchors' distance is another part of the surface.
_NEAR = 0.5
# An arc that spans less than this is replaced by its chord, radians.
_LEAST_ANGLE = 1e-6
# Greatest turn of a path at an anchor, degrees: arcs through sharper turns are loops.
_MOST_TURN = 120.0
# The stretch of a place is at most this, times how much further the second nearest part of the path is, as a fraction.
_ALONE = 2.0


@dataclass(frozen=True, slots=True)
class Located:
    """Coordinates of places relative to a path.

    Attributes:
        u: (…,) coordinate along the path: 0 at its first anchor, 1 at its last.
        across: (…,) signed distance from the path, positive towards tangent × normal, scene units.
        stretches: (…,) length of a step at the place for a unit step on the path. It is 1 on the path, less on the
            inside of a bend, and 0 at the bend's centre, beyond which the map folds, and halfway to another part of the
            path, where the map jumps. None if it is 1 everywhere.
    """

    u: Floats
    across: Floats
    stretches: Floats | None


@dataclass(frozen=True, slots=True)
class Straight:
    """The segment between two anchors, in world space at rest.

    Attributes:
        start: (3,) the first anchor.
        along: (3,) unit vector to the second anchor.
        normal: (3,) unit normal: the mean of both anchors' normals, projected across the segment.
        length: Scene units.
    """

    start: Floats
    along: Floats
    normal: Floats
    length: float

    @property
    def sideways(self) -> Floats:
        """(3,) unit vector across the segment, to the positive side."""
        return np.array(cross(self.along, self.normal))

    @property
    def middle(self) -> Floats:
        """(3,) the point halfway."""
        return self.start + 0.5 * self.length * self.along

    def locate(self, positions: Floats) -> Located:
        """Coordinates of (…, 3) world positions at rest."""
        relative = positions - self.start
        return Located(relative @ self.along / self.length, relative @ self.sideways, None)

    def cosines(self, _u: Floats, normals: Floats) -> Floats:
        """(…,) cosines between (…, 3) unit normals and the path's normal."""
        return normals @ self.normal

    def directions(self, u: Floats) -> Floats:
        """(…, 3) unit vectors along the path at (…,) u."""
        return np.broadcast_to(self.along, (*u.shape, 3))

    def depths(self, positions: Floats) -> Floats:
        """(…,) heights of (…, 3) positions above the path, along its normal."""
        return (positions - self.start) @ self.normal

    def box(self, across: float) -> tuple[Floats, Floats, Floats, Floats]:
        """The box of places up to a distance across: a point, (axes, 3), and least and greatest (axes,) coordinates."""
        axes = np.stack([self.along / self.length, self.sideways / across])
        return self.start, axes, np.array([0.0, -1.0]), np.array([1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve through more than two anchors, as samples along it in world space at rest.

    Attributes:
        points: (samples, 3).
        tangents: (samples, 3) unit vectors.
        bends: (samples, 3) derivatives of the tangents along the curve, one over scene units.
        normals: (samples, 3) unit normals across the curve: the anchors' own at the anchors.
        arc_lengths: (samples,) length of the curve up to each sample, scene units.
    """

    points: Floats
    tangents: Floats
    bends: Floats
    normals: Floats
    arc_lengths: Floats

    @property
    def length(self) -> float:
        """Scene units."""
        return float(self.arc_lengths[-1])

    @property
    def knots(self) -> Floats:
        """(2 anchors - 1, 3) the anchors, and the points of the surface halfway between two; the curve meets all."""
        return self.points[::_PIECES]

    @property
    def sharpest(self) -> tuple[float, int]:
        """Least radius of the curve's bends within the surface, scene units, and the index of the nearest anchor."""
        bends = np.abs(np.sum(self.bends * np.cross(self.tangents, self.normals), axis=1))
        sample = int(np.argmax(bends))
        return (1.0 / float(bends[sample]) if bends[sample] else np.inf), round(sample / (2 * _PIECES))

    @property
    def between(self) -> Floats:
        """(2 anchors - 2, 3) points of the curve halfway between two knots, which may be furthest from the mesh."""
        return self.points[_PIECES // 2 :: _PIECES]

    @property
    def along(self) -> Floats:
        """(3,) unit vector along the curve in its middle."""
        return unit(self._at(self.tangents, np.array(0.5)))

    @property
    def normal(self) -> Floats:
        """(3,) unit normal in the curve's middle."""
        return unit(self._at(self.normals, np.array(0.5)))

    @property
    def middle(self) -> Floats:
        """(3,) the point halfway along the curve."""
        return self._at(self.points, np.array(0.5))

    def locate(self, positions: Floats) -> Located:
        """Coordinates of (…, 3) world positions at rest, by the nearest point of the curve."""
        flat = positions.reshape(-1, 3)
        parts = [self._locate(flat[part]) for part in portions(max(len(flat), 1), len(self.points))]
        shape = positions.shape[:-1]
        u, across, stretches = (np.concatenate(each).reshape(shape) for each in zip(*parts, strict=True))
        return Located(u, across, stretches)

    def _locate(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        """The three fields of `Located` for (places, 3) positions."""
        last = len(self.points) - 1
        # Signed distance of each place from the plane across the curve at each sample, and squared distance from the
        # sample. Both are relative to the start, since products of coordinates lose digits far from the origin.
        relative, points = positions - self.points[0], self.points - self.points[0]
        ahead = relative @ self.tangents.T - np.einsum("sx,sx->s", points, self.tangents)
        apart = np.sum(relative**2, axis=1)[:, None] - 2.0 * relative @ points.T + np.sum(points**2, axis=1)
        # A place belongs to a piece if it is ahead of its first plane and behind its second, or to the end it is past.
        between = np.zeros((len(positions), last + 2), bool)
        between[:, 0], between[:, -1] = ahead[:, 0] < 0, ahead[:, -1] >= 0
        between[:, 1:-1] = (ahead[:, :-1] >= 0) & (ahead[:, 1:] < 0)
        squared = np.where(between, np.maximum(apart[:, [0, *range(last + 1)]], 0.0), np.inf)
        piece = np.argmin(squared, axis=1)
        nearest, second_nearest = np.sqrt(np.partition(squared, 1, axis=1)[:, :2].T)
        alone = 1.0 - np.divide(nearest, second_nearest, out=np.zeros(len(positions)), where=second_nearest > 0)
        rows = np.arange(len(positions))
        first, second = np.clip(piece - 1, 0, last), np.clip(piece, 0, last)
        inside = first != second
        before, behind = ahead[rows, first], ahead[rows, second]
        t = np.divide(before, before - behind, out=np.zeros(len(positions)), where=inside)
        past = np.where(inside, 0.0, before)

        def mixed(values: Floats) -> Floats:
            share = t if values.ndim == 1 else t[:, None]
            return np.asarray(values[first] + share * (values[second] - values[first]))

        tangents = mixed(self.tangents)
        away = relative - mixed(points) - past[:, None] * tangents
        sideways = unit(np.cross(tangents, mixed(self.normals)))
        stretches = 1.0 - np.where(inside, np.einsum("px,px->p", away, mixed(self.bends)), 0.0)
        u, across = (mixed(self.arc_lengths) + past) / self.length, np.einsum("px,px->p", away, sideways)
        return u, across, np.minimum(stretches, _ALONE * alone)

    def _at(self, vectors: Floats, u: Floats) -> Floats:
        """(…, 3) vectors interpolated from (samples, 3) at (…,) u."""
        return np.stack([np.interp(u * self.length, self.arc_lengths, axis) for axis in vectors.T], axis=-1)

    def cosines(self, u: Floats, normals: Floats) -> Floats:
        """(…,) cosines between (…, 3) unit normals and the curve's normals at (…,) u."""
        return np.asarray(np.sum(normals * unit(self._at(self.normals, u)), axis=-1))

    def directions(self, u: Floats) -> Floats:
        """(…, 3) unit vectors along the curve at (…,) u."""
        return unit(self._at(self.tangents, u))

    def depths(self, positions: Floats) -> Floats:
        """(…,) heights of (…, 3) positions above the curve, along its normals."""
        u = self.locate(positions).u
        return self.cosines(u, positions - self._at(self.points, u))

    def box(self, across: float) -> tuple[Floats, Floats, Floats, Floats]:
        """A box of all places up to a distance across: a point, (axes, 3), least and greatest (axes,) coordinates."""
        # A surface falls away beside the curve as far as it goes sideways, or as a limb is thick.
        reach = 2.0 * across + 0.5 * self.length
        low, high = self.points.min(axis=0) - reach, self.points.max(axis=0) + reach
        return np.zeros(3), np.eye(3), low, high


Path = Straight | Curve


def path_through(
    points: Sequence[Floats], normals: Sequence[Floats], foot: Foot, *, names: Sequence[str], where: str
) -> Path:
    """Make the path through a tool's anchors, with their (3,) points, no two neighbours equal, and unit normals.

    Raises:
        BakeError: The surface faces opposite ways at two neighbours, or the path turns back.
    """
    steps = [b - a for a, b in pairwise(points)]
    lengths = [float(np.linalg.norm(step)) for step in steps]
    means = []
    for k, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        along, mean = step / length, normals[k] + normals[k + 1]
        means.append(mean - (mean @ along) * along)
        if np.linalg.norm(means[k]) < _LEAST_MEAN:
            raise BakeError(f"the surface faces opposite ways at {names[k]} and {names[k + 1]}", where=where)
    if len(points) == 2:
        return Straight(points[0], steps[0] / lengths[0], unit(means[0]), lengths[0])
    for k, (a, b) in enumerate(pairwise(steps)):
        turn = float(np.degrees(np.arccos(np.clip(a @ b / (lengths[k] * lengths[k + 1]), -1.0, 1.0))))
        if turn > _MOST_TURN:
            raise BakeError(
                f"turns by {turn:.0f}° at {names[k + 1]}, but at most {_MOST_TURN:.0f}° is possible: add points there",
                where=where,
            )
    return curve_on(*_halved(np.stack(points), np.stack(normals), foot))


def curve_on(places: Floats, facing: Floats) -> Curve:
    """The smooth curve through (places, 3) points of a surface, with its (places, 3) normals there."""
    points, vectors = _spline(places, facing, _PIECES)
    arc_lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    tangents = unit(np.gradient(points, arc_lengths, axis=0, edge_order=2))
    bends = np.gradient(tangents, arc_lengths, axis=0)
    normals = unit(vectors - np.sum(vectors * tangents, axis=1, keepdims=True) * tangents)
    return Curve(points, tangents, bends, normals, arc_lengths)


def _halved(places: Floats, facing: Floats, foot: Foot) -> tuple[Floats, Floats]:
    """(2 anchors - 1, 3) points and normals: the anchors' and, between each two, those of the surface halfway."""
    middles, normals = (values[1::2] for values in _spline(places, facing, 2))
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    both = np.zeros((2, 2 * len(places) - 1, 3))
    both[:, ::2] = places, facing
    for k, (middle, normal) in enumerate(zip(middles, unit(normals), strict=True)):
        found = foot(middle)
        # Over a gap or a fold of the surface the curve leaves it.
        near = np.linalg.norm(found[0] - middle) < _NEAR * lengths[k] and found[1] @ normal > 0
        both[:, 2 * k + 1] = found if near else (middle, normal)
    return both[0], both[1]


def _spline(places: Floats, facing: Floats, pieces: int) -> tuple[Floats, Floats]:
    """(samples, 3) points on the smooth curve through (places, 3), with `pieces` between two places, and normals."""
    t = np.linspace(0.0, 1.0, pieces + 1)[1:, None]
    # Weight of the second of the two arcs between two places, and of the second normal.
    share = np.sin(0.5 * np.pi * t) ** 2
    points, normals = [places[:1]], [facing[:1]]
    for k in range(len(places) - 1):
        thirds = [places[third] for third in (k - 1, k + 2) if 0 <= third < len(places)]
        arcs = [_arc(places[k], places[k + 1], third, t) for third in thirds]
        points.append(arcs[0] + share * (arcs[-1] - arcs[0]))
        normals.append(facing[k] + share * (facing[k + 1] - facing[k]))
    return np.concatenate(points), np.concatenate(normals)


def _arc(start: Floats, end: Floats, third: Floats, t: Floats) -> Floats:
    """(times, 3) points, at (times, 1) t from 0 to 1, on the arc from start to end of the circle through a third point.

    The third point is not on the arc.
    """
    chord = end - start
    length = float(np.linalg.norm(chord))
    along = chord / length
    one, other = start - third, end - third
    # Half of the arc's angle is the angle at which the arc is seen from the third point (Euclid III.20).
    half = np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
    if half < _LEAST_ANGLE:
        return start + t * chord
    outwards = -unit(third - start - ((third - start) @ along) * along)
    turned, radius = (2.0 * t - 1.0) * half, 0.5 * length / np.sin(half)
    return (start + end) / 2.0 + radius * (np.sin(turned) * along + (np.cos(turned) - np.cos(half)) * outwards)
