"""The surface of a fold as the solver sees it: its resistance, its collisions, and how far it may move.

Collisions are found by the library ipctk. All lengths are in solver's units: a limb's radius is 70 of them.
"""

from dataclasses import fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from wrinklecli.effects.contact.response import Pieces, Response, stiffness_of
from wrinklecli.effects.contact.tearing import Tearing
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values
from wrinklecli.numeric.closest import ROUNDING
from wrinklecli.numeric.elements import factorised
from wrinklecli.numeric.intersections import Crossings, edges_of

UNITS = 70.0
"""Solver's units in a limb's radius: one is about a millimetre of a knee."""
# Length over which a correction fades, solver's units.
SOFT = 8.0
# Vertices may move up to this distance from a crossing, in units of SOFT. At 4, a tenth of the correction is left.
FREE = 5.0
# Stiffness of other meshes relative to the surface itself: they give way only where they would leave no room.
_OTHER_STIFFNESS = 1000.0
# Extra mass of a vertex at the border of the free region, relative to one at a crossing: volume that a contact squeezes
# away then bulges near the contact.
_EXTRA_MASS = 8.0
# Fraction of the squeezed volume that is lost: 0.15 % of a limb where 5 % of the limb is squeezed.
_LOST = 0.03
# Least movement of a piece under a unit of pressure, solver's units: a piece without an inside does not move.
_LEAST_MOVEMENT = 1e-9

# Barrier: gap below which it pushes two surfaces apart, solver's units,
_BARRIER_GAP = 0.7
# further gap that always remains, solver's units,
_KEPT_GAP = 0.3
# sum of both gaps relative to a short edge (the 5th percentile), at most,
_GAPS_PER_EDGE = 1 / 3
# and stiffness relative to that of the correction.
_BARRIER_STIFFNESS = 10.0
# The gaps are halved at most this often until nothing is within them at rest.
_GAP_HALVINGS = 8
# Edges below this length have none, solver's units: a micrometre of a knee.
_LEAST_EDGE = 1e-3
# A triangle of another mesh lies on the surface, and never collides, if its gap at rest is below this, solver's units.
_LYING_ON = 0.1 * (_BARRIER_GAP + _KEPT_GAP)
# A straight step ends where this fraction of the distance to a collision is used up,
_USED_UP = 0.99
# and this fraction of the step up to there is taken.
_SAFE = 0.9


@dataclass(frozen=True, slots=True)
class SkinnedPose:
    """Positions that skinning gives the vertices in a pose.

    Attributes:
        positions: (vertices, 3) solver's units, in the coordinate frame of the fold.
        matrices: (vertices, 3, 3) from bind space to that frame.
    """

    positions: Floats
    matrices: Floats


@dataclass(frozen=True, slots=True)
class SolverState:
    """Positions that the solver gives the vertices in a pose.

    Attributes:
        positions: (vertices, 3) solver's units.
        converged: True if the last step was short enough and all vertices that are not free are in their places.
        steps: Number of Newton steps that it took.
        near: The collisions in ipctk; None if nothing is near.
    """

    positions: Floats
    posed: SkinnedPose
    converged: bool = True
    steps: int = 0
    near: Any = None

    @property
    def correction(self) -> Floats:
        """(vertices, 3) positions relative to the skinned ones, solver's units, without rounding errors."""
        found = self.positions - self.posed.positions
        return np.where(np.abs(found) > ROUNDING, found, 0.0)


