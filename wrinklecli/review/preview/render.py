"""Render triangles by rays, without a display or a graphics card. The same triangles give the same picture."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.paints import Paint, Texture, look_up
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.pixels import Bytes, linear_rgb, srgb
from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints
from wrinklecli.numeric.portions import portions
from wrinklecli.review.preview.camera import Camera, project
from wrinklecli.review.preview.draw import (
    AnyMark,
    ProjectedMark,
    ProjectedOutline,
    blend,
    draw_mark,
    edge_cover,
    project_mark,
)
from wrinklecli.review.preview.light import REACH, light_up
from wrinklecli.review.preview.overlay import INK, NOTHING, PAPER, RED, Overlay, draw_overlay
from wrinklecli.review.preview.preview_options import PLAIN, Style
from wrinklecli.review.preview.rays import INVISIBLE, Hits, TracedSurface, first_hits, trace

# Primary rays along each axis of a pixel where one ray is not enough.
_SAMPLES = 2
# Step in depth between neighbours from which they get more rays, over half the picture's height.
_STEP = np.float32(0.03)
# Cosine between the normals of neighbours below which they get more rays.
_CREASE = np.float32(0.94)
# Grey of a picture without colours, linear.
_CLAY = 0.62
# Part of the light that a base colour of 1 reflects: nothing real reflects all.
_ALBEDO = np.float32(0.9)
# Opacity of the triangles' edges.
_WIRE = np.float32(0.75)
# Linear values 0 to 1 in sRGB; a power for each pixel would take 0.2 s.
_ENCODED = srgb(np.linspace(0, 1, 1 << 14, dtype=np.float32))
# Points along an edge of a triangle at which it is looked at, to see if all of it shows.
_POINTS = 8
_ALPHAS = (np.arange(256) / 255.0).astype(np.float32)
# Cells in the greatest slide of a picture: their edges show a tenth of it.
_CELLS = 3.0
# Greatest number of cells across the skin that slides: smaller ones flicker.
_MOST_CELLS = 40.0
# Part of the greatest slide from which skin gets the checker.
_LEAST_SLIDE = 0.01
# The two tones, 8-bit sRGB, which multiply the colour of the skin.
_TONES = (255, 196)
# Pixels of a cell: its edges are as sharp as those of the picture.
_CELL_PIXELS = 32


@dataclass(frozen=True, slots=True)
class Opacities:
    """The parts of triangles that show, by the material's `alphaMode`: lace has holes, and glass lets light through.

    Source: glTF 2.0 §3.9.4 (alpha coverage).

    Attributes:
        alphas: (triangles, 3) alpha at the corners.
        cutoffs: (triangles,) alpha from which on a point shows; 0 if all points do, infinite if alpha is opacity.
        coordinates: (triangles, 3, 2) texture coordinates of the corners.
        numbers: (triangles,) into `textures`; -1 for none.
        textures: Their one channel multiplies the alpha.
    """

    alphas: Floats
    cutoffs: Floats
    coordinates: Floats
    numbers: Ints
    textures: tuple[Texture, ...]

    @classmethod
    def of(cls, parts: Sequence[tuple[Ints, Paint]]) -> "Opacities | None":
        """Join parts, each with the (triangles, 3) vertices of its paint; None if all are opaque."""
        if not any(paint.opacity for _, paint in parts):
            return None
        textures: list[Texture] = []
        joined = []
        for vertices, paint in parts:
            alphas, cutoff, texture = np.ones(vertices.shape), 0.0, None
            if paint.opacity is not None:
                alphas, cutoff, texture = paint.opacity.alphas[vertices], paint.opacity.cutoff, paint.opacity.texture
            cutoffs, numbers = np.full(len(vertices), cutoff), np.full(len(vertices), _number_of(texture, textures))
            joined.append((alphas, cutoffs, paint.coordinates[vertices], numbers))
        alphas, cutoffs, coordinates, numbers = map(np.concatenate, zip(*joined, strict=True))
        return cls(alphas, cutoffs, coordinates, numbers, tuple(textures))

    def at(self, triangles: Ints, weights: Array) -> Array:
        """(points,) opacity from 0 to 1 at points of (points,) triangles, by (points, 3) barycentric weights."""
        found = np.ones(len(triangles), np.float32)
        partial = np.flatnonzero(self.cutoffs[triangles] > 0)
        triangles, weights = triangles[partial], weights[partial]
        alphas = np.einsum("pi,pi->p", weights, self.alphas[triangles])
        for here, texture, places in _textured(self.textures, self.numbers, self.coordinates, triangles, weights):
            alphas[here] *= look_up(texture, places, _ALPHAS)[:, 0]
        cutoffs = self.cutoffs[triangles]
        blended = np.where(alphas < INVISIBLE, 0.0, np.where(alphas > 1.0 - INVISIBLE, 1.0, alphas))
        found[partial] = np.where(np.isinf(cutoffs), blended, alphas >= cutoffs)
        return found

    def whole(self) -> Bools:
        """(triangles,) True if all of a triangle is opaque."""
        whole = np.ones(len(self.alphas), np.bool_)
        partial = np.flatnonzero(self.cutoffs > 0)
        steps = np.arange(_POINTS + 1) / _POINTS
        for first in steps:
            for second in steps[steps <= 1.0 - first]:
                weights = np.tile([first, second, 1.0 - first - second], (len(partial), 1))
                whole[partial] &= self.at(partial, weights) == 1.0
        return whole


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The triangles of an asset at a moment.

    Attributes:
        corners: (triangles, 3, 3) positions, world space.
        normals: (triangles, 3, 3) unit normals of the corners.
        colours: (triangles, 3, 3) base colours of the corners, linear RGB.
        coordinates: (triangles, 3, 2) texture coordinates of the corners.
        texture_numbers: (triangles,) into `textures`; -1 for none.
        textures: They multiply the colours.
        marks: Tools to draw on the triangles.
        opacities: What of the triangles shows; None for all.
    """

    corners: Floats
    normals: Floats
    colours: Floats
    coordinates: Floats
    texture_numbers: Ints
    textures: tuple[Texture, ...] = ()
    marks: tuple[AnyMark, ...] = ()
    opacities: Opacities | None = None

    @classmethod
    def of(cls, parts: Iterable[tuple[Floats, Floats, Ints, Paint]], marks: Sequence[AnyMark] = ()) -> "Snapshot":
        """Join parts, which may be none.

        Each has (triangles, 3, 3) corners and their normals, and the (triangles, 3) vertices of its paint there.
        """
        joined: list[tuple[Array, ...]] = [(*np.zeros((3, 0, 3, 3)), np.zeros((0, 3, 2)), np.zeros(0, np.intp))]
        textures: list[Texture] = []
        painted = []
        for corners, normals, vertices, paint in parts:
            painted.append((vertices, paint))
            numbers = np.full(len(corners), _number_of(paint.texture, textures))
            joined.append((corners, normals, paint.colours[vertices], paint.coordinates[vertices], numbers))
        places, turned, colours, coordinates, numbers = map(np.concatenate, zip(*joined, strict=True))
        opacities = Opacities.of(painted)
        return cls(places, turned, colours, coordinates, numbers, tuple(textures), tuple(marks), opacities)


