"""Folds of a moving surface: the regions that a pose compresses most, and the segment across each.

Greedy: from the site that a clip compresses most, the region around it that the same pose compresses along the same
direction; then the next, among the sites that belong to none. A segment's ends are those between which poses lose most
of its length, on a walk over the surface from the region's middle.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, morph_weights, node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.method.rest import Rest
from wrinklecli.numeric.arrays import Bools, Floats, Ints, unit
from wrinklecli.numeric.nearest import closest_point
from wrinklecli.review.suggest.strain import (
    Gauge,
    Peaks,
    Sites,
    along_directions,
    at_sites,
    posed,
    principal,
)

# Regions that are looked into, of a mesh.
_MOST_REGIONS = 50
# Poses that are kept while looking: many regions share one, and one of a large mesh takes 50 MB.
_KNOWN_POSES = 8
# A site must lose this part of its length to be looked into.
LEAST_LOSS = 0.15
# A region ends where the loss falls to this part of its seed's, ...
_REGION_LOSS = 0.33
# ... where the surface turns away from its middle by this cosine, ...
_REGION_FACING = 0.25
# ... at this part of its length to either side, and of its width either way along: beyond, it is a row of folds.
_REGION_ASPECTS = (1.3, 0.9)
# Sites that a region has at least: of fewer, the mesh says too little.
_FEWEST_SITES = 4
# Sine of a direction with the plane x = 0 below which it lies in it.
_ALIGNED = 0.35
# Part of a region's loss left out at either end when its extent is measured.
_TAIL = 0.03
# A region that looks at another part of the surface nearer than its own length is a fold at rest already (the crotch,
# the inside of a lip): nobody sees its wrinkles, so little of its score counts.
_BURIED_SCORE = 0.2


@dataclass(frozen=True, slots=True)
class MeasuredMesh:
    """A deforming mesh, measured over the clips that move it.

    Attributes:
        rig: What moves it.
        surface: The mesh, welded.
        rest: Its stored pose.
        gauge: What measures it.
        sites: On it.
        clips: Those that move it.
        times: Of each clip, (frames,) seconds.
        peaks: The greatest compression of each site over the clips.
        node: The name of its node as a tool must give it; None where it may be left out.
        flat: Whether it has no normals, so that it is shaded flat.
    """

    rig: Rig
    surface: Surface
    rest: Rest
    gauge: Gauge
    sites: Sites
    clips: tuple[Clip, ...]
    times: tuple[Floats, ...]
    peaks: Peaks
    node: str | None
    flat: bool


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
        twin: Whether the other side of x = 0 is compressed likewise.
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


@dataclass(frozen=True, slots=True)
class Fold:
    """A segment across a region.

    Attributes:
        mesh: The mesh.
        region: On it.
        clip: The animation that compresses the region.
        time: When most, seconds.
        origin: (3,) one end, on the surface, world space at rest.
        target: (3,) the other.
        score: What the region loses, area times 1 − σ, scene units squared; less where nobody sees it.
    """

    mesh: MeasuredMesh
    region: Region
    clip: Clip
    time: float
    origin: Floats
    target: Floats
    score: float


def pose_unscaled(mesh: MeasuredMesh, clip: Clip | None, time: float, weights: Floats | None = None) -> Floats:
    """(vertices, 3) a pose with animated scale taken out; (1, morph targets) weights replace the clip's."""
    positions, scales = posed(mesh.gauge, clip, np.array([time]), weights)
    pose: Floats = positions[0] / np.where(scales[0] > LEAST_SCALE, scales[0], 1.0)[:, None]
    return pose


