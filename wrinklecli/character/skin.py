"""Poses meshes at many times, with positions and normals as an engine would show them.

A `SkinnedMesh` is a mesh ready to be posed, a `PosedMesh` the same at some times. The arrays of a `Skin` hold the
coordinates of all vertices one after another, so that every operation runs along whole rows, and chunks of time stay in
a core's cache. Skin weights are kept by the few joints of each vertex, and written out for all joints chunk by chunk.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.7.3.3 (skinning). Differs from engines that turn normals by the blended
matrices themselves, whose normals lean where joints scale or shear.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Self

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.character.rig import Rig
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Array,
    Bools,
    Floats,
    Ints,
    cross,
    determinants,
    distinct_values,
    dot,
    places_of,
    renumbered,
)
from wrinklecli.numeric.portions import portions

# Numbers of a vertex in a pose: its matrix, and its places.
_WIDTH = 16


@dataclass(frozen=True, slots=True)
class Influences:
    """Skin weights by the few joints that each vertex follows: of 250 joints, most meshes have four at a vertex.

    Attributes:
        joints: (influences, vertices) numbers of joints.
        weights: (influences, vertices), 0 where a vertex has fewer.
        joint_count: The number of all joints.
    """

    joints: Ints
    weights: Floats
    joint_count: int

    @classmethod
    def of(cls, dense: Floats, columns: Ints | None = None, joint_count: int | None = None) -> "Influences":
        """Those of (vertices, joints) skin weights; of some joints alone if `columns` has their numbers."""
        counts = np.count_nonzero(dense, axis=1)
        vertices, joints = np.nonzero(dense)
        slots = np.arange(len(vertices)) - np.repeat(np.cumsum(counts) - counts, counts)
        found = np.zeros((max(int(counts.max(initial=0)), 1), len(dense)), np.intp)
        weights = np.zeros(found.shape)
        found[slots, vertices] = joints if columns is None else columns[joints]
        weights[slots, vertices] = dense[vertices, joints]
        return cls(found, weights, dense.shape[1] if joint_count is None else joint_count)

    def __len__(self) -> int:
        """The number of vertices."""
        return int(self.joints.shape[1])

    @property
    def acting(self) -> Ints:
        """(acting,) sorted numbers of the joints that have any weight."""
        return distinct_values(self.joints[self.weights > 0])

    @property
    def shares(self) -> Floats:
        """(joints,) the sum of each one's weights."""
        return np.asarray(np.bincount(self.joints.ravel(), self.weights.ravel(), self.joint_count), np.float64)

    @property
    def heaviest(self) -> Ints:
        """(vertices,) the joint with the greatest weight; the first of equal ones."""
        return np.asarray(self.joints[np.argmax(self.weights, axis=0), np.arange(len(self))])

    def among(self, joints: Ints) -> "Influences":
        """The same by the numbers among (joints,) sorted joints, which have all weight."""
        return Influences(places_of(joints, self.joint_count)[self.joints], self.weights, len(joints))

    def at(self, vertices: "Ints | slice") -> "Influences":
        """The same of some vertices."""
        return Influences(self.joints[:, vertices], self.weights[:, vertices], self.joint_count)

    def before(self, others: "Influences") -> "Influences":
        """These, and those of other vertices behind them."""
        both = (self, others)
        most = max(len(each.joints) for each in both)

        def padded(rows: Array) -> Array:
            return np.pad(rows, ((0, most - len(rows)), (0, 0)))

        joints, weights = (
            np.concatenate([padded(getattr(each, name)) for each in both], axis=1) for name in ("joints", "weights")
        )
        return Influences(joints, weights, self.joint_count)

    def dense(self) -> Floats:
        """(joints, vertices) skin weights."""
        found = np.zeros((self.joint_count, len(self)))
        every = np.arange(len(self))
        for joints, weights in zip(self.joints, self.weights, strict=True):
            found[joints, every] += weights
        return found

    def sparse(self) -> Any:
        """(vertices, joints) skin weights as a sparse matrix, which is imported in longer than a small bake takes."""
        from scipy.sparse import csr_array

        rows = np.broadcast_to(np.arange(len(self)), self.joints.shape)
        places = (rows.ravel(), self.joints.ravel())
        return csr_array((self.weights.ravel(), places), shape=(len(self), self.joint_count))


