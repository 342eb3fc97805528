"""Writes a changed document as .glb or .gltf, and decides where its bytes go in the file or in files beside it.

Source: glTF 2.0 specification, §3.6 (binary data storage), §4 (GLB).
"""

import copy
import hashlib
import os
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain
from typing import IO, NamedTuple, TypeAlias

from wrinklecli.errors import AssetError, BakeError, TooMuchError
from wrinklecli.files.outputs import Outputs
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import BIN_CHUNK, GLB_MAGIC, JSON_CHUNK, Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.files import path_of, read_file, uri_of
from wrinklecli.gltf.images import image_type, images_to_bring, lies_beside, put_image
from wrinklecli.gltf.new_data import ALIGNMENT
from wrinklecli.gltf.references import compressions, drop_extensions, view_parts
from wrinklecli.gltf.shape import MESHOPT, Json, json_bytes

Bytes: TypeAlias = bytes | memoryview

GLB_LIMIT = 2**32 - 1
"""Most bytes of a .glb: the length in its header has 32 bits."""


class Span(NamedTuple):
    """Bytes [low, high) of a source's buffer, and the buffer and first byte of their place in the written file."""

    low: int
    high: int
    buffer: int
    start: int


@dataclass(frozen=True, slots=True)
class Layout:
    """A file before it is written, without the new data at its end and the bytes that a `Seal` adds.

    Attributes:
        gltf: The JSON; the buffer of the new data may lack its length and name.
        contents: The pieces of each buffer of the JSON, without the new data.
        buffer: Index of the buffer that gets the new data.
        kept: Sorted spans of each buffer of the source that are in `contents`.
        beside: True if relative URIs of the source name the same files from the written file.
    """

    gltf: Json
    contents: Sequence[Sequence[Bytes]]
    buffer: int
    kept: Sequence[Sequence[Span]]
    beside: bool


# Gives the final JSON, and bytes that follow the new data.
Seal: TypeAlias = Callable[[EditedDocument, Layout], tuple[Json, bytes]]


def no_seal(_edited: EditedDocument, layout: Layout) -> tuple[Json, bytes]:
    """Add nothing behind the new data."""
    return layout.gltf, b""


def write(
    edited: EditedDocument, path: str | os.PathLike[str], *, seal: Seal = no_seal, outputs: Outputs | None = None
) -> int:
    """Write .glb or .gltf, as the path's ending says, and replace the file OUT only by a complete one.

    A .glb embeds every buffer. A .gltf keeps embedded and relative buffers as they are and writes one more file,
    `STEM-<hash>.bin`, before its JSON; such a file that only the earlier OUT named is removed. Images with relative
    URIs are copied beside an OUT in another folder (.gltf) or embedded (.glb).

    Args:
        edited: The document.
        path: OUT.
        seal: Gives the bytes that follow the new data.
        outputs: The outputs of which OUT is a main one, and with which it is committed; by default at once.

    Returns:
        The number of bytes written.

    Raises:
        BakeError: The disk is full, the folder is missing or read-only, or a .glb exceeds 4 GiB.
    """
    out = os.fspath(path)
    kind = _write_gltf if out.lower().endswith(".gltf") else _write_glb
    if outputs is not None:
        return kind(edited, out, seal, outputs)
    with Outputs() as own:
        return kind(edited, out, seal, own)


def _write_glb(edited: EditedDocument, out: str, seal: Seal, outputs: Outputs) -> int:
    layout = _lay_out_glb(edited, out)
    gltf, tail = seal(edited, layout)
    size = sum(len(part) for part in layout.contents[0]) + edited.new_size + len(tail)
    if size:
        gltf["buffers"][0]["byteLength"] = size
    text = json_bytes(gltf)
    text += b" " * (-len(text) % ALIGNMENT)
    padding = bytes(-size % ALIGNMENT)
    total = 12 + 8 + len(text) + (8 + size + len(padding) if size else 0)
    if total > GLB_LIMIT:
        raise BakeError(f"would be {total} bytes; a .glb holds 4 GiB: use --frames-dir", where=out)

    def write_chunks(file: IO[bytes]) -> None:
        file.write(struct.pack("<4sII", GLB_MAGIC, 2, total))
        file.write(struct.pack("<I4s", len(text), JSON_CHUNK) + text)
        if size:
            file.write(struct.pack("<I4s", size + len(padding), BIN_CHUNK))
            file.writelines(layout.contents[0])
            file.writelines(edited.new_data())
            file.write(tail + padding)

    return outputs.add(out, write_chunks, last=True)


