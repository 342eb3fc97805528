"""Patches and heights to displacements and normals, in bind space.

`attachment: skin`: a vertex keeps the (u, v) that it has at rest and its displacement direction is the rest
normal carried by the skin, so a tool's displacement is a sum of fixed shapes times amplitudes that depend on
the distance of its anchors alone.

`attachment: patch` is the paper's wording: (u, v) and normals of the undeformed posed surface, anew each
frame, the posed displacement pulled back to bind space.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: as
above; normals are area-weighted.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wrinklecli.curve import TAUT, ControlCurve
from wrinklecli.errors import BakeError
from wrinklecli.patch import Patch, Rest, inverses, lengths_over_time, singular
from wrinklecli.pose import Clip, Rig, blend, joint_matrices, morph_weights, transform
from wrinklecli.refine import Refinement
from wrinklecli.surface import unit, vertex_normals

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]

# A share of a tool's height too small to be seen or stored; vertices below it do not move.
_LEAST_SHARE = 1e-6
# Heights, over the greatest, at which true normals are sampled for the fit.
_FIT_HEIGHTS = np.array([0.25, 0.5, 0.75, 1.0])
# Rows of the table of weights for each group of bumps. Between the first two, a square root is off by most: 1/256.
_TABLE_ROWS = 65
_FULL_ROWS = 8
# Halvings that find where a group of bumps starts to the last bits of a float.
_HALVINGS = 50
# Cosine of true and base normal below which the fit does not follow: NORMAL deltas cannot turn a normal over.
_LEAST_COSINE = 0.1


@dataclass(frozen=True, slots=True)
class Carrier:
    """What carries one tool's curve to vertices: fixed for `attachment: skin`.

    Attributes:
        patch: The tool.
        vertices: (vertices,) fine welded vertices that move, rising.
        us: (vertices,) where each is along the segment.
        magnitudes: (vertices,) world displacement at rest over the curve's height.
        directions: (vertices, 3) bind displacement for a curve height of 1.
        free: (vertices,) those that may move: not what touches another mesh.
        stuck: How many members stay put because their joints' blend is singular at rest.
    """

    patch: Patch
    vertices: Ints
    us: Floats
    magnitudes: Floats
    directions: Floats
    free: Bools
    stuck: int


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


def carry(patch: Patch, fine: Refinement, pinned: Bools) -> Carrier:
    """Attach the vertices under a patch to it, at rest.

    Args:
        patch: The tool.
        fine: The refined surface.
        pinned: (coarse vertices,) those that must not move.

    Raises:
        BakeError: The tool moves no vertex.
    """
    members = np.unique(fine.triangles[patch.members[fine.subdivision.parents]])
    u, v = patch.coordinates(fine.rest_positions[members])
    magnitudes = patch.magnitudes(u, v, fine.rest_normals[members])
    old = members < len(pinned)
    magnitudes[old] *= ~pinned[members[old]]
    regular = ~singular(fine.blended[members])
    moving = np.abs(magnitudes) > _LEAST_SHARE * abs(patch.shape_strength)
    if not (regular & moving).any():
        raise BakeError("moves no vertex: the mesh faces away or lies beside the patch", where=patch.tool.where)
    # Projected anew each frame, any member may come to lie on the patch.
    chosen = regular & (moving if patch.tool.attachment == "skin" else True)
    vertices = members[chosen]
    carried = np.einsum("vij,vj->vi", inverses(fine.blended[vertices]), fine.rest_normals[vertices])
    return Carrier(
        patch=patch,
        vertices=vertices,
        us=u[chosen],
        magnitudes=magnitudes[chosen],
        directions=carried * magnitudes[chosen, None],
        free=~pinned[np.minimum(vertices, len(pinned) - 1)] | (vertices >= len(pinned)),
        # Where the blend is singular there is no normal either, and no magnitude.
        stuck=int(((u >= 0) & (u <= 1) & (np.abs(v) <= 1) & ~regular).sum()),
    )


def displacements(carrier: Carrier, fine: Refinement, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> Floats:
    """(frames, vertices, 3) what the method displaces a carrier's vertices by, bind space."""
    patch = carrier.patch
    amplitudes = patch.clip_strength(clip) * activity(patch, rig, rest, clip, times).amplitudes
    if patch.tool.attachment == "patch":
        return _posed_displacements(carrier, fine, rig, clip, times, amplitudes)
    heights = np.einsum("fgm,gmv->fv", amplitudes, patch.curve.shapes(carrier.us))
    moved: Floats = heights[..., None] * carrier.directions
    return moved


