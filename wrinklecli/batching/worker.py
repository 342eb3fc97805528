"""Run one job: take its outputs from the cache, or else bake it as `wrinkle bake` does.

The code is the same in this process and in a worker of a cluster. A worker reads and writes the files itself, so that
only small values travel to it and back.
"""

import hashlib
import os
import socket
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from typing import TypeAlias

from wrinklecli.batching import stores
from wrinklecli.batching.cache import Cache, CachedFile, Record, Solutions
from wrinklecli.batching.cache_keys import Parts, difference, key_of, parts_of, program
from wrinklecli.batching.job_files import JobFiles, protect
from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.staging import Staged, send, staged
from wrinklecli.batching.stores import StoreError
from wrinklecli.errors import RefusedError, WrinkleError
from wrinklecli.files.outputs import Outputs
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.memory import is_lack

OpenOutputs: TypeAlias = Callable[[], AbstractContextManager[Outputs]]
"""Opens the outputs that a bake writes."""

_FIRST_PAUSE = 0.5  # seconds before a store is asked again, doubled each time: a busy store needs a rest


class _LostError(Exception):
    """The cache has lost the content of a file, or it is damaged."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of all jobs of a batch: its cache, and how often a job is retried if its store does not answer.

    `program` is the version of the program that started the batch; each worker must have the same.
    """

    cache: str
    program: str
    retries: int = 0


def check_job(job: BatchJob, settings: Settings) -> Outcome:
    """Say whether a job would be baked, and why; nothing is written."""
    return _reported(job, settings, lambda here, cache: _checked(here, cache, job))


def run_job(job: BatchJob, settings: Settings, *, open_outputs: OpenOutputs = Outputs) -> Outcome:
    """Do a job; errors become part of the outcome."""
    for attempt in range(settings.retries + 1):
        try:
            return _reported(job, settings, lambda here, cache: _run(here, cache, job, open_outputs))
        except StoreError as error:
            if attempt == settings.retries:
                return Outcome(job, "failed", lines=error.lines)
            time.sleep(_FIRST_PAUSE * 2**attempt)
    raise AssertionError


def fetch_job(job: BatchJob, settings: Settings, *, open_outputs: OpenOutputs = Outputs) -> Outcome | None:
    """Take the outputs of a job from the cache; None if the job has to be baked or anything fails."""
    try:
        with staged(job) as here:
            return _fetched(here, Cache(settings.cache), job, parts_of(here.job, job), open_outputs)
    except WrinkleError:
        return None


def _reported(job: BatchJob, settings: Settings, action: Callable[[Staged, Cache], Outcome]) -> Outcome:
    """Do an action with a job, and turn errors into its outcome.

    Raises:
        StoreError: A store does not answer; it may answer later.
    """
    start, here = time.perf_counter(), None
    try:
        if settings.program != program():
            raise WrinkleError(
                f"this worker has wrinkle {program()}, but {settings.program} is asked for: install the same",
                where=f"{socket.gethostname()}:{os.getpid()}",
            )
        with staged(job) as here:
            outcome = action(here, Cache(settings.cache))
    except StoreError:
        raise
    except WrinkleError as error:
        lines = tuple(map(here.with_given_paths, error.lines)) if here else error.lines
        outcome = Outcome(job, "refused" if isinstance(error, RefusedError) else "failed", lines=lines)
    except Exception as error:
        if is_lack(error):
            outcome = Outcome(job, "failed", lines=(f"{job.asset}: takes more memory than there is",))
        else:
            outcome = Outcome(job, "bug", lines=tuple(traceback.format_exc().splitlines()))
    return replace(outcome, seconds=round(time.perf_counter() - start, 4))


def _checked(here: Staged, cache: Cache, job: BatchJob) -> Outcome:
    parts = parts_of(here.job, job)
    key = key_of(parts)
    record = cache.find(key, JobFiles(parts))
    if record is None:
        reason = difference(cache.parts_of_output(job.out), parts)
        return Outcome(job, "built", reason=reason, key=key, warnings=tuple(cache.warnings))
    in_place = not _missing_files(here, record)
    reason = "in place" if in_place else "from the cache"
    return Outcome(job, "hit", reason=reason, key=key, warnings=tuple(cache.warnings))


