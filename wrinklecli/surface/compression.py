"""Regions of a surface that a pose compresses along one direction, each grown around its most compressed site.

Compression concentrates at *summits* of the loss; the *basin* of a summit has the sites whose slopes lead up to it. A
slope that leads up to a deeper fold, such as the upper arm beside a bent elbow, is part of that fold, as flesh bulges
there. So is a summit that hardly rises above the saddle between them.

Source: H. Edelsbrunner, J. Harer, *Computational Topology*, 2010, §VII: watersheds merged by persistence.
"""

import numpy as np
from scipy.sparse import csr_array

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, root_of, unit, weighted_quantiles
from wrinklecli.numeric.closest import nearest_of
from wrinklecli.surface.sites import Sites
from wrinklecli.surface.strain import along_directions, principal

# Least rise of a summit above the saddle to a higher one, as a part of its loss: a lower summit is merged.
_PROMINENCE = 0.3
# A region ends where the loss falls to this part of its seed's: beyond, flesh bulges and does not fold, ...
REGION_LOSS = 0.5
# ... where the cosine of the surface's normal and the region's falls to this, ...
REGION_FACING = 0.25
# ... at this multiple of its length to either side of the seed, ...
_REGION_ASIDE = 1.3
# ... or at this multiple of its width ahead of the seed and behind: beyond is a row of folds.
_REGION_AHEAD = 0.9
# Least number of sites of a region: fewer say too little.
FEWEST_SITES = 4
# Part of the spacing of sites by which one half of a pair may extend beyond x = 0.
_OVERHANG = 0.5
# Distance from an axis over the spacing of sites, at most, of members that lie on the axis.
_ON_AXIS = 1.5
# Part of a region's loss left out at either end when its extent is measured.
_TAIL = 0.03
# Greatest |x| of a unit normal, 68° from the plane x = 0, at which a region may cross that plane, as at a temple.
_MOST_SIDEWAYS = 0.93
# Least |x| of a unit direction along x: 45°.
_ALONG_X = 0.5**0.5
# Two halves are one region across x = 0 if the surface between them loses this part of the one half's loss ...
_MIDDLE_LOSS = 0.15
# ... and the other half this part; ...
_HALF_LOSS = 0.6
# ... or if the normals between them have at least this cosine with the mean, as on a forehead.
_EVEN = 0.7
# Part of a mesh's area that must have its mirror image for the mesh to count as symmetric: clothes are not quite.
_SYMMETRIC = 0.75
# Least cosine of the normals of a site and of its mirror image.
_TWIN_FACING = 0.5


@dataclass(frozen=True, slots=True)
class CompressedRegion:
    """Sites that a pose compresses along one direction.

    Attributes:
        members: (members,) numbers of the sites.
        weights: (members,) area times loss, scene units squared.
        centre: (3,) near the surface.
        normal: (3,) unit, the mean.
        along: (3,) unit, the direction of the loss.
        length: Extent in this direction, scene units.
        width: Extent across, scene units.
        twin: True if the surface has the mirror image across x = 0 at rest.
        on_plane: True if the region is its own mirror image across x = 0.
    """

    members: Ints
    weights: Floats
    centre: Floats
    normal: Floats
    along: Floats
    length: float
    width: float
    twin: bool
    on_plane: bool


def basins(losses: Floats, near: csr_array, least: float) -> Ints:
    """(sites,) number of the site that is the summit of each site's basin; -1 for losses below the least.

    `losses` are (sites,), and `near` is (sites, sites), nonzero for neighbours.
    """
    order = np.argsort(-losses, kind="stable")
    order = order[losses[order] >= least]
    summits = np.full(len(losses), -1, np.intp)
    merged: dict[int, int] = {}  # from each summit to the one that it is merged into

    for site in order.tolist():
        around = summits[near.indices[near.indptr[site] : near.indptr[site + 1]]]
        known = {root_of(merged, int(summit)) for summit in np.unique(around[around >= 0])}
        # Of equally high summits the first one counts.
        highest = min(known, key=lambda summit: (-losses[summit], summit), default=site)
        merged.setdefault(highest, highest)
        summits[site] = highest
        for other in known:
            if losses[other] - losses[site] < _PROMINENCE * losses[other]:
                merged[other] = highest
    return np.array([root_of(merged, int(summit)) if summit >= 0 else -1 for summit in summits], np.intp)


