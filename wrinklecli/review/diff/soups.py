"""Find the greatest distance over time between two surfaces with different triangles."""

from collections.abc import Callable, Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.closest import Tree, on_triangles

# Vertices that are posed at once, over all times of a chunk. This bounds the memory: each takes about 100 bytes.
CHUNK = 2**16


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


def farthest_apart(a: Soup, b: Soup, times: Floats, advance: Callable[[float], None]) -> FarthestVertex:
    """Find the time, of at least one, and the vertex at which two surfaces are farthest apart.

    A triangle that is near a vertex at the first time is not far from it at others. So its distance at each time is a
    good upper bound, and the nearest triangle is searched only where that exceeds the greatest distance found before.
    """
    sides = ((a, b), (b, a))
    near: list[Ints] = []
    bounds: list[float] = []
    step = max(1, CHUNK // max(soup.starts[-1] for soup in (a, b)))
    for now in (times[k : k + step] for k in range(0, len(times), step)):
        for posed in zip(a.posed(now), b.posed(now), strict=True):
            for side, (one, other) in enumerate(sides):
                points, positions = posed[side][one.used], posed[1 - side]
                if len(near) == side:
                    near.append(Tree.of(positions, other.triangles).closest_points(points)[0])
                bounds.append(float(_distances(points, positions[other.triangles[near[side]]]).max()))
        advance(len(now))
    far = FarthestVertex(0.0, 0, int(a.used[0]), float(times[0]))
    # The surfaces and times with the greatest bounds come first: their distances rule out most others.
    for number in np.argsort(-np.array(bounds), kind="stable"):
        if bounds[number] <= far.distance:
            break
        frame, side = divmod(int(number), len(sides))
        (one, other), now = sides[side], times[frame : frame + 1]
        points, positions = one.posed(now)[0, one.used], other.posed(now)[0]
        chosen = np.flatnonzero(_distances(points, positions[other.triangles[near[side]]]) > far.distance)
        if len(chosen):
            near[side][chosen], _, places = Tree.of(positions, other.triangles).closest_points(points[chosen])
            distances = np.sqrt(np.sum((points[chosen] - places) ** 2, axis=1))
            top = int(distances.argmax())
            if distances[top] > far.distance:
                far = FarthestVertex(float(distances[top]), side, int(one.used[chosen[top]]), float(now[0]))
    return far


def _distances(points: Floats, corners: Floats) -> Floats:
    """(pairs,) distances of (pairs, 3) points, each from its own triangle among (pairs, 3, 3) corners."""
    _, places = on_triangles(points, corners)
    return np.asarray(np.sqrt(np.sum((points - places) ** 2, axis=1)))
