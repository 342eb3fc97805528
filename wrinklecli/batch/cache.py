"""A cache of finished outputs, in a folder or a store that many processes share.

    CACHEDIR.TAG            tells backup programs to skip the folder
    keys/ab/<key>.json      the record of a job: its files by digest, and its outcome
    files/ab/<digest>       the contents of the files
    outs/ab/<path>.json     the inputs of the output at a path, to say later what has changed

Each file is written whole, and a record after the files that it names. A damaged entry counts as missing.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from wrinklecli.batch import stores
from wrinklecli.batch.cache_keys import Parts
from wrinklecli.errors import WrinkleError

TAG = "CACHEDIR.TAG"
ENTRIES = ("keys", "files", "outs")
"""The folders of a cache."""

_VERSION = 1
# The signature is from bford.info/cachedir.
_TAG = b"Signature: 8a477f597d28d172789f06886806bc55\n# A cache of wrinkle batch: it may be deleted at any time.\n"


@dataclass(frozen=True, slots=True)
class CachedFile:
    """An output file: its root (such as `out`), its path in the root, and the SHA-256 of its content."""

    root: str
    path: str
    digest: str


@dataclass(frozen=True, slots=True)
class Record:
    """The output files of a job, the main one last, and some fields of its outcome."""

    files: tuple[CachedFile, ...]
    outcome: Mapping[str, Any]


class Cache:
    """A cache at a path or a URL. Methods that write raise WrinkleError if they cannot."""

    def __init__(self, place: str) -> None:
        self._place = place

    def open(self) -> None:
        """Make sure that the cache can be written."""
        tag = stores.join(self._place, TAG)
        with suppress(OSError):
            if stores.read(tag) == _TAG:
                return
        self._put(tag, _TAG)

    def find(self, key: str) -> Record | None:
        """Look up the outputs of a job by its key."""
        entry = self._read("keys", key)
        try:
            if entry is None or entry["cache"] != _VERSION:
                return None
            files = tuple(CachedFile(*map(str, each)) for each in entry["files"])
            return Record(files, dict(entry["said"])) if files else None
        except (KeyError, TypeError, ValueError):
            return None

    def content(self, file: CachedFile, most: int) -> bytes | None:
        """Read the content of a file of at most so many bytes; None if it is lost, damaged or larger."""
        try:
            data = stores.read(self._path("files", file.digest), most)
        except OSError:
            return None
        return data if hashlib.sha256(data).hexdigest() == file.digest else None

    def keep(self, key: str, files: Iterable[tuple[str, str, str]], outcome: Mapping[str, Any]) -> None:
        """Store the outputs of a job: root, path in the root and present place of each file, the main one last.

        Raises:
            OSError: A file cannot be read.
        """
        kept = []
        for root, path, now in files:
            with stores.opened(now) as file:
                data = file.read()
            digest = hashlib.sha256(data).hexdigest()
            self._put(self._path("files", digest), data)
            kept.append([root, path, digest])
        self._put(self._path("keys", key), json.dumps({"cache": _VERSION, "files": kept, "said": outcome}).encode())

    def parts_of_output(self, out: str) -> Parts | None:
        """The inputs that the output at a path was made from, as last noted."""
        entry = self._read("outs", _name_of(out))
        return entry.get("parts") if entry is not None else None

    def note_output(self, out: str, parts: Parts) -> None:
        """Note the inputs that the output at a path is made from."""
        self._put(self._path("outs", _name_of(out)), json.dumps({"out": out, "parts": parts}).encode())

    def _path(self, kind: str, name: str) -> str:
        ending = "" if kind == "files" else ".json"
        return stores.join(self._place, f"{kind}/{name[:2]}/{name}{ending}")

    def _read(self, kind: str, name: str) -> dict[str, Any] | None:
        try:
            entry = json.loads(stores.read(self._path(kind, name)))
        except (OSError, ValueError, RecursionError):
            return None
        return entry if isinstance(entry, dict) else None

    def _put(self, path: str, data: bytes) -> None:
        try:
            stores.put(path, data)
        except OSError as error:
            raise WrinkleError(f"the cache cannot be written: {error.strerror or error}", where=path) from error


def _name_of(out: str) -> str:
    return hashlib.sha256(stores.absolute(out).encode("utf-8", "surrogateescape")).hexdigest()
