"""Strain of a moving surface: how much each triangle is compressed in a pose, and along which direction.

The deformation of a triangle from rest to a pose has two principal stretches in its plane. A principal stretch σ < 1
compresses the triangle along its direction. The *loss* 1 − σ is the part of its length that is lost there, and that
wrinkles give back. Triangles that one moving node carries as a whole keep their shape.

Source: J. Bonet, R. D. Wood, *Nonlinear Continuum Mechanics for Finite Element Analysis*, 2nd ed. 2008, §4.6: principal
stretches are the eigenvalues of U in the polar decomposition F = RU.
"""

from collections.abc import Collection
from dataclasses import replace
from functools import reduce

import numpy as np
from scipy.sparse import csr_array

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, joint_matrices, morph_weights
from wrinklecli.character.rig import TRANSFORM_DEFAULTS, Rig, moving_nodes
from wrinklecli.character.surface import Surface
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, components, face_normals, renumbered, unit
from wrinklecli.numeric.closest import balls
from wrinklecli.numeric.memory import once
from wrinklecli.surface.rest import Rest

# Greatest stretch that counts, as a ratio of lengths: triangles of almost no area may have any.
_MOST_STRETCH = 2.0
# Part of the mesh's area below which a connected piece is a small one, such as a strand of hair.
_SMALL_PIECE = 0.01
# Least height of a triangle, and least length of its first edge, over its longest edge: shorter ones have no digits.
_LEAST_HEIGHT = 1e-6
# Part of a mesh's triangles from which on measuring all of them costs no more than selecting some.
_WHOLE_MESH = 0.5
# Stands for a node where a joint has no weight at a vertex; greater than the number of any node.
_NO_NODE = 2**60


@dataclass(frozen=True, slots=True)
class StrainedPart:
    """Some triangles of a mesh, with vertices numbered anew.

    Attributes:
        triangles: (chosen,) numbers of triangles of the mesh.
        vertices: (vertices,) numbers of vertices of the mesh, at the corners of these triangles.
        corners: (chosen, 3) indices into `vertices`.
    """

    triangles: Ints
    vertices: Ints
    corners: Ints


class StrainedParts:
    """Finds the triangles that a clip can strain. Clips that move the same nodes and morph targets share one part."""

    def __init__(self, rig: Rig, surface: Surface, triangles: Ints) -> None:
        """`triangles` are (triangles, 3) of the surface."""
        self._rig, self._surface, self._triangles = rig, surface, triangles
        self._above = moving_nodes(rig)
        self._known: dict[object, StrainedPart | None] = {}

    def of(self, clip: Clip) -> StrainedPart | None:
        """The triangles that a clip can strain; None for half of the mesh or more."""
        if "scale" in clip.paths:
            return None
        # A clip may move thousands of characters, of which this rig is one.
        moved = (node for node in self._above if any((node, path) in clip.by_target for path in TRANSFORM_DEFAULTS))
        nodes = frozenset(moved)
        targets = _moving_targets(self._rig, clip)
        return once(self._known, (nodes, targets), lambda: self._part(nodes, targets))

    def _part(self, nodes: Collection[int], targets: tuple[int, ...]) -> StrainedPart | None:
        """The triangles that moving nodes and morph targets can strain."""
        surface, carriers = self._surface, _carriers(self._rig, nodes)
        # Column by column, as there are few: several times as fast as row by row.
        own = [np.where(w > 0, carriers[j], _NO_NODE) for j, w in zip(surface.joints.T, surface.weights.T, strict=True)]
        low = reduce(np.minimum, own)
        high = reduce(np.maximum, [np.where(each == _NO_NODE, -_NO_NODE, each) for each in own])
        a, b, c = self._triangles.T
        strained = np.minimum(np.minimum(low[a], low[b]), low[c]) != np.maximum(np.maximum(high[a], high[b]), high[c])
        if targets:
            morphed = np.any(surface.morph_deltas[list(targets)], axis=(0, 2))
            strained |= morphed[a] | morphed[b] | morphed[c]
        if strained.sum() >= _WHOLE_MESH * len(self._triangles):
            return None
        chosen = np.flatnonzero(strained)
        return StrainedPart(chosen, *renumbered(self._triangles[chosen]))


def _carriers(rig: Rig, moving: Collection[int]) -> Ints:
    """(joints,) the nearest moving node that is the joint or an ancestor of it; -1 for none."""
    nearest = (next(filter(moving.__contains__, rig.upwards(joint)), -1) for joint in rig.joints.tolist())
    return np.array(list(nearest), np.intp)


def _moving_targets(rig: Rig, clip: Clip) -> tuple[int, ...]:
    """The numbers of the morph targets that a clip moves."""
    channel = clip.channel(rig.node, "weights")
    if channel is None:
        return ()
    # The tangents of a cubic spline move a target too, whatever its keys are.
    if channel.interpolation == "CUBICSPLINE":
        return tuple(range(len(rig.morph_weights)))
    return tuple(np.flatnonzero((channel.values != rig.morph_weights).any(axis=0)).tolist())


