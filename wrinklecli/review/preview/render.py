"""Triangles to a picture, by rays: no display, no graphics card.

A raking key light with soft shadows, a fill light and ambient occlusion show relief. The same triangles give the same
picture: rays follow fixed patterns.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from wrinklecli.numeric.arrays import unit

Floats = NDArray[Any]  # float64 for geometry, float32 for rays and light
Ints = NDArray[np.intp]
Bytes = NDArray[np.uint8]

TANGENT = float(np.tan(np.radians(12.0)))  # of half the vertical field of view: a long lens, little distortion
PAPER = (0.93, 0.94, 0.95)  # background, sRGB

_SAMPLES = 2  # per axis of a pixel: primary rays, where one is not enough
# Neighbours per axis that deal out a set of light rays among them; a box filter of this size joins it again.
_PATTERN = 4
_AMBIENT_RAYS = 8  # per pixel: 128 after the filter
_SHADOW_RAYS = 4
_BAND = 2**16  # pixels at a time: caches hold their arrays, and memory does not grow with the picture
# Neighbours that differ by more are sampled more finely: depth over half the picture's height, cosine of normals.
_STEP, _CREASE = np.float32(0.03), np.float32(0.94)
# Camera axes: right, up, backwards.
_KEY = np.array((-0.62, 0.62, 0.48), np.float32)
_FILL = np.array((0.75, 0.05, 0.65), np.float32)
_LIGHTS = np.array([(0.78, 0.75, 0.72), (0.126, 0.133, 0.14), (0.228, 0.235, 0.24)], np.float32)  # key, fill, sky
_SOFTNESS = np.float32(0.12)  # radius of the key light at unit distance
_SHINE = 0.10
_CLAY = 0.62  # linear grey
_ALBEDO = np.float32(0.9)  # of a base colour of 1: nothing real reflects all
_BACKFACE = (0.9, 0.03, 0.02)  # linear RGB
_INK = np.array((0.05, 0.07, 0.12), np.float32)  # of wires, sRGB
_LIFT = np.float32(2e-4)  # above the surface, over half the picture's height: where light rays start
_FAR = np.float32(1.2)  # occluders count up to here, over half the picture's height
_GOLDEN = 0.6180339887498949
_PLASTIC = 0.7548776662466927  # goes with the golden ratio as that with whole numbers: no pattern with it
_LEVELS = np.linspace(0, 1, 1 << 14, dtype=np.float32)  # sRGB by table: a power for each pixel takes 0.2 s
_ENCODED = np.where(_LEVELS < 0.0031308, 12.92 * _LEVELS, 1.055 * _LEVELS ** np.float32(1 / 2.4) - 0.055)
_CODES = np.arange(256) / 255.0
_DECODED = np.where(_CODES < 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Texture:
    """An image that colours a surface.

    Attributes:
        pixels: (height, width, 3) sRGB.
        wraps: How it goes on beyond [0, 1], across and down: repeat, mirror or clamp.
    """

    pixels: Bytes
    wraps: tuple[str, str] = ("repeat", "repeat")


@dataclass(frozen=True, slots=True)
class Mark:
    """A rectangle drawn on the surface, with a segment from one end to the other along its middle.

    Attributes:
        triangles: (triangles,) those that it may lie on, rising.
        inside: (triangles,) those that the rectangle may cover; on others only its ends show.
        places: (triangles, 3, 2) of their corners, along the segment and across it, scene units.
        span: Length of the segment, scene units.
        half_width: Of the rectangle, scene units.
        colour: sRGB.
        tint: How opaque its inside is.
    """

    triangles: Ints
    inside: NDArray[np.bool_]
    places: Floats
    span: float
    half_width: float
    colour: tuple[float, float, float]
    tint: float = 0.1


@dataclass(frozen=True, slots=True)
class Frame:
    """What there is to see: triangles without any order, world space, scene units.

    Attributes:
        corners: (triangles, 3, 3) positions.
        normals: (triangles, 3, 3) unit normals of the corners.
        colours: (triangles, 3, 3) base colours of the corners, linear RGB.
        coordinates: (triangles, 3, 2) of the corners in their texture.
        textures: (triangles,) into `images`; -1 for none.
        images: The textures, which multiply the colours.
        marks: To draw on it.
    """

    corners: Floats
    normals: Floats
    colours: Floats
    coordinates: Floats
    textures: Ints
    images: tuple[Texture, ...] = ()
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True, slots=True)
class Style:
    """How to draw.

    Attributes:
        wire: The triangles' edges too.
        clay: Grey, whatever the colours.
        backfaces: Triangles that are seen from behind in red.
    """

    wire: bool = False
    clay: bool = False
    backfaces: bool = False


@dataclass(frozen=True, slots=True)
class Camera:
    """A perspective camera that looks at a point.

    Attributes:
        centre: (3,) what it looks at, world space.
        axes: (3, 3) rows: right, up, and backwards (from the centre to the eye).
        reach: Half the height of what it sees at its centre, scene units.
    """

    centre: Floats
    axes: Floats
    reach: float

    @classmethod
    def framing(cls, points: Floats, axes: Floats, *, aspect: float, margin: float = 1.12) -> "Camera":
        """Sees all points, as close as that allows.

        Args:
            points: (n, 3) world space.
            axes: (3, 3) see `facing`.
            aspect: Width over height of the picture.
            margin: Of the distance.
        """
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        local = (points - middle) @ axes.T
        aim = (local.min(axis=0) + local.max(axis=0)) / 2
        aim[2] = 0.0
        local = local - aim
        depths = local[:, 2] * TANGENT
        reach = max(
            float((np.abs(local[:, 1]) + depths).max()),
            float((np.abs(local[:, 0]) / aspect + depths).max()),
        )
        return cls(middle + aim @ axes, axes, margin * reach)

    def project(self, points: Floats, size: tuple[int, int]) -> Floats:
        """(…, 2) pixels, from the left and the top, of (…, 3) world positions in front of the eye."""
        return _project(self.local(points), size[0], size[1])

    def local(self, points: Floats) -> Floats:
        """(…, 3) world positions in the camera's axes, about its centre, over its reach."""
        placed: Floats = (points - self.centre) @ self.axes.T / self.reach
        return placed


