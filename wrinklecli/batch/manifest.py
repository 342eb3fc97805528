"""A manifest (YAML, CSV or JSON lines) to jobs: defaults inherited, levels of detail and patterns expanded.

Three steps, as for tools files: text to a tree that knows its lines, the tree checked by the schema, what is right in
it made into jobs. All problems are reported at once, each with its line. `configs/batch.md` is the reference.
"""

import os
import posixpath
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from wrinklecli.batch import stores
from wrinklecli.batch.jobs import BatchJob
from wrinklecli.batch.manifest_schema import JOB_KEYS, MANIFEST_SCHEMA, OPTION_KEYS, OWN_KEYS
from wrinklecli.batch.tables import read_csv, read_json_lines
from wrinklecli.errors import ConfigError
from wrinklecli.tools.checked import Format, Place, check
from wrinklecli.tools.yaml_tree import Node, Problem, path_to, printable, read_tree

_FORMAT = Format(MANIFEST_SCHEMA, "job", JOB_KEYS, OWN_KEYS)
_READERS = {".yaml": read_tree, ".yml": read_tree, ".csv": read_csv, ".jsonl": read_json_lines}
ENDINGS = tuple(_READERS)
"""Of the names of manifests."""

_LISTS = ("tools", "anims", "anim", "clip", "tool")
_PATHS = ("tools", "anims", "anim", "out", "tracked", "frames_dir", "report", "timings")
_OUTPUTS = ("out", "report", "timings", "frames_dir")


@dataclass(slots=True)
class _Reading:
    """Jobs as they are found, and what is wrong with them.

    Attributes:
        folder: Of the manifest: its paths are as seen from there.
        given: What the command line says for all jobs.
        jobs: Found so far.
        problems: Found so far.
        writers: Paths as they are written, and where the jobs stand that write them.
        readers: Those that read one.
    """

    folder: str
    given: Mapping[str, Any]
    jobs: list[BatchJob] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    writers: dict[str, tuple[str, Problem]] = field(default_factory=dict)
    readers: dict[str, str] = field(default_factory=dict)


def read_manifest(path: str, given: Mapping[str, Any]) -> list[BatchJob]:
    """Read a manifest.

    Args:
        path: Or URL; its paths are as seen from its folder.
        given: Keys of jobs that hold where neither a job nor the defaults say otherwise, paths as seen from here.

    Raises:
        ConfigError: It cannot be read, or all of its problems, a line each.
        StoreError: Its store does not answer.
    """
    ending = os.path.splitext(path)[1].lower()
    try:
        text = stores.read(stores.plain(path)).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConfigError(f"cannot be read: {reason}", where=path) from None
    if not text.strip():
        raise ConfigError("the file is empty, expected jobs", where=path)
    root, problems = _READERS[ending](text)
    reading = _Reading(folder_of(path), given, problems=problems)
    if root is not None:
        refused, wrong = check(root, _FORMAT)
        reading.problems += refused
        _expand(root, wrong, reading, path)
    return _finished(reading, path)


def read_pattern(pattern: str, given: Mapping[str, Any]) -> list[BatchJob]:
    """A job for each asset that a pattern stands for; raises as `read_manifest`."""
    reading = _Reading("", given)
    _add({"asset": pattern}, Node({}, 0, "", {}), "", reading, pattern)
    return _finished(reading, "")


def folder_of(path: str) -> str:
    """The folder of a path or URL, without a slash at its end."""
    return posixpath.dirname(path) if stores.is_url(path) else os.path.dirname(path)


def _finished(reading: _Reading, name: str) -> list[BatchJob]:
    problems = [*reading.problems, *_overwriting(reading)]
    if problems:
        raise ConfigError.of_all(
            ConfigError(each.message, where=_place(name, each.line, each.path))
            for each in sorted(problems, key=lambda each: each.line)
        )
    return reading.jobs


def _place(name: str, line: int, path: str) -> str:
    shown = printable(name, len(name))
    return f"{shown}:{line}: {path}".rstrip(": ") if line else path


def _expand(root: Node, wrong: set[Place], reading: _Reading, name: str) -> None:
    """Make the jobs of which nothing is wrong."""
    common = root.children.get("defaults")
    given = common.value if common is not None and isinstance(common.value, dict) else {}
    defaults = {key: value for key, value in given.items() if ("defaults", key) not in wrong}
    jobs = root.children.get("jobs")
    for number, node in jobs.children.items() if jobs is not None and isinstance(jobs.value, list) else ():
        if ("jobs", number) in wrong:
            continue
        path = path_to("jobs", number)
        values = {**defaults, **node.value}
        levels = values.pop("lods", None)
        if levels is None:
            _add(values, node, path, reading, name)
        elif "asset" in values:
            message = "goes without asset: each level of detail has its own"
            reading.problems.append(Problem(node.children["lods"].line, f"{path}.lods", message))
        else:
            for index, level in node.children["lods"].children.items():
                _add({**values, **level.value}, level, f"{path}.lods[{index}]", reading, name)


