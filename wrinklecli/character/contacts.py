"""Contacts of a mesh with itself and with the other meshes of its file: vertices at which a gap opens if one moves."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.pose import blend, joint_matrices, transform
from wrinklecli.character.rig import Rig, read_hierarchy, read_rig
from wrinklecli.character.surface import Surface, Vertices, dense_influences, read_vertices
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, distinct_values

# Meshes touch where vertices are this near, as a share of the bounding box's diagonal.
_CONTACT = 1e-6


def contacts_of(document: Document, rig: Rig, surface: Surface, positions: Floats) -> Bools:
    """Mark the vertices that must stay where they are, or a gap would open.

    All vertices are compared, also those that nothing displaces: an edge along another mesh leaves it when it is split.

    Args:
        document: With the other meshes.
        rig: Of this mesh.
        surface: This mesh, welded; vertices with an unwelded twin are marked.
        positions: (vertices, 3) world space at rest.

    Returns:
        (vertices,) whether a vertex has a twin or touches a vertex of another mesh at rest.
    """
    contacts = surface.twins.copy()
    others = [i for i, node in enumerate(document.items("nodes")) if "mesh" in node and i != rig.node]
    if not others:
        return contacts
    # The size in the world: bind space may be of quantised units.
    reach = _CONTACT * float(np.linalg.norm(np.ptp(positions, axis=0)))
    hierarchy = read_hierarchy(document)
    known: dict[tuple[int, ...], Vertices] = {}  # of meshes that several nodes show
    for node in others if reach > 0 else []:
        other_rig = read_rig(document, node, hierarchy)
        key = (other_rig.mesh, other_rig.skinned, len(other_rig.joints))
        if key not in known:
            known[key] = read_vertices(document, other_rig)
        vertices = known[key]
        weights = dense_influences(vertices.joints, vertices.weights, len(other_rig.joints))
        morphed = vertices.positions + np.tensordot(other_rig.morph_weights, vertices.morph_deltas, axes=1)
        posed = transform(blend(weights, joint_matrices(other_rig, None, np.zeros(1))), morphed)[0]
        contacts |= _touching(positions, posed, reach)
    return contacts


def _touching(positions: Floats, others: Floats, reach: float) -> Bools:
    """(vertices,) whether one of (others, 3) lies within `reach` along each axis; up to twice as far it may count too.

    Args:
        positions: (vertices, 3), of 2^20 times `reach` in extent at the most.
        others: (others, 3).
        reach: Side of the cells that both are sorted into.
    """
    low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
    others = others[((others >= low) & (others <= high)).all(axis=1)]
    touching = np.zeros(len(positions), bool)
    if not len(others):
        return touching
    inside = ((positions >= others.min(axis=0) - reach) & (positions <= others.max(axis=0) + reach)).all(axis=1)
    mine = np.floor((positions[inside] - low) / reach).astype(np.int64)
    taken = distinct_values(_cell_numbers(np.floor((others - low) / reach).astype(np.int64)))
    touching[inside] = np.any(
        [np.isin(_cell_numbers(mine + offset), taken) for offset in product((-1, 0, 1), repeat=3)], axis=0
    )
    return touching


def _cell_numbers(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """(cells,) one number for each (x, y, z), of 20 bits and a sign each."""
    return cells[:, 0] << 42 | (cells[:, 1] & 0x1FFFFF) << 21 | (cells[:, 2] & 0x1FFFFF)
