"""Creases: what contact does in a fold, as few fixed shapes, for any clip: solved for the joint's own motion.

The joint turns through its range, and four times more with its axis leaning by 10° to a side. What module `contact`
finds there, taken back to bind space, is compressed into shapes. A clip's weights come from marching the clip itself
and fitting the shapes to what is found; those of a clip that was never baked are looked up by the joint's angle.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import approach
from wrinklecli.character.pose import Pose, pose_at
from wrinklecli.method.contact import FREE, SOFT, UNITS, Posed, State, Tissue, march
from wrinklecli.method.fold import Fold
from wrinklecli.numeric.arrays import Bools, Floats, Ints, inverses

# Radians between two poses of a sweep, at most: further apart, what closes fast needs several times the steps.
_STRIDE = np.radians(4.0)
# How far the axis leans: a clip's joint seldom turns about one axis alone.
_LEAN = float(np.tan(np.radians(10.0)))
_LEANING = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
# Poses of a sweep that are looked at for crossings: those that fold most, and some on the way there.
_LOOKS = 8
# Of the poses of the sweeps, each so manieth is looked at for what shapes leave.
_EACH = 3
# Poses from rest to the beginning of a clip that is folded there.
_APPROACH = 33
# Poses of which all but the last are passed over where nothing is near at its: 16° of a sweep, an eighth of a second.
_AHEAD = 4
# Poses that are computed at once: bounds the memory.
_AT_ONCE = 16


@dataclass(frozen=True)
class Crease:
    """A fold whose contact is resolved.

    Attributes:
        fold: The surface round the joint.
        tissue: What may touch.
        vertices: (vertices,) fine welded vertices that move, rising.
        shapes: (shapes, vertices, 3) bind space, at weight 1.
        angles: (rows,) radians of the joint about its axis, rising,
        table: and (rows, shapes) weights there.
        samples: Weights and poses in which normals are to be right.
        error: How far the shapes are from what was found in the sweeps, at most, scene units.
        largest: The greatest move that was found, scene units.
        unsettled: Poses of the sweeps whose solution did not settle.
        solved: Poses of the sweeps with contact.
    """

    fold: Fold
    tissue: Tissue
    vertices: Ints
    shapes: Floats
    angles: Floats
    table: Floats
    samples: tuple[tuple[Floats, Pose], ...]
    error: float
    largest: float
    unsettled: int
    solved: int

    def follow(self, clip: Clip | None, times: Floats) -> tuple[Floats, float, int]:
        """March a clip.

        Args:
            clip: The animation.
            times: (frames,) seconds, rising; near enough for the surface to follow.

        Returns:
            (frames, shapes) weights, how far the shapes are from what is found at most, scene units, and how many
            frames did not settle.
        """
        weights, error, unsettled = np.zeros((len(times), len(self.shapes))), 0.0, 0
        last = deque(_states(self.tissue, self._way_to(clip, float(times[0]))), maxlen=1)
        start = last[0] if last else None
        flat = self.shapes.reshape(len(self.shapes), -1)
        inverse = np.linalg.pinv(flat)
        for frame, (moved, state) in enumerate(_marched(self.fold, self.tissue, clip, times, start)):
            deltas = moved[self.rows].reshape(-1)
            weights[frame] = deltas @ inverse
            missed = (deltas - weights[frame] @ flat).reshape(-1, 3)
            error = max(error, float(np.sqrt(np.sum(missed**2, axis=1)).max(initial=0.0)))
            unsettled += not state.converged
        return weights, error, unsettled

    def _way_to(self, clip: Clip | None, time: float) -> Iterator[Posed]:
        """Poses from rest to a clip's beginning, where that is folded already."""
        if clip is None or self.tissue.clear(next(_poses(self.fold, self.tissue, clip, np.array([time]))).positions):
            return iter(())
        return _poses(self.fold, self.tissue, approach(clip, time, self.fold.rig), np.linspace(0.0, 1.0, _APPROACH))

    @property
    def rows(self) -> Ints:
        """(vertices,) of those that move, among those of the fold."""
        return np.searchsorted(self.fold.vertices, self.vertices)


