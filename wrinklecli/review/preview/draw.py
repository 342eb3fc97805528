"""Lines drawn over a surface in a picture: rectangles, segments and ends of tools, and the triangles' edges."""

from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints
from wrinklecli.review.preview.camera import project
from wrinklecli.review.preview.rays import unit_rows

# Half the width of a crest's line, pixels, and how opaque it is.
_CREST, _CREST_SHOWN = 1.2, 0.6
INK = np.array((0.05, 0.07, 0.12), np.float32)  # of wires, sRGB


@dataclass(frozen=True, slots=True)
class Mark:
    """A rectangle drawn on the surface, with a segment from one end to the other along its middle.

    Attributes:
        name: Of the tool.
        triangles: (triangles,) those that it may lie on, rising.
        inside: (triangles,) those that the rectangle may cover; on others only its ends show.
        places: (triangles, 3, 2) of their corners, along the segment and across it, scene units.
        span: Length of the segment, scene units.
        half_width: Of the rectangle, scene units.
        colour: sRGB.
        tint: How opaque its inside is.
        phases: (triangles, 3) of their corners among the tool's bumps: k + 1/2 on the crest of bump k. NaN where no
            wrinkle shows; None where no crests are drawn.
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


@dataclass(frozen=True, slots=True)
class SeenMark:
    """A mark as a camera sees it.

    Attributes:
        mark: In the scene.
        rows: (all triangles,) into those of the mark; -1 elsewhere.
        rates: (triangles, 2) how fast its places change, along and across, over a pixel.
        pixels: (triangles, 2, 2) pixels for each unit along and across.
        passing: (triangles,) how fast its phases change over a pixel; NaN where no crest is drawn.
    """

    mark: Mark
    rows: Ints
    rates: Array
    pixels: Array
    passing: Array


def seen_mark(mark: Mark, local: Floats, size: tuple[int, int], tangent: float) -> SeenMark:
    """A mark on (triangles, 3, 3) corners in a camera's axes, over its reach."""
    rows = np.full(len(local), -1, np.intp)
    rows[mark.triangles] = np.arange(len(mark.triangles))
    shown, placed = (
        np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        for corners in (project(local[mark.triangles], size, tangent), mark.places)
    )
    rates = np.sqrt(np.sum((placed @ _inverses(shown)) ** 2, axis=2))
    passing = np.full(len(rates), np.nan)
    if mark.phases is not None:
        steps = mark.phases[:, 1:] - mark.phases[:, :1]
        passing = np.sqrt(np.sum((steps[:, None] @ _inverses(shown))[:, 0] ** 2, axis=1))
    return SeenMark(mark, rows, np.maximum(rates, 1e-30), shown @ _inverses(placed), passing)


def _inverses(matrices: Array) -> Array:
    """(n, 2, 2) inverses; where there is none, as of a triangle seen edge-on, something huge."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    determinants = a * d - b * c
    least = 1e-9 * np.abs(matrices).max(axis=(1, 2), initial=0.0) ** 2 + 1e-30
    safe = np.where(np.abs(determinants) > least, determinants, least)
    inverses: Array = np.stack([np.stack([d, -b], 1), np.stack([-c, a], 1)], 1) / safe[:, None, None]
    return inverses


def blend(colours: Array, opacities: Array, ink: Array, rows: Ints | slice = slice(None)) -> None:
    """Lay an ink over some colours, in place."""
    colours[rows] += opacities[:, None] * (ink - colours[rows])


def edge_cover(projected: Array, places: Array, found: Ints) -> Array:
    """How much of each sub-pixel an edge of its triangle covers, 0 to 1; lines are as thin as a pixel.

    Args:
        projected: (triangles, 3, 2) corners, sub-pixels.
        places: (hits, 2) middles of the sub-pixels.
        found: (hits,) their triangles.
    """
    nearest = np.full(len(found), np.inf, np.float32)
    for i in range(3):
        along = unit_rows(projected[:, (i + 1) % 3] - projected[:, i])[found]
        offsets = places - projected[found, i]
        nearest = np.minimum(nearest, np.abs(offsets[:, 0] * along[:, 1] - offsets[:, 1] * along[:, 0]))
    covered: Array = np.clip(np.float32(1.4) - nearest, 0, 1)
    return covered


def draw_mark(colours: Array, drawn: SeenMark, found: Ints, weights: Array) -> None:
    """Draw a mark, in place: a tint, an outline, its crests, and a segment from a dot where it begins to a ring.

    Args:
        colours: (hits, 3) sRGB.
        drawn: The mark.
        found: (hits,) their triangles.
        weights: (hits, 3) barycentric.
    """
    mark = drawn.mark
    rows = drawn.rows[found]
    here = np.flatnonzero(rows >= 0)
    rows = rows[here]
    places = np.einsum("pi,pia->pa", weights[here], mark.places[rows])
    # Distances in pixels: lines are as wide on a slope as on the level.
    along, across = places[:, 0], np.abs(places[:, 1])
    by_along, by_across = drawn.rates[rows].T
    depth = np.minimum(np.minimum(along, mark.span - along) / by_along, (mark.half_width - across) / by_across)
    beside = np.maximum(across / by_across, np.maximum(-along, along - mark.span) / by_along)
    start, end = (
        np.sqrt(np.sum(np.einsum("pab,pb->pa", drawn.pixels[rows], places - (x, 0.0)) ** 2, axis=1))
        for x in (0.0, mark.span)
    )
    tint = np.where(depth > 0, mark.tint, 0.0)
    lines = np.maximum(0.8 * np.clip(1.2 - np.abs(depth), 0, 1), np.clip(1.7 - beside, 0, 1))
    if mark.phases is not None:
        phases = np.einsum("pi,pi->p", weights[here], mark.phases[rows])
        off = np.abs(phases - np.floor(phases) - 0.5) / np.maximum(drawn.passing[rows], 1e-30)
        crests = np.where((depth > 0) & (off < _CREST), _CREST_SHOWN * np.minimum(_CREST - off, 1.0), 0.0)
        lines = np.maximum(lines, crests)
    # A ring surrounds nothing but the surface.
    covered = np.where(mark.inside[rows], np.where(end < 3.0, tint, np.maximum(tint, lines)), 0.0)
    ends = np.maximum(np.clip(5.0 - start, 0, 1), np.clip(1.8 - np.abs(end - 4.2), 0, 1))
    covered = np.maximum(covered, ends).astype(np.float32)
    blend(colours, covered, np.array(mark.colour, np.float32), here)