def shapes_of(carrier: Carrier, fine: Refinement, *, with_normals: bool) -> list[Shape | None]:
    """A shape for each group of bumps and mode of their profile, in the order of the curve's amplitudes.

    One that never rises, or moves no vertex, is None.
    """
    curve = carrier.patch.curve
    scaled = curve.shapes(carrier.us) * curve.greatest_amplitudes[..., None]
    _, path = weight_table(curve)
    shapes: list[Shape | None] = []
    for group, heights in enumerate(scaled):
        shapes += make_shapes(
            fine,
            carrier.vertices,
            heights[..., None] * carrier.directions,
            tallest=np.abs(heights * carrier.magnitudes).max(axis=1),
            samples=_rising_samples(path[:, group]) if with_normals else None,
        )
    return shapes


def weight_table(curve: ControlCurve) -> tuple[Floats, Floats]:
    """Tabulate weights against shortening at the nominal rest length.

    Heights start like a square root, each group of bumps where the one before it is full: rows lie close
    behind every start. (65 rows uniform in √(d/l) miss the later groups by up to 27 % of their height.)

    Returns:
        (rows,) 1 - distance / rest length from 0 to 1, rising, and (rows, groups, modes) weights; straight lines
        in between are right to 1/256 of the greatest height.
    """
    steps = np.linspace(0.0, 1.0, _TABLE_ROWS) ** 2
    starts = _group_starts(curve)
    rising = [low + (high - low) * steps for low, high in pairwise(starts)]
    # Behind the last only the lower knots of a polyline with details still move, and slowly.
    rows = np.unique(np.concatenate([[0.0], *rising, np.linspace(starts[-1], 1.0, _FULL_ROWS)]))
    lengths = np.full(len(rows), curve.rest_length)
    amplitudes, _ = curve.follow((1.0 - rows) * lengths, lengths)
    return rows, weights_of(curve, amplitudes)


def _group_starts(curve: ControlCurve) -> Floats:
    """(groups + 1,) the shortening over rest length at which each group starts, and at which the last is full."""
    length = np.array([curve.rest_length])
    starts = [1.0 - TAUT]
    for group in range(len(curve.groups)):
        low, high = starts[-1], 1.0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            bumps, unabsorbed = curve.absorb(curve.shortening((1.0 - middle) * length, length), length)
            later = [bump for bumps_of in curve.groups[group + 1 :] for bump in bumps_of]
            passed_on = float(bumps[0, later].sum() + unabsorbed[0])
            low, high = (low, middle) if passed_on > 0 else (middle, high)
        starts.append(high)
    return np.array(starts)


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
    base = fine.normals[touched]
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
    touched = np.unique(fine.triangles[np.isin(fine.triangles, vertices).any(axis=1)])
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


