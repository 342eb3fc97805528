"""Small pictures of a place without and with wrinkles, drawn by a depth buffer, and how much of the wrinkles shows.

`review.preview` draws with rays, which need an optional library; a tool is looked at wherever the program runs.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, face_normals, runs, unit, vertex_normals
from wrinklecli.review.suggest.stage import StagedTool
from wrinklecli.surface.strain import tangents

# Pixels along a picture's side: a place that is drawn as large as on a sheet of `preview --review`.
SIDE = 160
# Pixels along the side of the pictures by which the side to look from is chosen.
_COARSE = 48
# Points of a place by which these sides are judged.
_JUDGED = 400
# Angle between the normal of a place and the further views that are tried, degrees.
_TILT = 40.0
# Number of these views.
_AROUND = 8
# Factor of a picture's reach round a place: what is beside it shows where it is.
_MARGIN = 1.15
# Depth over a picture's reach by which a point may lie behind what is drawn and still count as visible: a pixel of the
# coarse picture is 1/24 of the reach, and a surface seen at 60° falls by nearly twice that across it.
_NEAR = 0.06
# Cosine between normal and view above which a point counts fully; as in the views of a preview.
_FACES = 0.7
# Angle between the light and the view, degrees: light that rakes over a surface shows its relief best.
_RAKING = 55.0
# Part of the light that comes from everywhere.
_AMBIENT = 0.25
# Greatest number of pixels that are tested at once; bounds the memory.
_AT_ONCE = 2**21


@dataclass(frozen=True, slots=True)
class Seen:
    """The sight of a place.

    Attributes:
        visible: Part of the wrinkles that nothing hides, from the best side.
        contrasts: (pixels,) change of lightness at all pixels of the place, over the lightness that the plain place has
            there, or over its mean in the shade.
        shown: (pixels,) triangles that are seen with wrinkles at pixels of the place.
        pictures: (2, 2, side, side) lightness without and with wrinkles, in either light; 0 where nothing is.
    """

    visible: float
    contrasts: Floats
    shown: Ints
    pictures: Floats


def look_at(staged: StagedTool) -> Seen:
    """Look at a tool from the side that shows most of its wrinkles, in light that rakes along the tool."""
    faces = staged.triangles[staged.place]
    heights = np.linalg.norm(staged.wrinkled - staged.plain, axis=1)
    points = staged.wrinkled[faces].mean(axis=1)
    crossed = face_normals(staged.wrinkled, faces)
    weights = heights[faces].mean(axis=1) * np.linalg.norm(crossed, axis=1)
    normals = unit(crossed)
    centre = weights @ points / weights.sum()
    reach = _MARGIN * float(np.sqrt(np.max(np.sum((points - centre) ** 2, axis=1))))
    # Wrinkles are at a few thousand places; some of them tell how many are visible.
    some = np.arange(len(points))[:: -(-len(points) // _JUDGED)]
    best = _View(-1.0, np.eye(3))
    for axes in _cameras(unit(weights @ normals)):
        drawn = _draw(_local(staged.wrinkled, centre, axes, reach), staged.triangles, _COARSE)
        local = _local(points[some], centre, axes, reach)
        columns, rows = np.clip(((local[:, :2] + 1.0) * (_COARSE / 2.0)).astype(np.intp), 0, _COARSE - 1).T
        cosines = normals[some] @ axes[2]
        free = (local[:, 2] > drawn.depths[rows, columns] - _NEAR) & (cosines > 0)
        score = float(weights[some] @ (free * np.minimum(cosines, _FACES)))
        if score > best.score:
            best = _View(score, axes)
    visible = best.score / (_FACES * float(weights[some].sum()))
    return _compared(staged, centre, best.axes, reach, visible)


@dataclass(frozen=True, slots=True)
class _View:
    """The score of a camera and its (3, 3) axes: right, up, and backwards."""

    score: float
    axes: Floats


def _cameras(normal: Floats) -> Iterator[Floats]:
    """(3, 3) axes of cameras around a place with (3,) a normal: right, up and backwards."""
    right, up = (each[0] for each in tangents(normal[None]))
    yield np.stack([right, up, normal])
    tilt = np.radians(_TILT)
    for angle in 2 * np.pi * np.arange(_AROUND) / _AROUND:
        back = np.cos(tilt) * normal + np.sin(tilt) * (np.cos(angle) * right + np.sin(angle) * up)
        one, other = (each[0] for each in tangents(back[None]))
        yield np.stack([one, other, back])


def _local(corners: Floats, centre: Floats, axes: Floats, reach: float) -> Floats:
    """(…, 3) points in camera space, where the picture reaches from -1 to 1."""
    local: Floats = (corners - centre) @ (axes.T / reach)
    return local


@dataclass(frozen=True, slots=True)
class _Drawn:
    """A picture.

    Attributes:
        depths: (side, side) towards the eye; -inf where nothing is.
        numbers: (side, side) of triangles; -1 where nothing is.
        shares: (side, side, 3) of the triangle's corners.
    """

    depths: Floats
    numbers: Ints
    shares: Floats


def _draw(local: Floats, triangles: Ints, side: int) -> _Drawn:
    """Draw (triangles, 3) of (vertices, 3) in camera space into a depth buffer."""
    depths, numbers = np.full(side * side, -np.inf), np.full(side * side, -1)
    shares = np.zeros((side * side, 3))
    places = (local[:, :2] + 1.0) * (side / 2.0)
    x, y = (places[:, k][triangles].T for k in (0, 1))
    # The pixels whose middles are in the box round each triangle.
    left, right = (np.clip(np.ceil(each - 0.5), 0, side).astype(np.intp) for each in (x.min(axis=0), x.max(axis=0)))
    low, high = (np.clip(np.ceil(each - 0.5), 0, side).astype(np.intp) for each in (y.min(axis=0), y.max(axis=0)))
    doubled = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    drawn = np.flatnonzero((right > left) & (high > low) & (doubled != 0))
    counts = ((right - left) * (high - low))[drawn]
    parts = np.searchsorted(np.cumsum(counts), np.arange(_AT_ONCE, int(counts.sum()), _AT_ONCE))
    for some, many in zip(np.split(drawn, parts), np.split(counts, parts), strict=True):
        own = np.repeat(some, many)
        rows, columns = np.divmod(runs(np.zeros(len(some), np.intp), many), np.repeat((right - left)[some], many))
        rows, columns = rows + low[own], columns + left[own]
        (ax, bx, cx), (ay, by, cy) = x[:, own] - (columns + 0.5), y[:, own] - (rows + 0.5)
        first, second = (bx * cy - by * cx) / doubled[own], (cx * ay - cy * ax) / doubled[own]
        third = 1.0 - first - second
        inside = np.flatnonzero((first >= 0) & (second >= 0) & (third >= 0))
        of_corners = np.stack([first[inside], second[inside], third[inside]], axis=1)
        own, pixels = own[inside], (rows * side + columns)[inside]
        deep = np.sum(of_corners * local[:, 2][triangles[own]], axis=1)
        order = np.argsort(deep, kind="stable")
        order = order[deep[order] > depths[pixels[order]]]
        # Of several at one pixel the last one stays, which is the nearest to the eye.
        depths[pixels[order]], numbers[pixels[order]], shares[pixels[order]] = (
            deep[order],
            own[order],
            of_corners[order],
        )
    return _Drawn(depths.reshape(side, side), numbers.reshape(side, side), shares.reshape(side, side, 3))


def _compared(staged: StagedTool, centre: Floats, axes: Floats, reach: float, visible: float) -> Seen:
    """Draw a tool without and with wrinkles, in light from either of its ends, and compare."""
    across = unit(staged.along - (staged.along @ axes[2]) * axes[2])
    slant = np.radians(_RAKING)
    lights = np.stack([np.cos(slant) * axes[2] + sign * np.sin(slant) * across for sign in (1.0, -1.0)])
    pictures, there, shown = [], np.zeros((SIDE, SIDE), np.bool_), np.zeros(0, np.intp)
    for positions in (staged.plain, staged.wrinkled):
        drawn = _draw(_local(positions, centre, axes, reach), staged.triangles, SIDE)
        hit = drawn.numbers >= 0
        numbers = drawn.numbers[hit]
        normals = _normals(staged, positions, numbers, drawn.shares[hit])
        normals *= np.where(normals @ axes[2] < 0, -1.0, 1.0)[:, None]
        picture = np.zeros((2, SIDE, SIDE))
        picture[:, hit] = _AMBIENT + (1.0 - _AMBIENT) * np.maximum(lights @ normals.T, 0.0)
        pictures.append(picture)
        there[hit] |= staged.place[numbers]
        shown = numbers[staged.place[numbers]]
    if not there.any():
        # What hides the place lies so near to it that points of the place seemed visible.
        return Seen(0.0, np.zeros(1), shown, np.stack(pictures))
    before, after = (picture[:, there] for picture in pictures)
    contrasts = (np.abs(after - before) / np.maximum(before, before.mean())).max(axis=0)
    return Seen(visible, contrasts, shown, np.stack(pictures))


def _normals(staged: StagedTool, positions: Floats, numbers: Ints, shares: Floats) -> Floats:
    """(pixels, 3) unit normals at places on triangles of these numbers."""
    if staged.shaded_flat:
        return unit(face_normals(positions, staged.triangles[numbers]))
    corners = vertex_normals(positions, staged.triangles)[staged.triangles[numbers]]
    return unit(np.einsum("pk,pka->pa", shares, corners))
