"""A wrinkling tool on the refined surface, as it answers what may be asked of any effect."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.warnings import placement_warnings
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.surface.refine import Refinement


@dataclass(frozen=True, slots=True)
class WrinklePart:
    """A tool on the refined surface; `region` is the number of its patch among the regions of the refinement."""

    carried: CarriedPatch
    region: int

    @property
    def attached(self) -> Patch:
        """Its patch."""
        return self.carried.patch

    @property
    def vertices(self) -> Ints:
        """(vertices,) the vertices that it moves."""
        return self.carried.vertices

    @property
    def shares(self) -> Floats:
        """(vertices,) the parts of the curve's height that they get, over the greatest."""
        magnitudes = np.abs(self.carried.magnitudes)
        return np.asarray(magnitudes / magnitudes.max())

    @property
    def us(self) -> Floats:
        """(vertices,) their places along the control curve."""
        return self.carried.us

    def displacements(self, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames, vertices, 3) the method's displacements, bind space."""
        return displacements(self.carried, fine, rig, clip, times)

    def place_warnings(self, plan: MeshPlan) -> list[str]:
        """Warnings about anchors far off, and a patch that reaches across a fold."""
        return placement_warnings(plan, self.carried)
