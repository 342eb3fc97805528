"""A mesh with vertex colours or a texture as a small .glb, because a mesh of viser has a single colour.

Source: glTF 2.0 §4.4 (GLB), §3.7 (geometry), §3.9 (materials).
"""

import json
import struct

import numpy as np

from wrinklecli.character.paints import WRAPS, Texture
from wrinklecli.gltf.document import BIN_CHUNK, COMPONENT_TYPES, GLB_MAGIC, JSON_CHUNK, SIZE_TYPES, TRIANGLES
from wrinklecli.gltf.pixels import Bytes, jpeg_of
from wrinklecli.numeric.arrays import Array, Floats, Ints

_MODES = {wrap: mode for mode, wrap in WRAPS.items()}
_ROUGHNESS = 0.9  # like skin or cloth: folds show by their shading, not by reflections

_MOST_PIXELS = 1024  # along each side of a texture, which the browser reads again in each frame; the view has no more


class PaintedMesh:
    """The parts of the .glb that stay while its vertices move: (triangles, 3) vertices, and a texture.

    Each vertex has (vertices, 2) coordinates in the texture, which multiplies the vertex colours.
    """

    def __init__(self, triangles: Ints, coordinates: Floats, texture: Texture | None) -> None:
        self._fixed: list[Array] = [triangles.astype(np.uint32).reshape(-1, 1)]
        self._image = b""
        self._material: dict[str, object] = {"metallicFactor": 0.0, "roughnessFactor": _ROUGHNESS}
        self._sampler = {}
        if texture is not None:
            self._fixed.append(coordinates.astype(np.float32))
            self._image = jpeg_of(_small(texture.pixels))
            self._material["baseColorTexture"] = {"index": 0}
            self._sampler = {key: _MODES[wrap] for key, wrap in zip(("wrapS", "wrapT"), texture.wraps, strict=True)}

    def glb(self, positions: Floats, normals: Floats, colours: Floats) -> bytes:
        """Make the .glb of (vertices, 3) positions, unit normals and linear colours."""
        shades = np.full((len(colours), 4), 255, np.uint8)
        shades[:, :3] = np.round(255 * np.clip(colours, 0.0, 1.0))
        arrays = [*self._fixed, positions.astype(np.float32), normals.astype(np.float32), shades]
        # Without normals the browser would shade each triangle flat.
        attributes = {name: len(self._fixed) + k for k, name in enumerate(("POSITION", "NORMAL", "COLOR_0"))}
        if self._image:
            attributes["TEXCOORD_0"] = 1
        accessors, views, parts, start = [], [], [], 0
        for number, array in enumerate(arrays):
            accessor: dict[str, object] = {
                "bufferView": number,
                "componentType": COMPONENT_TYPES[array.dtype],
                "count": len(array),
                "type": SIZE_TYPES[array.shape[1]],
            }
            if array.shape[1] == 3:
                accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
            if array is shades:
                accessor["normalized"] = True
            accessors.append(accessor)
            views.append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes})
            parts.append(array.tobytes())
            start += array.nbytes
        gltf: dict[str, object] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [
                {"primitives": [{"attributes": attributes, "indices": 0, "material": 0, "mode": TRIANGLES}]},
            ],
            "materials": [{"doubleSided": True, "pbrMetallicRoughness": self._material}],
            "accessors": accessors,
            "bufferViews": views,
        }
        if self._image:
            views.append({"buffer": 0, "byteOffset": start, "byteLength": len(self._image)})
            parts.append(self._image)
            start += len(self._image)
            gltf["images"] = [{"bufferView": len(views) - 1, "mimeType": "image/jpeg"}]
            gltf["samplers"] = [self._sampler]
            gltf["textures"] = [{"source": 0, "sampler": 0}]
        gltf["buffers"] = [{"byteLength": start}]
        return _container(gltf, b"".join(parts))


def _small(pixels: Bytes) -> Bytes:
    """Average (height, width, 3) pixels in blocks, so that neither side is longer than the browser needs."""
    rows, columns = (-(-size // _MOST_PIXELS) for size in pixels.shape[:2])
    if rows == columns == 1:
        return pixels
    height, width = pixels.shape[0] // rows, pixels.shape[1] // columns
    blocks = pixels[: height * rows, : width * columns].reshape(height, rows, width, columns, 3)
    return np.asarray(blocks.mean(axis=(1, 3)).round().astype(np.uint8))


def _container(gltf: dict[str, object], data: bytes) -> bytes:
    """Join JSON and a buffer into a .glb."""
    text = json.dumps(gltf, separators=(",", ":")).encode()
    chunks = ((JSON_CHUNK, text + b" " * (-len(text) % 4)), (BIN_CHUNK, data + b"\0" * (-len(data) % 4)))
    body = b"".join(struct.pack("<I", len(chunk)) + kind + chunk for kind, chunk in chunks)
    return struct.pack("<4sII", GLB_MAGIC, 2, 12 + len(body)) + body
