"""Small pictures of a place without and with wrinkles, drawn by a depth buffer, and how much of the wrinkles shows.

`review.preview` draws with rays, which need an optional library; a tool is looked at wherever the program runs.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints, face_normals, runs, unit, vertex_normals
from wrinklecli.review.preview.sides import UNSEEN, Place, Side, best_light, best_side
from wrinklecli.review.suggest.stage import StagedTool
from wrinklecli.surface.strain import tangents

# Pixels along a picture's side: a place that is drawn as large as on a sheet of `preview --review`.
SIDE = 160
# Pixels along the side of the pictures by which the side to look from is chosen.
_COARSE = 32
# Factor of a picture's reach round a place: what is beside it shows where it is.
_MARGIN = 1.15
# Cosine between normal and view down to which a surface that falls away within a pixel does not hide itself.
_STEEPEST = 0.2
# Strips in which crests are looked at, side by side across a tool; a crest is at least as long as one.
_STRIPS = 3
# Greatest |v| in them; beyond, wrinkles fade.
_WITHIN = 0.75
# Steps across a bump in which the light is alike: eight for either flank, as large as a pixel or two.
_STEPS = 16
# Pixels in a step from which its mean counts.
_FEWEST = 3
# Part of the steps of a strip that must be seen.
_LEAST_KNOWN = 0.25
# Shares of the key light, of the fill light at the camera, and of the sky in the light of a review.
_KEY, _FILL, _SKY = 0.75, 0.25, 0.14
# Distance between points of a cloud over a pixel of a coarse picture, so that it has no holes.
_DENSE = 0.6
# Inverse of the golden ratio, whose multiples spread points evenly.
_GOLDEN = 0.6180339887498949
# Greatest number of pixels that are tested at once; bounds the memory.
_AT_ONCE = 2**21


@dataclass(frozen=True, slots=True)
class Seen:
    """The sight of a place.

    Attributes:
        side: From which it is seen, and how much of the wrinkles is visible from there.
        crests: What one sees of its crests.
        shown: (pixels,) triangles that are seen with wrinkles at pixels of the place.
        pictures: (2, side, side) lightness without and with wrinkles; 0 where nothing is.
    """

    side: Side
    crests: "Crests"
    shown: Ints
    pictures: Floats


@dataclass(frozen=True, slots=True)
class Crests:
    """The change of lightness that wrinkles make at a place, over the lightness.

    Crests are bands across the tool, light on one side and dark on the other. Lumps, specks and a step at the border
    of a place change the light as much, but not along the crests.

    Attributes:
        contrast: The part that is alike along the crests and alternates across them, root mean square.
        share: Square of that part over the square of all that changes within the place.
    """

    contrast: float
    share: float

    @classmethod
    def of(cls, changes: Floats, us: Floats, vs: Floats, bumps: int) -> "Crests":
        """Measure (pixels,) changes of lightness at places us along the curve of the wrinkles and vs across it."""
        inside = np.abs(vs) < _WITHIN
        changes, us, vs = changes[inside], us[inside], vs[inside]
        steps = _STEPS * bumps
        columns = np.clip((us * steps).astype(np.intp), 0, steps - 1)
        strips = np.clip(((vs / _WITHIN + 1.0) * (_STRIPS / 2.0)).astype(np.intp), 0, _STRIPS - 1)
        along, whole = 0.0, 0.0
        for strip in range(_STRIPS):
            here = strips == strip
            counts = np.bincount(columns[here], minlength=steps)
            known = counts >= _FEWEST
            here &= known[columns]
            if known.sum() < _LEAST_KNOWN * steps:
                continue
            counts = counts[known]
            means = np.bincount(columns[here], changes[here], steps)[known] / counts
            # A step or a slope in the light over a strip of several crests is none of them.
            line = np.polynomial.Polynomial.fit(np.flatnonzero(known), means, min(bumps - 1, 1), w=np.sqrt(counts))
            means_at = np.zeros(steps)
            means_at[known] = means
            beside = float(np.sum((changes[here] - means_at[columns[here]]) ** 2))
            crests = float(counts @ (means - line(np.flatnonzero(known))) ** 2)
            along, whole = along + crests, whole + crests + beside
        count = max(int(np.count_nonzero(inside)), 1)
        return cls(float(np.sqrt(along / count)), along / whole if whole > 0 else 0.0)


@dataclass(frozen=True, slots=True)
class Sight:
    """A place, and what may hide it.

    Attributes:
        place: Some of its triangles.
        reach: Distance from its middle that a picture shows, scene units.
        cloud: (points, 3) float32, on all that is near, with wrinkles, as dense as the pixels of a coarse picture.
    """

    place: Place
    reach: float
    cloud: Array

    @classmethod
    def of(cls, staged: StagedTool) -> "Sight":
        """Prepare to look at a tool from many sides."""
        faces = staged.triangles[staged.place]
        place = Place.of(staged.plain[faces], staged.wrinkled[faces])
        corners = staged.wrinkled[faces].reshape(-1, 3)
        reach = _MARGIN * float(np.sqrt(np.max(np.sum((corners - place.centre) ** 2, axis=1))))
        cloud = _spread(staged.wrinkled, staged.triangles, _DENSE * 2.0 * reach / _COARSE)
        return cls(place, reach, cloud.astype(np.float32))

    @property
    def best_side(self) -> Side:
        """The side to look from."""
        return best_side(self.place, self.free)

    def free(self, directions: Floats) -> Bools:
        """(directions, points) True for points of the place that nothing hides from (directions, 3)."""
        place = self.place
        return np.array([self.seen(place.points, place.normals, each) for each in directions])

    def seen(self, points: Floats, normals: Floats, direction: Floats) -> Bools:
        """(points,) True for (points, 3) of a surface that nothing of the cloud hides from (3,) a direction."""
        axes = _axes(direction)
        depths = np.full(_COARSE**2, -np.inf, np.float32)
        pixels, deep = self._pixels(self.cloud, axes)
        np.maximum.at(depths, pixels, deep)
        pixels, deep = self._pixels(points, axes)
        cosines = normals @ direction
        falls = np.sqrt(np.maximum(1.0 - cosines**2, 0.0)) / np.maximum(cosines, _STEEPEST)
        seen: Bools = (deep > depths[pixels] - (1.0 + falls) * (2.0 / _COARSE)) & (cosines > 0)
        return seen

    def _pixels(self, points: Array, axes: Floats) -> tuple[Ints, Array]:
        """The pixels of (points, 3) in a coarse picture, and their depths; those beside it are at its border."""
        local = points @ (axes.T / self.reach).astype(points.dtype)
        local -= (axes @ self.place.centre / self.reach).astype(points.dtype)
        columns, rows = np.clip((local[:, :2].T + 1) * (_COARSE // 2), 0, _COARSE - 1).astype(np.intp)
        return rows * _COARSE + columns, local[:, 2]


def _axes(back: Floats) -> Floats:
    """(3, 3) axes of a camera that looks against (3,) a unit direction: right, up and backwards."""
    right, up = (each[0] for each in tangents(back[None]))
    return np.stack([right, up, back])


def _spread(positions: Floats, triangles: Ints, apart: float) -> Floats:
    """(points, 3) spread evenly over triangles, about `apart` from each other."""
    areas = np.linalg.norm(face_normals(positions, triangles), axis=1) / 2.0
    # The rest of each triangle's number is carried on to the next, so that small ones have a point together.
    counts = np.diff(np.floor(np.cumsum(areas / apart**2)), prepend=0.0).astype(np.intp)
    own = np.repeat(np.arange(len(triangles)), counts)
    numbers = runs(np.zeros(len(triangles), np.intp), counts)
    first, second = ((numbers + 0.5) / counts[own]), (_GOLDEN * (numbers + 1)) % 1.0
    # The square root makes points as dense near one corner as elsewhere.
    root = np.sqrt(first)
    shares = np.stack([1.0 - root, root * (1.0 - second), root * second], axis=1)
    points: Floats = np.einsum("pk,pka->pa", shares, positions[triangles[own]])
    return points


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

    def interpolate(self, values: Floats, triangles: Ints) -> Floats:
        """(side, side, k) values at the pixels, of (vertices, k) ones on the (triangles, 3) that are drawn."""
        found: Floats = np.einsum("yxk,yxka->yxa", self.shares, values[triangles[self.numbers]])
        return found


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


def look_at(staged: StagedTool, sight: Sight, side: Side) -> Seen:
    """Look at a tool from a side, in the light in which a review shows it."""
    axes, place = side.axes, sight.place
    key = best_light(place, axes, sight.free) @ axes
    drawn = [
        _draw(_local(positions, place.centre, axes, sight.reach), staged.triangles, SIDE) for positions in staged.poses
    ]
    normals = [_normals(staged, positions, each, axes[2]) for positions, each in zip(staged.poses, drawn, strict=True)]
    # Shadows of the body are the same without and with wrinkles.
    lit = _softened(sight, staged.wrinkled[staged.triangles], drawn[1], normals[1], key)
    pictures = np.zeros((2, SIDE, SIDE))
    taken = np.zeros((2, SIDE, SIDE), np.bool_)
    for number, (each, towards) in enumerate(zip(drawn, normals, strict=True)):
        hit = each.numbers >= 0
        light = _KEY * lit * np.maximum(towards @ key, 0.0) + _FILL * (towards @ axes[2]) + _SKY
        pictures[number, hit] = light[hit]
        taken[number, hit] = staged.place[each.numbers[hit]]
    wrinkled, there = drawn[1], taken[1]
    crests = Crests(0.0, 0.0)
    both = taken[0] & taken[1]
    if both.any():
        before, after = pictures[:, both]
        us, vs = wrinkled.interpolate(staged.places, staged.triangles)[both].T
        known = np.isfinite(us)
        changes = (after - before) / np.maximum(before, before.mean())
        crests = Crests.of(changes[known], us[known], vs[known], staged.bumps)
    # What hides a place may lie so near to it that its points seemed visible.
    return Seen(side if there.any() else UNSEEN, crests, wrinkled.numbers[there], pictures)


def _softened(sight: Sight, corners: Floats, drawn: _Drawn, normals: Floats, key: Floats) -> Floats:
    """(side, side) part of the key light that reaches each pixel, blurred to the size of a coarse pixel."""
    hit = drawn.numbers >= 0
    points = np.einsum("pk,pka->pa", drawn.shares[hit], corners[drawn.numbers[hit]])
    lit = np.zeros((SIDE, SIDE))
    # What faces away from the light is dark anyway, and its neighbours are not in its shade.
    lit[hit] = sight.seen(points, normals[hit], key) | (normals[hit] @ key <= 0.0)
    blurred, counts = (
        uniform_filter(each, 2 * SIDE // _COARSE + 1, mode="constant") for each in (lit, hit.astype(float))
    )
    soft: Floats = blurred / np.maximum(counts, 1e-9)
    return soft


def _normals(staged: StagedTool, positions: Floats, drawn: _Drawn, towards: Floats) -> Floats:
    """(side, side, 3) unit normals of what is drawn, on the side of (3,) the view; 0 where nothing is."""
    normals = np.zeros((SIDE, SIDE, 3))
    hit = drawn.numbers >= 0
    if staged.shaded_flat:
        found = unit(face_normals(positions, staged.triangles[drawn.numbers[hit]]))
    else:
        found = unit(drawn.interpolate(vertex_normals(positions, staged.triangles), staged.triangles)[hit])
    normals[hit] = found * np.where(found @ towards < 0, -1.0, 1.0)[:, None]
    return normals
