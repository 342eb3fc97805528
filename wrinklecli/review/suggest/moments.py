"""When clips shorten a tool most, and the tissue's share with which its bumps rise until then."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.rig import Rig, moving_nodes
from wrinklecli.effects.wrinkle.activity import lengths_over_time
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.effects.wrinkle.weights import fitting_compressible
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.tools.materials import bump_height
from wrinklecli.tools.records import Length, WrinkleTool

# Per cent of a shortening that the tissue takes beyond what is needed: between the poses looked at, a clip may fold a
# little further. And the most that a file may say.
_SPARE = 1
_MOST_COMPRESSIBLE = 95
# Poses of a further clip.
_FURTHER_POSES = 8
# Factor by which bumps grow until that is enough.
_HIGHER = 1.1


@dataclass(frozen=True, slots=True)
class Moment:
    """A tool's anchors in a clip when they are nearest to each other, by what they shorten from.

    Attributes:
        shortening: As a part of the rest length, without the tool's slack.
        distance: Of the anchors, scene units; infinite where the character is hidden.
        rest_length: Of the curve, scene units.
        time: Seconds.
    """

    shortening: float
    distance: float
    rest_length: float
    time: float


def deepest_moments(mesh: MeasuredMesh, patch: Patch, further: Sequence[Clip] = ()) -> dict[str, Moment]:
    """By the name of each clip, its deepest moment for a tool.

    Args:
        mesh: With clips.
        patch: The attached tool.
        further: Clips to look at beside those of the mesh, each from one key to another.
    """
    found = {}
    above = [moving_nodes(mesh.rig, [joint]) for joint in {joint for each in patch.anchors for joint in each.joints}]
    more = [(clip, np.linspace(clip.start, clip.end, _FURTHER_POSES)) for clip in further]
    for clip, times in [*zip(mesh.clips, mesh.times, strict=True), *more]:
        if not any(_bends(channel, mesh.rig, above) for channel in clip.channels):
            found[clip.name] = Moment(0.0, patch.span, patch.rest_length, float(times[0]))
            continue
        distances, rest_lengths = lengths_over_time(patch, mesh.rig, mesh.rest, clip, times)
        ratios = distances / np.maximum(rest_lengths, patch.span)
        best = int(ratios.argmin())
        found[clip.name] = Moment(
            1.0 - float(ratios[best]), float(distances[best]), float(rest_lengths[best]), float(times[best])
        )
    return found


def _bends(channel: Channel, rig: Rig, above: Sequence[frozenset[int]]) -> bool:
    """Whether a channel may move joints, each of which follows the nodes above it, against each other, or hide them."""
    followers = sum(channel.node in nodes for nodes in above)
    return channel.node == rig.node or (followers > 0 and (followers < len(above) or channel.path == "scale"))


def rising_tools(
    patches: list[Patch], moments: list[dict[str, Moment]], highest: float = math.inf
) -> list[WrinkleTool] | None:
    """The tools of patches, compressible so much that no bump is full before the deepest pose.

    In whole per cent and one more. Where that is more than a file may say, bumps are higher.

    Args:
        patches: Of one tool, or of a pair.
        moments: Of each, by clip.
        highest: What a bump may have, scene units.

    Returns:
        None where bumps would have to be higher than that.
    """
    width = patches[0].rest_length / patches[0].tool.bumps
    usual = bump_height(patches[0].tool.material)
    height = min(usual, highest / width)
    while (percent := _needed_percent(patches, moments, height)) > _MOST_COMPRESSIBLE:
        height *= _HIGHER
    if height * width > highest:
        return None
    tools = [replace(each.tool, compressible=percent / 100.0) for each in patches]
    if height != usual:
        # Rounded away from what the tissue or the room would not take.
        nearest = math.ceil if height > usual else math.floor
        share = nearest(1e4 * height * width / patches[0].span) / 100.0
        tools = [replace(tool, max_height=Length(share, percent=True)) for tool in tools]
    return tools


def _needed_percent(patches: list[Patch], moments: list[dict[str, Moment]], height: float) -> int:
    """The tissue's share, per cent, for bumps that are at most so high, as a part of their width."""
    needed = 0.0
    for patch, found in zip(patches, moments, strict=True):
        distances, rest_lengths = np.array([[each.distance, each.rest_length] for each in found.values()]).T
        curve = replace(patch.curve, max_height=height * patch.rest_length / patch.tool.bumps)
        needed = max(needed, fitting_compressible(curve, [(distances, rest_lengths)]))
    return math.ceil(100.0 * needed) + _SPARE if needed else 0
