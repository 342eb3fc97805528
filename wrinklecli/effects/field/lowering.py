"""Lowers a field in the places where some pose shows it at fault.

Two things are at fault: a triangle that the field turns over and the skin alone does not, and an edge that passes
through a triangle, in a place where the skin alone has fewer of these. A field's heights are ours, and level it is the
skin, so this always has an answer.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from wrinklecli.character.pose import joint_matrices, node_rows
from wrinklecli.effects.below import losses_below
from wrinklecli.effects.faults import turned_over
from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.effects.field.compression import along
from wrinklecli.effects.field.factors import UNSEEN, weights_of
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    any_of,
    components,
    cross,
    distinct_values,
    dot,
    flags_of,
    runs,
)
from wrinklecli.numeric.intersections import Crossings, crossing, edges_of
from wrinklecli.numeric.processes import in_threads
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement

# Most poses in which the surface is looked at.
_POSES = 48
# Moments of a clip that they are chosen from, evenly spread; and the least distance of their weights: the default of
# --max-error, as players may be as far off.
_MOMENTS, _APART = 25, 0.01
# Halvings of what is at fault for the first time. Each further time takes as many as all before and a first one more,
# so that even shapes that hardly act become level. Most faults are gone after a little, which leaves a fold to be seen.
_FIRST = 0.25
# Wavelengths from a furrow to its crest, over which the fold beside one that is lowered keeps its height. Along crests
# it takes a whole one, as folds that end within less look torn.
_ACROSS = 0.5


def lowering(attached: AttachedField, ground: Ground, fine: Refinement, heights: Floats, ways: Floats) -> Floats:
    """(shapes, vertices) heights of which hardly anything is at fault in some poses.

    The shape that is highest at a place in a pose that shows a fault is lowered first: folds that a deep crease hides
    stay as they are in a bend that shows them, as the crease takes them back beyond that.

    Args:
        attached: The field.
        ground: The mesh, whose clips the surface is looked at in, too.
        fine: The refined surface.
        heights: (shapes, vertices) of the refined surface at weight 1.
        ways: (vertices, 3) displacements for a height of 1, bind space.
    """
    matrices, weights, of_clips = _poses(attached, ground)
    # For as much as a crease acts, its side is lowered apart from what it is in a slight bend.
    own, every = np.flatnonzero(attached.factors.creases), np.arange(len(heights))
    apart = np.eye(len(every))
    apart[own, own - 1] = -1.0
    weights, heights = weights @ apart, heights[every - attached.factors.creases]
    influences = fine.influences(matrices.shape[1], np.arange(len(fine.positions))).sparse()
    slopes, surface = _Slopes.of(fine, attached), _Posed(fine, matrices, ways, influences)
    raised = weights @ heights
    counting = raised > 0
    if attached.tool.contact is None:
        # Clips are what is seen, and beside their deepest moments other places cross. In all poses of sweeps, crossings
        # take half of a bake's time: so each shape is looked at where it acts most, and with its crease where both do.
        acting = np.where(of_clips[:, None], 0.0, np.hstack([weights, weights[:, own - 1] * weights[:, own]]))
        most = np.arange(len(weights))[:, None] == acting.argmax(axis=0)
        counting &= of_clips[:, None] | (most @ np.vstack([heights, heights[own]]) > 0)
    looks = [*_turning(surface, raised, slopes), *_crossing(surface, raised, counting)]
    halvings, looked = np.zeros(heights.shape), looks
    left = np.repeat(_below_layers(ground, fine, raised.max(axis=0), ways, slopes), len(heights), axis=0)
    # What is lowered again and again becomes level, so this ends.
    while looked:
        lowered, marked, found = left * heights, np.zeros(heights.shape), []
        rows = weights[[each.pose for each in looked]] @ lowered
        seen = in_threads(lambda pair: pair[0].faults(pair[1]), [*zip(looked, rows, strict=True)])
        for look, faults in zip(looked, seen, strict=True):
            if len(faults):
                # What is level may be at fault by what is beside it.
                acting = weights[look.pose][:, None] * slopes.around(faults, lowered)
                marked[:, faults] = np.maximum(marked[:, faults], (acting == acting.max(axis=0)) & (acting > 0))
                found.append(look)
        beside = slopes.beside(np.flatnonzero(marked.any(axis=0)))
        if len(beside):
            # Level, with all triangles that give its corners their normals, it is at fault as the skin is.
            faulty = slopes.around(beside, marked)
            halvings[:, beside] = np.where(faulty > 0, 2.0 * halvings[:, beside] + _FIRST, halvings[:, beside])
            limits = np.exp2(-halvings[:, beside])
            left = slopes.below(left, beside, np.where(limits > UNSEEN, limits, 0.0))
            looked = found
        else:
            # What was lowered for one pose may be at fault in another.
            looked = [] if looked is looks else looks
    lowered = left * heights
    lowered[own] -= lowered[own - 1]
    return lowered


def _below_layers(ground: Ground, fine: Refinement, tallest: Floats, ways: Floats, slopes: "_Slopes") -> Floats:
    """(1, vertices) factors by which (vertices,) heights stay below the layers over the mesh."""
    high = np.flatnonzero(tallest)
    moves = np.einsum("vij,vj->vi", fine.blended_at(fine.rest, high)[:, :, :3], ways[high])
    losses = losses_below(ground, fine, high, tallest[high] * (moves * fine.rest_normals_at(high)).sum(axis=1))
    return slopes.below(np.ones((1, len(tallest))), high[losses > 0], 1.0 - losses[losses > 0])


def _poses(attached: AttachedField, ground: Ground) -> tuple[Floats, Floats, Bools]:
    """(poses, joints, 4, 4) matrices and (poses, shapes) weights of clips, then of sweeps, the most different first.

    The last result has (poses,) flags of those of clips.

    Clips are what is seen. They show how far joints turn, and together: between the poses of a sweep a crease may turn
    a triangle. Each next pose is the one whose weights are farthest from those of all before it, and from level.
    """
    sweeps, factors = attached.sweeps, attached.factors
    drive, rig, nodes = replace(attached.drive, strengths={}, strength=1.0), ground.rig, sorted(attached.drive.nodes)
    moments = [(clip, np.linspace(clip.start, clip.end, _MOMENTS)) for clip in ground.clips]
    # All clips are measured at once, as of a character without any, hundreds of motions are looked at.
    rows = [np.zeros((len(nodes), 3, 4, 0))]
    for clip, times in moments:
        rows.append(np.stack([np.broadcast_to(each, (3, 4, _MOMENTS)) for each in node_rows(rig, clip, times, nodes)]))
    known = dict(zip(nodes, np.concatenate(rows, axis=3), strict=True))
    read = drive.reader(rig, None)(np.zeros(_MOMENTS * len(moments)), known)
    every = np.concatenate([drive.weights(None, read), weights_of(sweeps, factors.tables)])
    of_clips = np.arange(len(every)) < len(every) - len(sweeps.matrices)
    chosen, apart = list[int](), (every**2).sum(axis=1)
    for own in (of_clips, ~of_clips):
        while len(chosen) < _POSES and (apart * own).max() > _APART**2:
            chosen.append(int((apart * own).argmax()))
            apart = np.minimum(apart, ((every - every[chosen[-1]]) ** 2).sum(axis=1))
    matrices = [joint_matrices(rig, *moments[each // _MOMENTS])[each % _MOMENTS] for each in chosen if of_clips[each]]
    matrices += [sweeps.matrices[each - len(every)] for each in chosen if not of_clips[each]]
    return np.reshape(matrices, (-1, *sweeps.matrices.shape[1:])), every[chosen], of_clips[chosen]


@dataclass(frozen=True, slots=True, eq=False)
class _Slopes:
    """The greatest rise of a field's factors beside lower ones, along the edges of a surface.

    Attributes:
        firsts: (vertices,) where the neighbours of each begin, itself among them,
        counts: (vertices,) and how many they are.
        others: (neighbours,) their numbers.
        rises: (neighbours,) most by which a factor is greater than that of the neighbour.
    """

    firsts: Ints
    counts: Ints
    others: Ints
    rises: Floats

    @classmethod
    def of(cls, fine: Refinement, attached: AttachedField) -> "_Slopes":
        """Let factors rise from 0 to 1 over a wavelength along crests, and from a furrow to its crest across them."""
        edges, itself = edges_of(fine.triangles), np.arange(len(fine.positions))
        one, other = np.concatenate([edges, edges[:, ::-1], np.stack([itself, itself], axis=1)]).T
        order = np.argsort(one, kind="stable")
        ways = fine.rest_positions[one] - fine.rest_positions[other]
        directions = fine.subdivision.interpolate(attached.region.directions)
        across = np.maximum(-along((directions[one] + directions[other]) / 2.0, ways, ways), 0.0)
        lengths = np.sqrt(np.sum(ways**2, axis=1) + (_ACROSS**-2 - 1.0) * across)
        rises = lengths[order] / attached.wavelength
        counts = np.bincount(one, minlength=len(itself))
        return cls(np.cumsum(counts) - counts, counts, other[order], rises)

    def beside(self, chosen: Ints) -> Ints:
        """(near,) sorted vertices that are chosen, and their neighbours."""
        return distinct_values(self.others[runs(self.firsts[chosen], self.counts[chosen])])

    def around(self, chosen: Ints, values: Floats) -> Floats:
        """(shapes, chosen) the greatest of (shapes, vertices) values of some vertices and their neighbours."""
        own, firsts = self._around(chosen)
        return np.asarray(np.maximum.reduceat(values[:, self.others[own]], firsts, axis=1))

    def below(self, factors: Floats, chosen: Ints, limits: Floats) -> Floats:
        """(shapes, vertices) the greatest factors below others, and below limits of some, that rise no faster."""
        found, changed = factors.copy(), chosen
        found[:, chosen] = np.minimum(found[:, chosen], limits)
        while len(changed):
            near = self.beside(changed)
            own, firsts = self._around(near)
            lower = np.minimum.reduceat(found[:, self.others[own]] + self.rises[own], firsts, axis=1)
            changed = near[(lower < found[:, near]).any(axis=0)]
            found[:, near] = lower
        return found

    def _around(self, chosen: Ints) -> tuple[Ints, Ints]:
        """The places of the neighbours of some vertices, and where each one's begin among these."""
        counts = self.counts[chosen]
        return runs(self.firsts[chosen], counts), np.cumsum(counts) - counts


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """A part of the surface in a pose, and what is at fault there.

    Attributes:
        pose: The number of the pose.
        vertices: (own,) those of the part.
        still: (3, own) places in the skin.
        ways: (3, own) displacements for a height of 1.
        at_fault: Gives the indices of those that are at fault at (3, own) places.
    """

    pose: int
    vertices: Ints
    still: Floats
    ways: Floats
    at_fault: Callable[[Floats], Ints]

    def faults(self, raised: Floats) -> Ints:
        """The vertices at fault with a field of (vertices,) heights."""
        return self.vertices[self.at_fault(self.still + self.ways * raised[self.vertices])]


