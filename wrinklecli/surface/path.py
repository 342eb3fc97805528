"""Paths: the line that a tool follows on the surface at rest, and where a place lies along it and across it.

Two anchors have a straight line between them, as in the paper. More have a smooth curve through them: a place belongs
to the point of the curve that is nearest, so what runs across the curve fans out where it bends.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, which names curved tools as work to come.
Source of the curve: C. Yuksel, *A Class of C2 Interpolating Splines*, ACM Transactions on Graphics 39(5), 2020, with
circular arcs. Differs: it is sampled, and measured by its length; halfway between two anchors it is on the surface too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Floats, unit

# The point of the surface nearest to a (3,) one, and the unit normal there.
Foot: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]

# Length of the sum of two anchors' normals, across the line, below which they face opposite ways.
_LEAST_MEAN = 1e-3
# Pieces of the curve between an anchor and halfway to the next: of 8° where it bends most.
_PIECES = 8
# A surface further from the curve than this part of the distance of two anchors is another.
_NEAR = 0.5
# Radians below which an arc is as good as its chord.
_LEAST_ANGLE = 1e-6
# Degrees by which a path may turn at an anchor: the arcs through sharper turns are loops.
_MOST_TURN = 120.0
# What a place counts as stretched by, times the part of its distance by which another part of the path is further.
_ALONE = 2.0
# Places by samples of a curve that are looked at together: bounds the memory.
_AT_ONCE = 2**20


@dataclass(frozen=True, slots=True)
class Located:
    """Where places lie by a path.

    Attributes:
        u: (…,) along it: 0 at its first anchor, 1 at its last.
        across: (…,) signed distance from it, to the side of tangent × normal, scene units.
        stretches: (…,) how long a step there is for one of the path: 1 on it, less on the inside of a bend, 0 at its
            centre, beyond which the map folds, and halfway to another part of the path, where it jumps. None where it
            is 1 everywhere.
    """

    u: Floats
    across: Floats
    stretches: Floats | None


@dataclass(frozen=True, slots=True)
class Straight:
    """The segment between two anchors.

    Attributes:
        start: (3,) the first anchor, world space at rest, as all that follows.
        along: (3,) unit vector to the second.
        normal: (3,) unit normal: the mean of both anchors', across the segment.
        length: Scene units.
    """

    start: Floats
    along: Floats
    normal: Floats
    length: float

    @property
    def sideways(self) -> Floats:
        """(3,) unit vector across, to the positive side."""
        return np.cross(self.along, self.normal)

    @property
    def middle(self) -> Floats:
        """(3,) halfway."""
        return self.start + 0.5 * self.length * self.along

    def locate(self, positions: Floats) -> Located:
        """Where (…, 3) world positions at rest lie."""
        relative = positions - self.start
        return Located(relative @ self.along / self.length, relative @ self.sideways, None)

    def cosines(self, _u: Floats, normals: Floats) -> Floats:
        """(…,) of (…, 3) unit normals, at (…,) places along, and the path's."""
        found: Floats = normals @ self.normal
        return found

    def directions(self, u: Floats) -> Floats:
        """(…, 3) unit vectors along it at (…,) u."""
        return np.broadcast_to(self.along, (*u.shape, 3))

    def depths(self, positions: Floats) -> Floats:
        """(…,) how far (…, 3) positions are above the path, along its normal."""
        return (positions - self.start) @ self.normal

    def box(self, across: float) -> tuple[Floats, Floats, Floats, Floats]:
        """What is no further across than a distance: a point, (axes, 3) and its least and greatest (axes,) on them."""
        axes = np.stack([self.along / self.length, self.sideways / across])
        return self.start, axes, np.array([0.0, -1.0]), np.array([1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve through more than two anchors, as samples along it.

    Attributes:
        points: (samples, 3) on it, world space at rest, as all that follows.
        tangents: (samples, 3) unit vectors.
        bends: (samples, 3) what tangents change by along it, one over scene units.
        normals: (samples, 3) unit normals, across it: anchors' own at the anchors.
        ways: (samples,) its length up to there, scene units.
    """

    points: Floats
    tangents: Floats
    bends: Floats
    normals: Floats
    ways: Floats

    @property
    def length(self) -> float:
        """Scene units."""
        return float(self.ways[-1])

    @property
    def knots(self) -> Floats:
        """(2 anchors - 1, 3) what it goes through: the anchors, and what lies on the surface halfway between two."""
        found: Floats = self.points[::_PIECES]
        return found

    @property
    def sharpest(self) -> tuple[float, int]:
        """The least radius of its bends within the surface, scene units, and the number of the anchor nearest to it."""
        bends = np.abs(np.sum(self.bends * np.cross(self.tangents, self.normals), axis=1))
        sample = int(np.argmax(bends))
        return (1.0 / float(bends[sample]) if bends[sample] else np.inf), round(sample / (2 * _PIECES))

    @property
    def between(self) -> Floats:
        """(2 anchors - 2, 3) points of it, two between each two anchors: those furthest from what lies on the mesh."""
        found: Floats = self.points[_PIECES // 2 :: _PIECES]
        return found

    @property
    def along(self) -> Floats:
        """(3,) unit vector of its direction in the middle."""
        return self._at(self.tangents, np.array(0.5))

    @property
    def normal(self) -> Floats:
        """(3,) unit normal in the middle."""
        return self._at(self.normals, np.array(0.5))

    @property
    def middle(self) -> Floats:
        """(3,) halfway along it."""
        way = 0.5 * self.length
        return np.array([np.interp(way, self.ways, axis) for axis in self.points.T])

    def locate(self, positions: Floats) -> Located:
        """Where (…, 3) world positions at rest lie: each by the nearest point of the curve."""
        flat = positions.reshape(-1, 3)
        chunk = max(_AT_ONCE // len(self.points), 1)
        parts = [self._locate(flat[k : k + chunk]) for k in range(0, max(len(flat), 1), chunk)]
        shape = positions.shape[:-1]
        u, across, stretches = (np.concatenate(each).reshape(shape) for each in zip(*parts, strict=True))
        return Located(u, across, stretches)

    def _locate(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        """As `locate`, of (places, 3)."""
        last = len(self.points) - 1
        # How far each place is ahead of the plane across the curve at each sample, and from the sample, squared.
        # Measured from its start: products of coordinates lose digits far from the origin.
        relative, points = positions - self.points[0], self.points - self.points[0]
        ahead = relative @ self.tangents.T - np.einsum("sx,sx->s", points, self.tangents)
        apart = np.sum(relative**2, axis=1)[:, None] - 2.0 * relative @ points.T + np.sum(points**2, axis=1)
        # It belongs to a piece where it is ahead of its first plane and not of its second, or to what is past an end.
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
            found: Floats = values[first] + share * (values[second] - values[first])
            return found

        tangents = mixed(self.tangents)
        away = relative - mixed(points) - past[:, None] * tangents
        sideways = unit(np.cross(tangents, mixed(self.normals)))
        stretches = 1.0 - np.where(inside, np.einsum("px,px->p", away, mixed(self.bends)), 0.0)
        u, across = (mixed(self.ways) + past) / self.length, np.einsum("px,px->p", away, sideways)
        return u, across, np.minimum(stretches, _ALONE * alone)

    def _at(self, vectors: Floats, u: Floats) -> Floats:
        """(…, 3) unit vectors at (…,) u, of (samples, 3)."""
        return unit(np.stack([np.interp(u * self.length, self.ways, axis) for axis in vectors.T], axis=-1))

    def cosines(self, u: Floats, normals: Floats) -> Floats:
        """(…,) of (…, 3) unit normals, at (…,) places along, and the curve's there."""
        found: Floats = np.sum(normals * self._at(self.normals, u), axis=-1)
        return found

    def directions(self, u: Floats) -> Floats:
        """(…, 3) unit vectors along it at (…,) u."""
        return self._at(self.tangents, u)

    def depths(self, positions: Floats) -> Floats:
        """(…,) how far (…, 3) positions are above the curve, along its normal."""
        u = self.locate(positions).u
        feet = np.stack([np.interp(u * self.length, self.ways, axis) for axis in self.points.T], axis=-1)
        return self.cosines(u, positions - feet)

    def box(self, across: float) -> tuple[Floats, Floats, Floats, Floats]:
        """What may be no further across than a distance: a point, (axes, 3), least and greatest (axes,) on them."""
        # A surface falls away beside the curve as far as it goes sideways, or as a limb is thick.
        reach = 2.0 * across + 0.5 * self.length
        low, high = self.points.min(axis=0) - reach, self.points.max(axis=0) + reach
        return np.zeros(3), np.eye(3), low, high


Path = Straight | Curve


def path_through(
    points: Sequence[Floats], normals: Sequence[Floats], foot: Foot, *, names: Sequence[str], where: str
) -> Path:
    """The path through the anchors of a tool.

    Args:
        points: Their (3,) positions, two or more, no two neighbours alike.
        normals: (3,) of the surface there, unit length.
        foot: The surface between them.
        names: What messages call the anchors.
        where: The tool's place in its file.

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
                f"turns by {turn:.0f}° at {names[k + 1]}, and {_MOST_TURN:.0f}° is the most: more points round it",
                where=where,
            )
    return curve_on(*_halved(np.stack(points), np.stack(normals), foot))


def curve_on(places: Floats, facing: Floats) -> Curve:
    """The smooth curve through (places, 3) points of a surface, with its (places, 3) normals there."""
    return _curve(*_spline(places, facing, _PIECES))


def _halved(places: Floats, facing: Floats, foot: Foot) -> tuple[Floats, Floats]:
    """(2 anchors - 1, 3) places and normals: those of the anchors, and on the surface halfway between each two."""
    middles, normals = (values[1::2] for values in _spline(places, facing, 2))
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    both = np.zeros((2, 2 * len(places) - 1, 3))
    both[:, ::2] = places, facing
    for k, (middle, normal) in enumerate(zip(middles, unit(normals), strict=True)):
        found = foot(middle)
        # Over a gap or a fold of the surface the curve goes its own way.
        near = np.linalg.norm(found[0] - middle) < _NEAR * lengths[k] and found[1] @ normal > 0
        both[:, 2 * k + 1] = found if near else (middle, normal)
    return both[0], both[1]


def _spline(places: Floats, facing: Floats, pieces: int) -> tuple[Floats, Floats]:
    """(samples, 3) points on the smooth curve through (places, 3), so many pieces from one to the next, and normals."""
    t = np.linspace(0.0, 1.0, pieces + 1)[1:, None]
    # The share of the second of the two arcs between two places, and of the second normal.
    share = np.sin(0.5 * np.pi * t) ** 2
    points, normals = [places[:1]], [facing[:1]]
    for k in range(len(places) - 1):
        thirds = [places[third] for third in (k - 1, k + 2) if 0 <= third < len(places)]
        arcs = [_arc(places[k], places[k + 1], third, t) for third in thirds]
        points.append(arcs[0] + share * (arcs[-1] - arcs[0]))
        normals.append(facing[k] + share * (facing[k + 1] - facing[k]))
    return np.concatenate(points), np.concatenate(normals)


def _curve(points: Floats, facing: Floats) -> Curve:
    """Measure a curve along (samples, 3) points, with the parts of (samples, 3) vectors across it as normals."""
    ways = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    tangents = unit(np.gradient(points, ways, axis=0, edge_order=2))
    bends = np.gradient(tangents, ways, axis=0)
    normals = unit(facing - np.sum(facing * tangents, axis=1, keepdims=True) * tangents)
    return Curve(points, tangents, bends, normals, ways)


def _arc(start: Floats, end: Floats, third: Floats, t: Floats) -> Floats:
    """(times, 3) at (times, 1) from 0 to 1 on the circle through three points, from one to another past no third."""
    chord = end - start
    length = float(np.linalg.norm(chord))
    along = chord / length
    one, other = start - third, end - third
    # Half of what the arc spans is the angle at which it is seen from the third point (Euclid III.20).
    half = np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
    if half < _LEAST_ANGLE:
        return start + t * chord
    outwards = -unit(third - start - ((third - start) @ along) * along)
    turned, radius = (2.0 * t - 1.0) * half, 0.5 * length / np.sin(half)
    return (start + end) / 2.0 + radius * (np.sin(turned) * along + (np.cos(turned) - np.cos(half)) * outwards)
