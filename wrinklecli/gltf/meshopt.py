"""Decodes buffer views that meshoptimizer compressed, in numpy.

Source: EXT_meshopt_compression and KHR_meshopt_compression, appendices A (bitstream) and B (filters). Differs: KHR's
    additions (version 1 of the attribute stream, the filter COLOR) are read under either name; filters are computed in
    float64, so that a 16-bit result may differ by one unit from a float32 decoder's, as appendix B allows.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from wrinklecli.errors import AssetError, listed
from wrinklecli.numeric.arrays import Array, Floats
from wrinklecli.numeric.memory import Memory

Bytes = NDArray[np.uint8]

_GROUP = 16  # elements that share an encoding
_BLOCK_ELEMENTS = 256  # most elements of a block
_BLOCK_BYTES = 8192  # most bytes of a block
_WORD = 4  # bytes of a channel of attributes
_FIFO = 16  # edges and vertices that triangles may refer back to
_MOST_REMEMBERED = 4096  # edges that are stored before all but the last 16 are deleted

# Bits of a delta in a group by the header's two bits, for each version and control mode; 0 stores nothing.
_BITS_VERSION_0 = (0, 2, 4, 8)
_BITS_CONTROL = ((0, 1, 2, 4), (1, 2, 4, 8))
_CONTROL_ZERO, _CONTROL_LITERAL = 2, 3

# Smallest size of the tail, by version; longer elements make it longer.
_TAIL_BYTES = (32, 24)
_INDEX_TAIL_BYTES = 4
_TABLE_BYTES = 16
_VARINT_BYTES = 5
_MASK = 0xFFFFFFFF  # indices wrap at 32 bits

# Most bytes of memory while decoding for a byte of attributes (deltas, elements, filtered elements in float64),
_BYTES_PER_BYTE = 8
# for a byte of indices (Python's numbers, each of at least two bytes),
_INDEX_BYTES = 20
# and for a byte of the stream (offsets of groups).
_STREAM_BYTES = 80

# Appendix B allows exponents up to 100; others give unspecified results, which here stay within float32.
_EXPONENTS = (-126, 100)


class _MalformedError(ValueError):
    """An error in a stream, without its place, which `decode` adds."""


def decode(
    data: memoryview,
    *,
    count: int,
    stride: int,
    mode: str,
    filter_name: str = "NONE",
    memory: Memory | None = None,
    where: str,
) -> bytes:
    """Decode one compressed view.

    Args:
        data: The whole compressed stream.
        count: Number of elements.
        stride: Bytes of an element.
        mode: ATTRIBUTES, TRIANGLES or INDICES.
        filter_name: NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR.
        memory: The memory that decoding may take; by default 1 GB.
        where: The view, for messages.

    Returns:
        count · stride bytes.

    Raises:
        AssetError: The stream is malformed, or its parameters do not fit together.
    """
    decoders: dict[str, Callable[[Bytes, int, int], Array]] = {
        "ATTRIBUTES": _attributes,
        "TRIANGLES": _triangles,
        "INDICES": _indices,
    }
    strides: dict[str, tuple[Callable[[Bytes], Array], tuple[int, ...]]] = {
        "OCTAHEDRAL": (_octahedral, (4, 8)),
        "QUATERNION": (_quaternion, (8,)),
        "EXPONENTIAL": (_exponential, tuple(range(_WORD, 257, _WORD))),
        "COLOR": (_color, (4, 8)),
    }
    if mode not in decoders:
        raise AssetError(f"mode is {mode!r}; meshopt has {listed(decoders)}", where=where)
    if filter_name not in ("NONE", *strides):
        raise AssetError(f"filter is {filter_name!r}; meshopt has {listed(('NONE', *strides))}", where=where)
    accepted = range(_WORD, 257, _WORD) if mode == "ATTRIBUTES" else (2, 4)
    if stride not in accepted or (
        filter_name != "NONE" and (mode != "ATTRIBUTES" or stride not in strides[filter_name][1])
    ):
        raise AssetError(f"byteStride {stride} does not go with mode {mode} and filter {filter_name}", where=where)
    if count < 1:
        raise AssetError(f"count is {count}, not 1 or more", where=where)
    if mode == "TRIANGLES" and count % 3:
        raise AssetError(f"count is {count}, not three for each triangle", where=where)
    try:
        if len(data) < _least_bytes(mode, count, stride, version=data[0] & 1 if len(data) else 0):
            raise _MalformedError(f"{len(data)} bytes are too few for {count} elements")
        memory, size = memory or Memory(), count * stride
        peak = size * (_BYTES_PER_BYTE if mode == "ATTRIBUTES" else _INDEX_BYTES) + len(data) * _STREAM_BYTES
        memory.check(peak, f"{count} compressed elements", where=where)
        memory.claim(size, f"{count} compressed elements", where=where)
        elements = decoders[mode](np.frombuffer(data, np.uint8), count, stride)
    except _MalformedError as error:
        raise AssetError(f"the meshopt stream is malformed: {error}", where=where) from error
    if filter_name != "NONE":
        elements = strides[filter_name][0](elements)
    return elements.tobytes()


def _least_bytes(mode: str, count: int, stride: int, version: int) -> int:
    """Bytes of the shortest stream of `count` elements: for attributes, a byte for each channel of each block."""
    if mode == "ATTRIBUTES":
        return 1 + -(-count // _elements_of_a_block(stride)) * stride // _WORD + _tail_bytes(stride, version)
    return 1 + (count // 3 if mode == "TRIANGLES" else count)


def _tail_bytes(stride: int, version: int) -> int:
    return max(stride + version * (stride // _WORD), _TAIL_BYTES[version])


def _elements_of_a_block(stride: int) -> int:
    return min(_BLOCK_BYTES // stride & -_GROUP, _BLOCK_ELEMENTS)


def _attributes(data: Bytes, count: int, stride: int) -> Array:
    """(count, stride) bytes of mode 0."""
    if len(data) < 1 or data[0] not in (0xA0, 0xA1):
        raise _MalformedError("no attributes of version 0 or 1")
    version = int(data[0] & 1)
    tail = stride + version * (stride // _WORD)
    end = len(data) - _tail_bytes(stride, version)
    deltas = _deltas(data[:end], version, count, stride, _elements_of_a_block(stride))
    baseline = data[len(data) - tail :][:stride]
    channels = data[len(data) - stride // _WORD :] if version else np.zeros(stride // _WORD, np.uint8)
    elements = np.zeros((count, stride), np.uint8)
    for channel, kind in enumerate(channels.tolist()):
        columns = slice(channel * _WORD, (channel + 1) * _WORD)
        elements[:, columns] = _undelta(deltas[:, columns], baseline[columns], kind)
    return elements


def _undelta(deltas: Bytes, baseline: Bytes, kind: int) -> Bytes:
    """(count, 4) bytes of a channel from their differences to the previous element."""
    if kind in (0, 1):
        dtype = np.dtype(("<u1", "<u2")[kind])
        codes = np.ascontiguousarray(deltas).view(dtype)
        steps = (codes >> 1) ^ (0 - (codes & 1)).astype(dtype)
        steps[:1] += np.ascontiguousarray(baseline).view(dtype)
        return np.cumsum(steps, axis=0, dtype=dtype).view(np.uint8)
    if kind & 15 == 2:
        turn = kind >> 4
        codes = np.ascontiguousarray(deltas).view("<u4")
        steps = (codes << np.uint32(turn)) | (codes >> np.uint32(-turn & 31))
        steps[:1] ^= np.ascontiguousarray(baseline).view("<u4")
        return np.bitwise_xor.accumulate(steps, axis=0).view(np.uint8)
    raise _MalformedError(f"channel mode {kind:#04x}")


def _deltas(data: Bytes, version: int, count: int, stride: int, per_block: int) -> Bytes:
    """(count, stride) zigzag codes.

    The length of a group depends on its content, so offsets are found one after another, from tables of the length that
    a group would have at each byte. Then all groups of an encoding are decoded at once.
    """
    stream, end = data.tobytes(), len(data)
    # There is one entry more than bytes, since a group that begins at the end goes past it, too.
    sizes = {bits: _group_sizes(data, bits).tobytes() + bytes([_GROUP]) for bits in (1, 2, 4)}
    sizes[8] = bytes([_GROUP]) * (end + 1)
    places: dict[int, list[tuple[int, int, int]]] = {1: [], 2: [], 4: [], 8: []}
    deltas = np.zeros((-(-count // _GROUP) * _GROUP, stride), np.uint8)
    offset = 1
    for first in range(0, count, per_block):
        elements = min(per_block, count - first)
        groups = -(-elements // _GROUP)
        controls = [0] * stride
        if version:
            controls = [
                byte >> shift & 3 for byte in stream[offset : offset + stride // _WORD] for shift in (0, 2, 4, 6)
            ]
            offset += stride // _WORD
            if len(controls) < stride:
                raise _MalformedError("ends within a block")
        for column, control in enumerate(controls):
            if version and control == _CONTROL_ZERO:
                continue
            if version and control == _CONTROL_LITERAL:
                if offset + elements > end:
                    raise _MalformedError("ends within a block")
                deltas[first : first + elements, column] = data[offset : offset + elements]
                offset += elements
                continue
            lengths = _BITS_CONTROL[control] if version else _BITS_VERSION_0
            header = stream[offset : offset + -(-groups // 4)]
            offset += -(-groups // 4)
            if offset > end:
                raise _MalformedError("ends within a block")
            for group in range(groups):
                bits = lengths[header[group >> 2] >> (group & 3) * 2 & 3]
                if not bits:
                    continue
                places[bits].append((offset, first + group * _GROUP, column))
                offset += sizes[bits][offset]
                if offset > end:
                    raise _MalformedError("ends within a group")
    if offset != end:
        raise _MalformedError("has bytes left over")
    for bits, found in places.items():
        if found:
            starts, rows, columns = np.array(found, np.intp).T
            deltas[rows[:, None] + np.arange(_GROUP), columns[:, None]] = _groups(data, starts, bits)
    return deltas[:count]


def _codes(packed: Bytes, bits: int) -> Bytes:
    """(…, bytes · 8/bits) codes packed into bytes; single bits from the lowest, wider ones from the highest."""
    if bits == 8:
        return packed
    shifts = np.arange(0, 8, bits, dtype=np.uint8)
    shifts = shifts if bits == 1 else shifts[::-1]
    codes: Bytes = packed[..., None] >> shifts & np.uint8((1 << bits) - 1)
    return codes.reshape(*packed.shape[:-1], -1)


def _group_sizes(data: Bytes, bits: int) -> Bytes:
    """(bytes,) the length of a group of `bits` if it began at each byte."""
    sentinels = (_codes(np.arange(256, dtype=np.uint8)[:, None], bits) == (1 << bits) - 1).sum(axis=1, dtype=np.uint8)
    packed = _GROUP * bits // 8
    counts = np.pad(sentinels[data], (0, packed - 1))
    windows = np.lib.stride_tricks.sliding_window_view(counts, packed)
    return np.asarray(windows.sum(axis=1, dtype=np.uint8) + np.uint8(packed))


def _groups(data: Bytes, starts: NDArray[np.intp], bits: int) -> Bytes:
    """(groups, 16) deltas of groups of one encoding; a code of all ones means a byte after the codes."""
    packed = _GROUP * bits // 8
    codes = _codes(data[starts[:, None] + np.arange(packed)], bits)
    if bits == 8:
        return codes
    escaped = codes == (1 << bits) - 1
    after = starts[:, None] + packed + np.cumsum(escaped, axis=1) - 1
    return np.where(escaped, data[np.where(escaped, after, 0)], codes)


def _triangles(data: Bytes, count: int, stride: int) -> Array:
    """(count,) vertices of mode 1, read one triangle after another, as each refers to earlier ones."""
    stream, triangles = data.tobytes(), count // 3
    end = len(stream) - _TABLE_BYTES
    if end < 1 + triangles or stream[0] != 0xE1:
        raise _MalformedError("no triangles of version 1, or too few bytes")
    table, corners = stream[end:], iter(stream[1 + triangles : end])
    if table[-2:] != b"\0\0" or any(byte >> 4 == 15 or byte & 15 == 15 for byte in table):
        raise _MalformedError("an impossible table of codes")
    reader = _TriangleReader(table, corners)
    found: list[int] = []
    try:
        for code in stream[1 : 1 + triangles]:
            found += reader.on_edge(code >> 4, code & 15) if code >> 4 < 15 else reader.apart(code & 15)
    except IndexError as error:
        raise _MalformedError("refers to an edge or vertex before the first") from error
    except StopIteration as error:
        raise _MalformedError("ends within a triangle") from error
    if next(corners, None) is not None:
        raise _MalformedError("has bytes left over")
    return np.array(found, "<u4").astype(f"<u{stride}")


class _TriangleReader:
    """The state of reading triangles one after another; StopIteration if bytes are lacking.

    Args:
        table: Codes of the corners of common triangles.
        corners: The bytes behind the triangles' own codes.
    """

    def __init__(self, table: bytes, corners: Iterator[int]) -> None:
        self._table = table
        self._corners = corners
        self._following = 0  # the next new vertex
        self._last = 0  # the last explicit vertex
        self._edges: list[tuple[int, int]] = []
        self._vertices: list[int] = []

    def on_edge(self, edge: int, code: int) -> tuple[int, int, int]:
        """Read a triangle on one of the last edges, with the code of its third corner."""
        a, b = self._edges[-1 - edge]
        if 0 < code < 13:
            c = self._vertices[-1 - code]
        else:
            if code == 0:
                c = self._fresh()
            elif code == 15:
                c = self._explicit()
            else:
                c = self._last = (self._last + (1 if code == 14 else -1)) & _MASK
            self._vertices.append(c)
        self._edges += ((c, b), (a, c))
        self._forget()
        return a, b, c

    def apart(self, code: int) -> tuple[int, int, int]:
        """Read a triangle whose corners' codes are in the table or in the stream."""
        if code < 14:
            first, others = 0, self._table[code]
        else:
            first, others = (0, 15)[code - 14], next(self._corners)
            if others == 0:
                self._following = 0
        codes = (first, others >> 4, others & 15)
        a, b, c = [self._corner(each) for each in codes]
        self._vertices += [vertex for vertex, each in zip((a, b, c), codes, strict=True) if each in (0, 15)]
        self._edges += ((b, a), (c, b), (a, c))
        self._forget()
        return a, b, c

    def _corner(self, code: int) -> int:
        """Read a vertex by a code of four bits: 0 is the next new one, 15 explicit, others are recent ones."""
        return self._fresh() if code == 0 else self._explicit() if code == 15 else self._vertices[-code]

    def _fresh(self) -> int:
        vertex = self._following
        self._following = (vertex + 1) & _MASK
        return vertex

    def _explicit(self) -> int:
        """Read the step from the last explicit vertex."""
        value = varint(self._corners) & _MASK
        self._last = (self._last + (~(value >> 1) if value & 1 else value >> 1)) & _MASK
        return self._last

    def _forget(self) -> None:
        if len(self._edges) > _MOST_REMEMBERED:
            del self._edges[:-_FIFO], self._vertices[:-_FIFO]


