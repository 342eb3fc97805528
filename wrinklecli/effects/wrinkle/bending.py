"""Finds the motion that a tool's own wrinkles follow, and poses of it, whatever clips there are.

Results that follow from mesh and tools alone must not depend on clips. So the joint that carries one of the tool's ends
and not the other turns about the patch's v axis, along which wrinkles run, or a morph target goes from 0 to 1. Some of
its poses are those in which wrinkles rise, another that in which a morph target brings the ends together. Not in the
paper.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.motion import MOST_TURN, motion_clip, raising, turning
from wrinklecli.character.pose import Pose, node_matrices, pose_at
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.effects.wrinkle.lookup import looked_up, weight_path, weights_of
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, cross, unit, unit_quaternions
from wrinklecli.surface.anchor import Anchor
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

MOMENTS = 65
"""Sampled moments of a motion: a joint turns by 2.3° between two."""
# A joint hardly bends the skin between two ends if the fractions of their weights that it carries differ by less.
_LEAST_CARRIED = 0.1
# Turn of a joint that a morph target must outdo to count as what drives a tool, radians: 30°, as far as a jaw opens.
_JAW_TURN = np.radians(30.0)
# How far the morph target that drives a tool is raised where the tool is laid, as a fraction. Wrinkles are seen from
# half raised to fully raised. This is the middle: crests that are straight there bend least before and after.
_RAISED = 0.75
# A morph target that brings a tool's ends together by less, as a fraction, does not drive it.
_LEAST_RAISED = 0.01
# A twin that does less than this part of what the target does bends no crest that one would see.
_LEAST_TWIN = 0.05
# Triangles of a mesh that tell how much a morph target makes all of it smaller.
_SAMPLED = 2000
# Fraction of a mesh's edges that a morph target makes shorter if it makes all of the mesh smaller.
_NEARLY_EVERY = 0.9
# A morph target that brings a tool's ends together by less than this, over what nearly every edge loses, is one.
_OF_SHRINKING = 1.5
# Wrinkles this near to the tallest, as a fraction, are tall enough: full bumps stay full while a limb folds on.
_TALLEST = 0.97
# Fractions of that height on the way to it, at which wrinkles are looked at too.
_RISING = (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, slots=True)
class Risen:
    """A moment at which wrinkles have risen.

    Attributes:
        weights: (groups, modes) amplitudes over the greatest.
    """

    pose: Pose
    weights: Floats


def rising(patch: Patch, rig: Rig, rest: Rest) -> list[Risen]:
    """The moments at which a tool's own motion first raises its wrinkles to quarters of their greatest height.

    The last is that at which they are about as tall as they become. A tool that has no such motion, or whose rest
    length is keyed by hand, rises in the rest pose.
    """
    times, curve, raising_it = np.linspace(0.0, 1.0, MOMENTS), patch.curve, None
    weights = weight_path(curve)
    heights, tallest = curve.heights(weights * curve.greatest_amplitudes).sum(axis=1), 0.0
    keyed = isinstance(patch.tool.rest_length, RestLengthKeys)
    for motion in () if keyed else own_motions(patch, rig):
        amplitudes = looked_up(curve, patch.segment.lengths(rig, motion, times))
        reached = curve.heights(amplitudes).sum(axis=1)
        # Of several equal motions the first counts.
        if reached.max() * _TALLEST > tallest:
            tallest = float(reached.max())
            raising_it, weights, heights = motion, weights_of(curve, amplitudes), reached
    rows = [int(np.argmax(heights >= share * _TALLEST * heights.max())) for share in _RISING]
    return [
        Risen(rest.pose if raising_it is None else pose_at(rig, raising_it, float(times[row])), weights[row])
        for row in rows
    ]


def raised_weights(patch: Patch, rig: Rig, rest: Rest, surface: Surface) -> Floats | None:
    """(morph targets,) weights of the pose in which the morph target that drives a tool is raised; None if none does.

    It is raised by three quarters. The target that `rest_length` names drives the tool, or else the one that brings its
    ends together most, if it does so more than a joint that turns by 30°. Its twin on the other side of the body, by
    name, is raised in proportion to what the twin does: a tool between both brows is laid where both are raised.
    """
    wanted = patch.tool.rest_length
    if isinstance(wanted, RestLengthMorph):
        return _raised(rest, {rig.morph_names.index(wanted.morph): 1.0})
    before, shares = _approaches(patch, rig)
    least = max(_LEAST_RAISED, _jaw_share(patch, rig, before)) if shares.any() else np.inf
    # A target that makes all of the mesh smaller, such as a child's head, raises nothing.
    likely = (int(number) for number in np.argsort(-shares, kind="stable") if shares[number] >= least)
    best = next((number for number in likely if shares[number] > _OF_SHRINKING * _shrinking(surface, number)), None)
    if best is None:
        return None
    name = exchange_sides(rig.morph_names[best])
    twin = rig.morph_names.index(name) if name in rig.morph_names else best
    share = float(shares[twin] / shares[best])
    return _raised(rest, {best: 1.0} | ({twin: share} if share > _LEAST_TWIN else {}))


def _raised(rest: Rest, shares: Mapping[int, float]) -> Floats:
    """(morph targets,) weights at rest, with some targets raised by fractions of `_RAISED` towards 1."""
    weights = rest.morph_weights.copy()
    for number, share in shares.items():
        weights[number] += _RAISED * share * (1.0 - weights[number])
    return weights


def _approaches(patch: Patch, rig: Rig) -> tuple[float, Floats]:
    """A tool's length in the stored pose, and (morph targets,) fractions by which each target brings its ends together.

    They are 0 where the stored pose hides the character, or where the ends move apart.
    """
    shares = np.zeros(len(rig.morph_names))
    moving = [number for number in range(len(shares)) if _moves(patch, number)]
    if not moving:
        return patch.span, shares
    times = np.arange(1.0 + len(moving))
    values = np.tile(rig.morph_weights, (len(times), 1))
    values[1 + np.arange(len(moving)), moving] = 1.0
    each = Clip(-1, "", (Channel(0, rig.node, "weights", times, values, "LINEAR"),), 0.0, float(times[-1]))
    before, *after = patch.segment.lengths(rig, each, times).distances
    if 0.0 < before < np.inf:
        shares[moving] = np.maximum(1.0 - np.array(after) / before, 0.0)
    return float(before), shares


def _moves(patch: Patch, number: int) -> bool:
    """True if a morph target moves an end of a tool, or a point of its path."""
    return any(anchor.carried.points[1 + number].any() for anchor in patch.anchors)


def _shrinking(surface: Surface, number: int) -> float:
    """The part of its length that nearly every edge of a mesh loses to a morph target; some lose more."""
    sampled = surface.triangles[:: -(-len(surface.triangles) // _SAMPLED)]
    lengths = []
    for positions in (surface.positions, surface.positions + surface.morph_deltas[number]):
        corners = positions[sampled]
        lengths.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).reshape(-1))
    known = lengths[0] > 0
    ratios = np.sort(lengths[1][known] / lengths[0][known])
    return 1.0 - float(ratios[int(_NEARLY_EVERY * len(ratios))]) if len(ratios) else 0.0


def _jaw_share(patch: Patch, rig: Rig, before: float) -> float:
    """The fraction by which a tool's ends approach while the joint between them turns by 30° to the better side."""
    time = np.array([_JAW_TURN / np.radians(MOST_TURN)])
    after = [float(patch.segment.lengths(rig, turn, time).distances[0]) for turn in turns_of(patch, rig)]
    return 1.0 - min(after, default=before) / before


