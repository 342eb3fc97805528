"""Workers of Dask: the bytes of one process, whoever is killed meanwhile."""

import importlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from kit.command import files
from kit.limb import limb_asset, tool, write_tools
from kit.work import PATIENCE

pytestmark = [
    pytest.mark.slow,
    pytest.mark.long,
    pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs dask.distributed"),
    pytest.mark.skipif(not Path("/proc").exists(), reason="looks for workers in /proc"),
]
MAIN = [sys.executable, "-c", "from wrinklecli.cli import main; main()"]
COUNT = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Assets, and what one process makes of them."""
    made = tmp_path_factory.mktemp("batch")
    (made / "chars").mkdir()
    for number in range(COUNT):
        limb_asset(rings=7, sides=6, angle=60 + number).write(made / "chars" / f"c{number:02}.glb")
    write_tools(made / "tools.yaml", tool(bumps=2), refinement={"max_levels": 2}, sampling={"fps": 30})
    started = batch(made, "alone")
    assert started.wait() == 0
    return made


def batch(folder: Path, out: str, *arguments: str) -> subprocess.Popen[bytes]:
    (folder / out).mkdir(exist_ok=True)
    command = [
        "batch",
        "chars/*.glb",
        "--tools",
        "tools.yaml",
        "--out",
        f"{out}/{{stem}}.glb",
        "--cache",
        f"{out}.cache",
    ]
    report = ["--report", f"{out}.jsonl"]
    with (folder / f"{out}.err").open("w") as errors:
        return subprocess.Popen([*MAIN, *command, *report, *arguments], cwd=folder, stderr=errors)


def told(folder: Path, out: str) -> list[dict[str, Any]]:
    path = folder / f"{out}.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def children(process: int) -> list[int]:
    """The processes that bake for a driver: those of multiprocessing that it has spawned."""
    found = []
    for task in Path(f"/proc/{process}/task").iterdir():
        found += [int(each) for each in (task / "children").read_text().split()]
    return [each for each in found if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()]


def until(true: Callable[[], object], process: subprocess.Popen[Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not true() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.05)


def test_workers_and_drivers_that_are_killed_change_no_byte(folder: Path) -> None:
    started = batch(folder, "killed", "-j", "2", "--retry", "20")
    until(lambda: len(told(folder, "killed")) >= 2, started)
    for _ in range(8):  # those that follow, too, before they have begun
        for worker in children(started.pid):
            os.kill(worker, signal.SIGKILL)
        time.sleep(0.1)
    until(lambda: len(told(folder, "killed")) >= 5, started)
    started.kill()
    started.wait()
    done = {each["out"] for each in told(folder, "killed")}
    assert 5 <= len(done) < COUNT
    # What a worker had kept but not told of when it was killed is a hit the second time: at most one job of each.
    results = [each["result"] for each in told(folder, "killed")]
    assert results.count("built") + results.count("hit") == len(results)
    assert results.count("hit") <= 2
    again = batch(folder, "killed", "-j", "2")
    assert again.wait() == 0, (folder / "killed.err").read_text()
    every = told(folder, "killed")
    assert {each["out"] for each in every if each["result"] == "hit"} >= done
    assert {each["worker"] for each in every if each["result"] == "built"} != {""}
    made = files(folder / "killed")
    assert {name: data for name, data in made.items() if not name.startswith(".wrinkle-")} == files(folder / "alone")


def test_a_signal_ends_a_batch_in_a_line_and_its_workers(folder: Path) -> None:
    started = batch(folder, "ended", "-j", "2")
    until(lambda: told(folder, "ended"), started)
    workers = children(started.pid)
    started.terminate()
    assert started.wait(timeout=PATIENCE) == 128 + signal.SIGTERM
    assert (folder / "ended.err").read_text().splitlines()[-1] == "wrinkle: interrupted"
    assert workers
    end = time.monotonic() + PATIENCE
    while any(Path(f"/proc/{each}").exists() for each in workers) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(Path(f"/proc/{each}").exists() for each in workers)


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler and two worker processes on the loopback: its address, and its process."""
    from distributed import Client

    file = folder / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--memory-limit", "0"]
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    running = [subprocess.Popen([*scheduler, *common], **quiet)]  # type: ignore[call-overload]
    try:
        until(file.exists, running[0])
        for _ in range(2):
            running.append(subprocess.Popen([*worker, *common, "--no-nanny"], **quiet))  # type: ignore[call-overload]
        until(lambda: file.stat().st_size, running[0])
        address = json.loads(file.read_text())["address"]
        with Client(address) as client:  # or one worker does all before the other is there
            client.wait_for_workers(2, timeout=PATIENCE)
            client.run(importlib.import_module, "wrinklecli.batching.worker")  # to import takes as long as six jobs
        yield address, running[0]
    finally:
        for each in running:
            each.kill()
            each.wait()


def test_a_scheduler_with_two_workers_and_one_that_is_lost(folder: Path) -> None:
    with cluster(folder) as (address, scheduler):
        started = batch(folder, "far", "--scheduler", address)
        assert started.wait(timeout=PATIENCE) == 0
        assert files(folder / "far") == files(folder / "alone")
        assert len({each["worker"] for each in told(folder, "far")}) == 2

        started = batch(folder, "lost", "--scheduler", address)
        until(lambda: told(folder, "lost"), started)
        scheduler.kill()
        assert started.wait(timeout=PATIENCE) == 1
        *_, line = (folder / "lost.err").read_text().splitlines()
        assert line.startswith("the scheduler is lost, with ")
    unreachable = batch(folder, "lost", "--scheduler", address)
    assert unreachable.wait(timeout=PATIENCE) == 1
    assert (folder / "lost.err").read_text().startswith(f"{address}: no scheduler answers: ")
