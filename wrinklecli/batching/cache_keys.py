"""Cache keys: a digest of everything that the outputs of a job depend on.

The contents of the inputs count, and the version of this program. Times, folders and names of inputs do not, nor do
comments and the layout of tools files.
"""

import hashlib
import json
import os
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import wrinklecli
from wrinklecli.batching import stores
from wrinklecli.batching.jobs import OPEN_FOLDERS, BatchJob, References, uris_beside
from wrinklecli.batching.manifest_schema import OPTION_KEYS
from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.gltf.files import path_beside, references
from wrinklecli.tools.yaml_tree import MAX_BYTES, read_tree

Parts: TypeAlias = dict[str, Any]
"""Everything that a key depends on, by name, as JSON values."""

_MISSING = "missing"  # stands for the digest of a missing file
# Options that do not count by value: the contents of `anim` count, the names of folders do not matter, and `max_memory`
# only decides between a bake and an error.
_IGNORED_OPTIONS = ("anim", "max_memory", *OPEN_FOLDERS)
_NAMED_OUTPUTS = ("out", "report", "timings")  # their file names count: outputs refer to each other


@cache
def program() -> str:
    """The version of this program: its number and a digest of its source."""
    folder = os.path.dirname(wrinklecli.__file__)
    digest = hashlib.sha256()
    for path in sorted(os.path.join(top, name) for top, _, names in os.walk(folder) for name in names):
        if path.endswith((".py", ".yaml")):
            digest.update(Path(path).read_bytes())
    return f"{version('wrinklecli')}+{digest.hexdigest()[:16]}"


def parts_of(job: BatchJob, given: BatchJob) -> Parts:
    """List what the outputs of a job depend on. `job` has local inputs, and `given` those of the manifest.

    Raises:
        AssetError: An input cannot be read.
    """
    external = bool(job.options.get("allow_external", False))
    options = {
        key: value
        for key, value in job.options.items()
        if key not in _IGNORED_OPTIONS and value != OPTION_KEYS[key].get("default")
    }
    parts: Parts = {
        "program": program(),
        "asset": _digests(job.asset, references, external=external),
        "tools": [_digests(path, uris_beside, external=external, own=_digest_of_values) for path in job.tools],
        "anim": [_digests(path, references, external=external) for path in job.options.get("anim", ())],
        "anims": [[os.path.basename(path), _digests(path, references, external=external)] for path in job.anims],
        "options": {**options, "frames": "frames_dir" in job.options, "maps": "maps_dir" in job.options},
        # An output in the folder of its asset refers to the same files.
        "beside": [len({os.path.realpath(os.path.dirname(each)) for each in paths}) == 1 for paths in job.models],
        "names": {name: os.path.basename(getattr(job, name) or "") for name in _NAMED_OUTPUTS},
    }
    if job.report:  # a report names the inputs as the manifest does
        parts["names"]["given"] = [given.asset, *given.tools]
    return parts


def key_of(parts: Parts) -> str:
    """Digest the parts to a key."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def difference(old: Parts | None, new: Parts) -> str:
    """Say in words what has changed since the output was baked."""
    if old is None:
        return "new"
    words = {"program": "wrinkle", "asset": "the asset", "tools": "the tools", "anim": "clips", "anims": "clips"}
    words["beside"] = "the folder of an output"
    changed = [words.get(part, part) for part in new if old.get(part) != new[part]]
    return f"{', '.join(dict.fromkeys(changed))} changed" if changed else "the cache has lost it"


def _digests(
    path: str, references_in: References, *, external: bool, own: Callable[[str], str] | None = None
) -> dict[str, str]:
    """Digest a glTF asset or a tools file, and every file that it refers to, by URI; it has an empty one itself.

    `own` digests the file itself, if not its bytes count.

    Raises:
        AssetError: The file cannot be read. The bake reports other missing files.
    """
    digests = {"": (own or _digest)(path)}
    with stores.opened(path) as file:
        uris = references_in(file)
    for uri in uris:
        place = path_beside(path, uri, external=external)
        try:
            digests[uri] = _digest(place) if place else _MISSING
        except (AssetError, TooMuchError):
            digests[uri] = _MISSING
    return digests


def _digest_of_values(path: str) -> str:
    """Digest what a tools file says; its bytes if these are no sound YAML, as the bake then says.

    Raises:
        AssetError: The file cannot be read.
    """
    try:
        with stores.opened(path) as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise AssetError(f"cannot be read: {stores.reason_of(error)}", where=path) from error
    return _digest(path) if len(data) > MAX_BYTES else _digest_of_yaml(data)


@lru_cache(maxsize=16)  # many jobs have the same tools, and parsing takes longer than all else that a hit takes
def _digest_of_yaml(data: bytes) -> str:
    try:
        root, problems = read_tree(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        root, problems = None, []
    if root is not None and not problems:
        data = json.dumps(root.value).encode()
    return hashlib.sha256(data).hexdigest()


def _digest(path: str) -> str:
    try:
        with stores.opened(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    except (OSError, ValueError) as error:
        raise AssetError(f"cannot be read: {stores.reason_of(error)}", where=path) from error
