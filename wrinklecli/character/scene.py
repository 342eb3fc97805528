"""Reads all primitives of a scene, ready to be posed as an engine would, for `preview`, `diff` and `suggest`.

A bake welds one mesh to a surface. Here every primitive of every node is as the file stores it, with its own vertices,
normals and skin weights.

Source: glTF 2.0 §3.5 (scenes), §3.7.2.2 (morph targets), §3.7.3.3 (skinned meshes).
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.rig import Hierarchy, morph_target_names, read_hierarchy, read_parents, read_rig, upwards
from wrinklecli.character.skin import Influences, SkinnedMesh, acting_joints, prepare
from wrinklecli.character.surface import Vertices, read_primitive, read_triangles
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values


@dataclass(frozen=True, slots=True, eq=False)
class ScenePrimitive(SkinnedMesh):
    """One primitive as one node shows it, ready to be posed.

    Attributes:
        primitive: Index in the mesh.
        where: JSON pointer.
        vertices: Stored vertices, bind space.
        colour: (3,) base colour factor of the material, linear RGB.
    """

    primitive: int
    where: str
    vertices: Vertices
    colour: Floats

    @property
    def name(self) -> str:
        """The name of the node."""
        return self.rig.node_name

    @property
    def seen(self) -> Ints:
        """Sorted visible vertices: those of triangles, or all of points and lines."""
        return distinct_values(self.triangles) if len(self.triangles) else np.arange(len(self.vertices.positions))


def scene_nodes(document: Document) -> list[int]:
    """Sorted nodes that are drawn of the default scene; of all nodes if the file has no scene."""
    scenes = document.items("scenes")
    number = document.gltf.get("scene", 0)
    return sorted(_drawn(document, scenes[number].get("nodes", []) if scenes else _roots(document), 0, ()))


def drawn_with(document: Document, node: int) -> list[int]:
    """Sorted nodes that are drawn where a node is: of the scenes that hold it, at its level of detail.

    A node that no scene draws stands among those below its root; one that is hidden is looked at as if it were not.
    """
    above = list(upwards(read_parents(document), node))
    levels = {each: level for other in document.items("nodes") for level, each in enumerate(_levels(other), 1)}
    level = next((levels[each] for each in above if each in levels), 0)
    found = [_drawn(document, scene.get("nodes", []), level, above) for scene in document.items("scenes")]
    held = [each for each in found if node in each]
    if not held:
        scenes = document.items("scenes")
        held = [_drawn(document, [above[-1]] if scenes else _roots(document), level, above)]
    return sorted(set[int]().union(*held))


def _roots(document: Document) -> list[int]:
    return [node for node, parent in enumerate(read_parents(document).tolist()) if parent < 0]


def _drawn(document: Document, roots: Sequence[int], level: int, shown: Collection[int]) -> set[int]:
    """The nodes below roots that are drawn at a level of detail: of each node with levels this one, or its last.

    Source: MSFT_lod and KHR_node_visibility. Hidden nodes that are among `shown` count as visible.
    """
    nodes = document.items("nodes")

    def below(roots: Iterable[int], without: Collection[int] = ()) -> set[int]:
        found: set[int] = set()
        stack = list(roots)
        while stack:
            node = stack.pop()
            visible = nodes[node].get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
            if node not in found and node not in without and (visible or node in shown):
                found.add(node)
                stack += nodes[node].get("children", [])
        return found

    every = below(roots)
    leveled = {node: [node, *_levels(nodes[node])] for node in every if _levels(nodes[node])}
    chosen = {each[min(level, len(each) - 1)] for each in leveled.values()}
    others = {one for each in leveled.values() for one in each} - chosen
    return below([*roots, *sorted(chosen)], others)


def _levels(node: Json) -> list[int]:
    """The nodes that stand for a node where it is small, by MSFT_lod."""
    found: list[int] = node.get("extensions", {}).get("MSFT_lod", {}).get("ids", [])
    return found


def deforming_nodes(document: Document) -> list[int]:
    """Sorted nodes that are drawn of the default scene, whose meshes a skin or morph targets deform."""
    return [node for node in scene_nodes(document) if deforms(document, node)]


def deforms(document: Document, node: int) -> bool:
    """True if a node has a mesh that a skin or morph targets deform."""
    shown = document.items("nodes")[node]
    if "mesh" not in shown:
        return False
    return "skin" in shown or bool(morph_target_names(document.items("meshes")[shown["mesh"]]))


NO_MESH = "it has no mesh: --anim takes its clips, beside a character"
"""Advice for a file of clips alone."""


def none_deforms(document: Document) -> str:
    """The reason why no mesh of an asset deforms, with what to do with a file of clips alone."""
    if not document.items("meshes"):
        return NO_MESH
    if any(deforms(document, node) for node in range(len(document.items("nodes")))):
        return "those that do are not drawn"
    return "it has neither a skin nor morph targets"


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
            influences = Influences(vertices.joints.T, vertices.weights.T, len(rig.joints))
            acting = acting_joints(rig, influences)
            known[key] = ScenePrimitive(
                rig=rig,
                skin=prepare(
                    influences.among(acting),
                    vertices.positions,
                    vertices.morph_deltas,
                    vertices.normals,
                    vertices.normal_deltas,
                ),
                acting=acting,
                triangles=read_triangles(document, primitive, len(vertices.positions), where),
                primitive=number,
                where=where,
                vertices=vertices,
                colour=_base_colour(material_of(document, primitive)),
            )
        yield replace(known[key], rig=rig)


def material_of(document: Document, primitive: Json) -> Json:
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
