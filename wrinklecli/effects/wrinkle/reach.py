"""The reach of a tool: how much of its height is left near features of the surface, from 0 to 1."""

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, smoothstep
from wrinklecli.numeric.subdivide import Subdivision
from wrinklecli.surface.features import Nearest


@dataclass(frozen=True, slots=True)
class Reach:
    """The reach of the wrinkles of a tool.

    Attributes:
        nearest: The features near the patch; None if there are none.
        fade: Distance from a feature below which heights fade, scene units.
        detours: (coarse vertices,) 0 for places that are connected with the tool straight over the surface, rising to 1
            for other parts of the body that are only near in space; None if there are none.
    """

    nearest: Nearest | None
    fade: float
    detours: Floats | None

    def at(self, subdivision: Subdivision, vertices: Ints, places: Floats) -> Floats:
        """(vertices,) factors at fine vertices with (vertices, 3) world positions, in the pose of the features."""
        left = np.ones(len(vertices))
        if self.nearest is not None:
            distances = self.nearest.distances(subdivision.triangles, subdivision.parents, vertices, places)
            left *= smoothstep(np.minimum(distances / self.fade, 1.0))
        if self.detours is not None:
            left *= 1.0 - smoothstep(subdivision.interpolate(self.detours[:, None])[vertices, 0])
        return left
