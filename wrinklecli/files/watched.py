"""Files that others write: whether they have changed, once they are written."""

import os
from collections.abc import Iterable


class Watched:
    """Files that are looked at again and again.

    Args:
        paths: Of them; they need not be there.
    """

    def __init__(self, paths: Iterable[str | os.PathLike[str]]) -> None:
        self._paths = tuple(dict.fromkeys(os.fspath(path) for path in paths))
        self._known = self._last = self._look()

    def instead(self, paths: Iterable[str | os.PathLike[str]]) -> "Watched":
        """Other files from now on, as a reader knows only afterwards which they are; those of both count as before."""
        found = Watched(paths)
        known = dict(zip(self._paths, self._known, strict=True))
        found._known = tuple(known.get(path, now) for path, now in zip(found._paths, found._known, strict=True))
        return found

    def changed(self) -> bool:
        """Whether there is something new since the last time that this was so: the same at two looks.

        A program that writes a file is at it for a while.
        """
        now, before = self._look(), self._last
        self._last = now
        if now == self._known or now != before:
            return False
        self._known = now
        return True

    def _look(self) -> tuple[tuple[int, ...] | None, ...]:
        return tuple(map(_state, self._paths))


def _state(path: str) -> tuple[int, ...] | None:
    """What tells one content of a file from another; None where it is not there."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
