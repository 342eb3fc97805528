"""Solves a fold in the poses of a clip, by module `march`, and gives the solutions in bind space."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import islice

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.contact.given_up import TOO_MANY_STEPS, TORN, UNSETTLED
from wrinklecli.effects.contact.march import march
from wrinklecli.effects.contact.tissue import UNITS, SkinnedPose, SolverState, Tissue
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, inverses, unit
from wrinklecli.numeric.intersections import widened

# Poses that are skipped together if nothing is near in the last one: 16° of a sweep, or an eighth of a second.
_AHEAD = 4
# Distance of solved poses that others start from, solver's units: about a quarter of a step of a sweep. A long clip
# comes back to the same poses again and again.
_APART = 4.0
# Most steps of the solver for a pose with contact, in the mean of a sweep or clip: folds that settle take 2 to 11,
_MOST_STEPS_PER_POSE = 16
# and so many more for all poses together: a fold that closes at once takes a few times the mean in its first poses.
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
        state: The solver's state, from which the next pose starts.
    """

    tissue: Tissue
    moved: Floats
    error_weights: Floats
    outward: Floats
    positions: Floats
    matrices: Floats
    state: SolverState

    @property
    def touches(self) -> bool:
        """True if contact moves anything."""
        return bool(self.moved.any())

    @property
    def fault(self) -> str | None:
        """The reason why contact does not count in the pose; None if it does."""
        return self.state.fault or (None if self.state.converged else UNSETTLED)

    @property
    def greatest_move(self) -> float:
        """Length of the greatest move, solver's units."""
        return float(self.errors(np.zeros_like(self.moved)).max(initial=0.0))

    def errors(self, moved: Floats) -> Floats:
        """(free,) distances of another move from the solution, solver's units."""
        posed = np.einsum("vij,vj->vi", self.matrices, self.moved - moved)
        return np.asarray(np.sqrt(np.sum(posed**2, axis=1)))

    def greatest_error(self, moved: Floats) -> float:
        """Greatest distance of another move from the solution, solver's units."""
        return float(self.errors(moved).max(initial=0.0))

    def with_neighbours(self, marked: Bools) -> Bools:
        """(free,) the marked vertices and their neighbours."""
        rows, every = free_rows(self.tissue), np.zeros(len(self.positions), bool)
        every[rows] = marked
        return widened(self.tissue.edges, every)[rows]

    def positions_under(self, moved: Floats) -> Floats:
        """(vertices, 3) positions of all vertices under another move, solver's units."""
        positions = self.positions.copy()
        positions[free_rows(self.tissue)] += np.einsum("vij,vj->vi", self.matrices, moved)
        return positions

    def crosses(self, moved: Floats) -> bool:
        """True if anything crosses under another move and nothing does in the solution."""
        return not self.crosses_itself and self.tissue.crosses(self.positions_under(moved))

    @property
    def crosses_itself(self) -> bool:
        """True if anything crosses in the solution, for example where another mesh leaves no room."""
        return self._own_crossings is not None

    def crossing(self, moved: Floats, *, likely: bool = False) -> Bools | None:
        """(free,) vertices that cross under another move and not in the solution; None if none do.

        Where it is likely that some do, they are looked for at once.
        """
        if not likely and not self.tissue.crosses(self.positions_under(moved)):
            return None
        fresh = self.crossing_vertices(moved)
        return fresh if fresh.any() else None

    def crossing_vertices(self, moved: Floats) -> Bools:
        """(free,) vertices that cross under another move and not in the solution, if any do; slower than `crosses`."""
        marked = self.tissue.crossing_vertices(self.positions_under(moved))
        return (marked if self._own_crossings is None else marked & ~self._own_crossings)[free_rows(self.tissue)]

    def volume_loss(self, moved: Floats) -> float:
        """Volume that another move takes away, relative to that of a limb as long as it is thick."""
        change = self.tissue.pieces.volume_change(self.positions_under(moved), self.positions)
        return abs(change) / _VOLUME

    @cached_property
    def volume_gradient(self) -> Floats:
        """(free, 3) change of the volume, as `volume_loss` measures it, with the solution's move, in solver's units."""
        pushed = np.sum(self.tissue.pieces.gradients(self.positions_under(self.moved)), axis=0)
        scale = np.sqrt(np.mean(np.sum(self.matrices**2, axis=(1, 2))) / 3.0)
        return np.asarray(np.einsum("vij,vi->vj", self.matrices, pushed[free_rows(self.tissue)]) / (scale * _VOLUME))

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
        return self.tissue.tears(
            self.positions, self.positions_under(moved), crossing=lambda _skinned: self.skinned_crossings
        )

    def settled_in(self, tissue: Tissue) -> "Solution":
        """The same solution, of another copy of the tissue, from which no pose starts any more."""
        state = replace(self.state, posed=SkinnedPose(self.positions, self.matrices), near=None)
        return replace(self, tissue=tissue, state=state)

    @cached_property
    def skinned_crossings(self) -> Bools | None:
        """(vertices,) vertices that cross without contact; None if none do."""
        return self.tissue.crossing(self.positions)

    @cached_property
    def _own_crossings(self) -> Bools | None:
        """(vertices,) vertices that cross in the solution."""
        return self.tissue.crossing(self.positions_under(self.moved))


@dataclass(slots=True)
class Steps:
    """Counts the solver's steps in one motion.

    Attributes:
        taken: Number of Newton steps.
        poses: Number of poses with contact.
    """

    taken: int = 0
    poses: int = 0

    def count(self, state: SolverState) -> None:
        """Count one more pose."""
        self.taken += state.steps
        self.poses += state.converged and bool(state.correction.any())

    @property
    def suffice(self) -> bool:
        """False if there are too many steps for so many poses."""
        return self.taken <= _MOST_STEPS + _MOST_STEPS_PER_POSE * self.poses


