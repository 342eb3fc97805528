"""The effect of one wrinkling tool: its targets, their weights by its control curve, and its drive."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.sparse_targets import SparseDeltas
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.table import CurveTable, LeaningTable, Table
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, named_targets
from wrinklecli.effects.shapes import Shape
from wrinklecli.effects.wrinkle import report
from wrinklecli.effects.wrinkle.activity import Activity, ClipActivity, activity, further_activities
from wrinklecli.effects.wrinkle.bending import rising
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.lookup import tabulate_curve, tabulate_weights
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.remix import Remix, Remixed, fewest, in_turn, turns, unit_weights
from wrinklecli.effects.wrinkle.shapes import projected_shapes, shapes_of
from wrinklecli.effects.wrinkle.warnings import tool_warnings
from wrinklecli.effects.wrinkle.weights import weight_path, weights_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints, interpolated, matches

# Part of the tolerance below which a weight may be left out, so that its target does not count as active.
_LEAST_SHARE = 0.1
# Keys of each tool at which the proof compares because its track bends most there.
_BENDS = 4


def curve_weights(patch: Patch, clip: Clip | None, found: Activity) -> Floats:
    """(frames, shapes) weights of a tool's own shapes for its activity in a clip."""
    return patch.clip_strength(clip) * weights_of(patch.curve, found.amplitudes).reshape(len(found.amplitudes), -1)


