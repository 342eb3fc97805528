"""Shapes of the samples: signed distance fields, and quad meshes that are relaxed onto them.

Nearly all is built from + - * / and sqrt, which IEEE 754 rounds alike on every machine, so that the samples
come out with the same bytes everywhere.

Source: distance fields and smooth unions are common knowledge of implicit modelling (Ricci 1973, Wyvill
1986); the ellipsoid's estimate divides the implicit function by its gradient (Taubin 1994).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
Field = Callable[[Floats], Floats]

DIFFERENCE_STEP = 2e-5  # metres; the fields are smooth at this scale, and float64 leaves 1e-11 of noise


def norm(vectors: Floats) -> Floats:
    """Lengths (n,) of the vectors (n, 3), in a fixed order of summation."""
    x, y, z = vectors.T
    lengths: Floats = np.sqrt(x * x + y * y + z * z)
    return lengths


def on_one_side(points: Floats) -> Floats:
    """The points (n, 3), with those of negative x mirrored, each column contiguous."""
    mirrored: Floats = np.stack([np.abs(points[:, 0]), points[:, 1], points[:, 2]]).T
    return mirrored


def smoothstep(low: float, high: float, values: Floats) -> Floats:
    """Rise from 0 at `low` to 1 at `high` (which may be the smaller), flat at both ends (C²)."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    risen: Floats = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    return risen


def spline(knots: list[float], values: list[float], at: Floats) -> Floats:
    """Cubic Hermite curve through `values` with finite-difference tangents, constant beyond its ends."""
    xs, ys = np.array(knots, np.float64), np.array(values, np.float64)
    slopes = np.diff(ys) / np.diff(xs)
    tangents = np.concatenate([slopes[:1], (slopes[1:] + slopes[:-1]) / 2.0, slopes[-1:]])
    at = np.clip(at, xs[0], xs[-1])
    i = np.clip(np.searchsorted(xs, at, side="right") - 1, 0, len(xs) - 2)
    span = xs[i + 1] - xs[i]
    t = (at - xs[i]) / span
    s = 1.0 - t
    near: Floats = s * s * ((1.0 + 2.0 * t) * ys[i] + t * span * tangents[i])
    far: Floats = t * t * ((1.0 + 2.0 * s) * ys[i + 1] - s * span * tangents[i + 1])
    return near + far


def ellipsoid(points: Floats, centre: list[float], radii: list[float]) -> Floats:
    """Estimate of the signed distance (n,) to an ellipsoid, exact to first order near its surface."""
    scaled = (points - np.array(centre)) / np.array(radii)
    size = norm(scaled)
    return size * (size - 1.0) / np.maximum(norm(scaled / np.array(radii)), 1e-9)


def capsule(points: Floats, start: list[float], end: list[float], radius: float, end_radius: float) -> Floats:
    """Signed distance (n,) to a bone whose radius goes evenly from `radius` to `end_radius`."""
    a, b = np.array(start, np.float64), np.array(end, np.float64)
    ab = b - a
    offsets = points - a
    along = (offsets[:, 0] * ab[0] + offsets[:, 1] * ab[1] + offsets[:, 2] * ab[2]) / float(
        ab[0] * ab[0] + ab[1] * ab[1] + ab[2] * ab[2]
    )
    t: Floats = np.clip(along, 0.0, 1.0)
    apart = np.stack([offsets[:, k] - t * ab[k] for k in range(3)]).T
    return norm(apart) - (radius + t * (end_radius - radius))


def union(a: Floats, b: Floats, blend: float) -> Floats:
    """Union of two fields whose crease is rounded over the distance `blend` (metres)."""
    overlap = np.maximum(blend - np.abs(a - b), 0.0) / blend
    return np.minimum(a, b) - overlap * overlap * (blend / 4.0)


def cut(a: Floats, b: Floats, blend: float) -> Floats:
    """Field `a` without the inside of field `b`, rounded over `blend` (metres)."""
    return -union(-a, b, blend)


def within(region: Bools, shape: Field, points: Floats) -> Floats:
    """A field (n,) where a part may be, and far from it elsewhere: there a union is the other field, bit by bit.

    Args:
        region: (n,), True wherever the part is nearer than another by less than the union's blend.
        shape: Distance field of the part.
        points: (n, 3), metres.
    """
    distances = np.full(len(points), 10.0)  # metres: farther than anything of a character
    distances[region] = shape(points.T[:, region].T)
    return distances


