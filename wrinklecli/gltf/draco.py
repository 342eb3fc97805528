"""Primitives that Draco compressed, decoded by DracoPy.

Source: KHR_draco_mesh_compression. Differs: a decoder may come with the extra `draco`, and files without such
primitives never ask for it.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.errors import AssetError
from wrinklecli.numeric.arrays import Array

EXTENSION = "KHR_draco_mesh_compression"


@dataclass(frozen=True, slots=True)
class DracoMesh:
    """What a Draco stream holds.

    Attributes:
        indices: (3 · triangles,) vertices; empty for a point cloud.
        attributes: (vertices, components) by Draco's unique id of the attribute.
    """

    indices: Array
    attributes: dict[int, Array]


def decode(data: memoryview, *, where: str) -> DracoMesh:
    """Decode one Draco stream.

    Raises:
        AssetError: DracoPy is not installed, or the stream is malformed.
    """
    try:
        import DracoPy
    except ImportError as error:
        raise AssetError(
            f"is compressed by {EXTENSION}: install the decoder by `pip install 'wrinklecli[draco]'`,"
            " or decompress the file by `npx @gltf-transform/cli copy IN OUT`",
            where=where,
        ) from error
    try:
        mesh = DracoPy.decode(bytes(data))
        attributes = {
            int(each["unique_id"]): np.asarray(each["data"]).reshape(-1, int(each["num_components"]))
            for each in mesh.attributes
        }
        indices = np.asarray(getattr(mesh, "faces", ()), np.uint32).reshape(-1)
    except Exception as error:  # DracoPy raises bare Exceptions of its own
        raise AssetError(f"the Draco stream is malformed: {error}", where=where) from error
    counts = {len(values) for values in attributes.values()}
    if len(counts) != 1 or indices.max(initial=0) >= min(counts):
        raise AssetError("the Draco stream is malformed: its attributes and triangles do not agree", where=where)
    return DracoMesh(indices, attributes)