def facing(azimuth: float, elevation: float) -> Floats:
    """(3, 3) a camera's axes as rows: right, up, backwards.

    Args:
        azimuth: Degrees about +y; 0 sees an asset's front (from +z), 90 sees it from +x.
        elevation: Degrees above the horizon.
    """
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    right = np.array([np.cos(a), 0.0, -np.sin(a)])
    return np.array([right, np.cross(back, right), back])


def _project(local: Floats, width: int, height: int) -> Floats:
    depths = np.maximum(1 - TANGENT * local[..., 2:], 1e-9)
    flat = local[..., :2] * (1, -1) / depths
    projected: Floats = (flat + np.array((width / height, 1))) * (height / 2)
    return projected


@dataclass(frozen=True, slots=True)
class _Drawn:
    """A mark as a camera sees it.

    Attributes:
        mark: In the scene.
        rows: (all triangles,) into those of the mark; -1 elsewhere.
        rates: (triangles, 2) how fast its places change, along and across, over a pixel.
        pixels: (triangles, 2, 2) pixels for each unit along and across.
    """

    mark: Mark
    rows: Ints
    rates: Floats
    pixels: Floats


@dataclass(frozen=True, slots=True)
class _Scene:
    """A frame in a camera's axes, over its reach, float32; the eye is at (0, 0, 1 / TANGENT)."""

    rays: Any
    frame: Frame
    corners: Floats
    normals: Floats
    faces: Floats
    colours: Floats
    projected: Floats | None
    marks: tuple[_Drawn, ...]


