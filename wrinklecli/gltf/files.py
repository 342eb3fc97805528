"""Files that an asset consists of: the paths that its URIs name, and which of them may be read.

Source: glTF 2.0 §2.8 (URIs); RFC 3986 §2.1. Differs: bytes of a name that are not UTF-8 are percent-encoded too.
"""

import base64
import binascii
import json
import os
import struct
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO
from urllib.parse import quote, unquote_to_bytes

from wrinklecli.errors import AssetError
from wrinklecli.files.inputs import lies_below, open_input
from wrinklecli.numeric.memory import MAX_MEMORY, Memory, json_memory

# Header of a .glb (glTF 2.0, §4.4): magic, version, length; length and kind of the JSON chunk.
_HEADER = struct.Struct("<4sIIII")
_MAX_JSON = 2**28  # bytes of JSON that are read; the bake refuses a larger asset


def read_file(path: str, *, memory: Memory | None = None, where: str = "") -> memoryview:
    """Read as many bytes as a file has when it is opened; the memory is by default that of any command.

    Raises:
        AssetError: The file cannot be read or is too large.
    """
    try:
        with open_input(path) as file:
            size = os.fstat(file.fileno()).st_size
            (memory or Memory()).claim(size, "the bytes of the file", where=where or path)
            return memoryview(file.read(size))
    except OSError as error:
        raise AssetError(f"cannot be read: {error.strerror or error}", where=where or path) from error


def read_data_uri(uri: str, where: str, *, memory: Memory) -> memoryview:
    """Decode the bytes of a data URI."""
    head, comma, body = uri.partition(",")
    memory.claim(len(body), "the bytes of a data URI", where=where)
    try:
        if not comma or not head.endswith(";base64"):
            raise ValueError("not base64")
        return memoryview(base64.b64decode(body, validate=True))
    except (ValueError, binascii.Error) as error:
        raise AssetError(f"the data URI is malformed: {error}", where=where) from error


def local_file(uri: str, asset: str, where: str, *, allow_external: bool) -> str:
    """The file that a URI without a scheme names.

    Raises:
        AssetError: The file is not below the asset's folder, and `allow_external` is False.
    """
    folder = os.path.dirname(asset)
    relative = path_of(uri)
    file = os.path.join(folder, relative)
    if _names_no_file(relative):
        raise AssetError(f"uri {uri[:80]!r} is not a file below the asset's folder", where=where)
    if (leaves_folder(uri) or not lies_below(file, folder)) and not allow_external:
        hint = "others are read with --allow-external"
        raise AssetError(f"uri {uri[:80]!r} is not a file below the asset's folder; {hint}", where=where)
    return file


def leaves_folder(uri: str) -> bool:
    """True if a URI's path leaves the folder that it is relative to."""
    relative = path_of(uri)
    return os.path.isabs(relative) or os.path.normpath(relative).split(os.sep)[0] == os.pardir


def path_of(uri: str) -> str:
    """The path that a relative URI names; UnicodeEncodeError if it contains half a character."""
    return os.fsdecode(unquote_to_bytes(os.fsencode(uri)))


def uri_of(path: str) -> str:
    """The URI that names a path."""
    return quote(os.fsencode(path))


def files_named(assets: Iterable[str | os.PathLike[str]]) -> Iterator[str]:
    """Give assets and the files that they refer to, without decoding any: a file that cannot be read names no other."""
    for asset in [os.fspath(path) for path in assets]:
        yield asset
        try:
            with open_input(asset) as file:
                uris = references(file)
        except OSError:
            continue
        yield from filter(None, (path_beside(asset, uri, external=True) for uri in uris))


def references(file: BinaryIO) -> list[str]:
    """List the URIs of buffers and images of an open glTF file; none if the file is damaged, or too large to parse."""
    try:
        head = file.read(_HEADER.size)
        if head.startswith(b"glTF"):
            text = file.read(min(_HEADER.unpack(head)[3], _MAX_JSON))
        else:
            text = head + file.read(_MAX_JSON)
        # Most .glb files refer to nothing, and parsing takes a hundred times as long. An escape, or an encoding of
        # JSON with null bytes, may spell the key in another way.
        if not any(each in text for each in (b'"uri"', b"\\", b"\0")) or json_memory(text) > MAX_MEMORY:
            return []
        return list(dict.fromkeys(_uris(json.loads(text))))
    except (ValueError, struct.error, RecursionError, AttributeError, TypeError):
        return []


def _uris(gltf: Any) -> Iterator[str]:
    for each in (*gltf.get("buffers", ()), *gltf.get("images", ())):
        uri = each.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:"):
            yield uri


def path_beside(asset: str, uri: str, *, external: bool) -> str | None:
    """The file that a URI of an asset names; None if a bake would not read it."""
    try:
        relative = path_of(uri)
    except UnicodeEncodeError:
        return None
    refused = _names_no_file(relative) or (leaves_folder(uri) and not external)
    return None if refused else os.path.join(os.path.dirname(asset), relative)


def _names_no_file(relative: str) -> bool:
    """True for a URL, which would be read from elsewhere, and for a path with a null character."""
    return ":" in relative.split("/")[0] or "\0" in relative
