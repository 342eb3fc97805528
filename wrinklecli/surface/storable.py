"""Forbids splits of edges whose midpoint could not move as the surface does there.

A midpoint depends on the joints of both ends, which may be more than a vertex of the file can have. And where a mesh
touches another, a new midpoint in only one of them would leave a gap.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values
from wrinklecli.numeric.red_green import Level
from wrinklecli.surface.prune import joint_distances, pruning_errors
from wrinklecli.surface.region import Region
from wrinklecli.surface.rest import Rest


@dataclass(frozen=True, slots=True)
class SplitLimits:
    """The limits of a file on midpoints near the regions; other fields are those of `refine`.

    Attributes:
        near: (coarse triangles,) True for triangles at a region.
        bind_positions: (coarse vertices, 3) bind space at rest.
        weights: (coarse vertices, acting joints) skin weights near the regions; 0 elsewhere.
        distances: (acting joints, acting joints) in the skeleton.
        poses: (poses, acting joints, 4, 4) bind to world space.
    """

    contacts: Bools
    near: Bools
    bind_positions: Floats
    weights: Floats
    distances: Floats
    poses: Floats
    influences: int
    tolerance: float

    @classmethod
    def of(
        cls,
        surface: Surface,
        rest: Rest,
        members: Bools,
        rig: Rig,
        regions: Sequence[Region],
        *,
        contacts: Bools,
        influences: int,
        poses: Floats,
        tolerance: float,
    ) -> "SplitLimits":
        """Collect the vertices near the (coarse triangles,) members, and the joints that act there."""
        near = np.asarray(np.isin(surface.triangles, surface.triangles[members]).any(axis=1))
        used = distinct_values(surface.triangles[near])
        # Most joints move no vertex of a region.
        acting = distinct_values(surface.joints[used])
        return cls(
            contacts=contacts,
            near=near,
            bind_positions=rest.bind_positions,
            weights=spread_weights(surface, used, len(rig.joints), acting),
            distances=joint_distances(rig, regions, acting),
            poses=poses[:, acting],
            influences=influences,
            tolerance=tolerance,
        )

    def forbidden(self, level: Level) -> Bools:
        """(edges,) edges along another mesh, and edges near a region whose midpoint has too many joints."""
        touching = np.zeros(max(int(level.edges.max(initial=0)) + 1, len(self.contacts)), bool)
        touching[: len(self.contacts)] = self.contacts
        found: Bools = touching[level.edges[:, 0]] & touching[level.edges[:, 1]]
        edges = distinct_values(level.triangle_edges[self.near[level.parents]])
        weights = level.of_midpoints(edges, self.weights)
        many = (weights > 0).sum(axis=1) > self.influences
        edges, weights = edges[many], weights[many]
        positions = level.of_midpoints(edges, self.bind_positions)
        errors = pruning_errors(weights, positions, self.distances, self.influences, self.poses)
        found[edges] |= errors > self.tolerance
        return found


def spread_weights(surface: Surface, vertices: Ints, joint_count: int, chosen: Ints | slice = slice(None)) -> Floats:
    """(all vertices, chosen joints) skin weights of some vertices; 0 elsewhere, which takes hardly any memory."""
    some = surface.dense_weights(vertices, joint_count)[:, chosen]
    dense = np.zeros((len(surface.positions), some.shape[1]))
    dense[vertices] = some
    return dense
