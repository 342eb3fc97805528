"""A cache of finished outputs, in a folder or a store that many processes share.

    CACHEDIR.TAG            tells backup programs to skip the folder
    keys/ab/<key>.json      the record of a job: its files by digest, and its outcome
    files/ab/<digest>       the contents of the files
    shapes/ab/<key>         a region of flesh, or folds in contact, as they were solved, for bakes that change others
    outs/ab/<path>.json     the inputs of the output at a path, to say later what has changed

Each file is written whole, and a record after the files that it names. Nothing in a cache is trusted: a record may name
only the outputs of its job, and contents must have their digest. Every other entry counts as missing, with a warning.
"""

import errno
import hashlib
import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from wrinklecli.batching import stores
from wrinklecli.batching.cache_keys import Parts, program
from wrinklecli.batching.job_files import JobFiles
from wrinklecli.batching.jobs import Outcome
from wrinklecli.batching.tables import refuse_constant
from wrinklecli.errors import WrinkleError, shortened
from wrinklecli.frozen import dataclass

TAG = "CACHEDIR.TAG"
ENTRIES = ("keys", "files", "outs", "shapes")
"""The folders of a cache."""

_VERSION = 2  # of a record
_SAID = ("summary", "warnings", "residual", "tallest")  # the fields of an outcome that are kept with its files
_MAX_ENTRY = 2**23  # bytes of a record: the files of 60,000 frames
_DIGEST_BYTES = hashlib.sha256().digest_size
_LONGEST_REASON = 200  # characters of a warning, as an entry may have any text
_DIGEST = re.compile(r"[0-9a-f]{64}")
# Errors for an entry that is not there; some stores deny access to what is missing.
_MISSING = (FileNotFoundError, NotADirectoryError, PermissionError)
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
    """The output files of a job, the main one last, and the fields of its outcome that are kept, by name."""

    files: tuple[CachedFile, ...]
    said: Mapping[str, Any]


class Cache:
    """A cache at a path or a URL. Methods that write raise WrinkleError if they cannot.

    `warnings` collects a line for each entry that was refused.
    """

    def __init__(self, place: str) -> None:
        self._place = place
        self._has_tag = False
        self.warnings: list[str] = []

    def open(self) -> None:
        """Make sure that the cache can be written, and that backup programs know it; what is kept first does so too."""
        tag = stores.join(self._place, TAG)
        with suppress(OSError):
            self._has_tag = self._has_tag or stores.read(tag) == _TAG
        if not self._has_tag:
            self._write(tag, _TAG)
            self._has_tag = True

    def find(self, key: str, outputs: JobFiles) -> Record | None:
        """Look up the outputs of a job by its key; None if there is no record, or one that this job cannot have."""
        entry = self._read("keys", key)
        if entry is None or entry.get("cache") == 1:  # of a wrinkle before this one
            return None
        try:
            return _record(entry, outputs)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            self._refuse("keys", key, f"is not a record of this job ({reason})")
            return None

    def content(self, file: CachedFile, most: int) -> bytes | None:
        """Read the content of a file of at most so many bytes; None if it is lost, damaged or larger."""
        data = self._bytes("files", file.digest, most)
        return self._checked(data, "files", file.digest, bytes.fromhex(file.digest))

    def keep(self, key: str, files: Iterable[tuple[str, str, str]], outcome: Outcome) -> None:
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
        said = {name: getattr(outcome, name) for name in _SAID}
        self._put(self._path("keys", key), json.dumps({"cache": _VERSION, "files": kept, "said": said}).encode())

    def parts_of_output(self, out: str) -> Parts | None:
        """The inputs that the output at a path was made from, as last noted; they may be anything."""
        entry = self._read("outs", _name_of(out))
        parts = entry.get("parts") if entry is not None else None
        return parts if isinstance(parts, dict) else None

    def note_output(self, out: str, parts: Parts) -> None:
        """Note the inputs that the output at a path is made from."""
        self._put(self._path("outs", _name_of(out)), json.dumps({"out": out, "parts": parts}).encode())

    def _path(self, kind: str, name: str) -> str:
        ending = ".json" if kind in ("keys", "outs") else ""
        return stores.join(self._place, f"{kind}/{name[:2]}/{name}{ending}")

    def _bytes(self, kind: str, name: str, most: int) -> bytes | None:
        """Read an entry of at most so many bytes; None if it is missing or cannot be read."""
        try:
            return stores.read(self._path(kind, name), most)
        except OSError as error:
            if not isinstance(error, _MISSING):
                self._refuse(kind, name, f"cannot be read: {stores.reason_of(error)}")
            return None

    def _checked(self, data: bytes | None, kind: str, name: str, digest: bytes) -> bytes | None:
        """The data of an entry; None if there is none, or if its SHA-256 is another one."""
        if data is None or hashlib.sha256(data).digest() == digest:
            return data
        self._refuse(kind, name, "is damaged: its content has another digest")
        return None

    def _read(self, kind: str, name: str) -> dict[str, Any] | None:
        """Read an entry; None if it is missing or is no object of JSON."""
        data = self._bytes(kind, name, _MAX_ENTRY)
        if data is None:
            return None
        try:
            entry = json.loads(data, parse_constant=refuse_constant)
        except (ValueError, RecursionError) as error:
            self._refuse(kind, name, f"is not JSON: {error}")
            return None
        if not isinstance(entry, dict):
            self._refuse(kind, name, "is not an object of JSON")
            return None
        return entry

    def _refuse(self, kind: str, name: str, reason: str) -> None:
        line = f"{self._path(kind, name)}: {shortened(reason, _LONGEST_REASON)}: ignored"
        if line not in self.warnings:
            self.warnings.append(line)

    def _put(self, path: str, data: bytes) -> None:
        self.open()
        self._write(path, data)

    def _write(self, path: str, data: bytes) -> None:
        try:
            self._refuse_links(os.path.dirname(path))
            stores.put(path, data)
        except OSError as error:
            raise WrinkleError(f"the cache cannot be written: {stores.reason_of(error)}", where=path) from error

    def _refuse_links(self, folder: str) -> None:
        """Raise OSError if a link leads from a folder of the cache to another place."""
        if stores.is_url(self._place):
            return
        inside = os.path.join(os.path.realpath(self._place), os.path.relpath(folder, self._place or os.curdir))
        if os.path.realpath(folder) != os.path.normpath(inside):
            raise OSError(errno.ELOOP, "a link leads out of it")


