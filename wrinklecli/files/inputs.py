"""Inputs: regular files. A pipe would be waited for, and a device may never end."""

import errno
import os
import stat
from typing import BinaryIO


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file to read.

    Raises:
        OSError: It cannot be read, or is a pipe, a device or the like.
        ValueError: The path has a null character.
    """
    # Looked at first, since to open some devices does something.
    _refuse_others(os.stat(path).st_mode)
    return open(path, "rb", opener=_open)


def _open(path: str, flags: int) -> int:
    """Open what may have become a pipe meanwhile, without waiting for it."""
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
