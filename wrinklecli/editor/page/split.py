"""A view that is split: surfaces have no wrinkles left of a plane through the eye, and have them right of it.

Both states have the same triangles, so the plane chooses between them vertex by vertex, and nothing has to be clipped.
"""

import numpy as np
from viser import CameraHandle, transforms

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.intersections import zero_lines

# Part of the distance to the eye by which the line of the cut lies before the surface, so that this does not hide it.
_LIFT = 0.003


@dataclass(frozen=True, slots=True)
class SplitPlane:
    """A plane that the eye sees as an upright line.

    Attributes:
        eye: (3,) a point of it.
        right: (3,) unit normal, to the right.
    """

    eye: Floats
    right: Floats

    @classmethod
    def seen_by(cls, camera: CameraHandle, share: float) -> "SplitPlane | None":
        """The plane at a share of a view's width; None for a camera that sees nothing."""
        axes = axes_of(camera)
        aspect = camera.image_width / max(camera.image_height, 1)
        across = (2.0 * share - 1.0) * np.tan(camera.fov / 2.0) * aspect
        normal = axes[:, 0] - across * axes[:, 2]
        length, eye = float(np.linalg.norm(normal)), np.array(camera.position, float)
        sound = np.isfinite([*eye, *normal]).all() and length > 0
        return cls(eye, normal / length) if sound else None

    def distances(self, points: Floats) -> Floats:
        """(points,) distances of (points, 3) from the plane; those to the right are positive."""
        return (points - self.eye) @ self.right

    def between(self, left: Floats, right: Floats) -> Floats:
        """(points, 3) of the state to the left or to the right, by the side on which the left one is."""
        return np.where((self.distances(left) > 0)[:, None], right, left)

    def cut(self, points: Floats, triangles: Ints) -> Floats:
        """(segments, 2, 3) where the plane cuts (triangles, 3) of (points, 3), a little nearer to the eye."""
        found, shares = zero_lines(self.distances(points), triangles)
        places = np.einsum("sc,sca->sa", shares, points[triangles[found]])
        return np.asarray((places + _LIFT * (self.eye - places)).reshape(-1, 2, 3))


def axes_of(camera: CameraHandle) -> Floats:
    """(3, 3) axes of a camera in columns: right, down, forwards."""
    return np.asarray(transforms.SO3(np.asarray(camera.wxyz)).as_matrix())
