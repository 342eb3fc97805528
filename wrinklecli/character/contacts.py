"""Finds the vertices at which a mesh touches itself or another one that is drawn with it: a gap opens if one moves."""

from collections.abc import Container, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.rig import Hierarchy, Rig, read_hierarchy, read_rig
from wrinklecli.character.scene import drawn_with
from wrinklecli.character.skin import Influences, skinned_mesh
from wrinklecli.character.surface import Surface, Vertices, read_all_triangles, read_vertices
from wrinklecli.character.weld import SAME
from wrinklecli.choices import Part
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, Ints, diagonal, distinct_values, flags_of
from wrinklecli.numeric.cells import leaders
from wrinklecli.numeric.closest import ROUNDING
from wrinklecli.numeric.edges import Edges
from wrinklecli.numeric.memory import once


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
        influences = Influences(vertices.joints.T, vertices.weights.T, len(rig.joints))
        mesh = skinned_mesh(rig, influences, vertices.positions, vertices.morph_deltas, self.triangles)
        return mesh.positions_at(None, 0.0)

    def corners(self) -> Floats:
        """(triangles, 3, 3) those of the posed triangles."""
        return np.asarray(self.posed()[self.triangles])

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
    """The meshes of a file in the stored pose, by the nodes that show them, read on demand."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._known: dict[tuple[int, ...], tuple[Vertices, Ints, Ints]] = {}  # several nodes may show one mesh
        self._shown: dict[int, _Shown] = {}
        self._corners: dict[int, Floats] = {}  # many muscles may ask for triangles
        self._boxes: dict[int, Floats] = {}
        self._drawn: dict[int, Ints] = {}
        self.unread: dict[int, str] = {}  # nodes whose mesh cannot be read, and why: they are left out
        self.known: dict[str, Any] = {}  # what is found once for all meshes of the file

    def near(self, node: int, low: Floats, high: Floats) -> Iterator[tuple[int, Floats]]:
        """The nodes that are drawn with a node, and (seen, 3) world positions of meshes that may reach into a box.

        `low` and `high` are the (3,) bounds.
        """
        for other in self._meeting(node, low, high):
            yield other, self._of(other).seen()

    def triangles_near(self, node: int, low: Floats, high: Floats) -> Iterator[tuple[int, Floats]]:
        """The same nodes, and (triangles, 3, 3) world corners of their meshes."""
        for other in self._meeting(node, low, high):
            yield other, once(self._corners, other, self._of(other).corners)

    def _meeting(self, node: int, low: Floats, high: Floats) -> list[int]:
        """The other nodes that are drawn with a node and whose meshes may reach into a box."""
        if node not in self._drawn:
            nodes = self._document.items("nodes")
            shown = [each for each in drawn_with(self._document, node) if each != node and "mesh" in nodes[each]]
            shown = [each for each in shown if self._can_be_read(each)]
            self._boxes |= {each: self._of(each).box() for each in shown if each not in self._boxes}
            # Scaled to nothing, a mesh is not drawn (glTF 2.0 §3.5.3).
            large = [each for each in shown if (self._boxes[each][0] != self._boxes[each][1]).any()]
            self._drawn[node] = np.array(large, np.intp)
        drawn = self._drawn[node]
        boxes = np.array([self._boxes[each] for each in drawn.tolist()]).reshape(-1, 2, 3)
        slack = ROUNDING * np.abs(boxes).max(axis=(1, 2), initial=0.0)[:, None]
        meets = ((boxes[:, 0] - slack <= high) & (boxes[:, 1] + slack >= low)).all(axis=1)
        found: list[int] = drawn[meets].tolist()
        return found

    def _can_be_read(self, node: int) -> bool:
        try:
            self._of(node)
        except AssetError as error:
            self.unread[node] = str(error)
        return node not in self.unread

    def _of(self, node: int) -> _Shown:
        if node not in self._shown:
            rig = read_rig(self._document, node, self.hierarchy)
            key = (rig.mesh, rig.skinned, len(rig.joints))
            if key not in self._known:
                vertices = read_vertices(self._document, rig)
                acting = distinct_values(vertices.joints[vertices.weights > 0])
                self._known[key] = vertices, acting, read_all_triangles(self._document, rig, vertices)
            self._shown[node] = _Shown(rig, *self._known[key])
        return self._shown[node]

    @cached_property
    def hierarchy(self) -> Hierarchy:
        """The nodes of the file."""
        return read_hierarchy(self._document)

    @cached_property
    def parts(self) -> tuple[Part | None, ...]:
        """(nodes,) the part of the body that each node is."""
        from wrinklecli.character.bones import read_bones  # most bakes need none

        return read_bones(self._document).parts


@dataclass(frozen=True, slots=True)
class Contacts:
    """The places at which a gap would open if the vertices there moved.

    Attributes:
        held: (vertices,) whether a vertex has a twin or touches a vertex of another mesh at rest.
        copies: The nodes of other meshes that are copies of this one, or levels of detail: they hold nothing.
        unread: Other nodes whose mesh cannot be read, and why: they hold nothing.
    """

    held: Bools
    copies: tuple[int, ...]
    unread: dict[int, str]


def contacts_of(
    neighbours: Neighbours, rig: Rig, surface: Surface, positions: Floats, along: Container[int] = ()
) -> Contacts:
    """Find the vertices at which a gap would open if they moved.

    All vertices are compared, also those that nothing displaces: an edge along another mesh leaves it when it is split.

    Args:
        neighbours: The meshes of the file.
        rig: Of this mesh.
        surface: This mesh, welded; vertices with an unwelded twin are marked.
        positions: (vertices, 3) world space at rest.
        along: Nodes whose meshes move along, so that no gap opens.
    """
    held, copies = surface.twins.copy(), []
    # The reach depends on the size in world space, as bind space may have quantised units.
    low, high = positions.min(axis=0), positions.max(axis=0)
    reach = SAME * float(np.linalg.norm(high - low))
    if reach > 0:
        for node, posed in neighbours.near(rig.node, low - 2.0 * reach, high + 2.0 * reach):
            touching = _touching(positions, posed, reach)
            if node not in along and touching.any():
                if _is_copy(surface.triangles, positions, posed, touching, reach):
                    copies.append(node)
                else:
                    held |= touching
    return Contacts(held, tuple(copies), neighbours.unread)


def _is_copy(triangles: Ints, positions: Floats, others: Floats, touching: Bools, reach: float) -> bool:
    """True if the mesh of (others, 3) is the same surface as this one, such as a coarser level of it.

    It is about as large, and most vertices of one lie at the other's. Neighbours meet at borders, which do not count:
    there one goes on as the other, or caps it.
    """
    smaller, larger = sorted((diagonal(positions), diagonal(others)))
    edges = Edges.of(triangles)
    inner = np.flatnonzero(~flags_of(edges.vertices[edges.counts == 1], len(positions)))
    of_theirs = _touching(others, positions[inner], reach).sum()
    most = 2 * of_theirs > len(others) or 2 * touching[inner].sum() > len(inner)
    return bool(most and 2.0 * smaller > larger)


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
