"""Read manifests (YAML, CSV or JSON lines) into jobs: include others, apply defaults, expand levels and patterns.

A reader makes a tree of nodes with line numbers, the schema checks the tree, and the valid entries become jobs. All
problems are reported at once, each with its line. `configs/batch.md` is the reference.
"""

import os
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

from wrinklecli.batching import stores
from wrinklecli.batching.conflicts import NOTHING_WRITTEN, BatchFiles, kept_apart
from wrinklecli.batching.jobs import BatchJob
from wrinklecli.batching.manifest_schema import JOB_KEYS, MANIFEST_SCHEMA, OPTION_KEYS, OWN_KEYS
from wrinklecli.batching.tables import read_csv, read_json_lines
from wrinklecli.errors import ConfigError, listed
from wrinklecli.files.claims import is_path
from wrinklecli.files.formats import MODEL_ENDINGS
from wrinklecli.frozen import dataclass
from wrinklecli.tools.checked import Format, Place, check, crowded, refusal
from wrinklecli.tools.json_schema import Items
from wrinklecli.tools.yaml_tree import Node, Problem, path_to, printable, read_tree, without_tagged

_FORMAT = Format(MANIFEST_SCHEMA, [Items("job", JOB_KEYS, OWN_KEYS)])
_READERS = {".yaml": read_tree, ".yml": read_tree, ".csv": read_csv, ".jsonl": read_json_lines}
_LISTS = ("tools", "anims", "anim", "clip", "tool")
_PATHS = ("tools", "anims", "anim", "out", "tracked", "frames_dir", "maps_dir", "report", "timings")
_MAX_MANIFEST = 10**8  # bytes, with all that it includes: as many jobs as there may be, of 1 kB
_MAX_INCLUDED = 32  # manifests, as a server could name ever others


@dataclass(frozen=True, slots=True)
class _Source:
    """A manifest as it was read: the one that was given, or one that it includes.

    Attributes:
        path: Path or URL.
        root: All that it says.
        wrong: The places that the schema refuses.
    """

    path: str
    root: Node
    wrong: set[Place]

    @property
    def folder(self) -> str:
        """The folder that its paths are relative to."""
        return stores.folder_of(self.path)

    def members(self, *place: str) -> Iterator[tuple[str | int, Node]]:
        """The entries below a place, without those that the schema refuses."""
        node: Node | None = self.root
        for step in place:
            node = node.children.get(step) if node is not None else None
        for key, each in node.children.items() if node is not None else ():
            if (*place, key) not in self.wrong:
                yield key, each


def read_manifest(
    path: str, given: Mapping[str, Any], written: BatchFiles = NOTHING_WRITTEN, *, profile: str | None = None
) -> list[BatchJob]:
    """Read a manifest at a path or URL, and those that it includes; the paths in each are relative to its folder.

    `given` has values from the command line for keys that neither a job nor the defaults name; paths in them are
    relative to the current folder. `profile` is the name of a profile, whose keys override the defaults. `written`
    are outputs of the batch itself.

    Raises:
        ConfigError: The manifest cannot be read, has problems, or an output is also an input or another output (a line
            each).
        StoreError: A store does not answer.
    """
    sources = _Sources()
    try:
        sources.read(path)
    except ConfigError as error:
        raise ConfigError(str(error), where=path) from None
    included = tuple(each.path for each in sources.found if each.path != path)
    jobs = _Jobs(replace(written, manifest=path, included=included), given, sources.problems)
    jobs.add_all(sources.found, profile)
    return jobs.finished()