@dataclass(frozen=True, slots=True)
class Gauge:
    """Measures the strain of a surface: its triangles that have an area at rest, each in a plane of its own.

    Attributes:
        influences: (vertices, joints) skin weights.
        triangles: (triangles, 3) vertices at the corners.
        strained: Finds the triangles that a clip can strain.
        numbers: (triangles,) the number of each among the surface's triangles.
        pieces: (triangles,) number of the connected piece; -1 for small pieces. A shirt is one piece, the body another.
        middles: (triangles, 3) centroids at rest, world space.
        radii: (triangles,) greatest distance of a corner from the centroid, scene units.
        flat: (triangles, 3) length of the first edge a to b; length of the edge a to c along the first, and across it.
        tensors: (triangles, 3, 6) components xx, yy, zz, xy, yz, zx of products of the plane's axes: the first with
            itself, the first with the second plus the second with the first, the second with itself.
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

    @property
    def areas(self) -> Floats:
        """(triangles,) areas at rest, scene units squared."""
        return self.flat[:, 0] * self.flat[:, 2] / 2.0


def read_gauge(surface: Surface, rest: Rest, rig: Rig) -> Gauge:
    """Prepare to measure a surface; triangles without area are left out."""
    normals = face_normals(rest.positions, surface.triangles)
    chosen = solid(rest.positions, surface.triangles, normals)
    triangles = surface.triangles[chosen]
    a, b, c = (rest.positions[triangles[:, k]] for k in range(3))
    areas, normals = np.sqrt(np.sum(normals[chosen] ** 2, axis=1)), unit(normals[chosen])
    first = unit(b - a)
    second = np.cross(normals, first)
    flat = np.stack([np.sum((b - a) * first, 1), np.sum((c - a) * first, 1), np.sum((c - a) * second, 1)], axis=1)
    tensors = np.stack(
        [product(first, first), product(first, second) + product(second, first), product(second, second)], axis=1
    )
    count = len(surface.positions)
    rows = np.repeat(np.arange(count), surface.joints.shape[1])
    entries = (surface.weights.ravel(), (rows, surface.joints.ravel()))
    influences = csr_array(entries, shape=(count, len(rig.joints)))
    middles, radii = balls(rest.positions[triangles])
    numbers, pieces = np.flatnonzero(chosen), _pieces(triangles, areas, count)
    strained = StrainedParts(rig, surface, triangles)
    return Gauge(rig, surface, rest, influences, triangles, strained, numbers, pieces, middles, radii, flat, tensors)


def solid(positions: Floats, triangles: Ints, normals: Floats) -> Bools:
    """(triangles,) True for those that a gauge can be laid on, with (triangles, 3) `normals` by `face_normals`."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    longest = np.sqrt(np.max([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0))
    high = np.sqrt(np.sum(normals**2, axis=1)) > _LEAST_HEIGHT * longest**2
    return np.asarray(high & (np.sum((b - a) ** 2, axis=1) > _LEAST_HEIGHT**2 * longest**2))


def part_of(gauge: Gauge, chosen: Bools) -> Gauge:
    """A gauge of some of its triangles, with (triangles,) `chosen`."""
    strained = StrainedParts(gauge.rig, gauge.surface, gauge.triangles[chosen])
    own = ("triangles", "numbers", "pieces", "middles", "radii", "flat", "tensors")
    return replace(gauge, strained=strained, **{name: getattr(gauge, name)[chosen] for name in own})


def _pieces(triangles: Ints, areas: Floats, count: int) -> Ints:
    """(triangles,) the number of the piece that shared vertices connect; -1 for small pieces."""
    pieces = components(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]]), count)[triangles[:, 0]]
    sizes = np.bincount(pieces, areas, count)
    return np.where(sizes[pieces] < _SMALL_PIECE * areas.sum(), -1, pieces)


