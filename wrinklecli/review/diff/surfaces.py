"""Compare posed primitives at the times of a clip: vertex by vertex, or as surfaces with different triangles."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.closest import ROUNDING, Tree, meets_box
from wrinklecli.numeric.portions import portions
from wrinklecli.review.diff.common_clips import CommonClip
from wrinklecli.review.diff.difference import Difference

# Called with the number of further times that are done, which may be a fraction.
Advance = Callable[[float], None]

# Squared distance of two normals below which both are unit vectors: a zero vector is at 1 from any unit vector.
_ZERO_CHORD = 0.99


@dataclass(frozen=True, slots=True)
class Worst:
    """The place where two posed assets are farthest apart: a vertex of asset A or B (`side`).

    The distance is in scene units and the time in seconds; `place` is a JSON pointer to the vertex's primitive, and
    `name` that of its node. In the stored pose `clip` is None.
    """

    distance: float
    side: str
    place: str
    name: str
    vertex: int
    clip: str | None
    time: float


@dataclass(frozen=True, slots=True)
class Apart:
    """The distance between two primitives, or between the unpaired parts of both assets, in a clip.

    The greatest angle between normals is in degrees, or None unless both sides have normals. Of `total` vertices, `off`
    are beyond the tolerance; None if surfaces were compared.
    """

    worst: Worst
    normal: float | None
    off: int | None
    total: int


def untouched(primitive: ScenePrimitive, common: CommonClip, time: float) -> Apart:
    """The result of comparing a primitive with itself."""
    worst = Worst(0.0, "A", place_of(primitive), primitive.name, 0, common.name, time)
    return Apart(worst, None if primitive.vertices.normals is None else 0.0, 0, len(primitive.vertices.positions))


def compare_vertices(
    one: ScenePrimitive, other: ScenePrimitive, common: CommonClip, times: Floats, tolerance: float, advance: Advance
) -> Apart:
    """Compare two primitives with the same triangles, vertex by vertex, at (frames,) times of a clip.

    The tolerance is in scene units.
    """
    seen = one.seen
    # A slice is not copied.
    used: Ints | slice = seen if len(seen) < len(one.vertices.positions) else slice(None)
    off = np.zeros(len(seen), bool)
    worst, normal = untouched(one, common, float(times[0])).worst, None
    for now in (times[part] for part in portions(len(times), 12 * len(one.vertices.positions))):
        first, second = (primitive.posed(clip, now) for primitive, clip in zip((one, other), common.clips, strict=True))
        squared = _squared_distances(first.positions, second.positions)[:, used]
        beyond = squared > tolerance**2
        if beyond.any():
            off |= beyond.any(axis=0)
        frame, vertex = np.unravel_index(int(squared.argmax()), squared.shape)
        if squared[frame, vertex] > worst.distance**2:
            distance, time = float(np.sqrt(squared[frame, vertex])), float(now[frame])
            worst = replace(worst, distance=distance, vertex=int(seen[vertex]), time=time)
        if first.normals is not None and second.normals is not None:
            normal = max(normal or 0.0, _greatest_angle(first.normals, second.normals, used))
        advance(len(now))
    return Apart(worst, normal, int(off.sum()), len(seen))


def _squared_distances(first: Floats, second: Floats) -> Floats:
    """(frames, vertices) of (frames, vertices, 3) points; fastest by coordinates, as posing stores them."""
    squared = np.zeros(first.shape[:2])
    for k in range(3):
        apart = first[..., k] - second[..., k]
        apart *= apart
        squared += apart
    return squared


def _greatest_angle(first: Floats, second: Floats, used: Ints | slice) -> float:
    """Degrees between (frames, vertices, 3) unit vectors; pairs with a zero vector are left out."""
    squared = _squared_distances(first, second)[:, used]
    if squared.max(initial=0.0) > _ZERO_CHORD:
        lengths = (_squared_distances(each, np.zeros(3))[:, used] for each in (first, second))
        squared = np.where(next(lengths) * next(lengths) > 0, squared, 0.0)
    chord = float(np.sqrt(squared.max(initial=0.0)))
    return float(np.degrees(2.0 * np.arcsin(min(chord / 2.0, 1.0))))


@dataclass(frozen=True, slots=True)
class _Joined:
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
    def of(cls, primitives: Sequence[ScenePrimitive], clip: Clip | None) -> "_Joined":
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

    def posed(self, times: Floats) -> Floats:
        """(times, vertices, 3) positions of all primitives, scene units."""
        return np.concatenate([each.posed(self.clip, times).positions for each in self.primitives], axis=1)


@dataclass(frozen=True, slots=True)
class _Places:
    """Places on a surface, for the vertices of another one, to which they are near at some time.

    Attributes:
        triangles: (points,) triangles of the surface.
        shares: (points, 3) barycentric coordinates.
    """

    triangles: Ints
    shares: Floats

    def distances(self, points: Floats, positions: Floats, triangles: Ints) -> Floats:
        """(points,) distances from (points, 3) to these places of (triangles, 3) of (vertices, 3) positions."""
        places = np.einsum("pc,pcx->px", self.shares, positions[triangles[self.triangles]])
        return np.asarray(np.sqrt(np.sum((points - places) ** 2, axis=1)))

    def search(self, chosen: Ints, points: Floats, positions: Floats, triangles: Ints, reach: float) -> Floats:
        """(chosen,) distances from (chosen, 3) points to their nearest places, within a reach, which become these."""
        reach += ROUNDING * (reach + np.abs(positions).max())
        around = np.flatnonzero(meets_box(positions, points.min(axis=0) - reach, points.max(axis=0) + reach, triangles))
        found, self.shares[chosen], places = Tree.of(positions, triangles[around]).closest_points(points)
        self.triangles[chosen] = around[found]
        return np.asarray(np.sqrt(np.sum((points - places) ** 2, axis=1)))


def compare_surfaces(
    rest_a: Sequence[ScenePrimitive],
    rest_b: Sequence[ScenePrimitive],
    common: CommonClip,
    times: Floats,
    advance: Advance,
) -> Apart:
    """Compare primitives with different triangles by the distances of vertices of each from the other's surface.

    The place of a surface that is nearest to a vertex at the first time is not far from it at others. So its distance
    is a good upper bound, and the nearest place is searched only where that exceeds the greatest distance found before.
    """
    a, b = (_Joined.of(each, clip) for each, clip in zip((rest_a, rest_b), common.clips, strict=True))
    sides = ((a, b), (b, a))
    near: list[_Places] = []
    bounds = np.zeros(len(times))
    for part in portions(len(times), 12 * max(a.starts[-1], b.starts[-1])):
        now = times[part]
        for frame, posed in enumerate(zip(a.posed(now), b.posed(now), strict=True), part.start):
            for side, (one, other) in enumerate(sides):
                points, positions = posed[side][one.used], posed[1 - side]
                if len(near) == side:
                    near.append(_Places(*Tree.of(positions, other.triangles).closest_points(points)[:2]))
                bounds[frame] = max(bounds[frame], near[side].distances(points, positions, other.triangles).max())
        advance(len(now))
    farthest, at = 0.0, (0, int(a.used[0]), float(times[0]))
    # The times with the greatest bounds come first: their distances rule out most others.
    for frame in np.argsort(-bounds, kind="stable").tolist():
        if bounds[frame] <= farthest:
            break
        both = [each.posed(times[frame : frame + 1])[0] for each in (a, b)]
        for side, (one, other) in enumerate(sides):
            points, positions = both[side][one.used], both[1 - side]
            reaches = near[side].distances(points, positions, other.triangles)
            chosen = np.flatnonzero(reaches > farthest)
            if not len(chosen):
                continue
            distances = near[side].search(chosen, points[chosen], positions, other.triangles, float(reaches.max()))
            top = int(distances.argmax())
            if distances[top] > farthest:
                farthest, at = float(distances[top]), (side, int(one.used[chosen[top]]), float(times[frame]))
    side, vertex, time = at
    primitive, vertex = sides[side][0].vertex(vertex)
    worst = Worst(farthest, "AB"[side], place_of(primitive), primitive.name, vertex, common.name, time)
    return Apart(worst, None, None, 0)


def place_of(primitive: ScenePrimitive) -> str:
    """JSON pointer of a primitive in its mesh."""
    return f"/meshes/{primitive.rig.mesh}/primitives/{primitive.primitive}"


def when(clip: str | None, time: float) -> str:
    """A clip's time, or the stored pose, in words."""
    return "stored pose" if clip is None else f"clip {clip!r} at {time:.6g} s"


def pose_difference(apart: Apart) -> Difference:
    """The difference of two primitives that are farther apart than the tolerance."""
    worst = apart.worst
    if apart.off is None:
        other = "B" if worst.side == "A" else "A"
        message = f"vertex {worst.vertex} of {worst.side} is {worst.distance:.3g} from the surface of {other}"
    else:
        message = f"vertex {worst.vertex} is {worst.distance:.3g} off"
        message += f"; {apart.off} of {apart.total} are" if apart.off > 1 else ""
    return Difference("pose", worst.place, worst.name, f"{when(worst.clip, worst.time)}: {message}", worst.distance)