def resolve(fold: Fold, *, share: float, most: int) -> Crease | None:
    """Solve a fold for its joint's motion, and compress what is found; None where nothing ever crosses.

    Args:
        fold: The surface round a joint.
        share: Greatest error of a vertex, of the greatest move. Shapes are more than that asks for where they would
            leave crossings.
        most: Shapes at most, whatever they leave.
    """
    sweeps = [_angles(end) for end in (fold.hinge.least, fold.hinge.most) if end]
    free = _free(fold, sweeps)
    if not free.any():
        return None
    tissue = _tissue(fold, free)
    solved = list(_swept(fold, tissue, sweeps))
    if not solved:
        return None
    together = np.stack([each.moved for each in solved])
    rows = np.flatnonzero(together.any(axis=(0, 2)))
    weights, shapes, error = _fewest(fold, solved, rows, share=share, most=most)
    # Rows of the joint's own motion, those at rest and just before anything touches of weight 0.
    central = [(each.angle, number) for number, each in enumerate(solved) if not each.leaning]
    touching = np.array([angle for angle, _ in central])
    ahead = [angles[np.argmax(np.isin(angles, touching)) - 1] for angles in sweeps if np.isin(angles, touching).any()]
    central = sorted([*central, *((angle, len(solved)) for angle in {0.0, *map(float, ahead)})])
    padded = np.concatenate([weights, np.zeros((1, len(shapes)))])
    return Crease(
        fold=fold,
        tissue=tissue,
        vertices=fold.vertices[rows],
        shapes=shapes,
        angles=np.array([angle for angle, _ in central]),
        table=padded[[number for _, number in central]],
        samples=tuple((weights[k], pose_at(fold.rig, solved[k].clip, solved[k].time)) for k in _chosen(weights)),
        error=error,
        largest=max(float(np.sqrt(np.sum(each.corrections**2, axis=1)).max()) for each in solved),
        unsettled=sum(not each.settled for each in solved),
        solved=len(solved),
    )


@dataclass(frozen=True, slots=True)
class _Solved:
    """A pose of a sweep in which contact moves something.

    Attributes:
        clip: The sweep,
        time: and when.
        angle: Of the joint, radians.
        leaning: Whether its axis leans.
        moved: (vertices, 3) what contact adds in bind space.
        corrections: (vertices, 3) the same in the world, scene units.
        settled: Whether the solver did.
    """

    clip: Clip
    time: float
    angle: float
    leaning: bool
    moved: Floats
    corrections: Floats
    settled: bool


def _swept(fold: Fold, tissue: Tissue, sweeps: Sequence[Floats]) -> Iterator[_Solved]:
    """Turn the joint through its range, and with its axis leaning to each side."""
    for lean in _LEANING:
        for angles in sweeps:
            clip = fold.hinge.turn(angles, tilt=_LEAN * lean)
            times = np.linspace(0.0, 1.0, len(angles))
            for angle, time, (moved, state) in zip(angles, times, _marched(fold, tissue, clip, times), strict=True):
                if state.correction.any():
                    world = state.correction * fold.radius / UNITS
                    yield _Solved(clip, float(time), float(angle), bool(lean.any()), moved, world, state.converged)


def _fewest(
    fold: Fold, solved: Sequence[_Solved], rows: Ints, *, share: float, most: int
) -> tuple[Floats, Floats, float]:
    """The fewest shapes, of (rows,) vertices of the fold, that are right enough and leave no crossing in any sweep.

    Returns:
        (poses, shapes) weights in [-1, 1], the largest of each 1, (shapes, rows, 3), and the greatest error of a
        vertex, scene units.

    Source: C. Eckart, G. Young, *The approximation of one matrix by another of lower rank*, 1936.
    """
    deltas = np.stack([each.moved[rows] for each in solved])
    flat = deltas.reshape(len(deltas), -1)
    left, values, right = np.linalg.svd(flat, full_matrices=False)
    largest = float(np.sqrt(np.sum(deltas**2, axis=2)).max())
    error, rank = np.inf, 0
    for rank in range(1, min(most, len(values)) + 1):
        made = ((left[:, :rank] * values[:rank]) @ right[:rank]).reshape(deltas.shape)
        error = float(np.sqrt(np.sum((made - deltas) ** 2, axis=2)).max())
        if error <= share * largest and not any(
            _crosses(fold, each, rows, moved) for each, moved in zip(solved[::_EACH], made[::_EACH], strict=True)
        ):
            break
    weights = left[:, :rank] * values[:rank]
    peaks = weights[np.argmax(np.abs(weights), axis=0), np.arange(rank)]
    scale = float(np.cbrt(np.abs(np.linalg.det(fold.fine.blended[fold.vertices[rows], :, :3]))).mean())
    return weights / peaks, (right[:rank] * peaks[:, None]).reshape(rank, *deltas.shape[1:]), error * scale


