"""Rounds the refined surface: moves new vertices off the coarse one, but so little that only the effects show.

The butterfly scheme puts a new vertex beside its place on the coarse surface, so that the refined surface is smooth.
Only a part of this offset is applied:

- Only along the surface's normal. The rest would slide the texture, whose coordinates are mixed linearly.
- Only the fraction of the displacement that the region has there. It is 0 at the region's border, so that the triangles
  that close the gaps to coarser ones lie in the old faces.
- At most 15 % of the region's greatest displacement. More would show at rest on a mesh that is coarse for its effect.
- Nothing on hard edges, and stencils do not read across them: what the artist made flat stays flat.

The asset's own morph deltas move nothing at rest. So they get their whole offsets in all directions, and stay linear; a
coarse surface is then as smooth in an expression as the scheme makes it. Only at the region's border the offsets fade
out, and hard edges stay as they are. Morph targets with a weight at rest get the same fraction as positions.

Source: D. Zorin, P. Schröder, W. Sweldens, *Interpolating Subdivision for Meshes with Arbitrary Topology*, SIGGRAPH
1996. Differs: they apply the whole offset, as `scheme: butterfly_full` does.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.surface import Surface
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    bounded,
    children,
    distinct_values,
    face_normals,
    normals_at,
    smoothstep,
    unit,
)
from wrinklecli.numeric.edges import Edges
from wrinklecli.numeric.subdivide import Subdivision, two_rings
from wrinklecli.surface.region import Region, members_of
from wrinklecli.surface.rest import Rest

# An edge is hard if authored normals of one vertex on its two sides enclose more than 5°. Smooth surfaces have equal
# normals at seams, up to half a degree of rounding in bytes.
_SAME_NORMAL = float(np.cos(np.radians(5.0)))
# An edge is hard, whatever the normals, if its two faces enclose more than 50°.
SHARP = float(np.cos(np.radians(50.0)))
# Cosine of the greatest angle of two faces with one normal between them that are no crease: a limb of five sides, drawn
# smooth, has angles of 72°.
CREASE = float(np.cos(np.radians(80.0)))
# If more than this fraction of a region's edges is hard, all are: the mesh is meant to be faceted.
FACETED = 0.5
# Greatest offset over the region's greatest displacement at a strength of 1.
_MOST = 0.15
# Fraction of the region's displacement from which on morph deltas get their whole offsets: with the bell attenuation
# they fade over the outer eighth of the half width. A wider rim keeps more kinks: of those that a target adds to a
# coarse forehead the sharpest hundredth is 11.0° with this, 12.5° with 0.25, and 10.1° with whole offsets everywhere.
_WHOLE = 0.05
# Applied fractions are multiples of this, so that rounding of the rest pose does not reach the positions.
_STEP = 2.0**-16
# Offsets are divided by the cosine between the coarse and the smooth normal, or by this if it is greater.
_LEAST_COSINE = 0.5


@dataclass(frozen=True, slots=True)
class HardEdges:
    """The coarse edges that keep their shape.

    Attributes:
        vertices: (edges, 2) welded vertices, the lower first.
        shares: (regions,) fraction of each region's edges that are hard.
    """

    vertices: Ints
    shares: Floats

    @property
    def faceted(self) -> Bools:
        """(regions,) True if all edges of the region count as hard."""
        return self.shares > FACETED


def hard_edges(surface: Surface, positions: Floats, regions: Sequence[Region]) -> HardEdges:
    """Find the hard edges at the regions: where authored normals differ or are missing, and at sharp angles.

    Angles are those of (vertices, 3) positions in bind space.
    """
    members = members_of(regions, len(surface.triangles))
    faces = np.flatnonzero(two_rings(members, surface.triangles, len(surface.positions)))
    edges, hard, _ = _hard_among(surface, positions, faces)
    of_regions = [distinct_values(edges.of_faces[children(faces, region.members)]) for region in regions]
    shares = np.array([hard[each].mean() for each in of_regions])
    for number in np.flatnonzero(shares > FACETED):
        hard[of_regions[number]] = True
    return HardEdges(edges.vertices[hard], shares)


def hard_inside(surface: Surface, positions: Floats, region: Region) -> float:
    """The fraction of the edges inside a region that are hard; at its border, where effects have faded, none counts."""
    edges, hard, _ = _hard_among(surface, positions, distinct_values(region.members))
    inside = hard[edges.counts > 1]
    return float(inside.sum()) / max(len(inside), 1)


def bends(surface: Surface, positions: Floats) -> tuple[Floats, Floats]:
    """The bend of the surface at its edges, each its angle times its length: at hard ones, and at all.

    A smooth surface bends at soft edges, a faceted one and a box at hard ones alone.

    Args:
        surface: The mesh.
        positions: (vertices, 3) bind space.

    Returns:
        (vertices,) sums over the edges of each vertex, twice.
    """
    edges, hard, cosines = _hard_among(surface, positions, np.arange(len(surface.triangles)), CREASE)
    ends = edges.vertices[edges.pairs]
    lengths = np.linalg.norm(positions[ends[:, 1]] - positions[ends[:, 0]], axis=1)
    bent = np.arccos(np.clip(cosines, -1.0, 1.0)) * lengths
    count = len(positions)
    at_hard, at_all = (
        np.asarray(np.bincount(ends.reshape(-1), np.repeat(each, 2), count), np.float64)
        for each in (bent * hard[edges.pairs], bent)
    )
    return at_hard, at_all


def _hard_among(surface: Surface, positions: Floats, faces: Ints, sharp: float = SHARP) -> tuple[Edges, Bools, Floats]:
    """The edges of some faces, (edges,) True for those that are hard, and (pairs,) cosines between two faces.

    An edge with one normal on both sides is hard if its cosine is below `sharp`.
    """
    triangles = surface.triangles[faces]
    edges = Edges.of(triangles)
    hard = np.zeros(len(edges.vertices), np.bool_)

    authored = unit(surface.normals[surface.corners[faces]])
    without = ~authored.any(axis=2)
    hard[edges.of_faces[without | np.roll(without, -1, axis=1)]] = True
    flat = unit(face_normals(positions, triangles))
    cosines = edges.way * np.sum(flat[edges.one // 3] * flat[edges.other // 3], axis=1)
    hard[edges.pairs] |= (cosines < sharp) | normals_differ(authored, edges)
    return edges, hard, cosines


def normals_differ(authored: Floats, edges: Edges) -> Bools:
    """(pairs,) True for edges of two faces whose (faces, 3, 3) authored unit normals differ at one end or both."""
    at_starts, at_ends = authored.reshape(-1, 3), np.roll(authored, -1, axis=1).reshape(-1, 3)
    differ = np.zeros(len(edges.pairs), np.bool_)
    # As a rule the two sides run in opposite ways.
    for here, there in ((at_starts, at_ends), (at_ends, at_starts)):
        across = np.where(edges.way[:, None] > 0, there[edges.other], here[edges.other])
        differ |= np.sum(here[edges.one] * across, axis=1) < _SAME_NORMAL
    return differ


@dataclass(frozen=True, slots=True)
class Rounded:
    """The placed vertices of a refined surface, bind space.

    Attributes:
        positions: (vertices, 3) stored positions.
        morph_deltas: (morph targets, vertices, 3).
        departures: (regions,) greatest distance of a region's new vertices from the coarse surface, over the greatest
            displacement there.
    """

    positions: Floats
    morph_deltas: Floats
    departures: Floats


@dataclass(frozen=True, slots=True)
class LaidSurface:
    """The coarse surface at the new vertices of a subdivision, in a pose in which regions are laid.

    Attributes:
        places: (new vertices, 3) world space.
        normals: (new vertices, 3) unit normals; they are right on these regions alone.
    """

    pose: Rest
    places: Floats
    normals: Floats


def rounded(
    surface: Surface,
    subdivision: Subdivision,
    regions: Sequence[Region],
    *,
    blended: Floats,
    laid: Sequence[LaidSurface],
    at_rest: Floats,
    full: bool,
) -> Rounded:
    """Place the vertices of a subdivision, with the whole offset if `full`.

    (morph targets,) `at_rest` are the weights of the rest pose. `blended` are (new vertices, 3, 4) matrices from bind
    to world space at rest. `laid` has the coarse surface in each pose of regions.
    """
    old = len(surface.positions)
    places, deltas = subdivision.interpolate(surface.positions), subdivision.interpolate(surface.morph_deltas)
    if subdivision.matrix is subdivision.linear:
        return Rounded(places, deltas, np.zeros(len(regions)))
    smooth = subdivision.positions(surface.positions)
    normals, heights = _heights(places, smooth, subdivision.triangles, old)
    heights_rest = np.abs(heights) * np.linalg.norm(np.einsum("vij,vj->vi", blended[:, :, :3], normals), axis=1)

    shares, tallest = np.full(len(heights), 1.0 if full else 0.0), np.zeros(len(heights))
    of_deltas = shares.copy()
    on_regions = []
    for region in regions:
        vertices = distinct_values(subdivision.triangles[children(subdivision.parents, region.members)])
        vertices = vertices[vertices >= old]
        on_regions.append(vertices - old)
        (there,) = (each for each in laid if each.pose is region.pose)
        here = there.places[vertices - old]
        u, v = region.coordinates(here)
        share = region.presence(u, v, region.cosines(u, there.normals[vertices - old]))
        left = region.left(subdivision, vertices, here)
        if left is not None:
            share = left * share
        whole = np.rint(smoothstep(np.minimum(share / _WHOLE, 1.0)) / _STEP) * _STEP
        of_deltas[vertices - old] = np.maximum(of_deltas[vertices - old], whole)
        # The offset grows like the height at first, and towards its bound in the end.
        share = share * bounded(heights_rest[vertices - old] / (_MOST * region.nominal_height))
        share = np.rint(share / _STEP) * _STEP
        shares[vertices - old] = np.maximum(shares[vertices - old], share)
        tallest[vertices - old] = np.maximum(tallest[vertices - old], region.greatest_height)

    places[old:] = smooth[old:] if full else places[old:] + (shares * heights)[:, None] * normals
    of_targets = np.where((at_rest == 0.0)[:, None], of_deltas, shares)
    deltas[:, old:] += of_targets[..., None] * (subdivision.positions(surface.morph_deltas) - deltas)[:, old:]
    departures = [(shares * heights_rest)[each] / tallest[each] for each in on_regions]
    return Rounded(places, deltas, np.array([each.max(initial=0.0) for each in departures]))


def _heights(places: Floats, smooth: Floats, triangles: Ints, old: int) -> tuple[Floats, Floats]:
    """(new vertices, 3) unit normals of the coarse surface, and (new vertices,) heights of the smooth surface above it.

    The normal is that of the face in the middle of a coarse face, and the mean of both faces' on an edge. A vertex goes
    along the normal to the plane that touches the smooth surface at the vertex's place there; a line to the vertex on
    the smooth surface itself would lean. `places` and `smooth` are (vertices, 3), the `old` coarse vertices first, on
    the coarse and on the smooth surface.
    """
    new = np.arange(old, len(places))
    normals, smooth_normals = normals_at(places, triangles, new), normals_at(smooth, triangles, new)
    cosines = np.maximum(np.sum(normals * smooth_normals, axis=1), _LEAST_COSINE)
    heights: Floats = np.sum((smooth - places)[old:] * smooth_normals, axis=1) / cosines
    return normals, heights