@dataclass(frozen=True, slots=True)
class WrinkleEffect(Effect):
    """One tool's morph targets. Its states are `Activity`, and its weights as sampled are those of its curve's shapes.

    Attributes:
        carried: The tool on the refined surface.
        number: The number of the tool's patch among the regions of the refinement.
        remix: The other shapes that an engine's limits ask for; None if the shapes are the control curve's.
    """

    carried: CarriedPatch
    number: int
    remix: Remix | None = None

    section: ClassVar[str] = "tools"

    @property
    def name(self) -> str:
        """The tool's name."""
        return self.carried.patch.tool.name

    @property
    def on_skin(self) -> bool:
        """True if the segment's length alone gives the weights; False if vertices are projected in each frame."""
        return self.carried.ring is None

    @property
    def drive(self) -> Drive | None:
        """The segment, filter and table of the tool; None if vertices are projected in each frame."""
        if not self.on_skin:
            return None
        rest = self.carried.patch.segment.rest_length
        response = self._curve_table() if rest.keys or rest.morph else self._table()
        return tool_drive(self.carried.patch, self.target_names, response)

    def _table(self) -> Table:
        curve = self.carried.patch.curve
        return Table("shortenings", *tabulate_weights(curve, lambda each: self.written(self.shape_weights(each))))

    def _curve_table(self) -> CurveTable:
        """The control curve for all rest lengths that keys or a morph target give it."""
        patch, mixed = self.carried.patch, self.remix
        rest = patch.segment.rest_length
        keyed = [length for keys in rest.keys.values() for length in keys[:, 1].tolist()]
        lengths = [patch.span, *keyed, *([rest.morph[1]] if rest.morph else [])]
        mix = np.eye(patch.curve.greatest_amplitudes.size) if mixed is None else mixed.signed_mix
        positive = mixed is not None and bool(mixed.split)
        table = tabulate_curve(patch.curve, min(lengths), max(lengths), mix=self.written(mix).T, positive=positive)
        return replace(table, least=0.0 if mixed is None else mixed.least)

    @classmethod
    def count_targets(cls, _effects: Sequence[Effect]) -> str:
        """Nothing: the summary begins with the targets of the tools."""
        return ""

    def shape_weights(self, sampled: Floats) -> Floats:
        """(frames, shapes) weights of the targets' shapes from (frames, …) weights of the control curve's."""
        flat = sampled.reshape(len(sampled), -1)
        return flat if self.remix is None else self.remix.weights(flat)

    def stored_weights(self, rig: Rig) -> Floats:
        """(targets,) weights in the stored pose: zeros, unless the tools file has another rest pose."""
        if not self.on_skin:
            return np.zeros(len(self.target_names))
        return np.asarray(self.written(self.shape_weights(self._weights(rig, None, np.zeros(1))))[0])

    def _weights(self, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames, shapes) weights of the control curve's shapes in a clip."""
        patch = self.carried.patch
        return curve_weights(patch, clip, activity(patch, rig, clip, times))

    def weights_at(self, rig: Rig, motion: Motion, sampled: Floats, times: Floats) -> Floats:
        """(times, shapes) the curve's weights; straight between those sampled if vertices are projected."""
        return self._weights(rig, motion.clip, times) if self.on_skin else interpolated(times, motion.times, sampled)

    def acting(self, rig: Rig, clip: Clip, time: float) -> list[tuple[Shape, float]]:
        """The tool's shapes with weights by its segment alone; none if vertices are projected in each frame."""
        patch = self.carried.patch
        if not self.on_skin:
            return []
        amplitudes, _ = patch.curve.follow(*patch.segment.lengths(rig, clip, np.array([time])))
        weights = patch.clip_strength(clip) * weights_of(patch.curve, amplitudes).reshape(-1)
        pairs = zip(self.targets, weights, strict=True)
        return [(target.shape, float(weight)) for target, weight in pairs if target is not None and weight]

    @classmethod
    def observe(cls, effects: Sequence[Self], rig: Rig, motion: Motion, times: Floats, known: Sequence[Any]) -> Any:
        """The activity of each tool; joints of all anchors are posed once."""
        patches = [each.carried.patch for each in effects]
        return further_activities(patches, rig, motion.clip, times, known=known, known_at=motion.times)

    def _path(self) -> Floats:
        """(rows, shapes) weights of the targets over all shortenings, with the strengths of all clips."""
        patch = self.carried.patch
        table, strength = self.shape_weights(weight_path(patch.curve)), patch.shape_strength
        factors = [1.0, *(each / strength for each in patch.tool.clips.values())] if strength else [1.0]
        return np.concatenate([factor * table for factor in factors])

    def _remixed(self, remixed: Remixed | None) -> "WrinkleEffect":
        """The tool with other shapes; itself if there are none."""
        if remixed is None:
            return self
        shapes, mixed = remixed
        return replace(self, targets=named_targets(self.identifier, shapes), remix=mixed)

    def lowered(
        self, plan: MeshPlan, carried: CarriedPatch, motions: Sequence[Motion], weights: Sequence[Floats]
    ) -> "WrinkleEffect":
        """The same tool, and the same (frames, shapes) weights in all clips, with the shapes of another height."""
        if self.carried.ring is not None and carried.ring is not None:
            # A frame's displacement is in proportion to the factor of its vertex, so each shape is, too.
            before, after = self.carried.ring.kept, carried.ring.kept
            factors = np.divide(after, before, out=np.zeros_like(after), where=before != 0.0)
            deltas = np.zeros((len(self.targets), len(factors), 3))
            for number, target in enumerate(self.targets):
                if target is not None:
                    rows = np.searchsorted(carried.vertices, target.shape.vertices)
                    deltas[number, rows] = factors[rows, None] * target.shape.deltas
            projected = projected_shapes(plan, carried.vertices, deltas, motions, weights)
            return replace(self, targets=named_targets(self.identifier, projected), carried=carried)
        shapes = shapes_of(carried, plan.fine, rising(carried.patch, plan.rig, plan.rest) if plan.has_normals else [])
        return replace(self, targets=named_targets(self.identifier, shapes), carried=carried)

    def with_unit_weights(self, sampled: Sequence[Floats]) -> "WrinkleEffect":
        """The same motion with weights in [0, 1]: shapes are scaled, and split if their weights may be negative."""
        path = self._path() if self.on_skin else np.concatenate([np.zeros((0, len(self.targets))), *sampled])
        return self._remixed(unit_weights(self.targets, path))

    def with_fewest_targets(self, plan: MeshPlan, tolerance: float, *, at_once: bool) -> tuple["WrinkleEffect", float]:
        """The fewest targets for the whole range of shortenings; among equals at once, the exact ones are first."""
        if not self.on_skin:
            return self, 0.0
        greatest = self.carried.patch.curve.greatest_amplitudes
        reduced = fewest(self.targets, self._path(), greatest.shape[1], tolerance)
        fewer = (self, 0.0) if reduced is None else (self._remixed(reduced[0]), reduced[1])
        if not at_once:
            return fewer
        turned = self._remixed(in_turn(self.targets, greatest, _LEAST_SHARE * tolerance / plan.tallest))
        return min([(self, 0.0), (turned, 0.0), fewer], key=lambda choice: choice[0].most_at_once)

    @property
    def most_at_once(self) -> int:
        """The greatest number of active targets over all shortenings; all of them, if vertices are projected."""
        if not self.on_skin:
            return len(self.target_names)
        shown: Bools = self.written(self.shape_weights(weight_path(self.carried.patch.curve))) != 0
        return int((shown[:-1] | shown[1:]).sum(axis=1).max())

    def turns(self, rig: Rig, clip: Clip, keys: Floats, weights: Floats) -> Floats:
        """Times between keys when one group of bumps is full and the next begins."""
        if self.remix is None or not self.remix.least > 0:
            return np.zeros(0)
        groups, modes = self.carried.patch.curve.greatest_amplitudes.shape

        def weights_at(times: Floats) -> Floats:
            return self.shape_weights(self._weights(rig, clip, times))

        return turns((groups, modes), weights_at, keys, weights)

    def exact_shapes(self, vertices: Ints) -> Iterator[SparseDeltas]:
        """The displacements of each mode of each group of bumps at amplitude 1; none if vertices are projected."""
        if self.on_skin:
            rows, numbers = matches(vertices, self.carried.vertices)
            for heights in self.carried.shapes(numbers).reshape(-1, len(numbers)):
                yield SparseDeltas(rows, heights[:, None] * self.carried.directions[numbers])

    def exact_weights(self, motion: Motion, _sampled: Floats, times: Floats, state: Activity) -> Floats:
        """(times, groups · modes) amplitudes with the strength of the clip."""
        if not self.on_skin:
            return np.zeros((len(times), 0))
        return np.asarray(self.carried.patch.clip_strength(motion.clip) * state.amplitudes.reshape(len(times), -1))

    def moved_in_frames(
        self, plan: MeshPlan, clip: Clip, times: Floats, chosen: Ints, state: Activity
    ) -> tuple[Ints, Callable[[slice], Floats]] | None:
        """The vertices that are projected in each frame, and their displacements."""
        if self.on_skin:
            return None
        at, amplitudes = times[chosen], state.amplitudes[chosen]

        def moved(part: slice) -> Floats:
            return displacements(self.carried, plan.fine, plan.rig, clip, at[part], amplitudes[part])

        return self.carried.vertices, moved

    def raised(self, _times: Floats, state: Activity) -> Bools:
        """(times,) True where a bump is raised."""
        return np.asarray(state.amplitudes.any(axis=(1, 2)))

    def telling(self, _exact: Floats, state: Activity) -> set[int]:
        """The times when the bumps are tallest, the segment is shortest, and the track bends most."""
        sizes = np.abs(state.amplitudes)
        tall = np.einsum("fgm->f", sizes)
        # The straight line between the neighbours misses most here.
        bend = np.abs(tall[2:] - 2 * tall[1:-1] + tall[:-2])
        tallest = int(np.argmax(sizes)) // sizes[0].size
        bends = (1 + np.argsort(-bend, kind="stable")[:_BENDS]).tolist()
        return {tallest, int(np.argmax(state.shortenings)), *bends}

    def weight_error(self, played: Floats, _exact: Floats, state: Activity, clip: Clip) -> float:
        """Largest error of an amplitude; 0 if vertices are projected, as weights alone do not give heights then."""
        if not self.on_skin:
            return 0.0
        patch, shown = self.carried.patch, self.columns
        if self.remix is not None:
            # An engine's limits asked for other shapes: these are their parts of the curve's shapes.
            share = self.remix.unmix[shown]
            shown = np.flatnonzero(share.any(axis=0))
            played = played @ share[:, shown]
        greatest, wanted = patch.curve.greatest_amplitudes.reshape(-1), state.amplitudes.reshape(len(played), -1)
        strength, worst = patch.clip_strength(clip), 0.0
        for column, number in zip(played.T, shown, strict=True):
            error = column * greatest[number] - strength * wanted[:, number]
            worst = max(worst, float(np.abs(error).max(initial=0.0)) * abs(patch.shape_strength))
        return worst

    def describe(self, plan: MeshPlan) -> Json:
        """The tool's entry in the report."""
        return report.describe_tool(plan, self.carried, self.number, self.target_names)

    def describe_clip(self, motion: Motion, state: Activity) -> Json:
        """The tool's entry in a clip, frame by frame."""
        return report.describe_activity(self.carried, state, motion.clip)

    def warnings(self, plan: MeshPlan, motions: Sequence[tuple[Motion, Any, Floats]], *, up: str) -> list[str]:
        """Warnings about the tool's place and activity."""
        clips = [ClipActivity(motion.clip, motion.times, state) for motion, state, _ in motions]
        return tool_warnings(plan, self.carried, clips, up=up)


def tool_drive(patch: Patch, targets: tuple[str, ...], response: Table | LeaningTable | CurveTable) -> Drive:
    """A drive by a tool's segment, with its filter and its strengths."""
    strengths = {clip: each / patch.shape_strength for clip, each in patch.tool.clips.items()}
    others = patch.clip_strength(None)
    return Drive(patch.tool.name, patch.segment, targets, response, patch.tool.lag, strengths, others)
