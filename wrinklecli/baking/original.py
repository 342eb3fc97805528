"""The record of the asset that a baked file was made from: written at the end of the file, and read back.

A bake moves, changes and drops data. A record holds the original's JSON, the places of its bytes that the baked file
keeps, and its other bytes. Kept bytes include those with which new data begins or ends, as new vertices follow the old
ones. Nearly all other bytes are in the file in another order. So the record is small if it is compressed with a
dictionary: the new JSON, and the new data in place of the old. `zstandard` can do that; of the standard library,
neither zlib (a dictionary of 32 KiB) nor lzma (none) can, before Python 3.14.

The record is the last buffer view, and the first node that has got wrinkles refers to it by
`extras.wrinkle.original`. It begins with a digest of the rest of the file. A file that other software has rewritten is
refused, as its changes would be lost.

Source: RFC 8878 (Zstandard); `zstd --patch-from` does the same with whole files.
"""

import base64
import hashlib
import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrinklecli.drive.drive import is_baked, wrinkle_entry
from wrinklecli.errors import AssetError, BakeError
from wrinklecli.gltf.animated import check_channels
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.images import read_image
from wrinklecli.gltf.new_data import ALIGNMENT
from wrinklecli.gltf.references import view_parts
from wrinklecli.gltf.shape import Json, check_asset, parse_json
from wrinklecli.gltf.writer import Bytes, Layout, Span
from wrinklecli.numeric.memory import json_memory

# Bytes [low, high) of the record's buffer.
Range = tuple[int, int]

# The digest, and the number of ranges of the record's buffer that make the dictionary, which follow.
_HEADER = struct.Struct("<32sI")
_RANGE = struct.Struct("<QQ")
_DIGEST_BYTES = 32
_LEAST_RUN = 64  # bytes; a span takes about 20
_MOST_LONGER = 16  # times: in a track of many more keys and targets little is as before, and indexing it takes long
_LEVEL = 9  # higher ones take several times as long and save a fifth
_DICTIONARY_BYTES = 2**27  # bounds time and memory
_TABLE_LOG = 24  # of zstd's tables, which are to index the dictionary; 64 MiB each


def wrinkled(gltf: Json) -> list[int]:
    """The nodes whose meshes carry wrinkles."""
    nodes = enumerate(gltf.get("nodes", []))
    return [k for k, node in nodes if "mesh" in node and is_baked(node)]


def seal(asset: Document, edited: EditedDocument, layout: Layout) -> tuple[Json, bytes]:
    """Let a record of the asset follow the new data if a node has got wrinkles.

    Args:
        asset: The asset as it was read.
        edited: The asset being changed, which may have more items at the ends of its lists.
        layout: The layout of the file to be written.

    Returns:
        The JSON, in which the first such node refers to the record, and the bytes that follow the new data. Without
        new wrinkles, the JSON does not change, and there are no bytes.
    """
    added = sorted(set(wrinkled(layout.gltf)) - set(wrinkled(asset.gltf)))
    if not added:
        return layout.gltf, b""
    padding = bytes(-edited.new_size % ALIGNMENT)
    new = b"".join([*edited.new_data(), padding])
    start = sum(len(part) for part in layout.contents[layout.buffer])
    view: Json = {"buffer": layout.buffer, "byteOffset": start + len(new)}
    # A shallow copy of the JSON with the buffer view of a record, and a node that refers to this.
    node = added[0]
    views, nodes = [*layout.gltf.get("bufferViews", []), view], list(layout.gltf["nodes"])
    nodes[node] = _with_entry(nodes[node], wrinkle_entry(nodes[node]) | {"original": len(views) - 1})
    gltf = layout.gltf | {"nodes": nodes, "bufferViews": views}
    record = _pack(asset, replace(layout, gltf=gltf), new)
    view["byteLength"] = len(record)
    return gltf, padding + record


def _pack(source: Document, layout: Layout, new: bytes) -> bytes:
    """Make the record that follows the new data; in the layout, the record's view may lack its length."""
    bare, buffer = _without_record(layout.gltf), layout.buffer
    start = sum(len(part) for part in layout.contents[buffer])
    own = layout.kept[: len(source.buffers)]  # the original has no data of other files' clips
    kept, alike = _with_echoes(source, bare, new, (buffer, start), own)
    dead: list[Bytes] = []
    for data, spans in zip(source.buffers, kept, strict=True):
        at = 0
        for low, high, _, _ in spans:
            dead.append(data[at:low])
            at = high
        dead.append(data[at:])
    original: Json = {
        "gltf": _slim(source, bare),
        "sizes": [len(data) for data in source.buffers],
        "kept": kept,
        "beside": layout.beside,
    }
    content = b"".join([_dump(original), b"\n", *dead])
    packed = _compressed(content, _dictionary(bare, [new[low - start : high - start] for low, high in alike]))
    every = [[*parts, new] if number == buffer else parts for number, parts in enumerate(layout.contents)]
    return b"".join([_HEADER.pack(_digest(bare, every), len(alike)), *(_RANGE.pack(*each) for each in alike), packed])


