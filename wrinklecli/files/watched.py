"""Notices changes of files that other programs write."""

import os
from collections.abc import Iterable


class Watched:
    """Files, which need not exist, that are looked at repeatedly."""

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
