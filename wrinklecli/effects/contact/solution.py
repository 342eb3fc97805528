"""Solves a fold in the poses of a clip, by module `march`, and gives the solutions in bind space."""

from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from itertools import islice

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.fold import REACH_RADII, Fold
from wrinklecli.effects.contact.hinge import STRIDE
from wrinklecli.effects.contact.march import march
from wrinklecli.effects.contact.pose_faults import DEGENERATE, TOO_MANY_STEPS, TORN, UNSETTLED, unless_degenerate
from wrinklecli.effects.contact.response import Response
from wrinklecli.effects.contact.tissue import UNITS, SkinnedPose, SolverState, Tissue
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, inverses, unit
from wrinklecli.numeric.intersections import widened

# Poses are solved a stride of a hinge apart, as far as players look up between two rows, or where the surface has moved
# as far as the ends of a fold do in one, solver's units.
_STEP = STRIDE * REACH_RADII * UNITS
# The way round by a pose that lies between two others, relative to the straight one.
_DETOUR = 1.1
# Length in steps that the straight way counts as at least: poses nearer than an eighth of a step are alike. In a person
# who stands and talks, each frame differs from all others by less; solutions as near differ by 0.2 solver's units.
_ALIKE = 0.25
# Most poses of such a step, for their memory.
_MOST_AT_ONCE = 32
# Poses that are skipped together if nothing is near in the last one: 16° of a sweep, or an eighth of a second.
_AHEAD = 4
# Distance of solved poses that others start from, solver's units: about a quarter of a step of a sweep. A long clip
# comes back to the same poses again and again.
_APART = 4.0
# Steps of the solver in poses that do not settle, in a sweep or clip, beyond as many as in those that do: four poses. A
# clip takes at most about twice as long as its good poses so.
_MOST_STEPS = 128
# Least weight of a squared error, where nothing touches, relative to 1 where something does: an error ten times as long
# is as good there, hidden in the fold.
_LEAST_WEIGHT = 0.01
# Around touching vertices the weight falls over this many rings, since these vertices may touch next,
_RINGS = 3
# by this factor for each ring.
_RING_FACTOR = 0.4
# Volume of a piece of a limb as long as it is thick, cubic solver's units.
_VOLUME = 2.0 * np.pi * UNITS**3
# Touching vertices may be moved this much further apart than the solution, solver's units: the fold hides it.
_OPEN = 1.5


