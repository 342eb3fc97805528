"""Finds files that a batch would write though it reads them, or would write twice, before anything is written.

Files are compared by device and inode or by real path, and URLs by their parts. The inputs of a batch are its manifest
and, for each job, the assets, tools and clips, and the files that those assets refer to. Names of some outputs depend
on the bake: for these, each job gets the files of the batch that it may not touch.
"""

import os
import posixpath
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

from wrinklecli.batching import stores
from wrinklecli.batching.cache import ENTRIES, TAG
from wrinklecli.batching.jobs import BatchJob, uris_beside
from wrinklecli.files.claims import Claims, Clash, Identities, Identity
from wrinklecli.files.formats import MODEL_ENDINGS
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import path_beside, references
from wrinklecli.texture.map_files import MAPS_JSON
from wrinklecli.tools.yaml_tree import printable

Owner: TypeAlias = int | str
"""The number of a job, or words for what else uses a file."""

_MANIFEST, _REPORT, _CACHE, _JUNIT = "the manifest", "--report", "--cache", "--junit"
# A buffer that an earlier bake has written beside its OUT: the name of OUT, and a digest.
_BUFFER = re.compile(r"(.+)-[0-9a-f]{12}\.bin")
# Other names of the protocols of stores, and protocols of local files.
_SAME_STORES = {"s3a": "s3", "gcs": "gs", "abfss": "abfs", "az": "abfs"}
_LOCAL = ("file", "local")


@dataclass(frozen=True, slots=True)
class BatchFiles:
    """Files of a batch itself; a pattern of assets has no manifest, and None stands for a file that is not written."""

    manifest: str = ""
    included: tuple[str, ...] = ()
    report: str | None = None
    cache: str | None = None
    junit: str | None = None


NOTHING_WRITTEN = BatchFiles()


@dataclass(frozen=True, slots=True)
class Conflict:
    """A file that may not be written, and the number of the job at fault; None if the batch itself is."""

    job: int | None
    path: str
    message: str


def kept_apart(
    jobs: Sequence[BatchJob], names: Sequence[str], files: BatchFiles
) -> tuple[list[BatchJob], list[Conflict]]:
    """Give each job the files of others that it may not touch, and find the conflicts of a batch.

    `names` has a name of each job for messages, which may be empty.

    Raises:
        StoreError: A store does not answer.
    """
    batch = _Batch(jobs, names)
    batch.add(files)
    return [replace(job, others=batch.others(number)) for number, job in enumerate(jobs)], batch.conflicts


class _Places(Identities):
    """Identities of local files, and of files at URLs; each path is looked up once."""

    def __init__(self) -> None:
        super().__init__()
        self._known: dict[str, tuple[str, tuple[Identity, ...]]] = {}

    def look_up(self, path: str) -> tuple[str, tuple[Identity, ...]]:
        if path not in self._known:
            parts = _url_parts(path)
            self._known[path] = (stores.folder_of(path), (parts,)) if parts else super().look_up(_local(path))
        return self._known[path]

    def of_folder(self, folder: str) -> Identity:
        return _url_parts(folder) or super().of_folder(_local(folder))

    def upwards(self, folder: str) -> Iterator[Identity]:
        parts = _url_parts(folder)
        yield from (parts[:count] for count in range(len(parts), 0, -1)) if parts else super().upwards(_local(folder))


def _url_parts(path: str) -> Identity:
    """The store of a URL and the names in the URL; empty for a local file."""
    scheme, colon, rest = path.partition("://")
    if not colon or not stores.is_url(path) or scheme in _LOCAL:
        return ()
    names = posixpath.normpath(rest.strip("/")).split("/")
    return (f"{_SAME_STORES.get(scheme, scheme)}:", *(name for name in names if name != "."))


def _local(path: str) -> str:
    return path.partition("://")[2] if stores.is_url(path) else path


