"""Keeps what wrinkles and folds raise below the layers that lie over a surface, such as a sweater over shorts."""

from collections.abc import Container

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, distinct_values
from wrinklecli.numeric.closest import ROUNDING, meets_box
from wrinklecli.numeric.rays import first_hits
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement

# Distance over the mesh's size up to which a layer lies on the surface, not over it.
_APART = 1e-6


def losses_below(
    ground: Ground, fine: Refinement, vertices: Ints, heights: Floats, ignored: Container[str] = ()
) -> Floats:
    """Find the parts of heights that would come through a layer over the surface at rest.

    A layer is another mesh that is drawn with this one and is no copy of it, or another piece of this one: folds of one
    piece may meet, and skin beside a fold is no layer.

    Args:
        ground: The mesh at rest.
        fine: Its refined surface.
        vertices: (vertices,) of the refined surface.
        heights: (vertices,) the greatest to which they rise along their normals, scene units.
        ignored: Names of nodes whose meshes are no layers; the mesh's own stands for its other pieces.

    Returns:
        (vertices,) from 0 to 1.
    """
    losses = np.zeros(len(vertices))
    rising = np.flatnonzero(heights > 0)
    if not len(rising):
        return losses
    size, lengths = fine.rest_size, heights[rising]
    starts, rays = fine.rest_positions[vertices[rising]], fine.rest_normals_at(vertices[rising])
    ends = np.concatenate([starts, starts + lengths[:, None] * rays])
    low, high = ends.min(axis=0) - ROUNDING * size, ends.max(axis=0) + ROUNDING * size
    near = fine.triangles[meets_box(fine.rest_positions, low, high, fine.triangles)]
    of_others = [
        corners
        for node, corners in ground.neighbours.triangles_near(ground.rig.node, low, high)
        if node not in ground.contacts.copies and ground.rig.names[node] not in ignored
    ]
    if ground.rig.node_name in ignored:
        near = near[:0]
    corners = np.concatenate([fine.rest_positions[near], *of_others])
    # All other meshes count as one piece more.
    owners = np.append(fine.pieces[near[:, 0]], np.full(len(corners) - len(near), -1))
    own = fine.pieces[vertices[rising]]
    for piece in distinct_values(own):
        at, others = np.flatnonzero(own == piece), corners[owners != piece]
        inside = meets_box(others.reshape(-1, 3), low, high, np.arange(3 * len(others)).reshape(-1, 3))
        rooms = first_hits(starts[at], rays[at], lengths[at], others[inside], least=_APART * size)
        losses[rising[at]] = np.maximum(1.0 - rooms / lengths[at], 0.0)
    return losses