def varint(stream: Iterator[int]) -> int:
    """Read a number of seven bits per byte, the lowest first, which ends with the fifth byte at the latest."""
    value = 0
    for shift in range(0, 7 * _VARINT_BYTES, 7):
        byte = next(stream)
        value |= (byte & 127) << shift
        if byte < 128:
            break
    return value


def _indices(data: Bytes, count: int, stride: int) -> Array:
    """(count,) indices of mode 2, varints that are steps from one of two baselines."""
    if len(data) < 1 + _INDEX_TAIL_BYTES or data[0] != 0xD1:
        raise _MalformedError("no indices of version 1")
    body = data[1:-_INDEX_TAIL_BYTES]
    ends = np.flatnonzero(body < 128)
    if len(ends) != count or (count and ends[-1] != len(body) - 1):
        raise _MalformedError(f"{len(ends)} whole indices where there should be {count}")
    starts = np.concatenate([[0], ends[:-1] + 1]).astype(np.intp)
    lengths = ends - starts + 1
    if lengths.max(initial=0) > _VARINT_BYTES:
        raise _MalformedError("an index of more than five bytes")
    places = np.arange(len(body)) - np.repeat(starts, lengths)
    parts = (body & 127).astype(np.uint64) << (7 * places).astype(np.uint64)
    codes = np.bitwise_or.reduceat(parts, starts).astype(np.uint32)
    steps = (codes >> 2) ^ (0 - (codes >> 1 & 1)).astype(np.uint32)
    indices = np.zeros(count, "<u4")
    for baseline in (0, 1):
        chosen = codes & 1 == baseline
        indices[chosen] = np.cumsum(steps[chosen], dtype=np.uint32)
    return indices.astype(f"<u{stride}")


