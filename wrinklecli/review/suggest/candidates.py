"""Candidates for tools, found on a moving mesh: a compressed region, the segment across it, and what compresses it.

Around each summit of the compression over all clips grows the region that the same pose compresses along the same
direction.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from itertools import takewhile

import numpy as np

from wrinklecli.character.clip import Clip, sample
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.choices import MaterialName, Part
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, unit_quaternions
from wrinklecli.numeric.closest import closest_point, nearest_of
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.place_names import PlaceName
from wrinklecli.surface.compression import (
    REGION_LOSS,
    CompressedRegion,
    basins,
    grow_region,
    sites_with_twins,
    triangle_weights,
)
from wrinklecli.surface.sites import Peaks, at_sites
from wrinklecli.surface.strain import unscaled_pose
from wrinklecli.surface.substance import Substance
from wrinklecli.surface.trace import find_segment
from wrinklecli.tools.materials import Preset, presets
from wrinklecli.tools.mirror import exchange_sides, split_side

# Most regions of a mesh.
_MOST_REGIONS = 50
# Least loss of a summit, and of a tool that a joint drives, as a part of the length: for less, nothing folds.
LEAST_LOSS = 0.15
# Least merit of the best joint; below, the joint with most of the region drives it.
_LEAST_MERIT = 1e-3
# Parts of a body of which several stand side by side.
_DIGITS: tuple[Part, ...] = ("finger", "toes")
# Part of a region that follows a joint's twin, over the part that follows the joint, from which it hangs over both: a
# skirt's front has 0.7, though the fold lies a little on one side, and that of trousers next to nothing.
_OF_TWIN = 0.5
# Joints with a side that also wrinkle the skin between them and their twins: nobody raises one brow alone for long.
_OF_BOTH_SIDES = re.compile("brow|forehead", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place for a tool, and all that is known of it.

    Attributes:
        driver: Name of the joint or morph target that compresses it.
        by_morph: True if the driver is a morph target.
        part: The part of the body of a driving joint, if known.
        place: Its name, if a part of the body or of a face is known there.
        substance: What it is made of; None if it was not looked at.
        uniform: Part of it that is of one substance; NaN if it was not looked at.
        presets: Materials and presets by name, from which its tool gets one.
        fault: Why an artist would not wrinkle it; empty if nothing but its looks may say so.
    """

    driver: str = ""
    by_morph: bool = False
    part: Part | None = None
    place: PlaceName | None = None
    substance: Substance | None = None
    uniform: float = math.nan
    presets: Mapping[str, Preset] = field(default_factory=presets)
    fault: str = ""

    @property
    def material(self) -> MaterialName | None:
        """The material of its tool; None for a plain tool."""
        return None if self.substance is None else self.substance.material


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate(Place):
    """A place for a tool: a segment across a compressed region.

    Attributes:
        mesh: The mesh.
        region: On the mesh.
        clip: The clip that compresses the region most.
        time: The time in this clip, seconds.
        origin: (3,) one end of the segment, on the surface, world space at rest.
        target: (3,) the other end.
        widest: Greatest width of the tool, scene units.
        longest: Greatest length of a straight tool, scene units.
        between: (points, 3) of a path between the ends; none for a straight tool.
    """

    mesh: MeasuredMesh
    region: CompressedRegion
    clip: Clip
    time: float
    origin: Floats
    target: Floats
    widest: float = math.inf
    longest: float = math.inf
    between: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def score(self) -> float:
        """The region's loss 1 − σ summed over its area, scene units squared."""
        return float(self.region.weights.sum())


def find_candidates(
    meshes: Sequence[tuple[MeasuredMesh, Peaks]],
    parts: Sequence[Part | None],
    progress: Progress = log_progress,
    *,
    jobs: int = 1,
) -> list[Candidate]:
    """Find the regions of meshes that are compressed most, none within another, and a segment across each.

    Instances of a mesh, which share their peaks, have the same regions.

    Args:
        meshes: Each with the greatest compression of its sites.
        parts: Those of a body that nodes move.
        progress: Called with a stage's name, steps done and steps in all.
        jobs: How many processes may look for regions.
    """
    mesh_basins: dict[int, _Basins] = {}
    for mesh, peaks in meshes:
        if id(peaks) not in mesh_basins:
            mesh_basins[id(peaks)] = _Basins.of(mesh, peaks, parts)
    # All regions of a pose are the work of one process, which poses the mesh once.
    poses = [
        (key, pose)
        for key, each in mesh_basins.items()
        for pose in dict.fromkeys(each.peaks.poses[list(each.seeds)].tolist())
    ]
    shared = [each for mesh, _ in meshes for each in (mesh, *mesh.clips)]
    found: dict[int, dict[int, Candidate]] = {key: {} for key in mesh_basins}
    in_poses = in_processes(lambda pose: mesh_basins[pose[0]].candidates_in(pose[1]), poses, jobs, shared=shared)
    for step, ((key, _), candidates) in enumerate(zip(poses, in_poses, strict=True), 1):
        found[key] |= candidates
        progress("laying", step, len(poses))
    return [
        replace(found[id(peaks)][seed], mesh=mesh)
        for mesh, peaks in meshes
        for seed in mesh_basins[id(peaks)].seeds
        if seed in found[id(peaks)]
    ]