@dataclass(frozen=True, slots=True)
class Solutions:
    """Solutions of flesh and contact in a cache, by this version of the program. Its faults become warnings."""

    cache: Cache

    def find(self, key: str, most: int) -> bytes | None:
        """The solution of a key, of at most so many bytes; None if it is lost or damaged."""
        name = _solution_name(key)
        data = self.cache._bytes("shapes", name, most + _DIGEST_BYTES)
        if data is None:
            return None
        return self.cache._checked(data[_DIGEST_BYTES:], "shapes", name, data[:_DIGEST_BYTES])

    def keep(self, key: str, data: bytes) -> None:
        """Keep a solution behind its SHA-256, if the cache can be written."""
        try:
            place = self.cache._path("shapes", _solution_name(key))
            self.cache._put(place, hashlib.sha256(data).digest() + data)
        except WrinkleError as error:
            self.cache.warnings += [line for line in error.lines if line not in self.cache.warnings]

    def refuse(self, key: str, reason: str) -> None:
        """Warn that what the cache has is not used."""
        self.cache._refuse("shapes", _solution_name(key), reason)


def _solution_name(key: str) -> str:
    return hashlib.sha256(f"{program()} {key}".encode()).hexdigest()


def _record(entry: dict[str, Any], outputs: JobFiles) -> Record:
    """Check an entry.

    Raises:
        KeyError, TypeError, ValueError, OverflowError: It is not the record of a job with these outputs.
    """
    if entry["cache"] != _VERSION:
        raise ValueError(f"its version is {entry['cache']!r}")
    files: dict[tuple[str, str], CachedFile] = {}
    for each in entry["files"]:
        root, path, digest = each
        if not (isinstance(root, str) and isinstance(path, str) and isinstance(digest, str)):
            raise TypeError(f"{each!r} is no file")
        if not _DIGEST.fullmatch(digest) or not outputs.has(root, path, digest) or (root, path) in files:
            raise ValueError(f"{each!r} is not its file")
        files[root, path] = CachedFile(root, path, digest)
    for named in outputs.named:
        if named not in files:
            raise ValueError(f"without {named[1]!r}")
    main = files.pop(outputs.main)
    said = entry["said"]
    warnings = said["warnings"]
    if not isinstance(said["summary"], str) or not isinstance(warnings, list):
        raise TypeError("its outcome is none")
    if not all(isinstance(line, str) for line in warnings):
        raise TypeError("its warnings are none")
    lengths = {name: _length(said[name]) for name in ("residual", "tallest")}
    return Record((*files.values(), main), {"summary": said["summary"], "warnings": tuple(warnings), **lengths})


def _length(value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no length")
    return value


def _name_of(out: str) -> str:
    return hashlib.sha256(stores.absolute(out).encode("utf-8", "surrogateescape")).hexdigest()
