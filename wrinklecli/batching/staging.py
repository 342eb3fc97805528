"""Work on a job with URLs as on one with local files: fetch its inputs, and send its outputs when all are complete."""

import errno
import os
import posixpath
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from wrinklecli.batching import stores
from wrinklecli.batching.job_files import ROOTS
from wrinklecli.batching.jobs import OPEN_FOLDERS, BatchJob, References, uris_beside
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import leaves_folder, path_of, references


@dataclass(frozen=True, slots=True)
class Staged:
    """A job with local paths.

    `given` maps a local path to that of the manifest; `fetched` has the URLs that were read; `roots` has the manifest's
    folder and the local one of each of `ROOTS` that the job names.
    """

    job: BatchJob
    given: dict[str, str]
    fetched: set[str]
    roots: dict[str, tuple[str, str]]

    def with_given_paths(self, text: str) -> str:
        """Replace local paths in a text by those of the manifest."""
        for local in sorted(self.given, key=len, reverse=True):
            text = text.replace(local, self.given[local])
        return text


@contextmanager
def staged(job: BatchJob) -> Iterator[Staged]:
    """Keep local copies of the files at URLs while the block runs.

    Raises:
        AssetError: An input cannot be read.
        StoreError: A store does not answer.
    """
    if not any(map(stores.is_url, (*job.inputs, *job.outputs))):
        yield Staged(job, {}, set(), roots_of(job, job))
        return
    with stores.scratch() as folder:
        yield _Stager(folder, job.max_memory).staged(job)


class _Stager:
    """Fetches files of URLs into a folder; each folder of a store gets a subfolder.

    `most` is the largest size of a file, and of an asset together with the files that it refers to, in bytes.
    """

    def __init__(self, folder: str, most: int) -> None:
        self._folder, self._most = folder, most
        self._folders: dict[str, str] = {}
        self._given: dict[str, str] = {}
        self._fetched: set[str] = set()

    def staged(self, job: BatchJob) -> Staged:
        external = bool(job.options.get("allow_external", False))
        local = job.with_paths(
            asset=partial(self._with_references, references_in=references, external=external),
            tools=partial(self._with_references, references_in=uris_beside, external=external),
            file=self._output,
            folder=partial(self._output, is_folder=True),
        )
        return Staged(local, self._given, self._fetched, roots_of(job, local))

    def _place(self, url: str, kind: str) -> str:
        """The local path of a URL; files of one folder stay together."""
        above, name = posixpath.split(url)
        return os.path.join(self._folders.setdefault(kind + above, f"{self._folder}/{len(self._folders)}"), name)

    def _input(self, path: str) -> str:
        if not stores.is_url(path):
            return path
        local = self._place(path, "in ")
        self._given[local] = path
        self._fetched.add(path)
        try:
            if not os.path.exists(local):
                stores.fetch(path, local, self._most)
        except OSError as error:
            raise _unread(path, error) from error
        return local

    def _with_references(self, path: str, *, references_in: References, external: bool) -> str:
        """Fetch an asset or a tools file with the files that it refers to; the bake reports a missing one."""
        local = self._input(path)
        if local == path:
            return path
        with open(local, "rb") as file:
            uris = references_in(file)
        left = self._most - os.path.getsize(local)
        for uri in uris:
            if leaves_folder(uri):
                if external:
                    raise AssetError(f"uri {uri[:80]!r} is outside the file's folder: not read by URL", where=path)
                continue
            relative = os.path.normpath(path_of(uri))
            target = os.path.join(os.path.dirname(local), relative)
            self._given[target] = posixpath.join(posixpath.dirname(path), relative)
            self._fetched.add(self._given[target])
            try:
                if not os.path.exists(target):
                    stores.fetch(self._given[target], target, left)
                left -= os.path.getsize(target)
            except OSError as error:
                if error.errno == errno.EFBIG:
                    raise _unread(self._given[target], error) from error
        return local

    def _output(self, path: str, *, is_folder: bool = False) -> str:
        if not stores.is_url(path):
            return path
        file = self._place(stores.join(path, ".") if is_folder else path, "out ")
        folder = os.path.dirname(file)
        os.makedirs(folder, exist_ok=True)
        local = folder if is_folder else file
        self._given[local] = path
        return local


def _unread(path: str, error: OSError) -> AssetError:
    hint = ": raise max_memory" if error.errno == errno.EFBIG else ""
    return AssetError(f"cannot be read: {error.strerror or error}{hint}", where=path)


def roots_of(given: BatchJob, local: BatchJob) -> dict[str, tuple[str, str]]:
    """The folders of a job's outputs, as the manifest and as this process names them, by root."""
    pairs = {root: (_folder(given, root), _folder(local, root)) for root in ROOTS}
    return {root: (there, here) for root, (there, here) in pairs.items() if there is not None and here is not None}


def _folder(job: BatchJob, root: str) -> str | None:
    """The folder that a root names; for outputs that are files, the folder of the file."""
    path: str | None = job.options.get(root) if root in OPEN_FOLDERS else getattr(job, root)
    return path if path is None or root in ("tracked", *OPEN_FOLDERS) else stores.folder_of(path)


def send(staged: Staged, files: list[tuple[str, str]], own: set[tuple[str, str]]) -> None:
    """Copy files to the stores that the manifest names, unless their roots are local; the main one last.

    A file is its root and its path in the root. The job may replace its `own` files, which it wrote earlier.

    Raises:
        WrinkleError: A store does not take a file, or has another image of that name, or the file is an input or
            one of another job.
    """
    for root, path in files:
        given, local = staged.roots[root]
        if given == local:
            continue
        target = stores.join(given, path.replace(os.sep, "/"))
        if target in staged.job.others:
            raise BakeError("is a file of another job too and would be overwritten", where=target)
        if root in OPEN_FOLDERS and target in staged.fetched:
            raise BakeError("is an input too and would be overwritten", where=target)
        image = root == "out" and path != os.path.basename(staged.job.out) and not path.endswith(".bin")
        try:
            data = Path(local, path).read_bytes()
            if image and (root, path) not in own and stores.read_if_there(target) not in (None, data):
                raise BakeError("is there already and is another image; choose another folder", where=target)
            stores.put(target, data)
        except OSError as error:
            raise WrinkleError(f"cannot be written: {error.strerror or error}", where=target) from error
