"""Contact in a fold: a surface that touches itself and never crosses, marched from rest through a bend.

The wrinkled, posed surface is what skinning asks for; the surface found is the nearest one to it that keeps apart:

    min over x of ½ Σ m |c|² + ½ ℓ² |∇c|² + ½ ℓ⁴ |Δc|² + ½ p ΔV² + κ/d̂³ B(x; d̂, d_min),   c = x − posed and wrinkled,

with B the barrier of all pairs nearer than d̂ + d_min, and ΔV what c takes away of the volume below. The rest pose
crosses nothing, and no step lets anything pass through: so none ever crosses, however far skinning folds the surface
through itself. Other meshes are of the same system, but so stiff that they give way only where they pass through
themselves and would leave no room.

Source: M. Li et al., *Incremental Potential Contact*, SIGGRAPH 2020, by its library ipctk. Differs: quasi-static, no
friction, no material: what resists is the correction c, so nothing moves where nothing touches.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from wrinklecli.method.passing import passing
from wrinklecli.method.response import Held, Pressed, Response, stiffness_of
from wrinklecli.method.volume import Pieces
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, inverses
from wrinklecli.numeric.crossings import edges_of

UNITS = 70.0
"""Units of the solver in a limb's radius: lengths below are about millimetres of a knee."""

# Length over which a correction fades, and how far from what crosses vertices are free, in such lengths. Five: at four
# a tenth of the correction is left at the border.
SOFT, FREE = 8.0, 5.0
# Distance from which what comes near is held off, and that which is kept, at most; and as a share of short edges.
_NEAR, _KEPT = 0.7, 0.3
_OF_EDGE = 1 / 3
# Stiffness of the barrier against that of the correction.
_BARRIER = 10.0
# How much heavier vertices get towards where they are no longer free: what is squeezed away bulges near the contact.
_FARTHER = 8.0
# Share of the squeezed volume that is lost: of 5 % of a limb 0.15 %.
_LOST = 0.03
# What a piece gives at least under pressure, solver's units: one without an inside gives nothing.
_LEAST_GIVEN = 1e-9
# Stiffness of other meshes against that of the surface itself.
_STIFF = 1000.0
# Other meshes that are nearer at rest than this share of what is held off lie on the surface: they never collide.
_TIGHT = 0.1
# Newton's steps of a frame at most, and the length of a step that ends them, solver's units: two fifths of the gap.
# Where nothing touches any more all goes back to its pose.
_STEPS, _SETTLED, _STILL = 32, 0.4, 0.001
# What is not free is in its place, up to rounding.
_ARRIVED = 1e-9
# Solver's units that a step moves anything by at most: further, hardly one is free, and more has to be looked at.
_FARTHEST = 4.0
# Halvings of a step that does not lower the energy.
_HALVINGS = 12
# Share of the distance that is gone at the first touch, and share of a step up to there that is taken.
_CLOSE, _SAFE = 0.99, 0.9
# Halvings of the distances until nothing is near at rest.
_CLOSER = 8


@dataclass(frozen=True, slots=True)
class Posed:
    """Where a pose wants the vertices.

    Attributes:
        positions: (vertices, 3) solver's units, turned into the frame of the fold.
        matrices: (vertices, 3, 3) what turns bind space there.
    """

    positions: Floats
    matrices: Floats


@dataclass(frozen=True, slots=True)
class State:
    """Where the vertices are.

    Attributes:
        positions: (vertices, 3) solver's units.
        posed: What the pose wants.
        converged: Whether the last step ended by itself, with all vertices that are not free in their places.
        near: What is near, of ipctk; None where nothing is.
    """

    positions: Floats
    posed: Posed
    converged: bool = True
    near: Any = None

    @property
    def correction(self) -> Floats:
        """(vertices, 3) from where the pose wants the vertices."""
        corrected: Floats = self.positions - self.posed.positions
        return corrected


