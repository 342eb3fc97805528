"""Masks: factors on the height of a tool that an artist has painted, on vertices or in an image.

An attribute is mixed like all other attributes of new vertices. An image is looked up at the texture coordinates of
the refined vertices, so a coarse mesh can have a fine mask.
"""

import os

import numpy as np

from wrinklecli.character.rig import in_range
from wrinklecli.errors import AssetError, BakeError, listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import read_file
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Array, Floats, Ints, bilinear, children, distinct_values
from wrinklecli.numeric.memory import once
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.tools.body import Flesh, Touch
from wrinklecli.tools.fields import Field
from wrinklecli.tools.files_beside import path_beside
from wrinklecli.tools.records import MaskAttribute, MaskImage, WrinkleTool

# Parts of a coarse triangle's edge between the points at which a mask is looked at before refinement: as fine as four
# levels, the default of `max_levels`, make the vertices.
_PARTS = 16
# Fewest parts: of a border that only cuts a corner off, a quarter of an edge is missed at most.
_FEWEST_PARTS = 4
# Excess over 0 to 1 that rounding of stored numbers may leave.
_ROUNDING = 1e-3
# Bytes that an image takes for each pixel: four channels while it is read, then float32.
_PIXEL_BYTES = 8


@dataclass(frozen=True, slots=True)
class Mask:
    """A factor on the height of a tool, from 0 to 1 at each point of the mesh.

    Attributes:
        painted: (glTF vertices, 1) factors, or (glTF vertices, 2) texture coordinates if there is an image.
        image: (height, width) factors; None for factors of vertices.
    """

    painted: Floats
    image: Array | None

    def at(self, painted: Floats) -> Floats:
        """(points,) factors at mixtures of `painted`, (points, 1 or 2); pixels are mixed linearly, and clamped."""
        if self.image is None:
            return painted[:, 0]
        height, width = self.image.shape
        pixels = painted[:, ::-1] * (height, width) - 0.5
        return bilinear(self.image, np.clip(pixels, 0.0, (height - 1.0, width - 1.0)))

    def welded(self, weld: Ints, count: int) -> Floats:
        """(vertices,) mean factors of so many welded vertices, from the (glTF vertices,) welded vertex of each."""
        counts = np.bincount(weld, minlength=count)
        return np.asarray(np.bincount(weld, self.at(self.painted), count) / np.maximum(counts, 1))

    def over(self, corners: Ints) -> Floats:
        """(triangles, points) factors at points spread evenly over coarse triangles with (triangles, 3) corners."""
        spots = spread(self.painted[corners])
        return self.at(spots.reshape(-1, spots.shape[2])).reshape(spots.shape[:2])

    def errors(self, corners: Ints, barycentrics: Floats, level: int) -> Floats:
        """(faces,) greatest difference between the factors on each face and linear mixtures of those at its corners.

        All levels of refinement are looked at equally finely. Attributes are linear, so their errors are 0.
        """
        if self.image is None:
            return np.zeros(len(corners))
        grid = _grid(max(_PARTS >> level, _FEWEST_PARTS))
        ends = np.einsum("fcs,fsd->fcd", barycentrics, self.painted[corners])
        spots = np.einsum("pc,fcd->fpd", grid, ends)
        mixed = self.at(ends.reshape(-1, 2)).reshape(-1, 3) @ grid.T
        return np.asarray(np.abs(self.at(spots.reshape(-1, 2)).reshape(mixed.shape) - mixed).max(axis=1))

    def on_refined(self, fine: Refinement, members: Ints, vertices: Ints) -> Floats:
        """(vertices,) factors at sorted vertices of the children of coarse `members`.

        A vertex on a seam has several places in an image; it gets their mean, so that the surface does not tear.
        """
        corners = distinct_values(fine.corners[children(fine.subdivision.parents, members)])
        old = len(self.painted)
        painted = np.zeros((len(corners), self.painted.shape[1]))
        is_new = corners >= old
        painted[~is_new] = self.painted[corners[~is_new]]
        new = corners[is_new] - old
        painted[is_new] = np.einsum("vs,vsd->vd", fine.shares[new], self.painted[fine.sources[new]])
        at = np.searchsorted(vertices, fine.weld[corners])
        counts = np.bincount(at, minlength=len(vertices))
        sums = np.bincount(at, self.at(painted), minlength=len(vertices))
        return np.asarray(sums / np.maximum(counts, 1), np.float64)


def _grid(parts: int) -> Floats:
    """(points, 3) barycentric coordinates of an even grid on a triangle with so many parts of each edge."""
    i, j = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
    chosen = i + j <= parts
    i, j = i[chosen], j[chosen]
    return np.stack([i, j, parts - i - j], axis=1) / parts


_GRID = _grid(_PARTS)


def spread(corners: Floats) -> Floats:
    """(triangles, points, …) values at points spread evenly over triangles, from (triangles, 3, …) at their corners."""
    return np.asarray(np.einsum("pc,tcd->tpd", _GRID, corners))