def _add(values: Mapping[str, Any], node: Node, path: str, reading: _Reading, name: str) -> None:
    """Add the jobs of an entry: one for each asset that its pattern stands for."""
    faults = []
    for key in ("asset", "tools", "out"):
        if key not in values and key not in reading.given:
            faults.append(Problem(node.line, f"{path}.{key}".lstrip("."), "required, but missing"))
    if ("anims" in values) != ("tracked" in values):
        faults.append(Problem(node.line, path, "anims and tracked go together: files, and the folder for them"))
    if faults:
        reading.problems += faults
        return
    pattern = stores.plain(values["asset"])
    try:
        assets = matches_of(pattern, reading.folder)
    except ConfigError as error:
        place = f"{path}.asset".lstrip(".")
        reading.problems.append(Problem(node.line, place, str(error)))
        return
    for asset in assets:
        where = _place(name, node.line, path)
        _add_one(asset, values, Problem(node.line, path, where), reading)


def matches_of(pattern: str, folder: str) -> list[str]:
    """The files that a path stands for: it, unless it is a pattern.

    Raises:
        ConfigError: No file is like that, or nobody may know.
        StoreError: Its store does not answer.
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


def _add_one(asset: str, values: Mapping[str, Any], place: Problem, reading: _Reading) -> None:
    """Add the job of one asset.

    Args:
        asset: As the manifest has it.
        values: Of the job.
        place: Where it stands; its message is that place for people.
        reading: Where to add it.
    """
    stem = os.path.splitext(posixpath.basename(asset))[0]
    words = {"stem": stem, "folder": folder_of(asset) or "."}
    faults: list[Problem] = []

    def filled(key: str, text: str, folder: str) -> Iterator[str]:
        unknown = [word for word in re.findall(r"\{(\w*)\}", text) if word not in words]
        if unknown:
            message = f"found {{{unknown[0]}}}, expected {{stem}} or {{folder}}"
            faults.append(Problem(place.line, f"{place.path}.{key}".lstrip("."), message))
            return
        whole = re.sub(r"\{(\w+)\}", lambda word: words[word[1]], text)
        try:
            several = matches_of(whole, folder) if key in ("anims", "anim") else [whole]
        except ConfigError as error:
            faults.append(Problem(place.line, f"{place.path}.{key}".lstrip("."), str(error)))
            return
        yield from (stores.join(folder, each) for each in several)

    made: dict[str, Any] = {}
    for key, value in {**reading.given, **values}.items():
        folder = reading.folder if key in values else ""
        texts = [value] if isinstance(value, str) and key in _LISTS else value
        if key in _LISTS:
            made[key] = tuple(
                part for text in texts for part in (filled(key, text, folder) if key in _PATHS else [text])
            )
        else:
            made[key] = next(filled(key, value, folder), "") if key in _PATHS else value
    if not faults and not made["out"].lower().endswith((".glb", ".gltf")):
        message = f"found {printable(made['out'])!r}, which ends neither in .glb nor .gltf"
        faults.append(Problem(place.line, f"{place.path}.out".lstrip("."), message))
    made["asset"] = stores.join(reading.folder, asset)
    reading.problems += faults
    if not faults:
        reading.jobs.append(_job(made, place.message))
        _claim(made, place, reading)


def _job(made: Mapping[str, Any], where: str) -> BatchJob:
    options = {key: value for key, value in made.items() if key in OPTION_KEYS and key not in ("report", "timings")}
    rest = {key: value for key, value in made.items() if key not in options}
    return BatchJob(where=where, options=options, **rest)


def _claim(made: Mapping[str, Any], place: Problem, reading: _Reading) -> None:
    """Note what a job reads and writes, and refuse what another one writes, too."""
    outputs = [made[key] for key in _OUTPUTS if key in made]
    outputs += [stores.join(made["tracked"], posixpath.basename(each)) for each in made.get("anims", ())]
    for path in outputs:
        known = _known(path)
        if known in reading.writers:
            other = reading.writers[known][1].path
            who = other if other != place.path else "another asset"
            message = f"{printable(path)!r} is an output of {who} too: each needs a name of its own"
            reading.problems.append(Problem(place.line, place.path, message))
        reading.writers[known] = path, place
    for path in (made["asset"], *made["tools"], *made.get("anim", ()), *made.get("anims", ())):
        reading.readers.setdefault(_known(path), place.path)


def _known(path: str) -> str:
    """By which a file is known, however its path is written."""
    return path if stores.is_url(path) else os.path.abspath(path)


def _overwriting(reading: _Reading) -> Iterator[Problem]:
    """Outputs that are inputs, of whichever job."""
    for known in sorted(reading.writers.keys() & reading.readers.keys()):
        path, place = reading.writers[known]
        message = f"would write over {printable(path)!r}, which {reading.readers[known] or 'a job'} reads"
        yield Problem(place.line, place.path, message)
