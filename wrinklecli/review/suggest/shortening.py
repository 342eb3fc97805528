"""The greatest shortening of a tool in each clip, and bumps that keep rising until then."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.carried import pose_carriers_in
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.drive.segment import Segment
from wrinklecli.effects.attached import Attached
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.numeric.rays import near_points, ray_hits
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.tools.records import Length, WrinkleTool

# Poses of a further clip.
_FURTHER_POSES = 8
# Most nodes times poses whose matrices are kept, as tools share them: of 48 MB.
_MOST_KNOWN_ROWS = 500_000
# Frames of clips posed at once, a joint's rows of 3 MB. For a clip of 25 frames, calls cost more than numbers.
_MOST_FRAMES = 2**15
# Per cent added to `compressible`: between the poses looked at, a clip may fold a little further.
_SPARE = 1
# Most per cent of `compressible` that a file may have.
MOST_COMPRESSIBLE = 95
# Factor by which bumps grow until `compressible` is no more than that.
_HIGHER = 1.1
# Most rays that look for a surface over a patch.
_RAYS = 150
# Factor on the height below which a patch fades so much that it reaches nothing.
_LOW = 0.2
# Part of the free height over a patch that wrinkles take, as rays miss what lies between them.
_TAKEN = 0.8


@dataclass(frozen=True, slots=True)
class Shortening:
    """The pose of a clip in which a tool's anchors are nearest to each other.

    Attributes:
        clip: The clip.
        time: Seconds.
        ratio: Lost part of the rest length, without the tool's slack.
        distance: Distance of the anchors, scene units; infinite if the character is hidden.
        rest_length: Rest length of the control curve, scene units.
    """

    clip: Clip
    time: float
    ratio: float
    distance: float
    rest_length: float


def attached(mesh: MeasuredMesh, tools: list[WrinkleTool]) -> list[Attached[WrinkleTool]] | None:
    """Tools attached to a mesh at rest; None if a bake would refuse one."""
    try:
        return [attach_one(tool, mesh.ground, bounded=False) for tool in tools]
    except WrinkleError:
        return None


def shortenings_of(
    mesh: MeasuredMesh, patch: Attached[WrinkleTool], further: Sequence[Clip] = ()
) -> dict[str, Shortening]:
    """Find the greatest shortening of a tool in each clip of a mesh and in further clips, by the clip's name.

    Each further clip goes from one key to another.
    """
    found = {}
    segment = segment_of(patch)
    joints = {joint for each in patch.regions[0].anchors for joint in each.joints}
    above = [moving_nodes(mesh.rig, [joint]) for joint in joints]
    around = frozenset({mesh.rig.node}.union(*above))
    more = [(clip, np.linspace(clip.start, clip.end, _FURTHER_POSES)) for clip in further]
    motions = list[tuple[Clip, Floats]]()
    for clip, times in [*zip(mesh.clips, mesh.times, strict=True), *more]:
        # The order of clips decides between equal ones.
        found[clip.name] = Shortening(clip, float(times[0]), 0.0, patch.span, segment.rest_length.constant)
        if any(_bends(clip, node, mesh.rig, above) for node in around & clip.nodes):
            motions.append((clip, times))
    for batch in _batches(motions):
        known = [mesh.known_rows.setdefault((clip.name, len(times)), {}) for clip, times in batch]
        posed = [(*motion, rows) for motion, rows in zip(batch, known, strict=True)]
        ends = np.cumsum([len(times) for _, times in batch])
        carriers = pose_carriers_in(segment.points, mesh.rig, posed)
        distances_of_all = segment.distances(carriers, int(ends[-1]))
        if mesh.row_count > _MOST_KNOWN_ROWS:
            mesh.known_rows.clear()
        for (clip, times), distances in zip(batch, np.split(distances_of_all, ends[:-1]), strict=True):
            rest_lengths = segment.rest_length.at(mesh.rig, clip, times)
            ratios = distances / np.maximum(rest_lengths, patch.span)
            best = int(ratios.argmin())
            found[clip.name] = Shortening(
                clip, float(times[best]), 1.0 - float(ratios[best]), float(distances[best]), float(rest_lengths[best])
            )
    return found


def segment_of(patch: Attached[WrinkleTool]) -> Segment:
    """The segment whose length makes a tool's wrinkles."""
    assert patch.segment is not None, "wrinkles are made by a length"
    return patch.segment


def _batches(motions: Sequence[tuple[Clip, Floats]]) -> Iterator[list[tuple[Clip, Floats]]]:
    """Give clips with their times in batches that are posed at once."""
    batch, frames = list[tuple[Clip, Floats]](), 0
    for clip, times in motions:
        if batch and frames + len(times) > _MOST_FRAMES:
            yield batch
            batch, frames = [], 0
        batch.append((clip, times))
        frames += len(times)
    if batch:
        yield batch


def greatest(shortenings: Mapping[str, Shortening]) -> Shortening:
    """The greatest shortening of all clips; the first one of equal ones."""
    return max(shortenings.values(), key=lambda each: each.ratio)