def read_mask(tool: WrinkleTool | Flesh | Touch | Field, ground: Ground, members: Ints) -> Mask | None:
    """Read the mask of a tool, on the primitives of its coarse `members`; None if it has none.

    Raises:
        WrinkleError: The attribute or the image is missing or malformed.
    """
    if tool.mask is None:
        return None
    primitives = distinct_values(ground.surface.primitives[members])
    if isinstance(tool.mask, MaskAttribute):
        mask, where = tool.mask, tool.place("mask", "attribute")
        painted = _attribute(ground, primitives, mask.name, where)
        if mask.component >= painted.shape[1]:
            message = f"{mask.name} has {painted.shape[1]} components: there is no {mask.attribute[-1]}"
            raise BakeError(message, where=where)
        chosen = painted[:, mask.component, None]
        used = chosen[distinct_values(ground.surface.corners[members])]
        low, high = float(used.min()), float(used.max())
        if low < -_ROUNDING or high > 1.0 + _ROUNDING:
            raise BakeError(f"{mask.attribute} is {low:g} to {high:g} under the tool, expected 0 to 1", where=where)
        return Mask(np.clip(chosen, 0.0, 1.0), None)
    coordinates = mask_coordinates(tool, tool.mask, ground, members)
    return Mask(coordinates, _image(tool.mask, ground, tool.place("mask", "image")))


def mask_coordinates(
    tool: WrinkleTool | Flesh | Touch | Field, mask: MaskImage, ground: Ground, members: Ints
) -> Floats:
    """(glTF vertices, 2) texture coordinates of an image on the primitives of a tool's coarse `members`.

    Raises:
        WrinkleError: They are missing or malformed.
    """
    name, where = f"TEXCOORD_{mask.texcoord}", tool.place("mask", "texcoord")
    coordinates = _attribute(ground, distinct_values(ground.surface.primitives[members]), name, where)
    if coordinates.shape[1] != 2:
        raise BakeError(f"{name} has {coordinates.shape[1]} components, expected 2", where=where)
    return coordinates


def _attribute(ground: Ground, primitives: Ints, name: str, where: str) -> Floats:
    """(glTF vertices, components) of an attribute that some primitives must have; 0 for all others."""
    document, surface = ground.document, ground.surface
    stored: list[Json] = document.items("meshes")[ground.rig.mesh]["primitives"]
    parts: dict[int, Floats] = {}
    for number in primitives.tolist():
        attributes = stored[number]["attributes"]
        if name not in attributes:
            several = f"primitive {number} of " if len(stored) > 1 else ""
            raise BakeError(
                f"{several}the mesh of {ground.rig.node_name} has no {name}; it has {listed(attributes)}",
                where=where,
            )
        user = document.where("meshes", ground.rig.mesh, "primitives", number)
        values = document.accessor(attributes[name], user=user)
        count = int(surface.vertex_starts[number + 1] - surface.vertex_starts[number])
        if len(values) != count or not in_range(values):
            raise AssetError(f"{name} must hold finite numbers for {count} vertices", where=user)
        parts[number] = values.astype(np.float64).reshape(count, -1)
    widths = {each.shape[1] for each in parts.values()}
    painted = np.zeros((len(surface.weld), min(widths)))
    for number, values in parts.items():
        painted[surface.vertex_starts[number] : surface.vertex_starts[number + 1]] = values[:, : painted.shape[1]]
    return painted


def _image(mask: MaskImage, ground: Ground, where: str) -> Array:
    """(height, width) factors of an image, which is read once for all tools of a mesh, unless it changes.

    Raises:
        BakeError: It cannot be read, or is not below the folder of the tools file.
    """
    document, beside = ground.document, os.path.join(mask.folder, "tools")
    path = path_beside(beside, mask.image, external=document.allow_external)
    if path is None:
        hint = "others are read with --allow-external"
        raise BakeError(f"{mask.image!r} is not a file below the folder of the tools file; {hint}", where=where)
    try:
        found = os.stat(path)
    except OSError as error:
        raise BakeError(f"{mask.image!r} cannot be read: {error.strerror}", where=where) from error
    key = (path, mask.channel, found.st_mtime_ns, found.st_size)

    def make() -> Floats:
        from wrinklecli.gltf.pixels import read_channel  # few masks are images

        data = read_file(path, memory=document.memory, where=where)
        try:
            values = read_channel(data, mask.channel)
        except ImportError as error:
            message = f"a mask in an image needs Pillow ({error}): pip install 'wrinklecli[preview]'"
            raise BakeError(message, where=where) from error
        except ValueError as error:
            raise BakeError(f"{mask.image!r} {error}", where=where) from error
        document.memory.claim(_PIXEL_BYTES * values.size, f"an image of {values.size} pixels", where=where)
        return values

    return once(ground.known, key, make)
