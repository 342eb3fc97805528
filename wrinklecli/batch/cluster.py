"""Jobs by workers of Dask, on this machine or a cluster.

Source: distributed.readthedocs.io. Differs from its own way: a task is several jobs, of which its worker does as many
as take half a second, since each task costs all processes together as much as a small bake's tenth; the rest comes
back. A scheduler never holds a hundred thousand, and one that is lost is found out at once.
"""

import gc
import importlib.util
import logging
import math
import queue
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from wrinklecli.batch.jobs import BatchJob, Outcome
from wrinklecli.batch.worker import Settings, work
from wrinklecli.errors import WrinkleError, counted

# Tasks that a scheduler knows at a time: more than a cluster has workers, little memory.
_WINDOW = 1_000
# Jobs of a task at the most, and seconds after which its worker begins no other one.
_MOST, _ROUND = 16, 0.5
# Tasks for each thread that the jobs which are left are divided into, so that all threads end at about the same time.
_TASKS = 4
_CONNECT = 10.0  # seconds for a scheduler to answer
_PULSE = 0.5  # seconds between looks whether it is still there
_RECOUNT = 5.0  # seconds between looks how many threads its workers have, which come and go
_MOST_DEAD = 100  # workers that die one after another, while none ends a task
_BEFORE_COLLECTION = 100_000  # of objects, as for the command line
# What Dask's processes do beside their work: they look at themselves, for its dashboard, which takes a tenth of a
# worker's time; and give memory back at once, which takes a twentieth. A bake bounds its memory itself.
_UNWATCHED = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
_OF_WORKERS = {
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    # One that died is begun again at once, and may take longer than 15 s on a busy machine.
    "distributed.deploy.lost-worker-timeout": "5 minutes",
}

Task: TypeAlias = tuple[BatchJob, ...]


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


def refuse_without_dask(workers: Workers) -> None:
    """Check that Dask is there, and what its dashboard needs.

    Raises:
        WrinkleError: It is not.
    """
    if importlib.util.find_spec("distributed") is None:
        raise WrinkleError("more workers than one need dask.distributed: pip install 'wrinklecli[batch]'")
    own = workers.scheduler is None
    if own and workers.dashboard and importlib.util.find_spec("bokeh") is None:
        raise WrinkleError("Dask's dashboard needs bokeh: pip install bokeh")


def by_dask(
    jobs: Sequence[BatchJob], settings: Settings, workers: Workers, tell: Callable[[str], object]
) -> Iterator[Outcome]:
    """Have jobs done by workers of Dask; see `scheduler.outcomes`."""
    with _client(settings, workers) as (client, replace_dead):
        if workers.dashboard:
            tell(f"dashboard: {client.dashboard_link}")
        # Of workers that this process has started itself, others follow at once.
        of_workers = tell if workers.scheduler is not None else lambda _line: None
        yield from _Sent(client, settings, replace_dead, of_workers).outcomes(jobs)


def on_worker(task: Task, settings: Settings) -> list[Outcome]:
    """Do jobs in a worker of Dask: the first, and those after it that begin soon enough; what comes of each."""
    from distributed import get_worker

    gc.set_threshold(_BEFORE_COLLECTION)
    end = time.monotonic() + _ROUND
    done: list[Outcome] = []
    for job in task:
        if done and time.monotonic() > end:
            break
        done.append(replace(work(job, settings), worker=get_worker().address))
    return done