@dataclass(frozen=True)
class Tissue:
    """A surface that may touch itself: what resists, and what may collide.

    Attributes:
        rest: (vertices, 3) solver's units.
        triangles: (triangles, 3).
        colliding: (triangles,) those that may touch anything; others crossed at rest, or lie further off.
        free: (vertices,) those that may leave their pose.
        own: (vertices,) those that are not of other meshes, which only come in the way.
        apart: (vertices,) how far each is at rest from what crosses without contact, solver's units.
    """

    rest: Floats
    triangles: Ints
    colliding: Bools
    free: Bools
    own: Bools
    apart: Floats

    def loosened(self) -> "Tissue":
        """The same, but for triangles of other meshes that lie on it at rest: these it goes through ever after."""
        share = _TIGHT * self._share
        found = self._near(self.rest, share * _NEAR, share * _KEPT)
        edges, triangles = self.mesh.edges, self.mesh.faces
        pairs = [found[k].vertex_ids(edges, triangles) for k in range(len(found))]
        near = np.array([vertex for pair in pairs for vertex in pair if vertex >= 0], np.intp)
        on = np.zeros(len(self.rest), bool)
        on[self.rows[near]] = True
        return replace(self, colliding=self.colliding & ~(on & ~self.own)[self.triangles].any(axis=1))

    @cached_property
    def _share(self) -> float:
        """Of the distances, at most, so that short edges keep apart."""
        edges = edges_of(self.triangles[(self.free & self.own)[self.triangles].any(axis=1)])
        lengths = np.sqrt(np.sum((self.rest[edges[:, 0]] - self.rest[edges[:, 1]]) ** 2, axis=1))
        short = float(np.percentile(lengths, 5)) if len(lengths) else 1.0
        return min(1.0, _OF_EDGE * short / (_NEAR + _KEPT))

    @cached_property
    def distances(self) -> tuple[float, float]:
        """From where what comes near is held off, and what is kept: so that nothing is held off at rest."""
        share = self._share
        for _ in range(_CLOSER):
            if not len(self._near(self.rest, share * _NEAR, share * _KEPT)):
                break
            share /= 2.0
        return share * _NEAR, share * _KEPT

    @cached_property
    def rows(self) -> Ints:
        """(touching,) the vertices of what may collide, rising: ipctk knows these alone."""
        return distinct_values(self.triangles[self.colliding].reshape(-1))

    @cached_property
    def mesh(self) -> Any:
        """Of ipctk, of `rows`: vertices without triangles would touch each other, wherever they are.

        Vertices that are not free do not collide with each other, nor do other meshes.
        """
        import ipctk

        ipctk.set_logger_level(ipctk.off)
        ipctk.set_num_threads(1)
        triangles = np.searchsorted(self.rows, self.triangles[self.colliding])
        mesh = ipctk.CollisionMesh(
            self.placed(self.rest),
            np.asfortranarray(edges_of(triangles).astype(np.int32)),
            np.asfortranarray(triangles.astype(np.int32)),
        )
        labels = np.where(self.free & self.own, 1 + np.arange(len(self.rest)), 0)
        mesh.can_collide = ipctk.make_vertex_patches_filter(labels[self.rows].astype(np.int32))
        return mesh

    def placed(self, positions: Floats) -> Floats:
        """(touching, 3) of (vertices, 3), as ipctk wants them."""
        return np.asfortranarray(positions[self.rows])

    @cached_property
    def edges(self) -> Ints:
        """(edges, 2) of the surface."""
        return edges_of(self.triangles)

    @cached_property
    def barrier(self) -> Any:
        """Of ipctk."""
        import ipctk

        near = self.distances[0]
        return ipctk.BarrierPotential(near, _BARRIER / near**3)

    @cached_property
    def stiffness(self) -> Any:
        """(vertices, vertices) sparse: mass, gradient and Laplacian of a correction."""
        import scipy.sparse as sparse

        heavier = 1.0 + _FARTHER * (self.apart / (FREE * SOFT)) ** 2
        whole = stiffness_of(self.rest, self.triangles, soft=SOFT, heavier=heavier)
        # Meshes are apart from each other, so a factor of each leaves the matrix symmetric.
        return (sparse.diags_array(np.where(self.own, 1.0, _STIFF)) @ whole).tocsr()

    @cached_property
    def pieces(self) -> Pieces:
        """Those whose volume is kept."""
        return Pieces.of(self.triangles, self.free & self.own)

    @cached_property
    def pressures(self) -> Floats:
        """(pieces,) what resists a change of volume: so much more than a piece itself that hardly any is lost."""
        gradients = self.pieces.gradients(self.rest)[:, self.free]
        gives = np.sum(gradients * self.gives(gradients), axis=(1, 2))
        return np.asarray((1.0 / _LOST - 1.0) / np.maximum(gives, _LEAST_GIVEN))

    def gives(self, forces: Floats) -> Floats:
        """(several, free, 3) how free vertices move under as many forces."""
        columns = forces.transpose(1, 0, 2).reshape(-1, 3 * len(forces))
        return self.response.of(columns).reshape(-1, len(forces), 3).transpose(1, 0, 2)

    @cached_property
    def response(self) -> Response:
        """Of free vertices to forces."""
        rows = np.flatnonzero(self.free)
        return Response(self.stiffness[rows][:, rows])

    def collisions(self, positions: Floats) -> Any:
        """What is near at (vertices, 3)."""
        return self._near(positions, *self.distances)

    def clear(self, positions: Floats) -> bool:
        """Whether nothing is near, nor crosses, at (vertices, 3)."""
        # Long edges go through large triangles far from all their vertices.
        return not len(self.collisions(positions)) and not self.crosses(positions)

    def forces(self, state: State) -> Floats:
        """(vertices, 3) by which each is held off; 0 where nothing is near."""
        if state.near is None:
            return np.zeros_like(state.positions)
        return -self.gradient(state.near, state.positions)

    def gradient(self, near: Any, positions: Floats) -> Floats:
        """(vertices, 3) of the barrier of what is near at (vertices, 3)."""
        gradient = np.zeros_like(positions)
        gradient[self.rows] = self.barrier.gradient(near, self.mesh, self.placed(positions)).reshape(-1, 3)
        return gradient

    def crosses(self, positions: Floats) -> bool:
        """Whether anything crosses at (vertices, 3)."""
        import ipctk

        return bool(ipctk.has_intersections(self.mesh, self.placed(positions)))

    def crossing(self, positions: Floats) -> Bools | None:
        """(vertices,) whether an edge or a triangle of each crosses at (vertices, 3); None where none does."""
        if not self.crosses(positions):
            return None
        counting = (self.free & self.own)[self.rows]
        marked = np.zeros(len(positions), bool)
        marked[self.rows] = passing(self.placed(positions), self.mesh.edges, self.mesh.faces, counting)
        return marked if marked.any() else None

    def _near(self, positions: Floats, near: float, kept: float) -> Any:
        import ipctk

        found = ipctk.NormalCollisions()
        found.build(self.mesh, self.placed(positions), near, kept)
        return found

    def way(self, start: Floats, end: Floats) -> "_Way":
        """The straight way from (vertices, 3) to others."""
        return _Way(self, self.placed(start), self.placed(end))