def _bends(clip: Clip, node: int, rig: Rig, above: Sequence[frozenset[int]]) -> bool:
    """True if a clip, by a node, may move joints relative to each other, or hide them.

    `above` has each joint with its ancestors.
    """
    followers = sum(node in nodes for nodes in above)
    hides = followers > 0 and clip.channel(node, "scale") is not None
    return node == rig.node or 0 < followers < len(above) or hides


def with_rising_bumps(
    mesh: MeasuredMesh,
    patches: list[Attached[WrinkleTool]],
    shortenings: list[dict[str, Shortening]],
    *,
    height: float | None = None,
) -> list[WrinkleTool] | None:
    """Make tools so compressible that no bump reaches its full height before the greatest shortening.

    `compressible` is in whole per cent. Bumps are higher where it would exceed the most that a file may have.

    Args:
        mesh: The mesh.
        patches: One tool, or a pair.
        shortenings: The `shortenings_of` each.
        height: Highest point of a bump relative to its width at rest; the material's if None.

    Returns:
        None if the bumps would reach a surface above them.
    """
    width = segment_of(patches[0]).rest_length.constant / patches[0].tool.bumps
    usual = patches[0].tool.bump_height
    highest = min(_free_height(mesh, patch) for patch in patches)
    height = min(usual if height is None else height, highest / width)
    while (percent := _needed_percent(patches, shortenings, height)) > MOST_COMPRESSIBLE:
        height *= _HIGHER
    if height * width > highest:
        return None
    tools = [replace(each.tool, compressible=percent / 100.0) for each in patches]
    if height != usual:
        # Rounded up to need no more `compressible`, or down to stay below the surface above.
        rounded = math.ceil if height > usual else math.floor
        max_height = Length(rounded(1e4 * height * width / patches[0].span) / 100.0, percent=True)
        tools = [replace(tool, max_height=max_height) for tool in tools]
    return tools


def with_lower_bumps(
    patches: list[Attached[WrinkleTool]],
    tools: list[WrinkleTool],
    shortenings: list[dict[str, Shortening]],
    part: float,
) -> list[WrinkleTool] | None:
    """Make `tools`, which `with_rising_bumps` has made of patches, lower, by a factor on the height of their bumps.

    Returns:
        None if they would need a greater `compressible` than a file may have.
    """
    first, tool = patches[0], tools[0]
    width = segment_of(first).rest_length.constant / tool.bumps
    height = tool.bump_height * width
    if isinstance(tool.max_height, Length):
        height = tool.max_height.resolve(first.span)
    # Rounded up to need no more `compressible`.
    percent_of_span = math.ceil(1e4 * part * height / first.span) / 100.0
    percent = _needed_percent(patches, shortenings, part * height / width)
    if percent > MOST_COMPRESSIBLE:
        return None
    max_height = Length(percent_of_span, percent=True)
    return [replace(each, compressible=percent / 100.0, max_height=max_height) for each in tools]


def _needed_percent(
    patches: list[Attached[WrinkleTool]], shortenings: list[dict[str, Shortening]], height: float
) -> int:
    """The `compressible` that bumps need, per cent, if their greatest height over their width is `height`."""
    needed = 0.0
    for patch, found in zip(patches, shortenings, strict=True):
        distances, rest_lengths = np.array([[each.distance, each.rest_length] for each in found.values()]).T
        limit = height * segment_of(patch).rest_length.constant / patch.tool.bumps
        needed = max(needed, patch.fitting_compressible([(distances, rest_lengths)], limit))
    return math.ceil(100.0 * needed) + _SPARE if needed else 0


def _free_height(mesh: MeasuredMesh, patch: Attached[WrinkleTool]) -> float:
    """Greatest height of bumps that do not reach a surface above the patch at rest, such as a hem, scene units.

    Infinite if no surface lies within the usual height.
    """
    surface, positions = mesh.gauge.surface, mesh.rest.positions
    region = patch.regions[0].at_rest
    members = surface.triangles[region.members]
    places = positions[members].mean(axis=1)
    rays = unit(mesh.rest.normals[members].sum(axis=1))
    u, v = region.coordinates(places)
    factors = abs(patch.tool.strength) * region.share(u, v, region.cosines(u, rays))
    chosen = np.flatnonzero(factors > _LOW)
    chosen = chosen[:: -(-len(chosen) // _RAYS) or 1]
    usual = patch.height_limit
    if not len(chosen) or not np.isfinite(usual):
        return np.inf
    corners = positions[surface.triangles]
    near = near_points(corners, places[chosen], usual)
    triangles, own = surface.triangles[near], members[chosen]
    rows, met, free = ray_hits(places[chosen], rays[chosen], corners[near])
    # A ray passes through the triangle that it leaves, and may graze those beside it.
    beside = (triangles[met][:, :, None] == own[rows][:, None, :]).any(axis=(1, 2))
    reached = np.full(len(chosen), np.inf)
    np.minimum.at(reached, rows[~beside], free[~beside])
    low = reached < usual * factors[chosen]
    return float(np.min(_TAKEN * reached[low] / factors[chosen][low], initial=np.inf))