def solutions_in(
    fold: Fold, tissue: Tissue, clip: Clip | None, times: Floats, start: SolverState | None = None
) -> Iterator[Solution]:
    """Solve a fold at each of (frames,) seconds of a clip, from a state, or from a pose in which nothing touches.

    In a pose that does not settle, or that is torn, contact moves nothing, and the solution has a fault. After too
    many steps all poses have it in which anything is near.
    """
    scale = UNITS / fold.radius
    rows = free_rows(tissue)
    for state in _states(tissue, lambda at: _poses(fold, tissue, clip, at), times, start):
        matrices = scale * state.posed.matrices[rows]
        correction = state.correction[rows]
        moved, outward, shares = np.zeros_like(correction), np.zeros_like(correction), np.full(len(rows), _LEAST_WEIGHT)
        moving = np.flatnonzero(correction.any(axis=1)) if state.converged else np.zeros(0, np.intp)
        if len(moving):
            moved[moving] = np.einsum("vij,vj->vi", inverses(matrices[moving]), correction[moving])
            forces = tissue.forces(state)
            shares = _error_weights(tissue, np.asarray(forces.any(axis=1)))[rows]
            outward = unit(forces[rows])
        yield Solution(tissue, moved, shares, outward, state.posed.positions, matrices, state)


def _error_weights(tissue: Tissue, touching: Bools) -> Floats:
    """(vertices,) weights of squared errors, from the (vertices,) that touch."""
    weights, reached = np.where(touching, 1.0, _LEAST_WEIGHT), touching
    for ring in range(1, _RINGS + 1):
        wider = widened(tissue.edges, reached)
        weights[wider & ~reached] = max(_RING_FACTOR**ring, _LEAST_WEIGHT)
        reached = wider
    return weights


def free_rows(tissue: Tissue) -> Ints:
    """(free,) sorted vertices of the fold's own mesh that the solver may move."""
    return np.flatnonzero(tissue.free & tissue.own)


def last_state(states: Iterator[Solution]) -> SolverState | None:
    """The state of the last solution without a fault."""
    state = None
    for each in states:
        state = each.state if each.fault is None else state
    return state


def is_clear(fold: Fold, tissue: Tissue, clip: Clip | None, time: float) -> bool:
    """True if nothing is near at a time of a clip."""
    return tissue.is_clear(next(_poses(fold, tissue, clip, np.array([time]))).positions)


def _states(
    tissue: Tissue, posed_at: Callable[[Floats], Iterator[SkinnedPose]], times: Floats, start: SolverState | None
) -> Iterator[SolverState]:
    """March to the poses at (frames,) seconds, to each from the solved one that is nearest to it.

    So a pose has about the same solution however a clip comes to it, and the march goes on after poses that do not
    settle or are torn. A pose that is further from the nearest solved one than such a pose fails, too. Runs of poses
    are skipped before and after which nothing is near.
    """
    solved, poses, steps = [] if start is None else [_Reached(start)], posed_at(times), Steps()
    fault: str | None = None
    touching = start is not None and bool(start.correction.any())
    while ahead := list(islice(poses, _AHEAD)):
        if not touching and tissue.is_clear(ahead[-1].positions):
            yield from (SolverState(posed.positions, posed) for posed in ahead)
            last = SolverState(ahead[-1].positions, ahead[-1])
            if not solved or not solved[-1].stands_for(last):
                solved.append(_Reached(last))
            continue
        for posed in ahead:
            distances = [each.distance(posed) for each in solved]
            apart = min(distances, default=0.0)
            nearest = solved[distances.index(apart)] if solved else None
            if (nearest is None or apart < nearest.reach) and steps.suffice:
                (found,) = march(tissue, [posed], None if nearest is None else nearest.state)
                if found.converged and found.correction.any() and tissue.tears(posed.positions, found.positions):
                    found = replace(found, converged=False, fault=TORN)
                steps.count(found)
                fault = found.fault if steps.suffice else TOO_MANY_STEPS
            elif tissue.is_clear(posed.positions):
                found = SolverState(posed.positions, posed)
            else:
                found = SolverState(posed.positions, posed, converged=False, fault=fault)
            if not found.converged and nearest is not None:
                nearest.reach = min(nearest.reach, apart)
            elif nearest is None or not nearest.stands_for(found):
                solved.append(_Reached(replace(found, near=None)))
            touching = not found.converged or bool(found.correction.any())
            yield found


@dataclass(slots=True)
class _Reached:
    """A solved pose from which others start.

    Attributes:
        state: The solver's state.
        reach: Distance of the nearest pose that failed from here, solver's units.
    """

    state: SolverState
    reach: float = np.inf

    def distance(self, posed: SkinnedPose) -> float:
        """Greatest distance of a vertex in another pose, solver's units."""
        return float(np.abs(posed.positions - self.state.posed.positions).max())

    def stands_for(self, other: SolverState) -> bool:
        """True if poses that would start from another state may as well start from here."""
        alike = bool(other.correction.any()) == bool(self.state.correction.any())
        return alike and self.distance(other.posed) < _APART


def _poses(fold: Fold, tissue: Tissue, clip: Clip | None, times: Floats) -> Iterator[SkinnedPose]:
    """Pose the wrinkled surface, in a frame in which the surface round the joint stays where it is at rest."""
    scale = UNITS / fold.radius
    apart = np.sqrt(np.sum((fold.rest_positions - fold.pivot) ** 2, axis=1)) / fold.radius
    weights = np.where(fold.own, 1.0 / (1.0 + apart**2), 0.0)
    for positions, matrices in fold.poses(clip, times):
        turn, shift = _aligned(scale * positions, tissue.rest, weights)
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
