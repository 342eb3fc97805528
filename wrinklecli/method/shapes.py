"""Patches and heights to displacements and normals, in bind space.

`attachment: skin`: a vertex keeps the (u, v) that it has at rest and its displacement direction is the rest
normal carried by the skin, so a tool's displacement is a sum of fixed shapes times amplitudes that depend on
the distance of its anchors alone.

`attachment: patch` is the paper's wording: (u, v) and normals of the undeformed posed surface, anew each
frame, the posed displacement pulled back to bind space.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: as
above; normals are area-weighted.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.errors import BakeError
from wrinklecli.method.curve import TAUT, ControlCurve
from wrinklecli.method.patch import Patch, Rest, anchor_joints, anchor_poses, lengths_over_time
from wrinklecli.method.refine import Refinement
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    cross,
    determinants,
    distinct_values,
    inverses,
    singular,
    vertex_normals,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array


# A share of a tool's height too small to be seen or stored; vertices below it do not move.
_LEAST_SHARE = 1e-6
# Heights, over the greatest, at which true normals are sampled for the fit.
_FIT_HEIGHTS = np.array([0.25, 0.5, 0.75, 1.0])
# Rows of a path of weights, for each group of bumps, and behind the last, where only details of a polyline still move.
_PATH_ROWS = 65
_FULL_ROWS = 8
# Where a group of bumps starts is found to the last bits of a float by taking one of so many parts, so often. (Halves
# take three times as long: a curve answers for a hundred lengths nearly as fast as for one.)
_PARTS = 64
_ROUNDS = 9
# Anchors' joints and morph weights, times frames, posed at once: bounds the memory.
_ANCHORS_AT_ONCE = 2**16
# Triangles, times frames, posed at once for `attachment: patch`: what stays in a core's cache.
_POSED_AT_ONCE = 2**16
# Anchors of a posed patch nearer than this over their distance at rest coincide.
_LEAST_SPAN = 1e-9
# Length of the mean of their normals, across the segment, below which they face opposite ways.
_LEAST_MEAN = 1e-6
# Share of the tolerance of `compress` that the series may be simplified by; frames checked at once.
_SPARED_SHARE = 0.02
_CHECKED_AT_ONCE = 512
# Directions that a series may move in: four times as many as any engine plays morph targets.
_MOST_AXES = 1024
# Cosine of true and base normal below which the fit does not follow: NORMAL deltas cannot turn a normal over.
_LEAST_COSINE = 0.1


@dataclass(frozen=True, slots=True)
class CarriedPatch:
    """What carries one tool's curve to vertices: fixed for `attachment: skin`.

    Attributes:
        patch: The tool.
        vertices: (vertices,) fine welded vertices that move, rising.
        us: (vertices,) where each is along the segment.
        magnitudes: (vertices,) world displacement at rest over the curve's height.
        directions: (vertices, 3) bind displacement for a curve height of 1.
        free: (vertices,) those that may move: not what touches another mesh.
        stuck: How many members stay put because their joints' blend is singular at rest.
        ring: What poses them; None for `attachment: skin`.
    """

    patch: Patch
    vertices: Ints
    us: Floats
    magnitudes: Floats
    directions: Floats
    free: Bools
    stuck: int
    ring: "Ring | None"


@dataclass(frozen=True, slots=True)
class Shape:
    """One morph target: what one independent group of bumps does at its greatest height.

    Attributes:
        vertices: (vertices,) fine welded vertices, rising.
        deltas: (vertices, 3) bind displacement at weight 1.
        tallest: Largest world displacement at rest at weight 1, scene units.
        normal_vertices: (vertices,) fine welded vertices whose normal changes, rising.
        normal_deltas: (vertices, 3) to add to the unit bind normal at weight 1.
    """

    vertices: Ints
    deltas: Floats
    tallest: float
    normal_vertices: Ints
    normal_deltas: Floats


def carry(patch: Patch, fine: Refinement, pinned: Bools) -> CarriedPatch:
    """Attach the vertices under a patch to it, at rest.

    Args:
        patch: The tool.
        fine: The refined surface.
        pinned: (coarse vertices,) those that must not move.

    Raises:
        BakeError: The tool moves no vertex.
    """
    members = distinct_values(fine.triangles[patch.members[fine.subdivision.parents]])
    u, v = patch.coordinates(fine.rest_positions[members])
    normals = fine.rest_normals_at(members)
    magnitudes = patch.magnitudes(u, v, normals)
    old = members < len(pinned)
    magnitudes[old] *= ~pinned[members[old]]
    regular = ~singular(fine.blended[members])
    moving = np.abs(magnitudes) > _LEAST_SHARE * abs(patch.shape_strength)
    if not (regular & moving).any():
        raise BakeError("moves no vertex: the mesh faces away or lies beside the patch", where=patch.tool.where)
    # Projected anew each frame, any member may come to lie on the patch.
    chosen = regular & (moving if patch.tool.attachment == "skin" else True)
    vertices = members[chosen]
    normals_bind = np.einsum("vij,vj->vi", inverses(fine.blended[vertices]), normals[chosen])
    return CarriedPatch(
        patch=patch,
        vertices=vertices,
        us=u[chosen],
        magnitudes=magnitudes[chosen],
        directions=normals_bind * magnitudes[chosen, None],
        free=~pinned[np.minimum(vertices, len(pinned) - 1)] | (vertices >= len(pinned)),
        # Where the blend is singular there is no normal either, and no magnitude.
        stuck=int(((u >= 0) & (u <= 1) & (np.abs(v) <= 1) & ~regular).sum()),
        ring=_ring(patch, vertices, fine) if patch.tool.attachment == "patch" else None,
    )


@dataclass(frozen=True, slots=True)
class Activity:
    """What a clip makes of one tool, before any mesh.

    Attributes:
        distances: (frames,) of the anchors, animated scale taken out, scene units.
        rest_lengths: (frames,).
        shortenings: (frames,).
        unabsorbed: (frames,) what no bump could take.
        amplitudes: (frames, groups, modes) of the curve, clip strength not applied.
    """

    distances: Floats
    rest_lengths: Floats
    shortenings: Floats
    unabsorbed: Floats
    amplitudes: Floats


def displacements(
    carried: CarriedPatch,
    fine: Refinement,
    rig: Rig,
    rest: Rest,
    clip: Clip | None,
    times: Floats,
    amplitudes: Floats | None = None,
) -> Floats:
    """(frames, vertices, 3) what the method displaces a tool's vertices by, bind space.

    `amplitudes` are those of the tool's activity at these times, where they are known.
    """
    patch = carried.patch
    if amplitudes is None:
        amplitudes = activity(patch, rig, rest, clip, times).amplitudes
    amplitudes = patch.clip_strength(clip) * amplitudes
    if patch.tool.attachment == "patch":
        return _posed_displacements(carried, fine, rig, clip, times, amplitudes)
    heights = np.einsum("fgm,gmv->fv", amplitudes, patch.curve.shapes(carried.us))
    moved: Floats = heights[..., None] * carried.directions
    return moved


def shapes_of(carried: CarriedPatch, fine: Refinement, *, with_normals: bool) -> list[Shape | None]:
    """A shape for each group of bumps and mode of their profile, in the order of the curve's amplitudes.

    One that never rises, or moves no vertex, is None.
    """
    curve = carried.patch.curve
    scaled = curve.shapes(carried.us) * curve.greatest_amplitudes[..., None]
    path = weight_path(curve)
    shapes: list[Shape | None] = []
    for group, heights in enumerate(scaled):
        shapes += make_shapes(
            fine,
            carried.vertices,
            heights[..., None] * carried.directions,
            tallest=np.abs(heights * carried.magnitudes).max(axis=1),
            samples=_rising_samples(path[:, group]) if with_normals else None,
        )
    return shapes


def weight_path(curve: ControlCurve) -> Floats:
    """(rows, groups, modes) weights as the nominal rest length shortens to nothing, in small steps of the heights."""
    starts = group_starts(curve)
    steps = np.linspace(0.0, 1.0, _PATH_ROWS) ** 2  # heights start like a square root
    rising = [low + (high - low) * steps for low, high in pairwise(starts)]
    rows = distinct_values(np.concatenate([[0.0], *rising, np.linspace(starts[-1], 1.0, _FULL_ROWS)]))
    return weights_at(curve, rows)


def weights_at(curve: ControlCurve, shortenings: Floats) -> Floats:
    """(rows, groups, modes) weights at (rows,) shortenings over the nominal rest length, 1 - distance / rest length."""
    lengths = np.full(len(shortenings), curve.rest_length)
    amplitudes, _ = curve.follow((1.0 - shortenings) * lengths, lengths)
    return weights_of(curve, amplitudes)


def group_starts(curve: ControlCurve) -> Floats:
    """(groups + 1,) the shortening over the nominal rest length at which each group starts, and the last is full."""
    groups = np.arange(len(curve.groups))
    low, high = np.full(len(groups), 1.0 - TAUT), np.ones(len(groups))
    for _ in range(_ROUNDS):
        tried = np.linspace(low, high, _PARTS + 1)
        lengths = np.full(tried.size, curve.rest_length)
        shortenings = curve.shortening((1.0 - tried.reshape(-1)) * lengths, lengths)
        full = curve.full_groups(shortenings, lengths).reshape(tried.shape) > groups
        full[-1] = True  # the last stands for what is never full
        first = np.argmax(full[1:], axis=0)
        low, high = tried[first, groups], tried[first + 1, groups]
    return np.concatenate([[1.0 - TAUT], high])


def weights_of(curve: ControlCurve, amplitudes: Floats) -> Floats:
    """(frames, groups, modes) amplitudes as shares of the greatest; 0 for what never rises."""
    greatest = curve.greatest_amplitudes
    return amplitudes / np.where(greatest != 0, greatest, 1.0)


def _rising_samples(weights: Floats) -> Floats:
    """(samples, modes) weights of a group at a few heights, from (rows, modes) over all shortenings."""
    if not weights[:, 0].any():
        return weights[-1:]
    share = np.abs(weights[:, 0]) / np.abs(weights[:, 0]).max()
    rows = [int(np.argmin(np.abs(share - height))) for height in _FIT_HEIGHTS]
    return weights[rows]


def make_shapes(
    fine: Refinement, vertices: Ints, deltas: Floats, *, tallest: Floats, samples: Floats | None
) -> list[Shape | None]:
    """Morph targets that act together, with NORMAL deltas fitted over samples of their weights.

    Args:
        fine: The refined surface.
        vertices: (vertices,) fine welded vertices, rising.
        deltas: (shapes, vertices, 3) bind displacement at weight 1.
        tallest: (shapes,) largest world displacement at weight 1.
        samples: (samples, shapes) weights at which normals are to be right; none where the mesh has none.
    """
    lengths = np.abs(deltas).max(axis=2)
    moving = lengths > _LEAST_SHARE * lengths.max(initial=0.0)
    normal_vertices, normal_deltas = np.zeros(0, np.intp), np.zeros((len(deltas), 0, 3))
    if samples is not None and moving.any():
        normal_vertices, normal_deltas = _fit_normals(fine, vertices, deltas, samples)
    shapes: list[Shape | None] = []
    for shape, moves in enumerate(moving):
        changed = np.abs(normal_deltas[shape]).max(axis=1) > _LEAST_SHARE
        shapes.append(
            Shape(
                vertices[moves],
                deltas[shape, moves],
                float(tallest[shape]),
                normal_vertices[changed],
                normal_deltas[shape, changed],
            )
            if moves.any()
            else None
        )
    return shapes


def _fit_normals(fine: Refinement, vertices: Ints, deltas: Floats, samples: Floats) -> tuple[Ints, Floats]:
    """(touched,) vertices and (shapes, touched, 3) what to add to their unit normals at weight 1.

    An engine adds w ΔN to the base normal N and renormalises, so directions must be right, not lengths: the
    true unit normal t is scaled to t/(t·N), whose part along N is N, and fitted with weights (t·N)⁴.
    """
    touched, true = displaced_normals(fine, vertices, np.einsum("fs,svx->fvx", samples, deltas))
    base = fine.normals_at(touched)
    cosines = np.maximum(np.sum(true * base, axis=2), _LEAST_COSINE)
    wanted = true / cosines[..., None] - base
    leverage = cosines**4
    normal = np.einsum("fv,fs,ft->vst", leverage, samples, samples)
    right = np.einsum("fv,fs,fvx->vsx", leverage, samples, wanted)
    # Shapes that hardly act in any sample get no normals instead of huge ones.
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2).max(initial=0.0) + 1e-30
    fitted = np.linalg.solve(normal + ridge * np.eye(samples.shape[1]), right)
    return touched, fitted.transpose(1, 0, 2)


def displaced_normals(fine: Refinement, vertices: Ints, displacements: Floats) -> tuple[Ints, Floats]:
    """True normals around displaced vertices, bind space.

    Args:
        fine: The refined surface.
        vertices: (vertices,) that are displaced.
        displacements: (samples, vertices, 3) bind space.

    Returns:
        (touched,) vertices of every triangle that a displaced vertex has, and (samples, touched, 3) their
        unit area-weighted normals.
    """
    count = len(fine.positions)
    touched = distinct_values(fine.triangles[np.isin(fine.triangles, vertices).any(axis=1)])
    faces = fine.triangles[np.isin(fine.triangles, touched).any(axis=1)]
    around, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    place = np.full(count, -1, np.intp)
    place[around] = np.arange(len(around))
    normals = np.zeros((len(displacements), len(touched), 3))
    for sample, displacement in enumerate(displacements):
        positions = fine.bind_positions[around]
        positions[place[vertices]] += displacement
        normals[sample] = vertex_normals(positions, local)[place[touched]]
    return touched, normals


def turn_to(base: Floats, authored: Floats, vectors: Floats) -> Floats:
    """Turn vectors by the smallest rotations that take one unit normal to another.

    Args:
        base: (vertices, 3) unit normals, or 0: no turn.
        authored: (vertices, 3) unit normals.
        vectors: (vertices, 3).
    """
    axis = np.cross(base, authored)
    cosine = np.sum(base * authored, axis=1, keepdims=True)
    # Opposite normals (a face wound inside out) have no smallest rotation; there, both are mirrored.
    opposite = cosine < -0.999
    scale = 1.0 / np.where(opposite, 1.0, 1.0 + cosine)
    turned = vectors + np.cross(axis, vectors) + np.cross(axis, np.cross(axis, vectors)) * scale
    return np.where(opposite, -vectors, turned)


def activity(patch: Patch, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) times of a clip, seconds; none for the stored pose."""
    return activities([patch], rig, rest, clip, times)[0]


