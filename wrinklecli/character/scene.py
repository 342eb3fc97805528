"""All that a scene shows, posed as an engine would: what `preview`, `diff` and `suggest` look at.

Where the stages of a bake know one mesh as a welded surface, here every primitive of every node is as the file stores
it: its own vertices, its own normals, its own skin weights.

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
        rig: What moves it; an unskinned mesh hangs on its own node with weight 1.
        primitive: Its number in the mesh.
        where: Its JSON pointer.
        vertices: As stored, bind space.
        triangles: (triangles, 3) its vertices; none for points and lines.
        skin: Its vertices, ready to be posed.
        colour: (3,) base colour factor of its material, linear RGB.
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
    def seen(self) -> Ints:
        """The vertices that are seen, rising: those of triangles, or all of points and lines."""
        return distinct_values(self.triangles) if len(self.triangles) else np.arange(len(self.vertices.positions))


@dataclass(frozen=True, slots=True)
class PosedPrimitive:
    """A primitive at some times, world space, scene units.

    Attributes:
        positions: (frames, vertices, 3).
        normals: (frames, vertices, 3) unit; None where the file has none, which means flat shading.
        mirrored: (frames,) whether the node mirrors an unskinned mesh, so that its triangles wind the other way.
        hidden: (frames,) whether the node of an unskinned mesh is scaled to 0: so files with a mesh a frame hide one.
    """

    positions: Floats
    normals: Floats | None
    mirrored: NDArray[np.bool_]
    hidden: NDArray[np.bool_]


def scene_nodes(document: Document) -> list[int]:
    """The nodes of the default scene, ascending; all of them where the file has no scene."""
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
    """The nodes of the default scene, ascending, whose meshes a skin or morph targets deform."""
    return [node for node in scene_nodes(document) if deforms(document, node)]


def deforms(document: Document, node: int) -> bool:
    """Whether a node has a mesh that a skin or morph targets deform."""
    shown = document.items("nodes")[node]
    if "mesh" not in shown:
        return False
    return "skin" in shown or bool(morph_target_names(document.items("meshes")[shown["mesh"]]))


def read_scene(document: Document, *, leave_out_malformed: bool = False) -> tuple[ScenePrimitive, ...]:
    """Every primitive of every node of the default scene, in the document's order.

    Args:
        document: With the scene.
        leave_out_malformed: Go on without nodes whose mesh or skin is malformed.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    nodes = document.items("nodes")
    read_parents(document)  # a hierarchy is malformed for all
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
    """What a node shows; `known` is what other nodes show, by mesh and rig, and gets what is new."""
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
    """A primitive's material; empty where it has none, or one that is not there."""
    materials = document.items("materials")
    number = primitive.get("material", len(materials))
    return materials[number] if number < len(materials) else {}


def _base_colour(material: Json) -> Floats:
    """(3,) linear RGB; white where the file says nothing that is a colour, as looks are no reason to refuse it."""
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
    """Morph and skin a primitive by its own weights.

    Args:
        primitive: Of the scene.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds; before the first and after the last key a channel holds.
    """
    rig = primitive.rig
    matrices = joint_matrices(rig, clip, times)
    weights = morph_weights(rig, clip, times)
    determinants = np.linalg.det(matrices[:, 0, :3, :3])
    mirrored = np.zeros(len(times), bool) if rig.skinned else determinants < 0
    hidden = np.zeros(len(times), bool) if rig.skinned else determinants == 0
    positions, normals = pose(primitive.skin, matrices, weights)
    turned = None if normals is None else normals.transpose(0, 2, 1)
    return PosedPrimitive(positions.transpose(0, 2, 1), turned, mirrored, hidden)
