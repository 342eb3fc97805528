"""Bake one job by the function behind `wrinkle bake`, and track its other clips."""

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

from wrinklecli.baking.job import BakeOptions
from wrinklecli.baking.report import text_of
from wrinklecli.baking.timings import peak_memory
from wrinklecli.baking.track import track
from wrinklecli.batching.cache import Solutions
from wrinklecli.batching.job_files import path_in, protect
from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.staging import Staged
from wrinklecli.choices import FPS
from wrinklecli.effects.kept import solutions_in
from wrinklecli.errors import BakeError
from wrinklecli.files.outputs import Outputs
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import path_beside, references
from wrinklecli.numeric.memory import held
from wrinklecli.texture.with_bake import bake_with_maps
from wrinklecli.tools.records import parse_length

# The manifest's keys that `BakeOptions` calls otherwise.
_NAMES = {"anim": "anims", "clip": "clips", "tool": "only"}


@dataclass(frozen=True, slots=True)
class Built:
    """A finished bake: its outcome without seconds, and its files, the main one last.

    A file is its root (one of `job_files.ROOTS`), its path in the root, and its local path. There are no files if `out`
    is no regular file.
    """

    outcome: Outcome
    files: list[tuple[str, str, str]]


def build(
    here: Staged,
    open_outputs: Callable[[], AbstractContextManager[Outputs]],
    own: Iterable[tuple[str, str]],
    solutions: Solutions,
) -> Built:
    """Bake a job and put its outputs into their local places; missing folders are made.

    `own` has root and path of each file that the job wrote earlier and that nobody has changed since, `solutions` those
    of regions of flesh.

    Raises:
        WrinkleError: `bake` or `track` fails. Then nothing of the bake is written; of the tracks, all or nothing.
    """
    job = here.job
    options = bake_options(job)
    for _, folder in here.roots.values():  # if the job fails, they go when the batch ends
        try:
            os.makedirs(folder or ".", exist_ok=True)
        except OSError as error:
            raise BakeError(f"cannot be written: {error.strerror}", where=folder) from error
    # A new count of the peak memory, if the system can: see `proc_pid_clear_refs(5)`.
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    with held(options.max_memory), solutions_in(solutions):
        with open_outputs() as outputs:
            protect(job, outputs)
            outputs.own(os.path.join(here.roots[root][1], path) for root, path in own)
            for path in (job.report, job.timings):
                if path is not None:
                    outputs.claim(path)
            maps_dir = job.options.get("maps_dir")
            report, mapped = bake_with_maps(job.asset, job.tools, job.out, maps_dir, options, outputs=outputs)
            if job.report is not None:
                outputs.add_bytes(job.report, here.with_given_paths(text_of(report.data)).encode())
            if job.timings is not None:
                outputs.add_bytes(job.timings, text_of(report.timings).encode())
        written = list(outputs.written)
        warnings = [*report.warnings, *(mapped.warnings if mapped else ())]
        if job.anims and job.tracked is not None:
            with open_outputs() as outputs:
                protect(job, outputs)
                tracked = track(
                    job.out,
                    job.anims,
                    job.tracked,
                    fps=options.fps or FPS,
                    allow_external=options.allow_external,
                    max_memory=options.max_memory,
                    strict=options.strict,
                    outputs=outputs,
                )
            written += outputs.written
            warnings += [line for each in tracked for line in each.warnings]
    proven = [clip["residual"]["position"] for clip in report.data["clips"] if clip.get("residual")]
    outcome = Outcome(
        job,
        "built",
        peak_memory=peak_memory(),
        summary=f"{report.summary}; maps: {mapped.summary}" if mapped else report.summary,
        warnings=tuple(dict.fromkeys(map(here.with_given_paths, warnings))),
        residual=max(proven, default=None),
        tallest=report.data["tallest_wrinkle"],
    )
    return Built(outcome, _files_to_keep(here, written, mapped.paths if mapped else ()))


def bake_options(job: BatchJob) -> BakeOptions:
    """Convert the options of a job to those of `bake`."""
    of_bake = {key: value for key, value in job.options.items() if key != "maps_dir"}
    values: dict[str, Any] = {_NAMES.get(key, key): value for key, value in of_bake.items()}
    if "max_error" in values:
        values["max_error"] = parse_length(values["max_error"])
    values["max_memory"] = job.max_memory
    return BakeOptions(details=job.report is not None, **values)


def _files_to_keep(here: Staged, written: list[str], maps: Sequence[str]) -> list[tuple[str, str, str]]:
    """List the files that the cache has to keep: the named outputs, files that they refer to, maps, and frames."""
    job = here.job
    if not os.path.isfile(job.out):  # a pipe or a device, which cannot be read again
        return []
    (_, main), *others = job.models
    models = [("out", main), *(("tracked", path) for _, path in others)]
    found = [(root, path) for root in ("report", "timings") if (path := getattr(job, root))]
    for root, model in models:
        with open(model, "rb") as file:
            uris = references(file)
        places = (path_beside(model, uri, external=False) for uri in uris)
        found += [(root, place) for place in places if place is not None]
    found += [("maps_dir", path) for path in maps]
    found += models
    known = {os.path.abspath(path) for _, path in found}
    if "frames_dir" in job.options:
        found += [("frames_dir", path) for path in written if os.path.abspath(path) not in known]
    files = {}
    for root, path in found:
        relative = path_in(here.roots[root][1], path) if os.path.isfile(path) else None
        if relative is not None:
            files[root, relative] = path
    name = ("out", os.path.basename(main))
    files[name] = files.pop(name)
    return [(root, path, local) for (root, path), local in files.items()]
