"""Run all jobs of a batch: one after another in this process, or on workers of Dask."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace

from wrinklecli.batching.cache import Cache
from wrinklecli.batching.cluster import Workers, refuse_without_dask, run_on_dask
from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.staging import roots_of
from wrinklecli.batching.stores import StoreError, absolute, is_url
from wrinklecli.batching.worker import OpenOutputs, Settings, fetch_job, run_job
from wrinklecli.errors import WrinkleError
from wrinklecli.files.outputs import Outputs

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
    with _without_empty_folders(jobs):
        yield from _outcomes(jobs, settings, workers, open_outputs, tell, warn)


def _outcomes(
    jobs: Sequence[BatchJob],
    settings: Settings,
    workers: Workers,
    open_outputs: OpenOutputs,
    tell: Callable[[str], object],
    warn: Callable[[str], object],
) -> Iterator[Outcome]:
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
def _without_empty_folders(jobs: Sequence[BatchJob]) -> Iterator[None]:
    """In the end, remove the folders of outputs that were made for jobs that failed.

    None goes earlier, as another job may be about to write there.
    """
    made: set[str] = set()
    for job in jobs:
        for folder, _ in roots_of(job, job).values():
            while folder and not is_url(folder) and folder not in made and not os.path.lexists(folder):
                made.add(folder)
                folder = os.path.dirname(folder)
    try:
        yield
    finally:
        for folder in sorted(made, key=len, reverse=True):
            with suppress(OSError):  # it has files, or was never made
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
