"""Muscles on a mesh: attached to bones, carried by the refined surface, with the effect and the words of each."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.character.pose import morph_weights
from wrinklecli.drive.table import split
from wrinklecli.effects.body import BodyLayer, BodyWords, body_effect, body_shapes, moves_at_rest
from wrinklecli.effects.effect import Effect, EffectKind, MeshPlan, Seen
from wrinklecli.effects.muscle.attach import AttachedMuscle, attach_muscle
from wrinklecli.effects.muscle.volume import SHORTEST
from wrinklecli.errors import BakeError, listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant
from wrinklecli.numeric.intersections import Crossings
from wrinklecli.surface.bones import BoneLines
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Muscle
from wrinklecli.tools.records import ToolsFile, in_words

# Thicknesses of a belly that travels at which its normals are right.
_FIT_KNOTS = 12
# The section of the effects that keep skin apart.
_CONTACT = "folds"
# Part of a muscle's greatest bulge below which nobody sees that it passes through other skin.
_LEAST_DEEP = 0.1
# Decimal places of a thickness gained: those that follow are rounding errors of a muscle at rest.
_DIGITS = 12
# Change of a muscle's length over that at rest below which it does nothing that one would see.
_LEAST_CHANGE = 1e-3
# Distance from the insertion up to which a bulge may meet other skin, over the muscle's length: a forearm folds onto
# the upper arm, which is about as long.
_REACH = 1.5


def _fullest(plan: MeshPlan, deltas: Floats, weights: Floats) -> tuple[float, float]:
    """The largest move of the skin at rest, and the volume that it gains, by (targets, fine vertices, 3) deltas."""
    vertices, moves = moves_at_rest(plan.fine.blended, deltas)
    places = plan.fine.rest_positions
    moved = places.copy()
    total = np.tensordot(weights, moves, axes=1)
    moved[vertices] += total
    triangles = plan.fine.triangles[plan.fine.around.faces_of(vertices)]
    # About a point nearby: open meshes have a volume only as far as they move.
    middle = places[vertices].mean(axis=0)
    sums = [np.linalg.det(each[triangles] - middle).sum() / 6.0 for each in (moved, places)]
    return float(np.sqrt((total**2).sum(axis=1)).max(initial=0.0)), float(sums[0] - sums[1])


@dataclass(frozen=True, slots=True)
class MuscleWords(BodyWords[AttachedMuscle]):
    """A muscle's words about itself.

    Attributes:
        height: The largest move of the skin at the greatest thickness, scene units.
        gained: Volume that the skin gains at the greatest thickness, cubic scene units.
    """

    height: float
    gained: float
    remedy: ClassVar[str] = "`travel: false`"

    def values(self, names: Sequence[str]) -> Json:
        """Its bones and its measures; volumes are cubic scene units."""
        attached = self.attached
        return {
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
        }

    def describe_clip(self, seen: Seen) -> Json | None:
        """The muscle's entry in a clip: lengths over that at rest, and what the skin does; None while hidden."""
        state = seen.reading
        if not state.active.any():
            return None
        lengths = state.distances[state.active]
        response = self.attached.response
        gains = np.round(response.thicknesses(lengths) - 1.0, _DIGITS) + 0.0
        # The height and the volume of one more thickness.
        bulge, volumes = (gains * (each / float(response.gains[-1])) for each in (self.height, self.gained))
        return {
            "name": self.name,
            "length": [significant(float(end / response.rest_length)) for end in (lengths.min(), lengths.max())],
            "bulge": [significant(float(end)) for end in (bulge.min(), bulge.max())],
            "volume_gained": significant(float(volumes.max())),
        }

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], up: str) -> list[str]:
        """Warnings about a muscle that nothing moves, or that is asked to shorten further than it can."""
        attached, response, warnings = self.attached, self.attached.response, []
        if attached.idle:
            place = in_words(attached.belly.insertion.tolist(), up)
            bone = plan.rig.names[attached.bones[0]]
            warnings.append(
                f"{self.name}: both ends are on {bone!r}, so no joint shortens it; its insertion"
                f" {place} belongs on the bone that it moves, for instance by {{joint: NAME, offset: …}}"
            )
            return warnings
        least, at, clip = np.inf, 0.0, ""
        moved = False
        for motion, state, _ in clips:
            lengths = np.where(state.active, state.distances, response.rest_length)
            moved |= bool((np.abs(lengths / response.rest_length - 1.0) > _LEAST_CHANGE).any())
            # Ends that come too near are a fault of the muscle's place; what an activation adds is not.
            lengths = np.where(state.active, state.ends.distances, response.rest_length)
            if lengths.min() < least:
                least, at, clip = float(lengths.min()), float(motion.times[int(np.argmin(lengths))]), motion.clip.name
        if clips and not moved:
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
        warnings += self._meeting(plan, clips)
        return warnings

    def _meeting(self, plan: MeshPlan, clips: Sequence[Seen]) -> list[str]:
        """A warning about the clip in which the muscle is thickest, if it passes through other skin there."""
        if any(layer.section == _CONTACT for layer in plan.layers):
            return []
        peaks = [
            (float(np.where(state.active, state.distances, np.inf).min()), number)
            for number, (_, state, _) in enumerate(clips)
        ]
        length, number = min(peaks, default=(np.inf, 0))
        if not length < self.attached.response.rest_length:
            return []
        motion, state, _ = clips[number]
        time = float(motion.times[int(np.argmin(np.where(state.active, state.distances, np.inf)))])
        deep = _passes_through(plan, self.attached, self.deltas, motion.clip, time)
        if deep <= _LEAST_DEEP * self.height:
            return []
        return [
            f"{self.name}: passes through other skin in {motion.clip.name!r} at {time:.3g} s, which it lifts by up to"
            f" {deep:.3g} there; a tool over the joint with `contact: resolve` keeps both apart, or a lower thickness"
        ]


