"""A further set of texture coordinates for wrinkle maps, in a copy of the asset; all else of the asset stays.

Only what tools move takes texels: all other triangles lie on one point of the texture, where nothing rises. Each piece
is measured in its narrowest bumps, so that all bumps get as many texels.

Source: J. Young, *xatlas*, after I. Castaño, *thekla_atlas*; glTF 2.0 §3.7.2.1 (attributes).
"""

import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import count

import numpy as np

from wrinklecli.baking.job import Job
from wrinklecli.baking.refined_mesh import primitives_of
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.plan import skin_parts
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.edited_document import VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.split_mesh import DividedPrimitive
from wrinklecli.numeric.arrays import Floats, Ints, any_of, components, flags_of, groups_of, renumbered, unit
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.texture.layout import TexCoords, frames_of, material_of, mikk_tangents, own_uvs, signed_areas
from wrinklecli.texture.map_set import GUTTER

# Texels between charts, which so stay apart in the first two of the smaller images that a GPU makes of a texture.
_PADDING = 4
# Columns at the right without charts: those of a gutter, and two that a filter reads where nothing rises.
_FLAT = GUTTER + 2
# Cosine of the angle between tangents of one place that count as one: it turns a wrinkle of 45° by 2° at most.
_SAME_FRAME = math.cos(math.radians(2.0))
# Bytes that a triangle takes at most while it is unwrapped, as measured on sheets of 5,000 to 57,000 triangles.
_TRIANGLE_BYTES = 1100


def require_xatlas() -> None:
    """Raise BakeError if xatlas is not installed."""
    try:
        import xatlas  # noqa: F401
    except ImportError as error:
        raise BakeError(f"--unwrap needs xatlas ({error}): pip install 'wrinklecli[unwrap]'") from error


def unwrapped(
    job: Job, plans: Sequence[MeshPlan], size: int, progress: Progress = log_progress
) -> tuple[EditedDocument, TexCoords]:
    """Unwrap what the tools of a job move, for images of so many texels of a side.

    Returns:
        The asset with the new coordinates, and for each mesh and material that has them the number of their set.

    Raises:
        WrinkleError: Memory does not hold so many triangles, or an attribute is malformed.
    """
    by_mesh: dict[int, list[MeshPlan]] = defaultdict(list)
    for plan in plans:
        by_mesh[plan.rig.mesh].append(plan)
    wrinkled = [each for own in by_mesh.values() for each in _wrinkled(job, own)]
    edited = EditedDocument(job.asset)
    for each in wrinkled:
        for mesh, number in each.places.values():
            edited.unpack(edited.gltf["meshes"][mesh]["primitives"][number])
    edited = edited.continued()
    texcoords = {}
    for done, each in enumerate(wrinkled):
        progress("unwrap", done, len(wrinkled))
        texcoords[each.plan.rig.mesh, each.material] = _unwrap(job, edited, each, size)
    return edited, texcoords


@dataclass(frozen=True, slots=True)
class _Wrinkled:
    """The primitives of one mesh and one material, of which tools move something.

    Attributes:
        places: For each primitive of the mesh its mesh and number in the asset, where meshes may not be joined.
        faces: (triangles,) of the mesh that tools move.
        widths: (triangles,) of the mesh, the narrowest bump on each, scene units.
    """

    plan: MeshPlan
    material: int | None
    places: dict[int, tuple[int, int]]
    faces: Ints
    widths: Floats


def _wrinkled(job: Job, plans: Sequence[MeshPlan]) -> Iterator[_Wrinkled]:
    """The materials of one mesh, which one or several nodes show, that tools move."""
    plan, surface = plans[0], plans[0].fine.surface
    widths = np.full(len(surface.triangles), np.inf)
    for each in plans:
        for part in skin_parts(each):
            moved = any_of(flags_of(part.vertices, len(each.fine.positions)), each.fine.triangles)
            corners = surface.triangles[each.fine.subdivision.parents[moved]]
            # Maps refine further than a bake, and so reach beyond the triangles that it moves.
            near = any_of(flags_of(corners.ravel(), len(surface.positions)), surface.triangles)
            widths[near] = np.minimum(widths[near], part.attached.bump_width)
    numbers: dict[int | None, list[int]] = defaultdict(list)
    for number, primitive in enumerate(job.document.items("meshes")[plan.rig.mesh]["primitives"]):
        if (surface.primitives == number).any():
            numbers[material_of(job.document, primitive)].append(number)
    for material, own in numbers.items():
        faces = np.flatnonzero(np.isin(surface.primitives, own) & np.isfinite(widths))
        if len(faces):
            places = {number: _place(job, plan, number) for number in own}
            yield _Wrinkled(plan, material, places, faces, widths)


