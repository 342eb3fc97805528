"""Features of a surface, at which wrinkles end: open borders, seams of materials, and sharp creases.

An open border is the hem of a sleeve or the hole of an eye. A seam of materials is one between two primitives that look
different; neither a seam of texture coordinates nor a mere split of primitives is one. A crease is a run of
sharp edges.
"""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    among,
    children,
    components,
    distinct,
    distinct_values,
    face_normals,
    flags_of,
    renumbered,
    unit,
)
from wrinklecli.numeric.edges import Edges
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.rest import Rest
from wrinklecli.surface.rounding import CREASE, FACETED, SHARP, normals_differ

# Feature edges of a vertex that are looked at: two of a run, and a third where runs meet.
_RUNS = 3


@dataclass(frozen=True, slots=True)
class Cut:
    """Member triangles of a patch and the features among their edges.

    Attributes:
        features: (features, 2) welded vertices of the edges at which wrinkles end.
        parts: (members,) the part of the surface of each member; features lie between the parts.
    """

    features: Ints
    parts: Ints


def cut_at_features(ground: Ground, members: Ints, least: float) -> Cut:
    """Find the features of a surface at rest along the edges of (members,) sorted coarse triangles.

    Runs of creases that are no longer than `least`, scene units, are no features, nor are those of a faceted surface.
    """
    surface, rest = ground.surface, ground.rest
    faces = rest.around.faces_of(distinct_values(surface.triangles[members]))
    faces = faces[_firsts(surface.triangles[faces])]
    triangles, is_member = surface.triangles[faces], among(faces, members)
    edges = Edges.of(triangles)
    near = flags_of(edges.of_faces[is_member], len(edges.vertices))
    feature = near & (edges.counts == 1)
    looks = ground.looks[surface.primitives[faces]]
    feature[edges.pairs] |= near[edges.pairs] & (looks[edges.one // 3] != looks[edges.other // 3])

    hard = normals_differ(unit(surface.normals[surface.corners[faces]]), edges)
    normals = unit(face_normals(rest.positions, triangles))
    cosines = edges.way * np.sum(normals[edges.one // 3] * normals[edges.other // 3], axis=1)
    sharp = (cosines < CREASE) | (hard & (cosines < SHARP))
    inner = near[edges.pairs]
    creases = edges.pairs[sharp & inner & ~feature[edges.pairs]]
    if len(creases) and (hard | sharp)[inner].mean() <= FACETED:
        feature[creases[_long(edges.vertices[creases], rest.positions, least)]] = True

    return Cut(edges.vertices[feature], parts_of(surface.triangles[members], edges.vertices[feature]))


def _firsts(triangles: Ints) -> Bools:
    """(triangles,) False for those with two equal corners, and for all but the first of those with the same corners.

    Meshes have faces twice where both sides of cloth are drawn.
    """
    corners = np.sort(triangles, axis=1)
    proper: Bools = (np.diff(corners, axis=1) != 0).all(axis=1)
    return flags_of(distinct(corners)[0], len(corners)) & proper


def parts_of(triangles: Ints, features: Ints) -> Ints:
    """(triangles,) the part of each, where (features, 2) edges lie between parts; a vertex alone connects nothing."""
    edges = Edges.of(triangles)
    sides = edges.of_faces.reshape(-1)
    order = np.argsort(sides, kind="stable")
    count = int(triangles.max(initial=-1)) + 1
    cut = np.isin(edges.vertices @ [count, 1], features[(features < count).all(axis=1)] @ [count, 1])
    joined = np.flatnonzero((np.diff(sides[order]) == 0) & ~cut[sides[order[1:]]])
    return components(np.stack([order[joined], order[joined + 1]], axis=1) // 3, len(triangles))


def _long(edges: Ints, positions: Floats, least: float) -> Bools:
    """(edges,) True for (edges, 2) that belong to a run whose box has a longer diagonal than `least`."""
    vertices, local = renumbered(edges)
    run = components(local, len(vertices))
    low, high = np.full((run.max() + 1, 3), np.inf), np.full((run.max() + 1, 3), -np.inf)
    np.minimum.at(low, run, positions[vertices])
    np.maximum.at(high, run, positions[vertices])
    long: Bools = np.linalg.norm(high - low, axis=1) > least
    return long[run[local[:, 0]]]


@dataclass(frozen=True, slots=True)
class Nearest:
    """The features that are nearest to the triangles of a patch, over the surface.

    Attributes:
        segments: (features, 2, 3) ends of features, world space in a pose.
        members: (members,) coarse triangles that a feature may be near to, sorted.
        candidates: (members, 3 · runs) features that may be the nearest to a point of each; -1 for none.
    """

    segments: Floats
    members: Ints
    candidates: Ints

    @classmethod
    def of(cls, features: Ints, pose: Rest, members: Ints, far: float) -> "Nearest | None":
        """Find (features, 2) that are up to `far` from (members,) sorted triangles in a pose; None if there are none.

        A vertex passes its features on to its neighbours: a hem counts on its own sleeve, not on a hip beside it.
        """
        vertices, corners = renumbered(pose.triangles[members])
        positions = pose.positions[vertices]
        ends = np.searchsorted(vertices, features[np.isin(features, vertices).all(axis=1)])
        if not len(ends):
            return None
        segments = positions[ends]
        nearest = np.full((len(vertices), _RUNS), -1, np.intp)
        for number, pair in enumerate(ends.tolist()):
            for end in pair:
                free = np.flatnonzero(nearest[end] < 0)
                nearest[end, free[:1]] = number
        distances = np.where(nearest[:, 0] >= 0, 0.0, np.inf)
        sides = np.concatenate([corners[:, [k, m]] for k in range(3) for m in range(3) if k != m])
        fresh = distances == 0.0
        while fresh.any():
            sent = sides[fresh[sides[:, 0]] & (distances[sides[:, 0]] < far)]
            features = nearest[sent[:, 0], 0]
            reached = segment_distances(positions[sent[:, 1]], segments[features])
            order = np.lexsort((features, reached, sent[:, 1]))
            first = order[np.diff(sent[order, 1], prepend=-1) != 0]
            better = first[reached[first] < distances[sent[first, 1]]]
            at = sent[better, 1]
            distances[at], nearest[at, 0] = reached[better], features[better]
            fresh = flags_of(at, len(vertices))
        candidates = nearest[corners].reshape(len(members), -1)
        near = (candidates >= 0).any(axis=1)
        return cls(segments, members[near], candidates[near])

    def distances(self, triangles: Ints, parents: Ints, vertices: Ints, places: Floats) -> Floats:
        """(vertices,) distances from the features, infinite where none is near.

        Args:
            triangles: (triangles, 3) fine vertices.
            parents: (triangles,) the coarse triangle of each, sorted.
            vertices: (vertices,) chosen fine vertices.
            places: (vertices, 3) their positions in the pose of the features, world space.
        """
        count = int(triangles.max(initial=-1)) + 1
        found, every = np.full(count, np.inf), np.zeros((count, 3))
        every[vertices] = places
        faces = children(parents, self.members)
        corners = triangles[faces]
        candidates = self.candidates[np.searchsorted(self.members, parents[faces])]
        for column in candidates.T:
            used = column >= 0
            at = corners[used].reshape(-1)
            reached = segment_distances(every[at], np.repeat(self.segments[column[used]], 3, axis=0))
            np.minimum.at(found, at, reached)
        return found[vertices]


def segment_distances(points: Floats, segments: Floats) -> Floats:
    """(points,) distances of (points, 3) from (points, 2, 3) segments."""
    starts, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    squared = np.sum(along * along, axis=1)
    t = np.clip(np.sum((points - starts) * along, axis=1) / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
    return np.asarray(np.sqrt(np.sum((points - starts - t[:, None] * along) ** 2, axis=1)))


def surface_distances(edges: Ints, positions: Floats, starts: Floats) -> Floats:
    """(vertices,) lengths of the shortest ways along (edges, 2) from vertices with finite (vertices,) `starts`.

    A way begins with the start's own length.
    """
    lengths = np.linalg.norm(positions[edges[:, 1]] - positions[edges[:, 0]], axis=1)
    sides, lengths = np.concatenate([edges, edges[:, ::-1]]), np.tile(lengths, 2)
    found, fresh = starts.copy(), np.isfinite(starts)
    while fresh.any():
        sent = np.flatnonzero(fresh[sides[:, 0]])
        before = found.copy()
        np.minimum.at(found, sides[sent, 1], found[sides[sent, 0]] + lengths[sent])
        fresh = found < before
    return found
