"""Read a manifest (YAML, CSV or JSON lines) into jobs: apply defaults, expand levels of detail and patterns.

A reader makes a tree of nodes with line numbers, the schema checks the tree, and the valid entries become jobs. All
problems are reported at once, each with its line. `configs/batch.md` is the reference.
"""

import os
import posixpath
import re
from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

from wrinklecli.batching import stores
from wrinklecli.batching.conflicts import BatchFiles, kept_apart
from wrinklecli.batching.jobs import BatchJob
from wrinklecli.batching.manifest_schema import JOB_KEYS, MANIFEST_SCHEMA, OPTION_KEYS, OWN_KEYS
from wrinklecli.batching.tables import read_csv, read_json_lines
from wrinklecli.errors import ConfigError, listed
from wrinklecli.files.claims import is_path
from wrinklecli.files.formats import MODEL_ENDINGS
from wrinklecli.tools.checked import Format, Place, check, crowded
from wrinklecli.tools.json_schema import Items
from wrinklecli.tools.yaml_tree import Node, Problem, path_to, printable, read_tree, without_tagged

_FORMAT = Format(MANIFEST_SCHEMA, [Items("job", JOB_KEYS, OWN_KEYS)])
_READERS = {".yaml": read_tree, ".yml": read_tree, ".csv": read_csv, ".jsonl": read_json_lines}
_LISTS = ("tools", "anims", "anim", "clip", "tool")
_PATHS = ("tools", "anims", "anim", "out", "tracked", "frames_dir", "maps_dir", "report", "timings")
_MAX_MANIFEST = 10**8  # bytes: as many jobs as there may be, of 1 kB


def read_manifest(
    path: str,
    given: Mapping[str, Any],
    *,
    report: str | None = None,
    cache: str | None = None,
    junit: str | None = None,
) -> list[BatchJob]:
    """Read a manifest at a path or URL; the paths in it are relative to its folder.

    `given` has values from the command line for keys that neither a job nor the defaults name; paths in them are
    relative to the current folder. `report`, `cache` and `junit` are outputs of the batch itself.

    Raises:
        ConfigError: The manifest cannot be read, has problems, or an output is also an input or another output (a line
            each).
        StoreError: A store does not answer.
    """
    ending = os.path.splitext(path)[1].lower()
    if ending not in _READERS:
        raise ConfigError(f"does not end in {listed(list(_READERS))}", where=path)
    try:
        text = stores.read(stores.plain(path), _MAX_MANIFEST).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot be read: {stores.reason_of(error)}", where=path) from None
    if not text.strip():
        raise ConfigError("the file is empty, expected jobs", where=path)
    root, problems = _READERS[ending](text)
    files = BatchFiles(path, report, cache, junit)
    jobs = _Jobs(files, given, problems)
    if root is not None:
        too_many = crowded(root, _FORMAT)
        refused, wrong = (too_many, None) if too_many else check(root, _FORMAT)
        problems += refused
        if wrong is not None:
            jobs.add_all(root, wrong)
    return jobs.finished()


def read_pattern(
    pattern: str,
    given: Mapping[str, Any],
    *,
    report: str | None = None,
    cache: str | None = None,
    junit: str | None = None,
) -> list[BatchJob]:
    """Make a job for each asset that matches a pattern; arguments and errors are those of `read_manifest`."""
    jobs = _Jobs(BatchFiles("", report, cache, junit), given, [])
    jobs.add({"asset": pattern}, Node({}, 0, "", {}), "")
    return jobs.finished()


class _Jobs:
    """Collects jobs, and the problems of entries that cannot become one.

    `files` are those of the batch itself; `given` has the command line's values.
    """

    def __init__(self, files: BatchFiles, given: Mapping[str, Any], problems: list[Problem]) -> None:
        self._files, self._given, self._problems = files, given, problems
        self._folder = stores.folder_of(files.manifest)
        self._jobs: list[BatchJob] = []
        self._places: list[tuple[int, str]] = []  # line and entry of each job

    def finished(self) -> list[BatchJob]:
        """Return all jobs.

        Raises:
            ConfigError: There are problems.
        """
        jobs, conflicts = kept_apart(self._jobs, [entry for _, entry in self._places], self._files)
        of_batch = [ConfigError(each.message, where=each.path) for each in conflicts if each.job is None]
        for each in conflicts:
            if each.job is not None:
                self._refuse(*self._places[each.job], each.message)
        if of_batch or self._problems:
            of_jobs = (
                ConfigError(problem.message, where=self._where(problem.line, problem.path))
                for problem in sorted(without_tagged(self._problems), key=lambda each: each.line)
            )
            raise ConfigError.of_all(chain(of_batch, of_jobs))
        return jobs

    def add_all(self, root: Node, wrong: set[Place]) -> None:
        """Add the jobs of all entries that the schema accepts."""
        common = root.children.get("defaults")
        inherited = common.value if common is not None and isinstance(common.value, dict) else {}
        defaults = {key: value for key, value in inherited.items() if ("defaults", key) not in wrong}
        jobs = root.children.get("jobs")
        for number, node in jobs.children.items() if jobs is not None and isinstance(jobs.value, list) else ():
            if ("jobs", number) in wrong:
                continue
            entry = path_to("jobs", number)
            values = {**defaults, **node.value}
            levels = values.pop("lods", None)
            if levels is None:
                self.add(values, node, entry)
            elif "asset" in values:
                line = node.children["lods"].line
                self._refuse(line, f"{entry}.lods", "goes without asset: each level of detail has its own")
            else:
                for index, level in node.children["lods"].children.items():
                    self.add({**values, **level.value}, level, f"{entry}.lods[{index}]")

    def add(self, values: Mapping[str, Any], node: Node, entry: str) -> None:
        """Add the jobs of an entry: one for each asset that matches its pattern."""
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
            assets = _matches(stores.plain(values["asset"]), self._folder)
        except ConfigError as error:
            self._refuse(node.line, f"{entry}.asset", str(error))
            return
        for asset in assets:
            self._add_one(asset, values, node.line, entry)

    def _add_one(self, asset: str, values: Mapping[str, Any], line: int, entry: str) -> None:
        """Add the job of one asset, unless a path in it is wrong."""
        known = len(self._problems)
        stem = os.path.splitext(posixpath.basename(asset))[0]
        words = {"stem": stem, "folder": stores.folder_of(asset) or "."}
        job: dict[str, Any] = {}
        for key, value in {**self._given, **values}.items():
            if key in _PATHS:
                texts = [value] if isinstance(value, str) else value
                folder = self._folder if key in values else ""
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
        job["asset"] = stores.join(self._folder, asset)
        options = {key: job.pop(key) for key in list(job) if key in OPTION_KEYS and key not in ("report", "timings")}
        self._jobs.append(BatchJob(where=self._where(line, entry), options=options, **job))
        self._places.append((line, entry))

    def _paths(
        self, key: str, text: str, words: Mapping[str, str], folder: str, line: int, entry: str
    ) -> Iterator[str]:
        """Fill `{stem}` and `{folder}` into a path, expand patterns of inputs, and resolve it from a folder."""
        unknown = [word for word in re.findall(r"\{(\w*)\}", text) if word not in words]
        if unknown:
            self._refuse(line, f"{entry}.{key}", f"found {{{unknown[0]}}}, expected {{stem}} or {{folder}}")
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
        self._problems.append(Problem(line, path.lstrip("."), message))

    def _where(self, line: int, path: str) -> str:
        shown = printable(self._files.manifest, len(self._files.manifest))
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
