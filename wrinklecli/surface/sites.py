"""Sites: points spread evenly over a surface; the strain around each, and the pose that compresses it most.

Triangles are uneven, and the strain of single ones is noisy. So the loss tensor is averaged over a small neighbourhood.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from wrinklecli.character.clip import Clip
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, diagonal, distinct, face_normals, unit, weighted_quantiles
from wrinklecli.numeric.closest import pairs_within
from wrinklecli.numeric.portions import portions
from wrinklecli.numeric.processes import in_processes
from wrinklecli.surface.strain import Gauge, StrainedPart, greatest_losses, strain

# Radius of the neighbourhood over which strain is averaged, as a part of the diagonal of the mesh's box: 27 mm on a
# person.
_RADIUS = 0.015
# Least radius over a typical triangle's longest edge: a smaller one would show single triangles.
_RADIUS_OF_TRIANGLES = 0.6
# Distance of neighbouring sites over that radius: a neighbourhood then has about a dozen sites.
_SPACING = 0.5
# Most sites of a mesh, which is measured in seconds; the radius grows where there would be more.
_MOST_SITES = 12_000
# Most parts into which an edge of a triangle is divided for sampling.
_MOST_PARTS = 8
# Least cosine of the normals of two near points of one sheet; the two sides of a thin sheet have less.
_SAME_SHEET = 0.3
# Triangles times poses worth a process of its own, of half a second; to begin one takes a twentieth.
_WORK_OF_PROCESS = 1_500_000


@dataclass(frozen=True, slots=True)
class Sites:
    """Points spread evenly over a surface at rest.

    Attributes:
        gauge: Measures the strain of the surface.
        positions: (sites, 3) world space at rest.
        normals: (sites, 3) unit.
        areas: (sites,) area of the surface around each, scene units squared; their sum is the surface's area.
        pieces: (sites,) the connected piece that each is on, as `Gauge` numbers them.
        gather: (sites, triangles) weights for averaging triangles at each site; rows sum to 1.
        smooth: (sites, sites) weights for averaging each site's neighbourhood; rows sum to 1.
        near: (sites, sites) 1 for neighbours on one sheet of the surface.
        radius: Radius of the neighbourhoods, scene units.
        spacing: Approximate distance of two neighbours, scene units.
    """

    gauge: Gauge
    positions: Floats
    normals: Floats
    areas: Floats
    pieces: Ints
    gather: csr_array
    smooth: csr_array
    near: csr_array
    radius: float
    spacing: float


@dataclass(frozen=True, slots=True)
class Peaks:
    """The greatest compression of each site over some poses.

    Attributes:
        losses: (sites,) 1 − σ of the averaged strain; negative for sites that are only stretched.
        poses: (sites,) number of the pose with this loss.
        clips: (poses,)
        times: (poses,) seconds.
    """

    losses: Floats
    poses: Ints
    clips: tuple[Clip, ...]
    times: Floats


def spread_sites(gauge: Gauge) -> Sites:
    """Spread sites over a surface, as far apart as its size and its triangles require."""
    corners = gauge.rest.positions[gauge.triangles]
    crosses = gauge.rest.way * face_normals(gauge.rest.positions, gauge.triangles)
    areas = np.sqrt(np.sum(crosses**2, axis=1)) / 2.0
    edges = np.sqrt(np.max(np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=2), axis=1))
    size = diagonal(corners.reshape(-1, 3))
    typical = float(weighted_quantiles(edges, areas, np.array([0.5]))[0])
    radius = max(_RADIUS * size, _RADIUS_OF_TRIANGLES * typical)
    while True:
        spacing = _SPACING * radius
        points, point_areas, parents = _points(corners, areas, edges, spacing)
        normals = unit(crosses)[parents]
        cell, count = _cells(points, normals, gauge.pieces[parents], spacing)
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
    pieces = np.zeros(count, np.intp)
    pieces[cell] = gauge.pieces[parents]
    return Sites(gauge, positions, site_normals, site_areas, pieces, gather, smooth, near, radius, spacing)


def _points(corners: Floats, areas: Floats, edges: Floats, spacing: float) -> tuple[Floats, Floats, Ints]:
    """Divide triangles into equal parts no longer than the spacing.

    Returns:
        (points, 3) centroids of the parts, (points,) their areas, and (points,) the triangle of each.
    """
    parts = np.clip(np.ceil(edges / spacing), 1, _MOST_PARTS).astype(np.intp)
    places, sizes, parents = [], [], []
    for k in np.unique(parts):
        chosen = np.flatnonzero(parts == k)
        i, j = (each.ravel() for each in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
        up = i + j < k
        down = i + j < k - 1
        first = np.concatenate([i[up] + 1 / 3, i[down] + 2 / 3]) / k
        second = np.concatenate([j[up] + 1 / 3, j[down] + 2 / 3]) / k
        barycentrics = np.stack([1.0 - first - second, first, second], axis=1)
        places.append(np.einsum("pk,tkc->tpc", barycentrics, corners[chosen]).reshape(-1, 3))
        sizes.append(np.repeat(areas[chosen] / k**2, k**2))
        parents.append(np.repeat(chosen, k**2))
    return np.concatenate(places), np.concatenate(sizes), np.concatenate(parents)


def _cells(points: Floats, normals: Floats, pieces: Ints, spacing: float) -> tuple[Ints, int]:
    """(points,) a number for each cube, piece and direction that points face; and how many numbers there are."""
    cubes = np.floor((points - points.min(axis=0)) / spacing).astype(np.intp)
    facing = np.argmax(np.abs(normals), axis=1)
    side = 2 * facing + (np.take_along_axis(normals, facing[:, None], 1)[:, 0] < 0)
    keys = np.concatenate([cubes, side[:, None], pieces[:, None]], axis=1)
    firsts, cell = distinct(keys)
    return cell, len(firsts)


def _neighbours(
    positions: Floats, normals: Floats, areas: Floats, cell: Ints, corners: Ints, radius: float
) -> tuple[csr_array, csr_array]:
    """Find (sites, sites) `near` and `smooth` of `Sites`, over the surface and not through the air.

    Neighbours are on triangles that touch and face the same way. A site's neighbourhood has the sites within the radius
    and within three steps between neighbours. Points have (points,) cells, which are sites, and (points, 3) corners of
    their triangles.
    """
    from scipy.sparse import eye_array

    count = len(positions)
    close = pairs_within(positions, radius)
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
    if len(close):  # scipy has a sparse array for none
        close = close[np.asarray(reached[close[:, 0], close[:, 1]]).reshape(-1).astype(bool)]
    pairs = close
    squared = np.sum((positions[pairs[:, 0]] - positions[pairs[:, 1]]) ** 2, axis=1) / radius**2
    kernel = _symmetric(pairs, (1.0 - np.minimum(squared, 1.0)) ** 2, count) + eye_array(count)
    weights = csr_array(kernel.multiply(areas[None]))
    sums = np.asarray(weights.sum(axis=1)).reshape(-1)
    return near, csr_array(weights.multiply(1.0 / sums[:, None]))


def _symmetric(pairs: Ints, values: NDArray[Any], count: int) -> csr_array:
    """(count, count) matrix with (pairs,) values at (pairs, 2) and at the transposed places."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    return csr_array((np.concatenate([values, values]), (both[:, 0], both[:, 1])), shape=(count, count))


