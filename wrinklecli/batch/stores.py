"""Files by path or by URL (fsspec): they are read, listed, and written whole or not at all."""

import errno
import glob
import os
import posixpath
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

from wrinklecli.errors import WrinkleError
from wrinklecli.files.inputs import open_input

_URL = re.compile(r"([a-z][a-z0-9+.-]+)://")
# Stores in which a file appears only when it is complete; in others it is written under another name and renamed.
_ATOMIC = {"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oss", "oci", "r2", "memory"}
_PATTERN = re.compile(r"[*?\[]")
# Numbers for errors that store libraries raise without a number.
_NUMBERS = {FileNotFoundError: errno.ENOENT, PermissionError: errno.EACCES}
# Errors after which another try may succeed.
_TEMPORARY = {errno.EBUSY, errno.EAGAIN, getattr(errno, "EREMOTEIO", errno.EIO)}


class StoreError(WrinkleError):
    """A store does not answer; it may answer later."""


def reason_of(error: OSError | ValueError) -> str:
    """The reason why a file cannot be read, without its path."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def is_url(path: str) -> bool:
    """True if a path is a URL for fsspec."""
    return _URL.match(path) is not None


def is_pattern(path: str) -> bool:
    """True if a path may stand for several files."""
    return _PATTERN.search(path) is not None


def plain(path: str) -> str:
    """Remove `file://` from a path."""
    return path.removeprefix("file://") if path.startswith("file:///") else path


def absolute(path: str) -> str:
    """Make a path independent of the current folder; a URL stays as it is."""
    return path if is_url(path) else os.path.abspath(path)


def folder_of(path: str) -> str:
    """The folder of a path or URL, without a slash at its end."""
    return posixpath.dirname(path) if is_url(path) else os.path.dirname(path)


def join(folder: str, path: str) -> str:
    """Resolve a path from a folder; an absolute path or a URL stays as it is."""
    if is_url(path) or os.path.isabs(path):
        return plain(path)
    return posixpath.join(folder, path) if is_url(folder) else os.path.join(folder, path)


def matches(pattern: str, folder: str) -> list[str]:
    """Find the files that match a pattern, sorted, relative to a folder; raises as `opened`."""
    whole = join(folder, pattern)
    if not is_url(whole):
        return sorted(glob.glob(pattern, root_dir=folder or None, recursive=True))
    with _answering(whole):
        system, path = _system(whole)
        found = sorted(system.unstrip_protocol(each) for each in system.glob(path))
    return [each.removeprefix(folder.rstrip("/") + "/") for each in found] if is_url(folder) else found


@contextmanager
def opened(path: str) -> Iterator[BinaryIO]:
    """Open a file to read.

    Raises:
        OSError: It cannot be read.
        StoreError: Its store does not answer.
    """
    if not is_url(path):
        with open_input(path) as file:
            yield file
        return
    with _answering(path):
        system, inner = _system(path)
        with system.open(inner, "rb") as file:
            yield file


def read(path: str) -> bytes:
    """Read a small file; raises as `opened`."""
    with opened(path) as file:
        return file.read()


def read_if_there(path: str) -> bytes | None:
    """Read a small file; None if there is none."""
    try:
        return read(path)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        return None


def fetch(path: str, local: str) -> None:
    """Copy the file of a URL to a local path, and make its folders; raises as `opened`."""
    os.makedirs(os.path.dirname(local), exist_ok=True)
    with opened(path) as source, open(local, "wb") as target:
        while block := source.read(2**20):
            target.write(block)


def put(path: str, data: bytes) -> None:
    """Write a file completely or not at all, and make its folders.

    Raises:
        OSError: It cannot be written.
        StoreError: Its store does not answer.
    """
    aside = f"{path}.part-{os.urandom(6).hex()}"
    if not is_url(path):
        os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
        try:
            with open(aside, "xb") as file:
                file.write(data)
            os.replace(aside, path)
        except BaseException:
            with suppress(OSError):
                os.unlink(aside)
            raise
        return
    with _answering(path):
        system, inner = _system(path)
        if path.partition("://")[0] in _ATOMIC:
            system.pipe_file(inner, data)
            return
        system.makedirs(posixpath.dirname(inner), exist_ok=True)
        system.pipe_file(_system(aside)[1], data)
        system.mv(_system(aside)[1], inner)


def _system(url: str) -> tuple[Any, str]:
    """Open the store of a URL; also return the path within it."""
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise WrinkleError("URLs need fsspec: pip install 'wrinklecli[batch]'", where=url) from error
    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise WrinkleError(f"cannot be reached: {error}", where=url) from error
    return system, path


@contextmanager
def _answering(url: str) -> Iterator[None]:
    """Turn errors of store libraries into an `OSError` that has its reason, or into a `StoreError`."""
    try:
        yield
    except (WrinkleError, MemoryError):
        raise
    except OSError as error:
        own = type(error).__module__ != "builtins"  # such as broken connections of aiohttp
        if own or isinstance(error, ConnectionError | TimeoutError) or error.errno in _TEMPORARY:
            raise _unanswered(url, error) from error
        number = error.errno or _NUMBERS.get(type(error), errno.EIO)
        reason = next(iter((error.strerror or str(error)).splitlines()), "")
        is_path = reason in url or " " not in reason  # as some libraries report a missing file
        raise OSError(number, os.strerror(number) if is_path else reason) from error
    except Exception as error:
        raise _unanswered(url, error) from error


def _unanswered(url: str, error: Exception) -> StoreError:
    return StoreError(f"the store does not answer: {type(error).__name__}: {error}", where=url)