def _lay_out_glb(edited: EditedDocument, out: str) -> Layout:
    """Put all data into one buffer: kept bytes of the source's buffers, images from elsewhere, new data.

    Buffers without data, which only compressed views name, follow unchanged.
    """
    content: list[Bytes] = []
    size = 0

    def append(*parts: Bytes) -> int:
        """Append parts one after another, and give their offset."""
        nonlocal size
        start = size + -size % ALIGNMENT
        content.extend([bytes(start - size), *parts])
        size = start + sum(len(part) for part in parts)
        return start

    _refuse_repetition(edited.source, out)
    gltf = copy.copy(edited.gltf)
    placed = edited.placed_views(0)
    kept: list[list[Span]] = [[] for _ in edited.source.buffers]
    placeholders: list[Json] = []
    for number, shown in enumerate(placed.of_source):
        if not len(edited.source.buffers[number]):
            placeholders += [edited.gltf["buffers"][number]] if shown else []
            for part in shown:
                part["buffer"] = len(placeholders)
            continue
        bytes_kept = edited.kept(number)
        base = append(*bytes_kept.parts)
        kept[number] = [Span(low, high, 0, base + bytes_kept.moved(low)) for low, high in bytes_kept.spans]
        for part in shown:
            _set_offset(part, base + bytes_kept.moved(part.get("byteOffset", 0)))
            part["buffer"] = 0
    views = placed.views
    images = [dict(image) for image in gltf.get("images", [])]
    brought: dict[int, int] = {}  # views of data, which several images may share
    for number, data in images_to_bring(edited.source, out):
        if id(data) not in brought:
            brought[id(data)] = len(views)
            views.append({"buffer": 0, "byteOffset": append(data), "byteLength": len(data)})
        del images[number]["uri"]
        images[number]["bufferView"] = brought[id(data)]
        images[number].setdefault("mimeType", image_type(bytes(data[:16])))
    if images:
        gltf["images"] = images
    append()
    for view in placed.of_new:
        view["buffer"] = 0
        _set_offset(view, size + view.get("byteOffset", 0))
    if "bufferViews" in gltf or views:
        gltf["bufferViews"] = views
    if size + edited.new_size:
        gltf["buffers"] = [_binary_chunk(gltf) | {"byteLength": size + edited.new_size}, *placeholders]
    drop_extensions(gltf, compressions(edited.source.gltf) - compressions(gltf))
    # Buffers are in the file itself, so only images count.
    named = [image.get("uri", "data:") for image in edited.source.items("images")]
    return Layout(gltf, [content, *([] for _ in placeholders)], 0, kept, _found_beside(edited.source, out, named))


def _refuse_repetition(source: Document, out: str) -> None:
    """Check the memory of buffers that share a file, as each is written separately."""
    size = sum(len(data) for data in source.buffers)
    if size > sum({id(data.obj): len(data) for data in source.buffers}.values()):
        source.memory.check(size, f"{len(source.buffers)} buffers, each written for itself,", where=out)


def _binary_chunk(gltf: Json) -> Json:
    """The JSON of the first buffer, without its length, if it becomes the binary chunk."""
    if not gltf.get("buffers"):
        return {}
    # The chunk is no fallback of compressed views.
    fallback = any(name in gltf["buffers"][0].get("extensions", {}) for name in MESHOPT)
    left_out = ("uri", "extensions") if fallback else ("uri",)
    return {key: value for key, value in gltf["buffers"][0].items() if key not in left_out}


def _write_gltf(edited: EditedDocument, out: str, seal: Seal, outputs: Outputs) -> int:
    images = [dict(image) for image in edited.gltf.get("images", [])]
    brought: dict[str, str] = {}
    for number, data in images_to_bring(edited.source, out):
        uri = images[number]["uri"]
        brought[uri] = images[number]["uri"] = brought[uri] if uri in brought else put_image(uri, data, out, outputs)
    layout, contents = _lay_out_gltf(edited, images, out)
    written = sum(_put_buffer(name, content, out, outputs) for name, content in contents)
    gltf = layout.gltf
    if edited.new_size:
        gltf, tail = seal(edited, layout)
        digest = hashlib.sha256()
        for piece in chain(edited.new_data(), [tail]):
            digest.update(piece)
        name = _buffer_file(out, digest.hexdigest())
        gltf["buffers"][-1] |= {"uri": uri_of(name), "byteLength": edited.new_size + len(tail)}
        written += _put_buffer(name, chain(edited.new_data(), [tail]), out, outputs)
    outputs.drop(lambda: _old_buffer_files(out))
    return written + outputs.add_bytes(out, json_bytes(gltf, indent=2) + b"\n", last=True)