class _Way:
    """A straight way of all vertices: what may come near on it is found once."""

    def __init__(self, tissue: Tissue, start: Floats, end: Floats) -> None:
        import ipctk

        self._tissue, self._start, self._end = tissue, start, end
        self._candidates = ipctk.Candidates()
        self._candidates.build(tissue.mesh, start, end, sum(tissue.distances) / 2.0)

    def free_share(self) -> float:
        """The part on which nothing comes too near; somewhat less where that is not all of it."""
        import ipctk

        share = self._candidates.compute_collision_free_stepsize(
            self._tissue.mesh,
            self._start,
            self._end,
            self._tissue.distances[1],
            ipctk.AdditiveCCD(conservative_rescaling=_CLOSE),
        )
        return float(share) if share >= 1.0 else _SAFE * float(share)

    def near(self, positions: Floats) -> Any:
        """What is near at (vertices, 3) on it."""
        import ipctk

        found = ipctk.NormalCollisions()
        found.build(self._candidates, self._tissue.mesh, self._tissue.placed(positions), *self._tissue.distances)
        return found


def march(tissue: Tissue, poses: Iterable[Posed], start: State | None = None) -> Iterator[State]:
    """Follow poses one after another, each begun from the correction of the one before, carried by the skin.

    Args:
        tissue: The surface.
        poses: Near enough to each other for the surface to follow.
        start: Where it begins; the first pose, which crosses nothing, where left out.
    """
    state = start
    for posed in poses:
        state = State(posed.positions, posed) if state is None else _step(tissue, state, posed)
        yield state


