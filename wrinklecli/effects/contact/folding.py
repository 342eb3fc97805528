"""How a fold moves under contact: clips posed for the solver of module `contact`, and what it finds, in bind space."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.contact.march import march
from wrinklecli.effects.contact.tissue import UNITS, Posed, State, Tissue
from wrinklecli.numeric.arrays import Bools, Floats, Ints, inverses, unit
from wrinklecli.numeric.crossings import widened

# Poses of which all but the last are passed over where nothing is near at its: 16° of a sweep, an eighth of a second.
_AHEAD = 4
# What the square of an error counts where nothing touches, of what it counts where something does: there a tenth of
# the length is as good, hidden in the fold. From one to the other it falls over some rings of vertices, by a share
# each: what is there may touch next.
_APART, _RINGS, _FALLS = 0.01, 3, 0.4
# How much further apart what touches may be moved than was found, solver's units: hidden in the fold too.
_OPEN = 1.5


@dataclass(frozen=True, eq=False)
class Found:
    """What contact does in a pose.

    Attributes:
        tissue: What may touch.
        moved: (free, 3) what it adds to the vertices that may leave their pose, bind space.
        shares: (free,) what the square of an error counts there.
        outward: (free, 3) unit, which way each is held off by what it touches, solver's units; 0 where nothing is.
        positions: (vertices, 3) where the pose wants all vertices, solver's units.
        matrices: (free, 3, 3) what turns bind space to these units there.
        state: Of the solver, from which the next pose begins.
    """

    tissue: Tissue
    moved: Floats
    shares: Floats
    outward: Floats
    positions: Floats
    matrices: Floats
    state: State

    @property
    def touches(self) -> bool:
        """Whether contact does anything."""
        return bool(self.moved.any())

    @property
    def length(self) -> float:
        """The greatest move, solver's units."""
        return float(self.off(np.zeros_like(self.moved)).max(initial=0.0))

    def off(self, moved: Floats) -> Floats:
        """(free,) by how much another (free, 3) move is off, solver's units."""
        posed = np.einsum("vij,vj->vi", self.matrices, self.moved - moved)
        return np.asarray(np.sqrt(np.sum(posed**2, axis=1)))

    def missed(self, moved: Floats) -> float:
        """By how much another (free, 3) move is off at most, solver's units."""
        return float(self.off(moved).max(initial=0.0))

    def beside(self, marked: Bools) -> Bools:
        """(free,) those marked, and those that edges join to them."""
        rows, every = free_rows(self.tissue), np.zeros(len(self.positions), bool)
        every[rows] = marked
        return widened(self.tissue.edges, every)[rows]

    def with_moved(self, moved: Floats) -> Floats:
        """(vertices, 3) where all vertices are with another (free, 3) move, solver's units."""
        positions = self.positions.copy()
        positions[free_rows(self.tissue)] += np.einsum("vij,vj->vi", self.matrices, moved)
        return positions

    def crosses(self, moved: Floats) -> bool:
        """Whether anything crosses with another (free, 3) move, and did not with this one."""
        return self._ever is None and self.tissue.crosses(self.with_moved(moved))

    def crossing(self, moved: Floats) -> Bools | None:
        """(free,) which vertices cross with another (free, 3) move; None if none does.

        What crosses with this one too, as another mesh that leaves no room, does not count.
        """
        marked = self.tissue.crossing(self.with_moved(moved))
        if marked is None:
            return None
        fresh = (marked if self._ever is None else marked & ~self._ever)[free_rows(self.tissue)]
        return fresh if fresh.any() else None

    def squeezed(self, moved: Floats) -> float:
        """How much of a limb's volume, as long as it is thick, goes with another (free, 3) move."""
        return abs(self.tissue.pieces.grown(self.with_moved(moved), self.positions)) / (2.0 * np.pi * UNITS**3)

    def opened(self, moved: Floats) -> Floats:
        """(free, 3) this move, with as much more as another opens what touches further: that does no harm."""
        away = np.einsum("vij,vj,vi->v", self.matrices, moved - self.moved, self.outward)
        rows = np.flatnonzero(away > 0.0)
        further = np.minimum(away[rows], _OPEN)[:, None] * self.outward[rows]
        wanted = self.moved.copy()
        wanted[rows] += np.einsum("vij,vj->vi", inverses(self.matrices[rows]), further)
        return wanted

    @cached_property
    def _ever(self) -> Bools | None:
        """(vertices,) which cross with this move."""
        return self.tissue.crossing(self.with_moved(self.moved))