def _passes_through(plan: MeshPlan, attached: AttachedMuscle, deltas: Floats, clip: Clip, time: float) -> float:
    """The farthest that a muscle moves skin that passes through other skin at a time, and does not without the muscle.

    Args:
        plan: The mesh.
        attached: The muscle.
        deltas: (targets, fine vertices, 3) its displacements at weight 1, bind space.
        clip: A clip.
        time: Seconds.

    Returns:
        Scene units; 0 if none does.
    """
    fine, rig, belly = plan.fine, plan.rig, attached.belly
    near = ((fine.rest_positions - belly.insertion) ** 2).sum(axis=1) < (_REACH * belly.span) ** 2
    chosen = np.flatnonzero(near)
    moved = np.any(deltas[:, chosen], axis=(0, 2))
    mesh, now = fine.skinned(rig, chosen), np.array([time])
    shown = morph_weights(rig, clip, now)
    relaxed = shown.copy()
    relaxed[:, [rig.morph_names.index(name) for name in attached.drive.targets]] = 0.0
    flexed, flat = (mesh.posed(clip, now, weights=each).positions[0] for each in (shown, relaxed))
    crossings = Crossings.of(fine.rest_positions[chosen], mesh.triangles)
    # Most muscles meet nothing, so that the skin without them need not be looked at.
    after = crossings.pairs_at(flexed, moved)
    corners = crossings.corners_of(after - crossings.pairs_at(flat, moved) if after else ())
    return float(np.sqrt(((flexed - flat)[corners] ** 2).sum(axis=-1)).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class MuscleLayer(BodyLayer[AttachedMuscle]):
    """The muscles of a mesh."""

    section: ClassVar[str] = Muscle.section

    @property
    def sampled_numbers(self) -> int:
        """Weights, a distance and a rest length of each muscle."""
        return sum(len(each) + 2 for each in self.deltas)

    def words(self, plan: MeshPlan, attached: AttachedMuscle, deltas: Floats) -> MuscleWords:
        """The words of one of them about itself."""
        response = attached.response
        return MuscleWords(attached, deltas, *_fullest(plan, deltas, split(response.mix[-1:], response.lows)[0]))

    def effect(self, plan: MeshPlan, attached: AttachedMuscle, deltas: Floats) -> Effect:
        """The effect of one muscle.

        Parts of its travel with few vertices above them may move none.
        """
        response = attached.response
        flexed = np.linspace(len(response.mix) - 1, 0, min(_FIT_KNOTS, len(response.mix))).astype(int)
        rows = split(np.vstack([response.mix[flexed], response.thinnest]), response.lows)
        shapes = body_shapes(plan, deltas, rows)
        moving = np.array([each is not None for each in shapes])
        # A target and the further one that takes its place below 0 go together.
        negative, count = np.flatnonzero(response.lows), len(response.lows)
        moving[negative] &= moving[count:]
        moving[count:] = moving[negative]
        shapes = [shape if moves else None for shape, moves in zip(shapes, moving, strict=True)]
        found = body_effect(attached, shapes, self.words(plan, attached, deltas))
        return replace(found, exact=response.of_targets(moving[:count]))

    def warnings(self, _plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """A line if there is no clip; with clips, each muscle speaks for itself."""
        names = ", ".join(each.tool.name for each in self.attached if not each.idle)
        if clips or not names:
            return []
        return [f"{names}: there is no clip that moves the body: muscles swell only in a player with a driver"]


class MuscleKind(EffectKind[Muscle, AttachedMuscle]):
    """Muscles."""

    def attach(self, tools: Sequence[Muscle], ground: Ground, settings: ToolsFile) -> Sequence[AttachedMuscle]:
        """Attach the muscles to the rig and the surface at rest.

        Raises:
            WrinkleError: Muscles do not fit, a line for each.
        """
        names = MeshNames.of(ground.document)
        muscles = [each for each in settings.effects if isinstance(each, Muscle)]
        swelling = {ground.rig.names[node] for tool in muscles for node in names.called(tool.node or "")}
        bones = BoneLines.of(ground)
        return BakeError.every(lambda muscle: attach_muscle(muscle, ground, bones, swelling), tools)

    def plan(self, plan: MeshPlan, _ground: Ground, attached: Sequence[tuple[int, AttachedMuscle]]) -> MuscleLayer:
        """Let the refined surface carry the muscles."""
        return MuscleLayer.of(plan, attached)

    def lines(self, entry: Json) -> list[str]:
        """The lines of a muscle, and a table of its clips."""
        table = [
            (
                each["name"],
                *(f"{100 * end:.3g}" for end in each["length"]),
                f"{each['bulge'][1]:.3g}",
                each["volume_gained"],
            )
            for each in entry["clips"]
        ]
        width = max((len(name) for name, *_ in table), default=0)
        return [
            f"ends     {entry['origin']} to {entry['insertion']}, along {entry['bone']}",
            f"length   {entry['length']:.4g} at rest, of which tendons {entry['tendons']:.4g}",
            f"belly    {entry['thickness']:.4g} thick, {entry['width']:.4g} wide,"
            f" {entry['depth']:.4g} from the bone to the skin",
            f"mesh     {entry['moved_vertices']} vertices move, by at most {entry['height_limit']:.3g}",
            *(
                f"{name:{width}}  {low} to {high} % long, bulges by up to {bulge}, skin gains {volume:.3g} of volume"
                for name, low, high, bulge, volume in table
            ),
        ]


KIND = MuscleKind()