def posed(
    gauge: Gauge, clip: Clip | None, times: Floats, weights: Floats | None = None, *, vertices: Ints | None = None
) -> tuple[Floats, Floats]:
    """Pose the welded vertices.

    Args:
        gauge: Has the surface.
        clip: None for the stored pose.
        times: (frames,) seconds.
        weights: (frames, morph targets), in place of the clip's.
        vertices: (vertices,) numbers of those to pose; None for all.

    Returns:
        (frames, vertices, 3) world-space positions, and (frames, vertices) scale relative to rest, by which the
        animation enlarges the character.
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


def unscaled_pose(gauge: Gauge, clip: Clip | None, time: float, weights: Floats | None = None) -> Floats:
    """(vertices, 3) positions as `posed`, at one time, divided by animated scale; weights are (morph targets,)."""
    positions, scales = posed(gauge, clip, np.array([time]), None if weights is None else weights[None])
    return np.asarray(positions[0] / np.where(scales[0] > LEAST_SCALE, scales[0], 1.0)[:, None])


def strain(gauge: Gauge, clip: Clip | None, times: Floats, part: StrainedPart | None = None) -> Floats:
    """Measure the loss tensor I − U of each triangle; its eigenvalues are 1 − σ, negative where it is stretched.

    A character that an animation scales as a whole loses nothing.

    Args:
        gauge: Measures the surface.
        clip: None for the stored pose.
        times: (frames,) seconds.
        part: The triangles to measure; None for all.

    Returns:
        (frames, triangles, 6) components xx, yy, zz, xy, yz, zx in the triangle's plane at rest, world space.
    """
    triangles, flats, products, vertices = gauge.triangles, gauge.flat, gauge.tensors, None
    if part is not None:
        triangles, vertices = part.corners, part.vertices
        flats, products = flats[part.triangles], products[part.triangles]
    positions, scales = posed(gauge, clip, times, vertices=vertices)
    length, along, across = flats.T
    corners, shape = triangles.T, (len(times), len(triangles))
    xx, xy, yy = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    # Coordinate by coordinate, as numpy takes twice as long along an axis of three.
    for places in np.moveaxis(positions, 2, 0):
        a, b, c = (places.take(corner, axis=1) for corner in corners)
        first = (b - a) / length
        second = (c - a - along * first) / across
        xx += first * first
        xy += first * second
        yy += second * second
    scale = sum((scales.take(corner, axis=1) for corner in corners), np.zeros(shape)) / 3.0
    hidden = scale < LEAST_SCALE
    squared = np.where(hidden, 1.0, scale) ** 2
    xx, xy, yy = xx / squared, xy / squared, yy / squared
    mean, half = (xx + yy) / 2.0, (xx - yy) / 2.0
    spread = np.sqrt(half**2 + xy**2)
    losses = [1.0 - np.minimum(np.sqrt(np.maximum(mean + sign * spread, 0.0)), _MOST_STRETCH) for sign in (1.0, -1.0)]
    turn = (losses[0] - losses[1]) / 2.0 / np.where(spread > 0, spread, 1.0)
    middle = (losses[0] + losses[1]) / 2.0
    flat = np.stack([middle + turn * half, turn * xy, middle - turn * half])
    flat[:, hidden] = 0.0
    return np.asarray(np.matmul(flat.transpose(2, 1, 0), products).transpose(1, 0, 2))


def principal(tensors: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Find the greatest loss of (…, points, 6) tensors within tangent planes with (points, 3) unit normals.

    Returns:
        (…, points) losses 1 − σ, and (…, points, 3) unit vectors of their directions.
    """
    first, second = tangents(normals)
    mean, half, xy = _in_planes(tensors, first, second)
    angle = np.arctan2(xy, half) / 2.0
    directions = np.cos(angle)[..., None] * first + np.sin(angle)[..., None] * second
    return mean + np.sqrt(half**2 + xy**2), directions


def greatest_losses(tensors: Floats, normals: Floats) -> Floats:
    """(…, points) losses as `principal` finds them, in half the time without their directions."""
    mean, half, xy = _in_planes(tensors, *tangents(normals))
    return np.asarray(mean + np.sqrt(half**2 + xy**2))


def _in_planes(tensors: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats, Floats]:
    """(…, points) half of the sum and of the difference of xx and yy, and xy, of tensors along two unit vectors."""
    # Six of a symmetric tensor's nine components are stored; the three off the diagonal count twice.
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    mixed = (product(first, second) + product(second, first)) / 2.0
    xx, xy, yy = (
        np.einsum("...pk,pk->...p", tensors, twice * product)
        for product in (product(first, first), mixed, product(second, second))
    )
    return (xx + yy) / 2.0, (xx - yy) / 2.0, xy


def along_directions(tensors: Floats, normals: Floats, direction: Floats) -> Floats:
    """(points,) losses of (points, 6) tensors along one (3,) direction, projected into each tangent plane."""
    x, y, z = unit(direction - (normals @ direction)[:, None] * normals).T
    products = np.stack([x * x, y * y, z * z, 2.0 * x * y, 2.0 * y * z, 2.0 * z * x], axis=1)
    return np.asarray(np.einsum("pk,pk->p", tensors, products))


def tangents(normals: Floats) -> tuple[Floats, Floats]:
    """Two (…, 3) unit vectors, perpendicular to unit normals and to each other."""
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=-1)]
    first = unit(np.cross(normals, axis))
    return first, np.cross(normals, first)


def product(first: Floats, second: Floats) -> Floats:
    """(…, 6) components xx, yy, zz, xy, yz, zx of the outer product of (…, 3) vectors."""
    return np.stack([first[..., i] * second[..., j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))], -1)
