"""Regions of a surface that a pose compresses along one direction, each grown around its most compressed site."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints, unit
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.surface.sites import Sites
from wrinklecli.surface.strain import along_directions, principal

# A region ends where the loss falls to this part of its seed's: beyond, flesh bulges and does not fold, ...
_REGION_LOSS = 0.5
# ... where the surface turns away from its middle by this cosine, ...
_REGION_FACING = 0.25
# ... at this part of its length to either side, and of its width either way along: beyond, it is a row of folds.
_REGION_ASPECTS = (1.3, 0.9)
# Sites that a region has at least: of fewer, the mesh says too little.
_FEWEST_SITES = 4
# Sine of a normal with the plane x = 0 below which a region may be half of one across it: 68°, as at a temple.
_ALIGNED = 0.93
# Two halves are one region across the plane if what hangs together between them, and the other half, lose these parts
# of what the one loses.
_MIDDLE_LOSS, _HALF_LOSS = 0.15, 0.6
# Or if what is between them is as even as a forehead: least cosine of its normals with the mean.
_EVEN = 0.7
# Part of a region's loss left out at either end when its extent is measured.
_TAIL = 0.03
# Part of a mesh's area that must have its mirror image for the mesh to count as symmetric: clothes need not be.
_SYMMETRIC = 0.75


@dataclass(frozen=True, slots=True)
class Region:
    """Sites that a pose compresses along one direction.

    Attributes:
        members: (sites,) of the mesh.
        weights: (sites,) area times loss of each.
        centre: (3,) near the surface.
        normal: (3,) unit, mean.
        along: (3,) unit, the direction of the loss.
        length: Extent that way, scene units.
        width: Extent across, scene units.
        twin: Whether the other side of x = 0 is the same at rest.
        on_plane: Whether it is its own mirror image there.
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


