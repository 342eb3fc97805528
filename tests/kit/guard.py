"""Outside some folders nothing can be written while a block runs, whatever a forged file asks for.

Within them a disk may be full, read-only or forbidden from some change on.
"""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import get_native_id
from typing import Any

# Events of Python's audit that change files, with the number of paths that begin their arguments.
_CHANGES = {
    "os.chmod": 1,
    "os.link": 2,
    "os.mkdir": 1,
    "os.remove": 1,
    "os.rename": 2,
    "os.rmdir": 1,
    "os.symlink": 2,
    "os.truncate": 1,
}
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_MAKES = ("open", "os.link", "os.mkdir", "os.symlink")  # take room on a disk; others change names, or free room
_DEVICES = ("/dev/", "/proc/")
_LIBRARIES = tuple(os.path.expanduser(f"~/{each}/matplotlib/") for each in (".config", ".cache"))  # caches of their own


@dataclass
class Fault:
    """A disk that fails.

    Attributes:
        name: Of the error: of ENOSPC, what takes room fails from some change on; of EIO one change that does not remove
            a file fails; of EROFS and EACCES every change fails.
        left: Changes that succeed before.
    """

    name: str
    left: int

    def hear(self, event: str) -> None:
        """Raise OSError for a change that fails."""
        if event not in {"ENOSPC": _MAKES, "EIO": (*_MAKES, "os.rename", "os.chmod")}.get(
            self.name, _CHANGES | {"open": 1}
        ):
            return
        self.left -= 1
        if self.left == -1 if self.name == "EIO" else self.left < 0:
            number = getattr(errno, self.name)
            raise OSError(number, os.strerror(number))


class _Guard:
    """The folders in which files may be changed, and the paths elsewhere that were asked for; None changes nothing."""

    def __init__(self) -> None:
        self.folders: tuple[str, ...] | None = None
        self.refused: list[str] = []
        self.fault: Fault | None = None
        self.hooked = False
        self._busy: set[int] = set()

    def hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Refuse an event that would change a file elsewhere."""
        if self.folders is None or (event != "open" and event not in _CHANGES):
            return
        if event == "open":
            changes = isinstance(arguments[2], int) and arguments[2] & _WRITES
            paths = arguments[:1] if changes else ()
        else:
            # The first path of a symbolic link is only what it says.
            paths = arguments[1:2] if event == "os.symlink" else arguments[: _CHANGES[event]]
        thread = get_native_id()
        if not paths or thread in self._busy:
            return
        self._busy.add(thread)
        try:
            # The last argument of most events is the descriptor of the folder that a path is relative to, or -1.
            relative_to = -1 if event in ("open", "os.truncate") else arguments[-1]
            for path in paths:
                if relative_to >= 0 and not isinstance(path, int):
                    path = os.path.join(os.readlink(f"/proc/self/fd/{relative_to}"), os.fsdecode(path))
                within = self._refuse_elsewhere(path, follow=event in ("open", "os.chmod", "os.truncate"))
                if self.fault is not None and within:
                    self.fault.hear(event)
                    break  # a change counts once
        finally:
            self._busy.discard(thread)

    def _refuse_elsewhere(self, path: Any, *, follow: bool) -> bool:
        """Raise PermissionError for a file elsewhere; True for one within the folders."""
        if isinstance(path, int):
            return False
        text = os.fsdecode(path)
        folder, name = os.path.split(os.path.abspath(text))
        real = os.path.realpath(text) if follow else os.path.join(os.path.realpath(folder), name)
        if f"{real}/".startswith(self.folders or ()):
            return True
        # Python keeps what it has compiled of a module when this is first imported.
        if "/__pycache__" not in real and not f"{real}/".startswith((*_DEVICES, *_LIBRARIES)):
            self.refused.append(text)
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), text)
        return False


_GUARD = _Guard()


@contextmanager
def only_within(*folders: Path) -> Iterator[list[str]]:
    """Refuse to change files elsewhere; gives the paths that were asked for."""
    if not _GUARD.hooked:
        sys.addaudithook(_GUARD.hear)
        _GUARD.hooked = True
    _GUARD.refused = []
    _GUARD.folders = tuple(f"{os.path.realpath(folder)}/" for folder in folders)
    try:
        yield _GUARD.refused
    finally:
        _GUARD.folders = None


@contextmanager
def failing(fault: Fault | None) -> Iterator[None]:
    """Let the folders of `only_within` lie on a disk that has a fault."""
    _GUARD.fault = fault
    try:
        yield
    finally:
        _GUARD.fault = None