def _step(tissue: Tissue, state: State, posed: Posed) -> State:
    """Move to the next pose."""
    carried, correction = np.zeros_like(posed.positions), state.correction
    rows = np.flatnonzero(correction.any(axis=1))
    turns = posed.matrices[rows] @ inverses(state.posed.matrices[rows])
    carried[rows] = np.einsum("vij,vj->vi", turns, correction[rows])
    wanted = posed.positions + carried
    if carried.any() and np.abs(wanted - state.positions).max() > _FARTHEST:
        # What touches hardly moves on a straight way.
        return _newton(tissue, state.positions, posed, tissue.collisions(state.positions))
    way = tissue.way(state.positions, wanted)
    share = way.free_share()
    positions = state.positions + share * (wanted - state.positions)
    near = way.near(positions)
    if share >= 1.0 and not len(near) and not carried.any():
        return State(positions, posed)
    return _newton(tissue, positions, posed, near)


def _newton(tissue: Tissue, positions: Floats, posed: Posed, near: Any) -> State:
    """Lower the energy by projected Newton steps, none of which lets anything pass through anything."""
    wanted = _Wanted(posed.positions, tissue.pieces.volumes(posed.positions))
    energy = _energy(tissue, positions, wanted, near)
    settled = False
    held = ~tissue.free
    for _ in range(_STEPS):
        direction, slope = _direction(tissue, positions, wanted, near)
        arriving = np.abs((posed.positions - positions)[held]).max(initial=0.0) > _ARRIVED
        if not arriving and np.abs(direction).max() < (_SETTLED if len(near) else _STILL):
            settled = True
            break
        part = _FARTHEST / max(float(np.abs(direction).max()), _FARTHEST)
        way = tissue.way(positions, positions + part * direction)
        share = part * way.free_share()
        for _halving in range(_HALVINGS):
            trial = positions + share * direction
            trial_near = way.near(trial)
            trial_energy = _energy(tissue, trial, wanted, trial_near)
            if trial_energy <= energy + 1e-4 * share * slope or (arriving and trial_energy < energy):
                break
            share /= 2.0
        else:
            break
        positions, near, energy = trial, trial_near, trial_energy
    if settled:
        if not len(near):
            # To the bit: where nothing touches any more, contact moves nothing.
            return State(posed.positions, posed)
        positions = np.where(held[:, None], posed.positions, positions)
    return State(positions, posed, settled, near)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What a pose asks for.

    Attributes:
        positions: (vertices, 3) solver's units.
        volumes: (pieces,) under them.
    """

    positions: Floats
    volumes: Floats


def _energy(tissue: Tissue, positions: Floats, wanted: _Wanted, near: Any) -> float:
    correction = positions - wanted.positions
    elastic = 0.5 * float(np.sum(correction * (tissue.stiffness @ correction)))
    pressed = 0.5 * float(tissue.pressures @ (tissue.pieces.volumes(positions) - wanted.volumes) ** 2)
    return elastic + pressed + float(tissue.barrier(near, tissue.mesh, tissue.placed(positions)))


def _direction(tissue: Tissue, positions: Floats, wanted: _Wanted, near: Any) -> tuple[Floats, float]:
    """(vertices, 3) Newton's step, which takes what is not free to its place, and the slope of the energy along it."""
    import ipctk

    free, touching = tissue.free, tissue.rows
    correction = positions - wanted.positions
    barrier = tissue.gradient(near, positions)
    direction = np.where(free[:, None], 0.0, -correction)
    gradients = tissue.pieces.gradients(positions)
    more = tissue.pieces.volumes(positions) - wanted.volumes
    pressed = Pressed(
        gradients[:, free],
        tissue.gives(gradients[:, free]),
        tissue.pressures,
        more - np.tensordot(gradients, correction, axes=2),
    )
    placed = tissue.placed(positions)
    hessian = tissue.barrier.hessian(near, tissue.mesh, placed, ipctk.PSDProjectionMethod.CLAMP).tocsr()
    numbers = np.flatnonzero(np.diff(hessian.indptr).reshape(-1, 3).any(axis=1) & free[touching])
    coordinates, rows = (3 * numbers[:, None] + np.arange(3)).reshape(-1), touching[numbers]
    held = Held(
        (np.cumsum(free) - 1)[rows],
        -barrier[rows] - (hessian[coordinates] @ direction[touching].reshape(-1)).reshape(-1, 3),
        hessian[coordinates][:, coordinates],
        correction[rows],
    )
    direction[free] = tissue.response.settled(held, pressed) - correction[free]
    gradient = tissue.stiffness @ correction + np.tensordot(tissue.pressures * more, gradients, axes=1) + barrier
    return direction, float(np.sum(gradient * direction))
