"""Read a manifest (YAML, CSV or JSON lines) into jobs: apply defaults, expand levels of detail and patterns.

A reader makes a tree of nodes with line numbers, the schema checks the tree, and the valid entries become jobs. All
problems are reported at once, each with its line. `configs/batch.md` is the reference.
"""

import os
import posixpath
import re
from collections.abc import Iterator, Mapping
from typing import Any

from wrinklecli.batch import stores
from wrinklecli.batch.jobs import BatchJob
from wrinklecli.batch.manifest_schema import JOB_KEYS, MANIFEST_SCHEMA, OPTION_KEYS, OWN_KEYS
from wrinklecli.batch.tables import read_csv, read_json_lines
from wrinklecli.errors import ConfigError
from wrinklecli.tools.checked import Format, Place, check
from wrinklecli.tools.json_schema import Items
from wrinklecli.tools.yaml_tree import Node, Problem, path_to, printable, read_tree

_FORMAT = Format(MANIFEST_SCHEMA, [Items("job", JOB_KEYS, OWN_KEYS)])
_READERS = {".yaml": read_tree, ".yml": read_tree, ".csv": read_csv, ".jsonl": read_json_lines}
_LISTS = ("tools", "anims", "anim", "clip", "tool")
_PATHS = ("tools", "anims", "anim", "out", "tracked", "frames_dir", "report", "timings")
_OUTPUTS = ("out", "report", "timings", "frames_dir")
_OUTPUT_ENDINGS = (".glb", ".gltf")
_MAX_MANIFEST = 10**8  # bytes: as many jobs as there may be, of 1 kB


def read_manifest(path: str, given: Mapping[str, Any]) -> list[BatchJob]:
    """Read a manifest at a path or URL; the paths in it are relative to its folder.

    `given` has values from the command line for keys that neither a job nor the defaults name; paths in them are
    relative to the current folder.

    Raises:
        ConfigError: The manifest cannot be read, or has problems (a line each).
        StoreError: Its store does not answer.
    """
    ending = os.path.splitext(path)[1].lower()
    try:
        text = stores.read(stores.plain(path), _MAX_MANIFEST).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot be read: {stores.reason_of(error)}", where=path) from None
    if not text.strip():
        raise ConfigError("the file is empty, expected jobs", where=path)
    root, problems = _READERS[ending](text)
    jobs = _Jobs(path, stores.folder_of(path), given, problems)
    if root is not None:
        refused, wrong = check(root, _FORMAT)
        problems += refused
        jobs.add_all(root, wrong)
    return jobs.finished()


def read_pattern(pattern: str, given: Mapping[str, Any]) -> list[BatchJob]:
    """Make a job for each asset that matches a pattern; raises as `read_manifest`."""
    jobs = _Jobs("", "", given, [])
    jobs.add({"asset": pattern}, Node({}, 0, "", {}), "")
    return jobs.finished()


class _Jobs:
    """Collects jobs, and the problems of entries that cannot become one.

    `name` is the path of the manifest, empty for a pattern of the command line; `given` has the command line's values.
    """

    def __init__(self, name: str, folder: str, given: Mapping[str, Any], problems: list[Problem]) -> None:
        self._name, self._folder, self._given, self._problems = name, folder, given, problems
        self._jobs: list[BatchJob] = []
        # By absolute path: the path as it is written and the entry that writes it; the entry that reads it.
        self._writers: dict[str, tuple[str, int, str]] = {}
        self._readers: dict[str, str] = {}

    def finished(self) -> list[BatchJob]:
        """Return all jobs.

        Raises:
            ConfigError: There are problems.
        """
        for path in sorted(self._writers.keys() & self._readers.keys()):
            written, line, entry = self._writers[path]
            reader = self._readers[path] or "a job"
            self._refuse(line, entry, f"would write over {printable(written)!r}, which {reader} reads")
        if self._problems:
            raise ConfigError.of_all(
                ConfigError(each.message, where=self._where(each.line, each.path))
                for each in sorted(self._problems, key=lambda each: each.line)
            )
        return self._jobs

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
        if missing or half_tracked:
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
        if known == len(self._problems) and not job["out"].lower().endswith(_OUTPUT_ENDINGS):
            message = f"found {printable(job['out'])!r}, which ends neither in .glb nor .gltf"
            self._refuse(line, f"{entry}.out", message)
        if known < len(self._problems):
            return
        job["asset"] = stores.join(self._folder, asset)
        options = {key: job.pop(key) for key in list(job) if key in OPTION_KEYS and key not in ("report", "timings")}
        self._jobs.append(BatchJob(where=self._where(line, entry), options=options, **job))
        self._claim(self._jobs[-1], line, entry)

    def _paths(
        self, key: str, text: str, words: Mapping[str, str], folder: str, line: int, entry: str
    ) -> Iterator[str]:
        """Fill `{stem}` and `{folder}` into a path, expand patterns of inputs, and resolve it from a folder."""
        unknown = [word for word in re.findall(r"\{(\w*)\}", text) if word not in words]
        if unknown:
            self._refuse(line, f"{entry}.{key}", f"found {{{unknown[0]}}}, expected {{stem}} or {{folder}}")
            return
        whole = re.sub(r"\{(\w+)\}", lambda word: words[word[1]], text)
        try:
            several = _matches(whole, folder) if key in ("anims", "anim") else [whole]
        except ConfigError as error:
            self._refuse(line, f"{entry}.{key}", str(error))
            return
        yield from (stores.join(folder, each) for each in several)

    def _claim(self, job: BatchJob, line: int, entry: str) -> None:
        """Note the files that a job reads and writes, and refuse an output that another job writes too."""
        values = {**job.options, "out": job.out, "report": job.report, "timings": job.timings}
        outputs = [values[key] for key in _OUTPUTS if values.get(key) is not None]
        if job.tracked is not None:
            outputs += [stores.join(job.tracked, posixpath.basename(each)) for each in job.anims]
        for path in outputs:
            known = stores.absolute(path)
            if known in self._writers:
                other = self._writers[known][2]
                who = other if other != entry else "another asset"
                self._refuse(
                    line, entry, f"{printable(path)!r} is an output of {who} too: each needs a name of its own"
                )
            self._writers[known] = path, line, entry
        for path in job.inputs:
            self._readers.setdefault(stores.absolute(path), entry)

    def _refuse(self, line: int, path: str, message: str) -> None:
        self._problems.append(Problem(line, path.lstrip("."), message))

    def _where(self, line: int, path: str) -> str:
        shown = printable(self._name, len(self._name))
        return f"{shown}:{line}: {path}".rstrip(": ") if line else path


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