@dataclass(frozen=True, slots=True)
class _Scene:
    """A snapshot in camera space.

    Attributes:
        colours: (triangles, 3, 3) base colours of the corners, linear RGB, float32.
        projected: (triangles, 3, 2) corners in the picture, sub-pixels; None if no wires are drawn.
    """

    surface: TracedSurface
    snapshot: Snapshot
    colours: Array
    projected: Array | None
    marks: tuple[ProjectedMark | ProjectedOutline, ...]


def render(
    snapshot: Snapshot, camera: Camera, *, size: tuple[int, int], style: Style = PLAIN, overlay: Overlay = NOTHING
) -> Bytes:
    """Render a picture of a snapshot, of a width and height in pixels: (height, width, 3) sRGB.

    Both sides of a triangle are shaded, its normals turned with it. Light rays start from the curved surface that the
    vertex normals suggest, so that coarse meshes get no false dark edges.
    """
    width, height = size
    scene = _scene(snapshot, camera, size, style)
    shown = np.zeros((height, width, 3), np.uint8)
    for band in portions(height, 2 * width):
        shown[band] = _band(scene, size, style, band.start, min(band.stop, height))
    draw_overlay(shown, overlay, camera, scene.surface)
    return shown


def _scene(snapshot: Snapshot, camera: Camera, size: tuple[int, int], style: Style) -> _Scene:
    local = camera.local(snapshot.corners)
    projected = None
    if style.wire:
        finer = (size[0] * _SAMPLES, size[1] * _SAMPLES)
        projected = project(local, finer, camera.tangent).astype(np.float32)
    whole = None if snapshot.opacities is None else snapshot.opacities.whole()
    return _Scene(
        surface=trace(local, snapshot.normals @ camera.axes.T, camera.tangent, whole=whole),
        snapshot=snapshot,
        colours=snapshot.colours.astype(np.float32),
        projected=projected,
        marks=tuple(project_mark(mark, local, size, camera.tangent) for mark in snapshot.marks),
    )