def _run(here: Staged, cache: Cache, job: BatchJob, open_outputs: OpenOutputs) -> Outcome:
    parts = parts_of(here.job, job)
    fetched = _fetched(here, cache, job, parts, open_outputs)
    if fetched is not None:
        return fetched
    from wrinklecli.batching.build import build  # imports numpy and all that a bake needs; a hit does without

    before = cache.parts_of_output(job.out)
    reason = difference(before, parts)
    own = _own_files(here, cache, before)
    built = build(here, open_outputs, own, Solutions(cache))
    key = key_of(parts)
    outcome = replace(built.outcome, job=job, reason=reason, key=key)
    send(here, [(root, path) for root, path, _ in built.files], own)
    with _whatever_the_cache_does(cache):
        # If an input was changed during the bake, nobody knows which version was baked.
        if built.files and key_of(parts_of(here.job, job)) == key:
            cache.keep(key, built.files, outcome)
            cache.note_output(job.out, parts)
    return replace(outcome, warnings=(*outcome.warnings, *cache.warnings))


@contextmanager
def _whatever_the_cache_does(cache: Cache) -> Iterator[None]:
    """Turn errors of keeping outputs into warnings, as the outputs are in their places already."""
    try:
        yield
    except WrinkleError as error:
        cache.warnings += error.lines
    except OSError as error:
        cache.warnings.append(f"an output cannot be kept in the cache: {error}")
    except MemoryError:
        cache.warnings.append("the outputs take more memory to keep in the cache than there is")


def _own_files(here: Staged, cache: Cache, before: Parts | None) -> set[tuple[str, str]]:
    """Root and path of the files that this job wrote earlier, from other inputs, and that nobody has changed since."""
    try:
        record = None if before is None else cache.find(key_of(before), JobFiles(before))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):  # the cache has something else there
        return set()
    if record is None:
        return set()
    changed = _missing_files(here, record)
    unchanged = [file for number, file in enumerate(record.files) if number not in changed]
    return {(file.root, file.path) for file in unchanged}


def _fetched(here: Staged, cache: Cache, job: BatchJob, parts: Parts, open_outputs: OpenOutputs) -> Outcome | None:
    """Put outputs from the cache into their places; None if the cache does not have all of them."""
    key = key_of(parts)
    record = cache.find(key, JobFiles(parts))
    if record is None:
        return None
    missing = [record.files[number] for number in _missing_files(here, record)]
    if missing:
        try:
            with open_outputs() as outputs:
                _add(missing, record.files[-1], here, cache, outputs)
        except _LostError:
            return None
        send(here, [(file.root, file.path) for file in missing], set())
        with _whatever_the_cache_does(cache):
            cache.note_output(job.out, parts)
    said = {**record.said, "warnings": (*record.said["warnings"], *cache.warnings)}
    return Outcome(job, "hit", reason="from the cache" if missing else "in place", key=key, **said)


def _add(files: Iterable[CachedFile], main: CachedFile, here: Staged, cache: Cache, outputs: Outputs) -> None:
    """Copy files from the cache to outputs.

    Raises:
        _LostError: The cache does not have the content of a file.
    """
    protect(here.job, outputs)
    for file in files:
        content = cache.content(file, here.job.max_memory)
        if content is None:
            raise _LostError
        path = os.path.join(here.roots[file.root][1], file.path)
        outputs.make_folders(os.path.dirname(path))
        outputs.add_bytes(path, content, last=file == main)


def _missing_files(here: Staged, record: Record) -> list[int]:
    """Numbers of a record's files that are not in their places with the recorded content."""
    missing = []
    for number, file in enumerate(record.files):
        root = here.roots.get(file.root)
        if root is not None:  # an earlier job for this output had others
            with suppress(OSError), stores.opened(stores.join(root[0], file.path), here.job.max_memory) as there:
                if hashlib.file_digest(there, "sha256").hexdigest() == file.digest:  # type: ignore[arg-type]
                    continue
        missing.append(number)
    return missing