@dataclass(frozen=True, slots=True)
class _Basins:
    """The parts of a mesh that are compressed, one around each site that loses most.

    Attributes:
        mesh: The mesh.
        peaks: The greatest compression of its sites.
        seeds: The sites that lose most, highest first.
        summits: (sites,) the seed of each site; -1 for those that are not compressed.
        twins: (sites,) True for those with a mirror image across x = 0.
    """

    mesh: MeasuredMesh
    peaks: Peaks
    seeds: tuple[int, ...]
    summits: Ints
    twins: Bools

    @classmethod
    def of(cls, mesh: MeasuredMesh, peaks: Peaks, parts: Sequence[Part | None]) -> "_Basins":
        """Find the basins of a mesh; `parts` are those of a body that nodes move."""
        sites = mesh.sites
        summits = basins(peaks.losses, sites.near, LEAST_LOSS * REGION_LOSS)
        summits = _on_one_digit(summits, _digits(mesh, parts), peaks.losses, sites.positions)
        seeds = np.unique(summits[summits >= 0])
        seeds = seeds[peaks.losses[seeds] >= LEAST_LOSS]
        seeds = seeds[np.argsort(-peaks.losses[seeds], kind="stable")][:_MOST_REGIONS]
        return cls(mesh, peaks, tuple(seeds.tolist()), summits, sites_with_twins(sites))

    def candidates_in(self, number: int) -> dict[int, Candidate]:
        """The candidates of a pose, by their seeds."""
        mesh, clip, time = self.mesh, self.peaks.clips[number], float(self.peaks.times[number])
        tensors = at_sites(mesh.sites, clip, np.array([time]))[0]
        positions = unscaled_pose(mesh.gauge, clip, time)
        seeds = (seed for seed in self.seeds if self.peaks.poses[seed] == number)
        found = {seed: self._candidate(seed, clip, time, tensors, positions) for seed in seeds}
        return {seed: candidate for seed, candidate in found.items() if candidate is not None}

    def _candidate(self, seed: int, clip: Clip, time: float, tensors: Floats, positions: Floats) -> Candidate | None:
        """The candidate around a seed; across x = 0 if it extends there and its driver is not that of one side alone.

        The pose has (sites, 6) loss tensors, and (vertices, 3) positions without animated scale.
        """
        mesh, free, twin = self.mesh, self.summits == seed, bool(self.twins[seed])
        for across in (True, False):
            region = grow_region(mesh.sites, seed, tensors, free, twin=twin, across=across)
            ends = None if region is None else find_segment(mesh.sites, region, [positions])
            if region is None or ends is None:
                continue
            origin, target = ends
            candidate = Candidate(mesh=mesh, region=region, clip=clip, time=time, origin=origin, target=target)
            driver, by_morph = _driver_of(candidate)
            if not region.on_plane or by_morph or _is_of_both_sides(candidate, driver):
                return replace(candidate, driver=driver, by_morph=by_morph)
        return None


def _digits(mesh: MeasuredMesh, parts: Sequence[Part | None]) -> Ints:
    """(sites,) number of the finger or toe that moves each site most; -1 where none does."""
    rig = mesh.rig
    numbers: dict[int, int] = {}
    digits = np.full(len(rig.joints), -1)
    for k, joint in enumerate(rig.joints.tolist()):
        if joint < len(parts) and parts[joint] in _DIGITS:
            *_, first = takewhile(lambda each: parts[each] in _DIGITS, rig.upwards(joint))
            digits[k] = numbers.setdefault(first, len(numbers))
    if len(numbers) < 2:
        return np.full(len(mesh.sites.positions), -1)
    of_vertices = mesh.gauge.influences @ (digits[:, None] == np.arange(len(numbers))).astype(np.float64)
    shares = mesh.sites.gather @ of_vertices[mesh.gauge.triangles].mean(axis=1)
    return np.where(shares.any(axis=1), shares.argmax(axis=1), -1)


