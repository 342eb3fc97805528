"""A job of a batch and its outcome, as plain values that can be sent to other processes."""

import posixpath
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import Any, BinaryIO, Literal, TypeAlias

from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import uri_of
from wrinklecli.numeric.memory import MAX_MEMORY, parse_bytes
from wrinklecli.tools.files_beside import files_beside

Result: TypeAlias = Literal["hit", "built", "refused", "failed", "bug"]

OPEN_FOLDERS = ("frames_dir", "maps_dir")
"""The options that name a folder of outputs."""

References: TypeAlias = Callable[[BinaryIO], list[str]]
"""Lists the files that an open file refers to, as URIs."""


def uris_beside(file: BinaryIO) -> list[str]:
    """List the images and presets that an open tools file names, as URIs."""
    return list(map(uri_of, files_beside(file)))


@dataclass(frozen=True, slots=True)
class BatchJob:
    """One bake of a manifest. Every path may be a URL.

    Attributes:
        where: Place in the manifest, for messages.
        asset: Asset to read.
        tools: Tools files, merged if there are several.
        out: Asset to write.
        options: Options of the bake, by the manifest's keys.
        anims: Files that get the wrinkles of `out`, as from `wrinkle track`.
        tracked: Folder for the tracked files.
        report: Report to write.
        timings: Timings to write.
        others: Files of other jobs, and of the batch, that this job may neither replace nor remove, although names that
            depend on the bake might be theirs.
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
    others: tuple[str, ...] = ()

    @property
    def inputs(self) -> tuple[str, ...]:
        """All files that the job names to be read."""
        return (self.asset, *self.tools, *self.anims, *self.options.get("anim", ()))

    @property
    def models(self) -> list[tuple[str, str]]:
        """Each asset that the job reads to change it, and the path of the changed one; the main asset first."""
        folder = self.tracked
        tracked = (
            [] if folder is None else [(each, posixpath.join(folder, posixpath.basename(each))) for each in self.anims]
        )
        return [(self.asset, self.out), *tracked]

    @property
    def outputs(self) -> tuple[str, ...]:
        """All files and folders that the job names to be written."""
        named = (self.out, self.tracked, self.report, self.timings, *self.open_folders)
        return tuple(path for path in named if path)

    @property
    def open_folders(self) -> tuple[str, ...]:
        """The folders of frames and of maps, whose files have names that depend on the bake."""
        return tuple(self.options[key] for key in OPEN_FOLDERS if key in self.options)

    @property
    def max_memory(self) -> int:
        """The bytes that the job may take, and that a file which it reads by URL may have."""
        return parse_bytes(self.options["max_memory"]) if "max_memory" in self.options else MAX_MEMORY

    def with_paths(
        self,
        *,
        asset: Callable[[str], str],
        tools: Callable[[str], str],
        file: Callable[[str], str],
        folder: Callable[[str], str],
        other: Callable[[str], str] = lambda path: path,
    ) -> "BatchJob":
        """Replace every path by a function of it: of assets and tools to read, of files and folders to write.

        `other` gives the paths of files that belong to others.
        """
        options = dict(self.options)
        if "anim" in options:
            options["anim"] = tuple(map(asset, options["anim"]))
        for key in OPEN_FOLDERS:
            if key in options:
                options[key] = folder(options[key])
        return replace(
            self,
            asset=asset(self.asset),
            tools=tuple(map(tools, self.tools)),
            anims=tuple(map(asset, self.anims)),
            out=file(self.out),
            report=file(self.report) if self.report else None,
            timings=file(self.timings) if self.timings else None,
            tracked=folder(self.tracked) if self.tracked else None,
            others=tuple(map(other, self.others)),
            options=options,
        )


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a job.

    Attributes:
        result: `hit` if the outputs were in the cache, `built` if they were baked; `refused` and `failed` stand for
            the exit codes 3 and 1 of a bake, `bug` for a fault of this program.
        reason: Why the job was (or would be) baked; for a hit, whether its files were in their places already.
        seconds: Time that the job took.
        key: Cache key of the job; empty if an input cannot be read.
        peak_memory: Largest memory of the process during the job, bytes; None if the system does not tell.
        summary: One line about the output.
        residual: Largest distance of the file from the method, scene units; None without proof.
        tallest: Height of the tallest wrinkle, scene units.
        lines: Error messages.
        worker: Address of the worker; empty for this process.
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
        """True if the job's files are in their places."""
        return self.result in ("hit", "built")
