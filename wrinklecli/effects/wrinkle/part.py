"""A wrinkling tool on the refined surface, as it answers what may be asked of any effect."""

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.segment import Lengths
from wrinklecli.effects.effect import MeshPlan, Seen
from wrinklecli.effects.wrinkle.activity import Activity, ClipActivity, curve_drive
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.effect import WrinkleWords
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.report import describe_heights, describe_place
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.surface.refine import Refinement

# Points of a control curve that is drawn at a moment; and of one for each interval, doubled by each level of details.
_CURVE_POINTS, _POINTS = 200, 32


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
    def target_vertices(self) -> list[Ints]:
        """For each target the vertices under its bumps."""
        curve, us = self.attached.curve, self.us[:, None]
        under = (us >= curve.bumps.starts) & (us < curve.bumps.ends)
        of_groups = [self.vertices[under[:, list(bumps)].any(axis=1)] for bumps in curve.groups]
        return [vertices for vertices in of_groups for _ in range(curve.greatest_amplitudes.shape[1])]

    @property
    def shares(self) -> Floats:
        """(vertices,) the parts of the curve's height that they get, over the greatest."""
        magnitudes = np.abs(self.carried.magnitudes)
        return np.asarray(magnitudes / magnitudes.max())

    @property
    def us(self) -> Floats:
        """(vertices,) their places along the control curve."""
        return self.carried.us

    @property
    def drive(self) -> Drive:
        """Its segment and filter, with the table of its control curve; `attachment: patch` has them too."""
        return curve_drive(self.attached)

    def sizes(self, _fine: Refinement) -> Floats:
        """(amplitudes,) the greatest height for each."""
        return np.full(self.attached.curve.greatest_amplitudes.size, self.attached.greatest_height)

    def numbers(self, _clip: Clip | None, reading: Lengths) -> Floats:
        """(frames, numbers) what `Activity` has at each time."""
        seen = Activity.of(self.attached, reading)
        beside = seen.distances, seen.rest_lengths, seen.shortenings, seen.unabsorbed
        return np.column_stack([*beside, seen.amplitudes.reshape(len(seen.distances), -1)])

    def strengths(self, seen: Seen) -> Floats:
        """(frames,) shortenings over the rest length, without what the tissue takes."""
        found = Activity.of(self.attached, seen.reading)
        return np.asarray(found.shortenings / found.rest_lengths)

    def _seen(self, numbers: Floats) -> Activity:
        """The activity that (frames, numbers) are."""
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
        """The entry of `check` for it."""
        return describe_place(plan, self.carried, self.region, up)

    def facts_in(self, _plan: MeshPlan, seen: Seen) -> Json:
        """The entry of `check` for it in a clip."""
        found = Activity.of(self.attached, seen.reading)
        return describe_heights(self.carried, ClipActivity(seen.motion.clip, seen.motion.times, found))

    def cuts(self, shortenings: Floats) -> tuple[Floats, Floats]:
        """(cuts, points) of the control curve."""
        curve = self.attached.curve
        lengths = np.full(len(shortenings), curve.rest_length)
        distances = (1.0 - shortenings) * lengths
        amplitudes, _ = curve.follow(distances, lengths)
        us = np.linspace(0.0, 1.0, _POINTS * 2 ** len(curve.details) * curve.interval_count + 1)
        heights = self.attached.shape_strength * np.einsum("fgm,gmu->fu", amplitudes, curve.shapes(us))
        return distances[:, None] * us, heights

    def words(self, plan: MeshPlan) -> WrinkleWords:
        """Its words about itself."""
        return WrinkleWords(self.carried, self.region, plan.rig)
