"""All jobs: one after another in this process, or by workers of Dask, on this machine or a cluster.

Source: distributed.readthedocs.io. Differs from its own way: jobs are sent a window at a time, so that a scheduler
never holds a hundred thousand, and one that is lost is found out at once.
"""

import gc
import importlib.util
import logging
import os
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

from wrinklecli.batch import stores
from wrinklecli.batch.jobs import BatchJob, Outcome
from wrinklecli.batch.worker import OpenOutputs, Settings, hit, look, work
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.files.outputs import Outputs

# Jobs that a scheduler knows at a time: more than a cluster has workers, little memory.
_WINDOW = 1_000
# Seconds that jobs are looked up in the cache before workers are started, which takes about so long.
_LOOK_HERE = 3.0
_CONNECT = 10.0  # seconds for a scheduler to answer
_PULSE = 0.5  # seconds between looks whether it is still there
_BEFORE_COLLECTION = 100_000  # of objects, as for the command line


@dataclass(frozen=True, slots=True)
class Workers:
    """Who bakes.

    Attributes:
        count: Worker processes on this machine; one is this process.
        scheduler: Address of a Dask scheduler in their place.
        dashboard: Serve Dask's dashboard.
    """

    count: int = 1
    scheduler: str | None = None
    dashboard: bool = False


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
        WrinkleError: Dask is missing, or its scheduler does not answer any more.
    """
    if workers.scheduler is None and workers.count == 1:
        for job in jobs:
            yield work(job, settings, open_outputs=open_outputs)
        return
    refuse_without_dask()
    if workers.scheduler is not None:
        jobs = [_absolute(job) for job in jobs]
        settings = replace(settings, cache=_seen_from_anywhere(settings.cache))
    rest: list[BatchJob] = []
    end = time.monotonic() + _LOOK_HERE
    for job in jobs:
        found = hit(job, settings, open_outputs=open_outputs) if time.monotonic() < end else None
        if found is None:
            rest.append(job)
        else:
            yield found
    if rest:
        yield from _by_dask(rest, settings, workers, tell)


def refuse_without_dask() -> None:
    """Check that Dask is there.

    Raises:
        WrinkleError: It is not.
    """
    if importlib.util.find_spec("distributed") is None:
        raise WrinkleError("more workers than one need dask.distributed: pip install 'wrinklecli[batch]'")


def on_worker(job: BatchJob, settings: Settings) -> Outcome:
    """Do a job in a worker of Dask."""
    from distributed import get_worker

    gc.set_threshold(_BEFORE_COLLECTION)
    return replace(work(job, settings), worker=get_worker().address)


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


@contextmanager
def _client(settings: Settings, workers: Workers) -> Iterator[Any]:
    """A client of a scheduler that is there, or of one made for the time of the block."""
    import dask
    import distributed

    untyped: Any = distributed

    for name in ("distributed", "tornado", "asyncio", "bokeh"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    cluster: Any = None
    try:
        if workers.scheduler is None:
            # Memory is held by each bake itself; BLAS has one thread by Dask's own choice.
            dask.config.set({"distributed.scheduler.allowed-failures": settings.retries})
            cluster = untyped.LocalCluster(
                n_workers=workers.count,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address=":8787" if workers.dashboard else None,
                silence_logs=logging.CRITICAL,
            )
        client = untyped.Client(cluster or workers.scheduler, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, RuntimeError) as error:
        if cluster is not None:
            cluster.close()
        where = workers.scheduler or "Dask"
        raise WrinkleError(f"no scheduler answers: {str(error).splitlines()[0]}", where=where) from error
    try:
        yield client
    finally:
        with suppress(Exception):
            client.close(timeout=2)
        if cluster is not None:
            with suppress(Exception):
                cluster.close(timeout=5)


def _by_dask(
    jobs: Sequence[BatchJob], settings: Settings, workers: Workers, tell: Callable[[str], object]
) -> Iterator[Outcome]:
    """Have jobs done by workers of Dask."""
    if workers.dashboard and importlib.util.find_spec("bokeh") is None:
        raise WrinkleError("Dask's dashboard needs bokeh: pip install bokeh")
    with _client(settings, workers) as client:
        if workers.dashboard:
            tell(f"dashboard: {client.dashboard_link}")
        if not client.nthreads():
            tell("the scheduler has no workers yet")
        yield from _Sent(client, settings).outcomes(jobs)


class _Sent:
    """Jobs that are with a scheduler."""

    def __init__(self, client: Any, settings: Settings) -> None:
        self._client = client
        self._settings = settings
        self._finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._jobs: dict[str, BatchJob] = {}
        self._futures: dict[str, Any] = {}

    def outcomes(self, jobs: Sequence[BatchJob]) -> Iterator[Outcome]:
        waiting = iter(jobs)
        for job, _ in zip(waiting, range(_WINDOW), strict=False):
            self._send(job)
        while self._jobs:
            future = self._next()
            try:
                outcome = self._outcome(self._jobs[future.key], future)
            except (OSError, CancelledError) as error:
                # Done, and the scheduler was gone before it could pass on what came of it.
                raise self._lost() from error
            self._jobs.pop(future.key)
            self._futures.pop(future.key)
            following = next(waiting, None)
            if following is not None:
                self._send(following)
            yield outcome

    def _send(self, job: BatchJob) -> None:
        future = self._client.submit(on_worker, job, self._settings, pure=False)
        self._jobs[future.key] = job
        self._futures[future.key] = future
        future.add_done_callback(self._finished.put)

    def _next(self) -> Any:
        """The next job that is done.

        Raises:
            WrinkleError: The scheduler is lost.
        """
        while True:
            with suppress(queue.Empty):
                future = self._finished.get(timeout=_PULSE)
                if future.status in ("finished", "error"):
                    return future
            if self._client.status != "running" or any(each.status == "cancelled" for each in self._futures.values()):
                raise self._lost()

    def _lost(self) -> WrinkleError:
        return WrinkleError(
            f"the scheduler is lost, with {counted(len(self._jobs), 'job')} in flight; what is done is kept:"
            " run the same command again"
        )

    def _outcome(self, job: BatchJob, future: Any) -> Outcome:
        """What came of a job."""
        from distributed import KilledWorker

        if future.status == "finished":
            outcome = future.result()
            return outcome if isinstance(outcome, Outcome) else Outcome(job, "bug", lines=(repr(outcome),))
        error = future.exception()
        if isinstance(error, KilledWorker):
            line = f"{job.asset}: every worker died that had it ({self._settings.retries + 1} did): too little memory?"
        else:
            line = f"{job.asset}: the worker cannot do it: {type(error).__name__}: {error}"
        return Outcome(job, "failed", lines=(line,))
