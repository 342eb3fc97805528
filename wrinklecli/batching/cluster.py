"""Run jobs on workers of Dask, on this machine or a cluster.

Source: distributed.readthedocs.io. Differs: one task holds several jobs, because a task costs all processes together as
much as a tenth of a small bake. A worker does as many jobs of a task as it can begin within half a second and gives the
rest back. The scheduler never holds a hundred thousand tasks, and a lost scheduler is noticed at once.
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
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from typing import Any, TypeAlias

from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.worker import Settings, run_job
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.frozen import dataclass

_MAX_TASKS = 1_000  # tasks at the scheduler at a time: more than a cluster has workers, and little memory
_MAX_TASK_JOBS = 16  # jobs of one task
_TASK_SECONDS = 0.5  # seconds after which a worker begins no other job of its task
_TASKS_PER_THREAD = 4  # tasks that the remaining jobs are divided into, so that all threads end at about the same time
_CONNECT = 10.0  # seconds for a scheduler to answer
_CLOSE_CLIENT = 2.0  # seconds for the connection to a scheduler to close
_CLOSE_CLUSTER = 5.0  # seconds for this process's own workers to end
_PULSE = 0.5  # seconds between checks of the scheduler
_RECOUNT = 5.0  # seconds between counts of the workers' threads, as workers come and go
_MAX_DEAD = 100  # workers that may die one after another while no task ends
_GC_THRESHOLD = 100_000  # objects before a garbage collection, as for the command line
# Dask's processes measure themselves for its dashboard, which takes a tenth of a worker's time.
_UNWATCHED = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
_FOR_WORKERS = {
    # None: workers need not return memory at once, which takes a twentieth of their time; each bake has its own limit.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    # A worker that died starts again at once, but may need more than 15 s on a busy machine.
    "distributed.deploy.lost-worker-timeout": "5 minutes",
}

Task: TypeAlias = tuple[BatchJob, ...]


@dataclass(frozen=True, slots=True)
class Workers:
    """The processes that bake: a number of them on this machine, of which 1 is this process alone.

    If `scheduler` is the address of a Dask scheduler, its workers bake instead.
    """

    count: int
    scheduler: str | None
    dashboard: bool


def refuse_without_dask(workers: Workers) -> None:
    """Check that Dask is installed, and also bokeh if the dashboard needs it.

    Raises:
        WrinkleError: A library is missing.
    """
    if importlib.util.find_spec("distributed") is None:
        raise WrinkleError("more workers than one need dask.distributed: pip install 'wrinklecli[batch]'")
    if workers.scheduler is None and workers.dashboard and importlib.util.find_spec("bokeh") is None:
        raise WrinkleError("Dask's dashboard needs bokeh: pip install bokeh")


def run_on_dask(
    jobs: Sequence[BatchJob], settings: Settings, workers: Workers, tell: Callable[[str], object]
) -> Iterator[Outcome]:
    """Run jobs on workers of Dask; see `run.run_jobs`."""
    with _client(settings, workers) as (client, replace_dead):
        if workers.dashboard:
            tell(f"dashboard: {client.dashboard_link}")
        # Only other people's workers are worth a message: this process replaces its own at once.
        tell_of_workers = tell if workers.scheduler is not None else lambda _line: None
        yield from _DaskRun(client, settings, replace_dead, tell_of_workers).outcomes(jobs)


def run_task(task: Task, settings: Settings) -> list[Outcome]:
    """Run the first job of a task in a worker of Dask, and the next ones as long as there is time."""
    from distributed import get_worker

    gc.set_threshold(_GC_THRESHOLD)
    end = time.monotonic() + _TASK_SECONDS
    done: list[Outcome] = []
    for job in task:
        if done and time.monotonic() > end:
            break
        done.append(replace(run_job(job, settings), worker=get_worker().address))
    return done


@contextmanager
def _client(settings: Settings, workers: Workers) -> Iterator[tuple[Any, Callable[[], int]]]:
    """Connect to a scheduler, or to a new one that lives as long as the block; also give what replaces dead workers.

    Workers of an existing scheduler are replaced by whoever started them.
    """
    import distributed

    untyped: Any = distributed

    for name in ("distributed", "tornado", "asyncio", "bokeh"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    warnings.filterwarnings("ignore", module="distributed")  # such as of a taken port: another one is reported
    with ExitStack() as opened:
        cluster = _start_cluster(settings, workers) if workers.scheduler is None else None
        if cluster is not None:
            opened.callback(_close, cluster, _CLOSE_CLUSTER)
        try:
            client = untyped.Client(cluster or workers.scheduler, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError, RuntimeError, TypeError, ImportError) as error:  # tls:// without its settings
            where = workers.scheduler or "Dask"
            raise WrinkleError(f"no scheduler answers: {str(error).splitlines()[0]}", where=where) from error
        opened.callback(_close, client, _CLOSE_CLIENT)
        yield client, lambda: 0 if cluster is None else _replace_dead(cluster, workers.count)


def _close(opened: Any, patience: float) -> None:
    with suppress(Exception):
        opened.close(timeout=patience)


def _start_cluster(settings: Settings, workers: Workers) -> Any:
    """Start a scheduler in this process and workers in other processes."""
    import dask
    from distributed import LocalCluster

    address = "127.0.0.1:8787" if workers.dashboard else "127.0.0.1:0"  # for this machine alone
    watched = {} if workers.dashboard else _UNWATCHED
    dask.config.set(_FOR_WORKERS | watched | {"distributed.scheduler.allowed-failures": settings.retries})
    start: Any = LocalCluster
    for attempt in range(settings.retries + 1):
        try:
            # Dask sets no memory limit, as each bake has its own; Dask gives BLAS one thread.
            return start(
                n_workers=workers.count,
                threads_per_worker=1,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
                scheduler_kwargs={"dashboard": workers.dashboard, "dashboard_address": address},
            )
        except (OSError, ValueError, RuntimeError) as error:  # a worker was killed before it began
            if attempt == settings.retries:
                raise WrinkleError(f"workers do not start: {str(error).splitlines()[0]}", where="Dask") from error
    raise AssertionError


def _replace_dead(cluster: Any, count: int) -> int:
    """Start new workers for those that died before they began, which Dask does not replace; return their number."""
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


class _DaskRun:
    """The jobs at a scheduler, and the jobs that wait.

    Methods that look at the scheduler raise WrinkleError if it is lost, or if workers die as they start.
    """

    def __init__(
        self, client: Any, settings: Settings, replace_dead: Callable[[], int], tell: Callable[[str], object]
    ) -> None:
        self._client = client
        self._replace_dead = replace_dead
        self._tell = tell
        self._died = 0  # workers that died since a task ended
        self._settings = settings
        self._finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._waiting: deque[BatchJob] = deque()
        self._remaining = 0  # jobs that wait or are in tasks
        self._tasks: dict[str, tuple[Task, Any]] = {}
        self._threads, self._counted = -1, -math.inf

    def outcomes(self, jobs: Sequence[BatchJob]) -> Iterator[Outcome]:
        self._waiting.extend(jobs)
        self._remaining = len(jobs)
        self._send_waiting()
        while self._tasks:
            future = self._next_finished()
            try:
                done = self._done(future)
            except (OSError, CancelledError) as error:
                # The task is done, but the scheduler was lost before it could pass the outcomes on.
                raise self._lost() from error
            self._died = 0
            self._remaining -= len(done)
            self._send_waiting()
            yield from done

    def _send_waiting(self) -> None:
        """Send waiting jobs, as many as the scheduler may hold."""
        self._check_scheduler()
        while self._waiting and len(self._tasks) < _MAX_TASKS:
            self._count_threads()
            size = min(_MAX_TASK_JOBS, math.ceil(self._remaining / (_TASKS_PER_THREAD * max(self._threads, 1))))
            self._send(tuple(self._waiting.popleft() for _ in range(min(size, len(self._waiting)))))

    def _send(self, task: Task) -> None:
        future = self._client.submit(run_task, task, self._settings, pure=False)
        self._tasks[future.key] = task, future
        future.add_done_callback(self._finished.put)

    def _count_threads(self) -> None:
        """Count the threads of the scheduler's workers now and then, and tell the user if all have gone."""
        if time.monotonic() < self._counted + _RECOUNT:
            return
        with suppress(OSError):  # the scheduler is lost: the next check notices that
            before, self._threads = self._threads, sum(self._client.nthreads().values())
            if before and not self._threads:
                jobs = counted(self._remaining, "job")
                self._tell(f"the scheduler has no workers: it waits for some, with {jobs} left")
        self._counted = time.monotonic()

    def _next_finished(self) -> Any:
        while True:
            with suppress(queue.Empty):
                future = self._finished.get(timeout=_PULSE)
                if future.status in ("finished", "error"):
                    return future
                if future.status != "cancelled":  # its worker has died since, and another one does the task again
                    future.add_done_callback(self._finished.put)
            self._check_workers()

    def _result(self, future: Any) -> list[Outcome] | BaseException:
        """Ask for the outcomes of a task, or for the error that ended it.

        A worker keeps outcomes until it is asked; if it has died meanwhile, another one does the task again.
        """
        from distributed import KilledWorker

        while future.status != "error":
            try:
                done: list[Outcome] = future.result(timeout=_PULSE)
            except TimeoutError:
                self._check_workers()
            except KilledWorker as error:
                killed: BaseException = error
                return killed
            else:
                return done
        failed: BaseException = future.exception()
        return failed

    def _check_workers(self) -> None:
        self._check_scheduler()
        self._died += self._replace_dead()
        if self._died > _MAX_DEAD:
            raise WrinkleError(f"{self._died} workers died as they started: too little memory?", where="Dask")
        self._count_threads()

    def _check_scheduler(self) -> None:
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
        """The outcomes of a task; jobs that its worker gave back wait again."""
        task, _ = self._tasks[future.key]
        done = self._result(future)
        if isinstance(done, BaseException) and len(task) == 1:
            done = [Outcome(task[0], "failed", lines=(_failure(task[0], done),))]
        elif isinstance(done, BaseException):  # one job is at fault: send each alone; finished ones are in the cache
            done = []
            for job in task:
                self._send((job,))
        else:
            self._waiting.extendleft(reversed(task[len(done) :]))
        del self._tasks[future.key]
        return done


def _failure(job: BatchJob, error: BaseException) -> str:
    """Say why no worker could do a job."""
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        died = error.allowed_failures + 1
        return f"{job.asset}: every worker died that had it ({died} did): too little memory?"
    return f"{job.asset}: the worker cannot do it: {type(error).__name__}: {error}"
