"""What is to be baked: a job, and what came of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Result: TypeAlias = Literal["hit", "built", "refused", "failed", "bug"]


@dataclass(frozen=True, slots=True)
class BatchJob:
    """One bake of a manifest, as plain values: it goes to other processes.

    Attributes:
        where: Its place in the manifest, for messages.
        asset: To read: a path or a URL, as all of these.
        tools: Tools files, merged where there are several.
        out: To write.
        options: Of the bake, by the manifest's keys, paths in them as seen from here.
        anims: Files that get the wrinkles of `out`, as `wrinkle track` does.
        tracked: The folder for these.
        report: To write, too.
        timings: To write, too.
    """

    where: str
    asset: str
    tools: tuple[str, ...]
    out: str
    options: Mapping[str, Any] = field(default_factory=dict)
    anims: tuple[str, ...] = ()
    tracked: str | None = None
    report: str | None = None
    timings: str | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a job.

    Attributes:
        job: The job.
        result: `hit`: the cache knew it; `built`: baked; `refused` and `failed`, as a bake's exit codes 3 and 1;
            `bug`: a fault of ours.
        reason: Why it was, or would be, baked; for a hit, whether its files were in their places already.
        seconds: It took.
        key: Over all that it depends on; empty where that could not be read.
        peak_memory: Bytes that its process held at most meanwhile, where the system says so.
        summary: What was made, in a line.
        warnings: A line each.
        residual: Largest distance of the file from the method, scene units, where it was proved.
        tallest: Height of the tallest wrinkle, scene units.
        lines: What went wrong.
        worker: Who did it; empty for this process.
    """

    job: BatchJob
    result: Result
    reason: str = ""
    seconds: float = 0.0
    key: str = ""
    peak_memory: int | None = None
    summary: str = ""
    warnings: tuple[str, ...] = ()
    residual: float | None = None
    tallest: float | None = None
    lines: tuple[str, ...] = ()
    worker: str = ""

    @property
    def done(self) -> bool:
        """Whether the job's files are there."""
        return self.result in ("hit", "built")