def _place(job: Job, plan: MeshPlan, number: int) -> tuple[int, int]:
    """The mesh and the number in the asset of a primitive of the document's mesh, which may be joined of several."""
    joined = job.joined.get(plan.rig.node)
    if joined is None:
        return plan.rig.mesh, number
    which = bisect_right(joined.starts, number) - 1
    return job.asset.items("nodes")[joined.nodes[which]]["mesh"], number - joined.starts[which]


def _unwrap(job: Job, edited: EditedDocument, wrinkled: _Wrinkled, size: int) -> int:
    """Give primitives a set of texture coordinates, whose number is the first that is free in all of them."""
    surface, memory = wrinkled.plan.fine.surface, job.document.memory
    said = f"{len(wrinkled.faces)} triangles, unwrapped,"
    memory.check(_TRIANGLE_BYTES * len(wrinkled.faces), said, where=job.document.path)
    ids, uvs = _charts(wrinkled, _frames(job, wrinkled), size)
    flat = 1.0 - 0.5 / size
    uvs = np.concatenate([uvs, [[flat, flat]]]).astype(np.float32)  # the last is that of what no tool moves
    of_faces = np.full((len(surface.triangles), 3), len(uvs) - 1)
    of_faces[wrinkled.faces] = ids
    meshes = edited.gltf["meshes"]
    texcoord = max(_sets(meshes[mesh]["primitives"][number]) for mesh, number in wrinkled.places.values())
    for local, (mesh, number) in wrinkled.places.items():
        own = surface.primitives == local
        corners = surface.corners[own] - surface.vertex_starts[local]
        primitives = meshes[mesh]["primitives"]
        primitive = primitives[number]
        attributes, has_frames = dict(primitive["attributes"]), _may_have_tangents(job, primitive)
        # Its vertices keep their order; those that need several coordinates are repeated behind them.
        count = len(edited.source.stored(attributes["POSITION"]))
        pairs, which = renumbered(corners * len(uvs) + of_faces[own])
        vertices, coordinates = np.divmod(pairs, len(uvs))
        again = np.diff(vertices, prepend=-1) == 0
        made = primitive
        if again.any():
            order = np.concatenate([np.flatnonzero(~again), np.flatnonzero(again)])
            ranks = np.argsort(order)
            vertices, coordinates, corners = vertices[order], coordinates[order], ranks[which]
            divided = DividedPrimitive(edited, primitive)
            made = divided.take(vertices, corners, range(len(primitive.get("targets", []))))
            of_vertices = uvs[coordinates]
        else:
            of_vertices = np.tile(uvs[-1], (count, 1))
            of_vertices[vertices] = uvs[coordinates]
            vertices = np.arange(count)
        added = edited.add(of_vertices, target=VERTEX_DATA)
        # Sets before it that the primitive lacks are the same.
        made["attributes"] |= {f"TEXCOORD_{each}": added for each in range(_sets(primitive), texcoord + 1)}
        if has_frames:
            positions, normals = (edited.source.accessor(attributes[name])[vertices] for name in ("POSITION", "NORMAL"))
            tangents = _tangents(positions, unit(normals), of_vertices.astype(np.float64), corners)
            made["attributes"]["TANGENT"] = edited.add(tangents.astype(np.float32), target=VERTEX_DATA)
        primitives[number] = made
    return texcoord


def _sets(primitive: Json) -> int:
    """The number of the first set of texture coordinates that a primitive lacks."""
    return next(number for number in count() if f"TEXCOORD_{number}" not in primitive["attributes"])


def _frames(job: Job, wrinkled: _Wrinkled) -> Floats:
    """(triangles, 3, 4) tangents of the corners of the triangles that tools move; equal ones where none are given."""
    plan, document = wrinkled.plan, job.document
    surface = plan.fine.surface
    frames = np.tile([1.0, 0.0, 0.0, 1.0], (len(surface.triangles), 3, 1))
    primitives = document.items("meshes")[plan.rig.mesh]["primitives"]
    for refined in primitives_of(plan.fine):
        primitive = primitives[refined.index]
        if refined.index not in wrinkled.places or _may_have_tangents(job, primitive):
            continue
        own = surface.primitives == refined.index
        corners, found = surface.corners[own] - refined.old[0], frames_of(document, plan, refined)
        if found is not None:
            frames[own] = found[1][corners]
        uvs = own_uvs(document, plan, refined)
        if uvs is not None and "TANGENT" not in primitive["attributes"]:
            # Files without TANGENT often have one vertex for both sides of a mirrored texture.
            frames[own, :, 3] = np.where(signed_areas(uvs[corners]) < 0.0, -1.0, 1.0)[:, None]
    return frames[wrinkled.faces]


