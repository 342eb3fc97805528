"""The effect of one wrinkling tool: its targets, and the drive that sets their weights by its control curve.

A target is a shape: one for each group of bumps that rise together, at its greatest height.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: the paper
displaces each frame's vertices; here a shape in bind space times a weight does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import pose_at
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive, Lowered, Moments, Rows
from wrinklecli.drive.table import TABLE_ERROR, Table
from wrinklecli.effects.effect import Effect, MeshPlan, Remixes, SamplingOptions, Seen, Target, named_targets
from wrinklecli.effects.shapes import Middles, Sample, Shape, make_shapes
from wrinklecli.effects.wrinkle import report
from wrinklecli.effects.wrinkle.activity import Activity, ClipActivity, activity
from wrinklecli.effects.wrinkle.bending import Risen, rising
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.lookup import CurveResponse, weight_path
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.places import Places
from wrinklecli.effects.wrinkle.warnings import tool_warnings
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, interpolated, places_of, renumbered, unit
from wrinklecli.numeric.intersections import edges_of
from wrinklecli.surface.refine import Refinement

if TYPE_CHECKING:
    from wrinklecli.effects.wrinkle.remix import Remixed

SECTION = "tools"
"""The key of extras and report under which wrinkling tools stand."""

# Part of the tolerance below which a weight may be left out, so that its target does not count as active.
_LEAST_SHARE = 0.1
# Part of the error bound for the table, which the default bound gives to `TABLE_ERROR`.
_TABLE_SHARE = 0.05
# Frames, evenly spread, in which normals are to be right where displacements are projected, beside those with the
# greatest weights.
_FIT_FRAMES = 16


def wrinkle_effect(
    plan: MeshPlan, carried: CarriedPatch, region: int, clips: Sequence[Clip], how: SamplingOptions
) -> Effect:
    """The effect of a tool; `region` is the number of its patch among the regions of the refinement.

    Raises:
        BakeError: Its vertices are projected in each frame of the clips, and need too many shapes.
    """
    if carried.ring is not None:
        return _projected(plan, carried, region, clips, how)
    shapes = shapes_of(carried, plan.fine, rising(carried.patch, plan.rig, plan.rest) if plan.has_normals else [])
    columns = np.array([number for number, shape in enumerate(shapes) if shape is not None], np.intp)
    # The greatest error of a weight that is looked up, as a ratio of the greatest weight.
    error = min(TABLE_ERROR, _TABLE_SHARE * plan.max_error / plan.tallest)
    remixes = _Remixes(carried, CurveResponse(carried.patch.curve, columns), error)
    return remixes.effect(named_targets(carried.patch.tool.identifier, shapes), WrinkleWords(carried, region, plan.rig))


def shapes_of(carried: CarriedPatch, fine: Refinement, risen: Sequence[Risen]) -> list[Shape | None]:
    """A shape for each group of bumps and mode of their profile, in the order of the curve's amplitudes.

    A shape that never rises, or that moves no vertex, is None. Normals are fitted in the poses of the moments in which
    wrinkles have `risen`; there are none on a mesh without normals.
    """
    curve = carried.patch.curve
    scaled = carried.shapes * curve.greatest_amplitudes[..., None]
    between = _Between.of(carried, fine) if risen else None
    shapes: list[Shape | None] = []
    for group, heights in enumerate(scaled):
        deltas = heights[..., None] * carried.directions
        shapes += make_shapes(
            fine,
            carried.vertices,
            deltas,
            tallest=np.abs(heights * carried.magnitudes).max(axis=1),
            samples=[Sample(each.weights[group], each.pose) for each in risen],
            middles=between.middles(group, deltas) if between is not None else None,
        )
    return shapes


@dataclass(frozen=True, slots=True)
class _Between:
    """The middles of the edges round a tool's vertices, which have their own places on its patch.

    Attributes:
        edges: (edges,) numbers of the edges, as `Middles` has them.
        ends: (edges, 2) which of the tool's vertices the ends are; the number of vertices for all others.
        heights: (groups, modes, edges) heights of the curve at its greatest amplitudes.
        directions: (edges, 3) bind displacement for a curve height of 1.
    """

    edges: Ints
    ends: Ints
    heights: Floats
    directions: Floats

    @classmethod
    def of(cls, carried: CarriedPatch, fine: Refinement) -> "_Between":
        """Place the middles. What features, masks and sharp folds leave of their height is the mean of the ends'."""
        patch = carried.patch
        edges = edges_of(fine.triangles[fine.around.faces_of(carried.vertices)])
        used, ends = renumbered(edges)
        own = np.searchsorted(used, carried.vertices)
        positions, facing = fine.posed_at(patch.pose, used)

        def placed(positions: Floats, facing: Floats) -> Places:
            u, v = patch.coordinates(positions)
            return patch.places(u, v, patch.cosines(u, facing))

        whole = placed(positions, facing).factors
        kept = np.zeros(len(used))
        kept[own] = np.divide(carried.magnitudes, whole[own], out=np.zeros(len(own)), where=whole[own] != 0.0)
        # Ends beside the patch do not say what is left on it.
        one, other = ends.T
        left = (kept[one] + kept[other]) / np.maximum(1 * (whole != 0.0)[one] + (whole != 0.0)[other], 1)

        def halfway(values: Floats) -> Floats:
            return np.asarray((values[one] + values[other]) / 2.0)

        middles = placed(halfway(positions), unit(halfway(facing))).times(left)
        numbers = places_of(own, len(used), len(own))
        return cls(
            edges=Middles.numbers_of(edges, fine),
            ends=numbers[ends],
            heights=middles.shapes(patch.curve) * patch.curve.greatest_amplitudes[..., None],
            directions=halfway(fine.raising_at(used)) * middles.factors[:, None],
        )

    def middles(self, group: int, deltas: Floats) -> Middles:
        """The middles of a group's shapes, from the (modes, vertices, 3) deltas of the tool's vertices."""
        padded = np.pad(deltas, ((0, 0), (0, 1), (0, 0)))
        straight = (padded[:, self.ends[:, 0]] + padded[:, self.ends[:, 1]]) / 2.0
        return Middles(self.edges, self.heights[group, ..., None] * self.directions - straight)


