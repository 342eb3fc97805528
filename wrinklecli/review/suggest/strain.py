"""How much a moving surface is compressed: where, along which direction and when.

The deformation of a triangle from rest to a pose has two principal stretches in its plane. What is compressed by a
principal stretch σ < 1 has lost 1 − σ of its length along that direction: this is what wrinkles give back. Triangles
are uneven and single ones noisy, so the loss is averaged as a tensor over a small neighbourhood of points that are
spread evenly over the surface: `Sites`.

Source: principal stretches are those of the polar decomposition F = RU, such as in J. Bonet, R. D. Wood, *Nonlinear
Continuum Mechanics for Finite Element Analysis*, 2nd ed. 2008, §4.6.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, joint_matrices, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.method.rest import Rest
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, unit

# Radius of the neighbourhood over which strain is averaged, of the diagonal of the mesh's box: 27 mm of a person.
_RADIUS = 0.015
# And at least this part of a typical triangle's longest edge: less would tell single triangles apart.
_OF_TRIANGLES = 0.6
# Sites are this far apart, of that radius: a dozen of them in a neighbourhood.
_SPACING = 0.5
# More would take seconds; beyond it, they move apart.
_MOST_SITES = 12_000
# A triangle is sampled at the centroids of at most 8 × 8 parts.
_MOST_PARTS = 8
# Cosine of normals above which two near points are of one sheet, not of two sides of a thin one.
_SAME_SHEET = 0.3
# A stretch beyond twice the length counts as twice: slivers of almost no area have any.
_LONGEST = 2.0
# Triangles times poses that are held at once: 2**18 take 60 MB.
_CHUNK = 2**18


@dataclass(frozen=True, slots=True)
class Sites:
    """Points spread evenly over a surface at rest.

    Attributes:
        positions: (sites, 3) world space at rest.
        normals: (sites, 3) unit.
        areas: (sites,) of the surface around each; their sum is that of the surface.
        gather: (sites, triangles) shares of the triangles at each site; rows sum to 1.
        smooth: (sites, sites) shares of the sites in each one's neighbourhood; rows sum to 1.
        near: (sites, sites) which are neighbours, on one sheet of the surface.
        radius: Of the neighbourhoods, scene units.
        spacing: About the distance of two neighbours, scene units.
    """

    positions: Floats
    normals: Floats
    areas: Floats
    gather: csr_array
    smooth: csr_array
    near: csr_array
    radius: float
    spacing: float


@dataclass(frozen=True, slots=True)
class Gauge:
    """What measures a surface's strain: its triangles at rest, laid flat.

    Attributes:
        rig: Of the mesh.
        surface: The mesh.
        rest: Its rest pose.
        influences: (vertices, joints) skin weights.
        triangles: (triangles, 3) those with an area at rest.
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
    middles: Floats
    radii: Floats
    flat: Floats
    tensors: Floats


@dataclass(frozen=True, slots=True)
class Peaks:
    """The greatest compression of each site over some poses.

    Attributes:
        losses: (sites,) 1 − σ of the averaged strain; negative where a site is only ever stretched.
        poses: (sites,) the pose of it.
        clips: (poses,) its clip.
        times: (poses,) its time, seconds.
    """

    losses: Floats
    poses: Ints
    clips: tuple[Clip, ...]
    times: Floats


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
    middles = (a + b + c) / 3.0
    radii = np.sqrt(np.max([np.sum((corner - middles) ** 2, axis=1) for corner in (a, b, c)], axis=0))
    return Gauge(rig, surface, rest, influences, triangles, middles, radii, flat, tensors)


def _product(first: Floats, second: Floats) -> Floats:
    """(…, 6) xx, yy, zz, xy, yz, zx of first times second."""
    return np.stack([first[..., i] * second[..., j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))], -1)


def posed(gauge: Gauge, clip: Clip | None, times: Floats, weights: Floats | None = None) -> tuple[Floats, Floats]:
    """Pose the welded vertices.

    Args:
        gauge: Of the surface.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        weights: (frames, morph targets) in place of the clip's.

    Returns:
        (frames, vertices, 3) world space and (frames, vertices) scale against rest, by which an animation makes the
        whole character larger.
    """
    rig, surface, rest = gauge.rig, gauge.surface, gauge.rest
    matrices = joint_matrices(rig, clip, times)
    weights = morph_weights(rig, clip, times) if weights is None else weights
    shape = (len(times), len(surface.positions))
    rows = matrices[:, :, :3, :].transpose(1, 0, 2, 3).reshape(len(rig.joints), -1)
    blended = (gauge.influences @ rows).reshape(shape[1], shape[0], 3, 4).transpose(1, 0, 2, 3)
    bind = surface.positions + np.tensordot(weights, surface.morph_deltas, axes=1)
    positions = np.einsum("fvab,fvb->fva", blended[..., :3], bind) + blended[..., 3]
    now, before = np.abs(np.linalg.det(matrices[..., :3, :3])), np.abs(np.linalg.det(rest.matrices[:, :3, :3]))
    ratios = np.cbrt(now / np.where(before > 0, before, 1.0))
    scales: Floats = (gauge.influences @ ratios.T).T
    return positions, scales


