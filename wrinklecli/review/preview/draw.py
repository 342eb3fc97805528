"""Draw tools (patches, crests, segments, outlines) and the triangles' edges on a surface in a picture."""

from dataclasses import replace
from typing import TypeAlias

import numpy as np

from wrinklecli.character.paints import Colour
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints, places_of
from wrinklecli.review.preview.camera import project
from wrinklecli.review.preview.rays import unit_rows

# Half the width of a crest's line, pixels.
_CREST = 1.2
# Opacity of a crest's line.
_CREST_OPACITY = 0.6
# Half the width of an outline, pixels.
_OUTLINE = 1.2
# Half the width of a segment, pixels.
_SEGMENT = 1.7
# Opacity of an outline.
_OUTLINE_OPACITY = 0.8
# Radius of the dot at the origin, pixels.
_DOT = 5.0
# Radius of the ring around the target, pixels.
_RING = 4.2
# Half the width of its line, pixels.
_RING_LINE = 1.8
# Radius inside which no line is drawn, pixels.
_RING_INSIDE = 3.0
# Least value of a length that is divided by: any float32 above 0.
_TINY = 1e-30


@dataclass(frozen=True, slots=True)
class Mark:
    """A tool's patch on the surface: a rectangle with a segment along its middle.

    Attributes:
        name: The tool's name.
        triangles: (triangles,) sorted numbers of those that it may lie on.
        inside: (triangles,) True for those that the rectangle may cover; on others only its ends show.
        places: (triangles, 3, 2) places of their corners along the segment and across it, scene units.
        span: Length of the segment, scene units.
        half_width: Half the width of the rectangle, scene units.
        colour: sRGB.
        tint: Opacity of its inside.
        phases: (triangles, 3) places of their corners among the tool's bumps: k + 1/2 on the crest of bump k. NaN where
            no wrinkle shows; None to draw no crests.
    """

    name: str
    triangles: Ints
    inside: Bools
    places: Floats
    span: float
    half_width: float
    colour: tuple[float, float, float]
    tint: float = 0.1
    phases: Floats | None = None

    def rewound(self) -> "Mark":
        """The same for triangles whose corners are the other way round."""
        phases = None if self.phases is None else self.phases[:, ::-1]
        return replace(self, places=self.places[:, ::-1], phases=phases)


@dataclass(frozen=True, slots=True)
class Outline:
    """A line round the skin that a muscle, a region of flesh or a touch moves; what is not said is as in `Mark`.

    Attributes:
        depths: (triangles, 3) how far inside it their corners are, in any unit; 0 on it.
    """

    name: str
    triangles: Ints
    depths: Floats
    colour: tuple[float, float, float]
    tint: float = 0.1

    def rewound(self) -> "Outline":
        """The same for triangles whose corners are the other way round."""
        return replace(self, depths=self.depths[:, ::-1])


AnyMark: TypeAlias = Mark | Outline


@dataclass(frozen=True, slots=True)
class ProjectedMark:
    """A mark as a camera sees it.

    Attributes:
        rows: (all triangles,) rows of the mark's triangles; -1 for others.
        rates: (triangles, 2) change of its places, along and across, over a pixel.
        pixels: (triangles, 2, 2) pixels for each unit along and across.
        phase_rates: (triangles,) change of its phases over a pixel; NaN where no crest is drawn.
    """

    mark: Mark
    rows: Ints
    rates: Array
    pixels: Array
    phase_rates: Array

    def covered(self, rows: Ints, weights: Array) -> Array:
        """(hits,) opacities of a tint, an outline, crests, and a segment from a dot to a ring."""
        mark = self.mark
        places = np.einsum("pi,pia->pa", weights, mark.places[rows])
        # Distances are pixels, so that lines on a slope are not narrower.
        along, across = places[:, 0], np.abs(places[:, 1])
        by_along, by_across = self.rates[rows].T
        depth = np.minimum(np.minimum(along, mark.span - along) / by_along, (mark.half_width - across) / by_across)
        beside = np.maximum(across / by_across, np.maximum(-along, along - mark.span) / by_along)
        start, end = (
            np.sqrt(np.sum(np.einsum("pab,pb->pa", self.pixels[rows], places - (x, 0.0)) ** 2, axis=1))
            for x in (0.0, mark.span)
        )
        tint = np.where(depth > 0, mark.tint, 0.0)
        lines = np.maximum(_outline(depth), np.clip(_SEGMENT - beside, 0, 1))
        if mark.phases is not None:
            phases = np.einsum("pi,pi->p", weights, mark.phases[rows])
            off = np.abs(phases - np.floor(phases) - 0.5) / self.phase_rates[rows]
            crests = np.where((depth > 0) & (off < _CREST), _CREST_OPACITY * np.minimum(_CREST - off, 1.0), 0.0)
            lines = np.maximum(lines, crests)
        # Inside the ring only the surface shows.
        covered = np.where(mark.inside[rows], np.where(end < _RING_INSIDE, tint, np.maximum(tint, lines)), 0.0)
        ends = np.maximum(np.clip(_DOT - start, 0, 1), np.clip(_RING_LINE - np.abs(end - _RING), 0, 1))
        return np.asarray(np.maximum(covered, ends))


