"""A field on the refined surface: the displacements of its shapes, in bind space."""

import numpy as np

from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.effects.field.factors import seen_of
from wrinklecli.effects.field.heights import NEAR
from wrinklecli.effects.field.lowering import lowering
from wrinklecli.effects.field.material import Fabric
from wrinklecli.effects.field.stripes import Sides, phases
from wrinklecli.effects.shapes import Middles
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    TINY,
    Floats,
    Ints,
    distinct_values,
    weighted_quantiles,
)
from wrinklecli.numeric.laplacian import Average, Sheet
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement

# Part of the greatest height below which a place has no phase.
_LEAST = 0.01
# Half height over the wavelength from which on a fold is seen well: later fields leave it alone.
_SEEN = 0.04
# Length of ψ below which waves level out: beside it, crests run on.
_STRAIGHT = 0.9
# Waves along a side of a triangle that shows them, and the quantile of a field's sides that are usual beyond that, as
# in a draft.
_SHORT_ENOUGH, _USUAL = 0.25, 0.75
# Waves along a side from crest to furrow.
_LONGEST = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """A field on the refined surface.

    Attributes:
        deltas: (shapes, vertices, 3) at weight 1, bind space.
        middles: Those of edges, beyond the mean of their ends.
        shares: (vertices,) from 0 to 1, how much of the surface later fields leave to it.
        remaining: The greatest height over that without tools and earlier fields.
    """

    deltas: Floats
    middles: Middles
    shares: Floats
    remaining: float


def displaced(attached: AttachedField, fine: Refinement, free: Floats, shown: Ground | None = None) -> Displacements:
    """Carry a field to the refined surface, of which tools leave it (fine vertices,) parts from 0 to 1.

    It is lowered below layers over the mesh that is `shown`, and where it would be at fault, in bends and clips. In a
    sketch, for which none is, it is not: lowering takes several times as long as all else.
    """
    shapes, region = attached.factors.shapes, attached.region
    count = len(shapes)
    carried = [shapes, region.directions.T, region.slants, region.leads, region.wavelengths]
    values = fine.subdivision.interpolate(np.vstack(carried).T)
    greatest = values[:, :count].max(axis=1)
    faces = fine.triangles[(greatest[fine.triangles] > _LEAST * greatest.max()).any(axis=1)]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    vertices = distinct_values(faces)
    values, shares = values[vertices], greatest[vertices] / greatest.max()
    positions, normals = fine.rest_positions[vertices], fine.rest_normals_at(vertices)
    sheet = Sheet.of(positions, np.searchsorted(vertices, faces))
    # Linear mixtures of coarse values have creases.
    average = sheet.averaging(NEAR * attached.wavelength)
    heights = average.of(values[:, :count])
    tallest = max(float(heights.max(initial=0.0)), TINY)
    heights = seen_of(heights) * (free[vertices] * np.minimum(shares / _LEAST, 1.0))[:, None]
    remaining = float(heights.max(initial=0.0)) / tallest
    covered = np.zeros(len(free))
    covered[vertices] = np.minimum(heights.max(axis=1) / (_SEEN * values[:, -1]), 1.0)
    waves = _waves(attached, sheet, average, normals, values[:, count:], shares)
    outward = fine.raising_at(vertices)
    if shown is not None:
        whole, ways = np.zeros((count, len(free))), np.zeros(fine.positions.shape)
        whole[:, vertices], ways[vertices] = heights.T, waves.heights[:, None] * outward
        heights = lowering(attached, shown, fine, whole, ways)[:, vertices].T
    a, b = waves.sides.T
    bent = (waves.middles - (waves.heights[a] + waves.heights[b]) / 2.0)[:, None] * (heights[a] + heights[b]) / 2.0
    found = np.zeros((count, len(fine.positions), 3))
    found[:, vertices] = (heights * waves.heights[:, None]).T[:, :, None] * outward
    edges = Middles.numbers_of(vertices[waves.sides], fine)
    middles = Middles(edges, bent.T[:, :, None] * (outward[a] + outward[b]) / 2.0)
    return Displacements(found, middles, covered, remaining)


def _waves(
    attached: AttachedField, sheet: Sheet, average: Average, normals: Floats, values: Floats, shares: Floats
) -> "_Waves":
    """The waves of a field.

    Args:
        attached: The field.
        sheet: The refined surface at rest.
        average: Over `NEAR` of it.
        normals: (vertices, 3) of it.
        values: (vertices, 9) directions, slants and leads of `Heights`, and wavelengths.
        shares: (vertices,) parts of the greatest height.
    """
    fabric, places, irregular = attached.fabric, sheet.positions, attached.region.irregular
    lines, longer, higher, agreed = irregular.crests(places, normals, values[:, :6], *values[:, 6:8].T)
    wavelengths, trust = values[:, 8] * longer, np.clip(shares, 0.0, 1.0)

    def families(broader: Floats | float) -> tuple[list[Sides], Floats]:
        found = [
            Sides.of(places, sheet.triangles, normals, own, broader * lengths)
            for own, lengths in zip(lines, wavelengths, strict=True)
        ]
        return found, np.max([sides.waves for sides in found], axis=0)

    every, waves = families(1.0)
    ends = every[0].ends
    # One broad fold where sides are too long for more, and none where even it would become knobs.
    broader = sheet.averaging(attached.wavelength / 2.0).of(_lengths(ends, waves, sheet))
    every, waves = families(broader)
    shown = np.clip(average.of(np.clip(2.0 - _lengths(ends, waves, sheet), 0.0, 1.0)), 0.0, 1.0)
    at_vertices, at_middles = [], []
    for sides, uneven in zip(every, shown / broader * higher, strict=True):
        psi = phases(sides, places, sheet.triangles, trust, attached.wavelength, seed=irregular.seed)
        # No direction is right where lines turn at once.
        psi *= agreed[:, None]
        at_vertices.append(uneven * _height(fabric, psi))
        at_middles.append(uneven[ends].mean(axis=1) * _height(fabric, sides.middles(psi)))
    heights, middles = fabric.higher(*at_vertices), fabric.higher(*at_middles)
    # A side from crest to furrow says nothing of what is between: its middle is then halfway.
    straight = heights[ends].mean(axis=1)
    told = np.clip((_LONGEST - waves) / (_LONGEST - _SHORT_ENOUGH), 0.0, 1.0)
    return _Waves(heights, ends, straight + told * (middles - straight))


def _lengths(ends: Ints, waves: Floats, sheet: Sheet) -> Floats:
    """(vertices,) waves along the longest side over those that show them, 1 at least.

    Refinement splits no side whose middle would need too many joints, as in a groin. `ends` are (sides, 2) vertices,
    `waves` (sides,) of each.
    """
    longest = np.zeros(len(sheet.positions))
    np.maximum.at(longest, ends, waves[:, None])
    usual = max(float(weighted_quantiles(longest, sheet.areas, np.array([_USUAL]))[0]), _SHORT_ENOUGH)
    return np.maximum(longest / usual, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Waves:
    """Heights of waves over the half height: at (vertices,) and at the middles of (sides, 2) sides."""

    heights: Floats
    sides: Ints
    middles: Floats


def _height(fabric: Fabric, psi: Floats) -> Floats:
    """(n,) heights of waves over the half height, at (n, 2) ψ; level with their mean at forks."""
    length = np.linalg.norm(psi, axis=1)
    waves = fabric.wave(psi[:, 0] / np.where(length > 0, length, 1.0))
    level = np.clip(length / _STRAIGHT, 0.0, 1.0)
    return np.asarray(level * waves + (1.0 - level) * fabric.mean)
