"""Folds of a moving mesh, the most compressed first: a region, the segment across it, and what bends it.

From each summit of the compression over all clips, the region around it that the same pose compresses along the same
direction.
"""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from wrinklecli.character.bones import Part
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import morph_weights, node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.choices import MaterialName
from wrinklecli.numeric.arrays import Bools, Floats
from wrinklecli.numeric.nearest import closest_point
from wrinklecli.review.suggest.measure import MeasuredMesh, pose_unscaled
from wrinklecli.surface.compression import (
    CompressedRegion,
    basins,
    grow_region,
    is_buried,
    sites_with_twins,
    triangle_shares,
)
from wrinklecli.surface.segments import lay_segment
from wrinklecli.surface.sites import at_sites
from wrinklecli.tools.mirror import split_side

# Regions of a mesh that are looked into.
_MOST_REGIONS = 50
# Poses that are kept while regions are looked for: many regions share one. One of a large mesh takes 50 MB.
_KNOWN_POSES = 8
# Part of its length that a site must lose to be looked into, and part of that which its basin loses at least.
LEAST_LOSS = 0.15
_BASIN_LOSS = 0.3
# A region that looks at another part of the surface nearer than its own length is a fold at rest already (the crotch,
# the inside of a lip): nobody sees its wrinkles, so little of its score counts.
_BURIED_SCORE = 0.2
# Part of the lost length that joints alone must make for a region to be named after one.
_OF_JOINTS = 0.5


# Joints of a side that wrinkle what lies between them and their twins: nobody raises one brow alone for long.
_OF_BOTH_SIDES = re.compile("brow|forehead", re.IGNORECASE)


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
        widest: What the width of its tool is at most, scene units.
        between: (points, 3) of a path between them; none where a straight tool lies well.
        score: What the region loses, area times 1 − σ, scene units squared; less where nobody sees it.
        material: Of what the region is; None for none.
        facet: Length of its triangles' edges where they are shaded flat, scene units; 0 where they are not.
        driver: The joint or morph target that compresses it, as the asset names it.
        by_morph: Whether that is a morph target.
    """

    mesh: MeasuredMesh
    region: CompressedRegion
    clip: Clip
    time: float
    origin: Floats
    target: Floats
    score: float
    material: MaterialName | None = None
    facet: float = 0.0
    widest: float = math.inf
    between: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    driver: str = ""
    by_morph: bool = False
    part: Part | None = None


def find_folds(mesh: MeasuredMesh, progress: Callable[[float], None] = lambda _share: None) -> Iterator[Fold]:
    """Segments across the regions of a mesh that are compressed most, none within another's region.

    Args:
        mesh: The mesh.
        progress: Called with the share of the work that is done.
    """
    peaks, sites = mesh.peaks, mesh.sites
    summits = basins(peaks.losses, sites.near, LEAST_LOSS * _BASIN_LOSS)
    twins = sites_with_twins(mesh.sites)
    seeds = np.unique(summits[summits >= 0])
    seeds = seeds[peaks.losses[seeds] >= LEAST_LOSS]
    seeds = seeds[np.argsort(-peaks.losses[seeds], kind="stable")][:_MOST_REGIONS]
    known: dict[int, tuple[Floats, Floats]] = {}
    for step, seed in enumerate(seeds.tolist()):
        progress(step / len(seeds))
        pose = int(peaks.poses[seed])
        clip, time = peaks.clips[pose], peaks.times[pose : pose + 1]
        if pose not in known:
            if len(known) == _KNOWN_POSES:
                known.clear()
            known[pose] = at_sites(sites, clip, time)[0], pose_unscaled(mesh, clip, float(time[0]))
        tensors, now = known[pose]
        fold = _fold(mesh, seed, clip, float(time[0]), tensors, now, summits == seed, twin=bool(twins[seed]))
        if fold is not None:
            yield fold


def _fold(
    mesh: MeasuredMesh,
    seed: int,
    clip: Clip,
    time: float,
    tensors: Floats,
    now: Floats,
    free: Bools,
    *,
    twin: bool,
) -> Fold | None:
    """The fold about a seed, across x = 0 where it reaches there and what drives it has no side."""
    for across in (True, False):
        region = grow_region(mesh.sites, seed, tensors, free, twin=twin, across=across)
        ends = None if region is None else lay_segment(mesh.sites, region, [now])
        if region is None or ends is None:
            continue
        score = float(region.weights.sum()) * (_BURIED_SCORE if is_buried(mesh.sites, region) else 1.0)
        fold = Fold(mesh, region, clip, time, *ends, score)
        driver, by_morph = driver_of(fold)
        if not region.on_plane or by_morph or not split_side(driver)[1] or _OF_BOTH_SIDES.search(driver):
            return replace(fold, driver=driver, by_morph=by_morph)
    return None


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
        if rest_span - span(clip, stored) <= _OF_JOINTS * lost:
            alone = [span(None, np.where(np.arange(len(stored)) == k, weights, stored)) for k in moving]
            return rig.morph_names[moving[int(np.argmin(alone))]], True
    shares = _joint_shares(mesh, region)
    below = _below(rig)
    beyond = below @ shares
    turns = _turns(rig, clip, times)
    merits = beyond * (1.0 - beyond) * turns
    joint = int(merits.argmax()) if merits.max() > 1e-3 else int(shares.argmax())
    return rig.names[rig.joints[joint]], False


def _joint_shares(mesh: MeasuredMesh, region: CompressedRegion) -> Floats:
    """(joints,) how much of a region follows each joint; their sum is 1."""
    corners = mesh.gauge.triangles
    by_corner = np.repeat(triangle_shares(mesh.sites, region) / 3.0, 3)
    vertices = np.bincount(corners.ravel(), by_corner, len(mesh.surface.positions))
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
