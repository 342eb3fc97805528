"""Small pictures of a place without and with wrinkles, drawn by a depth buffer, and how much of the wrinkles shows.

`review.preview` draws with rays, which need an optional library; a tool is looked at wherever the program runs.
"""

import numpy as np
from scipy.ndimage import uniform_filter

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Array,
    Bools,
    Floats,
    Ints,
    any_of,
    dot,
    face_normals,
    runs,
    unit,
    vertex_normals,
)
from wrinklecli.numeric.cells import Cells
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
# Least area of a triangle that is drawn, pixels: others are seen from the side, and lie between two pixels.
_LEAST_AREA = 1e-9
# Rows of pixels, of all triangles, that are drawn at once: a cache holds their numbers.
_ROWS = 2**14


@dataclass(frozen=True, slots=True)
class Seen:
    """The sight of a place.

    Attributes:
        side: From which it is seen, and how much of the wrinkles is visible from there.
        crests: What one sees of its crests.
        shown: (pixels,) triangles that are seen with wrinkles at pixels of the place.
        pictures: (2, side, side) lightness without and with wrinkles; 0 where nothing is.
        rounding: Change of lightness that refinement alone makes at the place, over the lightness, root mean square.
    """

    side: Side
    crests: "Crests"
    shown: Ints
    pictures: Floats
    rounding: float


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
        cloud: (points, 3) float32, on all that is near, with wrinkles, as dense as the pixels of a coarse picture, in
            units of the reach from the middle of the place.
        cells: The cells of a grid in which the points lie.
    """

    place: Place
    reach: float
    cloud: Array
    cells: Cells

    @classmethod
    def of(cls, staged: StagedTool) -> "Sight":
        """Prepare to look at a tool from many sides."""
        faces = staged.triangles[staged.place]
        place = Place.of(staged.plain[faces], staged.wrinkled[faces])
        corners = staged.wrinkled[faces].reshape(-1, 3)
        reach = _MARGIN * float(np.sqrt(np.max(np.sum((corners - place.centre) ** 2, axis=1))))
        cloud = _spread(staged.wrinkled, staged.triangles, _DENSE * 2.0 * reach / _COARSE)
        cloud = ((cloud - place.centre) / reach).astype(np.float32)
        cells = Cells.of(cloud)
        return cls(place, reach, cloud[cells.numbers], cells)

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
        axes = _axes(direction).astype(np.float32)
        places = ((points - self.place.centre) / self.reach).astype(np.float32) @ axes.T
        cosines = normals @ direction
        behind = float(places[:, 2].min(initial=np.inf))
        depths = np.full((_COARSE + 2) ** 2, -np.inf, np.float32)
        cloud = self._in_front(axes, behind) @ axes.T
        np.maximum.at(depths, _pixels(cloud), cloud[:, 2])
        falls = np.sqrt(np.maximum(1.0 - cosines**2, 0.0)) / np.maximum(cosines, _STEEPEST)
        seen: Bools = (places[:, 2] > depths[_pixels(places)] - (1.0 + falls) * (2.0 / _COARSE)) & (cosines > 0)
        return seen

    def _in_front(self, axes: Array, depth: float) -> Array:
        """(points, 3) of the cloud that may lie in the picture of (3, 3) axes, nearer to the eye than a depth."""
        low, high = self.cells.low, self.cells.high
        middles, halves = (low + high) / 2.0 @ axes.T, (high - low) / 2.0 @ np.abs(axes).T
        least = np.array([-1.0, -1.0, depth]) - halves
        # Column by column, as numpy is slow to reduce rows of three.
        a, b, c = (middles >= least).T
        d, e = (middles[:, :2] <= 1.0 + halves[:, :2]).T
        chosen = np.flatnonzero(a & b & c & d & e)
        return self.cloud[runs(self.cells.starts[chosen], self.cells.counts[chosen])]


def _pixels(local: Array) -> Ints:
    """(points,) pixels, of a coarse picture with a border for what is beside it, of (points, 3) along its axes."""
    columns, rows = np.clip((local[:, :2].T + 1.0) * (_COARSE // 2) + 1.0, 0.0, _COARSE + 1).astype(np.intp)
    pixels: Ints = rows * (_COARSE + 2) + columns
    return pixels


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


def _places(positions: Floats, centre: Floats, axes: Floats, reach: float) -> Floats:
    """(3, vertices) column, row and depth in a picture of (vertices, 3); the middle of a pixel is a whole number."""
    places = (axes / reach) @ (positions - centre).T
    places[:2] = (places[:2] + 1.0) * (SIDE / 2.0) - 0.5
    return places


@dataclass(frozen=True, slots=True)
class _Drawn:
    """A picture.

    Attributes:
        numbers: (side, side) of triangles; -1 where nothing is.
        shares: (side, side, 3) of the triangle's corners.
    """

    numbers: Ints
    shares: Floats

    def interpolate(self, values: Floats, triangles: Ints, chosen: Bools) -> Floats:
        """(pixels, k) values at the chosen pixels, of (vertices, k) ones on the (triangles, 3) that are drawn."""
        found: Floats = np.einsum("pk,pka->pa", self.shares[chosen], values[triangles[self.numbers[chosen]]])
        return found


@dataclass(frozen=True, slots=True)
class _DepthBuffer:
    """The triangles that are seen at the pixels of a picture.

    Attributes:
        depths: (pixels,) towards the eye; -inf where nothing is.
        numbers: (pixels,) of triangles; -1 where nothing is.
    """

    depths: Floats
    numbers: Ints

    @classmethod
    def empty(cls) -> "_DepthBuffer":
        """A buffer without triangles."""
        return cls(np.full(SIDE * SIDE, -np.inf), np.full(SIDE * SIDE, -1))

    def drawn(self, places: Floats, triangles: Ints, chosen: Bools) -> "_DepthBuffer":
        """Draw (triangles,) chosen ones of (triangles, 3), whose vertices have (3, vertices) places, into a copy."""
        found = _DepthBuffer(self.depths.copy(), self.numbers.copy())
        kept = np.flatnonzero(chosen)
        (ax, bx, cx), (ay, by, cy) = (axis[triangles[kept]].T for axis in places[:2])
        # The rows and columns of pixels whose middles are in the box round each triangle.
        left, right = (np.ceil(each(each(ax, bx), cx)) for each in (np.minimum, np.maximum))
        low, high = (np.ceil(each(each(ay, by), cy)) for each in (np.minimum, np.maximum))
        low, high = (np.clip(each, 0, SIDE).astype(np.intp) for each in (low, high))
        wide = np.abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) > _LEAST_AREA
        met = np.flatnonzero(wide & (high > low) & (right > left) & (right > 0) & (left < SIDE))
        kept, low, counts = kept[met], low[met], (high - low)[met]
        parts = np.searchsorted(np.cumsum(counts), np.arange(_ROWS, int(counts.sum()), _ROWS))
        for some in zip(*(np.split(each, parts) for each in (kept, low, counts)), strict=True):
            found._add(places, triangles, *some)
        return found

    def _add(self, places: Floats, triangles: Ints, chosen: Ints, low: Ints, counts: Ints) -> None:
        """Draw chosen triangles into this buffer, each in so many rows of pixels from the lowest one."""
        own, rows = np.repeat(chosen, counts), runs(low, counts)
        starts, steps = _shares(places, triangles[own], np.zeros(len(own)), rows)
        # A pixel is within the triangle where no share is negative.
        with np.errstate(all="ignore"):
            borders = -starts / steps
        first = np.where(steps > 0, borders, np.where((steps == 0) & (starts < 0), np.inf, -np.inf)).max(axis=0)
        last = np.where(steps < 0, borders, np.inf).min(axis=0)
        first, last = np.ceil(np.clip(first, 0, SIDE)), np.floor(np.clip(last, -1, SIDE - 1))
        widths = np.maximum(last - first + 1, 0).astype(np.intp)
        columns, pixel_rows = runs(first.astype(np.intp), widths), np.repeat(rows, widths)
        corners = places[2][triangles[own]].T
        depths = np.repeat(dot(starts, corners), widths) + np.repeat(dot(steps, corners), widths) * columns
        pixels = pixel_rows * SIDE + columns
        np.maximum.at(self.depths, pixels, depths)
        seen = np.flatnonzero(depths == self.depths[pixels])
        self.numbers[pixels[seen]] = np.repeat(own, widths)[seen]

    def picture(self, places: Floats, triangles: Ints) -> _Drawn:
        """The picture of (triangles, 3) that were drawn, whose vertices have (3, vertices) places."""
        shares = np.zeros((SIDE * SIDE, 3))
        hit = np.flatnonzero(self.numbers >= 0)
        rows, columns = np.divmod(hit, SIDE)
        shares[hit] = _shares(places, triangles[self.numbers[hit]], columns, rows)[0].T
        return _Drawn(self.numbers.reshape(SIDE, SIDE), shares.reshape(SIDE, SIDE, 3))


def _shares(places: Floats, corners: Ints, columns: Array, rows: Ints) -> tuple[Floats, Floats]:
    """Shares of a triangle's corners at a pixel, and what they grow by from one column to the next, both (3, pixels).

    Args:
        places: (3, vertices) in the picture.
        corners: (pixels, 3) vertices of a triangle.
        columns: (pixels,)
        rows: (pixels,)
    """
    (ax, bx, cx), (ay, by, cy) = (axis[corners].T for axis in places[:2])
    ax, bx, cx = ax - columns, bx - columns, cx - columns
    ay, by, cy = ay - rows, by - rows, cy - rows
    scale = 1.0 / ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    first, second = (bx * cy - by * cx) * scale, (cx * ay - cy * ax) * scale
    step, other = (by - cy) * scale, (cy - ay) * scale
    return np.stack([first, second, 1.0 - first - second]), np.stack([step, other, -step - other])


def look_at(staged: StagedTool, sight: Sight, side: Side) -> Seen:
    """Look at a tool from a side, in the light in which a review shows it."""
    axes, place = side.axes, sight.place
    key = best_light(place, axes, sight.free) @ axes
    triangles = staged.triangles
    places = [_places(positions, place.centre, axes, sight.reach) for positions in staged.states]
    coarse, plain, wrinkled = staged.states
    moved = any_of((coarse != plain).any(axis=1) | (plain != wrinkled).any(axis=1), triangles)
    still = _DepthBuffer.empty().drawn(places[1], triangles, ~moved)
    drawn = [still.drawn(each, triangles, moved).picture(each, triangles) for each in places]
    shading = (staged.flat_normals, vertex_normals(plain, triangles), vertex_normals(wrinkled, triangles))
    normals = [
        _normals(staged, each, picture, axes[2], smooth)
        for each, picture, smooth in zip(staged.states, drawn, shading, strict=True)
    ]
    # Shadows of the body are the same without and with wrinkles.
    lit = _softened(sight, wrinkled[triangles], drawn[2], normals[2], key)
    pictures = np.zeros((3, SIDE, SIDE))
    taken = np.zeros((3, SIDE, SIDE), np.bool_)
    for number, (each, towards) in enumerate(zip(drawn, normals, strict=True)):
        hit = each.numbers >= 0
        light = _KEY * lit * np.maximum(towards @ key, 0.0) + _FILL * (towards @ axes[2]) + _SKY
        pictures[number, hit] = light[hit]
        taken[number, hit] = staged.place[each.numbers[hit]]
    there = taken[2]
    crests, rounding = Crests(0.0, 0.0), 0.0
    both = taken[1] & taken[2]
    if both.any():
        us, vs = drawn[2].interpolate(staged.places, triangles, both).T
        known = np.isfinite(us)
        changes = _changes(*pictures[1:, both])
        crests = Crests.of(changes[known], us[known], vs[known], staged.bumps)
        if (taken[0] & both).any():
            rounding = float(np.sqrt(np.mean(_changes(*pictures[:2, taken[0] & both]) ** 2)))
    # What hides a place may lie so near to it that its points seemed visible.
    return Seen(side if there.any() else UNSEEN, crests, drawn[2].numbers[there], pictures[1:], rounding)


def _changes(before: Floats, after: Floats) -> Floats:
    """(pixels,) changes of lightness over the lightness before; deep shade counts as the mean."""
    changes: Floats = (after - before) / np.maximum(before, before.mean())
    return changes


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


def _normals(staged: StagedTool, positions: Floats, drawn: _Drawn, towards: Floats, smooth: Floats) -> Floats:
    """(side, side, 3) unit normals of what is drawn, on the side of (3,) the view; 0 where nothing is.

    `smooth` are (vertices, 3) normals of smooth shading.
    """
    normals = np.zeros((SIDE, SIDE, 3))
    hit = drawn.numbers >= 0
    if staged.shaded_flat:
        found = unit(face_normals(positions, staged.triangles[drawn.numbers[hit]]))
    else:
        found = unit(drawn.interpolate(smooth, staged.triangles, hit))
    normals[hit] = found * np.where(found @ towards < 0, -1.0, 1.0)[:, None]
    return normals
