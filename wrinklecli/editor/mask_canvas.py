"""A mask that is painted on a mesh: an image in its texture coordinates, with the place of each texel at rest."""

import numpy as np

from wrinklecli.errors import ConfigError
from wrinklecli.gltf.pixels import Bytes, png_of
from wrinklecli.numeric.arrays import Floats, Ints, flags_of
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.mask import mask_coordinates, read_mask
from wrinklecli.texture.texels import covered, gutter
from wrinklecli.tools.body import Flesh, Touch
from wrinklecli.tools.fields import Field
from wrinklecli.tools.records import MaskAttribute, MaskImage, WrinkleTool

# Texels of a side: a place that covers a hundredth of a texture has a hundred of them across.
_SIZE = 1024
# Width of the border that is filled around charts, texels; a mask mixes the two on either side of a place.
_GUTTER = 2


class MaskCanvas:
    """The mask of a tool on (triangles,) members of a mesh, which a brush darkens where wrinkles shall be low.

    Attributes:
        node: Number of the node with the mesh.
        coordinates: (glTF vertices, 2) texture coordinates.
        pixels: (size, size) factors, 255 for 1.

    Raises:
        WrinkleError: The mesh has no texture coordinates, or the tool has a mask on vertices.
    """

    def __init__(self, tool: WrinkleTool | Flesh | Touch | Field, ground: Ground, members: Ints) -> None:
        if isinstance(tool.mask, MaskAttribute):
            raise ConfigError("has a mask on vertices; a brush paints images", where=tool.place("mask"))
        asked = tool.mask or MaskImage("")
        self.node, self.coordinates = ground.rig.node, mask_coordinates(tool, asked, ground, members)
        self.texcoord = asked.texcoord
        self.pixels = np.full((_SIZE, _SIZE), 255, np.uint8)
        if (mask := read_mask(tool, ground, members)) is not None:
            middles = (np.arange(_SIZE) + 0.5) / _SIZE
            spots = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
            self.pixels = np.round(255 * mask.at(spots)).astype(np.uint8).reshape(_SIZE, _SIZE)
        corners, triangles = self.coordinates[ground.surface.corners], ground.surface.triangles
        # A mask does not repeat beyond the image.
        within = np.flatnonzero(((corners >= 0.0) & (corners <= 1.0)).all(axis=(1, 2)))
        hits = list(covered(corners[within], _SIZE))
        self._texels = np.concatenate([np.zeros(0, np.intp), *(texels for texels, _, _ in hits)])
        found = [ground.rest.positions[triangles[within[which]]] for _, which, _ in hits]
        places = [np.einsum("hk,hkx->hx", shares, each) for each, (_, _, shares) in zip(found, hits, strict=True)]
        self._places = np.concatenate([np.zeros((0, 3)), *places])

    def paint(self, start: Floats, end: Floats, radius: float, *, back: bool) -> bool:
        """Move a soft brush over the surface between two (3,) places at rest; False if no texel is there.

        The factor falls from 1 at the radius to 0 at half of it, or with `back` rises.
        """
        way = end - start
        along = np.clip((self._places - start) @ way / max(float(way @ way), np.finfo(float).tiny), 0.0, 1.0)
        distances = np.linalg.norm(self._places - start - along[:, None] * way, axis=1)
        near = distances < radius
        factors = np.round(255 * np.clip(2.0 * distances[near] / radius - 1.0, 0.0, 1.0)).astype(np.uint8)
        painted, texels = self.pixels.reshape(-1), self._texels[near]
        if back:
            np.maximum.at(painted, texels, 255 - factors)
        else:
            np.minimum.at(painted, texels, factors)
        return bool(near.any())

    @property
    def shown(self) -> Bytes:
        """(size, size, 3) pixels as a texture."""
        return self.pixels[..., None].repeat(3, axis=2)

    def png(self) -> bytes:
        """The image, with the border around charts filled."""
        filled = flags_of(self._texels, _SIZE * _SIZE)
        beside, inside = gutter(filled.reshape(_SIZE, _SIZE), _GUTTER)
        done = self.pixels.copy().reshape(-1)
        done[beside] = done[inside]
        return png_of(done.reshape(_SIZE, _SIZE))