def grow_region(
    sites: Sites, seed: int, tensors: Floats, free: Bools, *, twin: bool, across: bool
) -> CompressedRegion | None:
    """Grow the region around a seed that a pose compresses along one direction.

    Two halves on either side of x = 0 that almost meet are one region, its own mirror image: a forehead, not two brows.

    Args:
        sites: Points of the surface.
        seed: Number of a site.
        tensors: (sites, 6) loss tensors of the pose.
        free: (sites,) True for sites that may belong to the region.
        twin: True if the surface has the mirror image of the seed at rest.
        across: True if the region may extend across x = 0.

    Returns:
        None if too few sites belong to the region.
    """
    grown = _grow(sites, seed, tensors, free, twin)
    if grown is None or len(grown.members) < FEWEST_SITES:
        return None
    weights, normal, along = grown.weights, grown.normal, grown.along
    places = sites.positions[grown.members]
    centre = weights @ places / float(weights.sum())
    on_plane = twin and across and _is_half(sites, grown, centre, tensors)
    along_x = bool(on_plane and abs(along[0]) > _ALONG_X)
    if on_plane:
        # Made exactly symmetric.
        flattened = np.array([0.0, 1.0, 1.0])
        places = np.concatenate([places, places * [-1.0, 1.0, 1.0]])
        weights = np.concatenate([weights, weights])
        centre, normal = centre * flattened, unit(normal * flattened)
        along = np.array([1.0, 0.0, 0.0]) if along_x else unit(along * flattened)
        along = unit(along - (along @ normal) * normal)
    sideways = np.cross(normal, along)
    (low, high), (left, right) = (extent((places - centre) @ axis, weights) for axis in (along, sideways))
    middle = (low + high) / 2.0 * along * (not along_x) + (left + right) / 2.0 * sideways * (along_x or not on_plane)
    return CompressedRegion(
        members=grown.members,
        weights=grown.weights,
        centre=centre + middle,
        normal=normal,
        along=along,
        length=high - low + sites.spacing,
        width=right - left + sites.spacing,
        twin=twin,
        on_plane=on_plane,
    )


@dataclass(frozen=True, slots=True)
class _GrownSites:
    """Sites around a seed, with attributes as in `CompressedRegion`."""

    members: Ints
    weights: Floats
    normal: Floats
    along: Floats


def _grow(sites: Sites, seed: int, tensors: Floats, free: Bools, twin: bool) -> _GrownSites | None:
    """Connect sites to a seed that lose length along its direction, then along their own mean direction."""
    losses, directions = principal(tensors[seed][None], sites.normals[seed][None])
    place, normal, along = sites.positions[seed], sites.normals[seed], directions[0]
    level = REGION_LOSS * float(losses[0])
    x = place[0]
    allowed = free
    if twin and abs(x) > sites.radius:
        # Each half of a pair stays on its side.
        allowed = free & (sites.positions[:, 0] * np.sign(x) > -_OVERHANG * sites.spacing)
    members, weights = np.array([seed]), np.ones(1)
    most_aside = most_ahead = np.inf
    for _ in range(3):
        lost = along_directions(tensors, sites.normals, along)
        across = np.cross(normal, along)
        aside, ahead = (sites.positions - place) @ across, (sites.positions - place) @ along
        inside = allowed & (lost >= level) & (sites.normals @ normal > REGION_FACING)
        inside &= (np.abs(aside) <= most_aside) & (np.abs(ahead) <= most_ahead)
        inside[seed] = True
        members = connected_sites(sites, inside, seed)
        weights = sites.areas[members] * np.maximum(lost[members], 0.0)
        total = float(weights.sum())
        normal = unit(weights @ sites.normals[members])
        if not total > 0 or not normal.any():
            return None
        _, found = principal((weights @ tensors[members] / total)[None], normal[None])
        along = found[0]
        most_aside = _REGION_ASIDE * _thickness(sites, ahead[members], aside[members], weights)
        most_ahead = _REGION_AHEAD * _thickness(sites, aside[members], ahead[members], weights)
    return _GrownSites(members, weights, normal, along)


