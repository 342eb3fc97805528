"""Find the greatest distance over time between two surfaces with different triangles."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.distances import farthest, near_triangles, triangle_distances

# Vertices that are posed at once, over all times of a chunk. This bounds the memory: each takes about 100 bytes.
CHUNK = 2**16
# Distance up to which a point is at a vertex, relative to the greatest coordinate.
_TWINS = 1e-9
# Points whose distances at all times are computed together, beginning with those that may be farthest.
_BATCH = 2**8


@dataclass(frozen=True, slots=True)
class Soup:
    """Primitives that a clip moves, as one surface.

    Attributes:
        primitives: The primitives, without normals.
        clip: Moves them; None for the stored pose.
        starts: (primitives + 1,) the first vertex of each.
        used: Sorted numbers of the visible vertices.
        triangles: (triangles, 3); points, and vertices of lines, are triangles without extent.
    """

    primitives: tuple[ScenePrimitive, ...]
    clip: Clip | None
    starts: Ints
    used: Ints
    triangles: Ints

    @classmethod
    def of(cls, primitives: Sequence[ScenePrimitive], clip: Clip | None) -> "Soup":
        """Join primitives."""
        starts = np.cumsum([0] + [len(primitive.vertices.positions) for primitive in primitives])
        used = [primitive.seen + start for primitive, start in zip(primitives, starts, strict=False)]
        triangles = [
            primitive.triangles + start if len(primitive.triangles) else np.repeat(each[:, None], 3, axis=1)
            for primitive, each, start in zip(primitives, used, starts, strict=False)
        ]
        return cls(
            tuple(primitive.bare for primitive in primitives),
            clip,
            starts,
            np.concatenate(used),
            np.concatenate(triangles),
        )

    def vertex(self, number: int) -> tuple[ScenePrimitive, int]:
        """The primitive that has a vertex, and the vertex's number there."""
        index = int(np.searchsorted(self.starts, number, side="right")) - 1
        return self.primitives[index], number - int(self.starts[index])

    def only(self, vertices: Ints) -> "Soup":
        """The surface with (vertices,) sorted vertices only, to be posed, and without triangles."""
        cuts = np.searchsorted(vertices, self.starts)
        primitives = tuple(
            primitive.only(vertices[first:stop] - start)
            for primitive, start, first, stop in zip(self.primitives, self.starts, cuts, cuts[1:], strict=False)
        )
        return Soup(primitives, self.clip, cuts, np.arange(len(vertices)), self.triangles[:0])

    def posed(self, times: Floats) -> Floats:
        """(times, vertices, 3) positions of all primitives, scene units."""
        return np.concatenate([each.posed(self.clip, times).positions for each in self.primitives], axis=1)


@dataclass(frozen=True, slots=True)
class FarthestVertex:
    """The vertex of two surfaces that is farthest from the other surface, at a time in seconds.

    The distance is in scene units; `side` is 0 for a vertex of the first surface, 1 for the second.
    """

    distance: float
    side: int
    vertex: int
    time: float


@dataclass(frozen=True, slots=True)
class _Near:
    """The parts of a surface that are near some points at one time.

    Attributes:
        triangles: (points,) a triangle near each point.
        corners: (points, 3) its vertices.
        apart: The points that are not at a vertex of the surface.
        twins: The points that are at a vertex.
        vertices: (twins,) these vertices.
    """

    triangles: Ints
    corners: Ints
    apart: Ints
    twins: Ints
    vertices: Ints

    @classmethod
    def of(cls, points: Floats, positions: Floats, triangles: Ints) -> "_Near":
        """Find triangles near (points, 3) points, of (vertices, 3) positions."""
        chosen = near_triangles(points, positions[triangles])
        corners = triangles[chosen]
        at = np.abs(positions[corners] - points[:, None]).max(axis=2) <= _TWINS * np.abs(points).max()
        twins = np.flatnonzero(at.any(axis=1))
        return cls(chosen, corners, np.flatnonzero(~at.any(axis=1)), twins, corners[twins, at[twins].argmax(axis=1)])

    def distances(self, points: Floats, positions: Floats) -> Floats:
        """(points,) upper bounds of the points' distances at another time."""
        found = np.zeros(len(points))
        found[self.apart] = triangle_distances(points[self.apart], positions[self.corners[self.apart]])
        found[self.twins] = np.sqrt(np.sum((points[self.twins] - positions[self.vertices]) ** 2, axis=1))
        return found


