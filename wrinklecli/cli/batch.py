"""`wrinkle batch`."""

import json
import os
import stat
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit, say, warn
from wrinklecli.cli.streams import job_outputs, leave_at_signals
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.files.formats import MODEL_ENDINGS

if TYPE_CHECKING:
    from wrinklecli.batch.jobs import Outcome

CACHE = ".wrinkle-cache"
_VERSION = 1
# The exit code of the command for the worst outcome of a job, the worst first.
_EXIT_CODES = {"bug": 70, "failed": 1, "refused": 3}


@click.command(
    short_help="Bake many assets, here or on a Dask cluster.",
    epilog="Example: wrinkle batch 'chars/*.glb' --tools tools.yaml --out 'out/{stem}.glb' -j 2",
)
@click.argument("manifest", type=opt.FILE)
@opt.file("--tools", metavar="TOOLS", text="The tools file of jobs that name none.")
@opt.file(
    "--out", metavar="PATH", text="The output of jobs that name none; {stem} is an asset's name, {folder} its folder."
)
@opt.whole("-j", "--jobs", bounds=(1, 1024), text="Worker processes.", default=1)
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="Use the workers of this Dask scheduler instead.")
@opt.file("--cache", metavar="DIR_OR_URL", text=f"Where outputs are kept.  [default: {CACHE} beside MANIFEST]")
@click.option("--keep-going/--fail-fast", default=True, show_default=True, help="What to do after a job that failed.")
@opt.flag("--dry-run", text="Say what would be baked, and why; bake nothing.")
@opt.whole(
    "--retry", bounds=(0, 100), text="Begin a job again if its worker died or its store did not answer.", default=3
)
@opt.file("--report", metavar="FILE.jsonl", text="Write a line for each job as it ends; - is stdout.")
@opt.flag("--dashboard", text="Serve Dask's dashboard, and say where.")
@opt.strict
@opt.quiet()
@opt.verbose("Print a line for each job.")
def batch(
    manifest: str,
    jobs: int,
    scheduler: str | None,
    cache: str | None,
    keep_going: bool,
    dry_run: bool,
    retry: int,
    report: str | None,
    dashboard: bool,
    quiet: bool,
    verbose: bool,
    **given: Any,
) -> None:
    """Bake all jobs of MANIFEST (YAML, CSV or JSON lines), or every asset of a pattern such as 'chars/*.glb'.

    A job is an asset, tools, an output, and options of `wrinkle bake`, by the same names; configs/batch.md is the
    reference. Outputs have the same bytes as those of `wrinkle bake`. Each appears complete or not at all, and a job
    that fails stops no other.

    A job is baked only if its asset, a file that the asset refers to, its tools, its options or wrinkle itself has
    changed. Otherwise its outputs are in their places already, or come from the cache.

    --report writes an object for each job; within version 1, keys are only added: "batch" (the version), "job",
    "asset", "tools", "out", "result" (hit, built, refused, failed, bug), "reason", "seconds", "key",
    "peak_memory_bytes", "warnings", "residual", "tallest_wrinkle", "errors" and "worker".

    Exit codes: 0 done; 1 MANIFEST is at fault and nothing was baked, or a job failed; 2 wrong usage; 3 jobs were
    refused (--strict, and by limits in MANIFEST), none failed otherwise; 70 a bug.
    """
    pattern = manifest.lower().endswith(MODEL_ENDINGS)
    _refuse_usage(manifest, pattern=pattern, jobs=jobs, scheduler=scheduler, dashboard=dashboard, given=given)

    from wrinklecli.batch.cache_keys import program
    from wrinklecli.batch.cluster import Workers
    from wrinklecli.batch.manifest import read_manifest, read_pattern
    from wrinklecli.batch.run import run_jobs
    from wrinklecli.batch.stores import folder_of, join
    from wrinklecli.batch.worker import Settings, check_job

    asked = {key: value for key, value in given.items() if value}
    place = cache or (CACHE if pattern else join(folder_of(manifest), CACHE))
    read = read_pattern if pattern else read_manifest
    every = read(manifest, asked, report=None if report == "-" else report, cache=place)
    settings = Settings(cache=place, program=program(), retries=retry)
    done: Iterator[Outcome]
    if dry_run:
        done = (check_job(job, settings) for job in every)
    else:
        workers = Workers(jobs, scheduler, dashboard)
        done = run_jobs(
            every,
            settings,
            workers,
            open_outputs=job_outputs,
            tell=lambda line: say(f"note: {line}"),
            warn=lambda line: None if quiet else warn(line),
        )
    leave_at_signals()  # between jobs, and where workers do them, which end with it
    monitor = _Monitor(len(every), quiet=quiet, verbose=verbose, dry_run=dry_run)
    with _report(report) as write, monitor:
        for outcome in done:
            write(json.dumps(_line(outcome), allow_nan=False))
            monitor.add(outcome)
            if not outcome.done and not keep_going:
                break
    monitor.summarize()
    for result, code in _EXIT_CODES.items():
        if monitor.counts.get(result):
            sys.exit(code)


