"""The effect of one muscle: its morph targets, their weights by its length and activation, and its drive."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np

from wrinklecli.character.carried import pose_carriers
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.segment import Contraction, Lengths
from wrinklecli.effects.body import BodyEffect
from wrinklecli.effects.effect import MeshPlan, Motion, named_targets
from wrinklecli.effects.muscle.attach import AttachedMuscle
from wrinklecli.effects.muscle.meeting import passes_through
from wrinklecli.effects.muscle.volume import SHORTEST, THINNEST, ConstantVolume
from wrinklecli.effects.shapes import summed
from wrinklecli.errors import listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, significant
from wrinklecli.tools.records import in_axes

# The section of the effects that keep skin apart.
_CONTACT = "folds"
# Part of a muscle's greatest bulge below which nobody sees that it passes through other skin.
_LEAST_DEEP = 0.1
# Decimal places of a thickness gained: those that follow are rounding errors of a muscle at rest.
_DIGITS = 12
# Change of a muscle's length over that at rest below which it does nothing that one would see.
_LEAST_CHANGE = 1e-3


@dataclass(frozen=True, slots=True)
class MuscleEffect(BodyEffect[AttachedMuscle]):
    """One muscle's morph targets. Its states are `Lengths`, or a `Contraction`.

    Attributes:
        height: The largest move of the skin at the greatest thickness, scene units.
        gained: Volume that the skin gains at the greatest thickness, cubic scene units.
        split: The response with a further target, so that no weight is below 0; None if weights may be.
    """

    height: float
    gained: float
    split: ConstantVolume | None = None

    section: ClassVar[str] = "muscles"

    @property
    def drive(self) -> Drive:
        """The segment of the muscle, and the weights that keep its volume."""
        if self.split is None:
            return self.attached.drive
        return replace(self.attached.drive, targets=self.target_names, response=self.split)

    def shape_weights(self, sampled: Floats) -> Floats:
        """The weights as sampled, or split so that none is below 0."""
        return sampled if self.split is None else self.split.split(sampled)

    def with_unit_weights(self, _sampled: Sequence[Floats]) -> "MuscleEffect":
        """The same motion with weights in [0, 1]: weights below 0 get targets of their own."""
        response = self.attached.response
        thinnest = (THINNEST - 1.0) / response.gains[0] * response.mix[0]
        lows = np.maximum(-np.vstack([thinnest, response.mix]), 0.0).max(axis=0)
        shapes = [None if target is None else target.shape for target in self.targets]
        pairs = zip(shapes, lows.tolist(), strict=True)
        minus = [summed([shape], np.array([-low])) for shape, low in pairs if shape is not None and low > 0]
        return replace(
            self, targets=named_targets(self.identifier, [*shapes, *minus]), split=replace(response, lows=lows)
        )

    @classmethod
    def observe(cls, effects: Sequence[Self], rig: Rig, motion: Motion, times: Floats, _known: Sequence[Any]) -> Any:
        """The length of each muscle at all times; the bones of all are posed once."""
        segments = [each.attached.segment for each in effects]
        points = [point for each in segments for point in each.points]
        carriers = pose_carriers(points, rig.own, motion.clip, times)
        return [each.contraction(rig.own, motion.clip, times, carriers) for each in segments]

    def exact_weights(self, _motion: Motion, _sampled: Floats, _times: Floats, state: Lengths | Contraction) -> Floats:
        """(times, targets) the weights that keep the volume."""
        return self.attached.response.weights(state)

    def raised(self, _times: Floats, state: Lengths | Contraction) -> Bools:
        """(times,) True where the muscle is thicker than at rest."""
        return np.asarray(self.attached.response.weights(state).any(axis=1))

    def telling(self, exact: Floats, _state: Lengths | Contraction) -> set[int]:
        """The times when the muscle is thickest and thinnest."""
        total = exact.sum(axis=1)
        return {int(np.argmax(total)), int(np.argmin(total))}

    def weight_error(self, played: Floats, exact: Floats, _state: Lengths | Contraction, _clip: Clip) -> float:
        """Largest error of the move that a weight stands for, scene units."""
        sizes = np.array([0.0 if target is None else target.shape.tallest for target in self.targets])
        every = np.zeros((len(played), len(self.targets)))
        every[:, self.columns] = played
        count = exact.shape[1]
        if self.split is not None and self.split.lows is not None:
            negative = np.flatnonzero(self.split.lows)
            every[:, negative] -= every[:, count:] * self.split.lows[negative]
        return float((np.abs(every[:, :count] - exact) * sizes[:count]).max(initial=0.0))

    def describe(self, plan: MeshPlan) -> Json:
        """The muscle's entry in the report; lengths are scene units, volumes cubic ones."""
        attached, names = self.attached, plan.rig.names
        return {
            "name": self.name,
            "where": attached.tool.where,
            "node": names[plan.rig.node],
            "origin": names[attached.bones[0]],
            "insertion": names[attached.bones[1]],
            "bone": names[attached.bone],
            "length": significant(attached.belly.span),
            "tendons": significant(attached.belly.tendons),
            "thickness": significant(attached.belly.thickness),
            "width": significant(attached.belly.width),
            "depth": significant(attached.belly.depth),
            "height_limit": significant(self.height),
            "volume_gained": significant(self.gained),
            "moved_vertices": int(np.any(self.deltas, axis=(0, 2)).sum()),
            "targets": list(self.target_names),
        }

    def describe_clip(self, motion: Motion, state: Lengths | Contraction) -> Json | None:
        """The muscle's entry in a clip: lengths over that at rest, and what the skin does; None while hidden."""
        assert len(motion.times)
        if not state.active.any():
            return None
        lengths = state.distances[state.active]
        response = self.attached.response
        gains = np.round(response.thicknesses(lengths) - 1.0, _DIGITS) + 0.0
        bulge, volumes = gains * self._height_of_thickness, gains * self._volume_of_thickness
        return {
            "name": self.name,
            "length": [significant(float(end / response.rest_length)) for end in (lengths.min(), lengths.max())],
            "bulge": [significant(float(end)) for end in (bulge.min(), bulge.max())],
            "volume_gained": significant(float(volumes.max())),
        }

    @property
    def _height_of_thickness(self) -> float:
        """The largest move of the skin for one more thickness, scene units."""
        return self.height / float(self.attached.response.gains[-1])

    @property
    def _volume_of_thickness(self) -> float:
        """The volume that the skin gains for one more thickness, cubic scene units."""
        return self.gained / float(self.attached.response.gains[-1])

    def warnings(self, plan: MeshPlan, motions: Sequence[tuple[Motion, Any, Floats]], *, up: str) -> list[str]:
        """Warnings about a muscle that nothing moves, or that is asked to shorten further than it can."""
        attached, response, warnings = self.attached, self.attached.response, []
        if attached.idle:
            place = ", ".join(f"{x:.4g}" for x in in_axes(attached.belly.insertion.tolist(), up))
            bone = plan.rig.names[attached.bones[0]]
            warnings.append(
                f"{self.name}: both ends are on {bone!r}, so no joint shortens it; its insertion"
                f" [{place}] belongs on the bone that it moves, for instance by {{joint: NAME, offset: …}}"
            )
            return warnings
        least, at, clip = np.inf, 0.0, ""
        moved = False
        for motion, state, _ in motions:
            lengths = np.where(state.active, state.distances, response.rest_length)
            moved |= bool((np.abs(lengths / response.rest_length - 1.0) > _LEAST_CHANGE).any())
            # Ends that come too near are a fault of the muscle's place; what an activation adds is not.
            lengths = np.where(state.active, state.ends.distances, response.rest_length)
            if lengths.min() < least:
                least, at, clip = float(lengths.min()), float(motion.times[int(np.argmin(lengths))]), motion.clip.name
        if motions and not moved:
            warnings.append(f"{self.name}: no clip changes its length, and nothing activates it: it stays as at rest")
        shortest = response.tendons + SHORTEST * response.belly
        if least < shortest:
            warnings.append(
                f"{self.name}: its ends come to {100 * least / response.rest_length:.3g} % of their distance at rest in"
                f" {clip!r} at {at:.3g} s; below {100 * shortest / response.rest_length:.3g} % it gets no thicker, as"
                " fibres shorten to half at most; an insertion nearer to the joint shortens less"
            )
        if attached.covers:
            stay = "stays" if len(attached.covers) == 1 else "stay"
            warnings.append(
                f"{self.name}: {listed(attached.covers)} over it {stay} as at rest: the skin may come through; a copy"
                f" of the muscle with `node: {attached.covers[0]}` lets clothes swell too"
            )
        warnings += self._meeting(plan, motions)
        return warnings

    def _meeting(self, plan: MeshPlan, motions: Sequence[tuple[Motion, Any, Floats]]) -> list[str]:
        """A warning about the clip in which the muscle is thickest, if it passes through other skin there."""
        if any(layer.section == _CONTACT for layer in plan.layers):
            return []
        peaks = [
            (float(np.where(state.active, state.distances, np.inf).min()), number)
            for number, (_, state, _) in enumerate(motions)
        ]
        length, number = min(peaks, default=(np.inf, 0))
        if not length < self.attached.response.rest_length:
            return []
        motion, state, _ = motions[number]
        time = float(motion.times[int(np.argmin(np.where(state.active, state.distances, np.inf)))])
        deep = passes_through(plan, self.attached, self.deltas, motion.clip, time)
        if deep <= _LEAST_DEEP * self.height:
            return []
        return [
            f"{self.name}: passes through other skin in {motion.clip.name!r} at {time:.3g} s, which it lifts by up to"
            f" {deep:.3g} there; a tool over the joint with `contact: resolve` keeps both apart, or a lower thickness"
        ]
