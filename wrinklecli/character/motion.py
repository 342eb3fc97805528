"""Makes clips of one second that no file has: a joint that turns from its stored rotation, a morph target that rises.

Not in the paper. They show how a character bends if it has no clips, or if its clips must not matter.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Channel, Clip, sample
from wrinklecli.character.rig import Rig
from wrinklecli.numeric.arrays import Floats

MOST_TURN = 150.0
"""Most degrees by which a joint turns to either side, as a knee and an elbow do."""

_FROM_START_TO_END = np.array([0.0, 1.0])


def motion_clip(name: str, channels: Iterable[Channel], *, index: int = -1) -> Clip:
    """Make a clip of one second; `index` is its animation's in a document, or -1 if it will be in none."""
    return Clip(index, name, tuple(replace(each, index=number) for number, each in enumerate(channels)), 0.0, 1.0)


def turning(node: int, stored: Floats, axis: Floats, angle: float, times: Floats = _FROM_START_TO_END) -> Channel:
    """Make a channel that turns a node evenly from its (4,) stored unit rotation.

    The (3,) unit axis is in the space of the node's parent. The angle is reached after a second, in radians, with less
    than 180° between two of the (keys,) times, seconds.
    """
    halves = times * angle / 2.0
    turns = np.concatenate([np.sin(halves)[:, None] * axis, np.cos(halves)[:, None]], axis=1)
    return Channel(0, node, "rotation", times, quaternion_product(turns, stored), "LINEAR")


def raising(rig: Rig, weights: Mapping[int, float], times: Floats = _FROM_START_TO_END) -> Channel:
    """Make a channel that raises weights of a rig's mesh, given by index, from 0 in a second."""
    values = np.tile(rig.morph_weights, (len(times), 1))
    for number, weight in weights.items():
        values[:, number] = times * weight
    return Channel(0, rig.node, "weights", times, values, "LINEAR")


def held_at(clip: Clip, time: Floats) -> list[Channel]:
    """The channels of a clip, each held for a second where it is at a (1,) time, seconds."""
    values = [np.repeat(sample(each, time), 2, axis=0) for each in clip.channels]
    pairs = zip(clip.channels, values, strict=True)
    return [replace(each, times=_FROM_START_TO_END, values=held, interpolation="LINEAR") for each, held in pairs]


def quaternion_product(turns: Floats, first: Floats) -> Floats:
    """(n, 4) products of (n, 4) quaternions, x, y, z and w, with those that act first: (n, 4), or (4,) for all."""
    # Coordinate by coordinate, as numpy takes twice as long along axes of three.
    (a, b, c, s), (p, q, r, t) = turns.T, first.T
    vectors = s * p + t * a + (b * r - c * q), s * q + t * b + (c * p - a * r), s * r + t * c + (a * q - b * p)
    return np.stack([*vectors, s * t - (a * p + b * q + c * r)], axis=1)


def turned_back(turns: Floats) -> Floats:
    """(…, 4) inverses of unit quaternions."""
    return turns * [-1.0, -1.0, -1.0, 1.0]


def turned_axis(rotation: Floats, axis: Floats) -> Floats:
    """(3,) an axis of a node with a (4,) rotation, in the space of its parent."""
    vector, real = rotation[:3], rotation[3]
    once = np.cross(vector, axis)
    return np.asarray(axis + 2.0 * (real * once + np.cross(vector, once)))


def approach(clip: Clip, time: float, rig: Rig) -> Clip:
    """Make a clip, of the same name, that moves in a second from the stored pose to that of a clip at a time."""
    at, channels = np.array([time]), []
    for channel in clip.channels:
        stored = rig.own.morph_weights if channel.path == "weights" else rig.locals[channel.node].get(channel.path)
        if stored is None or (channel.path == "weights" and channel.node != rig.node):
            continue
        values = np.stack([stored, sample(channel, at)[0]])
        channels.append(replace(channel, times=_FROM_START_TO_END, values=values, interpolation="LINEAR"))
    return motion_clip(clip.name, channels)
