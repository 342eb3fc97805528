"""The part of a surface that a field wrinkles, and the edges that are too long to show its wrinkles."""

from typing import ClassVar

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.numeric.closest import Tree
from wrinklecli.numeric.red_green import Level
from wrinklecli.numeric.subdivide import Subdivision
from wrinklecli.surface.path import Straight
from wrinklecli.surface.region import SmoothRegion, Steps
from wrinklecli.surface.rest import Rest

# Height over the wavelength from which on edges are as short as wrinkles ask; they may be longer where it is lower.
_STEEP = 0.2
# Length along a crest over that across it of edges that show it as well. Poses that compress a surface make triangles
# more slender again, and slivers are seen as scratches.
_SLENDER = 1.6


@dataclass(frozen=True, slots=True, eq=False)
class FieldRegion(SmoothRegion):
    """A part of the surface with heights on its vertices, and no coordinates.

    Attributes:
        members: (members,) sorted coarse triangles.
        pose: The surface at rest.
        height: Greatest displacement, scene units.
        shares: (vertices,) parts of it in any pose.
        lines: (vertices, 3) unit directions across the crests, without signs.
        wavelengths: (vertices,) at rest, scene units.
        tree: Finds nearest points on the members.
    """

    members: Ints
    pose: Rest
    height: float
    shares: Floats
    lines: Floats
    wavelengths: Floats
    tree: Tree

    intervals: ClassVar[float] = 1.25

    @property
    def span(self) -> float:
        """Half the shortest wavelength: the interval of its wrinkles."""
        return float(self.wavelengths.min()) / 2.0

    @property
    def half_width(self) -> float:
        """The longest wavelength."""
        return float(self.wavelengths.max())

    @property
    def path(self) -> Straight:
        """A line of a wavelength at the first member: a field has no path."""
        place = self.pose.positions[self.pose.triangles[self.members[0]]]
        along, normal = unit(place[1] - place[0]), unit(np.cross(place[1] - place[0], place[2] - place[0]))
        return Straight(place[0], along, normal, self.half_width)

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) halves, and 1 less the parts of the greatest height at the nearest places to (…, 3) world positions."""
        faces, shares, _ = self.tree.closest_points(positions.reshape(-1, 3))
        found = np.sum(self.shares[self.pose.triangles[self.members[faces]]] * shares, axis=1)
        return np.full(positions.shape[:-1], 0.5), 1.0 - found.reshape(positions.shape[:-1])

    def cosines(self, u: Floats, _normals: Floats) -> Floats:
        """(…,) ones: it lies along the surface."""
        return np.ones(np.shape(u))

    def share(self, _u: Floats, v: Floats, _cosines: Floats) -> Floats:
        """(…,) parts of the greatest height."""
        return np.clip(1.0 - np.abs(v), 0.0, 1.0)

    def steps(self, mesh: Level | Subdivision) -> Steps:
        """Gives (edges,) lengths across the crests over half a wavelength, shorter where wrinkles are lower."""
        steep = np.minimum(self.height * self.shares / self.wavelengths / _STEEP, 1.0)
        coarse = np.concatenate(
            [self.pose.positions, _tensors(self.lines), steep[:, None], self.wavelengths[:, None]], axis=1
        )

        def found(ends: Ints) -> Floats:
            used, at = np.unique(ends, return_inverse=True)
            at = at.reshape(-1, 2)
            places, lines, steep, wavelengths = np.split(mesh.of_vertices(used, coarse), [3, 12, 13], axis=1)
            way = places[at[:, 1]] - places[at[:, 0]]
            line = lines[at].mean(axis=1)
            # The part across the crests, and a share of the whole.
            squared = np.maximum(np.einsum("ei,eij,ej->e", way, line.reshape(-1, 3, 3), way), 0.0)
            length = np.sqrt(np.maximum(squared, np.sum(way**2, axis=1) / _SLENDER**2))
            return np.asarray(2.0 * length / wavelengths[at, 0].mean(axis=1) * np.sqrt(steep[at, 0].max(axis=1)))

        return found


def _tensors(lines: Floats) -> Floats:
    """(n, 9) products of unit vectors with themselves, which have no signs."""
    return np.asarray(np.einsum("vi,vj->vij", lines, lines).reshape(len(lines), 9))
