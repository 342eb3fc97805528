"""Motions that no file has, as clips of a second: a joint that turns on as it is stored, a morph target that rises.

Not in the paper. They show how a character bends where it has no clips, or where these must have no say.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Channel, Clip, sample
from wrinklecli.character.rig import Rig
from wrinklecli.numeric.arrays import Floats, cross

_FROM_START_TO_END = np.array([0.0, 1.0])


def motion_clip(name: str, channels: Iterable[Channel], *, index: int = -1) -> Clip:
    """A clip of a second; `index` is where its animation will be in a document, -1 where it gets into none."""
    return Clip(index, name, tuple(replace(each, index=number) for number, each in enumerate(channels)), 0.0, 1.0)


def turning(node: int, stored: Floats, axis: Floats, angle: float, times: Floats = _FROM_START_TO_END) -> Channel:
    """The rotation of a node that turns further and further, on from the stored one.

    Args:
        node: The node.
        stored: (4,) its rotation, of unit length.
        axis: (3,) unit, in the space of the node's parent.
        angle: After a second, radians; below 180° from one key to the next.
        times: (keys,) seconds.
    """
    halves = times * angle / 2.0
    turns = np.concatenate([np.sin(halves)[:, None] * axis, np.cos(halves)[:, None]], axis=1)
    return Channel(0, node, "rotation", times, quaternion_product(turns, stored), "LINEAR")


def raising(rig: Rig, weights: Mapping[int, float], times: Floats = _FROM_START_TO_END) -> Channel:
    """The weights of a rig's mesh, some of which, by their numbers, go from 0 to what they are after a second."""
    values = np.tile(rig.morph_weights, (len(times), 1))
    for number, weight in weights.items():
        values[:, number] = times * weight
    return Channel(0, rig.node, "weights", times, values, "LINEAR")


def quaternion_product(turns: Floats, stored: Floats) -> Floats:
    """(n, 4) quaternions (n, 4) times one (4,), x, y, z and w: first the one, then each turn."""
    vectors, reals = turns[:, :3], turns[:, 3:]
    imaginary = reals * stored[:3] + stored[3] * vectors + np.stack(cross(vectors.T, stored[:3, None]), axis=1)
    return np.concatenate([imaginary, reals * stored[3] - vectors @ stored[:3, None]], axis=1)


def turned_axis(rotation: Floats, axis: Floats) -> Floats:
    """(3,) an axis of a node's own space in that of its parent, by the node's (4,) rotation."""
    vector, real = rotation[:3], rotation[3]
    once = np.cross(vector, axis)
    return np.asarray(axis + 2.0 * (real * once + np.cross(vector, once)))


def approach(clip: Clip, time: float, rig: Rig) -> Clip:
    """A motion of a second from the stored pose to that of a clip at a time, under the clip's name."""
    at, channels = np.array([time]), []
    for channel in clip.channels:
        stored = rig.morph_weights if channel.path == "weights" else rig.locals[channel.node].get(channel.path)
        if stored is None or (channel.path == "weights" and channel.node != rig.node):
            continue
        values = np.stack([stored, sample(channel, at)[0]])
        channels.append(replace(channel, times=_FROM_START_TO_END, values=values, interpolation="LINEAR"))
    return motion_clip(clip.name, channels)
