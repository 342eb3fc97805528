"""Primitives that Draco compressed, decoded by DracoPy.

Source: KHR_draco_mesh_compression. Differs: a decoder may come with the extra `draco`, and files without such
primitives never ask for it.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.errors import AssetError
from wrinklecli.numeric.arrays import Array
from wrinklecli.numeric.memory import Memory, held

EXTENSION = "KHR_draco_mesh_compression"

# Of the bitstream's header: magic, version, kind of geometry, method, flags.
_HEADER_BYTES = 11
_MESH, _EDGEBREAKER = 1, 1
_METADATA_FLAG = 0x8000
# Bytes that DracoPy holds for each triangle and each vertex while it decodes: at least so many; measured.
_TRIANGLE_BYTES, _VERTEX_BYTES = 64, 48


@dataclass(frozen=True, slots=True)
class DracoMesh:
    """What a Draco stream holds.

    Attributes:
        indices: (3 · triangles,) vertices; empty for a point cloud.
        attributes: (vertices, components) by Draco's unique id of the attribute.
    """

    indices: Array
    attributes: dict[int, Array]


def decode(data: memoryview, *, memory: Memory, where: str) -> DracoMesh:
    """Decode one Draco stream.

    Args:
        data: The stream.
        memory: That it may take. What the stream says at its beginning is believed before any is taken, and the decoder
            is held to it.
        where: The view, for messages.

    Raises:
        AssetError: DracoPy is not installed, the stream is malformed, or it takes too much memory.
    """
    try:
        import DracoPy
    except ImportError as error:
        raise AssetError(
            f"is compressed by {EXTENSION}: install the decoder by `pip install 'wrinklecli[draco]'`,"
            " or decompress the file by `npx @gltf-transform/cli copy IN OUT`",
            where=where,
        ) from error
    triangles, vertices = _promised(data)
    memory.check(
        triangles * _TRIANGLE_BYTES + vertices * _VERTEX_BYTES,
        f"{triangles} triangles and {vertices} vertices of the Draco stream",
        where=where,
    )
    try:
        with held(memory.left):
            mesh = DracoPy.decode(bytes(data))
        attributes = {
            int(each["unique_id"]): np.asarray(each["data"]).reshape(-1, int(each["num_components"]))
            for each in mesh.attributes
        }
        indices = np.asarray(getattr(mesh, "faces", ()), np.uint32).reshape(-1)
    except MemoryError:
        memory.check(memory.left + 1, "what the Draco stream holds", where=where)
        raise
    except Exception as error:  # DracoPy raises bare Exceptions of its own
        raise AssetError(f"the Draco stream is malformed: {error}", where=where) from error
    counts = {len(values) for values in attributes.values()}
    if len(counts) != 1 or indices.max(initial=0) >= min(counts):
        raise AssetError("the Draco stream is malformed: its attributes and triangles do not agree", where=where)
    size = indices.nbytes + sum(values.nbytes for values in attributes.values())
    memory.claim(size, "triangles and vertices of the Draco stream", where=where)
    return DracoMesh(indices, attributes)


def _promised(data: memoryview) -> tuple[int, int]:
    """How many triangles and vertices a stream says that it holds; 0 where it does not say so at its beginning.

    Source: Draco bitstream specification 2.2, `Header`, `EdgebreakerConnectivityData`, `SequentialConnectivityData`.
    """
    if len(data) <= _HEADER_BYTES or data[7] != _MESH or int.from_bytes(data[9:11], "little") & _METADATA_FLAG:
        return 0, 0
    # The method of traversal comes first, for the one; vertices before faces, for the one, and behind, for the other.
    first, at = _varint(data, _HEADER_BYTES + (data[8] == _EDGEBREAKER))
    second, _ = _varint(data, at)
    return (second, first) if data[8] == _EDGEBREAKER else (first, second)


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, the lowest first, and where it ends; what the stream lacks is 0."""
    value = shift = 0
    while at < len(data) and shift < 35:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            break
    return value, at
