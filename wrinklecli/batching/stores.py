"""Files by path or by URL (fsspec): they are read, listed, and written whole or not at all.

A file at a URL is copied to this machine before anything looks at it, and the copy has limits of size and time.
"""

import asyncio
import errno
import glob
import os
import posixpath
import re
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.files.inputs import open_input
from wrinklecli.files.workplace import Workplace
from wrinklecli.numeric.memory import MAX_MEMORY, held, shown_bytes

_PATIENCE = 30.0  # seconds until an answer begins, or without a byte: ten times what a busy store takes to answer
_LISTED = 10  # times as long for a whole list of files, which arrives unwatched
_LEAST = 2**15  # bytes in that time, 1 kB/s: a tenth of the slowest line on which anybody would bake
_WEB = ("http://", "https://")
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
    with held(MAX_MEMORY), _answering(whole):  # nobody says how long a list will be
        system, path = _system(whole, _LISTED * _PATIENCE)
        found = sorted(system.unstrip_protocol(each) for each in system.glob(path))
    return [each.removeprefix(folder.rstrip("/") + "/") for each in found] if is_url(folder) else found


@contextmanager
def opened(path: str, most: int = MAX_MEMORY) -> Iterator[BinaryIO]:
    """Open a file to read; one at a URL has at most so many bytes.

    Raises:
        OSError: It cannot be read.
        StoreError: Its store does not answer.
    """
    if not is_url(path):
        with open_input(path) as file:
            yield file
        return
    with scratch() as folder:
        fetch(path, local := os.path.join(folder, "file"), most)
        with open(local, "rb") as file:
            yield file


def read(path: str, most: int = MAX_MEMORY) -> bytes:
    """Read a file of at most so many bytes; raises as `opened`."""
    with opened(path, most) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise _too_large(len(data), most)
    return data


def read_if_there(path: str) -> bytes | None:
    """Read a file; None if there is none."""
    try:
        return read(path)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        return None


@contextmanager
def scratch() -> Iterator[str]:
    """Give a temporary folder; a later run removes it if this one is killed.

    Raises:
        BakeError: No folder can be made.
    """
    workplace = Workplace(tempfile.gettempdir())
    try:
        try:
            workplace.make()
            os.mkdir(folder := workplace.next_path())
        except OSError as error:
            raise BakeError(f"cannot be written: {error.strerror}", where=tempfile.gettempdir()) from error
        yield folder
    finally:
        workplace.remove()


def fetch(url: str, local: str, most: int) -> None:
    """Copy the file of a URL, of at most so many bytes, to a local path, and make its folders; raises as `opened`.

    An archive, as in `zip://a.glb::https://…`, is copied too, and may have as many bytes.
    """
    os.makedirs(os.path.dirname(local), exist_ok=True)
    inner, chained, last = url.rpartition("::")
    with _answering(url):
        if not (chained and is_url(last)):
            _copy(url, local, most)
            return
        with scratch() as folder, held(most):  # the list of an archive's files may be long
            fetch(last, archive := os.path.join(folder, "archive"), most)
            _copy(f"{inner}::file://{_unpacked(archive, last, most)}", local, most)


def _copy(url: str, local: str, most: int) -> None:
    """Copy a file completely or not at all, while a watch looks at its size and pace."""
    system, path = _system(url)
    from fsspec.callbacks import Callback

    if "::" in url:
        _refuse_large(system.size(path), most)  # as the archive says
    try:
        system.get_file(path, local, callback=Callback(hooks={"watch": _Watch(most)}))
    except BaseException:
        with suppress(OSError):
            os.unlink(local)
        raise


def _unpacked(archive: str, url: str, most: int) -> str:
    """Unpack a compressed archive, such as a .tar.gz, in at most so many bytes; give the path of the result."""
    import fsspec
    from fsspec.utils import infer_compression

    compression = infer_compression(url)
    if compression in (None, "zip"):
        return archive
    watch, size = _Watch(most), 0
    with fsspec.open(archive, compression=compression) as packed, open(f"{archive}.unpacked", "wb") as file:
        while block := packed.read(2**20):
            size += file.write(block)
            watch(None, size)
    return file.name


class _Watch:
    """Ends a transfer that gets too large or too slow; fsspec calls it after each block."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._since: float | None = None
        self._arrived = 0

    def __call__(self, size: int | None, value: int, **_: Any) -> None:
        """Check the bytes that are announced, and that have arrived.

        Raises:
            OSError: There are too many.
            TimeoutError: Too few have arrived lately.
        """
        _refuse_large(max(size or 0, value), self._most)
        now = time.monotonic()
        if self._since is None or value - self._arrived >= _LEAST:
            self._since, self._arrived = now, value
        elif now - self._since > _PATIENCE:
            raise TimeoutError(f"less than {shown_bytes(_LEAST)} in {_PATIENCE:.3g} s")


def _refuse_large(size: int | None, most: int) -> None:
    if size is not None and size > most:
        raise _too_large(size, most)


def _too_large(size: int, most: int) -> OSError:
    return OSError(errno.EFBIG, f"has {shown_bytes(size)} or more, and at most {shown_bytes(most)} are read")


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


def _system(url: str, total: float | None = None) -> tuple[Any, str]:
    """Open the store of a URL; also return the path within it. Answers of web servers take `total` seconds at most."""
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise WrinkleError("URLs need fsspec: pip install 'wrinklecli[batch]'", where=url) from error
    try:
        # The library for web servers waits for ever for a byte, and ends long transfers after five minutes.
        system, path = url_to_fs(url, **(_web_options(total) if url.startswith(_WEB) else {}))
    except (ImportError, ValueError) as error:
        raise WrinkleError(f"cannot be reached: {error}", where=url) from error
    return system, path


def _web_options(total: float | None) -> dict[str, Any]:
    from aiohttp import ClientTimeout

    timeout = ClientTimeout(total=total, sock_connect=_PATIENCE, sock_read=_PATIENCE)
    return {"client_kwargs": {"timeout": timeout, "middlewares": (_begun,)}}


async def _begun(request: Any, ask: Callable[[Any], Awaitable[Any]]) -> Any:
    """Ask a web server, and wait for the end of the head of its answer, of which each byte may come in time."""
    return await asyncio.wait_for(ask(request), _PATIENCE)


@contextmanager
def _answering(url: str) -> Iterator[None]:
    """Turn errors of store libraries into an `OSError` that has its reason, or into a `StoreError`."""
    try:
        yield
    except (WrinkleError, MemoryError):
        raise
    except OSError as error:
        if isinstance(error.__cause__, OSError) and error.errno is None:  # what fsspec calls missing or late
            error = error.__cause__
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
    said = f"{type(error).__name__}: {error}".rstrip(": ")
    return StoreError(f"the store does not answer: {said}", where=url)
