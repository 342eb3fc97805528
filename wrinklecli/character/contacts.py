"""Finds the vertices at which a mesh touches itself or another mesh of its file: a gap opens there if one moves."""

from collections.abc import Container, Iterator
from functools import cached_property

import numpy as np

from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Rig, read_hierarchy, read_rig
from wrinklecli.character.skin import skinned_mesh
from wrinklecli.character.surface import Surface, Vertices, dense_influences, read_all_triangles, read_vertices
from wrinklecli.character.weld import SAME
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values
from wrinklecli.numeric.cells import leaders

# Slack of boxes, relative to their coordinates: rounding errors are far smaller.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class _Shown:
    """A mesh as one node shows it.

    Attributes:
        rig: Of the node.
        vertices: Those of the mesh, with any that no triangle uses: meshes may share their vertices.
        acting: (acting,) the joints that any vertex follows.
        triangles: (triangles, 3) none for points and lines.
    """

    rig: Rig
    vertices: Vertices
    acting: Ints
    triangles: Ints

    def morphed(self) -> Floats:
        """(vertices, 3) with the stored morph weights, bind space."""
        vertices = self.vertices
        return vertices.positions + np.tensordot(self.rig.morph_weights, vertices.morph_deltas, axes=1)

    def posed(self) -> Floats:
        """(vertices, 3) in the stored pose, world space."""
        vertices, rig = self.vertices, self.rig
        weights = dense_influences(vertices.joints, vertices.weights, len(rig.joints))
        mesh = skinned_mesh(rig, weights, vertices.positions, vertices.morph_deltas, self.triangles)
        return mesh.positions_at(None, 0.0)

    def seen(self) -> Floats:
        """(seen, 3) the posed vertices of triangles, and all those of a primitive that has none, as of points."""
        return self.posed()[self.vertices.seen(self.triangles)]

    def box(self) -> Floats:
        """(2, 3) least and greatest coordinates, world space, of a box round all vertices in the stored pose.

        A vertex lies between the places to which each of its joints alone would take it, and these lie in the boxes to
        which the joints take the box in bind space.
        """
        morphed = self.morphed()
        low, high = morphed.min(axis=0), morphed.max(axis=0)
        matrices = joint_matrices(self.rig, None, np.zeros(1), self.acting)[0, :, :3]
        middles = matrices[:, :, :3] @ ((low + high) / 2.0) + matrices[:, :, 3]
        reaches = np.abs(matrices[:, :, :3]) @ ((high - low) / 2.0)
        return np.stack([(middles - reaches).min(axis=0), (middles + reaches).max(axis=0)])


class Neighbours:
    """All meshes of a file in the stored pose, by the nodes that show them, read on demand."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._nodes = np.array([i for i, node in enumerate(document.items("nodes")) if "mesh" in node], np.intp)

    def near(self, node: int, low: Floats, high: Floats) -> Iterator[tuple[int, Floats]]:
        """Other nodes, and (seen, 3) world positions of each one's mesh that may reach into a box of (3,) bounds.

        Raises:
            AssetError: A mesh or a skin is malformed.
        """
        for number in self._meeting(node, low, high):
            yield int(self._nodes[number]), self._shown[number].seen()

    def triangles_near(self, node: int, low: Floats, high: Floats) -> Iterator[Floats]:
        """(triangles, 3, 3) world corners of each other node's mesh that may reach into a box of (3,) bounds.

        Raises:
            AssetError: A mesh or a skin is malformed.
        """
        for number in self._meeting(node, low, high):
            if number not in self._corners:
                shown = self._shown[number]
                self._corners[number] = shown.posed()[shown.triangles]
            yield self._corners[number]

    def _meeting(self, node: int, low: Floats, high: Floats) -> list[int]:
        """The numbers of other nodes whose meshes may reach into a box."""
        if len(self._nodes) < 2:
            return []
        boxes = self._boxes
        slack = _ROUNDING * np.abs(boxes).max(axis=(1, 2))[:, None]
        meets = ((boxes[:, 0] - slack <= high) & (boxes[:, 1] + slack >= low)).all(axis=1) & (self._nodes != node)
        found: list[int] = np.flatnonzero(meets).tolist()
        return found

    @cached_property
    def _corners(self) -> dict[int, Floats]:
        """The triangles of meshes that were asked for: many muscles may ask."""
        return {}

    @cached_property
    def _shown(self) -> list[_Shown]:
        hierarchy = read_hierarchy(self._document)
        known: dict[tuple[int, ...], tuple[Vertices, Ints, Ints]] = {}  # several nodes may show one mesh
        shown = []
        for node in self._nodes.tolist():
            rig = read_rig(self._document, node, hierarchy)
            key = (rig.mesh, rig.skinned, len(rig.joints))
            if key not in known:
                vertices = read_vertices(self._document, rig)
                acting = distinct_values(vertices.joints[vertices.weights > 0])
                known[key] = vertices, acting, read_all_triangles(self._document, rig, vertices)
            shown.append(_Shown(rig, *known[key]))
        return shown

    @cached_property
    def _boxes(self) -> Floats:
        """(nodes, 2, 3)."""
        return np.stack([each.box() for each in self._shown])


def contacts_of(
    neighbours: Neighbours, rig: Rig, surface: Surface, positions: Floats, along: Container[int] = ()
) -> Bools:
    """Mark the vertices at which a gap would open if they moved.

    All vertices are compared, also those that nothing displaces: an edge along another mesh leaves it when it is split.

    Args:
        neighbours: The meshes of the file.
        rig: Of this mesh.
        surface: This mesh, welded; vertices with an unwelded twin are marked.
        positions: (vertices, 3) world space at rest.
        along: Nodes whose meshes move along, so that no gap opens.

    Returns:
        (vertices,) whether a vertex has a twin or touches a vertex of another mesh at rest.

    Raises:
        AssetError: Another mesh is malformed.
    """
    contacts = surface.twins.copy()
    # The reach depends on the size in world space, as bind space may have quantised units.
    low, high = positions.min(axis=0), positions.max(axis=0)
    reach = SAME * float(np.linalg.norm(high - low))
    if reach > 0:
        for node, posed in neighbours.near(rig.node, low - 2.0 * reach, high + 2.0 * reach):
            if node not in along:
                contacts |= _touching(positions, posed, reach)
    return contacts


def _touching(positions: Floats, others: Floats, reach: float) -> Bools:
    """(vertices,) True for those of (vertices, 3) that lie where one of (others, 3) does."""
    low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
    others = others[((others >= low) & (others <= high)).all(axis=1)]
    touching = np.zeros(len(positions), np.bool_)
    if len(others):
        low, high = others.min(axis=0) - reach, others.max(axis=0) + reach
        near = np.flatnonzero(((positions >= low) & (positions <= high)).all(axis=1))
        places = leaders(np.concatenate([positions[near], others]), reach)
        touching[near] = np.isin(places[: len(near)], places[len(near) :])
    return touching
