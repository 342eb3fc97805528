"""Cameras project world positions into a picture; views are named or are two angles."""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats

# Tangent of half the vertical field of view, which is 24 degrees: a long lens distorts little.
TANGENT = float(np.tan(np.radians(12.0)))
# Elevation of the views from above and below, degrees; at 90 an azimuth would have no meaning.
_POLE = 89.9

# The name of the view that shows most of the wrinkles.
FACING = "facing"
# Azimuth and elevation, degrees.
VIEWS = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, _POLE),
    "bottom": (0.0, -_POLE),
    "oblique": (35.0, 15.0),
}


def parse_view(text: str) -> tuple[float, float]:
    """Read a name of `VIEWS`, or `azimuth:elevation`, as azimuth and elevation in degrees.

    Raises:
        ValueError: The text is neither.
    """
    if text in VIEWS:
        return VIEWS[text]
    azimuth, colon, elevation = text.partition(":")
    try:
        angles = float(azimuth), float(elevation)
    except ValueError:
        angles = (np.nan, np.nan)
    if not colon or not abs(angles[0]) <= 360 or not abs(angles[1]) <= 90:
        known = ", ".join((FACING, *VIEWS))
        raise ValueError(f"{text!r} is none of {known}, nor azimuth:elevation in degrees, such as -30:45")
    return angles


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera that looks at a point: a long lens, or parallel rays.

    Attributes:
        centre: (3,) point that it looks at, world space.
        axes: (3, 3) rows: right, up, and backwards (from the centre to the eye).
        reach: Half the height of the visible area at its centre, scene units.
        tangent: Tangent of half the vertical field of view; 0 for parallel rays.
    """

    centre: Floats
    axes: Floats
    reach: float
    tangent: float = TANGENT

    @classmethod
    def framing(
        cls, points: Floats, axes: Floats, *, aspect: float, margin: float = 1.12, tangent: float = TANGENT
    ) -> "Camera":
        """Place a camera as near as possible so that it sees all of (n, 3) world-space points.

        Args:
            points: (n, 3) world space.
            axes: (3, 3) as `camera_axes` gives them.
            aspect: Width over height of the picture.
            margin: Factor of the distance, for room around the points.
            tangent: Tangent of half the vertical field of view; 0 for parallel rays.
        """
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        local = (points - middle) @ axes.T
        aim = (local.min(axis=0) + local.max(axis=0)) / 2
        aim[2] = 0.0
        local = local - aim
        depths = local[:, 2] * tangent
        reach = max(
            float((np.abs(local[:, 1]) + depths).max()),
            float((np.abs(local[:, 0]) / aspect + depths).max()),
        )
        return cls(middle + aim @ axes, axes, margin * reach, tangent)

    @property
    def eye(self) -> Floats:
        """(3,) position of the eye, world space; rays must not be parallel."""
        return np.asarray(self.centre + self.axes[2] * self.reach / self.tangent)

    def project(self, points: Floats, size: tuple[int, int]) -> Floats:
        """(…, 2) pixels from the left and the top, of (…, 3) world positions in front of the eye."""
        return project(self.local(points), size, self.tangent)

    def local(self, points: Floats) -> Floats:
        """(…, 3) world positions in camera space: along its axes, from its centre, divided by its reach."""
        return (points - self.centre) @ self.axes.T / self.reach


def camera_axes(azimuth: float, elevation: float) -> Floats:
    """(3, 3) rows: right, up and backwards, of a camera at an azimuth and an elevation in degrees.

    Azimuth 0 sees an asset's front (from +z), 90 sees it from +x; elevation is above the horizon.
    """
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    right = np.array([np.cos(a), 0.0, -np.sin(a)])
    return np.array([right, np.cross(back, right), back])


def project(local: Floats, size: tuple[int, int], tangent: float) -> Floats:
    """(…, 2) pixels from the left and the top, of (…, 3) positions in camera space."""
    width, height = size
    depths = np.maximum(1 - tangent * local[..., 2:], 1e-9)
    flat = local[..., :2] * (1, -1) / depths
    return np.asarray((flat + np.array((width / height, 1))) * (height / 2))
