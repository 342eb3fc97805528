"""One job: its key, its outputs from the cache where that knows them, else a bake, as `wrinkle bake` makes it.

The same in this process and in a worker of a cluster, which reads and writes files itself; what it gets and gives back
is small.
"""

import os
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from wrinklecli.batch.cache import Cache, Record
from wrinklecli.batch.cache_keys import Parts, difference, key_of, parts_of, program
from wrinklecli.batch.jobs import BatchJob, Outcome
from wrinklecli.batch.staging import Staged, send, staged
from wrinklecli.batch.stores import StoreError
from wrinklecli.errors import RefusedError, WrinkleError
from wrinklecli.files.outputs import Outputs

OpenOutputs: TypeAlias = Callable[[], AbstractContextManager[Outputs]]
"""Opens what a bake writes into."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How jobs are done.

    Attributes:
        cache: Its path or URL.
        program: The version of the program that asks, which the one that does must have.
        retries: How often a job is begun again whose store did not answer.
    """

    cache: str
    program: str
    retries: int = 0


def look(job: BatchJob, settings: Settings) -> Outcome:
    """Say whether a job would be baked, and why; nothing is written."""
    return _reported(job, settings, lambda here, cache: _looked(here, cache, job))


def work(job: BatchJob, settings: Settings, *, open_outputs: OpenOutputs = Outputs) -> Outcome:
    """Do a job. What goes wrong is in the outcome.

    Args:
        job: The job.
        settings: How.
        open_outputs: Opens what the bake writes into.
    """
    for attempt in range(settings.retries + 1):
        try:
            return _reported(job, settings, lambda here, cache: _worked(here, cache, job, open_outputs))
        except StoreError as error:
            if attempt == settings.retries:
                return Outcome(job, "failed", lines=error.lines)
            time.sleep(0.5 * 2**attempt)  # stores that are asked too much want to be left alone for a while
    raise AssertionError


def hit(job: BatchJob, settings: Settings, *, open_outputs: OpenOutputs = Outputs) -> Outcome | None:
    """Take a job's outputs from the cache; none where it has to be baked, or something is wrong."""
    try:
        with staged(job) as here:
            parts = parts_of(here.job, job)
            return _hit(here, Cache(settings.cache), job, parts, open_outputs)
    except WrinkleError:
        return None


def _reported(job: BatchJob, settings: Settings, do: Callable[[Staged, Cache], Outcome]) -> Outcome:
    """Do something with a job; what goes wrong becomes a part of the outcome.

    Raises:
        StoreError: A store does not answer; it may another time.
    """
    start = time.perf_counter()
    try:
        if settings.program != program():
            raise WrinkleError(
                f"this worker has wrinkle {program()}, but {settings.program} is asked for: install the same",
                where=_who(),
            )
        with staged(job) as here:
            try:
                outcome = do(here, Cache(settings.cache))
            except StoreError:
                raise
            except WrinkleError as error:
                lines = tuple(map(here.as_asked, error.lines))
                outcome = Outcome(job, "refused" if isinstance(error, RefusedError) else "failed", lines=lines)
    except StoreError:
        raise
    except WrinkleError as error:
        outcome = Outcome(job, "failed", lines=error.lines)
    except MemoryError:
        outcome = Outcome(job, "failed", lines=(f"{job.asset}: takes more memory than there is",))
    except Exception:
        outcome = Outcome(job, "bug", lines=tuple(traceback.format_exc().splitlines()))
    return replace(outcome, seconds=round(time.perf_counter() - start, 4))


def _who() -> str:
    import socket

    return f"{socket.gethostname()}:{os.getpid()}"


def _looked(here: Staged, cache: Cache, job: BatchJob) -> Outcome:
    parts = parts_of(here.job, job)
    key = key_of(parts)
    record = cache.find(key)
    if record is None:
        return Outcome(job, "built", reason=difference(cache.made_from(job.out), parts), key=key)
    there = not _missing(here, record)
    return Outcome(job, "hit", reason="in place" if there else "from the cache", key=key)


def _worked(here: Staged, cache: Cache, job: BatchJob, open_outputs: OpenOutputs) -> Outcome:
    parts = parts_of(here.job, job)
    found = _hit(here, cache, job, parts, open_outputs)
    if found is not None:
        return found
    from wrinklecli.batch.build import build  # with numpy and all that a bake needs

    before = cache.made_from(job.out)
    reason = difference(before, parts)
    own = _own(here, cache, before)
    built = build(here, open_outputs, own)
    key = key_of(parts)
    said = replace(built.outcome, job=job, reason=reason, key=key)
    send(here, [(root, path) for root, path, _ in built.files], own)
    # An input that was changed meanwhile is in the bake or not: nobody knows.
    if built.files and key_of(parts_of(here.job, job)) == key:
        cache.keep(key, built.files, _said(said))
        cache.note(job.out, parts)
    return said


def _own(here: Staged, cache: Cache, before: Parts | None) -> set[tuple[str, str]]:
    """Root and path of the files that are in their places as the job wrote them when it was made from other parts."""
    record = None if before is None else cache.find(key_of(before))
    if record is None:
        return set()
    changed = _missing(here, record)
    there = [file for number, file in enumerate(record.files) if number not in changed]
    return {(file.root, file.path) for file in there if file.root in here.roots}


def _said(outcome: Outcome) -> dict[str, Any]:
    kept = ("summary", "warnings", "residual", "tallest", "seconds", "peak_memory")
    return {name: getattr(outcome, name) for name in kept}


def _hit(here: Staged, cache: Cache, job: BatchJob, parts: Parts, open_outputs: OpenOutputs) -> Outcome | None:
    """Outputs from the cache, put into their places where they are not there; none where it has not all of them."""
    key = key_of(parts)
    record = cache.find(key)
    if record is None:
        return None
    missing = _missing(here, record)
    contents = [cache.content(record.files[number]) for number in missing]
    if any(content is None for content in contents):
        return None
    if missing:
        with open_outputs() as outputs:
            outputs.protect([here.job.asset, *here.job.tools, *here.job.anims, *here.job.options.get("anim", ())])
            for number, content in zip(missing, contents, strict=True):
                file = record.files[number]
                path = os.path.join(here.roots[file.root][1], file.path)
                outputs.make_folders(os.path.dirname(path))
                last = number == len(record.files) - 1
                outputs.add_bytes(path, content or b"", last=last)
        send(here, [(record.files[number].root, record.files[number].path) for number in missing], set())
        cache.note(job.out, parts)
    said = record.said
    return Outcome(
        job,
        "hit",
        reason="from the cache" if missing else "in place",
        key=key,
        summary=str(said.get("summary", "")),
        warnings=tuple(map(str, said.get("warnings", ()))),
        residual=said.get("residual"),
        tallest=said.get("tallest"),
    )


def _missing(here: Staged, record: Record) -> list[int]:
    """Numbers of a record's files that are not in their places with their content."""
    import hashlib

    from wrinklecli.batch import stores

    missing = []
    for number, file in enumerate(record.files):
        root = here.roots.get(file.root)
        if root is None:
            continue
        with suppress(OSError), stores.opened(stores.join(root[0], file.path)) as there:
            if hashlib.file_digest(there, "sha256").hexdigest() == file.digest:  # type: ignore[arg-type]
                continue
        missing.append(number)
    return missing
