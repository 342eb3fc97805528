"""Computes how much area each node bends: that of triangles which it moves in part."""

from collections.abc import Iterator, Sequence

import numpy as np

from wrinklecli.character.rig import Rig, levels_of
from wrinklecli.character.surface import read_influences, read_positions, read_triangles
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, groups_of
from wrinklecli.numeric.portions import portions

# Joints of a vertex that count, the heaviest first: time and memory grow with the square of their number.
_INFLUENCES = 4


def bent_areas(document: Document, rigs: Sequence[Rig]) -> tuple[Floats, Floats]:
    """Compute the areas of skinned meshes that bend, and that move, if one node alone turns.

    If the node and its descendants have the fraction s of a triangle's weights, A s of its area A moves and A s (1 − s)
    bends. So a triangle that moves as a whole does not bend.

    Returns:
        (nodes,) areas that bend, and (nodes,) areas that move, bind units squared.

    Raises:
        AssetError: A mesh is malformed.
    """
    root = len(rigs[0].parents)  # above all
    up = np.append(np.where(rigs[0].parents < 0, root, rigs[0].parents), root)
    depths = np.append(1 + levels_of(rigs[0].parents), 0)
    moved, whole = np.zeros(root + 1), np.zeros(root + 1)
    known = set()
    for rig in rigs:
        key = rig.mesh, rig.joints.tobytes()
        if not rig.skinned or key in known:
            continue
        known.add(key)
        for one, other, areas in _carried_together(document, rig):
            np.add.at(moved, one, areas)
            np.add.at(whole, _meeting(one, other, up, depths), areas)
    for nodes in groups_of(-depths)[:-1]:
        for totals in (moved, whole):
            np.add.at(totals, up[nodes], totals[nodes])
    return (moved - whole)[:root], moved[:root]


def bending_nodes(document: Document, rig: Rig, least: float) -> list[int]:
    """The nodes that bend a mesh, those that bend most first; `least` is a part of the largest area that one bends.

    Raises:
        AssetError: The mesh is malformed.
    """
    areas, _ = bent_areas(document, [rig])
    return [node for node in np.argsort(-areas, kind="stable").tolist() if areas[node] > least * areas.max()]


def _carried_together(document: Document, rig: Rig) -> Iterator[tuple[Ints, Ints, Floats]]:
    """Give pairs of nodes, in both orders and each with itself, and the sum of A s t over the triangles.

    A is a triangle's area, s and t are the fractions of its weights that the two nodes have.
    """
    from scipy.sparse import csr_array

    for index, primitive in enumerate(document.items("meshes")[rig.mesh].get("primitives", [])):
        where = document.where("meshes", rig.mesh, "primitives", index)
        positions = read_positions(document, primitive, where)
        joints, weights = read_influences(document, primitive, rig, len(positions), where)
        heaviest = np.argsort(-weights, axis=1, kind="stable")[:, :_INFLUENCES]
        joints, weights = np.take_along_axis(joints, heaviest, 1), np.take_along_axis(weights, heaviest, 1)
        weights = weights / (3.0 * weights.sum(axis=1, keepdims=True))
        triangles = read_triangles(document, primitive, len(positions), where)
        for part in (triangles[some] for some in portions(len(triangles), 2)):
            areas = np.sqrt(np.sum(face_normals(positions, part) ** 2, axis=1)) / 2.0
            columns = joints[part].reshape(-1)
            rows = np.repeat(np.arange(len(part)), len(columns) // len(part))
            shares = csr_array((weights[part].reshape(-1), (rows, columns)), shape=(len(part), len(rig.joints)))
            pairs = (shares.T @ (shares * areas[:, None])).tocoo()
            yield rig.joints[pairs.row], rig.joints[pairs.col], pairs.data


def _meeting(one: Ints, other: Ints, up: Ints, depths: Ints) -> Ints:
    """(pairs,) the lowest common ancestor of each pair of nodes, which may be one of them."""
    one, other = one.copy(), other.copy()
    while len(apart := np.flatnonzero(one != other)):
        first, second = one[apart], other[apart]
        one[apart] = np.where(depths[first] >= depths[second], up[first], first)
        other[apart] = np.where(depths[second] >= depths[first], up[second], second)
    return one
