"""Takes vertices out of a triangulated surface where no edge becomes too long for it.

Halving edges, and splitting the faces beside them so that no gap opens, makes about twice as many vertices as the
lengths of edges ask for. A vertex goes by moving onto a neighbour, which ends the two faces between them.

Source: H. Hoppe, T. DeRose, T. Duchamp, J. McDonald, W. Stuetzle, *Mesh Optimization*, SIGGRAPH 1993: edges collapse
where the surface stays one. Differs: vertices keep their places, and edges have a greatest length.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, among, any_of, cross, dot, flags_of
from wrinklecli.numeric.edges import STEP, Edges

# Least cosine between the normals of a face before and after.
_LEAST_COSINE = 0.5
# Height of a face over its longest side, below which none becomes narrower: what is more slender is seen as a scratch.
_NARROW = 0.15
# Part of a face's area by which a place may lie beside it: midpoints lie on its sides but for rounding errors.
_BESIDE = 1e-3


def collapse_edges(
    triangles: Ints,
    weld: Ints,
    positions: Floats,
    lengths: Callable[[Ints], Floats],
    removable: Bools,
    tolerance: float,
) -> tuple[Ints, Ints]:
    """Take vertices out until none can go.

    Args:
        triangles: (triangles, 3) vertices; those on both sides of a seam have numbers of their own.
        weld: (vertices,) equal numbers for those at one point.
        positions: (vertices, 3).
        lengths: Gives (edges,) lengths from their (edges, 2) vertices. None longer than 1 is made, but for a step.
        removable: (vertices,) True for those that may go; at borders and seams they stay nevertheless.
        tolerance: Greatest distance of a vertex that goes from the faces in place of its own.

    Returns:
        (left, 3) triangles, and their (left,) sorted numbers among all.
    """
    count = len(positions)
    removable = removable & ~_at_borders(triangles, removable)
    here = any_of(flags_of(triangles[any_of(removable, triangles)], count), triangles)
    found, numbers = triangles[here], np.flatnonzero(here)
    # Each vertex tries its neighbours, the nearest first. It begins anew only when a face round it has changed.
    fresh, tries = removable, np.zeros(count, np.intp)
    fans, sizes = np.zeros((0, 3), np.intp), np.zeros(0)
    while len(fans) or fresh.any():
        own, own_sizes = _fans(found, fresh, lengths)
        fans, sizes = np.concatenate([fans, own]), np.concatenate([sizes, own_sizes])
        order = np.argsort(fans[:, 0], kind="stable")
        fans, sizes = fans[order], sizes[order]
        moves = _Moves.of(fans, sizes, tries)
        fits = moves.fit(found, weld, positions, lengths, tolerance)
        tries[moves.vertices[~fits]] += 1
        going = moves.apart(fits, found, weld)
        gone = flags_of(moves.vertices[going], count)
        changed = any_of(gone, found)
        beside = flags_of(found[changed], count)
        onto = np.arange(count)
        onto[moves.vertices[going]] = moves.targets[going]
        found[changed] = onto[found[changed]]
        whole = (found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2]) & (found[:, 2] != found[:, 0])
        found, numbers = found[whole], numbers[whole]
        tries[beside] = 0
        fresh = beside & removable & ~gone
        same = (flags_of(moves.vertices, count) & ~beside)[fans[:, 0]]
        fans, sizes = fans[same], sizes[same]
    left = ~here
    left[numbers] = True
    every = triangles.copy()
    every[numbers] = found
    return every[left], np.flatnonzero(left)


@dataclass(frozen=True, slots=True)
class _Moves:
    """Vertices, each of which would move onto a neighbour.

    Attributes:
        vertices: (moves,) those that would go.
        targets: (moves,) the neighbours.
        lengths: (moves,) of the edges between them, in steps.
        faces: (faces, 3) those round a vertex, with the vertex first, which the move leaves.
        of_faces: (faces,) the move of each.
        links: (links, 2) edges that are made: the target, and a vertex round it.
        of_links: (links,) the move of each.
    """

    vertices: Ints
    targets: Ints
    lengths: Floats
    faces: Ints
    of_faces: Ints
    links: Ints
    of_links: Ints

    @classmethod
    def of(cls, fans: Ints, sizes: Floats, tries: Ints) -> _Moves:
        """For each vertex of `_fans` the neighbour that it has not tried yet, until it has tried all."""
        firsts = np.flatnonzero(np.diff(fans[:, 0], prepend=-1))
        vertices, counts = fans[firsts, 0], np.diff(firsts, append=len(fans))
        number = np.repeat(np.arange(len(vertices)), counts)
        more = tries[vertices] < counts
        chosen = firsts + np.minimum(tries[vertices], counts - 1)
        targets, beyond = fans[chosen, 1][number], fans[chosen, 2][number]
        stays = more[number] & (fans[:, 1] != targets) & (fans[:, 2] != targets)
        links = stays & (fans[:, 1] != beyond)
        renumbered = np.cumsum(more) - 1
        return cls(
            vertices=vertices[more],
            targets=fans[chosen[more], 1],
            lengths=sizes[chosen[more]],
            faces=fans[stays],
            of_faces=renumbered[number[stays]],
            links=np.stack([targets, fans[:, 1]], axis=1)[links],
            of_links=renumbered[number[links]],
        )

    def fit(
        self, triangles: Ints, weld: Ints, positions: Floats, lengths: Callable[[Ints], Floats], tolerance: float
    ) -> Bools:
        """(moves,) True for those after which the surface is as good."""
        count = len(self.vertices)
        fails = flags_of(self.of_links[lengths(self.links) > 1.0 + STEP], count)
        faces = np.flatnonzero(~fails[self.of_faces])
        of_faces = self.of_faces[faces]
        shapely, near = _replaced(positions, self.faces[faces], self.targets[of_faces], tolerance)
        fails[of_faces[~shapely]] = True
        fails |= ~flags_of(of_faces[near], count)
        # An edge of four faces would be made where one between the same vertices is there already.
        links = np.flatnonzero(~fails[self.of_links])
        keys = _keys(self.links[links], weld)
        around = triangles[any_of(flags_of(weld[self.links[links, 0]], len(weld))[weld], triangles)]
        known = _keys(np.concatenate([around[:, :2], around[:, 1:], around[:, ::2]]), weld)
        fails[self.of_links[links[among(keys, np.sort(known))]]] = True
        return ~fails

    def apart(self, fits: Bools, triangles: Ints, weld: Ints) -> Bools:
        """(moves,) True for those that fit and change no face, and make no edge, of one that moves less far."""
        ranks = np.full(len(weld), len(weld))
        order = np.flatnonzero(fits)[np.argsort(self.lengths[fits], kind="stable")]
        ranks[self.vertices[order]] = np.arange(len(order))
        of_faces = ranks[triangles]
        first = of_faces.min(axis=1)
        later = triangles[of_faces > first[:, None]]
        going = fits & ~flags_of(later, len(weld))[self.vertices]
        links = np.flatnonzero(going[self.of_links])
        links = links[np.argsort(ranks[self.vertices[self.of_links[links]]], kind="stable")]
        _, firsts = np.unique(_keys(self.links[links], weld), return_index=True)
        going[self.of_links[np.delete(links, firsts)]] = False
        return going


def _fans(triangles: Ints, chosen: Bools, lengths: Callable[[Ints], Floats]) -> tuple[Ints, Floats]:
    """(faces, 3) those round each chosen vertex, with the vertex first, and (faces,) steps to the second corners.

    The nearest second corners come first. As faces go round a vertex, each neighbour is one of these.
    """
    face, corner = np.nonzero(chosen[triangles])
    fans = triangles[face[:, None], (corner[:, None] + np.arange(3)) % 3]
    sizes = np.rint(lengths(fans[:, :2]) / STEP)
    order = np.lexsort((fans[:, 1], sizes, fans[:, 0]))
    return fans[order], sizes[order]


def _at_borders(triangles: Ints, chosen: Bools) -> Bools:
    """(vertices,) True for chosen vertices at an edge that is not one of two faces that wind alike."""
    edges = Edges.of(triangles[any_of(chosen, triangles)])
    alone = np.ones(len(edges.vertices), np.bool_)
    alone[edges.pairs[edges.way > 0]] = False
    return flags_of(edges.vertices[alone], len(chosen))


def _keys(ends: Ints, weld: Ints) -> Ints:
    """(edges,) a number for each of (edges, 2) vertices, the same whichever comes first."""
    one, other = weld[ends].T
    return np.asarray(np.minimum(one, other) * len(weld) + np.maximum(one, other))


def _replaced(positions: Floats, faces: Ints, targets: Ints, tolerance: float) -> tuple[Bools, Bools]:
    """Look at (faces, 3) faces whose first corners move onto (faces,) targets.

    Returns:
        (faces,) True for those that are neither turned nor narrow, and True for those that stay near their corner.
    """
    before, b, c = (positions.T.take(each, axis=1) for each in faces.T)
    a = positions.T.take(targets, axis=1)
    old, new = (np.array(cross(b - each, c - each)) for each in (before, a))
    old_area, area = np.sqrt(dot(old, old)), np.sqrt(dot(new, new))
    old_side, side = (
        np.maximum(dot(c - b, c - b), np.maximum(dot(b - each, b - each), dot(c - each, c - each)))
        for each in (before, a)
    )
    narrow = (area < _NARROW * side) & (area * old_side < old_area * side)
    shapely = (dot(old, new) > _LEAST_COSINE * old_area * area) & ~narrow
    normal = new / np.maximum(area, TINY)
    beside = np.min([dot(cross(q - p, before - p), normal) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return shapely, (np.abs(dot(before - a, normal)) <= tolerance) & (beside >= -_BESIDE * area)