@dataclass(frozen=True, slots=True, eq=False)
class _Posed:
    """A refined surface in (poses, joints, 4, 4) poses, with (vertices, 3) displacements for a height of 1.

    `influences` are its (vertices, joints) sparse skin weights.
    """

    fine: Refinement
    matrices: Floats
    ways: Floats
    influences: Any

    def at(self, pose: int, vertices: Ints) -> tuple[Floats, Floats]:
        """(3, own) places of some vertices in the skin, and displacements for a height of 1."""
        rows = np.ascontiguousarray(self.matrices[pose, :, :3]).reshape(-1, 12)
        blended = np.ascontiguousarray((self.influences[vertices] @ rows).T).reshape(3, 4, -1)
        bind, ways = self.fine.bind_positions[vertices].T, self.ways[vertices].T
        still = np.einsum("abv,bv->av", blended[:, :3], bind) + blended[:, 3]
        return still, np.einsum("abv,bv->av", blended[:, :3], ways)


def _turning(surface: _Posed, raised: Floats, slopes: _Slopes) -> list[_Look]:
    """The looks at triangles: only near those that the whole field turns over in a pose."""
    every = range(len(raised))
    found = in_threads(lambda pose: _turned(surface, pose, raised[pose] > 0).faults(raised[pose]), every)
    # What is lowered for these may turn others.
    faults, level = slopes.beside(distinct_values(np.concatenate(found))), np.ones((1, raised.shape[1]))
    reached = slopes.below(level, faults, np.zeros((1, len(faults))))[0] < 1.0
    inside = reached & (raised > 0)
    return in_threads(lambda pose: _turned(surface, pose, inside[pose]), np.flatnonzero(inside.any(axis=1)).tolist())


