"""Reads all meshes of a scene, welded, with dense skin weights: obstacles of a fold, and surfaces that may cross."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.character.rig import Rig, read_hierarchy, read_rig
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.surface import has_triangles, read_surface
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, Ints


@dataclass(frozen=True, slots=True)
class SceneMesh:
    """A mesh as a node shows it.

    Attributes:
        weights: (vertices, joints) skin weights.
        positions: (vertices, 3) bind space.
        morph_deltas: (morph targets, vertices, 3).
        triangles: (triangles, 3).
    """

    rig: Rig
    weights: Floats
    positions: Floats
    morph_deltas: Floats
    triangles: Ints

    def posed(self, clip: Clip | None, times: Floats) -> tuple[Floats, Floats]:
        """Pose the mesh at (frames,) seconds of a clip, or without a clip in the stored pose.

        Returns:
            (frames, vertices, 3) world positions, and (frames, vertices, 3, 3) matrices from bind space.
        """
        blended = blend(self.weights, joint_matrices(self.rig, clip, times))
        bind = self.positions + np.tensordot(morph_weights(self.rig, clip, times), self.morph_deltas, axes=1)
        return transform(blended, bind), blended[..., :3]

    def part(self, chosen: Bools) -> "SceneMesh":
        """The chosen (triangles,) with their vertices."""
        vertices, local = np.unique(self.triangles[chosen], return_inverse=True)
        return replace(
            self,
            weights=self.weights[vertices],
            positions=self.positions[vertices],
            morph_deltas=self.morph_deltas[:, vertices],
            triangles=local.reshape(-1, 3),
        )


def read_scene_meshes(
    document: Document, without: int | None = None, ignored: Collection[str] = ()
) -> tuple[SceneMesh, ...]:
    """Read every mesh of the default scene except those of the node `without` and of nodes with `ignored` names.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    nodes, hierarchy = document.items("nodes"), read_hierarchy(document)
    found = []
    for node in scene_nodes(document):
        shown = nodes[node]
        if node == without or shown.get("name") in ignored or "mesh" not in shown:
            continue
        if not has_triangles(document, shown["mesh"]):
            continue
        rig = read_rig(document, node, hierarchy)
        surface = read_surface(document, rig)
        weights = surface.dense_weights(np.arange(len(surface.positions)), len(rig.joints))
        found.append(SceneMesh(rig, weights, surface.positions, surface.morph_deltas, surface.triangles))
    return tuple(found)
