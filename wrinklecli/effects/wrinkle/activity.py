"""Heights over time: each tool in a clip, from the distance of its anchors through its control curve.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004: the current distance of origin and target
gives the control curve of a frame. Differs: only the anchors are posed, those of all tools at once.
"""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from wrinklecli.character.carried import CarriedPoint, pose_carriers
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.lag import SpringFilter
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints

# Joints of anchors and morph weights, times frames, posed at once, which bounds the memory.
_ANCHORS_AT_ONCE = 2**16


@dataclass(frozen=True, slots=True)
class Activity:
    """One tool in one clip, whichever vertices the tool moves.

    Attributes:
        distances: (frames,) distances of the anchors, animated scale taken out, scene units; after the spring for a
            tool with `lag`.
        rest_lengths: (frames,) scene units.
        shortenings: (frames,) max(rest length - distance, 0), without rounding noise and the part that the tissue takes
            itself, scene units.
        unabsorbed: (frames,) the part of the shortening that no bump can take, scene units.
        amplitudes: (frames, groups, modes) amplitudes of the curve, without the tool's strength in the clip.
        spring: The filter in this clip; None without `lag`.
    """

    distances: Floats
    rest_lengths: Floats
    shortenings: Floats
    unabsorbed: Floats
    amplitudes: Floats
    spring: SpringFilter | None = None


@dataclass(frozen=True, slots=True)
class ClipActivity:
    """One tool in one clip: `seen` is its activity at (frames,) `times`, seconds."""

    clip: Clip
    times: Floats
    seen: Activity


def points_of(patches: Sequence[Patch]) -> list[CarriedPoint]:
    """The points of all tools' segments."""
    return [point for each in patches for point in each.segment.points]


def springs_in(patches: Sequence[Patch], rig: Rig, clip: Clip | None) -> list[SpringFilter | None]:
    """The filter of each tool in a clip; None without `lag`, and in the stored pose."""
    return [each.segment.spring(each.tool.lag, rig, clip) for each in patches]


def activity(patch: Patch, rig: Rig, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) seconds of a clip; in the stored pose if `clip` is None."""
    return activities([patch], rig, clip, times)[0]


def activities(
    patches: Sequence[Patch],
    rig: Rig,
    clip: Clip | None,
    times: Floats,
    *,
    springs: Sequence[SpringFilter | None] | None = None,
) -> list[Activity]:
    """The `activity` of several tools, whose joints are posed once. `springs` is the result of `springs_in`."""
    if not patches:
        return []
    springs = springs_in(patches, rig, clip) if springs is None else springs
    nodes = {node for point in points_of(patches) for node in point.nodes.tolist()}
    chunk = max(_ANCHORS_AT_ONCE // (len(nodes) + len(rig.morph_weights)), 1)
    parts: list[list[Activity]] = [[] for _ in patches]
    for at in (times[k : k + chunk] for k in range(0, max(len(times), 1), chunk)):
        carriers = pose_carriers(points_of(patches), rig, clip, at)
        for patch, spring, found in zip(patches, springs, parts, strict=True):
            distances, lengths = patch.segment.lengths(rig, clip, at, carriers)
            if spring is not None:
                distances = spring.follow(at, distances, lengths)
            shortenings = patch.curve.shortening(distances, lengths)
            amplitudes, unabsorbed = patch.curve.follow(distances, lengths)
            found.append(Activity(distances, lengths, shortenings, unabsorbed, amplitudes, spring))
    return [_joined(found) for found in parts]


def further_activities(
    patches: Sequence[Patch],
    rig: Rig,
    clip: Clip,
    times: Floats,
    *,
    known: Sequence[Activity],
    known_at: Floats,
) -> list[Activity]:
    """The `activities` at sorted (frames,) times, of which those at the times `known_at` are known already."""
    fresh = np.ones(len(times), bool)
    fresh[np.searchsorted(times, known_at)] = False
    if not fresh.any():
        return list(known)
    order = np.zeros(len(times), np.intp)
    order[~fresh], order[fresh] = np.arange(len(known_at)), np.arange(len(known_at), len(times))
    found = activities(patches, rig, clip, times[fresh], springs=[each.spring for each in known])
    return [_joined(pair, order) for pair in zip(known, found, strict=True)]


def _joined(parts: Sequence[Activity], order: Ints | None = None) -> Activity:
    """Join activities of one tool, and bring their frames into an order, (frames,), if there is one."""
    if len(parts) == 1 and order is None:
        return parts[0]
    of_frames = [field.name for field in fields(Activity) if field.name != "spring"]
    joined = {name: np.concatenate([getattr(each, name) for each in parts]) for name in of_frames}
    if order is not None:
        joined = {name: values.take(order, axis=0) for name, values in joined.items()}
    return Activity(**joined, spring=parts[0].spring)