@dataclass(frozen=True, eq=False)
class Solution:
    """The solution of a pose: the move that contact gives the free vertices of the fold's own mesh.

    Methods evaluate another (free, 3) move, in bind space, against it.

    Attributes:
        moved: (free, 3) the solution's move, bind space.
        error_weights: (free,) weights of squared errors.
        outward: (free, 3) unit directions in which the barrier pushes, solver's units; 0 where nothing is near.
        positions: (vertices, 3) skinned positions, solver's units.
        matrices: (free, 3, 3) from bind space to solver's units.
        fault: The reason why contact does not count in the pose; None if it does.
        between: If the pose is not solved, the numbers of two that are, and its part of the way between these.
    """

    tissue: Tissue
    moved: Floats
    error_weights: Floats
    outward: Floats
    positions: Floats
    matrices: Floats
    fault: str | None = None
    between: tuple[int, int, float] | None = None

    @property
    def touches(self) -> bool:
        """True if contact moves anything."""
        return bool(self.moved.any())

    @property
    def greatest_move(self) -> float:
        """Length of the greatest move, solver's units."""
        return float(self.errors(np.zeros_like(self.moved)).max(initial=0.0))

    def errors(self, moved: Floats) -> Floats:
        """(free,) distances of another move from the solution, solver's units."""
        posed = np.einsum("vij,vj->vi", self.matrices, self.moved - moved)
        return np.asarray(np.sqrt(np.sum(posed**2, axis=1)))

    def with_neighbours(self, marked: Bools) -> Bools:
        """(free,) the marked vertices and their neighbours."""
        rows, every = self.tissue.free_rows, np.zeros(len(self.positions), bool)
        every[rows] = marked
        return widened(self.tissue.edges, every)[rows]

    def positions_under(self, moved: Floats) -> Floats:
        """(vertices, 3) positions of all vertices under another move, solver's units."""
        positions = self.positions.copy()
        positions[self.tissue.free_rows] += np.einsum("vij,vj->vi", self.matrices, moved)
        return positions

    @property
    def crosses_itself(self) -> bool:
        """True if anything crosses in the solution, for example where another mesh leaves no room."""
        return bool(self._own_crossings.any())

    def crossing(self, moved: Floats) -> Bools:
        """(free,) vertices that cross under another move and not in the solution."""
        marked = self.tissue.crossing(self.positions_under(moved))
        return marked[self.tissue.free_rows] & ~self._own_crossings if marked.any() else np.zeros(len(moved), bool)

    def volume_change(self, moved: Floats) -> float:
        """Volume that another move adds, relative to that of a limb as long as it is thick."""
        return float(np.sum(self.tissue.pieces.volumes(self.positions_under(moved)) - self._volumes)) / _VOLUME

    @cached_property
    def _volumes(self) -> Floats:
        """(pieces,) volumes of the tissue's pieces under the skinned positions."""
        return self.tissue.pieces.volumes(self.positions)

    @cached_property
    def held_volume(self) -> tuple[Floats, float]:
        """(free, 3) change of the volume with the solution's move, and its product with moves that change no volume.

        Both are for moves in solver's units. A solution changes some volume itself: a whole limb that gives way by a
        tenth of a unit loses as much as a small bulge of five units has, which must not stand for it.
        """
        pushed = np.sum(self.tissue.pieces.gradients(self.positions_under(self.moved)), axis=0)
        scale = np.sqrt(np.mean(np.sum(self.matrices**2, axis=(1, 2))) / 3.0)
        gradient = np.einsum("vij,vi->vj", self.matrices, pushed[self.tissue.free_rows]) / (scale * _VOLUME)
        return gradient, float(np.sum(gradient * self.moved)) - self.volume_change(self.moved) / scale

    def opened(self, moved: Floats) -> Floats:
        """(free, 3) the solution's move, opened further where another move opens it; the fold hides small gaps."""
        away = np.einsum("vij,vj,vi->v", self.matrices, moved - self.moved, self.outward)
        rows = np.flatnonzero(away > 0.0)
        further = np.minimum(away[rows], _OPEN)[:, None] * self.outward[rows]
        wanted = self.moved.copy()
        wanted[rows] += np.einsum("vij,vj->vi", inverses(self.matrices[rows]), further)
        return wanted

    def tears(self, moved: Floats) -> bool:
        """True if another move tears the surface."""
        return self.tissue.tears(self.positions, self.positions_under(moved))

    @cached_property
    def _own_crossings(self) -> Bools:
        """(free,) vertices that cross in the solution."""
        return self.tissue.crossing(self.positions_under(self.moved))[self.tissue.free_rows]


