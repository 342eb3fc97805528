"""Fixed shapes, one for each group of bumps that rise together: morph targets and the normals fitted to them.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh deformation. Differs: the paper
displaces each frame's vertices; here a shape in bind space times a weight does, and so do its normals. True normals are
not linear in the weights, but engines renormalise: what to add to the base normals is fitted over the heights.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.method.carry import LEAST_SHARE, CarriedPatch
from wrinklecli.method.curve import weight_path
from wrinklecli.method.refine import Refinement
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, vertex_normals

# Heights, as shares of the greatest, at which true normals are sampled for the fit.
_FIT_HEIGHTS = np.array([0.25, 0.5, 0.75, 1.0])
# Cosine of true and base normal below which the fit does not follow: NORMAL deltas cannot turn a normal over.
_LEAST_COSINE = 0.1


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
    moving = lengths > LEAST_SHARE * lengths.max(initial=0.0)
    normal_vertices, normal_deltas = np.zeros(0, np.intp), np.zeros((len(deltas), 0, 3))
    if samples is not None and moving.any():
        normal_vertices, normal_deltas = _fit_normals(fine, vertices, deltas, samples)
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
    touched = distinct_values(fine.triangles[np.isin(fine.triangles, vertices).any(axis=1)])
    faces = fine.triangles[np.isin(fine.triangles, touched).any(axis=1)]
    around, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    moved, rows = np.searchsorted(around, vertices), np.searchsorted(around, touched)
    normals = np.zeros((len(displacements), len(touched), 3))
    for sample, displacement in enumerate(displacements):
        positions = fine.bind_positions[around]
        positions[moved] += displacement
        normals[sample] = vertex_normals(positions, local)[rows]
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