def _refuse_usage(
    manifest: str, *, pattern: bool, jobs: int, scheduler: str | None, dashboard: bool, given: dict[str, Any]
) -> None:
    if scheduler is not None and jobs > 1:
        raise click.UsageError("'--scheduler' has workers of its own: it goes without '-j'.")
    if dashboard and scheduler is None and jobs == 1:
        raise click.UsageError(
            "'--dashboard' shows Dask's workers: it goes with '-j' of two or more, or '--scheduler'."
        )
    if pattern and not (given["tools"] and given["out"]):
        raise click.UsageError("A pattern of assets needs '--tools' and '--out'.")
    if not pattern and not manifest.lower().endswith((".yaml", ".yml", ".csv", ".jsonl")):
        message = f"{manifest!r} ends neither in .yaml, .csv or .jsonl nor, as a pattern of assets, in .glb or .gltf"
        raise click.BadParameter(message, param_hint="MANIFEST")


@contextmanager
def _report(path: str | None) -> Iterator[Callable[[str], object]]:
    """Open the report and give a function that writes one line at once, so that an ended batch leaves its lines.

    The lines of an earlier batch stay until the first line is written, as this batch may not begin.

    Raises:
        WrinkleError: The report cannot be written.
    """
    if path is None or path == "-":
        yield click.echo if path else lambda _line: None
        return

    begun = False

    def write(line: str) -> None:
        nonlocal begun
        with _writing(path):
            if not begun and stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                stream.truncate(0)
            begun = True
            stream.write(line + "\n")
            stream.flush()

    with _writing(path):
        os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
        stream = open(path, "a", encoding="utf-8")  # noqa: SIM115
    try:
        yield write
    finally:
        with suppress(OSError):
            stream.close()


@contextmanager
def _writing(path: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise WrinkleError(f"cannot be written: {reason or error}", where=path) from error


def _line(outcome: "Outcome") -> dict[str, Any]:
    """One line of the report, as JSON values."""
    job = outcome.job
    return {
        "batch": _VERSION,
        "job": job.where,
        "asset": job.asset,
        "tools": list(job.tools),
        "out": job.out,
        "result": outcome.result,
        "reason": outcome.reason,
        "seconds": outcome.seconds,
        "key": outcome.key,
        "peak_memory_bytes": outcome.peak_memory,
        "warnings": list(outcome.warnings),
        "residual": outcome.residual,
        "tallest_wrinkle": outcome.tallest,
        "errors": list(outcome.lines),
        "worker": outcome.worker,
    }


class _Monitor(Progress):
    """Prints failures as they come, a bar with the rate and the remaining time, and a table at the end."""

    def __init__(self, total: int, *, quiet: bool, verbose: bool, dry_run: bool) -> None:
        super().__init__(quiet=quiet)
        self._total, self._quiet, self._verbose, self._dry_run = total, quiet, verbose, dry_run
        self._start = time.monotonic()
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._memory: defaultdict[str, int] = defaultdict(int)
        self._warnings = 0
        self.counts: defaultdict[str, int] = defaultdict(int)

    def add(self, outcome: "Outcome") -> None:
        """Print the outcome of a job."""
        result = outcome.result
        self.counts[result] += 1
        self._seconds[result] += outcome.seconds
        self._memory[result] = max(self._memory[result], outcome.peak_memory or 0)
        self._warnings += len(outcome.warnings)
        if not outcome.done or self._verbose or self._dry_run:
            self.clear()
        for line in outcome.lines:
            say(f"{outcome.job.where}: {line}" if outcome.job.where else line)
        if outcome.done and self._dry_run:
            emit(f"{outcome.job.out}: {_planned(outcome)}")
        elif outcome.done and self._verbose and not self._quiet:
            for warning in outcome.warnings:
                warn(f"{outcome.job.out}: {warning}")
            say(f"{outcome.job.out}: {result}, {outcome.reason}: {outcome.summary}")
        done = sum(self.counts.values())
        taken = max(time.monotonic() - self._start, 1e-3)
        remaining = taken / done * (self._total - done)
        self.show("batch", done, self._total, note=f"{done / taken:.3g} a second, {_time(remaining)} left")

    def summarize(self) -> None:
        """Print the table and the last line."""
        if self._quiet:
            return
        if not self._dry_run and len(self.counts) + self._total > 2:
            say(f"{'':10}{'jobs':>8}{'seconds':>10}{'a job':>9}{'memory':>10}")
            for result, count in self.counts.items():
                seconds, memory = self._seconds[result], self._memory[result]
                shown = f"{memory / 1e6:.0f} MB" if memory else ""
                say(f"{result:10}{count:>8}{seconds:>10.1f}{seconds / count:>9.2f}{shown:>10}")
        if self._warnings and not self._verbose:
            warn(f"{counted(self._warnings, 'warning')} in all; -v or --report show them")
        missing = self._total - sum(self.counts.values())
        words = {"built": "to build", "hit": "known"} if self._dry_run else {}
        parts = [f"{count:,} {words.get(result, result)}" for result, count in self.counts.items()]
        parts += [f"{missing:,} not begun"] if missing else []
        say(f"{counted(self._total, 'job')}: {', '.join(parts)}, in {_time(time.monotonic() - self._start)}")


def _planned(outcome: "Outcome") -> str:
    """The line of a job in a dry run."""
    if outcome.result == "built":
        return f"would be built: {outcome.reason}"
    return "is in place" if outcome.reason == "in place" else "would be taken from the cache"


def _time(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{seconds:.1f} s"
    return f"{whole // 60} min {whole % 60} s" if whole < 3600 else f"{whole // 3600} h {whole % 3600 // 60} min"