def project(shape: Field, points: Floats, held: Bools, *, steps: int = 1) -> tuple[Floats, Floats]:
    """Move points to the zero of a distance field by Newton's steps, along the free axes only.

    Args:
        shape: The distance field, (n, 3) to (n,).
        points: (n, 3), metres.
        held: (n, 3), the coordinates that must stay.
        steps: Number of Newton steps.

    Returns:
        The points (n, 3), and the field's unit gradient (n, 3) at the last step.
    """
    corners = np.array([[1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]])
    free = np.where(held, 0.0, 1.0)
    # Where each column is contiguous, fields take about two thirds of the time, and round alike.
    points = np.asfortranarray(points)
    gradients = np.zeros_like(points)
    for _ in range(steps):
        samples = [shape(points + corner * DIFFERENCE_STEP) for corner in corners]
        gradients = (
            sum(sample[:, None] * corner for sample, corner in zip(samples, corners, strict=True))
            / (4.0 * DIFFERENCE_STEP)
            * free
        )
        size = np.maximum(norm(gradients), 1e-6)
        distance = (samples[0] + samples[1] + samples[2] + samples[3]) / 4.0
        points = points - gradients * np.clip(distance / (size * size), -0.01, 0.01)[:, None]
        gradients = gradients / size[:, None]
    return points, gradients


@dataclass(frozen=True, slots=True)
class Mesh:
    """A mesh of welded vertices: quads (and single triangles) with texture coordinates of their own.

    Attributes:
        positions: (vertices, 3), metres.
        quads: (quads, 4), counter-clockwise from outside; a triangle repeats its last vertex.
        uvs: (quads, 4, 2), texture coordinates of the quads' corners, v upward.
        held: (vertices, 3), coordinates that relaxation must not change.
        border: (vertices,), True on an open border.
    """

    positions: Floats
    quads: Ints
    uvs: Floats
    held: Bools
    border: Bools


@dataclass(slots=True)
class Builder:
    """Collects points and grids of quads until `mesh()` makes a Mesh of them."""

    points: list[Floats] = field(default_factory=list)
    quads: list[list[int]] = field(default_factory=list)
    uvs: list[list[tuple[float, float]]] = field(default_factory=list)

    def add(self, points: Floats) -> Ints:
        """Add points (..., 3), and return their indices (...)."""
        first = len(self.points)
        flat = points.reshape(-1, 3)
        self.points.extend(flat)
        return np.arange(first, first + len(flat)).reshape(points.shape[:-1])

    def grid(
        self, ids: Ints, low: tuple[float, float], high: tuple[float, float], *, skip: Bools | None = None
    ) -> None:
        """Add the quads of a grid.

        Args:
            ids: (rows + 1, columns + 1) vertices; column × row direction faces outward.
            low: (u, v) at the grid's first vertex.
            high: (u, v) at its last.
            skip: (rows, columns), quads to leave out.
        """
        rows, columns = ids.shape[0] - 1, ids.shape[1] - 1
        us = np.linspace(low[0], high[0], columns + 1).tolist()
        vs = np.linspace(low[1], high[1], rows + 1).tolist()
        for r in range(rows):
            for c in range(columns):
                if skip is None or not skip[r, c]:
                    corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)]
                    self.quads.append([int(ids[corner]) for corner in corners])
                    self.uvs.append([(us[j], vs[i]) for i, j in corners])

    def triangle(self, ids: list[int], uvs: list[tuple[float, float]]) -> None:
        """Add one triangle."""
        self.quads.append([*ids, ids[-1]])
        self.uvs.append([*uvs, uvs[-1]])

    def mesh(self, *, border: Ints, border_axis: int, middle: Ints | None = None) -> Mesh:
        """Make the mesh of those vertices that have quads.

        Args:
            border: Vertices on open borders, which keep their coordinate `border_axis`.
            border_axis: 0, 1 or 2.
            middle: Vertices that stay in the plane x = 0, where half a mesh meets its mirror image.
        """
        used, quads = np.unique(np.array(self.quads), return_inverse=True)
        positions = np.array(self.points)[used]
        held = np.zeros(positions.shape, dtype=bool)
        on_border = np.isin(used, border)
        held[on_border, border_axis] = True
        if middle is not None:
            held[np.isin(used, middle), 0] = True
        return Mesh(
            positions=positions,
            quads=quads.reshape(-1, 4),
            uvs=np.array(self.uvs),
            held=held,
            border=on_border,
        )