def render(frame: Frame, camera: Camera, *, size: tuple[int, int] = (800, 600), style: Style | None = None) -> Bytes:
    """A picture of a frame: key light with soft shadow, fill light, ambient occlusion.

    Both sides of a triangle are shaded, its normals turned with it. Light rays start from the curved surface that the
    vertex normals suggest, so that coarse meshes get no false dark edges.

    Args:
        frame: The triangles.
        camera: Where from.
        size: Width and height, pixels.
        style: How.

    Returns:
        (height, width, 3) sRGB.
    """
    style = style or Style()
    width, height = size
    scene = _scene(frame, camera, size, style)
    shown = np.zeros((height, width, 3), np.uint8)
    rows = max(_BAND // width, 1)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        shown[top:bottom] = _band(scene, size, style, top, bottom)
    return shown


def _scene(frame: Frame, camera: Camera, size: tuple[int, int], style: Style) -> _Scene:
    local = camera.local(frame.corners)
    projected = None
    if style.wire:
        projected = _project(local, size[0] * _SAMPLES, size[1] * _SAMPLES).astype(np.float32)
    return _Scene(
        rays=_traced(local),
        frame=frame,
        corners=np.ascontiguousarray(local, np.float32),
        normals=(frame.normals @ camera.axes.T).astype(np.float32),
        faces=unit(np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 0])).astype(np.float32),
        colours=frame.colours.astype(np.float32),
        projected=projected,
        marks=tuple(_drawn(mark, local, size) for mark in frame.marks),
    )


def _traced(corners: Floats) -> Any:
    """What finds the triangles that rays hit."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=True)  # rays through a shared edge hit one triangle or the other
    TriangleMesh(scene, np.ascontiguousarray(corners, np.float32))
    return scene


def _drawn(mark: Mark, local: Floats, size: tuple[int, int]) -> _Drawn:
    rows = np.full(len(local), -1, np.intp)
    rows[mark.triangles] = np.arange(len(mark.triangles))
    shown, placed = (
        np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        for corners in (_project(local[mark.triangles], *size), mark.places)
    )
    rates = np.sqrt(np.sum((placed @ _inverses(shown)) ** 2, axis=2))
    return _Drawn(mark, rows, np.maximum(rates, 1e-30), shown @ _inverses(placed))


def _inverses(matrices: Floats) -> Floats:
    """(n, 2, 2) inverses; where there is none, as of a triangle seen edge-on, something huge."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    determinants = a * d - b * c
    least = 1e-9 * np.abs(matrices).max(axis=(1, 2), initial=0.0) ** 2 + 1e-30
    safe = np.where(np.abs(determinants) > least, determinants, least)
    inverses: Floats = np.stack([np.stack([d, -b], 1), np.stack([-c, a], 1)], 1) / safe[:, None, None]
    return inverses