class _Sources:
    """Reads a manifest and those that it includes, each once, and those that are included first.

    `problems` has the manifest of each problem.
    """

    def __init__(self) -> None:
        self.found: list[_Source] = []
        self.problems: list[tuple[str, Problem]] = []
        self._known: set[str] = set()
        self._remaining = _MAX_MANIFEST

    def read(self, path: str, above: tuple[str, ...] = ()) -> None:
        """Read a manifest; `above` has the identities of those that lead to it.

        Raises:
            ConfigError: The manifest is none, or cannot be read.
        """
        text = self._text(path)
        root, problems = _READERS[_ending(path)](text)
        if root is not None:
            too_many = crowded(root, _FORMAT)
            refused, wrong = (too_many, None) if too_many else check(root, _FORMAT)
            problems += refused
            if wrong is not None:
                source, above = _Source(path, root, wrong), (*above, _identity(path))
                self._known.add(above[-1])
                problems += self._include(source, above)
                self.found.append(source)
        self.problems += [(path, each) for each in problems]

    def _include(self, source: _Source, above: tuple[str, ...]) -> Iterator[Problem]:
        """Read what a manifest includes, and give the problems of this."""
        listed_files = source.root.children.get("include")
        if listed_files is None or ("include",) in source.wrong:
            return
        single = isinstance(listed_files.value, str)
        for key, node in [("", listed_files)] if single else source.members("include"):
            place = "include" if single else path_to("include", key)
            shown = printable(node.value)
            if not is_path(node.value):
                yield Problem(node.line, place, _no_path(node.value))
                continue
            path = stores.join(source.folder, stores.plain(node.value))
            identity = _identity(path)
            if identity in above:
                names = " → ".join(
                    printable(os.path.basename(each)) for each in (*above[above.index(identity) :], path)
                )
                yield Problem(node.line, place, f"found {shown!r}, which leads to itself: {names}")
            elif identity not in self._known and len(self._known) > _MAX_INCLUDED:
                yield Problem(node.line, place, f"found {shown!r}, expected at most {_MAX_INCLUDED} included manifests")
            elif identity not in self._known:
                try:
                    self.read(path, above)
                except ConfigError as error:
                    yield Problem(node.line, place, f"{shown!r} {error}")

    def _text(self, path: str) -> str:
        if _ending(path) not in _READERS:
            raise ConfigError(f"does not end in {listed(list(_READERS))}")
        try:
            data = stores.read(stores.plain(path), self._remaining)
            text = data.decode("utf-8-sig")
        except (OSError, ValueError) as error:
            raise ConfigError(f"cannot be read: {stores.reason_of(error)}") from None
        if not text.strip():
            raise ConfigError("the file is empty, expected jobs")
        self._remaining -= len(data)
        return text


def _ending(path: str) -> str:
    return os.path.splitext(path)[1].lower()


def _identity(path: str) -> str:
    return path if stores.is_url(path) else os.path.realpath(path)


def read_pattern(pattern: str, given: Mapping[str, Any], written: BatchFiles = NOTHING_WRITTEN) -> list[BatchJob]:
    """Make a job for each asset that matches a pattern; arguments and errors are those of `read_manifest`."""
    jobs = _Jobs(written, given, [])
    jobs.add({"asset": pattern}, {}, Node({}, 0, "", {}), "")
    return jobs.finished()


