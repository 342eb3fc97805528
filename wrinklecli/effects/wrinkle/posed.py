"""Displacements projected in each posed frame (`attachment: patch`), and the few shapes that give them all.

This takes the paper literally, C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation:
(u, v) and normals are those of the undeformed posed surface in each frame. Differs: only members of the patch at rest
are projected; normals are area-weighted; the posed displacement is pulled back to bind space, as morph targets act
before skinning.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.character.skin import orientations
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, cross, inverses, renumbered
from wrinklecli.numeric.closest import closest_point
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.anchor import LEAST_SPAN
from wrinklecli.surface.path import Curve, curve_on
from wrinklecli.surface.refine import Refinement

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Normals of two anchors face opposite ways if their mean, projected across the segment, is shorter than this.
_LEAST_MEAN = 1e-6


@dataclass(frozen=True, slots=True)
class Ring:
    """The vertices of a patch's members and of all triangles around them, which posed normals need.

    Attributes:
        vertices: (around,) sorted fine welded vertices.
        members: (members,) indices into `vertices`.
        kept: (members,) factors of the height: the mask's, and 0 for vertices that touch another mesh.
        knots: (corners,) indices into `vertices` and their (corners,) weights, for each point that the patch's path
            goes through, the anchors among them.
        triangles: (triangles, 3) indices into `vertices`.
        sums: (around, triangles) 1 where a triangle has a vertex.
        joints: (joints,) indices of the rig's joints that move any of the vertices.
        weights: (around, joints) skin weights.
    """

    vertices: Ints
    members: Ints
    kept: Floats
    knots: tuple[tuple[Ints, Floats], ...]
    triangles: Ints
    sums: "csr_array[np.float64, tuple[int, int]]"
    joints: Ints
    weights: Floats


def ring_around(patch: Patch, members: Ints, kept: Floats, fine: Refinement) -> Ring:
    """Make the ring of (members,) sorted fine welded vertices, which keep a (members,) factor of their heights."""
    from scipy.sparse import csr_array

    # Normals of members, and of anchors on a face that turns away, need all triangles around them.
    knots = _knots(patch, fine)
    needed = np.concatenate([members, *(corners for corners, _ in knots)])
    faces = fine.triangles[np.isin(fine.triangles, needed).any(axis=1)]
    around, local = renumbered(faces)
    sums = csr_array(
        (np.ones(local.size), (local.reshape(-1), np.repeat(np.arange(len(local)), 3))),
        shape=(len(around), len(local)),
    )
    weights = fine.dense_weights(around, fine.weights.joint_count)
    joints = np.flatnonzero(weights.any(axis=0))
    return Ring(
        vertices=around,
        members=np.searchsorted(around, members),
        kept=kept,
        knots=tuple((np.searchsorted(around, corners), shares) for corners, shares in knots),
        triangles=local,
        sums=sums,
        joints=joints,
        weights=np.ascontiguousarray(weights[:, joints]),
    )


def _knots(patch: Patch, fine: Refinement) -> list[tuple[Ints, Floats]]:
    """The (corners,) welded vertices around each point that a patch's path goes through, and their weights."""
    if not isinstance(patch.path, Curve):
        return [(anchor.vertices, anchor.barycentrics) for anchor in patch.anchors]
    triangles = fine.surface.triangles
    positions = fine.rest_positions[: len(fine.surface.positions)]
    found = [closest_point(positions, triangles, knot) for knot in patch.path.knots]
    return [(triangles[triangle], shares) for triangle, shares, _ in found]


def posed_displacements(
    patch: Patch, ring: Ring, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, amplitudes: Floats
) -> Floats:
    """(frames, members, 3) displacements by (u, v), normals and patch of each posed frame, in bind space.

    Each is the posed displacement times the inverse of the blended matrix, and 0 where that is singular. The (frames,
    groups, modes) amplitudes at (frames,) seconds have the clip's strength applied.
    """
    moved = np.zeros((len(times), len(ring.members), 3))
    acting = np.flatnonzero(amplitudes.any(axis=(1, 2)))
    if not len(acting):
        return moved
    for part in (acting[some] for some in portions(len(acting), 2 * len(ring.triangles))):
        moved[part] = _posed_at_once(patch, ring, fine, rig, clip, times[part], amplitudes[part])
    return moved