def _projected(
    plan: MeshPlan, carried: CarriedPatch, region: int, clips: Sequence[Clip], how: SamplingOptions
) -> Effect:
    """The effect of a tool whose vertices are projected in each frame, with normals for some of the frames."""
    from wrinklecli.effects.wrinkle.projected import project  # few tools ask for it

    found = project(plan, carried, clips, how)
    even = np.linspace(0, len(found.moments) - 1, _FIT_FRAMES).astype(int)
    rows: Sequence[int] = []
    if plan.has_normals and len(found.moments):
        rows = distinct_values(np.concatenate([even, np.argmax(found.together, axis=0)])).tolist()
    shapes = make_shapes(
        plan.fine,
        carried.vertices,
        found.deltas,
        tallest=plan.scale * np.sqrt(np.sum(found.deltas**2, axis=2)).max(axis=1, initial=0.0),
        samples=[Sample(found.together[row], pose_at(plan.rig, *found.moments[row])) for row in rows],
    )
    columns = [number for number, shape in enumerate(shapes) if shape is not None]
    own = {name: Rows(each.times, each.weights[:, columns]) for name, each in found.rows.items()}
    targets = named_targets(carried.patch.tool.identifier, shapes)
    nothing = Table("shortenings", np.zeros(1), np.zeros((1, len(targets))))

    def moved(clip: Clip, times: Floats) -> Floats:
        return displacements(carried, plan.fine, plan.rig, clip, times)

    return Effect(
        name=carried.patch.tool.name,
        section=SECTION,
        identifier=carried.patch.tool.identifier,
        targets=targets,
        drive=Drive(carried.patch.tool.name, None, tuple(each.name for each in targets), nothing, rows=own),
        words=WrinkleWords(carried, region, plan.rig),
        error=found.error,
        remixes=_RowRemixes(),
        projected=(carried.vertices, moved),
    )