def find_folds(mesh: MeasuredMesh, progress: Callable[[float], None] = lambda _share: None) -> Iterator[Fold]:
    """Segments across the regions of a mesh that are compressed most, none within another's region.

    Args:
        mesh: The mesh.
        progress: Called with the share of the work that is done.
    """
    peaks, sites = mesh.peaks, mesh.sites
    free = np.ones(len(sites.positions), bool)
    twins = _twins(mesh)
    known: dict[int, tuple[Floats, Floats]] = {}
    for step in range(_MOST_REGIONS):
        progress(step / _MOST_REGIONS)
        seed = int(np.where(free, peaks.losses, -np.inf).argmax())
        if not free[seed] or peaks.losses[seed] < LEAST_LOSS:
            break
        pose = int(peaks.poses[seed])
        clip, time = peaks.clips[pose], peaks.times[pose : pose + 1]
        if pose not in known:
            if len(known) == _KNOWN_POSES:
                known.clear()
            known[pose] = at_sites(mesh.gauge, sites, clip, time)[0], pose_unscaled(mesh, clip, float(time[0]))
        tensors, now = known[pose]
        region = _grow(mesh, seed, tensors, free, bool(twins[seed]))
        free[seed] = False
        if region is None:
            continue
        free[region.members] = False
        ends = lay(mesh, region, [now])
        if ends is None:
            continue
        score = float(region.weights.sum()) * (_BURIED_SCORE if _buried(sites, region) else 1.0)
        yield Fold(mesh, region, clip, float(time[0]), *ends, score)


# Part of a mesh's area that must have its mirror image for the mesh to count as symmetric: clothes need not be.
_SYMMETRIC = 0.75


def _twins(mesh: MeasuredMesh) -> Bools:
    """(sites,) whether the place across x = 0 is a site too and is compressed likewise; none of a lop-sided mesh."""
    from scipy.spatial import cKDTree

    sites, losses = mesh.sites, mesh.peaks.losses
    distances, others = cKDTree(sites.positions).query(sites.positions * [-1.0, 1.0, 1.0])
    facing = np.sum(sites.normals * sites.normals[others] * [-1.0, 1.0, 1.0], axis=1) > 0.5
    matched = (distances < sites.spacing) & facing
    symmetric = sites.areas @ matched > _SYMMETRIC * sites.areas.sum()
    return np.asarray(symmetric & matched & (losses[others] > 0.6 * losses))


def _grow(mesh: MeasuredMesh, seed: int, tensors: Floats, free: Bools, twin: bool) -> Region | None:
    """The region around a seed that a pose compresses along the same direction.

    Args:
        mesh: The mesh.
        seed: A site.
        tensors: (sites, 6) what the pose loses.
        free: (sites,) which belong to no other region.
        twin: Whether the pose or another compresses the other side of x = 0 likewise.
    """
    sites = mesh.sites
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
    if len(members) < _FEWEST_SITES:
        return None
    centre = weights @ sites.positions[members] / total
    on_plane = ""
    if twin and abs(centre[0]) < sites.spacing and abs(normal[0]) < _ALIGNED:
        # A fold that is its own mirror image: made exactly so.
        on_plane = "within" if abs(along[0]) < _ALIGNED else "across" if abs(along[0]) > 1.0 - _ALIGNED**2 / 2.0 else ""
    if on_plane:
        flattened = np.array([0.0, 1.0, 1.0])
        centre, normal = centre * flattened, unit(normal * flattened)
        along = unit(along * flattened) if on_plane == "within" else np.array([1.0, 0.0, 0.0])
    across = np.cross(normal, along)
    relative = sites.positions[members] - centre
    (low, high), (left, right) = (_extent(relative @ axis, weights) for axis in (along, across))
    middle = (low + high) / 2.0 * along * (on_plane != "across") + (left + right) / 2.0 * across * (
        on_plane != "within"
    )
    return Region(
        members=members,
        weights=weights,
        centre=centre + middle,
        normal=normal,
        along=along,
        length=high - low + sites.spacing,
        width=right - left + sites.spacing,
        twin=twin,
        on_plane=bool(on_plane),
    )


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


def _buried(sites: Sites, region: Region) -> bool:
    """Whether a region looks at another part of the surface that is nearer than its own length."""
    ahead = sites.positions - region.centre
    heights = ahead @ region.normal
    aside = np.sqrt(np.maximum(np.sum(ahead**2, axis=1) - heights**2, 0.0))
    before = (heights > 0) & (heights < region.length) & (aside < 0.5 * heights)
    return bool((before & (sites.normals @ region.normal < -0.3)).any())


