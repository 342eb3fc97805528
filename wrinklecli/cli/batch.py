"""`wrinkle batch`."""

import json
import sys
import time
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import click

from wrinklecli.choices import CACHE
from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit, emit_json, say, warn
from wrinklecli.cli.streams import job_outputs, leave_at_signals
from wrinklecli.errors import counted
from wrinklecli.files.formats import MODEL_ENDINGS

if TYPE_CHECKING:
    from wrinklecli.batching.jobs import Outcome

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
@click.option("--profile", metavar="NAME", help="Take this profile of MANIFEST, such as mobile, over its defaults.")
@opt.whole("-j", "--jobs", bounds=(1, 1024), text="Worker processes.", default=1)
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="Use the workers of this Dask scheduler instead.")
@opt.file("--cache", metavar="DIR_OR_URL", text=f"Where outputs are kept.  [default: {CACHE} beside MANIFEST]")
@click.option("--keep-going/--fail-fast", default=True, show_default=True, help="What to do after a job that failed.")
@opt.flag("--dry-run", text="Say what would be baked, and why; bake nothing.")
@opt.whole(
    "--retry", bounds=(0, 100), text="Begin a job again if its worker died or its store did not answer.", default=3
)
@opt.file("--report", metavar="FILE.jsonl", text="Write a line for each job as it ends; - is stdout.")
@opt.file("--junit", metavar="FILE.xml", text="Write JUnit's XML for CI systems: a test case for each job.")
@opt.flag("--dashboard", text="Serve Dask's dashboard, and say where.")
@opt.strict
@opt.json("Print what became of all jobs as JSON, in place of lines.")
@opt.quiet()
@opt.verbose("Print a line for each job.")
def batch(
    manifest: str,
    report: str | None,
    as_json: bool,
    quiet: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """Bake all jobs of MANIFEST (YAML, CSV or JSON lines), or every asset of a pattern such as 'chars/*.glb'.

    A job is an asset, tools, an output, and options of `wrinkle bake`, by the same names; configs/batch.md is the
    reference. Outputs have the same bytes as those of `wrinkle bake`. Each appears complete or not at all, and a job
    that fails stops no other.

    A job is baked only if its asset, a file that the asset refers to, its tools, its options or wrinkle itself has
    changed. Otherwise its outputs are in their places already, or come from the cache.

    --junit has a test case for each job: failed, with the job's line in MANIFEST, or skipped if nothing had changed.

    Exit codes: 0 done; 1 MANIFEST is at fault and nothing was baked, or a job failed; 2 wrong usage; 3 jobs were
    refused (--strict, and by limits in MANIFEST), none failed otherwise; 70 a bug.
    """
    _refuse_usage(manifest, options)
    if as_json and report == "-":
        raise click.UsageError("'--json' and '--report -' both want standard output.")

    from wrinklecli.batching.batch import batch as run
    from wrinklecli.batching.records import record_of

    quiet = quiet or as_json
    monitor = _Monitor(quiet=quiet, verbose=verbose, dry_run=options["dry_run"], as_json=as_json)

    def ended(outcome: "Outcome", total: int) -> None:
        if report == "-":
            click.echo(json.dumps(record_of(outcome), allow_nan=False))
        monitor.add(outcome, total)

    leave_at_signals()  # between jobs, and where workers do them, which end with it
    with monitor:
        made = run(
            manifest,
            ended=ended,
            open_outputs=job_outputs,
            tell=lambda line: say(f"note: {line}"),
            warn=lambda line: None if quiet else warn(line),
            report=None if report == "-" else report,
            **options,
        )
    if as_json:
        emit_json(made.data)
    monitor.summarize(len(made.not_begun))
    for result, code in _EXIT_CODES.items():
        if monitor.counts.get(result):
            sys.exit(code)


def _refuse_usage(manifest: str, options: dict[str, Any]) -> None:
    """Refuse options that do not go together."""
    pattern = manifest.lower().endswith(MODEL_ENDINGS)
    jobs, scheduler, dashboard = options["jobs"], options["scheduler"], options["dashboard"]
    if scheduler is not None and jobs > 1:
        raise click.UsageError("'--scheduler' has workers of its own: it goes without '-j'.")
    if dashboard and scheduler is None and jobs == 1:
        raise click.UsageError(
            "'--dashboard' shows Dask's workers: it goes with '-j' of two or more, or '--scheduler'."
        )
    if options["dry_run"] and options["junit"]:
        raise click.UsageError("'--dry-run' bakes nothing: it goes without '--junit'.")
    if pattern and not (options["tools"] and options["out"]):
        raise click.UsageError("A pattern of assets needs '--tools' and '--out'.")
    if not pattern and not manifest.lower().endswith((".yaml", ".yml", ".csv", ".jsonl")):
        message = f"{manifest!r} ends neither in .yaml, .csv or .jsonl nor, as a pattern of assets, in .glb or .gltf"
        raise click.BadParameter(message, param_hint="MANIFEST")


class _Monitor(Progress):
    """Prints failures as they come, a bar with the rate and the remaining time, and a table at the end."""

    def __init__(self, *, quiet: bool, verbose: bool, dry_run: bool, as_json: bool) -> None:
        super().__init__(quiet=quiet)
        self._quiet, self._verbose, self._dry_run, self._as_json = quiet, verbose, dry_run, as_json
        self._start = time.monotonic()
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._memory: defaultdict[str, int] = defaultdict(int)
        self._warnings = 0
        self.counts: defaultdict[str, int] = defaultdict(int)

    def add(self, outcome: "Outcome", total: int) -> None:
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
            if not self._as_json:
                emit(f"{outcome.job.out}: {_planned(outcome)}")
        elif outcome.done and self._verbose and not self._quiet:
            for warning in outcome.warnings:
                warn(f"{outcome.job.out}: {warning}")
            say(f"{outcome.job.out}: {result}, {outcome.reason}: {outcome.summary}")
        done = sum(self.counts.values())
        taken = max(time.monotonic() - self._start, 1e-3)
        remaining = taken / done * (total - done)
        self.show("batch", done, total, note=f"{done / taken:.3g} a second, {_time(remaining)} left")

    def summarize(self, missing: int) -> None:
        """Print the table and the last line; `missing` jobs were not begun."""
        if self._quiet:
            return
        total = missing + sum(self.counts.values())
        if not self._dry_run and len(self.counts) + total > 2:
            say(f"{'':10}{'jobs':>8}{'seconds':>10}{'a job':>9}{'memory':>10}")
            for result, count in self.counts.items():
                seconds, memory = self._seconds[result], self._memory[result]
                shown = f"{memory / 1e6:.0f} MB" if memory else ""
                say(f"{result:10}{count:>8}{seconds:>10.1f}{seconds / count:>9.2f}{shown:>10}")
        if self._warnings and not self._verbose:
            warn(f"{counted(self._warnings, 'warning')} in all; -v or --report show them")
        words = {"built": "to build", "hit": "known"} if self._dry_run else {}
        parts = [f"{count:,} {words.get(result, result)}" for result, count in self.counts.items()]
        parts += [f"{missing:,} not begun"] if missing else []
        say(f"{counted(total, 'job')}: {', '.join(parts)}, in {_time(time.monotonic() - self._start)}")


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
