"""Fixed shapes: morph targets in bind space, and the NORMAL deltas that fit them.

NORMAL deltas are fitted to the true normals of sampled states, such as the tallest wrinkles in a pose that raises them.
If a pose makes a surface shorter, its wrinkles are steeper, but neither skinning nor the asset's own morph targets turn
normals accordingly.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.pose import Pose, blend, transform
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    are_nonzero,
    cross,
    determinants,
    distinct,
    distinct_values,
    dot,
    greatest_coordinates,
    groups_of,
    matches,
    places_of,
    renumbered,
    smoothstep,
    unit,
    vertex_normals,
)
from wrinklecli.numeric.intersections import sides_of
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import carried_normals

LEAST_SHARE = 1e-6
"""Ratio of a displacement to the greatest below which a vertex counts as still: nobody would see the move."""

LEAST_COSINE = 0.1
"""Least cosine of true and base normal that the fit follows, as NORMAL deltas cannot turn a normal over."""

# Cosine of a skinned normal and the true one of the surface as skinned up to which that surface counts as folded over:
# it does not say there how a normal of what is displaced differs from the true one, and turned it to the inside.
_FOLDED_COSINE = 0.5
# Cosine from which on what the two differ by counts wholly: skinning is off by up to 25° outside of folds.
_WHOLE_COSINE = 0.9

# Arrays of vertices by pairs of shapes that the fit of normals holds at once.
_FIT_COPIES = 2


@dataclass(frozen=True, slots=True)
class Middles:
    """The displacements of the middles of edges, beyond the mean of those of the edges' ends.

    Triangles cut the corners of what a shape displaces: of a sine with two edges on each half of a wave they show two
    thirds of the slope, and with the middles of the edges nine tenths. Normals count these middles, which no file has.

    Attributes:
        edges: (edges,) sorted numbers of edges of the refined mesh, as `numbers_of` gives them.
        deltas: (…, edges, 3) bind space.
    """

    edges: Ints
    deltas: Floats

    @staticmethod
    def numbers_of(ends: Ints, fine: Refinement) -> Ints:
        """(edges,) a number for each edge of (edges, 2) fine welded vertices, the lower one first."""
        return ends[:, 0] * len(fine.positions) + ends[:, 1]


@dataclass(frozen=True, slots=True)
class Shape:
    """One morph target at weight 1.

    Attributes:
        vertices: (vertices,) fine welded vertices that move, sorted.
        deltas: (vertices, 3) bind displacement.
        tallest: Largest world displacement at rest, scene units.
        normal_vertices: (vertices,) fine welded vertices whose normal changes, sorted.
        normal_deltas: (vertices, 3) added to the unit bind normal.
        middles: Those of edges that are not straight, with (edges, 3) deltas; None if all are.
    """

    vertices: Ints
    deltas: Floats
    tallest: float
    normal_vertices: Ints
    normal_deltas: Floats
    middles: Middles | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """A state in which normals are to be right.

    Attributes:
        weights: (shapes,) weights of the shapes that act together.
        beneath: Shapes of other effects that act meanwhile, each with its weight; these have their normals already.
    """

    weights: Floats
    pose: Pose
    beneath: Sequence[tuple[Shape, float]] = ()


def make_shapes(
    fine: Refinement,
    vertices: Ints,
    deltas: Floats,
    *,
    tallest: Floats,
    samples: Sequence[Sample],
    folded: bool = False,
    middles: Middles | None = None,
) -> list[Shape | None]:
    """Morph targets that act together, with NORMAL deltas fitted over samples of their weights.

    Args:
        fine: The refined surface.
        vertices: (vertices,) fine welded vertices, sorted.
        deltas: (shapes, vertices, 3) bind displacement at weight 1.
        tallest: (shapes,) largest world displacement at weight 1, scene units.
        samples: The states of the fit; empty if the mesh has no normals.
        folded: As `DisplacedNormals` takes it.
        middles: With (shapes, edges, 3) deltas.
    """
    lengths = greatest_coordinates(deltas)
    moving = lengths > LEAST_SHARE * lengths.max(initial=0.0)
    normal_vertices, normal_deltas = np.zeros(0, np.intp), np.zeros((len(deltas), 0, 3))
    if samples and moving.any():
        together = moving.any(axis=0)
        normal_vertices, normal_deltas = _fit_normals(
            fine,
            vertices[together],
            np.where(moving[:, together, None], deltas[:, together], 0.0),
            samples,
            folded=folded,
            middles=middles,
        )
    shapes: list[Shape | None] = []
    for shape, moves in enumerate(moving):
        changed = greatest_coordinates(normal_deltas[shape]) > LEAST_SHARE
        shapes.append(
            Shape(
                vertices[moves],
                deltas[shape, moves],
                float(tallest[shape]),
                normal_vertices[changed],
                normal_deltas[shape, changed],
                middles and _bent(middles.edges, middles.deltas[shape]),
            )
            if moves.any()
            else None
        )
    return shapes


def _bent(edges: Ints, deltas: Floats) -> Middles | None:
    """The middles of one shape, without those of straight edges; None if there is none."""
    lengths = greatest_coordinates(deltas)
    bent = lengths > LEAST_SHARE * lengths.max(initial=0.0)
    return Middles(edges[bent], deltas[bent]) if bent.any() else None


def fit_bytes(shapes: int, vertices: int) -> int:
    """Bytes that the normals of so many shapes that act together take while they are fitted."""
    return _FIT_COPIES * 8 * vertices * shapes**2


def _fit_normals(
    fine: Refinement,
    vertices: Ints,
    deltas: Floats,
    samples: Sequence[Sample],
    *,
    folded: bool,
    middles: Middles | None,
) -> tuple[Ints, Floats]:
    """(touched,) vertices and (shapes, touched, 3) deltas of their unit normals at weight 1.

    An engine adds w ΔN to the base normal N and renormalises, so only directions must be right. The true unit normal t
    is scaled to t/(t·N), whose part along N is N, and fitted with weights (t·N)⁴. On a plane, this is exact at all
    heights.
    """
    weights = np.stack([each.weights for each in samples])
    normals = DisplacedNormals.of(fine, vertices)
    touched, base = normals.touched, normals.base
    true = np.tile(base, (len(samples), 1, 1))
    moving, bending = are_nonzero(deltas), None if middles is None else are_nonzero(middles.deltas)
    # A sample says nothing of vertices that no shape with a weight in it moves, and few of many shapes have one.
    for chosen in groups_of(distinct(weights != 0)[1]):
        shapes = weights[chosen[0]] != 0
        own, factors, bent = np.flatnonzero(moving[shapes].any(axis=0)), weights[np.ix_(chosen, shapes)], None
        if middles is not None and bending is not None:
            edges = np.flatnonzero(bending[shapes].any(axis=0))
            bent = Middles(
                middles.edges[edges], np.tensordot(factors, middles.deltas[shapes].take(edges, axis=1), axes=1)
            )
        part = normals if len(own) == len(vertices) else DisplacedNormals.of(fine, vertices[own])
        true[np.ix_(chosen, np.searchsorted(touched, part.touched))] = part.in_poses(
            np.einsum("fs,svx->fvx", factors, deltas[shapes].take(own, axis=1)),
            [samples[each].pose for each in chosen.tolist()],
            [samples[each].beneath for each in chosen.tolist()],
            folded=folded,
            middles=bent,
        )
    cosines = np.maximum(dot(np.moveaxis(true, 2, 0), base.T), LEAST_COSINE)
    wanted = true / cosines[..., None] - base
    for number, sample in enumerate(samples):
        for shape, weight in sample.beneath:
            _, rows, others = np.intersect1d(touched, shape.normal_vertices, assume_unique=True, return_indices=True)
            wanted[number, rows] -= weight * shape.normal_deltas[others]
    leverages, squares = cosines**4, weights[:, :, None] * weights[:, None]
    wanted *= leverages[:, :, None]
    # A shape turns no normal around which it moves nothing, though it could make up for what others leave there.
    reaching = normals.reached(moving)
    traces = np.sum(leverages.T @ weights**2 * reaching, axis=1)
    # Shapes that hardly act in any sample get no normals instead of huge ones.
    ridge = 1e-9 * traces.max(initial=0.0) + 1e-30
    found = np.zeros((len(deltas), len(touched), 3))
    # Few of many shapes reach a vertex, and the same ones those around it.
    for chosen in groups_of(distinct(np.packbits(reaching, axis=1))[1]):
        own = np.flatnonzero(reaching[chosen[0]])
        count = len(own)
        of_pairs = squares[:, own][:, :, own].reshape(len(samples), -1)
        normal = (leverages[:, chosen].T @ of_pairs).reshape(-1, count, count)
        normal[:, np.arange(count), np.arange(count)] += ridge
        right = (weights[:, own].T @ wanted[:, chosen].reshape(len(samples), -1)).reshape(count, -1, 3)
        found[np.ix_(own, chosen)] = np.linalg.solve(normal, right.transpose(1, 0, 2)).transpose(1, 0, 2)
    return touched, found


@dataclass(frozen=True, slots=True)
class DisplacedNormals:
    """Bind normals around displaced vertices that a pose takes to true ones.

    Skinned normals of a surface differ from the true ones of the posed surface. So the turns of true normals by
    wrinkles are applied to the skinned ones, and nothing changes where nothing is displaced.

    Attributes:
        fine: The refined surface.
        touched: (touched,) sorted vertices of every triangle that has a displaced vertex.
        around: (rows,) sorted vertices of every triangle that has a touched one.
        triangles: (triangles, 3) those triangles, as rows,
        edges: (edges,) sorted numbers of their edges, as `Middles` has them,
        ends: (edges, 2) the rows of these, and (triangles, 3) which one runs
        sides: from each corner to the next one.
        rows: (touched,) rows of the touched vertices,
        moved: and (vertices,) those of the displaced ones.
        weights: (rows, joints) skin weights.
        base: (touched, 3) unit bind normals.
    """

    fine: Refinement
    touched: Ints
    around: Ints
    triangles: Ints
    edges: Ints
    ends: Ints
    sides: Ints
    rows: Ints
    moved: Ints
    weights: Floats
    base: Floats

    @classmethod
    def of(cls, fine: Refinement, vertices: Ints) -> "DisplacedNormals":
        """Find what is round the (vertices,) that are displaced."""
        touched = distinct_values(fine.triangles[fine.around.faces_of(vertices)])
        corners = fine.triangles[fine.around.faces_of(touched)]
        around = distinct_values(corners)
        rows = places_of(around, len(fine.positions))
        edges, sides = renumbered(Middles.numbers_of(sides_of(corners), fine))
        ends = np.stack(np.divmod(edges, len(fine.positions)), axis=1)
        return cls(
            fine,
            touched,
            around,
            rows[corners],
            edges,
            rows[ends],
            sides.reshape(-1, 3),
            rows[touched],
            rows[vertices],
            fine.dense_weights(around, fine.weights.joint_count),
            fine.normals_at(touched),
        )

    def reached(self, moves: Bools) -> Bools:
        """(touched, shapes) True for those with a neighbour that a shape moves, or moved, by (shapes, vertices)."""
        moved = np.zeros((len(self.around), len(moves)), np.bool_)
        moved[self.moved] = moves.T
        of_faces = moved[self.triangles].any(axis=1)
        found = np.zeros_like(moved)
        for corners in self.triangles.T:
            np.logical_or.at(found, corners, of_faces)
        return found[self.rows]

    def in_poses(
        self,
        displacements: Floats,
        poses: Sequence[Pose],
        beneath: Sequence[Sequence[tuple[Shape, float]]] = (),
        *,
        folded: bool = False,
        middles: Middles | None = None,
    ) -> Floats:
        """The normals in some poses: (samples, touched, 3) unit vectors, bind space.

        The inverse transposes of the blended matrices turn them to area-weighted normals.

        Args:
            displacements: (samples, vertices, 3) bind space.
            poses: One for each sample.
            beneath: For each sample other shapes that displace vertices too, and their weights.
            folded: True if the displacements undo what poses fold over: there the true normals count themselves.
            middles: Those of the displacements, with (samples, edges, 3) deltas.
        """
        fine, around, rows, base = self.fine, self.around, self.rows, self.base
        middles = _with_others(middles, beneath, len(displacements))
        bent, known = (None, None) if middles is None else matches(self.edges, middles.edges)
        normals = np.zeros((len(displacements), len(self.touched), 3))
        shown_in: Pose | None = None
        for number, (into, displacement, pose) in enumerate(zip(normals, displacements, poses, strict=True)):
            if pose is not shown_in:
                shown_in = pose
                # Poses of the asset's own rig say nothing of the targets of effects.
                raised = np.flatnonzero(pose.morph_weights)
                deltas = fine.morph_deltas[raised[:, None], around]
                plain = fine.positions[around] + np.tensordot(pose.morph_weights[raised], deltas, axes=1)
                blended = blend(self.weights, pose.matrices[None])[0]
                # A mirrored pose turns the winding inside out.
                outward = np.sign(determinants(blended[rows, :, :3]))[:, None]
                smooth = outward * vertex_normals(transform(blended[None], plain)[0], self.triangles)[rows]
                shown = carried_normals(blended[rows], base)
            bind = plain.copy()
            bind[self.moved] += displacement
            for shape, weight in beneath[number] if beneath else ():
                _, here, others = np.intersect1d(around, shape.vertices, assume_unique=True, return_indices=True)
                bind[here] += weight * shape.deltas[others]
            posed = transform(blended[None], bind)[0]
            if middles is None or bent is None:
                true = outward * vertex_normals(posed, self.triangles)[rows]
            else:
                true = outward * self._normals(posed, blended, bent, middles.deltas[number, known])[rows]
            turned = turn_to(smooth, shown, true)
            if folded:
                alike = (dot(smooth.T, shown.T)[:, None] - _FOLDED_COSINE) / (_WHOLE_COSINE - _FOLDED_COSINE)
                kept = smoothstep(np.clip(alike, 0.0, 1.0))
                turned = kept * turned + (1.0 - kept) * true
            back = unit(np.einsum("vji,vj->vi", blended[rows, :, :3], turned))
            into += np.where(shown.any(axis=1, keepdims=True), back, base)  # a singular pose shows nothing
        return normals

    def _normals(self, posed: Floats, blended: Floats, bent: Ints, deltas: Floats) -> Floats:
        """(rows, 3) area-weighted unit normals of the triangles' corners, up to the middles of their sides.

        Args:
            posed: (rows, 3) positions in a pose.
            blended: (rows, 3, 4) matrices that take the skin there.
            bent: (bent,) edges that are not straight.
            deltas: (bent, 3) how far their middles are displaced, bind space.
        """
        turned = blended.take(self.ends[bent, 0], axis=0) + blended.take(self.ends[bent, 1], axis=0)
        middles = np.zeros((3, len(self.edges)))
        middles[:, bent] = np.einsum("eij,ej->ie", turned[:, :, :3], deltas) / 2.0
        places = np.ascontiguousarray(posed.T)
        corners = [places.take(column, axis=1) for column in self.triangles.T]
        moved = [middles.take(column, axis=1) for column in self.sides.T]
        half = [(corners[k - 2] - corners[k]) / 2.0 for k in range(3)]
        # From each corner to the middle of the side after it, and to that of the side before it.
        faces = [cross(moved[k] + half[k], moved[k - 1] - half[k - 1]) for k in range(3)]
        at = self.triangles.T.ravel()
        sums = [np.bincount(at, np.concatenate([each[k] for each in faces]), len(posed)) for k in range(3)]
        return unit(np.stack(sums, axis=1))


def turn_to(base: Floats, authored: Floats, vectors: Floats) -> Floats:
    """Turn (vertices, 3) vectors by the smallest rotations from `base` to `authored`, (vertices, 3) unit normals.

    A base of 0 makes no turn.
    """
    # Coordinate by coordinate, as `np.cross` takes several times as long.
    start, vector = base.T, vectors.T
    axis, cosine = cross(start, authored.T), dot(start, authored.T)
    # Opposite normals (a face wound inside out) have no smallest rotation; there, both are mirrored.
    opposite = cosine < -0.999
    scale = 1.0 / np.where(opposite, 1.0, 1.0 + cosine)
    across = cross(axis, vector)
    turned = [a + b + c * scale for a, b, c in zip(vector, across, cross(axis, across), strict=True)]
    return np.where(opposite[:, None], -vectors, np.stack(turned, axis=1))


def summed(shapes: Sequence[Shape], factors: Floats) -> Shape:
    """A weighted sum of shapes."""
    rows = factors[:, None]
    vertices, (deltas,) = _sums([each.vertices for each in shapes], [each.deltas for each in shapes], rows)
    turned, (turns,) = _sums([each.normal_vertices for each in shapes], [each.normal_deltas for each in shapes], rows)
    scale = max(shape.tallest / _longest(shape.deltas) for shape in shapes)
    middles = summed_middles(shapes, factors[None])
    middles = middles and replace(middles, deltas=middles.deltas[0])
    return Shape(vertices, deltas, scale * _longest(deltas), turned, turns, middles)


def summed_middles(shapes: Sequence[Shape], weights: Floats) -> Middles | None:
    """The middles of weighted sums of shapes, for (samples, shapes) weights; None if all edges are straight."""
    bent = [(each.middles, column) for each, column in zip(shapes, weights.T, strict=True) if each.middles is not None]
    if not bent:
        return None
    of_shapes = [each for each, _ in bent]
    columns = np.stack([column for _, column in bent])
    return Middles(*_sums([each.edges for each in of_shapes], [each.deltas for each in of_shapes], columns))


def _with_others(
    middles: Middles | None, beneath: Sequence[Sequence[tuple[Shape, float]]], count: int
) -> Middles | None:
    """The middles of (samples, …) displacements and of the weighted shapes `beneath` each; None if there are none."""
    each_alone = np.eye(count)
    bent = [
        (shape.middles.edges, shape.middles.deltas, weight * alone)
        for alone, shapes in zip(each_alone, beneath, strict=False)
        for shape, weight in shapes
        if shape.middles is not None
    ]
    if not bent:
        return middles
    if middles is not None:
        bent += [(middles.edges, deltas, alone) for deltas, alone in zip(middles.deltas, each_alone, strict=True)]
    edges, deltas, rows = zip(*bent, strict=True)
    return Middles(*_sums(edges, deltas, np.stack(rows)))


def _sums(places: Sequence[Ints], vectors: Sequence[Floats], weights: Floats) -> tuple[Ints, Floats]:
    """The sorted numbers that any part has, and (samples, numbers, 3) sums of the parts' vectors.

    Each part has (numbers,) `places` and (numbers, 3) `vectors`, and a row of (parts, samples) `weights`.
    """
    numbers = distinct_values(np.concatenate(places))
    sums = np.zeros((weights.shape[1], len(numbers), 3))
    for where, moves, row in zip(places, vectors, weights, strict=True):
        at = np.searchsorted(numbers, where)
        for sample in np.flatnonzero(row):
            sums[sample, at] += row[sample] * moves
    return numbers, sums


def _longest(deltas: Floats) -> float:
    return float(np.sqrt(np.sum(deltas**2, axis=1)).max())