# Points at which a trail from the centre may end, and how far it goes, of the region's length.
_STEPS = 30
_REACH = 2.6
# Directions that are tried, from that of the region's loss.
_TURNS = np.radians([0.0, -8.0, 8.0, -16.0, 16.0, -24.0, 24.0])
# Spans that are tried, of the region's length: the loss at the ends must be small, and wrinkles need room ...
_SHORTEST, _LONGEST = 0.8, 5.0
# ... but of the region's width, too: further away begins another part of the body.
_LONGEST_OF_WIDTH = 2.5
# What a span is worth: its shortening times the span to this power. 1 would prefer ever longer segments over a bend,
# 0 ever shorter ones within the fold.
_SPAN_POWER = 0.3
# A segment that shortens by more is all within a fold, and so are its wrinkles: a longer one is worth more.
_BEST_SHORTENING = 0.55
# Of the way over the surface, what a segment has at least: a shorter one reaches across a fold or a gap at rest.
_STRAIGHT = 0.75
# What a segment is worth less, of which one half is all of it.
_ASIDE = 0.6
# Cosine of the surface at an end with the patch between the ends: below 0.6 wrinkles fade.
_END_FACING = 0.45


@dataclass(frozen=True, slots=True)
class _Trail:
    """Points of a surface one after another, away from a centre, which is the first.

    Attributes:
        triangles: (points,)
        barycentrics: (points, 3)
        places: (points, 3)
        normals: (points, 3) unit.
    """

    triangles: Ints
    barycentrics: Floats
    places: Floats
    normals: Floats


def lay(mesh: MeasuredMesh, region: Region, poses: Sequence[Floats]) -> tuple[Floats, Floats] | None:
    """The ends of the segment across a region that poses shorten best; none where there is none.

    Args:
        mesh: The mesh.
        region: On it.
        poses: (vertices, 3) each, animated scale taken out.
    """
    triangles = _around(mesh, region)
    if not len(triangles):
        return None
    across = np.cross(region.normal, region.along)
    # What is its own mirror image stays so.
    turns = _TURNS[:1] if region.on_plane else _TURNS
    directions = np.cos(turns)[:, None] * region.along + np.sin(turns)[:, None] * across
    step = _REACH * region.length / _STEPS
    trails = _walk(mesh.rest, triangles, region.centre, np.concatenate([-directions, directions]), step)
    best, ends = 0.0, None
    longest = min(_LONGEST * region.length, max(_LONGEST_OF_WIDTH * region.width, region.length))
    for turn, first, second in zip(turns, trails[: len(turns)], trails[len(turns) :], strict=True):
        spans = _distances(first.places, second.places)
        between = unit(second.places[None] - first.places[:, None])
        mean = first.normals[:, None] + second.normals[None]
        mean = unit(mean - np.sum(mean * between, axis=2, keepdims=True) * between)
        facing = np.minimum(np.sum(mean * first.normals[:, None], axis=2), np.sum(mean * second.normals[None], axis=2))
        walked = [np.arange(len(trail.places)) for trail in (first, second)]
        total = walked[0][:, None] + walked[1]
        fits = (spans >= _SHORTEST * region.length) & (spans <= longest) & (facing > _END_FACING)
        fits &= spans >= _STRAIGHT * step * total
        moved = [
            [np.einsum("pk,pkc->pc", each.barycentrics, now[triangles[each.triangles]]) for each in (first, second)]
            for now in poses
        ]
        ratios = np.min([_distances(*ends) for ends in moved], axis=0) / np.where(fits, spans, 1.0)
        gains = (1.0 - ratios) * np.minimum(ratios / (1.0 - _BEST_SHORTENING), 1.0) * spans**_SPAN_POWER
        # A turn, and a middle beside the region's, must be worth their while.
        aside = np.abs(walked[0][:, None] - walked[1]) / np.maximum(total, 1)
        gains = np.where(fits, gains, 0.0) * np.cos(2.0 * turn) * (1.0 - _ASIDE * aside)
        i, j = np.unravel_index(int(gains.argmax()), gains.shape)
        if gains[i, j] > best * (1.0 + 1e-9):
            best, ends = float(gains[i, j]), (first.places[i], second.places[j])
    return ends


def _distances(first: Floats, second: Floats) -> Floats:
    """(n, m) of (n, 3) and (m, 3) points."""
    return np.asarray(np.sqrt(np.sum((first[:, None] - second[None]) ** 2, axis=2)))


