"""Fixed shapes: morph targets in bind space, and the NORMAL deltas that fit them.

NORMAL deltas are fitted to the true normals of sampled states, such as the tallest wrinkles in a pose that raises them.
If a pose makes a surface shorter, its wrinkles are steeper, but neither skinning nor the asset's own morph targets turn
normals accordingly.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.pose import Pose, blend, transform
from wrinklecli.numeric.arrays import (
    Floats,
    Ints,
    determinants,
    distinct_values,
    dot,
    smoothstep,
    unit,
    vertex_normals,
)
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import carried_normals

LEAST_SHARE = 1e-6
"""Ratio of a displacement to the greatest below which a vertex counts as still: nobody would see the move."""

LEAST_COSINE = 0.1
"""Least cosine of true and base normal that the fit follows, as NORMAL deltas cannot turn a normal over."""

# Cosine of a skinned normal and the true one of the surface as skinned up to which that surface counts as folded over:
# it does not say there how a normal of what is displaced differs from the true one, and turned it to the inside.
_FOLDED_COSINE = 0.5
# Cosine from which on what the two differ by counts wholly: skinning is off by up to 25° outside of folds.
_WHOLE_COSINE = 0.9

# Arrays of vertices by pairs of shapes that the fit of normals holds at once.
_FIT_COPIES = 2


@dataclass(frozen=True, slots=True)
class Shape:
    """One morph target at weight 1.

    Attributes:
        vertices: (vertices,) fine welded vertices that move, sorted.
        deltas: (vertices, 3) bind displacement.
        tallest: Largest world displacement at rest, scene units.
        normal_vertices: (vertices,) fine welded vertices whose normal changes, sorted.
        normal_deltas: (vertices, 3) added to the unit bind normal.
    """

    vertices: Ints
    deltas: Floats
    tallest: float
    normal_vertices: Ints
    normal_deltas: Floats


@dataclass(frozen=True, slots=True)
class Sample:
    """A state in which normals are to be right.

    Attributes:
        weights: (shapes,) weights of the shapes that act together.
        share: The state's weight in the fit.
        beneath: Shapes of other effects that act meanwhile, each with its weight; these have their normals already.
    """

    weights: Floats
    pose: Pose
    share: float = 1.0
    beneath: Sequence[tuple[Shape, float]] = ()


def make_shapes(
    fine: Refinement,
    vertices: Ints,
    deltas: Floats,
    *,
    tallest: Floats,
    samples: Sequence[Sample],
    folded: bool = False,
) -> list[Shape | None]:
    """Morph targets that act together, with NORMAL deltas fitted over samples of their weights.

    Args:
        fine: The refined surface.
        vertices: (vertices,) fine welded vertices, sorted.
        deltas: (shapes, vertices, 3) bind displacement at weight 1.
        tallest: (shapes,) largest world displacement at weight 1, scene units.
        samples: The states of the fit; empty if the mesh has no normals.
        folded: As `displaced_normals` takes it.
    """
    lengths = np.abs(deltas).max(axis=2)
    moving = lengths > LEAST_SHARE * lengths.max(initial=0.0)
    normal_vertices, normal_deltas = np.zeros(0, np.intp), np.zeros((len(deltas), 0, 3))
    if samples and moving.any():
        together = moving.any(axis=0)
        normal_vertices, normal_deltas = _fit_normals(
            fine, vertices[together], deltas[:, together], samples, folded=folded
        )
    shapes: list[Shape | None] = []
    for shape, moves in enumerate(moving):
        changed = np.abs(normal_deltas[shape]).max(axis=1) > LEAST_SHARE
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


def fit_bytes(shapes: int, vertices: int) -> int:
    """Bytes that the normals of so many shapes that act together take while they are fitted."""
    return _FIT_COPIES * 8 * vertices * shapes**2


def _fit_normals(
    fine: Refinement, vertices: Ints, deltas: Floats, samples: Sequence[Sample], *, folded: bool
) -> tuple[Ints, Floats]:
    """(touched,) vertices and (shapes, touched, 3) deltas of their unit normals at weight 1.

    An engine adds w ΔN to the base normal N and renormalises, so only directions must be right. The true unit normal t
    is scaled to t/(t·N), whose part along N is N, and fitted with weights (t·N)⁴. On a plane, this is exact at all
    heights.
    """
    weights, shares = np.stack([each.weights for each in samples]), np.array([each.share for each in samples])
    displacements = np.einsum("fs,svx->fvx", weights, deltas)
    touched, true = displaced_normals(
        fine,
        vertices,
        displacements,
        [each.pose for each in samples],
        [each.beneath for each in samples],
        folded=folded,
    )
    base = fine.normals_at(touched)
    cosines = np.maximum(np.sum(true * base, axis=2), LEAST_COSINE)
    wanted = true / cosines[..., None] - base
    for number, sample in enumerate(samples):
        for shape, weight in sample.beneath:
            _, rows, others = np.intersect1d(touched, shape.normal_vertices, assume_unique=True, return_indices=True)
            wanted[number, rows] -= weight * shape.normal_deltas[others]
    leverage = shares[:, None] * cosines**4
    normal = np.einsum("fv,fs,ft->vst", leverage, weights, weights)
    right = np.einsum("fv,fs,fvx->vsx", leverage, weights, wanted)
    # Shapes that hardly act in any sample get no normals instead of huge ones.
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2).max(initial=0.0) + 1e-30
    fitted = np.linalg.solve(normal + ridge * np.eye(weights.shape[1]), right)
    return touched, fitted.transpose(1, 0, 2)


def displaced_normals(
    fine: Refinement,
    vertices: Ints,
    displacements: Floats,
    poses: Sequence[Pose],
    beneath: Sequence[Sequence[tuple[Shape, float]]] = (),
    *,
    folded: bool = False,
) -> tuple[Ints, Floats]:
    """Bind normals around displaced vertices that a pose takes to true ones.

    Skinned normals of a surface differ from the true ones of the posed surface. So the turns of true normals by
    wrinkles are applied to the skinned ones, and nothing changes where nothing is displaced.

    Args:
        fine: The refined surface.
        vertices: (vertices,) that are displaced.
        displacements: (samples, vertices, 3) bind space.
        poses: One for each sample.
        beneath: For each sample other shapes that displace vertices too, and their weights.
        folded: True if the displacements undo what poses fold over: there the true normals count themselves.

    Returns:
        (touched,) vertices of every triangle that has a displaced vertex, and (samples, touched, 3) unit vectors, bind
        space, which the inverse transposes of the blended matrices turn to area-weighted normals.
    """
    touched = distinct_values(fine.triangles[fine.around.faces_of(vertices)])
    faces = fine.triangles[fine.around.faces_of(touched)]
    around, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    moved, rows = np.searchsorted(around, vertices), np.searchsorted(around, touched)
    weights, base = fine.dense_weights(around, fine.weights.shape[1]), fine.normals_at(touched)
    normals = np.zeros((len(displacements), len(touched), 3))
    shown_in: Pose | None = None
    for number, (into, displacement, pose) in enumerate(zip(normals, displacements, poses, strict=True)):
        if pose is not shown_in:
            shown_in = pose
            # Poses of the asset's own rig say nothing of the targets of effects.
            raised = np.flatnonzero(pose.morph_weights)
            deltas = fine.morph_deltas[raised[:, None], around]
            plain = fine.positions[around] + np.tensordot(pose.morph_weights[raised], deltas, axes=1)
            blended = blend(weights, pose.matrices[None])[0]
            # A mirrored pose turns the winding inside out.
            outward = np.sign(determinants(blended[rows, :, :3]))[:, None]
            smooth = outward * vertex_normals(transform(blended[None], plain)[0], local)[rows]
            shown = carried_normals(blended[rows], base)
        bind = plain.copy()
        bind[moved] += displacement
        for shape, weight in beneath[number] if beneath else ():
            _, here, others = np.intersect1d(around, shape.vertices, assume_unique=True, return_indices=True)
            bind[here] += weight * shape.deltas[others]
        true = outward * vertex_normals(transform(blended[None], bind)[0], local)[rows]
        turned = turn_to(smooth, shown, true)
        if folded:
            alike = (dot(smooth.T, shown.T)[:, None] - _FOLDED_COSINE) / (_WHOLE_COSINE - _FOLDED_COSINE)
            kept = smoothstep(np.clip(alike, 0.0, 1.0))
            turned = kept * turned + (1.0 - kept) * true
        back = unit(np.einsum("vji,vj->vi", blended[rows, :, :3], turned))
        into += np.where(shown.any(axis=1, keepdims=True), back, base)  # a singular pose shows nothing
    return touched, normals


def turn_to(base: Floats, authored: Floats, vectors: Floats) -> Floats:
    """Turn (vertices, 3) vectors by the smallest rotations from `base` to `authored`, (vertices, 3) unit normals.

    A base of 0 makes no turn.
    """
    axis = np.cross(base, authored)
    cosine = np.sum(base * authored, axis=1, keepdims=True)
    # Opposite normals (a face wound inside out) have no smallest rotation; there, both are mirrored.
    opposite = cosine < -0.999
    scale = 1.0 / np.where(opposite, 1.0, 1.0 + cosine)
    turned = vectors + np.cross(axis, vectors) + np.cross(axis, np.cross(axis, vectors)) * scale
    return np.where(opposite, -vectors, turned)


def summed(shapes: Sequence[Shape], factors: Floats) -> Shape:
    """A weighted sum of shapes."""
    pairs = []
    for each in ([(s.vertices, s.deltas) for s in shapes], [(s.normal_vertices, s.normal_deltas) for s in shapes]):
        vertices = np.unique(np.concatenate([where for where, _ in each]))
        deltas = np.zeros((len(vertices), 3))
        for factor, (where, values) in zip(factors, each, strict=True):
            deltas[np.searchsorted(vertices, where)] += factor * values
        pairs.append((vertices, deltas))
    (vertices, deltas), (normal_vertices, normal_deltas) = pairs
    scale = max(shape.tallest / _longest(shape.deltas) for shape in shapes)
    tallest = scale * _longest(deltas)
    return Shape(vertices, deltas, tallest, normal_vertices, normal_deltas)


def _longest(deltas: Floats) -> float:
    return float(np.sqrt(np.sum(deltas**2, axis=1)).max())
