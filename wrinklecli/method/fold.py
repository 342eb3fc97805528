"""Folds: the part of a surface round a joint that bends between a tool's ends, and how it lies, wrinkles and all.

Not in the paper, which names contact as a goal. A fold is what module `contact` solves at once: the tools over one
joint, with the surface round it that may touch.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip, sample
from wrinklecli.character.motion import motion_clip, quaternion_product, turning
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, node_matrices, transform
from wrinklecli.character.rig import Rig
from wrinklecli.method.activity import lengths_over_time
from wrinklecli.method.bending import bent_node
from wrinklecli.method.carry import CarriedPatch, displacements
from wrinklecli.method.patch import Patch
from wrinklecli.method.refine import Refinement
from wrinklecli.method.rest import Rest
from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, distinct_values, unit, unit_quaternions
from wrinklecli.numeric.crossings import Crossings

# How far the surface round a joint may touch, in radii of the limb, and at least in lengths of the segment.
_REACH_RADII, _REACH_SPANS = 2.6, 0.75
# Radius of the limb at least, in lengths of the segment: a joint may lie in the skin.
_LEAST_RADIUS = 0.25
# Radians that clips turn a joint before they tell how it turns (see `range_of_motion`), and that it turns either way
# where they do not.
_TELLING, _UNTOLD = np.radians(30.0), np.radians(120.0)
# Radians to a multiple of which the range is widened: clips that differ a little ask for the same targets.
_ROUND = np.radians(5.0)
# Moments of a clip at which a joint's rotation is looked at.
_MOMENTS = 61


@dataclass(frozen=True, slots=True)
class Hinge:
    """A joint that turns about one axis.

    Attributes:
        node: The joint.
        axis: (3,) unit, in the space of the node's parent.
        rest: (4,) the node's stored rotation, of unit length.
        least: Radians that it turns by at the most, one way; 0 or less,
        most: and the other; 0 or more.
    """

    node: int
    axis: Floats
    rest: Floats
    least: float
    most: float

    def turn(self, angles: Floats, *, tilt: Floats | None = None) -> Clip:
        """A clip of a second through (keys,) evenly spaced radians, each less than 180° from the one before.

        Args:
            angles: From the stored rotation.
            tilt: (2,) by how much the axis leans to two sides, tangents of angles; not at all where left out.
        """
        axis = self.axis if tilt is None else unit(self.axis + tilt @ _across(self.axis))
        times = np.linspace(0.0, 1.0, len(angles))
        greatest = float(np.abs(angles).max()) or 1.0
        channel = turning(self.node, self.rest, axis, greatest, angles / greatest)
        return motion_clip("", [type(channel)(0, self.node, "rotation", times, channel.values, "LINEAR")])

    def angles(self, rotations: Floats) -> Floats:
        """(frames,) radians about the axis from the stored rotation to (frames, 4) others: their twist.

        Source: the swing-twist decomposition of quaternions.
        """
        turns = _turns_from(self.rest, rotations)
        return np.asarray(2.0 * np.arctan2(turns[:, :3] @ self.axis, turns[:, 3]))


def _turns_from(stored: Floats, rotations: Floats) -> Floats:
    """(frames, 4) quaternions, the real part at least 0, that turn a stored one, (4,), to others, (frames, 4)."""
    turns = quaternion_product(rotations, stored * [-1.0, -1.0, -1.0, 1.0])
    return np.asarray(np.where(turns[:, 3:] < 0, -turns, turns))


def _across(axis: Floats) -> Floats:
    """(2, 3) unit, across an axis and each other."""
    first = unit(np.stack(cross(axis, np.eye(3)[np.argmin(np.abs(axis))])))
    return np.stack([first, np.stack(cross(axis, first))])


@dataclass(frozen=True)
class Fold:
    """The surface round a joint, with all that wrinkles it.

    Attributes:
        tools: Numbers of the tools whose contact is resolved here.
        hinge: The joint.
        vertices: (vertices,) fine welded vertices, rising.
        triangles: (triangles, 3) into these.
        radius: Of the limb, scene units.
        pivot: (3,) where the joint is at rest, world space.
        rig: Of the mesh.
        rest: Its rest pose.
        fine: The refined surface.
        carried: All tools on the mesh.
        weights: (vertices, joints) skin weights of the vertices.
    """

    tools: tuple[int, ...]
    hinge: Hinge
    vertices: Ints
    triangles: Ints
    radius: float
    pivot: Floats
    rig: Rig
    rest: Rest
    fine: Refinement
    carried: tuple[CarriedPatch, ...]
    weights: Floats

    @cached_property
    def rest_positions(self) -> Floats:
        """(vertices, 3) world space at rest."""
        return self.fine.rest_positions[self.vertices]

    @cached_property
    def crossings(self) -> Crossings:
        """What may cross."""
        return Crossings.of(self.rest_positions, self.triangles)

    @cached_property
    def moved(self) -> list[tuple[CarriedPatch, Ints, Ints]]:
        """The tools that move any vertex of it, the rows of these here, and their numbers among the tool's."""
        found = []
        for each in self.carried:
            _, here, there = np.intersect1d(self.vertices, each.vertices, assume_unique=True, return_indices=True)
            if len(here):
                found.append((each, here, there))
        return found

    def posed(self, clip: Clip | None, times: Floats) -> tuple[Floats, Floats]:
        """How the wrinkled surface lies at (frames,) seconds of a clip, without contact.

        In a motion that no file has (of index -1) nothing lags: it stands for all clips, fast or slow.

        Returns:
            (frames, vertices, 3) world space, and (frames, vertices, 3, 3) what turns bind space there.
        """
        blended = blend(self.weights, joint_matrices(self.rig, clip, times))
        bind = self.fine.positions[self.vertices] + np.tensordot(
            morph_weights(self.rig, clip, times), self.fine.morph_deltas[:, self.vertices], axes=1
        )
        for carried, here, there in self.moved:
            amplitudes = None
            if clip is not None and clip.index < 0:
                lengths = lengths_over_time(carried.patch, self.rig, self.rest, clip, times)
                amplitudes, _ = carried.patch.curve.follow(*lengths)
            bind[:, here] += displacements(carried, self.fine, self.rig, self.rest, clip, times, amplitudes)[:, there]
        return transform(blended, bind), blended[..., :3]

    def crossing(self, positions: Floats) -> Bools:
        """(vertices,) whether an edge or a triangle of each takes part in a crossing at (vertices, 3) positions."""
        edges, triangles = self.crossings.at(positions)
        marked = np.zeros(len(positions), bool)
        marked[self.crossings.edges[edges]] = True
        marked[self.triangles[triangles]] = True
        return marked