def strain(gauge: Gauge, clip: Clip | None, times: Floats) -> Floats:
    """(frames, triangles, 6) the loss tensor I − U of each triangle: its eigenvalues are 1 − σ, stretch is negative.

    Written in world space at rest, in the triangle's plane; a character that is scaled as a whole loses nothing.
    """
    positions, scales = posed(gauge, clip, times)
    a, b, c = (positions[:, gauge.triangles[:, k]] for k in range(3))
    scale = scales[:, gauge.triangles].mean(axis=2)
    hidden = scale < LEAST_SCALE
    length, along, across = gauge.flat.T
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
    tensors: Floats = np.einsum("ftk,tks->fts", flat, gauge.tensors)
    return tensors


def spread_sites(gauge: Gauge) -> Sites:
    """Spread sites over a surface, so far apart as its size and its triangles ask for."""
    corners = gauge.rest.positions[gauge.triangles]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.sqrt(np.sum(crosses**2, axis=1)) / 2.0
    edges = np.sqrt(np.max(np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=2), axis=1))
    size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    order = np.argsort(edges, kind="stable")
    total = np.cumsum(areas[order])
    typical = float(edges[order[np.searchsorted(total, total[-1] / 2.0)]])
    radius = max(_RADIUS * size, _OF_TRIANGLES * typical)
    while True:
        spacing = _SPACING * radius
        points, point_areas, parents = _points(corners, areas, edges, spacing)
        normals = unit(crosses)[parents]
        cell, count = _cells(points, normals, spacing)
        if count <= _MOST_SITES:
            break
        radius *= max(1.1, (count / _MOST_SITES) ** 0.5)
    site_areas = np.asarray(np.bincount(cell, point_areas, count), np.float64)

    def mean(values: Floats) -> Floats:
        sums = [np.bincount(cell, point_areas * values[:, k], count) for k in range(3)]
        return np.stack(sums, axis=1) / site_areas[:, None]

    positions, site_normals = mean(points), unit(mean(normals))
    near, smooth = _neighbours(positions, site_normals, site_areas, cell, gauge.triangles[parents], radius)
    gather = csr_array((point_areas / site_areas[cell], (cell, parents)), shape=(count, len(areas)))
    return Sites(positions, site_normals, site_areas, gather, smooth, near, radius, spacing)


