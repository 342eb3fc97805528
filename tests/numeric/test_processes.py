"""Work in processes and threads gives what it gives here, in the same order."""

import os
import subprocess
import sys
import time
from itertools import islice
from signal import SIGKILL
from threading import get_ident

import numpy as np
import pytest

from wrinklecli.numeric import processes
from wrinklecli.numeric.processes import core_count, in_processes, in_threads


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_results_come_in_the_order_of_the_items(jobs: int) -> None:
    assert list(in_processes(lambda number: number**2, [3, 1, 2], jobs)) == [9, 1, 4]
    assert list(in_processes(lambda number: number, [], jobs)) == []


def test_threads_give_results_in_order_and_numpy_is_as_strict_there() -> None:
    assert in_threads(lambda number: number**2, [3, 1, 2]) == [9, 1, 4]
    assert in_threads(str, []) == []
    with np.errstate(over="raise"), pytest.raises(FloatingPointError):
        in_threads(lambda number: np.float64(number) * 1e308, [0.0, 10.0])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_threads_of_processes_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    def own_thread(_: int) -> int:
        time.sleep(0.1)
        return get_ident()

    def count(_: int) -> int:
        return len(set(in_threads(own_thread, range(2))))

    monkeypatch.setattr(processes, "core_count", lambda: 2)
    assert count(0) == 2
    assert list(in_processes(count, [0, 1], 2)) == [1, 1]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_several_items_are_worked_out_elsewhere_and_one_is_here() -> None:
    assert os.getpid() not in in_processes(lambda _: os.getpid(), [0, 1], 2)
    assert list(in_processes(lambda _: os.getpid(), [0], 2)) == [os.getpid()]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_large_items_are_begun_first() -> None:
    def begun(_: float) -> float:
        now = time.monotonic()
        time.sleep(0.3)
        return now

    small, large, _ = in_processes(begun, [1.0, 3.0, 2.0], 2, size=float)
    assert large < small


@pytest.mark.parametrize("jobs", [1, 2])
def test_shared_objects_are_not_copied(jobs: int) -> None:
    shared, other = {"large": 1}, {"small": 2}
    for first, second in in_processes(lambda _: (shared, dict(other)), [0, 1], jobs, shared=[shared]):
        assert first is shared
        assert second == other


class NotSolvedError(Exception):
    """An error that knows more than its words."""

    def __init__(self, degrees: float) -> None:
        super().__init__(degrees)
        self.degrees = degrees


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_comes_when_it_is_its_turn(jobs: int) -> None:
    def work(number: int) -> int:
        if number == 1:
            raise NotSolvedError(80.0)
        return number

    found = in_processes(work, [0, 1, 2], jobs)
    assert list(islice(found, 1)) == [0]
    with pytest.raises(NotSolvedError) as raised:
        next(found)
    assert raised.value.degrees == 80.0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_result_is_given_while_others_are_worked_out() -> None:
    found = in_processes(time.sleep, [0.0, 60.0], 2)
    start = time.monotonic()
    assert next(found) is None
    found.close()
    assert time.monotonic() - start < 30.0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_large_results_are_whole() -> None:
    assert [*in_processes(bytes, [3_000_001, 1, 2_500_000], 2)] == [bytes(3_000_001), bytes(1), bytes(2_500_000)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_process_that_ends_before_its_work_is_an_error() -> None:
    found = in_processes(lambda signal: signal and os.kill(os.getpid(), signal), [0, SIGKILL], 2)
    assert next(found) == 0
    with pytest.raises(ChildProcessError, match="before its work"):
        next(found)


def test_there_is_a_core() -> None:
    assert core_count() >= 1


# In an interpreter of its own: a large one has memory that it has freed, which a worker takes first.
SHARED = """
import os
from wrinklecli.numeric.memory import _ITSELF, held
from wrinklecli.numeric.processes import in_processes

def fill(size):
    return len(bytearray(size)), os.getpid() == here

here = os.getpid()
with held(200 * 10**6 - _ITSELF):
    print(*in_processes(fill, [10**7, 15 * 10**7], 2))
"""


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs Linux")
def test_processes_share_the_memory_and_what_needs_more_than_a_share_is_worked_out_here() -> None:
    """Two workers share 200 MB; one item needs 10 MB, another one 150 MB."""
    done = subprocess.run([sys.executable, "-c", SHARED], capture_output=True, text=True, check=True)
    assert done.stdout == "(10000000, False) (150000000, True)\n"