def at_sites(sites: Sites, clip: Clip | None, times: Floats) -> Floats:
    """(frames, sites, 6) the averaged loss tensor around each site; None for the stored pose."""
    area = _strained_area(sites, clip)
    averaged = np.zeros((len(times), len(sites.positions), 6))
    averaged[:, area.sites] = _averaged(sites.gauge, area, clip, times)
    return averaged


@dataclass(frozen=True, slots=True)
class _StrainedArea:
    """The sites around which a clip can strain the surface.

    Attributes:
        part: The triangles that it can strain; None for all.
        sites: (area,) numbers of the sites.
        gather: (touched sites, triangles of the part), rows and columns of `Sites.gather`.
        smooth: (area, touched sites), rows and columns of `Sites.smooth`.
    """

    part: StrainedPart | None
    sites: Ints
    gather: csr_array
    smooth: csr_array


def _strained_area(sites: Sites, clip: Clip | None) -> _StrainedArea:
    # One joint strains little of a character.
    part = None if clip is None else sites.gauge.strained.of(clip)
    if part is None:
        return _StrainedArea(None, np.arange(len(sites.positions)), sites.gather, sites.smooth)
    gather = sites.gather[:, part.triangles]
    touched = np.flatnonzero(np.diff(gather.indptr))
    smooth = sites.smooth[:, touched]
    inside = np.flatnonzero(np.diff(smooth.indptr))
    return _StrainedArea(part, inside, gather[touched], smooth[inside])