@dataclass(frozen=True, slots=True)
class _Hits:
    """Where primary rays meet the scene.

    Attributes:
        pixels: (hits,) of a band, row after row.
        middles: (hits, 2) where the rays pass, pixels of the whole picture.
        shares: (hits,) of the pixel that each stands for.
        directions: (hits, 3) unit, from the eye.
        depths: (hits,) distance from the eye.
        found: (hits,) triangles.
        weights: (hits, 3) barycentric.
        sides: (hits, 1) -1 where the triangle is seen from behind, else 1.
        normals: (hits, 3) unit, towards the eye's side.
    """

    pixels: Ints
    middles: Floats
    shares: Floats
    directions: Floats
    depths: Floats
    found: Ints
    weights: Floats
    sides: Floats
    normals: Floats

    def only(self, chosen: NDArray[np.bool_]) -> "_Hits":
        """Some of them."""
        return _Hits(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def joined(self, others: "_Hits") -> "_Hits":
        """These and then others."""
        both = ((getattr(self, field.name), getattr(others, field.name)) for field in fields(self))
        return _Hits(*(np.concatenate(each) for each in both))


def _band(scene: _Scene, size: tuple[int, int], style: Style, top: int, bottom: int) -> Bytes:
    """(rows, width, 3) some rows of pixels, sRGB."""
    width, height = size
    # The filter that joins light rays looks beyond the band.
    first, last = max(top - _PATTERN, 0), min(bottom + _PATTERN, height)
    shape = (last - first, width)
    every = np.arange(shape[0] * width)
    hits = _hits(scene, size, first, every, np.zeros((1, 2)))
    uneven = _uneven(scene, hits, shape, style)
    offsets = (np.stack(np.divmod(np.arange(_SAMPLES**2), _SAMPLES), axis=1) + 0.5) / _SAMPLES - 0.5
    hits = hits.only(~uneven[hits.pixels]).joined(_hits(scene, size, first, np.flatnonzero(uneven), offsets))

    # One hit of each pixel speaks for it.
    firsts = np.full(len(every), -1, np.intp)
    firsts[hits.pixels[::-1]] = np.arange(len(hits.pixels))[::-1]
    whole = np.flatnonzero(firsts >= 0)
    sets = (whole // width + first) % _PATTERN * _PATTERN + whole % width % _PATTERN
    # Parallel rays in a row are a third faster, for what they find in the caches.
    order = np.argsort(sets, kind="stable")
    whole, sets = whole[order], sets[order]
    one = firsts[whole]
    starts = _starts(scene, hits.found[one], hits.weights[one], hits.sides[one])
    key, fill = _unit(_KEY[None]), _unit(_FILL[None])
    openness = _smooth(_openness(scene, starts, hits.normals[one], sets), whole, shape)[hits.pixels]
    lit = _smooth(_lit(scene, starts, hits.normals[one], sets, key), whole, shape)[hits.pixels]

    amounts = (
        lit * np.maximum(hits.normals @ key[0], 0),
        openness * np.maximum(hits.normals @ fill[0], 0),
        openness * (0.8 + 0.2 * hits.normals[:, 1]),
    )
    light = np.stack(amounts, axis=1) @ _LIGHTS
    gleam = np.maximum(np.einsum("pi,pi->p", hits.normals, _unit(key - hits.directions)), 0) ** 2
    shine = _SHINE * lit * (gleam * gleam * gleam) ** 4
    base = np.full_like(hits.normals, _CLAY)
    if not style.clay:
        base[:] = 0
        for i in range(3):
            base += _ALBEDO * hits.weights[:, i, None] * scene.colours[hits.found, i]
        _paint(scene.frame, base, hits.found, hits.weights)
    if style.backfaces:
        base[hits.sides[:, 0] < 0] = _BACKFACE
    colours = np.clip(base * light + shine[:, None], 0, 1)
    colours = _ENCODED[(colours * (len(_ENCODED) - 1) + 0.5).astype(np.intp)]
    if scene.projected is not None:
        _blend(colours, np.float32(0.75) * _edges(scene.projected, _SAMPLES * hits.middles, hits.found), _INK)
    for drawn in scene.marks:
        _draw(colours, drawn, hits.found, hits.weights)

    bare = 1 - np.bincount(hits.pixels, hits.shares, len(every))
    channels = [np.bincount(hits.pixels, hits.shares * colours[:, k], len(every)) + bare * PAPER[k] for k in range(3)]
    picture = np.stack(channels, axis=1).reshape(*shape, 3)[top - first : bottom - first]
    return np.asarray((255 * np.clip(picture, 0, 1) + 0.5).astype(np.uint8))


def _hits(scene: _Scene, size: tuple[int, int], first: int, pixels: Ints, offsets: Floats) -> _Hits:
    """Trace primary rays.

    Args:
        scene: The triangles.
        size: Of the picture.
        first: Row of the picture that the band begins with.
        pixels: (pixels,) of the band to trace.
        offsets: (rays, 2) of the rays of a pixel from its middle, down and across, pixels.
    """
    width, height = size
    down, across = np.divmod(np.repeat(pixels, len(offsets)), width)
    middles = np.stack([across, down + first], axis=1) + 0.5 + np.tile(offsets[:, ::-1], (len(pixels), 1))
    grid = np.full((len(middles), 3), -1, np.float32)
    grid[:, 0] = (middles[:, 0] * 2 / width - 1) * (TANGENT * width / height)
    grid[:, 1] = (1 - middles[:, 1] * 2 / height) * TANGENT
    directions = _unit(grid)
    eyes = np.zeros_like(directions)
    eyes[:, 2] = 1 / TANGENT
    traced = scene.rays.run(eyes, directions, output=True)
    hit = np.flatnonzero(traced["primID"] >= 0)
    found, directions = traced["primID"][hit].astype(np.intp), directions[hit]
    u, v = traced["u"][hit], traced["v"][hit]
    weights = np.stack([1 - u - v, u, v], axis=1)
    behind = np.einsum("pi,pi->p", scene.faces[found], directions) > 0
    sides = np.where(behind, np.float32(-1), np.float32(1))[:, None]
    normals = np.zeros_like(directions)
    for i in range(3):
        normals += weights[:, i, None] * scene.normals[found, i]
    return _Hits(
        pixels=np.repeat(pixels, len(offsets))[hit],
        middles=middles[hit].astype(np.float32),
        shares=np.full(len(hit), 1 / len(offsets), np.float32),
        directions=directions,
        depths=traced["tfar"][hit],
        found=found,
        weights=weights,
        sides=sides,
        normals=_unit(normals) * sides,
    )


def _uneven(scene: _Scene, hits: _Hits, shape: tuple[int, int], style: Style) -> NDArray[np.bool_]:
    """(pixels,) those that one ray does not do justice: at outlines and creases, or with texture, wires or marks."""
    seen = np.zeros(shape, bool)
    seen.ravel()[hits.pixels] = True
    if style.wire:
        fine = seen.copy()
    else:
        detailed = (scene.frame.textures[hits.found] >= 0) & (not style.clay)
        for drawn in scene.marks:
            detailed |= drawn.rows[hits.found] >= 0
        fine = np.zeros(shape, bool)
        fine.ravel()[hits.pixels] = detailed
    depths, normals = np.zeros(shape, np.float32), np.zeros((*shape, 3), np.float32)
    depths.ravel()[hits.pixels] = hits.depths
    normals.reshape(-1, 3)[hits.pixels] = hits.normals
    for axis in (0, 1):
        before, after = _neighbouring(axis)
        turned = np.einsum("yxa,yxa->yx", normals[before], normals[after])
        apart = (seen[before] != seen[after]) | (np.abs(depths[before] - depths[after]) > _STEP) | (turned < _CREASE)
        apart &= seen[before] | seen[after]
        fine[before] |= apart
        fine[after] |= apart
    return fine.ravel()


def _neighbouring(axis: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Places of a grid that have a neighbour after them, and these."""
    every, before, after = slice(None), slice(None, -1), slice(1, None)
    return ((before, every), (after, every)) if axis == 0 else ((every, before), (every, after))


def _starts(scene: _Scene, found: Ints, weights: Floats, sides: Floats) -> Floats:
    """(hits, 3) where light rays start: just above the curved surface that the vertex normals suggest.

    Args:
        scene: The triangles.
        found: (hits,) their triangles.
        weights: (hits, 3) barycentric.
        sides: (hits, 1) -1 where a triangle is seen from behind, else 1.

    Source: J. Hanika, Hacking the Shadow Terminator, Ray Tracing Gems II, 2021.
    """
    corners = scene.corners[found]
    points = np.einsum("pi,pia->pa", weights, corners)
    normals = scene.normals[found] * sides[..., None]
    below = np.minimum(np.einsum("pia,pia->pi", points[:, None] - corners, normals), 0)
    lifts = np.einsum("pi,pia->pa", weights * below, normals)
    starts: Floats = points - lifts + _LIFT * sides * scene.faces[found]
    return starts


def _openness(scene: _Scene, points: Floats, normals: Floats, sets: Ints) -> Floats:
    """(hits,) openness to the sky, 0 to 1: an occluder counts the less the further off it is.

    Args:
        scene: The triangles.
        points: (hits, 3) where rays start, just above the surface.
        normals: (hits, 3) unit.
        sets: (hits,) number of each hit's set of rays, 0 to PATTERN² - 1.
    """
    tangents, bitangents = _basis(normals)
    openness = np.zeros(len(points), np.float32)
    for disc in _discs(_AMBIENT_RAYS):
        x, y, square, length = disc[sets].T[..., None]
        directions = x * tangents
        directions += y * bitangents
        directions += np.sqrt(1 - square) * normals
        # Lengths are even from 0 to FAR: the share of rays that hit falls to 0 in a straight line.
        free = scene.rays.run(points, directions, dists=_FAR * length[:, 0], query="OCCLUDED") < 0
        openness += free / np.float32(_AMBIENT_RAYS)
    return openness


def _lit(scene: _Scene, points: Floats, normals: Floats, sets: Ints, key: Floats) -> Floats:
    """(hits,) how much of the key light, in direction (1, 3), is seen, 0 to 1; none from what faces away from it."""
    facing_it = np.flatnonzero(normals @ key[0] > 0)
    points, sets = points[facing_it], sets[facing_it]
    across = np.concatenate(_basis(key))
    free = np.zeros(len(points), np.float32)
    for disc in _discs(_SHADOW_RAYS):
        directions = (key + _SOFTNESS * (disc[:, :2] @ across))[sets]
        free += (scene.rays.run(points, directions, query="OCCLUDED") < 0) / np.float32(_SHADOW_RAYS)
    lit = np.zeros(len(normals), np.float32)
    lit[facing_it] = free
    return lit


def _smooth(values: Floats, places: Ints, shape: tuple[int, int]) -> Floats:
    """Join the ray sets of neighbours: a box filter of a grid, over the places that have a value; all places."""
    sums, counts = np.zeros((2, *shape), np.float32)
    sums.ravel()[places] = values
    counts.ravel()[places] = 1
    sums, counts = (uniform_filter(each, _PATTERN, mode="constant") for each in (sums, counts))
    smoothed: Floats = (sums / np.maximum(counts, 1e-6)).ravel()
    return smoothed


def _basis(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors across each normal, continuous but for one pole (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1), np.stack([b, sign + y * y * a, -y], 1)


def _discs(count: int) -> Floats:
    """Points spread evenly over the unit disc, (count, PATTERN², 4): x, y, the squared radius, a length of 0 to 1.

    Any one of the sets covers the disc, and all together cover it more finely (a golden-angle spiral, dealt
    out in turn).
    """
    numbers = np.arange(count * _PATTERN**2)
    squares = (numbers + 0.5) / len(numbers)
    angles = 2 * np.pi * _GOLDEN * numbers
    lengths = (_PLASTIC * numbers + 0.5) % 1
    radii = np.sqrt(squares)
    spiral = np.stack([radii * np.cos(angles), radii * np.sin(angles), squares, lengths], axis=1)
    return spiral.reshape(count, _PATTERN**2, 4).astype(np.float32)


def _paint(frame: Frame, base: Floats, found: Ints, weights: Floats) -> None:
    """Multiply the colours of hits by those of their textures, in place."""
    numbers = frame.textures[found]
    for number, texture in enumerate(frame.images):
        here = np.flatnonzero(numbers == number)
        if len(here):
            places = np.einsum("pi,pia->pa", weights[here], frame.coordinates[found[here]])
            base[here] *= _bilinear(texture, places)


def _bilinear(texture: Texture, places: Floats) -> Floats:
    """(places, 3) linear RGB of a texture at (places, 2) coordinates, mixed from the four nearest pixels."""
    rows, columns = texture.pixels.shape[:2]
    scaled = places * (columns, rows) - 0.5
    floor = np.floor(scaled)
    shares = (scaled - floor).astype(np.float32)
    mixed = np.zeros((len(places), 3), np.float32)
    for right, down, share in _neighbours(shares):
        x = _wrapped(floor[:, 0] + right, columns, texture.wraps[0])
        y = _wrapped(floor[:, 1] + down, rows, texture.wraps[1])
        mixed += share[:, None] * _DECODED[texture.pixels[y, x]]
    return mixed


def _neighbours(shares: Floats) -> Iterator[tuple[int, int, Floats]]:
    """The four pixels about a place, with their shares."""
    for right in (0, 1):
        for down in (0, 1):
            across = shares[:, 0] if right else 1 - shares[:, 0]
            yield right, down, across * (shares[:, 1] if down else 1 - shares[:, 1])


def _wrapped(indices: Floats, count: int, wrap: str) -> Ints:
    """Pixels that stand for those beyond the border."""
    if wrap == "clamp":
        inside = np.clip(indices, 0, count - 1)
    elif wrap == "repeat":
        inside = np.mod(indices, count)
    else:
        turned = np.mod(indices, 2 * count)
        inside = np.minimum(turned, 2 * count - 1 - turned)
    return np.asarray(inside, np.intp)


def _blend(colours: Floats, opacities: Floats, ink: Floats, rows: Ints | slice = slice(None)) -> None:
    """Lay an ink over some colours, in place."""
    colours[rows] += opacities[:, None] * (ink - colours[rows])


def _edges(projected: Floats, places: Floats, found: Ints) -> Floats:
    """How much of each sub-pixel an edge of its triangle covers, 0 to 1; lines are as thin as a pixel.

    Args:
        projected: (triangles, 3, 2) corners, sub-pixels.
        places: (hits, 2) middles of the sub-pixels.
        found: (hits,) their triangles.
    """
    nearest = np.full(len(found), np.inf, np.float32)
    for i in range(3):
        along = _unit(projected[:, (i + 1) % 3] - projected[:, i])[found]
        offsets = places - projected[found, i]
        nearest = np.minimum(nearest, np.abs(offsets[:, 0] * along[:, 1] - offsets[:, 1] * along[:, 0]))
    covered: Floats = np.clip(np.float32(1.4) - nearest, 0, 1)
    return covered


def _draw(colours: Floats, drawn: _Drawn, found: Ints, weights: Floats) -> None:
    """Draw a mark, in place: a tint, an outline and a segment with a dot where it begins and a ring where it ends.

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
    # A ring surrounds nothing but the surface.
    covered = np.where(mark.inside[rows], np.where(end < 3.0, tint, np.maximum(tint, lines)), 0.0)
    ends = np.maximum(np.clip(5.0 - start, 0, 1), np.clip(1.8 - np.abs(end - 4.2), 0, 1))
    covered = np.maximum(covered, ends).astype(np.float32)
    _blend(colours, covered, np.array(mark.colour, np.float32), here)


def seen(corners: Floats, points: Floats, normals: Floats, directions: Floats) -> NDArray[np.bool_]:
    """(directions, points) whether nothing lies between points of a surface and a far eye.

    Args:
        corners: (triangles, 3, 3) of everything, scene units.
        points: (points, 3) on it.
        normals: (points, 3) unit.
        directions: (directions, 3) unit, towards the eye.
    """
    middle = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    extent = max(float(np.abs(corners - middle).max()), 1e-30)
    rays = _traced((corners - middle) / extent)
    starts = np.tile((points - middle) / extent + 10 * _LIFT * normals, (len(directions), 1)).astype(np.float32)
    towards = np.repeat(directions, len(points), axis=0).astype(np.float32)
    free = rays.run(starts, towards, query="OCCLUDED").reshape(len(directions), -1) < 0
    return np.asarray(free & (directions @ normals.T > 0))


def _unit(vectors: Floats) -> Floats:
    """(n, k) float32 vectors divided by their length; 0 stays 0."""
    lengths = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    units: Floats = vectors / np.maximum(lengths, np.float32(1e-30))[:, None]
    return units
