"""The materials of a mesh on their textures: which set of coordinates maps take, and what its triangles have there."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from wrinklecli.baking.refined_mesh import RefinedPrimitive, old_values, primitives_of
from wrinklecli.character.paints import transformed
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct, unit
from wrinklecli.texture.relief import Textured
from wrinklecli.texture.texels import texture_steps

TexCoords: TypeAlias = Mapping[tuple[int, int | None], int]
"""The numbers of sets of texture coordinates that are for maps alone, by mesh and material."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The fine triangles of one material with their texture coordinates.

    Attributes:
        name: The material's, or the mesh's.
        material: Its number; None for primitives without one.
        texcoord: The number of the set of texture coordinates.
        transform: KHR_texture_transform of the texture whose coordinates are used; empty without.
        faces: (triangles,) numbers among the fine triangles.
        uvs: (triangles, 3, 2) after the transform.
        normals: (triangles, 3, 3) bind space.
        tangents: (triangles, 3, 3).
        hands: (triangles,).
    """

    name: str
    material: int | None
    texcoord: int
    transform: Json
    faces: Ints
    uvs: Floats
    normals: Floats
    tangents: Floats
    hands: Floats

    def textured(self, plan: MeshPlan, side: int) -> Textured:
        """The corners of its triangles, for a texture with so many samples of a side."""
        triangles, steps = plan.fine.triangles[self.faces], texture_steps(self.uvs, side)
        return Textured(triangles, self.normals, self.tangents, self.hands, steps)


def layouts_of(document: Document, plan: MeshPlan, texcoords: TexCoords) -> list[Layout]:
    """The materials of a mesh with texture coordinates; primitives without them are left out."""
    primitives = document.items("meshes")[plan.rig.mesh]["primitives"]
    parts: dict[int | None, list[Layout]] = {}
    for refined in primitives_of(plan.fine):
        primitive = primitives[refined.index]
        material = material_of(document, primitive)
        own = texcoords.get((plan.rig.mesh, material))
        texcoord, transform = _texture_of(document, material) if own is None else (own, {})
        uvs = _uvs(document, plan, refined, texcoord, transform)
        if uvs is None or not len(refined.triangles):
            continue
        normals, tangents = frames_of(document, plan, refined) or _frames(document, plan, refined, uvs)
        parts.setdefault(material, []).append(
            Layout(
                name=_name_of(document, material, plan),
                material=material,
                texcoord=texcoord,
                transform=transform,
                faces=np.flatnonzero(plan.fine.triangle_primitives == refined.index),
                uvs=_on_corners(refined, uvs),
                normals=_on_corners(refined, normals),
                tangents=_on_corners(refined, tangents[:, :3]),
                hands=np.where(_on_corners(refined, tangents[:, 3:])[..., 0].sum(axis=1) < 0, -1.0, 1.0),
            )
        )
    return [_joined(each) for each in parts.values()]


def frames_of(document: Document, plan: MeshPlan, refined: RefinedPrimitive) -> tuple[Floats, Floats] | None:
    """The (old vertices, 3) normals and (old vertices, 4) tangents that a primitive has in the asset's own textures.

    Tangents are those of TANGENT, or of the coordinates of its normal map or base colour. None if there are neither.
    """
    uvs = own_uvs(document, plan, refined)
    attributes = document.items("meshes")[plan.rig.mesh]["primitives"][refined.index].get("attributes", {})
    return None if uvs is None and "TANGENT" not in attributes else _frames(document, plan, refined, uvs)


def own_uvs(document: Document, plan: MeshPlan, refined: RefinedPrimitive) -> Floats | None:
    """(old vertices, 2) coordinates of a primitive's normal map or base colour; None if it has none."""
    primitive = document.items("meshes")[plan.rig.mesh]["primitives"][refined.index]
    return _uvs(document, plan, refined, *_texture_of(document, material_of(document, primitive)))


def _frames(document: Document, plan: MeshPlan, refined: RefinedPrimitive, uvs: Floats | None) -> tuple[Floats, Floats]:
    """Give the frames of `frames_of`, by (old vertices, 2) coordinates if the primitive has no TANGENT."""
    attributes = document.items("meshes")[plan.rig.mesh]["primitives"][refined.index].get("attributes", {})
    where = document.where("meshes", plan.rig.mesh, "primitives", refined.index)
    old = np.arange(len(refined.old))
    if "NORMAL" in attributes:
        normals = unit(old_values(document, attributes, "NORMAL", refined, size=3, where=where))
    else:
        normals = plan.fine.normals_at(refined.weld[old])
    if uvs is None or "TANGENT" in attributes:
        return normals, old_values(document, attributes, "TANGENT", refined, size=4, where=where)
    surface = plan.fine.surface
    own = surface.corners[surface.primitives == refined.index] - refined.old[0]
    return normals, mikk_tangents(surface.positions[refined.weld[old]], normals, uvs, own)


