"""All jobs: one after another in this process, or by workers of Dask, on this machine or a cluster."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from wrinklecli.batch import stores
from wrinklecli.batch.cache import Cache
from wrinklecli.batch.cluster import Workers, by_dask, refuse_without_dask
from wrinklecli.batch.jobs import BatchJob, Outcome
from wrinklecli.batch.worker import OpenOutputs, Settings, hit, look, work
from wrinklecli.files.outputs import Outputs

# Jobs are looked up in the cache before workers are started, which takes about so many seconds; and only until so many
# have to be baked, as then there is work for them.
_LOOK_HERE, _TO_BAKE = 3.0, 8


def looks(jobs: Sequence[BatchJob], settings: Settings) -> Iterator[Outcome]:
    """What would be done, job by job; nothing is."""
    for job in jobs:
        yield look(job, settings)


def outcomes(
    jobs: Sequence[BatchJob],
    settings: Settings,
    workers: Workers,
    *,
    open_outputs: OpenOutputs = Outputs,
    tell: Callable[[str], object] = lambda _line: None,
) -> Iterator[Outcome]:
    """Do all jobs, and give what comes of each as it comes. To stop is to ask for no more.

    Args:
        jobs: The jobs.
        settings: How they are done.
        workers: Who does them.
        open_outputs: Opens what this process writes into.
        tell: Called with what people may want to know, a line.

    Raises:
        WrinkleError: The cache cannot be written; Dask is missing, or its scheduler does not answer any more.
    """
    if workers.scheduler is None and workers.count == 1:
        Cache(settings.cache).open()
        for job in jobs:
            yield work(job, settings, open_outputs=open_outputs)
        return
    refuse_without_dask(workers)
    if workers.scheduler is not None:
        jobs = [_absolute(job) for job in jobs]
        settings = replace(settings, cache=_seen_from_anywhere(settings.cache))
    Cache(settings.cache).open()
    rest: list[BatchJob] = []
    end = time.monotonic() + _LOOK_HERE
    for job in jobs:
        looked = len(rest) < _TO_BAKE and time.monotonic() < end
        found = hit(job, settings, open_outputs=open_outputs) if looked else None
        if found is None:
            rest.append(job)
        else:
            yield found
    if rest:
        yield from by_dask(rest, settings, workers, tell)


def _absolute(job: BatchJob) -> BatchJob:
    """A job whose paths are the same wherever they are read: workers of a cluster share disks, not folders."""
    options = dict(job.options)
    if "anim" in options:
        options["anim"] = tuple(map(_seen_from_anywhere, options["anim"]))
    if "frames_dir" in options:
        options["frames_dir"] = _seen_from_anywhere(options["frames_dir"])
    return replace(
        job,
        asset=_seen_from_anywhere(job.asset),
        tools=tuple(map(_seen_from_anywhere, job.tools)),
        out=_seen_from_anywhere(job.out),
        options=options,
        anims=tuple(map(_seen_from_anywhere, job.anims)),
        tracked=_seen_from_anywhere(job.tracked) if job.tracked else None,
        report=_seen_from_anywhere(job.report) if job.report else None,
        timings=_seen_from_anywhere(job.timings) if job.timings else None,
    )


def _seen_from_anywhere(path: str) -> str:
    return path if stores.is_url(path) else os.path.abspath(path)