@dataclass(frozen=True)
class Tissue:
    """A surface that may touch itself, and other meshes that it may touch.

    Attributes:
        rest: (vertices, 3) solver's units.
        triangles: (triangles, 3).
        colliding: (triangles,) True if the triangle may touch anything: it crosses nothing at rest and is near enough.
        free: (vertices,) True if the solver may move the vertex.
        own: (vertices,) False for vertices of other meshes.
        apart: (vertices,) distance at rest from vertices that cross without contact, solver's units.
    """

    rest: Floats
    triangles: Ints
    colliding: Bools
    free: Bools
    own: Bools
    apart: Floats

    def __getstate__(self) -> dict[str, Any]:
        """The attributes: what is computed from them is computed again in another process."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def ready(self) -> "Tissue":
        """A copy in which nothing that touches at rest collides, nor meshes that lie on it; all is computed once."""
        # No gap is small enough for these; and triangles of other meshes that lie on the surface may stay there.
        touching, close = self._nearer_at_rest(0.5**_GAP_HALVINGS * _KEPT_GAP), self._nearer_at_rest(_LYING_ON)
        never = (touching | (close & ~self.own))[self.triangles].any(axis=1)
        found = replace(self, colliding=self.colliding & ~never)
        _ = found.mesh, found.barrier, found.pressures, found._crossings, found._tearing
        return found

    def _nearer_at_rest(self, gap: float) -> Bools:
        """(vertices,) True for those of triangles and edges that are nearer at rest than a gap, for long edges."""
        found = self._near(self.rest, 0.0, gap * self._gap_scale)
        edges, triangles = self.mesh.edges, self.mesh.faces
        pairs = [found[k].vertex_ids(edges, triangles) for k in range(len(found))]
        near = np.array([vertex for pair in pairs for vertex in pair if vertex >= 0], np.intp)
        on = np.zeros(len(self.rest), bool)
        on[self.rows[near]] = True
        return on

    @cached_property
    def _gap_scale(self) -> float:
        """Factor on both gaps, at most 1, that makes them small enough for short edges."""
        edges = edges_of(self.triangles[(self.free & self.own)[self.triangles].any(axis=1)])
        lengths = np.sqrt(np.sum((self.rest[edges[:, 0]] - self.rest[edges[:, 1]]) ** 2, axis=1))
        lengths = lengths[lengths >= _LEAST_EDGE]
        short = float(np.percentile(lengths, 5)) if len(lengths) else 1.0
        return min(1.0, _GAPS_PER_EDGE * short / (_BARRIER_GAP + _KEPT_GAP))

    @cached_property
    def gaps(self) -> tuple[float, float]:
        """The barrier's gap and the gap that is kept, solver's units; nothing is within them at rest."""
        scale = self._gap_scale
        for _ in range(_GAP_HALVINGS):
            if not len(self._near(self.rest, scale * _BARRIER_GAP, scale * _KEPT_GAP)):
                break
            scale /= 2.0
        return scale * _BARRIER_GAP, scale * _KEPT_GAP

    @cached_property
    def rows(self) -> Ints:
        """(touching,) sorted vertices of the triangles that may collide; ipctk knows only these."""
        return distinct_values(self.triangles[self.colliding].reshape(-1))

    @cached_property
    def mesh(self) -> Any:
        """The mesh in ipctk, of the vertices in `rows`; vertices without triangles would collide everywhere.

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
        """(touching, 3) of (vertices, 3), in the layout that ipctk asks for."""
        return np.asfortranarray(positions[self.rows])

    @property
    def free_rows(self) -> Ints:
        """(free,) sorted vertices of the fold's own mesh that the solver may move."""
        return np.flatnonzero(self.free & self.own)

    @cached_property
    def _crossings(self) -> Crossings:
        """The trees of `mesh`."""
        return Crossings.of(self.rest[self.rows], np.searchsorted(self.rows, self.triangles[self.colliding]))

    @cached_property
    def _tearing(self) -> Tearing:
        """The part of the surface that may tear."""
        own = self.triangles[self.own[self.triangles].all(axis=1)]
        return Tearing.of(self.rest, own, self.free, self.apart == 0.0)

    @cached_property
    def edges(self) -> Ints:
        """(edges, 2)."""
        return edges_of(self.triangles)

    @cached_property
    def barrier(self) -> Any:
        """The barrier in ipctk."""
        import ipctk

        gap = self.gaps[0]
        return ipctk.BarrierPotential(gap, _BARRIER_STIFFNESS / gap**3)

    @cached_property
    def stiffness(self) -> Any:
        """(vertices, vertices) sparse matrix of the energy of a correction, see `stiffness_of`."""
        import scipy.sparse as sparse

        heavier = 1.0 + _EXTRA_MASS * (self.apart / (FREE * SOFT)) ** 2
        whole = stiffness_of(self.rest, self.triangles, soft=SOFT, heavier=heavier)
        # Meshes are not joined, so one factor for each leaves the matrix symmetric.
        return (sparse.diags_array(np.where(self.own, 1.0, _OTHER_STIFFNESS)) @ whole).tocsr()

    @cached_property
    def pieces(self) -> Pieces:
        """The pieces of the surface whose volume is kept."""
        return Pieces.of(self.triangles, self.free & self.own)

    @cached_property
    def pressures(self) -> Floats:
        """(pieces,) force per unit of lost volume, so stiff relative to the surface that hardly any volume is lost."""
        gradients = self.pieces.gradients(self.rest)[:, self.free]
        movements = np.sum(gradients * self.moves_under(gradients), axis=(1, 2))
        return np.asarray((1.0 / _LOST - 1.0) / np.maximum(movements, _LEAST_MOVEMENT))

    def moves_under(self, forces: Floats) -> Floats:
        """(fields, free, 3) movements of the free vertices under (fields, free, 3) forces."""
        columns = forces.transpose(1, 0, 2).reshape(-1, 3 * len(forces))
        return self._moved(columns).reshape(-1, len(forces), 3).transpose(1, 0, 2)

    def response(self) -> Response:
        """The movement of the free vertices under forces, before anything has touched."""
        return Response(self._moved, int(np.count_nonzero(self.free)))

    def _moved(self, forces: Floats) -> Floats:
        """(free, columns) movements of the free vertices, one coordinate for each column of forces."""
        return np.asarray(self._factors.solve(np.asfortranarray(forces)))

    @cached_property
    def _factors(self) -> Any:
        """The factors of the free vertices' stiffness."""
        rows = np.flatnonzero(self.free)
        return factorised(self.stiffness[rows][:, rows].tocsc())

    def collisions(self, positions: Floats) -> Any:
        """The collisions, in ipctk, at (vertices, 3) positions."""
        return self._near(positions, *self.gaps)

    def is_clear(self, positions: Floats) -> bool:
        """True if nothing is near and nothing crosses at (vertices, 3) positions."""
        # A long edge may cross a large triangle far from all their vertices.
        return not len(self.collisions(positions)) and not self.crossing(positions).any()

    def hessian(self, near: Any, positions: Floats) -> Any:
        """(3 · touching, 3 · touching) sparse Hessian of the barrier at (vertices, 3), made positive semidefinite."""
        import ipctk

        return self.barrier.hessian(near, self.mesh, self.placed(positions), ipctk.PSDProjectionMethod.CLAMP).tocsr()

    def gradient(self, near: Any, positions: Floats) -> Floats:
        """(vertices, 3) gradient of the barrier at (vertices, 3) positions."""
        gradient = np.zeros_like(positions)
        gradient[self.rows] = self.barrier.gradient(near, self.mesh, self.placed(positions)).reshape(-1, 3)
        return gradient

    def crossing(self, positions: Floats) -> Bools:
        """(vertices,) True for the corners of edges and triangles that cross at (vertices, 3) positions."""
        counting = (self.free & self.own)[self.rows]
        marked = np.zeros(len(positions), bool)
        marked[self.rows] = self._crossings.vertices_at(positions[self.rows], counting)
        return marked

    def tears(self, given: Floats, shown: Floats) -> bool:
        """True if (vertices, 3) positions are torn relative to the given ones."""
        return self._tearing.tears(given, shown, self.crossing)

    def _near(self, positions: Floats, barrier_gap: float, kept_gap: float) -> Any:
        import ipctk

        found = ipctk.NormalCollisions()
        found.build(self.mesh, self.placed(positions), barrier_gap, kept_gap)
        return found

    def free_fraction(self, start: Floats, end: Floats) -> float:
        """The fraction of the straight step from (vertices, 3) positions to others without a collision.

        It is 1, or somewhat less than the way to the first collision.
        """
        import ipctk

        ends, search = (self.placed(start), self.placed(end)), ipctk.AdditiveCCD(conservative_rescaling=_USED_UP)
        fraction = float(ipctk.compute_collision_free_stepsize(self.mesh, *ends, self.gaps[1], narrow_phase_ccd=search))
        return fraction if fraction >= 1.0 else _SAFE * fraction
