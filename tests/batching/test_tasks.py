"""Tasks of several jobs: each job comes back once, whatever its worker leaves undone or dies of."""

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from wrinklecli.batching import cluster
from wrinklecli.batching.cluster import Task
from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.worker import Settings
from wrinklecli.errors import WrinkleError

distributed = pytest.importorskip("distributed")

SETTINGS = Settings("cache", "program")
JOBS = [BatchJob(str(number), f"{number}.glb", (), f"out/{number}.glb") for number in range(50)]
POISON = JOBS[21]


class Future:
    """What came of a task, as Dask's future of it."""

    def __init__(self, key: str, function: Callable[[], Any]) -> None:
        self.key, self.status, self._made = key, "finished", None
        self._lost = key == "3"  # at first, as its worker has died with it
        try:
            self._made = function()
        except distributed.KilledWorker as error:
            self.status, self._made = "error", error

    def result(self, timeout: float) -> Any:
        if self._lost:
            self._lost = False
            raise TimeoutError(timeout)
        if self.key == "7":  # its worker has died with it, and others with the task
            raise distributed.KilledWorker(self.key, None, 3)
        return self._made

    def exception(self) -> Any:
        return self._made

    def add_done_callback(self, done: Callable[["Future"], object]) -> None:
        if self.key == "5":  # done, and lost before anybody looks; then done again
            self.status = "finished" if self.status == "lost" else "lost"
        done(self)


class Client:
    """A client whose workers do a task when it is sent."""

    status = "running"

    def __init__(self) -> None:
        self.tasks: list[Task] = []
        self.looks = 0

    def nthreads(self) -> dict[str, int]:
        self.looks += 1
        return {} if self.looks < 4 else {"tcp://a": 1}

    def submit(self, function: Callable[..., Any], task: Task, settings: Settings, *, pure: bool) -> Future:
        assert not pure
        self.tasks.append(task)
        return Future(str(len(self.tasks)), lambda: function(task, settings))


def test_every_job_comes_back_once_and_one_that_kills_fails_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    now = itertools.count()

    def work(job: BatchJob, _: Settings) -> Outcome:
        if job is POISON:
            raise distributed.KilledWorker("key", None, 3)
        return Outcome(job, "built")

    monkeypatch.setattr(cluster, "run_job", work)
    monkeypatch.setattr(cluster.time, "monotonic", lambda: next(now) * cluster._TASK_SECONDS / 3)
    monkeypatch.setattr(distributed, "get_worker", lambda: Client)
    monkeypatch.setattr(Client, "address", "tcp://a", raising=False)
    client = Client()
    looks: list[int] = []
    told: list[str] = []
    sent = cluster._DaskRun(client, SETTINGS, lambda: looks.append(1) or 1, told.append)
    outcomes = list(sent.outcomes(JOBS))
    assert looks == [1, 1]
    assert told == ["the scheduler has no workers: it waits for some, with 50 jobs left"]
    assert sorted(each.job.where for each in outcomes) == sorted(each.where for each in JOBS)
    assert [each.job for each in outcomes if not each.done] == [POISON]
    assert "every worker died that had it (4 did)" in next(each.lines[0] for each in outcomes if not each.done)
    # Of a task of many, some are done in time; none is a task of more than its share of what is left.
    assert {len(task) for task in client.tasks[:3]} == {len(JOBS) // 4 + 1}
    assert len(JOBS) / 4 < len(client.tasks) < len(JOBS)
    # The killer goes with others, and then alone.
    *before, last = (len(task) for task in client.tasks if POISON in task)
    assert min(before) > 1
    assert last == 1


def test_workers_that_die_one_after_another_end_a_batch() -> None:
    sent = cluster._DaskRun(Client(), SETTINGS, lambda: 40, [].append)
    sent._check_workers()
    sent._check_workers()
    with pytest.raises(WrinkleError, match="120 workers died"):
        sent._check_workers()
