"""Opens inputs, which must be regular files: a pipe would block, and a device may never end."""

import errno
import os
import stat
from typing import BinaryIO


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file to read.

    Raises:
        OSError: The file cannot be read, or is not a regular file.
        ValueError: The path has a null character.
    """
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