def activities(patches: Sequence[Patch], rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> list[Activity]:
    """As `activity`, of several tools: what moves their anchors is posed once."""
    if not patches:
        return []
    joints = anchor_joints(patches)
    chunk = max(_ANCHORS_AT_ONCE // (len(joints) + len(rig.morph_weights)), 1)
    parts: list[list[Activity]] = [[] for _ in patches]
    for at in (times[k : k + chunk] for k in range(0, max(len(times), 1), chunk)):
        poses = anchor_poses(joints, rig, rest, clip, at)
        for patch, found in zip(patches, parts, strict=True):
            distances, lengths = lengths_over_time(patch, rig, rest, clip, at, poses)
            shortenings = patch.curve.shortening(distances, lengths)
            amplitudes, unabsorbed = patch.curve.follow(distances, lengths)
            found.append(Activity(distances, lengths, shortenings, unabsorbed, amplitudes))
    return [_joined(found) for found in parts]


def further_activities(
    patches: Sequence[Patch],
    rig: Rig,
    rest: Rest,
    clip: Clip,
    times: Floats,
    *,
    known: Sequence[Activity],
    known_at: Floats,
) -> list[Activity]:
    """As `activities` at (frames,) times, rising; those at some of these, `known_at`, are known."""
    fresh = np.ones(len(times), bool)
    fresh[np.searchsorted(times, known_at)] = False
    if not fresh.any():
        return list(known)
    order = np.zeros(len(times), np.intp)
    order[~fresh], order[fresh] = np.arange(len(known_at)), np.arange(len(known_at), len(times))
    found = activities(patches, rig, rest, clip, times[fresh])
    return [_joined(pair, order) for pair in zip(known, found, strict=True)]


def _joined(parts: Sequence[Activity], order: Ints | None = None) -> Activity:
    """Activities of one tool, one after another; of these the frames in an order."""
    if len(parts) == 1 and order is None:
        return parts[0]

    def joined(arrays: Iterable[Floats]) -> Floats:
        together = np.concatenate(list(arrays))
        return together if order is None else together.take(order, axis=0)

    return Activity(
        distances=joined(each.distances for each in parts),
        rest_lengths=joined(each.rest_lengths for each in parts),
        shortenings=joined(each.shortenings for each in parts),
        unabsorbed=joined(each.unabsorbed for each in parts),
        amplitudes=joined(each.amplitudes for each in parts),
    )


@dataclass(frozen=True, slots=True)
class Ring:
    """The vertices of a patch's members and of all triangles around these: what posed normals need.

    Attributes:
        vertices: (around,) fine welded vertices, rising.
        members: (members,) numbers in `vertices`.
        origin: (corners,) and
        target: (corners,) those of the anchors' vertices.
        triangles: (triangles, 3) numbers in `vertices`.
        sums: (around, triangles) 1 where a triangle has a vertex.
        joints: (joints,) into the rig's, that move any of the vertices.
        weights: (around, joints) skin weights.
    """

    vertices: Ints
    members: Ints
    origin: Ints
    target: Ints
    triangles: Ints
    sums: "csr_array[np.float64, tuple[int, int]]"
    joints: Ints
    weights: Floats


def _ring(patch: Patch, members: Ints, fine: Refinement) -> Ring:
    from scipy.sparse import csr_array

    # Normals of members, and of anchors on a face that turns away, need all triangles around them.
    needed = np.concatenate([members, patch.origin.vertices, patch.target.vertices])
    faces = fine.triangles[np.isin(fine.triangles, needed).any(axis=1)]
    around, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    sums = csr_array(
        (np.ones(local.size), (local.reshape(-1), np.repeat(np.arange(len(local)), 3))),
        shape=(len(around), len(local)),
    )
    weights = fine.dense_weights(around, fine.weights.shape[1])
    joints = np.flatnonzero(weights.any(axis=0))
    return Ring(
        vertices=around,
        members=np.searchsorted(around, members),
        origin=np.searchsorted(around, patch.origin.vertices),
        target=np.searchsorted(around, patch.target.vertices),
        triangles=local,
        sums=sums,
        joints=joints,
        weights=np.ascontiguousarray(weights[:, joints]),
    )


def _posed_displacements(
    carried: CarriedPatch, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, amplitudes: Floats
) -> Floats:
    """Displacements as the paper words them: (u, v), normals and patch of each posed frame, pulled back.

    Args:
        carried: The tool and its members.
        fine: The refined surface.
        rig: Of the mesh.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        amplitudes: (frames, groups, modes), strength in the clip applied.

    Returns:
        (frames, vertices, 3) bind space: the posed displacement times the inverse of the blended matrix; 0
        where that is singular.
    """
    moved = np.zeros((len(times), len(carried.vertices), 3))
    acting = np.flatnonzero(amplitudes.any(axis=(1, 2)))
    if not len(acting):
        return moved
    ring = carried.ring
    assert ring is not None
    chunk = max(_POSED_AT_ONCE // len(ring.triangles), 1)
    for part in (acting[k : k + chunk] for k in range(0, len(acting), chunk)):
        moved[part] = _posed_at_once(carried, ring, fine, rig, clip, times[part], amplitudes[part])
    return moved


def _posed_at_once(
    carried: CarriedPatch, ring: Ring, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, amplitudes: Floats
) -> Floats:
    """As `_posed_displacements`, of few frames. Inside, frames are the last axis and x, y, z the first."""
    patch = carried.patch
    matrices = joint_matrices(rig, clip, times, ring.joints)[:, :, :3].transpose(2, 3, 1, 0)
    blended = np.matmul(ring.weights, np.ascontiguousarray(matrices))
    bind = fine.positions[ring.vertices].T[:, :, None]
    if len(fine.morph_deltas):
        deltas = fine.morph_deltas[:, ring.vertices].transpose(2, 1, 0)
        bind = bind + np.matmul(deltas, morph_weights(rig, clip, times).T)
    posed = np.sum(blended[:, :3] * bind, axis=1) + blended[:, 3]
    a, b, c = (posed[:, ring.triangles[:, k]] for k in range(3))
    # A mirrored pose turns the winding inside out.
    outward = np.sign(np.median(determinants(blended[:, :3].transpose(2, 3, 0, 1)), axis=0))
    normals = outward * _units(np.stack([np.asarray(ring.sums @ each) for each in cross(b - a, c - a)]))
    ends = [
        (
            np.einsum("c,xcf->xf", anchor.barycentrics, posed[:, at]),
            np.einsum("c,xcf->xf", anchor.barycentrics, normals[:, at]),
        )
        for anchor, at in ((patch.origin, ring.origin), (patch.target, ring.target))
    ]
    difference = ends[1][0] - ends[0][0]
    span = np.sqrt(np.sum(difference**2, axis=0))
    apart = span > _LEAST_SPAN * patch.span
    span = np.where(apart, span, 1.0)
    along = difference / span
    mean = _units(ends[0][1]) + _units(ends[1][1])
    mean = mean - np.sum(mean * along, axis=0) * along
    # Where the anchors coincide or face opposite ways there is no patch.
    apart &= np.sqrt(np.sum(mean**2, axis=0)) >= _LEAST_MEAN
    facing = _units(mean)
    normals = normals[:, ring.members]
    relative = posed[:, ring.members] - ends[0][0][:, None]
    u = np.sum(relative * along[:, None], axis=0) / span
    v = np.sum(relative * np.stack(cross(along, facing))[:, None], axis=0) / patch.half_width
    factors = patch.factors(u, v, np.sum(normals * facing[:, None], axis=0)) * carried.free[:, None] * apart
    lengths = factors * patch.curve.rises(np.clip(u, 0.0, 1.0), amplitudes)
    members, frames = np.nonzero(lengths)
    linear = blended[:, :3, ring.members[members], frames].transpose(2, 0, 1)
    pushed = lengths[members, frames, None] * normals[:, members, frames].T
    moved = np.zeros((len(times), len(carried.vertices), 3))
    moved[frames, members] = np.einsum("vij,vj->vi", inverses(linear), pushed)
    return moved


def _units(vectors: Floats) -> Floats:
    """(3, …) divided by their length; 0 stays 0."""
    lengths = np.sqrt(np.sum(vectors * vectors, axis=0))
    divided: Floats = vectors / np.where(lengths > 0, lengths, 1.0)
    return divided


def compress(series: Iterable[Floats], tolerance: float, *, where: str = "") -> tuple[Floats, Floats]:
    """Few shapes whose weighted sums give every frame of a series.

    Args:
        series: Parts of (frames, vertices, 3) displacements, one after another; each is looked at once, and let go.
        tolerance: Greatest error of a coordinate, in the series' unit.
        where: What moves like that, for the message.

    Returns:
        (frames, shapes) weights in [-1, 1] and (shapes, vertices, 3). The fewest leading singular vectors
        that keep the greatest error, checked in the maximum norm, in bounds, up to the 1/50 that the series is
        simplified by; of each shape's weights the largest is positive.

    Raises:
        BakeError: There are more than 1,024 shapes to choose from.
    """
    spared = _SPARED_SHARE * tolerance
    axes, parts = np.zeros((0, 0)), []
    size: tuple[int, ...] = ()
    for part in series:
        size = part.shape[1:]
        flat = part.reshape(len(part), -1)
        axes = axes if len(axes) else np.zeros((0, flat.shape[1]))
        coordinates = flat @ axes.T
        rest = flat - coordinates @ axes
        if np.abs(rest).max(initial=0.0) > spared:
            _, values, fresh = np.linalg.svd(rest, full_matrices=False)
            # No entry of what is left out exceeds the largest singular value of it.
            fresh = fresh[values > spared]
            axes = np.concatenate([axes, fresh])
            coordinates = np.concatenate([coordinates, flat @ fresh.T], axis=1)
        if len(axes) > _MOST_AXES:
            raise BakeError(f"moves in more than {_MOST_AXES:,} ways, more than morph targets can follow", where=where)
        parts.append(coordinates)
    flat = np.concatenate([np.pad(each, ((0, 0), (0, len(axes) - each.shape[1]))) for each in parts])
    left, values, right = np.linalg.svd(flat, full_matrices=False)
    shapes = right @ axes
    rank = 0
    for start in range(0, len(flat), _CHECKED_AT_ONCE):
        rows = slice(start, start + _CHECKED_AT_ONCE)
        wanted = flat[rows] @ axes
        while (
            np.abs(wanted - (left[rows, :rank] * values[:rank]) @ shapes[:rank]).max(initial=0.0) > tolerance - spared
        ):
            rank += 1
    weights, shapes = left[:, :rank] * values[:rank], shapes[:rank]
    peaks = weights[np.argmax(np.abs(weights), axis=0), np.arange(rank)]
    return weights / peaks, (shapes * peaks[:, None]).reshape(rank, *size)
