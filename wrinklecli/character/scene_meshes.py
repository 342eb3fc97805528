"""Reads all meshes of a scene, welded: obstacles of a fold, and surfaces that may cross."""

from collections.abc import Collection

from wrinklecli.character.rig import read_hierarchy, read_rig
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.skin import SkinnedMesh
from wrinklecli.character.surface import has_triangles, read_surface
from wrinklecli.gltf.document import Document


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