def _compressed(content: bytes, dictionary: bytes) -> bytes:
    """Compress content by a dictionary."""
    import zstandard

    bits = (len(dictionary) + len(content)).bit_length()
    parameters = zstandard.ZstdCompressionParameters.from_level(
        _LEVEL,
        source_size=len(content),
        dict_size=len(dictionary),
        window_log=min(max(bits, zstandard.WINDOWLOG_MIN), zstandard.WINDOWLOG_MAX),
        hash_log=min(max(bits, zstandard.HASHLOG_MIN), _TABLE_LOG),
        chain_log=min(max(bits, zstandard.CHAINLOG_MIN), _TABLE_LOG),
        write_checksum=True,
        write_dict_id=False,
    )
    raw = zstandard.ZstdCompressionDict(dictionary, dict_type=zstandard.DICT_TYPE_RAWCONTENT)
    return zstandard.ZstdCompressor(dict_data=raw, compression_params=parameters).compress(content)


def _decompressed(packed: bytes, dictionary: bytes, document: Document, where: str) -> bytes:
    """Undo `_compressed` for a view of a document.

    Raises:
        ValueError: The view is damaged.
        TooMuchError: The content is too large.
    """
    import zstandard

    try:
        size = zstandard.frame_content_size(packed)
        if size <= 0:
            raise ValueError("empty, or of no size")
        # The content is copied once more when its JSON is taken off.
        document.claim_unstored(2 * size, "the bytes of the original asset", where=where)
        raw = zstandard.ZstdCompressionDict(dictionary, dict_type=zstandard.DICT_TYPE_RAWCONTENT)
        decompressor = zstandard.ZstdDecompressor(dict_data=raw, max_window_size=2**zstandard.WINDOWLOG_MAX)
        return decompressor.decompress(packed, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise ValueError("damaged") from error


def _with_echoes(
    source: Document, gltf: Json, new: bytes, place: tuple[int, int], kept: Sequence[Sequence[Span]]
) -> tuple[list[list[Span]], list[Range]]:
    """Look for the original's data in the new data in place of it.

    Args:
        source: The original.
        gltf: The JSON to be written.
        new: The new data.
        place: The buffer of the new data, and its first byte there.
        kept: For each buffer of the original, the spans that are in the baked file anyway.

    Returns:
        The spans, with those at the beginning or end of new data, and the ranges of new data that resemble the
        original's otherwise.
    """
    buffer, start = place
    content = np.frombuffer(new, np.uint8)
    found, alike = [list(each) for each in kept], []
    # New data has the number of the accessor that it replaces.
    for old, now in zip(source.items("accessors"), gltf.get("accessors", []), strict=False):
        elements, *sparse = _stored(gltf, now)
        if "sparse" in now and "sparse" not in old:
            elements = sparse[-1]  # morph targets, of which zeros are no longer stored
        for was, becomes in zip(_stored(source.gltf, old), (elements, *sparse), strict=True):
            if was is None or was[0] >= len(source.buffers):
                continue
            if becomes is None or becomes[0] != buffer or becomes[1] < start:
                continue
            (home, low, end, count), (_, at, stop, new_count) = was, becomes
            # New elements are packed. Where the old ones were not, the bytes differ.
            end = min(end, low + (stop - at) // max(new_count, 1) * count)
            before = np.frombuffer(source.buffers[home], np.uint8)[low:end]
            after = content[at - start : stop - start]
            head = _alike(before, after)
            tail = _alike(before[head:][::-1], after[head:][::-1])
            if head:
                found[home].append(Span(low, low + head, buffer, at))
            if tail:
                found[home].append(Span(low + len(before) - tail, low + len(before), buffer, stop - tail))
            if head + tail < len(before) and len(after) <= _MOST_LONGER * len(before):
                alike.append((at + head, stop - tail))
    return [_apart(spans) for spans in found], sorted(alike)


def _stored(gltf: Json, accessor: Json) -> Iterator[tuple[int, int, int, int] | None]:
    """The buffer, first byte, end of the view and count of an accessor's elements, sparse indices and sparse values.

    None for those that are missing or compressed. Accessors that nothing reads may refer to anything.
    """
    views, sparse = gltf.get("bufferViews", []), accessor.get("sparse", {})
    parts = [(accessor, accessor), (sparse.get("indices", {}), sparse), (sparse.get("values", {}), sparse)]
    for part, counted in parts:
        number = part.get("bufferView", len(views))
        view = views[number] if number < len(views) else {}
        if "buffer" not in view or len(list(view_parts(view))) > 1:
            yield None
            continue
        low = view.get("byteOffset", 0)
        end = low + view.get("byteLength", 0)
        yield view["buffer"], low + part.get("byteOffset", 0), end, counted.get("count", 0)


def _alike(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> int:
    """The number of bytes with which both begin; 0 if these are not worth a span."""
    count = min(len(one), len(other))
    differ = np.flatnonzero(one[:count] != other[:count])
    run = int(differ[0]) if len(differ) else count
    return run if run >= _LEAST_RUN else 0


def _apart(spans: Sequence[Span]) -> list[Span]:
    """The sorted spans without those that overlap others."""
    apart: list[Span] = []
    for span in sorted(spans):
        if not apart or span[0] >= apart[-1][1]:
            apart.append(span)
    return apart


def original(document: Document) -> Document:
    """The asset as it was before any wrinkles were baked into it: its JSON and buffers, bit by bit.

    An asset without wrinkles is returned as it is.

    Raises:
        BakeError: The asset carries wrinkles, but is not as `bake` wrote it.
        TooMuchError: The original takes too much memory.
    """
    while nodes := wrinkled(document.gltf):
        where = document.where("nodes", nodes[0], "extras", "wrinkle")
        try:
            document = _restored(document, _read_record(document, nodes, where))
        except (
            AssetError,
            ArithmeticError,
            AttributeError,
            LookupError,
            RecursionError,
            TypeError,
            ValueError,
        ) as error:
            raise BakeError(
                "the record of the original asset is missing or does not fit: `wrinkle track` or other software has"
                " rewritten the file since its bake; bake from the original asset",
                where=where,
            ) from error
        # Each bake adds a node to these, so a record that removes none is forged, and would make this loop endless.
        if not set(wrinkled(document.gltf)) < set(nodes):
            raise BakeError("the record of the original asset is not what `wrinkle bake` writes", where=where)
    return document


def _read_record(document: Document, nodes: Sequence[int], where: str) -> bytes:
    """The content of the record that one of the nodes refers to.

    Raises:
        TooMuchError: The record is too large; at `where`.
        ValueError: This and other errors mean that the file is not as it was written.
    """
    gltf, last = document.gltf, len(document.items("bufferViews")) - 1
    if last not in [wrinkle_entry(gltf["nodes"][node]).get("original") for node in nodes]:
        raise ValueError("no record")
    record, view = document.view(last), document.items("bufferViews")[last]
    if len(record) < _HEADER.size:
        raise ValueError("no header")
    buffer, offset = view["buffer"], view.get("byteOffset", 0)
    document.memory.check(sum(len(data) for data in document.buffers), "the bytes of all buffers", where=where)
    digest, count = _HEADER.unpack_from(record)
    body = _HEADER.size + count * _RANGE.size
    contents: list[list[Bytes]] = [[data] for data in document.buffers]
    contents[buffer] = [document.buffers[buffer][:offset]]
    bare = _without_record(gltf)
    if body > len(record) or offset + len(record) != len(document.buffers[buffer]) or digest != _digest(bare, contents):
        raise ValueError("rewritten")
    alike = [document.buffers[buffer][low:high] for low, high in _RANGE.iter_unpack(record[_HEADER.size : body])]
    if sum(len(part) for part in alike) > offset:
        raise ValueError("ranges overlap")
    return _decompressed(bytes(record[body:]), _dictionary(bare, alike), document, where)


def _restored(document: Document, content: bytes) -> Document:
    """The original that a record's content describes.

    Raises:
        ValueError: This and other errors mean that the file is not as it was written.
    """
    text, _, dead = content.partition(b"\n")
    document.memory.claim(json_memory(text), "the values of the original's JSON", where=document.path)
    made = parse_json(text, document.path)
    restored: Json = made["gltf"]
    images = restored.get("images", [])
    for index, image in enumerate(images):
        if image is None:
            images[index] = document.items("images")[index]
    check_asset(restored, document.path)
    check_channels(restored, document.path)
    buffers = tuple(_joined(document, memoryview(dead), made["sizes"], made["kept"]))
    if len(buffers) != len(restored.get("buffers", [])):
        raise ValueError("another number of buffers")
    for entry, data in zip(restored.get("buffers", []), buffers, strict=True):
        if len(data) not in (0, entry["byteLength"]):
            raise ValueError("a buffer of another length")
        uri = entry.get("uri", "")
        if uri.startswith("data:") and uri.endswith(","):
            entry["uri"] = uri + base64.b64encode(data).decode()
    restored_document = replace(document, gltf=restored, buffers=buffers)
    return restored_document if made["beside"] else _carrying_images(restored_document, document)


def _joined(
    document: Document, dead: memoryview, sizes: Sequence[int], kept: Sequence[Sequence[Span]]
) -> Iterator[memoryview]:
    """The buffers of an original, from spans that the document keeps and the bytes between them.

    Raises:
        ValueError: Spans and bytes do not fit together.
    """
    remaining = sum(len(data) for data in document.buffers)  # no span is kept twice
    taken = 0
    for size, spans in zip(sizes, kept, strict=True):
        parts: list[memoryview] = []
        at = 0
        for low, high, buffer, offset in [*spans, (size, size, 0, 0)]:
            remaining -= high - low
            if not 0 <= at <= low <= high <= size or min(buffer, offset, remaining) < 0:
                raise ValueError("spans overlap")
            parts.append(dead[taken : taken + low - at])
            taken += low - at
            if high > low:
                parts.append(document.buffers[buffer][offset : offset + high - low])
            at = high
        parts = [part for part in parts if len(part)]
        if sum(len(part) for part in parts) != size:
            raise ValueError("bytes are missing")
        yield parts[0] if len(parts) == 1 else memoryview(b"".join(parts))
    if taken != len(dead):
        raise ValueError("bytes are left over")


def _carrying_images(restored: Document, baked: Document) -> Document:
    """The original with the images of its relative URIs, which the baked file embeds or has beside it."""
    resources: dict[str, memoryview] = {}
    files = list(baked.files)
    for number, (image, _) in enumerate(zip(restored.items("images"), baked.items("images"), strict=True)):
        uri = image.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:"):
            resources[uri], file = read_image(baked, number)
            files += [file] if file else []
    return replace(restored, resources=resources, files=tuple(files))


def _with_entry(node: Json, entry: Json) -> Json:
    """A node with another entry."""
    return node | {"extras": node["extras"] | {"wrinkle": entry}}


def _without_record(gltf: Json) -> Json:
    """The JSON without its last buffer view, references to this view, and the length and name of its buffer."""
    views: list[Json] = gltf["bufferViews"]
    nodes, buffers = list(gltf["nodes"]), list(gltf["buffers"])
    for node in wrinkled(gltf):
        entry = wrinkle_entry(nodes[node])
        if entry.get("original") == len(views) - 1:
            nodes[node] = _with_entry(nodes[node], {key: value for key, value in entry.items() if key != "original"})
    buffer = views[-1]["buffer"]
    buffers[buffer] = {key: value for key, value in buffers[buffer].items() if key not in ("uri", "byteLength")}
    return gltf | {"nodes": nodes, "bufferViews": views[:-1], "buffers": buffers}


def _slim(source: Document, gltf: Json) -> Json:
    """The original's JSON without unchanged images, and without the buffers' data in URIs."""
    slim = dict(source.gltf)
    if "images" in slim:
        pairs = zip(slim["images"], gltf["images"], strict=True)
        slim["images"] = [None if _dump(image) == _dump(written) else image for image, written in pairs]
    if "buffers" in slim:
        slim["buffers"] = [dict(buffer) for buffer in slim["buffers"]]
        for entry, data in zip(slim["buffers"], source.buffers, strict=True):
            head, _, body = entry.get("uri", "").partition(",")
            if head.startswith("data:") and base64.b64encode(data).decode() == body:
                entry["uri"] = f"{head},"
    return slim


def _dictionary(bare: Json, alike: Sequence[Bytes]) -> bytes:
    """Bytes that resemble the original: the JSON without images, which may be large, and new data."""
    text = _dump({key: value for key, value in bare.items() if key != "images"})
    return b"".join([text, *alike])[:_DICTIONARY_BYTES]


def _digest(bare: Json, contents: Sequence[Sequence[Bytes]]) -> bytes:
    """The digest of all content of a file except its record."""
    digest = hashlib.blake2b(_dump(bare), digest_size=_DIGEST_BYTES)
    for parts in contents:
        digest.update(struct.pack("<Q", sum(len(part) for part in parts)))
        for part in parts:
            digest.update(part)
    return digest.digest()


def _dump(value: object) -> bytes:
    """JSON text in ASCII without line breaks; the same for the same value, keys in the same order."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()