def find_folds(
    carried_patches: Sequence[CarriedPatch],
    chosen: Sequence[int],
    fine: Refinement,
    rest: Rest,
    rig: Rig,
    clips: Sequence[Clip] = (),
) -> tuple[list[Fold], list[int]]:
    """The folds of some tools, of which those over one joint share one; and the tools that have no joint.

    Args:
        carried_patches: All tools on the mesh.
        chosen: Numbers of those whose contact is to be resolved.
        fine: The refined surface.
        rest: The rest pose.
        rig: The joints.
        clips: All of the asset, which tell how far a joint turns and about which axis, whichever are baked.
    """
    by_node: dict[int, list[int]] = {}
    without = []
    for number in chosen:
        node = bent_node(carried_patches[number].patch, rig)
        if node is None:
            without.append(number)
        else:
            by_node.setdefault(node, []).append(number)
    folds = [_fold(tuple(tools), node, carried_patches, fine, rest, rig, clips) for node, tools in by_node.items()]
    return folds, without


def _fold(
    tools: tuple[int, ...],
    node: int,
    carried_patches: Sequence[CarriedPatch],
    fine: Refinement,
    rest: Rest,
    rig: Rig,
    clips: Sequence[Clip],
) -> Fold:
    patches = [carried_patches[number].patch for number in tools]
    pivot = node_matrices(rig, rest.clip, rest.time, [node])[0, 0, :3, 3]
    radius = max(_limb_radius(patch, pivot) for patch in patches)
    reach = max(_REACH_RADII * radius, _REACH_SPANS * max(patch.span for patch in patches))
    vertices, triangles = _round(pivot, reach, fine, np.concatenate([carried_patches[t].vertices for t in tools]))
    return Fold(
        tools=tools,
        hinge=_hinge(node, patches, pivot, rig, clips),
        vertices=vertices,
        triangles=triangles,
        radius=radius,
        pivot=pivot,
        rig=rig,
        rest=rest,
        fine=fine,
        carried=tuple(carried_patches),
        weights=fine.dense_weights(vertices, len(rig.joints)),
    )


