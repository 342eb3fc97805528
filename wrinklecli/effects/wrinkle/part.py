"""A wrinkling tool on the refined surface, as it answers what may be asked of any effect."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.activity import Activity, ClipActivity, activities_in, playing
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.report import describe_heights, describe_place
from wrinklecli.effects.wrinkle.warnings import placement_warnings, tool_warnings
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.surface.refine import Refinement

# Points of a control curve that is drawn.
_CURVE_POINTS = 200


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

    def reader(self, rig: Rig, clip: Clip | None) -> Signal:
        """What `Activity` has at each time."""
        patches = [self.attached]
        played = playing(patches, rig, clip)

        def read(times: Floats) -> Floats:
            (seen,) = activities_in(played, patches, times)
            beside = seen.distances, seen.rest_lengths, seen.shortenings, seen.unabsorbed
            return np.column_stack([*beside, seen.amplitudes.reshape(len(times), -1)])

        return read

    def _seen(self, numbers: Floats) -> Activity:
        """The activity of which the reader has made (frames, numbers)."""
        distances, rest_lengths, shortenings, unabsorbed = numbers[:, :4].T
        amplitudes = numbers[:, 4:].reshape(len(numbers), *self.attached.curve.greatest_amplitudes.shape)
        return Activity(distances, rest_lengths, shortenings, unabsorbed, amplitudes)

    def displacements(
        self, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, numbers: Floats | None = None
    ) -> Floats:
        """(frames, vertices, 3) the method's displacements, bind space."""
        amplitudes = None if numbers is None else self._seen(numbers).amplitudes
        return displacements(self.carried, fine, rig, clip, times, amplitudes)

    def heights(self, _fine: Refinement, clip: Clip | None, numbers: Floats) -> Floats:
        """(frames,) the height of the control curve's highest bump."""
        patch = self.attached
        strength = abs(patch.clip_strength(clip) * patch.shape_strength)
        heights = patch.curve.heights(self._seen(numbers).amplitudes)
        return np.asarray(strength * heights.reshape(len(numbers), -1).max(axis=1))

    def cut(self, clip: Clip | None, numbers: Floats) -> Floats:
        """(points, 2) the control curve."""
        patch, seen, us = self.attached, self._seen(numbers), np.linspace(0.0, 1.0, _CURVE_POINTS)
        strength, distance = patch.clip_strength(clip) * patch.shape_strength, float(seen.distances[0])
        heights = strength * np.einsum("gm,gmv->v", seen.amplitudes[0], patch.curve.shapes(us))
        return np.stack([us * (distance if np.isfinite(distance) else 0.0), heights], axis=1)

    def facts(self, plan: MeshPlan, up: str) -> Json:
        """What `check` says of it."""
        return describe_place(plan, self.carried, self.region, up)

    def facts_in(self, _plan: MeshPlan, clip: Clip, times: Floats, numbers: Floats) -> Json:
        """What `check` says of it in a clip."""
        return describe_heights(self.carried, ClipActivity(clip, times, self._seen(numbers)))

    def warnings(self, plan: MeshPlan, clips: Sequence[tuple[Clip, Floats, Floats]], *, up: str) -> list[str]:
        """Warnings about its place and its heights in clips, each with (frames,) seconds and the reader's numbers."""
        seen = [ClipActivity(clip, times, self._seen(numbers)) for clip, times, numbers in clips]
        return tool_warnings(plan, self.carried, seen, up=up)

    def place_warnings(self, plan: MeshPlan) -> list[str]:
        """Warnings about anchors far off, and a patch that reaches across a fold."""
        return placement_warnings(plan, self.carried)
