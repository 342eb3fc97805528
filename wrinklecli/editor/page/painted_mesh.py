"""A mesh with vertex colours or a texture as a small .glb, because a mesh of viser has a single colour.

Source: glTF 2.0 §3.7 (geometry), §3.9 (materials).
"""

import numpy as np
import pygltflib

from wrinklecli.character.paints import WRAPS, Texture
from wrinklecli.gltf.document import COMPONENT_TYPES, SIZE_TYPES
from wrinklecli.gltf.pixels import Bytes, jpeg_of
from wrinklecli.numeric.arrays import Array, Floats, Ints

_MODES = {wrap: mode for mode, wrap in WRAPS.items()}
_ROUGHNESS = 0.9  # like skin or cloth: folds show by their shading, not by reflections

_MOST_PIXELS = 1024  # along each side of a texture, which the browser reads again in each frame; the view has no more


class PaintedMesh:
    """The parts of the .glb that stay while its vertices move: (triangles, 3) vertices, and a texture, as `image`.

    Each vertex has (vertices, 2) coordinates in the texture, which multiplies the vertex colours.
    """

    def __init__(self, triangles: Ints, coordinates: Floats, texture: Texture | None) -> None:
        self._fixed: list[Array] = [triangles.astype(np.uint32).reshape(-1, 1)]
        self.image = b""
        shine = pygltflib.PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=_ROUGHNESS)
        self._material = pygltflib.Material(doubleSided=True, pbrMetallicRoughness=shine)
        self._samplers: list[pygltflib.Sampler] = []
        if texture is not None:
            self._fixed.append(coordinates.astype(np.float32))
            self.image = image_of(texture.pixels)
            shine.baseColorTexture = pygltflib.TextureInfo(index=0)
            across, along = (_MODES[wrap] for wrap in texture.wraps)
            self._samplers.append(pygltflib.Sampler(wrapS=across, wrapT=along))

    def glb(self, positions: Floats, normals: Floats, colours: Floats) -> bytes:
        """Make the .glb of (vertices, 3) positions, unit normals and linear colours."""
        shades = np.full((len(colours), 4), 255, np.uint8)
        shades[:, :3] = np.round(255 * np.clip(colours, 0.0, 1.0))
        arrays = [*self._fixed, positions.astype(np.float32), normals.astype(np.float32), shades]
        # Without normals the browser would shade each triangle flat.
        attributes = {name: len(self._fixed) + k for k, name in enumerate(("POSITION", "NORMAL", "COLOR_0"))}
        if self.image:
            attributes["TEXCOORD_0"] = 1
        primitive = pygltflib.Primitive(attributes=pygltflib.Attributes(**attributes), indices=0, material=0)
        gltf = pygltflib.GLTF2(
            scene=0,
            scenes=[pygltflib.Scene(nodes=[0])],
            nodes=[pygltflib.Node(mesh=0)],
            meshes=[pygltflib.Mesh(primitives=[primitive])],
            materials=[self._material],
            accessors=[_accessor(number, array, array is shades) for number, array in enumerate(arrays)],
            samplers=self._samplers,
            textures=[pygltflib.Texture(source=0, sampler=0) for _ in self._samplers],
            images=[pygltflib.Image(bufferView=len(arrays), mimeType="image/jpeg") for _ in self._samplers],
        )
        parts = [*(array.tobytes() for array in arrays), *([self.image] if self.image else [])]
        start = 0
        for part in parts:
            gltf.bufferViews.append(pygltflib.BufferView(buffer=0, byteOffset=start, byteLength=len(part)))
            start += len(part)
        gltf.buffers = [pygltflib.Buffer(byteLength=start)]
        gltf.set_binary_blob(b"".join(parts))
        return b"".join(gltf.save_to_bytes())


def _accessor(view: int, array: Array, normalized: bool) -> pygltflib.Accessor:
    accessor = pygltflib.Accessor(
        bufferView=view,
        componentType=COMPONENT_TYPES[array.dtype],
        normalized=normalized,
        count=len(array),
        type=SIZE_TYPES[array.shape[1]],
    )
    if array.shape[1] == 3:
        accessor.min, accessor.max = array.min(axis=0).tolist(), array.max(axis=0).tolist()
    return accessor


def image_of(pixels: Bytes) -> bytes:
    """A JPEG of (height, width, 3) pixels, reduced for the browser."""
    return jpeg_of(_small(pixels))


def _small(pixels: Bytes) -> Bytes:
    """Average (height, width, 3) pixels in blocks, so that neither side is longer than the browser needs."""
    rows, columns = (-(-size // _MOST_PIXELS) for size in pixels.shape[:2])
    if rows == columns == 1:
        return pixels
    height, width = pixels.shape[0] // rows, pixels.shape[1] // columns
    blocks = pixels[: height * rows, : width * columns].reshape(height, rows, width, columns, 3)
    return np.asarray(blocks.mean(axis=(1, 3)).round().astype(np.uint8))
