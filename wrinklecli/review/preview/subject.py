"""An asset as a preview shows it: what of it can be seen, posed, coloured and marked with its tools.

Of materials, base colours and their textures show; everything is opaque and seen from both sides. Normals are the
file's own, morphed, skinned and renormalised, so that shading seams show as they would in an engine; primitives without
NORMAL are shaded flat.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.refined_mesh import primitives_of
from wrinklecli.character.clip import Clip, clip_named, read_clips
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.scene import Part, pose_part, read_scene
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.files import read_uri
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, unit
from wrinklecli.review.preview.render import Frame, Mark, Texture

Colour = tuple[float, float, float]

# Compression, 1 - the smallest principal stretch, and its colour, sRGB.
HEAT: tuple[tuple[float, Colour], ...] = (
    (0.0, (0.84, 0.84, 0.82)),
    (0.1, (0.98, 0.90, 0.55)),
    (0.25, (0.98, 0.62, 0.22)),
    (0.45, (0.85, 0.20, 0.16)),
    (0.65, (0.50, 0.06, 0.36)),
    (0.8, (0.16, 0.03, 0.28)),
)
HEAT_TICKS = (0.0, 0.2, 0.4, 0.6, 0.8)
# Of tools, sRGB: told apart on skin, on cloth and by most who confuse colours.
INKS: tuple[Colour, ...] = (
    (0.86, 0.08, 0.24),
    (0.00, 0.42, 0.84),
    (0.00, 0.55, 0.33),
    (0.93, 0.49, 0.00),
    (0.55, 0.20, 0.75),
    (0.00, 0.62, 0.66),
    (0.72, 0.36, 0.18),
    (0.80, 0.20, 0.58),
)
# Sampler properties, glTF 2.0 §5.26.
_WRAPS = {33071: "clamp", 33648: "mirror"}


@dataclass(frozen=True, slots=True)
class Moment:
    """A clip (none for the stored pose) at a time in seconds."""

    clip: str | None
    time: float

    @property
    def label(self) -> str:
        """In words."""
        return "as stored" if self.clip is None else f"{self.clip} {self.time:.2f} s"


@dataclass(frozen=True, slots=True)
class Piece:
    """What of a part does not change with time.

    Attributes:
        part: Of the scene.
        colours: (vertices, 3) base colours, linear RGB.
        coordinates: (vertices, 2) in its texture.
        texture: Into the subject's images; -1 for none.
        shapes: (shapes, vertices, 3) of the wrinkles' morph targets.
        shape_numbers: (shapes,) of these among all morph targets.
        marks: Of the tools on it.
    """

    part: Part
    colours: Floats
    coordinates: Floats
    texture: int
    shapes: Floats
    shape_numbers: Ints
    marks: tuple[Mark, ...]

    def displacements(self, clip: Clip | None, time: float) -> Floats:
        """(vertices,) how far the wrinkles move each vertex, bind units."""
        weights = morph_weights(self.part.rig, clip, np.array([time]))[0, self.shape_numbers]
        moved = np.tensordot(weights, self.shapes, axes=1)
        return np.asarray(np.sqrt(np.sum(moved**2, axis=1)))


@dataclass(frozen=True, slots=True)
class Body:
    """A piece at a moment.

    Attributes:
        number: Of the piece.
        piece: What is posed.
        positions: (vertices, 3) world space, scene units.
        normals: (vertices, 3) unit; None for flat shading.
        triangles: (triangles, 3) of the piece, as they wind there.
        mirrored: Whether they wind the other way than stored.
    """

    number: int
    piece: Piece
    positions: Floats
    normals: Floats | None
    triangles: Ints
    mirrored: bool


@dataclass(frozen=True, slots=True)
class Subject:
    """An asset to show.

    Attributes:
        label: What to call it.
        document: The asset.
        clips: Of it.
        pieces: Of its scene, those with triangles.
        images: Textures of the pieces.
    """

    label: str
    document: Document
    clips: tuple[Clip, ...]
    pieces: tuple[Piece, ...]
    images: tuple[Texture, ...]

    def clip(self, name: str | None) -> Clip | None:
        """The clip of a name.

        Raises:
            AssetError: There is none.
        """
        return None if name is None else clip_named(self.clips, name, where=self.document.path)

    def posed(self, moment: Moment) -> Iterator[Body]:
        """The pieces that show at a moment.

        Raises:
            AssetError: There is no such clip.
        """
        clip, times = self.clip(moment.clip), np.array([moment.time])
        for number, piece in enumerate(self.pieces):
            posed = pose_part(piece.part, clip, times)
            if posed.hidden[0]:
                continue
            mirrored = bool(posed.mirrored[0])
            yield Body(
                number=number,
                piece=piece,
                positions=posed.positions[0],
                normals=None if posed.normals is None else posed.normals[0],
                triangles=piece.part.triangles[:, ::-1] if mirrored else piece.part.triangles,
                mirrored=mirrored,
            )


def tool_names(plans: Sequence[MeshPlan]) -> list[str]:
    """The names of all tools, in the order of their colours."""
    return [carried.patch.tool.name for plan in plans for carried in plan.carried_patches]


def heat_colours(losses: Floats) -> Floats:
    """(…, 3) sRGB of compressions."""
    stops = [loss for loss, _ in HEAT]
    channels = [np.interp(losses, stops, [colour[k] for _, colour in HEAT]) for k in range(3)]
    return np.stack(channels, axis=-1)


def _linear(colours: Floats) -> Floats:
    """Linear RGB of sRGB."""
    return np.where(colours < 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def read_subject(document: Document, label: str, plans: Sequence[MeshPlan], warnings: list[str]) -> Subject:
    """Read what of an asset can be seen.

    Args:
        document: The asset.
        label: What to call it.
        plans: Of the tools to draw on it; they were baked into it.
        warnings: A line is added for each primitive whose texture cannot be read.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    images: list[Texture] = []
    read: dict[str, int] = {}
    pieces = []
    for part in read_scene(document):
        if not len(part.triangles):
            continue
        primitive = document.items("meshes")[part.rig.mesh]["primitives"][part.primitive]
        count = len(part.vertices.positions)
        numbers = _wrinkle_targets(document, part)
        texture, coordinates = -1, np.zeros((count, 2))
        try:
            info = _texture_info(document, primitive)
            if info:
                coordinates = _texture_coordinates(document, primitive, info, count)
                key = repr(info)
                if key not in read:
                    images.append(_read_texture(document, info))
                    read[key] = len(images) - 1
                texture = read[key]
        except (AssetError, ArithmeticError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
            # Without a texture a picture still shows the wrinkles.
            warnings.append(f"{part.where}: drawn without its texture: {error}")
        pieces.append(
            Piece(
                part=part,
                colours=part.colour * _vertex_colours(document, primitive, count),
                coordinates=coordinates,
                texture=texture,
                shapes=part.vertices.morph_deltas[numbers],
                shape_numbers=numbers,
                marks=tuple(_marks(part, plans)),
            )
        )
    return Subject(label, document, read_clips(document), tuple(pieces), tuple(images))


def _wrinkle_targets(document: Document, part: Part) -> Ints:
    """(shapes,) numbers of the morph targets that a bake has added, by the node's extras."""
    names: set[str] = set()
    extras = document.items("nodes")[part.rig.node].get("extras")
    try:
        entry = extras["wrinkle"] if isinstance(extras, dict) else {}
        names = {name for tool in entry["tools"] for name in tool["targets"]} | set(entry.get("undriven", ()))
    except (KeyError, TypeError, AttributeError):
        pass  # not what a bake writes: nothing is known of wrinkles
    return np.array([k for k, name in enumerate(part.rig.morph_names) if name in names], np.intp)


def _texture_info(document: Document, primitive: Json) -> Json:
    """What a primitive's material says of its base colour's texture; empty where it has none."""
    if "material" not in primitive:
        return {}
    material = document.item("materials", primitive["material"], user=document.path)
    info: Json = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    return info


def _read_texture(document: Document, info: Json) -> Texture:
    """The texture of a base colour.

    Raises:
        AssetError: The file of the image is missing or out of bounds.
        ValueError: The image is of no kind that is read, or damaged.
    """
    from wrinklecli.review.preview.sheet import read_texture

    where = document.where("textures")
    texture = document.item("textures", info.get("index"), user=where)
    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
    number = webp.get("source", texture.get("source"))
    image = document.item("images", number, user=where)
    if "uri" in image:
        place = document.where("images", str(number))
        data, _ = read_uri(image["uri"], document.path, place, allow_external=document.allow_external)
    else:
        data = document.view(image.get("bufferView"), user=where)
    sampler = document.item("samplers", texture["sampler"], user=where) if "sampler" in texture else {}
    across, down = (_WRAPS.get(sampler.get(key, 0), "repeat") for key in ("wrapS", "wrapT"))
    return Texture(read_texture(data), (across, down))


def _texture_coordinates(document: Document, primitive: Json, info: Json, count: int) -> Floats:
    """(vertices, 2) where in the texture each vertex is.

    Raises:
        AssetError: The file does not say.
    """
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    name = f"TEXCOORD_{transform.get('texCoord', info.get('texCoord', 0))}"
    if name not in primitive["attributes"]:
        raise AssetError(f"has no {name}", where=document.path)
    stored = _attribute(document, primitive, name, count, 2)
    offset, scale = (np.array(transform.get(key, (x, x)), float) for key, x in (("offset", 0), ("scale", 1)))
    turn = float(transform.get("rotation", 0.0))
    x, y = (stored * scale).T
    turned = np.stack([x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)], axis=1)
    return np.asarray(turned + offset)