class _Batch:
    """The files of a batch, each with the first job that uses it, and the conflicts found among them."""

    def __init__(self, jobs: Sequence[BatchJob], names: Sequence[str]) -> None:
        self.conflicts: list[Conflict] = []
        self._jobs, self._names = jobs, names
        self._places = _Places()
        self._claims = Claims[Owner](self._places.of)
        self._noted: set[tuple[str, Owner]] = set()
        self._inputs: set[str] = set()
        # Folders that have an output somewhere below, and those that have a file that is no output of a bake.
        self._written_below: set[Identity] = set()
        self._used_below: set[Identity] = set()
        # Folders in which, or below which, bakes write files whose names are not known yet.
        self._anything_below: set[Identity] = set()
        self._cached: set[Identity] = set()  # the folders of the cache
        # By folder of frames or maps, the files there; by folder and name of an OUT, buffers of earlier bakes.
        self._in_folders = {self._places.of_folder(each): list[str]() for job in jobs for each in job.open_folders}
        self._buffers: defaultdict[tuple[Identity, str], list[str]] = defaultdict(list)
        self._references: dict[str, list[str]] = {}
        self._tools = {path for job in jobs for path in job.tools}

    def add(self, files: BatchFiles) -> None:
        """Add the files of the batch itself, then those of its jobs, and those that their inputs refer to."""
        if files.cache is not None:
            self._cached = {self._places.of_folder(stores.join(files.cache, each)) for each in ENTRIES}
            self._write(files.cache, _CACHE)
            self._write(stores.join(files.cache, TAG), _CACHE)
        if files.manifest:
            self._read(files.manifest, _MANIFEST)
        for path in files.included:
            self._read(path, "an included manifest")
        if files.report is not None:
            self._write(files.report, _REPORT)
        if files.junit is not None:
            self._write(files.junit, _JUNIT)
        for number, job in enumerate(self._jobs):
            outs = [out for _, out in job.models]
            for path in filter(None, (*outs, job.report, job.timings, job.options.get("frames_dir"))):
                self._write(path, number)
            maps_dir = job.options.get("maps_dir")
            if maps_dir is not None and self._write(maps_dir, number):
                self._write(stores.join(maps_dir, MAPS_JSON), number)
            # In these, or below, a job writes files whose names depend on the bake.
            beside = [stores.folder_of(out) for out in outs if out.lower().endswith(".gltf")]
            for folder in (*beside, *job.open_folders):
                self._anything_below.add(self._places.of_folder(folder))
                self._add_above(stores.join(folder, "_"), self._written_below)
            for path in job.inputs:
                self._read(path, number)
        for number, job in enumerate(self._jobs):
            for asset in (job.asset, *job.tools, *job.anims, *job.options.get("anim", ())):
                if self._may_refer_to_outputs(asset, job):
                    for path in self._files_of(asset, external=_is_external(job)):
                        self._read(path, number)

    def _may_refer_to_outputs(self, asset: str, job: BatchJob) -> bool:
        """False if no output is in the folder of an asset or below, where the files are that it refers to."""
        folder = stores.folder_of(asset)
        return (
            self._places.of_folder(folder) in self._written_below
            or not self._anything_below.isdisjoint(self._places.upwards(folder))
            or self._places.have_several_names
            or _is_external(job)
        )

    def others(self, number: int) -> tuple[str, ...]:
        """The files of other jobs, and of the batch, that a job would write or remove if a bake gave them as names."""
        job, found = self._jobs[number], list[str]()
        for each in job.open_folders:
            found += self._in_folders[self._places.of_folder(each)]
        for asset, out in job.models:
            if not out.lower().endswith(".gltf"):
                continue
            folder = self._places.of_folder(stores.folder_of(out))
            found += self._buffers.get((folder, os.path.splitext(posixpath.basename(out))[0]), ())
            if folder in self._used_below:  # and so may have a file where an image is written
                found += self._files_of(asset, beside=out, external=False)
        owners = ((path, self._claims.owner_of(path)) for path in dict.fromkeys(found))
        return tuple(path for path, owner in owners if owner not in (None, number))

    def _read(self, path: str, owner: Owner) -> None:
        if path in self._inputs:
            return
        self._inputs.add(path)
        inner, chained, outer = path.rpartition("::")
        if chained and stores.is_url(inner):  # a file of an archive, as in zip://a.glb::https://…
            self._read(outer, owner)
        self._note(self._claims.add_input(path, owner))
        for folder in self._add(path, owner, self._used_below):
            buffer = _BUFFER.fullmatch(posixpath.basename(path))
            if buffer:
                self._buffers[folder, buffer[1]].append(path)

    def _write(self, path: str, owner: Owner) -> bool:
        """Note that a file is written; False if it is in conflict with one that was noted before."""
        clash = self._claims.add_output(path, owner)
        self._note(clash)
        self._add(path, owner, self._written_below)
        if not path.lower().endswith(MODEL_ENDINGS):
            self._add_above(path, self._used_below)
        return clash is None

    def _add(self, path: str, owner: Owner, below: set[Identity]) -> set[Identity]:
        """Note a file in its folders, and give them: two if the file is a link."""
        folders = {self._places.of_folder(each) for each in (stores.folder_of(path), self._places.look_up(path)[0])}
        for folder in folders & self._in_folders.keys():
            self._in_folders[folder].append(path)
        if self._cached and owner != _CACHE and not self._cached.isdisjoint(self._above(path)):
            self._refuse(owner, path, "is inside the cache, which has files of its own")
        self._add_above(path, below)
        return folders

    def _add_above(self, path: str, below: set[Identity]) -> None:
        for each in self._above(path):
            if each in below:
                break
            below.add(each)

    def _above(self, path: str) -> Iterator[Identity]:
        """The identity of each folder that a file is in."""
        return self._places.upwards(self._places.look_up(path)[0])

    def _note(self, clash: Clash[Owner] | None) -> None:
        """Turn a clash into a conflict, once for each output."""
        if clash is None or (clash.output, clash.writer) in self._noted:
            return
        self._noted.add((clash.output, clash.writer))
        writer, other = clash.writer, clash.other
        if not clash.is_input:
            self._refuse(writer, clash.output, f"is {self._output_of(other, writer)} too: each needs a name of its own")
        elif isinstance(writer, int):
            reads = f"{self._name(other)} reads" if isinstance(other, int) else f"is {other}"
            message = f"would write over {printable(clash.output)!r}, which {reads}"
            self.conflicts.append(Conflict(writer, clash.output, message))
        else:
            self._refuse(writer, clash.output, "is a file of the batch too and would be overwritten")

    def _output_of(self, other: Owner, writer: Owner) -> str:
        if other == writer:
            return "another output of this job"
        if isinstance(other, int) and isinstance(writer, int) and self._names[other] == self._names[writer]:
            return "an output of another asset"
        return f"an output of {self._name(other)}"

    def _refuse(self, owner: Owner, path: str, message: str) -> None:
        if isinstance(owner, int):
            self.conflicts.append(Conflict(owner, path, f"{printable(path)!r} {message}"))
        else:
            self.conflicts.append(Conflict(None, path, message))

    def _name(self, owner: Owner) -> str:
        return owner if isinstance(owner, str) else self._names[owner] or "a job"

    def _files_of(self, asset: str, *, external: bool, beside: str | None = None) -> Iterator[str]:
        """The files that an asset refers to, or those that it would refer to from beside another path."""
        places = (path_beside(beside or asset, uri, external=external) for uri in self._uris(asset))
        return (place for place in places if place is not None)

    def _uris(self, asset: str) -> list[str]:
        """The references of an asset; none if it cannot be read, which its job will say."""
        if asset not in self._references:
            try:
                with stores.opened(asset) as file:
                    is_model = asset not in self._tools
                    self._references[asset] = references(file) if is_model else uris_beside(file)
            except (OSError, ValueError):
                self._references[asset] = []
        return self._references[asset]


def _is_external(job: BatchJob) -> bool:
    return bool(job.options.get("allow_external", False))