@dataclass(frozen=True, slots=True)
class Skin:
    """Vertices ready to be posed.

    Attributes:
        influences: Skin weights, which sum to 1 at each vertex.
        places: (3, 1 + shapes, vertices) bind positions, then the deltas of each shape at weight 1.
        turns: (3, 1 + shapes, vertices) unit normals, then their deltas; None without normals.
    """

    influences: Influences
    places: Floats
    turns: Floats | None

    def __len__(self) -> int:
        """The number of vertices."""
        return len(self.influences)

    def of(self, vertices: Ints) -> "Skin":
        """The same of (vertices,) some vertices."""
        turns = None if self.turns is None else self.turns[:, :, vertices]
        return Skin(self.influences.at(vertices), self.places[:, :, vertices], turns)


def prepare(
    influences: Influences,
    positions: Floats,
    deltas: Floats,
    normals: Floats | None = None,
    normal_deltas: Floats | None = None,
) -> Skin:
    """Lay out arrays that do not change with time.

    Args:
        influences: Skin weights, which sum to 1 at each vertex.
        positions: (vertices, 3) bind space.
        deltas: (shapes, vertices, 3) added by each shape, such as a morph target, at weight 1.
        normals: (vertices, 3) unit, bind space.
        normal_deltas: (shapes, vertices, 3) added to the normals.
    """
    turns = None
    if normals is not None and normal_deltas is not None:
        turns = _by_coordinate(normals, normal_deltas)
    return Skin(influences, _by_coordinate(positions, deltas), turns)


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
    positions = np.zeros((len(matrices), 3, len(skin)))
    normals = None if skin.turns is None else np.zeros_like(positions)
    factors = np.concatenate([np.ones((len(matrices), 1)), weights], axis=1)
    rows = np.ascontiguousarray(matrices[:, :, :3].transpose(2, 3, 0, 1))
    a, b, c = rows[:, :3]
    mirroring = bool((dot(a, cross(b, c)) < 0).any())
    for block in portions(positions.shape[2], _WIDTH):
        joint_weights = skin.influences.at(block).dense()
        vertex_count = joint_weights.shape[1]
        for now in portions(len(matrices), _WIDTH * vertex_count):
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


def orientations(matrices: Floats, shares: Floats) -> Floats:
    """(…,) -1 where most of a mesh is turned inside out, as an odd number of negative scales does, or else 1.

    0 stands for a mesh without any extent.

    Args:
        matrices: (…, n, 3 or 4, 4) of joints or vertices, bind to world space.
        shares: (n,) the part of the mesh that follows each.
    """
    return np.sign(np.sign(determinants(matrices[..., :3, :3])) @ shares)


@dataclass(frozen=True, slots=True)
class PosedMesh:
    """A mesh at some times, world space, scene units.

    Attributes:
        triangles: (triangles, 3) vertices, as the mesh stores them.
        positions: (frames, vertices, 3).
        normals: (frames, vertices, 3) unit; None if the mesh has none, which means flat shading.
        mirrored: (frames,) True if the joints mirror the mesh, so that its triangles wind the other way.
        hidden: (frames,) True if the node of an unskinned mesh is scaled to 0, as files with a mesh per frame do.
    """

    triangles: Ints
    positions: Floats
    normals: Floats | None
    mirrored: Bools
    hidden: Bools

    def wound(self) -> Ints:
        """(triangles, 3) vertices in the winding order of the first frame; none if the mesh is hidden then."""
        if self.hidden[0]:
            return self.triangles[:0]
        return self.triangles[:, ::-1] if self.mirrored[0] else self.triangles

    def corners(self) -> Floats:
        """(triangles, 3, 3) positions of the corners of the triangles that the first frame shows."""
        return np.asarray(self.positions[0][self.wound()])