@dataclass(frozen=True, slots=True)
class WrinkleWords:
    """A tool's words about itself.

    Attributes:
        carried: The tool on the refined surface.
        region: The number of the tool's patch among the regions of the refinement.
        rig: The rig of the mesh.
    """

    carried: CarriedPatch
    region: int
    rig: Rig
    remedy: str = ""
    left_out: str | None = None

    def summary(self, _effects: int, _targets: int) -> str:
        """Nothing: the summary begins with the targets of the tools."""
        return ""

    def describe(self, plan: MeshPlan, targets: tuple[str, ...]) -> Json:
        """The tool's entry in the report."""
        return report.describe_tool(plan, self.carried, self.region, targets)

    def describe_clip(self, seen: Seen) -> Json:
        """The tool's entry in a clip, frame by frame."""
        return report.describe_activity(self.carried, self._activity(seen), seen.motion.clip)

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], up: str) -> list[str]:
        """Warnings about the tool's place and activity."""
        every = [ClipActivity(each.motion.clip, each.motion.times, self._activity(each)) for each in clips]
        return tool_warnings(plan, self.carried, every, up=up)

    def _activity(self, seen: Seen) -> Activity:
        patch, motion = self.carried.patch, seen.motion
        reading = seen.reading.reading if isinstance(seen.reading, Lowered) else seen.reading
        if isinstance(reading, Moments):
            return activity(patch, self.rig, motion.clip, motion.times)
        return Activity.of(patch, reading)


def lowered_in_clips(effect: Effect, heights: Mapping[str, Rows]) -> Effect:
    """The effect of a tool whose wrinkles keep parts of their height over the time of some clips, by their names."""
    assert isinstance(effect.drive, Drive)
    effect = replace(effect, drive=replace(effect.drive, heights=heights))
    if isinstance(effect.remixes, _Remixes):
        return replace(effect, remixes=replace(effect.remixes, heights=heights))
    if effect.projected is None:
        return effect
    vertices, moved = effect.projected

    def lower(clip: Clip, times: Floats) -> Floats:
        found, rows = moved(clip, times), heights.get(clip.name)
        return found if rows is None else found * interpolated(times, rows.times, rows.weights)[:, :, None]

    return replace(effect, projected=(vertices, lower))


def tool_drive(patch: Patch, targets: tuple[str, ...], response: Table) -> Drive:
    """A drive by a tool's segment, with its filter and its strengths."""
    strengths = {clip: each / patch.shape_strength for clip, each in patch.tool.clips.items()}
    others = patch.clip_strength(None)
    return Drive(
        patch.tool.name, patch.segment, targets, response, lag=patch.tool.lag, strengths=strengths, strength=others
    )


