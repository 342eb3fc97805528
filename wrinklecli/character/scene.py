"""Reads all primitives of a scene and poses them as an engine would, for `preview`, `diff` and `suggest`.

A bake welds one mesh to a surface. Here every primitive of every node is as the file stores it, with its own vertices,
normals and skin weights.

Source: glTF 2.0 §3.5 (scenes), §3.7.2.2 (morph targets), §3.7.3.3 (skinned meshes).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.rig import Hierarchy, Rig, morph_target_names, read_hierarchy, read_parents, read_rig
from wrinklecli.character.skin import Skin, pose, prepare
from wrinklecli.character.surface import Vertices, dense_influences, read_primitive, read_triangles
from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values


@dataclass(frozen=True, slots=True)
class ScenePrimitive:
    """One primitive as one node shows it.

    Attributes:
        rig: An unskinned mesh follows its own node with weight 1.
        primitive: Index in the mesh.
        where: JSON pointer.
        vertices: Stored vertices, bind space.
        triangles: (triangles, 3) vertices; none for points and lines.
        skin: The vertices, ready to be posed.
        colour: (3,) base colour factor of the material, linear RGB.
    """

    rig: Rig
    primitive: int
    where: str
    vertices: Vertices
    triangles: Ints
    skin: Skin
    colour: Floats

    @property
    def name(self) -> str:
        """The name of the node."""
        return self.rig.names[self.rig.node]

    @property
    def bare(self) -> "ScenePrimitive":
        """The primitive without normals, which is posed in half the time."""
        return replace(self, skin=replace(self.skin, turns=None))

    @property
    def seen(self) -> Ints:
        """Sorted visible vertices: those of triangles, or all of points and lines."""
        return distinct_values(self.triangles) if len(self.triangles) else np.arange(len(self.vertices.positions))


@dataclass(frozen=True, slots=True)
class PosedPrimitive:
    """A primitive at some times, world space, scene units.

    Attributes:
        positions: (frames, vertices, 3).
        normals: (frames, vertices, 3) unit; None if the file has none, which means flat shading.
        mirrored: (frames,) True if the node mirrors an unskinned mesh, so that its triangles wind the other way.
        hidden: (frames,) True if the node of an unskinned mesh is scaled to 0, as files with a mesh per frame do.
    """

    positions: Floats
    normals: Floats | None
    mirrored: NDArray[np.bool_]
    hidden: NDArray[np.bool_]


def scene_nodes(document: Document) -> list[int]:
    """Sorted nodes of the default scene; all nodes if the file has no scene."""
    nodes, scenes = document.items("nodes"), document.items("scenes")
    if not scenes:
        return list(range(len(nodes)))
    found: set[int] = set()
    stack = list(scenes[document.gltf.get("scene", 0)].get("nodes", []))
    while stack:
        node = stack.pop()
        if node not in found:
            found.add(node)
            stack += nodes[node].get("children", [])
    return sorted(found)


def deforming_nodes(document: Document) -> list[int]:
    """Sorted nodes of the default scene whose meshes a skin or morph targets deform."""
    return [node for node in scene_nodes(document) if deforms(document, node)]


def deforms(document: Document, node: int) -> bool:
    """True if a node has a mesh that a skin or morph targets deform."""
    shown = document.items("nodes")[node]
    if "mesh" not in shown:
        return False
    return "skin" in shown or bool(morph_target_names(document.items("meshes")[shown["mesh"]]))


def read_scene(document: Document, *, leave_out_malformed: bool = False) -> tuple[ScenePrimitive, ...]:
    """Read every primitive of every node of the default scene, in the document's order.

    Raises:
        AssetError: The hierarchy is malformed, or a mesh or skin is and `leave_out_malformed` is False.
    """
    nodes = document.items("nodes")
    read_parents(document)  # a malformed hierarchy is never left out
    primitives: list[ScenePrimitive] = []
    known: dict[tuple[int, ...], ScenePrimitive] = {}
    hierarchy: Hierarchy | None = None
    for node in scene_nodes(document):
        if "mesh" in nodes[node]:
            try:
                hierarchy = hierarchy or read_hierarchy(document)
                primitives += list(_read_node(document, node, hierarchy, known))
            except TooMuchError:
                raise
            except AssetError:
                if not leave_out_malformed:
                    raise
    return tuple(primitives)


def _read_node(
    document: Document, node: int, hierarchy: Hierarchy, known: dict[tuple[int, ...], ScenePrimitive]
) -> Iterator[ScenePrimitive]:
    """Give the primitives of a node; `known` has those of other nodes, by mesh and rig, and gets new ones."""
    rig = read_rig(document, node, hierarchy)
    for number, primitive in enumerate(document.items("meshes")[rig.mesh].get("primitives", [])):
        where = document.where("meshes", rig.mesh, "primitives", number)
        key = (rig.mesh, number, rig.skinned, len(rig.joints))
        if key not in known:
            vertices = read_primitive(document, primitive, rig, where)
            known[key] = ScenePrimitive(
                rig=rig,
                primitive=number,
                where=where,
                vertices=vertices,
                triangles=read_triangles(document, primitive, len(vertices.positions), where),
                skin=_skin(vertices, len(rig.joints)),
                colour=_base_colour(_material(document, primitive)),
            )
        yield replace(known[key], rig=rig)


def _material(document: Document, primitive: Json) -> Json:
    """A primitive's material; empty if it has none, or one that does not exist."""
    materials = document.items("materials")
    number = primitive.get("material", len(materials))
    return materials[number] if number < len(materials) else {}


def _base_colour(material: Json) -> Floats:
    """(3,) linear RGB; white if the file has no valid colour, as appearance is no reason to refuse a file."""
    try:
        factor = np.array(material["pbrMetallicRoughness"]["baseColorFactor"], np.float64)
    except (KeyError, TypeError, ValueError, OverflowError):
        return np.ones(3)
    known = factor.ndim == 1 and len(factor) >= 3 and bool(np.isfinite(factor).all())
    return np.clip(factor[:3], 0.0, 1.0) if known else np.ones(3)


def _skin(vertices: Vertices, joint_count: int) -> Skin:
    weights = dense_influences(vertices.joints, vertices.weights, joint_count)
    return prepare(weights, vertices.positions, vertices.morph_deltas, vertices.normals, vertices.normal_deltas)


def pose_primitive(primitive: ScenePrimitive, clip: Clip | None, times: Floats) -> PosedPrimitive:
    """Morph and skin a primitive at (frames,) seconds of a clip, or without a clip in the stored pose."""
    rig = primitive.rig
    matrices = joint_matrices(rig, clip, times)
    weights = morph_weights(rig, clip, times)
    determinants = np.linalg.det(matrices[:, 0, :3, :3])
    mirrored = np.zeros(len(times), bool) if rig.skinned else determinants < 0
    hidden = np.zeros(len(times), bool) if rig.skinned else determinants == 0
    positions, normals = pose(primitive.skin, matrices, weights)
    turned = None if normals is None else normals.transpose(0, 2, 1)
    return PosedPrimitive(positions.transpose(0, 2, 1), turned, mirrored, hidden)
