"""The bake of one job by the same function as `wrinkle bake`, and the tracks of its clips: what was made, and where."""

import os
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import Any

from wrinklecli.baking.job import BakeOptions
from wrinklecli.baking.pipeline import bake
from wrinklecli.baking.report import Report, as_json
from wrinklecli.baking.timings import peak_memory
from wrinklecli.baking.track import track
from wrinklecli.batch.cache_keys import references
from wrinklecli.batch.jobs import BatchJob, Outcome
from wrinklecli.batch.staging import Staged
from wrinklecli.errors import BakeError
from wrinklecli.files.outputs import Outputs
from wrinklecli.gltf.uris import path_of
from wrinklecli.numeric.memory import MAX_MEMORY, held, parse_bytes
from wrinklecli.tools.records import parse_length

# The manifest's keys, by the names of `BakeOptions` where these differ.
_NAMES = {"anim": "anims", "clip": "clips", "tool": "only"}


@dataclass(frozen=True, slots=True)
class Built:
    """What a bake has made.

    Attributes:
        outcome: What is said of it; its seconds are for others to tell.
        files: Root (of `staging.ROOTS`), path from there and path here of each file; the main one last. None where
            `out` is no file.
    """

    outcome: Outcome
    files: list[tuple[str, str, str]]


def build(
    here: Staged, open_outputs: Callable[[], AbstractContextManager[Outputs]], own: Iterable[tuple[str, str]]
) -> Built:
    """Bake a job; its outputs are in their places here at the end, in folders that are made where they are missing.

    Args:
        here: The job.
        open_outputs: Opens what it writes into.
        own: Root and path from there of files that it wrote before and that nobody has changed since.

    Raises:
        WrinkleError: As `bake` and `track`. Then nothing is written of the bake; of tracks, all or nothing.
    """
    job = here.job
    options = bake_options(job)
    _make_folders(here)
    _forget_peak()
    with held(options.max_memory):
        with open_outputs() as outputs:
            outputs.own(os.path.join(here.roots[root][1], path) for root, path in own)
            for path in (job.report, job.timings):
                if path is not None:
                    outputs.claim(path)
            made = bake(job.asset, job.tools, job.out, options, outputs=outputs)
            if job.report is not None:
                outputs.add_bytes(job.report, here.as_asked(as_json(made.data)).encode())
            if job.timings is not None:
                outputs.add_bytes(job.timings, as_json(made.timings).encode())
        written = list(outputs.written)
        warnings = list(made.warnings)
        if job.anims and job.tracked is not None:
            with open_outputs() as outputs:
                tracked = track(
                    job.out,
                    job.anims,
                    job.tracked,
                    fps=options.fps or 30.0,
                    allow_external=options.allow_external,
                    max_memory=options.max_memory,
                    strict=options.strict,
                    outputs=outputs,
                )
            written += outputs.written
            warnings += [line for each in tracked for line in each.warnings]
    outcome = Outcome(
        job,
        "built",
        peak_memory=peak_memory(),
        summary=made.summary,
        warnings=tuple(map(here.as_asked, warnings)),
        residual=_residual(made),
        tallest=made.data["tallest_wrinkle"],
    )
    return Built(outcome, _files(here, written))


def _make_folders(here: Staged) -> None:
    """Make the folders that a job writes into. They stay where it fails: another job may be about to write there."""
    for _, folder in here.roots.values():
        try:
            os.makedirs(folder or ".", exist_ok=True)
        except OSError as error:
            raise BakeError(f"cannot be written: {error.strerror}", where=folder) from error


def bake_options(job: BatchJob) -> BakeOptions:
    """The options of a job as `bake` takes them."""
    values: dict[str, Any] = {_NAMES.get(key, key): value for key, value in job.options.items()}
    if "max_error" in values:
        values["max_error"] = parse_length(values["max_error"])
    values["max_memory"] = parse_bytes(values["max_memory"]) if "max_memory" in values else MAX_MEMORY
    return BakeOptions(details=job.report is not None, **values)


def _residual(made: Report) -> float | None:
    proven = [clip["residual"]["position"] for clip in made.data["clips"] if clip.get("residual")]
    return max(proven, default=None)


def _files(here: Staged, written: list[str]) -> list[tuple[str, str, str]]:
    """What a cache has to keep: what was written, and what the outputs refer to, which may have been there."""
    job = here.job
    if not os.path.isfile(job.out):  # a pipe or a device, which has nothing to keep
        return []
    models = [job.out, *(path for path in written if here.roots.get("tracked") and _within(path, here, "tracked"))]
    for model in models:
        with open(model, "rb") as file:
            uris = references(file)
        written += [os.path.join(os.path.dirname(model), path_of(uri)) for uri in uris]
    files = {}
    for path in written:
        for root in here.roots:
            if os.path.exists(path) and (relative := _within(path, here, root)) is not None:
                files[os.path.abspath(path)] = (root, relative, path)
                break
    main = files.pop(os.path.abspath(job.out))
    return [*files.values(), ("out", main[1] if main[0] == "out" else os.path.basename(job.out), main[2])]


def _within(path: str, here: Staged, root: str) -> str | None:
    """A path as seen from the folder of a root; none where it is outside."""
    relative = os.path.relpath(path, here.roots[root][1] or ".")
    return None if relative.split(os.sep)[0] == os.pardir else relative


def _forget_peak() -> None:
    """Begin to count the most memory held anew, where the system can: see `proc_pid_clear_refs(5)`."""
    with suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")