@dataclass(frozen=True, slots=True)
class _Remixes(Remixes):
    """The targets of a tool on the skin, and others that play the same motion.

    Attributes:
        carried: The tool on the refined surface.
        exact: The weights of the targets.
        table_error: Greatest error of a weight that is looked up, as a ratio of the greatest weight.
        heights: As the drive has them.
    """

    carried: CarriedPatch
    exact: CurveResponse
    table_error: float
    heights: Mapping[str, Rows] = field(default_factory=dict)

    def effect(
        self, targets: tuple[Target, ...], words: WrinkleWords, error: float = 0.0, table: Table | None = None
    ) -> Effect:
        """The effect with such targets, whose shapes are off by an error, scene units, and its table."""
        patch, names = self.carried.patch, tuple(each.name for each in targets)
        response = self.exact.table(self.table_error) if table is None else table
        return Effect(
            name=patch.tool.name,
            section=SECTION,
            identifier=patch.tool.identifier,
            targets=targets,
            drive=replace(tool_drive(patch, names, response), heights=self.heights),
            words=words,
            exact=self.exact,
            error=error,
            remixes=self,
        )

    def _remixed(
        self, effect: Effect, remixed: "Remixed | None", error: float = 0.0, table: Table | None = None
    ) -> Effect:
        """The effect with other shapes; itself if there are none."""
        if remixed is None:
            return effect
        shapes, mixed = remixed
        assert isinstance(effect.words, WrinkleWords)
        return replace(self, exact=replace(self.exact, mix=mixed)).effect(
            named_targets(effect.identifier, shapes), effect.words, effect.error + error, table
        )

    def _path(self) -> Floats:
        """(rows, shapes) weights of the targets over all shortenings, with the strengths of all clips."""
        patch = self.carried.patch
        table, strength = self.exact.mixed(weight_path(patch.curve)), patch.shape_strength
        factors = [1.0, *(each / strength for each in patch.tool.clips.values())] if strength else [1.0]
        return np.concatenate([factor * table for factor in factors])

    def with_unit_weights(self, effect: Effect) -> Effect:
        """The same motion with weights in [0, 1]: shapes are scaled, and split if their weights may be negative."""
        from wrinklecli.effects.wrinkle.remix import unit_weights  # few bakes name an engine

        found = unit_weights(effect.targets, self._path())
        if found is None:
            return effect
        remixed, lows = found
        assert isinstance(effect.drive, Drive)
        assert isinstance(effect.drive.response, Table)
        # The same rows play the same motion exactly.
        made = self._remixed(effect, remixed, table=effect.drive.response.mapped(lambda own: own @ remixed[1]))
        assert isinstance(made.drive, Drive)
        return replace(made, drive=replace(made.drive, lows=lows if lows.any() else None))

    def with_fewest_targets(self, effect: Effect, plan: MeshPlan, tolerance: float, *, at_once: bool) -> Effect:
        """The fewest targets for the whole range of shortenings; among equals at once, the exact ones are first."""
        from wrinklecli.effects.wrinkle.remix import fewest, in_turn

        greatest, columns = self.carried.patch.curve.greatest_amplitudes, self.exact.columns
        reduced = fewest(effect.targets, self._path(), columns // greatest.shape[1], tolerance)
        fewer = effect if reduced is None else self._remixed(effect, *reduced)
        if not at_once:
            return fewer
        turned = self._remixed(effect, in_turn(effect.targets, columns, greatest))
        if turned is not effect:
            turned = replace(turned, least=_LEAST_SHARE * tolerance / plan.tallest)
        return min([effect, turned, fewer], key=lambda choice: choice.most_at_once)


@dataclass(frozen=True, slots=True)
class _RowRemixes(Remixes):
    """Other targets of a tool that is projected in each frame, of which it has the fewest for its clips already."""

    def with_unit_weights(self, effect: Effect) -> Effect:
        """The same motion with weights in [0, 1], from those of all clips."""
        from wrinklecli.effects.wrinkle.remix import unit_weights

        assert isinstance(effect.drive, Drive)
        rows = effect.drive.rows
        path = np.concatenate([np.zeros((0, len(effect.targets))), *(each.weights for each in rows.values())])
        found = unit_weights(effect.targets, path)
        if found is None:
            return effect
        (shapes, mixed), lows = found
        targets = named_targets(effect.identifier, shapes)
        drive = replace(
            effect.drive,
            targets=tuple(each.name for each in targets),
            response=Table("shortenings", np.zeros(1), np.zeros((1, len(targets)))),
            rows={name: Rows(each.times, each.weights @ mixed) for name, each in rows.items()},
            lows=lows,
        )
        return replace(effect, targets=targets, drive=drive)