def _averaged(gauge: Gauge, area: _StrainedArea, clip: Clip | None, times: Floats) -> Floats:
    """(frames, area, 6) the averaged loss tensor around each site of the area."""
    tensors = strain(gauge, clip, times, area.part)
    rows = tensors.transpose(1, 0, 2).reshape(tensors.shape[1], 6 * len(times))
    return np.asarray((area.smooth @ (area.gather @ rows)).reshape(len(area.sites), len(times), 6).transpose(1, 0, 2))


def find_peaks(
    sites: Sites,
    clips: Sequence[Clip],
    times: Sequence[Floats],
    progress: Callable[[int], None] = lambda _done: None,
    *,
    jobs: int = 1,
) -> Peaks:
    """Find the greatest compression of each site over clips, each at (frames,) times, seconds.

    `progress` is called with the number of poses done, and up to `jobs` processes measure them.
    """
    work = len(sites.gauge.triangles) * sum(map(len, times))
    count = max(1, min(jobs, len(clips), work // _WORK_OF_PROCESS))
    ends = np.linspace(0, len(clips), count + 1).astype(np.intp)
    runs = [slice(first, last) for first, last in pairwise(ends.tolist())]
    # Other processes cannot say here how far they are.
    told = progress if count == 1 else lambda _done: None
    found = in_processes(lambda run: _highest(sites, clips[run], times[run], told), runs, count)
    losses, poses, done = np.full(len(sites.positions), -np.inf), np.zeros(len(sites.positions), np.intp), 0
    for run, (highest, first) in zip(runs, found, strict=True):
        # Of poses with equal losses the first one counts, however many processes there are.
        poses = np.where(highest > losses, done + first, poses)
        losses = np.maximum(losses, highest)
        done += sum(map(len, times[run]))
        progress(done)
    of_pose = tuple(clip for clip, every in zip(clips, times, strict=True) for _ in every)
    return Peaks(losses, poses, of_pose, np.concatenate([np.zeros(0), *times]))


def _highest(
    sites: Sites, clips: Sequence[Clip], times: Sequence[Floats], progress: Callable[[int], None]
) -> tuple[Floats, Ints]:
    """(sites,) greatest losses over clips, and the (sites,) numbers of their poses."""
    count = len(sites.positions)
    losses, poses = np.full(count, -np.inf), np.zeros(count, np.intp)
    done, area = 0, _strained_area(sites, None)
    for clip, every in zip(clips, times, strict=True):
        # Consecutive clips often move the same joint, and strain the same area.
        if sites.gauge.strained.of(clip) is not area.part:
            area = _strained_area(sites, clip)
        for chunk in (every[part] for part in portions(len(every), max(area.gather.shape[1], len(area.sites)))):
            found = greatest_losses(_averaged(sites.gauge, area, clip, chunk), sites.normals[area.sites])
            best = found.argmax(axis=0)
            highest, first = np.zeros(count), np.zeros(count, np.intp)
            highest[area.sites], first[area.sites] = found[best, np.arange(len(area.sites))], best
            poses = np.where(highest > losses, done + first, poses)
            losses = np.maximum(losses, highest)
            done += len(chunk)
            progress(done)
    return losses, poses