def _vertex_colours(document: Document, primitive: Json, count: int) -> Floats:
    """(vertices, 3) linear RGB factors; white where there are none."""
    if "COLOR_0" not in primitive["attributes"]:
        return np.ones((count, 3))
    return np.clip(_attribute(document, primitive, "COLOR_0", count, 3), 0.0, 1.0)


def _attribute(document: Document, primitive: Json, name: str, count: int, size: int) -> Floats:
    """(vertices, size) the first numbers of an attribute.

    Raises:
        AssetError: It has others.
    """
    values = document.accessor(primitive["attributes"][name])
    if values.ndim != 2 or len(values) != count or values.shape[1] < size or not np.isfinite(values).all():
        raise AssetError(f"{name} must hold {size} finite numbers for {count} vertices", where=document.path)
    return values[:, :size].astype(np.float64)


def _marks(part: Part, plans: Sequence[MeshPlan]) -> Iterator[Mark]:
    """The tools on a part."""
    names = tool_names(plans)
    for plan in plans:
        if plan.rig.node != part.rig.node:
            continue
        fine = plan.fine
        refined = primitives_of(fine)[part.primitive]
        if refined.changed:
            parents = fine.subdivision.parents[fine.triangle_primitives == part.primitive]
            welded = refined.weld[refined.triangles]
        else:  # as the file has it, in its order
            parents = np.flatnonzero(fine.surface.primitives == part.primitive)
            welded = refined.weld[part.triangles]
        outwards = fine.rest_normals[welded].sum(axis=1)
        for carried in plan.carried_patches:
            patch = carried.patch
            # Around the members too, for the ends of the segment lie on the rectangle's edge.
            coarse = fine.surface.triangles
            near = np.any(np.isin(coarse, coarse[patch.members]), axis=1)
            triangles = np.flatnonzero(near[parents] & (outwards @ patch.normal > 0) | patch.members[parents])
            u, v = patch.coordinates(fine.rest_positions[welded[triangles]])
            yield Mark(
                triangles=triangles,
                inside=patch.members[parents[triangles]],
                places=np.stack([u * patch.span, v * patch.half_width], axis=2),
                span=patch.span,
                half_width=patch.half_width,
                colour=INKS[names.index(patch.tool.name) % len(INKS)],
            )


