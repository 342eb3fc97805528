"""Kills the workers of a batch every few seconds and its driver once: are all bytes right, and what is done twice?

    PYTHONPATH=tests:. python tests/benchmarks/batch_killed.py [COUNT [SECONDS]]

COUNT small assets (200) are baked one by one, by `wrinkle bake`, and by `wrinkle batch -j 2`, of which one worker is
killed (SIGKILL) each time that one has worked for SECONDS of a processor (3), its start included, and after half of the
jobs the driver, too; it is started again. It fails where a byte differs, or where a job that had been told of was built
again.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

from kit.limb import limb_asset, tool, write_tools
from wrinklecli import bake

_PATIENCE = 180.0  # seconds: after so many it hangs
_TICKS = os.sysconf("SC_CLK_TCK")  # a second of a processor
_WRINKLE = [sys.executable, "-c", "from wrinklecli.cli import main; main()"]


def workers(driver: int) -> list[int]:
    """The processes that bake for a driver."""
    found = []
    for children in Path(f"/proc/{driver}/task").glob("*/children"):
        with suppress(OSError):  # it, or its thread, has ended
            each_line = {each: Path(f"/proc/{each}/cmdline").read_bytes() for each in children.read_text().split()}
            found += [int(each) for each, line in each_line.items() if b"spawn_main" in line]
    return found


def worked(process: int) -> float:
    """Seconds of a processor that a process has had: on a loaded machine workers take longer to start than to bake."""
    with suppress(OSError):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS
    return 0.0


def told(report: Path) -> list[dict[str, Any]]:
    """What a report says so far."""
    return [json.loads(line) for line in report.read_text().splitlines()] if report.exists() else []


def run(folder: Path, report: Path, seconds: float, until: int) -> tuple[int, int | None]:
    """Run the batch with workers that are killed, until so many jobs are done: how many were, and its exit code."""
    arguments = ["batch", "chars/*.glb", "--tools", "tools.yaml", "--out", "many/{stem}.glb", "-j", "2", "-q"]
    command = [*_WRINKLE, *arguments, "--retry", "100", "--report", str(report)]
    driver = subprocess.Popen(command, cwd=folder)
    killed, done, moved = 0, 0, time.monotonic()
    while driver.poll() is None and len(told(report)) < until:
        time.sleep(0.05)
        now = time.monotonic()
        if len(told(report)) > done:
            done, moved = len(told(report)), now
        if now > moved + _PATIENCE:
            print(f"nothing ended for {_PATIENCE:.0f} s; workers: {workers(driver.pid)}, driver: {driver.pid}")
            break
        most, worker = max(((worked(each), each) for each in workers(driver.pid)), default=(0.0, 0))
        if most > seconds and done:
            os.kill(worker, signal.SIGKILL)
            killed += 1
    if driver.poll() is None:
        driver.kill()
    driver.wait()
    return killed, driver.returncode


def main(count: int = 200, seconds: float = 3.0) -> int:
    """Compare; the exit code."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for each in ("chars", "alone", "many"):
            (folder / each).mkdir()
        tools = write_tools(folder / "tools.yaml", tool(bumps=2))
        for number in range(count):
            asset = limb_asset(rings=7, sides=6, angle=30 + 0.1 * number).write(folder / "chars" / f"{number}.glb")
            bake(asset, tools, folder / "alone" / asset.name)
        reports = folder / "first.jsonl", folder / "second.jsonl"
        killed, code = run(folder, reports[0], seconds, until=count // 2)
        first = told(reports[0])
        print(f"driver ended with {code} after {len(first)} of {count} jobs and {killed} workers killed")
        killed, code = run(folder, reports[1], seconds, until=count + 1)
        second = told(reports[1])
        print(f"started again, it ended with {code} after {killed} more were killed")
        for each in (first, second):
            print(f"  {len(each)} jobs told of: {dict(Counter(one['result'] for one in each))}")
        again = {one["out"] for one in first} & {one["out"] for one in second if one["result"] == "built"}
        made = {path.name: path.read_bytes() for path in (folder / "many").glob("*.glb")}
        wanted = {path.name: path.read_bytes() for path in (folder / "alone").iterdir()}
        print(f"  {len(again)} built though told of before; bytes {'equal' if made == wanted else 'DIFFER'}")
        return int(code != 0 or bool(again) or made != wanted)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2]), *map(float, sys.argv[2:3])))