@dataclass(slots=True)
class March:
    """The solver's way through the poses of a fold.

    A pose is solved from the solved one that is nearest to it. So it has about the same solution however a clip comes
    to it, and the march goes on after poses that do not settle or are torn. In such a pose contact moves nothing, and
    the solution has a fault. A pose that is further from the nearest solved one than such a pose fails, too, and after
    too many steps in vain so does each in which anything is near.

    Poses that lie between two solved ones that are a step apart get a mean of both, and poses that are like a solved
    one get its solution, unless something would cross, and nothing does in these. Runs of poses are skipped before and
    after which nothing is near.

    Attributes:
        fold: The fold.
        response: That of its surface in one clip.
        reached: The solved poses from which others start.
        spare: Newton steps so far in poses that settle, less those in others.
        fault: The reason why poses that are not solved do not count: that of the last one that was.
        known: The solved poses in which contact moves something.
        spans: The pairs of these between which others lie, one twice if they are like it, and how far apart they are.
        count: Number of poses so far.
    """

    fold: Fold
    response: Response
    reached: "list[_Reached]" = field(default_factory=list)
    spare: int = 0
    fault: str = UNSETTLED
    known: "list[_Solved]" = field(default_factory=list)
    spans: list[tuple[int, int, float]] = field(default_factory=list)
    count: int = 0

    @property
    def goes_on(self) -> bool:
        """False if there were too many steps in vain."""
        return self.spare >= -_MOST_STEPS

    def through(self, clip: Clip, times: Floats, strides: Floats) -> Iterator[Solution]:
        """Solve the fold at (frames,) seconds of a clip, with (frames, hinges) angles there, in strides."""
        rows, ahead, last, place = self.fold.tissue.rows, list[_Pose](), None, np.zeros(0)
        moments = enumerate(zip(_poses(self.fold, clip, times), strides, strict=True), self.count)
        poses = (
            _Pose(number, posed, np.concatenate([turns, posed.positions[rows].reshape(-1) / _STEP]))
            for number, (posed, turns) in moments
        )
        touching = bool(self.reached) and bool(self.reached[-1].state.correction.any())
        self.count += len(times)
        while ahead := [*ahead, *islice(poses, max(_AHEAD - len(ahead), 0))]:
            if not touching and self.fold.tissue.is_clear(ahead[:_AHEAD][-1].posed.positions):
                states = [SolverState(each.posed.positions, each.posed) for each in ahead[:_AHEAD]]
                found = [*map(self._solution, states)]
                self._keep(states[-1], self.reached[-1] if self.reached else None)
            else:
                ahead += islice(poses, _MOST_AT_ONCE - len(ahead))
                found = self._solved(ahead, last, place)
            last, place, ahead = found[-1], ahead[len(found) - 1].place, ahead[len(found) :]
            touching = last.fault is not None or last.touches
            yield from found

    def _solved(self, poses: "Sequence[_Pose]", last: Solution | None, place: Floats) -> list[Solution]:
        """Solve the first few of some poses, or those within a step from the last one before, which has a place."""
        if last is None or not last.touches:
            return [self._between(each) or self._solve(each) for each in poses[:_AHEAD]]
        first, begin = self._between(poses[0]), len(self.known) - 1
        if first is not None or last.between is not None:
            return [first or self._solve(poses[0])]
        moves = list[float]()
        for each in poses:
            moved = _apart(each.place, place)
            if moves and moved > 1.0:
                break
            moves.append(moved)
        # The furthest; of equal ones the last counts.
        count = len(moves) - int(np.argmax(moves[::-1]))
        end = self._solve(poses[count - 1])
        if end.touches:
            self.spans.append((begin, len(self.known) - 1, max(moves[count - 1], _ALIKE)))
        return [*(self._between(each) or self._solve(each) for each in poses[: count - 1]), end]

    def _between(self, pose: "_Pose") -> Solution | None:
        """The mean of two solutions between which a pose lies; None if there are none, or something would cross."""
        apart = [_apart(pose.place, each.place) for each in self.known]
        ways = [(apart[begin] + apart[end]) / length for begin, end, length in self.spans]
        if min(ways, default=_DETOUR) >= _DETOUR:
            return None
        begin, end, _ = self.spans[int(np.argmin(ways))]
        share, one, two = apart[begin] / max(apart[begin] + apart[end], TINY), self.known[begin], self.known[end]
        between = replace(
            self._solution(SolverState(pose.posed.positions, pose.posed)),
            moved=(1.0 - share) * one.found.moved + share * two.found.moved,
            error_weights=np.maximum(one.found.error_weights, two.found.error_weights),
            outward=unit((1.0 - share) * one.found.outward + share * two.found.outward),
            between=(one.number, two.number, share),
        )
        return None if between.crosses_itself else between

    def _keep(self, state: SolverState, nearest: "_Reached | None") -> None:
        """Let other poses start from a solved one, unless they may as well start from the nearest one."""
        alike = nearest is not None and bool(state.correction.any()) == bool(nearest.state.correction.any())
        if nearest is None or not alike or _apart(state.posed.positions, nearest.state.posed.positions) >= _APART:
            self.reached.append(_Reached(replace(state, near=None)))

    def _solve(self, pose: "_Pose") -> Solution:
        """Solve a pose from the nearest solved one."""
        posed = pose.posed
        apart, nearest = min(
            ((_apart(posed.positions, each.state.posed.positions), each) for each in self.reached),
            key=lambda each: each[0],
            default=(0.0, None),
        )
        if (nearest is None or apart < nearest.reach) and self.goes_on:
            start = None if nearest is None else nearest.state
            solved = unless_degenerate(partial(next, march(self.fold.tissue, [posed], start, self.response)))
            state = solved or SolverState(posed.positions, posed, converged=False)
            fault = UNSETTLED if solved else DEGENERATE
            if state.converged and state.correction.any() and self.fold.tissue.tears(posed.positions, state.positions):
                state, fault = replace(state, converged=False), TORN
            self.spare += state.steps if state.converged else -state.steps
            self.fault = fault if self.goes_on else TOO_MANY_STEPS
        else:
            state = SolverState(posed.positions, posed, converged=self.fold.tissue.is_clear(posed.positions))
            fault = self.fault
        if state.converged:
            self._keep(state, nearest)
        elif nearest is not None:
            nearest.reach = min(nearest.reach, apart)
        found = self._solution(state, None if state.converged else fault)
        if found.touches:
            self.spans.append((len(self.known), len(self.known), _ALIKE))
            self.known.append(_Solved(pose.number, pose.place, found))
        return found

    def _solution(self, state: SolverState, fault: str | None = None) -> Solution:
        """The solution of a solver's state, in bind space."""
        tissue, rows = self.fold.tissue, self.fold.tissue.free_rows
        matrices = UNITS / self.fold.radius * state.posed.matrices[rows]
        correction = state.correction[rows]
        moved, outward, shares = np.zeros_like(correction), np.zeros_like(correction), np.full(len(rows), _LEAST_WEIGHT)
        moving = np.flatnonzero(correction.any(axis=1)) if state.converged else np.zeros(0, np.intp)
        if len(moving):
            moved[moving] = np.einsum("vij,vj->vi", inverses(matrices[moving]), correction[moving])
            forces = -tissue.gradient(state.near, state.positions)
            shares = _error_weights(tissue, np.asarray(forces.any(axis=1)))[rows]
            outward = unit(forces[rows])
        return Solution(tissue, moved, shares, outward, state.posed.positions, matrices, fault)