def neighbour_weights(mesh: Mesh) -> tuple[Ints, Floats]:
    """Neighbours of each vertex, padded.

    Border vertices see border vertices only, so they slide along it. Those of a mirror plane see their
    neighbours beside it twice, once for the mirror image.

    Returns:
        Indices and weights, both (vertices, largest valence).
    """
    ends = np.concatenate([np.stack([mesh.quads[:, i], mesh.quads[:, (i + 1) % 4]], axis=1) for i in range(4)])
    ends = ends[ends[:, 0] != ends[:, 1]]
    numbers = np.unique(np.concatenate([ends, ends[:, ::-1]]) @ [len(mesh.positions), 1])
    ends = np.stack(np.divmod(numbers, len(mesh.positions)), axis=1)
    ends = ends[~mesh.border[ends[:, 0]] | mesh.border[ends[:, 1]]]
    counts = np.bincount(ends[:, 0], minlength=len(mesh.positions))
    slots = np.arange(len(ends)) - np.repeat(np.cumsum(counts) - counts, counts)
    indices = np.zeros((len(counts), int(counts.max())), dtype=np.intp)
    weights = np.zeros(indices.shape)
    indices[ends[:, 0], slots] = ends[:, 1]
    in_plane = mesh.held[:, 0]
    weights[ends[:, 0], slots] = np.where(in_plane[ends[:, 0]] & ~in_plane[ends[:, 1]], 2.0, 1.0)
    return indices, weights


def relax(mesh: Mesh, shape: Field, *, steps: int, density: Field | None = None) -> Mesh:
    """Spread the vertices evenly over a shape: average each with its neighbours, put it back, repeat.

    Args:
        mesh: Connectivity, borders, and a first guess of the positions.
        shape: Distance field of the surface.
        steps: Number of rounds.
        density: Pull (n,) of places (n, 3) on the vertices; 1 everywhere if None.
    """
    indices, weights = neighbour_weights(mesh)
    points, gradients = project(shape, mesh.positions, mesh.held, steps=6)
    for _ in range(steps):
        pulls = weights if density is None else weights * density(points)[indices]
        total = np.zeros(len(points))
        means = np.zeros_like(points)
        for column in range(indices.shape[1]):
            others = points[indices[:, column]]
            # Long edges pull more: equal pulls would leave the tips of noses and fingers without vertices.
            pull = pulls[:, column] * norm(others - points)
            total = total + pull
            means = means + pull[:, None] * others
        moves = np.where(mesh.held, 0.0, means / total[:, None] - points)
        x, y, z = (moves * gradients).T
        moves = moves - (x + y + z)[:, None] * gradients
        points, gradients = project(shape, points + 0.35 * moves, mesh.held)
    points, _ = project(shape, points, mesh.held, steps=4)
    return replace(mesh, positions=points)


def triangulate(mesh: Mesh) -> tuple[Ints, Floats]:
    """Cut quads along the shorter diagonal.

    Returns:
        Vertices (triangles, 3), and texture coordinates (triangles, 3, 2) of the corners.
    """
    a, b, c, d = (mesh.positions[mesh.quads[:, i]] for i in range(4))
    # Half a micrometre of preference, lest rounding decide between diagonals of one length.
    other = norm(b - d) < norm(a - c) - 5e-7
    single = mesh.quads[:, 2] == mesh.quads[:, 3]
    corners = np.where(other[:, None, None], np.array([[0, 1, 3], [1, 2, 3]]), np.array([[0, 1, 2], [0, 2, 3]]))
    corners[single] = np.array([[0, 1, 2], [0, 2, 3]])
    keep = np.ones((len(corners), 2), dtype=bool)
    keep[single, 1] = False
    rows = np.arange(len(corners))[:, None, None]
    return mesh.quads[rows, corners][keep], mesh.uvs[rows, corners][keep]


def vertex_normals(positions: Floats, triangles: Ints) -> Floats:
    """Unit normals (vertices, 3), the area-weighted mean of the triangles around."""
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    u, v = b - a, c - a
    faces = np.stack(
        [
            u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1],
            u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2],
            u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0],
        ],
        axis=1,
    )
    sums = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(faces[:, axis], 3), len(positions)) for axis in range(3)],
        axis=1,
        dtype=np.float64,
    )
    return sums / norm(sums)[:, None]
