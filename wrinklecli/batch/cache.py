"""Outputs of earlier bakes by the keys of their jobs, in a folder or a store that many drivers and workers share.

    CACHEDIR.TAG            says to backups what this is
    keys/ab/<key>.json      what a job has made: its files by digest, and what was said of them
    files/ab/<digest>       their contents
    outs/ab/<path>.json     what the output at a path was made from, to say what has changed since

Each is written whole, the record of a key after its files. What is damaged counts as unknown.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from wrinklecli.batch import stores
from wrinklecli.batch.cache_keys import Parts
from wrinklecli.errors import WrinkleError

_VERSION = 1
# As bford.info/cachedir has it.
_TAG = b"Signature: 8a477f597d28d172789f06886806bc55\n# A cache of wrinkle batch: it may be deleted at any time.\n"


@dataclass(frozen=True, slots=True)
class CachedFile:
    """A file that a job has made.

    Attributes:
        root: Which of the job's folders it is in, such as `out`.
        path: From there.
        digest: Of its content.
    """

    root: str
    path: str
    digest: str


@dataclass(frozen=True, slots=True)
class Record:
    """What a job has made.

    Attributes:
        files: The main one last.
        said: Of it, as JSON values.
    """

    files: tuple[CachedFile, ...]
    said: Mapping[str, Any]


class Cache:
    """A cache at a path or a URL."""

    def __init__(self, place: str) -> None:
        self._place = place

    def open(self) -> None:
        """Make sure that it can be written; raises as `keep`."""
        tag = stores.join(self._place, "CACHEDIR.TAG")
        with suppress(OSError):
            if stores.read(tag) == _TAG:
                return
        self._put(tag, _TAG)

    def find(self, key: str) -> Record | None:
        """What the job of a key has made."""
        found = self._read("keys", key)
        try:
            if found is None or found["cache"] != _VERSION:
                return None
            files = tuple(CachedFile(*map(str, each)) for each in found["files"])
            return Record(files, dict(found["said"])) if files else None
        except (KeyError, TypeError, ValueError):
            return None

    def content(self, file: CachedFile) -> bytes | None:
        """The content of a file; none where it is lost or damaged."""
        try:
            data = stores.read(self._path("files", file.digest))
        except OSError:
            return None
        return data if hashlib.sha256(data).hexdigest() == file.digest else None

    def keep(self, key: str, files: Iterable[tuple[str, str, str]], said: Mapping[str, Any]) -> None:
        """Keep what a job has made.

        Args:
            key: Of the job.
            files: Root, path from there, and where each is now; the main one last.
            said: Of it, as JSON values.

        Raises:
            OSError, WrinkleError: It cannot be written.
        """
        kept = []
        for root, path, now in files:
            data = stores.read(now)
            digest = hashlib.sha256(data).hexdigest()
            self._put(self._path("files", digest), data)
            kept.append([root, path, digest])
        self._put(self._path("keys", key), json.dumps({"cache": _VERSION, "files": kept, "said": said}).encode())

    def made_from(self, out: str) -> Parts | None:
        """What the output at a path was made from when this cache saw it last."""
        found = self._read("outs", _name_of(out))
        return found.get("parts") if found is not None else None

    def note(self, out: str, parts: Parts) -> None:
        """Say what the output at a path is made from; raises as `keep`."""
        self._put(self._path("outs", _name_of(out)), json.dumps({"out": out, "parts": parts}).encode())

    def _path(self, kind: str, name: str) -> str:
        ending = "" if kind == "files" else ".json"
        return stores.join(self._place, f"{kind}/{name[:2]}/{name}{ending}")

    def _read(self, kind: str, name: str) -> dict[str, Any] | None:
        try:
            found = json.loads(stores.read(self._path(kind, name)))
        except (OSError, ValueError, RecursionError):
            return None
        return found if isinstance(found, dict) else None

    def _put(self, path: str, data: bytes) -> None:
        try:
            stores.put(path, data)
        except OSError as error:
            raise WrinkleError(f"the cache cannot be written: {error.strerror or error}", where=path) from error


def _name_of(out: str) -> str:
    known = out if stores.is_url(out) else os.path.abspath(out)
    return hashlib.sha256(known.encode("utf-8", "surrogateescape")).hexdigest()
