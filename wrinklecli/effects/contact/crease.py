"""Creases: what contact does in a fold, as few fixed shapes, for any clip: solved for the joint's own motion.

The joint turns through its range, and four times more with its axis leaning by 10° to a side. What module `folding`
finds there is compressed into shapes. A clip's weights come from marching the clip itself and fitting the shapes to
what is found; those of a clip that was never baked are looked up by the joint's angle.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import approach
from wrinklecli.effects.contact.fitting import fewest, fitted, made_of
from wrinklecli.effects.contact.fold import RINGS, Fold
from wrinklecli.effects.contact.folding import (
    Found,
    crossing_vertices,
    found_in,
    free_rows,
    is_clear,
    last_of,
    positions_of,
)
from wrinklecli.effects.contact.tissue import FREE, SOFT, UNITS, Tissue
from wrinklecli.numeric.arrays import Bools, Floats, Ints, interpolated
from wrinklecli.numeric.intersections import widened

# Strides between two poses of a sweep that leans: what is between these the others tell.
_LEANING_STRIDES = 2.0
# Solver's units that contact moves anything by, where a sweep ends: a limb is pressed by half of its radius, and by a
# quarter where the axis leans. Leaning as deep asks for more shapes than clips that fold so deep have use for.
_DEEPEST, _DEEPEST_LEANING = 36.0, 18.0
# Poses of a sweep that are looked at for crossings: those that fold most, and some on the way there.
_LOOKS = 8
# Poses from rest to the beginning of a clip that is folded there.
_APPROACH = 33


@dataclass(frozen=True)
class Crease:
    """A fold whose contact is resolved.

    Attributes:
        fold: The surface round the joint.
        tissue: What may touch.
        shapes: (shapes, free, 3) bind space, at weight 1, of the vertices that may move.
        rows: (rows,) radians of the joint about its axis, or shortenings of the tool that rises, rising,
        table: and (rows, shapes) weights there.
        samples: Weights, and the motions and times in which normals are to be right with them.
        error: How far the shapes are from what was found in the sweeps, at most, scene units.
        largest: The greatest move that was found, scene units.
        squeezed: Volume that the shapes take away in the sweeps, at most, of a limb's as long as it is thick.
        unsettled: Poses of the sweeps whose solution did not settle.
        crossing: Poses of the sweeps in which the shapes leave crossings.
        solved: Poses of the sweeps with contact.
    """

    fold: Fold
    tissue: Tissue
    shapes: Floats
    rows: Floats
    table: Floats
    samples: tuple[tuple[Floats, Clip, float], ...]
    error: float
    largest: float
    squeezed: float
    unsettled: int
    crossing: int
    solved: int

    @property
    def vertices(self) -> Ints:
        """(free,) fine welded vertices that may move, rising."""
        return self.fold.vertices[free_rows(self.tissue)]

    @property
    def sizes(self) -> Floats:
        """(shapes,) how far each moves a vertex at most, bind units."""
        return np.asarray(np.sqrt(np.sum(self.shapes**2, axis=2)).max(axis=1))

    def marched(self, clip: Clip | None, times: Floats) -> Iterator[Found]:
        """What contact does at (frames,) seconds of a clip, rising, from rest to its beginning where that is folded.

        Times are to be near enough to each other for the surface to follow.
        """
        start = None
        if clip is not None and not is_clear(self.fold, self.tissue, clip, float(times[0])):
            way = approach(clip, float(times[0]), self.fold.rig)
            start = last_of(found_in(self.fold, self.tissue, way, np.linspace(0.0, 1.0, _APPROACH)))
        return found_in(self.fold, self.tissue, clip, times, start)

    def follow(self, clip: Clip | None, times: Floats, marched: Iterable[Found]) -> "Followed":
        """Fit the shapes to a clip.

        A clip that folds the surface otherwise than the joint alone does may get from the shapes more crossings than
        they take away: it is left as it was.

        Args:
            clip: The animation.
            times: (frames,) seconds.
            marched: What contact does there.
        """
        weights, error, unsettled = np.zeros((len(times), len(self.shapes))), 0.0, 0
        urgent: Floats | None = None
        touching: list[int] = []
        left: list[int] = []  # of frames that cross still, how many vertices do
        for frame, found in enumerate(marched):
            unsettled += not found.state.converged
            if found.touches:
                weights[frame], urgent, crosses = fitted(found, self.shapes, urgent)
                urgent = None if crosses else urgent
                moved = made_of(weights[frame], self.shapes)
                if crosses and clip is not None:
                    # Those of the fold's own motion may leave none.
                    looked = self._looked_up(clip, times[frame : frame + 1])
                    own = made_of(looked, self.shapes)
                    if found.crossing(own) is None:
                        weights[frame], moved, crosses = looked, own, False
                error = max(error, found.missed(moved))
                touching.append(frame)
                if crosses:
                    left.append(crossing_vertices(self.tissue, found.with_moved(moved)))
        given_up = bool(left) and sum(left) > sum(
            crossing_vertices(self.tissue, positions)
            for positions in positions_of(self.fold, self.tissue, clip, times[touching])
        )
        if given_up:
            weights[:] = 0.0
        return Followed(weights, error * self.fold.radius / UNITS, unsettled, len(left), given_up)

    def for_clip(
        self, clip: Clip, times: Floats, marched: Sequence[Found], *, share: float, most: int
    ) -> "tuple[Crease, Followed]":
        """The same fold with shapes for what contact does in one clip alone, as `resolve`; and how they follow it.

        Args:
            clip: The animation, in which something touches.
            times: (frames,) seconds.
            marched: What contact does there.
            share: Greatest error of a vertex, of the greatest move.
            most: Shapes at most.
        """
        touching = [frame for frame, found in enumerate(marched) if found.touches]
        solved = [marched[frame] for frame in touching]
        made, shapes, crossing = fewest(solved, share=share, most=most)
        weights = np.zeros((len(times), len(shapes)))
        weights[touching] = made
        scale = self.fold.radius / UNITS
        error = scale * max(each.missed(made_of(row, shapes)) for each, row in zip(solved, made, strict=True))
        unsettled = sum(not each.state.converged for each in solved)
        samples = tuple((made[k], clip, float(times[touching[k]])) for k in _chosen(made))
        own = replace(self, shapes=shapes, table=np.zeros((len(self.rows), len(shapes))), samples=samples)
        return own, Followed(weights, error, unsettled, crossing)

    def _looked_up(self, clip: Clip, times: Floats) -> Floats:
        """(shapes,) weights at (1,) second of a clip, as a player finds them who knows the table alone."""
        (weights,) = interpolated(self.fold.hinge.rows_in(self.fold.rig, clip, times), self.rows, self.table)
        return np.asarray(weights)


@dataclass(frozen=True, slots=True)
class Followed:
    """A clip as the shapes of a crease follow it.

    Attributes:
        weights: (frames, shapes).
        error: How far the shapes are from what was found, at most, scene units.
        unsettled: Frames whose solution did not settle.
        crossing: Frames in which the shapes leave crossings.
        given_up: Whether the clip is as without contact, as there would be more crossings with it.
    """

    weights: Floats
    error: float
    unsettled: int
    crossing: int
    given_up: bool = False


def resolve(fold: Fold, *, share: float, most: int) -> Crease | None:
    """Solve a fold for its joint's motion, and compress what is found; None where nothing ever crosses.

    Args:
        fold: The surface round a joint.
        share: Greatest error of a vertex, of the greatest move. Shapes are more than that asks for where they would
            leave crossings.
        most: Shapes at most, whatever they leave.
    """
    apart = _apart(fold)
    if apart is None:
        return None
    tissue = _tissue(fold, apart)
    solved = list(_swept(fold, tissue))
    if not solved:
        return None
    weights, shapes, crossing = fewest([each.found for each in solved], share=share, most=most)
    made = [(each.found, made_of(row, shapes)) for each, row in zip(solved, weights, strict=True)]
    scale = fold.radius / UNITS
    rows, table = _tabulated(fold, solved, weights)
    return Crease(
        fold=fold,
        tissue=tissue,
        shapes=shapes,
        rows=rows,
        table=table,
        samples=tuple((weights[k], solved[k].clip, solved[k].time) for k in _chosen(weights)),
        error=scale * max(found.missed(moved) for found, moved in made),
        largest=scale * max(each.found.length for each in solved),
        squeezed=max(found.squeezed(moved) for found, moved in made),
        unsettled=sum(not each.found.state.converged for each in solved),
        crossing=crossing,
        solved=len(solved),
    )


@dataclass(frozen=True, slots=True)
class _Solved:
    """A pose of a sweep in which contact moves something.

    Attributes:
        clip: The sweep,
        time: and when.
        folded: How far the joint is turned, radians, or which share of a rise it is.
        leaning: Whether the axis leans.
        found: What contact does.
    """

    clip: Clip
    time: float
    folded: float
    leaning: bool
    found: Found


def _swept(fold: Fold, tissue: Tissue) -> Iterator[_Solved]:
    """Fold it as far as it goes, and with the axis leaning to each side."""
    for lean in fold.hinge.leanings:
        leaning = bool(lean.any())
        for end in fold.hinge.ends:
            way = _way(end, fold.hinge.stride * (_LEANING_STRIDES if leaning else 1.0))
            clip = fold.hinge.turn(way, tilt=lean)
            times = np.linspace(0.0, 1.0, len(way))
            for folded, time, found in zip(way, times, found_in(fold, tissue, clip, times), strict=True):
                if found.touches:
                    yield _Solved(clip, float(time), float(folded), leaning, found)
                    if found.length > (_DEEPEST_LEANING if leaning else _DEEPEST):
                        break


def _tabulated(fold: Fold, solved: Sequence[_Solved], weights: Floats) -> tuple[Floats, Floats]:
    """(rows,) of the fold's own motion, rising, and (rows, shapes) weights: 0 at rest and before a touch."""
    central = [(each.folded, number) for number, each in enumerate(solved) if not each.leaning]
    ahead = {0.0}
    for sign in (1.0, -1.0):
        nearest = min((sign * folded for folded, _ in central if sign * folded > 0), default=0.0)
        ahead.add(sign * max(nearest - fold.hinge.stride, 0.0))
    every = sorted([*central, *((folded, len(solved)) for folded in ahead)])
    padded = np.concatenate([weights, np.zeros((1, weights.shape[1]))])
    rows = fold.hinge.rows(np.array([folded for folded, _ in every]))
    # A morph target may take the ends past where they are nearest.
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(rows), prepend=-np.inf) > 0)
    return rows[rising], padded[[number for _, number in every]][rising]


