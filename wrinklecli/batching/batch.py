"""Bake all jobs of a manifest: one after another in this process, or on workers of Dask."""

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any

from wrinklecli.batching.cache import TAG, Cache
from wrinklecli.batching.cache_keys import program
from wrinklecli.batching.cluster import Workers, refuse_without_dask, run_on_dask
from wrinklecli.batching.conflicts import BatchFiles
from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.manifest import read_manifest, read_pattern
from wrinklecli.batching.records import VERSION, junit, opened_report, record_of
from wrinklecli.batching.staging import roots_of
from wrinklecli.batching.stores import StoreError, absolute, folder_of, is_url, join
from wrinklecli.batching.worker import OpenOutputs, Settings, check_job, fetch_job, run_job
from wrinklecli.choices import CACHE
from wrinklecli.errors import ConfigError, WrinkleError, log
from wrinklecli.files.formats import MODEL_ENDINGS
from wrinklecli.files.outputs import Outputs
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json

# Before workers are started, jobs are looked up in the cache here, until one of these limits:
_LOOKUP_SECONDS = 3.0  # as long as it takes to start workers
_ENOUGH_TO_BAKE = 8  # jobs to bake, which are enough work for the workers to start with


def run_jobs(
    jobs: Sequence[BatchJob],
    settings: Settings,
    workers: Workers,
    *,
    open_outputs: OpenOutputs = Outputs,
    tell: Callable[[str], object] = lambda _line: None,
    warn: Callable[[str], object] = lambda _line: None,
) -> Iterator[Outcome]:
    """Run all jobs and yield each outcome as it arrives. A caller that asks for no more outcomes stops the batch.

    `open_outputs` opens the outputs that this process writes; `tell` and `warn` are called with
    notes and warnings for the user.

    Raises:
        WrinkleError: The cache's store, or Dask's scheduler, does not answer, or Dask is missing.
    """
    with _without_empty_folders(jobs, settings.cache):
        if workers.scheduler is None and workers.count == 1:
            _open_cache(settings, warn)
            for job in jobs:
                yield run_job(job, settings, open_outputs=open_outputs)
            return
        refuse_without_dask(workers)
        if workers.scheduler is not None:
            # Workers of a cluster share the disks of this machine, but not its current folder.
            paths = dict.fromkeys(("asset", "tools", "file", "folder", "other"), absolute)
            jobs = [job.with_paths(**paths) for job in jobs]
            settings = replace(settings, cache=absolute(settings.cache))
        _open_cache(settings, warn)
        to_bake: list[BatchJob] = []
        end = time.monotonic() + _LOOKUP_SECONDS
        for job in jobs:
            looks = len(to_bake) < _ENOUGH_TO_BAKE and time.monotonic() < end
            outcome = fetch_job(job, settings, open_outputs=open_outputs) if looks else None
            if outcome is None:
                to_bake.append(job)
            else:
                yield outcome
        if to_bake:
            yield from run_on_dask(to_bake, settings, workers, tell)


@contextmanager
def _without_empty_folders(jobs: Sequence[BatchJob], cache: str) -> Iterator[None]:
    """Remove, in the end, the folders of outputs, and that of the cache, that were made for jobs that failed.

    None goes earlier, as another job may be about to write there.
    """
    made: set[str] = set()
    for folder in [cache, *(folder for job in jobs for folder, _ in roots_of(job, job).values())]:
        while folder and not is_url(folder) and folder not in made and not os.path.lexists(folder):
            made.add(folder)
            folder = os.path.dirname(folder)
    try:
        yield
    finally:
        for folder in sorted(made, key=len, reverse=True):
            with suppress(OSError):  # it has files, or was never made
                if folder == cache and os.listdir(folder) == [TAG]:
                    os.unlink(os.path.join(folder, TAG))
                os.rmdir(folder)


def _open_cache(settings: Settings, warn: Callable[[str], object]) -> None:
    """Warn before the first bake if the cache cannot be written; then outputs are written, but not kept.

    Raises:
        StoreError: The cache's store does not answer.
    """
    try:
        Cache(settings.cache).open()
    except StoreError:
        raise
    except WrinkleError as error:
        for line in error.lines:
            warn(f"{line}; outputs are not kept")


@dataclass(frozen=True, slots=True)
class BatchOptions:
    """The settings of `batch`.

    Attributes:
        tools: The tools file of jobs that name none.
        out: The output of jobs that name none.
        profile: The profile of the manifest whose keys override the defaults.
        strict: Treat warnings as refusals, in jobs that do not say otherwise.
        jobs: Worker processes; with more than one, Dask starts them.
        scheduler: The address of a Dask scheduler, whose workers bake instead.
        dashboard: Serve Dask's dashboard.
        cache: Folder or URL where outputs are kept; `.wrinkle-cache` beside the manifest if None.
        keep_going: Go on after a job that failed.
        dry_run: Find out what would be baked, and bake nothing.
        retry: How often a job is begun again if its worker died or its store did not answer.
        report: A file that gets a line of JSON for each job as it ends.
        junit: A file that gets JUnit's XML in the end.
    """

    tools: str | os.PathLike[str] | None = None
    out: str | None = None
    strict: bool = False
    profile: str | None = None
    jobs: int = 1
    scheduler: str | None = None
    dashboard: bool = False
    cache: str | os.PathLike[str] | None = None
    keep_going: bool = True
    dry_run: bool = False
    retry: int = 3
    report: str | os.PathLike[str] | None = None
    junit: str | os.PathLike[str] | None = None


