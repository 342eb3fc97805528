"""Opens inputs, which must be regular files as a pipe would block and a device may never end, and watches them."""

import errno
import os
import stat
from collections.abc import Iterable
from typing import BinaryIO


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file to read.

    Raises:
        OSError: The file cannot be read, or is not a regular file, or its path has a null character.
    """
    if "\0" in os.fsdecode(path):  # Python raises a ValueError, whose words differ from version to version
        raise OSError(errno.EINVAL, "its path has a null character")
    # The check comes first, since opening some devices has effects.
    _refuse_others(os.stat(path).st_mode)
    return open(path, "rb", opener=_open)


def lies_below(path: str | os.PathLike[str], folder: str) -> bool:
    """True if a path leads into a folder, whatever links are on the way."""
    inside = os.path.realpath(folder or os.curdir)
    return os.path.commonpath([inside, os.path.realpath(path)]) == inside


def _open(path: str, flags: int) -> int:
    """Open a path, which may have become a pipe meanwhile, without blocking."""
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    try:
        _refuse_others(os.fstat(descriptor).st_mode)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _refuse_others(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file")


class Watched:
    """Files, which need not exist, that are looked at repeatedly for changes by other programs."""

    def __init__(self, paths: Iterable[str | os.PathLike[str]]) -> None:
        self._paths = tuple(dict.fromkeys(os.fspath(path) for path in paths))
        self._known = self._last = self._look()

    def instead(self, paths: Iterable[str | os.PathLike[str]]) -> "Watched":
        """Watch other files from now on; files in both lists keep their known state."""
        found = Watched(paths)
        known = dict(zip(self._paths, self._known, strict=True))
        found._known = tuple(known.get(path, now) for path, now in zip(found._paths, found._known, strict=True))
        return found

    def changed(self) -> bool:
        """True if a file has changed since the last change, and not since the last look: writing may take a while."""
        now, before = self._look(), self._last
        self._last = now
        if now == self._known or now != before:
            return False
        self._known = now
        return True

    def _look(self) -> tuple[tuple[int, ...] | None, ...]:
        return tuple(map(_state, self._paths))


def _state(path: str) -> tuple[int, ...] | None:
    """Numbers that change with the content of a file; None if it does not exist."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