@dataclass(frozen=True, slots=True)
class ProjectedOutline:
    """An outline as a camera sees it.

    Attributes:
        rows: (all triangles,) rows of the outline's triangles; -1 for others.
        rates: (triangles,) change of its depths over a pixel.
    """

    mark: Outline
    rows: Ints
    rates: Array

    def covered(self, rows: Ints, weights: Array) -> Array:
        """(hits,) opacities of a tint and an outline."""
        depth = np.einsum("pi,pi->p", weights, self.mark.depths[rows]) / self.rates[rows]
        return np.asarray(np.maximum(np.where(depth > 0, self.mark.tint, 0.0), _outline(depth)))


def project_mark(
    mark: AnyMark, local: Floats, size: tuple[int, int], tangent: float
) -> ProjectedMark | ProjectedOutline:
    """Project a mark on (triangles, 3, 3) corners in camera space."""
    rows = places_of(mark.triangles, len(local), -1)
    shown = _edges(project(local[mark.triangles], size, tangent))
    if isinstance(mark, Outline):
        return ProjectedOutline(mark, rows, _rates(mark.depths, shown))
    rates = np.stack([_rates(mark.places[:, :, axis], shown) for axis in (0, 1)], axis=1)
    phase_rates = np.full(len(rates), np.nan) if mark.phases is None else _rates(mark.phases, shown)
    return ProjectedMark(mark, rows, rates, shown @ _inverses(_edges(mark.places)), phase_rates)


def _edges(corners: Floats) -> Array:
    """(triangles, 2, 2) two edges of triangles as columns, from (triangles, 3, 2) corners."""
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)


def _rates(values: Floats, shown: Array) -> Array:
    """(triangles,) change over a pixel of (triangles, 3) values at corners, by (triangles, 2, 2) edges in pixels."""
    steps = values[:, 1:] - values[:, :1]
    return np.asarray(np.maximum(np.sqrt(np.sum((steps[:, None] @ _inverses(shown))[:, 0] ** 2, axis=1)), _TINY))


def _inverses(matrices: Array) -> Array:
    """(n, 2, 2) inverses; huge numbers for singular matrices, such as those of triangles seen edge-on."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    determinants = a * d - b * c
    least = 1e-9 * np.abs(matrices).max(axis=(1, 2), initial=0.0) ** 2 + _TINY
    safe = np.where(np.abs(determinants) > least, determinants, least)
    return np.asarray(np.stack([np.stack([d, -b], 1), np.stack([-c, a], 1)], 1) / safe[:, None, None])


def blend(colours: Array, opacities: Array, ink: Colour, rows: Ints | slice = slice(None)) -> None:
    """Blend an ink over some colours, in place."""
    colours[rows] += opacities[:, None] * (np.array(ink, np.float32) - colours[rows])


def edge_cover(projected: Array, places: Array, triangles: Ints) -> Array:
    """(hits,) part of each sub-pixel that an edge of its triangle covers, 0 to 1; lines are a pixel wide.

    `projected` are the (triangles, 3, 2) corners and `places` the (hits, 2) middles of the sub-pixels, in sub-pixels.
    """
    nearest = np.full(len(triangles), np.inf, np.float32)
    for i in range(3):
        along = unit_rows(projected[:, (i + 1) % 3] - projected[:, i])[triangles]
        offsets = places - projected[triangles, i]
        nearest = np.minimum(nearest, np.abs(offsets[:, 0] * along[:, 1] - offsets[:, 1] * along[:, 0]))
    return np.asarray(np.clip(np.float32(1.4) - nearest, 0, 1))


def draw_mark(colours: Array, drawn: ProjectedMark | ProjectedOutline, triangles: Ints, weights: Array) -> None:
    """Draw a mark on (hits, 3) sRGB colours, in place.

    `triangles` and `weights` are the triangles and barycentric coordinates of the hits.
    """
    rows = drawn.rows[triangles]
    here = np.flatnonzero(rows >= 0)
    covered = drawn.covered(rows[here], weights[here]).astype(np.float32)
    blend(colours, covered, drawn.mark.colour, here)


def _outline(depth: Array) -> Array:
    """(hits,) opacities of a line where a depth in pixels is 0."""
    return np.asarray(_OUTLINE_OPACITY * np.clip(_OUTLINE - np.abs(depth), 0, 1))
