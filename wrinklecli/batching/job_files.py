"""The files that a job writes, as the job and its inputs name them: a record of a cache cannot add others.

A file has a root, one of `ROOTS`, and a path in the folder of the root, with slashes.
"""

import os
import posixpath
import re
from contextlib import suppress

from wrinklecli.batching.cache_keys import Parts
from wrinklecli.batching.jobs import OPEN_FOLDERS, BatchJob
from wrinklecli.files.outputs import Outputs
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.files import files_named, leaves_folder, path_of
from wrinklecli.texture.map_files import MAPS_JSON, is_map_file
from wrinklecli.tools.files_beside import with_files_beside

ROOTS = ("report", "timings", *OPEN_FOLDERS, "tracked", "out")
"""The outputs of a job, each in a folder of its own or a shared one; the main output last."""


@dataclass(frozen=True, slots=True)
class _Model:
    """A glTF file that a job writes: its root and name, and the digests of files that its source refers to, by path."""

    root: str
    name: str
    beside: dict[str, str]

    def has_beside(self, root: str, path: str, digest: str) -> bool:
        """True if the glTF file may refer to a file: a copy of one of its source, or one with a digest for a name."""
        if root != self.root or not self.name.lower().endswith(".gltf"):
            return False
        stem, ending = posixpath.splitext(self.name)[0], posixpath.splitext(path)[1]
        return path == f"{stem}-{digest[:12]}{ending}" or self.beside.get(path) == digest


class JobFiles:
    """The files that a job writes, by the parts of its cache key.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: The parts are not those of a job.
    """

    def __init__(self, parts: Parts) -> None:
        names, options = parts["names"], parts["options"]
        self.main = ("out", names["out"])
        self._models = [_Model("out", names["out"], _by_path(parts["asset"]))]
        self._models += [_Model("tracked", name, _by_path(digests)) for name, digests in parts["anims"]]
        self.named = {(each.root, each.name) for each in self._models}
        self.named |= {(key, names[key]) for key in ("report", "timings") if names[key]}
        self._has_maps = bool(options["maps"])
        if self._has_maps:
            self.named.add(("maps_dir", MAPS_JSON))
        kind = re.escape(options.get("frames_format", "obj"))
        self._frame = re.compile(rf"[A-Za-z0-9_.-]+_[0-9]{{4,}}\.{kind}") if options["frames"] else None

    def has(self, root: str, path: str, digest: str) -> bool:
        """True if the job may write a file with a SHA-256 digest as one of its outputs."""
        if "\0" in path:
            return False
        if (root, path) in self.named:
            return True
        if root == "frames_dir":
            return self._frame is not None and self._frame.fullmatch(path) is not None
        if root == "maps_dir":
            return self._has_maps and is_map_file(path)
        return any(model.has_beside(root, path, digest) for model in self._models)


def protect(job: BatchJob, outputs: Outputs) -> None:
    """Let no output of a job, nor of a step of it, overwrite an input of the job or a file of another one."""
    outputs.protect(files_named(job.inputs))
    outputs.protect(with_files_beside(job.tools))
    outputs.protect(job.others, used="a file of another job")


def path_in(folder: str, path: str) -> str | None:
    """The path of a local file in a folder, with slashes; None if the file is not inside."""
    relative = os.path.relpath(path, folder or os.curdir).replace(os.sep, "/")
    return None if relative.split("/")[0] == os.pardir else relative


def _by_path(digests: dict[str, str]) -> dict[str, str]:
    """The digests of the files that an asset refers to, by path in its folder; those outside are left out."""
    found = {}
    for uri, digest in digests.items():
        with suppress(UnicodeEncodeError):  # such a URI names no file
            if uri and not leaves_folder(uri):
                found[os.path.normpath(path_of(uri)).replace(os.sep, "/")] = digest
    return found
