"""Which triangles of a mesh a clip can strain: what one moving node carries as a whole keeps its shape."""

from collections.abc import Collection
from functools import reduce

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.numeric.arrays import Bools, Ints

# Share of the triangles from which on it is not worth while to look at these alone.
_MOST = 0.5
_NONE = 2**60  # no node: a joint that has no part in a vertex


def strained_triangles(rig: Rig, surface: Surface, triangles: Ints, clip: Clip) -> Ints | None:
    """(chosen,) the triangles that a clip may strain; None where these are half of them or more.

    Args:
        rig: Of the mesh.
        surface: The mesh.
        triangles: (triangles, 3) of it.
        clip: The animation.
    """
    if any(channel.path == "scale" for channel in clip.channels):
        return None
    carriers = _carriers(rig, {channel.node for channel in clip.channels if channel.path != "weights"})
    # By columns, which are few: several times as fast as along rows.
    own = [np.where(w > 0, carriers[j], _NONE) for j, w in zip(surface.joints.T, surface.weights.T, strict=True)]
    low = reduce(np.minimum, own)
    high = reduce(np.maximum, [np.where(each == _NONE, -_NONE, each) for each in own])
    a, b, c = triangles.T
    strained = np.minimum(np.minimum(low[a], low[b]), low[c]) != np.maximum(np.maximum(high[a], high[b]), high[c])
    morphed = _morphed(rig, surface, clip)
    if morphed is not None:
        strained |= morphed[a] | morphed[b] | morphed[c]
    return np.flatnonzero(strained) if strained.sum() < _MOST * len(triangles) else None


def _carriers(rig: Rig, moving: Collection[int]) -> Ints:
    """(joints,) of some moving nodes the nearest that each joint hangs on, or is; -1 where there is none."""
    known = {-1: -1} | {node: node for node in moving}

    def carrier(node: int) -> int:
        chain = []
        while node not in known:
            chain.append(node)
            node = int(rig.parents[node])
        known.update(dict.fromkeys(chain, known[node]))
        return known[node]

    return np.array([carrier(int(joint)) for joint in rig.joints], np.intp)


def _morphed(rig: Rig, surface: Surface, clip: Clip) -> Bools | None:
    """(vertices,) whether a clip moves a vertex by morph targets; None where it does not drive them."""
    channel = clip.channel(rig.node, "weights")
    if channel is None:
        return None
    # The tangents of a cubic spline move too.
    spline = channel.interpolation == "CUBICSPLINE"
    changing = slice(None) if spline else np.flatnonzero((channel.values != rig.morph_weights).any(axis=0))
    moved: Bools = np.any(surface.morph_deltas[changing], axis=(0, 2))
    return moved