def _uvs(
    document: Document, plan: MeshPlan, refined: RefinedPrimitive, texcoord: int, transform: Json
) -> Floats | None:
    """(old vertices, 2) coordinates of a set, transformed; None if the primitive has no such set."""
    attributes = document.items("meshes")[plan.rig.mesh]["primitives"][refined.index].get("attributes", {})
    key = f"TEXCOORD_{texcoord}"
    if key not in attributes:
        return None
    where = document.where("meshes", plan.rig.mesh, "primitives", refined.index)
    return transformed(old_values(document, attributes, key, refined, size=2, where=where), transform)


def material_of(document: Document, primitive: Json) -> int | None:
    """The number of a primitive's material; None without one, or if there is none of that number."""
    number = primitive.get("material")
    return number if isinstance(number, int) and 0 <= number < len(document.items("materials")) else None


def _on_corners(refined: RefinedPrimitive, values: Floats) -> Floats:
    """(triangles, 3, …) of (old vertices, …) values of a primitive."""
    return np.concatenate([values, refined.mix(values)])[refined.triangles]


def _joined(parts: Sequence[Layout]) -> Layout:
    """The primitives of one material as one."""
    return replace(
        parts[0],
        faces=np.concatenate([each.faces for each in parts]),
        uvs=np.concatenate([each.uvs for each in parts]),
        normals=np.concatenate([each.normals for each in parts]),
        tangents=np.concatenate([each.tangents for each in parts]),
        hands=np.concatenate([each.hands for each in parts]),
    )


def _texture_of(document: Document, material: int | None) -> tuple[int, Json]:
    """The set of coordinates and the transform that a map takes: the normal map's, or else the base colour's.

    Raises:
        AssetError: An entry is malformed.
    """
    if material is None:
        return 0, {}
    where = document.where("materials", material)
    try:
        known = document.items("materials")[material]
        base = known.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        texture = known.get("normalTexture") or base or {}
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        transformed(np.zeros((1, 2)), transform)
        return int(transform.get("texCoord", texture.get("texCoord", 0))), transform
    except (TypeError, ValueError, AttributeError) as error:
        raise AssetError(f"its texture is malformed: {error}", where=where) from error


def _name_of(document: Document, material: int | None, plan: MeshPlan) -> str:
    named = document.items("materials")[material].get("name") if material is not None else None
    return str(named or plan.rig.node_name)


def mikk_tangents(positions: Floats, normals: Floats, uvs: Floats, triangles: Ints) -> Floats:
    """(vertices, 4) unit tangents along u, and the handedness of the texture.

    Args:
        positions: (vertices, 3).
        normals: (vertices, 3) unit.
        uvs: (vertices, 2), v downwards as in glTF.
        triangles: (triangles, 3).

    Source: M. Mikkelsen, *Simulation of Wrinkled Surfaces Revisited*, 2008, and glTF 2.0 §3.7.2.1, which asks for
    MikkTSpace where TANGENT is missing. Differs: faces of one vertex whose texture is mirrored share it only if the
    file has vertices of its own for either side, as exporters write them.
    """
    corners, texture = positions[triangles], uvs[triangles] * [1.0, -1.0]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    d1, d2 = texture[:, 1] - texture[:, 0], texture[:, 2] - texture[:, 0]
    area = signed_areas(texture)
    along = unit((d2[:, 1:] * e1 - d1[:, 1:] * e2) * np.sign(area)[:, None])
    # Vertices of one place, normal and texture are one, whatever else tells them apart.
    _, merged = distinct(np.concatenate([positions, normals, uvs], axis=1))
    sums, signs = np.zeros((len(positions), 3)), np.zeros(len(positions))
    for corner in range(3):
        vertices = triangles[:, corner]
        normal = normals[vertices]
        before, after = (_flat(corners[:, (corner + step) % 3] - corners[:, corner], normal) for step in (2, 1))
        angles = np.arccos(np.clip(np.sum(before * after, axis=1), -1.0, 1.0))
        np.add.at(sums, merged[vertices], angles[:, None] * _flat(along, normal))
        np.add.at(signs, merged[vertices], np.sign(area))
    return np.column_stack([unit(sums[merged]), np.where(signs[merged] < 0, -1.0, 1.0)])


def signed_areas(uvs: Floats) -> Floats:
    """(triangles,) twice the areas of (triangles, 3, 2) on a texture, with the sign of their turn."""
    e1, e2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    return np.asarray(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])


def _flat(vectors: Floats, normals: Floats) -> Floats:
    """(…, 3) unit vectors in the planes across unit normals."""
    return unit(vectors - np.sum(vectors * normals, axis=1, keepdims=True) * normals)
