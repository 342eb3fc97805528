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
from wrinklecli.character.scene import ScenePrimitive, pose_primitive, read_scene
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import linear_rgb
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, unit
from wrinklecli.review.preview.draw import Mark
from wrinklecli.review.preview.heat import compressions, heat_colours
from wrinklecli.review.preview.materials import Texture, read_texture, texture_coordinates, texture_info, vertex_colours
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.render import Frame

Colour = tuple[float, float, float]

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

    part: ScenePrimitive
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
            posed = pose_primitive(piece.part, clip, times)
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
            info = texture_info(document, primitive)
            if info:
                coordinates = texture_coordinates(document, primitive, info, count)
                key = repr(info)
                if key not in read:
                    images.append(read_texture(document, info))
                    read[key] = len(images) - 1
                texture = read[key]
        except (AssetError, ArithmeticError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
            # Without a texture a picture still shows the wrinkles.
            warnings.append(f"{part.where}: drawn without its texture: {error}")
        pieces.append(
            Piece(
                part=part,
                colours=part.colour * vertex_colours(document, primitive, count),
                coordinates=coordinates,
                texture=texture,
                shapes=part.vertices.morph_deltas[numbers],
                shape_numbers=numbers,
                marks=tuple(_marks(part, plans)),
            )
        )
    return Subject(label, document, read_clips(document), tuple(pieces), tuple(images))


def _wrinkle_targets(document: Document, part: ScenePrimitive) -> Ints:
    """(shapes,) numbers of the morph targets that a bake has added, by the node's extras."""
    names: set[str] = set()
    extras = document.items("nodes")[part.rig.node].get("extras")
    try:
        entry = extras["wrinkle"] if isinstance(extras, dict) else {}
        names = {name for tool in entry["tools"] for name in tool["targets"]} | set(entry.get("undriven", ()))
    except (KeyError, TypeError, AttributeError):
        pass  # not what a bake writes: nothing is known of wrinkles
    return np.array([k for k, name in enumerate(part.rig.morph_names) if name in names], np.intp)


def _marks(part: ScenePrimitive, plans: Sequence[MeshPlan]) -> Iterator[Mark]:
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
        painted = linear_rgb(heat_colours(compressions(piece.part, body.positions))) if heat else piece.colours
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