def _posed_at_once(
    patch: Patch, ring: Ring, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, amplitudes: Floats
) -> Floats:
    """`posed_displacements` of few frames. Inside, frames are the last axis and x, y, z the first."""
    # Around the members: (3, 4, around, frames) blended matrices, (3, around, frames) world positions and unit normals.
    matrices = joint_matrices(rig, clip, times, ring.joints)
    blended = np.matmul(ring.weights, np.ascontiguousarray(matrices[:, :, :3].transpose(2, 3, 1, 0)))
    bind = fine.positions[ring.vertices].T[:, :, None]
    if len(fine.morph_deltas):
        deltas = fine.morph_deltas[:, ring.vertices].transpose(2, 1, 0)
        bind = bind + np.matmul(deltas, morph_weights(rig, clip, times).T)
    positions = np.sum(blended[:, :3] * bind, axis=1) + blended[:, 3]
    a, b, c = (positions[:, ring.triangles[:, k]] for k in range(3))
    outward = orientations(matrices, ring.weights.sum(axis=0))
    faces = cross(b - a, c - a)
    normals = outward * _units(np.stack([np.asarray(ring.sums @ each) for each in faces]))
    locate = _along_curves if isinstance(patch.path, Curve) else _along_segments
    u, v, cosines, exists = locate(patch, ring, positions, normals)
    normals = normals[:, ring.members]
    places = patch.places(u, v, cosines)
    lengths = places.times(ring.kept[:, None] * exists).heights(patch.curve, amplitudes)
    members, frames = np.nonzero(lengths)
    linear = blended[:, :3, ring.members[members], frames].transpose(2, 0, 1)
    pushed = lengths[members, frames, None] * normals[:, members, frames].T
    moved = np.zeros((len(times), len(ring.members), 3))
    moved[frames, members] = np.einsum("vij,vj->vi", inverses(linear), pushed)
    return moved


def _at_knots(ring: Ring, vectors: Floats) -> Floats:
    """(knots, 3, frames) values at the knots of (3, around, frames) vectors."""
    return np.stack([np.einsum("c,xcf->xf", shares, vectors[:, corners]) for corners, shares in ring.knots])


def _along_segments(
    patch: Patch, ring: Ring, positions: Floats, normals: Floats
) -> tuple[Floats, Floats, Floats, Bools]:
    """Project members onto a straight tool, by (3, around, frames) world positions and unit normals.

    Returns:
        (members, frames) u, v and cosines between the members' normals and the patch's, and (frames,) False where the
        anchors coincide or face opposite ways, so that there is no patch.
    """
    origin, target = _at_knots(ring, positions)
    difference = target - origin
    span = np.sqrt(np.sum(difference**2, axis=0))
    apart = span > LEAST_SPAN * patch.span
    span = np.where(apart, span, 1.0)
    along = difference / span
    first, second = _at_knots(ring, normals)
    mean = _units(first) + _units(second)
    mean = mean - np.sum(mean * along, axis=0) * along
    exists = apart & (np.sqrt(np.sum(mean**2, axis=0)) >= _LEAST_MEAN)
    normal = _units(mean)
    relative = positions[:, ring.members] - origin[:, None]
    across = np.stack(cross(along, normal))
    u = np.sum(relative * along[:, None], axis=0) / span
    v = np.sum(relative * across[:, None], axis=0) / patch.half_width
    return u, v, np.sum(normals[:, ring.members] * normal[:, None], axis=0), exists


def _along_curves(patch: Patch, ring: Ring, positions: Floats, normals: Floats) -> tuple[Floats, Floats, Floats, Bools]:
    """`_along_segments` of a tool with a path, through the points of the skin that the path met at rest."""
    shape = (len(ring.members), positions.shape[2])
    u, v, cosines, exists = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape[1], bool)
    knots, facing = (_at_knots(ring, vectors).transpose(2, 0, 1) for vectors in (positions, normals))
    apart = np.linalg.norm(np.diff(knots, axis=1), axis=2).min(axis=1) > LEAST_SPAN * patch.span
    facing = facing / np.maximum(np.linalg.norm(facing, axis=2, keepdims=True), _LEAST_MEAN)
    for frame in np.flatnonzero(apart):
        posed = replace(patch, laid=curve_on(knots[frame], facing[frame]))
        exists[frame] = True
        u[:, frame], v[:, frame] = posed.coordinates(positions[:, ring.members, frame].T)
        cosines[:, frame] = posed.cosines(u[:, frame], normals[:, ring.members, frame].T)
    return u, v, cosines, exists


def _units(vectors: Floats) -> Floats:
    """(3, …) vectors divided by their length; 0 stays 0."""
    lengths = np.sqrt(np.sum(vectors * vectors, axis=0))
    return vectors / np.where(lengths > 0, lengths, 1.0)