def _points(corners: Floats, areas: Floats, edges: Floats, spacing: float) -> tuple[Floats, Floats, Ints]:
    """Centroids of equal parts of the triangles, no larger than the spacing: places, areas and triangles."""
    parts = np.clip(np.ceil(edges / spacing), 1, _MOST_PARTS).astype(np.intp)
    places, sizes, parents = [], [], []
    for k in np.unique(parts):
        chosen = np.flatnonzero(parts == k)
        i, j = (each.ravel() for each in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
        up = i + j < k
        down = i + j < k - 1
        first = np.concatenate([i[up] + 1 / 3, i[down] + 2 / 3]) / k
        second = np.concatenate([j[up] + 1 / 3, j[down] + 2 / 3]) / k
        shares = np.stack([1.0 - first - second, first, second], axis=1)
        places.append(np.einsum("pk,tkc->tpc", shares, corners[chosen]).reshape(-1, 3))
        sizes.append(np.repeat(areas[chosen] / k**2, k**2))
        parents.append(np.repeat(chosen, k**2))
    return np.concatenate(places), np.concatenate(sizes), np.concatenate(parents)


def _cells(points: Floats, normals: Floats, spacing: float) -> tuple[Ints, int]:
    """(points,) the same number for those of one cube that face one way, and how many numbers there are."""
    cubes = np.floor((points - points.min(axis=0)) / spacing).astype(np.intp)
    facing = np.argmax(np.abs(normals), axis=1)
    side = 2 * facing + (np.take_along_axis(normals, facing[:, None], 1)[:, 0] < 0)
    keys = np.concatenate([cubes, side[:, None]], axis=1)
    _, cell = np.unique(keys, axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    return cell, int(cell.max()) + 1


def _neighbours(
    positions: Floats, normals: Floats, areas: Floats, cell: Ints, corners: Ints, radius: float
) -> tuple[csr_array, csr_array]:
    """Which sites are neighbours, and the shares of those around each: over the surface, not through the air.

    Args:
        positions: (sites, 3)
        normals: (sites, 3)
        areas: (sites,)
        cell: (points,) the site of each.
        corners: (points, 3) the vertices of the triangle of each.
        radius: Scene units.

    Returns:
        (sites, sites) 1 where two lie within the radius, on triangles that touch, and look the same way; and
        (sites, sites) shares of those within the radius and three steps between neighbours, less the further away.
    """
    from scipy.sparse import eye_array
    from scipy.spatial import cKDTree

    count = len(positions)
    close = cKDTree(positions).query_pairs(radius, output_type="ndarray")
    pairs = close[np.einsum("pk,pk->p", normals[close[:, 0]], normals[close[:, 1]]) > _SAME_SHEET]
    _, vertices = np.unique(corners, return_inverse=True)
    touched = csr_array(
        (np.ones(corners.size, np.int32), (np.repeat(cell, 3), vertices.reshape(-1))),
        shape=(count, int(vertices.max()) + 1),
    )
    shared = touched[pairs[:, 0]].multiply(touched[pairs[:, 1]]).sum(axis=1)
    pairs = pairs[np.asarray(shared) > 0]
    near = _symmetric(pairs, np.ones(len(pairs), np.int32), count)
    hop = csr_array(near + eye_array(count, dtype=np.int32))
    reached = csr_array((hop @ hop @ hop) > 0)
    pairs = close[np.asarray(reached[close[:, 0], close[:, 1]]).reshape(-1).astype(bool)]
    squared = np.sum((positions[pairs[:, 0]] - positions[pairs[:, 1]]) ** 2, axis=1) / radius**2
    kernel = _symmetric(pairs, (1.0 - np.minimum(squared, 1.0)) ** 2, count) + eye_array(count)
    weights = csr_array(kernel.multiply(areas[None]))
    sums = np.asarray(weights.sum(axis=1)).reshape(-1)
    return near, csr_array(weights.multiply(1.0 / sums[:, None]))


def _symmetric(pairs: Ints, values: NDArray[Any], count: int) -> csr_array:
    """(count, count) of values at pairs, either way round."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    return csr_array((np.concatenate([values, values]), (both[:, 0], both[:, 1])), shape=(count, count))


def at_sites(gauge: Gauge, sites: Sites, clip: Clip | None, times: Floats) -> Floats:
    """(frames, sites, 6) the averaged loss tensor around each site."""
    tensors = strain(gauge, clip, times)
    rows = tensors.transpose(1, 0, 2).reshape(len(gauge.triangles), -1)
    averaged: Floats = (
        (sites.smooth @ (sites.gather @ rows)).reshape(len(sites.positions), len(times), 6).transpose(1, 0, 2)
    )
    return averaged


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


def scan(
    gauge: Gauge,
    sites: Sites,
    clips: Sequence[Clip],
    times: Sequence[Floats],
    progress: Callable[[int], None] = lambda _done: None,
) -> Peaks:
    """Find the greatest compression of each site over clips.

    Args:
        gauge: Of the surface.
        sites: On it.
        clips: The animations.
        times: Of each clip, (frames,) seconds.
        progress: Called with the number of poses done.
    """
    count = len(sites.positions)
    losses, poses = np.full(count, -np.inf), np.zeros(count, np.intp)
    done = 0
    for clip, part in _chunks(clips, times, max(1, _CHUNK // max(len(gauge.triangles), count))):
        found, _ = principal(at_sites(gauge, sites, clip, part), sites.normals)
        best = found.argmax(axis=0)
        highest = found[best, np.arange(count)]
        # Among equal ones the first stays, in whatever chunks they come.
        poses = np.where(highest > losses, done + best, poses)
        losses = np.maximum(losses, highest)
        done += len(part)
        progress(done)
    of_pose = tuple(clip for clip, part in zip(clips, times, strict=True) for _ in part)
    return Peaks(losses, poses, of_pose, np.concatenate([np.zeros(0), *times]))


def _chunks(clips: Sequence[Clip], times: Sequence[Floats], size: int) -> Iterator[tuple[Clip, Floats]]:
    for clip, every in zip(clips, times, strict=True):
        for start in range(0, len(every), size):
            yield clip, every[start : start + size]
