"""The welded surfaces of all nodes of a scene together, and what crosses on them over time.

Each node's mesh is welded first, so that seams are no borders and triangles that share a point do not cross.
"""

from collections.abc import Collection, Mapping, Sequence
from functools import reduce
from itertools import pairwise

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig, read_hierarchy, read_rig
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.skin import Influences, SkinnedMesh
from wrinklecli.character.surface import has_triangles, read_surface
from wrinklecli.character.weld import weld
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.intersections import Crossings
from wrinklecli.numeric.portions import portions


@dataclass(frozen=True, slots=True)
class CrossingPairs:
    """Edges that pass through triangles at one time, by the vertices of `SceneSurface`.

    Attributes:
        edges: (crossings, 2).
        triangles: (crossings, 3) the triangle that each edge passes through.
    """

    edges: Ints
    triangles: Ints


@dataclass(frozen=True, slots=True)
class SceneSurface:
    """The surfaces of all nodes of a scene, with the vertices of one behind those of another.

    Attributes:
        meshes: The surfaces, ready to be posed.
        wholes: (meshes,) the surface of which each is a part; itself if it is whole.
        starts: (meshes + 1,) the first vertex of each surface.
        positions: (vertices, 3) world space, in the stored pose.
        carriers: (vertices,) the node that carries most of each vertex.
        crossings: Finds crossings among all surfaces.
    """

    meshes: tuple[SkinnedMesh, ...]
    wholes: Ints
    starts: Ints
    positions: Floats
    carriers: Ints
    crossings: Crossings

    @property
    def rigs(self) -> tuple[Rig, ...]:
        """One for each surface."""
        return tuple(each.rig for each in self.meshes)

    def posed(self, clip: Clip | None, times: Floats) -> Floats:
        """(frames, vertices, 3) at (frames,) seconds of a clip, world space; without a clip in the stored pose."""
        return _posed(self.meshes, clip, times)

    def found(self, clip: Clip | None, times: Floats) -> list[CrossingPairs]:
        """Find what crosses at each of (frames,) seconds of a clip."""
        every: list[CrossingPairs] = []
        for part in portions(len(times), 3 * len(self.positions)):
            for places in self.posed(clip, times[part]):
                edges, triangles = self.crossings.at(places)
                every.append(CrossingPairs(self.crossings.edges[edges], self.crossings.triangles[triangles]))
        return every

    def owners(self, vertices: Ints) -> Ints:
        """(vertices,) the index of the whole surface of each vertex."""
        return self.wholes[np.searchsorted(self.starts, vertices, side="right") - 1]


def read_scene_meshes(
    document: Document, chosen: Collection[int] | None = None, ignored: Collection[str] = ()
) -> tuple[SkinnedMesh, ...]:
    """Read every mesh of the default scene, or of chosen nodes, except those of nodes with `ignored` names.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    nodes, hierarchy = document.items("nodes"), read_hierarchy(document)
    found = []
    for node in scene_nodes(document) if chosen is None else chosen:
        shown = nodes[node]
        if hierarchy.names[node] in ignored or "mesh" not in shown:
            continue
        if not has_triangles(document, shown["mesh"]):
            continue
        rig = read_rig(document, node, hierarchy)
        found.append(read_surface(document, rig).skinned(rig))
    return tuple(found)


def read_scene_surface(document: Document, wholes: Mapping[int, int]) -> SceneSurface:
    """Weld the triangles of every node of the default scene.

    `wholes` gives, for nodes whose meshes are parts of a split one, the node of the whole. Parts are welded together.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    meshes = read_scene_meshes(document)
    starts = np.cumsum([0, *(len(each.bind_positions) for each in meshes)])
    triangles = [each.triangles + start for each, start in zip(meshes, starts.tolist(), strict=False)]
    carriers = [_joints(each.rig, wholes)[each.influences.heaviest] for each in meshes]
    positions = _posed(meshes, None, np.zeros(1))[0]
    # (rigs,) the number of the rig of each one's whole, which has the same joints; its own number without one.
    rigs = [each.rig for each in meshes]
    numbers = {rig.node: number for number, rig in enumerate(rigs)}
    whole_of = np.arange(len(rigs))
    for number, rig in enumerate(rigs):
        whole = numbers.get(wholes.get(rig.node, rig.node), number)
        if np.array_equal(_joints(rig, wholes), _joints(rigs[whole], wholes)):
            whole_of[number] = whole
    joined = _joined(meshes, starts, whole_of)
    return SceneSurface(
        meshes=meshes,
        wholes=whole_of,
        starts=starts,
        positions=positions,
        carriers=np.concatenate([np.zeros(0, np.intp), *carriers]),
        crossings=Crossings.of(positions, joined[np.concatenate([np.zeros((0, 3), np.intp), *triangles])]),
    )


def _joints(rig: Rig, wholes: Mapping[int, int]) -> Ints:
    """(joints,) the rig's joints; of a part without skin the node of the whole."""
    return rig.joints if rig.skinned else np.array([wholes.get(rig.node, rig.node)], np.intp)


def _joined(meshes: Sequence[SkinnedMesh], starts: Ints, wholes: Ints) -> Ints:
    """(vertices,) for each vertex of all meshes the first one that is the same point of a part of its whole."""
    first = np.arange(starts[-1])
    for whole in distinct_values(wholes):
        numbers = np.flatnonzero(wholes == whole).tolist()
        if len(numbers) == 1:
            continue
        parts = [meshes[number] for number in numbers]
        vertices = np.concatenate([np.arange(starts[number], starts[number + 1]) for number in numbers])
        names = sorted({name for part in parts for name in part.rig.morph_names})
        deltas = np.zeros((len(names), len(vertices), 3))
        ends = np.cumsum([0, *(len(part.bind_positions) for part in parts)]).tolist()
        for part, (begin, end) in zip(parts, pairwise(ends), strict=True):
            deltas[[names.index(name) for name in part.rig.morph_names], begin:end] = part.deltas
        places = np.vstack([each.bind_positions for each in parts])
        followed = reduce(Influences.before, (each.influences for each in parts))
        points = weld(places, deltas, followed.joints.T, followed.weights.T).points
        first[vertices] = vertices[np.unique(points, return_index=True)[1][points]]
    return first


def _posed(meshes: Sequence[SkinnedMesh], clip: Clip | None, times: Floats) -> Floats:
    """(frames, vertices, 3) of all meshes, world space."""
    return np.concatenate(
        [np.zeros((len(times), 0, 3)), *(each.posed(clip, times).positions for each in meshes)], axis=1
    )
