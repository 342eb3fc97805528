"""Strain of a moving surface: how much each triangle is compressed in a pose, and along which direction.

The deformation of a triangle from rest to a pose has two principal stretches in its plane. What is compressed by a
principal stretch σ < 1 has lost 1 − σ of its length along that direction: this is what wrinkles give back.

Source: principal stretches are those of the polar decomposition F = RU, such as in J. Bonet, R. D. Wood, *Nonlinear
Continuum Mechanics for Finite Element Analysis*, 2nd ed. 2008, §4.6.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, joint_matrices, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, pieces_of, unit
from wrinklecli.numeric.nearest import balls
from wrinklecli.surface.rest import Rest
from wrinklecli.surface.strained import StrainedPart, StrainedParts

# A stretch beyond twice the length counts as twice: slivers of almost no area have any.
_LONGEST = 2.0
# Part of a mesh's area below which a piece of it is a small one.
_SMALL_PIECE = 0.01


@dataclass(frozen=True, slots=True)
class Gauge:
    """What measures a surface's strain: its triangles at rest, laid flat.

    Attributes:
        rig: Of the mesh.
        surface: The mesh.
        rest: Its rest pose.
        influences: (vertices, joints) skin weights.
        triangles: (triangles, 3) those with an area at rest.
        strained: Which of them clips may strain.
        numbers: (triangles,) which of the surface's they are.
        pieces: (triangles,) the same number for those that hang together: a shirt is another than the body below.
        middles: (triangles, 3) their centroids at rest, world space.
        radii: (triangles,) the greatest distance of a corner from there.
        flat: (triangles, 3) length of the first edge, and the second along and across it.
        tensors: (triangles, 3, 6) xx, yy, zz, xy, yz, zx of the products of the two in-plane axes: of the first by
            itself, of the two (both ways), of the second by itself.
    """

    rig: Rig
    surface: Surface
    rest: Rest
    influences: csr_array
    triangles: Ints
    strained: StrainedParts
    numbers: Ints
    pieces: Ints
    middles: Floats
    radii: Floats
    flat: Floats
    tensors: Floats


def read_gauge(surface: Surface, rest: Rest, rig: Rig) -> Gauge:
    """Lay the triangles of a surface flat; those without area are left out."""
    normals = face_normals(rest.positions, surface.triangles)
    areas = np.sqrt(np.sum(normals**2, axis=1))
    a, b, c = (rest.positions[surface.triangles[:, k]] for k in range(3))
    longest = np.sqrt(np.max([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0))
    # Thinner than this, the height has no digits left, and there is no area to compress.
    solid = areas > 1e-6 * longest**2
    solid &= np.sum((b - a) ** 2, axis=1) > 1e-12 * longest**2
    triangles = surface.triangles[solid]
    a, b, c, normals = a[solid], b[solid], c[solid], unit(normals[solid])
    first = unit(b - a)
    second = np.cross(normals, first)
    flat = np.stack([np.sum((b - a) * first, 1), np.sum((c - a) * first, 1), np.sum((c - a) * second, 1)], axis=1)
    tensors = np.stack(
        [_product(first, first), _product(first, second) + _product(second, first), _product(second, second)], axis=1
    )
    count = len(surface.positions)
    rows = np.repeat(np.arange(count), surface.joints.shape[1])
    entries = (surface.weights.ravel(), (rows, surface.joints.ravel()))
    influences = csr_array(entries, shape=(count, len(rig.joints)))
    middles, radii = balls(rest.positions[triangles])
    numbers, pieces = np.flatnonzero(solid), _pieces(triangles, areas[solid], count)
    strained = StrainedParts(rig, surface, triangles)
    return Gauge(rig, surface, rest, influences, triangles, strained, numbers, pieces, middles, radii, flat, tensors)


def _pieces(triangles: Ints, areas: Floats, count: int) -> Ints:
    """(triangles,) the same number for those that hang together by vertices; -1 for small ones, such as hair."""
    pieces = pieces_of(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]]), count)[triangles[:, 0]]
    sizes = np.bincount(pieces, areas, count)
    return np.where(sizes[pieces] < _SMALL_PIECE * areas.sum(), -1, pieces)


def posed(
    gauge: Gauge, clip: Clip | None, times: Floats, weights: Floats | None = None, *, vertices: Ints | None = None
) -> tuple[Floats, Floats]:
    """Pose the welded vertices.

    Args:
        gauge: Of the surface.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        weights: (frames, morph targets) in place of the clip's.
        vertices: (vertices,) which; all where left out.

    Returns:
        (frames, vertices, 3) world space and (frames, vertices) scale against rest, by which an animation makes the
        whole character larger.
    """
    rig, surface, rest = gauge.rig, gauge.surface, gauge.rest
    matrices = joint_matrices(rig, clip, times)
    weights = morph_weights(rig, clip, times) if weights is None else weights
    influences, positions, deltas = gauge.influences, surface.positions, surface.morph_deltas
    if vertices is not None:
        influences, positions, deltas = influences[vertices], positions[vertices], deltas[:, vertices]
    shape = (len(times), len(positions))
    rows = matrices[:, :, :3, :].transpose(1, 0, 2, 3).reshape(len(rig.joints), -1)
    blended = (influences @ rows).reshape(shape[1], shape[0], 3, 4).transpose(1, 0, 2, 3)
    bind = positions + np.tensordot(weights, deltas, axes=1)
    places = np.einsum("fvab,fvb->fva", blended[..., :3], bind) + blended[..., 3]
    now, before = np.abs(np.linalg.det(matrices[..., :3, :3])), np.abs(np.linalg.det(rest.matrices[:, :3, :3]))
    ratios = np.cbrt(now / np.where(before > 0, before, 1.0))
    scales: Floats = (influences @ ratios.T).T
    return places, scales


def strain(gauge: Gauge, clip: Clip | None, times: Floats, part: StrainedPart | None = None) -> Floats:
    """(frames, triangles, 6) the loss tensor I − U of each triangle: its eigenvalues are 1 − σ, stretch is negative.

    Written in world space at rest, in the triangle's plane; a character that is scaled as a whole loses nothing.

    Args:
        gauge: Of the surface.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        part: Of which triangles; of all where left out.
    """
    triangles, flats, products, vertices = gauge.triangles, gauge.flat, gauge.tensors, None
    if part is not None:
        triangles, vertices = part.corners, part.vertices
        flats, products = flats[part.triangles], products[part.triangles]
    positions, scales = posed(gauge, clip, times, vertices=vertices)
    a, b, c = (positions[:, triangles[:, k]] for k in range(3))
    scale = scales[:, triangles].mean(axis=2)
    hidden = scale < LEAST_SCALE
    length, along, across = flats.T
    first = (b - a) / length[:, None]
    second = (c - a - along[:, None] * first) / across[:, None]
    squared = np.where(hidden, 1.0, scale) ** 2
    xx, xy, yy = (
        np.einsum("ftk,ftk->ft", p, q) / squared for p, q in ((first, first), (first, second), (second, second))
    )
    mean, half = (xx + yy) / 2.0, (xx - yy) / 2.0
    spread = np.sqrt(half**2 + xy**2)
    losses = [1.0 - np.minimum(np.sqrt(np.maximum(mean + sign * spread, 0.0)), _LONGEST) for sign in (1.0, -1.0)]
    turn = (losses[0] - losses[1]) / 2.0 / np.where(spread > 0, spread, 1.0)
    middle = (losses[0] + losses[1]) / 2.0
    flat = np.stack([middle + turn * half, turn * xy, middle - turn * half], axis=2)
    flat = np.where(hidden[..., None], 0.0, flat)
    tensors: Floats = np.einsum("ftk,tks->fts", flat, products)
    return tensors


def principal(tensors: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """The greatest loss within tangent planes.

    Args:
        tensors: (…, points, 6).
        normals: (points, 3) unit, of the planes.

    Returns:
        (…, points) 1 − σ, and (…, points, 3) unit vectors along which that is.
    """
    first, second = tangents(normals)
    # Six of a symmetric tensor's nine components are stored: those off the diagonal count twice.
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    mixed = (_product(first, second) + _product(second, first)) / 2.0
    xx, xy, yy = (
        np.einsum("...pk,pk->...p", tensors, twice * product)
        for product in (_product(first, first), mixed, _product(second, second))
    )
    half = (xx - yy) / 2.0
    spread = np.sqrt(half**2 + xy**2)
    angle = np.arctan2(xy, half) / 2.0
    directions = np.cos(angle)[..., None] * first + np.sin(angle)[..., None] * second
    return (xx + yy) / 2.0 + spread, directions


def along_directions(tensors: Floats, normals: Floats, direction: Floats) -> Floats:
    """(points,) the loss of (points, 6) tensors along one direction, laid into each tangent plane."""
    x, y, z = unit(direction - (normals @ direction)[:, None] * normals).T
    products = np.stack([x * x, y * y, z * z, 2.0 * x * y, 2.0 * y * z, 2.0 * z * x], axis=1)
    losses: Floats = np.einsum("pk,pk->p", tensors, products)
    return losses


def tangents(normals: Floats) -> tuple[Floats, Floats]:
    """Two (…, 3) unit vectors across unit normals and each other."""
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=-1)]
    first = unit(np.cross(normals, axis))
    return first, np.cross(normals, first)


def _product(first: Floats, second: Floats) -> Floats:
    """(…, 6) xx, yy, zz, xy, yz, zx of first times second."""
    return np.stack([first[..., i] * second[..., j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))], -1)