def _on_one_digit(summits: Ints, digits: Ints, losses: Floats, positions: Floats) -> Ints:
    """(sites,) summits of basins that are divided among the fingers on which they lie.

    A fist folds the palm along one line, but a tool there would reach across the gaps between the fingers. What no
    finger moves belongs to the nearest one of its basin.
    """
    divided = summits.copy()
    for summit in np.unique(summits[(summits >= 0) & (digits >= 0)]):
        members = np.flatnonzero(summits == summit)
        on_digits = members[digits[members] >= 0]
        if len(np.unique(digits[on_digits])) > 1:
            _, nearest = nearest_of(positions[on_digits], positions[members])
            of_members = digits[on_digits[nearest]]
            for digit in np.unique(of_members):
                there = members[of_members == digit]
                divided[there] = there[losses[there].argmax()]
    return divided


def _is_of_both_sides(candidate: Candidate, driver: str) -> bool:
    """True if a joint has no side, or wrinkles what is between it and its twin.

    A skirt hangs over both thighs: a tool of one thigh would lie on one half of a sheet that folds as a whole.
    """
    if not split_side(driver)[1] or _OF_BOTH_SIDES.search(driver):
        return True
    rig = candidate.mesh.rig
    names = [rig.names[joint] for joint in rig.joints.tolist()]
    weights = dict(zip(names, joint_weights(candidate.mesh, candidate.region).tolist(), strict=True))
    return bool(weights.get(exchange_sides(driver), 0.0) > _OF_TWIN * weights[driver])


def _driver_of(candidate: Candidate) -> tuple[str, bool]:
    """Name the joint or the morph target that compresses a region; True for a morph target.

    The joint is the one that turns most relative to its parent and has much of the region on both its sides.
    """
    mesh, region, clip = candidate.mesh, candidate.region, candidate.clip
    rig = mesh.rig
    weights, stored = morph_weights(rig, clip, np.array([candidate.time]))[0], mesh.rest.morph_weights
    moving = np.flatnonzero(weights != stored)
    ends = [
        closest_point(mesh.rest.positions, mesh.gauge.triangles, end) for end in (candidate.origin, candidate.target)
    ]

    def span(of_clip: Clip | None, morphs: Floats) -> float:
        now = unscaled_pose(mesh.gauge, of_clip, candidate.time, morphs)
        first, second = (barycentrics @ now[mesh.gauge.triangles[triangle]] for triangle, barycentrics, _ in ends)
        return float(np.linalg.norm(second - first))

    # Morph targets shorten it more than joints do.
    if len(moving) and span(None, weights) <= span(clip, stored):
        alone = [span(None, np.where(np.arange(len(stored)) == k, weights, stored)) for k in moving]
        return rig.morph_names[moving[int(np.argmin(alone))]], True
    shares = joint_weights(mesh, region)
    beyond = rig.joints_below @ shares
    merits = beyond * (1.0 - beyond)
    bending = np.flatnonzero(merits > 0)
    merits[bending] *= _turns(rig, clip, candidate.time, bending)
    joint = int(merits.argmax()) if merits.max() > _LEAST_MERIT else int(shares.argmax())
    return rig.names[rig.joints[joint]], False


def joint_weights(mesh: MeasuredMesh, region: CompressedRegion) -> Floats:
    """(joints,) part of a region that follows each joint; their sum is 1."""
    corners = mesh.gauge.triangles
    by_corner = np.repeat(triangle_weights(mesh.sites, region) / 3.0, 3)
    vertices = np.bincount(corners.ravel(), by_corner, len(mesh.gauge.surface.positions))
    by_joint = np.asarray(mesh.gauge.influences.T @ vertices)
    weights: Floats = by_joint / by_joint.sum()
    return weights


def _turns(rig: Rig, clip: Clip, time: float, joints: Ints) -> Floats:
    """(joints,) angles by which a clip turns joints of some numbers from their stored pose, radians."""
    turns = np.zeros(len(joints))
    for number, node in enumerate(rig.joints[joints].tolist()):
        channel = clip.channel(node, "rotation")
        if channel is not None:
            ends = [sample(channel, np.array([time]))[0], rig.locals[node]["rotation"]]
            one, other = map(unit_quaternions, ends)
            turns[number] = 2.0 * np.arccos(min(abs(float(one @ other)), 1.0))
    return turns