def grow_region(
    mesh: MeasuredMesh, seed: int, tensors: Floats, free: Bools, *, twin: bool, across: bool
) -> Region | None:
    """The region around a seed that a pose compresses along the same direction.

    Two halves on either side of x = 0 that all but meet are one region, its own mirror image: a forehead, not two
    brows.

    Args:
        mesh: The mesh.
        seed: A site.
        tensors: (sites, 6) what the pose loses.
        free: (sites,) which may belong to it.
        twin: Whether the other side of x = 0 is the same at rest.
        across: Whether it may be one with that.
    """
    sites = mesh.sites
    grown = _grow(sites, seed, tensors, free, twin)
    if grown is None or len(grown.members) < _FEWEST_SITES:
        return None
    weights, normal, along = grown.weights, grown.normal, grown.along
    places = sites.positions[grown.members]
    centre = weights @ places / float(weights.sum())
    on_plane = twin and across and _is_across(sites, grown, centre, tensors)
    across_it = bool(on_plane and abs(along[0]) > 0.5**0.5)
    if on_plane:
        # A fold that is its own mirror image: made exactly so.
        flattened = np.array([0.0, 1.0, 1.0])
        places = np.concatenate([places, places * [-1.0, 1.0, 1.0]])
        weights = np.concatenate([weights, weights])
        centre, normal = centre * flattened, unit(normal * flattened)
        along = np.array([1.0, 0.0, 0.0]) if across_it else unit(along * flattened)
        along = unit(along - (along @ normal) * normal)
    sideways = np.cross(normal, along)
    (low, high), (left, right) = (_extent((places - centre) @ axis, weights) for axis in (along, sideways))
    middle = (low + high) / 2.0 * along * (not across_it) + (left + right) / 2.0 * sideways * (
        across_it or not on_plane
    )
    return Region(
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
class _Grown:
    """Sites around a seed that a pose compresses, as `Region` has them."""

    members: Ints
    weights: Floats
    normal: Floats
    along: Floats


def _grow(sites: Sites, seed: int, tensors: Floats, free: Bools, twin: bool) -> _Grown | None:
    """Sites connected to a seed that lose length along its direction, then along theirs; none where none is lost."""
    losses, directions = principal(tensors[seed][None], sites.normals[seed][None])
    place, normal, along = sites.positions[seed], sites.normals[seed], directions[0]
    level = _REGION_LOSS * float(losses[0])
    x = place[0]
    # Each side of a pair keeps to itself; a seed on the plane has the region on both sides.
    allowed = free & (sites.positions[:, 0] * np.sign(x) > -0.5 * sites.spacing) if twin else free
    if abs(x) <= sites.radius:
        allowed = free
    members, weights = np.array([seed]), np.ones(1)
    reaches = (np.inf, np.inf)
    for _ in range(3):
        lost = along_directions(tensors, sites.normals, along)
        across = np.cross(normal, along)
        sideways, ahead = (sites.positions - place) @ across, (sites.positions - place) @ along
        inside = allowed & (lost >= level) & (sites.normals @ normal > _REGION_FACING)
        inside &= (np.abs(sideways) <= reaches[0]) & (np.abs(ahead) <= reaches[1])
        inside[seed] = True
        members = _connected(sites, inside, seed)
        weights = sites.areas[members] * np.maximum(lost[members], 0.0)
        total = float(weights.sum())
        normal = unit(weights @ sites.normals[members])
        if not total > 0 or not normal.any():
            return None
        _, found = principal((weights @ tensors[members] / total)[None], normal[None])
        along = found[0]
        reaches = (
            _REGION_ASPECTS[0] * _thickness(sites, ahead[members], sideways[members], weights),
            _REGION_ASPECTS[1] * _thickness(sites, sideways[members], ahead[members], weights),
        )
    return _Grown(members, weights, normal, along)


def _is_across(sites: Sites, grown: _Grown, centre: Floats, tensors: Floats) -> bool:
    """Whether what was grown on one side of x = 0 is half of a region across it."""
    if abs(grown.normal[0]) > _ALIGNED:
        return False
    sideways = abs(grown.along[0]) > 0.5**0.5
    flattened = np.array([1.0, 0.0, 0.0]) if sideways else unit(grown.along * [0.0, 1.0, 1.0])
    outward = unit(grown.normal * [0.0, 1.0, 1.0])
    lost = along_directions(tensors, sites.normals, flattened)
    start = int(grown.members[lost[grown.members].argmax()])
    own = float(lost[start])
    other = np.sum((sites.positions - centre * [-1.0, 1.0, 1.0]) ** 2, axis=1)
    if lost[other < max(float(other.min()), sites.radius**2)].max() < _HALF_LOSS * own:
        return False
    inside = (lost >= _MIDDLE_LOSS * own) & (sites.normals @ outward > 0.0)
    inside[start] = True
    between = _connected(sites, inside, start)
    hangs_together = bool((np.abs(sites.positions[between, 0]) < sites.radius).any())
    return hangs_together or (not sideways and _is_smooth(sites, grown, centre, flattened, outward))


def _is_smooth(sites: Sites, grown: _Grown, centre: Floats, along: Floats, outward: Floats) -> bool:
    """Whether the surface between two halves is an even one, such as a forehead, without a nose or a gap."""
    near, far = _extent(np.abs(sites.positions[grown.members, 0]), grown.weights)
    relative = sites.positions - centre * [0.0, 1.0, 1.0]
    low, high = _extent(relative[grown.members] @ along, grown.weights)
    ahead = relative @ along
    band = (np.abs(sites.positions[:, 0]) <= near) & (ahead >= low) & (ahead <= high)
    band &= np.abs(relative @ outward) < far
    x = np.sort(sites.positions[band, 0])
    if not len(x) or np.diff(x, prepend=-near, append=near).max() > sites.radius:
        return False
    return bool((sites.normals[band] @ outward).min() > _EVEN)


def _thickness(sites: Sites, along: Floats, aside: Floats, weights: Floats) -> float:
    """Extent along one axis of the members that lie on it, but two radii at least."""
    middle = np.abs(aside) <= 1.5 * sites.spacing
    low, high = _extent(along[middle], weights[middle])
    return max(high - low + sites.spacing, 2.0 * sites.radius)


def _connected(sites: Sites, inside: Bools, seed: int) -> Ints:
    """Those of some sites that neighbours connect to a seed, ascending."""
    from scipy.sparse.csgraph import breadth_first_order

    chosen = np.flatnonzero(inside)
    graph = sites.near[chosen][:, chosen]
    start = int(np.searchsorted(chosen, seed))
    return np.sort(chosen[breadth_first_order(graph, start, directed=False, return_predecessors=False)])


def _extent(values: Floats, weights: Floats) -> tuple[float, float]:
    """Between which values lies all but a tail of the weight at either end."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    low, high = np.searchsorted(total, np.array([_TAIL, 1.0 - _TAIL]) * total[-1])
    return float(values[order[low]]), float(values[order[min(int(high), len(order) - 1)]])


def sites_with_twins(mesh: MeasuredMesh) -> Bools:
    """(sites,) whether the place across x = 0 is a site too; none of a lop-sided mesh.

    Whatever the clips do: an artist gives both arms the same, and a game plays clips that the file has not.
    """
    from scipy.spatial import cKDTree

    sites = mesh.sites
    distances, others = cKDTree(sites.positions).query(sites.positions * [-1.0, 1.0, 1.0])
    facing = np.sum(sites.normals * sites.normals[others] * [-1.0, 1.0, 1.0], axis=1) > 0.5
    matched = (distances < sites.spacing) & facing
    symmetric = sites.areas @ matched > _SYMMETRIC * sites.areas.sum()
    return np.asarray(symmetric & matched)


def is_buried(sites: Sites, region: Region) -> bool:
    """Whether a region looks at another part of the surface that is nearer than its own length."""
    ahead = sites.positions - region.centre
    heights = ahead @ region.normal
    aside = np.sqrt(np.maximum(np.sum(ahead**2, axis=1) - heights**2, 0.0))
    before = (heights > 0) & (heights < region.length) & (aside < 0.5 * heights)
    return bool((before & (sites.normals @ region.normal < -0.3)).any())