def _rounded(values: Floats, limit: int) -> Array:
    """Nearest integers, halves away from zero, clamped to ±limit."""
    nearest = np.trunc(values + np.copysign(0.5, values))
    return np.clip(nearest, -limit, limit)


def _octahedral(elements: Bytes) -> Array:
    """Unit vectors from octahedral coordinates, as signed normalised integers; the fourth number is kept."""
    stored = elements.view(f"<i{elements.shape[1] // 4}")
    limit = int(np.iinfo(stored.dtype).max)
    x, y, one = (stored[:, k].astype(np.float64) for k in range(3))
    z = one - np.abs(x) - np.abs(y)
    fold = np.minimum(z, 0)
    x, y = x + np.where(x >= 0, fold, -fold), y + np.where(y >= 0, fold, -fold)
    length = np.sqrt(x * x + y * y + z * z)
    scale = limit / np.where(length > 0, length, 1)
    vectors = np.array(stored)
    for column, component in enumerate((x, y, z)):
        vectors[:, column] = _rounded(component * scale, limit)
    return vectors


def _quaternion(elements: Bytes) -> Array:
    """Unit quaternions from their three smaller components, as 16-bit signed normalised integers."""
    stored = elements.view("<i2")
    one, largest = stored[:, 3] | 3, stored[:, 3] & 3
    scale = 1 / np.sqrt(2) / one.astype(np.float64)
    x, y, z = (stored[:, k].astype(np.float64) * scale for k in range(3))
    w = np.sqrt(np.maximum(1 - x * x - y * y - z * z, 0))
    rotations = np.zeros(stored.shape, "<i2")
    rows = np.arange(len(stored))
    for turn, component in enumerate((w, x, y, z)):
        rotations[rows, (largest + turn) % 4] = _rounded(component * 32767, 32767)
    return rotations


def _exponential(elements: Bytes) -> Array:
    """float32 from 24 bits of mantissa and 8 of exponent."""
    stored = elements.view("<i4")
    exponents = np.clip(stored >> 24, *_EXPONENTS)
    mantissas = (stored << 8) >> 8
    return np.asarray(np.ldexp(mantissas.astype(np.float64), exponents).astype("<f4"))


def _color(elements: Bytes) -> Array:
    """RGBA from YCoCg and an alpha whose highest bit gives the number of bits of all, as normalised integers."""
    width = elements.shape[1] // 4
    limit = 256**width - 1
    y, alpha = (elements.view(f"<u{width}")[:, k].astype(np.int64) for k in (0, 3))
    co, cg = (elements.view(f"<i{width}")[:, k].astype(np.int64) for k in (1, 2))
    full = alpha.copy()
    for shift in (1, 2, 4, 8):
        full |= full >> shift
    alpha = alpha & (full >> 1)
    colors = np.stack([y + co - cg, y + cg, y - co - cg, alpha << 1 | alpha & 1], axis=1)
    scale = limit / np.maximum(full, 1).astype(np.float64)
    return np.clip(_rounded(colors.astype(np.float64) * scale[:, None], limit), 0, limit).astype(f"<u{width}")
