"""What an effect asks of the surface under it: which triangles it deforms, and how finely these must be split."""

from collections.abc import Sequence
from typing import Protocol

from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.surface.anchor import Anchor


class Region(Protocol):
    """A part of a surface at rest that an effect deforms.

    Its coordinates are u along the effect, from 0 to 1, and v across it, from -1 to 1.
    """

    @property
    def members(self) -> Ints:
        """(members,) the coarse triangles that the effect may deform, rising."""
        ...

    @property
    def anchors(self) -> Sequence[Anchor]:
        """Points of the surface; the joints between neighbouring ones bend the region."""
        ...

    @property
    def half_width(self) -> float:
        """|v| is 1 at this distance from the middle of the region, scene units."""
        ...

    @property
    def intervals(self) -> float:
        """How many intervals of equal length along u the triangles must be able to show."""
        ...

    @property
    def projected(self) -> bool:
        """Whether vertices are projected onto the region in each frame, so that any member may come to lie on it."""
        ...

    @property
    def nominal_height(self) -> float:
        """Greatest displacement at a strength of 1, scene units."""
        ...

    @property
    def greatest_height(self) -> float:
        """Greatest displacement, scene units."""
        ...

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u and v of (…, 3) world positions at rest."""
        ...

    def cosines(self, u: Floats, normals: Floats) -> Floats:
        """(…,) cosines of (…, 3) unit normals of the surface and the region's normal at (…,) u."""
        ...

    def bowed(self, u: Floats, v: Floats) -> Floats:
        """(…,) the u whose height points at (…,) u and v have."""
        ...

    def stretched(self, u: Floats, v: Floats) -> Floats:
        """(…,) a coordinate along which edges of equal length show the shape equally well."""
        ...

    def share(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) share of the full displacement at points, from their normals' cosines; 0 outside the region."""
        ...

    def presence(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) as `share`, but fading to 0 at both ends of u as well."""
        ...
