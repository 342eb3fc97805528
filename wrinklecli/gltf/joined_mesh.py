"""One mesh of the meshes of several nodes, and back: the nodes show their own primitives again in the end.

Meshes that the same skin moves differ from primitives of one mesh in nothing but the nodes that show them.
"""

import copy
from collections.abc import Sequence

import numpy as np

from wrinklecli.errors import AssetError, listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import channels_of, moves_weights
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.split_mesh import Part, split_node


@dataclass(frozen=True, slots=True)
class JoinedMesh:
    """The meshes of nodes, as one.

    Attributes:
        nodes: They; the first has the mesh.
        starts: The number of the first primitive of each, and of all primitives.
        shown: The other nodes and their meshes, as they are in the asset.
    """

    nodes: tuple[int, ...]
    starts: tuple[int, ...]
    shown: tuple[tuple[Json, Json], ...]


def joined(document: Document, nodes: Sequence[int]) -> tuple[Document, JoinedMesh]:
    """A document in which the first node shows the primitives of all.

    Raises:
        AssetError: The meshes cannot be one: a node has no skin or another one, or a mesh has morph targets or is shown
            by other nodes too.
    """
    every, meshes = document.items("nodes"), document.items("meshes")
    names = [str(every[node].get("name", f"node_{node}")) for node in nodes]
    for node, name in zip(nodes, names, strict=True):
        users = [each for each in every if each.get("mesh") == every[node]["mesh"]]
        why = (
            "another skin"
            if not _same_skin(document, every[nodes[0]].get("skin"), every[node].get("skin"))
            else "morph targets"
            if any(each.get("targets") for each in meshes[every[node]["mesh"]]["primitives"])
            else "a mesh that other nodes show too"
            if len(users) > 1
            else ""
        )
        if why:
            raise AssetError(
                f"{listed(names)} cannot be one surface: {name} has {why}; give each a field of its own",
                where=document.where("nodes", node),
            )
    gltf = dict(document.gltf) | {"nodes": list(every), "meshes": list(meshes)}
    of_nodes = [meshes[every[node]["mesh"]]["primitives"] for node in nodes]
    first = every[nodes[0]]["mesh"]
    gltf["meshes"][first] = meshes[first] | {"primitives": [each for own in of_nodes for each in own]}
    for node in nodes[1:]:
        gltf["nodes"][node] = {key: each for key, each in every[node].items() if key not in ("mesh", "skin")}
    starts = np.cumsum([0, *map(len, of_nodes)]).tolist()
    shown = tuple((every[node], meshes[every[node]["mesh"]]) for node in nodes[1:])
    return document.extended(gltf, document.buffers), JoinedMesh(tuple(nodes), tuple(starts), shown)


def _same_skin(document: Document, one: object, other: object) -> bool:
    """True if there are two skins of the same joints that bind alike."""
    if one is None or other is None:
        return False
    if one == other:
        return True
    skins = [document.item("skins", each, user=document.where("skins")) for each in (one, other)]
    if skins[0]["joints"] != skins[1]["joints"] or any("inverseBindMatrices" not in each for each in skins):
        return False
    first, second = (document.accessor(each["inverseBindMatrices"]) for each in skins)
    return bool(np.array_equal(first, second))


def parts_of_nodes(document: Document, mesh: JoinedMesh) -> list[Part]:
    """The primitives of each node, with the morph targets that change anything of them; the first has one at least."""
    primitives = document.items("meshes")[document.items("nodes")[mesh.nodes[0]]["mesh"]]["primitives"]
    whole, none = np.zeros((1, 3), np.intp), np.zeros((0, 3), np.intp)
    parts: list[Part] = []
    for first, end in zip(mesh.starts, mesh.starts[1:], strict=False):
        targets = sorted(
            {
                number
                for primitive in primitives[first:end]
                for number, target in enumerate(primitive.get("targets", []))
                if any(len(document.changes(index)[0]) for index in target.values())
            }
        )
        own = tuple(whole if first <= number < end else none for number in range(len(primitives)))
        parts.append(Part(own, tuple(targets or [0][: 1 - len(parts)])))
    return parts


def give_back(edited: EditedDocument, mesh: JoinedMesh) -> list[int]:
    """Let each node of a joined mesh show its own primitives again, with the morph targets that move them.

    The mesh must be unchanged otherwise. Returns the nodes.
    """
    gltf, nodes = edited.gltf, list(mesh.nodes)
    made = split_node(edited, nodes[0], parts_of_nodes(edited.source, mesh))[1:]
    for node, new, (shown, own) in zip(nodes[1:], made, mesh.shown, strict=True):
        part = gltf["nodes"][new]
        given = gltf["meshes"][part["mesh"]]
        gltf["meshes"][shown["mesh"]] = _with_weights(copy.deepcopy(own) | {"primitives": given["primitives"]}, given)
        gltf["nodes"][node] = _with_weights(copy.deepcopy(shown), part)
        for animation, channel in channels_of(gltf):
            if moves_weights(channel, new):
                channel["target"]["node"] = node
            elif channel["target"].get("node") == new:
                animation["channels"].remove(channel)
    for new in sorted(made, reverse=True):
        del gltf["meshes"][gltf["nodes"][new]["mesh"]], gltf["nodes"][new]
        for holder in (*gltf["nodes"], *gltf.get("scenes", [])):
            for key in ("children", "nodes"):
                if new in holder.get(key, []):
                    holder[key].remove(new)
    return nodes


def _with_weights(holder: Json, given: Json) -> Json:
    """A mesh or node with the weights and the names of morph targets that another has."""
    names = given.get("extras", {}).get("targetNames") if isinstance(given.get("extras"), dict) else None
    if "weights" in given:
        holder["weights"] = given["weights"]
    if names is not None:
        holder["extras"] = (holder["extras"] if isinstance(holder.get("extras"), dict) else {}) | {"targetNames": names}
    return holder
