"""The segments of baked tools over time: how far apart their anchors are, by the joints that the extras name.

Source: the extras of `extras.encode_extras`, which say how.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from wrinklecli.baking.baked_body import BakedAnchor, BakedTool
from wrinklecli.character.clip import Clip, motion_breaks
from wrinklecli.character.pose import LEAST_SCALE, morph_weights, node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.drive.lag import lagging_tissue
from wrinklecli.numeric.arrays import Floats

# (frames,) seconds to (frames,) distances and (frames,) rest lengths, scene units.
Lengths: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]


def segment_lengths(
    tool: BakedTool, rig: Rig, joints: dict[str, int], clip: Clip, times: Floats
) -> tuple[Floats, Floats]:
    """What a clip does to a tool's segment.

    Args:
        tool: Of a baked body.
        rig: Of the node with its mesh.
        joints: Nodes by name, those of its anchors among them.
        clip: The animation.
        times: (frames,) seconds.

    Returns:
        (frames,) summed distances of neighbouring anchors with animated scale taken out, and (frames,) rest length,
        scene units. Where the anchors' scale is below 1e-6 the distance is infinite: the tool is inactive.
    """
    own = morph_weights(rig, clip, times)
    places, scales = zip(*(_posed_anchor(each, rig, joints, clip, times, own) for each in tool.anchors), strict=True)
    scale = sum(scales, np.zeros(1)) / len(scales)
    hidden = scale < LEAST_SCALE
    apart = sum((np.linalg.norm(b - a, axis=1) for a, b in pairwise(places)), np.zeros(1))
    distances = apart / np.where(hidden, 1.0, scale)
    return np.where(hidden, np.inf, distances), _rest_lengths(tool, rig, clip, times, own)


def lengths_in(tool: BakedTool, rig: Rig, joints: dict[str, int], clip: Clip) -> Lengths:
    """As `segment_lengths` of one clip, at any times; of a tool that lags, the distances that its tissue follows."""
    lengths = partial(segment_lengths, tool, rig, joints, clip)
    if tool.lag is None:
        return lengths

    def ratios(times: Floats) -> Floats:
        distances, rest_lengths = lengths(times)
        return (distances / rest_lengths)[:, None]

    breaks = np.concatenate([motion_breaks(clip, rig), tool.keys.get(clip.name, np.zeros((0, 2)))[:, 0]])
    tissue = lagging_tissue(tool.lag, ratios, clip, breaks)

    def followed(times: Floats) -> tuple[Floats, Floats]:
        distances, rest_lengths = lengths(times)
        return tissue.follow(times, distances, rest_lengths), rest_lengths

    return followed


def _posed_anchor(
    anchor: BakedAnchor, rig: Rig, joints: dict[str, int], clip: Clip, times: Floats, morphs: Floats
) -> tuple[Floats, Floats]:
    """(frames, 3) where an anchor is, world space, and (frames,) its scale against rest.

    Args:
        anchor: In the spaces of its joints.
        rig: Of the node that gets the tracks.
        joints: Nodes by name.
        clip: The animation.
        times: (frames,) seconds.
        morphs: (frames, morph targets) weights of the rig's.
    """
    matrices = node_matrices(rig, clip, times, [joints[joint] for joint in anchor.joints])
    positions = np.tile(anchor.positions, (len(times), 1, 1))
    for name, deltas in anchor.morphs.items():
        if name in rig.morph_names:
            positions += morphs[:, rig.morph_names.index(name), None, None] * deltas
    moved = np.einsum("fkab,fkb->fka", matrices[:, :, :3, :3], positions) + matrices[:, :, :3, 3]
    scales = np.cbrt(np.abs(np.linalg.det(matrices[:, :, :3, :3])))
    return np.einsum("k,fka->fa", anchor.weights, moved), (scales / anchor.scales) @ anchor.weights


def _rest_lengths(tool: BakedTool, rig: Rig, clip: Clip, times: Floats, morphs: Floats) -> Floats:
    """(frames,) scene units; `morphs` are (frames, morph targets) weights of the rig's."""
    constant = np.full(len(times), tool.rest_length)
    if clip.name in tool.keys:
        return np.interp(times, *tool.keys[clip.name].T)
    if tool.morph is None or tool.morph[0] not in rig.morph_names:
        return constant
    share = np.clip(morphs[:, rig.morph_names.index(tool.morph[0])], 0.0, 1.0)
    lengths: Floats = constant + share * (tool.morph[1] - tool.rest_length)
    return lengths