def frame_of(subject: Subject, moment: Moment, *, heat: bool) -> Frame:
    """A subject at a moment, as a soup of triangles."""
    corners, normals, colours, coordinates, textures, marks = [], [], [], [], [], []
    start = 0
    for body in subject.posed(moment):
        piece, triangles = body.piece, body.triangles
        corners.append(body.positions[triangles])
        if body.normals is None:
            flat = unit(face_normals(body.positions, triangles))
            normals.append(np.repeat(flat[:, None], 3, axis=1))
        else:
            normals.append(body.normals[triangles])
        painted = _linear(heat_colours(_losses(body))) if heat else piece.colours
        colours.append(painted[triangles])
        coordinates.append(piece.coordinates[triangles])
        textures.append(np.full(len(triangles), -1 if heat else piece.texture))
        for mark in piece.marks:
            places = mark.places[:, ::-1] if body.mirrored else mark.places
            tint = 0.0 if heat else mark.tint  # colours that mean something stay as they are
            marks.append(replace(mark, triangles=mark.triangles + start, places=places, tint=tint))
        start += len(triangles)
    return Frame(
        corners=np.concatenate(corners),
        normals=np.concatenate(normals),
        colours=np.concatenate(colours),
        coordinates=np.concatenate(coordinates),
        textures=np.concatenate(textures),
        images=subject.images,
        marks=tuple(marks),
    )


