"""The records of a batch: a line of JSON for each job as it ends, and JUnit's XML of all jobs for CI systems."""

import json
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from xml.etree.ElementTree import Element, SubElement, tostring

from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.shape import Json

VERSION = 1


def record_of(outcome: Outcome) -> Json:
    """The outcome of a job as JSON values: a line of `--report`, and one of "jobs" of `--json`."""
    job = outcome.job
    return {
        "batch": VERSION,
        "job": job.where,
        "asset": job.asset,
        "tools": list(job.tools),
        "out": job.out,
        **{name: getattr(outcome, name) for name in ("result", "reason", "seconds", "key")},
        "peak_memory_bytes": outcome.peak_memory,
        "warnings": list(outcome.warnings),
        "residual": outcome.residual,
        "tallest_wrinkle": outcome.tallest,
        "errors": list(outcome.lines),
        "worker": outcome.worker,
    }


@contextmanager
def opened_report(path: str | None) -> Iterator[Callable[[Outcome], object]]:
    """Open a report and give a function that writes one line at once, so that an ended batch leaves its lines.

    The lines of an earlier batch stay until the first line is written, as this batch may not begin.

    Raises:
        WrinkleError: The report cannot be written.
    """
    if path is None:
        yield lambda _outcome: None
        return

    begun = False

    def write(outcome: Outcome) -> None:
        nonlocal begun
        with _writing(path):
            if not begun and stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                stream.truncate(0)
            begun = True
            stream.write(json.dumps(record_of(outcome), allow_nan=False) + "\n")
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


def junit(name: str, outcomes: Sequence[Outcome], not_begun: Sequence[BatchJob], seconds: float) -> bytes:
    """JUnit's XML: a test case for each job, skipped if its outputs were known or if it was not begun.

    Source: junit-10.xsd of Jenkins' xunit-plugin, to which GitLab, Azure and others keep, too.
    """
    bugs = sum(each.result == "bug" for each in outcomes)
    counts = {
        "tests": len(outcomes) + len(not_begun),
        "failures": sum(not each.done for each in outcomes) - bugs,
        "errors": bugs,
    }
    skipped = len(not_begun) + sum(each.result == "hit" for each in outcomes)
    shared = {"name": "wrinkle batch", "time": f"{seconds:.3f}", **{key: str(count) for key, count in counts.items()}}
    root = Element("testsuites", shared)
    suite = SubElement(root, "testsuite", {**shared, "name": _text(name), "skipped": str(skipped)})
    for outcome in outcomes:
        case = _case(suite, name, outcome.job, outcome.seconds)
        if outcome.result == "hit":
            SubElement(case, "skipped", {"message": outcome.reason})
        elif not outcome.done:
            lines = [f"{outcome.job.where}: {line}" if outcome.job.where else line for line in outcome.lines]
            kind = "error" if outcome.result == "bug" else "failure"
            # The last line of a traceback says what went wrong.
            message = lines[-1 if kind == "error" else 0] if lines else outcome.result
            SubElement(case, kind, {"message": _text(message), "type": outcome.result}).text = _text("\n".join(lines))
        if outcome.warnings:
            SubElement(case, "system-err").text = _text("\n".join(f"warning: {line}" for line in outcome.warnings))
    for job in not_begun:
        SubElement(_case(suite, name, job, 0.0), "skipped", {"message": "not begun"})
    data: bytes = tostring(root, encoding="utf-8", xml_declaration=True)
    return data


def _case(suite: Element, name: str, job: BatchJob, seconds: float) -> Element:
    return SubElement(suite, "testcase", {"classname": _text(name), "name": _text(job.out), "time": f"{seconds:.3f}"})


def _text(text: str) -> str:
    """Text without the characters that XML cannot hold."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)