def _is_half(sites: Sites, grown: _GrownSites, centre: Floats, tensors: Floats) -> bool:
    """True if the sites, grown on one side of x = 0, are half of a region across that plane."""
    if abs(grown.normal[0]) > _MOST_SIDEWAYS:
        return False
    along_x = abs(grown.along[0]) > _ALONG_X
    along = np.array([1.0, 0.0, 0.0]) if along_x else unit(grown.along * [0.0, 1.0, 1.0])
    outward = unit(grown.normal * [0.0, 1.0, 1.0])
    lost = along_directions(tensors, sites.normals, along)
    start = int(grown.members[lost[grown.members].argmax()])
    own = float(lost[start])
    other = np.sum((sites.positions - centre * [-1.0, 1.0, 1.0]) ** 2, axis=1)
    # The centre of a region round a tube lies within the tube, where no site may be within the radius.
    if lost[other <= max(float(other.min()), sites.radius**2)].max() < _HALF_LOSS * own:
        return False
    inside = (lost >= _MIDDLE_LOSS * own) & (sites.normals @ outward > 0.0)
    inside[start] = True
    between = connected_sites(sites, inside, start)
    connected = bool((np.abs(sites.positions[between, 0]) < sites.radius).any())
    return connected or (not along_x and _is_even(sites, grown, centre, along, outward))


def _is_even(sites: Sites, grown: _GrownSites, centre: Floats, along: Floats, outward: Floats) -> bool:
    """True if the surface between two halves is even, as a forehead is, without a nose or a gap."""
    near, far = extent(np.abs(sites.positions[grown.members, 0]), grown.weights)
    relative = sites.positions - centre * [0.0, 1.0, 1.0]
    low, high = extent(relative[grown.members] @ along, grown.weights)
    ahead = relative @ along
    band = (np.abs(sites.positions[:, 0]) <= near) & (ahead >= low) & (ahead <= high)
    band &= np.abs(relative @ outward) < far
    x = np.sort(sites.positions[band, 0])
    if not len(x) or np.diff(x, prepend=-near, append=near).max() > sites.radius:
        return False
    return bool((sites.normals[band] @ outward).min() > _EVEN)


def _thickness(sites: Sites, along: Floats, aside: Floats, weights: Floats) -> float:
    """Extent along an axis of the members that lie on the axis; at least two radii, scene units."""
    middle = np.abs(aside) <= _ON_AXIS * sites.spacing
    low, high = extent(along[middle], weights[middle])
    return max(high - low + sites.spacing, 2.0 * sites.radius)


def connected_sites(sites: Sites, inside: Bools, seed: int) -> Ints:
    """(members,) sorted numbers of the sites inside that neighbours connect to the seed."""
    from scipy.sparse.csgraph import breadth_first_order

    chosen = np.flatnonzero(inside)
    graph = sites.near[chosen][:, chosen]
    start = int(np.searchsorted(chosen, seed))
    return np.sort(chosen[breadth_first_order(graph, start, directed=False, return_predecessors=False)])


def extent(values: Floats, weights: Floats) -> tuple[float, float]:
    """Bounds of the values, without a tail of the weight at either end."""
    low, high = weighted_quantiles(values, weights, np.array([_TAIL, 1.0 - _TAIL]))
    return float(low), float(high)


def sites_with_twins(sites: Sites) -> Bools:
    """(sites,) True if the mirror image across x = 0 is a site too; all False for an asymmetric mesh.

    Clips do not matter: an artist wrinkles both arms alike, and a game plays clips that the file lacks.
    """
    distances, others = nearest_of(sites.positions, sites.positions * [-1.0, 1.0, 1.0])
    facing = np.sum(sites.normals * sites.normals[others] * [-1.0, 1.0, 1.0], axis=1) > _TWIN_FACING
    matched = (distances < sites.spacing) & facing
    symmetric = sites.areas @ matched > _SYMMETRIC * sites.areas.sum()
    return np.asarray(symmetric & matched)


def triangle_weights(sites: Sites, region: CompressedRegion) -> Floats:
    """(triangles,) the part of a region's loss in each triangle of the gauge; their sum is 1."""
    losses = np.asarray((region.weights @ sites.smooth[region.members]) @ sites.gather)
    return np.asarray(losses / losses.sum())
