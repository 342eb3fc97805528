"""A run's folder for staged files, and the removal of such folders after killed runs.

The folder is locked as long as its run lives; the system drops the lock with the process, however it ends. Locks may be
unknown to other machines, so their folders are kept for a week.
"""

import os
import re
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache

try:
    import fcntl
except ImportError:  # Windows has no such locks, so that folders of killed runs stay
    fcntl = None  # type: ignore[assignment]

_NAME = re.compile(r"\.wrinkle-([0-9a-f]{8})-[0-9a-f]{16}")
# Seconds after which a folder of another machine is removed: no run leaves its folder unchanged for so long.
_STALE = 7 * 24 * 3600.0


# Seconds for which a run waits for others that rename their files, each of which takes a thousandth; whoever may read a
# folder can hold its lock for ever. And seconds between two looks.
_PATIENCE, _LOOK = 10.0, 0.005


@contextmanager
def locked(folder: str) -> Iterator[None]:
    """Keep other runs from renaming files in a folder; on a disk without locks, and on Windows, nothing does."""
    descriptor = None
    with suppress(OSError):
        descriptor = os.open(folder or os.curdir, os.O_RDONLY) if fcntl else None
    try:
        end = time.monotonic() + _PATIENCE
        while descriptor is not None and time.monotonic() < end:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(_LOOK)
            except OSError:
                break
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


class Workplace:
    """A folder of this run inside `folder`, from which folders of killed runs are removed."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._path = ""
        self._lock: int | None = None
        self._count = 0

    def make(self) -> None:
        """Create the folder; OSError if that fails."""
        # Remove the folders of this user's killed runs.
        with suppress(OSError):
            for name in os.listdir(self._folder):
                found = _NAME.fullmatch(name)
                if found:
                    with suppress(OSError):
                        _remove_if_left(os.path.join(self._folder, name), same_machine=found[1] == _machine())
        while True:
            self._path = os.path.join(self._folder, f".wrinkle-{_machine()}-{os.urandom(8).hex()}")
            os.mkdir(self._path, 0o700)
            if fcntl is None or self._is_locked():
                return
            self.remove()

    def _is_locked(self) -> bool:
        """Lock the folder, unless another run is removing it as an abandoned one."""
        try:
            self._lock = os.open(self._path, os.O_RDONLY)
            fcntl.flock(self._lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except (FileNotFoundError, BlockingIOError):
            return False
        except OSError:  # on a disk without locks nobody removes the folder, as that needs a lock
            return True
        return os.path.isdir(self._path)

    def next_path(self) -> str:
        """A new path in the folder, for a file or a folder."""
        self._count += 1
        return os.path.join(self._path, str(self._count))

    def remove(self) -> None:
        """Remove the folder with its content. This may be called at any moment, and repeatedly."""
        if self._path:
            _remove(self._path)
        if self._lock is not None:
            lock, self._lock = self._lock, None
            os.close(lock)


def _remove_if_left(path: str, *, same_machine: bool) -> None:
    status = os.lstat(path)
    if fcntl is None or not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid():
        return
    if not same_machine and time.time() - status.st_mtime < _STALE:
        return
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _remove(path)
    finally:
        os.close(descriptor)


def _remove(path: str) -> None:
    """Remove a folder and the files in it that have names of ours, and nothing else."""
    with suppress(OSError):
        for name in os.listdir(path):
            if name.isdecimal():
                with suppress(OSError):
                    _remove_one(os.path.join(path, name))
        os.rmdir(path)


def _remove_one(path: str) -> None:
    if stat.S_ISDIR(os.lstat(path).st_mode):
        import shutil  # it imports all kinds of archives

        shutil.rmtree(path, ignore_errors=True)
    else:
        os.unlink(path)


@cache
def _machine() -> str:
    """Eight hexadecimal digits of this machine until it reboots, which other containers on it share."""
    try:
        with open("/proc/sys/kernel/random/boot_id") as file:
            return file.read(8)
    except OSError:
        import platform
        import zlib

        return f"{zlib.crc32(platform.node().encode()):08x}"
