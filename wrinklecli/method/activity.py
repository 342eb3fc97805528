"""Heights over time: what a clip makes of each tool, from the distance of its anchors through its control curve.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004: the current distance of origin and target
gives the control curve of a frame. Differs: only the anchors are posed, those of all tools at once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.method.patch import Patch, Rest, anchor_joints, anchor_poses, lengths_over_time
from wrinklecli.numeric.arrays import Floats, Ints

# Anchors' joints and morph weights, times frames, posed at once: bounds the memory.
_ANCHORS_AT_ONCE = 2**16


@dataclass(frozen=True, slots=True)
class Activity:
    """What a clip makes of one tool, before any mesh.

    Attributes:
        distances: (frames,) of the anchors, animated scale taken out, scene units.
        rest_lengths: (frames,).
        shortenings: (frames,).
        unabsorbed: (frames,) what no bump could take.
        amplitudes: (frames, groups, modes) of the curve, clip strength not applied.
    """

    distances: Floats
    rest_lengths: Floats
    shortenings: Floats
    unabsorbed: Floats
    amplitudes: Floats


def activity(patch: Patch, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) times of a clip, seconds; none for the stored pose."""
    return activities([patch], rig, rest, clip, times)[0]


def activities(patches: Sequence[Patch], rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> list[Activity]:
    """As `activity`, of several tools: what moves their anchors is posed once."""
    if not patches:
        return []
    joints = anchor_joints(patches)
    chunk = max(_ANCHORS_AT_ONCE // (len(joints) + len(rig.morph_weights)), 1)
    parts: list[list[Activity]] = [[] for _ in patches]
    for at in (times[k : k + chunk] for k in range(0, max(len(times), 1), chunk)):
        poses = anchor_poses(joints, rig, rest, clip, at)
        for patch, found in zip(patches, parts, strict=True):
            distances, lengths = lengths_over_time(patch, rig, rest, clip, at, poses)
            shortenings = patch.curve.shortening(distances, lengths)
            amplitudes, unabsorbed = patch.curve.follow(distances, lengths)
            found.append(Activity(distances, lengths, shortenings, unabsorbed, amplitudes))
    return [_joined(found) for found in parts]


def further_activities(
    patches: Sequence[Patch],
    rig: Rig,
    rest: Rest,
    clip: Clip,
    times: Floats,
    *,
    known: Sequence[Activity],
    known_at: Floats,
) -> list[Activity]:
    """As `activities` at (frames,) times, rising; those at some of these, `known_at`, are known."""
    fresh = np.ones(len(times), bool)
    fresh[np.searchsorted(times, known_at)] = False
    if not fresh.any():
        return list(known)
    order = np.zeros(len(times), np.intp)
    order[~fresh], order[fresh] = np.arange(len(known_at)), np.arange(len(known_at), len(times))
    found = activities(patches, rig, rest, clip, times[fresh])
    return [_joined(pair, order) for pair in zip(known, found, strict=True)]


def _joined(parts: Sequence[Activity], order: Ints | None = None) -> Activity:
    """Activities of one tool, one after another; of these the frames in an order."""
    if len(parts) == 1 and order is None:
        return parts[0]

    def joined(arrays: Iterable[Floats]) -> Floats:
        together = np.concatenate(list(arrays))
        return together if order is None else together.take(order, axis=0)

    return Activity(
        distances=joined(each.distances for each in parts),
        rest_lengths=joined(each.rest_lengths for each in parts),
        shortenings=joined(each.shortenings for each in parts),
        unabsorbed=joined(each.unabsorbed for each in parts),
        amplitudes=joined(each.amplitudes for each in parts),
    )
