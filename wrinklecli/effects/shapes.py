"""Fixed shapes: morph targets in bind space, and the NORMAL deltas that fit them.

NORMAL deltas are fitted to the true normals of sampled states, such as the tallest wrinkles in a pose that raises them.
If a pose makes a surface shorter, its wrinkles are steeper, but neither skinning nor the asset's own morph targets turn
normals accordingly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.pose import Pose, blend, transform
from wrinklecli.numeric.arrays import (
    Floats,
    Ints,
    determinants,
    distinct,
    distinct_values,
    dot,
    face_normals,
    matches,
    smoothstep,
    unit,
    vertex_normals,
)
from wrinklecli.numeric.intersections import sides_of
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
class Middles:
    """How far the middles of edges are displaced beyond the mean of the edges' ends.

    Triangles cut the corners of what a shape displaces: of a sine with two edges on each half of a wave they show two
    thirds of the slope, and with the middles of the edges nine tenths. Normals count these middles, which no file has.

    Attributes:
        edges: (edges,) sorted numbers of edges of the refined mesh, as `numbers_of` gives them.
        deltas: (…, edges, 3) bind space.
    """

    edges: Ints
    deltas: Floats

    @staticmethod
    def numbers_of(ends: Ints, fine: Refinement) -> Ints:
        """(edges,) a number for each edge of (edges, 2) fine welded vertices, the lower one first."""
        numbers: Ints = ends[:, 0] * len(fine.positions) + ends[:, 1]
        return numbers


@dataclass(frozen=True, slots=True)
class Shape:
    """One morph target at weight 1.

    Attributes:
        vertices: (vertices,) fine welded vertices that move, sorted.
        deltas: (vertices, 3) bind displacement.
        tallest: Largest world displacement at rest, scene units.
        normal_vertices: (vertices,) fine welded vertices whose normal changes, sorted.
        normal_deltas: (vertices, 3) added to the unit bind normal.
        middles: Those of edges that are not straight, with (edges, 3) deltas; None if all are.
    """

    vertices: Ints
    deltas: Floats
    tallest: float
    normal_vertices: Ints
    normal_deltas: Floats
    middles: Middles | None = None


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
    middles: Middles | None = None,
) -> list[Shape | None]:
    """Morph targets that act together, with NORMAL deltas fitted over samples of their weights.

    Args:
        fine: The refined surface.
        vertices: (vertices,) fine welded vertices, sorted.
        deltas: (shapes, vertices, 3) bind displacement at weight 1.
        tallest: (shapes,) largest world displacement at weight 1, scene units.
        samples: The states of the fit; empty if the mesh has no normals.
        folded: As `displaced_normals` takes it.
        middles: With (shapes, edges, 3) deltas.
    """
    lengths = np.abs(deltas).max(axis=2)
    moving = lengths > LEAST_SHARE * lengths.max(initial=0.0)
    normal_vertices, normal_deltas = np.zeros(0, np.intp), np.zeros((len(deltas), 0, 3))
    if samples and moving.any():
        together = moving.any(axis=0)
        normal_vertices, normal_deltas = _fit_normals(
            fine, vertices[together], deltas[:, together], samples, folded=folded, middles=middles
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
                middles and _bent(middles.edges, middles.deltas[shape]),
            )
            if moves.any()
            else None
        )
    return shapes


def _bent(edges: Ints, deltas: Floats) -> Middles | None:
    """The middles of one shape, without those of straight edges; None if there is none."""
    lengths = np.abs(deltas).max(axis=1)
    bent = lengths > LEAST_SHARE * lengths.max(initial=0.0)
    return Middles(edges[bent], deltas[bent]) if bent.any() else None


def fit_bytes(shapes: int, vertices: int) -> int:
    """Bytes that the normals of so many shapes that act together take while they are fitted."""
    return _FIT_COPIES * 8 * vertices * shapes**2


def _fit_normals(
    fine: Refinement,
    vertices: Ints,
    deltas: Floats,
    samples: Sequence[Sample],
    *,
    folded: bool,
    middles: Middles | None,
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
        middles=middles and replace(middles, deltas=np.tensordot(weights, middles.deltas, axes=1)),
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
    middles: Middles | None = None,
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
        middles: Those of the displacements, with (samples, edges, 3) deltas.

    Returns:
        (touched,) vertices of every triangle that has a displaced vertex, and (samples, touched, 3) unit vectors, bind
        space, which the inverse transposes of the blended matrices turn to area-weighted normals.
    """
    touched = distinct_values(fine.triangles[fine.around.faces_of(vertices)])
    faces = fine.triangles[fine.around.faces_of(touched)]
    around, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    moved, rows = np.searchsorted(around, vertices), np.searchsorted(around, touched)
    between = [
        _sum_of(middles and replace(middles, deltas=middles.deltas[number]), beneath[number] if beneath else ())
        for number in range(len(displacements))
    ]
    corners = _Corners.of(fine, around, local, rows) if any(between) else None
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
        posed, bent = transform(blended[None], bind)[0], between[number]
        if corners is None or bent is None:
            true = outward * vertex_normals(posed, local)[rows]
        else:
            true = outward * corners.normals(posed, blended, bent)
        turned = turn_to(smooth, shown, true)
        if folded:
            alike = (dot(smooth.T, shown.T)[:, None] - _FOLDED_COSINE) / (_WHOLE_COSINE - _FOLDED_COSINE)
            kept = smoothstep(np.clip(alike, 0.0, 1.0))
            turned = kept * turned + (1.0 - kept) * true
        back = unit(np.einsum("vji,vj->vi", blended[rows, :, :3], turned))
        into += np.where(shown.any(axis=1, keepdims=True), back, base)  # a singular pose shows nothing
    return touched, normals