def _limb_radius(patch: Patch, pivot: Floats) -> float:
    """How far a joint is from a tool's segment, scene units."""
    apart = pivot - patch.origin.position
    away = apart - np.clip(apart @ patch.along, 0.0, patch.span) * patch.along
    return max(float(np.linalg.norm(away)), _LEAST_RADIUS * patch.span)


def _hinge(node: int, patches: Sequence[Patch], pivot: Floats, rig: Rig, clips: Sequence[Clip]) -> Hinge:
    """The joint, turning as the asset's clips turn it; where they hardly do, so that the tools' ends come together."""
    stored = unit_quaternions(rig.locals[node]["rotation"])
    parent = int(rig.parents[node])
    world = np.eye(4) if parent < 0 else node_matrices(rig, None, np.zeros(1), [parent])[0, 0]
    # A turn about this brings the first tool's ends together fastest.
    closing = unit(np.linalg.pinv(world[:3, :3]) @ np.cross(patches[0].target.position - pivot, patches[0].along))
    channels = [channel for clip in clips if (channel := clip.channel(node, "rotation")) is not None]
    turns = [np.array([[0.0, 0.0, 0.0, 1.0]])]
    for channel in channels:
        times = np.linspace(channel.times[0], channel.times[-1], _MOMENTS)
        turns.append(_turns_from(stored, sample(channel, times)))
    together = np.concatenate(turns)
    if 2.0 * np.arcsin(np.minimum(np.linalg.norm(together[:, :3], axis=1), 1.0)).max() < _TELLING:
        return Hinge(node, closing, stored, -_UNTOLD, _UNTOLD)
    _, _, axes = np.linalg.svd(together[:, :3], full_matrices=False)
    axis = axes[0] if axes[0] @ closing >= 0 else -axes[0]
    angles = 2.0 * np.arctan2(together[:, :3] @ axis, together[:, 3])
    low, high = (np.sign(end) * np.ceil(np.abs(end) / _ROUND) * _ROUND for end in (angles.min(), angles.max()))
    return Hinge(node, axis, stored, min(float(low), 0.0), max(float(high), 0.0))


def _round(pivot: Floats, reach: float, fine: Refinement, seeds: Ints) -> tuple[Ints, Ints]:
    """(vertices,) within reach of a joint, rising, that hang together with some of (seeds,), and their triangles."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    near = np.sum((fine.rest_positions - pivot) ** 2, axis=1) <= reach**2
    near[seeds] = True
    triangles = fine.triangles[near[fine.triangles].all(axis=1)]
    vertices, local = np.unique(triangles, return_inverse=True)
    local = local.reshape(-1, 3)
    ends = local[:, [0, 1, 1, 2]].reshape(-1, 2)
    links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(vertices), len(vertices)))
    _, pieces = connected_components(links, directed=False)
    wanted = distinct_values(pieces[np.isin(vertices, seeds)])
    kept = np.isin(pieces, wanted)
    numbers = np.cumsum(kept) - 1
    return vertices[kept], numbers[local[kept[local[:, 0]]]]
