"""Parts of a mesh by the morph targets that move them, chosen so that all targets take the least memory on a GPU.

Engines unpack a morph target over all vertices of its mesh, however few it moves, so its costs grow with the mesh. If
each part has only the targets that move it, the costs grow with the wrinkles.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.baking.budget import TEXEL_BYTES
from wrinklecli.baking.refined_mesh import RefinedPrimitive
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.split_mesh import Part
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct

PARTS = "parts"
"""Key, in a node's `extras.wrinkle`, of the names of the nodes beside it that show the other parts of its mesh."""

# Bytes on a GPU that one more mesh is worth, which takes a draw call.
_WORTH = 131_072
# Parts at most, as each takes a draw call.
_MOST = 16
# Largest kinds of faces that are compared with each other, as time grows with the square; the others join these first.
_COMPARED = 192
# Length of a NORMAL delta, 2.3°, that no one sees where two parts meet: one in a hundred normals of a shape is as far
# off, as all heights of a wrinkle share its delta.
_UNSEEN = 0.04


def parts_of(
    document: Document, primitives: Sequence[Json], refined_primitives: Sequence[RefinedPrimitive], *, own: int
) -> list[Part]:
    """Divide a mesh; there is a single part if nothing is gained. No part lacks a morph target that moves it.

    Where a wrinkle ends, it turns the normals of vertices that it does not move, and so may reach a vertex of the next
    part. Targets that do no more in a part, and turn them by less than anyone sees, are not in it.

    Faces of a part need not lie together. The first part, for the node itself, gets all `own` targets of the asset, the
    first ones of the mesh.
    """
    faces = [each.triangles if len(each.triangles) else np.arange(len(each.weld))[None] for each in refined_primitives]
    moved, seen = _moved_faces(document, primitives, refined_primitives, faces)
    sets, part_of = divided(moved, seen, own=own)
    ends = np.cumsum([len(each) for each in faces])[:-1]
    of_primitives = np.split(part_of, ends)
    return [
        Part(
            tuple(each[of == k] for each, of in zip(faces, of_primitives, strict=True)),
            tuple(np.flatnonzero(targets).tolist()),
        )
        for k, targets in enumerate(sets)
    ]


def divided(moved: Bools, seen: Bools, *, own: int) -> tuple[Bools, Ints]:
    """Divide faces by the targets that move them.

    Faces that the same targets move begin as one part. Then the two parts that cost the least together are joined, as
    long as this is little. The first part has all `own` targets of the asset, since players may set these by their
    numbers: it is the part where they cost the least.

    Args:
        moved: (faces, targets) True if a target changes anything there, the asset's own targets first.
        seen: (faces, targets) True if one sees the change.
        own: The number of the asset's own targets.

    Returns:
        (parts, targets) the targets of each part, and (faces,) the part of each face.
    """
    firsts, kind_of = distinct(np.packbits(moved, axis=1))
    sets, groups = _joined(moved[firsts], np.bincount(kind_of).astype(np.float64))
    part_of = groups[kind_of]
    for part, needed in enumerate(sets[:, own:]):
        needed &= seen[part_of == part, own:].any(axis=0)
    sizes = np.bincount(part_of, minlength=len(sets))
    missing = sizes * (~sets[:, :own]).sum(axis=1) + np.where(sets[:, own:].any(axis=1), 0, len(moved) * (own + 1))
    first = int(np.argmin(missing))
    sets[first, :own] = True
    sets[first] |= ~sets.any(axis=0)
    order = np.array([first, *(k for k in range(len(sets)) if k != first)])
    return sets[order], np.argsort(order)[part_of]


def _moved_faces(
    document: Document,
    primitives: Sequence[Json],
    refined_primitives: Sequence[RefinedPrimitive],
    faces: Sequence[Ints],
) -> list[Bools]:
    """(faces, targets) True if a target changes a corner of a face in any primitive, and True if one sees it."""
    count = 1 + max(int(each.weld.max(initial=0)) for each in refined_primitives)
    moved, seen = np.zeros((2, count, len(primitives[0]["targets"])), bool)
    for primitive, refined in zip(primitives, refined_primitives, strict=True):
        for number, target in enumerate(primitive["targets"]):
            for name, index in target.items():
                rows, deltas = document.changes(index)
                moved[refined.weld[rows], number] = True
                if name == "NORMAL":
                    rows = rows[np.linalg.norm(deltas, axis=1) > _UNSEEN]
                seen[refined.weld[rows], number] = True
    corners = [refined.weld[each] for refined, each in zip(refined_primitives, faces, strict=True)]
    return [np.concatenate([flags[each].any(axis=1) for each in corners]) for flags in (moved, seen)]


def _joined(kinds: Bools, counts: Floats) -> tuple[Bools, Ints]:
    """Join kinds of faces while this costs little.

    Args:
        kinds: (kinds, targets) True if a target moves a kind.
        counts: (kinds,) faces.

    Returns:
        (parts, targets) and (kinds,) the part of each kind.
    """
    sets, sizes = kinds.astype(np.float64), counts.copy()
    alive = np.argsort(-counts, kind="stable")
    # Most of thousands of kinds have a few faces: these join the best of the largest.
    alive, few = alive[:_COMPARED], alive[_COMPARED:]
    for kind in few:
        into = int(alive[np.argmin(_costs(sets[alive], sizes[alive], sets[kind], sizes[kind]))])
        _join(sets, sizes, into, int(kind))
    # (parts, parts) the cost of joining each two; infinite if one is gone, and for a part with itself.
    costs = np.stack([_costs(sets[alive], sizes[alive], sets[k], sizes[k]) for k in alive])
    np.fill_diagonal(costs, np.inf)
    gone = np.zeros(len(alive), bool)
    while (remaining := int((~gone).sum())) > 1:
        one, other = np.unravel_index(int(costs.argmin()), costs.shape)
        # A target has two texels for a vertex, POSITION and NORMAL, and surfaces have two faces for a vertex.
        if costs[one, other] * TEXEL_BYTES > _WORTH and remaining <= _MOST:
            break
        _join(sets, sizes, int(alive[one]), int(alive[other]))
        gone[other] = True
        row = _costs(sets[alive], sizes[alive], sets[alive[one]], sizes[alive[one]])
        row[gone] = row[one] = np.inf
        costs[one], costs[:, one] = row, row
        costs[other] = costs[:, other] = np.inf
    # Each kind goes to the part with the fewest targets that has all of its own: parts were others when it joined.
    made = sets[alive[~gone]]
    lacking = kinds.sum(axis=1)[:, None] > kinds @ made.T
    used, parts = np.unique(np.where(lacking, np.inf, made.sum(axis=1)).argmin(axis=1), return_inverse=True)
    return np.stack([kinds[parts == part].any(axis=0) for part in range(len(used))]), parts


def _costs(sets: Floats, sizes: Floats, other: Floats, size: float) -> Floats:
    """(parts,) the growth of faces times targets if another part of `size` faces joins each."""
    each, more = sets.sum(axis=1), other.sum()
    both = each + more - sets @ other
    return np.asarray(both * (sizes + size) - each * sizes - more * size)


def _join(sets: Floats, sizes: Floats, into: int, kind: int) -> None:
    sets[into] = np.maximum(sets[into], sets[kind])
    sizes[into] += sizes[kind]