@dataclass(frozen=True, slots=True)
class _Corners:
    """The corners of triangles at some vertices, up to the middles of the sides.

    Attributes:
        edges: (edges,) sorted numbers of the triangles' edges, as `Middles.numbers_of` gives them.
        ends: (edges, 2) rows of the edges' ends.
        corners: (corners, 3) the row of the vertex, and then, counted on from the rows, the edges behind and before it.
        at: (corners,) which of the vertices each corner is at.
        count: The number of the vertices.
    """

    edges: Ints
    ends: Ints
    corners: Ints
    at: Ints
    count: int

    @classmethod
    def of(cls, fine: Refinement, vertices: Ints, triangles: Ints, rows: Ints) -> "_Corners":
        """The corners at some (chosen,) sorted rows of (rows,) sorted fine `vertices`, of (triangles, 3) rows."""
        sides = sides_of(triangles)
        firsts, which = distinct(sides)
        behind = len(vertices) + which.reshape(-1, 3)
        corners = np.stack([triangles, behind, np.roll(behind, 1, axis=1)], axis=2).reshape(-1, 3)
        at = np.full(len(vertices), -1)
        at[rows] = np.arange(len(rows))
        corners = corners[at[corners[:, 0]] >= 0]
        ends = sides[firsts]
        return cls(Middles.numbers_of(vertices[ends], fine), ends, corners, at[corners[:, 0]], len(rows))

    def normals(self, posed: Floats, blended: Floats, middles: Middles) -> Floats:
        """(chosen, 3) area-weighted unit normals of (rows, 3) positions in a pose.

        (rows, 3, 4) `blended` matrices take the middles to the pose.
        """
        halfway = posed[self.ends].mean(axis=1)
        here, others = matches(self.edges, middles.edges)
        turned = blended[self.ends[here], :, :3].mean(axis=1)
        halfway[here] += np.einsum("eij,ej->ei", turned, middles.deltas[others])
        faces = face_normals(np.concatenate([posed, halfway]), self.corners)
        return unit(np.stack([np.bincount(self.at, column, self.count) for column in faces.T], axis=1))


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
    vertices, deltas = _sparse_sum([(each.vertices, each.deltas) for each in shapes], factors)
    normal_vertices, normal_deltas = _sparse_sum(
        [(each.normal_vertices, each.normal_deltas) for each in shapes], factors
    )
    scale = max(shape.tallest / _longest(shape.deltas) for shape in shapes)
    middles = _sum_of(None, list(zip(shapes, factors, strict=True)))
    return Shape(vertices, deltas, scale * _longest(deltas), normal_vertices, normal_deltas, middles)


def summed_middles(shapes: Sequence[Shape], weights: Floats) -> Middles | None:
    """The middles of weighted sums of shapes, for (samples, shapes) weights; None if all edges are straight."""
    sums = [_sum_of(None, list(zip(shapes, row, strict=True))) for row in weights]
    edges = [each.edges for each in sums if each is not None]
    if not edges:
        return None
    every = distinct_values(np.concatenate(edges))
    deltas = np.zeros((len(weights), len(every), 3))
    for into, each in zip(deltas, sums, strict=True):
        if each is not None:
            into[np.searchsorted(every, each.edges)] = each.deltas
    return Middles(every, deltas)


def _sum_of(first: Middles | None, others: Sequence[tuple[Shape, float]]) -> Middles | None:
    """The middles of a displacement and of shapes with their weights; None if all edges are straight."""
    parts = [(first, 1.0), *((shape.middles, weight) for shape, weight in others)]
    bent = [(each.edges, each.deltas, weight) for each, weight in parts if each is not None and weight]
    if not bent:
        return None
    return Middles(*_sparse_sum([(edges, deltas) for edges, deltas, _ in bent], [weight for *_, weight in bent]))


def _sparse_sum(parts: Sequence[tuple[Ints, Floats]], factors: Sequence[float] | Floats) -> tuple[Ints, Floats]:
    """The sorted numbers that any part has, and the (numbers, 3) sums of the parts' vectors times their factors."""
    numbers = distinct_values(np.concatenate([where for where, _ in parts]))
    sums = np.zeros((len(numbers), 3))
    for factor, (where, vectors) in zip(factors, parts, strict=True):
        sums[np.searchsorted(numbers, where)] += factor * vectors
    return numbers, sums


def _longest(deltas: Floats) -> float:
    return float(np.sqrt(np.sum(deltas**2, axis=1)).max())
