"""Files read and written: which URIs of an asset may be followed, and files that are complete or not there."""

import base64
import binascii
import os
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO
from urllib.parse import unquote

from wrinklecli.errors import AssetError, BakeError


def read_file(path: str, *, where: str = "") -> memoryview:
    """The bytes of a file; AssetError, at `where`, if it cannot be read."""
    try:
        return memoryview(Path(path).read_bytes())
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
    if os.path.exists(file) and not (os.path.isfile(file) or os.path.isdir(file)):  # a pipe would be waited for
        raise AssetError("cannot be read: not a regular file", where=where)
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


def make_folders(path: str) -> list[str]:
    """Make a folder and those above it; the ones that were not there, outermost first.

    Raises:
        BakeError: One cannot be made; no other is left.
    """
    if not path or os.path.isdir(path):
        return []
    made = make_folders(os.path.dirname(path))
    if os.path.isdir(path):  # `a/..`, by making `a`
        return made
    try:
        os.mkdir(path)
    except OSError as error:
        _remove(made)
        raise BakeError(f"cannot be written: {error.strerror or error}", where=path) from error
    return [*made, path]


def replace_file(path: str, write: Callable[[IO[bytes]], object]) -> int:
    """Write a file completely beside `path`, then put it in its place; its size in bytes.

    Raises:
        BakeError: It cannot be written; the old file is as it was, and no other is left.
    """
    target = os.path.realpath(path)
    temporary: str | None = None
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=".wrinkle-", dir=os.path.dirname(target))
        with os.fdopen(descriptor, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
            size = file.tell()
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, target)
        temporary = None
    except OSError as error:
        raise BakeError(f"cannot be written: {error.strerror or error}", where=path) from error
    finally:
        if temporary is not None:
            os.unlink(temporary)
    return size


def replace_bytes(path: str, data: bytes | memoryview) -> int:
    """Put a file with this content in place of `path`, as `replace_file` does."""
    return replace_file(path, lambda file: file.write(data))


class FileGroup:
    """Files that belong together: where anything fails before the last, those that were not there are taken away.

    Use it with `with`.
    """

    def __init__(self) -> None:
        self._made: list[str] = []  # files and folders, in this order

    def __enter__(self) -> "FileGroup":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            _remove(self._made)

    def make_folders(self, path: str) -> None:
        """As the function of this name."""
        self._made += make_folders(path)

    def replace_file(self, path: str, write: Callable[[IO[bytes]], object]) -> int:
        """As the function of this name."""
        if not os.path.lexists(path):
            self._made.append(path)
        return replace_file(path, write)

    def replace_bytes(self, path: str, data: bytes | memoryview) -> int:
        """As the function of this name."""
        return self.replace_file(path, lambda file: file.write(data))


def _remove(made: Sequence[str]) -> None:
    """Take away files and folders that have been made, the last ones first; a folder with others' files stays."""
    for path in reversed(made):
        with suppress(OSError):
            os.rmdir(path) if os.path.isdir(path) else os.unlink(path)
