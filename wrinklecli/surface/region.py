"""A region: the part of a surface that an effect deforms, and how finely its triangles must be split."""

from collections.abc import Callable, Sequence
from typing import Protocol, Self, TypeAlias

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, flags_of
from wrinklecli.numeric.red_green import Level
from wrinklecli.numeric.subdivide import Subdivision
from wrinklecli.surface.anchor import Anchor
from wrinklecli.surface.path import Path
from wrinklecli.surface.rest import Rest

FACING = (0.2, 0.6)
"""Cosines of the normals of a vertex and of a region between which displacement fades in."""

Steps: TypeAlias = Callable[[Ints], Floats]
"""Gives numbers for edges with (edges, 2) vertices."""


class PaintedFactor(Protocol):
    """A factor on the displacement of a region, painted more finely than the surface is."""

    def errors(self, corners: Ints, barycentrics: Floats, level: int) -> Floats:
        """(faces,) greatest difference between the factor on each face and linear mixtures of those at its corners.

        Faces are given by the (faces, 3) glTF vertices of their coarse triangles, by the (faces, 3, 3) coordinates of
        their corners there, and by the level of refinement.
        """


class Region(Protocol):
    """The part of a surface at rest that an effect deforms, with u from 0 to 1 along it and v from -1 to 1 across.

    What is not said otherwise holds where the displacement is smooth: no furrows, no features, and nothing at the whole
    border.
    """

    @property
    def members(self) -> Ints:
        """(members,) sorted coarse triangles that the effect may deform."""

    @property
    def anchors(self) -> Sequence[Anchor]:
        """Points on the surface; joints between two neighbouring anchors bend the region."""
        return ()

    @property
    def path(self) -> Path:
        """The line along its middle at rest, from u = 0 to u = 1."""

    @property
    def at_rest(self) -> Self:
        """The region with u and v as if they were found at rest."""
        return self

    @property
    def pose(self) -> Rest:
        """The pose in which u and v of a place are found; mostly that at rest."""

    @property
    def span(self) -> float:
        """Length of the region along u, scene units."""

    @property
    def mask(self) -> PaintedFactor | None:
        """A factor on its displacement that is painted."""
        return None

    @property
    def half_width(self) -> float:
        """Distance from the middle of the region at which |v| is 1, scene units."""

    @property
    def intervals(self) -> float:
        """Number of equal intervals along u that the triangles must be able to show."""

    @property
    def projected(self) -> bool:
        """True if vertices are projected onto the region in each frame, so that any member may come to lie on it."""
        return False

    @property
    def nominal_height(self) -> float:
        """Greatest displacement at a strength of 1, scene units."""
        return self.greatest_height

    @property
    def greatest_height(self) -> float:
        """Greatest displacement, scene units."""

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u and v at (…, 3) world positions in `pose`."""

    def cosines(self, u: Floats, normals: Floats) -> Floats:
        """(…,) cosines between (…, 3) unit normals of the surface in `pose` and the region's normals at (…,) u."""

    def bowed(self, u: Floats, _v: Floats) -> Floats:
        """(…,) the u at which points on the middle line are displaced as points at (…,) u and v are."""
        return u

    def stretched(self, u: Floats, _v: Floats) -> Floats:
        """(…,) a coordinate along which edges of equal length show the displacement equally well."""
        return u

    def steps(self, _mesh: Level | Subdivision) -> Steps | None:
        """Gives (edges,) lengths of edges of a mesh over an interval, shorter where less of the displacement is left.

        None where they are differences of `stretched` u.
        """
        return None

    @property
    def furrows(self) -> Floats:
        """(furrows,) sorted `stretched` coordinates of sharp furrows, the borders of the region among them, if any."""
        return np.zeros(0)

    def share(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) fraction of the full displacement at points, from the cosines of their normals; 0 outside the region."""

    def crests(self, u: Floats, _v: Floats) -> Floats:
        """(triangles, 3) phases of its bumps at corners: k at a foot, k + 1/2 on a crest; NaN where there is none."""
        return np.full(np.shape(u), np.nan)

    def presence(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) as `share`, but fading to 0 at both ends of the region too."""
        return self.share(u, v, cosines)

    def left(self, _subdivision: Subdivision, _vertices: Ints, _places: Floats) -> Floats | None:
        """(vertices,) factors of the displacement near features of the surface; None if there are none.

        (vertices, 3) `places` are world positions in `pose`.
        """
        return None


def members_of(regions: Sequence[Region], count: int) -> Bools:
    """(count,) True for the coarse triangles, of so many, that belong to a region."""
    return flags_of(np.concatenate([np.zeros(0, np.intp), *(region.members for region in regions)]), count)