def farthest_apart(a: Soup, b: Soup, times: Floats, advance: Callable[[float], None]) -> FarthestVertex:
    """Find the time, of at least one, and the vertex at which two surfaces are farthest apart.

    A triangle that is near a vertex at the first time is not far from it at others. So its distance at each time is a
    good upper bound, and the nearest triangle is searched only for vertices that may be the farthest.
    """
    pairs = ((a, b), (b, a))
    near: list[_Near] = []
    peaks = [np.zeros(len(soup.used)) for soup in (a, b)]
    step = max(1, CHUNK // max(soup.starts[-1] for soup in (a, b)))
    for now in (times[k : k + step] for k in range(0, len(times), step)):
        for posed in zip(a.posed(now), b.posed(now), strict=True):
            sides = list(zip(pairs, posed, posed[::-1], strict=True))
            near = near or [_Near.of(own[one.used], its, other.triangles) for (one, other), own, its in sides]
            for ((one, _), own, its), hints, peak in zip(sides, near, peaks, strict=True):
                np.maximum(peak, hints.distances(own[one.used], its), out=peak)
        advance(len(now))
    far = FarthestVertex(0.0, 0, int(a.used[0]), float(times[0]))
    for side in (0, 1) if peaks[0].max() >= peaks[1].max() else (1, 0):
        far = _farthest_of(side, pairs[side], times, near[side].triangles, peaks[side], far)
    return far


def _farthest_of(
    side: int, pair: tuple[Soup, Soup], times: Floats, near: Ints, peaks: Floats, far: FarthestVertex
) -> FarthestVertex:
    """The farthest vertex of one surface (side 0 or 1, first of the pair) from another, or `far` if none is farther.

    `near` is (points,) a triangle near each point, `peaks` (points,) upper bounds of the points' distances.
    """
    one, other = pair
    order = np.argsort(-peaks, kind="stable")
    for chosen in (order[k : k + _BATCH] for k in range(0, len(order), _BATCH)):
        if peaks[chosen[0]] <= far.distance:
            break
        hints, bounds = near[chosen], _distances(one, other, chosen, near[chosen], times)
        while bounds.max() > far.distance:
            frame = int(bounds.max(axis=1).argmax())
            now = times[frame : frame + 1]
            points, corners = one.posed(now)[0, one.used[chosen]], other.posed(now)[0, other.triangles]
            found = farthest(points, corners, hints=hints, floor=far.distance)
            if found.point >= 0:
                far = FarthestVertex(found.distance, side, int(one.used[chosen[found.point]]), float(now[0]))
            changed, hints = np.flatnonzero(found.hints != hints), found.hints
            nearer = _distances(one, other, chosen[changed], hints[changed], times)
            bounds[:, changed] = np.minimum(bounds[:, changed], nearer)
            bounds[frame] = 0.0  # this time is done, even if rounding left a bound above the distance
    return far


def _distances(one: Soup, other: Soup, points: Ints, triangles: Ints, times: Floats) -> Floats:
    """(times, points) distances of (points,) visible vertices of a surface from (points,) triangles of another."""
    corners = distinct_values(other.triangles[triangles])
    vertices, rows = np.unique(one.used[points], return_inverse=True)
    moving, still = one.only(vertices), other.only(corners)
    columns = np.searchsorted(corners, other.triangles[triangles])
    step = max(1, CHUNK // max(len(points), 1))
    found = np.zeros((len(times), len(points)))
    for first in range(0, len(times), step):
        now = times[first : first + step]
        places, around = moving.posed(now)[:, rows].reshape(-1, 3), still.posed(now)[:, columns].reshape(-1, 3, 3)
        found[first : first + step] = triangle_distances(places, around).reshape(len(now), -1)
    return found