def _around(mesh: MeasuredMesh, region: Region) -> Ints:
    """(triangles, 3) those within reach of a segment that look its way."""
    gauge = mesh.gauge
    distances = np.sqrt(np.sum((gauge.middles - region.centre) ** 2, axis=1))
    close = gauge.triangles[distances < 1.5 * _REACH * region.length + gauge.radii]
    found: Ints = close[mesh.rest.normals[close].sum(axis=1) @ region.normal > -0.5]
    return found


def _walk(rest: Rest, triangles: Ints, centre: Floats, directions: Floats, step: float) -> list[_Trail]:
    """Walk over a surface, from the point nearest to a centre straight on in some directions as far as it goes."""
    from scipy.spatial import cKDTree

    corners = rest.positions[triangles]
    middles = corners.mean(axis=1)
    radius = float(np.sqrt(np.max(np.sum((corners - middles[:, None]) ** 2, axis=2))))
    tree = cKDTree(middles)
    count = len(directions)
    first, shares = _nearest_points(centre[None], corners)
    found, shares = np.repeat(first, count), np.repeat(shares, count, axis=0)
    steps = []
    for number in range(_STEPS + 1):
        places = np.einsum("pk,pkc->pc", shares, corners[found])
        normals = unit(np.einsum("pk,pkc->pc", shares, rest.normals[triangles[found]]))
        steps.append((found, shares, places, normals))
        if number < _STEPS:
            directions = unit(directions - np.sum(directions * normals, axis=1)[:, None] * normals)
            ahead = places + step * directions
            # The surface is no further than where the step came from.
            close = np.unique(np.concatenate(tree.query_ball_point(ahead, 1.001 * step + radius)).astype(np.intp))
            which, shares = _nearest_points(ahead, corners[close])
            found = close[which]
    columns = [np.stack(column, axis=1) for column in zip(*steps, strict=True)]
    # At a border the nearest point stays behind.
    strides = np.sqrt(np.sum(np.diff(columns[2], axis=1) ** 2, axis=2))
    lengths = 1 + np.cumprod(strides > 0.4 * step, axis=1).sum(axis=1)
    return [_Trail(*(column[k, : lengths[k]] for column in columns)) for k in range(count)]


def _nearest_points(points: Floats, corners: Floats) -> tuple[Ints, Floats]:
    """The points of triangles with area that are nearest to points.

    Args:
        points: (points, 3)
        corners: (triangles, 3, 3)

    Returns:
        (points,) triangles, the first of equally near ones, and (points, 3) barycentric coordinates.
    """
    # Products of coordinates lose digits far from the origin.
    middle = points.mean(axis=0)
    a, ab, ac = corners[:, 0] - middle, corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    aa, bb, mixed = np.sum(ab * ab, axis=1), np.sum(ac * ac, axis=1), np.sum(ab * ac, axis=1)
    points = points - middle
    first, second = points @ ab.T - np.sum(a * ab, axis=1), points @ ac.T - np.sum(a * ac, axis=1)
    determinant = aa * bb - mixed**2
    v, w = (bb * first - mixed * second) / determinant, (aa * second - mixed * first) / determinant
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    on_ab, on_ac = np.clip(first / aa, 0.0, 1.0), np.clip(second / bb, 0.0, 1.0)
    on_bc = np.clip((second - first - mixed + aa) / (aa + bb - 2.0 * mixed), 0.0, 1.0)
    zero = np.zeros_like(v)
    vs = np.stack([np.where(inside, v, 0.0), on_ab, zero, 1.0 - on_bc])
    ws = np.stack([np.where(inside, w, 0.0), zero, on_ac, on_bc])
    # Squared distances, less that of the first corner where it is the same for all four.
    squared = vs**2 * aa + 2.0 * vs * ws * mixed + ws**2 * bb - 2.0 * (vs * first + ws * second)
    squared = squared + (np.sum(points**2, axis=1)[:, None] - 2.0 * points @ a.T + np.sum(a**2, axis=1))
    squared[0] = np.where(inside, squared[0], np.inf)
    which = squared.argmin(axis=0)
    triangle = squared.min(axis=0).argmin(axis=1)
    rows = np.arange(len(points))
    chosen = which[rows, triangle]
    v, w = vs[chosen, rows, triangle], ws[chosen, rows, triangle]
    return triangle, np.stack([1.0 - v - w, v, w], axis=1)