class _Jobs:
    """Collects jobs, and the problems of entries that cannot become one.

    `files` are those of the batch itself; `given` has the command line's values.
    """

    def __init__(self, files: BatchFiles, given: Mapping[str, Any], problems: Sequence[tuple[str, Problem]]) -> None:
        self._files, self._given, self._problems = files, given, list(problems)
        self._manifest = files.manifest  # that of the entry which is looked at
        self._words: dict[str, str] = {}  # what `{profile}` stands for
        self._jobs: list[BatchJob] = []
        self._places: list[tuple[str, int, str]] = []  # manifest, line and entry of each job

    def finished(self) -> list[BatchJob]:
        """Return all jobs.

        Raises:
            ConfigError: There are problems.
        """
        manifest = self._files.manifest
        names = [
            entry if path == manifest else f"{entry} of {printable(path, len(path))}" for path, _, entry in self._places
        ]
        jobs, conflicts = kept_apart(self._jobs, names, self._files)
        of_batch = [ConfigError(each.message, where=each.path) for each in conflicts if each.job is None]
        for each in conflicts:
            if each.job is not None:
                self._manifest, line, entry = self._places[each.job]
                self._refuse(line, entry, each.message)
        if of_batch or self._problems:
            raise ConfigError.of_all(chain(of_batch, self._errors()))
        return jobs

    def _errors(self) -> Iterator[ConfigError]:
        """The problems, those of each manifest by their lines."""
        for path in dict.fromkeys(path for path, _ in self._problems):
            problems = without_tagged(problem for manifest, problem in self._problems if manifest == path)
            for problem in sorted(problems, key=lambda each: each.line):
                yield ConfigError(problem.message, where=_where(path, problem.line, problem.path))

    def add_all(self, sources: Sequence[_Source], profile: str | None) -> None:
        """Add the jobs of all entries that the schema accepts; what a later manifest says overrides earlier ones."""
        sections: list[tuple[str, ...]] = [("defaults",)]
        if profile is not None:
            self._words["profile"] = profile
            if self._has_profile(sources, profile):
                sections.append(("profiles", profile))
        inherited: dict[str, Any] = {}
        folders: dict[str, str] = {}  # of the manifest that gives a key
        for section in sections:
            for source in sources:
                given = {str(key): node.value for key, node in source.members(*section)}
                inherited |= given
                folders |= dict.fromkeys(given, source.folder)
        for source in sources:
            self._manifest = source.path
            for number, node in source.members("jobs"):
                self._add_entry(node, number, inherited, folders, source.folder)
        if not self._jobs and not self._problems:
            self._refuse(1, "jobs", "required, but missing")

    def _has_profile(self, sources: Sequence[_Source], profile: str) -> bool:
        """Tell whether a manifest has a profile; if none has, this is a problem."""
        known = {str(key): node for source in sources for key, node in source.members("profiles")}
        if profile in known or self._problems:
            return profile in known
        own = sources[-1].root
        node = Node(profile, own.children.get("profiles", own).line, printable(profile), {})
        expected = f"expected {' or '.join(known)}" if known else "but no manifest has profiles"
        self._refuse(node.line, "profiles", refusal(node, expected))
        return False

    def _add_entry(
        self, node: Node, number: str | int, inherited: Mapping[str, Any], folders: Mapping[str, str], folder: str
    ) -> None:
        """Add the jobs of an entry: one, or one for each level of detail."""
        entry = path_to("jobs", number)
        values = {**inherited, **node.value}
        folders = {**folders, **dict.fromkeys(node.value, folder)}
        levels = values.pop("lods", None)
        if levels is None:
            self.add(values, folders, node, entry)
        elif "asset" in values:
            line = node.children["lods"].line
            self._refuse(line, f"{entry}.lods", "goes without asset: each level of detail has its own")
        else:
            for index, level in node.children["lods"].children.items():
                own = {**folders, **dict.fromkeys(level.value, folder)}
                self.add({**values, **level.value}, own, level, f"{entry}.lods[{index}]")

    def add(self, values: Mapping[str, Any], folders: Mapping[str, str], node: Node, entry: str) -> None:
        """Add the jobs of an entry: one for each asset that matches its pattern.

        `folders` has, for each key, the folder that its paths are relative to; without one, the current folder.
        """
        missing = [key for key in ("asset", "tools", "out") if key not in values and key not in self._given]
        for key in missing:
            self._refuse(node.line, f"{entry}.{key}", "required, but missing")
        half_tracked = ("anims" in values) != ("tracked" in values)
        if half_tracked:
            self._refuse(node.line, entry, "anims and tracked go together: files, and the folder for them")
        of_a_bake = bool(values.get("replace")) and "maps_dir" in values
        if of_a_bake:
            self._refuse(node.line, f"{entry}.maps_dir", "goes without replace: maps are of an asset without wrinkles")
        if missing or half_tracked or of_a_bake:
            return
        if not is_path(values["asset"]):
            self._refuse(node.line, f"{entry}.asset", _no_path(values["asset"]))
            return
        try:
            assets = _matches(stores.plain(values["asset"]), folders.get("asset", ""))
        except ConfigError as error:
            self._refuse(node.line, f"{entry}.asset", str(error))
            return
        for asset in assets:
            self._add_one(asset, values, folders, node.line, entry)

    def _add_one(
        self, asset: str, values: Mapping[str, Any], folders: Mapping[str, str], line: int, entry: str
    ) -> None:
        """Add the job of one asset, unless a path in it is wrong."""
        known = len(self._problems)
        stem = os.path.splitext(posixpath.basename(asset))[0]
        words = {"stem": stem, "folder": stores.folder_of(asset) or ".", **self._words}
        job: dict[str, Any] = {}
        for key, value in {**self._given, **values}.items():
            if key in _PATHS:
                texts = [value] if isinstance(value, str) else value
                folder = folders.get(key, "")
                paths = [path for text in texts for path in self._paths(key, text, words, folder, line, entry)]
                job[key] = tuple(paths) if key in _LISTS else "".join(paths)
            elif key in _LISTS:
                job[key] = (value,) if isinstance(value, str) else tuple(value)
            else:
                job[key] = value
        if known == len(self._problems) and not job["out"].lower().endswith(MODEL_ENDINGS):
            message = f"found {printable(job['out'])!r}, which does not end in {listed(MODEL_ENDINGS)}"
            self._refuse(line, f"{entry}.out", message)
        if known < len(self._problems):
            return
        job["asset"] = stores.join(folders.get("asset", ""), asset)
        options = {key: job.pop(key) for key in list(job) if key in OPTION_KEYS and key not in ("report", "timings")}
        self._jobs.append(BatchJob(where=_where(self._manifest, line, entry), options=options, **job))
        self._places.append((self._manifest, line, entry))

    def _paths(
        self, key: str, text: str, words: Mapping[str, str], folder: str, line: int, entry: str
    ) -> Iterator[str]:
        """Fill `{stem}` and `{folder}` into a path, expand patterns of inputs, and resolve it from a folder."""
        unknown = [word for word in re.findall(r"\{(\w*)\}", text) if word not in words]
        if unknown:
            known = " or ".join(f"{{{each}}}" for each in words)
            mended = "which needs --profile NAME" if unknown[0] == "profile" else f"expected {known}"
            self._refuse(line, f"{entry}.{key}", f"found {{{unknown[0]}}}, {mended}")
            return
        if not is_path(text):
            self._refuse(line, f"{entry}.{key}", _no_path(text))
            return
        whole = re.sub(r"\{(\w+)\}", lambda word: words[word[1]], text)
        try:
            several = _matches(whole, folder) if key in ("anims", "anim") else [whole]
        except ConfigError as error:
            self._refuse(line, f"{entry}.{key}", str(error))
            return
        yield from (stores.join(folder, each) for each in several)

    def _refuse(self, line: int, path: str, message: str) -> None:
        self._problems.append((self._manifest, Problem(line, path.lstrip("."), message)))


def _where(manifest: str, line: int, path: str) -> str:
    shown = printable(manifest, len(manifest))
    return f"{shown}:{line}: {path}".rstrip(": ") if line else path


def _no_path(text: str) -> str:
    return f"found {printable(text)!r}, which has a null character: no file has such a name"


def _matches(pattern: str, folder: str) -> list[str]:
    """The files that match a pattern; a path without a pattern stands for itself.

    Raises:
        ConfigError: No file matches, or the folder cannot be listed.
        StoreError: The store does not answer.
    """
    if not stores.is_pattern(pattern) or (not stores.is_url(pattern) and os.path.exists(stores.join(folder, pattern))):
        return [pattern]
    try:
        found = stores.matches(pattern, folder)
    except OSError as error:
        raise ConfigError(f"found {printable(pattern)!r}, which cannot be listed: {error.strerror}") from error
    if not found:
        raise ConfigError(f"found {printable(pattern)!r}, which no file is like")
    return found