def _lay_out_gltf(edited: EditedDocument, images: list[Json], out: str) -> tuple[Layout, list[tuple[str, list[Bytes]]]]:
    """Keep buffers where they are, but write new files for those that lost data or would not be found from OUT.

    Returns:
        The layout; name and content of each new file.
    """
    source = edited.source
    gltf = copy.copy(edited.gltf)
    buffers: list[Json] = [dict(buffer) for buffer in gltf.get("buffers", [])]
    stored = [number for number, data in enumerate(source.buffers) if len(data)]
    _refuse_repetition(source, out)
    placed = edited.placed_views(stored[0] if stored else 0)
    contents: list[list[Bytes]] = [[] for _ in buffers]
    kept: list[list[Span]] = [[] for _ in source.buffers]
    new_files: list[tuple[str, list[Bytes]]] = []
    for number in stored:
        bytes_kept = edited.kept(number)
        kept[number] = [Span(low, high, number, bytes_kept.moved(low)) for low, high in bytes_kept.spans]
        if bytes_kept.whole and _is_in_place(source, number, out):
            contents[number] = [source.buffers[number]]
            continue
        for part in placed.of_source[number]:
            _set_offset(part, bytes_kept.moved(part.get("byteOffset", 0)))
        content = b"".join(bytes_kept.parts) or bytes(ALIGNMENT)  # a buffer may not be empty
        contents[number] = [content]
        new_files.append((_buffer_file(out, hashlib.sha256(content).hexdigest()), [content]))
        buffers[number] |= {"byteLength": len(content), "uri": uri_of(new_files[-1][0])}
    if edited.new_size:
        buffers.append({})
        contents.append([])
    parts = [part for view in placed.views for part in view_parts(view)]
    shown = {part.get("buffer") for part in parts}
    lasting = [number for number, buffer in enumerate(buffers) if number in shown or "uri" in buffer]
    for part in parts:
        if part.get("buffer") in lasting:
            part["buffer"] = lasting.index(part["buffer"])
    if images:
        gltf["images"] = images
    if buffers:
        gltf["buffers"] = [buffers[number] for number in lasting]
    if "bufferViews" in gltf or placed.views:
        gltf["bufferViews"] = placed.views
    drop_extensions(gltf, compressions(source.gltf) - compressions(gltf))
    named = [each.get("uri", "data:") for kind in ("images", "buffers") for each in source.items(kind)]
    layout = Layout(
        gltf=gltf,
        contents=[contents[number] for number in lasting],
        buffer=len(lasting) - 1,
        kept=[[span._replace(buffer=lasting.index(span.buffer)) for span in spans] for spans in kept],
        beside=_found_beside(source, out, named),
    )
    return layout, new_files


def _is_in_place(source: Document, number: int, out: str) -> bool:
    """True if the JSON, or a file beside OUT, still contains a buffer."""
    uri, content = source.items("buffers")[number].get("uri", ""), source.buffers[number]
    if uri.startswith("data:"):
        return True
    if not uri or not lies_beside(source, out):
        return False
    where = source.where("buffers", number)
    try:
        data, _ = source.read_uri(uri, where)
    except (AssetError, TooMuchError):  # it has been restored from another file
        return False
    return data[: len(content)] == content


def _found_beside(source: Document, out: str, uris: Sequence[str]) -> bool:
    """True if some of the URIs name files, which are the same from OUT as from the source."""
    return lies_beside(source, out) and not all(uri.startswith("data:") for uri in uris)


def _buffer_file(out: str, digest: str) -> str:
    """The name of a buffer's file beside OUT, with the digest of its content."""
    return f"{os.path.splitext(os.path.basename(out))[0]}-{digest[:12]}.bin"


def _put_buffer(name: str, content: Iterable[Bytes], out: str, outputs: Outputs) -> int:
    """Write a buffer's file beside OUT, unless an input or another buffer is that file, and give its size.

    One that an earlier bake has left is written again: another bake that ends meanwhile may remove it.
    """
    path = os.path.join(os.path.dirname(out), name)
    there = outputs.found(path)
    own = there is not None and (there != path or outputs.is_input(path))
    if there is not None and own and _is_buffer_file(there, name, out):
        return os.path.getsize(there)
    return outputs.add(path, lambda file: file.writelines(content))


def _old_buffer_files(out: str) -> Iterator[str]:
    """Give the buffer files of an earlier bake beside OUT: OUT names them, and their names begin with its name."""
    with suppress(AssetError):
        for uri in re.findall(rb'"uri": *"([^"\\/]+-[0-9a-f]{12}\.bin)"', read_file(out)):
            name = path_of(os.fsdecode(uri))
            path = os.path.join(os.path.dirname(out), name)
            if _is_buffer_file(path, name, out):
                yield path


def _is_buffer_file(path: str, name: str, out: str) -> bool:
    """True if a file's name has the digest of its content, as a buffer of OUT."""
    try:
        return name == _buffer_file(out, hashlib.sha256(read_file(path)).hexdigest())
    except (AssetError, TooMuchError):
        return False


def _set_offset(view: Json, offset: int) -> None:
    if offset or "byteOffset" in view:
        view["byteOffset"] = offset