def _chosen(weights: Floats) -> list[int]:
    """Frames in which normals are to be right: those where a shape is greatest, and an even choice."""
    even = np.linspace(0, len(weights) - 1, 8).astype(int).tolist()
    return sorted({*even, *np.argmax(np.abs(weights), axis=0).tolist()})


def _way(end: float, stride: float) -> Floats:
    """(poses,) from 0 to an end, evenly spaced."""
    return np.linspace(0.0, end, int(np.ceil(abs(end) / stride)) + 1)


def _apart(fold: Fold) -> Floats | None:
    """(vertices,) how far each is at rest from any that crosses in a sweep and not at rest, solver's units.

    Where edges are long, a vertex counts as nearer: what crosses fades over `RINGS` edges at least.
    """
    from scipy.spatial import cKDTree

    still = fold.crossing(fold.rest_positions)
    marked = np.zeros(len(fold.own), bool)
    for lean in fold.hinge.leanings:
        for end in fold.hinge.ends:
            clip = fold.hinge.turn(_way(end, fold.hinge.stride), tilt=lean)
            looks = np.linspace(0.0, 1.0, _LOOKS)[1:] if not lean.any() else np.ones(1)
            for positions in fold.posed(clip, looks)[0]:
                marked |= fold.crossing(positions)
    marked &= ~still
    if not marked[fold.own].any():
        return None
    apart = np.asarray(cKDTree(fold.rest_positions[marked]).query(fold.rest_positions)[0] * UNITS / fold.radius)
    for ring in range(1, RINGS + 1):
        marked, within = widened(fold.crossings.edges, marked), marked
        apart = np.where(marked & ~within, np.minimum(apart, FREE * SOFT * ring / (RINGS + 1)), apart)
    return apart


def _border(fold: Fold) -> Bools:
    """(vertices,) those with triangles beyond the fold, which must stay where they are; none of other meshes."""
    inside = np.bincount(fold.triangles.reshape(-1), minlength=len(fold.own))[: len(fold.vertices)]
    starts = fold.fine.around.starts
    return np.asarray(starts[fold.vertices + 1] - starts[fold.vertices] > inside)


def _tissue(fold: Fold, apart: Floats) -> Tissue:
    free = apart < FREE * SOFT
    free[: len(fold.vertices)] &= ~_border(fold)
    edges, crossed = fold.crossings.at(fold.rest_positions)
    # What is not near any that is free never touched one.
    colliding = np.asarray(free[fold.triangles].any(axis=1))
    colliding[crossed] = False
    through = np.zeros(len(free), bool)
    through[fold.crossings.edges[edges]] = True
    colliding[(through & ~fold.own)[fold.triangles].any(axis=1)] = False
    tissue = Tissue(fold.rest_positions * UNITS / fold.radius, fold.triangles, colliding, free, fold.own, apart)
    return tissue if fold.own.all() else tissue.without_close_meshes()