# Part of the lost length that joints alone must make for a region to be named after one.
_OF_JOINTS = 0.5


def driver_of(fold: Fold) -> tuple[str, bool]:
    """The joint or the morph target that compresses a region, and whether it is a morph target.

    Of joints, the one that turns most against its parent, where the region lies on both its sides.
    """
    mesh, region, clip = fold.mesh, fold.region, fold.clip
    rig, times = mesh.rig, np.array([fold.time])
    weights, stored = morph_weights(rig, clip, times)[0], mesh.rest.morph_weights
    moving = np.flatnonzero(weights != stored)
    ends = [closest_point(mesh.rest.positions, mesh.gauge.triangles, end) for end in (fold.origin, fold.target)]

    def span(of_clip: Clip | None, morphs: Floats) -> float:
        now = pose_unscaled(mesh, of_clip, fold.time, morphs[None])
        first, second = (shares @ now[mesh.gauge.triangles[triangle]] for triangle, shares, _ in ends)
        return float(np.linalg.norm(second - first))

    if len(moving):
        rest_span = span(None, stored)
        lost = rest_span - span(clip, weights)
        if rest_span - span(clip, stored) < _OF_JOINTS * lost:
            alone = [span(None, np.where(np.arange(len(stored)) == k, weights, stored)) for k in moving]
            return rig.morph_names[moving[int(np.argmin(alone))]], True
    shares = _joint_shares(mesh, region)
    below = _below(rig)
    beyond = below @ shares
    turns = _turns(rig, clip, times)
    merits = beyond * (1.0 - beyond) * turns
    joint = int(merits.argmax()) if merits.max() > 1e-3 else int(shares.argmax())
    return rig.names[rig.joints[joint]], False


def _joint_shares(mesh: MeasuredMesh, region: Region) -> Floats:
    """(joints,) how much of a region follows each joint; their sum is 1."""
    triangles = np.asarray((region.weights @ mesh.sites.smooth[region.members]) @ mesh.sites.gather)
    corners = mesh.gauge.triangles
    vertices = np.bincount(corners.ravel(), np.repeat(triangles / 3.0, 3), len(mesh.surface.positions))
    shares: Floats = np.asarray(mesh.gauge.influences.T @ vertices)
    total: Floats = shares / shares.sum()
    return total


def _below(rig: Rig) -> Floats:
    """(joints, joints) 1 where the second hangs on the first, or is it."""
    numbers = {int(joint): k for k, joint in enumerate(rig.joints)}
    below = np.zeros((len(rig.joints),) * 2)
    for k, joint in enumerate(rig.joints):
        node = int(joint)
        while node >= 0:
            if node in numbers:
                below[numbers[node], k] = 1.0
            node = int(rig.parents[node])
    return below


def _turns(rig: Rig, clip: Clip, times: Floats) -> Floats:
    """(joints,) angles by which joints are turned against their parents, from the stored pose, radians."""
    nodes = [int(joint) for joint in rig.joints]
    parents = [int(rig.parents[node]) for node in nodes]
    turns = np.zeros(len(nodes))
    hanging = [k for k, parent in enumerate(parents) if parent >= 0]
    if not hanging:
        return turns
    every = [nodes[k] for k in hanging] + [parents[k] for k in hanging]
    relative = []
    for of_clip in (None, clip):
        matrices = node_matrices(rig, of_clip, times, every)[0, :, :3, :3]
        own, above = matrices[: len(hanging)], matrices[len(hanging) :]
        regular = np.abs(np.linalg.det(above)) > 0
        relative.append(_rotation(np.linalg.inv(np.where(regular[:, None, None], above, np.eye(3))) @ own))
    trace = np.einsum("jab,jab->j", *relative)
    turns[hanging] = np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))
    return turns


def _rotation(matrices: Floats) -> Floats:
    """(…, 3, 3) nearest orthogonal matrices."""
    left, _, right = np.linalg.svd(matrices)
    return np.asarray(left @ right)
