"""Heights over time: what a clip makes of each tool, from the distance of its anchors through its control curve.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004: the current distance of origin and target
gives the control curve of a frame. Differs: only the anchors are posed, those of all tools at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from wrinklecli.character.clip import Clip, motion_breaks
from wrinklecli.character.pose import LEAST_SCALE, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.drive.lag import LaggingTissue, lagging_tissue
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.surface.anchor import AnchorPoses, anchor_poses, posed_anchor
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

# Anchors' joints and morph weights, times frames, posed at once: bounds the memory.
_ANCHORS_AT_ONCE = 2**16


def anchor_joints(patches: Sequence[Patch]) -> Ints:
    """(joints,) into the rig's, rising: those that move an anchor of any of the tools."""
    return distinct_values(np.concatenate([anchor.joints for each in patches for anchor in each.anchors]))


def lengths_over_time(
    patch: Patch, rig: Rig, rest: Rest, clip: Clip | None, times: Floats, poses: AnchorPoses | None = None
) -> tuple[Floats, Floats]:
    """What a clip does to a tool's segment.

    Args:
        patch: The attached tool.
        rig: Of its mesh.
        rest: The rest pose.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        poses: At these times, where other tools need them too.

    Returns:
        (frames,) summed distances of neighbouring anchors with animated scale taken out, and (frames,) rest length,
        scene units. Where the anchors' scale is below 1e-6 the distance is infinite: the tool is inactive.
    """
    if poses is None:
        poses = anchor_poses(anchor_joints([patch]), rig, rest, clip, times)
    places, scales = zip(*(posed_anchor(anchor, poses, len(times)) for anchor in patch.anchors), strict=True)
    scale = sum(scales, np.zeros(1)) / len(scales)
    hidden = scale < LEAST_SCALE
    steps = [b - a for a, b in pairwise(places)]
    apart = sum((np.sqrt(np.einsum("xf,xf->f", step, step)) for step in steps), np.zeros(1))
    distances = apart / np.where(hidden, 1.0, scale)
    return np.where(hidden, np.inf, distances), rest_lengths_over_time(patch, rig, clip, times)


def rest_lengths_over_time(patch: Patch, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
    """(frames,) rest lengths of a tool at (frames,) seconds of a clip, scene units."""
    wanted = patch.tool.rest_length
    if isinstance(wanted, RestLengthKeys) and clip is not None and clip.name in wanted.keys:
        keys = wanted.keys[clip.name]
        return np.interp(times, [t for t, _ in keys], [each.resolve(patch.span) for _, each in keys])
    if isinstance(wanted, RestLengthMorph):
        weights = morph_weights(rig, clip, times)
        number = rig.morph_names.index(wanted.morph)
        full = wanted.full.resolve(patch.span)
        return patch.span + np.clip(weights[:, number], 0.0, 1.0) * (full - patch.span)
    return np.full(len(times), patch.rest_length)


def tissues(patches: Sequence[Patch], rig: Rig, rest: Rest, clip: Clip | None) -> list[LaggingTissue | None]:
    """How what each tool wrinkles lags behind a clip; None where it does not, and in the stored pose."""
    return [_tissue(patch, rig, rest, clip) for patch in patches]


def _tissue(patch: Patch, rig: Rig, rest: Rest, clip: Clip | None) -> LaggingTissue | None:
    lag, wanted = patch.tool.lag, patch.tool.rest_length
    if lag is None or clip is None:
        return None
    keys = wanted.keys.get(clip.name, ()) if isinstance(wanted, RestLengthKeys) else ()

    def ratios(times: Floats) -> Floats:
        distances, rest_lengths = lengths_over_time(patch, rig, rest, clip, times)
        return (distances / rest_lengths)[:, None]

    return lagging_tissue(lag, ratios, clip, np.concatenate([motion_breaks(clip, rig), [time for time, _ in keys]]))


@dataclass(frozen=True, slots=True)
class Activity:
    """What a clip makes of one tool, whichever vertices the tool moves.

    Attributes:
        distances: (frames,) of the anchors, animated scale taken out, scene units; of a tool with `lag` those that its
            tissue follows.
        rest_lengths: (frames,).
        shortenings: (frames,) what rest lengths exceed distances by, without rounding noise and without what the
            tissue takes itself; 0 where they do not.
        unabsorbed: (frames,) the part of them that no bump can take.
        amplitudes: (frames, groups, modes) of the curve; the tool's strength in the clip is not applied.
        tissue: How it lags in this clip; None where it does not.
    """

    distances: Floats
    rest_lengths: Floats
    shortenings: Floats
    unabsorbed: Floats
    amplitudes: Floats
    tissue: LaggingTissue | None = None


def activity(patch: Patch, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) times of a clip, seconds; none for the stored pose."""
    return activities([patch], rig, rest, clip, times)[0]


def activities(
    patches: Sequence[Patch],
    rig: Rig,
    rest: Rest,
    clip: Clip | None,
    times: Floats,
    *,
    lagging: Sequence[LaggingTissue | None] | None = None,
) -> list[Activity]:
    """As `activity`, of several tools: what moves their anchors is posed once. `lagging` is what `tissues` gives."""
    if not patches:
        return []
    joints = anchor_joints(patches)
    lagging = tissues(patches, rig, rest, clip) if lagging is None else lagging
    chunk = max(_ANCHORS_AT_ONCE // (len(joints) + len(rig.morph_weights)), 1)
    parts: list[list[Activity]] = [[] for _ in patches]
    for at in (times[k : k + chunk] for k in range(0, max(len(times), 1), chunk)):
        poses = anchor_poses(joints, rig, rest, clip, at)
        for patch, late, found in zip(patches, lagging, parts, strict=True):
            distances, lengths = lengths_over_time(patch, rig, rest, clip, at, poses)
            if late is not None:
                distances = late.follow(at, distances, lengths)
            shortenings = patch.curve.shortening(distances, lengths)
            amplitudes, unabsorbed = patch.curve.follow(distances, lengths)
            found.append(Activity(distances, lengths, shortenings, unabsorbed, amplitudes, late))
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
    """As `activities` at (frames,) times, rising, where those at some of these times, `known_at`, are known already."""
    fresh = np.ones(len(times), bool)
    fresh[np.searchsorted(times, known_at)] = False
    if not fresh.any():
        return list(known)
    order = np.zeros(len(times), np.intp)
    order[~fresh], order[fresh] = np.arange(len(known_at)), np.arange(len(known_at), len(times))
    found = activities(patches, rig, rest, clip, times[fresh], lagging=[each.tissue for each in known])
    return [_joined(pair, order) for pair in zip(known, found, strict=True)]


def _joined(parts: Sequence[Activity], order: Ints | None = None) -> Activity:
    """Activities of one tool, one after another; with their frames in an order, (frames,), if there is one."""
    if len(parts) == 1 and order is None:
        return parts[0]
    of_frames = [field.name for field in fields(Activity) if field.name != "tissue"]
    joined = {name: np.concatenate([getattr(each, name) for each in parts]) for name in of_frames}
    if order is not None:
        joined = {name: values.take(order, axis=0) for name, values in joined.items()}
    return Activity(**joined, tissue=parts[0].tissue)
