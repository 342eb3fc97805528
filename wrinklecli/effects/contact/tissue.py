"""What may touch in a fold: how it resists a correction, what comes near, and how far it may go, by ipctk.

All lengths are in units of the solver, of which a limb's radius has 70.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from wrinklecli.effects.contact.passing import passing
from wrinklecli.effects.contact.response import Response, stiffness_of
from wrinklecli.effects.contact.volume import Pieces
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values
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

    def hessian(self, near: Any, positions: Floats) -> Any:
        """(3 · touching, 3 · touching) sparse, of the barrier of what is near at (vertices, 3), made not negative."""
        import ipctk

        return self.barrier.hessian(near, self.mesh, self.placed(positions), ipctk.PSDProjectionMethod.CLAMP).tocsr()

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
