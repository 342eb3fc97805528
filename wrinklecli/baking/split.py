"""A baked mesh split in parts, each with only the morph targets that move it: see `baking.parts`."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.baking.budget import mesh_texture_bytes, texel_bytes, texture_bytes
from wrinklecli.baking.parts import PARTS, divided, parts_of
from wrinklecli.baking.refined_mesh import primitives_of, shared_vertices
from wrinklecli.baking.report import BakedMesh, Split
from wrinklecli.drive.drive import wrinkle_entry
from wrinklecli.effects.effect import MeshPlan, targets_of
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.joined_mesh import JoinedMesh, give_back
from wrinklecli.gltf.split_mesh import Part, split_node
from wrinklecli.numeric.arrays import Ints, distinct_values

# Bytes on a GPU below which a split is not worth a look.
_MATTERS = 1_000_000


def split_meshes(
    edited: EditedDocument, baked: Sequence[BakedMesh], joined: Mapping[int, JoinedMesh], *, asked: bool
) -> tuple[EditedDocument, list[BakedMesh]]:
    """Split the mesh of each baked node where it was joined of several, and, if that is asked for, others too.

    Others are split if that makes their morph targets smaller. No vertex moves.

    Returns:
        A document being changed whose source is the whole of `edited`, and the meshes with their parts.

    Raises:
        BakeError: Something sets the morph targets of a mesh in a way that several meshes cannot follow.
    """
    whole = edited.continued()
    made = []
    for mesh in baked:
        node = mesh.plan.rig.node
        if node in joined:
            made.append(_told(whole, mesh, give_back(whole, joined[node])))
        else:
            made.append(_split(whole, edited.source, mesh) if asked else weighed(edited, mesh))
    return whole, made


def weighed(edited: EditedDocument, mesh: BakedMesh) -> BakedMesh:
    """A mesh that is not split, with the memory of its targets if it were, unless this is little anyway."""
    plan = mesh.plan
    if texture_bytes(plan, len(plan.rig.own.morph_names) + len(targets_of(mesh.effects))) < _MATTERS:
        return mesh
    document = edited.document()
    parts = _parts(document, edited.source, mesh)
    vertices = (len(part.targets) * sum(len(distinct_values(each)) for each in part.triangles) for part in parts)
    return replace(mesh, split=Split(texel_bytes(plan, sum(vertices))))


def planned_bytes(plan: MeshPlan, targets: Sequence[Ints]) -> int:
    """GPU memory of morph targets in the parts in which a split would keep them, before they are baked.

    Args:
        plan: The mesh.
        targets: For each target the fine welded vertices that it moves. It turns normals of their neighbours.
    """
    triangles, vertices = plan.fine.triangles, np.zeros((len(plan.fine.positions), len(targets)), np.bool_)
    for number, moved in enumerate(targets):
        vertices[moved, number] = True
    seen = np.asarray(vertices[triangles].any(axis=1))
    for corners in triangles.T:
        np.logical_or.at(vertices, corners, seen)
    turned = np.asarray(vertices[triangles].any(axis=1))
    # Other effects may move the other faces; where they do, a part of its own is worth it.
    here = turned.any(axis=1)
    turned, seen, corners = turned[here], seen[here], plan.fine.corners[here]
    sets, part_of = divided(turned if plan.has_normals else seen, seen, own=0)
    return texel_bytes(
        plan, sum(int(each.sum()) * len(distinct_values(corners[part_of == k])) for k, each in enumerate(sets))
    )


def grown_bytes(plan: MeshPlan) -> int:
    """GPU memory that the mesh's own morph targets take for the vertices that refinement adds, before a split."""
    added = plan.fine.morph_deltas[: len(plan.rig.own.morph_names), len(plan.fine.surface.positions) :]
    return texel_bytes(plan, int(np.count_nonzero(added.any(axis=2))))


def _split(whole: EditedDocument, source: Document, mesh: BakedMesh) -> BakedMesh:
    parts = _parts(whole.source, source, mesh)
    return mesh if len(parts) < 2 else _told(whole, mesh, split_node(whole, mesh.plan.rig.node, parts))


def _told(whole: EditedDocument, mesh: BakedMesh, made: Sequence[int]) -> BakedMesh:
    """A mesh with its parts, whose names are in the extras of the first."""
    gltf = whole.gltf
    nodes = [gltf["nodes"][node] for node in made]
    entry = wrinkle_entry(nodes[0])
    if entry:
        for node in nodes[1:]:
            node["extras"] = {key: each for key, each in node.get("extras", {}).items() if key != "wrinkle"}
            if not node["extras"]:
                del node["extras"]
        entry[PARTS] = [node.get("name", "") for node in nodes[1:]]
    size = sum(mesh_texture_bytes(gltf, gltf["meshes"][node["mesh"]]) for node in nodes)
    return replace(mesh, split=Split(size, tuple(str(node.get("name", "")) for node in nodes)))


def _parts(document: Document, source: Document, mesh: BakedMesh) -> list[Part]:
    """The parts of a baked mesh of a document; none if it has no morph targets."""
    plan = mesh.plan
    primitives = document.items("meshes")[document.items("nodes")[plan.rig.node]["mesh"]]["primitives"]
    if not any(primitive.get("targets") for primitive in primitives):
        return []
    refined_primitives = primitives_of(plan.fine, shared_vertices(source, plan.rig.mesh, plan.fine))
    return parts_of(document, primitives, refined_primitives, own=len(plan.rig.own.morph_names))