def _losses(body: Body) -> Floats:
    """(vertices,) compression against the stored pose, the mean of the triangles around each place."""
    part = body.piece.part
    stored = pose_part(part, None, np.zeros(1)).positions[0]
    triangles = part.triangles
    losses = compression(stored[triangles], body.positions[triangles])
    areas = np.sqrt(np.sum(face_normals(stored, triangles) ** 2, axis=1))
    # Vertices of a seam are one place.
    _, places = np.unique(part.vertices.positions, axis=0, return_inverse=True)
    places = places.reshape(-1)
    into = places[triangles].ravel()
    sums = np.bincount(into, np.repeat(losses * areas, 3), len(places))
    weights = np.bincount(into, np.repeat(areas, 3), len(places))
    means: Floats = (sums / np.where(weights > 0, weights, 1.0))[places]
    return means


def compression(rest: Floats, posed: Floats) -> Floats:
    """(triangles,) 1 - the smallest principal stretch of each triangle, at least 0; 0 where it has no area at rest.

    Args:
        rest: (triangles, 3, 3) corners.
        posed: (triangles, 3, 3).

    Source: principal stretches squared are the eigenvalues of the product of the posed metric of a triangle's edges
        and the inverse of that at rest.
    """
    before, after = (_metric(corners) for corners in (rest, posed))
    a, b, c = before.T
    area = a * c - b * b
    solid = area > 1e-12 * (a + c) ** 2
    area = np.where(solid, area, 1.0)
    p, q, r = after.T
    trace = (c * p - 2 * b * q + a * r) / area
    determinant = np.maximum(p * r - q * q, 0.0) / area
    largest = trace / 2 + np.sqrt(np.maximum(trace**2 / 4 - determinant, 0.0))
    smallest = np.sqrt(determinant / np.where(largest > 0, largest, 1.0))
    return np.where(solid, np.maximum(1.0 - smallest, 0.0), 0.0)


def _metric(corners: Floats) -> Floats:
    """(triangles, 3) products of the edges from the first corner: of one, of both, of the other."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([np.sum(p * q, axis=1) for p, q in ((first, first), (first, second), (second, second))], axis=1)
