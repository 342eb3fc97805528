"""A job with files of URLs, as one with files here: inputs are fetched, outputs sent when all of them are there."""

import os
import posixpath
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from wrinklecli.batch import stores
from wrinklecli.batch.cache_keys import references
from wrinklecli.batch.jobs import BatchJob
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.files.workplace import Workplace
from wrinklecli.gltf.uris import path_of

ROOTS = ("report", "timings", "frames_dir", "tracked", "out")
"""The folders that a job writes into, by what they are for; the main one last."""


@dataclass(frozen=True, slots=True)
class Staged:
    """A job as it is done here.

    Attributes:
        job: With paths of this machine.
        folder: Where fetched and unsent files are; none where there are none.
        asked: Paths that were asked for, by those that stand for them here.
        roots: The folder asked for and the one that stands for it here, of each of `ROOTS` that the job has.
    """

    job: BatchJob
    folder: str | None
    asked: dict[str, str]
    roots: dict[str, tuple[str, str]]

    def as_asked(self, text: str) -> str:
        """Text with the paths that were asked for in place of those here."""
        for here in sorted(self.asked, key=len, reverse=True):
            text = text.replace(here, self.asked[here])
        return text


@contextmanager
def staged(job: BatchJob) -> Iterator[Staged]:
    """Fetch what is not here, as long as the block runs.

    Raises:
        AssetError: An input cannot be read.
        StoreError: A store does not answer.
    """
    paths = (job.asset, job.out, *job.tools, *job.anims, *job.options.get("anim", ()))
    others = (job.tracked, job.report, job.timings, job.options.get("frames_dir"))
    if not any(stores.is_url(path) for path in (*paths, *others) if path):
        yield Staged(job, None, {}, _roots(job, job))
        return
    workplace = Workplace(tempfile.gettempdir())
    try:
        yield _Stage(_made(workplace)).staged(job)
    finally:
        workplace.remove()


def _made(workplace: Workplace) -> str:
    """A folder in a workplace, which a later run takes away if this one is killed."""
    try:
        workplace.make()
        folder = workplace.next_path()
        os.mkdir(folder)
    except OSError as error:
        raise BakeError(f"cannot be written: {error.strerror}", where=tempfile.gettempdir()) from error
    return folder


class _Stage:
    """A folder that files of URLs are fetched into, each from another folder of its store into one of its own."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._folders: dict[str, str] = {}
        self.asked: dict[str, str] = {}

    def staged(self, job: BatchJob) -> Staged:
        external = bool(job.options.get("allow_external", False))
        options = dict(job.options)
        if "anim" in options:
            options["anim"] = tuple(self._asset(path, external=external) for path in options["anim"])
        if "frames_dir" in options:
            options["frames_dir"] = self._output_folder(options["frames_dir"])
        here = replace(
            job,
            asset=self._asset(job.asset, external=external),
            tools=tuple(map(self._input, job.tools)),
            anims=tuple(self._asset(path, external=external) for path in job.anims),
            out=self._output(job.out),
            report=self._output(job.report) if job.report else None,
            timings=self._output(job.timings) if job.timings else None,
            tracked=self._output_folder(job.tracked) if job.tracked else None,
            options=options,
        )
        return Staged(here, self._folder, self.asked, _roots(job, here))

    def _place(self, url: str, kind: str) -> str:
        """The path here of a URL; those of one folder stay beside each other."""
        above, name = posixpath.split(url)
        return os.path.join(self._folders.setdefault(kind + above, f"{self._folder}/{len(self._folders)}"), name)

    def _input(self, path: str) -> str:
        if not stores.is_url(path):
            return path
        here = self._place(path, "in ")
        self.asked[here] = path
        try:
            if not os.path.exists(here):
                stores.fetch(path, here)
        except OSError as error:
            raise AssetError(f"cannot be read: {error.strerror or error}", where=path) from error
        return here

    def _asset(self, path: str, *, external: bool) -> str:
        """Fetch an asset with the files that it refers to; where one is missing, the bake says so."""
        here = self._input(path)
        if here == path:
            return path
        with open(here, "rb") as file:
            uris = references(file)
        for uri in uris:
            relative = os.path.normpath(path_of(uri))
            if os.path.isabs(relative) or relative.split(os.sep)[0] == os.pardir:
                if external:
                    raise AssetError(f"uri {uri[:80]!r} is outside the asset's folder: not read by URL", where=path)
                continue
            target = os.path.join(os.path.dirname(here), relative)
            self.asked[target] = posixpath.join(posixpath.dirname(path), relative)
            try:
                if not os.path.exists(target):
                    stores.fetch(self.asked[target], target)
            except OSError:
                continue
        return here

    def _output(self, path: str) -> str:
        if not stores.is_url(path):
            return path
        here = self._place(path, "out ")
        os.makedirs(os.path.dirname(here), exist_ok=True)
        self.asked[here] = path
        return here

    def _output_folder(self, path: str) -> str:
        if not stores.is_url(path):
            return path
        here = os.path.dirname(self._place(stores.join(path, "."), "out "))
        os.makedirs(here, exist_ok=True)
        self.asked[here] = path
        return here


def _roots(asked: BatchJob, here: BatchJob) -> dict[str, tuple[str, str]]:
    found = {}
    for root in ROOTS:
        there, local = _root(asked, root), _root(here, root)
        if there is not None and local is not None:
            found[root] = there, local
    return found


def _root(job: BatchJob, root: str) -> str | None:
    """The folder of a job for `frames_dir` and `tracked`, that of the file for others."""
    if root == "frames_dir":
        return job.options.get(root)
    return job.tracked if root == "tracked" else _folder(getattr(job, root))


def _folder(path: str | None) -> str | None:
    if path is None:
        return None
    return posixpath.dirname(path) if stores.is_url(path) else os.path.dirname(path)


def send(staged: Staged, files: list[tuple[str, str]], own: set[tuple[str, str]]) -> None:
    """Put files into the stores that were asked for them, the main one last.

    Args:
        staged: The job.
        files: Root and path from there, of each file; those whose root is here are in their places.
        own: Those of them that this job wrote before, and that it may write over.

    Raises:
        WrinkleError: A store does not take one, or has another image of that name.
    """
    for root, path in files:
        asked, here = staged.roots[root]
        if asked == here:
            continue
        target = stores.join(asked, path.replace(os.sep, "/"))
        image = root == "out" and path != os.path.basename(staged.job.out) and not path.endswith(".bin")
        try:
            with open(os.path.join(here, path), "rb") as file:
                data = file.read()
            if image and (root, path) not in own and stores.read_if_there(target) not in (None, data):
                raise BakeError("is there already and is another image; choose another folder", where=target)
            stores.put(target, data)
        except OSError as error:
            raise WrinkleError(f"cannot be written: {error.strerror or error}", where=target) from error