def _may_have_tangents(job: Job, primitive: Json) -> bool:
    """True for a primitive that has no tangents, and whose material does not ask for those of its own textures.

    Then maps are its only normal map, and tangents are theirs (glTF 2.0 §3.7.2.1).
    """
    attributes, number = primitive["attributes"], material_of(job.document, primitive)
    material = {} if number is None else job.document.items("materials")[number]
    extensions = material.get("extensions", {})
    own = material.get("normalTexture") or "KHR_materials_anisotropy" in extensions
    own = own or "clearcoatNormalTexture" in extensions.get("KHR_materials_clearcoat", {})
    return "NORMAL" in attributes and "TANGENT" not in attributes and not own


def _pieces(triangles: Ints, frames: Floats) -> Ints:
    """(triangles,) the piece of each of (triangles, 3): pieces end where the (triangles, 3, 4) frames jump.

    Slopes of maps are told in these frames, and texels on both sides of a jump would be mixed.
    """
    pairs = [[corner, (corner + 1) % 3] for corner in range(3)]
    edges = np.concatenate([triangles[:, pair] for pair in pairs])
    ends = np.concatenate([frames[:, pair] for pair in pairs])
    back = edges[:, 0] > edges[:, 1]
    edges[back], ends[back] = edges[back][:, ::-1], ends[back][:, ::-1]
    order = np.lexsort(edges.T)
    edges, ends, faces = edges[order], ends[order], np.tile(np.arange(len(triangles)), 3)[order]
    alike = np.sum(ends[1:, :, :3] * ends[:-1, :, :3], axis=2) >= _SAME_FRAME
    alike &= ends[1:, :, 3] * ends[:-1, :, 3] > 0.0
    same = (edges[1:] == edges[:-1]).all(axis=1) & alike.all(axis=1)
    return components(np.column_stack([faces[1:], faces[:-1]])[same], len(triangles))


def _charts(wrinkled: _Wrinkled, frames: Floats, size: int) -> tuple[Ints, Floats]:
    """Unwrap triangles without overlap.

    Args:
        wrinkled: The triangles.
        frames: (triangles, 3, 4) tangents.
        size: Texels of a side.

    Returns:
        (triangles, 3) numbers of coordinates, and (coordinates, 2).
    """
    import xatlas

    faces, fine = wrinkled.faces, wrinkled.plan.fine
    groups = groups_of(_pieces(fine.surface.triangles[faces], frames))
    atlas = xatlas.Atlas()
    for group in groups:
        vertices, corners = renumbered(fine.surface.triangles[faces[group]])
        places = fine.rest_positions[vertices]
        measured = (places - places.mean(axis=0)) / wrinkled.widths[faces[group]].min()
        atlas.add_mesh(measured.astype(np.float32), corners.astype(np.uint32))
    packing = xatlas.PackOptions()
    packing.padding, packing.resolution = _PADDING, size - _FLAT
    atlas.generate(xatlas.ChartOptions(), packing)
    sides = np.array([atlas.width, atlas.height])
    ids, uvs, count = np.zeros((len(faces), 3), np.intp), [], 0
    for number, group in enumerate(groups):
        _, indices, found = atlas[number]
        ids[group] = indices.astype(np.intp).reshape(-1, 3) + count
        uvs.append(found * (sides / max(sides.max(), 1) * (size - _FLAT) / size))
        count += len(found)
    return ids, np.concatenate(uvs)


def _tangents(positions: Floats, normals: Floats, uvs: Floats, triangles: Ints) -> Floats:
    """(vertices, 4) as of `mikk_tangents`, and any tangent where the texture is one point."""
    tangents = mikk_tangents(positions, normals, uvs, triangles)
    lost = np.flatnonzero(~tangents[:, :3].any(axis=1))
    least = np.eye(3)[np.abs(normals[lost]).argmin(axis=1)]
    across = np.cross(normals[lost], least)
    tangents[lost, :3] = np.where(np.any(across, axis=1)[:, None], unit(across), [1.0, 0.0, 0.0])
    return tangents