@contextmanager
def _client(settings: Settings, workers: Workers) -> Iterator[tuple[Any, Callable[[], int]]]:
    """A client of a scheduler that is there, or of one made for the time of the block; and what replaces dead workers.

    Elsewhere those who started workers do that.
    """
    import distributed

    untyped: Any = distributed

    for name in ("distributed", "tornado", "asyncio", "bokeh"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    warnings.filterwarnings("ignore", module="distributed")  # such as of a port that is taken: another one is told
    cluster = _started(settings, workers) if workers.scheduler is None else None
    try:
        try:
            client = untyped.Client(cluster or workers.scheduler, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError, RuntimeError, TypeError, ImportError) as error:  # tls:// without its settings
            where = workers.scheduler or "Dask"
            raise WrinkleError(f"no scheduler answers: {str(error).splitlines()[0]}", where=where) from error
        try:
            yield client, lambda: 0 if cluster is None else _replace_dead(cluster, workers.count)
        finally:
            with suppress(Exception):
                client.close(timeout=2)
    finally:
        if cluster is not None:
            with suppress(Exception):
                cluster.close(timeout=5)


def _started(settings: Settings, workers: Workers) -> Any:
    """A scheduler in this process, with workers in others.

    Raises:
        WrinkleError: They do not start.
    """
    import dask
    from distributed import LocalCluster

    address = "127.0.0.1:8787" if workers.dashboard else "127.0.0.1:0"  # for this machine alone
    watched = {} if workers.dashboard else _UNWATCHED
    dask.config.set(_OF_WORKERS | watched | {"distributed.scheduler.allowed-failures": settings.retries})
    start: Any = LocalCluster
    for attempt in range(settings.retries + 1):
        try:
            # Memory is held by each bake itself; BLAS has one thread by Dask's own choice.
            return start(
                n_workers=workers.count,
                threads_per_worker=1,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
                scheduler_kwargs={"dashboard": workers.dashboard, "dashboard_address": address},
            )
        except (OSError, ValueError, RuntimeError) as error:  # one was killed before it began
            if attempt == settings.retries:
                raise WrinkleError(f"workers do not start: {str(error).splitlines()[0]}", where="Dask") from error
    raise AssertionError


def _replace_dead(cluster: Any, count: int) -> int:
    """Start others for workers that died before they had begun, for which Dask starts no other; how many did."""
    from distributed.core import Status

    async def forget() -> int:
        dead = [name for name, each in cluster.workers.items() if each.status in (Status.closed, Status.failed)]
        for name in dead:
            del cluster.workers[name]
        return len(dead)

    died: int = cluster.sync(forget)
    if died:
        cluster.scale(count)
    return died


class _Sent:
    """Jobs that are with a scheduler, and those that wait."""

    def __init__(
        self, client: Any, settings: Settings, replace_dead: Callable[[], int], tell: Callable[[str], object]
    ) -> None:
        self._client = client
        self._replace_dead = replace_dead
        self._tell = tell
        self._died = 0  # of workers, one after another
        self._settings = settings
        self._finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._waiting: deque[BatchJob] = deque()
        self._left = 0  # jobs that wait or are in tasks, of which workers give back what they have no time for
        self._tasks: dict[str, tuple[Task, Any]] = {}
        self._threads, self._counted = -1, -math.inf

    def outcomes(self, jobs: Sequence[BatchJob]) -> Iterator[Outcome]:
        self._waiting.extend(jobs)
        self._left = len(jobs)
        self._send_some()
        while self._tasks:
            future = self._next()
            try:
                done = self._done(future)
            except (OSError, CancelledError) as error:
                # Done, and the scheduler was gone before it could pass on what came of it.
                raise self._lost() from error
            self._died = 0
            self._left -= len(done)
            self._send_some()
            yield from done

    def _send_some(self) -> None:
        """Send what waits, as far as the window allows; raises as `_next`."""
        self._check()
        while self._waiting and len(self._tasks) < _WINDOW:
            self._count_threads()
            size = min(_MOST, math.ceil(self._left / (_TASKS * max(self._threads, 1))))
            self._send(tuple(self._waiting.popleft() for _ in range(min(size, len(self._waiting)))))

    def _send(self, task: Task) -> None:
        future = self._client.submit(on_worker, task, self._settings, pure=False)
        self._tasks[future.key] = task, future
        future.add_done_callback(self._finished.put)

    def _count_threads(self) -> None:
        """Count the threads of the scheduler's workers, which come and go, and tell where all have gone."""
        if time.monotonic() < self._counted + _RECOUNT:
            return
        with suppress(OSError):  # the scheduler is lost: the next look finds that out
            before, self._threads = self._threads, sum(self._client.nthreads().values())
            if before and not self._threads:
                self._tell(f"the scheduler has no workers: it waits for some, with {counted(self._left, 'job')} left")
        self._counted = time.monotonic()

    def _next(self) -> Any:
        """The next task that is done.

        Raises:
            WrinkleError: The scheduler is lost, or workers die as they start.
        """
        while True:
            with suppress(queue.Empty):
                future = self._finished.get(timeout=_PULSE)
                if future.status in ("finished", "error"):
                    return future
                if future.status != "cancelled":  # its worker has died since, and another one does the task again
                    future.add_done_callback(self._finished.put)
            self._look_after_workers()

    def _result(self, future: Any) -> list[Outcome] | BaseException:
        """What came of a task, or why nothing did.

        A worker keeps it until it is asked for: if it has died meanwhile, another one does the task again.
        """
        from distributed import KilledWorker

        while future.status != "error":
            try:
                done: list[Outcome] = future.result(timeout=_PULSE)
            except TimeoutError:
                self._look_after_workers()
            except KilledWorker as error:
                return error
            else:
                return done
        failed: BaseException = future.exception()
        return failed

    def _look_after_workers(self) -> None:
        """See that there are workers; raises as `_next`."""
        self._check()
        self._died += self._replace_dead()
        if self._died > _MOST_DEAD:
            raise WrinkleError(f"{self._died} workers died as they started: too little memory?", where="Dask")
        self._count_threads()

    def _check(self) -> None:
        """Raise if the scheduler is lost."""
        lost = any(future.status == "cancelled" for _, future in self._tasks.values())
        if lost or self._client.status != "running":
            raise self._lost()

    def _lost(self) -> WrinkleError:
        count = sum(len(task) for task, _ in self._tasks.values())
        return WrinkleError(
            f"the scheduler is lost, with {counted(count, 'job')} in flight; what is done is kept:"
            " run the same command again"
        )

    def _done(self, future: Any) -> list[Outcome]:
        """What came of the jobs of a task that were done; the others wait or are sent again."""
        task, _ = self._tasks[future.key]
        done = self._result(future)
        if isinstance(done, BaseException) and len(task) == 1:
            done = [Outcome(task[0], "failed", lines=(_why_not(task[0], done),))]
        elif isinstance(done, BaseException):  # a job is at fault: each goes alone, and what was done is in the cache
            done = []
            for job in task:
                self._send((job,))
        else:
            self._waiting.extendleft(reversed(task[len(done) :]))
        del self._tasks[future.key]
        return done


def _why_not(job: BatchJob, error: BaseException) -> str:
    """Why no worker has done a job, in a line."""
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        died = error.allowed_failures + 1
        return f"{job.asset}: every worker died that had it ({died} did): too little memory?"
    return f"{job.asset}: the worker cannot do it: {type(error).__name__}: {error}"