def _crosses(fold: Fold, pose: _Solved, rows: Ints, moved: Floats) -> bool:
    """Whether anything that moves crosses in a pose of a sweep with (rows, 3) of it moved in bind space."""
    (positions,), (matrices,) = fold.posed(pose.clip, np.array([pose.time]))
    positions[rows] += np.einsum("vij,vj->vi", matrices[rows], moved)
    return bool(fold.crossing(positions)[rows].any())


def _chosen(weights: Floats) -> list[int]:
    """Frames in which normals are to be right: those where a shape is greatest, and an even choice."""
    even = np.linspace(0, len(weights) - 1, 8).astype(int).tolist()
    return sorted({*even, *np.argmax(np.abs(weights), axis=0).tolist()})


def _angles(end: float) -> Floats:
    """(poses,) radians from 0 to an end."""
    return np.linspace(0.0, end, int(np.ceil(abs(end) / _STRIDE)) + 1)


def _free(fold: Fold, sweeps: Sequence[Floats]) -> Bools:
    """(vertices,) those near any that ever crosses in a sweep, and did not at rest."""
    from scipy.spatial import cKDTree

    still = fold.crossing(fold.rest_positions)
    marked = np.zeros(len(fold.vertices), bool)
    for lean in _LEANING:
        for angles in sweeps:
            clip = fold.hinge.turn(angles, tilt=_LEAN * lean)
            looks = np.linspace(0.0, 1.0, _LOOKS)[1:] if not lean.any() else np.ones(1)
            for positions in fold.posed(clip, looks)[0]:
                marked |= fold.crossing(positions)
    marked &= ~still
    if not marked.any():
        return marked
    near = cKDTree(fold.rest_positions[marked]).query(fold.rest_positions)[0] < FREE * SOFT / UNITS * fold.radius
    return np.asarray(near & ~_border(fold))


def _border(fold: Fold) -> Bools:
    """(vertices,) those with triangles beyond the fold, which must stay where they are."""
    inside = np.bincount(fold.triangles.reshape(-1), minlength=len(fold.vertices))
    starts = fold.fine.around.starts
    return np.asarray(starts[fold.vertices + 1] - starts[fold.vertices] > inside)


def _tissue(fold: Fold, free: Bools) -> Tissue:
    _, crossed = fold.crossings.at(fold.rest_positions)
    # What is not near any that is free never touched one.
    colliding = np.asarray(free[fold.triangles].any(axis=1))
    colliding[crossed] = False
    return Tissue(fold.rest_positions * UNITS / fold.radius, fold.triangles, colliding, free)


def _marched(
    fold: Fold, tissue: Tissue, clip: Clip | None, times: Floats, start: State | None = None
) -> Iterator[tuple[Floats, State]]:
    """At each of (frames,) times (vertices, 3) what contact adds in bind space, and the solver's state."""
    for state in _states(tissue, _poses(fold, tissue, clip, times), start):
        scale = fold.radius / UNITS
        correction = state.correction
        moved = np.zeros_like(correction)
        rows = np.flatnonzero(correction.any(axis=1))
        moved[rows] = scale * np.einsum("vij,vj->vi", inverses(state.posed.matrices[rows]), correction[rows])
        yield moved, state


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
    shares = 1.0 / (1.0 + apart**2)
    for k in range(0, len(times), _AT_ONCE):
        for positions, matrices in zip(*fold.posed(clip, times[k : k + _AT_ONCE]), strict=True):
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