@dataclass(frozen=True, slots=True)
class _Pose:
    """A pose, its number, and its place among others: turns in strides, and positions of what may touch in steps."""

    number: int
    posed: SkinnedPose
    place: Floats


@dataclass(frozen=True, slots=True)
class _Solved:
    """The number of a solved pose, its place, and the solution."""

    number: int
    place: Floats
    found: Solution


def _apart(places: Floats, others: Floats) -> float:
    """Greatest distance of numbers from others, such as (vertices, 3) positions by coordinates."""
    return float(np.abs(places - others).max(initial=0.0))


def _error_weights(tissue: Tissue, touching: Bools) -> Floats:
    """(vertices,) weights of squared errors, from the (vertices,) that touch."""
    weights, reached = np.where(touching, 1.0, _LEAST_WEIGHT), touching
    for ring in range(1, _RINGS + 1):
        wider = widened(tissue.edges, reached)
        weights[wider & ~reached] = max(_RING_FACTOR**ring, _LEAST_WEIGHT)
        reached = wider
    return weights


def is_clear(fold: Fold, clip: Clip | None, time: float) -> bool:
    """True if nothing is near at a time of a clip."""
    return fold.tissue.is_clear(next(_poses(fold, clip, np.array([time]))).positions)


@dataclass(slots=True)
class _Reached:
    """A solved pose from which others start.

    Attributes:
        state: The solver's state.
        reach: Distance of the nearest pose that failed from here, solver's units.
    """

    state: SolverState
    reach: float = np.inf


def _poses(fold: Fold, clip: Clip | None, times: Floats) -> Iterator[SkinnedPose]:
    """Pose the wrinkled surface, in a frame in which the surface round the joint stays where it is at rest."""
    scale = UNITS / fold.radius
    apart = np.sqrt(np.sum((fold.rest_positions - fold.pivot) ** 2, axis=1)) / fold.radius
    weights = np.where(fold.own, 1.0 / (1.0 + apart**2), 0.0)
    for positions, matrices in fold.poses(clip, times):
        turn, shift = _aligned(scale * positions, fold.tissue.rest, weights)
        yield SkinnedPose(scale * positions @ turn.T + shift, turn @ matrices)


def _aligned(positions: Floats, wanted: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """(3, 3) rotation and (3,) shift that bring (vertices, 3) positions nearest to others, by (vertices,) weights.

    Source: W. Kabsch, *A solution for the best rotation to relate two sets of vectors*, 1976.
    """
    whole = weights.sum()
    middle, other = weights @ positions / whole, weights @ wanted / whole
    left, _, right = np.linalg.svd((positions - middle).T @ (weights[:, None] * (wanted - other)))
    mirrored = np.sign(np.linalg.det(right.T @ left.T))
    turn = right.T @ np.diag([1.0, 1.0, mirrored]) @ left.T
    return turn, other - turn @ middle
