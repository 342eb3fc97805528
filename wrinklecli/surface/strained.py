"""The triangles of a mesh that a clip can strain: what one moving node carries as a whole keeps its shape."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import reduce

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.numeric.arrays import Ints, distinct_values

# Part of a mesh's triangles from which on measuring all of them costs no more than selecting some.
_WHOLE_MESH = 0.5
# Stands for a node where a joint has no weight at a vertex; greater than the number of any node.
_NO_NODE = 2**60


@dataclass(frozen=True, slots=True)
class StrainedPart:
    """Some triangles of a mesh, with vertices numbered anew.

    Attributes:
        triangles: (chosen,) numbers of triangles of the mesh.
        vertices: (vertices,) numbers of vertices of the mesh, at the corners of these triangles.
        corners: (chosen, 3) indices into `vertices`.
    """

    triangles: Ints
    vertices: Ints
    corners: Ints


class StrainedParts:
    """Finds the triangles that a clip can strain. Clips that move the same nodes and morph targets share one part."""

    def __init__(self, rig: Rig, surface: Surface, triangles: Ints) -> None:
        """`triangles` are (triangles, 3) of the surface."""
        self._rig, self._surface, self._triangles = rig, surface, triangles
        self._known: dict[object, StrainedPart | None] = {}

    def of(self, clip: Clip) -> StrainedPart | None:
        """The triangles that a clip can strain; None for half of the mesh or more."""
        if any(channel.path == "scale" for channel in clip.channels):
            return None
        nodes = frozenset(channel.node for channel in clip.channels if channel.path != "weights")
        targets = _moving_targets(self._rig, clip)
        if (nodes, targets) not in self._known:
            self._known[nodes, targets] = self._part(nodes, targets)
        return self._known[nodes, targets]

    def _part(self, nodes: Collection[int], targets: tuple[int, ...]) -> StrainedPart | None:
        """The triangles that moving nodes and morph targets can strain."""
        surface, carriers = self._surface, _carriers(self._rig, nodes)
        # Column by column, as there are few: several times as fast as row by row.
        own = [np.where(w > 0, carriers[j], _NO_NODE) for j, w in zip(surface.joints.T, surface.weights.T, strict=True)]
        low = reduce(np.minimum, own)
        high = reduce(np.maximum, [np.where(each == _NO_NODE, -_NO_NODE, each) for each in own])
        a, b, c = self._triangles.T
        strained = np.minimum(np.minimum(low[a], low[b]), low[c]) != np.maximum(np.maximum(high[a], high[b]), high[c])
        if targets:
            morphed = np.any(surface.morph_deltas[list(targets)], axis=(0, 2))
            strained |= morphed[a] | morphed[b] | morphed[c]
        if strained.sum() >= _WHOLE_MESH * len(self._triangles):
            return None
        chosen = np.flatnonzero(strained)
        vertices, corners = distinct_values(self._triangles[chosen]), np.zeros(len(surface.positions), np.intp)
        corners[vertices] = np.arange(len(vertices))
        return StrainedPart(chosen, vertices, corners[self._triangles[chosen]])


def _carriers(rig: Rig, moving: Collection[int]) -> Ints:
    """(joints,) the nearest moving node that is the joint or an ancestor of it; -1 for none."""
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
    # The tangents of a cubic spline move a target too, whatever its keys are.
    if channel.interpolation == "CUBICSPLINE":
        return tuple(range(len(rig.morph_weights)))
    return tuple(np.flatnonzero((channel.values != rig.morph_weights).any(axis=0)).tolist())