@dataclass(frozen=True, slots=True)
class Batch:
    """A batch that has ended: its outcomes, and the jobs that it did not begin.

    Attributes:
        manifest: The manifest, or the pattern of assets.
        outcomes: Those of the jobs, in the order in which they ended.
        not_begun: The jobs that were left when the batch stopped.
        seconds: Time that the batch took.
        warnings: Lines about the batch as a whole, such as a cache that cannot be written.
    """

    manifest: str
    outcomes: tuple[Outcome, ...]
    not_begun: tuple[BatchJob, ...]
    seconds: float
    warnings: tuple[str, ...] = ()

    @property
    def data(self) -> Json:
        """For `--json`: JSON values only."""
        return {
            "batch": VERSION,
            "manifest": self.manifest,
            "counts": Counter(each.result for each in self.outcomes),
            "not_begun": [each.out for each in self.not_begun],
            "seconds": round(self.seconds, 4),
            "jobs": list(map(record_of, self.outcomes)),
            "warnings": list(self.warnings),
        }


def batch(
    manifest: str | os.PathLike[str],
    options: BatchOptions | None = None,
    *,
    ended: Callable[[Outcome, int], object] = lambda _outcome, _total: None,
    open_outputs: OpenOutputs = Outputs,
    tell: Callable[[str], object] = lambda line: log("info", line),
    warn: Callable[[str], object] = lambda line: log("warning", line),
    **named: Any,
) -> Batch:
    """Bake all jobs of a manifest, or every asset of a pattern, of which nothing changed since the last time.

    A job that fails is an outcome and no exception.

    Args:
        manifest: A .yaml, .csv or .jsonl, or a pattern such as `chars/*.glb`, which needs `tools` and `out`.
        options: The defaults of `BatchOptions` if None.
        ended: Called with each outcome as it arrives, and the number of all jobs.
        open_outputs: Opens the outputs that this process writes.
        tell: Called with notes about workers, at once.
        warn: Called with each warning about the batch as a whole, at once.
        named: Single options by their names in `BatchOptions`, in place of those in `options`.

    Raises:
        ConfigError: The manifest cannot be read, or has problems (a line each); nothing was baked.
        WrinkleError: A store or Dask's scheduler does not answer, Dask is missing, or a report cannot be written.
        TypeError: `BatchOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import batch
        >>> made = batch("samples/*.glb", tools="configs/wrist.yaml", out="out/{stem}.glb")
        >>> [(each.job.out, each.result) for each in made.outcomes]
        [('out/wrist.glb', 'built')]
    """
    options = replace(options or BatchOptions(), **named)
    place, start = os.fspath(manifest), time.monotonic()
    report, xml, cache = (os.fspath(each) if each else None for each in (options.report, options.junit, options.cache))
    is_pattern = place.lower().endswith(MODEL_ENDINGS)
    cache = cache or (CACHE if is_pattern else join(folder_of(place), CACHE))
    asked = {"tools": options.tools and os.fspath(options.tools), "out": options.out, "strict": options.strict}
    given = {key: value for key, value in asked.items() if value}
    if is_pattern and options.profile is not None:
        raise ConfigError("is a pattern of assets, which has no profiles", where=place)
    read = read_pattern if is_pattern else partial(read_manifest, profile=options.profile)
    every = read(place, given, BatchFiles(report=report, cache=cache, junit=xml))
    if xml is not None:  # before the first bake
        with open_outputs() as outputs:
            outputs.make_folders(os.path.dirname(xml))
            outputs.claim(xml)
    settings = Settings(cache=cache, program=program(), retries=options.retry)
    warnings: list[str] = []

    def warned(line: str) -> None:
        warnings.append(line)
        warn(line)

    done: Iterator[Outcome]
    if options.dry_run:
        done = (check_job(job, settings) for job in every)
    else:
        workers = Workers(options.jobs, options.scheduler, options.dashboard)
        done = run_jobs(every, settings, workers, open_outputs=open_outputs, tell=tell, warn=warned)
    outcomes: list[Outcome] = []
    with opened_report(report) as write:
        for outcome in done:
            write(outcome)
            outcomes.append(outcome)
            ended(outcome, len(every))
            if not outcome.done and not options.keep_going:
                break
    known = {absolute(each.job.out) for each in outcomes}  # as workers of a cluster have it
    not_begun = tuple(job for job in every if absolute(job.out) not in known)
    seconds = time.monotonic() - start
    if xml is not None:
        with open_outputs() as outputs:
            outputs.add_bytes(xml, junit(place, outcomes, not_begun, seconds))
    return Batch(place, tuple(outcomes), not_begun, seconds, tuple(warnings))
