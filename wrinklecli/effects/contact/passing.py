"""Vertices where a fold passes through itself: candidates by trees of ipctk, over twice as fast as our own.

What passes through is what module `numeric.crossings` says: the two find the same.
"""

import numpy as np

from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.crossings import pass_through


def passing(positions: Floats, edges: Ints, triangles: Ints, counting: Bools) -> Bools:
    """Mark what takes part in a crossing.

    Args:
        positions: (vertices, 3).
        edges: (edges, 2).
        triangles: (triangles, 3).
        counting: (vertices,) of which a crossing is to have at least one.

    Returns:
        (vertices,) whether an edge or a triangle of each takes part in one.
    """
    import ipctk

    ipctk.set_num_threads(1)
    tree = ipctk.LBVH()
    tree.build(
        np.asfortranarray(positions),
        np.asfortranarray(edges.astype(np.int32)),
        np.asfortranarray(triangles.astype(np.int32)),
        0.0,
    )
    found = tree.detect_edge_face_candidates()
    pairs = np.array([(each.edge_id, each.face_id) for each in found], np.intp).reshape(-1, 2)
    ends, corners = edges[pairs[:, 0]], triangles[pairs[:, 1]]
    counts = counting[ends].any(axis=1) | counting[corners].any(axis=1)
    ends, corners = ends[counts], corners[counts]
    crosses = pass_through(positions[ends], positions[corners])
    marked = np.zeros(len(positions), bool)
    marked[ends[crosses]] = True
    marked[corners[crosses]] = True
    return marked
