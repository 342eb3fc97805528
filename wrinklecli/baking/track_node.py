"""The nodes that get a body's tracks in a file of clips: nodes of the same names, or stubs for players to bind.

Players bind tracks by the name of a node. If two nodes have one name, three.js renames the second.
"""

from collections import Counter

import numpy as np

from wrinklecli.baking.baked_body import BakedPart
from wrinklecli.baking.morphs import add_idle_targets
from wrinklecli.character.rig import morph_target_names
from wrinklecli.errors import AssetError, listed
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json


def targets_there(document: Document, name: str) -> tuple[str, ...] | None:
    """The names of the morph targets of a file's own mesh on the node of a name; None if there is none."""
    found = next((node for node in document.items("nodes") if node.get("name") == name and "mesh" in node), None)
    return None if found is None else tuple(morph_target_names(document.items("meshes")[found["mesh"]]))


def node_for_tracks(edited: EditedDocument, body: BakedPart, *, ambiguous: bool) -> int:
    """The node that gets a body's tracks: the file's own of that name, which may lack its mesh, or a stub.

    The morph targets of the file's own mesh are put in the order of the body's, which has all of their names; those
    that the mesh lacks do nothing. A body without morph targets gets a node without a mesh. If the body's name is
    `ambiguous`, a node without a mesh may be a joint, and is left alone.

    Raises:
        AssetError: The file has a mesh on a node of that name, with two morph targets of one name, or without vertices.
    """
    nodes = edited.gltf.setdefault("nodes", [])
    found = [index for index, node in enumerate(nodes) if node.get("name") == body.node and "mesh" in node]
    if not found:
        joints = {joint for skin in edited.gltf.get("skins", []) for joint in skin.get("joints", [])}
        bare = [index for index, node in enumerate(nodes) if node.get("name") == body.node and index not in joints]
        index = bare[0] if bare and not ambiguous else _add_node(edited.gltf, body.node)
        if body.targets:
            _add_stub(edited, body, nodes[index])
        return index
    node = nodes[found[0]]
    names = tuple(morph_target_names(edited.gltf["meshes"][node["mesh"]]))
    if names != body.targets:
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise AssetError(
                f"the mesh of {body.node!r} has several morph targets of one name, {listed(twice)}: weights are matched"
                " by name",
                where=edited.source.where("nodes", found[0]),
            )
        _refuse_incomplete(edited.source, node["mesh"], targets=len(names))
        add_idle_targets(edited, node, body.targets, names)
    return found[0]


def _refuse_incomplete(document: Document, mesh: int, *, targets: int) -> None:
    """Check that a mesh has primitives, all of them with vertices and with so many morph targets."""
    primitives = document.items("meshes")[mesh].get("primitives", [])
    if not primitives:
        raise AssetError("has no primitives", where=document.where("meshes", mesh))
    for number, primitive in enumerate(primitives):
        where = document.where("meshes", mesh, "primitives", number)
        if "POSITION" not in primitive.get("attributes", {}):
            raise AssetError("has no POSITION", where=where)
        if len(primitive.get("targets", [])) != targets:
            raise AssetError(f"has {len(primitive.get('targets', []))} morph targets, not {targets}", where=where)


def _add_node(gltf: Json, name: str) -> int:
    """Append a node to the scene; return its index."""
    nodes = gltf["nodes"]
    nodes.append({"name": name})
    for scene in gltf.get("scenes", [])[gltf.get("scene", 0) :][:1]:
        scene.setdefault("nodes", []).append(len(nodes) - 1)
    return len(nodes) - 1


def _add_stub(edited: EditedDocument, body: BakedPart, node: Json) -> None:
    """Give a node a mesh of the body's names and targets, three vertices in one point."""
    point = edited.add(np.zeros((3, 3), np.float32), target=VERTEX_DATA, bounds=True)
    primitive: Json = {"attributes": {"POSITION": point}, "targets": [{"POSITION": point} for _ in body.targets]}
    mesh: Json = {} if body.mesh is None else {"name": body.mesh}
    # Players name the parts of a mesh by their number, and tracks by the part.
    mesh["primitives"] = [primitive for _ in range(body.primitives)]
    mesh["weights"] = [0.0] * len(body.targets)
    mesh["extras"] = {"targetNames": list(body.targets)}
    meshes = edited.gltf.setdefault("meshes", [])
    meshes.append(mesh)
    node["mesh"] = len(meshes) - 1
    if body.stored.any():
        node["weights"] = body.stored.tolist()