def _band(scene: _Scene, size: tuple[int, int], style: Style, top: int, bottom: int) -> Bytes:
    """(rows, width, 3) sRGB pixels of the rows from `top` to `bottom`."""
    width, height = size
    # The filter that blends light rays looks beyond the band.
    first, last = max(top - REACH, 0), min(bottom + REACH, height)
    shape = (last - first, width)
    hits = _sampled(scene, size, style, shape, first)
    light, shine = light_up(scene.surface, hits, shape, first, style.key)
    colours = np.clip(_base_colours(scene, hits, style) * light + shine[:, None], 0, 1)
    colours = _ENCODED[(colours * (len(_ENCODED) - 1) + 0.5).astype(np.intp)]
    if scene.projected is not None:
        blend(colours, _WIRE * edge_cover(scene.projected, _SAMPLES * hits.middles, hits.triangles), INK)
    for mark in scene.marks:
        draw_mark(colours, mark, hits.triangles, hits.weights)

    count = shape[0] * width
    bare = 1 - np.bincount(hits.pixels, hits.areas, count)
    channels = [np.bincount(hits.pixels, hits.areas * colours[:, k], count) + bare * PAPER[k] for k in range(3)]
    picture = np.stack(channels, axis=1).reshape(*shape, 3)[top - first : bottom - first]
    return np.asarray((255 * np.clip(picture, 0, 1) + 0.5).astype(np.uint8))


def _sampled(scene: _Scene, size: tuple[int, int], style: Style, shape: tuple[int, int], first: int) -> Hits:
    """Trace a ray for each pixel of a band of `shape` rows and columns, and more rays for the uneven ones."""
    opacity = None if scene.snapshot.opacities is None else scene.snapshot.opacities.at
    hits = first_hits(scene.surface, size, first, np.arange(shape[0] * shape[1]), np.zeros((1, 2)), opacity)
    uneven = _uneven(scene, hits, shape, style)
    offsets = (np.stack(np.divmod(np.arange(_SAMPLES**2), _SAMPLES), axis=1) + 0.5) / _SAMPLES - 0.5
    finer = first_hits(scene.surface, size, first, np.flatnonzero(uneven), offsets, opacity)
    return hits.only(~uneven[hits.pixels]).joined(finer)


def _uneven(scene: _Scene, hits: Hits, shape: tuple[int, int], style: Style) -> Bools:
    """(pixels,) True for pixels that need more rays: outlines, creases, texture, wires and marks."""
    seen = np.zeros(shape, bool)
    seen.ravel()[hits.pixels] = True
    if style.wire:
        fine = seen.copy()
    else:
        detailed = (scene.snapshot.texture_numbers[hits.triangles] >= 0) & (not style.clay)
        for drawn in scene.marks:
            detailed |= drawn.rows[hits.triangles] >= 0
        fine = np.zeros(shape, bool)
        fine.ravel()[hits.pixels[detailed]] = True
    depths, normals = np.zeros(shape, np.float32), np.zeros((*shape, 3), np.float32)
    # Of several hits of a pixel, the first is in front.
    depths.ravel()[hits.pixels[::-1]] = hits.depths[::-1]
    normals.reshape(-1, 3)[hits.pixels[::-1]] = hits.normals[::-1]
    for axis in (0, 1):
        before, after = _neighbouring(axis)
        turned = np.einsum("yxa,yxa->yx", normals[before], normals[after])
        apart = (seen[before] != seen[after]) | (np.abs(depths[before] - depths[after]) > _STEP) | (turned < _CREASE)
        apart &= seen[before] | seen[after]
        fine[before] |= apart
        fine[after] |= apart
    return fine.ravel()