@dataclass(frozen=True, slots=True, eq=False)
class SkinnedMesh:
    """A mesh as a node shows it, ready to be posed.

    Attributes:
        rig: An unskinned mesh follows its own node with weight 1.
        skin: Its vertices, with the weights of the acting joints.
        acting: (acting,) sorted numbers of those of the rig's joints that may move a vertex.
        triangles: (triangles, 3) vertices; none for points and lines.
    """

    rig: Rig
    skin: Skin
    acting: Ints
    triangles: Ints

    @property
    def bare(self) -> Self:
        """The mesh without normals, which is posed in half the time."""
        return replace(self, skin=replace(self.skin, turns=None))

    def only(self, vertices: Ints) -> Self:
        """The mesh with (vertices,) sorted vertices only, and with the triangles that have no others."""
        triangles = places_of(vertices, len(self.skin), -1)[self.triangles]
        return replace(self, skin=self.skin.of(vertices), triangles=triangles[(triangles >= 0).all(axis=1)])

    def part(self, chosen: Bools) -> Self:
        """The mesh with the chosen (triangles,) and their vertices only."""
        vertices, local = renumbered(self.triangles[chosen])
        return replace(self, skin=self.skin.of(vertices), triangles=local)

    def posed(
        self, clip: Clip | None, times: Floats, *, weights: Floats | None = None, offsets: Floats | None = None
    ) -> PosedMesh:
        """Morph and skin the mesh.

        Args:
            clip: None for the stored pose.
            times: (frames,) seconds of the clip.
            weights: (frames, morph targets) in place of the clip's; None to keep those.
            offsets: (frames, vertices, 3) added to the positions, bind space.
        """
        matrices = joint_matrices(self.rig, clip, times, self.acting)
        weights = morph_weights(self.rig, clip, times) if weights is None else weights
        moved = None if offsets is None else offsets.transpose(0, 2, 1)
        positions, normals = (
            None if each is None else each.transpose(0, 2, 1) for each in pose(self.skin, matrices, weights, moved)
        )
        assert positions is not None
        signs = orientations(matrices, self.skin.influences.shares)
        return PosedMesh(self.triangles, positions, normals, signs < 0, (signs == 0) & (not self.rig.skinned))

    def carried(self, clip: Clip | None, times: Floats, offsets: Floats | None = None) -> tuple[Floats, Floats]:
        """Pose the mesh, as `posed` does, with the matrices that carry moves in bind space along.

        Returns:
            (frames, vertices, 3) world positions, and (frames, vertices, 3, 3) matrices from bind to world space.
        """
        blended = blend(self.skin.influences.dense().T, joint_matrices(self.rig, clip, times, self.acting))
        bind = self.bind_positions + np.tensordot(morph_weights(self.rig, clip, times), self.deltas, axes=1)
        return transform(blended, bind if offsets is None else bind + offsets), blended[..., :3]

    def inputs(self, clip: Clip | None, times: Floats) -> Iterator[Array]:
        """The arrays on which `carried` depends, and on nothing else."""
        yield from (self.skin.places, self.skin.influences.joints, self.skin.influences.weights)
        yield from (joint_matrices(self.rig, clip, times, self.acting), morph_weights(self.rig, clip, times))

    @property
    def bind_positions(self) -> Floats:
        """(vertices, 3) positions without morph targets, bind space."""
        return self.skin.places[:, 0].T

    @property
    def deltas(self) -> Floats:
        """(morph targets, vertices, 3) added by each at weight 1, bind space."""
        return self.skin.places[:, 1:].transpose(1, 2, 0)

    @property
    def influences(self) -> Influences:
        """Skin weights by the numbers of the rig's joints."""
        own = self.skin.influences
        return Influences(self.acting[own.joints], own.weights, max(len(self.rig.joints), 1))

    def positions_at(self, clip: Clip | None, time: float) -> Floats:
        """(vertices, 3) positions at a time of a clip, or without a clip in the stored pose."""
        return np.asarray(self.bare.posed(clip, np.array([time])).positions[0])


def acting_joints(rig: Rig, influences: Influences) -> Ints:
    """(acting,) sorted numbers of the joints that have any weight."""
    return influences.acting if rig.skinned else np.arange(1)


def skinned_mesh(rig: Rig, influences: Influences, positions: Floats, deltas: Floats, triangles: Ints) -> SkinnedMesh:
    """Make a mesh without normals ready to be posed.

    Args:
        rig: Of the node that shows it.
        influences: Skin weights, which sum to 1 at each vertex.
        positions: (vertices, 3) bind space.
        deltas: (morph targets, vertices, 3) added by each at weight 1.
        triangles: (triangles, 3) vertices.
    """
    acting = acting_joints(rig, influences)
    return SkinnedMesh(rig, prepare(influences.among(acting), positions, deltas), acting, triangles)
