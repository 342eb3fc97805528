"""Pictures of animated glTF assets, offscreen: posed as an engine would, then ray cast.

    python samples/pictures.py hand.glb wrinkled.glb --clip bend --times 0,0.3 --views top,40:20 -o sheet.png

A contact sheet: rows are views, columns are times; with two assets each time shows both side by side. Needs
the extra `pictures` (`pip install -e .[pictures]`). As a module: `pose`, `Camera`, `render`, `sheet`.

Normals are the file's own, morphed, skinned (by the inverse transpose) and renormalised, so that shading
seams show as they would in an engine; primitives without NORMAL are shaded flat. Textures are left out.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import uniform_filter

from wrinklecli.document import Document, Json, read_document
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.pose import Clip, joint_matrices, morph_weights, node_matrices, read_clips, read_rig
from wrinklecli.surface import read_triangles, unit

Floats = NDArray[Any]  # float64 for posing, float32 for the rays
Ints = NDArray[np.integer[Any]]


@dataclass(frozen=True, slots=True)
class Frame:
    """A posed asset as a soup of triangles, world space, scene units.

    Attributes:
        corners: (triangles, 3, 3) positions.
        normals: (triangles, 3, 3) unit normals of the corners.
        colours: (triangles, 3) base colours, linear RGB.
        vertices: (vertices, 3) positions of all primitives in file order, for `--follow`.
    """

    corners: Floats
    normals: Floats
    colours: Floats
    vertices: Floats


def _scene_nodes(document: Document) -> list[int]:
    """The nodes of the scene, ascending; all of them where the file has no scene."""
    nodes, scenes = document.items("nodes"), document.items("scenes")
    if not scenes:
        return list(range(len(nodes)))
    found: list[int] = []
    stack = list(scenes[document.gltf.get("scene", 0)].get("nodes", []))
    while stack:
        found.append(stack.pop())
        stack += nodes[found[-1]].get("children", [])
    return sorted(found)


def _morphed(document: Document, primitive: Json, name: str, weights: Floats) -> Floats:
    values = document.accessor(primitive["attributes"][name])
    for weight, morph_target in zip(weights, primitive.get("targets", ()), strict=False):
        if weight != 0 and name in morph_target:
            values = values + weight * document.accessor(morph_target[name])
    return values


def _blended(document: Document, primitive: Json, matrices: Floats) -> Floats:
    """Joint matrices blended for each vertex, (vertices, 4, 4), the weights renormalised as engines do."""
    attributes = primitive["attributes"]
    sets = [name.removeprefix("JOINTS_") for name in attributes if name.startswith("JOINTS_")]
    joints = np.hstack([document.accessor(attributes[f"JOINTS_{i}"]) for i in sets])
    weights = np.hstack([document.accessor(attributes[f"WEIGHTS_{i}"]) for i in sets])
    weights = weights / weights.sum(axis=1, keepdims=True)
    blended = np.zeros((len(joints), 4, 4))
    for column in range(joints.shape[1]):
        blended += weights[:, column, None, None] * matrices[joints[:, column]]
    return blended


def _cofactors(matrices: Floats) -> Floats:
    """(..., 3, 3) inverse transposes times the determinants: what turns normals, without a division."""
    a, b, c = np.moveaxis(matrices, -1, 0)
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)


def _primitives(
    document: Document, clip: Clip | None, time: float
) -> Iterator[tuple[Floats, Floats | None, Ints, Floats]]:
    """Positions, normals (if any), triangles and base colour of each visible primitive, world space."""
    times = np.array([time])
    carriers = [node for node in _scene_nodes(document) if "mesh" in document.items("nodes")[node]]
    if not carriers:
        return
    places = node_matrices(read_rig(document, carriers[0]), clip, times, carriers)[0]
    for node, place in zip(carriers, places, strict=True):
        rig = read_rig(document, node)
        determinant = np.linalg.det(place[:3, :3])
        if not rig.skinned and determinant == 0:
            continue
        matrices = joint_matrices(rig, clip, times)[0]
        weights = morph_weights(rig, clip, times)[0]
        for primitive in document.items("meshes")[rig.mesh]["primitives"]:
            positions = _morphed(document, primitive, "POSITION", weights)
            triangles = read_triangles(document, primitive, len(positions), document.where("meshes", rig.mesh))
            if rig.skinned:
                blended = _blended(document, primitive, matrices)
            else:
                blended = np.broadcast_to(place, (len(positions), 4, 4))
                triangles = triangles if determinant > 0 else triangles[:, ::-1]
            normals = None
            if "NORMAL" in primitive["attributes"]:
                bind_normals = unit(_morphed(document, primitive, "NORMAL", weights))
                normals = unit(np.einsum("vij,vj->vi", _cofactors(blended[:, :3, :3]), bind_normals))
                if not rig.skinned and determinant < 0:
                    normals = -normals
            positions = np.einsum("vij,vj->vi", blended[:, :3, :3], positions) + blended[:, :3, 3]
            material = document.items("materials")[primitive["material"]] if "material" in primitive else {}
            pbr = material.get("pbrMetallicRoughness", {})
            yield positions, normals, triangles, np.array(pbr.get("baseColorFactor", (1, 1, 1, 1))[:3], float)


def pose(document: Document, clip: Clip | None = None, time: float = 0.0) -> Frame:
    """Pose every mesh of the scene, but for those scaled to nothing.

    Args:
        document: The asset.
        clip: One of `read_clips(document)`; none for the pose as stored.
        time: Seconds, held at both ends of the clip.

    Raises:
        AssetError: The asset is malformed, or has nothing to show.
    """
    corners, normals, colours, vertices = [], [], [], []
    for positions, vertex_normals, triangles, colour in _primitives(document, clip, time):
        corners.append(positions[triangles])
        if vertex_normals is None:
            a, b, c = np.moveaxis(corners[-1], 1, 0)
            normals.append(np.repeat(unit(np.cross(b - a, c - a))[:, None], 3, axis=1))
        else:
            normals.append(vertex_normals[triangles])
        colours.append(np.repeat(colour[None], len(triangles), axis=0))
        vertices.append(positions)
    if not sum(map(len, corners)):
        raise AssetError("nothing to see: no triangles in the scene, or all are scaled to 0", where=document.path)
    return Frame(*(np.concatenate(parts) for parts in (corners, normals, colours, vertices)))


VIEWS = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 89.9),
    "bottom": (0.0, -89.9),
    "oblique": (35.0, 15.0),
}
TANGENT = np.tan(np.radians(12.0))  # of half the vertical field of view: a long lens, little distortion


@dataclass(frozen=True, slots=True)
class Camera:
    """A perspective camera that looks at a point.

    Attributes:
        eye: (3,) position, world space.
        axes: (3, 3) rows: right, up, and backwards (from the centre to the eye).
        reach: Half the height of what it sees at its centre, scene units.
    """

    eye: Floats
    axes: Floats
    reach: float

    @classmethod
    def framing(
        cls,
        points: Floats,
        *,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        aspect: float = 4 / 3,
        margin: float = 1.12,
    ) -> "Camera":
        """Sees all points, as close as that allows.

        Args:
            points: (n, 3) world space.
            azimuth: Degrees about +y; 0 sees the asset's front (from +z), 90 sees it from +x.
            elevation: Degrees above the horizon.
            aspect: Width over height of the picture.
            margin: Of the distance.
        """
        axes = _axes(azimuth, elevation)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        local = (points - centre) @ axes.T
        local[:, :2] -= (local[:, :2].min(axis=0) + local[:, :2].max(axis=0)) / 2
        middle = centre + axes.T @ (((points - centre) @ axes.T - local)[0])
        distance = margin * max(
            float((np.abs(local[:, 1]) / TANGENT + local[:, 2]).max()),
            float((np.abs(local[:, 0]) / (TANGENT * aspect) + local[:, 2]).max()),
        )
        return cls(middle + distance * axes[2], axes, distance * TANGENT)

    @classmethod
    def focusing(
        cls,
        focus: Floats,
        radius: float,
        *,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        aspect: float = 4 / 3,
    ) -> "Camera":
        """Sees a ball of a radius about a point: the short side of the picture spans it."""
        axes = _axes(azimuth, elevation)
        reach = radius / min(aspect, 1)
        return cls(np.asarray(focus) + reach / TANGENT * axes[2], axes, reach)


def _axes(azimuth: float, elevation: float) -> Floats:
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    right = np.array([np.cos(a), 0.0, -np.sin(a)])
    return np.array([right, np.cross(back, right), back])


SAMPLES = 2  # per pixel and axis: primary rays
PATTERN = 4  # sub-pixels per axis that share a set of light rays; a box filter of this size joins them again
AMBIENT_RAYS = 8  # per sub-pixel: 32 a pixel, 128 after the filter
SHADOW_RAYS = 2
KEY = np.array([-0.62, 0.62, 0.48])  # towards the lights, in the camera's axes; raking, so that relief shows
FILL = np.array([0.75, 0.05, 0.65])
COLOURS = np.array([(0.78, 0.75, 0.72), (0.126, 0.133, 0.14), (0.228, 0.235, 0.24)], np.float32)  # and of the sky
SOFTNESS = 0.12  # radius of the key light at unit distance
PAPER = np.array([0.93, 0.94, 0.95])  # background, sRGB
_LEVELS = np.linspace(0, 1, 1 << 14, dtype=np.float32)  # sRGB by table: a power for each pixel takes 0.2 s
GAMMA = np.where(_LEVELS < 0.0031308, 12.92 * _LEVELS, 1.055 * _LEVELS ** np.float32(1 / 2.4) - 0.055)
GOLDEN = 0.6180339887498949


def _hits(scene: EmbreeScene, camera: Camera, size: tuple[int, int]) -> tuple[Ints, Floats, Ints, Floats]:
    """Primary rays: the sub-pixels that hit, their directions, triangles and barycentric weights."""
    width, height = size[0] * SAMPLES, size[1] * SAMPLES
    xs = ((np.arange(width) + 0.5) * 2 / width - 1) * TANGENT * size[0] / size[1]
    ys = (1 - (np.arange(height) + 0.5) * 2 / height) * TANGENT
    grid: Floats = np.ones((height, width, 3), np.float32)
    grid[..., 0], grid[..., 1], grid[..., 2] = xs[None], ys[:, None], -1
    directions = unit(grid.reshape(-1, 3) @ camera.axes.astype(np.float32))
    found = scene.run(np.broadcast_to(camera.eye.astype(np.float32), directions.shape).copy(), directions, output=True)
    pixels = np.flatnonzero(found["primID"] >= 0)
    u, v = found["u"][pixels], found["v"][pixels]
    return pixels, directions[pixels], found["primID"][pixels], np.stack([1 - u - v, u, v], axis=1)


def _smooth(values: Floats, pixels: Ints, shape: tuple[int, int]) -> Floats:
    """Join the ray sets of neighbouring sub-pixels: a box filter over those that hit."""
    sums, counts = np.zeros((2, *shape), np.float32)
    sums.ravel()[pixels] = values
    counts.ravel()[pixels] = 1
    sums, counts = uniform_filter(sums, PATTERN), uniform_filter(counts, PATTERN)
    return sums.ravel()[pixels] / np.maximum(counts.ravel()[pixels], 1e-6)


def _basis(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors across each normal, continuous but for one pole (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1), np.stack([b, sign + y * y * a, -y], 1)


def _discs(count: int) -> Floats:
    """Points spread evenly over the unit disc, (count, PATTERN², 3): x, y and the squared radius.

    Any one of the sets covers the disc, and all together cover it more finely (a golden-angle spiral, dealt
    out in turn).
    """
    numbers = np.arange(count * PATTERN**2)
    squares = (numbers + 0.5) / len(numbers)
    angles = 2 * np.pi * GOLDEN * numbers
    spiral = np.stack([np.sqrt(squares) * np.cos(angles), np.sqrt(squares) * np.sin(angles), squares], axis=1)
    return spiral.reshape(count, PATTERN**2, 3).astype(np.float32)


def _light(
    scene: EmbreeScene, points: Floats, normals: Floats, camera: Camera, rows: Ints, key: Floats
) -> tuple[Floats, Floats]:
    """Openness to the sky and to the key light, both 0 to 1, from deterministic rays.

    Args:
        scene: The triangles.
        points: (hits, 3) where rays start, just above the surface.
        normals: (hits, 3) unit.
        camera: Occluders count up to the height that it sees.
        rows: (hits,) number of each hit's set of rays, 0 to PATTERN² - 1.
        key: (3,) unit vector towards the key light.
    """
    tangents, bitangents = _basis(normals)
    far = np.float32(1.2 * camera.reach)
    openness = np.ones(len(points), np.float32)
    for disc in _discs(AMBIENT_RAYS):
        x, y, radius = disc[rows].T[..., None]
        directions = x * tangents + y * bitangents + np.sqrt(1 - radius) * normals
        distances = scene.run(points, directions, query="DISTANCE")
        openness -= (1 - np.minimum(distances, far) / far) / AMBIENT_RAYS
    lit = np.zeros(len(points), np.float32)
    across = np.concatenate(_basis(key[None]))
    for disc in _discs(SHADOW_RAYS):
        directions = (key + np.float32(SOFTNESS) * (disc[:, :2] @ across))[rows]
        lit += (scene.run(points, directions, query="OCCLUDED") < 0) / np.float32(SHADOW_RAYS)
    return openness, lit


def _edges(frame: Frame, camera: Camera, size: tuple[int, int], pixels: Ints, found: Ints) -> Floats:
    """How much of each sub-pixel a triangle edge covers, 0 to 1; lines are as thin as a pixel."""
    width, height = size[0] * SAMPLES, size[1] * SAMPLES
    local = (frame.corners - camera.eye) @ camera.axes.T
    depths = np.maximum(-local[..., 2], 1e-9)
    projected = np.stack([local[..., 0], -local[..., 1]], -1) / depths[..., None] / TANGENT * height / 2
    projected += (width / 2, height / 2)
    nearest = np.full(len(pixels), np.inf)
    places = np.stack([pixels % width + 0.5, pixels // width + 0.5], 1)
    for i in range(3):
        starts = projected[:, i]
        along = unit(projected[:, (i + 1) % 3] - starts)
        offsets = places - starts[found]
        nearest = np.minimum(nearest, np.abs(offsets[:, 0] * along[found, 1] - offsets[:, 1] * along[found, 0]))
    return np.clip(1.4 - nearest, 0, 1)


def render(
    frame: Frame,
    camera: Camera,
    *,
    size: tuple[int, int] = (800, 600),
    wire: bool = False,
    backfaces: bool = False,
    clay: bool = False,
) -> NDArray[np.uint8]:
    """A picture of a frame: key light with soft shadow, fill light, ambient occlusion.

    Both sides of a triangle are shaded, its normals turned with it. Light rays start from the curved surface
    that the vertex normals suggest (Hanika, Hacking the Shadow Terminator, 2021), so that coarse meshes get
    no false dark edges.

    Args:
        frame: What `pose` returns.
        camera: Where from.
        size: Width and height, pixels.
        wire: Draw the triangles' edges.
        backfaces: Paint triangles seen from behind red.
        clay: Grey, whatever the materials say.

    Returns:
        (height, width, 3) sRGB.
    """
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(frame.corners, np.float32))
    pixels, directions, found, weights = _hits(scene, camera, size)
    shape = (size[1] * SAMPLES, size[0] * SAMPLES)

    corners = frame.corners.astype(np.float32)
    faces = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))[found]
    behind = np.einsum("pi,pi->p", faces, directions) > 0
    sides = np.where(behind, -1, 1).astype(np.float32)[:, None]
    faces *= sides
    points = np.zeros_like(directions)
    normals = np.zeros_like(directions)
    for i in range(3):
        points += weights[:, i, None] * corners[found, i]
    lifted = np.zeros_like(points)
    for i in range(3):
        corner_normals = frame.normals[:, i].astype(np.float32)[found] * sides
        below = np.minimum(np.einsum("pi,pi->p", points - corners[found, i], corner_normals), 0)
        lifted -= (weights[:, i] * below)[:, None] * corner_normals
        normals += weights[:, i, None] * corner_normals
    normals = unit(normals)
    extent = float(np.linalg.norm(np.ptp(frame.vertices, axis=0)))
    starts = points + lifted + np.float32(1e-4 * extent) * faces

    key, fill = ((unit(light) @ camera.axes).astype(np.float32) for light in (KEY, FILL))
    rows = pixels // shape[1] % PATTERN * PATTERN + pixels % shape[1] % PATTERN
    openness, lit = _light(scene, starts, normals, camera, rows, key)
    openness, lit = _smooth(openness, pixels, shape), _smooth(lit, pixels, shape)

    halfways: Floats = key - directions
    amounts = (
        lit * np.maximum(normals @ key, 0),
        openness * np.maximum(normals @ fill, 0),
        openness * (0.8 + 0.2 * (normals @ camera.axes[1].astype(np.float32))),
    )
    light = np.stack(amounts, axis=1) @ COLOURS
    shine = 0.10 * lit * np.maximum(np.einsum("pi,pi->p", normals, unit(halfways)), 0) ** 24
    base = (np.full_like(frame.colours, 0.62) if clay else 0.9 * frame.colours).astype(np.float32)[found]
    if backfaces:
        base[behind] = (0.9, 0.03, 0.02)
    colours = np.clip(base * light + shine[:, None], 0, 1)
    colours = GAMMA[(colours * (len(GAMMA) - 1) + 0.5).astype(np.intp)]
    if wire:
        ink = 0.75 * _edges(frame, camera, size, pixels, found)[:, None]
        colours = colours * (1 - ink) + ink * np.array([0.05, 0.07, 0.12])

    picture = np.tile(PAPER.astype(np.float32), (shape[0] * shape[1], 1))
    picture[pixels] = colours
    picture = picture.reshape(size[1], SAMPLES, size[0], SAMPLES, 3).mean(axis=(1, 3))
    shown: NDArray[np.uint8] = (255 * picture + 0.5).astype(np.uint8)
    return shown


def sheet(rows: Sequence[Sequence[tuple[str, NDArray[np.uint8]]]], *, gutter: int = 4) -> Image.Image:
    """Labelled pictures of one size in rows."""
    height, width, _ = rows[0][0][1].shape
    font = ImageFont.load_default(max(12, height // 36))
    columns = max(map(len, rows))
    whole = Image.new("RGB", (columns * (width + gutter) - gutter, len(rows) * (height + gutter) - gutter), "white")
    for j, row in enumerate(rows):
        for i, (label, picture) in enumerate(row):
            cell = Image.fromarray(picture)
            pen = ImageDraw.Draw(cell)
            left, top, right, bottom = pen.textbbox((8, 6), label, font=font)
            pen.rectangle((left - 4, top - 3, right + 4, bottom + 3), fill="white")
            pen.text((8, 6), label, fill=(60, 66, 74), font=font)
            whole.paste(cell, (i * (width + gutter), j * (height + gutter)))
    return whole


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in text.split(","))


def _tied(words: Sequence[str]) -> list[str]:
    """Join `--focus -1,0,0` to `--focus=-1,0,0`: argparse would take such a value for another option."""
    tied: list[str] = []
    for word in words:
        if tied and tied[-1] in ("--views", "--focus", "--times"):
            tied[-1] += f"={word}"
        else:
            tied.append(word)
    return tied


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("assets", nargs="+", metavar="ASSET", help="one, or several to compare (before, after)")
    parser.add_argument("--clip", help="default: the first; `--rest` for the pose as stored")
    parser.add_argument("--rest", action="store_true", help="the pose as stored, no clip")
    parser.add_argument("--times", type=_numbers, help="seconds, comma-separated; default: start, middle and end")
    parser.add_argument(
        "--views",
        default="oblique",
        help=f"comma-separated: {', '.join(VIEWS)} or azimuth:elevation in degrees",
    )
    parser.add_argument("--focus", type=_numbers, metavar="X,Y,Z", help="look at this point")
    parser.add_argument("--radius", type=float, help="of what to see about the focus, scene units")
    parser.add_argument(
        "--follow",
        action="store_true",
        help="the focus is a point of the stored pose; the camera moves with the skin there",
    )
    parser.add_argument("--labels", type=lambda text: text.split(","), metavar="A,B", help="one for each asset")
    parser.add_argument("--size", default="800x600", help="of each picture, pixels")
    parser.add_argument("--wire", action="store_true", help="draw the triangles' edges")
    parser.add_argument("--clay", action="store_true", help="grey, whatever the materials say")
    parser.add_argument("--backfaces", action="store_true", help="paint triangles seen from behind red")
    parser.add_argument("-o", "--output", required=True, metavar="SHEET.png")
    options = parser.parse_args(_tied(sys.argv[1:]))
    if (options.focus is None) != (options.radius is None):
        parser.error("--focus and --radius go together")
    if options.follow and options.focus is None:
        parser.error("--follow needs --focus")
    if options.labels and len(options.labels) != len(options.assets):
        parser.error("--labels needs one for each asset")
    return options


def _clip(document: Document, name: str | None) -> Clip | None:
    """The named clip, the first where no name is given, none where there is none.

    Raises:
        AssetError: There is no clip of that name.
    """
    clips = read_clips(document)
    if name is None:
        return clips[0] if clips else None
    for clip in clips:
        if clip.name == name:
            return clip
    known = ", ".join(clip.name for clip in clips) or "none"
    raise AssetError(f"no clip {name!r}; there are: {known}", where=document.path)


def _pictures(options: argparse.Namespace) -> Iterator[list[tuple[str, NDArray[np.uint8]]]]:
    """Rows of labelled pictures."""
    width, height = (int(part) for part in options.size.split("x"))
    documents = [read_document(path) for path in options.assets]
    clips = [None if options.rest else _clip(document, options.clip) for document in documents]
    times = options.times or (0.0,)
    if clips[0] and not options.times:
        times = tuple(clips[0].start + share * (clips[0].end - clips[0].start) for share in (0.0, 0.5, 1.0))
    shots = [(i, time) for time in times for i in range(len(documents))]
    frames = [pose(documents[i], clips[i], time) for i, time in shots]
    everything = np.concatenate([frame.vertices for frame in frames])
    focuses = np.tile(options.focus or (0.0, 0.0, 0.0), (len(shots), 1))
    if options.follow:
        nearest = np.linalg.norm(pose(documents[0]).vertices - options.focus, axis=1).argmin()
        # Of the first asset at the same time, so that before and after are seen from the same place.
        focuses = np.repeat([frame.vertices[nearest] for frame in frames[:: len(documents)]], len(documents), axis=0)
    for view in options.views.split(","):
        azimuth, elevation = VIEWS.get(view) or (float(part) for part in view.split(":"))
        row = []
        for (i, time), frame, focus in zip(shots, frames, focuses, strict=True):
            if options.focus:
                camera = Camera.focusing(
                    focus, options.radius, azimuth=azimuth, elevation=elevation, aspect=width / height
                )
            else:
                camera = Camera.framing(everything, azimuth=azimuth, elevation=elevation, aspect=width / height)
            picture = render(
                frame,
                camera,
                size=(width, height),
                wire=options.wire,
                backfaces=options.backfaces,
                clay=options.clay,
            )
            clip = clips[i]
            when = f"{clip.name} {time:.4g} s" if clip else "as stored"
            label = options.labels[i] if options.labels else f"{Path(options.assets[i]).stem}   {when}   {view}"
            row.append((label, picture))
        yield row


def main() -> int:
    """Command line: see the module's text."""
    options = _options()
    try:
        sheet(list(_pictures(options))).save(options.output, optimize=True)
    except WrinkleError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
