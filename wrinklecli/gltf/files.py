"""Files that an asset consists of: which of its URIs may be followed."""

import base64
import binascii
import os
from urllib.parse import unquote

from wrinklecli.errors import AssetError
from wrinklecli.files.inputs import open_input


def read_file(path: str, *, where: str = "") -> memoryview:
    """The bytes of a file; AssetError, at `where`, if it cannot be read."""
    try:
        with open_input(path) as file:
            return memoryview(file.read())
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise AssetError(f"cannot be read: {reason or error}", where=where or path) from error


def read_uri(uri: str, asset: str, where: str, *, allow_external: bool) -> tuple[memoryview, str | None]:
    """The bytes behind a URI, and the file they came from (none for a data URI)."""
    if uri.startswith("data:"):
        head, comma, body = uri.partition(",")
        try:
            if not comma or not head.endswith(";base64"):
                raise ValueError("not base64")
            return memoryview(base64.b64decode(body, validate=True)), None
        except (ValueError, binascii.Error) as error:
            raise AssetError(f"the data URI is malformed: {error}", where=where) from error
    file = _local_file(uri, asset, where, allow_external=allow_external)
    return read_file(file, where=where), file


def _local_file(uri: str, asset: str, where: str, *, allow_external: bool) -> str:
    """The file that a URI without a scheme names; below the asset's folder, unless others are allowed."""
    folder = os.path.dirname(asset)
    relative = unquote(uri)
    file = os.path.join(folder, relative)
    inside = os.path.realpath(folder or ".")
    if ":" in relative.split("/")[0] or "\0" in relative:
        raise AssetError(f"uri {uri[:80]!r} is not a file below the asset's folder", where=where)
    if (leaves_folder(uri) or os.path.commonpath([inside, os.path.realpath(file)]) != inside) and not allow_external:
        hint = "others are read with --allow-external"
        raise AssetError(f"uri {uri[:80]!r} is not a file below the asset's folder; {hint}", where=where)
    return file


def leaves_folder(uri: str) -> bool:
    """Whether a URI's path leaves the folder that it is relative to."""
    relative = unquote(uri)
    return os.path.isabs(relative) or os.path.normpath(relative).split(os.sep)[0] == os.pardir
