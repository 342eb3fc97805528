"""Rounding: how far new vertices leave the coarse surface, so little that nothing but the wrinkles changes.

The butterfly scheme puts a new vertex beside its place on the coarse surface, so that the refined one is smooth. Of
this offset only a part is made:

- Only along the surface's normal. The rest would slide the texture, whose coordinates are mixed linearly.
- Only the share of the height that the tool has there. It is 0 at the patch's border, so that the triangles that close
  the gaps to coarser ones lie in the old faces.
- At most 15 % of the wrinkles' height. On a mesh that is coarse for its wrinkles more would show at rest.
- Nothing on hard edges, and stencils do not read across them: what the artist made flat stays flat.

The asset's own morph deltas get the same share of theirs, in all directions: so they stay linear.

Source: D. Zorin, P. Schröder, W. Sweldens, *Interpolating Subdivision for Meshes with Arbitrary Topology*, SIGGRAPH
1996. Differs: theirs is the whole offset, as `scheme: butterfly_full` has it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.surface import Surface
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    children,
    distinct_values,
    face_normals,
    flags_of,
    normals_at,
    unit,
)
from wrinklecli.numeric.subdivide import Subdivision, two_rings
from wrinklecli.surface.region import Region

# Cosine of the angle between authored normals of one vertex beyond which the edge between them is hard: 5°. Seams of
# smooth surfaces have equal ones, but for the half degree by which bytes round.
_SAME_NORMAL = float(np.cos(np.radians(5.0)))
# Cosine of the angle between the two faces of an edge beyond which it is hard, whatever the normals: 50°.
_SHARP = float(np.cos(np.radians(50.0)))
# Share of a patch's edges that are hard beyond which all are: the mesh is meant to be faceted.
_FACETED = 0.5
# Greatest offset over the height of the tallest wrinkle, at a strength of 1.
_MOST = 0.15
# Shares are multiples of this: what the rest pose rounds off does not reach the positions.
_STEP = 2.0**-16
# Cosine of the coarse and the smooth surface's normal from which on the way along the one to the other grows no longer.
_LEAST_COSINE = 0.5


@dataclass(frozen=True, slots=True)
class HardEdges:
    """The coarse edges that keep their shape.

    Attributes:
        vertices: (edges, 2) their welded vertices, the lower first.
        shares: (regions,) of each patch's edges, how many are hard.
    """

    vertices: Ints
    shares: Floats

    @property
    def faceted(self) -> Bools:
        """(regions,) those of which all edges count as hard."""
        return self.shares > _FACETED


def hard_edges(surface: Surface, positions: Floats, regions: Sequence[Region]) -> HardEdges:
    """Find the hard edges at the regions: where authored normals differ or are missing, and at sharp angles.

    Args:
        surface: The coarse surface.
        positions: (vertices, 3) of it, bind space.
        regions: Where more than half of the edges of one are hard, all are.
    """
    count = len(surface.positions)
    members = flags_of(np.concatenate([region.members for region in regions]), len(surface.triangles))
    faces = np.flatnonzero(two_rings(members, surface.triangles, count))
    triangles = surface.triangles[faces]
    starts, ends = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    keys, edges = np.unique(np.minimum(starts, ends) * count + np.maximum(starts, ends), return_inverse=True)
    hard = np.zeros(len(keys), np.bool_)

    authored = unit(surface.normals)[surface.corners[faces]]
    at_starts, at_ends = authored.reshape(-1, 3), np.roll(authored, -1, axis=1).reshape(-1, 3)
    hard[edges[~at_starts.any(axis=1) | ~at_ends.any(axis=1)]] = True
    # The sides of two faces meet in an edge; as a rule one runs from its start to its end, and the other back.
    order, pairs = np.argsort(edges, kind="stable"), np.flatnonzero(np.bincount(edges, minlength=len(keys)) == 2)
    first = np.searchsorted(edges[order], pairs)
    one, other = order[first], order[first + 1]
    back = starts[one] != starts[other]
    flat = np.repeat(unit(face_normals(positions, triangles)), 3, axis=0)
    hard[pairs] |= np.sum(flat[one] * flat[other], axis=1) * np.where(back, 1.0, -1.0) < _SHARP
    for here, there in ((at_starts, at_ends), (at_ends, at_starts)):
        across = np.where(back[:, None], there[other], here[other])
        hard[pairs] |= np.sum(here[one] * across, axis=1) < _SAME_NORMAL

    edges = edges.reshape(-1, 3)
    of_patches = [distinct_values(edges[children(faces, region.members)]) for region in regions]
    shares = np.array([hard[each].mean() for each in of_patches])
    for number in np.flatnonzero(shares > _FACETED):
        hard[of_patches[number]] = True
    return HardEdges(np.stack(np.divmod(keys[hard], count), axis=1), shares)


@dataclass(frozen=True, slots=True)
class Rounded:
    """Where the vertices of a refined surface lie, bind space.

    Attributes:
        positions: (vertices, 3) stored positions.
        morph_deltas: (morph targets, vertices, 3).
        departures: (regions,) how far a patch's new vertices leave the coarse surface at the most, over the height of
            the tallest wrinkle there.
    """

    positions: Floats
    morph_deltas: Floats
    departures: Floats


def rounded(
    surface: Surface,
    subdivision: Subdivision,
    regions: Sequence[Region],
    *,
    blended: Floats,
    rest_places: Floats,
    rest_normals: Floats,
    full: bool,
) -> Rounded:
    """Place the vertices of a subdivision.

    Args:
        surface: The coarse surface.
        subdivision: How it was split.
        regions: Of all tools on it.
        blended: (vertices, 3, 4) bind to world space at rest.
        rest_places: (vertices, 3) places on the coarse surface, world space at rest.
        rest_normals: (vertices, 3) of the coarse surface where a region is, world space at rest.
        full: Make the whole offset.
    """
    old = len(surface.positions)
    places, deltas = subdivision.interpolate(surface.positions), subdivision.interpolate(surface.morph_deltas)
    if subdivision.matrix is subdivision.linear:
        return Rounded(places, deltas, np.zeros(len(regions)))
    smooth = subdivision.positions(surface.positions)
    normals, heights = _heights(places, smooth, subdivision.triangles, old)
    heights_rest = np.abs(heights) * np.linalg.norm(np.einsum("vij,vj->vi", blended[old:, :, :3], normals), axis=1)

    shares, tallest = np.full(len(heights), 1.0 if full else 0.0), np.zeros(len(heights))
    on_patches = []
    for region in regions:
        vertices = distinct_values(subdivision.triangles[children(subdivision.parents, region.members)])
        vertices = vertices[vertices >= old]
        on_patches.append(vertices - old)
        u, v = region.coordinates(rest_places[vertices])
        share = region.presence(u, v, region.cosines(u, rest_normals[vertices]))
        # Grows like the height at first, and towards its bound in the end.
        excess = heights_rest[vertices - old] / (_MOST * region.nominal_height)
        share = np.rint(share / (1.0 + excess**4) ** 0.25 / _STEP) * _STEP
        shares[vertices - old] = np.maximum(shares[vertices - old], share)
        tallest[vertices - old] = np.maximum(tallest[vertices - old], region.greatest_height)

    places[old:] = smooth[old:] if full else places[old:] + (shares * heights)[:, None] * normals
    deltas[:, old:] += shares[:, None] * (subdivision.positions(surface.morph_deltas) - deltas)[:, old:]
    departures = [(shares * heights_rest)[each] / tallest[each] for each in on_patches]
    return Rounded(places, deltas, np.array([each.max(initial=0.0) for each in departures]))


def _heights(places: Floats, smooth: Floats, triangles: Ints, old: int) -> tuple[Floats, Floats]:
    """(new vertices, 3) unit normals of the coarse surface, and (new vertices,) how high above it the smooth one lies.

    In the middle of a coarse face that is its normal, on an edge the mean of both faces'. Along it a vertex goes to the
    plane that touches the smooth surface at the vertex's place there: a line to the vertex itself would lean.

    Args:
        places: (vertices, 3) of the fine triangles' vertices on the coarse surface.
        smooth: (vertices, 3) on the smooth surface.
        triangles: (triangles, 3).
        old: How many of the vertices are coarse ones.
    """
    new = np.arange(old, len(places))
    normals, smooth_normals = normals_at(places, triangles, new), normals_at(smooth, triangles, new)
    cosines = np.maximum(np.sum(normals * smooth_normals, axis=1), _LEAST_COSINE)
    heights: Floats = np.sum((smooth - places)[old:] * smooth_normals, axis=1) / cosines
    return normals, heights