def _neighbouring(axis: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Index a grid by the places that have a neighbour after them along an axis, and by these neighbours."""
    every, before, after = slice(None), slice(None, -1), slice(1, None)
    return ((before, every), (after, every)) if axis == 0 else ((every, before), (every, after))


def _base_colours(scene: _Scene, hits: Hits, style: Style) -> Array:
    """(hits, 3) base colours, linear RGB."""
    base = np.full_like(hits.normals, _CLAY)
    if not style.clay:
        base[:] = 0
        for i in range(3):
            base += _ALBEDO * hits.weights[:, i, None] * scene.colours[hits.triangles, i]
        shot = scene.snapshot
        for here, texture, places in _textured(
            shot.textures, shot.texture_numbers, shot.coordinates, hits.triangles, hits.weights
        ):
            base[here] *= look_up(texture, places)
    if style.backfaces:
        base[hits.sides[:, 0] < 0] = linear_rgb(np.array(RED))
    return base


def _number_of(texture: Texture | None, textures: list[Texture]) -> int:
    """The number of a texture among others, which get it if it is new; -1 for none."""
    if texture is None:
        return -1
    if texture not in textures:
        textures.append(texture)
    return textures.index(texture)


def _textured(
    textures: Sequence[Texture], numbers: Ints, coordinates: Floats, triangles: Ints, weights: Array
) -> Iterator[tuple[Ints, Texture, Array]]:
    """For each texture the points of (points,) triangles that have it, and their places in it.

    `weights` are (points, 3) barycentric; `numbers` and (3, 2) `coordinates` are those of each triangle.
    """
    own = numbers[triangles]
    for number, texture in enumerate(textures):
        here = np.flatnonzero(own == number)
        if len(here):
            yield here, texture, np.einsum("pi,pia->pa", weights[here], coordinates[triangles[here]])


def _texture() -> Texture:
    """Two by two cells, which repeat."""
    tones = np.array([_TONES, _TONES[::-1]], np.uint8)
    pixels: Bytes = np.repeat(np.kron(tones, np.ones((_CELL_PIXELS, _CELL_PIXELS), np.uint8))[..., None], 3, axis=2)
    return Texture(pixels)


_CHECKER = _texture()


def checked(before: Snapshot, after: Snapshot, axes: Floats) -> tuple[Snapshot, Snapshot]:
    """Draw a checker on the triangles that have slid from one snapshot to another, in place of their texture.

    It is straight where nothing has slid, as seen along (3, 3) the rows of a camera: right, up and backwards. The
    snapshots have the same triangles.
    """
    slides = np.linalg.norm(after.corners - before.corners, axis=2).max(axis=1)
    greatest = float(slides.max(initial=0.0))
    if not greatest > 0:
        return before, after
    chosen = np.flatnonzero(slides > _LEAST_SLIDE * greatest)
    places = before.corners[chosen] @ axes[:2].T
    cell = max(greatest / _CELLS, float(np.ptp(places.reshape(-1, 2), axis=0).max()) / _MOST_CELLS)
    coordinates, numbers = after.coordinates.copy(), after.texture_numbers.copy()
    coordinates[chosen] = (places - places.reshape(-1, 2).mean(axis=0)) / (2.0 * cell)
    numbers[chosen] = len(after.textures)
    textures = (*after.textures, _CHECKER)
    one, other = (
        replace(each, coordinates=coordinates, texture_numbers=numbers, textures=textures) for each in (before, after)
    )
    return one, other