def found_in(
    fold: Fold, tissue: Tissue, clip: Clip | None, times: Floats, start: State | None = None
) -> Iterator[Found]:
    """What contact does at each of (frames,) seconds of a clip, begun from a state or from nothing that touches."""
    scale = UNITS / fold.radius
    rows = free_rows(tissue)
    for state in _states(tissue, _poses(fold, tissue, clip, times), start):
        matrices = scale * state.posed.matrices[rows]
        correction = state.correction[rows]
        moved, shares, outward = np.zeros_like(correction), np.full(len(rows), _APART), np.zeros_like(correction)
        moving = np.flatnonzero(correction.any(axis=1))
        if len(moving):
            moved[moving] = np.einsum("vij,vj->vi", inverses(matrices[moving]), correction[moving])
            forces = tissue.forces(state)
            shares = _spread(tissue, np.asarray(forces.any(axis=1)))[rows]
            outward = unit(forces[rows])
        yield Found(tissue, moved, shares, outward, state.posed.positions, matrices, state)


def _spread(tissue: Tissue, touching: Bools) -> Floats:
    """(vertices,) what the square of an error counts at each, where (vertices,) some touch."""
    shares, reached = np.where(touching, 1.0, _APART), touching
    for ring in range(1, _RINGS + 1):
        wider = widened(tissue.edges, reached)
        shares[wider & ~reached] = max(_FALLS**ring, _APART)
        reached = wider
    return shares


def free_rows(tissue: Tissue) -> Ints:
    """(free,) the vertices that may leave their pose, rising; but for those of other meshes."""
    return np.flatnonzero(tissue.free & tissue.own)


def crossing_vertices(tissue: Tissue, positions: Floats) -> int:
    """How many vertices cross at (vertices, 3) positions, solver's units."""
    marked = tissue.crossing(positions)
    return 0 if marked is None else int(marked.sum())


def positions_of(fold: Fold, tissue: Tissue, clip: Clip | None, times: Floats) -> Iterator[Floats]:
    """(vertices, 3) where the pose wants them at each of (frames,) seconds of a clip, solver's units."""
    return (posed.positions for posed in _poses(fold, tissue, clip, times))


def last_of(states: Iterator[Found]) -> State | None:
    """The state of the last of some poses."""
    state = None
    for each in states:
        state = each.state
    return state


def is_clear(fold: Fold, tissue: Tissue, clip: Clip | None, time: float) -> bool:
    """Whether nothing is near at a time of a clip."""
    return tissue.clear(next(_poses(fold, tissue, clip, np.array([time]))).positions)


def _states(tissue: Tissue, poses: Iterator[Posed], start: State | None = None) -> Iterator[State]:
    """March poses, but pass over those before and behind which nothing is near."""
    state = start
    while ahead := list(islice(poses, _AHEAD)):
        if tissue.clear(ahead[-1].positions) and (state is None or not state.correction.any()):
            yield from (State(posed.positions, posed) for posed in ahead)
            state = State(ahead[-1].positions, ahead[-1])
        else:
            for marched in march(tissue, ahead, state):
                yield (state := marched)


def _poses(fold: Fold, tissue: Tissue, clip: Clip | None, times: Floats) -> Iterator[Posed]:
    """The wrinkled surface over time, turned so that the surface round the joint stays as it is at rest."""
    scale = UNITS / fold.radius
    apart = np.sqrt(np.sum((fold.rest_positions - fold.pivot) ** 2, axis=1)) / fold.radius
    shares = np.where(fold.own, 1.0 / (1.0 + apart**2), 0.0)
    for positions, matrices in fold.poses(clip, times):
        turn, shift = _aligned(scale * positions, tissue.rest, shares)
        yield Posed(scale * positions @ turn.T + shift, turn @ matrices)


def _aligned(positions: Floats, wanted: Floats, shares: Floats) -> tuple[Floats, Floats]:
    """(3, 3) turn and (3,) shift that bring (vertices, 3) positions nearest to others, by their (vertices,) shares.

    Source: W. Kabsch, *A solution for the best rotation to relate two sets of vectors*, 1976.
    """
    whole = shares.sum()
    middle, other = shares @ positions / whole, shares @ wanted / whole
    left, _, right = np.linalg.svd((positions - middle).T @ (shares[:, None] * (wanted - other)))
    mirrored = np.sign(np.linalg.det(right.T @ left.T))
    turn = right.T @ np.diag([1.0, 1.0, mirrored]) @ left.T
    return turn, other - turn @ middle
