"""The greatest shortening of a tool in each clip, and bumps that keep rising until then."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.carried import pose_carriers_in
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.choices import MAX_COMPRESSIBLE
from wrinklecli.drive.segment import Segment
from wrinklecli.effects.attached import Attached
from wrinklecli.effects.plan import attach_one
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.tools.records import Length, RestLengthMorph, WrinkleTool

# Most nodes times poses whose matrices are kept, as tools share them: of 48 MB.
_MOST_KNOWN_ROWS = 500_000
# Per cent added to `compressible`: between the poses looked at, a clip may fold a little further.
_SPARE = 1
# Factor by which bumps grow until a file may have the `compressible` that they need.
_HIGHER = 1.1
# Per cent of its rest distance by which a tool is longer at weight 1 of its morph target: multiples of the first, up to
# the last. Skin between brows hardly shortens and yet has lines, so the weight makes them.
_STEP, _LONGER = 5, 30


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


def shortenings_of(mesh: MeasuredMesh, patch: Attached[WrinkleTool]) -> dict[str, Shortening]:
    """Find the greatest shortening of a tool in each clip of a mesh, by the clip's name."""
    found = {}
    segment = segment_of(patch)
    joints = {joint for each in patch.regions[0].anchors for joint in each.joints}
    above = [moving_nodes(mesh.rig, [joint]) for joint in joints]
    around = frozenset({mesh.rig.node}.union(*above))
    motions = list[tuple[Clip, Floats]]()
    for clip, times in zip(mesh.clips, mesh.times, strict=True):
        # The order of clips decides between equal ones.
        found[clip.name] = Shortening(clip, float(times[0]), 0.0, patch.span, segment.rest_length.constant)
        if any(_bends(clip, node, mesh.rig, above) for node in around & clip.nodes):
            motions.append((clip, times))
    if not motions:
        return found
    # All clips are posed at once: for one of 25 frames, calls cost more than numbers.
    posed = [(*motion, mesh.known_rows.setdefault((motion[0].name, len(motion[1])), {})) for motion in motions]
    ends = np.cumsum([len(times) for _, times in motions])
    distances_of_all = segment.distances(pose_carriers_in(segment.points, mesh.rig, posed), int(ends[-1]))
    # As many rows may become known as there are nodes, in the poses of all clips.
    if len(mesh.rig.parents) * sum(map(len, mesh.times)) > _MOST_KNOWN_ROWS:
        mesh.known_rows.clear()
    for (clip, times), distances in zip(motions, np.split(distances_of_all, ends[:-1]), strict=True):
        rest_lengths = segment.rest_length.at(mesh.rig, clip, times)
        ratios = distances / np.maximum(rest_lengths, patch.span)
        best = int(ratios.argmin())
        found[clip.name] = Shortening(
            clip, float(times[best]), 1.0 - float(ratios[best]), float(distances[best]), float(rest_lengths[best])
        )
    return found


def attached_and_folded(
    mesh: MeasuredMesh, tools: list[WrinkleTool], least: float, morph: str = ""
) -> tuple[list[Attached[WrinkleTool]], list[dict[str, Shortening]]] | None:
    """Attach tools and find the `shortenings_of` each; None if a bake would refuse one, or none shortens enough.

    Args:
        mesh: The mesh.
        tools: One tool, or a pair.
        least: Least shortening, as a part of the rest length.
        morph: A morph target whose weight makes the wrinkles where the skin itself shortens less; empty for none.
    """
    steps = range(_STEP, _LONGER + 1, _STEP) if morph else ()
    fulls = [RestLengthMorph(morph, Length(100.0 + step, percent=True)) for step in steps]
    for length in [None, *fulls]:
        patches = attached(mesh, [replace(each, rest_length=length) if length else each for each in tools])
        if patches is None:
            return None
        shortenings = [shortenings_of(mesh, patch) for patch in patches]
        if max(greatest(each).ratio for each in shortenings) >= least:
            return patches, shortenings
    return None


def segment_of(patch: Attached[WrinkleTool]) -> Segment:
    """The segment whose length makes a tool's wrinkles."""
    assert patch.segment is not None, "wrinkles are made by a length"
    return patch.segment


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
    patches: list[Attached[WrinkleTool]], shortenings: list[dict[str, Shortening]], *, height: float | None = None
) -> list[WrinkleTool]:
    """Make tools so compressible that no bump reaches its full height before the greatest shortening.

    `compressible` is in whole per cent. Bumps are higher where it would exceed the most that a file may have.

    Args:
        patches: One tool, or a pair.
        shortenings: The `shortenings_of` each.
        height: Highest point of a bump relative to its width at rest; the material's if None.
    """
    width = segment_of(patches[0]).rest_length.constant / patches[0].tool.bumps
    usual = patches[0].tool.bump_height
    height = usual if height is None else height
    while (percent := _needed_percent(patches, shortenings, height)) > MAX_COMPRESSIBLE:
        height *= _HIGHER
    tools = [replace(each.tool, compressible=percent / 100.0) for each in patches]
    if height != usual:
        # Rounded up to need no more `compressible`.
        max_height = Length(math.ceil(1e4 * height * width / patches[0].span) / 100.0, percent=True)
        tools = [replace(tool, max_height=max_height) for tool in tools]
    return tools


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
