"""Which triangles of a mesh a clip can strain: what one moving node carries as a whole keeps its shape."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import reduce

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.numeric.arrays import Ints, distinct_values

# Share of the triangles from which on it is not worth while to look at these alone.
_MOST = 0.5
_NONE = 2**60  # no node: a joint that has no part in a vertex


@dataclass(frozen=True, slots=True)
class StrainedPart:
    """Triangles of a mesh, with vertices of their own numbers.

    Attributes:
        triangles: (chosen,) of the mesh.
        vertices: (vertices,) of the mesh, at their corners.
        corners: (chosen, 3) which of these.
    """

    triangles: Ints
    vertices: Ints
    corners: Ints


class StrainedParts:
    """The triangles of a mesh that clips may strain, kept by what a clip moves: motions of one joint share them."""

    def __init__(self, rig: Rig, surface: Surface, triangles: Ints) -> None:
        """`triangles` are (triangles, 3) of the surface."""
        self._rig, self._surface, self._triangles = rig, surface, triangles
        self._known: dict[object, StrainedPart | None] = {}

    def of(self, clip: Clip) -> StrainedPart | None:
        """Those that a clip may strain; None where these are half of them or more."""
        if any(channel.path == "scale" for channel in clip.channels):
            return None
        nodes = frozenset(channel.node for channel in clip.channels if channel.path != "weights")
        targets = _moving_targets(self._rig, clip)
        if (nodes, targets) not in self._known:
            self._known[nodes, targets] = self._part(nodes, targets)
        return self._known[nodes, targets]

    def _part(self, nodes: Collection[int], targets: tuple[int, ...]) -> StrainedPart | None:
        """What nodes and morph targets may strain when they move."""
        surface, carriers = self._surface, _carriers(self._rig, nodes)
        # By columns, which are few: several times as fast as along rows.
        own = [np.where(w > 0, carriers[j], _NONE) for j, w in zip(surface.joints.T, surface.weights.T, strict=True)]
        low = reduce(np.minimum, own)
        high = reduce(np.maximum, [np.where(each == _NONE, -_NONE, each) for each in own])
        a, b, c = self._triangles.T
        strained = np.minimum(np.minimum(low[a], low[b]), low[c]) != np.maximum(np.maximum(high[a], high[b]), high[c])
        if targets:
            morphed = np.any(surface.morph_deltas[list(targets)], axis=(0, 2))
            strained |= morphed[a] | morphed[b] | morphed[c]
        if strained.sum() >= _MOST * len(self._triangles):
            return None
        chosen = np.flatnonzero(strained)
        vertices, corners = distinct_values(self._triangles[chosen]), np.zeros(len(surface.positions), np.intp)
        corners[vertices] = np.arange(len(vertices))
        return StrainedPart(chosen, vertices, corners[self._triangles[chosen]])


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


def _moving_targets(rig: Rig, clip: Clip) -> tuple[int, ...]:
    """The numbers of the morph targets that a clip moves."""
    channel = clip.channel(rig.node, "weights")
    if channel is None:
        return ()
    # The tangents of a cubic spline move too.
    if channel.interpolation == "CUBICSPLINE":
        return tuple(range(len(rig.morph_weights)))
    return tuple(np.flatnonzero((channel.values != rig.morph_weights).any(axis=0)).tolist())
