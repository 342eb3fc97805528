"""Tangents of a textured mesh that has none, as MikkTSpace makes them.

Source: M. Mikkelsen, *Simulation of Wrinkled Surfaces Revisited*, 2008, and glTF 2.0 §3.7.2.1, which asks for
MikkTSpace where TANGENT is missing. Differs: faces of one vertex whose texture is mirrored share it only if the file
has vertices of its own for either side, as exporters write them.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, distinct, unit


def mikk_tangents(positions: Floats, normals: Floats, uvs: Floats, triangles: Ints) -> Floats:
    """(vertices, 4) unit tangents along u, and the handedness of the texture.

    Args:
        positions: (vertices, 3).
        normals: (vertices, 3) unit.
        uvs: (vertices, 2), v downwards as in glTF.
        triangles: (triangles, 3).
    """
    corners, texture = positions[triangles], uvs[triangles] * [1.0, -1.0]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d1, d2 = texture[:, 1] - texture[:, 0], texture[:, 2] - texture[:, 0]
    area = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
    along = unit((d2[:, 1:] * e1 - d1[:, 1:] * e2) * np.sign(area)[:, None])
    # Vertices of one place, normal and texture are one, whatever else tells them apart.
    _, merged = distinct(np.concatenate([positions, normals, uvs], axis=1))
    sums, signs = np.zeros((len(positions), 3)), np.zeros(len(positions))
    for corner in range(3):
        vertices = triangles[:, corner]
        normal = normals[vertices]
        before, after = (_flat(corners[:, (corner + step) % 3] - corners[:, corner], normal) for step in (2, 1))
        angles = np.arccos(np.clip(np.sum(before * after, axis=1), -1.0, 1.0))
        np.add.at(sums, merged[vertices], angles[:, None] * _flat(along, normal))
        np.add.at(signs, merged[vertices], np.sign(area))
    return np.column_stack([unit(sums[merged]), np.where(signs[merged] < 0, -1.0, 1.0)])


def _flat(vectors: Floats, normals: Floats) -> Floats:
    """(…, 3) unit vectors in the planes across unit normals."""
    return unit(vectors - np.sum(vectors * normals, axis=1, keepdims=True) * normals)