def own_motions(patch: Patch, rig: Rig) -> Iterator[Clip]:
    """Motions of a second that may bring a tool's ends together: its joint turning either way, then morph targets."""
    morphed = patch.tool.rest_length.morph if isinstance(patch.tool.rest_length, RestLengthMorph) else None
    if not morphed:
        yield from turns_of(patch, rig)
    for number, name in enumerate(rig.morph_names):
        if _moves(patch, number) if morphed is None else name == morphed:
            yield motion_clip("", [raising(rig, {number: 1.0})])


def turns_of(patch: Patch, rig: Rig) -> list[Clip]:
    """Motions of a second in which all joints that bend a tool turn by 150° about its v axis, either way; or none."""
    bent = bent_nodes(patch, rig)
    axis = np.stack(cross(patch.along, patch.normal))
    return [motion_clip("", [_turning(rig, node, way) for node in bent]) for way in (axis, -axis) if bent]


def bent_node(patch: Patch, rig: Rig) -> int | None:
    """The joint that bends a tool: the one nearest to its middle of those that carry one end more than the other."""
    return next(iter(bent_nodes(patch, rig)), None)


def bent_nodes(patch: Patch, rig: Rig) -> list[int]:
    """The joints that bend a tool, the nearest to its middle first.

    There are several where limbs share what hangs over them: each thigh bends the middle of a skirt. Joints of one limb
    bend it at one place, so the nearest of them stands for all.
    """
    carried = [carried_by(anchor, rig) for anchor in patch.anchors]
    shares = {
        node: [each.get(node, 0.0) for each in carried]
        for node in sorted({node for each in carried for node in each})
        if "rotation" in rig.locals[node]
    }
    differences = {node: max(each) - min(each) for node, each in shares.items()}
    most = max(differences.values(), default=0.0)
    if most < _LEAST_CARRIED:
        return []
    likely = [node for node, difference in differences.items() if difference > most - _LEAST_CARRIED]
    places = node_matrices(rig, None, np.zeros(1), likely)[0, :, :3, 3]
    middle = sum((anchor.position for anchor in patch.anchors), np.zeros(3)) / len(patch.anchors)
    found: list[int] = []
    for number in np.argsort(np.linalg.norm(places - middle, axis=1), kind="stable"):
        node = likely[int(number)]
        if not any(node in rig.upwards(other) or other in rig.upwards(node) for other in found):
            found.append(node)
    return found


def carried_by(anchor: Anchor, rig: Rig) -> dict[int, float]:
    """The fraction of an anchor's weights that each node carries, directly or through its children."""
    shares: dict[int, float] = {}
    for node, weight in zip(anchor.carried.nodes.tolist(), anchor.carried.weights, strict=True):
        for above in rig.upwards(node):
            shares[above] = shares.get(above, 0.0) + float(weight)
    return shares


def _turning(rig: Rig, node: int, axis: Floats) -> Channel:
    """The channel of a node that turns steadily about a (3,) axis in world space at rest."""
    parent = int(rig.parents[node])
    world = np.eye(4) if parent < 0 else node_matrices(rig, None, np.zeros(1), [parent])[0, 0]
    # The axis in the parent's space that the parent takes to the wanted one.
    local = unit(np.linalg.pinv(world[:3, :3]) @ axis)
    stored = unit_quaternions(rig.locals[node]["rotation"])
    return turning(node, stored, local, np.radians(MOST_TURN), np.linspace(0.0, 1.0, MOMENTS))
