"""Decodes primitives that Draco compressed, by DracoPy, which comes with the extra `draco`.

Source: KHR_draco_mesh_compression.
"""

from itertools import chain, repeat

import numpy as np

from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.meshopt import varint
from wrinklecli.gltf.shape import DRACO
from wrinklecli.numeric.arrays import Array
from wrinklecli.numeric.memory import Memory, held

# Bytes of the bitstream's header: magic, version, kind of geometry, method, flags.
_HEADER_BYTES = 11
_MESH, _EDGEBREAKER = 1, 1
_METADATA_FLAG = 0x8000
# Least bytes, measured, that DracoPy takes for each triangle while it decodes,
_TRIANGLE_BYTES = 64
# and for each vertex.
_VERTEX_BYTES = 48


@dataclass(frozen=True, slots=True)
class DracoMesh:
    """The content of a Draco stream.

    Attributes:
        indices: (3 · triangles,) vertices; empty for a point cloud.
        attributes: (vertices, components) values by Draco's unique id of the attribute.
    """

    indices: Array
    attributes: dict[int, Array]


def decode(data: memoryview, *, memory: Memory, where: str) -> DracoMesh:
    """Decode one Draco stream, whose header first tells the memory that it needs; then the system limits the decoder.

    Raises:
        AssetError: DracoPy is not installed, the stream is malformed, or it takes too much memory.
    """
    try:
        import DracoPy
    except ImportError as error:
        raise AssetError(
            f"is compressed by {DRACO}: install the decoder by `pip install 'wrinklecli[draco]'`,"
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
    """Read the numbers of triangles and vertices at the begin of a stream; 0 if it does not say.

    Source: Draco bitstream specification 2.2, `Header`, `EdgebreakerConnectivityData`, `SequentialConnectivityData`.
    """
    if len(data) <= _HEADER_BYTES or data[7] != _MESH or int.from_bytes(data[9:11], "little") & _METADATA_FLAG:
        return 0, 0
    # Edgebreaker streams have the method of traversal, then vertices, then faces; sequential ones faces, then vertices.
    numbers = chain(data[_HEADER_BYTES + (data[8] == _EDGEBREAKER) :], repeat(0))
    first, second = varint(numbers), varint(numbers)
    return (second, first) if data[8] == _EDGEBREAKER else (first, second)