def _turned(surface: _Posed, pose: int, inside: Bools) -> _Look:
    """A look at the triangles with a corner among (vertices,) that are inside, by the normals of their corners.

    Those that the skin turns over itself do not count.
    """
    triangles = surface.fine.triangles
    judged = any_of(inside, triangles)
    around = any_of(flags_of(triangles[judged], len(inside)), triangles)
    vertices, corners = _numbered(triangles[around], len(inside))
    still, ways = surface.at(pose, vertices)
    skinned = _faces(still, corners)
    judged = judged[around] & ~turned_over(corners, skinned, _sums(skinned, corners, len(vertices)))

    def at_fault(places: Floats) -> Ints:
        faces = _faces(places, corners)
        over = turned_over(corners, faces, _sums(faces, corners, len(vertices)))
        return distinct_values(corners[judged & (over | (dot(faces, skinned) < 0.0))])

    return _Look(pose, vertices, still, ways, at_fault)


def _numbered(triangles: Ints, count: int) -> tuple[Ints, Ints]:
    """(used,) sorted vertices of (n, k) triangles or pairs, of so many, and the (n, k) numbers among these."""
    used = flags_of(triangles, count)
    return np.flatnonzero(used), (np.cumsum(used) - 1)[triangles]


def _faces(places: Floats, triangles: Ints) -> list[Floats]:
    """Three (triangles,) coordinates of the triangles' normals at (3, vertices) places."""
    a, b, c = (places.take(corner, axis=1) for corner in triangles.T)
    return cross(b - a, c - a)


