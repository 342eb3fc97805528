"""Poses many vertices at many times, with positions and normals as an engine would show them.

Arrays hold the coordinates of all vertices one after another, so that every operation runs along whole rows, and chunks
of time stay in a core's cache.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.7.3.3 (skinning). Differs from engines that turn normals by the blended
matrices themselves, whose normals lean where joints scale or shear.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, cross, dot

# Vertices times frames that are posed at once. Matrix products of half as many are slow; twice as many leave the cache,
# and the allocator gives their memory back to the system each time.
_CHUNK = 2**13


@dataclass(frozen=True, slots=True)
class Skin:
    """Vertices ready to be posed.

    Attributes:
        weights: (joints, vertices) skin weights, columns summing to 1.
        places: (3, 1 + shapes, vertices) bind positions, then the deltas of each shape at weight 1.
        turns: (3, 1 + shapes, vertices) unit normals, then their deltas; None without normals.
    """

    weights: Floats
    places: Floats
    turns: Floats | None

    def of(self, vertices: Ints) -> "Skin":
        """The same of (vertices,) some vertices."""
        turns = None if self.turns is None else self.turns[:, :, vertices]
        return Skin(self.weights[:, vertices], self.places[:, :, vertices], turns)


def prepare(
    weights: Floats,
    positions: Floats,
    deltas: Floats,
    normals: Floats | None = None,
    normal_deltas: Floats | None = None,
) -> Skin:
    """Lay out arrays that do not change with time.

    Args:
        weights: (vertices, joints) skin weights, rows summing to 1.
        positions: (vertices, 3) bind space.
        deltas: (shapes, vertices, 3) added by each shape, such as a morph target, at weight 1.
        normals: (vertices, 3) unit, bind space.
        normal_deltas: (shapes, vertices, 3) added to the normals.
    """
    turns = None
    if normals is not None and normal_deltas is not None:
        turns = _by_coordinate(normals, normal_deltas)
    return Skin(np.ascontiguousarray(weights.T), _by_coordinate(positions, deltas), turns)


def _by_coordinate(base: Floats, deltas: Floats) -> Floats:
    return np.ascontiguousarray(np.concatenate([base[None], deltas]).transpose(2, 0, 1))


def pose(skin: Skin, matrices: Floats, weights: Floats, offsets: Floats | None = None) -> tuple[Floats, Floats | None]:
    """Morph and skin all vertices in all frames.

    Args:
        skin: The vertices.
        matrices: (frames, joints, 4, 4) bind to world space.
        weights: (frames, shapes).
        offsets: (frames, 3, vertices) added to the positions, bind space.

    Returns:
        (frames, 3, vertices) world positions, scene units, and unit normals turned by the inverse transposes of the
        blended matrices; None without normals.
    """
    positions = np.zeros((len(matrices), 3, skin.weights.shape[1]))
    normals = None if skin.turns is None else np.zeros_like(positions)
    factors = np.concatenate([np.ones((len(matrices), 1)), weights], axis=1)
    rows = np.ascontiguousarray(matrices[:, :, :3].transpose(2, 3, 0, 1))
    a, b, c = rows[:, :3]
    mirroring = bool((dot(a, cross(b, c)) < 0).any())
    for block in (slice(k, k + _CHUNK) for k in range(0, positions.shape[2], _CHUNK)):
        joint_weights = skin.weights[:, block]
        vertex_count = joint_weights.shape[1]
        step = max(1, _CHUNK // vertex_count)
        for now in (slice(k, k + step) for k in range(0, len(matrices), step)):
            frames = len(factors[now])
            # One product is faster than twelve of few frames.
            blended = (rows[:, :, now].reshape(12 * frames, -1) @ joint_weights).reshape(3, 4, frames, vertex_count)
            bind = factors[now] @ skin.places[:, :, block]
            if offsets is not None:
                bind += offsets[now, :, block].transpose(1, 0, 2)
            for row, into in zip(blended, positions[now, :, block].transpose(1, 0, 2), strict=True):
                np.add(dot(row[:3], bind), row[3], out=into)
            if normals is not None and skin.turns is not None:
                turned = _turned(blended[:, :3], factors[now] @ skin.turns[:, :, block], mirroring=mirroring)
                lengths = np.sqrt(dot(turned, turned))
                lengths[lengths == 0] = 1.0
                # A division takes as long as several products.
                np.reciprocal(lengths, out=lengths)
                for row, into in zip(turned, normals[now, :, block].transpose(1, 0, 2), strict=True):
                    np.multiply(row, lengths, out=into)
    return positions, normals


def _turned(matrices: Floats, normals: Floats, *, mirroring: bool) -> list[Floats]:
    """Three (…) coordinates of (3, …) normals turned by the inverse transposes of (3, 3, …) matrices, lengths not kept.

    A cofactor matrix is the inverse transpose times the determinant, of which only the sign of a mirroring joint
    counts.
    """
    turned = []
    signs = None
    for k in range(3):
        cofactors = cross(matrices[(k + 1) % 3], matrices[(k + 2) % 3])
        if k == 0 and mirroring:
            signs = np.sign(dot(matrices[0], cofactors))
        turned.append(dot(cofactors, normals))
    return turned if signs is None else [each * signs for each in turned]
