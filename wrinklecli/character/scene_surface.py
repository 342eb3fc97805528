"""The welded surfaces of all nodes of a scene together, and what crosses on them over time.

Each node's mesh is welded first, so that seams are no borders and triangles that share a point do not cross.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.scene_meshes import read_scene_meshes
from wrinklecli.character.skin import SkinnedMesh
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct, distinct_values
from wrinklecli.numeric.intersections import Crossings

# Coordinates that are posed at once. Bounds the memory.
_COORDINATES = 2**22


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
        step = max(_COORDINATES // (3 * max(len(self.positions), 1)), 1)
        for k in range(0, len(times), step):
            for places in self.posed(clip, times[k : k + step]):
                edges, triangles = self.crossings.at(places)
                every.append(CrossingPairs(self.crossings.edges[edges], self.crossings.triangles[triangles]))
        return every

    def owners(self, vertices: Ints) -> Ints:
        """(vertices,) the index of the whole surface of each vertex."""
        return self.wholes[np.searchsorted(self.starts, vertices, side="right") - 1]


def read_scene_surface(document: Document, wholes: Mapping[int, int]) -> SceneSurface:
    """Weld the triangles of every node of the default scene.

    `wholes` gives, for nodes whose meshes are parts of a split one, the node of the whole. Parts are welded together.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    meshes = read_scene_meshes(document)
    starts = np.cumsum([0, *(len(each.bind_positions) for each in meshes)])
    triangles = [each.triangles + start for each, start in zip(meshes, starts.tolist(), strict=False)]
    carriers = [_joints(each.rig, wholes)[np.argmax(each.weights, axis=1)] for each in meshes]
    positions = _posed(meshes, None, np.zeros(1))[0]
    whole_of = _wholes([each.rig for each in meshes], wholes)
    joined = _joined(meshes, starts, whole_of)
    return SceneSurface(
        meshes=meshes,
        wholes=whole_of,
        starts=starts,
        positions=positions,
        carriers=np.concatenate([np.zeros(0, np.intp), *carriers]),
        crossings=Crossings.of(positions, joined[np.concatenate([np.zeros((0, 3), np.intp), *triangles])]),
    )


def _wholes(rigs: Sequence[Rig], wholes: Mapping[int, int]) -> Ints:
    """(rigs,) the number of the rig of each one's whole, which has the same joints; its own number without one."""
    numbers = {rig.node: number for number, rig in enumerate(rigs)}
    found = np.arange(len(rigs))
    for number, rig in enumerate(rigs):
        whole = numbers.get(wholes.get(rig.node, rig.node), number)
        if np.array_equal(_joints(rig, wholes), _joints(rigs[whole], wholes)):
            found[number] = whole
    return found


def _joints(rig: Rig, wholes: Mapping[int, int]) -> Ints:
    """(joints,) the rig's joints; of a part without skin the node of the whole."""
    return rig.joints if rig.skinned else np.array([wholes.get(rig.node, rig.node)], np.intp)


def _joined(meshes: Sequence[SkinnedMesh], starts: Ints, wholes: Ints) -> Ints:
    """(vertices,) for each vertex of all meshes the first one that moves alike in its place, in a part of its whole."""
    first = np.arange(starts[-1])
    for whole in distinct_values(wholes):
        parts = np.flatnonzero(wholes == whole).tolist()
        if len(parts) == 1:
            continue
        vertices = np.concatenate([np.arange(starts[part], starts[part + 1]) for part in parts])
        _, places = distinct(np.concatenate([meshes[part].bind_positions for part in parts]))
        met = np.bincount(places)[places] > 1
        names = sorted({name for part in parts for name in meshes[part].rig.morph_names})
        ends = np.cumsum([len(meshes[part].bind_positions) for part in parts])[:-1]
        split = zip(parts, np.split(met, ends), strict=True)
        firsts, which = distinct(np.concatenate([_motions(meshes[part], chosen, names) for part, chosen in split]))
        first[vertices[met]] = vertices[met][firsts[which]]
    return first


def _motions(mesh: SkinnedMesh, chosen: Bools, names: Sequence[str]) -> Floats:
    """(chosen, columns) all that moves the chosen (vertices,): positions, weights, deltas of morph targets by name."""
    still = np.zeros((int(chosen.sum()), 3))
    deltas = dict(zip(mesh.rig.morph_names, mesh.deltas[:, chosen], strict=True))
    return np.hstack([mesh.bind_positions[chosen], mesh.weights[chosen], *(deltas.get(name, still) for name in names)])


def _posed(meshes: Sequence[SkinnedMesh], clip: Clip | None, times: Floats) -> Floats:
    """(frames, vertices, 3) of all meshes, world space."""
    return np.concatenate(
        [np.zeros((len(times), 0, 3)), *(each.posed(clip, times).positions for each in meshes)], axis=1
    )