def _sums(faces: list[Floats], triangles: Ints, count: int) -> Floats:
    """(3, vertices) sums of three (triangles,) coordinates of normals around each of so many vertices."""
    at = triangles.ravel()
    return np.array([np.bincount(at, np.repeat(each, 3), count) for each in faces])


def _crossing(surface: _Posed, raised: Floats, counting: Bools) -> list[_Look]:
    """The looks at crossings of which some (poses, vertices) count: at what may cross between skin and whole field."""
    triangles, every = surface.fine.triangles, np.arange(raised.shape[1])
    apart = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    trees = Crossings.of(surface.fine.rest_positions, triangles[apart])

    def look(pose: int) -> _Look:
        still, ways = surface.at(pose, every)
        pairs = trees.may_cross(still.T, (still + ways * raised[pose]).T, counting[pose])
        vertices, pairs = _numbered(pairs, len(every))
        return _crossed(pose, vertices, still[:, vertices], ways[:, vertices], pairs.astype(np.int32))

    return in_threads(look, np.flatnonzero(counting.any(axis=1)).tolist())


def _crossed(pose: int, vertices: Ints, still: Floats, ways: Floats, pairs: Ints) -> _Look:
    """A look at a surface that may pass through itself: what crosses in a row is at fault if it has become longer.

    Most rows are creases in which the skin passes through itself, and the field may shift those.

    `pairs` are (pairs, 5) indices of the two ends of edges, and of the three corners of triangles.
    """

    def linked(own: Ints) -> Ints:
        """(vertices,) the components of what (pairs, 5) link."""
        return components(own[:, [0, 1, 0, 2, 0, 3, 0, 4]].reshape(-1, 2), len(vertices))

    skinned = crossing(still, pairs[:, :2], pairs[:, 2:])
    # What crosses in the skin is in a row anyway.
    creases = linked(pairs[skinned])

    def at_fault(places: Floats) -> Ints:
        found = crossing(places, pairs[:, :2], pairs[:, 2:])
        changed = np.flatnonzero(found != skinned)
        own, added = pairs[changed], found[changed]
        rows = linked(creases[own[added]])[creases[own[:, 0]]]
        more = np.bincount(rows, np.where(added, 1.0, -1.0)) > 0
        return distinct_values(own[added & more[rows]])

    return _Look(pose, vertices, still, ways, at_fault)