def activity(patch: Patch, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) times of a clip, seconds; none for the stored pose."""
    distances, lengths = lengths_over_time(patch, rig, rest, clip, times)
    shortenings = patch.curve.shortening(distances, lengths)
    bumps, unabsorbed = patch.curve.absorb(shortenings, lengths)
    amplitudes = patch.curve.amplitudes(bumps, lengths, unabsorbed)
    return Activity(distances, lengths, shortenings, unabsorbed, amplitudes)


def _posed_displacements(
    carrier: Carrier, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, amplitudes: Floats
) -> Floats:
    """Displacements as the paper words them: (u, v), normals and patch of each posed frame, pulled back.

    Args:
        carrier: The tool and its members.
        fine: The refined surface.
        rig: Of the mesh.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        amplitudes: (frames, groups, modes), strength in the clip applied.

    Returns:
        (frames, vertices, 3) bind space: the posed displacement times the inverse of the blended matrix; 0
        where that is singular.
    """
    patch, members = carrier.patch, carrier.vertices
    # Normals of members, and of anchors on a face that turns away, need all triangles around them.
    needed = np.concatenate([members, patch.origin.vertices, patch.target.vertices])
    ring = fine.triangles[np.isin(fine.triangles, needed).any(axis=1)]
    around, local = np.unique(ring, return_inverse=True)
    local = local.reshape(-1, 3)
    place = np.searchsorted(around, members)
    weights = fine.dense_weights(around, len(rig.joints))
    matrices = joint_matrices(rig, clip, times)
    morphs = morph_weights(rig, clip, times)
    moved = np.zeros((len(times), len(members), 3))
    for frame in range(len(times)):
        if not amplitudes[frame].any():
            continue
        blended = blend(weights, matrices[frame : frame + 1])[0]
        bind = fine.positions[around] + np.tensordot(morphs[frame], fine.morph_deltas[:, around], axes=1)
        posed = transform(blended[None], bind)[0]
        # A mirrored pose turns the winding inside out.
        outward = np.sign(np.median(np.linalg.det(blended[:, :, :3])))
        normals = outward * vertex_normals(posed, local)
        current = _posed_patch(patch, around, posed, normals)
        if current is None:
            continue
        u, v = current.coordinates(posed[place])
        heights = np.einsum("gm,gmv->v", amplitudes[frame], patch.curve.shapes(np.clip(u, 0.0, 1.0)))
        length = heights * current.magnitudes(u, v, normals[place]) * carrier.free
        moved[frame] = np.einsum("vij,vj->vi", inverses(blended[place]), length[:, None] * normals[place])
    return moved


def _posed_patch(patch: Patch, vertices: Ints, posed: Floats, normals: Floats) -> Patch | None:
    """The patch between the anchors of a posed surface, None where they coincide or face opposite ways."""
    ends = []
    for anchor in (patch.origin, patch.target):
        at = np.searchsorted(vertices, anchor.vertices)
        ends.append((anchor.barycentrics @ posed[at], unit(anchor.barycentrics @ normals[at])))
    difference = ends[1][0] - ends[0][0]
    span = float(np.linalg.norm(difference))
    if span <= 1e-9 * patch.span:
        return None
    along = difference / span
    mean = ends[0][1] + ends[1][1]
    mean = mean - (mean @ along) * along
    if np.linalg.norm(mean) < 1e-6:
        return None
    origin, target = (
        replace(anchor, position=place) for anchor, (place, _) in zip((patch.origin, patch.target), ends, strict=True)
    )
    return replace(patch, origin=origin, target=target, span=span, along=along, normal=unit(mean))


def compress(series: Floats, tolerance: float) -> tuple[Floats, Floats]:
    """Few shapes whose weighted sums give every frame of a series.

    Args:
        series: (frames, vertices, 3) displacements.
        tolerance: Greatest error of a coordinate, in the series' unit.

    Returns:
        (frames, shapes) weights in [-1, 1] and (shapes, vertices, 3). The fewest leading singular vectors
        that keep the greatest error, checked in the maximum norm, in bounds; of each shape's weights the
        largest is positive.
    """
    flat = series.reshape(len(series), -1)
    left, values, right = np.linalg.svd(flat, full_matrices=False)
    rank = 0
    while np.abs(flat - (left[:, :rank] * values[:rank]) @ right[:rank]).max(initial=0.0) > tolerance:
        rank += 1
    weights, shapes = left[:, :rank] * values[:rank], right[:rank]
    peaks = weights[np.argmax(np.abs(weights), axis=0), np.arange(rank)]
    return weights / peaks, (shapes * peaks[:, None]).reshape(rank, *series.shape[1:])
