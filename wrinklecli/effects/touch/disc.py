"""The disc of skin round a touch in which edges must be split, so that it can show the slide and the rings.

Rings curve, so edges must be short along two axes: the disc is a region twice, once for each.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.effects.touch.skin import Place
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, ramp, smoothstep, unit
from wrinklecli.surface.path import Straight
from wrinklecli.surface.region import FACING, Region
from wrinklecli.surface.rest import Rest

# Part of the radius from which on the displacement fades to the disc's border.
_RIM = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class Disc(Region):
    """A disc of skin, with u along an axis of its tangent plane.

    Attributes:
        place: Its middle and axes.
        radius: Scene units.
        intervals: Equal intervals along u that triangles must be able to show.
        greatest_height: Of the displacement along the normals, scene units.
        members: (members,) sorted coarse triangles.
        pose: The surface at rest.
        turned: True if u runs sideways.
    """

    place: Place
    radius: float
    intervals: float
    greatest_height: float
    members: Ints
    pose: Rest
    turned: bool = False

    @property
    def both(self) -> "tuple[Disc, Disc]":
        """The disc, once for each axis."""
        return self, replace(self, turned=True)

    @property
    def span(self) -> float:
        """The diameter."""
        return 2.0 * self.radius

    @property
    def half_width(self) -> float:
        """The radius."""
        return self.radius

    @property
    def path(self) -> Straight:
        """The diameter along the axis."""
        along = self.place.axes[int(self.turned)]
        return Straight(self.place.at - self.radius * along, along, self.place.axes[2], self.span)

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u from 0 to 1 along the axis and v across, of (…, 3) world positions at rest."""
        relative = (positions - self.place.at) / self.radius
        along, across = relative @ self.place.axes[0], relative @ self.place.axes[1]
        along, across = (across, along) if self.turned else (along, across)
        return (along + 1.0) / 2.0, across

    def cosines(self, _u: Floats, normals: Floats) -> Floats:
        """(…,) cosines between (…, 3) unit normals and the place's."""
        return np.asarray(normals @ self.place.axes[2])

    def share(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) fractions of the displacement: 1 in the disc, fading at its border and where the skin turns away."""
        apart = np.hypot(2.0 * u - 1.0, v)
        return np.asarray(smoothstep(ramp(apart, 1.0, _RIM)) * smoothstep(ramp(cosines, *FACING)))


def disc_on(rest: Rest, place: Place, radius: float, intervals: float, height: float, still: Floats) -> Disc:
    """The disc round a place, of the coarse triangles that face as it does and move."""
    corners = rest.positions[rest.triangles]
    distances, _ = place.polar(corners)
    longest = np.sqrt(np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=2)).max(axis=1)
    normals = unit(face_normals(rest.positions, rest.triangles))
    facing = normals @ place.axes[2]
    if np.median(np.linalg.det(rest.blended[:, :, :3])) <= 0:  # a pose that mirrors the mesh turns it inside out
        facing = np.abs(facing)
    near = (distances.min(axis=1) < radius + longest) & (facing > 0) & (still[rest.triangles] < 1).any(axis=1)
    return Disc(place, radius, intervals, height, np.flatnonzero(near), rest)
